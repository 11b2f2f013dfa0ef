//! Tables 6.1 and 6.3 of Steinberger's thesis: the stages of a frame.
//!
//! The thesis clocked its stages. So does `isobar_octree::stages`, tile by tile on one thread, since the rays of a packet are in different stages at once; `octree/cpu`
//! itself has no clock in it and counts the work of each stage. Table 6.1 is of the thesis's three algebraic surfaces, drawn by its pipeline with a clock between the stages of a
//! row of pixels (`isobar_octree::comparators::algebraic`).

use anyhow::{Result, bail};
use isobar_core::{Data, View};
use isobar_fields::Synthetic;
use isobar_octree::comparators::algebraic::{Composition, Drawn, Extent, Surface, draw};
use isobar_octree::finders::Finder;
use serde::{Deserialize, Serialize};

pub use isobar_octree::comparators::algebraic::STAGES as STAGES_6_1;
pub use isobar_octree::figures::printed::{TABLE_6_1 as PRINTED_6_1, TABLE_6_3 as PRINTED_6_3};

/// Degrees of the columns.
pub const DEGREES: [&str; 3] = ["tri-linear", "tri-square", "tri-cubic"];

/// Stages of [`PRINTED_6_3`].
pub const STAGES: [&str; 5] = ["setup", "traverse", "composition + load", "rootfind", "normal calc + store"];

/// Frames of which the fastest counts.
const REPEATS: usize = 3;

/// A frame of one of the surfaces of Figure 6.1, 1024x768, one thread.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct SurfaceRow {
    /// SB1 and LR81 with 6 (d + 1) iterations in f32, as in the thesis; else the recommended composition and solver in f64.
    pub thesis: bool,
    /// Degree per axis.
    pub degree: u64,
    /// Milliseconds of the wall clock, by [`STAGES_6_1`].
    pub stages: [f64; 7],
    /// Pixels hit.
    pub hits: u64,
}

/// Measures Table 6.1, both ways.
///
/// # Errors
/// When a surface cannot be drawn.
pub fn measure() -> Result<Vec<SurfaceRow>> {
    let mut out = Vec::new();
    for thesis in [true, false] {
        out.push(surface::<1, 4>("a", thesis)?);
        out.push(surface::<2, 7>("b", thesis)?);
        out.push(surface::<3, 10>("c", thesis)?);
    }
    Ok(out)
}

fn surface<const D: usize, const M: usize>(letter: &str, thesis: bool) -> Result<SurfaceRow> {
    let Data::Algebraic(p) = format!("steinberger-{letter},as=algebraic").parse::<Synthetic>()?.data()? else {
        bail!("steinberger-{letter} is no polynomial");
    };
    let view = View::fit((p.lo, p.hi), 40.0, 1024, 768);
    let iterations = 6 * (D as u32 + 1);
    let mut best: Option<Drawn> = None;
    for _ in 0..REPEATS {
        let drawn = if thesis {
            let finder = Finder::Lr81 { iterations };
            draw::<f32, D, M>(&Surface::new(&p)?, &view, Composition::Sb1, &finder, Extent::Box)?
        } else {
            let finder = Finder::Robust { width: 1e-9 };
            draw::<f64, D, M>(&Surface::new(&p)?, &view, Composition::Axis, &finder, Extent::Box)?
        };
        if best.as_ref().is_none_or(|b| drawn.total() < b.total()) {
            best = Some(drawn);
        }
    }
    let Some(best) = best else { bail!("nothing was drawn") };
    Ok(SurfaceRow {
        thesis,
        degree: D as u64,
        stages: best.stages.map(|s| s.as_secs_f64() * 1e3),
        hits: best.points.iter().filter(|p| p.is_finite()).count() as u64,
    })
}
