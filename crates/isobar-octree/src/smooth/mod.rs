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
mod planes;
mod roots;
#[cfg(test)]
mod tests;
mod vector;

use crate::bricks::{SIDE, Values, bit, room};
use crate::stages::{self, Laps};
use crate::trilinear::MARGIN;
use crate::walk::Bounds;
use basis::{Cubic, Quadratic, Spline, Table};
use bricks::{Active, ranges};
pub(crate) use caster::Work;
use caster::{DrawTile, Search};
use isobar_core::{DataError, Function, Grid, Samples, Stage, View};
use isobar_cpu::nodes::Ranges;
use isobar_cpu::packet::RaySet;
use isobar_cpu::scene::Isovalues;
use isobar_cpu::{Level, Tile, TileOut};
use isobar_fields::{Coefficients, GridSpline, Kind};
use lattice::{Coefficient, Lattice, Space};
use planes::{Plane, planes};
use std::marker::PhantomData;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// Bricks of any coefficient type.
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

/// A volume as a quadratic or cubic B-spline.
#[derive(Debug)]
pub(crate) struct Smooth {
    spline: GridSpline,
    space: Space,
    bricks: AnyBricks,
    /// One for each brick, or none at all.
    planes: Vec<Plane>,
    range: (f64, f64),
    single: Table<f32>,
    double: Table<f64>,
}

/// What depends on the isovalues.
#[derive(Debug)]
pub(crate) struct Prepared {
    bounds: Vec<Bounds>,
    active: Active,
    /// Whether planes have told the cells of bricks since the last frame began.
    rough: AtomicBool,
    /// Whether this frame looks for cells that planes have left too many.
    refine: bool,
}

impl Prepared {
    /// A frame begins: it takes back cells that planes have left too many, if the frame before has entered new bricks.
    pub(crate) fn begin(&mut self) {
        self.refine = std::mem::replace(self.rough.get_mut(), false);
    }

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
        let [nx, ny, nz] = self.active.dims().map(|n| 4 * n);
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
        fn bricks<T: Coefficient>(c: &[T], dims: [usize; 3], cubic: bool) -> Ranges<T> {
            if cubic {
                ranges::<Cubic, T>(c, dims)
            } else {
                ranges::<Quadratic, T>(c, dims)
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
            planes: Vec::new(),
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

    /// With planes, which take as long as bounding all cells once: for volumes that see more than one isovalue.
    pub(crate) fn with_planes(mut self) -> Self {
        self.planes = self.made_planes();
        self
    }

    /// Planes, where they leave the nodes of 16^3 cells their room. None in degree 2: there a first image gained 10 ms by them, of 155, and later ones, in which
    /// cells are left that planes cannot tell, took 4 % longer.
    fn made_planes(&self) -> Vec<Plane> {
        fn of<T: Coefficient>(smooth: &Smooth, bricks: &Ranges<T>) -> Vec<Plane> {
            let nodes: usize = bricks.dims.iter().map(|n| n.div_ceil(SIDE)).product();
            let room = smooth.room(bricks.bytes());
            if room < bricks.range.len() * size_of::<Plane>() + nodes * bricks::NODE {
                return Vec::new();
            }
            planes::<Cubic, T>(&smooth.lattice(), bricks, Level::detect())
        }
        if self.kind().basis().degree != 3 {
            return Vec::new();
        }
        typed!(self.bricks, b => of(self, b))
    }

    /// Bytes that the index may take beside these; see [`room`].
    fn room(&self, held: usize) -> usize {
        let own = self.spline.own_bytes();
        room(if own == 0 { self.spline.grid().samples.bytes() } else { own }, held)
    }

    /// The coefficients.
    fn lattice(&self) -> Lattice<'_> {
        let values = match self.spline.coefficients() {
            Coefficients::Samples(c) => Values::of(c),
            Coefficients::F32(c) => Values::F32(c),
            Coefficients::F64(_) => unreachable!("the coefficients of Stage::Stored are f32"),
        };
        Lattice {
            values,
            dims: self.spline.grid().dims,
            border: self.spline.border(),
        }
    }

    pub(crate) fn kind(&self) -> Kind {
        self.spline.kind()
    }

    /// What the isovalues need, in the memory of `old`; no part of the volume is read again.
    pub(crate) fn prepare(&self, isovalues: &[f64], old: Option<Prepared>) -> Prepared {
        let bounds: Vec<_> = isovalues.iter().map(|&c| Bounds::new(c, MARGIN, self.range)).collect();
        let room = self.room(self.bytes().1);
        let active = typed!(self.bricks, b => Active::new(b, &bounds, room, old.map(|p| p.active)));
        Prepared {
            bounds,
            active,
            rough: AtomicBool::new(!self.planes.is_empty()),
            refine: false,
        }
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
        let planes = size_of_val(self.planes.as_slice());
        (self.spline.own_bytes(), typed!(self.bricks, b => b.bytes()) + planes)
    }

    /// What all tiles look at.
    fn search<'a>(&'a self, prepared: &'a Prepared, level: Level, claims: bool) -> Search<'a> {
        Search {
            lattice: self.lattice(),
            bricks: &self.bricks,
            planes: &self.planes,
            rough: &prepared.rough,
            refine: prepared.refine,
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

impl Search<'_> {
    /// The cells of a brick that a surface may meet; by its plane some more.
    #[cold]
    #[inline(never)]
    fn active_cells<S: Spline>(&self, brick: [i32; 3]) -> u64 {
        let cells = self.space.cells;
        let plane = typed!(*self.bricks, b => {
            let at = lattice::flat(b.dims, brick.map(|b| b as usize));
            self.planes.get(at).and_then(|p| p.cells(self.level, b.range[at].map(Into::into), self.bounds))
        });
        if let Some(mask) = plane {
            self.rough.store(true, Ordering::Relaxed);
            return mask & bricks::inside(cells, brick);
        }
        self.bounded_cells::<S>(brick)
    }

    /// The same by the coefficients of its cells, whatever its plane.
    fn bounded_cells<S: Spline>(&self, brick: [i32; 3]) -> u64 {
        macro_rules! by {
            ($isa:ty) => {
                bricks::active_cells::<S, $isa>(&self.lattice, self.space.cells, brick, self.bounds)
            };
        }
        match self.level {
            #[cfg(target_arch = "x86_64")]
            Level::Avx512 => by!(vector::Avx512),
            #[cfg(target_arch = "x86_64")]
            Level::Avx2 => by!(vector::Avx2),
            _ => by!(vector::Portable),
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
