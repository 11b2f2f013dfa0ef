//! Least and greatest sample of bricks of 4^3 cells, and which bricks and cells an isovalue can meet.
//!
//! Steinberger 2010, section 3.3: the rendertree's min/max octree over bricks, bounded by the influence coefficients (for degree 1 the
//! samples themselves, which bound the interpolant). Different here: two octree levels at once, as one bit per brick in 64-bit words, so that
//! "is anything in these 4^3 bricks" is one load; and the cells of a brick get such a word too, made when the first ray enters the brick and kept
//! until the isovalues change: work follows what is visible.

use crate::walk::{Bounds, three};
use isobar_core::Samples;
use isobar_cpu::Level;
use isobar_cpu::packet::{Lanes, WithLanes, run as lanes};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

/// Cells of a brick, and bricks of a node, per axis: the word of either has 4^3 = 64 bits, x fastest.
pub(crate) const SIDE: usize = 4;

/// Samples a volume may have.
pub(crate) trait Sample: Copy + PartialOrd + Into<f64> + Send + Sync + 'static {}
impl<T: Copy + PartialOrd + Into<f64> + Send + Sync + 'static> Sample for T {}

/// Samples of a volume, or coefficients of a spline, as they are stored.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Values<'a> {
    U8(&'a [u8]),
    I16(&'a [i16]),
    U16(&'a [u16]),
    F32(&'a [f32]),
}

impl<'a> Values<'a> {
    pub(crate) fn of(samples: &'a Samples) -> Self {
        match samples {
            Samples::U8(s) => Self::U8(s),
            Samples::I16(s) => Self::I16(s),
            Samples::U16(s) => Self::U16(s),
            Samples::F32(s) => Self::F32(s),
        }
    }
}

/// Runs `$body` with the typed values. One branch per cell costs nothing; one caster per type would quadruple the program, and the time to compile it.
macro_rules! values {
    ($values:expr, $v:ident => $body:expr) => {
        match $values {
            $crate::bricks::Values::U8($v) => $body,
            $crate::bricks::Values::I16($v) => $body,
            $crate::bricks::Values::U16($v) => $body,
            $crate::bricks::Values::F32($v) => $body,
        }
    };
}
pub(crate) use values;

/// Bit of cell or brick (x, y, z) in its word; only the lowest two bits of each count.
#[inline(always)]
pub(crate) fn bit([x, y, z]: [i32; 3]) -> u32 {
    ((z & 3) << 4 | (y & 3) << 2 | (x & 3)) as u32
}

/// The range of every brick; depends on the data alone.
#[derive(Debug)]
pub(crate) struct Bricks<T> {
    /// Bricks per axis.
    pub(crate) dims: [usize; 3],
    range: Vec<[T; 2]>,
}

impl<T: Sample> Bricks<T> {
    /// For samples of `dims`, each at least 2.
    pub(crate) fn new(samples: &[T], dims: [usize; 3]) -> Self {
        let bricks = dims.map(|n| (n - 1).div_ceil(SIDE));
        let mut range = vec![[samples[0]; 2]; bricks.iter().product()];
        range.par_chunks_mut(bricks[0]).enumerate().for_each(|(row, out)| {
            let lo = [0, row % bricks[1] * SIDE, row / bricks[1] * SIDE];
            let hi = lo.map(|l| l + SIDE);
            for (i, o) in out.iter_mut().enumerate() {
                let x = [i * SIDE, (i * SIDE + SIDE).min(dims[0] - 1)];
                let first = samples[(lo[2] * dims[1] + lo[1]) * dims[0] + x[0]];
                let (mut least, mut greatest) = (first, first);
                for z in lo[2]..=hi[2].min(dims[2] - 1) {
                    for y in lo[1]..=hi[1].min(dims[1] - 1) {
                        let start = (z * dims[1] + y) * dims[0];
                        for &v in &samples[start + x[0]..=start + x[1]] {
                            least = if v < least { v } else { least };
                            greatest = if v > greatest { v } else { greatest };
                        }
                    }
                }
                *o = [least, greatest];
            }
        });
        Self { dims: bricks, range }
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.range.as_slice())
    }

    /// Least and greatest sample of all.
    pub(crate) fn whole(&self) -> (f64, f64) {
        self.range
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), &[lo, hi]| {
                (a.min(lo.into()), b.max(hi.into()))
            })
    }
}

/// Bricks, and later cells, that the isovalues can meet; made anew when these change, in time linear in the number of bricks.
#[derive(Debug)]
pub(crate) struct Active {
    /// Words per axis.
    pub(crate) dims: [usize; 3],
    /// Bit b of word w: brick b of node w may hold a surface.
    pub(crate) words: Vec<u64>,
    /// Active bricks before each word: where its bricks' cells are.
    before: Vec<u32>,
    /// Per active brick: its active cells, and [`UNKNOWN`] until a ray comes by.
    cells: Vec<AtomicU64>,
    /// Instructions these are worked out with; the same at every level.
    level: Level,
}

/// The word of a brick that no ray has entered yet. No active brick has this word afterwards: between a sample on one side of the isovalue and one
/// on the other there is an edge that crosses it, and with it an active cell.
const UNKNOWN: u64 = 0;

impl Active {
    pub(crate) fn new<T: Sample>(bricks: &Bricks<T>, bounds: &[Bounds]) -> Self {
        let dims = bricks.dims.map(|n| n.div_ceil(SIDE));
        let mut words = vec![0u64; dims.iter().product()];
        words.par_chunks_mut(dims[0] * dims[1]).enumerate().for_each(|(z, layer)| {
            for k in z * SIDE..(z * SIDE + SIDE).min(bricks.dims[2]) {
                for j in 0..bricks.dims[1] {
                    let row = &bricks.range[(k * bricks.dims[1] + j) * bricks.dims[0]..][..bricks.dims[0]];
                    let word = &mut layer[j / SIDE * dims[0]..][..dims[0]];
                    for (i, &[lo, hi]) in row.iter().enumerate() {
                        let (lo, hi) = (lo.into(), hi.into());
                        let on = bounds.iter().any(|b| b.meets(lo, hi));
                        word[i / SIDE] |= u64::from(on) << bit([i as i32, j as i32, k as i32]);
                    }
                }
            }
        });
        let mut count = 0u32;
        let before = words
            .iter()
            .map(|w| {
                let at = count;
                count += w.count_ones();
                at
            })
            .collect();
        let cells = (0..count).map(|_| AtomicU64::new(UNKNOWN)).collect();
        Self {
            dims,
            words,
            before,
            cells,
            level: Level::detect(),
        }
    }

    /// The word of the node with these indices.
    #[inline(always)]
    pub(crate) fn word_of(&self, node: [i32; 3]) -> usize {
        (node[2] as usize * self.dims[1] + node[1] as usize) * self.dims[0] + node[0] as usize
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        self.words.len() * 12 + self.cells.len() * 8
    }

    /// Active bricks.
    pub(crate) fn count(&self) -> usize {
        self.cells.len()
    }

    /// The active cells of brick `at` (bit `b` of word `w`, which is set).
    #[inline(always)]
    pub(crate) fn cells(&self, w: usize, b: u32, at: [i32; 3], samples: Values<'_>, dims: [usize; 3], bounds: &[Bounds]) -> u64 {
        let below = self.words[w] & ((1u64 << b) - 1);
        let slot = &self.cells[(self.before[w] + below.count_ones()) as usize];
        match slot.load(Ordering::Relaxed) {
            UNKNOWN => {
                let mask = active_cells_of(self.level, at, samples, dims, bounds);
                // Every thread would store the same word.
                slot.store(mask, Ordering::Relaxed);
                mask
            }
            mask => mask,
        }
    }
}

#[cold]
#[inline(never)]
fn active_cells_of(level: Level, brick: [i32; 3], samples: Values<'_>, dims: [usize; 3], bounds: &[Bounds]) -> u64 {
    values!(samples, samples => lanes(level, ActiveCells { brick, samples, dims, bounds }))
}

/// The active cells of a brick. A cell meets an isovalue where one of its corners is not above it and one not below: one bit per sample and side, rows of eight, and cells by
/// shifts of these.
struct ActiveCells<'a, T> {
    brick: [i32; 3],
    samples: &'a [T],
    dims: [usize; 3],
    bounds: &'a [Bounds],
}

impl<T: Sample> WithLanes for ActiveCells<'_, T> {
    type Output = u64;

    #[inline(always)]
    fn run<S: Lanes>(self) -> u64 {
        let dims = self.dims;
        let lo = three(|a| self.brick[a] as usize * SIDE);
        let n = three(|a| (dims[a] - 1 - lo[a]).min(SIDE));
        let mut mask = 0;
        for bound in self.bounds {
            let (least, greatest) = bound.ends();
            let (least, greatest) = (S::splat(least), S::splat(greatest));
            // Per plane of samples, bit 8 j + i.
            let (mut low, mut high) = ([0u64; SIDE + 1], [0u64; SIDE + 1]);
            for k in 0..=n[2] {
                for j in 0..=n[1] {
                    let at = ((lo[2] + k) * dims[1] + lo[1] + j) * dims[0] + lo[0];
                    // What lies behind the row is some other sample, and counts for no cell.
                    let row = S::load(&eight(self.samples, at));
                    low[k] |= u64::from(!row.above(greatest)) << (8 * j);
                    high[k] |= u64::from(!least.above(row)) << (8 * j);
                }
            }
            for k in 0..n[2] {
                let cells = corners(low[k] | low[k + 1]) & corners(high[k] | high[k + 1]);
                for j in 0..n[1] {
                    mask |= (cells >> (8 * j) & ((1 << n[0]) - 1)) << (16 * k + 4 * j);
                }
            }
        }
        mask
    }
}

/// Of two planes of samples, those at the corners of each cell together.
#[inline(always)]
fn corners(plane: u64) -> u64 {
    let edges = plane | plane >> 1;
    edges | edges >> 8
}

/// Eight samples, or as many as there are.
#[inline(always)]
fn eight<T: Sample>(samples: &[T], at: usize) -> [f64; 8] {
    let s = &samples[at..];
    if let Some(s) = s.first_chunk::<8>() {
        return [
            s[0].into(),
            s[1].into(),
            s[2].into(),
            s[3].into(),
            s[4].into(),
            s[5].into(),
            s[6].into(),
            s[7].into(),
        ];
    }
    let mut row = [0.0; 8];
    for (to, &v) in row.iter_mut().zip(s) {
        *to = v.into();
    }
    row
}

#[cfg(test)]
mod tests {
    use super::*;

    fn volume(dims: [usize; 3]) -> Vec<f32> {
        let mut s = 12345u32;
        (0..dims.iter().product())
            .map(|_| {
                s = s.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (s >> 8) as f32 / 65536.0
            })
            .collect()
    }

    /// A brick or cell is active exactly where the range of its samples meets the isovalue, also where sizes divide nothing.
    #[test]
    fn activity_is_that_of_the_samples() {
        for dims in [[2, 2, 2], [5, 9, 17], [18, 3, 6]] {
            let s = volume(dims);
            let bricks = Bricks::new(&s, dims);
            let bounds = [Bounds::new(100.0, 0.0, (0.0, 256.0)), Bounds::new(253.0, 0.0, (0.0, 256.0))];
            let active = Active::new(&bricks, &bounds);
            let mut count = 0;
            for z in 0..dims[2] - 1 {
                for y in 0..dims[1] - 1 {
                    for x in 0..dims[0] - 1 {
                        let v: Vec<f64> = (0..8)
                            .map(|n| f64::from(s[((z + (n >> 2)) * dims[1] + y + (n >> 1 & 1)) * dims[0] + x + (n & 1)]))
                            .collect();
                        let (lo, hi) = v.iter().fold((f64::MAX, f64::MIN), |(a, b), &v| (a.min(v), b.max(v)));
                        let want = bounds.iter().any(|b| b.meets(lo, hi));
                        let cell = [x as i32, y as i32, z as i32];
                        let brick = cell.map(|c| c >> 2);
                        let w = ((brick[2] >> 2) as usize * active.dims[1] + (brick[1] >> 2) as usize) * active.dims[0]
                            + (brick[0] >> 2) as usize;
                        let on = active.words[w] >> bit(brick) & 1 == 1;
                        assert!(on || !want, "an active cell in a brick that is not");
                        if on {
                            let mask = active.cells(w, bit(brick), brick, Values::F32(&s), dims, &bounds);
                            for level in Level::ALL {
                                let again = active_cells_of(level, brick, Values::F32(&s), dims, &bounds);
                                assert_eq!(again, mask, "{level}");
                            }
                            assert_eq!(mask >> bit(cell) & 1 == 1, want, "{cell:?} of {dims:?}");
                            count += usize::from(want);
                        }
                    }
                }
            }
            assert!(count > 0, "{dims:?} has active cells");
        }
    }
}
