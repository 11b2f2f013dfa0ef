// Coefficient p of the grid (texel p + pad), less the bias.
fn coefficient(p: vec3<i32>) -> f32 {
    return (texel(p) - params.bias_hi) - params.bias_lo;
}
