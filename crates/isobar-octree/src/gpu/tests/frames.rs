//! Frames against the oracle and against `octree/cpu`.

use super::*;
use crate::OCTREE_CPU;
use crate::agreement::Agreement;
use crate::gpu::OCTREE_GPU;
use isobar_core::{Camera, Claim, ClipPlane, Ray};
use isobar_oracle::Oracle;

/// A root of the GPU against its certified one, voxels. Seen: median 5e-8, 99 % 5e-7, at most 1.1e-5 (rays that graze the surface).
const VOXELS: f64 = 2e-5;

/// No pixel is missed, false, on the wrong root or surface, for any reconstruction.
#[test]
fn frames_are_exact() {
    let Some(_gpu) = adapter("frames_are_exact") else {
        return;
    };
    let kinds = [Kind::Trilinear, Kind::Quadratic, Kind::CubicInterpolating];
    for (spec, c, kinds) in [
        ("marschner-lobb,n=40", 0.5, &kinds[..]),
        ("gyroid,n=35", 0.2, &[Kind::QuadraticInterpolating, Kind::Cubic][..]),
    ] {
        for kind in kinds {
            let data = synthetic(spec);
            let c = checked(knobs(*kind), &data, &[Surface::isovalue(c, 0)], &View::bench(72, 54));
            assert!(c.hits > 500, "{spec} {kind}: {}", c.hits);
            assert_eq!(
                (c.missed, c.false_hits, c.wrong_root, c.wrong_surface, c.unclaimed),
                (0, 0, 0, 0, 72 * 54),
                "{spec} {kind}"
            );
            assert!(
                c.t_error_voxels.p99 < 2e-6 && c.t_error_voxels.max < VOXELS,
                "{spec} {kind}: {:?}",
                c.t_error_voxels
            );
            assert!(c.normal_error_deg.max < 0.01, "{spec} {kind}: {:?}", c.normal_error_deg);
        }
    }
}

/// White noise has every cell active and every case in it; all sample types, odd sizes, oblique axes.
#[test]
fn noise_is_exact_on_any_lattice() {
    let Some(_gpu) = adapter("noise_is_exact_on_any_lattice") else {
        return;
    };
    let grids = [
        (random_grid([2, 2, 2], 0), 127.5),
        (random_grid([7, 18, 5], 1), 300.25),
        (oblique(random_grid([9, 6, 17], 3)), 0.1),
        (random_grid([6, 33, 4], 2), 32_000.0),
    ];
    for (grid, c) in grids {
        let data = Arc::new(Data::Grid(grid));
        let view = View::fit(data.bounds(), 40.0, 64, 48);
        for kind in [Kind::Trilinear, Kind::Cubic] {
            let c = checked(knobs(kind), &data, &[Surface::isovalue(c, 0)], &view);
            let wrong = c.missed + c.false_hits + c.wrong_root + c.wrong_surface;
            assert!(c.hits > 100, "{kind}: {}", c.hits);
            assert_eq!(wrong, 0, "{kind}");
            assert!(c.t_error_voxels.max < 1e-4, "{kind}: {:?}", c.t_error_voxels);
        }
    }
}

/// Seeded rays through noise, from outside and inside: all hits in order.
#[test]
fn all_hits_are_those_of_the_oracle() {
    let Some(_gpu) = adapter("all_hits_are_those_of_the_oracle") else {
        return;
    };
    let data = Arc::new(Data::Grid(random_grid([8, 9, 10], 3)));
    let (lo, hi) = data.bounds();
    let mut random = Random(5);
    let rays: Vec<Ray> = (0..1500)
        .map(|i| {
            let mut point = || DVec3::new(random.single(), random.single(), random.single());
            let p = lo + (hi - lo) * point();
            let d = (point() * 2.0 - 1.0).normalize();
            Ray {
                origin: p - d * if i % 3 == 0 { 0.0 } else { 30.0 },
                direction: d,
            }
        })
        .collect();
    let layers = 40;
    for (kind, c) in [
        (Kind::Trilinear, 0.1),
        (Kind::Quadratic, 0.03),
        (Kind::CubicInterpolating, 0.05),
    ] {
        let mut r = open(&OCTREE_GPU, &request(layers, knobs(kind)));
        let f = draw(&mut *r, &data, &[Surface::isovalue(c, 0)], &View::rays(rays.clone()));
        let oracle = Oracle::new(r.reconstruction(Stage::Stored).unwrap(), c);
        let (mut total, mut unlike) = (0, 0);
        for (i, ray) in rays.iter().enumerate() {
            let roots = oracle.all(ray).roots;
            let same = usize::from(f.hits[i]) == roots.len()
                && roots
                    .iter()
                    .enumerate()
                    .all(|(l, root)| root.distance(f.t[l * rays.len() + i]) < 1e-4);
            unlike += usize::from(!same && !oracle.undecidable(ray));
            total += roots.len();
        }
        assert!(total > 1500, "{kind}: {total} roots");
        assert_eq!(unlike, 0, "{kind}: rays with other roots of {}", rays.len());
    }
}

/// Several isovalues, one invisible, one semi-transparent, more hits than layers: as `octree/cpu`.
#[test]
fn layers_and_several_isovalues_are_those_of_the_cpu() {
    let Some(_gpu) = adapter("layers_and_several_isovalues_are_those_of_the_cpu") else {
        return;
    };
    let data = Arc::new(Data::Grid(random_grid([12, 9, 10], 1)));
    let mut surfaces = [15_000.5, -9_000.0, 300.0, 1.0e9, -20_000.0].map(|c| Surface::isovalue(c, 0));
    for (i, s) in surfaces.iter_mut().enumerate() {
        s.opacity = [0.3, 1.0, 0.0, 1.0, 0.5][i];
        s.colour = Surface::COLOURS[i];
    }
    let view = View::fit(data.bounds(), 40.0, 60, 45);
    let g = draw(
        &mut *open(&OCTREE_GPU, &request(4, Knobs::default())),
        &data,
        &surfaces,
        &view,
    );
    let c = draw(
        &mut *open(&OCTREE_CPU, &request(4, Knobs::default())),
        &data,
        &surfaces,
        &view,
    );
    let n = view.pixels();
    let a = Agreement::of(&g, &c, n, 1.0);
    let mut colours = g.rgba.iter().flatten().zip(c.rgba.iter().flatten());
    let colour = colours.by_ref().map(|(x, y)| (x - y).abs()).fold(0.0, f32::max);
    let hits: u64 = g.hits.iter().map(|h| u64::from(*h)).sum();
    assert!(hits > n as u64, "{hits} hits");
    assert!([0, 1, 4].iter().all(|s| g.surface.contains(s)) && !g.surface.contains(&2));
    assert_eq!((a.other, a.beyond), (0, 0), "{a:?}");
    assert!(colour < 1e-3, "{colour}");
}

/// Both forms of the code do the same operations: frames differ by what a compiler makes of them at most.
#[test]
fn looped_code_draws_what_unrolled_code_draws() {
    let Some(_gpu) = adapter("looped_code_draws_what_unrolled_code_draws") else {
        return;
    };
    let data = synthetic("marschner-lobb,n=25");
    let view = View::bench(56, 42);
    let mut r = open(&OCTREE_GPU, &request(3, Knobs::default()));
    for kind in [Kind::Trilinear, Kind::Quadratic, Kind::Cubic] {
        r.set_knobs(&knobs(kind)).unwrap();
        let a = draw(&mut *r, &data, &[Surface::isovalue(0.5, 0)], &view);
        r.set_knobs(&knobs(kind).with("loops", "looped")).unwrap();
        let b = redraw(&mut *r);
        assert_eq!(a.hits, b.hits, "{kind}");
        assert!(a.hits.iter().filter(|h| **h > 0).count() > 300);
        let apart = a.t.iter().zip(&b.t).filter(|(x, y)| x != y && (*x - *y).abs() > 1e-6).count();
        assert_eq!(apart, 0, "{kind}");
    }
}

/// hardcases B8: rays exactly along edges, diagonals and faces of cells hit as their neighbours do.
#[test]
fn rays_along_edges_and_faces_lose_nothing() {
    let Some(_gpu) = adapter("rays_along_edges_and_faces_lose_nothing") else {
        return;
    };
    let data = Arc::new(Data::Grid(sampled([11; 3], |x, y, z| {
        (x - 5.0).powi(2) + (y - 5.0).powi(2) + (z - 5.0).powi(2)
    })));
    let directions = [
        DVec3::X,
        DVec3::Y,
        -DVec3::Z,
        DVec3::new(1.0, 1.0, 0.0),
        DVec3::ONE,
        DVec3::new(0.0, -1.0, 1.0),
        // nearly parallel to faces
        DVec3::new(1.0, 1e-7, -1e-5),
        DVec3::new(1e-9, 1.0, 1e-12),
    ];
    let offsets = [0.0, 1e-9, -1e-9, 1.0].map(|e| DVec3::new(e, -e, e));
    let rays = isobar_scenes::trials::rays_towards(DVec3::splat(5.0), &directions, &offsets);
    for kind in [Kind::Trilinear, Kind::Quadratic, Kind::Cubic] {
        let mut r = open(&OCTREE_GPU, &request(4, knobs(kind)));
        let f = draw(&mut *r, &data, &[Surface::isovalue(9.5, 0)], &View::rays(rays.clone()));
        let oracle = Oracle::new(r.reconstruction(Stage::Stored).unwrap(), 9.5);
        for (i, ray) in rays.iter().enumerate() {
            let roots = oracle.all(ray).roots;
            assert_eq!(usize::from(f.hits[i]), roots.len(), "{kind} ray {i} {ray:?}: {roots:?}");
            for (l, root) in roots.iter().enumerate() {
                assert!(root.distance(f.t[l * rays.len() + i]) < 1e-5, "{kind} ray {i}");
            }
        }
    }
}

/// A large offset costs no digits (hardcases A17), and neither does a far eye or a large volume's far end.
#[test]
fn digits_are_kept_far_from_zero() {
    let Some(_gpu) = adapter("digits_are_kept_far_from_zero") else {
        return;
    };
    let mut r = open(&OCTREE_GPU, &request(1, Knobs::default()));
    let mut hit = |data: Grid, c: f64, ray: Ray| {
        let data = Arc::new(Data::Grid(data));
        draw(&mut *r, &data, &[Surface::isovalue(c, 0)], &View::rays(vec![ray])).t[0]
    };
    let along = |x: f64| Ray {
        origin: DVec3::new(x, 1.0, 1.0),
        direction: DVec3::X,
    };
    // 0.3 of a cell; the isovalue has no f32.
    let t = hit(sampled([9, 3, 3], |x, _, _| 1e6 + x / 16.0), 1e6 + 4.3 / 16.0, along(-1.0));
    assert!((t - 5.3).abs() < 2e-7, "{t}");
    let t = hit(sampled([9, 3, 3], |x, _, _| x), 4.3, along(-1e6));
    assert!((t - 1_000_004.3).abs() < 2e-7, "{t}");
    let t = hit(sampled([2001, 3, 3], |x, _, _| x - 1990.0), 0.3, along(-1.0));
    assert!((t - 1991.3).abs() < 1e-6, "{t}");
}

/// Isovalues equal to samples, plateaus (hardcases B5, B7): no panic, and what the oracle can decide is right.
#[test]
fn plateaus_are_hit_at_their_entry() {
    let Some(_gpu) = adapter("plateaus_are_hit_at_their_entry") else {
        return;
    };
    let ramp = [0.0, 1.0, 2.0, 2.0, 3.0, 4.0];
    let data = Arc::new(Data::Grid(sampled([6, 2, 2], |x, _, _| ramp[x as usize])));
    let rays = vec![
        Ray {
            origin: DVec3::new(-1.0, 0.5, 0.5),
            direction: DVec3::X,
        },
        Ray {
            origin: DVec3::new(6.0, 0.25, 0.75),
            direction: -DVec3::X,
        },
    ];
    let mut r = open(&OCTREE_GPU, &request(4, Knobs::default()));
    let f = draw(&mut *r, &data, &[Surface::isovalue(2.0, 0)], &View::rays(rays));
    assert_eq!(f.hits, [1, 1], "{:?}", f.t);
    assert!((f.t[0] - 3.0).abs() < 1e-6 && (f.t[1] - 3.0).abs() < 1e-6, "{:?}", f.t);
    isobar_scenes::trials::plateaus(|data, surfaces, view| {
        let c = checked(Knobs::default(), data, surfaces, view);
        assert_eq!((c.missed, c.false_hits, c.wrong_root), (0, 0, 0));
    });
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
    let mut r = open(&OCTREE_GPU, &request(2, Knobs::default().with("claims", "cpu")));
    let frame = draw(&mut *r, &data, &surfaces, &view);
    let c = against(&frame, &*r, &surfaces, &view);
    assert_eq!((c.refuted, c.missed + c.false_hits + c.wrong_root + c.wrong_surface), (0, 0));
    assert_eq!(c.unclaimed, 0, "pixels that are not proved");
    let hits = frame
        .claim
        .iter()
        .zip(&frame.t_error)
        .filter(|(c, e)| c.contains(Claim::EXISTS) && e.is_finite());
    assert!(hits.count() > 500);
    let counters = r.counters();
    let of = |name: &str| counters.0.iter().find(|(n, _)| *n == name).unwrap().1;
    assert!(of("proof microseconds") > 0 && of("pixels proved") > 3000 && of("pixels unlike the cpu") == 0);
    r.set_knobs(&Knobs::default()).unwrap();
    let plain = redraw(&mut *r);
    assert!(plain.claim.iter().all(|c| c.is_empty()) && plain.t == frame.t);
    // Claims are proved for frames that hold neither t nor surface, too.
    let only = Request {
        channels: Channels::CLAIM,
        ..request(1, Knobs::default().with("claims", "cpu"))
    };
    let bare = draw(&mut *open(&OCTREE_GPU, &only), &data, &surfaces, &view);
    assert_eq!((bare.claim, bare.t.len(), bare.surface.len()), (frame.claim, 0, 0));
}

/// Open cuts: rays begin behind the plane.
#[test]
fn clipping_planes_cut_rays() {
    let Some(_gpu) = adapter("clipping_planes_cut_rays") else {
        return;
    };
    let data = synthetic("sphere,n=33");
    let mut view = View {
        camera: Camera::Orthographic {
            eye: DVec3::new(-4.0, 0.0, 0.0),
            target: DVec3::ZERO,
            up: DVec3::Z,
            height: 0.1,
        },
        ..View::bench(3, 3)
    };
    let mut r = open(&OCTREE_GPU, &request(2, Knobs::default()));
    let whole = draw(&mut *r, &data, &[Surface::isovalue(1.0, 0)], &view);
    view.clips.push(ClipPlane {
        normal: DVec3::NEG_X,
        distance: 0.5,
        cap: false,
    });
    let cut = draw(&mut *r, &data, &[Surface::isovalue(1.0, 0)], &view);
    assert_eq!((whole.hits[4], cut.hits[4]), (2, 1));
    assert!((cut.t[4] - whole.t[9 + 4]).abs() < 1e-6 && cut.t[4] > 4.9);
}

/// Rays with more turns of loops than software Vulkan grants: all their hits, or the error that says so; never a frame with some.
#[test]
fn a_ray_the_driver_cuts_is_an_error() {
    let Some((_gpu, _one)) = adapter("a_ray_the_driver_cuts_is_an_error") else {
        return;
    };
    // Every second sample lies on the other side of isovalue 253 of 255, and every cell is compared with all below it: half a million turns.
    let data = Arc::new(Data::Grid(sampled(
        [2, 2, 2048],
        |_, _, z| if z % 2.0 == 0.0 { 25.25 } else { 25.35 },
    )));
    let surfaces: Vec<_> = (0..255).map(|i| Surface::isovalue(0.1 * f64::from(i), i as usize)).collect();
    let ray = isobar_core::Ray {
        origin: DVec3::new(0.5, 0.5, -1.0),
        direction: DVec3::Z,
    };
    let frames = [&OCTREE_CPU as &dyn isobar_core::Method, &OCTREE_GPU].map(|m| {
        let mut r = m
            .open(&Request {
                channels: Channels::T | Channels::HITS,
                ..Request::default()
            })
            .unwrap();
        r.set_view(&View::rays(vec![ray])).unwrap();
        r.set_surfaces(&surfaces).unwrap();
        r.set_data(&data).unwrap();
        r.render(&Stop::default()).unwrap();
        let mut frame = Frame::default();
        r.read(&mut frame).map(|()| frame.hits[0])
    });
    assert_eq!(*frames[0].as_ref().unwrap(), 2047);
    match &frames[1] {
        Ok(hits) => assert_eq!(*hits, 2047),
        Err(e) => {
            println!("{e}");
            assert!(e.to_string().contains("65,535 turns"), "{e}");
        }
    }
}
