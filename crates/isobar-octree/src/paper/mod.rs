//! `octree/cpu-paper`: the caster of the thesis's section 3.3 as printed, in f32, one ray at a time.
//!
//! The seven steps of section 3.3.3 with the parts it describes: the min/max octree over bricks of b^3 cells ([`tree`]), its parametric traversal without a stack ([`path`]), from
//! coefficients to a polynomial on the fly, composed and solved by the forms and finders of Tables 3.1 and 3.2 with their budgets ([`cell`]), the analytic normal. Every choice of the thesis
//! is a knob. Corrected only where the print does not work: the matrices (maths, corrections, section B), the listings ([`crate::compose`], [`crate::finders`]), and the
//! parameters of middle planes ([`path`]). Not here: step 4, in which the threads of a block wait for each other, which is one ray's business on a CPU, and packets that share a cell's polynomial.
//!
//! **No guarantee.** Finders with a fixed budget miss roots and find some that are not there; a cell's polynomial ends where the next begins up to rounding only; of several roots in a cell of
//! the same isovalue the first counts. README, "The thesis's caster", counts what that costs.

mod caster;
mod cell;
mod path;
#[cfg(test)]
mod tests;
mod tree;

use crate::bricks::Values;
use crate::compose::Form;
use crate::finders::{Finder, SPLITS};
use caster::{Caster, Work, normal};
use isobar_core::{
    Claim, Counters, Data, DataError, DataKind, Frame, Function, Grid, Hit, KnobKind, KnobSpec, Knobs, Memory, Method,
    MethodInfo, RenderError, RenderTime, Renderer, Request, ResolvedKnobs, Scene, Stage, Stop, Surface, TransferFunction,
    Unsupported, View,
};
use isobar_cpu::packet::Projection;
use isobar_cpu::scene::{Isovalues, check_clipped_scene, check_medium, check_open_cuts, check_request, grid};
use isobar_cpu::{PixelSink, Pool, Tile, TileOut, copy_frame, render_tiles};
use isobar_fields::{Coefficients as Stored, GridSpline, Kind};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;
use tree::{Coefficients, Tree};

pub(crate) static INFO: MethodInfo = MethodInfo {
    id: "octree/cpu-paper",
    summary: "as printed: one ray at a time in f32 through a min/max octree without a stack, with the thesis's compositions and root finders",
    paper: crate::cpu::INFO.paper,
    data: DataKind::GRID,
    hits: true,
    gpu: false,
    work_unit: "cells composed",
    knobs: &[
        KnobSpec {
            name: "reconstruction",
            doc: "the function drawn",
            kind: KnobKind::Choice(Kind::NAMES),
        },
        KnobSpec {
            name: "brick",
            doc: "cells along a side of a brick; a volume of more than 1024 bricks along an axis is refused",
            kind: KnobKind::Choice(&["2", "1", "4", "8", "16"]),
        },
        KnobSpec {
            name: "composition",
            doc: "of a cell's polynomial with the ray: scaled Bernstein form with the products of 0, 1 or 2 sums calculated before, power form by Horner's scheme or multiplied out",
            kind: KnobKind::Choice(&["sb2", "sb1", "sb0", "pf", "naive"]),
        },
        KnobSpec {
            name: "finder",
            doc: "of the first root: Lane and Riesenfeld, Morken and Reimers, regula falsi after isolation, Sturm's chain",
            kind: KnobKind::Choice(&["lr81", "mr07", "arfbs", "sturm"]),
        },
        KnobSpec {
            name: "iterations",
            doc: "of the finder; 0: as the thesis, 3, 5 and 7 in degrees 1, 2 and 3",
            kind: KnobKind::Int {
                default: 0,
                min: 0,
                max: 64,
            },
        },
    ],
    sweep: ("iterations", &["1", "2", "3", "5", "7", "11", "24"]),
};

/// The method `octree/cpu-paper`.
#[derive(Debug)]
pub struct OctreeCpuPaper;

/// The method `octree/cpu-paper`: Steinberger 2010, section 3.3, as printed; [`crate::OCTREE_CPU`] is the exact and faster form.
///
/// Grids of any sample type, the reconstructions of [`Kind::ALL`], several isovalues, open cuts by clipping planes. Hits in order, at most one for each cell and isovalue. t in
/// units of the ray's direction, normals in the world. No guarantee and no claims. Source: sections 3.2 and 3.3; corrections: maths, section B, and the documentation of [`crate::compose`] and
/// [`crate::finders`].
pub static OCTREE_CPU_PAPER: OctreeCpuPaper = OctreeCpuPaper;

impl Method for OctreeCpuPaper {
    fn info(&self) -> &'static MethodInfo {
        &INFO
    }

    fn supports(&self, scene: &Scene<'_>, request: &Request) -> Result<(), Unsupported> {
        check_clipped_scene(&INFO, scene, request)
    }

    fn open(&self, request: &Request) -> Result<Box<dyn Renderer>, RenderError> {
        check_request(&INFO, request)?;
        Ok(Box::new(Paper {
            pool: Pool::new(request.threads)?,
            settings: Settings::new(&request.knobs)?,
            request: request.clone(),
            volume: None,
            surfaces: None,
            view: None,
            frame: None,
            work: Counters::default(),
        }))
    }
}

/// The knobs.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Settings {
    kind: Kind,
    /// Bricks have 2^`side` cells a side.
    side: u32,
    form: Form,
    finder: Finder,
}

impl Settings {
    fn new(knobs: &Knobs) -> Result<Self, RenderError> {
        let knobs = ResolvedKnobs::new(INFO.knobs, knobs)?;
        let kind: Kind = knobs.word("reconstruction").parse()?;
        let n = match knobs.int("iterations") {
            0 => [3, 5, 7][kind.basis().degree - 1],
            n => n as u32,
        };
        Ok(Self {
            kind,
            side: ["1", "2", "4", "8", "16"]
                .iter()
                .position(|b| *b == knobs.word("brick"))
                .map_or(0, |i| i as u32),
            form: match knobs.word("composition") {
                "naive" => Form::Naive,
                "pf" => Form::Pf,
                "sb0" => Form::Sb0,
                "sb1" => Form::Sb1,
                _ => Form::Sb2,
            },
            finder: match knobs.word("finder") {
                "mr07" => Finder::Mr07 { knots: n },
                "arfbs" => Finder::Arfbs {
                    splits: SPLITS,
                    iterations: n,
                },
                "sturm" => Finder::Sturm { halvings: n },
                _ => Finder::Lr81 { iterations: n },
            },
        })
    }
}

/// Coefficients and tree of a grid.
#[derive(Debug)]
struct Volume {
    grid: Grid,
    spline: GridSpline,
    tree: Tree,
    cells: [usize; 3],
}

/// Above this much of the greatest f32, a coefficient times e, binomials and sums of a composition may overflow: less than 216 * 126 * 4^3.
const MOST: f32 = f32::MAX / (1 << 21) as f32;

impl Volume {
    fn new(grid: &Grid, settings: &Settings) -> Result<Self, RenderError> {
        if grid.dims.iter().any(|&n| n > 1 << 30) {
            return Err(DataError::Dims(grid.dims).into());
        }
        let kind = settings.kind;
        let cells = grid.dims.map(|n| n - usize::from(!kind.basis().centred));
        if tree::depth(cells, settings.side).is_none() {
            let n = cells.into_iter().max().unwrap_or(0);
            // From 16384 cells on even the largest bricks are too many.
            let remedy = match (0..5).find(|&side| tree::depth(cells, side).is_some()) {
                Some(side) => format!("use --knob brick={}", 1 << side),
                None => "use --method octree/cpu".to_owned(),
            };
            return Err(Unsupported::Feature {
                method: INFO.id,
                what: format!(
                    "{n} cells along an axis with brick={}, which are more than the 1024 bricks that a path of 30 bits tells; {remedy}",
                    1 << settings.side
                ),
            }
            .into());
        }
        let spline = GridSpline::new(grid, kind, Stage::Stored)?;
        let tree =
            Tree::new(values(&spline), grid.dims, cells, kind.basis().degree, settings.side).ok_or(DataError::Dims(grid.dims))?;
        let [lo, hi] = tree.range(0, [0; 3]);
        if lo < -MOST || hi > MOST {
            return Err(DataError::Unknown(format!(
                "polynomials of {kind} overflow f32: samples come too near to 3.4e38; scale them down"
            ))
            .into());
        }
        Ok(Self {
            grid: grid.clone(),
            spline,
            tree,
            cells,
        })
    }
}

/// The coefficients of [`Stage::Stored`], which are never f64.
fn values(spline: &GridSpline) -> Values<'_> {
    match spline.coefficients() {
        Stored::Samples(s) => Values::of(s),
        Stored::F32(c) => Values::F32(c),
        Stored::F64(_) => Values::F32(&[]),
    }
}

#[derive(Debug)]
struct Paper {
    pool: Pool,
    settings: Settings,
    request: Request,
    volume: Option<Volume>,
    surfaces: Option<Isovalues>,
    view: Option<View>,
    frame: Option<Frame>,
    work: Counters,
}

impl Renderer for Paper {
    fn set_data(&mut self, data: &Arc<Data>) -> Result<(), RenderError> {
        let grid = grid(&INFO, data)?;
        let settings = self.settings;
        self.volume = Some(self.pool.install(|| Volume::new(grid, &settings))?);
        Ok(())
    }

    fn set_surfaces(&mut self, surfaces: &[Surface]) -> Result<(), RenderError> {
        self.surfaces = Some(Isovalues::new(&INFO, surfaces)?);
        Ok(())
    }

    fn set_medium(&mut self, medium: Option<&TransferFunction>) -> Result<(), RenderError> {
        Ok(check_medium(&INFO, medium)?)
    }

    fn set_view(&mut self, view: &View) -> Result<(), RenderError> {
        view.validate()?;
        check_open_cuts(&INFO, view)?;
        self.view = Some(view.clone());
        Ok(())
    }

    fn set_knobs(&mut self, knobs: &Knobs) -> Result<(), RenderError> {
        let settings = Settings::new(knobs)?;
        let rebuilds = (settings.kind, settings.side) != (self.settings.kind, self.settings.side);
        if let Some(volume) = self.volume.as_ref().filter(|_| rebuilds) {
            let grid = &volume.grid;
            self.volume = Some(self.pool.install(|| Volume::new(grid, &settings))?);
        }
        self.settings = settings;
        Ok(())
    }

    fn render(&mut self, stop: &Stop) -> Result<RenderTime, RenderError> {
        let volume = self.volume.as_ref().ok_or(RenderError::NotReady("set_data"))?;
        let surfaces = self.surfaces.as_ref().ok_or(RenderError::NotReady("set_surfaces"))?;
        let view = self.view.as_ref().ok_or(RenderError::NotReady("set_view"))?;
        let start = Instant::now();
        let basis = self.settings.kind.basis();
        let domain = volume.grid.domain();
        let job = Job {
            caster: Caster {
                tree: &volume.tree,
                coefficients: Coefficients {
                    values: values(&volume.spline),
                    dims: volume.grid.dims,
                    border: self.settings.kind.border(),
                },
                cells: volume.cells.map(|n| n as u32),
                domain,
                shift: if basis.centred { 0.5 } else { 0.0 },
                surfaces,
                form: self.settings.form,
                finder: self.settings.finder,
            },
            view,
            launched: Projection::new(view, &domain).and_then(|p| p.bounds(domain.hi.to_array())),
        };
        let total = Totals::default();
        let frame = self.frame.get_or_insert_with(Frame::default);
        let drawn = render_tiles(&self.pool, view, &self.request, stop, frame, |tile, out| {
            total.add(match basis.degree {
                1 => job.draw::<1, 4>(tile, out),
                2 => job.draw::<2, 7>(tile, out),
                _ => job.draw::<3, 10>(tile, out),
            });
        });
        if let Err(e) = drawn {
            // A frame drawn in part is none.
            self.frame = None;
            return Err(e);
        }
        self.work = total.counters();
        Ok(RenderTime {
            wall: start.elapsed(),
            device: None,
        })
    }

    fn read(&mut self, out: &mut Frame) -> Result<(), RenderError> {
        copy_frame(self.frame.as_ref().ok_or(RenderError::NotReady("render"))?, out);
        Ok(())
    }

    fn reconstruction(&self, stage: Stage) -> Option<Arc<dyn Function>> {
        let volume = self.volume.as_ref()?;
        match stage {
            Stage::Stored => Some(Arc::new(volume.spline.clone())),
            Stage::Ideal => Some(Arc::new(GridSpline::new(&volume.grid, self.settings.kind, stage).ok()?)),
        }
    }

    fn memory(&self) -> Memory {
        let bytes = |of: fn(&Volume) -> usize| self.volume.as_ref().map_or(0, of) as u64;
        Memory {
            coefficients: bytes(|v| v.spline.own_bytes()),
            index: bytes(|v| v.tree.bytes()),
            ..Memory::default()
        }
    }

    fn counters(&self) -> Counters {
        self.work.clone()
    }
}

/// One frame.
struct Job<'a> {
    caster: Caster<'a>,
    view: &'a View,
    /// Least and greatest x and y of the pixels that can see the volume (section 3.3.4); `None`: any.
    launched: Option<[[f64; 2]; 2]>,
}

impl Job<'_> {
    fn draw<const D: usize, const M: usize>(&self, tile: Tile, out: &mut TileOut<'_>) -> (Work, u64) {
        let mut work = Work::default();
        let mut rays = 0;
        let surfaces = self.caster.surfaces;
        if surfaces.values().is_empty() {
            return (work, rays);
        }
        let generator = self.view.generator();
        for (x, y) in tile.pixels() {
            let within = |[lo, hi]: [f64; 2], at: usize| lo <= at as f64 && at as f64 <= hi;
            if self
                .launched
                .is_some_and(|[across, down]| !within(across, x) || !within(down, y))
            {
                continue;
            }
            rays += 1;
            let ray = generator.ray(x, y);
            let before = work.cells;
            let mut sink = PixelSink::new(out, x, y, &ray, surfaces.all());
            if let Some(kept) = generator.kept(&ray) {
                self.caster.roots::<D, M>(&ray, kept, &mut work, |root| {
                    sink.push(&Hit {
                        t: root.t,
                        point: ray.at(root.t),
                        normal: normal(&self.caster.domain, root.gradient),
                        surface: surfaces.surface(root.value),
                        t_error: f64::INFINITY,
                    })
                });
            }
            sink.finish(Claim::empty(), (work.cells - before) as u32);
        }
        (work, rays)
    }
}

/// Work of all tiles.
#[derive(Debug, Default)]
struct Totals([AtomicU64; 5]);

impl Totals {
    fn add(&self, (w, rays): (Work, u64)) {
        for (total, n) in self.0.iter().zip([rays, w.nodes, w.bricks, w.cells, w.roots]) {
            total.fetch_add(n, Ordering::Relaxed);
        }
    }

    fn counters(&self) -> Counters {
        let names = ["rays launched", "nodes", "bricks", "cells composed", "roots found"];
        Counters(
            names
                .into_iter()
                .zip(&self.0)
                .map(|(n, w)| (n, w.load(Ordering::Relaxed)))
                .collect(),
        )
    }
}
