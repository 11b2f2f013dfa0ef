//! `peaks/gpu`: what is refused, what is remembered between calls, stopping, losing the device.

use super::gpu::{adapter, mixed, waves};
use super::*;
use crate::PEAKS_GPU;
use crate::gpu::renderer::GpuRenderer;
use isobar_core::{DataError, RenderError, RenderTime};
use isobar_gpu::Gpu;

fn scene() -> (Arc<Data>, TransferFunction, View) {
    let data = Arc::new(Data::Grid(waves([14, 12, 13], 3)));
    let view = View::fit(data.bounds(), 40.0, 24, 18);
    (data, mixed(1.0, 0.0), view)
}

#[test]
fn what_the_gpu_cannot_draw_is_refused_and_what_was_set_is_kept() {
    let Some((gpu, _one)) = adapter("what_the_gpu_cannot_draw_is_refused_and_what_was_set_is_kept") else {
        return;
    };
    let (data, tf, view) = scene();
    let mut r = PEAKS_GPU.open(&request(1, &[])).unwrap();
    assert!(matches!(r.render(&Stop::default()), Err(RenderError::NotReady("set_data"))));
    assert!(matches!(r.read(&mut Frame::default()), Err(RenderError::NotReady("render"))));
    r.set_data(&data).unwrap();
    assert!(matches!(
        r.render(&Stop::default()),
        Err(RenderError::NotReady("set_surfaces"))
    ));
    r.set_medium(Some(&tf)).unwrap();
    assert!(matches!(r.render(&Stop::default()), Err(RenderError::NotReady("set_view"))));
    let first = image(r.as_mut(), &view);
    assert!(first.t.iter().any(|t| t.is_finite()));
    let long = gpu.report().max_texture_3d as usize + 1;
    let thin = Data::Grid(Grid::unit([long, 2, 2], Samples::U8(vec![0; long * 4].into())).unwrap());
    assert!(matches!(r.set_data(&Arc::new(thin)), Err(RenderError::Memory { bytes, .. }) if bytes == long as u64));
    let wide = vec![3e38f32, -3e38, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let wide = Arc::new(Data::Grid(Grid::unit([2; 3], Samples::F32(wide.into())).unwrap()));
    assert!(matches!(r.set_data(&wide), Err(RenderError::Data(DataError::Unknown(_)))));
    for bad in [
        ("integration", "analytic"),
        ("precision", "single"),
        ("sk", "0"),
        ("reconstruction", "type6"),
    ] {
        assert!(
            matches!(r.set_knobs(&knobs(&[bad])), Err(RenderError::Knob { .. })),
            "{bad:?}"
        );
    }
    let mut capped = view.clone();
    capped.clips.push(isobar_core::ClipPlane {
        normal: DVec3::X,
        distance: 0.0,
        cap: true,
    });
    assert!(matches!(r.set_view(&capped), Err(RenderError::Unsupported(_))));
    // Nothing of this changed what is drawn.
    assert_eq!(image(r.as_mut(), &view), first);
    r.set_knobs(&knobs(&[("sk", "1e-12")])).unwrap();
    let e = r.render(&Stop::default()).unwrap_err();
    assert!(matches!(&e, RenderError::Knob { name, .. } if name == "sk"), "{e}");
    let stop = Stop::default();
    stop.raise();
    r.set_knobs(&knobs(&[])).unwrap();
    assert!(matches!(r.render(&stop), Err(RenderError::Stopped)));
    assert_eq!(image(r.as_mut(), &view), first);
}

#[test]
fn views_beyond_memory_are_refused() {
    let Some(_gpu) = adapter("views_beyond_memory_are_refused") else {
        return;
    };
    let (data, tf, _) = scene();
    for (layers, w, h) in [(1, 16_384, 16_384), (1_000_000_000, 64, 64), (usize::MAX, 4, 4)] {
        let mut r = open(
            &PEAKS_GPU,
            &data,
            &[],
            Some(&tf),
            Request {
                layers,
                ..Request::default()
            },
        );
        r.set_view(&View::fit(data.bounds(), 20.0, w, h)).unwrap();
        match r.render(&Stop::default()) {
            Err(RenderError::Memory { bytes, limit, .. }) => assert!(bytes > limit),
            other => panic!("{layers} {w}x{h}: {other:?}"),
        }
    }
}

/// Setters in any order and over and over give the frame of a new renderer.
#[test]
fn every_change_gives_the_frame_of_a_fresh_renderer() {
    let Some(_gpu) = adapter("every_change_gives_the_frame_of_a_fresh_renderer") else {
        return;
    };
    let (data, tf, view) = scene();
    let other = Arc::new(Data::Grid(waves([9, 15, 8], 0)));
    let away = View::perspective(DVec3::splat(100.0), DVec3::splat(200.0), DVec3::Z, 40.0, 9, 7);
    let k: &[(&str, &str)] = &[("sampling", "geometric"), ("multiplier", "on"), ("reconstruction", "cubic")];
    let want = draw(&PEAKS_GPU, &data, &[], Some(&tf), &view, (2, k));
    let mut r = PEAKS_GPU.open(&request(2, &[])).unwrap();
    r.set_medium(Some(&mixed(50.0, 120.0))).unwrap();
    r.set_data(&other).unwrap();
    let first = image(r.as_mut(), &view);
    assert!(first.rgba.iter().any(|c| c[3] > 0.1));
    assert_eq!(image(r.as_mut(), &away), Frame::new(9, 7, 2, Channels::all()));
    r.set_knobs(&knobs(k)).unwrap();
    r.render(&Stop::default()).unwrap();
    r.set_surfaces(&[Surface::isovalue(0.1, 0)]).unwrap();
    r.set_data(&data).unwrap();
    image(r.as_mut(), &view);
    r.set_surfaces(&[]).unwrap();
    r.set_medium(Some(&tf)).unwrap();
    assert!(matches!(r.read(&mut Frame::default()), Err(RenderError::NotReady("render"))));
    assert_eq!(image(r.as_mut(), &view), want);
    let m = r.memory();
    assert!(m.device > 100_000 && m.view > 0 && m.index > 0, "{m:?}");
    let samples = r.counters().0.iter().find(|c| c.0 == "samples").unwrap().1;
    assert_eq!(samples, want.work.iter().map(|w| u64::from(*w)).sum::<u64>());
    // Without colour and medium, and with no value that can be seen.
    r.set_medium(Some(&peaks(&[(1e6, RED, 0.5)], 0.1))).unwrap();
    let f = image(r.as_mut(), &view);
    assert!(f.rgba.iter().all(|c| *c == [0.0; 4]) && f.t.iter().all(|t| t.is_infinite()));
}

/// Rays that pause after few turns of their loops give the frame of those that do not.
#[test]
fn passes_do_not_show() {
    let Some((gpu, _one)) = adapter("passes_do_not_show") else {
        return;
    };
    let (data, tf, view) = scene();
    for k in [
        &[][..],
        &[("sampling", "printed"), ("multiplier", "on"), ("sk", "1")],
        &[("macrocells", "off"), ("integration", "lum"), ("shading", "on")],
        &[
            ("sampling", "geometric"),
            ("reconstruction", "cubic"),
            ("mode", "peak_xor_dvr"),
        ],
    ] {
        let frame = |turns: u32| {
            let mut r = GpuRenderer::new(gpu.clone(), &request(2, k)).unwrap().with_turns(turns);
            r.set_data(&data).unwrap();
            r.set_medium(Some(&tf)).unwrap();
            let first = image(&mut r, &view);
            // What a frame leaves with the rays is nothing to the next one.
            assert_eq!(image(&mut r, &view), first, "{k:?}");
            first
        };
        let whole = frame(1 << 20);
        assert!(whole.hits.iter().any(|h| *h > 2), "{k:?}");
        for turns in [31, 50] {
            assert_eq!(frame(turns), whole, "{k:?} {turns}");
        }
    }
}

/// A ray of some hundred thousand samples: more turns than software Vulkan's loops have.
#[test]
fn long_rays_are_drawn_to_their_end() {
    let Some((_gpu, _one)) = adapter("long_rays_are_drawn_to_their_end") else {
        return;
    };
    let data = grid([40, 3, 3], |x, _, _| (x as f64 * 0.5).sin());
    let surfaces = [Surface::isovalue(0.3, 0)];
    let k = [("step", "0.0004"), ("sampling", "uniform")];
    let view = ray([-1.0, 1.1, 0.9], [1.0, 0.0, 0.0]);
    let f = draw(&PEAKS_GPU, &data, &surfaces, None, &view, (16, &k));
    let want = draw(&crate::PEAKS_CPU_PAPER, &data, &surfaces, None, &view, (16, &k));
    assert!(
        want.hits[0] == 7 && want.work[0] > 65_535,
        "{} {}",
        want.hits[0],
        want.work[0]
    );
    near(&hits(&f), &hits(&want), 1e-3);
}

#[test]
fn a_lost_device_is_an_error_and_a_new_renderer_works() {
    let Some((shared, _one)) = adapter("a_lost_device_is_an_error_and_a_new_renderer_works") else {
        return;
    };
    let own = Gpu::open_named(Some(&shared.report().name)).unwrap();
    let (data, tf, view) = scene();
    let mut r = GpuRenderer::new(own.clone(), &request(1, &[])).unwrap();
    r.set_data(&data).unwrap();
    r.set_medium(Some(&tf)).unwrap();
    image(&mut r, &view);
    own.device().destroy();
    // The loss is told by the driver's callback, which runs when the device is next asked.
    assert!(own.wait().is_err());
    let lost = |e: Result<RenderTime, RenderError>| assert!(matches!(e, Err(RenderError::Device(_))), "{e:?}");
    lost(r.render(&Stop::default()));
    assert!(matches!(r.set_data(&data), Err(RenderError::Device(_))));
    assert!(matches!(GpuRenderer::new(own, &request(1, &[])), Err(RenderError::Device(_))));
    let f = draw(&PEAKS_GPU, &data, &[], Some(&tf), &view, (1, &[]));
    assert!(f.t.iter().any(|t| t.is_finite()));
}
