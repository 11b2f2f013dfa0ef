//! Inputs that once led to wrong claims: rounded ends of the domain, planes behind the ray, directions next to parallel, samples at both ends of f32,
//! skew axes, eyes at the end of f64. Nothing is asked of the image but that no claim is refuted; nor may a frame take for ever.

use crate::TETSPLINE_CPU;
use isobar_core::{DMat3, DVec3, Data, Knobs, Ray, Surface, View};
use isobar_scenes::{against, cube, open, redraw, request, trials};
use std::sync::Arc;

/// Draws the rays with every reconstruction; the oracle refutes nothing.
fn hold(name: &str, data: &Arc<Data>, isovalue: f64, rays: &[Ray]) {
    let view = View::rays(rays.to_vec());
    hold_view(name, data, &[Surface::isovalue(isovalue, 0)], &view);
}

/// As [`hold`], for a view of several surfaces; gives the hits.
fn hold_view(name: &str, data: &Arc<Data>, surfaces: &[Surface], view: &View) -> usize {
    let mut hits = 0;
    for kind in ["type6", "type6-prefiltered"] {
        let mut r = open(&TETSPLINE_CPU, &request(1, Knobs::default().with("reconstruction", kind)));
        if let Err(e) = r.set_data(data) {
            panic!("{name}, {kind}: {e}");
        }
        r.set_surfaces(surfaces).unwrap();
        r.set_view(view).unwrap();
        let frame = redraw(&mut *r);
        let c = against(&frame, &*r, surfaces, view);
        assert_eq!(c.refuted, 0, "{name}, {kind}: {:?} {:?}", frame.t, frame.claim);
        hits += c.hits;
    }
    hits
}

/// Coefficients are worked out less the lowest isovalue: what that rounds away of the others belongs to their bounds, in packets and alone. And 255 isovalues are as many as fit.
#[test]
fn isovalues_far_from_the_data() {
    let noise = |[i, j, k]: [usize; 3]| ((i * 7 + j * 13 + k * 29) % 17) as f32 / 17.0;
    let data = cube(12, DVec3::ONE, DMat3::IDENTITY, noise);
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
fn hostile_inputs_prove_nothing_false() {
    trials::hostile(hold);
}

#[test]
fn samples_next_to_the_greatest() {
    let (data, rays) = trials::great_samples([1.0e38, 0.06e38]);
    hold("greatest", &data, 6e36, &rays);
}
