//! Table 6.4 of Steinberger's thesis: the dragon's distance field over levels of detail, chosen by view.

use anyhow::{Context, Result, bail};
use isobar_core::{Camera, Data, View};
use isobar_octree::wavelet::table::{Setting, epsilon_for};
use isobar_octree::wavelet::{Bank, Pyramid};
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::time::Duration;

/// What Table 6.4 prints for a figure.
#[derive(Debug, Clone, Copy)]
pub struct Printed64 {
    /// Figure 6.7's letter.
    pub figure: &'static str,
    /// Active chunks, and their share of all in percent.
    pub chunks: (u32, f64),
    /// Milliseconds of the reconstruction and of the frame.
    pub times: [f64; 2],
    /// Mean squared error over coloured pixels, times 1000.
    pub mse: f64,
}

/// Table 6.4 (paper-numbers: Steinberger2010, Tab6.4; dragon 128³, Core i7 and GeForce GTX 285).
pub const PRINTED_6_4: [Printed64; 6] = [
    printed("full", (4681, 100.0), [7.23, 225.0], 0.0),
    printed("b", (3421, 73.0), [8.72, 219.0], 24.0),
    printed("c", (1877, 40.0), [9.25, 161.0], 45.0),
    printed("d", (585, 12.0), [6.11, 115.0], 57.0),
    printed("e", (295, 6.0), [6.92, 89.3], 176.0),
    printed("f", (73, 1.6), [3.58, 61.4], 370.0),
];

const fn printed(figure: &'static str, chunks: (u32, f64), times: [f64; 2], mse: f64) -> Printed64 {
    Printed64 {
        figure,
        chunks,
        times,
        mse,
    }
}

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

/// Measures the rows on a distance field, cubic, isovalue 0, default view at 1024x768; none where the file is not there.
///
/// # Errors
/// When the file holds no grid, or a frame cannot be drawn.
pub fn measure(file: &Path) -> Result<Vec<LevelRow>> {
    if !file.exists() {
        return Ok(Vec::new());
    }
    let named = || format!("{}", file.display());
    let loaded = isobar_io::load(file, &isobar_io::Options::default()).with_context(named)?;
    let Data::Grid(grid) = loaded.data else {
        bail!("{} holds no grid", file.display());
    };
    let view = View::fit(grid.domain().world_bounds(), 40.0, 1024, 768);
    let Camera::Perspective { eye, .. } = view.camera else {
        bail!("the default view is in perspective");
    };
    let setting = Setting {
        grid: &grid,
        bank: Bank::Psi42,
        isovalue: 0.0,
        view: &view,
        method: &isobar_octree::OCTREE_CPU,
        threads: 1,
        clock: isobar::machine::cpu_time,
    };
    let pyramid = Pyramid::new(&grid, setting.bank).with_context(named)?;
    let epsilons: Vec<f64> = (PRINTED_6_4.iter())
        .map(|p| epsilon_for(&pyramid, eye, p.chunks.1 / 100.0))
        .collect();
    let ms = |d: Duration| d.as_secs_f64() * 1e3;
    let rows = setting.rows(eye, &epsilons, false).with_context(named)?;
    Ok((rows.iter().zip(PRINTED_6_4))
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
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The shares of Table 6.4 follow from its counts, of 4681 chunks.
    #[test]
    fn shares_follow_from_the_counts() {
        for p in PRINTED_6_4 {
            let share = 100.0 * f64::from(p.chunks.0) / 4681.0;
            assert!((share - p.chunks.1).abs() < 0.6, "{p:?}: {share}");
        }
    }

    #[test]
    fn a_field_that_is_not_there_has_no_rows() {
        assert_eq!(measure(Path::new("no such file.nrrd")).unwrap(), []);
    }
}
