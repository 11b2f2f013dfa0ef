//! Degrees 2 and 3: sums of products of the weights of three axes.

use super::{Form, MOST, ROW, Volume, locate};
use crate::interval::outward;
use crate::space::{U, three};
use glam::DVec3;
use isobar_core::Lattice;

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

    /// The coefficients that the cells of a box of at most 4^3 cells use: `[z][y][x]`, zeros beyond.
    #[inline(always)]
    fn coefficients(self, lo: [i32; 3], hi: [i32; 3]) -> [[[f64; 7]; 7]; 7] {
        let mut out = [[[0.0; 7]; 7]; 7];
        // Those of the corner cells are all there are.
        for corner in 0..8usize {
            let away = three(|a| if corner >> a & 1 == 0 { 0 } else { (hi[a] - lo[a]) as usize });
            let s = self.stencil(three(|a| lo[a] + away[a] as i32));
            for k in 0..W {
                for j in 0..W {
                    for i in 0..W {
                        out[away[2] + k][away[1] + j][away[0] + i] = s[(k * W + j) * W + i];
                    }
                }
            }
        }
        out
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

    /// From the Bernstein coefficients, worked out for all cells together, one axis after another: neighbours share those on their face.
    #[inline(always)]
    #[expect(clippy::needless_range_loop, reason = "several arrays by one index, unrolled")]
    fn extremes(self, lo: [i32; 3], hi: [i32; 3]) -> ([f32; 64], [f32; 64]) {
        let c = self.coefficients(lo, hi);
        let spread = &self.0.spread;
        let (count, reach) = (W + 3, 4 * Self::DEGREE + 1);
        // [k][j] rows of Bernstein coefficients along x, then y, then z.
        let mut x = [[[0.0f64; ROW]; 7]; 7];
        for k in 0..count {
            for j in 0..count {
                for i in 0..count {
                    for l in 0..ROW {
                        x[k][j][l] += c[k][j][i] * spread[i][l];
                    }
                }
            }
        }
        let mut y = [[[0.0f64; ROW]; ROW]; 7];
        for k in 0..count {
            for q in 0..reach {
                // The cell it belongs to reaches W coefficients from its own on.
                let first = (q / Self::DEGREE).min(3);
                for j in first..first + W {
                    for l in 0..ROW {
                        y[k][q][l] += x[k][j][l] * spread[j][q];
                    }
                }
            }
        }
        let (mut least, mut most) = ([[[f64::INFINITY; ROW]; ROW]; 4], [[[f64::NEG_INFINITY; ROW]; ROW]; 4]);
        for q in 0..reach {
            let first = (q / Self::DEGREE).min(3);
            for r in 0..reach {
                let mut z = [0.0f64; ROW];
                for k in first..first + W {
                    for l in 0..ROW {
                        z[l] += y[k][r][l] * spread[k][q];
                    }
                }
                let mut extend = |cell: usize| {
                    for l in 0..ROW {
                        least[cell][r][l] = lesser(least[cell][r][l], z[l]);
                        most[cell][r][l] = -lesser(-most[cell][r][l], -z[l]);
                    }
                };
                extend(first);
                // On a face between two cells.
                if q % Self::DEGREE == 0 && (1..4).contains(&(q / Self::DEGREE)) {
                    extend(q / Self::DEGREE - 1);
                }
            }
        }
        // Each coefficient is three sums of W products, in any order.
        let slack = |x: f64, m: f64| x + m * (192.0 * U);
        let (mut low, mut high) = ([0.0f32; 64], [0.0f32; 64]);
        for k in 0..4 {
            for j in 0..4 {
                let rows = j * Self::DEGREE..=(j + 1) * Self::DEGREE;
                let (mut a, mut b) = ([f64::INFINITY; ROW], [f64::NEG_INFINITY; ROW]);
                for r in rows {
                    for l in 0..ROW {
                        a[l] = lesser(a[l], least[k][r][l]);
                        b[l] = -lesser(-b[l], -most[k][r][l]);
                    }
                }
                for i in 0..4 {
                    let row = i * Self::DEGREE..=(i + 1) * Self::DEGREE;
                    let a = a[row.clone()].iter().fold(f64::INFINITY, |m, &x| lesser(m, x));
                    let b = b[row].iter().fold(f64::NEG_INFINITY, |m, &x| -lesser(-m, -x));
                    let size = a.abs().max(b.abs());
                    [low[16 * k + 4 * j + i], high[16 * k + 4 * j + i]] = outward(slack(a, -size), slack(b, size));
                }
            }
        }
        (low, high)
    }
}

/// The lesser of two numbers; one instruction, which `f64::min` with its care for NaN is not.
#[inline(always)]
fn lesser(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
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
