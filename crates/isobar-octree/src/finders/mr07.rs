//! MR07 after Mørken and Reimers (Math. Comp. 76, 2007; thesis, section 3.2.4).

use super::polygon::first_crossing;
use isobar_poly::Real;

/// Most coefficients while knots are inserted.
const ROOM: usize = 64;

/// First root on [0, 1]: a knot is inserted where the control polygon of the B-spline form first crosses zero, `knots` times (at most
/// 64 - M). The thesis gives no listing; its registers, 30 + 9d + 2i, say that coefficients and knots both grow, as here.
///
/// The crossing is that of the polygon over the Greville abscissae. Converges to the first root if it is simple; **no guarantee** at a given
/// number of knots: a crossing that is still to vanish is returned as a root. A knot of full multiplicity ends the search.
#[must_use]
pub fn mr07<T: Real, const M: usize>(b: &[T; M], knots: u32) -> Option<T> {
    let d = M.checked_sub(1).filter(|d| *d > 0 && M <= 32)?;
    let mut c = [T::ZERO; ROOM];
    c[..M].copy_from_slice(b);
    let mut t = [T::ONE; ROOM + 32];
    t[..=d].fill(T::ZERO);
    let degree = T::from_f64(d as f64);
    let crossing = |c: &[T], t: &[T]| {
        first_crossing(c).map(|i| {
            let greville = t[i + 1..=i + d].iter().fold(T::ZERO, |s, x| s + *x) / degree;
            greville + c[i] / (c[i] - c[i + 1]) * ((t[i + d + 1] - t[i + 1]) / degree)
        })
    };
    let mut x = crossing(b, &t)?;
    // m coefficients at the start of a step.
    for m in M..M + (knots as usize).min(ROOM - M) {
        // The last non-empty interval [t_l, t_(l+1)] for x = 1, else the one with t_l <= x < t_(l+1).
        let l = (d..m).rev().find(|&l| t[l] <= x && t[l] < t[l + 1]).unwrap_or(d);
        // A knot of multiplicity d: the spline passes through its coefficient there.
        if t[l + 1 - d] == x || (x == T::ONE && t[l + 1] == x) {
            break;
        }
        c.copy_within(l..m, l + 1);
        for i in (l + 1 - d..=l).rev() {
            let a = (x - t[i]) / (t[i + d] - t[i]);
            // c[i] still holds the old coefficient i, except that the shift has not touched those up to l.
            c[i] = (T::ONE - a) * c[i - 1] + a * c[i];
        }
        t.copy_within(l + 1..m + d + 1, l + 2);
        t[l + 1] = x;
        x = crossing(&c[..=m], &t)?;
    }
    Some(x)
}
