//! Levels of detail: Figures 4.5, 4.6, 6.7, 6.8 and 6.9.

use super::{Album, Figures, Shown, Table, VERDICT, load, verify};
use crate::steinberger::levels::Field;
use anyhow::{Context, Result};
use isobar_core::View;
use isobar_fields::Kind;
use isobar_octree::figures::levels::{SHARES, transition};
use isobar_octree::figures::{Image, printed::TABLE_6_4, topology};
use isobar_octree::wavelet::Bank;
use isobar_octree::wavelet::table::{Picture, Row, Setting, level_picture};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Figure 4.5: the greatest coefficients alone.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct CompressionRow {
    /// Greatest by their own magnitude, or by magnitude times the norm of their basis function.
    pub weighted: bool,
    /// Coefficients kept.
    pub kept: u64,
    /// Of all, percent.
    pub share: f64,
    /// Root mean square and greatest difference of the spline coefficients, voxels of the distance field.
    pub rms: f64,
    /// See `rms`.
    pub max: f64,
    /// Mean squared difference of linear colour over pixels hit, times 1000.
    pub mse: f64,
    /// Root mean square distance of the hits along the ray, voxels.
    pub depth: f64,
    /// Pixels hit in one picture only.
    pub one_sided: u64,
    /// The picture.
    pub shown: Shown,
}

/// The pictures of a row of Table 6.4.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct LevelPictures {
    /// Figure 6.7's letter.
    pub figure: String,
    /// Shaded; the frame is that of the row's coefficients at full resolution.
    pub shaded: Shown,
    /// By level of detail.
    pub by_level: String,
    /// Pixels of the frame over levels, which is the one timed, whose hit is farther than 1e-3 voxel from that of the shaded one.
    pub differ: u64,
    /// Finest chunks by the finest level whose details act there, level 0 first.
    pub chunks_by_level: Vec<u64>,
}

/// A picture of Figure 6.8.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Shot {
    /// What it shows.
    pub name: String,
    /// Shaded.
    pub shaded: Shown,
    /// By level of detail.
    pub by_level: String,
}

/// Figure 6.9.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct TopologyRow {
    /// Which details are left.
    pub details: String,
    /// Chunks with details that act.
    pub chunks: u64,
    /// Connected parts of the samples at or above the isovalue: all, those of 64 samples and more, samples of the largest.
    pub above: [u64; 3],
    /// Of those below it.
    pub below: [u64; 3],
    /// The picture.
    pub shown: Shown,
}

/// Figures 4.5, 4.6, 6.7 and 6.8 of the field of Table 6.4, from the rows of that table.
///
/// # Errors
/// When a frame cannot be drawn or checked, or a picture not be written.
pub fn dragon(field: &Field, rows: &[(Row, Picture)], album: Album<'_>, out: &mut Figures) -> Result<()> {
    let table = field.setting(1);
    for ((row, picture), printed) in rows.iter().zip(TABLE_6_4) {
        let letter = printed.figure;
        out.levels.push(LevelPictures {
            figure: letter.into(),
            shaded: shown(&table, picture, album, &format!("figure-6.7-{letter}"))?,
            by_level: album.save(
                &format!("figure-4.6-{letter}"),
                &Image::linear(table.view, &level_picture(&table, row, picture)),
            )?,
            differ: row.levels.differ as u64,
            chunks_by_level: row.by_level.iter().map(|&n| n as u64).collect(),
        });
    }
    if let Some((row, picture)) = rows.get(1) {
        for s in transition(&table, row, picture)? {
            let name = format!("figure-6.8-{}", s.name.replace(' ', "-"));
            let seen = Setting { view: &s.view, ..table };
            out.transition.push(Shot {
                name: s.name.into(),
                shaded: shown(&seen, &s.picture, album, &name)?,
                by_level: album.save(&format!("{name}-levels"), &s.by_level)?,
            });
        }
    }
    let view = View::fit(field.grid.domain().world_bounds(), 40.0, 512, 384);
    let small = Setting {
        view: &view,
        ..field.setting(0)
    };
    let voxel = field.grid.spacing.min_element();
    for weighted in [false, true] {
        for (i, (c, picture)) in small.compressions(&SHARES, weighted)?.into_iter().enumerate() {
            let by = if weighted { "norm" } else { "magnitude" };
            out.compressions.push(CompressionRow {
                weighted,
                kept: c.kept as u64,
                share: 100.0 * c.share,
                rms: c.rms / voxel,
                max: c.max / voxel,
                mse: c.picture.mse * 1e3,
                depth: c.picture.depth,
                one_sided: c.picture.one_sided as u64,
                shown: shown(&small, &picture, album, &format!("figure-4.5-{by}-{i}"))?,
            });
        }
    }
    Ok(())
}

/// Saves a cubic frame and checks it.
fn shown(setting: &Setting<'_>, picture: &Picture, album: Album<'_>, name: &str) -> Result<Shown> {
    Ok(Shown {
        file: album.save(name, &Image::linear(setting.view, &picture.frame.rgba))?,
        verified: verify(&picture.frame, &picture.grid, Kind::Cubic, setting.isovalue, setting.view)
            .with_context(|| name.to_owned())?,
    })
}

/// The volume of Figure 6.9, from `bench-data`, and its isovalue; for the thesis's Bucky.
pub const TOPOLOGY: (&str, f64) = ("skull_2.9.nhdr", 2.9);

/// Share of the range below which details are off in the last row.
const MAGNITUDE: f64 = 0.2;

/// Figure 6.9; nothing where its data are not there.
///
/// # Errors
/// As [`dragon`].
pub fn parts(data: &Path, album: Album<'_>, out: &mut Figures) -> Result<()> {
    let Some(grid) = load(&data.join(TOPOLOGY.0))? else {
        return Ok(());
    };
    let view = View::fit(grid.domain().world_bounds(), 40.0, 384, 384);
    let setting = Setting {
        grid: &grid,
        bank: Bank::Psi42,
        isovalue: TOPOLOGY.1,
        view: &view,
        method: &isobar_octree::OCTREE_CPU,
        threads: 0,
        clock: isobar::machine::cpu_time,
    };
    let counts = |p: topology::Parts| [p.all, p.large, p.largest].map(|n| n as u64);
    for (i, s) in topology::stages(&setting, &[MAGNITUDE])?.into_iter().enumerate() {
        out.topology.push(TopologyRow {
            details: s.details,
            chunks: s.chunks as u64,
            above: counts(s.above),
            below: counts(s.below),
            shown: shown(&setting, &s.picture, album, &format!("figure-6.9-{i}"))?,
        });
    }
    Ok(())
}

pub(super) fn compressions_table(f: &Figures) -> Table {
    let head = [
        "weighted",
        "kept",
        "share_percent",
        "rms_voxels",
        "max_voxels",
        "mse_x1000",
        "depth_rms_voxels",
        "one_sided",
    ];
    let row = |c: &CompressionRow| {
        let mut line = vec![c.weighted.to_string(), c.kept.to_string()];
        line.extend([c.share, c.rms, c.max, c.mse, c.depth].map(|x| format!("{x:e}")));
        line.push(c.one_sided.to_string());
        line.extend(c.shown.verified.cells());
        line
    };
    Table {
        name: "figure-4.5.csv",
        head: head.into_iter().chain(VERDICT).collect(),
        rows: f.compressions.iter().map(row).collect(),
    }
}

pub(super) fn levels_table(f: &Figures) -> Table {
    let row = |l: &LevelPictures| {
        let chunks: Vec<String> = l.chunks_by_level.iter().map(ToString::to_string).collect();
        let mut line = vec![l.figure.clone(), chunks.join(" "), l.differ.to_string()];
        line.extend(l.shaded.verified.cells());
        line
    };
    Table {
        name: "figure-6.7.csv",
        head: ["figure", "finest_chunks_by_level", "pixels_that_differ_over_levels"]
            .into_iter()
            .chain(VERDICT)
            .collect(),
        rows: f.levels.iter().map(row).collect(),
    }
}

pub(super) fn transition_table(f: &Figures) -> Table {
    let row = |s: &Shot| std::iter::once(s.name.clone()).chain(s.shaded.verified.cells()).collect();
    Table {
        name: "figure-6.8.csv",
        head: std::iter::once("view").chain(VERDICT).collect(),
        rows: f.transition.iter().map(row).collect(),
    }
}

pub(super) fn topology_table(f: &Figures) -> Table {
    let head = [
        "details",
        "chunks",
        "parts_above",
        "parts_above_64",
        "largest_above",
        "parts_below",
        "parts_below_64",
        "largest_below",
    ];
    let row = |t: &TopologyRow| {
        let mut line = vec![t.details.clone(), t.chunks.to_string()];
        line.extend(t.above.iter().chain(&t.below).map(ToString::to_string));
        line.extend(t.shown.verified.cells());
        line
    };
    Table {
        name: "figure-6.9.csv",
        head: head.into_iter().chain(VERDICT).collect(),
        rows: f.topology.iter().map(row).collect(),
    }
}
