//! The renderer: what is kept between calls on the host and on the device.

use super::INFO;
use super::bricks::{Active, Bricks};
use super::claims::Prover;
use super::data::{self, Prepared};
use super::generate::Loops;
use super::layout::{COLOUR, COUNT_ALL, Hit, Level, NORMALS, Params, Pixel, Ray};
use super::programs::{Kernels, Program};
use bytemuck::Zeroable;
use isobar_core::{
    Channels, Claim, Counters, Data, Frame, Function, Hit as FrameHit, Knobs, Memory, NO_SURFACE, Pixel as FramePixel,
    RenderError, RenderTime, Renderer, Request, ResolvedKnobs, Stage, Stop, Surface, TransferFunction, View,
};
use isobar_cpu::Pool;
use isobar_cpu::scene::{Isovalues, check_medium, check_open_cuts};
use isobar_fields::{GridSpline, Kind};
use isobar_gpu::rays::{Entry, Rectangle};
use isobar_gpu::{Gpu, Texel, wgpu};
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
    loops: Loops,
    claims: bool,
}

impl Settings {
    fn new(knobs: &Knobs) -> Result<Self, RenderError> {
        let k = ResolvedKnobs::new(INFO.knobs, knobs)?;
        Ok(Self {
            kind: k.word("reconstruction").parse()?,
            loops: if k.word("loops") == "looped" {
                Loops::Looped
            } else {
                Loops::Unrolled
            },
            claims: k.word("claims") == "cpu",
        })
    }
}

/// Some rows of the rectangle of the view that sees the volume, with buffers of their own.
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

/// What depends on data and surfaces.
#[derive(Debug)]
struct Search {
    active: Active,
    levels: Vec<Level>,
    bias: [f32; 2],
}

/// A renderer of `octree/gpu`.
#[derive(Debug)]
pub(super) struct OctreeRenderer {
    gpu: Gpu,
    pool: Pool,
    request: Request,
    settings: Settings,
    kernels: Vec<(Program, Kernels)>,
    uniform: wgpu::Buffer,
    levels: wgpu::Buffer,
    prepared: Option<Prepared>,
    given: Vec<Surface>,
    surfaces: Option<Isovalues>,
    view: Option<View>,
    search: Option<Search>,
    rectangle: Rectangle,
    chunks: Vec<Chunk>,
    prover: Option<Prover>,
    drawn: bool,
    visited: u64,
}

impl OctreeRenderer {
    /// Compiles the kernels of the knobs for every texel type.
    pub(super) fn new(gpu: Gpu, request: &Request) -> Result<Self, RenderError> {
        let settings = Settings::new(&request.knobs)?;
        let mut new = Self {
            pool: Pool::new(request.threads)?,
            uniform: gpu.uniform("parameters", &Params::zeroed())?,
            levels: gpu.storage_empty("isovalues", MOST_LEVELS * size_of::<Level>() as u64)?,
            gpu,
            request: request.clone(),
            settings,
            kernels: Vec::new(),
            prepared: None,
            given: Vec::new(),
            surfaces: None,
            view: None,
            search: None,
            rectangle: Rectangle::default(),
            chunks: Vec::new(),
            prover: None,
            drawn: false,
            visited: 0,
        };
        for texel in [Texel::F32, Texel::U8, Texel::I16] {
            new.kernels(Program::new(texel, settings.kind, settings.loops))?;
        }
        new.prover = new.prover(&settings)?;
        Ok(new)
    }

    /// The kernels of a program, compiled at its first use.
    fn kernels(&mut self, program: Program) -> Result<Kernels, RenderError> {
        if let Some((_, k)) = self.kernels.iter().find(|(p, _)| *p == program) {
            return Ok(k.clone());
        }
        let kernels = program.kernels(&self.gpu)?;
        self.kernels.push((program, kernels.clone()));
        Ok(kernels)
    }

    /// The second caster, with the scene set so far, where claims are wanted and asked for.
    fn prover(&self, settings: &Settings) -> Result<Option<Prover>, RenderError> {
        if !settings.claims || !self.request.channels.intersects(Channels::CLAIM | Channels::T_ERROR) {
            return Ok(None);
        }
        let mut p = Prover::new(&self.request, settings.kind)?;
        if let Some(prepared) = &self.prepared {
            p.set_data(&prepared.data)?;
        }
        if self.surfaces.is_some() {
            p.set_surfaces(&self.given)?;
        }
        if let Some(view) = &self.view {
            p.set_view(view)?;
        }
        Ok(Some(p))
    }

    fn prepare(&mut self, data: &Arc<Data>, settings: &Settings) -> Result<Prepared, RenderError> {
        let texel = data::texel(data, settings.kind)?;
        let kernels = self.kernels(Program::new(texel, settings.kind, settings.loops))?;
        self.pool.install(|| Prepared::new(&self.gpu, &kernels, data, settings.kind))
    }

    /// Takes new data, or the same prepared otherwise.
    fn replace(&mut self, prepared: Prepared) -> Result<(), RenderError> {
        let moved = self
            .prepared
            .as_ref()
            .is_none_or(|p| *p.spline.domain() != *prepared.spline.domain() || p.spline.kind() != prepared.spline.kind());
        if let (true, Some(view)) = (moved, &self.view) {
            (self.rectangle, self.chunks) = self.chunks(&prepared, view)?;
        }
        self.prepared = Some(prepared);
        self.search = None;
        self.unbind();
        Ok(())
    }

    /// The rectangle of a view that sees the domain, and its chunks with their rays.
    fn chunks(&self, prepared: &Prepared, view: &View) -> Result<(Rectangle, Vec<Chunk>), RenderError> {
        let rectangle = Rectangle::of(view, prepared.spline.domain());
        let layers = self.request.layers.max(1) as u64;
        let row = rectangle.width as u64;
        let hit_row = (size_of::<Hit>() as u64).saturating_mul(row).saturating_mul(layers);
        let other_row = row * (size_of::<Ray>() + size_of::<Pixel>()) as u64;
        let total = hit_row.saturating_add(other_row).saturating_mul(rectangle.height as u64);
        if total > MOST_VIEW_BYTES {
            return Err(RenderError::Memory {
                what: format!("{}x{} pixels with {layers} layers", rectangle.width, rectangle.height),
                bytes: total,
                limit: MOST_VIEW_BYTES,
            });
        }
        if rectangle.width * rectangle.height == 0 {
            return Ok((rectangle, Vec::new()));
        }
        let widest = hit_row.max(row * size_of::<Ray>() as u64);
        let fit = (self.gpu.binding_limit() / widest).max(1) as usize;
        let rows = CHUNK_PIXELS.div_ceil(rectangle.width).min(fit);
        // Whole workgroups, where there is more than one.
        let rows = if rows > 8 { rows & !7 } else { rows };
        let end = rectangle.y + rectangle.height;
        let chunks = (rectangle.y..end).step_by(rows).map(|y| {
            let rows = rows.min(end - y);
            let pixels = (rows * rectangle.width) as u64;
            let (rays, entries) = self.pool.install(|| prepared.to_index.rows(view, rectangle, y, rows));
            Ok(Chunk {
                y,
                rows,
                entries,
                rays: self.gpu.storage("rays", &rays)?,
                hits: self.gpu.storage_empty("hits", hit_row * rows as u64)?,
                pixels: self.gpu.storage_empty("pixels", pixels * size_of::<Pixel>() as u64)?,
                bind: None,
            })
        });
        Ok((rectangle, chunks.collect::<Result<_, RenderError>>()?))
    }

    fn unbind(&mut self) {
        self.drawn = false;
        for c in &mut self.chunks {
            c.bind = None;
        }
    }

    /// Isovalues inside the range of the data, ascending, less the bias, and the bias as a sum of two f32.
    fn levels(surfaces: &Isovalues, range: [f32; 2]) -> (Vec<Level>, [f32; 2]) {
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
    fn params(&self, prepared: &Prepared, search: &Search) -> Params {
        let has = |c, bit| if self.request.channels.contains(c) { bit } else { 0 };
        Params {
            bias_hi: search.bias[0],
            bias_lo: search.bias[1],
            levels: search.levels.len() as u32,
            layers: self.request.layers.clamp(1, u32::MAX as usize) as u32,
            flags: prepared.params.flags
                | has(Channels::HITS, COUNT_ALL)
                | has(Channels::RGBA, COLOUR)
                | has(Channels::NORMAL, NORMALS),
            width: self.rectangle.width as u32,
            ..prepared.params
        }
    }

    /// Marks what the isovalues can meet, where data or surfaces are new: first thing of a `render`.
    fn ensure_search(&mut self, kernels: &Kernels) -> Result<(), RenderError> {
        let (Some(prepared), Some(surfaces)) = (&self.prepared, &self.surfaces) else {
            return Err(RenderError::NotReady("set_surfaces"));
        };
        if self.search.is_some() {
            return Ok(());
        }
        let bricks: &Bricks = &prepared.bricks;
        let (levels, bias) = Self::levels(surfaces, bricks.range);
        self.gpu.write(&self.levels, bytemuck::cast_slice(&levels))?;
        let params = Params {
            bias_hi: bias[0],
            bias_lo: bias[1],
            levels: levels.len() as u32,
            ..prepared.params
        };
        let active = self
            .pool
            .install(|| bricks.mark(&self.gpu, kernels, &prepared.volume, &params, &levels, &self.levels))?;
        self.search = Some(Search { active, levels, bias });
        self.unbind();
        Ok(())
    }

    /// Runs the caster over all chunks; the device time.
    fn cast(&mut self, kernels: &Kernels, stop: &Stop) -> Result<Option<Duration>, RenderError> {
        let (Some(prepared), Some(search)) = (&self.prepared, &self.search) else {
            return Err(RenderError::NotReady("set_surfaces"));
        };
        let mut device = self.gpu.report().timestamps.then_some(Duration::ZERO);
        if search.active.count == 0 {
            return Ok(device);
        }
        let params = self.params(prepared, search);
        self.gpu.write(&self.uniform, bytemuck::bytes_of(&params))?;
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
                    (3, search.active.nodes.as_entire_binding()),
                    (4, search.active.cells.as_entire_binding()),
                    (5, self.levels.as_entire_binding()),
                    (6, chunk.hits.as_entire_binding()),
                    (7, chunk.pixels.as_entire_binding()),
                ];
                chunk.bind = Some(kernels.cast.bind(&self.gpu, &resources)?);
            }
            let groups = [self.rectangle.width.div_ceil(8) as u32, chunk.rows.div_ceil(8) as u32, 1];
            let times = self.gpu.run("octree caster", 1, |w| {
                if let Some(bind) = &chunk.bind {
                    w.compute(&kernels.cast, bind, groups);
                }
            })?;
            device = device.zip(times).map(|(sum, t)| sum + t.iter().sum::<Duration>());
            stop.step();
        }
        Ok(device)
    }

    /// Copies the hits of a chunk into the frame; returns the cells visited.
    fn collect(&self, chunk: &Chunk, view: &View, out: &mut Frame) -> Result<u64, RenderError> {
        let count = chunk.rows * self.rectangle.width;
        let layers = self.request.layers.max(1);
        let pixels: Vec<Pixel> = self.gpu.read(&chunk.pixels, count)?;
        let deepest = pixels.iter().map(|p| p.hits as usize).max().unwrap_or(0).min(layers);
        let hits: Vec<Hit> = self.gpu.read(&chunk.hits, deepest * count)?;
        let generator = self.request.channels.contains(Channels::POINT).then(|| view.generator());
        let mut visited = 0;
        for (i, (p, entry)) in pixels.iter().zip(&chunk.entries).enumerate() {
            let x = self.rectangle.x + i % self.rectangle.width;
            let y = chunk.y + i / self.rectangle.width;
            let at = y * view.width + x;
            for layer in 0..layers.min(p.hits as usize) {
                let h = &hits[layer * count + i];
                let u = f64::from(h.whole) + f64::from(h.u);
                let t = entry.t + u.max(0.0) / entry.speed;
                let mut hit = FrameHit {
                    t,
                    normal: h.normal,
                    surface: h.surface as u8,
                    ..FrameHit::NONE
                };
                if let Some(g) = &generator {
                    hit.point = g.ray(x, y).at(t);
                }
                out.set_hit(layer, at, &hit);
            }
            visited += u64::from(p.work);
            let pixel = FramePixel {
                hits: p.hits.min(u32::from(u16::MAX)) as u16,
                claim: Claim::empty(),
                rgba: p.rgba,
                work: p.work,
            };
            out.set_pixel(at, &pixel);
        }
        Ok(visited)
    }

    /// Writes what the CPU proved into the frame.
    fn claim(&mut self, out: &mut Frame) {
        let (Some(prover), Some(prepared), Some(view)) = (&mut self.prover, &self.prepared, &self.view) else {
            return;
        };
        (prover.proved, prover.unlike) = (0, 0);
        let generator = view.generator();
        let voxel = prepared.spline.domain().voxel();
        for i in 0..view.pixels() {
            let t = out.t.get(i).copied().unwrap_or(f64::INFINITY);
            let surface = out.surface.get(i).copied().unwrap_or(NO_SURFACE);
            let speed = generator.ray(i % view.width, i / view.width).direction.length();
            let (claim, error) = prover.claim(i, t, surface, voxel / speed);
            if let Some(c) = out.claim.get_mut(i) {
                *c = claim;
            }
            if let Some(e) = out.t_error.get_mut(i) {
                *e = error;
            }
        }
    }
}

impl Renderer for OctreeRenderer {
    fn set_data(&mut self, data: &Arc<Data>) -> Result<(), RenderError> {
        let settings = self.settings;
        let prepared = self.prepare(data, &settings)?;
        if let Some(p) = &mut self.prover {
            p.set_data(data)?;
        }
        self.replace(prepared)
    }

    fn set_surfaces(&mut self, surfaces: &[Surface]) -> Result<(), RenderError> {
        self.surfaces = Some(Isovalues::new(&INFO, surfaces)?);
        self.given = surfaces.to_vec();
        self.search = None;
        self.drawn = false;
        if let Some(p) = &mut self.prover {
            p.set_surfaces(surfaces)?;
        }
        Ok(())
    }

    fn set_medium(&mut self, medium: Option<&TransferFunction>) -> Result<(), RenderError> {
        Ok(check_medium(&INFO, medium)?)
    }

    fn set_view(&mut self, view: &View) -> Result<(), RenderError> {
        check_open_cuts(&INFO, view)?;
        view.validate()?;
        if let Some(p) = &self.prepared {
            (self.rectangle, self.chunks) = self.chunks(p, view)?;
        }
        self.view = Some(view.clone());
        self.drawn = false;
        if let Some(p) = &mut self.prover {
            p.set_view(view)?;
        }
        Ok(())
    }

    fn set_knobs(&mut self, knobs: &Knobs) -> Result<(), RenderError> {
        let settings = Settings::new(knobs)?;
        if settings == self.settings {
            return Ok(());
        }
        let prover = self.prover(&settings)?;
        if let Some(p) = &self.prepared {
            let (data, texel) = (Arc::clone(&p.data), p.volume.texel());
            if p.spline.kind() == settings.kind {
                self.kernels(Program::new(texel, settings.kind, settings.loops))?;
            } else {
                let prepared = self.prepare(&data, &settings)?;
                self.replace(prepared)?;
            }
        }
        self.settings = settings;
        self.prover = prover;
        self.unbind();
        Ok(())
    }

    fn render(&mut self, stop: &Stop) -> Result<RenderTime, RenderError> {
        let prepared = self.prepared.as_ref().ok_or(RenderError::NotReady("set_data"))?;
        let texel = prepared.volume.texel();
        self.surfaces.as_ref().ok_or(RenderError::NotReady("set_surfaces"))?;
        self.view.as_ref().ok_or(RenderError::NotReady("set_view"))?;
        let start = Instant::now();
        self.drawn = false;
        if stop.is_raised() {
            return Err(RenderError::Stopped);
        }
        self.visited = 0;
        self.gpu.check()?;
        let kernels = self.kernels(Program::new(texel, self.settings.kind, self.settings.loops))?;
        self.ensure_search(&kernels)?;
        let device = self.cast(&kernels, stop)?;
        if let Some(p) = &mut self.prover {
            p.prove(stop)?;
        }
        self.drawn = true;
        Ok(RenderTime {
            wall: start.elapsed(),
            device,
        })
    }

    fn read(&mut self, out: &mut Frame) -> Result<(), RenderError> {
        let (Some(view), Some(search), true) = (&self.view, &self.search, self.drawn) else {
            return Err(RenderError::NotReady("render"));
        };
        // The proof compares t and surface, asked for or not.
        let channels = self.request.channels;
        let needed = if self.prover.is_some() {
            channels | Channels::T | Channels::SURFACE
        } else {
            channels
        };
        out.reset(view.width, view.height, self.request.layers.max(1), needed);
        if search.active.count > 0 {
            let mut visited = 0;
            for chunk in &self.chunks {
                visited += self.collect(chunk, view, out)?;
            }
            self.visited = visited;
        }
        self.claim(out);
        if needed != channels {
            out.channels = channels;
            if !channels.contains(Channels::T) {
                out.t.clear();
            }
            if !channels.contains(Channels::SURFACE) {
                out.surface.clear();
            }
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
        let entries = self.chunks.iter().map(|c| c.entries.capacity() * size_of::<Entry>());
        let view: u64 = self.chunks.iter().map(Chunk::device_bytes).sum();
        let active = self
            .search
            .as_ref()
            .map_or(0, |s| s.active.nodes.size() + s.active.cells.size());
        let p = self.prepared.as_ref();
        let prover = self.prover.as_ref().map_or_else(Memory::default, Prover::memory);
        Memory {
            coefficients: p.map_or(0, |p| p.spline.own_bytes() as u64) + prover.coefficients,
            index: p.map_or(0, |p| p.bricks.bytes()) + prover.index,
            view: entries.sum::<usize>() as u64 + prover.view,
            device: p.map_or(0, |p| p.volume.bytes()) + active + view + self.uniform.size() + self.levels.size(),
        }
    }

    /// `cells` of the last frame read: the device counts per pixel, and they come back with the pixels. With `claims=cpu` also what the
    /// proof took and said.
    fn counters(&self) -> Counters {
        let mut out = vec![
            ("cells", self.visited),
            ("active bricks", self.search.as_ref().map_or(0, |s| s.active.count as u64)),
            ("pixels launched", (self.rectangle.width * self.rectangle.height) as u64),
        ];
        if let Some(p) = &self.prover {
            out.push(("proof microseconds", p.time.as_micros() as u64));
            out.push(("pixels proved", p.proved));
            out.push(("pixels unlike the cpu", p.unlike));
        }
        Counters(out)
    }
}
