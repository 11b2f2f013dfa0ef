//! The shaders' mathematics in f32 on the CPU, operation by operation: same names, same order. Test code; the product's CPU twin is
//! march/cpu, in f64.

use super::data;
use super::layout::Ray;
use super::programs::Filter;
use isobar_core::Lattice;
use isobar_fields::{Coefficients, GridSpline};
use isobar_gpu::levels::Level;

type V3 = [f32; 3];

/// Coefficients with the border written out, less the bias.
pub(super) struct Twin {
    texels: Vec<f32>,
    dims: [usize; 3],
    last: V3,
    degree: usize,
    /// 1: exact weights.
    fractions: f32,
}

/// `mix(a, b, w)` as the shaders write it.
fn lerp(a: f32, b: f32, w: f32) -> f32 {
    a + w * (b - a)
}

fn weights(degree: usize, w: f32) -> Vec<f32> {
    const SIXTH: f32 = 1.0 / 6.0;
    let v = 1.0 - w;
    if degree == 2 {
        return vec![0.5 * v * v, 0.5 + w * v, 0.5 * w * w];
    }
    let (ww, vv) = (w * w, v * v);
    vec![
        SIXTH * vv * v,
        SIXTH * (4.0 - 3.0 * ww * (1.0 + v)),
        SIXTH * (4.0 - 3.0 * vv * (1.0 + w)),
        SIXTH * ww * w,
    ]
}

fn slopes(degree: usize, w: f32) -> Vec<f32> {
    let v = 1.0 - w;
    if degree == 2 {
        return vec![w - 1.0, 1.0 - 2.0 * w, w];
    }
    vec![-0.5 * v * v, w * (1.5 * w - 2.0), v * (2.0 - 1.5 * v), 0.5 * w * w]
}

/// Two fetch positions along an axis and their weights.
#[derive(Clone, Copy)]
struct Axis {
    base: [usize; 2],
    fraction: [f32; 2],
    weight: [f32; 2],
}

fn value_axis(degree: usize, i: usize, w: f32) -> Axis {
    let v = 1.0 - w;
    if degree == 2 {
        let last = 0.5 * w * w;
        let pair = 1.0 - last;
        return Axis {
            base: [i, i + 2],
            fraction: [(0.5 + w * v) / pair, 0.0],
            weight: [pair, last],
        };
    }
    let w1 = (4.0 - 3.0 * w * w * (1.0 + v)) / 6.0;
    let w3 = w * w * w / 6.0;
    let first = v * v * v / 6.0 + w1;
    let second = 1.0 - first;
    Axis {
        base: [i, i + 2],
        fraction: [w1 / first, w3 / second],
        weight: [first, second],
    }
}

fn slope_axis(degree: usize, i: usize, w: f32) -> Axis {
    if degree == 2 {
        return Axis {
            base: [i, i + 1],
            fraction: [w, w],
            weight: [-1.0, 1.0],
        };
    }
    let v = 1.0 - w;
    let w1 = w * (1.5 * w - 2.0);
    let w3 = 0.5 * w * w;
    let first = -0.5 * v * v + w1;
    Axis {
        base: [i, i + 2],
        fraction: [w1 / first, w3 / -first],
        weight: [first, -first],
    }
}

impl Twin {
    /// `fractions`: as [`Filter::fractions`], or any other number of steps.
    pub(super) fn new(spline: &GridSpline, bias: [f32; 2], fractions: f32) -> Self {
        let degree = spline.kind().basis().degree;
        let pad = data::pad(degree);
        let n = Lattice::dims(spline);
        let dims = n.map(|n| n + 2 * pad);
        let at = |i: usize, a: usize| spline.border().index(i as isize - pad as isize, n[a]);
        let coefficient = |i: usize| match spline.coefficients() {
            Coefficients::Samples(s) => s.get(i) as f32,
            Coefficients::F32(c) => c[i],
            Coefficients::F64(c) => c[i] as f32,
        };
        let mut texels = Vec::new();
        for k in 0..dims[2] {
            for j in 0..dims[1] {
                for i in 0..dims[0] {
                    let c = coefficient((at(k, 2) * n[1] + at(j, 1)) * n[0] + at(i, 0));
                    texels.push((c - bias[0]) - bias[1]);
                }
            }
        }
        Self {
            texels,
            dims,
            last: n.map(|n| (n - 1) as f32),
            degree,
            fractions,
        }
    }

    /// Texels outside are only ever weighted by 0.
    fn coefficient(&self, [x, y, z]: [usize; 3]) -> f32 {
        let [x, y, z] = [x.min(self.dims[0] - 1), y.min(self.dims[1] - 1), z.min(self.dims[2] - 1)];
        self.texels[(z * self.dims[1] + y) * self.dims[0] + x]
    }

    fn cell_of(&self, u: V3) -> ([usize; 3], V3) {
        let mut base = [0; 3];
        let mut w = [0.0; 3];
        for a in 0..3 {
            let c = if self.degree == 2 {
                (u[a] + 0.5).floor().min(self.last[a])
            } else {
                u[a].floor().min(self.last[a] - 1.0)
            };
            base[a] = c as usize;
            w[a] = if self.degree == 2 { (u[a] - c) + 0.5 } else { u[a] - c };
        }
        (base, w)
    }

    fn corners(&self, [x, y, z]: [usize; 3]) -> [[[f32; 2]; 2]; 2] {
        std::array::from_fn(|k| std::array::from_fn(|j| std::array::from_fn(|i| self.coefficient([x + i, y + j, z + k]))))
    }

    /// `c` as `[z][y][x]`.
    fn interpolate(c: [[[f32; 2]; 2]; 2], w: V3) -> f32 {
        let z: [[f32; 2]; 2] = std::array::from_fn(|j| std::array::from_fn(|i| lerp(c[0][j][i], c[1][j][i], w[2])));
        let y: [f32; 2] = std::array::from_fn(|i| lerp(z[0][i], z[1][i], w[1]));
        lerp(y[0], y[1], w[0])
    }

    fn fetch(&self, base: [usize; 3], w: V3) -> f32 {
        let q = w.map(|w| (w * self.fractions + 0.5).floor() / self.fractions);
        Self::interpolate(self.corners(base), q)
    }

    fn sum_axes(&self, [x, y, z]: [Axis; 3]) -> f32 {
        let row = |j: usize, k: usize| {
            let at = |i: usize| {
                let base = [x.base[i], y.base[j], z.base[k]];
                x.weight[i] * self.fetch(base, [x.fraction[i], y.fraction[j], z.fraction[k]])
            };
            at(0) + at(1)
        };
        let plane = |k: usize| y.weight[0] * row(0, k) + y.weight[1] * row(1, k);
        z.weight[0] * plane(0) + z.weight[1] * plane(1)
    }

    fn sum(&self, b: [usize; 3], x: &[f32], y: &[f32], z: &[f32]) -> f32 {
        let dot = |w: &[f32], f: &dyn Fn(usize) -> f32| {
            let mut s = w[0] * f(0);
            for (i, w) in w.iter().enumerate().skip(1) {
                s += w * f(i);
            }
            s
        };
        dot(z, &|k| {
            dot(y, &|j| dot(x, &|i| self.coefficient([b[0] + i, b[1] + j, b[2] + k])))
        })
    }

    /// s less the bias.
    pub(super) fn value(&self, u: V3) -> f32 {
        let (b, w) = self.cell_of(u);
        match (self.degree, self.fractions > 1.0) {
            (1, false) => Self::interpolate(self.corners(b), w),
            (1, true) => self.fetch(b, w),
            (d, false) => self.sum(b, &weights(d, w[0]), &weights(d, w[1]), &weights(d, w[2])),
            (d, true) => self.sum_axes(std::array::from_fn(|a| value_axis(d, b[a], w[a]))),
        }
    }

    /// Index-space gradient.
    pub(super) fn gradient(&self, u: V3) -> V3 {
        let (b, w) = self.cell_of(u);
        let d = self.degree;
        std::array::from_fn(|g| match (d, self.fractions > 1.0) {
            (1, false) => {
                let c = self.corners(b);
                let pick = |end: f32| {
                    let mut w = w;
                    w[g] = end;
                    w
                };
                // The shader shares sums; the two forms agree to rounding.
                Self::interpolate(c, pick(1.0)) - Self::interpolate(c, pick(0.0))
            }
            (1, true) => {
                let mut next = b;
                next[g] += 1;
                let mut q = w;
                q[g] = 0.0;
                self.fetch(next, q) - self.fetch(b, q)
            }
            (_, false) => {
                let x: [Vec<f32>; 3] = std::array::from_fn(|a| if a == g { slopes(d, w[a]) } else { weights(d, w[a]) });
                self.sum(b, &x[0], &x[1], &x[2])
            }
            (_, true) => self.sum_axes(std::array::from_fn(|a| {
                if a == g {
                    slope_axis(d, b[a], w[a])
                } else {
                    value_axis(d, b[a], w[a])
                }
            })),
        })
    }

    fn position(&self, ray: &Ray, u: f32) -> V3 {
        std::array::from_fn(|a| (ray.origin[a] + u * ray.direction[a]).clamp(0.0, self.last[a]))
    }

    /// All hits of a ray, `(u, surface)` front to back, without blocks.
    pub(super) fn march(&self, ray: &Ray, step: f32, bisections: u32, levels: &[Level]) -> Vec<(f32, u32)> {
        let mut hits = Vec::new();
        if ray.length < 0.0 {
            return hits;
        }
        let class_of = |s: f32| levels.iter().take_while(|l| s >= l.value).count();
        let last = (ray.length / step).ceil() as u32;
        let u = |k: u32| (k as f32 * step).min(ray.length);
        let mut before = class_of(self.value(self.position(ray, 0.0)));
        for k in 1..=last {
            let now = class_of(self.value(self.position(ray, u(k))));
            while now != before {
                let rising = now > before;
                let level = &levels[if rising { before } else { before - 1 }];
                let (mut lo, mut hi) = (u(k - 1), u(k));
                for _ in 0..bisections {
                    let mid = 0.5 * (lo + hi);
                    if mid <= lo || mid >= hi {
                        break;
                    }
                    if (self.value(self.position(ray, mid)) >= level.value) == rising {
                        hi = mid;
                    } else {
                        lo = mid;
                    }
                }
                hits.push((0.5 * (lo + hi), level.surface));
                before = if rising { before + 1 } else { before - 1 };
            }
        }
        hits
    }
}

/// The twin of a renderer's settings.
pub(super) fn of(spline: &GridSpline, bias: [f32; 2], filter: Filter) -> Twin {
    Twin::new(spline, bias, filter.fractions())
}
