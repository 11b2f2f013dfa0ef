//! The rays of a tile, how far they are, and the part of index space they can be in.

use super::lanes::{LANES, Lanes};
use super::view::Projection;
use super::{BLOCKS, PerRay, RAYS, RaySet, ones, pixel, three};
use crate::clip::{Side, kept, reach};
use crate::{Tile, TileOut};
use glam::DVec3;
use isobar_core::{Claim, Domain, Pixel, Ray, View};

/// A direction component below this is parallel to the plane.
const PARALLEL: f64 = 1e-100;

/// What the ends of the domain may add to the margin of a packet, in margins: a ray that enters or leaves by a face at less than about a
/// thirtieth of its speed goes alone.
const AT_ENDS: f64 = 32.0;

/// A packet's slices are cut across an axis along which each of its rays moves at least this part of its fastest axis.
const SLOWEST: f64 = 1e-3;

/// The index space of a grid, as the method has it that derives its bounds in it.
///
/// The *margin* of a ray is a bound on the error of a coefficient of the polynomials along it, in units of the greatest |datum - isovalue|.
pub trait Space {
    /// Errors E of a position that the margin holds.
    const PART: f64;
    /// How much faster the function changes along a ray than the ray itself moves, in units of the greatest |datum - isovalue|, index units and its fastest axis.
    const STEEPEST: f64;
    /// The domain.
    fn domain(&self) -> &Domain;
    /// Its bounds in the world.
    fn world(&self) -> (DVec3, DVec3);
    /// A world displacement in index space.
    fn vector(&self, v: DVec3) -> DVec3;
    /// The margin of a ray from `origin`, as far as it can be inside the domain.
    fn margin(&self, origin: DVec3) -> f64;
}

/// The volume a packet crosses and the tile it comes from.
#[derive(Debug)]
pub struct Place<'a, D> {
    /// The volume's.
    pub space: &'a D,
    /// Where rays come from.
    pub view: &'a View,
    /// Where they end.
    pub tile: Tile,
    /// Index space is shifted by this, so that cells begin at whole numbers: the domain is `[shift, hi + shift]`.
    pub shift: f64,
    /// The margin of a ray, in those of [`Space::margin`].
    pub margins: f64,
    /// The greatest margin, that which active cells allow for; below 1e-6.
    pub most: f64,
}

impl<D: Space> Place<'_, D> {
    /// The pixels of the tile: less than all at the edges of the image.
    #[must_use]
    pub fn rays(&self) -> RaySet {
        std::array::from_fn(|b| {
            (0..LANES).fold(0, |m, l| {
                let (x, y) = pixel(b, l);
                m | u8::from(x < self.tile.width && y < self.tile.height) << l
            })
        })
    }

    /// Whether no ray of the tile can meet the volume.
    #[must_use]
    pub fn misses(&self, view: &Projection) -> bool {
        let t = self.tile;
        let hi = self.space.domain().hi.to_array();
        view.bounds(hi).is_some_and(|[x, y]| {
            x[1] < t.x as f64 || x[0] > (t.x + t.width - 1) as f64 || y[1] < t.y as f64 || y[0] > (t.y + t.height - 1) as f64
        })
    }

    /// Writes pixels without a hit, given as a set. `claims`: whether they are proved to be empty; `cells`: active cells on the rays, where these were counted.
    pub fn write_empty(&self, out: &mut TileOut<'_>, rays: &RaySet, claims: bool, cells: Option<&[[u32; LANES]; BLOCKS]>) {
        if cells.is_none() && !claims {
            return;
        }
        for (b, &set) in rays.iter().enumerate() {
            for l in ones(set.into()) {
                let (x, y) = pixel(b, l);
                let empty = Pixel {
                    claim: if claims { Claim::EMPTY } else { Claim::empty() },
                    work: cells.map_or(0, |c| c[b][l]),
                    ..Pixel::default()
                };
                out.set_pixel(self.tile.x + x, self.tile.y + y, &empty);
            }
        }
    }
}

/// The rays of a tile and how far they are.
#[derive(Debug)]
pub struct Rays {
    /// In the world, `LANES * block + lane`.
    pub rays: [Ray; RAYS],
    /// Parameter of plane x of axis a: `x * inv[a] + shift[a]`.
    pub inv: [PerRay; 3],
    /// See [`Rays::inv`].
    pub shift: [PerRay; 3],
    /// |d|, index units.
    pub speed: [PerRay; 3],
    /// Parameters at which the rays enter the domain.
    pub begin: PerRay,
    /// Parameters at which the rays leave it.
    pub end: PerRay,
    /// What clipping planes keep of the rays, first and last t: as rounded, grown and shrunk by what rounding can hide. Only where there are planes.
    cuts: [[PerRay; 2]; 3],
    /// Rays that are still under way.
    pub alive: RaySet,
    /// Blocks that have such rays.
    pub blocks: u32,
    /// Rays to be walked alone.
    pub single: RaySet,
    /// Whether axis a descends.
    pub down: [bool; 3],
    /// The margin of every ray, with what the ends of the domain add.
    pub margin: f64,
}

/// The part of index space that the rays of a tile can be in: per plane across the major axis an interval of each other axis.
#[derive(Debug)]
pub struct Frustum {
    pub(super) major: usize,
    /// Where the rays begin and end along the major axis; the first is the nearer one.
    pub(super) ends: [f64; 2],
    /// Least and greatest of the other two axes (major + 1, major + 2) at both ends.
    pub(super) sides: [[[f64; 2]; 2]; 2],
}

/// Least of the lanes.
#[inline(always)]
fn least<S: Lanes>(v: S) -> f64 {
    let mut lanes = [0.0; LANES];
    v.store(&mut lanes);
    lanes.iter().fold(f64::INFINITY, |m, &v| if v < m { v } else { m })
}

/// Greatest of the lanes.
#[inline(always)]
fn greatest<S: Lanes>(v: S) -> f64 {
    let mut lanes = [0.0; LANES];
    v.store(&mut lanes);
    lanes.iter().fold(f64::NEG_INFINITY, |m, &v| if v > m { v } else { m })
}

impl Rays {
    /// No rays.
    #[must_use]
    pub const fn new() -> Self {
        let zero = [[0.0; LANES]; BLOCKS];
        let none = [0; BLOCKS];
        Self {
            rays: [Ray {
                origin: DVec3::ZERO,
                direction: DVec3::ZERO,
            }; RAYS],
            inv: [zero; 3],
            shift: [zero; 3],
            speed: [zero; 3],
            begin: zero,
            end: zero,
            cuts: [[zero; 2]; 3],
            alive: none,
            blocks: 0,
            single: none,
            down: [false; 3],
            margin: 0.0,
        }
    }

    /// For a tile whose rays all miss the volume.
    pub fn forget(&mut self) {
        (self.blocks, self.single) = (0, [0; BLOCKS]);
    }

    /// Takes rays of block `b` out: those that have ended, and those to be walked alone.
    #[inline(always)]
    pub fn take_out(&mut self, b: usize, ended: u8, alone: u8) {
        self.single[b] |= alone;
        self.alive[b] &= !(ended | alone);
        if self.alive[b] == 0 {
            self.blocks &= !(1 << b);
        }
    }

    /// Eight of the numbers of rays, those of the rays with the given indices.
    #[inline(always)]
    pub fn of<S: Lanes>(all: &PerRay, rays: S::Index) -> S {
        match all.as_flattened().first_chunk::<RAYS>() {
            Some(all) => S::gather(all, rays),
            None => S::splat(0.0),
        }
    }

    /// Makes the rays; `None` where they cannot travel together.
    #[inline(always)]
    pub fn start<S: Lanes, D: Space>(&mut self, place: &Place<'_, D>) -> Option<Frustum> {
        let (space, t) = (place.space, place.tile);
        let rays = place.view.generator();
        // The greatest margin of a rectangle of origins is that of a corner.
        let corner = |x: usize, y: usize| space.margin(rays.ray(t.x + x * (t.width - 1), t.y + y * (t.height - 1)).origin);
        let margin = place.margins * corner(0, 0).max(corner(1, 0)).max(corner(0, 1).max(corner(1, 1))) * (1.0 + 1e-9);
        // Rays that need more than this at the ends of the domain go alone.
        let most = AT_ENDS * margin;
        if margin + most > place.most || margin.is_nan() {
            return None;
        }
        self.margin = margin;
        self.alive = place.rays();
        (self.blocks, self.single) = (0, [0; BLOCKS]);
        let clips = &place.view.clips;
        for b in 0..BLOCKS {
            for l in 0..LANES {
                let (x, y) = pixel(b, l);
                let ray = rays.ray(t.x + x.min(t.width - 1), t.y + y.min(t.height - 1));
                self.rays[b * LANES + l] = ray;
                if !clips.is_empty() {
                    let reach = reach(&ray, space.world());
                    for (side, to) in [Side::Rounded, Side::Outer, Side::Inner].into_iter().zip(&mut self.cuts) {
                        let (first, last) = kept(&ray, clips, reach, side);
                        (to[0][b][l], to[1][b][l]) = (first, last);
                    }
                }
                let o = (space.vector(ray.origin - space.domain().origin) + place.shift).to_array();
                let d = space.vector(ray.direction).to_array();
                for a in 0..3 {
                    self.inv[a][b][l] = d[a];
                    self.shift[a][b][l] = -o[a];
                }
            }
        }
        for a in 0..3 {
            let (mut up, mut down) = (u8::MAX, u8::MAX);
            for d in &self.inv[a] {
                let d = S::load(d);
                up &= d.above(S::splat(PARALLEL));
                down &= S::splat(-PARALLEL).above(d);
            }
            if up != u8::MAX && down != u8::MAX {
                return None;
            }
            self.down[a] = down == u8::MAX;
        }
        let hi = three(|a| space.domain().hi[a] + place.shift);
        let near = three(|a| if self.down[a] { hi[a] } else { place.shift });
        let far = three(|a| if self.down[a] { place.shift } else { hi[a] });
        self.enter::<S, D>(near, far, most, !clips.is_empty());
        let major = self.major::<S>()?;
        Some(self.frustum::<S>(major, near, far))
    }

    /// Lets the rays end at `t` of their pixels in the tile, where that is before they leave the domain; rays that would end before they begin are taken out. What
    /// is left of the frustum.
    #[inline(always)]
    #[must_use]
    pub fn end_at<S: Lanes>(&mut self, frustum: Frustum, t: impl Fn(usize, usize) -> f64) -> Frustum {
        let k = frustum.major;
        let [near, mut far] = frustum.ends;
        let mut reached = near;
        for b in ones(self.blocks) {
            let mut ended = 0;
            for l in ones(self.alive[b].into()) {
                let (x, y) = pixel(b, l);
                let end = self.end[b][l].min(t(x, y));
                if end < self.begin[b][l] {
                    ended |= 1 << l;
                    continue;
                }
                self.end[b][l] = end;
                let at = (end - self.shift[k][b][l]) / self.inv[k][b][l];
                reached = if self.down[k] { reached.min(at) } else { reached.max(at) };
            }
            self.take_out(b, ended, 0);
        }
        far = if self.down[k] { far.max(reached) } else { far.min(reached) };
        let across = |x: f64| three(|a| if a == k { x } else { 0.0 });
        self.frustum::<S>(k, across(near), across(far))
    }

    /// Where the rays enter and leave the domain, and what that adds to the margin; at most `most`.
    #[inline(always)]
    fn enter<S: Lanes, D: Space>(&mut self, near: [f64; 3], far: [f64; 3], most: f64, clipped: bool) {
        let (one, zero) = (S::splat(1.0), S::splat(0.0));
        let mut more = zero;
        for b in 0..BLOCKS {
            let (mut first, mut last) = (zero, S::splat(f64::INFINITY));
            let (mut grown_first, mut grown_last) = (first, last);
            let (mut shrunk_first, mut shrunk_last, mut fastest) = (first, last, zero);
            if clipped {
                (first, last) = (S::load(&self.cuts[0][0][b]), S::load(&self.cuts[0][1][b]));
                (grown_first, grown_last) = (S::load(&self.cuts[1][0][b]), S::load(&self.cuts[1][1][b]));
                (shrunk_first, shrunk_last) = (S::load(&self.cuts[2][0][b]), S::load(&self.cuts[2][1][b]));
            }
            for a in 0..3 {
                let d = S::load(&self.inv[a][b]);
                let inv = one.div(d);
                let shift = S::load(&self.shift[a][b]).mul(inv);
                inv.store(&mut self.inv[a][b]);
                shift.store(&mut self.shift[a][b]);
                d.abs().store(&mut self.speed[a][b]);
                fastest = fastest.max(d.abs());
                let grow = self.margin / D::PART * if self.down[a] { 1.0 } else { -1.0 };
                let plane = |x: f64| S::splat(x).mul(inv).add(shift);
                first = first.max(plane(near[a]));
                last = last.min(plane(far[a]));
                grown_first = grown_first.max(plane(near[a] + grow));
                grown_last = grown_last.min(plane(far[a] - grow));
                shrunk_first = shrunk_first.max(plane(near[a] - grow));
                shrunk_last = shrunk_last.min(plane(far[a] + grow));
            }
            first.store(&mut self.begin[b]);
            last.store(&mut self.end[b]);
            let outside = first.above(last);
            let surely = grown_first.above(grown_last);
            let ends = first
                .sub(grown_first)
                .max(grown_last.sub(last))
                .mul(fastest)
                .mul(S::splat(D::STEEPEST));
            let doubtful = shrunk_first.above(shrunk_last) | ends.above(S::splat(most));
            let all = self.alive[b];
            self.alive[b] = all & !outside & !doubtful;
            self.single[b] = all & ((outside & !surely) | (!outside & doubtful));
            self.blocks |= u32::from(self.alive[b] != 0) << b;
            more = ends.max(zero).where_or(self.alive[b], zero).max(more);
        }
        // What the ray needs that needs most.
        self.margin += greatest(more).max(0.0);
    }

    /// The axis along which the slowest of the rays under way is fastest; `None` where a ray is next to parallel to each axis's slices.
    #[inline(always)]
    fn major<S: Lanes>(&self) -> Option<usize> {
        let infinite = S::splat(f64::INFINITY);
        let mut slowest = [infinite; 3];
        for b in ones(self.blocks) {
            let speed = three(|a| S::load(&self.speed[a][b]));
            let fastest = speed[0].max(speed[1]).max(speed[2]);
            slowest = three(|a| slowest[a].min(speed[a].div(fastest).where_or(self.alive[b], infinite)));
        }
        let slowest = three(|a| least(slowest[a]));
        let major = (0..3).fold(0, |m, a| if slowest[a] > slowest[m] { a } else { m });
        (slowest[major] >= SLOWEST).then_some(major)
    }

    /// Bounds the rays that are under way, between the volume's near and far faces of the major axis.
    #[inline(always)]
    fn frustum<S: Lanes>(&self, major: usize, near: [f64; 3], far: [f64; 3]) -> Frustum {
        // Rays that begin inside the volume begin at the nearest of their origins.
        let down = self.down[major];
        let mut start = near[major];
        if self.blocks != 0 {
            let begins = ones(self.blocks)
                .flat_map(|b| ones(self.alive[b].into()).map(move |l| (b, l)))
                .map(|(b, l)| -self.shift[major][b][l] / self.inv[major][b][l]);
            start = if down {
                begins.fold(f64::NEG_INFINITY, f64::max).min(start)
            } else {
                begins.fold(f64::INFINITY, f64::min).max(start)
            };
        }
        let ends = [start, far[major]];
        let infinite = [f64::INFINITY, f64::NEG_INFINITY];
        let mut sides = [[infinite; 2]; 2];
        for b in ones(self.blocks) {
            let alive = self.alive[b];
            for (e, &k) in ends.iter().enumerate() {
                let t = S::splat(k)
                    .mul(S::load(&self.inv[major][b]))
                    .add(S::load(&self.shift[major][b]));
                for (i, side) in sides.iter_mut().enumerate() {
                    let a = (major + 1 + i) % 3;
                    let sign = if self.down[a] { -1.0 } else { 1.0 };
                    let u = t
                        .sub(S::load(&self.shift[a][b]))
                        .mul(S::load(&self.speed[a][b]).mul(S::splat(sign)));
                    let side = &mut side[e];
                    side[0] = side[0].min(least(u.where_or(alive, S::splat(f64::INFINITY))));
                    side[1] = side[1].max(greatest(u.where_or(alive, S::splat(f64::NEG_INFINITY))));
                }
            }
        }
        Frustum { major, ends, sides }
    }
}

impl Default for Rays {
    fn default() -> Self {
        Self::new()
    }
}
