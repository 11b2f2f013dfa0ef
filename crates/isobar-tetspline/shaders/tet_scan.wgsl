// K9, the exclusive prefix scan of the flags of a chunk (Blelloch 1990; Harris et al. 2007, cited by Kalbe et al. 2009): blocks of 256 first,
// then the sums of blocks, to which the cubes found in earlier chunks are added.

@group(0) @binding(2) var<storage, read> flags: array<u32>;
@group(0) @binding(3) var<storage, read_write> scan: array<u32>;
@group(0) @binding(4) var<storage, read_write> sums: array<u32>;

var<workgroup> shared_sums: array<u32, 256>;

// Inclusive sums over the workgroup.
fn inclusive(local: u32, own: u32) -> u32 {
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
    return shared_sums[local];
}

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let block = group.y * ROW + group.x;
    let i = block * 256u + local;
    var own = 0u;
    if i < params.count {
        own = flags[i];
    }
    let sum = inclusive(local, own);
    if i < params.count {
        scan[i] = sum - own;
    }
    if local == 255u && block * 256u < params.count {
        sums[block] = sum;
    }
}
