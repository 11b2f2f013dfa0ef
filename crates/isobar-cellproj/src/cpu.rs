//! `cellproj/cpu` as a method.

use crate::faces::{INSIDE, Inside, Look};
use crate::medium::Model;
use crate::mesh::{ActiveCell, Cells};
use crate::mixed::{Draw, Filled, Image, Integration, Settings, Sort, Volume};
use crate::normals::{Shading, at_points};
use crate::resolve::Resolver;
use crate::surfaces::{DrawTile, Prepared, Work, Write, nearest_only};
use glam::Vec3;
use isobar_core::{
    Camera, Counters, Data, DataError, DataKind, Frame, Function, KnobKind, KnobSpec, Knobs, Memory, Method, MethodInfo,
    RenderError, RenderTime, Renderer, Request, ResolvedKnobs, Scene, Stage, Stop, Surface, TetMesh, TransferFunction,
    Unsupported, View,
};
use isobar_cpu::scene::{Isovalues, check_clipped_scene, check_open_cuts, check_request};
use isobar_cpu::{Level, Pool, copy_frame, render_tiles};
use isobar_fields::TetLinear;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// Settings that `cellproj/gpu` has as well.
pub(crate) const SHADING: KnobSpec = KnobSpec {
    name: "shading",
    doc: "light of a hit by the gradient of its cell, or by normals of the points, linear in the cell; normals given are the cell's",
    kind: KnobKind::Choice(&["flat", "smooth"]),
};
pub(crate) const TABLE: KnobSpec = KnobSpec {
    name: "table",
    doc: "nodes along each axis of the 3D table; the 2D table has four times as many",
    kind: KnobKind::Int {
        default: 64,
        min: 2,
        max: 256,
    },
};
pub(crate) const MODEL: KnobSpec = KnobSpec {
    name: "model",
    doc: "what the medium emits: extinction times colour, or colour alone",
    kind: KnobKind::Choice(&["williams-max", "wilhelms-van-gelder"]),
};
pub(crate) const SORT: KnobSpec = KnobSpec {
    name: "sort",
    doc: "order of the cells: by visibility, or by the distance of their centroids, which may be wrong",
    kind: KnobKind::Choice(&["visibility", "centroids"]),
};

pub(crate) static INFO: MethodInfo = MethodInfo {
    id: "cellproj/cpu",
    summary: "isosurfaces of tetrahedra by projection, exact and proved, mixed with a pre-integrated medium",
    paper: "Roettger, Kraus, Ertl, Hardware-accelerated volume and isosurface rendering based on cell-projection, IEEE Visualization 2000",
    data: DataKind::TETS,
    hits: true,
    gpu: false,
    work_unit: "patches covering the pixel",
    knobs: &[
        KnobSpec {
            name: "claims",
            doc: "state what is proved of each pixel (EXISTS, FIRST, EMPTY)",
            kind: KnobKind::Choice(&["on", "off"]),
        },
        SHADING,
        INSIDE,
        KnobSpec {
            name: "integration",
            doc: "how a ray's stay in a cell is integrated: 3D table, 2D table at the average thickness, or each by itself to rounding",
            kind: KnobKind::Choice(&["table3d", "table2d", "exact"]),
        },
        TABLE,
        MODEL,
        SORT,
    ],
    sweep: ("table", &["8", "16", "32", "64", "128"]),
};

/// The method `cellproj/cpu`.
#[derive(Debug)]
pub struct CellprojCpu;

/// The method `cellproj/cpu`: projected cells of a tetrahedral mesh.
///
/// Isosurfaces of the function that is linear in each tetrahedron; all hits in order. Guarantee with `claims=on`: every pixel claims, and a pixel with
/// EXISTS has a root within `t_error` of t, with FIRST none before it, with EMPTY none at all; rays that f64 with its proved bounds cannot tell
/// from an edge are decided in integers (`patch.rs`, `resolve.rs`, `exact.rs`). Normals are the gradients of the cells; `shading=smooth` changes colours alone. Eyes inside the mesh, cells across
/// the eye plane and lists of rays are drawn as any other. Source: sections 5 to 7 and 9.
///
/// With a transfer function the colour is that of the medium with the surfaces in it (sections 3, 4 and 10): cells in visibility order, each fragment
/// integrated by table or by itself, cut at the exact hits. Colours carry no claim. Lists of rays are not drawn with a medium.
///
/// Open clipping planes: whether a hit lies beyond one is decided as whether it is one, in integers where f64 cannot tell; a hit on a plane is kept. The medium ends at the plane, to
/// rounding. Closed cuts are refused.
pub static CELLPROJ_CPU: CellprojCpu = CellprojCpu;

impl Method for CellprojCpu {
    fn info(&self) -> &'static MethodInfo {
        &INFO
    }

    fn supports(&self, scene: &Scene<'_>, request: &Request) -> Result<(), Unsupported> {
        let surfaces_only = Scene { medium: None, ..*scene };
        check_clipped_scene(&INFO, &surfaces_only, request)?;
        match (scene.medium, &scene.view.camera) {
            (Some(_), Camera::Rays(_)) => Err(rays_with_medium()),
            _ => Ok(()),
        }
    }

    fn open(&self, request: &Request) -> Result<Box<dyn Renderer>, RenderError> {
        check_request(&INFO, request)?;
        Ok(Box::new(Cellproj {
            pool: Pool::new(request.threads)?,
            level: Level::detect(),
            output: settings(&request.knobs)?.0,
            settings: settings(&request.knobs)?.1,
            request: request.clone(),
            cells: None,
            normals: None,
            volume: None,
            transfer: None,
            filled: None,
            surfaces: None,
            active: Vec::new(),
            view: None,
            prepared: None,
            image: None,
            frame: None,
            work: Work::default(),
        }))
    }
}

fn rays_with_medium() -> Unsupported {
    Unsupported::Feature {
        method: INFO.id,
        what: "transfer functions on lists of rays; give a camera or leave out --tf".into(),
    }
}

/// How hits are written.
#[derive(Debug, Clone, Copy)]
struct Output {
    claims: bool,
    smooth: bool,
    inside: Inside,
}

/// How hits are written, and how the medium is drawn.
fn settings(knobs: &Knobs) -> Result<(Output, Settings), RenderError> {
    let k = ResolvedKnobs::new(INFO.knobs, knobs)?;
    let output = Output {
        claims: k.word("claims") == "on",
        smooth: k.word("shading") == "smooth",
        inside: Inside::new(&k),
    };
    Ok((output, medium_settings(&k)))
}

/// How the medium is drawn.
pub(crate) fn medium_settings(k: &ResolvedKnobs) -> Settings {
    Settings {
        model: if k.word("model") == "williams-max" {
            Model::WilliamsMax
        } else {
            Model::WilhelmsVanGelder
        },
        integration: match k.word("integration") {
            "table3d" => Integration::Table3,
            "table2d" => Integration::Table2,
            _ => Integration::Exact,
        },
        nodes: k.int("table") as usize,
        sort: if k.word("sort") == "visibility" {
            Sort::Visibility
        } else {
            Sort::Centroids
        },
    }
}

#[derive(Debug)]
struct Cellproj {
    pool: Pool,
    level: Level,
    output: Output,
    settings: Settings,
    request: Request,
    cells: Option<Cells>,
    /// Of the points, made where smooth shading of surfaces asks for them.
    normals: Option<Vec<Vec3>>,
    /// Of the cells, made with the first transfer function.
    volume: Option<Volume>,
    transfer: Option<TransferFunction>,
    /// Of the cells and the transfer function.
    filled: Option<Filled>,
    surfaces: Option<Isovalues>,
    /// Of the cells and surfaces.
    active: Vec<ActiveCell>,
    view: Option<View>,
    /// The patches of the last frame; made by `render`, because they depend on data, surfaces and view.
    prepared: Option<Prepared>,
    /// The medium of the last frame.
    image: Option<Image>,
    frame: Option<Frame>,
    work: Work,
}

impl Cellproj {
    /// Makes what the medium needs.
    fn fill(&mut self) -> Result<(), RenderError> {
        (self.filled, self.image) = (None, None);
        let (Some(cells), Some(transfer)) = (&self.cells, &self.transfer) else {
            return Ok(());
        };
        let extent = (cells.bounds.1 - cells.bounds.0).max_element();
        // Products of three lengths and their reciprocals have to be numbers.
        if !cells.cells.is_empty() && !(1e-100..=1e100).contains(&extent) {
            let what =
                format!("its extent of {extent:e} leaves no room for a medium, which takes 1e-100 to 1e100; scale its points");
            return Err(DataError::Mesh(what).into());
        }
        let (volume, settings) = (&mut self.volume, self.settings);
        self.filled = Some(self.pool.install(|| -> Result<Filled, RenderError> {
            if volume.is_none() {
                *volume = Some(Volume::new(cells)?);
            }
            let volume = volume.as_ref().expect("made above");
            Ok(Filled::new(cells, volume, transfer, settings))
        })?);
        Ok(())
    }

    /// The frame with a medium.
    fn draw_medium(&self, prepared: &Prepared, stop: &Stop) -> Result<Option<Image>, RenderError> {
        let (Some(filled), Some(volume)) = (&self.filled, &self.volume) else {
            return Ok(None);
        };
        let draw = Draw {
            mesh: self.cells.as_ref().ok_or(RenderError::NotReady("set_data"))?,
            volume,
            filled,
            surfaces: self.surfaces.as_ref().ok_or(RenderError::NotReady("set_surfaces"))?,
            prepared,
            view: self.view.as_ref().ok_or(RenderError::NotReady("set_view"))?,
            nearest_only: self.nearest_only(),
            sort: self.settings.sort,
            look: self.look(),
            level: self.level,
            stop,
        };
        let image = self.pool.install(|| draw.run())?;
        if stop.is_raised() {
            return Err(RenderError::Stopped);
        }
        image.map(Some).ok_or_else(|| rays_with_medium().into())
    }

    /// To be called where normals were made.
    fn look(&self) -> Look<'_> {
        let shading = match &self.normals {
            Some(normals) if self.output.smooth => Shading::Smooth(normals),
            _ => Shading::Flat,
        };
        let inside = self.output.inside;
        Look { shading, inside }
    }

    /// Makes the normals, if surfaces are to be shaded with them.
    fn smooth(&mut self) {
        let surfaces = self.surfaces.as_ref().is_some_and(|s| !s.values().is_empty());
        if let (Some(cells), None, true) = (&self.cells, &self.normals, self.output.smooth && surfaces) {
            self.normals = Some(at_points(cells));
        }
    }

    fn nearest_only(&self) -> bool {
        self.surfaces.as_ref().is_some_and(|s| nearest_only(s, &self.request))
    }

    fn activate(&mut self) {
        self.prepared = None;
        self.active = match (&self.cells, &self.surfaces) {
            (Some(cells), Some(surfaces)) => self.pool.install(|| cells.active(surfaces.values())),
            _ => Vec::new(),
        };
    }
}

impl Renderer for Cellproj {
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
        self.cells = Some(self.pool.install(|| Cells::new(mesh))?);
        (self.volume, self.normals) = (None, None);
        self.activate();
        self.smooth();
        self.fill()
    }

    fn set_surfaces(&mut self, surfaces: &[Surface]) -> Result<(), RenderError> {
        self.surfaces = Some(Isovalues::new(&INFO, surfaces)?);
        self.activate();
        self.smooth();
        Ok(())
    }

    fn set_medium(&mut self, medium: Option<&TransferFunction>) -> Result<(), RenderError> {
        self.transfer = match medium {
            None => None,
            Some(m) => Some(TransferFunction::new(m.points.clone(), m.unit)?),
        };
        self.fill()
    }

    fn set_view(&mut self, view: &View) -> Result<(), RenderError> {
        view.validate()?;
        check_open_cuts(&INFO, view)?;
        if !matches!(view.camera, Camera::Rays(_)) && view.height > 65_536 {
            return Err(RenderError::View(
                "cellproj counts to 65536 rows; give a smaller --size".into(),
            ));
        }
        self.view = Some(view.clone());
        self.prepared = None;
        Ok(())
    }

    fn set_knobs(&mut self, knobs: &Knobs) -> Result<(), RenderError> {
        let (output, settings) = settings(knobs)?;
        self.output = output;
        self.smooth();
        let before = std::mem::replace(&mut self.settings, settings);
        let same = Settings {
            sort: settings.sort,
            ..before
        };
        if same != settings { self.fill() } else { Ok(()) }
    }

    fn render(&mut self, stop: &Stop) -> Result<RenderTime, RenderError> {
        let cells = self.cells.as_ref().ok_or(RenderError::NotReady("set_data"))?;
        let surfaces = self.surfaces.as_ref().ok_or(RenderError::NotReady("set_surfaces"))?;
        let view = self.view.as_ref().ok_or(RenderError::NotReady("set_view"))?;
        let start = Instant::now();
        let (level, active) = (self.level, &self.active);
        // Patches are made anew in every frame: projection is what the method does, not preparation.
        let prepared = self
            .pool
            .install(|| Prepared::new(cells, active, surfaces.values(), view, level));
        // A frame drawn in part is none.
        let mut frame = self.frame.take().unwrap_or_default();
        let image = self.draw_medium(&prepared, stop)?;
        let resolver = Resolver {
            cells,
            isovalues: surfaces.values(),
            clips: &view.clips,
        };
        let total = [AtomicU64::new(0), AtomicU64::new(0)];
        let nearest_only = self.nearest_only();
        let (request, claims, look) = (&self.request, self.output.claims, self.look());
        render_tiles(&self.pool, view, request, stop, &mut frame, |tile, out| {
            let mut write = Write {
                cells,
                surfaces,
                claims,
                look,
                out,
            };
            if let Some(image) = &image {
                let rays = view.generator();
                for (x, y) in tile.pixels() {
                    let (roots, covered, rgba) = image.pixel(x, y);
                    write.coloured(&rays, (x, y), roots, covered, rgba);
                }
                return;
            }
            let work = level.run(DrawTile {
                prepared: &prepared,
                resolver,
                view,
                nearest_only,
                tile,
                emit: write,
            });
            total[0].fetch_add(work.fragments, Ordering::Relaxed);
            total[1].fetch_add(work.resolved, Ordering::Relaxed);
        })?;
        let [fragments, resolved] = total.map(AtomicU64::into_inner);
        self.work = image.as_ref().map_or(Work { fragments, resolved }, |i| i.work);
        self.frame = Some(frame);
        self.image = image;
        self.prepared = Some(prepared);
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
        Some(Arc::new(TetLinear::new(&self.cells.as_ref()?.mesh).ok()?))
    }

    fn memory(&self) -> Memory {
        let normals = self.normals.as_ref().map_or(0, |n| n.len() * size_of::<Vec3>());
        let mesh = normals + self.cells.as_ref().map_or(0, Cells::bytes) + self.active.len() * size_of::<ActiveCell>();
        let volume = self.volume.as_ref().map_or(0, |v| v.topology.bytes()) + self.filled.as_ref().map_or(0, Filled::bytes);
        let image = self.image.as_ref().map_or(0, |i| i.bytes);
        Memory {
            index: (mesh + volume) as u64,
            view: (self.prepared.as_ref().map_or(0, Prepared::bytes) + image) as u64,
            ..Memory::default()
        }
    }

    fn counters(&self) -> Counters {
        let (patches, entries) = self.prepared.as_ref().map_or((0, 0), Prepared::counts);
        let cells = self.cells.as_ref();
        let mut out = vec![
            ("cells", cells.map_or(0, |c| c.cells.len() as u64)),
            ("cells without volume", cells.map_or(0, |c| c.flat as u64)),
            ("inverted cells", cells.map_or(0, |c| c.inverted as u64)),
            ("active cells", self.active.len() as u64),
            ("patches", patches as u64),
            ("patches in tiles", entries as u64),
            ("fragments of surfaces", self.work.fragments),
            ("pixels resolved apart", self.work.resolved),
        ];
        if let Some(v) = &self.volume {
            let t = &v.topology;
            out.extend([
                ("parts", t.components as u64),
                ("duplicate points", t.duplicate_points as u64),
                ("boundary faces", t.boundary_faces as u64),
                ("faces of more than two cells", t.crowded_faces as u64),
                ("convex", u64::from(t.convex)),
            ]);
        }
        if let Some(i) = &self.image {
            out.extend([
                ("relations across gaps", i.counts.pairs as u64),
                ("cycles", i.counts.cycles as u64),
                ("cells in cycles", i.counts.cells_in_cycles as u64),
                ("cells in blocks", i.counts.entries as u64),
                ("microseconds of sorting", i.counts.sorting.as_micros() as u64),
                ("cells set up", i.volume.cells),
                ("fragments", i.volume.fragments),
                ("fragments sorted per pixel", i.volume.sorted),
                ("fragments out of order", i.volume.disordered),
                ("pixels out of order", i.volume.disordered_pixels),
            ]);
        }
        Counters(out)
    }
}
