//! `octree/cpu` against the oracle, through the traits.

use crate::OCTREE_CPU;
use isobar_core::{Channels, DVec3, Data, Frame, Grid, Knobs, Ray, Renderer, Request, Samples, Stage, Surface, View};
use isobar_oracle::{Check, Oracle};
use isobar_scenes::trials::{self, hits_are_roots, rays_towards};
use isobar_scenes::{against, open, ray, sampled, synthetic, wrong};
use std::sync::Arc;

fn request(layers: usize) -> Request {
    isobar_scenes::request(layers, Knobs::default())
}

fn draw(data: &Arc<Data>, surfaces: &[Surface], view: &View, layers: usize) -> (Frame, Box<dyn Renderer>) {
    draw_request(data, surfaces, view, &request(layers))
}

/// Without the number of hits the first one ends a ray, and tiles are drawn in packets.
fn first_hits() -> Request {
    Request {
        channels: Channels::all() - Channels::HITS,
        ..Request::default()
    }
}

fn draw_request(data: &Arc<Data>, surfaces: &[Surface], view: &View, request: &Request) -> (Frame, Box<dyn Renderer>) {
    let mut r = open(&OCTREE_CPU, request);
    (isobar_scenes::draw(&mut *r, data, surfaces, view), r)
}

fn checked(data: &Arc<Data>, surfaces: &[Surface], view: &View) -> Check {
    let (frame, r) = draw(data, surfaces, view, 1);
    let right = |frame: &Frame| {
        let c = against(frame, &*r, surfaces, view);
        assert_eq!(wrong(&c), [0; 5]);
        c
    };
    right(&frame);
    right(&draw_request(data, surfaces, view, &first_hits()).0)
}

#[test]
fn frames_are_exact_and_proved() {
    trials::bench_frames(checked);
}

/// White noise has every cell active and every trilinear case in it; odd sizes, spacings and axes.
#[test]
fn noise_is_exact_on_any_lattice() {
    trials::noise_on_lattices(96, 72, |data, view, dims| {
        let c = checked(data, &[Surface::isovalue(0.5, 0)], view);
        assert!(c.hits > 500, "{dims:?}: {}", c.hits);
        assert!(c.unclaimed <= 5, "{dims:?}: {} pixels are not proved", c.unclaimed);
    });
}

#[test]
fn all_hits_are_those_of_the_oracle() {
    let total = trials::all_hits(&OCTREE_CPU, 3000, 0.45);
    assert!(total > 5_000, "{total} roots");
}

#[test]
fn several_isovalues_are_merged_in_order() {
    trials::several_isovalues(&OCTREE_CPU, |data, surfaces, view| {
        checked(data, surfaces, view);
    });
}

/// hardcases B8: rays exactly along edges, diagonals and faces of cells hit as their neighbours do.
#[test]
fn rays_along_edges_and_faces_lose_nothing() {
    let from = |x: f64| (x - 5.0).powi(2);
    let data = Arc::new(Data::Grid(sampled([11; 3], |x, y, z| from(x) + from(y) + from(z))));
    let directions = [
        DVec3::X,
        DVec3::Y,
        -DVec3::Z,
        DVec3::new(1.0, 1.0, 0.0),
        DVec3::ONE,
        DVec3::new(0.0, -1.0, 1.0),
    ];
    let offsets = [0.0, 1e-9, -1e-9].map(|e| DVec3::new(e, -e, e * 0.5));
    let rays = rays_towards(DVec3::splat(5.0), &directions, &offsets);
    assert_eq!(hits_are_roots(&OCTREE_CPU, &data, 9.5, &rays, 4, 1e-8), 2 * rays.len());
}

/// An isovalue equal to samples, plateaus included (hardcases B5, B7): no panic, nothing false, and what is claimed is right.
#[test]
fn plateaus_are_hit_at_their_entry() {
    trials::plateaus(|data, surfaces, view| {
        checked(data, surfaces, view);
    });
}

/// hardcases E1 and B17: far eyes and extreme aspects neither lose hits nor claim what is not proved.
#[test]
fn far_eyes_and_thin_cells() {
    trials::far_eyes_and_thin_cells(&OCTREE_CPU, true, |data, surfaces, view| {
        checked(data, surfaces, view);
    });
}

#[test]
fn claims_can_be_switched_off_and_an_isovalue_costs_no_rebuild() {
    trials::claims_and_isovalues(&OCTREE_CPU, &Knobs::default());
}

/// hardcases C5, C7: a surface that touches a face, an edge or a vertex of cells from one side is hit once; so is one that crosses there.
#[test]
fn roots_shared_by_cells_are_one_hit() {
    let of = |f: &dyn Fn(f64, f64, f64) -> f64| {
        let samples: Vec<f32> = (0..7 * 7 * 7)
            .map(|i| f((i % 7) as f64 - 3.0, (i / 7 % 7) as f64 - 3.0, (i / 49) as f64 - 3.0) as f32)
            .collect();
        Arc::new(Data::Grid(Grid::unit([7; 3], Samples::F32(samples.into())).unwrap()))
    };
    let fields: [&dyn Fn(f64, f64, f64) -> f64; 5] = [
        &|x, _, _| x.abs(),
        &|x, _, _| -x.abs(),
        &|x, y, z| x * x + y * y + z * z,
        &|x, y, z| x * y - z,
        &|x, _, _| x.abs().max(1.0) - 1.0,
    ];
    let mut touched = 0;
    for (n, f) in fields.into_iter().enumerate() {
        let data = of(f);
        let mut rays = Vec::new();
        for offset in [DVec3::ZERO, DVec3::new(0.0, 0.5, 0.25), DVec3::new(0.0, 0.5, 0.0)] {
            for d in [DVec3::X, -DVec3::X, DVec3::new(1.0, 0.5, 0.25), DVec3::ONE] {
                let origin = DVec3::splat(3.0) + offset - d * 5.0;
                rays.push(Ray { origin, direction: d });
            }
        }
        println!("field {n}");
        touched += hits_are_roots(&OCTREE_CPU, &data, 0.0, &rays, 6, 1e-4);
    }
    assert!(touched >= 50, "{touched} roots");
}

/// hardcases B5, B7, C4 to C11: touching and triple roots on faces, edges and vertices of cells, an isovalue equal to samples, a plateau.
#[test]
fn hard_cases_are_those_of_the_oracle() {
    let grid =
        |dims: [usize; 3], samples: Vec<f32>| Arc::new(Data::Grid(Grid::unit(dims, Samples::F32(samples.into())).unwrap()));
    let peak = (0..27).map(|i| f32::from(i == 13)).collect();
    let ramp = (0..24).map(|i| [0.0, 1.0, 2.0, 2.0, 3.0, 4.0][i % 6]).collect();
    let (x, y, z, all) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0; 3]);
    let cases = [
        (
            "B5",
            grid([3; 3], peak),
            1.0,
            vec![ray([-1.0, 1.0, 1.0], x), ray([-1.0; 3], all), ray([-1.0, 1.0, 1.25], x)],
        ),
        (
            "B7",
            grid([6, 2, 2], ramp),
            2.0,
            vec![ray([-1.0, 0.5, 0.5], x), ray([6.0, 0.25, 0.75], [-1.0, 0.0, 0.0])],
        ),
        ("C4", synthetic("torus,n=65"), 0.0, vec![ray([-2.0, 0.75, 0.0], x)]),
        (
            "C5",
            synthetic("torus,n=65"),
            0.0,
            vec![ray([0.75, 0.0, -2.0], z), ray([-2.0, 1.25, 0.0], x)],
        ),
        ("C6c", synthetic("teardrop,n=65"), 0.0, vec![ray([0.0, 0.0, -2.0], z)]),
        ("C7", synthetic("cayley,n=65"), 0.0, vec![ray([-0.5, -0.5, -2.0], z)]),
        ("C8c", synthetic("steinberger-c,n=65"), 0.0, vec![ray([-2.0; 3], all)]),
        ("C10", synthetic("steiner,n=65"), 0.0, vec![ray([-2.0; 3], all)]),
        ("C11", synthetic("whitney,n=65"), 0.0, vec![ray([-2.0, 0.0, -1.0], x)]),
        (
            "kiss",
            synthetic("kiss,n=65"),
            0.0,
            vec![ray([-2.0, 0.0, 0.0], x), ray([0.0, -2.0, 0.0], y)],
        ),
    ];
    for (name, data, c, rays) in cases {
        let (f, r) = draw(&data, &[Surface::isovalue(c, 0)], &View::rays(rays.clone()), 8);
        let oracle = Oracle::new(r.reconstruction(Stage::Stored).unwrap(), c);
        for (i, ray) in rays.iter().enumerate() {
            let roots = oracle.all(ray).roots;
            let hits: Vec<f64> = (0..8).map(|l| f.t[l * rays.len() + i]).filter(|t| t.is_finite()).collect();
            let near = hits.len() == roots.len() && hits.iter().zip(&roots).all(|(t, r)| r.distance(*t) < 1e-5);
            assert!(near, "{name}, ray {i}: {hits:?} instead of {roots:?}");
        }
    }
}
