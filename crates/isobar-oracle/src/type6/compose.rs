//! Stages 1 and 2: the stretches of a ray in the tetrahedra of one cube, and `s - c` on each in Bernstein form.
//!
//! **Cutting.** The six planes `x_a = +-x_b` through the cube's centre cut it into its 24 tetrahedra. Each form `x_a +- x_b` is linear in s, known in double-double with
//! the errors of [`crate::map::Axis::at`] at both ends of the stay. With certain, equal signs it has no zero inside; with certain, opposite signs one, at
//! `s0 + h g0/(g0 - g1)`: numerator and denominator round to f64 (3u, no cancellation), product, quotient, h and the sum follow (5u), and the errors e0, e1 of the form
//! move it by at most `h (e0 + e1)/|g0 - g1|`. Taken: `h (16u + 2 (e0 + e1)/|g0 - g1|) + 4u |s|`. Anything doubtful, or crossings nearer to each other than
//! their errors, is left to integers. Between two crossings the signs of the six forms name the tetrahedron.
//!
//! **Bound of the coefficients.** With barycentric phi_v at the two ends, `s - c` is `sum (b_ijkl - c) multinomial prod phi_v^(exponent)`; products of the linear forms
//! are taken as convolutions. U is the unit of rounding, e the greatest error of a coordinate. Sums over the four phi: of their errors 10 e (the rows of the
//! integer forms have 10 units in all) and 4 U of rounding, for coordinates rounded to R 5 U more; three factors: 30 e + 27 U. Powers and products at most 12 U, multinomial, coefficient
//! and the sum of 20 terms 22 U, division by the binomial 2 U. A coefficient: difference 1 U, 27 products and sums 28 U, division 2 U. With `sum |phi| <= 1 + 2^-7` and all b - c at
//! most M: less than `(128 U + 32 e) M`, which leaves a fifth for second-order terms.

use crate::{
    compose::{Bernstein, MOST},
    map::RayMap,
    real::{Dd, Real, U64},
    walk::Visit,
};
use isobar_core::TetMasks;

/// The part of a cube's stay inside one tetrahedron.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Part {
    /// Enclosures as of a [`Visit`].
    pub(crate) outer: (f64, f64),
    pub(crate) inner: (f64, f64),
    pub(crate) kind: usize,
}

/// The forms `x_a + sign x_b`.
const FORMS: [(usize, usize, i32); 6] = [(0, 1, 1), (0, 1, -1), (0, 2, 1), (0, 2, -1), (1, 2, 1), (1, 2, -1)];

/// Which forms are positive inside each kind, bit n for form n; their values at the sum of the vertices tell.
pub(crate) fn signatures(masks: &TetMasks) -> [u8; 24] {
    masks.vertices.map(|v| {
        let sum: [i32; 3] = std::array::from_fn(|a| v.iter().map(|p| i32::from(p[a])).sum());
        FORMS
            .iter()
            .enumerate()
            .map(|(n, &(a, b, sign))| u8::from(sum[a] + sign * sum[b] > 0) << n)
            .sum()
    })
}

/// The parts front to back, `None` where f64 cannot tell.
pub(crate) fn cut(map: &RayMap, v: &Visit, signatures: &[u8; 24]) -> Option<Vec<Part>> {
    let (s0, s1) = v.outer;
    let ends = [s0, s1].map(|s| std::array::from_fn::<_, 3, _>(|a| centred(map, v.index, a, s)));
    let mut signs = 0u8;
    let mut crossings: Vec<(f64, f64, usize)> = Vec::with_capacity(6);
    let h = s1 - s0;
    for (n, &(a, b, sign)) in FORMS.iter().enumerate() {
        let at = |end: &[(Dd, f64); 3]| {
            let (x, y) = (end[a], end[b]);
            let g = if sign > 0 { x.0 + y.0 } else { x.0 - y.0 };
            // The sum rounds by 3u^2 of at most 1.
            (g.hi, x.1 + y.1 + 4e-32)
        };
        let ((g0, e0), (g1, e1)) = (at(&ends[0]), at(&ends[1]));
        if g0.abs() * (1.0 - 1e-15) <= e0 || g1.abs() * (1.0 - 1e-15) <= e1 {
            return None;
        }
        signs |= u8::from(g0 > 0.0) << n;
        if (g0 > 0.0) != (g1 > 0.0) {
            let drop = g0 - g1;
            let s = s0 + h * (g0 / drop);
            let e = h * (16.0 * U64 + 2.0 * (e0 + e1) / drop.abs()) + 4.0 * U64 * s.abs();
            crossings.push((s, e, n));
        }
    }
    crossings.sort_by(|x, y| x.0.total_cmp(&y.0));
    let mut parts = Vec::with_capacity(crossings.len() + 1);
    let (mut outer, mut inner) = (s0, v.inner.0);
    for i in 0..=crossings.len() {
        let (outer_end, inner_end) = crossings.get(i).map_or((s1, v.inner.1), |&(s, e, _)| (s + e, s - e));
        if inner >= inner_end {
            return None;
        }
        let kind = signatures.iter().position(|&k| k == signs)?;
        parts.push(Part {
            outer: (outer, outer_end),
            inner: (inner, inner_end),
            kind,
        });
        if let Some(&(s, e, n)) = crossings.get(i) {
            signs ^= 1 << n;
            (outer, inner) = (s - e, s + e);
        }
    }
    Some(parts)
}

/// Local coordinate a at s, from the centre of the cube, and a bound of its error.
fn centred(map: &RayMap, cube: [usize; 3], a: usize, s: f64) -> (Dd, f64) {
    let (w, e) = map.axes[a].at(s, cube[a] as f64);
    // One sum more: 2u^2 of at most 1.
    (w.plus(-0.5), e + 3e-32)
}

/// `s - c` on a part; `None` where the stretch leaves the tetrahedron too far for the bound, or over- or underflow could touch it. `most`: the
/// greatest |datum - c|, rounded up.
pub(crate) fn compose<R: Real>(
    map: &RayMap,
    cube: [usize; 3],
    part: &Part,
    masks: &TetMasks,
    data: &[f64; 27],
    c: f64,
    most: f64,
) -> Option<Bernstein<R>> {
    const OUTSIDE: f64 = 1.0 / 1024.0;
    if !(most == 0.0 || (1e-270..1e270).contains(&most)) {
        return None;
    }
    // Linear forms [at s0, at s1] of the four barycentric coordinates.
    let mut phi = [[R::ZERO; 2]; 4];
    let mut e = 0.0f64;
    for (i, s) in [part.outer.0, part.outer.1].into_iter().enumerate() {
        let x: [(Dd, f64); 3] = std::array::from_fn(|a| centred(map, cube, a, s));
        e = x.iter().fold(e, |e, x| e.max(x.1));
        for (f, row) in phi.iter_mut().zip(&masks.barycentric[part.kind]) {
            let mut v = R::from_f64(row[0].into());
            for a in 0..3 {
                if row[1 + a] != 0 {
                    v = v + R::from_f64(row[1 + a].into()) * R::from_dd(x[a].0);
                }
            }
            if v.f64() < -OUTSIDE {
                return None;
            }
            f[i] = v;
        }
    }
    let differences: [R; 27] = std::array::from_fn(|n| R::difference(data[n], c));
    let part_of = {
        // 1/denominator to about one unit of R.
        let d = R::from_f64(masks.denominator.into());
        let r = R::from_f64(1.0 / f64::from(masks.denominator));
        r + r * (R::from_f64(1.0) - d * r)
    };
    let mut out = Bernstein {
        n: 3,
        b: [R::ZERO; MOST + 1],
        error: (128.0 * R::UNIT + 32.0 * e) * most,
    };
    for (index, weights) in masks.indices.iter().zip(&masks.weights[part.kind]) {
        let mut b = R::ZERO;
        for (&w, &d) in weights.iter().zip(&differences) {
            if w > 0 {
                b = b + R::from_f64(w.into()) * d;
            }
        }
        let mut form = [R::ZERO; 4];
        form[0] = b * part_of * R::from_f64(multinomial(*index));
        let mut degree = 0;
        for (f, &power) in phi.iter().zip(index) {
            for _ in 0..power {
                for m in (0..=degree + 1).rev() {
                    let left = if m <= degree { form[m] * f[0] } else { R::ZERO };
                    form[m] = if m > 0 { left + form[m - 1] * f[1] } else { left };
                }
                degree += 1;
            }
        }
        for (o, x) in out.b.iter_mut().zip(form) {
            *o = *o + x;
        }
    }
    let third = {
        let r = R::from_f64(1.0 / 3.0);
        r + r * (R::from_f64(1.0) - R::from_f64(3.0) * r)
    };
    out.b[1] = out.b[1] * third;
    out.b[2] = out.b[2] * third;
    Some(out)
}

/// `3!/(i! j! k! l!)`.
pub(crate) fn multinomial(index: [u8; 4]) -> f64 {
    index.iter().fold(6.0, |m, &i| m / [1.0, 1.0, 2.0, 6.0][usize::from(i)])
}
