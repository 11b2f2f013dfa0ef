//! Two f64 at once: the part of SIMD every x86-64 processor has, without which a sample of a trilinear cell takes twice the
//! instructions. Elsewhere, and in tests, a plain array stands in; the bits are the same.

/// What a pair of f64 can do, element by element.
pub(crate) trait PairOps: Copy {
    fn new(a: f64, b: f64) -> Self;
    fn get(self) -> [f64; 2];
    fn add(self, o: Self) -> Self;
    fn sub(self, o: Self) -> Self;
    fn mul(self, o: Self) -> Self;
    /// `self < o ? self : o`: `o` where either is NaN.
    fn min(self, o: Self) -> Self;
    /// `self > o ? self : o`: `o` where either is NaN.
    fn max(self, o: Self) -> Self;
    /// Cut towards 0; the value must fit an i32.
    fn cut(self) -> [i32; 2];
    /// Two consecutive f32.
    fn of_f32(v: [f32; 2]) -> Self;
    /// Two integers.
    fn of_i32(v: [i32; 2]) -> Self;
    #[inline(always)]
    fn splat(x: f64) -> Self {
        Self::new(x, x)
    }
    /// `self + w (o - self)`.
    #[inline(always)]
    fn lerp(self, o: Self, w: Self) -> Self {
        self.add(w.mul(o.sub(self)))
    }
}

#[cfg(target_arch = "x86_64")]
mod sse2 {
    use super::PairOps;
    use std::arch::x86_64::{
        __m128d, _mm_add_pd, _mm_castsi128_ps, _mm_cvtepi32_pd, _mm_cvtps_pd, _mm_cvtsd_f64, _mm_cvtsi64_si128,
        _mm_cvtsi128_si64, _mm_cvttpd_epi32, _mm_max_pd, _mm_min_pd, _mm_mul_pd, _mm_set_pd, _mm_sub_pd, _mm_unpackhi_pd,
    };

    /// One SSE register.
    #[derive(Debug, Clone, Copy)]
    pub(crate) struct Pair(__m128d);

    /// Intrinsics of SSE2.
    macro_rules! always {
        ($e:expr) => {{
            #[expect(unsafe_code, reason = "intrinsics are unsafe to call without their feature")]
            // SAFETY: SSE2 is part of x86-64.
            unsafe {
                $e
            }
        }};
    }

    impl PairOps for Pair {
        #[inline(always)]
        fn new(a: f64, b: f64) -> Self {
            Self(always!(_mm_set_pd(b, a)))
        }
        #[inline(always)]
        fn get(self) -> [f64; 2] {
            always!([_mm_cvtsd_f64(self.0), _mm_cvtsd_f64(_mm_unpackhi_pd(self.0, self.0))])
        }
        #[inline(always)]
        fn add(self, o: Self) -> Self {
            Self(always!(_mm_add_pd(self.0, o.0)))
        }
        #[inline(always)]
        fn sub(self, o: Self) -> Self {
            Self(always!(_mm_sub_pd(self.0, o.0)))
        }
        #[inline(always)]
        fn mul(self, o: Self) -> Self {
            Self(always!(_mm_mul_pd(self.0, o.0)))
        }
        #[inline(always)]
        fn min(self, o: Self) -> Self {
            Self(always!(_mm_min_pd(self.0, o.0)))
        }
        #[inline(always)]
        fn max(self, o: Self) -> Self {
            Self(always!(_mm_max_pd(self.0, o.0)))
        }
        #[inline(always)]
        fn cut(self) -> [i32; 2] {
            let both = always!(_mm_cvtsi128_si64(_mm_cvttpd_epi32(self.0)));
            [both as i32, (both >> 32) as i32]
        }
        #[inline(always)]
        fn of_f32(v: [f32; 2]) -> Self {
            Self(always!(_mm_cvtps_pd(_mm_castsi128_ps(_mm_cvtsi64_si128(bytemuck::cast(v))))))
        }
        #[inline(always)]
        fn of_i32(v: [i32; 2]) -> Self {
            Self(always!(_mm_cvtepi32_pd(_mm_cvtsi64_si128(bytemuck::cast(v)))))
        }
    }
}

/// The portable form.
#[cfg(any(test, not(target_arch = "x86_64")))]
mod array {
    use super::PairOps;

    /// A plain array.
    #[derive(Debug, Clone, Copy)]
    pub(crate) struct Pair([f64; 2]);

    impl Pair {
        #[inline(always)]
        fn zip(self, o: Self, f: impl Fn(f64, f64) -> f64) -> Self {
            Self([f(self.0[0], o.0[0]), f(self.0[1], o.0[1])])
        }
    }

    impl PairOps for Pair {
        #[inline(always)]
        fn new(a: f64, b: f64) -> Self {
            Self([a, b])
        }
        #[inline(always)]
        fn get(self) -> [f64; 2] {
            self.0
        }
        #[inline(always)]
        fn add(self, o: Self) -> Self {
            self.zip(o, |a, b| a + b)
        }
        #[inline(always)]
        fn sub(self, o: Self) -> Self {
            self.zip(o, |a, b| a - b)
        }
        #[inline(always)]
        fn mul(self, o: Self) -> Self {
            self.zip(o, |a, b| a * b)
        }
        #[inline(always)]
        fn min(self, o: Self) -> Self {
            self.zip(o, |a, b| if a < b { a } else { b })
        }
        #[inline(always)]
        fn max(self, o: Self) -> Self {
            self.zip(o, |a, b| if a > b { a } else { b })
        }
        #[inline(always)]
        fn cut(self) -> [i32; 2] {
            self.0.map(|x| x as i32)
        }
        #[inline(always)]
        fn of_f32(v: [f32; 2]) -> Self {
            Self(v.map(f64::from))
        }
        #[inline(always)]
        fn of_i32(v: [i32; 2]) -> Self {
            Self(v.map(f64::from))
        }
    }
}

#[cfg(not(target_arch = "x86_64"))]
pub(crate) use array::Pair;
#[cfg(target_arch = "x86_64")]
pub(crate) use sse2::Pair;

#[cfg(test)]
mod tests {
    use super::*;

    fn all<P: PairOps>(a: [f64; 2], b: [f64; 2]) -> Vec<u64> {
        let (p, q) = (P::new(a[0], a[1]), P::new(b[0], b[1]));
        let results = [
            p.add(q),
            p.sub(q),
            p.mul(q),
            p.min(q),
            p.max(q),
            p.lerp(q, P::splat(0.3)),
            P::of_f32([a[0] as f32, b[1] as f32]),
            P::of_i32(p.max(P::splat(-1e9)).min(P::splat(1e9)).cut()),
        ];
        results
            .iter()
            .flat_map(|r| r.get())
            .map(|x| if x.is_nan() { u64::MAX } else { x.to_bits() })
            .collect()
    }

    #[test]
    fn the_two_forms_give_the_same_bits() {
        let values = [
            0.0,
            -0.0,
            1.5,
            -2.75,
            1e-310,
            1e30,
            f64::INFINITY,
            f64::NEG_INFINITY,
            f64::NAN,
            0.1,
        ];
        for a in values {
            for b in values {
                for c in [a * 0.7, 3.3] {
                    assert_eq!(all::<Pair>([a, b], [b, c]), all::<array::Pair>([a, b], [b, c]), "{a} {b} {c}");
                }
            }
        }
    }
}
