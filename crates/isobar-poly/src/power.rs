//! Power form: `p(t) = sum_i a[i] t^i`, constant term first, n + 1 coefficients for degree n.

use crate::{Real, scaled};

/// p(t) by Horner's rule. The error is at most `2 n u sum |a[i]| |t|^i`. 0 for an empty slice.
#[inline]
pub fn eval<T: Real>(a: &[T], t: T) -> T {
    a.iter().rev().fold(T::ZERO, |acc, &c| acc * t + c)
}

/// (p(t), p'(t)) by Horner's rule.
#[inline]
pub fn eval_with_derivative<T: Real>(a: &[T], t: T) -> (T, T) {
    a.iter().rev().fold((T::ZERO, T::ZERO), |(p, d), &c| (p * t + c, d * t + p))
}

/// The derivative's coefficients `i a[i]`, in place; returns that part of the slice. A constant gives `[0]`, nothing gives nothing.
#[inline]
pub fn derivative<T: Real>(a: &mut [T]) -> &mut [T] {
    let Some(n) = a.len().checked_sub(1) else { return a };
    if n == 0 {
        a[0] = T::ZERO;
        return a;
    }
    for i in 0..n {
        a[i] = a[i + 1] * T::from_f64((i + 1) as f64);
    }
    &mut a[..n]
}

/// Reparametrises: the coefficients of `p(lo + (hi - lo) t)`, in place. The way to put a root search on [lo, hi] onto [0, 1].
#[inline]
pub fn restrict<T: Real>(a: &mut [T], lo: T, hi: T) {
    let m = a.len();
    if lo != T::ZERO {
        for k in 0..m {
            for i in (k..m - 1).rev() {
                a[i] += a[i + 1] * lo;
            }
        }
    }
    let (width, mut power) = (hi - lo, T::ONE);
    for x in a {
        *x *= power;
        power *= width;
    }
}

/// To scaled Bernstein form on [0, 1], in place: additions only, the error of each is at most `n u sum_j C(n-j,i-j) |a[j]|`.
#[inline]
pub fn to_scaled<T: Real>(a: &mut [T]) {
    // sum_j a[j] t^j (s+t)^(n-j) with s = 1 - t, by a Horner scheme in (s+t): multiply what is there by (s+t), add the next term.
    for j in 1..a.len() {
        for i in (1..=j).rev() {
            a[i] += a[i - 1];
        }
    }
}

/// To Bernstein form on [0, 1], in place.
#[inline]
pub fn to_bernstein<T: Real>(a: &mut [T]) {
    to_scaled(a);
    scaled::to_bernstein(a);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hand_values() {
        let a = [2.0, -3.0, 1.0]; // (t - 1)(t - 2)
        assert_eq!(eval(&a, 2.0), 0.0);
        assert_eq!(eval_with_derivative(&a, 3.0), (2.0, 3.0));
        let mut s = a;
        to_scaled(&mut s); // 2 (s+t)^2 - 3 t (s+t) + t^2 = 2 s^2 + st + 0 t^2
        assert_eq!(s, [2.0, 1.0, 0.0]);
        let mut b = a;
        to_bernstein(&mut b);
        assert_eq!(b, [2.0, 0.5, 0.0]);
        let mut r = a;
        restrict(&mut r, 1.0, 3.0); // 2t (2t - 1)
        assert_eq!(r, [0.0, -2.0, 4.0]);
        let mut d = a;
        assert_eq!(derivative(&mut d), [-3.0, 2.0]);
    }
}
