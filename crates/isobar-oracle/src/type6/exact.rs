//! Stage 3: the stay of a ray in the tetrahedra of a cube, and `s - c` on each, in integers.
//!
//! With `w = e/f` the position in the cube at an end of a span ([`ExactRay::ends`]), twice the coordinate from the centre is `(2e - f)/f`; over the common
//! denominator F of the three axes and of both ends everything is an integer. A part ends where one of the six forms `x_a +- x_b` changes sign; parts are half open like cells.
//! A ray inside a plane of the partition belongs to any adjacent tetrahedron: the pieces agree there.

use super::compose::multinomial;
use crate::exact::{Dyadic, ExactRay, Piece, Ratio, Span, convolve, sign};
use dashu_int::IBig;
use isobar_core::TetMasks;

/// A stretch of the ray in one tetrahedron.
#[derive(Clone, Debug)]
pub(crate) struct ExactPart {
    pub(crate) span: Span,
    pub(crate) kind: usize,
}

/// Twice the coordinates from the centre of a cube at both ends of `[t0, t1]`, times F, and F.
struct Line {
    at: [[IBig; 3]; 2],
    f: IBig,
}

impl Line {
    fn new(ray: &ExactRay, cube: [usize; 3], t0: &Ratio, t1: &Ratio) -> Self {
        let ends: [(IBig, IBig, IBig); 3] = std::array::from_fn(|a| ray.ends(a, cube[a] as i64, t0, t1));
        let f = &ends[0].2 * &ends[1].2 * &ends[2].2;
        let at = |second: bool| {
            std::array::from_fn(|a| {
                let (e0, e1, own) = &ends[a];
                let e = if second { e1 } else { e0 };
                (e * IBig::from(2) - own) * (&f / own)
            })
        };
        Self {
            at: [at(false), at(true)],
            f,
        }
    }

    /// A kind whose closed tetrahedron contains the point at `(1 - n/d) start + n/d end`; where rounding does not exist there always is one for points of the cube.
    fn kind(&self, masks: &TetMasks, n: &IBig, d: &IBig) -> usize {
        let x: [IBig; 3] = std::array::from_fn(|a| &self.at[0][a] * (d - n) + &self.at[1][a] * n);
        let whole = &self.f * d * IBig::from(2);
        let inside = |kind: &[[i8; 4]; 4]| {
            kind.iter().all(|row| {
                let v = (0..3).fold(&whole * IBig::from(row[0]), |v, a| v + IBig::from(row[1 + a]) * &x[a]);
                sign(&v) >= 0
            })
        };
        masks.barycentric.iter().position(inside).unwrap_or(0)
    }
}

/// The parts of a cube's stay, front to back; a single point is one part.
pub(crate) fn parts(ray: &ExactRay, cube: [usize; 3], span: Span, masks: &TetMasks) -> Vec<ExactPart> {
    let line = Line::new(ray, cube, &span.t0, &span.t1);
    if span.t0.compare(&span.t1).is_eq() {
        let kind = line.kind(masks, &IBig::ZERO, &IBig::ONE);
        return vec![ExactPart { span, kind }];
    }
    // tau of the crossings, strictly inside.
    let mut cuts: Vec<Ratio> = Vec::new();
    for a in 0..3 {
        for b in a + 1..3 {
            for plus in [true, false] {
                let g = |x: &[IBig; 3]| if plus { &x[a] + &x[b] } else { &x[a] - &x[b] };
                let (g0, g1) = (g(&line.at[0]), g(&line.at[1]));
                if sign(&g0) * sign(&g1) < 0 {
                    cuts.push(Ratio::new(g0.clone(), g0 - g1));
                }
            }
        }
    }
    cuts.push(Ratio::new(IBig::ZERO, IBig::ONE));
    cuts.push(Ratio::new(IBig::ONE, IBig::ONE));
    cuts.sort_by(Ratio::compare);
    cuts.dedup_by(|x, y| x.compare(y).is_eq());
    // t0 + tau (t1 - t0)
    let t = |tau: &Ratio| {
        let (a, b) = (&span.t0.n * &span.t1.d, &span.t1.n * &span.t0.d);
        Ratio::new(&a * (&tau.d - &tau.n) + b * &tau.n, &span.t0.d * &span.t1.d * &tau.d)
    };
    cuts.windows(2)
        .map(|w| {
            let middle = Ratio::new(&w[0].n * &w[1].d + &w[1].n * &w[0].d, &w[0].d * &w[1].d * IBig::from(2));
            ExactPart {
                span: Span {
                    t0: t(&w[0]),
                    t1: t(&w[1]),
                    closed: span.closed && w[1].n == w[1].d,
                },
                kind: line.kind(masks, &middle.n, &middle.d),
            }
        })
        .collect()
}

/// `s - c` of a kind on a span, up to a positive factor.
pub(crate) fn piece(ray: &ExactRay, cube: [usize; 3], part: ExactPart, masks: &TetMasks, data: &[f64; 27], c: f64) -> Piece {
    let ExactPart { span, kind } = part;
    let line = Line::new(ray, cube, &span.t0, &span.t1);
    let mut all: Vec<Dyadic> = data.iter().map(|&v| Dyadic::from_f64(v)).collect();
    all.push(Dyadic::from_f64(c));
    let mut differences = Dyadic::integers(&all);
    let c = differences.pop().unwrap_or(IBig::ZERO);
    for d in &mut differences {
        *d -= &c;
    }
    // Twice phi_v times F at both ends.
    let whole = &line.f * IBig::from(2);
    let phi = masks.barycentric[kind].map(|row| {
        [0, 1].map(|i| {
            (0..3).fold(&whole * IBig::from(row[0]), |v, a| {
                v + IBig::from(row[1 + a]) * &line.at[i][a]
            })
        })
    });
    let mut b = vec![IBig::ZERO; 4];
    for (index, weights) in masks.indices.iter().zip(&masks.weights[kind]) {
        let mut coefficient = IBig::ZERO;
        for (&w, d) in weights.iter().zip(&differences).filter(|(w, _)| **w > 0) {
            coefficient += IBig::from(w) * d;
        }
        if coefficient.is_zero() {
            continue;
        }
        let mut form = vec![coefficient * IBig::from(multinomial(*index) as i64)];
        for (f, &power) in phi.iter().zip(index) {
            for _ in 0..power {
                form = convolve(&form, f);
            }
        }
        for (o, x) in b.iter_mut().zip(form) {
            *o += x;
        }
    }
    // The phi of the form sum to 2F (X + Y), the weights to the denominator.
    let most = differences
        .iter()
        .map(|v| if sign(v) < 0 { -v } else { v.clone() })
        .max()
        .unwrap_or(IBig::ZERO);
    let most = most * IBig::from(masks.denominator) * &whole * &whole * &whole;
    let zero = b.iter().all(IBig::is_zero);
    Piece {
        b: if zero { vec![IBig::ZERO] } else { b },
        t0: span.t0,
        t1: span.t1,
        closed: span.closed,
        most,
    }
}
