//! How fast reconstructions converge to the field they were sampled from: no renderer and no root finder of a method is involved.
//!
//! At seeded points x of the exact isosurface f = c, at least `BORDER` cells from the faces, the isosurface of the reconstruction s
//! lies |s(x) - c| / |grad f(x)| away to first order in the error, which is what an order is fitted to.
//!
//! Interpolating kinds mirror the samples at the faces. Where the field has a slope there, the kink disturbs the coefficients, and the
//! disturbance falls by 0.268 (cubic) or 0.172 (quadratic) per cell: to 3e-5 of `h |grad f|` over 8 cells, which is more than the error of the cubic
//! kind itself, to 7e-10 over 16 and 2e-14 over 24. So the points are 16 cells from the faces at the coarsest sampling and at least 24 at those that
//! are fitted.

use crate::results::Convergence;
use anyhow::{Result, bail};
use isobar_core::{DVec3, Data, Function, Stage};
use isobar_fields::{Kind, Reconstruction, Synthetic};

/// Cells kept between the points and the faces at the coarsest sampling.
const BORDER: usize = 16;

/// Points on the surface.
const POINTS: usize = 600;

/// Samples per axis measured; the fit uses the last four.
const COUNTS: [usize; 6] = [65, 81, 97, 129, 161, 193];

/// The orders of position and normal that theory promises.
#[must_use]
pub fn theory(reconstruction: Reconstruction) -> [f64; 2] {
    use Reconstruction::{Tensor, Type6, Type6Prefiltered};
    match reconstruction {
        // Maths: corrections, section A: (h^2/8) Laplacian in the value; the prefilter removes that term.
        Type6 => [2.0, 2.0],
        Type6Prefiltered => [3.0, 2.0],
        // Not interpolating: the B-spline of the samples smooths them, an error of order 2 in value and gradient alike.
        Tensor(Kind::Quadratic | Kind::Cubic) => [2.0, 2.0],
        Tensor(Kind::Trilinear) => [2.0, 1.0],
        Tensor(Kind::QuadraticInterpolating) => [3.0, 2.0],
        Tensor(Kind::CubicInterpolating) => [4.0, 3.0],
    }
}

/// Whether a measured order is the one promised, within 0.1.
///
/// The order of `type6-prefiltered` is met from above: its term of order 3 is small beside the next one on smooth fields (3.26 on the torus with 97 to
/// 193 samples, 3.34 and 3.13 on another field with 12 to 24 and 36 to 72 cells, 3.02 with 48 to 96), and finer lattices meet the rounding of
/// f32 samples. It may exceed its promise by 0.4.
#[must_use]
pub fn is_met(reconstruction: &str, order: f64, promised: f64) -> bool {
    let above = if reconstruction == "type6-prefiltered" { 0.4 } else { 0.1 };
    order > promised - 0.1 && order < promised + above
}

/// Measures every reconstruction on a field of the command line.
///
/// # Errors
/// When the field does not exist or has no surface in the inner part of its box.
pub fn measure(name: &str) -> Result<Vec<Convergence>> {
    let field: Synthetic = name.parse()?;
    let points = surface_points(field.field().function.as_ref(), field.field().isovalue)?;
    let mut all: Vec<Convergence> = (Reconstruction::ALL.iter())
        .map(|k| Convergence {
            field: name.to_owned(),
            reconstruction: k.to_string(),
            theory: theory(*k),
            ..Convergence::default()
        })
        .collect();
    for n in COUNTS {
        let Data::Grid(grid) = format!("{name},n={n}").parse::<Synthetic>()?.data()? else {
            bail!("{name} is not a grid");
        };
        for (kind, out) in Reconstruction::ALL.iter().zip(&mut all) {
            let s = kind.of(&grid, Stage::Ideal)?;
            let (position, normal) = errors(s.as_ref(), field.field().function.as_ref(), field.field().isovalue, &points);
            out.n.push(n);
            out.position.push(position);
            out.normal.push(normal);
        }
    }
    for c in &mut all {
        c.slope = slope(&c.n, &c.position);
        c.normal_slope = slope(&c.n, &c.normal);
    }
    Ok(all)
}

/// Root mean square of the distances between the surfaces, and of the angles between the normals, degrees.
fn errors(s: &dyn Function, f: &dyn Function, isovalue: f64, points: &[DVec3]) -> (f64, f64) {
    let (mut d, mut a) = (0.0, 0.0);
    for &x in points {
        let g = f.gradient(x);
        d += ((s.value(x) - isovalue) / g.length()).powi(2);
        let h = s.gradient(x);
        // The angle by its tangent: accurate where it is small.
        a += g.cross(h).length().atan2(g.dot(h)).to_degrees().powi(2);
    }
    let n = points.len() as f64;
    ((d / n).sqrt(), (a / n).sqrt())
}

/// Seeded points with f = c, bisected to rounding, in the inner part of the box.
fn surface_points(f: &dyn Function, isovalue: f64) -> Result<Vec<DVec3>> {
    let domain = f.domain();
    let margin = BORDER as f64 / (COUNTS[0] as f64 - 1.0);
    let (lo, hi) = (
        domain.lo + (domain.hi - domain.lo) * margin,
        domain.hi - (domain.hi - domain.lo) * margin,
    );
    let mut state = 20_090_u64;
    let mut next = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let mut points = Vec::with_capacity(POINTS);
    for _ in 0..POINTS * 400 {
        let a = lo + (hi - lo) * DVec3::new(next(), next(), next());
        let b = (a + (DVec3::new(next(), next(), next()) - 0.5) * (hi - lo) * 0.1).clamp(lo, hi);
        let (mut a, mut b) = (domain.world(a), domain.world(b));
        let below = |x: DVec3| f.value(x) < isovalue;
        if below(a) == below(b) {
            continue;
        }
        for _ in 0..60 {
            let m = (a + b) * 0.5;
            if below(m) == below(a) { a = m } else { b = m }
        }
        // Where the gradient vanishes there is no normal to compare.
        if f.gradient(a).length() > 1e-3 {
            points.push(a);
            if points.len() == POINTS {
                return Ok(points);
            }
        }
    }
    bail!("{} has no surface at {isovalue} in the inner part of its box", f.name())
}

/// Order of the error in the cell size: least squares on the logarithms of the last four counts.
fn slope(n: &[usize], error: &[f64]) -> f64 {
    let from = n.len().saturating_sub(4);
    let points: Vec<(f64, f64)> = (n[from..].iter().zip(&error[from..]))
        .filter(|(_, e)| **e > 0.0)
        .map(|(n, e)| (-(*n as f64 - 1.0).ln(), e.ln()))
        .collect();
    let count = points.len() as f64;
    let (mx, my) = points
        .iter()
        .fold((0.0, 0.0), |(a, b), (x, y)| (a + x / count, b + y / count));
    let (top, bottom) = (points.iter()).fold((0.0, 0.0), |(t, b), (x, y)| (t + (x - mx) * (y - my), b + (x - mx).powi(2)));
    top / bottom
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_border_is_far_from_the_fit() {
        let margin = BORDER as f64 / (COUNTS[0] - 1) as f64;
        let fitted = &COUNTS[COUNTS.len() - 4..];
        assert!(fitted.iter().all(|n| margin * (n - 1) as f64 >= 24.0));
    }

    #[test]
    fn slopes_are_fitted_on_logarithms() {
        let n = [11, 21, 41, 81, 161];
        let error: Vec<f64> = n.iter().map(|n| 3.0 / ((n - 1) as f64).powi(3)).collect();
        assert!((slope(&n, &error) - 3.0).abs() < 1e-12);
    }

    /// The orders that the page shows in red where they fail.
    #[test]
    fn orders_are_those_of_the_theory() {
        for c in measure("torus").unwrap() {
            let name = &c.reconstruction;
            assert!(is_met(name, c.slope, c.theory[0]), "{name}: {} {:?}", c.slope, c.position);
            assert!(
                is_met(name, c.normal_slope, c.theory[1]),
                "{name}: {} {:?}",
                c.normal_slope,
                c.normal
            );
        }
    }

    #[test]
    fn points_lie_on_the_surface_and_inside() {
        let f: Synthetic = "gyroid".parse().unwrap();
        let points = surface_points(f.field().function.as_ref(), f.field().isovalue).unwrap();
        assert_eq!(points.len(), POINTS);
        for p in points {
            assert!(p.abs().max_element() <= 0.5 + 1e-12);
            assert!((f.field().function.value(p) - f.field().isovalue).abs() < 1e-13);
        }
    }
}
