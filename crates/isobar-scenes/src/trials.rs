//! Tests that more than one method has to pass.

use crate::{Random, cube, draw, lattices, noise, open, random_grid, ray, redraw, request, synthetic};
use isobar_core::{
    Algebraic, Camera, Channels, Claim, ClipPlane, DMat3, DVec3, Data, DataError, Frame, Grid, Knobs, Method, Ray, RenderError,
    Renderer, Request, Samples, Sampling, Stage, Stop, Surface, SurfaceKind, TransferFunction, Unsupported, View,
};
use isobar_oracle::{Check, Oracle};
use std::sync::Arc;

/// Noise to try things out on, with the isovalue 0.
#[must_use]
pub fn small_noise() -> Arc<Data> {
    Arc::new(Data::Grid(random_grid([10, 11, 12], 3)))
}

/// The isovalue 0.
#[must_use]
pub fn zero() -> [Surface; 1] {
    [Surface::isovalue(0.0, 0)]
}

/// [`small_noise`] elsewhere.
#[must_use]
pub fn moved_noise() -> Arc<Data> {
    let origin = DVec3::new(1.0, 2.0, -1.0);
    Arc::new(Data::Grid(Grid {
        origin,
        ..random_grid([10, 11, 12], 3)
    }))
}

/// Views of [`small_noise`]: one that fits it, one with parallel rays.
#[must_use]
pub fn near_and_parallel() -> [View; 2] {
    let near = View::fit(small_noise().bounds(), 40.0, 33, 21);
    let parallel = View {
        camera: Camera::Orthographic {
            eye: DVec3::new(-9.0, 5.0, 5.0),
            target: DVec3::splat(5.0),
            up: DVec3::Z,
            height: 12.0,
        },
        ..near.clone()
    };
    [near, parallel]
}

/// A wide view of [`small_noise`] from another side.
#[must_use]
pub fn wide(width: usize, height: usize) -> View {
    View::fit_from(
        small_noise().bounds(),
        DVec3::new(-1.0, 2.0, 0.5),
        DVec3::Z,
        60.0,
        width,
        height,
    )
}

/// A view with a closed cut.
#[must_use]
pub fn capped(view: &View) -> View {
    let plane = ClipPlane {
        normal: DVec3::X,
        distance: 0.0,
        cap: true,
    };
    View {
        clips: vec![plane],
        ..view.clone()
    }
}

/// White noise on every lattice, with its size: every cell is active and every case of a cell is there. `checked`: draws it and looks.
pub fn noise_on_lattices(width: usize, height: usize, mut checked: impl FnMut(&Arc<Data>, &View, [usize; 3])) {
    for (i, (dims, spacing, direction)) in lattices().into_iter().enumerate() {
        let data = noise(dims, spacing, direction, i as u64 + 1);
        checked(&data, &View::fit(data.bounds(), 40.0, width, height), dims);
    }
}

/// So many rays through noise, from outside and inside: every hit is a root and every root is hit, in order. Gives the number of roots.
///
/// # Panics
/// Where it is not so.
pub fn all_hits(method: &dyn Method, count: usize, isovalue: f64) -> usize {
    let data = noise([8, 9, 10], DVec3::ONE, DMat3::IDENTITY, 77);
    let (lo, hi) = data.bounds();
    let mut random = Random(5);
    let rays: Vec<Ray> = (0..count)
        .map(|_| {
            let p = lo + (hi - lo) * random.vector();
            let d = random.direction();
            let back = if random.unit() < 0.7 { 30.0 } else { 0.0 };
            Ray {
                origin: p - d * back,
                direction: d,
            }
        })
        .collect();
    hits_are_roots(method, &data, isovalue, &rays, 40, 1e-8)
}

/// Every hit of the rays is a root of the oracle's, to `apart` along the ray, and every root is hit, in order. Gives the number of roots.
///
/// # Panics
/// Where it is not so.
pub fn hits_are_roots(method: &dyn Method, data: &Arc<Data>, isovalue: f64, rays: &[Ray], layers: usize, apart: f64) -> usize {
    let mut r = open(method, &request(layers, Knobs::default()));
    let f = draw(&mut *r, data, &[Surface::isovalue(isovalue, 0)], &View::rays(rays.to_vec()));
    let oracle = Oracle::new(r.reconstruction(Stage::Stored).unwrap(), isovalue);
    let mut total = 0;
    for (i, ray) in rays.iter().enumerate() {
        let roots = oracle.all(ray).roots;
        assert_eq!(usize::from(f.hits[i]), roots.len(), "ray {i}: {roots:?}");
        for (l, root) in roots.iter().enumerate() {
            let t = f.t[l * rays.len() + i];
            assert!(root.distance(t) < apart, "ray {i}, layer {l}: {t} instead of {root:?}");
        }
        total += roots.len();
    }
    total
}

/// Rays in each of the directions towards the middle, from 20 of them before it, moved by each of the offsets.
#[must_use]
pub fn rays_towards(middle: DVec3, directions: &[DVec3], offsets: &[DVec3]) -> Vec<Ray> {
    let from = |d: DVec3, e: DVec3| Ray {
        origin: middle - d * 20.0 + e,
        direction: d,
    };
    directions
        .iter()
        .flat_map(|&d| offsets.iter().map(move |&e| from(d, e)))
        .collect()
}

/// Three isovalues, one of them seen through: their hits are in order.
///
/// # Panics
/// Where they are not.
pub fn several_isovalues(method: &dyn Method, checked: impl FnOnce(&Arc<Data>, &[Surface], &View)) {
    let data = synthetic("gyroid,n=32");
    let mut s: [Surface; 3] = std::array::from_fn(|i| Surface::isovalue([0.2, -0.3, 0.9][i], i));
    s[1].opacity = 0.4;
    let view = View::bench(96, 72);
    checked(&data, &s, &view);
    let f = draw(&mut *open(method, &request(6, Knobs::default())), &data, &s, &view);
    let n = 96 * 72;
    for i in 0..n {
        assert!(
            (1..6).all(|l| f.t[l * n + i] >= f.t[(l - 1) * n + i]),
            "pixel {i} is out of order"
        );
    }
    assert!([0, 1, 2].iter().all(|s| f.surface.contains(s)));
}

/// hardcases B5, B7: an isovalue equal to samples, plateaus included.
pub fn plateaus(checked: impl FnOnce(&Arc<Data>, &[Surface], &View)) {
    let mut random = Random(3);
    let samples: Vec<u8> = (0..6 * 7 * 8).map(|_| (random.unit() * 3.0) as u8).collect();
    let data = Arc::new(Data::Grid(Grid::unit([6, 7, 8], Samples::U8(samples.into())).unwrap()));
    checked(&data, &[Surface::isovalue(1.0, 0)], &View::fit(data.bounds(), 40.0, 64, 48));
}

/// hardcases E1 and B17: far eyes and extreme aspects neither lose hits nor claim what is not proved. `exact`: what f64 does not prove from 10^12 away is decided all the same.
///
/// # Panics
/// Where they do.
pub fn far_eyes_and_thin_cells(method: &dyn Method, exact: bool, checked: impl FnOnce(&Arc<Data>, &[Surface], &View)) {
    let data = noise([6, 6, 6], DVec3::new(1.0, 1.0, 1e-6), DMat3::IDENTITY, 9);
    checked(&data, &[Surface::isovalue(0.5, 0)], &View::fit(data.bounds(), 40.0, 32, 24));
    let far = ray([-1e12, 0.01, 0.02], [1.0, 0.0, 0.0]);
    let view = View::rays(vec![far]);
    let mut r = open(method, &request(2, Knobs::default()));
    let f = draw(&mut *r, &synthetic("sphere,n=33"), &[Surface::isovalue(1.0, 0)], &view);
    let claim = if exact { Claim::EXISTS | Claim::FIRST } else { Claim::empty() };
    assert_eq!((f.hits[0], f.claim[0]), (2, claim), "at 10^12");
    if exact {
        // Numbers next to each other are 1.2e-4 apart there.
        let roots = Oracle::new(r.reconstruction(Stage::Stored).unwrap(), 1.0).all(&far).roots;
        assert!(
            roots.iter().zip(&f.t).all(|(root, t)| root.distance(*t) < 2.5e-4),
            "{:?}: {roots:?}",
            f.t
        );
    }
}

/// Without claims nothing is claimed; an isovalue outside the range, after `change`, is a proved miss that needs less memory. Gives the renderer.
///
/// # Panics
/// Where it is not so.
pub fn claims_and_isovalues(method: &dyn Method, change: &Knobs) -> Box<dyn Renderer> {
    let mut r = open(method, &request(1, Knobs::default()));
    r.set_data(&synthetic("gyroid,n=24")).unwrap();
    r.set_view(&View::bench(40, 30)).unwrap();
    assert!(matches!(r.render(&Stop::default()), Err(RenderError::NotReady(_))));
    r.set_surfaces(&[Surface::isovalue(0.2, 0)]).unwrap();
    r.set_knobs(&Knobs::default().with("claims", "off")).unwrap();
    let f = redraw(&mut *r);
    assert!(f.claim.iter().all(|c| c.is_empty()) && f.t_error.iter().all(|e| e.is_infinite()));
    let before = r.memory().index;
    r.set_surfaces(&[Surface::isovalue(50.0, 0)]).unwrap();
    r.set_knobs(change).unwrap();
    let f = redraw(&mut *r);
    assert!(
        f.claim.iter().all(|c| *c == Claim::EMPTY),
        "an isovalue outside the range is a proved miss"
    );
    assert!(r.memory().index < before);
    r
}

/// What a method of isosurfaces on grids cannot draw is refused, in one of the ways of [`RenderError`], and what was set before is drawn as it was. `views` and `knobs`: more that it refuses.
///
/// # Panics
/// Where it is not so.
pub fn refusals(method: &dyn Method, views: &[View], knobs: &[Knobs]) {
    let data = small_noise();
    let mut r = open(method, &Request::default());
    assert!(matches!(r.read(&mut Frame::default()), Err(RenderError::NotReady("render"))));
    assert!(matches!(r.render(&Stop::default()), Err(RenderError::NotReady("set_data"))));
    let first = draw(&mut *r, &data, &zero(), &View::fit(data.bounds(), 40.0, 20, 16));
    assert!(first.t.iter().any(|t| t.is_finite()));
    let algebraic = Arc::new(Data::Algebraic(Algebraic {
        name: "x".into(),
        terms: vec![([1, 0, 0], 1.0)].into(),
        lo: DVec3::ZERO,
        hi: DVec3::ONE,
    }));
    assert!(matches!(
        r.set_data(&algebraic),
        Err(RenderError::Unsupported(Unsupported::DataKind { .. }))
    ));
    let grid = |samples: Vec<f32>, dims| Arc::new(Data::Grid(Grid::unit(dims, Samples::F32(samples.into())).unwrap()));
    assert!(matches!(
        r.set_data(&grid(vec![0.0, f32::NAN, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [2; 3])),
        Err(RenderError::Data(DataError::NotFinite { count: 1, total: 8 }))
    ));
    assert!(matches!(
        r.set_data(&grid(vec![0.0; 9], [3, 3, 1])),
        Err(RenderError::Data(DataError::TooThin { .. }))
    ));
    let boundary = Surface {
        kind: SurfaceKind::Boundary,
        ..zero()[0]
    };
    for surface in [boundary, Surface::isovalue(f64::NAN, 0)] {
        assert!(matches!(r.set_surfaces(&[surface]), Err(RenderError::Unsupported(_))));
    }
    let medium = TransferFunction {
        points: vec![],
        unit: 1.0,
    };
    assert!(matches!(r.set_medium(Some(&medium)), Err(RenderError::Unsupported(_))));
    r.set_medium(None).unwrap();
    for (w, h) in [(0, 4), (4, 0), (70_000, 1)] {
        assert!(matches!(r.set_view(&View::bench(w, h)), Err(RenderError::View(_))), "{w}x{h}");
    }
    for view in views {
        assert!(matches!(r.set_view(view), Err(RenderError::Unsupported(_))), "{view:?}");
    }
    for knobs in knobs {
        assert!(matches!(r.set_knobs(knobs), Err(RenderError::Knob { .. })), "{knobs:?}");
    }
    // Nothing of this changed what is drawn.
    assert_eq!(redraw(&mut *r), first);
    let frusta = Request {
        sampling: Sampling::PixelFrustum,
        ..Request::default()
    };
    assert!(matches!(method.open(&frusta), Err(RenderError::Unsupported(_))));
}

/// Frames too large for a device are [`RenderError::Memory`], and so is a grid of more than `longest` samples along an axis.
///
/// # Panics
/// Where they are not.
pub fn absurd_sizes(method: &dyn Method, longest: usize) {
    let data = small_noise();
    for (layers, w, h) in [(1, 16_384, 16_384), (1_000_000_000, 64, 64), (usize::MAX, 4, 4)] {
        let wanted = Request {
            layers,
            ..Request::default()
        };
        let mut r = open(method, &wanted);
        r.set_data(&data).unwrap();
        match r.set_view(&View::fit(data.bounds(), 20.0, w, h)) {
            Err(RenderError::Memory { bytes, limit, .. }) => assert!(bytes > limit),
            other => panic!("{layers} {w}x{h}: {other:?}"),
        }
    }
    let long = longest + 1;
    let thin = Data::Grid(Grid::unit([long, 2, 2], Samples::U8(vec![0; long * 4].into())).unwrap());
    let mut r = open(method, &Request::default());
    assert!(matches!(
        r.set_data(&Arc::new(thin)),
        Err(RenderError::Memory { bytes, .. }) if bytes == long as u64
    ));
}

/// Isovalues outside the range, invisible surfaces, none, and views past the domain: an empty frame.
///
/// # Panics
/// Where it is not.
pub fn empty_frames(method: &dyn Method) {
    let data = small_noise();
    let view = View::fit(data.bounds(), 40.0, 9, 7);
    let mut r = open(method, &request(1, Knobs::default()));
    let outside = [Surface::isovalue(5.0, 0), Surface::isovalue(-1e300, 1)];
    let f = draw(&mut *r, &data, &outside, &view);
    assert_eq!(f, Frame::new(9, 7, 1, Channels::all()));
    let mut invisible = zero();
    invisible[0].opacity = 0.0;
    for nothing in [&invisible[..], &[]] {
        r.set_surfaces(nothing).unwrap();
        assert_eq!(redraw(&mut *r), f);
    }
    r.set_surfaces(&zero()).unwrap();
    assert_ne!(redraw(&mut *r), f);
    let from = |target: DVec3, fov| View::perspective(DVec3::splat(100.0), target, DVec3::Z, fov, 9, 7);
    for past in [from(DVec3::splat(200.0), 40.0), from(DVec3::new(0.0, 100.0, 900.0), 10.0)] {
        r.set_view(&past).unwrap();
        assert_eq!(redraw(&mut *r), f);
    }
}

/// One thing that is set anew.
#[derive(Debug, Clone)]
pub enum Change {
    /// The view.
    View(View),
    /// The isovalue.
    Isovalue(f64),
    /// The data, with an isovalue for them.
    Data(Arc<Data>, f64),
    /// The knobs.
    Knobs(Knobs),
}

/// Begins with [`small_noise`], its isovalue 0, this view and no knobs, and makes the changes one after the other: each alone gives the frame of a renderer opened for it, bit for bit.
/// `after`: is shown the number of the change, the device memory before it, and the renderer.
///
/// # Panics
/// Where it does not, or nothing is hit.
pub fn each_change(
    method: &dyn Method,
    wanted: impl Fn(Knobs) -> Request,
    view: &View,
    changes: Vec<Change>,
    mut after: impl FnMut(usize, u64, &dyn Renderer),
) {
    let (mut data, mut surfaces, mut view, mut knobs) = (small_noise(), zero(), view.clone(), Knobs::default());
    let mut r = open(method, &wanted(knobs.clone()));
    assert!(draw(&mut *r, &data, &surfaces, &view).t.iter().any(|t| t.is_finite()));
    for (n, change) in changes.into_iter().enumerate() {
        let before = r.memory().device;
        match change {
            Change::View(v) => {
                view = v;
                r.set_view(&view).unwrap();
            }
            Change::Isovalue(c) => {
                surfaces = [Surface::isovalue(c, 0)];
                r.set_surfaces(&surfaces).unwrap();
            }
            Change::Data(d, c) => {
                (data, surfaces) = (d, [Surface::isovalue(c, 0)]);
                r.set_surfaces(&surfaces).unwrap();
                r.set_data(&data).unwrap();
            }
            Change::Knobs(k) => {
                knobs = k;
                r.set_knobs(&knobs).unwrap();
            }
        }
        let got = redraw(&mut *r);
        let want = draw(&mut *open(method, &wanted(knobs.clone())), &data, &surfaces, &view);
        assert!(want.t.iter().any(|t| t.is_finite()), "change {n} hits nothing");
        assert_eq!(got, want, "change {n}");
        after(n, before, &*r);
    }
}

/// Rounded ends of the domain, planes behind the ray, directions next to parallel, eyes at the end of f64, samples next to 0, skew axes: inputs that once led to wrong claims. `hold` draws the
/// rays (name, data, isovalue, rays) and sees to it that no claim is refuted.
pub fn hostile(hold: impl Fn(&str, &Arc<Data>, f64, &[Ray])) {
    let plain = |n, sample: &dyn Fn([usize; 3]) -> f32| cube(n, DVec3::ONE, DMat3::IDENTITY, sample);
    let data = cube(11, DVec3::splat(0.3), DMat3::IDENTITY, |[x, _, _]| x as f32);
    // 3.0 is beyond the last sample, 10 * fl(0.3), by less than its index rounds by.
    hold("face", &data, 4.5, &[ray([-5.0, 1.5, 3.0], [1.0, 0.0, 0.0])]);
    let data = plain(65, &|[x, _, _]| (x as f32 - 1.75).abs());
    let slow = -(2f64.powi(-46)) / 1.5;
    let grazing = ray([0.0, 1.5, 64.0 + 2f64.powi(-46)], [1.0, 0.0, slow]);
    hold("grazing", &data, 0.5, &[grazing]);

    let data = plain(50, &|[x, y, z]| {
        if (x, y, z) == (0, 20, 25) { 0.0 } else { 6.0 + 2.0 * x as f32 }
    });
    let r = ray([-1.5, 20.3, 24.999_999_999_999_996], [1.0, 0.0, 5.370_822_105_685_78e-16]);
    hold("plane", &data, 5.0, &[r]);

    let data = plain(9, &|[x, y, z]| (x + y + z) as f32);
    let rays = [
        ray([-1.0, 3.3, 3.4], [1.0, 1e-310, 0.0]),
        ray([-1.0, 3.3, 3.4], [1.0, -1e-200, 1e-305]),
        ray([-1e120, 1e119, 3.0], [1.0, -0.1, 0.0]),
        ray([1e18, 1e18, 1e18], [-1.0, -1.0, -1.0]),
    ];
    hold("parallel", &data, 9.5, &rays);
    // Reciprocals overflow.
    let rays = [
        ray([-1000.0, 3.3, 3.4], [1e-306, 0.0, 0.0]),
        ray([1.5, 3.3, 3.4], [5e-309, 0.0, 0.0]),
        ray([1.5, 3.3, 3.4], [0.0, -5e-309, 0.0]),
    ];
    hold("short", &data, 9.5, &rays);

    let u = f32::from_bits(1);
    let data = plain(6, &|[x, _, _]| if x < 3 { 4.0 * u } else { 5.0 * u });
    let rays: Vec<Ray> = (0..20)
        .map(|i| ray([-1.0, 1.0 + 0.1 * f64::from(i), 2.3], [1.0, 0.0, 0.0]))
        .collect();
    hold("least", &data, 4.5 * f64::from(u), &rays);

    for angle in [1e-2, 1e-4, 1e-6f64] {
        let axes = DMat3::from_cols(DVec3::X, DVec3::new(angle.cos(), angle.sin(), 0.0), DVec3::Z);
        let data = cube(9, DVec3::ONE, axes, |[x, y, z]| (x + 2 * y + z) as f32);
        let rays: Vec<Ray> = (0..200)
            .map(|i| {
                let s = 4.0 * f64::from(i) / 200.0;
                ray([2.0 + 2.0 * s, s * angle, -1.0], [0.1, 0.0, 1.0])
            })
            .collect();
        hold("skew", &data, 12.25, &rays);
    }
}

/// Samples near the greatest f32: these two, of either sign, among zeros; and rays along them.
#[must_use]
pub fn great_samples([first, second]: [f32; 2]) -> (Arc<Data>, Vec<Ray>) {
    let data = cube(6, DVec3::ONE, DMat3::IDENTITY, |[x, _, z]| {
        let v = [0.0, first, 0.0, second, 0.0, 0.0][x];
        if z <= 2 { v } else { -v }
    });
    let rays = (0..40)
        .map(|i| ray([6.0, 2.3, 2.0 + 0.025 * f64::from(i)], [-1.0, 0.0, 0.0]))
        .collect();
    (data, rays)
}

/// Frames of well-known fields at the bench view: many hits, exact to 1e-9 voxels and 1e-4 degrees, all but two pixels proved.
///
/// # Panics
/// Where they are not.
pub fn bench_frames(mut checked: impl FnMut(&Arc<Data>, &[Surface], &View) -> Check) {
    for (spec, c) in [("marschner-lobb,n=40", 0.5), ("gyroid,n=48", 0.2), ("sphere,n=21", 1.0)] {
        let c = checked(&synthetic(spec), &[Surface::isovalue(c, 0)], &View::bench(160, 120));
        assert!(c.is_clean() && c.hits > 1000, "{spec}");
        assert!(c.t_error_voxels.max < 1e-9, "{spec}: {:?}", c.t_error_voxels);
        assert!(c.normal_error_deg.max < 1e-4, "{spec}: {:?}", c.normal_error_deg);
        assert!(c.unclaimed <= 2, "{spec}: {} pixels are not proved", c.unclaimed);
    }
}
