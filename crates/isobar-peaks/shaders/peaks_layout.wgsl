// Structures shared with src/gpu/layout.rs, which asserts sizes and offsets. Lengths along a ray are voxels behind its entry.

struct Params {
    // index of the last sample per axis: the upper corner of the domain
    last: vec3<f32>,
    // of the index where cell 0 begins, less that of sample 0: cells are centred on samples where it is 1/2
    shift: f32,
    // macrocells and nodes of 4^3 macrocells per axis
    macrocells: vec3<i32>,
    flags: u32,
    nodes: vec3<i32>,
    // what follows one sample after another
    law: u32,
    // the field is read less the bias
    bias_hi: f32,
    bias_lo: f32,
    // the least value, less the bias
    least: f32,
    // pixels per row of the rectangle launched
    width: u32,
    // bins per unit of the value, and per axis, of the peak table
    peak_bins_per_value: f32,
    peak_bins: u32,
    // of the transfer function's table, or the pre-integration table
    medium_per_value: f32,
    medium_bins: u32,
    integration: u32,
    mode: u32,
    // steps of the secant method
    iterations: u32,
    layers: u32,
    values: u32,
    // of loops that a ray may take in one pass, and the number of the pass
    turns: u32,
    pass_number: u32,
    // 0, which no compiler knows
    nothing: u32,
    // index-space direction to world direction, up to a factor
    axes: mat3x3<f32>,
    // index-space gradient to world gradient, up to a factor
    gradients: mat3x3<f32>,
}

// Sample k lies at first + k (step + growth k / 2), or for geometric steps at first + step (exp(growth k) - 1).
struct Ray {
    // entry, index space
    origin: vec3<f32>,
    // voxels from entry to exit; below 0: the ray misses the domain
    length: f32,
    // unit length in index space
    direction: vec3<f32>,
    first: f32,
    step: f32,
    growth: f32,
    // world length of a voxel along the ray
    unit: f32,
    // What a pass that ran out of turns leaves to the next: whether it did, the last sample taken (-FAR where there is none) and its number, what is seen through, and in which block
    // and at which parameter to go on.
    state: u32,
    end: f32,
    next: f32,
    clear: f32,
    resume: f32,
    block: vec3<i32>,
    unused: f32,
}

// Ray.state: the ray is done; it paused before a node, before a macrocell, or inside one.
const DONE: u32 = 0u;
const AT_NODE: u32 = 1u;
const AT_MACROCELL: u32 = 2u;
const INSIDE: u32 = 3u;

// Bits of Params.flags.
const COUNT_ALL: u32 = 1u;
const COLOUR: u32 = 2u;
const NORMALS: u32 = 4u;
const MACROCELLS: u32 = 8u;
const MULTIPLIERS: u32 = 16u;
const SHADED: u32 = 32u;

// Params.law; 0: T(n) in closed form, which uniform steps are too.
const PRINTED: u32 = 1u;
const GEOMETRIC: u32 = 2u;

// Params.integration; 0: there is no medium.
const POST: u32 = 1u;
const ENGEL: u32 = 2u;
const LUM: u32 = 3u;

// Params.mode; 0: peaks and medium.
const EITHER: u32 = 1u;
const PEAKS: u32 = 2u;
const MEDIUM: u32 = 3u;

@group(0) @binding(1) var<uniform> params: Params;
