//! Where the time of a frame of `octree/cpu` goes, stage by stage (thesis, Table 6.3; S23).
//!
//! Rays of a packet are in different stages at once, so no clock inside the caster could part them; and the caster has none. Here a tile is drawn
//! by the ordinary code with a clock read between its three parts: rays, the way through the cells, the hits. Then two parts are taken apart by doing one of their stages again:
//! the way is walked once more with the ends of the rays known, so that no cell is looked into, which is the traversal; the rest of the way is loading, composing and looking for
//! signs. The roots are solved once more by themselves; the rest of the hits is normals, shading and storing. What is done again finds its data in the cache.

use crate::bricks::{Active, Values, ranges};
use crate::cpu::INFO;
use crate::packet::{self, Drawn, Packet, with_packet};
use crate::smooth::{self, Smooth};
use crate::trilinear::{DrawTile, MARGIN, SingleRays};
use crate::walk::{Bounds, Search, Space, Work};
use isobar_core::{Channels, DataError, Frame, Grid, RenderError, Request, Samples, Stage, Stop, Surface, View};
use isobar_cpu::packet::{Cells, Crossing, Lanes, Plain, Projection, RaySet, Rays, Wanted, WithLanes, run as lanes};
use isobar_cpu::scene::{Isovalues, check_open_cuts};
use isobar_cpu::{Level, Pool, TileOut, render_tiles};
use isobar_fields::{GridSpline, Kind};
use std::hint::black_box;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

/// The time of each stage of a frame, one thread.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Laps {
    /// Rays, their way through the volume's box, the tile's frustum.
    pub setup: Duration,
    /// Nodes, bricks and cells on the way of a packet, and the pixels they cover.
    pub traverse: Duration,
    /// Loading stencils, where a ray enters and leaves a cell, composition, and the signs of the coefficients; several changes of sign are solved here too.
    pub compose: Duration,
    /// Roots and their proofs.
    pub solve: Duration,
    /// Normals, shading, storing.
    pub finish: Duration,
    /// Rays that packets leave to be walked alone, all stages.
    pub alone: Duration,
}

impl Laps {
    /// Names of the stages, the thesis's for the first five.
    pub const NAMES: [&str; 6] = [
        "setup",
        "traverse",
        "composition + load",
        "rootfind",
        "normal calc + store",
        "rays walked alone",
    ];

    /// In the order of [`Laps::NAMES`].
    #[must_use]
    pub const fn all(&self) -> [Duration; 6] {
        [self.setup, self.traverse, self.compose, self.solve, self.finish, self.alone]
    }

    /// All stages.
    #[must_use]
    pub fn total(&self) -> Duration {
        self.all().iter().sum()
    }

    fn add(&mut self, o: &Self) {
        self.setup += o.setup;
        self.traverse += o.traverse;
        self.compose += o.compose;
        self.solve += o.solve;
        self.finish += o.finish;
        self.alone += o.alone;
    }
}

/// A frame and its stages.
#[derive(Debug, Clone)]
pub struct Staged {
    /// Of the fastest of the repeats.
    pub laps: Laps,
    /// T, normal, surface, colour and claims: what the ordinary method draws.
    pub frame: Frame,
}

/// Draws the surface `isovalue` of `grid` by the caster `octree/cpu` with claims, on one thread, `repeats` times (at least once) after a first frame
/// that is not counted: that one finds the active cells. Samples are taken as f32, which holds those of every type.
///
/// # Errors
/// As the method: data too thin or not finite, axes above 2^30 samples, views out of range, closed cuts.
pub fn stages(grid: &Grid, kind: Kind, isovalue: f64, view: &View, repeats: usize) -> Result<Staged, RenderError> {
    check_open_cuts(&INFO, view)?;
    if grid.dims.iter().any(|&n| n > 1 << 30) {
        return Err(DataError::Dims(grid.dims).into());
    }
    let job = Job {
        pool: Pool::new(1)?,
        level: Level::best(Level::detect()),
        surfaces: Isovalues::new(&INFO, &[Surface::isovalue(isovalue, 0)])?,
        view,
        repeats: repeats.max(1),
    };
    if kind != Kind::Trilinear {
        let smooth = job.pool.install(|| Smooth::new(grid, kind))?;
        let prepared = job.pool.install(|| smooth.prepare(job.surfaces.values(), None));
        return job.draw(|tile, out| {
            let mut laps = Laps::default();
            let job = smooth::Job {
                view,
                surfaces: &job.surfaces,
                tile,
                out,
                level: job.level,
                claims: true,
            };
            smooth.draw_clocked(&prepared, job, &mut laps);
            laps
        });
    }
    // Refuses what is too thin or not finite.
    GridSpline::new(grid, kind, Stage::Stored)?;
    let converted: Vec<f32>;
    let samples: &[f32] = match &grid.samples {
        Samples::F32(s) => s,
        other => {
            converted = (0..other.len()).map(|i| other.get(i) as f32).collect();
            &converted
        }
    };
    let space = Space::new(grid.domain());
    let bricks = job.pool.install(|| ranges(samples, grid.dims));
    let bounds = [Bounds::new(isovalue, MARGIN, bricks.whole())];
    let active = job.pool.install(|| Active::new(&bricks, &bounds, usize::MAX, None));
    let search = Search {
        samples: Values::F32(samples),
        dims: grid.dims,
        active: &active,
        bounds: &bounds,
        margin: MARGIN,
        claims: true,
    };
    job.draw(|tile, out| {
        let surfaces = &job.surfaces;
        let space = &space;
        linear(
            job.level,
            DrawTile {
                search,
                space,
                view,
                surfaces,
                tile,
                out,
            },
        )
    })
}

/// What all repeats share.
struct Job<'a> {
    pool: Pool,
    level: Level,
    surfaces: Isovalues,
    view: &'a View,
    repeats: usize,
}

impl Job<'_> {
    fn draw(&self, tile: impl Fn(isobar_cpu::Tile, &mut isobar_cpu::TileOut<'_>) -> Laps + Sync) -> Result<Staged, RenderError> {
        let request = Request {
            channels: Channels::T | Channels::NORMAL | Channels::SURFACE | Channels::RGBA | Channels::CLAIM,
            threads: 1,
            ..Request::default()
        };
        let mut frame = Frame::default();
        let mut best: Option<Laps> = None;
        for repeat in 0..=self.repeats {
            let total = Mutex::new(Laps::default());
            render_tiles(&self.pool, self.view, &request, &Stop::default(), &mut frame, |at, out| {
                let laps = tile(at, out);
                total.lock().unwrap_or_else(PoisonError::into_inner).add(&laps);
            })?;
            let laps = total.into_inner().unwrap_or_else(PoisonError::into_inner);
            if repeat > 0 && best.is_none_or(|b| laps.total() < b.total()) {
                best = Some(laps);
            }
        }
        Ok(Staged {
            laps: best.unwrap_or_default(),
            frame,
        })
    }
}

/// A tile of degree 1, as `trilinear::draw` draws it.
fn linear(level: Level, tile: DrawTile<'_, '_>) -> Laps {
    let mut laps = Laps::default();
    let clock = Instant::now();
    let mut rays = None;
    if packet::applies(tile.tile, tile.surfaces)
        && let Some(view) = Projection::new(tile.view, &tile.space.domain)
    {
        let together = tile.together();
        laps.setup += clock.elapsed();
        rays = Some(clocked(level, &together, &view, &mut *tile.out, &mut laps));
    }
    let clock = Instant::now();
    if rays.is_none_or(|r| r.iter().any(|&b| b != 0)) {
        let _: Work = level.run(SingleRays { tile, rays });
    }
    laps.alone += clock.elapsed();
    laps
}

/// As `packet::draw`, with clocks; gives the rays that are left.
pub(crate) fn clocked<W: Drawn>(level: Level, what: &W, view: &Projection, out: &mut TileOut<'_>, laps: &mut Laps) -> RaySet {
    with_packet(|packet| {
        let run = Run {
            what,
            packet,
            view,
            out,
            laps,
        };
        // Clocks mean nothing in builds for tests: the plain lanes, which give the same bits, are all that is compiled there.
        if cfg!(debug_assertions) {
            run.run::<Plain>()
        } else {
            lanes(level, run)
        }
    })
}

/// One tile with its clocks.
struct Run<'k, 'o, W> {
    what: &'k W,
    packet: &'k mut Packet,
    view: &'k Projection,
    out: &'k mut TileOut<'o>,
    laps: &'k mut Laps,
}

impl<W: Drawn> WithLanes for Run<'_, '_, W> {
    type Output = RaySet;

    #[inline(always)]
    fn run<S: Lanes>(self) -> RaySet {
        let Self {
            what,
            packet: p,
            view,
            out,
            laps,
        } = self;
        let (place, surfaces) = (what.place(), what.surfaces());
        let wanted = Wanted::new(out, surfaces);
        let clock = Instant::now();
        let misses = place.misses(view);
        laps.setup += clock.elapsed();
        let mut log = Log::default();
        let mut ways = [Duration::ZERO; 3];
        let mut solved = Duration::ZERO;
        let mut finish = Duration::ZERO;
        let mut left = None;
        // Once to draw; once more, to know which look into a cell ended which ray; and once with nothing but that. One loop, so that all is compiled once.
        for (mode, way) in [Mode::Run, Mode::Record, Mode::Replay].into_iter().zip(&mut ways) {
            let mut setup = Duration::ZERO;
            let clock = Instant::now();
            if misses {
                p.forget();
            } else if !p.make::<S, _>(place, wanted, false) {
                break;
            }
            setup += clock.elapsed();
            (log.looks, log.next) = (0, 0);
            loop {
                let clock = Instant::now();
                let frustum = p.next_group::<S, _>(place);
                setup += clock.elapsed();
                let Some(frustum) = frustum else { break };
                if p.rays.blocks == 0 {
                    continue;
                }
                let crossing = Crossing::new(&p.rays, place, view);
                let clock = Instant::now();
                let mut cells = Marked {
                    cells: what.cells(p, false),
                    mode,
                    log: &mut log,
                };
                black_box(crossing.cross::<S, _>(&mut cells, &frustum));
                *way += clock.elapsed();
                drop(cells);
                if mode == Mode::Run {
                    let clock = Instant::now();
                    what.roots::<S>(p);
                    solved += clock.elapsed();
                    let clock = Instant::now();
                    what.solve::<S>(p);
                    finish += clock.elapsed();
                }
            }
            if mode == Mode::Run {
                laps.setup += setup;
                let clock = Instant::now();
                p.write(place, surfaces, out, what.claims(), false);
                finish += clock.elapsed();
                left = Some(p.rays.single);
                if misses {
                    break;
                }
            }
        }
        let [way, _, traversed] = ways;
        laps.traverse += traversed;
        laps.compose += way.saturating_sub(traversed);
        laps.solve += solved;
        laps.finish += finish.saturating_sub(solved);
        left.unwrap_or_else(|| place.rays())
    }
}

/// A ray or more ended in a look into a cell.
#[derive(Debug, Clone, Copy)]
struct End {
    look: u64,
    block: u8,
    /// Rays of the block still under way after it.
    alive: u8,
}

#[derive(Debug, Default)]
struct Log {
    ends: Vec<End>,
    looks: u64,
    next: usize,
}

/// How cells are looked into.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Mode {
    Run,
    Record,
    Replay,
}

/// Cells of which the way through is noted, or that are not looked into.
struct Marked<'l, C> {
    cells: C,
    mode: Mode,
    log: &'l mut Log,
}

impl<C: Cells> Cells for Marked<'_, C> {
    #[inline(always)]
    fn rays(&mut self) -> &mut Rays {
        self.cells.rays()
    }

    #[inline(always)]
    fn size(&self) -> [i32; 3] {
        self.cells.size()
    }

    #[inline(always)]
    fn node(&self, node: [i32; 3]) -> u64 {
        self.cells.node(node)
    }

    #[inline(always)]
    fn brick(&mut self, brick: [i32; 3]) -> u64 {
        self.cells.brick(brick)
    }

    #[inline(always)]
    fn cell<S: Lanes>(&mut self, blocks: u32, cell: [i32; 3], bit: u32) {
        if self.mode == Mode::Replay {
            self.log.looks += 1;
            while let Some(end) = self.log.ends.get(self.log.next).filter(|e| e.look == self.log.looks) {
                let rays = self.cells.rays();
                rays.alive[usize::from(end.block)] = end.alive;
                if end.alive == 0 {
                    rays.blocks &= !(1 << end.block);
                }
                self.log.next += 1;
            }
            return;
        }
        if self.mode == Mode::Run {
            return self.cells.cell::<S>(blocks, cell, bit);
        }
        let before = self.cells.rays().alive;
        self.cells.cell::<S>(blocks, cell, bit);
        self.log.looks += 1;
        for (block, (before, &alive)) in (0u8..).zip(before.iter().zip(&self.cells.rays().alive)) {
            if *before != alive {
                let look = self.log.looks;
                self.log.ends.push(End { look, block, alive });
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::OCTREE_CPU;
    use isobar_core::{Camera, ClipPlane, DVec3, Data, Knobs, Method};
    use isobar_fields::Synthetic;
    use std::sync::Arc;

    /// What is clocked is what the method draws, bit for bit; every stage takes time, and no more than all of it.
    fn is_the_method(data: &Data, isovalue: f64, kind: Kind, view: &View) -> Staged {
        let Data::Grid(grid) = data else { panic!("a grid") };
        let clock = Instant::now();
        let staged = stages(grid, kind, isovalue, view, 2).unwrap();
        let wall = clock.elapsed();
        let request = Request {
            channels: staged.frame.channels,
            knobs: Knobs::default().with("reconstruction", kind.name()),
            ..Request::default()
        };
        let mut r = OCTREE_CPU.open(&request).unwrap();
        r.set_data(&Arc::new(data.clone())).unwrap();
        r.set_surfaces(&[Surface::isovalue(isovalue, 0)]).unwrap();
        r.set_view(view).unwrap();
        r.render(&Stop::default()).unwrap();
        let mut frame = Frame::default();
        r.read(&mut frame).unwrap();
        assert!(
            frame.t.iter().filter(|t| t.is_finite()).count() > 500,
            "{kind}: the surface is in view"
        );
        assert!(frame == staged.frame, "{kind}: the frames differ");
        assert!(staged.laps.total() <= wall, "{kind}: {:?} of {wall:?}", staged.laps);
        staged
    }

    #[test]
    fn stages_are_those_of_the_frame_the_method_draws() {
        let data = "marschner-lobb,n=24".parse::<Synthetic>().unwrap().data().unwrap();
        for kind in Kind::ALL {
            let laps = is_the_method(&data, 0.5, kind, &View::bench(75, 52)).laps;
            for (name, lap) in Laps::NAMES.iter().zip(laps.all()).take(5) {
                assert!(!lap.is_zero(), "{kind}: {name} took no time");
            }
        }
    }

    /// Rays that packets cannot take, a cut, and samples that are not f32.
    #[test]
    fn views_that_go_ray_by_ray_and_cuts_are_clocked_too() {
        let data = "gyroid,n=16".parse::<Synthetic>().unwrap().data().unwrap();
        let mut view = View::perspective(DVec3::new(0.1, 0.0, 0.2), DVec3::new(1.0, 0.3, 0.1), DVec3::Z, 90.0, 64, 48);
        for kind in [Kind::Trilinear, Kind::Cubic] {
            let laps = is_the_method(&data, 0.2, kind, &view).laps;
            assert!(!laps.alone.is_zero());
        }
        view = View::bench(64, 48);
        view.clips.push(ClipPlane {
            normal: DVec3::X,
            distance: 0.3,
            cap: false,
        });
        is_the_method(&data, 0.2, Kind::Quadratic, &view);
        let Data::Grid(mut grid) = data else {
            unreachable!("as=grid is the default")
        };
        let bytes: Vec<u8> = (0..grid.samples.len())
            .map(|i| (grid.samples.get(i) * 40.0 + 128.0) as u8)
            .collect();
        grid.samples = Samples::U8(bytes.into());
        view.clips.clear();
        is_the_method(&Data::Grid(grid.clone()), 136.0, Kind::Trilinear, &view);
        view.clips.push(ClipPlane {
            normal: DVec3::X,
            distance: 0.3,
            cap: true,
        });
        assert!(stages(&grid, Kind::Trilinear, 136.0, &view, 1).is_err());
        let list = View {
            camera: Camera::Rays(vec![View::bench(64, 48).ray(3, 4); 64].into()),
            width: 64,
            height: 1,
            clips: Vec::new(),
        };
        let laps = stages(&grid, Kind::Cubic, 136.0, &list, 1).unwrap().laps;
        assert!(laps.traverse.is_zero() && !laps.alone.is_zero());
    }
}
