//! `tetspline/cpu` as a method.

use crate::bricks::{Active, ranges};
use crate::caps::Caps;
use crate::classify::Rule;
use crate::packet::{Job, Projection};
use crate::paint::Paint;
use crate::ray::Space;
use crate::roots::Finder;
use crate::single::{Extra, draw};
use crate::smooth;
use crate::walk::{Search, Work};
use isobar_core::{
    Counters, Data, DataKind, Frame, Function, Grid, KnobKind, KnobSpec, Knobs, Memory, Method, MethodInfo, RenderError,
    RenderTime, Renderer, Request, ResolvedKnobs, Samples, Scene, Stage, Stop, Surface, TransferFunction, Unsupported, View,
};
use isobar_cpu::index::Bounds;
use isobar_cpu::nodes::Ranges;
use isobar_cpu::scene::{Isovalues, check_clipped_scene, check_medium, check_request, grid};
use isobar_cpu::{Level, Pool, copy_frame, render_tiles};
use isobar_fields::{Coefficients, Type6Spline};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

pub(crate) static INFO: MethodInfo = MethodInfo {
    id: "tetspline/cpu",
    summary: "every root of the cubic C1 spline on tetrahedra, with proofs in f64",
    paper: "Kalbe, Koch and Goesele, High-quality rendering of varying isosurfaces with cubic trivariate C1-continuous splines, ISVC 2009",
    data: DataKind::GRID,
    hits: true,
    gpu: false,
    work_unit: "active cubes crossed",
    knobs: &[
        KnobSpec {
            name: "reconstruction",
            doc: "the function drawn",
            kind: KnobKind::Choice(&["type6", "type6-prefiltered"]),
        },
        KnobSpec {
            name: "roots",
            doc: "certified: all roots with proofs; newton3: the paper's three Newton sequences, which lose some first roots and prove nothing",
            kind: KnobKind::Choice(&["certified", "newton3"]),
        },
        KnobSpec {
            name: "classify",
            doc: "tetrahedra by their coefficients, kept; cubes by their 27 data, nothing kept of tetrahedra; or paper: cubes by the determining set as printed, which loses surface and proves nothing",
            kind: KnobKind::Choice(&["coefficients", "data", "paper"]),
        },
        KnobSpec {
            name: "coefficients",
            doc: "on-the-fly: from 23 data of each tetrahedron; determining-set: by averaging from the 56 stored for each cube that a ray enters, 448 bytes, the paper's other variant, which proves nothing",
            kind: KnobKind::Choice(&["on-the-fly", "determining-set"]),
        },
        KnobSpec {
            name: "smooth",
            doc: "standard deviation, in voxels, of a Gaussian that the samples are smoothed with first; 0: as they are",
            kind: KnobKind::Float {
                default: 0.0,
                min: 0.0,
                max: 16.0,
            },
        },
        KnobSpec {
            name: "texture",
            doc: "colours: plain, or marble: solid noise at the hit",
            kind: KnobKind::Choice(&["plain", "marble"]),
        },
        KnobSpec {
            name: "overlay",
            doc: "curves: the curves where the surface crosses the faces of cubes in black",
            kind: KnobKind::Choice(&["none", "curves"]),
        },
        KnobSpec {
            name: "claims",
            doc: "prove hits and misses (EXISTS, FIRST, EMPTY) where f64 arithmetic can",
            kind: KnobKind::Choice(&["on", "off"]),
        },
    ],
    sweep: ("", &[]),
};

/// Bricks and cubes are taken to meet an isovalue within this much of the greatest |datum - isovalue|; rays whose own bound is larger (eyes more
/// than some 10^7 voxels away) claim nothing.
pub(crate) const MARGIN: f64 = 1e-6;

/// The method `tetspline/cpu`.
#[derive(Debug)]
pub struct TetsplineCpu;

/// The method `tetspline/cpu`: exact ray casting of the cubic C1 spline on the type-6 partition, on grids of any sample type, with open and closed cuts by clipping planes.
///
/// All hits in order. Guarantee with `roots=certified` and `claims=on`: a pixel with EXISTS has a root within `t_error` of t, with FIRST none before it, with EMPTY none at
/// all; the proof is the bound derived in `ray.rs`. A pixel without them was not decided: the ray touches the surface, or passes an end of the domain or a plateau, within
/// that bound (about 1e-12 of the range of the data for ordinary views). In views with closed cuts only EXISTS is claimed, of roots alone.
pub static TETSPLINE_CPU: TetsplineCpu = TetsplineCpu;

impl Method for TetsplineCpu {
    fn info(&self) -> &'static MethodInfo {
        &INFO
    }

    fn supports(&self, scene: &Scene<'_>, request: &Request) -> Result<(), Unsupported> {
        // Cuts may be closed: they are as good as open ones here.
        let mut view = scene.view.clone();
        view.clips.iter_mut().for_each(|c| c.cap = false);
        check_clipped_scene(&INFO, &Scene { view: &view, ..*scene }, request)
    }

    fn open(&self, request: &Request) -> Result<Box<dyn Renderer>, RenderError> {
        check_request(&INFO, request)?;
        Ok(Box::new(Tetspline {
            pool: Pool::new(request.threads)?,
            level: Level::detect(),
            settings: Settings::new(&request.knobs)?,
            request: request.clone(),
            grid: None,
            volume: None,
            surfaces: None,
            view: None,
            prepared: None,
            frame: None,
            work: Work::default(),
        }))
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Settings {
    prefiltered: bool,
    /// Standard deviation in voxels; 0: not smoothed.
    smooth: f64,
    /// Determining sets are stored.
    stored: bool,
    paint: Paint,
    finder: Finder,
    rule: Rule,
    claims: bool,
}

impl Settings {
    fn new(knobs: &Knobs) -> Result<Self, RenderError> {
        let k = ResolvedKnobs::new(INFO.knobs, knobs)?;
        Ok(Self {
            prefiltered: k.word("reconstruction") == "type6-prefiltered",
            finder: if k.word("roots") == "newton3" {
                Finder::Newton3
            } else {
                Finder::Certified
            },
            rule: match k.word("classify") {
                "data" => Rule::Data,
                "paper" => Rule::DeterminingSet,
                _ => Rule::Coefficients,
            },
            smooth: k.float("smooth"),
            stored: k.word("coefficients") == "determining-set",
            paint: Paint::new(&k),
            // The bound of `ray.rs` is that of coefficients on the fly.
            claims: k.word("claims") == "on" && k.word("coefficients") != "determining-set",
        })
    }
}

/// Bricks of any type of data.
#[derive(Debug)]
enum AnyBricks {
    U8(Ranges<u8>),
    I16(Ranges<i16>),
    U16(Ranges<u16>),
    F32(Ranges<f32>),
}

/// Runs `$body` with the typed data and bricks.
macro_rules! typed {
    ($volume:expr, $data:ident, $bricks:ident => $body:expr) => {
        match ($volume.spline.coefficients(), &$volume.bricks) {
            (Coefficients::Samples(Samples::U8($data)), AnyBricks::U8($bricks)) => {
                let $data: &[u8] = $data;
                $body
            }
            (Coefficients::Samples(Samples::I16($data)), AnyBricks::I16($bricks)) => {
                let $data: &[i16] = $data;
                $body
            }
            (Coefficients::Samples(Samples::U16($data)), AnyBricks::U16($bricks)) => {
                let $data: &[u16] = $data;
                $body
            }
            (Coefficients::Samples(Samples::F32($data)), AnyBricks::F32($bricks)) => {
                let $data: &[f32] = $data;
                $body
            }
            (Coefficients::F32($data), AnyBricks::F32($bricks)) => $body,
            _ => unreachable!("bricks are made from the data beside them, and those are never f64"),
        }
    };
}

#[derive(Debug)]
struct Volume {
    spline: Type6Spline,
    bricks: AnyBricks,
    range: (f64, f64),
    space: Space,
}

#[derive(Debug)]
struct Prepared {
    bounds: Vec<Bounds>,
    active: Active,
}

#[derive(Debug)]
struct Tetspline {
    pool: Pool,
    level: Level,
    settings: Settings,
    request: Request,
    grid: Option<Grid>,
    volume: Option<Volume>,
    surfaces: Option<Isovalues>,
    view: Option<View>,
    /// Made when data and surfaces are both known.
    prepared: Option<Prepared>,
    frame: Option<Frame>,
    work: Work,
}

impl Tetspline {
    /// The volume of a grid, in the memory of the one before where that suffices; the one before is kept if the data are refused.
    fn replace(&mut self, grid: &Grid, settings: Settings) -> Result<(), RenderError> {
        let dims = grid.dims;
        if dims.iter().any(|&n| n > 1 << 30) {
            return Err(isobar_core::DataError::Dims(dims).into());
        }
        let spline = self.pool.install(|| {
            let smoothed = (settings.smooth > 0.0)
                .then(|| smooth::gaussian(grid, settings.smooth))
                .transpose()?;
            let grid = smoothed.as_ref().unwrap_or(grid);
            if settings.prefiltered {
                Type6Spline::prefiltered(grid, Stage::Stored)
            } else {
                Type6Spline::new(grid)
            }
        })?;
        let old = self.volume.take().map(|v| v.bricks);
        self.volume = Some(self.pool.install(|| {
            // Bricks of the same type of data lend their memory.
            macro_rules! renewed {
                ($kind:ident, $data:expr) => {{
                    let old = old.and_then(|b| if let AnyBricks::$kind(b) = b { Some(b) } else { None });
                    AnyBricks::$kind(ranges($data, dims, old))
                }};
            }
            let bricks = match spline.coefficients() {
                Coefficients::Samples(Samples::U8(s)) => renewed!(U8, s),
                Coefficients::Samples(Samples::I16(s)) => renewed!(I16, s),
                Coefficients::Samples(Samples::U16(s)) => renewed!(U16, s),
                Coefficients::Samples(Samples::F32(s)) => renewed!(F32, s),
                Coefficients::F32(s) => renewed!(F32, s),
                Coefficients::F64(_) => unreachable!("stored data are f32"),
            };
            let mut volume = Volume {
                space: Space::new(grid.domain()),
                spline,
                bricks,
                range: (0.0, 0.0),
            };
            volume.range = typed!(volume, _data, bricks => bricks.whole());
            volume
        }));
        Ok(())
    }

    fn prepare(&mut self) {
        let mut old = self.prepared.take().map(|p| p.active);
        if let (Some(volume), Some(surfaces)) = (&self.volume, &self.surfaces) {
            let bounds: Vec<_> = surfaces
                .values()
                .iter()
                .map(|&c| Bounds::new(c, MARGIN, volume.range))
                .collect();
            let settings = self.settings;
            let active = self.pool.install(
                || typed!(volume, _data, bricks => Active::new(bricks, &bounds, settings.rule, settings.stored, old.take())),
            );
            self.prepared = Some(Prepared { bounds, active });
        }
    }
}

impl Renderer for Tetspline {
    fn set_data(&mut self, data: &Arc<Data>) -> Result<(), RenderError> {
        let grid = grid(&INFO, data)?;
        self.replace(grid, self.settings)?;
        self.grid = Some(grid.clone());
        self.prepare();
        Ok(())
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
        self.view = Some(view.clone());
        Ok(())
    }

    fn set_knobs(&mut self, knobs: &Knobs) -> Result<(), RenderError> {
        let settings = Settings::new(knobs)?;
        let before = self.settings;
        let same_data = (settings.prefiltered, settings.smooth) == (before.prefiltered, before.smooth);
        if !same_data && let Some(grid) = self.grid.clone() {
            self.replace(&grid, settings)?;
        }
        self.settings = settings;
        if !same_data || (before.rule, before.stored) != (settings.rule, settings.stored) {
            self.prepare();
        }
        Ok(())
    }

    fn render(&mut self, stop: &Stop) -> Result<RenderTime, RenderError> {
        let volume = self.volume.as_ref().ok_or(RenderError::NotReady("set_data"))?;
        let surfaces = self.surfaces.as_ref().ok_or(RenderError::NotReady("set_surfaces"))?;
        let view = self.view.as_ref().ok_or(RenderError::NotReady("set_view"))?;
        let prepared = self.prepared.as_ref().ok_or(RenderError::NotReady("set_surfaces"))?;
        let start = Instant::now();
        let total = SharedWork::default();
        let frame = self.frame.get_or_insert_with(Frame::default);
        let settings = self.settings;
        let result = typed!(volume, data, _bricks => {
            let search = Search {
                data,
                dims: volume.spline.grid().dims,
                active: &prepared.active,
                bounds: &prepared.bounds,
                finder: settings.finder,
                margin: MARGIN,
            };
            let claims = settings.claims && search.finds_all();
            let projection = Projection::new(view, &volume.space.domain);
            render_tiles(&self.pool, view, &self.request, stop, frame, |tile, out| {
                let job = Job { field: &search, space: &volume.space, view, surfaces, claims, tile, out };
                // What packets do not do.
                let caps = Caps::new(&volume.spline, &volume.space, surfaces, view);
                let alone = caps.is_some() || settings.stored || !settings.paint.is_plain();
                let projection = projection.as_ref().filter(|_| !alone);
                total.add(draw(self.level, projection, search, job, Extra { paint: settings.paint, caps }));
            })
        });
        if let Err(e) = result {
            // A frame drawn in part is none.
            self.frame = None;
            return Err(e);
        }
        self.work = total.get();
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
        let spline = &self.volume.as_ref()?.spline;
        if self.settings.prefiltered && stage == Stage::Ideal {
            return Some(Arc::new(Type6Spline::prefiltered(spline.grid(), stage).ok()?));
        }
        Some(Arc::new(spline.clone()))
    }

    fn memory(&self) -> Memory {
        let bricks = self.volume.as_ref().map_or(0, |v| typed!(v, _data, b => b.bytes()));
        let active = self.prepared.as_ref().map_or(0, |p| p.active.bytes());
        Memory {
            coefficients: self.volume.as_ref().map_or(0, |v| {
                let smoothed = if self.settings.smooth > 0.0 {
                    4 * v.spline.grid().dims.iter().product::<usize>()
                } else {
                    0
                };
                (v.spline.own_bytes() + smoothed) as u64
            }),
            index: (bricks + active) as u64,
            ..Memory::default()
        }
    }

    fn counters(&self) -> Counters {
        let active = self.prepared.as_ref().map_or(0, |p| p.active.count());
        Counters(vec![
            ("nodes", self.work.nodes),
            ("bricks", self.work.bricks),
            ("cubes", self.work.cubes),
            ("active cubes entered", self.work.active),
            ("tetrahedra", self.work.tets),
            ("cubics", self.work.cubics),
            ("rays alone", self.work.alone),
            ("active bricks", active as u64),
        ])
    }
}

/// Work of all tiles.
#[derive(Debug, Default)]
struct SharedWork([AtomicU64; 7]);

impl SharedWork {
    fn add(&self, w: Work) {
        let all = [w.nodes, w.bricks, w.cubes, w.active, w.tets, w.cubics, w.alone];
        for (total, n) in self.0.iter().zip(all) {
            total.fetch_add(n, Ordering::Relaxed);
        }
    }

    fn get(&self) -> Work {
        let [nodes, bricks, cubes, active, tets, cubics, alone] = std::array::from_fn(|i| self.0[i].load(Ordering::Relaxed));
        Work {
            nodes,
            bricks,
            cubes,
            active,
            tets,
            cubics,
            alone,
        }
    }
}
