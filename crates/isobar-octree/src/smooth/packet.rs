//! Packets of rays for degrees 2 and 3: the tiles of `crate::packet`, eight f64 lanes across the rays of a block.
//!
//! The stencil of an active cell is read once for all rays of the tile and turned into powers
//! (`along.rs`); then the polynomials of eight rays are composed together. Most rays end here: the value in the middle outweighs all other
//! coefficients. Else the signs of the Bernstein coefficients tell, as for single rays (`roots.rs`); what has more than one change of sign goes to the solver of
//! isobar-poly, and a ray with any doubt is walked alone. There is no f32 stage: a composition in eight f64 lanes costs a ray less than one in f32
//! lanes across the places of a single ray.
//!
//! **Proofs.** The bound is (12E) M for the position, as in `caster.rs`, plus that of `along.rs`, in its scale. A root is kept only if signs beyond the bound differ on
//! both sides of it; else the ray is walked alone.

use super::Job;
use super::along::{Powers, ROUNDING, along, bernstein, powers, scale};
use super::basis::{Spline, gradient};
use super::caster::{Search, Work};
use super::lattice::three;
use crate::bricks::bit;
use crate::packet::{self, COEFFICIENTS, Done, Drawn, Looked, Packet, Value, applies, reference, values};
use crate::trilinear::MARGIN;
use crate::walk::Space;
use glam::DVec3;
use isobar_cpu::packet::{Cells, Group, LANES, Lanes, One, Place, Projection, RaySet, Rays, Solved, ones};
use isobar_cpu::scene::Isovalues;
use isobar_poly::{First, Root, RootKind, Tolerance, all_roots, first_root};
use std::marker::PhantomData;

/// Margins of a ray in those of degree 1: 12E instead of 6E.
const MARGINS: f64 = 2.0;

/// Draws what packets can; gives the rays that are left, or `None` where packets do not apply.
pub(super) fn draw<S: Spline>(search: &Search<'_>, job: &mut Job<'_, '_>, work: &mut Work) -> Option<RaySet> {
    let (tile, view) = Tile::<S>::new(search, job)?;
    let Done { left, crossed, cells } = packet::draw(search.level, &tile, &view, job.out);
    work.nodes += crossed.nodes;
    work.bricks += crossed.bricks;
    work.cells += cells;
    work.composed += cells;
    Some(left)
}

/// One tile and what it looks at.
pub(super) struct Tile<'a, S> {
    search: &'a Search<'a>,
    place: Place<'a, Space>,
    surfaces: &'a Isovalues,
    kind: PhantomData<S>,
}

impl<'a, S: Spline> Tile<'a, S> {
    /// The tile and how its volume is seen; `None` where packets do not apply.
    pub(super) fn new(search: &'a Search<'a>, job: &Job<'a, '_>) -> Option<(Self, Projection)> {
        if !applies(job.tile, job.surfaces) {
            return None;
        }
        let space = search.space.of_degree_1();
        let view = Projection::new(job.view, &space.domain)?;
        let tile = Self {
            search,
            place: packet::place(space, job.view, job.tile, if S::CENTRED { 0.5 } else { 0.0 }, MARGINS),
            surfaces: job.surfaces,
            kind: PhantomData,
        };
        Some((tile, view))
    }

    fn values(&self, p: &Packet) -> Vec<Value> {
        let relative = scale::<S>() * (p.rays.margin + ROUNDING * 0.5 * f64::EPSILON);
        values(self.search.bounds, scale::<S>(), |size| relative * size)
    }

    /// As [`Self::values`], with bounds that hold for any ray, and for sums of all powers.
    fn limits(&self) -> Vec<Value> {
        let relative = scale::<S>() * (MARGIN + 2.0 * ROUNDING * 0.5 * f64::EPSILON);
        values(self.search.bounds, scale::<S>(), |size| relative * size)
    }
}

/// Whether the value in the middle of a cell outweighs all other powers, for every isovalue: nothing meets the cell.
#[inline(always)]
fn beyond<L: Lanes>(c: &Powers, limits: &[Value]) -> bool {
    let mut sum = L::splat(0.0);
    for plane in c {
        for half in plane.as_chunks::<LANES>().0 {
            sum = sum.add(L::load(half).abs());
        }
    }
    let mut all = [0.0; LANES];
    sum.store(&mut all);
    let middle = c[0][0];
    let others = all.iter().sum::<f64>() - middle.abs();
    limits.iter().all(|v| (middle - v.shift).abs() > others + v.bound)
}

impl<S: Spline> Drawn for Tile<'_, S> {
    type Cells<'c>
        = SmoothCells<'c, S>
    where
        Self: 'c;

    #[inline(always)]
    fn place(&self) -> &Place<'_, Space> {
        &self.place
    }

    fn surfaces(&self) -> &Isovalues {
        self.surfaces
    }

    fn claims(&self) -> bool {
        self.search.claims
    }

    #[inline(always)]
    fn cells<'c>(&'c self, p: &'c mut Packet, count: bool) -> SmoothCells<'c, S> {
        SmoothCells {
            search: self.search,
            isovalue: reference(self.search.bounds).isovalue,
            values: self.values(p),
            limits: self.limits(),
            brick: (0, 0),
            count,
            looked: 0,
            p,
            kind: PhantomData,
        }
    }

    #[inline(always)]
    fn roots<L: Lanes>(&self, p: &Packet) {
        let values = self.values(p);
        for at in (0..p.pending.len()).step_by(LANES) {
            std::hint::black_box(solved::<S, L>(&p.pending.group(at), &values));
        }
    }

    #[inline(always)]
    fn solve<L: Lanes>(&self, p: &mut Packet) {
        let values = self.values(p);
        let down = three(|a| i32::from(p.rays.down[a]));
        for at in (0..p.pending.len()).step_by(LANES) {
            let group = p.pending.group(at);
            let (t, error) = solved::<S, L>(&group, &values);
            let mut near = [[0.0; LANES]; 3];
            for (to, near) in near.iter_mut().zip(group.near) {
                near.store(to);
            }
            for l in ones(group.held.into()) {
                let (b, lane) = (usize::from(group.ray[l]) / LANES, usize::from(group.ray[l]) % LANES);
                let rays = &mut p.rays;
                if !error[l].is_finite() {
                    rays.single[b] |= 1 << lane;
                }
                if rays.single[b] >> lane & 1 != 0 {
                    continue;
                }
                let cell = three(|a| near[a][l] as i32 - down[a]);
                let at = three(|a| {
                    let near = near[a][l] * rays.inv[a][b][lane] + rays.shift[a][b][lane];
                    let x = ((t[l] - near) * rays.speed[a][b][lane]).clamp(0.0, 1.0);
                    if rays.down[a] { 1.0 - x } else { x }
                });
                let isovalue = self.search.bounds[usize::from(group.value[l])].isovalue;
                let d = self.search.lattice.doubles::<S>(cell, isovalue);
                let g = DVec3::from_array(gradient::<S>(&d, at));
                let normal = self.search.space.world_gradient(g).normalize_or(DVec3::ZERO);
                let root = Solved {
                    t: t[l],
                    error: error[l],
                    normal: normal.as_vec3().to_array(),
                    value: group.value[l],
                };
                p.add(group.ray[l], root);
            }
        }
    }
}

/// t of eight roots, and the distances within which signs beyond the bound differ; infinite where they do not.
#[expect(clippy::needless_range_loop, reason = "coefficients by their degree, unrolled")]
#[inline(always)]
fn solved<S: Spline, L: Lanes>(group: &Group<L, COEFFICIENTS>, values: &[Value]) -> ([f64; LANES], [f64; LANES]) {
    let n = 3 * S::DEGREE;
    let c = &group.p;
    let mut bound = [0.0; LANES];
    for (to, &v) in bound.iter_mut().zip(&group.value) {
        *to = values[usize::from(v)].bound;
    }
    let certain = L::load(&bound);
    let (zero, one, half, two) = (L::splat(0.0), L::splat(1.0), L::splat(0.5), L::splat(2.0));
    // The line through both ends.
    let (mut even, mut odd) = (c[0], c[1]);
    for k in 2..=n {
        if k % 2 == 0 {
            even = even.add(c[k]);
        } else {
            odd = odd.add(c[k]);
        }
    }
    let [known, reach] = group.root;
    let done = !zero.above(known) & group.held;
    let (least, greatest) = (L::splat(-1.0), one);
    let (mut lo, mut hi) = (least, greatest);
    let mut v = zero.sub(even.div(odd)).max(least).min(greatest);
    v = known.mul(two).sub(one).where_or(done, v);
    let negative = odd.above(even);
    let mut open = group.held & !done;
    for _ in 0..60 {
        if open == 0 {
            break;
        }
        let (f, slope) = value_and_slope::<S, L>(c, v);
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
    let [t0, t1] = group.ends;
    let length = half.mul(t1.sub(t0));
    let t = t0.add(v.add(one).mul(length));
    let (_, slope) = value_and_slope::<S, L>(c, v);
    let mut error = L::splat(f64::INFINITY);
    let minus = zero.sub(certain);
    let mut todo = group.held;
    // Twice the distance at which the tangent leaves the bound; then wider.
    let reach = two.mul(reach);
    let mut width = two.mul(certain).div(slope.abs()).max(L::splat(1e-12)).max(reach);
    for _ in 0..4 {
        let (a, z) = (v.sub(width).max(least), v.add(width).min(greatest));
        let (f, _) = value_and_slope::<S, L>(c, a);
        let (g, _) = value_and_slope::<S, L>(c, z);
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
pub(super) struct SmoothCells<'c, S> {
    search: &'c Search<'c>,
    p: &'c mut Packet,
    isovalue: f64,
    values: Vec<Value>,
    /// The same with bounds that hold for any ray.
    limits: Vec<Value>,
    /// The brick in hand, word and bit.
    brick: (usize, u32),
    count: bool,
    looked: u64,
    kind: PhantomData<S>,
}

impl<S: Spline> Looked for SmoothCells<'_, S> {
    fn looked(&self) -> u64 {
        self.looked
    }
}

impl<S: Spline> Cells for SmoothCells<'_, S> {
    #[inline(always)]
    fn rays(&mut self) -> &mut Rays {
        &mut self.p.rays
    }

    #[inline(always)]
    fn size(&self) -> [i32; 3] {
        self.search.space.cells
    }

    #[inline(always)]
    fn node(&self, node: [i32; 3]) -> u64 {
        self.search.active.word(self.search.active.word_of(node))
    }

    #[inline(always)]
    fn brick(&mut self, brick: [i32; 3]) -> u64 {
        let active = self.search.active;
        let word = active.word_of(three(|a| brick[a] >> 2));
        self.brick = (word, bit(brick));
        active.cells(word, bit(brick), || self.search.active_cells::<S>(brick))
    }

    #[expect(clippy::needless_range_loop, reason = "coefficients by their degree, unrolled")]
    #[inline(always)]
    fn cell<L: Lanes>(&mut self, blocks: u32, cell: [i32; 3], bit: u32) {
        let p = &mut *self.p;
        let near = three(|a| f64::from(cell[a] + i32::from(p.rays.down[a])));
        let far = three(|a| f64::from(cell[a] + i32::from(!p.rays.down[a])));
        let side = three(|a| L::splat(if p.rays.down[a] { -1.0 } else { 1.0 }));
        let one = L::splat(1.0);
        let mut c: Option<Powers> = None;
        for b in ones(blocks) {
            let inv = three(|a| L::load(&p.rays.inv[a][b]));
            let shift = three(|a| L::load(&p.rays.shift[a][b]));
            let tn = three(|a| L::splat(near[a]).mul(inv[a]).add(shift[a]));
            let tf = three(|a| L::splat(far[a]).mul(inv[a]).add(shift[a]));
            let t0 = tn[0].max(tn[1]).max(tn[2].max(L::load(&p.rays.begin[b])));
            let t1 = tf[0].min(tf[1]).min(tf[2].min(L::load(&p.rays.end[b])));
            let inside = p.rays.alive[b] & !t0.above(t1);
            if inside == 0 {
                continue;
            }
            if c.is_none() {
                let made = powers::<S>(&self.search.lattice.doubles::<S>(cell, self.isovalue));
                if self.search.refine && beyond::<L>(&made, &self.limits) {
                    let (word, brick) = self.brick;
                    self.search.active.take_back(word, brick, bit);
                    return;
                }
                c = Some(made);
            }
            self.looked += u64::from(inside.count_ones());
            if self.count {
                for l in ones(inside.into()) {
                    p.cells[b][l] += 1;
                }
            }
            let Some(c) = &c else { return };
            let speed = three(|a| L::load(&p.rays.speed[a][b]));
            // From -1 at the near plane to 1 at the far one, measured from the plane nearer to either end; then turned where the axis descends.
            let from = three(|a| {
                let x = t0.sub(tn[a]).mul(speed[a]).min(one);
                x.add(x).sub(one).mul(side[a])
            });
            let to = three(|a| {
                let x = tf[a].sub(t1).mul(speed[a]).min(one);
                one.sub(x.add(x)).mul(side[a])
            });
            let mut q = along::<S, L>(c, from, to);
            let mut others = q[1].abs();
            for k in 2..=3 * S::DEGREE {
                others = others.add(q[k].abs());
            }
            let middle = q[0];
            let (mut hit, mut alone) = (0, 0);
            for (v, value) in self.values.iter().zip(0u8..) {
                q[0] = middle.sub(L::splat(v.shift));
                let maybe = inside & !q[0].abs().above(others.add(L::splat(v.bound)));
                if maybe == 0 {
                    continue;
                }
                let signed = bernstein::<S, L>(&q);
                let (once, rest) = signs::<S, L>(&signed, v.bound, maybe);
                if once != 0 {
                    p.push(once, b, &q[..=3 * S::DEGREE], [t0, t1], near, value);
                    hit |= once;
                }
                if rest != 0 {
                    let at = At { b, near, value };
                    let (more, doubtful) = several::<S, L>(p, &at, rest, [&q, &signed], [t0, t1], v.bound);
                    hit |= more;
                    alone |= doubtful;
                }
            }
            p.advance(b, hit, alone);
        }
    }
}

/// Of the lanes `maybe`, by the Bernstein coefficients, those with exactly one root, clear of the ends, and those about which more has to be known.
#[expect(clippy::needless_range_loop, reason = "coefficients by their degree, unrolled")]
#[inline(always)]
fn signs<S: Spline, L: Lanes>(q: &[L; COEFFICIENTS], bound: f64, maybe: u8) -> (u8, u8) {
    let (bound, minus) = (L::splat(bound), L::splat(-bound));
    let mut last = minus.above(q[0]);
    let mut certain = last | q[0].above(bound);
    let (mut once, mut twice) = (0, 0);
    for k in 1..=3 * S::DEGREE {
        let below = minus.above(q[k]);
        certain &= below | q[k].above(bound);
        let change = below ^ last;
        twice |= once & change;
        once |= change;
        last = below;
    }
    let hit = maybe & certain & once & !twice;
    (hit, maybe & !hit & !(certain & !once))
}

/// A block in a cell, for an isovalue.
struct At {
    b: usize,
    near: [f64; 3],
    value: u8,
}

/// Stores eight numbers each.
#[inline(always)]
fn stored<L: Lanes, const N: usize>(v: &[L; N]) -> [[f64; LANES]; N] {
    let mut lanes = [[0.0; LANES]; N];
    for (to, v) in lanes.iter_mut().zip(v) {
        v.store(to);
    }
    lanes
}

/// The lanes of `rest`: puts their roots aside. Gives the rays that have some, and those in doubt. `q`: by powers and Bernstein coefficients.
#[inline(always)]
fn several<S: Spline, L: Lanes>(
    p: &mut Packet,
    at: &At,
    rest: u8,
    q: [&[L; COEFFICIENTS]; 2],
    ends: [L; 2],
    bound: f64,
) -> (u8, u8) {
    let lanes = Several {
        powers: stored(q[0]),
        bernstein: stored(q[1]),
        ends: stored(&ends),
        count: 3 * S::DEGREE + 1,
        bound,
    };
    lanes.solve(p, at, rest)
}

/// Polynomials of eight rays.
struct Several {
    powers: [[f64; LANES]; COEFFICIENTS],
    bernstein: [[f64; LANES]; COEFFICIENTS],
    ends: [[f64; LANES]; 2],
    /// Coefficients.
    count: usize,
    bound: f64,
}

impl Several {
    /// One by one, by isobar-poly.
    #[cold]
    #[inline(never)]
    fn solve(&self, p: &mut Packet, at: &At, rest: u8) -> (u8, u8) {
        /// Brackets in [0, 1] are at most this wide, where signs are certain that close.
        const WIDTH: f64 = 1e-9;
        let tolerance = Tolerance {
            error: self.bound,
            ..Tolerance::new(WIDTH)
        };
        let first = p.wants_first();
        let (mut hit, mut alone) = (0, 0);
        for l in ones(rest.into()) {
            let of = |q: &[[f64; LANES]; COEFFICIENTS]| -> [f64; COEFFICIENTS] { std::array::from_fn(|k| q[k][l]) };
            let (powers, bernstein) = (of(&self.powers), of(&self.bernstein));
            let bernstein = &bernstein[..self.count];
            let mut take = |r: &Root<f64>| {
                if r.kind != RootKind::Crossing || r.lo <= 0.0 || r.hi >= 1.0 {
                    alone |= 1 << l;
                    return;
                }
                hit |= 1 << l;
                p.push_one(&One {
                    ray: (at.b * LANES + l) as u8,
                    p: &powers[..self.count],
                    ends: [self.ends[0][l], self.ends[1][l]],
                    root: [r.t, (r.t - r.lo).max(r.hi - r.t)],
                    near: at.near,
                    value: at.value,
                    kind: 0,
                });
            };
            if first {
                match first_root(bernstein, &tolerance) {
                    First::None => {}
                    First::Root(r) => take(&r),
                    First::GaveUp { .. } => alone |= 1 << l,
                }
            } else {
                let roots = all_roots(bernstein, &tolerance);
                for r in roots.as_slice() {
                    take(r);
                }
                if roots.gave_up().is_some() {
                    alone |= 1 << l;
                }
            }
        }
        (hit, alone)
    }
}
