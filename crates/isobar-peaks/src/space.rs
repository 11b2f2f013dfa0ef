//! Index space, a ray in it, blocks of cells along it, and the bound on what rounding does to a position.
//!
//! Knoll et al. 2009, section 6.1, walks one coarse grid with a 3D DDA. Here there are three sizes of blocks (nodes of 16^3 cells, macrocells of 4^3,
//! cells), each walked by the same [`Dda`]; a plane's parameter is *one expression of its index*, whatever the size of the blocks it
//! separates, so that blocks inside one another end at the same bits and no stretch of a ray falls between two of them.
//!
//! **Bound E on a position** (u = 2^-53, in index units, per axis). A point of a ray is computed as `(eye - origin) * r + t * (d * r)` with r the
//! rounded reciprocal of the spacing. First term: a subtraction, a rounded factor, a product, 3u of |eye| + |origin|, over the spacing. Second term: two
//! products and the rounded factor, 3u |t d|. Their sum: one more u of both. t itself, where it is the parameter of a plane, `index * (1/d) + shift`,
//! carries 3u of the plane's index and 2u of the shift, which is the eye's index; seen along its axis that is at most 5u (n + |eye index|), and along
//! another axis t moves the point by no more than the way travelled does, which the choice of the nearest plane bounds by the same number. Together under 10u
//! (|eye| + |origin| + |t d|)/spacing + 5u n; 16 and 8 are used. A skew lattice multiplies by its inverse: nine terms, each as above, and the
//! inverse itself is off by the loss of digits of its determinant, [`Space::skew`]: 128 and that factor are used.
//!
//! Where a ray enters or leaves the domain, the plane is off by E too, and a clipping plane by what `isobar_cpu::clip` says: [`Walk::loose`] is how far, in index units, the ray travels
//! between the kept part shrunk and grown by that.

use glam::DVec3;
use isobar_core::{ClipPlane, Domain, Ray};
use isobar_cpu::clip::{Side, kept};
use isobar_cpu::index::{cleaned, overflows};

/// One value per axis; `array::map` is not inlined into functions compiled for more instructions than the crate.
#[inline(always)]
pub(crate) fn three<R>(f: impl Fn(usize) -> R) -> [R; 3] {
    [f(0), f(1), f(2)]
}

/// Unit roundoff of f64.
pub(crate) const U: f64 = 0.5 * f64::EPSILON;

/// Index space of a grid, shifted by a half where cells are centred on samples: cell i is [i, i + 1] per axis in either case.
#[derive(Debug, Clone)]
pub(crate) struct Space {
    pub(crate) domain: Domain,
    shift: f64,
    /// The domain.
    pub(crate) lo: [f64; 3],
    pub(crate) hi: [f64; 3],
    /// Cells per axis.
    pub(crate) cells: [i32; 3],
    aligned: bool,
    /// World displacement to index space, by columns.
    to_index: [DVec3; 3],
    /// Index units per world unit, an upper bound.
    scale: f64,
    /// Product of the lengths of the axes over the volume they span.
    skew: f64,
    world: (DVec3, DVec3),
    /// Largest world extent: the unit of length of differential sampling.
    pub(crate) extent: f64,
}

impl Space {
    pub(crate) fn new(domain: Domain, centred: bool) -> Self {
        let a = domain.axes;
        let aligned = domain.is_axis_aligned();
        let to_index = if aligned {
            [DVec3::X / a.x_axis.x, DVec3::Y / a.y_axis.y, DVec3::Z / a.z_axis.z]
        } else {
            let m = a.inverse();
            [m.x_axis, m.y_axis, m.z_axis]
        };
        let scale = if aligned {
            to_index[0].x.abs().max(to_index[1].y.abs()).max(to_index[2].z.abs())
        } else {
            to_index.iter().map(|c| c.length()).sum()
        };
        let shift = if centred { 0.5 } else { 0.0 };
        let world = domain.world_bounds();
        Self {
            shift,
            lo: (domain.lo + shift).to_array(),
            hi: (domain.hi + shift).to_array(),
            cells: three(|i| domain.hi[i] as i32 + i32::from(centred)),
            aligned,
            to_index,
            scale,
            skew: a.x_axis.length() * a.y_axis.length() * a.z_axis.length() / a.determinant().abs(),
            extent: (world.1 - world.0).max_element(),
            world,
            domain,
        }
    }

    /// What is added to the index of a sample.
    #[cfg(feature = "gpu")]
    pub(crate) const fn shift(&self) -> f64 {
        self.shift
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

    /// More than the greatest t at which a ray can be in the domain: twice the distance of the farthest corner, for what of it is rounded and a direction whose length is.
    #[inline(always)]
    fn reach(&self, ray: &Ray) -> f64 {
        let (lo, hi) = self.world;
        let far = (ray.origin - lo).abs().max((ray.origin - hi).abs()).length();
        // Not its length, whose square may overflow; this is no less.
        2.0 * far / ray.direction.abs().max_element()
    }

    /// The bound E of the module for rays from `origin`, as far as they can be inside the domain.
    #[inline(always)]
    pub(crate) fn position_error(&self, origin: DVec3) -> f64 {
        let (lo, hi) = self.world;
        let far = (origin - lo).abs().max((origin - hi).abs()).length();
        let size = origin.abs().max_element() + self.domain.origin.abs().max_element() + 2.0 * far;
        let n = self.hi[0].max(self.hi[1]).max(self.hi[2]) + 1.0;
        let factor = if self.aligned { 16.0 } else { 128.0 * self.skew };
        factor * U * size * self.scale + 8.0 * U * n
    }
}

/// A ray in index space, and the part of it inside the domain.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Walk {
    pub(crate) o: [f64; 3],
    pub(crate) d: [f64; 3],
    pub(crate) inv: [f64; 3],
    /// Parameter of the plane with index x: `x * inv + shift`; +inf where the ray is parallel to it.
    pub(crate) shift: [f64; 3],
    up: [i32; 3],
    step: [i32; 3],
    pub(crate) t0: f64,
    pub(crate) t1: f64,
    /// See the module; +inf where the ray may miss the domain altogether.
    pub(crate) loose: f64,
}

/// Whether a ray meets what is kept of the domain.
#[derive(Debug)]
pub(crate) enum Entry {
    /// It does.
    Through(Walk),
    /// It does not; for certain, if it would miss a domain larger by E too.
    Misses {
        /// Whether that is proved.
        certain: bool,
    },
}

impl Walk {
    /// The part at t >= 0 of a ray inside the domain that all clipping planes keep; `error` is E, where something is to be proved.
    #[inline(always)]
    pub(crate) fn enter(ray: &Ray, space: &Space, clips: &[ClipPlane], error: Option<f64>) -> Entry {
        let o = (space.index_vector(ray.origin - space.domain.origin) + space.shift).to_array();
        let d = cleaned(space.index_vector(ray.direction).to_array());
        let most = d[0].abs().max(d[1].abs()).max(d[2].abs());
        let inv = three(|a| if d[a] == 0.0 { 0.0 } else { 1.0 / d[a] });
        let shift = three(|a| if d[a] == 0.0 { f64::INFINITY } else { -o[a] * inv[a] });
        if overflows(o, d, inv, space.hi) {
            return Entry::Misses { certain: false };
        }
        // The stretch inside the domain grown by e on every side, and with it what the planes keep.
        let inside = |e: f64, side: Side| {
            let (mut t0, mut t1) = if clips.is_empty() {
                (0.0f64, f64::INFINITY)
            } else {
                kept(ray, clips, space.reach(ray), side)
            };
            for a in 0..3 {
                let (lo, hi) = (space.lo[a] - e, space.hi[a] + e);
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
        let (t0, t1) = inside(0.0, Side::Rounded);
        let loose = match error {
            None if t0 <= t1 => 0.0,
            None => return Entry::Misses { certain: false },
            Some(error) => {
                let (first, last) = inside(error, Side::Outer);
                if t0 > t1 {
                    return Entry::Misses { certain: first > last };
                }
                let (late, early) = inside(-error, Side::Inner);
                // What is not a number is not `<=`.
                if late <= early {
                    // At an edge of the domain the inner distance can be the larger one: another plane decides there.
                    (t0 - first).max(last - t1).max(late - t0).max(t1 - early) * most
                } else {
                    f64::INFINITY
                }
            }
        };
        Entry::Through(Self {
            o,
            d,
            inv,
            shift,
            up: three(|a| i32::from(d[a] >= 0.0)),
            step: three(|a| if d[a] >= 0.0 { 1 } else { -1 }),
            t0,
            t1,
            loose,
        })
    }

    #[inline(always)]
    fn plane(&self, a: usize, at: i32) -> f64 {
        f64::from(at) * self.inv[a] + self.shift[a]
    }

    /// Position at t along one axis.
    #[inline(always)]
    pub(crate) fn at(&self, a: usize, t: f64) -> f64 {
        self.o[a] + t * self.d[a]
    }

    /// Local coordinates of the point at t in a cell; a plane the ray enters or leaves by has its exact coordinate, 0 or 1, so that the cells on both
    /// sides compute with the same point.
    #[inline(always)]
    pub(crate) fn local(&self, cell: [i32; 3], t: f64) -> [f64; 3] {
        three(|a| {
            let x = self.at(a, t) - f64::from(cell[a]);
            if t == self.plane(a, cell[a]) {
                0.0
            } else if t == self.plane(a, cell[a] + 1) {
                1.0
            } else {
                x
            }
        })
    }

    /// Index units per unit of t along the fastest axis.
    #[inline(always)]
    pub(crate) fn speed(&self) -> f64 {
        self.d[0].abs().max(self.d[1].abs()).max(self.d[2].abs())
    }
}

/// The block of `1 << log` cells per axis at which a ray is, and where it leaves it (3DDDA: Amanatides and Woo 1987).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Dda {
    pub(crate) at: [i32; 3],
    exits: [f64; 3],
    log: u32,
}

impl Dda {
    /// At parameter t, among the blocks `lo..=hi`.
    #[inline(always)]
    pub(crate) fn new(w: &Walk, log: u32, t: f64, lo: [i32; 3], hi: [i32; 3]) -> Self {
        let at = three(|a| ((w.at(a, t) as i32) >> log).clamp(lo[a], hi[a]));
        Self {
            at,
            exits: three(|a| w.plane(a, (at[a] + w.up[a]) << log)),
            log,
        }
    }

    /// The axis along which the ray leaves the block first, and the parameter there.
    #[inline(always)]
    pub(crate) fn exit(&self) -> (usize, f64) {
        let t = self.exits;
        // Without branches: which axis it is cannot be foretold.
        let a = usize::from(t[0] >= t[1]);
        let first = if t[0] < t[1] { t[0] } else { t[1] };
        let last = usize::from(first >= t[2]);
        (a >> last | last << 1, if first < t[2] { first } else { t[2] })
    }

    /// To the next block along axis `a`; false where it is outside of `lo..=hi`.
    #[inline(always)]
    pub(crate) fn step(&mut self, w: &Walk, a: usize, lo: [i32; 3], hi: [i32; 3]) -> bool {
        self.at[a] += w.step[a];
        if self.at[a] < lo[a] || self.at[a] > hi[a] {
            return false;
        }
        self.exits[a] = w.plane(a, (self.at[a] + w.up[a]) << self.log);
        true
    }
}
