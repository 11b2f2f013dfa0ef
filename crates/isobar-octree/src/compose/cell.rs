//! From the samples of a cell to its power form (thesis, section 3.3.2; S10): separable, the common factor of the matrices left out.

use super::{Scalar, at};

/// What [`powers_of_samples`] is too large by, per axis: 1, 2 or 6. The isovalue is to be scaled by its cube.
#[must_use]
pub const fn scale_of_samples<const D: usize>() -> u32 {
    [1, 2, 6][D - 1]
}

/// One axis: the B-spline's matrix (maths, corrections, section B: the last row of degree 2 is 1, -2, 1), times its denominator.
#[inline(always)]
fn axis<T: Scalar, const D: usize>([a, b, c, d]: [T; 4]) -> [T; 4] {
    let three = T::ONE + T::ONE + T::ONE;
    match D {
        1 => [a, b - a, T::ZERO, T::ZERO],
        2 => {
            let slope = b - a;
            [a + b, slope + slope, (a - b) + (c - b), T::ZERO]
        }
        _ => {
            let outer = a + c;
            let twice = b + b;
            [
                outer + twice + twice,
                three * (c - a),
                three * (outer - twice),
                (d - a) + three * (b - c),
            ]
        }
    }
}

/// [`axis`] of what `get` gives for the coefficients there are.
#[inline(always)]
fn line<T: Scalar, const D: usize>(get: impl Fn(usize) -> T) -> [T; 4] {
    axis::<T, D>(std::array::from_fn(|i| if i <= D { get(i) } else { T::ZERO }))
}

/// The power form on [0, 1]^3 of the cell with the (D + 1)^3 spline coefficients `samples`, x fastest, times [`scale_of_samples`] cubed, into `f` as
/// [`super::compose`] wants it.
///
/// # Panics
/// When there are not (D + 1)^3 of either. D other than 1, 2, 3 does not compile.
#[inline(always)]
pub fn powers_of_samples<T: Scalar, const D: usize>(samples: &[T], f: &mut [T]) {
    const { assert!(D >= 1 && D <= 3, "degrees 1, 2 and 3") };
    let n = D + 1;
    assert!(samples.len() == n * n * n && f.len() == n * n * n, "(D + 1)^3 coefficients");
    let mut x = [T::ZERO; 64];
    for r in 0..n * n {
        let p = line::<T, D>(|i| samples[r * n + i]);
        for (i, v) in p.into_iter().take(n).enumerate() {
            x[r * n + i] = v;
        }
    }
    let mut y = [T::ZERO; 64];
    for k in 0..n {
        for i in 0..n {
            let p = line::<T, D>(|j| x[(k * n + j) * n + i]);
            for (j, v) in p.into_iter().take(n).enumerate() {
                y[(k * n + j) * n + i] = v;
            }
        }
    }
    for j in 0..n {
        for i in 0..n {
            let p = line::<T, D>(|k| y[(k * n + j) * n + i]);
            for (k, v) in p.into_iter().take(n).enumerate() {
                f[at::<D>(i, j, k)] = v;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use isobar_core::{Basis1, CUBIC, QUADRATIC, TRILINEAR};

    /// The tensor product by its definition, on whole numbers.
    fn agrees<const D: usize>(basis: &Basis1) {
        let n = D + 1;
        let samples: Vec<i128> = (0..n * n * n).map(|i| (i as i128 * 37) % 23 - 11).collect();
        let mut f = vec![0i128; n * n * n];
        powers_of_samples::<i128, D>(&samples, &mut f);
        assert_eq!(scale_of_samples::<D>() as i32, basis.denominator);
        let m = |k: usize, j: usize| i128::from(basis.matrix[k][j]);
        for i in 0..n * n * n {
            let [p, q, r] = [i / (n * n), i / n % n, i % n];
            let sum: i128 = (0..n * n * n)
                .map(|s| samples[s] * m(p, s % n) * m(q, s / n % n) * m(r, s / (n * n)))
                .sum();
            assert_eq!(f[at::<D>(p, q, r)], sum, "degree {D}, power {p} {q} {r}");
        }
    }

    #[test]
    fn powers_are_those_of_the_matrices() {
        agrees::<1>(&TRILINEAR);
        agrees::<2>(&QUADRATIC);
        agrees::<3>(&CUBIC);
    }
}
