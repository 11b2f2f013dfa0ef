//! Roots on their way from a cell to a pixel: put aside, worked out eight at a time, put in order, written.

use super::lanes::{LANES, Lanes};
use super::rays::{Frustum, Place, Rays, Space};
use super::{BLOCKS, RAYS, RaySet, ones, pixel};
use crate::scene::Isovalues;
use crate::{PixelSink, TileOut};
use isobar_core::{Channels, Claim, Hit};

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

/// Polynomials of up to `N` coefficients that have one root each for certain, with what belongs to it; the entries of a list each.
#[derive(Debug)]
pub struct Pending<const N: usize> {
    count: usize,
    p: [Vec<f64>; N],
    ends: [Vec<f64>; 2],
    root: [Vec<f64>; 2],
    near: [Vec<f64>; 3],
    ray: Vec<u8>,
    value: Vec<u8>,
    kind: Vec<u8>,
}

/// One of [`Pending`].
#[derive(Debug, Clone, Copy)]
pub struct One<'a> {
    /// Its ray, `LANES * block + lane`.
    pub ray: u8,
    /// Coefficients between `ends`.
    pub p: &'a [f64],
    /// Parameters.
    pub ends: [f64; 2],
    /// The root in [0, 1] and how far its bracket reaches to both sides; below 0 where there is only one.
    pub root: [f64; 2],
    /// The cell, as the method counts it.
    pub near: [f64; 3],
    /// Number of the isovalue.
    pub value: u8,
    /// What part of the cell.
    pub kind: u8,
}

/// Eight of [`Pending`], of which `held` are.
#[derive(Debug)]
pub struct Group<S, const N: usize> {
    /// Coefficients between the ends.
    pub p: [S; N],
    /// Parameters.
    pub ends: [S; 2],
    /// See [`One::root`].
    pub root: [S; 2],
    /// See [`One::near`].
    pub near: [S; 3],
    /// Rays, isovalues and kinds; 0 where nothing is held.
    pub ray: [u8; LANES],
    /// See [`One::value`].
    pub value: [u8; LANES],
    /// See [`One::kind`].
    pub kind: [u8; LANES],
    /// The first ones.
    pub held: u8,
}

/// Puts the lanes of a mask together at `at`; there is room for eight.
#[inline(always)]
fn put<S: Lanes>(all: &mut [f64], at: usize, m: u8, v: S) {
    if let Some(to) = all[at..].first_chunk_mut() {
        v.store_packed(m, to);
    }
}

/// Eight from `at` on.
#[inline(always)]
fn get<S: Lanes>(all: &[f64], at: usize) -> S {
    all[at..].first_chunk().map_or(S::splat(0.0), S::load)
}

/// As [`get`], for bytes; 0 beyond `n`.
#[inline(always)]
fn bytes(all: &[u8], at: usize, n: usize) -> [u8; LANES] {
    let mut out = [0; LANES];
    for (to, &from) in out.iter_mut().zip(&all[at..at + n]) {
        *to = from;
    }
    out
}

impl<const N: usize> Pending<N> {
    const fn new() -> Self {
        Self {
            count: 0,
            p: [const { Vec::new() }; N],
            ends: [const { Vec::new() }; 2],
            root: [const { Vec::new() }; 2],
            near: [const { Vec::new() }; 3],
            ray: Vec::new(),
            value: Vec::new(),
            kind: Vec::new(),
        }
    }

    /// How many there are.
    #[must_use]
    pub const fn len(&self) -> usize {
        self.count
    }

    /// Whether there are none.
    #[must_use]
    pub const fn is_empty(&self) -> bool {
        self.count == 0
    }

    /// Room for eight more.
    #[cold]
    #[inline(never)]
    fn grow(&mut self) {
        let n = (2 * self.count).max(RAYS) + LANES;
        for v in (self.p.iter_mut())
            .chain(&mut self.ends)
            .chain(&mut self.root)
            .chain(&mut self.near)
        {
            v.resize(n, 0.0);
        }
        for v in [&mut self.ray, &mut self.value, &mut self.kind] {
            v.resize(n, 0);
        }
    }

    #[inline(always)]
    fn push<S: Lanes>(&mut self, m: u8, b: usize, p: &[S], ends: [S; 2], near: [f64; 3], value: u8) {
        let n = self.count;
        if n + LANES > self.ray.len() {
            self.grow();
        }
        for (all, &v) in self.p.iter_mut().zip(p) {
            put(all, n, m, v);
        }
        put(&mut self.ends[0], n, m, ends[0]);
        put(&mut self.ends[1], n, m, ends[1]);
        put(&mut self.root[0], n, u8::MAX, S::splat(-1.0));
        put(&mut self.root[1], n, u8::MAX, S::splat(0.0));
        for (all, &v) in self.near.iter_mut().zip(&near) {
            put(all, n, u8::MAX, S::splat(v));
        }
        let rays = 0x0706_0504_0302_0100 + (b * LANES) as u64 * 0x0101_0101_0101_0101;
        if let Some(to) = self.ray[n..].first_chunk_mut() {
            *to = S::pack_bytes(rays, m).to_le_bytes();
        }
        if let Some(to) = self.value[n..].first_chunk_mut::<LANES>() {
            *to = [value; LANES];
        }
        if let Some(to) = self.kind[n..].first_chunk_mut::<LANES>() {
            *to = [0; LANES];
        }
        self.count += m.count_ones() as usize;
    }

    fn push_one(&mut self, one: &One<'_>) {
        let n = self.count;
        if n + LANES > self.ray.len() {
            self.grow();
        }
        for (all, &v) in self.p.iter_mut().zip(one.p) {
            all[n] = v;
        }
        for i in 0..2 {
            self.ends[i][n] = one.ends[i];
            self.root[i][n] = one.root[i];
        }
        for a in 0..3 {
            self.near[a][n] = one.near[a];
        }
        (self.ray[n], self.value[n], self.kind[n]) = (one.ray, one.value, one.kind);
        self.count += 1;
    }

    /// Up to eight from `at` on.
    #[inline(always)]
    #[must_use]
    pub fn group<S: Lanes>(&self, at: usize) -> Group<S, N> {
        let n = (self.count - at).min(LANES);
        let mut p = [S::splat(0.0); N];
        for (to, all) in p.iter_mut().zip(&self.p) {
            *to = get(all, at);
        }
        Group {
            p,
            ends: [get(&self.ends[0], at), get(&self.ends[1], at)],
            root: [get(&self.root[0], at), get(&self.root[1], at)],
            near: [get(&self.near[0], at), get(&self.near[1], at), get(&self.near[2], at)],
            ray: bytes(&self.ray, at, n),
            value: bytes(&self.value, at, n),
            kind: bytes(&self.kind, at, n),
            held: u8::MAX >> (LANES - n),
        }
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
        })
    }

    /// For a tile whose rays all miss the volume.
    pub fn forget(&mut self) {
        self.rays.forget();
        self.pending.count = 0;
        self.solved.clear();
        self.ends = [[NONE; 2]; RAYS];
    }

    /// Makes the rays; `None` where they cannot travel together. `count`: whether cells on each ray are to be counted.
    #[inline(always)]
    pub fn start<S: Lanes, D: Space>(&mut self, place: &Place<'_, D>, wanted: Wanted, count: bool) -> Option<Frustum> {
        self.forget();
        self.wanted = wanted;
        if count {
            self.cells = [[0; LANES]; BLOCKS];
        }
        if !wanted.first && !wanted.all {
            (self.counts, self.opaque) = ([0; RAYS], [0; BLOCKS]);
        }
        self.rays.start::<S, D>(place)
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
        let many = if self.pending.count > MOST { hit } else { 0 };
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

    /// Adds a root of a ray, in its place.
    pub fn add(&mut self, ray: u8, root: Solved) {
        let new = self.solved.len() as u32;
        let [first, last] = self.ends[usize::from(ray)];
        let later = |at: u32| self.solved[at as usize].0.t > root.t;
        if last == NONE || !later(last) {
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
}
