//! Coefficients on the device: a 3D texture in their own type, with the border rule written out around them where a stencil reaches beyond
//! the grid, so that shaders know no border.

use isobar_core::{DataError, RenderError};
use isobar_fields::{Coefficients, GridSpline};
use isobar_gpu::{Gpu, Texels, Volume};

/// Coefficients before the first and behind the last sample of each axis that the stencils of a degree reach.
pub(super) fn pad(degree: usize) -> usize {
    usize::from(degree > 1)
}

/// Uploads the coefficients slice by slice; beside them the power of two that they are multiplied by, as isovalues have to be.
pub(super) fn upload(gpu: &Gpu, spline: &GridSpline) -> Result<(Volume, f64), RenderError> {
    let texels = match spline.coefficients() {
        Coefficients::Samples(s) => Texels::Samples(s),
        Coefficients::F32(c) => Texels::F32(c),
        Coefficients::F64(_) => {
            return Err(RenderError::Data(DataError::Unknown(
                "coefficients in f64 are not drawn on the GPU".into(),
            )));
        }
    };
    let pad = pad(spline.kind().basis().degree);
    let border = spline.border();
    let outside = |i, n| border.index(i, n);
    let (texels, scale) = texels.balanced();
    Ok((
        gpu.upload_bordered("the volume", spline.grid().dims, texels, pad, outside)?,
        scale,
    ))
}
