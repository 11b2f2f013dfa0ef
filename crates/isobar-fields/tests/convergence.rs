//! Orders of convergence on a smooth field: values and gradients within 0.1 of theory.
//!
//! Measured 24 cells from the faces. The mirror border makes the normal derivative zero at a face, an error of order one there, which
//! the prefilter carries inward by 0.172^n (quadratic) or 0.268^n (cubic) after n cells: 3e-5 after 8 cells, enough to hide
//! the cubic's fourth order (2.16 was measured at 8 cells), 2e-14 after 24.

mod common;

use common::Random;
use isobar_core::{DMat3, DVec3, Function, Grid, Samples, Stage};
use isobar_fields::{GridSpline, Kind};

/// sin(3x) cos(2y) exp(z) with derivatives.
fn smooth(p: DVec3) -> f64 {
    (3.0 * p.x).sin() * (2.0 * p.y).cos() * p.z.exp()
}

fn gradient(p: DVec3) -> DVec3 {
    let (s, c) = (3.0 * p.x).sin_cos();
    let (t, d) = (2.0 * p.y).sin_cos();
    p.z.exp() * DVec3::new(3.0 * c * d, -2.0 * s * t, s * d)
}

/// Sum over the axes of the second derivatives.
fn laplacian(p: DVec3) -> f64 {
    (-9.0 - 4.0 + 1.0) * smooth(p)
}

/// Cells between the faces and the points of measurement.
const MARGIN: usize = 24;

/// A grid of n^3 points whose inner cube, [`MARGIN`] and more cells from the faces, is [-0.5, 0.5]^3.
///
/// Samples are f64 values rounded to f32; where the order is to be seen below 1e-7, the rounding is taken out: the spline is linear in
/// the samples, so those of the remainder (scaled to f32's range) are added. Two levels leave 2^-48.
fn splines(n: usize, kind: Kind) -> (f64, Vec<(f64, GridSpline)>) {
    let h = 1.0 / (n - 1 - 2 * MARGIN) as f64;
    let origin = DVec3::splat(-0.5 - MARGIN as f64 * h);
    let mut rest: Vec<f64> = (0..n * n * n)
        .map(|i| smooth(origin + h * DVec3::new((i % n) as f64, (i / n % n) as f64, (i / n / n) as f64)))
        .collect();
    let mut out = Vec::new();
    let mut factor = 1.0;
    for _ in 0..2 {
        let level: Vec<f32> = rest.iter().map(|&v| (v * factor) as f32).collect();
        for (r, &l) in rest.iter_mut().zip(&level) {
            *r -= f64::from(l) / factor;
        }
        let grid = Grid::new([n; 3], DVec3::splat(h), origin, DMat3::IDENTITY, Samples::F32(level.into())).unwrap();
        out.push((1.0 / factor, GridSpline::new(&grid, kind, Stage::Ideal).unwrap()));
        factor *= 2f64.powi(24);
    }
    (h, out)
}

/// Spacing, greatest error of value and of gradient over 4000 seeded points of the inner cube.
fn errors(n: usize, kind: Kind) -> (f64, f64, f64) {
    let (h, parts) = splines(n, kind);
    let mut r = Random(17);
    let (mut value, mut slope) = (0.0f64, 0.0f64);
    for _ in 0..4000 {
        let x = r.point(DVec3::splat(-0.5), DVec3::splat(0.5));
        let v: f64 = parts.iter().map(|(f, s)| f * s.value(x)).sum();
        let g: DVec3 = parts.iter().map(|(f, s)| *f * s.gradient(x)).sum();
        value = value.max((v - smooth(x)).abs());
        slope = slope.max((g - gradient(x)).length());
    }
    (h, value, slope)
}

/// Orders of value and gradient between the coarsest and the finest of n = 65 to 128.
fn orders(kind: Kind) -> (f64, f64) {
    let all: Vec<_> = [65, 77, 97, 128].map(|n| errors(n, kind)).into();
    let fit = |pick: fn(&(f64, f64, f64)) -> f64| {
        let points: Vec<(f64, f64)> = all.iter().map(|e| (e.0.ln(), pick(e).ln())).collect();
        let mean = |f: &dyn Fn(&(f64, f64)) -> f64| points.iter().map(f).sum::<f64>() / points.len() as f64;
        let (mx, my) = (mean(&|p| p.0), mean(&|p| p.1));
        mean(&|p| (p.0 - mx) * (p.1 - my)) / mean(&|p| (p.0 - mx).powi(2))
    };
    (fit(|e| e.1), fit(|e| e.2))
}

#[test]
fn trilinear_is_of_order_two() {
    let (v, g) = orders(Kind::Trilinear);
    println!("trilinear: value {v:.3}, gradient {g:.3}");
    assert!((v - 2.0).abs() < 0.1 && (g - 1.0).abs() < 0.1, "{v} {g}");
}

#[test]
fn interpolating_quadratic_is_of_order_three() {
    let (v, g) = orders(Kind::QuadraticInterpolating);
    println!("quadratic-interpolating: value {v:.3}, gradient {g:.3}");
    assert!((v - 3.0).abs() < 0.1 && (g - 2.0).abs() < 0.1, "{v} {g}");
}

#[test]
fn interpolating_cubic_is_of_order_four() {
    let (v, g) = orders(Kind::CubicInterpolating);
    println!("cubic-interpolating: value {v:.3}, gradient {g:.3}");
    assert!((v - 4.0).abs() < 0.1 && (g - 3.0).abs() < 0.1, "{v} {g}");
}

/// Samples as coefficients: order 2, error (h^2/8) f'' per axis (quadratic), (h^2/6) f'' (cubic); maths: corrections, section B.
#[test]
fn plain_splines_are_of_order_two_with_their_constants() {
    for (kind, constant) in [(Kind::Quadratic, 1.0 / 8.0), (Kind::Cubic, 1.0 / 6.0)] {
        let (v, g) = orders(kind);
        println!("{kind}: value {v:.3}, gradient {g:.3}");
        assert!((v - 2.0).abs() < 0.1 && (g - 2.0).abs() < 0.1, "{kind} {v} {g}");
        let (h, parts) = splines(128, kind);
        let mut r = Random(23);
        let (mut worst, mut largest) = (0.0f64, 0.0f64);
        for _ in 0..2000 {
            let x = r.point(DVec3::splat(-0.5), DVec3::splat(0.5));
            let e = parts.iter().map(|(f, s)| f * s.value(x)).sum::<f64>() - smooth(x);
            let predicted = constant * h * h * laplacian(x);
            worst = worst.max((e - predicted).abs());
            largest = largest.max(predicted.abs());
        }
        assert!(worst < 0.02 * largest, "{kind}: {worst} beside {largest}");
    }
}
