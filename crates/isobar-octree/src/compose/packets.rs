//! The recommended compositions for sixteen rays at a time, f32, compiled for the processor's instruction set at run time.
//!
//! Least times for a tri-cubic cell, ns per ray, one core: single rays 37, arrays of sixteen lanes left to the compiler's vectoriser 20 to 28 at every
//! level, a loop over lanes around the scalar composition 50 to 60; with the registers' own types below 7.9 (AVX2) and 5.3 (AVX-512).

use super::{Lanes, Scalar, axis, axis_segment};
use isobar_cpu::{Kernel, Level};

/// Rays per packet.
pub const WIDTH: usize = 16;

/// Sixteen rays, each with its own cell.
#[derive(Debug, Clone, Copy)]
pub struct Packet<'a> {
    /// The (D + 1)^3 power coefficients, lane by lane.
    pub cells: &'a [Lanes<WIDTH>],
    /// x and y along the ray's axis z: `[x0, slope]`, `[y0, slope]`.
    pub rays: [[Lanes<WIDTH>; 2]; 2],
    /// The stretch `[t0, t1]` of z; not read by [`axis_packets`].
    pub stretch: [Lanes<WIDTH>; 2],
}

/// [`axis`] for packets: the same numbers, bit for bit, at every level. `out` holds 3 D + 1 per packet, one after another. The level is chosen
/// once per call: worth calling for many packets.
///
/// # Panics
/// As [`super::compose`], and if `out` does not hold 3 D + 1 per packet.
pub fn axis_packets<const D: usize>(level: Level, packets: &[Packet<'_>], out: &mut [Lanes<WIDTH>]) {
    run::<D, false>(level, packets, out);
}

/// [`axis_segment`] for packets; otherwise as [`axis_packets`].
///
/// # Panics
/// As [`axis_packets`].
pub fn axis_segment_packets<const D: usize>(level: Level, packets: &[Packet<'_>], out: &mut [Lanes<WIDTH>]) {
    run::<D, true>(level, packets, out);
}

fn run<const D: usize, const STRETCH: bool>(level: Level, packets: &[Packet<'_>], out: &mut [Lanes<WIDTH>]) {
    assert_eq!(
        out.len(),
        packets.len() * (3 * D + 1),
        "room for 3 D + 1 coefficients per packet"
    );
    // Features are detected before a type that needs them is used.
    match Level::best(level) {
        #[cfg(target_arch = "x86_64")]
        Level::Avx512 => Level::run_avx512(Work::<x86::Zmm, D, STRETCH>::new(packets, out)),
        #[cfg(target_arch = "x86_64")]
        Level::Avx2 => Level::run_avx2(Work::<x86::TwoYmm, D, STRETCH>::new(packets, out)),
        _ => Work::<Lanes<WIDTH>, D, STRETCH>::new(packets, out).run(),
    }
}

/// Sixteen lanes in registers.
trait Register: Scalar {
    fn load(x: &Lanes<WIDTH>) -> Self;
    fn store(self) -> Lanes<WIDTH>;
}

impl Register for Lanes<WIDTH> {
    #[inline(always)]
    fn load(x: &Lanes<WIDTH>) -> Self {
        *x
    }
    #[inline(always)]
    fn store(self) -> Lanes<WIDTH> {
        self
    }
}

struct Work<'a, R, const D: usize, const STRETCH: bool> {
    packets: &'a [Packet<'a>],
    out: &'a mut [Lanes<WIDTH>],
    registers: std::marker::PhantomData<R>,
}

impl<'a, R, const D: usize, const STRETCH: bool> Work<'a, R, D, STRETCH> {
    fn new(packets: &'a [Packet<'a>], out: &'a mut [Lanes<WIDTH>]) -> Self {
        Self {
            packets,
            out,
            registers: std::marker::PhantomData,
        }
    }
}

impl<R: Register, const D: usize, const STRETCH: bool> Kernel for Work<'_, R, D, STRETCH> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for (p, out) in self.packets.iter().zip(self.out.chunks_exact_mut(3 * D + 1)) {
            match D {
                1 => one::<R, D, STRETCH, 8, 4>(p, out),
                2 => one::<R, D, STRETCH, 27, 7>(p, out),
                _ => one::<R, D, STRETCH, 64, 10>(p, out),
            }
        }
    }
}

#[inline(always)]
fn one<R: Register, const D: usize, const STRETCH: bool, const N: usize, const M: usize>(
    p: &Packet<'_>,
    out: &mut [Lanes<WIDTH>],
) {
    assert!(p.cells.len() == N, "(D + 1)^3 coefficients per packet");
    let (mut f, mut a) = ([R::ZERO; N], [R::ZERO; M]);
    for (f, c) in f.iter_mut().zip(p.cells) {
        *f = R::load(c);
    }
    let [x, y] = p.rays;
    let r = [[R::load(&x[0]), R::load(&x[1])], [R::load(&y[0]), R::load(&y[1])]];
    if STRETCH {
        let stretch = [R::load(&p.stretch[0]), R::load(&p.stretch[1])];
        axis_segment::<R, D>(&f, &r, stretch, &mut a);
    } else {
        axis::<R, D>(&f, &r, &mut a);
    }
    for (out, a) in out.iter_mut().zip(a) {
        *out = a.store();
    }
}

/// Registers of x86. Used by [`run`] alone, inside kernels compiled for their features and started after these were detected.
#[cfg(target_arch = "x86_64")]
mod x86 {
    use super::{Lanes, Register, Scalar, WIDTH};
    use std::arch::x86_64::{
        __m256, __m512, _mm256_add_ps, _mm256_loadu_ps, _mm256_mul_ps, _mm256_storeu_ps, _mm256_sub_ps, _mm512_add_ps,
        _mm512_loadu_ps, _mm512_mul_ps, _mm512_storeu_ps, _mm512_sub_ps,
    };
    use std::mem::transmute;
    use std::ops::{Add, Mul, Sub};

    #[derive(Clone, Copy)]
    pub(super) struct Zmm(__m512);

    #[derive(Clone, Copy)]
    pub(super) struct TwoYmm([__m256; 2]);

    macro_rules! operators {
        ($($trait:ident $method:ident $zmm:ident $ymm:ident;)*) => {
            $(impl $trait for Zmm {
                type Output = Self;
                #[inline(always)]
                #[expect(unsafe_code, reason = "an instruction of AVX-512 F")]
                fn $method(self, o: Self) -> Self {
                    // SAFETY: only used after detection, see the module.
                    Self(unsafe { $zmm(self.0, o.0) })
                }
            }

            impl $trait for TwoYmm {
                type Output = Self;
                #[inline(always)]
                #[expect(unsafe_code, reason = "an instruction of AVX")]
                fn $method(self, o: Self) -> Self {
                    // SAFETY: only used after detection, see the module.
                    Self(unsafe { [$ymm(self.0[0], o.0[0]), $ymm(self.0[1], o.0[1])] })
                }
            })*
        };
    }

    operators! {
        Add add _mm512_add_ps _mm256_add_ps;
        Sub sub _mm512_sub_ps _mm256_sub_ps;
        Mul mul _mm512_mul_ps _mm256_mul_ps;
    }

    #[expect(unsafe_code, reason = "constants of register types")]
    impl Scalar for Zmm {
        // SAFETY: both are sixteen f32.
        const ZERO: Self = Self(unsafe { transmute::<[f32; WIDTH], __m512>([0.0; WIDTH]) });
        // SAFETY: as above.
        const ONE: Self = Self(unsafe { transmute::<[f32; WIDTH], __m512>([1.0; WIDTH]) });
    }

    #[expect(unsafe_code, reason = "constants of register types")]
    impl Scalar for TwoYmm {
        // SAFETY: both are twice eight f32.
        const ZERO: Self = Self(unsafe { transmute::<[f32; WIDTH], [__m256; 2]>([0.0; WIDTH]) });
        // SAFETY: as above.
        const ONE: Self = Self(unsafe { transmute::<[f32; WIDTH], [__m256; 2]>([1.0; WIDTH]) });
    }

    #[expect(unsafe_code, reason = "loads and stores of registers")]
    impl Register for Zmm {
        #[inline(always)]
        fn load(x: &Lanes<WIDTH>) -> Self {
            // SAFETY: sixteen f32 are read from sixteen; only used after detection.
            Self(unsafe { _mm512_loadu_ps(x.0.as_ptr()) })
        }
        #[inline(always)]
        fn store(self) -> Lanes<WIDTH> {
            let mut out = Lanes::splat(0.0);
            // SAFETY: sixteen f32 are written onto sixteen; only used after detection.
            unsafe { _mm512_storeu_ps(out.0.as_mut_ptr(), self.0) };
            out
        }
    }

    #[expect(unsafe_code, reason = "loads and stores of registers")]
    impl Register for TwoYmm {
        #[inline(always)]
        fn load(x: &Lanes<WIDTH>) -> Self {
            let (halves, _) = x.0.as_chunks::<8>();
            // SAFETY: eight f32 are read from eight, twice; only used after detection.
            Self(unsafe { [_mm256_loadu_ps(halves[0].as_ptr()), _mm256_loadu_ps(halves[1].as_ptr())] })
        }
        #[inline(always)]
        fn store(self) -> Lanes<WIDTH> {
            let mut out = Lanes::splat(0.0);
            let (halves, _) = out.0.as_chunks_mut::<8>();
            // SAFETY: eight f32 are written onto eight, twice; only used after detection.
            unsafe {
                _mm256_storeu_ps(halves[0].as_mut_ptr(), self.0[0]);
                _mm256_storeu_ps(halves[1].as_mut_ptr(), self.0[1]);
            }
            out
        }
    }
}
