//! Gaussian smoothing of the samples on the device (K23): the twin of [`crate::smooth`], in f32.
//!
//! Kalbe et al. 2009, Fig. 1: "VisMale and Tooth are smoothed with a Gaussian filter on the GPU." The result comes back to the host once, because the function drawn is the spline of these samples, and that is what
//! checks and claims are about.

use super::programs::SNIPPETS;
use crate::smooth::{floats, weights};
use isobar_core::{Grid, RenderError, Samples};
use isobar_gpu::{Gpu, Kernel, shader};

/// The grid with smoothed samples; `sigma` in voxels, positive.
///
/// # Errors
/// [`RenderError::Data`] where samples are not finite, [`RenderError::Memory`] where they do not fit a binding, [`RenderError::Device`].
pub(super) fn gaussian(gpu: &Gpu, grid: &Grid, sigma: f64) -> Result<Grid, RenderError> {
    grid.require_finite()?;
    let samples = floats(grid);
    let weights: Vec<f32> = weights(sigma).into_iter().map(|w| w as f32).collect();
    let kernel = Kernel::new(gpu, "smoothing", &source()?, "main")?;
    let weights = gpu.storage("weights", &weights)?;
    let ping = gpu.storage("samples", &samples)?;
    let pong = gpu.storage_empty("smoothed samples", ping.size())?;
    let [nx, ny, nz] = grid.dims.map(|n| n as u32);
    let blocks = (samples.len() as u32).div_ceil(256);
    let groups = [blocks.clamp(1, 256), blocks.div_ceil(256).max(1), 1];
    for axis in 0..3u32 {
        let (from, to) = if axis == 1 { (&pong, &ping) } else { (&ping, &pong) };
        let uniform = gpu.uniform("axis", &[nx, ny, nz, axis])?;
        let bind = kernel.bind(
            gpu,
            &[
                (0, uniform.as_entire_binding()),
                (1, from.as_entire_binding()),
                (2, weights.as_entire_binding()),
                (3, to.as_entire_binding()),
            ],
        )?;
        gpu.run("smoothing", 1, |w| w.compute(&kernel, &bind, groups))?;
    }
    let smoothed: Vec<f32> = gpu.read(&pong, samples.len())?;
    Ok(Grid {
        samples: Samples::F32(smoothed.into()),
        ..grid.clone()
    })
}

/// WGSL of the kernel.
pub(super) fn source() -> Result<String, isobar_gpu::GpuError> {
    shader::compose(&[SNIPPETS], &["tet_smooth"])
}
