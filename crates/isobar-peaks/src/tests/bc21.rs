//! BC(2,1), which the oracle does not take: claims of `peaks/cpu` against exact polynomials.
//!
//! Samples are small integers, and eyes and directions such that every face of a cell has a parameter without rounding: the polynomial along the ray in a cell then has whole coefficients, worked
//! out here from the filter's matrix, and isobar-oracle gives all of its roots by integers alone.

use super::*;
use crate::{BC21, PEAKS_CPU};
use isobar_core::{Claim, Lattice, Stage};
use isobar_fields::{GridSpline, Kind};
use isobar_oracle::Root;
use isobar_oracle::univariate::{Coefficient, Form, roots};

const N: usize = 6;
/// Origins are whole multiples of 1 / FINE, directions too.
const FINE: i128 = 16;

/// Power coefficients in t, times (6 FINE^3), of the four weights of one axis where the local coordinate is (o + d t) / FINE.
fn weights(o: i128, d: i128) -> [[i128; 4]; 4] {
    let mut out = [[0; 4]; 4];
    for (j, w) in out.iter_mut().enumerate() {
        // Powers of o + d t.
        let mut power = [1, 0, 0, 0];
        for k in 0..4u32 {
            let m = i128::from(BC21.matrix[k as usize][j]) * FINE.pow(3 - k);
            for (w, p) in w.iter_mut().zip(power) {
                *w += m * p;
            }
            let mut next = [0; 4];
            for i in 0..4 {
                next[i] += o * power[i];
                if i > 0 {
                    next[i] += d * power[i - 1];
                }
            }
            power = next;
        }
    }
    out
}

fn times(a: &[i128], b: &[i128]) -> Vec<i128> {
    let mut out = vec![0; a.len() + b.len() - 1];
    for (i, x) in a.iter().enumerate() {
        for (j, y) in b.iter().enumerate() {
            out[i + j] += x * y;
        }
    }
    out
}

/// All roots of field = value / 4 along (o + d t) / FINE.
fn truth(spline: &GridSpline, value: i128, o: [i128; 3], d: [i128; 3]) -> Vec<Root> {
    let mut out: Vec<Root> = Vec::new();
    for at in 0..(N - 1).pow(3) {
        let cell = [at % (N - 1), at / (N - 1) % (N - 1), at / (N - 1).pow(2)];
        let (mut lo, mut hi) = (0.0f64, f64::INFINITY);
        for a in 0..3 {
            let faces = [0, 1].map(|k| (cell[a] as i128 + k) * FINE - o[a]);
            if d[a] == 0 {
                if faces[0] > 0 || faces[1] < 0 {
                    hi = -1.0;
                }
            } else {
                let t = faces.map(|f| f as f64 / d[a] as f64);
                lo = lo.max(t[0].min(t[1]));
                hi = hi.min(t[0].max(t[1]));
            }
        }
        if lo >= hi {
            continue;
        }
        let mut s = [0.0; 64];
        spline.stencil(cell, &mut s);
        let w: Vec<[[i128; 4]; 4]> = (0..3).map(|a| weights(o[a] - cell[a] as i128 * FINE, d[a])).collect();
        let mut sum = [0i128; 10];
        for k in 0..4 {
            for j in 0..4 {
                for i in 0..4 {
                    let c = s[(k * 4 + j) * 4 + i];
                    assert_eq!(c.fract(), 0.0, "whole coefficients");
                    let product = times(&times(&w[0][i], &w[1][j]), &w[2][k]);
                    for (sum, p) in sum.iter_mut().zip(product) {
                        *sum += 4 * c as i128 * p;
                    }
                }
            }
        }
        sum[0] -= value * (6 * FINE.pow(3)).pow(3);
        let coefficients: Vec<Coefficient> = sum.iter().map(|&c| Coefficient::new(c, 1).unwrap()).collect();
        for root in roots(Form::Power, &coefficients, lo, hi).unwrap().roots {
            // One on a face is found on both sides.
            if !out.iter().any(|r| r.lo <= root.hi && root.lo <= r.hi) {
                out.push(root);
            }
        }
    }
    out.sort_by(|a, b| a.lo.total_cmp(&b.lo));
    out
}

#[test]
fn claims_of_the_filter_with_negative_lobes_hold() {
    let mut seed = 11u32;
    let mut number = |below: u32| {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (seed >> 8) % below
    };
    let samples: Vec<f32> = (0..N * N * N).map(|_| number(10) as f32).collect();
    let grid = Grid::unit([N; 3], Samples::F32(samples.into())).unwrap();
    let spline = GridSpline::new(&grid, Kind::Cubic, Stage::Stored).unwrap();
    let data = Arc::new(Data::Grid(grid));
    // Powers of two, so that parameters of faces are not rounded.
    let direction = |n: u32| [16i128, 8, 4, -16, -8, -4, 2, 0][n as usize];
    let mut lines: Vec<([i128; 3], [i128; 3])> = Vec::new();
    while lines.len() < 300 {
        let p: [i128; 3] = std::array::from_fn(|_| i128::from(number(FINE as u32 * (N as u32 - 1))));
        let d: [i128; 3] = std::array::from_fn(|_| direction(number(8)));
        if d.iter().all(|&x| x == 0) {
            continue;
        }
        // From outside, and every third from inside.
        let back = if lines.len().is_multiple_of(3) { 0 } else { 12 };
        lines.push((std::array::from_fn(|a| p[a] - back * d[a]), d));
    }
    let rays: Vec<Ray> = (lines.iter())
        .map(|(o, d)| {
            let v = |x: &[i128; 3]| DVec3::from_array(x.map(|c| c as f64 / FINE as f64));
            Ray {
                origin: v(o),
                direction: v(d),
            }
        })
        .collect();
    const LAYERS: usize = 40;
    // 4 1/4: crossings everywhere; 6 1/4: here and there.
    for (value, least, without) in [(17, 400, 1), (25, 40, 50)] {
        let surfaces = [Surface::isovalue(value as f64 / 4.0, 0)];
        let k = [("reconstruction", "bc21"), ("mode", "peak_only")];
        let f = draw(&PEAKS_CPU, &data, &surfaces, None, &View::rays(rays.clone()), (LAYERS, &k));
        let (mut found, mut proved, mut empty) = (0, 0, 0);
        for (i, (o, d)) in lines.iter().enumerate() {
            let want = truth(&spline, value, *o, *d);
            let (t, error, claim) = (f.t[i], f.t_error[i], f.claim[i]);
            if claim.contains(Claim::EMPTY) {
                assert!(want.is_empty(), "ray {i}: {want:?}");
                empty += 1;
            }
            if claim.contains(Claim::EXISTS) {
                assert!(want.iter().any(|r| r.distance(t) <= error), "ray {i}: {t} {error} {want:?}");
            }
            if claim.contains(Claim::FIRST) {
                assert!(want.iter().all(|r| r.hi >= t - error), "ray {i}: {t} {error} {want:?}");
            }
            proved += usize::from(!claim.is_empty());
            let hits: Vec<f64> = (0..LAYERS)
                .map(|l| f.t[l * rays.len() + i])
                .filter(|t| t.is_finite())
                .collect();
            assert_eq!(
                (hits.len(), usize::from(f.hits[i])),
                (want.len(), want.len()),
                "ray {i}: {hits:?} {want:?}"
            );
            for (hit, root) in hits.iter().zip(&want) {
                assert!(root.distance(*hit) < 1e-8, "ray {i}: {hit} {root:?}");
            }
            found += hits.len();
        }
        assert!(
            found >= least && empty >= without,
            "{value}: {found} crossings, {empty} empty"
        );
        assert!(proved + 3 >= lines.len(), "{value}: {proved} of {}", lines.len());
    }
}
