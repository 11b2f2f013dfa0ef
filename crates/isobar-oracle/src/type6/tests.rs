//! The bound of the composition and the cutting, against integers.

use super::compose::{compose, cut, multinomial, signatures};
use super::exact::{parts, piece};
use crate::{
    exact::{ExactRay, Ratio, Span},
    map::{LocalMap, Mapped},
    real::{Dd, Real},
    walk::Visit,
};
use isobar_core::{DMat3, DVec3, Domain, Ray, TetMasks};
use isobar_fields::type6::TYPE6;

fn random(seed: &mut u64) -> f64 {
    *seed = seed
        .wrapping_mul(6_364_136_223_846_793_005)
        .wrapping_add(1_442_695_040_888_963_407);
    (*seed >> 11) as f64 / (1u64 << 53) as f64
}

fn domain(n: f64) -> Domain {
    Domain {
        origin: DVec3::new(0.25, -1.0, 0.5),
        axes: DMat3::from_diagonal(DVec3::new(0.7, 0.31, 1.3)),
        lo: DVec3::ZERO,
        hi: DVec3::splat(n - 1.0),
    }
}

#[test]
fn kinds_have_signatures_of_their_own() {
    let mut all = signatures(&TYPE6).to_vec();
    all.sort_unstable();
    all.dedup();
    assert_eq!(all.len(), 24);
    assert_eq!(TYPE6.indices.iter().map(|&i| multinomial(i)).sum::<f64>(), 64.0);
}

/// Value of a piece's form at tau, scaled so that constant data 1 give 1.
fn value(b: &[f64], tau: f64) -> f64 {
    let (y, n) = (1.0 - tau, b.len() - 1);
    let mut v = b.to_vec();
    for k in 1..=n {
        for i in 0..=n - k {
            v[i] = y * v[i] + tau * v[i + 1];
        }
    }
    v[0]
}

/// The parts of f64 are those of integers, and the coefficients agree within the bound.
#[test]
fn the_composition_keeps_its_bound() {
    let mut seed = 3;
    let (mut compared, mut worst) = (0, [0.0f64; 2]);
    let domain = domain(4.0);
    let local = LocalMap::new(&domain, true).unwrap();
    let masks: &TetMasks = &TYPE6;
    let names = signatures(masks);
    for n in 0..600 {
        let point = |seed: &mut u64| domain.world(DVec3::new(random(seed), random(seed), random(seed)) * 3.0);
        let to = point(&mut seed);
        let from =
            point(&mut seed) + DVec3::new(random(&mut seed) - 0.5, random(&mut seed), 1.0) * if n % 3 == 0 { 1e4 } else { 3.0 };
        let ray = Ray {
            origin: from,
            direction: to - from,
        };
        let Some(exact) = ExactRay::new(&ray, &domain, true) else {
            continue;
        };
        let Mapped::Ray(map) = local.map(&ray) else { continue };
        let Some((t0, t1)) = exact.stay.clone() else { continue };
        // Some cube on the way.
        let tau = random(&mut seed);
        let mid = Ratio::from_f64(t0.bounds().0 + tau * (t1.bounds().1 - t0.bounds().0));
        if mid.compare(&t0).is_lt() || mid.compare(&t1).is_gt() {
            continue;
        }
        let index = exact.cell_at(&mid, [4; 3], false);
        let Some(span) = exact.span(index, [4; 3]) else { continue };
        let ends = (span.t0.bounds().0 - map.t_ref, span.t1.bounds().1 - map.t_ref);
        let slack = 1e-13 * (map.end.1 - map.start.0);
        let visit = Visit {
            index,
            outer: (ends.0 - slack, ends.1 + slack),
            inner: (ends.0 + slack, ends.1 - slack),
        };
        let Some(found) = cut(&map, &visit, &names) else { continue };
        let truth = parts(&exact, index, span, masks);
        assert_eq!(found.len(), truth.len(), "ray {n}");
        let c = random(&mut seed);
        let data: [f64; 27] = std::array::from_fn(|_| random(&mut seed));
        let most = data.iter().fold(0.0f64, |m, v| m.max((v - c).abs())).next_up();
        for (f, t) in found.iter().zip(truth) {
            assert_eq!(f.kind, t.kind, "ray {n}");
            let (lo, hi) = (t.span.t0.bounds(), t.span.t1.bounds());
            let ulps = 4.0 * f64::EPSILON * hi.1.abs();
            assert!(f.outer.0 + map.t_ref <= lo.1 + ulps && f.inner.0 + map.t_ref >= lo.0 - ulps);
            assert!(f.outer.1 + map.t_ref >= hi.0 - ulps && f.inner.1 + map.t_ref <= hi.1 + ulps);
            // The exact piece on the f64 stretch.
            let at = |s: f64| {
                let (a, b) = (Ratio::from_f64(map.t_ref), Ratio::from_f64(s));
                Ratio::new(&a.n * &b.d + &b.n * &a.d, a.d * b.d)
            };
            let stretch = super::exact::ExactPart {
                span: Span {
                    t0: at(f.outer.0),
                    t1: at(f.outer.1),
                    closed: true,
                },
                kind: f.kind,
            };
            let p = piece(&exact, index, stretch, masks, &data, c);
            let (b, scale) = p.bernstein();
            let exact_most = data.iter().fold(0.0f64, |m, v| m.max((v - c).abs()));
            let want: Vec<f64> = b.iter().map(|v| v / scale * exact_most).collect();
            let f64s = compose::<f64>(&map, index, f, masks, &data, c, most).unwrap();
            let dds = compose::<Dd>(&map, index, f, masks, &data, c, most).unwrap();
            for (i, want) in want.iter().enumerate() {
                // The comparison itself rounds.
                let slack = 1e-15 * most;
                let (d, e) = ((f64s.b[i] - want).abs(), (dds.b[i].f64() - want).abs());
                assert!(
                    d <= f64s.error + slack && e <= dds.error + slack,
                    "{d:e} {e:e} {:e}",
                    f64s.error
                );
                worst[0] = worst[0].max(d / f64s.error);
            }
            assert!((value(&want, 0.5) - value(&f64s.b[..4], 0.5)).abs() < 1e-13);
            compared += 1;
        }
    }
    assert!(compared > 1000, "{compared}");
    println!("{compared} parts, greatest error {:.3} of the bound", worst[0]);
}
