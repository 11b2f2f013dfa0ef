// K9, the compaction: the index of every active cube of a chunk at its place in Q_active.

@group(0) @binding(2) var<storage, read> flags: array<u32>;
@group(0) @binding(3) var<storage, read> scan: array<u32>;
@group(0) @binding(4) var<storage, read> sums: array<u32>;
@group(0) @binding(5) var<storage, read_write> cubes: array<u32>;

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let block = group.y * ROW + group.x;
    let i = block * 256u + local;
    if i < params.count && flags[i] == 1u {
        let at = sums[block] + scan[i];
        if at < params.room_cubes {
            cubes[at] = params.first + i;
        }
    }
}
