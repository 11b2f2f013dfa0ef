//! Enclosures hold every sample, converge, and say the domain's cut; for all kinds of grids and all analytic fields.

mod common;

use common::Random;
use isobar_core::{DVec3, Function, Grid, Interval, Ray, Samples, Stage, Structure};
use isobar_fields::{GridSpline, Kind, Synthetic, analytic};
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::sync::Arc;

fn field(name: &str) -> Arc<dyn Function> {
    analytic(name, &BTreeMap::new()).unwrap().function
}

/// Values of s at points of the box lie in its enclosure, but for the rounding of the value itself.
fn check_box(f: &dyn Function, lo: DVec3, hi: DVec3, slack: f64, r: &mut Random) -> Interval {
    let e = f.enclosure(lo, hi);
    let d = f.domain();
    let (a, b) = (lo.max(d.lo).min(d.hi), hi.min(d.hi).max(d.lo));
    let corner = |n: usize| DVec3::select(glam_mask(n), b, a);
    let points = (0..8).map(corner).chain((0..24).map(|_| r.point(a, b))).collect::<Vec<_>>();
    for u in points {
        let v = f.value(d.world(u));
        assert!(
            e.lo - slack <= v && v <= e.hi + slack,
            "{}: {v} at {u} not in {e:?} of {lo} {hi}",
            f.name()
        );
    }
    e
}

fn glam_mask(n: usize) -> glam::BVec3 {
    glam::BVec3::new(n & 1 != 0, n & 2 != 0, n & 4 != 0)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn grids_are_enclosed(
        dims in prop::array::uniform3(2usize..9),
        kind in prop::sample::select(Kind::ALL.to_vec()),
        offset in prop::sample::select(vec![0.0f32, 1e6]),
        ideal: bool,
        seed: u64,
        size in -30i32..4,
    ) {
        let mut r = Random(seed);
        let s: Vec<f32> = (0..dims.iter().product::<usize>()).map(|_| offset + r.range(-1.0, 1.0) as f32).collect();
        let grid = Grid::unit(dims, Samples::F32(s.into())).unwrap();
        let stage = if ideal { Stage::Ideal } else { Stage::Stored };
        let s = GridSpline::new(&grid, kind, stage).unwrap();
        let hi = s.domain().hi;
        // Boxes that start on cell faces, half way, and anywhere, inside and across the domain's end.
        let at = match seed % 3 {
            0 => r.point(DVec3::splat(-1.0), hi + 1.0).round(),
            1 => r.point(DVec3::splat(-1.0), hi + 1.0).floor() + 0.5,
            _ => r.point(DVec3::splat(-1.0), hi + 1.0),
        };
        let edge = 2f64.powi(size) * r.unit();
        let slack = f64::from(offset).max(30.0) * 1e-14;
        check_box(&s, at, at + edge, slack, &mut r);
        // A box across the lower side of a face, one number wide.
        check_box(&s, (at - 1e-16).min(at.map(f64::next_down)), at, slack, &mut r);
    }

    #[test]
    fn fields_are_enclosed(name in prop::sample::select(Synthetic::NAMES.to_vec()), seed: u64, size in -30i32..2) {
        let f = field(name);
        let mut r = Random(seed);
        let (lo, hi) = (f.domain().lo, f.domain().hi);
        let at = if seed.is_multiple_of(4) { DVec3::ZERO } else { r.point(lo, hi) };
        let edge = 2f64.powi(size) * r.unit();
        // The value's own rounding: some ulps of the largest term.
        let slack = match name { "clebsch" | "barth-sextic" | "kummer" | "mitchell" => 1e-11, "chmutov" => 1e-12, _ => 1e-11 };
        check_box(&*f, at, at + edge, slack, &mut r);
    }

    #[test]
    fn rays_are_enclosed(name in prop::sample::select(vec!["marschner-lobb", "gyroid", "chmutov"]), seed: u64, size in -30i32..2) {
        let f = field(name);
        let Structure::Analytic(a) = f.structure() else { panic!("{name} is not analytic") };
        let mut r = Random(seed);
        let half = f.domain().hi.x;
        // Through the axis of the Marschner-Lobb field now and then, where r is not smooth.
        let through = if seed.is_multiple_of(3) { DVec3::new(0.0, 0.0, 0.3) } else { r.point(-DVec3::splat(half), DVec3::splat(half)) };
        let direction = r.point(DVec3::NEG_ONE, DVec3::ONE).normalize();
        let back = r.range(0.0, 1.0);
        let ray = Ray { origin: through - direction * back, direction };
        let width = 2f64.powi(size) * r.unit();
        let t = Interval::new(back - 0.5 * width, back + 0.5 * width);
        let (value, slope) = a.along_ray(&ray, t);
        for n in 0..=16 {
            let s = (t.lo + (t.hi - t.lo) * f64::from(n) / 16.0).clamp(t.lo, t.hi);
            let x = ray.at(s);
            if x.abs().max_element() > half {
                continue;
            }
            let v = f.value(x);
            let d = f.gradient(x).dot(direction);
            prop_assert!(value.lo - 1e-12 <= v && v <= value.hi + 1e-12, "{} {:?} {:?} {} {}", name, ray, t, v, value.width());
            let big = 1e-11 * (1.0 + d.abs());
            prop_assert!(slope.lo - big <= d && d <= slope.hi + big, "{} {:?} {:?} {} {:?}", name, ray, t, d, slope);
        }
    }
}

/// What the width of the enclosure exceeds that of the linear part by falls with the square of the box, in every kind.
#[test]
fn enclosures_converge() {
    let grid = common::f32_grid([9; 3], 1.0, DVec3::ZERO, |i, j, k| ((i * 7 + j * 5 + k * 3) as f64).sin());
    let at = DVec3::new(3.3, 4.7, 2.6);
    let mut functions: Vec<(Arc<dyn Function>, DVec3)> = Synthetic::NAMES
        .iter()
        .map(|n| (field(n), DVec3::new(0.31, -0.27, 0.53)))
        .collect();
    for kind in Kind::ALL {
        functions.push((Arc::new(GridSpline::new(&grid, kind, Stage::Ideal).unwrap()), at));
    }
    for (f, at) in functions {
        let width = |h: f64| f.enclosure(at - h, at + h).width();
        // |grad s| l1 times the box's edge is what the range itself measures.
        let slope = f.gradient(f.domain().world(at)).abs().element_sum();
        let excess = |h: f64| width(h) - 2.0 * h * slope;
        // The mean value form exceeds by 4 h^2 times the sum of the absolute second derivatives, and these are over-estimated in turn.
        let bend: f64 = [DVec3::X, DVec3::Y, DVec3::Z]
            .iter()
            .map(|&e| {
                (f.gradient(f.domain().world(at + 1e-4 * e)) - f.gradient(f.domain().world(at - 1e-4 * e)))
                    .abs()
                    .element_sum()
                    / 2e-4
            })
            .sum();
        for e in 7..18 {
            let h = 2f64.powi(-e);
            let bound = 16.0 * h * h * (1.0 + bend) + 1e-11;
            assert!(excess(h) <= bound, "{} at 2^-{e}: {} {bound}", f.name(), excess(h));
        }
        assert!(width(1e-9) < 3e-9 * (1.0 + slope) && width(0.0) < 1e-11, "{}", f.name());
    }
}

/// Along rays: exact to rounding where monotone, an excess of second order at an extremum; the slope's is of first order.
#[test]
fn ray_enclosures_are_tight() {
    for name in ["marschner-lobb", "gyroid", "chmutov"] {
        let f = field(name);
        let Structure::Analytic(a) = f.structure() else {
            panic!("{name} is not analytic")
        };
        let ray = Ray {
            origin: DVec3::new(-0.4, 0.3, 0.2),
            direction: DVec3::new(0.6, 0.64, 0.48),
        };
        let slope = |t: f64| f.gradient(ray.at(t)).dot(ray.direction);
        let excess = |at: f64, h: f64| {
            let (value, derivative) = a.along_ray(&ray, Interval::new(at - h, at + h));
            let range = |g: &dyn Fn(f64) -> f64| {
                let samples = (-500..=500).map(|n| g(at + h * f64::from(n) / 500.0));
                let (lo, hi) = samples.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| (v.min(lo), v.max(hi)));
                hi - lo
            };
            (
                value.width() - range(&|t| f.value(ray.at(t))),
                derivative.width() - range(&slope),
            )
        };
        assert!(slope(0.3).abs() > 0.1, "{name}");
        assert!(excess(0.3, 1e-4).0 < 1e-13, "{name}: {:?}", excess(0.3, 1e-4));
        let quotient = excess(0.3, 1e-3).1 / excess(0.3, 1e-4).1;
        assert!((8.0..130.0).contains(&quotient), "{name}: {quotient}");
        // An extremum on the ray.
        let step = 1e-3;
        let n = (0..2000)
            .find(|&n| slope(step * f64::from(n)) * slope(step * f64::from(n + 1)) < 0.0)
            .unwrap();
        let (mut lo, mut hi) = (step * f64::from(n), step * f64::from(n + 1));
        for _ in 0..60 {
            let m = 0.5 * (lo + hi);
            if slope(lo) * slope(m) < 0.0 {
                hi = m;
            } else {
                lo = m;
            }
        }
        let quotient = excess(lo, 1e-3).0 / excess(lo, 1e-4).0;
        assert!(
            (70.0..1100.0).contains(&quotient),
            "{name}: {quotient} {:?}",
            excess(lo, 1e-3)
        );
        let (value, slope) = a.along_ray(&ray, Interval::point(0.3));
        assert!(value.width() < 1e-12 && slope.width() < 1e-10, "{name}: {value:?} {slope:?}");
        // An unbounded interval is no reason to fail.
        let (value, _) = a.along_ray(&ray, Interval::new(0.0, f64::INFINITY));
        assert!(value.contains(f.value(ray.at(1.0))));
    }
}
