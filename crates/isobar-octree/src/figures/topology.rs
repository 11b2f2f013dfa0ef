//! Figure 6.9: what fewer details do to the topology. Connected parts of the samples at or above an isovalue, and of those below it.
//!
//! Parts are counted on the coefficients at full resolution, neighbours along axes; those of a few samples are noise more often than not, so parts of at
//! least [`SMALL`] samples are counted apart.

use crate::wavelet::table::{Picture, Setting, part_sizes};
use crate::wavelet::{Adaptive, Criteria, Extent, Pyramid, Selection};
use isobar_core::RenderError;
use std::sync::Arc;

/// A part of fewer samples is small.
pub const SMALL: usize = 64;

/// Parts of the samples on one side of the isovalue.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Parts {
    /// All.
    pub all: usize,
    /// Those of at least [`SMALL`] samples.
    pub large: usize,
    /// Samples of the largest.
    pub largest: usize,
}

impl Parts {
    fn of(sizes: &[usize]) -> Self {
        Self {
            all: sizes.len(),
            large: sizes.iter().filter(|&&n| n >= SMALL).count(),
            largest: sizes.iter().max().copied().unwrap_or(0),
        }
    }
}

/// A choice of details.
#[derive(Debug, Clone)]
pub struct Stage {
    /// Which details are left.
    pub details: String,
    /// Chunks with details that act.
    pub chunks: usize,
    /// At or above the isovalue.
    pub above: Parts,
    /// Below it.
    pub below: Parts,
    /// The surface, as `octree/cpu` draws the coefficients.
    pub picture: Picture,
}

/// The surface with whole levels of details off, finest first, then by magnitude: chunks whose details are all below these shares of the range of the samples are off.
///
/// # Errors
/// Those of the method, and of data that are not finite.
pub fn stages(setting: &Setting<'_>, magnitudes: &[f64]) -> Result<Vec<Stage>, RenderError> {
    let pyramid = Arc::new(Pyramid::new(setting.grid, setting.bank)?);
    let mut adaptive = Adaptive::new(pyramid.clone());
    let (lo, hi) = setting.grid.samples.range().0.unwrap_or_default();
    let whole = (0..=pyramid.levels()).map(|from| {
        let details = match from {
            0 => "all".to_owned(),
            1 => "without the finest level".to_owned(),
            n => format!("without the {n} finest levels"),
        };
        (details, Selection::by(&pyramid, |n| n.level >= from))
    });
    let by_magnitude = magnitudes.iter().map(|m| {
        let criteria = Criteria {
            magnitude: Some(m * (hi - lo)),
            ..Criteria::default()
        };
        (
            format!("above {} % of the range", 100.0 * m),
            Selection::new(&pyramid, &criteria),
        )
    });
    let mut out = Vec::new();
    for (details, selection) in whole.chain(by_magnitude) {
        adaptive.update(&selection, Extent::Whole);
        let grid = adaptive.grid()?;
        out.push(Stage {
            details,
            chunks: selection.count(),
            above: Parts::of(&part_sizes(&grid, |v| v >= setting.isovalue)),
            below: Parts::of(&part_sizes(&grid, |v| v < setting.isovalue)),
            picture: setting.picture(&grid)?,
        });
    }
    Ok(out)
}
