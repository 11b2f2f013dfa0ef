//! Values and partial derivatives at several points at once: the pixels of a piece in the lanes of a vector.
//!
//! Coefficients are the same for all pixels and stand in every lane; what differs are the Bernstein polynomials. The sums are those of [`crate::bernstein::jet`] in the same order, so the
//! same bounds of roundings hold.

use crate::bernstein::Point;

/// Points that are evaluated together.
pub(crate) const WIDE: usize = 8;

/// One number for each point.
type Wide = [f64; WIDE];

/// Values and partial derivatives at [`WIDE`] points: `[derivative][channel][point]`, the value first.
pub(crate) struct Jets {
    points: [[Wide; 4]; 4],
    values: [[Wide; 1]; 4],
}

/// Bernstein polynomials of degree N - 1 along an axis, and their derivatives.
type Bases<const N: usize> = ([Wide; N], [Wide; N]);

#[inline(always)]
fn basis<const N: usize>(x: &Wide) -> Bases<N> {
    let (mut b, mut d) = ([[0.0; WIDE]; N], [[0.0; WIDE]; N]);
    for i in 0..WIDE {
        let (x, y) = (x[i], 1.0 - x[i]);
        match N {
            2 => {
                (b[0][i], b[1][i]) = (y, x);
                (d[0][i], d[1][i]) = (-1.0, 1.0);
            }
            3 => {
                (b[0][i], b[1][i], b[2][i]) = (y * y, 2.0 * (x * y), x * x);
                (d[0][i], d[1][i], d[2][i]) = (-2.0 * y, 2.0 * (y - x), 2.0 * x);
            }
            _ => {
                let (xx, xy, yy) = (x * x, 2.0 * (x * y), y * y);
                (b[0][i], b[1][i], b[2][i], b[3][i]) = (yy * y, 3.0 * (x * yy), 3.0 * (xx * y), xx * x);
                (d[0][i], d[1][i], d[2][i], d[3][i]) = (-3.0 * yy, 3.0 * (yy - xy), 3.0 * (xy - xx), 3.0 * xx);
            }
        }
    }
    (b, d)
}

/// `sum[channel] += k * add[channel]`, point by point.
#[inline(always)]
fn add<const C: usize>(sum: &mut [Wide; C], k: &Wide, add: &[Wide; C]) {
    for c in 0..C {
        for i in 0..WIDE {
            sum[c][i] += k[i] * add[c][i];
        }
    }
}

/// The form with these coefficients, N along each axis (2, 3 or 4).
#[inline(always)]
fn jets<const N: usize, const C: usize>(c: &[[f64; C]], u: &[Wide; 3], out: &mut [[Wide; C]; 4]) {
    let [(bu, du), (bv, dv), (bw, dw)] = [basis::<N>(&u[0]), basis::<N>(&u[1]), basis::<N>(&u[2])];
    let zero = [[0.0; WIDE]; C];
    *out = [zero; 4];
    for (k, plane) in c[..N * N * N].chunks_exact(N * N).enumerate() {
        let (mut s, mut su, mut sv) = (zero, zero, zero);
        for (j, line) in plane.chunks_exact(N).enumerate() {
            let (mut v, mut g) = (zero, zero);
            for n in 0..N {
                for l in 0..C {
                    for i in 0..WIDE {
                        v[l][i] += bu[n][i] * line[n][l];
                        g[l][i] += du[n][i] * line[n][l];
                    }
                }
            }
            add(&mut s, &bv[j], &v);
            add(&mut su, &bv[j], &g);
            add(&mut sv, &dv[j], &v);
        }
        add(&mut out[0], &bw[k], &s);
        add(&mut out[1], &bw[k], &su);
        add(&mut out[2], &bw[k], &sv);
        add(&mut out[3], &dw[k], &s);
    }
}

impl Jets {
    #[inline(always)]
    pub(crate) const fn new() -> Self {
        Self {
            points: [[[0.0; WIDE]; 4]; 4],
            values: [[[0.0; WIDE]; 1]; 4],
        }
    }

    /// At the parameters `at(0)` to `at(7)`; false, and nothing done, where the degrees are not 1, 2 or 3 along all axes.
    #[inline(always)]
    pub(crate) fn fill(
        &mut self,
        g: [usize; 3],
        points: &[Point],
        h: [usize; 3],
        values: &[f64],
        at: impl Fn(usize) -> [f64; 3],
    ) -> bool {
        let even = |d: [usize; 3]| (1..=3).contains(&d[0]) && d == [d[0]; 3];
        if !even(g) || !even(h) {
            return false;
        }
        let all: [[f64; 3]; WIDE] = std::array::from_fn(at);
        let u: [Wide; 3] = std::array::from_fn(|a| std::array::from_fn(|i| all[i][a]));
        match g[0] {
            1 => jets::<2, 4>(points, &u, &mut self.points),
            2 => jets::<3, 4>(points, &u, &mut self.points),
            _ => jets::<4, 4>(points, &u, &mut self.points),
        }
        let values = values.as_chunks::<1>().0;
        match h[0] {
            1 => jets::<2, 1>(values, &u, &mut self.values),
            2 => jets::<3, 1>(values, &u, &mut self.values),
            _ => jets::<4, 1>(values, &u, &mut self.values),
        }
        true
    }

    /// Those of one point.
    #[inline(always)]
    pub(crate) fn get(&self, i: usize) -> ([Point; 4], [f64; 4]) {
        (
            std::array::from_fn(|d| std::array::from_fn(|c| self.points[d][c][i])),
            std::array::from_fn(|d| self.values[d][0][i]),
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bernstein::{bases, count, jet};

    #[test]
    fn points_together_are_points_one_by_one() {
        for (g, h) in [([3; 3], [1; 3]), ([2; 3], [3; 3]), ([1; 3], [2; 3])] {
            let points: Vec<Point> = (0..count(g))
                .map(|i| [0, 1, 2, 3].map(|l| ((i * i * 7 + 5 * l) % 23) as f64 - 9.0))
                .collect();
            let values: Vec<f64> = (0..count(h)).map(|i| ((i * i * 5) % 19) as f64 - 7.0).collect();
            let at = |i: usize| [0, 1, 2].map(|a| ((i * (a + 3)) % 8) as f64 / 7.0);
            let mut all = Jets::new();
            assert!(all.fill(g, &points, h, &values, at));
            for i in 0..WIDE {
                let own = (jet(g, &points, &bases(g, at(i))), jet(h, &values, &bases(h, at(i))));
                assert_eq!(all.get(i), own, "{g:?} {h:?} point {i}");
            }
        }
        let uneven = [2, 1, 1];
        assert!(!Jets::new().fill(uneven, &[[0.0; 4]; 12], [1; 3], &[0.0; 8], |_| [0.5; 3]));
    }
}
