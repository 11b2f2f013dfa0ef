//! Index space, a ray in it, and the bound that all proofs rest on.
//!
//! **Bound on the error of a Bernstein coefficient.** u = 2^-53, per ray. A position o + t d in index space is off per axis by at most E = 24u (|eye| + |origin of the
//! grid| + |t d|)/spacing + 4u n (four roundings of terms of that size; that of a plane's parameter, seen across the plane, is of the same size; 24 leaves a factor of
//! two). M is the greatest |datum - c| of the volume. The four barycentric coordinates are off by 10 E together, and each of the three arguments of a blossom moves it by as much of M.
//! - A coefficient of a tetrahedron costs 14uM (one difference, sums of at most 9 terms that amount to at most 192M, one division), a step of de Casteljau's rule 7uM, another
//!   isovalue 2uM (M then the greater of its own and that of the first isovalue, which coefficients are relative to), an evaluation of the cubic 14uM.
//! - The value at an end: 30EM + (14 + 3 * 7)uM.
//! - The inner coefficients add a third of the slope times the length: the `b^[2]` there, off by 20EM + 28uM, times the change of the barycentric coordinates along the segment, at most
//!   5 together (its length is at most sqrt(3)/2): 100EM + 140uM, 35uM for the sum itself, and 12EM because the length of the segment is off by 2E.
//! - The slope at the start is that of the tetrahedron before (C1). Its point lies within E of the common face, where the slopes of the two cubics differ by at most 300ME (second
//!   derivatives are at most 6 * 5^2 M): times a third of the length, 87EM.
//!
//! Together below **(256E + 256u) M**. Packets of rays (`packet/`) blossom with both ends instead, so all four coefficients have the bound of a value: 30EM, no division,
//! 10uM for the sums of the masks, 21uM for three steps, and 4uM because positions are counted from centres shifted by 1/2: less than a seventh of it. A stretch within E of a face that was given to the wrong one of two tetrahedra is covered: their
//! cubics join with C1, so they differ there by the square of E.

use glam::DVec3;
use isobar_core::{ClipPlane, Domain, Ray};
use isobar_cpu::clip::{Side, kept, reach};

/// One value per axis. `array::map` is not inlined into functions compiled for more instructions than the crate.
#[inline(always)]
pub(crate) fn three<R>(f: impl Fn(usize) -> R) -> [R; 3] {
    [f(0), f(1), f(2)]
}

/// Errors of a position that the margin holds.
pub(crate) const PART: f64 = 256.0;

/// Unit roundoff of f64.
const U: f64 = 0.5 * f64::EPSILON;

/// An isovalue with what is needed to be sure about it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Bounds {
    pub(crate) isovalue: f64,
    /// Greatest |datum - isovalue|.
    pub(crate) size: f64,
    lo: f64,
    hi: f64,
}

impl Bounds {
    /// `margin`: the greatest relative bound of any ray to come; `range` that of all data.
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

    /// What counts as reaching the isovalue.
    pub(crate) fn margin(&self) -> f64 {
        self.hi - self.isovalue
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
    /// Index units per world unit, an upper bound.
    scale: f64,
    pub(crate) aligned: bool,
    /// Product of the lengths of the axes over the volume they span: how much the inverse of a skew matrix loses.
    skew: f64,
    /// World displacement to index space: the reciprocal spacings, or the inverse of the axes.
    to_index: [DVec3; 3],
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

    /// The relative bound of a ray from `origin`, as far as it can be inside the domain: 256E + 256u.
    #[inline(always)]
    pub(crate) fn margin(&self, origin: DVec3) -> f64 {
        let (lo, hi) = self.world;
        let far = (origin - lo).abs().max((origin - hi).abs()).length();
        let n = self.domain.hi.max_element() + 1.0;
        let world = origin.abs().max_element() + self.domain.origin.abs().max_element() + 2.0 * far;
        // The inverse of a general matrix loses some more digits, the more the nearer the axes are to a plane.
        let factor = if self.aligned { 24.0 } else { 192.0 * self.skew };
        PART * (factor * U * world * self.scale + 4.0 * U * n) + 256.0 * U
    }

    /// World gradient from that in index space.
    #[inline(always)]
    pub(crate) fn world_gradient(&self, g: [f64; 3]) -> DVec3 {
        let [x, y, z] = self.to_index;
        let g = DVec3::from_array(g);
        if self.aligned {
            g * DVec3::new(x.x, y.y, z.z)
        } else {
            DVec3::new(x.dot(g), y.dot(g), z.dot(g))
        }
    }
}

/// The planes `x_a +- x_b`: axes and sign.
pub(crate) const FORMS: [(usize, usize, f64); 6] = [
    (0, 1, 1.0),
    (0, 1, -1.0),
    (0, 2, 1.0),
    (0, 2, -1.0),
    (1, 2, 1.0),
    (1, 2, -1.0),
];

/// A ray in index space.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Walk {
    pub(crate) o: [f64; 3],
    pub(crate) d: [f64; 3],
    pub(crate) inv: [f64; 3],
    /// Parameter of the plane x_a = v: `v * inv + shift`; +inf where the ray is parallel to it.
    pub(crate) shift: [f64; 3],
    /// The same for the six forms; never inside the domain where the ray is parallel.
    pub(crate) form_inv: [f64; 6],
    pub(crate) form_shift: [f64; 6],
    pub(crate) up: [i32; 3],
    pub(crate) step: [i32; 3],
    pub(crate) t0: f64,
    pub(crate) t1: f64,
    /// What the margin grows by, so that a certain sign at t0 and t1 holds up to the true ends, of the domain shrunk and grown by the error of a position and of what clipping planes
    /// keep within theirs; +inf where the ray may miss all of it.
    pub(crate) ends: f64,
}

/// How much faster s changes along a ray than the ray itself moves, in units of M, index units and its fastest axis: for what lies between the ends of
/// the domain and the true ones.
pub(crate) const STEEPEST: f64 = 32.0;

/// Components of a direction below this part of the greatest are taken as 0: their reciprocals would overflow, and they move no position.
const NOTHING: f64 = 1e-100;

/// Whether a ray meets the box.
#[expect(
    clippy::large_enum_variant,
    reason = "lives on the stack of one ray; a box would cost an allocation a ray"
)]
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

impl Walk {
    /// The way of a ray through the box [0, dims - 1] at t >= 0, where all clipping planes keep it. `margin`: its relative bound.
    #[inline(always)]
    pub(crate) fn enter(ray: &Ray, space: &Space, clips: &[ClipPlane], margin: f64) -> Entry {
        let o = space.index_vector(ray.origin - space.domain.origin).to_array();
        let d = space.index_vector(ray.direction).to_array();
        let most = d[0].abs().max(d[1].abs()).max(d[2].abs());
        let d = d.map(|x| if x.abs() < NOTHING * most { 0.0 } else { x });
        let inv = three(|a| if d[a] == 0.0 { 0.0 } else { 1.0 / d[a] });
        let shift = three(|a| if d[a] == 0.0 { f64::INFINITY } else { -o[a] * inv[a] });
        let mut form_inv = [0.0; 6];
        let mut form_shift = [f64::NEG_INFINITY; 6];
        for (n, &(a, b, sign)) in FORMS.iter().enumerate() {
            let (p, q) = (o[a] + sign * o[b], d[a] + sign * d[b]);
            if q != 0.0 {
                form_inv[n] = 1.0 / q;
                form_shift[n] = -p * form_inv[n];
            }
        }
        // The stretch inside the box grown by e on every side, and with it what the planes keep.
        let inside = |e: f64, side: Side| {
            let (mut t0, mut t1) = if clips.is_empty() {
                (0.0f64, f64::INFINITY)
            } else {
                kept(ray, clips, reach(ray, space.world), side)
            };
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
        let (t0, t1) = inside(0.0, Side::Rounded);
        if t0 > t1 {
            let (a, b) = inside(margin, Side::Outer);
            return Entry::Misses { certain: a > b };
        }
        // The margin holds the error of a position 256 times; over as long a way s changes by at most 32 times it. The true ends lie between the outer and the inner ones, on
        // either side of the rounded ones.
        let error = margin / PART;
        let ((first, last), (late, early)) = (inside(error, Side::Outer), inside(-error, Side::Inner));
        let loose = (t0 - first).max(late - t0).max(last - t1).max(t1 - early);
        Entry::Through(Self {
            ends: if late <= early {
                STEEPEST * loose * most
            } else {
                f64::INFINITY
            },
            o,
            d,
            inv,
            shift,
            form_inv,
            form_shift,
            up: three(|a| i32::from(d[a] >= 0.0)),
            step: three(|a| if d[a] >= 0.0 { 1 } else { -1 }),
            t0,
            t1,
        })
    }

    /// Parameter of the lower face of cube `at`: `x_a = at - 1/2`.
    #[inline(always)]
    pub(crate) fn plane(&self, a: usize, at: i32) -> f64 {
        (f64::from(at) - 0.5) * self.inv[a] + self.shift[a]
    }

    /// Parameters at which the ray leaves the block of `1 << log` cubes per axis with index `i`.
    #[inline(always)]
    pub(crate) fn exits(&self, i: [i32; 3], log: u32) -> [f64; 3] {
        three(|a| self.plane(a, (i[a] + self.up[a]) << log))
    }

    #[inline(always)]
    pub(crate) fn cube_at(&self, a: usize, t: f64) -> i32 {
        (self.o[a] + t * self.d[a] + 0.5) as i32
    }
}
