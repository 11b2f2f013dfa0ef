//! Tests at the level of the method.

use crate::MARCH_CPU;
use crate::testing::{Seed, draw, isovalues, rays, ready, request, sampled};
use isobar_core::{
    Camera, Channels, ClipPlane, DMat3, DVec3, Data, DataError, Frame, Function, Grid, Knobs, Method, NO_SURFACE, Ray,
    RenderError, Request, Samples, Sampling, Scene, Stage, Stop, Surface, SurfaceKind, TransferFunction, View,
};
use isobar_cpu::Level;
use isobar_fields::{GridSpline, Kind};
use std::sync::Arc;

fn knobs() -> Knobs {
    Knobs::default()
}

/// A ray along +x through (y, z).
fn along_x(y: f64, z: f64) -> Ray {
    Ray {
        origin: DVec3::new(0.0, y, z),
        direction: DVec3::X,
    }
}

/// hardcases B14: planes are hit within the bisection's bound, whatever the reconstruction, step and direction.
#[test]
fn planes_are_hit_within_the_bound_of_the_bisection() {
    let normal = DVec3::new(0.5, -0.25, 1.0);
    let data = sampled(25, |x| normal.dot(x));
    let rays = rays(3, 400, 12.0);
    for kind in [Kind::Trilinear, Kind::Quadratic, Kind::Cubic] {
        for (step, bisections) in [(0.5, 8), (0.3, 3), (4.0, 12)] {
            let k = knobs()
                .with("reconstruction", kind)
                .with("step", step)
                .with("bisections", bisections);
            let f = draw(
                &MARCH_CPU,
                &data,
                &isovalues(&[0.375]),
                &View::rays(rays.clone()),
                &request(k),
            );
            let mut seen = 0;
            for (i, r) in rays.iter().enumerate() {
                let t = (0.375 - normal.dot(r.origin)) / normal.dot(r.direction);
                // B-splines with clamped coefficients are not linear in the outer cells
                if t < 1.0 || r.at(t).abs().max_element() > 10.0 {
                    continue;
                }
                let bound = step * 0.5f64.powi(bisections + 1) + 1e-9;
                assert!((f.t[i] - t).abs() <= bound, "{kind} step {step}: {} for {t}", f.t[i]);
                let n = DVec3::from_array(f.normal[i].map(f64::from));
                assert!((n - normal.normalize()).length() < 1e-6, "{kind}: normal {n}");
                assert!((f.point[i] - r.at(f.t[i])).length() < 1e-12);
                seen += 1;
            }
            assert!(seen > 100, "{seen} of the planes' hits are inside");
        }
    }
}

/// hardcases B13 and B10: with bisections enough the hit is the root of the reconstruction to 1e-12, not that of the model.
#[test]
fn the_root_of_the_reconstruction_is_reached() {
    let data = sampled(31, |x| x.length_squared());
    let hit = |kind: Kind, c: f64, direction: DVec3| {
        let ray = Ray {
            origin: DVec3::ZERO,
            direction,
        };
        let k = knobs().with("bisections", 60).with("reconstruction", kind);
        draw(&MARCH_CPU, &data, &isovalues(&[c]), &View::rays(vec![ray]), &request(k)).t[0]
    };
    let close = |got: f64, want: f64| assert!((got - want).abs() <= 1e-12 * want, "{got} for {want}");
    close(hit(Kind::Trilinear, 90.25, DVec3::X), 9.486_842_105_263_158);
    let diagonal = DVec3::ONE.normalize();
    for d in [DVec3::X, DVec3::NEG_Z, diagonal, DVec3::new(0.6, 0.0, 0.8)] {
        close(hit(Kind::Cubic, 100.0, d), 99.0f64.sqrt());
        close(hit(Kind::Quadratic, 100.0, d), 99.25f64.sqrt());
    }
    let unit = hit(Kind::CubicInterpolating, 100.0, DVec3::X);
    assert!((unit - 10.0).abs() < 1e-4, "{unit}: the mirrored border reaches this far in");
}

/// The samples of every type, as noise of the same shape.
fn noise(seed: u64, dims: [usize; 3], kind: usize) -> Arc<Data> {
    let mut s = Seed(seed);
    let n = dims.iter().product();
    // waves and a little noise, so that some blocks are free of the isovalues
    let (phase, wave) = (s.point(0.0, 6.0), s.point(0.2, 0.5));
    let mut i = 0;
    let mut next = move || {
        let u = DVec3::new(
            (i % dims[0]) as f64,
            (i / dims[0] % dims[1]) as f64,
            (i / dims[0] / dims[1]) as f64,
        );
        i += 1;
        let a = phase + u * wave;
        100.0 + 55.0 * a.x.sin() + 30.0 * a.y.sin() * a.z.cos() + s.between(-8.0, 8.0)
    };
    let samples = match kind {
        0 => Samples::U8((0..n).map(|_| next() as u8).collect()),
        1 => Samples::I16((0..n).map(|_| next() as i16).collect()),
        2 => Samples::U16((0..n).map(|_| next() as u16).collect()),
        _ => Samples::F32((0..n).map(|_| next() as f32).collect()),
    };
    let grid = Grid::new(
        dims,
        DVec3::new(1.0, 0.5, 2.0),
        DVec3::new(-9.0, 3.0, 1.0),
        DMat3::from_rotation_z(0.3) * DMat3::from_rotation_x(0.2),
        samples,
    );
    Arc::new(Data::Grid(grid.expect("a good grid")))
}

/// Blocks, instruction sets, threads and block sizes change the time, never a bit of the frame.
#[test]
fn the_frame_does_not_depend_on_how_it_is_made() {
    let mut skipped = false;
    for (case, kind) in Kind::ALL.into_iter().enumerate() {
        let data = noise(case as u64 + 1, [23, 38, 17], case % 4);
        let view = View::fit(data.bounds(), 40.0, 37, 21);
        let mut surfaces = isovalues(&[150.5, 60.0, 20.5, 60.25]);
        surfaces[1].opacity = 0.5;
        surfaces[3].opacity = 0.0;
        for step in [0.25, 1.0, 8.0] {
            let k = knobs().with("reconstruction", kind).with("step", step);
            let base = Request {
                layers: 3,
                channels: Channels::all() - Channels::WORK,
                ..request(k.clone().with("skip", "off").with("simd", "scalar"))
            };
            let want = draw(&MARCH_CPU, &data, &surfaces, &view, &base);
            assert!(want.hits.iter().any(|h| *h > 3), "{kind}: the test sees several layers");
            for level in Level::ALL {
                for block in ["4", "8", "16"] {
                    let r = Request {
                        threads: if block == "8" { 2 } else { 1 },
                        knobs: k.clone().with("simd", level).with("block", block),
                        ..base.clone()
                    };
                    assert_eq!(
                        draw(&MARCH_CPU, &data, &surfaces, &view, &r),
                        want,
                        "{kind} step {step} {level} block {block}"
                    );
                }
            }
            let count = |skip: &str| {
                let r = Request {
                    knobs: k.clone().with("skip", skip),
                    ..base.clone()
                };
                let mut r = ready(&MARCH_CPU, &data, &surfaces, &view, &r);
                r.render(&Stop::default()).expect("everything is set");
                r.counters().0[0].1
            };
            let (on, off) = (count("on"), count("off"));
            assert!(on <= off, "{on} samples with blocks, {off} without");
            skipped |= on < off;
        }
    }
    assert!(skipped, "some block was stepped over");
}

/// The definition, read off the reference reconstruction: signs at t0 + k h, in order, each bracket bisected.
#[test]
fn hits_are_the_sign_changes_between_samples() {
    for kind in Kind::ALL {
        let data = noise(77, [19, 14, 21], 3);
        let Data::Grid(grid) = &*data else { panic!("a grid") };
        let spline = GridSpline::new(grid, kind, Stage::Stored).expect("a good grid");
        let view = View::fit(data.bounds(), 30.0, 41, 33);
        let (step, c) = (0.7, 100.25);
        let k = knobs().with("reconstruction", kind).with("step", step).with("bisections", 30);
        let r = Request { layers: 4, ..request(k) };
        let f = draw(&MARCH_CPU, &data, &isovalues(&[c]), &view, &r);
        let mut total = 0;
        for (i, (y, x)) in (0..33).flat_map(|y| (0..41).map(move |x| (y, x))).enumerate() {
            let ray = view.ray(x, y);
            let Some((t0, t1)) = spline.domain().clip(&ray) else {
                assert_eq!(f.hits[i], 0);
                continue;
            };
            let h = step / spline.domain().local_vector(ray.direction).length();
            let mut ts: Vec<f64> = (0..).map(|k| t0 + f64::from(k) * h).take_while(|t| *t < t1).collect();
            ts.push(t1);
            let inside: Vec<bool> = ts.iter().map(|t| spline.value(ray.at(*t)) >= c).collect();
            let changes: Vec<usize> = (1..ts.len()).filter(|k| inside[*k] != inside[k - 1]).collect();
            assert_eq!(usize::from(f.hits[i]), changes.len(), "{kind} pixel ({x}, {y})");
            for (layer, k) in changes.iter().take(4).enumerate() {
                let t = f.t[layer * 41 * 33 + i];
                assert!(ts[k - 1] <= t && t <= ts[*k], "{kind}: {t} in {}..{}", ts[k - 1], ts[*k]);
                let slope = spline.gradient(ray.at(t)).length();
                assert!((spline.value(ray.at(t)) - c).abs() <= 1e-7 * (1.0 + slope), "{kind} at {t}");
                total += 1;
            }
        }
        assert!(total > 100, "{kind}: {total} hits compared");
    }
}

/// Several isovalues in one step come in the order in which the ray meets them (hardcases E4).
#[test]
fn many_surfaces_in_one_step_are_in_order() {
    let data = sampled(9, |x| x.x);
    let values = [0.5, -0.25, 0.0, 0.25, -0.5];
    let k = knobs().with("step", 8).with("bisections", 40);
    let r = Request { layers: 5, ..request(k) };
    let back = Ray {
        origin: DVec3::new(6.0, 0.3, 0.2),
        direction: DVec3::NEG_X,
    };
    let forth = Ray {
        origin: DVec3::new(-6.0, 0.3, 0.2),
        direction: DVec3::X,
    };
    let f = draw(&MARCH_CPU, &data, &isovalues(&values), &View::rays(vec![forth, back]), &r);
    let column = |p: usize| -> Vec<u8> { (0..5).map(|l| f.surface[l * 2 + p]).collect() };
    assert_eq!((column(0), column(1)), (vec![4, 1, 2, 3, 0], vec![0, 3, 2, 1, 4]));
    assert_eq!(f.hits, [5, 5]);
    for (l, s) in column(0).iter().enumerate() {
        assert!((f.t[l * 2] - 6.0 - values[usize::from(*s)]).abs() < 1e-9);
    }
}

/// A surface between the last whole step and the face where the ray leaves.
#[test]
fn the_last_partial_step_counts() {
    let data = sampled(9, |x| x.x);
    let k = knobs().with("step", 3).with("bisections", 40);
    let f = draw(
        &MARCH_CPU,
        &data,
        &isovalues(&[3.9]),
        &View::rays(vec![along_x(0.1, 0.2)]),
        &request(k),
    );
    assert!((f.t[0] - 3.9).abs() < 1e-6, "{}", f.t[0]);
}

/// hardcases B17: index space is what counts, so extreme spacings change nothing but the scale.
#[test]
fn extreme_aspect_ratios_scale() {
    let frame = |spacing: DVec3| {
        let Data::Grid(g) = &*sampled(12, |x| x.length()) else {
            panic!("a grid")
        };
        let grid = Grid::new(g.dims, spacing, g.origin * spacing, g.direction, g.samples.clone()).expect("positive");
        let rays: Vec<Ray> = rays(5, 200, 5.5)
            .iter()
            .map(|r| Ray {
                origin: r.origin * spacing,
                direction: r.direction * spacing,
            })
            .collect();
        draw(
            &MARCH_CPU,
            &Arc::new(Data::Grid(grid)),
            &isovalues(&[4.0]),
            &View::rays(rays),
            &request(knobs()),
        )
    };
    let want = frame(DVec3::ONE);
    assert!(want.t.iter().filter(|t| t.is_finite()).count() > 50);
    for s in [DVec3::new(1.0, 1.0, 1e-6), DVec3::new(1.0, 1e6, 1.0)] {
        let got = frame(s);
        for (a, b) in got.t.iter().zip(&want.t) {
            assert!(a == b || (a - b).abs() < 1e-9, "{a} for {b} with {s}");
        }
    }
}

/// What fixed steps cannot see (hardcases C1 and E11): a pair of roots inside one step, and a tangent.
#[test]
fn an_even_number_of_roots_in_a_step_is_missed() {
    let data = sampled(9, |x| -x.x.abs());
    let at = |k: Knobs| {
        draw(
            &MARCH_CPU,
            &data,
            &isovalues(&[-0.2]),
            &View::rays(vec![Ray {
                origin: DVec3::new(-4.0, 0.3, 0.1),
                direction: DVec3::X,
            }]),
            &request(k),
        )
        .hits[0]
    };
    assert_eq!(at(knobs().with("step", 0.25)), 2);
    assert_eq!(
        at(knobs().with("step", 0.75)),
        0,
        "roots at -0.2 and 0.2, samples at -0.25 and 0.5"
    );
}

#[test]
fn an_isovalue_outside_the_range_gives_an_empty_frame_at_once() {
    let data = sampled(9, |x| x.x);
    let mut r = ready(
        &MARCH_CPU,
        &data,
        &isovalues(&[5.0, -4.5]),
        &View::bench(40, 30),
        &request(knobs()),
    );
    r.render(&Stop::default()).expect("a warning at most");
    let mut f = Frame::default();
    r.read(&mut f).expect("drawn");
    assert!(f.surface.iter().all(|s| *s == NO_SURFACE) && f.claim.iter().all(|c| c.is_empty()));
    assert_eq!(r.counters().0[0], ("samples", 0));
}

#[test]
fn calls_out_of_order_are_errors() {
    let data = sampled(5, |x| x.x);
    let mut r = MARCH_CPU.open(&request(knobs())).expect("a good request");
    let mut f = Frame::default();
    assert_eq!(r.read(&mut f), Err(RenderError::NotReady("render")));
    assert_eq!(r.render(&Stop::default()), Err(RenderError::NotReady("set_data")));
    assert!(r.reconstruction(Stage::Stored).is_none());
    r.set_surfaces(&isovalues(&[0.5])).expect("good");
    r.set_data(&data).expect("good");
    assert_eq!(r.render(&Stop::default()), Err(RenderError::NotReady("set_view")));
    r.set_view(&View::bench(4, 4)).expect("good");
    assert_eq!(r.read(&mut f), Err(RenderError::NotReady("render")));
    let stop = Stop::default();
    stop.raise();
    assert_eq!(r.render(&stop), Err(RenderError::Stopped));
    assert_eq!(r.read(&mut f), Err(RenderError::NotReady("render")));
    r.render(&Stop::default()).expect("everything is set");
    r.read(&mut f).expect("drawn");
}

#[test]
fn what_it_cannot_do_is_said() {
    let grid = sampled(5, |x| x.x);
    let view = View::bench(4, 4);
    let surfaces = isovalues(&[0.0]);
    let scene = Scene {
        data: &grid,
        surfaces: &surfaces,
        medium: None,
        view: &view,
    };
    let ok = request(knobs());
    assert_eq!(MARCH_CPU.supports(&scene, &ok), Ok(()));
    let medium = TransferFunction {
        points: vec![],
        unit: 1.0,
    };
    let mut clipped = view.clone();
    clipped.clips.push(ClipPlane {
        normal: DVec3::X,
        distance: 0.0,
        cap: true,
    });
    let boundary = [Surface {
        kind: SurfaceKind::Boundary,
        ..surfaces[0]
    }];
    let frustum = Request {
        sampling: Sampling::PixelFrustum,
        ..ok.clone()
    };
    let polynomial = Arc::new(Data::Algebraic(isobar_core::Algebraic {
        name: "x".into(),
        terms: vec![([1, 0, 0], 1.0)].into(),
        lo: DVec3::NEG_ONE,
        hi: DVec3::ONE,
    }));
    let all = [
        MARCH_CPU.supports(
            &Scene {
                data: &polynomial,
                ..scene
            },
            &ok,
        ),
        MARCH_CPU.supports(
            &Scene {
                medium: Some(&medium),
                ..scene
            },
            &ok,
        ),
        MARCH_CPU.supports(&Scene { view: &clipped, ..scene }, &ok),
        MARCH_CPU.supports(
            &Scene {
                surfaces: &boundary,
                ..scene
            },
            &ok,
        ),
        MARCH_CPU.supports(&scene, &frustum),
    ];
    for r in all {
        let e = r.expect_err("it cannot").to_string();
        assert!(e.starts_with("march/cpu ") && !e.contains('\n'), "{e}");
    }
    let mut r = MARCH_CPU.open(&ok).expect("good");
    assert!(r.set_data(&polynomial).is_err() && r.set_medium(Some(&medium)).is_err() && r.set_view(&clipped).is_err());
    assert!(r.set_medium(None).is_ok());
    assert!(MARCH_CPU.open(&frustum).is_err());
    assert!(matches!(r.set_view(&View::bench(0, 4)), Err(RenderError::View(_))));
    for (k, v) in [
        ("step", "0.01"),
        ("bisections", "61"),
        ("reconstruction", "type6"),
        ("claims", "cpu"),
        ("block", "5"),
    ] {
        assert!(
            matches!(r.set_knobs(&knobs().with(k, v)), Err(RenderError::Knob { .. })),
            "{k}={v}"
        );
    }
    // Common to all methods, and nothing to it here.
    assert!(r.set_knobs(&knobs().with("claims", "off")).is_ok());
}

#[test]
fn unusable_samples_are_refused_and_the_former_data_kept() {
    let good = sampled(5, |x| x.x);
    let mut r = ready(&MARCH_CPU, &good, &isovalues(&[0.1]), &View::bench(8, 8), &request(knobs()));
    let nan = sampled(5, |x| if x.x == 2.0 { f64::NAN } else { 0.0 });
    assert!(matches!(
        r.set_data(&nan),
        Err(RenderError::Data(DataError::NotFinite { count: 25, total: 125 }))
    ));
    let thin = Grid::unit([4, 4, 1], Samples::U8(vec![0; 16].into())).expect("a grid");
    assert!(matches!(
        r.set_data(&Arc::new(Data::Grid(thin))),
        Err(RenderError::Data(DataError::TooThin { .. }))
    ));
    r.render(&Stop::default()).expect("the former data");
    assert_eq!(r.reconstruction(Stage::Stored).map(|f| f.name()), Some("trilinear".into()));
}

#[test]
fn new_settings_rebuild_only_what_they_must() {
    let data = sampled(33, |x| x.length());
    let mut r = ready(&MARCH_CPU, &data, &isovalues(&[10.0]), &View::bench(8, 8), &request(knobs()));
    let m = r.memory();
    assert_eq!(m.coefficients, 0, "trilinear draws from the shared samples");
    assert!(m.index * 25 < data.bytes() as u64);
    let before = Arc::strong_count(&data);
    r.set_knobs(&knobs().with("step", 0.125)).expect("in range");
    assert_eq!((r.memory(), Arc::strong_count(&data)), (m, before));
    r.set_knobs(&knobs().with("reconstruction", "cubic-interpolating"))
        .expect("a kind");
    assert_eq!(r.memory().coefficients, 33 * 33 * 33 * 4);
    let name = |s: Stage| r.reconstruction(s).map(|f| f.name());
    assert_eq!(name(Stage::Stored), Some("cubic-interpolating".into()));
    assert_eq!(name(Stage::Ideal), Some("cubic-interpolating".into()));
}

#[test]
fn every_camera_and_size_is_drawn() {
    let data = sampled(17, |x| x.length());
    let inside = View::perspective(DVec3::new(0.5, 0.1, 0.2), DVec3::Y, DVec3::Z, 90.0, 33, 18);
    let ortho = View {
        camera: Camera::Orthographic {
            eye: DVec3::new(0.0, -20.0, 0.0),
            target: DVec3::ZERO,
            up: DVec3::Z,
            height: 4.0,
        },
        width: 1,
        height: 1,
        clips: vec![],
    };
    for view in [inside, ortho] {
        let f = draw(&MARCH_CPU, &data, &isovalues(&[5.0]), &view, &request(knobs()));
        for (i, t) in f.t.iter().enumerate() {
            let (x, y) = (i % view.width, i / view.width);
            let r = view.ray(x, y).at(*t).length();
            assert!((r - 5.0).abs() < 0.1, "({x}, {y}): {r}");
            assert_eq!((f.hits[i], f.rgba[i][3]), (2 - u16::from(view.width > 1), 1.0));
        }
    }
}
