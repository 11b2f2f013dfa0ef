//! The silhouette system Q = (gamma, delta, eta) and its solution with normal cones (sections 3 and 4.1.2; equations 18 to 20 and 25).
//!
//! gamma = 0 is the surface, delta = 0 where it turns about, and eta = 0 where the gradient's projection points to the pixel's centre: the point of the silhouette nearest to it. Q is subdivided until the normal cones of
//! the three leave at most one zero, which Newton's method finds; the part is dropped where one of the three has one sign, or where it lies outside the pixel.
//!
//! **The cones.** The text says that the *normal cones* of the three must not intersect. That is not enough: with gamma = x, delta = y, eta = x + y + (z^2 - 1/4)/100 the three cones are narrow and far apart, and there are two
//! zeros. What Elber et al. show is about the cones of *directions in which a function may stay constant*: two zeros differ by a vector across some gradient of each function, so no direction may be across a normal
//! of all three cones at once. With a_i the axes and s_i the sines of the half angles such a direction has |v . a_i| <= s_i; the corners of that parallelepiped all lie inside the unit ball exactly where there is none.
//!
//! **What Q misses** (maths, section C; counted against COVERED in `paper_silhouette_tests.rs`): surfaces that end inside the pixel, at the boundary of the domain, have no silhouette there; the nearest point may lie outside the square whose
//! corner the curve cuts. [`Region::Disc`] searches the disc about the square for these and keeps a point outside the square where the tangent of the curve cuts it.

use crate::bernstein::{Point, halve, range};
use crate::matrix::{inverse, product};
use crate::paper_forms::{Forms, evaluate};
use glam::DVec3;

/// Where the nearest point of the silhouette is sought.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Region {
    /// In the pixel's square, as printed.
    Square,
    /// In the disc through the square's corners.
    Disc,
}

/// Halvings of an element's parameters along an axis, at most.
const DEEPEST: u8 = 20;
/// Parts of Q for one pixel and one part of P, at most.
const MOST: usize = 512;
/// Newton steps.
const STEPS: usize = 12;

/// The pixel: slopes of its centre and half its edge.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Square {
    pub(crate) slope: [f64; 2],
    pub(crate) half: f64,
    pub(crate) region: Region,
}

impl Square {
    fn reach(&self) -> f64 {
        self.half
            * if self.region == Region::Disc {
                std::f64::consts::SQRT_2
            } else {
                1.0
            }
    }

    /// Whether a part may be inside, by the coefficients of x, y, W.
    pub(crate) fn meets(&self, p: &[Point]) -> bool {
        let ([s, r], h) = (self.slope, self.reach());
        // Forms that are negative on all coefficients are so on the part.
        ![(0, s, 1.0), (0, s, -1.0), (1, r, 1.0), (1, r, -1.0)]
            .iter()
            .any(|&(lane, slope, sign)| p.iter().all(|p| h * p[2] + sign * (p[lane] - slope * p[2]) < 0.0))
    }

    /// Whether a point of the silhouette, with the projection `n` of its gradient, shows that the surface is in the square; half-open.
    fn shows(&self, [x, y]: [f64; 2], n: [f64; 2]) -> bool {
        let (h, [s, r]) = (self.half, self.slope);
        let (dx, dy) = (x - s, y - r);
        let inside = -h <= dx && dx < h && -h <= dy && dy < h;
        if inside || self.region == Region::Square {
            return inside;
        }
        // The tangent, n . (p - point) = 0: distance of the centre against the square's extent across it.
        (n[0] * dx + n[1] * dy).abs() < h * (n[0].abs() + n[1].abs())
    }
}

/// Counts.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Work {
    /// Subdivisions of Q into octants.
    pub(crate) subdivisions: u64,
    pub(crate) points: u64,
    /// Searches that were given up.
    pub(crate) limits: u64,
}

/// A part of Q.
struct Part {
    lo: [f64; 3],
    level: u8,
    /// x, y, W, gamma.
    p: Vec<Point>,
    delta: Vec<f64>,
    eta: Vec<f64>,
}

/// Degrees of gamma, delta, eta.
type Degrees = [[usize; 3]; 3];

/// Axis and cosine of a cone that holds the gradients of a form everywhere on its part; `None` where it is no narrower than a half space.
fn cone(d: [usize; 3], c: &[f64]) -> Option<(DVec3, f64)> {
    let n = d.map(|d| d + 1);
    let at = |i: [usize; 3]| c[(i[2] * n[1] + i[1]) * n[0] + i[0]];
    // The partial derivative along an axis has a degree less there: raised again, so that the three have common control vectors.
    let slope = |mut i: [usize; 3], a: usize| {
        let (m, k) = (d[a], i[a]);
        let mut difference = |k: usize| {
            i[a] = k + 1;
            let upper = at(i);
            i[a] = k;
            upper - at(i)
        };
        match k {
            _ if m == 0 => 0.0,
            0 => m as f64 * difference(0),
            k if k == m => m as f64 * difference(m - 1),
            k => k as f64 * difference(k - 1) + (m - k) as f64 * difference(k),
        }
    };
    let mut all = Vec::with_capacity(c.len());
    for k in 0..n[2] {
        for j in 0..n[1] {
            for i in 0..n[0] {
                all.push(DVec3::from_array([0, 1, 2].map(|a| slope([i, j, k], a))).try_normalize()?);
            }
        }
    }
    let axis = all.iter().sum::<DVec3>().try_normalize()?;
    let cosine = all.iter().map(|v| v.dot(axis)).fold(1.0, f64::min);
    (cosine > 0.0).then_some((axis, cosine))
}

/// Whether cones of gradients leave no direction along which all three functions may be constant.
fn at_most_one_zero(cones: [(DVec3, f64); 3]) -> bool {
    let rows = cones.map(|(a, _)| a.to_array());
    let sines = cones.map(|(_, c)| (1.0 - c * c).max(0.0).sqrt() + 1e-12);
    inverse(&rows).is_some_and(|m| {
        (0..4).all(|n| {
            let sign = |i: usize| if n >> i & 1 == 0 { 1.0 } else { -1.0 };
            let v = product(&m, [sines[0], sign(0) * sines[1], sign(1) * sines[2]]);
            DVec3::from_array(v).length() < 1.0
        })
    })
}

impl Part {
    fn alive(&self, square: &Square) -> bool {
        let changes = |(lo, hi): (f64, f64)| lo <= 0.0 && hi >= 0.0;
        let (lo, hi) = range(&self.p);
        changes((lo[3], hi[3])) && changes(range(&self.delta)) && changes(range(&self.eta)) && square.meets(&self.p)
    }

    fn octants(self, [d, e, q]: Degrees) -> Vec<Self> {
        let mut parts = vec![self];
        for axis in 0..3 {
            let mut halves = Vec::with_capacity(2 * parts.len());
            for mut upper in parts {
                let (mut p, mut delta, mut eta) = (upper.p.clone(), upper.delta.clone(), upper.eta.clone());
                halve(d, axis, &mut upper.p, &mut p);
                halve(e, axis, &mut upper.delta, &mut delta);
                halve(q, axis, &mut upper.eta, &mut eta);
                let (lo, level) = (upper.lo, upper.level);
                upper.lo[axis] += 0.5f64.powi(i32::from(level) + 1);
                halves.push(Self {
                    lo,
                    level,
                    p,
                    delta,
                    eta,
                });
                halves.push(upper);
            }
            parts = halves;
        }
        parts.iter_mut().for_each(|p| p.level += 1);
        parts
    }

    fn cones(&self, [d, e, q]: Degrees) -> Option<[(DVec3, f64); 3]> {
        let gamma: Vec<f64> = self.p.iter().map(|p| p[3]).collect();
        Some([cone(d, &gamma)?, cone(e, &self.delta)?, cone(q, &self.eta)?])
    }
}

/// Newton's method on Q from the middle of a part; its end, where it converges at all.
fn newton(k: &Forms, square: &Square, lo: [f64; 3], size: f64) -> Option<[f64; 3]> {
    let [s, r] = square.slope;
    let mut u = lo.map(|x| x + 0.5 * size);
    for _ in 0..STEPS {
        let [p, pu, pv, pw] = evaluate(k.d, &k.lanes, u);
        let [a, au, av, aw] = evaluate(k.e, &k.delta, u);
        let [b, bu, bv, bw] = evaluate(k.q, &k.eta, u);
        let eta = |e: Point| e[0] - s * e[1] + r * e[2];
        let j = [[pu[3], pv[3], pw[3]], [au, av, aw], [eta(bu), eta(bv), eta(bw)]];
        let step = product(&inverse(&j)?, [p[3], a, eta(b)]);
        (0..3).for_each(|i| u[i] -= step[i]);
        if (0..3).any(|i| !(lo[i] - size..=lo[i] + 2.0 * size).contains(&u[i])) {
            return None;
        }
        if step.iter().all(|x| x.abs() <= 1e-9 * size) {
            return Some(u);
        }
    }
    None
}

/// Parameters of the points of the silhouette that show the surface in the pixel, in the part of P with these coefficients (x, y, W, gamma; delta; E0, E1, E2).
pub(crate) fn silhouettes(
    k: &Forms,
    square: &Square,
    (lo, level): ([f64; 3], u8),
    p: Vec<Point>,
    delta: Vec<f64>,
    eta: &[Point],
    work: &mut Work,
) -> Vec<[f64; 3]> {
    let degrees = [k.d, k.e, k.q];
    let [s, r] = square.slope;
    let eta = eta.iter().map(|e| e[0] - s * e[1] + r * e[2]).collect();
    let mut stack = vec![Part {
        lo,
        level,
        p,
        delta,
        eta,
    }];
    let mut found = Vec::new();
    let mut budget = MOST;
    while let Some(part) = stack.pop() {
        if !part.alive(square) {
            continue;
        }
        let size = 0.5f64.powi(i32::from(part.level));
        if part.cones(degrees).is_some_and(at_most_one_zero)
            && let Some(u) = newton(k, square, part.lo, size)
        {
            let inside = (0..3).all(|a| (part.lo[a]..=part.lo[a] + size).contains(&u[a]));
            if inside && shows(k, square, u) {
                work.points += 1;
                found.push(u);
            }
            continue;
        }
        if part.level >= DEEPEST || budget == 0 {
            work.limits += 1;
            continue;
        }
        budget -= 1;
        work.subdivisions += 1;
        stack.extend(part.octants(degrees));
    }
    found
}

/// Whether the point at `u` shows the surface in the square.
fn shows(k: &Forms, square: &Square, u: [f64; 3]) -> bool {
    let [p, ..] = evaluate(k.d, &k.lanes, u);
    let [e, ..] = evaluate(k.q, &k.eta, u);
    // E1 = W Ny, E2 = W Nx.
    square.shows([p[0] / p[2], p[1] / p[2]], [e[2], e[1]])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bernstein::count;

    /// Bernstein coefficients of degree 2 per axis through the values at 0, 1/2, 1.
    fn quadratic(f: impl Fn([f64; 3]) -> f64) -> Vec<f64> {
        let e = crate::tests::element([2; 3], |u| [f(u), 0.0, 0.0], [0; 3], &[0.0]);
        e.points.iter().map(|p| p[0]).collect()
    }

    #[test]
    fn cones_hold_all_gradients() {
        let d = [2; 3];
        let c = quadratic(|[u, v, w]| u + 0.2 * v * v + 0.3 * u * w - 0.1 * w * w);
        let (axis, cosine) = cone(d, &c).unwrap();
        for n in 0..125 {
            let u = [n % 5, n / 5 % 5, n / 25].map(|i| f64::from(i) * 0.25);
            let [_, x, y, z] = evaluate(d, &c, u);
            let g = DVec3::new(x, y, z).normalize();
            assert!(g.dot(axis) >= cosine - 1e-12, "{u:?}");
        }
        assert!(cosine > 0.8);
        // A gradient that vanishes has no direction.
        assert!(cone(d, &quadratic(|[u, ..]| (u - 0.5).powi(2))).is_none());
        assert_eq!(count(d), 27);
    }

    /// Normal cones that do not intersect, and two zeros: the text's rule is not enough, Elber's is.
    #[test]
    fn disjoint_normal_cones_do_not_mean_one_zero() {
        let d = [2; 3];
        let x = |u: f64| 2.0 * u - 1.0;
        let forms = [
            quadratic(|[u, ..]| x(u)),
            quadratic(|[_, v, _]| x(v)),
            quadratic(|[u, v, w]| x(u) + x(v) + 0.01 * (x(w).powi(2) - 0.25)),
        ];
        let cones = [0, 1, 2].map(|i| cone(d, &forms[i]).unwrap());
        let apart = |a: usize, b: usize| cones[a].0.angle_between(cones[b].0) > cones[a].1.acos() + cones[b].1.acos();
        assert!(apart(0, 1) && apart(0, 2) && apart(1, 2));
        assert!(!at_most_one_zero(cones));
        // Three directions of which none is in the plane of the others: one zero.
        let third = quadratic(|[u, v, w]| x(u) + x(v) + x(w) + 0.05 * x(w).powi(2));
        assert!(at_most_one_zero([cones[0], cones[1], cone(d, &third).unwrap()]));
    }

    #[test]
    fn points_beside_the_square_show_what_their_tangent_cuts() {
        let square = |region| Square {
            slope: [0.0; 2],
            half: 1.0,
            region,
        };
        let n = [1.0, 1.0];
        // The corner is cut by the tangent through (1.05, 0.8), not by that through (1.05, 1.2).
        assert!(!square(Region::Square).shows([1.05, 0.8], n));
        assert!(square(Region::Disc).shows([1.05, 0.8], n) && !square(Region::Disc).shows([1.05, 1.2], n));
        // Half-open.
        assert!(square(Region::Square).shows([-1.0, 0.0], n) && !square(Region::Square).shows([1.0, 0.0], n));
        assert!(square(Region::Square).meets(&[[0.5, 0.0, 1.0, 0.0]]) && !square(Region::Square).meets(&[[1.2, 0.0, 1.0, 0.0]]));
    }
}
