//! The trilinear caster: the rays of one tile, their hits, and what is claimed about them.

use crate::bricks::Sample;
use crate::cell::{Root, Scratch, gradient};
use crate::exact::{Exact, Volume};
use crate::packet::{self, applies};
use crate::packet_cells::LinearTile;
use crate::walk::{Entry, Search, Space, Walk, Work, three};
use glam::DVec3;
use isobar_core::{Camera, Claim, Hit, Ray, View};
use isobar_cpu::packet::{Projection, RaySet, holds};
use isobar_cpu::scene::Isovalues;
use isobar_cpu::{Kernel, Level, PixelSink, Tile, TileOut};

/// Bricks and cells are taken to meet an isovalue within this much of the greatest |sample - isovalue|; rays whose own bound is larger
/// (eyes more than some 10^8 voxels away) claim nothing.
pub(crate) const MARGIN: f64 = 1e-6;

/// Draws one tile; gives the work done.
pub(crate) struct DrawTile<'a, 'b, T> {
    pub(crate) search: Search<'a, T>,
    pub(crate) space: &'a Space,
    pub(crate) view: &'a View,
    pub(crate) surfaces: &'a Isovalues,
    pub(crate) tile: Tile,
    pub(crate) out: &'a mut TileOut<'b>,
}

/// Draws one tile with at most the instructions of `level`; gives the work done.
pub(crate) fn draw<T: Sample>(level: Level, tile: DrawTile<'_, '_, T>) -> Work {
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

impl<'a, T: Sample> DrawTile<'a, '_, T> {
    /// As packets have it.
    pub(crate) fn together(&self) -> LinearTile<'a, T> {
        LinearTile {
            search: self.search,
            place: packet::place(self.space, self.view, self.tile, 0.0, 1.0),
            surfaces: self.surfaces,
        }
    }
}

impl<T: Sample> Volume for Search<'_, T> {
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
}

/// Draws a tile ray by ray.
pub(crate) struct SingleRays<'a, 'b, T> {
    pub(crate) tile: DrawTile<'a, 'b, T>,
    /// Only these.
    pub(crate) rays: Option<RaySet>,
}

impl<T: Sample> Kernel for SingleRays<'_, '_, T> {
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
        let allowed = exact.allowed(search.claims, matches!(view.camera, Camera::Rays(_)), out);
        for (x, y) in tile.pixels() {
            if self.rays.is_some_and(|set| !holds(&set, x - tile.x, y - tile.y)) {
                continue;
            }
            let ray = rays.ray(x, y);
            search.margin = space.margin(ray.origin);
            let before = work.cells;
            work.alone += 1;
            let near = search.margin <= MARGIN;
            let mut sink = PixelSink::new(out, x, y, &ray, surfaces.all());
            let mut claim = Claim::empty();
            let mut certain = search.margin <= MARGIN;
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
            if near && !Exact::is_decided(claim) && (work.exact[0] as usize) < allowed {
                work.exact[0] += 1;
                let anew = exact.draw(&search, out, [x, y], &ray, hits, cells);
                work.exact[1] += u64::from(!anew.is_some_and(Exact::is_decided));
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
