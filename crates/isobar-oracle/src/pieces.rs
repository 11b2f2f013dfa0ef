//! What the searches in cells of a lattice and in tetrahedra of its cubes share: the walk over blocks, pieces solved in integers, what becomes of their roots.

use crate::{
    Decided, Multiplicity, Root,
    bracket::Bracket,
    compose::Bernstein,
    exact::{ExactRay, ExactRoot, Piece, Ratio, Roots, Span},
    extremum::{Stretch, Watch},
    isolate::{Isolated, isolate},
    map::{Mapped, RayMap},
    oracle::{Goal, Search, Shared},
    real::Real,
    skip::{BLOCK, Skip},
    walk::{Visit, Walk},
};
use isobar_core::{Function, Ray};
use std::ops::ControlFlow::{self, Break, Continue};

/// Stop the walk, or go on.
pub(crate) type Flow = ControlFlow<()>;

/// The ray in index space, as far as floating point can tell and is wanted to.
pub(crate) fn mapped(shared: &Shared, goal: &Goal<'_>, ray: &Ray) -> Mapped {
    match (&shared.local, goal.least) {
        (_, Decided::Exact) | (None, _) => Mapped::Unclear,
        (Some(local), _) => goal.keep(local.map(ray)),
    }
}

/// What was found, with what the watch saw.
pub(crate) fn finished(mut out: Search, mut watch: Watch, goal: &Goal<'_>) -> Search {
    if goal.watch {
        if out.roots.is_empty() {
            watch.finish();
        }
        out.near = watch.found;
    }
    out
}

/// Whether to go on; `done`: all roots that were asked for are found.
pub(crate) fn enough(done: bool, goal: &Goal<'_>, watch: &Watch) -> Flow {
    if done && !(goal.watch && watch.wants_more()) {
        Break(())
    } else {
        Continue(())
    }
}

/// The walk over what lies inside a box of the next coarser level.
fn inner<'a>(map: &'a RayMap, v: &Visit, stride: f64, count: [usize; 3]) -> Walk<'a> {
    let lo = v.index.map(|i| i * BLOCK);
    Walk {
        map,
        stride,
        lo,
        hi: std::array::from_fn(|a| (lo[a] + BLOCK - 1).min(count[a] - 1)),
    }
}

/// Shows the `count` cells per axis front to back, up to those that begin after `until`. Superblocks and blocks whose least and greatest datum are `idle` are passed by. Gives what the
/// visitor broke with.
pub(crate) fn walk<S, B>(
    map: &RayMap,
    skip: &Skip,
    count: [usize; 3],
    until: f64,
    state: &mut S,
    idle: impl Fn(&S, f64, f64) -> bool,
    mut visit: impl FnMut(&mut S, &Visit) -> ControlFlow<B>,
) -> Option<B> {
    let all = Walk {
        map,
        stride: (BLOCK * BLOCK) as f64,
        lo: [0; 3],
        hi: skip.supers.map(|n| n - 1),
    };
    let flow = all.run(map.start.0, map.end.1, |v| {
        if v.outer.0 > until {
            return Break(None);
        }
        let range = skip.superblock(v.index);
        if idle(state, range.lo, range.hi) {
            return Continue(());
        }
        inner(map, v, BLOCK as f64, skip.blocks).run(v.outer.0, v.outer.1, |v| {
            let range = skip.block(v.index);
            if idle(state, range.lo, range.hi) {
                return Continue(());
            }
            inner(map, v, 1.0, count).run(v.outer.0, v.outer.1, |v| match visit(state, v) {
                Continue(()) => Continue(()),
                Break(b) => Break(Some(b)),
            })
        })
    });
    flow.break_value().flatten()
}

/// Where a piece of the ray may be and where it certainly is.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stay {
    pub(crate) outer: (f64, f64),
    pub(crate) inner: (f64, f64),
}

/// The roots of a piece in this arithmetic, if it can tell: all of them, each certainly inside, in narrow brackets.
pub(crate) fn brackets<R: Real>(
    t_ref: f64,
    stay: Stay,
    p: &Bernstein<R>,
    first_only: bool,
    isolated: &mut Vec<Isolated>,
    out: &mut Vec<Bracket>,
) -> bool {
    out.clear();
    if isolate(p, first_only, isolated).is_err() {
        return false;
    }
    for root in isolated.iter() {
        let b = Bracket::new(t_ref, stay.outer, root);
        if !(b.s.0 >= stay.inner.0 && b.s.1 <= stay.inner.1 && b.narrow()) {
            return false;
        }
        out.push(b);
    }
    true
}

/// A search that can go on in integers alone.
pub(crate) trait Exactly {
    fn exact_ray(&mut self) -> Option<&ExactRay>;
    /// One cell that the ray visits.
    fn visit_exactly(&mut self, index: [usize; 3]) -> Flow;
}

/// All of `count` cells per axis by integers alone, from `t` up to `until`.
pub(crate) fn walk_exactly(run: &mut impl Exactly, count: [usize; 3], mut t: Ratio, until: f64) {
    let until = Ratio::from_f64(until.min(f64::MAX));
    loop {
        if t.compare(&until).is_gt() {
            return;
        }
        let Some(ray) = run.exact_ray() else { return };
        let index = ray.cell_at(&t, count, false);
        let Some(span) = ray.span(index, count) else { return };
        let flow = run.visit_exactly(index);
        if flow.is_break() || span.closed {
            return;
        }
        t = span.t1;
    }
}

/// A piece solved exactly.
pub(crate) struct Solved {
    pub(crate) piece: Piece,
    pub(crate) roots: Roots,
    /// Whether the ray's stay in the domain begins here.
    pub(crate) begins: bool,
    /// Whether the ray only touches the piece (and the domain) in one point.
    pub(crate) point: bool,
}

impl Solved {
    /// The roots of the polynomial over a span.
    pub(crate) fn new(ray: &ExactRay, span: Span, first_only: bool, piece: impl FnOnce(Span) -> Piece) -> Self {
        let begins = ray.stay.as_ref().is_some_and(|s| span.t0.compare(&s.0).is_eq());
        let point = span.t0.compare(&span.t1).is_eq();
        // A single point: the polynomial beyond it tells the order of a root there.
        let span = if point {
            let t1 = Ratio::new(&span.t1.n + &span.t1.d, span.t1.d.clone());
            Span {
                t1,
                closed: false,
                ..span
            }
        } else {
            span
        };
        let piece = piece(span);
        let mut roots = piece.roots(first_only);
        if point && let Roots::Some(r) = &mut roots {
            r.retain(|r| r.at_start);
        }
        Self {
            piece,
            roots,
            begins,
            point,
        }
    }

    /// tau of the first root.
    pub(crate) fn first_tau(&self) -> Option<f64> {
        match &self.roots {
            Roots::Zero => Some(0.0),
            Roots::Some(r) => r.first().map(|r| r.tau),
        }
    }

    /// Shows the piece to a watch whose parameter is t. `root`: tau of its first root, where that counts; `tiny`, from |t| at both ends: what is rounding.
    pub(crate) fn show(&self, watch: &mut Watch, root: Option<f64>, tiny: impl FnOnce(f64) -> f64) {
        let (b, most) = self.piece.bernstein();
        let s0 = self.piece.t0.bounds().0;
        let s1 = if self.point { s0 } else { self.piece.t1.bounds().1 };
        let stretch = Stretch {
            b: &b,
            most,
            s0,
            s1,
            first: self.begins,
            last: self.point || self.piece.closed,
            root,
        };
        watch.piece(&stretch, tiny(s0.abs() + s1.abs()));
    }
}

/// A root of a piece as it is told.
pub(crate) fn told(r: &ExactRoot, multiplicity: Multiplicity, function: &dyn Function, ray: &Ray) -> Root {
    Root {
        lo: r.lo,
        hi: r.hi,
        multiplicity,
        interval_end: None,
        slope: match multiplicity {
            Multiplicity::Simple => function.gradient(ray.at(r.lo)).dot(ray.direction),
            _ => 0.0,
        },
        decided: Decided::Exact,
    }
}

/// A stretch s = c that begins within `start` and, for now, ends at `end`.
pub(crate) fn told_stretch(start: (f64, f64), end: f64) -> Root {
    Root {
        lo: start.0,
        hi: start.1,
        multiplicity: Multiplicity::Interval,
        interval_end: Some(end),
        slope: 0.0,
        decided: Decided::Exact,
    }
}

/// The multiplicity of a root between two pieces, from its order and the sign beside it in each.
pub(crate) fn joined((left, sign_left): (u32, i32), (right, sign_right): (u32, i32)) -> Multiplicity {
    let changes = sign_left != sign_right;
    let order = left.max(right);
    Multiplicity::of(if (order % 2 == 1) == changes { order } else { order + 1 })
}
