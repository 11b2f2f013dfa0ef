//! Scaled Bernstein form: `p(t) = sum_i s[i] t^i (1-t)^(n-i)` with `s[i] = b[i] C(n,i)`.
//!
//! Compositions along a ray give this form with additions and multiplications only, and it has the signs of the Bernstein form.

use crate::Real;

/// p(t) in O(n). For t in [0, 1] the error is at most `(3 n + 2) u max |b[i]|`. 0 for an empty slice.
#[inline]
pub fn eval<T: Real>(s: &[T], t: T) -> T {
    let Some((&first, rest)) = s.split_first() else {
        return T::ZERO;
    };
    let r = T::ONE - t;
    let (mut acc, mut power) = (first, T::ONE);
    for &c in rest {
        power *= t;
        acc = acc * r + c * power;
    }
    acc
}

/// To Bernstein form, in place: `s[i] / C(n,i)`. One rounding each.
#[inline]
pub fn to_bernstein<T: Real>(s: &mut [T]) {
    let Some(n) = s.len().checked_sub(1) else { return };
    for (x, &c) in s.iter_mut().zip(T::binomials(n)) {
        *x = *x / c;
    }
}

/// To power form, in place, additions only: `a[j] = sum_i (-1)^(j-i) C(n-i,j-i) s[i]`.
#[inline]
pub fn to_power<T: Real>(s: &mut [T]) {
    // The steps of the power form's conversion, undone in reverse order.
    for j in (1..s.len()).rev() {
        for i in 1..=j {
            s[i] -= s[i - 1];
        }
    }
}

/// The product's coefficients into `out`; in this form that is the plain convolution, and degrees add.
///
/// # Panics
/// If either factor is empty or `out.len() != a.len() + b.len() - 1`.
#[inline]
pub fn multiply<T: Real>(a: &[T], b: &[T], out: &mut [T]) {
    assert!(
        !a.is_empty() && !b.is_empty() && out.len() == a.len() + b.len() - 1,
        "degrees add"
    );
    out.fill(T::ZERO);
    for (i, &x) in a.iter().enumerate() {
        for (o, &y) in out[i..].iter_mut().zip(b) {
            *o += x * y;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hand_values() {
        let s = [2.0, 1.0, 0.0]; // (t - 1)(t - 2)
        assert_eq!(eval(&s, 0.5), 0.75);
        let mut a = s;
        to_power(&mut a);
        assert_eq!(a, [2.0, -3.0, 1.0]);
        let mut out = [0.0; 3];
        multiply(&[-1.0, 0.0], &[-2.0, -1.0], &mut out); // (t-1) and (t-2)
        assert_eq!(out, s);
    }
}
