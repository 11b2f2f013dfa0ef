// Structures shared with src/gpu/layout.rs, which asserts sizes and offsets. Lengths along a ray are counted in half voxels behind its entry
// into the domain.

struct Params {
    // cells per axis
    cells: vec3<u32>,
    flags: u32,
    // nodes of 16^3 cells per axis
    nodes: vec3<u32>,
    // number of isovalues
    levels: u32,
    // index of the last coefficient per axis
    last: vec3<i32>,
    layers: u32,
    // coefficients are read as (c - bias_hi) - bias_lo, so that isovalues far from 0 keep their digits
    bias_hi: f32,
    bias_lo: f32,
    // pixels per row of the rectangle launched
    width: u32,
    // bricks of 4^3 cells in all, or active ones to be marked
    bricks: u32,
    // index-space direction to world direction, up to a factor
    axes: mat3x3<f32>,
    // index-space gradient to world gradient, up to a factor
    gradients: mat3x3<f32>,
}

// A ray in fixed point: entry = cell + fraction * 2^-32 (cells; shifted by half a cell where cells are centred on samples), and per half voxel
// +-(direction * 2^-32 + ten bits of `fine` * 2^-42).
struct Ray {
    cell: vec3<u32>,
    // bits 0 to 15: whole half voxels from entry to exit; 16 to 18: the axes along which it falls; 31: it misses the domain
    length: u32,
    fraction: vec3<u32>,
    // the rest of the length, below 1
    rest: f32,
    direction: vec3<u32>,
    fine: u32,
}

// 4^3 bricks: a bit for each that may meet an isovalue, and where the first of these has its cells.
struct Node {
    lo: u32,
    hi: u32,
    first: u32,
    unused: u32,
}

// A hit lies `whole + u` half voxels behind the entry.
struct Hit {
    whole: u32,
    u: f32,
    surface: u32,
    normal_x: f32,
    normal_y: f32,
    normal_z: f32,
}

// Bits of Params.flags.
const COUNT_ALL: u32 = 1u;
const COLOUR: u32 = 2u;
const NORMALS: u32 = 4u;
const MIRROR: u32 = 8u;

@group(0) @binding(1) var<uniform> params: Params;

// Coefficient of index i outside the grid: that of the clamped index, or of the index mirrored about the end (the twin of isobar_fields::Border, as
// far as a stencil reaches).
fn inside(i: i32, last: i32) -> i32 {
    if (params.flags & MIRROR) != 0u {
        let j = abs(i);
        return clamp(select(j, 2 * last - j, j > last), 0, last);
    }
    return clamp(i, 0, last);
}

fn coefficient(p: vec3<i32>) -> f32 {
    return (texel(p) - params.bias_hi) - params.bias_lo;
}
