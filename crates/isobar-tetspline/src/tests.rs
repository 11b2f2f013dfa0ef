//! `tetspline/cpu` against the oracle, through the traits.

use crate::TETSPLINE_CPU;
use isobar_core::{
    Claim, ClipPlane, DMat3, DVec3, Data, Frame, Grid, Knobs, Ray, RenderError, Renderer, Samples, Stage, Surface, View,
};
use isobar_oracle::{Check, check};
use isobar_scenes::trials::{self, hits_are_roots, rays_towards};
use isobar_scenes::{Random, noise, open, request, synthetic, truth, wrong};
use std::sync::Arc;

fn draw_with(data: &Arc<Data>, surfaces: &[Surface], view: &View, layers: usize, knobs: Knobs) -> (Frame, Box<dyn Renderer>) {
    let mut r = open(&TETSPLINE_CPU, &request(layers, knobs));
    (isobar_scenes::draw(&mut *r, data, surfaces, view), r)
}

fn draw(data: &Arc<Data>, surfaces: &[Surface], view: &View, layers: usize) -> (Frame, Box<dyn Renderer>) {
    draw_with(data, surfaces, view, layers, Knobs::default())
}

/// The frame against the oracle; that of the same rays as a list, which go alone, is as good.
fn compared(data: &Arc<Data>, surfaces: &[Surface], view: &View, knobs: Knobs) -> Check {
    let (frame, r) = draw_with(data, surfaces, view, 1, knobs.clone());
    let f = r.reconstruction(Stage::Stored).unwrap();
    let truth = truth(&*r, surfaces, view);
    let c = check(&frame, &truth, &f, surfaces, view).unwrap();
    let rays: Vec<Ray> = (0..view.pixels()).map(|i| view.ray(i % view.width, i / view.width)).collect();
    let list = View {
        clips: view.clips.clone(),
        ..View::rays(rays)
    };
    let (mut alone, _) = draw_with(data, surfaces, &list, 1, knobs);
    (alone.width, alone.height) = (view.width, view.height);
    let a = check(&alone, &truth, &f, surfaces, view).unwrap();
    assert_eq!(wrong(&a), wrong(&c));
    assert!(
        a.unclaimed <= c.unclaimed + 2,
        "{} alone, {} in packets",
        a.unclaimed,
        c.unclaimed
    );
    c
}

fn checked(data: &Arc<Data>, surfaces: &[Surface], view: &View) -> Check {
    let c = compared(data, surfaces, view, Knobs::default());
    assert_eq!(wrong(&c), [0; 5]);
    c
}

#[test]
fn frames_are_exact_and_proved() {
    for kind in ["type6", "type6-prefiltered"] {
        let knobs = Knobs::default().with("reconstruction", kind);
        trials::bench_frames(|data, surfaces, view| compared(data, surfaces, view, knobs.clone()));
    }
}

/// White noise has every cube active; odd sizes, spacings and axes.
#[test]
fn noise_is_exact_on_any_lattice() {
    trials::noise_on_lattices(96, 72, |data, view, dims| {
        let c = checked(data, &[Surface::isovalue(0.5, 0)], view);
        assert!(c.hits > 300, "{dims:?}: {}", c.hits);
        assert!(c.unclaimed <= 5, "{dims:?}: {} pixels are not proved", c.unclaimed);
    });
}

#[test]
fn all_hits_are_those_of_the_oracle() {
    let total = trials::all_hits(&TETSPLINE_CPU, 2000, 0.5);
    assert!(total > 3_000, "{total} roots");
}

#[test]
fn several_isovalues_are_merged_in_order() {
    trials::several_isovalues(&TETSPLINE_CPU, |data, surfaces, view| {
        checked(data, surfaces, view);
    });
}

/// hardcases B8, B11b: rays exactly along faces, edges and diagonals of the partition, and through its vertices, lose nothing and see nothing twice.
#[test]
fn rays_along_planes_of_the_partition_lose_nothing() {
    let from = |x: f64| (x - 12.0).powi(2);
    let data = Arc::new(Data::Grid(isobar_scenes::sampled([25; 3], |x, y, z| {
        from(x) + from(y) + from(z)
    })));
    let directions = [
        DVec3::X,
        DVec3::Y,
        -DVec3::Z,
        DVec3::new(1.0, 1.0, 0.0),
        DVec3::ONE,
        DVec3::new(0.0, -1.0, 1.0),
        DVec3::new(1.0, 0.5, 0.5),
        DVec3::new(2.0, 1.0, -1.0),
        DVec3::new(1.0, 0.0, 2.0),
    ];
    let offsets = [DVec3::ZERO, DVec3::splat(0.5), DVec3::X * 0.5, DVec3::new(1e-9, -1e-9, 5e-10)];
    let rays = rays_towards(DVec3::splat(12.0), &directions, &offsets);
    assert_eq!(hits_are_roots(&TETSPLINE_CPU, &data, 100.0, &rays, 4, 1e-8), 2 * rays.len());
    let (f, _) = draw(&data, &[Surface::isovalue(100.0, 0)], &View::rays(rays.clone()), 4);
    // Through the centre: the radius is sqrt(99.25).
    assert!((f.t[0] - (20.0 - 99.25f64.sqrt())).abs() < 1e-12);
    // Sphere through vertices, centres and centroids: the roots lie on common points of many tetrahedra.
    let (f, _) = draw(&data, &[Surface::isovalue(25.75, 0)], &View::rays(rays[..4].to_vec()), 4);
    assert!((f.t[0] - 15.0).abs() < 1e-12 && f.hits[0] == 2, "{} {}", f.t[0], f.hits[0]);
}

/// An isovalue equal to samples, plateaus included (hardcases B5, B7): no panic, nothing false, and what is claimed is right.
#[test]
fn plateaus_are_hit_at_their_entry() {
    trials::plateaus(|data, surfaces, view| {
        checked(data, surfaces, view);
    });
    let mut random = Random(3);
    let samples: Vec<u8> = (0..12 * 12 * 12)
        .map(|i| if (3..9).contains(&(i % 12)) { 5 } else { (i % 3) as u8 })
        .collect();
    let data = Arc::new(Data::Grid(Grid::unit([12; 3], Samples::U8(samples.into())).unwrap()));
    let rays: Vec<Ray> = (0..200)
        .map(|_| {
            let to = DVec3::new(6.0, 2.0, 2.0) + random.vector() * DVec3::new(0.0, 7.0, 7.0);
            let from = DVec3::new(-4.0, 5.0, 5.0) + random.vector();
            Ray {
                origin: from,
                direction: to - from,
            }
        })
        .collect();
    let c = checked(&data, &[Surface::isovalue(5.0, 0)], &View::rays(rays));
    assert_eq!(c.hits, 200);
}

/// hardcases E1 and B17: far eyes and extreme aspects neither lose hits nor claim what is not proved.
#[test]
fn far_eyes_and_thin_cells() {
    trials::far_eyes_and_thin_cells(&TETSPLINE_CPU, false, |data, surfaces, view| {
        checked(data, surfaces, view);
    });
}

/// Open cuts keep what they should and are proved, in packets and alone. hardcases E13: what is kept of the surface stays where it was to 1e-9, less than an ulp of any depth buffer.
#[test]
fn clipping_planes_cut() {
    let data = synthetic("gyroid,n=32");
    let s = [Surface::isovalue(0.2, 0)];
    let mut view = View::bench(96, 72);
    let plane = |normal: DVec3, distance| ClipPlane {
        normal,
        distance,
        cap: false,
    };
    let (open, _) = draw(&data, &s, &view, 30);
    view.clips = vec![plane(DVec3::new(1.0, 0.2, 0.1), 0.3), plane(DVec3::new(0.0, 0.0, -2.0), 0.9)];
    let c = checked(&data, &s, &view);
    assert!(
        c.hits > 500 && c.unclaimed <= 2,
        "{} of {} pixels are not proved",
        c.unclaimed,
        c.pixels
    );
    let (cut, _) = draw(&data, &s, &view, 30);
    let n = 96 * 72;
    let mut dropped = 0;
    for i in 0..n {
        let of = |f: &Frame| -> Vec<f64> { (0..30).map(|l| f.t[l * n + i]).take_while(|t| t.is_finite()).collect() };
        let ray = view.ray(i % 96, i / 96);
        let kept = |t: f64| view.clips.iter().all(|c| c.normal.dot(ray.at(t)) <= c.distance);
        let all = of(&open);
        let want: Vec<f64> = all.iter().copied().filter(|&t| kept(t)).collect();
        dropped += all.len() - want.len();
        let got = of(&cut);
        assert!(
            got.len() == want.len() && got.iter().zip(&want).all(|(a, b)| (a - b).abs() < 1e-9),
            "pixel {i}: {got:?} {want:?}"
        );
    }
    assert!(dropped > 1000);
}

/// A plane that a ray meets at the surface itself, or that lies along it, proves nothing; a plane elsewhere takes no proof away. Rays from a list go alone.
#[test]
fn cuts_at_the_surface_are_not_proved() {
    let samples: Vec<f32> = (0..9 * 9 * 9).map(|i| (i % 9) as f32).collect();
    let data = Arc::new(Data::Grid(Grid::unit([9; 3], Samples::F32(samples.into())).unwrap()));
    let rays: Vec<Ray> = (0..50)
        .map(|i| Ray {
            origin: DVec3::new(-3.0, 1.0 + 0.1 * f64::from(i), 2.3),
            direction: DVec3::new(1.0, 0.1 / 3.0, 0.05),
        })
        .collect();
    let plane = |normal: DVec3, distance: f64| ClipPlane {
        normal,
        distance,
        cap: false,
    };
    // The surface is the plane x = 4.3.
    let first = Claim::EXISTS | Claim::FIRST;
    for (clip, want) in [
        (plane(-DVec3::X, -2.0), Some(first)),
        (plane(DVec3::X, 4.0), Some(Claim::EMPTY)),
        (plane(-DVec3::X, -4.3), None),
        (plane(DVec3::X, 4.3), None),
    ] {
        let view = View {
            clips: vec![clip],
            ..View::rays(rays.clone())
        };
        let c = compared(&data, &[Surface::isovalue(4.3, 0)], &view, Knobs::default());
        assert_eq!(c.refuted, 0);
        let (f, _) = draw(&data, &[Surface::isovalue(4.3, 0)], &view, 1);
        let right = |c: &Claim| want.map_or(c.is_empty(), |w| *c == w);
        assert!(f.claim.iter().all(right), "{clip:?}: {:?}", f.claim);
    }
}

/// hardcases C16, the function of the paper's Fig. 5 on 64^3 samples: the roots of the spline are near those of the function, the nearer with `type6-prefiltered`, and there is none where it has none.
#[test]
fn the_function_of_figure_5() {
    let step = 2.2 / 63.0;
    let one = |i: usize| {
        let x = i as f64 * step - 1.1;
        x.powi(16) - (7.0 * x).cos()
    };
    let samples: Vec<f32> = (0..64 * 64 * 64)
        .map(|n| (one(n % 64) + one(n / 64 % 64) + one(n / 4096)) as f32)
        .collect();
    let grid = Grid::new(
        [64; 3],
        DVec3::splat(step),
        DVec3::splat(-1.1),
        DMat3::IDENTITY,
        Samples::F32(samples.into()),
    );
    let data = Arc::new(Data::Grid(grid.unwrap()));
    let aside = |a: f64| Ray {
        origin: DVec3::new(-3.0, a, a),
        direction: DVec3::X,
    };
    let view = View::rays(vec![aside(0.0), aside(0.9), aside(0.448_798_950_512_827_6)]);
    let surfaces = [Surface::isovalue(0.0, 0)];
    let mut errors = Vec::new();
    for kind in ["type6", "type6-prefiltered"] {
        let knobs = Knobs::default().with("reconstruction", kind);
        assert!(compared(&data, &surfaces, &view, knobs.clone()).is_clean(), "{kind}");
        let (f, _) = draw_with(&data, &surfaces, &view, 3, knobs);
        assert_eq!(f.hits, [2, 2, 0], "{kind}");
        for (ray, root) in [(0, 1.057_271_837_396_040_8), (1, 1.048_180_748_420_97)] {
            let apart = [(0, -root), (1, root)].map(|(l, x)| (f.t[3 * l + ray] - 3.0 - x).abs());
            errors.push(apart[0].max(apart[1]));
        }
    }
    println!("C16: distance of the spline's roots from the function's {errors:?}");
    // h^2/8 times the Laplacian, some 600 there, over a slope of 43, is 2e-3.
    assert!(
        errors[0] < 4e-3 && errors[1] < 4e-3 && errors[2] < 0.3 * errors[0] && errors[3] < 0.3 * errors[1],
        "{errors:?}"
    );
}

/// The paper's roots: nothing is claimed, what is hit is a root, and some first roots are lost.
#[test]
fn newton_as_printed_loses_first_roots() {
    let data = noise([20; 3], DVec3::ONE, DMat3::IDENTITY, 4);
    let view = View::fit(data.bounds(), 40.0, 120, 90);
    let s = [Surface::isovalue(0.5, 0)];
    let c = compared(&data, &s, &view, Knobs::default().with("roots", "newton3"));
    let wrong = c.missed + c.wrong_root + c.false_hits;
    println!(
        "newton3 on noise: {} hits, {} missed, {} later, {} false",
        c.hits, c.missed, c.wrong_root, c.false_hits
    );
    assert!(
        c.refuted == 0 && c.unclaimed == c.pixels && wrong > 0 && wrong * 5 < c.hits,
        "{wrong} of {}",
        c.hits
    );
}

#[test]
fn claims_can_be_switched_off_and_an_isovalue_costs_no_rebuild() {
    let change = Knobs::default().with("reconstruction", "type6-prefiltered");
    let mut r = trials::claims_and_isovalues(&TETSPLINE_CPU, &change);
    assert_eq!(r.memory().coefficients, 24 * 24 * 24 * 4);
    assert_eq!(r.reconstruction(Stage::Stored).unwrap().name(), "type6-prefiltered");
    assert!(matches!(
        r.set_data(&noise([1, 4, 4], DVec3::ONE, DMat3::IDENTITY, 1)),
        Err(RenderError::Data(_))
    ));
}
