//! A rigorous enclosure of the type-6 spline over a box of index space.
//!
//! Large boxes: the hull of the data. Small ones: per cube, the hull of the Bernstein-Bezier coefficients of the tetrahedra the box touches, and the mean
//! value form `s(m) + sum_a G_a [-r_a, r_a]` about the middle m of the part of the box in the cube, G_a the hull of the coefficients of the
//! derivatives there; s is C1 and the box is convex, so the segment from m to any point stays among the tetrahedra touched. Its excess falls with the square of the box.
//!
//! Rounding, u = 2^-53, M the greatest |datum - reference|: a coefficient 14uM, a value 21uM more and 30uM for a rounded position; a derivative's
//! coefficient is at most 12 (14u M) off, times r <= 1/2 and three axes; the reference costs uM. 256uM covers all of it.

use crate::type6::{Type6Spline, barycentric, canonical, coefficients, from_canonical, kind_of, last_step, reorder, two_steps};
use glam::DVec3;
use isobar_core::{Interval, Tetrahedral};

/// Boxes that touch at most this many cubes are enclosed piece by piece.
const PIECES: usize = 27;

/// For `lo`, `hi` inside the domain.
pub(crate) fn enclosure(s: &Type6Spline, lo: DVec3, hi: DVec3) -> Interval {
    let dims = s.dims();
    // Round to even or away: a face belongs to both cubes, so one of them more never hurts.
    let first: [usize; 3] = std::array::from_fn(|a| ((lo[a] - 0.5).ceil().max(0.0) as usize).min(dims[a] - 1));
    let last: [usize; 3] = std::array::from_fn(|a| ((hi[a] + 0.5).floor() as usize).clamp(first[a], dims[a] - 1));
    let count: usize = (0..3).map(|a| last[a] - first[a] + 1).product();
    if count > PIECES {
        return s.range(first, last);
    }
    let mut all: Option<Interval> = None;
    for k in first[2]..=last[2] {
        for j in first[1]..=last[1] {
            for i in first[0]..=last[0] {
                let cube = [i, j, k];
                let part = |u: DVec3| -> [f64; 3] { std::array::from_fn(|a| (u[a] - cube[a] as f64).clamp(-0.5, 0.5)) };
                let e = piece(s, cube, part(lo), part(hi));
                all = Some(all.map_or(e, |x| x.union(e)));
            }
        }
    }
    all.unwrap_or(Interval::ALL)
}

/// Over the part `[lo, hi]` of a cube, in grid steps from its centre.
fn piece(s: &Type6Spline, cube: [usize; 3], lo: [f64; 3], hi: [f64; 3]) -> Interval {
    let mut data = [0.0; 27];
    s.data(cube, &mut data);
    let (least, greatest) = data.iter().fold((data[0], data[0]), |(a, b), &v| (a.min(v), b.max(v)));
    let whole = Interval::new(least, greatest);
    let reference = 0.5 * least + 0.5 * greatest;
    let size = (greatest - reference).max(reference - least);
    if size == 0.0 || !size.is_finite() {
        return whole;
    }
    for d in &mut data {
        *d -= reference;
    }
    let middle: [f64; 3] = std::array::from_fn(|a| 0.5 * (lo[a] + hi[a]));
    let reach: [f64; 3] = std::array::from_fn(|a| (hi[a] - middle[a]).max(middle[a] - lo[a]));
    let (mut hull, mut slopes) = ((f64::INFINITY, f64::NEG_INFINITY), [0.0f64; 3]);
    for kind in 0..24 {
        if !touches(kind, lo, hi) {
            continue;
        }
        let b = coefficients(&reorder(kind, &data));
        for &v in &b {
            hull = (hull.0.min(v), hull.1.max(v));
        }
        // The greatest |derivative| along each axis: grad phi_v are the rows of the barycentric forms.
        for q in QUADRATIC {
            let g = [
                6.0 * (b[q[1]] - b[q[0]]),
                3.0 * (b[q[2]] + b[q[3]] - 2.0 * b[q[1]]),
                3.0 * (b[q[2]] - b[q[3]]),
            ];
            let g = from_canonical(kind, g);
            for a in 0..3 {
                slopes[a] = slopes[a].max(g[a].abs());
            }
        }
    }
    let kind = kind_of(middle);
    let phi = barycentric(canonical(kind, middle));
    let value = last_step(two_steps(&coefficients(&reorder(kind, &data)), phi), phi);
    let away: f64 = (0..3).map(|a| slopes[a] * reach[a]).sum();
    let pad = size * (256.0 * 0.5 * f64::EPSILON);
    let (lo, hi) = (hull.0.max(value - away) - pad, hull.1.min(value + away) + pad);
    let tight = Interval::new(lo.min(hi), hi.max(lo)) + Interval::point(reference);
    tight.intersect(whole).unwrap_or(whole)
}

/// For each coefficient of the quadratics, the four cubic ones its first step of de Casteljau's rule mixes.
const QUADRATIC: [[usize; 4]; 10] = [
    [0, 1, 2, 3],
    [1, 4, 5, 6],
    [2, 5, 7, 8],
    [3, 6, 8, 9],
    [4, 10, 11, 12],
    [5, 11, 13, 14],
    [6, 12, 14, 15],
    [7, 13, 16, 17],
    [8, 14, 17, 18],
    [9, 15, 18, 19],
];

/// Whether the box may meet the tetrahedron: no barycentric coordinate is negative on all of it (beyond rounding).
fn touches(kind: usize, lo: [f64; 3], hi: [f64; 3]) -> bool {
    crate::type6::TYPE6.barycentric[kind].iter().all(|row| {
        let most: f64 = f64::from(row[0])
            + (0..3)
                .map(|a| {
                    let k = f64::from(row[1 + a]);
                    (k * lo[a]).max(k * hi[a])
                })
                .sum::<f64>();
        most >= -1e-12
    })
}
