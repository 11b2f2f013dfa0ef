//! Roots on their way from a cell to a pixel: put aside, worked out, put in order, written.
//!
//! Where the first root ends a ray, as in most frames, there is a place for one per ray, and nothing is put in order.

use super::lanes::{LANES, Lanes};
use super::pending::{One, Pending};
use super::rays::{Frustum, Place, Rays, Space};
use super::{BLOCKS, RAYS, RaySet, ones, pixel};
use crate::index::vague;
use crate::scene::Isovalues;
use crate::{Blend, PixelSink, TileOut};
use isobar_core::{Channels, Claim, Hit, Pixel};

/// Roots of a tile: more than some 100 a ray are not gathered, and the rays go alone.
const MOST: usize = 1 << 15;

/// No entry of a list.
const NONE: u32 = u32::MAX;

/// How far rays have to go.
#[derive(Debug, Clone, Copy)]
pub struct Wanted {
    /// The first root ends a ray.
    first: bool,
    /// No root does.
    all: bool,
    /// So many end a ray...
    layers: u16,
    /// ...if this is false, or one of them is of an opaque surface.
    colour: bool,
    /// Values that are opaque, a bit each.
    opaque: [u64; 4],
}

impl Wanted {
    /// What the channels and layers of a frame need, as [`PixelSink::wants_more`] has it.
    #[must_use]
    pub fn new(out: &TileOut<'_>, surfaces: &Isovalues) -> Self {
        let (all, colour) = (out.holds(Channels::HITS), out.holds(Channels::RGBA));
        let mut opaque = [0; 4];
        let mut through = false;
        for i in 0..surfaces.values().len() {
            if surfaces.all()[usize::from(surfaces.surface(i))].opacity >= 1.0 {
                opaque[i >> 6] |= 1 << (i & 63);
            } else {
                through = true;
            }
        }
        Self {
            first: !all && out.layers() == 1 && !(colour && through),
            all,
            layers: u16::try_from(out.layers()).unwrap_or(u16::MAX),
            colour,
            opaque,
        }
    }

    /// Whether the first root ends a ray.
    #[inline(always)]
    #[must_use]
    pub const fn first(&self) -> bool {
        self.first
    }
}

/// A root of a ray.
#[derive(Debug, Clone, Copy)]
pub struct Solved {
    /// Its parameter.
    pub t: f64,
    /// A root is proved to lie within that of it; infinite where it is not.
    pub error: f64,
    /// Unit normal in the world.
    pub normal: [f32; 3],
    /// Number of the isovalue.
    pub value: u8,
}

/// Whether proved roots of two isovalues may be in either order.
#[inline(always)]
fn clash(a: &Solved, b: &Solved) -> bool {
    let error = a.error + b.error;
    a.value != b.value && error < f64::INFINITY && (a.t - b.t).abs() <= error
}

/// The rays of a tile with their roots.
#[derive(Debug)]
pub struct Packet<const N: usize> {
    /// The rays.
    pub rays: Rays,
    /// Roots put aside.
    pub pending: Pending<N>,
    /// Active cells on each ray, where the frame wants to know.
    pub cells: [[u32; LANES]; BLOCKS],
    wanted: Wanted,
    /// Roots of each ray, where some number of them ends it, and whether an opaque surface is among them.
    counts: [u16; RAYS],
    opaque: RaySet,
    /// Roots worked out, with the next one of the same ray.
    solved: Vec<(Solved, u32)>,
    /// Of each ray the first and the last one.
    ends: [[u32; 2]; RAYS],
    /// Where the first root ends a ray: the rays that have one, and these.
    hit: RaySet,
    first: [Solved; RAYS],
    /// See [`vague`]; rays of views have unit directions.
    vague: f64,
}

impl<const N: usize> Packet<N> {
    /// No rays. Some 80 KiB, which need no clearing between tiles.
    #[must_use]
    pub fn new() -> Box<Self> {
        Box::new(Self {
            rays: Rays::new(),
            pending: Pending::new(),
            cells: [[0; LANES]; BLOCKS],
            wanted: Wanted {
                first: true,
                all: false,
                layers: 1,
                colour: false,
                opaque: [0; 4],
            },
            counts: [0; RAYS],
            opaque: [0; BLOCKS],
            solved: Vec::new(),
            ends: [[NONE; 2]; RAYS],
            hit: [0; BLOCKS],
            first: [Solved {
                t: 0.0,
                error: 0.0,
                normal: [0.0; 3],
                value: 0,
            }; RAYS],
            vague: f64::INFINITY,
        })
    }

    /// For a tile whose rays all miss the volume.
    pub fn forget(&mut self) {
        self.rays.forget();
        self.pending.clear();
        self.hit = [0; BLOCKS];
        // What was linked in the tile before.
        if !self.solved.is_empty() {
            self.solved.clear();
            self.ends = [[NONE; 2]; RAYS];
        }
    }

    /// Makes the rays; `None` where they cannot all travel together. `count`: whether cells on each ray are to be counted.
    #[inline(always)]
    pub fn start<S: Lanes, D: Space>(&mut self, place: &Place<'_, D>, wanted: Wanted, count: bool) -> Option<Frustum> {
        self.want(wanted, count);
        self.vague = vague(place.space.domain(), 1.0);
        self.rays.start::<S, D>(place)
    }

    /// Makes the rays; false where none of them can travel in packets. They do so group by group ([`Packet::next_group`]), and before the next one goes the roots that
    /// are pending have to be worked out.
    #[inline(always)]
    pub fn make<S: Lanes, D: Space>(&mut self, place: &Place<'_, D>, wanted: Wanted, count: bool) -> bool {
        self.want(wanted, count);
        self.vague = vague(place.space.domain(), 1.0);
        self.rays.make::<S, D>(place)
    }

    /// As [`Rays::next_group`].
    #[inline(always)]
    pub fn next_group<S: Lanes, D: Space>(&mut self, place: &Place<'_, D>) -> Option<Frustum> {
        self.pending.clear();
        self.rays.next_group::<S, D>(place)
    }

    fn want(&mut self, wanted: Wanted, count: bool) {
        self.forget();
        self.wanted = wanted;
        if count {
            self.cells = [[0; LANES]; BLOCKS];
        }
        if !wanted.first && !wanted.all {
            (self.counts, self.opaque) = ([0; RAYS], [0; BLOCKS]);
        }
    }

    /// Whether the first root ends a ray.
    #[inline(always)]
    #[must_use]
    pub const fn wants_first(&self) -> bool {
        self.wanted.first
    }

    /// Puts aside polynomials `p` between the parameters `ends`, which have exactly one root, for the lanes `m` of block `b`.
    #[inline(always)]
    pub fn push<S: Lanes>(&mut self, m: u8, b: usize, p: &[S], ends: [S; 2], near: [f64; 3], value: u8) {
        self.pending.push(m, b, p, ends, near, value);
        if !self.wanted.first && !self.wanted.all {
            self.count(b, m, value);
        }
    }

    /// Puts aside one polynomial.
    pub fn push_one(&mut self, one: &One<'_>) {
        self.pending.push_one(one);
        if !self.wanted.first && !self.wanted.all {
            let ray = usize::from(one.ray);
            self.count(ray / LANES, 1 << (ray % LANES), one.value);
        }
    }

    fn count(&mut self, b: usize, m: u8, value: u8) {
        for l in ones(m.into()) {
            let n = &mut self.counts[b * LANES + l];
            *n = n.saturating_add(1);
        }
        if self.wanted.opaque[usize::from(value >> 6)] >> (value & 63) & 1 != 0 {
            self.opaque[b] |= m;
        }
    }

    /// After a cell: rays `hit` of block `b` have further roots in it; takes out those that need no more, and those to be walked alone.
    #[inline(always)]
    pub fn advance(&mut self, b: usize, hit: u8, alone: u8) {
        if hit | alone == 0 {
            return;
        }
        let ended = if self.wanted.first { hit } else { self.ended(b, hit) };
        let many = if self.pending.len() > MOST { hit } else { 0 };
        self.rays.take_out(b, ended, alone | many);
    }

    /// Which of the rays that were hit need no more.
    fn ended(&self, b: usize, hit: u8) -> u8 {
        let w = &self.wanted;
        if w.all {
            return 0;
        }
        let enough = ones(hit.into())
            .filter(|l| self.counts[b * LANES + l] >= w.layers)
            .fold(0, |m, l| m | 1 << l);
        if w.colour { enough & self.opaque[b] } else { enough }
    }

    /// Adds a root of a ray, in its place. A ray with a proved root that is vague, or that cannot be told from one of another isovalue, is to be walked alone.
    #[inline(always)]
    pub fn add(&mut self, ray: u8, root: Solved) {
        if root.error > self.vague && root.error < f64::INFINITY {
            self.leave(ray);
        }
        if !self.wanted.first {
            self.link(ray, root);
            return;
        }
        let (ray, bit) = (usize::from(ray), 1 << (usize::from(ray) % LANES));
        let is_hit = self.hit[ray / LANES] & bit != 0;
        // Of several isovalues more than one may have a root in a cell.
        if is_hit && clash(&self.first[ray], &root) {
            self.rays.single[ray / LANES] |= bit;
        }
        if !is_hit || root.t < self.first[ray].t {
            self.hit[ray / LANES] |= bit;
            self.first[ray] = root;
        }
    }

    #[cold]
    fn leave(&mut self, ray: u8) {
        let ray = usize::from(ray);
        self.rays.single[ray / LANES] |= 1 << (ray % LANES);
    }

    fn link(&mut self, ray: u8, root: Solved) {
        let new = self.solved.len() as u32;
        let [first, last] = self.ends[usize::from(ray)];
        let later = |at: u32| self.solved[at as usize].0.t > root.t;
        if last == NONE || !later(last) {
            if last != NONE && clash(&self.solved[last as usize].0, &root) {
                self.leave(ray);
            }
            self.solved.push((root, NONE));
            if last == NONE {
                self.ends[usize::from(ray)] = [new, new];
            } else {
                self.solved[last as usize].1 = new;
                self.ends[usize::from(ray)][1] = new;
            }
            return;
        }
        // Of the last cell, most likely; roots before it are few.
        let (mut before, mut at) = (NONE, first);
        while !later(at) {
            (before, at) = (at, self.solved[at as usize].1);
        }
        let beside = |at: u32| at != NONE && clash(&self.solved[at as usize].0, &root);
        if beside(before) || beside(at) {
            self.leave(ray);
        }
        self.solved.push((root, at));
        if before == NONE {
            self.ends[usize::from(ray)][0] = new;
        } else {
            self.solved[before as usize].1 = new;
        }
    }

    /// Writes all pixels but those of rays to be walked alone. `claims`: whether what is proved is claimed. `count`: as at the start.
    pub fn write<D: Space>(&self, place: &Place<'_, D>, surfaces: &Isovalues, out: &mut TileOut<'_>, claims: bool, count: bool) {
        let mut empty = place.rays();
        if self.wanted.first {
            self.write_first(place, surfaces, out, claims, count);
            for (b, empty) in empty.iter_mut().enumerate() {
                *empty &= !(self.rays.single[b] | self.hit[b]);
            }
            place.write_empty(
                out,
                &empty,
                claims && out.holds(Channels::CLAIM),
                count.then_some(&self.cells),
            );
            return;
        }
        for (b, empty) in empty.iter_mut().enumerate() {
            *empty &= !self.rays.single[b];
            for l in ones(u32::from(*empty)) {
                let ray = b * LANES + l;
                let [mut at, _] = self.ends[ray];
                if at == NONE {
                    continue;
                }
                *empty &= !(1 << l);
                let (x, y) = pixel(b, l);
                let world = &self.rays.rays[ray];
                let mut sink = PixelSink::new(out, place.tile.x + x, place.tile.y + y, world, surfaces.all());
                let proved = claims && self.solved[at as usize].0.error < f64::INFINITY;
                while at != NONE {
                    let (root, next) = &self.solved[at as usize];
                    let go_on = sink.push(&Hit {
                        t: root.t,
                        point: world.at(root.t),
                        normal: root.normal,
                        surface: surfaces.surface(root.value.into()),
                        t_error: if proved { root.error } else { f64::INFINITY },
                    });
                    at = if go_on { *next } else { NONE };
                }
                let claim = if proved {
                    Claim::EXISTS | Claim::FIRST
                } else {
                    Claim::empty()
                };
                sink.finish(claim, if count { self.cells[b][l] } else { 0 });
            }
        }
        let claims = claims && out.holds(Channels::CLAIM);
        place.write_empty(out, &empty, claims, count.then_some(&self.cells));
    }

    /// Where the first root ends a ray, what was hit: of each pixel one layer, whose surface is opaque where there is colour.
    fn write_first<D: Space>(
        &self,
        place: &Place<'_, D>,
        surfaces: &Isovalues,
        out: &mut TileOut<'_>,
        claims: bool,
        count: bool,
    ) {
        let colour = out.holds(Channels::RGBA);
        for b in 0..BLOCKS {
            for l in ones((self.hit[b] & !self.rays.single[b]).into()) {
                let ray = b * LANES + l;
                let (world, root) = (&self.rays.rays[ray], &self.first[ray]);
                let (x, y) = pixel(b, l);
                let (x, y) = (place.tile.x + x, place.tile.y + y);
                let surface = surfaces.surface(root.value.into());
                let proved = claims && root.error < f64::INFINITY;
                let hit = Hit {
                    t: root.t,
                    point: world.at(root.t),
                    normal: root.normal,
                    surface,
                    t_error: if proved { root.error } else { f64::INFINITY },
                };
                out.set_hit(0, x, y, &hit);
                let mut blend = Blend::default();
                if colour {
                    blend.add(&surfaces.all()[usize::from(surface)], root.normal, world.direction);
                }
                let known = Pixel {
                    hits: 1,
                    claim: if proved {
                        Claim::EXISTS | Claim::FIRST
                    } else {
                        Claim::empty()
                    },
                    rgba: blend.rgba(),
                    work: if count { self.cells[b][l] } else { 0 },
                };
                out.set_pixel(x, y, &known);
            }
        }
    }
}
