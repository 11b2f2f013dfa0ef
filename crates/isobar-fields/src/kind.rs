//! The reconstructions by name, and the border rule.

use isobar_core::{Basis1, CUBIC, DataError, QUADRATIC, TRILINEAR};
use std::fmt;
use std::str::FromStr;

/// A tensor-product reconstruction of grid samples.
///
/// The plain kinds take the samples as coefficients: trilinear interpolates them, the B-splines smooth them
/// (`s[x^2] = x^2 + 1/4` quadratic, `+ 1/3` cubic; maths: corrections, section B). The interpolating kinds solve for
/// coefficients with which the spline passes through the samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Kind {
    /// Linear interpolation, C0, order 2.
    Trilinear,
    /// Quadratic B-spline with the samples as coefficients, C1, order 2; cells are centred on samples.
    Quadratic,
    /// Quadratic B-spline through the samples, C1, order 3.
    QuadraticInterpolating,
    /// Cubic B-spline with the samples as coefficients, C2, order 2.
    Cubic,
    /// Cubic B-spline through the samples, C2, order 4.
    CubicInterpolating,
}

impl Kind {
    /// All kinds, in the order of [`Kind::NAMES`].
    pub const ALL: [Self; 5] = [
        Self::Trilinear,
        Self::Quadratic,
        Self::QuadraticInterpolating,
        Self::Cubic,
        Self::CubicInterpolating,
    ];

    /// Their names on the command line, the default first.
    pub const NAMES: &'static [&'static str] = &[
        "trilinear",
        "quadratic",
        "quadratic-interpolating",
        "cubic",
        "cubic-interpolating",
    ];

    /// The name on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        Self::NAMES[self as usize]
    }

    /// The basis of one axis.
    #[must_use]
    pub const fn basis(self) -> &'static Basis1 {
        match self {
            Self::Trilinear => &TRILINEAR,
            Self::Quadratic | Self::QuadraticInterpolating => &QUADRATIC,
            Self::Cubic | Self::CubicInterpolating => &CUBIC,
        }
    }

    /// Whether it needs a prefilter: coefficients of its own that make it pass through the samples.
    #[must_use]
    pub const fn interpolates(self) -> bool {
        matches!(self, Self::QuadraticInterpolating | Self::CubicInterpolating)
    }

    /// Where coefficients beyond the grid come from.
    #[must_use]
    pub const fn border(self) -> Border {
        if self.interpolates() { Border::Mirror } else { Border::Clamp }
    }
}

impl fmt::Display for Kind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for Kind {
    type Err = DataError;

    fn from_str(s: &str) -> Result<Self, DataError> {
        Self::ALL.into_iter().find(|k| k.name() == s).ok_or_else(|| {
            DataError::Unknown(format!(
                "there is no reconstruction \"{s}\" of grids here; use one of {}",
                Self::NAMES.join(", ")
            ))
        })
    }
}

/// What stands for a coefficient outside the grid. This is the one place of the rule.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Border {
    /// The index is clamped: c(-1) = c(0), c(n) = c(n-1).
    Clamp,
    /// Mirrored about the end sample: c(-1) = c(1), c(n) = c(n-2), with period 2(n-1).
    Mirror,
}

impl Border {
    /// The index inside `0..n` that stands for index `i`. With `n = 1` always 0.
    ///
    /// # Panics
    /// When `n` is 0 (debug builds).
    #[must_use]
    #[inline]
    pub const fn index(self, i: isize, n: usize) -> usize {
        debug_assert!(n > 0);
        let last = n as isize - 1;
        match self {
            Self::Clamp => {
                if i < 0 {
                    0
                } else if i > last {
                    last as usize
                } else {
                    i as usize
                }
            }
            Self::Mirror => {
                if last == 0 {
                    return 0;
                }
                let m = i.rem_euclid(2 * last);
                (if m > last { 2 * last - m } else { m }) as usize
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_round_trip() {
        assert_eq!(Kind::ALL.len(), Kind::NAMES.len());
        for (k, name) in Kind::ALL.into_iter().zip(Kind::NAMES) {
            assert_eq!(k.to_string(), *name);
            assert_eq!(name.parse::<Kind>(), Ok(k));
        }
        let e = "cubical".parse::<Kind>().unwrap_err().to_string();
        assert!(e.contains("cubical") && e.contains("cubic-interpolating"), "{e}");
    }

    #[test]
    fn borders() {
        let row = |b: Border, n| (-4..6).map(|i| b.index(i, n)).collect::<Vec<_>>();
        assert_eq!(row(Border::Clamp, 3), [0, 0, 0, 0, 0, 1, 2, 2, 2, 2]);
        assert_eq!(row(Border::Mirror, 3), [0, 1, 2, 1, 0, 1, 2, 1, 0, 1]);
        assert_eq!(row(Border::Mirror, 2), [0, 1, 0, 1, 0, 1, 0, 1, 0, 1]);
        assert_eq!(row(Border::Mirror, 1), [0; 10]);
    }
}
