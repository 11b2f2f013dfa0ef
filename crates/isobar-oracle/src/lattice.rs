//! Roots in tensor-product splines over a lattice.

use crate::{
    Decided, Multiplicity,
    bracket::Bracket,
    compose::{self, Bernstein, Differences},
    exact::{ExactRay, Piece, Roots, lattice_piece},
    extremum::{Stretch, Watch, far},
    isolate::Isolated,
    map::{Mapped, RayMap},
    oracle::{Goal, Search, Shared},
    pieces::{self, Exactly, Flow, Solved, Stay, brackets, finished, joined, mapped, told, told_stretch},
    real::{Dd, Real},
    walk::{Visit, steady},
};
use isobar_core::{Function, Lattice, Ray};
use std::ops::ControlFlow::{Break, Continue};

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
    match mapped(shared, &goal, ray) {
        Mapped::Outside => {}
        Mapped::Ray(map) if steady(&map) => run.walk(&map),
        Mapped::Ray(_) | Mapped::Unclear => run.walk_exactly(),
    }
    run.close();
    finished(run.out, run.watch, &goal)
}

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
        let idle = |_: &Self, lo, hi| far(lo, hi, c);
        pieces::walk(map, skip, self.cells, until, self, idle, |run, v| run.visit(map, v, until));
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
        let stay = Stay {
            outer: v.outer,
            inner: v.inner,
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
        solved.show(&mut self.watch, solved.first_tau(), |size| 1e-12 * size);
    }

    /// The cell's roots by integers; `None` where no t belongs to the cell.
    fn exact_roots(&mut self, cell: &Cell) -> Option<Solved> {
        let (cells, c, first_only) = (self.cells, self.c, self.goal.first_only);
        let basis = self.lattice.basis();
        let ray = self.exact_ray()?;
        let span = ray.span(cell.index, cells)?;
        #[expect(clippy::float_cmp, reason = "equality of data values is meant")]
        let constant = cell.least == c && cell.greatest == c;
        Some(Solved::new(ray, span, first_only, |span| {
            if constant {
                Piece::zero(span)
            } else {
                lattice_piece(ray, cell.index, span, basis, &cell.stencil, c)
            }
        }))
    }

    /// Takes over the roots of a cell, joining stretches.
    fn accept(&mut self, cell: &Cell, solved: &Solved) -> Flow {
        let open = self.open.take();
        let (t0, t1) = (solved.piece.t0.bounds(), solved.piece.t1.bounds());
        match &solved.roots {
            Roots::Zero => {
                if open.is_none() {
                    let end = if solved.point { t0.1 } else { t1.1 };
                    self.out.roots.push(told_stretch(t0, end));
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
                    self.out.roots.push(told(r, multiplicity, self.function, self.ray));
                }
            }
        }
        self.enough()
    }

    /// The multiplicity of a root exactly at the start of a piece, from both sides.
    fn on_face(&mut self, solved: &Solved) -> Multiplicity {
        let (cells, c) = (self.cells, self.c);
        let right = solved.piece.order_at_start().unwrap_or((1, 1));
        let t0 = solved.piece.t0.clone();
        let Some(index) = self.exact_ray().map(|r| r.cell_at(&t0, cells, true)) else {
            return Multiplicity::of(right.0);
        };
        let before = self.cell(index);
        let basis = self.lattice.basis();
        let Some(ray) = self.exact_ray() else {
            return Multiplicity::of(right.0);
        };
        let Some(span) = ray.span(index, cells) else {
            return Multiplicity::of(right.0);
        };
        let piece = lattice_piece(ray, index, span, basis, &before.stencil, c);
        piece
            .order_at_end()
            .map_or(Multiplicity::of(right.0), |left| joined(left, right))
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
        if let Some((t, _)) = self.exact_ray().and_then(|r| r.stay.clone()) {
            pieces::walk_exactly(self, cells, t, self.goal.until);
        }
    }
}

impl Exactly for Run<'_> {
    fn exact_ray(&mut self) -> Option<&ExactRay> {
        if self.exact.is_none() {
            let exact = self.goal.exact_ray(self.ray, self.function.domain(), self.shared.centred);
            self.exact = exact.map(Box::new);
        }
        self.exact.as_deref()
    }

    fn visit_exactly(&mut self, index: [usize; 3]) -> Flow {
        let cell = self.cell(index);
        if far(cell.least, cell.greatest, self.c) {
            return Continue(());
        }
        match self.exact_roots(&cell) {
            None => Continue(()),
            Some(solved) => {
                self.note_exact(&solved);
                self.accept(&cell, &solved)
            }
        }
    }
}
