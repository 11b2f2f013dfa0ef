//! What drawing over levels of detail gains over the volume at full resolution, and at which error.

use anyhow::{Result, bail};
use isobar_core::{Camera, Data, View};
use isobar_fields::Synthetic;
use isobar_octree::wavelet::Bank;
use isobar_octree::wavelet::table::Setting;
use serde::{Deserialize, Serialize};
use std::fmt::Write;
use std::time::Duration;

/// The field: small enough for every report.
pub const FIELD: (&str, f64) = ("gyroid,n=257", 0.2);

/// Images of the bench view: about a pixel a voxel, and half a pixel.
const SIZES: [(usize, usize); 2] = [(512, 384), (256, 192)];

/// Pieces of coarser levels are seen at most so many pixels wide.
const PIXELS: [f64; 3] = [2.0, 4.0, 8.0];

/// Times are of CPU, one thread, milliseconds.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct GainRow {
    /// Width and height of the image.
    pub size: String,
    /// Width of a voxel in the middle, pixels.
    pub voxel: f64,
    /// Widest piece of a coarser level, pixels.
    pub pixels: f64,
    /// The levels drawn, finest first; 0 is full resolution.
    pub levels: String,
    /// To select, reconstruct and lay out the lattices from nothing.
    pub anew: f64,
    /// The same from one frame to the next, the eye moved by a degree.
    pub moved: f64,
    /// Of the frame over levels.
    pub frame: f64,
    /// Of the frame at full resolution, interleaved with it.
    pub full: f64,
    /// Mean squared difference of linear colour over pixels hit, times 1000.
    pub mse: f64,
    /// Of the distance between the first hits along the ray, voxels.
    pub median: f64,
    /// See `median`.
    pub p99: f64,
    /// Pixels hit in one picture only.
    pub one_sided: u64,
    /// Pixels hit at full resolution.
    pub hits: u64,
}

/// Measures the rows.
///
/// # Errors
/// When a frame cannot be drawn.
pub fn measure() -> Result<Vec<GainRow>> {
    let Data::Grid(grid) = FIELD.0.parse::<Synthetic>()?.data()? else {
        bail!("{} is no grid", FIELD.0);
    };
    let ms = |d: Duration| d.as_secs_f64() * 1e3;
    let mut out = Vec::new();
    for (width, height) in SIZES {
        let view = View::bench(width, height);
        let Camera::Perspective { eye, target, .. } = view.camera else {
            bail!("the bench view is in perspective");
        };
        let setting = Setting {
            grid: &grid,
            bank: Bank::Psi42,
            isovalue: FIELD.1,
            view: &view,
            method: &isobar_octree::OCTREE_CPU,
            threads: 1,
            clock: isobar::machine::cpu_time,
        };
        let voxel = grid.spacing.min_element() / view.footprint(eye.distance(target));
        for g in setting.gains(&PIXELS)? {
            let mut levels = String::new();
            for (level, _) in g.levels.iter().filter(|l| l.1 > 0) {
                let _ = write!(levels, "{}{level}", if levels.is_empty() { "" } else { ", " });
            }
            out.push(GainRow {
                size: format!("{width}×{height}"),
                voxel,
                pixels: g.pixels,
                levels,
                anew: ms(g.anew),
                moved: ms(g.select),
                frame: ms(g.render),
                full: ms(g.full),
                mse: g.difference.mse * 1e3,
                median: g.difference.voxels[0],
                p99: g.difference.voxels[1],
                one_sided: g.difference.one_sided as u64,
                hits: g.hits as u64,
            });
        }
    }
    Ok(out)
}
