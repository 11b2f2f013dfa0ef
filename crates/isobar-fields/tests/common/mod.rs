//! Shared by the tests: a seeded generator, grids of integers, bisection.

#![allow(dead_code, reason = "each test binary uses its own part")]

use isobar_core::{DMat3, DVec3, Function, Grid, Samples};

/// A small seeded generator of numbers in [0, 1).
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn unit(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    pub(crate) fn range(&mut self, lo: f64, hi: f64) -> f64 {
        lo + (hi - lo) * self.unit()
    }

    pub(crate) fn point(&mut self, lo: DVec3, hi: DVec3) -> DVec3 {
        DVec3::new(self.range(lo.x, hi.x), self.range(lo.y, hi.y), self.range(lo.z, hi.z))
    }
}

/// Samples f(i, j, k) as f32 in the grid's own index space.
pub(crate) fn f32_grid(dims: [usize; 3], spacing: f64, origin: DVec3, f: impl Fn(usize, usize, usize) -> f64) -> Grid {
    let mut s = Vec::with_capacity(dims.iter().product());
    for k in 0..dims[2] {
        for j in 0..dims[1] {
            for i in 0..dims[0] {
                s.push(f(i, j, k) as f32);
            }
        }
    }
    Grid::new(dims, DVec3::splat(spacing), origin, DMat3::IDENTITY, Samples::F32(s.into())).unwrap()
}

/// A grid of seeded bytes.
pub(crate) fn byte_grid(dims: [usize; 3], seed: u64) -> Grid {
    let mut r = Random(seed);
    let s: Vec<u8> = (0..dims.iter().product::<usize>())
        .map(|_| (r.unit() * 256.0) as u8)
        .collect();
    Grid::unit(dims, Samples::U8(s.into())).unwrap()
}

/// The root of s = c on the segment, which must change sign between its ends, to f64.
pub(crate) fn bisect(f: &dyn Function, c: f64, at: impl Fn(f64) -> DVec3, mut lo: f64, mut hi: f64) -> f64 {
    let sign = |t: f64| f.value(at(t)) < c;
    let low = sign(lo);
    assert_ne!(low, sign(hi), "no sign change");
    for _ in 0..200 {
        let m = 0.5 * (lo + hi);
        if sign(m) == low {
            lo = m;
        } else {
            hi = m;
        }
    }
    0.5 * (lo + hi)
}
