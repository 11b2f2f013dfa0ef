//! Frames as printed against the oracle: how much is wrong is counted, and what the paper says of it is checked.

use crate::tests::{orthographic, synthetic};
use crate::{CELLPROJ_CPU, CELLPROJ_CPU_PAPER};
use isobar_core::{
    Camera, Channels, Counters, DVec3, Data, Frame, Function, Knobs, Method, Request, Scene, Stage, Stop, Surface,
    TransferFunction, View,
};
use isobar_oracle::{Check, Colours, Integral, Model, Reference, Truth, check};
use std::sync::Arc;

fn draw(
    method: &dyn Method,
    (data, surfaces, transfer): (&Arc<Data>, &[Surface], Option<&TransferFunction>),
    view: &View,
    knobs: Knobs,
) -> (Frame, Counters, Arc<dyn Function>) {
    let request = Request {
        channels: Channels::all(),
        knobs,
        ..Request::default()
    };
    let mut r = method.open(&request).unwrap();
    r.set_data(data).unwrap();
    r.set_surfaces(surfaces).unwrap();
    r.set_medium(transfer).unwrap();
    r.set_view(view).unwrap();
    r.render(&Stop::default()).unwrap();
    let mut frame = Frame::default();
    r.read(&mut frame).unwrap();
    (frame, r.counters(), r.reconstruction(Stage::Stored).unwrap())
}

fn surfaces(isovalues: &[f64]) -> Vec<Surface> {
    isovalues.iter().enumerate().map(|(i, &c)| Surface::isovalue(c, i)).collect()
}

fn checked(data: &Arc<Data>, isovalues: &[f64], view: &View, knobs: Knobs) -> (Check, Counters) {
    let surfaces = surfaces(isovalues);
    let (frame, counters, function) = draw(&CELLPROJ_CPU_PAPER, (data, &surfaces, None), view, knobs);
    let truth = Truth::compute(&function, &surfaces, view, &Stop::default()).unwrap();
    (check(&frame, &truth, &function, &surfaces, view).unwrap(), counters)
}

fn count(c: &Counters, name: &str) -> u64 {
    c.0.iter().find(|c| c.0 == name).unwrap().1
}

/// Pixels that differ from the oracle's.
fn wrong(c: &Check) -> usize {
    c.missed + c.false_hits + c.wrong_root + c.wrong_surface
}

fn view() -> View {
    orthographic(DVec3::new(2.6, 1.9, 2.2), DVec3::ZERO, 2.9, (97, 71))
}

fn knobs(pairs: &[(&str, &str)]) -> Knobs {
    pairs.iter().fold(Knobs::default(), |k, (name, value)| k.with(name, value))
}

/// Finer textures are nearer, and have more gaps: values of neighbours at their common face, which the lattice of positions moves, are rounded to the same texel less
/// often. The stencil, whose test is per pixel, is right but for that lattice.
#[test]
fn wrong_pixels_are_counted() {
    let data = synthetic("marschner-lobb,n=20,as=tets");
    let of = |pairs: &[(&str, &str)]| checked(&data, &[0.5, 0.3], &view(), knobs(pairs)).0;
    let coarse = of(&[("texture", "16")]);
    let fine = of(&[("texture", "256")]);
    let finer = of(&[("texture", "2048")]);
    let stencil = of(&[("isosurface", "stencil")]);
    assert!(fine.hits > 1500 && fine.unclaimed == fine.pixels && fine.refuted == 0);
    let told = [&coarse, &fine, &finer, &stencil].map(|c| (wrong(c), c.t_error_voxels.median));
    let t = |c: &Check| c.t_error_voxels.median;
    assert!(t(&coarse) > 4.0 * t(&fine) && t(&fine) > 4.0 * t(&finer), "{told:?}");
    assert!(wrong(&fine) * 20 < fine.hits, "{told:?}");
    assert!(wrong(&finer) * 100 < finer.hits, "{told:?}");
    assert!(wrong(&stencil) * 200 < stencil.hits && t(&stencil) < 0.01, "{told:?}");
    // One and two passes set the same pixels.
    let flat = of(&[("shading", "flat")]);
    assert_eq!((wrong(&flat), flat.hits), (wrong(&fine), fine.hits));
}

/// Thickening sets more and loses none; in semi-transparent surfaces it draws edges twice.
#[test]
fn thickening_closes_gaps_and_doubles_edges() {
    let data = synthetic("gyroid,n=16,as=tets");
    let at = |thickening: &str| {
        let (frame, _, _) = draw(
            &CELLPROJ_CPU_PAPER,
            (&data, &surfaces(&[0.2]), None),
            &view(),
            knobs(&[("thickening", thickening)]),
        );
        let found = frame.t.iter().filter(|t| t.is_finite()).count();
        (found, frame.hits.iter().map(|h| u64::from(*h)).sum::<u64>())
    };
    let ((thin, once), (thick, twice)) = (at("0"), at("1"));
    assert!(thick >= thin && twice > once + once / 20, "{thin} {thick} {once} {twice}");
}

/// Table 1's claim (hardcases E4): ten isosurfaces in the same cells are the triangles and fragments of two; smooth takes a pass more.
#[test]
fn the_number_of_isosurfaces_does_not_matter() {
    let data = synthetic("sphere,n=12,as=tets");
    let ten: Vec<f64> = (0..10).map(|i| 1.003 + 1e-5 * f64::from(i)).collect();
    let two = [ten[0], ten[9]];
    let work = |isovalues: &[f64], shading: &str| {
        let c = checked(&data, isovalues, &view(), knobs(&[("shading", shading), ("texture", "64")])).1;
        (count(&c, "cells intersected"), count(&c, "triangles"))
    };
    assert_eq!(work(&two, "flat"), work(&ten, "flat"));
    let (flat, smooth) = (work(&ten, "flat").1, work(&ten, "smooth").1);
    assert!(flat > 1000 && smooth == 2 * flat, "{flat} {smooth}");
}

fn smooth_transfer() -> TransferFunction {
    TransferFunction {
        points: vec![
            (0.0, [0.1, 0.2, 1.0], 0.0),
            (0.25, [0.1, 0.8, 0.6], 1.2),
            (0.5, [1.0, 1.0, 0.2], 0.0),
            (0.8, [1.0, 0.1, 0.1], 2.0),
            (1.0, [1.0, 1.0, 1.0], 0.4),
        ],
        unit: 1.0,
    }
}

/// The tables of sections 3 and 4 against the integral, the comparators of section 2, 8 bits, perspective.
#[test]
fn volumes_are_as_wrong_as_the_paper_says() {
    let data = synthetic("marschner-lobb,n=14,as=tets");
    let transfer = smooth_transfer();
    let of = |view: &View, pairs: &[(&str, &str)]| {
        let (frame, counters, function) = draw(&CELLPROJ_CPU_PAPER, (&data, &[], Some(&transfer)), view, knobs(pairs));
        let left_out = count(&counters, "left out");
        let integral = Integral::new(
            &function,
            &[],
            Some(&transfer),
            Reference::Integral,
            Model::VolumeDensity,
            &[],
        )
        .unwrap();
        let truth = Colours::of(&integral, view, &Stop::default()).unwrap();
        (truth.difference(&frame).unwrap().p99, left_out)
    };
    let small = orthographic(DVec3::new(2.6, 1.9, 2.2), DVec3::ZERO, 2.9, (61, 43));
    let (three, left_out) = of(&small, &[("volume", "table3d")]);
    let (two, _) = of(&small, &[("volume", "table2d")]);
    let (linear, _) = of(&small, &[("volume", "linear")]);
    let (stein, _) = of(&small, &[("volume", "stein")]);
    let (bytes, _) = of(&small, &[("volume", "table3d"), ("framebuffer", "8bit")]);
    let (perspective, _) = of(&View::bench(61, 43), &[("volume", "table3d")]);
    assert_eq!(left_out, 0);
    assert!(three < 2.0 / 255.0, "{three}");
    assert!(two > three && two < 0.1, "{two}");
    assert!(
        linear > 2.0 * three && stein > 2.0 * three && stein < linear * 1.5,
        "{linear} {stein} {three}"
    );
    assert!(bytes > 3.0 * three, "{bytes} {three}");
    assert!(perspective < 3.0 * two, "{perspective}");
}

/// Section 10: the stopped integration under opaque surfaces is the integral, the smooth order is not quite.
#[test]
fn both_mixtures_are_near_the_integral() {
    let data = synthetic("marschner-lobb,n=14,as=tets");
    let (transfer, surfaces) = (smooth_transfer(), surfaces(&[0.5]));
    let small = orthographic(DVec3::new(2.6, 1.9, 2.2), DVec3::ZERO, 2.9, (61, 43));
    let of = |mixing: &str, shading: &str| {
        let knobs = knobs(&[
            ("mixing", mixing),
            ("shading", shading),
            ("volume", "table3d"),
            ("texture", "1024"),
        ]);
        let (frame, _, function) = draw(&CELLPROJ_CPU_PAPER, (&data, &surfaces, Some(&transfer)), &small, knobs);
        let integral = Integral::new(
            &function,
            &surfaces,
            Some(&transfer),
            Reference::Integral,
            Model::VolumeDensity,
            &[],
        )
        .unwrap();
        let truth = Colours::of(&integral, &small, &Stop::default()).unwrap();
        let d = truth.difference(&frame).unwrap();
        (d.mean, d.p99)
    };
    let (stopped, smooth) = (of("stopped", "flat"), of("smooth", "flat"));
    // The 3D texture does not resolve where the integration stops: half a texel of value is much of a stay.
    assert!(stopped.0 < 4.0 / 255.0 && smooth.0 < 8.0 / 255.0, "{stopped:?} {smooth:?}");
    of("stopped", "smooth");
}

/// Section 9: faces towards greater values have a colour of their own, by texture and by stencil.
#[test]
fn the_two_faces_of_a_surface_have_two_colours() {
    let data = synthetic("gyroid,n=16,as=tets");
    let surface = [Surface {
        colour: [1.0, 0.0, 0.0],
        ..Surface::isovalue(0.2, 0)
    }];
    for pairs in [
        &[("texture", "1024"), ("shading", "flat")][..],
        &[("texture", "1024")],
        &[("isosurface", "stencil")],
    ] {
        let (one, _, _) = draw(&CELLPROJ_CPU_PAPER, (&data, &surface, None), &view(), knobs(pairs));
        let two = knobs(pairs).with("inside", 0x00_00ff);
        let (two, _, function) = draw(&CELLPROJ_CPU_PAPER, (&data, &surface, None), &view(), two);
        assert_eq!(one.t, two.t);
        let (mut outside, mut inside, mut wrong) = (0, 0, 0);
        for i in (0..two.t.len()).filter(|&i| two.t[i].is_finite()) {
            let ray = view().ray(i % 97, i / 97);
            let [r, _, b, _] = two.rgba[i];
            assert!(one.rgba[i][0] > 0.0 && one.rgba[i][2] == 0.0);
            // Values rise along the ray: it comes from smaller ones.
            let rising = function.gradient(two.point[i]).dot(ray.direction) > 0.0;
            if rising {
                outside += 1
            } else {
                inside += 1
            }
            wrong += usize::from((r > b) != rising);
        }
        // The place of a hit is that of its texel: near a face it may lie in the neighbouring cell.
        assert!(
            outside > 500 && inside > 500 && wrong * 50 < outside + inside,
            "{outside} {inside} {wrong}"
        );
    }
}

/// The eye's own value lies between those of a cell's corners: rays come from it, not from the corner nearest.
#[test]
fn the_stencil_orders_by_the_value_at_the_eye() {
    let points = vec![
        DVec3::new(0.0, 4.0, -0.5),
        DVec3::new(-3.0, 5.0, 2.0),
        DVec3::new(3.0, 5.0, 2.0),
        DVec3::new(0.0, 9.0, -0.2),
    ];
    // Turned over, too: rays then come from greater values.
    for sign in [1.0f64, -1.0] {
        let values: Vec<f32> = points.iter().map(|p| (sign * p.z) as f32).collect();
        let mesh = isobar_core::TetMesh::new(points.clone().into(), vec![[0, 1, 2, 3]].into(), values.into()).unwrap();
        let data = Arc::new(Data::Tets(mesh));
        let view = View::perspective(DVec3::ZERO, DVec3::new(0.0, 5.0, 0.3), DVec3::Z, 10.0, 96, 72);
        let of = |values: &[f64]| {
            let values: Vec<f64> = values.iter().map(|v| sign * v).collect();
            let scene = (&data, &surfaces(&values)[..], None);
            draw(&CELLPROJ_CPU_PAPER, scene, &view, knobs(&[("isosurface", "stencil")])).0
        };
        let values = [0.3, 0.35, 0.4];
        let (all, alone) = (of(&values), values.map(|c| of(&[c])));
        let mut several = 0;
        for i in 0..all.t.len() {
            // What is drawn of each alone has the same errors.
            let there: Vec<usize> = (0..3).filter(|&k| alone[k].t[i].is_finite()).collect();
            several += usize::from(there.len() > 1);
            match there.first() {
                Some(&nearest) => assert_eq!(usize::from(all.surface[i]), nearest, "{sign} {i}: {there:?}"),
                None => assert!(!all.t[i].is_finite()),
            }
        }
        assert!(several > 100, "{several}");
    }
}

/// Smooth shading here and in `cellproj/cpu` differ by where light is interpolated, flat shading by textures alone.
#[test]
fn smooth_light_is_that_of_the_exact_method() {
    let data = synthetic("sphere,n=12,as=tets");
    let scene = (&data, &surfaces(&[1.0])[..], None);
    let exact = |shading| draw(&CELLPROJ_CPU, scene, &view(), knobs(&[("shading", shading)])).0;
    let paper = |shading| {
        draw(
            &CELLPROJ_CPU_PAPER,
            scene,
            &view(),
            knobs(&[("shading", shading), ("texture", "1024")]),
        )
        .0
    };
    let apart = |a: &Frame, b: &Frame| {
        let both = (0..a.t.len()).filter(|&i| a.t[i].is_finite() && b.t[i].is_finite());
        let d: Vec<f32> = both.map(|i| (a.rgba[i][0] - b.rgba[i][0]).abs()).collect();
        d.iter().sum::<f32>() / d.len() as f32
    };
    let (flat, smooth) = (exact("flat"), exact("smooth"));
    assert_eq!(
        (&flat.t, &flat.normal, &flat.claim),
        (&smooth.t, &smooth.normal, &smooth.claim)
    );
    assert!(apart(&flat, &paper("flat")) < 0.004, "{}", apart(&flat, &paper("flat")));
    assert!(
        apart(&smooth, &paper("smooth")) < 0.004,
        "{}",
        apart(&smooth, &paper("smooth"))
    );
    assert!(apart(&flat, &smooth) > 0.008, "{}", apart(&flat, &smooth));
    // Against the light of the sphere itself.
    let error = |f: &Frame| {
        let d: Vec<f64> = (0..f.t.len())
            .filter(|&i| f.t[i].is_finite())
            .map(|i| {
                let (ray, c) = (view().ray(i % 97, i / 97), Surface::COLOURS[0][0]);
                let light = f.point[i].normalize().dot(ray.direction).abs() as f32;
                f64::from((f.rgba[i][0] - c * (0.15 + 0.85 * light)).abs())
            })
            .collect();
        d.iter().sum::<f64>() / d.len() as f64
    };
    assert!(error(&smooth) * 4.0 < error(&flat), "{} {}", error(&smooth), error(&flat));
}

#[test]
fn what_cannot_be_drawn_is_said() {
    let data = synthetic("sphere,n=4,as=tets");
    let glass = [Surface {
        opacity: 0.5,
        ..Surface::isovalue(1.0, 0)
    }];
    let transfer = smooth_transfer();
    let view = view();
    let scene = Scene {
        data: &data,
        surfaces: &glass,
        medium: Some(&transfer),
        view: &view,
    };
    for (pairs, word) in [
        (&[("isosurface", "stencil")][..], "mixing=stopped"),
        (&[("mixing", "stopped"), ("volume", "stein")], "volume=table2d"),
        (&[("mixing", "stopped")], "mixing=smooth"),
    ] {
        let request = Request {
            knobs: knobs(pairs),
            ..Request::default()
        };
        let e = CELLPROJ_CPU_PAPER.supports(&scene, &request).unwrap_err().to_string();
        assert!(e.contains(word) && !e.contains('\n'), "{e}");
        let mut r = CELLPROJ_CPU_PAPER.open(&request).unwrap();
        r.set_data(&data).unwrap();
        r.set_medium(Some(&transfer)).unwrap();
        assert!(r.set_surfaces(&glass).unwrap_err().to_string().contains(word));
    }
    let layers = Request {
        layers: 2,
        ..Request::default()
    };
    assert!(CELLPROJ_CPU_PAPER.supports(&scene, &layers).is_err() && CELLPROJ_CPU_PAPER.open(&layers).is_err());
    assert!(CELLPROJ_CPU_PAPER.supports(&scene, &Request::default()).is_ok());
    // Eyes inside the mesh: cells across the eye plane are left out and counted; constant fields are ordinary.
    let inside = View::perspective(DVec3::new(0.1, 0.0, 0.05), DVec3::X, DVec3::Z, 60.0, 24, 16);
    let (_, counters, _) = draw(
        &CELLPROJ_CPU_PAPER,
        (&data, &glass, Some(&transfer)),
        &inside,
        Knobs::default(),
    );
    assert!(count(&counters, "left out") > 0);
    let Data::Tets(m) = &*data else { panic!("a mesh") };
    let constant = isobar_core::TetMesh::new(m.points.clone(), m.cells.clone(), vec![0.5; m.values.len()].into()).unwrap();
    let constant = Arc::new(Data::Tets(constant));
    let (frame, _, _) = draw(
        &CELLPROJ_CPU_PAPER,
        (&constant, &surfaces(&[0.5]), Some(&transfer)),
        &view,
        Knobs::default(),
    );
    assert!(frame.t.iter().all(|t| !t.is_nan()) && frame.rgba.iter().flatten().all(|v| v.is_finite()));
    assert!(matches!(view.camera, Camera::Orthographic { .. }));
}
