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
    Decided, Multiplicity, Root,
    bracket::Bracket,
    compose::Bernstein,
    exact::{ExactRay, Piece, Ratio, Roots, Span},
    extremum::{Stretch, Watch, far},
    isolate::{Isolated, isolate},
    lattice::inner,
    map::{Mapped, RayMap},
    oracle::{Goal, Search, Shared},
    real::{Dd, Real},
    skip::{BLOCK, Skip},
    walk::{Visit, Walk, steady},
};
use compose::{Part, cut, signatures};
use exact::{ExactPart, parts, piece};
use isobar_core::{Function, Ray, TetMasks, Tetrahedral};
use std::ops::ControlFlow::{self, Break, Continue};

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
    let mapped = match (&shared.local, goal.least) {
        (_, Decided::Exact) | (None, _) => Mapped::Unclear,
        (Some(local), _) => goal.keep(local.map(ray)),
    };
    match mapped {
        Mapped::Outside => {}
        Mapped::Ray(map) if steady(&map) => run.walk(&map),
        Mapped::Ray(_) | Mapped::Unclear => run.walk_exactly(),
    }
    run.close();
    if goal.watch {
        if run.out.roots.is_empty() {
            run.watch.finish();
        }
        run.out.near = run.watch.found;
    }
    run.out
}

/// Stop the walk, or go on.
type Flow = ControlFlow<()>;

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
        let all = Walk {
            map,
            stride: (BLOCK * BLOCK) as f64,
            lo: [0; 3],
            hi: skip.supers.map(|n| n - 1),
        };
        let _ = all.run(map.start.0, map.end.1, |v| {
            if v.outer.0 > until {
                return Break(());
            }
            let range = skip.superblock(v.index);
            if far(range.lo, range.hi, c) {
                return Continue(());
            }
            inner(map, v, BLOCK as f64, skip.blocks).run(v.outer.0, v.outer.1, |v| {
                let range = Skip::block(skip, v.index);
                if far(range.lo, range.hi, c) {
                    return Continue(());
                }
                inner(map, v, 1.0, self.cubes).run(v.outer.0, v.outer.1, |v| self.visit(map, v, until))
            })
        });
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
        out.clear();
        if isolate(p, self.goal.first_only, &mut self.isolated).is_err() {
            return false;
        }
        for root in &self.isolated {
            let b = Bracket::new(map.t_ref, part.outer, root);
            if !(b.s.0 >= part.inner.0 && b.s.1 <= part.inner.1 && b.narrow()) {
                return false;
            }
            out.push(b);
        }
        true
    }

    /// Whether all that was asked for is found.
    fn done(&self) -> bool {
        self.goal.first_only && !self.out.roots.is_empty() && self.open.is_none()
    }

    fn enough(&self) -> Flow {
        if self.done() && !(self.goal.watch && self.watch.wants_more()) {
            Break(())
        } else {
            Continue(())
        }
    }

    fn exact_ray(&mut self) -> Option<&ExactRay> {
        if self.exact.is_none() {
            self.exact = self.goal.exact_ray(self.ray, self.function.domain(), true).map(Box::new);
        }
        self.exact.as_deref()
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
        let begins = ray.stay.as_ref().is_some_and(|s| part.span.t0.compare(&s.0).is_eq());
        let point = part.span.t0.compare(&part.span.t1).is_eq();
        let part = if point {
            // The polynomial beyond a single point tells the order of a root there.
            let t = &part.span.t1;
            let t1 = Ratio::new(&t.n + &t.d, t.d.clone());
            let span = Span {
                t0: part.span.t0,
                t1,
                closed: false,
            };
            ExactPart { span, ..part }
        } else {
            part
        };
        #[expect(clippy::float_cmp, reason = "equality of data values is meant")]
        let constant = cube.least == c && cube.greatest == c;
        let piece = if constant {
            Piece::zero(part.span)
        } else {
            piece(ray, cube.index, part, masks, &cube.data, c)
        };
        let mut roots = piece.roots(first_only);
        if point && let Roots::Some(r) = &mut roots {
            r.retain(|r| r.at_start);
        }
        Some(Solved {
            piece,
            roots,
            begins,
            point,
        })
    }

    /// Shows a piece to the watch; `after`: the first root has been found before.
    fn note(&mut self, solved: &Solved, after: bool) {
        if !self.goal.watch {
            return;
        }
        let (b, most) = solved.piece.bernstein();
        let s0 = solved.piece.t0.bounds().0;
        let s1 = if solved.point { s0 } else { solved.piece.t1.bounds().1 };
        let root = match &solved.roots {
            _ if after => None,
            Roots::Zero => Some(0.0),
            Roots::Some(r) => r.first().map(|r| r.tau),
        };
        let stretch = Stretch {
            b: &b,
            most,
            s0,
            s1,
            first: solved.begins,
            last: solved.point || solved.piece.closed,
            root,
        };
        let tiny = self.tiny.max(4.0 * f64::EPSILON * (s0.abs() + s1.abs()));
        self.watch.piece(&stretch, tiny);
    }

    /// Takes over the roots of a part, joining stretches.
    fn accept(&mut self, solved: &Solved) {
        let t0 = solved.piece.t0.bounds();
        match &solved.roots {
            Roots::Zero => {
                let end = if solved.point { &solved.piece.t0 } else { &solved.piece.t1 };
                if self.open.is_none() {
                    self.out.roots.push(Root {
                        lo: t0.0,
                        hi: t0.1,
                        multiplicity: Multiplicity::Interval,
                        interval_end: Some(end.bounds().1),
                        slope: 0.0,
                        decided: Decided::Exact,
                    });
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
                    let slope = match multiplicity {
                        Multiplicity::Simple => self.function.gradient(self.ray.at(r.lo)).dot(self.ray.direction),
                        _ => 0.0,
                    };
                    self.out.roots.push(Root {
                        lo: r.lo,
                        hi: r.hi,
                        multiplicity,
                        interval_end: None,
                        slope,
                        decided: Decided::Exact,
                    });
                }
            }
        }
    }

    /// The multiplicity of a root exactly at the start of a piece, from both sides.
    fn on_face(&mut self, after: &Piece) -> Multiplicity {
        let (right, sign_right) = after.order_at_start().unwrap_or((1, 1));
        let (c, cubes, masks) = (self.c, self.cubes, self.masks);
        let t0 = &after.t0;
        let Some(index) = self.exact_ray().map(|r| r.cell_at(t0, cubes, true)) else {
            return Multiplicity::of(right);
        };
        let Some(part) = self.exact_parts(index).into_iter().find(|p| p.span.t1.compare(t0).is_eq()) else {
            return Multiplicity::of(right);
        };
        let cube = self.cube(index);
        let before = self
            .exact_ray()
            .map(|ray| piece(ray, index, part, masks, &cube.data, c))
            .and_then(|p| p.order_at_end());
        let Some((left, sign_left)) = before else {
            return Multiplicity::of(right);
        };
        let changes = sign_left != sign_right;
        let order = left.max(right);
        Multiplicity::of(if (order % 2 == 1) == changes { order } else { order + 1 })
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
        let until = Ratio::from_f64(self.goal.until.min(f64::MAX));
        let Some((mut t, end)) = self.exact_ray().and_then(|r| r.stay.clone()) else {
            return;
        };
        self.tiny = 1e-12 * (end.bounds().1 - t.bounds().0);
        loop {
            if t.compare(&until).is_gt() {
                return;
            }
            let Some(ray) = self.exact_ray() else { return };
            let index = ray.cell_at(&t, cubes, false);
            let Some(span) = ray.span(index, cubes) else { return };
            let cube = self.cube(index);
            let flow = if far(cube.least, cube.greatest, self.c) {
                Continue(())
            } else {
                self.exactly(&cube)
            };
            if flow.is_break() || span.closed {
                return;
            }
            t = span.t1;
        }
    }
}

/// A part solved exactly.
struct Solved {
    piece: Piece,
    roots: Roots,
    /// Whether the ray's stay in the domain begins here.
    begins: bool,
    /// Whether the ray only touches the domain in one point.
    point: bool,
}
