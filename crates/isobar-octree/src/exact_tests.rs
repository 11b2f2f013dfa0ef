//! Rays that f64 leaves open: what exact arithmetic makes of them. And hard rays as pixels of views, which travel in packets.

use crate::OCTREE_CPU;
use isobar_core::{
    Camera, Channels, Claim, DMat3, DVec3, Data, Frame, Function, Grid, Knobs, Method, Ray, Renderer, Request, Samples, Stage,
    Stop, Surface, View,
};
use isobar_fields::{GridSpline, Kind, Synthetic};
use isobar_oracle::{Truth, check};
use std::sync::Arc;

const PLAIN: [Kind; 3] = [Kind::Trilinear, Kind::Quadratic, Kind::Cubic];

struct Random(u64);

impl Random {
    fn unit(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    fn vector(&mut self) -> DVec3 {
        DVec3::new(self.unit(), self.unit(), self.unit())
    }
}

fn grid(dims: [usize; 3], axes: DMat3, sample: impl Fn([usize; 3]) -> f32) -> Arc<Data> {
    let [nx, ny, _] = dims;
    let samples: Vec<f32> = (0..dims.iter().product())
        .map(|i| sample([i % nx, i / nx % ny, i / nx / ny]))
        .collect();
    let origin = DVec3::new(0.25, -3.1, 11.7);
    Arc::new(Data::Grid(
        Grid::new(dims, DVec3::new(1.0, 0.7, 1.3), origin, axes, Samples::F32(samples.into())).unwrap(),
    ))
}

fn noise(dims: [usize; 3], axes: DMat3, seed: u64) -> Arc<Data> {
    let mut random = Random(seed);
    let values: Vec<f32> = (0..dims.iter().product()).map(|_| random.unit() as f32).collect();
    grid(dims, axes, |[x, y, z]| values[(z * dims[1] + y) * dims[0] + x])
}

/// A frame with its renderer, held against the oracle: nothing missed, false, wrong or refuted.
pub(crate) struct Drawn {
    pub(crate) frame: Frame,
    renderer: Box<dyn Renderer>,
    pub(crate) truth: Truth,
}

impl Drawn {
    pub(crate) fn new(name: &str, kind: Kind, data: &Arc<Data>, isovalues: &[f64], view: &View, channels: Channels) -> Self {
        let surfaces: Vec<_> = isovalues.iter().enumerate().map(|(i, &c)| Surface::isovalue(c, i)).collect();
        let request = Request {
            channels,
            knobs: Knobs::default().with("reconstruction", kind.name()),
            ..Request::default()
        };
        let mut renderer = OCTREE_CPU.open(&request).unwrap();
        renderer.set_data(data).unwrap();
        renderer.set_surfaces(&surfaces).unwrap();
        renderer.set_view(view).unwrap();
        renderer.render(&Stop::default()).unwrap();
        let mut frame = Frame::default();
        renderer.read(&mut frame).unwrap();
        let f = renderer.reconstruction(Stage::Stored).unwrap();
        let truth = Truth::compute(&f, &surfaces, view, &Stop::default()).unwrap();
        let c = check(&frame, &truth, &f, &surfaces, view).unwrap();
        let wrong = (c.missed, c.false_hits, c.wrong_root, c.wrong_surface, c.refuted);
        assert_eq!(wrong, (0, 0, 0, 0, 0), "{name}, {kind}: {:?} {:?}", frame.t, frame.claim);
        Self { frame, renderer, truth }
    }

    pub(crate) fn count(&self, name: &str) -> u64 {
        self.renderer.counters().0.iter().find(|c| c.0 == name).unwrap().1
    }

    /// Every pixel is decided, and as the oracle decides it, also where it calls a pixel sensitive.
    pub(crate) fn is_decided(&self, name: &str) {
        for (i, p) in self.truth.pixels.iter().enumerate() {
            assert!(!p.unresolved, "{name}, pixel {i}: the oracle does not know");
            let claim = self.frame.claim[i];
            let want = if p.is_hit() {
                Claim::EXISTS | Claim::FIRST
            } else {
                Claim::EMPTY
            };
            assert!(claim.contains(want), "{name}, pixel {i}: {claim:?} instead of {want:?}");
            let (t, e) = (self.frame.t[i], self.frame.t_error[i]);
            assert!(
                !p.is_hit() || t - e <= p.hi && p.lo <= t + e,
                "{name}, pixel {i}: {t} +- {e} and {p:?}"
            );
        }
    }
}

/// The greatest value along a ray between t0 and t1, which lies inside, and not at an end of a smooth piece for degrees 2 and 3.
fn greatest(f: &dyn Function, ray: &Ray, [t0, t1]: [f64; 2]) -> Option<f64> {
    let steps = 600;
    let at = |i: usize| t0 + (t1 - t0) * i as f64 / steps as f64;
    let value = |t: f64| f.value(ray.at(t));
    let best = (0..=steps).max_by(|&i, &j| value(at(i)).total_cmp(&value(at(j))))?;
    if best == 0 || best == steps {
        return None;
    }
    let (mut lo, mut hi) = (at(best - 1), at(best + 1));
    for _ in 0..60 {
        let (a, b) = (lo + (hi - lo) * 0.4, lo + (hi - lo) * 0.6);
        if value(a) < value(b) { lo = a } else { hi = b }
    }
    Some(value(0.5 * (lo + hi)))
}

/// Rays that pass the surface at 1e-16 to 1e-14 of the range of the samples, on both sides of touching it: f64 tells nothing about them.
#[test]
fn near_misses_are_decided() {
    let turned = DMat3::from_rotation_z(0.3) * DMat3::from_rotation_x(-1.1);
    let (mut exact, mut all, mut hits) = (0, 0, 0);
    for (n, axes) in [DMat3::IDENTITY, turned].into_iter().enumerate() {
        let data = noise([5, 6, 4], axes, 3 + n as u64);
        let Data::Grid(g) = &*data else { panic!("a grid") };
        for kind in PLAIN {
            let f = GridSpline::new(g, kind, Stage::Stored).unwrap();
            let (lo, hi) = data.bounds();
            let mut random = Random(17);
            for i in 0..8 {
                let p = lo + (hi - lo) * (0.3 + 0.4 * random.vector());
                let d = random.vector() - 0.5;
                let ray = Ray {
                    origin: p - 9.0 * d.normalize(),
                    direction: d,
                };
                let Some((t0, t1)) = f.domain().clip(&ray) else { continue };
                let Some(c) = greatest(&f, &ray, [t0, t1]) else { continue };
                for off in [-1e-14, -1e-15, -1e-16, 3e-16, 1e-15, 1e-14] {
                    let name = format!("axes {n}, {kind}, ray {i}, {off:e}");
                    let drawn = Drawn::new(&name, kind, &data, &[c + off], &View::rays([ray]), Channels::all());
                    drawn.is_decided(&name);
                    all += 1;
                    exact += drawn.count("rays exact");
                    hits += u64::from(drawn.frame.hits[0] > 0);
                    assert_eq!(drawn.count("rays undecided"), 0, "{name}");
                }
            }
        }
    }
    // f64 proves some of the farther ones of degree 1.
    assert!(
        exact > all * 2 / 3 && hits > all / 4 && hits < all * 3 / 4,
        "{exact} exact, {hits} hits of {all}"
    );
}

/// Touching is decided, at a dyadic number and at another one.
#[test]
fn what_touches_exactly() {
    let unit = |v: [f32; 4]| {
        let samples: Vec<f32> = (0..8).map(|i| v[i % 4]).collect();
        Arc::new(Data::Grid(Grid::unit([2; 3], Samples::F32(samples.into())).unwrap()))
    };
    let diagonal = |x: f64| Ray {
        origin: DVec3::new(x, -1.0, 0.5),
        direction: DVec3::new(1.0 - 2.0 * f64::from(u8::from(x > 0.0)), 1.0, 0.0),
    };
    // x y along x = 1 - y: a quarter at most, at 1/2.
    let product = unit([0.0, 0.0, 0.0, 1.0]);
    let drawn = Drawn::new(
        "1/2",
        Kind::Trilinear,
        &product,
        &[0.25],
        &View::rays([diagonal(2.0)]),
        Channels::all(),
    );
    drawn.is_decided("1/2");
    assert_eq!((drawn.frame.hits[0], drawn.frame.t[0]), (1, 1.5));
    // (1 - 3x)(1 - 3y) along x = y: zero at 1/3, twice.
    let square = unit([1.0, -2.0, -2.0, 4.0]);
    let drawn = Drawn::new(
        "1/3",
        Kind::Trilinear,
        &square,
        &[0.0],
        &View::rays([diagonal(-1.0)]),
        Channels::all(),
    );
    drawn.is_decided("1/3");
    assert_eq!(drawn.frame.hits[0], 1);
    assert!((drawn.frame.t[0] - 4.0 / 3.0).abs() < 1e-15);
    assert_eq!((drawn.count("rays exact"), drawn.count("rays undecided")), (1, 0));
}

/// Rays inside faces of the domain, along its edges, through corners of cells; and a stretch on which s = c.
#[test]
fn faces_edges_and_plateaus_are_decided() {
    let data = noise([4, 5, 6], DMat3::IDENTITY, 11);
    let Data::Grid(g) = &*data else { panic!("a grid") };
    let domain = g.domain();
    let at = |x: f64, y: f64, z: f64| domain.world(DVec3::new(x, y, z));
    let mut rays = Vec::new();
    for (p, q) in [
        (at(0.0, 1.3, -2.0), at(0.0, 2.2, 3.0)),
        (at(-2.0, 0.0, 0.0), at(5.0, 0.0, 0.0)),
        (at(1.0, -1.0, 2.0), at(1.0, 6.0, 2.0)),
        (at(-1.0, -1.0, -1.0), at(2.0, 2.0, 2.0)),
        (at(3.0, 7.0, 1.25), at(3.0, -1.0, 1.5)),
    ] {
        rays.push(Ray {
            origin: p,
            direction: q - p,
        });
    }
    for kind in Kind::ALL {
        for c in [0.4, 0.6, g.samples.get(21)] {
            let drawn = Drawn::new("faces", kind, &data, &[c], &View::rays(rays.clone()), Channels::all());
            drawn.is_decided(&format!("faces, {kind}, {c}"));
        }
    }
    // Some samples are 1 and fill cells and stencils with it.
    let data = grid([9, 8, 8], DMat3::IDENTITY, |[x, _, _]| {
        [0.0, 0.5, 1.0, 1.0, 1.0, 1.0, 1.0, 2.0, 3.0][x]
    });
    let (lo, hi) = data.bounds();
    let mut random = Random(2);
    let rays: Vec<Ray> = (0..20)
        .map(|_| {
            let p = lo + (hi - lo) * (0.2 + 0.6 * random.vector());
            let direction = (p - lo) + random.vector();
            Ray {
                origin: p - 20.0 * direction,
                direction,
            }
        })
        .collect();
    for kind in PLAIN {
        let drawn = Drawn::new("plateau", kind, &data, &[1.0], &View::rays(rays.clone()), Channels::all());
        drawn.is_decided(&format!("plateau, {kind}"));
        assert!(drawn.frame.hits.iter().all(|&n| n <= 1), "{kind}: {:?}", drawn.frame.hits);
    }
}

/// A frame full of plateaus is decided whole.
#[test]
fn constant_volumes_are_decided() {
    let data = grid([9, 7, 8], DMat3::IDENTITY, |_| 7.0);
    let view = View::fit(data.bounds(), 30.0, 64, 48);
    for kind in PLAIN {
        for channels in [Channels::all() - Channels::HITS, Channels::all()] {
            let drawn = Drawn::new("constant", kind, &data, &[7.0], &view, channels);
            drawn.is_decided(&format!("constant, {kind}"));
            let exact = drawn.count("rays exact");
            assert!(exact > 500 && drawn.count("rays alone") >= exact, "{kind}: {exact}");
            assert_eq!(drawn.count("rays undecided"), 0, "{kind}");
        }
    }
}

/// One sample so great that f64 tells nothing about the others: small volumes are decided whole, of larger ones in larger images as many rays of every tile as the work allows.
#[test]
fn a_frame_has_its_limit() {
    let of = |n: usize| {
        let mut random = Random(n as u64);
        let values: Vec<f32> = (0..n * n * n).map(|_| random.unit() as f32).collect();
        grid([n; 3], DMat3::IDENTITY, |[x, y, z]| {
            if [x, y, z] == [0; 3] {
                1e14
            } else {
                values[(z * n + y) * n + x]
            }
        })
    };
    let (small, large) = (of(5), of(48));
    for kind in PLAIN {
        let view = View::fit(small.bounds(), 30.0, 32, 24);
        let drawn = Drawn::new("small", kind, &small, &[0.45], &view, Channels::all() - Channels::HITS);
        drawn.is_decided(&format!("small, {kind}"));
        assert!(drawn.count("rays exact") > 100, "{kind}: {}", drawn.count("rays exact"));
        let view = View::fit(large.bounds(), 30.0, 128, 128);
        let draw = |view: &View| {
            let request = Request {
                channels: Channels::all(),
                knobs: Knobs::default().with("reconstruction", kind.name()),
                ..Request::default()
            };
            let mut r = OCTREE_CPU.open(&request).unwrap();
            r.set_data(&large).unwrap();
            r.set_surfaces(&[Surface::isovalue(0.45, 0)]).unwrap();
            r.set_view(view).unwrap();
            r.render(&Stop::default()).unwrap();
            let mut frame = Frame::default();
            r.read(&mut frame).unwrap();
            (frame, r.counters().0.iter().find(|c| c.0 == "rays exact").unwrap().1)
        };
        let (frame, exact) = draw(&view);
        let claimed = frame.claim.iter().filter(|c| !c.is_empty()).count();
        assert!(
            exact > 40 && claimed < 128 * 128 - 1000,
            "{kind}: {exact} exact, {claimed} claimed"
        );
        // What is decided is what is decided without a limit.
        let decided = |c: Claim| c.contains(Claim::EXISTS | Claim::FIRST) || c.contains(Claim::EMPTY);
        let some: Vec<usize> = (0..128 * 128).filter(|&i| decided(frame.claim[i])).step_by(211).collect();
        let list = View::rays(some.iter().map(|&i| view.ray(i % 128, i / 128)).collect::<Vec<_>>());
        let (all, _) = draw(&list);
        for (j, &i) in some.iter().enumerate() {
            let (t, also) = (frame.t[i], all.t[j]);
            let near = t == also || (t - also).abs() <= frame.t_error[i] + all.t_error[j];
            assert!(all.claim[j] == frame.claim[i] && near, "{kind}, pixel {i}: {t} and {also}");
        }
    }
}

/// Volumes smaller than the stencil, with spacings 1e6 : 1, and one sample thick.
#[test]
fn small_stretched_and_thin_volumes() {
    let of = |dims: [usize; 3], spacing: DVec3, seed: u64| {
        let mut random = Random(seed);
        let samples: Vec<f32> = (0..dims.iter().product()).map(|_| random.unit() as f32).collect();
        Grid::new(dims, spacing, DVec3::ZERO, DMat3::IDENTITY, Samples::F32(samples.into()))
    };
    let cases = [
        ([2, 2, 2], DVec3::ONE),
        ([2, 3, 2], DVec3::ONE),
        ([5, 2, 7], DVec3::ONE),
        ([5, 4, 5], DVec3::new(1.0, 1e6, 1.0)),
        ([5, 4, 5], DVec3::new(1.0, 1.0, 1e-6)),
    ];
    for (n, (dims, spacing)) in cases.into_iter().enumerate() {
        let data = Arc::new(Data::Grid(of(dims, spacing, n as u64 + 1).unwrap()));
        let view = View::fit(data.bounds(), 40.0, 40, 30);
        for kind in Kind::ALL {
            let name = format!("{dims:?}, {spacing}");
            for channels in [Channels::all() - Channels::HITS, Channels::all()] {
                let drawn = Drawn::new(&name, kind, &data, &[0.5], &view, channels);
                drawn.is_decided(&name);
            }
        }
    }
    let thin = Arc::new(Data::Grid(of([5, 1, 5], DVec3::ONE, 1).unwrap()));
    for kind in Kind::ALL {
        let request = Request {
            knobs: Knobs::default().with("reconstruction", kind.name()),
            ..Request::default()
        };
        let error = OCTREE_CPU.open(&request).unwrap().set_data(&thin).unwrap_err().to_string();
        assert!(!error.is_empty() && !error.contains('\n'), "{kind}: {error}");
    }
}

/// Views whose middle pixel is the given ray: parallel, with exactly its origin, and from its origin.
fn views_of(ray: &Ray) -> [View; 2] {
    let (eye, d) = (ray.origin, ray.direction.normalize());
    let target = eye + d * 2f64.powi(-20) * eye.abs().max_element().max(1.0);
    let up = d.any_orthonormal_vector();
    [
        View {
            camera: Camera::Orthographic {
                eye,
                target,
                up,
                height: 1e-9,
            },
            ..View::bench(5, 5)
        },
        View::perspective(eye, target, up, 1e-7, 5, 5),
    ]
}

/// hardcases B and C as pixels: rays through edges, vertices, saddles, plateaus and touching points, and those beside them, for one isovalue, for several, and for one that is far outside.
#[test]
fn hard_rays_go_in_packets_too() {
    let of = |f: &dyn Fn(f64, f64, f64) -> f64| {
        let samples: Vec<f32> = (0..7 * 7 * 7)
            .map(|i| f((i % 7) as f64 - 3.0, (i / 7 % 7) as f64 - 3.0, (i / 49) as f64 - 3.0) as f32)
            .collect();
        Arc::new(Data::Grid(Grid::unit([7; 3], Samples::F32(samples.into())).unwrap()))
    };
    let synthetic = |spec: &str| Arc::new(spec.parse::<Synthetic>().unwrap().data().unwrap());
    let cases = [
        ("C5", of(&|x, _, _| x.abs())),
        ("C7", of(&|x, y, z| x * x + y * y + z * z)),
        ("B2", of(&|x, y, z| x * y - z)),
        ("B7", of(&|x, _, _| x.abs().max(1.0) - 1.0)),
        ("B5", of(&|x, y, z| f64::from(x.abs() + y.abs() + z.abs() < 0.5) - 1.0)),
        ("C4", synthetic("torus,n=17")),
        ("C8c", synthetic("steinberger-c,n=17")),
    ];
    let (mut together, mut all) = (0, 0);
    for (name, data) in &cases {
        let (lo, hi) = data.bounds();
        let (middle, size) = ((lo + hi) * 0.5, (hi - lo).max_element());
        for (offset, d) in [
            (DVec3::ZERO, DVec3::ONE),
            (DVec3::ZERO, DVec3::new(1.0, -0.5, 0.25)),
            (DVec3::new(0.0, 0.5, 0.25), DVec3::new(-1.0, 0.5, 2.0)),
            (DVec3::new(0.125, 0.0, 0.0), DVec3::new(1.0, 1.0, 0.0)),
            (DVec3::ZERO, DVec3::X),
        ] {
            let ray = Ray {
                origin: middle + offset * size / 6.0 - d * 1.5 * size,
                direction: d,
            };
            for view in views_of(&ray) {
                assert!((view.ray(2, 2).origin, view.ray(2, 2).direction.cross(d).length() < 1e-9) == (ray.origin, true));
                for kind in PLAIN {
                    for values in [&[0.0][..], &[0.0, 0.25], &[-1e12, 0.0, 3.0]] {
                        for channels in [Channels::all() - Channels::HITS, Channels::all()] {
                            let drawn = Drawn::new(name, kind, data, values, &view, channels);
                            all += 1;
                            together += u64::from(drawn.count("rays alone") < 25);
                        }
                    }
                }
            }
        }
    }
    assert!(together > all / 4, "{together} frames of {all} have rays that go together");
}

/// The rays of `proofs.rs` that once led to wrong claims are lists; here tiles in which directions differ in sign, and in which some rays are parallel to an axis plane.
#[test]
fn tiles_of_all_signs_go_in_packets() {
    let data = noise([9, 11, 8], DMat3::IDENTITY, 5);
    let (lo, hi) = data.bounds();
    let middle = (lo + hi) * 0.5;
    for (n, axis) in [DVec3::X, -DVec3::Y, DVec3::Z].into_iter().enumerate() {
        let up = DVec3::new(0.3, 0.2, 0.1) + DVec3::AXES[(n + 1) % 3];
        let views = [
            View::perspective(middle - axis * 20.0, middle, up, 40.0, 33, 33),
            // From inside, all octants; and straight along the axes, so that a column and a row are parallel to a plane.
            View::perspective(middle, middle + DVec3::new(0.1, 0.05, 0.02), up, 150.0, 33, 33),
            View::perspective(middle - axis * 20.0, middle, DVec3::AXES[(n + 1) % 3], 40.0, 33, 33),
        ];
        for (i, view) in views.iter().enumerate() {
            for kind in PLAIN {
                for (channels, values) in [
                    (Channels::all() - Channels::HITS, &[0.6][..]),
                    (Channels::all(), &[0.55]),
                    (Channels::all() - Channels::HITS, &[-1e9, 0.4, 0.6]),
                ] {
                    let drawn = Drawn::new("signs", kind, &data, values, view, channels);
                    let alone = drawn.count("rays alone");
                    assert!(
                        alone < if i == 2 { 120 } else { 40 },
                        "axis {n}, view {i}, {kind}: {alone} rays alone"
                    );
                    assert!(drawn.frame.t.iter().filter(|t| t.is_finite()).count() > 200);
                }
            }
        }
    }
}

/// An isovalue far outside the data puts no ray of the others in doubt.
#[test]
fn far_isovalues_disturb_no_other() {
    let data = Arc::new("gyroid,n=24".parse::<Synthetic>().unwrap().data().unwrap());
    let view = View::bench(64, 48);
    for kind in PLAIN {
        let alone = |values: &[f64]| {
            let drawn = Drawn::new("far", kind, &data, values, &view, Channels::all() - Channels::HITS);
            (drawn.count("rays alone"), drawn.frame.t)
        };
        let (near, far) = (alone(&[0.2]), alone(&[-1e13, 0.2, 1e13]));
        assert!(near.0 <= 5 && far.0 <= near.0 + 5, "{kind}: {} and {}", near.0, far.0);
        let apart = near
            .1
            .iter()
            .zip(&far.1)
            .filter(|(a, b)| a != b && (*a - *b).abs() > 1e-9)
            .count();
        assert_eq!(apart, 0, "{kind}");
    }
}
