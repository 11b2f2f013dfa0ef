//! What is refused, what is remembered between calls, stopping, losing the device.

use super::*;
use crate::gpu::lists::Limits;
use crate::gpu::renderer::TetsplineRenderer;
use crate::gpu::{INFO, TETSPLINE_GPU};
use isobar_core::RenderError;
use isobar_scenes::trials::{Change, each_change, near_and_parallel, refusals, small_noise as noise, wide, zero};

#[test]
fn what_cannot_be_drawn_is_refused_and_what_was_set_is_kept() {
    let Some(_gpu) = adapter("what_cannot_be_drawn_is_refused_and_what_was_set_is_kept") else {
        return;
    };
    let list = View::rays(vec![View::bench(20, 16).ray(3, 3)]);
    let knobs = [
        ("claims", "on"),
        ("roots", "certified"),
        ("rays", "7"),
        ("cull", "maybe"),
        ("coefficients", "stored"),
    ];
    refusals(&TETSPLINE_GPU, &[list], &knobs.map(|(k, v)| Knobs::default().with(k, v)));
    assert!(INFO.gpu && INFO.id == "tetspline/gpu");
}

/// Each change alone gives the frame of a renderer opened for it; a time step on the same lattice keeps the device's memory (K25).
#[test]
fn every_change_gives_the_frame_of_a_fresh_renderer() {
    let Some(_gpu) = adapter("every_change_gives_the_frame_of_a_fresh_renderer") else {
        return;
    };
    let bytes = Arc::new(Data::Grid(random_grid([10, 11, 12], 0)));
    let [near, parallel] = near_and_parallel();
    let mut other = random_grid([10, 11, 12], 4);
    other.origin = DVec3::ZERO;
    let filtered = Knobs::default()
        .with("reconstruction", "type6-prefiltered")
        .with("rays", "interpolated");
    let changes = vec![
        Change::View(wide(200, 40)),
        Change::Isovalue(0.3),
        Change::Data(bytes, 99.5),
        Change::Knobs(Knobs::default().with("coefficients", "determining-set")),
        Change::View(parallel),
        Change::Data(noise(), 0.1),
        Change::Data(Arc::new(Data::Grid(other)), 0.1),
        Change::Knobs(filtered),
        Change::Knobs(Knobs::default()),
    ];
    each_change(&TETSPLINE_GPU, first_hits, &near, changes, |n, before, r| {
        assert!(n != 6 || r.memory().device == before);
    });
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
