//! Macrocells: which blocks of the volume a ray need not look at (Knoll et al. 2009, section 6.1).
//!
//! Least and greatest value of every block of 4^3 cells, once per data set, and which blocks the transfer function or a surface can be seen in, anew
//! for each of these, in parallel. The paper's grid has 64^3 macrocells whatever the data; blocks of 4^3 cells are the same at 256^3. Different here: 64 macrocells share a
//! word, so that empty space is crossed in steps of 16 cells, and their ranges lie side by side, so that a word is made by comparing 64 ranges at once; and for rays that find exact
//! crossings the cells of a macrocell have such a word too: all of it where the macrocell's range lies in what can be seen. Else, for degree 1, it is made at once too, from the ranges of the
//! cells, two bytes each, kept from one transfer function to the next (`cells.rs`): read in the order they lie in memory, they take a fifth of the time that they take when rays come by.
//! For the others, whose ranges take long, it is made from the coefficients when a ray first enters, so that work follows what is visible. For filters without negative lobes the coefficients in reach bound a macrocell; for BC(2,1) the Bernstein
//! coefficients of its pieces do.

mod cells;

use crate::interval::{Bands, Intervals, outward};
use crate::space::{Dda, Walk, three};
use crate::volume::{Form, Smooth, Volume, bits_of};
use cells::CellRanges;
use isobar_core::Lattice;
use isobar_cpu::{Kernel, Level};
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

/// The range of every macrocell, those of a node side by side.
#[derive(Debug)]
pub(crate) struct Macrocells {
    pub(crate) dims: [i32; 3],
    pub(crate) nodes: [i32; 3],
    /// Per node and [`bit`]; NaN, which meets nothing, beyond the volume.
    least: Vec<[f32; 64]>,
    most: Vec<[f32; 64]>,
    /// Of the whole volume.
    pub(crate) range: (f64, f64),
    /// Of every cell, where they are kept.
    cells: Option<CellRanges>,
}

/// Node of a place in the list of nodes.
fn node_at(n: usize, nodes: [i32; 3]) -> [i32; 3] {
    let [x, y] = [nodes[0] as usize, nodes[1] as usize];
    [(n % x) as i32, (n / x % y) as i32, (n / (x * y)) as i32]
}

/// Place of a node in the list of nodes.
#[inline(always)]
fn node_index([x, y, z]: [i32; 3], nodes: [i32; 3]) -> usize {
    (z as usize * nodes[1] as usize + y as usize) * nodes[0] as usize + x as usize
}

/// Place of a macrocell in lists of 64 per node.
#[inline(always)]
fn slot(at: [i32; 3], nodes: [i32; 3]) -> usize {
    node_index(three(|a| at[a] >> LOG), nodes) << 6 | bit(at) as usize
}

impl Macrocells {
    /// In parallel on the calling pool. `keep`: the ranges of cells, if they are of degree 1.
    pub(crate) fn new(volume: &Volume, keep: bool, level: Level) -> Self {
        let cells = volume.space.cells;
        let dims = cells.map(|n| (n + SIDE - 1) >> LOG);
        let nodes = dims.map(|n| (n + SIDE - 1) >> LOG);
        let count = nodes.iter().map(|&n| n as usize).product::<usize>();
        let range_of = |at: [i32; 3]| {
            let (lo, hi) = span(at, cells);
            if volume.filter.has_negative_lobes() {
                let (mut least, mut most) = (f64::INFINITY, f64::NEG_INFINITY);
                Smooth::<4>(volume).ranges(lo, hi, |_, a, b| (least, most) = (least.min(a), most.max(b)));
                outward(least, most)
            } else {
                let r = volume.spline.range(lo.map(|x| x as usize), hi.map(|x| x as usize));
                outward(r.lo, r.hi)
            }
        };
        let (least, most): (Vec<_>, Vec<_>) = (0..count)
            .into_par_iter()
            .map(|n| {
                let (mut least, mut most) = ([f32::NAN; 64], [f32::NAN; 64]);
                let (lo, hi) = span(node_at(n, nodes), dims);
                for k in lo[2]..=hi[2] {
                    for j in lo[1]..=hi[1] {
                        for i in lo[0]..=hi[0] {
                            let at = bit([i, j, k]) as usize;
                            [least[at], most[at]] = range_of([i, j, k]);
                        }
                    }
                }
                (least, most)
            })
            .unzip();
        let lowest = least.as_flattened().iter().fold(f64::INFINITY, |a, &x| a.min(x.into()));
        let highest = most.as_flattened().iter().fold(f64::NEG_INFINITY, |a, &x| a.max(x.into()));
        Self {
            dims,
            nodes,
            least,
            most,
            range: (lowest, highest),
            cells: (keep && volume.filter.basis().degree == 1).then(|| CellRanges::new(volume, nodes, dims, level)),
        }
    }

    pub(crate) fn bytes(&self) -> usize {
        let cells = self.cells.as_ref().map_or(0, CellRanges::bytes);
        cells + size_of_val(self.least.as_slice()) + size_of_val(self.most.as_slice())
    }

    /// Place of a macrocell in the list of multipliers.
    #[inline(always)]
    pub(crate) fn index(&self, at: [i32; 3]) -> usize {
        slot(at, self.nodes)
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
    (0..macros.least.len())
        .into_par_iter()
        .flat_map_iter(|n| {
            let node = node_at(n, macros.nodes);
            (0..64i32).map(move |i| {
                let at = three(|a| node[a] << LOG | i >> (2 * a) & (SIDE - 1));
                if (0..3).any(|a| at[a] >= macros.dims[a]) {
                    return 1;
                }
                let (lo, hi) = span(at, cells);
                let end: [usize; 3] = std::array::from_fn(|a| (hi[a] as usize + 1).min(dims[a] - 1));
                let sigma = deviation(moments(lo.map(|x| x as usize), end));
                // 0/0 takes no longer steps; anything over 0 the longest.
                let ratio = whole / sigma;
                if ratio.is_nan() {
                    1
                } else {
                    2 * (ratio.log2().clamp(0.0, 3.0) as u8) + 1
                }
            })
        })
        .collect()
}

/// The macrocells, and later cells, in which anything can be seen.
#[derive(Debug)]
pub(crate) struct Visible {
    macros: [i32; 3],
    nodes: [i32; 3],
    cells: [i32; 3],
    words: Vec<AtomicU64>,
    /// Per macrocell its visible cells; [`UNKNOWN`] until a ray comes by, where the ranges of cells are not kept.
    masks: Vec<AtomicU64>,
    wanted: Bands,
    level: Level,
}

/// The word of a macrocell whose cells have not been looked at. One without a visible cell is taken out of the nodes.
const UNKNOWN: u64 = 0;

impl Visible {
    /// Those that meet a value of `wanted`, or all of them. Where the range of a macrocell lies in an interval of `wanted`, all its cells are visible and need not be looked at. In parallel on
    /// the calling pool.
    pub(crate) fn new(volume: &Volume, macros: &Macrocells, wanted: &Intervals, all: bool, level: Level) -> Self {
        let wanted = if all {
            Intervals::new([(f64::NEG_INFINITY, f64::INFINITY)], 0.0).outward()
        } else {
            wanted.outward()
        };
        let masks: Vec<AtomicU64> = (0..64 * macros.least.len()).map(|_| AtomicU64::new(UNKNOWN)).collect();
        let words: Vec<AtomicU64> = (0..macros.least.len()).map(|_| AtomicU64::new(0)).collect();
        // Nodes a task takes.
        const RUN: usize = 128;
        words.par_chunks(RUN).enumerate().for_each(|(n, words)| {
            level.run(LookAtNodes {
                macros,
                space: volume.space.cells,
                first: n * RUN,
                wanted: &wanted,
                words,
                masks: &masks[64 * n * RUN..],
            });
        });
        Self {
            macros: macros.dims,
            nodes: macros.nodes,
            cells: volume.space.cells,
            masks,
            words,
            wanted,
            level,
        }
    }

    pub(crate) fn bytes(&self) -> usize {
        8 * (self.words.len() + self.masks.len())
    }

    /// Per node its visible macrocells by their [`bit`], as two halves, the lower first.
    #[cfg(feature = "gpu")]
    pub(crate) fn words(&self) -> Vec<[u32; 2]> {
        let halves = |w: &AtomicU64| {
            let w = w.load(Ordering::Relaxed);
            [w as u32, (w >> 32) as u32]
        };
        self.words.iter().map(halves).collect()
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
        let slot = slot(at, self.nodes);
        match self.masks[slot].load(Ordering::Relaxed) {
            UNKNOWN => self.look(at, slot, form),
            mask => mask,
        }
    }

    #[inline(never)]
    fn look(&self, at: [i32; 3], slot: usize, form: impl Form) -> u64 {
        let (lo, hi) = span(at, self.cells);
        let mask = self.level.run(LookAtCells {
            form,
            lo,
            hi,
            wanted: &self.wanted,
        });
        if mask == UNKNOWN {
            self.words[slot >> 6].fetch_and(!(1 << bit(at)), Ordering::Relaxed);
        }
        // Every thread would store the same word.
        self.masks[slot].store(mask, Ordering::Relaxed);
        mask
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
            let word = self.words[node_index(node.at, self.nodes)].load(Ordering::Relaxed);
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

/// Which cells of a macrocell can be seen.
struct LookAtCells<'a, F> {
    form: F,
    lo: [i32; 3],
    hi: [i32; 3],
    wanted: &'a Bands,
}

impl<F: Form> Kernel for LookAtCells<'_, F> {
    type Output = u64;

    #[inline(always)]
    fn run(self) -> u64 {
        self.form.visible(self.lo, self.hi, self.wanted)
    }
}

/// Which macrocells of some nodes can be seen, and which of their cells, where that is known without the coefficients.
struct LookAtNodes<'a> {
    macros: &'a Macrocells,
    /// Cells per axis.
    space: [i32; 3],
    /// The first node.
    first: usize,
    wanted: &'a Bands,
    words: &'a [AtomicU64],
    masks: &'a [AtomicU64],
}

impl Kernel for LookAtNodes<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let macros = self.macros;
        for (i, word) in self.words.iter().enumerate() {
            let n = self.first + i;
            let (mut meets, mut inside) = self.wanted.bits(&macros.least[n], &macros.most[n]);
            let mut part = meets & !inside;
            while inside != 0 {
                self.masks[64 * i + inside.trailing_zeros() as usize].store(u64::MAX, Ordering::Relaxed);
                inside &= inside - 1;
            }
            if let Some(ranges) = &macros.cells {
                let node = node_at(n, macros.nodes);
                while part != 0 {
                    let b = part.trailing_zeros();
                    part &= part - 1;
                    let (lo, hi) = span(three(|a| node[a] << LOG | b as i32 >> (2 * a) & (SIDE - 1)), self.space);
                    let mask = ranges.mask(64 * n + b as usize, macros, self.wanted) & bits_of(lo, hi);
                    if mask == UNKNOWN {
                        meets &= !(1 << b);
                    } else {
                        self.masks[64 * i + b as usize].store(mask, Ordering::Relaxed);
                    }
                }
            }
            word.store(meets, Ordering::Relaxed);
        }
    }
}

/// What a ray does in the macrocells it crosses.
pub(crate) trait Visit {
    /// The macrocell `at`, between parameters `from` and `to`; false ends the ray.
    fn macrocell(&mut self, at: [i32; 3], from: f64, to: f64) -> bool;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filter::Filter;
    use crate::volume::Linear;
    use isobar_core::{Grid, Samples};

    /// No cell that meets what is wanted is passed by, and those that only come near it do so within two parts of their macrocell's range: whether words are made at once or when a ray
    /// comes by, for every type of samples and every level.
    #[test]
    fn words_hold_every_cell_that_meets() {
        let dims = [23usize, 18, 34];
        let n: usize = dims.iter().product();
        let mut seed = 11u32;
        let mut unit = || {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(seed >> 8) / f64::from(1u32 << 24)
        };
        // Half of it is smooth, so that macrocells have small ranges too.
        let all: Vec<f64> = (0..n)
            .map(|i| if i % dims[0] < 12 { unit() } else { i as f64 / n as f64 })
            .collect();
        let of: [(Samples, f64); 4] = [
            (Samples::F32(all.iter().map(|v| *v as f32).collect()), 1.0),
            (Samples::U8(all.iter().map(|v| (v * 255.0) as u8).collect()), 255.0),
            (Samples::I16(all.iter().map(|v| (v * 30_000.0) as i16).collect()), 30_000.0),
            (Samples::U16(all.iter().map(|v| (v * 60_000.0) as u16).collect()), 60_000.0),
        ];
        for (samples, scale) in of {
            let grid = Grid::unit(dims, samples).unwrap();
            let volume = Volume::new(&grid, "trilinear".parse::<Filter>().unwrap()).unwrap();
            for (keep, level) in [(true, Level::Avx512), (true, Level::Scalar), (false, Level::Avx2)] {
                let macros = Macrocells::new(&volume, keep, Level::best(level));
                let values = [(0.25, 0.25), (0.6, 0.601), (0.83, 0.83)];
                let wanted = Intervals::new(values.map(|(a, b)| (a * scale, b * scale)), 1e-6 * scale);
                let visible = Visible::new(&volume, &macros, &wanted, false, Level::best(level));
                let form = Linear::new(&volume);
                let mut passed = 0;
                for at in 0..macros.least.len() * 64 {
                    let node = node_at(at >> 6, macros.nodes);
                    let at = three(|a| node[a] << LOG | (at as i32 & 63) >> (2 * a) & (SIDE - 1));
                    if (0..3).any(|a| at[a] >= macros.dims[a]) {
                        continue;
                    }
                    let slot = slot(at, macros.nodes);
                    let range = [&macros.least, &macros.most].map(|r| f64::from(r.as_flattened()[slot]));
                    let near = 2.0 / 255.0 * (range[1] - range[0]);
                    let seen = visible.words[slot >> 6].load(Ordering::Relaxed) >> bit(at) & 1 != 0;
                    let mask = if seen { visible.cells_of(at, form) } else { 0 };
                    let (lo, hi) = span(at, volume.space.cells);
                    form.ranges(lo, hi, |cell, a, b| {
                        let drawn = mask >> bit(cell) & 1 != 0;
                        assert!(drawn || !wanted.meets(a, b), "{scale} {level} {cell:?}: [{a}, {b}]");
                        assert!(
                            !drawn || wanted.meets(a - near, b + near),
                            "{scale} {level} {cell:?}: [{a}, {b}]"
                        );
                        passed += usize::from(!drawn);
                    });
                }
                assert!(passed > n / 4, "{passed} of {n}");
            }
        }
    }
}
