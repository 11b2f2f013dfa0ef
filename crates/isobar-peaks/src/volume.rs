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

mod linear;
mod smooth;

pub(crate) use linear::Linear;
pub(crate) use smooth::Smooth;

use crate::filter::{Filter, rows};
use crate::interval::Bands;
use crate::macrocells::bit;
use crate::space::{Space, U, three};
use glam::DVec3;
use isobar_core::{DataError, Grid, Stage};
use isobar_cpu::packet::{LANES, Lanes};
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
    /// Of the coefficients along a row of four cells, by index, in the Bernstein coefficients of all four: see [`Smooth::extremes`].
    spread: [[f64; ROW]; 7],
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
            spread: spread(filter),
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
    /// [`Form::value`] at the first `n` of eight points, to the bit; the other lanes mean nothing.
    #[inline(always)]
    fn values<S: Lanes>(self, at: [S; 3], n: usize) -> S {
        let at = stored(at);
        let mut out = [0.0; LANES];
        for (l, v) in out.iter_mut().enumerate().take(n) {
            *v = self.value(three(|a| at[a][l]));
        }
        S::load(&out)
    }
    /// [`Form::compose`] for the first `n` of eight cells, to the bit; the other lanes mean nothing.
    #[inline(always)]
    fn composed<S: Lanes>(self, cells: &[[i32; LANES]; 3], ends: [[S; 3]; 2], reference: f64, n: usize, out: &mut [S; MOST]) {
        let [a, b] = [stored(ends[0]), stored(ends[1])];
        let mut all = [[0.0; LANES]; MOST];
        for l in 0..n {
            let mut p = [0.0; MOST];
            self.compose(
                three(|i| cells[i][l]),
                three(|i| a[i][l]),
                three(|i| b[i][l]),
                reference,
                &mut p,
            );
            for (all, p) in all.iter_mut().zip(&p).take(Self::COUNT) {
                all[l] = *p;
            }
        }
        for (out, all) in out.iter_mut().zip(&all) {
            *out = S::load(all);
        }
    }
    /// Which cells of a box of at most 4^3 cells, whose first cell's indices are multiples of four, have a value of `wanted`: their [`bit`]s.
    #[inline(always)]
    fn visible(self, lo: [i32; 3], hi: [i32; 3], wanted: &Bands) -> u64 {
        let (least, most) = self.extremes(lo, hi);
        wanted.bits(&least, &most).0 & bits_of(lo, hi)
    }
    /// Bounds of the field on each cell of such a box, by the [`bit`] of its place in the box. Of cells beyond it: anything.
    fn extremes(self, lo: [i32; 3], hi: [i32; 3]) -> ([f32; 64], [f32; 64]);
    /// The same, handed on cell by cell, x fastest.
    #[inline(always)]
    fn ranges(self, lo: [i32; 3], hi: [i32; 3], mut each: impl FnMut([i32; 3], f64, f64)) {
        let (least, most) = self.extremes(lo, hi);
        for k in lo[2]..=hi[2] {
            for j in lo[1]..=hi[1] {
                for i in lo[0]..=hi[0] {
                    let at = bit([i - lo[0], j - lo[1], k - lo[2]]) as usize;
                    each([i, j, k], least[at].into(), most[at].into());
                }
            }
        }
    }
}

/// The [`bit`]s of the cells of a box of at most 4^3 cells, from its first on.
#[inline(always)]
pub(crate) fn bits_of(lo: [i32; 3], hi: [i32; 3]) -> u64 {
    let n = three(|a| (hi[a] - lo[a] + 1) as u32);
    let rows = (0..n[1]).fold(0u64, |m, j| m | ((1 << n[0]) - 1) << (4 * j));
    (0..n[2]).fold(0u64, |m, k| m | rows << (16 * k))
}

/// Cell and local coordinates of a point, clamped to the domain.
#[inline(always)]
fn locate(space: &Space, at: [f64; 3]) -> ([i32; 3], [f64; 3]) {
    let x = three(|a| at[a].max(space.lo[a]).min(space.hi[a]));
    let cell = three(|a| (x[a] as i32).min(space.cells[a] - 1));
    (cell, three(|a| x[a] - f64::from(cell[a])))
}

/// [`locate`] for eight points.
#[inline(always)]
fn locate_eight<S: Lanes>(space: &Space, at: [S; 3]) -> ([[i32; LANES]; 3], [S; 3]) {
    let mut cells = [[0; LANES]; 3];
    let mut x = at;
    for a in 0..3 {
        x[a] = at[a].max(S::splat(space.lo[a])).min(S::splat(space.hi[a]));
    }
    let inside = stored(x);
    let mut whole = [[0.0; LANES]; 3];
    for a in 0..3 {
        let last = space.cells[a] - 1;
        for l in 0..LANES {
            cells[a][l] = (inside[a][l] as i32).min(last);
            whole[a][l] = f64::from(cells[a][l]);
        }
    }
    for a in 0..3 {
        x[a] = x[a].sub(S::load(&whole[a]));
    }
    (cells, x)
}

/// Lanes as arrays, per axis.
#[inline(always)]
pub(crate) fn stored<S: Lanes>(x: [S; 3]) -> [[f64; LANES]; 3] {
    let mut out = [[0.0; LANES]; 3];
    for (x, out) in x.iter().zip(&mut out) {
        x.store(out);
    }
    out
}

/// Places for the Bernstein coefficients along four cells: 13 of degree 3, 9 of degree 2.
const ROW: usize = 16;

/// Bernstein coefficients along a row of four cells from coefficients of the field: `[j][l]` is the weight of coefficient j in Bernstein coefficient l, l % degree of cell
/// l / degree; the last of a cell is the first of the next.
fn spread(filter: Filter) -> [[f64; ROW]; 7] {
    let (p, n) = (filter.points(), filter.basis().degree);
    let mut out = [[0.0; ROW]; 7];
    for l in 0..=4 * n {
        let cell = (l / n).min(3);
        for j in 0..=n {
            out[cell + j][l] = p[l - cell * n][j];
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::filter::binomial;
    use isobar_core::{Function, Samples};

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
