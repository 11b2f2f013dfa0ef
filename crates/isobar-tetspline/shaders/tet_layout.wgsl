// Structures and data shared by all kernels; the twin of src/gpu/layout.rs, which asserts sizes and offsets.

struct Params {
    // samples per axis: as many cubes
    dims: vec3<u32>,
    // number of isovalues
    levels: u32,
    // index of the first cube of the chunk at hand, and how many it has
    first: u32,
    count: u32,
    // what the lists of the part at hand have room for
    room_cubes: u32,
    room_tets: u32,
    // data are read as (d - bias_hi) - bias_lo, so that isovalues far from 0 keep their digits
    bias_hi: f32,
    bias_lo: f32,
    // 1: lists of tetrahedra hold the place of their cube among the active ones, not its index
    slots: u32,
    // room for blocks of 256 active cubes
    blocks: u32,
}

// An isovalue less the bias; ascending.
struct Level {
    value: f32,
    surface: u32,
}

// Workgroups are counted in rows of this many.
const ROW: u32 = 256u;

@group(0) @binding(1) var<uniform> params: Params;

// Data outside the grid are those of the nearest sample.
fn datum(p: vec3<i32>) -> f32 {
    return (texel(clamp(p, vec3(0), vec3<i32>(params.dims) - 1)) - params.bias_hi) - params.bias_lo;
}

// The cube of index i + j n + k n^2, as the paper counts them.
fn cube_of(i: u32) -> vec3<i32> {
    let n = params.dims;
    return vec3<i32>(vec3(i % n.x, i / n.x % n.y, i / (n.x * n.y)));
}
