//! Data on the device: a 3D texture in their own type, read by explicit loads.

use super::INFO;
use super::settings::Settings;
use super::smooth::gaussian;
use isobar_core::{DVec3, Data, DataError, Domain, RenderError, Stage, Tetrahedral as _};
use isobar_cpu::scene::grid;
use isobar_fields::{Coefficients, Type6Spline};
use isobar_gpu::rays::ToIndex;
use isobar_gpu::{Gpu, Texels, Volume};
use std::sync::Arc;

/// What is made of the data.
#[derive(Debug)]
pub(super) struct Prepared {
    /// As given.
    pub(super) data: Arc<Data>,
    /// As drawn: smoothed where that is asked for.
    pub(super) drawn: Arc<Data>,
    pub(super) smooth: f64,
    pub(super) spline: Type6Spline,
    pub(super) volume: Volume,
    pub(super) to_index: ToIndex,
    pub(super) domain: Domain,
    /// Least and greatest datum.
    pub(super) range: (f64, f64),
    /// Data on the device are those of the spline times this power of two, and isovalues have to be.
    pub(super) scale: f64,
    pub(super) prefiltered: bool,
}

impl Prepared {
    /// Filters where asked for, and uploads; into the texture of `old` where it fits, so that a time step costs no allocation (K25).
    pub(super) fn new(gpu: &Gpu, data: &Arc<Data>, settings: &Settings, old: Option<&Self>) -> Result<Self, RenderError> {
        let (prefiltered, smooth) = (settings.prefiltered, settings.smooth);
        let given = grid(&INFO, data)?;
        let drawn = if smooth > 0.0 {
            Arc::new(Data::Grid(gaussian(gpu, given, smooth)?))
        } else {
            Arc::clone(data)
        };
        let grid = grid(&INFO, &drawn)?;
        let dims = grid.dims;
        let spline = if prefiltered {
            Type6Spline::prefiltered(grid, Stage::Stored)?
        } else {
            Type6Spline::new(grid)?
        };
        let cubes: u128 = dims.iter().map(|&n| n as u128).product();
        if cubes > u128::from(u32::MAX) {
            // The paper's index i + j n + k n^2 has 32 bits.
            return Err(RenderError::Memory {
                what: "the indices of cubes, at most 2^32".into(),
                bytes: u64::try_from(cubes * 4).unwrap_or(u64::MAX),
                limit: u64::from(u32::MAX) * 4,
            });
        }
        let range = spline.range([0; 3], dims);
        let texels = match spline.coefficients() {
            Coefficients::Samples(s) => Texels::Samples(s),
            Coefficients::F32(s) => Texels::F32(s),
            Coefficients::F64(_) => return Err(DataError::Unknown("data in f64 are not drawn on the GPU".into()).into()),
        };
        let (texels, scale) = texels.balanced();
        let texel = texels.texel();
        let same = old.filter(|o| o.volume.texel() == texel && o.volume.dims().map(|n| n as usize) == dims);
        let volume = match same {
            Some(o) => o.volume.clone(),
            None => gpu.volume("the volume", dims, texel)?,
        };
        let slice = dims[0] * dims[1];
        gpu.write_slices(&volume, (0..dims[2]).map(|z| texels.bytes(z * slice, slice)))?;
        let domain = grid.domain();
        Ok(Self {
            data: Arc::clone(data),
            smooth,
            volume,
            to_index: ToIndex::new(&domain, true),
            domain,
            range: (range.lo, range.hi),
            scale,
            prefiltered,
            spline,
            drawn,
        })
    }

    /// Samples per axis, which are cubes too.
    pub(super) fn dims(&self) -> [u32; 3] {
        self.volume.dims()
    }

    pub(super) fn mirrored(&self) -> bool {
        let a = self.domain.axes;
        DVec3::cross(a.x_axis, a.y_axis).dot(a.z_axis) < 0.0
    }
}
