//! Eight f64 lanes: plain arrays, AVX2, AVX-512, behind one trait.
//!
//! No fused operations and the same rule for least and greatest, so all three give the same bits. Masks are bytes, bit l for lane l.
//!
//! Kernels are generic in [`Lanes`] and get their lanes from [`run`], which compiles them for each instruction set and calls the one that the machine has. The types
//! of AVX2 and AVX-512 have no names outside this module, so nothing else can call their instructions.

#[cfg(target_arch = "x86_64")]
mod x86;

use crate::{Kernel, Level};
use std::fmt::Debug;
use std::marker::PhantomData;

/// Rays of a block.
pub const LANES: usize = 8;

/// Bits of a byte as bytes: 255 in byte l where bit l is set.
pub static SPREAD: [u64; 256] = {
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
pub trait Lanes: Copy + Debug {
    /// Eight small whole numbers.
    type Index: Copy;
    /// The instruction set they are made for.
    const LEVEL: Level;
    /// Whole numbers from bytes, that of lane 0 lowest.
    fn index(bytes: u64) -> Self::Index;
    /// i + j.
    fn plus(i: Self::Index, j: Self::Index) -> Self::Index;
    /// i - j.
    fn minus(i: Self::Index, j: Self::Index) -> Self::Index;
    /// Entries i (modulo 32).
    fn lookup(table: &[i32; 32], i: Self::Index) -> Self::Index;
    /// Entries i (modulo N, a power of two).
    fn gather<const N: usize>(table: &[f64; N], i: Self::Index) -> Self;
    /// Lanes whose bit is set; all are below 32.
    fn are_in(set: u32, i: Self::Index) -> u8;
    /// The lanes of a mask, moved together; what is behind them means nothing.
    #[must_use]
    fn pack(self, m: u8) -> Self;
    /// The bytes of a mask, moved together.
    fn pack_bytes(bytes: u64, m: u8) -> u64;
    /// x in all lanes.
    fn splat(x: f64) -> Self;
    /// Lane l from entry l.
    fn load(x: &[f64; LANES]) -> Self;
    /// Lane l to entry l.
    fn store(self, to: &mut [f64; LANES]);
    /// self + o.
    #[must_use]
    fn add(self, o: Self) -> Self;
    /// self - o.
    #[must_use]
    fn sub(self, o: Self) -> Self;
    /// self * o.
    #[must_use]
    fn mul(self, o: Self) -> Self;
    /// self / o.
    #[must_use]
    fn div(self, o: Self) -> Self;
    /// `self` where it is greater, else `o`.
    #[must_use]
    fn max(self, o: Self) -> Self;
    /// `self` where it is smaller, else `o`.
    #[must_use]
    fn min(self, o: Self) -> Self;
    /// |self|.
    #[must_use]
    fn abs(self) -> Self;
    /// The square root.
    #[must_use]
    fn sqrt(self) -> Self;
    /// self > o.
    fn above(self, o: Self) -> u8;
    /// `self` where the mask is set, else `o`.
    #[must_use]
    fn where_or(self, m: u8, o: Self) -> Self;

    /// Stores the lanes of the mask together; what is written behind them means nothing.
    #[inline(always)]
    fn store_packed(self, m: u8, to: &mut [f64; LANES]) {
        self.pack(m).store(to);
    }

    /// Stores the lanes of the mask and leaves the others.
    #[inline(always)]
    fn store_where(self, m: u8, to: &mut [f64; LANES]) {
        self.where_or(m, Self::load(to)).store(to);
    }

    /// p + x (q - p), with the difference given.
    #[inline(always)]
    #[must_use]
    fn along(self, x: Self, difference: Self) -> Self {
        self.add(x.mul(difference))
    }
}

/// Work done in lanes, compiled once per instruction set.
pub trait WithLanes {
    /// What it gives.
    type Output;
    /// Does the work. Mark it, and all it calls that is to use the lanes' instructions, `#[inline(always)]`.
    fn run<S: Lanes>(self) -> Self::Output;
}

/// A kernel with its lanes.
struct With<S, K>(K, PhantomData<S>);

impl<S: Lanes, K: WithLanes> Kernel for With<S, K> {
    type Output = K::Output;

    #[inline(always)]
    fn run(self) -> K::Output {
        self.0.run::<S>()
    }
}

/// Runs a kernel in the lanes of `level`, or plain ones where the machine lacks it.
#[inline]
pub fn run<K: WithLanes>(level: Level, kernel: K) -> K::Output {
    #[cfg(target_arch = "x86_64")]
    match Level::best(level) {
        Level::Avx512 => return Level::run_avx512(With::<x86::Avx512, K>(kernel, PhantomData)),
        Level::Avx2 => return Level::run_avx2(With::<x86::Avx2, K>(kernel, PhantomData)),
        Level::Scalar => {}
    }
    let _ = level;
    With::<Plain, K>(kernel, PhantomData).run()
}

/// For any processor.
#[derive(Debug, Clone, Copy)]
pub struct Plain([f64; LANES]);

// In builds for tests the operations on arrays are calls: inlined a thousand times over, and then joined to vectors, they take minutes to compile.
impl Plain {
    #[cfg_attr(debug_assertions, inline(never))]
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn map(mut self, o: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        for (x, y) in self.0.iter_mut().zip(o.0) {
            *x = f(*x, y);
        }
        self
    }
}

impl Lanes for Plain {
    type Index = [i32; LANES];
    const LEVEL: Level = Level::Scalar;

    #[inline(always)]
    fn index(bytes: u64) -> Self::Index {
        bytes.to_le_bytes().map(i32::from)
    }
    #[cfg_attr(debug_assertions, inline(never))]
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn plus(mut i: Self::Index, j: Self::Index) -> Self::Index {
        for l in 0..LANES {
            i[l] += j[l];
        }
        i
    }
    #[cfg_attr(debug_assertions, inline(never))]
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn minus(mut i: Self::Index, j: Self::Index) -> Self::Index {
        for l in 0..LANES {
            i[l] -= j[l];
        }
        i
    }
    #[cfg_attr(debug_assertions, inline(never))]
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn lookup(table: &[i32; 32], i: Self::Index) -> Self::Index {
        i.map(|i| table[i as usize & 31])
    }
    #[cfg_attr(debug_assertions, inline(never))]
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn gather<const N: usize>(table: &[f64; N], i: Self::Index) -> Self {
        Self(i.map(|i| table[i as usize & (N - 1)]))
    }
    #[cfg_attr(debug_assertions, inline(never))]
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn are_in(set: u32, i: Self::Index) -> u8 {
        let mut m = 0;
        for (l, &i) in i.iter().enumerate() {
            m |= ((set >> (i & 31) & 1) as u8) << l;
        }
        m
    }
    #[cfg_attr(debug_assertions, inline(never))]
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn pack(self, m: u8) -> Self {
        let mut out = self;
        let mut n = 0;
        for l in 0..LANES {
            out.0[n] = self.0[l];
            n += usize::from(m >> l & 1);
        }
        out
    }
    #[cfg_attr(debug_assertions, inline(never))]
    #[cfg_attr(not(debug_assertions), inline(always))]
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
    fn sqrt(self) -> Self {
        self.map(self, |a, _| a.sqrt())
    }
    #[cfg_attr(debug_assertions, inline(never))]
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn above(self, o: Self) -> u8 {
        let mut m = 0;
        for l in 0..LANES {
            m |= u8::from(self.0[l] > o.0[l]) << l;
        }
        m
    }
    #[cfg_attr(debug_assertions, inline(never))]
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn where_or(mut self, m: u8, o: Self) -> Self {
        for l in 0..LANES {
            self.0[l] = if m >> l & 1 != 0 { self.0[l] } else { o.0[l] };
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
            a.store_packed(m, &mut packed);
            out.extend(packed[..n].iter().map(|x| if x.is_nan() { 1 } else { x.to_bits() }));
            let bytes = S::pack_bytes(bytes, m).to_le_bytes();
            out.extend(bytes[..n].iter().map(|&b| u64::from(b)));
        }
        out
    }

    struct All;
    impl WithLanes for All {
        type Output = (Level, Vec<u64>);
        #[inline(always)]
        fn run<S: Lanes>(self) -> Self::Output {
            (S::LEVEL, all::<S>())
        }
    }

    #[test]
    fn all_kinds_give_the_same_bits() {
        let want = all::<Plain>();
        for level in Level::ALL {
            assert_eq!(run(level, All), (Level::best(level), want.clone()), "{level}");
        }
    }
}
