//! Comparators against what they have to agree with: the polynomial itself, integers, and the B-spline of isobar-fields.

use super::algebraic::{Composition, Drawn, Extent, Surface, draw};
use super::frustum::{Frustum, FrustumForm, weights};
use super::texture::{Angles, FRACTION_BITS, March, Texture};
use crate::compose::{Counted, Operations, Scalar, count};
use crate::finders::Finder;
use glam::DVec3;
use isobar_core::{Algebraic, Camera, Data, Function, Grid, Ray, Samples, Stage, View};
use isobar_fields::{GridSpline, Kind, Synthetic};
use isobar_poly::{Real, scaled};

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
}

/// The surfaces of Figure 6.1.
fn surface(letter: char) -> Algebraic {
    let s: Synthetic = format!("steinberger-{letter},as=algebraic").parse().unwrap();
    let Data::Algebraic(a) = s.data().unwrap() else {
        unreachable!("asked for")
    };
    a
}

fn view(width: usize, height: usize) -> View {
    View::perspective(DVec3::new(6.0, 4.0, 5.0), DVec3::ZERO, DVec3::Z, 40.0, width, height)
}

fn parallel(width: usize, height: usize) -> View {
    View {
        camera: Camera::Orthographic {
            eye: DVec3::new(6.0, 4.0, 5.0),
            target: DVec3::new(0.1, 0.0, 0.2),
            up: DVec3::Z,
            height: 5.0,
        },
        ..view(width, height)
    }
}

/// The frustum's rays are the view's, for both cameras.
#[test]
fn pixels_of_a_frustum_are_those_of_the_view() {
    for view in [view(40, 30), parallel(40, 30)] {
        let frustum = Frustum::around(&view, DVec3::splat(-2.0), DVec3::splat(2.0)).unwrap();
        for (x, y) in [(0, 0), (39, 0), (7, 29), (20, 15)] {
            let ray = view.ray(x, y);
            let (u, v) = ((x as f64 + 0.5) / 40.0, (y as f64 + 0.5) / 30.0);
            for p in frustum.ends(u, v) {
                let t = (p - ray.origin).dot(ray.direction);
                assert!(t > 0.0 && (ray.at(t) - p).length() < 1e-12, "pixel ({x}, {y}): {p}");
            }
        }
        // The sphere round the box touches the planes.
        let [near, far] = frustum.ends(0.5, 0.5);
        assert!(((far - near).length() - 4.0 * 3f64.sqrt()).abs() < 0.3);
    }
    let inside = View::perspective(DVec3::X, DVec3::ZERO, DVec3::Z, 40.0, 4, 4);
    assert_eq!(Frustum::around(&inside, DVec3::splat(-2.0), DVec3::splat(2.0)), None);
    assert_eq!(Frustum::new(&inside, 1.0, 1.0), None);
    let list = View::rays(vec![Ray {
        origin: DVec3::ZERO,
        direction: DVec3::X,
    }]);
    assert_eq!(Frustum::new(&list, 1.0, 2.0), None);
}

/// On integers the form is exact: coefficients of (u + 2v + 3t + 1)(u - v + t) in degree 2, written down by hand.
#[test]
fn frustum_forms_are_exact_on_integers() {
    // Scaled Bernstein form of u^a v^b t^c in degree 2: per axis 1 = (1, 2, 1), x = (0, 1, 1), x^2 = (0, 0, 1).
    let powers = [[1i128, 2, 1], [0, 1, 1], [0, 0, 1]];
    let terms = [
        // u^2 + uv - 2v^2 + 4ut - vt + 3t^2 + u - v + t
        ([2, 0, 0], 1),
        ([1, 1, 0], 1),
        ([0, 2, 0], -2),
        ([1, 0, 1], 4),
        ([0, 1, 1], -1),
        ([0, 0, 2], 3),
        ([1, 0, 0], 1),
        ([0, 1, 0], -1),
        ([0, 0, 1], 1),
    ];
    let mut c = vec![0; 27];
    for (e, k) in terms {
        for (at, c) in c.iter_mut().enumerate() {
            let [u, v, t]: [usize; 3] = e;
            *c += k * powers[v][at / 9] * powers[u][at / 3 % 3] * powers[t][at % 3];
        }
    }
    let form = FrustumForm::<i128, 3>::from_coefficients(c).unwrap();
    for u in -3..4i128 {
        for v in -3..4 {
            let p = form.ray(&weights(u), &weights(v));
            for t in -3..4 {
                let s = 1 - t;
                let got = p[0] * s * s + p[1] * s * t + p[2] * t * t;
                assert_eq!(got, (u + 2 * v + 3 * t + 1) * (u - v + t), "at {u}, {v}, {t}");
            }
        }
    }
    assert_eq!(FrustumForm::<i128, 3>::from_coefficients(vec![0; 26]), None);
}

/// The multiplications the docs speak of, counted.
#[test]
fn operations_of_a_ray_are_as_documented() {
    fn counted<const M: usize>() -> [Operations; 2] {
        let one = Counted(1.0f32);
        let form = FrustumForm::<_, M>::from_coefficients(vec![one; M * M * M]).unwrap();
        let w = [one; M];
        let row = form.row(&w);
        [
            count(|| drop(form.ray(&w, &w).to_vec())),
            count(|| drop(row.ray(&w).to_vec())),
        ]
    }
    for (n, [alone, shared]) in [(4, counted::<4>()), (7, counted::<7>()), (10, counted::<10>())] {
        assert_eq!(alone.multiplications, n * n * (n + 1));
        assert_eq!(shared.multiplications, n * n);
        assert_eq!(shared.additions, n * (n - 1));
    }
}

/// All ways to the polynomial of a ray: its values are the surface's own, evaluated from its terms.
fn ways_agree<const D: usize, const M: usize>(letter: char) {
    let polynomial = surface(letter);
    let exact = Surface::<f64, D>::new(&polynomial).unwrap();
    let mut random = Random(61);
    for view in [view(64, 48), parallel(64, 48)] {
        let frustum = Frustum::around(&view, polynomial.lo, polynomial.hi).unwrap();
        let form = FrustumForm::<f64, M>::new(|p| polynomial.value(p), &frustum);
        let local = |p: DVec3| (p * 0.5).to_array();
        for _ in 0..50 {
            let (u, v) = (random.unit(), random.unit());
            let mut along = form.ray(&weights(u), &weights(v));
            scaled::to_bernstein(&mut along);
            let [near, far] = frustum.ends(u, v);
            let mut all = vec![("frustum form", along)];
            for how in [Composition::Pf, Composition::Sb1, Composition::Axis] {
                all.push((how.name(), exact.composed(how, local(near), local(far)).unwrap()));
            }
            let size = along.iter().fold(0.0f64, |m, x| m.max(x.abs()));
            for (name, b) in all {
                for _ in 0..4 {
                    let t = random.unit();
                    let (got, want) = (isobar_poly::bernstein::eval(&b, t), polynomial.value(frustum.at(u, v, t)));
                    let bar = 1e-11 * size;
                    assert!(
                        (got - want).abs() < bar,
                        "{letter}, {name}: {got} not {want} at {u}, {v}, {t}"
                    );
                }
            }
        }
    }
    assert_eq!(exact.composed::<M>(Composition::Axis, [0.5; 3], [0.5; 3]), None);
}

#[test]
fn all_ways_give_the_polynomial_of_the_ray() {
    ways_agree::<1, 4>('a');
    ways_agree::<2, 7>('b');
    ways_agree::<3, 10>('c');
    assert!(
        Surface::<f64, 2>::new(&surface('c')).is_err(),
        "x^3 is no tri-quadratic polynomial"
    );
}

/// A box that is not centred on 0 and not a cube.
#[test]
fn coefficients_are_about_the_middle_of_any_box() {
    let terms: Vec<([u8; 3], f64)> = vec![([3, 1, 0], 1.5), ([0, 2, 3], -2.0), ([1, 0, 0], 0.25), ([0, 0, 0], -0.75)];
    let (lo, hi) = (DVec3::new(-1.0, 0.5, 2.0), DVec3::new(0.0, 2.5, 5.0));
    let p = Algebraic::new("test", terms, lo, hi).unwrap();
    let s = Surface::<f64, 3>::new(&p).unwrap();
    let (a, b) = ([-0.9, 0.3, 0.8], [0.7, -0.2, -1.0]);
    let world = |l: [f64; 3]| (lo + hi) * 0.5 + DVec3::from_array(l) * (hi - lo) * 0.5;
    for how in [Composition::Pf, Composition::Sb1, Composition::Axis] {
        let c = s.composed::<10>(how, a, b).unwrap();
        for t in [0.0, 0.25, 0.6, 1.0] {
            let want = p.value(world(a) * (1.0 - t) + world(b) * t);
            let got = isobar_poly::bernstein::eval(&c, t);
            assert!(
                (got - want).abs() < 1e-11 * (1.0 + want.abs()),
                "{}: {got}, {want}",
                how.name()
            );
        }
    }
}

fn drawn<T: Scalar + Real, const D: usize, const M: usize>(letter: char, how: Composition, extent: Extent, view: &View) -> Drawn {
    let s = Surface::<T, D>::new(&surface(letter)).unwrap();
    let finder = Finder::Lr81 {
        iterations: 6 * (D as u32 + 1),
    };
    draw::<T, D, M>(&s, view, how, &finder, extent).unwrap()
}

/// Points drawn lie on the surface and on their ray; all ways hit the same pixels but a few at silhouettes.
fn frames_agree<const D: usize, const M: usize>(letter: char) {
    let view = view(48, 36);
    let polynomial = surface(letter);
    for extent in [Extent::Planes, Extent::Box] {
        let frames: Vec<Drawn> = Composition::ALL
            .map(|how| drawn::<f64, D, M>(letter, how, extent, &view))
            .into();
        let hits = |f: &Drawn| f.points.iter().filter(|p| p.is_finite()).count();
        assert!(hits(&frames[0]) > 100, "{letter}: the surface is in view");
        for (how, f) in Composition::ALL.into_iter().zip(&frames) {
            let name = how.name();
            for (i, p) in f.points.iter().enumerate().filter(|(_, p)| p.is_finite()) {
                let ray = view.ray(i % 48, i / 48);
                let t = (*p - ray.origin).dot(ray.direction);
                assert!((ray.at(t) - *p).length() < 1e-9, "{name}: off the ray");
                assert!(
                    polynomial.value(*p).abs() < 1e-3,
                    "{letter}, {name}: {} at {p}",
                    polynomial.value(*p)
                );
                assert!(extent == Extent::Planes || p.abs().max_element() < 2.0 + 1e-9);
                assert!(f.colours[i][0] < 1.0);
            }
            let other = (f.points.iter().zip(&frames[0].points))
                .filter(|(a, b)| a.is_finite() != b.is_finite())
                .count();
            assert!(other <= 8, "{letter}, {name}: {other} pixels differ");
            let pre = f.preprocessing.is_zero();
            assert_eq!(pre, !matches!(how, Composition::Frustum | Composition::FrustumRows));
            assert!(f.total() >= f.preprocessing + f.stages[3] && f.composed > 0 && f.composed <= view.pixels());
        }
    }
}

#[test]
fn frames_of_all_ways_show_the_same_surface() {
    frames_agree::<1, 4>('a');
    frames_agree::<2, 7>('b');
    frames_agree::<3, 10>('c');
    // In the thesis's f32 too, but for the silhouettes.
    let (narrow, wide) = (
        drawn::<f32, 3, 10>('c', Composition::Sb1, Extent::Box, &view(48, 36)),
        drawn::<f64, 3, 10>('c', Composition::Sb1, Extent::Box, &view(48, 36)),
    );
    let far = (narrow.points.iter().zip(&wide.points))
        .filter(|(a, b)| a.is_finite() != b.is_finite() || (**a - **b).length() > 1e-2)
        .count();
    assert!(far <= 17, "{far} of 1728 pixels");
}

#[test]
fn an_eye_inside_the_sphere_is_refused() {
    let s = Surface::<f32, 1>::new(&surface('a')).unwrap();
    let inside = View::perspective(DVec3::X, DVec3::ZERO, DVec3::Z, 40.0, 4, 4);
    let e = draw::<f32, 1, 4>(&s, &inside, Composition::Frustum, &Finder::THESIS[0], Extent::Planes).unwrap_err();
    assert!(e.to_string().contains("--eye"), "{e}");
}

/// A volume of random samples with a spacing and an origin of its own.
fn volume(n: usize) -> Grid {
    let mut random = Random(66);
    let samples: Vec<f32> = (0..n * n * n).map(|_| random.unit() as f32).collect();
    let mut grid = Grid::unit([n; 3], Samples::F32(samples.into())).unwrap();
    grid.origin = DVec3::new(-1.0, 2.0, 0.5);
    grid.spacing = DVec3::new(0.5, 0.25, 1.0);
    grid
}

/// With fractions as they are, the eight fetches are the cubic B-spline, value and gradient, up to f32, at the borders too.
#[test]
fn eight_fetches_are_the_b_spline() {
    let grid = volume(7);
    let spline = GridSpline::new(&grid, Kind::Cubic, Stage::Stored).unwrap();
    let texture = Texture::new(&grid, None).unwrap();
    let domain = grid.domain();
    let mut random = Random(20);
    for n in 0..2000 {
        let p = [(); 3].map(|()| {
            let x = random.unit() * 6.0;
            // Some on cell faces, where floor changes.
            if n % 5 == 0 { x.round() as f32 } else { x as f32 }
        });
        let world = domain.origin + domain.axes * DVec3::from_array(p.map(f64::from));
        let (got, want) = (f64::from(texture.value(p)), spline.value(world));
        assert!((got - want).abs() < 2e-6, "{got}, {want} at {p:?}");
        let (got, want) = (texture.normal(world), spline.gradient(world));
        // The rounding of f32 over the gradient's size.
        let angle = Angles::between([(got, want.normalize())]).max;
        assert!(angle < 1e-3 / want.length(), "{angle} degrees at {p:?}, gradient {want}");
    }
}

/// On f = x a fetch gives its own place, so with rounded fractions the place rounded; the spline is off by at most half a step, and by no less somewhere.
#[test]
fn fractions_are_rounded_to_the_bits_asked_for() {
    let samples: Vec<f32> = (0..8 * 8 * 8).map(|i| (i % 8) as f32).collect();
    let ramp = Grid::unit([8; 3], Samples::F32(samples.into())).unwrap();
    for bits in [FRACTION_BITS, 9, 4] {
        let texture = Texture::new(&ramp, Some(bits)).unwrap();
        let steps = f64::from(1u32 << bits);
        let mut worst = 0.0f64;
        for n in 0..997u32 {
            let x = 2.0 + 3.0 * n as f32 / 997.0;
            let fetched = f64::from(texture.fetch([x, 3.3, 3.7]));
            assert!(
                (fetched - (f64::from(x) * steps).round() / steps).abs() < 1e-6,
                "{x}, {bits} bits"
            );
            worst = worst.max((f64::from(texture.value([x, 3.3, 3.7])) - f64::from(x)).abs());
        }
        let half = 0.5 / steps;
        assert!(worst < half + 2e-6 && worst > 0.5 * half, "{bits} bits: off by {worst}");
    }
    assert!(Texture::new(&ramp, Some(21)).is_err());
    let thin = Grid::unit([8, 1, 2], Samples::U8(vec![0; 16].into())).unwrap();
    assert!(Texture::new(&thin, None).is_err());
}

/// Normals get worse with fewer bits, as in Figure 6.6; the surface is found within the last halving.
#[test]
fn few_bits_bend_the_normals() {
    let n = 12;
    let distance = |i: usize| {
        let p = [i % n, i / n % n, i / n / n].map(|x| x as f64 - 5.6);
        (p[0] * p[0] + p[1] * p[1] + p[2] * p[2]).sqrt() as f32
    };
    let samples: Vec<f32> = (0..n * n * n).map(distance).collect();
    let grid = Grid::unit([n; 3], Samples::F32(samples.into())).unwrap();
    let spline = GridSpline::new(&grid, Kind::Cubic, Stage::Stored).unwrap();
    let march = March {
        step: 0.5,
        fine: 0.125,
        near: 0.5,
        halvings: 16,
    };
    let mut random = Random(5);
    let rays: Vec<Ray> = (0..300)
        .map(|_| Ray {
            origin: DVec3::new(-3.0, 5.0, 5.0),
            direction: DVec3::new(1.0, random.unit() - 0.5, random.unit() - 0.5).normalize(),
        })
        .collect();
    let errors = |bits: Option<u32>| {
        let texture = Texture::new(&grid, bits).unwrap();
        Angles::between(rays.iter().filter_map(|ray| {
            let f = texture.first(ray, 4.0, &march)?;
            assert!(f.samples > 10);
            let at = ray.at(f.t);
            let off = (spline.value(at) - 4.0).abs();
            assert!(
                off < bits.map_or(1e-4, |b| 2.0 / f64::from(1u32 << b)),
                "{bits:?} bits: {off}"
            );
            Some((f.normal, spline.gradient(at).normalize()))
        }))
    };
    let (exact, nine, eight) = (errors(None), errors(Some(9)), errors(Some(8)));
    assert!(exact.count > 200 && exact.max < 1e-3, "{exact:?}");
    assert!(
        nine.p50 > 10.0 * exact.p50 && eight.p50 > 1.3 * nine.p50,
        "{exact:?} {nine:?} {eight:?}"
    );
    // A ray beside the volume, one that meets nothing, and a step that is none.
    let texture = Texture::new(&grid, None).unwrap();
    let up = Ray {
        origin: DVec3::new(-3.0, 5.0, 5.0),
        direction: DVec3::Z,
    };
    assert_eq!(texture.first(&up, 4.0, &march), None);
    assert_eq!(texture.first(&rays[0], 400.0, &march), None);
    assert_eq!(texture.first(&rays[0], 4.0, &March { step: 0.0, ..march }), None);
}

#[test]
fn angles_are_those_of_the_sorted_list() {
    let turned = |d: f64| DVec3::new(d.to_radians().cos(), d.to_radians().sin(), 0.0);
    let a = Angles::between((1..=200).map(|d| (DVec3::X, turned(f64::from(d) * 0.5))));
    assert_eq!(a.count, 200);
    for (got, want) in [(a.p50, 50.0), (a.p99, 99.0), (a.max, 100.0)] {
        assert!((got - want).abs() < 1e-9, "{got} not {want}");
    }
    assert_eq!(Angles::between([(DVec3::X, DVec3::ZERO)]).count, 0);
}
