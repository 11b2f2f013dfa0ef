//! Sixteen f32 lanes: plain arrays, AVX2, AVX-512, behind one private trait.
//!
//! Arrays left to the compiler's vectoriser were tried first: 51 to 97 ns per polynomial in the bench `solvers`, depending on how a
//! blend happened to be written, against 20 ns with these types (AVX-512). No fused operations: all three give the same bits.

use crate::Real;

/// Number of lanes.
pub const LANES: usize = 16;

/// Sixteen numbers. Comparisons with NaN are false; `larger` and `smaller` are those of [`Real`].
///
/// The types of AVX2 and AVX-512 may only be used inside functions compiled for those features; they are private to the
/// crate and `packet` keeps that rule.
pub(crate) trait Wide: Copy {
    /// One truth value per lane.
    type Mask: Copy;
    /// Half of the lanes in f64.
    type Double: Double;

    fn splat(x: f32) -> Self;
    fn load(x: &[f32; LANES]) -> Self;
    fn store(self) -> [f32; LANES];
    fn add(self, o: Self) -> Self;
    fn sub(self, o: Self) -> Self;
    fn mul(self, o: Self) -> Self;
    fn div(self, o: Self) -> Self;
    fn larger(self, o: Self) -> Self;
    fn smaller(self, o: Self) -> Self;
    fn abs(self) -> Self;
    /// Bitwise, on the numbers' representations.
    fn xor(self, o: Self) -> Self;
    fn and(self, o: Self) -> Self;
    fn or(self, o: Self) -> Self;
    /// self > o.
    fn above(self, o: Self) -> Self::Mask;
    /// self <= o.
    fn up_to(self, o: Self) -> Self::Mask;
    /// self == o.
    fn equals(self, o: Self) -> Self::Mask;
    /// Lanes whose sign bit is set.
    fn negative(self) -> Self::Mask;
    /// `self` where the mask is set, else `o`.
    fn where_or(self, m: Self::Mask, o: Self) -> Self;

    fn none() -> Self::Mask;
    fn both(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    fn either(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// `a` without `b`.
    fn without(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    fn any(m: Self::Mask) -> bool;
    /// Bit per lane.
    fn bits(m: Self::Mask) -> u16;
    /// Lanes 0 to 7 and 8 to 15.
    fn widen(self) -> [Self::Double; 2];
    /// The nearest f32 numbers.
    fn narrow(x: [Self::Double; 2]) -> Self;
}

/// Eight f64 numbers.
pub(crate) trait Double: Copy {
    fn splat(x: f64) -> Self;
    fn add(self, o: Self) -> Self;
    fn sub(self, o: Self) -> Self;
    fn mul(self, o: Self) -> Self;
    fn div(self, o: Self) -> Self;
    /// self > o, a bit per lane.
    fn above(self, o: Self) -> u8;
}

/// For any processor.
#[derive(Clone, Copy)]
pub(crate) struct Plain([f32; LANES]);

// In builds for tests the operations on arrays are calls: inlined a thousand times over, and then joined to vectors, they take minutes to compile.
impl Plain {
    #[cfg_attr(debug_assertions, inline(never))]
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn map(self, o: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        let mut out = self.0;
        for (x, y) in out.iter_mut().zip(o.0) {
            *x = f(*x, y);
        }
        Self(out)
    }

    #[cfg_attr(debug_assertions, inline(never))]
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn test(self, o: Self, f: impl Fn(f32, f32) -> bool) -> [u32; LANES] {
        let mut out = [0; LANES];
        for (m, (a, b)) in out.iter_mut().zip(self.0.into_iter().zip(o.0)) {
            *m = 0u32.wrapping_sub(u32::from(f(a, b)));
        }
        out
    }

    #[cfg_attr(debug_assertions, inline(never))]
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn join(mut a: [u32; LANES], b: [u32; LANES], f: impl Fn(u32, u32) -> u32) -> [u32; LANES] {
        for (x, y) in a.iter_mut().zip(b) {
            *x = f(*x, y);
        }
        a
    }
}

/// For any processor.
#[derive(Clone, Copy)]
pub(crate) struct PlainDouble([f64; LANES / 2]);

impl PlainDouble {
    #[cfg_attr(debug_assertions, inline(never))]
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn map(mut self, o: Self, f: impl Fn(f64, f64) -> f64) -> Self {
        for (x, y) in self.0.iter_mut().zip(o.0) {
            *x = f(*x, y);
        }
        self
    }
}

impl Double for PlainDouble {
    #[inline(always)]
    fn splat(x: f64) -> Self {
        Self([x; LANES / 2])
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
    fn above(self, o: Self) -> u8 {
        let mut m = 0;
        for l in 0..LANES / 2 {
            m |= u8::from(self.0[l] > o.0[l]) << l;
        }
        m
    }
}

impl Wide for Plain {
    type Mask = [u32; LANES];
    type Double = PlainDouble;

    #[cfg_attr(debug_assertions, inline(never))]
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn widen(self) -> [PlainDouble; 2] {
        let mut out = [[0.0; LANES / 2]; 2];
        for (l, x) in self.0.into_iter().enumerate() {
            out[l / 8][l % 8] = f64::from(x);
        }
        out.map(PlainDouble)
    }
    #[cfg_attr(debug_assertions, inline(never))]
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn narrow(x: [PlainDouble; 2]) -> Self {
        let mut out = [0.0; LANES];
        for (l, to) in out.iter_mut().enumerate() {
            *to = x[l / 8].0[l % 8] as f32;
        }
        Self(out)
    }

    #[inline(always)]
    fn splat(x: f32) -> Self {
        Self([x; LANES])
    }
    #[inline(always)]
    fn load(x: &[f32; LANES]) -> Self {
        Self(*x)
    }
    #[inline(always)]
    fn store(self) -> [f32; LANES] {
        self.0
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
    fn larger(self, o: Self) -> Self {
        self.map(o, Real::larger)
    }
    #[inline(always)]
    fn smaller(self, o: Self) -> Self {
        self.map(o, Real::smaller)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.map(self, |a, _| a.abs())
    }
    #[inline(always)]
    fn xor(self, o: Self) -> Self {
        self.map(o, |a, b| f32::from_bits(a.to_bits() ^ b.to_bits()))
    }
    #[inline(always)]
    fn and(self, o: Self) -> Self {
        self.map(o, |a, b| f32::from_bits(a.to_bits() & b.to_bits()))
    }
    #[inline(always)]
    fn or(self, o: Self) -> Self {
        self.map(o, |a, b| f32::from_bits(a.to_bits() | b.to_bits()))
    }
    #[cfg_attr(debug_assertions, inline(never))]
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn above(self, o: Self) -> Self::Mask {
        self.test(o, |a, b| a > b)
    }
    #[inline(always)]
    fn up_to(self, o: Self) -> Self::Mask {
        self.test(o, |a, b| a <= b)
    }
    #[inline(always)]
    fn equals(self, o: Self) -> Self::Mask {
        self.test(o, |a, b| a == b)
    }
    #[inline(always)]
    fn negative(self) -> Self::Mask {
        self.test(self, |a, _| a.to_bits() >> 31 != 0)
    }
    #[cfg_attr(debug_assertions, inline(never))]
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn where_or(self, m: Self::Mask, o: Self) -> Self {
        let mut out = o.0;
        for l in 0..LANES {
            out[l] = f32::from_bits((self.0[l].to_bits() & m[l]) | (o.0[l].to_bits() & !m[l]));
        }
        Self(out)
    }
    #[inline(always)]
    fn none() -> Self::Mask {
        [0; LANES]
    }
    #[inline(always)]
    fn both(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        Self::join(a, b, |a, b| a & b)
    }
    #[inline(always)]
    fn either(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        Self::join(a, b, |a, b| a | b)
    }
    #[inline(always)]
    fn without(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        Self::join(a, b, |a, b| a & !b)
    }
    #[cfg_attr(debug_assertions, inline(never))]
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn any(m: Self::Mask) -> bool {
        m.iter().fold(0, |all, x| all | x) != 0
    }
    #[cfg_attr(debug_assertions, inline(never))]
    #[cfg_attr(not(debug_assertions), inline(always))]
    fn bits(m: Self::Mask) -> u16 {
        m.iter().enumerate().fold(0, |all, (l, x)| all | (((x & 1) as u16) << l))
    }
}

#[cfg(target_arch = "x86_64")]
pub(crate) use x86::{Avx2, Avx512};

#[cfg(target_arch = "x86_64")]
#[expect(unsafe_code, reason = "vector instructions of the processor; see the rule at `Wide`")]
mod x86;
