//! Closed intervals with outward rounding.
//!
//! Every operation returns an interval that contains the exact real result for all points of its operands: the f64
//! result (correctly rounded by IEEE 754) is moved one step outward, so no rounding mode is needed. Overflow gives
//! infinite ends. Sine and cosine are widened by four ulps and by the quadrant's extrema; the platform's libm is assumed
//! to be within two ulps, which glibc, musl and the Rust fallback document for |x| < 2^20.

use std::ops::{Add, Mul, Neg, Sub};

/// A closed interval `[lo, hi]` with `lo <= hi`, ends may be infinite.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Interval {
    /// Lower end.
    pub lo: f64,
    /// Upper end.
    pub hi: f64,
}

impl Interval {
    /// The whole real line: the enclosure of which nothing is known.
    pub const ALL: Self = Self {
        lo: f64::NEG_INFINITY,
        hi: f64::INFINITY,
    };

    /// `[lo, hi]`.
    #[must_use]
    pub fn new(lo: f64, hi: f64) -> Self {
        debug_assert!(lo <= hi, "[{lo}, {hi}]");
        Self { lo, hi }
    }

    /// The single number `x`, exactly.
    #[must_use]
    pub const fn point(x: f64) -> Self {
        Self { lo: x, hi: x }
    }

    /// Whether `x` lies in the interval, ends included.
    #[must_use]
    pub fn contains(self, x: f64) -> bool {
        self.lo <= x && x <= self.hi
    }

    /// Whether zero lies in the interval.
    #[must_use]
    pub fn has_zero(self) -> bool {
        self.contains(0.0)
    }

    /// `hi - lo`, rounded.
    #[must_use]
    pub fn width(self) -> f64 {
        self.hi - self.lo
    }

    /// A number inside, near the middle.
    #[must_use]
    pub fn mid(self) -> f64 {
        let m = 0.5 * self.lo + 0.5 * self.hi;
        m.clamp(self.lo, self.hi)
    }

    /// The smallest interval that holds both.
    #[must_use]
    pub fn union(self, o: Self) -> Self {
        Self {
            lo: self.lo.min(o.lo),
            hi: self.hi.max(o.hi),
        }
    }

    /// The common part, if any.
    #[must_use]
    pub fn intersect(self, o: Self) -> Option<Self> {
        let lo = self.lo.max(o.lo);
        let hi = self.hi.min(o.hi);
        (lo <= hi).then_some(Self { lo, hi })
    }

    /// `x * x`, tighter than the product of two independent operands: never negative.
    #[must_use]
    pub fn square(self) -> Self {
        let (a, b) = (self.lo * self.lo, self.hi * self.hi);
        let hi = a.max(b).next_up();
        let lo = if self.has_zero() { 0.0 } else { a.min(b).next_down().max(0.0) };
        Self { lo, hi }
    }

    /// `x^n` for `n >= 0`, tight for even powers around zero.
    #[must_use]
    pub fn powi(self, n: u32) -> Self {
        match n {
            0 => Self::point(1.0),
            1 => self,
            _ if n.is_multiple_of(2) => self.powi(n / 2).square(),
            _ => {
                // Odd powers are monotone: the ends decide.
                let end = |x: f64| {
                    let p = Self::point(x);
                    p.powi(n - 1) * p
                };
                Self {
                    lo: end(self.lo).lo,
                    hi: end(self.hi).hi,
                }
            }
        }
    }

    /// Sine over the interval. `[-1, 1]` where an end exceeds 2^20, the range the error bound is stated for.
    #[must_use]
    pub fn sin(self) -> Self {
        self.periodic(f64::sin, std::f64::consts::FRAC_PI_2)
    }

    /// Cosine over the interval. `[-1, 1]` where an end exceeds 2^20.
    #[must_use]
    pub fn cos(self) -> Self {
        self.periodic(f64::cos, 0.0)
    }

    /// `f` has its maxima at `peak + 2 pi k` and its minima half a period later.
    fn periodic(self, f: fn(f64) -> f64, peak: f64) -> Self {
        use std::f64::consts::{PI, TAU};
        if !(self.lo.abs() < 1_048_576.0 && self.hi.abs() < 1_048_576.0) || self.width() >= TAU {
            return Self { lo: -1.0, hi: 1.0 };
        }
        // An extremum may only be reported too often, never too rarely: the slack exceeds the rounding of the quotient.
        let slack = 1e-9;
        let holds = |at: f64| {
            let first = ((self.lo - at) / TAU - slack).ceil();
            first <= (self.hi - at) / TAU + slack
        };
        let (a, b) = (f(self.lo), f(self.hi));
        let ulps = 4.0 * f64::EPSILON;
        let hi = if holds(peak) { 1.0 } else { (a.max(b) + ulps).min(1.0) };
        let lo = if holds(peak + PI) { -1.0 } else { (a.min(b) - ulps).max(-1.0) };
        Self { lo, hi }
    }
}

impl Add for Interval {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Self {
            lo: (self.lo + o.lo).next_down(),
            hi: (self.hi + o.hi).next_up(),
        }
    }
}

impl Sub for Interval {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        Self {
            lo: (self.lo - o.hi).next_down(),
            hi: (self.hi - o.lo).next_up(),
        }
    }
}

impl Neg for Interval {
    type Output = Self;
    fn neg(self) -> Self {
        Self {
            lo: -self.hi,
            hi: -self.lo,
        }
    }
}

impl Mul for Interval {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        // 0 * inf is NaN; the exact product with the number zero is zero.
        let p = |a: f64, b: f64| if a == 0.0 || b == 0.0 { 0.0 } else { a * b };
        let (a, b, c, d) = (p(self.lo, o.lo), p(self.lo, o.hi), p(self.hi, o.lo), p(self.hi, o.hi));
        Self {
            lo: a.min(b).min(c.min(d)).next_down(),
            hi: a.max(b).max(c.max(d)).next_up(),
        }
    }
}

impl Mul<f64> for Interval {
    type Output = Self;
    fn mul(self, k: f64) -> Self {
        self * Self::point(k)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A small seeded generator; tests need no crate for it.
    fn next(seed: &mut u64) -> f64 {
        *seed = seed
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (*seed >> 11) as f64 / (1u64 << 53) as f64 * 8.0 - 4.0
    }

    #[test]
    fn operations_enclose_samples() {
        let mut s = 7;
        for _ in 0..20_000 {
            let (a, b, c, d) = (next(&mut s), next(&mut s), next(&mut s), next(&mut s));
            let x = Interval::new(a.min(b), a.max(b));
            let y = Interval::new(c.min(d), c.max(d));
            for k in 0..=4 {
                let u = (x.lo + (x.hi - x.lo) * f64::from(k) / 4.0).clamp(x.lo, x.hi);
                let v = (y.hi - (y.hi - y.lo) * f64::from(k) / 4.0).clamp(y.lo, y.hi);
                assert!((x + y).contains(u + v));
                assert!((x - y).contains(u - v));
                assert!((x * y).contains(u * v));
                assert!(x.square().contains(u * u));
                assert!(x.powi(3).contains(u * u * u));
                assert!(x.sin().contains(u.sin()), "{x:?} {u}");
                assert!(x.cos().contains(u.cos()));
            }
        }
    }

    #[test]
    fn sine_extrema_are_reached() {
        let x = Interval::new(1.5, 1.6).sin();
        assert!(x.hi >= 1.0 && x.lo < 1.5f64.sin());
        let x = Interval::new(3.0, 3.3).cos();
        assert!(x.lo <= -1.0);
        assert_eq!(Interval::new(0.0, 7.0).sin(), Interval::new(-1.0, 1.0));
    }

    #[test]
    fn even_powers_are_not_negative() {
        assert_eq!(Interval::new(-2.0, 1.0).square().lo, 0.0);
        assert!(Interval::new(-2.0, 1.0).powi(3).contains(-8.0));
    }
}
