//! Degree 1: samples at the corners of cells.

use super::{Form, MOST, Volume, locate, locate_eight};
use crate::space::three;
use glam::DVec3;
use isobar_core::Samples;
use isobar_cpu::packet::{LANES, Lanes};

/// Degree 1.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Linear<'a> {
    volume: &'a Volume,
    samples: &'a Samples,
    sy: usize,
    sz: usize,
}

impl<'a> Linear<'a> {
    pub(crate) fn new(volume: &'a Volume) -> Self {
        Self {
            volume,
            samples: &volume.spline.grid().samples,
            sy: volume.dims[0],
            sz: volume.dims[0] * volume.dims[1],
        }
    }

    #[inline(always)]
    fn corners(self, cell: [i32; 3]) -> [f64; 8] {
        let at = (cell[2] as usize) * self.sz + (cell[1] as usize) * self.sy + cell[0] as usize;
        #[inline(always)]
        fn pick<T: Copy + Into<f64>>(s: &[T], at: usize, sy: usize, sz: usize) -> [f64; 8] {
            let s = &s[at..at + sz + sy + 2];
            [
                s[0].into(),
                s[1].into(),
                s[sy].into(),
                s[sy + 1].into(),
                s[sz].into(),
                s[sz + 1].into(),
                s[sz + sy].into(),
                s[sz + sy + 1].into(),
            ]
        }
        match self.samples {
            Samples::U8(s) => pick(s, at, self.sy, self.sz),
            Samples::I16(s) => pick(s, at, self.sy, self.sz),
            Samples::U16(s) => pick(s, at, self.sy, self.sz),
            Samples::F32(s) => pick(s, at, self.sy, self.sz),
        }
    }

    /// The corners of eight cells.
    #[inline(always)]
    fn corners_of_eight<S: Lanes>(self, cells: &[[i32; LANES]; 3]) -> [S; 8] {
        let mut at = [0; LANES];
        for (l, at) in at.iter_mut().enumerate() {
            *at = (cells[2][l] as usize) * self.sz + (cells[1][l] as usize) * self.sy + cells[0][l] as usize;
        }
        match self.samples {
            Samples::U8(s) => pairs(s, &at, self.sy, self.sz),
            Samples::I16(s) => pairs(s, &at, self.sy, self.sz),
            Samples::U16(s) => pairs(s, &at, self.sy, self.sz),
            Samples::F32(s) => pairs(s, &at, self.sy, self.sz),
        }
    }

    #[inline(always)]
    fn locate(self, at: [f64; 3]) -> ([i32; 3], [f64; 3]) {
        locate(&self.volume.space, at)
    }
}

/// Samples that are fetched two at a time, as they lie side by side along x, and made numbers of eight at a time.
trait Sample: Copy {
    type Pair: Copy + Default;
    fn pair(first: Self, second: Self) -> Self::Pair;
    fn numbers(pair: Self::Pair) -> [f64; 2];
}

/// Two integers of half the width in one.
macro_rules! sample {
    ($t:ty, $half:ty, $pair:ty) => {
        impl Sample for $t {
            type Pair = $pair;
            #[inline(always)]
            fn pair(first: Self, second: Self) -> $pair {
                <$pair>::from(first as $half) | <$pair>::from(second as $half) << <$half>::BITS
            }
            #[inline(always)]
            fn numbers(pair: $pair) -> [f64; 2] {
                [f64::from(pair as $t), f64::from((pair >> <$half>::BITS) as $t)]
            }
        }
    };
}
sample!(u8, u8, u16);
sample!(i16, u16, u32);
sample!(u16, u16, u32);

impl Sample for f32 {
    type Pair = [f32; 2];
    #[inline(always)]
    fn pair(first: f32, second: f32) -> [f32; 2] {
        [first, second]
    }
    #[inline(always)]
    fn numbers([first, second]: [f32; 2]) -> [f64; 2] {
        [first.into(), second.into()]
    }
}

/// The corners of eight cells whose first ones are at `at`, as in [`Linear::corners`].
#[inline(always)]
fn pairs<S: Lanes, T: Sample>(s: &[T], at: &[usize; LANES], sy: usize, sz: usize) -> [S; 8] {
    let mut two = [[T::Pair::default(); LANES]; 4];
    for (l, &at) in at.iter().enumerate() {
        let s = &s[at..at + sz + sy + 2];
        two[0][l] = T::pair(s[0], s[1]);
        two[1][l] = T::pair(s[sy], s[sy + 1]);
        two[2][l] = T::pair(s[sz], s[sz + 1]);
        two[3][l] = T::pair(s[sz + sy], s[sz + sy + 1]);
    }
    let mut out = [S::splat(0.0); 8];
    for (k, two) in two.iter().enumerate() {
        let (mut first, mut second) = ([0.0; LANES], [0.0; LANES]);
        for l in 0..LANES {
            [first[l], second[l]] = T::numbers(two[l]);
        }
        (out[2 * k], out[2 * k + 1]) = (S::load(&first), S::load(&second));
    }
    out
}

/// [`mix`] in lanes.
#[inline(always)]
fn mixed<S: Lanes>(p: S, q: S, x: S) -> S {
    p.along(x, q.sub(p))
}

#[inline(always)]
fn mix(p: f64, q: f64, x: f64) -> f64 {
    p + x * (q - p)
}

impl Form for Linear<'_> {
    const DEGREE: usize = 1;

    #[inline(always)]
    fn value(self, at: [f64; 3]) -> f64 {
        let (cell, [x, y, z]) = self.locate(at);
        let v = self.corners(cell);
        mix(
            mix(mix(v[0], v[1], x), mix(v[2], v[3], x), y),
            mix(mix(v[4], v[5], x), mix(v[6], v[7], x), y),
            z,
        )
    }

    #[inline(always)]
    fn gradient(self, at: [f64; 3]) -> DVec3 {
        let (cell, [x, y, z]) = self.locate(at);
        let v = self.corners(cell);
        let d = |i: usize, j: usize| v[j] - v[i];
        DVec3::new(
            mix(mix(d(0, 1), d(2, 3), y), mix(d(4, 5), d(6, 7), y), z),
            mix(mix(d(0, 2), d(1, 3), x), mix(d(4, 6), d(5, 7), x), z),
            mix(mix(d(0, 4), d(1, 5), x), mix(d(2, 6), d(3, 7), x), y),
        )
    }

    #[inline(always)]
    fn compose(self, cell: [i32; 3], a: [f64; 3], b: [f64; 3], reference: f64, out: &mut [f64; MOST]) {
        let v = self.corners(cell);
        // Along x: the value at a (even) and at b (odd) on each of the four edges.
        let mut x = [0.0; 8];
        for k in 0..4 {
            let (p, q) = (v[2 * k] - reference, v[2 * k + 1] - reference);
            (x[2 * k], x[2 * k + 1]) = (mix(p, q, a[0]), mix(p, q, b[0]));
        }
        // Then y: bit 1 of the index.
        let mut y = [0.0; 8];
        for k in [0, 4] {
            for i in 0..2 {
                let (p, q) = (x[k + i], x[k + 2 + i]);
                (y[k + i], y[k + 2 + i]) = (mix(p, q, a[1]), mix(p, q, b[1]));
            }
        }
        let (za, zb) = (a[2], b[2]);
        let corner = |i: usize, z: f64| mix(y[i], y[4 + i], z);
        out[0] = corner(0, za);
        out[1] = (corner(1, za) + corner(2, za) + corner(0, zb)) * (1.0 / 3.0);
        out[2] = (corner(3, za) + corner(1, zb) + corner(2, zb)) * (1.0 / 3.0);
        out[3] = corner(3, zb);
    }

    #[inline(always)]
    fn values<S: Lanes>(self, at: [S; 3], _: usize) -> S {
        let (cells, [x, y, z]) = locate_eight(&self.volume.space, at);
        let v = self.corners_of_eight::<S>(&cells);
        mixed(
            mixed(mixed(v[0], v[1], x), mixed(v[2], v[3], x), y),
            mixed(mixed(v[4], v[5], x), mixed(v[6], v[7], x), y),
            z,
        )
    }

    #[inline(always)]
    fn composed<S: Lanes>(self, cells: &[[i32; LANES]; 3], [a, b]: [[S; 3]; 2], reference: f64, _: usize, out: &mut [S; MOST]) {
        let v = self.corners_of_eight::<S>(cells);
        let (less, third) = (S::splat(reference), S::splat(1.0 / 3.0));
        // As in `compose`.
        let mut x = [less; 8];
        for k in 0..4 {
            let (p, q) = (v[2 * k].sub(less), v[2 * k + 1].sub(less));
            let d = q.sub(p);
            (x[2 * k], x[2 * k + 1]) = (p.along(a[0], d), p.along(b[0], d));
        }
        let mut y = [less; 8];
        for k in [0, 4] {
            for i in 0..2 {
                let (p, q) = (x[k + i], x[k + 2 + i]);
                let d = q.sub(p);
                (y[k + i], y[k + 2 + i]) = (p.along(a[1], d), p.along(b[1], d));
            }
        }
        let (za, zb) = (a[2], b[2]);
        let (mut near, mut far) = ([less; 4], [less; 4]);
        for i in 0..4 {
            let d = y[4 + i].sub(y[i]);
            (near[i], far[i]) = (y[i].along(za, d), y[i].along(zb, d));
        }
        out[0] = near[0];
        out[1] = near[1].add(near[2]).add(far[0]).mul(third);
        out[2] = near[3].add(far[1]).add(far[2]).mul(third);
        out[3] = far[3];
    }

    /// Least and greatest sample; every type of samples is exact in f32.
    #[inline(always)]
    fn extremes(self, lo: [i32; 3], hi: [i32; 3]) -> ([f32; 64], [f32; 64]) {
        let n = three(|a| (hi[a] - lo[a] + 1) as usize);
        let at = lo[2] as usize * self.sz + lo[1] as usize * self.sy + lo[0] as usize;
        let block = match self.samples {
            Samples::U8(s) => block(&s[at..], n, self.sy, self.sz),
            Samples::I16(s) => block(&s[at..], n, self.sy, self.sz),
            Samples::U16(s) => block(&s[at..], n, self.sy, self.sz),
            Samples::F32(s) => block(&s[at..], n, self.sy, self.sz),
        };
        let less = |a: f32, b: f32| if a < b { a } else { b };
        (along(&block, less), along(&block, |a, b| if a > b { a } else { b }))
    }
}

/// The samples of `n + 1` per axis, in rows of eight of which five count.
#[inline(always)]
fn block<T: Copy + Into<f32>>(s: &[T], n: [usize; 3], sy: usize, sz: usize) -> [[f32; 8]; 25] {
    let mut out = [[0.0; 8]; 25];
    for k in 0..=n[2] {
        for j in 0..=n[1] {
            let from = k * sz + j * sy;
            let row = &mut out[5 * k + j];
            // Eight at once, except at the end of the volume.
            if let Some(eight) = s.get(from..from + 8) {
                for i in 0..8 {
                    row[i] = eight[i].into();
                }
            } else {
                for (to, v) in row.iter_mut().zip(&s[from..=from + n[0]]) {
                    *to = (*v).into();
                }
            }
        }
    }
    out
}

/// The least or greatest, as `of` has it, of the eight corners of each of 4^3 cells: of neighbours along x, then y, then z.
#[inline(always)]
fn along(block: &[[f32; 8]; 25], of: impl Fn(f32, f32) -> f32) -> [f32; 64] {
    let mut x = [[0.0f32; 4]; 25];
    for (to, row) in x.iter_mut().zip(block) {
        for i in 0..4 {
            to[i] = of(row[i], row[i + 1]);
        }
    }
    let mut y = [[0.0f32; 16]; 5];
    for (k, plane) in y.iter_mut().enumerate() {
        for j in 0..4 {
            for i in 0..4 {
                plane[4 * j + i] = of(x[5 * k + j][i], x[5 * k + j + 1][i]);
            }
        }
    }
    let mut z = [0.0f32; 64];
    for k in 0..4 {
        for i in 0..16 {
            z[16 * k + i] = of(y[k][i], y[k + 1][i]);
        }
    }
    z
}
