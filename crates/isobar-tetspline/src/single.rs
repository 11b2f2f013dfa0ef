//! A tile: in packets where they can draw it, and ray by ray.

use crate::bricks::Datum;
use crate::caps::Caps;
use crate::cpu::MARGIN;
use crate::packet::{Job, Projection, RaySet, holds};
use crate::paint::{Colours, Paint};
use crate::ray::{Space, Walk};
use crate::walk::{Root, Scratch, Search, Work};
use glam::DVec3;
use isobar_core::{Claim, Hit, Pixel, Ray};
use isobar_cpu::index::Entry;
use isobar_cpu::scene::Isovalues;
use isobar_cpu::{Kernel, Level, PixelSink};

/// What packets do not do.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Extra<'a> {
    pub(crate) paint: Paint,
    pub(crate) caps: Option<Caps<'a>>,
}

/// Draws one tile with at most the instructions of `level`; gives the work done.
pub(crate) fn draw<T: Datum>(
    level: Level,
    projection: Option<&Projection>,
    search: Search<'_, T>,
    mut job: Job<'_, '_>,
    extra: Extra<'_>,
) -> Work {
    let mut work = Work::default();
    let mut rays = None;
    if let Some(projection) = projection
        && job.suits_packets()
    {
        let left = job.draw(level, projection, MARGIN, &mut work);
        if left.iter().all(|&b| b == 0) {
            return work;
        }
        rays = Some(left);
    }
    level.run(SingleRays {
        search,
        job,
        rays,
        work,
        extra,
    })
}

/// A tile ray by ray, as a kernel.
struct SingleRays<'a, 'b, T> {
    search: Search<'a, T>,
    job: Job<'a, 'b>,
    /// Only these.
    rays: Option<RaySet>,
    /// What was done before.
    work: Work,
    extra: Extra<'a>,
}

impl<T: Datum> Kernel for SingleRays<'_, '_, T> {
    type Output = Work;

    #[inline(always)]
    fn run(self) -> Work {
        let mut search = self.search;
        let Job {
            space,
            view,
            surfaces,
            claims,
            tile,
            out,
            ..
        } = self.job;
        let rays = view.generator();
        let mut scratch = Scratch::new(surfaces.values().len());
        let mut work = self.work;
        for (x, y) in tile.pixels() {
            if self.rays.is_some_and(|set| !holds(&set, x - tile.x, y - tile.y)) {
                continue;
            }
            work.alone += 1;
            let ray = rays.ray(x, y);
            let mut sink = PixelSink::new(out, x, y, &ray, surfaces.all());
            let mut claim = Claim::empty();
            if surfaces.values().is_empty() {
                sink.finish(if claims { Claim::EMPTY } else { claim }, 0);
                continue;
            }
            search.margin = space.margin(ray.origin);
            let before = work.active;
            let entry = Walk::enter(&ray, space, &view.clips, search.margin);
            let mut sure = claims && search.margin <= MARGIN;
            if let Entry::Through(walk) = &entry {
                sure &= search.margin + walk.line.ends <= MARGIN;
                if sure {
                    search.margin += walk.line.ends;
                }
            }
            // Whether a cut is closed where a ray meets it is looked at, not proved.
            let mut certain = sure && self.extra.caps.is_none();
            let complete = certain;
            let mut colours = Colours::new(self.extra.paint, view, space, surfaces);
            match entry {
                Entry::Through(walk) => {
                    let [first, last] = self.extra.caps.map_or([None; 2], |c| c.ends(&ray));
                    if let Some(hit) = first {
                        colours.add(&hit, &ray);
                        sink.push(&hit);
                    }
                    certain &= !sink.wants_more()
                        || search.roots(walk, &mut scratch, &mut work, |root| {
                            if sink.hits() == 0 && sure && root.found.error.is_finite() {
                                claim = if root.found.first && complete {
                                    Claim::EXISTS | Claim::FIRST
                                } else {
                                    Claim::EXISTS
                                };
                            }
                            let hit = hit(&ray, root, surfaces, space, !claim.is_empty());
                            colours.add(&hit, &ray);
                            sink.push(&hit)
                        });
                    if sink.wants_more()
                        && let Some(hit) = last
                    {
                        colours.add(&hit, &ray);
                        sink.push(&hit);
                    }
                }
                Entry::Misses { certain: missed } => certain &= missed,
            }
            if sink.hits() == 0 && certain {
                claim = Claim::EMPTY;
            }
            let (hits, cubes) = (sink.hits(), (work.active - before) as u32);
            sink.finish(claim, cubes);
            if let Some(rgba) = colours.rgba() {
                out.set_pixel(
                    x,
                    y,
                    &Pixel {
                        hits,
                        claim,
                        rgba,
                        work: cubes,
                    },
                );
            }
        }
        work
    }
}

#[inline(always)]
fn hit(ray: &Ray, root: &Root, surfaces: &Isovalues, space: &Space, exists: bool) -> Hit {
    let g = space.world_gradient(root.gradient);
    Hit {
        t: root.found.t,
        point: ray.at(root.found.t),
        normal: g.normalize_or(DVec3::ZERO).as_vec3().to_array(),
        surface: surfaces.surface(root.surface),
        t_error: if exists { root.found.error } else { f64::INFINITY },
    }
}
