// The first root: parts between the extrema, and in the first one that changes sign Newton's method inside a bracket.

fn bracketed(c: vec4<f32>, from_x: f32, to_x: f32) -> f32 {
    var lo = from_x;
    var hi = to_x;
    let before = cubic_at(c, lo);
    let behind = cubic_at(c, hi);
    let negative = before < 0.0;
    let d = slopes(c);
    // The secant is a good start where the part is nearly straight.
    var x = clamp(lo + (hi - lo) * (before / (before - behind)), lo, hi);
    for (var i = 0; i < 20; i++) {
        let v = cubic_at(c, x);
        if (v < 0.0) == negative {
            lo = x;
        } else {
            hi = x;
        }
        let p = mix(d.xy, d.yz, x);
        let move_by = v / (3.0 * mix(p.x, p.y, x));
        let next = x - move_by;
        if abs(move_by) < 2e-7 {
            // What is left is rounding, which may point out of the bracket.
            return clamp(next, from_x, to_x);
        }
        x = select(0.5 * (lo + hi), next, next > lo && next < hi);
    }
    return x;
}

fn first_root(c: vec4<f32>, wanted: i32) -> f32 {
    if is_clear(c) {
        return NO_ROOT;
    }
    let d = slopes(c);
    var first = 1.0;
    var second = 1.0;
    if !(all(d >= vec3(0.0)) || all(d <= vec3(0.0))) {
        // d0 (1-x)^2 + 2 d1 x (1-x) + d2 x^2
        let a = (d.z - d.y) - (d.y - d.x);
        let b = d.y - d.x;
        let disc = b * b - a * d.x;
        if disc > 0.0 {
            let q = -(b + select(-1.0, 1.0, b >= 0.0) * sqrt(disc));
            let r = q / a;
            let s = d.x / q;
            let x = select(1.0, r, r > 0.0 && r < 1.0);
            let y = select(1.0, s, s > 0.0 && s < 1.0);
            first = min(x, y);
            second = max(x, y);
        }
    }
    let v0 = c.x;
    let v1 = cubic_at(c, first);
    if fits(v0, v1, wanted) {
        return bracketed(c, 0.0, first);
    }
    let v2 = cubic_at(c, second);
    if first < 1.0 && fits(v1, v2, wanted) {
        return bracketed(c, first, second);
    }
    if second < 1.0 && fits(v2, c.w, wanted) {
        return bracketed(c, second, 1.0);
    }
    return NO_ROOT;
}
