//! What is refused, what is remembered between calls, stopping, losing the device.

use super::{draw, open, random_grid, redraw, sampled};
use crate::march_gpu::renderer::MarchRenderer;
use crate::march_gpu::{INFO, MARCH_GPU};
use isobar_core::{
    Algebraic, Camera, Channels, ClipPlane, DVec3, Data, DataError, Frame, Grid, Knobs, Method, RenderError, Renderer, Request,
    Samples, Sampling, Scene, Stage, Stop, Surface, SurfaceKind, TransferFunction, Unsupported, View,
};
use isobar_fields::Kind;
use isobar_gpu::rays::Rectangle;
use isobar_gpu::{Gpu, test_adapter};
use std::sync::Arc;

fn noise() -> Arc<Data> {
    Arc::new(Data::Grid(random_grid([10, 11, 12], 3)))
}

fn zero() -> [Surface; 1] {
    [Surface::isovalue(0.0, 0)]
}

#[test]
fn nothing_is_drawn_before_everything_is_set() {
    if test_adapter("nothing_is_drawn_before_everything_is_set").is_none() {
        return;
    }
    let mut r = open(&MARCH_GPU, &Request::default());
    let not_ready = |r: &mut dyn Renderer| match r.render(&Stop::default()) {
        Err(RenderError::NotReady(what)) => what,
        other => panic!("{other:?}"),
    };
    let mut frame = Frame::default();
    assert!(matches!(r.read(&mut frame), Err(RenderError::NotReady("render"))));
    assert!(r.reconstruction(Stage::Stored).is_none());
    assert_eq!(not_ready(&mut *r), "set_data");
    r.set_data(&noise()).unwrap();
    assert_eq!(not_ready(&mut *r), "set_surfaces");
    r.set_surfaces(&zero()).unwrap();
    assert_eq!(not_ready(&mut *r), "set_view");
    r.set_view(&View::bench(8, 6)).unwrap();
    assert!(matches!(r.read(&mut frame), Err(RenderError::NotReady("render"))));
    r.render(&Stop::default()).unwrap();
    r.read(&mut frame).unwrap();
    r.set_surfaces(&zero()).unwrap();
    assert!(matches!(r.read(&mut frame), Err(RenderError::NotReady("render"))));
    assert_eq!(r.reconstruction(Stage::Stored).unwrap().name(), "trilinear");
}

#[test]
fn what_cannot_be_drawn_is_refused_and_what_was_set_is_kept() {
    if test_adapter("what_cannot_be_drawn_is_refused_and_what_was_set_is_kept").is_none() {
        return;
    }
    let data = noise();
    let view = View::fit(data.bounds(), 40.0, 20, 16);
    let mut r = open(&MARCH_GPU, &Request::default());
    let first = draw(&mut *r, &data, &zero(), &view);
    assert!(first.t.iter().any(|t| t.is_finite()));
    let algebraic = Arc::new(Data::Algebraic(Algebraic {
        name: "x".into(),
        terms: vec![([1, 0, 0], 1.0)].into(),
        lo: DVec3::ZERO,
        hi: DVec3::ONE,
    }));
    assert!(matches!(
        r.set_data(&algebraic),
        Err(RenderError::Unsupported(Unsupported::DataKind { .. }))
    ));
    let grid = |samples: Vec<f32>, dims| Arc::new(Data::Grid(Grid::unit(dims, Samples::F32(samples.into())).unwrap()));
    assert!(matches!(
        r.set_data(&grid(vec![0.0, f32::NAN, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [2; 3])),
        Err(RenderError::Data(DataError::NotFinite { count: 1, total: 8 }))
    ));
    assert!(matches!(
        r.set_data(&grid(vec![0.0; 9], [3, 3, 1])),
        Err(RenderError::Data(DataError::TooThin { .. }))
    ));
    assert!(matches!(
        r.set_data(&grid(vec![3e38, -3e38, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [2; 3])),
        Err(RenderError::Data(DataError::Unknown(_)))
    ));
    let boundary = Surface {
        kind: SurfaceKind::Boundary,
        ..zero()[0]
    };
    assert!(matches!(r.set_surfaces(&[boundary]), Err(RenderError::Unsupported(_))));
    assert!(matches!(
        r.set_surfaces(&[Surface::isovalue(f64::NAN, 0)]),
        Err(RenderError::Unsupported(_))
    ));
    let medium = TransferFunction {
        points: vec![],
        unit: 1.0,
    };
    assert!(matches!(r.set_medium(Some(&medium)), Err(RenderError::Unsupported(_))));
    r.set_medium(None).unwrap();
    for (w, h) in [(0, 4), (4, 0), (70_000, 1)] {
        assert!(matches!(r.set_view(&View::bench(w, h)), Err(RenderError::View(_))), "{w}x{h}");
    }
    let mut clipped = view.clone();
    clipped.clips.push(ClipPlane {
        normal: DVec3::X,
        distance: 0.0,
        cap: true,
    });
    assert!(matches!(r.set_view(&clipped), Err(RenderError::Unsupported(_))));
    assert!(matches!(
        r.set_knobs(&Knobs::default().with("step", 0)),
        Err(RenderError::Knob { .. })
    ));
    assert!(matches!(
        r.set_knobs(&Knobs::default().with("block", 8)),
        Err(RenderError::Knob { .. })
    ));
    // Nothing of this changed what is drawn.
    assert_eq!(redraw(&mut *r), first);
}

#[test]
fn supports_says_so_before_anything_is_built() {
    if test_adapter("supports_says_so_before_anything_is_built").is_none() {
        return;
    }
    let (data, view, surfaces) = (noise(), View::bench(4, 4), zero());
    let mut scene = Scene {
        data: &data,
        surfaces: &surfaces,
        medium: None,
        view: &view,
    };
    let plain = Request::default();
    MARCH_GPU.supports(&scene, &plain).unwrap();
    let frusta = Request {
        sampling: Sampling::PixelFrustum,
        ..Request::default()
    };
    assert!(matches!(
        MARCH_GPU.supports(&scene, &frusta),
        Err(Unsupported::Feature { .. })
    ));
    assert!(matches!(MARCH_GPU.open(&frusta), Err(RenderError::Unsupported(_))));
    let medium = TransferFunction {
        points: vec![],
        unit: 1.0,
    };
    scene.medium = Some(&medium);
    let e = MARCH_GPU.supports(&scene, &plain).unwrap_err().to_string();
    assert!(e.starts_with("march/gpu cannot do transfer functions"), "{e}");
    assert!(INFO.knobs.iter().any(|k| k.name == INFO.sweep.0));
}

#[test]
fn absurd_sizes_are_memory_errors() {
    if test_adapter("absurd_sizes_are_memory_errors").is_none() {
        return;
    }
    let data = noise();
    for (layers, w, h) in [
        (1, 16_384, 16_384),
        (1_000_000_000, 64, 64),
        (usize::MAX, 4, 4),
        (3_000_000, 1, 1),
    ] {
        let mut r = open(
            &MARCH_GPU,
            &Request {
                layers,
                ..Request::default()
            },
        );
        r.set_data(&data).unwrap();
        let view = View::bench(w, h);
        match r.set_view(&view) {
            Err(RenderError::Memory { bytes, limit, .. }) => assert!(bytes > limit),
            // 3 million layers of one pixel are 60 MB: fine where a binding holds them.
            other => assert!(other.is_ok() && layers == 3_000_000, "{layers} {w}x{h}: {other:?}"),
        }
    }
    // A device's longest texture side.
    let long = Gpu::shared().unwrap().report().max_texture_3d as usize + 1;
    let thin = Data::Grid(Grid::unit([long, 2, 2], Samples::U8(vec![0; long * 4].into())).unwrap());
    let mut r = open(&MARCH_GPU, &Request::default());
    assert!(matches!(
        r.set_data(&Arc::new(thin)),
        Err(RenderError::Memory { bytes, .. }) if bytes == long as u64
    ));
}

#[test]
fn an_isovalue_outside_the_range_gives_an_empty_frame() {
    if test_adapter("an_isovalue_outside_the_range_gives_an_empty_frame").is_none() {
        return;
    }
    let data = noise();
    let request = Request {
        channels: Channels::all(),
        ..Request::default()
    };
    let view = View::fit(data.bounds(), 40.0, 9, 7);
    let mut r = open(&MARCH_GPU, &request);
    let outside = [Surface::isovalue(5.0, 0), Surface::isovalue(-1e300, 1)];
    let f = draw(&mut *r, &data, &outside, &view);
    assert_eq!(f, Frame::new(9, 7, 1, Channels::all()));
    let mut invisible = zero();
    invisible[0].opacity = 0.0;
    r.set_surfaces(&invisible).unwrap();
    assert_eq!(redraw(&mut *r), f);
    r.set_surfaces(&[]).unwrap();
    assert_eq!(redraw(&mut *r), f);
    r.set_surfaces(&zero()).unwrap();
    assert_ne!(redraw(&mut *r), f);
    // A view that misses the domain altogether.
    let away = View::perspective(DVec3::splat(100.0), DVec3::splat(200.0), DVec3::Z, 40.0, 9, 7);
    r.set_view(&away).unwrap();
    assert_eq!(redraw(&mut *r), f);
}

/// Each change alone gives the frame of a renderer opened for it.
#[test]
fn every_change_gives_the_frame_of_a_fresh_renderer() {
    if test_adapter("every_change_gives_the_frame_of_a_fresh_renderer").is_none() {
        return;
    }
    let request = |knobs: &Knobs| Request {
        channels: Channels::all(),
        layers: 2,
        knobs: knobs.clone(),
        ..Request::default()
    };
    let bytes = Arc::new(Data::Grid(random_grid([10, 11, 12], 0)));
    let floats = noise();
    let moved = match &*floats {
        Data::Grid(g) => Arc::new(Data::Grid(Grid {
            origin: DVec3::new(1.0, 2.0, -1.0),
            ..g.clone()
        })),
        _ => unreachable!("noise is a grid"),
    };
    let near = View::fit(floats.bounds(), 40.0, 33, 21);
    let wide = View::fit_from(floats.bounds(), DVec3::new(-1.0, 2.0, 0.5), DVec3::Z, 60.0, 600, 110);
    let rays = View::rays((0..50).map(|i| near.ray(i % 33, i / 3)).collect::<Vec<_>>());
    let ortho = View {
        camera: Camera::Orthographic {
            eye: DVec3::new(-9.0, 5.0, 5.0),
            target: DVec3::splat(5.0),
            up: DVec3::Z,
            height: 12.0,
        },
        ..near.clone()
    };
    let plain = Knobs::default();
    let mut r = open(&MARCH_GPU, &request(&plain));
    draw(&mut *r, &floats, &zero(), &near);
    let (mut data, mut iso, mut view, mut knobs) = (&floats, 0.0, &near, plain.clone());
    let cubic = plain.clone().with("reconstruction", "cubic-interpolating");
    let coarse = plain.clone().with("step", 2).with("filter", "bits8");
    for change in 0..12 {
        match change {
            0 => view = &wide,
            1 => iso = 0.3,
            2 => (data, iso) = (&bytes, 99.5),
            3 => knobs = cubic.clone(),
            4 => view = &rays,
            5 => (data, iso) = (&moved, 0.1),
            6 => knobs = coarse.clone(),
            7 => view = &ortho,
            8 => knobs = plain.clone().with("skip", "off"),
            9 => data = &floats,
            10 => knobs = plain.clone().with("reconstruction", "quadratic"),
            _ => view = &near,
        }
        let surfaces = [Surface::isovalue(iso, 0)];
        match change {
            0 | 4 | 7 | 11 => r.set_view(view).unwrap(),
            3 | 6 | 8 | 10 => r.set_knobs(&knobs).unwrap(),
            1 => r.set_surfaces(&surfaces).unwrap(),
            _ => {
                r.set_surfaces(&surfaces).unwrap();
                r.set_data(data).unwrap();
            }
        }
        let got = redraw(&mut *r);
        let want = draw(&mut *open(&MARCH_GPU, &request(&knobs)), data, &surfaces, view);
        assert!(want.hits.iter().any(|h| *h > 0), "change {change} hits nothing");
        assert_eq!(got, want, "change {change}");
    }
}

#[test]
fn times_memory_and_counters_are_told() {
    let Some(gpu) = test_adapter("times_memory_and_counters_are_told") else {
        return;
    };
    let data = Arc::new(Data::Grid(random_grid([40, 41, 42], 0)));
    let request = Request {
        channels: Channels::T | Channels::WORK,
        ..Request::default()
    };
    let mut r = open(&MARCH_GPU, &request);
    let view = View::fit(data.bounds(), 40.0, 120, 100);
    r.set_data(&data).unwrap();
    r.set_surfaces(&[Surface::isovalue(127.5, 0)]).unwrap();
    r.set_view(&view).unwrap();
    let time = r.render(&Stop::default()).unwrap();
    assert_eq!(time.device.is_some(), gpu.report().timestamps);
    if let Some(device) = time.device {
        assert!(!device.is_zero() && device <= time.wall, "{time:?}");
    }
    let mut frame = Frame::default();
    r.read(&mut frame).unwrap();
    let work: u64 = frame.work.iter().map(|w| u64::from(*w)).sum();
    assert_eq!(r.counters().0, [("samples", work)]);
    let m = r.memory();
    // Bytes stay bytes; rays, one layer of hits and pixels: 76 bytes a pixel that may see the volume.
    let Data::Grid(grid) = &*data else { panic!("a grid") };
    let seen = Rectangle::of(&view, &grid.domain());
    let (texels, pixels) = (40 * 41 * 42, (seen.width * seen.height) as u64);
    assert!(pixels < 120 * 100);
    assert!(
        m.device > texels + 76 * pixels && m.device < texels * 5 / 4 + 76 * pixels + 16_384,
        "{m:?}"
    );
    assert_eq!((m.coefficients, m.view), (0, 16 * pixels));
    r.set_knobs(&Knobs::default().with("reconstruction", Kind::CubicInterpolating))
        .unwrap();
    assert_eq!(r.memory().coefficients, texels * 4);
}

#[test]
fn stop_ends_it_and_progress_is_told() {
    if test_adapter("stop_ends_it_and_progress_is_told").is_none() {
        return;
    }
    let data = noise();
    let mut r = open(&MARCH_GPU, &Request::default());
    let view = View::fit(data.bounds(), 40.0, 400, 300);
    let stop = Stop::default();
    draw(&mut *r, &data, &zero(), &view);
    r.render(&stop).unwrap();
    assert_eq!(stop.progress(), (2, 2));
    stop.raise();
    assert!(matches!(r.render(&stop), Err(RenderError::Stopped)));
    assert!(matches!(r.read(&mut Frame::default()), Err(RenderError::NotReady("render"))));
}

#[test]
fn a_lost_device_is_an_error_and_a_new_renderer_works() {
    let Some(shared) = test_adapter("a_lost_device_is_an_error_and_a_new_renderer_works") else {
        return;
    };
    let own = Gpu::open_named(Some(&shared.report().name)).unwrap();
    let data = Arc::new(Data::Grid(sampled([8; 3], |x, y, z| x + y + z)));
    let surfaces = [Surface::isovalue(10.0, 0)];
    let view = View::fit(data.bounds(), 40.0, 16, 16);
    let mut r = MarchRenderer::new(own.clone(), &Request::default()).unwrap();
    draw(&mut r, &data, &surfaces, &view);
    own.device().destroy();
    // The loss is told by the driver's callback, which runs when the device is next asked.
    assert!(own.wait().is_err());
    let device = |e: Result<(), RenderError>| assert!(matches!(e, Err(RenderError::Device(_))), "{e:?}");
    device(r.render(&Stop::default()).map(|_| ()));
    device(r.set_data(&data));
    device(r.set_view(&view));
    device(MarchRenderer::new(own, &Request::default()).map(|_| ()));
    draw(&mut *open(&MARCH_GPU, &Request::default()), &data, &surfaces, &view);
}
