// K16, the closed form, as Loop and Blinn 2006 ([14] of the paper) choose it: Cardano's rule with one real root, cosines with three.

fn cube_root(x: f32) -> f32 {
    return sign(x) * pow(abs(x), 1.0 / 3.0);
}

// The lesser of two parameters in [0, 1] where the cubic goes as wanted.
fn nearer(c: vec4<f32>, best: f32, x: f32, wanted: i32) -> f32 {
    let d = slopes(c);
    let p = mix(d.xy, d.yz, x);
    let slope = mix(p.x, p.y, x);
    let right = wanted == 0 || (slope >= 0.0) == (wanted > 0);
    return select(best, x, x >= 0.0 && x <= 1.0 && x < best && right);
}

fn first_root(c: vec4<f32>, wanted: i32) -> f32 {
    if is_clear(c) {
        return NO_ROOT;
    }
    let m = monomial(c);
    var best = NO_ROOT;
    if abs(m.w) < 1e-5 * (abs(m.x) + abs(m.y) + abs(m.z)) {
        // x0 + x1 t + x2 t^2
        let disc = m.y * m.y - 4.0 * m.z * m.x;
        if disc >= 0.0 {
            let q = -0.5 * (m.y + select(-1.0, 1.0, m.y >= 0.0) * sqrt(disc));
            best = nearer(c, best, m.x / q, wanted);
            best = nearer(c, best, q / m.z, wanted);
        }
        return best;
    }
    let a = m.z / m.w;
    let b = m.y / m.w;
    let e = m.x / m.w;
    let q = (a * a - 3.0 * b) / 9.0;
    let r = (a * (2.0 * a * a - 9.0 * b) + 27.0 * e) / 54.0;
    let third = a / 3.0;
    let rest = q * q * q - r * r;
    if rest > 0.0 {
        let angle = acos(clamp(r / sqrt(q * q * q), -1.0, 1.0)) / 3.0;
        let size = -2.0 * sqrt(q);
        best = nearer(c, best, size * cos(angle) - third, wanted);
        best = nearer(c, best, size * cos(angle + 2.0943951) - third, wanted);
        best = nearer(c, best, size * cos(angle - 2.0943951) - third, wanted);
        return best;
    }
    let s = -sign(r) * cube_root(abs(r) + sqrt(-rest));
    return nearer(c, best, s + select(0.0, q / s, s != 0.0) - third, wanted);
}
