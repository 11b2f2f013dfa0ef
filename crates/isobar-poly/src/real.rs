//! The two number types of this crate, behind one small trait.

use std::fmt::{Debug, Display};
use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub, SubAssign};

/// Highest degree any routine of this crate accepts: 28 coefficients, the ray restriction of a tri-degree-9 field.
pub const MAX_DEGREE: usize = 27;

mod sealed {
    pub trait Sealed: Sized {
        /// The bracket and estimate `[lo, hi, t]` of a root, found in this precision, as narrow as the next higher one makes it: see `sharpen.rs`.
        fn sharpen<const CAP: usize>(
            b: &[Self; CAP],
            m: usize,
            error: Self,
            width: Self,
            rising: bool,
            bracket: [Self; 3],
        ) -> [Self; 3];
    }

    impl Sealed for f32 {
        #[inline(always)]
        fn sharpen<const CAP: usize>(
            b: &[f32; CAP],
            m: usize,
            error: f32,
            width: f32,
            rising: bool,
            bracket: [f32; 3],
        ) -> [f32; 3] {
            crate::sharpen::sharpen(b, m, error, width, rising, bracket)
        }
    }

    impl Sealed for f64 {
        #[inline(always)]
        fn sharpen<const CAP: usize>(_: &[f64; CAP], _: usize, _: f64, _: f64, _: bool, bracket: [f64; 3]) -> [f64; 3] {
            bracket
        }
    }
}

/// `f32` or `f64`: what polynomial code needs of a number, with IEEE 754 rounding and no contraction into fused operations
/// (so that scalar and SIMD forms, and all machines, agree bit for bit).
pub trait Real:
    sealed::Sealed
    + Copy
    + Default
    + Debug
    + Display
    + PartialEq
    + PartialOrd
    + Send
    + Sync
    + 'static
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
    + MulAssign
{
    /// 0.
    const ZERO: Self;
    /// 1.
    const ONE: Self;
    /// 1/2.
    const HALF: Self;
    /// Unit roundoff u: half the distance from 1 to the next number (2^-24, 2^-53).
    const ROUNDOFF: Self;
    /// Smallest positive normal number.
    const TINY: Self;
    /// Coefficients up to here cannot overflow in the solver (2^90, 2^960); larger ones are scaled first.
    const LARGE: Self;
    /// Polynomials whose largest coefficient is below are scaled up first, so that underflow stays far below rounding (2^-60, 2^-500).
    const SMALL: Self;
    /// The step of that scaling, an exact power of two (2^64).
    const SCALE: Self;

    /// The nearest number to `x`.
    fn from_f64(x: f64) -> Self;
    /// The same number as f64, exact.
    fn to_f64(self) -> f64;
    /// Absolute value.
    #[must_use]
    fn abs(self) -> Self;
    /// Whether neither infinite nor NaN.
    fn is_finite(self) -> bool;
    /// 1 for numbers with the sign bit set (-0 too), else 0.
    fn sign_bit(self) -> u32;
    /// The next number above.
    #[must_use]
    fn above(self) -> Self;
    /// The next number below.
    #[must_use]
    fn below(self) -> Self;
    /// `2^-k` for `k <= 100`.
    fn half_power(k: u32) -> Self;
    /// Row n of Pascal's triangle, n <= [`MAX_DEGREE`]: `binomials(n)[i] = n! / (i! (n-i)!)`, all exact in both types.
    fn binomials(n: usize) -> &'static [Self; MAX_DEGREE + 1];

    /// The larger; `o` where a NaN is involved.
    #[inline(always)]
    #[must_use]
    fn larger(self, o: Self) -> Self {
        if self > o { self } else { o }
    }

    /// The smaller; `o` where a NaN is involved.
    #[inline(always)]
    #[must_use]
    fn smaller(self, o: Self) -> Self {
        if self < o { self } else { o }
    }
}

/// Pascal's triangle to [`MAX_DEGREE`]. The largest entry, 20058300 = 4 * 5014575, is exact in f32 as well.
const PASCAL: [[u32; MAX_DEGREE + 1]; MAX_DEGREE + 1] = {
    let mut p = [[0; MAX_DEGREE + 1]; MAX_DEGREE + 1];
    let mut n = 0;
    while n <= MAX_DEGREE {
        p[n][0] = 1;
        let mut i = 1;
        while i <= n {
            p[n][i] = p[n - 1][i - 1] + p[n - 1][i];
            i += 1;
        }
        n += 1;
    }
    p
};

macro_rules! real {
    ($t:ident, $sign_shift:literal, $large:expr, $small:expr, $scale:expr) => {
        impl Real for $t {
            const ZERO: Self = 0.0;
            const ONE: Self = 1.0;
            const HALF: Self = 0.5;
            const ROUNDOFF: Self = $t::EPSILON / 2.0;
            const TINY: Self = $t::MIN_POSITIVE;
            const LARGE: Self = $large;
            const SMALL: Self = $small;
            const SCALE: Self = $scale;

            #[inline(always)]
            fn from_f64(x: f64) -> Self {
                x as $t
            }
            #[inline(always)]
            fn to_f64(self) -> f64 {
                f64::from(self)
            }
            #[inline(always)]
            fn abs(self) -> Self {
                $t::abs(self)
            }
            #[inline(always)]
            fn is_finite(self) -> bool {
                $t::is_finite(self)
            }
            #[inline(always)]
            fn sign_bit(self) -> u32 {
                (self.to_bits() >> $sign_shift) as u32
            }
            #[inline(always)]
            fn above(self) -> Self {
                self.next_up()
            }
            #[inline(always)]
            fn below(self) -> Self {
                self.next_down()
            }
            #[inline(always)]
            fn half_power(k: u32) -> Self {
                const POWERS: [$t; 101] = {
                    let mut p = [1.0; 101];
                    let mut k = 1;
                    while k < 101 {
                        p[k] = p[k - 1] * 0.5;
                        k += 1;
                    }
                    p
                };
                POWERS[k as usize]
            }
            #[inline(always)]
            fn binomials(n: usize) -> &'static [Self; MAX_DEGREE + 1] {
                static TABLE: [[$t; MAX_DEGREE + 1]; MAX_DEGREE + 1] = {
                    let mut p = [[0.0; MAX_DEGREE + 1]; MAX_DEGREE + 1];
                    let mut n = 0;
                    while n <= MAX_DEGREE {
                        let mut i = 0;
                        while i <= n {
                            p[n][i] = PASCAL[n][i] as $t;
                            i += 1;
                        }
                        n += 1;
                    }
                    p
                };
                &TABLE[n]
            }
        }
    };
}

/// `2^k` as f64, for the constants below.
const fn two_to(k: i32) -> f64 {
    f64::from_bits(((1023 + k) as u64) << 52)
}

real!(f32, 31, two_to(90) as f32, two_to(-60) as f32, two_to(64) as f32);
real!(f64, 63, two_to(960), two_to(-500), two_to(64));

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn binomials_are_exact_in_both_types() {
        for n in 0..=MAX_DEGREE {
            for i in 0..=n {
                let exact = (0..i).fold(1u128, |p, k| p * (n - k) as u128 / (k as u128 + 1));
                assert_eq!(f64::binomials(n)[i] as u128, exact, "{n} {i}");
                assert_eq!(f64::from(f32::binomials(n)[i]), f64::binomials(n)[i], "{n} {i}");
            }
        }
    }

    #[test]
    fn half_powers() {
        assert_eq!(f32::half_power(0), 1.0);
        assert_eq!(f32::half_power(100), 2f32.powi(-100));
        assert_eq!(f64::half_power(53), 2f64.powi(-53));
    }
}
