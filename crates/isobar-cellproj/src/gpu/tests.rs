//! `cellproj/gpu` against `cellproj/cpu`, every pixel, and against the oracle.

use super::medium::Limits;
use super::{INFO, SNIPPETS, source};
use crate::colour_tests::{Scene, count, cycle, frame_of, glass, smooth, truth, views};
use crate::hostile_tests::{edge_on, long_cycle};
use crate::tests::{fire, orthographic, synthetic};
use crate::{CELLPROJ_CPU, CELLPROJ_GPU};
use isobar_core::{
    Camera, Channels, Claim, ClipPlane, DVec3, Data, Frame, Knobs, Method, RenderError, Renderer, Request, Stage, Stop, Surface,
    TetMesh, View,
};
use isobar_gpu::{Gpu, shader, test_adapter};
use isobar_oracle::{Model, Truth, check};
use std::process::Command;
use std::sync::Arc;

#[test]
fn every_module_is_portable() {
    for name in ["patch", "medium"] {
        shader::validate(name, &source(name).unwrap()).unwrap();
    }
    assert_eq!(SNIPPETS.len(), 3);
}

fn draw(method: &dyn Method, data: &Arc<Data>, surfaces: &[Surface], view: &View, knobs: Knobs) -> (Frame, f64) {
    let request = Request {
        channels: Channels::all(),
        layers: 3,
        knobs,
        ..Request::default()
    };
    let mut r = method.open(&request).unwrap();
    r.set_data(data).unwrap();
    r.set_surfaces(surfaces).unwrap();
    r.set_view(view).unwrap();
    r.render(&Stop::default()).unwrap();
    let mut frame = Frame::default();
    r.read(&mut frame).unwrap();
    let Data::Tets(mesh) = &**data else { panic!("a mesh") };
    let (lo, hi) = data.bounds();
    (frame, (hi - lo).length() / (mesh.cells.len() as f64).cbrt())
}

/// What differs between two frames.
#[derive(Debug, Default)]
struct Twin {
    hits: usize,
    /// Pixels of which one method has a hit, or of another surface, or more than a hundredth of a cell apart.
    other: usize,
    /// Pixels with another number of hits.
    counts: usize,
    /// Of the others, the greatest difference of t, in cells.
    apart: f64,
    /// Normals that differ by more than f32 does.
    normals: usize,
}

fn twin(data: &Arc<Data>, surfaces: &[Surface], view: &View) -> Twin {
    let (a, cell) = draw(&CELLPROJ_CPU, data, surfaces, view, Knobs::default());
    let (b, _) = draw(&CELLPROJ_GPU, data, surfaces, view, Knobs::default());
    let mut out = Twin::default();
    for i in 0..view.pixels() {
        out.hits += usize::from(a.t[i].is_finite());
        let apart = if a.t[i] == b.t[i] {
            0.0
        } else {
            (a.t[i] - b.t[i]).abs() / cell
        };
        if a.surface[i] != b.surface[i] || apart.is_nan() || apart > 0.01 {
            out.other += 1;
            continue;
        }
        out.counts += usize::from(a.hits[i] != b.hits[i]);
        out.apart = out.apart.max(apart);
        let off = (0..3).map(|k| (a.normal[i][k] - b.normal[i][k]).abs()).fold(0.0, f32::max);
        out.normals += usize::from(off > 1e-6);
    }
    out
}

fn opaque(values: &[f64]) -> Vec<Surface> {
    values.iter().enumerate().map(|(i, &c)| Surface::isovalue(c, i)).collect()
}

/// The hits are those of the CPU but at silhouettes, within f32; what was seen is a few in a hundred thousand.
#[test]
fn hits_are_those_of_the_cpu() {
    if test_adapter("hits_are_those_of_the_cpu").is_none() {
        return;
    }
    let ml = synthetic("marschner-lobb,n=20,as=tets");
    let gyroid = synthetic("gyroid,n=24,as=tets");
    let inside = View::perspective(
        DVec3::new(0.31, -0.2, 0.05),
        DVec3::new(1.0, 0.3, 0.1),
        DVec3::Z,
        100.0,
        80,
        60,
    );
    let through = orthographic(DVec3::new(0.1, 0.05, 0.2), DVec3::new(0.9, 0.4, 0.3), 1.6, (80, 60));
    let outside = orthographic(DVec3::new(2.6, 1.9, 2.2), DVec3::ZERO, 2.6, (201, 150));
    let mut clipped = View::bench(240, 180);
    clipped.clips = vec![ClipPlane {
        normal: DVec3::new(1.0, 0.2, 0.1),
        distance: 0.3,
        cap: false,
    }];
    let bench = View::bench(240, 180);
    let (mut hits, mut other) = (0, 0);
    for (name, data, values, view) in [
        ("perspective", &ml, &[0.5][..], &bench),
        ("many", &ml, &[0.2, 0.3, 0.4, 0.5, 0.6, 0.7], &bench),
        ("gyroid", &gyroid, &[0.2, -0.4], &bench),
        ("orthographic", &ml, &[0.5, 0.3], &outside),
        ("inside", &ml, &[0.5, 0.3], &inside),
        ("orthographic inside", &ml, &[0.5], &through),
        ("clipped", &ml, &[0.5, 0.3], &clipped),
    ] {
        let t = twin(data, &opaque(values), view);
        println!("{name}: {t:?}");
        assert!(t.hits > 300, "{name}: {t:?}");
        assert!(t.other <= 2 && t.counts <= 4 && t.normals <= t.hits / 500, "{name}: {t:?}");
        assert!(t.apart < 2e-3, "{name}: {t:?}");
        (hits, other) = (hits + t.hits, other + t.other);
    }
    assert!(other * 20_000 < hits, "{other} of {hits}");
}

/// Shipped data, far from the origin, of extreme sizes: f32 holds because points are counted from the middle of the mesh.
#[test]
fn real_far_small_and_inverted_meshes() {
    if test_adapter("real_far_small_and_inverted_meshes").is_none() {
        return;
    }
    let data = fire();
    let Data::Tets(mesh) = &*data else { panic!("a mesh") };
    let (lo, hi) = mesh
        .values
        .iter()
        .fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), &v| (a.min(v), b.max(v)));
    let c = f64::from(lo) + 0.3 * f64::from(hi - lo);
    let t = twin(&data, &opaque(&[c]), &View::fit(data.bounds(), 40.0, 200, 150));
    assert!(t.hits > 1000 && t.other <= 1 && t.apart < 5e-3, "{t:?}");
    let Data::Tets(base) = &*synthetic("sphere,n=9,as=tets") else {
        panic!("a mesh")
    };
    let direction = DVec3::new(2.6, 1.9, 2.2);
    for (name, scale, shift) in [
        ("far", 1.0, 1e6),
        ("small", 1e-30, 0.0),
        ("tiny", 1e-90, 0.0),
        ("large", 1e60, 0.0),
    ] {
        let shift = DVec3::new(shift, -shift, 2.0 * shift);
        let points: Vec<DVec3> = base.points.iter().map(|&p| p * scale + shift).collect();
        let turned = |(i, &[a, b, c, d]): (usize, &[u32; 4])| if i % 3 == 0 { [b, a, c, d] } else { [a, b, c, d] };
        let cells: Vec<[u32; 4]> = base.cells.iter().enumerate().map(turned).collect();
        let data = Arc::new(Data::Tets(
            TetMesh::new(points.into(), cells.into(), base.values.clone()).unwrap(),
        ));
        for view in [
            View::perspective(direction * scale + shift, shift, DVec3::Z, 40.0, 80, 60),
            orthographic(direction * (40.0 * scale) + shift, shift, 2.5 * scale, (80, 60)),
        ] {
            let t = twin(&data, &opaque(&[1.0]), &view);
            assert!(t.hits > 500 && t.other <= 1 && t.apart < 1e-3, "{name}: {t:?}");
        }
    }
}

/// Cells that only touch the surface, plateaus and constant cells: the first hit is there, from outside.
#[test]
fn plateaus() {
    if test_adapter("plateaus").is_none() {
        return;
    }
    let n = 7;
    let grid = |f: &dyn Fn([usize; 3]) -> f32| {
        let samples: Vec<f32> = (0..n * n * n).map(|i| f([i % n, i / n % n, i / n / n])).collect();
        let grid = isobar_core::Grid::unit([n; 3], isobar_core::Samples::F32(samples.into())).unwrap();
        Arc::new(Data::Tets(isobar_fields::grid_to_tets(&grid).unwrap()))
    };
    let block = |[x, y, z]: [usize; 3]| (2..=4).contains(&x) && y > 1 && z > 0;
    let plateau = grid(&|p| if block(p) { 1.0 } else { 1.5 + p[0] as f32 });
    let floor = grid(&|[_, _, z]| (z as f32 - 3.0).abs());
    let centre = DVec3::splat(3.0);
    for (name, data, c) in [("plateau", &plateau, 1.0), ("floor", &floor, 0.0), ("planes", &floor, 1.0)] {
        for view in [
            View::perspective(centre + DVec3::new(8.0, 5.5, 6.3), centre, DVec3::Z, 45.0, 81, 60),
            orthographic(centre + DVec3::new(9.0, 4.1, 5.3), centre, 9.0, (81, 60)),
        ] {
            let t = twin(data, &opaque(&[c]), &view);
            assert!(t.hits > 500 && t.other <= 2 && t.apart < 1e-3, "{name}: {t:?}");
            // A joined stretch is one hit on the CPU, and one for each cell here.
            assert!(name == "plateau" || t.counts <= 2, "{name}: {t:?}");
        }
    }
}

#[test]
fn claims_are_those_of_the_cpu() {
    if test_adapter("claims_are_those_of_the_cpu").is_none() {
        return;
    }
    let data = synthetic("marschner-lobb,n=20,as=tets");
    let (view, surfaces) = (View::bench(120, 90), opaque(&[0.5, 0.3]));
    let request = Request {
        channels: Channels::all() - Channels::HITS,
        knobs: Knobs::default().with("claims", "cpu"),
        ..Request::default()
    };
    let mut r = CELLPROJ_GPU.open(&request).unwrap();
    r.set_view(&view).unwrap();
    r.set_surfaces(&surfaces).unwrap();
    r.set_data(&data).unwrap();
    r.render(&Stop::default()).unwrap();
    let mut frame = Frame::default();
    r.read(&mut frame).unwrap();
    let f = r.reconstruction(Stage::Stored).unwrap();
    let truth = Truth::compute(&f, &surfaces, &view, &Stop::default()).unwrap();
    let c = check(&frame, &truth, &f, &surfaces, &view).unwrap();
    assert!(c.refuted == 0 && c.unclaimed <= 2 && c.hits > 1500, "{c:?}");
    assert!(c.missed + c.false_hits + c.wrong_root + c.wrong_surface <= 1, "{c:?}");
    assert!(count(&r.counters(), "pixels proved") as usize + 2 >= view.pixels());
    let without = draw(&CELLPROJ_GPU, &data, &surfaces, &view, Knobs::default()).0;
    assert!(without.claim.iter().all(|c| *c == Claim::empty()));
    assert_eq!(without.t[..view.pixels()], frame.t[..]);
}

/// Greatest difference of two images, and how many pixels differ by more than 1/255.
fn apart(a: &Frame, b: &Frame) -> (f32, usize) {
    let each = a.rgba.iter().zip(&b.rgba).map(|(a, b)| {
        let d = (0..4).map(|k| (a[k] - b[k]).abs());
        d.fold(0.0, |m: f32, v| if v > m || v.is_nan() { v } else { m })
    });
    each.fold((0.0, 0), |(m, n), v| {
        (
            if v > m || v.is_nan() { v } else { m },
            n + usize::from(v.is_nan() || v > 1.0 / 255.0),
        )
    })
}

/// The medium alone, with glass and with opaque surfaces, all views, tables and models, planes: the CPU's image.
#[test]
fn media_are_those_of_the_cpu() {
    if test_adapter("media_are_those_of_the_cpu").is_none() {
        return;
    }
    let data = synthetic("marschner-lobb,n=14,as=tets");
    for (name, view) in views() {
        for surfaces in [vec![], glass(&[(0.5, 0.4), (0.3, 0.3)]), glass(&[(0.5, 1.0)])] {
            for (knob, word) in [
                ("integration", "table3d"),
                ("integration", "table2d"),
                ("model", "wilhelms-van-gelder"),
            ] {
                // Each scene with the 3D table; glass with the other one and planes, the medium alone with the other model.
                let glass = surfaces.len() == 2;
                if word == "table2d" && !glass || knob == "model" && !surfaces.is_empty() {
                    continue;
                }
                let mut view = view.clone();
                if word == "table2d" {
                    view.clips = vec![ClipPlane {
                        normal: DVec3::new(2.0, 0.5, 0.1),
                        distance: 0.7,
                        cap: false,
                    }];
                }
                let scene = Scene {
                    data: data.clone(),
                    surfaces: surfaces.clone(),
                    transfer: smooth((0.0, 1.0), 2.0),
                    view,
                };
                let knobs = Knobs::default().with(knob, word);
                let a = frame_of(&CELLPROJ_CPU, &scene, knobs.clone()).0;
                let b = frame_of(&CELLPROJ_GPU, &scene, knobs).0;
                let (most, many) = apart(&a, &b);
                // Normals of hits on faces may be those of either side.
                assert!(many <= 2, "{name}, {word}, {} surfaces: {most} {many}", surfaces.len());
                assert!(!surfaces.is_empty() || most < 1e-3, "{name}, {word}: {most}");
            }
        }
    }
}

/// What far values have in common does not take the digits of a medium's table.
#[test]
fn values_far_from_zero() {
    if test_adapter("values_far_from_zero").is_none() {
        return;
    }
    let Data::Tets(base) = &*synthetic("marschner-lobb,n=9,as=tets") else {
        panic!("a mesh")
    };
    let values: Vec<f32> = base.values.iter().map(|v| (1e7 + 12.0 * f64::from(*v)) as f32).collect();
    let data = Arc::new(Data::Tets(
        TetMesh::new(base.points.clone(), base.cells.clone(), values.into()).unwrap(),
    ));
    for (name, view) in views() {
        let scene = Scene {
            data: data.clone(),
            surfaces: vec![],
            transfer: smooth((1e7, 1e7 + 12.0), 2.0),
            view,
        };
        let a = frame_of(&CELLPROJ_CPU, &scene, Knobs::default()).0;
        let b = frame_of(&CELLPROJ_GPU, &scene, Knobs::default()).0;
        let (most, many) = apart(&a, &b);
        assert!(many == 0 && most < 1e-3, "{name}: {most} {many}");
    }
}

/// No order exists: each pixel has its own.
#[test]
fn a_cycle_is_resolved() {
    if test_adapter("a_cycle_is_resolved").is_none() {
        return;
    }
    let scene = cycle();
    let (f, counters, function) = frame_of(&CELLPROJ_GPU, &scene, Knobs::default().with("table", 128));
    assert_eq!((count(&counters, "cycles"), count(&counters, "cells in cycles")), (1, 3));
    let (cpu, _, _) = frame_of(&CELLPROJ_CPU, &scene, Knobs::default().with("table", 128));
    let (most, many) = apart(&cpu, &f);
    assert!(most < 2e-3 && many == 0, "{most} {many}");
    // What the table is off by, 0.07 in a medium as dense as this, is the same on both.
    let exact = truth(&scene, &function, Model::VolumeDensity);
    let (d, e) = (exact.difference(&f).unwrap(), exact.difference(&cpu).unwrap());
    assert!((d.p99 - e.p99).abs() < 2e-3 && (d.mean - e.mean).abs() < 1e-3, "{d:?} {e:?}");
}

/// Cycles of any length, with surfaces in them; rays in the planes of faces.
#[test]
fn long_cycles_and_edge_on_faces_are_those_of_the_cpu() {
    if test_adapter("long_cycles_and_edge_on_faces_are_those_of_the_cpu").is_none() {
        return;
    }
    for n in [22, 100, 400] {
        let scene = long_cycle(n);
        let (f, counters, _) = frame_of(&CELLPROJ_GPU, &scene, Knobs::default());
        assert_eq!(count(&counters, "cells in cycles"), 3 * u64::from(n));
        let (cpu, _, _) = frame_of(&CELLPROJ_CPU, &scene, Knobs::default());
        let (most, many) = apart(&cpu, &f);
        println!("{n}: {most:e}, {many}");
        assert!(many <= 2, "{n}: {most} {many}");
    }
    for (name, scene) in edge_on() {
        let (f, _, _) = frame_of(&CELLPROJ_GPU, &scene, Knobs::default());
        let (cpu, _, _) = frame_of(&CELLPROJ_CPU, &scene, Knobs::default());
        let (most, many) = apart(&cpu, &f);
        assert!(many == 0, "{name}: {most} {many}");
    }
}

/// A frame in many passes and bands is, to the bit, the frame in one.
#[test]
fn passes_and_bands_make_no_difference() {
    let Some(gpu) = test_adapter("passes_and_bands_make_no_difference") else {
        return;
    };
    let glassy = Scene {
        data: synthetic("marschner-lobb,n=10,as=tets"),
        surfaces: glass(&[(0.5, 0.4), (0.3, 0.3)]),
        transfer: smooth((0.0, 1.0), 2.0),
        view: View::bench(61, 43),
    };
    for (name, scene) in [("glass", glassy), ("a cycle", cycle())] {
        let mut r = super::renderer::CellprojRenderer::new(gpu.clone(), &Request::default()).unwrap();
        r.set_data(&scene.data).unwrap();
        r.set_surfaces(&scene.surfaces).unwrap();
        r.set_medium(Some(&scene.transfer)).unwrap();
        r.set_view(&scene.view).unwrap();
        let mut draw = |limits: Option<Limits>| {
            r.limits = limits.unwrap_or(r.limits);
            r.render(&Stop::default()).unwrap();
            let mut frame = Frame::default();
            r.read(&mut frame).unwrap();
            (frame, count(&r.counters(), "passes of the medium"))
        };
        let (whole, one) = draw(None);
        assert_eq!(one, 1, "{name}");
        assert!(whole.rgba.iter().any(|c| c[3] > 0.5));
        // Cells in a pass, bytes in a binding: a row of squares holds 61 x 8 pixels, or 97 x 8.
        for (cells, bytes, least) in [(1, 1 << 30, 2), (7, 20_000, 3), (4096, 1, 6)] {
            let (parts, passes) = draw(Some(Limits { cells, bytes }));
            assert!(passes >= least, "{name}: {passes}");
            assert_eq!(parts.rgba, whole.rgba, "{name}: {cells} {bytes}");
        }
    }
}

#[test]
fn smooth_shading_is_that_of_the_cpu() {
    if test_adapter("smooth_shading_is_that_of_the_cpu").is_none() {
        return;
    }
    let data = synthetic("sphere,n=9,as=tets");
    let view = View::bench(120, 90);
    let knobs = Knobs::default().with("shading", "smooth").with("inside", 0x20_80ff);
    let (a, _) = draw(&CELLPROJ_CPU, &data, &opaque(&[1.0]), &view, knobs.clone());
    let (b, _) = draw(&CELLPROJ_GPU, &data, &opaque(&[1.0]), &view, knobs);
    let (most, many) = apart(&a, &b);
    assert!(many == 0 && most < 1e-4, "{most} {many}");
}

#[test]
fn what_cannot_be_drawn_is_one_line() {
    let Some(gpu) = test_adapter("what_cannot_be_drawn_is_one_line") else {
        return;
    };
    let data = synthetic("sphere,n=5,as=tets");
    let mut r = CELLPROJ_GPU.open(&Request::default()).unwrap();
    let said = |e: RenderError, word: &str| {
        let e = e.to_string();
        assert!(e.contains(word) && !e.contains('\n'), "{e}");
    };
    let ray = View::bench(2, 2).ray(0, 0);
    said(r.set_view(&View::rays(vec![ray])).unwrap_err(), "lists of rays");
    let plane = ClipPlane {
        normal: DVec3::X,
        distance: 0.0,
        cap: false,
    };
    let mut view = View::bench(8, 8);
    view.clips = vec![plane; 9];
    said(r.set_view(&view).unwrap_err(), "clipping planes");
    view.clips = vec![ClipPlane { cap: true, ..plane }];
    said(r.set_view(&view).unwrap_err(), "--cap");
    let Data::Tets(m) = &*data else { panic!("a mesh") };
    let wide: Vec<f32> = m.values.iter().map(|v| v * 3e37).collect();
    let wide = TetMesh::new(m.points.clone(), m.cells.clone(), wide.into()).unwrap();
    said(r.set_data(&Arc::new(Data::Tets(wide))).unwrap_err(), "1e37");
    r.set_data(&data).unwrap();
    r.set_surfaces(&opaque(&[1.0])).unwrap();
    // Too long for a target, too large for a binding: refused with both numbers, and the renderer goes on.
    let long = gpu.report().max_texture_2d as usize + 1;
    if long < 65_536 {
        r.set_view(&View::bench(long, 4)).unwrap();
        let e = r.render(&Stop::default()).unwrap_err();
        assert!(matches!(e, RenderError::Memory { .. }), "{e}");
    }
    r.set_view(&View::bench(8, 8)).unwrap();
    if gpu.binding_limit() < 256 << 20 {
        r.set_knobs(&Knobs::default().with("table", 256)).unwrap();
        r.set_medium(Some(&smooth((0.0, 1.0), 1.0))).unwrap();
        let e = r.render(&Stop::default()).unwrap_err();
        assert!(matches!(e, RenderError::Memory { .. }), "{e}");
    }
    r.set_knobs(&Knobs::default()).unwrap();
    r.set_medium(None).unwrap();
    r.render(&Stop::default()).unwrap();
    let scene = isobar_core::Scene {
        data: &data,
        surfaces: &opaque(&[1.0]),
        medium: None,
        view: &View {
            camera: Camera::Rays(vec![ray].into()),
            width: 1,
            height: 1,
            clips: vec![],
        },
    };
    let e = CELLPROJ_GPU.supports(&scene, &Request::default()).unwrap_err().to_string();
    assert!(e.starts_with(INFO.id) && e.contains("lists of rays"), "{e}");
}

/// A lost device is an error of `render`; a renderer opened again draws.
#[test]
fn a_lost_device_is_one_error() {
    let Some(gpu) = test_adapter("a_lost_device_is_one_error") else {
        return;
    };
    // A device of its own: the shared one serves other tests.
    let own = Gpu::open_named(Some(&gpu.report().name)).unwrap();
    let mut r: Box<dyn isobar_core::Renderer> =
        Box::new(super::renderer::CellprojRenderer::new(own.clone(), &Request::default()).unwrap());
    r.set_data(&synthetic("sphere,n=5,as=tets")).unwrap();
    r.set_surfaces(&opaque(&[1.0])).unwrap();
    r.set_view(&View::bench(8, 8)).unwrap();
    r.render(&Stop::default()).unwrap();
    own.device().destroy();
    let e = r.render(&Stop::default()).unwrap_err();
    assert!(matches!(e, RenderError::Device(_)) && !e.to_string().contains('\n'), "{e}");
}

/// Runs the test below in a process that asks for an adapter which is not there.
#[test]
fn a_missing_adapter_is_one_error() {
    let out = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "gpu::tests::without_an_adapter"])
        .env("ISOBAR_ADAPTER", "no such card")
        .output()
        .unwrap();
    assert!(out.status.success(), "{}", String::from_utf8_lossy(&out.stdout));
}

#[test]
fn without_an_adapter() {
    if std::env::var("ISOBAR_ADAPTER").is_ok_and(|a| a == "no such card") {
        let e = CELLPROJ_GPU.open(&Request::default()).err().expect("no adapter").to_string();
        assert!(e.starts_with(INFO.id) && e.contains("adapter") && !e.contains('\n'), "{e}");
    }
}
