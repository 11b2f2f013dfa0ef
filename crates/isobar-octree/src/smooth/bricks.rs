//! Least and greatest coefficient of bricks of 4^3 cells, and which bricks and cells an isovalue can meet.
//!
//! As `crate::bricks`, for the wider influence of degrees 2 and 3: a brick is bounded by the coefficients of all its stencils, because the
//! weights are non-negative and sum to one (Steinberger 2010, section 3.3). That hull is loose: a cell of a cubic looks 4 coefficients far. So the
//! cells of a brick are bounded by their Bernstein coefficients, worked out for the whole brick at once when the first ray enters it,
//! separably and sharing those on common faces (13^3 for 4^3 cells of degree 3). Bricks in which no cell is left are taken out.

use super::basis::Spline;
use super::lattice::{Coefficient, Lattice};
use super::vector::{Isa, Register};
use crate::bricks::{self, SIDE, UNKNOWN, bit};
use crate::walk::Bounds;
use isobar_cpu::Kernel;
use isobar_cpu::nodes::Ranges;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU64, Ordering};

/// The range of the coefficients of every brick, for coefficients of `dims`, each at least 2.
pub(crate) fn ranges<S: Spline, T: Coefficient>(c: &[T], dims: [usize; 3]) -> Ranges<T> {
    let more = usize::from(S::CENTRED);
    let bricks = dims.map(|n| (n - 1 + more).div_ceil(SIDE));
    // What the border rule takes from elsewhere lies inside the cut block, with either rule.
    let reach = |a: usize, b: usize| (b * SIDE).saturating_sub(1)..(b * SIDE + SIDE + S::DEGREE - 1).min(dims[a]);
    let mut range = vec![[c[0]; 2]; bricks.iter().product()];
    range.par_chunks_mut(bricks[0]).enumerate().for_each_init(
        || (vec![c[0]; dims[0]], vec![c[0]; dims[0]]),
        |(least, greatest), (row, out)| {
            let mut first = true;
            for z in reach(2, row / bricks[1]) {
                for y in reach(1, row % bricks[1]) {
                    let line = &c[(z * dims[1] + y) * dims[0]..][..dims[0]];
                    if first {
                        least.copy_from_slice(line);
                        greatest.copy_from_slice(line);
                        first = false;
                        continue;
                    }
                    for ((lo, hi), &v) in least.iter_mut().zip(greatest.iter_mut()).zip(line) {
                        *lo = if v < *lo { v } else { *lo };
                        *hi = if v > *hi { v } else { *hi };
                    }
                }
            }
            for (i, o) in out.iter_mut().enumerate() {
                let reach = reach(0, i);
                let pick = |all: &[T], better: fn(&T, &T) -> bool| {
                    all[1..].iter().fold(all[0], |m, v| if better(v, &m) { *v } else { m })
                };
                *o = [
                    pick(&least[reach.clone()], |a, b| a < b),
                    pick(&greatest[reach], |a, b| a > b),
                ];
            }
        },
    );
    Ranges { dims: bricks, range }
}

/// Bricks and cells that the isovalues can meet; made anew when these change, in time linear in the number of bricks.
#[derive(Debug)]
pub(crate) struct Active {
    /// Bricks as the coefficients' hull leaves them, and the active cells of those that a ray has entered. A ray that enters one without active cells works that out once more.
    all: bricks::Active,
    /// The bricks of each node; bits are taken back where no cell is active.
    live: Vec<AtomicU64>,
}

/// Bytes of a node, beside its bricks: its word, what is left of it, and a number.
pub(crate) const NODE: usize = 20;

/// The cells of a brick that lie inside the volume.
#[inline(always)]
pub(crate) fn inside(cells: [i32; 3], brick: [i32; 3]) -> u64 {
    // Whole rows, planes and bricks of so many cells.
    const X: [u64; 4] = [0x1111_1111_1111_1111, 0x3333_3333_3333_3333, 0x7777_7777_7777_7777, u64::MAX];
    const Y: [u64; 4] = [0x000f_000f_000f_000f, 0x00ff_00ff_00ff_00ff, 0x0fff_0fff_0fff_0fff, u64::MAX];
    const Z: [u64; 4] = [0xffff, 0xffff_ffff, 0xffff_ffff_ffff, u64::MAX];
    let last = |a: usize| (cells[a] - 1 - (brick[a] << 2)).clamp(0, 3) as usize;
    X[last(0)] & Y[last(1)] & Z[last(2)]
}

impl Active {
    /// `room`: the bytes it may take, as far as nodes leave any; `old`: others of the same volume, whose memory is used.
    pub(crate) fn new<T: Coefficient>(bricks: &Ranges<T>, bounds: &[Bounds], room: usize, old: Option<Self>) -> Self {
        let nodes: usize = bricks.dims.iter().map(|n| n.div_ceil(SIDE)).product();
        let (all, mut live) = old.map_or((None, Vec::new()), |a| (Some(a.all), a.live));
        let all = bricks::Active::new(bricks, bounds, room.saturating_sub(nodes * size_of::<AtomicU64>()), all);
        live.clear();
        live.extend(all.nodes.words.iter().map(|&w| AtomicU64::new(w)));
        Self { all, live }
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(self.live.as_slice()) + self.all.bytes()
    }

    /// Nodes per axis.
    pub(crate) fn dims(&self) -> [usize; 3] {
        self.all.nodes.dims
    }

    /// Bricks that the coefficients' hull leaves.
    pub(crate) fn count(&self) -> usize {
        self.all.nodes.count()
    }

    /// The word of the node with these indices.
    #[inline(always)]
    pub(crate) fn word_of(&self, node: [i32; 3]) -> usize {
        self.all.nodes.word_of(node)
    }

    /// The bricks of node `w`.
    #[inline(always)]
    pub(crate) fn word(&self, w: usize) -> u64 {
        self.live[w].load(Ordering::Relaxed)
    }

    /// Takes back the active cell with bit `cell` of such a brick, which [`Active::cells`] gave.
    #[inline(always)]
    pub(crate) fn take_back(&self, w: usize, b: u32, cell: u32) {
        if self.all.take_back(w, b, cell) == UNKNOWN {
            self.live[w].fetch_and(!(1u64 << b), Ordering::Relaxed);
        }
    }

    /// The active cells of the brick with bit `b` of word `w`, which is set or was; `make` works them out.
    #[inline(always)]
    pub(crate) fn cells(&self, w: usize, b: u32, make: impl FnOnce() -> u64) -> u64 {
        self.all.known(w, b, || {
            let mask = make();
            if mask == UNKNOWN {
                self.live[w].fetch_and(!(1u64 << b), Ordering::Relaxed);
            }
            mask
        })
    }
}

/// The active cells of a brick, by their Bernstein coefficients.
#[cold]
#[inline(never)]
pub(crate) fn active_cells<S: Spline, I: Isa>(lattice: &Lattice<'_>, cells: [i32; 3], brick: [i32; 3], bounds: &[Bounds]) -> u64 {
    let hulls = hulls::<S, I>(lattice, brick);
    let mut mask = 0;
    let n: [i32; 3] = std::array::from_fn(|a| (cells[a] - (brick[a] << 2)).min(SIDE as i32));
    for k in 0..n[2] {
        for j in 0..n[1] {
            for i in 0..n[0] {
                let [lo, hi] = hulls.range([i, j, k].map(|v| v as usize));
                // Differences that overflow f32 leave no finite range: then every cell is active.
                let on = !(lo.is_finite() && hi.is_finite()) || bounds.iter().any(|b| b.meets(lo, hi));
                mask |= u64::from(on) << bit([i, j, k]);
            }
        }
    }
    mask
}

/// The ranges of the cells of a brick, by their Bernstein coefficients; what lies beyond the volume is that of its border.
///
/// In f32, relative to one of the coefficients. Differences carry u, each axis three products and two sums with constants that are
/// themselves rounded, 7u: 22u of the greatest difference. The range of a cell is widened by 32u.
pub(crate) fn hulls<S: Spline, I: Isa>(lattice: &Lattice<'_>, brick: [i32; 3]) -> Hulls {
    let (reference, block) = lattice.block(brick.map(|b| b << 2), SIDE + S::DEGREE);
    I::run(CellHulls::<S, I> {
        reference,
        block: &block,
        kind: std::marker::PhantomData,
    })
}

/// Range of each cell of a brick relative to `reference`: cell (i, j, k) at `16 (4k + j) + i`.
pub(crate) struct Hulls {
    reference: f64,
    pad: f64,
    least: [f32; 256],
    greatest: [f32; 256],
}

impl Hulls {
    /// Least and greatest of eight cells, the eight with number `n`, x fastest.
    #[inline(always)]
    pub(crate) fn eight(&self, n: usize) -> [[f64; 8]; 2] {
        let mut out = [[0.0; 8]; 2];
        for j in 0..2 {
            for i in 0..SIDE {
                let at = (2 * n + j) * 16 + i;
                out[0][4 * j + i] = self.reference + (f64::from(self.least[at]) - self.pad);
                out[1][4 * j + i] = self.reference + (f64::from(self.greatest[at]) + self.pad);
            }
        }
        out
    }

    /// That of a cell; not finite where differences overflow.
    #[inline(always)]
    pub(crate) fn range(&self, [i, j, k]: [usize; 3]) -> [f64; 2] {
        let at = (k * 4 + j) * 16 + i;
        [
            self.reference + (f64::from(self.least[at]) - self.pad),
            self.reference + (f64::from(self.greatest[at]) + self.pad),
        ]
    }
}

struct CellHulls<'a, S, I> {
    reference: f32,
    block: &'a [[f32; 16]; 49],
    kind: std::marker::PhantomData<(S, I)>,
}

/// Bernstein points along an axis of a brick, at most.
const POINTS: usize = 13;

impl<S: Spline, I: Isa> Kernel for CellHulls<'_, S, I> {
    type Output = Hulls;

    #[inline(always)]
    fn run(self) -> Hulls {
        let n = SIDE + S::DEGREE;
        let points = SIDE * S::DEGREE + 1;
        // Points along x of each row: those that begin cells first, then the second ones and so on.
        let mut x = [[0.0f32; 24]; 49];
        let mut most = I::Single8::splat(0.0);
        for (r, c) in self.block[..n * n].iter().enumerate() {
            let v = I::Single8::load(c);
            most = most.larger(v).larger(I::Single8::splat(0.0).sub(v));
            let p = S::points(v, I::Single8::load(&c[1..]), I::Single8::load(&c[2..]));
            // A lane for each cell, and one more for the first point of the cell after; what lies beyond is written over.
            p[0].store(&mut x[r]);
            for q in 1..S::DEGREE {
                p[q].store(&mut x[r][q * SIDE + 1..]);
            }
        }
        let mut y = [[0.0f32; 16]; 7 * POINTS];
        for k in 0..n {
            for j in 0..=SIDE {
                // Of the cell beyond the last only the first point is used; in degree 2 there is no third coefficient there, and none is needed.
                let row = |j: usize| I::Single16::load(&x[k * n + j.min(n - 1)]);
                let p = S::points(row(j), row(j + 1), row(j + 2));
                for q in 0..if j < SIDE { S::DEGREE } else { 1 } {
                    p[q].store(&mut y[k * POINTS + j * S::DEGREE + q]);
                }
            }
        }
        // Along z, and the range of the points of each cell, first along z and then along y.
        let mut least = [[0.0f32; 16]; SIDE * POINTS];
        let mut greatest = least;
        for p in 0..points {
            let mut column = [[0.0f32; 16]; POINTS];
            for k in 0..=SIDE {
                let row = |k: usize| I::Single16::load(&y[k.min(n - 1) * POINTS + p]);
                let v = S::points(row(k), row(k + 1), row(k + 2));
                for q in 0..if k < SIDE { S::DEGREE } else { 1 } {
                    v[q].store(&mut column[k * S::DEGREE + q]);
                }
            }
            for k in 0..SIDE {
                let part = &column[k * S::DEGREE..][..=S::DEGREE];
                extremes::<I>(part, part, &mut least[k * POINTS + p], &mut greatest[k * POINTS + p]);
            }
        }
        let mut out = Hulls {
            reference: self.reference.into(),
            pad: 0.0,
            least: [0.0; 256],
            greatest: [0.0; 256],
        };
        for k in 0..SIDE {
            for j in 0..SIDE {
                let part = k * POINTS + j * S::DEGREE..=k * POINTS + j * S::DEGREE + S::DEGREE;
                let (mut lo, mut hi) = ([0.0; 16], [0.0; 16]);
                extremes::<I>(&least[part.clone()], &greatest[part], &mut lo, &mut hi);
                for i in 0..SIDE {
                    // The points of cell i: its first, the groups of further ones, and the first of the next.
                    let (mut a, mut b) = (lo[i].min(lo[i + 1]), hi[i].max(hi[i + 1]));
                    for p in 1..S::DEGREE {
                        a = a.min(lo[p * SIDE + 1 + i]);
                        b = b.max(hi[p * SIDE + 1 + i]);
                    }
                    out.least[(k * SIDE + j) * 16 + i] = a;
                    out.greatest[(k * SIDE + j) * 16 + i] = b;
                }
            }
        }
        let mut size = [0.0f32; 8];
        most.store(&mut size);
        let size = size.iter().fold(0.0f32, |m, &v| if v > m || v.is_nan() { v } else { m });
        // Relative errors, and the absolute one of subnormal numbers.
        out.pad = 16.0 * (f64::from(size) * f64::from(f32::EPSILON) + f64::from(f32::from_bits(1)));
        if size.is_nan() || size >= f32::MAX / 8.0 {
            // Sums may have overflown, and minimum and maximum dropped what is not a number.
            out.least[..].fill(f32::NEG_INFINITY);
        }
        out
    }
}

/// Least and greatest of the points of a cell along an axis, lane by lane.
#[inline(always)]
fn extremes<I: Isa>(lo: &[[f32; 16]], hi: &[[f32; 16]], least: &mut [f32; 16], greatest: &mut [f32; 16]) {
    let (mut a, mut b) = (I::Single16::load(&lo[0]), I::Single16::load(&hi[0]));
    for q in 1..lo.len() {
        a = a.smaller(I::Single16::load(&lo[q]));
        b = b.larger(I::Single16::load(&hi[q]));
    }
    a.store(least);
    b.store(greatest);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bricks::Values;
    use crate::smooth::basis::{Cubic, Quadratic};
    use crate::smooth::vector::Portable;
    use isobar_core::{Function, Grid, Samples, Stage};
    use isobar_cpu::Level;
    use isobar_fields::{Border, GridSpline, Kind};

    /// A cell is active where values in it straddle the isovalue, and not where the coefficients' hull excludes it, also where sizes divide nothing
    /// and in the halves of cells at the border.
    fn agrees<S: Spline>(kind: Kind) {
        let mut s = 12345u32;
        for dims in [[2, 2, 2], [5, 9, 18], [17, 3, 6]] {
            let samples: Vec<f32> = (0..dims.iter().product())
                .map(|_| {
                    s = s.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    (s >> 8) as f32 / 65536.0
                })
                .collect();
            let grid = Grid::unit(dims, Samples::F32(samples.clone().into())).unwrap();
            let spline = GridSpline::new(&grid, kind, Stage::Stored).unwrap();
            let lattice = Lattice {
                values: Values::F32(&samples),
                dims,
                border: Border::Clamp,
            };
            let bricks = ranges::<S, _>(&samples, dims);
            let bounds = [Bounds::new(100.0, 0.0, (0.0, 256.0)), Bounds::new(200.0, 0.0, (0.0, 256.0))];
            let active = Active::new(&bricks, &bounds, usize::MAX, None);
            let cells = dims.map(|n| n as i32 - i32::from(!S::CENTRED));
            let (mut on, mut all) = (0, 0);
            for (z, y, x) in (0..cells[2]).flat_map(|z| (0..cells[1]).flat_map(move |y| (0..cells[0]).map(move |x| (z, y, x)))) {
                let (cell, brick) = ([x, y, z], [x >> 2, y >> 2, z >> 2]);
                let w = active.word_of(brick.map(|b| b >> 2));
                let b = bit(brick);
                let make = || active_cells::<S, Portable>(&lattice, cells, brick, &bounds);
                let is = active.all.nodes.words[w] >> b & 1 == 1 && active.cells(w, b, make) >> bit(cell) & 1 == 1;
                let d = lattice.doubles::<S>(cell, 0.0);
                let stencil = &d[..(S::DEGREE + 1).pow(3)];
                let (lo, hi) = stencil.iter().fold((f64::MAX, f64::MIN), |(a, b), &v| (a.min(v), b.max(v)));
                let shift = if S::CENTRED { 0.5 } else { 0.0 };
                let mut seen = (f64::MAX, f64::MIN);
                for n in 0..216 {
                    let at = |a: usize| f64::from(cell[a]) - shift + [n % 6, n / 6 % 6, n / 36][a] as f64 / 5.0;
                    let v = spline.value(glam::DVec3::new(at(0), at(1), at(2)));
                    seen = (seen.0.min(v), seen.1.max(v));
                }
                assert!(
                    is || !bounds.iter().any(|b| b.meets(seen.0, seen.1)),
                    "{cell:?} of {dims:?} holds a surface"
                );
                assert!(
                    !is || bounds.iter().any(|b| b.meets(lo - 1e-3, hi + 1e-3)),
                    "{cell:?} of {dims:?} cannot"
                );
                on += u32::from(is);
                all += 1;
            }
            assert!(on > 0 && (all < 100 || on < all), "{dims:?}: {on} of {all}");
        }
    }

    #[test]
    fn activity_is_that_of_the_spline() {
        agrees::<Quadratic>(Kind::Quadratic);
        agrees::<Cubic>(Kind::Cubic);
    }

    /// All instruction sets give the same cells.
    #[test]
    fn levels_agree() {
        let dims = [23, 9, 11];
        let c: Vec<u8> = (0..dims.iter().product::<usize>()).map(|i| (i * 89 % 251) as u8).collect();
        let lattice = Lattice {
            values: Values::U8(&c),
            dims,
            border: Border::Mirror,
        };
        let bounds = [Bounds::new(120.5, 0.0, (0.0, 255.0))];
        let with = |level: Level, brick| match level {
            Level::Scalar => active_cells::<Cubic, Portable>(&lattice, [22, 8, 10], brick, &bounds),
            #[cfg(target_arch = "x86_64")]
            Level::Avx2 => active_cells::<Cubic, crate::smooth::vector::Avx2>(&lattice, [22, 8, 10], brick, &bounds),
            #[cfg(target_arch = "x86_64")]
            Level::Avx512 => active_cells::<Cubic, crate::smooth::vector::Avx512>(&lattice, [22, 8, 10], brick, &bounds),
            #[cfg(not(target_arch = "x86_64"))]
            _ => unreachable!(),
        };
        for brick in [[0, 0, 0], [3, 1, 1], [5, 1, 2]] {
            for level in Level::ALL.into_iter().filter(|l| l.is_available()) {
                assert_eq!(with(level, brick), with(Level::Scalar, brick), "{level}: {brick:?}");
            }
        }
    }
}
