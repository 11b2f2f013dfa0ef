//! Numbers the compositions run on: f32, f64, sixteen rays side by side, and numbers that count.

use std::cell::Cell;
use std::ops::{Add, Mul, Sub};

/// What a composition needs of a number: a commutative ring. There is no division in any of them.
pub trait Scalar: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// 0.
    const ZERO: Self;
    /// 1.
    const ONE: Self;
}

macro_rules! scalar {
    ($($t:ty: $zero:expr, $one:expr;)*) => {
        $(impl Scalar for $t {
            const ZERO: Self = $zero;
            const ONE: Self = $one;
        })*
    };
}

scalar! {
    f32: 0.0, 1.0;
    f64: 0.0, 1.0;
}

/// Exact, while nothing exceeds 127 bits: what the tests compare with.
#[cfg(test)]
impl Scalar for i128 {
    const ZERO: Self = 0;
    const ONE: Self = 1;
}

/// One number for each of N rays, f32. The arithmetic is that of f32, lane by lane and never fused, so that results agree with the
/// scalar ones bit for bit.
#[derive(Debug, Clone, Copy, PartialEq)]
#[repr(align(64))]
pub struct Lanes<const N: usize>(pub [f32; N]);

impl<const N: usize> Lanes<N> {
    /// The same number in all lanes.
    #[inline(always)]
    #[must_use]
    pub const fn splat(x: f32) -> Self {
        Self([x; N])
    }
}

impl<const N: usize> Scalar for Lanes<N> {
    const ZERO: Self = Self::splat(0.0);
    const ONE: Self = Self::splat(1.0);
}

macro_rules! lanes {
    ($($trait:ident $method:ident $op:tt;)*) => {
        $(impl<const N: usize> $trait for Lanes<N> {
            type Output = Self;
            #[inline(always)]
            fn $method(mut self, o: Self) -> Self {
                for (x, y) in self.0.iter_mut().zip(o.0) {
                    *x $op y;
                }
                self
            }
        })*
    };
}

lanes! {
    Add add +=;
    Sub sub -=;
    Mul mul *=;
}

/// Multiplications and additions (with subtractions).
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Operations {
    /// Multiplications.
    pub multiplications: u64,
    /// Additions and subtractions.
    pub additions: u64,
}

impl Operations {
    /// Both together.
    #[must_use]
    pub const fn total(self) -> u64 {
        self.multiplications + self.additions
    }
}

thread_local! {
    static DONE: Cell<Operations> = const { Cell::new(Operations { multiplications: 0, additions: 0 }) };
}

/// A number whose arithmetic is counted, see [`count`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Counted<T>(pub T);

impl<T: Scalar> Scalar for Counted<T> {
    const ZERO: Self = Self(T::ZERO);
    const ONE: Self = Self(T::ONE);
}

fn done(multiplications: u64, additions: u64) {
    let before = DONE.get();
    DONE.set(Operations {
        multiplications: before.multiplications + multiplications,
        additions: before.additions + additions,
    });
}

macro_rules! counted {
    ($($trait:ident $method:ident $multiplications:literal $additions:literal;)*) => {
        $(impl<T: Scalar> $trait for Counted<T> {
            type Output = Self;
            // Inlined a thousand times it would take seconds to compile.
            #[inline(never)]
            fn $method(self, o: Self) -> Self {
                done($multiplications, $additions);
                Self(self.0.$method(o.0))
            }
        })*
    };
}

counted! {
    Add add 0 1;
    Sub sub 0 1;
    Mul mul 1 0;
}

/// The operations on [`Counted`] numbers that `work` does on this thread, calls inside calls included.
pub fn count(work: impl FnOnce()) -> Operations {
    let before = DONE.get();
    work();
    let after = DONE.get();
    Operations {
        multiplications: after.multiplications - before.multiplications,
        additions: after.additions - before.additions,
    }
}
