//! Roots in tensor-product splines over a lattice.

use crate::{
    Decided, Multiplicity, Root,
    bracket::Bracket,
    compose::{self, Bernstein, Differences},
    exact::{ExactRay, Piece, Ratio, Roots, Span, lattice_piece},
    extremum::{Stretch, Watch, far},
    isolate::{Isolated, isolate},
    map::{Mapped, RayMap},
    oracle::{Goal, Search, Shared},
    real::{Dd, Real},
    skip::{BLOCK, Skip},
    walk::{Visit, Walk, steady},
};
use isobar_core::{Function, Lattice, Ray};
use std::ops::ControlFlow::{self, Break, Continue};

/// Finds what the goal asks for.
pub(crate) fn search(
    lattice: &dyn Lattice,
    function: &dyn Function,
    shared: &Shared,
    c: f64,
    ray: &Ray,
    goal: Goal<'_>,
) -> Search {
    let mut run = Run {
        lattice,
        function,
        shared,
        c,
        ray,
        goal,
        cells: lattice.cells(),
        exact: None,
        open: None,
        watch: Watch::default(),
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

/// One search.
struct Run<'a> {
    lattice: &'a dyn Lattice,
    function: &'a dyn Function,
    shared: &'a Shared,
    c: f64,
    ray: &'a Ray,
    goal: Goal<'a>,
    cells: [usize; 3],
    exact: Option<Box<ExactRay>>,
    /// The last cell of a stretch s = c that reaches its end: the last root.
    open: Option<[usize; 3]>,
    watch: Watch,
    out: Search,
    isolated: Vec<Isolated>,
}

/// A cell's coefficients.
struct Cell {
    index: [usize; 3],
    stencil: [f64; 64],
    least: f64,
    greatest: f64,
}

impl Run<'_> {
    fn cell(&self, index: [usize; 3]) -> Cell {
        let mut stencil = [0.0; 64];
        self.lattice.stencil(index, &mut stencil);
        let n = (self.lattice.basis().degree + 1).pow(3);
        let (mut least, mut greatest) = (stencil[0], stencil[0]);
        for &v in &stencil[1..n] {
            least = least.min(v);
            greatest = greatest.max(v);
        }
        Cell {
            index,
            stencil,
            least,
            greatest,
        }
    }

    /// Superblocks, blocks, cells; those that cannot come near the isovalue are passed by.
    fn walk(&mut self, map: &RayMap) {
        let shared = self.shared;
        let Some(skip) = &shared.skip else { return };
        let c = self.c;
        // Rounded upward: cells that begin later hold nothing that was asked for.
        let until = (self.goal.until - map.t_ref) + 1e-15 * (self.goal.until.abs() + map.t_ref);
        let cells = self.cells;
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
            let blocks = inner(map, v, BLOCK as f64, skip.blocks);
            blocks.run(v.outer.0, v.outer.1, |v| {
                let range = Skip::block(skip, v.index);
                if far(range.lo, range.hi, c) {
                    return Continue(());
                }
                inner(map, v, 1.0, cells).run(v.outer.0, v.outer.1, |v| self.visit(map, v, until))
            })
        });
    }

    /// One cell with f64, double-double, then integers.
    fn visit(&mut self, map: &RayMap, v: &Visit, until: f64) -> Flow {
        if v.outer.0 > until {
            return Break(());
        }
        let cell = self.cell(v.index);
        if far(cell.least, cell.greatest, self.c) {
            return Continue(());
        }
        #[expect(clippy::float_cmp, reason = "equality of data values is meant")]
        if self.open.is_some() && cell.least == self.c && cell.greatest == self.c && v.inner.0 < v.inner.1 {
            // A stretch goes on through a cell that the ray certainly visits.
            self.open = Some(v.index);
            return Continue(());
        }
        let p = self.compose::<f64>(map, v, &cell);
        if self.done() {
            // Only the watch wants to see what comes after the root.
            if let Some(p) = &p {
                self.note(map, v, p.coefficients(), &cell, None);
            }
            return self.enough();
        }
        let mut stage = Decided::Exact;
        let mut brackets = Vec::new();
        if self.goal.least == Decided::F64
            && let Some(p) = &p
            && self.isolate(map, v, p, &mut brackets)
        {
            stage = Decided::F64;
        } else if p.is_some()
            && let Some(p) = self.compose::<Dd>(map, v, &cell)
            && self.isolate(map, v, &p, &mut brackets)
        {
            stage = Decided::DoubleDouble;
        }
        self.out.decided = self.out.decided.max(stage);
        if stage == Decided::Exact {
            let roots = self.exact_roots(&cell);
            let first = roots.as_ref().and_then(Solved::first_tau);
            match (&p, &roots) {
                // The stay of stages 1 and 2 differs from the exact one by rounding; tau of the root is good enough for the flag.
                (Some(p), Some(_)) => self.note(map, v, p.coefficients(), &cell, first),
                (None, Some(solved)) => self.note_exact(solved),
                (_, None) => {}
            }
            return match &roots {
                None => Continue(()),
                Some(solved) => self.accept(&cell, solved),
            };
        }
        let first = brackets
            .first()
            .map(|b: &Bracket| (b.s.0 - v.outer.0) / (v.outer.1 - v.outer.0));
        if let Some(p) = &p {
            self.note(map, v, p.coefficients(), &cell, first);
        }
        // A root inside the cell is inside the stay.
        self.out.roots.extend(brackets.iter().map(|b| b.root(0.0, stage)));
        self.enough()
    }

    fn compose<R: Real>(&self, map: &RayMap, v: &Visit, cell: &Cell) -> Option<Bernstein<R>> {
        let degree = self.lattice.basis().degree;
        let differences = Differences::<R>::new(&cell.stencil, (degree + 1).pow(3), self.c);
        compose::lattice(map, v.index.map(|i| i as f64), v.outer, degree, &differences)
    }

    /// The roots of the cell in this arithmetic, if it can tell: all of them, each certainly inside the cell, in narrow brackets.
    fn isolate<R: Real>(&mut self, map: &RayMap, v: &Visit, p: &Bernstein<R>, out: &mut Vec<Bracket>) -> bool {
        out.clear();
        if isolate(p, self.goal.first_only, &mut self.isolated).is_err() {
            return false;
        }
        for root in &self.isolated {
            let b = Bracket::new(map.t_ref, v.outer, root);
            if !(b.s.0 >= v.inner.0 && b.s.1 <= v.inner.1 && b.narrow()) {
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

    /// Shows the piece to the watch. Nothing that comes after the first root counts.
    fn note(&mut self, map: &RayMap, v: &Visit, b: &[f64], cell: &Cell, first: Option<f64>) {
        if !self.goal.watch {
            return;
        }
        let most = (cell.greatest - self.c).abs().max((cell.least - self.c).abs());
        let scale = map.end.1 - map.start.0;
        let stretch = Stretch {
            b,
            most,
            s0: v.outer.0,
            s1: v.outer.1,
            first: v.outer.0 <= map.start.1,
            last: v.outer.1 >= map.end.0,
            root: first,
        };
        let before = self.watch.found.is_some();
        self.watch.piece(&stretch, 1e-12 * scale);
        if let (false, Some(s)) = (before, &mut self.watch.found) {
            *s += map.t_ref;
        }
    }

    /// The same for a piece known exactly only; the watch's parameter is t.
    fn note_exact(&mut self, solved: &Solved) {
        if !self.goal.watch {
            return;
        }
        let (b, most) = solved.piece.bernstein();
        let s0 = solved.piece.t0.bounds().0;
        let s1 = if solved.point { s0 } else { solved.piece.t1.bounds().1 };
        let first = solved.first_tau();
        self.watch.piece(
            &Stretch {
                b: &b,
                most,
                s0,
                s1,
                first: solved.begins,
                last: solved.point || solved.piece.closed,
                root: first,
            },
            1e-12 * (s1.abs() + s0.abs()),
        );
    }

    fn exact_ray(&mut self) -> Option<&ExactRay> {
        if self.exact.is_none() {
            let exact = self.goal.exact_ray(self.ray, self.function.domain(), self.shared.centred);
            self.exact = exact.map(Box::new);
        }
        self.exact.as_deref()
    }

    /// The cell's roots by integers; `None` where no t belongs to the cell.
    fn exact_roots(&mut self, cell: &Cell) -> Option<Solved> {
        let (cells, c, first_only) = (self.cells, self.c, self.goal.first_only);
        let basis = self.lattice.basis();
        let ray = self.exact_ray()?;
        let span = ray.span(cell.index, cells)?;
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
        #[expect(clippy::float_cmp, reason = "equality of data values is meant")]
        let constant = cell.least == c && cell.greatest == c;
        let piece = if constant {
            Piece::zero(span)
        } else {
            lattice_piece(ray, cell.index, span, basis, &cell.stencil, c)
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

    /// Takes over the roots of a cell, joining stretches.
    fn accept(&mut self, cell: &Cell, solved: &Solved) -> Flow {
        let open = self.open.take();
        let (t0, t1) = (solved.piece.t0.bounds(), solved.piece.t1.bounds());
        match &solved.roots {
            Roots::Zero => {
                if open.is_none() {
                    self.out.roots.push(Root {
                        lo: t0.0,
                        hi: t0.1,
                        multiplicity: Multiplicity::Interval,
                        interval_end: Some(if solved.point { t0.1 } else { t1.1 }),
                        slope: 0.0,
                        decided: Decided::Exact,
                    });
                }
                self.open = Some(cell.index);
            }
            Roots::Some(roots) => {
                self.open = open;
                self.close();
                for r in roots {
                    if r.at_start && open.is_some() {
                        // The end of the stretch before.
                        continue;
                    }
                    let multiplicity = if r.at_start && !solved.begins {
                        self.on_face(solved)
                    } else {
                        Multiplicity::of(r.order)
                    };
                    let at = self.ray.at(r.lo);
                    let slope = match multiplicity {
                        Multiplicity::Simple => self.function.gradient(at).dot(self.ray.direction),
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
        self.enough()
    }

    /// The multiplicity of a root exactly at the start of a piece, from both sides.
    fn on_face(&mut self, solved: &Solved) -> Multiplicity {
        let (cells, c) = (self.cells, self.c);
        let (right, sign_right) = solved.piece.order_at_start().unwrap_or((1, 1));
        let t0 = solved.piece.t0.clone();
        let Some(index) = self.exact_ray().map(|r| r.cell_at(&t0, cells, true)) else {
            return Multiplicity::of(right);
        };
        let before = self.cell(index);
        let basis = self.lattice.basis();
        let Some(ray) = self.exact_ray() else {
            return Multiplicity::of(right);
        };
        let Some(span) = ray.span(index, cells) else {
            return Multiplicity::of(right);
        };
        let piece = lattice_piece(ray, index, span, basis, &before.stencil, c);
        let Some((left, sign_left)) = piece.order_at_end() else {
            return Multiplicity::of(right);
        };
        let changes = sign_left != sign_right;
        let order = left.max(right);
        Multiplicity::of(if (order % 2 == 1) == changes { order } else { order + 1 })
    }

    /// Ends an open stretch: its last cell's exact end becomes the end of the root.
    fn close(&mut self) {
        let cells = self.cells;
        if let Some(index) = self.open.take()
            && let Some(end) = self.exact_ray().and_then(|r| r.span(index, cells)).map(|s| s.t1.bounds().1)
            && let Some(root) = self.out.roots.last_mut()
        {
            root.interval_end = Some(end);
        }
    }

    /// All cells by integers alone.
    fn walk_exactly(&mut self) {
        self.out.decided = Decided::Exact;
        let cells = self.cells;
        let until = Ratio::from_f64(self.goal.until.min(f64::MAX));
        let Some((mut t, _)) = self.exact_ray().and_then(|r| r.stay.clone()) else {
            return;
        };
        loop {
            if t.compare(&until).is_gt() {
                return;
            }
            let Some(ray) = self.exact_ray() else { return };
            let index = ray.cell_at(&t, cells, false);
            let Some(span) = ray.span(index, cells) else { return };
            let cell = self.cell(index);
            let flow = if far(cell.least, cell.greatest, self.c) {
                Continue(())
            } else {
                match self.exact_roots(&cell) {
                    None => Continue(()),
                    Some(solved) => {
                        self.note_exact(&solved);
                        self.accept(&cell, &solved)
                    }
                }
            };
            if flow.is_break() || span.closed {
                return;
            }
            t = span.t1;
        }
    }
}

/// A cell solved exactly.
struct Solved {
    piece: Piece,
    roots: Roots,
    /// Whether the ray's stay in the domain begins here.
    begins: bool,
    /// Whether the ray only touches the cell (and the domain) in one point.
    point: bool,
}

impl Solved {
    /// tau of the first root.
    fn first_tau(&self) -> Option<f64> {
        match &self.roots {
            Roots::Zero => Some(0.0),
            Roots::Some(r) => r.first().map(|r| r.tau),
        }
    }
}

/// The walk over what lies inside a box of the next coarser level.
pub(crate) fn inner<'a>(map: &'a RayMap, v: &Visit, stride: f64, count: [usize; 3]) -> Walk<'a> {
    let lo = v.index.map(|i| i * BLOCK);
    Walk {
        map,
        stride,
        lo,
        hi: std::array::from_fn(|a| (lo[a] + BLOCK - 1).min(count[a] - 1)),
    }
}
