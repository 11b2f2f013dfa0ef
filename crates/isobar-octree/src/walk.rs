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
//! E = 16u (|eye| + |origin of the grid| + |t d|)/spacing + 4u n (subtraction, division, product, sum: four roundings of terms of that size; the rounding of t in a
//! plane's parameter, seen along its axis, is of the same size; 16 leaves a factor of two). s changes by at most 2M per unit of each axis, M the
//! greatest |sample - c| of the volume, so position errors move a coefficient by at most 6EM. Subtracting c costs uM; three interpolations
//! 3 * 3uM; the sum of three and the product with 1/3 at most 4uM: together under 16uM. Evaluation by de Casteljau's rule adds 6uM. The bound is
//! **(6E + 64u) M**; it is used for all coefficients of the ray, and the test whether a cell or brick can meet c is widened by it. Then:
//! a stretch of the ray that lies within E of a face and was attributed to the wrong one of two cells is covered too, because both interpolants agree on the face and leave it by at most 2ME.

use crate::bricks::{Active, SIDE, Sample, bit};
use crate::cell::{Root, Scratch, Way};
use glam::DVec3;
use isobar_core::{ClipPlane, Domain, Ray};
use isobar_cpu::clip::{self, Side, kept};
pub(crate) use isobar_cpu::packet::three;
use isobar_cpu::packet::{self, Lanes};

/// Unit roundoff of f64.
const U: f64 = 0.5 * f64::EPSILON;

/// An isovalue with what is needed to be sure about it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bounds {
    pub(crate) isovalue: f64,
    /// Greatest |sample - isovalue|.
    pub(crate) size: f64,
    lo: f64,
    hi: f64,
}

impl Bounds {
    /// `margin`: the greatest relative bound (6E + 64u) of any ray to come; `range` that of all samples.
    pub(crate) fn new(isovalue: f64, margin: f64, range: (f64, f64)) -> Self {
        let size = (range.1 - isovalue).abs().max((range.0 - isovalue).abs());
        let m = margin * size;
        Self {
            isovalue,
            size,
            lo: isovalue - m,
            hi: isovalue + m,
        }
    }

    /// Whether values between `lo` and `hi` can reach the isovalue, up to the margin.
    #[inline(always)]
    pub(crate) fn meets(&self, lo: f64, hi: f64) -> bool {
        lo <= self.hi && hi >= self.lo
    }
}

/// Index space of a grid.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Space {
    pub(crate) domain: Domain,
    /// Per axis: index units per world unit, an upper bound.
    scale: f64,
    pub(crate) aligned: bool,
    /// Product of the lengths of the axes over the volume they span: how much the inverse of a skew matrix loses; 1 where they are orthogonal.
    skew: f64,
    /// World displacement to index space: the reciprocal spacings, or the inverse of the axes.
    pub(crate) to_index: [DVec3; 3],
    /// World bounds.
    pub(crate) world: (DVec3, DVec3),
}

impl Space {
    pub(crate) fn new(domain: Domain) -> Self {
        let a = domain.axes;
        let aligned = domain.is_axis_aligned();
        let to_index = if aligned {
            [DVec3::X / a.x_axis.x, DVec3::Y / a.y_axis.y, DVec3::Z / a.z_axis.z]
        } else {
            let m = a.inverse();
            [m.x_axis, m.y_axis, m.z_axis]
        };
        Self {
            domain,
            scale: if aligned {
                to_index[0].x.abs().max(to_index[1].y.abs()).max(to_index[2].z.abs())
            } else {
                to_index.iter().map(|c| c.length()).sum()
            },
            aligned,
            skew: a.x_axis.length() * a.y_axis.length() * a.z_axis.length() / a.determinant().abs(),
            to_index,
            world: domain.world_bounds(),
        }
    }

    #[inline(always)]
    pub(crate) fn index_vector(&self, v: DVec3) -> DVec3 {
        let [x, y, z] = self.to_index;
        if self.aligned {
            v * DVec3::new(x.x, y.y, z.z)
        } else {
            x * v.x + y * v.y + z * v.z
        }
    }

    /// The margin (6E + 64u) of a ray from `origin`, as far as it can be inside the domain.
    #[inline(always)]
    pub(crate) fn margin(&self, origin: DVec3) -> f64 {
        let (lo, hi) = self.world;
        let far = (origin - lo).abs().max((origin - hi).abs()).length();
        let n = self.domain.hi.max_element() + 1.0;
        let world = origin.abs().max_element() + self.domain.origin.abs().max_element() + 2.0 * far;
        // The inverse of a general matrix loses some more digits, the more the nearer the axes are to a plane.
        let factor = if self.aligned { 16.0 } else { 128.0 * self.skew };
        6.0 * (factor * U * world * self.scale + 4.0 * U * n) + 64.0 * U
    }

    /// No point of the domain lies further along the ray than this.
    #[inline(always)]
    pub(crate) fn reach(&self, ray: &Ray) -> f64 {
        clip::reach(ray, self.world)
    }

    /// World gradient from that in index space.
    #[inline(always)]
    pub(crate) fn world_gradient(&self, g: DVec3) -> DVec3 {
        let [x, y, z] = self.to_index;
        if self.aligned {
            g * DVec3::new(x.x, y.y, z.z)
        } else {
            DVec3::new(x.dot(g), y.dot(g), z.dot(g))
        }
    }
}

impl packet::Space for Space {
    const PART: f64 = 6.0;
    const STEEPEST: f64 = 6.0;

    #[inline(always)]
    fn domain(&self) -> &Domain {
        &self.domain
    }
    #[inline(always)]
    fn world(&self) -> (DVec3, DVec3) {
        self.world
    }
    #[inline(always)]
    fn vector(&self, v: DVec3) -> DVec3 {
        self.index_vector(v)
    }
    #[inline(always)]
    fn vectors<S: Lanes>(&self, v: [S; 3]) -> [S; 3] {
        let m = self.to_index;
        let along = |i: usize, a: usize| S::splat(m[i][a]).mul(v[i]);
        if self.aligned {
            three(|a| along(a, a))
        } else {
            three(|a| along(0, a).add(along(1, a)).add(along(2, a)))
        }
    }
    #[inline(always)]
    fn margin(&self, origin: DVec3) -> f64 {
        Self::margin(self, origin)
    }
}

/// A ray in index space.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Walk {
    pub(crate) o: [f64; 3],
    pub(crate) d: [f64; 3],
    pub(crate) inv: [f64; 3],
    /// Parameter of plane x: `x * inv + shift`; +inf where the ray is parallel to it.
    shift: [f64; 3],
    up: [i32; 3],
    step: [i32; 3],
    t0: f64,
    t1: f64,
    /// What the margin of this ray grows by, so that a certain sign at t0 and t1 holds for what lies between them and the true ends of the domain;
    /// +inf where the ray may miss the domain altogether.
    pub(crate) ends: f64,
}

/// Components of a direction below this part of the greatest one are taken as 0: their reciprocals would overflow, and over the longest way
/// through a domain they move a position by nothing that counts.
const NOTHING: f64 = 1e-100;

/// A direction without components that are next to nothing.
#[inline(always)]
pub(crate) fn cleaned(d: [f64; 3]) -> [f64; 3] {
    let most = d[0].abs().max(d[1].abs()).max(d[2].abs());
    d.map(|x| if x.abs() < NOTHING * most { 0.0 } else { x })
}

/// What planes keep of a ray in a domain grown by e.
#[inline(always)]
pub(crate) fn side(e: f64) -> Side {
    if e == 0.0 {
        Side::Rounded
    } else if e > 0.0 {
        Side::Outer
    } else {
        Side::Inner
    }
}

/// See [`Walk::ends`]. `of(e)`: the parameters at which the ray enters and leaves the domain grown by e; `e` is at least the error of a position.
/// The ray enters and leaves within the grown and the shrunk domain, and s changes by at most 2M per unit of an axis.
#[inline(always)]
pub(crate) fn ends(d: [f64; 3], [t0, t1]: [f64; 2], e: f64, of: impl Fn(f64) -> (f64, f64)) -> f64 {
    let ((first, last), (late, early)) = (of(e), of(-e));
    // What is not a number meets nothing.
    let met = late <= early;
    if !met {
        return f64::INFINITY;
    }
    let most = d[0].abs().max(d[1].abs()).max(d[2].abs());
    // At an edge of the domain the inner distance can be the larger one: another plane decides there.
    6.0 * (t0 - first).max(last - t1).max(late - t0).max(t1 - early) * most
}

impl Walk {
    /// The way of a ray through the box [0, dims - 1] at t >= 0, where the planes keep it. `margin`: its (6E + 64u).
    #[inline(always)]
    pub(crate) fn enter(ray: &Ray, space: &Space, clips: &[ClipPlane], margin: f64) -> Entry {
        let o = space.index_vector(ray.origin - space.domain.origin).to_array();
        let d = cleaned(space.index_vector(ray.direction).to_array());
        let inv = three(|a| if d[a] == 0.0 { 0.0 } else { 1.0 / d[a] });
        let shift = three(|a| if d[a] == 0.0 { f64::INFINITY } else { -o[a] * inv[a] });
        // The stretch inside the box grown by e on every side.
        let inside = |e: f64| {
            let (mut t0, mut t1) = (0.0f64, f64::INFINITY);
            if !clips.is_empty() {
                (t0, t1) = kept(ray, clips, space.reach(ray), side(e));
            }
            for a in 0..3 {
                let hi = space.domain.hi[a] + e;
                if d[a] == 0.0 {
                    if o[a] < -e || o[a] > hi {
                        t1 = -1.0;
                    }
                } else {
                    let (x, y) = (-e * inv[a] + shift[a], hi * inv[a] + shift[a]);
                    t0 = t0.max(x.min(y));
                    t1 = t1.min(x.max(y));
                }
            }
            (t0, t1)
        };
        let (t0, t1) = inside(0.0);
        if t0 > t1 {
            let (a, b) = inside(margin);
            return Entry::Misses { certain: a > b };
        }
        Entry::Through(Self {
            o,
            d,
            inv,
            shift,
            up: three(|a| i32::from(d[a] >= 0.0)),
            step: three(|a| if d[a] >= 0.0 { 1 } else { -1 }),
            t0,
            t1,
            ends: ends(d, [t0, t1], margin / 6.0, inside),
        })
    }

    #[inline(always)]
    pub(crate) fn plane(&self, a: usize, at: i32) -> f64 {
        f64::from(at) * self.inv[a] + self.shift[a]
    }

    /// Parameters at which the ray leaves the block of `1 << log` cells per axis with index `i`.
    #[inline(always)]
    fn exits(&self, i: [i32; 3], log: u32) -> [f64; 3] {
        three(|a| self.plane(a, (i[a] + self.up[a]) << log))
    }

    #[inline(always)]
    fn cell_at(&self, a: usize, t: f64) -> i32 {
        (self.o[a] + t * self.d[a]) as i32
    }
}

/// Whether a ray meets the box.
#[derive(Debug)]
pub(crate) enum Entry {
    /// It does.
    Through(Walk),
    /// It does not; for certain, if it would miss a box larger by its error too.
    Misses {
        /// Whether that is proved.
        certain: bool,
    },
}

#[inline(always)]
fn nearest(t: [f64; 3]) -> usize {
    if t[0] < t[1] {
        if t[0] < t[2] { 0 } else { 2 }
    } else if t[1] < t[2] {
        1
    } else {
        2
    }
}

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
pub(crate) struct Search<'a, T> {
    pub(crate) samples: &'a [T],
    pub(crate) dims: [usize; 3],
    pub(crate) active: &'a Active,
    pub(crate) bounds: &'a [Bounds],
    /// (6E + 64u) of these rays.
    pub(crate) margin: f64,
    /// Prove what can be proved.
    pub(crate) claims: bool,
}

impl<T: Sample> Search<'_, T> {
    /// Calls `push` with the roots in order until it returns false. Returns whether all of the ray that was walked is certain.
    #[inline(always)]
    pub(crate) fn roots(&self, walk: Walk, scratch: &mut Scratch, work: &mut Work, push: impl FnMut(&Root) -> bool) -> bool {
        scratch.reset();
        let mut way = Way::new(walk, scratch, work, push);
        self.nodes(&mut way);
        self.end(&mut way);
        way.certain
    }

    #[inline(always)]
    fn nodes<F: FnMut(&Root) -> bool>(&self, way: &mut Way<'_, F>) {
        let w = way.walk;
        let last = three(|a| (self.dims[a] as i32 - 2) >> 2);
        let words = self.active.dims;
        let mut brick = three(|a| (w.cell_at(a, w.t0) >> 2).clamp(0, last[a]));
        let mut t = w.t0;
        'node: loop {
            way.work.nodes += 1;
            let node = three(|a| brick[a] >> 2);
            let at = (node[2] as usize * words[1] + node[1] as usize) * words[0] + node[0] as usize;
            let word = self.active.words[at];
            if word != 0 {
                let mut exits = w.exits(brick, 2);
                loop {
                    let a = nearest(exits);
                    // Rounded planes may lie behind where the ray is: it never goes back.
                    let te = exits[a].min(w.t1).max(t);
                    if word >> bit(brick) & 1 != 0 && !self.brick(way, at, brick, t, te) {
                        return;
                    }
                    if te >= w.t1 {
                        return;
                    }
                    brick[a] += w.step[a];
                    t = t.max(te);
                    if brick[a] >> 2 != node[a] {
                        if brick[a] < 0 || brick[a] > last[a] {
                            return;
                        }
                        continue 'node;
                    }
                    exits[a] = w.plane(a, (brick[a] + w.up[a]) << 2);
                }
            }
            let exits = w.exits(node, 4);
            let a = nearest(exits);
            if exits[a] >= w.t1 {
                return;
            }
            t = t.max(exits[a]);
            for i in 0..3 {
                brick[i] = (w.cell_at(i, t) >> 2).clamp(node[i] << 2, (node[i] << 2 | 3).min(last[i]));
            }
            brick[a] = if w.step[a] > 0 {
                (node[a] + 1) << 2
            } else {
                (node[a] << 2) - 1
            };
            if brick[a] < 0 || brick[a] > last[a] {
                return;
            }
        }
    }

    /// Returns whether to go on.
    #[inline(always)]
    fn brick<F: FnMut(&Root) -> bool>(&self, way: &mut Way<'_, F>, word: usize, brick: [i32; 3], t0: f64, t1: f64) -> bool {
        way.work.bricks += 1;
        let w = way.walk;
        let mask = self
            .active
            .cells(word, bit(brick), brick, self.samples, self.dims, self.bounds);
        let mut cell = three(|a| {
            let lo = brick[a] << 2;
            w.cell_at(a, t0).clamp(lo, (lo | 3).min(self.dims[a] as i32 - 2))
        });
        let mut exits = w.exits(cell, 0);
        let mut t = t0;
        loop {
            let a = nearest(exits);
            let te = exits[a].min(t1).max(t);
            if mask >> bit(cell) & 1 != 0 && !self.cell(way, cell, t, te) {
                return false;
            }
            if te >= t1 {
                return true;
            }
            cell[a] += w.step[a];
            if cell[a] >> 2 != brick[a] {
                return true;
            }
            t = t.max(te);
            exits[a] = w.plane(a, cell[a] + w.up[a]);
        }
    }
}

const _: () = assert!(SIDE == 4, "words of 64 bits, indices shifted by 2 and 4");
