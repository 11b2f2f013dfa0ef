//! One search: elements on the ray's way, stages, and roots joined.

use super::{
    Doubt, Index, Line, Target, Wanted,
    exact::{self, simplest},
    forms::{Forms, Number},
    index::Candidate,
    place,
    solve::{Doubtful, Solved, Task, Zero, clusters, hull, solve},
};
use crate::{
    Decided, Multiplicity, Root,
    bracket::narrow,
    exact::Ratio,
    extremum::LIMIT,
    oracle::{Goal, Search, Shared},
    real::Dd,
    tets::ball::Ball,
};
use isobar_core::{Function, HexElement, HexPatches, Ray};

/// Boxes per element with f64, double-double, and for the watch.
const BOXES: [usize; 3] = [30_000, 12_000, 4_000];
/// Least sizes of boxes: 2^-44, 2^-50, 2^-18.
const LEAST: [f64; 3] = [5.7e-14, 8.9e-16, 3.9e-6];
/// Doubtful boxes of one element that are looked at one by one.
const FEW: usize = 512;

/// A root of one element.
#[derive(Clone, Copy, Debug)]
struct Located {
    /// Certain.
    t: Ball<Dd>,
    /// The same as f64.
    bounds: (f64, f64),
    slope: f64,
    /// Whether the zero is known to be regular.
    regular: bool,
    decided: Decided,
    candidate: Candidate,
    target: Target,
}

/// A stretch that could not be decided.
#[derive(Clone, Copy, Debug)]
struct Unresolved {
    lo: f64,
    hi: f64,
    why: Doubt,
    /// Of a regular zero that may lie in the element, else 0.
    slope: f64,
}

/// A zero, for all values in the watch's band, that a face of its element cuts.
#[derive(Clone, Copy, Debug)]
struct Cut {
    t: (f64, f64),
    rises: bool,
    element: u32,
    target: Target,
    /// Half the band, in units of s.
    limit: f64,
}

/// One search.
struct Run<'a> {
    patches: &'a HexPatches,
    index: &'a Index,
    wanted: Wanted,
    line: Line,
    watch: bool,
    roots: Vec<Located>,
    doubts: Vec<Unresolved>,
    cuts: Vec<Cut>,
    /// Elements looked at, for the watch.
    seen: Vec<Candidate>,
    /// The first near-extremum.
    near: Option<f64>,
    decided: Decided,
    /// The part of the ray that is looked at: its ends within these.
    from: (f64, f64),
    to: (f64, f64),
}

/// Finds what the goal asks for.
pub(crate) fn search(
    patches: &HexPatches,
    function: &dyn Function,
    shared: &Shared,
    wanted: Wanted,
    ray: &Ray,
    goal: Goal<'_>,
) -> Search {
    let mut out = Search::new(Decided::F64);
    let Some(index) = &shared.hexes else { return out };
    let (mut from, mut to) = ((0.0, 0.0), (f64::INFINITY, f64::INFINITY));
    if goal.kept.is_some() {
        let Some((a, b)) = goal.exact_ray(ray, function.domain(), false).and_then(|r| r.stay) else {
            return out;
        };
        (from, to) = (a.bounds(), b.bounds());
    }
    let line = Line::new(ray);
    if !(index.moderate && line.moderate()) {
        out.decided = Decided::Exact;
        out.unresolved.push((from.0, to.1));
        out.doubts.push(Doubt::Limit);
        return out;
    }
    let mut run = Run {
        patches,
        index,
        wanted,
        line,
        watch: goal.watch,
        roots: Vec::new(),
        doubts: Vec::new(),
        cuts: Vec::new(),
        seen: Vec::new(),
        near: None,
        decided: Decided::F64,
        from,
        to,
    };
    let value = match wanted {
        Wanted::Each(Target::Isovalue(c)) => Some(c),
        _ => None,
    };
    let mut first = f64::INFINITY;
    for candidate in index.gather(ray, value, from.0, to.1.min(goal.until)) {
        // A root certainly before all that is left; the watch looks a little beyond it.
        let beyond = if goal.watch { 1e-5 * first.abs() } else { 0.0 };
        if goal.first_only && first + beyond < candidate.stay.0 {
            break;
        }
        run.visit(&candidate, goal.least);
        first = run.roots.iter().fold(first, |f, r| f.min(r.bounds.1));
    }
    run.finish(goal, out)
}

impl Run<'_> {
    fn visit(&mut self, candidate: &Candidate, least: Decided) {
        match self.wanted {
            Wanted::Each(target) => self.element(candidate, target, least),
            Wanted::Boundary => {
                for (axis, value) in self.index.outer(self.patches, candidate.element) {
                    self.element(candidate, Target::Parameter { axis, value }, least);
                }
            }
        }
    }

    /// One element with f64, double-double, then integers.
    fn element(&mut self, candidate: &Candidate, target: Target, least: Decided) {
        let patches = self.patches;
        let element = &patches.elements[candidate.element as usize];
        let mut floating = None;
        if least == Decided::F64 {
            let band = if self.watch {
                band(element, target, limit(element, target))
            } else {
                0.0
            };
            let Some(forms) = Forms::<f64>::near(element, &self.line, target, band) else {
                return;
            };
            if self.watch {
                floating = self.watched(candidate, element, target, &forms);
            }
            let mut solved = floating.unwrap_or_else(|| solve(forms, task(target, 0)));
            self.sharpen(element, target, &mut solved.zeros);
            let clear = solved.doubts.is_empty() && solved.beside.is_empty();
            if clear && self.place(candidate, target, &solved.zeros, Decided::F64, true) {
                return;
            }
        }
        self.decided = self.decided.max(Decided::DoubleDouble);
        let Some(forms) = Forms::<Dd>::new(element, &self.line, target) else {
            return;
        };
        let solved = solve(forms, task(target, 1));
        self.place(candidate, target, &solved.zeros, Decided::DoubleDouble, false);
        if !(solved.doubts.is_empty() && solved.beside.is_empty()) {
            self.decided = Decided::Exact;
        }
        for zero in &solved.beside {
            self.on_face(candidate, element, target, zero);
        }
        self.doubtful(candidate, element, target, &solved.doubts);
    }

    /// Zeros that f64 does not place narrowly enough: one step with values in double-double.
    fn sharpen(&self, element: &HexElement, target: Target, zeros: &mut [Zero<f64>]) {
        let mut better = None;
        for zero in zeros {
            let wide = place::along(element, &self.line, &zero.u).is_none_or(|t| !narrow(t.bounds().0, t.bounds().1));
            if !wide {
                continue;
            }
            let forms = better.get_or_insert_with(|| Forms::<Dd>::new(element, &self.line, target));
            let (newton, size) = &zero.test;
            if let Some(u) = forms.as_ref().and_then(|f| newton.sharpened(f, &zero.u, size)) {
                zero.u = u;
            }
        }
    }

    /// Adds zeros as roots; with `strict` only if all their brackets are narrow, else it says no.
    fn place<R: Number>(
        &mut self,
        candidate: &Candidate,
        target: Target,
        zeros: &[Zero<R>],
        decided: Decided,
        strict: bool,
    ) -> bool {
        let element = &self.patches.elements[candidate.element as usize];
        let mut all = Vec::with_capacity(zeros.len());
        for zero in zeros {
            let Some(t) = place::along(element, &self.line, &zero.u) else {
                if strict {
                    return false;
                }
                self.doubt(candidate.stay, Doubt::Fold, 0.0);
                continue;
            };
            let (lo, hi) = t.bounds();
            if strict && !narrow(lo, hi) {
                return false;
            }
            let u = zero.u.map(|b| b.x.f64());
            let root = Located {
                t: Ball { x: t.x.dd(), e: t.e },
                bounds: (lo, hi),
                slope: place::slope(element, &self.line, target, &u),
                regular: true,
                decided,
                candidate: *candidate,
                target,
            };
            all.push((root, zero.u.map(Ball::bounds)));
        }
        for (root, u) in all {
            self.keep(root, Some(&u));
        }
        true
    }

    /// Adds a root if it lies in the part of the ray looked at; where that is in doubt, integers may find it at simple parameters.
    fn keep(&mut self, root: Located, u: Option<&[(f64, f64); 3]>) {
        let (lo, hi) = root.bounds;
        if lo >= self.from.1 && hi <= self.to.0 {
            self.roots.push(root);
            return;
        }
        if hi < self.from.0 || lo > self.to.1 {
            return;
        }
        let element = &self.patches.elements[root.candidate.element as usize];
        match u.and_then(|u| self.at_fraction(element, root.target, u)) {
            Some(t) => {
                self.decided = Decided::Exact;
                let (x, e) = exact::ball(&t);
                let exact = Located {
                    t: Ball { x: Dd::new(x), e },
                    bounds: t.bounds(),
                    decided: Decided::Exact,
                    ..root
                };
                self.keep(exact, None);
            }
            None => self.doubt((lo, hi), Doubt::Face, root.slope),
        }
    }

    /// Adds a stretch, as far as it is looked at.
    fn doubt(&mut self, (lo, hi): (f64, f64), why: Doubt, slope: f64) {
        let (lo, hi) = (lo.max(self.from.0), hi.min(self.to.1));
        if lo <= hi {
            self.doubts.push(Unresolved { lo, hi, why, slope });
        }
    }

    /// A zero that double-double cannot tell from one on a face.
    fn on_face(&mut self, candidate: &Candidate, element: &HexElement, target: Target, zero: &Zero<Dd>) {
        let bounds = zero.u.map(Ball::bounds);
        if let Some(t) = self.at_fraction(element, target, &bounds) {
            self.exact_root(candidate, target, &t, zero.u.map(|b| b.x.hi), true);
            return;
        }
        let faces: Vec<(usize, f64)> = (0..3).filter_map(|k| zero.faces[k].map(|f| (k, f))).collect();
        if let Some(kept) = exact::independent(element, &self.line, target, &zero.faces)
            && let Some(forms) = Forms::<Dd>::on_faces(element, &self.line, target, &kept, &faces)
        {
            let mut task = task(target, 1);
            faces.iter().for_each(|&(k, _)| task.pinned[k] = true);
            let solved = solve(forms, task);
            let same = |z: &&Zero<Dd>| (0..3).all(|k| z.u[k].minus(zero.u[k]).sign().is_none());
            if let Some(z) = solved.zeros.iter().find(same) {
                let z = *z;
                self.place(candidate, target, &[z], Decided::Exact, false);
                return;
            }
        }
        match place::along(element, &self.line, &zero.u) {
            Some(t) => {
                let slope = place::slope(element, &self.line, target, &zero.u.map(|b| b.x.hi));
                self.doubt(t.bounds(), Doubt::Face, slope);
            }
            None => self.doubt(candidate.stay, Doubt::Fold, 0.0),
        }
    }

    /// The t of a root at the simplest fractions within bounds.
    fn at_fraction(&self, element: &HexElement, target: Target, bounds: &[(f64, f64); 3]) -> Option<Ratio> {
        let mut u = [simplest(0.0, 0.0)?; 3];
        for (x, b) in u.iter_mut().zip(bounds) {
            *x = simplest(b.0, b.1)?;
        }
        exact::root_at(element, &self.line, target, &u)
    }

    fn exact_root(&mut self, candidate: &Candidate, target: Target, t: &Ratio, u: [f64; 3], regular: bool) {
        let element = &self.patches.elements[candidate.element as usize];
        let (x, e) = exact::ball(t);
        let root = Located {
            t: Ball { x: Dd::new(x), e },
            bounds: t.bounds(),
            slope: if regular {
                place::slope(element, &self.line, target, &u)
            } else {
                0.0
            },
            regular,
            decided: Decided::Exact,
            candidate: *candidate,
            target,
        };
        self.keep(root, None);
    }

    /// Boxes that double-double could not decide.
    fn doubtful(&mut self, candidate: &Candidate, element: &HexElement, target: Target, boxes: &[Doubtful]) {
        let Some(first) = boxes.first() else { return };
        let why = boxes.iter().map(|b| b.why).max().unwrap_or(first.why);
        if boxes.len() > FEW {
            self.doubt(candidate.stay, why, 0.0);
            return;
        }
        for cluster in clusters(boxes) {
            let hull = hull(&cluster);
            if let Some(t) = self.at_fraction(element, target, &hull) {
                self.exact_root(candidate, target, &t, hull.map(|h| h.0), false);
            }
            let mut range: Option<(f64, f64)> = None;
            for b in &cluster {
                let (lo, hi) = stretch(&self.line, candidate, element, b);
                range = Some(range.map_or((lo, hi), |r| (r.0.min(lo), r.1.max(hi))));
            }
            if let Some(range) = range {
                self.doubt(range, why, 0.0);
            }
        }
    }

    /// The element for all values in the limit's band: notes near-extrema; the zeros, where nothing was in doubt.
    fn watched(&mut self, c: &Candidate, e: &HexElement, target: Target, forms: &Forms<f64>) -> Option<Solved<f64>> {
        self.seen.push(*c);
        let limit = limit(e, target);
        let solved = banded(e, target, forms, limit);
        let mut note = |t: f64| self.near = Some(self.near.map_or(t, |n| n.min(t)));
        if solved.doubts.len() > FEW {
            note(c.stay.0);
        } else {
            for b in &solved.doubts {
                note(stretch(&self.line, c, e, b).0);
            }
        }
        self.cuts.extend(cuts(&self.line, c, e, target, limit, &solved));
        // The part looked at begins or ends within the limit of the surface.
        for z in &solved.zeros {
            let slope = place::slope(e, &self.line, target, &z.u.map(|b| b.x)).abs();
            let t = place::along(e, &self.line, &z.u).map_or(f64::INFINITY, |t| t.x);
            for end in [self.from.0, self.to.0] {
                if (t - end).abs() * slope <= limit {
                    note(end);
                }
            }
        }
        solved.doubts.is_empty().then_some(solved)
    }

    /// Roots in order, those told apart in f64 only where they are.
    fn refined(&mut self) {
        self.sort();
        let mut again: Vec<(Candidate, Target)> = Vec::new();
        for w in self.roots.windows(2) {
            if overlap(&w[0], &w[1]) {
                for r in w.iter().filter(|r| r.decided == Decided::F64) {
                    if !again.iter().any(|(c, t)| c.element == r.candidate.element && *t == r.target) {
                        again.push((r.candidate, r.target));
                    }
                }
            }
        }
        for (candidate, target) in again {
            self.roots
                .retain(|r| r.candidate.element != candidate.element || r.target != target);
            self.element(&candidate, target, Decided::DoubleDouble);
        }
        self.sort();
    }

    fn sort(&mut self) {
        self.roots
            .sort_by(|a, b| a.t.x.hi.total_cmp(&b.t.x.hi).then(a.t.x.lo.total_cmp(&b.t.x.lo)));
    }

    /// Joins what cannot be told apart and hands all over.
    fn finish(mut self, goal: Goal<'_>, mut out: Search) -> Search {
        self.refined();
        let mut groups: Vec<Vec<Located>> = Vec::new();
        for root in std::mem::take(&mut self.roots) {
            match groups.last_mut() {
                Some(g) if g.iter().any(|o| overlap(o, &root)) => g.push(root),
                _ => groups.push(vec![root]),
            }
        }
        let mut roots: Vec<Root> = groups.iter().map(|g| joined(g)).collect();
        let mut open: Vec<Unresolved> = Vec::new();
        for d in std::mem::take(&mut self.doubts) {
            // A doubt within a bracket, or hardly beyond, is part of that root.
            let holds = |r: &&mut Root| {
                let (lo, hi) = (r.lo.min(d.lo), r.hi.max(d.hi));
                r.lo <= d.hi && d.lo <= r.hi && hi - lo <= 1e-10 * hi.abs()
            };
            match roots.iter_mut().find(holds) {
                Some(r) => {
                    (r.lo, r.hi) = (r.lo.min(d.lo), r.hi.max(d.hi));
                    if r.slope * d.slope <= 0.0 {
                        (r.multiplicity, r.slope) = (Multiplicity::Unknown, 0.0);
                    }
                }
                None => open.push(d),
            }
        }
        open.sort_by(|a, b| a.lo.total_cmp(&b.lo));
        for d in open {
            match (out.unresolved.last_mut(), out.doubts.last_mut()) {
                (Some(l), Some(why)) if d.lo <= l.1 => {
                    l.1 = l.1.max(d.hi);
                    *why = d.why.max(*why);
                }
                _ => {
                    out.unresolved.push((d.lo, d.hi));
                    out.doubts.push(d.why);
                }
            }
        }
        roots.sort_by(|a, b| a.lo.total_cmp(&b.lo).then(a.hi.total_cmp(&b.hi)));
        if goal.first_only {
            roots.truncate(1);
        }
        if self.watch {
            self.pair();
            out.near = self.near;
        }
        out.roots = roots;
        out.decided = self.decided;
        out
    }

    /// A zero that leaves its element by a face must enter another one there with s going the same way.
    fn pair(&mut self) {
        let all = std::mem::take(&mut self.cuts);
        for a in &all {
            let slack = 1e-9 * (a.t.0.abs() + a.t.1.abs());
            let partner = |b: &Cut| {
                let close = b.t.0 <= a.t.1 + slack && a.t.0 <= b.t.1 + slack;
                b.element != a.element && b.rises == a.rises && close
            };
            if a.t.1 < self.from.0 || a.t.0 > self.to.1 || all.iter().any(partner) {
                continue;
            }
            // The neighbour's own limit may be smaller: with this one it may have its part.
            let found = self.seen.iter().any(|c| {
                let element = &self.patches.elements[c.element as usize];
                let near = c.element != a.element && c.stay.0 <= a.t.1 + slack && a.t.0 <= c.stay.1 + slack;
                near && Forms::<f64>::near(element, &self.line, a.target, band(element, a.target, a.limit)).is_some_and(|forms| {
                    let solved = banded(element, a.target, &forms, a.limit);
                    cuts(&self.line, c, element, a.target, a.limit, &solved).any(|b| partner(&b))
                })
            });
            if !found {
                let t = a.t.0.max(self.from.0);
                self.near = Some(self.near.map_or(t, |n| n.min(t)));
            }
        }
    }
}

/// What f32-sized errors may change s by in an element.
fn limit(e: &HexElement, target: Target) -> f64 {
    match target {
        Target::Isovalue(iso) => LIMIT * e.values.iter().fold(0.0f64, |m, v| m.max((v - iso).abs())),
        Target::Parameter { .. } => LIMIT,
    }
}

/// What that is in units of gamma, at most.
fn band(e: &HexElement, target: Target, limit: f64) -> f64 {
    match target {
        Target::Isovalue(_) if e.rational_value => limit * e.points.iter().fold(0.0f64, |m, p| m.max(p[3])),
        _ => limit,
    }
}

/// All zeros for all values within `limit`.
fn banded(e: &HexElement, target: Target, forms: &Forms<f64>, limit: f64) -> Solved<f64> {
    let band = band(e, target, limit);
    solve(forms.clone(), Task { band, ..task(target, 2) })
}

/// The zeros that a face cuts.
fn cuts<'a>(
    line: &'a Line,
    c: &'a Candidate,
    e: &'a HexElement,
    target: Target,
    limit: f64,
    solved: &'a Solved<f64>,
) -> impl Iterator<Item = Cut> + 'a {
    solved.cut.iter().map(move |u| Cut {
        // Far from where it can be told, it is anywhere in the element.
        t: place::along(e, line, u).map_or(c.stay, Ball::bounds),
        rises: place::slope(e, line, target, &u.map(|b| b.x)) > 0.0,
        element: c.element,
        target,
        limit,
    })
}

/// Whether two roots may be one.
fn overlap(a: &Located, b: &Located) -> bool {
    a.t.minus(b.t).sign().is_none()
}

/// The root of a group that cannot be told apart.
fn joined(group: &[Located]) -> Root {
    let bounds = group.iter().map(|r| r.bounds);
    let (lo, hi) = bounds.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), b| (lo.min(b.0), hi.max(b.1)));
    let slope = group[0].slope;
    let simple = group.iter().all(|r| r.regular && r.slope.signum() == slope.signum());
    Root {
        lo,
        hi,
        multiplicity: if simple { Multiplicity::Simple } else { Multiplicity::Unknown },
        interval_end: None,
        slope: if simple { slope } else { 0.0 },
        decided: group.iter().map(|r| r.decided).max().unwrap_or(Decided::F64),
    }
}

fn task(target: Target, stage: usize) -> Task {
    let mut pinned = [false; 3];
    if let Target::Parameter { axis, .. } = target {
        pinned[axis] = true;
    }
    Task {
        pinned,
        band: 0.0,
        boxes: BOXES[stage],
        least: LEAST[stage],
    }
}

/// t of all points of the line in a box.
fn stretch(line: &Line, candidate: &Candidate, element: &HexElement, b: &Doubtful) -> (f64, f64) {
    let u: [Ball<f64>; 3] = std::array::from_fn(|k| Ball {
        x: 0.5 * (b.lo[k] + b.hi[k]),
        e: 0.5 * (b.hi[k] - b.lo[k]) + f64::EPSILON,
    });
    let (lo, hi) = place::along(element, line, &u).map_or((f64::NEG_INFINITY, f64::INFINITY), Ball::bounds);
    // The hull of the control points is as good a bound.
    let (a, b) = (lo.max(candidate.stay.0), hi.min(candidate.stay.1));
    if a <= b { (a, b) } else { candidate.stay }
}
