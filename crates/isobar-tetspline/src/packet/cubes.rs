//! The active cubes of a volume for one tile: pieces of rays between sorted planes, and the queue of those in active tetrahedra.

use super::pieces::{Lines, blossom, coefficients};
use super::{Field, Packet, Paths, SHIFT, Value};
use crate::bricks;
use crate::cube::Data;
use crate::ray::{FORMS, three};
use crate::walk::Work;
use isobar_cpu::packet::{BLOCKS, Cells, LANES, Lanes, One, RaySet, Rays, SPREAD, ones, only_roots};
use isobar_poly::{First, Root, RootKind, Tolerance, all_roots, first_root};

/// Pieces a block can add, seven for each ray, and those left from before; a vector is written at a time.
const ROOM: usize = 9 * LANES;

/// Pieces in active tetrahedra of one cube that have not been looked at.
struct Queue {
    t0: [f64; ROOM],
    t1: [f64; ROOM],
    ray: [u8; ROOM],
    kind: [u8; ROOM],
    count: usize,
}

/// Eight entries from `at` on; zeros beyond the end.
#[inline(always)]
fn eight<T: Copy + Default>(all: &[T; ROOM], at: usize) -> [T; LANES] {
    all[at..].first_chunk().copied().unwrap_or_default()
}

impl Queue {
    /// Adds the lanes of a mask.
    #[inline(always)]
    fn add<S: Lanes>(&mut self, m: u8, t0: S, t1: S, rays: u64, kinds: u64) {
        let n = self.count;
        let put = |all: &mut [f64; ROOM], v: S| {
            if let Some(to) = all[n..].first_chunk_mut() {
                v.pack(m).store(to);
            }
        };
        put(&mut self.t0, t0);
        put(&mut self.t1, t1);
        let put = |all: &mut [u8; ROOM], v: u64| {
            if let Some(to) = all[n..].first_chunk_mut() {
                *to = S::pack_bytes(v, m).to_le_bytes();
            }
        };
        put(&mut self.ray, rays);
        put(&mut self.kind, kinds);
        self.count += m.count_ones() as usize;
    }

    /// Drops the first `n`, whole eights, of which less than eight remain.
    #[inline(always)]
    fn drop_first(&mut self, n: usize) {
        if n > 0 {
            let rest = (
                eight(&self.t0, n),
                eight(&self.t1, n),
                eight(&self.ray, n),
                eight(&self.kind, n),
            );
            self.t0[..LANES].copy_from_slice(&rest.0);
            self.t1[..LANES].copy_from_slice(&rest.1);
            self.ray[..LANES].copy_from_slice(&rest.2);
            self.kind[..LANES].copy_from_slice(&rest.3);
            self.count -= n;
        }
    }
}

/// The cubes of a volume, for one tile.
pub(super) struct Cubes<'c> {
    field: &'c dyn Field,
    values: &'c [Value],
    p: &'c mut Packet,
    paths: &'c Paths,
    work: &'c mut Work,
    /// Whether the active cubes on each ray are counted.
    count: bool,
    /// The brick's cubes.
    brick: Option<&'c bricks::Cubes>,
    queue: Queue,
    /// Rays that have roots in this cube, those in doubt about it, and the blocks that have such rays.
    hit: RaySet,
    alone: RaySet,
    met: u32,
}

impl<'c> Cubes<'c> {
    #[inline(always)]
    pub(super) fn new(
        field: &'c dyn Field,
        values: &'c [Value],
        p: &'c mut Packet,
        paths: &'c Paths,
        work: &'c mut Work,
        count: bool,
    ) -> Self {
        Self {
            field,
            values,
            p,
            paths,
            work,
            count,
            brick: None,
            queue: Queue {
                t0: [0.0; ROOM],
                t1: [0.0; ROOM],
                ray: [0; ROOM],
                kind: [0; ROOM],
                count: 0,
            },
            hit: [0; BLOCKS],
            alone: [0; BLOCKS],
            met: 0,
        }
    }
}

impl Cells for Cubes<'_> {
    #[inline(always)]
    fn rays(&mut self) -> &mut Rays {
        &mut self.p.rays
    }

    #[inline(always)]
    fn size(&self) -> [i32; 3] {
        self.field.size()
    }

    #[inline(always)]
    fn node(&self, node: [i32; 3]) -> u64 {
        let nodes = &self.field.active().nodes;
        nodes.words[nodes.word_of(node)]
    }

    #[inline(always)]
    fn brick(&mut self, brick: [i32; 3]) -> u64 {
        let cubes = self.field.brick(brick);
        self.brick = Some(cubes);
        cubes.mask()
    }

    #[inline(always)]
    fn cell<S: Lanes>(&mut self, blocks: u32, cube: [i32; 3], bit: u32) {
        let Some(brick) = self.brick else { return };
        let mut data: Option<Data> = None;
        let kinds = if let Some(kinds) = brick.known(bit) {
            kinds
        } else {
            let kinds = active_kinds::<S>(data.insert(self.field.data(cube)), self.values);
            brick.keep(bit, kinds);
            kinds
        };
        if kinds == 0 {
            return;
        }
        let down = self.p.rays.down;
        let near = three(|a| f64::from(cube[a] + i32::from(down[a])));
        let far = three(|a| f64::from(cube[a] + i32::from(!down[a])));
        let mut left = blocks;
        while left != 0 {
            let b = left.trailing_zeros() as usize;
            left &= left - 1;
            let rays = &self.p.rays;
            let inv = three(|a| S::load(&rays.inv[a][b]));
            let shift = three(|a| S::load(&rays.shift[a][b]));
            let (tn, tf) = (planes(near, inv, shift), planes(far, inv, shift));
            let t0 = tn[0].max(tn[1]).max(tn[2].max(S::load(&rays.begin[b])));
            let t1 = tf[0].min(tf[1]).min(tf[2].min(S::load(&rays.end[b])));
            let inside = rays.alive[b] & t1.above(t0);
            if inside != 0 {
                self.work.cubes += u64::from(inside.count_ones());
                self.work.active += u64::from(inside.count_ones());
                if self.count {
                    ones(inside.into()).for_each(|l| self.p.cells[b][l] += 1);
                }
                self.cut(b, cube, kinds, [t0, t1], inside);
            }
            if self.queue.count >= LANES || (left == 0 && self.queue.count > 0) {
                let data = data.get_or_insert_with(|| self.field.data(cube));
                self.empty::<S>(cube, data, left == 0);
            }
        }
        for b in ones(self.met) {
            self.p.advance(b, self.hit[b], self.alone[b]);
            (self.hit[b], self.alone[b]) = (0, 0);
        }
        self.met = 0;
    }
}

/// The kinds whose coefficients can meet an isovalue, from the 27 data of a cube: eight kinds at a time.
#[inline(always)]
pub(super) fn active_kinds<S: Lanes>(data: &Data, values: &[Value]) -> u32 {
    let mut mask = 0;
    for group in 0..3 {
        let kinds = 0x0706_0504_0302_0100 + group * 8 * LOWEST;
        let b = coefficients::<S, 32>(data, S::index(0), S::index(kinds));
        let (mut least, mut greatest) = (b[0], b[0]);
        for &v in &b[1..] {
            least = least.min(v);
            greatest = greatest.max(v);
        }
        let mut on = 0;
        for v in values {
            on |= !least.above(S::splat(v.shift + v.margin)) & !S::splat(v.shift - v.margin).above(greatest);
        }
        mask |= u32::from(on) << (8 * group);
    }
    mask
}

/// Exchanges that sort six numbers.
const SORT: [(usize, usize); 12] = [
    (0, 5),
    (1, 3),
    (2, 4),
    (1, 2),
    (3, 4),
    (0, 3),
    (2, 5),
    (0, 1),
    (2, 3),
    (4, 5),
    (1, 2),
    (3, 4),
];

/// Parameters of three planes across the axes.
#[inline(always)]
fn planes<S: Lanes>(x: [f64; 3], inv: [S; 3], shift: [S; 3]) -> [S; 3] {
    [
        S::splat(x[0]).mul(inv[0]).add(shift[0]),
        S::splat(x[1]).mul(inv[1]).add(shift[1]),
        S::splat(x[2]).mul(inv[2]).add(shift[2]),
    ]
}

/// Bits 0 of eight bytes.
const LOWEST: u64 = 0x0101_0101_0101_0101;

/// The kinds of the tetrahedra that hold eight points, given in grid steps from the centre of their cube: as `kind_of`, in bytes.
#[inline(always)]
fn kinds_of<S: Lanes>(p: [S; 3]) -> u64 {
    let zero = S::splat(0.0);
    let m = three(|a| p[a].abs());
    let (yx, zx, zy) = (m[1].above(m[0]), m[2].above(m[0]), m[2].above(m[1]));
    let (x, z) = (!yx & !zx, zx & zy);
    let y = !x & !z;
    let up = three(|a| !zero.above(p[a]));
    let first = (x & up[0]) | (y & up[1]) | (z & up[2]);
    // The second axis is the next one but one.
    let swap = (x & zy) | (y & !zx) | (z & yx);
    let next = (x & up[1]) | (y & up[2]) | (z & up[0]);
    let other = (x & up[2]) | (y & up[0]) | (z & up[1]);
    let second = (swap & other) | (!swap & next);
    let bytes = |m: u8, k: u32| (SPREAD[usize::from(m)] & LOWEST) << k;
    bytes(z, 4) | bytes(y, 3) | bytes(first, 2) | bytes(swap, 1) | bytes(second, 0)
}

impl Cubes<'_> {
    /// Puts the pieces of block `b` in active tetrahedra into the queue.
    #[inline(always)]
    fn cut<S: Lanes>(&mut self, b: usize, cube: [i32; 3], kinds: u32, [t0, t1]: [S; 2], inside: u8) {
        let c = cube.map(f64::from);
        // Planes outside make pieces of no length.
        let mut cuts = [t0; 8];
        for (n, &(i, j, sign)) in FORMS.iter().enumerate() {
            let t = S::splat(c[i] + sign * c[j])
                .mul(S::load(&self.paths.form_inv[n][b]))
                .add(S::load(&self.paths.form_shift[n][b]));
            cuts[n + 1] = t.min(t1).max(t0);
        }
        for (i, j) in SORT {
            let (lo, hi) = (cuts[i + 1], cuts[j + 1]);
            (cuts[i + 1], cuts[j + 1]) = (lo.min(hi), lo.max(hi));
        }
        cuts[7] = t1;
        let o = three(|a| Paths::of::<S>(&self.paths.origin, a, b).sub(S::splat(c[a])));
        let d = three(|a| Paths::of::<S>(&self.paths.direction, a, b));
        let rays = 0x0706_0504_0302_0100 + (b * LANES) as u64 * LOWEST;
        for n in 0..7 {
            let (from, to) = (cuts[n], cuts[n + 1]);
            let long = inside & to.above(from);
            if long == 0 {
                continue;
            }
            let middle = S::splat(0.5).mul(from.add(to));
            let at = [
                o[0].add(middle.mul(d[0])),
                o[1].add(middle.mul(d[1])),
                o[2].add(middle.mul(d[2])),
            ];
            let kind = kinds_of(at);
            let active = long & S::are_in(kinds, S::index(kind));
            if active != 0 {
                self.queue.add(active, from, to, rays, kind);
            }
        }
    }

    /// Works out the queue, eight pieces at a time; `all`: the rest too.
    #[inline(always)]
    fn empty<S: Lanes>(&mut self, cube: [i32; 3], data: &Data, all: bool) {
        let count = self.queue.count;
        self.work.tets += count as u64;
        let mut centre = [0.0; 32];
        for a in 0..3 {
            centre[a * LANES] = f64::from(cube[a]);
        }
        let mut at = 0;
        while at + LANES <= count || (all && at < count) {
            let n = (count - at).min(LANES);
            let held = u8::MAX >> (LANES - n);
            let q = &self.queue;
            let (t0, t1) = (S::load(&eight(&q.t0, at)), S::load(&eight(&q.t1, at)));
            let kind = S::index(u64::from_le_bytes(eight(&q.kind, at)));
            let ray = S::index(u64::from_le_bytes(eight(&q.ray, at)));
            let b = coefficients::<S, 32>(data, S::index(0), kind);
            let lines = Lines::new(self.paths, ray, &centre, S::index(0), kind);
            let c = blossom(&b, lines.at(t0), lines.at(t1));
            let least = c[0].min(c[1]).min(c[2].min(c[3]));
            let greatest = c[0].max(c[1]).max(c[2].max(c[3]));
            for (v, value) in self.values.iter().zip(0u8..) {
                let maybe = held & !least.above(S::splat(v.shift + v.bound)) & !S::splat(v.shift - v.bound).above(greatest);
                if maybe == 0 {
                    continue;
                }
                let d = S::splat(v.shift);
                let c = [c[0].sub(d), c[1].sub(d), c[2].sub(d), c[3].sub(d)];
                // Ends clear of zero and one change of sign for certain: exactly one root.
                let one = only_roots(&c, S::splat(v.bound), S::splat(-v.bound));
                let mut lanes = [[0.0; LANES]; 4];
                for (to, c) in lanes.iter_mut().zip(c) {
                    c.store(to);
                }
                for l in ones(maybe.into()) {
                    let piece = Piece {
                        at: at + l,
                        cube,
                        c: [lanes[0][l], lanes[1][l], lanes[2][l], lanes[3][l]],
                        value,
                    };
                    self.take(&piece, one >> l & 1 != 0, v.bound);
                }
            }
            at += LANES;
        }
        if all {
            self.queue.count = 0;
        } else {
            self.work.tets -= (count - at) as u64;
            self.queue.drop_first(at);
        }
    }

    /// The cubic of a piece may have roots, just one if `one`: puts them aside.
    #[inline(always)]
    fn take(&mut self, piece: &Piece, one: bool, bound: f64) {
        self.work.cubics += 1;
        let ray = self.queue.ray[piece.at];
        let (b, bit) = (usize::from(ray) / LANES, 1u8 << (usize::from(ray) % LANES));
        // Pieces of a ray come in order, those of one isovalue: what follows the one root that is wanted means nothing.
        let first = self.p.wants_first();
        if self.alone[b] & bit != 0 || (first && self.values.len() == 1 && self.hit[b] & bit != 0) {
            return;
        }
        let mut put = |root: Option<[f64; 2]>| {
            self.met |= 1 << b;
            let Some(root) = root else {
                self.alone[b] |= bit;
                return;
            };
            self.hit[b] |= bit;
            self.p.push_one(&One {
                ray,
                p: &piece.c,
                ends: [self.queue.t0[piece.at], self.queue.t1[piece.at]],
                root,
                near: piece.cube.map(f64::from),
                value: piece.value,
                kind: self.queue.kind[piece.at],
            });
        };
        if one {
            put(Some([-1.0, 0.0]));
        } else {
            solve(&piece.c, bound, first, &mut put);
        }
    }
}

/// A piece of a ray in a tetrahedron: place in the queue, cubic, number of the isovalue.
struct Piece {
    at: usize,
    cube: [i32; 3],
    c: [f64; 4],
    value: u8,
}

/// Tells `put` the roots of a cubic, the first one or all, and how far their brackets reach; nothing of one in doubt.
#[cold]
#[inline(never)]
fn solve(c: &[f64; 4], bound: f64, first: bool, put: &mut dyn FnMut(Option<[f64; 2]>)) {
    /// Brackets in [0, 1] are at most this wide, where signs are certain that close.
    const WIDTH: f64 = 1e-9;
    let tolerance = Tolerance {
        error: bound,
        ..Tolerance::new(WIDTH)
    };
    let sure = |r: &Root<f64>| {
        let crosses = r.kind == RootKind::Crossing && r.lo > 0.0 && r.hi < 1.0;
        crosses.then(|| [r.t, (r.t - r.lo).max(r.hi - r.t)])
    };
    if first {
        match first_root(c, &tolerance) {
            First::None => {}
            First::Root(r) => put(sure(&r)),
            First::GaveUp { .. } => put(None),
        }
        return;
    }
    let roots = all_roots(c, &tolerance);
    for r in roots.as_slice() {
        put(sure(r));
    }
    if roots.gave_up().is_some() {
        put(None);
    }
}

const _: () = assert!(SHIFT == 0.5, "cubes reach half a step to both sides of their sample");

#[cfg(test)]
mod tests {
    use super::*;
    use isobar_cpu::packet::Plain;
    use isobar_fields::type6::DENOMINATOR;
    use isobar_fields::type6::kind_of;

    /// By the principle of zeros and ones.
    #[test]
    fn six_numbers_are_sorted() {
        for n in 0..64u32 {
            let mut v: [u32; 6] = std::array::from_fn(|i| n >> i & 1);
            for (i, j) in SORT {
                (v[i], v[j]) = (v[i].min(v[j]), v[i].max(v[j]));
            }
            assert!(v.is_sorted(), "{n}");
        }
    }

    #[test]
    fn active_kinds_are_those_of_their_coefficients() {
        let mut s = 9u64;
        let mut next = || {
            s = s
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (s >> 11) as f64 / (1u64 << 53) as f64 - 0.3
        };
        let mut some = 0;
        for _ in 0..500 {
            let mut data: Data = [0.0; 32];
            data[..27].fill_with(&mut next);
            let of: &[f64; 27] = data.first_chunk().unwrap();
            let want = crate::classify::active_kinds(of, 1e-6);
            let mut values = vec![Value {
                shift: 0.0,
                bound: 0.0,
                margin: f64::from(DENOMINATOR) * 1e-6,
            }];
            assert_eq!(active_kinds::<Plain>(&data, &values), want);
            // Another isovalue.
            let other = crate::classify::active_kinds(&of.map(|v| v - 0.2), 1e-6);
            values.push(Value {
                shift: f64::from(DENOMINATOR) * 0.2,
                ..values[0]
            });
            assert_eq!(active_kinds::<Plain>(&data, &values), want | other);
            some += u32::from(want != 0 && want != (1 << 24) - 1);
        }
        assert!(some > 100, "{some}");
    }

    #[test]
    fn kinds_are_those_of_the_partition() {
        let mut s = 1u64;
        let mut next = || {
            s = s
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (s >> 11) as f64 / (1u64 << 53) as f64 - 0.5
        };
        let mut met = 0u32;
        for _ in 0..200 {
            let p: [[f64; LANES]; 3] = std::array::from_fn(|_| std::array::from_fn(|_| next()));
            let kinds = kinds_of(three(|a| Plain::load(&p[a]))).to_le_bytes();
            for l in 0..LANES {
                assert_eq!(usize::from(kinds[l]), kind_of(three(|a| p[a][l])), "{p:?}");
                met |= 1 << kinds[l];
            }
        }
        assert_eq!(met, (1 << 24) - 1);
    }
}
