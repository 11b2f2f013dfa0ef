//! The rendertree: a min/max octree over bricks of b^3 cells (thesis, section 3.3.2).
//!
//! A leaf's range is that of all coefficients that influence its cells, which the function cannot leave, since B-splines are non-negative and sum to one; a node's range that of its
//! children. Levels are arrays, without pointers, cut where the volume ends. Nothing depends on an isovalue.

use super::path::LEVELS;
use crate::bricks::{Values, values};
use rayon::prelude::*;

/// Ranges of all nodes, in the type of the coefficients, and where each level begins.
#[derive(Debug)]
enum Ranges {
    U8(Vec<[u8; 2]>),
    I16(Vec<[i16; 2]>),
    U16(Vec<[u16; 2]>),
    F32(Vec<[f32; 2]>),
}

#[derive(Debug)]
pub(super) struct Tree {
    /// Side of a brick is 2^`side` cells.
    pub(super) side: u32,
    /// Levels below the root.
    pub(super) depth: u32,
    /// Nodes per axis and the place of the first, the root's level first.
    levels: Vec<([usize; 3], usize)>,
    ranges: Ranges,
}

/// Levels below the root that bricks of 2^`side` cells a side need; `None` where a path has not as many.
pub(super) fn depth(cells: [usize; 3], side: u32) -> Option<u32> {
    let bricks = cells.map(|n| n.div_ceil(1 << side)).into_iter().max()?;
    let depth = bricks.next_power_of_two().trailing_zeros();
    (depth <= LEVELS).then_some(depth)
}

trait Number: Copy + PartialOrd + Send + Sync {}
impl<T: Copy + PartialOrd + Send + Sync> Number for T {}

#[inline(always)]
fn join<T: Number>(a: [T; 2], b: [T; 2]) -> [T; 2] {
    [if b[0] < a[0] { b[0] } else { a[0] }, if b[1] > a[1] { b[1] } else { a[1] }]
}

/// First and last coefficient along an axis that the cells of a brick use; the border mirrors or repeats some of these.
fn influence(brick: usize, side: u32, degree: usize, cells: usize, samples: usize) -> std::ops::RangeInclusive<usize> {
    let before = usize::from(degree > 1);
    let (first, last) = (brick << side, (((brick + 1) << side) - 1).min(cells - 1));
    first.saturating_sub(before)..=(last + degree - before).min(samples - 1)
}

/// The leaves: rows of a slab of bricks are reduced along x, then along y and z.
fn leaves<T: Number>(c: &[T], dims: [usize; 3], cells: [usize; 3], degree: usize, side: u32) -> Vec<[T; 2]> {
    let bricks = cells.map(|n| n.div_ceil(1 << side));
    let along = |axis: usize, brick| influence(brick, side, degree, cells[axis], dims[axis]);
    let mut out = vec![[c[0]; 2]; bricks.iter().product()];
    out.par_chunks_mut(bricks[0] * bricks[1]).enumerate().for_each(|(bz, slab)| {
        let mut rows = vec![None; bricks[0] * dims[1]];
        for z in along(2, bz) {
            for (y, rows) in rows.chunks_exact_mut(bricks[0]).enumerate() {
                let row = &c[(z * dims[1] + y) * dims[0]..][..dims[0]];
                for (bx, range) in rows.iter_mut().enumerate() {
                    let row = &row[along(0, bx)];
                    let found = row.iter().fold([row[0]; 2], |r, &v| join(r, [v; 2]));
                    *range = Some(range.map_or(found, |r| join(r, found)));
                }
            }
        }
        for (i, range) in slab.iter_mut().enumerate() {
            let (bx, by) = (i % bricks[0], i / bricks[0]);
            let found = along(1, by).filter_map(|y| rows[y * bricks[0] + bx]).reduce(join);
            *range = found.unwrap_or(*range);
        }
    });
    out
}

impl Tree {
    /// `None` where a path of [`LEVELS`] levels does not reach the bricks.
    pub(super) fn new(coefficients: Values<'_>, dims: [usize; 3], cells: [usize; 3], degree: usize, side: u32) -> Option<Self> {
        let depth = depth(cells, side)?;
        let mut levels = Vec::new();
        let mut place = 0;
        for level in 0..=depth {
            let n = cells.map(|n| n.div_ceil(1 << (side + depth - level)));
            levels.push((n, place));
            place += n.iter().product::<usize>();
        }
        fn all<T: Number>(leaves: Vec<[T; 2]>, levels: &[([usize; 3], usize)], total: usize) -> Vec<[T; 2]> {
            let mut out = vec![leaves[0]; total];
            out[total - leaves.len()..].copy_from_slice(&leaves);
            for pair in levels.windows(2).rev() {
                let ((n, first), (below, of)) = (pair[0], pair[1]);
                let (upper, lower) = out.split_at_mut(of);
                for (i, range) in upper[first..].iter_mut().enumerate() {
                    let at = [i % n[0], i / n[0] % n[1], i / n[0] / n[1]];
                    let children = (0..8usize).filter_map(|k| {
                        let [x, y, z] = [0, 1, 2].map(|a| 2 * at[a] + (k >> a & 1));
                        (x < below[0] && y < below[1] && z < below[2]).then(|| lower[(z * below[1] + y) * below[0] + x])
                    });
                    *range = children.reduce(join).unwrap_or(*range);
                }
            }
            out
        }
        let ranges = match coefficients {
            Values::U8(c) => Ranges::U8(all(leaves(c, dims, cells, degree, side), &levels, place)),
            Values::I16(c) => Ranges::I16(all(leaves(c, dims, cells, degree, side), &levels, place)),
            Values::U16(c) => Ranges::U16(all(leaves(c, dims, cells, degree, side), &levels, place)),
            Values::F32(c) => Ranges::F32(all(leaves(c, dims, cells, degree, side), &levels, place)),
        };
        Some(Self {
            side,
            depth,
            levels,
            ranges,
        })
    }

    /// Least and greatest coefficient of a node. All types are exact in f32.
    #[inline(always)]
    pub(super) fn range(&self, level: u32, [x, y, z]: [u32; 3]) -> [f32; 2] {
        let (n, first) = self.levels[level as usize];
        let at = first + (z as usize * n[1] + y as usize) * n[0] + x as usize;
        match &self.ranges {
            Ranges::U8(r) => r[at].map(f32::from),
            Ranges::I16(r) => r[at].map(f32::from),
            Ranges::U16(r) => r[at].map(f32::from),
            Ranges::F32(r) => r[at],
        }
    }

    /// Bytes held.
    pub(super) fn bytes(&self) -> usize {
        match &self.ranges {
            Ranges::U8(r) => size_of_val(&r[..]),
            Ranges::I16(r) => size_of_val(&r[..]),
            Ranges::U16(r) => size_of_val(&r[..]),
            Ranges::F32(r) => size_of_val(&r[..]),
        }
    }

    /// Nodes per axis of a level.
    #[cfg(test)]
    pub(super) fn nodes(&self, level: u32) -> [usize; 3] {
        self.levels[level as usize].0
    }
}

/// Types coefficients are stored in; all are exact in f32.
trait Single: Copy {
    fn single(self) -> f32;
}
impl Single for f32 {
    #[inline(always)]
    fn single(self) -> f32 {
        self
    }
}
macro_rules! whole {
    ($($t:ty)*) => {$(
        impl Single for $t {
            #[inline(always)]
            fn single(self) -> f32 {
                f32::from(self)
            }
        }
    )*};
}
whole!(u8 i16 u16);

/// Coefficients with their border, x fastest.
#[derive(Debug, Clone, Copy)]
pub(super) struct Coefficients<'a> {
    pub(super) values: Values<'a>,
    pub(super) dims: [usize; 3],
    pub(super) border: isobar_fields::Border,
}

impl Coefficients<'_> {
    /// The (D + 1)^3 coefficients that influence a cell, x fastest.
    #[inline(always)]
    pub(super) fn stencil<const D: usize>(&self, cell: [u32; 3], out: &mut [f32; 64]) {
        let (n, [nx, ny, _]) = (D + 1, self.dims);
        let before = usize::from(D > 1);
        let inside = |a: usize| cell[a] as usize >= before && cell[a] as usize - before + n <= self.dims[a];
        values!(self.values, c => if inside(0) && inside(1) && inside(2) {
            let [x, y, z] = cell.map(|i| i as usize - before);
            for k in 0..n {
                for j in 0..n {
                    let row = &c[((z + k) * ny + y + j) * nx + x..][..n];
                    for i in 0..n {
                        out[(k * n + j) * n + i] = row[i].single();
                    }
                }
            }
        } else {
            let index = [0, 1, 2].map(|a| {
                let at = |i: usize| self.border.index(cell[a] as isize - before as isize + i as isize, self.dims[a]);
                std::array::from_fn::<usize, 4, _>(|i| if i < n { at(i) } else { 0 })
            });
            for k in 0..n {
                for j in 0..n {
                    for i in 0..n {
                        out[(k * n + j) * n + i] = c[(index[2][k] * ny + index[1][j]) * nx + index[0][i]].single();
                    }
                }
            }
        });
    }
}
