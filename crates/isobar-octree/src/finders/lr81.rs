//! LR81 after Lane and Riesenfeld (thesis, section 3.2.4 and Listing A.2).

use super::polygon::{crossing_at, first_crossing, split};
use isobar_poly::Real;

/// First root on [0, 1] of the polynomial with Bernstein coefficients `b`: the crossing of its control polygon, after `iterations`
/// subdivisions there. **No guarantee**: it takes the left part whenever that part's polygon crosses zero, and never comes back, so a polygon that
/// crosses without a root (hardcases A7) ends the search early or is taken for a root.
///
/// The thesis uses 9 to 11 iterations for algebraic surfaces, 3, 5, 7 for tri-linear, -quadratic and -cubic voxels, 6 (d + 1) in its section 6.1.
///
/// Corrected against the listing (maths, section B; the inventory's errata): `t` in `deCasteljauSplit` is `at`; `approxRoot` divides by 10
/// where the control points of degree 9 lie at i/9; line 21's `return = ` returns; `int` and `real_t at` are declared once. Filled in: the part of
/// [0, 1] the current polynomial stands for (the listing's "snipped update of Scale and Root"). The bounds of
/// its loops are right.
#[must_use]
pub fn lr81<T: Real, const M: usize>(b: &[T; M], iterations: u32) -> Option<T> {
    let mut p = *b;
    let mut at = crossing_at(&p, first_crossing(&p)?);
    let (mut start, mut width) = (T::ZERO, T::ONE);
    for _ in 0..iterations {
        let (left, right) = split(&p, at);
        if let Some(i) = first_crossing(&left) {
            width *= at;
            at = crossing_at(&left, i);
            p = left;
        } else if let Some(i) = first_crossing(&right) {
            start += width * at;
            width *= T::ONE - at;
            at = crossing_at(&right, i);
            p = right;
        } else {
            return None;
        }
    }
    Some(start + width * at)
}
