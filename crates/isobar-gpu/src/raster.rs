//! Rasterisation off screen: a target with colour and depth, a pipeline, and reading both back.

use crate::work::bind_group;
use crate::{Gpu, GpuError};

/// Depth buffers hold f32, so that they can be read back exactly.
const DEPTH: wgpu::TextureFormat = wgpu::TextureFormat::Depth32Float;

/// An off-screen image with a depth buffer.
#[derive(Debug)]
pub struct Target {
    colour: wgpu::TextureView,
    depth: wgpu::TextureView,
    width: u32,
    height: u32,
    format: wgpu::TextureFormat,
}

impl Target {
    /// A target of `width * height` pixels, with colour in `format` and a 32-bit float depth buffer.
    ///
    /// # Errors
    /// [`GpuError::Size`] beyond the device's longest 2D side; [`GpuError::Refused`] for an empty image or a format that cannot be
    /// drawn to; as [`Gpu::guard`].
    pub fn new(gpu: &Gpu, width: usize, height: usize, format: wgpu::TextureFormat) -> Result<Self, GpuError> {
        let limit = gpu.report().max_texture_2d;
        let longest = width.max(height);
        if longest > limit as usize {
            return Err(GpuError::Size {
                what: "an image".into(),
                size: longest as u64,
                limit: u64::from(limit),
            });
        }
        let (width, height) = (width as u32, height as u32);
        let texel = u64::from(format.block_copy_size(None).unwrap_or(16)) + 4;
        let texture = |format| {
            gpu.device()
                .create_texture(&wgpu::TextureDescriptor {
                    label: Some("target"),
                    size: wgpu::Extent3d {
                        width,
                        height,
                        depth_or_array_layers: 1,
                    },
                    mip_level_count: 1,
                    sample_count: 1,
                    dimension: wgpu::TextureDimension::D2,
                    format,
                    usage: wgpu::TextureUsages::RENDER_ATTACHMENT
                        | wgpu::TextureUsages::TEXTURE_BINDING
                        | wgpu::TextureUsages::COPY_SRC,
                    view_formats: &[],
                })
                .create_view(&wgpu::TextureViewDescriptor::default())
        };
        let bytes = u64::from(width) * u64::from(height) * texel;
        let (colour, depth) = gpu.guard("an image", bytes, || (texture(format), texture(DEPTH)))?;
        Ok(Self {
            colour,
            depth,
            width,
            height,
            format,
        })
    }

    /// The colour attachment.
    #[must_use]
    pub const fn colour(&self) -> &wgpu::TextureView {
        &self.colour
    }

    /// The depth attachment.
    #[must_use]
    pub const fn depth(&self) -> &wgpu::TextureView {
        &self.depth
    }

    /// The bytes of the colour image, row by row from the top, tightly packed.
    ///
    /// # Errors
    /// As [`Gpu::read_bytes`].
    pub fn read_colour(&self, gpu: &Gpu) -> Result<Vec<u8>, GpuError> {
        let texel = self.format.block_copy_size(None).unwrap_or(4);
        self.read(gpu, &self.colour, wgpu::TextureAspect::All, texel)
    }

    /// The depth image, row by row from the top.
    ///
    /// # Errors
    /// As [`Gpu::read_bytes`].
    pub fn read_depth(&self, gpu: &Gpu) -> Result<Vec<f32>, GpuError> {
        self.read(gpu, &self.depth, wgpu::TextureAspect::DepthOnly, 4)
            .map(|b| bytemuck::pod_collect_to_vec(&b))
    }

    fn read(&self, gpu: &Gpu, view: &wgpu::TextureView, aspect: wgpu::TextureAspect, texel: u32) -> Result<Vec<u8>, GpuError> {
        let row = self.width * texel;
        let padded = row.next_multiple_of(wgpu::COPY_BYTES_PER_ROW_ALIGNMENT);
        let size = u64::from(padded) * u64::from(self.height);
        let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        let staging = gpu.buffer("reading an image", size, gpu.report().max_buffer, usage)?;
        gpu.run("reading an image", 0, |w| {
            w.encoder().copy_texture_to_buffer(
                wgpu::TexelCopyTextureInfo {
                    texture: view.texture(),
                    mip_level: 0,
                    origin: wgpu::Origin3d::ZERO,
                    aspect,
                },
                wgpu::TexelCopyBufferInfo {
                    buffer: &staging,
                    layout: wgpu::TexelCopyBufferLayout {
                        offset: 0,
                        bytes_per_row: Some(padded),
                        rows_per_image: None,
                    },
                },
                view.texture().size(),
            );
        })?;
        gpu.map(&staging, size, |bytes| {
            bytes
                .chunks_exact(padded as usize)
                .flat_map(|r| &r[..row as usize])
                .copied()
                .collect()
        })
    }
}

/// How triangles reach the target.
#[derive(Debug, Clone)]
pub struct RasterOptions<'a> {
    /// Vertex entry point.
    pub vertex: &'a str,
    /// Fragment entry point, with one output.
    pub fragment: &'a str,
    /// Vertex buffers by slot.
    pub buffers: &'a [Option<wgpu::VertexBufferLayout<'a>>],
    /// Primitives, culling.
    pub primitive: wgpu::PrimitiveState,
    /// Which fragments are kept; `Always` and no write: no depth test.
    pub depth_compare: wgpu::CompareFunction,
    /// Whether kept fragments change the depth.
    pub depth_write: bool,
    /// Blending; `None` replaces.
    pub blend: Option<wgpu::BlendState>,
}

impl Default for RasterOptions<'_> {
    /// Entry points `vs` and `fs`, triangles without culling, nearest kept, no blending.
    fn default() -> Self {
        Self {
            vertex: "vs",
            fragment: "fs",
            buffers: &[],
            primitive: wgpu::PrimitiveState::default(),
            depth_compare: wgpu::CompareFunction::Less,
            depth_write: true,
            blend: None,
        }
    }
}

/// A render pipeline for [`Target`]s of one colour format.
#[derive(Debug, Clone)]
pub struct Raster {
    pipeline: wgpu::RenderPipeline,
}

impl Raster {
    /// Compiles a WGSL module.
    ///
    /// # Errors
    /// [`GpuError::Refused`] where the module or the options are wrong; as [`Gpu::guard`].
    pub fn new(
        gpu: &Gpu,
        what: &str,
        source: &str,
        format: wgpu::TextureFormat,
        options: &RasterOptions<'_>,
    ) -> Result<Self, GpuError> {
        gpu.guard(what, 0, || {
            let module = gpu.device().create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(what),
                source: wgpu::ShaderSource::Wgsl(source.into()),
            });
            let pipeline = gpu.device().create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                label: Some(what),
                layout: None,
                vertex: wgpu::VertexState {
                    module: &module,
                    entry_point: Some(options.vertex),
                    compilation_options: wgpu::PipelineCompilationOptions::default(),
                    buffers: options.buffers,
                },
                primitive: options.primitive,
                depth_stencil: Some(wgpu::DepthStencilState {
                    format: DEPTH,
                    depth_write_enabled: Some(options.depth_write),
                    depth_compare: Some(options.depth_compare),
                    stencil: wgpu::StencilState::default(),
                    bias: wgpu::DepthBiasState::default(),
                }),
                multisample: wgpu::MultisampleState::default(),
                fragment: Some(wgpu::FragmentState {
                    module: &module,
                    entry_point: Some(options.fragment),
                    compilation_options: wgpu::PipelineCompilationOptions::default(),
                    targets: &[Some(wgpu::ColorTargetState {
                        format,
                        blend: options.blend,
                        write_mask: wgpu::ColorWrites::ALL,
                    })],
                }),
                multiview_mask: None,
                cache: None,
            });
            Self { pipeline }
        })
    }

    /// The pipeline, for `set_pipeline` inside [`crate::Work::raster`].
    #[must_use]
    pub const fn pipeline(&self) -> &wgpu::RenderPipeline {
        &self.pipeline
    }

    /// The resources of group 0, by binding.
    ///
    /// # Errors
    /// [`GpuError::Refused`] where they are not those of the shader; as [`Gpu::guard`].
    pub fn bind(&self, gpu: &Gpu, resources: &[(u32, wgpu::BindingResource<'_>)]) -> Result<wgpu::BindGroup, GpuError> {
        let layout = gpu.guard("binding resources", 0, || self.pipeline.get_bind_group_layout(0))?;
        bind_group(gpu, &layout, resources)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_adapter;

    /// Vertices from a storage buffer: xyz in clip space, colour by instance.
    const TRIANGLES: &str = "
        @group(0) @binding(0) var<storage, read> corners: array<vec4<f32>>;
        struct Out { @builtin(position) position: vec4<f32>, @location(0) @interpolate(flat) instance: u32 }
        @vertex
        fn vs(@builtin(vertex_index) v: u32, @builtin(instance_index) i: u32) -> Out {
            return Out(vec4(corners[3u * i + v].xyz, 1.0), i);
        }
        @fragment
        fn fs(in: Out) -> @location(0) vec4<f32> {
            return select(vec4(0.0, 0.25, 0.0, 0.5), vec4(1.0, 0.0, 0.0, 1.0), in.instance == 0u);
        }";

    /// A far triangle over the whole image, then a near one over its lower left half; the rows are not a multiple of 256 bytes.
    #[test]
    fn triangles_are_drawn_near_over_far_and_read_back() {
        let Some(gpu) = test_adapter("triangles_are_drawn_near_over_far_and_read_back") else {
            return;
        };
        let (w, h) = (37usize, 20usize);
        let format = wgpu::TextureFormat::Rgba32Float;
        let corners: [[f32; 4]; 6] = [
            [-1.0, -3.0, 0.75, 0.0],
            [-1.0, 1.0, 0.75, 0.0],
            [3.0, 1.0, 0.75, 0.0],
            [-1.0, -1.0, 0.25, 0.0],
            [-1.0, 1.0, 0.25, 0.0],
            [1.0, -1.0, 0.25, 0.0],
        ];
        let target = Target::new(&gpu, w, h, format).unwrap();
        let raster = Raster::new(&gpu, "triangles", TRIANGLES, format, &RasterOptions::default()).unwrap();
        let buffer = gpu.storage("corners", &corners).unwrap();
        let bind = raster.bind(&gpu, &[(0, buffer.as_entire_binding())]).unwrap();
        let times = gpu
            .run("triangles", 1, |work| {
                work.raster(&target, Some(([0.0; 4], 1.0)), |pass| {
                    pass.set_pipeline(raster.pipeline());
                    pass.set_bind_group(0, &bind, &[]);
                    // The near one first: the depth test must keep it.
                    pass.draw(0..3, 1..2);
                    pass.draw(0..3, 0..1);
                });
            })
            .unwrap();
        assert_eq!(times.map(|t| t.len()), gpu.report().timestamps.then_some(1));
        let depth = target.read_depth(&gpu).unwrap();
        let colour: Vec<[f32; 4]> = bytemuck::pod_collect_to_vec(&target.read_colour(&gpu).unwrap());
        assert_eq!((depth.len(), colour.len()), (w * h, w * h));
        for y in 0..h {
            for x in 0..w {
                let (i, px, py) = (y * w + x, (x as f64 + 0.5) / w as f64, (y as f64 + 0.5) / h as f64);
                // Lower left of the diagonal from the top left to the bottom right corner; leave out pixels on it.
                if (px - py).abs() < 1e-6 {
                    continue;
                }
                let (z, c) = if px < py {
                    (0.25, [0.0, 0.25, 0.0, 0.5])
                } else {
                    (0.75, [1.0, 0.0, 0.0, 1.0])
                };
                assert_eq!((depth[i], colour[i]), (z, c), "pixel {x}, {y}");
            }
        }
    }

    #[test]
    fn useless_targets_are_refused() {
        let Some(gpu) = test_adapter("useless_targets_are_refused") else {
            return;
        };
        let format = wgpu::TextureFormat::Rgba8Unorm;
        assert!(matches!(Target::new(&gpu, 0, 4, format), Err(GpuError::Refused { .. })));
        let long = gpu.report().max_texture_2d as usize + 1;
        assert!(matches!(Target::new(&gpu, 4, long, format), Err(GpuError::Size { .. })));
        gpu.check().unwrap();
    }
}
