//! The trilinear caster: the rays of one tile, their hits, and what is claimed about them.

use crate::cell::{Root, Scratch, composed, gradient};
use crate::exact::{Exact, PLACE, Volume, common_sign};
use crate::packet::{self, applies};
use crate::packet_cells::LinearTile;
use crate::walk::{Entry, Search, Space, Walk, Work, three};
use glam::DVec3;
use isobar_core::{Claim, Hit, Ray, View};
use isobar_cpu::index::vague;
use isobar_cpu::packet::{Projection, RaySet, holds};
use isobar_cpu::scene::Isovalues;
use isobar_cpu::{Kernel, Level, PixelSink, Tile, TileOut};

/// Bricks and cells are taken to meet an isovalue within this much of the greatest |sample - isovalue|; rays whose own bound is larger
/// (eyes more than some 10^8 voxels away) prove nothing in f64.
pub(crate) const MARGIN: f64 = 1e-6;

/// Draws one tile; gives the work done.
pub(crate) struct DrawTile<'a, 'b> {
    pub(crate) search: Search<'a>,
    pub(crate) space: &'a Space,
    pub(crate) view: &'a View,
    pub(crate) surfaces: &'a Isovalues,
    pub(crate) tile: Tile,
    pub(crate) out: &'a mut TileOut<'b>,
}

/// Draws one tile with at most the instructions of `level`; gives the work done.
pub(crate) fn draw(level: Level, tile: DrawTile<'_, '_>) -> Work {
    let mut work = Work::default();
    let mut rays = None;
    if applies(tile.tile, tile.surfaces)
        && let Some(projection) = Projection::new(tile.view, &tile.space.domain)
    {
        let done = packet::draw(level, &tile.together(), &projection, &mut *tile.out);
        work = Work {
            nodes: done.crossed.nodes,
            bricks: done.crossed.bricks,
            cells: done.cells,
            cubics: done.cells * tile.surfaces.values().len() as u64,
            ..Work::default()
        };
        if done.left.iter().all(|&b| b == 0) {
            return work;
        }
        rays = Some(done.left);
    }
    let alone = level.run(SingleRays { tile, rays });
    Work {
        nodes: work.nodes + alone.nodes,
        bricks: work.bricks + alone.bricks,
        cells: work.cells + alone.cells,
        cubics: work.cubics + alone.cubics,
        ..alone
    }
}

impl<'a> DrawTile<'a, '_> {
    /// As packets have it.
    pub(crate) fn together(&self) -> LinearTile<'a> {
        LinearTile {
            search: self.search,
            place: packet::place(self.space, self.view, self.tile, 0.0, 1.0),
            surfaces: self.surfaces,
        }
    }
}

impl Volume for Search<'_> {
    fn degree(&self) -> usize {
        1
    }

    fn cells(&self) -> [i32; 3] {
        three(|a| self.dims[a] as i32 - 1)
    }

    fn shift(&self) -> f64 {
        0.0
    }

    fn stencil(&self, cell: [i32; 3]) -> [f64; 64] {
        let mut out = [0.0; 64];
        out[..8].copy_from_slice(&self.corners(cell));
        out
    }

    fn gradient(&self, cell: [i32; 3], at: [f64; 3], _: f64) -> DVec3 {
        gradient(&self.corners(cell), at)
    }

    /// Positions move a coefficient by at most 3 * 2 [`PLACE`] uM and its composition loses 16uM (`walk.rs`), M the greatest |sample - c| of the cell.
    fn sign(&self, cell: [i32; 3], isovalue: f64, [a, b]: [[f64; 3]; 2]) -> i32 {
        let v = self.corners(cell);
        let most = v.iter().fold(0.0f64, |m, v| m.max((v - isovalue).abs()));
        let error = (6.0 * PLACE + 32.0) * 0.5 * f64::EPSILON * most + f64::MIN_POSITIVE;
        common_sign(&composed(&v, isovalue, a, b), error)
    }
}

/// Draws a tile ray by ray.
pub(crate) struct SingleRays<'a, 'b> {
    pub(crate) tile: DrawTile<'a, 'b>,
    /// Only these.
    pub(crate) rays: Option<RaySet>,
}

impl Kernel for SingleRays<'_, '_> {
    type Output = Work;

    #[inline(always)]
    fn run(self) -> Work {
        let DrawTile {
            mut search,
            space,
            view,
            surfaces,
            tile,
            out,
        } = self.tile;
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
        let exact = Exact {
            space,
            clips: &view.clips,
            bounds: search.bounds,
            surfaces,
        };
        let mut left = Exact::allowed(search.claims, view, out);
        let asked = left > 0;
        for (x, y) in tile.pixels() {
            if self.rays.is_some_and(|set| !holds(&set, x - tile.x, y - tile.y)) {
                continue;
            }
            let ray = rays.ray(x, y);
            search.margin = space.margin(ray.origin);
            let before = work.cells;
            work.alone += 1;
            let mut sink = PixelSink::new(out, x, y, &ray, surfaces.all());
            let mut claim = Claim::empty();
            let mut certain = search.margin <= MARGIN;
            let (least, mut worst) = (vague(&space.domain, ray.direction.length()), 0.0f64);
            match Walk::enter(&ray, space, &view.clips, Some(search.margin)) {
                Entry::Through(walk) => {
                    certain &= search.margin + walk.ends <= MARGIN;
                    if certain {
                        search.margin += walk.ends;
                    }
                    let sure = certain && search.claims;
                    certain &= search.roots(walk, &mut scratch, &mut work, |root| {
                        if sink.hits() == 0 && sure && root.error.is_finite() {
                            claim = if root.first {
                                Claim::EXISTS | Claim::FIRST
                            } else {
                                Claim::EXISTS
                            };
                        }
                        worst = worst.max(root.error);
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
            let (hits, cells) = (sink.hits(), (work.cells - before) as u32);
            sink.finish(claim, cells);
            if asked && !(certain && worst <= least && Exact::is_decided(claim)) {
                work.exact[0] += u64::from(left > 0);
                let anew = (left > 0).then(|| exact.draw(&search, out, ([x, y], &ray), (hits, cells), &mut left));
                work.exact[1] += u64::from(!Exact::is_decided(anew.flatten().unwrap_or(claim)));
            }
        }
        work
    }
}

/// A root as a hit; `exists`: whether it is proved.
#[inline(always)]
pub(crate) fn hit(ray: &Ray, root: &Root, surfaces: &Isovalues, space: &Space, exists: bool) -> Hit {
    let g = space.world_gradient(root.gradient);
    Hit {
        t: root.t,
        point: ray.at(root.t),
        normal: g.normalize_or(DVec3::ZERO).as_vec3().to_array(),
        surface: surfaces.surface(root.surface),
        t_error: if exists { root.error } else { f64::INFINITY },
    }
}
