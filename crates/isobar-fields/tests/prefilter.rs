//! The interpolating kinds: samples met, border rows solved, storage as promised.

mod common;

use common::Random;
use isobar_core::{DVec3, Function, Grid, Lattice, Samples, Stage};
use isobar_fields::{Border, Coefficients, GridSpline, Kind};

const INTERPOLATING: [Kind; 2] = [Kind::QuadraticInterpolating, Kind::CubicInterpolating];
const SIZES: [[usize; 3]; 7] = [
    [2, 2, 2],
    [2, 3, 4],
    [3, 3, 3],
    [5, 2, 9],
    [17, 6, 3],
    [9, 10, 40],
    [4, 5, 101],
];

fn grids(dims: [usize; 3]) -> Vec<Grid> {
    let n = dims.iter().product::<usize>();
    let mut r = Random(n as u64);
    let mut values = |lo: f64, hi: f64| (0..n).map(|_| r.range(lo, hi)).collect::<Vec<_>>();
    let u8s = values(0.0, 256.0).iter().map(|&v| v as u8).collect::<Vec<_>>();
    let i16s = values(-32768.0, 32768.0).iter().map(|&v| v as i16).collect::<Vec<_>>();
    let u16s = values(0.0, 65536.0).iter().map(|&v| v as u16).collect::<Vec<_>>();
    let f32s = values(-1.0, 1.0).iter().map(|&v| v as f32).collect::<Vec<_>>();
    [
        Samples::U8(u8s.into()),
        Samples::I16(i16s.into()),
        Samples::U16(u16s.into()),
        Samples::F32(f32s.into()),
    ]
    .map(|s| Grid::unit(dims, s).unwrap())
    .into()
}

fn all_indices(d: [usize; 3]) -> impl Iterator<Item = [usize; 3]> {
    (0..d[2]).flat_map(move |k| (0..d[1]).flat_map(move |j| (0..d[0]).map(move |i| [i, j, k])))
}

#[test]
fn samples_are_met() {
    for dims in SIZES {
        for grid in grids(dims) {
            let (range, _) = grid.samples.range();
            let (lo, hi) = range.unwrap();
            let size = lo.abs().max(hi.abs());
            for kind in INTERPOLATING {
                for (stage, tol) in [(Stage::Ideal, 1e-13), (Stage::Stored, 27.0 * 2f64.powi(-24))] {
                    let s = GridSpline::new(&grid, kind, stage).unwrap();
                    for ijk in all_indices(dims) {
                        let v = s.value(DVec3::from_array(ijk.map(|i| i as f64)));
                        let e = (v - grid.sample(ijk)).abs();
                        assert!(e <= tol * size, "{kind} {stage:?} {dims:?} {ijk:?}: off by {e}");
                    }
                }
            }
        }
    }
}

/// The rows of the system, applied to the coefficients with the border rule: independent of the evaluation.
#[test]
fn the_system_is_solved() {
    for dims in SIZES {
        for grid in grids(dims) {
            for (kind, m, q) in [(INTERPOLATING[0], 6.0, 8.0), (INTERPOLATING[1], 4.0, 6.0)] {
                let s = GridSpline::new(&grid, kind, Stage::Ideal).unwrap();
                let Coefficients::F64(c) = s.coefficients() else {
                    panic!("f64 coefficients expected")
                };
                assert_eq!(s.own_bytes(), c.len() * 8);
                let scale = c.iter().fold(0.0f64, |a, v| a.max(v.abs()));
                for ijk in all_indices(dims) {
                    let mut sum = 0.0;
                    for n in 0..27usize {
                        let o = [n % 3, n / 3 % 3, n / 9];
                        let w: f64 = o.iter().map(|&o| if o == 1 { m } else { 1.0 }).product();
                        let at = [0, 1, 2].map(|a| Border::Mirror.index((ijk[a] + o[a]) as isize - 1, dims[a]));
                        sum += w * c[grid.index(at)];
                    }
                    let e = (sum / (q * q * q) - grid.sample(ijk)).abs();
                    assert!(e < 1e-14 * scale, "{kind} {dims:?} {ijk:?}: residual {e}");
                }
            }
        }
    }
}

/// Blocks along z change nothing: f32 coefficients are the f64 ones rounded once.
#[test]
fn stored_is_ideal_rounded() {
    for dims in SIZES {
        for grid in grids(dims) {
            for kind in INTERPOLATING {
                let ideal = GridSpline::new(&grid, kind, Stage::Ideal).unwrap();
                let stored = GridSpline::new(&grid, kind, Stage::Stored).unwrap();
                let (Coefficients::F64(a), Coefficients::F32(b)) = (ideal.coefficients(), stored.coefficients()) else {
                    panic!("own coefficients expected")
                };
                assert_eq!(stored.own_bytes(), b.len() * 4);
                for (a, b) in a.iter().zip(b) {
                    assert_eq!((*a as f32).to_bits(), b.to_bits());
                }
            }
        }
    }
}

#[test]
fn plain_kinds_share_the_samples() {
    let grid = common::byte_grid([5, 6, 7], 1);
    for kind in [Kind::Trilinear, Kind::Quadratic, Kind::Cubic] {
        let s = GridSpline::new(&grid, kind, Stage::Stored).unwrap();
        assert_eq!(s.own_bytes(), 0);
        let (Coefficients::Samples(Samples::U8(c)), Samples::U8(g)) = (s.coefficients(), &grid.samples) else {
            panic!("shared bytes expected")
        };
        assert!(std::sync::Arc::ptr_eq(c, g));
    }
}

/// Least and greatest over the stencils of a box of cells, beside a direct search.
#[test]
fn ranges() {
    for dims in [[2, 2, 2], [2, 3, 5], [6, 7, 5]] {
        for grid in grids(dims) {
            for kind in Kind::ALL {
                let s = GridSpline::new(&grid, kind, Stage::Stored).unwrap();
                let cells = s.cells();
                let w = kind.basis().degree + 1;
                let mut r = Random(4);
                for _ in 0..20 {
                    let lo = cells.map(|n| (r.unit() * n as f64) as usize);
                    let hi = [0, 1, 2].map(|a| lo[a] + (r.unit() * (cells[a] - lo[a]) as f64) as usize);
                    let (mut least, mut greatest) = (f64::INFINITY, f64::NEG_INFINITY);
                    let mut stencil = [0.0; 64];
                    for cell in all_indices(cells).filter(|c| (0..3).all(|a| lo[a] <= c[a] && c[a] <= hi[a])) {
                        s.stencil(cell, &mut stencil);
                        for &v in &stencil[..w * w * w] {
                            least = least.min(v);
                            greatest = greatest.max(v);
                        }
                    }
                    let range = s.range(lo, hi);
                    assert_eq!((range.lo, range.hi), (least, greatest), "{kind} {dims:?} {lo:?} {hi:?}");
                }
            }
        }
    }
}
