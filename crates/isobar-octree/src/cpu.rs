//! `octree/cpu`: the casters of degrees 1, 2 and 3 as a method.

use crate::bricks::{Active, Values, ranges, room};
use crate::smooth::{self, Smooth};
use crate::trilinear::{self, DrawTile, MARGIN};
use crate::walk::{Bounds, Search, Space, Work};
use isobar_core::{
    Counters, Data, DataKind, Frame, Function, Grid, KnobKind, KnobSpec, Knobs, Memory, Method, MethodInfo, RenderError,
    RenderTime, Renderer, Request, ResolvedKnobs, Samples, Scene, Stage, Stop, Surface, TransferFunction, Unsupported, View,
};
use isobar_cpu::nodes::Ranges;
use isobar_cpu::scene::{Isovalues, check_clipped_scene, check_medium, check_open_cuts, check_request, grid};
use isobar_cpu::{Level, Pool, copy_frame, render_tiles};
use isobar_fields::{GridSpline, Kind};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

pub(crate) static INFO: MethodInfo = MethodInfo {
    id: "octree/cpu",
    summary: "every root of a trilinear, quadratic or cubic spline, cell by cell, with proofs",
    paper: "Steinberger, Isosurface rendering with spline wavelets and octrees, Graz 2010",
    data: DataKind::GRID,
    hits: true,
    gpu: false,
    work_unit: "active cells crossed",
    knobs: &[
        KnobSpec {
            name: "reconstruction",
            doc: "the function drawn",
            kind: KnobKind::Choice(Kind::NAMES),
        },
        KnobSpec {
            name: "claims",
            doc: "prove hits and misses (EXISTS, FIRST, EMPTY) in f64, and exactly where that cannot tell",
            kind: KnobKind::Choice(&["on", "off"]),
        },
    ],
    sweep: ("", &[]),
};

/// The method `octree/cpu`.
#[derive(Debug)]
pub struct OctreeCpu;

/// The method `octree/cpu`: exact ray casting of splines on grids of any sample type.
///
/// The knob `reconstruction` chooses among [`Kind::ALL`]: trilinear, quadratic and cubic B-splines with the samples as coefficients, and the two that
/// interpolate the samples. All hits in order; open cuts by clipping planes. Guarantee with `claims=on`: a pixel with EXISTS has a root within `t_error` of t, with FIRST none
/// before it, with EMPTY none at all; the proofs are the bounds derived in `walk.rs` (degree 1) and `smooth/caster.rs` (degrees 2 and 3), about
/// 1e-13 and 1e-11 of the range of the coefficients for ordinary views. Rays that this leaves open are decided in exact arithmetic (`exact.rs`), touching ones too. A pixel without
/// claims was not decided: more of its tile was left open than a frame spends exact work on. The counters tell the rays that went alone, those decided exactly, and those left open. Source: Steinberger 2010, sections 3.2 and 3.3; matrices: maths, corrections, section B.
pub static OCTREE_CPU: OctreeCpu = OctreeCpu;

impl Method for OctreeCpu {
    fn info(&self) -> &'static MethodInfo {
        &INFO
    }

    fn supports(&self, scene: &Scene<'_>, request: &Request) -> Result<(), Unsupported> {
        check_clipped_scene(&INFO, scene, request)
    }

    fn open(&self, request: &Request) -> Result<Box<dyn Renderer>, RenderError> {
        check_request(&INFO, request)?;
        Ok(Box::new(Octree {
            pool: Pool::new(request.threads)?,
            level: Level::detect(),
            claims: settings(&request.knobs)?.1,
            kind: settings(&request.knobs)?.0,
            request: request.clone(),
            grid: None,
            volume: None,
            surfaces: None,
            view: None,
            prepared: None,
            frame: None,
            work: Counters::default(),
        }))
    }
}

/// The reconstruction, and whether to claim.
fn settings(knobs: &Knobs) -> Result<(Kind, bool), RenderError> {
    let knobs = ResolvedKnobs::new(INFO.knobs, knobs)?;
    Ok((knobs.word("reconstruction").parse()?, knobs.word("claims") == "on"))
}

/// Bricks of any sample type.
#[derive(Debug)]
enum AnyBricks {
    U8(Ranges<u8>),
    I16(Ranges<i16>),
    U16(Ranges<u16>),
    F32(Ranges<f32>),
}

/// Runs `$body` with the typed bricks.
macro_rules! typed {
    ($bricks:expr, $b:ident => $body:expr) => {
        match &$bricks {
            AnyBricks::U8($b) => $body,
            AnyBricks::I16($b) => $body,
            AnyBricks::U16($b) => $body,
            AnyBricks::F32($b) => $body,
        }
    };
}

/// A volume as the caster of its degree has it.
#[derive(Debug)]
enum Volume {
    Linear(Box<Linear>),
    Smooth(Box<Smooth>),
}

/// The trilinear interpolant.
#[derive(Debug)]
struct Linear {
    grid: Grid,
    bricks: AnyBricks,
    range: (f64, f64),
    space: Space,
}

impl Linear {
    fn new(grid: &Grid) -> Result<Self, RenderError> {
        // Refuses what is too thin or not finite.
        GridSpline::new(grid, Kind::Trilinear, Stage::Stored)?;
        let dims = grid.dims;
        let bricks = match &grid.samples {
            Samples::U8(s) => AnyBricks::U8(ranges(s, dims)),
            Samples::I16(s) => AnyBricks::I16(ranges(s, dims)),
            Samples::U16(s) => AnyBricks::U16(ranges(s, dims)),
            Samples::F32(s) => AnyBricks::F32(ranges(s, dims)),
        };
        let mut linear = Self {
            space: Space::new(grid.domain()),
            grid: grid.clone(),
            bricks,
            range: (0.0, 0.0),
        };
        linear.range = typed!(linear.bricks, b => b.whole());
        Ok(linear)
    }
}

/// What depends on the isovalues.
#[derive(Debug)]
enum Prepared {
    Linear { bounds: Vec<Bounds>, active: Active },
    Smooth(smooth::Prepared),
}

#[derive(Debug)]
struct Octree {
    pool: Pool,
    level: Level,
    claims: bool,
    kind: Kind,
    request: Request,
    grid: Option<Grid>,
    volume: Option<Volume>,
    surfaces: Option<Isovalues>,
    view: Option<View>,
    /// Made when data and surfaces are both known.
    prepared: Option<Prepared>,
    frame: Option<Frame>,
    work: Counters,
}

impl Octree {
    /// Makes the volume from the grid and the reconstruction.
    fn load(&mut self) -> Result<(), RenderError> {
        self.volume = None;
        self.prepared = None;
        let Some(grid) = &self.grid else { return Ok(()) };
        let kind = self.kind;
        let volume = self.pool.install(|| match kind {
            Kind::Trilinear => Linear::new(grid).map(|l| Volume::Linear(Box::new(l))),
            _ => Ok(Volume::Smooth(Box::new(Smooth::new(grid, kind)?.with_planes()))),
        })?;
        self.volume = Some(volume);
        self.prepare();
        Ok(())
    }

    /// What depends on the isovalues, in the memory of what was there before.
    fn prepare(&mut self) {
        let old = self.prepared.take();
        if let (Some(volume), Some(surfaces)) = (&self.volume, &self.surfaces) {
            let prepared = self.pool.install(|| match (volume, old) {
                (Volume::Smooth(smooth), old) => {
                    let old = old.and_then(|p| match p {
                        Prepared::Smooth(p) => Some(p),
                        Prepared::Linear { .. } => None,
                    });
                    Prepared::Smooth(smooth.prepare(surfaces.values(), old))
                }
                (Volume::Linear(linear), old) => {
                    let bound = |&c: &f64| Bounds::new(c, MARGIN, linear.range);
                    let bounds: Vec<_> = surfaces.values().iter().map(bound).collect();
                    let old = old.and_then(|p| match p {
                        Prepared::Linear { active, .. } => Some(active),
                        Prepared::Smooth(_) => None,
                    });
                    let room = room(linear.grid.samples.bytes(), typed!(linear.bricks, b => b.bytes()));
                    let active = typed!(linear.bricks, b => Active::new(b, &bounds, room, old));
                    Prepared::Linear { bounds, active }
                }
            });
            self.prepared = Some(prepared);
        }
    }
}

impl Renderer for Octree {
    fn set_data(&mut self, data: &Arc<Data>) -> Result<(), RenderError> {
        let grid = grid(&INFO, data)?;
        if grid.dims.iter().any(|&n| n > 1 << 30) {
            return Err(isobar_core::DataError::Dims(grid.dims).into());
        }
        self.grid = Some(grid.clone());
        self.load()
    }

    fn set_surfaces(&mut self, surfaces: &[Surface]) -> Result<(), RenderError> {
        self.surfaces = Some(Isovalues::new(&INFO, surfaces)?);
        self.prepare();
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
        let (kind, claims) = settings(knobs)?;
        self.claims = claims;
        if kind != self.kind {
            self.kind = kind;
            self.load()?;
        }
        Ok(())
    }

    fn render(&mut self, stop: &Stop) -> Result<RenderTime, RenderError> {
        let volume = self.volume.as_ref().ok_or(RenderError::NotReady("set_data"))?;
        let surfaces = self.surfaces.as_ref().ok_or(RenderError::NotReady("set_surfaces"))?;
        let view = self.view.as_ref().ok_or(RenderError::NotReady("set_view"))?;
        let prepared = self.prepared.as_mut().ok_or(RenderError::NotReady("set_surfaces"))?;
        if let Prepared::Smooth(prepared) = prepared {
            prepared.begin();
        }
        let prepared = &*prepared;
        let start = Instant::now();
        let total = SharedWork::default();
        let frame = self.frame.get_or_insert_with(Frame::default);
        let result = match (volume, prepared) {
            (Volume::Linear(volume), Prepared::Linear { bounds, active }) => {
                let search = Search {
                    samples: Values::of(&volume.grid.samples),
                    dims: volume.grid.dims,
                    active,
                    bounds,
                    margin: MARGIN,
                    claims: self.claims,
                };
                render_tiles(&self.pool, view, &self.request, stop, frame, |tile, out| {
                    let space = &volume.space;
                    let tile = DrawTile {
                        search,
                        space,
                        view,
                        surfaces,
                        tile,
                        out,
                    };
                    total.linear(trilinear::draw(self.level, tile));
                })
            }
            (Volume::Smooth(volume), Prepared::Smooth(prepared)) => {
                let (level, claims) = (self.level, self.claims);
                render_tiles(&self.pool, view, &self.request, stop, frame, |tile, out| {
                    let job = smooth::Job {
                        view,
                        surfaces,
                        tile,
                        out,
                        level,
                        claims,
                    };
                    total.smooth(volume.draw(prepared, job));
                })
            }
            _ => unreachable!("what is prepared is made from the volume beside it"),
        };
        if let Err(e) = result {
            // A frame drawn in part is none.
            self.frame = None;
            return Err(e);
        }
        self.work = total.get(matches!(volume, Volume::Smooth(_)));
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
        match self.volume.as_ref()? {
            Volume::Linear(linear) => Some(Arc::new(GridSpline::new(&linear.grid, Kind::Trilinear, stage).ok()?)),
            Volume::Smooth(smooth) => smooth.function(stage),
        }
    }

    fn memory(&self) -> Memory {
        let (coefficients, bricks) = match &self.volume {
            None => (0, 0),
            Some(Volume::Linear(v)) => (0, typed!(v.bricks, b => b.bytes())),
            Some(Volume::Smooth(v)) => v.bytes(),
        };
        let active = match &self.prepared {
            None => 0,
            Some(Prepared::Linear { active, .. }) => active.bytes(),
            Some(Prepared::Smooth(p)) => p.bytes(),
        };
        Memory {
            coefficients: coefficients as u64,
            index: (bricks + active) as u64,
            ..Memory::default()
        }
    }

    fn counters(&self) -> Counters {
        let active = match &self.prepared {
            None => 0,
            Some(Prepared::Linear { active, .. }) => active.nodes.count(),
            Some(Prepared::Smooth(p)) => p.active_bricks(),
        };
        let mut counters = self.work.clone();
        counters.0.push(("active bricks", active as u64));
        counters
    }
}

/// Work of all tiles.
#[derive(Debug, Default)]
struct SharedWork([AtomicU64; 8]);

impl SharedWork {
    fn add(&self, work: [u64; 8]) {
        for (total, n) in self.0.iter().zip(work) {
            total.fetch_add(n, Ordering::Relaxed);
        }
    }

    fn linear(&self, w: Work) {
        self.add([w.alone, w.exact[0], w.exact[1], w.nodes, w.bricks, w.cells, w.cubics, 0]);
    }

    fn smooth(&self, w: smooth::Work) {
        self.add([
            w.alone, w.exact[0], w.exact[1], w.nodes, w.bricks, w.cells, w.filtered, w.composed,
        ]);
    }

    fn get(&self, smooth: bool) -> Counters {
        let names: &[&str] = if smooth {
            &["nodes", "bricks", "cells", "compositions in f32", "compositions in f64"]
        } else {
            &["nodes", "bricks", "cells", "cubics"]
        };
        let rays = &["rays alone", "rays exact", "rays undecided"];
        Counters(
            rays.iter()
                .chain(names)
                .zip(&self.0)
                .map(|(&n, w)| (n, w.load(Ordering::Relaxed)))
                .collect(),
        )
    }
}
