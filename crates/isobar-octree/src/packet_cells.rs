//! The active cells of a trilinear volume for one tile, and the roots in them.

use crate::bricks::{bit, values};
use crate::cell::corner;
use crate::cubic::{self, Event};
use crate::packet::{Drawn, Looked, Packet, Value, reference, values};
use crate::walk::{Search, Space, three};
use isobar_cpu::packet::{Cells, Group, LANES, Lanes, One, Place, Rays, Solved, cubic_roots, ones, only_roots};
use isobar_cpu::scene::Isovalues;

/// One tile of a trilinear volume.
pub(crate) struct LinearTile<'a> {
    pub(crate) search: Search<'a>,
    pub(crate) place: Place<'a, Space>,
    pub(crate) surfaces: &'a Isovalues,
}

impl LinearTile<'_> {
    fn values(&self, p: &Packet) -> Vec<Value> {
        values(self.search.bounds, 1.0, |size| p.rays.margin * size)
    }
}

impl Drawn for LinearTile<'_> {
    type Cells<'c>
        = LinearCells<'c>
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
    fn cells<'c>(&'c self, p: &'c mut Packet, count: bool) -> LinearCells<'c> {
        let dims = self.search.dims;
        let (sy, sz) = (dims[0], dims[0] * dims[1]);
        let far = three(|a| usize::from(p.rays.down[a]));
        let corner = |n: usize| (n & 1 ^ far[0]) + (n >> 1 & 1 ^ far[1]) * sy + (n >> 2 ^ far[2]) * sz;
        LinearCells {
            search: &self.search,
            offsets: [
                corner(0),
                corner(1),
                corner(2),
                corner(3),
                corner(4),
                corner(5),
                corner(6),
                corner(7),
            ],
            isovalue: reference(self.search.bounds).isovalue,
            values: self.values(p),
            count,
            looked: 0,
            p,
        }
    }

    #[inline(always)]
    fn roots<S: Lanes>(&self, p: &Packet) {
        let values = self.values(p);
        for at in (0..p.pending.len()).step_by(LANES) {
            let [t, error] = self.solved::<S>(&p.pending.group(at), &values);
            let mut lanes = [[0.0; LANES]; 2];
            t.store(&mut lanes[0]);
            error.store(&mut lanes[1]);
            std::hint::black_box(lanes);
        }
    }

    #[inline(always)]
    fn solve<S: Lanes>(&self, p: &mut Packet) {
        let values = self.values(p);
        for at in (0..p.pending.len()).step_by(LANES) {
            let group = p.pending.group(at);
            let [t, error] = self.solved::<S>(&group, &values);
            let normals = self.normals(&p.rays, &group, t);
            let mut lanes = [[0.0; LANES]; 2];
            t.store(&mut lanes[0]);
            error.store(&mut lanes[1]);
            for l in ones(group.held.into()) {
                if self.search.claims && !lanes[1][l].is_finite() {
                    // Not proved in lanes: what is known about such a ray is worked out alone.
                    let ray = usize::from(group.ray[l]);
                    p.rays.single[ray / LANES] |= 1 << (ray % LANES);
                    continue;
                }
                let root = Solved {
                    t: lanes[0][l],
                    error: lanes[1][l],
                    normal: [normals[0][l] as f32, normals[1][l] as f32, normals[2][l] as f32],
                    value: group.value[l],
                };
                p.add(group.ray[l], root);
            }
        }
    }
}

impl LinearTile<'_> {
    /// t and error of eight roots, as [`cubic_roots`].
    #[inline(always)]
    fn solved<S: Lanes>(&self, group: &Group<S, { crate::packet::COEFFICIENTS }>, values: &[Value]) -> [S; 2] {
        let p = &group.p;
        let mut bound = [0.0; LANES];
        for (to, &v) in bound.iter_mut().zip(&group.value) {
            *to = values[usize::from(v)].bound;
        }
        let q = [p[0], p[1], p[2], p[3]];
        cubic_roots(&q, group.root, group.ends, S::load(&bound), group.held, self.search.claims)
    }

    /// Unit normals in the world at parameters t, as components; zero where the gradient vanishes.
    #[inline(always)]
    fn normals<S: Lanes, const N: usize>(&self, p: &Rays, group: &Group<S, N>, t: S) -> [[f64; LANES]; 3] {
        let dims = self.search.dims;
        let (sy, sz) = (dims[0], dims[0] * dims[1]);
        let down = three(|a| usize::from(p.down[a]));
        let mut near = [[0.0; LANES]; 3];
        for (to, near) in near.iter_mut().zip(group.near) {
            near.store(to);
        }
        // Samples counted from the near corner, 4z + 2y + x.
        let mut v = [[0.0; LANES]; 8];
        values!(self.search.samples, samples => {
            for l in ones(group.held.into()) {
                let cell = three(|a| near[a][l] as usize - down[a]);
                let base = cell[2] * sz + cell[1] * sy + cell[0];
                let s = &samples[base..base + sz + sy + 2];
                for (n, v) in v.iter_mut().enumerate() {
                    let at = (n & 1 ^ down[0]) + (n >> 1 & 1 ^ down[1]) * sy + (n >> 2 ^ down[2]) * sz;
                    v[l] = s[at].into();
                }
            }
        });
        let rays = S::index(u64::from_le_bytes(group.ray));
        let [x, y, z] = [
            local(p, 0, group.near[0], rays, t),
            local(p, 1, group.near[1], rays, t),
            local(p, 2, group.near[2], rays, t),
        ];
        let d = |i: usize, j: usize| S::load(&v[j]).sub(S::load(&v[i]));
        let mix = |p: S, q: S, x: S| p.along(x, q.sub(p));
        let g = [
            mix(mix(d(0, 1), d(2, 3), y), mix(d(4, 5), d(6, 7), y), z),
            mix(mix(d(0, 2), d(1, 3), x), mix(d(4, 6), d(5, 7), x), z),
            mix(mix(d(0, 4), d(1, 5), x), mix(d(2, 6), d(3, 7), x), y),
        ];
        let g = three(|a| if p.down[a] { S::splat(0.0).sub(g[a]) } else { g[a] });
        let m = self.place.space.to_index;
        let w = three(|a| {
            let term = |i: usize| S::splat(m[a][i]).mul(g[i]);
            if self.place.space.aligned {
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

/// Local coordinates along axis `a` of rays at t, from the near planes. Not a closure: those are not inlined when they are large, and their instructions then become calls.
#[inline(always)]
fn local<S: Lanes>(p: &Rays, a: usize, near: S, rays: S::Index, t: S) -> S {
    let near = near.mul(Rays::of(&p.inv[a], rays)).add(Rays::of(&p.shift[a], rays));
    let local = t.sub(near).mul(Rays::of(&p.speed[a], rays));
    local.max(S::splat(0.0)).min(S::splat(1.0))
}

/// The cells of a trilinear volume, for one tile.
pub(crate) struct LinearCells<'c> {
    search: &'c Search<'c>,
    p: &'c mut Packet,
    /// Sample 4z + 2y + x of a cell counted from its near corner, as an offset from its first sample.
    offsets: [usize; 8],
    isovalue: f64,
    values: Vec<Value>,
    count: bool,
    looked: u64,
}

impl Looked for LinearCells<'_> {
    fn looked(&self) -> u64 {
        self.looked
    }
}

impl Cells for LinearCells<'_> {
    #[inline(always)]
    fn rays(&mut self) -> &mut Rays {
        &mut self.p.rays
    }

    #[inline(always)]
    fn size(&self) -> [i32; 3] {
        three(|a| self.search.dims[a] as i32 - 1)
    }

    #[inline(always)]
    fn node(&self, node: [i32; 3]) -> u64 {
        self.search.active.nodes.words[self.search.active.nodes.word_of(node)]
    }

    #[inline(always)]
    fn brick(&mut self, brick: [i32; 3]) -> u64 {
        let search = self.search;
        let word = search.active.nodes.word_of(three(|a| brick[a] >> 2));
        search
            .active
            .cells(word, bit(brick), brick, search.samples, search.dims, search.bounds)
    }

    #[inline(always)]
    fn cell<S: Lanes>(&mut self, blocks: u32, cell: [i32; 3], _bit: u32) {
        let dims = self.search.dims;
        let sz = dims[0] * dims[1];
        let base = corner(dims, cell);
        let at = &self.offsets;
        let v: [f64; 8] = values!(self.search.samples, s => {
            let s = &s[base..base + sz + dims[0] + 2];
            [
                s[at[0]].into(),
                s[at[1]].into(),
                s[at[2]].into(),
                s[at[3]].into(),
                s[at[4]].into(),
                s[at[5]].into(),
                s[at[6]].into(),
                s[at[7]].into(),
            ]
        });
        let c = self.isovalue;
        let v = [v[0] - c, v[1] - c, v[2] - c, v[3] - c, v[4] - c, v[5] - c, v[6] - c, v[7] - c];
        let p = &mut *self.p;
        let near = three(|a| f64::from(cell[a] + i32::from(p.rays.down[a])));
        let far = three(|a| f64::from(cell[a] + i32::from(!p.rays.down[a])));
        let one = S::splat(1.0);
        for b in ones(blocks) {
            let rays = &p.rays;
            let inv = three(|a| S::load(&rays.inv[a][b]));
            let shift = three(|a| S::load(&rays.shift[a][b]));
            let tn = three(|a| S::splat(near[a]).mul(inv[a]).add(shift[a]));
            let tf = three(|a| S::splat(far[a]).mul(inv[a]).add(shift[a]));
            let t0 = tn[0].max(tn[1]).max(tn[2].max(S::load(&rays.begin[b])));
            let t1 = tf[0].min(tf[1]).min(tf[2].min(S::load(&rays.end[b])));
            let inside = rays.alive[b] & !t0.above(t1);
            if inside == 0 {
                continue;
            }
            self.looked += u64::from(inside.count_ones());
            if self.count {
                for l in ones(inside.into()) {
                    p.cells[b][l] += 1;
                }
            }
            let speed = three(|a| S::load(&p.rays.speed[a][b]));
            let from = three(|a| t0.sub(tn[a]).mul(speed[a]));
            let to = three(|a| one.sub(tf[a].sub(t1).mul(speed[a])));
            let q = composed::<S>(&v, from, to);
            let least = q[0].min(q[1]).min(q[2].min(q[3]));
            let greatest = q[0].max(q[1]).max(q[2].max(q[3]));
            let (mut hit, mut alone) = (0, 0);
            for (v, value) in self.values.iter().zip(0u8..) {
                let maybe = inside & !least.above(S::splat(v.shift + v.bound)) & !S::splat(v.shift - v.bound).above(greatest);
                if maybe == 0 {
                    continue;
                }
                let (bound, minus, d) = (S::splat(v.bound), S::splat(-v.bound), S::splat(v.shift));
                let q = [q[0].sub(d), q[1].sub(d), q[2].sub(d), q[3].sub(d)];
                // Ends clear of zero and one change of sign for certain: exactly one root.
                let single = maybe & only_roots(&q, bound, minus);
                if single != 0 {
                    p.push(single, b, &q, [t0, t1], near, value);
                    hit |= single;
                }
                let rest = maybe & !single;
                if rest != 0 {
                    let mut lanes = [[0.0; LANES]; 6];
                    for (to, q) in lanes.iter_mut().zip([q[0], q[1], q[2], q[3], t0, t1]) {
                        q.store(to);
                    }
                    let (more, doubtful) = several(p, b, rest, &lanes, near, value, v.bound);
                    hit |= more;
                    alone |= doubtful;
                }
            }
            p.advance(b, hit, alone);
        }
    }
}

/// The cubics of the lanes `rest` of block `b` one by one, from left to right: puts their roots aside. Gives the rays that have some, and those in doubt. `lanes`: four
/// coefficients and the two ends.
fn several(p: &mut Packet, b: usize, rest: u8, lanes: &[[f64; LANES]; 6], near: [f64; 3], value: u8, bound: f64) -> (u8, u8) {
    let first = p.wants_first();
    let (mut hit, mut alone) = (0, 0);
    for l in ones(rest.into()) {
        let q = [lanes[0][l], lanes[1][l], lanes[2][l], lanes[3][l]];
        cubic::scan(q, bound, &mut |event| match event {
            // What follows the one root that is wanted means nothing.
            _ if first && (hit | alone) >> l & 1 != 0 => {}
            Event::Clear(_) => {}
            Event::Doubt(..) => alone |= 1 << l,
            Event::Simple(x) => {
                hit |= 1 << l;
                p.push_one(&One {
                    ray: (b * LANES + l) as u8,
                    p: &q,
                    ends: [lanes[4][l], lanes[5][l]],
                    root: [x, 0.0],
                    near,
                    value,
                    kind: 0,
                });
            }
        });
    }
    (hit, alone)
}

/// Bernstein coefficients between the two ends, for samples counted from the near corner; see `walk.rs`.
#[inline(always)]
fn composed<S: Lanes>(v: &[f64; 8], a: [S; 3], b: [S; 3]) -> [S; 4] {
    let edge = |k: usize| {
        let (p, d) = (S::splat(v[2 * k]), S::splat(v[2 * k + 1] - v[2 * k]));
        [p.along(a[0], d), p.along(b[0], d)]
    };
    let x = [edge(0), edge(1), edge(2), edge(3)];
    // [z][y end][x end]
    let face = |k: usize, i: usize| {
        let d = x[k + 1][i].sub(x[k][i]);
        [x[k][i].along(a[1], d), x[k][i].along(b[1], d)]
    };
    let y = [[face(0, 0), face(0, 1)], [face(2, 0), face(2, 1)]];
    let across = |i: usize, j: usize| {
        let d = y[1][i][j].sub(y[0][i][j]);
        [y[0][i][j].along(a[2], d), y[0][i][j].along(b[2], d)]
    };
    let (v00, v10, v01, v11) = (across(0, 0), across(1, 0), across(0, 1), across(1, 1));
    let third = S::splat(1.0 / 3.0);
    [
        v00[0],
        v10[0].add(v01[0]).add(v00[1]).mul(third),
        v11[0].add(v10[1]).add(v01[1]).mul(third),
        v11[1],
    ]
}
