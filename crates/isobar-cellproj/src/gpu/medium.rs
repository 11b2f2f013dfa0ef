//! The medium: cells into squares in visibility order, hits as lists of pixels, and the kernel that goes through both.
//!
//! **Limits.** The image is drawn in bands of rows of squares, each within what a binding holds, and a band in passes of so many cells a square that a device that cuts loops short
//! (Mesa's software device does after 65,535 turns in all, without a word) is not met: at most [`Limits::cells`] cells of some ten turns each. Cycles of more than [`CYCLE`] cells, which a pixel
//! goes through in turns as many as their square, are refused.

use super::device::{Mesh, Scene};
use super::source;
use crate::blocks::CellBins;
use crate::camera::Projection;
use crate::mesh::Cells;
use crate::mixed::{Counts, Filled, Lookup, Settings, Volume, arrange, hit_colour};
use crate::normals::Shading;
use crate::tables::Parts;
use crate::volume::groups;
use bytemuck::{Pod, Zeroable};
use isobar_core::{RayGenerator, RenderError, Stop};
use isobar_cpu::scene::Isovalues;
use isobar_gpu::{Gpu, Kernel, wgpu};
use rayon::prelude::*;
use std::collections::HashMap;
use std::ops::Range;
use std::time::Duration;

/// Pixels along a side of the squares: those of a workgroup.
const SQUARE: usize = 8;
/// Flags of cells in cycles, as in `medium.wgsl`.
const MEMBER: u32 = 1 << 31;
const FIRST: u32 = 1 << 30;
/// Cells of a cycle at most: their square times the turns of setting one up stays below 65,535.
pub(super) const CYCLE: usize = 64;

/// What a pass may have.
#[derive(Debug, Clone, Copy)]
pub(super) struct Limits {
    /// Cells of a square in a pass.
    pub(super) cells: u32,
    /// Bytes of a binding.
    pub(super) bytes: u64,
}

impl Limits {
    pub(super) fn new(gpu: &Gpu) -> Self {
        Self {
            cells: 4096,
            bytes: gpu.binding_limit(),
        }
    }
}

/// `Table` of `medium.wgsl`.
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
#[repr(C)]
struct Uniforms {
    value: f32,
    per: f32,
    nodes: u32,
    planar: u32,
    length: f32,
    row: u32,
    passed: u32,
    most: u32,
}

/// The table on the device.
#[derive(Debug)]
pub(super) struct Table {
    axes: Uniforms,
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
            row: 0,
            passed: 0,
            most: 0,
        };
        Ok(Self {
            axes: uniform,
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

/// The cells of a band's squares: where each begins and the end, and the cells with their flags.
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
    pub(super) limits: Limits,
}

/// A frame of the medium.
#[derive(Debug)]
pub(super) struct Image {
    /// Premultiplied colour and opacity, row by row.
    pub(super) rgba: Vec<[f32; 4]>,
    pub(super) counts: Counts,
    pub(super) device: Option<Duration>,
    /// Bytes on the device, of the greatest band.
    pub(super) bytes: u64,
    /// Dispatches.
    pub(super) passes: u64,
}

impl Draw<'_> {
    /// Draws, with the hits of the pixels: see [`Crossings`]. To be called on the pool.
    ///
    /// # Errors
    /// [`RenderError::Memory`] where the lists exceed memory, or those of a single row of squares a binding; [`RenderError::Unsupported`] for long cycles; [`RenderError::Stopped`];
    /// [`RenderError::Device`].
    pub(super) fn run(&self, hits: &Crossings, stop: &Stop) -> Result<Image, RenderError> {
        let p = &self.scene.projection;
        let columns = p.width.div_ceil(SQUARE);
        let (screen, order, mut counts) = arrange(self.cells, self.volume, *p, self.settings.sort)?;
        if let Some(long) = order.groups.iter().map(|g| g.len()).find(|n| *n > CYCLE) {
            return Err(super::feature(format!("{long} cells that hide each other in a cycle; use cellproj/cpu")).into());
        }
        let visible = &self.filled.visible;
        let bins = CellBins::with_side(self.cells, &screen, &order.cells, SQUARE, |c| visible[c as usize])?;
        counts.entries = bins.len();
        let groups = groups(&order);
        let mut out = Image {
            rgba: Vec::with_capacity(p.width * p.height),
            counts,
            device: self.gpu.report().timestamps.then_some(Duration::ZERO),
            bytes: 0,
            passes: 0,
        };
        for rows in self.bands(&bins, hits, columns) {
            let squares = squares(&bins, &groups, rows.start * columns..rows.end * columns);
            self.band(&squares, hits, rows, stop, &mut out)?;
        }
        Ok(out)
    }

    /// Rows of squares whose lists fit into bindings together; a row alone that does not is left to be refused by name.
    fn bands(&self, bins: &CellBins, hits: &Crossings, columns: usize) -> Vec<Range<usize>> {
        let p = &self.scene.projection;
        let mut out: Vec<Range<usize>> = Vec::new();
        let mut held = [u64::MAX; 3];
        for row in 0..p.height.div_ceil(SQUARE) {
            let cells = (row * columns..(row + 1) * columns)
                .flat_map(|s| bins.lists(s))
                .map(<[_]>::len);
            let pixels = pixels(p, &(row..row + 1));
            let found = hits.starts[pixels.end] - hits.starts[pixels.start];
            let here = [cells.sum::<usize>() as u64 * 4, pixels.len() as u64 * 16, found as u64 * 20];
            for (held, here) in held.iter_mut().zip(here) {
                *held = held.saturating_add(here);
            }
            match out.last_mut() {
                Some(band) if held.iter().all(|h| *h <= self.limits.bytes) => band.end = row + 1,
                _ => {
                    held = here;
                    out.push(row..row + 1);
                }
            }
        }
        out
    }

    /// Draws a band of rows of squares and adds its pixels.
    fn band(
        &self,
        squares: &Squares,
        hits: &Crossings,
        rows: Range<usize>,
        stop: &Stop,
        out: &mut Image,
    ) -> Result<(), RenderError> {
        let gpu = self.gpu;
        let p = &self.scene.projection;
        let columns = p.width.div_ceil(SQUARE);
        let pixels = pixels(p, &rows);
        let first = hits.starts[pixels.start];
        let ranges: Vec<[u32; 2]> = hits.starts[pixels.start..=pixels.end]
            .windows(2)
            .map(|w| [(w[0] - first) as u32, (w[1] - first) as u32])
            .collect();
        let starts = gpu.storage("cells of squares", &squares.starts)?;
        let listed = gpu.storage("cells in visibility order", &squares.listed)?;
        let ranges = gpu.storage("hits of pixels", &ranges)?;
        let all = gpu.storage("hits", &hits.all[first..hits.starts[pixels.end]])?;
        let image = gpu.storage_empty("the image", pixels.len() as u64 * 16)?;
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
                (7, ranges.as_entire_binding()),
                (8, all.as_entire_binding()),
                (9, image.as_entire_binding()),
            ],
        )?;
        let longest = squares.starts.windows(2).map(|w| w[1] - w[0]).max().unwrap_or(0);
        let mut passed = 0;
        loop {
            if stop.is_raised() {
                return Err(RenderError::Stopped);
            }
            let pass = Uniforms {
                row: rows.start as u32,
                passed,
                most: self.limits.cells,
                ..self.table.axes
            };
            gpu.write(&self.table.uniform, bytemuck::bytes_of(&pass))?;
            let times = gpu.run("medium", 1, |w| {
                w.compute(self.kernel, &bind, [columns as u32, rows.len() as u32, 1])
            })?;
            out.device = out.device.zip(times).map(|(a, t)| a + t.iter().sum::<Duration>());
            out.passes += 1;
            passed = passed.saturating_add(self.limits.cells);
            if passed >= longest {
                break;
            }
        }
        let opacity = |c: [f32; 4]| [c[0], c[1], c[2], 1.0 - c[3]];
        out.rgba
            .extend(gpu.read::<[f32; 4]>(&image, pixels.len())?.into_iter().map(opacity));
        let buffers = [&starts, &listed, &ranges, &all, &image];
        out.bytes = out.bytes.max(buffers.iter().map(|b| b.size()).sum());
        Ok(())
    }
}

/// The pixels of rows of squares.
fn pixels(p: &Projection, rows: &Range<usize>) -> Range<usize> {
    let row = |r: usize| (r * SQUARE).min(p.height) * p.width;
    row(rows.start)..row(rows.end)
}

fn squares(bins: &CellBins, groups: &HashMap<u32, u32>, numbers: Range<usize>) -> Squares {
    let mut out = Squares {
        starts: Vec::with_capacity(numbers.len() + 1),
        listed: Vec::new(),
    };
    for square in numbers {
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
    out
}

/// The hits of all pixels, front to back: where those of each begin, and the end; depth, colour and minus the opacity.
pub(super) struct Crossings {
    starts: Vec<usize>,
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
        let rows: Vec<(Vec<usize>, Vec<[f32; 5]>)> = (0..p.height)
            .into_par_iter()
            .map(|y| {
                let (mut counts, mut all, mut roots) = (Vec::with_capacity(p.width), Vec::new(), Vec::new());
                for x in 0..p.width {
                    let ray = rays.ray(x, y);
                    let along = p.rows[2].dot(ray.direction);
                    hits.roots(y * p.width + x, along, &mut roots);
                    counts.push(roots.len());
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
