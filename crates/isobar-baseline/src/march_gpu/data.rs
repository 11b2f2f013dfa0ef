//! Coefficients on the device: a 3D texture in their own type, with the border rule written out around them where a stencil reaches beyond
//! the grid, so that shaders know no border.

use isobar_core::{DataError, RenderError, Samples};
use isobar_fields::{Border, Coefficients, GridSpline};
use isobar_gpu::{Gpu, GpuError, Texel, Volume};

/// Coefficients before the first and behind the last sample of each axis that the stencils of a degree reach.
pub(super) fn pad(degree: usize) -> usize {
    usize::from(degree > 1)
}

/// The texel type of the coefficients of a spline, without a copy or rounding.
pub(super) fn texel(spline: &GridSpline) -> Texel {
    match spline.coefficients() {
        Coefficients::Samples(s) => Texel::of(s),
        Coefficients::F32(_) | Coefficients::F64(_) => Texel::F32,
    }
}

/// Uploads the coefficients slice by slice.
pub(super) fn upload(gpu: &Gpu, spline: &GridSpline) -> Result<Volume, RenderError> {
    let pad = pad(spline.kind().basis().degree);
    let dims = spline.grid().dims;
    let volume = gpu.volume("the volume", dims.map(|n| n + 2 * pad), texel(spline))?;
    let border = spline.border();
    match spline.coefficients() {
        Coefficients::Samples(Samples::U8(c)) => write(gpu, &volume, c, dims, pad, border),
        Coefficients::Samples(Samples::I16(c)) => write(gpu, &volume, c, dims, pad, border),
        Coefficients::Samples(Samples::U16(c)) => write(gpu, &volume, c, dims, pad, border),
        Coefficients::Samples(Samples::F32(c)) => write(gpu, &volume, c, dims, pad, border),
        Coefficients::F32(c) => write(gpu, &volume, c, dims, pad, border),
        Coefficients::F64(_) => {
            return Err(RenderError::Data(DataError::Unknown(
                "coefficients in f64 are not drawn on the GPU".into(),
            )));
        }
    }?;
    Ok(volume)
}

fn write<T: bytemuck::Pod>(
    gpu: &Gpu,
    volume: &Volume,
    c: &[T],
    [nx, ny, nz]: [usize; 3],
    pad: usize,
    border: Border,
) -> Result<(), GpuError> {
    if pad == 0 {
        return gpu.write_slices(volume, c.chunks_exact(nx * ny).map(bytemuck::cast_slice::<T, u8>));
    }
    let outside = |i: usize, n: usize| border.index(i as isize - pad as isize, n);
    let columns: Vec<usize> = (0..nx + 2 * pad).map(|i| outside(i, nx)).collect();
    let slices = (0..nz + 2 * pad).map(|k| {
        let slice = &c[outside(k, nz) * nx * ny..][..nx * ny];
        let mut padded = Vec::with_capacity((nx + 2 * pad) * (ny + 2 * pad) * size_of::<T>());
        for j in 0..ny + 2 * pad {
            let row = &slice[outside(j, ny) * nx..][..nx];
            for &i in &columns[..pad] {
                padded.extend_from_slice(bytemuck::bytes_of(&row[i]));
            }
            padded.extend_from_slice(bytemuck::cast_slice(row));
            for &i in &columns[nx + pad..] {
                padded.extend_from_slice(bytemuck::bytes_of(&row[i]));
            }
        }
        padded
    });
    gpu.write_slices(volume, slices)
}
