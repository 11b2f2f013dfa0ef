//! Packets of rays: the 256 rays of a tile walk slices of bricks together, eight rays to a vector.
//!
//! Steinberger 2010, section 3.2, traces coherent blocks of rays and falls back to single rays (S12, S13). Here the order of loops is turned round:
//! a tile visits the active bricks that its rays can meet, front to back, and in each the active cells; a cell goes to the blocks of 4 x 2 pixels
//! that it covers on the screen (`packet_view.rs`). So traversal and the eight samples are shared by all rays, and composition, tests
//! and solving run in vectors of f64 (`packet_lanes.rs`).
//!
//! **Order.** All directions of a tile have the same signs, and slices, bricks and cells are visited away from the eye along each axis, so of two cells on one ray the
//! nearer comes first, whichever axis is the outer loop.
//!
//! **Completeness.** A ray is inside a cell between the greatest of its three entry parameters and the least of its three exit parameters; the parameter of a plane is one expression,
//! monotone in its index, so these intervals cover the ray without gaps. Coefficients obey the bound of `walk.rs`: coordinates are
//! measured from the near plane, (t - t_near) |d|, or back from the far one, which rounds no more than o + t d does.
//!
//! **What is left to single rays**: a ray on which any coefficient that matters lies within the bound, rays parallel to an axis plane, tiles in which
//! directions differ in sign, lists of rays, and everything but the first hit of one opaque isovalue.

use crate::bricks::Sample;
use crate::clip::kept;
use crate::packet_cells::Crossing;
#[cfg(target_arch = "x86_64")]
use crate::packet_lanes::{Avx2, Avx512};
use crate::packet_lanes::{LANES, Lanes, Plain};
use crate::packet_view::Projection;
use crate::trilinear::{DrawTile, MARGIN};
use crate::walk::{Space, Work, three};
use isobar_core::{Channels, Claim, Pixel, Ray, View};
use isobar_cpu::scene::Isovalues;
use isobar_cpu::{Level, TILE, Tile, TileOut};
use std::cell::RefCell;

/// Blocks of a tile: 4 x 2 pixels each, 4 in a row.
pub(crate) const BLOCKS: usize = TILE * TILE / LANES;
const _: () = assert!(TILE == 16 && LANES == 8, "blocks of 4 x 2 pixels, one bit each in a u32");

/// One number per ray.
pub(crate) type PerRay = [[f64; LANES]; BLOCKS];

/// A direction component below this is parallel to the plane.
const PARALLEL: f64 = 1e-100;

/// What the ends of the domain may add to the margin of a packet, in margins: a ray that enters or leaves by a face at less than about a
/// thirtieth of its speed goes alone.
const AT_ENDS: f64 = 32.0;

/// A packet's slices are cut across an axis along which each of its rays moves at least this part of its fastest axis.
const SLOWEST: f64 = 1e-3;

/// Pixel of lane `l` of block `b` in its tile.
#[inline(always)]
pub(crate) fn pixel(b: usize, l: usize) -> (usize, usize) {
    ((b & 3) * 4 + (l & 3), (b >> 2) * 2 + (l >> 2))
}

/// Lanes of a tile, a byte per block.
pub(crate) type RaySet = [u8; BLOCKS];

/// Whether the set holds the ray of pixel (x, y) of the tile.
#[inline(always)]
pub(crate) fn holds(set: &RaySet, x: usize, y: usize) -> bool {
    set[(y >> 1) * 4 + (x >> 2)] >> ((y & 1) * 4 + (x & 3)) & 1 != 0
}

/// The volume a packet crosses and the tile it comes from.
#[derive(Clone, Copy)]
pub(crate) struct Place<'a> {
    pub(crate) space: &'a Space,
    pub(crate) view: &'a View,
    pub(crate) tile: Tile,
    /// Index space is shifted by this, so that cells begin at whole numbers: the domain is `[shift, hi + shift]`.
    pub(crate) shift: f64,
    /// The margin of a ray, in those of [`Space::margin`].
    pub(crate) margins: f64,
    pub(crate) claims: bool,
}

/// The rays of a tile and how far they are.
pub(crate) struct Packet {
    pub(crate) rays: [Ray; TILE * TILE],
    /// Parameter of plane x of axis a: `x * inv[a] + shift[a]`.
    pub(crate) inv: [PerRay; 3],
    pub(crate) shift: [PerRay; 3],
    /// |d|, index units.
    pub(crate) speed: [PerRay; 3],
    /// Parameters at which the rays enter and leave the domain.
    pub(crate) begin: PerRay,
    pub(crate) end: PerRay,
    /// What clipping planes keep of the rays, first and last t: as rounded, grown and shrunk by what rounding can hide. Only where there are planes.
    cuts: [[PerRay; 2]; 3],
    /// Rays that are still under way.
    pub(crate) alive: RaySet,
    /// Blocks that have such rays.
    pub(crate) blocks: u32,
    /// Rays to be walked alone.
    pub(crate) single: RaySet,
    /// Rays that hit something.
    pub(crate) hit: RaySet,
    /// Whether axis a descends.
    pub(crate) down: [bool; 3],
    pub(crate) found: Found,
    /// The margin of every ray, with what the ends of the domain add: (6E + 64u), or what [`Place::margins`] makes of it.
    pub(crate) margin: f64,
    /// Active cells on each ray, where the frame wants to know.
    pub(crate) cells: [[u32; LANES]; BLOCKS],
}

/// Most coefficients of the polynomial along a ray in a cell.
pub(crate) const COEFFICIENTS: usize = 10;

/// The polynomial each ray ends in.
pub(crate) struct Found {
    /// Coefficients between t0 and t1: Bernstein ones of a cubic, or powers of the higher degrees (`smooth/along.rs`).
    pub(crate) p: [PerRay; COEFFICIENTS],
    pub(crate) t0: PerRay,
    pub(crate) t1: PerRay,
    /// The cell's near planes.
    pub(crate) near: [PerRay; 3],
    /// The root in [0, 1], where it is known already; else below 0.
    pub(crate) root: PerRay,
    /// Its bracket reaches at most that far on both sides (degrees 2 and 3).
    pub(crate) reach: PerRay,
}

/// The part of index space that the rays of a tile can be in: per plane across the major axis an interval of each other axis.
pub(crate) struct Frustum {
    pub(crate) major: usize,
    /// Where the rays begin and end along the major axis; the first is the nearer one.
    pub(crate) ends: [f64; 2],
    /// Least and greatest of the other two axes (major + 1, major + 2) at both ends.
    pub(crate) sides: [[[f64; 2]; 2]; 2],
}

impl Packet {
    fn new() -> Box<Self> {
        let zero = [[0.0; LANES]; BLOCKS];
        let none = [0; BLOCKS];
        Box::new(Self {
            rays: [Ray {
                origin: glam::DVec3::ZERO,
                direction: glam::DVec3::ZERO,
            }; TILE * TILE],
            inv: [zero; 3],
            shift: [zero; 3],
            speed: [zero; 3],
            cuts: [[zero; 2]; 3],
            begin: zero,
            end: zero,
            alive: none,
            blocks: 0,
            single: none,
            hit: none,
            down: [false; 3],
            found: Found {
                p: [zero; COEFFICIENTS],
                t0: zero,
                t1: zero,
                near: [zero; 3],
                root: zero,
                reach: zero,
            },
            cells: [[0; LANES]; BLOCKS],
            margin: 0.0,
        })
    }
}

/// Whether packets can draw the tile: the first hit of one isovalue ends a ray.
pub(crate) fn applies(tile: Tile, surfaces: &Isovalues, out: &TileOut<'_>) -> bool {
    let &[_] = surfaces.values() else { return false };
    let surface = &surfaces.all()[usize::from(surfaces.surface(0))];
    tile.width <= TILE
        && tile.height <= TILE
        && out.layers() == 1
        && !out.holds(Channels::HITS)
        && (surface.opacity >= 1.0 || !out.holds(Channels::RGBA))
}

thread_local! {
    /// Some 70 KiB that need no clearing between tiles.
    static PACKET: RefCell<Box<Packet>> = RefCell::new(Packet::new());
}

/// Runs `f` with this thread's packet.
pub(crate) fn with_packet<R>(f: impl FnOnce(&mut Packet) -> R) -> R {
    PACKET.with_borrow_mut(|p| f(p))
}

/// The place of a tile of degree 1.
pub(crate) fn place<'a, T>(tile: &DrawTile<'a, '_, T>) -> Place<'a> {
    Place {
        space: tile.space,
        view: tile.view,
        tile: tile.tile,
        shift: 0.0,
        margins: 1.0,
        claims: tile.search.claims,
    }
}

/// Draws what packets can; gives the rays that are left.
pub(crate) fn draw<T: Sample>(level: Level, tile: &mut DrawTile<'_, '_, T>, view: &Projection, work: &mut Work) -> RaySet {
    let place = place(tile);
    if place.misses(view) {
        place.finish_empty(tile.out, &place.rays(), None);
        return [0; BLOCKS];
    }
    with_packet(|packet| {
        #[cfg(target_arch = "x86_64")]
        if level.is_available() {
            match level {
                #[expect(unsafe_code, reason = "functions with target features")]
                // SAFETY: `is_available` found the features.
                Level::Avx512 => return unsafe { avx512(packet, &place, tile, view, work) },
                #[expect(unsafe_code, reason = "functions with target features")]
                // SAFETY: `is_available` found the features.
                Level::Avx2 => return unsafe { avx2(packet, &place, tile, view, work) },
                Level::Scalar => {}
            }
        }
        let _ = level;
        with_lanes::<Plain, T>(packet, &place, tile, view, work)
    })
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,bmi1,bmi2,lzcnt,popcnt")]
fn avx512<T: Sample>(
    p: &mut Packet,
    place: &Place<'_>,
    tile: &mut DrawTile<'_, '_, T>,
    view: &Projection,
    work: &mut Work,
) -> RaySet {
    with_lanes::<Avx512, T>(p, place, tile, view, work)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
fn avx2<T: Sample>(
    p: &mut Packet,
    place: &Place<'_>,
    tile: &mut DrawTile<'_, '_, T>,
    view: &Projection,
    work: &mut Work,
) -> RaySet {
    with_lanes::<Avx2, T>(p, place, tile, view, work)
}

#[inline(always)]
fn with_lanes<S: Lanes, T: Sample>(
    packet: &mut Packet,
    place: &Place<'_>,
    tile: &mut DrawTile<'_, '_, T>,
    view: &Projection,
    work: &mut Work,
) -> RaySet {
    let count = tile.out.holds(Channels::WORK);
    let Some(frustum) = packet.start::<S>(place, count) else {
        return place.rays();
    };
    if packet.blocks != 0 {
        let crossing = Crossing::new(packet, place, view);
        let mut cells = tile.cells(packet, count);
        crossing.cross::<S, _>(&mut cells, packet, &frustum, work);
        tile.finish::<S>(packet);
    }
    place.finish_empty(tile.out, &packet.empty(place), count.then_some(&packet.cells));
    packet.single
}

impl Place<'_> {
    /// The pixels of the tile: less than all at the edges of the image.
    pub(crate) fn rays(&self) -> RaySet {
        std::array::from_fn(|b| {
            (0..LANES).fold(0, |m, l| {
                let (x, y) = pixel(b, l);
                m | u8::from(x < self.tile.width && y < self.tile.height) << l
            })
        })
    }

    /// Whether no ray of the tile can meet the volume.
    pub(crate) fn misses(&self, view: &Projection) -> bool {
        let t = self.tile;
        let hi = self.space.domain.hi.to_array();
        view.bounds(hi).is_some_and(|[x, y]| {
            x[1] < t.x as f64 || x[0] > (t.x + t.width - 1) as f64 || y[1] < t.y as f64 || y[0] > (t.y + t.height - 1) as f64
        })
    }

    /// Writes the pixels without a hit; `cells`: active cells on the rays, where these were counted.
    pub(crate) fn finish_empty(&self, out: &mut TileOut<'_>, rays: &RaySet, cells: Option<&[[u32; LANES]; BLOCKS]>) {
        if cells.is_none() && !(self.claims && out.holds(Channels::CLAIM)) {
            return;
        }
        for (b, &set) in rays.iter().enumerate() {
            for l in ones(set.into()) {
                let (x, y) = pixel(b, l);
                let empty = Pixel {
                    claim: if self.claims { Claim::EMPTY } else { Claim::empty() },
                    work: cells.map_or(0, |c| c[b][l]),
                    ..Pixel::default()
                };
                out.set_pixel(self.tile.x + x, self.tile.y + y, &empty);
            }
        }
    }
}

/// Positions of the bits set, ascending.
#[inline(always)]
pub(crate) fn ones(mut set: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        (set != 0).then(|| {
            let at = set.trailing_zeros();
            set &= set - 1;
            at as usize
        })
    })
}

impl Packet {
    /// For a tile whose rays all miss the volume.
    pub(crate) fn forget(&mut self) {
        (self.blocks, self.single, self.hit) = (0, [0; BLOCKS], [0; BLOCKS]);
    }

    /// Rays that hit nothing and are not left to be walked alone.
    pub(crate) fn empty(&self, place: &Place<'_>) -> RaySet {
        let mut empty = place.rays();
        for (e, (h, s)) in empty.iter_mut().zip(self.hit.iter().zip(&self.single)) {
            *e &= !(h | s);
        }
        empty
    }

    /// Makes the rays; `None` where they cannot travel together. `count`: whether cells on each ray are to be counted.
    #[inline(always)]
    pub(crate) fn start<S: Lanes>(&mut self, place: &Place<'_>, count: bool) -> Option<Frustum> {
        let (space, t) = (place.space, place.tile);
        let rays = place.view.generator();
        // The greatest margin of a rectangle of origins is that of a corner.
        let corner = |x: usize, y: usize| space.margin(rays.ray(t.x + x * (t.width - 1), t.y + y * (t.height - 1)).origin);
        let margin = place.margins * corner(0, 0).max(corner(1, 0)).max(corner(0, 1).max(corner(1, 1))) * (1.0 + 1e-9);
        // See `walk::ends`: rays that need more than this at the ends of the domain go alone.
        let most = AT_ENDS * margin;
        if margin + most > MARGIN || margin.is_nan() {
            return None;
        }
        self.margin = margin;
        self.alive = place.rays();
        (self.blocks, self.single, self.hit) = (0, [0; BLOCKS], [0; BLOCKS]);
        if count {
            self.cells = [[0; LANES]; BLOCKS];
        }
        let clipped = !place.view.clips.is_empty();
        for b in 0..BLOCKS {
            for l in 0..LANES {
                let (x, y) = pixel(b, l);
                let ray = rays.ray(t.x + x.min(t.width - 1), t.y + y.min(t.height - 1));
                self.rays[b * LANES + l] = ray;
                if clipped {
                    let reach = space.reach(&ray);
                    for (side, to) in [0.0, 1.0, -1.0].into_iter().zip(&mut self.cuts) {
                        let (first, last) = kept(&ray, &place.view.clips, reach, side);
                        (to[0][b][l], to[1][b][l]) = (first, last);
                    }
                }
                let o = (space.index_vector(ray.origin - space.domain.origin) + place.shift).to_array();
                let d = space.index_vector(ray.direction).to_array();
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
            if up & down != 0 || (up != u8::MAX && down != u8::MAX) {
                return None;
            }
            self.down[a] = down == u8::MAX;
        }
        let hi = three(|a| space.domain.hi[a] + place.shift);
        let (one, zero) = (S::splat(1.0), S::splat(0.0));
        let near = three(|a| if self.down[a] { hi[a] } else { place.shift });
        let far = three(|a| if self.down[a] { place.shift } else { hi[a] });
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
                let grow = margin / 6.0 * if self.down[a] { 1.0 } else { -1.0 };
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
                .mul(S::splat(6.0));
            let doubtful = shrunk_first.above(shrunk_last) | ends.above(S::splat(most));
            let all = self.alive[b];
            self.alive[b] = all & !outside & !doubtful;
            self.single[b] = all & ((outside & !surely) | (!outside & doubtful));
            self.blocks |= u32::from(self.alive[b] != 0) << b;
            more = ends.max(zero).where_or(self.alive[b], zero).max(more);
        }
        let mut lanes = [0.0; LANES];
        more.store(&mut lanes);
        // What the ray needs that needs most.
        self.margin += lanes.iter().fold(0.0, |m, &v| if v > m { v } else { m });
        let major = self.major::<S>()?;
        Some(self.frustum::<S>(major, near, far))
    }

    /// The axis along which the slowest of the rays under way is fastest; `None` where a ray is next to parallel to each axis's slices.
    #[inline(always)]
    fn major<S: Lanes>(&self) -> Option<usize> {
        let mut least = three(|_| S::splat(f64::INFINITY));
        for b in ones(self.blocks) {
            let speed = three(|a| S::load(&self.speed[a][b]));
            let fastest = speed[0].max(speed[1]).max(speed[2]);
            least = three(|a| least[a].min(speed[a].div(fastest).where_or(self.alive[b], S::splat(f64::INFINITY))));
        }
        let slowest = three(|a| {
            let mut lanes = [0.0; LANES];
            least[a].store(&mut lanes);
            lanes.iter().fold(f64::INFINITY, |m, &v| if v < m { v } else { m })
        });
        let major = (0..3).fold(0, |m, a| if slowest[a] > slowest[m] { a } else { m });
        (slowest[major] >= SLOWEST).then_some(major)
    }

    /// Bounds the rays that are under way, between the volume's near and far faces of the major axis.
    #[inline(always)]
    fn frustum<S: Lanes>(&self, major: usize, near: [f64; 3], far: [f64; 3]) -> Frustum {
        // Rays that begin inside the volume begin at the nearest of their origins.
        let mut start = near[major];
        if self.blocks != 0 {
            let inside = if self.down[major] { f64::max } else { f64::min };
            let begin = self
                .rays_alive()
                .map(|(b, l)| -self.shift[major][b][l] / self.inv[major][b][l])
                .fold(if self.down[major] { f64::NEG_INFINITY } else { f64::INFINITY }, inside);
            start = if self.down[major] {
                begin.min(start)
            } else {
                begin.max(start)
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
                    let (mut lo, mut hi) = ([0.0; LANES], [0.0; LANES]);
                    u.where_or(alive, S::splat(f64::INFINITY)).store(&mut lo);
                    u.where_or(alive, S::splat(f64::NEG_INFINITY)).store(&mut hi);
                    let side = &mut side[e];
                    side[0] = lo.iter().fold(side[0], |m, &v| if v < m { v } else { m });
                    side[1] = hi.iter().fold(side[1], |m, &v| if v > m { v } else { m });
                }
            }
        }
        Frustum { major, ends, sides }
    }

    fn rays_alive(&self) -> impl Iterator<Item = (usize, usize)> {
        ones(self.blocks).flat_map(|b| ones(self.alive[b].into()).map(move |l| (b, l)))
    }
}
