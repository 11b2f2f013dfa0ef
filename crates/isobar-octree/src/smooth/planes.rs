//! A plane beside every brick, which bounds its cells whatever the isovalue.
//!
//! The Bernstein coefficients of the 64 cells of a brick take some 0.6 us, too long for a first image after a change of the isovalue. They do not depend on it: with the data
//! a linear function of the cell's indices is fitted to the middles of the cells' ranges, and a width found within which every range lies. Five bytes a brick tell then, in a few
//! vector operations, which cells an isovalue can meet. Smooth data leave one cell in seven too many (`gyroid` 256^3); packets test those once more (`packet.rs`).
//! Bricks in which a plane is much wider than the cells' ranges keep none, and are bounded by their coefficients when a ray enters them.
//!
//! **Proof.** Numbers are rounded to eight bits first. The width is then chosen so that [`Plane::ends`], as it is computed, holds the range of every cell: what is looked up later
//! are the same bits, by the same operations, so that no rounding is left to be bounded.

use super::basis::Spline;
use super::bricks::{Hulls, hulls};
use super::lattice::{Coefficient, Lattice};
use super::vector::{self, Isa};
use crate::bricks::SIDE;
use crate::walk::Bounds;
use isobar_cpu::Level;
use isobar_cpu::nodes::Ranges;
use isobar_cpu::packet::{LANES, Lanes, WithLanes, run};
use rayon::prelude::*;

/// Cells of a brick.
const CELLS: usize = SIDE * SIDE * SIDE;

/// Wider than the mean range of the cells by more than this, a plane leaves so many cells that bounding them all by their coefficients costs less.
const WIDER: f64 = 1.4;

/// What bounds the cells of a brick, in 254ths of the range of its coefficients.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Plane {
    /// In the middle of the brick, from the middle of the range.
    middle: i8,
    /// From a cell to the next.
    slope: [i8; 3],
    /// Half width of what holds the ranges of all cells; [`NONE`]: there is no such plane.
    width: u8,
}

const NONE: u8 = u8::MAX;

/// No plane.
const EMPTY: Plane = Plane {
    middle: 0,
    slope: [0; 3],
    width: NONE,
};

/// Middle of a range, and its 254th part.
#[inline(always)]
fn unit([lo, hi]: [f64; 2]) -> (f64, f64) {
    (0.5 * lo + 0.5 * hi, (0.5 * hi - 0.5 * lo) * (1.0 / 127.0))
}

/// From the middle of a brick to those of eight cells, two rows of it, along x, and along y for the first two rows.
const X: [f64; LANES] = [-1.5, -0.5, 0.5, 1.5, -1.5, -0.5, 0.5, 1.5];
const Y: [f64; LANES] = [-1.5, -1.5, -1.5, -1.5, -0.5, -0.5, -0.5, -0.5];

/// Eights of cells.
const EIGHTS: usize = CELLS / LANES;

impl Plane {
    /// Middles of the ranges of eight cells, the eight with number `n`, in 254ths: exact.
    #[inline(always)]
    fn at<S: Lanes>(&self, n: usize) -> S {
        let [x, y, z] = self.slope.map(f64::from);
        let rest = f64::from(self.middle) + (n / 2) as f64 * z - 1.5 * z + (n % 2) as f64 * 2.0 * y;
        S::splat(rest)
            .add(S::load(&X).mul(S::splat(x)))
            .add(S::load(&Y).mul(S::splat(y)))
    }

    /// What holds the ranges of eight cells, `range` being that of the brick's coefficients.
    #[inline(always)]
    fn ends<S: Lanes>(&self, range: [f64; 2], n: usize) -> [S; 2] {
        let (mid, unit) = unit(range);
        let (mid, unit) = (S::splat(mid), S::splat(unit));
        let (x, w) = (self.at::<S>(n), S::splat(self.width.into()));
        [mid.add(unit.mul(x.sub(w))), mid.add(unit.mul(x.add(w)))]
    }

    /// The cells that may meet an isovalue; `None` where there is no plane.
    #[inline(always)]
    pub(crate) fn cells(&self, level: Level, range: [f64; 2], bounds: &[Bounds]) -> Option<u64> {
        let plane = *self;
        (self.width != NONE).then(|| run(level, ActiveCells { plane, range, bounds }))
    }
}

struct ActiveCells<'a> {
    plane: Plane,
    range: [f64; 2],
    bounds: &'a [Bounds],
}

impl WithLanes for ActiveCells<'_> {
    type Output = u64;

    #[inline(always)]
    fn run<S: Lanes>(self) -> u64 {
        let mut mask = 0;
        for n in 0..EIGHTS {
            let [lower, upper] = self.plane.ends::<S>(self.range, n);
            let mut on = 0;
            for b in self.bounds {
                let (least, greatest) = b.ends();
                on |= !lower.above(S::splat(greatest)) & !S::splat(least).above(upper);
            }
            mask |= u64::from(on) << (LANES * n);
        }
        mask
    }
}

/// Fits a plane to the ranges of cells, in a brick with this range of coefficients.
struct Fit<'a> {
    range: [f64; 2],
    hulls: &'a Hulls,
}

impl WithLanes for Fit<'_> {
    type Output = Plane;

    #[inline(always)]
    fn run<S: Lanes>(self) -> Plane {
        let (mid, unit) = unit(self.range);
        let per = 1.0 / unit;
        if !(unit > 0.0 && unit.is_finite() && per.is_finite()) {
            return EMPTY;
        }
        let (zero, half, infinite) = (S::splat(0.0), S::splat(0.5), S::splat(f64::INFINITY));
        let mut ends = [[zero; 2]; EIGHTS];
        let mut sums = [zero; 4];
        let mut size = zero;
        for (n, ends) in ends.iter_mut().enumerate() {
            let [lo, hi] = self.hulls.eight(n);
            let (lo, hi) = (S::load(&lo), S::load(&hi));
            // Neither infinite nor NaN.
            if infinite.above(lo.abs()) & infinite.above(hi.abs()) != u8::MAX {
                return EMPTY;
            }
            *ends = [lo, hi];
            let y = lo.mul(half).add(hi.mul(half)).sub(S::splat(mid)).mul(S::splat(per));
            size = size.add(hi.sub(lo).mul(S::splat(0.5 * per)));
            let along = S::load(&Y).add(S::splat((n % 2) as f64 * 2.0));
            sums[0] = sums[0].add(y);
            sums[1] = sums[1].add(y.mul(S::load(&X)));
            sums[2] = sums[2].add(y.mul(along));
            sums[3] = sums[3].add(y.mul(S::splat((n / 2) as f64 - 1.5)));
        }
        // The squares of the distances from the middle sum to 80. Casts saturate.
        const SLOPE: f64 = 1.0 / 80.0;
        let mut plane = Plane {
            middle: rounded(sums[0], 1.0 / CELLS as f64),
            slope: [rounded(sums[1], SLOPE), rounded(sums[2], SLOPE), rounded(sums[3], SLOPE)],
            width: 0,
        };
        let mut wide = zero;
        for (n, [lo, hi]) in ends.into_iter().enumerate() {
            let x = plane.at::<S>(n);
            let above = hi.sub(S::splat(mid)).mul(S::splat(per)).sub(x);
            let below = x.sub(lo.sub(S::splat(mid)).mul(S::splat(per)));
            wide = wide.max(above).max(below);
        }
        let wide = each(wide).into_iter().fold(0.0, f64::max);
        if wide >= f64::from(NONE - 2) || wide > WIDER * total(size) * (1.0 / CELLS as f64) + 1.0 {
            return EMPTY;
        }
        plane.width = wide.ceil() as u8;
        while plane.width != NONE {
            let mut out = 0;
            for (n, [lo, hi]) in ends.into_iter().enumerate() {
                let [lower, upper] = plane.ends::<S>(self.range, n);
                out |= lower.above(lo) | hi.above(upper);
            }
            if out == 0 {
                break;
            }
            plane.width += 1;
        }
        plane
    }
}

#[inline(always)]
fn each<S: Lanes>(v: S) -> [f64; LANES] {
    let mut out = [0.0; LANES];
    v.store(&mut out);
    out
}

/// The sum of the lanes times the weight, as a whole number.
#[inline(always)]
fn rounded<S: Lanes>(v: S, weight: f64) -> i8 {
    (total(v) * weight).round_ties_even() as i8
}

#[inline(always)]
fn total<S: Lanes>(v: S) -> f64 {
    each(v).into_iter().sum()
}

/// The planes of all bricks.
pub(crate) fn planes<S: Spline, T: Coefficient>(lattice: &Lattice<'_>, bricks: &Ranges<T>, level: Level) -> Vec<Plane> {
    match level {
        #[cfg(target_arch = "x86_64")]
        Level::Avx512 => made::<S, vector::Avx512, T>(lattice, bricks, level),
        #[cfg(target_arch = "x86_64")]
        Level::Avx2 => made::<S, vector::Avx2, T>(lattice, bricks, level),
        _ => made::<S, vector::Portable, T>(lattice, bricks, level),
    }
}

fn made<S: Spline, I: Isa, T: Coefficient>(lattice: &Lattice<'_>, bricks: &Ranges<T>, level: Level) -> Vec<Plane> {
    let [nx, ny, _] = bricks.dims;
    let mut out = vec![EMPTY; bricks.range.len()];
    out.par_chunks_mut(nx).enumerate().for_each(|(row, out)| {
        for (i, plane) in out.iter_mut().enumerate() {
            let range = bricks.range[row * nx + i].map(Into::into);
            if range[0] < range[1] {
                let brick = [i, row % ny, row / ny].map(|b| b as i32);
                let hulls = hulls::<S, I>(lattice, brick);
                *plane = run(level, Fit { range, hulls: &hulls });
            }
        }
    });
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bricks::{Values, bit};
    use crate::smooth::basis::{Cubic, Quadratic};
    use crate::smooth::bricks::{active_cells, ranges};
    use crate::smooth::lattice::{Block, block};
    use crate::smooth::vector::Portable;
    use isobar_fields::Border;

    /// No cell that its coefficients leave is switched off, at isovalues where cells begin and end among others; and smooth data have planes that leave few others. In all instruction sets.
    fn holds<S: Spline>(name: &str, dims: [usize; 3], smooth: bool, of: impl Fn(f64, f64, f64) -> f64) {
        let c: Vec<f32> = (0..dims.iter().product())
            .map(|i| {
                of(
                    (i % dims[0]) as f64,
                    (i / dims[0] % dims[1]) as f64,
                    (i / (dims[0] * dims[1])) as f64,
                ) as f32
            })
            .collect();
        let lattice = Lattice {
            values: Values::F32(&c),
            dims,
            border: Border::Mirror,
        };
        let bricks = ranges::<S, _>(&c, dims);
        let all = bricks.whole();
        let cells = dims.map(|n| n as i32 - i32::from(!S::CENTRED));
        let planes = planes::<S, _>(&lattice, &bricks, Level::detect());
        let plain = super::planes::<S, _>(&lattice, &bricks, Level::Scalar);
        assert!(planes == plain, "{name}: instruction sets agree");
        let (mut with, mut deep, mut exact, mut rough) = (0, 0, 0, 0);
        for (n, plane) in planes.iter().enumerate() {
            let range = bricks.range[n].map(f64::from);
            let brick = [
                n % bricks.dims[0],
                n / bricks.dims[0] % bricks.dims[1],
                n / (bricks.dims[0] * bricks.dims[1]),
            ];
            let brick = brick.map(|b| b as i32);
            // At the border coefficients are mirrored, and cells are no smooth continuation of each other.
            if let Block::Inside(_) = block(dims, brick.map(|b| b << 2), SIDE + S::DEGREE) {
                deep += 1;
                with += usize::from(plane.width != NONE);
            }
            let hulls = hulls::<S, Portable>(&lattice, brick);
            let ends: Vec<f64> = [[0, 0, 0], [3, 1, 2], [2, 3, 3]]
                .into_iter()
                .flat_map(|m| hulls.range(m))
                .collect();
            for isovalue in ends.into_iter().chain([range[0], 0.3 * range[0] + 0.7 * range[1], range[1]]) {
                for margin in [0.0, 1e-6] {
                    let bounds = [Bounds::new(isovalue, margin, all)];
                    let want = active_cells::<S, Portable>(&lattice, cells, brick, &bounds);
                    let Some(got) = plane.cells(Level::Scalar, range, &bounds) else {
                        continue;
                    };
                    assert_eq!(want & !got, 0, "{name}: brick {brick:?} at {isovalue}");
                    for level in Level::ALL {
                        assert_eq!(plane.cells(level, range, &bounds), Some(got), "{level}");
                    }
                    let inside = (0..64u32).filter(|&b| {
                        let at = [b & 3, b >> 2 & 3, b >> 4].map(|v| v as i32);
                        (0..3).all(|a| (brick[a] << 2 | at[a]) < cells[a]) && got >> bit(at) & 1 == 1
                    });
                    exact += want.count_ones() as usize;
                    rough += inside.count();
                }
            }
        }
        if smooth {
            assert!(with * 2 > deep, "{name}: {with} of {deep} bricks have planes");
            assert!(rough * 10 < exact * 14, "{name}: {rough} cells for {exact}");
        }
    }

    #[test]
    fn planes_hold_the_cells_of_their_bricks() {
        let mut seed = 9u32;
        let noise: Vec<f64> = std::iter::repeat_with(|| {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            f64::from(seed >> 8) / 16_777_216.0
        })
        .take(20 * 20 * 20)
        .collect();
        let at = |x: f64, y: f64, z: f64| noise[(z * 400.0 + y * 20.0 + x) as usize];
        let wave = |x: f64, y: f64, z: f64| {
            (0.05 * x).sin() * (0.05 * y).cos() + (0.05 * y).sin() * (0.05 * z).cos() + (0.05 * z + 0.3).sin() + 0.1 * x
                - 0.05 * z
                + 0.02 * y
        };
        macro_rules! both {
            ($name:expr, $dims:expr, $smooth:expr, $of:expr) => {
                holds::<Cubic>($name, $dims, $smooth, $of);
                holds::<Quadratic>($name, $dims, $smooth, $of);
            };
        }
        both!("wave", [31, 26, 22], true, wave);
        both!("plane", [13, 13, 13], false, |x: f64, y: f64, z: f64| 3.0 * x - y + 0.1 * z);
        both!("noise", [18, 7, 11], false, at);
        both!("thin", [2, 17, 9], false, at);
        both!("one sample raised", [9, 9, 9], false, |x: f64, y: f64, z: f64| f64::from(
            u8::from(x + y + z == 12.0)
        ));
        // Far from zero next to nothing is left of the digits; beyond f32's sums nothing.
        both!("offset", [9, 10, 9], false, |x, y, z| 1e6 + 0.1 * wave(x, y, z));
        both!("far", [9, 9, 9], false, |x, y, z| 1e30 * (1.0 + 1e-6 * at(x, y, z)));
        both!("huge", [9, 9, 9], false, |x, y, z| 3e38 * (2.0 * at(x, y, z) - 1.0));
        both!("tiny", [9, 9, 9], false, |x, y, z| 1e-44 * (20.0 * at(x, y, z)).round());
        both!("constant", [9, 9, 9], false, |_, _, _| 0.7);
    }
}
