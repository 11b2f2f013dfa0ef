//! Bernstein form on [0, 1]: `p(t) = sum_i b[i] C(n,i) t^i (1-t)^(n-i)`, n + 1 coefficients for degree n.
//!
//! All routines take slices, work in place and allocate nothing. Error bounds use the unit roundoff u and
//! `M = max |b[i]|`; they hold to first order in u while nothing over- or underflows.

use crate::Real;

/// p(t) by de Casteljau's scheme, O(n^2). For t in [0, 1] the error is at most `3 n u M` and the value never leaves the
/// hull of the coefficients by more. Overwrites `b` with the scheme's last column: `b[0]` becomes p(t). 0 for an empty slice.
#[inline]
pub fn de_casteljau<T: Real>(b: &mut [T], t: T) -> T {
    let s = T::ONE - t;
    for k in 1..b.len() {
        for i in 0..b.len() - k {
            b[i] = b[i] * s + b[i + 1] * t;
        }
    }
    b.first().copied().unwrap_or(T::ZERO)
}

/// p(t) in O(n) from Bernstein coefficients. For t in [0, 1] the error is at most `(4 n + 2) u M`. 0 for an empty slice.
#[inline]
pub fn eval<T: Real>(b: &[T], t: T) -> T {
    let Some(n) = b.len().checked_sub(1) else { return T::ZERO };
    let c = T::binomials(n);
    let s = T::ONE - t;
    let mut acc = b[0];
    let mut power = T::ONE;
    for i in 1..=n {
        power *= t;
        acc = acc * s + (b[i] * c[i]) * power;
    }
    acc
}

/// (p(t), p'(t)) in O(n).
#[inline]
pub fn eval_with_derivative<T: Real>(b: &[T], t: T) -> (T, T) {
    let Some(n) = b.len().checked_sub(1) else {
        return (T::ZERO, T::ZERO);
    };
    let mut slope = T::ZERO;
    if n > 0 {
        let c = T::binomials(n - 1);
        let s = T::ONE - t;
        let mut power = T::ONE;
        for i in 0..n {
            slope = slope * s + ((b[i + 1] - b[i]) * c[i]) * power;
            power *= t;
        }
        slope *= T::from_f64(n as f64);
    }
    (eval(b, t), slope)
}

/// Splits at `t`: `b` becomes the coefficients over [0, t], `right` those over [t, 1] (both reparametrised to [0, 1]).
/// Each coefficient's error is at most `3 n u M`; at t = 1/2 it is `n u M`.
///
/// # Panics
/// If the lengths differ.
#[inline]
pub fn split<T: Real>(b: &mut [T], t: T, right: &mut [T]) {
    assert_eq!(b.len(), right.len(), "both halves have the degree of the whole");
    let (s, m) = (T::ONE - t, b.len());
    // right[m-1-k] is the last entry of the scheme's column k; b[k] is the first one, so the columns shrink from the left.
    for k in 0..m {
        right[m - 1 - k] = b[m - 1];
        for i in (k + 1..m).rev() {
            b[i] = b[i - 1] * s + b[i] * t;
        }
    }
}

/// Restricts to [lo, hi], a part of [0, 1] (reparametrised to [0, 1]), in place. Nothing is divided unless lo > 0.
#[inline]
pub fn restrict<T: Real>(b: &mut [T], lo: T, hi: T) {
    let m = b.len();
    let s = T::ONE - hi;
    for k in 0..m {
        for i in (k + 1..m).rev() {
            b[i] = b[i - 1] * s + b[i] * hi;
        }
    }
    if lo > T::ZERO {
        let t = if hi > T::ZERO { (lo / hi).smaller(T::ONE) } else { T::ZERO };
        let s = T::ONE - t;
        for k in 1..m {
            for i in 0..m - k {
                b[i] = b[i] * s + b[i + 1] * t;
            }
        }
    }
}

/// The derivative's n coefficients `n (b[i+1] - b[i])`, in place; returns that part of the slice. A constant gives `[0]`, nothing gives nothing.
#[inline]
pub fn derivative<T: Real>(b: &mut [T]) -> &mut [T] {
    let Some(n) = b.len().checked_sub(1) else { return b };
    if n == 0 {
        b[0] = T::ZERO;
        return b;
    }
    let degree = T::from_f64(n as f64);
    for i in 0..n {
        b[i] = (b[i + 1] - b[i]) * degree;
    }
    &mut b[..n]
}

/// Raises the degree by one without changing the polynomial: the slice holds n + 1 coefficients and one free place at its
/// end, afterwards n + 2 coefficients. Exact arithmetic: `b'[i] = (i b[i-1] + (n+1-i) b[i]) / (n+1)`. Slices of fewer than two places stay.
#[inline]
pub fn elevate<T: Real>(b: &mut [T]) {
    let Some(n) = b.len().checked_sub(2) else { return };
    let whole = T::from_f64((n + 1) as f64);
    b[n + 1] = b[n];
    for i in (1..=n).rev() {
        let k = T::from_f64(i as f64);
        b[i] = (k * b[i - 1] + (whole - k) * b[i]) / whole;
    }
}

/// Smallest and largest coefficient: they enclose p on [0, 1] (exactly, for the coefficients as given). `None` for an empty slice.
#[inline]
pub fn hull<T: Real>(b: &[T]) -> Option<(T, T)> {
    let first = *b.first()?;
    Some(b.iter().fold((first, first), |(lo, hi), &x| (lo.smaller(x), hi.larger(x))))
}

/// Sign changes along the coefficients, zeros skipped. By Descartes' rule the number of roots in the open interval (0, 1),
/// counted with multiplicity, is this number or less by an even number.
#[inline]
pub fn variations<T: Real>(b: &[T]) -> usize {
    let mut last = T::ZERO;
    let mut count = 0;
    for &x in b {
        if x != T::ZERO {
            count += usize::from((x > T::ZERO && last < T::ZERO) || (x < T::ZERO && last > T::ZERO));
            last = x;
        }
    }
    count
}

/// To scaled Bernstein form, in place: `b[i] C(n,i)`. One rounding each.
#[inline]
pub fn to_scaled<T: Real>(b: &mut [T]) {
    let Some(n) = b.len().checked_sub(1) else { return };
    for (x, &c) in b.iter_mut().zip(T::binomials(n)) {
        *x *= c;
    }
}

/// To power form, in place. Ill conditioned by nature: the error of `a[j]` is up to about `C(n,j) 2^j n u M`.
#[inline]
pub fn to_power<T: Real>(b: &mut [T]) {
    // Forward differences: a[j] = C(n,j) (difference of order j at 0).
    let m = b.len();
    for k in 1..m {
        for i in (k..m).rev() {
            b[i] -= b[i - 1];
        }
    }
    to_scaled(b);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hand_values() {
        // (t - 1/4)^2 = 1/16 - t/2 + t^2 has the Bernstein coefficients 1/16, -3/16, 9/16.
        let b = [1.0 / 16.0, -3.0 / 16.0, 9.0 / 16.0];
        assert_eq!(eval(&b, 0.75), 0.25);
        assert_eq!(eval_with_derivative(&b, 0.75), (0.25, 1.0));
        assert_eq!(de_casteljau(&mut b.clone(), 0.25), 0.0);
        assert_eq!(variations(&b), 2);
        assert_eq!(hull(&b), Some((-3.0 / 16.0, 9.0 / 16.0)));
        let mut a = b;
        to_power(&mut a);
        assert_eq!(a, [1.0 / 16.0, -0.5, 1.0]);
        let (mut l, mut r) = (b, [0.0; 3]);
        split(&mut l, 0.5, &mut r);
        assert_eq!(
            (l, r),
            ([1.0 / 16.0, -1.0 / 16.0, 1.0 / 16.0], [1.0 / 16.0, 3.0 / 16.0, 9.0 / 16.0])
        );
        let mut part = b;
        restrict(&mut part, 0.25, 0.5);
        assert_eq!(part, [0.0, 0.0, 1.0 / 16.0]);
        let mut d = b;
        assert_eq!(derivative(&mut d), [-0.5, 1.5]);
        let mut e = [1.0 / 16.0, -3.0 / 16.0, 9.0 / 16.0, 0.0];
        elevate(&mut e);
        assert_eq!(e, [1.0 / 16.0, -5.0 / 48.0, 1.0 / 16.0, 9.0 / 16.0]);
    }

    #[test]
    fn small_slices() {
        assert_eq!(eval::<f64>(&[], 0.5), 0.0);
        assert_eq!(eval(&[2.0f32], 0.5), 2.0);
        assert_eq!(eval_with_derivative(&[2.0f32], 0.5), (2.0, 0.0));
        assert_eq!(derivative(&mut [2.0f64]), [0.0]);
        assert_eq!(hull::<f64>(&[]), None);
        elevate(&mut [1.0f64]);
    }
}
