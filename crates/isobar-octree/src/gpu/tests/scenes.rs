//! What is refused, what is remembered between calls, stopping, losing the device.

use super::*;
use crate::gpu::renderer::OctreeRenderer;
use crate::gpu::{INFO, OCTREE_GPU};
use isobar_core::{Algebraic, Camera, ClipPlane, DataError, RenderError, Sampling, SurfaceKind, TransferFunction, Unsupported};
use isobar_gpu::Gpu;

fn noise() -> Arc<Data> {
    Arc::new(Data::Grid(random_grid([10, 11, 12], 3)))
}

fn zero() -> [Surface; 1] {
    [Surface::isovalue(0.0, 0)]
}

#[test]
fn what_cannot_be_drawn_is_refused_and_what_was_set_is_kept() {
    let Some(_gpu) = adapter("what_cannot_be_drawn_is_refused_and_what_was_set_is_kept") else {
        return;
    };
    let data = noise();
    let view = View::fit(data.bounds(), 40.0, 20, 16);
    let mut r = open(&OCTREE_GPU, &Request::default());
    assert!(matches!(r.read(&mut Frame::default()), Err(RenderError::NotReady("render"))));
    assert!(matches!(r.render(&Stop::default()), Err(RenderError::NotReady("set_data"))));
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
    let long = Gpu::shared().unwrap().report().max_texture_3d as usize + 1;
    let thin = Data::Grid(Grid::unit([long, 2, 2], Samples::U8(vec![0; long * 4].into())).unwrap());
    assert!(matches!(
        r.set_data(&Arc::new(thin)),
        Err(RenderError::Memory { bytes, .. }) if bytes == long as u64
    ));
    let boundary = Surface {
        kind: SurfaceKind::Boundary,
        ..zero()[0]
    };
    assert!(matches!(r.set_surfaces(&[boundary]), Err(RenderError::Unsupported(_))));
    assert!(r.set_surfaces(&[Surface::isovalue(f64::NAN, 0)]).is_err());
    let medium = TransferFunction {
        points: vec![],
        unit: 1.0,
    };
    assert!(matches!(r.set_medium(Some(&medium)), Err(RenderError::Unsupported(_))));
    r.set_medium(None).unwrap();
    for (w, h) in [(0, 4), (4, 0), (70_000, 1)] {
        assert!(matches!(r.set_view(&View::bench(w, h)), Err(RenderError::View(_))), "{w}x{h}");
    }
    let mut capped = view.clone();
    capped.clips.push(ClipPlane {
        normal: DVec3::X,
        distance: 0.0,
        cap: true,
    });
    assert!(matches!(r.set_view(&capped), Err(RenderError::Unsupported(_))));
    for bad in [("claims", "on"), ("loops", "no"), ("block", "8"), ("reconstruction", "type6")] {
        assert!(
            matches!(
                r.set_knobs(&Knobs::default().with(bad.0, bad.1)),
                Err(RenderError::Knob { .. })
            ),
            "{bad:?}"
        );
    }
    // Nothing of this changed what is drawn.
    assert_eq!(redraw(&mut *r), first);
    let frusta = Request {
        sampling: Sampling::PixelFrustum,
        ..Request::default()
    };
    assert!(matches!(OCTREE_GPU.open(&frusta), Err(RenderError::Unsupported(_))));
    assert!(INFO.gpu && INFO.id == "octree/gpu");
}

#[test]
fn absurd_sizes_are_memory_errors() {
    let Some(_gpu) = adapter("absurd_sizes_are_memory_errors") else {
        return;
    };
    let data = noise();
    for (layers, w, h) in [(1, 16_384, 16_384), (1_000_000_000, 64, 64), (usize::MAX, 4, 4)] {
        let mut r = open(
            &OCTREE_GPU,
            &Request {
                layers,
                ..Request::default()
            },
        );
        r.set_data(&data).unwrap();
        let view = View::fit(data.bounds(), 20.0, w, h);
        match r.set_view(&view) {
            Err(RenderError::Memory { bytes, limit, .. }) => assert!(bytes > limit),
            other => panic!("{layers} {w}x{h}: {other:?}"),
        }
    }
}

#[test]
fn an_isovalue_outside_the_range_gives_an_empty_frame() {
    let Some(_gpu) = adapter("an_isovalue_outside_the_range_gives_an_empty_frame") else {
        return;
    };
    let data = noise();
    let view = View::fit(data.bounds(), 40.0, 9, 7);
    let mut r = open(&OCTREE_GPU, &request(1, Knobs::default()));
    let outside = [Surface::isovalue(5.0, 0), Surface::isovalue(-1e300, 1)];
    let f = draw(&mut *r, &data, &outside, &view);
    assert_eq!(f, Frame::new(9, 7, 1, Channels::all()));
    r.set_surfaces(&[]).unwrap();
    assert_eq!(redraw(&mut *r), f);
    r.set_surfaces(&zero()).unwrap();
    assert_ne!(redraw(&mut *r), f);
    // A view that misses the domain altogether.
    let away = View::perspective(DVec3::splat(100.0), DVec3::splat(200.0), DVec3::Z, 40.0, 9, 7);
    r.set_view(&away).unwrap();
    assert_eq!(redraw(&mut *r), f);
    let beside = View::perspective(DVec3::splat(100.0), DVec3::new(0.0, 100.0, 900.0), DVec3::Z, 10.0, 9, 7);
    r.set_view(&beside).unwrap();
    assert_eq!(redraw(&mut *r), f);
}

/// Each change alone gives the frame of a renderer opened for it.
#[test]
fn every_change_gives_the_frame_of_a_fresh_renderer() {
    let Some(_gpu) = adapter("every_change_gives_the_frame_of_a_fresh_renderer") else {
        return;
    };
    let bytes = Arc::new(Data::Grid(random_grid([10, 11, 12], 0)));
    let floats = noise();
    let Data::Grid(g) = &*floats else {
        unreachable!("noise is a grid")
    };
    let moved = Arc::new(Data::Grid(Grid {
        origin: DVec3::new(1.0, 2.0, -1.0),
        ..g.clone()
    }));
    let near = View::fit(floats.bounds(), 40.0, 33, 21);
    let wide = View::fit_from(floats.bounds(), DVec3::new(-1.0, 2.0, 0.5), DVec3::Z, 60.0, 300, 60);
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
    let mut r = open(&OCTREE_GPU, &request(2, plain.clone()));
    draw(&mut *r, &floats, &zero(), &near);
    let (mut data, mut iso, mut view, mut set) = (&floats, 0.0, &near, plain.clone());
    let cubic = knobs(Kind::CubicInterpolating);
    for change in 0..10 {
        match change {
            0 => view = &wide,
            1 => iso = 0.3,
            2 => (data, iso) = (&bytes, 99.5),
            3 => set = cubic.clone(),
            4 => view = &rays,
            5 => (data, iso) = (&moved, 0.1),
            6 => view = &ortho,
            7 => set = plain.clone(),
            8 => data = &floats,
            _ => set = knobs(Kind::Quadratic),
        }
        let surfaces = [Surface::isovalue(iso, 0)];
        match change {
            0 | 4 | 6 => r.set_view(view).unwrap(),
            3 | 7 | 9 => r.set_knobs(&set).unwrap(),
            1 => r.set_surfaces(&surfaces).unwrap(),
            _ => {
                r.set_surfaces(&surfaces).unwrap();
                r.set_data(data).unwrap();
            }
        }
        let got = redraw(&mut *r);
        let want = draw(&mut *open(&OCTREE_GPU, &request(2, set.clone())), data, &surfaces, view);
        assert!(want.hits.iter().any(|h| *h > 0), "change {change} hits nothing");
        assert_eq!(got, want, "change {change}");
    }
}

#[test]
fn times_memory_and_counters_are_told_and_stop_ends_it() {
    let Some(gpu) = adapter("times_memory_and_counters_are_told_and_stop_ends_it") else {
        return;
    };
    let data = Arc::new(Data::Grid(random_grid([40, 41, 42], 0)));
    let mut r = open(
        &OCTREE_GPU,
        &Request {
            channels: Channels::T | Channels::WORK,
            ..Request::default()
        },
    );
    // The cube fills the middle of a wide image only.
    let view = View::fit(data.bounds(), 40.0, 900, 100);
    r.set_data(&data).unwrap();
    r.set_surfaces(&[Surface::isovalue(127.5, 0)]).unwrap();
    r.set_view(&view).unwrap();
    let stop = Stop::default();
    let time = r.render(&stop).unwrap();
    assert_eq!(time.device.is_some(), gpu.0.report().timestamps);
    if let Some(device) = time.device {
        assert!(!device.is_zero() && device <= time.wall, "{time:?}");
    }
    let (done, of) = stop.progress();
    assert!(done == of && of >= 1);
    let mut frame = Frame::default();
    r.read(&mut frame).unwrap();
    let work: u64 = frame.work.iter().map(|w| u64::from(*w)).sum();
    let counters = r.counters();
    assert_eq!(counters.0[0], ("cells", work));
    let (name, launched) = counters.0[2];
    assert!(name == "pixels launched" && launched < 900 * 100 / 4, "{counters:?}");
    let m = r.memory();
    // Bytes stay bytes; rays, one layer of hits and pixels: 96 bytes a pixel; 8 bytes of active cells per brick.
    let texels = 40 * 41 * 42;
    assert!(
        m.device > texels + 96 * launched && m.device < texels * 5 / 4 + 96 * launched + 24_000,
        "{m:?}"
    );
    assert_eq!((m.coefficients, m.index, m.view), (0, 8 * 10 * 10 * 11, 16 * launched));
    stop.raise();
    assert!(matches!(r.render(&stop), Err(RenderError::Stopped)));
    assert!(matches!(r.read(&mut frame), Err(RenderError::NotReady("render"))));
}

#[test]
fn a_lost_device_is_an_error_and_a_new_renderer_works() {
    let Some(shared) = adapter("a_lost_device_is_an_error_and_a_new_renderer_works") else {
        return;
    };
    let own = Gpu::open_named(Some(&shared.0.report().name)).unwrap();
    let data = Arc::new(Data::Grid(sampled([8; 3], |x, y, z| x + y + z)));
    let surfaces = [Surface::isovalue(10.0, 0)];
    let view = View::fit(data.bounds(), 40.0, 16, 16);
    let mut r = OctreeRenderer::new(own.clone(), &Request::default()).unwrap();
    draw(&mut r, &data, &surfaces, &view);
    own.device().destroy();
    // The loss is told by the driver's callback, which runs when the device is next asked.
    assert!(own.wait().is_err());
    let device = |e: Result<(), RenderError>| assert!(matches!(e, Err(RenderError::Device(_))), "{e:?}");
    device(r.render(&Stop::default()).map(|_| ()));
    device(r.set_data(&data));
    device(r.set_view(&view));
    device(OctreeRenderer::new(own, &Request::default()).map(|_| ()));
    draw(&mut *open(&OCTREE_GPU, &Request::default()), &data, &surfaces, &view);
}
