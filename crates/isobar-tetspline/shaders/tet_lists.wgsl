// K10, the 24 compactions: every active tetrahedron of an active cube at its place in the list of its kind.

@group(0) @binding(2) var<storage, read> state: array<u32>;
@group(0) @binding(3) var<storage, read> cubes: array<u32>;
@group(0) @binding(4) var<storage, read> masks: array<u32>;
@group(0) @binding(5) var<storage, read> totals: array<u32>;
@group(0) @binding(6) var<storage, read> bases: array<u32>;
@group(0) @binding(7) var<storage, read_write> tetrahedra: array<u32>;

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let count = min(state[3], params.room_cubes);
    let block = group.y * ROW + group.x;
    let slot = block * 256u + local;
    var mask = 0u;
    if slot < count {
        mask = masks[slot];
    }
    let sum = inclusive(local, spread(mask));
    if slot < count {
        let entry = select(cubes[slot], slot, params.slots == 1u);
        var rest = mask;
        while rest != 0u {
            let kind = firstTrailingBit(rest);
            rest &= rest - 1u;
            let at = bases[kind] + totals[kind * params.blocks + block] + count_of(sum, kind) - 1u;
            if at < params.room_tets {
                tetrahedra[at] = entry;
            }
        }
    }
}
