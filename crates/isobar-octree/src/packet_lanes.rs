//! Eight f64 lanes: plain arrays, AVX2, AVX-512, behind one private trait.
//!
//! No fused operations and the same rule for least and greatest, so all three give the same bits. Masks are bytes, bit l for lane l.
//!
//! **Rule.** The types of AVX2 and AVX-512 are only used inside functions compiled for these features; `packet.rs` keeps it.

/// Rays of a block.
pub(crate) const LANES: usize = 8;

/// Eight numbers. Comparisons with NaN are false.
pub(crate) trait Lanes: Copy {
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
    fn sqrt(self) -> Self;
    /// self > o.
    fn above(self, o: Self) -> u8;
    /// `self` where the mask is set, else `o`.
    fn where_or(self, m: u8, o: Self) -> Self;

    /// Stores the lanes of the mask and leaves the others.
    #[inline(always)]
    fn store_where(self, m: u8, to: &mut [f64; LANES]) {
        self.where_or(m, Self::load(to)).store(to);
    }

    /// p + x (q - p), with the difference given.
    #[inline(always)]
    fn along(self, x: Self, difference: Self) -> Self {
        self.add(x.mul(difference))
    }
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
    fn sqrt(self) -> Self {
        self.map(self, |a, _| a.sqrt())
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

    impl Lanes for Avx2 {
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
    #[derive(Clone, Copy)]
    pub(crate) struct Avx512(__m512d);

    impl Lanes for Avx512 {
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
        for v in [
            a.add(b),
            a.sub(b),
            a.mul(b),
            a.div(b),
            a.max(b),
            a.min(b),
            a.abs(),
            b.abs().sqrt(),
        ] {
            put(v);
        }
        put(a.where_or(0b1010_0110, b));
        put(a.along(b, S::splat(0.3)));
        let mut x = B;
        a.store_where(0b0101_1001, &mut x);
        put(S::load(&x));
        out.extend([a.above(b), b.above(a)].map(u64::from));
        out
    }

    #[cfg(target_arch = "x86_64")]
    #[expect(unsafe_code, reason = "functions with target features")]
    #[test]
    fn all_kinds_give_the_same_bits() {
        #[target_feature(enable = "avx2")]
        fn avx2() -> Vec<u64> {
            all::<Avx2>()
        }
        #[target_feature(enable = "avx512f,avx512dq")]
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
