// Roots of a cubic in Bernstein form on [0, 1], in f32. Zero counts as positive. `wanted`: 1 for roots where it rises, -1 for falling ones, 0 for any.

const NO_ROOT: f32 = 2.0;

fn cubic_at(c: vec4<f32>, x: f32) -> f32 {
    let y = 1.0 - x;
    let p = mix(c.xyz, c.yzw, x);
    let q = p.xy * y + p.yz * x;
    return q.x * y + q.y * x;
}

// Three times the differences: the derivative in Bernstein form, over 3.
fn slopes(c: vec4<f32>) -> vec3<f32> {
    return c.yzw - c.xyz;
}

fn is_clear(c: vec4<f32>) -> bool {
    return all(c >= vec4(0.0)) || all(c < vec4(0.0));
}

fn fits(before: f32, behind: f32, wanted: i32) -> bool {
    let rises = before < 0.0 && behind >= 0.0;
    let falls = before >= 0.0 && behind < 0.0;
    return (rises && wanted >= 0) || (falls && wanted <= 0);
}

// Power coefficients x_0 to x_3.
fn monomial(c: vec4<f32>) -> vec4<f32> {
    return vec4(c.x, 3.0 * (c.y - c.x), 3.0 * ((c.z - c.y) - (c.y - c.x)), (c.w - c.x) - 3.0 * (c.z - c.y));
}
