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

/// Degrees of the columns.
pub const DEGREES: [&str; 3] = ["tri-linear", "tri-square", "tri-cubic"];

/// Table 6.3 (a), milliseconds (paper-numbers: Steinberger2010, Tab6.3a): per data set five stages, per stage the three degrees. GeForce GTX 285 and Core i7,
/// 1024x768.
pub const PRINTED_6_3: [(&str, [[f64; 3]; 5]); 4] = [
    (
        "Bucky 32³",
        [
            [0.40, 0.39, 0.41],
            [21.96, 32.95, 40.47],
            [5.46, 21.92, 75.55],
            [0.62, 6.30, 22.29],
            [0.21, 2.32, 10.56],
        ],
    ),
    (
        "Dragon 128³",
        [
            [0.40, 0.40, 0.39],
            [54.06, 92.94, 114.9],
            [2.51, 11.88, 41.44],
            [0.67, 4.52, 21.58],
            [0.41, 2.90, 17.78],
        ],
    ),
    (
        "Foot 256³",
        [
            [0.40, 0.39, 0.40],
            [100.2, 205.0, 224.0],
            [3.85, 22.22, 67.16],
            [1.26, 6.73, 23.48],
            [0.71, 4.34, 22.58],
        ],
    ),
    (
        "Vertebra 512³",
        [
            [0.42, 0.42, 0.42],
            [98.64, 173.6, 214.1],
            [4.33, 20.11, 64.23],
            [0.77, 4.53, 17.24],
            [0.37, 2.50, 15.74],
        ],
    ),
];

/// Stages of [`PRINTED_6_3`].
pub const STAGES: [&str; 5] = ["setup", "traverse", "composition + load", "rootfind", "normal calc + store"];

/// Table 6.1, percent of a frame (paper-numbers: Steinberger2010, Tab6.1): per stage the three degrees. GeForce GTX 285.
pub const PRINTED_6_1: [[f64; 3]; 7] = [
    [8.390, 0.903, 0.187],
    [6.936, 0.743, 0.141],
    [6.090, 0.676, 0.139],
    [3.941, 1.823, 1.029],
    [71.017, 93.551, 97.489],
    [1.546, 1.732, 0.972],
    [2.079, 0.571, 0.042],
];

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

#[cfg(test)]
mod tests {
    use super::*;

    /// The columns of Table 6.1 are parts of a whole.
    #[test]
    fn shares_of_table_6_1_sum_to_a_hundred() {
        for degree in 0..3 {
            let all: f64 = PRINTED_6_1.iter().map(|s| s[degree]).sum();
            assert!((all - 100.0).abs() < 0.01, "{}: {all}", DEGREES[degree]);
        }
    }

    /// The relative half of Table 6.3 follows from the absolute one: the copies hold together.
    #[test]
    fn shares_follow_from_the_times() {
        // Table 6.3 (b): traversal, percent.
        let printed = [
            [76.65, 51.58, 27.11],
            [93.11, 82.51, 58.61],
            [94.16, 85.89, 66.35],
            [94.37, 86.31, 68.69],
        ];
        for ((name, stages), shares) in PRINTED_6_3.iter().zip(printed) {
            for (degree, share) in shares.iter().enumerate() {
                let whole: f64 = stages.iter().map(|s| s[degree]).sum();
                let found = 100.0 * stages[1][degree] / whole;
                assert!((found - share).abs() < 0.06, "{name} {}: {found}", DEGREES[degree]);
            }
        }
    }
}
