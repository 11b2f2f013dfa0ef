//! Every reconstruction of grids by its name.

use crate::type6::Type6Spline;
use crate::{GridSpline, Kind};
use isobar_core::{DataError, Function, Grid, Stage};
use std::fmt;
use std::str::FromStr;
use std::sync::Arc;

/// A named reconstruction of a grid: what the knob `reconstruction` means.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Reconstruction {
    /// A tensor-product spline.
    Tensor(Kind),
    /// The cubic C1 spline on the type-6 partition, C1, order 2.
    Type6,
    /// The same of data minus an eighth of their second differences, order 3.
    Type6Prefiltered,
}

impl Reconstruction {
    /// All of them, in the order of [`Reconstruction::NAMES`].
    pub const ALL: [Self; 7] = [
        Self::Tensor(Kind::Trilinear),
        Self::Tensor(Kind::Quadratic),
        Self::Tensor(Kind::QuadraticInterpolating),
        Self::Tensor(Kind::Cubic),
        Self::Tensor(Kind::CubicInterpolating),
        Self::Type6,
        Self::Type6Prefiltered,
    ];

    /// Their names on the command line, the common default first.
    pub const NAMES: &'static [&'static str] = &[
        "trilinear",
        "quadratic",
        "quadratic-interpolating",
        "cubic",
        "cubic-interpolating",
        "type6",
        "type6-prefiltered",
    ];

    /// The name on the command line.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Tensor(kind) => kind.name(),
            Self::Type6 => "type6",
            Self::Type6Prefiltered => "type6-prefiltered",
        }
    }

    /// The function of a grid.
    ///
    /// # Errors
    /// As [`GridSpline::new`] and [`Type6Spline::new`].
    pub fn of(self, grid: &Grid, stage: Stage) -> Result<Arc<dyn Function>, DataError> {
        Ok(match self {
            Self::Tensor(kind) => Arc::new(GridSpline::new(grid, kind, stage)?),
            Self::Type6 => Arc::new(Type6Spline::new(grid)?),
            Self::Type6Prefiltered => Arc::new(Type6Spline::prefiltered(grid, stage)?),
        })
    }
}

impl fmt::Display for Reconstruction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for Reconstruction {
    type Err = DataError;

    fn from_str(s: &str) -> Result<Self, DataError> {
        Self::ALL.into_iter().find(|k| k.name() == s).ok_or_else(|| {
            DataError::Unknown(format!(
                "there is no reconstruction \"{s}\" of grids; use one of {}",
                Self::NAMES.join(", ")
            ))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_round_trip() {
        for (r, name) in Reconstruction::ALL.into_iter().zip(Reconstruction::NAMES) {
            assert_eq!(r.to_string(), *name);
            assert_eq!(name.parse::<Reconstruction>(), Ok(r));
        }
        assert_eq!(Reconstruction::ALL.len(), Reconstruction::NAMES.len());
        assert!(
            "type7"
                .parse::<Reconstruction>()
                .unwrap_err()
                .to_string()
                .contains("type6-prefiltered")
        );
    }
}
