//! Eight f32 side by side: an array, or a register of AVX2.
//!
//! No fused operations and the same rule for least and greatest, so both give the same bits. Left to the compiler, the loops over a run's pixels stayed in pieces of
//! registers (1.31 us a cell on Marschner-Lobb 64^3); written out they are whole ones.

#[cfg(target_arch = "x86_64")]
mod x86;

use crate::tables::Texel;
use isobar_cpu::{Kernel, Level};

/// Pixels of a run.
pub(crate) const LANES: usize = 8;

/// Eight numbers.
pub(crate) trait Eight: Copy {
    fn splat(x: f32) -> Self;
    fn load(x: &[f32; LANES]) -> Self;
    fn store(self, to: &mut [f32; LANES]);
    fn add(self, o: Self) -> Self;
    fn sub(self, o: Self) -> Self;
    fn mul(self, o: Self) -> Self;
    fn div(self, o: Self) -> Self;
    fn abs(self) -> Self;
    /// `self` where it is smaller, else `o`; so `o` where `self` is NaN.
    fn min(self, o: Self) -> Self;
    /// `self` where it is greater, else `o`; so `o` where `self` is NaN.
    fn max(self, o: Self) -> Self;
    /// The whole number below.
    fn floor(self) -> Self;
    /// The whole number above.
    fn ceil(self) -> Self;
    /// Lanes in which `self` is greater, as bits.
    fn above(self, o: Self) -> u32;
    /// `a` where `self` is above 0, else `b`.
    fn positive_or(self, a: Self, b: Self) -> Self;
    /// Entry `index` (below 8) of each lane.
    fn pick(self, index: &[u32; LANES]) -> Self;
    /// The whole numbers towards 0 of numbers of at least 0 and below 2^31.
    fn whole(self) -> [u32; LANES];
    /// Between the texels `at`, `at + 1` by the share u and those n further by v; 0 where there are none.
    fn between(texels: &[Texel], at: u32, n: usize, u: f32, v: f32) -> Texel;
}

/// Asks for entry `i` to be brought near the processor, if there is one. Cells come in visibility order: without it some tenth of a frame waits for them.
#[inline(always)]
pub(crate) fn prefetch<T>(all: &[T], i: u32) {
    #[cfg(target_arch = "x86_64")]
    x86::prefetch(all.as_ptr().wrapping_add(i as usize).cast());
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (all, i);
}

/// Work done in lanes.
pub(crate) trait WithEight {
    type Output;
    /// Does the work. Mark it, and all it calls that is to use the lanes' instructions, `#[inline(always)]`.
    fn run<F: Eight>(self) -> Self::Output;
}

/// A kernel with its lanes.
struct With<F, K>(K, std::marker::PhantomData<F>);

impl<F: Eight, K: WithEight> Kernel for With<F, K> {
    type Output = K::Output;

    #[inline(always)]
    fn run(self) -> K::Output {
        self.0.run::<F>()
    }
}

/// Runs a kernel in the lanes of `level`. Those of AVX2 serve AVX-512 as well: runs are short, and 512-bit lanes took 15 % more time.
pub(crate) fn run<K: WithEight>(level: Level, kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    if Level::best(level) >= Level::Avx2 {
        return Level::run_avx2(With::<x86::Ymm, K>(kernel, std::marker::PhantomData));
    }
    let _ = level;
    kernel.run::<Plain>()
}

/// For any processor.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Plain([f32; LANES]);

impl Plain {
    #[inline(always)]
    fn with(mut self, o: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        for (x, y) in self.0.iter_mut().zip(o.0) {
            *x = f(*x, y);
        }
        self
    }
}

impl Eight for Plain {
    #[inline(always)]
    fn splat(x: f32) -> Self {
        Self([x; LANES])
    }
    #[inline(always)]
    fn load(x: &[f32; LANES]) -> Self {
        Self(*x)
    }
    #[inline(always)]
    fn store(self, to: &mut [f32; LANES]) {
        *to = self.0;
    }
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        self.with(o, |a, b| a + b)
    }
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        self.with(o, |a, b| a - b)
    }
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        self.with(o, |a, b| a * b)
    }
    #[inline(always)]
    fn div(self, o: Self) -> Self {
        self.with(o, |a, b| a / b)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.with(self, |a, _| a.abs())
    }
    #[inline(always)]
    fn min(self, o: Self) -> Self {
        self.with(o, |a, b| if a < b { a } else { b })
    }
    #[inline(always)]
    fn max(self, o: Self) -> Self {
        self.with(o, |a, b| if a > b { a } else { b })
    }
    #[inline(always)]
    fn floor(self) -> Self {
        self.with(self, |a, _| a.floor())
    }
    #[inline(always)]
    fn ceil(self) -> Self {
        self.with(self, |a, _| a.ceil())
    }
    #[inline(always)]
    fn above(self, o: Self) -> u32 {
        (0..LANES).fold(0, |m, i| m | u32::from(self.0[i] > o.0[i]) << i)
    }
    #[inline(always)]
    fn positive_or(self, a: Self, b: Self) -> Self {
        Self(std::array::from_fn(|i| if self.0[i] > 0.0 { a.0[i] } else { b.0[i] }))
    }
    #[inline(always)]
    fn pick(self, index: &[u32; LANES]) -> Self {
        Self(std::array::from_fn(|i| self.0[index[i] as usize % LANES]))
    }
    #[inline(always)]
    fn whole(self) -> [u32; LANES] {
        self.0.map(|x| x as u32)
    }
    #[inline(always)]
    fn between(texels: &[Texel], at: u32, n: usize, u: f32, v: f32) -> Texel {
        let at = at as usize;
        let Some(t) = texels.get(at..at + n + 2) else {
            return Texel::ZERO;
        };
        let (first, second) = (t[0] + (t[n] - t[0]) * v, t[1] + (t[n + 1] - t[1]) * v);
        first + (second - first) * u
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    struct All;
    impl WithEight for All {
        type Output = Vec<u32>;

        #[inline(always)]
        fn run<F: Eight>(self) -> Vec<u32> {
            const A: [f32; LANES] = [1.0, -2.5, 0.0, -0.0, f32::INFINITY, f32::NAN, 1e30, 3.75];
            const B: [f32; LANES] = [1.0, 7.25, -0.0, 0.0, 2.0, 5.0, -1e30, f32::NAN];
            let (a, b) = (F::load(&A), F::load(&B));
            let mut out = Vec::new();
            let many = [
                a.add(b),
                a.sub(b),
                a.mul(b),
                a.div(b),
                b.abs(),
                a.min(b),
                a.max(b),
                b.min(a),
                b.max(a),
                b.floor(),
                b.ceil(),
                a.positive_or(b, F::splat(0.5)),
                a.pick(&[7, 1, 1, 0, 3, 6, 2, 4]),
            ];
            for v in many {
                let mut x = [0.0; LANES];
                v.store(&mut x);
                // The sign of a NaN may differ.
                out.extend(x.map(|x| if x.is_nan() { 1 } else { x.to_bits() }));
            }
            out.extend([a.above(b), b.above(a)]);
            let few = F::load(&[0.0, 0.5, 1.0, 254.999, 16_777_215.0, 3.5, 7.25, 99.0]);
            out.extend(few.whole());
            let texels: Vec<Texel> = (0..12).map(|i| Texel::new(i as f32, 0.3, -(i as f32).sqrt(), 1.0)).collect();
            for (at, n) in [(0, 3), (5, 4), (6, 4), (7, 4), (u32::MAX, 3)] {
                let t = F::between(&texels, at, n, 0.3, 0.8);
                out.extend(t.to_array().map(f32::to_bits));
            }
            out
        }
    }

    #[test]
    fn both_kinds_give_the_same_bits() {
        let want = All.run::<Plain>();
        for level in Level::ALL {
            assert_eq!(run(level, All), want, "{level}");
        }
    }
}
