//! Tests at the level of the method.

use crate::MC_CPU;
use crate::testing::{draw, isovalues, rays, ready, request, sampled};
use isobar_core::{
    Channels, DMat3, DVec3, Data, DataError, Frame, Grid, Knobs, Method, NO_SURFACE, Ray, RenderError, Request, Samples, Scene,
    Stage, Stop, View,
};
use std::sync::Arc;

fn knobs() -> Knobs {
    Knobs::default()
}

/// hardcases B14: a plane is its own mesh; vertices are rounded to 2^-24 of an edge.
#[test]
fn planes_are_exact_to_the_rounding_of_vertices() {
    let normal = DVec3::new(0.5, -0.25, 1.0);
    let data = sampled(25, |x| normal.dot(x));
    let rays = rays(3, 400, 12.0);
    for subdivide in [1, 2, 4] {
        for normals in ["gradient", "face"] {
            let k = knobs().with("subdivide", subdivide).with("normals", normals);
            let f = draw(&MC_CPU, &data, &isovalues(&[0.375]), &View::rays(rays.clone()), &request(k));
            let mut seen = 0;
            for (i, r) in rays.iter().enumerate() {
                let t = (0.375 - normal.dot(r.origin)) / normal.dot(r.direction);
                if t < 0.1 || r.at(t).abs().max_element() > 11.9 {
                    continue;
                }
                assert!((f.t[i] - t).abs() < 1e-5, "{} for {t}", f.t[i]);
                let n = DVec3::from_array(f.normal[i].map(f64::from));
                let tolerance = if normals == "face" { 1e-4 } else { 1e-6 };
                assert!((n - normal.normalize()).length() < tolerance, "{normals}: normal {n}");
                assert_eq!(f.hits[i], 1);
                seen += 1;
            }
            assert!(seen > 100);
        }
    }
}

/// The mesh comes nearer to the trilinear surface with the square of the cells.
#[test]
fn subdivision_brings_the_trilinear_surface_nearer() {
    let data = sampled(17, |x| (0.9 * x.x).sin() + (0.8 * x.y).cos() * (0.7 * x.z).sin());
    let view = View::fit(data.bounds(), 30.0, 64, 48);
    let surfaces = isovalues(&[0.3]);
    let exact = draw(
        &crate::MARCH_CPU,
        &data,
        &surfaces,
        &view,
        &request(knobs().with("bisections", 40).with("step", 0.05)),
    );
    let median = |subdivide: usize| {
        let f = draw(
            &MC_CPU,
            &data,
            &surfaces,
            &view,
            &request(knobs().with("subdivide", subdivide)),
        );
        let pairs = f.t.iter().zip(&exact.t).filter(|(a, b)| a.is_finite() && b.is_finite());
        let mut e: Vec<f64> = pairs.map(|(a, b)| (a - b).abs()).collect();
        assert!(e.len() > 500);
        e.sort_by(f64::total_cmp);
        e[e.len() / 2]
    };
    let (one, two, four) = (median(1), median(2), median(4));
    assert!(
        one > 1e-3 && (2.8..5.6).contains(&(one / two)) && (2.8..5.6).contains(&(two / four)),
        "{one} {two} {four}"
    );
}

/// hardcases B5 and B6: a surface that is a point has no triangles with an area; half way there is an octahedron.
#[test]
fn an_isovalue_equal_to_a_sample_gives_no_false_hit() {
    let data = sampled(3, |x| if x == DVec3::ZERO { 1.0 } else { 0.0 });
    let ray = |d: DVec3| Ray {
        origin: -d * 4.0,
        direction: d,
    };
    let view = View::rays(vec![
        ray(DVec3::X),
        ray(DVec3::ONE.normalize()),
        ray(DVec3::new(0.3, 0.2, 0.9).normalize()),
    ]);
    let f = draw(&MC_CPU, &data, &isovalues(&[1.0]), &view, &request(knobs()));
    assert!(
        f.surface.iter().all(|s| *s == NO_SURFACE),
        "the tangential hit is missed, as documented: {:?}",
        f.t
    );
    let f = draw(&MC_CPU, &data, &isovalues(&[0.5]), &view, &request(knobs()));
    assert!((f.t[0] - 3.5).abs() < 1e-9 && f.hits == [2, 2, 2], "{:?} {:?}", f.t, f.hits);
}

/// Layers, opacity and order; a surface of opacity 0 is not there. One nearest hit is the first of all hits.
#[test]
fn layers_come_front_to_back_each_root_once() {
    let data = sampled(17, |x| x.length());
    let mut surfaces = isovalues(&[3.0, 5.0, 6.0]);
    surfaces[1].opacity = 0.0;
    surfaces[2].opacity = 0.5;
    let view = View::rays(
        [DVec3::X, DVec3::Y, DVec3::new(0.6, 0.8, 0.0), DVec3::ONE.normalize()]
            .map(|d| Ray {
                origin: d * -7.5,
                direction: d,
            })
            .to_vec(),
    );
    let r = Request {
        layers: 5,
        ..request(knobs())
    };
    let all = draw(&MC_CPU, &data, &surfaces, &view, &r);
    for p in 0..4 {
        let column: Vec<u8> = (0..5).map(|l| all.surface[l * 4 + p]).collect();
        assert_eq!(
            (column, all.hits[p]),
            (vec![2, 0, 0, 2, NO_SURFACE], 4),
            "along edges and vertices too"
        );
        assert!((0..3).all(|l| all.t[l * 4 + p] < all.t[(l + 1) * 4 + p]));
        assert!(all.rgba[p][3] >= 1.0);
    }
    let one = Request {
        channels: Channels::T | Channels::SURFACE,
        ..request(knobs())
    };
    let first = draw(&MC_CPU, &data, &surfaces, &view, &one);
    assert_eq!(first.t[..], all.t[..4]);
}

/// Threads change nothing; sample types, oblique axes and odd image sizes are drawn.
#[test]
fn the_frame_does_not_depend_on_the_threads() {
    let values = |i: usize| {
        ((i % 21) as f64 * 0.4).sin() * 60.0 + ((i / 21 % 19) as f64 * 0.5).cos() * 40.0 + (i / 399) as f64 * 3.0 + 80.0
    };
    let n = 21 * 19 * 35;
    let all = [
        Samples::U8((0..n).map(|i| values(i).clamp(0.0, 255.0) as u8).collect()),
        Samples::I16((0..n).map(|i| values(i) as i16).collect()),
        Samples::U16((0..n).map(|i| values(i).max(0.0) as u16).collect()),
        Samples::F32((0..n).map(|i| values(i) as f32).collect()),
    ];
    for samples in all {
        let axes = DMat3::from_rotation_y(0.4) * DMat3::from_rotation_z(1.0);
        let grid = Grid::new(
            [21, 19, 35],
            DVec3::new(1.0, 2.0, 0.5),
            DVec3::new(5.0, -3.0, 0.0),
            axes,
            samples,
        )
        .expect("a good grid");
        let data = Arc::new(Data::Grid(grid));
        let view = View::fit(data.bounds(), 35.0, 83, 37);
        let surfaces = isovalues(&[90.5, 60.25]);
        let with = |threads: usize| {
            let r = Request {
                threads,
                layers: 2,
                ..request(knobs())
            };
            draw(&MC_CPU, &data, &surfaces, &view, &r)
        };
        let one = with(1);
        assert!(one.t.iter().filter(|t| t.is_finite()).count() > 200);
        assert_eq!(one, with(2));
    }
}

#[test]
fn calls_out_of_order_are_errors_and_any_order_is_good() {
    let data = sampled(5, |x| x.x);
    let mut r = MC_CPU.open(&request(knobs())).expect("a good request");
    let mut f = Frame::default();
    assert_eq!(r.read(&mut f), Err(RenderError::NotReady("render")));
    assert_eq!(r.render(&Stop::default()), Err(RenderError::NotReady("set_data")));
    r.set_view(&View::bench(4, 4)).expect("good");
    r.set_data(&data).expect("good");
    assert_eq!(r.render(&Stop::default()), Err(RenderError::NotReady("set_surfaces")));
    r.set_surfaces(&isovalues(&[0.5])).expect("good");
    let stop = Stop::default();
    stop.raise();
    assert_eq!(r.render(&stop), Err(RenderError::Stopped));
    assert_eq!(r.read(&mut f), Err(RenderError::NotReady("render")));
    r.render(&Stop::default()).expect("everything is set");
    r.read(&mut f).expect("drawn");
    // surfaces before data
    let mut other = MC_CPU.open(&request(knobs())).expect("a good request");
    other.set_surfaces(&isovalues(&[0.5])).expect("good");
    other.set_data(&data).expect("good");
    other.set_view(&View::bench(4, 4)).expect("good");
    other.render(&Stop::default()).expect("everything is set");
    let mut g = Frame::default();
    other.read(&mut g).expect("drawn");
    assert_eq!(f, g);
}

#[test]
fn the_mesh_is_rebuilt_only_where_it_must() {
    let data = sampled(17, |x| x.length());
    let mut r = ready(&MC_CPU, &data, &isovalues(&[5.0]), &View::bench(8, 8), &request(knobs()));
    let m = r.memory();
    assert!(m.index > 0 && m.coefficients == 0);
    r.set_knobs(&knobs().with("normals", "face")).expect("a choice");
    assert_eq!(r.memory(), m);
    r.set_knobs(&knobs().with("subdivide", 2)).expect("a choice");
    let finer = r.memory().index as f64 / m.index as f64;
    assert!((3.0..5.5).contains(&finer), "{finer} times the triangles");
    r.set_surfaces(&isovalues(&[50.0])).expect("outside the range");
    assert_eq!(r.memory().index, 0);
    r.render(&Stop::default()).expect("an empty image");
    assert_eq!(r.counters().0, [("triangle tests", 0), ("triangles", 0)]);
    assert_eq!(r.reconstruction(Stage::Ideal).map(|f| f.name()), Some("trilinear".into()));
    assert!(matches!(
        r.set_knobs(&knobs().with("subdivide", 3)),
        Err(RenderError::Knob { .. })
    ));
    assert!(matches!(
        r.set_knobs(&knobs().with("reconstruction", "cubic")),
        Err(RenderError::Knob { .. })
    ));
}

#[test]
fn unusable_data_are_refused() {
    let mut r = MC_CPU.open(&request(knobs())).expect("a good request");
    let nan = sampled(5, |x| if x.x == 2.0 { f64::NAN } else { 0.0 });
    assert!(matches!(
        r.set_data(&nan),
        Err(RenderError::Data(DataError::NotFinite { .. }))
    ));
    let thin = Grid::unit([4, 1, 4], Samples::U8(vec![0; 16].into())).expect("a grid");
    assert!(matches!(
        r.set_data(&Arc::new(Data::Grid(thin))),
        Err(RenderError::Data(DataError::TooThin { .. }))
    ));
    let polynomial = Arc::new(Data::Algebraic(isobar_core::Algebraic {
        name: "x".into(),
        terms: vec![([1, 0, 0], 1.0)].into(),
        lo: DVec3::NEG_ONE,
        hi: DVec3::ONE,
    }));
    assert!(r.set_data(&polynomial).is_err());
    let view = View::bench(4, 4);
    let scene = Scene {
        data: &polynomial,
        surfaces: &[],
        medium: None,
        view: &view,
    };
    let e = MC_CPU
        .supports(&scene, &request(knobs()))
        .expect_err("not a grid")
        .to_string();
    assert_eq!(e, "mc/cpu draws grid, not algebraic");
}
