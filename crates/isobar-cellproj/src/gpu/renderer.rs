//! The renderer: what is kept between calls on the host and on the device.

use super::device::{Mesh, Scene, Uniform};
use super::medium::{self, Crossings, Image, Limits, Table};
use super::surfaces::{Draw, Hits, Patches, Program, Targets, Texel};
use super::{INFO, check_view};
use crate::CELLPROJ_CPU;
use crate::cpu::medium_settings;
use crate::faces::{Inside, Look};
use crate::mesh::{ActiveCell, Cells};
use crate::mixed::{Filled, Settings as MediumSettings, Volume};
use crate::normals::{Shading, at_points};
use crate::surfaces::{Emit, Write, nearest_only};
use bytemuck::Zeroable;
use glam::Vec3;
use isobar_core::{
    Channels, Counters, Data, Frame, Function, Knobs, Memory, RenderError, RenderTime, Renderer, Request, ResolvedKnobs, Stage,
    Stop, Surface, TetMesh, TransferFunction, Unsupported, View,
};
use isobar_cpu::scene::Isovalues;
use isobar_cpu::{Pool, render_tiles};
use isobar_fields::TetLinear;
use isobar_gpu::{Gpu, Kernel, Prover, wgpu};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Layers peeled at most where every hit counts.
const MOST_LAYERS: usize = 4096;

/// The knobs, read.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Settings {
    claims: bool,
    smooth: bool,
    inside: Inside,
    medium: MediumSettings,
}

impl Settings {
    fn new(knobs: &Knobs) -> Result<Self, RenderError> {
        let k = ResolvedKnobs::new(INFO.knobs, knobs)?;
        Ok(Self {
            claims: k.word("claims") == "cpu",
            smooth: k.word("shading") == "smooth",
            inside: Inside::new(&k),
            medium: medium_settings(&k),
        })
    }
}

/// A mesh on host and device.
#[derive(Debug)]
struct Prepared {
    data: Arc<Data>,
    cells: Cells,
    mesh: Mesh,
    /// Made with the first transfer function.
    volume: Option<Volume>,
    /// Made where smooth shading asks for them.
    normals: Option<Vec<Vec3>>,
}

/// The last frame.
#[derive(Debug)]
struct Drawn {
    scene: Scene,
    layers: Vec<Vec<Texel>>,
    image: Option<Image>,
}

/// A renderer of `cellproj/gpu`.
#[derive(Debug)]
pub(super) struct CellprojRenderer {
    gpu: Gpu,
    pool: Pool,
    request: Request,
    settings: Settings,
    /// Compiled at their first use.
    program: Option<Program>,
    kernel: Option<Kernel>,
    uniform: wgpu::Buffer,
    prepared: Option<Prepared>,
    given: Vec<Surface>,
    surfaces: Option<Isovalues>,
    transfer: Option<TransferFunction>,
    /// Of the mesh and the surfaces.
    active: Vec<ActiveCell>,
    patches: Option<Patches>,
    /// Of the mesh and the transfer function.
    filled: Option<(Filled, Table)>,
    view: Option<View>,
    /// Of the view's size.
    targets: Option<Targets>,
    drawn: Option<Drawn>,
    prover: Option<Prover>,
    /// Of the medium's passes.
    pub(super) limits: Limits,
}

impl CellprojRenderer {
    pub(super) fn new(gpu: Gpu, request: &Request) -> Result<Self, RenderError> {
        let settings = Settings::new(&request.knobs)?;
        let limits = Limits::new(&gpu);
        let mut new = Self {
            pool: Pool::new(request.threads)?,
            uniform: gpu.uniform("view", &Uniform::zeroed())?,
            gpu,
            request: request.clone(),
            settings,
            program: None,
            kernel: None,
            prepared: None,
            given: Vec::new(),
            surfaces: None,
            transfer: None,
            active: Vec::new(),
            patches: None,
            filled: None,
            view: None,
            targets: None,
            drawn: None,
            prover: None,
            limits,
        };
        new.prover = new.prover(&settings)?;
        Ok(new)
    }

    /// The CPU's method, with the scene set so far, where claims are wanted and asked for.
    fn prover(&self, settings: &Settings) -> Result<Option<Prover>, RenderError> {
        if !settings.claims || !self.request.channels.intersects(Channels::CLAIM | Channels::T_ERROR) {
            return Ok(None);
        }
        let mut p = Prover::new(&CELLPROJ_CPU, &self.request, Knobs::default())?;
        let surfaces = self.surfaces.is_some().then_some(self.given.as_slice());
        p.set(self.prepared.as_ref().map(|p| &p.data), surfaces, self.view.as_ref())?;
        Ok(Some(p))
    }

    /// Layers to be peeled at most.
    fn layers(&self, surfaces: &Isovalues) -> usize {
        let one_layer = Request {
            layers: 1,
            ..self.request.clone()
        };
        if nearest_only(surfaces, &one_layer) {
            self.request.layers.max(1)
        } else {
            MOST_LAYERS
        }
    }

    /// Makes what is missing of mesh, surfaces and transfer function.
    fn ensure(&mut self) -> Result<(), RenderError> {
        let (Some(prepared), Some(surfaces)) = (&mut self.prepared, &self.surfaces) else {
            return Err(RenderError::NotReady("set_data and set_surfaces"));
        };
        if self.program.is_none() {
            self.program = Some(Program::new(&self.gpu)?);
        }
        if self.patches.is_none() {
            self.active = self.pool.install(|| prepared.cells.active(surfaces.values()));
            self.patches = Some(Patches::new(&self.gpu, &prepared.cells, &self.active, surfaces.values())?);
        }
        if self.settings.smooth && !surfaces.values().is_empty() && prepared.normals.is_none() {
            prepared.normals = Some(at_points(&prepared.cells));
        }
        let coloured = self.request.channels.contains(Channels::RGBA);
        let Some(transfer) = self.transfer.as_ref().filter(|_| coloured) else {
            return Ok(());
        };
        if self.kernel.is_none() {
            self.kernel = Some(medium::kernel(&self.gpu)?);
        }
        if self.filled.is_none() {
            let (cells, volume, settings) = (&prepared.cells, &mut prepared.volume, self.settings.medium);
            let filled = self.pool.install(|| -> Result<Filled, RenderError> {
                if volume.is_none() {
                    *volume = Some(Volume::new(cells)?);
                }
                let volume = volume.as_ref().ok_or(RenderError::NotReady("set_data"))?;
                Ok(Filled::new(cells, volume, transfer, settings))
            })?;
            let table = Table::new(&self.gpu, &filled, &prepared.mesh)?;
            self.filled = Some((filled, table));
        }
        Ok(())
    }

    /// Draws a frame; with the device time.
    fn draw(&mut self, stop: &Stop) -> Result<(Drawn, Option<Duration>), RenderError> {
        let view = self.view.as_ref().ok_or(RenderError::NotReady("set_view"))?;
        let size = (view.width, view.height);
        let mut targets = match self.targets.take() {
            Some(t) => t,
            None => Targets::new(&self.gpu, size)?,
        };
        let (Some(prepared), Some(surfaces), Some(patches), Some(program)) =
            (&self.prepared, &self.surfaces, &self.patches, &self.program)
        else {
            return Err(RenderError::NotReady("set_data"));
        };
        let scene = Scene::new(view, &prepared.mesh).ok_or_else(|| super::feature("lists of rays"))?;
        let draw = Draw {
            gpu: &self.gpu,
            program,
            mesh: &prepared.mesh,
            patches,
            uniform: &self.uniform,
            scene: &scene,
            layers: self.layers(surfaces),
        };
        let (layers, mut device) = draw.run(&mut targets, stop)?;
        self.targets = Some(targets);
        let mut drawn = Drawn {
            scene,
            layers,
            image: None,
        };
        if stop.is_raised() {
            return Err(RenderError::Stopped);
        }
        if let (Some((filled, table)), Some(kernel), Some(volume)) = (&self.filled, &self.kernel, &prepared.volume) {
            let medium = medium::Draw {
                gpu: &self.gpu,
                kernel,
                mesh: &prepared.mesh,
                cells: &prepared.cells,
                volume,
                filled,
                table,
                scene: &drawn.scene,
                uniform: &self.uniform,
                settings: self.settings.medium,
                limits: self.limits,
            };
            let hits = hits(prepared, surfaces, patches, &drawn);
            let look = look(prepared, &self.settings);
            let image = self.pool.install(|| {
                let crossings = Crossings::new(&hits, surfaces, look, view.generator());
                medium.run(&crossings, stop)
            })?;
            device = device.zip(image.device).map(|(a, b)| a + b);
            drawn.image = Some(image);
        }
        Ok((drawn, device))
    }
}

fn hits<'a>(prepared: &'a Prepared, surfaces: &'a Isovalues, patches: &'a Patches, drawn: &'a Drawn) -> Hits<'a> {
    Hits {
        cells: &prepared.cells,
        patches,
        scene: &drawn.scene,
        layers: &drawn.layers,
        isovalues: surfaces.values(),
    }
}

fn look<'a>(prepared: &'a Prepared, settings: &Settings) -> Look<'a> {
    let shading = match &prepared.normals {
        Some(normals) if settings.smooth => Shading::Smooth(normals),
        _ => Shading::Flat,
    };
    let inside = settings.inside;
    Look { shading, inside }
}

impl Renderer for CellprojRenderer {
    fn set_data(&mut self, data: &Arc<Data>) -> Result<(), RenderError> {
        let Data::Tets(mesh) = &**data else {
            return Err(Unsupported::DataKind {
                method: INFO.id,
                can: INFO.data.words(),
                given: data.kind(),
            }
            .into());
        };
        // The fields are public: a mesh need not come from its constructor.
        TetMesh::new(mesh.points.clone(), mesh.cells.clone(), mesh.values.clone())?;
        let cells = self.pool.install(|| Cells::new(mesh))?;
        let mesh = self.pool.install(|| Mesh::new(&self.gpu, &cells))?;
        if let Some(p) = &mut self.prover {
            p.set(Some(data), None, None)?;
        }
        (self.patches, self.filled, self.drawn) = (None, None, None);
        self.prepared = Some(Prepared {
            data: Arc::clone(data),
            cells,
            mesh,
            volume: None,
            normals: None,
        });
        Ok(())
    }

    fn set_surfaces(&mut self, surfaces: &[Surface]) -> Result<(), RenderError> {
        let isovalues = Isovalues::new(&INFO, surfaces)?;
        if let Some(p) = &mut self.prover {
            p.set(None, Some(surfaces), None)?;
        }
        (self.surfaces, self.given) = (Some(isovalues), surfaces.to_vec());
        (self.patches, self.drawn) = (None, None);
        Ok(())
    }

    fn set_medium(&mut self, medium: Option<&TransferFunction>) -> Result<(), RenderError> {
        self.transfer = match medium {
            None => None,
            Some(m) => Some(TransferFunction::new(m.points.clone(), m.unit)?),
        };
        (self.filled, self.drawn) = (None, None);
        Ok(())
    }

    fn set_view(&mut self, view: &View) -> Result<(), RenderError> {
        view.validate()?;
        check_view(view)?;
        if let Some(p) = &mut self.prover {
            p.set(None, None, Some(view))?;
        }
        let same = self
            .view
            .as_ref()
            .is_some_and(|v| (v.width, v.height) == (view.width, view.height));
        if !same {
            self.targets = None;
        }
        self.view = Some(view.clone());
        self.drawn = None;
        Ok(())
    }

    fn set_knobs(&mut self, knobs: &Knobs) -> Result<(), RenderError> {
        let settings = Settings::new(knobs)?;
        if settings.claims != self.settings.claims {
            self.prover = self.prover(&settings)?;
        }
        let before = MediumSettings {
            sort: settings.medium.sort,
            ..self.settings.medium
        };
        if before != settings.medium {
            self.filled = None;
        }
        self.settings = settings;
        self.drawn = None;
        Ok(())
    }

    fn render(&mut self, stop: &Stop) -> Result<RenderTime, RenderError> {
        self.prepared.as_ref().ok_or(RenderError::NotReady("set_data"))?;
        self.surfaces.as_ref().ok_or(RenderError::NotReady("set_surfaces"))?;
        self.view.as_ref().ok_or(RenderError::NotReady("set_view"))?;
        let start = Instant::now();
        self.drawn = None;
        if stop.is_raised() {
            return Err(RenderError::Stopped);
        }
        self.gpu.check()?;
        self.ensure()?;
        let (drawn, device) = self.draw(stop)?;
        if let Some(p) = &mut self.prover {
            p.prove(stop)?;
        }
        self.drawn = Some(drawn);
        Ok(RenderTime {
            wall: start.elapsed(),
            device,
        })
    }

    fn read(&mut self, out: &mut Frame) -> Result<(), RenderError> {
        let (Some(drawn), Some(prepared), Some(surfaces), Some(patches), Some(view)) =
            (&self.drawn, &self.prepared, &self.surfaces, &self.patches, &self.view)
        else {
            return Err(RenderError::NotReady("render"));
        };
        let asked = self.request.channels;
        let request = Request {
            channels: Prover::channels(self.prover.as_ref(), asked),
            ..self.request.clone()
        };
        let hits = hits(prepared, surfaces, patches, drawn);
        let look = look(prepared, &self.settings);
        let rays = view.generator();
        let forward = drawn.scene.projection.rows[2];
        render_tiles(&self.pool, view, &request, &Stop::default(), out, |tile, out| {
            let mut write = Write {
                cells: &prepared.cells,
                surfaces,
                claims: false,
                look,
                out,
            };
            let mut roots = Vec::new();
            for (x, y) in tile.pixels() {
                let (i, ray) = (y * view.width + x, rays.ray(x, y));
                hits.roots(i, forward.dot(ray.direction), &mut roots);
                let work = roots.len() as u32;
                match &drawn.image {
                    Some(image) => write.coloured(&rays, (x, y), &roots, work, image.rgba[i]),
                    None => write.pixel(&ray, x, y, &roots, work),
                }
            }
        })?;
        if let Some(prover) = &mut self.prover {
            let (lo, hi) = prepared.cells.bounds;
            // A cell's width.
            let voxel = (hi - lo).length() / (prepared.cells.cells.len() as f64).cbrt();
            prover.write(out, view, voxel, asked);
        }
        Ok(())
    }

    fn reconstruction(&self, _: Stage) -> Option<Arc<dyn Function>> {
        Some(Arc::new(TetLinear::new(&self.prepared.as_ref()?.cells.mesh).ok()?))
    }

    fn memory(&self) -> Memory {
        let prepared = self.prepared.as_ref();
        let normals = prepared
            .and_then(|p| p.normals.as_ref())
            .map_or(0, |n| n.len() * size_of::<Vec3>());
        let index = normals
            + prepared.map_or(0, |p| p.cells.bytes())
            + prepared.and_then(|p| p.volume.as_ref()).map_or(0, |v| v.topology.bytes())
            + self.active.len() * size_of::<ActiveCell>()
            + self.filled.as_ref().map_or(0, |f| f.0.bytes());
        let view = self.drawn.as_ref().map_or(0, |d| {
            let layers: usize = d.layers.iter().map(|l| l.len() * size_of::<Texel>()).sum();
            layers + d.image.as_ref().map_or(0, |i| i.rgba.len() * 16)
        });
        let prover = self.prover.as_ref().map_or_else(Memory::default, Prover::memory);
        let image = self.drawn.as_ref().and_then(|d| d.image.as_ref()).map_or(0, |i| i.bytes);
        Memory {
            coefficients: prover.coefficients,
            index: index as u64 + prover.index,
            view: view as u64 + prover.view,
            device: prepared.map_or(0, |p| p.mesh.bytes())
                + self.patches.as_ref().map_or(0, Patches::bytes)
                + self.filled.as_ref().map_or(0, |f| f.1.bytes())
                + self.targets.as_ref().map_or(0, Targets::bytes)
                + self.uniform.size()
                + image,
        }
    }

    /// Of the last frame. With `claims=cpu` also what the proof took and said.
    fn counters(&self) -> Counters {
        let cells = self.prepared.as_ref().map(|p| &p.cells);
        let mut out = vec![
            ("cells", cells.map_or(0, |c| c.cells.len() as u64)),
            ("cells without volume", cells.map_or(0, |c| c.flat as u64)),
            ("inverted cells", cells.map_or(0, |c| c.inverted as u64)),
            ("active cells", self.active.len() as u64),
            ("patches", self.patches.as_ref().map_or(0, |p| p.len() as u64)),
            ("layers", self.drawn.as_ref().map_or(0, |d| d.layers.len() as u64)),
        ];
        if let Some(i) = self.drawn.as_ref().and_then(|d| d.image.as_ref()) {
            out.extend([
                ("relations across gaps", i.counts.pairs as u64),
                ("cycles", i.counts.cycles as u64),
                ("cells in cycles", i.counts.cells_in_cycles as u64),
                ("cells in squares", i.counts.entries as u64),
                ("passes of the medium", i.passes),
                ("microseconds of sorting", i.counts.sorting.as_micros() as u64),
            ]);
        }
        if let Some(p) = &self.prover {
            out.extend(p.counters());
        }
        Counters(out)
    }
}
