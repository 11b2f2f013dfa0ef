//! Degrees 2 and 3 of `octree/cpu` against the oracle, through the traits.

use crate::OCTREE_CPU;
use isobar_core::{
    Claim, DMat3, DVec3, Data, DataError, Frame, Grid, Knobs, Method, Ray, RenderError, Renderer, Request, Samples, Stage, Stop,
    Surface, View,
};
use isobar_fields::Kind;
use isobar_oracle::{Check, Oracle};
use isobar_scenes::{Random, against, noise, request, wrong};
use std::sync::Arc;

const SMOOTH: [Kind; 4] = [
    Kind::Quadratic,
    Kind::QuadraticInterpolating,
    Kind::Cubic,
    Kind::CubicInterpolating,
];

fn open(kind: Kind, layers: usize) -> Box<dyn Renderer> {
    let knobs = Knobs::default().with("reconstruction", kind.name());
    isobar_scenes::open(&OCTREE_CPU, &request(layers, knobs))
}

fn draw(kind: Kind, data: &Arc<Data>, surfaces: &[Surface], view: &View, layers: usize) -> (Frame, Box<dyn Renderer>) {
    let mut r = open(kind, layers);
    (isobar_scenes::draw(&mut *r, data, surfaces, view), r)
}

fn checked(kind: Kind, data: &Arc<Data>, surfaces: &[Surface], view: &View) -> Check {
    let (frame, r) = draw(kind, data, surfaces, view, 1);
    let f = r.reconstruction(Stage::Stored).unwrap();
    assert_eq!(f.name(), kind.name());
    let c = against(&frame, &*r, surfaces, view);
    assert_eq!(wrong(&c), [0; 5], "{kind}");
    c
}

fn grid(dims: [usize; 3], samples: Samples) -> Arc<Data> {
    Arc::new(Data::Grid(Grid::unit(dims, samples).unwrap()))
}

/// White noise has every case in it; sizes from one cell on, spacings, axes; every kind.
#[test]
fn noise_is_exact_on_any_lattice() {
    let turned = DMat3::from_rotation_z(0.3) * DMat3::from_rotation_x(-1.1);
    let cases = [
        ([2, 2, 2], DVec3::ONE, DMat3::IDENTITY),
        ([3, 2, 19], DVec3::ONE, DMat3::IDENTITY),
        ([7, 18, 5], DVec3::new(1.0, 0.25, 3.0), DMat3::IDENTITY),
        ([9, 6, 17], DVec3::new(1.0, 2.0, 0.5), turned),
        ([6, 9, 6], DVec3::ONE, DMat3::from_diagonal(DVec3::new(-1.0, 1.0, -1.0))),
    ];
    for (i, (dims, spacing, direction)) in cases.into_iter().enumerate() {
        let data = noise(dims, spacing, direction, i as u64 + 1);
        let view = View::fit(data.bounds(), 40.0, 48, 36);
        for kind in SMOOTH {
            let c = checked(kind, &data, &[Surface::isovalue(0.5, 0)], &view);
            assert!(c.hits > 40, "{kind} {dims:?}: {}", c.hits);
            assert!(c.unclaimed <= 2, "{kind} {dims:?}: {} pixels are not proved", c.unclaimed);
            assert!(
                c.t_error_voxels.max < 1e-5 && c.normal_error_deg.max < 1e-2,
                "{kind} {dims:?}"
            );
        }
    }
}

/// Every sample type, and the isovalue of a surface far from zero (hardcases A17).
#[test]
fn sample_types_and_offsets() {
    let mut random = Random(21);
    let dims = [11, 9, 10];
    let n: usize = dims.iter().product();
    let unit: Vec<f64> = (0..n).map(|_| random.unit()).collect();
    let cases = [
        (
            Samples::U8(unit.iter().map(|v| (v * 255.0) as u8).collect::<Vec<_>>().into()),
            100.5,
        ),
        (
            Samples::I16(unit.iter().map(|v| (v * 6e4 - 3e4) as i16).collect::<Vec<_>>().into()),
            -1234.25,
        ),
        (
            Samples::U16(unit.iter().map(|v| (v * 6e4) as u16).collect::<Vec<_>>().into()),
            33_333.0,
        ),
        (
            Samples::F32(unit.iter().map(|v| (1e6 + v * 100.0) as f32).collect::<Vec<_>>().into()),
            1e6 + 50.1,
        ),
    ];
    for (samples, c) in cases {
        let data = grid(dims, samples);
        let view = View::fit(data.bounds(), 40.0, 40, 30);
        for kind in [Kind::Quadratic, Kind::Cubic, Kind::CubicInterpolating] {
            let c = checked(kind, &data, &[Surface::isovalue(c, 0)], &view);
            assert!(
                c.hits > 100 && c.unclaimed <= 2,
                "{kind}: {} hits, {} not proved",
                c.hits,
                c.unclaimed
            );
        }
    }
}

#[test]
fn all_hits_are_those_of_the_oracle() {
    let data = noise([8, 9, 10], DVec3::ONE, DMat3::IDENTITY, 77);
    let (lo, hi) = data.bounds();
    let mut random = Random(5);
    let rays: Vec<Ray> = (0..1200)
        .map(|_| {
            let p = lo + (hi - lo) * random.vector();
            let d = (random.vector() * 2.0 - 1.0).normalize();
            // from outside and from inside
            let back = if random.unit() < 0.7 { 30.0 } else { 0.0 };
            Ray {
                origin: p - d * back,
                direction: d,
            }
        })
        .collect();
    let layers = 40;
    for kind in [Kind::QuadraticInterpolating, Kind::Cubic] {
        let (f, r) = draw(kind, &data, &[Surface::isovalue(0.48, 0)], &View::rays(rays.clone()), layers);
        let oracle = Oracle::new(r.reconstruction(Stage::Stored).unwrap(), 0.48);
        let mut total = 0;
        for (i, ray) in rays.iter().enumerate() {
            let roots = oracle.all(ray).roots;
            assert_eq!(usize::from(f.hits[i]), roots.len(), "{kind}, ray {i}: {roots:?}");
            for (l, root) in roots.iter().enumerate() {
                let t = f.t[l * rays.len() + i];
                assert!(root.distance(t) < 1e-6, "{kind}, ray {i}, layer {l}: {t} instead of {root:?}");
            }
            total += roots.len();
        }
        assert!(total > 1_000, "{kind}: {total} roots");
    }
}

#[test]
fn several_isovalues_are_merged_in_order() {
    let data = noise([12; 3], DVec3::ONE, DMat3::IDENTITY, 4);
    let mut s: Vec<_> = [0.5, 0.42, 0.6]
        .iter()
        .enumerate()
        .map(|(i, &c)| Surface::isovalue(c, i))
        .collect();
    s[1].opacity = 0.4;
    let view = View::fit(data.bounds(), 40.0, 48, 36);
    for kind in [Kind::Quadratic, Kind::Cubic] {
        checked(kind, &data, &s, &view);
        let (f, _) = draw(kind, &data, &s, &view, 6);
        let n = 48 * 36;
        for i in 0..n {
            assert!(
                (1..6).all(|l| f.t[l * n + i] >= f.t[(l - 1) * n + i]),
                "pixel {i} is out of order"
            );
        }
        assert!([0, 1, 2].iter().all(|s| f.surface.contains(s)), "{kind}");
    }
}

/// hardcases B10 and B11: coefficients i^2 + j^2 + k^2 give x^2 + y^2 + z^2 + 1 and + 3/4; the interpolating cubic gives the field itself inside.
#[test]
fn moments_of_the_bases() {
    let n = 25;
    let samples: Vec<f32> = (0..n * n * n)
        .map(|i| (DVec3::new((i % n) as f64, (i / n % n) as f64, (i / n / n) as f64) - 12.0).length_squared() as f32)
        .collect();
    let data = grid([n; 3], Samples::F32(samples.into()));
    let rays: Vec<Ray> = [DVec3::X, DVec3::ONE.normalize(), DVec3::new(0.0, -0.6, 0.8)]
        .iter()
        .map(|&d| Ray {
            origin: DVec3::splat(12.0) - d * 30.0,
            direction: d,
        })
        .collect();
    for (kind, radius, tolerance) in [
        (Kind::Cubic, 99.0f64.sqrt(), 1e-9),
        (Kind::Quadratic, 99.25f64.sqrt(), 1e-9),
        (Kind::CubicInterpolating, 10.0, 0.05),
    ] {
        let (f, _) = draw(kind, &data, &[Surface::isovalue(100.0, 0)], &View::rays(rays.clone()), 2);
        for i in 0..rays.len() {
            assert_eq!((f.hits[i], f.claim[i]), (2, Claim::EXISTS | Claim::FIRST), "{kind}, ray {i}");
            for (t, want) in [(f.t[i], 30.0 - radius), (f.t[rays.len() + i], 30.0 + radius)] {
                assert!((t - want).abs() < tolerance, "{kind}, ray {i}: {t} instead of {want}");
            }
        }
    }
}

/// Rays exactly along edges, diagonals and faces of cells, and in the planes where cells centred on samples meet (hardcases B8).
#[test]
fn rays_along_edges_and_faces_lose_nothing() {
    let samples: Vec<f32> = (0..11 * 11 * 11)
        .map(|i| (DVec3::new((i % 11) as f64, (i / 11 % 11) as f64, (i / 121) as f64) - 5.0).length_squared() as f32)
        .collect();
    let data = grid([11; 3], Samples::F32(samples.into()));
    let directions = [
        DVec3::X,
        -DVec3::Z,
        DVec3::new(1.0, 1.0, 0.0),
        DVec3::ONE,
        DVec3::new(0.0, -1.0, 1.0),
    ];
    let rays: Vec<Ray> = directions
        .iter()
        .flat_map(|&d| {
            [(0.0, 0.0), (0.5, 0.0), (0.0, 1e-9), (0.5, -1e-9)].map(|(h, e)| Ray {
                origin: DVec3::splat(5.0 + h) - d * 20.0 + DVec3::new(e, -e, e * 0.5),
                direction: d,
            })
        })
        .collect();
    for kind in [Kind::Quadratic, Kind::Cubic] {
        let (f, r) = draw(kind, &data, &[Surface::isovalue(9.5, 0)], &View::rays(rays.clone()), 4);
        let oracle = Oracle::new(r.reconstruction(Stage::Stored).unwrap(), 9.5);
        for (i, ray) in rays.iter().enumerate() {
            let roots = oracle.all(ray).roots;
            assert_eq!(usize::from(f.hits[i]), roots.len(), "{kind}, ray {i}");
            for (l, root) in roots.iter().enumerate() {
                assert!(root.distance(f.t[l * rays.len() + i]) < 1e-8, "{kind}, ray {i}");
            }
        }
    }
}

/// Plateaus, and a volume that is the isovalue everywhere (hardcases B5, B7): nothing false, and a plateau is one hit at its entry.
#[test]
fn plateaus_are_hit_at_their_entry() {
    let mut random = Random(3);
    let samples: Vec<u8> = (0..9 * 9 * 9)
        .map(|i| {
            if (2..7).contains(&(i % 9)) {
                1
            } else {
                (random.unit() * 3.0) as u8
            }
        })
        .collect();
    let data = grid([9; 3], Samples::U8(samples.into()));
    let view = View::fit(data.bounds(), 40.0, 32, 24);
    let constant = grid([5; 3], Samples::U8(vec![7u8; 125].into()));
    let ray = Ray {
        origin: DVec3::new(-3.0, 1.9, 2.2),
        direction: DVec3::X,
    };
    for kind in [Kind::Quadratic, Kind::Cubic] {
        checked(kind, &data, &[Surface::isovalue(1.0, 0)], &view);
        let (f, _) = draw(kind, &constant, &[Surface::isovalue(7.0, 0)], &View::rays(vec![ray]), 3);
        assert_eq!((f.hits[0], f.claim[0]), (1, Claim::EXISTS | Claim::FIRST), "{kind}");
        assert!((f.t[0] - 3.0).abs() < 1e-12 && f.normal[0] == [0.0; 3], "{kind}: {}", f.t[0]);
        let (f, _) = draw(kind, &constant, &[Surface::isovalue(6.5, 0)], &View::rays(vec![ray]), 3);
        assert_eq!((f.hits[0], f.claim[0]), (0, Claim::EMPTY), "{kind}");
    }
}

/// hardcases E1 and B17: extreme aspects change nothing; far eyes lose no hit, and exact arithmetic decides them.
#[test]
fn far_eyes_and_thin_cells() {
    for spacing in [DVec3::new(1.0, 1.0, 1e-6), DVec3::new(1.0, 1e6, 1.0)] {
        let data = noise([6, 6, 6], spacing, DMat3::IDENTITY, 9);
        let view = View::fit(data.bounds(), 40.0, 24, 18);
        for kind in SMOOTH {
            checked(kind, &data, &[Surface::isovalue(0.5, 0)], &view);
        }
    }
    let samples: Vec<f32> = (0..33 * 33 * 33).map(|i| (i % 33) as f32).collect();
    let data = grid([33; 3], Samples::F32(samples.into()));
    let ray = Ray {
        origin: DVec3::new(-1e12, 10.3, 10.7),
        direction: DVec3::X,
    };
    for kind in SMOOTH {
        let (f, _) = draw(kind, &data, &[Surface::isovalue(16.25, 0)], &View::rays(vec![ray]), 2);
        assert_eq!((f.hits[0], f.claim[0]), (1, Claim::EXISTS | Claim::FIRST), "{kind}: at 10^12");
        // Numbers next to each other are 1.2e-4 apart there.
        assert!((f.t[0] - 1e12 - 16.25).abs() < 2.5e-4, "{kind}: {}", f.t[0]);
    }
}

#[test]
fn what_cannot_be_is_refused_and_knobs_take_effect() {
    let thin = grid([5, 1, 5], Samples::U8(vec![0u8; 25].into()));
    for kind in SMOOTH {
        let error = open(kind, 1).set_data(&thin).unwrap_err();
        let RenderError::Data(DataError::TooThin { reconstruction, .. }) = &error else {
            panic!("{error}")
        };
        assert_eq!(reconstruction, kind.name());
    }
    assert!(
        OCTREE_CPU
            .open(&Request {
                knobs: Knobs::default().with("reconstruction", "quintic"),
                ..Request::default()
            })
            .is_err()
    );

    // The same renderer with another reconstruction draws what one opened with it draws; so it does without claims.
    let data = noise([9; 3], DVec3::ONE, DMat3::IDENTITY, 8);
    let (surfaces, view) = ([Surface::isovalue(0.5, 0)], View::fit(data.bounds(), 40.0, 32, 24));
    let mut r = open(Kind::Trilinear, 1);
    r.set_surfaces(&surfaces).unwrap();
    r.set_data(&data).unwrap();
    r.set_view(&view).unwrap();
    for kind in SMOOTH {
        r.set_knobs(&Knobs::default().with("reconstruction", kind.name())).unwrap();
        r.render(&Stop::default()).unwrap();
        let mut f = Frame::default();
        r.read(&mut f).unwrap();
        let (want, other) = draw(kind, &data, &surfaces, &view, 1);
        assert_eq!(f, want, "{kind}");
        assert_eq!(
            r.memory().coefficients,
            if kind.interpolates() { 4 * 729 } else { 0 },
            "{kind}"
        );
        assert_eq!(other.reconstruction(Stage::Ideal).unwrap().name(), kind.name());
        assert!(r.counters().0.iter().any(|(n, v)| *n == "compositions in f64" && *v > 0));
        r.set_knobs(&Knobs::default().with("reconstruction", kind.name()).with("claims", "off"))
            .unwrap();
        r.render(&Stop::default()).unwrap();
        r.read(&mut f).unwrap();
        assert!(f.t == want.t && f.claim.iter().all(|c| c.is_empty()) && f.t_error.iter().all(|e| e.is_infinite()));
    }
}

/// Isovalues by turns, each drawn from two sides and again: cells that planes have left too many are taken back on the way, words are made in memory that held others. All frames are
/// those of a renderer that has seen nothing else.
#[test]
fn isovalues_by_turns_change_nothing() {
    let fields = [
        (isobar_scenes::synthetic("gyroid,n=45"), [0.2, 0.9, 0.2, 0.200_001]),
        (isobar_scenes::synthetic("gyroid,n=90"), [0.2, -1.1, 0.2, 0.3]),
        (noise([19, 22, 17], DVec3::ONE, DMat3::IDENTITY, 3), [0.5, 0.2, 0.5, 0.51]),
    ];
    for (data, isovalues) in &fields {
        let views = [1.0, -1.0].map(|side| View::fit_from(data.bounds(), DVec3::new(side, 0.7, 0.4), DVec3::Z, 40.0, 64, 48));
        for kind in SMOOTH.into_iter().chain([Kind::Trilinear]) {
            let mut r = open(kind, 1);
            r.set_data(data).unwrap();
            for isovalue in isovalues {
                let surfaces = [Surface::isovalue(*isovalue, 0)];
                r.set_surfaces(&surfaces).unwrap();
                for view in views.iter().chain(&views) {
                    r.set_view(view).unwrap();
                    r.render(&Stop::default()).unwrap();
                    let mut frame = Frame::default();
                    r.read(&mut frame).unwrap();
                    let (fresh, _) = draw(kind, data, &surfaces, view, 1);
                    assert!(frame.t == fresh.t && frame.claim == fresh.claim, "{kind} at {isovalue}");
                }
            }
        }
    }
}
