// K13 (b): coefficients from stored determining sets; lists hold places among the active cubes.

@group(0) @binding(6) var<storage, read> cubes: array<u32>;
@group(0) @binding(7) var<storage, read> sets: array<f32>;
@group(0) @binding(8) var<storage, read> set_table: array<u32>;

fn owner(entry: u32) -> vec2<u32> {
    return vec2(cubes[entry], entry);
}

fn patch_of(at: vec2<u32>, kind: u32, axes: mat3x3<f32>) -> Patch {
    return bezier(at.y, kind);
}
