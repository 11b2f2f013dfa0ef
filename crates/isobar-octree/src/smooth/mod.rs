//! Tri-quadratic and tri-cubic B-splines: the caster of degrees 2 and 3.
//!
//! Steinberger 2010, sections 3.2 and 3.3. [`basis`]: the splines and the composition along a ray; [`lattice`]: coefficients, border, index space;
//! [`bricks`]: which bricks and cells a surface can meet; [`roots`]: from a cell's polynomial to roots, proved where f64 arithmetic can;
//! [`caster`]: the walk of a single ray; [`packet`] and [`along`]: tiles of rays together. The plain kinds read the samples where they are; the interpolating ones the f32 coefficients of their [`GridSpline`].

mod along;
mod basis;
mod bricks;
mod caster;
mod lattice;
mod packet;
mod roots;
#[cfg(test)]
mod tests;
mod vector;

use crate::bricks::{Values, bit};
use crate::stages::{self, Laps};
use crate::trilinear::MARGIN;
use crate::walk::Bounds;
use basis::{Cubic, Quadratic, Spline, Table};
use bricks::{Active, Bricks};
pub(crate) use caster::Work;
use caster::{DrawTile, Search};
use isobar_core::{DataError, Function, Grid, Samples, Stage, View};
use isobar_cpu::packet::RaySet;
use isobar_cpu::scene::Isovalues;
use isobar_cpu::{Level, Tile, TileOut};
use isobar_fields::{Coefficients, GridSpline, Kind};
use lattice::{Coefficient, Lattice, Space};
use std::marker::PhantomData;
use std::sync::Arc;
use std::time::Instant;

/// Bricks of any coefficient type.
#[derive(Debug)]
enum AnyBricks {
    U8(Bricks<u8>),
    I16(Bricks<i16>),
    U16(Bricks<u16>),
    F32(Bricks<f32>),
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

/// A volume as a quadratic or cubic B-spline.
#[derive(Debug)]
pub(crate) struct Smooth {
    spline: GridSpline,
    space: Space,
    bricks: AnyBricks,
    range: (f64, f64),
    single: Table<f32>,
    double: Table<f64>,
}

/// What depends on the isovalues.
#[derive(Debug)]
pub(crate) struct Prepared {
    bounds: Vec<Bounds>,
    active: Active,
}

impl Prepared {
    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        self.active.bytes()
    }

    /// Bricks a surface may meet.
    pub(crate) fn active_bricks(&self) -> usize {
        self.active.count()
    }

    /// Takes out the bricks of 4^3 cells that `keep` does not want, by their indices: nothing is drawn in them. Gives those a surface may still meet.
    pub(crate) fn retain(&self, keep: impl Fn([usize; 3]) -> bool) -> Vec<[usize; 3]> {
        let [nx, ny, nz] = self.active.dims.map(|n| 4 * n);
        let mut left = Vec::new();
        for [z, y, x] in (0..nx * ny * nz).map(|i| [i / (nx * ny), i / nx % ny, i % nx]) {
            let brick = [x as i32, y as i32, z as i32];
            let word = self.active.word_of(brick.map(|b| b >> 2));
            if self.active.word(word) >> bit(brick) & 1 == 0 {
                continue;
            }
            if keep([x, y, z]) {
                left.push([x, y, z]);
            } else {
                // What a ray would do that finds no active cell in it.
                self.active.cells(word, bit(brick), || 0);
            }
        }
        left
    }
}

/// One tile of a frame.
pub(crate) struct Job<'a, 'b> {
    pub(crate) view: &'a View,
    pub(crate) surfaces: &'a Isovalues,
    pub(crate) tile: Tile,
    pub(crate) out: &'a mut TileOut<'b>,
    pub(crate) level: Level,
    pub(crate) claims: bool,
}

impl Smooth {
    /// The reconstruction `kind`, of degree 2 or 3, of `grid`, whose axes have at most 2^30 samples.
    ///
    /// # Errors
    /// As [`GridSpline::new`].
    pub(crate) fn new(grid: &Grid, kind: Kind) -> Result<Self, DataError> {
        let spline = GridSpline::new(grid, kind, Stage::Stored)?;
        let cubic = kind.basis().degree == 3;
        let dims = grid.dims;
        fn bricks<T: Coefficient>(c: &[T], dims: [usize; 3], cubic: bool) -> Bricks<T> {
            if cubic {
                Bricks::new::<Cubic>(c, dims)
            } else {
                Bricks::new::<Quadratic>(c, dims)
            }
        }
        let bricks = match spline.coefficients() {
            Coefficients::Samples(Samples::U8(c)) => AnyBricks::U8(bricks(c, dims, cubic)),
            Coefficients::Samples(Samples::I16(c)) => AnyBricks::I16(bricks(c, dims, cubic)),
            Coefficients::Samples(Samples::U16(c)) => AnyBricks::U16(bricks(c, dims, cubic)),
            Coefficients::Samples(Samples::F32(c)) => AnyBricks::F32(bricks(c, dims, cubic)),
            Coefficients::F32(c) => AnyBricks::F32(bricks(c, dims, cubic)),
            Coefficients::F64(_) => unreachable!("the coefficients of Stage::Stored are f32"),
        };
        let mut smooth = Self {
            space: Space::new(grid.domain(), grid.dims, kind.basis().centred),
            bricks,
            range: (0.0, 0.0),
            single: if cubic {
                Table::new::<Cubic>()
            } else {
                Table::new::<Quadratic>()
            },
            double: if cubic {
                Table::new::<Cubic>()
            } else {
                Table::new::<Quadratic>()
            },
            spline,
        };
        smooth.range = typed!(smooth.bricks, b => b.whole());
        Ok(smooth)
    }

    pub(crate) fn kind(&self) -> Kind {
        self.spline.kind()
    }

    /// What the isovalues need; no part of the volume is read again.
    pub(crate) fn prepare(&self, isovalues: &[f64]) -> Prepared {
        let bounds: Vec<_> = isovalues.iter().map(|&c| Bounds::new(c, MARGIN, self.range)).collect();
        let active = typed!(self.bricks, b => Active::new(b, &bounds));
        Prepared { bounds, active }
    }

    /// The function drawn: the spline itself, or its form with coefficients that are not rounded.
    pub(crate) fn function(&self, stage: Stage) -> Option<Arc<dyn Function>> {
        match stage {
            Stage::Ideal if self.kind().interpolates() => {
                Some(Arc::new(GridSpline::new(self.spline.grid(), self.kind(), stage).ok()?))
            }
            _ => Some(Arc::new(self.spline.clone())),
        }
    }

    /// Bytes of coefficients beyond the shared samples, and of the index.
    pub(crate) fn bytes(&self) -> (usize, usize) {
        (self.spline.own_bytes(), typed!(self.bricks, b => b.bytes()))
    }

    /// What all tiles look at.
    fn search<'a>(&'a self, prepared: &'a Prepared, level: Level, claims: bool) -> Search<'a> {
        let values = match self.spline.coefficients() {
            Coefficients::Samples(c) => Values::of(c),
            Coefficients::F32(c) => Values::F32(c),
            Coefficients::F64(_) => unreachable!("the coefficients of Stage::Stored are f32"),
        };
        Search {
            lattice: Lattice {
                values,
                dims: self.spline.grid().dims,
                border: self.spline.border(),
            },
            space: &self.space,
            active: &prepared.active,
            bounds: &prepared.bounds,
            single: &self.single,
            double: &self.double,
            claims,
            // Vectors are those of this level: it has to be one the machine has.
            level: Level::best(level),
        }
    }

    /// Draws a tile.
    pub(crate) fn draw(&self, prepared: &Prepared, job: Job<'_, '_>) -> Work {
        let search = self.search(prepared, job.level, job.claims);
        if self.kind().basis().degree == 3 {
            draw::<Cubic>(&search, job)
        } else {
            draw::<Quadratic>(&search, job)
        }
    }

    /// Draws a tile with its stages clocked.
    pub(crate) fn draw_clocked(&self, prepared: &Prepared, job: Job<'_, '_>, laps: &mut Laps) {
        let search = self.search(prepared, job.level, job.claims);
        if self.kind().basis().degree == 3 {
            draw_clocked::<Cubic>(&search, job, laps);
        } else {
            draw_clocked::<Quadratic>(&search, job, laps);
        }
    }
}

/// Draws a tile with the vectors of the level, inside functions compiled for it: the rule of [`vector::Register`].
fn draw<S: Spline>(search: &Search<'_>, mut job: Job<'_, '_>) -> Work {
    let mut work = Work::default();
    let rays = packet::draw::<S>(search, &mut job, &mut work);
    if rays.is_some_and(|r| r.iter().all(|&b| b == 0)) {
        return work;
    }
    let alone = alone::<S>(search, job, rays);
    Work {
        nodes: work.nodes + alone.nodes,
        bricks: work.bricks + alone.bricks,
        cells: work.cells + alone.cells,
        filtered: work.filtered + alone.filtered,
        composed: work.composed + alone.composed,
        ..alone
    }
}

/// As [`draw`], with clocks.
fn draw_clocked<S: Spline>(search: &Search<'_>, job: Job<'_, '_>, laps: &mut Laps) {
    let clock = Instant::now();
    let together = packet::Tile::<S>::new(search, &job);
    laps.setup += clock.elapsed();
    let rays = together.map(|(tile, view)| stages::clocked(search.level, &tile, &view, job.out, laps));
    let clock = Instant::now();
    if rays.is_none_or(|r| r.iter().any(|&b| b != 0)) {
        alone::<S>(search, job, rays);
    }
    laps.alone += clock.elapsed();
}

/// Draws a tile, or only the given rays of it, ray by ray.
fn alone<S: Spline>(search: &Search<'_>, job: Job<'_, '_>, rays: Option<RaySet>) -> Work {
    macro_rules! run {
        ($isa:ty) => {
            <$isa as vector::Isa>::run(DrawTile::<S, $isa> {
                search,
                view: job.view,
                surfaces: job.surfaces,
                tile: job.tile,
                out: job.out,
                rays,
                kind: PhantomData,
            })
        };
    }
    match search.level {
        Level::Scalar => run!(vector::Portable),
        #[cfg(target_arch = "x86_64")]
        Level::Avx2 => run!(vector::Avx2),
        #[cfg(target_arch = "x86_64")]
        Level::Avx512 => run!(vector::Avx512),
        #[cfg(not(target_arch = "x86_64"))]
        _ => run!(vector::Portable),
    }
}
