//! From a cell with exactly one sign change to a narrow bracket.
//!
//! Local coordinate x in [0, 1] of the cell. Newton's iteration inside a bracket, started where the control polygon crosses zero; then the
//! signs of p on both sides of the estimate are checked against the error bound, so a returned bracket is proved
//! whatever Newton did. Where that fails, bisection.

use crate::Real;
use crate::cell::eval_error;

/// Newton steps before the cell is left to bisection.
pub(crate) const NEWTON: u32 = 8;

/// A step whose square is below this times the wanted half width is the last: convergence is quadratic and the constant p''/2p' is
/// of order one in a cell with one sign change. Only speed depends on it.
pub(crate) const LAST_STEP: f64 = 0.25;

/// Half of the bracket aimed at, in wanted widths: below 1/2, to leave room for rounding the ends outward.
pub(crate) const HALF_WIDTH: f64 = 0.48;

/// A bracket found by Newton's iteration may be this many times wider than asked for, where rounding asks for it; else bisection finds the
/// narrowest. (A slope near zero at the estimate could ask for a far wider one than needed.)
pub(crate) const FAR: f64 = 64.0;

/// A bracket in local coordinates with certain, opposite signs at its ends, and the estimate.
#[derive(Clone, Copy)]
pub(crate) struct Bracket<T> {
    pub(crate) lo: T,
    pub(crate) hi: T,
    pub(crate) x: T,
}

/// The polynomial over the cell, prepared for evaluation.
pub(crate) struct Local<T, const CAP: usize> {
    /// Scaled Bernstein coefficients.
    s: [T; CAP],
    /// Those of the derivative, one fewer.
    d: [T; CAP],
    m: usize,
    /// A value's sign is certain above this.
    error: T,
    /// Whether p rises through zero.
    rising: bool,
}

impl<T: Real, const CAP: usize> Local<T, CAP> {
    /// `b`: m >= 2 coefficients, one sign change, ends certain. `error`, `most`: their error and largest size.
    #[inline(always)]
    pub(crate) fn new(b: &[T; CAP], m: usize, error: T, most: T) -> Self {
        let (c, c1) = (T::binomials(m - 1), T::binomials(m - 2));
        let degree = T::from_f64((m - 1) as f64);
        let (mut s, mut d) = ([T::ZERO; CAP], [T::ZERO; CAP]);
        for i in 0..m {
            s[i] = b[i] * c[i];
        }
        for i in 0..m - 1 {
            d[i] = (b[i + 1] - b[i]) * (c1[i] * degree);
        }
        Self {
            s,
            d,
            m,
            error: error + eval_error::<T>(m) * most,
            rising: b[m - 1] > T::ZERO,
        }
    }

    /// p over all of [0, 1], of which only the way p goes through zero near the root sought is told by `rising`.
    #[inline(always)]
    pub(crate) fn on_all(b: &[T; CAP], m: usize, error: T, most: T, rising: bool) -> Self {
        Self {
            rising,
            ..Self::new(b, m, error, most)
        }
    }

    /// p(x).
    #[inline(always)]
    fn value(&self, x: T) -> T {
        let r = T::ONE - x;
        let (mut p, mut power) = (self.s[0], T::ONE);
        for i in 1..self.m {
            power *= x;
            p = p * r + self.s[i] * power;
        }
        p
    }

    /// p(x), p'(x).
    #[inline(always)]
    pub(crate) fn value_and_slope(&self, x: T) -> (T, T) {
        let r = T::ONE - x;
        let (mut p, mut q, mut power) = (self.s[0], self.d[0], T::ONE);
        for i in 1..self.m {
            power *= x;
            p = p * r + self.s[i] * power;
            if i + 1 < self.m {
                q = q * r + self.d[i] * power;
            }
        }
        (p, q)
    }

    /// Newton, then the check. `None` if the check fails; the caller then has [`Local::bisect`].
    #[inline(always)]
    pub(crate) fn newton(&self, start: T, half: T) -> Option<Bracket<T>> {
        let (mut lo, mut hi, mut x) = (T::ZERO, T::ONE, start);
        let last = half * T::from_f64(LAST_STEP);
        let mut slope = T::ZERO;
        for _ in 0..NEWTON {
            let (p, q) = self.value_and_slope(x);
            if p.abs() > self.error {
                if (p > T::ZERO) == self.rising {
                    hi = x;
                } else {
                    lo = x;
                }
            }
            let mut step = p / q;
            let mut next = x - step;
            if !(next > lo && next < hi) {
                next = (lo + hi) * T::HALF;
                step = T::ONE;
            }
            slope = q;
            x = next;
            if step * step <= last {
                break;
            }
        }
        // Where rounding hides the sign further than `half` from the root, look further out.
        let reach = half.larger(T::from_f64(2.0) * self.error / slope.abs());
        let (l, h) = ((x - reach).larger(lo), (x + reach).smaller(hi));
        let (pl, ph) = (self.value(l), self.value(h));
        // A bracket end taken over from lo or hi is certain already.
        let (below, above) = if self.rising { (-pl, ph) } else { (pl, -ph) };
        let ok = (below > self.error || l == lo) && (above > self.error || h == hi) && reach <= half * T::from_f64(FAR);
        ok.then_some(Bracket { lo: l, hi: h, x })
    }

    /// Certain sign relative to the root: -1 left of it, 1 right of it, 0 not certain.
    #[inline(always)]
    pub(crate) fn side(&self, x: T) -> i8 {
        let p = self.value(x);
        match (p.abs() > self.error, (p > T::ZERO) == self.rising) {
            (false, _) => 0,
            (true, true) => 1,
            (true, false) => -1,
        }
    }

    /// Bisection of [lo, hi], at whose ends signs are certain and differ, to a bracket of `2 half`, or to the band in which signs are not certain and then outward to its borders. Always succeeds.
    #[cold]
    #[inline(never)]
    pub(crate) fn bisect(&self, mut lo: T, mut hi: T, half: T) -> Bracket<T> {
        loop {
            let x = lo + (hi - lo) * T::HALF;
            if hi - lo <= half + half || x <= lo || x >= hi {
                return Bracket { lo, hi, x };
            }
            match self.side(x) {
                -1 => lo = x,
                1 => hi = x,
                _ => {
                    let (inner_lo, inner_hi) = (x, x);
                    lo = self.edge(lo, inner_lo, -1, half);
                    hi = self.edge(hi, inner_hi, 1, half);
                    return Bracket { lo, hi, x };
                }
            }
        }
    }

    /// Between `outer`, where the sign is certainly `side`, and `inner`, where it is not: a point near `inner` with certain sign `side`.
    fn edge(&self, mut outer: T, mut inner: T, side: i8, half: T) -> T {
        while (outer - inner).abs() > half {
            let x = outer + (inner - outer) * T::HALF;
            if x == outer || x == inner {
                break;
            }
            if self.side(x) == side {
                outer = x;
            } else {
                inner = x;
            }
        }
        outer
    }
}

/// Where the control polygon of a cell with one sign change crosses zero.
#[inline(always)]
pub(crate) fn polygon_crossing<T: Real>(b: &[T]) -> T {
    let m = b.len();
    let first = b[0].sign_bit();
    // The last pair that starts with the first sign is the crossing one.
    let (mut p, mut q, mut at) = (b[0], b[1], T::ZERO);
    for i in 1..m - 1 {
        if b[i].sign_bit() == first {
            p = b[i];
            q = b[i + 1];
            at = T::from_f64(i as f64);
        }
    }
    (at + p / (p - q)) / T::from_f64((m - 1) as f64)
}
