//! The analytic fields beside the numbers of the hard cases, and the text that names them.

mod common;

use common::{Random, bisect};
use isobar_core::{DVec3, Data, DataError, Structure};
use isobar_fields::{Field, Synthetic, analytic};
use std::collections::BTreeMap;

fn field(name: &str) -> Field {
    analytic(name, &BTreeMap::new()).unwrap()
}

fn v(x: f64, y: f64, z: f64) -> DVec3 {
    DVec3::new(x, y, z)
}

/// Roots of s = isovalue on the line, by sign changes of 1000 steps and bisection.
fn roots(name: &str, at: impl Fn(f64) -> DVec3 + Copy, lo: f64, hi: f64) -> Vec<f64> {
    let f = field(name);
    let step = (hi - lo) / 999.7;
    (0..1000)
        .map(|n| (lo + step * f64::from(n), (lo + step * f64::from(n + 1)).min(hi)))
        .filter(|&(a, b)| (f.function.value(at(a)) < f.isovalue) != (f.function.value(at(b)) < f.isovalue))
        .map(|(a, b)| bisect(&*f.function, f.isovalue, at, a, b))
        .collect()
}

fn check_roots(name: &str, at: impl Fn(f64) -> DVec3 + Copy, lo: f64, hi: f64, want: &[f64], tol: f64) {
    let got = roots(name, at, lo, hi);
    assert_eq!(got.len(), want.len(), "{name}: {got:?}");
    for (g, w) in got.iter().zip(want) {
        assert!((g - w).abs() <= tol, "{name}: {g} instead of {w}");
    }
}

#[test]
fn b18_marschner_lobb() {
    for (x, want) in [
        (0.0, 0.160_861_246_510_332_49),
        (0.25, -0.154_828_981_921_295_14),
        (0.5, 0.007_356_854_374_883_622),
    ] {
        check_roots("marschner-lobb", |z| v(x, 0.0, z), -0.9, 0.9, &[want], 2e-15);
        check_roots("marschner-lobb", |z| v(0.6 * x, -0.8 * x, z), -0.9, 0.9, &[want], 4e-15);
    }
    // fm = 0: cos 0 = 1 everywhere, so the surface is the plane z = (2/pi) asin(alpha).
    let params = BTreeMap::from([("fm".to_string(), 0.0), ("alpha".to_string(), 0.5), ("L".to_string(), 2.0)]);
    let f = analytic("marschner-lobb", &params).unwrap().function;
    assert_eq!(f.domain().hi, DVec3::splat(2.0));
    assert!((f.value(v(0.7, 0.1, 1.0 / 3.0)) - 0.5).abs() < 1e-15);
}

/// Straight from the formulas, without the shared code.
#[test]
fn transcendental_fields_are_their_formulas() {
    let mut r = Random(2);
    for _ in 0..500 {
        let p = r.point(DVec3::NEG_ONE, DVec3::ONE);
        let (x, y, z) = (p.x, p.y, p.z);
        let wave = (std::f64::consts::TAU * 6.0 * (std::f64::consts::FRAC_PI_2 * x.hypot(y)).cos()).cos();
        let ml = (1.0 - (std::f64::consts::FRAC_PI_2 * z).sin() + 0.25 * (1.0 + wave)) / 2.5;
        assert!((field("marschner-lobb").function.value(p) - ml).abs() < 1e-14);
        let g = |a: f64, b: f64| (6.0 * a).sin() * (6.0 * b).cos();
        let gyroid = g(x, y) + g(y, z) + g(z, x);
        assert!((field("gyroid").function.value(p) - gyroid).abs() < 1e-14);
        assert!(gyroid.abs() <= 1.5 + 1e-14);
        let c = |t: f64| t.powi(16) - (7.0 * t).cos();
        assert!((field("chmutov").function.value(p) - c(x) - c(y) - c(z)).abs() < 1e-13);
    }
}

/// Gradients beside central differences, all fields.
#[test]
fn gradients() {
    let mut r = Random(8);
    for name in Synthetic::NAMES {
        let f = field(name).function;
        let inner = f.domain().hi * 0.9;
        let scale = f.gradient(inner).length().max(1.0) * 50.0;
        for n in 0..100 {
            let p = if n == 0 { DVec3::ZERO } else { r.point(-inner, inner) };
            let h = 1e-5;
            let d = |e: DVec3| (f.value(p + e * h) - f.value(p - e * h)) / (2.0 * h);
            let g = f.gradient(p);
            let want = v(d(DVec3::X), d(DVec3::Y), d(DVec3::Z));
            assert!((g - want).length() < 1e-7 * scale, "{name} at {p}: {g} beside {want}");
        }
        // Outside: the nearest point's.
        let (out, face) = (v(99.0, 0.1, -99.0), v(f.domain().hi.x, 0.1, f.domain().lo.z));
        assert_eq!((f.value(out), f.gradient(out)), (f.value(face), f.gradient(face)));
        assert_eq!(f.name(), *name);
    }
}

#[test]
fn section_c_on_simple_lines() {
    check_roots("sphere", |t| v(t, 0.6, 0.0), -1.2, 1.2, &[-0.8, 0.8], 1e-15);
    check_roots("torus", |t| v(t, 0.0, 0.0), -1.5, 1.5, &[-1.25, -0.75, 0.75, 1.25], 1e-15);
    check_roots(
        "teardrop",
        |t| v(-0.8, 0.0, t),
        -1.2,
        1.2,
        &[-0.202_385_770_250_776_28, 0.202_385_770_250_776_28],
        1e-15,
    );
    let b = [-0.545_499_028_854_807_2, -0.469_498_111_533_437_4, 0.249_972_888_949_539_1];
    check_roots("steinberger-a", DVec3::splat, -2.0, 2.0, &[0.322_185_354_626_085_6], 1e-15);
    check_roots("steinberger-b", DVec3::splat, -2.0, 2.0, &b, 1e-15);
    let c = [-0.531_254_150_515_238_4, 0.661_915_795_254_215_4, 1.0];
    check_roots("steinberger-c", DVec3::splat, -2.0, 2.0, &c, 1e-15);
    check_roots(
        "steiner",
        |t| v(t, 0.1, 0.1),
        -2.0,
        2.0,
        &[0.010_208_423_834_364_02, 0.489_791_576_165_635_98],
        1e-15,
    );
    check_roots("whitney", |t| v(t, 1e-3, 0.25), -0.01, 0.01, &[-5e-4, 5e-4], 1e-18);
    check_roots("whitney", |t| v(t, 1e-3, -1.0), -2.0, 2.0, &[], 0.0);
    let s = 9.949_874_371_066_2e-5;
    check_roots("kiss", |t| v(t, 0.0, 0.01), -0.01, 0.01, &[-s, s], 1e-18);
    let t = 2.261_077_198_045_795_7;
    check_roots("tangle", |x| v(x, 1.5, 1.5), -3.0, 3.0, &[-t, t], 2e-15);
    check_roots("tangle", |x| v(x, 0.0, 0.0), -3.0, 3.0, &[], 0.0);
    let (a, b) = (1.042_010_766_559_974_2, 1.978_437_151_484_245_4);
    for axis in [DVec3::X, DVec3::Y] {
        check_roots("mitchell", |t| axis * t, -2.5, 2.5, &[-b, -a, a, b], 2e-15);
    }
    check_roots("mitchell", |t| v(t, t, 0.0), -2.5, 2.5, &[], 0.0);
    check_roots(
        "chmutov",
        |t| v(t, 0.0, 0.0),
        -1.25,
        1.25,
        &[-1.057_271_837_396_040_8, 1.057_271_837_396_040_8],
        1e-15,
    );
    check_roots(
        "chmutov",
        |t| v(t, 0.9, 0.9),
        -1.25,
        1.25,
        &[-1.048_180_748_420_97, 1.048_180_748_420_97],
        1e-15,
    );
    check_roots(
        "chmutov",
        |t| v(t, 0.448_798_950_512_827_6, 0.448_798_950_512_827_6),
        -1.25,
        1.25,
        &[],
        0.0,
    );
}

/// C9: f vanishes along three of the Clebsch cubic's lines.
#[test]
fn clebsch_lines() {
    let f = field("clebsch").function;
    for n in -40..=40 {
        let t = f64::from(n) / 32.0;
        for p in [v(t, -t, -1.0 / 3.0), v(t, 1.0 / 3.0 - t, 0.0), v(t, 2.0 / 3.0 - t, 1.0 / 3.0)] {
            assert!(f.value(p).abs() < 1e-11, "{p}: {}", f.value(p));
        }
    }
}

/// All local minima of |grad f|^2 + f^2 that reach zero, by Newton on the gradient from a lattice of starts.
fn nodes(name: &str, starts: i32, half: f64) -> Vec<DVec3> {
    let f = field(name).function;
    let scale = f.gradient(DVec3::splat(0.9 * half)).length();
    let mut found: Vec<DVec3> = Vec::new();
    for n in 0..(2 * starts + 1).pow(3) {
        let m = 2 * starts + 1;
        let mut p = v(f64::from(n % m), f64::from(n / m % m), f64::from(n / m / m)) - DVec3::splat(f64::from(starts));
        // Off the symmetry planes, where the Hessian is singular.
        p = p * (half / f64::from(starts)) + v(1.3e-3, -2.1e-3, 0.7e-3);
        for _ in 0..40 {
            let g = f.gradient(p);
            let h = 1e-6;
            let column = |e: DVec3| (f.gradient(p + e * h) - f.gradient(p - e * h)) / (2.0 * h);
            let hessian = isobar_core::DMat3::from_cols(column(DVec3::X), column(DVec3::Y), column(DVec3::Z));
            let step = hessian.inverse() * g;
            if !step.is_finite() {
                break;
            }
            p -= step * (0.3 / step.length()).min(1.0);
        }
        let zero = f.gradient(p).length() < 1e-9 * scale && f.value(p).abs() < 1e-9 * scale;
        if zero && p.abs().max_element() < half && found.iter().all(|q| q.distance(p) > 1e-4) {
            found.push(p);
        }
    }
    found
}

#[test]
fn node_counts() {
    let cayley = nodes("cayley", 4, 1.9);
    assert_eq!(cayley.len(), 4);
    for p in &cayley {
        assert!((p.abs() - 0.5).length() < 1e-9 && p.x * p.y * p.z < 0.0, "{p}");
    }
    assert_eq!(nodes("banchoff-chmutov", 5, 1.24).len(), 12);
    let barth = nodes("barth-sextic", 8, 1.95);
    let near = |r: f64| barth.iter().filter(|p| (p.length() - r).abs() < 1e-7).count();
    assert_eq!((barth.len(), near(1.0), near(3f64.sqrt())), (50, 30, 20));
    assert_eq!(nodes("kummer", 8, 1.99).len(), 16);
}

#[test]
fn polynomials_have_the_degrees_and_terms_expected() {
    let of = |name: &str| match field(name).function.structure() {
        Structure::Polynomial(p) => (p.degree(), p.terms.len()),
        _ => panic!("{name} is no polynomial"),
    };
    // (1 + x + y + z)-like counts done by hand for the short ones
    assert_eq!(of("sphere"), (2, 3));
    assert_eq!(of("teardrop"), (5, 4));
    assert_eq!(of("tangle"), (4, 7));
    assert_eq!(of("steinberger-a"), (3, 5));
    assert_eq!(of("steinberger-c"), (9, 6));
    assert_eq!(of("clebsch"), (3, 20));
    assert_eq!(of("kiss"), (5, 4));
    let tangle = field("tangle").function;
    let Structure::Polynomial(p) = tangle.structure() else {
        panic!("tangle is a polynomial")
    };
    assert!(p.terms.contains(&([0, 0, 0], 11.8)));
}

#[test]
fn grids_are_sampled_as_promised() {
    let source: Synthetic = "torus,n=9,L=2".parse().unwrap();
    let Data::Grid(g) = source.data().unwrap() else {
        panic!("a grid is expected")
    };
    assert_eq!((g.dims, g.spacing, g.origin), ([9; 3], DVec3::splat(0.5), DVec3::splat(-2.0)));
    for ijk in [[0, 0, 0], [8, 8, 8], [3, 5, 1], [8, 0, 4]] {
        let x = g.domain().world(DVec3::from_array(ijk.map(|i| i as f64)));
        assert_eq!(g.sample(ijk), f64::from(source.field().function.value(x) as f32));
    }
    let Data::Grid(g) = "gyroid".parse::<Synthetic>().unwrap().data().unwrap() else {
        panic!("a grid is expected")
    };
    assert_eq!((g.dims, g.spacing.x), ([64; 3], 2.0 / 63.0));
    let Data::Tets(m) = "sphere,n=5,as=tets".parse::<Synthetic>().unwrap().data().unwrap() else {
        panic!("tetrahedra are expected")
    };
    assert_eq!((m.points.len(), m.cells.len()), (125, 320));
    let Data::Hexes(h) = "gyroid,n=5,as=hexes".parse::<Synthetic>().unwrap().data().unwrap() else {
        panic!("elements are expected")
    };
    assert_eq!(h.elements.len(), 64);
    let Data::Algebraic(a) = "kummer,as=algebraic".parse::<Synthetic>().unwrap().data().unwrap() else {
        panic!("a polynomial is expected")
    };
    assert_eq!((a.degree(), a.name.as_str(), a.hi), (4, "kummer", DVec3::splat(2.0)));
}

#[test]
fn all_names_parse_and_no_other() {
    for name in Synthetic::NAMES {
        let s: Synthetic = format!("{name},n=4").parse().unwrap();
        assert_eq!(s.name(), *name);
        let Data::Grid(g) = s.data().unwrap() else {
            panic!("a grid is expected")
        };
        assert_eq!(g.samples.len(), 64);
    }
    let refused = [
        ("", "marschner-lobb, gyroid"),
        ("donut", "torus"),
        ("torus,n=1", "2 to 1024"),
        ("torus,n=1025", "2 to 1024"),
        ("torus,n=99999999999999999999999", "2 to 1024"),
        ("torus,n=-3", "2 to 1024"),
        ("torus,n=300,as=tets", "2 to 256"),
        ("torus,n=129,as=hexes", "2 to 128"),
        ("torus,as=mesh", "grid, algebraic, tets or hexes"),
        ("torus,n", "key=value"),
        ("torus,n=3,n=4", "twice"),
        ("torus,fm=3", "it has L"),
        ("marschner-lobb,beta=3", "L, fm, alpha"),
        ("marschner-lobb,alpha=-1", "0 to 1000"),
        ("marschner-lobb,fm=nan", "finite"),
        ("sphere,L=0", "1e-6 to 1e6"),
        ("gyroid,as=algebraic", "no polynomial"),
    ];
    for (text, part) in refused {
        let Err(DataError::Unknown(e)) = text.parse::<Synthetic>() else {
            panic!("{text} was not refused")
        };
        assert!(e.contains(part) && e.lines().count() == 1, "{text}: {e}");
    }
    let e = "chmutov,L=1000,n=4"
        .parse::<Synthetic>()
        .unwrap()
        .data()
        .unwrap_err()
        .to_string();
    assert!(e.contains("smaller L"), "{e}");
}
