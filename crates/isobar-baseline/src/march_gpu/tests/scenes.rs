//! What is refused, what is remembered between calls, stopping, losing the device.

use crate::march_gpu::renderer::MarchRenderer;
use crate::march_gpu::{INFO, MARCH_GPU};
use isobar_core::{
    Channels, Data, Frame, Knobs, Method, RenderError, Renderer, Request, Sampling, Scene, Stage, Stop, Surface,
    TransferFunction, Unsupported, View,
};
use isobar_fields::Kind;
use isobar_gpu::rays::Rectangle;
use isobar_gpu::{Gpu, test_adapter};
use isobar_scenes::trials::{
    Change, absurd_sizes, capped, each_change, empty_frames, moved_noise, near_and_parallel, refusals, small_noise as noise,
    wide, zero,
};
use isobar_scenes::{draw, open, random_grid, request, sampled};
use std::sync::Arc;

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
    let knobs = [Knobs::default().with("step", 0), Knobs::default().with("block", 8)];
    refusals(&MARCH_GPU, &[capped(&View::bench(20, 16))], &knobs);
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
    absurd_sizes(&MARCH_GPU, Gpu::shared().unwrap().report().max_texture_3d as usize);
    // 3 million layers of one pixel are 60 MB: fine where a binding holds them.
    let wanted = Request {
        layers: 3_000_000,
        ..Request::default()
    };
    let mut r = open(&MARCH_GPU, &wanted);
    r.set_data(&noise()).unwrap();
    match r.set_view(&View::bench(1, 1)) {
        Err(RenderError::Memory { bytes, limit, .. }) => assert!(bytes > limit),
        other => other.unwrap(),
    }
}

#[test]
fn an_isovalue_outside_the_range_gives_an_empty_frame() {
    if test_adapter("an_isovalue_outside_the_range_gives_an_empty_frame").is_none() {
        return;
    }
    empty_frames(&MARCH_GPU);
}

/// Each change alone gives the frame of a renderer opened for it.
#[test]
fn every_change_gives_the_frame_of_a_fresh_renderer() {
    if test_adapter("every_change_gives_the_frame_of_a_fresh_renderer").is_none() {
        return;
    }
    let bytes = Arc::new(Data::Grid(random_grid([10, 11, 12], 0)));
    let [near, parallel] = near_and_parallel();
    let rays = View::rays((0..50).map(|i| near.ray(i % 33, i / 3)).collect::<Vec<_>>());
    let with = |name: &'static str, value: &'static str| Knobs::default().with(name, value);
    let changes = vec![
        Change::View(wide(600, 110)),
        Change::Isovalue(0.3),
        Change::Data(bytes, 99.5),
        Change::Knobs(with("reconstruction", "cubic-interpolating")),
        Change::View(rays),
        Change::Data(moved_noise(), 0.1),
        Change::Knobs(with("step", "2").with("filter", "bits8")),
        Change::View(parallel),
        Change::Knobs(with("skip", "off")),
        Change::Data(noise(), 0.1),
        Change::Knobs(with("reconstruction", "quadratic")),
        Change::View(near.clone()),
    ];
    each_change(&MARCH_GPU, |knobs| request(2, knobs), &near, changes, |_, _, _| {});
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
