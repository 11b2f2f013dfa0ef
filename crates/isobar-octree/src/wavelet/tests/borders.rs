//! No cracks: a million rays in packets, and as many alone, aimed at the curves in which the surface crosses borders of levels (S17).

use super::multires::{BANKS, waves};
use super::rays::Random;
use crate::wavelet::{Adaptive, Extent, Multiresolution, Pyramid, Selection};
use glam::DVec3;
use isobar_core::{Channels, Domain, Function, Ray, Stage, Stop, Surface, View};
use isobar_fields::{GridSpline, Kind};
use rayon::prelude::*;
use std::sync::Arc;

const VALUE: f64 = -0.5;

/// Faces between levels: axis, and where it is along it in voxels.
const BORDERS: [(usize, f64); 4] = [(0, 16.0), (1, 24.0), (0, 32.0), (0, 64.0)];

/// Half the stretch of a ray about a border whose ends tell whether the surface is between them, voxels.
const ABOUT: f64 = 0.01;

/// A volume of four levels.
struct Scene {
    levels: Multiresolution,
    function: GridSpline,
    domain: Domain,
    random: Random,
    /// By border, points of it on the surface.
    points: Vec<Vec<DVec3>>,
}

impl Scene {
    fn new(bank: crate::wavelet::Bank, kind: Kind) -> Self {
        // Sizes of which all coarse lattices end with the domain.
        let dims = if bank.degree() == 2 { [96, 48, 32] } else { [97, 49, 33] };
        let grid = waves(dims, DVec3::ONE, 0.15);
        let pyramid = Arc::new(Pyramid::new(&grid, bank).unwrap());
        let selection = Selection::by(&pyramid, |n| n.chunk[0] < 1 && (n.level > 0 || n.chunk[1] < 2));
        let mut levels = Multiresolution::new(pyramid.clone(), Channels::T, 0).unwrap();
        levels.set_surfaces(&[Surface::isovalue(VALUE, 0)]).unwrap();
        levels.select(&selection).unwrap();
        let drawn: Vec<usize> = levels.levels().map(|l| l.0).collect();
        assert_eq!(drawn, [0, 1, 2, 3]);
        let mut adaptive = Adaptive::new(pyramid);
        adaptive.update(&selection, Extent::Whole);
        let function = GridSpline::new(&adaptive.grid().unwrap(), kind, Stage::Stored).unwrap();
        let mut scene = Self {
            levels,
            function,
            domain: grid.domain(),
            random: Random(99),
            points: Vec::new(),
        };
        // Quadratic pieces begin half a fine step before those of the other degrees.
        let shift = if bank.degree() == 2 { 0.5 } else { 0.0 };
        for (axis, at) in BORDERS {
            let points = scene.on_the_surface(axis, at - shift);
            assert!(points.len() > 10, "{kind}: {} points at {at} of axis {axis}", points.len());
            scene.points.push(points);
        }
        scene
    }

    fn above(&self, p: DVec3) -> f64 {
        self.function.value(self.domain.world(p)) - VALUE
    }

    /// Points of a face between levels that lie on the surface, well inside the domain.
    fn on_the_surface(&mut self, axis: usize, at: f64) -> Vec<DVec3> {
        let (lo, hi) = (DVec3::splat(5.0), self.domain.hi - 5.0);
        // The level at 24 ends where the next border is.
        let hi = if axis == 1 { DVec3::new(15.0, hi.y, hi.z) } else { hi };
        let mut points = Vec::new();
        for _ in 0..3000 {
            let mut end = || {
                let mut p = lo + self.random.vector() * (hi - lo);
                p[axis] = at;
                p
            };
            let (mut a, mut b) = (end(), end());
            if (self.above(a) > 0.0) == (self.above(b) > 0.0) {
                continue;
            }
            for _ in 0..50 {
                let m = (a + b) * 0.5;
                if (self.above(m) > 0.0) == (self.above(a) > 0.0) {
                    a = m
                } else {
                    b = m
                }
            }
            points.push(a);
            if points.len() == 200 {
                break;
            }
        }
        points
    }

    /// A direction that crosses the border.
    fn direction(&mut self, axis: usize) -> DVec3 {
        loop {
            let d = (self.random.vector() - 0.5).normalize();
            if d[axis].abs() > 0.2 {
                return d;
            }
        }
    }

    /// A point beside one of a border's: beside it by a hundredth of a voxel or up to 10^5 times less, in the plane of the border.
    fn beside(&mut self, border: usize) -> DVec3 {
        let points = &self.points[border];
        let p = points[(self.random.next() * points.len() as f64) as usize];
        let mut off = (self.random.vector() - 0.5) * 10f64.powf(-2.0 - 5.0 * self.random.next());
        off[BORDERS[border].0] = 0.0;
        p + off
    }

    /// Checks the first hits of rays that were aimed at a border: how many of them cross the surface there.
    fn checked(&self, border: usize, rays: impl IndexedParallelIterator<Item = Ray>, hits: &[f64]) -> usize {
        let axis = BORDERS[border].0;
        let at = self.points[border][0][axis];
        rays.zip(hits)
            .map(|(ray, &t)| {
                let (o, d) = (self.domain.local(ray.origin), self.domain.local_vector(ray.direction));
                let above = |t: f64| self.above(o + d * t);
                // In the last voxel of degree 3 coarse levels differ by the border rule.
                let hit = o + d * t;
                if t.is_finite() && hit.min(self.domain.hi - hit).min_element() > 1.0 {
                    assert!(above(t).abs() < 1e-4, "{} at the hit {t} of {ray:?}", above(t));
                }
                let crossed = (at - o[axis]) / d[axis];
                let p = o + d * crossed;
                let aimed = crossed > ABOUT && p.min_element() > 4.0 && (self.domain.hi - p).min_element() > 4.0;
                let (before, after) = (above(crossed - ABOUT), above(crossed + ABOUT));
                let changes = aimed && before.abs().min(after.abs()) > 1e-5 && (before > 0.0) != (after > 0.0);
                assert!(
                    !changes || t < crossed + ABOUT,
                    "the sign changes about {crossed} on {ray:?}, across axis {axis} at {at}; the hit is at {t}"
                );
                usize::from(changes)
            })
            .sum()
    }
}

#[test]
fn no_ray_in_packets_slips_through() {
    let (mut rays, mut crossings) = (0, 0);
    for (bank, kind) in BANKS {
        let mut scene = Scene::new(bank, kind);
        for i in 0..112 {
            let border = i % BORDERS.len();
            let (p, d) = (scene.beside(border), scene.direction(BORDERS[border].0));
            let far = 1.0 + 4.0 * scene.random.next();
            let fov = 10f64.powf(0.5 - 4.0 * scene.random.next());
            let eye = scene.domain.world(p - d * far);
            let up = if d.z.abs() < 0.8 { DVec3::Z } else { DVec3::X };
            let view = View::perspective(eye, scene.domain.world(p), up, fov, 64, 48);
            scene.levels.render(&view, &Stop::default()).unwrap();
            let all = (0..view.pixels())
                .into_par_iter()
                .map(|i| view.ray(i % view.width, i / view.width));
            crossings += scene.checked(border, all, &scene.levels.frame().t);
            rays += view.pixels();
        }
    }
    assert!(rays > 1_000_000 && crossings * 2 > rays, "{crossings} of {rays}");
}

#[test]
fn no_ray_alone_slips_through() {
    let (mut rays, mut crossings) = (0, 0);
    for (bank, kind) in BANKS {
        let mut scene = Scene::new(bank, kind);
        for (border, &(axis, _)) in BORDERS.iter().enumerate() {
            for _ in 0..2 {
                // A list of rays is an image one pixel high: at most 65,536 of them.
                let list: Vec<Ray> = (0..42_000)
                    .map(|_| {
                        let (p, d) = (scene.beside(border), scene.direction(axis));
                        Ray {
                            origin: scene.domain.world(p - d * (0.1 + scene.random.next())),
                            direction: d,
                        }
                    })
                    .collect();
                let view = View::rays(list.clone());
                scene.levels.render(&view, &Stop::default()).unwrap();
                crossings += scene.checked(border, list.into_par_iter(), &scene.levels.frame().t);
                rays += view.pixels();
            }
        }
    }
    assert!(rays > 1_000_000 && crossings * 2 > rays, "{crossings} of {rays}");
}
