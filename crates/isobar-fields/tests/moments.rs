//! Polynomials the reconstructions must reproduce exactly: hardcases B9 to B14.

mod common;

use common::{Random, bisect, f32_grid};
use isobar_core::{DMat3, DVec3, Function, Grid, Samples, Stage};
use isobar_fields::{GridSpline, Kind};

fn spline(grid: &Grid, kind: Kind) -> GridSpline {
    GridSpline::new(grid, kind, Stage::Ideal).unwrap()
}

/// Samples i^2 + j^2 + k^2 about the middle of 2 half + 1 samples per axis.
fn squares(half: i32) -> Grid {
    let n = 2 * half as usize + 1;
    let s = |i: usize| f64::from((i as i32 - half).pow(2));
    f32_grid([n; 3], 1.0, DVec3::splat(-f64::from(half)), |i, j, k| s(i) + s(j) + s(k))
}

/// s = x^2 + y^2 + z^2 + defect away from the border, and the sphere of isovalue 100 has the radius given.
fn check_squares(kind: Kind, half: i32, defect: f64, radius: f64, tol: f64) {
    let s = spline(&squares(half), kind);
    let mut r = Random(3);
    for _ in 0..500 {
        let x = r.point(DVec3::splat(-11.0), DVec3::splat(11.0));
        assert!((s.value(x) - x.length_squared() - defect).abs() < tol, "{kind} at {x}");
        assert!((s.gradient(x) - 2.0 * x).length() < tol, "{kind} gradient at {x}");
    }
    for d in [DVec3::X, DVec3::new(1.0, 2.0, -3.0).normalize(), DVec3::NEG_ONE.normalize()] {
        let t = bisect(&s, 100.0, |t| d * t, 0.0, 12.0);
        assert!((t - radius).abs() < tol, "{kind}: {t} instead of {radius}");
    }
}

#[test]
fn b10_cubic_moment() {
    check_squares(Kind::Cubic, 14, 1.0, 9.949_874_371_066_2, 1e-12);
    // The mirror border of the prefilter is felt by 0.268^n after n samples: 28 samples away below 1e-15.
    check_squares(Kind::CubicInterpolating, 40, 0.0, 10.0, 1e-10);
}

#[test]
fn b11_quadratic_moment() {
    check_squares(Kind::Quadratic, 14, 0.75, 9.962_429_422_585_6, 1e-12);
    check_squares(Kind::QuadraticInterpolating, 40, 0.0, 10.0, 1e-10);
}

#[test]
fn b12_cubic_moment_in_one_dimension() {
    let g = f32_grid([17, 4, 4], 1.0, DVec3::new(-8.0, 0.0, 0.0), |i, _, _| {
        (i as f64 - 8.0).powi(3)
    });
    let s = spline(&g, Kind::Cubic);
    for n in -60..=60 {
        let x = f64::from(n) / 10.0;
        let v = s.value(DVec3::new(x, 1.3, 2.1));
        assert!((v - (x.powi(3) + x)).abs() < 1e-12, "at {x}: {v}");
        let d = s.gradient(DVec3::new(x, 1.3, 2.1));
        assert!(
            (d - DVec3::new(3.0 * x * x + 1.0, 0.0, 0.0)).length() < 1e-11,
            "gradient at {x}: {d}"
        );
    }
}

#[test]
fn b13_trilinear_hit_is_that_of_the_reconstruction() {
    let s = spline(&squares(12), Kind::Trilinear);
    for d in [DVec3::X, DVec3::Y, DVec3::Z, DVec3::NEG_X, DVec3::NEG_Z] {
        let t = bisect(&s, 90.25, |t| d * t, 0.0, 12.0);
        assert!((t - 9.486_842_105_263_158).abs() < 1e-12, "{t}");
    }
}

/// Plain B-splines take a clamped index outside, so planes are exact where the stencil stays inside; the interpolating ones mirror
/// and are exact to 0.268^n, n samples from the face.
#[test]
fn b14_planes() {
    let (a, b, c, d) = (0.75, -2.5, 1.25, 3.0);
    let n = 72;
    let grid = f32_grid([n; 3], 1.0, DVec3::ZERO, |i, j, k| {
        a * i as f64 + b * j as f64 + c * k as f64 + d
    });
    for kind in Kind::ALL {
        let s = spline(&grid, kind);
        let margin = match kind {
            Kind::Trilinear => 0.0,
            Kind::Quadratic | Kind::Cubic => 1.0,
            _ => 30.0,
        };
        let (lo, hi) = (DVec3::splat(margin), DVec3::splat((n - 1) as f64 - margin));
        let mut r = Random(11);
        for _ in 0..300 {
            let x = r.point(lo, hi);
            let want = a * x.x + b * x.y + c * x.z + d;
            assert!((s.value(x) - want).abs() < 2e-13, "{kind} at {x}");
            assert!((s.gradient(x) - DVec3::new(a, b, c)).length() < 1e-12, "{kind} at {x}");
        }
        let (from, to) = (DVec3::new(31.0, 40.5, 36.25), DVec3::new(39.0, 31.5, 35.25));
        let plane = |x: DVec3| a * x.x + b * x.y + c * x.z + d;
        let iso = 0.3 * plane(from) + 0.7 * plane(to);
        let t = bisect(&s, iso, |t| from.lerp(to, t), 0.0, 1.0);
        assert!((t - 0.7).abs() < 1e-14, "{kind}: {t}");
    }
}

/// f = g(x) + y with g of slope 1 before x = 1 and slope 2 after it (here moved to x = 4).
#[test]
fn b9_kink() {
    let g = |x: f64| if x < 4.0 { x } else { 2.0 * x - 4.0 };
    let grid = f32_grid([9, 9, 9], 1.0, DVec3::ZERO, |i, j, _| g(i as f64) + j as f64);
    for kind in Kind::ALL {
        let s = spline(&grid, kind);
        let h = 1e-9;
        let normal = |x: f64| s.gradient(DVec3::new(x, 4.2, 4.4)).normalize();
        let angle = normal(4.0 - h).cross(normal(4.0 + h)).length().asin().to_degrees();
        let want = if kind == Kind::Trilinear { 18.434_948_822_922 } else { 0.0 };
        assert!((angle - want).abs() < 1e-6, "{kind}: {angle}");
        // Quadratic pieces join half way between samples.
        let angle = normal(4.5 - h).cross(normal(4.5 + h)).length().asin().to_degrees();
        assert!(angle < 1e-6, "{kind} half way: {angle}");
    }
}

/// The world map: with direction, spacing and origin, value and gradient are those of the index-space spline.
#[test]
fn world_geometry() {
    let base = common::byte_grid([7, 6, 5], 5);
    let direction = DMat3::from_cols(
        DVec3::new(0.6, 0.8, 0.0),
        DVec3::new(0.8, -0.6, 0.0),
        DVec3::new(0.0, 0.6, 0.8),
    );
    let aligned = (DVec3::new(0.5, 2.0, 0.125), DVec3::new(-3.0, 1.0, 8.0), DMat3::IDENTITY);
    let skew = (DVec3::new(0.3, 1.7, 0.9), DVec3::new(10.0, -20.0, 30.0), direction);
    for (spacing, origin, direction) in [aligned, skew] {
        let grid = Grid::new(base.dims, spacing, origin, direction, base.samples.clone()).unwrap();
        for kind in Kind::ALL {
            let (local, world) = (spline(&base, kind), spline(&grid, kind));
            let d = world.domain();
            let mut r = Random(9);
            for _ in 0..50 {
                let u = r.point(d.lo, d.hi);
                assert!((world.value(d.world(u)) - local.value(u)).abs() < 1e-10);
                let g = d.world_gradient(local.gradient(u));
                assert!(
                    (world.gradient(d.world(u)) - g).length() < 1e-9 * (1.0 + g.length()),
                    "{kind}"
                );
            }
        }
    }
}

/// Outside the domain the value is that of the nearest point, and the border rule decides the stencil.
#[test]
fn domain_and_border() {
    let grid = f32_grid([4, 4, 4], 1.0, DVec3::ZERO, |i, _, _| [3.0, 5.0, 11.0, 4.0][i]);
    let at = |kind, x: f64| spline(&grid, kind).value(DVec3::new(x, 1.5, 1.5));
    for kind in Kind::ALL {
        assert_eq!(at(kind, -2.0), at(kind, 0.0));
        assert_eq!(at(kind, 9.0), at(kind, 3.0));
        let g = spline(&grid, kind);
        assert_eq!(g.gradient(DVec3::new(-1.0, 9.0, 1.5)), g.gradient(DVec3::new(0.0, 3.0, 1.5)));
    }
    // c(-1) = c(0), c(4) = c(3)
    assert!((at(Kind::Quadratic, 0.0) - (3.0 + 6.0 * 3.0 + 5.0) / 8.0).abs() < 1e-14);
    assert!((at(Kind::Cubic, 0.0) - (3.0 + 4.0 * 3.0 + 5.0) / 6.0).abs() < 1e-14);
    assert!((at(Kind::Cubic, 3.0) - (11.0 + 4.0 * 4.0 + 4.0) / 6.0).abs() < 1e-14);
    // mirrored: the slope at the ends vanishes, and the samples are met
    for kind in [Kind::QuadraticInterpolating, Kind::CubicInterpolating] {
        let s = spline(&grid, kind);
        for (x, v) in [(0.0, 3.0), (1.0, 5.0), (2.0, 11.0), (3.0, 4.0)] {
            assert!((at(kind, x) - v).abs() < 1e-13);
        }
        assert!(s.gradient(DVec3::new(0.0, 1.5, 1.5)).x.abs() < 1e-13);
        assert!(s.gradient(DVec3::new(3.0, 1.5, 1.5)).x.abs() < 1e-13);
    }
}

#[test]
fn bad_grids_are_refused() {
    let thin = Grid::unit([4, 1, 4], Samples::U8(vec![0; 16].into())).unwrap();
    let nan = Grid::unit([2, 2, 2], Samples::F32(vec![f32::NAN; 8].into())).unwrap();
    // The cubic prefilter amplifies alternation 27 times.
    let huge = f32_grid(
        [4; 3],
        1.0,
        DVec3::ZERO,
        |i, j, k| if (i + j + k) % 2 == 0 { 3e38 } else { -3e38 },
    );
    for kind in Kind::ALL {
        for stage in [Stage::Ideal, Stage::Stored] {
            let e = GridSpline::new(&thin, kind, stage).unwrap_err().to_string();
            assert!(e.contains(kind.name()) && e.contains("[4, 1, 4]"), "{e}");
            assert!(GridSpline::new(&nan, kind, stage).is_err());
            let overflows = kind.interpolates() && stage == Stage::Stored;
            assert_eq!(GridSpline::new(&huge, kind, stage).is_err(), overflows, "{kind} {stage:?}");
        }
    }
}
