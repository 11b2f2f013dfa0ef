//! The bricks of one level, as a lattice that the casters draw.

use crate::bricks::{Active, Values, bit, ranges};

use crate::smooth::{self, Smooth};
use crate::trilinear::{self, DrawTile, MARGIN};
use crate::walk::{Bounds, Search, Space};
use crate::wavelet::blocks::{Blocks, CHUNK, ChunkSet};
use crate::wavelet::{Adaptive, Bank, Mirror, Pyramid};
use glam::DVec3;
use isobar_core::{Camera, ClipPlane, DataError, Domain, Grid, Samples, View};
use isobar_cpu::nodes::Ranges;
use isobar_cpu::packet::Projection;
use isobar_cpu::scene::Isovalues;
use isobar_cpu::{Level, TILE, Tile, TileOut};
use isobar_fields::Kind;
use rayon::prelude::*;

/// Cells of a brick per axis.
const BRICK: usize = CHUNK / 2;

/// The bricks of one level.
#[derive(Debug)]
pub(super) struct Part {
    pub(super) level: usize,
    /// All bricks of the level that are drawn, with the overlap, in those of the whole level.
    pub(super) bricks: ChunkSet,
    /// The brick of the whole level that is the first of the lattice; -1 where the lattice begins before the domain.
    first: [isize; 3],
    grid: Grid,
    caster: Caster,
    /// Where the domain ends inside a brick.
    pub(super) ends: Vec<ClipPlane>,
    /// What depends on the isovalues.
    pub(super) prepared: Option<Prepared>,
}

/// The lattice as the caster of its degree has it.
#[derive(Debug)]
enum Caster {
    Linear { bricks: Ranges<f32>, space: Box<Space> },
    Smooth(Box<Smooth>),
}

/// At most so many boxes tell where a level may have a surface: each is projected once a frame.
const MOST: usize = 1 << 12;

#[derive(Debug)]
pub(super) struct Prepared {
    caster: PreparedCaster,
    /// Bricks that a surface may meet.
    pub(super) bricks: usize,
    /// Boxes of `size` pieces per axis that hold these, in such boxes of the lattice.
    boxes: Vec<[usize; 3]>,
    size: usize,
}

#[derive(Debug)]
enum PreparedCaster {
    Linear { bounds: Vec<Bounds>, active: Active },
    Smooth(smooth::Prepared),
}

/// The reconstruction that the coefficients of a bank are drawn with.
pub(super) fn kind_of(bank: Bank) -> Kind {
    [Kind::Trilinear, Kind::Quadratic, Kind::Cubic][bank.degree() - 1]
}

impl Part {
    /// The bricks of a level cut out of the reconstruction; `None` where there are none.
    pub(super) fn new(adaptive: &Adaptive<f32>, level: usize, bricks: ChunkSet) -> Result<Option<Self>, DataError> {
        let Some((lo, hi)) = corners(&bricks) else { return Ok(None) };
        let pyramid = adaptive.pyramid();
        let dims = pyramid.level_dims(level);
        // A brick more below and two coefficients above, for the stencils of the last pieces.
        let first = lo.map(|b| b as isize - 1);
        let first = if level == 0 { first.map(|b| b.max(0)) } else { first };
        let line = |a: usize| {
            let (from, to) = (first[a] * BRICK as isize, (hi[a] * BRICK + BRICK + 1) as isize);
            let to = if level == 0 { to.min(dims[a] as isize - 1) } else { to };
            (from..=to).map(|i| index(pyramid, level, a, i)).collect::<Vec<_>>()
        };
        let lines = [line(0), line(1), line(2)];
        let samples = cut_out(adaptive.values(level), &lines);
        let place = Place::new(pyramid, level);
        let corner = DVec3::from_array(first.map(|b| (b * BRICK as isize) as f64));
        let p = pyramid.placement;
        let grid = Grid::new(
            [0, 1, 2].map(|a| lines[a].len()),
            p.spacing * place.step,
            pyramid.domain().world(corner * place.step + place.shift),
            p.direction,
            Samples::F32(samples.into()),
        )?;
        let kind = kind_of(pyramid.bank());
        let caster = match (&grid.samples, kind) {
            (Samples::F32(samples), Kind::Trilinear) => {
                grid.require_finite()?;
                Caster::Linear {
                    bricks: ranges(samples, grid.dims),
                    space: Box::new(Space::new(grid.domain())),
                }
            }
            _ => Caster::Smooth(Box::new(Smooth::new(&grid, kind)?)),
        };
        let ends = if level == 0 { Vec::new() } else { place.ends(pyramid, lo, hi) };
        Ok(Some(Self {
            level,
            bricks,
            first,
            grid,
            caster,
            ends,
            prepared: None,
        }))
    }

    pub(super) fn prepare(&mut self, isovalues: &[f64]) {
        let keep = |brick: [usize; 3]| {
            let at = [0, 1, 2].map(|a| brick[a] as isize + self.first[a]);
            let inside = (0..3).all(|a| at[a] >= 0 && at[a] < self.bricks.chunks()[a] as isize);
            inside && self.bricks.contains(at.map(|v| v as usize))
        };
        let (caster, left) = match &self.caster {
            Caster::Linear { bricks, .. } => {
                let bounds: Vec<_> = isovalues.iter().map(|&c| Bounds::new(c, MARGIN, bricks.whole())).collect();
                let mut active = Active::new(bricks, &bounds, usize::MAX, None);
                let left = retain(&mut active, keep);
                (PreparedCaster::Linear { bounds, active }, left)
            }
            Caster::Smooth(s) => {
                let prepared = s.prepare(isovalues, None);
                let left = prepared.retain(keep);
                (PreparedCaster::Smooth(prepared), left)
            }
        };
        let mut size = CHUNK;
        let boxes = loop {
            let mut set = ChunkSet::new(self.grid.dims.map(|n| n.div_ceil(size)), false);
            left.iter().for_each(|b| set.set(b.map(|b| b * BRICK / size), true));
            if set.count() <= MOST {
                break set.iter().collect();
            }
            size *= 2;
        };
        self.prepared = Some(Prepared {
            caster,
            bricks: left.len(),
            boxes,
            size,
        });
    }

    /// For every tile of the image a lower bound of t where this level may have a surface; `None`: any tile may.
    pub(super) fn nearest(&self, prepared: &Prepared, view: &View) -> Option<Nearest> {
        if view.height < TILE {
            return None;
        }
        let domain = self.grid.domain();
        let projection = Projection::new(view, &domain)?;
        let shift = if kind_of_grid(&self.caster).basis().centred {
            0.5
        } else {
            0.0
        };
        let half = prepared.size as f64 / 2.0;
        let sum = domain.axes.x_axis.length() + domain.axes.y_axis.length() + domain.axes.z_axis.length();
        let radius = half * sum * (1.0 + 1e-9);
        let mut out = Nearest {
            columns: view.width.div_ceil(TILE),
            rows: view.height.div_ceil(TILE),
            t: Vec::new(),
        };
        out.t.resize(out.columns * out.rows, f64::INFINITY);
        for at in &prepared.boxes {
            let centre = at.map(|c| (c * prepared.size) as f64 + half - shift);
            let (columns, rows) = match projection.seen(centre, half) {
                Some((s, _)) => (tiles(s.x, s.half[0], out.columns), tiles(s.y, s.half[1], out.rows)),
                None => (0..out.columns, 0..out.rows),
            };
            let t = match &view.camera {
                Camera::Perspective { eye, .. } => (eye.distance(domain.world(DVec3::from_array(centre))) - radius).max(0.0),
                _ => 0.0,
            };
            for y in rows {
                for at in &mut out.t[y * out.columns..][columns.clone()] {
                    *at = at.min(t);
                }
            }
        }
        Some(out)
    }

    /// Draws a tile; gives the active cells looked into, once a ray.
    pub(super) fn draw(
        &self,
        prepared: &Prepared,
        simd: Level,
        (view, surfaces): (&View, &Isovalues),
        tile: Tile,
        out: &mut TileOut<'_>,
    ) -> u64 {
        match (&self.caster, &prepared.caster, &self.grid.samples) {
            (Caster::Linear { space, .. }, PreparedCaster::Linear { bounds, active }, Samples::F32(samples)) => {
                let search = Search {
                    samples: Values::F32(samples),
                    dims: self.grid.dims,
                    active,
                    bounds,
                    margin: MARGIN,
                    claims: false,
                };
                let tile = DrawTile {
                    search,
                    space,
                    view,
                    surfaces,
                    tile,
                    out,
                };
                trilinear::draw(simd, tile).cells
            }
            (Caster::Smooth(smooth), PreparedCaster::Smooth(prepared), _) => {
                let job = smooth::Job {
                    view,
                    surfaces,
                    tile,
                    out,
                    level: simd,
                    claims: false,
                };
                smooth.draw(prepared, job).cells
            }
            _ => unreachable!("what is prepared is made from the caster beside it, whose samples are f32"),
        }
    }

    pub(super) fn bytes(&self) -> usize {
        let index = match &self.caster {
            Caster::Linear { bricks, .. } => bricks.bytes(),
            Caster::Smooth(s) => s.bytes().1,
        };
        let prepared = self.prepared.as_ref().map_or(0, |p| match &p.caster {
            PreparedCaster::Linear { active, .. } => active.bytes(),
            PreparedCaster::Smooth(p) => p.bytes(),
        });
        self.grid.samples.len() * 4 + index + prepared
    }
}

/// The reconstruction a caster draws.
fn kind_of_grid(caster: &Caster) -> Kind {
    match caster {
        Caster::Linear { .. } => Kind::Trilinear,
        Caster::Smooth(s) => s.kind(),
    }
}

/// As [`smooth::Prepared::retain`], for degree 1.
fn retain(active: &mut Active, keep: impl Fn([usize; 3]) -> bool) -> Vec<[usize; 3]> {
    let [nx, ny, nz] = active.nodes.dims.map(|n| 4 * n);
    let mut left = Vec::new();
    for brick in (0..nx * ny * nz).map(|i| [i % nx, i / nx % ny, i / (nx * ny)]) {
        let at = brick.map(|b| b as i32);
        let word = active.nodes.word_of(at.map(|b| b >> 2));
        if active.nodes.words[word] >> bit(at) & 1 == 0 {
            continue;
        }
        if keep(brick) {
            left.push(brick);
        } else {
            active.nodes.words[word] &= !(1 << bit(at));
        }
    }
    left
}

/// Lower bounds of t by tile.
#[derive(Debug)]
pub(super) struct Nearest {
    columns: usize,
    rows: usize,
    t: Vec<f64>,
}

impl Nearest {
    pub(super) fn of(&self, tile: Tile) -> f64 {
        self.t[tile.y / TILE * self.columns + tile.x / TILE]
    }
}

/// The tiles of a line of `n` whose pixels lie within `half` of `at`.
fn tiles(at: f64, half: f64, n: usize) -> std::ops::Range<usize> {
    let tile = |x: f64| ((x / TILE as f64).floor().clamp(0.0, n as f64)) as usize;
    if at + half < 0.0 {
        return 0..0;
    }
    tile((at - half).floor())..(tile((at + half).ceil()) + 1).min(n)
}

/// Least and greatest indices of a set.
fn corners(set: &ChunkSet) -> Option<([usize; 3], [usize; 3])> {
    let mut members = set.iter();
    let one = members.next()?;
    Some(members.fold((one, one), |(lo, hi), c| {
        ([0, 1, 2].map(|a| lo[a].min(c[a])), [0, 1, 2].map(|a| hi[a].max(c[a])))
    }))
}

/// The coefficient of a level that stands for coefficient i along axis a: as the transform to the next finer level has it.
fn index(pyramid: &Pyramid, level: usize, a: usize, i: isize) -> usize {
    let n = pyramid.level_dims(level)[a] as isize;
    if (0..n).contains(&i) {
        return i as usize;
    }
    if level == 0 {
        return i.clamp(0, n - 1) as usize;
    }
    let finer = pyramid.level_dims(level - 1)[a];
    let mirror: Mirror = pyramid.bank().mirror();
    // Slots of the low pass are mirrored on such slots, with no change of sign.
    mirror.slot(2 * i, finer).map_or(0, |(slot, _)| slot / 2)
}

/// The values with these indices per axis, x fastest.
fn cut_out(values: &Blocks<f32>, [x, y, z]: &[Vec<usize>; 3]) -> Vec<f32> {
    // Runs of neighbours inside a chunk.
    let mut runs: Vec<(usize, usize)> = Vec::new();
    for (i, &v) in x.iter().enumerate() {
        match runs.last_mut() {
            Some((_, len)) if v % CHUNK != 0 && x[i - 1] + 1 == v => *len += 1,
            _ => runs.push((i, 1)),
        }
    }
    let mut out = vec![0.0f32; x.len() * y.len() * z.len()];
    out.par_chunks_mut(x.len() * y.len()).zip(z).for_each(|(plane, &z)| {
        for (row, &y) in plane.chunks_exact_mut(x.len()).zip(y) {
            for &(at, len) in &runs {
                let from = values.at([x[at], y, z]);
                row[at..at + len].copy_from_slice(&values.data[from..from + len]);
            }
        }
    });
    out
}

/// Where a level's lattice lies in the index space of the finest.
struct Place {
    /// Distance of coefficients.
    step: f64,
    /// Coefficient 0.
    shift: f64,
    /// Where pieces begin, before coefficient 0, in the level's own steps.
    before: f64,
}

impl Place {
    fn new(pyramid: &Pyramid, level: usize) -> Self {
        let step = (1u64 << level) as f64;
        // Quadratic pieces are centred on coefficients, and begin half a fine step before 0 on every level (maths, section B).
        let before = if pyramid.bank().degree() == 2 { 0.5 } else { 0.0 };
        Self {
            step,
            shift: before * step - before,
            before,
        }
    }

    /// The planes that end the domain inside bricks `lo` to `hi`.
    fn ends(&self, pyramid: &Pyramid, lo: [usize; 3], hi: [usize; 3]) -> Vec<ClipPlane> {
        let domain: Domain = pyramid.domain();
        let mut planes = Vec::new();
        for a in 0..3 {
            let normal = domain.world_gradient(DVec3::AXES[a]);
            let at = normal.dot(domain.origin);
            let plane = |side: f64, x: f64| ClipPlane {
                normal: normal * side,
                distance: (at + x) * side,
                cap: false,
            };
            let end = ((hi[a] + 1) * BRICK) as f64 * self.step - self.before;
            if end > domain.hi[a] {
                planes.push(plane(1.0, domain.hi[a]));
            }
            if lo[a] == 0 && self.before > 0.0 {
                planes.push(plane(-1.0, 0.0));
            }
        }
        planes
    }
}
