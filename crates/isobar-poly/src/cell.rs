//! One cell of the subdivision: Bernstein coefficients over [a, a + w], signs with error bounds, halving.

use crate::Real;

/// Number of coefficients: known to the compiler (`CAP`), or at run time (`DYN`, up to `CAP`).
#[inline(always)]
pub(crate) fn count<const CAP: usize, const DYN: bool>(runtime: usize) -> usize {
    if DYN { runtime } else { CAP }
}

/// What the coefficients' sizes and signs say.
#[derive(Clone, Copy)]
pub(crate) struct Signs<T> {
    /// Largest |coefficient|.
    pub(crate) most: T,
    /// Smallest |coefficient|.
    pub(crate) least: T,
    /// Changes of the sign bit along the coefficients.
    pub(crate) changes: u32,
}

/// Branch-free scan. If `least > error`, all signs are certain and `changes` is Descartes' number.
#[inline(always)]
pub(crate) fn signs<T: Real>(b: &[T]) -> Signs<T> {
    let (mut most, mut least, mut changes) = (b[0].abs(), b[0].abs(), 0);
    for i in 1..b.len() {
        let size = b[i].abs();
        most = most.larger(size);
        least = least.smaller(size);
        changes += b[i].sign_bit() ^ b[i - 1].sign_bit();
    }
    Signs { most, least, changes }
}

/// Error that one halving adds to each coefficient, relative to the largest one of the parent: n roundings of u each; the 2
/// more absorb second-order terms and underflow (coefficients are at least [`Real::SMALL`] at the root).
#[inline(always)]
pub(crate) fn halving_error<T: Real>(m: usize) -> T {
    T::from_f64((m + 1) as f64) * T::ROUNDOFF
}

/// Error of [`crate::scaled::eval`] on coefficients `b[i] C(n,i)` rounded once, relative to the largest |b[i]|: 3n + 2 roundings, and as above.
#[inline(always)]
pub(crate) fn eval_error<T: Real>(m: usize) -> T {
    T::from_f64((3 * m + 3) as f64) * T::ROUNDOFF
}

/// Coefficients over the two halves. Sums are formed unscaled and multiplied by 2^-k at the end: the same numbers as with
/// averages (scaling by powers of two is exact), half the operations.
#[inline(always)]
pub(crate) fn halve<T: Real, const CAP: usize>(b: &[T; CAP], m: usize) -> ([T; CAP], [T; CAP]) {
    let mut s = *b;
    let (mut left, mut right) = ([T::ZERO; CAP], [T::ZERO; CAP]);
    left[0] = s[0];
    right[m - 1] = s[m - 1];
    for k in 1..m {
        for i in 0..m - k {
            s[i] += s[i + 1];
        }
        let scale = T::half_power(k as u32);
        left[k] = s[0] * scale;
        right[m - 1 - k] = s[m - 1 - k] * scale;
    }
    (left, right)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_of_a_cubic() {
        let (l, r) = halve(&[0.0, 0.0, 0.0, 8.0], 4); // 8 t^3
        assert_eq!((l, r), ([0.0, 0.0, 0.0, 1.0], [1.0, 2.0, 4.0, 8.0]));
    }

    #[test]
    fn scan() {
        let s = signs(&[1.0f32, -2.0, 0.5, -0.25]);
        assert_eq!((s.most, s.least, s.changes), (2.0, 0.25, 3));
    }
}
