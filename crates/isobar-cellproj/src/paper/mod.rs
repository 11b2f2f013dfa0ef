//! `cellproj/cpu-paper`: the algorithm as printed, on a rasteriser with the rules of graphics hardware. It claims nothing; its hits are what the textures give, so that its wrong
//! pixels can be counted.
//!
//! | section | module |
//! |---|---|
//! | 2, decomposition | [`fan`], [`scene`] |
//! | 2, linear opacity and Stein's texture; 3, 3D texture; 4, 2D texture; 7 to 10, isosurface textures | [`textures`] |
//! | 6, stencil; the passes of 7 to 10 | [`draw`] |
//! | OpenGL's rasterisation | [`triangle`] |
//!
//! Texture coordinates are linear on the screen, which is right for orthographic images only; others are drawn with that error. What the paper
//! leaves open is settled so: isosurface textures take the nearest texel, volume textures are interpolated; a hit's depth is that of the front and back face
//! with the section 8 weights of its texel; cells with a corner behind the eye (or the plane rays start on) are left out and counted.

mod draw;
mod fan;
mod maps;
mod scene;
mod settings;
#[cfg(test)]
mod tests;
mod textures;
mod triangle;

use crate::blocks::{Block, SIDE};
use crate::camera::Projection;
use crate::measure::Lengths;
use crate::medium::Medium;
use crate::mesh::Cells;
use crate::normals::at_points;
use crate::resolve::Gradient;
use crate::topology::Topology;
pub use maps::{TextureMap, TextureMaps};

use draw::{DrawBlock, Nearest, Pass, Scene as DrawScene, Work, passes};
use glam::{Vec3, Vec4};
use isobar_core::{
    Camera, Claim, Counters, Data, Frame, Function, Hit, Knobs, Memory, Method, MethodInfo, Pixel, RenderError, RenderTime,
    Renderer, Request, Scene, Stage, Stop, Surface, TetMesh, TransferFunction, Unsupported, View,
};
use isobar_cpu::scene::{Isovalues, check_request, check_scene, check_view};
use isobar_cpu::{Level, Pool, TileOut, copy_frame, render_tiles};
use isobar_fields::TetLinear;
use rayon::prelude::*;
use scene::{Make, Wanted};
use settings::{INFO, Mixing, Settings, VolumeKind, check_layers, feature};
use std::sync::Arc;
use std::time::Instant;
use textures::{Axis, Filling, Isosurfaces, Making, NO_SURFACE, Volume};

/// The method `cellproj/cpu-paper`.
#[derive(Debug)]
pub struct CellprojCpuPaper;

/// The method `cellproj/cpu-paper`: Roettger, Kraus and Ertl 2000 as printed.
///
/// Every projected tetrahedron becomes one to four triangles, whose passes look up 2D or 3D textures and are blended back to front. No guarantee: pixels and values
/// are as right as textures of the chosen resolution, positions of 1/256 pixel and linear interpolation on the screen allow, and nothing is claimed.
/// Frames hold one layer; `hits` counts surfaces set in a pixel, double edges included. Lists of rays and clipping planes are refused.
pub static CELLPROJ_CPU_PAPER: CellprojCpuPaper = CellprojCpuPaper;

impl Method for CellprojCpuPaper {
    fn info(&self) -> &'static MethodInfo {
        &INFO
    }

    fn supports(&self, scene: &Scene<'_>, request: &Request) -> Result<(), Unsupported> {
        check_scene(&INFO, &Scene { medium: None, ..*scene }, request)?;
        check_layers(request)?;
        if matches!(scene.view.camera, Camera::Rays(_)) {
            return Err(feature("lists of rays; give a camera"));
        }
        match Settings::new(&request.knobs) {
            Ok(s) => s.check(scene.surfaces, scene.medium.is_some()),
            // Said by `open`.
            Err(_) => Ok(()),
        }
    }

    fn open(&self, request: &Request) -> Result<Box<dyn Renderer>, RenderError> {
        check_request(&INFO, request)?;
        check_layers(request)?;
        Ok(Box::new(Paper {
            pool: Pool::new(request.threads)?,
            level: Level::detect(),
            settings: Settings::new(&request.knobs)?,
            request: request.clone(),
            mesh: None,
            surfaces: None,
            transfer: None,
            textures: None,
            view: None,
            last: None,
            frame: None,
        }))
    }
}

/// What depends on the mesh.
#[derive(Debug)]
struct Mesh {
    cells: Cells,
    topology: Topology,
    lengths: Lengths,
    range: (f64, f64),
    /// Made where smooth shading asks for it.
    normals: Option<Vec<Vec3>>,
}

/// What depends on mesh, surfaces, transfer function and settings.
#[derive(Debug)]
struct Textures {
    isovalues: Vec<(f64, u8)>,
    isosurfaces: Option<Isosurfaces>,
    volume: Option<Volume>,
    wanted: Vec<Wanted>,
    /// Cells with an isovalue between their least and greatest value: those of Table 1.
    intersected: usize,
    passes: Vec<Pass>,
}

impl Textures {
    fn new(mesh: &Mesh, surfaces: &Isovalues, transfer: Option<&TransferFunction>, settings: &Settings) -> Self {
        let isovalues: Vec<(f64, u8)> = surfaces
            .values()
            .iter()
            .enumerate()
            .map(|(i, &c)| (c, surfaces.surface(i)))
            .collect();
        let textured = !isovalues.is_empty() && !settings.stencil;
        let making = Making {
            isovalues: &isovalues,
            surfaces: surfaces.all(),
            inside: settings.inside,
            thickening: settings.thickening,
            fixed: settings.fixed,
        };
        let medium = transfer.map(|t| (Medium::new(t, settings.model), t));
        let wanted = wanted(mesh, &isovalues, medium.as_ref().map(|m| &m.0), settings);
        let filling = Filling {
            range: mesh.range,
            longest: mesh.lengths.longest,
            average: mesh.lengths.average,
            stops: if settings.mixing == Mixing::Stopped { &isovalues } else { &[] },
            fixed: settings.fixed,
        };
        let volume = medium.map(|(medium, transfer)| match settings.volume {
            VolumeKind::Table2 => Volume::table2(&medium, &filling, settings.texture),
            VolumeKind::Table3 => Volume::table3(&medium, &filling, settings.table),
            VolumeKind::Linear => Volume::Linear(medium),
            VolumeKind::Stein => {
                let greatest = transfer.points.iter().fold(0.0f32, |m, p| m.max(p.2));
                Volume::stein(medium, f64::from(greatest) / transfer.unit, &filling, settings.texture)
            }
        });
        Self {
            isosurfaces: textured.then(|| Isosurfaces::new(mesh.range, settings.texture, &making)),
            passes: passes(settings, !isovalues.is_empty(), volume.is_some()),
            intersected: mesh.cells.active(surfaces.values()).len(),
            wanted,
            volume,
            isovalues,
        }
    }

    fn bytes(&self) -> usize {
        self.wanted.len() * size_of::<Wanted>()
            + self.isosurfaces.as_ref().map_or(0, Isosurfaces::bytes)
            + self.volume.as_ref().map_or(0, Volume::bytes)
    }
}

/// The cells that can show something: by texture also those whose values come within a texel of an isovalue.
fn wanted(mesh: &Mesh, isovalues: &[(f64, u8)], medium: Option<&Medium>, settings: &Settings) -> Vec<Wanted> {
    let texel = Axis::new(mesh.range, settings.texture).texel();
    let margin = if settings.stencil {
        0.0
    } else {
        (1.0 + settings.thickening) * texel
    };
    let values = &mesh.cells.mesh.values;
    mesh.cells
        .cells
        .par_iter()
        .with_min_len(4096)
        .map(|c| {
            let v = c.map(|i| f64::from(values[i as usize]));
            let (lo, hi) = (v[0].min(v[1]).min(v[2].min(v[3])), v[0].max(v[1]).max(v[2].max(v[3])));
            Wanted {
                surfaces: isovalues.iter().any(|&(c, _)| lo - margin <= c && c <= hi + margin),
                volume: medium.is_some_and(|m| !m.is_clear(lo, hi)),
            }
        })
        .collect()
}

/// One block of the last frame.
type Drawn = (Vec<Vec4>, Vec<Nearest>, Work);

#[derive(Debug)]
struct Paper {
    pool: Pool,
    level: Level,
    settings: Settings,
    request: Request,
    mesh: Option<Mesh>,
    surfaces: Option<Isovalues>,
    transfer: Option<TransferFunction>,
    textures: Option<Textures>,
    view: Option<View>,
    /// The last frame's cells and work.
    last: Option<(scene::Frame, Work)>,
    frame: Option<Frame>,
}

impl Paper {
    /// Makes the textures, if all they depend on is there.
    fn prepare(&mut self) -> Result<(), RenderError> {
        self.textures = None;
        let (Some(mesh), Some(surfaces)) = (&mut self.mesh, &self.surfaces) else {
            return Ok(());
        };
        let (transfer, settings) = (self.transfer.as_ref(), &self.settings);
        let seen: Vec<Surface> = (0..surfaces.values().len())
            .map(|i| surfaces.all()[usize::from(surfaces.surface(i))])
            .collect();
        settings.check(&seen, transfer.is_some())?;
        self.textures = Some(self.pool.install(|| {
            if settings.smooth && !seen.is_empty() && mesh.normals.is_none() {
                mesh.normals = Some(at_points(&mesh.cells));
            }
            Textures::new(mesh, surfaces, transfer, settings)
        }));
        Ok(())
    }

    fn draw(
        &self,
        mesh: &Mesh,
        textures: &Textures,
        view: &View,
        stop: &Stop,
    ) -> Result<(scene::Frame, Vec<Drawn>), RenderError> {
        let surfaces = self.surfaces.as_ref().ok_or(RenderError::NotReady("set_surfaces"))?;
        let projection = Projection::new(view).ok_or_else(|| feature("lists of rays; give a camera"))?;
        let make = Make {
            mesh: &mesh.cells,
            topology: &mesh.topology,
            normals: mesh.normals.as_deref().filter(|_| self.settings.smooth),
            wanted: &textures.wanted,
            settings: &self.settings,
        };
        self.pool.install(|| {
            let mut frame = scene::Frame::new(&make, projection)?;
            let start = Instant::now();
            let scene = DrawScene {
                mesh: &mesh.cells,
                frame: &frame,
                settings: &self.settings,
                isovalues: &textures.isovalues,
                surfaces: surfaces.all(),
                isosurfaces: textures.isosurfaces.as_ref(),
                volume: textures.volume.as_ref(),
                passes: &textures.passes,
            };
            let blocks: Vec<Block> = Block::all(&projection).collect();
            let draw = |&block: &Block| (!stop.is_raised()).then(|| self.level.run(DrawBlock { scene: &scene, block }));
            let drawn: Option<Vec<Drawn>> = blocks.par_iter().with_max_len(1).map(draw).collect();
            frame.parts.drawing = start.elapsed().as_micros() as u64;
            Ok((frame, drawn.ok_or(RenderError::Stopped)?))
        })
    }
}

/// Writes a pixel of the frame.
fn write(out: &mut TileOut<'_>, mesh: &Mesh, view: &View, (x, y): (usize, usize), (colour, nearest): (Vec4, &Nearest)) {
    let found = nearest.surface != NO_SURFACE;
    if found {
        let ray = view.ray(x, y);
        let forward = match &view.camera {
            Camera::Perspective { eye, target, .. } => (*target - *eye).normalize(),
            _ => ray.direction,
        };
        let t = nearest.depth / forward.dot(ray.direction);
        let gradient = Gradient::new(&mesh.cells.corners(nearest.cell), &mesh.cells.values(nearest.cell)).scaled;
        let hit = Hit {
            t,
            point: ray.at(t),
            normal: gradient.normalize_or_zero().as_vec3().to_array(),
            surface: nearest.surface,
            t_error: f64::INFINITY,
        };
        out.set_hit(0, x, y, &hit);
    }
    let pixel = Pixel {
        hits: nearest.count,
        claim: Claim::empty(),
        rgba: colour.to_array(),
        work: nearest.fragments,
    };
    out.set_pixel(x, y, &pixel);
}

impl Renderer for Paper {
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
        self.mesh = Some(self.pool.install(|| -> Result<Mesh, RenderError> {
            let cells = Cells::new(mesh)?;
            let (lo, hi) = cells.range();
            Ok(Mesh {
                topology: Topology::new(&cells)?,
                lengths: Lengths::new(&cells),
                range: (f64::from(lo), f64::from(hi)),
                cells,
                normals: None,
            })
        })?);
        self.prepare()
    }

    fn set_surfaces(&mut self, surfaces: &[Surface]) -> Result<(), RenderError> {
        self.surfaces = Some(Isovalues::new(&INFO, surfaces)?);
        self.prepare()
    }

    fn set_medium(&mut self, medium: Option<&TransferFunction>) -> Result<(), RenderError> {
        self.transfer = match medium {
            None => None,
            Some(m) => Some(TransferFunction::new(m.points.clone(), m.unit)?),
        };
        self.prepare()
    }

    fn set_view(&mut self, view: &View) -> Result<(), RenderError> {
        view.validate()?;
        check_view(&INFO, view)?;
        if view.width > 32_768 || view.height > 32_768 {
            return Err(RenderError::View(
                "cellproj/cpu-paper draws at most 32768 x 32768 pixels; give a smaller --size".into(),
            ));
        }
        self.view = Some(view.clone());
        Ok(())
    }

    fn set_knobs(&mut self, knobs: &Knobs) -> Result<(), RenderError> {
        let settings = Settings::new(knobs)?;
        let before = std::mem::replace(&mut self.settings, settings);
        let same = Settings {
            sort: settings.sort,
            ..before
        };
        if same == settings { Ok(()) } else { self.prepare() }
    }

    fn render(&mut self, stop: &Stop) -> Result<RenderTime, RenderError> {
        let mesh = self.mesh.as_ref().ok_or(RenderError::NotReady("set_data"))?;
        let view = self.view.as_ref().ok_or(RenderError::NotReady("set_view"))?;
        let textures = self.textures.as_ref().ok_or(RenderError::NotReady("set_surfaces"))?;
        let start = Instant::now();
        let drawn = self.draw(mesh, textures, view, stop);
        let frame = self.frame.get_or_insert_with(Frame::default);
        let result = drawn.and_then(|(cells, blocks)| {
            let columns = view.width.div_ceil(SIDE);
            render_tiles(&self.pool, view, &self.request, stop, frame, |tile, out| {
                for (x, y) in tile.pixels() {
                    let (colour, nearest, _) = &blocks[y / SIDE * columns + x / SIDE];
                    let i = y % SIDE * SIDE + x % SIDE;
                    write(out, mesh, view, (x, y), (colour[i], &nearest[i]));
                }
            })?;
            let work = blocks.iter().fold(Work::default(), |a, b| Work {
                triangles: a.triangles + b.2.triangles,
                fragments: a.fragments + b.2.fragments,
            });
            Ok((cells, work))
        });
        match result {
            Ok(last) => self.last = Some(last),
            Err(e) => {
                // A frame drawn in part is none.
                (self.frame, self.last) = (None, None);
                return Err(e);
            }
        }
        Ok(RenderTime {
            wall: start.elapsed(),
            device: None,
        })
    }

    fn read(&mut self, out: &mut Frame) -> Result<(), RenderError> {
        copy_frame(self.frame.as_ref().ok_or(RenderError::NotReady("render"))?, out);
        Ok(())
    }

    fn reconstruction(&self, _: Stage) -> Option<Arc<dyn Function>> {
        Some(Arc::new(TetLinear::new(&self.mesh.as_ref()?.cells.mesh).ok()?))
    }

    fn memory(&self) -> Memory {
        let mesh = self.mesh.as_ref().map_or(0, |m| {
            m.cells.bytes() + m.topology.bytes() + m.normals.as_ref().map_or(0, |n| n.len() * size_of::<Vec3>())
        });
        Memory {
            index: (mesh + self.textures.as_ref().map_or(0, Textures::bytes)) as u64,
            view: self.last.as_ref().map_or(0, |l| l.0.bytes()) as u64,
            ..Memory::default()
        }
    }

    fn counters(&self) -> Counters {
        let mut out = vec![
            ("cells", self.mesh.as_ref().map_or(0, |m| m.cells.cells.len() as u64)),
            (
                "cells intersected",
                self.textures.as_ref().map_or(0, |t| t.intersected as u64),
            ),
        ];
        if let Some((frame, work)) = &self.last {
            out.extend([
                ("class 1", frame.classes.of[1]),
                ("class 2", frame.classes.of[2]),
                ("class 3", frame.classes.of[3]),
                ("class 4", frame.classes.of[4]),
                ("seen edge-on", frame.classes.of[0]),
                ("left out", frame.classes.left_out),
                ("cycles", frame.cycles as u64),
                ("triangles", work.triangles),
                ("fragments", work.fragments),
                ("microseconds of sorting", frame.parts.sorting),
                ("microseconds of decomposition", frame.parts.decomposition),
                ("microseconds of drawing", frame.parts.drawing),
            ]);
        }
        Counters(out)
    }
}
