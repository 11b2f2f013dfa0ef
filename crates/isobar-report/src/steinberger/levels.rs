//! Table 6.4 of Steinberger's thesis: the dragon's distance field over levels of detail, chosen by view.

use super::figures::load;
use anyhow::{Context, Result};
use isobar_core::{Grid, View};
use isobar_octree::figures::levels::eye;
use isobar_octree::wavelet::table::{Picture, Row, Setting, epsilon_for};
use isobar_octree::wavelet::{Bank, Pyramid};
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::time::Duration;

pub use isobar_octree::figures::printed::TABLE_6_4 as PRINTED_6_4;

/// Ours, at the threshold that leaves the share of chunks of the thesis's row.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct LevelRow {
    /// Figure 6.7's letter.
    pub figure: String,
    /// Threshold of the diameter of a node over its distance.
    pub epsilon: f64,
    /// Active chunks, those of the coarsest level included.
    pub chunks: u64,
    /// Of all, percent.
    pub share: f64,
    /// Milliseconds of CPU time, one thread: to select and reconstruct from nothing.
    pub reconstruction: f64,
    /// To select, reconstruct and lay out the lattices, coming from the row before.
    pub select: f64,
    /// Of the frame over levels.
    pub frame: f64,
    /// Of the frame of the volume itself at full resolution, interleaved with the last.
    pub full: f64,
    /// Mean squared difference of linear colour over pixels hit, times 1000.
    pub mse: f64,
    /// Root mean square distance of the hits along the ray, voxels.
    pub depth: f64,
    /// Pixels hit in one picture only.
    pub one_sided: u64,
    /// Connected parts of the samples above the isovalue.
    pub parts: u64,
}

/// The distance field of the table, cubic, isovalue 0, in the default view at 1024x768.
#[derive(Debug, Clone)]
pub struct Field {
    /// The samples.
    pub grid: Grid,
    /// The view that chooses levels.
    pub view: View,
}

impl Field {
    /// Reads it; `None` where the file is not there.
    ///
    /// # Errors
    /// When the file holds no grid.
    pub fn load(file: &Path) -> Result<Option<Self>> {
        Ok(load(file)?.map(|grid| Self {
            view: View::fit(grid.domain().world_bounds(), 40.0, 1024, 768),
            grid,
        }))
    }

    /// What is drawn, by so many threads; 0: all.
    #[must_use]
    pub fn setting(&self, threads: usize) -> Setting<'_> {
        Setting {
            grid: &self.grid,
            bank: Bank::Psi42,
            isovalue: 0.0,
            view: &self.view,
            method: &isobar_octree::OCTREE_CPU,
            threads,
            clock: isobar::machine::cpu_time,
        }
    }

    /// The rows at the thresholds that leave the thesis's shares of chunks, one thread, with their frames.
    ///
    /// # Errors
    /// When a frame cannot be drawn.
    pub fn rows(&self) -> Result<Vec<(Row, Picture)>> {
        let setting = self.setting(1);
        let eye = eye(setting.view)?;
        let pyramid = Pyramid::new(&self.grid, setting.bank).context("the field of Table 6.4")?;
        let share = |p: &isobar_octree::figures::printed::Printed64| epsilon_for(&pyramid, eye, p.chunks.1 / 100.0);
        let epsilons: Vec<f64> = PRINTED_6_4.iter().map(share).collect();
        setting.rows(eye, &epsilons, false).context("the field of Table 6.4")
    }
}

/// The table.
#[must_use]
pub fn table(rows: &[(Row, Picture)]) -> Vec<LevelRow> {
    let ms = |d: Duration| d.as_secs_f64() * 1e3;
    (rows.iter().zip(PRINTED_6_4))
        .map(|((r, _), p)| LevelRow {
            figure: p.figure.into(),
            epsilon: r.epsilon,
            chunks: r.chunks as u64,
            share: 100.0 * r.share,
            reconstruction: ms(r.from_nothing),
            select: ms(r.levels.select),
            frame: ms(r.levels.render),
            full: ms(r.levels.full),
            mse: r.mse * 1e3,
            depth: r.depth,
            one_sided: r.one_sided as u64,
            parts: r.parts as u64,
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_field_that_is_not_there_has_no_rows() {
        assert!(Field::load(Path::new("no such file.nrrd")).unwrap().is_none());
    }
}
