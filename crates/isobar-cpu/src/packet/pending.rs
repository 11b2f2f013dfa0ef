//! Polynomials with one root each, put aside until the end of a tile, to be worked out eight at a time.

use super::LANES;
use super::lanes::Lanes;

/// Entries of a piece of the list.
const ROOM: usize = 256;

/// The same with what a vector may write beyond.
const WITH_SLACK: usize = ROOM + LANES;

/// A piece of the list. Of one size, so that there is one check for all its lists when a vector is put into them.
#[derive(Debug)]
struct Piece<const N: usize> {
    p: [[f64; WITH_SLACK]; N],
    ends: [[f64; WITH_SLACK]; 2],
    root: [[f64; WITH_SLACK]; 2],
    near: [[f64; WITH_SLACK]; 3],
    ray: [u8; WITH_SLACK],
    value: [u8; WITH_SLACK],
    kind: [u8; WITH_SLACK],
}

/// Polynomials of up to `N` coefficients that have one root each for certain, with what belongs to it.
#[derive(Debug)]
pub struct Pending<const N: usize> {
    count: usize,
    /// All but the last one in use are full.
    pieces: Vec<Box<Piece<N>>>,
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

/// Puts the lanes of a mask together at `at`, which is below [`ROOM`].
#[inline(always)]
fn put<S: Lanes>(all: &mut [f64; WITH_SLACK], at: usize, m: u8, v: S) {
    if let Some(to) = all[at..].first_chunk_mut() {
        v.store_packed(m, to);
    }
}

/// Puts all lanes at `at`, which is below [`ROOM`].
#[inline(always)]
fn put_all<S: Lanes>(all: &mut [f64; WITH_SLACK], at: usize, v: S) {
    if let Some(to) = all[at..].first_chunk_mut() {
        v.store(to);
    }
}

#[inline(always)]
fn put_bytes(all: &mut [u8; WITH_SLACK], at: usize, v: [u8; LANES]) {
    if let Some(to) = all[at..].first_chunk_mut() {
        *to = v;
    }
}

/// Eight from `at` on.
#[inline(always)]
fn get<S: Lanes>(all: &[f64; WITH_SLACK], at: usize) -> S {
    all[at..].first_chunk().map_or(S::splat(0.0), S::load)
}

/// As [`get`], for bytes; 0 beyond `n`.
#[inline(always)]
fn bytes(all: &[u8; WITH_SLACK], at: usize, n: usize) -> [u8; LANES] {
    let all = all[at..].first_chunk().map_or(0, |v| u64::from_le_bytes(*v));
    (all & u64::MAX >> (8 * (LANES - n))).to_le_bytes()
}

impl<const N: usize> Piece<N> {
    fn new() -> Box<Self> {
        Box::new(Self {
            p: [[0.0; WITH_SLACK]; N],
            ends: [[0.0; WITH_SLACK]; 2],
            root: [[0.0; WITH_SLACK]; 2],
            near: [[0.0; WITH_SLACK]; 3],
            ray: [0; WITH_SLACK],
            value: [0; WITH_SLACK],
            kind: [0; WITH_SLACK],
        })
    }

    /// All lists of numbers.
    fn numbers(&mut self) -> impl Iterator<Item = &mut [f64; WITH_SLACK]> {
        (self.p.iter_mut())
            .chain(&mut self.ends)
            .chain(&mut self.root)
            .chain(&mut self.near)
    }

    /// What was written beyond the end of `from` is the start of this one.
    fn carry(&mut self, from: &mut Self) {
        for (to, from) in self.numbers().zip(from.numbers()) {
            to[..LANES].copy_from_slice(&from[ROOM..]);
        }
        for (to, from) in [
            (&mut self.ray, &from.ray),
            (&mut self.value, &from.value),
            (&mut self.kind, &from.kind),
        ] {
            to[..LANES].copy_from_slice(&from[ROOM..]);
        }
    }
}

impl<const N: usize> Pending<N> {
    pub(super) const fn new() -> Self {
        Self {
            count: 0,
            pieces: Vec::new(),
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

    /// Forgets all.
    pub const fn clear(&mut self) {
        self.count = 0;
    }

    #[cold]
    #[inline(never)]
    fn grow(&mut self) {
        self.pieces.push(Piece::new());
    }

    /// The piece the next one goes to, and where in it.
    #[inline(always)]
    fn last(&mut self) -> (&mut Piece<N>, usize) {
        let at = self.count / ROOM;
        if at >= self.pieces.len() {
            self.grow();
        }
        (&mut self.pieces[at], self.count % ROOM)
    }

    /// After entries up to `n` have been put into the last piece.
    #[cold]
    #[inline(never)]
    fn carry(&mut self) {
        let at = self.count / ROOM;
        if at >= self.pieces.len() {
            self.grow();
        }
        let (full, next) = self.pieces.split_at_mut(at);
        next[0].carry(&mut full[at - 1]);
    }

    #[inline(always)]
    pub(super) fn push<S: Lanes>(&mut self, m: u8, b: usize, p: &[S], ends: [S; 2], near: [f64; 3], value: u8) {
        let (piece, n) = self.last();
        for (all, &v) in piece.p.iter_mut().zip(p) {
            put(all, n, m, v);
        }
        put(&mut piece.ends[0], n, m, ends[0]);
        put(&mut piece.ends[1], n, m, ends[1]);
        put_all(&mut piece.root[0], n, S::splat(-1.0));
        put_all(&mut piece.root[1], n, S::splat(0.0));
        for (all, &v) in piece.near.iter_mut().zip(&near) {
            put_all(all, n, S::splat(v));
        }
        let rays = 0x0706_0504_0302_0100 + (b * LANES) as u64 * 0x0101_0101_0101_0101;
        put_bytes(&mut piece.ray, n, S::pack_bytes(rays, m).to_le_bytes());
        put_bytes(&mut piece.value, n, [value; LANES]);
        put_bytes(&mut piece.kind, n, [0; LANES]);
        let more = m.count_ones() as usize;
        self.count += more;
        if n + more > ROOM {
            self.carry();
        }
    }

    pub(super) fn push_one(&mut self, one: &One<'_>) {
        let (piece, n) = self.last();
        for (all, &v) in piece.p.iter_mut().zip(one.p) {
            all[n] = v;
        }
        for i in 0..2 {
            piece.ends[i][n] = one.ends[i];
            piece.root[i][n] = one.root[i];
        }
        for a in 0..3 {
            piece.near[a][n] = one.near[a];
        }
        (piece.ray[n], piece.value[n], piece.kind[n]) = (one.ray, one.value, one.kind);
        self.count += 1;
    }

    /// Up to eight from `at` on, a multiple of eight below the number of all.
    ///
    /// # Panics
    /// Where it is none.
    #[inline(always)]
    #[must_use]
    pub fn group<S: Lanes>(&self, at: usize) -> Group<S, N> {
        assert!(
            at.is_multiple_of(LANES) && at < self.count,
            "a group of eight at {at} of {}",
            self.count
        );
        let n = (self.count - at).min(LANES);
        let (piece, at) = (&*self.pieces[at / ROOM], at % ROOM);
        let mut p = [S::splat(0.0); N];
        for (to, all) in p.iter_mut().zip(&piece.p) {
            *to = get(all, at);
        }
        Group {
            p,
            ends: [get(&piece.ends[0], at), get(&piece.ends[1], at)],
            root: [get(&piece.root[0], at), get(&piece.root[1], at)],
            near: [get(&piece.near[0], at), get(&piece.near[1], at), get(&piece.near[2], at)],
            ray: bytes(&piece.ray, at, n),
            value: bytes(&piece.value, at, n),
            kind: bytes(&piece.kind, at, n),
            held: u8::MAX >> (LANES - n),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::lanes::Plain;
    use super::*;

    /// Vectors of any number of lanes, over the ends of pieces, come out in the order they were put in.
    #[test]
    fn what_was_put_aside_comes_back_in_order() {
        let mut pending = Pending::<2>::new();
        let (mut want, mut seed) = (Vec::new(), 1u32);
        while want.len() < 1000 {
            seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let (m, b, value) = ((seed >> 24) as u8, (seed >> 16 & 31) as usize, (seed >> 8 & 7) as u8);
            let lanes: [f64; LANES] = std::array::from_fn(|l| f64::from(seed >> 10) + l as f64);
            let near = [1.0, 2.0, f64::from(value)];
            if seed & 64 == 0 {
                let v = Plain::load(&lanes);
                pending.push(m, b, &[v, v.add(v)], [v, v], near, value);
                want.extend(
                    (0..LANES)
                        .filter(|l| m >> l & 1 != 0)
                        .map(|l| (lanes[l], (b * LANES + l) as u8, value, -1.0)),
                );
            } else {
                pending.push_one(&One {
                    ray: 9,
                    p: &[lanes[0], 2.0 * lanes[0]],
                    ends: [lanes[0]; 2],
                    root: [0.5, 0.1],
                    near,
                    value,
                    kind: 0,
                });
                want.push((lanes[0], 9, value, 0.5));
            }
        }
        assert_eq!(pending.len(), want.len());
        for (at, want) in want.chunks(LANES).enumerate() {
            let group = pending.group::<Plain>(at * LANES);
            assert_eq!(group.held.count_ones() as usize, want.len());
            let store = |v: Plain| {
                let mut to = [0.0; LANES];
                v.store(&mut to);
                to
            };
            let (p, q, end, root, near) = (
                store(group.p[0]),
                store(group.p[1]),
                store(group.ends[1]),
                store(group.root[0]),
                store(group.near[2]),
            );
            for (l, &(x, ray, value, known)) in want.iter().enumerate() {
                assert_eq!(
                    (p[l], q[l], end[l], root[l], near[l]),
                    (x, 2.0 * x, x, known, f64::from(value))
                );
                assert_eq!((group.ray[l], group.value[l]), (ray, value));
            }
        }
        pending.clear();
        assert!(pending.is_empty());
    }
}
