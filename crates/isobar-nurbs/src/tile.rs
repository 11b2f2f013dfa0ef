//! One tile of `nurbs/cpu`: the roots of its pixels as hits and claims.

use crate::candidates::Candidates;
use crate::frustum::Frustum;
use crate::grid::Cells;
use crate::solve::{Found, Solver};
use isobar_core::{Channels, Claim, HexPatches, Hit, Stop, Surface, View};
use isobar_cpu::{Kernel, PixelSink, Tile, TileOut};

/// Where a tile finds what it may see.
#[derive(Debug)]
pub(crate) enum Index {
    /// Elements and the tasks among them.
    Elements(HexPatches, Box<Candidates>),
    /// Cells of a grid.
    Cells(Box<Cells>),
}

/// One tile as a kernel.
pub(crate) struct DrawTile<'a, 'b> {
    pub(crate) index: &'a Index,
    pub(crate) view: &'a View,
    pub(crate) surfaces: &'a [Surface],
    pub(crate) claims: bool,
    /// Per surface whether nothing behind its hits is wanted.
    pub(crate) stops: &'a [bool],
    /// Whether pixels that the centre ray misses are searched as frusta.
    pub(crate) frusta: bool,
    /// Asked before each element.
    pub(crate) stop: &'a Stop,
    pub(crate) tile: Tile,
    pub(crate) out: &'a mut TileOut<'b>,
    pub(crate) solver: &'a mut Solver,
}

impl Kernel for DrawTile<'_, '_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self {
            index,
            view,
            surfaces,
            claims,
            stops,
            frusta,
            stop,
            tile,
            out,
            solver,
        } = self;
        let heat = out.holds(Channels::WORK);
        let mut nodes = Vec::new();
        for (frustum, (x0, y0)) in Frustum::of_tile(view, tile) {
            solver.begin(frustum.rays.len(), heat, stops);
            match index {
                Index::Elements(patches, candidates) => {
                    for (near, i) in candidates.list(&frustum, &mut nodes, solver.ends.is_on()) {
                        if stop.is_raised() || solver.ends.all_behind(&frustum, near) {
                            break;
                        }
                        let task = &candidates.tasks[i as usize];
                        solver.solve(&frustum, &patches.elements[task.element as usize], task);
                    }
                }
                Index::Cells(cells) => cells.solve(&frustum, solver, &mut nodes),
            }
            solver
                .found
                .sort_unstable_by(|a, b| a.pixel.cmp(&b.pixel).then(a.t.total_cmp(&b.t)));
            if matches!(index, Index::Cells(_)) && solver.found.iter().any(|f| f.face) {
                solver.found = once_at_faces(&solver.found, &frustum);
            }
            let mut covered = Vec::new();
            // Of what planes cut away nothing is known of the pixel's square.
            if frusta && frustum.half > 0.0 && view.clips.is_empty() {
                let mut settled = vec![false; frustum.rays.len()];
                solver.found.iter().for_each(|f| settled[usize::from(f.pixel)] = true);
                covered = vec![false; settled.len()];
                let wide = frustum.widened();
                match index {
                    Index::Elements(patches, candidates) => candidates.visit(&wide, &mut nodes, |task| {
                        if stop.is_raised() {
                            return;
                        }
                        let element = &patches.elements[task.element as usize];
                        solver.cover(&wide, element, task, [0.0; 2], &mut settled, &mut covered);
                    }),
                    Index::Cells(cells) => cells.elements(&wide, &mut nodes, |element, task, errors| {
                        solver.cover(&wide, element, task, errors, &mut settled, &mut covered);
                    }),
                }
            }
            let mut rest: &[Found] = &solver.found;
            let mut hits = 0;
            for (i, ray) in frustum.rays.iter().enumerate() {
                let n = rest.iter().take_while(|f| usize::from(f.pixel) == i).count();
                let (own, more) = rest.split_at(n);
                rest = more;
                let (x, y) = (x0 + i % frustum.width, y0 + i / frustum.width);
                let mut sink = PixelSink::new(out, x, y, &ray.ray, surfaces);
                let mut claim = pixel(view, ray.ray, own, solver.undecided[i], claims, &mut sink);
                if covered.get(i) == Some(&true) {
                    claim |= Claim::COVERED;
                }
                hits += u64::from(sink.hits());
                sink.finish(claim, solver.seen.as_ref().map_or(0, |s| s[i]));
            }
            solver.work.hits += hits;
        }
    }
}

/// Roots of a grid's cells, sorted, without those that a kink at a face would show twice: each of two cells may find the one crossing just beyond its own side, and their
/// slopes may put these farther apart than their errors. A continuous function does not cross twice the same way with nothing between, so of two such crossings, of which at
/// least one is at a face, the better known stays, without a claim. Where a crossing the other way may lie between them, or beside one of them within the errors (a touching root at a face is
/// two crossings, one from each cell, in either order), both stay.
fn once_at_faces(found: &[Found], f: &Frustum) -> Vec<Found> {
    let mut out: Vec<Found> = Vec::with_capacity(found.len());
    let way = |x: &Found| x.normal.dot(f.rays[usize::from(x.pixel)].ray.direction);
    for own in found.chunk_by(|a, b| a.pixel == b.pixel) {
        let begin = out.len();
        for next in own {
            let crossing = |x: &Found| x.certain || x.face;
            let between = |last: &Found| {
                let (from, to) = (last.t - last.error, next.t + next.error);
                let back = |o: &&Found| o.surface == next.surface && way(o) * way(next) <= 0.0;
                own.iter().filter(back).any(|o| o.t + o.error >= from && o.t - o.error <= to)
            };
            match out[begin..].iter_mut().rev().find(|o| o.surface == next.surface) {
                Some(last)
                    if (last.face || next.face)
                        && crossing(last)
                        && crossing(next)
                        && way(last) * way(next) > 0.0
                        && !between(last) =>
                {
                    let better = next.certain && !last.certain || next.certain == last.certain && next.error < last.error;
                    if better {
                        *last = *next;
                    }
                    last.certain = false;
                    last.face = true;
                }
                _ => out.push(*next),
            }
        }
    }
    out
}

/// The roots of one pixel, by t, as hits: those of one surface whose enclosures overlap are one. What may be claimed.
#[inline(always)]
pub(crate) fn pixel(
    view: &View,
    ray: isobar_core::Ray,
    found: &[Found],
    undecided: bool,
    claims: bool,
    sink: &mut PixelSink<'_, '_>,
) -> Claim {
    let clipped = !view.clips.is_empty();
    let Some((first, last)) = view.kept(&ray) else {
        return Claim::empty();
    };
    let mut claim = Claim::empty();
    // Whether all roots so far are proved, and none may lie on either side of an end.
    let mut sure = !undecided;
    let mut wanted = true;
    let mut i = 0;
    while i < found.len() && wanted {
        let (mut best, mut j) = (found[i], i + 1);
        let (mut lo, mut hi) = (best.t - best.error, best.t + best.error);
        // Roots are by t, not by the ends of their enclosures; other surfaces may stand between.
        while let Some(next) = found.get(j).filter(|n| n.surface == best.surface && n.t - n.error <= hi) {
            (lo, hi) = (lo.min(next.t - next.error), hi.max(next.t + next.error));
            if !best.certain && next.certain || best.certain == next.certain && next.error < best.error {
                best = *next;
            }
            j += 1;
        }
        i = j;
        best.error = (best.t - lo).max(hi - best.t).max(best.error);
        if !best.t.is_finite() {
            // A root it is, but beyond all numbers.
            sure = false;
            continue;
        }
        if hi < 0.0 {
            continue;
        }
        sure &= best.certain && lo >= 0.0;
        if best.t < first || best.t > last {
            continue;
        }
        let provable = claims && best.certain && (!clipped || lo >= first && hi <= last);
        if sink.hits() == 0 && provable {
            claim = if sure && !clipped {
                Claim::EXISTS | Claim::FIRST
            } else {
                Claim::EXISTS
            };
        }
        wanted = sink.push(&Hit {
            t: best.t,
            point: ray.at(best.t),
            normal: best.normal.as_vec3().to_array(),
            surface: best.surface,
            t_error: if provable { best.error } else { f64::INFINITY },
        });
    }
    if claims && sink.hits() == 0 && sure && !clipped {
        claim = Claim::EMPTY;
    }
    if undecided || sink.hits() > 0 && claim.is_empty() || !sure && claim.is_empty() {
        claim |= Claim::LIMIT;
    }
    claim
}
