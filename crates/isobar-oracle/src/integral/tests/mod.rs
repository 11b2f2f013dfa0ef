//! Closed forms (hardcases E5), dense quadrature, and scenes that are the same in other words.

mod scenes;

use super::*;
use crate::{Decided, Truth};
use isobar_core::{Algebraic, DVec3, Grid, Samples, Stop, SurfaceKind, TetMesh, View};
use isobar_fields::{AlgebraicFunction, GridSpline, Kind, TetLinear, Type6Spline, grid_to_tets};

fn random(seed: &mut u64) -> f64 {
    *seed = seed
        .wrapping_mul(6_364_136_223_846_793_005)
        .wrapping_add(1_442_695_040_888_963_407);
    (*seed >> 11) as f64 / (1u64 << 53) as f64
}

fn ray(o: [f64; 3], d: [f64; 3]) -> Ray {
    Ray {
        origin: o.into(),
        direction: d.into(),
    }
}

/// n^3 samples at whole coordinates.
fn grid(n: usize, s: impl FnMut(DVec3) -> f64) -> Grid {
    let at = |i: usize| DVec3::new((i % n) as f64, (i / n % n) as f64, (i / n / n) as f64);
    let samples: Vec<f32> = (0..n * n * n).map(at).map(s).map(|v| v as f32).collect();
    Grid::unit([n; 3], Samples::F32(samples.into())).unwrap()
}

fn spline(grid: &Grid, kind: Kind) -> Arc<dyn Function> {
    Arc::new(GridSpline::new(grid, kind, isobar_core::Stage::Stored).unwrap())
}

fn tets(grid: &Grid) -> Arc<dyn Function> {
    Arc::new(TetLinear::new(&grid_to_tets(grid).unwrap()).unwrap())
}

fn tf(points: &[(f64, [f32; 3], f32)], unit: f64) -> TransferFunction {
    TransferFunction::new(points.to_vec(), unit).unwrap()
}

fn integral(f: &Arc<dyn Function>, medium: &TransferFunction) -> Integral {
    Integral::new(f, &[], Some(medium), Reference::Integral, Model::VolumeDensity, &[]).unwrap()
}

fn surface(c: f64, colour: [f32; 3], opacity: f32) -> Surface {
    Surface {
        kind: SurfaceKind::Isovalue(c),
        colour,
        opacity,
    }
}

const RED: [f32; 3] = [1.0, 0.0, 0.0];
const BLUE: [f32; 3] = [0.0, 0.0, 1.0];
const WHITE: [f32; 3] = [1.0; 3];

/// Within the proved error, which is at most `most`, and in every channel.
#[track_caller]
fn near(c: &Colour, want: [f64; 4], most: f64) {
    assert!(c.error <= most, "{c:?}");
    for (x, y) in c.rgba.iter().zip(want) {
        assert!((x - y).abs() <= c.error + 1e-15, "{c:?} {want:?}");
    }
}

/// hardcases E5, on a mesh and on a grid: constant extinction, and extinction equal to the value.
#[test]
fn closed_forms_of_the_opacity() {
    let g = grid(6, |x| x.x);
    let constant = tf(&[(0.0, RED, 3.0)], 4.0);
    let ramp = tf(&[(0.0, RED, 0.0), (8.0, RED, 8.0)], 10.0);
    for f in [tets(&g), spline(&g, Kind::Trilinear)] {
        for (o, d, l) in [
            ([-3.0, 1.25, 2.7], [1.0, 0.0, 0.0], 5.0),
            // not of unit length, and backwards
            ([7.0, 1.25, 2.7], [-2.0, 0.0, 0.0], 5.0),
            ([1.5, 2.2, 3.3], [0.5, 0.0, 0.0], 3.5),
        ] {
            let a = 1.0 - (-0.75f64 * l).exp();
            near(&integral(&f, &constant).colour(&ray(o, d)), [a, 0.0, 0.0, a], 1e-12);
            let mean = if l == 5.0 { 2.5 } else { 3.25 };
            let a = 1.0 - (-0.1 * mean * l).exp();
            near(&integral(&f, &ramp).colour(&ray(o, d)), [a, 0.0, 0.0, a], 1e-12);
        }
        // oblique: l = sqrt(2) * 5, s from 0 to 5
        let r = ray([-1.0, -1.0, 0.5], [1.0, 1.0, 0.0]);
        let a = 1.0 - (-0.1 * 2.5 * 50f64.sqrt()).exp();
        near(&integral(&f, &ramp).colour(&r), [a, 0.0, 0.0, a], 1e-12);
        near(
            &integral(&f, &ramp).colour(&ray([-1.0, 9.0, 0.5], [1.0, 0.1, 0.0])),
            [0.0; 4],
            1e-12,
        );
    }
}

/// A colour that changes along the ray: constant extinction k and green s/5 give (1/(5k)) (1 - (1 + k l) exp(-k l)); the emitter without extinction gives l^2/10.
#[test]
fn closed_forms_of_the_colour() {
    let g = grid(6, |x| x.x);
    for f in [tets(&g), spline(&g, Kind::Trilinear)] {
        for k in [0.01f32, 0.3, 2.0, 40.0] {
            let m = tf(&[(0.0, [0.0; 3], k), (5.0, [0.0, 1.0, 0.0], k)], 1.0);
            let c = integral(&f, &m).colour(&ray([-1.0, 1.2, 1.4], [1.0, 0.0, 0.0]));
            let k = f64::from(k);
            let e = (-5.0 * k).exp();
            near(&c, [0.0, (1.0 - (1.0 + 5.0 * k) * e) / (5.0 * k), 0.0, 1.0 - e], 2e-10);
        }
        let m = tf(&[(0.0, [0.0; 3], 0.0), (5.0, [0.0, 1.0, 0.0], 0.0)], 2.0);
        let of = |model| Integral::new(&f, &[], Some(&m), Reference::Integral, model, &[]).unwrap();
        let r = ray([-1.0, 1.2, 1.4], [1.0, 0.0, 0.0]);
        near(&of(Model::DensityEmitter).colour(&r), [0.0, 1.25, 0.0, 0.0], 2e-10);
        near(&of(Model::VolumeDensity).colour(&r), [0.0; 4], 1e-12);
    }
}

/// A triangle of half-width h in the value, crossed at ds/dl = 1: depth d h / unit, whatever its width, and whatever the step of the cells.
#[test]
fn narrow_peaks_are_not_stepped_over() {
    let g = grid(6, |x| x.x);
    for f in [tets(&g), spline(&g, Kind::Trilinear), spline(&g, Kind::Cubic)] {
        for h in [0.3, 1e-3, 1e-6, 1e-9] {
            let d = (1.0 / h) as f32;
            let m = tf(&[(2.5 - h, RED, 0.0), (2.5, WHITE, d), (2.5 + h, RED, 0.0)], 1.0);
            let c = integral(&f, &m).colour(&ray([-1.0, 2.2, 2.4], [1.0, 0.0, 0.0]));
            // the knots themselves are rounded to f64
            let depth = 0.5 * f64::from(d) * ((2.5 + h) - (2.5 - h));
            let a = 1.0 - (-depth).exp();
            // roundings of the value times the steepness: 1.5e-13/h on the mesh and trilinear, 5.3e-13/h cubic
            assert!(
                (c.rgba[3] - a).abs() <= c.error && c.error < 2e-12 + 6e-13 / h,
                "{h:e} {c:?} {a}"
            );
            assert!((c.rgba[0] - a).abs() <= c.error && c.rgba[1] > 0.3 && c.rgba[1] < 0.6);
        }
    }
}

/// A transfer function with steps, a thin peak and colours everywhere.
fn rich(lo: f64, hi: f64) -> TransferFunction {
    let v = |x: f64| lo + (hi - lo) * x;
    tf(
        &[
            (v(0.05), [0.1, 0.9, 0.3], 0.0),
            (v(0.3), [0.8, 0.2, 0.1], 0.6),
            (v(0.42), [0.2, 0.2, 1.0], 0.1),
            (v(0.449), [0.9, 0.9, 0.2], 0.0),
            (v(0.45), [1.0, 0.6, 0.2], 9.0),
            (v(0.451), [0.3, 0.9, 0.2], 0.0),
            (v(0.7), [0.3, 0.1, 0.2], 0.0),
            (v(0.9), [0.9, 0.5, 0.7], 1.5),
        ],
        0.8,
    )
}

/// The midpoint rule with n steps: colours premultiplied.
fn dense(f: &Arc<dyn Function>, m: &TransferFunction, r: &Ray, stay: (f64, f64), n: usize) -> [f64; 4] {
    dense_model(f, m, r, stay, n, Model::VolumeDensity)
}

fn dense_model(f: &Arc<dyn Function>, m: &TransferFunction, r: &Ray, (t0, t1): (f64, f64), n: usize, model: Model) -> [f64; 4] {
    let step = (t1 - t0) / n as f64;
    let h = step * r.direction.length() / m.unit;
    let (mut out, mut through) = ([0.0; 4], 1.0);
    for i in 0..n {
        let s = f.value(r.at(t0 + (i as f64 + 0.5) * step));
        let (c, density) = m.at(s);
        let a = -(-density * h).exp_m1();
        for k in 0..3 {
            out[k] += match model {
                Model::VolumeDensity => through * a * c[k],
                Model::DensityEmitter => through * (-0.5 * density * h).exp() * h * c[k],
            };
        }
        through *= 1.0 - a;
    }
    out[3] = 1.0 - through;
    out
}

fn noise(n: usize, seed: u64) -> Grid {
    let mut s = seed;
    grid(n, |_| random(&mut s))
}

fn all_kinds(g: &Grid) -> Vec<(&'static str, Arc<dyn Function>)> {
    vec![
        ("mesh", tets(g)),
        ("trilinear", spline(g, Kind::Trilinear)),
        ("quadratic", spline(g, Kind::Quadratic)),
        ("cubic", spline(g, Kind::Cubic)),
        ("type6", Arc::new(Type6Spline::new(g).unwrap())),
    ]
}

fn through(seed: &mut u64, n: f64) -> Ray {
    let mut p = |size: f64| DVec3::new(random(seed), random(seed), random(seed)) * size;
    let (from, to) = (p(3.0 * n) - n, p(n));
    Ray {
        origin: from,
        direction: (to - from) * 0.7,
    }
}

/// Random rays through noise by dense quadrature, whose own error is that of its steps; and the bound is small.
#[test]
fn dense_quadrature_agrees() {
    let g = noise(6, 5);
    let m = rich(0.0, 1.0);
    let mut seed = 77;
    for (name, f) in all_kinds(&g) {
        let exact = integral(&f, &m);
        let mut worst = 0.0f64;
        for _ in 0..12 {
            let r = through(&mut seed, 5.0);
            let Some(stay) = g.domain().clip(&r) else { continue };
            let c = exact.colour(&r);
            assert!(c.error < 2e-10, "{name} {r:?} {c:?}");
            let d = dense(&f, &m, &r, stay, 40_000);
            for (x, y) in c.rgba.iter().zip(d) {
                worst = worst.max((x - y).abs());
            }
        }
        assert!(worst < 2e-4, "{name}: {worst:e}");
        assert!(worst > 1e-12, "{name}: dense quadrature cannot be so good");
    }
}

/// Both models, with a transfer function that is smooth enough for the midpoint rule to be good to 1e-7.
#[test]
fn both_models_agree_with_dense_quadrature() {
    let g = noise(5, 15);
    let m = tf(
        &[
            (0.1, [0.9, 0.1, 0.4], 0.2),
            (0.5, [0.1, 0.8, 0.3], 0.9),
            (0.8, [0.2, 0.3, 1.0], 0.0),
        ],
        1.3,
    );
    let mut seed = 5;
    for (name, f) in all_kinds(&g) {
        for model in [Model::VolumeDensity, Model::DensityEmitter] {
            let i = Integral::new(&f, &[], Some(&m), Reference::Integral, model, &[]).unwrap();
            for _ in 0..4 {
                let r = through(&mut seed, 4.0);
                let Some(stay) = g.domain().clip(&r) else { continue };
                let (c, d) = (i.colour(&r), dense_model(&f, &m, &r, stay, 40_000, model));
                assert!(
                    c.rgba.iter().zip(d).all(|(x, y)| (x - y).abs() < 1e-7),
                    "{name} {model:?} {c:?} {d:?}"
                );
                assert!(c.error < 1e-9, "{name} {model:?} {c:?}");
            }
        }
    }
}

/// A ray cut into pieces by clipping planes and composed again is the whole ray: segments do not matter. Half of the cuts lie on faces of cells.
#[test]
fn segments_compose() {
    let g = noise(6, 9);
    let m = rich(0.0, 1.0);
    let mut seed = 3;
    for (name, f) in all_kinds(&g) {
        let whole = integral(&f, &m);
        for n in 0..12 {
            let r = through(&mut seed, 5.0);
            let r = if r.direction.x < 0.0 {
                Ray {
                    direction: -r.direction,
                    ..r
                }
            } else {
                r
            };
            let cut = if n % 2 == 0 { 5.0 * random(&mut seed) } else { 3.0 };
            let plane = |sign: f64| ClipPlane {
                normal: DVec3::X * sign,
                distance: cut * sign,
                cap: false,
            };
            let part = |sign: f64| {
                Integral::new(&f, &[], Some(&m), Reference::Integral, Model::VolumeDensity, &[plane(sign)])
                    .unwrap()
                    .colour(&r)
            };
            let (a, b, all) = (part(1.0), part(-1.0), whole.colour(&r));
            for i in 0..4 {
                let both = a.rgba[i] + (1.0 - a.rgba[3]) * b.rgba[i];
                let error = all.error + 2.0 * (a.error + b.error);
                assert!(
                    (both - all.rgba[i]).abs() <= error && error < 1e-9,
                    "{name} {n}: {both} {all:?}"
                );
            }
        }
    }
}

/// The same in floating point, double-double (meshes) and integers; also for rays inside faces, along edges and in the planes of the type-6 partition.
#[test]
fn stages_agree() {
    let g = noise(5, 21);
    let m = rich(0.0, 1.0);
    let mut seed = 8;
    for (name, f) in all_kinds(&g) {
        let exact = Integral {
            oracle: Oracle::new(f.clone(), 0.0).with_stage(Decided::Exact),
            ..integral(&f, &m)
        };
        let float = integral(&f, &m);
        let mut rays: Vec<Ray> = (0..6).map(|_| through(&mut seed, 4.0)).collect();
        rays.extend([
            ray([-2.0, 2.0, 1.3], [1.0, 0.0, 0.0]),
            ray([-2.0, 2.0, 3.0], [1.0, 0.0, 0.0]),
            ray([5.0, 5.0, 5.0], [-1.0, -1.0, -1.0]),
            ray([-1.0, 1.0, 0.7], [0.5, 0.5, 0.0]),
            ray([2.5, 2.5, -3.0], [0.0, 0.0, 1.0]),
            ray([-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]),
            ray([-1.0, 4.0, 1.5], [1.0, 0.0, 0.0]),
        ]);
        for r in &rays {
            let (a, b) = (float.colour(r), exact.colour(r));
            for i in 0..4 {
                assert!((a.rgba[i] - b.rgba[i]).abs() <= a.error + b.error, "{name} {r:?} {a:?} {b:?}");
            }
            assert!(a.error < 5e-10 && b.error < 5e-10, "{name} {r:?} {a:?} {b:?}");
        }
    }
}

/// A ray inside a face is the limit of rays beside it, from both sides, and is not counted twice.
#[test]
fn rays_inside_faces_are_limits() {
    let g = noise(5, 33);
    let m = tf(&[(0.0, RED, 0.1), (1.0, WHITE, 0.9)], 1.0);
    for (name, f) in all_kinds(&g) {
        let i = integral(&f, &m);
        for o in [[-2.0, 2.0, 1.3], [-2.0, 1.0, 3.0], [-2.0, 2.5, 2.5]] {
            let on = i.colour(&ray(o, [1.0, 0.0, 0.0])).rgba;
            for e in [1e-7, -1e-7] {
                let beside = i.colour(&ray([o[0], o[1] + e, o[2] - 0.3 * e], [1.0, 0.0, 0.0])).rgba;
                for k in 0..4 {
                    assert!(
                        (on[k] - beside[k]).abs() < 1e-6 && on[3] > 0.5,
                        "{name} {o:?}: {on:?} {beside:?}"
                    );
                }
            }
        }
    }
}

/// A linear function is the same on a mesh and on grids of every kind (quadratic and cubic reproduce it away from the border), with both cameras, clipped, with surfaces.
#[test]
fn meshes_and_grids_agree_on_linear_functions() {
    let g = grid(9, |x| 0.25 * x.x + 0.5 * x.y - 0.125 * x.z);
    let m = rich(-1.0, 6.0);
    let surfaces = [surface(2.0, RED, 0.4), surface(3.25, BLUE, 0.7), surface(1.0, WHITE, 1.0)];
    let centre = DVec3::splat(4.0);
    let eye = DVec3::new(14.0, 11.0, 13.0);
    let mut perspective = View::perspective(eye, centre, DVec3::Z, 30.0, 24, 18);
    let inner = |normal: DVec3, distance: f64| ClipPlane {
        normal,
        distance,
        cap: false,
    };
    // all that is left is two cells from the border
    perspective.clips = (0..3)
        .flat_map(|a| [inner(DVec3::AXES[a], 6.0), inner(-DVec3::AXES[a], -2.0)])
        .collect();
    let mut orthographic = perspective.clone();
    orthographic.camera = isobar_core::Camera::Orthographic {
        eye,
        target: centre,
        up: DVec3::Z,
        height: 8.0,
    };
    for view in [perspective, orthographic] {
        for reference in [Reference::Integral, Reference::Peaks, Reference::PeaksAlone] {
            let of =
                |f: &Arc<dyn Function>| Colours::compute(f, &surfaces, Some(&m), reference, &view, &Stop::default()).unwrap();
            let all: Vec<(&str, Colours)> = all_kinds(&g).iter().map(|(n, f)| (*n, of(f))).collect();
            let base = &all[0].1;
            let seen = base.rgba.iter().filter(|c| c[3] > 0.3).count();
            assert!(seen > 60, "{reference:?} {seen}");
            for (name, c) in &all[1..] {
                for (i, (x, y)) in base.rgba.iter().zip(&c.rgba).enumerate() {
                    let e = base.error[i] + c.error[i];
                    for k in 0..4 {
                        // shading is of f32 size: the gradients' last bits
                        assert!((x[k] - y[k]).abs() <= e + 3e-7, "{name} {reference:?} {i}: {x:?} {y:?} {e:e}");
                    }
                }
                assert!(c.greatest_error() < 1e-9, "{name}: {:e}", c.greatest_error());
            }
            // the surfaces are those that Truth finds
            let f = &all_kinds(&g)[1].1;
            let truth = Truth::compute(f, &surfaces[2..], &view, &Stop::default()).unwrap();
            for (p, c) in truth.pixels.iter().zip(&all[1].1.rgba) {
                assert!(!p.is_hit() || c[3] > 1.0 - 1e-9);
            }
        }
    }
}

/// Densities far beyond opacity, a camera far away and data far from 0 keep a small bound.
#[test]
fn extremes_keep_their_bound() {
    let g = noise(5, 4);
    let m = rich(0.0, 1.0);
    let thick = TransferFunction { unit: 1e-9, ..m.clone() };
    let far = grid(5, |x| 1e4 + x.x);
    let ramp = tf(&[(1e4, RED, 0.0), (1e4 + 4.0, WHITE, 1.0)], 1.0);
    for (name, f) in all_kinds(&g) {
        let r = ray([-9e6, -9e6, 2.0], [0.6, 0.600_000_1, 0.000_000_01]);
        let c = integral(&f, &m).colour(&r);
        assert!(c.error < 1e-9 && c.rgba[3] > 0.05, "{name}: {c:?}");
        let c = integral(&f, &thick).colour(&ray([-3.0, 1.9, 2.1], [1.0, 0.02, 0.03]));
        // an end of the stay is known to some 1e-15, and a length of 1e-9 is opaque
        assert!(c.error < 1e-4 && (c.rgba[3] - 1.0).abs() <= c.error, "{name}: {c:?}");
    }
    for (name, f) in all_kinds(&far) {
        let c = integral(&f, &ramp).colour(&ray([-3.0, 1.9, 2.1], [1.0, 0.0, 0.0]));
        let want = 1.0 - (-2.0f64).exp();
        let alike = !["mesh", "trilinear"].contains(&name) || (c.rgba[3] - want).abs() <= c.error;
        assert!(c.error < 1e-9 && alike, "{name}: {c:?} {want}");
    }
}

/// A medium denser than f64 can follow, in a band that it leaves and enters again: the bound says that nothing is known, and soon.
#[test]
fn hopeless_media_end() {
    let g = noise(5, 4);
    for density in [1e18, 1e25, 1e30] {
        let m = tf(&[(0.0, RED, density), (1.0, BLUE, 0.0)], 1.0);
        for (name, f) in all_kinds(&g) {
            let c = integral(&f, &m).colour(&ray([-3.0, 1.9, 2.1], [1.0, 0.02, 0.03]));
            assert!(
                c.error >= 1.0 || (c.rgba[3] - 1.0).abs() <= c.error,
                "{name} {density}: {c:?}"
            );
            assert!(c.leaves < 100_000, "{name} {density}: {c:?}");
        }
    }
}

/// A polynomial over a box: s = x along x, and a sextic against dense quadrature.
#[test]
fn polynomials_in_world_coordinates() {
    let make = |terms: Vec<([u8; 3], f64)>| -> Arc<dyn Function> {
        let p = Algebraic::new("p", terms, DVec3::splat(-1.0), DVec3::splat(1.0)).unwrap();
        Arc::new(AlgebraicFunction::new(p).unwrap())
    };
    let f = make(vec![([1, 0, 0], 1.0)]);
    let m = tf(&[(-1.0, RED, 0.0), (1.0, RED, 2.0)], 1.0);
    let c = integral(&f, &m).colour(&ray([-5.0, 0.3, 0.2], [1.0, 0.0, 0.0]));
    let a = 1.0 - (-2.0f64).exp();
    near(&c, [a, 0.0, 0.0, a], 1e-12);
    // a constant
    let c = integral(&make(vec![([0, 0, 0], 0.5)]), &m).colour(&ray([-5.0, 0.3, 0.2], [1.0, 0.0, 0.0]));
    let a = 1.0 - (-3.0f64).exp();
    near(&c, [a, 0.0, 0.0, a], 1e-12);
    let f = make(vec![([6, 0, 0], 1.0), ([0, 4, 2], -1.5), ([0, 0, 1], 0.7), ([0, 0, 0], 0.1)]);
    let m = rich(-0.8, 1.2);
    let i = integral(&f, &m);
    let mut seed = 6;
    for _ in 0..8 {
        let mut p = |s: f64| DVec3::new(random(&mut seed) - 0.5, random(&mut seed) - 0.5, random(&mut seed) - 0.5) * s;
        let (from, to) = (p(8.0), p(1.5));
        let r = Ray {
            origin: from,
            direction: to - from,
        };
        let Some(stay) = f.domain().clip(&r) else { continue };
        let (c, d) = (i.colour(&r), dense(&f, &m, &r, stay, 40_000));
        assert!(c.error < 1e-9, "{c:?}");
        assert!(c.rgba.iter().zip(d).all(|(x, y)| (x - y).abs() < 1e-4), "{c:?} {d:?}");
    }
}

/// Gaps of a mesh hold nothing, cells that overlap count once.
#[test]
fn gaps_and_overlaps() {
    let tet = |z: f64| [[0.0, 0.0, z], [4.0, 0.0, z], [0.0, 4.0, z], [0.0, 0.0, z + 4.0]];
    let build = |zs: &[f64]| -> Arc<dyn Function> {
        let points: Vec<DVec3> = zs.iter().flat_map(|&z| tet(z)).map(DVec3::from_array).collect();
        let cells: Vec<[u32; 4]> = (0..zs.len() as u32).map(|i| [0, 1, 2, 3].map(|k| 4 * i + k)).collect();
        let values = vec![0.5f32; points.len()];
        Arc::new(TetLinear::new(&TetMesh::new(points.into(), cells.into(), values.into()).unwrap()).unwrap())
    };
    let m = tf(&[(0.0, RED, 1.0)], 1.0);
    // at (1, 1) a cell is 2 high
    let r = ray([1.0, 1.0, -1.0], [0.0, 0.0, 1.0]);
    for (zs, length) in [
        (&[0.0][..], 2.0),
        (&[0.0, 5.0][..], 4.0),
        (&[0.0, 1.0][..], 3.0),
        (&[0.0, 0.0][..], 2.0),
    ] {
        let a = 1.0 - f64::exp(-length);
        near(&integral(&build(zs), &m).colour(&r), [a, 0.0, 0.0, a], 1e-12);
    }
}
