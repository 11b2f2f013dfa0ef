//! The two B-splines, and the polynomial a ray meets in a cell.
//!
//! Steinberger 2010, sections 3.1.2 and 3.3.2, composes f(r(t)) from the polynomial of the cell. Different here: the spline is evaluated at
//! 3d + 1 fixed places of the segment, all at once in the lanes of a vector, and the Bernstein coefficients are a fixed matrix times
//! these values. That is 64 + 16 + 4 products of vectors with no shuffle among lanes (degree 3), against some 700 scalar ones for a
//! composition by products of polynomials. The matrices of the B-splines are those of the correction (maths: corrections, section B).
//!
//! **Scale.** Weights are those of the B-spline times 2 or 6, so values and coefficients are [`Spline::SCALE`] = 8 or 216 times too large: no
//! sign and no root depends on it.
//!
//! **Bound.** u the unit roundoff, m the greatest |coefficient - c| of the stencil; all relative to the scale. The position of a place, (1 - x) a + x b,
//! carries 4u per axis; s changes by at most 2m per unit of an axis (a B-spline's derivative has the differences of coefficients as its own): 24 um.
//! Weights times 6: v^3 and w^3 carry at most 5u, 4 - 3v^2(1+w) = 4 - v^2(6-3v) 22u, and what is left to 6 the sum of those and
//! 3 * 6u: together at most 78u of 6, 13u for each axis, 39 um; quadratic ones carry less. Sums of four products thrice: 14 um. Subtracting c:
//! at most 3 um. A value is thus off by less than 80 um; the bound doubles that to 160 um, for terms of second order. A coefficient is a row of the
//! matrix times the values: that multiplies the error by the greatest row sum of absolute values, [`spread`], and rounds the sum of
//! products by at most (3d + 3)um times [`spread`]; within the doubled part. So **160 u m [`spread`]** bounds the error of a coefficient,
//! given the exact ends a and b of the segment.

use super::vector::{Isa, Real, Vector};

/// A uniform tensor-product B-spline, as the caster uses it.
pub(crate) trait Spline: Copy + std::fmt::Debug + Send + Sync + 'static {
    /// Polynomial degree per axis.
    const DEGREE: usize;
    /// Cells are centred on samples; index space is then shifted by a half, so that cell i spans [i, i + 1] in either case.
    const CENTRED: bool;
    /// Places on a segment: 3 degree + 1.
    const PLACES: usize;
    /// All values are this much too large.
    const SCALE: f64;
    /// 256 times the places, about those of Chebyshev and Lobatto: dyadic, so that they and their distances from 1 are exact.
    const AT: &'static [u16];
    /// Vectors of at least that many lanes.
    type Single<I: Isa>: Vector<Scalar = f32>;
    /// As [`Spline::Single`].
    type Double<I: Isa>: Vector<Scalar = f64>;
    /// Weights of the `degree + 1` coefficients at w in [0, 1], times the cube root of the scale; the rest is not used.
    fn weights<V: Vector>(w: V) -> [V; 4];
    /// Derivatives of the weights.
    fn slopes(w: f64) -> [f64; 4];
    /// The first `degree` Bernstein points, along one axis, of the cell whose first three coefficients these are. (The last point is the first of the
    /// next cell.)
    fn points<V: Vector<Scalar = f32>>(below: V, at: V, above: V) -> [V; 3];
}

/// Degree 2.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Quadratic;

/// Degree 3.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Cubic;

#[inline(always)]
fn splat<V: Vector>(x: f64) -> V {
    V::splat(V::Scalar::of(x))
}

impl Spline for Quadratic {
    const DEGREE: usize = 2;
    const CENTRED: bool = true;
    const PLACES: usize = 7;
    const SCALE: f64 = 8.0;
    const AT: &'static [u16] = &[0, 17, 64, 128, 192, 239, 256];
    type Single<I: Isa> = I::Single8;
    type Double<I: Isa> = I::Double8;

    #[inline(always)]
    fn weights<V: Vector>(w: V) -> [V; 4] {
        let v = splat::<V>(1.0).sub(w);
        let (low, high) = (v.mul(v), w.mul(w));
        [low, splat::<V>(2.0).sub(low).sub(high), high, high]
    }

    #[inline(always)]
    fn slopes(w: f64) -> [f64; 4] {
        [2.0 * w - 2.0, 2.0 - 4.0 * w, 2.0 * w, 0.0]
    }

    #[inline(always)]
    fn points<V: Vector<Scalar = f32>>(below: V, at: V, _: V) -> [V; 3] {
        let first = below.add(at).mul(splat::<V>(0.5));
        [first, at, at]
    }
}

impl Spline for Cubic {
    const DEGREE: usize = 3;
    const CENTRED: bool = false;
    const PLACES: usize = 10;
    const SCALE: f64 = 216.0;
    const AT: &'static [u16] = &[0, 8, 30, 64, 106, 150, 192, 226, 248, 256];
    type Single<I: Isa> = I::Single16;
    type Double<I: Isa> = I::Double16;

    #[inline(always)]
    fn weights<V: Vector>(w: V) -> [V; 4] {
        let v = splat::<V>(1.0).sub(w);
        let (ww, vv) = (w.mul(w), v.mul(v));
        let (first, last) = (vv.mul(v), ww.mul(w));
        let third = splat::<V>(4.0).sub(vv.mul(splat::<V>(6.0).sub(v.mul(splat(3.0)))));
        [first, splat::<V>(6.0).sub(first).sub(last).sub(third), third, last]
    }

    #[inline(always)]
    fn slopes(w: f64) -> [f64; 4] {
        let v = 1.0 - w;
        [-3.0 * v * v, w * (9.0 * w - 12.0), v * (12.0 - 9.0 * v), 3.0 * w * w]
    }

    #[inline(always)]
    fn points<V: Vector<Scalar = f32>>(below: V, at: V, above: V) -> [V; 3] {
        let (sixth, third, more) = (splat::<V>(1.0 / 6.0), splat::<V>(1.0 / 3.0), splat::<V>(2.0 / 3.0));
        let (lower, upper) = (at.mul(more), above.mul(third));
        [
            below.add(above).mul(sixth).add(lower),
            lower.add(upper),
            at.mul(third).add(above.mul(more)),
        ]
    }
}

/// Most places, and lanes of the tables.
pub(crate) const LANES: usize = 16;

/// Bernstein coefficients of the polynomials that are 1 at one place and 0 at the others: `[place][coefficient]`, each rounded three times. Unused
/// lanes repeat the first coefficient, unused places are zero.
const fn inverse(at: &[u16]) -> [[f64; LANES]; 10] {
    let n = at.len();
    let mut out = [[0.0; LANES]; 10];
    let mut l = 0;
    while l < n {
        // Scaled Bernstein coefficients of the product of (x - x_k), times 256^(n-1): integers below 2^80.
        let mut p = [0i128; 10];
        p[0] = 1;
        let (mut denominator, mut degree, mut k) = (1i128, 0, 0);
        while k < n {
            if k != l {
                let x = at[k] as i128;
                degree += 1;
                let mut i = degree;
                while i > 0 {
                    p[i] = p[i - 1] * (256 - x) - p[i] * x;
                    i -= 1;
                }
                p[0] *= -x;
                denominator *= at[l] as i128 - x;
            }
            k += 1;
        }
        let (mut binomial, mut i) = (1i128, 0);
        while i < n {
            out[l][i] = p[i] as f64 / (denominator * binomial) as f64;
            binomial = binomial * (degree - i) as i128 / (i as i128 + 1);
            i += 1;
        }
        while i < LANES {
            out[l][i] = out[l][0];
            i += 1;
        }
        l += 1;
    }
    out
}

/// Greatest row sum of |matrix|: how much the coefficients can exceed the values.
const fn spread(matrix: &[[f64; LANES]; 10]) -> f64 {
    let (mut most, mut i) = (0.0, 0);
    while i < LANES {
        let (mut sum, mut l) = (0.0, 0);
        while l < 10 {
            sum += matrix[l][i].abs();
            l += 1;
        }
        if sum > most {
            most = sum;
        }
        i += 1;
    }
    most
}

const QUADRATIC: [[f64; LANES]; 10] = inverse(Quadratic::AT);
const CUBIC: [[f64; LANES]; 10] = inverse(Cubic::AT);

/// What [`Table::compose`] needs besides the cell, in one precision.
#[derive(Debug, Clone, Copy)]
#[repr(align(64))]
pub(crate) struct Table<R> {
    matrix: [[R; LANES]; 10],
    /// 1 - x and x of the places.
    low: [R; LANES],
    high: [R; LANES],
}

/// 160 [`spread`] of the spline: times u and m the error of a coefficient.
pub(crate) const fn growth<S: Spline>() -> f64 {
    160.0 * spread(if S::DEGREE == 2 { &QUADRATIC } else { &CUBIC })
}

impl<R: Real> Table<R> {
    pub(crate) fn new<S: Spline>() -> Self {
        let matrix = if S::DEGREE == 2 { QUADRATIC } else { CUBIC };
        let place = |l: usize| f64::from(S::AT.get(l).copied().unwrap_or(0)) / 256.0;
        Self {
            matrix: matrix.map(|row| row.map(R::of)),
            low: std::array::from_fn(|l| R::of(1.0 - place(l))),
            high: std::array::from_fn(|l| R::of(place(l))),
        }
    }

    /// Bernstein coefficients, times the scale, of the spline with coefficients `d` (x fastest, `degree + 1` per axis) along the segment from
    /// local `a` to local `b`. Lanes beyond the coefficients repeat the first.
    #[expect(clippy::needless_range_loop, reason = "several arrays by one index, unrolled")]
    #[inline(always)]
    pub(crate) fn compose<S: Spline, V: Vector<Scalar = R>>(&self, d: &[R; 64], a: [R; 3], b: [R; 3]) -> V {
        // No closures here: those the compiler does not inline are compiled without the vectors' instructions.
        let (low, high) = (V::load(&self.low), V::load(&self.high));
        let x = S::weights(high.times_plus(V::splat(b[0]), low.mul(V::splat(a[0]))));
        let y = S::weights(high.times_plus(V::splat(b[1]), low.mul(V::splat(a[1]))));
        let z = S::weights(high.times_plus(V::splat(b[2]), low.mul(V::splat(a[2]))));
        let n = S::DEGREE + 1;
        let mut s = V::splat(R::of(0.0));
        for k in 0..n {
            let mut plane = V::splat(R::of(0.0));
            for j in 0..n {
                let row = &d[(k * n + j) * n..][..n];
                let mut sum = x[0].mul(V::splat(row[0]));
                for i in 1..n {
                    sum = x[i].times_plus(V::splat(row[i]), sum);
                }
                plane = if j == 0 { y[j].mul(sum) } else { y[j].times_plus(sum, plane) };
            }
            s = if k == 0 { z[k].mul(plane) } else { z[k].times_plus(plane, s) };
        }
        let mut values = [R::of(0.0); LANES];
        s.store(&mut values);
        // Two sums, so that they need not wait for each other.
        let mut even = V::splat(values[0]).mul(V::load(&self.matrix[0]));
        let mut odd = V::splat(values[1]).mul(V::load(&self.matrix[1]));
        for l in 2..S::PLACES {
            let (value, row) = (V::splat(values[l]), V::load(&self.matrix[l]));
            if l % 2 == 0 {
                even = value.times_plus(row, even);
            } else {
                odd = value.times_plus(row, odd);
            }
        }
        even.add(odd)
    }
}

/// Gradient per cell of the spline with coefficients `d` at local `x`, to some ulps of the greatest coefficient; not scaled.
#[inline(always)]
pub(crate) fn gradient<S: Spline>(d: &[f64; 64], x: [f64; 3]) -> [f64; 3] {
    let n = S::DEGREE + 1;
    let value = |axis: usize| S::weights(super::vector::one(x[axis])).map(super::vector::only);
    let (vx, vy, vz) = (value(0), value(1), value(2));
    let [dx, dy, dz] = [S::slopes(x[0]), S::slopes(x[1]), S::slopes(x[2])];
    let mut g = [0.0; 3];
    for k in 0..n {
        for j in 0..n {
            let row = &d[(k * n + j) * n..][..n];
            let (mut r, mut s) = (0.0, 0.0);
            for i in 0..n {
                r += vx[i] * row[i];
                s += dx[i] * row[i];
            }
            g[0] += vy[j] * vz[k] * s;
            g[1] += dy[j] * vz[k] * r;
            g[2] += vy[j] * dz[k] * r;
        }
    }
    g.map(|v| v / S::SCALE)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::smooth::vector::{Portable, Register};
    use isobar_core::Basis1;

    /// The weights and their slopes are those of the corrected matrices (maths B), which isobar-core holds as integers.
    fn follows<S: Spline>(basis: &Basis1) {
        let root = S::SCALE.cbrt().round();
        for n in 0..=32 {
            let w = f64::from(n) / 32.0;
            let v = S::weights(crate::smooth::vector::one(w)).map(crate::smooth::vector::only);
            let d = S::slopes(w);
            for j in 0..=S::DEGREE {
                let m = |k: usize| f64::from(basis.matrix[k][j]) / f64::from(basis.denominator) * root;
                let value = m(0) + w * (m(1) + w * (m(2) + w * m(3)));
                let slope = m(1) + w * (2.0 * m(2) + w * 3.0 * m(3));
                assert!(
                    (v[j] - value).abs() < 1e-14 && (d[j] - slope).abs() < 1e-14,
                    "degree {} weight {j} at {w}",
                    S::DEGREE
                );
            }
        }
    }

    #[test]
    fn weights_follow_the_basis() {
        follows::<Quadratic>(&isobar_core::QUADRATIC);
        follows::<Cubic>(&isobar_core::CUBIC);
    }

    /// Values of Bernstein polynomials at the places times the matrix: the identity.
    #[test]
    fn matrices_invert_evaluation() {
        for (at, m) in [(Quadratic::AT, &QUADRATIC), (Cubic::AT, &CUBIC)] {
            let n = at.len();
            for i in 0..n {
                for j in 0..n {
                    let sum: f64 = at
                        .iter()
                        .zip(m.iter())
                        .map(|(&place, row)| {
                            let x = f64::from(place) / 256.0;
                            let choose = (0..j).fold(1.0, |c, k| c * (n - 1 - k) as f64 / (k + 1) as f64);
                            row[i] * choose * x.powi(j as i32) * (1.0 - x).powi((n - 1 - j) as i32)
                        })
                        .sum();
                    assert!((sum - f64::from(u8::from(i == j))).abs() < 1e-11, "{i}, {j}: {sum}");
                }
            }
        }
        let (q, c) = (spread(&QUADRATIC), spread(&CUBIC));
        assert!(
            q > 1.0 && q < 60.0 && c > q && c < 900.0,
            "{q}, {c}: about the condition of the Bernstein basis"
        );
    }

    /// Against Bernstein coefficients worked out from the polar form in f64, within the stated bound and not absurdly below it.
    fn composes<S: Spline>() {
        let mut seed = 7u64;
        let mut unit = || {
            seed = seed
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (seed >> 11) as f64 / (1u64 << 53) as f64
        };
        let (single, double) = (Table::<f32>::new::<S>(), Table::<f64>::new::<S>());
        let mut worst = [0.0f64; 2];
        for _ in 0..2000 {
            let d: [f64; 64] = std::array::from_fn(|_| f64::from((unit() * 2.0 - 1.0) as f32));
            let a: [f64; 3] = std::array::from_fn(|_| f64::from(unit() as f32));
            let b: [f64; 3] = std::array::from_fn(|_| f64::from(unit() as f32));
            let want = polar::<S>(&d, a, b);
            let m = d.iter().fold(0.0f64, |m, v| m.max(v.abs()));
            let mut got = [0.0; LANES];
            double.compose::<S, S::Double<Portable>>(&d, a, b).store(&mut got);
            let mut rough = [0.0f32; LANES];
            single
                .compose::<S, S::Single<Portable>>(&d.map(|v| v as f32), a.map(|v| v as f32), b.map(|v| v as f32))
                .store(&mut rough);
            for i in 0..S::PLACES {
                let e = (got[i] / S::SCALE - want[i]).abs() / m / (growth::<S>() * f64::EPSILON * 0.5);
                worst[0] = worst[0].max(e);
                let e = (f64::from(rough[i]) / S::SCALE - want[i]).abs() / m / (growth::<S>() * f64::from(f32::EPSILON) * 0.5);
                worst[1] = worst[1].max(e);
            }
        }
        assert!(worst.iter().all(|e| *e < 0.3), "degree {}: {worst:?} of the bound", S::DEGREE);
        assert!(worst[1] > 1e-4, "the bound of degree {} is useless: {worst:?}", S::DEGREE);
    }

    /// Bernstein coefficients along the segment by blossoming: independent of places and matrices.
    fn polar<S: Spline>(d: &[f64; 64], a: [f64; 3], b: [f64; 3]) -> Vec<f64> {
        let (n, degree) = (S::DEGREE + 1, S::DEGREE);
        // Polar weights of one axis at r times b and degree - r times a, by de Boor on unit vectors.
        let weights = |axis: usize, r: usize| {
            let mut w = vec![vec![0.0; n]; n];
            for (j, row) in w.iter_mut().enumerate() {
                row[j] = 1.0;
            }
            for level in 1..=degree {
                let x = if level > degree - r { b[axis] } else { a[axis] };
                let width = (degree - level + 1) as f64;
                w = (0..=degree - level)
                    .map(|j| {
                        let f = (x + (degree - level - j) as f64) / width;
                        (0..n).map(|i| (1.0 - f) * w[j][i] + f * w[j + 1][i]).collect()
                    })
                    .collect();
            }
            w.remove(0)
        };
        let choose = |n: usize, k: usize| (0..k).fold(1.0, |c, i| c * (n - i) as f64 / (i + 1) as f64);
        let mut out = vec![0.0; S::PLACES];
        for r in 0..n * n * n {
            let r = [r % n, r / n % n, r / n / n];
            let w = [weights(0, r[0]), weights(1, r[1]), weights(2, r[2])];
            let v: f64 = (0..n * n * n)
                .map(|i| w[0][i % n] * w[1][i / n % n] * w[2][i / n / n] * d[i])
                .sum();
            let m = r.iter().sum::<usize>();
            let factor: f64 = r.iter().map(|&k| choose(degree, k)).product();
            out[m] += v * factor / choose(3 * degree, m);
        }
        out
    }

    #[test]
    fn compositions_are_within_their_bounds() {
        composes::<Quadratic>();
        composes::<Cubic>();
    }

    /// The gradient is the derivative of the composition: along a short segment, by its end coefficients.
    #[test]
    fn gradients_are_derivatives() {
        fn follows<S: Spline>() {
            let d: [f64; 64] = std::array::from_fn(|i| ((i * 37 + 11) % 64) as f64 / 64.0);
            let x = [0.3, 0.6, 0.9];
            let g = gradient::<S>(&d, x);
            for axis in 0..3 {
                let mut y = x;
                y[axis] += 0.01;
                let b = polar::<S>(&d, x, y);
                let slope = (b[1] - b[0]) * (3 * S::DEGREE) as f64 / 0.01;
                assert!((slope - g[axis]).abs() < 1e-10, "{axis}: {slope} {g:?}");
            }
        }
        follows::<Quadratic>();
        follows::<Cubic>();
    }
}
