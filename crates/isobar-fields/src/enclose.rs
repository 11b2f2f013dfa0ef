//! A rigorous enclosure of one spline piece over a part of its cell.
//!
//! The Bernstein coefficients of a piece on `[a, b]`, a part of the cell's [0, 1], are its polar form (blossom) at `a` and `b`. For a
//! uniform B-spline the de Boor steps with arguments inside the cell are convex combinations, so every Bernstein coefficient is a
//! combination of the stencil's coefficients with non-negative weights that sum to one, and s on the box lies in their hull.
//!
//! Rounding, u = 2^-53, c the greatest |coefficient - reference|: an argument carries u/2 absolute (cells centred on samples) or none; a de
//! Boor factor 2u relative more, a weight 12u, three axes 36u, three dot products of at most four terms 12u; the argument's error
//! moves the value by at most 6uc; subtracting the reference costs uc. Together less than 64uc. The reference is added back outward.

use isobar_core::Interval;

/// Weights of the Bernstein coefficients of `[a, b]`: `[r][j]` is the factor of stencil coefficient j in Bernstein coefficient r.
fn bernstein_weights(degree: usize, a: f64, b: f64) -> [[f64; 4]; 4] {
    let mut out = [[0.0; 4]; 4];
    for (r, weights) in out.iter_mut().enumerate().take(degree + 1) {
        // The polar form at (degree - r) times a and r times b, as weights: run de Boor on the unit vectors from the top down.
        weights[0] = 1.0;
        for level in (1..=degree).rev() {
            // From one value of level `level` to the ones below it: value j is (1 - f_j) v_j + f_j v_{j+1}.
            let x = if level > r { a } else { b };
            let width = (degree - level + 1) as f64;
            let mut below = [0.0; 4];
            for j in 0..=degree - level {
                let f = (x + (degree - level - j) as f64) / width;
                let g = ((1.0 - x) + j as f64) / width;
                below[j] += weights[j] * g;
                below[j + 1] += weights[j] * f;
            }
            *weights = below;
        }
    }
    out
}

/// An interval that contains s over the part `[lo, hi]` (in [0, 1]^3) of a cell with this stencil (x fastest, `(degree + 1)^3`).
pub(crate) fn piece(degree: usize, stencil: &[f64; 64], lo: [f64; 3], hi: [f64; 3]) -> Interval {
    let w = degree + 1;
    let count = w * w * w;
    let c = &stencil[..count];
    let (least, greatest) = c.iter().fold((c[0], c[0]), |(a, b), &v| (a.min(v), b.max(v)));
    let hull = Interval::new(least, greatest);
    let reference = 0.5 * least + 0.5 * greatest;
    let size = (greatest - reference).max(reference - least);
    if size == 0.0 || !size.is_finite() {
        return hull;
    }
    let mut from = [0.0; 64];
    for (f, &v) in from.iter_mut().zip(c) {
        *f = v - reference;
    }
    for axis in 0..3 {
        let weights = bernstein_weights(degree, lo[axis], hi[axis]);
        let stride = w.pow(axis as u32);
        let mut to = [0.0; 64];
        for (n, t) in to[..count].iter_mut().enumerate() {
            let r = n / stride % w;
            let base = n - r * stride;
            *t = (0..w).map(|j| weights[r][j] * from[base + j * stride]).sum();
        }
        from = to;
    }
    let (least, greatest) = from[..count]
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), &v| (a.min(v), b.max(v)));
    let pad = size * (64.0 * 0.5 * f64::EPSILON);
    let tight = Interval::new(least - pad, greatest + pad) + Interval::point(reference);
    tight.intersect(hull).unwrap_or(hull)
}
