//! Active cells of one ray: the cubic in each, and one root out of what neighbouring cells know of it.
//!
//! A stretch of the ray that cannot be told from zero (`cubic.rs`) may reach over faces: a root on a face, an edge or a vertex of cells, a tangent
//! point there, a plateau. It is carried from cell to cell until the sign is certain again, and is one root then: between opposite signs a proved
//! one, within the stretch; between equal signs, or at an end of the domain, a touching one that is not proved. A long stretch (s = c on an interval) is
//! hit at its entry, a short one where |s - c| is least.

use crate::bricks::values;
use crate::cubic::{self, Event};
use crate::walk::{Search, Walk, Work, three};
use glam::DVec3;

/// A root along the ray.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Root {
    pub(crate) t: f64,
    /// Index of the isovalue.
    pub(crate) surface: usize,
    /// Gradient of s in index space.
    pub(crate) gradient: DVec3,
    /// A root is proved to lie in [t - error, t + error]; +inf where it is not.
    pub(crate) error: f64,
    /// Nothing lies before it but the roots reported before.
    pub(crate) first: bool,
}

/// A stretch in doubt that has not ended yet.
#[derive(Debug, Clone, Copy)]
struct Doubt {
    from: f64,
    to: f64,
    /// Where s - c is least in size, how small, and the gradient.
    at: f64,
    least: f64,
    gradient: DVec3,
}

/// What is known of s - c at the end of the last cell.
#[derive(Debug, Clone, Copy, Default)]
struct Track {
    value: f64,
    /// The last certain sign.
    positive: Option<bool>,
    doubt: Option<Doubt>,
}

/// What is kept along a ray.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    /// Per isovalue.
    tracks: Vec<Track>,
    /// Roots that end in the cell at hand; `first` tells whether each is certain to be the only one there.
    found: Vec<Root>,
}

impl Scratch {
    pub(crate) fn new(surfaces: usize) -> Self {
        Self {
            tracks: vec![Track::default(); surfaces],
            found: Vec::with_capacity(3 * surfaces),
        }
    }

    /// For the next ray.
    #[inline(always)]
    pub(crate) fn reset(&mut self) {
        self.tracks.fill(Track::default());
    }
}

/// State of one ray on its way.
pub(crate) struct Way<'w, F> {
    pub(crate) walk: Walk,
    scratch: &'w mut Scratch,
    pub(crate) work: &'w mut Work,
    /// Parameter at the end of the last cell looked at.
    end: f64,
    pub(crate) certain: bool,
    /// No further root is wanted.
    ended: bool,
    push: F,
}

impl<'w, F: FnMut(&Root) -> bool> Way<'w, F> {
    #[inline(always)]
    pub(crate) fn new(walk: Walk, scratch: &'w mut Scratch, work: &'w mut Work, push: F) -> Self {
        Self {
            walk,
            scratch,
            work,
            end: f64::NEG_INFINITY,
            certain: true,
            ended: false,
            push,
        }
    }

    /// Hands on the roots found, in order. Returns whether to go on.
    fn push_found(&mut self) -> bool {
        let Scratch { found, tracks } = &mut *self.scratch;
        found.sort_by(|x, y| x.t.total_cmp(&y.t));
        for i in 0..found.len() {
            let (t, surface, after) = (found[i].t, found[i].surface, found[i].t + found[i].error);
            // Of two isovalues, and in either order: one beside the other, or beside a stretch in doubt.
            let next = found
                .get(i + 1)
                .is_some_and(|next| next.surface != surface && next.t - next.error <= after);
            let mut open = (tracks.iter().enumerate()).filter_map(|(of, track)| Some((of, track.doubt.as_ref()?.from)));
            if next || tracks.len() > 1 && open.any(|(of, from)| of != surface && from <= after.max(t)) {
                self.certain = false;
            }
            let root = &mut found[i];
            let sure = root.first;
            root.first = self.certain;
            self.certain &= sure;
            if !(self.push)(root) {
                self.ended = true;
                return false;
            }
        }
        found.clear();
        true
    }
}

/// An active cell with the part of the ray in it.
struct Inside {
    v: [f64; 8],
    /// Local coordinates at the ends.
    ends: [[f64; 3]; 2],
    t: [f64; 2],
}

impl Inside {
    #[inline(always)]
    fn t(&self, x: f64) -> f64 {
        if x == 1.0 {
            self.t[1]
        } else {
            self.t[0] + x * (self.t[1] - self.t[0])
        }
    }

    #[inline(always)]
    fn gradient(&self, x: f64) -> DVec3 {
        let [a, b] = self.ends;
        gradient(&self.v, three(|i| a[i] + x * (b[i] - a[i])))
    }
}

impl Search<'_> {
    /// The samples at the corners of a cell, x fastest.
    #[inline(always)]
    pub(crate) fn corners(&self, cell: [i32; 3]) -> [f64; 8] {
        let (sy, sz) = (self.dims[0], self.dims[0] * self.dims[1]);
        let at = corner(self.dims, cell);
        values!(self.samples, s => {
            let s = &s[at..at + sz + sy + 2];
            [
                s[0].into(),
                s[1].into(),
                s[sy].into(),
                s[sy + 1].into(),
                s[sz].into(),
                s[sz + 1].into(),
                s[sz + sy].into(),
                s[sz + sy + 1].into(),
            ]
        })
    }

    /// Returns whether to go on.
    #[inline(always)]
    pub(crate) fn cell<F: FnMut(&Root) -> bool>(&self, way: &mut Way<'_, F>, cell: [i32; 3], t0: f64, t1: f64) -> bool {
        way.work.cells += 1;
        let v = self.corners(cell);
        let w = way.walk;
        // A plane the ray enters or leaves by has its exact coordinate.
        let local = |a: usize, t: f64| {
            let x = w.o[a] + t * w.d[a] - f64::from(cell[a]);
            if t == w.plane(a, cell[a]) {
                0.0
            } else if t == w.plane(a, cell[a] + 1) {
                1.0
            } else {
                x
            }
        };
        let inside = Inside {
            v,
            ends: [three(|i| local(i, t0)), three(|i| local(i, t1))],
            t: [t0, t1],
        };
        let continues = way.end == t0;
        way.end = t1;
        for (i, bound) in self.bounds.iter().enumerate() {
            way.work.cubics += 1;
            let mut p = composed(&v, bound.isovalue, inside.ends[0], inside.ends[1]);
            let track = &mut way.scratch.tracks[i];
            if continues {
                p[0] = track.value;
            } else if track.doubt.is_some() {
                // Only where rays are so far off that the margin of active cells does not hold.
                way.scratch.found.extend(close(track, None, &w, i));
            }
            track.value = p[3];
            let b = self.margin * bound.size;
            if let (Some(positive), None) = (cubic::sign(p, b), &track.doubt) {
                track.positive = Some(positive);
                continue;
            }
            self.follow(way, &inside, p, i);
        }
        way.scratch.found.is_empty() || way.push_found()
    }

    /// Takes one isovalue through a cell whose sign is not the same everywhere, or that a stretch in doubt reaches.
    fn follow<F>(&self, way: &mut Way<'_, F>, inside: &Inside, p: [f64; 4], surface: usize) {
        let bound = self.margin * self.bounds[surface].size;
        let track = &mut way.scratch.tracks[surface];
        let (found, walk) = (&mut way.scratch.found, &way.walk);
        cubic::scan(p, bound, &mut |event| match event {
            Event::Clear(positive) => {
                if track.doubt.is_some() {
                    found.extend(close(track, Some(positive), walk, surface));
                }
                track.positive = Some(positive);
            }
            Event::Simple(x) => found.push(Root {
                t: inside.t(x),
                surface,
                gradient: inside.gradient(x),
                error: if self.claims {
                    bracket(p, x, bound, inside.t)
                } else {
                    f64::INFINITY
                },
                first: true,
            }),
            Event::Doubt(lo, hi) => {
                let doubt = track.doubt.get_or_insert_with(|| Doubt {
                    from: inside.t(lo),
                    to: 0.0,
                    at: 0.0,
                    least: f64::INFINITY,
                    gradient: DVec3::ZERO,
                });
                doubt.to = inside.t(hi);
                for x in [lo, 0.5 * (lo + hi), hi] {
                    let f = cubic::value(p, x).abs();
                    if f < doubt.least {
                        (doubt.at, doubt.least, doubt.gradient) = (inside.t(x), f, inside.gradient(x));
                    }
                }
            }
        });
    }

    /// The end of the ray, or of what is wanted of it.
    #[inline(always)]
    pub(crate) fn end<F: FnMut(&Root) -> bool>(&self, way: &mut Way<'_, F>) {
        if way.ended {
            way.scratch.found.clear();
            return;
        }
        for (i, track) in way.scratch.tracks.iter_mut().enumerate() {
            if track.doubt.is_some() {
                way.scratch.found.extend(close(track, None, &way.walk, i));
            }
        }
        if !way.scratch.found.is_empty() {
            way.push_found();
            way.scratch.found.clear();
        }
    }
}

/// The root that a stretch in doubt is, given the sign after it.
fn close(track: &mut Track, after: Option<bool>, walk: &Walk, surface: usize) -> Option<Root> {
    let Doubt {
        from, to, at, gradient, ..
    } = track.doubt.take()?;
    let crossed = track.positive.is_some() && after.is_some() && track.positive != after;
    track.positive = after;
    // Time for a hundredth of a cell.
    let short = 1e-2
        * walk
            .inv
            .iter()
            .fold(f64::INFINITY, |m, &x| if x == 0.0 { m } else { m.min(x.abs()) });
    // A crossing is where the values say; what may be a plateau begins where it begins.
    let t = if crossed || to - from <= short { at } else { from };
    Some(Root {
        t,
        surface,
        gradient,
        // t itself, and the two ends, are rounded.
        error: if crossed {
            (t - from).max(to - t) + 8.0 * f64::EPSILON * to.abs()
        } else {
            f64::INFINITY
        },
        first: crossed,
    })
}

/// Half the width, in t, of an interval about the simple root x with proved opposite signs at its ends; +inf where rounding hides them.
#[inline(always)]
fn bracket(p: [f64; 4], x: f64, bound: f64, [t0, t1]: [f64; 2]) -> f64 {
    let d = |i: usize| 3.0 * (p[i + 1] - p[i]);
    let y = 1.0 - x;
    let slope = y * (y * d(0) + x * d(1)) + x * (y * d(1) + x * d(2));
    // Twice the distance at which the tangent leaves the bound; then wider.
    let mut width = (2.0 * bound / slope.abs()).max(1e-14);
    while width < 1e-3 {
        let (lo, hi) = ((x - width).max(0.0), (x + width).min(1.0));
        let (f, g) = (cubic::value(p, lo), cubic::value(p, hi));
        if f.abs() > bound && g.abs() > bound && (f < 0.0) != (g < 0.0) {
            // t itself, and the two ends, are rounded.
            return (x - lo).max(hi - x) * (t1 - t0) + 8.0 * f64::EPSILON * t1.abs();
        }
        width *= 16.0;
    }
    f64::INFINITY
}

/// Bernstein coefficients of s - c along the segment from local a to local b of a cell with these corner samples (x fastest).
#[inline(always)]
pub(crate) fn composed(v: &[f64; 8], c: f64, a: [f64; 3], b: [f64; 3]) -> [f64; 4] {
    let mix = |p: f64, q: f64, x: f64| p + x * (q - p);
    let mut x = [0.0; 8];
    for k in 0..4 {
        let (p, q) = (v[2 * k] - c, v[2 * k + 1] - c);
        x[2 * k] = mix(p, q, a[0]);
        x[2 * k + 1] = mix(p, q, b[0]);
    }
    let mut y = [0.0; 8];
    for k in [0, 4] {
        for i in 0..2 {
            y[k + i] = mix(x[k + i], x[k + 2 + i], a[1]);
            y[k + 2 + i] = mix(x[k + i], x[k + 2 + i], b[1]);
        }
    }
    let (z0, z1) = (a[2], b[2]);
    let third = 1.0 / 3.0;
    [
        mix(y[0], y[4], z0),
        (mix(y[1], y[5], z0) + mix(y[2], y[6], z0) + mix(y[0], y[4], z1)) * third,
        (mix(y[3], y[7], z0) + mix(y[1], y[5], z1) + mix(y[2], y[6], z1)) * third,
        mix(y[3], y[7], z1),
    ]
}

/// Index of the first sample of a cell; 64 bits wide, so that volumes of more than 2^32 samples work.
#[inline(always)]
pub(crate) fn corner(dims: [usize; 3], cell: [i32; 3]) -> usize {
    (cell[2] as usize * dims[1] + cell[1] as usize) * dims[0] + cell[0] as usize
}

/// Gradient of the trilinear interpolant at local x, per cell.
#[inline(always)]
pub(crate) fn gradient(v: &[f64; 8], [x, y, z]: [f64; 3]) -> DVec3 {
    let mix = |p: f64, q: f64, x: f64| p + x * (q - p);
    let d = |i: usize, j: usize| v[j] - v[i];
    DVec3::new(
        mix(mix(d(0, 1), d(2, 3), y), mix(d(4, 5), d(6, 7), y), z),
        mix(mix(d(0, 2), d(1, 3), x), mix(d(4, 6), d(5, 7), x), z),
        mix(mix(d(0, 4), d(1, 5), x), mix(d(2, 6), d(3, 7), x), y),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Indices beyond 2^32 samples, without the memory.
    #[test]
    fn cells_of_huge_volumes_are_addressed() {
        let dims = [5000, 6000, 7000];
        let last = corner(dims, [4998, 5998, 6998]);
        // The last of its eight samples is the last of all.
        assert_eq!((last + dims[0] * dims[1] + dims[0] + 1) as u64, 5000 * 6000 * 7000 - 1);
        assert!(last > u32::MAX as usize);
        assert_eq!(corner([1 << 30, 2, 2], [(1 << 30) - 2, 0, 0]), (1 << 30) - 2);
    }
}
