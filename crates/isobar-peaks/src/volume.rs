//! The field: its value and gradient at a point, and its exact polynomial along a ray in a cell.
//!
//! **Composition.** In a cell the field is a tensor product of polynomials of degree d (1, 2, 3) per axis; along the ray from local a to local b it is a
//! polynomial of degree 3d in Bernstein form on [0, 1].
//!
//! *Degree 1.* Its four coefficients are values of the blossom, which is multi-affine in the three coordinates: with V_ijk the value at the corner of the box
//! from a to b where each coordinate is that of a or b, they are V_000, the mean of V_100, V_010, V_001, that of V_110, V_101, V_011, and V_111.
//!
//! *Degrees 2 and 3.* Each weight of an axis, restricted to [a, b], is a polynomial of degree d whose scaled Bernstein coefficients are values of its polar form; the
//! sums over x, then y, then z are products of such polynomials, which in scaled Bernstein form are plain convolutions.
//!
//! **Bound on a coefficient**, relative to M, the greatest |coefficient of the field - reference| (u = 2^-53). `E` bounds a position per axis (`space.rs`). A spline's
//! derivative along an axis is a combination, with weights that sum to one, of differences of two coefficients: at most 2M per unit (7.2M for BC(2,1):
//! one axis 4M where its derivative's weights are greatest, the others' weights sum to at most 4/3 in size). A Bernstein coefficient takes its arguments at a or b, so
//! positions move it by at most 2ME per axis, together [`Volume::steep`] M E, 6 or 22.
//!
//! Rounding, degree 1: subtracting the reference uM; three interpolations `p + x (q - p)` at 4uM each (|q - p| <= 2M); the mean of three 3uM: 16uM; 64 are used,
//! which covers the subtraction of a value and the evaluation of the coefficients too. Degrees 2 and 3: a polar value of a weight, times the denominator, is a sum of at most eight terms of
//! absolute sum at most 13 (50 for BC(2,1)): off by at most 8u times that, over a denominator of 6; four weights an axis, three axes, the others' absolute sums at most
//! 1 (16/9 for BC(2,1)): 210uM (1430uM). The convolutions are sums of at most 4 + 16 + 28 products, at most 50uM, times (4/3)^3 for BC(2,1). Reference and scaling: 3uM.
//! Together 270uM (1600uM); 1024 (8192) are used.

use crate::filter::{Filter, rows};
use crate::space::{Space, U, three};
use glam::DVec3;
use isobar_core::{DataError, Grid, Lattice, Samples, Stage};
use isobar_fields::GridSpline;

/// Most Bernstein coefficients along a ray: degree 9.
pub(crate) const MOST: usize = 10;

/// A field on a grid.
#[derive(Debug)]
pub(crate) struct Volume {
    pub(crate) filter: Filter,
    pub(crate) spline: GridSpline,
    pub(crate) space: Space,
    dims: [usize; 3],
    /// Power coefficients of the weights.
    rows: [[f64; 4]; 4],
    /// 1 / denominator^3.
    scale: f64,
}

impl Volume {
    /// # Errors
    /// As [`GridSpline::new`].
    pub(crate) fn new(grid: &Grid, filter: Filter) -> Result<Self, DataError> {
        let spline = GridSpline::new(grid, filter.coefficients(), Stage::Stored)?;
        let basis = filter.basis();
        Ok(Self {
            filter,
            space: Space::new(grid.domain(), basis.centred),
            dims: grid.dims,
            rows: rows(basis),
            scale: f64::from(basis.denominator).powi(-3),
            spline,
        })
    }

    /// Factor of E M in the bound of the module.
    pub(crate) fn steep(&self) -> f64 {
        if self.filter.has_negative_lobes() { 22.0 } else { 6.0 }
    }

    /// The rest of the bound, relative to M.
    pub(crate) fn rounding(&self) -> f64 {
        match self.filter.basis().degree {
            1 => 64.0 * U,
            _ if self.filter.has_negative_lobes() => 8192.0 * U,
            _ => 1024.0 * U,
        }
    }
}

/// What a ray asks a field of one degree.
pub(crate) trait Form: Copy {
    /// Degree along one axis.
    const DEGREE: usize;
    /// Bernstein coefficients along a ray.
    const COUNT: usize = 3 * Self::DEGREE + 1;
    /// The field at a point of index space, coordinates clamped to the domain.
    fn value(self, at: [f64; 3]) -> f64;
    /// Its gradient in index space.
    fn gradient(self, at: [f64; 3]) -> DVec3;
    /// Bernstein coefficients, less `reference`, on the segment from local a to local b of a cell; the first [`Form::COUNT`] of `out`.
    fn compose(self, cell: [i32; 3], a: [f64; 3], b: [f64; 3], reference: f64, out: &mut [f64; MOST]);
    /// Range of the field on each cell of a box of at most 4^3 cells, x fastest, from its Bernstein coefficients.
    fn ranges(self, lo: [i32; 3], hi: [i32; 3], each: impl FnMut([i32; 3], f64, f64));
}

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

/// Cell and local coordinates of a point, clamped to the domain.
#[inline(always)]
fn locate(space: &Space, at: [f64; 3]) -> ([i32; 3], [f64; 3]) {
    let x = three(|a| at[a].max(space.lo[a]).min(space.hi[a]));
    let cell = three(|a| (x[a] as i32).min(space.cells[a] - 1));
    (cell, three(|a| x[a] - f64::from(cell[a])))
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

    fn ranges(self, lo: [i32; 3], hi: [i32; 3], mut each: impl FnMut([i32; 3], f64, f64)) {
        let n = three(|a| (hi[a] - lo[a] + 1) as usize);
        // Least and greatest of neighbours along x, then y, then z: each sample is read once.
        let (mut least, mut most) = ([0.0f64; 125], [0.0f64; 125]);
        for k in 0..=n[2] {
            for j in 0..=n[1] {
                let at = (lo[2] as usize + k) * self.sz + (lo[1] as usize + j) * self.sy + lo[0] as usize;
                let row = &mut least[(k * 5 + j) * 5..][..n[0] + 1];
                match self.samples {
                    Samples::U8(s) => read(&s[at..], row),
                    Samples::I16(s) => read(&s[at..], row),
                    Samples::U16(s) => read(&s[at..], row),
                    Samples::F32(s) => read(&s[at..], row),
                }
            }
        }
        most.copy_from_slice(&least);
        for stride in [1, 5, 25] {
            for i in 0..125 - stride {
                least[i] = least[i].min(least[i + stride]);
                most[i] = most[i].max(most[i + stride]);
            }
        }
        for k in 0..n[2] {
            for j in 0..n[1] {
                for i in 0..n[0] {
                    let at = (k * 5 + j) * 5 + i;
                    each(three(|a| lo[a] + [i, j, k][a] as i32), least[at], most[at]);
                }
            }
        }
    }
}

#[inline(always)]
fn read<T: Copy + Into<f64>>(s: &[T], row: &mut [f64]) {
    for (to, from) in row.iter_mut().zip(s) {
        *to = (*from).into();
    }
}

/// Degree 2 (W = 3) or 3 (W = 4).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Smooth<'a, const W: usize>(pub(crate) &'a Volume);

impl<const W: usize> Smooth<'_, W> {
    #[inline(always)]
    fn stencil(self, cell: [i32; 3]) -> [f64; 64] {
        let mut s = [0.0; 64];
        self.0.spline.stencil(cell.map(|i| i as usize), &mut s);
        s
    }

    /// Weights at w, times the denominator.
    #[inline(always)]
    fn weights(self, w: f64) -> [f64; W] {
        let m = &self.0.rows;
        let mut out = [0.0; W];
        for (j, o) in out.iter_mut().enumerate() {
            *o = m[0][j] + w * (m[1][j] + w * (m[2][j] + w * m[3][j]));
        }
        out
    }

    #[inline(always)]
    fn slopes(self, w: f64) -> [f64; W] {
        let m = &self.0.rows;
        let mut out = [0.0; W];
        for (j, o) in out.iter_mut().enumerate() {
            *o = m[1][j] + w * (2.0 * m[2][j] + w * (3.0 * m[3][j]));
        }
        out
    }

    /// Scaled Bernstein coefficients, times the denominator, of each weight on [a, b]: `[j][i]`.
    #[inline(always)]
    fn restricted(self, a: f64, b: f64) -> [[f64; W]; W] {
        let m = &self.0.rows;
        let mut out = [[0.0; W]; W];
        for (j, o) in out.iter_mut().enumerate() {
            let m = [m[0][j], m[1][j], m[2][j], m[3][j]];
            if W == 4 {
                // Polar form m0 + m1 (x+y+z)/3 + m2 (xy+yz+zx)/3 + m3 xyz, times 1, 3, 3, 1.
                let cube = |x: f64| m[0] + x * (m[1] + x * (m[2] + x * m[3]));
                let two =
                    |x: f64, y: f64| 3.0 * m[0] + m[1] * (2.0 * x + y) + m[2] * (x * (x + 2.0 * y)) + 3.0 * m[3] * (x * x * y);
                o[0] = cube(a);
                o[1] = two(a, b);
                o[2] = two(b, a);
                o[W - 1] = cube(b);
            } else {
                let square = |x: f64| m[0] + x * (m[1] + x * m[2]);
                o[0] = square(a);
                o[1] = 2.0 * m[0] + m[1] * (a + b) + 2.0 * m[2] * (a * b);
                o[W - 1] = square(b);
            }
        }
        out
    }
}

impl<const W: usize> Form for Smooth<'_, W> {
    const DEGREE: usize = W - 1;

    #[inline(always)]
    fn value(self, at: [f64; 3]) -> f64 {
        let (cell, x) = locate(&self.0.space, at);
        let s = self.stencil(cell);
        let [wx, wy, wz] = three(|a| self.weights(x[a]));
        let mut sum = 0.0;
        for k in 0..W {
            let mut plane = 0.0;
            for j in 0..W {
                let row = &s[(k * W + j) * W..][..W];
                let mut r = 0.0;
                for i in 0..W {
                    r += wx[i] * row[i];
                }
                plane += wy[j] * r;
            }
            sum += wz[k] * plane;
        }
        sum * self.0.scale
    }

    #[inline(always)]
    fn gradient(self, at: [f64; 3]) -> DVec3 {
        let (cell, x) = locate(&self.0.space, at);
        let s = self.stencil(cell);
        let [wx, wy, wz] = three(|a| self.weights(x[a]));
        let [dx, dy, dz] = three(|a| self.slopes(x[a]));
        let mut g = DVec3::ZERO;
        for k in 0..W {
            let mut plane = DVec3::ZERO;
            for j in 0..W {
                let row = &s[(k * W + j) * W..][..W];
                let (mut r, mut d) = (0.0, 0.0);
                for i in 0..W {
                    r += wx[i] * row[i];
                    d += dx[i] * row[i];
                }
                plane += DVec3::new(wy[j] * d, dy[j] * r, wy[j] * r);
            }
            g += plane * DVec3::new(wz[k], wz[k], dz[k]);
        }
        g * self.0.scale
    }

    #[inline(always)]
    fn compose(self, cell: [i32; 3], a: [f64; 3], b: [f64; 3], reference: f64, out: &mut [f64; MOST]) {
        let s = self.stencil(cell);
        let [x, y, z] = three(|i| self.restricted(a[i], b[i]));
        let mut total = [0.0; MOST];
        for k in 0..W {
            // Products of degree 2 (W - 1): at most 7 coefficients.
            let mut plane = [0.0; 7];
            for j in 0..W {
                let row = &s[(k * W + j) * W..][..W];
                let mut line = [0.0; W];
                for i in 0..W {
                    let c = row[i] - reference;
                    for (l, w) in line.iter_mut().zip(&x[i]) {
                        *l += c * w;
                    }
                }
                for i in 0..W {
                    for l in 0..W {
                        plane[i + l] += line[i] * y[j][l];
                    }
                }
            }
            for i in 0..2 * W - 1 {
                for l in 0..W {
                    total[i + l] += plane[i] * z[k][l];
                }
            }
        }
        let scale = self.0.scale;
        for i in 0..Self::COUNT {
            out[i] = total[i] * (scale * INVERSE[W - 2][i]);
        }
    }

    fn ranges(self, lo: [i32; 3], hi: [i32; 3], mut each: impl FnMut([i32; 3], f64, f64)) {
        let p = self.0.filter.points();
        for k in lo[2]..=hi[2] {
            for j in lo[1]..=hi[1] {
                for i in lo[0]..=hi[0] {
                    let (least, most) = hull::<W>(&p, self.stencil([i, j, k]));
                    // Each coefficient is three sums of W products, in any order.
                    let slack = 64.0 * U * least.abs().max(most.abs()) * 3.0;
                    each([i, j, k], least - slack, most + slack);
                }
            }
        }
    }
}

/// Least and greatest Bernstein coefficient of a piece; `p`: [`Filter::points`].
fn hull<const W: usize>(p: &[[f64; 4]; 4], mut s: [f64; 64]) -> (f64, f64) {
    for stride in [1, W, W * W] {
        for line in 0..W * W {
            // The first index of the line along this axis.
            let at = match stride {
                1 => line * W,
                s if s == W => line / W * (W * W) + line % W,
                _ => line,
            };
            let c: [f64; W] = std::array::from_fn(|i| s[at + i * stride]);
            for (i, row) in p.iter().enumerate().take(W) {
                let mut sum = 0.0;
                for j in 0..W {
                    sum += row[j] * c[j];
                }
                s[at + i * stride] = sum;
            }
        }
    }
    s[..W * W * W]
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), &x| (a.min(x), b.max(x)))
}

/// 1 / C(6, i) and 1 / C(9, i).
static INVERSE: [[f64; MOST]; 3] = {
    const fn row(n: usize) -> [f64; MOST] {
        let mut out = [0.0; MOST];
        let mut c = 1.0;
        let mut i = 0;
        while i <= n {
            out[i] = 1.0 / c;
            c = c * (n - i) as f64 / (i + 1) as f64;
            i += 1;
        }
        out
    }
    [row(3), row(6), row(9)]
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filter::binomial;
    use isobar_core::Function;

    fn noise(dims: [usize; 3]) -> Grid {
        let mut seed = 5u32;
        let samples: Vec<f32> = (0..dims.iter().product())
            .map(|_| {
                seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                (seed >> 8) as f32 / (1u32 << 24) as f32
            })
            .collect();
        Grid::unit(dims, Samples::F32(samples.into())).unwrap()
    }

    /// Value, composition and ranges agree with each other, and the value with isobar-fields.
    fn check(filter: Filter, volume: &Volume, form: impl Form) {
        let (count, n) = (3 * filter.basis().degree + 1, 3 * filter.basis().degree);
        let shift = if filter.basis().centred { 0.5 } else { 0.0 };
        for cell in [[0, 0, 0], [1, 2, 3], [3, 3, 2]] {
            let (a, b) = ([0.1, 0.9, 0.3], [0.8, 0.2, 0.95]);
            let mut p = [0.0; MOST];
            form.compose(cell, a, b, 0.25, &mut p);
            let (mut lo, mut hi) = (0.0, 0.0);
            form.ranges(cell, cell, |c, x, y| {
                assert_eq!(c, cell);
                (lo, hi) = (x, y);
            });
            for i in 0..=16 {
                let x = f64::from(i) / 16.0;
                let at = three(|k| f64::from(cell[k]) + a[k] + x * (b[k] - a[k]));
                if (0..3).any(|k| at[k] < volume.space.lo[k] || at[k] > volume.space.hi[k]) {
                    continue;
                }
                let bernstein: f64 = (0..count)
                    .map(|i| binomial(n, i) * x.powi(i as i32) * (1.0 - x).powi((n - i) as i32) * p[i])
                    .sum();
                let v = form.value(at);
                assert!((v - bernstein - 0.25).abs() < 1e-13, "{filter}: {v} {bernstein}");
                assert!(lo <= v && v <= hi, "{filter}: {v} outside [{lo}, {hi}]");
                let world = DVec3::from_array(at) - shift;
                if !filter.has_negative_lobes() {
                    assert!((volume.spline.value(world) - v).abs() < 1e-13, "{filter}");
                    assert!(
                        (volume.spline.gradient(world) - form.gradient(at)).length() < 1e-12,
                        "{filter}"
                    );
                }
                let h = 1e-6;
                for k in 0..3 {
                    let step = |s: f64| form.value(three(|i| at[i] + if i == k { s } else { 0.0 }));
                    let slope = (step(h) - step(-h)) / (2.0 * h);
                    assert!((slope - form.gradient(at)[k]).abs() < 1e-4, "{filter}");
                }
            }
        }
    }

    #[test]
    fn the_polynomial_along_a_ray_is_the_field() {
        let grid = noise([5, 6, 7]);
        for name in Filter::NAMES {
            let filter: Filter = name.parse().unwrap();
            let volume = Volume::new(&grid, filter).unwrap();
            match filter.basis().degree {
                1 => check(filter, &volume, Linear::new(&volume)),
                2 => check(filter, &volume, Smooth::<3>(&volume)),
                _ => check(filter, &volume, Smooth::<4>(&volume)),
            }
        }
    }

    /// One sample among zeros: the piece goes below all of its samples, and its Bernstein coefficients tell.
    #[test]
    fn negative_lobes_leave_the_range_of_the_samples() {
        let mut s = vec![0.0f32; 343];
        s[3 + 7 * (3 + 7 * 3)] = 1.0;
        let volume = Volume::new(&Grid::unit([7; 3], Samples::F32(s.into())).unwrap(), Filter::Bc21).unwrap();
        let form = Smooth::<4>(&volume);
        let v = form.value([1.5, 3.0, 3.0]);
        assert!((v + 1.0 / 108.0).abs() < 1e-12, "k(1.5) k(0)^2 = {v}");
        form.ranges([1, 3, 3], [1, 3, 3], |_, lo, hi| assert!(lo <= v && hi > 0.0 && lo > -1.0));
    }
}
