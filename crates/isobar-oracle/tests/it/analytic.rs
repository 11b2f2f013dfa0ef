//! Fields with enclosures only: C16 and the contract's fields.

use crate::support::{Random, field, list, ray};
use isobar_core::{DVec3, Ray};
use isobar_oracle::Answer;

const X: [f64; 3] = [1.0, 0.0, 0.0];

#[test]
fn c16_chmutov() {
    let o = field("chmutov");
    for (y, want) in [(0.0, 1.057_271_837_396_040_782_1), (0.9, 1.048_180_748_420_969_998_2)] {
        let all = o.all(&ray([-3.0, y, y], X));
        let got = list(&all, 3.0);
        assert_eq!(got.len(), 2, "{all:?}");
        assert!((got[0].0 + want).abs() < 1e-12 && (got[1].0 - want).abs() < 1e-12);
        assert!(all.roots.iter().all(|r| r.hi - r.lo < 3e-12));
    }
    let y = 0.448_798_950_512_827_6;
    assert!(o.all(&ray([-3.0, y, y], X)).roots.is_empty());
    assert!(matches!(o.first(&ray([-3.0, y, y], X)), Answer::Miss { .. }));
}

/// On the x axis the gyroid is sin 6x.
#[test]
fn gyroid_on_an_axis() {
    let o = field("gyroid");
    let a = 0.2f64.asin();
    let all = o.all(&ray([-2.0, 0.0, 0.0], X));
    let pi = std::f64::consts::PI;
    let mut want: Vec<f64> = (-3..=3)
        .flat_map(|k| [a + 2.0 * pi * f64::from(k), pi - a + 2.0 * pi * f64::from(k)])
        .map(|x| x / 6.0)
        .filter(|x| x.abs() <= 1.0)
        .collect();
    want.sort_by(f64::total_cmp);
    let got = list(&all, 2.0);
    assert_eq!(got.len(), want.len());
    for (g, w) in got.iter().zip(&want) {
        assert!((g.0 - w).abs() < 1e-12, "{got:?} {want:?}");
    }
}

/// B18: heights of the Marschner-Lobb surface.
#[test]
fn marschner_lobb_heights() {
    let o = field("marschner-lobb");
    for (x, z) in [
        (0.0, 0.160_861_246_510_332_49),
        (0.25, -0.154_828_981_921_294_91),
        (0.5, 0.007_356_854_374_883_621_6),
    ] {
        let all = o.all(&ray([x, 0.0, -2.0], [0.0, 0.0, 1.0]));
        assert!(all.roots.iter().any(|r| (r.t() - 2.0 - z).abs() < 1e-12), "{x}: {all:?}");
    }
}

/// Tangents are not guessed: the answer says what it does not know, and nothing before it is lost.
#[test]
fn tangents_are_unresolved() {
    let o = field("gyroid").with_isovalue(1.0);
    // sin 6x = 1 at x = pi/12 and so on
    match o.first(&ray([-2.0, 0.0, 0.0], X)) {
        Answer::Unresolved { lo, hi } => {
            let at = 2.0 + std::f64::consts::PI / 12.0 - std::f64::consts::PI / 3.0;
            assert!(lo <= at && at <= hi && hi - lo < 1e-6, "{lo} {hi}");
        }
        other => panic!("{other:?}"),
    }
    assert!(o.undecidable(&ray([-2.0, 0.0, 0.0], X)));
    assert!(matches!(
        field("gyroid").with_isovalue(1.001).first(&ray([-2.0, 0.0, 0.0], X)),
        Answer::Miss { .. }
    ));
}

/// Roots are where a dense sampling sees them, with the sign of the slope, and brackets hold to 1e-12.
#[test]
fn random_rays_agree_with_sampling() {
    let mut random = Random(8);
    for name in ["gyroid", "marschner-lobb", "chmutov"] {
        let o = field(name);
        let mut unresolved = 0;
        for _ in 0..40 {
            let target = random.vector(-0.8, 0.8);
            let origin = random.vector(-3.0, 3.0) + DVec3::new(4.0, 0.0, 0.0);
            let r = Ray {
                origin,
                direction: (target - origin).normalize(),
            };
            let all = o.all(&r);
            unresolved += all.unresolved.len();
            let (t0, t1) = o.function().domain().clip(&r).unwrap();
            let g = |t: f64| o.function().value(r.at(t)) - o.isovalue();
            const N: usize = 4000;
            let at = |i: usize| t0 + (t1 - t0) * i as f64 / N as f64;
            let changes: Vec<f64> = (0..N).filter(|&i| g(at(i)) * g(at(i + 1)) < 0.0).map(at).collect();
            // Sampling may miss pairs; the oracle may not miss what sampling sees.
            assert!(
                all.roots.len() >= changes.len(),
                "{name}: {} of {}",
                all.roots.len(),
                changes.len()
            );
            let step = (t1 - t0) / N as f64;
            for c in &changes {
                assert!(
                    all.roots.iter().any(|x| x.t() >= c - 1e-9 && x.t() <= c + step + 1e-9),
                    "{name} {c}"
                );
            }
            for x in &all.roots {
                assert!(x.hi - x.lo <= 1e-12 * x.hi.max(1.0) / x.slope.abs().min(1.0), "{x:?}");
                assert!(g(x.lo - 1e-9) * x.slope < 0.0 || x.slope.abs() < 1e-3);
            }
        }
        assert_eq!(unresolved, 0, "{name}");
    }
}
