//! Coefficients on the device: a 3D texture in their own type, floats times a power of two where f32 would not hold what is made of them, read by explicit loads.

use super::INFO;
use super::bricks::Bricks;
use super::layout::{MIRROR, Params};
use super::programs::Kernels;
use bytemuck::Zeroable;
use isobar_core::{Data, DataError, Lattice as _, RenderError, Stage};
use isobar_cpu::scene::grid;
use isobar_fields::{Border, Coefficients, GridSpline, Kind};
use isobar_gpu::rays::ToIndex;
use isobar_gpu::{Gpu, Texel, Texels, Volume};
use std::sync::Arc;

/// What is built for the data.
#[derive(Debug)]
pub(super) struct Prepared {
    pub(super) data: Arc<Data>,
    pub(super) spline: GridSpline,
    pub(super) volume: Volume,
    pub(super) bricks: Bricks,
    pub(super) to_index: ToIndex,
    /// Coefficients on the device are those of the spline times this power of two, and isovalues have to be.
    pub(super) scale: f64,
    /// What depends on the data only; the rest is filled in by `render`.
    pub(super) params: Params,
}

/// The texel type of the coefficients of a reconstruction, without a copy or rounding.
pub(super) fn texel(data: &Data, kind: Kind) -> Result<Texel, RenderError> {
    let samples = &grid(&INFO, data)?.samples;
    Ok(if kind.interpolates() { Texel::F32 } else { Texel::of(samples) })
}

impl Prepared {
    /// Prefilters where the kind interpolates, uploads, builds bricks.
    pub(super) fn new(gpu: &Gpu, kernels: &Kernels, data: &Arc<Data>, kind: Kind) -> Result<Self, RenderError> {
        let grid = grid(&INFO, data)?;
        let spline = GridSpline::new(grid, kind, Stage::Stored)?;
        let texels = match spline.coefficients() {
            Coefficients::Samples(s) => Texels::Samples(s),
            Coefficients::F32(c) => Texels::F32(c),
            Coefficients::F64(_) => {
                return Err(DataError::Unknown("coefficients in f64 are not drawn on the GPU".into()).into());
            }
        };
        let (texels, scale) = texels.balanced();
        // The kernels know the border.
        let volume = gpu.upload_bordered("the volume", grid.dims, texels, 0, |i, _| i as usize)?;
        let to_index = ToIndex::new(&grid.domain(), kind.basis().centred);
        let mut params = Params::zeroed();
        // Sides of a texture fit u32.
        params.cells = spline.cells().map(|n| n as u32);
        params.nodes = params.cells.map(|n| n.div_ceil(16));
        params.last = grid.dims.map(|n| n as i32 - 1);
        params.flags = if kind.border() == Border::Mirror { MIRROR } else { 0 };
        params.axes = to_index.axes();
        params.gradients = to_index.gradients();
        let bricks = Bricks::new(gpu, kernels, &volume, &params)?;
        Ok(Self {
            data: Arc::clone(data),
            spline,
            volume,
            bricks,
            to_index,
            scale,
            params,
        })
    }
}
