//! From brackets in the parameter of a stretch to brackets in t.

use crate::{
    Decided, Multiplicity, Root,
    isolate::Isolated,
    real::{Dd, two_sum},
};

/// A certified bracket in s and in t, and the slope of the function there.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Bracket {
    /// In s, rounded outward.
    pub(crate) s: (f64, f64),
    /// In t, rounded outward.
    pub(crate) t: (f64, f64),
    /// d(s - c)/dt at the root, rounded.
    pub(crate) slope: f64,
}

/// An enclosure of a double-double with absolute error at most `e`: f64 at or below `x - e` and at or above `x + e`.
fn outward(x: Dd, e: f64) -> (f64, f64) {
    // Up to x.hi + y for y > 0; downward is the mirror image. y carries one rounding of a sum, which the factor covers.
    let up = |hi: f64, y: f64| {
        if y <= 0.0 {
            return hi;
        }
        let (y, next) = (y * (1.0 + 4.0 * f64::EPSILON), hi.next_up());
        // The gap is exact. Beyond it the sum rounds by at most half an ulp of itself, which the step to the next f64 undoes.
        if y <= next - hi { next } else { (hi + y).next_up() }
    };
    (-up(-x.hi, e - x.lo), up(x.hi, e + x.lo))
}

impl Bracket {
    /// Of a root isolated in tau over `[s0, s1]`: `s = s0 + (s1 - s0) tau` with an exact difference, one product and one sum in
    /// double-double, and one sum more for t.
    pub(crate) fn new(t_ref: f64, (s0, s1): (f64, f64), root: &Isolated) -> Self {
        let h = two_sum(s1, -s0);
        let at = |tau: f64| {
            let s = h.times(tau).plus(s0);
            // 2^-100 of the magnitudes: more than the 2u^2 + 2u^2 + 2u^2 of the three operations.
            let e = 7.9e-31 * (h.abs() + s0.abs() + t_ref.abs());
            (outward(s, e), outward(s.plus(t_ref), e))
        };
        let (a, b) = (at(root.lo), at(root.hi));
        Self {
            s: (a.0.0, b.0.1),
            t: (a.1.0, b.1.1),
            slope: root.slope / h.hi,
        }
    }

    /// The root, which is known not to lie before `least`.
    pub(crate) fn root(&self, least: f64, decided: Decided) -> Root {
        Root {
            lo: self.t.0.max(least),
            hi: self.t.1.max(least),
            multiplicity: Multiplicity::Simple,
            interval_end: None,
            slope: self.slope,
            decided,
        }
    }

    /// Whether the bracket in t is as narrow as the oracle promises.
    pub(crate) fn narrow(&self) -> bool {
        narrow(self.t.0, self.t.1)
    }
}

/// `hi - lo <= max(4 ulp, 1e-13 |t|)`.
pub(crate) fn narrow(lo: f64, hi: f64) -> bool {
    let t = lo.abs().max(hi.abs());
    let ulp = t.next_up() - t;
    hi - lo <= (4.0 * ulp).max(1e-13 * t)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_is_outward() {
        assert_eq!(outward(Dd::new(1.0), 0.0), (1.0, 1.0));
        let x = two_sum(1.0, 1e-20);
        assert_eq!(outward(x, 1e-30), (1.0, 1.0f64.next_up()));
        let x = two_sum(1.0, -1e-20);
        let (lo, hi) = outward(x, 1e-30);
        assert!(lo < 1.0 && hi == 1.0);
        let (lo, hi) = outward(Dd::new(0.0), 1e-30);
        assert!(lo < 0.0 && hi > 0.0);
    }
}
