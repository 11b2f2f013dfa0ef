//! The reconstruction filters: which there are, and their basis functions.
//!
//! Knoll et al. 2009, section 6, samples trilinearly or with the cubic filters of Mitchell and Netravali 1988, as printed the one with B = 2, C = 1:
//!
//! ```text
//! k(x) = 1/6 (-12 |x|^3 + 12 |x|^2 + 2)                for |x| <= 1
//! k(x) = 1/6 (-8 |x|^3 + 42 |x|^2 - 72 |x| + 40)       for 1 <= |x| <= 2
//! ```
//!
//! It sums to one and is C1, but k(1.5) = -1/12: a piece is not bounded by its samples, only by its own Bernstein coefficients ([`Filter::points`]). B = 1,
//! C = 0 is the cubic B-spline, which has no negative lobe.

use isobar_core::{Basis1, CUBIC, DataError, QUADRATIC, TRILINEAR};
use isobar_fields::Kind;
use std::fmt;
use std::str::FromStr;

/// The filter BC(2,1) on a cell, as [`isobar_core::Lattice`] would have it but for the weights that are negative.
pub static BC21: Basis1 = Basis1 {
    degree: 3,
    denominator: 6,
    matrix: [[2, 2, 2, 0], [-12, 0, 12, 0], [18, 12, -24, -6], [-8, -12, 12, 8]],
    centred: false,
};

/// A reconstruction this method can draw.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Filter {
    /// A B-spline of isobar-fields.
    Spline(Kind),
    /// Mitchell and Netravali's filter with B = 2, C = 1.
    Bc21,
}

impl Filter {
    /// The names on the command line, the default first.
    pub const NAMES: &'static [&'static str] = &[
        "trilinear",
        "quadratic",
        "quadratic-interpolating",
        "cubic",
        "cubic-interpolating",
        "bc21",
    ];

    /// The basis of one axis.
    #[must_use]
    pub const fn basis(self) -> &'static Basis1 {
        match self {
            Self::Spline(kind) => kind.basis(),
            Self::Bc21 => &BC21,
        }
    }

    /// The kind whose coefficients and borders it uses.
    #[must_use]
    pub const fn coefficients(self) -> Kind {
        match self {
            Self::Spline(kind) => kind,
            Self::Bc21 => Kind::Cubic,
        }
    }

    /// Whether its weights are negative somewhere.
    #[must_use]
    pub const fn has_negative_lobes(self) -> bool {
        matches!(self, Self::Bc21)
    }

    /// Bernstein coefficients of a piece in one axis: `[i][j]` is the weight of coefficient j of the stencil in Bernstein coefficient i. A value on
    /// the piece lies between the least and greatest of them.
    #[must_use]
    pub fn points(self) -> [[f64; 4]; 4] {
        let b = self.basis();
        let n = b.degree;
        let mut out = [[0.0; 4]; 4];
        for (i, row) in out.iter_mut().enumerate().take(n + 1) {
            for (j, w) in row.iter_mut().enumerate().take(n + 1) {
                // sum over k of C(i,k)/C(n,k) of the power coefficients
                let sum: f64 = (0..=i)
                    .map(|k| f64::from(b.matrix[k][j]) * binomial(i, k) / binomial(n, k))
                    .sum();
                *w = sum / f64::from(b.denominator);
            }
        }
        out
    }
}

/// n over k.
pub(crate) fn binomial(n: usize, k: usize) -> f64 {
    (0..k).fold(1.0, |b, i| b * (n - i) as f64 / (i + 1) as f64)
}

impl fmt::Display for Filter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Spline(kind) => kind.name(),
            Self::Bc21 => "bc21",
        })
    }
}

impl FromStr for Filter {
    type Err = DataError;

    fn from_str(s: &str) -> Result<Self, DataError> {
        if s == "bc21" {
            Ok(Self::Bc21)
        } else {
            s.parse().map(Self::Spline)
        }
    }
}

/// Power coefficients of the weights of one axis, not divided by the denominator.
#[inline(always)]
pub(crate) fn rows(basis: &Basis1) -> [[f64; 4]; 4] {
    basis.matrix.map(|row| row.map(f64::from))
}

const _: () = assert!(TRILINEAR.degree == 1 && QUADRATIC.degree == 2 && CUBIC.degree == 3);

#[cfg(test)]
mod tests {
    use super::*;

    /// The kernel of Mitchell and Netravali 1988, equation 8.
    fn kernel(b: f64, c: f64, x: f64) -> f64 {
        let x = x.abs();
        let v = if x < 1.0 {
            (12.0 - 9.0 * b - 6.0 * c) * x.powi(3) + (-18.0 + 12.0 * b + 6.0 * c) * x * x + (6.0 - 2.0 * b)
        } else if x < 2.0 {
            (-b - 6.0 * c) * x.powi(3) + (6.0 * b + 30.0 * c) * x * x + (-12.0 * b - 48.0 * c) * x + (8.0 * b + 24.0 * c)
        } else {
            0.0
        };
        v / 6.0
    }

    fn weight(basis: &Basis1, j: usize, w: f64) -> f64 {
        let m = |k: usize| f64::from(basis.matrix[k][j]) / f64::from(basis.denominator);
        m(0) + w * (m(1) + w * (m(2) + w * m(3)))
    }

    #[test]
    fn the_printed_filter_is_mitchell_and_netravalis() {
        assert!((kernel(2.0, 1.0, 1.5) + 1.0 / 12.0).abs() < 1e-15, "the negative lobe");
        for n in 0..=32 {
            let w = f64::from(n) / 32.0;
            for (j, x) in [1.0 + w, w, 1.0 - w, 2.0 - w].into_iter().enumerate() {
                assert!((weight(&BC21, j, w) - kernel(2.0, 1.0, x)).abs() < 1e-14, "weight {j} at {w}");
                assert!(
                    (weight(&CUBIC, j, w) - kernel(1.0, 0.0, x)).abs() < 1e-14,
                    "B-spline {j} at {w}"
                );
            }
        }
    }

    #[test]
    fn bernstein_coefficients_bound_what_samples_do_not() {
        for f in [
            Filter::Spline(Kind::Trilinear),
            Filter::Spline(Kind::Quadratic),
            Filter::Spline(Kind::Cubic),
            Filter::Bc21,
        ] {
            let (n, p) = (f.basis().degree, f.points());
            for w in [0.0, 0.1, 0.5, 0.77, 1.0f64] {
                let mut sums = [0.0; 4];
                for (i, row) in p.iter().enumerate().take(n + 1) {
                    let b = binomial(n, i) * w.powi(i as i32) * (1.0 - w).powi((n - i) as i32);
                    sums.iter_mut().zip(row).for_each(|(s, p)| *s += b * p);
                }
                for (j, s) in sums.iter().enumerate().take(n + 1) {
                    assert!((s - weight(f.basis(), j, w)).abs() < 1e-14, "{f}");
                }
            }
            let negative = p.iter().flatten().any(|&w| w < -1e-15);
            assert_eq!(negative, f.has_negative_lobes(), "{f}");
        }
    }

    #[test]
    fn names_round_trip() {
        for n in Filter::NAMES {
            assert_eq!(n.parse::<Filter>().unwrap().to_string(), *n);
        }
        assert!("bc12".parse::<Filter>().is_err());
    }
}
