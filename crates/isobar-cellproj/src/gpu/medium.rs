//! The medium: cells into squares in visibility order, hits as lists of pixels, and the kernel that goes through both.

use super::device::{Mesh, Scene};
use super::source;
use crate::blocks::CellBins;
use crate::mesh::Cells;
use crate::mixed::{Counts, Filled, Lookup, Settings, Volume, arrange, hit_colour};
use crate::normals::Shading;
use crate::tables::Parts;
use crate::volume::groups;
use bytemuck::{Pod, Zeroable};
use isobar_core::{RayGenerator, RenderError};
use isobar_cpu::scene::Isovalues;
use isobar_gpu::{Gpu, Kernel, wgpu};
use rayon::prelude::*;
use std::time::Duration;

/// Pixels along a side of the squares: those of a workgroup.
const SQUARE: usize = 8;
/// Flags of cells in cycles, as in `medium.wgsl`.
const MEMBER: u32 = 1 << 31;
const FIRST: u32 = 1 << 30;

/// `Table` of `medium.wgsl`.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Uniforms {
    value: f32,
    per: f32,
    nodes: u32,
    planar: u32,
    length: f32,
    unused: [u32; 3],
}

/// The table on the device.
#[derive(Debug)]
pub(super) struct Table {
    uniform: wgpu::Buffer,
    texels: wgpu::Buffer,
}

impl Table {
    /// # Errors
    /// [`RenderError::Memory`] for tables that exceed a binding.
    pub(super) fn new(gpu: &Gpu, filled: &Filled, mesh: &Mesh) -> Result<Self, RenderError> {
        let (parts, planar): (Parts<'_>, bool) = match &filled.lookup {
            Lookup::Table3(t) => (t.parts(), false),
            Lookup::Table2(t) => (t.parts(), true),
            Lookup::Exact(_) => return Err(super::feature("integration without a table").into()),
        };
        let texels: Vec<[f32; 4]> = parts.texels.iter().map(|t| t.to_array()).collect();
        let uniform = Uniforms {
            value: parts.from as f32,
            per: parts.per as f32,
            nodes: parts.nodes as u32,
            planar: u32::from(planar),
            length: (parts.length * mesh.unit) as f32,
            unused: [0; 3],
        };
        Ok(Self {
            uniform: gpu.uniform("the table's axes", &uniform)?,
            texels: gpu.storage("the pre-integrated table", &texels)?,
        })
    }

    pub(super) fn bytes(&self) -> u64 {
        self.texels.size()
    }
}

/// The kernel.
pub(super) fn kernel(gpu: &Gpu) -> Result<Kernel, RenderError> {
    Ok(Kernel::new(gpu, "medium", &source("medium")?, "main")?)
}

/// The cells of every square: where each begins and the end, and the cells with their flags.
struct Squares {
    starts: Vec<u32>,
    listed: Vec<u32>,
}

/// What a frame needs.
pub(super) struct Draw<'a> {
    pub(super) gpu: &'a Gpu,
    pub(super) kernel: &'a Kernel,
    pub(super) mesh: &'a Mesh,
    pub(super) cells: &'a Cells,
    pub(super) volume: &'a Volume,
    pub(super) filled: &'a Filled,
    pub(super) table: &'a Table,
    pub(super) scene: &'a Scene,
    pub(super) uniform: &'a wgpu::Buffer,
    pub(super) settings: Settings,
}

/// A frame of the medium.
#[derive(Debug)]
pub(super) struct Image {
    /// Premultiplied colour and opacity, row by row.
    pub(super) rgba: Vec<[f32; 4]>,
    pub(super) counts: Counts,
    pub(super) device: Option<Duration>,
    /// Bytes on the device.
    pub(super) bytes: u64,
}

impl Draw<'_> {
    /// Draws, with the hits of the pixels: see [`Crossings`]. To be called on the pool.
    ///
    /// # Errors
    /// [`RenderError::Memory`] where the lists exceed a binding; [`RenderError::Device`].
    pub(super) fn run(&self, hits: &Crossings) -> Result<Image, RenderError> {
        let gpu = self.gpu;
        let p = &self.scene.projection;
        let (columns, rows) = (p.width.div_ceil(SQUARE), p.height.div_ceil(SQUARE));
        let (squares, counts) = self.squares(columns * rows);
        let starts = gpu.storage("cells of squares", &squares.starts)?;
        let listed = gpu.storage("cells in visibility order", &squares.listed)?;
        let hit_starts = gpu.storage("hits of pixels", &hits.starts)?;
        let all = gpu.storage("hits", &hits.all)?;
        let pixels = p.width * p.height;
        let image = gpu.storage_empty("the image", pixels as u64 * 16)?;
        let view = self.scene.uniform.in_columns(columns);
        gpu.write(self.uniform, bytemuck::bytes_of(&view))?;
        let bind = self.kernel.bind(
            gpu,
            &[
                (0, self.uniform.as_entire_binding()),
                (1, self.mesh.points.as_entire_binding()),
                (2, self.mesh.cells.as_entire_binding()),
                (3, self.table.uniform.as_entire_binding()),
                (4, self.table.texels.as_entire_binding()),
                (5, starts.as_entire_binding()),
                (6, listed.as_entire_binding()),
                (7, hit_starts.as_entire_binding()),
                (8, all.as_entire_binding()),
                (9, image.as_entire_binding()),
            ],
        )?;
        let times = gpu.run("medium", 1, |w| {
            w.compute(self.kernel, &bind, [columns as u32, rows as u32, 1])
        })?;
        let rgba = gpu.read(&image, pixels)?;
        let buffers = [&starts, &listed, &hit_starts, &all, &image];
        Ok(Image {
            rgba,
            counts,
            device: times.map(|t| t.iter().sum()),
            bytes: buffers.iter().map(|b| b.size()).sum(),
        })
    }

    fn squares(&self, count: usize) -> (Squares, Counts) {
        let (screen, order, mut counts) = arrange(self.cells, self.volume, self.scene.projection, self.settings.sort);
        let visible = &self.filled.visible;
        let bins = CellBins::with_side(self.cells, &screen, &order.cells, SQUARE, |c| visible[c as usize]);
        counts.entries = bins.len();
        let groups = groups(&order);
        let mut out = Squares {
            starts: Vec::with_capacity(count + 1),
            listed: Vec::with_capacity(bins.len()),
        };
        for square in 0..count {
            out.starts.push(out.listed.len() as u32);
            if groups.is_empty() {
                out.listed.extend(bins.numbered(square));
                continue;
            }
            let mut last = None;
            for cell in bins.numbered(square) {
                let group = groups.get(&cell).copied();
                let flags = match group {
                    None => 0,
                    Some(_) if group == last => MEMBER,
                    Some(_) => MEMBER | FIRST,
                };
                last = group;
                out.listed.push(cell | flags);
            }
        }
        out.starts.push(out.listed.len() as u32);
        (out, counts)
    }
}

/// The hits of all pixels, front to back: where those of each begin, and the end; depth, colour and minus the opacity.
pub(super) struct Crossings {
    starts: Vec<u32>,
    all: Vec<[f32; 5]>,
}

impl Crossings {
    /// To be called on the pool.
    pub(super) fn new(
        hits: &super::surfaces::Hits<'_>,
        surfaces: &Isovalues,
        shading: Shading<'_>,
        rays: RayGenerator<'_>,
    ) -> Self {
        let p = &hits.scene.projection;
        let mut out = Self {
            starts: vec![0; p.width * p.height + 1],
            all: Vec::new(),
        };
        if hits.layers.is_empty() {
            return out;
        }
        let rows: Vec<(Vec<u32>, Vec<[f32; 5]>)> = (0..p.height)
            .into_par_iter()
            .map(|y| {
                let (mut counts, mut all, mut roots) = (Vec::with_capacity(p.width), Vec::new(), Vec::new());
                for x in 0..p.width {
                    let ray = rays.ray(x, y);
                    let along = p.rows[2].dot(ray.direction);
                    hits.roots(y * p.width + x, along, &mut roots);
                    counts.push(roots.len() as u32);
                    for root in &roots {
                        let c = hit_colour(surfaces, shading, hits.cells, &ray, root);
                        all.push([hits.scene.local(root.t * along), c.x, c.y, c.z, c.w]);
                    }
                }
                (counts, all)
            })
            .collect();
        for (y, (counts, all)) in rows.into_iter().enumerate() {
            for (x, n) in counts.into_iter().enumerate() {
                let i = y * p.width + x;
                out.starts[i + 1] = out.starts[i] + n;
            }
            out.all.extend(all);
        }
        out
    }
}
