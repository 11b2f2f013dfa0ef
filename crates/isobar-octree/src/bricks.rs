//! Least and greatest sample of bricks of 4^3 cells, and which bricks and cells an isovalue can meet.
//!
//! Steinberger 2010, section 3.3: the rendertree's min/max octree over bricks, bounded by the influence coefficients (for degree 1 the
//! samples themselves, which bound the interpolant). Different here: two octree levels at once, as one bit per brick in 64-bit words, so that
//! "is anything in these 4^3 bricks" is one load; and the cells of a brick get such a word too, made when the first ray enters the brick and kept
//! until the isovalues change: work follows what is visible.

use crate::walk::{Bounds, three};
use isobar_core::Samples;
use isobar_cpu::Level;
use isobar_cpu::nodes::{Nodes, Ranges};
pub(crate) use isobar_cpu::nodes::{SIDE, bit};
use isobar_cpu::packet::{Lanes, WithLanes, run as lanes};
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

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

/// The range of the samples of every brick, for samples of `dims`, each at least 2.
pub(crate) fn ranges<T: Sample>(samples: &[T], dims: [usize; 3]) -> Ranges<T> {
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
    Ranges { dims: bricks, range }
}

/// Bytes beside `ranges` that an index may take: with these a tenth of the data, and of small data a tenth of 64 MiB.
pub(crate) fn room(data: usize, ranges: usize) -> usize {
    (data.max(64 << 20) / 10).saturating_sub(ranges)
}

/// Bricks, and later cells, that the isovalues can meet; made anew when these change, in time linear in the number of bricks.
#[derive(Debug)]
pub(crate) struct Active {
    pub(crate) nodes: Nodes,
    /// Of each active brick, as far as memory goes, its active cells, and [`UNKNOWN`] until a ray comes by. Those of other bricks are worked out whenever a packet or a ray comes.
    cells: Vec<AtomicU64>,
    /// Instructions these are worked out with; the same at every level.
    level: Level,
}

/// The word of a brick that no ray has entered yet. In degree 1 no active brick has this word afterwards: between a sample on one side of the isovalue and one
/// on the other there is an edge that crosses it, and with it an active cell.
pub(crate) const UNKNOWN: u64 = 0;

impl Active {
    /// `room`: the bytes it may take, as far as nodes leave any; `old`: others of the same volume, whose memory is used.
    pub(crate) fn new<T: Sample>(bricks: &Ranges<T>, bounds: &[Bounds], room: usize, old: Option<Self>) -> Self {
        let (nodes, mut cells) = old.map_or((None, Vec::new()), |a| (Some(a.nodes), a.cells));
        let nodes = Nodes::new(bricks, bounds, nodes);
        let kept = nodes.count().min(room.saturating_sub(nodes.bytes()) / size_of::<AtomicU64>());
        if kept < cells.capacity() / 2 {
            // Far more than is needed: given back.
            cells = Vec::new();
        }
        cells.truncate(kept);
        cells.iter_mut().for_each(|c| *c.get_mut() = UNKNOWN);
        cells.reserve_exact(kept - cells.len());
        cells.resize_with(kept, || AtomicU64::new(UNKNOWN));
        Self {
            nodes,
            cells,
            level: Level::detect(),
        }
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        self.nodes.bytes() + self.cells.capacity() * size_of::<AtomicU64>()
    }

    /// The active cells of the brick with bit `b` of word `w`, which is set; `make` works them out.
    #[inline(always)]
    pub(crate) fn known(&self, w: usize, b: u32, make: impl FnOnce() -> u64) -> u64 {
        let Some(slot) = self.cells.get(self.nodes.brick(w, b)) else {
            return make();
        };
        match slot.load(Ordering::Relaxed) {
            UNKNOWN => {
                let mask = make();
                // Every thread would store the same word.
                slot.store(mask, Ordering::Relaxed);
                mask
            }
            mask => mask,
        }
    }

    /// Takes back an active cell of a brick that has been worked out, where its word is kept; gives those left.
    #[inline(always)]
    pub(crate) fn take_back(&self, w: usize, b: u32, cell: u32) -> u64 {
        let rest = !(1u64 << cell);
        self.cells
            .get(self.nodes.brick(w, b))
            .map_or(rest, |slot| slot.fetch_and(rest, Ordering::Relaxed) & rest)
    }

    /// The active cells of brick `at` (bit `b` of word `w`, which is set).
    #[inline(always)]
    pub(crate) fn cells(&self, w: usize, b: u32, at: [i32; 3], samples: Values<'_>, dims: [usize; 3], bounds: &[Bounds]) -> u64 {
        self.known(w, b, || active_cells_of(self.level, at, samples, dims, bounds))
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
            let bricks = ranges(&s, dims);
            let bounds = [Bounds::new(100.0, 0.0, (0.0, 256.0)), Bounds::new(253.0, 0.0, (0.0, 256.0))];
            let active = Active::new(&bricks, &bounds, usize::MAX, None);
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
                        let w = active.nodes.word_of(brick.map(|b| b >> 2));
                        let on = active.nodes.words[w] >> bit(brick) & 1 == 1;
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

    /// Where memory holds the words of some bricks only, or of none, cells are the same; words in memory that held others are too.
    #[test]
    fn words_that_are_not_kept_are_worked_out_again() {
        let dims = [22, 19, 17];
        let s = volume(dims);
        let bricks = ranges(&s, dims);
        let bounds = |c: f64| [Bounds::new(c, 0.0, (0.0, 256.0))];
        let values = Values::F32(&s);
        let mut old = [None, None, None];
        for c in [100.0, 128.5, 20.0] {
            let bounds = bounds(c);
            let whole = Active::new(&bricks, &bounds, usize::MAX, None);
            let nodes = whole.nodes.bytes();
            assert!(whole.nodes.count() > 60, "nearly all");
            for (room, old) in [0, nodes + 8 * 20 + 7, nodes + 8 * 50].into_iter().zip(&mut old) {
                let active = Active::new(&bricks, &bounds, room, old.take());
                assert!(active.bytes() <= room.max(nodes), "{} of {room}", active.bytes());
                // Twice: words that are kept are known by then.
                for _ in 0..2 {
                    for (w, &word) in active.nodes.words.iter().enumerate() {
                        let node = [
                            w % active.nodes.dims[0],
                            w / active.nodes.dims[0] % active.nodes.dims[1],
                            w / (active.nodes.dims[0] * active.nodes.dims[1]),
                        ];
                        for b in (0..64u32).filter(|b| word >> b & 1 == 1) {
                            let at = three(|a| (node[a] << 2) as i32 + (b >> (2 * a) & 3) as i32);
                            let cells = |a: &Active| a.cells(w, b, at, values, dims, &bounds);
                            assert_eq!(cells(&active), cells(&whole));
                        }
                    }
                }
                *old = Some(active);
            }
        }
    }
}
