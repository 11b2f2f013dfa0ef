//! `octree/cpu`: the trilinear caster as a method.

use crate::bricks::{Active, Bricks, Sample};
use crate::walk::{Bounds, Entry, Root, Scratch, Search, Space, Walk, Work};
use glam::DVec3;
use isobar_core::{
    Claim, Counters, Data, DataKind, Frame, Function, Grid, Hit, KnobKind, KnobSpec, Knobs, Memory, Method, MethodInfo, Ray,
    RenderError, RenderTime, Renderer, Request, ResolvedKnobs, Samples, Scene, Stage, Stop, Surface, TransferFunction,
    Unsupported, View,
};
use isobar_cpu::scene::{Isovalues, check_medium, check_request, check_scene, check_view, grid};
use isobar_cpu::{Kernel, Level, PixelSink, Pool, Tile, TileOut, copy_frame, render_tiles};
use isobar_fields::{GridSpline, Kind};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

pub(crate) static INFO: MethodInfo = MethodInfo {
    id: "octree/cpu",
    summary: "every root of the trilinear interpolant, cell by cell, with proofs in f64",
    paper: "Steinberger, Isosurface rendering with spline wavelets and octrees, Graz 2010",
    data: DataKind::GRID,
    hits: true,
    gpu: false,
    work_unit: "cells visited",
    knobs: &[
        KnobSpec {
            name: "reconstruction",
            doc: "the function drawn",
            kind: KnobKind::Choice(&["trilinear"]),
        },
        KnobSpec {
            name: "claims",
            doc: "prove hits and misses (EXISTS, FIRST, EMPTY) where f64 arithmetic can",
            kind: KnobKind::Choice(&["on", "off"]),
        },
    ],
    sweep: ("", &[]),
};

/// Bricks and cells are taken to meet an isovalue within this much of the greatest |sample - isovalue|; rays whose own bound is larger
/// (eyes more than some 10^8 voxels away) claim nothing.
const MARGIN: f64 = 1e-6;

/// The method `octree/cpu`.
#[derive(Debug)]
pub struct OctreeCpu;

/// The method `octree/cpu`: exact trilinear ray casting on grids of any sample type.
///
/// All hits in order. Guarantee with `claims=on`: a pixel with EXISTS has a root within `t_error` of t, with FIRST none before it, with EMPTY none at
/// all; the proof is the bound derived in `walk.rs`. A pixel without them was not decided: the ray touches the surface, or passes an end of
/// the domain, within that bound (about 1e-13 of the range of the samples for ordinary views).
pub static OCTREE_CPU: OctreeCpu = OctreeCpu;

impl Method for OctreeCpu {
    fn info(&self) -> &'static MethodInfo {
        &INFO
    }

    fn supports(&self, scene: &Scene<'_>, request: &Request) -> Result<(), Unsupported> {
        check_scene(&INFO, scene, request)
    }

    fn open(&self, request: &Request) -> Result<Box<dyn Renderer>, RenderError> {
        check_request(&INFO, request)?;
        Ok(Box::new(Octree {
            pool: Pool::new(request.threads)?,
            level: Level::detect(),
            claims: claims(&request.knobs)?,
            request: request.clone(),
            volume: None,
            surfaces: None,
            view: None,
            prepared: None,
            frame: None,
            work: Work::default(),
        }))
    }
}

fn claims(knobs: &Knobs) -> Result<bool, RenderError> {
    Ok(ResolvedKnobs::new(INFO.knobs, knobs)?.word("claims") == "on")
}

/// Bricks of any sample type.
#[derive(Debug)]
enum AnyBricks {
    U8(Bricks<u8>),
    I16(Bricks<i16>),
    U16(Bricks<u16>),
    F32(Bricks<f32>),
}

/// Runs `$body` with the typed samples and bricks.
macro_rules! typed {
    ($volume:expr, $samples:ident, $bricks:ident => $body:expr) => {
        match (&$volume.grid.samples, &$volume.bricks) {
            (Samples::U8($samples), AnyBricks::U8($bricks)) => $body,
            (Samples::I16($samples), AnyBricks::I16($bricks)) => $body,
            (Samples::U16($samples), AnyBricks::U16($bricks)) => $body,
            (Samples::F32($samples), AnyBricks::F32($bricks)) => $body,
            _ => unreachable!("bricks are made from the samples beside them"),
        }
    };
}

#[derive(Debug)]
struct Volume {
    grid: Grid,
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
struct Octree {
    pool: Pool,
    level: Level,
    claims: bool,
    request: Request,
    volume: Option<Volume>,
    surfaces: Option<Isovalues>,
    view: Option<View>,
    /// Made when data and surfaces are both known.
    prepared: Option<Prepared>,
    frame: Option<Frame>,
    work: Work,
}

impl Octree {
    fn prepare(&mut self) {
        self.prepared = None;
        if let (Some(volume), Some(surfaces)) = (&self.volume, &self.surfaces) {
            let bounds: Vec<_> = surfaces
                .values()
                .iter()
                .map(|&c| Bounds::new(c, MARGIN, volume.range))
                .collect();
            let active = self
                .pool
                .install(|| typed!(volume, _samples, bricks => Active::new(bricks, &bounds)));
            self.prepared = Some(Prepared { bounds, active });
        }
    }
}

impl Renderer for Octree {
    fn set_data(&mut self, data: &Arc<Data>) -> Result<(), RenderError> {
        let grid = grid(&INFO, data)?;
        // Refuses what is too thin or not finite.
        GridSpline::new(grid, Kind::Trilinear, Stage::Stored)?;
        let dims = grid.dims;
        if dims.iter().any(|&n| n > 1 << 30) {
            return Err(isobar_core::DataError::Dims(dims).into());
        }
        let bricks = self.pool.install(|| match &grid.samples {
            Samples::U8(s) => AnyBricks::U8(Bricks::new(s, dims)),
            Samples::I16(s) => AnyBricks::I16(Bricks::new(s, dims)),
            Samples::U16(s) => AnyBricks::U16(Bricks::new(s, dims)),
            Samples::F32(s) => AnyBricks::F32(Bricks::new(s, dims)),
        });
        let mut volume = Volume {
            space: Space::new(grid.domain()),
            grid: grid.clone(),
            bricks,
            range: (0.0, 0.0),
        };
        volume.range = typed!(volume, _samples, bricks => bricks.whole());
        self.volume = Some(volume);
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
        check_view(&INFO, view)?;
        self.view = Some(view.clone());
        Ok(())
    }

    fn set_knobs(&mut self, knobs: &Knobs) -> Result<(), RenderError> {
        self.claims = claims(knobs)?;
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
        let result = typed!(volume, samples, _bricks => {
            let search = Search {
                samples,
                dims: volume.grid.dims,
                active: &prepared.active,
                bounds: &prepared.bounds,
                margin: MARGIN,
                claims: self.claims,
            };
            render_tiles(&self.pool, view, &self.request, stop, frame, |tile, out| {
                total.add(self.level.run(DrawTile { search, space: &volume.space, view, surfaces, tile, out }));
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
        let spline = GridSpline::new(&self.volume.as_ref()?.grid, Kind::Trilinear, stage).ok()?;
        Some(Arc::new(spline))
    }

    fn memory(&self) -> Memory {
        let bricks = self.volume.as_ref().map_or(0, |v| typed!(v, _samples, b => b.bytes()));
        let active = self.prepared.as_ref().map_or(0, |p| p.active.bytes());
        Memory {
            index: (bricks + active) as u64,
            ..Memory::default()
        }
    }

    fn counters(&self) -> Counters {
        let active = self.prepared.as_ref().map_or(0, |p| p.active.count());
        Counters(vec![
            ("nodes", self.work.nodes),
            ("bricks", self.work.bricks),
            ("cells", self.work.cells),
            ("cubics", self.work.cubics),
            ("active bricks", active as u64),
        ])
    }
}

/// Work of all tiles.
#[derive(Debug, Default)]
struct SharedWork([AtomicU64; 4]);

impl SharedWork {
    fn add(&self, w: Work) {
        for (total, n) in self.0.iter().zip([w.nodes, w.bricks, w.cells, w.cubics]) {
            total.fetch_add(n, Ordering::Relaxed);
        }
    }

    fn get(&self) -> Work {
        let [nodes, bricks, cells, cubics] = [0, 1, 2, 3].map(|i| self.0[i].load(Ordering::Relaxed));
        Work {
            nodes,
            bricks,
            cells,
            cubics,
        }
    }
}

struct DrawTile<'a, 'b, T> {
    search: Search<'a, T>,
    space: &'a Space,
    view: &'a View,
    surfaces: &'a Isovalues,
    tile: Tile,
    out: &'a mut TileOut<'b>,
}

impl<T: Sample> Kernel for DrawTile<'_, '_, T> {
    type Output = Work;

    #[inline(always)]
    fn run(self) -> Work {
        let Self {
            mut search,
            space,
            view,
            surfaces,
            tile,
            out,
        } = self;
        let rays = view.generator();
        let mut scratch = Scratch::new(surfaces.values().len());
        let mut work = Work::default();
        if surfaces.values().is_empty() {
            for (x, y) in tile.pixels() {
                PixelSink::new(out, x, y, &rays.ray(x, y), surfaces.all())
                    .finish(if search.claims { Claim::EMPTY } else { Claim::empty() }, 0);
            }
            return work;
        }
        for (x, y) in tile.pixels() {
            let ray = rays.ray(x, y);
            search.margin = space.margin(ray.origin);
            let before = work.cells;
            let mut sink = PixelSink::new(out, x, y, &ray, surfaces.all());
            let mut claim = Claim::empty();
            let mut certain = search.margin <= MARGIN;
            match Walk::enter(&ray, space, search.margin) {
                Entry::Through(walk) => {
                    let sure = certain;
                    certain &= search.roots(walk, &mut scratch, &mut work, |root| {
                        if sink.hits() == 0 && sure && root.error.is_finite() {
                            claim = if root.first {
                                Claim::EXISTS | Claim::FIRST
                            } else {
                                Claim::EXISTS
                            };
                        }
                        sink.push(&hit(&ray, root, surfaces, space, !claim.is_empty()))
                    });
                }
                Entry::Misses { certain: missed } => certain &= missed,
            }
            if sink.hits() == 0 && certain {
                claim = Claim::EMPTY;
            }
            if !search.claims {
                claim = Claim::empty();
            }
            sink.finish(claim, (work.cells - before) as u32);
        }
        work
    }
}

#[inline(always)]
fn hit(ray: &Ray, root: &Root, surfaces: &Isovalues, space: &Space, exists: bool) -> Hit {
    let g = space.world_gradient(root.gradient);
    Hit {
        t: root.t,
        point: ray.at(root.t),
        normal: g.normalize_or(DVec3::ZERO).as_vec3().to_array(),
        surface: surfaces.surface(root.surface),
        t_error: if exists { root.error } else { f64::INFINITY },
    }
}
