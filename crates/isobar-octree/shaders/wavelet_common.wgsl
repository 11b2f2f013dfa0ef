// A level of spline coefficients in chunks of 8^3, x fastest in a chunk and over the chunks.

struct Params {
    // Values per axis; chunks of this pass.
    dims: vec4<i32>,
    // Chunks per axis.
    chunks: vec4<i32>,
    // Chunks per axis of the coarser level.
    coarse: vec4<i32>,
}

// Workgroups per row of a dispatch.
const PER_ROW: u32 = 32768u;

@group(0) @binding(0) var<uniform> params: Params;
// Chunks of this pass.
@group(0) @binding(1) var<storage, read> list: array<u32>;
@group(0) @binding(2) var<storage, read> source: array<f32>;
@group(0) @binding(3) var<storage, read_write> result: array<f32>;

fn stored(v: vec3<i32>, chunks: vec3<i32>) -> u32 {
    let c = vec3(v.x >> 3u, v.y >> 3u, v.z >> 3u);
    let chunk = (c.z * chunks.y + c.y) * chunks.x + c.x;
    return u32(((chunk * 8 + (v.z & 7)) * 8 + (v.y & 7)) * 8 + (v.x & 7));
}

fn at(v: vec3<i32>) -> u32 {
    return stored(v, params.chunks.xyz);
}

// The first value of a chunk.
fn first_of(chunk: u32) -> vec3<i32> {
    let i = i32(chunk);
    let n = params.chunks;
    return 8 * vec3(i % n.x, i / n.x % n.y, i / (n.x * n.y));
}
