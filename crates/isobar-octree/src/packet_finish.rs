//! The hits of a packet: roots, proofs and normals, eight rays at a time.

use crate::bricks::Sample;
use crate::packet::{BLOCKS, Packet, ones, pixel};
use crate::packet_lanes::{LANES, Lanes};
use crate::trilinear::DrawTile;
use crate::walk::three;
use isobar_core::{Claim, Hit};
use isobar_cpu::PixelSink;

/// What a block of rays hits.
struct Block<S> {
    t: S,
    /// Half the width of the bracket of the root, in t; +inf where none is proved.
    error: S,
}

impl<T: Sample> DrawTile<'_, '_, T> {
    /// Writes the pixels that hit something.
    #[inline(always)]
    pub(crate) fn finish<S: Lanes>(&mut self, p: &Packet) {
        let bound = p.margin * self.search.bounds[0].size;
        for b in 0..BLOCKS {
            if p.hit[b] == 0 {
                continue;
            }
            let q = [0, 1, 2, 3].map(|i| S::load(&p.found.p[i][b]));
            let block = solved(&q, p, b, bound, self.search.claims);
            let normals = self.normals(p, b, block.t);
            let (mut t, mut error) = ([0.0; LANES], [0.0; LANES]);
            block.t.store(&mut t);
            block.error.store(&mut error);
            for l in ones(p.hit[b].into()) {
                let (x, y) = pixel(b, l);
                let ray = &p.rays[b * LANES + l];
                let mut sink = PixelSink::new(self.out, self.tile.x + x, self.tile.y + y, ray, self.surfaces.all());
                sink.push(&Hit {
                    t: t[l],
                    point: ray.at(t[l]),
                    normal: [normals[0][l] as f32, normals[1][l] as f32, normals[2][l] as f32],
                    surface: self.surfaces.surface(0),
                    t_error: error[l],
                });
                let claim = if error[l] < f64::INFINITY {
                    Claim::EXISTS | Claim::FIRST
                } else {
                    Claim::empty()
                };
                sink.finish(claim, p.cells[b][l]);
            }
        }
    }

    /// Solves as [`DrawTile::finish`] does, and keeps nothing: for the clocks of `stages.rs`.
    #[inline(always)]
    pub(crate) fn roots<S: Lanes>(&self, p: &Packet) {
        let bound = p.margin * self.search.bounds[0].size;
        for b in (0..BLOCKS).filter(|&b| p.hit[b] != 0) {
            let q = [
                S::load(&p.found.p[0][b]),
                S::load(&p.found.p[1][b]),
                S::load(&p.found.p[2][b]),
                S::load(&p.found.p[3][b]),
            ];
            let block = solved(&q, p, b, bound, self.search.claims);
            let (mut t, mut error) = ([0.0; LANES], [0.0; LANES]);
            block.t.store(&mut t);
            block.error.store(&mut error);
            std::hint::black_box((t, error));
        }
    }

    /// Unit normals in the world at parameter t of the rays of block b, as components; zero where the gradient vanishes.
    #[inline(always)]
    fn normals<S: Lanes>(&self, p: &Packet, b: usize, t: S) -> [[f64; LANES]; 3] {
        let dims = self.search.dims;
        let (sy, sz) = (dims[0], dims[0] * dims[1]);
        let down = three(|a| usize::from(p.down[a]));
        // Samples counted from the near corner, 4z + 2y + x.
        let mut v = [[0.0; LANES]; 8];
        for l in ones(p.hit[b].into()) {
            let cell = three(|a| p.found.near[a][b][l] as usize - down[a]);
            let base = cell[2] * sz + cell[1] * sy + cell[0];
            let s = &self.search.samples[base..base + sz + sy + 2];
            for (n, v) in v.iter_mut().enumerate() {
                let at = (n & 1 ^ down[0]) + (n >> 1 & 1 ^ down[1]) * sy + (n >> 2 ^ down[2]) * sz;
                v[l] = s[at].into();
            }
        }
        let [x, y, z] = three(|a| {
            let near = S::load(&p.found.near[a][b])
                .mul(S::load(&p.inv[a][b]))
                .add(S::load(&p.shift[a][b]));
            let local = t.sub(near).mul(S::load(&p.speed[a][b]));
            local.max(S::splat(0.0)).min(S::splat(1.0))
        });
        let d = |i: usize, j: usize| S::load(&v[j]).sub(S::load(&v[i]));
        let mix = |p: S, q: S, x: S| p.along(x, q.sub(p));
        let g = [
            mix(mix(d(0, 1), d(2, 3), y), mix(d(4, 5), d(6, 7), y), z),
            mix(mix(d(0, 2), d(1, 3), x), mix(d(4, 6), d(5, 7), x), z),
            mix(mix(d(0, 4), d(1, 5), x), mix(d(2, 6), d(3, 7), x), y),
        ];
        let g = three(|a| if p.down[a] { S::splat(0.0).sub(g[a]) } else { g[a] });
        let m = self.space.to_index;
        let w = three(|a| {
            let term = |i: usize| S::splat(m[a][i]).mul(g[i]);
            if self.space.aligned {
                term(a)
            } else {
                term(0).add(term(1)).add(term(2))
            }
        });
        let square = w[0].mul(w[0]).add(w[1].mul(w[1])).add(w[2].mul(w[2]));
        let scale = S::splat(1.0).div(square.sqrt());
        // As `normalize_or`: zero where the length has no finite reciprocal.
        let ok = S::splat(f64::INFINITY).above(scale) & scale.above(S::splat(0.0));
        let scale = scale.where_or(ok, S::splat(0.0));
        let mut out = [[0.0; LANES]; 3];
        for (o, w) in out.iter_mut().zip(w) {
            w.mul(scale).store(o);
        }
        out
    }
}

/// The roots of block b.
#[inline(always)]
fn solved<S: Lanes>(q: &[S; 4], p: &Packet, b: usize, bound: f64, claims: bool) -> Block<S> {
    let (zero, one, half) = (S::splat(0.0), S::splat(1.0), S::splat(0.5));
    let three = S::splat(3.0);
    let c1 = three.mul(q[1].sub(q[0]));
    let c2 = three.mul(q[2].sub(q[1]).sub(q[1].sub(q[0])));
    let c3 = q[3].sub(q[0]).sub(three.mul(q[2].sub(q[1])));
    let slope = |x: S| c1.add(x.mul(c2.add(c2).add(x.mul(three.mul(c3)))));
    let value = |x: S| q[0].add(x.mul(c1.add(x.mul(c2.add(x.mul(c3))))));
    let negative = zero.above(q[0]);
    let known = S::load(&p.found.root[b]);
    let done_before = !zero.above(known) & p.hit[b];
    // Newton's method inside a shrinking bracket, as in `cubic.rs`.
    let (mut lo, mut hi) = (zero, one);
    let mut x = q[0].div(q[0].sub(q[3])).max(zero).min(one);
    x = known.where_or(done_before, x);
    let mut open = p.hit[b] & !done_before;
    for _ in 0..60 {
        if open == 0 {
            break;
        }
        let f = value(x);
        let left = !(zero.above(f) ^ negative);
        lo = x.where_or(left, lo);
        hi = x.where_or(!left, hi);
        let newton = x.sub(f.div(slope(x)));
        // The last comparison fails for NaN, which passes the first two.
        let inside = !lo.above(newton) & !newton.above(hi) & newton.above(S::splat(-1.0));
        let next = newton.where_or(inside, half.mul(lo.add(hi)));
        let far = next.sub(x).abs().above(S::splat(1e-15));
        x = next.where_or(open, x);
        open &= far;
    }
    let (t0, t1) = (S::load(&p.found.t0[b]), S::load(&p.found.t1[b]));
    let length = t1.sub(t0);
    let t = t0.add(x.mul(length));
    let mut error = S::splat(f64::INFINITY);
    if claims {
        // Opposite signs beyond the bound on both sides, at parameters that exist as f64.
        let bernstein = |x: S| {
            let y = one.sub(x);
            let m = |p: S, q: S| y.mul(p).add(x.mul(q));
            let (p, q, r) = (m(q[0], q[1]), m(q[1], q[2]), m(q[2], q[3]));
            m(m(p, q), m(q, r))
        };
        let mut todo = p.hit[b];
        // Twice the distance at which the tangent leaves the bound; then wider.
        let mut width = S::splat(2.0 * bound).div(slope(x).abs()).max(S::splat(1e-14));
        for _ in 0..4 {
            let (a, c) = (x.sub(width).max(zero), x.add(width).min(one));
            let (f, g) = (bernstein(a), bernstein(c));
            let up = S::splat(-bound).above(f) & g.above(S::splat(bound));
            let down = f.above(S::splat(bound)) & S::splat(-bound).above(g);
            let proved = todo & (up | down) & S::splat(1e-3).above(width);
            let span = x.sub(a).max(c.sub(x)).mul(length);
            // t itself, and the two ends, are rounded.
            let e = span.add(S::splat(8.0 * f64::EPSILON).mul(t1.abs()));
            error = e.where_or(proved, error);
            todo &= !proved;
            if todo == 0 {
                break;
            }
            width = width.mul(S::splat(16.0));
        }
    }
    Block { t, error }
}
