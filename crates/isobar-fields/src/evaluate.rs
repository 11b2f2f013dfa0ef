//! Value and gradient of a tensor-product B-spline at a point, in f64, for any coefficient type.

use crate::Border;
use glam::DVec3;

/// The basis functions of one axis on a cell, `W = degree + 1` of them.
trait Weights<const W: usize> {
    /// Cells are centred on samples.
    const CENTRED: bool;
    /// Values at `w` in [0, 1]; they sum to one.
    fn value(w: f64) -> [f64; W];
    /// Derivatives at `w`; they sum to zero.
    fn slope(w: f64) -> [f64; W];
}

struct Linear;
struct Quadratic;
struct Cubic;

impl Weights<2> for Linear {
    const CENTRED: bool = false;
    #[inline]
    fn value(w: f64) -> [f64; 2] {
        [1.0 - w, w]
    }
    #[inline]
    fn slope(_: f64) -> [f64; 2] {
        [-1.0, 1.0]
    }
}

impl Weights<3> for Quadratic {
    const CENTRED: bool = true;
    #[inline]
    fn value(w: f64) -> [f64; 3] {
        let v = 1.0 - w;
        [0.5 * v * v, 0.5 + w * v, 0.5 * w * w]
    }
    #[inline]
    fn slope(w: f64) -> [f64; 3] {
        [w - 1.0, 1.0 - 2.0 * w, w]
    }
}

impl Weights<4> for Cubic {
    const CENTRED: bool = false;
    #[inline]
    fn value(w: f64) -> [f64; 4] {
        const SIXTH: f64 = 1.0 / 6.0;
        let v = 1.0 - w;
        let (ww, vv) = (w * w, v * v);
        // 3w^3 - 6w^2 + 4 = 4 - 3 w^2 (1 + v), and its mirror image.
        [
            SIXTH * vv * v,
            SIXTH * (4.0 - 3.0 * ww * (1.0 + v)),
            SIXTH * (4.0 - 3.0 * vv * (1.0 + w)),
            SIXTH * ww * w,
        ]
    }
    #[inline]
    fn slope(w: f64) -> [f64; 4] {
        let v = 1.0 - w;
        [-0.5 * v * v, w * (1.5 * w - 2.0), v * (2.0 - 1.5 * v), 0.5 * w * w]
    }
}

/// Cell of a local coordinate `u` in [0, n-1], `n >= 2`, and the position in it.
#[inline]
pub(crate) fn locate(u: f64, n: usize, centred: bool) -> (usize, f64) {
    // `as` sends NaN to 0; coordinates are clamped before, so nothing is out of range. Signed, because that is one instruction each way.
    let n = n as i64;
    if centred {
        let i = ((u + 0.5) as i64).min(n - 1);
        (i as usize, (u - i as f64) + 0.5)
    } else {
        let i = (u as i64).min(n - 2);
        (i as usize, u - i as f64)
    }
}

/// A lattice of coefficients with its border rule.
#[derive(Clone, Copy)]
pub(crate) struct Coefs<'a, T> {
    pub(crate) c: &'a [T],
    pub(crate) dims: [usize; 3],
    pub(crate) border: Border,
}

impl<T: Copy + Into<f64>> Coefs<'_, T> {
    /// s at local `u` (inside the domain), degree 1, 2 or 3.
    #[inline]
    pub(crate) fn value(self, degree: usize, u: DVec3) -> f64 {
        match degree {
            1 => self.sum::<2, Linear>(u),
            2 => self.sum::<3, Quadratic>(u),
            _ => self.sum::<4, Cubic>(u),
        }
    }

    /// Local gradient of s at `u`.
    #[inline]
    pub(crate) fn gradient(self, degree: usize, u: DVec3) -> DVec3 {
        match degree {
            1 => self.sum_gradient::<2, Linear>(u),
            2 => self.sum_gradient::<3, Quadratic>(u),
            _ => self.sum_gradient::<4, Cubic>(u),
        }
    }

    #[inline]
    fn sum<const W: usize, B: Weights<W>>(self, u: DVec3) -> f64 {
        let at = [0, 1, 2].map(|a| locate(u[a], self.dims[a], B::CENTRED));
        let [wx, wy, wz] = at.map(|(_, w)| B::value(w));
        let mut s = 0.0;
        self.rows::<W>(at.map(|(i, _)| i), |j, k, row| {
            let mut r = 0.0;
            for i in 0..W {
                r += wx[i] * row[i];
            }
            s += wy[j] * wz[k] * r;
        });
        s
    }

    #[inline]
    fn sum_gradient<const W: usize, B: Weights<W>>(self, u: DVec3) -> DVec3 {
        let at = [0, 1, 2].map(|a| locate(u[a], self.dims[a], B::CENTRED));
        let [wx, wy, wz] = at.map(|(_, w)| B::value(w));
        let [dx, dy, dz] = at.map(|(_, w)| B::slope(w));
        let mut g = DVec3::ZERO;
        self.rows::<W>(at.map(|(i, _)| i), |j, k, row| {
            let (mut r, mut d) = (0.0, 0.0);
            for i in 0..W {
                r += wx[i] * row[i];
                d += dx[i] * row[i];
            }
            g += DVec3::new(wy[j] * wz[k] * d, dy[j] * wz[k] * r, wy[j] * dz[k] * r);
        });
        g
    }

    /// Calls `f(j, k, row)` for the `W * W` rows of `W` coefficients of a cell's stencil, x then y fastest.
    #[inline]
    pub(crate) fn rows<const W: usize>(self, cell: [usize; 3], mut f: impl FnMut(usize, usize, [f64; W])) {
        let Self { c, dims, border } = self;
        let before = (W - 1) / 2;
        let inside = (0..3).all(|a| cell[a] >= before && cell[a] - before + W <= dims[a]);
        if inside {
            let [i0, j0, k0] = cell.map(|i| i - before);
            for k in 0..W {
                for j in 0..W {
                    let start = ((k0 + k) * dims[1] + j0 + j) * dims[0] + i0;
                    let row = &c[start..start + W];
                    f(j, k, std::array::from_fn(|i| row[i].into()));
                }
            }
        } else {
            let index: [[usize; W]; 3] =
                std::array::from_fn(|a| std::array::from_fn(|i| border.index((cell[a] + i) as isize - before as isize, dims[a])));
            for k in 0..W {
                for j in 0..W {
                    let start = (index[2][k] * dims[1] + index[1][j]) * dims[0];
                    f(j, k, std::array::from_fn(|i| c[start + index[0][i]].into()));
                }
            }
        }
    }

    /// Least and greatest coefficient with indices in the closed box `lo..=hi`.
    pub(crate) fn range(self, lo: [usize; 3], hi: [usize; 3]) -> (f64, f64)
    where
        T: PartialOrd,
    {
        // Eight running extrema, so that rows are compared without a chain of dependent steps.
        const LANES: usize = 8;
        let [nx, ny, _] = self.dims;
        let first = self.c[(lo[2] * ny + lo[1]) * nx + lo[0]];
        let (mut least, mut greatest) = ([first; LANES], [first; LANES]);
        let mut take = |l: usize, v: T| {
            least[l] = if v < least[l] { v } else { least[l] };
            greatest[l] = if v > greatest[l] { v } else { greatest[l] };
        };
        for k in lo[2]..=hi[2] {
            for j in lo[1]..=hi[1] {
                let row = (k * ny + j) * nx;
                let (chunks, rest) = self.c[row + lo[0]..=row + hi[0]].as_chunks::<LANES>();
                for chunk in chunks {
                    for (l, &v) in chunk.iter().enumerate() {
                        take(l, v);
                    }
                }
                for (l, &v) in rest.iter().enumerate() {
                    take(l, v);
                }
            }
        }
        let down = |a: T, &b: &T| if b < a { b } else { a };
        let up = |a: T, &b: &T| if b > a { b } else { a };
        (least.iter().fold(first, down).into(), greatest.iter().fold(first, up).into())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use isobar_core::{Basis1, CUBIC, QUADRATIC, TRILINEAR};

    /// The closed forms agree with the integer matrices.
    fn check<const W: usize, B: Weights<W>>(b: &Basis1) {
        for n in 0..=64 {
            let w = f64::from(n) / 64.0;
            let (v, d) = (B::value(w), B::slope(w));
            for j in 0..W {
                let m = |k: usize| f64::from(b.matrix[k][j]) / f64::from(b.denominator);
                let value = m(0) + w * (m(1) + w * (m(2) + w * m(3)));
                let slope = m(1) + w * (2.0 * m(2) + w * 3.0 * m(3));
                assert!((v[j] - value).abs() < 4e-16, "value degree {} weight {j} at {w}", b.degree);
                assert!(
                    (d[j] - slope).abs() < 8e-16,
                    "slope degree {} weight {j} at {w}: {} {slope}",
                    b.degree,
                    d[j]
                );
            }
            assert!((v.iter().sum::<f64>() - 1.0).abs() < 4e-16);
            assert!(d.iter().sum::<f64>().abs() < 4e-16);
        }
    }

    #[test]
    fn weights_follow_the_basis() {
        check::<2, Linear>(&TRILINEAR);
        check::<3, Quadratic>(&QUADRATIC);
        check::<4, Cubic>(&CUBIC);
    }
}
