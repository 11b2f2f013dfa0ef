//! The medium: cells into squares in visibility order, hits as lists of pixels, and the kernel that goes through both.
//!
//! **Limits.** The image is drawn in bands of rows of squares, each within what a binding holds, and a band in passes of so many cells a square that a device that cuts loops short
//! (Mesa's software device does after 65,535 turns in all, without a word) is not met: at most [`Limits::cells`] cells of some ten turns each.
//!
//! **Cycles.** Where cells hide each other in a cycle, each pixel of a square sorts its own stays in them on the CPU; the square then lists, in place of the cells, each stay's cell and pixel, so cycles may have any
//! number of cells and cost the device what their stays do.

use super::device::{Mesh, Scene};
use super::source;
use crate::blocks::CellBins;
use crate::camera::Projection;
use crate::cells::{CellOnScreen, Screen};
use crate::faces::Look;
use crate::mesh::Cells;
use crate::mixed::{Counts, Filled, Lookup, Settings, Volume, arrange, hit_colour};
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
/// A place in the lists of cell and pixel instead of a cell, as in `medium.wgsl`.
const APART: u32 = 1 << 31;

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
        let (screen, order, mut counts) = arrange(self.cells, self.volume, *p, (self.settings.sort, true))?;
        let visible = &self.filled.visible;
        let bins = CellBins::with_side(self.cells, &screen, &order.cells, SQUARE, |c| visible[c as usize])?;
        counts.entries = bins.len();
        let cycles = Cycles::new(self.cells, &screen, &bins, &groups(&order), columns);
        let mut out = Image {
            rgba: Vec::with_capacity(p.width * p.height),
            counts,
            device: self.gpu.report().timestamps.then_some(Duration::ZERO),
            bytes: 0,
            passes: 0,
        };
        for rows in self.bands(&bins, &cycles, hits, columns) {
            let squares = squares(&bins, &cycles, rows.start * columns..rows.end * columns);
            self.band(&squares, hits, rows, stop, &mut out)?;
        }
        Ok(out)
    }

    /// Rows of squares whose lists fit into bindings together; a row alone that does not is left to be refused by name.
    fn bands(&self, bins: &CellBins, cycles: &Cycles, hits: &Crossings, columns: usize) -> Vec<Range<usize>> {
        let p = &self.scene.projection;
        let mut out: Vec<Range<usize>> = Vec::new();
        let mut held = [u64::MAX; 3];
        for row in 0..p.height.div_ceil(SQUARE) {
            let cells = (row * columns..(row + 1) * columns).map(|s| match cycles.0.get(s) {
                // A stay is three words.
                Some(listed) => 3 * listed.len(),
                None => bins.lists(s).map(<[_]>::len).sum(),
            });
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

/// What a square lists: a cell, for all pixels or for the one of this number in the square.
type Listed = (u32, Option<u32>);

/// What each square lists, with the stays in cells of cycles one by one, each pixel's in their own order; empty where there are no cycles.
struct Cycles(Vec<Vec<Listed>>);

impl Cycles {
    fn new(mesh: &Cells, screen: &Screen, bins: &CellBins, groups: &HashMap<u32, u32>, columns: usize) -> Self {
        if groups.is_empty() {
            return Self(Vec::new());
        }
        let p = &screen.projection;
        let square = |number: usize| {
            let cells: Vec<u32> = bins.numbered(number).collect();
            let mut out = Vec::with_capacity(cells.len());
            for run in cells.chunk_by(|a, b| groups.contains_key(a) && groups.get(a) == groups.get(b)) {
                if groups.contains_key(&run[0]) {
                    let corner = [number % columns * SQUARE, number / columns * SQUARE];
                    stays(mesh, screen, run, corner, &mut out);
                } else {
                    out.push((run[0], None));
                }
            }
            out
        };
        Self((0..columns * p.height.div_ceil(SQUARE)).into_par_iter().map(square).collect())
    }
}

/// The stays of a square's pixels in some cells, each pixel's front to back.
fn stays(mesh: &Cells, screen: &Screen, cells: &[u32], corner: [usize; 2], out: &mut Vec<Listed>) {
    let (p, first) = (&screen.projection, screen.projection.first_pixel());
    let mut found: Vec<(u32, f64, f64, u32)> = Vec::new();
    for &cell in cells {
        let corners = mesh.cells[cell as usize].map(|i| screen.points[i as usize].at);
        let on_screen = CellOnScreen::new(p.perspective, &corners, &[0.0; 4]);
        for pixel in 0..SQUARE * SQUARE {
            let (x, y) = (corner[0] + pixel % SQUARE, corner[1] + pixel / SQUARE);
            if let Some(stay) = on_screen.stay(p.perspective, first[0] + x as f64, first[1] + y as f64) {
                found.push((pixel as u32, stay.from, stay.to, cell));
            }
        }
    }
    found.sort_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.total_cmp(&b.2)));
    out.extend(found.iter().map(|f| (f.3, Some(f.0))));
}

fn squares(bins: &CellBins, cycles: &Cycles, numbers: Range<usize>) -> Squares {
    let mut out = Squares {
        starts: Vec::with_capacity(numbers.len() + 1),
        listed: Vec::new(),
    };
    let mut apart: Vec<[u32; 2]> = Vec::new();
    for square in numbers {
        out.starts.push(out.listed.len() as u32);
        let Some(listed) = cycles.0.get(square) else {
            out.listed.extend(bins.numbered(square));
            continue;
        };
        for &(cell, pixel) in listed {
            out.listed.push(match pixel {
                None => cell,
                Some(pixel) => {
                    apart.push([cell, pixel]);
                    APART | (apart.len() - 1) as u32
                }
            });
        }
    }
    out.starts.push(out.listed.len() as u32);
    // Behind the squares' lists; their places count from there.
    let listed = out.listed.len() as u32;
    for code in out.listed.iter_mut().filter(|c| **c & APART != 0) {
        *code = APART | (listed + 2 * (*code & !APART));
    }
    out.listed.extend(apart.into_iter().flatten());
    out
}

/// The hits of all pixels, front to back: where those of each begin, and the end; depth, colour and minus the opacity.
pub(super) struct Crossings {
    starts: Vec<usize>,
    all: Vec<[f32; 5]>,
}

impl Crossings {
    /// To be called on the pool.
    pub(super) fn new(hits: &super::surfaces::Hits<'_>, surfaces: &Isovalues, look: Look<'_>, rays: RayGenerator<'_>) -> Self {
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
                        let c = hit_colour(surfaces, look, hits.cells, &ray, root);
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
