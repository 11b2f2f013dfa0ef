//! What is known of a piece as a whole: ranges of its partial derivatives, the linear model for all its pixels, and the axis to halve.

use crate::bernstein::{Point, middle, slopes, value_roundings};
use crate::frustum::{EPS, Frustum, PixelBox};
use crate::matrix::{Matrix, inverse, product, row_sums};
use crate::solve::{Constants, Piece, WIDENED, WIDER};

/// A piece's linear model for all its pixels.
pub(crate) struct Model {
    pub(crate) y: Matrix,
    /// Upper bound of |Y J - I|.
    pub(crate) e: Matrix,
    pub(crate) rows: [f64; 3],
    pub(crate) rho: f64,
    /// |Y| times the error bounds of P.
    pub(crate) noise: [f64; 3],
    pub(crate) middle: Point,
    pub(crate) gamma: f64,
    /// Greatest |dz| and |dw| by each parameter.
    pub(crate) dz: [f64; 3],
    pub(crate) dw: [f64; 3],
}

/// Ranges of all partial derivatives of a piece, as middle and half width.
pub(crate) struct Derivatives {
    point: [(Point, Point); 3],
    value: [(f64, f64); 3],
}

/// Of one axis. No closure: those are compiled apart, for no instruction set.
#[inline(always)]
fn along(k: &Constants, a: usize, points: &[Point], values: &[f64]) -> ((Point, Point), (f64, f64)) {
    let ((lo, hi), (p, q)) = (slopes(k.g, a, points), slopes(k.h, a, values));
    let (n, m) = (k.g[a] as f64, k.h[a] as f64);
    let middle: Point = std::array::from_fn(|i| n * (0.5 * (lo[i] + hi[i])));
    let half: Point = std::array::from_fn(|i| n * (0.5 * (hi[i] - lo[i])));
    ((middle, half), (m * (0.5 * (p + q)), m * (0.5 * (q - p))))
}

impl Derivatives {
    #[inline(always)]
    pub(crate) fn new(k: &Constants, points: &[Point], values: &[f64]) -> Self {
        let [x, y, z] = [
            along(k, 0, points, values),
            along(k, 1, points, values),
            along(k, 2, points, values),
        ];
        Self {
            point: [x.0, y.0, z.0],
            value: [x.1, y.1, z.1],
        }
    }

    /// The linear model; `None` where the middle Jacobian is singular.
    #[inline(always)]
    pub(crate) fn model(&self, f: &Frustum, k: &Constants, piece: &Piece, points: &[Point], values: &[f64]) -> Option<Model> {
        let [(s, ds), (r, dr)] = f.slopes(piece.pixels);
        let lane = k.lane;
        // Differences of coefficients have twice their error; the middle and half width round once more.
        let noise = 2.0 * EPS * k.scale * (piece.geometry + 4.0) * f.obliquity;
        let noise_d = if f.parallel {
            2.0 * EPS * k.weight * (piece.geometry + 4.0) * f.reach
        } else {
            0.0
        };
        let noise_a = 2.0 * EPS * k.gamma * (piece.attribute + 4.0);
        let (mut j, mut radius) = ([[0.0; 3]; 3], [[0.0; 3]; 3]);
        for a in 0..3 {
            let (c, h) = &self.point[a];
            let n = k.g[a] as f64;
            let depth = c[lane].abs() + h[lane];
            j[0][a] = c[0] - s * c[lane];
            radius[0][a] = h[0] + s.abs() * h[lane] + ds * depth + n * (noise + noise_d);
            j[1][a] = c[1] - r * c[lane];
            radius[1][a] = h[1] + r.abs() * h[lane] + dr * depth + n * (noise + noise_d);
            (j[2][a], radius[2][a]) = (self.value[a].0, self.value[a].1 + k.h[a] as f64 * noise_a);
        }
        let y = inverse(&j)?;
        let mut e = [[0.0; 3]; 3];
        for i in 0..3 {
            for l in 0..3 {
                let (mut sum, mut size, mut spread) = (0.0, 0.0, 0.0);
                for n in 0..3 {
                    sum += y[i][n] * j[n][l];
                    size += (y[i][n] * j[n][l]).abs();
                    spread += y[i][n].abs() * radius[n][l];
                }
                let unit = if i == l { 1.0 } else { 0.0 };
                e[i][l] = ((sum - unit).abs() + 8.0 * EPS * size + spread) * WIDENED;
            }
        }
        let rows = row_sums(&e);
        let rho = rows[0].max(rows[1]).max(rows[2]);
        if !rho.is_finite() {
            return None;
        }
        let eval = EPS * k.scale * (piece.geometry + value_roundings(k.g)) * f.obliquity
            + f.slope_error * if f.parallel { k.weight } else { k.scale }
            + if f.parallel {
                EPS * k.weight * (piece.geometry + value_roundings(k.g)) * f.reach + EPS * 16.0 * k.scale
            } else {
                0.0
            };
        let errors = [eval, eval, EPS * k.gamma * (piece.attribute + value_roundings(k.h))];
        let noise = std::array::from_fn(|i| (0..3).map(|n| y[i][n].abs() * errors[n]).sum::<f64>() * 1.01);
        let most = |lane: usize| [0, 1, 2].map(|a| (self.point[a].0[lane].abs() + self.point[a].1[lane]) * WIDENED);
        Some(Model {
            y,
            e,
            rows,
            rho,
            noise,
            middle: middle(k.g, points),
            gamma: middle(k.h, values),
            dz: most(2),
            dw: most(3),
        })
    }

    /// The axis to halve; `None` where all are at the limit.
    #[inline(always)]
    pub(crate) fn axis(&self, f: &Frustum, k: &Constants, piece: &Piece, model: Option<&Model>) -> Option<usize> {
        let score: [f64; 3] = match model {
            // How much each partial derivative varies, in units of steps of the parameters.
            Some(m) => [0, 1, 2].map(|a| m.e[0][a] + m.e[1][a] + m.e[2][a]),
            // No inverse: by the extent along the axis, of each equation relative to the whole.
            None => {
                let [(s, _), (r, _)] = f.slopes(piece.pixels);
                let size = |a: usize| {
                    let (c, h) = &self.point[a];
                    let lane = k.lane;
                    [
                        (c[0] - s * c[lane]).abs() + h[0] + s.abs() * h[lane],
                        (c[1] - r * c[lane]).abs() + h[1] + r.abs() * h[lane],
                        self.value[a].0.abs() + self.value[a].1,
                    ]
                };
                let all = [size(0), size(1), size(2)];
                let total = [0, 1, 2].map(|n| all[0][n] + all[1][n] + all[2][n]);
                all.map(|x| (0..3).map(|n| if total[n] > 0.0 { x[n] / total[n] } else { 0.0 }).sum())
            }
        };
        let free = (0..3).filter(|&a| piece.depth[a] < k.deepest);
        free.max_by(|&a, &b| {
            let late = |a: usize| piece.since[a] >= 8;
            late(a).cmp(&late(b)).then(score[a].total_cmp(&score[b]))
        })
    }
}

impl Model {
    /// Y P(m) of a pixel.
    #[inline(always)]
    pub(crate) fn step(&self, f: &Frustum, k: &Constants, pixel: usize) -> [f64; 3] {
        let [s, r] = f.rays[pixel].slope;
        let (p, d) = (&self.middle, self.middle[k.lane]);
        product(&self.y, [p[0] - s * d, p[1] - r * d, self.gamma])
    }

    /// Whether the piece certainly has no root for the pixel of this step.
    #[inline(always)]
    pub(crate) fn excludes(&self, d: [f64; 3]) -> bool {
        (0..3).any(|i| d[i].abs() > (0.5 + 0.5 * self.rows[i]) * (1.0 + 4.0 * WIDER) + self.noise[i])
    }
}

/// The pixels of `b` that the oriented test leaves, as a rectangle.
#[inline(always)]
pub(crate) fn survivors(f: &Frustum, k: &Constants, m: &Model, b: PixelBox) -> Option<PixelBox> {
    let mut out: Option<PixelBox> = None;
    for y in b.y0..=b.y1 {
        for x in b.x0..=b.x1 {
            if m.excludes(m.step(f, k, usize::from(y) * f.width + usize::from(x))) {
                continue;
            }
            out = Some(PixelBox::with(out, x, y));
        }
    }
    out
}
