//! The last digits of an f32 root.
//!
//! In f32 the sign of p is uncertain within some 30 u of the largest coefficient: at degree 9 most brackets end wider than 1e-6, though f32 numbers near 1
//! are 6e-8 apart. The coefficients are f32 numbers, so f64 evaluates the same polynomial 2^29 times as accurately: one step of Newton's
//! iteration from the f32 estimate, and the signs on both sides of its result. Ends of brackets stay f32 numbers.

use crate::Real;
use crate::refine::Local;

/// Half of the bracket aimed at, in wanted widths: leaves room for rounding both ends, at t near 1 and widths down to 1e-6.
pub(crate) const HALF: f32 = 0.45;

/// Narrows the bracket `[lo, hi]` around `t` to `width`, or as far as f64 can tell the sign of p. `b`: `m` coefficients over [0, 1], each wrong by
/// at most `error`; p has exactly one root in the cell the bracket lies in, and rises or falls through zero there.
#[inline(always)]
pub(crate) fn sharpen<const CAP: usize>(
    b: &[f32; CAP],
    m: usize,
    error: f32,
    width: f32,
    rising: bool,
    [lo, hi, t]: [f32; 3],
) -> [f32; 3] {
    let most = b[1..m].iter().fold(b[0].abs(), |most, x| most.larger(x.abs()));
    let p = Local::<f64, CAP>::on_all(&b.map(f64::from), m, error.into(), most.into(), rising);
    let (value, slope) = p.value_and_slope(t.into());
    let x = (f64::from(t) - value / slope) as f32;
    if x > lo && x < hi {
        let half = HALF * width;
        let (low, high) = ((x - half).larger(lo), (x + half).smaller(hi));
        if (p.side(low.into()) < 0 || low == lo) && (p.side(high.into()) > 0 || high == hi) {
            return [low, high, x];
        }
    }
    let r = p.bisect(lo.into(), hi.into(), f64::from(HALF * width));
    let (mut low, mut high) = (r.lo as f32, r.hi as f32);
    if f64::from(low) > r.lo {
        low = low.below();
    }
    if f64::from(high) < r.hi {
        high = high.above();
    }
    [low, high, r.x as f32]
}
