//! Work on the device: a compute kernel, passes, and their time.

use crate::{Gpu, GpuError, Target};
use std::time::Duration;

/// A compute pipeline with the bind-group layout its shader uses (group 0; bindings the shader does not use are not in it).
#[derive(Debug, Clone)]
pub struct Kernel {
    pipeline: wgpu::ComputePipeline,
    layout: wgpu::BindGroupLayout,
}

impl Kernel {
    /// Compiles the entry point of a WGSL module. The driver may put off its own compilation until the first dispatch.
    ///
    /// # Errors
    /// [`GpuError::Refused`] where the module is wrong or beyond the device's limits; as [`Gpu::guard`].
    pub fn new(gpu: &Gpu, what: &str, source: &str, entry: &str) -> Result<Self, GpuError> {
        gpu.guard(what, 0, || {
            let module = gpu.device().create_shader_module(wgpu::ShaderModuleDescriptor {
                label: Some(what),
                source: wgpu::ShaderSource::Wgsl(source.into()),
            });
            let pipeline = gpu.device().create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(what),
                layout: None,
                module: &module,
                entry_point: Some(entry),
                compilation_options: wgpu::PipelineCompilationOptions::default(),
                cache: None,
            });
            let layout = pipeline.get_bind_group_layout(0);
            Self { pipeline, layout }
        })
    }

    /// The resources of group 0, by binding.
    ///
    /// # Errors
    /// [`GpuError::Refused`] where they are not those of the shader; as [`Gpu::guard`].
    pub fn bind(&self, gpu: &Gpu, resources: &[(u32, wgpu::BindingResource<'_>)]) -> Result<wgpu::BindGroup, GpuError> {
        bind_group(gpu, &self.layout, resources)
    }
}

/// A bind group of `resources`, by binding.
pub(crate) fn bind_group(
    gpu: &Gpu,
    layout: &wgpu::BindGroupLayout,
    resources: &[(u32, wgpu::BindingResource<'_>)],
) -> Result<wgpu::BindGroup, GpuError> {
    let entries: Vec<_> = resources
        .iter()
        .map(|(binding, resource)| wgpu::BindGroupEntry {
            binding: *binding,
            resource: resource.clone(),
        })
        .collect();
    gpu.guard("binding resources", 0, || {
        gpu.device().create_bind_group(&wgpu::BindGroupDescriptor {
            label: None,
            layout,
            entries: &entries,
        })
    })
}

/// Records passes; see [`Gpu::run`].
#[derive(Debug)]
pub struct Work<'a> {
    encoder: wgpu::CommandEncoder,
    queries: Option<&'a wgpu::QuerySet>,
    timed: u32,
    passes: u32,
}

impl<'a> Work<'a> {
    /// One compute pass with one dispatch of `groups` workgroups.
    pub fn compute(&mut self, kernel: &Kernel, bind: &wgpu::BindGroup, groups: [u32; 3]) {
        let mut pass = self.pass();
        pass.set_pipeline(&kernel.pipeline);
        pass.set_bind_group(0, bind, &[]);
        pass.dispatch_workgroups(groups[0], groups[1], groups[2]);
    }

    /// As [`Work::compute`], with the number of workgroups (three u32) read by the device from `buffer` at byte `offset`: see [`Gpu::indirect_empty`].
    pub fn compute_indirect(&mut self, kernel: &Kernel, bind: &wgpu::BindGroup, buffer: &wgpu::Buffer, offset: u64) {
        let mut pass = self.pass();
        pass.set_pipeline(&kernel.pipeline);
        pass.set_bind_group(0, bind, &[]);
        pass.dispatch_workgroups_indirect(buffer, offset);
    }

    /// A compute pass, timed where the next one is.
    fn pass(&mut self) -> wgpu::ComputePass<'_> {
        let timestamp_writes = self.next_pass().map(|(query_set, i)| wgpu::ComputePassTimestampWrites {
            query_set,
            beginning_of_pass_write_index: Some(2 * i),
            end_of_pass_write_index: Some(2 * i + 1),
        });
        self.encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: None,
            timestamp_writes,
        })
    }

    /// One render pass into `target`. `clear`: colour (linear, premultiplied) and depth to start from; `None` keeps what is there.
    pub fn raster(&mut self, target: &Target, clear: Option<([f64; 4], f32)>, draw: impl FnOnce(&mut wgpu::RenderPass<'_>)) {
        let timestamp_writes = self.next_pass().map(|(query_set, i)| wgpu::RenderPassTimestampWrites {
            query_set,
            beginning_of_pass_write_index: Some(2 * i),
            end_of_pass_write_index: Some(2 * i + 1),
        });
        let colour = clear.map_or(wgpu::LoadOp::Load, |([r, g, b, a], _)| {
            wgpu::LoadOp::Clear(wgpu::Color { r, g, b, a })
        });
        let depth = clear.map_or(wgpu::LoadOp::Load, |(_, d)| wgpu::LoadOp::Clear(d));
        let mut pass = self.encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: None,
            color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                view: target.colour(),
                depth_slice: None,
                resolve_target: None,
                ops: wgpu::Operations {
                    load: colour,
                    store: wgpu::StoreOp::Store,
                },
            })],
            depth_stencil_attachment: Some(wgpu::RenderPassDepthStencilAttachment {
                view: target.depth(),
                depth_ops: Some(wgpu::Operations {
                    load: depth,
                    store: wgpu::StoreOp::Store,
                }),
                stencil_ops: None,
            }),
            timestamp_writes,
            ..wgpu::RenderPassDescriptor::default()
        });
        draw(&mut pass);
    }

    /// The encoder, for copies between passes.
    pub fn encoder(&mut self) -> &mut wgpu::CommandEncoder {
        &mut self.encoder
    }

    /// Queries and number of the pass about to begin, where it is timed.
    fn next_pass(&mut self) -> Option<(&'a wgpu::QuerySet, u32)> {
        let i = self.passes;
        self.passes += 1;
        self.queries.filter(|_| i < self.timed).map(|q| (q, i))
    }
}

impl Gpu {
    /// Records passes in `record`, submits them as one batch and waits. Returns the device time of each of the first `timed` passes, in
    /// order, from timestamps at their borders; `None` where the device has no timestamps. Passes may overlap, so the sum is an
    /// upper bound.
    ///
    /// # Errors
    /// As [`Gpu::guard`].
    pub fn run(&self, what: &str, timed: u32, record: impl FnOnce(&mut Work<'_>)) -> Result<Option<Vec<Duration>>, GpuError> {
        // wgpu allows 4096 queries in a set.
        let timed = timed.min(2048);
        let timer = (timed > 0 && self.report().timestamps)
            .then(|| Timer::new(self, timed))
            .transpose()?;
        let passes = self.guard(what, 0, || {
            let mut work = Work {
                encoder: self
                    .device()
                    .create_command_encoder(&wgpu::CommandEncoderDescriptor { label: Some(what) }),
                queries: timer.as_ref().map(|t| &t.queries),
                timed,
                passes: 0,
            };
            record(&mut work);
            let passes = work.passes.min(timed);
            if let Some(t) = timer.as_ref().filter(|_| passes > 0) {
                t.resolve(&mut work.encoder, passes);
            }
            self.queue().submit([work.encoder.finish()]);
            passes
        })?;
        self.wait()?;
        match timer {
            Some(t) if passes > 0 => t.read(self, passes).map(Some),
            Some(_) => Ok(Some(Vec::new())),
            None => Ok(None),
        }
    }
}

/// Timestamps at the borders of passes.
struct Timer {
    queries: wgpu::QuerySet,
    resolved: wgpu::Buffer,
    staging: wgpu::Buffer,
}

impl Timer {
    fn new(gpu: &Gpu, passes: u32) -> Result<Self, GpuError> {
        let bytes = u64::from(passes) * 16;
        let queries = gpu.guard("timestamps", bytes, || {
            gpu.device().create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("timestamps"),
                ty: wgpu::QueryType::Timestamp,
                count: 2 * passes,
            })
        })?;
        let resolve = wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC;
        let read = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        Ok(Self {
            queries,
            resolved: gpu.buffer("timestamps", bytes, u64::MAX, resolve)?,
            staging: gpu.buffer("timestamps", bytes, u64::MAX, read)?,
        })
    }

    fn resolve(&self, encoder: &mut wgpu::CommandEncoder, passes: u32) {
        encoder.resolve_query_set(&self.queries, 0..2 * passes, &self.resolved, 0);
        encoder.copy_buffer_to_buffer(&self.resolved, 0, &self.staging, 0, u64::from(passes) * 16);
    }

    fn read(&self, gpu: &Gpu, passes: u32) -> Result<Vec<Duration>, GpuError> {
        let period = f64::from(gpu.queue().get_timestamp_period());
        gpu.map(&self.staging, u64::from(passes) * 16, |bytes| {
            let ticks: Vec<[u64; 2]> = bytemuck::pod_collect_to_vec(bytes);
            ticks
                .iter()
                .map(|[begin, end]| Duration::from_nanos((end.saturating_sub(*begin) as f64 * period) as u64))
                .collect()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_adapter;

    const COUNT: &str = "
        @group(0) @binding(0) var<storage, read_write> sum: array<u32>;
        @compute @workgroup_size(64)
        fn main(@builtin(global_invocation_id) id: vec3<u32>) {
            if id.x < arrayLength(&sum) {
                var x = id.x;
                for (var i = 0u; i < 2000u; i++) {
                    x = x * 1664525u + 1013904223u;
                }
                sum[id.x] += x;
            }
        }";

    #[test]
    fn a_kernel_runs_and_is_timed() {
        let Some(gpu) = test_adapter("a_kernel_runs_and_is_timed") else {
            return;
        };
        let kernel = Kernel::new(&gpu, "count", COUNT, "main").unwrap();
        let n = 10_000usize;
        let sum = gpu.storage_empty("sum", n as u64 * 4).unwrap();
        let bind = kernel.bind(&gpu, &[(0, sum.as_entire_binding())]).unwrap();
        let groups = [(n as u32).div_ceil(64), 1, 1];
        let start = std::time::Instant::now();
        let times = gpu
            .run("count", 2, |w| {
                for _ in 0..3 {
                    w.compute(&kernel, &bind, groups);
                }
            })
            .unwrap();
        let wall = start.elapsed();
        assert_eq!(times.is_some(), gpu.report().timestamps);
        if let Some(times) = times {
            assert_eq!(times.len(), 2);
            assert!(times.iter().all(|t| !t.is_zero() && *t < wall), "{times:?} in {wall:?}");
        }
        let want: Vec<u32> = (0..n as u32)
            .map(|i| (0..2000).fold(i, |x, _| x.wrapping_mul(1_664_525).wrapping_add(1_013_904_223)))
            .map(|x| x.wrapping_mul(3))
            .collect();
        assert_eq!(gpu.read::<u32>(&sum, n).unwrap(), want);
    }

    /// The device's own number of workgroups is taken.
    #[test]
    fn an_indirect_dispatch_takes_its_size_from_the_buffer() {
        const MARK: &str = "
            @group(0) @binding(0) var<storage, read_write> seen: array<u32>;
            @compute @workgroup_size(1)
            fn main(@builtin(workgroup_id) group: vec3<u32>) { seen[group.y * 3u + group.x] = 7u; }";
        let Some(gpu) = test_adapter("an_indirect_dispatch_takes_its_size_from_the_buffer") else {
            return;
        };
        let kernel = Kernel::new(&gpu, "mark", MARK, "main").unwrap();
        let seen = gpu.storage_empty("seen", 40).unwrap();
        let size = gpu.indirect_empty("size", 16).unwrap();
        gpu.write(&size, bytemuck::cast_slice(&[9u32, 3, 2, 1])).unwrap();
        let bind = kernel.bind(&gpu, &[(0, seen.as_entire_binding())]).unwrap();
        gpu.run("mark", 0, |w| w.compute_indirect(&kernel, &bind, &size, 4)).unwrap();
        assert_eq!(gpu.read::<u32>(&seen, 10).unwrap(), [7, 7, 7, 7, 7, 7, 0, 0, 0, 0]);
    }

    #[test]
    fn wrong_shaders_bindings_and_dispatches_are_refused() {
        let Some(gpu) = test_adapter("wrong_shaders_bindings_and_dispatches_are_refused") else {
            return;
        };
        assert!(matches!(
            Kernel::new(&gpu, "broken", "fn main( {", "main"),
            Err(GpuError::Refused { .. })
        ));
        assert!(Kernel::new(&gpu, "count", COUNT, "nothing").is_err());
        let kernel = Kernel::new(&gpu, "count", COUNT, "main").unwrap();
        let sum = gpu.storage_empty("sum", 4).unwrap();
        assert!(kernel.bind(&gpu, &[(1, sum.as_entire_binding())]).is_err());
        let bind = kernel.bind(&gpu, &[(0, sum.as_entire_binding())]).unwrap();
        let e = gpu
            .run("too many", 0, |w| w.compute(&kernel, &bind, [u32::MAX, 1, 1]))
            .unwrap_err();
        assert!(matches!(&e, GpuError::Refused { what, .. } if what == "too many"), "{e}");
        // And the device still works.
        gpu.run("one", 0, |w| w.compute(&kernel, &bind, [1, 1, 1])).unwrap();
    }
}
