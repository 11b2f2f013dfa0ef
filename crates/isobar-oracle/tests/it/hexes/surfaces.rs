//! Parameter surfaces, the boundary, whole frames, clipping planes.

use super::{cuboid, element, expect, net, oracle, roots, through};
use crate::support::{Random, Spline, ray};
use isobar_core::{
    Channels, ClipPlane, DVec3, Frame, Function, HexElement, HexPatches, Hit, NO_SURFACE, Ray, Stop, Surface, SurfaceKind,
    TRILINEAR, View,
};
use isobar_fields::HexField;
use isobar_oracle::{Class, Multiplicity, Oracle, Truth, TruthError, check};
use std::{f64::consts::FRAC_1_SQRT_2, sync::Arc};

/// Quarter `n` of the annulus with radii 1 to 2 and z from 0 to 1 as a rational element, attribute u + v + w.
fn quarter(n: usize) -> HexElement {
    let turn = |x: f64, y: f64| [[x, y], [-y, x], [-x, -y], [y, -x]][n];
    let arc = [[1.0, 0.0, 1.0], [1.0, 1.0, FRAC_1_SQRT_2], [0.0, 1.0, 1.0]];
    let points = net([2, 1, 1], |[i, j, k]| {
        let [x, y] = turn(arc[i][0], arc[i][1]);
        let r = 1.0 + j as f64;
        [r * x, r * y, k as f64, arc[i][2]]
    });
    let values = net([1; 3], |i| [i.iter().sum::<usize>() as f64, 0.0, 0.0, 0.0]);
    element([2, 1, 1], points, [1; 3], values.iter().map(|v| v[0]).collect())
}

fn surface(kind: SurfaceKind) -> Surface {
    Surface {
        kind,
        ..Surface::isovalue(0.0, 0)
    }
}

/// t >= 0 where the line meets the circle of radius r about the z axis, within z in [0, 1].
fn cylinder(r: f64, line: &Ray, keep: impl Fn(DVec3) -> bool) -> Vec<f64> {
    let (o, d) = (line.origin.truncate(), line.direction.truncate());
    let (a, b, c) = (d.length_squared(), o.dot(d), o.length_squared() - r * r);
    let w = b * b - a * c;
    if w < 0.0 {
        return Vec::new();
    }
    [-1.0, 1.0]
        .map(|s: f64| (-b + s * w.sqrt()) / a)
        .into_iter()
        .filter(|&t| t >= 0.0 && (0.0..=1.0).contains(&line.at(t).z) && keep(line.at(t)))
        .collect()
}

/// Roots on a whole rational annulus against the quadratic equation: parameter surfaces v = const are cylinders.
#[test]
fn parameter_surfaces_of_an_annulus_are_cylinders() {
    let whole = oracle((0..4).map(quarter).collect(), 0.0);
    let mut random = Random(3);
    let mut found = 0;
    for n in 0..15_000 {
        let v = [0.5, 0.0, 1.0, 0.3][n % 4];
        let o = whole.with_surface(SurfaceKind::Parameter { axis: 1, value: v }).unwrap();
        let r = through(&mut random, DVec3::new(-2.0, -2.0, 0.0), DVec3::new(2.0, 2.0, 1.0));
        let want = cylinder(1.0 + v, &r, |_| true);
        let all = o.all(&r);
        let grazing = want.len() == 2 && want[1] - want[0] < 1e-3;
        assert!(
            all.unresolved.is_empty() && (grazing || all.roots.len() == want.len()),
            "{r:?} {all:?} {want:?}"
        );
        for (x, t) in all.roots.iter().zip(&want) {
            assert!(
                grazing || (x.t() - t).abs() < 1e-11 && x.multiplicity == Multiplicity::Simple,
                "{x:?} {want:?}"
            );
        }
        found += all.roots.len();
    }
    assert!(found > 7500, "{found}");
    // w = 1/2 is a plane, u = 1/2 four half planes; both between the cylinders only
    let w = whole.with_surface(SurfaceKind::Parameter { axis: 2, value: 0.5 }).unwrap();
    expect(&w, &ray([1.25, 0.5, 2.0], [0.0, 0.0, -1.0]), &[1.5]);
    expect(&w, &ray([0.25, 0.5, 2.0], [0.0, 0.0, -1.0]), &[]);
    let u = whole.with_surface(SurfaceKind::Parameter { axis: 0, value: 0.5 }).unwrap();
    expect(&u, &ray([0.0, 1.0, 0.5], [1.0, 0.0, 0.0]), &[1.0]);
    // Along the plane x = 0, where quarters meet: z is the same on both.
    expect(&w, &ray([0.0, 1.5, 2.0], [0.0, 0.0, -1.0]), &[1.5]);
    assert!(whole.with_surface(SurfaceKind::Parameter { axis: 3, value: 0.5 }).is_none());
    assert!(whole.with_surface(SurfaceKind::Parameter { axis: 0, value: 1.5 }).is_none());
}

/// The boundary of the whole annulus: two cylinders and two rings, nothing where quarters meet.
#[test]
fn the_boundary_is_what_no_two_elements_share() {
    let whole = oracle((0..4).map(quarter).collect(), 0.0)
        .with_surface(SurfaceKind::Boundary)
        .unwrap();
    let mut random = Random(8);
    let mut found = 0;
    for _ in 0..8000 {
        let r = through(&mut random, DVec3::new(-2.0, -2.0, 0.0), DVec3::new(2.0, 2.0, 1.0));
        let mut want = cylinder(1.0, &r, |_| true);
        want.extend(cylinder(2.0, &r, |_| true));
        for z in [0.0, 1.0] {
            let t = (z - r.origin.z) / r.direction.z;
            let out = r.at(t).truncate().length();
            want.extend((t >= 0.0 && (1.0..=2.0).contains(&out)).then_some(t));
        }
        want.sort_by(f64::total_cmp);
        let all = whole.all(&r);
        let close = want.windows(2).any(|w| w[1] - w[0] < 1e-3);
        assert!(
            all.unresolved.is_empty() && (close || all.roots.len() == want.len()),
            "{r:?} {all:?} {want:?}"
        );
        assert!(close || all.roots.iter().zip(&want).all(|(x, t)| (x.t() - t).abs() < 1e-11));
        // Twice in, twice out.
        assert!(close || all.roots.len().is_multiple_of(2));
        found += all.roots.len();
    }
    assert!(found > 10_000, "{found}");
    // Through the common edge of four cubes: the faces only.
    let cubes = (0..4)
        .map(|n| {
            let lo = DVec3::new(f64::from(n & 1), f64::from(n >> 1), 0.0);
            cuboid(lo, lo + 1.0, [0; 3], vec![0.0])
        })
        .collect();
    let o = oracle(cubes, 0.0).with_surface(SurfaceKind::Boundary).unwrap();
    expect(&o, &ray([1.0, 1.0, 3.0], [0.0, 0.0, -1.0]), &[2.0, 3.0]);
    expect(&o, &ray([1.0, 0.5, 3.0], [0.0, 0.0, -1.0]), &[2.0, 3.0]);
    // Along the diagonal by the corners: three faces each, one root.
    let corner = roots(&o, &ray([-1.0, -1.0, -0.5], [2.0, 2.0, 1.0]));
    assert_eq!(corner.iter().map(|r| r.0).collect::<Vec<_>>(), [0.5, 1.5]);
}

fn perfect(f: &Arc<dyn Function>, truth: &Truth, v: &View) -> Frame {
    let mut frame = Frame::new(v.width, v.height, 1, Channels::T | Channels::NORMAL | Channels::SURFACE);
    for (i, p) in truth.pixels.iter().enumerate().filter(|(_, p)| p.is_hit()) {
        let point = v.ray(i % v.width, i / v.width).at(p.t());
        let hit = Hit {
            t: p.t(),
            point,
            normal: f.gradient(point).normalize_or_zero().as_vec3().to_array(),
            surface: p.surface,
            t_error: 0.0,
        };
        frame.set_hit(0, i, &hit);
    }
    frame
}

#[test]
fn frames_are_checked_against_the_truth_of_elements() {
    let patches = HexPatches::new((0..4).map(quarter).collect::<Vec<_>>()).unwrap();
    let f: Arc<dyn Function> = Arc::new(HexField::new(&patches).unwrap());
    let view = View::fit(isobar_core::Data::Hexes(patches).bounds(), 40.0, 48, 36);
    let surfaces = [
        Surface::isovalue(1.2, 0),
        surface(SurfaceKind::Parameter { axis: 1, value: 0.25 }),
        surface(SurfaceKind::Boundary),
    ];
    for shown in [&surfaces[..1], &surfaces[..2], &surfaces[1..]] {
        let truth = Truth::compute(&f, shown, &view, &Stop::default()).unwrap();
        assert!(
            truth.hits() > 100 && truth.pixels.iter().all(|p| !p.unresolved),
            "{}",
            truth.hits()
        );
        assert_eq!(Truth::from_bytes(&truth.to_bytes()).unwrap(), truth);
        let frame = perfect(&f, &truth, &view);
        let all = check(&frame, &truth, &f, shown, &view).unwrap();
        assert_eq!((all.missed, all.false_hits, all.wrong_root, all.wrong_surface), (0, 0, 0, 0));
        assert_eq!(all.t_error_voxels.max, 0.0);
        // The inverse map that the gradient is taken by is good to 1e-12 of an element.
        assert!(all.normal_error_deg.max < 1e-3 || all.normal_error_deg.max.is_nan());
        // Another surface's name is seen.
        if shown.len() > 1 {
            let mut frame = frame;
            let certain = |p: &isobar_oracle::TruePixel| p.is_hit() && !p.undecidable;
            let i = truth.pixels.iter().position(certain).unwrap();
            frame.surface[i] = 1 - truth.pixels[i].surface;
            assert_eq!(check(&frame, &truth, &f, shown, &view).unwrap().class[i], Class::WrongSurface);
        }
    }
    // An invisible surface is no hit; other functions have no parameters.
    let hidden = [Surface {
        opacity: 0.0,
        ..surfaces[2]
    }];
    let truth = Truth::compute(&f, &hidden, &view, &Stop::default()).unwrap();
    assert!(truth.pixels.iter().all(|p| p.surface == NO_SURFACE));
    let lattice: Arc<dyn Function> = Arc::new(Spline::new([3; 3], &TRILINEAR, |i, _, _| i));
    let refused = Truth::compute(&lattice, &surfaces[2..], &view, &Stop::default());
    assert!(matches!(refused, Err(TruthError::Unsupported(_))));
}

#[test]
fn clipping_planes_and_the_start_of_the_ray_cut_roots() {
    // s = x on [0, 4]
    let o = oracle(
        vec![cuboid(DVec3::ZERO, DVec3::new(4.0, 1.0, 1.0), [2, 0, 0], vec![0.0, 8.0, 0.0])],
        3.0,
    );
    // 4 (x/4)(1 - x/4) 4 = 3: x = 1 and 3
    let r = ray([-1.0, 0.25, 0.5], [1.0, 0.0, 0.0]);
    expect(&o, &r, &[2.0, 4.0]);
    let clip = |normal: DVec3, distance: f64| ClipPlane {
        normal,
        distance,
        cap: false,
    };
    expect(&o.with_clips(&[clip(-DVec3::X, -2.0)]), &r, &[4.0]);
    expect(&o.with_clips(&[clip(DVec3::X, 2.0)]), &r, &[2.0]);
    // A root exactly on a plane counts, as one exactly at the start of the ray.
    expect(&o.with_clips(&[clip(-DVec3::X, -3.0)]), &r, &[4.0]);
    expect(&o, &ray([3.0, 0.25, 0.5], [1.0, 0.0, 0.0]), &[0.0]);
    expect(&o, &ray([3.0f64.next_up(), 0.25, 0.5], [1.0, 0.0, 0.0]), &[]);
    expect(&o, &ray([2.0, 0.25, 0.5], [1.0, 0.125, 0.0]), &[1.0]);
    assert!(o.undecidable(&ray([3.0, 0.25, 0.5], [1.0, 0.0, 0.0])));
}

/// Numbers that the bounds do not hold for are left open, never wrong.
#[test]
fn extreme_numbers_are_left_open() {
    let far = |x: f64| {
        Oracle::new(
            Arc::new(
                HexField::new(&HexPatches::new(vec![cuboid(DVec3::ZERO, DVec3::splat(x), [1, 0, 0], vec![0.0, 1.0])]).unwrap())
                    .unwrap(),
            ),
            0.5,
        )
    };
    let along = |x: f64| ray([-x, 0.25 * x, 0.5 * x], [1.0, 0.0, 0.0]);
    let all = far(1e40).all(&along(1e40));
    assert!(all.roots.is_empty() && all.unresolved.len() == 1);
    for x in [1e-30, 1e-12, 1e12, 1e30] {
        let all = far(x).all(&along(x));
        assert!(all.unresolved.is_empty() && all.roots.len() == 1, "{x} {all:?}");
        assert!((all.roots[0].t() - 1.5 * x).abs() <= 1e-15 * x);
    }
}
