//! AVX2 and AVX-512.

use super::{Double, LANES, Wide};
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

/// Two registers of four.
#[derive(Clone, Copy)]
pub(crate) struct Avx2Double(__m256d, __m256d);

impl Double for Avx2Double {
    #[inline(always)]
    fn splat(x: f64) -> Self {
        op!(Self(_mm256_set1_pd(x), _mm256_set1_pd(x)))
    }
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        op!(Self(_mm256_add_pd(self.0, o.0), _mm256_add_pd(self.1, o.1)))
    }
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        op!(Self(_mm256_sub_pd(self.0, o.0), _mm256_sub_pd(self.1, o.1)))
    }
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        op!(Self(_mm256_mul_pd(self.0, o.0), _mm256_mul_pd(self.1, o.1)))
    }
    #[inline(always)]
    fn div(self, o: Self) -> Self {
        op!(Self(_mm256_div_pd(self.0, o.0), _mm256_div_pd(self.1, o.1)))
    }
    #[inline(always)]
    fn above(self, o: Self) -> u8 {
        op!({
            let (a, b) = (
                _mm256_cmp_pd::<_CMP_GT_OQ>(self.0, o.0),
                _mm256_cmp_pd::<_CMP_GT_OQ>(self.1, o.1),
            );
            (_mm256_movemask_pd(a) | _mm256_movemask_pd(b) << 4) as u8
        })
    }
}

/// One register of eight.
#[derive(Clone, Copy)]
pub(crate) struct Avx512Double(__m512d);

impl Double for Avx512Double {
    #[inline(always)]
    fn splat(x: f64) -> Self {
        op!(Self(_mm512_set1_pd(x)))
    }
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        op!(Self(_mm512_add_pd(self.0, o.0)))
    }
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        op!(Self(_mm512_sub_pd(self.0, o.0)))
    }
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        op!(Self(_mm512_mul_pd(self.0, o.0)))
    }
    #[inline(always)]
    fn div(self, o: Self) -> Self {
        op!(Self(_mm512_div_pd(self.0, o.0)))
    }
    #[inline(always)]
    fn above(self, o: Self) -> u8 {
        op!(_mm512_cmp_pd_mask::<_CMP_GT_OQ>(self.0, o.0))
    }
}

impl Wide for Avx2 {
    type Mask = Self;
    type Double = Avx2Double;

    #[inline(always)]
    fn widen(self) -> [Avx2Double; 2] {
        let half = |x: __m256| {
            op!(Avx2Double(
                _mm256_cvtps_pd(_mm256_castps256_ps128(x)),
                _mm256_cvtps_pd(_mm256_extractf128_ps::<1>(x)),
            ))
        };
        [half(self.0), half(self.1)]
    }
    #[inline(always)]
    fn narrow([a, b]: [Avx2Double; 2]) -> Self {
        let half = |x: Avx2Double| op!(_mm256_set_m128(_mm256_cvtpd_ps(x.1), _mm256_cvtpd_ps(x.0)));
        Self(half(a), half(b))
    }

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
    type Double = Avx512Double;

    #[inline(always)]
    fn widen(self) -> [Avx512Double; 2] {
        op!([
            Avx512Double(_mm512_cvtps_pd(_mm512_castps512_ps256(self.0))),
            Avx512Double(_mm512_cvtps_pd(_mm512_extractf32x8_ps::<1>(self.0))),
        ])
    }
    #[inline(always)]
    fn narrow([a, b]: [Avx512Double; 2]) -> Self {
        op!(Self(_mm512_insertf32x8::<1>(
            _mm512_castps256_ps512(_mm512_cvtpd_ps(a.0)),
            _mm512_cvtpd_ps(b.0),
        )))
    }

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
