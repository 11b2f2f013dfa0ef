//! 3D textures of samples in a type that holds them exactly.

use crate::{Gpu, GpuError};
use isobar_core::Samples;
use rayon::prelude::*;
use std::borrow::Cow;

/// The texel type of a [`Volume`]: each holds its samples exactly, and turns into f32 exactly.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Texel {
    /// Unsigned bytes (`r8uint`, WGSL `texture_3d<u32>`).
    U8,
    /// Unsigned 16 bits (`r16uint`, `texture_3d<u32>`).
    U16,
    /// Signed 16 bits (`r16sint`, `texture_3d<i32>`).
    I16,
    /// 32-bit floats (`r32float`, `texture_3d<f32>`).
    F32,
}

impl Texel {
    /// The type that keeps these samples.
    #[must_use]
    pub const fn of(samples: &Samples) -> Self {
        match samples {
            Samples::U8(_) => Self::U8,
            Samples::U16(_) => Self::U16,
            Samples::I16(_) => Self::I16,
            Samples::F32(_) => Self::F32,
        }
    }

    /// Bytes of a texel.
    #[must_use]
    pub const fn bytes(self) -> u64 {
        match self {
            Self::U8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::F32 => 4,
        }
    }

    /// The shader snippet that declares `volume` and `fn texel(p: vec3<i32>) -> f32`; see [`crate::shader::SHARED`].
    #[must_use]
    pub const fn snippet(self) -> &'static str {
        match self {
            Self::U8 | Self::U16 => "volume_u32",
            Self::I16 => "volume_i32",
            Self::F32 => "volume_f32",
        }
    }

    /// The texture format.
    #[must_use]
    pub const fn format(self) -> wgpu::TextureFormat {
        match self {
            Self::U8 => wgpu::TextureFormat::R8Uint,
            Self::U16 => wgpu::TextureFormat::R16Uint,
            Self::I16 => wgpu::TextureFormat::R16Sint,
            Self::F32 => wgpu::TextureFormat::R32Float,
        }
    }
}

/// What is uploaded, x fastest.
#[derive(Debug, Clone, Copy)]
pub enum Texels<'a> {
    /// Samples, in their own type.
    Samples(&'a Samples),
    /// Coefficients in f32.
    F32(&'a [f32]),
    /// Coefficients in f32 times a power of two: see [`Texels::balanced`].
    Scaled(&'a [f32], f64),
}

/// The exponent of a number that is not 0: the number is below 2^(e + 1) and not below 2^e.
fn exponent(v: f32) -> i32 {
    ((f64::from(v).to_bits() >> 52) & 0x7ff) as i32 - 1023
}

/// 2^e for |e| below 1023.
fn power(e: i32) -> f64 {
    f64::from_bits(((1023 + e) as u64) << 52)
}

impl<'a> Texels<'a> {
    /// The same texels times a power of two, and that power: kernels compute in f32, where polynomials and products of coefficients near 3.4e38 overflow and coefficients near
    /// 1.2e-38 or below it vanish. 1, and nothing is done, for integers and where every magnitude but 0 lies between 2^-40 and 2^41; else the greatest comes to lie between
    /// 2^30 and 2^31. The product is exact but for what lies below 2^-157 of the greatest. Isovalues are to be multiplied by the same number; roots, signs, normals and their
    /// order do not change.
    #[must_use]
    pub fn balanced(self) -> (Self, f64) {
        /// Exponents of what is left as it is.
        const USUAL: std::ops::RangeInclusive<i32> = -40..=40;
        /// Exponent of the greatest magnitude: cubes of it are far from overflow.
        const TOP: i32 = 30;
        let values = match self {
            Self::Samples(Samples::F32(s)) => s,
            Self::F32(s) => s,
            _ => return (self, 1.0),
        };
        let extremes = |part: &[f32]| {
            part.iter().fold((f32::INFINITY, 0.0f32), |(lo, hi), v| {
                let v = v.abs();
                (if v > 0.0 { lo.min(v) } else { lo }, hi.max(v))
            })
        };
        let (lo, hi) = values
            .par_chunks(1 << 16)
            .map(extremes)
            .reduce(|| (f32::INFINITY, 0.0), |a, b| (a.0.min(b.0), a.1.max(b.1)));
        if hi == 0.0 || (USUAL.contains(&exponent(hi)) && USUAL.contains(&exponent(lo))) {
            return (self, 1.0);
        }
        let by = power(TOP - exponent(hi));
        (Self::Scaled(values, by), by)
    }

    /// Their type.
    #[must_use]
    pub const fn texel(self) -> Texel {
        match self {
            Self::Samples(s) => Texel::of(s),
            Self::F32(_) | Self::Scaled(..) => Texel::F32,
        }
    }

    /// Number of texels.
    fn count(self) -> usize {
        match self {
            Self::Samples(s) => s.len(),
            Self::F32(s) | Self::Scaled(s, _) => s.len(),
        }
    }

    /// The bytes of `count` texels from `first` on, as the texture holds them.
    ///
    /// # Panics
    /// When there are not as many.
    #[must_use]
    pub fn bytes(self, first: usize, count: usize) -> Cow<'a, [u8]> {
        let range = first..first + count;
        match self {
            Self::Samples(s) => Cow::Borrowed(match s {
                Samples::U8(s) => &s[range],
                Samples::U16(s) => bytemuck::cast_slice(&s[range]),
                Samples::I16(s) => bytemuck::cast_slice(&s[range]),
                Samples::F32(s) => bytemuck::cast_slice(&s[range]),
            }),
            Self::F32(s) => Cow::Borrowed(bytemuck::cast_slice(&s[range])),
            Self::Scaled(s, by) => {
                let scaled = s[range].iter().flat_map(|v| ((f64::from(*v) * by) as f32).to_ne_bytes());
                Cow::Owned(scaled.collect())
            }
        }
    }
}

/// Samples on the device as a 3D texture, x fastest, read by explicit loads.
#[derive(Debug, Clone)]
pub struct Volume {
    view: wgpu::TextureView,
    texel: Texel,
    dims: [u32; 3],
}

impl Volume {
    /// For bind groups.
    #[must_use]
    pub const fn view(&self) -> &wgpu::TextureView {
        &self.view
    }

    /// Texel type.
    #[must_use]
    pub const fn texel(&self) -> Texel {
        self.texel
    }

    /// Texels per axis.
    #[must_use]
    pub const fn dims(&self) -> [u32; 3] {
        self.dims
    }

    /// Device bytes of the texels.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        self.dims.iter().map(|&d| u64::from(d)).product::<u64>() * self.texel.bytes()
    }
}

impl Gpu {
    /// An uninitialised (zero) volume, to be filled slice by slice with [`Gpu::write_slice`].
    ///
    /// # Errors
    /// [`GpuError::Size`] beyond the device's longest 3D texture side, [`GpuError::Memory`] when it is out of memory; as
    /// [`Gpu::guard`].
    pub fn volume(&self, what: &str, dims: [usize; 3], texel: Texel) -> Result<Volume, GpuError> {
        let limit = self.report().max_texture_3d;
        let longest = dims.iter().copied().max().unwrap_or(0);
        if longest > limit as usize {
            return Err(GpuError::Size {
                what: what.to_owned(),
                size: longest as u64,
                limit: u64::from(limit),
            });
        }
        // Each side fits u32 now. wgpu refuses empty sides.
        let dims = dims.map(|d| d as u32);
        let bytes = dims.iter().map(|&d| u64::from(d)).product::<u64>() * texel.bytes();
        let view = self.guard(what, bytes, || {
            self.device()
                .create_texture(&wgpu::TextureDescriptor {
                    label: Some(what),
                    size: extent(dims),
                    mip_level_count: 1,
                    sample_count: 1,
                    dimension: wgpu::TextureDimension::D3,
                    format: texel.format(),
                    usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST | wgpu::TextureUsages::COPY_SRC,
                    view_formats: &[],
                })
                .create_view(&wgpu::TextureViewDescriptor::default())
        })?;
        Ok(Volume { view, texel, dims })
    }

    /// Writes the slice z of a volume: `nx * ny` texels of its type, x fastest, tightly packed.
    ///
    /// # Errors
    /// [`GpuError::Refused`] where z or the number of bytes does not fit; as [`Gpu::guard`].
    pub fn write_slice(&self, volume: &Volume, z: u32, texels: &[u8]) -> Result<(), GpuError> {
        let [nx, ny, _] = volume.dims;
        let row = nx * volume.texel.bytes() as u32;
        self.guard("writing a slice", texels.len() as u64, || {
            self.queue().write_texture(
                wgpu::TexelCopyTextureInfo {
                    texture: volume.view.texture(),
                    mip_level: 0,
                    origin: wgpu::Origin3d { x: 0, y: 0, z },
                    aspect: wgpu::TextureAspect::All,
                },
                texels,
                wgpu::TexelCopyBufferLayout {
                    offset: 0,
                    bytes_per_row: Some(row),
                    rows_per_image: Some(ny),
                },
                extent([nx, ny, 1]),
            );
        })
    }

    /// Uploads samples with `dims` of them per axis in their own type. Staging memory is freed slice by slice.
    ///
    /// # Errors
    /// As [`Gpu::volume`] and [`Gpu::write_slice`].
    ///
    /// # Panics
    /// When the samples are not as many as `dims` says.
    pub fn upload(&self, what: &str, dims: [usize; 3], samples: &Samples) -> Result<Volume, GpuError> {
        self.upload_bordered(what, dims, Texels::Samples(samples), 0, |i, _| i as usize)
    }

    /// [`Gpu::upload`] of samples or coefficients, with `pad` texels more on every side of each axis, so that shaders know no border: texel -1, for one, is that of index
    /// `outside(-1, n)`, which lies in `0..n`.
    ///
    /// # Errors
    /// As [`Gpu::upload`].
    ///
    /// # Panics
    /// When the texels are not as many as `dims` says, or `outside` gives an index beyond them.
    pub fn upload_bordered(
        &self,
        what: &str,
        dims: [usize; 3],
        texels: Texels<'_>,
        pad: usize,
        outside: impl Fn(isize, usize) -> usize,
    ) -> Result<Volume, GpuError> {
        let (texel, [nx, ny, nz]) = (texels.texel(), dims);
        let size = texel.bytes() as usize;
        assert_eq!(
            texels.count(),
            dims.iter().product::<usize>(),
            "texels match their dimensions"
        );
        let volume = self.volume(what, dims.map(|n| n + 2 * pad), texel)?;
        let slice = |z: usize| texels.bytes(z * nx * ny, nx * ny);
        if pad == 0 {
            self.write_slices(&volume, (0..nz).map(slice))?;
            return Ok(volume);
        }
        let index = |i: usize, n: usize| outside(i as isize - pad as isize, n);
        let columns: Vec<usize> = (0..nx + 2 * pad).map(|i| index(i, nx)).collect();
        let slices = (0..nz + 2 * pad).map(|k| {
            let slice = slice(index(k, nz));
            let mut padded = Vec::with_capacity((nx + 2 * pad) * (ny + 2 * pad) * size);
            for j in 0..ny + 2 * pad {
                let row = &slice[index(j, ny) * nx * size..][..nx * size];
                for &i in &columns[..pad] {
                    padded.extend_from_slice(&row[i * size..][..size]);
                }
                padded.extend_from_slice(row);
                for &i in &columns[nx + pad..] {
                    padded.extend_from_slice(&row[i * size..][..size]);
                }
            }
            padded
        });
        self.write_slices(&volume, slices)?;
        Ok(volume)
    }

    /// Writes slices 0, 1, ... in order; waits now and then so that staging memory stays small.
    ///
    /// # Errors
    /// As [`Gpu::write_slice`].
    pub fn write_slices<S: AsRef<[u8]>>(&self, volume: &Volume, slices: impl IntoIterator<Item = S>) -> Result<(), GpuError> {
        /// Bytes staged before they are flushed to the texture.
        const STAGED: usize = 32 << 20;
        let mut staged = 0;
        for (z, slice) in (0u32..).zip(slices) {
            let slice = slice.as_ref();
            self.write_slice(volume, z, slice)?;
            staged += slice.len();
            if staged >= STAGED {
                self.flush()?;
                staged = 0;
            }
        }
        self.flush()
    }

    /// Submits pending writes and waits for them.
    fn flush(&self) -> Result<(), GpuError> {
        self.guard("writing", 0, || self.queue().submit([]))?;
        self.wait()
    }
}

const fn extent(dims: [u32; 3]) -> wgpu::Extent3d {
    wgpu::Extent3d {
        width: dims[0],
        height: dims[1],
        depth_or_array_layers: dims[2],
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Kernel, shader, test_adapter};

    /// All texels as a shader sees them, x fastest.
    fn texels(gpu: &Gpu, volume: &Volume) -> Vec<f32> {
        const READ: &str = "
            @group(0) @binding(1) var<storage, read_write> out: array<f32>;
            @compute @workgroup_size(64)
            fn main(@builtin(global_invocation_id) id: vec3<u32>) {
                let n = textureDimensions(volume);
                if id.x < n.x * n.y * n.z {
                    out[id.x] = texel(vec3<i32>(vec3(id.x % n.x, id.x / n.x % n.y, id.x / (n.x * n.y))));
                }
            }";
        let source = shader::compose(&[shader::SHARED, &[("read", READ)]], &[volume.texel().snippet(), "read"]).unwrap();
        let kernel = Kernel::new(gpu, "read texels", &source, "main").unwrap();
        let count: usize = volume.dims().iter().map(|&d| d as usize).product();
        let out = gpu.storage_empty("out", count as u64 * 4).unwrap();
        let bind = kernel
            .bind(
                gpu,
                &[
                    (0, wgpu::BindingResource::TextureView(volume.view())),
                    (1, out.as_entire_binding()),
                ],
            )
            .unwrap();
        gpu.run("read", 0, |w| w.compute(&kernel, &bind, [(count as u32).div_ceil(64), 1, 1]))
            .unwrap();
        gpu.read(&out, count).unwrap()
    }

    #[test]
    fn every_sample_type_arrives_exactly() {
        let Some(gpu) = test_adapter("every_sample_type_arrives_exactly") else {
            return;
        };
        let dims = [5, 3, 4];
        let n = 60u16;
        let all = [
            Samples::U8((0..n).map(|i| (i * 4 + 15) as u8).collect()),
            Samples::U16((0..n).map(|i| 65535 - i * 7).collect()),
            Samples::I16((0..i32::from(n)).map(|i| (i * 1000 - 32768) as i16).collect()),
            Samples::F32((0..n).map(|i| f32::from(i).mul_add(1e-7, 1.0)).collect()),
        ];
        for samples in &all {
            let v = gpu.upload("samples", dims, samples).unwrap();
            let want: Vec<f32> = (0..60).map(|i| samples.get(i) as f32).collect();
            assert_eq!(texels(&gpu, &v), want, "{}", samples.type_name());
            assert_eq!(v.bytes(), samples.bytes() as u64);
        }
    }

    #[test]
    fn floats_beyond_the_middle_of_their_range_are_scaled_exactly() {
        let usual = [1e-12f32, -3.0, 0.0, 1e12];
        assert!(matches!(Texels::F32(&usual).balanced(), (Texels::F32(_), by) if by == 1.0));
        assert_eq!(Texels::F32(&[0.0; 3]).balanced().1, 1.0);
        assert_eq!(Texels::Samples(&Samples::U8(vec![255u8].into())).balanced().1, 1.0);
        for values in [[f32::MAX, -1e37, 3e30], [1e-45, -3e-44, 0.0], [1.0, 1e-40, -0.75]] {
            let (texels, by) = Texels::F32(&values).balanced();
            let bytes = texels.bytes(0, 3);
            let scaled: &[f32] = &bytemuck::pod_collect_to_vec(&bytes);
            let most = scaled.iter().fold(0.0f32, |m, v| m.max(v.abs()));
            assert!((2f32.powi(30)..2f32.powi(31)).contains(&most), "{values:?}: {most}");
            for (v, s) in values.iter().zip(scaled) {
                assert_eq!(f64::from(*s) / by, f64::from(*v));
                assert!(*s == 0.0 || s.is_normal());
            }
            assert_eq!(texels.bytes(1, 1)[..], bytes[4..8]);
        }
    }

    #[test]
    fn borders_are_written_out() {
        let Some(gpu) = test_adapter("borders_are_written_out") else {
            return;
        };
        let (dims, pad) = ([3usize, 2, 2], 1);
        let samples: Vec<f32> = (0..12).map(|i| i as f32).collect();
        // The border of this test goes round.
        let round = |i: isize, n: usize| i.rem_euclid(n as isize) as usize;
        let v = gpu
            .upload_bordered("samples", dims, Texels::F32(&samples), pad, round)
            .unwrap();
        let [nx, ny, nz] = dims.map(|n| n + 2);
        let at = |i: usize, n: usize| (i + n - 1) % n;
        let want: Vec<f32> = (0..nx * ny * nz)
            .map(|i| (i % nx, i / nx % ny, i / nx / ny))
            .map(|(x, y, z)| samples[(at(z, dims[2]) * dims[1] + at(y, dims[1])) * dims[0] + at(x, dims[0])])
            .collect();
        assert_eq!(texels(&gpu, &v), want);
    }

    #[test]
    fn sizes_beyond_the_device_are_refused() {
        let Some(gpu) = test_adapter("sizes_beyond_the_device_are_refused") else {
            return;
        };
        let long = gpu.report().max_texture_3d as usize + 1;
        assert!(matches!(
            gpu.volume("long", [long, 1, 1], Texel::U8),
            Err(GpuError::Size { size, .. }) if size == long as u64
        ));
        assert!(matches!(
            gpu.volume("empty", [4, 0, 4], Texel::U8),
            Err(GpuError::Refused { .. })
        ));
        let v = gpu.volume("small", [4, 4, 4], Texel::U8).unwrap();
        assert!(gpu.write_slice(&v, 4, &[0; 16]).is_err());
        assert!(gpu.write_slice(&v, 0, &[0; 15]).is_err());
        gpu.check().unwrap();
    }
}
