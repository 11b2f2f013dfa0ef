//! The caster of degrees 2 and 3: the rays of one tile through nodes, bricks and cells.
//!
//! The walk is that of `crate::walk` (Steinberger 2010, section 3.3, on three sizes: nodes of 16^3 cells, bricks of 4^3, cells), in the index space
//! of [`Space`]. In an active cell the polynomial is composed in f32 first ([`Table::compose`]): if every coefficient is on one side of zero beyond
//! its bound, there is no root, and this is all that most cells cost. Else it is composed again in f64 and solved (`roots.rs`).
//!
//! **Bounds.** In f64, u = 2^-53: (12E) M + 160 u M spread, in units of the scale; E bounds the position (see [`Space::margin`]), M the greatest
//! |coefficient - c| of the volume. In f32, v = 2^-24: the ends of the segment are rounded, which moves a coefficient by at most 6 v M; subtracting c
//! as a sum of two f32 leaves 2v (m + v |c|), m the greatest difference of the stencil. Both are within 160 v (m + v |c|) spread, which is what the
//! composition loses, as long as spread is above 2: (12E) M + 6 v M + 160 v (m + v |c|) spread.

use super::AnyBricks;
use super::basis::{LANES, Spline, Table, gradient, growth};
use super::bricks::Active;
use super::lattice::{Entry, Lattice, Path, Space, local, three};
use super::planes::Plane;
use super::roots::{Candidate, Segment, Track};
use super::vector::{Isa, Portable, Register};
use crate::bricks::bit;
use crate::exact::{Exact, PLACE, Volume, common_sign};
use crate::trilinear::MARGIN;
use crate::walk::Bounds;
use glam::DVec3;
use isobar_core::{Claim, Hit, View};
use isobar_cpu::index::vague;
use isobar_cpu::packet::{RaySet, holds};
use isobar_cpu::scene::Isovalues;
use isobar_cpu::{Kernel, Level, PixelSink, Tile, TileOut};
use std::marker::PhantomData;
use std::sync::atomic::AtomicBool;

/// Work done along rays.
#[derive(Debug, Default, Clone, Copy)]
pub(crate) struct Work {
    pub(crate) nodes: u64,
    pub(crate) bricks: u64,
    /// Active cells crossed.
    pub(crate) cells: u64,
    /// Compositions in f32.
    pub(crate) filtered: u64,
    /// Compositions in f64.
    pub(crate) composed: u64,
    /// As in [`crate::walk::Work`].
    pub(crate) alone: u64,
    /// As in [`crate::walk::Work`].
    pub(crate) exact: [u64; 2],
}

/// Everything that stays the same over a frame.
#[derive(Debug)]
pub(crate) struct Search<'a> {
    pub(crate) lattice: Lattice<'a>,
    pub(crate) bricks: &'a AnyBricks,
    /// As in [`super::Smooth`].
    pub(crate) planes: &'a [Plane],
    /// Set where a plane has told the cells of a brick.
    pub(crate) rough: &'a AtomicBool,
    /// Cells that planes may have left too many are looked for, and taken back.
    pub(crate) refine: bool,
    pub(crate) space: &'a Space,
    pub(crate) active: &'a Active,
    pub(crate) bounds: &'a [Bounds],
    pub(crate) single: &'a Table<f32>,
    pub(crate) double: &'a Table<f64>,
    pub(crate) claims: bool,
    pub(crate) level: Level,
}

/// Draws one tile; gives the work done.
pub(crate) struct DrawTile<'a, 'b, S, I> {
    pub(crate) search: &'a Search<'a>,
    pub(crate) view: &'a View,
    pub(crate) surfaces: &'a Isovalues,
    pub(crate) tile: Tile,
    pub(crate) out: &'a mut TileOut<'b>,
    /// Only these.
    pub(crate) rays: Option<RaySet>,
    pub(crate) kind: PhantomData<(S, I)>,
}

/// A cell's coefficients in f32, kept for the next rays of the tile.
#[repr(align(64))]
#[derive(Clone, Copy)]
struct Kept {
    d: [f32; 64],
    /// Bound of the composition's own rounding.
    rounding: f64,
    cell: [i32; 3],
    surface: usize,
}

/// Cells kept, by the lowest two bits of their indices: neighbouring rays meet the same few.
const KEPT: usize = 64;

/// State of one ray on its way.
struct Way<'a> {
    tracks: &'a mut [Track],
    found: &'a mut Vec<Candidate>,
    work: &'a mut Work,
    kept: &'a mut [Kept; KEPT],
    /// Parameter at the end of the last cell looked at.
    end: f64,
    /// 12E of the ray, at most [`MARGIN`].
    margin: f64,
    /// All that was walked is free of roots but those reported.
    certain: bool,
}

impl<S: Spline, I: Isa> Kernel for DrawTile<'_, '_, S, I> {
    type Output = Work;

    #[inline(always)]
    fn run(self) -> Work {
        let Self {
            search,
            view,
            surfaces,
            tile,
            out,
            rays: only,
            ..
        } = self;
        let rays = view.generator();
        let mut work = Work::default();
        let mut tracks = vec![Track::default(); surfaces.values().len()];
        let mut found = Vec::with_capacity(16);
        let none = Kept {
            d: [0.0; 64],
            rounding: 0.0,
            cell: [-1; 3],
            surface: 0,
        };
        let mut kept = [none; KEPT];
        let exact = Exact {
            space: search.space.of_degree_1(),
            clips: &view.clips,
            bounds: search.bounds,
            surfaces,
        };
        let mut left = Exact::allowed(search.claims, view, out);
        let asked = left > 0;
        let volume = Exactly::<S>(search, PhantomData);
        let mut eye = rays.ray(tile.x, tile.y).origin;
        let mut margin = search.space.margin(eye);
        for (x, y) in tile.pixels() {
            if only.is_some_and(|set| !holds(&set, x - tile.x, y - tile.y)) {
                continue;
            }
            let ray = rays.ray(x, y);
            let before = work.cells;
            work.alone += 1;
            if ray.origin != eye {
                eye = ray.origin;
                margin = search.space.margin(eye);
            }
            let mut sure = margin <= MARGIN;
            let mut sink = PixelSink::new(out, x, y, &ray, surfaces.all());
            let mut claim = Claim::empty();
            let mut certain = true;
            let (least, mut worst) = (vague(&search.space.of_degree_1().domain, ray.direction.length()), 0.0f64);
            if !tracks.is_empty() {
                match search.space.enter(&ray, &view.clips, margin) {
                    Entry::Through(path) => {
                        tracks.fill(Track::default());
                        sure &= margin + path.ends <= MARGIN;
                        let mut way = Way {
                            tracks: &mut tracks,
                            found: &mut found,
                            work: &mut work,
                            kept: &mut kept,
                            end: f64::NEG_INFINITY,
                            margin: if sure { margin + path.ends } else { margin.min(MARGIN) },
                            certain: true,
                        };
                        let mut push = |c: &Candidate, first: bool| {
                            let proved = sure && c.crosses && search.claims;
                            if sink.hits() == 0 && proved {
                                claim = if first { Claim::EXISTS | Claim::FIRST } else { Claim::EXISTS };
                            }
                            // The ends of the bracket, and t itself, are rounded.
                            let error = (c.t - c.lo).max(c.hi - c.t) + 8.0 * f64::EPSILON * c.hi.abs();
                            worst = worst.max(error);
                            // Relative to the isovalue: on a plateau the gradient is exactly zero.
                            let d = search.lattice.doubles::<S>(c.cell, search.bounds[c.surface].isovalue);
                            let g = gradient::<S>(&d, c.at);
                            let g = search.space.world_gradient(DVec3::from_array(g));
                            sink.push(&Hit {
                                t: c.t,
                                point: ray.at(c.t),
                                normal: g.normalize_or(DVec3::ZERO).as_vec3().to_array(),
                                surface: surfaces.surface(c.surface),
                                t_error: if proved { error } else { f64::INFINITY },
                            })
                        };
                        search.nodes::<S, I>(&path, &mut way, &mut push);
                        certain = way.certain;
                    }
                    Entry::Misses { certain: missed } => certain = missed,
                }
            }
            if sink.hits() == 0 && certain && sure && search.claims {
                claim = Claim::EMPTY;
            }
            let (hits, cells) = (sink.hits(), (work.cells - before) as u32);
            sink.finish(claim, cells);
            if asked && !(certain && worst <= least && Exact::is_decided(claim)) {
                work.exact[0] += u64::from(left > 0);
                let anew = (left > 0).then(|| exact.draw(&volume, out, ([x, y], &ray), (hits, cells), &mut left));
                work.exact[1] += u64::from(!Exact::is_decided(anew.flatten().unwrap_or(claim)));
            }
        }
        work
    }
}

/// The spline as the exact stage has it.
struct Exactly<'a, S>(&'a Search<'a>, PhantomData<S>);

impl<S: Spline> Volume for Exactly<'_, S> {
    fn degree(&self) -> usize {
        S::DEGREE
    }

    fn cells(&self) -> [i32; 3] {
        self.0.space.cells
    }

    fn shift(&self) -> f64 {
        if S::CENTRED { 0.5 } else { 0.0 }
    }

    fn stencil(&self, cell: [i32; 3]) -> [f64; 64] {
        self.0.lattice.doubles::<S>(cell, 0.0)
    }

    fn gradient(&self, cell: [i32; 3], at: [f64; 3], isovalue: f64) -> DVec3 {
        DVec3::from_array(gradient::<S>(&self.0.lattice.doubles::<S>(cell, isovalue), at))
    }

    /// Positions move a coefficient by at most 12 [`PLACE`] uM, as 12E above; the rest is `basis.rs`, with M the greatest |coefficient - c| of the stencil.
    fn sign(&self, cell: [i32; 3], isovalue: f64, [a, b]: [[f64; 3]; 2]) -> i32 {
        let d = self.0.lattice.doubles::<S>(cell, isovalue);
        let most = d.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        let error = S::SCALE * (12.0 * PLACE + growth::<S>()) * 0.5 * f64::EPSILON * most;
        let mut q = [0.0; LANES];
        self.0.double.compose::<S, S::Double<Portable>>(&d, a, b).store(&mut q);
        common_sign(&q[..S::PLACES], error + 1e6 * f64::MIN_POSITIVE)
    }
}

/// The axis of the least parameter, as one truth value per axis: which one comes next is hard to predict, so nothing branches on it.
#[inline(always)]
fn nearest(t: [f64; 3]) -> [bool; 3] {
    let (ab, ac, bc) = (t[0] < t[1], t[0] < t[2], t[1] < t[2]);
    [ab & ac, !ab & bc, (ab & !ac) | !(ab | bc)]
}

/// Least of three.
#[inline(always)]
fn least(t: [f64; 3]) -> f64 {
    let m = if t[0] < t[1] { t[0] } else { t[1] };
    if m < t[2] { m } else { t[2] }
}

/// A digital differential analyser over blocks of `1 << log` cells.
struct Steps<'a> {
    path: &'a Path,
    log: u32,
    /// The block the ray is in.
    at: [i32; 3],
    /// Parameters of the planes it leaves by, and of those after.
    exits: [f64; 3],
    next: [f64; 3],
}

impl<'a> Steps<'a> {
    #[inline(always)]
    fn new(path: &'a Path, log: u32, at: [i32; 3]) -> Self {
        Self {
            path,
            log,
            at,
            exits: path.exits(at, log),
            next: path.exits(three(|a| at[a] + path.step[a]), log),
        }
    }

    /// Parameter at which the ray leaves the block.
    #[inline(always)]
    fn exit(&self) -> f64 {
        least(self.exits)
    }

    /// Goes to the next block.
    #[expect(clippy::needless_range_loop, reason = "several arrays by one index, unrolled")]
    #[inline(always)]
    fn go_on(&mut self) {
        let turn = nearest(self.exits);
        for a in 0..3 {
            self.exits[a] = if turn[a] { self.next[a] } else { self.exits[a] };
            self.at[a] += if turn[a] { self.path.step[a] } else { 0 };
        }
        self.next = self.path.exits(three(|a| self.at[a] + self.path.step[a]), self.log);
    }
}

impl Search<'_> {
    /// Calls `push` with the roots in order, and whether none lies before, until it returns false.
    #[inline(always)]
    fn nodes<S: Spline, I: Isa>(&self, w: &Path, way: &mut Way<'_>, push: &mut impl FnMut(&Candidate, bool) -> bool) {
        let last = three(|a| (self.space.cells[a] - 1) >> 2);
        let mut brick = three(|a| (w.cell_at(a, w.t0) >> 2).clamp(0, last[a]));
        let mut t = w.t0;
        'node: loop {
            way.work.nodes += 1;
            let node = three(|a| brick[a] >> 2);
            let at = self.active.word_of(node);
            let word = self.active.word(at);
            if word != 0 {
                let mut s = Steps::new(w, 2, brick);
                loop {
                    let exit = s.exit();
                    let te = if exit < w.t1 { exit } else { w.t1 };
                    // Rounded planes may lie behind where the ray is: it never goes back.
                    let te = if te > t { te } else { t };
                    if word >> bit(s.at) & 1 != 0 && !self.brick::<S, I>(w, way, [at, bit(s.at) as usize], s.at, t, te, push) {
                        return;
                    }
                    if te >= w.t1 {
                        break 'node;
                    }
                    s.go_on();
                    t = if te > t { te } else { t };
                    if (s.at[0] >> 2 ^ node[0]) | (s.at[1] >> 2 ^ node[1]) | (s.at[2] >> 2 ^ node[2]) != 0 {
                        brick = s.at;
                        if (0..3).any(|a| brick[a] < 0 || brick[a] > last[a]) {
                            break 'node;
                        }
                        continue 'node;
                    }
                }
            }
            let exits = w.exits(node, 4);
            let exit = least(exits);
            if exit >= w.t1 {
                break;
            }
            t = if exit > t { exit } else { t };
            let turn = nearest(exits);
            for a in 0..3 {
                let same = (w.cell_at(a, t) >> 2).clamp(node[a] << 2, (node[a] << 2 | 3).min(last[a]));
                let other = if w.step[a] > 0 {
                    (node[a] + 1) << 2
                } else {
                    (node[a] << 2) - 1
                };
                brick[a] = if turn[a] { other } else { same };
            }
            if (0..3).any(|a| brick[a] < 0 || brick[a] > last[a]) {
                break;
            }
        }
        if way.tracks.iter().any(|t| !t.is_settled()) {
            self.skip(way);
            self.report(way, push);
        }
    }

    /// Returns whether to go on.
    #[expect(clippy::too_many_arguments, reason = "one loop of `nodes`, split off for its length")]
    #[inline(always)]
    fn brick<S: Spline, I: Isa>(
        &self,
        w: &Path,
        way: &mut Way<'_>,
        word: [usize; 2],
        brick: [i32; 3],
        t0: f64,
        t1: f64,
        push: &mut impl FnMut(&Candidate, bool) -> bool,
    ) -> bool {
        way.work.bricks += 1;
        let cells = self.space.cells;
        // Not by planes: only packets take back what these leave too many, and a ray alone would look into a tenth more cells for good.
        let mask = self.active.cells(word[0], word[1] as u32, || self.bounded_cells::<S>(brick));
        if mask == 0 {
            return true;
        }
        let first = three(|a| {
            let lo = brick[a] << 2;
            w.cell_at(a, t0).clamp(lo, (lo | 3).min(cells[a] - 1))
        });
        let mut s = Steps::new(w, 0, first);
        let mut t = t0;
        loop {
            let exit = s.exit();
            let te = if exit < t1 { exit } else { t1 };
            let te = if te > t { te } else { t };
            if mask >> bit(s.at) & 1 != 0 && !self.cell::<S, I>(w, way, s.at, t, te, push) {
                return false;
            }
            if te >= t1 {
                return true;
            }
            s.go_on();
            if (s.at[0] >> 2 ^ brick[0]) | (s.at[1] >> 2 ^ brick[1]) | (s.at[2] >> 2 ^ brick[2]) != 0 {
                return true;
            }
            t = if te > t { te } else { t };
        }
    }

    #[inline(always)]
    fn cell<S: Spline, I: Isa>(
        &self,
        w: &Path,
        way: &mut Way<'_>,
        cell: [i32; 3],
        t0: f64,
        t1: f64,
        push: &mut impl FnMut(&Candidate, bool) -> bool,
    ) -> bool {
        let segment = Segment {
            cell,
            a: local(w, cell, t0),
            b: local(w, cell, t1),
            t0,
            t1,
        };
        way.work.cells += 1;
        if way.end != t0 {
            self.skip(way);
        }
        way.end = t1;
        for (i, bound) in self.bounds.iter().enumerate() {
            way.work.filtered += 1;
            let sign = self.filter::<S, I>(&segment, i, way);
            if sign != 0 {
                way.tracks[i].certain(sign, way.found);
                continue;
            }
            way.work.composed += 1;
            let d = self.lattice.doubles::<S>(cell, bound.isovalue);
            let mut b = [0.0; LANES];
            self.double.compose::<S, S::Double<I>>(&d, segment.a, segment.b).store(&mut b);
            let error = S::SCALE * bound.size * (way.margin + growth::<S>() * 0.5 * f64::EPSILON);
            way.certain &= way.tracks[i].take(&b[..S::PLACES], error, i, &segment, way.found);
        }
        way.found.is_empty() || self.report(way, push)
    }

    /// The sign of s - c on all of the segment, proved in f32; 0 where that cannot tell.
    #[inline(always)]
    fn filter<S: Spline, I: Isa>(&self, segment: &Segment, surface: usize, way: &mut Way<'_>) -> i8 {
        const U: f64 = 0.5 * f32::EPSILON as f64;
        let bound = &self.bounds[surface];
        let kept = &mut way.kept[bit(segment.cell) as usize];
        if kept.cell != segment.cell || kept.surface != surface {
            let high = bound.isovalue as f32;
            self.lattice
                .singles::<S>(segment.cell, high, (bound.isovalue - f64::from(high)) as f32, &mut kept.d);
            let zero = I::Single16::splat(0.0);
            let mut most = zero;
            for k in 0..4 {
                let v = I::Single16::load(&kept.d[16 * k..]);
                most = most.larger(v).larger(zero.sub(v));
            }
            let most = f64::from(most.greatest());
            // Beside relative errors an absolute one, of subnormal numbers. Near the greatest f32 sums may overflow: nothing is told then.
            kept.rounding = if most < 1e30 {
                growth::<S>() * (U * (most + U * bound.isovalue.abs()) + f64::from(f32::from_bits(1)))
            } else {
                f64::INFINITY
            };
            (kept.cell, kept.surface) = (segment.cell, surface);
        }
        let (a, b) = (three(|i| segment.a[i] as f32), three(|i| segment.b[i] as f32));
        let b = self.single.compose::<S, S::Single<I>>(&kept.d, a, b);
        let error = (S::SCALE * ((way.margin + 6.0 * U) * bound.size + kept.rounding)) as f32 * (1.0 + f32::EPSILON);
        if b.all_above(error) {
            1
        } else if b.all_below(-error) {
            -1
        } else {
            0
        }
    }

    /// The ray comes from cells that were not looked at.
    #[inline(always)]
    fn skip(&self, way: &mut Way<'_>) {
        for t in way.tracks.iter_mut() {
            t.skip(way.found);
        }
    }

    /// Hands over what was found, in order; returns whether to go on.
    #[inline(always)]
    fn report(&self, way: &mut Way<'_>, push: &mut impl FnMut(&Candidate, bool) -> bool) -> bool {
        if way.found.len() > 1 {
            way.found.sort_by(|a, b| a.t.total_cmp(&b.t));
        }
        let mut go_on = true;
        for (i, c) in way.found.iter().enumerate() {
            // Of two isovalues, and in either order.
            if way
                .found
                .get(i + 1)
                .is_some_and(|next| next.surface != c.surface && next.lo <= c.hi)
            {
                way.certain = false;
            }
            let first = way.certain && (way.tracks.len() == 1 || way.tracks.iter().all(Track::is_settled));
            go_on = push(c, first);
            way.certain &= c.crosses;
            if !go_on {
                break;
            }
        }
        way.found.clear();
        go_on
    }
}
