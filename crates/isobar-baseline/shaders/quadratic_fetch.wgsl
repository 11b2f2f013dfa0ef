// Quadratic B-spline by eight emulated hardware fetches: along each axis the first two coefficients in one fetch, the third in another.

// Texel `i` is coefficient `i - 1`, the first of the three.
fn value_axis(i: i32, w: f32) -> Axis {
    let v = 1.0 - w;
    let last = 0.5 * w * w;
    let pair = 1.0 - last;
    return Axis(vec2(i, i + 2), vec2((0.5 + w * v) / pair, 0.0), vec2(pair, last));
}

// s' interpolates the differences of the coefficients: one fetch between the last two less one between the first two.
fn slope_axis(i: i32, w: f32) -> Axis {
    return Axis(vec2(i, i + 1), vec2(w, w), vec2(-1.0, 1.0));
}

fn value(u: vec3<f32>) -> f32 {
    let c = min(floor(u + 0.5), params.last);
    let i = vec3<i32>(c);
    let w = (u - c) + 0.5;
    return sum(value_axis(i.x, w.x), value_axis(i.y, w.y), value_axis(i.z, w.z));
}

fn gradient(u: vec3<f32>) -> vec3<f32> {
    let c = min(floor(u + 0.5), params.last);
    let i = vec3<i32>(c);
    let w = (u - c) + 0.5;
    let x = value_axis(i.x, w.x);
    let y = value_axis(i.y, w.y);
    let z = value_axis(i.z, w.z);
    return vec3(sum(slope_axis(i.x, w.x), y, z), sum(x, slope_axis(i.y, w.y), z), sum(x, y, slope_axis(i.z, w.z)));
}
