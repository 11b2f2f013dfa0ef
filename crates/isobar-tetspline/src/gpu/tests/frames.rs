//! Frames against the oracle and against `tetspline/cpu`.

use super::*;
use crate::TETSPLINE_CPU;
use crate::gpu::TETSPLINE_GPU;
use isobar_core::{Camera, Claim, ClipPlane};

/// A root of the GPU against its certified one, voxels.
const VOXELS: f64 = 5e-5;

fn knob(name: &'static str, value: &'static str) -> Knobs {
    Knobs::default().with(name, value)
}

/// No pixel is missed, false, on the wrong root or surface, for both reconstructions, both ways to the coefficients and all exact root finders.
#[test]
fn frames_are_exact() {
    let Some(_gpu) = adapter("frames_are_exact") else {
        return;
    };
    let ml = synthetic("marschner-lobb,n=40");
    let gyroid = synthetic("gyroid,n=35");
    let cases = [
        (&ml, 0.5, Knobs::default()),
        (&ml, 0.5, knob("coefficients", "determining-set")),
        (&ml, 0.5, knob("roots", "hull")),
        (&gyroid, 0.2, Knobs::default()),
        (
            &gyroid,
            0.2,
            knob("reconstruction", "type6-prefiltered").with("classify", "data"),
        ),
    ];
    for (data, c, knobs) in cases {
        let name = format!("{knobs:?}");
        let (c, r) = checked(knobs, data, &[Surface::isovalue(c, 0)], &View::bench(96, 72));
        println!(
            "{name}: {} hits, wrong {:?}, t {:?}, normal {:?}",
            c.hits,
            wrong(&c),
            c.t_error_voxels,
            c.normal_error_deg
        );
        assert!(c.hits > 1000, "{name}: {}", c.hits);
        assert_eq!((wrong(&c), c.unclaimed), ([0; 4], 96 * 72), "{name} {:?}", r.counters());
        assert!(
            c.t_error_voxels.p99 < 2e-6 && c.t_error_voxels.max < VOXELS,
            "{name}: {:?}",
            c.t_error_voxels
        );
        assert!(c.normal_error_deg.max < 0.01, "{name}: {:?}", c.normal_error_deg);
    }
}

/// White noise has every cube active and every case in it; all sample types, odd sizes, oblique axes; eyes outside and inside; parallel rays.
#[test]
fn noise_is_exact_on_any_lattice() {
    let Some(_gpu) = adapter("noise_is_exact_on_any_lattice") else {
        return;
    };
    let grids = [
        (random_grid([2, 2, 2], 0), 127.5),
        (random_grid([7, 18, 5], 1), 300.25),
        (oblique(random_grid([9, 6, 17], 3)), 0.1),
        (random_grid([6, 23, 4], 2), 32_000.0),
    ];
    for (grid, c) in grids {
        let data = Arc::new(Data::Grid(grid));
        let (lo, hi) = data.bounds();
        let middle = (lo + hi) * 0.5;
        let outside = View::fit(data.bounds(), 40.0, 64, 48);
        let inside = View::perspective(middle + (hi - lo) * 0.1, lo, DVec3::new(0.1, 0.2, 1.0), 95.0, 64, 48);
        let parallel = View {
            camera: Camera::Orthographic {
                eye: lo - (hi - lo) * 0.7,
                target: middle,
                up: DVec3::Z,
                height: (hi - lo).length(),
            },
            ..outside.clone()
        };
        for (name, view) in [("outside", outside), ("inside", inside), ("parallel", parallel)] {
            let (c, _) = checked(Knobs::default(), &data, &[Surface::isovalue(c, 0)], &view);
            assert!(c.hits > 30, "{name}: {}", c.hits);
            assert_eq!(wrong(&c), [0; 4], "{name} of {:?}", data.bounds());
            assert!(c.t_error_voxels.max < 1e-3, "{name}: {:?}", c.t_error_voxels);
        }
    }
}

/// The paper's rays are interpolated, and its roots Newton's: what they lose is counted, and most pixels are right.
#[test]
fn the_paper_as_printed_is_mostly_right() {
    let Some(_gpu) = adapter("the_paper_as_printed_is_mostly_right") else {
        return;
    };
    let data = synthetic("marschner-lobb,n=40");
    let surfaces = [Surface::isovalue(0.5, 0)];
    let view = View::bench(96, 72);
    let printed = knob("rays", "interpolated")
        .with("roots", "newton3")
        .with("classify", "paper");
    let cases = [
        ("interpolated", knob("rays", "interpolated"), 0.02, 5e-3),
        ("newton3", knob("roots", "newton3"), 0.3, 0.1),
        ("analytic", knob("roots", "analytic"), 0.02, 0.1),
        ("printed", printed, 0.3, 0.1),
    ];
    for (name, knobs, share, voxels) in cases {
        let (c, _) = checked(knobs, &data, &surfaces, &view);
        let bad: usize = wrong(&c).iter().sum();
        println!("{name}: {} hits, wrong {:?}, t {:?}", c.hits, wrong(&c), c.t_error_voxels);
        assert!(
            c.hits > 1000 && (bad as f64) < share * c.hits as f64,
            "{name}: {bad} of {}",
            c.hits
        );
        assert!(c.t_error_voxels.p99 < voxels, "{name}: {:?}", c.t_error_voxels);
    }
    // Interpolated rays have no tetrahedra behind the eye's own: some are lost from inside, and none of the others.
    let inside = View::perspective(
        DVec3::new(0.03, 0.02, -0.2),
        DVec3::new(0.4, 0.6, -0.1),
        DVec3::Z,
        90.0,
        64,
        48,
    );
    let (c, _) = checked(Knobs::default(), &data, &surfaces, &inside);
    assert_eq!(wrong(&c), [0; 4]);
}

/// Several isovalues, one invisible, one semi-transparent, more hits than layers: as `tetspline/cpu`.
#[test]
fn layers_and_several_isovalues_are_those_of_the_cpu() {
    let Some(_gpu) = adapter("layers_and_several_isovalues_are_those_of_the_cpu") else {
        return;
    };
    let data = Arc::new(Data::Grid(random_grid([9, 8, 10], 1)));
    let mut surfaces = [12_000.5, -9_000.0, 300.0, 1.0e9].map(|c| Surface::isovalue(c, 0));
    for (i, s) in surfaces.iter_mut().enumerate() {
        s.opacity = [0.3, 1.0, 0.0, 1.0][i];
        s.colour = Surface::COLOURS[i];
    }
    let view = View::fit(data.bounds(), 40.0, 48, 36);
    let g = draw(
        &mut *open(&TETSPLINE_GPU, &request(4, Knobs::default())),
        &data,
        &surfaces,
        &view,
    );
    let c = draw(
        &mut *open(&TETSPLINE_CPU, &request(4, Knobs::default())),
        &data,
        &surfaces,
        &view,
    );
    let n = view.pixels();
    let unlike = isobar_scenes::unlike_layers(&g, &c, 4);
    let hits: u64 = g.hits.iter().map(|h| u64::from(*h)).sum();
    for (i, hits) in g.hits.iter().enumerate() {
        assert!(*hits == 0 || g.work[i] > 0, "pixel {i} has hits without fragments");
    }
    assert!(hits > n as u64 / 2, "{hits} hits");
    assert!([0, 1].iter().all(|s| g.surface.contains(s)) && !g.surface.contains(&2));
    // Near-tangent pixels of noise, where a root more or less is a matter of rounding.
    assert!(unlike <= 2, "{unlike} of {n} pixels");
}

/// With `claims=cpu` the CPU's proofs are taken over, and none of them is refuted by the oracle.
#[test]
fn claims_are_those_of_the_cpu() {
    let Some(_gpu) = adapter("claims_are_those_of_the_cpu") else {
        return;
    };
    let data = synthetic("gyroid,n=32");
    let surfaces = [Surface::isovalue(0.2, 0), Surface::isovalue(-0.7, 1)];
    let view = View::bench(64, 48);
    let channels = Channels::T | Channels::SURFACE | Channels::NORMAL | Channels::CLAIM | Channels::T_ERROR;
    let of_cpu = Request {
        channels,
        ..request(1, knob("claims", "cpu"))
    };
    let mut r = open(&TETSPLINE_GPU, &of_cpu);
    let frame = draw(&mut *r, &data, &surfaces, &view);
    let c = isobar_scenes::against(&frame, &*r, &surfaces, &view);
    assert_eq!((c.refuted, wrong(&c)), (0, [0; 4]));
    assert!(c.unclaimed <= 2, "{} pixels are not proved", c.unclaimed);
    let hits = frame
        .claim
        .iter()
        .zip(&frame.t_error)
        .filter(|(c, e)| c.contains(Claim::EXISTS) && e.is_finite());
    assert!(hits.count() > 500);
    let counters = r.counters();
    let of = |name: &str| counters.0.iter().find(|(n, _)| *n == name).unwrap().1;
    assert!(of("proof microseconds") > 0 && of("pixels proved") > 3000 - 4 && of("pixels unlike the cpu") == 0);
    r.set_knobs(&Knobs::default()).unwrap();
    let plain = redraw(&mut *r);
    assert!(plain.claim.iter().all(|c| c.is_empty()) && plain.t == frame.t);
    let only = Request {
        channels: Channels::CLAIM,
        ..of_cpu
    };
    let bare = draw(&mut *open(&TETSPLINE_GPU, &only), &data, &surfaces, &view);
    assert_eq!((bare.claim, bare.t.len(), bare.surface.len()), (frame.claim, 0, 0));
}

/// Open cuts: as `tetspline/cpu`, with both kinds of rays.
#[test]
fn clipping_planes_cut_rays() {
    let Some(_gpu) = adapter("clipping_planes_cut_rays") else {
        return;
    };
    let data = synthetic("gyroid,n=24");
    let surfaces = [Surface::isovalue(0.2, 0)];
    let mut view = View::bench(64, 48);
    let plane = |normal: DVec3, distance| ClipPlane {
        normal,
        distance,
        cap: false,
    };
    view.clips = vec![plane(DVec3::new(1.0, 0.2, 0.1), 0.3), plane(DVec3::new(0.0, 0.0, -2.0), 0.9)];
    let (c, _) = checked(Knobs::default(), &data, &surfaces, &view);
    assert!(c.hits > 300 && wrong(&c) == [0; 4], "{} {:?}", c.hits, wrong(&c));
    let (c, _) = checked(knob("rays", "interpolated"), &data, &surfaces, &view);
    let bad: usize = wrong(&c).iter().sum();
    assert!(c.hits > 300 && bad * 50 < c.hits, "{bad} of {}", c.hits);
}

/// Isovalues equal to samples, plateaus (hardcases B5, B7): no panic, and what the oracle can decide is right.
#[test]
fn plateaus_do_not_break_it() {
    let Some(_gpu) = adapter("plateaus_do_not_break_it") else {
        return;
    };
    isobar_scenes::trials::plateaus(|data, surfaces, view| {
        let (c, _) = checked(Knobs::default(), data, surfaces, view);
        assert_eq!(wrong(&c), [0; 4]);
    });
}

/// A far eye, a large offset of the data, a large volume: no digit is lost.
#[test]
fn digits_are_kept_far_from_zero() {
    let Some(_gpu) = adapter("digits_are_kept_far_from_zero") else {
        return;
    };
    let sampled = |dims, f: &dyn Fn(f64) -> f64| Arc::new(Data::Grid(isobar_scenes::sampled(dims, |x, _, _| f(x))));
    let mut r = open(&TETSPLINE_GPU, &first_hits(Knobs::default()));
    let mut hit = |data: Arc<Data>, c: f64, x: f64, fov: f64| {
        let eye = DVec3::new(x, 1.1, 1.2);
        let view = View::perspective(eye, eye + DVec3::X, DVec3::Z, fov, 1, 1);
        draw(&mut *r, &data, &[Surface::isovalue(c, 0)], &view).t[0]
    };
    let t = hit(sampled([9, 3, 3], &|x| 1e6 + x / 16.0), 1e6 + 4.3 / 16.0, -1.0, 20.0);
    assert!((t - 5.3).abs() < 2e-6, "{t}");
    let t = hit(sampled([9, 3, 3], &|x| x), 4.3, -1e6, 1e-4);
    assert!((t - 1_000_004.3).abs() < 2e-6, "{t}");
    let t = hit(sampled([2001, 3, 3], &|x| x - 1990.0), 0.3, -1.0, 0.01);
    assert!((t - 1991.3).abs() < 1e-5, "{t}");
}
