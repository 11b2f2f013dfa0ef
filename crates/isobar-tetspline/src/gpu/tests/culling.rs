//! Culling by the view frustum, and closed cuts.

use super::*;
use crate::TETSPLINE_CPU;
use crate::gpu::TETSPLINE_GPU;
use crate::gpu::lists::{Limits, Lists};
use crate::gpu::renderer::TetsplineRenderer;
use isobar_core::{Camera, ClipPlane};

/// Tetrahedra sent, as the device holds their number; each is one of the active ones, and the draws send them all.
fn sent(gpu: &Gpu, lists: &Lists) -> usize {
    let mut total = 0;
    for p in &lists.parts {
        let drawn = p.drawn();
        let bases: Vec<u32> = gpu.read(drawn.bases, 25).unwrap();
        let draws: Vec<[u32; 4]> = gpu.read(drawn.draws, 24).unwrap();
        let active: Vec<u32> = gpu.read(&p.tetrahedra, p.counts[1] as usize).unwrap();
        let first: Vec<u32> = gpu.read(&p.bases, 25).unwrap();
        let own: Vec<u32> = gpu.read(drawn.tetrahedra, bases[24] as usize).unwrap();
        for k in 0..24 {
            let of = |all: &[u32], b: &[u32]| {
                let mut l = all[b[k] as usize..b[k + 1] as usize].to_vec();
                l.sort_unstable();
                l
            };
            let (all, seen) = (of(&active, &first), of(&own, &bases));
            assert!(seen.iter().all(|t| all.binary_search(t).is_ok()), "kind {k}");
            assert_eq!(draws[k], [6, seen.len() as u32, 6 * k as u32, 0]);
        }
        total += bases[24] as usize;
    }
    total
}

/// What the view does not see is not sent, and the image is the same to the last bit; for eyes before and inside the volume, parallel rays, stored sets, lists in parts, and
/// after changes of view and isovalue.
#[test]
fn culled_tetrahedra_are_not_missed() {
    let Some((gpu, _guard)) = adapter("culled_tetrahedra_are_not_missed") else {
        return;
    };
    let data = synthetic("gyroid,n=30");
    let near = View::perspective(DVec3::new(1.6, 1.1, 1.3), DVec3::new(0.4, -0.2, 0.1), DVec3::Z, 22.0, 72, 54);
    let inside = View::perspective(DVec3::new(0.1, 0.15, 0.0), DVec3::new(1.0, 0.3, 0.2), DVec3::Z, 60.0, 48, 48);
    let mut parallel = near.clone();
    parallel.camera = Camera::Orthographic {
        eye: DVec3::new(3.0, 1.0, 2.0),
        target: DVec3::new(0.2, 0.3, 0.0),
        up: DVec3::Z,
        height: 0.6,
    };
    let whole = View::fit(data.bounds(), 40.0, 48, 36);
    let wide = Limits::new(&gpu);
    let narrow = Limits {
        chunk: 5000,
        list: 1 << 16,
    };
    for (limits, coefficients) in [(wide, "on-the-fly"), (wide, "determining-set"), (narrow, "on-the-fly")] {
        let knobs = |cull: &str| Knobs::default().with("coefficients", coefficients).with("cull", cull);
        let mut on = TetsplineRenderer::new(gpu.clone(), &first_hits(knobs("on")), limits).unwrap();
        let mut off = TetsplineRenderer::new(gpu.clone(), &first_hits(knobs("off")), limits).unwrap();
        for (view, isovalue) in [
            (&near, 0.2),
            (&inside, 0.2),
            (&parallel, 0.2),
            (&parallel, -0.7),
            (&whole, -0.7),
        ] {
            let surfaces = [Surface::isovalue(isovalue, 0)];
            let (a, b) = (draw(&mut on, &data, &surfaces, view), draw(&mut off, &data, &surfaces, view));
            assert!(a == b && a.t.iter().filter(|t| t.is_finite()).count() > 300, "{view:?}");
            let (some, all) = (sent(&gpu, on.lists().unwrap().0), sent(&gpu, off.lists().unwrap().0));
            assert_eq!(all as u64, on.lists().unwrap().0.counts()[1]);
            if std::ptr::eq(view, &raw const whole) {
                assert_eq!(some, all, "everything is seen");
            } else {
                assert!(some > 0 && some < all * 3 / 4, "{some} of {all}");
            }
        }
    }
}

/// Closed cuts look as those of `tetspline/cpu`, whose test holds them against the function.
#[test]
fn closed_cuts_are_those_of_the_cpu() {
    let Some((_gpu, _guard)) = adapter("closed_cuts_are_those_of_the_cpu") else {
        return;
    };
    let data = synthetic("gyroid,n=26");
    let mut view = View::bench(80, 60);
    view.clips = [
        (DVec3::new(1.0, 0.2, 0.1), 0.3, true),
        (DVec3::NEG_Z, 0.45, true),
        (DVec3::Y, 0.55, false),
    ]
    .map(|(normal, distance, cap)| ClipPlane { normal, distance, cap })
    .to_vec();
    let mut surfaces = vec![Surface::isovalue(0.7, 0), Surface::isovalue(-0.1, 1)];
    for (layers, opacity) in [(1, 1.0), (3, 0.5)] {
        surfaces[1].opacity = opacity;
        let want = draw(
            &mut *open(&TETSPLINE_CPU, &request(layers, Knobs::default())),
            &data,
            &surfaces,
            &view,
        );
        let got = draw(
            &mut *open(&TETSPLINE_GPU, &request(layers, Knobs::default())),
            &data,
            &surfaces,
            &view,
        );
        let sides = [view.clips[0], view.clips[1]].map(|c| (-c.normal.normalize()).as_vec3().to_array());
        let caps = want.normal.iter().filter(|n| sides.contains(n)).count();
        assert!(caps > 100, "{caps} caps");
        let apart = want
            .t
            .iter()
            .zip(&got.t)
            .filter(|(a, b)| a != b && (*a - *b).abs() > 1e-4)
            .count();
        let other = want.surface.iter().zip(&got.surface).filter(|(a, b)| a != b).count();
        assert!(
            apart <= 2 && other <= 2,
            "{layers} layers: {apart} other distances, {other} other surfaces"
        );
        let colours = want
            .rgba
            .iter()
            .zip(&got.rgba)
            .filter(|(a, b)| (0..4).any(|i| (a[i] - b[i]).abs() > 1e-2))
            .count();
        assert!(colours <= 2, "{colours} other colours");
    }
}

/// Smoothing on the device is smoothing on the host, to the rounding of f32; frames are those of the smoothed data, claims too.
#[test]
fn smoothing_is_that_of_the_cpu() {
    let Some((gpu, _guard)) = adapter("smoothing_is_that_of_the_cpu") else {
        return;
    };
    for (which, sigma) in [(0, 0.7), (1, 2.0), (3, 1.3)] {
        let grid = random_grid([19, 7, 12], which);
        let (a, b) = (
            crate::gpu::smooth::gaussian(&gpu, &grid, sigma).unwrap(),
            crate::smooth::gaussian(&grid, sigma).unwrap(),
        );
        let (Samples::F32(a), Samples::F32(b)) = (&a.samples, &b.samples) else {
            panic!("f32")
        };
        let scale = crate::smooth::floats(&grid).iter().fold(0.0f32, |m, v| m.max(v.abs()));
        let most = a.iter().zip(b.iter()).fold(0.0f32, |m, (x, y)| m.max((x - y).abs()));
        assert!(most <= 4e-6 * scale, "{most} of {scale}");
    }
    let data = synthetic("marschner-lobb,n=28");
    let (surfaces, view) = ([Surface::isovalue(0.5, 0)], View::bench(48, 36));
    let knobs = Knobs::default().with("smooth", 0.8).with("claims", "cpu");
    let (c, mut r) = checked(knobs, &data, &surfaces, &view);
    assert_eq!((wrong(&c), c.refuted), ([0; 4], 0));
    assert!(
        c.hits > 200 && c.unclaimed < c.pixels / 10,
        "{} of {} not claimed",
        c.unclaimed,
        c.pixels
    );
    let smooth = redraw(&mut *r);
    r.set_knobs(&Knobs::default()).unwrap();
    let plain = redraw(&mut *r);
    assert_ne!(plain.t, smooth.t);
    assert_eq!(
        plain.t,
        draw(
            &mut *open(&TETSPLINE_GPU, &first_hits(Knobs::default())),
            &data,
            &surfaces,
            &view
        )
        .t
    );
}
