//! `octree/cpu` against the oracle, through the traits.

use crate::OCTREE_CPU;
use isobar_core::{
    Channels, Claim, DMat3, DVec3, Data, Frame, Grid, Knobs, Method, Ray, RenderError, Renderer, Request, Samples, Stage, Stop,
    Surface, View,
};
use isobar_fields::Synthetic;
use isobar_oracle::{Check, Oracle, Truth, check};
use std::sync::Arc;

/// A seeded generator of numbers in [0, 1).
struct Random(u64);
impl Random {
    fn unit(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
    fn direction(&mut self) -> DVec3 {
        loop {
            let v = DVec3::new(self.unit(), self.unit(), self.unit()) * 2.0 - 1.0;
            if v.length() > 0.1 && v.length() < 1.0 {
                return v.normalize();
            }
        }
    }
}

fn request(layers: usize) -> Request {
    Request {
        channels: Channels::all(),
        layers,
        ..Request::default()
    }
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
    let mut r = OCTREE_CPU.open(request).unwrap();
    r.set_data(data).unwrap();
    r.set_surfaces(surfaces).unwrap();
    r.set_view(view).unwrap();
    r.render(&Stop::default()).unwrap();
    let mut f = Frame::default();
    r.read(&mut f).unwrap();
    (f, r)
}

fn checked(data: &Arc<Data>, surfaces: &[Surface], view: &View) -> Check {
    let (frame, r) = draw(data, surfaces, view, 1);
    let f = r.reconstruction(Stage::Stored).unwrap();
    let truth = Truth::compute(&f, surfaces, view, &Stop::default()).unwrap();
    let right = |frame: &Frame| {
        let c = check(frame, &truth, &f, surfaces, view).unwrap();
        assert_eq!(
            (c.missed, c.false_hits, c.wrong_root, c.wrong_surface, c.refuted),
            (0, 0, 0, 0, 0)
        );
        c
    };
    right(&frame);
    right(&draw_request(data, surfaces, view, &first_hits()).0)
}

fn synthetic(spec: &str) -> Arc<Data> {
    Arc::new(spec.parse::<Synthetic>().unwrap().data().unwrap())
}

fn noise(dims: [usize; 3], spacing: DVec3, direction: DMat3, seed: u64) -> Arc<Data> {
    let mut random = Random(seed);
    let samples: Vec<f32> = (0..dims.iter().product()).map(|_| random.unit() as f32).collect();
    let grid = Grid::new(
        dims,
        spacing,
        DVec3::new(0.5, -3.0, 11.0),
        direction,
        Samples::F32(samples.into()),
    )
    .unwrap();
    Arc::new(Data::Grid(grid))
}

#[test]
fn frames_are_exact_and_proved() {
    for (spec, c) in [("marschner-lobb,n=40", 0.5), ("gyroid,n=48", 0.2), ("sphere,n=21", 1.0)] {
        let view = View::bench(160, 120);
        let c = checked(&synthetic(spec), &[Surface::isovalue(c, 0)], &view);
        assert!(c.hits > 1000, "{spec}");
        assert!(c.t_error_voxels.max < 1e-9, "{spec}: {:?}", c.t_error_voxels);
        assert!(c.normal_error_deg.max < 1e-4, "{spec}: {:?}", c.normal_error_deg);
        assert!(c.unclaimed <= 2, "{spec}: {} pixels are not proved", c.unclaimed);
    }
}

/// White noise has every cell active and every trilinear case in it; odd sizes, spacings and axes.
#[test]
fn noise_is_exact_on_any_lattice() {
    let turned = DMat3::from_rotation_z(0.3) * DMat3::from_rotation_x(-1.1);
    let cases = [
        ([2, 2, 2], DVec3::ONE, DMat3::IDENTITY),
        ([7, 18, 5], DVec3::new(1.0, 0.25, 3.0), DMat3::IDENTITY),
        ([9, 6, 17], DVec3::new(1.0, 2.0, 0.5), turned),
        ([6, 9, 6], DVec3::ONE, DMat3::from_diagonal(DVec3::new(-1.0, 1.0, -1.0))),
    ];
    for (i, (dims, spacing, direction)) in cases.into_iter().enumerate() {
        let data = noise(dims, spacing, direction, i as u64 + 1);
        let view = View::fit(data.bounds(), 40.0, 96, 72);
        let c = checked(&data, &[Surface::isovalue(0.5, 0)], &view);
        assert!(c.hits > 500, "{dims:?}: {}", c.hits);
        assert!(c.unclaimed <= 5, "{dims:?}: {} pixels are not proved", c.unclaimed);
    }
}

#[test]
fn all_hits_are_those_of_the_oracle() {
    let data = noise([8, 9, 10], DVec3::ONE, DMat3::IDENTITY, 77);
    let (lo, hi) = data.bounds();
    let mut random = Random(5);
    let rays: Vec<Ray> = (0..3000)
        .map(|_| {
            // from outside and from inside
            let p = lo + (hi - lo) * DVec3::new(random.unit(), random.unit(), random.unit());
            let d = random.direction();
            let back = if random.unit() < 0.7 { 30.0 } else { 0.0 };
            Ray {
                origin: p - d * back,
                direction: d,
            }
        })
        .collect();
    let layers = 40;
    let (f, r) = draw(&data, &[Surface::isovalue(0.45, 0)], &View::rays(rays.clone()), layers);
    let oracle = Oracle::new(r.reconstruction(Stage::Stored).unwrap(), 0.45);
    let mut total = 0;
    for (i, ray) in rays.iter().enumerate() {
        let roots = oracle.all(ray).roots;
        assert_eq!(usize::from(f.hits[i]), roots.len(), "ray {i}: {roots:?}");
        for (l, root) in roots.iter().enumerate() {
            let t = f.t[l * rays.len() + i];
            assert!(root.distance(t) < 1e-8, "ray {i}, layer {l}: {t} instead of {root:?}");
        }
        total += roots.len();
    }
    assert!(total > 5_000, "{total} roots");
}

#[test]
fn several_isovalues_are_merged_in_order() {
    let data = synthetic("gyroid,n=32");
    let mut s: Vec<_> = [0.2, -0.3, 0.9]
        .iter()
        .enumerate()
        .map(|(i, &c)| Surface::isovalue(c, i))
        .collect();
    s[1].opacity = 0.4;
    checked(&data, &s, &View::bench(96, 72));
    let (f, _) = draw(&data, &s, &View::bench(96, 72), 6);
    let n = 96 * 72;
    for i in 0..n {
        assert!(
            (1..6).all(|l| f.t[l * n + i] >= f.t[(l - 1) * n + i]),
            "pixel {i} is out of order"
        );
    }
    assert!([0, 1, 2].iter().all(|s| f.surface.contains(s)));
}

/// hardcases B8: rays exactly along edges, diagonals and faces of cells hit as their neighbours do.
#[test]
fn rays_along_edges_and_faces_lose_nothing() {
    let samples: Vec<f32> = (0..11 * 11 * 11)
        .map(|i| {
            let p = DVec3::new((i % 11) as f64, (i / 11 % 11) as f64, (i / 121) as f64) - 5.0;
            p.length_squared() as f32
        })
        .collect();
    let data = Arc::new(Data::Grid(Grid::unit([11; 3], Samples::F32(samples.into())).unwrap()));
    let directions = [
        DVec3::X,
        DVec3::Y,
        -DVec3::Z,
        DVec3::new(1.0, 1.0, 0.0),
        DVec3::ONE,
        DVec3::new(0.0, -1.0, 1.0),
    ];
    let rays: Vec<Ray> = directions
        .iter()
        .flat_map(|&d| {
            [0.0, 1e-9, -1e-9].map(|e| Ray {
                origin: DVec3::splat(5.0) - d * 20.0 + DVec3::new(e, -e, e * 0.5),
                direction: d,
            })
        })
        .collect();
    let (f, r) = draw(&data, &[Surface::isovalue(9.5, 0)], &View::rays(rays.clone()), 4);
    let oracle = Oracle::new(r.reconstruction(Stage::Stored).unwrap(), 9.5);
    for (i, ray) in rays.iter().enumerate() {
        assert_eq!(f.hits[i], 2, "ray {i}");
        for (l, root) in oracle.all(ray).roots.iter().enumerate() {
            assert!(root.distance(f.t[l * rays.len() + i]) < 1e-8, "ray {i}");
        }
    }
}

/// An isovalue equal to samples, plateaus included (hardcases B5, B7): no panic, nothing false, and what is claimed is right.
#[test]
fn plateaus_are_hit_at_their_entry() {
    let mut random = Random(3);
    let samples: Vec<u8> = (0..6 * 7 * 8).map(|_| (random.unit() * 3.0) as u8).collect();
    let data = Arc::new(Data::Grid(Grid::unit([6, 7, 8], Samples::U8(samples.into())).unwrap()));
    let view = View::fit(data.bounds(), 40.0, 64, 48);
    checked(&data, &[Surface::isovalue(1.0, 0)], &view);
}

/// hardcases E1 and B17: far eyes and extreme aspects neither lose hits nor claim what is not proved.
#[test]
fn far_eyes_and_thin_cells() {
    let data = noise([6, 6, 6], DVec3::new(1.0, 1.0, 1e-6), DMat3::IDENTITY, 9);
    let view = View::fit(data.bounds(), 40.0, 32, 24);
    checked(&data, &[Surface::isovalue(0.5, 0)], &view);
    let data = synthetic("sphere,n=33");
    let ray = Ray {
        origin: DVec3::new(-1e12, 0.01, 0.02),
        direction: DVec3::X,
    };
    let (f, _) = draw(&data, &[Surface::isovalue(1.0, 0)], &View::rays(vec![ray]), 2);
    assert_eq!((f.hits[0], f.claim[0]), (2, Claim::empty()), "nothing is proved at 10^12");
}

#[test]
fn claims_can_be_switched_off_and_an_isovalue_costs_no_rebuild() {
    let data = synthetic("gyroid,n=24");
    let mut r = OCTREE_CPU.open(&request(1)).unwrap();
    r.set_data(&data).unwrap();
    r.set_view(&View::bench(40, 30)).unwrap();
    assert!(matches!(r.render(&Stop::default()), Err(RenderError::NotReady(_))));
    r.set_surfaces(&[Surface::isovalue(0.2, 0)]).unwrap();
    r.set_knobs(&Knobs::default().with("claims", "off")).unwrap();
    r.render(&Stop::default()).unwrap();
    let mut f = Frame::default();
    r.read(&mut f).unwrap();
    assert!(f.claim.iter().all(|c| c.is_empty()) && f.t_error.iter().all(|e| e.is_infinite()));
    let before = r.memory().index;
    r.set_surfaces(&[Surface::isovalue(50.0, 0)]).unwrap();
    r.set_knobs(&Knobs::default()).unwrap();
    r.render(&Stop::default()).unwrap();
    r.read(&mut f).unwrap();
    assert!(
        f.claim.iter().all(|c| *c == Claim::EMPTY),
        "an isovalue outside the range is a proved miss"
    );
    assert!(r.memory().index < before);
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
        let (frame, r) = draw(&data, &[Surface::isovalue(0.0, 0)], &View::rays(rays.clone()), 6);
        let oracle = Oracle::new(r.reconstruction(Stage::Stored).unwrap(), 0.0);
        for (i, ray) in rays.iter().enumerate() {
            let roots = oracle.all(ray).roots;
            assert_eq!(usize::from(frame.hits[i]), roots.len(), "field {n}, ray {i}: {roots:?}");
            for (l, root) in roots.iter().enumerate() {
                let t = frame.t[l * rays.len() + i];
                assert!(root.distance(t) < 1e-4, "field {n}, ray {i}: {t} instead of {root:?}");
            }
            touched += roots.len();
        }
    }
    assert!(touched >= 50, "{touched} roots");
}

/// hardcases B5, B7, C4 to C11: touching and triple roots on faces, edges and vertices of cells, an isovalue equal to samples, a plateau.
#[test]
fn hard_cases_are_those_of_the_oracle() {
    let grid =
        |dims: [usize; 3], samples: Vec<f32>| Arc::new(Data::Grid(Grid::unit(dims, Samples::F32(samples.into())).unwrap()));
    let ray = |o: [f64; 3], d: [f64; 3]| Ray {
        origin: o.into(),
        direction: d.into(),
    };
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
