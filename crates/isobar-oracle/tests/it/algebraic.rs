//! Hardcases C on exact rays, and E1.

use crate::support::{Random, algebraic, expect, field, list, ray};
use isobar_core::Ray;
use isobar_oracle::{Decided, Oracle};

/// All three stages must say the same.
fn staged(o: &Oracle, check: impl Fn(&Oracle)) {
    for s in [Decided::F64, Decided::DoubleDouble, Decided::Exact] {
        check(&o.with_stage(s));
    }
}

/// A line through `p` along `d`; t = 0 of the case lies `back` units after the start.
fn line(p: [f64; 3], d: [f64; 3], back: f64) -> (Ray, f64) {
    let o = std::array::from_fn(|a| p[a] - back * d[a]);
    (ray(o, d), back)
}

fn through(o: &Oracle, p: [f64; 3], d: [f64; 3], want: &[(f64, u32)]) {
    staged(o, |o| {
        let (r, back) = line(p, d, 4.0);
        expect(o, &r, back, want, 4e-16);
    });
}

const X: [f64; 3] = [1.0, 0.0, 0.0];
const Y: [f64; 3] = [0.0, 1.0, 0.0];
const Z: [f64; 3] = [0.0, 0.0, 1.0];
const XYZ: [f64; 3] = [1.0, 1.0, 1.0];

#[test]
fn c1_silhouette() {
    let o = field("sphere");
    for (k, given) in [
        (6, 0.001_414_213_208_819_660_3),
        (10, 1.414_213_562_337_739_7e-5),
        (14, 1.414_213_562_373_091_5e-7),
    ] {
        let y = 1.0 - 10f64.powi(-k);
        // y is rounded, 1 - y is exact
        let e = 1.0 - y;
        let h = (e * (2.0 - e)).sqrt();
        assert!((h - given).abs() < 0.01 * given);
        staged(&o, |o| {
            let all = o.all(&ray([-2.0, y, 0.0], X));
            assert_eq!(all.roots.len(), 2);
            for (r, want) in all.roots.iter().zip([-h, h]) {
                assert!(r.lo - 5e-16 <= 2.0 + want && 2.0 + want <= r.hi + 5e-16, "{r:?} {want}");
            }
        });
        through(&o, [0.0, 2.0 - y, 0.0], X, &[]);
        assert_eq!(k >= 10, o.undecidable(&ray([-2.0, y, 0.0], X)));
    }
    through(&o, [0.0, 1.0, 0.0], X, &[(0.0, 2)]);
    through(&o, [0.0, 1.0f64.next_up(), 0.0], X, &[]);
    assert_eq!(o.all(&ray([-2.0, 1.0f64.next_down(), 0.0], X)).roots.len(), 2);
}

#[test]
fn c2_to_c5_torus() {
    let o = field("torus");
    through(&o, [0.0; 3], X, &[(-1.25, 1), (-0.75, 1), (0.75, 1), (1.25, 1)]);
    through(&o, [0.0, 0.0, 0.25], X, &[(-1.0, 2), (1.0, 2)]);
    through(&o, [0.0, 0.75, 0.0], X, &[(-1.0, 1), (0.0, 2), (1.0, 1)]);
    through(&o, [0.75, 0.0, 0.0], Z, &[(0.0, 2)]);
    through(&o, [0.0, 1.25, 0.0], X, &[(0.0, 2)]);
}

#[test]
fn c6_teardrop() {
    let o = field("teardrop");
    for (x, h) in [
        (-0.01, 7.035_623_639_735_144_3e-5),
        (0.01, 7.106_335_201_775_947_7e-5),
        (-0.1, 6.708_203_932_499_369_1e-3),
        (-0.8, 0.202_385_770_250_776_28),
    ] {
        through(&o, [x, 0.0, 0.0], Z, &[(-h, 1), (h, 1)]);
    }
    through(&o, [0.0; 3], Z, &[(0.0, 2)]);
    through(&o, [0.0; 3], X, &[(-1.0, 1), (0.0, 4)]);
}

#[test]
fn c7_cayley_node() {
    through(&field("cayley"), [-0.5, -0.5, 0.0], Z, &[(-0.5, 2)]);
}

#[test]
fn c8_steinberger() {
    through(&field("steinberger-a"), [0.0; 3], XYZ, &[(0.322_185_354_626_085_6, 1)]);
    let b = [
        (-0.545_499_028_854_807_2, 1),
        (-0.469_498_111_533_437_4, 1),
        (0.249_972_888_949_539_1, 1),
    ];
    through(&field("steinberger-b"), [0.0; 3], XYZ, &b);
    let c = [(-0.531_254_150_515_238_4, 1), (0.661_915_795_254_215_4, 1), (1.0, 1)];
    through(&field("steinberger-c"), [0.0; 3], XYZ, &c);
}

/// With X = 3x the lines' coordinates are exact.
#[test]
fn c9_clebsch_lines() {
    let mut terms: Vec<([u8; 3], f64)> = vec![([1, 1, 1], 2.0), ([0, 0, 0], 1.0)];
    for a in 0..3 {
        let e = |pairs: &[(usize, u8)]| {
            let mut e = [0u8; 3];
            pairs.iter().for_each(|&(a, p)| e[a] += p);
            e
        };
        terms.extend([(e(&[(a, 3)]), 3.0), (e(&[(a, 2)]), -1.0), (e(&[(a, 1)]), -3.0)]);
        terms.push((e(&[(a, 1), ((a + 1) % 3, 1)]), 14.0));
        for b in (0..3).filter(|&b| b != a) {
            terms.push((e(&[(a, 2), (b, 1)]), -7.0));
        }
    }
    let o = algebraic(&terms, 6.0);
    for (p, d) in [
        ([0.0, 0.0, -1.0], [1.0, -1.0, 0.0]),
        ([0.0, 1.0, 0.0], [1.0, -1.0, 0.0]),
        ([0.0, 2.0, 1.0], [1.0, -1.0, 0.0]),
    ] {
        staged(&o, |o| {
            let (r, _) = line(p, d, 16.0);
            let all = o.all(&r);
            assert_eq!(list(&all, 0.0).iter().map(|r| r.1).collect::<Vec<_>>(), [0], "{all:?}");
            assert!(all.roots[0].interval_end.unwrap() > all.roots[0].hi + 8.0);
            let (r, _) = line([p[0], p[1], p[2] + 1e-9], d, 16.0);
            let all = o.all(&r);
            assert!(all.roots.len() <= 3 && all.roots.iter().all(|r| r.interval_end.is_none()));
        });
    }
}

#[test]
fn c10_to_c12_singular_lines() {
    let steiner = field("steiner");
    through(
        &steiner,
        [0.0, 0.1, 0.1],
        X,
        &[(0.010_208_423_834_364_02, 1), (0.489_791_576_165_635_98, 1)],
    );
    through(&steiner, [0.0; 3], XYZ, &[(0.0, 3), (1.0 / 3.0, 1)]);
    for c in [0.125, 0.25, 0.75] {
        let (r, back) = line([0.0, 0.0, c], [1.0, 0.5, 0.0], 4.0);
        let got = list(&steiner.all(&r), back);
        assert!(got.contains(&(0.0, 2)), "{got:?}");
        assert_eq!(got.len(), if c < 0.4 { 3 } else { 1 });
    }
    let whitney = field("whitney");
    through(&whitney, [0.0, 0.0, -1.0], X, &[(0.0, 2)]);
    through(&whitney, [0.0, 1e-3, -1.0], X, &[]);
    let kiss = field("kiss");
    for s in [0.01f64, 0.25, 0.9] {
        let h = s * s * (1.0 - s).sqrt();
        through(&kiss, [0.0, 0.0, s], X, &[(-h, 1), (h, 1)]);
    }
    assert!((1e-4 * 0.99f64.sqrt() - 9.949_874_371_066_2e-5).abs() < 1e-17);
}

/// The twelve nodes (0, ±1/√2, ±1/√2) and their permutations: irrational double roots.
#[test]
fn c15_banchoff_chmutov_nodes() {
    let o = field("banchoff-chmutov");
    let h = std::f64::consts::FRAC_1_SQRT_2;
    for a in 0..3 {
        for sign in [1.0, -1.0] {
            let mut d = [1.0, 1.0, 1.0];
            d[a] = 0.0;
            d[(a + 1) % 3] = sign;
            through(&o, [0.0; 3], d, &[(-h, 2), (h, 2)]);
        }
    }
}

#[test]
fn c17_c18_tangle_and_mitchell() {
    let tangle = field("tangle");
    through(&tangle, [0.0; 3], X, &[]);
    let h = 2.261_077_198_045_795_7;
    through(&tangle, [0.0, 1.5, 1.5], X, &[(-h, 1), (h, 1)]);
    let mitchell = field("mitchell");
    through(&mitchell, [0.0; 3], [1.0, 1.0, 0.0], &[]);
    let (a, b) = (1.042_010_766_559_974_2, 1.978_437_151_484_245_4);
    through(&mitchell, [0.0; 3], X, &[(-b, 1), (-a, 1), (a, 1), (b, 1)]);
    through(&mitchell, [0.0; 3], Y, &[(-b, 1), (-a, 1), (a, 1), (b, 1)]);
}

/// Rays of C19, all surfaces together.
const C19_RAYS: usize = 100_000;

/// From both ends the same set, an even number counted with multiplicity, slopes alternate: closed surfaces inside their boxes.
#[test]
fn c19_random_rays_both_ways() {
    let mut random = Random(19);
    let mut later = 0;
    let mut total = 0;
    for (name, size) in [("sphere", 1.2), ("torus", 1.4), ("mitchell", 2.4), ("tangle", 2.9)] {
        let o = field(name);
        for _ in 0..C19_RAYS / 4 {
            let (a, b) = (random.vector(-size, size), random.vector(-size, size));
            let d = (b - a).normalize();
            let start = a - 16.0 * d;
            let all = o.all(&Ray {
                origin: start,
                direction: d,
            });
            let back = o.all(&Ray {
                origin: a + 16.0 * d,
                direction: -d,
            });
            assert_eq!(all.roots.len(), back.roots.len(), "{name}");
            assert!(all.roots.len().is_multiple_of(2));
            for (f, g) in all.roots.iter().zip(back.roots.iter().rev()) {
                assert!((f.t() + g.t() - 32.0).abs() < 1e-8 / f.slope.abs().min(1.0));
            }
            assert!(all.roots.windows(2).all(|w| w[0].slope * w[1].slope < 0.0));
            assert!(all.decided != Decided::Exact);
            later += usize::from(all.decided != Decided::F64);
            total += 1;
        }
    }
    // Sums in world coordinates cancel: one ray in ten needs double-double for a bracket of 1e-13 t, none needs integers.
    assert!(later * 6 <= total, "{later} of {total} not by f64");
}

/// The stages agree on random rays, also for degree 6.
#[test]
fn stage_1_agrees_with_integers() {
    let mut random = Random(20);
    for (name, size) in [
        ("barth-sextic", 2.0),
        ("kummer", 2.0),
        ("clebsch", 2.0),
        ("steinberger-c", 2.0),
        ("kiss", 2.0),
    ] {
        let o = field(name);
        let exact = o.with_stage(Decided::Exact);
        let mut early = 0;
        for _ in 0..60 {
            let (a, b) = (random.vector(-size, size), random.vector(-size, size));
            let r = Ray {
                origin: a - 4.0 * (b - a),
                direction: b - a,
            };
            let (x, y) = (o.all(&r), exact.all(&r));
            assert_eq!(x.roots.len(), y.roots.len(), "{name} {r:?}");
            for (p, q) in x.roots.iter().zip(&y.roots) {
                assert!(
                    p.lo <= q.hi && q.lo <= p.hi && p.multiplicity == q.multiplicity,
                    "{name} {p:?} {q:?}"
                );
            }
            early += usize::from(x.decided == Decided::F64);
        }
        assert!(early > 30, "{name}: {early} of 60 by f64");
    }
}

#[test]
fn e1_far_camera() {
    let o = field("sphere");
    for (d, first, last) in [(X, 9_999_999.0, 10_000_001.0), ([0.5, 0.0, 0.0], 19_999_998.0, 20_000_002.0)] {
        staged(&o, |o| {
            let all = o.all(&ray([-1e7, 0.0, 0.0], d));
            assert_eq!(all.roots.len(), 2);
            for (r, want) in all.roots.iter().zip([first, last]) {
                assert!(r.lo <= want && want <= r.hi && r.hi - r.lo <= 1e-7);
            }
        });
    }
    // exactly representable roots come back exactly from the integers
    let all = o.with_stage(Decided::Exact).all(&ray([-1e7, 0.0, 0.0], X));
    assert_eq!(
        (all.roots[0].lo, all.roots[0].hi, all.roots[1].lo),
        (9_999_999.0, 9_999_999.0, 10_000_001.0)
    );
}
