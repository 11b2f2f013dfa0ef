//! Inputs that once led to wrong claims: rounded ends of the domain, planes behind the ray, directions next to parallel, samples at both ends of f32,
//! skew axes, eyes at the end of f64. Nothing is asked of the image but that no claim is refuted; nor may a frame take for ever.

use crate::TETSPLINE_CPU;
use isobar_core::{Channels, DMat3, DVec3, Data, Frame, Grid, Knobs, Method, Ray, Request, Samples, Stage, Stop, Surface, View};
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
    let view = View::rays(rays.to_vec());
    hold_view(name, data, &[Surface::isovalue(isovalue, 0)], &view);
}

/// As [`hold`], for a view of several surfaces; gives the hits.
fn hold_view(name: &str, data: &Arc<Data>, surfaces: &[Surface], view: &View) -> usize {
    let mut hits = 0;
    for kind in ["type6", "type6-prefiltered"] {
        let mut r = TETSPLINE_CPU
            .open(&Request {
                channels: Channels::all(),
                knobs: Knobs::default().with("reconstruction", kind),
                ..Request::default()
            })
            .unwrap();
        if let Err(e) = r.set_data(data) {
            panic!("{name}, {kind}: {e}");
        }
        r.set_surfaces(surfaces).unwrap();
        r.set_view(view).unwrap();
        r.render(&Stop::default()).unwrap();
        let mut frame = Frame::default();
        r.read(&mut frame).unwrap();
        let f = r.reconstruction(Stage::Stored).unwrap();
        let truth = Truth::compute(&f, surfaces, view, &Stop::default()).unwrap();
        let c = check(&frame, &truth, &f, surfaces, view).unwrap();
        assert_eq!(c.refuted, 0, "{name}, {kind}: {:?} {:?}", frame.t, frame.claim);
        hits += c.hits;
    }
    hits
}

/// Coefficients are worked out less the lowest isovalue: what that rounds away of the others belongs to their bounds, in packets and alone. And 255 isovalues are as many as fit.
#[test]
fn isovalues_far_from_the_data() {
    let noise = |[i, j, k]: [usize; 3]| ((i * 7 + j * 13 + k * 29) % 17) as f32 / 17.0;
    let data = grid(12, DVec3::ONE, DMat3::IDENTITY, noise);
    let view = View::fit(data.bounds(), 40.0, 32, 24);
    for far in [-1e13, -1e9, 1e13] {
        let surfaces = [Surface::isovalue(far, 0), Surface::isovalue(0.5, 1)];
        assert!(hold_view(&format!("{far}"), &data, &surfaces, &view) > 300);
    }
    let many: Vec<_> = (0..255)
        .map(|i| Surface::isovalue(f64::from(i) / 255.0, i as usize))
        .collect();
    assert!(hold_view("255", &data, &many, &view) > 300);
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

#[test]
fn samples_at_both_ends_of_f32() {
    let data = grid(6, DVec3::ONE, DMat3::IDENTITY, |[x, _, z]| {
        let v = [0.0, 1.0e38, 0.0, 0.06e38, 0.0, 0.0][x];
        if z <= 2 { v } else { -v }
    });
    let rays: Vec<Ray> = (0..40)
        .map(|i| ray([6.0, 2.3, 2.0 + 0.025 * f64::from(i)], [-1.0, 0.0, 0.0]))
        .collect();
    hold("greatest", &data, 6e36, &rays);
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
