//! Sixteen f32 lanes: plain arrays, AVX2, AVX-512, behind one private trait.
//!
//! Arrays left to the compiler's vectoriser were tried first: 51 to 97 ns per polynomial in the bench `solvers`, depending on how a
//! blend happened to be written, against 20 ns with these types (AVX-512). No fused operations: all three give the same bits.

use crate::Real;

/// Number of lanes.
pub const LANES: usize = 16;

/// Sixteen numbers. Comparisons with NaN are false; `larger` and `smaller` are those of [`Real`].
///
/// The types of AVX2 and AVX-512 may only be used inside functions compiled for those features; they are private to the
/// crate and `packet` keeps that rule.
pub(crate) trait Wide: Copy {
    /// One truth value per lane.
    type Mask: Copy;

    fn splat(x: f32) -> Self;
    fn load(x: &[f32; LANES]) -> Self;
    fn store(self) -> [f32; LANES];
    fn add(self, o: Self) -> Self;
    fn sub(self, o: Self) -> Self;
    fn mul(self, o: Self) -> Self;
    fn div(self, o: Self) -> Self;
    fn larger(self, o: Self) -> Self;
    fn smaller(self, o: Self) -> Self;
    fn abs(self) -> Self;
    /// Bitwise, on the numbers' representations.
    fn xor(self, o: Self) -> Self;
    fn and(self, o: Self) -> Self;
    fn or(self, o: Self) -> Self;
    /// self > o.
    fn above(self, o: Self) -> Self::Mask;
    /// self <= o.
    fn up_to(self, o: Self) -> Self::Mask;
    /// self == o.
    fn equals(self, o: Self) -> Self::Mask;
    /// Lanes whose sign bit is set.
    fn negative(self) -> Self::Mask;
    /// `self` where the mask is set, else `o`.
    fn where_or(self, m: Self::Mask, o: Self) -> Self;

    fn none() -> Self::Mask;
    fn both(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    fn either(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// `a` without `b`.
    fn without(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    fn any(m: Self::Mask) -> bool;
    /// Bit per lane.
    fn bits(m: Self::Mask) -> u16;
}

/// For any processor.
#[derive(Clone, Copy)]
pub(crate) struct Plain([f32; LANES]);

impl Plain {
    #[inline(always)]
    fn map(self, o: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        let mut out = self.0;
        for (x, y) in out.iter_mut().zip(o.0) {
            *x = f(*x, y);
        }
        Self(out)
    }

    #[inline(always)]
    fn test(self, o: Self, f: impl Fn(f32, f32) -> bool) -> [u32; LANES] {
        let mut out = [0; LANES];
        for (m, (a, b)) in out.iter_mut().zip(self.0.into_iter().zip(o.0)) {
            *m = 0u32.wrapping_sub(u32::from(f(a, b)));
        }
        out
    }

    #[inline(always)]
    fn join(mut a: [u32; LANES], b: [u32; LANES], f: impl Fn(u32, u32) -> u32) -> [u32; LANES] {
        for (x, y) in a.iter_mut().zip(b) {
            *x = f(*x, y);
        }
        a
    }
}

impl Wide for Plain {
    type Mask = [u32; LANES];

    #[inline(always)]
    fn splat(x: f32) -> Self {
        Self([x; LANES])
    }
    #[inline(always)]
    fn load(x: &[f32; LANES]) -> Self {
        Self(*x)
    }
    #[inline(always)]
    fn store(self) -> [f32; LANES] {
        self.0
    }
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        self.map(o, |a, b| a + b)
    }
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        self.map(o, |a, b| a - b)
    }
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        self.map(o, |a, b| a * b)
    }
    #[inline(always)]
    fn div(self, o: Self) -> Self {
        self.map(o, |a, b| a / b)
    }
    #[inline(always)]
    fn larger(self, o: Self) -> Self {
        self.map(o, Real::larger)
    }
    #[inline(always)]
    fn smaller(self, o: Self) -> Self {
        self.map(o, Real::smaller)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.map(self, |a, _| a.abs())
    }
    #[inline(always)]
    fn xor(self, o: Self) -> Self {
        self.map(o, |a, b| f32::from_bits(a.to_bits() ^ b.to_bits()))
    }
    #[inline(always)]
    fn and(self, o: Self) -> Self {
        self.map(o, |a, b| f32::from_bits(a.to_bits() & b.to_bits()))
    }
    #[inline(always)]
    fn or(self, o: Self) -> Self {
        self.map(o, |a, b| f32::from_bits(a.to_bits() | b.to_bits()))
    }
    #[inline(always)]
    fn above(self, o: Self) -> Self::Mask {
        self.test(o, |a, b| a > b)
    }
    #[inline(always)]
    fn up_to(self, o: Self) -> Self::Mask {
        self.test(o, |a, b| a <= b)
    }
    #[inline(always)]
    fn equals(self, o: Self) -> Self::Mask {
        self.test(o, |a, b| a == b)
    }
    #[inline(always)]
    fn negative(self) -> Self::Mask {
        self.test(self, |a, _| a.to_bits() >> 31 != 0)
    }
    #[inline(always)]
    fn where_or(self, m: Self::Mask, o: Self) -> Self {
        let mut out = o.0;
        for l in 0..LANES {
            out[l] = f32::from_bits((self.0[l].to_bits() & m[l]) | (o.0[l].to_bits() & !m[l]));
        }
        Self(out)
    }
    #[inline(always)]
    fn none() -> Self::Mask {
        [0; LANES]
    }
    #[inline(always)]
    fn both(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        Self::join(a, b, |a, b| a & b)
    }
    #[inline(always)]
    fn either(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        Self::join(a, b, |a, b| a | b)
    }
    #[inline(always)]
    fn without(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        Self::join(a, b, |a, b| a & !b)
    }
    #[inline(always)]
    fn any(m: Self::Mask) -> bool {
        m.iter().fold(0, |all, x| all | x) != 0
    }
    #[inline(always)]
    fn bits(m: Self::Mask) -> u16 {
        m.iter().enumerate().fold(0, |all, (l, x)| all | (((x & 1) as u16) << l))
    }
}

#[cfg(target_arch = "x86_64")]
pub(crate) use x86::{Avx2, Avx512};

#[cfg(target_arch = "x86_64")]
#[expect(unsafe_code, reason = "vector instructions of the processor; see the rule at `Wide`")]
mod x86 {
    use super::{LANES, Wide};
    use std::arch::x86_64::*;

    /// An intrinsic, called under the rule at [`Wide`].
    macro_rules! op {
        ($e:expr) => {
            // SAFETY: only used in functions compiled for, and called after detection of, the feature (the rule at `Wide`);
            // memory operands are references to arrays of the right size, and no alignment is assumed.
            unsafe { $e }
        };
    }

    /// Two registers of eight.
    #[derive(Clone, Copy)]
    pub(crate) struct Avx2(__m256, __m256);

    impl Wide for Avx2 {
        type Mask = Self;

        #[inline(always)]
        fn splat(x: f32) -> Self {
            op!(Self(_mm256_set1_ps(x), _mm256_set1_ps(x)))
        }
        #[inline(always)]
        fn load(x: &[f32; LANES]) -> Self {
            op!(Self(_mm256_loadu_ps(x.as_ptr()), _mm256_loadu_ps(x.as_ptr().add(8))))
        }
        #[inline(always)]
        fn store(self) -> [f32; LANES] {
            let mut out = [0.0; LANES];
            op!({
                _mm256_storeu_ps(out.as_mut_ptr(), self.0);
                _mm256_storeu_ps(out.as_mut_ptr().add(8), self.1);
            });
            out
        }
        #[inline(always)]
        fn add(self, o: Self) -> Self {
            op!(Self(_mm256_add_ps(self.0, o.0), _mm256_add_ps(self.1, o.1)))
        }
        #[inline(always)]
        fn sub(self, o: Self) -> Self {
            op!(Self(_mm256_sub_ps(self.0, o.0), _mm256_sub_ps(self.1, o.1)))
        }
        #[inline(always)]
        fn mul(self, o: Self) -> Self {
            op!(Self(_mm256_mul_ps(self.0, o.0), _mm256_mul_ps(self.1, o.1)))
        }
        #[inline(always)]
        fn div(self, o: Self) -> Self {
            op!(Self(_mm256_div_ps(self.0, o.0), _mm256_div_ps(self.1, o.1)))
        }
        #[inline(always)]
        fn larger(self, o: Self) -> Self {
            op!(Self(_mm256_max_ps(self.0, o.0), _mm256_max_ps(self.1, o.1)))
        }
        #[inline(always)]
        fn smaller(self, o: Self) -> Self {
            op!(Self(_mm256_min_ps(self.0, o.0), _mm256_min_ps(self.1, o.1)))
        }
        #[inline(always)]
        fn abs(self) -> Self {
            let sign = Self::splat(-0.0);
            op!(Self(_mm256_andnot_ps(sign.0, self.0), _mm256_andnot_ps(sign.1, self.1)))
        }
        #[inline(always)]
        fn xor(self, o: Self) -> Self {
            op!(Self(_mm256_xor_ps(self.0, o.0), _mm256_xor_ps(self.1, o.1)))
        }
        #[inline(always)]
        fn and(self, o: Self) -> Self {
            op!(Self(_mm256_and_ps(self.0, o.0), _mm256_and_ps(self.1, o.1)))
        }
        #[inline(always)]
        fn or(self, o: Self) -> Self {
            op!(Self(_mm256_or_ps(self.0, o.0), _mm256_or_ps(self.1, o.1)))
        }
        #[inline(always)]
        fn above(self, o: Self) -> Self {
            op!(Self(
                _mm256_cmp_ps::<_CMP_GT_OQ>(self.0, o.0),
                _mm256_cmp_ps::<_CMP_GT_OQ>(self.1, o.1)
            ))
        }
        #[inline(always)]
        fn up_to(self, o: Self) -> Self {
            op!(Self(
                _mm256_cmp_ps::<_CMP_LE_OQ>(self.0, o.0),
                _mm256_cmp_ps::<_CMP_LE_OQ>(self.1, o.1)
            ))
        }
        #[inline(always)]
        fn equals(self, o: Self) -> Self {
            op!(Self(
                _mm256_cmp_ps::<_CMP_EQ_OQ>(self.0, o.0),
                _mm256_cmp_ps::<_CMP_EQ_OQ>(self.1, o.1)
            ))
        }
        #[inline(always)]
        fn negative(self) -> Self {
            op!(Self(
                _mm256_castsi256_ps(_mm256_srai_epi32::<31>(_mm256_castps_si256(self.0))),
                _mm256_castsi256_ps(_mm256_srai_epi32::<31>(_mm256_castps_si256(self.1))),
            ))
        }
        #[inline(always)]
        fn where_or(self, m: Self, o: Self) -> Self {
            op!(Self(_mm256_blendv_ps(o.0, self.0, m.0), _mm256_blendv_ps(o.1, self.1, m.1)))
        }
        #[inline(always)]
        fn none() -> Self {
            Self::splat(0.0)
        }
        #[inline(always)]
        fn both(a: Self, b: Self) -> Self {
            a.and(b)
        }
        #[inline(always)]
        fn either(a: Self, b: Self) -> Self {
            a.or(b)
        }
        #[inline(always)]
        fn without(a: Self, b: Self) -> Self {
            op!(Self(_mm256_andnot_ps(b.0, a.0), _mm256_andnot_ps(b.1, a.1)))
        }
        #[inline(always)]
        fn any(m: Self) -> bool {
            op!(_mm256_movemask_ps(_mm256_or_ps(m.0, m.1)) != 0)
        }
        #[inline(always)]
        fn bits(m: Self) -> u16 {
            op!((_mm256_movemask_ps(m.0) | (_mm256_movemask_ps(m.1) << 8)) as u16)
        }
    }

    /// One register of sixteen (AVX-512 F and DQ).
    #[derive(Clone, Copy)]
    pub(crate) struct Avx512(__m512);

    impl Wide for Avx512 {
        type Mask = u16;

        #[inline(always)]
        fn splat(x: f32) -> Self {
            op!(Self(_mm512_set1_ps(x)))
        }
        #[inline(always)]
        fn load(x: &[f32; LANES]) -> Self {
            op!(Self(_mm512_loadu_ps(x.as_ptr())))
        }
        #[inline(always)]
        fn store(self) -> [f32; LANES] {
            let mut out = [0.0; LANES];
            op!(_mm512_storeu_ps(out.as_mut_ptr(), self.0));
            out
        }
        #[inline(always)]
        fn add(self, o: Self) -> Self {
            op!(Self(_mm512_add_ps(self.0, o.0)))
        }
        #[inline(always)]
        fn sub(self, o: Self) -> Self {
            op!(Self(_mm512_sub_ps(self.0, o.0)))
        }
        #[inline(always)]
        fn mul(self, o: Self) -> Self {
            op!(Self(_mm512_mul_ps(self.0, o.0)))
        }
        #[inline(always)]
        fn div(self, o: Self) -> Self {
            op!(Self(_mm512_div_ps(self.0, o.0)))
        }
        #[inline(always)]
        fn larger(self, o: Self) -> Self {
            op!(Self(_mm512_max_ps(self.0, o.0)))
        }
        #[inline(always)]
        fn smaller(self, o: Self) -> Self {
            op!(Self(_mm512_min_ps(self.0, o.0)))
        }
        #[inline(always)]
        fn abs(self) -> Self {
            op!(Self(_mm512_andnot_ps(_mm512_set1_ps(-0.0), self.0)))
        }
        #[inline(always)]
        fn xor(self, o: Self) -> Self {
            op!(Self(_mm512_xor_ps(self.0, o.0)))
        }
        #[inline(always)]
        fn and(self, o: Self) -> Self {
            op!(Self(_mm512_and_ps(self.0, o.0)))
        }
        #[inline(always)]
        fn or(self, o: Self) -> Self {
            op!(Self(_mm512_or_ps(self.0, o.0)))
        }
        #[inline(always)]
        fn above(self, o: Self) -> u16 {
            op!(_mm512_cmp_ps_mask::<_CMP_GT_OQ>(self.0, o.0))
        }
        #[inline(always)]
        fn up_to(self, o: Self) -> u16 {
            op!(_mm512_cmp_ps_mask::<_CMP_LE_OQ>(self.0, o.0))
        }
        #[inline(always)]
        fn equals(self, o: Self) -> u16 {
            op!(_mm512_cmp_ps_mask::<_CMP_EQ_OQ>(self.0, o.0))
        }
        #[inline(always)]
        fn negative(self) -> u16 {
            op!(_mm512_movepi32_mask(_mm512_castps_si512(self.0)))
        }
        #[inline(always)]
        fn where_or(self, m: u16, o: Self) -> Self {
            op!(Self(_mm512_mask_blend_ps(m, o.0, self.0)))
        }
        #[inline(always)]
        fn none() -> u16 {
            0
        }
        #[inline(always)]
        fn both(a: u16, b: u16) -> u16 {
            a & b
        }
        #[inline(always)]
        fn either(a: u16, b: u16) -> u16 {
            a | b
        }
        #[inline(always)]
        fn without(a: u16, b: u16) -> u16 {
            a & !b
        }
        #[inline(always)]
        fn any(m: u16) -> bool {
            m != 0
        }
        #[inline(always)]
        fn bits(m: u16) -> u16 {
            m
        }
    }
}
