// K13 (a): coefficients on the fly; lists hold indices of cubes.
fn owner(entry: u32) -> vec2<u32> {
    return vec2(entry, 0u);
}

fn patch_of(at: vec2<u32>, kind: u32, axes: mat3x3<f32>) -> Patch {
    return bezier(cube_of(at.x), vec3<i32>(axes[0]), vec3<i32>(axes[1]), vec3<i32>(axes[2]));
}
