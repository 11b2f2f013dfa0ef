//! The pyramid in f32: sizes, selections, rounding, compression.

use super::noise;
use super::rays::Random;
use crate::wavelet::blocks::{Blocks, chunks_of};
use crate::wavelet::table::{epsilon_for, parts};
use crate::wavelet::{Adaptive, Bank, Criteria, Extent, Placement, Pyramid, Selection};
use glam::DVec3;
use isobar_core::{DataError, Grid, Samples};
use std::sync::Arc;

fn noisy(dims: [usize; 3]) -> Grid {
    let samples: Vec<i16> = noise(dims.iter().product(), 11).into_iter().map(|v| v as i16).collect();
    Grid::unit(dims, Samples::I16(samples.into())).unwrap()
}

/// A ball of radius 6 about the middle of 32^3.
fn ball() -> Grid {
    let samples: Vec<f32> = (0..32 * 32 * 32)
        .map(|i| {
            let p = DVec3::new((i % 32) as f64, (i / 32 % 32) as f64, (i / 1024) as f64) - 15.5;
            (6.0 - p.length()) as f32
        })
        .collect();
    Grid::unit([32; 3], Samples::F32(samples.into())).unwrap()
}

#[test]
fn the_thesis_counts_4681_chunks_in_128_cubed() {
    let p = Pyramid::<f32>::of([128; 3], &vec![0.0; 1 << 21], Bank::Psi42, Placement::default());
    assert_eq!((p.levels(), p.chunks()), (4, 4681));
}

#[test]
fn samples_come_back_but_for_rounding() {
    // The bound is 16 units in the last place of the greatest sample, 128.
    for bank in Bank::ALL {
        for dims in [[33, 30, 17], [40, 1, 9], [9, 9, 9], [8, 8, 8]] {
            let grid = noisy(dims);
            let p = Arc::new(Pyramid::new(&grid, bank).unwrap());
            let mut adaptive = Adaptive::new(p.clone());
            adaptive.update(&Selection::whole(&p, true), Extent::Drawn);
            let out = adaptive.grid().unwrap();
            let worst = (0..out.samples.len()).fold(0.0f64, |m, i| m.max((out.samples.get(i) - grid.samples.get(i)).abs()));
            assert!(worst < 2.5e-4, "{bank} {dims:?} {worst}");
            assert_eq!((out.dims, out.domain()), (grid.dims, grid.domain()));
        }
    }
}

#[test]
fn the_number_of_threads_changes_no_bit() {
    let p = Arc::new(Pyramid::new(&noisy([33, 30, 40]), Bank::Psi44).unwrap());
    let selection = Selection::by(&p, |n| n.chunk[0] % 2 == 0);
    let of = |threads: usize| {
        let pool = isobar_cpu::Pool::new(threads).unwrap();
        pool.install(|| {
            let mut a = Adaptive::new(p.clone());
            a.update(&selection, Extent::Drawn);
            a.coefficients()
        })
    };
    assert_eq!(of(1), of(3));
}

#[test]
fn views_open_what_is_near() {
    let p = Pyramid::new(&ball(), Bank::Psi42).unwrap();
    let count = |eye: DVec3, epsilon: f64| {
        let view = Some((eye, epsilon));
        Selection::new(
            &p,
            &Criteria {
                view,
                ..Criteria::default()
            },
        )
    };
    let eye = DVec3::new(-10.0, 15.0, 15.0);
    let some = count(eye, 0.9);
    assert!(some.level(0).contains([0, 1, 1]) && !some.level(0).contains([3, 1, 1]));
    let mut last = usize::MAX;
    for epsilon in [1e-3, 0.5, 0.9, 2.0, 1e3] {
        let n = count(eye, epsilon).count();
        assert!(n <= last);
        last = n;
    }
    assert_eq!((count(eye, 1e-3).count(), last), (64 + 8, 0));
    // An eye inside opens its own node at any threshold.
    assert!(count(DVec3::splat(3.0), 1e9).level(0).contains([0, 0, 0]));
    let epsilon = epsilon_for(&p, eye, 0.5);
    let n = |e: f64| count(eye, e).count() + 1;
    assert!(n(epsilon) * 2 >= p.chunks() && n(epsilon * 1.002) * 2 < p.chunks());
}

#[test]
fn isovalues_and_magnitudes_leave_out_what_does_not_matter() {
    let p = Arc::new(Pyramid::new(&ball(), Bank::Psi42).unwrap());
    let isovalues = Criteria {
        isovalues: Some(vec![3.0]),
        ..Criteria::default()
    };
    let selection = Selection::new(&p, &isovalues);
    assert!(selection.level(0).contains([1, 1, 1]) && !selection.level(0).contains([0, 0, 0]));
    // The surface is the same: where a node has it, the details are there, and those of neighbours far from it matter little.
    let mut adaptive = Adaptive::new(p.clone());
    adaptive.update(&selection, Extent::Drawn);
    let out = adaptive.grid().unwrap();
    let near = |i: usize| (ball().samples.get(i) - 3.0).abs() < 1.0;
    let worst = (0..32768)
        .step_by(5)
        .filter(|&i| near(i))
        .fold(0.0f64, |m, i| m.max((out.samples.get(i) - ball().samples.get(i)).abs()));
    assert!(worst < 0.02, "{worst}");
    let magnitude = |m: f64| {
        let criteria = Criteria {
            magnitude: Some(m),
            ..Criteria::default()
        };
        Selection::new(&p, &criteria).count()
    };
    assert!(magnitude(0.0) == 72 && magnitude(0.05) < 72 && magnitude(1e9) == 0);
    assert_eq!(
        Selection::new(
            &p,
            &Criteria {
                isovalues: Some(vec![99.0]),
                ..Criteria::default()
            }
        )
        .count(),
        0
    );
}

#[test]
fn frames_share_their_chunks() {
    let p = Arc::new(Pyramid::new(&noisy([64; 3]), Bank::Psi42).unwrap());
    let select = |x: f64| {
        let view = Some((DVec3::new(x, 32.0, 32.0), 0.55));
        Selection::new(
            &p,
            &Criteria {
                view,
                ..Criteria::default()
            },
        )
    };
    let mut adaptive = Adaptive::new(p.clone());
    let first = adaptive.update(&select(-20.0), Extent::Drawn);
    assert!(first.computed > 100 && first.reused == 0, "{first:?}");
    assert_eq!(adaptive.update(&select(-20.0), Extent::Drawn).computed, 0);
    let near = adaptive.update(&select(-23.0), Extent::Drawn);
    assert!(near.reused > near.computed, "{near:?}");
}

#[test]
fn the_largest_coefficients_come_first() {
    let grid = ball();
    let p = Pyramid::new(&grid, Bank::Psi42).unwrap();
    let error = |share: f64, weighted: bool| {
        let (small, kept) = p.keep_largest((share * 32768.0) as usize, weighted);
        assert!(kept as f64 <= share * 32768.0 + 64.0 && kept >= 512, "{kept}");
        let small = Arc::new(small);
        let mut a = Adaptive::new(small.clone());
        a.update(&Selection::whole(&small, true), Extent::Whole);
        let sum: f64 = a
            .coefficients()
            .iter()
            .enumerate()
            .map(|(i, &v)| (f64::from(v) - grid.samples.get(i)).powi(2))
            .sum();
        (sum / 32768.0).sqrt()
    };
    let errors: Vec<f64> = [1.0, 0.3, 0.1, 0.03, 0.016].into_iter().map(|s| error(s, true)).collect();
    assert!(errors.windows(2).all(|w| w[0] < w[1]), "{errors:?}");
    assert!(errors[0] < 1e-5 && errors[2] < 0.01, "{errors:?}");
    // The wavelets are not orthogonal: weights change the choice, for better or worse.
    assert_ne!(error(0.03, true), error(0.03, false));
}

#[test]
fn aggressive_levels_change_the_topology() {
    // Two rods three samples apart, one sample thick: the coarse spline sees one or none (Figure 6.9).
    let at = |i: usize| (i % 32, i / 32 % 32);
    let samples: Vec<f32> = (0..32768)
        .map(|i| f32::from(u8::from(matches!(at(i), (14 | 17, 15)))))
        .collect();
    let grid = Grid::unit([32; 3], Samples::F32(samples.into())).unwrap();
    assert_eq!(parts(&grid, 0.2), 2);
    let p = Arc::new(Pyramid::new(&grid, Bank::Psi42).unwrap());
    let mut adaptive = Adaptive::new(p.clone());
    adaptive.update(&Selection::whole(&p, false), Extent::Drawn);
    assert_ne!(parts(&adaptive.grid().unwrap(), 0.2), 2);
    adaptive.update(&Selection::whole(&p, true), Extent::Drawn);
    assert_eq!(parts(&adaptive.grid().unwrap(), 0.2), 2);
}

/// Beyond 2^32 values, without the memory: a value's place is its chunk's and that inside.
#[test]
fn huge_lattices_are_addressed() {
    let dims = [5000, 6003, 7001];
    let blocks = Blocks::<f32> {
        dims,
        chunks: chunks_of(dims),
        data: Vec::new(),
    };
    assert_eq!(blocks.chunks, [625, 751, 876]);
    let at = blocks.at([4999, 6002, 7000]) as u64;
    assert_eq!(at, ((875 * 751 + 750) * 625 + 624) * 512 + 2 * 8 + 7);
    assert!(at > u64::from(u32::MAX));
    assert_eq!(blocks.at([4992, 6000, 7000]) as u64, at - 23);
}

#[test]
fn small_thin_and_broken_volumes() {
    for dims in [[1, 1, 1], [2, 1, 3], [100, 1, 1], [9, 2, 1]] {
        let grid = noisy(dims);
        for bank in Bank::ALL {
            let p = Arc::new(Pyramid::new(&grid, bank).unwrap());
            let mut a = Adaptive::new(p.clone());
            a.update(&Selection::whole(&p, true), Extent::Drawn);
            let values = a.coefficients();
            let worst = values
                .iter()
                .enumerate()
                .fold(0.0f64, |m, (i, &v)| m.max((f64::from(v) - grid.samples.get(i)).abs()));
            assert!(worst < 2.5e-4, "{bank} {dims:?} {worst}");
        }
    }
    let broken = Grid::unit([2, 2, 2], Samples::F32(vec![f32::NAN; 8].into())).unwrap();
    assert!(matches!(
        Pyramid::new(&broken, Bank::Psi22),
        Err(DataError::NotFinite { count: 8, .. })
    ));
    // A constant stays constant at every level.
    let flat = Grid::unit([20; 3], Samples::U8(vec![7; 8000].into())).unwrap();
    let p = Arc::new(Pyramid::new(&flat, Bank::Psi33).unwrap());
    let mut a = Adaptive::new(p);
    assert!(a.coefficients().iter().all(|&v| v == 7.0));
}

/// Samples that f32 holds and whose details, or sums of these, it does not.
#[test]
fn details_beyond_f32_are_refused() {
    let mut random = Random(99);
    let mut grid = |most: f32| {
        let samples: Vec<f32> = (0..8000).map(|_| if random.next() < 0.5 { -most } else { most }).collect();
        Grid::unit([20; 3], Samples::F32(samples.into())).unwrap()
    };
    for bank in Bank::ALL {
        let e = Pyramid::new(&grid(3e38), bank).unwrap_err();
        assert!(e.to_string().contains("scale them down"), "{bank}: {e}");
        // What is not refused is finite whatever is used of it.
        let mut taken = 0;
        for exponent in 30..=38 {
            let Ok(p) = Pyramid::new(&grid(10f32.powi(exponent)), bank) else {
                continue;
            };
            taken += 1;
            let p = Arc::new(p);
            for odd in [0, 1] {
                let some = Selection::by(&p, |n| n.level > 0 || (n.chunk[0] + n.chunk[1] + n.chunk[2]) % 2 == odd);
                let mut adaptive = Adaptive::new(p.clone());
                adaptive.update(&some, Extent::Whole);
                assert!(adaptive.coefficients().iter().all(|v| v.is_finite()), "{bank} 1e{exponent}");
            }
        }
        assert!(taken >= 5, "{bank}: {taken}");
    }
}
