//! Macrocells: which blocks of the volume a ray need not look at (Knoll et al. 2009, section 6.1).
//!
//! Least and greatest value of every block of 4^3 cells, once per data set, and which blocks the transfer function or a surface can be seen in, anew
//! for each of these, in parallel. The paper's grid has 64^3 macrocells whatever the data; blocks of 4^3 cells are the same at 256^3. Different here: 64 macrocells share a
//! word, so that empty space is crossed in steps of 16 cells; and the cells of a macrocell have such a word too, made when a ray that finds exact crossings
//! first enters it, so that work follows what is visible. For filters without negative lobes the coefficients in reach bound a macrocell; for BC(2,1) the Bernstein
//! coefficients of its pieces do.

use crate::interval::Intervals;
use crate::space::{Dda, Walk, three};
use crate::volume::{Form, Smooth, Volume};
use isobar_core::Lattice;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

/// Cells per macrocell, and macrocells per node, along an axis, as a power of two.
pub(crate) const LOG: u32 = 2;
const SIDE: i32 = 1 << LOG;

/// Bit of a cell or macrocell in its word.
#[inline(always)]
pub(crate) fn bit([x, y, z]: [i32; 3]) -> u32 {
    ((z & 3) << 4 | (y & 3) << 2 | (x & 3)) as u32
}

/// The range of every macrocell.
#[derive(Debug)]
pub(crate) struct Macrocells {
    pub(crate) dims: [i32; 3],
    ranges: Vec<[f32; 2]>,
    /// Of the whole volume.
    pub(crate) range: (f64, f64),
}

/// Rounded so that it encloses.
fn outward(lo: f64, hi: f64) -> [f32; 2] {
    let (a, b) = (lo as f32, hi as f32);
    [
        if f64::from(a) > lo { a.next_down() } else { a },
        if f64::from(b) < hi { b.next_up() } else { b },
    ]
}

impl Macrocells {
    /// In parallel on the calling pool.
    pub(crate) fn new(volume: &Volume) -> Self {
        let cells = volume.space.cells;
        let dims = cells.map(|n| (n + SIDE - 1) >> LOG);
        let count = dims.iter().map(|&n| n as usize).product::<usize>();
        let mut ranges = vec![[0.0f32; 2]; count];
        ranges.par_chunks_mut(dims[0] as usize).enumerate().for_each(|(row, out)| {
            for (i, o) in out.iter_mut().enumerate() {
                let at = [i as i32, row as i32 % dims[1], row as i32 / dims[1]];
                let (lo, hi) = span(at, cells);
                *o = if volume.filter.has_negative_lobes() {
                    let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
                    Smooth::<4>(volume).ranges(lo, hi, |_, a, b| (least, most) = (least.min(a), most.max(b)));
                    outward(least, most)
                } else {
                    let r = volume.spline.range(lo.map(|x| x as usize), hi.map(|x| x as usize));
                    outward(r.lo, r.hi)
                };
            }
        });
        let range = ranges.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), r| {
            (a.min(r[0].into()), b.max(r[1].into()))
        });
        Self { dims, ranges, range }
    }

    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.ranges.as_slice())
    }

    /// Index of a macrocell.
    #[inline(always)]
    pub(crate) fn index(&self, [x, y, z]: [i32; 3]) -> usize {
        (z as usize * self.dims[1] as usize + y as usize) * self.dims[0] as usize + x as usize
    }
}

/// First and last cell of a macrocell.
#[inline(always)]
pub(crate) fn span(at: [i32; 3], cells: [i32; 3]) -> ([i32; 3], [i32; 3]) {
    (
        three(|a| at[a] << LOG),
        three(|a| ((at[a] << LOG) + SIDE - 1).min(cells[a] - 1)),
    )
}

/// The step multiplier of each macrocell: Knoll et al. 2009, section 6.2.
///
/// A macrocell's metric is the standard deviation of its samples over that of the volume, and its inverse lengthens the steps by an odd factor M. The print
/// ("M = 2m1 + 1") has lost what m is; here m = floor(log2(1 / metric)), between 0 and 3, so M is 1, 3, 5 or 7: a macrocell with half the
/// volume's deviation takes steps three times as long.
pub(crate) fn multipliers(volume: &Volume, macros: &Macrocells) -> Vec<u8> {
    let grid = volume.spline.grid();
    let dims = grid.dims;
    let cells = volume.space.cells;
    let moments = |lo: [usize; 3], hi: [usize; 3]| {
        let (mut n, mut sum, mut square) = (0.0, 0.0, 0.0);
        for k in lo[2]..=hi[2] {
            for j in lo[1]..=hi[1] {
                for i in lo[0]..=hi[0] {
                    let v = grid.samples.get((k * dims[1] + j) * dims[0] + i);
                    n += 1.0;
                    sum += v;
                    square += v * v;
                }
            }
        }
        (n, sum, square)
    };
    let deviation = |(n, sum, square): (f64, f64, f64)| (square / n - (sum / n) * (sum / n)).max(0.0).sqrt();
    let slices: Vec<_> = (0..dims[2])
        .into_par_iter()
        .map(|k| moments([0, 0, k], [dims[0] - 1, dims[1] - 1, k]))
        .collect();
    let whole = deviation(slices.iter().fold((0.0, 0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1, a.2 + b.2)));
    let row = macros.dims[0] as usize;
    let mut out = vec![1u8; macros.ranges.len()];
    out.par_chunks_mut(row).enumerate().for_each(|(r, out)| {
        for (i, m) in out.iter_mut().enumerate() {
            let at = [i as i32, r as i32 % macros.dims[1], r as i32 / macros.dims[1]];
            let (lo, hi) = span(at, cells);
            let end: [usize; 3] = std::array::from_fn(|a| (hi[a] as usize + 1).min(dims[a] - 1));
            let sigma = deviation(moments(lo.map(|x| x as usize), end));
            // 0/0 takes no longer steps; anything over 0 the longest.
            let ratio = whole / sigma;
            *m = if ratio.is_nan() {
                1
            } else {
                2 * (ratio.log2().clamp(0.0, 3.0) as u8) + 1
            };
        }
    });
    out
}

/// The macrocells, and later cells, in which anything can be seen.
#[derive(Debug)]
pub(crate) struct Visible {
    macros: [i32; 3],
    nodes: [i32; 3],
    cells: [i32; 3],
    words: Vec<AtomicU64>,
    /// Per macrocell its visible cells; [`UNKNOWN`] until a ray comes by.
    masks: Vec<AtomicU64>,
    wanted: Intervals,
    /// Nothing is skipped.
    all: bool,
}

/// The word of a macrocell whose cells have not been looked at. One without a visible cell is taken out of the nodes.
const UNKNOWN: u64 = 0;

impl Visible {
    /// Those that meet a value of `wanted`, or all of them.
    pub(crate) fn new(volume: &Volume, macros: &Macrocells, wanted: Intervals, all: bool) -> Self {
        let dims = macros.dims;
        let nodes = dims.map(|n| (n + SIDE - 1) >> LOG);
        let layer = nodes[0] as usize * nodes[1] as usize;
        let words: Vec<AtomicU64> = (0..layer * nodes[2] as usize)
            .into_par_iter()
            .with_min_len(nodes[0] as usize)
            .map(|n| {
                let at = [
                    (n % nodes[0] as usize) as i32,
                    (n / nodes[0] as usize % nodes[1] as usize) as i32,
                    (n / layer) as i32,
                ];
                let (lo, hi) = span(at, dims);
                let mut word = 0;
                for k in lo[2]..=hi[2] {
                    for j in lo[1]..=hi[1] {
                        for i in lo[0]..=hi[0] {
                            let [a, b] = macros.ranges[macros.index([i, j, k])];
                            let on = all || wanted.meets(a.into(), b.into());
                            word |= u64::from(on) << bit([i, j, k]);
                        }
                    }
                }
                AtomicU64::new(word)
            })
            .collect();
        Self {
            macros: dims,
            nodes,
            cells: volume.space.cells,
            masks: (0..macros.ranges.len()).map(|_| AtomicU64::new(UNKNOWN)).collect(),
            words,
            wanted,
            all,
        }
    }

    pub(crate) fn bytes(&self) -> usize {
        8 * (self.words.len() + self.masks.len())
    }

    /// Macrocells in which something can be seen, as far as is known.
    pub(crate) fn count(&self) -> u64 {
        self.words
            .iter()
            .map(|w| u64::from(w.load(Ordering::Relaxed).count_ones()))
            .sum()
    }

    /// The visible cells of a macrocell.
    #[inline(always)]
    pub(crate) fn cells_of(&self, at: [i32; 3], form: impl Form) -> u64 {
        let slot = (at[2] as usize * self.macros[1] as usize + at[1] as usize) * self.macros[0] as usize + at[0] as usize;
        match self.masks[slot].load(Ordering::Relaxed) {
            UNKNOWN => self.look(at, slot, form),
            mask => mask,
        }
    }

    #[inline(never)]
    fn look(&self, at: [i32; 3], slot: usize, form: impl Form) -> u64 {
        let (lo, hi) = span(at, self.cells);
        let mut mask = 0u64;
        form.ranges(lo, hi, |cell, a, b| {
            mask |= u64::from(self.all || self.wanted.meets(a, b)) << bit(cell);
        });
        if mask == UNKNOWN {
            self.words[self.word(three(|a| at[a] >> LOG))].fetch_and(!(1 << bit(at)), Ordering::Relaxed);
        }
        // Every thread would store the same word.
        self.masks[slot].store(mask, Ordering::Relaxed);
        mask
    }

    #[inline(always)]
    fn word(&self, [x, y, z]: [i32; 3]) -> usize {
        (z as usize * self.nodes[1] as usize + y as usize) * self.nodes[0] as usize + x as usize
    }

    /// Hands the visible macrocells along a ray to `to`, in order, until it returns false.
    #[inline(always)]
    pub(crate) fn walk(&self, w: &Walk, to: &mut impl Visit) {
        let none = [0; 3];
        let last = three(|a| self.nodes[a] - 1);
        let mut node = Dda::new(w, 2 * LOG, w.t0, none, last);
        let mut t = w.t0;
        loop {
            let (a, exit) = node.exit();
            // Rounded planes may lie behind where the ray is: it never goes back.
            let end = exit.min(w.t1).max(t);
            let word = self.words[self.word(node.at)].load(Ordering::Relaxed);
            if word != 0 {
                let (lo, hi) = span(node.at, self.macros);
                let mut cell = Dda::new(w, LOG, t, lo, hi);
                let mut from = t;
                loop {
                    let (a, exit) = cell.exit();
                    let to_t = exit.min(end).max(from);
                    if word >> bit(cell.at) & 1 != 0 && !to.macrocell(cell.at, from, to_t) {
                        return;
                    }
                    if to_t >= end || !cell.step(w, a, lo, hi) {
                        break;
                    }
                    from = to_t;
                }
            }
            if end >= w.t1 || !node.step(w, a, none, last) {
                return;
            }
            t = end;
        }
    }
}

/// What a ray does in the macrocells it crosses.
pub(crate) trait Visit {
    /// The macrocell `at`, between parameters `from` and `to`; false ends the ray.
    fn macrocell(&mut self, at: [i32; 3], from: f64, to: f64) -> bool;
}
