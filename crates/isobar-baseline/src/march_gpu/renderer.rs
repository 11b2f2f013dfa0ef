//! The renderer: what is kept between calls on the host and on the device.

use super::INFO;
use super::blocks::{self, Blocks, Builder};
use super::data;
use super::layout::{COLOUR, COUNT_ALL, Hit, Level, NORMALS, Params, Pixel, Ray, SKIP};
use super::programs::{Filter, Program};
use super::rays::{Entry, ToIndex};
use crate::given::Given;
use crate::support::{self, Isovalues};
use bytemuck::Zeroable;
use isobar_core::{
    Channels, Claim, Counters, Data, DataError, Frame, Function, Hit as FrameHit, Knobs, Memory, Pixel as FramePixel,
    RenderError, RenderTime, Renderer, Request, ResolvedKnobs, Stage, Stop, Surface, TransferFunction, View,
};
use isobar_cpu::Pool;
use isobar_fields::{GridSpline, Kind};
use isobar_gpu::{Gpu, Kernel, Texel, Volume, wgpu};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Pixels of one dispatch: short enough that `Stop` is seen and no driver's watchdog bites, long enough to fill a large GPU.
const CHUNK_PIXELS: usize = 1 << 16;
/// Most bytes on the device for rays and hits of one view.
const MOST_VIEW_BYTES: u64 = 4 << 30;
/// `Frame::surface` counts to 254, so that there are at most this many isovalues.
const MOST_LEVELS: u64 = 255;

/// Settings, read once.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Settings {
    kind: Kind,
    step: f32,
    bisections: u32,
    filter: Filter,
    skip: bool,
}

impl Settings {
    fn new(knobs: &Knobs) -> Result<Self, RenderError> {
        let k = ResolvedKnobs::new(INFO.knobs, knobs)?;
        Ok(Self {
            kind: k.word("reconstruction").parse()?,
            step: k.float("step") as f32,
            bisections: k.int("bisections") as u32,
            filter: Filter::named(k.word("filter")),
            skip: k.word("skip") == "on",
        })
    }
}

/// What is built for the data.
#[derive(Debug)]
struct Prepared {
    data: Arc<Data>,
    spline: GridSpline,
    volume: Volume,
    blocks: Blocks,
    to_index: ToIndex,
    /// What depends on the data only; the rest is filled in by `render`.
    params: Params,
}

/// Some rows of the view, with buffers of their own.
#[derive(Debug)]
struct Chunk {
    y: usize,
    rows: usize,
    entries: Vec<Entry>,
    rays: wgpu::Buffer,
    hits: wgpu::Buffer,
    pixels: wgpu::Buffer,
    bind: Option<wgpu::BindGroup>,
}

impl Chunk {
    fn device_bytes(&self) -> u64 {
        self.rays.size() + self.hits.size() + self.pixels.size()
    }
}

/// A renderer of `march/gpu`.
#[derive(Debug)]
pub(super) struct MarchRenderer {
    gpu: Gpu,
    pool: Pool,
    request: Request,
    settings: Settings,
    kernels: Vec<(Program, Kernel)>,
    builders: Vec<(&'static str, Builder)>,
    uniform: wgpu::Buffer,
    levels: wgpu::Buffer,
    prepared: Option<Prepared>,
    given: Given,
    chunks: Vec<Chunk>,
    /// No isovalue lies in the range of the data: no kernel ran.
    empty: bool,
    samples: u64,
}

impl MarchRenderer {
    /// Compiles the kernels of the knobs for every texel type.
    pub(super) fn new(gpu: Gpu, request: &Request) -> Result<Self, RenderError> {
        let settings = Settings::new(&request.knobs)?;
        let mut new = Self {
            given: Given::new(&INFO, request)?,
            pool: Pool::new(request.threads)?,
            uniform: gpu.uniform("parameters", &Params::zeroed())?,
            levels: gpu.storage_empty("isovalues", MOST_LEVELS * size_of::<Level>() as u64)?,
            gpu,
            request: request.clone(),
            settings,
            kernels: Vec::new(),
            builders: Vec::new(),
            prepared: None,
            chunks: Vec::new(),
            empty: false,
            samples: 0,
        };
        for program in Program::all(settings.kind, settings.filter) {
            new.kernel(program)?;
        }
        for texel in [Texel::F32, Texel::U8, Texel::I16] {
            new.builder(texel)?;
        }
        Ok(new)
    }

    /// The kernel of a program, compiled at its first use.
    fn kernel(&mut self, program: Program) -> Result<Kernel, RenderError> {
        if let Some((_, k)) = self.kernels.iter().find(|(p, _)| *p == program) {
            return Ok(k.clone());
        }
        let kernel = program.march(&self.gpu)?;
        self.kernels.push((program, kernel.clone()));
        Ok(kernel)
    }

    /// The kernels that build blocks, compiled at their first use.
    fn builder(&mut self, texel: Texel) -> Result<Builder, RenderError> {
        if let Some((_, b)) = self.builders.iter().find(|(s, _)| *s == texel.snippet()) {
            return Ok(b.clone());
        }
        let builder = Builder::new(&self.gpu, texel)?;
        self.builders.push((texel.snippet(), builder.clone()));
        Ok(builder)
    }

    fn prepare(&mut self, data: &Arc<Data>, settings: &Settings) -> Result<Prepared, RenderError> {
        let grid = support::grid(&INFO, data)?;
        let spline = self.pool.install(|| GridSpline::new(grid, settings.kind, Stage::Stored))?;
        let volume = data::upload(&self.gpu, &spline)?;
        let to_index = ToIndex::new(&grid.domain());
        let mut params = Params::zeroed();
        params.last = grid.dims.map(|n| (n - 1) as f32);
        params.axes = to_index.axes();
        params.gradients = to_index.gradients();
        blocks::describe(&mut params, grid.dims, settings.kind.basis().degree, self.gpu.binding_limit());
        let blocks = self.builder(volume.texel())?.build(&self.gpu, &volume, &params)?;
        if !(blocks.range[1] - blocks.range[0]).is_finite() {
            return Err(RenderError::Data(DataError::Unknown(
                "the samples span more than f32 holds; scale them down, or use a cpu method".into(),
            )));
        }
        Ok(Prepared {
            data: Arc::clone(data),
            spline,
            volume,
            blocks,
            to_index,
            params,
        })
    }

    /// The chunks of a view, with their rays.
    fn chunks(&self, to_index: &ToIndex, view: &View) -> Result<Vec<Chunk>, RenderError> {
        let layers = self.request.layers.max(1) as u64;
        let row = view.width as u64;
        let hit_row = (size_of::<Hit>() as u64).saturating_mul(row).saturating_mul(layers);
        let other_row = row * (size_of::<Ray>() + size_of::<Pixel>()) as u64;
        let total = hit_row.saturating_add(other_row).saturating_mul(view.height as u64);
        if total > MOST_VIEW_BYTES {
            return Err(RenderError::Memory {
                what: format!("{}x{} pixels with {layers} layers", view.width, view.height),
                bytes: total,
                limit: MOST_VIEW_BYTES,
            });
        }
        let widest = hit_row.max(row * size_of::<Ray>() as u64);
        let fit = (self.gpu.binding_limit() / widest).max(1) as usize;
        let rows = CHUNK_PIXELS.div_ceil(view.width).min(fit);
        // Whole workgroups, where there is more than one.
        let rows = if rows > 8 { rows & !7 } else { rows };
        (0..view.height)
            .step_by(rows)
            .map(|y| {
                let rows = rows.min(view.height - y);
                let pixels = (rows * view.width) as u64;
                let (rays, entries) = self.pool.install(|| to_index.rows(view, y, rows));
                Ok(Chunk {
                    y,
                    rows,
                    entries,
                    rays: self.gpu.storage("rays", &rays)?,
                    hits: self.gpu.storage_empty("hits", hit_row * rows as u64)?,
                    pixels: self.gpu.storage_empty("pixels", pixels * size_of::<Pixel>() as u64)?,
                    bind: None,
                })
            })
            .collect()
    }

    fn unbind(&mut self) {
        self.given.changed();
        for c in &mut self.chunks {
            c.bind = None;
        }
    }

    /// Isovalues inside the range of the data, ascending, less the bias, and the bias as a sum of two f32.
    fn search(surfaces: &Isovalues, range: [f32; 2]) -> (Vec<Level>, [f32; 2]) {
        let within: Vec<(usize, f64)> = surfaces
            .values()
            .iter()
            .copied()
            .enumerate()
            .filter(|(_, c)| f64::from(range[0]) <= *c && *c <= f64::from(range[1]))
            .collect();
        let bias = match (within.first(), within.last()) {
            (Some(a), Some(b)) => 0.5 * a.1 + 0.5 * b.1,
            _ => 0.0,
        };
        let hi = bias as f32;
        let lo = (bias - f64::from(hi)) as f32;
        let levels = within
            .into_iter()
            .map(|(i, c)| {
                let surface = surfaces.surface(i);
                let s = &surfaces.all()[usize::from(surface)];
                Level {
                    value: (c - bias) as f32,
                    opacity: s.opacity.clamp(0.0, 1.0),
                    surface: u32::from(surface),
                    unused: 0,
                    colour: s.colour,
                    unused_1: 0.0,
                }
            })
            .collect();
        (levels, [hi, lo])
    }

    /// The uniform of the scene set.
    fn params(&self, base: Params, levels: usize, bias: [f32; 2], width: usize) -> Params {
        let has = |c, bit| if self.request.channels.contains(c) { bit } else { 0 };
        Params {
            step: self.settings.step,
            bias_hi: bias[0],
            bias_lo: bias[1],
            fractions: self.settings.filter.fractions(),
            bisections: self.settings.bisections,
            levels: levels as u32,
            layers: self.request.layers.clamp(1, u32::MAX as usize) as u32,
            flags: has(Channels::HITS, COUNT_ALL)
                | has(Channels::RGBA, COLOUR)
                | has(Channels::NORMAL, NORMALS)
                | if self.settings.skip { SKIP } else { 0 },
            width: width as u32,
            ..base
        }
    }

    /// Copies the hits of a chunk into the frame; returns the samples taken.
    fn collect(&self, chunk: &Chunk, view: &View, out: &mut Frame) -> Result<u64, RenderError> {
        let count = chunk.rows * view.width;
        let layers = self.request.layers.max(1);
        let pixels: Vec<Pixel> = self.gpu.read(&chunk.pixels, count)?;
        let deepest = pixels.iter().map(|p| p.hits as usize).max().unwrap_or(0).min(layers);
        let hits: Vec<Hit> = self.gpu.read(&chunk.hits, deepest * count)?;
        let generator = self.request.channels.contains(Channels::POINT).then(|| view.generator());
        let first = chunk.y * view.width;
        let mut samples = 0;
        for (i, (p, entry)) in pixels.iter().zip(&chunk.entries).enumerate() {
            let at = first + i;
            for layer in 0..layers.min(p.hits as usize) {
                let h = &hits[layer * count + i];
                let t = entry.t + f64::from(h.u) / entry.speed;
                let mut hit = FrameHit {
                    t,
                    normal: h.normal,
                    surface: h.surface as u8,
                    ..FrameHit::NONE
                };
                if let Some(g) = &generator {
                    hit.point = g.ray(at % view.width, at / view.width).at(t);
                }
                out.set_hit(layer, at, &hit);
            }
            samples += u64::from(p.work);
            let pixel = FramePixel {
                hits: p.hits.min(u32::from(u16::MAX)) as u16,
                claim: Claim::empty(),
                rgba: p.rgba,
                work: p.work,
            };
            out.set_pixel(at, &pixel);
        }
        Ok(samples)
    }
}

impl Renderer for MarchRenderer {
    fn set_data(&mut self, data: &Arc<Data>) -> Result<(), RenderError> {
        let settings = self.settings;
        let prepared = self.prepare(data, &settings)?;
        let program = Program::new(prepared.volume.texel(), settings.kind, settings.filter);
        self.kernel(program)?;
        let moved = self
            .prepared
            .as_ref()
            .is_none_or(|p| *p.spline.domain() != *prepared.spline.domain());
        if let (true, Some(view)) = (moved, self.given.view()) {
            self.chunks = self.chunks(&prepared.to_index, view)?;
        }
        self.prepared = Some(prepared);
        self.unbind();
        Ok(())
    }

    fn set_surfaces(&mut self, surfaces: &[Surface]) -> Result<(), RenderError> {
        self.given.set_surfaces(self.given.isovalues(surfaces)?);
        Ok(())
    }

    fn set_medium(&mut self, medium: Option<&TransferFunction>) -> Result<(), RenderError> {
        self.given.set_medium(medium)
    }

    fn set_view(&mut self, view: &View) -> Result<(), RenderError> {
        self.given.check_view(view)?;
        if let Some(p) = &self.prepared {
            self.chunks = self.chunks(&p.to_index, view)?;
        }
        self.given.set_view(view);
        Ok(())
    }

    fn set_knobs(&mut self, knobs: &Knobs) -> Result<(), RenderError> {
        let settings = Settings::new(knobs)?;
        if let Some(p) = &self.prepared {
            let same = p.spline.kind() == settings.kind;
            let data = Arc::clone(&p.data);
            let texel = p.volume.texel();
            let texel = if same {
                texel
            } else {
                let prepared = self.prepare(&data, &settings)?;
                let texel = prepared.volume.texel();
                self.prepared = Some(prepared);
                texel
            };
            self.kernel(Program::new(texel, settings.kind, settings.filter))?;
        }
        self.settings = settings;
        self.unbind();
        Ok(())
    }

    fn render(&mut self, stop: &Stop) -> Result<RenderTime, RenderError> {
        let prepared = self.prepared.as_ref().ok_or(RenderError::NotReady("set_data"))?;
        self.given.changed();
        let (surfaces, view) = self.given.scene()?;
        let start = Instant::now();
        self.samples = 0;
        self.gpu.check()?;
        let (levels, bias) = Self::search(surfaces, prepared.blocks.range);
        self.empty = levels.is_empty();
        if self.empty {
            self.given.drew();
            return Ok(RenderTime {
                wall: start.elapsed(),
                device: self.gpu.report().timestamps.then_some(Duration::ZERO),
            });
        }
        let params = self.params(prepared.params, levels.len(), bias, view.width);
        let program = Program::new(prepared.volume.texel(), self.settings.kind, self.settings.filter);
        let kernel = self
            .kernels
            .iter()
            .find(|(p, _)| *p == program)
            .map(|(_, k)| k.clone())
            .ok_or(RenderError::NotReady("set_data"))?;
        self.gpu.write(&self.uniform, bytemuck::bytes_of(&params))?;
        self.gpu.write(&self.levels, bytemuck::cast_slice(&levels))?;
        let mut device = Some(Duration::ZERO);
        stop.begin(self.chunks.len() as u64);
        for chunk in &mut self.chunks {
            if stop.is_raised() {
                return Err(RenderError::Stopped);
            }
            if chunk.bind.is_none() {
                let resources = [
                    (0, wgpu::BindingResource::TextureView(prepared.volume.view())),
                    (1, self.uniform.as_entire_binding()),
                    (2, chunk.rays.as_entire_binding()),
                    (3, prepared.blocks.ranges.as_entire_binding()),
                    (4, self.levels.as_entire_binding()),
                    (5, chunk.hits.as_entire_binding()),
                    (6, chunk.pixels.as_entire_binding()),
                ];
                chunk.bind = Some(kernel.bind(&self.gpu, &resources)?);
            }
            let groups = [view.width.div_ceil(8) as u32, chunk.rows.div_ceil(8) as u32, 1];
            let times = self.gpu.run("march", 1, |w| {
                if let Some(bind) = &chunk.bind {
                    w.compute(&kernel, bind, groups);
                }
            })?;
            device = device.zip(times).map(|(sum, t)| sum + t.iter().sum::<Duration>());
            stop.step();
        }
        self.given.drew();
        Ok(RenderTime {
            wall: start.elapsed(),
            device,
        })
    }

    fn read(&mut self, out: &mut Frame) -> Result<(), RenderError> {
        let view = self.given.frame()?;
        out.reset(view.width, view.height, self.request.layers.max(1), self.request.channels);
        if !self.empty {
            let mut samples = 0;
            for chunk in &self.chunks {
                samples += self.collect(chunk, view, out)?;
            }
            self.samples = samples;
        }
        Ok(())
    }

    fn reconstruction(&self, stage: Stage) -> Option<Arc<dyn Function>> {
        let p = self.prepared.as_ref()?;
        if stage == Stage::Stored || !p.spline.kind().interpolates() {
            return Some(Arc::new(p.spline.clone()));
        }
        let ideal = self.pool.install(|| GridSpline::new(p.spline.grid(), p.spline.kind(), stage));
        ideal.ok().map(|s| Arc::new(s) as Arc<dyn Function>)
    }

    fn memory(&self) -> Memory {
        let p = self.prepared.as_ref();
        let entries = self.chunks.iter().map(|c| c.entries.capacity() * size_of::<Entry>());
        let data = p.map_or(0, |p| p.volume.bytes() + p.blocks.ranges.size());
        let view: u64 = self.chunks.iter().map(Chunk::device_bytes).sum();
        Memory {
            coefficients: p.map_or(0, |p| p.spline.own_bytes() as u64),
            index: 0,
            view: entries.sum::<usize>() as u64,
            device: data + view + self.uniform.size() + self.levels.size(),
        }
    }

    /// `samples` of the last frame read: the device counts per pixel, and they come back with the pixels.
    fn counters(&self) -> Counters {
        Counters(vec![("samples", self.samples)])
    }
}
