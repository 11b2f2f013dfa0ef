//! The index space of a grid, the part of a ray inside it, and what rounding can hide there.
//!
//! A plane's parameter is *one expression of its index*, whatever the size of the blocks it separates ([`Line::plane`]), so that blocks inside one another end at the same bits and no
//! stretch of a ray falls between two of them. Where a ray enters or leaves the domain the plane is off by the error of a position, and a clipping plane by what [`clip`] says: the part
//! of the ray is known as rounded, in a domain grown by that error, and in one shrunk by it; [`Line::ends`] is what lies between.

use crate::clip::{self, Side, kept};
use crate::packet::{self, Lanes, three};
use glam::DVec3;
use isobar_core::{ClipPlane, Domain, Ray};
use std::fmt::Debug;
use std::marker::PhantomData;

/// Unit roundoff of f64.
const U: f64 = 0.5 * f64::EPSILON;

/// How a method bounds what rounding does: it derives these numbers where its polynomials are made.
///
/// u = 2^-53. A position in index space is off per axis by at most E = [`POSITION`](Self::POSITION) u (|eye - origin of the grid| + |t d|)/spacing + [`INDEX`](Self::INDEX) u n, the first the
/// greatest of the three axes where these are the world's. The
/// *margin* of a ray is [`PART`](Self::PART) E + [`REST`](Self::REST) u: what a coefficient along it is off by, in units of the greatest |datum - isovalue|.
pub trait Rounding: Debug + Clone + Copy + Send + Sync + 'static {
    /// Roundings of a position, in those of world coordinates; eight times as many, and [`IndexSpace::skew`](IndexSpace) times, where the axes are not those of the world.
    const POSITION: f64;
    /// Roundings of a position, in those of the greatest index.
    const INDEX: f64;
    /// Errors E of a position that the margin holds.
    const PART: f64;
    /// Roundings that the margin holds beside.
    const REST: f64;
    /// How much faster the function changes along a ray than the ray itself moves, in units of the greatest |datum - isovalue|, index units and its fastest axis.
    const STEEPEST: f64;

    /// More than the greatest t at which a ray can be inside a box of the world: see [`clip::reach`].
    #[inline(always)]
    #[must_use]
    fn reach(ray: &Ray, world: (DVec3, DVec3)) -> f64 {
        clip::reach(ray, world)
    }
}

/// An isovalue with what is needed to be sure about it.
#[derive(Debug, Clone, Copy)]
pub struct Bounds {
    /// The isovalue.
    pub isovalue: f64,
    /// Greatest |datum - isovalue|.
    pub size: f64,
    lo: f64,
    hi: f64,
}

impl Bounds {
    /// `margin`: the greatest margin of any ray to come; `range` that of all data.
    #[must_use]
    pub fn new(isovalue: f64, margin: f64, range: (f64, f64)) -> Self {
        let size = (range.1 - isovalue).abs().max((range.0 - isovalue).abs());
        let m = margin * size;
        Self {
            isovalue,
            size,
            lo: isovalue - m,
            hi: isovalue + m,
        }
    }

    /// What counts as reaching the isovalue, in units of the data.
    #[must_use]
    pub fn margin(&self) -> f64 {
        self.hi - self.isovalue
    }

    /// What lies below the first or above the second cannot reach the isovalue, up to the margin.
    #[inline(always)]
    #[must_use]
    pub fn ends(&self) -> (f64, f64) {
        (self.lo, self.hi)
    }

    /// Whether values between `lo` and `hi` can reach the isovalue, up to the margin.
    #[inline(always)]
    #[must_use]
    pub fn meets(&self, lo: f64, hi: f64) -> bool {
        lo <= self.hi && hi >= self.lo
    }
}

/// Index space of a grid, with a method's bounds on rounding.
#[derive(Debug, Clone, Copy)]
pub struct IndexSpace<R> {
    /// The grid's.
    pub domain: Domain,
    /// Whether its axes are those of the world.
    pub aligned: bool,
    /// World displacement to index space, by columns: the reciprocal spacings, or the inverse of the axes.
    pub to_index: [DVec3; 3],
    /// World bounds of the domain.
    pub world: (DVec3, DVec3),
    /// Added to indices of samples in a [`Line`].
    shift: f64,
    /// Index units per world unit, an upper bound.
    scale: f64,
    /// Product of the lengths of the axes over the volume they span: how much the inverse of a skew matrix loses; 1 where they are orthogonal.
    skew: f64,
    rounding: PhantomData<R>,
}

impl<R: Rounding> IndexSpace<R> {
    /// Of a grid with this domain.
    #[must_use]
    pub fn new(domain: Domain) -> Self {
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
            aligned,
            to_index,
            world: domain.world_bounds(),
            shift: 0.0,
            scale: if aligned {
                to_index[0].x.abs().max(to_index[1].y.abs()).max(to_index[2].z.abs())
            } else {
                to_index.iter().map(|c| c.length()).sum()
            },
            skew: a.x_axis.length() * a.y_axis.length() * a.z_axis.length() / a.determinant().abs(),
            rounding: PhantomData,
        }
    }

    /// The same with `shift` added to the indices in a [`Line`], so that cells centred on samples begin at whole numbers.
    #[must_use]
    pub fn shifted(self, shift: f64) -> Self {
        Self { shift, ..self }
    }

    /// What is added to the index of a sample in a [`Line`].
    #[must_use]
    pub const fn shift(&self) -> f64 {
        self.shift
    }

    /// A world displacement in index space.
    #[inline(always)]
    #[must_use]
    pub fn index_vector(&self, v: DVec3) -> DVec3 {
        let [x, y, z] = self.to_index;
        if self.aligned {
            v * DVec3::new(x.x, y.y, z.z)
        } else {
            x * v.x + y * v.y + z * v.z
        }
    }

    /// World gradient from that in index space.
    #[inline(always)]
    #[must_use]
    pub fn world_gradient(&self, g: DVec3) -> DVec3 {
        let [x, y, z] = self.to_index;
        if self.aligned {
            g * DVec3::new(x.x, y.y, z.z)
        } else {
            DVec3::new(x.dot(g), y.dot(g), z.dot(g))
        }
    }

    /// The bound E of [`Rounding`] for rays from `origin`, as far as they can be inside the domain.
    #[inline(always)]
    #[must_use]
    pub fn position_error(&self, origin: DVec3) -> f64 {
        let n = self.domain.hi.max_element() + self.shift + 1.0;
        // Rays are counted from the origin of the grid, by one subtraction: how far both are from that of the world is nothing to them.
        let from = (origin - self.domain.origin).abs();
        let (axes, hi) = (self.domain.axes, self.domain.hi);
        let to = from + axes.x_axis.abs() * hi.x + axes.y_axis.abs() * hi.y + axes.z_axis.abs() * hi.z;
        let indices = if self.aligned {
            let [x, y, z] = self.to_index;
            ((from + 2.0 * to) * DVec3::new(x.x, y.y, z.z).abs()).max_element()
        } else {
            // The inverse of a general matrix loses some more digits, the more the nearer the axes are to a plane.
            8.0 * self.skew * (from.max_element() + 2.0 * to.length()) * self.scale
        };
        R::POSITION * U * indices + R::INDEX * U * n
    }

    /// The margin of a ray from `origin`, as far as it can be inside the domain.
    #[inline(always)]
    #[must_use]
    pub fn margin(&self, origin: DVec3) -> f64 {
        R::PART * self.position_error(origin) + R::REST * U
    }

    /// No point of the domain lies further along the ray than this.
    #[inline(always)]
    #[must_use]
    pub fn reach(&self, ray: &Ray) -> f64 {
        R::reach(ray, self.world)
    }
}

impl<R: Rounding> packet::Space for IndexSpace<R> {
    const PART: f64 = R::PART;
    const STEEPEST: f64 = R::STEEPEST;

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

/// A root that is known no better than to this part of a voxel is vague: its proof holds, and yet more than the rounding of its t may be wrong with the picture.
const VAGUE: f64 = 1e-5;

/// The error of t from which on a root is vague, for rays that advance by `speed` (units of the world) as t grows by 1. Spacings may differ: a voxel is as long as its shortest edge here.
#[must_use]
pub fn vague(domain: &Domain, speed: f64) -> f64 {
    let a = domain.axes;
    VAGUE * a.x_axis.length().min(a.y_axis.length()).min(a.z_axis.length()) / speed
}

/// Components of a direction below this part of the greatest are taken as 0: their reciprocals would overflow, and over the longest way through a domain they move a position by nothing
/// that counts.
const NOTHING: f64 = 1e-100;

/// A direction without components that are next to nothing.
#[inline(always)]
#[must_use]
pub fn cleaned(d: [f64; 3]) -> [f64; 3] {
    let most = fastest(d);
    three(|a| if d[a].abs() < NOTHING * most { 0.0 } else { d[a] })
}

#[inline(always)]
fn fastest(d: [f64; 3]) -> f64 {
    d[0].abs().max(d[1].abs()).max(d[2].abs())
}

/// Whether so little is left of a direction (some 1e-300 voxels), or it is so long, that planes of a domain which ends at `hi` have no finite parameters: no t is known then, and nothing may be claimed.
/// `o`: the origin; `inv`: the reciprocals of `d`, 0 for what is 0.
#[inline(always)]
#[must_use]
pub fn overflows(o: [f64; 3], d: [f64; 3], inv: [f64; 3], hi: [f64; 3]) -> bool {
    let far = |a: usize| (o[a].abs() + hi[a] + 1.0) * inv[a].abs();
    !(fastest(d) > 0.0 && fastest(d).is_finite() && far(0).is_finite() && far(1).is_finite() && far(2).is_finite())
}

/// What planes keep of a ray in a domain grown by e.
#[inline(always)]
#[must_use]
pub fn side(e: f64) -> Side {
    if e == 0.0 {
        Side::Rounded
    } else if e > 0.0 {
        Side::Outer
    } else {
        Side::Inner
    }
}

/// See [`Line::ends`]. `of(e)`: the parameters at which the ray enters and leaves the domain grown by e; `e` is at least the error of a position.
/// The ray enters and leaves within the grown and the shrunk domain.
#[inline(always)]
#[must_use]
pub fn ends(steepest: f64, d: [f64; 3], [t0, t1]: [f64; 2], e: f64, of: impl Fn(f64) -> (f64, f64)) -> f64 {
    let ((first, last), (late, early)) = (of(e), of(-e));
    // What is not a number meets nothing, and bounds nothing.
    let met = late <= early;
    if !met || [t0, t1, first, last, late, early].iter().any(|t| !t.is_finite()) {
        return f64::INFINITY;
    }
    // At an edge of the domain the inner distance can be the larger one: another plane decides there.
    steepest * (t0 - first).max(last - t1).max(late - t0).max(t1 - early) * fastest(d)
}

/// A ray in index space, and the part of it in the domain. `HALVES`: cells begin half an index below their number (they are centred on samples, and positions are not shifted).
#[derive(Debug, Clone, Copy)]
pub struct Line<const HALVES: bool = false> {
    /// Origin.
    pub o: [f64; 3],
    /// Direction.
    pub d: [f64; 3],
    /// Reciprocals of its components; 0 for those that are 0.
    pub inv: [f64; 3],
    /// Parameter of the plane with coordinate x: `x * inv + shift`; +inf where the ray is parallel to it.
    pub shift: [f64; 3],
    /// 1 along axes that the ray ascends, 0 along others.
    pub up: [i32; 3],
    /// 1 along axes that the ray ascends, -1 along others.
    pub step: [i32; 3],
    /// Where it enters.
    pub t0: f64,
    /// Where it leaves.
    pub t1: f64,
    /// What the margin of this ray grows by, so that a certain sign at t0 and t1 holds for what lies between them and the true ends of the domain; +inf where the ray may miss the
    /// domain altogether, 0 where nothing is to be proved.
    pub ends: f64,
}

/// Whether a ray meets what is kept of the domain.
#[derive(Debug)]
pub enum Entry<L> {
    /// It does.
    Through(L),
    /// It does not; for certain, if it would miss a domain larger by its error too.
    Misses {
        /// Whether that is proved.
        certain: bool,
    },
}

impl<L> Entry<L> {
    /// With what a method keeps of the line beside.
    #[inline(always)]
    #[must_use]
    pub fn map<M>(self, f: impl FnOnce(L) -> M) -> Entry<M> {
        match self {
            Self::Through(line) => Entry::Through(f(line)),
            Self::Misses { certain } => Entry::Misses { certain },
        }
    }
}

impl<const HALVES: bool> Line<HALVES> {
    /// The part at t >= 0 of a ray inside the domain that all clipping planes keep; `margin`: that of the ray, where something is to be proved. A ray whose direction is so short that the
    /// parameters of planes overflow misses, and that is not certain.
    #[inline(always)]
    #[must_use]
    pub fn enter<R: Rounding>(ray: &Ray, space: &IndexSpace<R>, clips: &[ClipPlane], margin: Option<f64>) -> Entry<Self> {
        let o = space.index_vector(ray.origin - space.domain.origin);
        // Not + 0: that changes the sign of a zero.
        let o = if space.shift == 0.0 { o } else { o + space.shift }.to_array();
        let d = cleaned(space.index_vector(ray.direction).to_array());
        let inv = three(|a| if d[a] == 0.0 { 0.0 } else { 1.0 / d[a] });
        let shift = three(|a| if d[a] == 0.0 { f64::INFINITY } else { -o[a] * inv[a] });
        if overflows(o, d, inv, space.domain.hi.to_array()) {
            return Entry::Misses { certain: false };
        }
        // The stretch inside the domain grown by e on every side, and with it what the planes keep.
        let inside = |e: f64| {
            let (mut t0, mut t1) = (0.0f64, f64::INFINITY);
            if !clips.is_empty() {
                (t0, t1) = kept(ray, clips, space.reach(ray), side(e));
            }
            for a in 0..3 {
                let (lo, hi) = (-(e - space.shift), space.domain.hi[a] + space.shift + e);
                if d[a] == 0.0 {
                    if o[a] < lo || o[a] > hi {
                        t1 = -1.0;
                    }
                } else {
                    let (x, y) = (lo * inv[a] + shift[a], hi * inv[a] + shift[a]);
                    t0 = t0.max(x.min(y));
                    t1 = t1.min(x.max(y));
                }
            }
            (t0, t1)
        };
        let (t0, t1) = inside(0.0);
        if t0 > t1 {
            let outside = |margin| {
                let (a, b) = inside(margin);
                a > b
            };
            return Entry::Misses {
                certain: margin.is_some_and(outside),
            };
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
            ends: margin.map_or(0.0, |m| ends(R::STEEPEST, d, [t0, t1], m / R::PART, inside)),
        })
    }

    /// Parameter of the plane at which the cells with index `at` begin along axis `a`: the same expression for cells, bricks and nodes.
    #[inline(always)]
    #[must_use]
    pub fn plane(&self, a: usize, at: i32) -> f64 {
        let x = f64::from(at);
        (if HALVES { x - 0.5 } else { x }) * self.inv[a] + self.shift[a]
    }

    /// Parameters at which the ray leaves the block of `1 << log` cells per axis with index `i`.
    #[inline(always)]
    #[must_use]
    pub fn exits(&self, i: [i32; 3], log: u32) -> [f64; 3] {
        three(|a| self.plane(a, (i[a] + self.up[a]) << log))
    }

    /// Position at t along one axis.
    #[inline(always)]
    #[must_use]
    pub fn at(&self, a: usize, t: f64) -> f64 {
        self.o[a] + t * self.d[a]
    }

    /// Index of the cell at t along one axis; only where that is not negative.
    #[inline(always)]
    #[must_use]
    pub fn cell_at(&self, a: usize, t: f64) -> i32 {
        let x = self.at(a, t);
        (if HALVES { x + 0.5 } else { x }) as i32
    }

    /// Index units per unit of t along the fastest axis.
    #[inline(always)]
    #[must_use]
    pub fn speed(&self) -> f64 {
        fastest(self.d)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use isobar_core::DMat3;

    #[derive(Debug, Clone, Copy)]
    struct Trilinear;
    impl Rounding for Trilinear {
        const POSITION: f64 = 16.0;
        const INDEX: f64 = 4.0;
        const PART: f64 = 6.0;
        const REST: f64 = 64.0;
        const STEEPEST: f64 = 6.0;
    }

    fn space(shift: f64) -> IndexSpace<Trilinear> {
        let domain = Domain {
            origin: DVec3::new(-1.0, 2.0, 0.5),
            axes: DMat3::from_diagonal(DVec3::new(0.5, 2.0, 1.0)),
            lo: DVec3::ZERO,
            hi: DVec3::new(8.0, 9.0, 10.0),
        };
        IndexSpace::new(domain).shifted(shift)
    }

    fn enter<const HALVES: bool>(space: &IndexSpace<Trilinear>, origin: DVec3, direction: DVec3) -> Entry<Line<HALVES>> {
        let ray = Ray { origin, direction };
        Line::enter(&ray, space, &[], Some(space.margin(origin)))
    }

    #[test]
    fn a_ray_enters_and_leaves_where_it_should() {
        let s = space(0.0);
        let at = s.domain.world(DVec3::new(-3.0, 4.25, 5.0));
        let Entry::Through(line) = enter::<false>(&s, at, DVec3::X) else {
            panic!("it goes through")
        };
        // 3 cells of half a unit before the domain.
        assert!((line.t0 - 1.5).abs() < 1e-12 && (line.t1 - 5.5).abs() < 1e-12, "{line:?}");
        assert!(line.ends > 0.0 && line.ends < 1e-12);
        assert_eq!((line.plane(0, 2), line.cell_at(0, 2.6), line.cell_at(1, 2.6)), (2.5, 2, 4));
        assert!(line.plane(1, 3).is_infinite() && line.speed() == 2.0);
        // Cells centred on samples, by number and by shifted index space.
        let Entry::Through(centred) = enter::<true>(&s, at, DVec3::X) else {
            panic!("it goes through")
        };
        let Entry::Through(shifted) = enter::<false>(&space(0.5), at, DVec3::X) else {
            panic!("it goes through")
        };
        for at in 0..9 {
            assert!((centred.plane(0, at) - shifted.plane(0, at)).abs() < 1e-12);
        }
        assert_eq!([centred.cell_at(0, 2.6), shifted.cell_at(0, 2.6)], [2, 2]);
        let miss = |y: f64| match enter::<false>(&s, s.domain.world(DVec3::new(-3.0, y, 5.0)), DVec3::X) {
            Entry::Through(_) => None,
            Entry::Misses { certain } => Some(certain),
        };
        assert_eq!((miss(9.5), miss(9.0 + 4e-15), miss(9.0)), (Some(true), Some(false), None));
    }

    /// A root may lie at 1e307, but no plane has a parameter there: nothing is claimed.
    #[test]
    fn directions_too_short_for_parameters_prove_nothing() {
        let s = space(0.0);
        let inside = s.domain.world(DVec3::splat(3.3));
        let outside = s.domain.world(DVec3::new(-900.0, 3.3, 3.3));
        for (origin, x) in [
            (outside, 1e-306),
            (inside, 5e-309),
            (inside, -5e-309),
            (outside, 5e-324),
            (outside, 1.5e308),
        ] {
            let entry = enter::<false>(&s, origin, DVec3::X * x);
            assert!(matches!(entry, Entry::Misses { certain: false }), "{x}: {entry:?}");
        }
        assert!(matches!(enter::<false>(&s, outside, DVec3::X * 1e-290), Entry::Through(_)));
    }
}
