//! Degree 1: samples at the corners of cells.

use super::{Form, MOST, Volume, locate};
use crate::space::three;
use glam::DVec3;
use isobar_core::Samples;

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

    #[inline(always)]
    fn locate(self, at: [f64; 3]) -> ([i32; 3], [f64; 3]) {
        locate(&self.volume.space, at)
    }
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
