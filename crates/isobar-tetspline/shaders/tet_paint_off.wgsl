fn paint_of(in: Varying, phi: vec4<f32>, axes: mat3x3<f32>, normal: vec3<f32>) -> u32 {
    return 0u;
}
