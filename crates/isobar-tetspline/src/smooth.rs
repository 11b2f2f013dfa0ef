//! Gaussian smoothing of the samples before anything else (K23).
//!
//! Kalbe et al. 2009, Fig. 1: "VisMale and Tooth are smoothed with a Gaussian filter on the GPU. Choosing the desired isosurfaces and smoothing to an appropriate degree is an interactive process." Three
//! passes along the axes; samples outside are those of the nearest one, as everywhere in this spline. Weights are those of the continuous Gaussian at whole steps out to three
//! standard deviations, scaled to sum 1, so constants stay; sums are f64, results f32.

use isobar_core::{DataError, Grid, Samples};
use rayon::prelude::*;

/// The weights from the middle outwards.
pub(crate) fn weights(sigma: f64) -> Vec<f64> {
    let reach = (3.0 * sigma).ceil() as usize;
    let raw: Vec<f64> = (0..=reach).map(|n| (-0.5 * (n as f64 / sigma).powi(2)).exp()).collect();
    let sum = raw[0] + 2.0 * raw[1..].iter().sum::<f64>();
    raw.into_iter().map(|w| w / sum).collect()
}

/// The samples as f32, which holds all of their types.
pub(crate) fn floats(grid: &Grid) -> Vec<f32> {
    match &grid.samples {
        Samples::U8(s) => s.par_iter().map(|&v| v.into()).collect(),
        Samples::I16(s) => s.par_iter().map(|&v| v.into()).collect(),
        Samples::U16(s) => s.par_iter().map(|&v| v.into()).collect(),
        Samples::F32(s) => s.to_vec(),
    }
}

/// The grid with smoothed samples, f32; `sigma` in voxels, positive.
///
/// # Errors
/// [`DataError`] where samples are not finite.
pub(crate) fn gaussian(grid: &Grid, sigma: f64) -> Result<Grid, DataError> {
    grid.require_finite()?;
    let mut data = floats(grid);
    let weights = weights(sigma);
    let mut out = vec![0.0f32; data.len()];
    for axis in 0..3 {
        pass(&data, &mut out, grid.dims, axis, &weights);
        std::mem::swap(&mut data, &mut out);
    }
    Ok(Grid {
        samples: Samples::F32(data.into()),
        ..grid.clone()
    })
}

/// One axis. Rows along x are summed as wholes, weight by weight, so that every axis runs along memory.
fn pass(from: &[f32], to: &mut [f32], dims: [usize; 3], axis: usize, weights: &[f64]) {
    let [nx, ny, nz] = dims;
    to.par_chunks_mut(nx).enumerate().for_each_init(
        || vec![0.0f64; nx],
        |sum, (row, to)| {
            let (y, z) = (row % ny, row / ny);
            sum.fill(0.0);
            for (n, &w) in weights.iter().enumerate() {
                // The middle counts once.
                for side in 0..if n == 0 { 1 } else { 2 } {
                    let shifted = |i: usize, count: usize| {
                        if side == 0 {
                            (i + n).min(count - 1)
                        } else {
                            i.saturating_sub(n)
                        }
                    };
                    let (j, k) = match axis {
                        1 => (shifted(y, ny), z),
                        2 => (y, shifted(z, nz)),
                        _ => (y, z),
                    };
                    let source = &from[(k * ny + j) * nx..][..nx];
                    if axis == 0 {
                        for (i, s) in sum.iter_mut().enumerate() {
                            *s += w * f64::from(source[shifted(i, nx)]);
                        }
                    } else {
                        for (s, v) in sum.iter_mut().zip(source) {
                            *s += w * f64::from(*v);
                        }
                    }
                }
            }
            to.iter_mut().zip(&*sum).for_each(|(t, s)| *t = *s as f32);
        },
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A constant stays, an impulse becomes the product of the weights, and variance grows by that of the weights.
    #[test]
    fn impulses_become_gaussians() {
        let n = 25usize;
        let mut samples = vec![0u8; n * n * n];
        samples[(12 * n + 12) * n + 12] = 200;
        let grid = Grid::unit([n; 3], Samples::U8(samples.into())).unwrap();
        let sigma = 1.5;
        let smooth = gaussian(&grid, sigma).unwrap();
        let Samples::F32(s) = &smooth.samples else { panic!("f32") };
        let w = weights(sigma);
        for (z, y, x) in [(12, 12, 12), (12, 13, 9), (8, 12, 16), (12, 12, 18)] {
            let of = |i: usize| w.get(i.abs_diff(12)).copied().unwrap_or(0.0);
            let want = 200.0 * of(x) * of(y) * of(z);
            assert!((f64::from(s[(z * n + y) * n + x]) - want).abs() <= want * 1e-6, "{x} {y} {z}");
        }
        let sum: f64 = s.iter().map(|&v| f64::from(v)).sum();
        assert!((sum - 200.0).abs() < 1e-3, "{sum}");
        let variance: f64 = s
            .iter()
            .enumerate()
            .map(|(i, &v)| f64::from(v) * (i as f64 % n as f64 - 12.0).powi(2))
            .sum::<f64>()
            / sum;
        assert!((variance.sqrt() - sigma).abs() < 0.03, "{variance}");
        let flat = Grid::unit([3, 4, 2], Samples::I16(vec![-7; 24].into())).unwrap();
        let flat = gaussian(&flat, 4.0).unwrap();
        let Samples::F32(s) = &flat.samples else { panic!("f32") };
        assert!(s.iter().all(|v| (v + 7.0).abs() < 1e-6));
    }
}
