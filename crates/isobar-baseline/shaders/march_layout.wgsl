// Structures shared with src/march_gpu/layout.rs, which asserts sizes and offsets.

struct Params {
    // samples per axis - 1: the upper corner of the domain in index space
    last: vec3<f32>,
    // distance of samples along a ray, voxels
    step: f32,
    // coefficients are read as (c - bias_hi) - bias_lo, so that isovalues far from 0 keep their digits
    bias_hi: f32,
    bias_lo: f32,
    // a hardware filter's fractions are multiples of 1 / fractions
    fractions: f32,
    bisections: u32,
    // blocks per axis, and the side of one in cells
    fine: vec3<u32>,
    fine_side: u32,
    coarse: vec3<u32>,
    coarse_side: u32,
    levels: u32,
    layers: u32,
    flags: u32,
    // texels before sample 0
    pad: u32,
    width: u32,
    unused_0: u32,
    unused_1: u32,
    unused_2: u32,
    // index-space direction to world direction, up to a factor
    axes: mat3x3<f32>,
    // index-space gradient to world gradient, up to a factor
    gradients: mat3x3<f32>,
}

struct Ray {
    // entry into the domain, index space
    origin: vec3<f32>,
    // voxels from entry to exit; below 0: the ray misses the domain
    length: f32,
    // unit length in index space
    direction: vec3<f32>,
    unused: f32,
}

// Bits of Params.flags.
const SKIP: u32 = 1u;
const COUNT_ALL: u32 = 2u;
const COLOUR: u32 = 4u;
const NORMALS: u32 = 8u;

@group(0) @binding(1) var<uniform> params: Params;
