//! A ray through nodes, bricks and cells; what it meets in an active cell is in `cell.rs`.
//!
//! Steinberger 2010, sections 3.2 and 3.3. Different here: instead of the parametric octree traversal of Revelles et al. a digital
//! differential analyser on three sizes (nodes of 16^3, bricks of 4^3, cells) that computes the parameter of *the same plane by the same
//! expression* at every size, so that no ray slips between two of them; the composition is the multi-affine one below; all in f64.
//!
//! **Composition.** The trilinear interpolant restricted to the sub-box between the entry a and the exit b of the ray is again trilinear, with corner
//! values V_ijk = s(x_i, y_j, z_k), where each coordinate is that of a or b. Along the diagonal from a to b its Bernstein coefficients are V_000,
//! (V_100 + V_010 + V_001)/3, (V_011 + V_101 + V_110)/3, V_111: 14 interpolations, and all coefficients are convex combinations of the
//! samples. The coordinate of the plane the ray enters or leaves by is exactly 0 or 1, so that two cells give a shared face the same sign.
//!
//! **Bound on the error of a coefficient.** u = 2^-53, per ray. The position o + t d in index space is off, per axis, by at most
//! E = 16u (|eye - origin of the grid| + |t d|)/spacing + 4u n (subtraction, division, product, sum: four roundings of terms of that size; the rounding of t in a
//! plane's parameter, seen along its axis, is of the same size; 16 leaves a factor of two). s changes by at most 2M per unit of each axis, M the
//! greatest |sample - c| of the volume, so position errors move a coefficient by at most 6EM. Subtracting c costs uM; three interpolations
//! 3 * 3uM; the sum of three and the product with 1/3 at most 4uM: together under 16uM. Evaluation by de Casteljau's rule adds 6uM. The bound is
//! **(6E + 64u) M**; it is used for all coefficients of the ray, and the test whether a cell or brick can meet c is widened by it. Then:
//! a stretch of the ray that lies within E of a face and was attributed to the wrong one of two cells is covered too, because both interpolants agree on the face and leave it by at most 2ME.

use crate::bricks::{Active, Values, bit};
use crate::cell::{Root, Scratch, Way};
pub(crate) use isobar_cpu::index::Bounds;
use isobar_cpu::index::{self, IndexSpace, Line, Rounding};
use isobar_cpu::nodes::Cast;
pub(crate) use isobar_cpu::packet::three;

/// The bound above.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Trilinear;

impl Rounding for Trilinear {
    const POSITION: f64 = 16.0;
    const INDEX: f64 = 4.0;
    const PART: f64 = 6.0;
    const REST: f64 = 64.0;
    /// s changes by at most 2M per unit of an axis.
    const STEEPEST: f64 = 6.0;
}

/// Index space of a grid.
pub(crate) type Space = IndexSpace<Trilinear>;

/// A ray in index space.
pub(crate) type Walk = Line;

/// Whether a ray meets the box [0, dims - 1], where the planes keep it.
pub(crate) type Entry = index::Entry<Walk>;

/// Work done along rays.
#[derive(Debug, Default, Clone, Copy)]
pub(crate) struct Work {
    pub(crate) nodes: u64,
    pub(crate) bricks: u64,
    /// Active cells crossed.
    pub(crate) cells: u64,
    /// As many, once per isovalue.
    pub(crate) cubics: u64,
    /// Rays that went alone.
    pub(crate) alone: u64,
    /// Rays decided in exact arithmetic, and those that it left undecided.
    pub(crate) exact: [u64; 2],
}

/// A volume with the surfaces sought in it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Search<'a> {
    pub(crate) samples: Values<'a>,
    pub(crate) dims: [usize; 3],
    pub(crate) active: &'a Active,
    pub(crate) bounds: &'a [Bounds],
    /// (6E + 64u) of these rays.
    pub(crate) margin: f64,
    /// Prove what can be proved.
    pub(crate) claims: bool,
}

impl Search<'_> {
    /// Calls `push` with the roots in order until it returns false. Returns whether all of the ray that was walked is certain.
    #[inline(always)]
    pub(crate) fn roots(&self, walk: Walk, scratch: &mut Scratch, work: &mut Work, push: impl FnMut(&Root) -> bool) -> bool {
        scratch.reset();
        let mut way = Way::new(walk, scratch, work, push);
        let cells = self.dims.map(|n| n as i32 - 1);
        let walk = way.walk;
        walk.cross(&self.active.nodes, cells, self, &mut way);
        self.end(&mut way);
        way.certain
    }
}

impl<F: FnMut(&Root) -> bool> Cast<Way<'_, F>> for Search<'_> {
    type Brick = u64;

    #[inline(always)]
    fn node(&self, way: &mut Way<'_, F>) {
        way.work.nodes += 1;
    }

    #[inline(always)]
    fn brick(&self, way: &mut Way<'_, F>, word: usize, brick: [i32; 3]) -> u64 {
        way.work.bricks += 1;
        self.active
            .cells(word, bit(brick), brick, self.samples, self.dims, self.bounds)
    }

    #[inline(always)]
    fn cell(&self, way: &mut Way<'_, F>, active: &u64, cell: [i32; 3], from: f64, to: f64) -> bool {
        active >> bit(cell) & 1 == 0 || Search::cell(self, way, cell, from, to)
    }
}
