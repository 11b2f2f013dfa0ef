//! No cracks: rays about the borders of levels, through the caster of this crate.

use crate::wavelet::{Adaptive, Bank, Extent, Pyramid, Selection};
use glam::DVec3;
use isobar_core::{Data, Frame, Function, Grid, Method, Ray, Request, Samples, Stage, Stop, Surface, View};
use isobar_fields::{GridSpline, Kind};
use std::sync::Arc;

/// Numbers in [0, 1) that look random.
pub(super) struct Random(pub(super) u64);

impl Random {
    pub(super) fn next(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    pub(super) fn vector(&mut self) -> DVec3 {
        DVec3::new(self.next(), self.next(), self.next())
    }
}

/// A wavy function with some noise, in 40 x 24 x 24 samples.
fn grid() -> Grid {
    let mut random = Random(0x1234_5678_9abc_def1);
    let samples: Vec<f32> = (0..40 * 24 * 24)
        .map(|i| {
            let p = DVec3::new((i % 40) as f64, (i / 40 % 24) as f64, (i / 960) as f64) * 0.45;
            (p.x.sin() * p.y.cos() + p.y.sin() * p.z.cos() + p.z.sin() * p.x.cos() + 0.3 * random.next()) as f32
        })
        .collect();
    Grid::unit([40, 24, 24], Samples::F32(samples.into())).unwrap()
}

const RAYS: usize = 120_000;
const STEPS: usize = 12;

#[test]
fn every_sign_change_about_a_border_is_hit() {
    for (bank, kind) in [
        (Bank::Psi22, Kind::Trilinear),
        (Bank::Psi31, Kind::Quadratic),
        (Bank::Psi42, Kind::Cubic),
    ] {
        let pyramid = Arc::new(Pyramid::new(&grid(), bank).unwrap());
        let mut selection = Selection::whole(&pyramid, true);
        // Level 0 only at low x: it is drawn up to x = 16, coarser behind.
        for x in 1..5 {
            for i in 0..9 {
                selection.level_mut(0).set([x, i % 3, i / 3], false);
            }
        }
        let mut adaptive = Adaptive::new(pyramid);
        adaptive.update(&selection, Extent::Drawn);
        assert_eq!(adaptive.level_map().0[..5], [0, 0, 1, 1, 1]);
        let coefficients = adaptive.grid().unwrap();
        let function = GridSpline::new(&coefficients, kind, Stage::Stored).unwrap();
        let mut random = Random(99);
        let rays: Vec<Ray> = (0..RAYS)
            .map(|_| Ray {
                origin: DVec3::new(13.0, 3.0, 3.0) + random.vector() * DVec3::new(6.0, 17.0, 17.0),
                direction: (random.vector() - 0.5).normalize(),
            })
            .collect();
        let mut renderer = crate::OCTREE_CPU
            .open(&Request {
                knobs: isobar_core::Knobs::default().with("reconstruction", kind.name()),
                ..Request::default()
            })
            .unwrap();
        renderer.set_data(&Arc::new(Data::Grid(coefficients))).unwrap();
        renderer.set_surfaces(&[Surface::isovalue(0.25, 0)]).unwrap();
        // A list of rays is an image one pixel high: at most 65,536 of them.
        let mut hits = Vec::with_capacity(rays.len());
        for part in rays.chunks(60_000) {
            renderer.set_view(&View::rays(part.to_vec())).unwrap();
            renderer.render(&Stop::default()).unwrap();
            let mut frame = Frame::default();
            renderer.read(&mut frame).unwrap();
            hits.extend_from_slice(&frame.t);
        }
        let mut changes = 0;
        for (ray, &t) in rays.iter().zip(&hits) {
            let at = |t: f64| function.value(ray.at(t)) - 0.25;
            let first = at(0.0);
            let Some(end) = (1..=STEPS).map(|i| i as f64 * 0.25).find(|&t| (at(t) > 0.0) != (first > 0.0)) else {
                continue;
            };
            changes += 1;
            assert!(t <= end, "{kind}: a sign changes before {end} on {ray:?}, the hit is at {t}");
            assert!(at(t).abs() < 1e-9, "{kind}: {} at the hit {t} of {ray:?}", at(t));
        }
        assert!(changes > RAYS / 4, "{changes}");
    }
}
