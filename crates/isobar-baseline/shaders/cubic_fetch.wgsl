// Cubic B-spline by eight emulated hardware fetches: fast tri-cubic filtering (Sigg and Hadwiger 2005), the comparator of Steinberger
// 2010, section 6.2. Along each axis two fetches take two coefficients each; those of the derivative have weights of one sign, too.

// Texel `i` is coefficient `i - 1`, the first of the four.
fn value_axis(i: i32, w: f32) -> Axis {
    let v = 1.0 - w;
    let w1 = (4.0 - 3.0 * w * w * (1.0 + v)) / 6.0;
    let w3 = w * w * w / 6.0;
    let first = v * v * v / 6.0 + w1;
    let second = 1.0 - first;
    return Axis(vec2(i, i + 2), vec2(w1 / first, w3 / second), vec2(first, second));
}

fn slope_axis(i: i32, w: f32) -> Axis {
    let v = 1.0 - w;
    let w1 = w * (1.5 * w - 2.0);
    let w3 = 0.5 * w * w;
    // w^2 - w - 1/2, between -3/4 and -1/2: never 0
    let first = -0.5 * v * v + w1;
    return Axis(vec2(i, i + 2), vec2(w1 / first, w3 / -first), vec2(first, -first));
}

fn value(u: vec3<f32>) -> f32 {
    let c = min(floor(u), params.last - 1.0);
    let i = vec3<i32>(c);
    let w = u - c;
    return sum(value_axis(i.x, w.x), value_axis(i.y, w.y), value_axis(i.z, w.z));
}

fn gradient(u: vec3<f32>) -> vec3<f32> {
    let c = min(floor(u), params.last - 1.0);
    let i = vec3<i32>(c);
    let w = u - c;
    let x = value_axis(i.x, w.x);
    let y = value_axis(i.y, w.y);
    let z = value_axis(i.z, w.z);
    return vec3(sum(slope_axis(i.x, w.x), y, z), sum(x, slope_axis(i.y, w.y), z), sum(x, y, slope_axis(i.z, w.z)));
}
