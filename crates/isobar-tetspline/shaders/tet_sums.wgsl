// The exclusive scan of the sums of blocks, by one workgroup, and the number of active cubes so far: `state` is the indirect dispatch over active
// cubes (three numbers of workgroups) and their number.

@group(0) @binding(2) var<storage, read_write> sums: array<u32>;
@group(0) @binding(3) var<storage, read_write> state: array<u32>;

var<workgroup> shared_sums: array<u32, 256>;
var<workgroup> carry: u32;

@compute @workgroup_size(256)
fn main(@builtin(local_invocation_index) local: u32) {
    let blocks = (params.count + 255u) / 256u;
    if local == 0u {
        carry = state[3];
    }
    workgroupBarrier();
    for (var base = 0u; base < blocks; base += 256u) {
        var own = 0u;
        if base + local < blocks {
            own = sums[base + local];
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
        if base + local < blocks {
            sums[base + local] = carry + shared_sums[local] - own;
        }
        workgroupBarrier();
        if local == 255u {
            carry += shared_sums[255];
        }
        workgroupBarrier();
    }
    if local == 0u {
        let groups = (min(carry, params.room_cubes) + 255u) / 256u;
        state[0] = min(groups, ROW);
        state[1] = (groups + ROW - 1u) / ROW;
        state[2] = 1u;
        state[3] = carry;
    }
}
