//! The active cubes of a volume for one tile: pieces of rays between sorted planes, and the queue of those in active tetrahedra.

use super::crossing::Lattice;
use super::lanes::{LANES, Lanes, SPREAD};
use super::pieces::{Lines, blossom, coefficients};
use super::{Field, Packet, SHIFT, ones};
use crate::bricks;
use crate::cube::Data;
use crate::ray::{FORMS, three};
use crate::walk::Work;
use isobar_fields::type6::DENOMINATOR;
use isobar_poly::{First, RootKind, Tolerance, first_root};
use std::marker::PhantomData;

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
pub(super) struct Cubes<'a, S> {
    field: &'a dyn Field,
    /// What a coefficient may be off by, 192 times.
    bound: f64,
    /// The brick's cubes.
    brick: Option<&'a bricks::Cubes>,
    queue: Queue,
    /// Whether a ray ended in this cube.
    ended: bool,
    lanes: PhantomData<S>,
}

impl<'a, S: Lanes> Cubes<'a, S> {
    /// `margin`: the relative bound of the packet's rays.
    #[inline(always)]
    pub(super) fn new(field: &'a dyn Field, margin: f64) -> Self {
        Self {
            field,
            bound: f64::from(DENOMINATOR) * margin * field.bounds()[0].size,
            brick: None,
            queue: Queue {
                t0: [0.0; ROOM],
                t1: [0.0; ROOM],
                ray: [0; ROOM],
                kind: [0; ROOM],
                count: 0,
            },
            ended: false,
            lanes: PhantomData,
        }
    }

    pub(super) fn bound(&self) -> f64 {
        self.bound
    }
}

impl<S: Lanes> Lattice for Cubes<'_, S> {
    #[inline(always)]
    fn size(&self) -> [i32; 3] {
        self.field.size()
    }

    #[inline(always)]
    fn node(&self, node: [i32; 3]) -> u64 {
        let active = self.field.active();
        active.words[active.word_of(node)]
    }

    #[inline(always)]
    fn brick(&mut self, brick: [i32; 3]) -> u64 {
        let cubes = self.field.brick(brick);
        self.brick = Some(cubes);
        cubes.mask()
    }

    #[inline(always)]
    fn cube(&mut self, p: &mut Packet, blocks: u32, cube: [i32; 3], b: u32, work: &mut Work) {
        let Some(brick) = self.brick else { return };
        let mut data: Option<Data> = None;
        let kinds = if let Some(kinds) = brick.known(b) {
            kinds
        } else {
            let kinds = active_kinds::<S>(data.insert(self.field.data(cube)), self.field.bounds()[0].margin());
            brick.keep(b, kinds);
            kinds
        };
        if kinds == 0 {
            return;
        }
        let near = three(|a| f64::from(cube[a] + i32::from(p.down[a])));
        let far = three(|a| f64::from(cube[a] + i32::from(!p.down[a])));
        let mut left = blocks;
        while left != 0 {
            let b = left.trailing_zeros() as usize;
            left &= left - 1;
            let inv = three(|a| S::load(&p.inv[a][b]));
            let shift = three(|a| S::load(&p.shift[a][b]));
            let (tn, tf) = (planes(near, inv, shift), planes(far, inv, shift));
            let t0 = tn[0].max(tn[1]).max(tn[2].max(S::load(&p.begin[b])));
            let t1 = tf[0].min(tf[1]).min(tf[2].min(S::load(&p.end[b])));
            let inside = p.alive[b] & t1.above(t0);
            if inside != 0 {
                work.cubes += u64::from(inside.count_ones());
                work.active += u64::from(inside.count_ones());
                self.cut(p, b, cube, kinds, [t0, t1], inside);
            }
            if self.queue.count >= LANES || (left == 0 && self.queue.count > 0) {
                let data = data.get_or_insert_with(|| self.field.data(cube));
                self.empty(p, cube, data, left == 0, work);
            }
        }
        if self.ended {
            self.ended = false;
            p.end(blocks);
        }
    }
}

/// The kinds whose coefficients hold a value within `margin` of zero, from the 27 data of a cube: eight kinds at a time.
#[inline(always)]
pub(super) fn active_kinds<S: Lanes>(data: &Data, margin: f64) -> u32 {
    let margin = S::splat(f64::from(DENOMINATOR) * margin);
    let mut mask = 0;
    for group in 0..3 {
        let kinds = 0x0706_0504_0302_0100 + group * 8 * LOWEST;
        let b = coefficients::<S, 32>(data, S::index(0), S::index(kinds));
        let (mut least, mut greatest) = (b[0], b[0]);
        for &v in &b[1..] {
            least = least.min(v);
            greatest = greatest.max(v);
        }
        let on = !least.above(margin) & !S::splat(0.0).sub(margin).above(greatest);
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

impl<S: Lanes> Cubes<'_, S> {
    /// Puts the pieces of block `b` in active tetrahedra into the queue.
    #[inline(always)]
    fn cut(&mut self, p: &Packet, b: usize, cube: [i32; 3], kinds: u32, [t0, t1]: [S; 2], inside: u8) {
        let c = cube.map(f64::from);
        // Planes outside make pieces of no length.
        let mut cuts = [t0; 8];
        for (n, &(i, j, sign)) in FORMS.iter().enumerate() {
            let t = S::splat(c[i] + sign * c[j])
                .mul(S::load(&p.form_inv[n][b]))
                .add(S::load(&p.form_shift[n][b]));
            cuts[n + 1] = t.min(t1).max(t0);
        }
        for (i, j) in SORT {
            let (lo, hi) = (cuts[i + 1], cuts[j + 1]);
            (cuts[i + 1], cuts[j + 1]) = (lo.min(hi), lo.max(hi));
        }
        cuts[7] = t1;
        let o = three(|a| Packet::of::<S>(&p.origin, a, b).sub(S::splat(c[a])));
        let d = three(|a| Packet::of::<S>(&p.direction, a, b));
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
    fn empty(&mut self, p: &mut Packet, cube: [i32; 3], data: &Data, all: bool, work: &mut Work) {
        let count = self.queue.count;
        work.tets += count as u64;
        let mut centre = [0.0; 32];
        for a in 0..3 {
            centre[a * LANES] = f64::from(cube[a]);
        }
        let (bound, minus) = (S::splat(self.bound), S::splat(-self.bound));
        let mut at = 0;
        while at + LANES <= count || (all && at < count) {
            let n = (count - at).min(LANES);
            let held = u8::MAX >> (LANES - n);
            let q = &self.queue;
            let (t0, t1) = (S::load(&eight(&q.t0, at)), S::load(&eight(&q.t1, at)));
            let kind = S::index(u64::from_le_bytes(eight(&q.kind, at)));
            let ray = S::index(u64::from_le_bytes(eight(&q.ray, at)));
            let b = coefficients::<S, 32>(data, S::index(0), kind);
            let lines = Lines::new(p, ray, &centre, S::index(0), kind);
            let c = blossom(&b, lines.at(t0), lines.at(t1));
            let least = c[0].min(c[1]).min(c[2].min(c[3]));
            let greatest = c[0].max(c[1]).max(c[2].max(c[3]));
            let maybe = held & !least.above(bound) & !minus.above(greatest);
            if maybe != 0 {
                // Ends clear of zero and one change of sign for certain: exactly one root.
                let (up, down) = (
                    [c[0].above(bound), c[1].above(bound), c[2].above(bound), c[3].above(bound)],
                    [minus.above(c[0]), minus.above(c[1]), minus.above(c[2]), minus.above(c[3])],
                );
                let one = (up[0] & down[3] & (up[1] | down[2])) | (down[0] & up[3] & (down[1] | up[2]));
                let mut lanes = [[0.0; LANES]; 4];
                for (to, c) in lanes.iter_mut().zip(c) {
                    c.store(to);
                }
                for l in ones(maybe.into()) {
                    let c = [lanes[0][l], lanes[1][l], lanes[2][l], lanes[3][l]];
                    self.take(p, at + l, cube, c, one >> l & 1 != 0, work);
                }
            }
            at += LANES;
        }
        if all {
            self.queue.count = 0;
        } else {
            work.tets -= (count - at) as u64;
            self.queue.drop_first(at);
        }
    }

    /// The cubic of piece `at` of the queue may have a root, just one if `one`: whether it has, and is the first of its ray.
    #[inline(always)]
    fn take(&mut self, p: &mut Packet, at: usize, cube: [i32; 3], c: [f64; 4], one: bool, work: &mut Work) {
        work.cubics += 1;
        let ray = self.queue.ray[at];
        let (b, l) = (usize::from(ray) / LANES, usize::from(ray) % LANES);
        let (t0, bit) = (self.queue.t0[at], 1u8 << l);
        // Rays that had ended are not in this cube; one in doubt stays so, of two hits the first counts.
        if p.single[b] & bit != 0 || (p.hit[b] & bit != 0 && p.found.t0[b][l] <= t0) {
            return;
        }
        let known = if one { Some([-1.0, 0.0]) } else { first(&c, self.bound) };
        let Some([root, reach]) = known else { return };
        self.ended = true;
        if reach.is_nan() {
            p.single[b] |= bit;
            p.hit[b] &= !bit;
            return;
        }
        p.hit[b] |= bit;
        let f = &mut p.found;
        for (to, c) in f.p.iter_mut().zip(c) {
            to[b][l] = c;
        }
        (f.t0[b][l], f.t1[b][l]) = (t0, self.queue.t1[at]);
        (f.root[b][l], f.reach[b][l]) = (root, reach);
        f.cube[usize::from(ray)] = cube;
        f.kind[usize::from(ray)] = self.queue.kind[at];
    }
}

/// The first root of a cubic and how far its bracket reaches; the latter NaN where that is in doubt. `None`: no root for certain.
#[cold]
#[inline(never)]
fn first(c: &[f64; 4], bound: f64) -> Option<[f64; 2]> {
    /// Brackets in [0, 1] are at most this wide, where signs are certain that close.
    const WIDTH: f64 = 1e-9;
    let tolerance = Tolerance {
        error: bound,
        ..Tolerance::new(WIDTH)
    };
    match first_root(c, &tolerance) {
        First::None => None,
        First::Root(r) if r.kind == RootKind::Crossing && r.lo > 0.0 && r.hi < 1.0 => Some([r.t, (r.t - r.lo).max(r.hi - r.t)]),
        _ => Some([f64::NAN; 2]),
    }
}

const _: () = assert!(SHIFT == 0.5, "cubes reach half a step to both sides of their sample");

#[cfg(test)]
mod tests {
    use super::super::lanes::Plain;
    use super::*;
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
            assert_eq!(active_kinds::<Plain>(&data, 1e-6), want);
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
