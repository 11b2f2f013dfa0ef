//! What is refused, what is remembered between calls, stopping, losing the device.

use super::*;
use crate::gpu::renderer::OctreeRenderer;
use crate::gpu::{INFO, OCTREE_GPU};
use isobar_core::RenderError;
use isobar_gpu::Gpu;
use isobar_scenes::trials::{
    Change, absurd_sizes, capped, each_change, empty_frames, moved_noise, near_and_parallel, refusals, small_noise, wide,
};

#[test]
fn what_cannot_be_drawn_is_refused_and_what_was_set_is_kept() {
    let Some(_gpu) = adapter("what_cannot_be_drawn_is_refused_and_what_was_set_is_kept") else {
        return;
    };
    let knobs = [("claims", "on"), ("loops", "no"), ("block", "8"), ("reconstruction", "type6")];
    let knobs = knobs.map(|(k, v)| Knobs::default().with(k, v));
    refusals(&OCTREE_GPU, &[capped(&View::bench(20, 16))], &knobs);
    assert!(INFO.gpu && INFO.id == "octree/gpu");
}

#[test]
fn absurd_sizes_are_memory_errors() {
    let Some(gpu) = adapter("absurd_sizes_are_memory_errors") else {
        return;
    };
    absurd_sizes(&OCTREE_GPU, gpu.0.report().max_texture_3d as usize);
}

#[test]
fn an_isovalue_outside_the_range_gives_an_empty_frame() {
    let Some(_gpu) = adapter("an_isovalue_outside_the_range_gives_an_empty_frame") else {
        return;
    };
    empty_frames(&OCTREE_GPU);
}

/// Each change alone gives the frame of a renderer opened for it.
#[test]
fn every_change_gives_the_frame_of_a_fresh_renderer() {
    let Some(_gpu) = adapter("every_change_gives_the_frame_of_a_fresh_renderer") else {
        return;
    };
    let bytes = Arc::new(Data::Grid(random_grid([10, 11, 12], 0)));
    let [near, parallel] = near_and_parallel();
    let rays = View::rays((0..50).map(|i| near.ray(i % 33, i / 3)).collect::<Vec<_>>());
    let changes = vec![
        Change::View(wide(300, 60)),
        Change::Isovalue(0.3),
        Change::Data(bytes, 99.5),
        Change::Knobs(knobs(Kind::CubicInterpolating)),
        Change::View(rays),
        Change::Data(moved_noise(), 0.1),
        Change::View(parallel),
        Change::Knobs(Knobs::default()),
        Change::Data(small_noise(), 0.1),
        Change::Knobs(knobs(Kind::Quadratic)),
    ];
    each_change(&OCTREE_GPU, |knobs| request(2, knobs), &near, changes, |_, _, _| {});
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
