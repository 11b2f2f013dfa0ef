//! Inputs that once led to wrong claims: rounded ends of the domain, planes behind the ray, directions next to parallel, samples at both ends of f32,
//! skew axes, eyes at the end of f64. Nothing is asked of the image but that no claim is refuted; nor may a frame take for ever.

use crate::OCTREE_CPU;
use isobar_core::{Channels, DMat3, DVec3, Data, Frame, Grid, Knobs, Method, Ray, Request, Samples, Stage, Stop, Surface, View};
use isobar_fields::Kind;
use isobar_oracle::{Truth, check};
use std::sync::Arc;

fn ray(origin: [f64; 3], direction: [f64; 3]) -> Ray {
    Ray {
        origin: DVec3::from_array(origin),
        direction: DVec3::from_array(direction),
    }
}

fn grid(n: usize, spacing: DVec3, axes: DMat3, sample: impl Fn([usize; 3]) -> f32) -> Arc<Data> {
    let samples: Arc<[f32]> = (0..n * n * n).map(|i| sample([i % n, i / n % n, i / n / n])).collect();
    Arc::new(Data::Grid(
        Grid::new([n; 3], spacing, DVec3::ZERO, axes, Samples::F32(samples)).unwrap(),
    ))
}

/// Draws the rays with every reconstruction; the oracle refutes nothing.
fn hold(name: &str, data: &Arc<Data>, isovalue: f64, rays: &[Ray]) {
    let surfaces = [Surface::isovalue(isovalue, 0)];
    let view = View::rays(rays.to_vec());
    for kind in Kind::ALL {
        let mut r = OCTREE_CPU
            .open(&Request {
                channels: Channels::all(),
                knobs: Knobs::default().with("reconstruction", kind.name()),
                ..Request::default()
            })
            .unwrap();
        if let Err(e) = r.set_data(data) {
            panic!("{name}, {kind}: {e}");
        }
        r.set_surfaces(&surfaces).unwrap();
        r.set_view(&view).unwrap();
        r.render(&Stop::default()).unwrap();
        let mut frame = Frame::default();
        r.read(&mut frame).unwrap();
        let f = r.reconstruction(Stage::Stored).unwrap();
        let truth = Truth::compute(&f, &surfaces, &view, &Stop::default()).unwrap();
        let c = check(&frame, &truth, &f, &surfaces, &view).unwrap();
        assert_eq!(c.refuted, 0, "{name}, {kind}: {:?} {:?}", frame.t, frame.claim);
    }
}

#[test]
fn a_face_that_rounding_puts_before_the_ray() {
    let data = grid(11, DVec3::splat(0.3), DMat3::IDENTITY, |[x, _, _]| x as f32);
    // 3.0 is beyond the last sample, 10 * fl(0.3), by less than its index rounds by.
    hold("face", &data, 4.5, &[ray([-5.0, 1.5, 3.0], [1.0, 0.0, 0.0])]);
    let data = grid(65, DVec3::ONE, DMat3::IDENTITY, |[x, _, _]| (x as f32 - 1.75).abs());
    let slow = -(2f64.powi(-46)) / 1.5;
    hold(
        "grazing",
        &data,
        0.5,
        &[ray([0.0, 1.5, 64.0 + 2f64.powi(-46)], [1.0, 0.0, slow])],
    );
}

/// Rays that meet an edge of the domain almost within one of its two faces: the other face decides where they enter, and rounding decides which. The stretch in question is
/// up to some voxels long, and noise has roots in it.
#[test]
fn edges_of_the_domain() {
    let mut seed = 99u64;
    let mut unit = || {
        seed = seed
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (seed >> 11) as f64 / (1u64 << 53) as f64
    };
    let n = 6;
    let values: Vec<f32> = (0..n * n * n).map(|_| unit() as f32).collect();
    let data = grid(n, DVec3::splat(0.3), DMat3::IDENTITY, |[x, y, z]| values[(z * n + y) * n + x]);
    let most = (n - 1) as f64 * 0.3;
    let mut rays = Vec::new();
    for i in 0..600 {
        let axes = [[0, 1, 2], [1, 2, 0], [2, 0, 1], [1, 0, 2], [2, 1, 0], [0, 2, 1]][i % 6];
        let far = 10f64.powf(3.0 * unit());
        // Along the first axis, next to a face of the second one.
        let slope = 10f64.powf(-16.0 + 3.0 * unit()) * far * if unit() < 0.5 { -1.0 } else { 1.0 };
        let (mut p, mut d) = ([0.0; 3], [0.0; 3]);
        p[axes[0]] = if unit() < 0.5 { 0.0 } else { most };
        p[axes[1]] = if unit() < 0.5 { 0.0 } else { most };
        p[axes[2]] = most * unit();
        d[axes[0]] = if unit() < 0.5 { -1.0 } else { 1.0 };
        d[axes[1]] = slope;
        d[axes[2]] = unit() - 0.5;
        // Past the edge by some of what rounding makes of the position.
        p[axes[1]] += (unit() - 0.5) * 4e-16 * far;
        let origin = std::array::from_fn(|a| p[a] - far * d[a]);
        rays.push(ray(origin, d));
    }
    for isovalue in [0.3, 0.5, 0.7] {
        hold("edges", &data, isovalue, &rays);
    }
}

/// Past the edge of x = 0 and the greatest z: rounding puts the plane of z before that of x, which then decides where the ray enters, a twentieth of a unit too early; and the root
/// lies between the two. Only a domain shrunk by the bound tells, since the grown one is entered by x too (`isobar_cpu::index::ends`).
#[test]
fn an_edge_that_rounding_moves() {
    let data = grid(41, DVec3::splat(0.3), DMat3::IDENTITY, |[x, _, _]| x as f32);
    // 12 is beyond the last sample, 40 * fl(0.3), by less than its index rounds by; five units in its last place.
    let five = 5.0 * (12.0f64.next_up() - 12.0);
    let rays: Vec<Ray> = (0..20)
        .map(|i| ray([-1.0, 0.5 + 0.55 * f64::from(i), 12.0 + five], [1.0, 0.0, -five]))
        .collect();
    // In the first sixth of a voxel: of degree 1, 2 and 3.
    for isovalue in [0.05, 0.1, 0.15, 0.17, 0.2, 0.22] {
        hold("edge", &data, isovalue, &rays);
    }
}

#[test]
fn a_plane_behind_the_ray() {
    let data = grid(50, DVec3::ONE, DMat3::IDENTITY, |[x, y, z]| {
        if (x, y, z) == (0, 20, 25) { 0.0 } else { 6.0 + 2.0 * x as f32 }
    });
    let r = ray([-1.5, 20.3, 24.999_999_999_999_996], [1.0, 0.0, 5.370_822_105_685_78e-16]);
    hold("plane", &data, 5.0, &[r]);
}

#[test]
fn directions_next_to_parallel_and_eyes_at_the_end_of_numbers() {
    let data = grid(9, DVec3::ONE, DMat3::IDENTITY, |[x, y, z]| (x + y + z) as f32);
    let rays = [
        ray([-1.0, 3.3, 3.4], [1.0, 1e-310, 0.0]),
        ray([-1.0, 3.3, 3.4], [1.0, -1e-200, 1e-305]),
        ray([-1e120, 1e119, 3.0], [1.0, -0.1, 0.0]),
        ray([1e18, 1e18, 1e18], [-1.0, -1.0, -1.0]),
    ];
    hold("parallel", &data, 9.5, &rays);
}

/// Directions so short that parameters of planes overflow, or almost; t itself is still a number.
#[test]
fn directions_of_next_to_nothing() {
    let data = grid(9, DVec3::ONE, DMat3::IDENTITY, |[x, y, z]| (x + y + z) as f32);
    let mut rays = Vec::new();
    for size in [1e-306, 3e-307, 5e-309, 1e-310, 1e-323] {
        for (p, d) in [
            ([-1.0, 3.3, 3.4], [1.0, 0.0, 0.0]),
            ([3.0, 3.3, 3.4], [1.0, 0.0, 0.0]),
            ([1000.0, 1000.0, 1000.0], [-1.0, -1.0, -1.0]),
            ([-1000.0, 2.0, 3.0], [1.0, 0.0, 0.0]),
            ([2.0, 3.0, 1.0], [0.0, -1.0, 1.0]),
            ([-1.0, 20.0, 1.0], [1.0, 0.0, 0.0]),
        ] {
            rays.push(ray(p, d.map(|d: f64| d * size)));
        }
    }
    for isovalue in [9.5, 20.25] {
        hold("short", &data, isovalue, &rays);
    }
}

#[test]
fn samples_at_both_ends_of_f32() {
    let data = grid(6, DVec3::ONE, DMat3::IDENTITY, |[x, _, z]| {
        let v = [0.0, 3.3e38, 0.0, 0.2e38, 0.0, 0.0][x];
        if z <= 2 { v } else { -v }
    });
    let rays: Vec<Ray> = (0..40)
        .map(|i| ray([6.0, 2.3, 2.0 + 0.025 * f64::from(i)], [-1.0, 0.0, 0.0]))
        .collect();
    // The interpolating coefficients of these exceed f32 and are refused or proved, never wrong; the plain kinds are what failed.
    hold(
        "greatest",
        &grid(6, DVec3::ONE, DMat3::IDENTITY, |[x, _, z]| {
            let v = [0.0, 3.3e37, 0.0, 0.2e37, 0.0, 0.0][x];
            if z <= 2 { v } else { -v }
        }),
        2e36,
        &rays,
    );
    for kind in [Kind::Trilinear, Kind::Quadratic, Kind::Cubic] {
        let surfaces = [Surface::isovalue(2e37, 0)];
        let view = View::rays(rays.clone());
        let request = Request {
            channels: Channels::all(),
            knobs: Knobs::default().with("reconstruction", kind.name()),
            ..Request::default()
        };
        let mut r = OCTREE_CPU.open(&request).unwrap();
        r.set_data(&data).unwrap();
        r.set_surfaces(&surfaces).unwrap();
        r.set_view(&view).unwrap();
        r.render(&Stop::default()).unwrap();
        let mut frame = Frame::default();
        r.read(&mut frame).unwrap();
        let f = r.reconstruction(Stage::Stored).unwrap();
        let truth = Truth::compute(&f, &surfaces, &view, &Stop::default()).unwrap();
        assert!(truth.hits() > 0);
        let c = check(&frame, &truth, &f, &surfaces, &view).unwrap();
        assert_eq!((c.refuted, c.missed, c.false_hits), (0, 0, 0), "{kind}");
    }
    let u = f32::from_bits(1);
    let data = grid(
        6,
        DVec3::ONE,
        DMat3::IDENTITY,
        |[x, _, _]| if x < 3 { 4.0 * u } else { 5.0 * u },
    );
    let rays: Vec<Ray> = (0..20)
        .map(|i| ray([-1.0, 1.0 + 0.1 * f64::from(i), 2.3], [1.0, 0.0, 0.0]))
        .collect();
    hold("least", &data, 4.5 * f64::from(u), &rays);
}

#[test]
fn axes_next_to_a_plane() {
    for angle in [1e-2, 1e-4, 1e-6f64] {
        let axes = DMat3::from_cols(DVec3::X, DVec3::new(angle.cos(), angle.sin(), 0.0), DVec3::Z);
        let data = grid(9, DVec3::ONE, axes, |[x, y, z]| (x + 2 * y + z) as f32);
        let rays: Vec<Ray> = (0..200)
            .map(|i| {
                let s = 4.0 * f64::from(i) / 200.0;
                ray([2.0 + 2.0 * s, s * angle, -1.0], [0.1, 0.0, 1.0])
            })
            .collect();
        hold("skew", &data, 12.25, &rays);
    }
}
