//! The figures of Steinberger's thesis, drawn again beside its numbers: 3.2, 4.5, 4.6 and 6.1 to 6.9.
//!
//! What is drawn is `isobar_octree::figures`. Every frame of `octree/cpu` here is held against certified roots in the same run, all its pixels; frames over
//! levels of detail against those of the coefficients they reconstruct; what draws algebraic surfaces on a lattice of pixels of each image. Data are those
//! of the repository: where the thesis shows others, ours stand in. A figure without its data is absent.

use anyhow::{Context, Result, bail};
use isobar_core::{Data, Frame, Grid, Stage, Stop, Surface, View};
use isobar_fields::{Kind, Reconstruction};
use isobar_octree::figures::Image;
use isobar_oracle::Truth;
use serde::{Deserialize, Serialize};
use std::path::Path;

pub mod detail;
pub mod surfaces;
pub mod volumes;

/// Folder of the pictures, from the page.
const FOLDER: &str = "files/imported-steinberger2010";

/// The figures.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Figures {
    /// Figure 3.2.
    pub blocks: Option<volumes::BlocksRow>,
    /// Figure 4.5.
    pub compressions: Vec<detail::CompressionRow>,
    /// Figures 4.6 and 6.7, in the order of Table 6.4.
    pub levels: Vec<detail::LevelPictures>,
    /// Figure 6.8.
    pub transition: Vec<detail::Shot>,
    /// Figure 6.9.
    pub topology: Vec<detail::TopologyRow>,
    /// Figure 6.1: ways and sizes, surface by surface.
    pub surfaces: Vec<surfaces::SurfaceTime>,
    /// Pictures of Figure 6.1: letter and file.
    pub surface_pictures: Vec<(char, String)>,
    /// Figures 6.2 to 6.5, and Table 6.2.
    pub degrees: Vec<volumes::DegreesRow>,
    /// Figure 6.6.
    pub closeup: Option<volumes::CloseupRow>,
    /// Seconds the figures took.
    pub seconds: f64,
}

/// A frame against certified roots, all its pixels.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Verified {
    /// Pixels compared.
    pub pixels: u64,
    /// Hits of the frame.
    pub hits: u64,
    /// Missed, false, on a wrong root; and refuted claims.
    pub wrong: u64,
    /// Pixels that f32-sized errors could change.
    pub undecidable: u64,
}

/// A picture with its frame's verdict.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Shown {
    /// File, from the page.
    pub file: String,
    /// Its frame.
    pub verified: Verified,
}

impl Figures {
    /// Every verdict, with what it is about.
    pub fn verdicts(&self) -> impl Iterator<Item = (&'static str, Verified)> + '_ {
        let blocks = self.blocks.iter().map(|b| ("3.2", b.shown.verified));
        let compressions = self.compressions.iter().map(|c| ("4.5", c.shown.verified));
        let levels = self.levels.iter().map(|l| ("4.6 and 6.7", l.shaded.verified));
        let transition = self.transition.iter().map(|s| ("6.8", s.shaded.verified));
        let topology = self.topology.iter().map(|t| ("6.9", t.shown.verified));
        let degrees = (self.degrees.iter()).flat_map(|d| d.degrees.iter().map(|k| ("6.2 to 6.5", k.shown.verified)));
        let closeup = self.closeup.iter().map(|c| ("6.6", c.exact.verified));
        (blocks.chain(compressions).chain(levels).chain(transition))
            .chain(topology)
            .chain(degrees)
            .chain(closeup)
    }

    /// Frames of `octree/cpu` with wrong pixels, a line each.
    #[must_use]
    pub fn trouble(&self) -> Vec<String> {
        (self.verdicts().filter(|(_, v)| v.wrong > 0))
            .map(|(figure, v)| {
                format!(
                    "Steinberger 2010, Figure {figure}: {} of {} pixels are wrong",
                    v.wrong, v.pixels
                )
            })
            .collect()
    }
}

/// Where the pictures go: the folder in which the page is put together.
#[derive(Debug, Clone, Copy)]
pub struct Album<'a> {
    /// The folder.
    pub stage: &'a Path,
}

impl Album<'_> {
    /// Writes a picture as PNG, under a temporary name first; the file from the page.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn save(&self, name: &str, image: &Image) -> Result<String> {
        let file = format!("{FOLDER}/{name}.png");
        let path = self.stage.join(&file);
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).with_context(|| format!("{} cannot be made", folder.display()))?;
        }
        let (width, height) = (u32::try_from(image.width)?, u32::try_from(image.height)?);
        let Some(picture) = image::RgbImage::from_raw(width, height, image.rgb.clone()) else {
            bail!("{name}: a picture has three bytes a pixel");
        };
        isobar::output::write_picture(&path, &picture)?;
        Ok(file)
    }
}

/// The grid in a file, `None` where there is no file.
///
/// # Errors
/// When it cannot be read or holds no grid.
pub fn load(file: &Path) -> Result<Option<Grid>> {
    if !file.exists() {
        return Ok(None);
    }
    let loaded = isobar_io::load(file, &isobar_io::Options::default()).with_context(|| file.display().to_string())?;
    match loaded.data {
        Data::Grid(grid) => Ok(Some(grid)),
        other => bail!("{} holds {}, not a grid", file.display(), other.kind()),
    }
}

/// Holds a frame against the certified first roots of its function.
///
/// # Errors
/// When the oracle has no answer for the function.
pub fn verify(frame: &Frame, grid: &Grid, kind: Kind, isovalue: f64, view: &View) -> Result<Verified> {
    let function = Reconstruction::Tensor(kind).of(grid, Stage::Stored)?;
    let surfaces = [Surface::isovalue(isovalue, 0)];
    let truth = Truth::compute(&function, &surfaces, view, &Stop::default())?;
    let check = isobar_oracle::check(frame, &truth, &function, &surfaces, view)?;
    Ok(Verified {
        pixels: check.pixels as u64,
        hits: check.hits as u64,
        wrong: (isobar::checking::wrong(&check) + check.refuted) as u64,
        undecidable: check.undecidable as u64,
    })
}

/// Writes the tables of the figures as CSV into `folder`, which exists.
///
/// # Errors
/// When a file cannot be written.
pub fn write(f: &Figures, folder: &Path) -> Result<()> {
    let tables = [
        volumes::blocks_table(f),
        detail::compressions_table(f),
        detail::levels_table(f),
        detail::transition_table(f),
        detail::topology_table(f),
        surfaces::table(f),
        volumes::degrees_table(f),
        volumes::closeup_table(f),
    ];
    for Table { name, head, rows } in tables.into_iter().filter(|t| !t.rows.is_empty()) {
        let path = folder.join(name);
        let mut w = csv::Writer::from_path(&path).with_context(|| format!("{} cannot be written", path.display()))?;
        w.write_record(head)?;
        for row in rows {
            w.write_record(row)?;
        }
        w.flush()?;
    }
    Ok(())
}

/// A CSV file.
#[derive(Debug)]
pub(crate) struct Table {
    pub(crate) name: &'static str,
    pub(crate) head: Vec<&'static str>,
    pub(crate) rows: Vec<Vec<String>>,
}

/// The columns of a verdict.
const VERDICT: [&str; 4] = ["pixels_checked", "hits", "wrong", "undecidable"];

impl Verified {
    fn cells(&self) -> [String; 4] {
        [self.pixels, self.hits, self.wrong, self.undecidable].map(|n| n.to_string())
    }
}

#[cfg(test)]
mod tests;
