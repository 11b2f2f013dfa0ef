//! Eight or sixteen f32 or f64 lanes on plain arrays, AVX2 and AVX-512.
//!
//! Left to the compiler's vectoriser, arrays of this size cost several times as much (isobar-poly measured 51 to 97 ns against 20). f64 is never
//! fused, so that all levels give the same bits; f32 is fused on AVX-512, because it only sorts out cells in which a bound that holds either way
//! proves that there is no root.

use isobar_cpu::Kernel;
use std::fmt::Debug;

/// f32 or f64.
pub(crate) trait Real: Copy + Debug + PartialOrd + Send + Sync + 'static {
    fn of(x: f64) -> Self;
}
impl Real for f32 {
    #[inline(always)]
    fn of(x: f64) -> Self {
        x as Self
    }
}
impl Real for f64 {
    #[inline(always)]
    fn of(x: f64) -> Self {
        x
    }
}

/// One register.
///
/// The types of AVX2 and AVX-512 may only be used inside functions compiled for, and called after detection of, those features:
/// [`crate::smooth::draw`] keeps that rule.
pub(crate) trait Register: Copy {
    type Scalar: Real;
    const LANES: usize;
    fn splat(x: Self::Scalar) -> Self;
    /// The first lanes of `x`, which has at least as many.
    fn load(x: &[Self::Scalar]) -> Self;
    /// Into the first lanes of `to`.
    fn store(self, to: &mut [Self::Scalar]);
    fn add(self, o: Self) -> Self;
    fn sub(self, o: Self) -> Self;
    fn mul(self, o: Self) -> Self;
    /// `self * a + b`, fused or not.
    fn times_plus(self, a: Self, b: Self) -> Self;
    fn smaller(self, o: Self) -> Self;
    fn larger(self, o: Self) -> Self;
    /// Greatest lane; with NaN any.
    fn greatest(self) -> Self::Scalar;
    /// All lanes are above `x`; false with NaN.
    fn all_above(self, x: Self::Scalar) -> bool;
    /// All lanes are below `x`; false with NaN.
    fn all_below(self, x: Self::Scalar) -> bool;
}

/// A register of one lane, for any processor.
macro_rules! plain {
    ($t:ty) => {
        impl Register for $t {
            type Scalar = $t;
            const LANES: usize = 1;
            #[inline(always)]
            fn splat(x: $t) -> Self {
                x
            }
            #[inline(always)]
            fn load(x: &[$t]) -> Self {
                x[0]
            }
            #[inline(always)]
            fn store(self, to: &mut [$t]) {
                to[0] = self;
            }
            #[inline(always)]
            fn add(self, o: Self) -> Self {
                self + o
            }
            #[inline(always)]
            fn sub(self, o: Self) -> Self {
                self - o
            }
            #[inline(always)]
            fn mul(self, o: Self) -> Self {
                self * o
            }
            #[inline(always)]
            fn times_plus(self, a: Self, b: Self) -> Self {
                self * a + b
            }
            #[inline(always)]
            fn smaller(self, o: Self) -> Self {
                if self < o { self } else { o }
            }
            #[inline(always)]
            fn larger(self, o: Self) -> Self {
                if self > o { self } else { o }
            }
            #[inline(always)]
            fn greatest(self) -> $t {
                self
            }
            #[inline(always)]
            fn all_above(self, x: $t) -> bool {
                self > x
            }
            #[inline(always)]
            fn all_below(self, x: $t) -> bool {
                self < x
            }
        }
    };
}
plain!(f32);
plain!(f64);

/// `K` registers as one vector.
#[derive(Clone, Copy)]
pub(crate) struct Wide<R, const K: usize>([R; K]);

/// What the kernels compute with.
pub(crate) trait Vector: Register {}
impl<R: Register, const K: usize> Vector for Wide<R, K> {}

impl<R: Register, const K: usize> Wide<R, K> {
    #[inline(always)]
    fn zip(self, o: Self, f: impl Fn(R, R) -> R) -> Self {
        let mut out = self.0;
        for (x, y) in out.iter_mut().zip(o.0) {
            *x = f(*x, y);
        }
        Self(out)
    }
}

impl<R: Register, const K: usize> Register for Wide<R, K> {
    type Scalar = R::Scalar;
    const LANES: usize = R::LANES * K;
    #[inline(always)]
    fn splat(x: R::Scalar) -> Self {
        Self([R::splat(x); K])
    }
    #[inline(always)]
    fn load(x: &[R::Scalar]) -> Self {
        let x = &x[..Self::LANES];
        let mut out = [R::splat(x[0]); K];
        for (i, o) in out.iter_mut().enumerate() {
            *o = R::load(&x[i * R::LANES..]);
        }
        Self(out)
    }
    #[inline(always)]
    fn store(self, to: &mut [R::Scalar]) {
        let to = &mut to[..Self::LANES];
        for i in 0..K {
            self.0[i].store(&mut to[i * R::LANES..]);
        }
    }
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        self.zip(o, R::add)
    }
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        self.zip(o, R::sub)
    }
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        self.zip(o, R::mul)
    }
    #[inline(always)]
    fn times_plus(self, a: Self, b: Self) -> Self {
        let mut out = self.0;
        for ((x, a), b) in out.iter_mut().zip(a.0).zip(b.0) {
            *x = x.times_plus(a, b);
        }
        Self(out)
    }
    #[inline(always)]
    fn smaller(self, o: Self) -> Self {
        self.zip(o, R::smaller)
    }
    #[inline(always)]
    fn larger(self, o: Self) -> Self {
        self.zip(o, R::larger)
    }
    #[inline(always)]
    fn greatest(self) -> R::Scalar {
        let mut most = self.0[0];
        for i in 1..K {
            most = most.larger(self.0[i]);
        }
        most.greatest()
    }
    #[inline(always)]
    fn all_above(self, x: R::Scalar) -> bool {
        let mut all = true;
        for r in self.0 {
            all &= r.all_above(x);
        }
        all
    }
    #[inline(always)]
    fn all_below(self, x: R::Scalar) -> bool {
        let mut all = true;
        for r in self.0 {
            all &= r.all_below(x);
        }
        all
    }
}

/// A vector of one lane.
#[inline(always)]
pub(crate) fn one(x: f64) -> Wide<f64, 1> {
    Wide([x])
}

/// Its lane.
#[inline(always)]
pub(crate) fn only(x: Wide<f64, 1>) -> f64 {
    x.0[0]
}

/// The vectors of one instruction set.
pub(crate) trait Isa: Copy + Debug + Send + Sync + 'static {
    type Single8: Vector<Scalar = f32>;
    type Single16: Vector<Scalar = f32>;
    type Double8: Vector<Scalar = f64>;
    type Double16: Vector<Scalar = f64>;
    /// Runs a kernel with these vectors in it, compiled for their instruction set and no other.
    fn run<K: Kernel>(kernel: K) -> K::Output;
}

/// Any processor.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Portable;
impl Isa for Portable {
    type Single8 = Wide<f32, 8>;
    type Single16 = Wide<f32, 16>;
    type Double8 = Wide<f64, 8>;
    type Double16 = Wide<f64, 16>;
    #[inline]
    fn run<K: Kernel>(kernel: K) -> K::Output {
        kernel.run()
    }
}

#[cfg(target_arch = "x86_64")]
pub(crate) use x86::{Avx2, Avx512};

#[cfg(target_arch = "x86_64")]
#[expect(unsafe_code, reason = "vector instructions of the processor; see the rule at `Register`")]
mod x86 {
    use super::{Isa, Register, Wide};
    use isobar_cpu::{Kernel, Level};
    use std::arch::x86_64::*;

    /// An intrinsic, called under the rule at [`Register`].
    macro_rules! op {
        ($e:expr) => {
            // SAFETY: only used in functions compiled for, and called after detection of, the feature (the rule at `Register`);
            // memory operands are slices whose length is checked beside, and no alignment is assumed.
            unsafe { $e }
        };
    }

    macro_rules! register {
        ($name:ident, $reg:ty, $t:ty, $lanes:literal, $set1:ident, $load:ident, $store:ident, $add:ident, $sub:ident, $mul:ident,
         $min:ident, $max:ident, $m:ident => $greatest:expr, ($x:ident, $a:ident, $b:ident) => $fused:expr, ($l:ident, $r:ident) => $above:expr) => {
            #[derive(Clone, Copy)]
            pub(crate) struct $name($reg);
            impl Register for $name {
                type Scalar = $t;
                const LANES: usize = $lanes;
                #[inline(always)]
                fn splat(x: $t) -> Self {
                    op!(Self($set1(x)))
                }
                #[inline(always)]
                fn load(x: &[$t]) -> Self {
                    let x = &x[..$lanes];
                    op!(Self($load(x.as_ptr())))
                }
                #[inline(always)]
                fn store(self, to: &mut [$t]) {
                    let to = &mut to[..$lanes];
                    op!($store(to.as_mut_ptr(), self.0))
                }
                #[inline(always)]
                fn add(self, o: Self) -> Self {
                    op!(Self($add(self.0, o.0)))
                }
                #[inline(always)]
                fn sub(self, o: Self) -> Self {
                    op!(Self($sub(self.0, o.0)))
                }
                #[inline(always)]
                fn mul(self, o: Self) -> Self {
                    op!(Self($mul(self.0, o.0)))
                }
                #[inline(always)]
                fn times_plus(self, a: Self, b: Self) -> Self {
                    let ($x, $a, $b) = (self.0, a.0, b.0);
                    op!(Self($fused))
                }
                #[inline(always)]
                fn smaller(self, o: Self) -> Self {
                    op!(Self($min(self.0, o.0)))
                }
                #[inline(always)]
                fn larger(self, o: Self) -> Self {
                    op!(Self($max(self.0, o.0)))
                }
                #[inline(always)]
                fn greatest(self) -> $t {
                    let $m = self.0;
                    $greatest
                }
                #[inline(always)]
                fn all_above(self, x: $t) -> bool {
                    let ($l, $r) = (self.0, Self::splat(x).0);
                    op!($above)
                }
                #[inline(always)]
                fn all_below(self, x: $t) -> bool {
                    let ($r, $l) = (self.0, Self::splat(x).0);
                    op!($above)
                }
            }
        };
    }

    #[inline(always)]
    fn most(m: __m256) -> f32 {
        op!({
            let h = _mm_max_ps(_mm256_castps256_ps128(m), _mm256_extractf128_ps::<1>(m));
            let h = _mm_max_ps(h, _mm_movehl_ps(h, h));
            _mm_cvtss_f32(_mm_max_ss(h, _mm_movehdup_ps(h)))
        })
    }

    #[inline(always)]
    fn most_double(m: __m256d) -> f64 {
        op!({
            let h = _mm_max_pd(_mm256_castpd256_pd128(m), _mm256_extractf128_pd::<1>(m));
            _mm_cvtsd_f64(_mm_max_sd(h, _mm_unpackhi_pd(h, h)))
        })
    }

    register!(
        Single, __m256, f32, 8, _mm256_set1_ps, _mm256_loadu_ps, _mm256_storeu_ps, _mm256_add_ps, _mm256_sub_ps, _mm256_mul_ps,
        _mm256_min_ps, _mm256_max_ps, m => most(m),
        (x, a, b) => _mm256_add_ps(_mm256_mul_ps(x, a), b),
        (l, r) => _mm256_movemask_ps(_mm256_cmp_ps::<_CMP_GT_OQ>(l, r)) == 0xff
    );
    register!(
        Double, __m256d, f64, 4, _mm256_set1_pd, _mm256_loadu_pd, _mm256_storeu_pd, _mm256_add_pd, _mm256_sub_pd, _mm256_mul_pd,
        _mm256_min_pd, _mm256_max_pd, m => most_double(m),
        (x, a, b) => _mm256_add_pd(_mm256_mul_pd(x, a), b),
        (l, r) => _mm256_movemask_pd(_mm256_cmp_pd::<_CMP_GT_OQ>(l, r)) == 0xf
    );
    register!(
        Half512, __m256, f32, 8, _mm256_set1_ps, _mm256_loadu_ps, _mm256_storeu_ps, _mm256_add_ps, _mm256_sub_ps, _mm256_mul_ps,
        _mm256_min_ps, _mm256_max_ps, m => most(m),
        (x, a, b) => _mm256_fmadd_ps(x, a, b),
        (l, r) => _mm256_cmp_ps_mask::<_CMP_GT_OQ>(l, r) == 0xff
    );
    register!(
        Single512, __m512, f32, 16, _mm512_set1_ps, _mm512_loadu_ps, _mm512_storeu_ps, _mm512_add_ps, _mm512_sub_ps, _mm512_mul_ps,
        _mm512_min_ps, _mm512_max_ps, m => op!(_mm512_reduce_max_ps(m)),
        (x, a, b) => _mm512_fmadd_ps(x, a, b),
        (l, r) => _mm512_cmp_ps_mask::<_CMP_GT_OQ>(l, r) == 0xffff
    );
    register!(
        Double512, __m512d, f64, 8, _mm512_set1_pd, _mm512_loadu_pd, _mm512_storeu_pd, _mm512_add_pd, _mm512_sub_pd, _mm512_mul_pd,
        _mm512_min_pd, _mm512_max_pd, m => op!(_mm512_reduce_max_pd(m)),
        (x, a, b) => _mm512_add_pd(_mm512_mul_pd(x, a), b),
        (l, r) => _mm512_cmp_pd_mask::<_CMP_GT_OQ>(l, r) == 0xff
    );

    /// AVX2.
    #[derive(Debug, Clone, Copy)]
    pub(crate) struct Avx2;
    impl Isa for Avx2 {
        type Single8 = Wide<Single, 1>;
        type Single16 = Wide<Single, 2>;
        type Double8 = Wide<Double, 2>;
        type Double16 = Wide<Double, 4>;
        #[inline]
        fn run<K: Kernel>(kernel: K) -> K::Output {
            Level::run_avx2(kernel)
        }
    }

    /// AVX-512 F, VL and DQ.
    #[derive(Debug, Clone, Copy)]
    pub(crate) struct Avx512;
    impl Isa for Avx512 {
        type Single8 = Wide<Half512, 1>;
        type Single16 = Wide<Single512, 1>;
        type Double8 = Wide<Double512, 1>;
        type Double16 = Wide<Double512, 2>;
        #[inline]
        fn run<K: Kernel>(kernel: K) -> K::Output {
            Level::run_avx512(kernel)
        }
    }
}
