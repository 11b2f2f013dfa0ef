//! Two levels of min/max blocks over a lattice's cells, so that rays pass empty space in strides.

use isobar_core::{Interval, Lattice};
use rayon::prelude::*;

/// Cells per edge of a block, and blocks per edge of a superblock.
pub(crate) const BLOCK: usize = 8;

/// See the module.
#[derive(Debug)]
pub(crate) struct Skip {
    /// Blocks per axis.
    pub(crate) blocks: [usize; 3],
    /// Superblocks per axis.
    pub(crate) supers: [usize; 3],
    block_ranges: Vec<Interval>,
    super_ranges: Vec<Interval>,
}

/// Indices of an array of `n` per axis, x fastest.
fn unflatten(i: usize, n: [usize; 3]) -> [usize; 3] {
    [i % n[0], i / n[0] % n[1], i / (n[0] * n[1])]
}

impl Skip {
    /// Ranges of all blocks, each from [`Lattice::range`]; parallel over blocks.
    pub(crate) fn new(lattice: &dyn Lattice) -> Self {
        Self::of(lattice.cells(), |lo, hi| lattice.range(lo, hi))
    }

    /// The same for any function on cells whose range over a box of cells is known.
    pub(crate) fn of(cells: [usize; 3], range: impl Fn([usize; 3], [usize; 3]) -> Interval + Sync) -> Self {
        let blocks = cells.map(|n| n.div_ceil(BLOCK));
        let supers = blocks.map(|n| n.div_ceil(BLOCK));
        let block_ranges: Vec<Interval> = (0..blocks.iter().product::<usize>())
            .into_par_iter()
            .map(|i| {
                let b = unflatten(i, blocks);
                let lo = b.map(|i| i * BLOCK);
                let hi = std::array::from_fn(|a| (lo[a] + BLOCK - 1).min(cells[a] - 1));
                range(lo, hi)
            })
            .collect();
        let super_ranges = (0..supers.iter().product::<usize>())
            .map(|i| {
                let s = unflatten(i, supers);
                let mut all: Option<Interval> = None;
                for k in s[2] * BLOCK..((s[2] + 1) * BLOCK).min(blocks[2]) {
                    for j in s[1] * BLOCK..((s[1] + 1) * BLOCK).min(blocks[1]) {
                        for i in s[0] * BLOCK..((s[0] + 1) * BLOCK).min(blocks[0]) {
                            let r = block_ranges[(k * blocks[1] + j) * blocks[0] + i];
                            all = Some(all.map_or(r, |x| x.union(r)));
                        }
                    }
                }
                all.unwrap_or(Interval::ALL)
            })
            .collect();
        Self {
            blocks,
            supers,
            block_ranges,
            super_ranges,
        }
    }

    /// Range of a block.
    pub(crate) fn block(&self, [i, j, k]: [usize; 3]) -> Interval {
        self.block_ranges[(k * self.blocks[1] + j) * self.blocks[0] + i]
    }

    /// Range of a superblock.
    pub(crate) fn superblock(&self, [i, j, k]: [usize; 3]) -> Interval {
        self.super_ranges[(k * self.supers[1] + j) * self.supers[0] + i]
    }
}
