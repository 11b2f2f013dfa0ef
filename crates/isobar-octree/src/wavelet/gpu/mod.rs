//! The reconstruction on a GPU: Algorithms 1 to 3 of Steinberger 2010 as wgpu compute kernels.
//!
//! The twin of [`super::Adaptive`]: the same selections, the same chunks computed and kept, a dispatch per level and pass. A workgroup of 64 has a chunk
//! of 8^3, an invocation the eight outputs of a line of it. Where the thesis convolves in place, a beam of chunks per block with copies of the chunk before,
//! a pass here reads one buffer and writes another, so that all chunks of a level run at once; that costs two buffers of the size of the finest level. The
//! text of a pass is generated for the bank, written out (`generate.rs`).
//!
//! **Precision.** f32; sums are those of the CPU, in the same order, but a device may fuse a product and a sum or add in another order. The tests hold every
//! coefficient of all banks to [`TWIN`] of the greatest coefficient beside the CPU.

mod generate;
#[cfg(test)]
mod tests;

use super::adaptive::Plan;
use super::blocks::{CHUNK, ChunkSet};
use super::{Extent, Pyramid, Selection, Update};
use bytemuck::{Pod, Zeroable};
use generate::{Axis, source};
use isobar_gpu::{Gpu, GpuError, Kernel, wgpu};
use std::sync::Arc;
use std::time::Duration;

/// Coefficients of GPU and CPU differ by at most this part of the greatest magnitude of all samples, in what the tests have seen.
pub const TWIN: f32 = 1.0 / (1 << 20) as f32;

/// Workgroups per row of a dispatch, as in the shaders.
const PER_ROW: u32 = 1 << 15;

/// One level on the device.
#[derive(Debug)]
struct Level {
    details: wgpu::Buffer,
    /// Values in chunks.
    values: wgpu::Buffer,
    /// Whether chunks are active.
    active: wgpu::Buffer,
    valid: ChunkSet,
}

/// A spline with details in the active chunks only, on a device: as [`super::Adaptive`].
#[derive(Debug)]
pub struct GpuAdaptive {
    gpu: Gpu,
    pyramid: Arc<Pyramid>,
    kernels: Vec<Kernel>,
    levels: Vec<Level>,
    coarsest: wgpu::Buffer,
    /// What the passes z and y leave, for the largest level.
    scratch: [wgpu::Buffer; 2],
    selection: Selection,
}

/// What the kernels know of a level: `Params` of the shaders.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Params {
    dims: [i32; 4],
    chunks: [i32; 4],
    coarse: [i32; 4],
}

fn four([x, y, z]: [usize; 3], w: usize) -> [i32; 4] {
    [x as i32, y as i32, z as i32, w as i32]
}

impl GpuAdaptive {
    /// Uploads the pyramid; nothing active, nothing computed.
    ///
    /// # Errors
    /// [`GpuError::Memory`] where a level is more than one binding holds; as [`Gpu::guard`].
    pub fn new(gpu: &Gpu, pyramid: Arc<Pyramid>) -> Result<Self, GpuError> {
        let kernels = Axis::ALL
            .iter()
            .map(|&axis| Kernel::new(gpu, &format!("wavelet pass {axis:?}"), &source(pyramid.bank(), axis), "main"))
            .collect::<Result<Vec<_>, _>>()?;
        let bytes = |l: usize| pyramid.level_chunks(l).iter().product::<usize>() as u64 * (CHUNK * CHUNK * CHUNK * 4) as u64;
        let levels = (0..pyramid.levels())
            .map(|l| {
                let chunks = pyramid.level_chunks(l);
                Ok(Level {
                    details: gpu.storage("wavelet details", &pyramid.levels[l].details.data)?,
                    values: gpu.storage_empty("spline coefficients", bytes(l))?,
                    active: gpu.storage_empty("active chunks", chunks.iter().product::<usize>() as u64 * 4)?,
                    valid: ChunkSet::new(chunks, false),
                })
            })
            .collect::<Result<Vec<_>, GpuError>>()?;
        let scratch = gpu.storage_empty("wavelet pass", bytes(0))?;
        Ok(Self {
            coarsest: gpu.storage("coarsest level", &pyramid.coarsest.data)?,
            scratch: [scratch, gpu.storage_empty("wavelet pass", bytes(0))?],
            selection: Selection::whole(&pyramid, false),
            gpu: gpu.clone(),
            pyramid,
            kernels,
            levels,
        })
    }

    /// As [`super::Adaptive::update`]; beside it the time of the passes on the device, where it has timestamps.
    ///
    /// # Errors
    /// As [`Gpu::guard`]; nothing counts as computed afterwards.
    ///
    /// # Panics
    /// When the selection was made for a pyramid of other dimensions.
    pub fn update(&mut self, selection: &Selection, extent: Extent) -> Result<(Update, Option<Duration>), GpuError> {
        let valid = self.levels.iter().map(|l| &l.valid).collect();
        let plan = Plan::new(&self.pyramid, [&self.selection, selection], valid, extent);
        self.forget();
        let time = self.compute(selection, &plan.todo)?;
        for (level, valid) in self.levels.iter_mut().zip(plan.valid) {
            level.valid = valid;
        }
        self.selection = selection.clone();
        Ok((plan.update, time))
    }

    /// Forgets what was computed.
    pub fn forget(&mut self) {
        for level in &mut self.levels {
            level.valid = ChunkSet::new(level.valid.chunks(), false);
        }
    }

    /// Runs the passes, coarsest level first.
    fn compute(&self, selection: &Selection, todo: &[ChunkSet]) -> Result<Option<Duration>, GpuError> {
        let mut passes = Vec::new();
        for l in (0..self.levels.len()).rev().filter(|&l| todo[l].count() > 0) {
            let level = &self.levels[l];
            let active: Vec<u32> = selection.level(l).members().iter().map(|&m| u32::from(m)).collect();
            self.gpu.write(&level.active, bytemuck::cast_slice(&active))?;
            // What the x pass reads, and what the y pass reads.
            let along_y = todo[l].dilated([1, 0, 0]);
            let along_z = along_y.dilated([0, 1, 0]);
            let low = self.levels.get(l + 1).map_or(&self.coarsest, |c| &c.values);
            let [a, b] = &self.scratch;
            for (i, (set, from, to)) in [(&along_z, &level.details, a), (&along_y, a, b), (&todo[l], b, &level.values)]
                .into_iter()
                .enumerate()
            {
                let list: Vec<u32> = set.iter().map(|c| set.index(c) as u32).collect();
                let params = Params {
                    dims: four(self.pyramid.level_dims(l), list.len()),
                    chunks: four(set.chunks(), 0),
                    coarse: four(self.pyramid.level_chunks(l + 1), 0),
                };
                let params = self.gpu.uniform("a level", &params)?;
                let chunks = self.gpu.storage("chunks of a pass", &list)?;
                let mut resources = vec![
                    (0, params.as_entire_binding()),
                    (1, chunks.as_entire_binding()),
                    (2, from.as_entire_binding()),
                    (3, to.as_entire_binding()),
                ];
                if i == 0 {
                    resources.extend([(4, low.as_entire_binding()), (5, level.active.as_entire_binding())]);
                }
                let bind = self.kernels[i].bind(&self.gpu, &resources)?;
                let n = list.len() as u32;
                passes.push((i, bind, [n.min(PER_ROW), n.div_ceil(PER_ROW), 1]));
            }
        }
        let times = self.gpu.run("wavelet reconstruction", passes.len() as u32, |work| {
            for (i, bind, groups) in &passes {
                work.compute(&self.kernels[*i], bind, *groups);
            }
        })?;
        Ok(times.map(|t| t.iter().sum()))
    }

    /// The values of a level with details that are there for the present selection: chunks, and for each its 8^3 values, x fastest; those beyond the
    /// level's size are padding.
    ///
    /// # Errors
    /// As [`Gpu::read_bytes`].
    ///
    /// # Panics
    /// When there is no such level.
    pub fn level(&self, level: usize) -> Result<(ChunkSet, Vec<f32>), GpuError> {
        let l = &self.levels[level];
        let count = l.valid.members().len() * CHUNK * CHUNK * CHUNK;
        Ok((l.valid.clone(), self.gpu.read(&l.values, count)?))
    }

    /// Bytes on the device.
    #[must_use]
    pub fn bytes(&self) -> u64 {
        let level = |l: &Level| l.details.size() + l.values.size() + l.active.size();
        let levels: u64 = self.levels.iter().map(level).sum();
        levels + self.coarsest.size() + self.scratch.iter().map(wgpu::Buffer::size).sum::<u64>()
    }
}
