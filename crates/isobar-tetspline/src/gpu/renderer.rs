//! The renderer: what is kept between calls on the host and on the device.

use super::bands::{self, Band};
use super::data::Prepared;
use super::layout::{self, Level, Params, Texel, View as Uniform};
use super::lists::{self, Limits, Lists, Subject};
use super::pixels::{self, Behind, Look};
use super::programs::{DrawProgram, FORMAT, ListKernels, ListProgram, Rays};
use super::settings::Settings;
use super::{INFO, check_view, cull, generate};
use crate::TETSPLINE_CPU;
use crate::caps::Caps;
use crate::ray::Space;
use bytemuck::Zeroable;
use isobar_core::{
    Channels, Counters, Data, Frame, Function, Knobs, Memory, RenderError, RenderTime, Renderer, Request, Stage, Stop, Surface,
    TransferFunction, View,
};
use isobar_cpu::scene::{Isovalues, check_medium};
use isobar_cpu::{Pool, is_visible};
use isobar_fields::Type6Spline;
use isobar_gpu::rays::{Entry, Rectangle};
use isobar_gpu::{Gpu, Prover, Raster, Target, wgpu};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// `Frame::surface` counts to 254.
const MOST_LEVELS: u64 = 255;
/// Layers peeled at most where every hit counts: rays have no more roots in any volume that fits.
const MOST_LAYERS: usize = 4096;

/// A renderer of `tetspline/gpu`.
#[derive(Debug)]
pub(super) struct TetsplineRenderer {
    gpu: Gpu,
    pool: Pool,
    request: Request,
    settings: Settings,
    limits: Limits,
    list_kernels: Vec<(ListProgram, ListKernels)>,
    rasters: Vec<(DrawProgram, Raster)>,
    levels: wgpu::Buffer,
    uniform: wgpu::Buffer,
    table: wgpu::Buffer,
    /// Stands for the layer before the first one.
    blank: Target,
    prepared: Option<Prepared>,
    given: Vec<Surface>,
    surfaces: Option<Isovalues>,
    view: Option<View>,
    lists: Option<Lists>,
    /// The lists and isovalues are those of the data and surfaces set.
    listed: Option<(Vec<Level>, [f32; 2])>,
    /// The lists are culled by the view set.
    culled: bool,
    rectangle: Rectangle,
    bands: Vec<Band>,
    prover: Option<Prover>,
    drawn: bool,
}

impl TetsplineRenderer {
    pub(super) fn new(gpu: Gpu, request: &Request, limits: Limits) -> Result<Self, RenderError> {
        let settings = Settings::new(&request.knobs)?;
        let mut new = Self {
            pool: Pool::new(request.threads)?,
            levels: gpu.storage_empty("isovalues", MOST_LEVELS * size_of::<Level>() as u64)?,
            uniform: gpu.uniform("view", &Uniform::zeroed())?,
            table: gpu.storage("determining sets by kind", &generate::table())?,
            blank: Target::new(&gpu, 1, 1, FORMAT)?,
            gpu,
            request: request.clone(),
            settings,
            limits,
            list_kernels: Vec::new(),
            rasters: Vec::new(),
            prepared: None,
            given: Vec::new(),
            surfaces: None,
            view: None,
            lists: None,
            listed: None,
            culled: false,
            rectangle: Rectangle::default(),
            bands: Vec::new(),
            prover: None,
            drawn: false,
        };
        new.prover = new.prover(&settings)?;
        Ok(new)
    }

    /// The kernels of the lists, compiled at their first use.
    fn list_kernels(&mut self, program: ListProgram) -> Result<ListKernels, RenderError> {
        if let Some((_, k)) = self.list_kernels.iter().find(|(p, _)| *p == program) {
            return Ok(k.clone());
        }
        let kernels = program.kernels(&self.gpu)?;
        self.list_kernels.push((program, kernels.clone()));
        Ok(kernels)
    }

    /// The drawing stages, compiled at their first use.
    fn raster(&mut self, program: DrawProgram) -> Result<Raster, RenderError> {
        if let Some((_, r)) = self.rasters.iter().find(|(p, _)| *p == program) {
            return Ok(r.clone());
        }
        let raster = program.raster(&self.gpu)?;
        self.rasters.push((program, raster.clone()));
        Ok(raster)
    }

    /// The CPU caster, with the scene set so far, where claims are wanted and asked for.
    fn prover(&self, settings: &Settings) -> Result<Option<Prover>, RenderError> {
        if !settings.claims || !self.request.channels.intersects(Channels::CLAIM | Channels::T_ERROR) {
            return Ok(None);
        }
        let knobs = Knobs::default()
            .with("reconstruction", settings.reconstruction())
            .with("claims", "on");
        let mut p = Prover::new(&TETSPLINE_CPU, &self.request, knobs)?;
        let surfaces = self.surfaces.as_ref().map(|_| self.given.as_slice());
        p.set(self.prepared.as_ref().map(|p| &p.drawn), surfaces, self.view.as_ref())?;
        Ok(Some(p))
    }

    /// Whether layers are drawn beyond those kept: every hit is counted, or colour is seen through surfaces.
    fn needs_all(&self) -> bool {
        let clear = |s: &Surface| is_visible(s) && s.opacity < 1.0;
        self.request.channels.contains(Channels::HITS)
            || (self.request.channels.contains(Channels::RGBA) && self.given.iter().any(clear))
    }

    fn layers(&self) -> usize {
        if self.needs_all() {
            MOST_LAYERS
        } else {
            self.request.layers.max(1)
        }
    }

    /// Takes new data, or the same prepared otherwise.
    fn replace(&mut self, prepared: Prepared, settings: &Settings) -> Result<(), RenderError> {
        let same_rays = settings.rays == self.settings.rays;
        let same_domain = same_rays && self.prepared.as_ref().is_some_and(|p| p.domain == prepared.domain);
        let same_dims = self.prepared.as_ref().is_some_and(|p| p.dims() == prepared.dims());
        if let (false, Some(view)) = (same_domain, &self.view) {
            (self.rectangle, self.bands) = self.bands(&prepared, view, settings)?;
        }
        if !same_dims {
            self.lists = None;
        }
        if let Some(l) = &mut self.lists {
            l.forget_data();
        }
        self.prepared = Some(prepared);
        self.listed = None;
        self.drawn = false;
        Ok(())
    }

    /// The bands of a view.
    fn bands(&self, prepared: &Prepared, view: &View, settings: &Settings) -> Result<(Rectangle, Vec<Band>), RenderError> {
        let counted = self.request.channels.contains(Channels::WORK);
        bands::bands(&self.gpu, &self.pool, prepared, view, settings.rays, counted)
    }

    fn params(prepared: &Prepared, levels: &[Level], bias: [f32; 2]) -> Params {
        Params {
            dims: prepared.dims(),
            levels: levels.len() as u32,
            bias,
            ..Params::zeroed()
        }
    }

    /// Makes the lists anew where data, surfaces or settings are new.
    fn ensure_lists(&mut self) -> Result<(), RenderError> {
        let settings = self.settings;
        let (Some(prepared), Some(surfaces)) = (&self.prepared, &self.surfaces) else {
            return Err(RenderError::NotReady("set_surfaces"));
        };
        if self.listed.is_some() {
            return self.ensure_culled();
        }
        let (levels, bias) = lists::levels(surfaces, prepared.range, prepared.scale);
        self.gpu.write(&self.levels, bytemuck::cast_slice(&levels))?;
        let program = ListProgram {
            texel: prepared.volume.texel(),
            rule: settings.rule,
        };
        let kernels = self.list_kernels(program)?;
        let Some(prepared) = &self.prepared else {
            return Err(RenderError::NotReady("set_data"));
        };
        let cubes = prepared.dims().iter().product();
        let mut lists = match self.lists.take() {
            Some(l) => l,
            None => Lists::new(&self.gpu, cubes, self.limits, settings.stored)?,
        };
        let subject = Subject {
            volume: &prepared.volume,
            levels: &self.levels,
            params: Self::params(prepared, &levels, bias),
            stored: settings.stored,
        };
        lists.rebuild(&self.gpu, &kernels, &subject)?;
        self.lists = Some(lists);
        self.listed = Some((levels, bias));
        self.culled = false;
        self.ensure_culled()
    }

    /// Leaves out what the view does not see, once per view and change of the lists.
    fn ensure_culled(&mut self) -> Result<(), RenderError> {
        let (Some(prepared), Some(view), Some((levels, bias)), false) = (&self.prepared, &self.view, &self.listed, self.culled)
        else {
            return Ok(());
        };
        let (texel, rule) = (prepared.volume.texel(), self.settings.rule);
        let planes = if self.settings.cull {
            cull::planes(view, &prepared.domain)
        } else {
            None
        };
        let params = Self::params(prepared, levels, *bias);
        let kernels = self.list_kernels(ListProgram { texel, rule })?;
        if let (Some(lists), Some(prepared)) = (&mut self.lists, &self.prepared) {
            let subject = Subject {
                volume: &prepared.volume,
                levels: &self.levels,
                params,
                stored: self.settings.stored,
            };
            lists.cull(&self.gpu, &kernels, &subject, planes.as_ref())?;
            self.culled = true;
        }
        Ok(())
    }

    /// Draws all bands, layer by layer; the device time.
    fn draw(&mut self, stop: &Stop) -> Result<Option<Duration>, RenderError> {
        let settings = self.settings;
        let prepared = self.prepared.as_ref().ok_or(RenderError::NotReady("set_data"))?;
        let program = DrawProgram {
            texel: prepared.volume.texel(),
            roots: settings.roots,
            rays: settings.rays,
            stored: settings.stored,
            counted: self.request.channels.contains(Channels::WORK),
            painted: !settings.paint.is_plain(),
            mirrored: prepared.mirrored(),
        };
        let raster = self.raster(program)?;
        let mut bands = std::mem::take(&mut self.bands);
        stop.begin(bands.len() as u64);
        let mut device = self.gpu.report().timestamps.then_some(Duration::ZERO);
        let mut result = Ok(());
        for band in &mut bands {
            result = self
                .draw_band(&raster, band, stop)
                .map(|t| device = device.zip(t).map(|(a, b)| a + b));
            if result.is_err() {
                break;
            }
            stop.step();
        }
        self.bands = bands;
        result.map(|()| device)
    }

    /// Peels off the layers of a band.
    fn draw_band(&self, raster: &Raster, band: &mut Band, stop: &Stop) -> Result<Option<Duration>, RenderError> {
        let mut device = self.gpu.report().timestamps.then_some(Duration::ZERO);
        band.layers.clear();
        band.behind = None;
        if let Some(work) = &band.work {
            self.gpu.run("fragments", 0, |w| w.encoder().clear_buffer(work, 0, None))?;
        }
        let (Some(lists), Some((levels, _))) = (&self.lists, &self.listed) else {
            return Err(RenderError::NotReady("set_surfaces"));
        };
        let layers = self.layers();
        if peels(&self.settings) && layers > 1 && band.targets.len() < 2 {
            band.targets
                .push(Target::new(&self.gpu, self.rectangle.width, band.rows, FORMAT)?);
        }
        for layer in 0..layers {
            if stop.is_raised() {
                return Err(RenderError::Stopped);
            }
            if levels.is_empty() || lists.counts()[1] == 0 {
                break;
            }
            let uniform = Uniform {
                peel: u32::from(layer > 0),
                paint: layout::paint_bits(self.settings.paint),
                ..band.view
            };
            self.gpu.write(&self.uniform, bytemuck::bytes_of(&uniform))?;
            let target = &band.targets[layer % band.targets.len()];
            let before = if layer == 0 {
                &self.blank
            } else {
                &band.targets[(layer + 1) % 2]
            };
            let binds = self.bind(raster, band, before, lists)?;
            let times = self.gpu.run("tetrahedra", 1, |w| {
                w.raster(target, Some(([0.0; 4], 1.0)), |pass| {
                    pass.set_pipeline(raster.pipeline());
                    for (part, bind) in lists.parts.iter().zip(&binds) {
                        pass.set_bind_group(0, bind, &[]);
                        for kind in 0..24 {
                            pass.draw_indirect(part.drawn().draws, 16 * kind);
                        }
                    }
                });
            })?;
            device = device.zip(times).map(|(a, t)| a + t.iter().sum::<Duration>());
            let hits: Vec<Texel> = bytemuck::pod_collect_to_vec(&target.read_colour(&self.gpu)?);
            let any = hits.iter().any(|h| h[1] & layout::HIT != 0);
            if any {
                pixels::take(band, &self.pool, hits, self.request.layers.max(1), &self.look()?)?;
            }
            if !any || !peels(&self.settings) {
                break;
            }
        }
        band.fragments = match &band.work {
            Some(work) => self.gpu.read(work, self.rectangle.width * band.rows)?,
            None => Vec::new(),
        };
        Ok(device)
    }

    /// The resources of each part's draws.
    fn bind(&self, raster: &Raster, band: &Band, before: &Target, lists: &Lists) -> Result<Vec<wgpu::BindGroup>, RenderError> {
        let (Some(prepared), Some((levels, bias))) = (&self.prepared, &self.listed) else {
            return Err(RenderError::NotReady("set_data"));
        };
        let params = self.gpu.uniform("parameters", &Self::params(prepared, levels, *bias))?;
        let exact = self.settings.rays == Rays::Exact;
        let mut out = Vec::with_capacity(lists.parts.len());
        for part in &lists.parts {
            let mut resources = vec![
                (1, params.as_entire_binding()),
                (2, self.levels.as_entire_binding()),
                (3, self.uniform.as_entire_binding()),
                (4, part.drawn().tetrahedra.as_entire_binding()),
                (5, part.drawn().bases.as_entire_binding()),
            ];
            match &part.sets {
                Some(sets) => resources.extend([
                    (6, part.cubes.as_entire_binding()),
                    (7, sets.as_entire_binding()),
                    (8, self.table.as_entire_binding()),
                ]),
                None => resources.push((0, wgpu::BindingResource::TextureView(prepared.volume.view()))),
            }
            if let (true, Some(rays)) = (exact, &band.rays) {
                resources.push((9, rays.as_entire_binding()));
                resources.push((10, wgpu::BindingResource::TextureView(before.colour())));
            }
            if let Some(work) = &band.work {
                resources.push((11, work.as_entire_binding()));
            }
            out.push(raster.bind(&self.gpu, &resources)?);
        }
        Ok(out)
    }

    /// What the colours of the view set depend on.
    fn look(&self) -> Result<Look<'_>, RenderError> {
        Ok(Look {
            view: self.view.as_ref().ok_or(RenderError::NotReady("set_view"))?,
            isovalues: self.surfaces.as_ref().ok_or(RenderError::NotReady("set_surfaces"))?,
            rectangle: self.rectangle,
            paint: self.settings.paint,
        })
    }

    /// Writes the layers of all bands into the frame.
    fn collect(&self, channels: Channels, out: &mut Frame) -> Result<(), RenderError> {
        let prepared = self.prepared.as_ref().ok_or(RenderError::NotReady("set_data"))?;
        let (look, space) = (self.look()?, Space::new(prepared.domain));
        // Closed cuts are found on the host: one value of the spline for each end of a ray.
        let caps = Caps::new(&prepared.spline, &space, look.isovalues, look.view);
        let request = Request {
            channels,
            ..self.request.clone()
        };
        pixels::collect(&self.pool, &request, &self.bands, &look, &space, caps, out)
    }
}

/// Whether further layers can be told from the ones before: rays as printed have no common parameter.
fn peels(settings: &Settings) -> bool {
    settings.rays == Rays::Exact
}

impl Renderer for TetsplineRenderer {
    fn set_data(&mut self, data: &Arc<Data>) -> Result<(), RenderError> {
        let settings = self.settings;
        let old = self.prepared.as_ref();
        let prepared = self.pool.install(|| Prepared::new(&self.gpu, data, &settings, old))?;
        let told = match &mut self.prover {
            Some(p) => p.set(Some(&prepared.drawn), None, None),
            None => Ok(()),
        };
        let result = told.and_then(|()| self.replace(prepared, &settings));
        if result.is_err() {
            // The samples may stand in the old texture already: nothing of the step before is drawn with them.
            (self.prepared, self.listed, self.drawn) = (None, None, false);
        }
        result
    }

    fn set_surfaces(&mut self, surfaces: &[Surface]) -> Result<(), RenderError> {
        self.surfaces = Some(Isovalues::new(&INFO, surfaces)?);
        self.given = surfaces.to_vec();
        self.listed = None;
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
        view.validate()?;
        check_view(view)?;
        if let Some(p) = &self.prepared {
            (self.rectangle, self.bands) = self.bands(p, view, &self.settings)?;
        }
        self.view = Some(view.clone());
        (self.drawn, self.culled) = (false, false);
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
        let mut prover = self.prover(&settings)?;
        if let Some(p) = &self.prepared {
            if (p.prefiltered, p.smooth) != (settings.prefiltered, settings.smooth) {
                let data = Arc::clone(&p.data);
                let prepared = self.pool.install(|| Prepared::new(&self.gpu, &data, &settings, None))?;
                if let Some(prover) = &mut prover {
                    prover.set(Some(&prepared.drawn), None, None)?;
                }
                self.replace(prepared, &settings)?;
            } else if let (true, Some(view)) = (settings.rays != self.settings.rays, &self.view) {
                (self.rectangle, self.bands) = self.bands(p, view, &settings)?;
            }
        }
        if (settings.stored, settings.rule) != (self.settings.stored, self.settings.rule) {
            self.listed = None;
        }
        if settings.stored != self.settings.stored {
            self.lists = None;
        }
        self.settings = settings;
        self.prover = prover;
        (self.drawn, self.culled) = (false, false);
        Ok(())
    }

    fn render(&mut self, stop: &Stop) -> Result<RenderTime, RenderError> {
        self.prepared.as_ref().ok_or(RenderError::NotReady("set_data"))?;
        self.surfaces.as_ref().ok_or(RenderError::NotReady("set_surfaces"))?;
        self.view.as_ref().ok_or(RenderError::NotReady("set_view"))?;
        let start = Instant::now();
        self.drawn = false;
        if stop.is_raised() {
            return Err(RenderError::Stopped);
        }
        self.gpu.check()?;
        self.ensure_lists()?;
        let device = self.draw(stop)?;
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
        let (Some(view), true) = (self.view.clone(), self.drawn) else {
            return Err(RenderError::NotReady("render"));
        };
        let channels = self.request.channels;
        // The proof compares t and surface, asked for or not.
        self.collect(Prover::channels(self.prover.as_ref(), channels), out)?;
        if let (Some(prover), Some(prepared)) = (&mut self.prover, &self.prepared) {
            prover.write(out, &view, prepared.domain.voxel(), channels);
        }
        Ok(())
    }

    fn reconstruction(&self, stage: Stage) -> Option<Arc<dyn Function>> {
        let p = self.prepared.as_ref()?;
        if p.prefiltered && stage == Stage::Ideal {
            return Some(Arc::new(Type6Spline::prefiltered(p.spline.grid(), stage).ok()?));
        }
        Some(Arc::new(p.spline.clone()))
    }

    fn memory(&self) -> Memory {
        let entries = self.bands.iter().map(|b| b.entries.capacity() * size_of::<Entry>());
        let layers = self
            .bands
            .iter()
            .flat_map(|b| &b.layers)
            .map(|l| l.len() * size_of::<Texel>())
            .chain(self.bands.iter().filter_map(|b| b.behind.as_ref()).map(Behind::bytes));
        let view: u64 = self.bands.iter().map(|b| b.device_bytes(self.rectangle.width)).sum();
        let p = self.prepared.as_ref();
        let prover = self.prover.as_ref().map_or_else(Memory::default, Prover::memory);
        let own = self.levels.size() + self.uniform.size() + self.table.size();
        Memory {
            coefficients: p.map_or(0, |p| p.spline.own_bytes() as u64) + prover.coefficients,
            index: prover.index,
            view: entries.chain(layers).sum::<usize>() as u64 + prover.view,
            device: p.map_or(0, |p| p.volume.bytes()) + self.lists.as_ref().map_or(0, Lists::bytes) + view + own,
        }
    }

    /// Of the lists as they are now: active cubes and tetrahedra, the bytes that Q_active, T_active and stored determining sets need, and the device time of
    /// the last change of the isovalue. With `claims=cpu` also what the proof took and said.
    fn counters(&self) -> Counters {
        let mut out = Vec::new();
        if let Some(l) = &self.lists {
            let ([cubes, tets], [q, t, s]) = (l.counts(), l.used());
            out.extend([
                ("active cubes", cubes),
                ("active tetrahedra", tets),
                ("bytes of Q_active", q),
                ("bytes of T_active", t),
                ("bytes of determining sets", s),
                ("parts", l.parts.len() as u64),
            ]);
            if let Some([cubes, tets]) = l.times {
                out.push(("cubes microseconds", cubes.as_micros() as u64));
                out.push(("tetrahedra microseconds", tets.as_micros() as u64));
            }
        }
        let fragments: u64 = self.bands.iter().flat_map(|b| &b.fragments).map(|n| u64::from(*n)).sum();
        out.push(("fragments", fragments));
        if let Some(p) = &self.prover {
            out.extend(p.counters());
        }
        Counters(out)
    }
}

#[cfg(test)]
impl TetsplineRenderer {
    /// The lists, for tests of the kernels.
    pub(super) fn lists(&mut self) -> Result<(&Lists, Vec<Level>, [f32; 2]), RenderError> {
        self.ensure_lists()?;
        match (&self.lists, &self.listed) {
            (Some(l), Some((levels, bias))) => Ok((l, levels.clone(), *bias)),
            _ => Err(RenderError::NotReady("set_data")),
        }
    }
}
