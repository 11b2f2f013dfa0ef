//! Eight f64 lanes in the registers of x86-64.
//!
//! **Rule.** These types are only used inside functions compiled for their features, and called after detection of these: [`super::run`] alone names them.

#![expect(unsafe_code, reason = "SIMD intrinsics")]

use super::{LANES, Lanes, SPREAD};
use crate::Level;
use std::arch::x86_64::*;

/// An intrinsic, called under the rule at the head of this file.
macro_rules! op {
    ($e:expr) => {
        // SAFETY: only used in functions compiled for, and called after detection of, the feature (the rule at the head of this file);
        // memory operands are references to arrays of the right size, and no alignment is assumed.
        unsafe { $e }
    };
}

/// Two registers of four.
#[derive(Debug, Clone, Copy)]
pub(super) struct Avx2(__m256d, __m256d);

/// All bits of lane l set where bit l is.
static WIDE: [[u64; 4]; 16] = {
    let mut t = [[0; 4]; 16];
    let mut i = 0;
    while i < 64 {
        if (i / 4) >> (i % 4) & 1 == 1 {
            t[i / 4][i % 4] = u64::MAX;
        }
        i += 1;
    }
    t
};

/// Halves of the lanes of a mask, moved together.
static TOGETHER: [[i32; 8]; 16] = {
    let mut t = [[0; 8]; 16];
    let mut m = 0;
    while m < 16 {
        let (mut l, mut n) = (0, 0);
        while l < 4 {
            if m >> l & 1 == 1 {
                t[m][2 * n] = 2 * l;
                t[m][2 * n + 1] = 2 * l + 1;
                n += 1;
            }
            l += 1;
        }
        m += 1;
    }
    t
};

/// Entries of a table at indices modulo its size.
macro_rules! gathered {
    ($gather:ident, $table:expr, $i:expr, $n:expr) => {{
        const { assert!($n.is_power_of_two() && $n <= 1 << 20) };
        // SAFETY: as in `op`; the mask keeps every index inside the table.
        unsafe { $gather::<8>($table.as_ptr(), $i) }
    }};
}

impl Lanes for Avx2 {
    type Index = __m256i;
    const LEVEL: Level = Level::Avx2;

    #[inline(always)]
    fn index(bytes: u64) -> __m256i {
        op!(_mm256_cvtepu8_epi32(_mm_cvtsi64_si128(bytes.cast_signed())))
    }
    #[inline(always)]
    fn plus(i: __m256i, j: __m256i) -> __m256i {
        op!(_mm256_add_epi32(i, j))
    }
    #[inline(always)]
    fn minus(i: __m256i, j: __m256i) -> __m256i {
        op!(_mm256_sub_epi32(i, j))
    }
    #[inline(always)]
    fn lookup(table: &[i32; 32], i: __m256i) -> __m256i {
        // SAFETY: as in `op`; the mask keeps every index inside the table.
        unsafe { _mm256_i32gather_epi32::<4>(table.as_ptr(), _mm256_and_si256(i, _mm256_set1_epi32(31))) }
    }
    #[inline(always)]
    fn gather<const N: usize>(table: &[f64; N], i: __m256i) -> Self {
        let i = op!(_mm256_and_si256(i, _mm256_set1_epi32(N as i32 - 1)));
        let (low, high) = op!((_mm256_castsi256_si128(i), _mm256_extracti128_si256::<1>(i)));
        Self(
            gathered!(_mm256_i32gather_pd, table, low, N),
            gathered!(_mm256_i32gather_pd, table, high, N),
        )
    }
    #[inline(always)]
    fn are_in(set: u32, i: __m256i) -> u8 {
        op!({
            let at = _mm256_srlv_epi32(_mm256_set1_epi32(set.cast_signed()), i);
            _mm256_movemask_ps(_mm256_castsi256_ps(_mm256_slli_epi32::<31>(at))) as u8
        })
    }
    #[inline(always)]
    fn pack(self, m: u8) -> Self {
        let mut all = [0.0; LANES];
        self.store_packed(m, &mut all);
        Self::load(&all)
    }
    #[inline(always)]
    fn store_packed(self, m: u8, to: &mut [f64; LANES]) {
        let (low, high) = (&TOGETHER[usize::from(m & 15)], &TOGETHER[usize::from(m >> 4)]);
        let first = (m & 15).count_ones() as usize;
        op!({
            let (low, high) = (
                _mm256_loadu_si256(low.as_ptr().cast()),
                _mm256_loadu_si256(high.as_ptr().cast()),
            );
            let low = _mm256_castps_pd(_mm256_permutevar8x32_ps(_mm256_castpd_ps(self.0), low));
            let high = _mm256_castps_pd(_mm256_permutevar8x32_ps(_mm256_castpd_ps(self.1), high));
            // At most four before the upper ones: these end with the array.
            _mm256_storeu_pd(to.as_mut_ptr(), low);
            _mm256_storeu_pd(to.as_mut_ptr().add(first), high);
        });
    }
    #[inline(always)]
    fn pack_bytes(bytes: u64, m: u8) -> u64 {
        op!(_pext_u64(bytes, SPREAD[usize::from(m)]))
    }
    #[inline(always)]
    fn splat(x: f64) -> Self {
        op!(Self(_mm256_set1_pd(x), _mm256_set1_pd(x)))
    }
    #[inline(always)]
    fn load(x: &[f64; LANES]) -> Self {
        op!(Self(_mm256_loadu_pd(x.as_ptr()), _mm256_loadu_pd(x.as_ptr().add(4))))
    }
    #[inline(always)]
    fn store(self, to: &mut [f64; LANES]) {
        op!({
            _mm256_storeu_pd(to.as_mut_ptr(), self.0);
            _mm256_storeu_pd(to.as_mut_ptr().add(4), self.1);
        });
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
    fn max(self, o: Self) -> Self {
        op!(Self(_mm256_max_pd(self.0, o.0), _mm256_max_pd(self.1, o.1)))
    }
    #[inline(always)]
    fn min(self, o: Self) -> Self {
        op!(Self(_mm256_min_pd(self.0, o.0), _mm256_min_pd(self.1, o.1)))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        let sign = Self::splat(-0.0);
        op!(Self(_mm256_andnot_pd(sign.0, self.0), _mm256_andnot_pd(sign.1, self.1)))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        op!(Self(_mm256_sqrt_pd(self.0), _mm256_sqrt_pd(self.1)))
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
    #[inline(always)]
    fn where_or(self, m: u8, o: Self) -> Self {
        let (low, high) = (&WIDE[usize::from(m & 15)], &WIDE[usize::from(m >> 4)]);
        op!(Self(
            _mm256_blendv_pd(o.0, self.0, _mm256_loadu_pd(low.as_ptr().cast())),
            _mm256_blendv_pd(o.1, self.1, _mm256_loadu_pd(high.as_ptr().cast())),
        ))
    }
}

/// One register of eight (AVX-512 F and DQ).
#[derive(Debug, Clone, Copy)]
pub(super) struct Avx512(__m512d);

impl Lanes for Avx512 {
    type Index = __m256i;
    const LEVEL: Level = Level::Avx512;

    #[inline(always)]
    fn index(bytes: u64) -> __m256i {
        Avx2::index(bytes)
    }
    #[inline(always)]
    fn plus(i: __m256i, j: __m256i) -> __m256i {
        Avx2::plus(i, j)
    }
    #[inline(always)]
    fn minus(i: __m256i, j: __m256i) -> __m256i {
        Avx2::minus(i, j)
    }
    #[inline(always)]
    fn lookup(table: &[i32; 32], i: __m256i) -> __m256i {
        Avx2::lookup(table, i)
    }
    #[inline(always)]
    fn gather<const N: usize>(table: &[f64; N], i: __m256i) -> Self {
        let i = op!(_mm256_and_si256(i, _mm256_set1_epi32(N as i32 - 1)));
        const { assert!(N.is_power_of_two() && N <= 1 << 20) };
        // SAFETY: as in `op`; the mask keeps every index inside the table.
        Self(unsafe { _mm512_i32gather_pd::<8>(i, table.as_ptr()) })
    }
    #[inline(always)]
    fn are_in(set: u32, i: __m256i) -> u8 {
        Avx2::are_in(set, i)
    }
    #[inline(always)]
    fn pack(self, m: u8) -> Self {
        op!(Self(_mm512_maskz_compress_pd(m, self.0)))
    }
    #[inline(always)]
    fn pack_bytes(bytes: u64, m: u8) -> u64 {
        Avx2::pack_bytes(bytes, m)
    }
    #[inline(always)]
    fn splat(x: f64) -> Self {
        op!(Self(_mm512_set1_pd(x)))
    }
    #[inline(always)]
    fn load(x: &[f64; LANES]) -> Self {
        op!(Self(_mm512_loadu_pd(x.as_ptr())))
    }
    #[inline(always)]
    fn store(self, to: &mut [f64; LANES]) {
        op!(_mm512_storeu_pd(to.as_mut_ptr(), self.0));
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
    fn max(self, o: Self) -> Self {
        op!(Self(_mm512_max_pd(self.0, o.0)))
    }
    #[inline(always)]
    fn min(self, o: Self) -> Self {
        op!(Self(_mm512_min_pd(self.0, o.0)))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        op!(Self(_mm512_abs_pd(self.0)))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        op!(Self(_mm512_sqrt_pd(self.0)))
    }
    #[inline(always)]
    fn above(self, o: Self) -> u8 {
        op!(_mm512_cmp_pd_mask::<_CMP_GT_OQ>(self.0, o.0))
    }
    #[inline(always)]
    fn where_or(self, m: u8, o: Self) -> Self {
        op!(Self(_mm512_mask_blend_pd(m, o.0, self.0)))
    }
    #[inline(always)]
    fn store_where(self, m: u8, to: &mut [f64; LANES]) {
        op!(_mm512_mask_storeu_pd(to.as_mut_ptr(), m, self.0));
    }
}
