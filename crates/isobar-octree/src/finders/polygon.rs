//! The control polygon of a polynomial in Bernstein form: where it crosses zero, and its subdivision.

use isobar_poly::Real;

/// Whether a coefficient counts as negative. Zero does not: so of two cells that share a face on which p is zero, exactly one has the crossing.
/// (The thesis's listings leave `findCrossing` open; the product of neighbours, as in Listing A.4, loses +, 0, -.)
#[inline(always)]
fn negative<T: Real>(x: T) -> bool {
    x < T::ZERO
}

/// The first i with a crossing between coefficients i and i + 1.
#[inline(always)]
pub(super) fn first_crossing<T: Real>(b: &[T]) -> Option<usize> {
    (1..b.len()).find(|&i| negative(b[i - 1]) != negative(b[i])).map(|i| i - 1)
}

/// Where the polygon crosses zero between coefficients i and i + 1, on [0, 1]: the abscissae are i/n for degree n.
#[inline(always)]
pub(super) fn crossing_at<T: Real>(b: &[T], i: usize) -> T {
    let n = T::from_f64((b.len() - 1) as f64);
    (T::from_f64(i as f64) + b[i] / (b[i] - b[i + 1])) / n
}

/// Number of crossings up to 2, and where the first two are (0 where there is none).
#[inline(always)]
pub(super) fn first_two_crossings<T: Real>(b: &[T]) -> (u32, T, T) {
    let (mut found, mut at) = (0, [T::ZERO; 2]);
    for i in 0..b.len() - 1 {
        if negative(b[i]) != negative(b[i + 1]) {
            at[found] = crossing_at(b, i);
            found += 1;
            if found == 2 {
                break;
            }
        }
    }
    (found as u32, at[0], at[1])
}

/// De Casteljau's subdivision: the coefficients over [0, at] and [at, 1].
#[inline(always)]
pub(super) fn split<T: Real, const M: usize>(b: &[T; M], at: T) -> ([T; M], [T; M]) {
    let u = T::ONE - at;
    let (mut parent, mut left, mut right) = (*b, *b, *b);
    for i in 1..M {
        for j in 0..M - i {
            parent[j] = u * parent[j] + at * parent[j + 1];
        }
        left[i] = parent[0];
        right[M - 1 - i] = parent[M - 1 - i];
    }
    (left, right)
}
