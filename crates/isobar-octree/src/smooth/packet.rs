//! Packets of rays for degrees 2 and 3: the tiles of `crate::packet`, eight f64 lanes across the rays of a block.
//!
//! Traversal is that of degree 1 (`crate::packet_cells`). The stencil of an active cell is read once for all rays of the tile and turned into powers
//! (`along.rs`); then the polynomials of eight rays are composed together. Most rays end here: the value in the middle outweighs all other
//! coefficients. Else the signs of the Bernstein coefficients tell, as for single rays (`roots.rs`); what has more than one change of sign goes to the solver of
//! isobar-poly, and a ray with any doubt is walked alone. There is no f32 stage: a composition in eight f64 lanes costs a ray less than one in f32
//! lanes across the places of a single ray.
//!
//! **Proofs.** The bound is (12E) M for the position, as in `caster.rs`, plus that of `along.rs`, in its scale. A hit is kept only if signs beyond the bound differ on
//! both sides of the root; else the ray is walked alone.

use super::along::{Powers, ROUNDING, along, bernstein, powers, scale};
use super::basis::{Spline, gradient};
use super::bricks::active_cells;
use super::caster::{Search, Work};
use super::vector::{self, Isa};
use super::{Job, lattice::three};
use crate::bricks::bit;
use crate::packet::{self, BLOCKS, COEFFICIENTS, Packet, Place, RaySet, ones, pixel, with_packet};
use crate::packet_cells::{Cells, Crossing};
use crate::packet_lanes::{self, LANES, Lanes};
use crate::packet_view::Projection;
use crate::walk;
use glam::DVec3;
use isobar_core::{Channels, Claim, Hit};
use isobar_cpu::{Level, PixelSink};
use isobar_poly::{First, RootKind, Tolerance, first_root};
use std::marker::PhantomData;

/// Margins of a ray in those of degree 1: 12E instead of 6E.
const MARGINS: f64 = 2.0;

/// The place of a tile of these degrees.
pub(super) fn place<'a, S: Spline>(search: &Search<'a>, job: &Job<'a, '_>) -> Place<'a> {
    Place {
        space: search.space.of_degree_1(),
        view: job.view,
        tile: job.tile,
        shift: if S::CENTRED { 0.5 } else { 0.0 },
        margins: MARGINS,
        claims: job.claims,
    }
}

/// Draws what packets can; gives the rays that are left, or `None` where packets do not apply.
pub(super) fn draw<S: Spline>(search: &Search<'_>, job: &mut Job<'_, '_>, work: &mut Work) -> Option<RaySet> {
    if !packet::applies(job.tile, job.surfaces, job.out) {
        return None;
    }
    let view = Projection::new(job.view, search.space.of_degree_1())?;
    let place = place::<S>(search, job);
    if place.misses(&view) {
        place.finish_empty(job.out, &place.rays(), None);
        return Some([0; BLOCKS]);
    }
    Some(with_packet(|p| {
        let tile = Tile {
            search,
            place: &place,
            view: &view,
            kind: PhantomData::<S>,
        };
        match search.level {
            #[cfg(target_arch = "x86_64")]
            #[expect(unsafe_code, reason = "functions with target features")]
            // SAFETY: the level of a `Search` is one this machine has.
            Level::Avx512 => unsafe { avx512(&tile, p, job, work) },
            #[cfg(target_arch = "x86_64")]
            #[expect(unsafe_code, reason = "functions with target features")]
            // SAFETY: as above.
            Level::Avx2 => unsafe { avx2(&tile, p, job, work) },
            _ => tile.draw::<packet_lanes::Plain, vector::Portable>(p, job, work),
        }
    }))
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,bmi1,bmi2,lzcnt,popcnt")]
fn avx512<S: Spline>(tile: &Tile<'_, S>, p: &mut Packet, job: &mut Job<'_, '_>, work: &mut Work) -> RaySet {
    tile.draw::<packet_lanes::Avx512, vector::Avx512>(p, job, work)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
fn avx2<S: Spline>(tile: &Tile<'_, S>, p: &mut Packet, job: &mut Job<'_, '_>, work: &mut Work) -> RaySet {
    tile.draw::<packet_lanes::Avx2, vector::Avx2>(p, job, work)
}

/// One tile and what it looks at.
pub(super) struct Tile<'a, S> {
    pub(super) search: &'a Search<'a>,
    pub(super) place: &'a Place<'a>,
    pub(super) view: &'a Projection,
    pub(super) kind: PhantomData<S>,
}

impl<'a, S: Spline> Tile<'a, S> {
    /// The cells for a packet that has been started; `count`: whether those on each ray are to be counted.
    #[inline(always)]
    pub(super) fn cells<I: Isa>(&self, p: &Packet, count: bool) -> SmoothCells<'a, S, I> {
        let bound = &self.search.bounds[0];
        SmoothCells {
            search: self.search,
            isovalue: bound.isovalue,
            bound: scale::<S>() * bound.size * (p.margin + ROUNDING * 0.5 * f64::EPSILON),
            count,
            composed: 0,
            kind: PhantomData,
        }
    }

    #[inline(always)]
    fn draw<L: Lanes, I: Isa>(&self, p: &mut Packet, job: &mut Job<'_, '_>, work: &mut Work) -> RaySet {
        let count = job.out.holds(Channels::WORK);
        let Some(frustum) = p.start::<L>(self.place, count) else {
            return self.place.rays();
        };
        let mut cells = self.cells::<I>(p, count);
        if p.blocks != 0 {
            let mut crossed = walk::Work::default();
            Crossing::new(p, self.place, self.view).cross::<L, _>(&mut cells, p, &frustum, &mut crossed);
            work.nodes += crossed.nodes;
            work.bricks += crossed.bricks;
            work.cells += crossed.cells;
            work.composed += cells.composed;
            self.finish::<L>(p, cells.bound, job);
        }
        self.place
            .finish_empty(job.out, &p.empty(self.place), count.then_some(&p.cells));
        p.single
    }

    /// Writes the pixels that hit something; what cannot be proved is left to single rays.
    #[inline(always)]
    pub(super) fn finish<L: Lanes>(&self, p: &mut Packet, bound: f64, job: &mut Job<'_, '_>) {
        for b in 0..BLOCKS {
            if p.hit[b] == 0 {
                continue;
            }
            let (t, error) = solved::<S, L>(p, b, bound);
            for l in ones(p.hit[b].into()) {
                if !error[l].is_finite() {
                    p.hit[b] &= !(1 << l);
                    p.single[b] |= 1 << l;
                    continue;
                }
                let down = three(|a| i32::from(p.down[a]));
                let cell = three(|a| p.found.near[a][b][l] as i32 - down[a]);
                let at = three(|a| {
                    let near = p.found.near[a][b][l] * p.inv[a][b][l] + p.shift[a][b][l];
                    let x = ((t[l] - near) * p.speed[a][b][l]).clamp(0.0, 1.0);
                    if p.down[a] { 1.0 - x } else { x }
                });
                let d = self.search.lattice.doubles::<S>(cell, self.search.bounds[0].isovalue);
                let g = DVec3::from_array(gradient::<S>(&d, at));
                let normal = self.search.space.world_gradient(g).normalize_or(DVec3::ZERO);
                let (x, y) = pixel(b, l);
                let ray = &p.rays[b * LANES + l];
                let mut sink = PixelSink::new(job.out, job.tile.x + x, job.tile.y + y, ray, job.surfaces.all());
                sink.push(&Hit {
                    t: t[l],
                    point: ray.at(t[l]),
                    normal: normal.as_vec3().to_array(),
                    surface: job.surfaces.surface(0),
                    t_error: if job.claims { error[l] } else { f64::INFINITY },
                });
                let claim = if job.claims {
                    Claim::EXISTS | Claim::FIRST
                } else {
                    Claim::empty()
                };
                sink.finish(claim, p.cells[b][l]);
            }
        }
    }
}

/// The roots of block b: t, and the distance within which signs beyond the bound differ; infinite where they do not.
#[expect(clippy::needless_range_loop, reason = "coefficients by their degree, unrolled")]
#[inline(always)]
pub(super) fn solved<S: Spline, L: Lanes>(p: &Packet, b: usize, bound: f64) -> ([f64; LANES], [f64; LANES]) {
    let n = 3 * S::DEGREE;
    let (zero, one, half, two) = (L::splat(0.0), L::splat(1.0), L::splat(0.5), L::splat(2.0));
    let mut c = [zero; COEFFICIENTS];
    for k in 0..=n {
        c[k] = L::load(&p.found.p[k][b]);
    }
    // The line through both ends.
    let (mut even, mut odd) = (c[0], c[1]);
    for k in 2..=n {
        if k % 2 == 0 {
            even = even.add(c[k]);
        } else {
            odd = odd.add(c[k]);
        }
    }
    let known = L::load(&p.found.root[b]);
    let done = !zero.above(known) & p.hit[b];
    let (least, greatest) = (L::splat(-1.0), one);
    let (mut lo, mut hi) = (least, greatest);
    let mut v = zero.sub(even.div(odd)).max(least).min(greatest);
    v = known.mul(two).sub(one).where_or(done, v);
    let negative = odd.above(even);
    let mut open = p.hit[b] & !done;
    for _ in 0..60 {
        if open == 0 {
            break;
        }
        let (f, slope) = value_and_slope::<S, L>(&c, v);
        let left = !(zero.above(f) ^ negative);
        lo = v.where_or(left, lo);
        hi = v.where_or(!left, hi);
        let newton = v.sub(f.div(slope));
        // The last comparison fails for NaN, which passes the first two.
        let inside = !lo.above(newton) & !newton.above(hi) & newton.above(L::splat(-2.0));
        let next = newton.where_or(inside, half.mul(lo.add(hi)));
        let far = next.sub(v).abs().above(L::splat(1e-13));
        v = next.where_or(open, v);
        open &= far;
    }
    let (t0, t1) = (L::load(&p.found.t0[b]), L::load(&p.found.t1[b]));
    let length = half.mul(t1.sub(t0));
    let t = t0.add(v.add(one).mul(length));
    let (_, slope) = value_and_slope::<S, L>(&c, v);
    let mut error = L::splat(f64::INFINITY);
    let (certain, minus) = (L::splat(bound), L::splat(-bound));
    let mut todo = p.hit[b];
    // Twice the distance at which the tangent leaves the bound; then wider.
    let reach = two.mul(L::load(&p.found.reach[b]));
    let mut width = L::splat(2.0 * bound).div(slope.abs()).max(L::splat(1e-12)).max(reach);
    for _ in 0..4 {
        let (a, z) = (v.sub(width).max(least), v.add(width).min(greatest));
        let (f, _) = value_and_slope::<S, L>(&c, a);
        let (g, _) = value_and_slope::<S, L>(&c, z);
        let up = minus.above(f) & g.above(certain);
        let falls = f.above(certain) & minus.above(g);
        let proved = todo & (up | falls) & L::splat(1e-2).above(width);
        let span = v.sub(a).max(z.sub(v)).mul(length);
        // t itself, and the two ends, are rounded.
        let e = span.add(L::splat(8.0 * f64::EPSILON).mul(t1.abs()));
        error = e.where_or(proved, error);
        todo &= !proved;
        if todo == 0 {
            break;
        }
        width = width.mul(L::splat(16.0));
    }
    let mut out = ([0.0; LANES], [0.0; LANES]);
    t.store(&mut out.0);
    error.store(&mut out.1);
    out
}

/// Value and derivative at v, by Horner's rule.
#[inline(always)]
fn value_and_slope<S: Spline, L: Lanes>(c: &[L; COEFFICIENTS], v: L) -> (L, L) {
    let n = 3 * S::DEGREE;
    let (mut f, mut slope) = (c[n], L::splat(0.0));
    for k in (0..n).rev() {
        slope = f.add(v.mul(slope));
        f = c[k].add(v.mul(f));
    }
    (f, slope)
}

/// The cells of a quadratic or cubic volume, for one tile.
pub(super) struct SmoothCells<'a, S, I> {
    search: &'a Search<'a>,
    isovalue: f64,
    /// What a coefficient may be off by, in the scale of `along.rs`.
    pub(super) bound: f64,
    count: bool,
    composed: u64,
    kind: PhantomData<(S, I)>,
}

impl<S: Spline, I: Isa> Cells for SmoothCells<'_, S, I> {
    #[inline(always)]
    fn size(&self) -> [i32; 3] {
        self.search.space.cells
    }

    #[inline(always)]
    fn node(&self, node: [i32; 3]) -> u64 {
        self.search.active.word(self.search.active.word_of(node))
    }

    #[inline(always)]
    fn brick(&self, brick: [i32; 3]) -> u64 {
        let search = self.search;
        let word = search.active.word_of(three(|a| brick[a] >> 2));
        search.active.cells(word, bit(brick), || {
            active_cells::<S, I>(&search.lattice, search.space.cells, brick, search.bounds)
        })
    }

    #[expect(clippy::needless_range_loop, reason = "coefficients by their degree, unrolled")]
    #[inline(always)]
    fn cell<L: Lanes>(&mut self, p: &mut Packet, blocks: u32, cell: [i32; 3], work: &mut walk::Work) {
        let near = three(|a| f64::from(cell[a] + i32::from(p.down[a])));
        let far = three(|a| f64::from(cell[a] + i32::from(!p.down[a])));
        let side = three(|a| L::splat(if p.down[a] { -1.0 } else { 1.0 }));
        let one = L::splat(1.0);
        let mut c: Option<Powers> = None;
        for b in ones(blocks) {
            let inv = three(|a| L::load(&p.inv[a][b]));
            let shift = three(|a| L::load(&p.shift[a][b]));
            let tn = three(|a| L::splat(near[a]).mul(inv[a]).add(shift[a]));
            let tf = three(|a| L::splat(far[a]).mul(inv[a]).add(shift[a]));
            let t0 = tn[0].max(tn[1]).max(tn[2].max(L::load(&p.begin[b])));
            let t1 = tf[0].min(tf[1]).min(tf[2].min(L::load(&p.end[b])));
            let inside = p.alive[b] & !t0.above(t1);
            if inside == 0 {
                continue;
            }
            let rays = u64::from(inside.count_ones());
            work.cells += rays;
            self.composed += rays;
            if self.count {
                for l in ones(inside.into()) {
                    p.cells[b][l] += 1;
                }
            }
            if c.is_none() {
                c = Some(powers::<S>(&self.search.lattice.doubles::<S>(cell, self.isovalue)));
            }
            let Some(c) = &c else { return };
            let speed = three(|a| L::load(&p.speed[a][b]));
            // From -1 at the near plane to 1 at the far one, measured from the plane nearer to either end; then turned where the axis descends.
            let from = three(|a| {
                let x = t0.sub(tn[a]).mul(speed[a]).min(one);
                x.add(x).sub(one).mul(side[a])
            });
            let to = three(|a| {
                let x = tf[a].sub(t1).mul(speed[a]).min(one);
                one.sub(x.add(x)).mul(side[a])
            });
            let q = along::<S, L>(c, from, to);
            let mut others = q[1].abs();
            for k in 2..=3 * S::DEGREE {
                others = others.add(q[k].abs());
            }
            let maybe = inside & !q[0].abs().above(others.add(L::splat(self.bound)));
            if maybe == 0 {
                continue;
            }
            let (mut hit, alone) = self.signs::<L>(p, b, maybe, &bernstein::<S, L>(&q));
            hit &= !alone;
            if hit | alone == 0 {
                continue;
            }
            for k in 0..=3 * S::DEGREE {
                q[k].store_where(hit, &mut p.found.p[k][b]);
            }
            t0.store_where(hit, &mut p.found.t0[b]);
            t1.store_where(hit, &mut p.found.t1[b]);
            for (&near, to) in near.iter().zip(&mut p.found.near) {
                L::splat(near).store_where(hit, &mut to[b]);
            }
            p.hit[b] |= hit;
            p.single[b] |= alone;
            p.alive[b] &= !(hit | alone);
            if p.alive[b] == 0 {
                p.blocks &= !(1 << b);
            }
        }
    }
}

impl<S: Spline, I: Isa> SmoothCells<'_, S, I> {
    /// Lanes of `maybe` with a root for certain and none before it, and those that have to be walked alone.
    #[expect(clippy::needless_range_loop, reason = "coefficients by their degree, unrolled")]
    #[inline(always)]
    fn signs<L: Lanes>(&self, p: &mut Packet, b: usize, maybe: u8, q: &[L; COEFFICIENTS]) -> (u8, u8) {
        let n = 3 * S::DEGREE;
        let (bound, minus) = (L::splat(self.bound), L::splat(-self.bound));
        let mut last = minus.above(q[0]);
        let mut certain = last | q[0].above(bound);
        let (mut once, mut twice) = (0, 0);
        for k in 1..=n {
            let below = minus.above(q[k]);
            certain &= below | q[k].above(bound);
            let change = below ^ last;
            twice |= once & change;
            once |= change;
            last = below;
        }
        let hit = maybe & certain & once & !twice;
        L::splat(-1.0).store_where(hit, &mut p.found.root[b]);
        L::splat(0.0).store_where(hit, &mut p.found.reach[b]);
        let rest = maybe & !hit & !(certain & !once);
        if rest == 0 {
            return (hit, 0);
        }
        let mut lanes = [[0.0; LANES]; COEFFICIENTS];
        for k in 0..=n {
            q[k].store(&mut lanes[k]);
        }
        let (more, alone) = self.rest(p, b, rest, &lanes);
        (hit | more, alone)
    }

    /// The lanes of `rest`, one by one, by isobar-poly.
    #[cold]
    #[inline(never)]
    fn rest(&self, p: &mut Packet, b: usize, rest: u8, q: &[[f64; LANES]; COEFFICIENTS]) -> (u8, u8) {
        /// Brackets in [0, 1] are at most this wide, where signs are certain that close.
        const WIDTH: f64 = 1e-9;
        let n = 3 * S::DEGREE;
        let tolerance = Tolerance {
            error: self.bound,
            ..Tolerance::new(WIDTH)
        };
        let (mut hit, mut alone) = (0, 0);
        for l in ones(rest.into()) {
            let mut one = [0.0; COEFFICIENTS];
            for k in 0..=n {
                one[k] = q[k][l];
            }
            match first_root(&one[..=n], &tolerance) {
                First::None => {}
                First::Root(r) if r.kind == RootKind::Crossing && r.lo > 0.0 && r.hi < 1.0 => {
                    p.found.root[b][l] = r.t;
                    p.found.reach[b][l] = (r.t - r.lo).max(r.hi - r.t);
                    hit |= 1 << l;
                }
                _ => alone |= 1 << l,
            }
        }
        (hit, alone)
    }
}
