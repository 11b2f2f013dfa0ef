//! Where on the ray a point of an element lies, and the slope of s there.
//!
//! On the line, `t = T(u)/(W(u) d_k)` with `T = sum w_i (p_ik - o_k) B_i` and k the axis of the greatest `|d_k|`. De Casteljau's steps `a + u (b - a)` carry the
//! errors of all three along, so the ball that comes out holds t for all parameters in theirs. For a within e_a, b within e_b and u within e_u the exact step is
//! wrong by at most `|1 - u| e_a + |u| e_b + |b - a| e_u + e_u (e_a + e_b)`, and rounding adds a difference, a product and a sum: at most 2U of
//! `|u| |b - a|`, twice, and U of the result, for which `6U (|a| + |b|)(1 + |u|)` is used.

use super::{
    Line, Target,
    forms::{Number, up},
};
use crate::tets::ball::Ball;
use isobar_core::{DVec3, HexElement};

/// One step of de Casteljau.
fn between<R: Number>(a: Ball<R>, b: Ball<R>, u: Ball<R>) -> Ball<R> {
    let difference = b.x - a.x;
    let (size, at) = (a.x.f64().abs() + b.x.f64().abs(), u.x.f64());
    let carried = (1.0 - at).abs() * a.e + at.abs() * b.e + difference.f64().abs() * u.e + u.e * (a.e + b.e);
    // `1 - at` and the leading parts are rounded too: half an ulp each, which `up` and the least errors cover.
    let leading = 4.0 * f64::EPSILON * (a.e + size * u.e);
    Ball {
        x: a.x + difference * u.x,
        e: up(carried + leading + 6.0 * R::UNIT * size * (1.0 + at.abs())),
    }
}

/// The last point of de Casteljau's scheme.
fn point<R: Number>(mut c: Vec<Ball<R>>, degree: [u8; 3], u: &[Ball<R>; 3]) -> Ball<R> {
    let mut slab = c.len();
    for axis in (0..3).rev() {
        let n = usize::from(degree[axis]);
        slab /= n + 1;
        for last in (1..=n).rev() {
            for i in 0..last * slab {
                let (a, b) = (c[i], c[i + slab]);
                c[i] = between(a, b, u[axis]);
            }
        }
    }
    c[0]
}

/// t of all points of the line with parameters in the balls; `None` where the weights' sum may vanish there.
pub(super) fn along<R: Number>(element: &HexElement, line: &Line, u: &[Ball<R>; 3]) -> Option<Ball<R>> {
    let k = line.along;
    let polynomial = element.is_polynomial();
    let numerator = element
        .points
        .iter()
        .map(|p| {
            let x = Ball::difference(p[k], line.origin[k]);
            if polynomial { x } else { x.times(Ball::exact(p[3])) }
        })
        .collect();
    let t = point(numerator, element.degree, u);
    let mut below = Ball::exact(line.direction[k]);
    if !polynomial {
        let weights = element.points.iter().map(|p| Ball::exact(p[3])).collect();
        below = below.times(point(weights, element.degree, u));
    }
    t.over(below)
}

/// Bernstein polynomials of one degree and their derivatives at x.
pub(super) fn basis(n: usize, x: f64) -> (Vec<f64>, Vec<f64>) {
    let raise = |b: &[f64]| -> Vec<f64> {
        (0..=b.len())
            .map(|i| {
                let left = if i > 0 { x * b[i - 1] } else { 0.0 };
                let right = if i < b.len() { (1.0 - x) * b[i] } else { 0.0 };
                left + right
            })
            .collect()
    };
    if n == 0 {
        return (vec![1.0], vec![0.0]);
    }
    let lower = (1..n).fold(vec![1.0], |b, _| raise(&b));
    let slope = (0..=n)
        .map(|i| {
            let left = if i > 0 { lower[i - 1] } else { 0.0 };
            let right = if i < n { lower[i] } else { 0.0 };
            n as f64 * (left - right)
        })
        .collect();
    (raise(&lower), slope)
}

/// Value and gradient of a tensor-product polynomial, in f64.
fn jet(degree: [u8; 3], u: &[f64; 3], coefficient: impl Fn(usize) -> f64) -> (f64, DVec3) {
    let b = [0, 1, 2].map(|a| basis(usize::from(degree[a]), u[a]));
    let (mut value, mut gradient) = (0.0, DVec3::ZERO);
    let mut at = 0;
    for k in 0..=usize::from(degree[2]) {
        for j in 0..=usize::from(degree[1]) {
            for i in 0..=usize::from(degree[0]) {
                let (x, y, z) = (b[0].0[i], b[1].0[j], b[2].0[k]);
                let c = coefficient(at);
                value += c * x * y * z;
                gradient += c * DVec3::new(b[0].1[i] * y * z, x * b[1].1[j] * z, x * y * b[2].1[k]);
                at += 1;
            }
        }
    }
    (value, gradient)
}

/// ds/dt along the ray at parameters u, rounded: with v along the line's preimage, `(grad s . v)/(grad t . v)`. Infinite or 0 where the line
/// stops or s does.
pub(super) fn slope(element: &HexElement, line: &Line, target: Target, u: &[f64; 3]) -> f64 {
    let p = &element.points;
    let (k, [i, j]) = (line.along, line.others);
    let (o, d) = (line.origin, line.direction);
    let of = |f: &dyn Fn(&[f64; 4]) -> f64| jet(element.degree, u, |n| f(&p[n]));
    let across = |i: usize| of(&|p| p[3] * (d[k] * (p[i] - o[i]) - d[i] * (p[k] - o[k]))).1;
    let (weight, weight_slope) = of(&|p| p[3]);
    let (way, way_slope) = of(&|p| p[3] * (p[k] - o[k]));
    let value_slope = match target {
        Target::Parameter { axis, .. } => DVec3::AXES[axis],
        Target::Isovalue(c) if element.rational_value => {
            let (_, g) = jet(element.degree, u, |n| p[n][3] * (element.values[n] - c));
            g / weight
        }
        Target::Isovalue(_) => jet(element.value_degree, u, |n| element.values[n]).1,
    };
    let v = across(i).cross(across(j));
    let t_slope = (way_slope - weight_slope * (way / weight)) / (weight * d[k]);
    let slope = value_slope.dot(v) / t_slope.dot(v);
    if slope.is_nan() { 0.0 } else { slope }
}
