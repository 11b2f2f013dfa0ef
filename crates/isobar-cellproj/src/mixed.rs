//! A medium in a mesh, with isosurfaces in it: preparation, visibility order and blocks of a frame.

use crate::blocks::{AREA, Block, CellBins, SIDE};
use crate::camera::Projection;
use crate::cells::{BESIDE, BESIDE_F32, Screen};
use crate::exterior;
use crate::faces::Look;
use crate::lanes::{self, LANES};
use crate::measure::Lengths;
use crate::medium::{Medium, Model};
use crate::mesh::Cells;
use crate::order::Order;
use crate::resolve::{Resolver, Root};
use crate::setup::Units;
use crate::stays;
use crate::surfaces::{DrawTile, Gathered, Prepared, Work};
use crate::tables::{Integrator, Table, Table2, Table3};
use crate::topology::Topology;
use crate::volume::{self, Crossing, Crossings, Scene, VolumeWork, groups};
use glam::Vec4;
use isobar_core::{Ray, RenderError, Stop, TransferFunction, View, shade};
use isobar_cpu::scene::Isovalues;
use isobar_cpu::{Level, Tile};
use rayon::prelude::*;
use std::time::{Duration, Instant};

/// How fragments are integrated.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Integration {
    /// The 3D table.
    Table3,
    /// The 2D table.
    Table2,
    /// Each fragment by itself.
    Exact,
}

/// How cells are ordered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Sort {
    /// The visibility order.
    Visibility,
    /// By centroids.
    Centroids,
}

/// Settings of the medium.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Settings {
    pub(crate) model: Model,
    pub(crate) integration: Integration,
    /// Nodes along each axis of the 3D table; the 2D table has four times as many.
    pub(crate) nodes: usize,
    pub(crate) sort: Sort,
}

/// Where fragments are looked up.
#[derive(Debug)]
pub(crate) enum Lookup {
    Table3(Table3),
    Table2(Table2),
    Exact(Medium),
}

/// What depends on the mesh alone.
#[derive(Debug)]
pub(crate) struct Volume {
    pub(crate) topology: Topology,
    lengths: Lengths,
    range: (f64, f64),
}

impl Volume {
    pub(crate) fn new(mesh: &Cells) -> Result<Self, RenderError> {
        let (lo, hi) = mesh.range();
        Ok(Self {
            topology: Topology::new(mesh)?,
            lengths: Lengths::new(mesh),
            range: (f64::from(lo), f64::from(hi)),
        })
    }
}

/// What depends on mesh and transfer function.
#[derive(Debug)]
pub(crate) struct Filled {
    pub(crate) lookup: Lookup,
    /// Whether each cell changes the rays through it.
    pub(crate) visible: Vec<bool>,
}

impl Filled {
    pub(crate) fn new(mesh: &Cells, volume: &Volume, transfer: &TransferFunction, settings: Settings) -> Self {
        let medium = Medium::new(transfer, settings.model);
        let visible = mesh
            .cells
            .par_iter()
            .with_min_len(4096)
            .map(|c| {
                let v = c.map(|i| mesh.mesh.values[i as usize]);
                let (lo, hi) = (v[0].min(v[1]).min(v[2].min(v[3])), v[0].max(v[1]).max(v[2].max(v[3])));
                !medium.is_clear(f64::from(lo), f64::from(hi))
            })
            .collect();
        let (range, lengths) = (volume.range, volume.lengths);
        let lookup = match settings.integration {
            Integration::Table3 => Lookup::Table3(Table3::new(&medium, range, lengths.longest, settings.nodes)),
            Integration::Table2 => Lookup::Table2(Table2::new(&medium, range, lengths.average, 4 * settings.nodes)),
            Integration::Exact => Lookup::Exact(medium),
        };
        Self { lookup, visible }
    }

    pub(crate) fn bytes(&self) -> usize {
        self.visible.len()
            + match &self.lookup {
                Lookup::Table3(t) => t.bytes(),
                Lookup::Table2(t) => t.bytes(),
                Lookup::Exact(_) => 0,
            }
    }
}

/// The frame of a medium, block by block.
#[derive(Debug)]
pub(crate) struct Image {
    columns: usize,
    blocks: Vec<BlockImage>,
    pub(crate) work: Work,
    pub(crate) volume: VolumeWork,
    pub(crate) counts: Counts,
    /// Bytes of what the frame needed besides.
    pub(crate) bytes: usize,
}

/// What a frame's order was like.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Counts {
    /// Relations across gaps.
    pub(crate) pairs: usize,
    /// Parts of the order with cycles, and their cells.
    pub(crate) cycles: usize,
    pub(crate) cells_in_cycles: usize,
    /// Entries of blocks.
    pub(crate) entries: usize,
    /// What the order took, relations across gaps included.
    pub(crate) sorting: Duration,
}

#[derive(Debug)]
struct BlockImage {
    hits: Gathered,
    colour: Vec<[f32; 4]>,
}

impl Image {
    /// Hits, patches and colour of pixel (x, y).
    pub(crate) fn pixel(&self, x: usize, y: usize) -> (&[Root], u32, [f32; 4]) {
        let block = &self.blocks[y / SIDE * self.columns + x / SIDE];
        let (roots, covered) = block.hits.pixel(x, y);
        (roots, covered, block.colour[y % SIDE * SIDE + x % SIDE])
    }
}

/// A frame of a medium.
pub(crate) struct Draw<'a> {
    pub(crate) mesh: &'a Cells,
    pub(crate) volume: &'a Volume,
    pub(crate) filled: &'a Filled,
    pub(crate) surfaces: &'a Isovalues,
    /// Patches of the surfaces.
    pub(crate) prepared: &'a Prepared,
    pub(crate) view: &'a View,
    pub(crate) nearest_only: bool,
    pub(crate) sort: Sort,
    pub(crate) look: Look<'a>,
    pub(crate) level: Level,
    pub(crate) stop: &'a Stop,
}

/// The points of a view on the screen and its cells front to back, for lanes of f32 or in f64; to be called on the pool.
///
/// # Errors
/// [`RenderError::Memory`], as [`CellBins::new`].
pub(crate) fn arrange(
    mesh: &Cells,
    volume: &Volume,
    projection: Projection,
    (sort, single): (Sort, bool),
) -> Result<(Screen, Order, Counts), RenderError> {
    let screen = Screen::new(mesh, projection, if single { BESIDE_F32 } else { BESIDE });
    let mut counts = Counts::default();
    let start = Instant::now();
    let order = match sort {
        Sort::Centroids => Order::centroids(mesh, &projection),
        Sort::Visibility => {
            let topology = &volume.topology;
            let pairs = if topology.convex {
                Vec::new()
            } else {
                exterior::pairs(mesh, topology, &screen)?
            };
            counts.pairs = pairs.len();
            Order::visibility(mesh, topology, &projection, &pairs)
        }
    };
    counts.sorting = start.elapsed();
    (counts.cycles, counts.cells_in_cycles) = (order.groups.len(), order.in_cycles());
    Ok((screen, order, counts))
}

/// The premultiplied colour of a hit and minus its opacity.
pub(crate) fn hit_colour(surfaces: &Isovalues, look: Look<'_>, mesh: &Cells, ray: &Ray, root: &Root) -> Vec4 {
    let (surface, normal) = look.of(surfaces, mesh, ray, root);
    let alpha = surface.opacity.clamp(0.0, 1.0);
    let [r, g, b] = shade(surface.colour, normal, ray.direction).map(|c| c * alpha);
    Vec4::new(r, g, b, -alpha)
}

impl Draw<'_> {
    /// Draws; to be called on the pool. `None` for lists of rays, which have no blocks.
    ///
    /// # Errors
    /// [`RenderError::Memory`], as [`CellBins::new`].
    pub(crate) fn run(&self) -> Result<Option<Image>, RenderError> {
        let Some(projection) = Projection::new(self.view) else {
            return Ok(None);
        };
        let (screen, order, mut counts) = arrange(self.mesh, self.volume, projection, (self.sort, self.is_single()))?;
        let visible = &self.filled.visible;
        let bins = CellBins::new(self.mesh, &screen, &order.cells, |c| visible[c as usize])?;
        counts.entries = bins.len();
        let image = match &self.filled.lookup {
            Lookup::Table3(t) => self.tabled(&screen, &bins, &order, t),
            Lookup::Table2(t) => self.tabled(&screen, &bins, &order, t),
            Lookup::Exact(m) => self.exactly(&screen, &bins, &order, m),
        };
        Ok(Some(Image {
            counts,
            bytes: screen.bytes() + bins.bytes() + order.bytes() + image.blocks.len() * SIDE * SIDE * 28,
            ..image
        }))
    }

    /// In f64: each stay by itself, planes, and orders that have to be checked.
    fn exactly<I: Integrator>(&self, screen: &Screen, bins: &CellBins, order: &Order, integrator: &I) -> Image {
        let groups = groups(order);
        let scene = Scene {
            mesh: self.mesh,
            screen,
            bins,
            groups: &groups,
            integrator,
        };
        // Runs are short: 512-bit lanes took 15 % more time here.
        let level = Level::best(self.level.min(Level::Avx2));
        self.blocks(screen, |block, crossings| {
            level.run(volume::DrawBlock {
                scene: &scene,
                block,
                crossings,
            })
        })
    }

    /// Whether it is done in lanes of f32.
    fn is_single(&self) -> bool {
        let tabled = !matches!(self.filled.lookup, Lookup::Exact(_));
        tabled && self.sort != Sort::Centroids && self.view.clips.is_empty()
    }

    /// By a table.
    fn tabled<T: Table>(&self, screen: &Screen, bins: &CellBins, order: &Order, table: &T) -> Image {
        if !self.is_single() {
            return self.exactly(screen, bins, order, table);
        }
        let groups = groups(order);
        let scene = Scene {
            mesh: self.mesh,
            screen,
            bins,
            groups: &groups,
            integrator: table,
        };
        let units = Units::new(&screen.projection, self.mesh.bounds, table.axis());
        self.blocks(screen, |block, crossings| {
            let draw = stays::DrawBlock {
                scene: &scene,
                units: &units,
                level: self.level,
                block,
                crossings,
            };
            lanes::run(self.level, draw)
        })
    }

    fn blocks(&self, screen: &Screen, draw: impl Fn(Block, &Crossings) -> (Vec<[f32; 4]>, VolumeWork) + Sync) -> Image {
        let all: Vec<Block> = Block::all(&screen.projection).collect();
        self.stop.begin(all.len() as u64);
        let drawn: Vec<(BlockImage, Work, VolumeWork)> = all
            .par_iter()
            .with_max_len(1)
            .map(|&block| {
                let mut hits = Gathered::new(block.x, block.y, SIDE);
                if self.stop.is_raised() {
                    let colour = vec![[0.0; 4]; SIDE * SIDE];
                    return (BlockImage { hits, colour }, Work::default(), VolumeWork::default());
                }
                let work = self.hits(block, &mut hits);
                let crossings = self.crossings(screen, block, &hits);
                let (colour, volume) = draw(block, &crossings);
                self.stop.step();
                (BlockImage { hits, colour }, work, volume)
            })
            .collect();
        let (mut work, mut volume) = (Work::default(), VolumeWork::default());
        for (_, w, v) in &drawn {
            work.fragments += w.fragments;
            work.resolved += w.resolved;
            volume.cells += v.cells;
            volume.fragments += v.fragments;
            volume.disordered += v.disordered;
            volume.disordered_pixels += v.disordered_pixels;
            volume.sorted += v.sorted;
        }
        Image {
            columns: Block::columns(&screen.projection),
            blocks: drawn.into_iter().map(|d| d.0).collect(),
            work,
            volume,
            counts: Counts::default(),
            bytes: 0,
        }
    }

    fn resolver(&self) -> Resolver<'_> {
        Resolver {
            cells: self.mesh,
            isovalues: self.surfaces.values(),
            clips: &self.view.clips,
        }
    }

    /// The keys between which clipping planes keep the rays of a block.
    fn kept(&self, projection: &Projection, block: Block) -> Vec<[f64; 2]> {
        if self.view.clips.is_empty() {
            return Vec::new();
        }
        let rays = self.view.generator();
        let forward = projection.rows[2];
        let key = |depth: f64| if projection.perspective { 1.0 / depth } else { -depth };
        (0..AREA + LANES)
            .map(|i| {
                let (x, y) = (block.x + i % SIDE, block.y + i / SIDE);
                if i >= AREA || x >= self.view.width || y >= self.view.height {
                    return [f64::NEG_INFINITY, f64::INFINITY];
                }
                let ray = rays.ray(x, y);
                let along = forward.dot(ray.direction);
                rays.kept(&ray).map_or([f64::NEG_INFINITY, f64::INFINITY], |(first, last)| {
                    [key(first * along), key(last * along)]
                })
            })
            .collect()
    }

    /// The surface hits of a block's pixels.
    fn hits(&self, block: Block, out: &mut Gathered) -> Work {
        if self.surfaces.values().is_empty() {
            return Work::default();
        }
        self.level.run(DrawTile {
            prepared: self.prepared,
            resolver: self.resolver(),
            view: self.view,
            nearest_only: self.nearest_only,
            tile: Tile {
                x: block.x,
                y: block.y,
                width: SIDE.min(self.view.width - block.x),
                height: SIDE.min(self.view.height - block.y),
            },
            emit: out,
        })
    }

    /// The same as depths and colours.
    fn crossings(&self, screen: &Screen, block: Block, hits: &Gathered) -> Crossings {
        let mut out = Crossings {
            starts: vec![0; SIDE * SIDE + 1],
            all: Vec::new(),
            kept: self.kept(&screen.projection, block),
        };
        if self.surfaces.values().is_empty() {
            return out;
        }
        let rays = self.view.generator();
        let forward = screen.projection.rows[2];
        for i in 0..SIDE * SIDE {
            out.starts[i] = out.all.len() as u32;
            let (x, y) = (block.x + i % SIDE, block.y + i / SIDE);
            if x >= self.view.width || y >= self.view.height {
                continue;
            }
            let roots = hits.pixel(x, y).0;
            if roots.is_empty() {
                continue;
            }
            let ray = rays.ray(x, y);
            for root in roots {
                out.all.push(Crossing {
                    depth: root.t * forward.dot(ray.direction),
                    colour: hit_colour(self.surfaces, self.look, self.mesh, &ray, root),
                });
            }
        }
        out.starts[SIDE * SIDE] = out.all.len() as u32;
        out
    }
}
