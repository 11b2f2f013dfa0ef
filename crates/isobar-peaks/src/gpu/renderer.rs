//! The renderer: what is kept between calls on the device, beside the inputs and tables all methods of this crate share.

use super::layout::{COLOUR, COUNT_ALL, MACROCELLS, MULTIPLIERS, NORMALS, Params, Ray, SHADED};
use super::programs::Program;
use crate::knobs::Variant;
use crate::paper::{Integration, Mode};
use crate::sampling::Law;
use crate::scene::{Field, Inputs, Prepared};
use crate::tables::{Bins, LOOKUP};
use bytemuck::{Pod, Zeroable};
use isobar_core::{
    Channels, Counters, Data, DataError, Frame, Function, Knobs, Memory, RenderError, RenderTime, Renderer, Request, Stage, Stop,
    Surface, TransferFunction, View,
};
use isobar_fields::Coefficients;
use isobar_gpu::bands::{Bands, Bindings, Hit};
use isobar_gpu::levels::{Level, halves};
use isobar_gpu::rays::{Rectangle, ToIndex};
use isobar_gpu::{Gpu, Kernel, Texels, Volume, wgpu};
use std::sync::Arc;
use std::time::Instant;

/// What depends on surfaces and transfer function, and on settings.
#[derive(Debug)]
struct Tables {
    nodes: wgpu::Buffer,
    values: wgpu::Buffer,
    peaks: wgpu::Buffer,
    medium: wgpu::Buffer,
    multipliers: wgpu::Buffer,
    /// Without what depends on the view.
    params: Params,
}

impl Tables {
    fn device_bytes(&self) -> u64 {
        let all = [&self.nodes, &self.values, &self.peaks, &self.medium, &self.multipliers];
        all.into_iter().map(wgpu::Buffer::size).sum()
    }
}

/// Turns of loops that a ray may take in one pass on software adapters. Mesa's llvmpipe ends every loop of a shader, without a word, after 65,535 turns in all of the 4 to 16 invocations it runs
/// as one vector; each of these can take turns that the others do not. A ray pauses before a segment, which takes at most four times 64 secant steps and few others.
const TURNS: u32 = 65_535 / 16 - 4 * 64 - 16;

/// A renderer of `peaks/gpu`.
#[derive(Debug)]
pub(crate) struct GpuRenderer {
    gpu: Gpu,
    inputs: Inputs,
    kernels: Vec<(Program, Kernel)>,
    uniform: wgpu::Buffer,
    /// Rays that paused in a pass.
    unfinished: wgpu::Buffer,
    /// Of loops that a ray may take in one pass.
    turns: u32,
    volume: Option<Volume>,
    tables: Option<Tables>,
    bands: Option<Bands<Hit>>,
    drawn: bool,
    work: u64,
}

/// A buffer of some items; a zero item where there are none, since a binding may not be empty.
fn buffer<T: Pod>(gpu: &Gpu, what: &str, items: &[T]) -> Result<wgpu::Buffer, RenderError> {
    Ok(if items.is_empty() {
        gpu.storage(what, &[T::zeroed()])?
    } else {
        gpu.storage(what, items)?
    })
}

impl GpuRenderer {
    pub(crate) fn new(gpu: Gpu, request: &Request) -> Result<Self, RenderError> {
        Ok(Self {
            inputs: Inputs::new(Variant::Gpu, request)?,
            uniform: gpu.uniform("parameters", &Params::zeroed())?,
            unfinished: gpu.storage("rays that paused", &[0u32])?,
            turns: if gpu.report().device_type == "cpu" { TURNS } else { u32::MAX },
            gpu,
            kernels: Vec::new(),
            volume: None,
            tables: None,
            bands: None,
            drawn: false,
            work: 0,
        })
    }

    /// With fewer turns a pass.
    #[cfg(test)]
    pub(crate) fn with_turns(mut self, turns: u32) -> Self {
        self.turns = turns;
        self
    }

    /// The kernel of a program, compiled at its first use.
    fn kernel(&mut self, program: Program) -> Result<Kernel, RenderError> {
        if let Some((_, k)) = self.kernels.iter().find(|(p, _)| *p == program) {
            return Ok(k.clone());
        }
        let kernel = program.kernel(&self.gpu)?;
        self.kernels.push((program, kernel.clone()));
        Ok(kernel)
    }

    /// Uploads the field's coefficients and compiles its kernel.
    fn upload(&mut self) -> Result<(), RenderError> {
        let Some(field) = &self.inputs.field else { return Ok(()) };
        let (lo, hi) = field.macrocells.range;
        if !(hi as f32 - lo as f32).is_finite() {
            return Err(
                DataError::Unknown("the samples span more than f32 holds; scale them down, or use a cpu method".into()).into(),
            );
        }
        let spline = &field.volume.spline;
        let texels = match spline.coefficients() {
            Coefficients::Samples(s) => Texels::Samples(s),
            Coefficients::F32(c) => Texels::F32(c),
            Coefficients::F64(_) => {
                return Err(DataError::Unknown("coefficients in f64 are not drawn on the GPU".into()).into());
            }
        };
        let filter = field.volume.filter;
        let border = spline.border();
        let pad = usize::from(filter.basis().degree > 1);
        let outside = |i, n| border.index(i, n);
        let volume = self
            .gpu
            .upload_bordered("the volume", spline.grid().dims, texels, pad, outside)?;
        self.kernel(Program::new(volume.texel(), filter))?;
        self.volume = Some(volume);
        self.changed();
        (self.tables, self.bands) = (None, None);
        Ok(())
    }

    fn changed(&mut self) {
        self.drawn = false;
        if let Some(b) = &mut self.bands {
            b.unbind();
        }
    }

    /// Macrocells, values and tables of the scene on the device.
    fn make_tables(&self, field: &Field, scene: &Prepared) -> Result<Tables, RenderError> {
        let settings = &self.inputs.settings;
        let (Some(s), Some((table, integration))) = (&settings.sampled, &scene.tables) else {
            return Err(RenderError::NotReady("set_surfaces"));
        };
        let (lo, hi) = field.macrocells.range;
        let bias = 0.5 * lo + 0.5 * hi;
        let values = &scene.values;
        let level = |(i, &c): (usize, &f64)| {
            let surface = values.surface(i);
            Level::new(c, bias, surface, &values.all()[usize::from(surface)])
        };
        let levels: Vec<Level> = values.values().iter().enumerate().map(level).collect();
        let segments = |bins: &Bins| (bins.per_value(), bins.count());
        let (kind, medium, (per_value, bins)) = match integration {
            None => (0, Vec::new(), (0.0, 2)),
            Some(Integration::Post(l)) => (1, l.entries().to_vec(), (l.per_value(), LOOKUP)),
            Some(Integration::Table(t)) => (2, t.rows(), segments(t.bins())),
            Some(Integration::Smooth(t)) => (3, t.rows(), segments(t.bins())),
            // The knob does not offer it: differences of integrals lose their digits in f32.
            Some(Integration::Analytic(_)) => return Err(RenderError::NotReady("set_knobs")),
        };
        let multipliers = field.multipliers.as_ref().filter(|_| s.multiplier);
        let word = |b: &[u8]| u32::from_le_bytes([b[0], b[1], b[2], b[3]]);
        let packed: Vec<u32> = multipliers.map_or_else(Vec::new, |m| m.chunks_exact(4).map(word).collect());
        let domain = &field.volume.space.domain;
        let to_index = ToIndex::new(domain, false);
        let [bias_hi, bias_lo] = halves(bias);
        let has = |c, bit| if self.inputs.request.channels.contains(c) { bit } else { 0 };
        let flag = |on, bit| if on { bit } else { 0 };
        let params = Params {
            last: domain.hi.as_vec3().to_array(),
            shift: field.volume.space.shift() as f32,
            macrocells: field.macrocells.dims,
            flags: has(Channels::HITS, COUNT_ALL)
                | has(Channels::RGBA, COLOUR)
                | has(Channels::NORMAL, NORMALS)
                | flag(settings.macrocells, MACROCELLS)
                | flag(multipliers.is_some(), MULTIPLIERS)
                | flag(s.shaded, SHADED),
            nodes: field.macrocells.nodes,
            bias_hi,
            bias_lo,
            least: (lo - bias) as f32,
            peak_bins_per_value: table.bins().per_value() as f32,
            peak_bins: table.bins().count() as u32,
            medium_per_value: per_value as f32,
            medium_bins: bins as u32,
            integration: kind,
            mode: [Mode::Both, Mode::Either, Mode::Peaks, Mode::Medium]
                .iter()
                .position(|m| *m == settings.mode)
                .unwrap_or(0) as u32,
            iterations: s.iterations,
            layers: self.inputs.request.layers.clamp(1, u32::MAX as usize) as u32,
            values: levels.len() as u32,
            axes: to_index.axes(),
            gradients: to_index.gradients(),
            ..Params::zeroed()
        };
        Ok(Tables {
            nodes: buffer(&self.gpu, "macrocells", &scene.visible.words())?,
            values: buffer(&self.gpu, "peaks", &levels)?,
            peaks: buffer(&self.gpu, "the peak table", &table.words())?,
            medium: buffer(&self.gpu, "the transfer function", &medium)?,
            multipliers: buffer(&self.gpu, "multipliers", &packed)?,
            params,
        })
    }

    /// The pixels of the view that see the domain, with their rays.
    fn make_bands(&self, field: &Field, view: &View) -> Result<Bands<Hit>, RenderError> {
        let Some(s) = &self.inputs.settings.sampled else {
            return Err(RenderError::NotReady("set_knobs"));
        };
        let sampler = self.inputs.sampler(s, field, view)?;
        let space = &field.volume.space;
        let rectangle = Rectangle::of(view, &space.domain);
        Bands::new(&self.gpu, rectangle, self.inputs.request.layers, |y, rows| {
            let ray = |ray: &isobar_core::Ray, _| Ray::new(space, &sampler, &view.clips, ray);
            self.inputs.pool.install(|| rectangle.rows(view, y, rows, ray))
        })
    }
}

impl Renderer for GpuRenderer {
    fn set_data(&mut self, data: &Arc<Data>) -> Result<(), RenderError> {
        let former = self.inputs.grid.clone();
        self.inputs.set_data(data)?;
        if let Err(e) = self.upload() {
            // The former data stay, and their texture.
            self.inputs.restore(former)?;
            return Err(e);
        }
        Ok(())
    }

    fn set_surfaces(&mut self, surfaces: &[Surface]) -> Result<(), RenderError> {
        self.inputs.set_surfaces(surfaces)?;
        self.changed();
        Ok(())
    }

    fn set_medium(&mut self, medium: Option<&TransferFunction>) -> Result<(), RenderError> {
        self.inputs.set_medium(medium)?;
        self.changed();
        Ok(())
    }

    fn set_view(&mut self, view: &View) -> Result<(), RenderError> {
        self.inputs.set_view(view)?;
        (self.bands, self.drawn) = (None, false);
        Ok(())
    }

    fn set_knobs(&mut self, knobs: &Knobs) -> Result<(), RenderError> {
        let former = self.inputs.settings.clone();
        self.inputs.set_knobs(knobs)?;
        if self.inputs.settings.filter != former.filter
            && let Err(e) = self.upload()
        {
            // The former settings stay, and the texture made for them.
            self.inputs.settings = former;
            self.inputs.restore(self.inputs.grid.clone())?;
            return Err(e);
        }
        (self.tables, self.bands, self.drawn) = (None, None, false);
        Ok(())
    }

    fn render(&mut self, stop: &Stop) -> Result<RenderTime, RenderError> {
        let start = Instant::now();
        self.drawn = false;
        if self.inputs.prepare()? {
            self.tables = None;
        }
        if stop.is_raised() {
            return Err(RenderError::Stopped);
        }
        self.gpu.check()?;
        let volume = self.volume.clone().ok_or(RenderError::NotReady("set_data"))?;
        let kernel = self.kernel(Program::new(volume.texel(), self.inputs.settings.filter))?;
        let field = self.inputs.field.as_ref().ok_or(RenderError::NotReady("set_data"))?;
        let scene = self.inputs.scene.as_ref().ok_or(RenderError::NotReady("set_surfaces"))?;
        let view = self.inputs.view.as_ref().ok_or(RenderError::NotReady("set_view"))?;
        let mut bands = match self.bands.take() {
            Some(b) => b,
            None => self.make_bands(field, view)?,
        };
        let tables = match self.tables.take() {
            Some(t) => t,
            None => {
                bands.unbind();
                self.make_tables(field, scene)?
            }
        };
        // Lists of rays are sampled uniformly whatever is asked for: the law of the rays there are.
        let law = match (&self.inputs.settings.sampled, &view.camera) {
            (_, isobar_core::Camera::Rays(_)) | (None, _) => Law::Uniform,
            (Some(s), camera) => match (s.law, camera) {
                // Parallel rays have equal steps, which no growth tells.
                (Law::Geometric, isobar_core::Camera::Orthographic { .. }) => Law::Uniform,
                (law, _) => law,
            },
        };
        let params = Params {
            width: bands.rectangle().width as u32,
            law: match law {
                Law::Differential | Law::Uniform => 0,
                Law::Printed => 1,
                Law::Geometric => 2,
            },
            turns: self.turns,
            ..tables.params
        };
        let common = [
            (0, wgpu::BindingResource::TextureView(volume.view())),
            (1, self.uniform.as_entire_binding()),
            (3, tables.nodes.as_entire_binding()),
            (4, tables.values.as_entire_binding()),
            (5, tables.peaks.as_entire_binding()),
            (6, tables.medium.as_entire_binding()),
            (7, tables.multipliers.as_entire_binding()),
            (10, self.unfinished.as_entire_binding()),
        ];
        let own = Bindings {
            rays: 2,
            hits: 8,
            pixels: 9,
        };
        let mut device = None;
        for pass_number in 0.. {
            self.gpu
                .write(&self.uniform, bytemuck::bytes_of(&Params { pass_number, ..params }))?;
            self.gpu.write(&self.unfinished, &[0; 4])?;
            let time = bands.cast(&self.gpu, "peaks", &kernel, &common, own, stop)?;
            device = if pass_number == 0 {
                time
            } else {
                device.zip(time).map(|(a, b)| a + b)
            };
            // Only adapters on which loops are bounded have more than one pass.
            if self.turns == u32::MAX || self.gpu.read::<u32>(&self.unfinished, 1)? == [0] {
                break;
            }
        }
        (self.bands, self.tables, self.drawn) = (Some(bands), Some(tables), true);
        Ok(RenderTime {
            wall: start.elapsed(),
            device,
        })
    }

    fn read(&mut self, out: &mut Frame) -> Result<(), RenderError> {
        let (Some(view), Some(bands), true) = (&self.inputs.view, &self.bands, self.drawn) else {
            return Err(RenderError::NotReady("render"));
        };
        let request = &self.inputs.request;
        out.reset(view.width, view.height, request.layers.max(1), request.channels);
        self.work = bands.read(&self.gpu, view, out)?;
        Ok(())
    }

    fn reconstruction(&self, stage: Stage) -> Option<Arc<dyn Function>> {
        self.inputs.reconstruction(stage)
    }

    fn memory(&self) -> Memory {
        let bands = self.bands.as_ref();
        Memory {
            view: bands.map_or(0, Bands::host_bytes),
            device: self.volume.as_ref().map_or(0, Volume::bytes)
                + self.tables.as_ref().map_or(0, Tables::device_bytes)
                + bands.map_or(0, Bands::device_bytes)
                + self.uniform.size()
                + self.unfinished.size(),
            ..self.inputs.memory()
        }
    }

    /// `samples`, those of secant steps among them, of the last frame read: the device counts per pixel, and they come back with the pixels.
    fn counters(&self) -> Counters {
        let mut out = vec![("samples", self.work)];
        out.extend(self.inputs.counters());
        Counters(out)
    }
}
