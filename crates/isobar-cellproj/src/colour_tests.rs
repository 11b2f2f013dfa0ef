//! Colours of media and surfaces against the oracle's integral.

use crate::CELLPROJ_CPU;
use crate::tests::{fire, orthographic, synthetic};
use isobar_core::{
    Camera, Channels, ClipPlane, Counters, DVec3, Data, Frame, Function, Knobs, Method, Ray, Request, Stage, Stop, Surface,
    TetMesh, TransferFunction, View,
};
use isobar_oracle::{Colours, Difference, Integral, Model, Reference};
use std::sync::Arc;

/// A scene with a medium.
pub(crate) struct Scene {
    pub(crate) data: Arc<Data>,
    pub(crate) surfaces: Vec<Surface>,
    pub(crate) transfer: TransferFunction,
    pub(crate) view: View,
}

fn frame(scene: &Scene, knobs: Knobs) -> (Frame, Counters, Arc<dyn Function>) {
    frame_of(&CELLPROJ_CPU, scene, knobs)
}

pub(crate) fn frame_of(method: &dyn Method, scene: &Scene, knobs: Knobs) -> (Frame, Counters, Arc<dyn Function>) {
    let request = Request {
        knobs,
        ..Request::default()
    };
    let mut r = method.open(&request).unwrap();
    r.set_data(&scene.data).unwrap();
    r.set_surfaces(&scene.surfaces).unwrap();
    r.set_medium(Some(&scene.transfer)).unwrap();
    r.set_view(&scene.view).unwrap();
    r.render(&Stop::default()).unwrap();
    let mut frame = Frame::default();
    r.read(&mut frame).unwrap();
    (frame, r.counters(), r.reconstruction(Stage::Stored).unwrap())
}

pub(crate) fn count(c: &Counters, name: &str) -> u64 {
    c.0.iter().find(|c| c.0 == name).unwrap().1
}

pub(crate) fn truth(scene: &Scene, function: &Arc<dyn Function>, model: Model) -> Colours {
    let integral = Integral::new(
        function,
        &scene.surfaces,
        Some(&scene.transfer),
        Reference::Integral,
        model,
        &scene.view.clips,
    )
    .unwrap();
    let c = Colours::of(&integral, &scene.view, &Stop::default()).unwrap();
    assert!(c.greatest_error() < 1e-7, "{}", c.greatest_error());
    c
}

/// Slopes of at most 8 over the range, optical depths near 1.
pub(crate) fn smooth((lo, hi): (f64, f64), depth: f64) -> TransferFunction {
    let at = |x: f64| lo + x * (hi - lo);
    let d = depth as f32;
    TransferFunction {
        points: vec![
            (at(0.0), [0.1, 0.2, 1.0], 0.0),
            (at(0.25), [0.1, 0.8, 0.6], 0.6 * d),
            (at(0.5), [1.0, 1.0, 0.2], 0.0),
            (at(0.6), [1.0, 0.6, 0.1], 0.1 * d),
            (at(0.8), [1.0, 0.1, 0.1], d),
            (at(1.0), [1.0, 1.0, 1.0], 0.2 * d),
        ],
        unit: 1.0,
    }
}

pub(crate) fn glass(values: &[(f64, f32)]) -> Vec<Surface> {
    let surface = |(i, &(c, opacity)): (usize, &(f64, f32))| Surface {
        opacity,
        ..Surface::isovalue(c, i)
    };
    values.iter().enumerate().map(surface).collect()
}

pub(crate) fn views() -> Vec<(&'static str, View)> {
    vec![
        ("perspective", View::bench(61, 43)),
        (
            "orthographic",
            orthographic(DVec3::new(2.6, 1.9, 2.2), DVec3::ZERO, 2.9, (61, 43)),
        ),
        (
            "inside",
            View::perspective(
                DVec3::new(0.31, -0.2, 0.05),
                DVec3::new(1.0, 0.3, 0.1),
                DVec3::Z,
                100.0,
                61,
                43,
            ),
        ),
        (
            "orthographic inside",
            orthographic(DVec3::new(0.1, 0.05, 0.2), DVec3::new(0.9, 0.4, 0.3), 1.6, (61, 43)),
        ),
    ]
}

fn exact() -> Knobs {
    Knobs::default().with("integration", "exact")
}

/// Volume alone, with glass and opaque surfaces in it, both models, all views: the integral to f32.
#[test]
fn the_exact_mode_is_the_integral() {
    let data = synthetic("marschner-lobb,n=14,as=tets");
    for (name, view) in views() {
        for surfaces in [vec![], glass(&[(0.5, 0.4), (0.3, 0.3)]), glass(&[(0.5, 1.0)])] {
            for (model, word) in [
                (Model::VolumeDensity, "williams-max"),
                (Model::DensityEmitter, "wilhelms-van-gelder"),
            ] {
                let scene = Scene {
                    data: data.clone(),
                    surfaces: surfaces.clone(),
                    transfer: smooth((0.0, 1.0), 2.0),
                    view: view.clone(),
                };
                let (f, counters, function) = frame(&scene, exact().with("model", word));
                let d = truth(&scene, &function, model).difference(&f).unwrap();
                // f32 sums of some 60 fragments, and the cut at 1.5e-6 of the light left; normals of hits on faces may be those of either side.
                let most = if surfaces.is_empty() { 2e-5 } else { 0.02 };
                assert!(
                    d.p99 < 2e-5 && d.max < most,
                    "{name}, {} surfaces, {word}: {d:?}",
                    surfaces.len()
                );
                assert_eq!(count(&counters, "fragments out of order"), 0, "{name}");
                assert_eq!((count(&counters, "convex"), count(&counters, "cycles")), (1, 0));
            }
        }
    }
}

/// The aims: 64^3 within 2/255 at the 99th percentile for slopes of at most 8 over the range; perspective at most 1/255 worse than orthographic.
#[test]
fn tables_are_close_to_the_integral() {
    let data = synthetic("marschner-lobb,n=14,as=tets");
    let mut apart = Vec::new();
    for (name, view) in views().into_iter().take(2) {
        let scene = Scene {
            data: data.clone(),
            surfaces: glass(&[(0.5, 0.4)]),
            transfer: smooth((0.0, 1.0), 2.0),
            view,
        };
        let of = |knobs: Knobs| -> Difference {
            let (f, _, function) = frame(&scene, knobs);
            truth(&scene, &function, Model::VolumeDensity).difference(&f).unwrap()
        };
        let three = of(Knobs::default());
        let two = of(Knobs::default().with("integration", "table2d"));
        assert!(three.p99 < 2.0 / 255.0, "{name}: {three:?}");
        assert!(two.p99 < 0.1 && two.p99 > three.p99, "{name}: {two:?}");
        let coarse = of(Knobs::default().with("table", 8));
        assert!(coarse.p99 > three.p99);
        apart.push(three.p99);
    }
    assert!(apart[0] < apart[1] + 1.0 / 255.0);
}

/// Meshes whose rays leave and enter again: the relations across gaps order them, centroids do not.
#[test]
fn meshes_with_gaps_are_ordered() {
    let Data::Tets(base) = &*synthetic("marschner-lobb,n=11,as=tets") else {
        panic!("a mesh")
    };
    let keep = |c: &&[u32; 4]| {
        let m = c.iter().map(|&i| base.points[i as usize]).sum::<DVec3>() * 0.25;
        // A comb, a cavity and a part of its own.
        !((m.x * 2.5).fract().abs() < 0.5 && m.z > 0.0)
            && (m - DVec3::new(0.0, 0.0, -0.5)).length() > 0.3
            && (m.y - 0.5).abs() > 0.1
    };
    let cells: Vec<[u32; 4]> = base.cells.iter().filter(keep).copied().collect();
    // Sheared, so that the nearer centroid is not always that of the cell in front.
    let points: Vec<DVec3> = base
        .points
        .iter()
        .map(|p| DVec3::new(p.x, p.y + 0.8 * p.x, p.z * 0.3 - 0.5 * p.y))
        .collect();
    let data = Arc::new(Data::Tets(
        TetMesh::new(points.into(), cells.into(), base.values.clone()).unwrap(),
    ));
    let mut wrong = 0;
    for (name, view) in views() {
        let scene = Scene {
            data: data.clone(),
            surfaces: glass(&[(0.5, 0.4)]),
            transfer: smooth((0.0, 1.0), 4.0),
            view,
        };
        let (f, counters, function) = frame(&scene, exact());
        let t = truth(&scene, &function, Model::VolumeDensity);
        let d = t.difference(&f).unwrap();
        assert!(d.p99 < 2e-5 && d.max < 0.02, "{name}: {d:?}");
        assert_eq!(
            (count(&counters, "fragments out of order"), count(&counters, "convex")),
            (0, 0),
            "{name}"
        );
        assert!(count(&counters, "relations across gaps") > 100 && count(&counters, "parts") > 1);
        let (f, counters, _) = frame(&scene, exact().with("sort", "centroids"));
        wrong += count(&counters, "pixels out of order");
        assert!(t.difference(&f).unwrap().max < 1.5);
    }
    assert!(wrong > 100, "{wrong}");
}

#[test]
fn a_real_mesh_is_ordered() {
    let data = fire();
    let Data::Tets(mesh) = &*data else { panic!("a mesh") };
    let (lo, hi) = mesh
        .values
        .iter()
        .fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), &v| (a.min(v), b.max(v)));
    let view = View::fit(data.bounds(), 40.0, 64, 48);
    let extent = (data.bounds().1 - data.bounds().0).max_element();
    let scene = Scene {
        transfer: TransferFunction {
            unit: extent * 0.2,
            ..smooth((f64::from(lo), f64::from(hi)), 1.0)
        },
        surfaces: vec![],
        view,
        data,
    };
    let (f, counters, function) = frame(&scene, exact());
    let d = truth(&scene, &function, Model::VolumeDensity).difference(&f).unwrap();
    assert!(d.max < 5e-5, "{d:?}");
    assert_eq!(count(&counters, "fragments out of order"), 0);
}

/// Three slabs that hide each other in turn: no order exists, each pixel has its own.
pub(crate) fn cycle() -> Scene {
    let mut points = Vec::new();
    let mut cells: Vec<[u32; 4]> = Vec::new();
    for k in 0..3 {
        // A long tetrahedron along one side of a triangle, one end near and the other far.
        let angle = f64::from(k) * std::f64::consts::TAU / 3.0;
        let turn = |x: f64, y: f64, z: f64| DVec3::new(x * angle.cos() - y * angle.sin(), x * angle.sin() + y * angle.cos(), z);
        let first = points.len() as u32;
        points.extend([
            turn(-1.5, 0.3, -0.6),
            turn(1.5, 0.3, 0.6),
            turn(-1.5, 0.7, -0.6),
            turn(1.5, 0.5, 0.7),
        ]);
        cells.push([first, first + 1, first + 2, first + 3]);
    }
    let values: Vec<f32> = (0..12).map(|i| (i / 4) as f32 * 0.4 + 0.1).collect();
    let mesh = TetMesh::new(points.into(), cells.into(), values.into()).unwrap();
    Scene {
        data: Arc::new(Data::Tets(mesh)),
        surfaces: vec![],
        transfer: smooth((0.0, 1.0), 60.0),
        view: orthographic(DVec3::new(0.0, -0.001, 5.0), DVec3::ZERO, 3.0, (97, 97)),
    }
}

#[test]
fn a_cycle_is_found_and_resolved() {
    let scene = cycle();
    let (f, counters, function) = frame(&scene, exact());
    assert_eq!(
        (
            count(&counters, "cycles"),
            count(&counters, "cells in cycles"),
            count(&counters, "fragments out of order")
        ),
        (1, 3, 0)
    );
    assert!(count(&counters, "fragments sorted per pixel") > 300);
    let t = truth(&scene, &function, Model::VolumeDensity);
    let d = t.difference(&f).unwrap();
    assert!(d.max < 2e-5, "{d:?}");
    let (g, counters, _) = frame(&scene, exact().with("sort", "centroids"));
    let (pixels, d) = (count(&counters, "pixels out of order"), t.difference(&g).unwrap());
    assert!(pixels > 10 && d.max > 0.01, "{pixels} {d:?}");
}

/// Two planes through the mesh, one along some rays' plane, in every view: the medium ends at them, hits beyond are gone.
#[test]
fn the_medium_is_cut_at_planes() {
    let data = synthetic("marschner-lobb,n=14,as=tets");
    for (name, mut view) in views() {
        for (normal, distance) in [(DVec3::new(2.0, 0.5, 0.1), 0.7), (DVec3::new(0.0, -0.3, -1.0), 0.4)] {
            let cap = false;
            view.clips.push(ClipPlane { normal, distance, cap });
        }
        let scene = Scene {
            data: data.clone(),
            surfaces: glass(&[(0.5, 0.4)]),
            transfer: smooth((0.0, 1.0), 2.0),
            view,
        };
        let (f, _, function) = frame(&scene, exact());
        let d = truth(&scene, &function, Model::VolumeDensity).difference(&f).unwrap();
        assert!(d.p99 < 2e-5 && d.max < 0.02, "{name}: {d:?}");
        let whole = View {
            clips: vec![],
            ..scene.view.clone()
        };
        let (g, _, _) = frame(&Scene { view: whole, ..scene }, exact());
        assert!(f.rgba != g.rgba, "{name}: the planes cut something");
    }
}

/// The tables in f32 (`stays.rs`) and in f64 (`volume.rs`), which a plane that cuts nothing asks for: media alone, under glass and around opaque surfaces, in a cycle, in a mesh with gaps, and a million
/// sizes away.
#[test]
fn f32_gives_the_colours_of_f64() {
    let data = synthetic("marschner-lobb,n=14,as=tets");
    let Data::Tets(mesh) = &*data else { panic!("a mesh") };
    let away = DVec3::new(1e6, -2e6, 5e5);
    let points: Vec<DVec3> = mesh.points.iter().map(|p| *p + away).collect();
    let far = Arc::new(Data::Tets(
        TetMesh::new(points.into(), mesh.cells.clone(), mesh.values.clone()).unwrap(),
    ));
    let mut scenes: Vec<(String, Scene)> = vec![("a cycle".into(), cycle())];
    for (name, view) in views() {
        for surfaces in [vec![], glass(&[(0.5, 0.4), (0.3, 0.3)]), glass(&[(0.5, 1.0)])] {
            let scene = |data: &Arc<Data>, view: View| Scene {
                data: data.clone(),
                surfaces: surfaces.clone(),
                transfer: smooth((0.0, 1.0), 2.0),
                view,
            };
            scenes.push((format!("{name}, {} surfaces", surfaces.len()), scene(&data, view.clone())));
            if let Camera::Orthographic { eye, target, up, height } = view.camera {
                let (eye, target) = (eye + away, target + away);
                let camera = Camera::Orthographic { eye, target, up, height };
                scenes.push((format!("{name}, away"), scene(&far, View { camera, ..view.clone() })));
            }
        }
    }
    // Seen from a million sizes away.
    let from_afar = View::perspective(DVec3::new(2e6, 1.5e6, 1.7e6), DVec3::ZERO, DVec3::Z, 5e-5, 61, 43);
    scenes.push((
        "from afar".into(),
        Scene {
            data: data.clone(),
            surfaces: vec![],
            transfer: smooth((0.0, 1.0), 2.0),
            view: from_afar,
        },
    ));
    for (name, mut scene) in scenes {
        for integration in ["table2d", "table3d"] {
            let knobs = Knobs::default().with("integration", integration);
            let fast = frame(&scene, knobs.clone());
            scene.view.clips = vec![ClipPlane {
                normal: DVec3::X,
                distance: 1e9,
                cap: false,
            }];
            let slow = frame(&scene, knobs);
            scene.view.clips.clear();
            assert_eq!(fast.0.t, slow.0.t);
            let apart = |i: usize| {
                (0..4)
                    .map(|k| (fast.0.rgba[i][k] - slow.0.rgba[i][k]).abs())
                    .fold(0.0, f32::max)
            };
            let mut all: Vec<f32> = (0..fast.0.rgba.len()).map(apart).collect();
            all.sort_by(f32::total_cmp);
            let (most, p99) = (all[all.len() - 1], all[all.len() * 99 / 100]);
            let (a, b) = (count(&fast.1, "fragments"), count(&slow.1, "fragments"));
            println!("{name}, {integration}: {p99:e}, {most:e}; {a} and {b} stays");
            assert!(p99 < 1e-4 && most < 2e-3, "{name}, {integration}: {p99} {most}");
            assert!(fast.0.rgba.iter().any(|c| c[3] > 0.1), "{name}");
            assert!(a.abs_diff(b) * 1000 <= b, "{name}: {a} {b}");
        }
    }
}

/// The paper's appendix: a transfer function that is 0 but for a steep peak of unbounded height at the isovalue gives the isosurface, alpha = H H whatever the length.
#[test]
fn a_dirac_transfer_function_is_the_isosurface() {
    let data = synthetic("marschner-lobb,n=14,as=tets");
    let surface = Surface {
        colour: [0.9, 0.3, 0.1],
        ..Surface::isovalue(0.5, 0)
    };
    let c = surface.colour;
    let scene = Scene {
        data,
        surfaces: vec![surface],
        transfer: TransferFunction {
            points: vec![(0.4999, c, 0.0), (0.5, c, 1e9), (0.5001, c, 0.0)],
            unit: 1.0,
        },
        view: View::bench(61, 43),
    };
    let with = frame(&scene, exact()).0;
    let alone = frame(
        &Scene {
            surfaces: vec![],
            ..scene
        },
        exact(),
    )
    .0;
    let (mut hits, mut differ) = (0, 0);
    for (i, t) in with.t.iter().enumerate() {
        hits += usize::from(t.is_finite());
        let opaque = alone.rgba[i][3] > 0.999;
        differ += usize::from(t.is_finite() != opaque);
        if opaque && t.is_finite() {
            assert!((0..3).all(|k| (alone.rgba[i][k] - c[k]).abs() < 1e-3), "unshaded");
        }
    }
    // The peak has a width: silhouettes may touch it where they miss the surface.
    assert!(hits > 500 && differ * 100 < hits, "{hits} {differ}");
}

#[test]
fn what_cannot_be_drawn_is_said() {
    let data = synthetic("sphere,n=4,as=tets");
    let mut r = CELLPROJ_CPU.open(&Request::default()).unwrap();
    r.set_data(&data).unwrap();
    let bad = |points: Vec<(f64, [f32; 3], f32)>| TransferFunction { points, unit: 1.0 };
    for t in [
        bad(vec![]),
        bad(vec![(1.0, [0.0; 3], 1.0), (0.0, [0.0; 3], 1.0)]),
        bad(vec![(f64::NAN, [0.0; 3], 1.0)]),
    ] {
        assert!(r.set_medium(Some(&t)).is_err());
    }
    // One point, no density anywhere, a constant field: ordinary scenes.
    r.set_surfaces(&[]).unwrap();
    r.set_view(&View::bench(8, 8)).unwrap();
    r.set_medium(Some(&bad(vec![(0.5, [1.0; 3], 0.0)]))).unwrap();
    r.render(&Stop::default()).unwrap();
    let mut f = Frame::new(1, 1, 1, Channels::empty());
    r.read(&mut f).unwrap();
    assert!(f.rgba.iter().all(|c| *c == [0.0; 4]));
    let Data::Tets(m) = &*data else { panic!("a mesh") };
    let constant = TetMesh::new(m.points.clone(), m.cells.clone(), vec![0.5; m.values.len()].into()).unwrap();
    r.set_data(&Arc::new(Data::Tets(constant))).unwrap();
    r.set_medium(Some(&bad(vec![(0.5, [1.0; 3], 1.0)]))).unwrap();
    r.render(&Stop::default()).unwrap();
    r.read(&mut f).unwrap();
    assert!(f.rgba[4 * 8 + 4][3] > 0.5);
    let ray = Ray {
        origin: DVec3::ZERO,
        direction: DVec3::X,
    };
    r.set_view(&View {
        camera: Camera::Rays(vec![ray].into()),
        width: 1,
        height: 1,
        clips: vec![],
    })
    .unwrap();
    let e = r.render(&Stop::default()).unwrap_err().to_string();
    assert!(e.contains("lists of rays") && !e.contains('\n'), "{e}");
}
