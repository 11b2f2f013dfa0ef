//! `nurbs/cpu` and `nurbs/cpu-paper` as methods.

use crate::candidates::Candidates;
use crate::grid::{Bricks, Cells};
use crate::paper::{self, Kept, Manner};
use crate::paper_cpu::{DrawPaper, epsilon};
use crate::paper_forms::{MOST_PRODUCTS, is_feasible};
use crate::paper_parts::Cutting;
use crate::paper_silhouette::Region;
use crate::paper_volume::Bounds;
use crate::solve::{Solver, Work};
use crate::tile::{DrawTile, Index};
use isobar_core::{
    Channels, Counters, Data, DataKind, Frame, Function, HexPatches, KnobKind, KnobSpec, Knobs, Memory, Method, MethodInfo,
    RenderError, RenderTime, Renderer, Request, ResolvedKnobs, Sampling, Scene, Stage, Stop, Surface, SurfaceKind,
    TransferFunction, Unsupported, View,
};
use isobar_cpu::scene::{check_medium, check_open_cuts};
use isobar_cpu::{Level, Pool, copy_frame, render_tiles};
use isobar_fields::{GridSpline, HexField, Kind, algebraic_to_hexes, spline_to_hexes};
use std::str::FromStr;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Instant;

/// The paper.
pub(crate) const PAPER: &str = "Martin, Cohen and Kirby, Direct isosurface visualization of hex-based high-order geometry and attribute representations, IEEE TVCG 18(5), 2012";

static INFO: MethodInfo = MethodInfo {
    id: "nurbs/cpu",
    summary: "every root on trivariate rational Bezier elements, with proofs in f64",
    work_unit: "pieces",
    knobs: &[
        KnobSpec {
            name: "reconstruction",
            doc: "the spline a grid is turned into",
            kind: KnobKind::Choice(Kind::NAMES),
        },
        KnobSpec {
            name: "claims",
            doc: "prove hits and misses (EXISTS, FIRST, EMPTY) where f64 arithmetic can",
            kind: KnobKind::Choice(&["on", "off"]),
        },
    ],
    ..INFO_BASE
};

static PAPER_INFO: MethodInfo = MethodInfo {
    id: "nurbs/cpu-paper",
    summary: "subdivision per pixel as printed: boxes about the origin, the sign of delta, Newton to a quarter pixel; no claims",
    work_unit: "subdivisions",
    knobs: &[
        KnobSpec {
            name: "reconstruction",
            doc: "the spline a grid is turned into",
            kind: KnobKind::Choice(Kind::NAMES),
        },
        KnobSpec {
            name: "bounds",
            doc: "bounding volume: box along the Jacobian, axis-aligned box, box along the principal axes of the coefficients",
            kind: KnobKind::Choice(&["obb", "aabb", "pca"]),
        },
        KnobSpec {
            name: "subdivision",
            doc: "how parts are cut: de Casteljau at the middle, or the middle as one more knot",
            kind: KnobKind::Choice(&["bezier", "knots"]),
        },
        KnobSpec {
            name: "silhouettes",
            doc: "where frusta seek a silhouette the ray misses: the pixel's square as printed, or the disc about it with the curve's tangent",
            kind: KnobKind::Choice(&["square", "disc"]),
        },
    ],
    ..INFO_BASE
};

/// What both methods share.
const INFO_BASE: MethodInfo = MethodInfo {
    id: "",
    summary: "",
    paper: PAPER,
    data: DataKind::HEXES.union(DataKind::GRID).union(DataKind::ALGEBRAIC),
    hits: true,
    gpu: false,
    work_unit: "",
    knobs: &[],
    sweep: ("", &[]),
};

/// The methods of this crate.
#[derive(Debug)]
pub struct NurbsCpu {
    paper: bool,
}

/// The method `nurbs/cpu`: all hits of isosurfaces, parametric surfaces and the boundary on rational Bezier elements; grids and polynomials are turned
/// into such elements first, grids of which only isosurfaces are sought are drawn cell by cell instead (`grid.rs`). Open clipping planes. Pixel centres, and with `Sampling::PixelFrustum` the claim COVERED where the surface certainly passes through the
/// pixel's square beside its centre.
///
/// Guarantee with `claims=on`: a pixel with EXISTS has a root within `t_error` of t, with FIRST none before it, with EMPTY none at all; derived in `solve.rs`. A pixel
/// without them was not decided: LIMIT says that a contact is tangential, degenerate or at a face of an element to within rounding. With clipping planes only
/// EXISTS is claimed.
pub static NURBS_CPU: NurbsCpu = NurbsCpu { paper: false };

/// The method `nurbs/cpu-paper`: the algorithm as printed, of isosurfaces only; see `paper.rs` for what is printed and what is not. No guarantee: hits are within about
/// a quarter pixel of a root, and roots may be lost or found twice. With `Sampling::PixelFrustum` a pixel whose ray misses the surface has a hit at the point of a silhouette inside its
/// square (type 3), drawn like any other; COVERED, which is a claim, is not given.
pub static NURBS_CPU_PAPER: NurbsCpu = NurbsCpu { paper: true };

impl NurbsCpu {
    const fn own(&self) -> &'static MethodInfo {
        if self.paper { &PAPER_INFO } else { &INFO }
    }
}

impl Method for NurbsCpu {
    fn info(&self) -> &'static MethodInfo {
        self.own()
    }

    fn supports(&self, scene: &Scene<'_>, _: &Request) -> Result<(), Unsupported> {
        let info = self.own();
        check_kind(info, scene.data)?;
        check_cells(info, scene.data, scene.surfaces)?;
        check_surfaces(info, scene.surfaces)?;
        check_medium(info, scene.medium)?;
        check_open_cuts(info, scene.view)?;
        check_degrees(info, scene.data)
    }

    fn open(&self, request: &Request) -> Result<Box<dyn Renderer>, RenderError> {
        let info = self.own();
        let settings = Settings::new(info, &request.knobs)?;
        Ok(Box::new(Nurbs {
            info,
            pool: Pool::new(request.threads)?,
            level: Level::detect(),
            settings,
            request: request.clone(),
            source: None,
            bricks: None,
            patches: None,
            surfaces: None,
            view: None,
            index: None,
            frame: None,
            solvers: Mutex::default(),
            work: Work::default(),
            paper_work: paper::Work::default(),
        }))
    }
}

/// The products of the paper's form have degrees four and five times those of the elements.
fn check_degrees(info: &MethodInfo, data: &Data) -> Result<(), Unsupported> {
    match data {
        Data::Hexes(h) if info.id == PAPER_INFO.id && !h.elements.iter().all(is_feasible) => Err(feature(
            info,
            format!("elements whose silhouette products have more than {MOST_PRODUCTS} coefficients; nurbs/cpu does"),
        )),
        _ => Ok(()),
    }
}

fn feature(info: &MethodInfo, what: impl Into<String>) -> Unsupported {
    Unsupported::Feature {
        method: info.id,
        what: what.into(),
    }
}

pub(crate) fn check_kind(info: &'static MethodInfo, data: &Data) -> Result<(), Unsupported> {
    if info.data.contains(DataKind::of(data)) {
        return Ok(());
    }
    Err(Unsupported::DataKind {
        method: info.id,
        can: info.data.words(),
        given: data.kind(),
    })
}

/// Whether a grid is drawn cell by cell, without elements of all: where only isosurfaces are sought.
fn by_cells(surfaces: &[Surface]) -> bool {
    surfaces.iter().all(|s| s.value().is_some())
}

/// Other grids become elements, which there may not be too many of.
fn check_cells(info: &MethodInfo, data: &Data, surfaces: &[Surface]) -> Result<(), Unsupported> {
    const MOST: usize = 1 << 22;
    match data {
        Data::Grid(_) if by_cells(surfaces) => Ok(()),
        Data::Grid(g)
            if g.dims
                .iter()
                .try_fold(1usize, |n, &d| n.checked_mul(d))
                .is_none_or(|n| n > MOST) =>
        {
            let what = "parametric and boundary surfaces of grids";
            Err(feature(info, format!("{what} of more than {MOST} samples; crop it")))
        }
        _ => Ok(()),
    }
}

/// Isovalues that are finite, parameters in [0, 1] of an axis, boundaries.
pub(crate) fn check_surfaces(info: &MethodInfo, surfaces: &[Surface]) -> Result<(), Unsupported> {
    if surfaces.len() > 255 {
        return Err(feature(info, format!("{} surfaces; 255 are the most", surfaces.len())));
    }
    for s in surfaces {
        match s.kind {
            SurfaceKind::Isovalue(c) if !c.is_finite() => {
                return Err(feature(info, format!("the isovalue {c}; give a finite number")));
            }
            SurfaceKind::Isovalue(_) => {}
            _ if info.id == PAPER_INFO.id => return Err(feature(info, "parametric and boundary surfaces; nurbs/cpu does")),
            SurfaceKind::Boundary => {}
            SurfaceKind::Parameter { axis, value } if axis < 3 && (0.0..=1.0).contains(&value) => {}
            SurfaceKind::Parameter { axis, value } => {
                return Err(feature(
                    info,
                    format!("the surface of parameter {axis} at {value}; give axis 0, 1 or 2 and a value from 0 to 1"),
                ));
            }
            _ => return Err(feature(info, "surfaces of this kind")),
        }
    }
    Ok(())
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Settings {
    kind: Kind,
    claims: bool,
    /// Of the paper's form; `None` for the other.
    paper: Option<Literal>,
}

/// The paper's choices.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Literal {
    bounds: Bounds,
    cutting: Cutting,
    region: Region,
}

impl Settings {
    fn new(info: &'static MethodInfo, knobs: &Knobs) -> Result<Self, RenderError> {
        let k = ResolvedKnobs::new(info.knobs, knobs)?;
        let paper = (info.id == PAPER_INFO.id).then(|| Literal {
            bounds: match k.word("bounds") {
                "aabb" => Bounds::Aabb,
                "pca" => Bounds::Pca,
                _ => Bounds::Obb,
            },
            cutting: match k.word("subdivision") {
                "knots" => Cutting::Knots,
                _ => Cutting::Bezier,
            },
            region: match k.word("silhouettes") {
                "disc" => Region::Disc,
                _ => Region::Square,
            },
        });
        Ok(Self {
            kind: Kind::from_str(k.word("reconstruction"))?,
            claims: paper.is_none() && k.word("claims") == "on",
            paper,
        })
    }
}

/// The elements of some data: their own, or what grids and polynomials are turned into.
pub(crate) fn elements(info: &'static MethodInfo, data: &Data, kind: Kind) -> Result<HexPatches, RenderError> {
    check_kind(info, data)?;
    Ok(match data {
        Data::Hexes(h) => HexPatches::new(h.elements.clone())?,
        Data::Grid(g) => spline_to_hexes(g, kind, Stage::Stored)?,
        Data::Algebraic(a) => algebraic_to_hexes(a)?,
        other => {
            return Err(Unsupported::DataKind {
                method: info.id,
                can: info.data.words(),
                given: other.kind(),
            }
            .into());
        }
    })
}

#[derive(Debug)]
struct Nurbs {
    info: &'static MethodInfo,
    pool: Pool,
    level: Level,
    settings: Settings,
    request: Request,
    source: Option<Arc<Data>>,
    /// Of a grid that is drawn cell by cell.
    bricks: Option<Bricks>,
    /// Of everything else.
    patches: Option<HexPatches>,
    surfaces: Option<Vec<Surface>>,
    view: Option<View>,
    index: Option<Index>,
    frame: Option<Frame>,
    /// One per thread that has drawn a tile.
    solvers: Mutex<Vec<Solver>>,
    work: Work,
    paper_work: paper::Work,
}

impl Nurbs {
    /// Whether the data are drawn cell by cell (a grid of which no other surfaces are known to be sought).
    fn by_cells(&self) -> bool {
        matches!(self.source.as_deref(), Some(Data::Grid(_))) && by_cells(self.surfaces.as_deref().unwrap_or_default())
    }

    /// Makes what the data and surfaces known so far ask for, where it is not there.
    fn prepare(&mut self) -> Result<(), RenderError> {
        self.index = None;
        let Some(data) = self.source.clone() else { return Ok(()) };
        let kind = self.settings.kind;
        if let (Data::Grid(g), true) = (&*data, self.by_cells()) {
            self.patches = None;
            if self.bricks.is_none() {
                self.bricks = Some(self.pool.install(|| Bricks::new(g, kind))?);
            }
        } else {
            self.bricks = None;
            if self.patches.is_none() {
                check_cells(self.info, &data, self.surfaces.as_deref().unwrap_or_default())?;
                check_degrees(self.info, &data)?;
                self.patches = Some(self.pool.install(|| elements(self.info, &data, kind))?);
            }
        }
        let Some(surfaces) = &self.surfaces else { return Ok(()) };
        self.index = match (&self.bricks, &self.patches) {
            (Some(b), _) => Some(Index::Cells(Box::new(self.pool.install(|| Cells::new(b, surfaces))))),
            (None, Some(p)) => Some(Index::Elements(p.clone(), Box::new(Candidates::new(p, surfaces)))),
            (None, None) => None,
        };
        Ok(())
    }

    /// Prepares for new data or another reconstruction; where that fails, everything is as it was, `undo` included.
    fn change(&mut self, undo: impl FnOnce(&mut Self)) -> Result<(), RenderError> {
        let former = (self.index.take(), self.bricks.take(), self.patches.take());
        let prepared = self.prepare();
        if prepared.is_err() {
            (self.index, self.bricks, self.patches) = former;
            undo(self);
        }
        prepared
    }
}

impl Renderer for Nurbs {
    fn set_data(&mut self, data: &Arc<Data>) -> Result<(), RenderError> {
        check_kind(self.info, data)?;
        let former = self.source.replace(Arc::clone(data));
        self.change(|r| r.source = former)
    }

    fn set_surfaces(&mut self, surfaces: &[Surface]) -> Result<(), RenderError> {
        check_surfaces(self.info, surfaces)?;
        let former = self.surfaces.replace(surfaces.to_vec());
        if let Err(e) = self.prepare() {
            self.surfaces = former;
            // What served them did so before.
            self.prepare()?;
            return Err(e);
        }
        Ok(())
    }

    fn set_medium(&mut self, medium: Option<&TransferFunction>) -> Result<(), RenderError> {
        Ok(check_medium(self.info, medium)?)
    }

    fn set_view(&mut self, view: &View) -> Result<(), RenderError> {
        view.validate()?;
        check_open_cuts(self.info, view)?;
        self.view = Some(view.clone());
        Ok(())
    }

    fn set_knobs(&mut self, knobs: &Knobs) -> Result<(), RenderError> {
        let settings = Settings::new(self.info, knobs)?;
        let other = settings.kind != self.settings.kind && matches!(self.source.as_deref(), Some(Data::Grid(_)));
        let former = std::mem::replace(&mut self.settings, settings);
        if other {
            self.change(|r| r.settings = former)?;
        }
        Ok(())
    }

    fn render(&mut self, stop: &Stop) -> Result<RenderTime, RenderError> {
        self.source.as_ref().ok_or(RenderError::NotReady("set_data"))?;
        let surfaces = self.surfaces.as_ref().ok_or(RenderError::NotReady("set_surfaces"))?;
        let view = self.view.as_ref().ok_or(RenderError::NotReady("set_view"))?;
        let index = self.index.as_ref().ok_or(RenderError::NotReady("set_surfaces"))?;
        let start = Instant::now();
        let total = SharedWork::default();
        let paper_total = Mutex::new(paper::Work::default());
        let frusta = self.request.sampling == Sampling::PixelFrustum;
        let manner = self.settings.paper.map(|p| Manner {
            bounds: p.bounds,
            cutting: p.cutting,
            region: frusta.then_some(p.region),
            epsilon: epsilon(view),
        });
        let kept = Kept::default();
        let stops = stops(&self.request, surfaces, view);
        let frame = self.frame.get_or_insert_with(Frame::default);
        let solvers = &self.solvers;
        let take = || solvers.lock().map_or_else(|_| None, |mut s| s.pop());
        let result = render_tiles(&self.pool, view, &self.request, stop, frame, |tile, out| {
            if let Some(manner) = manner {
                let draw = DrawPaper {
                    index,
                    view,
                    surfaces,
                    manner,
                    kept: &kept,
                    stop,
                };
                let work = draw.tile(tile, out);
                if let Ok(mut w) = paper_total.lock() {
                    w.add(work);
                }
                return;
            }
            let mut solver = take().unwrap_or_default();
            solver.work = Work::default();
            let draw = DrawTile {
                index,
                view,
                surfaces,
                claims: self.settings.claims,
                stops: &stops,
                frusta,
                stop,
                tile,
                out,
                solver: &mut solver,
            };
            self.level.run(draw);
            total.add(solver.work);
            if let Ok(mut s) = solvers.lock() {
                s.push(solver);
            }
        });
        if let Err(e) = result {
            // A frame drawn in part is none.
            self.frame = None;
            return Err(e);
        }
        self.work = total.get();
        self.paper_work = paper_total.into_inner().unwrap_or_default();
        self.paper_work.forms = kept.bytes() as u64;
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
        if let Some(b) = &self.bricks {
            return match (stage, self.source.as_deref()?) {
                (Stage::Ideal, Data::Grid(g)) => Some(Arc::new(GridSpline::new(g, self.settings.kind, stage).ok()?)),
                _ => Some(Arc::new(b.spline.clone())),
            };
        }
        Some(Arc::new(HexField::new(self.patches.as_ref()?).ok()?))
    }

    fn memory(&self) -> Memory {
        let own = match self.source.as_deref() {
            Some(Data::Hexes(_)) | None => 0,
            _ => self.patches.as_ref().map_or(0, |p| {
                p.elements
                    .iter()
                    .map(|e| e.points.len() * 32 + e.values.len() * 8 + size_of_val(e))
                    .sum()
            }),
        };
        let scratch = self.solvers.lock().map_or(0, |s| s.iter().map(Solver::bytes).sum());
        Memory {
            coefficients: (own + self.bricks.as_ref().map_or(0, Bricks::bytes)) as u64,
            index: match &self.index {
                Some(Index::Elements(_, c)) => c.bytes() as u64,
                Some(Index::Cells(c)) => c.bytes() as u64,
                None => 0,
            },
            view: scratch as u64,
            device: 0,
        }
    }

    fn counters(&self) -> Counters {
        if self.settings.paper.is_some() {
            let w = self.paper_work;
            return Counters(vec![
                ("subdivisions", w.subdivisions),
                ("newton steps", w.newton),
                ("undecided pixels", w.limits),
                ("hits", w.hits),
                ("lists", w.lists),
                ("list entries", w.sizes),
                ("squares of list sizes", w.squares),
                ("longest list", w.longest),
                ("silhouette subdivisions", w.silhouettes.subdivisions),
                ("silhouette points", w.silhouettes.points),
                ("silhouettes given up", w.silhouettes.limits),
                ("bytes of octants", w.octants),
                ("bytes of products", w.forms),
            ]);
        }
        let w = self.work;
        Counters(vec![
            ("elements entered", w.tasks),
            ("pieces", w.pieces),
            ("subdivisions", w.halvings),
            ("newton steps", w.newton),
            ("polynomials", w.polynomials),
            ("undecided pieces", w.limits),
            ("hits", w.hits),
            ("longest list", w.deepest),
        ])
    }
}

/// Of each surface, whether nothing behind its hits is wanted; of none where clipping planes may cut a hit away.
fn stops(request: &Request, surfaces: &[Surface], view: &View) -> Vec<bool> {
    let all = request.layers > 1 || request.channels.contains(Channels::HITS) || !view.clips.is_empty();
    let colour = request.channels.contains(Channels::RGBA);
    surfaces.iter().map(|s| !all && (!colour || s.opacity >= 1.0)).collect()
}

/// Work of all tiles.
#[derive(Debug, Default)]
struct SharedWork([AtomicU64; 8]);

impl SharedWork {
    fn add(&self, w: Work) {
        let all = [w.tasks, w.pieces, w.halvings, w.newton, w.polynomials, w.limits, w.hits];
        for (total, n) in self.0.iter().zip(all) {
            total.fetch_add(n, Ordering::Relaxed);
        }
        self.0[7].fetch_max(w.deepest, Ordering::Relaxed);
    }

    fn get(&self) -> Work {
        let [tasks, pieces, halvings, newton, polynomials, limits, hits, deepest] =
            std::array::from_fn(|i| self.0[i].load(Ordering::Relaxed));
        Work {
            tasks,
            pieces,
            halvings,
            newton,
            polynomials,
            limits,
            hits,
            deepest,
        }
    }
}
