// A trilinear fetch as texture hardware does it: the fractions are rounded to multiples of 1 / params.fractions (256 or 512), the rest is
// f32 (Steinberger 2010, section 6.2: "limited precision of the texture interpolation hardware"). Real hardware may also round products.

fn fetch(b: vec3<i32>, w: vec3<f32>) -> f32 {
    let q = floor(w * params.fractions + 0.5) / params.fractions;
    let lo = vec4(
        coefficient(b),
        coefficient(b + vec3(1, 0, 0)),
        coefficient(b + vec3(0, 1, 0)),
        coefficient(b + vec3(1, 1, 0)),
    );
    let hi = vec4(
        coefficient(b + vec3(0, 0, 1)),
        coefficient(b + vec3(1, 0, 1)),
        coefficient(b + vec3(0, 1, 1)),
        coefficient(b + vec3(1, 1, 1)),
    );
    let z = lo + q.z * (hi - lo);
    let y = z.xy + q.y * (z.zw - z.xy);
    return y.x + q.x * (y.y - y.x);
}

// Two fetch positions along an axis, texels `base + fraction`, and their weights.
struct Axis {
    base: vec2<i32>,
    fraction: vec2<f32>,
    weight: vec2<f32>,
}

// Eight fetches, as in fast tri-cubic filtering (Sigg and Hadwiger, GPU Gems 2, chapter 20, 2005).
fn sum(x: Axis, y: Axis, z: Axis) -> f32 {
    return z.weight.x * sum_plane(x, y, z.base.x, z.fraction.x) + z.weight.y * sum_plane(x, y, z.base.y, z.fraction.y);
}

fn sum_plane(x: Axis, y: Axis, k: i32, fz: f32) -> f32 {
    return y.weight.x * sum_row(x, y.base.x, y.fraction.x, k, fz) + y.weight.y * sum_row(x, y.base.y, y.fraction.y, k, fz);
}

fn sum_row(x: Axis, j: i32, fy: f32, k: i32, fz: f32) -> f32 {
    return x.weight.x * fetch(vec3(x.base.x, j, k), vec3(x.fraction.x, fy, fz))
        + x.weight.y * fetch(vec3(x.base.y, j, k), vec3(x.fraction.y, fy, fz));
}
