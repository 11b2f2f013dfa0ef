// K23, Gaussian smoothing along one axis: samples outside the grid are those of the nearest one. One invocation per sample.

struct Smooth {
    dims: vec3<u32>,
    axis: u32,
}

const ROW: u32 = 256u;

@group(0) @binding(0) var<uniform> smoothing: Smooth;
@group(0) @binding(1) var<storage, read> source: array<f32>;
// from the middle outwards
@group(0) @binding(2) var<storage, read> weights: array<f32>;
@group(0) @binding(3) var<storage, read_write> smoothed: array<f32>;

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) local: u32) {
    let n = smoothing.dims;
    let i = (group.y * ROW + group.x) * 256u + local;
    if i >= n.x * n.y * n.z {
        return;
    }
    let stride = vec3(1u, n.x, n.x * n.y)[smoothing.axis];
    let count = n[smoothing.axis];
    let at = i / stride % count;
    var sum = weights[0] * source[i];
    for (var k = 1u; k < arrayLength(&weights); k++) {
        sum += weights[k] * source[i - min(k, at) * stride] + weights[k] * source[i + min(k, count - 1u - at) * stride];
    }
    smoothed[i] = sum;
}
