//! The renderer: what is kept between calls on the host and on the device.

use super::INFO;
use super::blocks::{self, Blocks, Builder};
use super::data;
use super::layout::{COLOUR, COUNT_ALL, NORMALS, Params, Ray, SKIP};
use super::programs::{Filter, Program};
use crate::given::Given;
use crate::support;
use bytemuck::Zeroable;
use isobar_core::{
    Channels, Counters, Data, Frame, Function, Knobs, Memory, RenderError, RenderTime, Renderer, Request, ResolvedKnobs, Stage,
    Stop, Surface, TransferFunction, View,
};
use isobar_cpu::Pool;
use isobar_fields::{GridSpline, Kind};
use isobar_gpu::bands::{Bands, Bindings, Hit};
use isobar_gpu::levels::{Level, MOST_LEVELS, levels_within};
use isobar_gpu::rays::{Rectangle, ToIndex};
use isobar_gpu::{Gpu, Kernel, Texel, Volume, wgpu};
use std::sync::Arc;
use std::time::{Duration, Instant};

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
    /// Coefficients on the device are those of the spline times this power of two, and isovalues have to be.
    scale: f64,
    blocks: Blocks,
    to_index: ToIndex,
    /// What depends on the data only; the rest is filled in by `render`.
    params: Params,
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
    bands: Bands<Hit>,
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
            bands: Bands::default(),
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
        let (volume, scale) = data::upload(&self.gpu, &spline)?;
        let to_index = ToIndex::new(&grid.domain(), false);
        let mut params = Params::zeroed();
        params.last = grid.dims.map(|n| (n - 1) as f32);
        params.axes = to_index.axes();
        params.gradients = to_index.gradients();
        blocks::describe(&mut params, grid.dims, settings.kind.basis().degree, self.gpu.binding_limit());
        let blocks = self.builder(volume.texel())?.build(&self.gpu, &volume, &params)?;
        Ok(Prepared {
            data: Arc::clone(data),
            spline,
            volume,
            scale,
            blocks,
            to_index,
            params,
        })
    }

    /// The bands of a view, with their rays.
    fn bands(&self, to_index: &ToIndex, view: &View) -> Result<Bands<Hit>, RenderError> {
        let rectangle = Rectangle::of(view, to_index.domain());
        Bands::new(&self.gpu, rectangle, self.request.layers, |y, rows| {
            self.pool
                .install(|| rectangle.rows(view, y, rows, |ray, kept| Ray::new(to_index, ray, kept)))
        })
    }

    fn unbind(&mut self) {
        self.given.changed();
        self.bands.unbind();
    }

    /// The uniform of the scene set.
    fn params(&self, base: Params, levels: usize, bias: [f32; 2]) -> Params {
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
            width: self.bands.rectangle().width as u32,
            ..base
        }
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
            self.bands = self.bands(&prepared.to_index, view)?;
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
            self.bands = self.bands(&p.to_index, view)?;
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
        let (surfaces, _) = self.given.scene()?;
        let start = Instant::now();
        self.samples = 0;
        self.gpu.check()?;
        let surface_of = |i| surfaces.surface(i);
        let values: Vec<f64> = surfaces.values().iter().map(|c| c * prepared.scale).collect();
        let (levels, bias) = levels_within(&values, surface_of, surfaces.all(), prepared.blocks.range);
        self.empty = levels.is_empty();
        if self.empty {
            self.given.drew();
            return Ok(RenderTime {
                wall: start.elapsed(),
                device: self.gpu.report().timestamps.then_some(Duration::ZERO),
            });
        }
        let params = self.params(prepared.params, levels.len(), bias);
        let program = Program::new(prepared.volume.texel(), self.settings.kind, self.settings.filter);
        let kernel = self
            .kernels
            .iter()
            .find(|(p, _)| *p == program)
            .map(|(_, k)| k.clone())
            .ok_or(RenderError::NotReady("set_data"))?;
        self.gpu.write(&self.uniform, bytemuck::bytes_of(&params))?;
        self.gpu.write(&self.levels, bytemuck::cast_slice(&levels))?;
        let common = [
            (0, wgpu::BindingResource::TextureView(prepared.volume.view())),
            (1, self.uniform.as_entire_binding()),
            (3, prepared.blocks.ranges.as_entire_binding()),
            (4, self.levels.as_entire_binding()),
        ];
        let own = Bindings {
            rays: 2,
            hits: 5,
            pixels: 6,
        };
        let device = self.bands.cast(&self.gpu, "march", &kernel, &common, own, stop)?;
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
            self.samples = self.bands.read(&self.gpu, view, out)?;
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
        let data = p.map_or(0, |p| p.volume.bytes() + p.blocks.ranges.size());
        Memory {
            coefficients: p.map_or(0, |p| p.spline.own_bytes() as u64),
            index: 0,
            view: self.bands.host_bytes(),
            device: data + self.bands.device_bytes() + self.uniform.size() + self.levels.size(),
        }
    }

    /// `samples` of the last frame read: the device counts per pixel, and they come back with the pixels.
    fn counters(&self) -> Counters {
        Counters(vec![("samples", self.samples)])
    }
}
