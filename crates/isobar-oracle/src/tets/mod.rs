//! Roots on the tetrahedra of a mesh ([`isobar_core::Structure::Mesh`]).
//!
//! **What a root is.** A t >= 0 for which some closed cell with a volume holds `o + t d` and its linear function is c there. Cells that share a face, an edge or a corner agree there, so the
//! root is the same t and counts once; where a mesh has gaps there is nothing. Where cells overlap (a folded mesh) each has its say.
//!
//! Each cell near the ray with values about c is looked at in f64, where that does not do in f64 about a point of the ray near the cell ([`ball::Near`]), then double-double ([`ball`]), then integers ([`exact`]); floating point
//! answers only where the ray goes through the inside of the cell by two certain faces and s - c certainly is not 0 there. Then a root lies inside
//! this cell and in no other. All cells about a root on a face, an edge or a corner are solved in integers, where equal t are
//! equal. Brackets that overlap, as those of cells that overlap may, send the whole ray to integers.

pub(crate) mod ball;
mod exact;
pub(crate) mod legs;
#[cfg(test)]
mod tests;
mod tree;

use crate::{
    Decided, Multiplicity, Root,
    bracket::narrow,
    exact::Ratio,
    extremum::{Stretch, Watch, far},
    oracle::{Goal, Search, Shared},
    real::{Dd, two_sum},
};
use ball::{Divide, Near, Seen, see, surely_beside};
use exact::{ExactCell, Zero};
use isobar_core::{DVec3, Function, Ray, TetMesh};
pub(crate) use tree::Index;
use tree::moderate;

/// s - c over the part of a cell's stay that is looked at, for the watch.
#[derive(Clone, Copy, Debug)]
struct Piece {
    s: [f64; 2],
    b: [f64; 2],
    most: f64,
    /// Whether the ray leaves the mesh, or what is looked at, here.
    last: bool,
}

/// The part of the ray that is looked at.
struct Part {
    from: Ratio,
    to: Option<Ratio>,
    /// f64 about both.
    from_f64: (f64, f64),
    to_f64: (f64, f64),
}

/// What floating point found in a cell.
struct Found {
    piece: Option<Piece>,
    root: Option<Root>,
}

/// The greatest f64 not above.
fn below(x: Dd) -> f64 {
    if x.lo < 0.0 { x.hi.next_down() } else { x.hi }
}

/// Finds what the goal asks for.
pub(crate) fn search(mesh: &TetMesh, function: &dyn Function, shared: &Shared, c: f64, ray: &Ray, goal: Goal<'_>) -> Search {
    let mut out = Search::new(Decided::F64);
    let Some(index) = &shared.tets else { return out };
    let Some(part) = Part::new(function, ray, &goal) else {
        return out;
    };
    let mut cells = Vec::new();
    index.gather(ray, c, part.from_f64.0, part.to_f64.1.min(goal.until), &mut cells);
    let numbers = ray.origin.to_array().into_iter().chain(ray.direction.to_array()).chain([c]);
    let floating = index.moderate && numbers.into_iter().all(moderate);
    let least = if floating { goal.least } else { Decided::Exact };
    let mut run = Run {
        mesh,
        index,
        c,
        ray,
        part,
        pieces: Vec::new(),
        roots: Vec::new(),
        exact: Vec::new(),
        decided: Decided::F64,
    };
    for &cell in &cells {
        run.visit(cell, least);
    }
    run.finish_exactly();
    let apart = |r: &[Root]| {
        r.windows(2)
            .all(|w| w[0].hi < w[1].lo && w[0].interval_end.is_none_or(|e| e < w[1].lo))
    };
    run.sort();
    if !apart(&run.roots) && run.roots.iter().any(|r| r.decided != Decided::Exact) {
        (run.pieces, run.roots, run.exact) = Default::default();
        for &cell in &cells {
            run.visit(cell, Decided::Exact);
        }
        run.finish_exactly();
        run.sort();
    }
    out.decided = run.decided;
    if goal.watch {
        out.near = run.watched();
    }
    out.roots = run.roots;
    if goal.first_only {
        out.roots.truncate(1);
    }
    out
}

impl Part {
    /// From the start of the ray, or what clipping planes keep of it.
    fn new(function: &dyn Function, ray: &Ray, goal: &Goal<'_>) -> Option<Self> {
        if goal.kept.is_none() {
            return Some(Self {
                from: Ratio::from_f64(0.0),
                to: None,
                from_f64: (0.0, 0.0),
                to_f64: (f64::INFINITY, f64::INFINITY),
            });
        }
        let (from, to) = goal.exact_ray(ray, function.domain(), false)?.stay?;
        Some(Self {
            from_f64: from.bounds(),
            to_f64: to.bounds(),
            from,
            to: Some(to),
        })
    }
}

/// One search.
struct Run<'a> {
    mesh: &'a TetMesh,
    index: &'a Index,
    c: f64,
    ray: &'a Ray,
    part: Part,
    pieces: Vec<Piece>,
    roots: Vec<Root>,
    /// Cells that only integers can tell.
    exact: Vec<ExactCell>,
    decided: Decided,
}

impl Run<'_> {
    fn cell(&self, cell: u32) -> ([DVec3; 4], [f64; 4]) {
        let c = self.mesh.cells[cell as usize];
        (
            c.map(|i| self.mesh.points[i as usize]),
            c.map(|i| f64::from(self.mesh.values[i as usize])),
        )
    }

    /// One cell with f64, double-double, then integers.
    fn visit(&mut self, cell: u32, least: Decided) {
        let (corners, values) = self.cell(cell);
        let (lo, hi) = values.iter().fold((values[0], values[0]), |(a, b), &v| (a.min(v), b.max(v)));
        if far(lo, hi, self.c) {
            return;
        }
        let mut found = None;
        if least == Decided::F64 {
            if surely_beside(self.ray, &corners) {
                return;
            }
            let seen = see::<f64>(self.ray, &corners, &values, self.c);
            found = self.float(cell, seen, 0.0, &corners, &values, Decided::F64);
            // From afar f64 knows the root too badly.
            if found.is_none()
                && let Some(near) = Near::new(self.ray, &corners)
            {
                let seen = near.see(self.ray.direction, &corners, &values, self.c);
                found = self.float(cell, seen, near.t, &corners, &values, Decided::F64);
            }
        }
        if found.is_none() && least != Decided::Exact {
            let seen = see::<Dd>(self.ray, &corners, &values, self.c);
            found = self.float(cell, seen, 0.0, &corners, &values, Decided::DoubleDouble);
            if found.is_some() {
                self.decided = self.decided.max(Decided::DoubleDouble);
            }
        }
        if let Some(found) = found {
            self.pieces.extend(found.piece);
            self.roots.extend(found.root);
            return;
        }
        self.decided = Decided::Exact;
        let stay = (&self.part.from, self.part.to.as_ref());
        self.exact
            .extend(ExactCell::new(self.ray, cell, &corners, &values, self.c, stay));
    }

    /// What follows from a stay whose t is counted from `shift`; `None` where this arithmetic cannot tell.
    fn float<R: Divide>(
        &self,
        cell: u32,
        seen: Seen<R>,
        shift: f64,
        corners: &[DVec3; 4],
        values: &[f64; 4],
        decided: Decided,
    ) -> Option<Found> {
        const NOTHING: Option<Found> = Some(Found { piece: None, root: None });
        let stay = match seen {
            Seen::Beside => return NOTHING,
            Seen::Unclear => return None,
            Seen::Through(s) => s,
        };
        let shifted = |(lo, hi): (f64, f64)| (below(two_sum(shift, lo)), -below(two_sum(-shift, -hi)));
        let (t0, t1) = (shifted(stay.t[0].bounds()), shifted(stay.t[1].bounds()));
        let (from, to) = (self.part.from_f64, self.part.to_f64);
        if t1.1 < from.0 || t0.0 > to.1 {
            return NOTHING;
        }
        let (f0, f1) = (stay.f[0].sign()?, stay.f[1].sign()?);
        let (a, b) = (stay.f[0].x.f64(), stay.f[1].x.f64());
        let local = stay.t.map(|t| t.x.f64());
        let (s0, s1) = (shift + local[0], shift + local[1]);
        let slope = (b - a) / (local[1] - local[0]);
        let mut root = None;
        if f0 != f1 {
            // t0 + (t1 - t0) f0/(f0 - f1)
            let share = stay.f[0].over(stay.f[0].minus(stay.f[1]))?;
            let (lo, hi) = shifted(stay.t[0].plus(stay.t[1].minus(stay.t[0]).times(share)).bounds());
            if hi >= from.0 && lo <= to.1 {
                // Certainly within what is looked at.
                if !(lo > from.1 && hi < to.0 && narrow(lo, hi)) {
                    return None;
                }
                root = Some(Root {
                    lo,
                    hi,
                    multiplicity: Multiplicity::Simple,
                    interval_end: None,
                    slope: self.slope(corners, values),
                    decided,
                });
            }
        }
        let at = |t: f64| {
            if t == s0 {
                a
            } else if t == s1 {
                b
            } else {
                a + slope * (t - s0)
            }
        };
        let s = [s0.max(from.0), s1.min(to.1)];
        let piece = Piece {
            s,
            b: s.map(at),
            most: values.iter().fold(0.0, |m: f64, v| m.max((v - self.c).abs())),
            last: s1 >= to.0 || self.index.is_outer(cell, stay.faces[1]),
        };
        Some(Found {
            piece: Some(piece),
            root,
        })
    }

    /// The roots of the cells left to integers.
    fn finish_exactly(&mut self) {
        let cells = std::mem::take(&mut self.exact);
        // Closed stretches s = c, some of them points.
        let mut zeros: Vec<(Ratio, Ratio)> = Vec::new();
        for x in &cells {
            let (t0, t1) = (x.t0.bounds().0, x.t1.bounds().1);
            self.pieces.push(Piece {
                s: [t0, if x.is_point() { t0 } else { t1 }],
                b: [x.share(&x.t0), x.share(&x.t1)],
                most: 1.0,
                last: x.out.is_none_or(|k| self.index.is_outer(x.cell, k)),
            });
            match x.zero() {
                Zero::None => {}
                Zero::At(t) => zeros.push((t.clone(), t)),
                Zero::All => zeros.push((x.t0.clone(), x.t1.clone())),
            }
        }
        zeros.sort_by(|a, b| a.0.compare(&b.0));
        let mut joined: Vec<(Ratio, Ratio)> = Vec::new();
        for z in zeros {
            match joined.last_mut() {
                Some(l) if z.0.compare(&l.1).is_le() => l.1 = l.1.clone().max(z.1),
                _ => joined.push(z),
            }
        }
        for (t0, t1) in joined {
            let (lo, hi) = t0.bounds();
            let (multiplicity, slope) = if t0.compare(&t1).is_lt() {
                (Multiplicity::Interval, 0.0)
            } else {
                self.at_point(&cells, &t0)
            };
            self.roots.push(Root {
                lo,
                hi,
                multiplicity,
                interval_end: (multiplicity == Multiplicity::Interval).then(|| t1.bounds().1),
                slope,
                decided: Decided::Exact,
            });
        }
    }

    /// The multiplicity of a root at one t, from both sides, and the slope.
    fn at_point(&self, cells: &[ExactCell], t: &Ratio) -> (Multiplicity, f64) {
        let before = cells
            .iter()
            .find(|x| x.t0.compare(t).is_lt() && x.t1.compare(t).is_ge() && x.share(t) == 0.0);
        let after = cells
            .iter()
            .find(|x| x.t0.compare(t).is_le() && x.t1.compare(t).is_gt() && x.share(t) == 0.0);
        if let (Some(b), Some(a)) = (before, after)
            && a.rise() != b.rise()
        {
            return (Multiplicity::Even(2), 0.0);
        }
        let touched = || cells.iter().find(|x| x.is_point() && x.t0.compare(t).is_eq());
        let slope = after.or(before).or_else(touched).map_or(0.0, |x| {
            let (corners, values) = self.cell(x.cell);
            self.slope(&corners, &values)
        });
        (Multiplicity::Simple, slope)
    }

    /// ds/dt in a cell.
    fn slope(&self, p: &[DVec3; 4], v: &[f64; 4]) -> f64 {
        let (a, b, d) = (p[1] - p[0], p[2] - p[0], p[3] - p[0]);
        let normals = [b.cross(d), d.cross(a), a.cross(b)];
        let g = normals[0] * (v[1] - v[0]) + normals[1] * (v[2] - v[0]) + normals[2] * (v[3] - v[0]);
        g.dot(self.ray.direction) / normals[2].dot(d)
    }

    fn sort(&mut self) {
        self.roots.sort_by(|a, b| a.lo.total_cmp(&b.lo).then(a.hi.total_cmp(&b.hi)));
    }

    /// The first near-extremum not after the first root.
    fn watched(&mut self) -> Option<f64> {
        self.pieces
            .sort_by(|a, b| a.s[0].total_cmp(&b.s[0]).then(a.s[1].total_cmp(&b.s[1])));
        let (first, last) = (
            self.pieces.first()?.s[0],
            self.pieces.iter().fold(0.0f64, |m, p| m.max(p.s[1])),
        );
        let tiny = 1e-12 * (last - first) + 4.0 * f64::EPSILON * (first.abs() + last.abs());
        let root = self.roots.first().copied();
        let mut watch = Watch::default();
        let (mut passed, mut end) = (false, f64::NEG_INFINITY);
        for p in &self.pieces {
            if passed && !watch.wants_more() {
                break;
            }
            let length = p.s[1] - p.s[0];
            if length > tiny && p.s[1] <= end + tiny {
                // A ray inside a face: the neighbour has the same piece.
                continue;
            }
            let here = root.filter(|r| !passed && r.lo <= p.s[1] + tiny && r.t() >= p.s[0] - tiny);
            let stretch = Stretch {
                b: &p.b,
                most: p.most,
                s0: p.s[0],
                s1: p.s[1],
                first: true,
                last: p.last,
                root: here.map(|r| ((r.t() - p.s[0]) / length).clamp(0.0, 1.0)),
            };
            // A neighbour met in a point only says nothing that a longer piece there does not.
            let touches = length <= tiny
                && self
                    .pieces
                    .iter()
                    .any(|q| q.s[1] - q.s[0] > tiny && q.s[0] <= p.s[1] + tiny && q.s[1] >= p.s[0] - tiny);
            if touches {
                continue;
            }
            watch.piece(&stretch, tiny);
            passed |= here.is_some();
            end = end.max(p.s[1]);
        }
        if root.is_none() {
            watch.finish();
        }
        watch.found
    }
}
