//! Frames against march/cpu (the same samples in f64) and against the f32 twin.

use crate::MARCH_CPU;
use crate::march_gpu::layout::Ray as DeviceRay;
use crate::march_gpu::programs::Filter;
use crate::march_gpu::{MARCH_GPU, twin};
use isobar_core::{Channels, DMat3, DVec3, Data, Frame, Function, Grid, Knobs, Ray, Request, Samples, Stage, Surface, View};
use isobar_fields::{GridSpline, Kind, Synthetic};
use isobar_gpu::levels::Level;
use isobar_gpu::rays::{Rectangle, ToIndex};
use isobar_gpu::test_adapter;
use isobar_scenes::{Random, draw, open, random_grid, redraw, sampled};
use std::sync::Arc;

/// GPU against the f32 twin, in voxels along the ray: a driver that fuses products into sums moves a root by roundings of s.
const TWIN_VOXELS: f64 = 1e-5;
/// GPU against march/cpu in f64, in voxels: positions are off by 2^-23 * (ray + axis) and s by a few 2^-24 of the coefficients; then the
/// bisections end up in neighbouring brackets of 2^-9 voxels.
const CPU_VOXELS: f64 = 4e-3;

fn every_channel() -> Channels {
    Channels::all() - Channels::WORK
}

fn request(layers: usize, knobs: Knobs) -> Request {
    Request {
        channels: every_channel(),
        layers,
        knobs,
        ..Request::default()
    }
}

/// Pixels of two frames that disagree: another number of hits, another surface, t or normal further apart than allowed.
struct Disagreement {
    hits: usize,
    surface: usize,
    t: usize,
    normal: usize,
    colour: usize,
}

fn compare(a: &Frame, b: &Frame, voxel: f64, voxels: f64) -> Disagreement {
    assert_eq!(
        (a.width, a.height, a.layers, a.channels),
        (b.width, b.height, b.layers, b.channels)
    );
    let n = a.width * a.height;
    let mut d = Disagreement {
        hits: 0,
        surface: 0,
        t: 0,
        normal: 0,
        colour: 0,
    };
    for i in 0..n {
        if a.hits[i] != b.hits[i] {
            d.hits += 1;
            continue;
        }
        for at in (0..a.layers).map(|l| l * n + i).take(a.hits[i] as usize) {
            d.surface += usize::from(a.surface[at] != b.surface[at]);
            d.t += usize::from((a.t[at] - b.t[at]).abs() > voxels * voxel);
            let dot: f32 = (0..3).map(|k| a.normal[at][k] * b.normal[at][k]).sum();
            d.normal += usize::from(dot < 0.9999);
            assert!((a.point[at] - b.point[at]).length() <= 2.0 * (a.t[at] - b.t[at]).abs() + 1e-12);
        }
        d.colour += usize::from((0..4).any(|k| (a.rgba[i][k] - b.rgba[i][k]).abs() > 0.01));
    }
    d
}

fn sphere() -> Arc<Data> {
    Arc::new("sphere,n=33".parse::<Synthetic>().unwrap().data().unwrap())
}

fn grid(data: &Data) -> &Grid {
    match data {
        Data::Grid(g) => g,
        _ => panic!("a grid is wanted"),
    }
}

/// All kinds, sphere, 128x96: hits, t, normal, colour against march/cpu.
#[test]
fn a_sphere_is_that_of_march_cpu() {
    if test_adapter("a_sphere_is_that_of_march_cpu").is_none() {
        return;
    }
    let data = sphere();
    let view = View::bench(128, 96);
    let surfaces = [Surface::isovalue(1.0, 0)];
    for kind in Kind::ALL {
        let knobs = Knobs::default().with("reconstruction", kind);
        let g = draw(&mut *open(&MARCH_GPU, &request(1, knobs.clone())), &data, &surfaces, &view);
        let c = draw(&mut *open(&MARCH_CPU, &request(1, knobs)), &data, &surfaces, &view);
        let d = compare(&g, &c, grid(&data).domain().voxel(), CPU_VOXELS);
        let hit = g.hits.iter().filter(|h| **h > 0).count();
        assert!(hit > 1500, "{kind}: {hit} pixels are hit");
        // At the silhouette two roots may fall into one step in f32 and not in f64.
        assert!(
            d.hits <= 2 && d.surface == 0 && d.t == 0,
            "{kind}: {} {} {}",
            d.hits,
            d.surface,
            d.t
        );
        // A trilinear normal jumps where a hit moves into the next cell.
        let jumps = if kind == Kind::Trilinear { 40 } else { 0 };
        assert!(d.normal <= jumps && d.colour <= jumps, "{kind}: {} {}", d.normal, d.colour);
    }
}

/// Random 16-bit noise: many surfaces, several isovalues in one step, four layers, semi-transparent.
#[test]
fn noise_with_layers_and_three_isovalues_is_that_of_march_cpu() {
    if test_adapter("noise_with_layers_and_three_isovalues_is_that_of_march_cpu").is_none() {
        return;
    }
    let data = Arc::new(Data::Grid(random_grid([12, 9, 10], 1)));
    let mut surfaces = [15_000.5, -9_000.0, 300.0, 1.0e9].map(|c| Surface::isovalue(c, 0));
    for (i, s) in surfaces.iter_mut().enumerate() {
        s.opacity = [0.3, 1.0, 0.0, 1.0][i];
        s.colour = Surface::COLOURS[i];
    }
    let view = View::fit(data.bounds(), 40.0, 90, 70);
    for kind in [Kind::Trilinear, Kind::Quadratic] {
        let knobs = Knobs::default().with("reconstruction", kind).with("bisections", 14);
        let mut gpu = open(&MARCH_GPU, &request(4, knobs.clone()));
        let g = draw(&mut *gpu, &data, &surfaces, &view);
        let c = draw(&mut *open(&MARCH_CPU, &request(4, knobs)), &data, &surfaces, &view);
        let d = compare(&g, &c, 1.0, CPU_VOXELS);
        let deep = g.hits.iter().filter(|h| **h > 4).count();
        assert!(deep > 100, "{deep} pixels have more hits than layers");
        assert!(g.surface.contains(&0) && g.surface.contains(&1) && !g.surface.contains(&2));
        assert!(
            d.hits <= 12 && d.surface <= 3 && d.t <= 6,
            "{kind}: {} {} {}",
            d.hits,
            d.surface,
            d.t
        );
        assert!(d.colour <= 30, "{kind}: {}", d.colour);
        // front to back
        let n = g.width * g.height;
        for i in 0..n {
            let ts: Vec<f64> = (0..4).map(|l| g.t[l * n + i]).collect();
            assert!(ts.windows(2).all(|w| w[0] <= w[1]), "{ts:?}");
        }
    }
}

/// The hits of the device are those of the f32 twin, for exact and emulated weights.
#[test]
fn hits_are_those_of_the_f32_twin() {
    if test_adapter("hits_are_those_of_the_f32_twin").is_none() {
        return;
    }
    let data = sphere();
    let view = View::bench(64, 48);
    let iso = 1.0;
    for (kind, word) in [
        (Kind::Trilinear, "exact"),
        (Kind::Trilinear, "bits8"),
        (Kind::QuadraticInterpolating, "exact"),
        (Kind::Quadratic, "bits9"),
        (Kind::Cubic, "exact"),
        (Kind::Cubic, "bits8"),
    ] {
        let knobs = Knobs::default()
            .with("reconstruction", kind)
            .with("filter", word)
            .with("bisections", 12);
        let f = draw(
            &mut *open(&MARCH_GPU, &request(3, knobs)),
            &data,
            &[Surface::isovalue(iso, 0)],
            &view,
        );
        let spline = GridSpline::new(grid(&data), kind, Stage::Stored).unwrap();
        let twin = twin::of(&spline, [iso as f32, 0.0], Filter::named(word));
        let levels = [Level {
            value: 0.0,
            opacity: 1.0,
            surface: 0,
            unused: 0,
            colour: [1.0; 3],
            unused_1: 0.0,
        }];
        let to = ToIndex::new(spline.domain(), false);
        let whole = Rectangle::whole(&view);
        let (rays, entries) = whole.rows(&view, 0, view.height, |r, kept| DeviceRay::new(&to, r, kept));
        let n = view.pixels();
        let (mut beyond, mut hits) = (0, 0);
        for (i, (ray, entry)) in rays.iter().zip(&entries).enumerate() {
            let want = twin.march(ray, 0.5, 12, &levels);
            let same = usize::from(f.hits[i]) == want.len()
                && want.iter().take(3).enumerate().all(|(l, (u, s))| {
                    let du = (f.t[l * n + i] - entry.t) * entry.speed - f64::from(*u);
                    f.surface[l * n + i] == *s as u8 && du.abs() <= TWIN_VOXELS
                });
            beyond += usize::from(!same);
            hits += want.len();
        }
        assert!(hits > 500, "{hits}");
        // A root exactly on a bracket's middle may go either way: then u differs by a bracket.
        assert!(beyond <= 3, "{kind} {word}: {beyond} of {hits}");
    }
}

/// Stepping over blocks changes no bit of the answer, only the work.
#[test]
fn skipping_changes_nothing_but_the_work() {
    if test_adapter("skipping_changes_nothing_but_the_work").is_none() {
        return;
    }
    let gyroid = Arc::new("gyroid,n=40".parse::<Synthetic>().unwrap().data().unwrap());
    let noise = Arc::new(Data::Grid(random_grid([20, 7, 33], 0)));
    let knobs = |kind: Kind, skip: &str| Knobs::default().with("reconstruction", kind).with("skip", skip);
    let mut r = open(
        &MARCH_GPU,
        &Request {
            channels: Channels::all(),
            ..request(3, Knobs::default())
        },
    );
    for (data, isos) in [(&gyroid, vec![0.2]), (&gyroid, vec![1.4, -1.2]), (&noise, vec![150.5, 90.5])] {
        let surfaces: Vec<_> = isos.iter().enumerate().map(|(i, c)| Surface::isovalue(*c, i)).collect();
        let view = View::fit(data.bounds(), 30.0, 64, 48);
        for kind in [Kind::Trilinear, Kind::Cubic] {
            r.set_knobs(&knobs(kind, "on")).unwrap();
            let mut on = draw(&mut *r, data, &surfaces, &view);
            r.set_knobs(&knobs(kind, "off")).unwrap();
            let mut off = redraw(&mut *r);
            assert!(on.hits.iter().any(|h| *h > 0));
            let work = |f: &mut Frame| std::mem::take(&mut f.work).iter().map(|w| u64::from(*w)).sum::<u64>();
            let (a, b) = (work(&mut on), work(&mut off));
            // Every block of the noise holds every isovalue.
            assert!(
                if Arc::ptr_eq(data, &gyroid) { a < b } else { a == b },
                "{kind}: {a} samples of {b}"
            );
            assert_eq!(on, off, "{kind} {isos:?}");
        }
    }
}

/// hardcases B14: every reconstruction reproduces linear functions, so that a plane is hit where it is.
#[test]
fn a_plane_is_hit_exactly() {
    if test_adapter("a_plane_is_hit_exactly").is_none() {
        return;
    }
    let n = 33;
    let (a, b, c, d) = (0.5, -0.25, 1.0, 3.0);
    let data = Arc::new(Data::Grid(sampled([n; 3], |x, y, z| a * x + b * y + c * z + d)));
    let iso = 16.0 * (a + b + c) + d + 0.125;
    let mut r = Random(3);
    // From all around, through the middle: the border rules bend a line near the faces.
    let rays: Vec<Ray> = (0..300)
        .map(|_| {
            let mut p = |s: f64| DVec3::new(r.single() - 0.5, r.single() - 0.5, r.single() - 0.5) * s + 16.0;
            let at = p(6.0);
            let origin = at + (p(2.0) - 16.0).normalize() * 100.0;
            Ray {
                origin,
                direction: (at - origin).normalize(),
            }
        })
        .collect();
    let normal = DVec3::new(a, b, c).normalize();
    for kind in Kind::ALL {
        let knobs = Knobs::default().with("reconstruction", kind).with("bisections", 40);
        let f = draw(
            &mut *open(&MARCH_GPU, &request(1, knobs)),
            &data,
            &[Surface::isovalue(iso, 0)],
            &View::rays(rays.clone()),
        );
        let mut checked = 0;
        for (i, ray) in rays.iter().enumerate() {
            let slope = DVec3::new(a, b, c).dot(ray.direction);
            let t = (iso - d - DVec3::new(a, b, c).dot(ray.origin)) / slope;
            if (ray.at(t) - 16.0).abs().max_element() > 8.0 {
                continue;
            }
            checked += 1;
            // Positions in f32, 2^-23 * (57 + 32) voxels, s in f32 (|c| <= 50: 24 * 3e-6) over the slope.
            let bound = 1.1e-5 + 7.2e-5 / slope.abs();
            assert!(
                (f.t[i] - t).abs() <= bound,
                "{kind} ray {i}: {} for {t}, bound {bound}",
                f.t[i]
            );
            let got = DVec3::from_array(f.normal[i].map(f64::from));
            assert!((got - normal).length() < 1e-4, "{kind} {got}");
        }
        assert!(checked > 150, "{checked}");
    }
}

/// hardcases A17: values around a million with a range of 0.01 keep their digits, because the isovalue is taken away before anything
/// is multiplied. (f32 samples hold 1e6 + k/16.)
#[test]
fn a_large_offset_costs_no_digits() {
    if test_adapter("a_large_offset_costs_no_digits").is_none() {
        return;
    }
    let data = Arc::new(Data::Grid(sampled([9, 3, 3], |x, _, _| 1e6 + x / 16.0)));
    let ray = Ray {
        origin: DVec3::new(-1.0, 1.0, 1.0),
        direction: DVec3::X,
    };
    let knobs = Knobs::default().with("bisections", 20);
    let mut r = open(&MARCH_GPU, &request(1, knobs));
    // 0.3 of a cell; the isovalue has no f32.
    let f = draw(
        &mut *r,
        &data,
        &[Surface::isovalue(1e6 + 4.3 / 16.0, 0)],
        &View::rays(vec![ray]),
    );
    assert!((f.t[0] - 5.3).abs() < 2e-6, "{}", f.t[0]);
}

/// Skew, anisotropic, left-handed geometry: as march/cpu, and normals along the world gradient.
#[test]
fn oblique_grids_are_drawn_in_the_world() {
    if test_adapter("oblique_grids_are_drawn_in_the_world").is_none() {
        return;
    }
    let plain = sampled([14, 20, 11], |x, y, z| {
        (x - 6.0).powi(2) + 0.3 * (y - 9.0).powi(2) + (z - 5.0).powi(2)
    });
    let direction = DMat3::from_cols(
        DVec3::new(0.0, 0.8, 0.6),
        DVec3::new(1.0, 0.0, 0.0),
        DVec3::new(0.0, 0.28, 0.96),
    );
    let spacing = DVec3::new(1.0, 0.5, 2.0) * 1e3;
    let g = Grid::new(plain.dims, spacing, DVec3::new(5e3, -2e3, 1e3), direction, plain.samples).unwrap();
    let voxel = g.domain().voxel();
    let data = Arc::new(Data::Grid(g));
    let view = View::fit(data.bounds(), 40.0, 100, 80);
    let surfaces = [Surface::isovalue(16.25, 0)];
    let knobs = Knobs::default().with("reconstruction", "cubic");
    let gpu = draw(&mut *open(&MARCH_GPU, &request(2, knobs.clone())), &data, &surfaces, &view);
    let cpu = draw(&mut *open(&MARCH_CPU, &request(2, knobs)), &data, &surfaces, &view);
    let d = compare(&gpu, &cpu, voxel, CPU_VOXELS * 4.0);
    let through = gpu.hits.iter().filter(|h| **h == 2).count();
    assert!(through > 200, "{through} pixels are hit twice");
    assert!(
        d.hits <= 1 && d.t == 0 && d.normal == 0 && d.colour == 0,
        "{} {} {} {}",
        d.hits,
        d.t,
        d.normal,
        d.colour
    );
}

/// Fixed-point weights move hits: by more than f32 does, by less with one more bit.
#[test]
fn emulated_filtering_moves_hits_and_a_ninth_bit_halves_it() {
    if test_adapter("emulated_filtering_moves_hits_and_a_ninth_bit_halves_it").is_none() {
        return;
    }
    let data = sphere();
    let view = View::bench(96, 72);
    for kind in [Kind::Trilinear, Kind::Cubic] {
        let knobs = |filter: &str| {
            Knobs::default()
                .with("reconstruction", kind)
                .with("bisections", 16)
                .with("filter", filter)
        };
        let mut r = open(&MARCH_GPU, &request(1, knobs("exact")));
        let exact = draw(&mut *r, &data, &[Surface::isovalue(1.0, 0)], &view);
        let mut medians = Vec::new();
        for filter in ["bits8", "bits9"] {
            r.set_knobs(&knobs(filter)).unwrap();
            let f = redraw(&mut *r);
            let voxel = grid(&data).domain().voxel();
            let mut e: Vec<f64> = (0..view.pixels())
                .filter(|&i| f.hits[i] == exact.hits[i] && f.hits[i] > 0)
                .map(|i| (f.t[i] - exact.t[i]).abs() / voxel)
                .collect();
            e.sort_by(f64::total_cmp);
            medians.push(e[e.len() / 2]);
        }
        assert!(medians[0] > 2e-4 && medians[0] < 1e-2, "{kind}: {medians:?}");
        assert!(
            medians[1] < 0.7 * medians[0] && medians[1] > 0.3 * medians[0],
            "{kind}: {medians:?}"
        );
    }
}

/// Values from 2x2x2 up, every sample type, one view inside the volume.
#[test]
fn small_grids_and_every_sample_type_are_drawn() {
    if test_adapter("small_grids_and_every_sample_type_are_drawn").is_none() {
        return;
    }
    let ramp = |i: usize| (i % 2) as f64 * 200.0;
    let all = [
        Samples::U8((0..8).map(|i| ramp(i) as u8).collect()),
        Samples::I16((0..8).map(|i| ramp(i) as i16).collect()),
        Samples::U16((0..8).map(|i| ramp(i) as u16).collect()),
        Samples::F32((0..8).map(|i| ramp(i) as f32).collect()),
    ];
    let from = |x: f64, dx: f64| Ray {
        origin: DVec3::new(x, 0.25, 0.75),
        direction: DVec3::X * dx,
    };
    // From outside, from inside, away from the surface, in units of the direction, along the face of the domain.
    let mut rays = vec![from(-2.0, 1.0), from(0.25, 1.0), from(0.75, 1.0), from(0.75, -0.125)];
    rays.push(Ray {
        origin: DVec3::new(-1.0, 0.0, 1.0),
        direction: DVec3::X,
    });
    let mut r = open(&MARCH_GPU, &request(1, Knobs::default()));
    for samples in all {
        let name = samples.type_name();
        let data = Arc::new(Data::Grid(Grid::unit([2; 3], samples).unwrap()));
        for kind in Kind::ALL {
            let knobs = Knobs::default().with("reconstruction", kind).with("bisections", 20);
            r.set_knobs(&knobs).unwrap();
            let f = draw(&mut *r, &data, &[Surface::isovalue(100.0, 0)], &View::rays(rays.clone()));
            // All are odd about the middle, where s = 100.
            for (t, want) in f.t.iter().zip([2.5, 0.25, f64::INFINITY, 2.0, 1.5]) {
                assert!(*t == want || (t - want).abs() < 2e-6, "{name} {kind}: {:?}", f.t);
            }
        }
    }
}

/// Rays with more turns of loops than software Vulkan grants: all their hits, or the error that says so; never a frame with some.
#[test]
fn a_ray_the_driver_cuts_is_an_error() {
    if test_adapter("a_ray_the_driver_cuts_is_an_error").is_none() {
        return;
    }
    // Every second sample lies on the other side of isovalue 253 of 255; each sample is compared with all below it: a million turns.
    let data = Arc::new(Data::Grid(sampled(
        [2, 2, 2048],
        |_, _, z| if z % 2.0 == 0.0 { 25.25 } else { 25.35 },
    )));
    let surfaces: Vec<_> = (0..255).map(|i| Surface::isovalue(0.1 * f64::from(i), i as usize)).collect();
    let ray = Ray {
        origin: DVec3::new(0.5, 0.5, -1.0),
        direction: DVec3::Z,
    };
    let frames = [&MARCH_CPU as &dyn isobar_core::Method, &MARCH_GPU].map(|m| {
        let mut r = open(m, &request(1, Knobs::default()));
        r.set_view(&View::rays(vec![ray])).unwrap();
        r.set_surfaces(&surfaces).unwrap();
        r.set_data(&data).unwrap();
        r.render(&isobar_core::Stop::default()).unwrap();
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
