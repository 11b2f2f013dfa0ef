//! Stage against stage, ray against reversed ray, on random data.

use crate::support::{Random, Spline, list, ray};
use isobar_core::{Basis1, CUBIC, DMat3, DVec3, Function, QUADRATIC, Ray, Stage, TRILINEAR};
use isobar_core::{Grid, Samples};
use isobar_fields::{GridSpline, Kind};
use isobar_oracle::{AllRoots, Decided, Oracle};
use std::sync::Arc;

pub(crate) fn agree(a: &AllRoots, b: &AllRoots, r: &Ray) {
    assert_eq!(a.roots.len(), b.roots.len(), "{r:?}\n{a:?}\n{b:?}");
    for (x, y) in a.roots.iter().zip(&b.roots) {
        assert!(x.lo <= y.hi && y.lo <= x.hi, "{r:?}: {x:?} {y:?}");
        assert_eq!(x.multiplicity, y.multiplicity, "{r:?}");
        let t = x.hi.abs();
        assert!(x.hi - x.lo <= (4.0 * (t.next_up() - t)).max(1e-13 * t), "{x:?}");
    }
}

fn random_ray(random: &mut Random, size: f64) -> Ray {
    let o = random.vector(-size, 2.0 * size);
    let target = random.vector(0.0, size);
    Ray {
        origin: o,
        direction: (target - o).normalize(),
    }
}

/// The stage 1 answer is that of integers alone, which share neither traversal nor arithmetic with it.
#[test]
fn stage_1_agrees_with_integers() {
    let mut random = Random(1);
    for (kind, basis) in [&TRILINEAR, &QUADRATIC, &CUBIC].into_iter().enumerate() {
        let mut found = 0;
        let (mut later, mut integers) = (0, 0);
        for volume in 0..8 {
            let mut noise = Random(volume + 100);
            let n = [5, 6, 7];
            let values: Vec<f64> = (0..210).map(|_| noise.within(-1.0, 1.0)).collect();
            let at = |i: f64, j: f64, k: f64| values[(i + 5.0 * (j + 6.0 * k)) as usize];
            let o = Spline::new(n, basis, at).oracle(0.05);
            let exact = o.with_stage(Decided::Exact);
            for _ in 0..260 {
                let r = random_ray(&mut random, 5.0);
                let (a, b) = (o.all(&r), exact.all(&r));
                agree(&a, &b, &r);
                assert_eq!(
                    o.first(&r).hit().map(|h| h.multiplicity),
                    a.roots.first().map(|h| h.multiplicity)
                );
                found += a.roots.len();
                later += usize::from(a.decided != Decided::F64);
                integers += usize::from(a.decided == Decided::Exact);
            }
        }
        // Eyes inside the volume ask for brackets of 1e-13 t near t = 0, which takes double-double.
        assert!(
            found > 2000 && later <= 300 && integers == 0,
            "kind {kind}: {found} roots, {later} and {integers} later"
        );
    }
}

/// Double-double alone, too.
#[test]
fn stage_2_agrees_with_stage_1() {
    let mut random = Random(2);
    let wave = |i: f64, j: f64, k: f64| (i * 0.9).sin() * (j * 0.8).cos() + (k * 0.7).sin();
    for basis in [&TRILINEAR, &QUADRATIC, &CUBIC] {
        let o = Spline::new([12; 3], basis, wave).oracle(0.3);
        let dd = o.with_stage(Decided::DoubleDouble);
        for _ in 0..300 {
            let r = random_ray(&mut random, 11.0);
            agree(&o.all(&r), &dd.all(&r), &r);
        }
    }
}

/// Rays with integer and half-integer data: faces, edges, corners, plateaus and tangents all the time.
#[test]
fn degenerate_rays_agree_with_integers() {
    let mut random = Random(3);
    let mut exact_used = 0;
    for basis in [&TRILINEAR, &QUADRATIC, &CUBIC] {
        for volume in 0..6 {
            let mut noise = Random(volume + 7);
            let values: Vec<f64> = (0..64).map(|_| noise.below(3) as f64 - 1.0).collect();
            let at = |i: f64, j: f64, k: f64| values[(i + 4.0 * (j + 4.0 * k)) as usize];
            let o = Spline::new([4; 3], basis, at).oracle(0.0);
            let exact = o.with_stage(Decided::Exact);
            for _ in 0..60 {
                let half = |r: &mut Random, a: u64, shift: f64| r.below(a) as f64 * 0.5 - shift;
                let from: [f64; 3] = std::array::from_fn(|_| half(&mut random, 15, 2.0));
                let d: [f64; 3] = std::array::from_fn(|_| half(&mut random, 5, 1.0));
                if d == [0.0; 3] {
                    continue;
                }
                let r = ray(from, d);
                let (a, b) = (o.all(&r), exact.all(&r));
                assert_eq!(list(&a, 0.0).len(), list(&b, 0.0).len(), "{r:?}\n{a:?}\n{b:?}");
                for (x, y) in a.roots.iter().zip(&b.roots) {
                    assert!(x.lo <= y.hi && y.lo <= x.hi && x.multiplicity == y.multiplicity);
                    assert_eq!(x.interval_end, y.interval_end);
                }
                assert_eq!(
                    o.first(&r).hit().map(|h| h.interval_end),
                    a.roots.first().map(|h| h.interval_end)
                );
                exact_used += usize::from(a.decided == Decided::Exact);
            }
        }
    }
    assert!(exact_used > 40, "{exact_used}");
}

/// C19 for lattices: from the other end the same set, and ds/dt alternates where all roots are simple.
#[test]
fn reversed_rays_find_the_same_set() {
    let mut random = Random(4);
    let bowl = |i: f64, j: f64, k: f64| (i - 5.0).powi(2) + (j - 5.0).powi(2) + (k - 5.0).powi(2) + 3.0 * (i * j).sin();
    let axes = DMat3::from_cols(
        DVec3::new(1.5, 0.5, 0.0),
        DVec3::new(0.0, 1.0, 0.25),
        DVec3::new(0.0, 0.0, 2.0),
    );
    for basis in [&TRILINEAR, &QUADRATIC, &CUBIC] as [&'static Basis1; 3] {
        for axes in [DMat3::IDENTITY, axes] {
            let o = Spline::new([11; 3], basis, bowl).placed(DVec3::ZERO, axes).oracle(15.0);
            for _ in 0..200 {
                let (a, b) = (random.vector(-4.0, 14.0), random.vector(-4.0, 14.0));
                let (a, b) = (axes * a, axes * b);
                let d = b - a;
                let forward = o.all(&Ray {
                    origin: a - 8.0 * d,
                    direction: d,
                });
                // An exactly reversed line needs an end point that is exact on it: t -> T - t about the midpoint a - 8 d.
                let back = o.all(&Ray {
                    origin: a - 8.0 * d,
                    direction: -d,
                });
                assert!(back.roots.is_empty() || !forward.roots.is_empty() || back.roots[0].lo >= 0.0);
                let far = a + 24.0 * d;
                let back = o.all(&Ray {
                    origin: far,
                    direction: -d,
                });
                assert_eq!(forward.roots.len(), back.roots.len());
                for (f, g) in forward.roots.iter().zip(back.roots.iter().rev()) {
                    // the two lines differ by rounding of the far point, so only nearly the same numbers
                    assert!((f.t() - (32.0 - g.t())).abs() < 1e-9);
                    assert!(f.slope * g.slope < 0.0);
                }
                assert!(forward.roots.windows(2).all(|w| w[0].slope * w[1].slope < 0.0));
            }
        }
    }
}

/// Every kind of grid spline through its own `Lattice`, against integers.
#[test]
fn grid_splines_agree_with_integers() {
    let mut noise = Random(50);
    let samples: Vec<u8> = (0..8 * 7 * 6).map(|_| noise.below(200) as u8).collect();
    let grid = Grid::new(
        [8, 7, 6],
        DVec3::new(0.1, 0.2, 0.15),
        DVec3::new(-1.0, 2.0, 0.3),
        DMat3::IDENTITY,
        Samples::U8(samples.into()),
    );
    let grid = grid.unwrap();
    let mut random = Random(51);
    for kind in Kind::ALL {
        let f: Arc<dyn Function> = Arc::new(GridSpline::new(&grid, kind, Stage::Stored).unwrap());
        let o = Oracle::new(f, 99.5);
        let exact = o.with_stage(Decided::Exact);
        let mut found = 0;
        for _ in 0..60 {
            let target = DVec3::new(random.within(-1.0, -0.3), random.within(2.0, 3.2), random.within(0.3, 1.05));
            let from = random.vector(-3.0, 3.0);
            let r = Ray {
                origin: from,
                direction: (target - from).normalize(),
            };
            let a = o.all(&r);
            agree(&a, &exact.all(&r), &r);
            found += a.roots.len();
            // f64 evaluation agrees with the certificate
            for root in &a.roots {
                let s = o.function().value(r.at(root.t()));
                assert!((s - 99.5).abs() < 1e-9 * (1.0 + root.slope.abs()), "{kind} {s}");
            }
        }
        assert!(found > 50, "{kind} {found}");
    }
}
