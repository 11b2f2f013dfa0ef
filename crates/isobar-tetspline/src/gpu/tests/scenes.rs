//! What is refused, what is remembered between calls, stopping, losing the device.

use super::*;
use crate::gpu::lists::Limits;
use crate::gpu::renderer::TetsplineRenderer;
use crate::gpu::{INFO, TETSPLINE_GPU};
use isobar_core::{Algebraic, Camera, DataError, RenderError, Sampling, SurfaceKind, TransferFunction, Unsupported};

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
    let mut r = open(&TETSPLINE_GPU, &Request::default());
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
    let boundary = Surface {
        kind: SurfaceKind::Boundary,
        ..zero()[0]
    };
    assert!(matches!(r.set_surfaces(&[boundary]), Err(RenderError::Unsupported(_))));
    let medium = TransferFunction {
        points: vec![],
        unit: 1.0,
    };
    assert!(matches!(r.set_medium(Some(&medium)), Err(RenderError::Unsupported(_))));
    r.set_medium(None).unwrap();
    assert!(matches!(r.set_view(&View::bench(0, 4)), Err(RenderError::View(_))));
    assert!(matches!(
        r.set_view(&View::rays(vec![view.ray(3, 3)])),
        Err(RenderError::Unsupported(Unsupported::Feature { .. }))
    ));
    for bad in [
        ("claims", "on"),
        ("roots", "certified"),
        ("rays", "7"),
        ("cull", "maybe"),
        ("coefficients", "stored"),
    ] {
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
    assert!(matches!(TETSPLINE_GPU.open(&frusta), Err(RenderError::Unsupported(_))));
    assert!(INFO.gpu && INFO.id == "tetspline/gpu");
}

/// Each change alone gives the frame of a renderer opened for it; a time step on the same lattice keeps the device's memory (K25).
#[test]
fn every_change_gives_the_frame_of_a_fresh_renderer() {
    let Some(_gpu) = adapter("every_change_gives_the_frame_of_a_fresh_renderer") else {
        return;
    };
    let bytes = Arc::new(Data::Grid(random_grid([10, 11, 12], 0)));
    let floats = noise();
    let mut other = random_grid([10, 11, 12], 4);
    other.origin = DVec3::ZERO;
    let step = Arc::new(Data::Grid(other));
    let near = View::fit(floats.bounds(), 40.0, 33, 21);
    let wide = View::fit_from(floats.bounds(), DVec3::new(-1.0, 2.0, 0.5), DVec3::Z, 60.0, 200, 40);
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
    let stored = Knobs::default().with("coefficients", "determining-set");
    let filtered = Knobs::default()
        .with("reconstruction", "type6-prefiltered")
        .with("rays", "interpolated");
    let mut r = open(&TETSPLINE_GPU, &first_hits(plain.clone()));
    draw(&mut *r, &floats, &zero(), &near);
    let (mut data, mut iso, mut view, mut set) = (&floats, 0.0, &near, plain.clone());
    for change in 0..9 {
        match change {
            0 => view = &wide,
            1 => iso = 0.3,
            2 => (data, iso) = (&bytes, 99.5),
            3 => set = stored.clone(),
            4 => view = &ortho,
            5 => (data, iso) = (&floats, 0.1),
            6 => data = &step,
            7 => set = filtered.clone(),
            _ => set = plain.clone(),
        }
        let surfaces = [Surface::isovalue(iso, 0)];
        let before = r.memory().device;
        match change {
            0 | 4 => r.set_view(view).unwrap(),
            3 | 7 | 8 => r.set_knobs(&set).unwrap(),
            1 => r.set_surfaces(&surfaces).unwrap(),
            _ => {
                r.set_surfaces(&surfaces).unwrap();
                r.set_data(data).unwrap();
            }
        }
        let got = redraw(&mut *r);
        let want = draw(&mut *open(&TETSPLINE_GPU, &first_hits(set.clone())), data, &surfaces, view);
        assert!(want.t.iter().any(|t| t.is_finite()), "change {change} hits nothing");
        assert_eq!(got, want, "change {change}");
        if change == 6 {
            assert_eq!(r.memory().device, before);
        }
    }
}

#[test]
fn counters_and_memory_are_told_and_stop_ends_it() {
    let Some((gpu, _guard)) = adapter("counters_and_memory_are_told_and_stop_ends_it") else {
        return;
    };
    let data = Arc::new(Data::Grid(random_grid([20, 21, 22], 0)));
    let mut r = open(
        &TETSPLINE_GPU,
        &Request {
            channels: Channels::T | Channels::WORK,
            ..Request::default()
        },
    );
    let view = View::fit(data.bounds(), 40.0, 90, 60);
    r.set_data(&data).unwrap();
    r.set_surfaces(&[Surface::isovalue(127.5, 0)]).unwrap();
    r.set_view(&view).unwrap();
    let stop = Stop::default();
    let time = r.render(&stop).unwrap();
    assert_eq!(time.device.is_some(), gpu.report().timestamps);
    let mut frame = Frame::default();
    r.read(&mut frame).unwrap();
    let counters = r.counters();
    let of = |name: &str| counters.0.iter().find(|(n, _)| *n == name).unwrap().1;
    let work: u64 = frame.work.iter().map(|w| u64::from(*w)).sum();
    assert_eq!(of("fragments"), work);
    assert!(
        work > 1000 && of("active tetrahedra") > 10 * of("active cubes") / 4,
        "{counters:?}"
    );
    assert_eq!(of("bytes of T_active"), 4 * of("active tetrahedra"));
    assert!(of("bytes of determining sets") == 0 && of("parts") == 1);
    r.set_knobs(&Knobs::default().with("coefficients", "determining-set"))
        .unwrap();
    r.render(&stop).unwrap();
    let counters = r.counters();
    let of = |name: &str| counters.0.iter().find(|(n, _)| *n == name).unwrap().1;
    assert_eq!(of("bytes of determining sets"), 224 * of("active cubes"));
    assert!(r.memory().device > 224 * of("active cubes"));
    stop.raise();
    assert!(matches!(r.render(&stop), Err(RenderError::Stopped)));
    assert!(matches!(r.read(&mut frame), Err(RenderError::NotReady("render"))));
}

#[test]
fn a_lost_device_is_an_error_and_a_new_renderer_works() {
    let Some((gpu, _guard)) = adapter("a_lost_device_is_an_error_and_a_new_renderer_works") else {
        return;
    };
    let own = Gpu::open_named(Some(&gpu.report().name)).unwrap();
    let data = noise();
    let view = View::fit(data.bounds(), 40.0, 16, 16);
    let limits = Limits::new(&own);
    let mut r = TetsplineRenderer::new(own.clone(), &Request::default(), limits).unwrap();
    draw(&mut r, &data, &zero(), &view);
    own.device().destroy();
    // The loss is told by the driver's callback, which runs when the device is next asked.
    assert!(own.wait().is_err());
    let device = |e: Result<(), RenderError>| assert!(matches!(e, Err(RenderError::Device(_))), "{e:?}");
    device(r.render(&Stop::default()).map(|_| ()));
    device(r.set_data(&data));
    device(r.set_view(&view));
    device(TetsplineRenderer::new(own, &Request::default(), limits).map(|_| ()));
    draw(&mut *open(&TETSPLINE_GPU, &Request::default()), &data, &zero(), &view);
}

/// A device that is destroyed while frames are under way: the frame at hand is one line of error, and a renderer on another device draws what the first one drew.
#[test]
fn a_device_lost_during_a_frame_is_one_error() {
    let Some((gpu, _guard)) = adapter("a_device_lost_during_a_frame_is_one_error") else {
        return;
    };
    let data = noise();
    // Many layers of noise: a frame is many submissions.
    let (surfaces, view) = ([Surface::isovalue(0.1, 0)], View::fit(data.bounds(), 40.0, 60, 45));
    let fresh = || {
        let own = Gpu::open_named(Some(&gpu.report().name)).unwrap();
        let r = TetsplineRenderer::new(own.clone(), &request(1, Knobs::default()), Limits::new(&own)).unwrap();
        (own, r)
    };
    let (own, mut r) = fresh();
    let want = draw(&mut r, &data, &surfaces, &view);
    let frame_time = r.render(&Stop::default()).unwrap().wall;
    let mut frames = 0;
    let error = std::thread::scope(|s| {
        s.spawn(|| {
            std::thread::sleep(frame_time.mul_f64(1.5));
            own.device().destroy();
        });
        loop {
            match r.render(&Stop::default()) {
                Ok(_) => frames += 1,
                Err(e) => break e,
            }
            assert!(frames < 100_000, "the loss is never seen");
        }
    });
    let text = error.to_string();
    assert!(matches!(error, RenderError::Device(_)) && !text.contains('\n'), "{text}");
    assert!(text.contains("open the renderer again"), "{text}");
    assert!(matches!(r.read(&mut Frame::default()), Err(RenderError::NotReady("render"))));
    assert!(matches!(r.render(&Stop::default()), Err(RenderError::Device(_))));
    let (_other, mut again) = fresh();
    assert!(
        draw(&mut again, &data, &surfaces, &view) == want,
        "after {frames} whole frames"
    );
}

/// Lists that outgrow a (lowered) binding limit are split, and the frame is the same: with coefficients on the fly and stored, first hits, and all hits of surfaces seen through.
#[test]
fn lists_in_parts_draw_what_one_list_draws() {
    let Some((gpu, _guard)) = adapter("lists_in_parts_draw_what_one_list_draws") else {
        return;
    };
    let data = noise();
    let view = View::fit(data.bounds(), 40.0, 40, 30);
    let clear = Surface {
        opacity: 0.4,
        ..zero()[0]
    };
    let stored = Knobs::default().with("coefficients", "determining-set");
    for (wanted, surface, list) in [
        (first_hits(Knobs::default()), zero()[0], 8192),
        (first_hits(stored.clone()), zero()[0], 65_536),
        (request(3, Knobs::default()), clear, 8192),
    ] {
        let whole = draw(&mut *open(&TETSPLINE_GPU, &wanted), &data, &[surface], &view);
        let limits = Limits { chunk: 300, list };
        let mut r = TetsplineRenderer::new(gpu.clone(), &wanted, limits).unwrap();
        let parts = draw(&mut r, &data, &[surface], &view);
        assert!(
            r.lists().unwrap().0.parts.len() > 4,
            "{} parts",
            r.lists().unwrap().0.parts.len()
        );
        // A root on a common face may be found by either tetrahedron, as draws come: the same root to rounding.
        let far = |(a, b): &(&f64, &f64)| a != b && (*a - *b).abs() > 1e-5;
        assert_eq!(whole.t.iter().zip(&parts.t).filter(far).count(), 0);
        assert!(whole.surface == parts.surface && whole.hits == parts.hits);
        let colours = whole.rgba.iter().zip(&parts.rgba);
        let far = |(a, b): &(&[f32; 4], &[f32; 4])| (0..4).any(|k| (a[k] - b[k]).abs() > 1e-3);
        assert_eq!(colours.filter(far).count(), 0);
    }
}
