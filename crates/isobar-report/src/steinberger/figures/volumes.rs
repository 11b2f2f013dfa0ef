//! Volumes by `octree/cpu`: Figures 3.2, 6.2 to 6.5 with Table 6.2, and 6.6.

use super::{Album, Figures, Shown, Table, VERDICT, load, verify};
use anyhow::{Context, Result, bail};
use isobar_core::{Channels, Data, Grid, View};
use isobar_fields::{Kind, Synthetic};
use isobar_octree::blocks::BlockClass;
use isobar_octree::comparators::texture::{Angles, FRACTION_BITS};
use isobar_octree::figures::classes::Classes;
use isobar_octree::figures::closeup::{BITS, Closeup, near};
use isobar_octree::figures::degrees::{Bricks, KINDS};
use isobar_octree::figures::{Image, Scene};
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;

/// A volume of a figure: where it is and what is drawn of it.
#[derive(Debug, Clone, Copy)]
pub struct Volume {
    /// Path from `bench-data`, or a synthetic field with its samples.
    pub file: &'static str,
    /// Data units.
    pub isovalue: f64,
    /// What it is, for the caption.
    pub title: &'static str,
}

impl Volume {
    /// The grid, `None` where its file is absent.
    ///
    /// # Errors
    /// When it cannot be read or holds no grid.
    fn open(&self, data: &Path) -> Result<Option<Arc<Data>>> {
        if let Some(spec) = self.file.strip_prefix("synthetic:") {
            return Ok(Some(Arc::new(spec.parse::<Synthetic>()?.data()?)));
        }
        Ok(load(&data.join(self.file))?.map(|g| Arc::new(Data::Grid(g))))
    }
}

fn grid(data: &Data) -> Result<&Grid> {
    match data {
        Data::Grid(g) => Ok(g),
        other => bail!("{} instead of a grid", other.kind()),
    }
}

/// Figure 3.2.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct BlocksRow {
    /// The volume.
    pub title: String,
    /// Blocks of the image.
    pub blocks: u64,
    /// Of the rectangle.
    pub launched: u64,
    /// Finished at the box, without a candidate, polynomials without a root, hit.
    pub classes: [u64; 4],
    /// The picture.
    pub shown: Shown,
}

/// The volume of Figure 3.2, for Bucky.
pub const BLOCKS: Volume = Volume {
    file: "skull_2.9.nhdr",
    isovalue: 2.9,
    title: "the skull, 64³, at 2.9",
};

/// Figure 3.2; nothing where its data are not there.
///
/// # Errors
/// When the frame cannot be drawn or checked, or the picture not be written.
pub fn blocks(data: &Path, album: Album<'_>, out: &mut Figures) -> Result<()> {
    let Some(volume) = BLOCKS.open(data)? else {
        return Ok(());
    };
    let view = View::fit(volume.bounds(), 40.0, 512, 512);
    let kind = Kind::Cubic;
    let classes = Classes::draw(&Scene {
        data: &volume,
        isovalue: BLOCKS.isovalue,
        kind,
        view: &view,
    })?;
    let named = [
        BlockClass::MissesBox,
        BlockClass::NoCandidate,
        BlockClass::Composed,
        BlockClass::Hit,
    ];
    out.blocks = Some(BlocksRow {
        title: BLOCKS.title.into(),
        blocks: classes.blocks.classes.len() as u64,
        launched: classes.blocks.launched_blocks() as u64,
        classes: named.map(|c| classes.blocks.count(c) as u64),
        shown: Shown {
            file: album.save("figure-3.2", &classes.image(&view))?,
            verified: verify(&classes.frame, grid(&volume)?, kind, BLOCKS.isovalue, &view).context("Figure 3.2")?,
        },
    });
    Ok(())
}

/// One degree of a volume.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Degree {
    /// The reconstruction.
    pub kind: String,
    /// Milliseconds of the wall clock, all threads, claims on.
    pub frame: f64,
    /// The picture.
    pub shown: Shown,
}

/// One of Figures 6.2 to 6.5 with its column of Table 6.2.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct DegreesRow {
    /// The figure.
    pub figure: String,
    /// The volume.
    pub title: String,
    /// Tri-linear, tri-quadratic, tri-cubic.
    pub degrees: Vec<Degree>,
    /// Bricks of 2^3 cells: active, all; then those of 4^3.
    pub bricks: [[u64; 2]; 2],
    /// Picture of the active bricks of 2^3 cells.
    pub bricks_file: String,
}

/// The volumes of Figures 6.2 to 6.5, in that order.
pub const VOLUMES: [Volume; 4] = [
    Volume {
        file: "heart.vti",
        isovalue: 50.5,
        title: "a heart, 32×32×12, at 50.5",
    },
    Volume {
        file: "cache/dragon_128.nrrd",
        isovalue: 0.0,
        title: "another dragon's distance field, 128³, at 0",
    },
    Volume {
        file: "ch2.nii.gz",
        isovalue: 30.5,
        title: "a head by magnetic resonance, 181×217×181, at 30.5",
    },
    Volume {
        file: "synthetic:gyroid,n=512",
        isovalue: 0.2,
        title: "the gyroid, 512³, at 0.2",
    },
];

/// One of Figures 6.2 to 6.5; nothing where its data are not there.
///
/// # Errors
/// As [`blocks`].
pub fn degrees(data: &Path, figure: &str, v: &Volume, size: [usize; 2], album: Album<'_>, out: &mut Figures) -> Result<()> {
    let Some(volume) = v.open(data)? else {
        return Ok(());
    };
    let samples = grid(&volume)?;
    let view = View::fit(volume.bounds(), 40.0, size[0], size[1]);
    let mut row = DegreesRow {
        figure: figure.to_owned(),
        title: v.title.into(),
        ..DegreesRow::default()
    };
    for kind in KINDS {
        let scene = Scene {
            data: &volume,
            isovalue: v.isovalue,
            kind,
            view: &view,
        };
        let wanted = Channels::T | Channels::NORMAL | Channels::SURFACE | Channels::RGBA | isobar::checking::CHANNELS;
        let (frame, wall) = scene.draw(wanted, 0, 3)?;
        let name = format!("figure-{figure}-{}", kind.name());
        row.degrees.push(Degree {
            kind: kind.name().into(),
            frame: wall.as_secs_f64() * 1e3,
            shown: Shown {
                file: album.save(&name, &Image::linear(&view, &frame.rgba))?,
                verified: verify(&frame, samples, kind, v.isovalue, &view).context(name)?,
            },
        });
    }
    let bricks = Bricks::new(samples, v.isovalue, 2);
    let coarse = Bricks::new(samples, v.isovalue, 4);
    row.bricks = [&bricks, &coarse].map(|b| [b.active() as u64, b.active.len() as u64]);
    row.bricks_file = album.save(&format!("figure-{figure}-bricks"), &bricks.image(&view))?;
    out.degrees.push(row);
    Ok(())
}

/// Texture sampling in the close-up.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct SampledRow {
    /// Bits of a fetch's fraction; none: those of f32.
    pub bits: Option<u32>,
    /// Degrees between its gradient and the exact one at the exact hits: median, 99 %, greatest.
    pub at_exact_hits: [f64; 3],
    /// The same at its own hits.
    pub at_own_hits: [f64; 3],
    /// Pixels hit by one of the two only.
    pub one_sided: u64,
    /// Voxels between the two hits: median, 99 %, greatest.
    pub off: [f64; 3],
}

/// Figure 6.6.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct CloseupRow {
    /// The volume.
    pub title: String,
    /// Voxels from the eye to the surface.
    pub voxels: f64,
    /// Degrees between the normals of `octree/cpu` and the exact gradients: median, 99 %, greatest.
    pub octree: [f64; 3],
    /// By bits.
    pub sampled: Vec<SampledRow>,
    /// The frame of `octree/cpu`.
    pub exact: Shown,
    /// Picture with the weights of a texture unit.
    pub sampled_file: String,
    /// Picture of the angle between the normals of the two.
    pub angle_file: String,
}

/// The volume of Figure 6.6, for the vertebra.
pub const CLOSEUP: Volume = Volume {
    file: "heart.vti",
    isovalue: 50.5,
    title: "the heart, 32×32×12, at 50.5",
};

/// Voxels from the eye to the surface.
const NEAR: f64 = 1.0;

/// Figure 6.6; nothing where its data are not there.
///
/// # Errors
/// As [`blocks`].
pub fn closeup(data: &Path, size: [usize; 2], album: Album<'_>, out: &mut Figures) -> Result<()> {
    let Some(volume) = CLOSEUP.open(data)? else {
        return Ok(());
    };
    let overview = View::fit(volume.bounds(), 40.0, size[0], size[1]);
    let view = near(&volume, CLOSEUP.isovalue, &overview, NEAR, size)?;
    let exact = Closeup::draw(&volume, CLOSEUP.isovalue, view)?;
    let three = |a: &Angles| [a.p50, a.p99, a.max];
    let mut row = CloseupRow {
        title: CLOSEUP.title.into(),
        voxels: NEAR,
        octree: three(&exact.angles),
        exact: Shown {
            file: album.save("figure-6.6-octree", &exact.image())?,
            verified: verify(&exact.frame, grid(&volume)?, Kind::Cubic, CLOSEUP.isovalue, &exact.view).context("Figure 6.6")?,
        },
        ..CloseupRow::default()
    };
    for bits in BITS {
        let s = exact.sample(bits)?;
        row.sampled.push(SampledRow {
            bits,
            at_exact_hits: three(&s.at_exact_hits),
            at_own_hits: three(&s.at_own_hits),
            one_sided: s.one_sided as u64,
            off: s.off,
        });
        if bits == Some(FRACTION_BITS) {
            row.sampled_file = album.save("figure-6.6-sampled", &exact.sampled_image(&s))?;
            row.angle_file = album.save("figure-6.6-angle", &exact.angle_image(&s))?;
        }
    }
    out.closeup = Some(row);
    Ok(())
}

pub(super) fn blocks_table(f: &Figures) -> Table {
    let row = |b: &BlocksRow| {
        let mut line = vec![b.title.clone()];
        line.extend([b.blocks, b.launched].iter().chain(&b.classes).map(ToString::to_string));
        line.extend(b.shown.verified.cells());
        line
    };
    let head = [
        "volume",
        "blocks",
        "launched",
        "finished_at_box",
        "no_candidate",
        "polynomials_without_root",
        "hit",
    ];
    Table {
        name: "figure-3.2.csv",
        head: head
            .into_iter()
            .chain(VERDICT.map(|v| if v == "hits" { "pixels_hit" } else { v }))
            .collect(),
        rows: f.blocks.iter().map(row).collect(),
    }
}

pub(super) fn degrees_table(f: &Figures) -> Table {
    let row = |d: &DegreesRow, k: &Degree| {
        let mut line = vec![d.figure.clone(), d.title.clone(), k.kind.clone(), format!("{:.4}", k.frame)];
        line.extend(d.bricks.as_flattened().iter().map(ToString::to_string));
        line.extend(k.shown.verified.cells());
        line
    };
    let head = [
        "figure",
        "volume",
        "reconstruction",
        "frame_ms",
        "active_bricks_2",
        "bricks_2",
        "active_bricks_4",
        "bricks_4",
    ];
    Table {
        name: "figures-6.2-to-6.5.csv",
        head: head.into_iter().chain(VERDICT).collect(),
        rows: (f.degrees.iter())
            .flat_map(|d| d.degrees.iter().map(move |k| row(d, k)))
            .collect(),
    }
}

pub(super) fn closeup_table(f: &Figures) -> Table {
    let mut rows = Vec::new();
    if let Some(c) = &f.closeup {
        let mut line = vec!["octree/cpu".to_owned(), String::new()];
        line.extend(c.octree.iter().chain(&c.octree).map(|x| format!("{x:e}")));
        line.extend(["0", "0", "0", "0"].map(String::from));
        rows.push(line);
        for s in &c.sampled {
            let bits = s.bits.map_or_else(|| "f32".to_owned(), |b| b.to_string());
            let mut line = vec!["texture sampling".to_owned(), bits];
            line.extend(s.at_exact_hits.iter().chain(&s.at_own_hits).map(|x| format!("{x:e}")));
            line.push(s.one_sided.to_string());
            line.extend(s.off.map(|x| format!("{x:e}")));
            rows.push(line);
        }
    }
    Table {
        name: "figure-6.6.csv",
        head: vec![
            "method",
            "bits",
            "normal_at_exact_hits_median_degrees",
            "p99",
            "max",
            "normal_at_own_hits_median_degrees",
            "own_p99",
            "own_max",
            "one_sided",
            "off_median_voxels",
            "off_p99",
            "off_max",
        ],
        rows,
    }
}
