//! The type-6 spline: hardcases B11b, B14, B15, and agreement of the stages.

use crate::random::agree;
use crate::support::{Random, ray};
use isobar_core::{DMat3, DVec3, Function, Grid, Ray, Samples, Stage};
use isobar_fields::Reconstruction;
use isobar_oracle::{Decided, Multiplicity, Oracle};
use std::sync::Arc;

fn spline(dims: [usize; 3], mut f: impl FnMut(f64, f64, f64) -> f32) -> Arc<dyn Function> {
    let n = dims.iter().product::<usize>();
    let samples: Vec<f32> = (0..n)
        .map(|i| {
            f(
                (i % dims[0]) as f64,
                (i / dims[0] % dims[1]) as f64,
                (i / dims[0] / dims[1]) as f64,
            )
        })
        .collect();
    let grid = Grid::unit(dims, Samples::F32(samples.into())).unwrap();
    Reconstruction::Type6.of(&grid, Stage::Stored).unwrap()
}

/// B11b: data i^2 + j^2 + k^2 give a sphere of radius sqrt(99.25), also along axes, edges and diagonals of the partition.
#[test]
fn squares_give_a_sphere() {
    let s = spline([25; 3], |x, y, z| {
        ((x - 12.0).powi(2) + (y - 12.0).powi(2) + (z - 12.0).powi(2)) as f32
    });
    let o = Oracle::new(s, 100.0);
    let directions = [
        [1.0, 0.0, 0.0],
        [1.0, 1.0, 0.0],
        [1.0, 1.0, 1.0],
        [0.0, -1.0, 1.0],
        [0.3, -0.2, 0.9],
        [1.0, 0.5, 0.5],
        [2.0, 1.0, 1.0],
    ];
    for d in directions {
        let d = DVec3::from(d);
        let r = Ray {
            origin: DVec3::splat(12.0),
            direction: d,
        };
        let all = o.all(&r);
        let want = 99.25f64.sqrt() / d.length();
        assert_eq!(all.roots.len(), 1, "{d}: {all:?}");
        assert!(
            (all.roots[0].t() - want).abs() < 1e-12 && all.roots[0].multiplicity == Multiplicity::Simple,
            "{d}: {all:?}"
        );
        let r = Ray {
            origin: DVec3::splat(12.0) - d * 30.0,
            direction: d,
        };
        let all = o.all(&r).roots;
        assert_eq!(all.len(), 2, "{d}: {all:?}");
        assert!((all[0].t() - (30.0 - want)).abs() < 1e-11 && (all[1].t() - (30.0 + want)).abs() < 1e-11);
    }
    // A tangent at the top: y at exactly the radius is not a number of f64, so a pair or nothing, a hair apart.
    let inside = o.all(&ray([0.0, 12.0, 12.0 + 9.962_429_422_585_6], [1.0, 0.0, 0.0])).roots;
    let outside = o.all(&ray([0.0, 12.0, 12.0 + 9.962_429_422_585_7], [1.0, 0.0, 0.0])).roots;
    assert!(inside.len() == 2 && outside.is_empty(), "{inside:?} {outside:?}");
    assert!(o.undecidable(&ray([0.0, 12.0, 12.0 + 9.962_429_422_585_7], [1.0, 0.0, 0.0])));
}

/// B14, and an exact tangent: a plane is hit to the last bits from anywhere; x^2 - 1/4 touches zero in a plane of centres.
#[test]
fn planes_and_tangents() {
    let s = spline([9; 3], |x, y, z| (3.0 * x - 2.0 * y + 0.5 * z + 7.0) as f32);
    let o = Oracle::new(s, 11.0);
    let mut random = Random(4);
    for _ in 0..200 {
        let (a, b) = (random.vector(1.0, 7.0), random.vector(1.0, 7.0));
        let f = |p: DVec3| 3.0 * p.x - 2.0 * p.y + 0.5 * p.z - 4.0;
        let r = Ray {
            origin: a,
            direction: b - a,
        };
        let want = f(a) / (f(a) - f(b));
        let roots = o.all(&r).roots;
        if (0.0..=1.0).contains(&want) {
            assert!(roots.len() == 1 && (roots[0].t() - want).abs() < 1e-11, "{roots:?} {want}");
        }
    }
    let s = spline([9; 3], |x, _, _| ((x - 4.0).powi(2)) as f32);
    let o = Oracle::new(s, 0.25);
    for d in [[1.0, 0.0, 0.0], [1.0, 0.1, 0.2], [1.0, 1.0, 0.0]] {
        let roots = o.all(&ray([2.0, 3.0, 4.0], d)).roots;
        assert_eq!(roots.len(), 1, "{roots:?}");
        assert!(matches!(roots[0].multiplicity, Multiplicity::Even(2)) && (roots[0].t() - 2.0).abs() < 1e-12);
    }
}

/// A plateau is one stretch with exact ends, whatever the ray.
#[test]
fn plateaus_are_stretches() {
    // 5 on 2 <= x <= 7: all 27 data of the cubes 3 to 6 are 5, so s = 5 for 2.5 <= x <= 6.5
    let s = spline([10; 3], |x, _, _| if (2.0..=7.0).contains(&x) { 5.0 } else { 0.0 });
    let o = Oracle::new(s, 5.0);
    for d in [[1.0, 0.0, 0.0], [1.0, 0.25, 0.125], [1.0, 0.5, 0.5]] {
        let all = o.all(&ray([0.0, 1.0, 1.0], d)).roots;
        assert_eq!(all.len(), 1, "{all:?}");
        assert!(
            all[0].multiplicity == Multiplicity::Interval && all[0].t() == 2.5 && all[0].interval_end == Some(6.5),
            "{all:?}"
        );
    }
}

/// Noise through all cells, odd lattices, rays through lattice points and centres of faces: the three stages say the same.
#[test]
fn stages_agree_on_noise() {
    let mut noise = Random(50);
    let samples: Vec<u8> = (0..8 * 7 * 6).map(|_| noise.below(200) as u8).collect();
    let turned = DMat3::from_rotation_z(0.3) * DMat3::from_rotation_x(-1.1);
    let mut random = Random(51);
    for (case, direction) in [DMat3::IDENTITY, turned].into_iter().enumerate() {
        let grid = Grid::new(
            [8, 7, 6],
            DVec3::new(0.5, 0.25, 2.0),
            DVec3::new(-1.0, 2.0, 0.3),
            direction,
            Samples::U8(samples.clone().into()),
        )
        .unwrap();
        for kind in [Reconstruction::Type6, Reconstruction::Type6Prefiltered] {
            let f = kind.of(&grid, Stage::Stored).unwrap();
            let domain = *f.domain();
            let o = Oracle::new(f, 99.5);
            let (exact, dd) = (o.with_stage(Decided::Exact), o.with_stage(Decided::DoubleDouble));
            let (mut found, mut by_integers) = (0, 0);
            for n in 0..120 {
                let mut a = random.vector(-4.0, 12.0);
                let mut b = domain.hi * random.vector(0.0, 1.0);
                if n % 4 == 0 {
                    (a, b) = ((a * 2.0).round() * 0.5, (b * 2.0).round() * 0.5);
                }
                if a == b {
                    continue;
                }
                let (a, b) = (domain.world(a), domain.world(b));
                let r = Ray {
                    origin: a,
                    direction: b - a,
                };
                let all = o.all(&r);
                agree(&all, &exact.all(&r), &r);
                agree(&all, &dd.all(&r), &r);
                found += all.roots.len();
                by_integers += usize::from(all.decided == Decided::Exact);
                for root in &all.roots {
                    let s = o.function().value(r.at(root.t()));
                    assert!((s - 99.5).abs() < 1e-9 * (1.0 + root.slope.abs()), "{kind} {s}");
                }
                if let Some(first) = o.first(&r).hit() {
                    assert_eq!(first.lo, all.roots[0].lo);
                } else {
                    assert!(all.roots.is_empty());
                }
            }
            assert!(found > 150, "{kind} {found}");
            assert!(by_integers < 60 || case == 0, "{kind}: {by_integers} by integers");
        }
    }
}

/// The number of roots is the same as seen from the other end, with alternating signs.
#[test]
fn reversed_rays_see_the_same() {
    let mut noise = Random(9);
    let s = spline([7; 3], move |_, _, _| noise.below(1000) as f32);
    let o = Oracle::new(s, 480.25);
    let mut random = Random(10);
    let mut found = 0;
    for _ in 0..150 {
        let (a, b) = (random.vector(-9.0, -1.0), random.vector(7.0, 15.0));
        let forward = o
            .all(&Ray {
                origin: a,
                direction: b - a,
            })
            .roots;
        let back = o
            .all(&Ray {
                origin: b,
                direction: a - b,
            })
            .roots;
        assert_eq!(forward.len(), back.len());
        for (f, g) in forward.iter().zip(back.iter().rev()) {
            assert!((f.t() - (1.0 - g.t())).abs() < 1e-9);
        }
        let simple = forward.iter().all(|r| r.multiplicity == Multiplicity::Simple);
        assert!(
            !simple || forward.windows(2).all(|w| w[0].slope * w[1].slope < 0.0),
            "{forward:?}"
        );
        found += forward.len();
    }
    assert!(found > 100, "{found}");
}
