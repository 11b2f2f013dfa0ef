//! Roots of a cubic in Bernstein form on [0, 1], left to right, with what is certain about them.
//!
//! "Certain" is meant in the sense of a bound on the error of the four coefficients (see `walk.rs` for its derivation): a coefficient
//! counts as positive or negative only beyond the bound. The number of sign changes bounds the number of roots from above and has its parity
//! (variation diminishing), so no change is a proof of no root, one change a proof of exactly one.

/// A root found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct CubicRoot {
    /// Position in [0, 1].
    pub(crate) at: f64,
    /// The sign changes here, beyond the bound at both ends of the part it was isolated in.
    pub(crate) simple: bool,
}

/// What was found on [0, 1]: at most three roots in order.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Found {
    roots: [CubicRoot; 3],
    len: usize,
    /// Everything but the roots found is proved free of roots.
    pub(crate) certain: bool,
    /// Right end of the last stretch on which the cubic cannot be told from zero.
    touched: f64,
    whole: [f64; 4],
    bound: f64,
}

impl Found {
    pub(crate) fn roots(&self) -> &[CubicRoot] {
        &self.roots[..self.len]
    }

    fn push(&mut self, r: CubicRoot) {
        // Rounding may split a touching point into several; between these the cubic cannot be told from zero.
        if let (Some(last), false) = (self.roots().last(), r.simple)
            && !last.simple
            && value(self.whole, 0.5 * (last.at + r.at)).abs() <= 2.0 * self.bound
        {
            return;
        }
        if self.len < 3 {
            self.roots[self.len] = r;
            self.len += 1;
        }
    }
}

/// Parts are halved this often before what is left counts as touching zero: 2^-40 of a cell.
const DEPTH: u32 = 40;

/// All roots of the cubic `b` on [0, 1], given that each coefficient is off by at most `bound`. No root where all are clear of zero.
#[inline(always)]
pub(crate) fn roots(b: [f64; 4], bound: f64) -> Found {
    let mut f = Found {
        roots: [CubicRoot { at: 0.0, simple: false }; 3],
        len: 0,
        certain: true,
        touched: -1.0,
        whole: b,
        bound,
    };
    let least = b[0].min(b[1]).min(b[2].min(b[3]));
    let greatest = b[0].max(b[1]).max(b[2].max(b[3]));
    if least > bound || greatest < -bound {
        return f;
    }
    isolate(b, bound, 0.0, 1.0, DEPTH, &mut f);
    f
}

fn isolate(b: [f64; 4], bound: f64, lo: f64, hi: f64, depth: u32, f: &mut Found) {
    let least = b[0].min(b[1]).min(b[2].min(b[3]));
    let greatest = b[0].max(b[1]).max(b[2].max(b[3]));
    if least > bound || greatest < -bound {
        return;
    }
    let n = [b[0] < 0.0, b[1] < 0.0, b[2] < 0.0, b[3] < 0.0];
    let changes = u32::from(n[0] != n[1]) + u32::from(n[1] != n[2]) + u32::from(n[2] != n[3]);
    let clear = b[0].abs().min(b[1].abs()).min(b[2].abs().min(b[3].abs())) > bound;
    if changes == 1 {
        let at = lo + refine(b, bound) * (hi - lo);
        // One change among coefficients whose signs are certain is exactly one root; so it is if only inner ones are in doubt and they lie
        // between the signs of the ends.
        let simple = b[0].abs() > bound && b[3].abs() > bound;
        f.certain &= clear;
        f.push(CubicRoot { at, simple });
        return;
    }
    if -bound <= least && greatest <= bound || depth == 0 {
        // Not to be told from zero: a tangent point or a whole stretch. It is reported once, at its entry.
        f.certain = false;
        if f.touched < lo {
            let at = if changes == 0 && depth < DEPTH { 0.5 * (lo + hi) } else { lo };
            f.push(CubicRoot { at, simple: false });
        }
        f.touched = hi;
        return;
    }
    if changes == 0 && (b[1].abs() > bound && b[2].abs() > bound) {
        // Only an end is in doubt, and all signs agree: the root beside it, if any, belongs to the neighbour.
        f.certain = false;
        return;
    }
    let m = |x: f64, y: f64| 0.5 * (x + y);
    let (p, q, r) = (m(b[0], b[1]), m(b[1], b[2]), m(b[2], b[3]));
    let (s, t) = (m(p, q), m(q, r));
    let mid = m(s, t);
    let half = 0.5 * (lo + hi);
    isolate([b[0], p, s, mid], bound, lo, half, depth - 1, f);
    isolate([mid, t, r, b[3]], bound, half, hi, depth - 1, f);
}

/// Value at x by de Casteljau's rule: convex combinations, so the rounding error is at most 6 units of the greatest coefficient.
#[inline(always)]
pub(crate) fn value(b: [f64; 4], x: f64) -> f64 {
    let y = 1.0 - x;
    let (p, q, r) = (y * b[0] + x * b[1], y * b[1] + x * b[2], y * b[2] + x * b[3]);
    y * (y * p + x * q) + x * (y * q + x * r)
}

/// The root of a cubic whose end coefficients differ in sign, by Newton's method kept inside a shrinking bracket.
#[inline(always)]
fn refine(b: [f64; 4], bound: f64) -> f64 {
    let c1 = 3.0 * (b[1] - b[0]);
    let c2 = 3.0 * ((b[2] - b[1]) - (b[1] - b[0]));
    let c3 = (b[3] - b[0]) - 3.0 * (b[2] - b[1]);
    let negative = b[0] < 0.0;
    let (mut lo, mut hi) = (0.0f64, 1.0f64);
    // An end that is zero up to the bound may be another root: away from it.
    let clear = b[0].abs().min(b[3].abs()) > bound;
    let mut x = if clear { (b[0] / (b[0] - b[3])).clamp(0.0, 1.0) } else { 0.5 };
    for _ in 0..60 {
        let f = b[0] + x * (c1 + x * (c2 + x * c3));
        if (f < 0.0) == negative {
            lo = x;
        } else {
            hi = x;
        }
        let g = c1 + x * (2.0 * c2 + x * (3.0 * c3));
        let newton = x - f / g;
        // NaN and anything outside the bracket fall back to halving it.
        let next = if newton >= lo && newton <= hi {
            newton
        } else {
            0.5 * (lo + hi)
        };
        let done = (next - x).abs() <= 1e-15;
        x = next;
        if done {
            break;
        }
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bernstein coefficients of k (x - r)(x - s)(x - t), by the polar form.
    fn with_roots(r: f64, s: f64, t: f64, k: f64) -> [f64; 4] {
        let polar = |x: f64, y: f64, z: f64| {
            let e = |a: f64, b: f64, c: f64| (x - a) * (y - b) * (z - c);
            k * (e(r, s, t) + e(r, t, s) + e(s, r, t) + e(s, t, r) + e(t, r, s) + e(t, s, r)) / 6.0
        };
        [
            polar(0.0, 0.0, 0.0),
            polar(1.0, 0.0, 0.0),
            polar(1.0, 1.0, 0.0),
            polar(1.0, 1.0, 1.0),
        ]
    }

    fn at(b: [f64; 4]) -> Vec<f64> {
        roots(b, 1e-15).roots().iter().map(|r| r.at).collect()
    }

    fn near(a: &[f64], b: &[f64], tolerance: f64) {
        assert!(
            a.len() == b.len() && a.iter().zip(b).all(|(x, y)| (x - y).abs() <= tolerance),
            "{a:?} instead of {b:?}"
        );
    }

    #[test]
    fn planted_roots_are_found_in_order() {
        near(&at(with_roots(0.3, 0.6, -1.0, 1.0)), &[0.3, 0.6], 1e-14); // hardcases B2
        near(&at(with_roots(0.1, 0.5, 0.9, -3.0)), &[0.1, 0.5, 0.9], 1e-14);
        near(&at(with_roots(0.5, 2.0, 3.0, 1.0)), &[0.5], 1e-14);
        near(&at(with_roots(-0.5, 2.0, 3.0, 1.0)), &[], 0.0);
        near(&at([1.0, 1.0, -4.0, 5.0]), &[0.343_553_830_433, 0.673_413_701_243], 1e-11); // hardcases A15
    }

    #[test]
    fn tangents_are_reported_once_and_not_as_certain() {
        let f = roots(with_roots(0.45, 0.45, -1.0, 1.0), 1e-15); // hardcases B3
        assert_eq!(f.roots().len(), 1);
        assert!((f.roots()[0].at - 0.45).abs() < 1e-6 && !f.certain && !f.roots()[0].simple);
        let f = roots(with_roots(0.5, 0.5, 0.5, 1.0), 1e-15); // hardcases A3
        assert_eq!(f.roots().len(), 1);
        assert!((f.roots()[0].at - 0.5).abs() < 1e-4, "{:?}", f.roots());
    }

    #[test]
    fn zero_is_one_hit_at_the_entry() {
        let f = roots([0.0; 4], 1e-15); // hardcases A16
        assert_eq!((f.roots().len(), f.roots()[0].at, f.certain), (1, 0.0, false));
    }

    #[test]
    fn no_root_is_certain_and_false_alarms_are_not_roots() {
        assert!(roots([1.0, 2.0, 3.0, 1.0], 1e-15).certain);
        let f = roots([1.0, -0.2, -0.2, 1.0], 1e-15); // two sign changes, least value 0.1
        assert!(f.roots().is_empty() && f.certain);
    }

    #[test]
    fn values_agree_with_the_power_form() {
        let b = with_roots(0.25, 0.5, 0.75, 2.0);
        for i in 0..=16 {
            let x = f64::from(i) / 16.0;
            assert!((value(b, x) - 2.0 * (x - 0.25) * (x - 0.5) * (x - 0.75)).abs() < 1e-15);
        }
    }
}
