//! Four equations in four unknowns: `V(u) = o + t d` and `a(u) = c` by subdivision in u, v, w and t (Elber and Kim's solver in outline) and Newton's method.
//!
//! The equations `x W - (o + t d) W` are linear in t, so their Bernstein coefficients in four variables are those at both ends of the t-interval: what is stored stays three-dimensional, what is tested is
//! the four-dimensional control net. A part whose nets do not all hold zero is dropped; from a size on each part gets one Newton iteration on the four equations; parts of the last
//! level without a root are dropped.

use crate::Scene;
use isobar_core::{DVec3, HexElement, Ray};
use isobar_fields::evaluate_hex;
use isobar_fields::hexes_bezier::{Tensor, split};

/// Level from which on Newton's method is tried, and the last level.
const TRY: usize = 3;
const LAST: usize = 9;

/// A part of the four-dimensional domain.
struct Part {
    /// x W, y W, z W, W, attribute minus isovalue.
    nets: [Tensor<f64>; 5],
    lo: [f64; 3],
    size: f64,
    t: (f64, f64),
}

impl Part {
    fn may_hold(&self, ray: &Ray) -> bool {
        let holds = |values: &mut dyn Iterator<Item = f64>| {
            let (lo, hi) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
            lo <= 0.0 && hi >= 0.0
        };
        holds(&mut self.nets[4].values.iter().copied())
            && (0..3).all(|a| {
                let w = &self.nets[3].values;
                holds(
                    &mut self.nets[a]
                        .values
                        .iter()
                        .zip(w)
                        .flat_map(|(x, w)| [self.t.0, self.t.1].map(|t| x - (ray.origin[a] + t * ray.direction[a]) * w)),
                )
            })
    }

    /// The sixteen parts.
    fn split(self, ray: &Ray, out: &mut Vec<Self>) {
        let mut parts = vec![self];
        for axis in 0..3 {
            parts = parts
                .into_iter()
                .flat_map(|p| {
                    let halves = |upper: bool| {
                        let cut = |c: &[f64]| {
                            let (a, b) = split(c, &0.5);
                            if upper { b } else { a }
                        };
                        let mut lo = p.lo;
                        lo[axis] += if upper { 0.5 * p.size } else { 0.0 };
                        Self {
                            nets: p.nets.each_ref().map(|n| n.along(axis, cut)),
                            lo,
                            ..p
                        }
                    };
                    [halves(false), halves(true)]
                })
                .collect();
        }
        for p in parts {
            let middle = 0.5 * (p.t.0 + p.t.1);
            for t in [(p.t.0, middle), (middle, p.t.1)] {
                let part = Self {
                    nets: p.nets.clone(),
                    size: 0.5 * p.size,
                    t,
                    ..p
                };
                if part.may_hold(ray) {
                    out.push(part);
                }
            }
        }
    }

    /// Newton's method on the four equations from the middle; the t of a root inside the part.
    fn newton(&self, e: &HexElement, c: f64, ray: &Ray) -> Option<f64> {
        let mut u = DVec3::from_array(self.lo) + 0.5 * self.size;
        let mut t = 0.5 * (self.t.0 + self.t.1);
        for _ in 0..10 {
            let p = evaluate_hex(e, u);
            // J du - d dt = r, g . du = s: du = J^-1 (r + d dt), dt from the last.
            let (r, s) = (ray.at(t) - p.position, c - p.value);
            let inverse = p.jacobian.inverse();
            let g = inverse.transpose() * p.parametric_gradient;
            let dt = (s - g.dot(r)) / g.dot(ray.direction);
            let du = inverse * (r + ray.direction * dt);
            if !(dt.is_finite() && du.is_finite()) {
                return None;
            }
            (u, t) = (u + du, t + dt);
            if du.abs().max_element() < 1e-12 {
                let (lo, hi) = (DVec3::from_array(self.lo), DVec3::from_array(self.lo) + self.size);
                let inside = (u - lo).min_element() >= -1e-10 && (hi - u).min_element() >= -1e-10;
                return inside.then_some(t);
            }
        }
        None
    }
}

/// What is found on every pixel, by t; subdivisions; hits.
pub(crate) fn draw_all(scene: &Scene) -> (Vec<Vec<f64>>, usize, usize) {
    let (view, c) = (&scene.view, scene.isovalue);
    let (mut subdivisions, mut hits) = (0, 0);
    let mut all = Vec::new();
    for i in 0..view.pixels() {
        let ray = view.ray(i % view.width, i / view.width);
        let mut found = Vec::new();
        for e in scene.patches.elements.iter() {
            let channel = |f: &dyn Fn(&[f64; 4]) -> f64| Tensor {
                counts: e.degree.map(|d| usize::from(d) + 1),
                values: e.points.iter().map(f).collect(),
            };
            let attribute = Tensor {
                counts: e.value_degree.map(|d| usize::from(d) + 1),
                values: e.values.iter().map(|v| v - c).collect(),
            };
            let whole = Part {
                nets: [
                    channel(&|p| p[0] * p[3]),
                    channel(&|p| p[1] * p[3]),
                    channel(&|p| p[2] * p[3]),
                    channel(&|p| p[3]),
                    attribute,
                ],
                lo: [0.0; 3],
                size: 1.0,
                t: (0.0, 10.0),
            };
            if !whole.may_hold(&ray) {
                continue;
            }
            let mut list = vec![whole];
            for level in 0..=LAST {
                let mut next = Vec::new();
                for part in list {
                    if level >= TRY
                        && let Some(t) = part.newton(e, c, &ray)
                    {
                        found.push(t);
                    } else if level < LAST {
                        subdivisions += 1;
                        part.split(&ray, &mut next);
                    }
                }
                list = next;
            }
        }
        found.sort_by(f64::total_cmp);
        found.dedup_by(|b, a| *b - *a < 1e-9);
        hits += found.len();
        all.push(found);
    }
    (all, subdivisions, hits)
}
