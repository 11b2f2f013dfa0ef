//! What the renderer of the paper is used for: closed cuts, time steps, smoothing, painted surfaces, stored determining sets, meshes; and hostile data.

use crate::TETSPLINE_CPU;
use isobar_core::{
    Channels, Claim, ClipPlane, DVec3, Data, Frame, Function, Grid, Hit, Knobs, Method, NO_SURFACE, Pixel, Renderer, Request,
    Samples, Scene, Stage, Stop, Surface, View,
};
use isobar_fields::{Synthetic, Type6Spline};
use isobar_oracle::{Truth, check};
use std::sync::Arc;

fn synthetic(spec: &str) -> Arc<Data> {
    Arc::new(spec.parse::<Synthetic>().unwrap().data().unwrap())
}

fn open(channels: Channels, layers: usize, knobs: Knobs) -> Box<dyn Renderer> {
    let request = Request {
        channels,
        layers,
        knobs,
        ..Request::default()
    };
    TETSPLINE_CPU.open(&request).unwrap()
}

fn rendered(r: &mut dyn Renderer) -> Frame {
    r.render(&Stop::default()).unwrap();
    let mut f = Frame::default();
    r.read(&mut f).unwrap();
    f
}

fn draw(data: &Arc<Data>, surfaces: &[Surface], view: &View, layers: usize, knobs: Knobs) -> (Frame, Arc<dyn Function>) {
    let mut r = open(Channels::all(), layers, knobs);
    r.set_data(data).unwrap();
    r.set_surfaces(surfaces).unwrap();
    r.set_view(view).unwrap();
    (rendered(&mut *r), r.reconstruction(Stage::Stored).unwrap())
}

/// Where a ray is inside an axis-aligned box.
fn inside(ray: &isobar_core::Ray, (lo, hi): (DVec3, DVec3)) -> (f64, f64) {
    let (a, b) = ((lo - ray.origin) / ray.direction, (hi - ray.origin) / ray.direction);
    (a.min(b).max_element().max(0.0), a.max(b).min_element())
}

/// A cap is met where the cut begins or ends inside the solid, everything else is as with open cuts, which the oracle certifies.
#[test]
fn closed_cuts_show_the_solid() {
    let data = synthetic("gyroid,n=32");
    let mut view = View::bench(120, 90);
    let plane = |normal: DVec3, distance, cap| ClipPlane { normal, distance, cap };
    view.clips = vec![
        plane(DVec3::new(1.0, 0.2, 0.1), 0.3, true),
        plane(DVec3::new(0.0, 0.0, -2.0), 0.9, true),
        plane(DVec3::Y, 0.55, false),
    ];
    let mut open_view = view.clone();
    open_view.clips.iter_mut().for_each(|c| c.cap = false);
    for surfaces in [
        vec![Surface::isovalue(0.2, 0)],
        vec![Surface::isovalue(0.7, 0), Surface::isovalue(-0.1, 1)],
    ] {
        let scene = Scene {
            data: &data,
            surfaces: &surfaces,
            medium: None,
            view: &view,
        };
        TETSPLINE_CPU.supports(&scene, &Request::default()).unwrap();
        let (cut, f) = draw(&data, &surfaces, &open_view, 1, Knobs::default());
        let truth = Truth::compute(&f, &surfaces, &open_view, &Stop::default()).unwrap();
        let c = check(&cut, &truth, &f, &surfaces, &open_view).unwrap();
        assert!(c.is_clean(), "open cuts");
        let (capped, _) = draw(&data, &surfaces, &view, 1, Knobs::default());
        let (mut entered, mut left) = (0, 0);
        for i in 0..120 * 90 {
            let ray = view.ray(i % 120, i / 120);
            let (a, b) = inside(&ray, data.bounds());
            let Some((first, last)) = view.kept(&ray) else {
                assert_eq!(capped.surface[i], NO_SURFACE);
                continue;
            };
            // The plane that the ray passes at t, if that is capped; the solid there.
            let cap = |t: f64| {
                let p = ray.at(t);
                view.clips
                    .iter()
                    .find(|c| (c.normal.dot(p) - c.distance).abs() < 1e-9 && c.cap)
            };
            let solid = |t: f64| {
                let s = f.value(ray.at(t));
                let near = surfaces.iter().any(|c| (s - c.value().unwrap()).abs() < 1e-9);
                assert!(!near, "a cap on the surface itself: choose another view");
                let below = |x: &&Surface| x.value().unwrap() < s;
                let top = surfaces
                    .iter()
                    .filter(below)
                    .max_by(|x, y| x.value().unwrap().total_cmp(&y.value().unwrap()))?;
                surfaces.iter().position(|x| x == top)
            };
            let at = |t: f64, from: f64, to: f64| (from < t && t < to).then_some(t).and_then(|t| Some((t, cap(t)?, solid(t)?)));
            let (t, want) = match at(first, a, b.min(last)) {
                Some((t, plane, surface)) => {
                    entered += 1;
                    (t, Some((plane, surface)))
                }
                None if cut.t[i].is_finite() => (cut.t[i], None),
                None => match at(last, a.max(first), b) {
                    Some((t, plane, surface)) => {
                        left += 1;
                        (t, Some((plane, surface)))
                    }
                    None => (f64::INFINITY, None),
                },
            };
            assert!(
                capped.t[i] == t || (capped.t[i] - t).abs() < 1e-12,
                "pixel {i}: {} instead of {t}",
                capped.t[i]
            );
            if let Some((plane, surface)) = want {
                let n = DVec3::from_array(capped.normal[i].map(f64::from));
                assert!(
                    (n + plane.normal.normalize()).length() < 1e-6 && usize::from(capped.surface[i]) == surface,
                    "pixel {i}"
                );
                assert!(capped.claim[i].is_empty() && capped.t_error[i].is_infinite() && capped.rgba[i][3] == 1.0);
            } else {
                assert_eq!(capped.surface[i], cut.surface[i]);
            }
        }
        assert!(entered > 300 && left > 10, "{entered} caps entered, {left} left by");
    }
}

/// With all layers a closed solid is entered and left by turns: an even number of hits, wherever both its ends are inside the domain.
#[test]
fn closed_solids_have_two_sides() {
    let data = synthetic("sphere,n=24");
    let mut view = View::bench(80, 60);
    // The solid of values above 1 is outside the sphere: of minus the field it is the ball, so the planes keep the values' high side.
    let Data::Grid(g) = &*data else { panic!("a grid") };
    let Samples::F32(s) = &g.samples else { panic!("f32") };
    let samples = Samples::F32(s.iter().map(|v| -v).collect::<Vec<f32>>().into());
    let data = Arc::new(Data::Grid(Grid { samples, ..g.clone() }));
    view.clips = [(DVec3::X, 0.4), (DVec3::new(-0.3, 1.0, 0.0), 0.2), (DVec3::NEG_Z, 0.5)]
        .map(|(normal, distance)| ClipPlane {
            normal,
            distance,
            cap: true,
        })
        .to_vec();
    let (f, _) = draw(&data, &[Surface::isovalue(-1.0, 0)], &view, 4, Knobs::default());
    let hits: Vec<u16> = f.hits.iter().copied().filter(|h| *h > 0).collect();
    assert!(hits.len() > 500 && hits.iter().all(|h| *h == 2), "the ball is convex");
}

/// Stored determining sets draw the same picture, to rounding, and claim nothing.
#[test]
fn stored_determining_sets_draw_the_same() {
    let data = synthetic("gyroid,n=32");
    let (surfaces, view) = ([Surface::isovalue(0.2, 0)], View::bench(96, 72));
    let (fly, f) = draw(&data, &surfaces, &view, 1, Knobs::default());
    let (stored, _) = draw(
        &data,
        &surfaces,
        &view,
        1,
        Knobs::default().with("coefficients", "determining-set"),
    );
    let apart = fly
        .t
        .iter()
        .zip(&stored.t)
        .filter(|(a, b)| a != b && (**a - **b).abs() > 1e-10)
        .count();
    assert_eq!(apart, 0);
    assert!(stored.claim.iter().all(|c| c.is_empty()));
    let truth = Truth::compute(&f, &surfaces, &view, &Stop::default()).unwrap();
    let c = check(&stored, &truth, &f, &surfaces, &view).unwrap();
    assert!(c.hits > 3000 && (c.missed, c.false_hits, c.wrong_root, c.refuted) == (0, 0, 0, 0));
}

/// A time step, and one of another size, draw what a fresh renderer draws; a step that is refused leaves the one before.
#[test]
fn time_steps_are_fresh() {
    let surfaces = [Surface::isovalue(0.3, 0)];
    let view = View::bench(64, 48);
    let mut r = open(Channels::all(), 1, Knobs::default());
    r.set_surfaces(&surfaces).unwrap();
    r.set_view(&view).unwrap();
    let steps = [
        "gyroid,n=30",
        "marschner-lobb,n=30",
        "sphere,n=30",
        "gyroid,n=21",
        "gyroid,n=30",
    ];
    let mut memory = Vec::new();
    for spec in steps {
        let data = synthetic(spec);
        r.set_data(&data).unwrap();
        let (want, _) = draw(&data, &surfaces, &view, 1, Knobs::default());
        assert!(rendered(&mut *r) == want, "{spec}");
        memory.push(r.memory().index);
    }
    let data = synthetic("gyroid,n=30");
    let before = rendered(&mut *r);
    let Data::Grid(g) = &*data else { panic!("a grid") };
    let mut samples = vec![0.5f32; 27000];
    samples[777] = f32::NAN;
    for bad in [
        Grid {
            samples: Samples::F32(samples.into()),
            ..g.clone()
        },
        Grid::unit([30, 1, 2], Samples::U8(vec![0; 60].into())).unwrap(),
    ] {
        let e = r.set_data(&Arc::new(Data::Grid(bad))).unwrap_err().to_string();
        assert!(!e.contains('\n') && !e.is_empty(), "{e}");
    }
    assert!(rendered(&mut *r) == before && memory.iter().all(|m| *m > 0));
}

/// Two samples along an axis are enough; isovalues equal to samples, coefficients (multiples of 1/192) and plateaus are exact.
#[test]
fn isovalues_on_data_and_on_coefficients() {
    let mut s = 5u64;
    for dims in [[2, 2, 7], [2, 9, 3], [8, 6, 7]] {
        let samples: Vec<u8> = (0..dims.iter().product())
            .map(|_| {
                s = s
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1_442_695_040_888_963_407);
                (s >> 62) as u8
            })
            .collect();
        let grid = Grid::unit(dims, Samples::U8(samples.into())).unwrap();
        let spline = Type6Spline::new(&grid).unwrap();
        let coefficient = spline.value(DVec3::new(0.5, 0.5, 0.5));
        let data = Arc::new(Data::Grid(grid));
        let view = View::fit(data.bounds(), 40.0, 48, 36);
        for c in [1.0, 2.0, coefficient, 265.0 / 192.0] {
            let surfaces = [Surface::isovalue(c, 0)];
            let (frame, f) = draw(&data, &surfaces, &view, 1, Knobs::default());
            let truth = Truth::compute(&f, &surfaces, &view, &Stop::default()).unwrap();
            let result = check(&frame, &truth, &f, &surfaces, &view).unwrap();
            assert!(result.is_clean(), "{dims:?} at {c}");
        }
    }
}

/// Smoothing is a change of the data: the function is the spline of the smoothed samples, and the oracle agrees.
#[test]
fn smoothed_data_are_drawn_exactly() {
    let data = synthetic("marschner-lobb,n=40");
    let (surfaces, view) = ([Surface::isovalue(0.5, 0)], View::bench(80, 60));
    let knobs = Knobs::default().with("smooth", 0.8);
    let (frame, f) = draw(&data, &surfaces, &view, 1, knobs.clone());
    let truth = Truth::compute(&f, &surfaces, &view, &Stop::default()).unwrap();
    let c = check(&frame, &truth, &f, &surfaces, &view).unwrap();
    assert!(c.is_clean() && c.hits > 800);
    let (plain, g) = draw(&data, &surfaces, &view, 1, Knobs::default());
    assert!(plain.t != frame.t && f.value(DVec3::ZERO) != g.value(DVec3::ZERO));
    // Changed by a knob, and back.
    let mut r = open(Channels::all(), 1, knobs);
    r.set_data(&data).unwrap();
    r.set_surfaces(&surfaces).unwrap();
    r.set_view(&view).unwrap();
    assert_eq!(r.memory().coefficients, 4 * 40 * 40 * 40);
    assert!(rendered(&mut *r) == frame);
    r.set_knobs(&Knobs::default()).unwrap();
    assert!(rendered(&mut *r) == plain);
}

/// Texture and curves change colours and nothing else; the curves lie on faces of cubes.
#[test]
fn painted_surfaces_are_the_same_surfaces() {
    let data = synthetic("sphere,n=16");
    let (surfaces, view) = ([Surface::isovalue(1.0, 0)], View::bench(160, 120));
    let (plain, _) = draw(&data, &surfaces, &view, 1, Knobs::default());
    let (marble, _) = draw(&data, &surfaces, &view, 1, Knobs::default().with("texture", "marble"));
    let (curves, _) = draw(&data, &surfaces, &view, 1, Knobs::default().with("overlay", "curves"));
    let step = 2.5 / 15.0;
    let (mut black, mut far, mut near) = (0, 0, 0);
    for i in 0..plain.t.len() {
        assert!((plain.t[i] == marble.t[i] || (plain.t[i] - marble.t[i]).abs() < 1e-10) && plain.surface[i] == curves.surface[i]);
        if !plain.t[i].is_finite() {
            assert_eq!((marble.rgba[i], curves.rgba[i]), ([0.0; 4], [0.0; 4]));
            continue;
        }
        let p = (curves.point[i] + 1.25) / step - 0.5;
        let away = (p - p.round()).abs().min_element();
        if curves.rgba[i] == [0.0, 0.0, 0.0, 1.0] {
            black += 1;
            near += usize::from(away < 4.0 * view.footprint(curves.t[i]) / step);
        } else {
            far += usize::from(away > 1.1 * view.footprint(curves.t[i]) / step);
        }
        assert!(marble.rgba[i][0] <= plain.rgba[i][0] * 1.001 && marble.rgba[i][3] == 1.0);
    }
    assert!(
        black > 500 && near == black && far > 1000,
        "{black} black, {near} near faces, {far} others"
    );
    let values: Vec<f32> = marble
        .rgba
        .iter()
        .zip(&plain.rgba)
        .filter(|(_, p)| p[3] > 0.0)
        .map(|(m, p)| m[0] / p[0])
        .collect();
    let of = |f: fn(f32, f32) -> f32, start: f32| values.iter().copied().fold(start, f);
    assert!(of(f32::max, 0.0) > 0.9 && of(f32::min, 1.0) < 0.4, "veins");
}

/// K18: a frame joins with another renderer's by t. The other one is a plane through the ball here.
#[test]
fn frames_compose_by_depth() {
    let data = synthetic("sphere,n=32");
    let view = View::bench(64, 48);
    let surfaces = [Surface::isovalue(1.0, 0)];
    let (ball, f) = draw(&data, &surfaces, &view, 1, Knobs::default());
    let mut plane = Frame::new(64, 48, 1, Channels::all());
    for i in 0..64 * 48 {
        let ray = view.ray(i % 64, i / 64);
        let t = (0.3 - ray.origin.z) / ray.direction.z;
        if t > 0.0 {
            let hit = Hit {
                t,
                point: ray.at(t),
                normal: [0.0, 0.0, 1.0],
                surface: 1,
                t_error: f64::INFINITY,
            };
            plane.set_hit(0, i, &hit);
            plane.set_pixel(
                i,
                &Pixel {
                    hits: 1,
                    claim: Claim::empty(),
                    rgba: [0.5, 0.5, 0.5, 1.0],
                    work: 0,
                },
            );
        }
    }
    let mut both = ball.clone();
    both.compose(&plane);
    let (mut above, mut below) = (0, 0);
    for i in 0..64 * 48 {
        assert_eq!(both.t[i], ball.t[i].min(plane.t[i]));
        if both.surface[i] == 0 {
            assert!(both.point[i].z > 0.3 - 1e-9 && (f.value(both.point[i]) - 1.0).abs() < 1e-9);
            above += 1;
        }
        below += usize::from(both.surface[i] == 1 && ball.t[i].is_finite());
    }
    assert!(above > 100 && below > 100, "{above} {below}");
}
