//! Packets of rays: the 256 rays of a tile walk slices of bricks together, and pieces of eight rays are worked out at a time.
//!
//! The paper rasterises tetrahedra, each for all pixels it covers (section 4.3). Here a tile visits the active bricks that its rays can meet, front to back, and in each the
//! active cubes (`crossing.rs`); a cube goes to the blocks of 4 x 2 pixels that it covers on the screen (`view.rs`). There the pieces of eight rays in the tetrahedra of the cube
//! are cut by sorted plane parameters, as single rays do it, and those in active tetrahedra are put into a queue (`cubes.rs`). The queue is emptied eight pieces
//! at a time, whatever ray and tetrahedron they belong to: coefficients from the data, blossoming, signs (`pieces.rs`). So lanes are full where tetrahedra are as small as
//! pixels. Roots, proofs and gradients come at the end, eight rays at a time (`finish.rs`).
//!
//! **Order.** All directions of a tile have the same signs, and slices, bricks and cubes are visited away from the eye along each axis, so of two cubes on one ray the
//! nearer comes first. Of the hits of a ray in one cube the one of the first piece is kept.
//!
//! **Completeness.** A ray is inside a cube between the greatest of its three entry parameters and the least of its three exit parameters; the parameter of a plane is one
//! expression, monotone in its index, so these intervals cover the ray without gaps; inside a cube the pieces between sorted parameters do. Coefficients obey the bound of `ray.rs`.
//!
//! **What is left to single rays**: a ray on which any coefficient that matters lies within the bound, rays parallel to a face of a cube, tiles in which
//! directions differ in sign, lists of rays, clipping planes, and everything but the first hit of one opaque isovalue.

mod crossing;
mod cubes;
mod finish;
mod lanes;
mod pieces;
#[cfg(test)]
mod tests;
mod view;

use crate::bricks::{self, Active, Datum, bit};
use crate::cube::Data;
use crate::ray::{Bounds, FORMS, PART, STEEPEST, Space, three};
use crate::walk::{Search, Work};
use crossing::Crossing;
use cubes::Cubes;
use isobar_core::{Channels, Claim, Pixel, Ray, View};
use isobar_cpu::scene::Isovalues;
use isobar_cpu::{Level, TILE, Tile, TileOut};
#[cfg(target_arch = "x86_64")]
use lanes::{Avx2, Avx512};
use lanes::{LANES, Lanes, Plain};
use std::cell::RefCell;
pub(crate) use view::Projection;

/// Blocks of a tile: 4 x 2 pixels each, 4 in a row.
const BLOCKS: usize = TILE * TILE / LANES;
const _: () = assert!(
    TILE == 16 && LANES == 8,
    "blocks of 4 x 2 pixels, one bit each in a u32; rays in a byte"
);

/// Rays of a tile.
const RAYS: usize = TILE * TILE;

/// One number per ray.
type PerRay = [[f64; LANES]; BLOCKS];

/// A direction component below this is parallel to the plane.
const PARALLEL: f64 = 1e-100;

/// What the ends of the domain may add to the margin of a packet, in margins: a ray that enters or leaves by a face at less than about a 256th of
/// its speed goes alone.
const AT_ENDS: f64 = 32.0;

/// A packet's slices are cut across an axis along which each of its rays moves at least this part of its fastest axis.
const SLOWEST: f64 = 1e-3;

/// Index space is shifted by this where cubes are counted, so that they begin at whole numbers: the domain is `[SHIFT, hi + SHIFT]`.
const SHIFT: f64 = 0.5;

/// Pixel of lane `l` of block `b` in its tile.
#[inline(always)]
fn pixel(b: usize, l: usize) -> (usize, usize) {
    ((b & 3) * 4 + (l & 3), (b >> 2) * 2 + (l >> 2))
}

/// Rays of a tile, a byte per block.
pub(crate) type RaySet = [u8; BLOCKS];

/// Whether the set holds the ray of pixel (x, y) of the tile.
#[inline(always)]
pub(crate) fn holds(set: &RaySet, x: usize, y: usize) -> bool {
    set[(y >> 1) * 4 + (x >> 2)] >> ((y & 1) * 4 + (x & 3)) & 1 != 0
}

/// Positions of the bits set, ascending.
#[inline(always)]
fn ones(mut set: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        (set != 0).then(|| {
            let at = set.trailing_zeros();
            set &= set - 1;
            at as usize
        })
    })
}

/// A volume with data of any type: what depends on the type is called once a cube, so that packets are compiled once per instruction set.
pub(crate) trait Field {
    /// Cubes per axis.
    fn size(&self) -> [i32; 3];
    fn bounds(&self) -> &[Bounds];
    fn active(&self) -> &Active;
    /// Whether every root is found.
    fn finds_all(&self) -> bool;
    /// The cubes of an active brick.
    fn brick(&self, brick: [i32; 3]) -> &bricks::Cubes;
    /// The 27 data of a cube minus the isovalue.
    fn data(&self, cube: [i32; 3]) -> Data;
}

impl<T: Datum> Field for Search<'_, T> {
    fn size(&self) -> [i32; 3] {
        three(|a| self.dims[a] as i32)
    }
    fn bounds(&self) -> &[Bounds] {
        self.bounds
    }
    fn active(&self) -> &Active {
        self.active
    }
    fn finds_all(&self) -> bool {
        Search::finds_all(self)
    }
    fn brick(&self, brick: [i32; 3]) -> &bricks::Cubes {
        let word = self.active.word_of(three(|a| brick[a] >> 2));
        self.active.cubes(word, bit(brick), brick, self.data, self.dims, self.bounds)
    }
    fn data(&self, cube: [i32; 3]) -> Data {
        self.gather(cube)
    }
}

/// A tile to be drawn.
pub(crate) struct Job<'a, 'b> {
    pub(crate) field: &'a dyn Field,
    pub(crate) space: &'a Space,
    pub(crate) view: &'a View,
    pub(crate) surfaces: &'a Isovalues,
    pub(crate) claims: bool,
    pub(crate) tile: Tile,
    pub(crate) out: &'a mut TileOut<'b>,
}

/// The rays of a tile and how far they are.
struct Packet {
    rays: [Ray; RAYS],
    /// Index space: `a * RAYS + ray`.
    origin: [f64; 4 * RAYS],
    direction: [f64; 4 * RAYS],
    /// Parameter of the plane that is the lower face of cubes x of axis a: `x * inv[a] + shift[a]`.
    inv: [PerRay; 3],
    shift: [PerRay; 3],
    /// The same for the six forms of `ray.rs`.
    form_inv: [PerRay; 6],
    form_shift: [PerRay; 6],
    /// Parameters at which the rays enter and leave the domain.
    begin: PerRay,
    end: PerRay,
    /// Rays that are still under way.
    alive: RaySet,
    /// Blocks that have such rays.
    blocks: u32,
    /// Rays to be walked alone.
    single: RaySet,
    /// Rays that hit something, and what; none of them is in `single`.
    hit: RaySet,
    found: Found,
    /// Whether axis a descends.
    down: [bool; 3],
    /// The relative margin of every ray, with what the ends of the domain add.
    margin: f64,
}

/// The piece each ray ends in.
struct Found {
    /// 192 times the Bernstein coefficients between t0 and t1.
    p: [PerRay; 4],
    t0: PerRay,
    t1: PerRay,
    /// The root in [0, 1], where it is known already; else below 0.
    root: PerRay,
    /// Its bracket reaches at most that far on both sides.
    reach: PerRay,
    cube: [[i32; 3]; RAYS],
    kind: [u8; RAYS],
}

/// The part of index space that the rays of a tile can be in: per plane across the major axis an interval of each other axis.
struct Frustum {
    major: usize,
    /// Where the rays begin and end along the major axis; the first is the nearer one.
    ends: [f64; 2],
    /// Least and greatest of the other two axes (major + 1, major + 2) at both ends.
    sides: [[[f64; 2]; 2]; 2],
}

thread_local! {
    /// Some 90 KiB that need no clearing between tiles.
    static PACKET: RefCell<Box<Packet>> = RefCell::new(Packet::new());
}

impl Job<'_, '_> {
    /// Whether packets can draw the tile: the first hit of one isovalue ends a ray, whole, and no work is counted per pixel.
    pub(crate) fn suits_packets(&self) -> bool {
        let &[_] = self.surfaces.values() else { return false };
        let surface = &self.surfaces.all()[usize::from(self.surfaces.surface(0))];
        self.field.finds_all()
            && self.view.clips.is_empty()
            && self.tile.width <= TILE
            && self.tile.height <= TILE
            && self.out.layers() == 1
            && !self.out.holds(Channels::HITS)
            && !self.out.holds(Channels::WORK)
            && (surface.opacity >= 1.0 || !self.out.holds(Channels::RGBA))
    }

    /// Draws what packets can; gives the rays that are left.
    pub(crate) fn draw(&mut self, level: Level, view: &Projection, most: f64, work: &mut Work) -> RaySet {
        if self.misses(view) {
            self.finish_empty(&self.all());
            return [0; BLOCKS];
        }
        PACKET.with_borrow_mut(|packet| {
            #[cfg(target_arch = "x86_64")]
            if level.is_available() {
                match level {
                    #[expect(unsafe_code, reason = "functions with target features")]
                    // SAFETY: `is_available` found the features.
                    Level::Avx512 => return unsafe { avx512(packet, self, view, most, work) },
                    #[expect(unsafe_code, reason = "functions with target features")]
                    // SAFETY: `is_available` found the features.
                    Level::Avx2 => return unsafe { avx2(packet, self, view, most, work) },
                    Level::Scalar => {}
                }
            }
            let _ = level;
            self.draw_in::<Plain>(packet, view, most, work)
        })
    }

    #[inline(always)]
    fn draw_in<S: Lanes>(&mut self, packet: &mut Packet, view: &Projection, most: f64, work: &mut Work) -> RaySet {
        let Some(frustum) = packet.start::<S>(self, most) else {
            return self.all();
        };
        if packet.blocks != 0 {
            let crossing = Crossing::new(packet, self.tile, view);
            let mut cubes = Cubes::<S>::new(self.field, packet.margin);
            crossing.cross(&mut cubes, packet, &frustum, work);
            let bound = cubes.bound();
            self.finish::<S>(packet, bound);
        }
        let mut empty = self.all();
        for (e, (h, s)) in empty.iter_mut().zip(packet.hit.iter().zip(&packet.single)) {
            *e &= !(h | s);
        }
        self.finish_empty(&empty);
        packet.single
    }

    /// The pixels of the tile: less than all at the edges of the image.
    fn all(&self) -> RaySet {
        std::array::from_fn(|b| {
            (0..LANES).fold(0, |m, l| {
                let (x, y) = pixel(b, l);
                m | u8::from(x < self.tile.width && y < self.tile.height) << l
            })
        })
    }

    /// Whether no ray of the tile can meet the volume.
    fn misses(&self, view: &Projection) -> bool {
        let t = self.tile;
        let hi = self.space.domain.hi.to_array();
        view.bounds(hi).is_some_and(|[x, y]| {
            x[1] < t.x as f64 || x[0] > (t.x + t.width - 1) as f64 || y[1] < t.y as f64 || y[0] > (t.y + t.height - 1) as f64
        })
    }

    /// Writes the pixels without a hit.
    fn finish_empty(&mut self, rays: &RaySet) {
        if !(self.claims && self.out.holds(Channels::CLAIM)) {
            return;
        }
        let empty = Pixel {
            claim: Claim::EMPTY,
            ..Pixel::default()
        };
        for (b, &set) in rays.iter().enumerate() {
            for l in ones(set.into()) {
                let (x, y) = pixel(b, l);
                self.out.set_pixel(self.tile.x + x, self.tile.y + y, &empty);
            }
        }
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,bmi1,bmi2,lzcnt,popcnt")]
fn avx512(p: &mut Packet, job: &mut Job<'_, '_>, view: &Projection, most: f64, work: &mut Work) -> RaySet {
    job.draw_in::<Avx512>(p, view, most, work)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
fn avx2(p: &mut Packet, job: &mut Job<'_, '_>, view: &Projection, most: f64, work: &mut Work) -> RaySet {
    job.draw_in::<Avx2>(p, view, most, work)
}

impl Packet {
    fn new() -> Box<Self> {
        let zero = [[0.0; LANES]; BLOCKS];
        let none = [0; BLOCKS];
        Box::new(Self {
            rays: [Ray {
                origin: glam::DVec3::ZERO,
                direction: glam::DVec3::ZERO,
            }; RAYS],
            origin: [0.0; 4 * RAYS],
            direction: [0.0; 4 * RAYS],
            inv: [zero; 3],
            shift: [zero; 3],
            form_inv: [zero; 6],
            form_shift: [zero; 6],
            begin: zero,
            end: zero,
            alive: none,
            blocks: 0,
            single: none,
            hit: none,
            found: Found {
                p: [zero; 4],
                t0: zero,
                t1: zero,
                root: zero,
                reach: zero,
                cube: [[0; 3]; RAYS],
                kind: [0; RAYS],
            },
            down: [false; 3],
            margin: 0.0,
        })
    }

    /// Eight of the numbers of rays, those of block `b` for axis `a`.
    #[inline(always)]
    fn of<S: Lanes>(all: &[f64; 4 * RAYS], a: usize, b: usize) -> S {
        let at = a * RAYS + b * LANES;
        all[at..].first_chunk().map_or(S::splat(0.0), S::load)
    }

    /// Makes the rays; `None` where they cannot travel together. `most`: the margin that activity allows for.
    #[inline(always)]
    fn start<S: Lanes>(&mut self, job: &Job<'_, '_>, most: f64) -> Option<Frustum> {
        let (space, t) = (job.space, job.tile);
        let rays = job.view.generator();
        // The greatest margin of a rectangle of origins is that of a corner.
        let corner = |x: usize, y: usize| space.margin(rays.ray(t.x + x * (t.width - 1), t.y + y * (t.height - 1)).origin);
        let margin = corner(0, 0).max(corner(1, 0)).max(corner(0, 1).max(corner(1, 1))) * (1.0 + 1e-9);
        // What the ends of the domain may add; rays that need more go alone.
        let more = AT_ENDS * margin;
        if margin + more > most || margin.is_nan() {
            return None;
        }
        self.margin = margin;
        self.alive = job.all();
        (self.blocks, self.single, self.hit) = (0, [0; BLOCKS], [0; BLOCKS]);
        for b in 0..BLOCKS {
            for l in 0..LANES {
                let (x, y) = pixel(b, l);
                let ray = rays.ray(t.x + x.min(t.width - 1), t.y + y.min(t.height - 1));
                let n = b * LANES + l;
                self.rays[n] = ray;
                let o = space.index_vector(ray.origin - space.domain.origin).to_array();
                let d = space.index_vector(ray.direction).to_array();
                for a in 0..3 {
                    self.origin[a * RAYS + n] = o[a];
                    self.direction[a * RAYS + n] = d[a];
                }
            }
        }
        for a in 0..3 {
            let (mut up, mut down) = (u8::MAX, u8::MAX);
            for b in 0..BLOCKS {
                let d = Self::of::<S>(&self.direction, a, b);
                up &= d.above(S::splat(PARALLEL));
                down &= S::splat(-PARALLEL).above(d);
            }
            if up != u8::MAX && down != u8::MAX {
                return None;
            }
            self.down[a] = down == u8::MAX;
        }
        self.enter::<S>(space, more);
        self.forms::<S>();
        let major = self.major::<S>()?;
        let hi = three(|a| space.domain.hi[a] + SHIFT);
        let near = three(|a| if self.down[a] { hi[a] } else { SHIFT });
        let far = three(|a| if self.down[a] { SHIFT } else { hi[a] });
        Some(self.frustum::<S>(major, near, far))
    }

    /// Where the rays enter and leave the domain, and what that adds to the margin; at most `most`.
    #[inline(always)]
    fn enter<S: Lanes>(&mut self, space: &Space, most: f64) {
        let hi = three(|a| space.domain.hi[a] + SHIFT);
        let near = three(|a| if self.down[a] { hi[a] } else { SHIFT });
        let far = three(|a| if self.down[a] { SHIFT } else { hi[a] });
        let (one, zero) = (S::splat(1.0), S::splat(0.0));
        let mut needed = zero;
        for b in 0..BLOCKS {
            let (mut first, mut last) = (zero, S::splat(f64::INFINITY));
            let (mut grown_first, mut grown_last) = (first, last);
            let (mut shrunk_first, mut shrunk_last, mut fastest) = (first, last, zero);
            for a in 0..3 {
                let d = Self::of::<S>(&self.direction, a, b);
                let inv = one.div(d);
                let shift = zero.sub(Self::of::<S>(&self.origin, a, b).add(S::splat(SHIFT))).mul(inv);
                inv.store(&mut self.inv[a][b]);
                shift.store(&mut self.shift[a][b]);
                fastest = fastest.max(d.abs());
                let grow = self.margin / PART * if self.down[a] { 1.0 } else { -1.0 };
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
                .mul(S::splat(STEEPEST));
            let doubtful = shrunk_first.above(shrunk_last) | ends.above(S::splat(most));
            let all = self.alive[b];
            self.alive[b] = all & !outside & !doubtful;
            self.single[b] = all & ((outside & !surely) | (!outside & doubtful));
            self.blocks |= u32::from(self.alive[b] != 0) << b;
            needed = ends.max(zero).where_or(self.alive[b], zero).max(needed);
        }
        let mut lanes = [0.0; LANES];
        needed.store(&mut lanes);
        // What the ray needs that needs most.
        self.margin += lanes.iter().fold(0.0, |m, &v| if v > m { v } else { m });
    }

    /// Parameters of the six planes through the centres of cubes; never inside where a ray is parallel.
    #[inline(always)]
    fn forms<S: Lanes>(&mut self) {
        let zero = S::splat(0.0);
        for b in ones(self.blocks) {
            for (n, &(i, j, sign)) in FORMS.iter().enumerate() {
                let p = Self::of::<S>(&self.origin, i, b).add(S::splat(sign).mul(Self::of(&self.origin, j, b)));
                let q = Self::of::<S>(&self.direction, i, b).add(S::splat(sign).mul(Self::of(&self.direction, j, b)));
                let crosses = q.above(zero) | zero.above(q);
                let inv = S::splat(1.0).div(q).where_or(crosses, zero);
                let shift = zero.sub(p).mul(inv).where_or(crosses, S::splat(f64::NEG_INFINITY));
                inv.store(&mut self.form_inv[n][b]);
                shift.store(&mut self.form_shift[n][b]);
            }
        }
    }

    /// The axis along which the slowest of the rays under way is fastest; `None` where a ray is next to parallel to each axis's slices.
    #[inline(always)]
    fn major<S: Lanes>(&self) -> Option<usize> {
        let infinite = S::splat(f64::INFINITY);
        let mut least = [infinite; 3];
        for b in ones(self.blocks) {
            let speed = three(|a| Self::of::<S>(&self.direction, a, b).abs());
            let fastest = speed[0].max(speed[1]).max(speed[2]);
            least = three(|a| least[a].min(speed[a].div(fastest).where_or(self.alive[b], infinite)));
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
        let down = self.down[major];
        let mut start = near[major];
        if self.blocks != 0 {
            let first = ones(self.blocks)
                .flat_map(|b| ones(self.alive[b].into()).map(move |l| b * LANES + l))
                .map(|n| self.origin[major * RAYS + n] + SHIFT);
            start = if down {
                first.fold(f64::NEG_INFINITY, f64::max).min(start)
            } else {
                first.fold(f64::INFINITY, f64::min).max(start)
            };
        }
        let ends = [start, far[major]];
        let mut sides = [[[f64::INFINITY, f64::NEG_INFINITY]; 2]; 2];
        for b in ones(self.blocks) {
            let alive = self.alive[b];
            for (e, &k) in ends.iter().enumerate() {
                let t = S::splat(k)
                    .mul(S::load(&self.inv[major][b]))
                    .add(S::load(&self.shift[major][b]));
                for (i, side) in sides.iter_mut().enumerate() {
                    let a = (major + 1 + i) % 3;
                    let o = Self::of::<S>(&self.origin, a, b).add(S::splat(SHIFT));
                    let u = o.add(t.mul(Self::of::<S>(&self.direction, a, b)));
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
}
