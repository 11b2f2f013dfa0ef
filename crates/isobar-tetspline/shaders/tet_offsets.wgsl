// K10, the scans of the sums of blocks: one workgroup for each of the 24 kinds; how many tetrahedra of the kind there are goes to `bases`, for now.

@group(0) @binding(2) var<storage, read> state: array<u32>;
@group(0) @binding(3) var<storage, read_write> totals: array<u32>;
@group(0) @binding(4) var<storage, read_write> bases: array<u32>;

var<workgroup> shared_sums: array<u32, 256>;
var<workgroup> carry: u32;

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    // A loop with barriers must end at the same time for all: its length is that of the room.
    let blocks = (min(state[3], params.room_cubes) + 255u) / 256u;
    let row = group.x * params.blocks;
    if local == 0u {
        carry = 0u;
    }
    workgroupBarrier();
    for (var base = 0u; base < params.blocks; base += 256u) {
        let at = base + local;
        var own = 0u;
        if at < blocks {
            own = totals[row + at];
        }
        shared_sums[local] = own;
        workgroupBarrier();
        for (var step = 1u; step < 256u; step <<= 1u) {
            var before = 0u;
            if local >= step {
                before = shared_sums[local - step];
            }
            workgroupBarrier();
            shared_sums[local] += before;
            workgroupBarrier();
        }
        if at < blocks {
            totals[row + at] = carry + shared_sums[local] - own;
        }
        workgroupBarrier();
        if local == 255u {
            carry += shared_sums[255];
        }
        workgroupBarrier();
    }
    if local == 0u {
        bases[group.x] = carry;
    }
}
