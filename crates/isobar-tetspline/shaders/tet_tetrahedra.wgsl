// K10, the 24 classifications of tetrahedra, one invocation per active cube, and how many of each kind every block of 256 cubes has.

@group(0) @binding(3) var<storage, read> state: array<u32>;
@group(0) @binding(4) var<storage, read> cubes: array<u32>;
@group(0) @binding(5) var<storage, read_write> masks: array<u32>;
@group(0) @binding(6) var<storage, read_write> totals: array<u32>;

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let count = min(state[3], params.room_cubes);
    let block = group.y * ROW + group.x;
    let slot = block * 256u + local;
    var mask = 0u;
    if slot < count {
        let q = cube_of(cubes[slot]);
        mask = kinds_of(q, 192.0 * slack_of(data_hull(q)));
        masks[slot] = mask;
    }
    let sum = inclusive(local, spread(mask));
    if local == 255u && block * 256u < count {
        for (var kind = 0u; kind < 24u; kind++) {
            totals[kind * params.blocks + block] = count_of(sum, kind);
        }
    }
}
