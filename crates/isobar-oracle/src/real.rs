//! The two floating-point number types of stages 1 and 2: f64 and double-double, behind one trait with a stated unit of rounding.
//!
//! Double-double arithmetic follows Joldes, Muller and Popescu, *Tight and rigorous error bounds for basic building
//! blocks of double-word arithmetic* (ACM TOMS 44, 2017), with `u = 2^-53`. The bounds used, all relative to the exact result:
//! sum of two double-doubles (algorithm 6) `3u^2 + 13u^3`, sum with an f64 (algorithm 4) `2u^2`, product (algorithms 10 to 12)
//! `7u^2`, product with an f64 (algorithms 7 to 9) `2u^2` (7) to `3u^2` (8), quotient by an f64 (algorithm 15) `3u^2`, quotient
//! (algorithms 16 and 17) `15u^2 + 56u^3`. They hold without overflow and underflow, which [`in_range`] excludes beforehand:
//! every input is 0 or has magnitude in `[2^-200, 2^200]`, and no formula of this crate multiplies enough of them to leave
//! `[2^-969, 2^1023]` where exactness of the error terms is needed (the longest, a coordinate from a general matrix, is a quotient of
//! degree 3 over degree 3; polynomials of higher degree check their magnitude, see `compose`).

use std::ops::{Add, Mul, Neg, Sub};

/// Half an ulp of one: the unit of rounding of f64.
pub(crate) const U64: f64 = 1.110_223_024_625_156_5e-16;

/// `8u^2`, above all double-double bounds but the quotient's: the unit of rounding of [`Dd`] sums and products.
pub(crate) const UDD: f64 = 8.0 * U64 * U64;

/// Whether a number is 0 or of a magnitude with which no intermediate over- or underflows.
pub(crate) fn in_range(x: f64) -> bool {
    // 2^-200 and 2^200
    x == 0.0 || (6.223_015_277_861_142e-61..=1.606_938_044_258_990_3e60).contains(&x.abs())
}

/// A real number type with a bound on the relative error of each sum, difference and product.
pub(crate) trait Real: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Neg<Output = Self> {
    /// Bound on the relative error of one operation.
    const UNIT: f64;
    /// Zero.
    const ZERO: Self;
    /// Exactly `x`.
    fn from_f64(x: f64) -> Self;
    /// `a - b`: for f64 with one rounding, for double-double exactly.
    fn difference(a: f64, b: f64) -> Self;
    /// The nearest f64, to a relative error of at most `2u^2` besides that of f64.
    fn f64(self) -> f64;
    /// The double-double, rounded where this type is narrower.
    fn from_dd(x: Dd) -> Self;
}

impl Real for f64 {
    const UNIT: f64 = U64;
    const ZERO: Self = 0.0;
    #[inline]
    fn from_f64(x: f64) -> Self {
        x
    }
    #[inline]
    fn difference(a: f64, b: f64) -> Self {
        a - b
    }
    #[inline]
    fn f64(self) -> f64 {
        self
    }
    #[inline]
    fn from_dd(x: Dd) -> Self {
        x.hi
    }
}

/// An unevaluated sum `hi + lo` with `hi = fl(hi + lo)`: about 106 bits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Dd {
    /// The f64 nearest to the value.
    pub(crate) hi: f64,
    /// What is missing.
    pub(crate) lo: f64,
}

/// `a + b` exactly (Knuth).
#[inline]
pub(crate) fn two_sum(a: f64, b: f64) -> Dd {
    let s = a + b;
    let bb = s - a;
    Dd {
        hi: s,
        lo: (a - (s - bb)) + (b - bb),
    }
}

/// `a + b` exactly, for `|a| >= |b|` or a = 0 (Dekker).
#[inline]
fn quick_two_sum(a: f64, b: f64) -> Dd {
    let s = a + b;
    Dd { hi: s, lo: b - (s - a) }
}

/// `x` in two halves of at most 26 bits each (Veltkamp).
#[inline]
fn split(x: f64) -> (f64, f64) {
    let c = 134_217_729.0 * x; // 2^27 + 1
    let hi = c - (c - x);
    (hi, x - hi)
}

/// `a * b` exactly (Dekker; no fused multiply-add, which the base x86-64 lacks).
#[inline]
pub(crate) fn two_prod(a: f64, b: f64) -> Dd {
    let p = a * b;
    let (ah, al) = split(a);
    let (bh, bl) = split(b);
    Dd {
        hi: p,
        lo: ((ah * bh - p) + ah * bl + al * bh) + al * bl,
    }
}

impl Dd {
    /// Exactly `x`.
    #[inline]
    pub(crate) const fn new(x: f64) -> Self {
        Self { hi: x, lo: 0.0 }
    }

    /// Product with an f64 (algorithm 7): `2u^2`.
    #[inline]
    pub(crate) fn times(self, y: f64) -> Self {
        let c = two_prod(self.hi, y);
        let t = quick_two_sum(c.hi, self.lo * y);
        quick_two_sum(t.hi, t.lo + c.lo)
    }

    /// Sum with an f64 (algorithm 4): `2u^2`.
    #[inline]
    pub(crate) fn plus(self, y: f64) -> Self {
        let s = two_sum(self.hi, y);
        quick_two_sum(s.hi, self.lo + s.lo)
    }

    /// Quotient by an f64 (algorithm 15): `3u^2`.
    #[inline]
    pub(crate) fn over(self, y: f64) -> Self {
        let q = self.hi / y;
        let p = two_prod(q, y);
        let r = (self.hi - p.hi) + (self.lo - p.lo);
        quick_two_sum(q, r / y)
    }

    /// Quotient (algorithm 17): `15u^2 + 56u^3`.
    #[inline]
    pub(crate) fn divide(self, y: Self) -> Self {
        let q = self.hi / y.hi;
        let p = y.times(q);
        let r = (self.hi - p.hi) + (self.lo - p.lo);
        quick_two_sum(q, r / y.hi)
    }

    /// Magnitude of the leading part.
    #[inline]
    pub(crate) fn abs(self) -> f64 {
        self.hi.abs()
    }
}

impl Add for Dd {
    type Output = Self;
    /// Algorithm 6: `3u^2 + 13u^3`.
    #[inline]
    fn add(self, y: Self) -> Self {
        let s = two_sum(self.hi, y.hi);
        let t = two_sum(self.lo, y.lo);
        let v = quick_two_sum(s.hi, s.lo + t.hi);
        quick_two_sum(v.hi, t.lo + v.lo)
    }
}

impl Neg for Dd {
    type Output = Self;
    #[inline]
    fn neg(self) -> Self {
        Self {
            hi: -self.hi,
            lo: -self.lo,
        }
    }
}

impl Sub for Dd {
    type Output = Self;
    #[inline]
    fn sub(self, y: Self) -> Self {
        self + -y
    }
}

impl Mul for Dd {
    type Output = Self;
    /// Algorithm 10: `7u^2`.
    #[inline]
    fn mul(self, y: Self) -> Self {
        let c = two_prod(self.hi, y.hi);
        quick_two_sum(c.hi, c.lo + (self.hi * y.lo + self.lo * y.hi))
    }
}

impl Real for Dd {
    const UNIT: f64 = UDD;
    const ZERO: Self = Self::new(0.0);
    #[inline]
    fn from_f64(x: f64) -> Self {
        Self::new(x)
    }
    #[inline]
    fn difference(a: f64, b: f64) -> Self {
        two_sum(a, -b)
    }
    #[inline]
    fn f64(self) -> f64 {
        self.hi
    }
    #[inline]
    fn from_dd(x: Dd) -> Self {
        x
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exact::Dyadic;

    fn exact(x: Dd) -> Dyadic {
        Dyadic::from_f64(x.hi).plus(&Dyadic::from_f64(x.lo))
    }

    /// The stated bounds against exact arithmetic, with operands that cancel.
    #[test]
    fn operations_keep_their_bounds() {
        let mut seed = 11u64;
        let mut next = || {
            seed = seed
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (seed >> 11) as f64 / (1u64 << 53) as f64 - 0.5
        };
        for n in 0..20_000 {
            let a = two_sum(next(), next() * 1e-17);
            let b = if n % 3 == 0 {
                two_sum(-a.hi, next() * 1e-17)
            } else {
                two_sum(next(), next() * 1e-17)
            };
            let (ea, eb) = (exact(a), exact(b));
            let ok = |got: Dd, want: Dyadic, bound: f64| {
                let error = exact(got).plus(&want.negated());
                let error = error.to_f64_bounds().0.abs().max(error.to_f64_bounds().1.abs());
                let size = want.to_f64_bounds().0.abs();
                assert!(error <= bound * size * (1.0 + 1e-9) + 1e-300, "{error:e} {size:e}");
            };
            ok(a + b, ea.plus(&eb), UDD);
            ok(a * b, ea.times(&eb), UDD);
            ok(a.times(b.hi), ea.times(&Dyadic::from_f64(b.hi)), UDD);
            ok(a.plus(b.hi), ea.plus(&Dyadic::from_f64(b.hi)), UDD);
            // q * y - a = a * relative error of q
            let q = a.over(b.hi);
            ok(a, exact(q).times(&Dyadic::from_f64(b.hi)), UDD);
            let q = a.divide(b);
            ok(a, exact(q).times(&eb), 2.0 * UDD);
        }
    }

    #[test]
    fn products_are_exact() {
        let (a, b) = (1.0 + 2f64.powi(-40), 1.0 - 2f64.powi(-45));
        let p = two_prod(a, b);
        assert_eq!(
            exact(p).compare(&Dyadic::from_f64(a).times(&Dyadic::from_f64(b))),
            std::cmp::Ordering::Equal
        );
    }
}
