//! Roots in cubics on the tetrahedra of the type-6 partition ([`isobar_core::Tetrahedral`]).
//!
//! The walk over cubes is that over the cells of a lattice centred on samples; a cube's stay is cut into those of its tetrahedra ([`compose`], in integers [`exact`]), and each is solved
//! by the same stages as a cell. Where f64 and double-double cannot tell the parts of a cube, or the roots of one, all of that cube is solved in integers.

mod compose;
mod exact;
pub(crate) mod legs;
#[cfg(test)]
mod tests;

use crate::{
    Decided, Multiplicity,
    bracket::Bracket,
    compose::Bernstein,
    exact::{ExactRay, Piece, Ratio, Roots},
    extremum::{Stretch, Watch, far},
    isolate::Isolated,
    map::{Mapped, RayMap},
    oracle::{Goal, Search, Shared},
    pieces::{self, Exactly, Flow, Solved, Stay, brackets, finished, joined, mapped, told, told_stretch},
    real::{Dd, Real},
    walk::{Visit, steady},
};
use compose::{Part, cut, signatures};
use exact::{ExactPart, parts, piece};
use isobar_core::{Function, Ray, TetMasks, Tetrahedral};
use std::ops::ControlFlow::{Break, Continue};

/// Finds what the goal asks for.
pub(crate) fn search(
    spline: &dyn Tetrahedral,
    function: &dyn Function,
    shared: &Shared,
    c: f64,
    ray: &Ray,
    goal: Goal<'_>,
) -> Search {
    let masks = spline.masks();
    let mut run = Run {
        spline,
        masks,
        signatures: signatures(masks),
        function,
        shared,
        c,
        ray,
        goal,
        cubes: spline.dims(),
        exact: None,
        open: None,
        watch: Watch::default(),
        tiny: 0.0,
        out: Search::new(Decided::F64),
        isolated: Vec::new(),
    };
    match mapped(shared, &goal, ray) {
        Mapped::Outside => {}
        Mapped::Ray(map) if steady(&map) => run.walk(&map),
        Mapped::Ray(_) | Mapped::Unclear => run.walk_exactly(),
    }
    run.close();
    finished(run.out, run.watch, &goal)
}

/// What a stretch s = c last went through.
#[derive(Clone, Debug)]
enum Open {
    /// Up to this t.
    Until(Ratio),
    /// All of this cube.
    Cube([usize; 3]),
}

/// One search.
struct Run<'a> {
    spline: &'a dyn Tetrahedral,
    masks: &'static TetMasks,
    signatures: [u8; 24],
    function: &'a dyn Function,
    shared: &'a Shared,
    c: f64,
    ray: &'a Ray,
    goal: Goal<'a>,
    cubes: [usize; 3],
    exact: Option<Box<ExactRay>>,
    /// A stretch s = c that is the last root and has not ended.
    open: Option<Open>,
    /// Its parameter is t.
    watch: Watch,
    /// Stretches shorter than this, and gaps, are rounding.
    tiny: f64,
    out: Search,
    isolated: Vec<Isolated>,
}

/// A cube's data.
struct Cube {
    index: [usize; 3],
    data: [f64; 27],
    least: f64,
    greatest: f64,
}

impl Cube {
    /// Greatest |datum - c|, rounded up.
    fn most(&self, c: f64) -> f64 {
        (self.greatest - c).abs().max((self.least - c).abs()).next_up()
    }
}

/// The answer in f64 or double-double cannot be given.
struct Doubtful;

impl Run<'_> {
    fn cube(&self, index: [usize; 3]) -> Cube {
        let mut data = [0.0; 27];
        self.spline.data(index, &mut data);
        let (least, greatest) = data.iter().fold((data[0], data[0]), |(a, b), &v| (a.min(v), b.max(v)));
        Cube {
            index,
            data,
            least,
            greatest,
        }
    }

    /// Superblocks, blocks, cubes; those that cannot come near the isovalue are passed by.
    fn walk(&mut self, map: &RayMap) {
        let shared = self.shared;
        let Some(skip) = &shared.skip else { return };
        let c = self.c;
        let reach = map.t_ref.abs() + map.start.0.abs().max(map.end.1.abs());
        self.tiny = 1e-12 * (map.end.1 - map.start.0) + 4.0 * f64::EPSILON * reach;
        // Rounded upward: cubes that begin later hold nothing that was asked for.
        let until = (self.goal.until - map.t_ref) + 1e-15 * (self.goal.until.abs() + map.t_ref);
        let idle = |_: &Self, lo, hi| far(lo, hi, c);
        pieces::walk(map, skip, self.cubes, until, self, idle, |run, v| run.visit(map, v, until));
    }

    /// One cube with f64, double-double, then integers.
    fn visit(&mut self, map: &RayMap, v: &Visit, until: f64) -> Flow {
        if v.outer.0 > until {
            return Break(());
        }
        let cube = self.cube(v.index);
        if far(cube.least, cube.greatest, self.c) {
            return Continue(());
        }
        #[expect(clippy::float_cmp, reason = "equality of data values is meant")]
        if self.open.is_some() && cube.least == self.c && cube.greatest == self.c && v.inner.0 < v.inner.1 {
            // A stretch goes on through a cube that the ray certainly visits.
            self.open = Some(Open::Cube(v.index));
            return Continue(());
        }
        let before = (self.out.roots.len(), self.watch.clone());
        match self.parts(map, v, &cube) {
            Ok(flow) => flow,
            Err(Doubtful) => {
                self.out.roots.truncate(before.0);
                self.watch = before.1;
                self.exactly(&cube)
            }
        }
    }

    /// The parts of a cube in floating point.
    fn parts(&mut self, map: &RayMap, v: &Visit, cube: &Cube) -> Result<Flow, Doubtful> {
        if self.open.is_some() {
            return Err(Doubtful);
        }
        let parts = cut(map, v, &self.signatures).ok_or(Doubtful)?;
        let mut brackets = Vec::new();
        for (n, part) in parts.iter().enumerate() {
            let p = self.compose::<f64>(map, cube, part).ok_or(Doubtful)?;
            let watched = self.done();
            let mut stage = Decided::F64;
            if watched {
                // Only the watch wants to see what comes after the root.
                brackets.clear();
            } else if !(self.goal.least == Decided::F64 && self.isolate(map, part, &p, &mut brackets)) {
                let p = self.compose::<Dd>(map, cube, part).ok_or(Doubtful)?;
                if !self.isolate(map, part, &p, &mut brackets) {
                    return Err(Doubtful);
                }
                stage = Decided::DoubleDouble;
            }
            if self.goal.watch {
                let (o, h) = (part.outer, part.outer.1 - part.outer.0);
                let stretch = Stretch {
                    b: p.coefficients(),
                    most: cube.most(self.c),
                    s0: map.t_ref + o.0,
                    s1: map.t_ref + o.1,
                    first: n == 0 && o.0 <= map.start.1,
                    last: n + 1 == parts.len() && o.1 >= map.end.0,
                    root: brackets.first().map(|b: &Bracket| (b.s.0 - o.0) / h),
                };
                self.watch.piece(&stretch, self.tiny);
            }
            self.out.decided = self.out.decided.max(stage);
            self.out.roots.extend(brackets.iter().map(|b| b.root(0.0, stage)));
            if self.enough().is_break() {
                return Ok(Break(()));
            }
        }
        Ok(Continue(()))
    }

    fn compose<R: Real>(&self, map: &RayMap, cube: &Cube, part: &Part) -> Option<Bernstein<R>> {
        compose::compose(map, cube.index, part, self.masks, &cube.data, self.c, cube.most(self.c))
    }

    /// The roots of a part in this arithmetic, if it can tell: all of them, each certainly inside, in narrow brackets.
    fn isolate<R: Real>(&mut self, map: &RayMap, part: &Part, p: &Bernstein<R>, out: &mut Vec<Bracket>) -> bool {
        let stay = Stay {
            outer: part.outer,
            inner: part.inner,
        };
        brackets(map.t_ref, stay, p, self.goal.first_only, &mut self.isolated, out)
    }

    /// Whether all that was asked for is found.
    fn done(&self) -> bool {
        self.goal.first_only && !self.out.roots.is_empty() && self.open.is_none()
    }

    fn enough(&self) -> Flow {
        pieces::enough(self.done(), &self.goal, &self.watch)
    }

    /// One cube in integers.
    fn exactly(&mut self, cube: &Cube) -> Flow {
        self.out.decided = Decided::Exact;
        for part in self.exact_parts(cube.index) {
            let after = self.done();
            if let Some(solved) = self.solve(cube, part) {
                self.note(&solved, after);
                if !after {
                    self.accept(&solved);
                }
            }
            if self.enough().is_break() {
                return Break(());
            }
        }
        Continue(())
    }

    fn exact_parts(&mut self, index: [usize; 3]) -> Vec<ExactPart> {
        let (cubes, masks) = (self.cubes, self.masks);
        let span = |ray: &ExactRay| ray.span(index, cubes).map(|span| parts(ray, index, span, masks));
        self.exact_ray().and_then(span).unwrap_or_default()
    }

    fn solve(&mut self, cube: &Cube, part: ExactPart) -> Option<Solved> {
        let (c, first_only, masks) = (self.c, self.goal.first_only, self.masks);
        let ray = self.exact_ray()?;
        #[expect(clippy::float_cmp, reason = "equality of data values is meant")]
        let constant = cube.least == c && cube.greatest == c;
        let ExactPart { span, kind } = part;
        Some(Solved::new(ray, span, first_only, |span| {
            if constant {
                Piece::zero(span)
            } else {
                piece(ray, cube.index, ExactPart { span, kind }, masks, &cube.data, c)
            }
        }))
    }

    /// Shows a piece to the watch; `after`: the first root has been found before.
    fn note(&mut self, solved: &Solved, after: bool) {
        if !self.goal.watch {
            return;
        }
        let root = if after { None } else { solved.first_tau() };
        let tiny = self.tiny;
        solved.show(&mut self.watch, root, |size| tiny.max(4.0 * f64::EPSILON * size));
    }

    /// Takes over the roots of a part, joining stretches.
    fn accept(&mut self, solved: &Solved) {
        let t0 = solved.piece.t0.bounds();
        match &solved.roots {
            Roots::Zero => {
                let end = if solved.point { &solved.piece.t0 } else { &solved.piece.t1 };
                if self.open.is_none() {
                    self.out.roots.push(told_stretch(t0, end.bounds().1));
                }
                self.open = Some(Open::Until(end.clone()));
            }
            Roots::Some(roots) => {
                let continued = self.open.is_some();
                self.close();
                // Where the stretch before ends is no root of its own.
                for r in roots.iter().filter(|r| !(r.at_start && continued)) {
                    let multiplicity = if r.at_start && !solved.begins {
                        self.on_face(&solved.piece)
                    } else {
                        Multiplicity::of(r.order)
                    };
                    self.out.roots.push(told(r, multiplicity, self.function, self.ray));
                }
            }
        }
    }

    /// The multiplicity of a root exactly at the start of a piece, from both sides.
    fn on_face(&mut self, after: &Piece) -> Multiplicity {
        let right = after.order_at_start().unwrap_or((1, 1));
        let (c, cubes, masks) = (self.c, self.cubes, self.masks);
        let t0 = &after.t0;
        let Some(index) = self.exact_ray().map(|r| r.cell_at(t0, cubes, true)) else {
            return Multiplicity::of(right.0);
        };
        let Some(part) = self.exact_parts(index).into_iter().find(|p| p.span.t1.compare(t0).is_eq()) else {
            return Multiplicity::of(right.0);
        };
        let cube = self.cube(index);
        let before = self
            .exact_ray()
            .map(|ray| piece(ray, index, part, masks, &cube.data, c))
            .and_then(|p| p.order_at_end());
        before.map_or(Multiplicity::of(right.0), |left| joined(left, right))
    }

    /// Ends an open stretch.
    fn close(&mut self) {
        let cubes = self.cubes;
        let end = match self.open.take() {
            None => return,
            Some(Open::Until(t)) => Some(t),
            Some(Open::Cube(index)) => self.exact_ray().and_then(|r| r.span(index, cubes)).map(|s| s.t1),
        };
        if let (Some(end), Some(root)) = (end, self.out.roots.last_mut()) {
            root.interval_end = Some(end.bounds().1);
        }
    }

    /// All cubes by integers alone.
    fn walk_exactly(&mut self) {
        self.out.decided = Decided::Exact;
        let cubes = self.cubes;
        if let Some((t, end)) = self.exact_ray().and_then(|r| r.stay.clone()) {
            self.tiny = 1e-12 * (end.bounds().1 - t.bounds().0);
            pieces::walk_exactly(self, cubes, t, self.goal.until);
        }
    }
}

impl Exactly for Run<'_> {
    fn exact_ray(&mut self) -> Option<&ExactRay> {
        if self.exact.is_none() {
            self.exact = self.goal.exact_ray(self.ray, self.function.domain(), true).map(Box::new);
        }
        self.exact.as_deref()
    }

    fn visit_exactly(&mut self, index: [usize; 3]) -> Flow {
        let cube = self.cube(index);
        if far(cube.least, cube.greatest, self.c) {
            Continue(())
        } else {
            self.exactly(&cube)
        }
    }
}
