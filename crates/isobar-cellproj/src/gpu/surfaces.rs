//! Isosurfaces: the list of patches, the draws that peel off layers, and what was hit.

use super::device::{Mesh, Scene};
use super::source;
use crate::mesh::{ActiveCell, Cells};
use crate::resolve::{Gradient, Root};
use isobar_core::{RenderError, Stop};
use isobar_cpu::require_memory;
use isobar_gpu::{Gpu, Raster, RasterOptions, Target, wgpu};
use std::time::Duration;

/// Depth and patch of a hit.
pub(super) const FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rg32Uint;
/// A pixel of a layer: the bits of the depth, and the patch plus 1; 0: no hit.
pub(super) type Texel = [u32; 2];

/// The stages, compiled once.
#[derive(Debug)]
pub(super) struct Program {
    raster: Raster,
    /// Stands for the layer before the first.
    blank: Target,
}

impl Program {
    pub(super) fn new(gpu: &Gpu) -> Result<Self, RenderError> {
        let options = RasterOptions {
            primitive: wgpu::PrimitiveState {
                topology: wgpu::PrimitiveTopology::TriangleStrip,
                ..wgpu::PrimitiveState::default()
            },
            ..RasterOptions::default()
        };
        Ok(Self {
            raster: Raster::new(gpu, "patches of isosurfaces", &source("patch")?, FORMAT, &options)?,
            blank: Target::new(gpu, 1, 1, FORMAT)?,
        })
    }
}

/// The patches of a mesh and its isovalues, on the device and off.
#[derive(Debug)]
pub(super) struct Patches {
    /// Cell; isovalue, and from bit 8 a face of a constant cell plus 1.
    list: Vec<[u32; 2]>,
    device: wgpu::Buffer,
    levels: wgpu::Buffer,
}

impl Patches {
    pub(super) fn new(gpu: &Gpu, cells: &Cells, active: &[ActiveCell], isovalues: &[f64]) -> Result<Self, RenderError> {
        let mut list = Vec::with_capacity(active.len() + active.len() / 2);
        for a in active {
            let values = cells.values(a.cell);
            for i in a.from..a.to {
                let constant = values.iter().all(|v| *v == isovalues[usize::from(i)]);
                let faces = if constant { 1..5 } else { 0..1 };
                list.extend(faces.map(|face| [a.cell, u32::from(i) | face << 8]));
            }
        }
        let levels: Vec<[f32; 2]> = isovalues
            .iter()
            .map(|&c| [c as f32, (c - f64::from(c as f32)) as f32])
            .collect();
        Ok(Self {
            device: gpu.storage("patches of isosurfaces", &list)?,
            levels: gpu.storage("isovalues", &levels)?,
            list,
        })
    }

    pub(super) fn len(&self) -> usize {
        self.list.len()
    }

    pub(super) fn bytes(&self) -> u64 {
        self.device.size() + self.levels.size()
    }

    /// The root that a texel means, at `t`.
    fn root(&self, cells: &Cells, number: u32, t: f64) -> Root {
        let [cell, rest] = self.list[number as usize - 1];
        Root {
            t,
            error: f64::INFINITY,
            cell,
            isovalue: (rest & 255) as u8,
            end: None,
            gradient: Gradient::new(&cells.corners(cell), &cells.values(cell)).scaled,
        }
    }
}

/// The image's targets, kept between frames of the same size.
#[derive(Debug)]
pub(super) struct Targets {
    size: (usize, usize),
    targets: Vec<Target>,
}

impl Targets {
    pub(super) fn new(gpu: &Gpu, size: (usize, usize)) -> Result<Self, RenderError> {
        Ok(Self {
            size,
            targets: vec![Target::new(gpu, size.0, size.1, FORMAT)?],
        })
    }

    pub(super) fn bytes(&self) -> u64 {
        (self.targets.len() * self.size.0 * self.size.1 * 12) as u64
    }
}

/// What a draw needs.
pub(super) struct Draw<'a> {
    pub(super) gpu: &'a Gpu,
    pub(super) program: &'a Program,
    pub(super) mesh: &'a Mesh,
    pub(super) patches: &'a Patches,
    pub(super) uniform: &'a wgpu::Buffer,
    pub(super) scene: &'a Scene,
    /// Layers at most.
    pub(super) layers: usize,
}

impl Draw<'_> {
    /// Layers from front to back, each with a hit at least, and the device time.
    ///
    /// # Errors
    /// [`RenderError::Memory`] before a layer for which the host has no room; [`RenderError::Stopped`]; [`RenderError::Device`].
    pub(super) fn run(&self, targets: &mut Targets, stop: &Stop) -> Result<(Vec<Vec<Texel>>, Option<Duration>), RenderError> {
        let mut device = self.gpu.report().timestamps.then_some(Duration::ZERO);
        let mut out: Vec<Vec<Texel>> = Vec::new();
        if self.patches.list.is_empty() {
            return Ok((out, device));
        }
        if self.layers > 1 && targets.targets.len() < 2 {
            targets
                .targets
                .push(Target::new(self.gpu, targets.size.0, targets.size.1, FORMAT)?);
        }
        for layer in 0..self.layers {
            if stop.is_raised() {
                return Err(RenderError::Stopped);
            }
            let layer_bytes = (targets.size.0 * targets.size.1 * size_of::<Texel>()) as u64;
            // The layer as it is read and as it is kept.
            require_memory(
                || {
                    format!(
                        "layer {} of the hits of {} x {} pixels",
                        layer + 1,
                        targets.size.0,
                        targets.size.1
                    )
                },
                2 * layer_bytes,
            )?;
            let view = self.scene.uniform.peeled(layer > 0);
            self.gpu.write(self.uniform, bytemuck::bytes_of(&view))?;
            let target = &targets.targets[layer % targets.targets.len()];
            let before = if layer == 0 {
                &self.program.blank
            } else {
                &targets.targets[(layer + 1) % 2]
            };
            let bind = self.program.raster.bind(
                self.gpu,
                &[
                    (0, self.uniform.as_entire_binding()),
                    (1, self.mesh.points.as_entire_binding()),
                    (2, self.mesh.cells.as_entire_binding()),
                    (3, self.patches.device.as_entire_binding()),
                    (4, self.patches.levels.as_entire_binding()),
                    (5, wgpu::BindingResource::TextureView(before.colour())),
                ],
            )?;
            let count = self.patches.list.len() as u32;
            let times = self.gpu.run("patches of isosurfaces", 1, |w| {
                w.raster(target, Some(([0.0; 4], 1.0)), |pass| {
                    pass.set_pipeline(self.program.raster.pipeline());
                    pass.set_bind_group(0, &bind, &[]);
                    pass.draw(0..4, 0..count);
                });
            })?;
            device = device.zip(times).map(|(a, t)| a + t.iter().sum::<Duration>());
            let hits: Vec<Texel> = bytemuck::pod_collect_to_vec(&target.read_colour(self.gpu)?);
            if hits.iter().all(|h| h[1] == 0) {
                break;
            }
            out.push(hits);
        }
        Ok((out, device))
    }
}

/// Hits of all pixels.
pub(super) struct Hits<'a> {
    pub(super) cells: &'a Cells,
    pub(super) patches: &'a Patches,
    pub(super) scene: &'a Scene,
    pub(super) layers: &'a [Vec<Texel>],
    pub(super) isovalues: &'a [f64],
}

impl Hits<'_> {
    /// The roots of pixel `i`, whose ray has a depth of `along` per t; front to back.
    pub(super) fn roots(&self, i: usize, along: f64, out: &mut Vec<Root>) {
        out.clear();
        for layer in self.layers {
            let [z, number] = layer[i];
            if number == 0 {
                break;
            }
            let t = self.scene.depth(f32::from_bits(z)) / along;
            let root = self.patches.root(self.cells, number, t);
            if !out.last().is_some_and(|last| self.is_same(last, &root)) {
                out.push(root);
            }
        }
    }

    /// Whether two hits are one on the common face of two cells, which both have where it lies in the surface.
    fn is_same(&self, a: &Root, b: &Root) -> bool {
        let touches = |r: &Root| self.cells.values(r.cell).contains(&self.isovalues[usize::from(r.isovalue)]);
        a.isovalue == b.isovalue && (b.t - a.t).abs() <= 1e-5 * b.t.abs() && touches(a) && touches(b)
    }
}
