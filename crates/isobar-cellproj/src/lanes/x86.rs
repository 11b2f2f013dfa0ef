//! Eight f32 in a register of AVX2.
//!
//! **Rule.** This type is only used inside functions compiled for AVX2, and called after its detection: [`super::run`] alone names it.

#![expect(unsafe_code, reason = "SIMD intrinsics")]

use super::{Eight, LANES};
use crate::tables::Texel;
use std::arch::x86_64::*;

/// An intrinsic, called under the rule at the head of this file.
macro_rules! op {
    ($e:expr) => {
        // SAFETY: only used in functions compiled for, and called after detection of, the feature (the rule at the head of this file); memory
        // operands are references to arrays of the right size, and no alignment is assumed.
        unsafe { $e }
    };
}

/// Asks for what lies at an address.
#[inline(always)]
pub(super) fn prefetch(at: *const i8) {
    // SAFETY: every processor of the target has the instruction, and no address makes it fail.
    unsafe { _mm_prefetch::<_MM_HINT_T0>(at) }
}

#[derive(Debug, Clone, Copy)]
pub(super) struct Ymm(__m256);

impl Eight for Ymm {
    #[inline(always)]
    fn splat(x: f32) -> Self {
        Self(op!(_mm256_set1_ps(x)))
    }
    #[inline(always)]
    fn load(x: &[f32; LANES]) -> Self {
        Self(op!(_mm256_loadu_ps(x.as_ptr())))
    }
    #[inline(always)]
    fn store(self, to: &mut [f32; LANES]) {
        op!(_mm256_storeu_ps(to.as_mut_ptr(), self.0));
    }
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        Self(op!(_mm256_add_ps(self.0, o.0)))
    }
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        Self(op!(_mm256_sub_ps(self.0, o.0)))
    }
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        Self(op!(_mm256_mul_ps(self.0, o.0)))
    }
    #[inline(always)]
    fn div(self, o: Self) -> Self {
        Self(op!(_mm256_div_ps(self.0, o.0)))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self(op!(_mm256_andnot_ps(_mm256_set1_ps(-0.0), self.0)))
    }
    #[inline(always)]
    fn min(self, o: Self) -> Self {
        Self(op!(_mm256_min_ps(self.0, o.0)))
    }
    #[inline(always)]
    fn max(self, o: Self) -> Self {
        Self(op!(_mm256_max_ps(self.0, o.0)))
    }
    #[inline(always)]
    fn floor(self) -> Self {
        Self(op!(_mm256_floor_ps(self.0)))
    }
    #[inline(always)]
    fn ceil(self) -> Self {
        Self(op!(_mm256_ceil_ps(self.0)))
    }
    #[inline(always)]
    fn above(self, o: Self) -> u32 {
        op!(_mm256_movemask_ps(_mm256_cmp_ps::<_CMP_GT_OQ>(self.0, o.0))).cast_unsigned()
    }
    #[inline(always)]
    fn positive_or(self, a: Self, b: Self) -> Self {
        Self(op!({
            let positive = _mm256_cmp_ps::<_CMP_GT_OQ>(self.0, _mm256_setzero_ps());
            _mm256_blendv_ps(b.0, a.0, positive)
        }))
    }
    #[inline(always)]
    fn pick(self, index: &[u32; LANES]) -> Self {
        Self(op!(_mm256_permutevar8x32_ps(
            self.0,
            _mm256_loadu_si256(index.as_ptr().cast())
        )))
    }
    #[inline(always)]
    fn whole(self) -> [u32; LANES] {
        let mut to = [0; LANES];
        op!(_mm256_storeu_si256(to.as_mut_ptr().cast(), _mm256_cvttps_epi32(self.0)));
        to
    }
    #[inline(always)]
    fn between(texels: &[Texel], at: u32, n: usize, u: f32, v: f32) -> Texel {
        let at = at as usize;
        if at + n + 2 > texels.len() {
            return Texel::ZERO;
        }
        // SAFETY: as in `op`; texels are four f32 each, and those of index at to at + n + 1 are there.
        let t = unsafe {
            let first = texels.as_ptr().add(at).cast::<f32>();
            let rows = (_mm256_loadu_ps(first), _mm256_loadu_ps(first.add(4 * n)));
            let mixed = _mm256_add_ps(rows.0, _mm256_mul_ps(_mm256_sub_ps(rows.1, rows.0), _mm256_set1_ps(v)));
            let (a, b) = (_mm256_castps256_ps128(mixed), _mm256_extractf128_ps::<1>(mixed));
            _mm_add_ps(a, _mm_mul_ps(_mm_sub_ps(b, a), _mm_set1_ps(u)))
        };
        Texel::from(t)
    }
}
