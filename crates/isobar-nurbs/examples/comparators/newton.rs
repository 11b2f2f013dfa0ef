//! Newton's method (or bisection) along the ray on the inverse map, between the ray's entries into and exits from each element.
//!
//! The entries and exits are those of `nurbs/cpu` (the boundary of each element alone), so what is lost here is lost by the iteration: the inverse map `u(t)` by Newton's method on `V(u) = r(t)` from
//! where the last one ended, and `f(t) = a(u(t)) - c` with `f' = grad a . d` started in the middle of the stay.

use crate::{Failure, Scene, draw};
use isobar_core::{DVec3, HexElement, HexPatches, Ray, Surface, SurfaceKind};
use isobar_fields::{HexPoint, evaluate_hex};

/// Steps along the ray, and of each inverse map.
const STEPS: usize = 20;
/// Greatest number of entries and exits of one element on one ray.
const LAYERS: usize = 8;

/// The element at the parameter that maps to a point: Newton's method from `u`.
fn inverse(e: &HexElement, x: DVec3, u: &mut DVec3, evaluations: &mut usize) -> Option<HexPoint> {
    let size = e
        .points
        .iter()
        .map(|p| p[0].abs().max(p[1].abs()).max(p[2].abs()))
        .fold(0.0, f64::max);
    for _ in 0..STEPS {
        *evaluations += 1;
        let p = evaluate_hex(e, *u);
        let miss = p.position - x;
        if miss.length() <= 1e-13 * size {
            // Beyond the element the extended map is another function.
            return (u.min_element() >= -1e-9 && u.max_element() <= 1.0 + 1e-9).then_some(p);
        }
        let step = p.jacobian.inverse() * miss;
        if !step.is_finite() {
            return None;
        }
        *u = (*u - step).clamp(DVec3::splat(-0.5), DVec3::splat(1.5));
    }
    None
}

/// The root of one stay, if the iteration finds it.
fn root(e: &HexElement, c: f64, ray: &Ray, (from, to): (f64, f64), bisect: bool, evaluations: &mut usize) -> Option<f64> {
    let mut u = DVec3::splat(0.5);
    let mut f = |t: f64| {
        let p = inverse(e, ray.at(t), &mut u, evaluations)?;
        Some((p.value - c, p.gradient().dot(ray.direction)))
    };
    if bisect {
        // The ends lie on the boundary to within rounding: a little inside.
        let inset = 1e-9 * (to - from);
        let (mut a, mut b) = (from + inset, to - inset);
        let (fa, fb) = (f(a)?.0, f(b)?.0);
        if (fa < 0.0) == (fb < 0.0) {
            return None;
        }
        for _ in 0..60 {
            let m = 0.5 * (a + b);
            if (f(m)?.0 < 0.0) == (fa < 0.0) { a = m } else { b = m }
        }
        return Some(0.5 * (a + b));
    }
    let mut t = 0.5 * (from + to);
    for _ in 0..STEPS {
        let (value, slope) = f(t)?;
        let step = value / slope;
        if !step.is_finite() {
            return None;
        }
        if step.abs() <= 1e-10 * (to - from) {
            return Some(t);
        }
        t -= step;
        if !(from..=to).contains(&t) {
            return None;
        }
    }
    None
}

/// What is found on every pixel, by t, and how often V was evaluated.
pub(crate) fn draw_all(scene: &Scene, bisect: bool) -> Result<(Vec<Vec<f64>>, usize), Failure> {
    let (view, n) = (&scene.view, scene.view.pixels());
    let boundary = [Surface {
        kind: SurfaceKind::Boundary,
        opacity: 0.5,
        ..Surface::isovalue(0.0, 0)
    }];
    let (mut found, mut evaluations) = (vec![Vec::new(); n], 0);
    for e in scene.patches.elements.iter() {
        let (lo, hi) = e.value_range();
        if scene.isovalue < lo || scene.isovalue > hi {
            continue;
        }
        let frame = draw(&HexPatches::new(vec![e.clone()])?, &boundary, view, LAYERS)?;
        for (i, out) in found.iter_mut().enumerate() {
            let ends: Vec<f64> = (0..LAYERS).map(|l| frame.t[l * n + i]).filter(|t| t.is_finite()).collect();
            let ray = view.ray(i % view.width, i / view.width);
            for stay in ends.chunks_exact(2) {
                out.extend(root(e, scene.isovalue, &ray, (stay[0], stay[1]), bisect, &mut evaluations));
            }
        }
    }
    found.iter_mut().for_each(|f| f.sort_by(f64::total_cmp));
    Ok((found, evaluations))
}
