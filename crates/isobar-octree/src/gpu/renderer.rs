//! The renderer: what is kept between calls on the host and on the device.

use super::INFO;
use super::bricks::{Active, Bricks};
use super::data::{self, Prepared};
use super::generate::Loops;
use super::layout::{COLOUR, COUNT_ALL, Hit, NORMALS, Params};
use super::programs::{Kernels, Program};
use crate::OCTREE_CPU;
use bytemuck::Zeroable;
use isobar_core::{
    Channels, Counters, Data, Frame, Function, Knobs, Memory, RenderError, RenderTime, Renderer, Request, ResolvedKnobs, Stage,
    Stop, Surface, TransferFunction, View,
};
use isobar_cpu::Pool;
use isobar_cpu::scene::{Isovalues, check_medium, check_open_cuts};
use isobar_fields::{GridSpline, Kind};
use isobar_gpu::bands::{Bands, Bindings};
use isobar_gpu::levels::{Level, MOST_LEVELS, levels_within};
use isobar_gpu::rays::Rectangle;
use isobar_gpu::{Gpu, Prover, Texel, wgpu};
use std::sync::Arc;
use std::time::{Duration, Instant};

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
    bands: Bands<Hit>,
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
            bands: Bands::default(),
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
        let knobs = Knobs::default().with("reconstruction", settings.kind).with("claims", "on");
        let mut p = Prover::new(&OCTREE_CPU, &self.request, knobs)?;
        let surfaces = self.surfaces.as_ref().map(|_| self.given.as_slice());
        p.set(self.prepared.as_ref().map(|p| &p.data), surfaces, self.view.as_ref())?;
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
            self.bands = self.bands(&prepared, view)?;
        }
        self.prepared = Some(prepared);
        self.search = None;
        self.unbind();
        Ok(())
    }

    /// The pixels of a view that see the domain, with their rays.
    fn bands(&self, prepared: &Prepared, view: &View) -> Result<Bands<Hit>, RenderError> {
        let rectangle = Rectangle::of(view, prepared.spline.domain());
        Bands::new(&self.gpu, rectangle, self.request.layers, |y, rows| {
            self.pool.install(|| prepared.to_index.rows(view, rectangle, y, rows))
        })
    }

    fn unbind(&mut self) {
        self.drawn = false;
        self.bands.unbind();
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
            width: self.bands.rectangle().width as u32,
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
        let surface_of = |i| surfaces.surface(i);
        let values: Vec<f64> = surfaces.values().iter().map(|c| c * prepared.scale).collect();
        let (levels, bias) = levels_within(&values, surface_of, surfaces.all(), bricks.range);
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

    /// Runs the caster over all bands; the device time.
    fn cast(&mut self, kernels: &Kernels, stop: &Stop) -> Result<Option<Duration>, RenderError> {
        let (Some(prepared), Some(search)) = (&self.prepared, &self.search) else {
            return Err(RenderError::NotReady("set_surfaces"));
        };
        if search.active.count == 0 {
            return Ok(self.gpu.report().timestamps.then_some(Duration::ZERO));
        }
        let params = self.params(prepared, search);
        self.gpu.write(&self.uniform, bytemuck::bytes_of(&params))?;
        let common = [
            (0, wgpu::BindingResource::TextureView(prepared.volume.view())),
            (1, self.uniform.as_entire_binding()),
            (3, search.active.nodes.as_entire_binding()),
            (4, search.active.cells.as_entire_binding()),
            (5, self.levels.as_entire_binding()),
        ];
        let own = Bindings {
            rays: 2,
            hits: 6,
            pixels: 7,
        };
        self.bands.cast(&self.gpu, "octree caster", &kernels.cast, &common, own, stop)
    }
}

impl Renderer for OctreeRenderer {
    fn set_data(&mut self, data: &Arc<Data>) -> Result<(), RenderError> {
        let settings = self.settings;
        let prepared = self.prepare(data, &settings)?;
        if let Some(p) = &mut self.prover {
            p.set(Some(data), None, None)?;
        }
        self.replace(prepared)
    }

    fn set_surfaces(&mut self, surfaces: &[Surface]) -> Result<(), RenderError> {
        self.surfaces = Some(Isovalues::new(&INFO, surfaces)?);
        self.given = surfaces.to_vec();
        self.search = None;
        self.drawn = false;
        if let Some(p) = &mut self.prover {
            p.set(None, Some(surfaces), None)?;
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
            self.bands = self.bands(p, view)?;
        }
        self.view = Some(view.clone());
        self.drawn = false;
        if let Some(p) = &mut self.prover {
            p.set(None, None, Some(view))?;
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
        let channels = self.request.channels;
        // The proof compares t and surface, asked for or not.
        let needed = Prover::channels(self.prover.as_ref(), channels);
        out.reset(view.width, view.height, self.request.layers.max(1), needed);
        if search.active.count > 0 {
            self.visited = self.bands.read(&self.gpu, view, out)?;
        }
        if let (Some(prover), Some(prepared)) = (&mut self.prover, &self.prepared) {
            prover.write(out, view, prepared.spline.domain().voxel(), channels);
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
        let active = self
            .search
            .as_ref()
            .map_or(0, |s| s.active.nodes.size() + s.active.cells.size());
        let p = self.prepared.as_ref();
        let prover = self.prover.as_ref().map_or_else(Memory::default, Prover::memory);
        Memory {
            coefficients: p.map_or(0, |p| p.spline.own_bytes() as u64) + prover.coefficients,
            index: p.map_or(0, |p| p.bricks.bytes()) + prover.index,
            view: self.bands.host_bytes() + prover.view,
            device: p.map_or(0, |p| p.volume.bytes())
                + active
                + self.bands.device_bytes()
                + self.uniform.size()
                + self.levels.size(),
        }
    }

    /// `cells` of the last frame read: the device counts per pixel, and they come back with the pixels. With `claims=cpu` also what the
    /// proof took and said.
    fn counters(&self) -> Counters {
        let rectangle = self.bands.rectangle();
        let launched = rectangle.width * rectangle.height;
        let mut out = vec![
            ("cells", self.visited),
            ("active bricks", self.search.as_ref().map_or(0, |s| s.active.count as u64)),
            ("pixels launched", launched as u64),
        ];
        if let Some(p) = &self.prover {
            out.extend(p.counters());
        }
        Counters(out)
    }
}
