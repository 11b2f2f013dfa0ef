//! The hits of a packet: roots, proofs and normals, eight rays at a time.

use super::lanes::{LANES, Lanes};
use super::pieces::{Lines, coefficients, gradients, two_steps};
use super::{BLOCKS, Job, Packet, ones, pixel};
use crate::ray::three;
use glam::DVec3;
use isobar_core::{Claim, Hit};
use isobar_cpu::PixelSink;

impl Job<'_, '_> {
    /// Writes the pixels that hit something; what cannot be proved is left to single rays.
    #[inline(always)]
    pub(super) fn finish<S: Lanes>(&mut self, p: &mut Packet, bound: f64) {
        for b in 0..BLOCKS {
            if p.hit[b] == 0 {
                continue;
            }
            let (t, error) = solved::<S>(p, b, bound);
            let doubtful = p.hit[b] & !S::splat(f64::INFINITY).above(error);
            p.hit[b] &= !doubtful;
            p.single[b] |= doubtful;
            let gradient = self.gradients(p, b, t);
            let mut lanes = [[0.0; LANES]; 2];
            t.store(&mut lanes[0]);
            error.store(&mut lanes[1]);
            for l in ones(p.hit[b].into()) {
                let (t, error) = (lanes[0][l], lanes[1][l]);
                let normal = self.space.world_gradient(three(|a| gradient[a][l])).normalize_or(DVec3::ZERO);
                let (x, y) = pixel(b, l);
                let ray = &p.rays[b * LANES + l];
                let mut sink = PixelSink::new(self.out, self.tile.x + x, self.tile.y + y, ray, self.surfaces.all());
                sink.push(&Hit {
                    t,
                    point: ray.at(t),
                    normal: normal.as_vec3().to_array(),
                    surface: self.surfaces.surface(0),
                    t_error: if self.claims { error } else { f64::INFINITY },
                });
                let claim = if self.claims {
                    Claim::EXISTS | Claim::FIRST
                } else {
                    Claim::empty()
                };
                sink.finish(claim, 0);
            }
        }
    }

    /// Gradients in index space at parameter t of the rays of block b.
    #[inline(always)]
    fn gradients<S: Lanes>(&self, p: &Packet, b: usize, t: S) -> [[f64; LANES]; 3] {
        let mut data = [0.0; 32 * LANES];
        let mut centres = [0.0; 32];
        let mut kinds = [0; LANES];
        for l in ones(p.hit[b].into()) {
            let ray = b * LANES + l;
            let cube = p.found.cube[ray];
            data[32 * l..32 * (l + 1)].copy_from_slice(&self.field.data(cube));
            for a in 0..3 {
                centres[a * LANES + l] = f64::from(cube[a]);
            }
            kinds[l] = p.found.kind[ray];
        }
        let kind = S::index(u64::from_le_bytes(kinds));
        let coefficients = coefficients(&data, S::index(0xe0c0_a080_6040_2000), kind);
        let lanes = 0x0706_0504_0302_0100;
        let rays = S::index(lanes + (b * LANES) as u64 * 0x0101_0101_0101_0101);
        let at = Lines::new(p, rays, &centres, S::index(lanes), kind).at(t);
        gradients(two_steps(&coefficients, at), &kinds)
    }
}

/// Power coefficients of a cubic in Bernstein form.
#[inline(always)]
fn powers<S: Lanes>(q: &[S; 4]) -> [S; 4] {
    let three = S::splat(3.0);
    [
        q[0],
        three.mul(q[1].sub(q[0])),
        three.mul(q[2].sub(q[1]).sub(q[1].sub(q[0]))),
        q[3].sub(q[0]).sub(three.mul(q[2].sub(q[1]))),
    ]
}

#[inline(always)]
fn value<S: Lanes>(c: &[S; 4], x: S) -> S {
    c[0].add(x.mul(c[1].add(x.mul(c[2].add(x.mul(c[3]))))))
}

#[inline(always)]
fn slope<S: Lanes>(c: &[S; 4], x: S) -> S {
    c[1].add(x.mul(c[2].add(c[2]).add(x.mul(S::splat(3.0).mul(c[3])))))
}

#[inline(always)]
fn mix<S: Lanes>(p: S, q: S, x: S, y: S) -> S {
    y.mul(p).add(x.mul(q))
}

/// The value by de Casteljau's rule, for proofs.
#[inline(always)]
fn bernstein<S: Lanes>(q: &[S; 4], x: S) -> S {
    let y = S::splat(1.0).sub(x);
    let (a, b, c) = (mix(q[0], q[1], x, y), mix(q[1], q[2], x, y), mix(q[2], q[3], x, y));
    mix(mix(a, b, x, y), mix(b, c, x, y), x, y)
}

/// The roots of block b: t, and the distance within which signs beyond the bound differ; infinite where they do not.
#[inline(always)]
fn solved<S: Lanes>(p: &Packet, b: usize, bound: f64) -> (S, S) {
    let f = &p.found.p;
    let q = [S::load(&f[0][b]), S::load(&f[1][b]), S::load(&f[2][b]), S::load(&f[3][b])];
    let (zero, one, half) = (S::splat(0.0), S::splat(1.0), S::splat(0.5));
    let c = powers(&q);
    let negative = zero.above(q[0]);
    let known = S::load(&p.found.root[b]);
    let reach = S::load(&p.found.reach[b]);
    let near = !zero.above(known);
    // Newton's method inside a shrinking bracket.
    let mut lo = known.sub(reach).max(zero).where_or(near, zero);
    let mut hi = known.add(reach).min(one).where_or(near, one);
    let chord = q[0].div(q[0].sub(q[3])).max(zero).min(one);
    let mut x = known.where_or(near, chord);
    let mut open = p.hit[b];
    for _ in 0..60 {
        if open == 0 {
            break;
        }
        let f = value(&c, x);
        let left = !(zero.above(f) ^ negative);
        lo = x.where_or(left, lo);
        hi = x.where_or(!left, hi);
        let newton = x.sub(f.div(slope(&c, x)));
        // The last comparison fails for NaN, which passes the first two.
        let inside = !lo.above(newton) & !newton.above(hi) & newton.above(S::splat(-1.0));
        let next = newton.where_or(inside, half.mul(lo.add(hi)));
        let far = next.sub(x).abs().above(S::splat(1e-14));
        x = next.where_or(open, x);
        open &= far;
    }
    let (t0, t1) = (S::load(&p.found.t0[b]), S::load(&p.found.t1[b]));
    let length = t1.sub(t0);
    let t = t0.add(x.mul(length));
    let mut error = S::splat(f64::INFINITY);
    // Opposite signs beyond the bound on both sides, at parameters that exist as f64.
    let mut todo = p.hit[b];
    // Twice the distance at which the tangent leaves the bound; then wider.
    let mut width = S::splat(2.0 * bound)
        .div(slope(&c, x).abs())
        .max(S::splat(1e-14))
        .max(reach.add(reach));
    for _ in 0..4 {
        let (a, z) = (x.sub(width).max(zero), x.add(width).min(one));
        let (f, g) = (bernstein(&q, a), bernstein(&q, z));
        let up = S::splat(-bound).above(f) & g.above(S::splat(bound));
        let down = f.above(S::splat(bound)) & S::splat(-bound).above(g);
        let proved = todo & (up | down) & S::splat(1e-3).above(width);
        let span = x.sub(a).max(z.sub(x)).mul(length);
        // t itself, and the two ends, are rounded.
        let e = span.add(S::splat(8.0 * f64::EPSILON).mul(t1.abs()));
        error = e.where_or(proved, error);
        todo &= !proved;
        if todo == 0 {
            break;
        }
        width = width.mul(S::splat(16.0));
    }
    (t, error)
}
