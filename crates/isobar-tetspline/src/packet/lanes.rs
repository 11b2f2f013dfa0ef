//! Eight f64 lanes: plain arrays, AVX2, AVX-512, behind one private trait.
//!
//! No fused operations and the same rule for least and greatest, so all three give the same bits. Masks are bytes, bit l for lane l.
//!
//! **Rule.** The types of AVX2 and AVX-512 are only used inside functions compiled for these features; `mod.rs` keeps it.

/// Rays of a block.
pub(crate) const LANES: usize = 8;

/// Bits of a byte as bytes: 255 in byte l where bit l is set.
pub(crate) static SPREAD: [u64; 256] = {
    let mut t = [0; 256];
    let mut i = 0;
    while i < 256 {
        let mut l = 0;
        while l < 8 {
            if i >> l & 1 == 1 {
                t[i] |= 255 << (8 * l);
            }
            l += 1;
        }
        i += 1;
    }
    t
};

/// Eight numbers. Comparisons with NaN are false.
pub(crate) trait Lanes: Copy {
    /// Eight small whole numbers.
    type Index: Copy;
    /// From bytes, that of lane 0 lowest.
    fn index(bytes: u64) -> Self::Index;
    fn plus(i: Self::Index, j: Self::Index) -> Self::Index;
    fn minus(i: Self::Index, j: Self::Index) -> Self::Index;
    /// Entries i (modulo 32).
    fn lookup(table: &[i32; 32], i: Self::Index) -> Self::Index;
    /// Entries i (modulo N, a power of two).
    fn gather<const N: usize>(table: &[f64; N], i: Self::Index) -> Self;
    /// Lanes whose bit is set; all are below 32.
    fn are_in(set: u32, i: Self::Index) -> u8;
    /// The lanes of a mask, moved together; what is behind them means nothing.
    fn pack(self, m: u8) -> Self;
    /// The bytes of a mask, moved together.
    fn pack_bytes(bytes: u64, m: u8) -> u64;
    fn splat(x: f64) -> Self;
    fn load(x: &[f64; LANES]) -> Self;
    fn store(self, to: &mut [f64; LANES]);
    fn add(self, o: Self) -> Self;
    fn sub(self, o: Self) -> Self;
    fn mul(self, o: Self) -> Self;
    fn div(self, o: Self) -> Self;
    /// `self` where it is greater, else `o`.
    fn max(self, o: Self) -> Self;
    /// `self` where it is smaller, else `o`.
    fn min(self, o: Self) -> Self;
    fn abs(self) -> Self;
    /// self > o.
    fn above(self, o: Self) -> u8;
    /// `self` where the mask is set, else `o`.
    fn where_or(self, m: u8, o: Self) -> Self;
}

/// For any processor.
#[derive(Clone, Copy)]
pub(crate) struct Plain([f64; LANES]);

impl Plain {
    #[inline(always)]
    fn map(mut self, o: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        for (x, y) in self.0.iter_mut().zip(o.0) {
            *x = f(*x, y);
        }
        self
    }
}

impl Lanes for Plain {
    type Index = [i32; LANES];

    #[inline(always)]
    fn index(bytes: u64) -> Self::Index {
        bytes.to_le_bytes().map(i32::from)
    }
    #[inline(always)]
    fn plus(mut i: Self::Index, j: Self::Index) -> Self::Index {
        for l in 0..LANES {
            i[l] += j[l];
        }
        i
    }
    #[inline(always)]
    fn minus(mut i: Self::Index, j: Self::Index) -> Self::Index {
        for l in 0..LANES {
            i[l] -= j[l];
        }
        i
    }
    #[inline(always)]
    fn lookup(table: &[i32; 32], i: Self::Index) -> Self::Index {
        i.map(|i| table[i as usize & 31])
    }
    #[inline(always)]
    fn gather<const N: usize>(table: &[f64; N], i: Self::Index) -> Self {
        Self(i.map(|i| table[i as usize & (N - 1)]))
    }
    #[inline(always)]
    fn are_in(set: u32, i: Self::Index) -> u8 {
        let mut m = 0;
        for (l, &i) in i.iter().enumerate() {
            m |= ((set >> (i & 31) & 1) as u8) << l;
        }
        m
    }
    #[inline(always)]
    fn pack(self, m: u8) -> Self {
        let mut out = self;
        let mut n = 0;
        for l in 0..LANES {
            out.0[n] = self.0[l];
            n += usize::from(m >> l & 1);
        }
        out
    }
    #[inline(always)]
    fn pack_bytes(bytes: u64, m: u8) -> u64 {
        let (from, mut out, mut n) = (bytes.to_le_bytes(), [0; LANES], 0);
        for (l, &byte) in from.iter().enumerate() {
            out[n & 7] = byte;
            n += usize::from(m >> l & 1);
        }
        u64::from_le_bytes(out)
    }
    #[inline(always)]
    fn splat(x: f64) -> Self {
        Self([x; LANES])
    }
    #[inline(always)]
    fn load(x: &[f64; LANES]) -> Self {
        Self(*x)
    }
    #[inline(always)]
    fn store(self, to: &mut [f64; LANES]) {
        *to = self.0;
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
    fn max(self, o: Self) -> Self {
        self.map(o, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn min(self, o: Self) -> Self {
        self.map(o, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.map(self, |a, _| a.abs())
    }
    #[inline(always)]
    fn above(self, o: Self) -> u8 {
        let mut m = 0;
        for l in 0..LANES {
            m |= u8::from(self.0[l] > o.0[l]) << l;
        }
        m
    }
    #[inline(always)]
    fn where_or(mut self, m: u8, o: Self) -> Self {
        for l in 0..LANES {
            self.0[l] = if m >> l & 1 != 0 { self.0[l] } else { o.0[l] };
        }
        self
    }
}

#[cfg(target_arch = "x86_64")]
pub(crate) use x86::{Avx2, Avx512};

#[cfg(target_arch = "x86_64")]
#[expect(unsafe_code, reason = "SIMD intrinsics")]
mod x86 {
    use super::{LANES, Lanes};
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
    #[derive(Clone, Copy)]
    pub(crate) struct Avx2(__m256d, __m256d);

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
            self.store(&mut all);
            Self::load(&super::Plain(all).pack(m).0)
        }
        #[inline(always)]
        fn pack_bytes(bytes: u64, m: u8) -> u64 {
            op!(_pext_u64(bytes, super::SPREAD[usize::from(m)]))
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
    #[derive(Clone, Copy)]
    pub(crate) struct Avx512(__m512d);

    impl Lanes for Avx512 {
        type Index = __m256i;

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
        fn above(self, o: Self) -> u8 {
            op!(_mm512_cmp_pd_mask::<_CMP_GT_OQ>(self.0, o.0))
        }
        #[inline(always)]
        fn where_or(self, m: u8, o: Self) -> Self {
            op!(Self(_mm512_mask_blend_pd(m, o.0, self.0)))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use isobar_cpu::Level;

    const A: [f64; LANES] = [1.0, -2.5, 0.0, -0.0, f64::INFINITY, f64::NAN, 1e300, 3.0];
    const B: [f64; LANES] = [1.0, 7.25, -0.0, 0.0, 2.0, 5.0, -1e300, f64::NAN];

    /// All operations, as bits.
    #[inline(always)]
    fn all<S: Lanes>() -> Vec<u64> {
        let (a, b) = (S::load(&A), S::load(&B));
        let mut out = Vec::new();
        let mut put = |v: S| {
            let mut x = [0.0; LANES];
            v.store(&mut x);
            // The sign of a NaN may differ.
            out.extend(x.map(|x| if x.is_nan() { 1 } else { x.to_bits() }));
        };
        for v in [a.add(b), a.sub(b), a.mul(b), a.div(b), a.max(b), a.min(b), a.abs()] {
            put(v);
        }
        put(a.where_or(0b1010_0110, b));
        let table: [f64; 64] = std::array::from_fn(|i| i as f64 * 0.5);
        let numbers: [i32; 32] = std::array::from_fn(|i| 100 - 3 * i as i32);
        let bytes = 0x1f00_0307_1811_0a02;
        let i = S::index(bytes);
        put(S::gather(&table, i));
        put(S::gather(&table, S::minus(S::plus(i, i), S::lookup(&numbers, i))));
        out.extend([a.above(b), b.above(a), S::are_in(0x8101_048c, i)].map(u64::from));
        for m in [0u8, 255, 0b1000_0001, 0b0110_1010] {
            let n = m.count_ones() as usize;
            let mut packed = [0.0; LANES];
            a.pack(m).store(&mut packed);
            out.extend(packed[..n].iter().map(|x| if x.is_nan() { 1 } else { x.to_bits() }));
            let bytes = S::pack_bytes(bytes, m).to_le_bytes();
            out.extend(bytes[..n].iter().map(|&b| u64::from(b)));
        }
        out
    }

    #[cfg(target_arch = "x86_64")]
    #[expect(unsafe_code, reason = "functions with target features")]
    #[test]
    fn all_kinds_give_the_same_bits() {
        #[target_feature(enable = "avx2,bmi2")]
        fn avx2() -> Vec<u64> {
            all::<Avx2>()
        }
        #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx2,bmi2")]
        fn avx512() -> Vec<u64> {
            all::<Avx512>()
        }
        let want = all::<Plain>();
        if Level::Avx2.is_available() {
            // SAFETY: the feature was detected.
            assert_eq!(unsafe { avx2() }, want);
        }
        if Level::Avx512.is_available() {
            // SAFETY: the features were detected.
            assert_eq!(unsafe { avx512() }, want);
        }
    }
}
