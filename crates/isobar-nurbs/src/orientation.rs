//! Which way an element's parameters turn, and whether it folds: the sign of the Jacobian determinant (bad input; hardcases D3 to D5).
//!
//! With x, y, z, w the homogeneous coordinates, `w^4 det J = w [x y z] - x [w y z] - y [x w z] - z [x y w]`, brackets being determinants of gradients: a polynomial, whose Bernstein coefficients bound its sign and
//! whose corner coefficients are values. Nothing here is needed to draw an element: all of this crate's methods draw each sheet of a folded one. `isobar info` tells the counts.

use crate::affine::exact_box;
use crate::bernstein::{count, halve, range};
use crate::paper_forms::{Poly, Smooth, Sum, determinant};
use isobar_core::{HexElement, HexPatches};
use rayon::prelude::*;

/// Coefficients below this part of the greatest one count as zero: some hundred roundings of the products.
const ZERO: f64 = 1e-12;
/// Pieces looked at, at most.
const MOST_PIECES: usize = 4096;
/// Halvings of each axis, at most.
const DEEPEST: u32 = 8;

/// The sign of an element's Jacobian determinant.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Orientation {
    /// Positive everywhere.
    Right,
    /// Negative everywhere.
    Left,
    /// Of one sign where it could be told, but zero to within rounding (or 2^-8 of the element) somewhere.
    Vanishing,
    /// Positive at one point and negative at another: some points of space are those of several parameters, and the surface there has several sheets.
    Folded,
}

/// The orientation of an element. Proved up to rounding (a part in 10^12 of the greatest coefficient of the determinant): signs of Bernstein coefficients on at most 4,096 parts, values at their corners.
#[must_use]
pub fn orientation(e: &HexElement) -> Orientation {
    if let Some((lo, hi)) = exact_box(e) {
        // Signs, not their product, which may underflow.
        let turns = (hi - lo).to_array().iter().filter(|x| **x < 0.0).count();
        return if turns % 2 == 0 {
            Orientation::Right
        } else {
            Orientation::Left
        };
    }
    let d = determinant_of(e);
    let degree = d.counts.map(|c| c - 1);
    let most = d.values.iter().fold(0.0f64, |m, v| m.max(v.abs()));
    let zero = ZERO * most;
    let (mut positive, mut negative, mut open) = (false, false, false);
    let mut pieces = vec![(d.values, 0u32)];
    let mut looked = 0;
    while let Some((c, depth)) = pieces.pop() {
        let (lo, hi) = range(&c);
        let corners = (0..8).map(|n| {
            let at = |a: usize| if n >> a & 1 == 0 { 0 } else { degree[a] };
            c[(at(2) * (degree[1] + 1) + at(1)) * (degree[0] + 1) + at(0)]
        });
        for v in corners {
            (positive, negative) = (positive || v > zero, negative || v < -zero);
        }
        if positive && negative {
            return Orientation::Folded;
        }
        looked += 1;
        if lo > zero || hi < -zero {
            continue;
        }
        if depth == 3 * DEEPEST || looked >= MOST_PIECES {
            open = true;
            continue;
        }
        let mut upper = c;
        let mut lower = vec![0.0; count(degree)];
        halve(degree, (depth % 3) as usize, &mut upper, &mut lower);
        pieces.extend([(upper, depth + 1), (lower, depth + 1)]);
    }
    match (open, positive) {
        (true, _) => Orientation::Vanishing,
        (false, true) => Orientation::Right,
        (false, false) => Orientation::Left,
    }
}

/// How many elements of a mesh have each orientation.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Orientations {
    /// [`Orientation::Right`].
    pub right: usize,
    /// [`Orientation::Left`].
    pub left: usize,
    /// [`Orientation::Vanishing`].
    pub vanishing: usize,
    /// [`Orientation::Folded`].
    pub folded: usize,
}

impl Orientations {
    /// Of all elements, on all threads.
    #[must_use]
    pub fn of(patches: &HexPatches) -> Self {
        let one = |e: &HexElement| {
            let mut n = Self::default();
            match orientation(e) {
                Orientation::Right => n.right = 1,
                Orientation::Left => n.left = 1,
                Orientation::Vanishing => n.vanishing = 1,
                Orientation::Folded => n.folded = 1,
            }
            n
        };
        let sum = |a: Self, b: Self| Self {
            right: a.right + b.right,
            left: a.left + b.left,
            vanishing: a.vanishing + b.vanishing,
            folded: a.folded + b.folded,
        };
        patches.elements.par_iter().map(one).reduce(Self::default, sum)
    }
}

/// `w^4 det J`.
fn determinant_of(e: &HexElement) -> Poly {
    let counts = e.degree.map(|d| usize::from(d) + 1);
    let first = e.points[0];
    let lane = |a: usize| {
        let values = e.points.iter().map(|p| p[3] * (p[a] - first[a])).collect();
        Smooth::new(Poly { counts, values })
    };
    let w = if e.is_polynomial() {
        Smooth::new(Poly {
            counts: [1; 3],
            values: vec![first[3]],
        })
    } else {
        let values = e.points.iter().map(|p| p[3]).collect();
        Smooth::new(Poly { counts, values })
    };
    let [x, y, z] = [0, 1, 2].map(lane);
    let mut sum = Sum::default();
    sum.add(1.0, determinant(&x, &y, &z).product(&w.value));
    sum.add(-1.0, determinant(&w, &y, &z).product(&x.value));
    sum.add(-1.0, determinant(&x, &w, &z).product(&y.value));
    sum.add(-1.0, determinant(&x, &y, &w).product(&z.value));
    sum.get()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::{annulus, element};
    use isobar_fields::evaluate_hex;

    #[test]
    fn the_product_is_the_determinant() {
        let mut e = annulus();
        e.points[7][1] += 0.3;
        let d = determinant_of(&e);
        let degree = d.counts.map(|c| c - 1);
        for u in [[0.2, 0.4, 0.9], [0.7, 0.1, 0.5]] {
            let at = evaluate_hex(&e, u.into());
            let weights: Vec<f64> = e.points.iter().map(|p| p[3]).collect();
            let w = crate::paper_forms::evaluate([2, 1, 1], &weights, u)[0];
            let found = crate::paper_forms::evaluate(degree, &d.values, u)[0] / w.powi(4);
            let want = at.jacobian.determinant();
            assert!((found - want).abs() < 1e-12, "{found} {want}");
        }
    }

    #[test]
    fn elements_are_told_apart() {
        let of = |degree, at: &dyn Fn([f64; 3]) -> [f64; 3]| orientation(&element(degree, at, [0; 3], &[0.0]));
        assert_eq!(of([1; 3], &|u| u), Orientation::Right);
        assert_eq!(of([1; 3], &|[u, v, w]| [-u, -v, 1e-200 * w]), Orientation::Right);
        assert_eq!(of([1; 3], &|[u, v, w]| [-u, v, w]), Orientation::Left);
        // u along the arc, v outwards, w up.
        assert_eq!(orientation(&annulus()), Orientation::Left);
        // Hardcases D3, D4, D5.
        assert_eq!(of([2, 1, 1], &|[u, v, w]| [u * u, v, w]), Orientation::Vanishing);
        assert_eq!(of([1; 3], &|[u, v, w]| [u, u * v, w]), Orientation::Vanishing);
        assert_eq!(of([2, 1, 1], &|[u, v, w]| [4.0 * u * u - 3.0 * u, v, w]), Orientation::Folded);
        assert_eq!(of([1; 3], &|[u, v, _]| [u, v, 0.0]), Orientation::Vanishing);
        // Coefficients of both signs, values of one.
        let near = |[u, v, w]: [f64; 3]| [u * u * u - u * u + 0.34 * u, v, w];
        assert_eq!(of([3, 1, 1], &near), Orientation::Right);
    }

    #[test]
    fn elements_of_a_mesh_are_counted() {
        let of = |degree, at: &dyn Fn([f64; 3]) -> [f64; 3]| element(degree, at, [0; 3], &[0.0]);
        let mesh = HexPatches::new(vec![
            of([1; 3], &|u| u),
            annulus(),
            of([2, 1, 1], &|[u, v, w]| [u * u, v, w]),
            of([2, 1, 1], &|[u, v, w]| [4.0 * u * u - 3.0 * u, v, w]),
            of([1; 3], &|[u, v, w]| [u, v + u, w]),
        ])
        .unwrap();
        let want = Orientations {
            right: 2,
            left: 1,
            vanishing: 1,
            folded: 1,
        };
        assert_eq!(Orientations::of(&mesh), want);
    }
}
