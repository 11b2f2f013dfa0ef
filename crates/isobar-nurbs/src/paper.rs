//! `nurbs/cpu-paper`: the algorithm of section 4 as printed, pixel by pixel.
//!
//! Per pixel and candidate element the tuple (P, delta) is subdivided into octants at the middle; parts whose bounding volume holds the origin stay in the list L
//! (section 4.1.1). The volume is an axis-aligned box, the box along the Jacobian's directions, or the box along the principal axes of the coefficients. A part whose delta
//! (equation 17 as corrected in maths, section C: the attribute's derivative along the ray, times a positive polynomial) has no change of sign goes to Newton's
//! method from the node of the coefficient nearest to the origin; where that fails it is subdivided. Roots are filtered by the alternation of the signs of f'(t)
//! (section 4.2, equation 26 with the inverse transposed), and many roots in a short stretch become its two ends.
//!
//! What is taken from the corrections instead of the print, because nothing would be drawn otherwise: pixel centres (12), the weight in gamma (13, 15), signs in the projection
//! (9). **As printed stays**: Newton stops at epsilon = 1/(2h), a quarter pixel, for alpha and beta and for the attribute alike (14), so hits are only
//! that near, and a ray that passes the edge of the surface within a quarter pixel gets a hit where there is none (9, 20 and 12 of 1,600 pixels with oriented, axis-aligned and principal
//! boxes in `paper_tests.rs`; with a tolerance of 1e-8 the same scene has no such pixel, and none is lost in either case); alternation of signs drops true roots where the surface leaves the domain between two of them; roots that Newton's method misses in a part without a change of
//! sign of delta are found after further subdivision or, at the last level, lost. Nothing is claimed.

use crate::bernstein::{Lanes, Point, bases, halve, jet, range};
use crate::candidates::Candidates;
use crate::frustum::Frustum;
use crate::matrix::{inverse, product};
use crate::solve::{Found, Target, Task};
use glam::DVec3;
use isobar_core::HexElement;
use isobar_fields::hexes_bezier::{Tensor, derivative, elevate};
use std::collections::HashMap;

/// Subdivision levels, at most.
const DEEPEST: usize = 20;
/// Parts in the list, at most; more end the search of the pixel.
const MOST_PARTS: usize = 4096;
/// Newton steps from one start.
const STEPS: usize = 8;
/// More roots than this within an epsilon of t are taken for a stretch of the ray on the surface.
const CROWD: usize = 4;

/// The bounding volume of a part.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Bounds {
    /// Along alpha, beta, gamma.
    Aabb,
    /// Along the two longest columns of the Jacobian at the middle.
    Obb,
    /// Along the principal axes of the coefficients.
    Pca,
}

/// Counts of work.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Work {
    /// Octant subdivisions.
    pub(crate) subdivisions: u64,
    pub(crate) newton: u64,
    pub(crate) hits: u64,
    /// Lists looked at (one per level), their sizes and the squares of these.
    pub(crate) lists: u64,
    pub(crate) sizes: u64,
    pub(crate) squares: u64,
    pub(crate) limits: u64,
}

impl Work {
    pub(crate) fn add(&mut self, o: Self) {
        self.subdivisions += o.subdivisions;
        self.newton += o.newton;
        self.hits += o.hits;
        self.lists += o.lists;
        self.sizes += o.sizes;
        self.squares += o.squares;
        self.limits += o.limits;
    }
}

/// An element in the frame of a tile: all channels in one degree, delta in its own.
struct Prepared {
    d: [usize; 3],
    /// x, y, D, gamma.
    lanes: Vec<Point>,
    /// w beside z, for t.
    depth: Vec<[f64; 2]>,
    e: [usize; 3],
    delta: Vec<f64>,
}

/// One part: its coefficients and its box of parameters.
#[derive(Clone)]
struct Part {
    /// alpha, beta, gamma, D.
    p: Vec<Point>,
    delta: Vec<f64>,
    lo: [f64; 3],
}

/// A tensor in a degree at least its own.
fn raised(mut t: Tensor<f64>, d: [usize; 3]) -> Tensor<f64> {
    for (axis, &d) in d.iter().enumerate() {
        while t.counts[axis] <= d {
            t = t.along(axis, elevate);
        }
    }
    t
}

/// `det (grad a, grad b, grad c)` in Bernstein form.
fn determinant(a: &[Tensor<f64>; 3], b: &[Tensor<f64>; 3], c: &[Tensor<f64>; 3]) -> Tensor<f64> {
    let mut out: Option<Tensor<f64>> = None;
    for (i, j, k, sign) in [
        (0, 1, 2, 1.0),
        (1, 2, 0, 1.0),
        (2, 0, 1, 1.0),
        (0, 2, 1, -1.0),
        (2, 1, 0, -1.0),
        (1, 0, 2, -1.0),
    ] {
        let term = a[i].product(&b[j]).product(&c[k]);
        match &mut out {
            None => out = Some(term),
            Some(o) => o.values.iter_mut().zip(&term.values).for_each(|(o, t)| *o += sign * t),
        }
    }
    out.unwrap_or(Tensor {
        counts: [1; 3],
        values: vec![0.0],
    })
}

fn gradient(t: &Tensor<f64>) -> [Tensor<f64>; 3] {
    [0, 1, 2].map(|axis| t.along(axis, derivative))
}

impl Prepared {
    fn new(f: &Frustum, e: &HexElement, c: f64) -> Self {
        let g = e.degree.map(usize::from);
        let h = if e.rational_value {
            g
        } else {
            e.value_degree.map(usize::from)
        };
        let d: [usize; 3] = std::array::from_fn(|a| g[a].max(h[a]));
        let place = |n: DVec3| {
            let values = e
                .points
                .iter()
                .map(|p| p[3] * n.dot(DVec3::new(p[0], p[1], p[2]) - f.eye))
                .collect();
            raised(
                Tensor {
                    counts: g.map(|d| d + 1),
                    values,
                },
                d,
            )
        };
        let (x, y, z) = (place(f.right), place(f.up), place(f.forward));
        let w = raised(
            Tensor {
                counts: g.map(|d| d + 1),
                values: e.points.iter().map(|p| p[3]).collect(),
            },
            d,
        );
        let weight = |i: usize| if e.rational_value { e.points[i][3] } else { 1.0 };
        let gamma = raised(
            Tensor {
                counts: h.map(|d| d + 1),
                values: e.values.iter().enumerate().map(|(i, a)| weight(i) * (a - c)).collect(),
            },
            d,
        );
        let depth = if f.parallel { &w } else { &z };
        // D = grad gamma . (W grad x cross grad y + x grad y cross grad W + y grad W cross grad x), W the depth.
        let [gx, gy, gw, gg] = [&x, &y, depth, &gamma].map(gradient);
        let mut delta = determinant(&gg, &gx, &gy).product(depth);
        for (a, b, by) in [(&gy, &gw, &x), (&gw, &gx, &y)] {
            let more = determinant(&gg, a, b).product(by);
            delta.values.iter_mut().zip(&more.values).for_each(|(o, t)| *o += t);
        }
        let n = x.values.len();
        Self {
            d,
            lanes: (0..n)
                .map(|i| [x.values[i], y.values[i], depth.values[i], gamma.values[i]])
                .collect(),
            depth: (0..n).map(|i| [z.values[i], w.values[i]]).collect(),
            e: delta.counts.map(|c| c - 1),
            delta: delta.values,
        }
    }
}

/// Scratch memory and results of a tile.
#[derive(Default)]
pub(crate) struct Paper {
    prepared: HashMap<(u32, u64), Prepared>,
    pub(crate) found: Vec<Found>,
    pub(crate) undecided: Vec<bool>,
    pub(crate) seen: Vec<u32>,
    pub(crate) work: Work,
}

impl Paper {
    /// All pixels of a frustum. `epsilon` is the paper's, as a slope or offset for alpha and beta, and as it is for the attribute.
    pub(crate) fn draw(
        &mut self,
        f: &Frustum,
        candidates: &Candidates,
        elements: &[HexElement],
        bounds: Bounds,
        epsilon: [f64; 2],
    ) {
        self.found.clear();
        self.prepared.clear();
        (self.undecided, self.seen) = (vec![false; f.rays.len()], vec![0; f.rays.len()]);
        let mut tasks: Vec<Task> = Vec::new();
        candidates.visit(f, &mut Vec::new(), |t| tasks.push(*t));
        for task in &tasks {
            let Target::Isovalue(c) = task.target else { continue };
            let element = &elements[task.element as usize];
            let key = (task.element, c.to_bits());
            let p = self.prepared.remove(&key).unwrap_or_else(|| Prepared::new(f, element, c));
            for pixel in 0..f.rays.len() {
                self.pixel(f, task, &p, pixel, bounds, epsilon);
            }
            self.prepared.insert(key, p);
        }
    }

    /// All roots of one element on one ray, with duplicates.
    fn pixel(&mut self, f: &Frustum, task: &Task, k: &Prepared, pixel: usize, bounds: Bounds, epsilon: [f64; 2]) {
        let [s, r] = f.rays[pixel].slope;
        let whole = Part {
            p: k.lanes
                .iter()
                .map(|l| [l[0] - s * l[2], l[1] - r * l[2], l[3], l[2]])
                .collect(),
            delta: k.delta.clone(),
            lo: [0.0; 3],
        };
        if !holds_origin(k.d, &whole.p, Bounds::Aabb) {
            return;
        }
        let before = self.work.subdivisions;
        let mut list = vec![whole];
        for level in 0..=DEEPEST {
            let n = list.len() as u64;
            self.work.lists += 1;
            (self.work.sizes, self.work.squares) = (self.work.sizes + n, self.work.squares + n * n);
            let size = 0.5f64.powi(level as i32);
            let mut next = Vec::new();
            for part in list {
                let (lo, hi) = range(&part.delta);
                let one_sign = lo > 0.0 || hi < 0.0;
                if one_sign && let Some(u) = self.newton(k, &part, epsilon) {
                    let u = [0, 1, 2].map(|a| part.lo[a] + size * u[a]);
                    self.found.push(hit(f, task, k, pixel, u));
                    continue;
                }
                if level == DEEPEST {
                    continue;
                }
                self.work.subdivisions += 1;
                octants(k, part, size, |o| {
                    if holds_origin(k.d, &o.p, bounds) {
                        next.push(o);
                    }
                });
            }
            list = next;
            if list.is_empty() {
                break;
            }
            if list.len() > MOST_PARTS {
                self.undecided[pixel] = true;
                self.work.limits += 1;
                break;
            }
        }
        self.seen[pixel] += (self.work.subdivisions - before) as u32;
    }

    /// A root of P in a part, to epsilon, from the node nearest to the origin.
    fn newton(&mut self, k: &Prepared, part: &Part, epsilon: [f64; 2]) -> Option<[f64; 3]> {
        let far = |p: &Point| p[0] * p[0] + p[1] * p[1] + p[2] * p[2];
        let nearest = (0..part.p.len()).min_by(|&a, &b| far(&part.p[a]).total_cmp(&far(&part.p[b])))?;
        let c = k.d.map(|d| d + 1);
        let at = [nearest % c[0], nearest / c[0] % c[1], nearest / c[0] / c[1]];
        let mut u = [0, 1, 2].map(|a| if k.d[a] == 0 { 0.5 } else { at[a] as f64 / k.d[a] as f64 });
        for _ in 0..STEPS {
            self.work.newton += 1;
            let [p, pu, pv, pw] = jet(k.d, &part.p, &bases(k.d, u));
            let limit = epsilon[0] * p[3].abs();
            if p[0].abs() < limit && p[1].abs() < limit && p[2].abs() < epsilon[1] {
                return u.iter().all(|&x| (0.0..=1.0).contains(&x)).then_some(u);
            }
            let j = [0, 1, 2].map(|n| [pu[n], pv[n], pw[n]]);
            let step = product(&inverse(&j)?, [p[0], p[1], p[2]]);
            for a in 0..3 {
                u[a] -= step[a];
            }
            if u.iter().any(|x| !(-1.0..=2.0).contains(x)) {
                return None;
            }
        }
        None
    }

    /// Section 4.2: of one pixel's roots, sorted by t, those whose f' has the sign of the one before are removed; a crowd within an epsilon becomes its two ends.
    pub(crate) fn filter(own: &mut Vec<Found>, direction: DVec3, epsilon: f64) {
        own.sort_by(|a, b| a.surface.cmp(&b.surface).then(a.t.total_cmp(&b.t)));
        let mut kept: Vec<Found> = Vec::with_capacity(own.len());
        for f in own.iter() {
            let sign = f.normal.dot(direction) > 0.0;
            let last = kept.last().filter(|l| l.surface == f.surface);
            if last.is_none_or(|l| (l.normal.dot(direction) > 0.0) != sign) {
                kept.push(*f);
            }
        }
        let crowded = kept.len() > CROWD && kept[kept.len() - 1].t - kept[0].t < epsilon;
        if crowded && let (Some(&a), Some(&b)) = (kept.first(), kept.last()) {
            kept = vec![a, b];
        }
        kept.sort_by(|a, b| a.t.total_cmp(&b.t));
        *own = kept;
    }
}

fn hit(f: &Frustum, task: &Task, k: &Prepared, pixel: usize, u: [f64; 3]) -> Found {
    let at = bases(k.d, u);
    let [p, pu, pv, pw] = jet(k.d, &k.lanes, &at);
    let pairs: Vec<Point> = k.depth.iter().map(|d| [d[0], d[1], 0.0, 0.0]).collect();
    let [q, qu, qv, qw] = jet(k.d, &pairs, &at);
    let ray = &f.rays[pixel];
    let join = |p: &Point, q: &Point| [p[0], p[1], q[0], q[1]];
    let normal = crate::solve::normal(
        f,
        join(&p, &q),
        [join(&pu, &qu), join(&pv, &qv), join(&pw, &qw)],
        [pu[3], pv[3], pw[3]],
    );
    Found {
        pixel: pixel as u16,
        surface: task.surface,
        certain: false,
        t: (q[0] / q[1] - ray.start) / ray.rate,
        error: 0.0,
        normal,
    }
}

/// The eight octants of a part of edge `size`.
fn octants(k: &Prepared, part: Part, size: f64, mut take: impl FnMut(Part)) {
    let mut parts = vec![part];
    for axis in 0..3 {
        let mut halves = Vec::with_capacity(2 * parts.len());
        for mut upper in parts {
            let mut lower = upper.clone();
            halve(k.d, axis, &mut upper.p, &mut lower.p);
            halve(k.e, axis, &mut upper.delta, &mut lower.delta);
            upper.lo[axis] += 0.5 * size;
            halves.push(lower);
            halves.push(upper);
        }
        parts = halves;
    }
    parts.into_iter().for_each(&mut take);
}

/// Whether the bounding volume of (alpha, beta, gamma) holds the origin.
fn holds_origin(d: [usize; 3], p: &[Point], bounds: Bounds) -> bool {
    let (lo, hi) = range(p);
    if (0..3).any(|i| lo[i] > 0.0 || hi[i] < 0.0) {
        return false;
    }
    let axes = match bounds {
        Bounds::Aabb => return true,
        Bounds::Obb => jacobian_axes(d, p),
        Bounds::Pca => principal_axes(p),
    };
    axes.is_none_or(|axes| {
        axes.iter().all(|v| {
            let (mut a, mut b) = (f64::INFINITY, f64::NEG_INFINITY);
            for q in p {
                let x = v.x * q[0] + v.y * q[1] + v.z * q[2];
                (a, b) = (a.least(x), b.most(x));
            }
            a <= 0.0 && b >= 0.0
        })
    })
}

/// The paper's frame: v1 along the longest partial derivative at the middle, v3 across it and the second longest, v2 = v3 x v1.
fn jacobian_axes(d: [usize; 3], p: &[Point]) -> Option<[DVec3; 3]> {
    let [_, a, b, c] = jet(d, p, &bases(d, [0.5; 3]));
    let mut v = [a, b, c].map(|q| DVec3::new(q[0], q[1], q[2]));
    v.sort_by(|a, b| b.length_squared().total_cmp(&a.length_squared()));
    let v1 = v[0].try_normalize()?;
    let v3 = v[0].cross(v[1]).try_normalize()?;
    Some([v1, v3.cross(v1), v3])
}

/// Eigenvectors of the covariance of the coefficients, by Jacobi rotations.
fn principal_axes(p: &[Point]) -> Option<[DVec3; 3]> {
    let n = p.len() as f64;
    let at = |q: &Point| DVec3::new(q[0], q[1], q[2]);
    let mean = p.iter().map(at).sum::<DVec3>() / n;
    let mut m = [[0.0f64; 3]; 3];
    for q in p {
        let x = at(q) - mean;
        for (i, row) in m.iter_mut().enumerate() {
            for (j, e) in row.iter_mut().enumerate() {
                *e += x[i] * x[j] / n;
            }
        }
    }
    let mut axes = [DVec3::X, DVec3::Y, DVec3::Z];
    for _ in 0..12 {
        for (i, j) in [(0, 1), (0, 2), (1, 2)] {
            if m[i][j] == 0.0 {
                continue;
            }
            let theta = (m[j][j] - m[i][i]) / (2.0 * m[i][j]);
            let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
            let t = if theta == 0.0 { 1.0 } else { t };
            let c = 1.0 / (t * t + 1.0).sqrt();
            let s = t * c;
            let (a, b) = (m[i], m[j]);
            m[i] = std::array::from_fn(|k| c * a[k] - s * b[k]);
            m[j] = std::array::from_fn(|k| s * a[k] + c * b[k]);
            for row in &mut m {
                let (a, b) = (row[i], row[j]);
                (row[i], row[j]) = (c * a - s * b, s * a + c * b);
            }
            let (a, b) = (axes[i], axes[j]);
            (axes[i], axes[j]) = (a * c - b * s, a * s + b * c);
        }
    }
    axes.iter().all(|a| a.is_finite()).then_some(axes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn principal_axes_are_those_of_a_stretched_cloud() {
        let long = DVec3::new(1.0, 2.0, -0.5).normalize();
        let wide = long.any_orthonormal_vector();
        let p: Vec<Point> = (0..50)
            .map(|i| {
                let x = long * f64::from(i - 25) + wide * f64::from(i * 7 % 11 - 5) + long.cross(wide) * 0.1 * f64::from(i % 3);
                [x.x, x.y, x.z, 1.0]
            })
            .collect();
        let axes = principal_axes(&p).unwrap();
        assert!(axes.iter().any(|a| a.dot(long).abs() > 0.999));
        assert!((axes[0].dot(axes[1])).abs() < 1e-12 && (axes[1].dot(axes[2])).abs() < 1e-12);
    }

    #[test]
    fn oriented_boxes_are_tighter() {
        // A thin slab across the diagonal, away from the origin: its axis-aligned box holds it.
        let d = [1, 1, 1];
        let p: Vec<Point> = (0..8)
            .map(|n| {
                let [u, v, w] = [n & 1, n >> 1 & 1, n >> 2].map(f64::from);
                [2.0 * u - 1.0 + 0.4, 2.0 * v - 1.0 + 0.4, 1.0 - u - v + 0.02 * w + 0.4, 1.0]
            })
            .collect();
        assert!(holds_origin(d, &p, Bounds::Aabb));
        assert!(!holds_origin(d, &p, Bounds::Obb) && !holds_origin(d, &p, Bounds::Pca));
    }
}
