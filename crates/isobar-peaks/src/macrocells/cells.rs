//! The range of every cell in two bytes, so that a new transfer function does not read the samples again.
//!
//! Least and greatest value of a cell, rounded outward to whole parts of its macrocell's range: 255ths of it, or ones where samples are whole numbers and it is at most 255, so that 8 bits lose nothing.
//! The 64 cells of a macrocell lie side by side in two cache lines, where their samples are spread over 25.

use super::{Macrocells, bit, node_at, span};
use crate::interval::{Bands, packed};
use crate::volume::{Form, Linear, Volume};
use isobar_core::Samples;
use isobar_cpu::{Kernel, Level};
use rayon::prelude::*;

/// The ranges of all cells of a volume.
#[derive(Debug)]
pub(super) struct CellRanges {
    /// Per macrocell, by [`super::slot`], the least and the greatest of its cells by their [`bit`]; anything beyond the volume.
    cells: Vec<[[u8; 64]; 2]>,
    /// Samples are whole numbers.
    whole: bool,
}

/// More than twice of what a place among the parts is off by in f32.
const SLACK: f32 = 1e-3;

/// Parts per value of a macrocell with this range; 0 where that is no number, or beyond f32.
#[inline(always)]
fn parts(least: f32, most: f32, whole: bool) -> f32 {
    let range = most - least;
    if whole && range <= 255.0 {
        1.0
    } else if range.is_finite() {
        255.0 / range
    } else {
        0.0
    }
}

impl CellRanges {
    /// In parallel on the calling pool.
    pub(super) fn new(volume: &Volume, nodes: [i32; 3], dims: [i32; 3], level: Level) -> Self {
        let count = nodes.iter().map(|&n| n as usize).product::<usize>();
        let whole = !matches!(volume.spline.grid().samples, Samples::F32(_));
        let mut cells = vec![[[0; 64]; 2]; 64 * count];
        cells.par_chunks_mut(64).enumerate().for_each(|(n, out)| {
            level.run(LookAtNode {
                volume,
                whole,
                box_of: span(node_at(n, nodes), dims),
                out,
            });
        });
        Self { cells, whole }
    }

    pub(super) fn bytes(&self) -> usize {
        size_of_val(self.cells.as_slice())
    }

    /// The cells of a macrocell that meet an interval of `wanted`, with others perhaps that come near one.
    #[inline(always)]
    pub(super) fn mask(&self, slot: usize, macros: &Macrocells, wanted: &Bands) -> u64 {
        let (least, most) = (macros.least.as_flattened()[slot], macros.most.as_flattened()[slot]);
        let per = parts(least, most, self.whole);
        let [lo, hi] = &self.cells[slot];
        let mut meets = [0u8; 64];
        for &[a, b] in wanted.iter() {
            if !(a <= most && b >= least) {
                continue;
            }
            // Places of both ends. Casts are saturating, and a place beyond either end of the macrocell is that end; NaN, from an end at infinity where there are no parts, is 0.
            let from = ((a - least) * per - SLACK).ceil() as u8;
            let to = ((b - least) * per + SLACK).floor();
            let to = if to.is_nan() { 255 } else { to as u8 };
            for i in 0..64 {
                meets[i] |= u8::from(lo[i] <= to) & u8::from(hi[i] >= from);
            }
        }
        packed(&meets)
    }
}

struct LookAtNode<'a> {
    volume: &'a Volume,
    whole: bool,
    /// First and last macrocell.
    box_of: ([i32; 3], [i32; 3]),
    out: &'a mut [[[u8; 64]; 2]],
}

impl Kernel for LookAtNode<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let form = Linear::new(self.volume);
        let cells = self.volume.space.cells;
        let (lo, hi) = self.box_of;
        for k in lo[2]..=hi[2] {
            for j in lo[1]..=hi[1] {
                for i in lo[0]..=hi[0] {
                    let (first, last) = span([i, j, k], cells);
                    let (a, b) = form.extremes(first, last);
                    let (mut least, mut most) = (f32::INFINITY, f32::NEG_INFINITY);
                    for z in 0..=last[2] - first[2] {
                        for y in 0..=last[1] - first[1] {
                            for x in 0..=last[0] - first[0] {
                                let at = bit([x, y, z]) as usize;
                                (least, most) = (least.min(a[at]), most.max(b[at]));
                            }
                        }
                    }
                    let per = parts(least, most, self.whole);
                    let [low, high] = &mut self.out[bit([i, j, k]) as usize];
                    for c in 0..64 {
                        let (x, y) = ((a[c] - least) * per, (b[c] - least) * per);
                        // What is not a number is anything.
                        (low[c], high[c]) = if per > 0.0 && x <= y {
                            (x.floor() as u8, y.ceil() as u8)
                        } else {
                            (0, 255)
                        };
                    }
                }
            }
        }
    }
}
