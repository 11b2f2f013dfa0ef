//! The rays of a tile, how far they are, and the part of index space they can be in.

use super::fan::Fan;
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
    /// As [`Space::vector`], eight at a time.
    #[inline(always)]
    fn vectors<S: Lanes>(&self, v: [S; 3]) -> [S; 3] {
        let mut lanes = [[0.0; LANES]; 3];
        for (to, v) in lanes.iter_mut().zip(v) {
            v.store(to);
        }
        let [x, y, z] = &mut lanes;
        for (x, (y, z)) in x.iter_mut().zip(y.iter_mut().zip(z)) {
            [*x, *y, *z] = self.vector(DVec3::new(*x, *y, *z)).to_array();
        }
        three(|a| S::load(&lanes[a]))
    }
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
    /// The same without that.
    least: f64,
    /// Rays whose directions agree in sign, with what is to be [`Rays::down`]; `count` of them, the next one to travel is `at`.
    groups: [(RaySet, [bool; 3]); 8],
    count: usize,
    at: usize,
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
            least: 0.0,
            groups: [(none, [false; 3]); 8],
            count: 0,
            at: 0,
        }
    }

    /// For a tile whose rays all miss the volume.
    pub fn forget(&mut self) {
        (self.blocks, self.single) = (0, [0; BLOCKS]);
        (self.count, self.at) = (0, 0);
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

    /// Makes the rays; `None` where not all of them can travel together.
    #[inline(always)]
    pub fn start<S: Lanes, D: Space>(&mut self, place: &Place<'_, D>) -> Option<Frustum> {
        if !self.make::<S, D>(place) || self.count != 1 || self.single != [0; BLOCKS] {
            return None;
        }
        self.next_group::<S, D>(place)
    }

    /// Makes the rays and parts them by the signs of their directions; false where none can travel in a packet.
    #[inline(always)]
    pub fn make<S: Lanes, D: Space>(&mut self, place: &Place<'_, D>) -> bool {
        let (space, t) = (place.space, place.tile);
        self.forget();
        let Some(fan) = Fan::new(place.view, t) else {
            return false;
        };
        let rays = place.view.generator();
        // The greatest margin of a rectangle of origins is that of a corner.
        let corner = |x: usize, y: usize| space.margin(rays.ray(t.x + x * (t.width - 1), t.y + y * (t.height - 1)).origin);
        let margin = place.margins * corner(0, 0).max(corner(1, 0)).max(corner(0, 1).max(corner(1, 1))) * (1.0 + 1e-9);
        // Rays that need more than this at the ends of the domain go alone.
        let most = AT_ENDS * margin;
        if margin + most > place.most || margin.is_nan() {
            return false;
        }
        self.least = margin;
        let clips = &place.view.clips;
        let eye = (space.vector(fan.lens.eye - space.domain().origin) + place.shift).to_array();
        let (zero, one) = (S::splat(0.0), S::splat(1.0));
        let none = [0; BLOCKS];
        let (mut up, mut down) = ([none; 3], [none; 3]);
        for b in 0..BLOCKS {
            let [origin, direction] = fan.rays::<S>(b);
            self.keep(b, origin, direction);
            if !clips.is_empty() {
                self.cut(place, b);
            }
            let o = if fan.lens.parallel {
                let from = space.domain().origin.to_array();
                let o = space.vectors::<S>(three(|a| origin[a].sub(S::splat(from[a]))));
                three(|a| o[a].add(S::splat(place.shift)))
            } else {
                three(|a| S::splat(eye[a]))
            };
            let d = space.vectors::<S>(direction);
            for a in 0..3 {
                let inv = one.div(d[a]);
                inv.store(&mut self.inv[a][b]);
                zero.sub(o[a]).mul(inv).store(&mut self.shift[a][b]);
                d[a].abs().store(&mut self.speed[a][b]);
                up[a][b] = d[a].above(S::splat(PARALLEL));
                down[a][b] = S::splat(-PARALLEL).above(d[a]);
            }
        }
        self.part(place.rays(), &up, &down);
        true
    }

    /// Keeps the rays of block `b` in the world.
    #[inline(always)]
    fn keep<S: Lanes>(&mut self, b: usize, origin: [S; 3], direction: [S; 3]) {
        let (mut o, mut d) = ([[0.0; LANES]; 3], [[0.0; LANES]; 3]);
        for a in 0..3 {
            origin[a].store(&mut o[a]);
            direction[a].store(&mut d[a]);
        }
        for (l, ray) in self.rays[b * LANES..(b + 1) * LANES].iter_mut().enumerate() {
            ray.origin = DVec3::new(o[0][l], o[1][l], o[2][l]);
            ray.direction = DVec3::new(d[0][l], d[1][l], d[2][l]);
        }
    }

    /// What clipping planes keep of the rays of block `b`.
    fn cut<D: Space>(&mut self, place: &Place<'_, D>, b: usize) {
        for l in 0..LANES {
            let ray = self.rays[b * LANES + l];
            let reach = reach(&ray, place.space.world());
            for (side, to) in [Side::Rounded, Side::Outer, Side::Inner].into_iter().zip(&mut self.cuts) {
                let (first, last) = kept(&ray, &place.view.clips, reach, side);
                (to[0][b][l], to[1][b][l]) = (first, last);
            }
        }
    }

    /// Parts the rays by the signs of their directions; those parallel to an axis plane go alone. Lanes beyond the image repeat rays of it.
    fn part(&mut self, all: RaySet, up: &[RaySet; 3], down: &[RaySet; 3]) {
        let whole = |set: &RaySet| set.iter().all(|&m| m == u8::MAX);
        if (0..3).all(|a| whole(&up[a]) || whole(&down[a])) {
            self.groups[0] = (all, three(|a| whole(&down[a])));
            self.count = 1;
            return;
        }
        self.single = all;
        for octant in 0..8 {
            let down_now = three(|a| octant >> a & 1 != 0);
            let side = |a: usize, b: usize| if down_now[a] { down[a][b] } else { up[a][b] };
            let set: RaySet = std::array::from_fn(|b| all[b] & side(0, b) & side(1, b) & side(2, b));
            if set != [0; BLOCKS] {
                self.groups[self.count] = (set, down_now);
                self.count += 1;
                for (single, set) in self.single.iter_mut().zip(set) {
                    *single &= !set;
                }
            }
        }
    }

    /// Sends the next rays that agree in the signs of their directions on their way; `None` where all have been.
    #[inline(always)]
    pub fn next_group<S: Lanes, D: Space>(&mut self, place: &Place<'_, D>) -> Option<Frustum> {
        let hi = three(|a| place.space.domain().hi[a] + place.shift);
        while self.at < self.count {
            let (set, down) = self.groups[self.at];
            self.at += 1;
            (self.alive, self.down, self.blocks, self.margin) = (set, down, 0, self.least);
            let near = three(|a| if down[a] { hi[a] } else { place.shift });
            let far = three(|a| if down[a] { place.shift } else { hi[a] });
            self.enter::<S, D>(near, far, AT_ENDS * self.least, !place.view.clips.is_empty());
            if let Some(major) = self.major::<S>() {
                return Some(self.frustum::<S>(major, near, far));
            }
            for b in 0..BLOCKS {
                self.take_out(b, 0, self.alive[b]);
            }
        }
        None
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
        let zero = S::splat(0.0);
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
                let (inv, shift) = (S::load(&self.inv[a][b]), S::load(&self.shift[a][b]));
                fastest = fastest.max(S::load(&self.speed[a][b]));
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
            // Outwards and inwards: at an edge of the domain another plane may decide there.
            let ends = first
                .sub(grown_first)
                .max(grown_last.sub(last))
                .max(shrunk_first.sub(first))
                .max(last.sub(shrunk_last))
                .mul(fastest)
                .mul(S::splat(D::STEEPEST));
            let doubtful = shrunk_first.above(shrunk_last) | ends.above(S::splat(most));
            let all = self.alive[b];
            self.alive[b] = all & !outside & !doubtful;
            self.single[b] |= all & ((outside & !surely) | (!outside & doubtful));
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
        let (zero, infinite) = (S::splat(0.0), S::splat(f64::INFINITY));
        let none = zero.sub(infinite);
        let mut begins = if down { none } else { infinite };
        for b in ones(self.blocks) {
            let o = zero.sub(S::load(&self.shift[major][b])).div(S::load(&self.inv[major][b]));
            begins = if down {
                o.where_or(self.alive[b], none).max(begins)
            } else {
                o.where_or(self.alive[b], infinite).min(begins)
            };
        }
        let start = match (self.blocks, down) {
            (0, _) => near[major],
            (_, true) => greatest(begins).min(near[major]),
            (_, false) => least(begins).max(near[major]),
        };
        let ends = [start, far[major]];
        // Per axis and end, the least and the greatest of each lane.
        let mut bounds = [[[infinite, none]; 2]; 2];
        for b in ones(self.blocks) {
            let alive = self.alive[b];
            for (e, &k) in ends.iter().enumerate() {
                let t = S::splat(k)
                    .mul(S::load(&self.inv[major][b]))
                    .add(S::load(&self.shift[major][b]));
                for (i, side) in bounds.iter_mut().enumerate() {
                    let a = (major + 1 + i) % 3;
                    let sign = if self.down[a] { -1.0 } else { 1.0 };
                    let u = t
                        .sub(S::load(&self.shift[a][b]))
                        .mul(S::load(&self.speed[a][b]).mul(S::splat(sign)));
                    let [lo, hi] = side[e];
                    side[e] = [u.where_or(alive, infinite).min(lo), u.where_or(alive, none).max(hi)];
                }
            }
        }
        let of = |i: usize, e: usize| [least(bounds[i][e][0]), greatest(bounds[i][e][1])];
        let sides = [[of(0, 0), of(0, 1)], [of(1, 0), of(1, 1)]];
        Frustum { major, ends, sides }
    }
}

impl Default for Rays {
    fn default() -> Self {
        Self::new()
    }
}
