//! Compositions in scaled Bernstein form: SB0 to SB3 (thesis, equation 3.2).
//!
//! A polynomial of degree n is `sum s[i] t^i (1-t)^(n-i)`; products are convolutions (Sanchez-Reyes 2003). The ray's component `u = [u0, u1]` holds the
//! coordinate at t = 0 and t = 1, `q = 1 - u`. One sum is `sum_k b_k q^(d-k) u^k`, either by the thesis's recursion
//! `b_d u^d + q (b_(d-1) u^(d-1) + ... + q (b_1 u + b_0 q))` or with the products `q^(d-k) u^k` calculated before.

use super::{Scalar, at, check};

/// a b. All sizes are constants, so that everything stays in registers.
#[inline(always)]
fn multiply<T: Scalar, const A: usize, const B: usize, const M: usize>(a: [T; A], b: [T; B]) -> [T; M] {
    const { assert!(A > 0 && B > 0 && M + 1 == A + B) };
    let mut out = [T::ZERO; M];
    for i in 0..A {
        for j in 0..B {
            let product = a[i] * b[j];
            // The first term of a place is not added to anything.
            out[i + j] = if i == 0 || j + 1 == B { product } else { out[i + j] + product };
        }
    }
    out
}

#[inline(always)]
fn add<T: Scalar, const M: usize>(mut a: [T; M], b: [T; M]) -> [T; M] {
    for i in 0..M {
        a[i] = a[i] + b[i];
    }
    a
}

/// `sum_k c(k) q^(d-k) u^k` for one axis of a tri-linear f; the c(k) have N coefficients. Nothing can be calculated before.
#[derive(Clone, Copy)]
struct Linear<T> {
    q: [T; 2],
    u: [T; 2],
}

/// The same for a tri-quadratic f.
#[derive(Clone, Copy)]
struct Quadratic<T> {
    q: [T; 2],
    u: [T; 2],
    /// u^2 (recursion), or q^2, q u, u^2 (calculated before).
    powers: [[T; 3]; 3],
    before: bool,
}

/// The same for a tri-cubic f.
#[derive(Clone, Copy)]
struct Cubic<T> {
    q: [T; 2],
    u: [T; 2],
    u2: [T; 3],
    /// u^3 last (recursion), or q^3, q^2 u, q u^2, u^3 (calculated before).
    powers: [[T; 4]; 4],
    before: bool,
}

#[inline(always)]
fn complement<T: Scalar>(u: [T; 2]) -> [T; 2] {
    [T::ONE - u[0], T::ONE - u[1]]
}

impl<T: Scalar> Linear<T> {
    #[inline(always)]
    fn new(u: [T; 2]) -> Self {
        Self { q: complement(u), u }
    }

    #[inline(always)]
    fn sum<const N: usize, const M: usize>(&self, c: impl Fn(usize) -> [T; N]) -> [T; M] {
        add(multiply(c(0), self.q), multiply(c(1), self.u))
    }
}

impl<T: Scalar> Quadratic<T> {
    #[inline(always)]
    fn new(u: [T; 2], before: bool) -> Self {
        let (q, u2) = (complement(u), multiply(u, u));
        let powers = if before {
            [multiply(q, q), multiply(q, u), u2]
        } else {
            [u2; 3]
        };
        Self { q, u, powers, before }
    }

    #[inline(always)]
    fn sum<const N: usize, const N1: usize, const M: usize>(&self, c: impl Fn(usize) -> [T; N]) -> [T; M] {
        let p = &self.powers;
        if self.before {
            let a = add(multiply(c(0), p[0]), multiply(c(1), p[1]));
            return add(a, multiply(c(2), p[2]));
        }
        let a: [T; N1] = add(multiply(c(0), self.q), multiply(c(1), self.u));
        add(multiply(a, self.q), multiply(c(2), p[2]))
    }
}

impl<T: Scalar> Cubic<T> {
    #[inline(always)]
    fn new(u: [T; 2], before: bool) -> Self {
        let (q, u2): (_, [T; 3]) = (complement(u), multiply(u, u));
        let u3 = multiply(u2, u);
        let powers = if before {
            let q2: [T; 3] = multiply(q, q);
            [multiply(q2, q), multiply(q2, u), multiply(u2, q), u3]
        } else {
            [u3; 4]
        };
        Self {
            q,
            u,
            u2,
            powers,
            before,
        }
    }

    #[inline(always)]
    fn sum<const N: usize, const N1: usize, const N2: usize, const M: usize>(&self, c: impl Fn(usize) -> [T; N]) -> [T; M] {
        let p = &self.powers;
        if self.before {
            let a = add(multiply(c(0), p[0]), multiply(c(1), p[1]));
            let a = add(a, multiply(c(2), p[2]));
            return add(a, multiply(c(3), p[3]));
        }
        let a: [T; N1] = add(multiply(c(0), self.q), multiply(c(1), self.u));
        let a: [T; N2] = add(multiply(a, self.q), multiply(c(2), self.u2));
        add(multiply(a, self.q), multiply(c(3), p[3]))
    }
}

/// SB0 to SB3: the products `q^(d-k) u^k` are calculated before for the P innermost of the three sums.
///
/// Counted for D = 3: SB0 741 multiplications and 483 additions, exactly the thesis's Table 3.1; SB1 683 and 490 (printed 687 and 490); SB2 697
/// and 533. What the table prints for SB2, 720 and 558, is exactly the count of P = 3.
///
/// # Panics
/// As [`super::compose`].
#[inline(always)]
pub fn sb<T: Scalar, const D: usize, const P: usize>(b: &[T], u: &[[T; 2]; 3], out: &mut [T]) {
    check::<D>(b.len(), out.len());
    let c = |i, j, k| [b[at::<D>(i, j, k)]];
    match D {
        1 => {
            let [x, y, z] = u.map(Linear::new);
            let plane = |i| y.sum::<2, 3>(|j| z.sum::<1, 2>(|k| c(i, j, k)));
            out.copy_from_slice(&x.sum::<3, 4>(plane));
        }
        2 => {
            let axis = |a: usize| Quadratic::new(u[a], P + a >= 3);
            let (x, y, z) = (axis(0), axis(1), axis(2));
            let plane = |i| y.sum::<3, 4, 5>(|j| z.sum::<1, 2, 3>(|k| c(i, j, k)));
            out.copy_from_slice(&x.sum::<5, 6, 7>(plane));
        }
        _ => {
            let axis = |a: usize| Cubic::new(u[a], P + a >= 3);
            let (x, y, z) = (axis(0), axis(1), axis(2));
            let plane = |i| y.sum::<4, 5, 6, 7>(|j| z.sum::<1, 2, 3, 4>(|k| c(i, j, k)));
            out.copy_from_slice(&x.sum::<7, 8, 9, 10>(plane));
        }
    }
}
