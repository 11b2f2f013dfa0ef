// K10: what the two kernels over active cubes share. The 24 flags of a cube are the bits of one number; their 24 scans over a block of 256 cubes are
// done at once, three counters of ten bits to a number.

struct Counts {
    low: vec4<u32>,
    high: vec4<u32>,
}

fn spread(mask: u32) -> Counts {
    let at = vec4(0u, 3u, 6u, 9u);
    let m = vec4(mask);
    let low = (m >> at & vec4(1u)) | (m >> (at + 1u) & vec4(1u)) << vec4(10u) | (m >> (at + 2u) & vec4(1u)) << vec4(20u);
    let n = vec4(mask >> 12u);
    let high = (n >> at & vec4(1u)) | (n >> (at + 1u) & vec4(1u)) << vec4(10u) | (n >> (at + 2u) & vec4(1u)) << vec4(20u);
    return Counts(low, high);
}

fn count_of(c: Counts, kind: u32) -> u32 {
    let word = kind / 3u;
    let three = select(c.low[word & 3u], c.high[word & 3u], word >= 4u);
    return three >> (10u * (kind % 3u)) & 1023u;
}

var<workgroup> shared_low: array<vec4<u32>, 256>;
var<workgroup> shared_high: array<vec4<u32>, 256>;

// Inclusive counts over the workgroup: at most 256, within ten bits.
fn inclusive(local: u32, own: Counts) -> Counts {
    shared_low[local] = own.low;
    shared_high[local] = own.high;
    workgroupBarrier();
    for (var step = 1u; step < 256u; step <<= 1u) {
        var low = vec4(0u);
        var high = vec4(0u);
        if local >= step {
            low = shared_low[local - step];
            high = shared_high[local - step];
        }
        workgroupBarrier();
        shared_low[local] += low;
        shared_high[local] += high;
        workgroupBarrier();
    }
    return Counts(shared_low[local], shared_high[local]);
}
