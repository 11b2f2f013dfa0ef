//! Roots of one polynomial in world coordinates over a box.

use crate::{
    Decided, Multiplicity, Root,
    bracket::Bracket,
    compose::{self, MOST},
    exact::{Piece, Ratio, Roots, Span, algebraic_piece},
    extremum::{Stretch, Watch},
    isolate::isolate,
    map::{Mapped, RayMap},
    oracle::{Goal, Search, Shared},
    real::{Dd, Real},
};
use isobar_core::{Algebraic, Function, Ray};

/// Finds what the goal asks for.
pub(crate) fn search(p: &Algebraic, function: &dyn Function, shared: &Shared, c: f64, ray: &Ray, goal: Goal<'_>) -> Search {
    let mut run = Run {
        p,
        function,
        c,
        ray,
        goal,
        watch: Watch::default(),
        out: Search::new(Decided::F64),
    };
    let mapped = match (&shared.local, goal.least) {
        (_, Decided::Exact) | (None, _) => Mapped::Unclear,
        (Some(local), _) => goal.keep(local.map(ray)),
    };
    match mapped {
        Mapped::Outside => {}
        Mapped::Ray(map) if floats_can(p) && run.parts(&map) => {}
        Mapped::Ray(_) | Mapped::Unclear => run.exactly(),
    }
    if goal.watch {
        run.out.near = run.watch.found;
    }
    run.out
}

/// Whether stages 1 and 2 have room for the exponents.
fn floats_can(p: &Algebraic) -> bool {
    p.degree() <= MOST && p.terms.iter().all(|(e, _)| e.iter().all(|&e| e <= 15))
}

struct Run<'a> {
    p: &'a Algebraic,
    function: &'a dyn Function,
    c: f64,
    ray: &'a Ray,
    goal: Goal<'a>,
    watch: Watch,
    out: Search,
}

/// Why parts could not be solved in floating point.
struct Doubtful;

impl Run<'_> {
    /// Cuts the stay into parts (at places no symmetry singles out, since a root at a cut costs a stage) and solves them in order. `false`:
    /// integers must decide, what was found so far is dropped.
    fn parts(&mut self, map: &RayMap) -> bool {
        let (s0, s1) = (map.start.0, map.end.1);
        let count = match self.p.degree() {
            0..=2 => 1,
            3..=4 => 2,
            5..=8 => 4,
            _ => 8,
        };
        let cut = |i: usize| match i {
            0 => s0,
            i if i == count => s1,
            i => s0 + (s1 - s0) * ((i as f64 - 0.0713) / count as f64),
        };
        for i in 0..count {
            let (a, b) = (cut(i), cut(i + 1));
            if map.t_ref + a > self.goal.until || a > b {
                continue;
            }
            let (first, last) = (i == 0, i + 1 == count);
            if self.part(map, (a, b), first, last).is_err() {
                self.out = Search::new(Decided::F64);
                self.watch = Watch::default();
                return false;
            }
            if self.goal.first_only && !self.out.roots.is_empty() && !self.watch.wants_more() {
                break;
            }
        }
        true
    }

    fn part(&mut self, map: &RayMap, range: (f64, f64), first: bool, last: bool) -> Result<(), Doubtful> {
        if self.goal.least == Decided::F64
            && let Ok(()) = self.part_in::<f64>(map, range, first, last, Decided::F64)
        {
            return Ok(());
        }
        self.part_in::<Dd>(map, range, first, last, Decided::DoubleDouble)
    }

    fn part_in<R: Real>(
        &mut self,
        map: &RayMap,
        (a, b): (f64, f64),
        first: bool,
        last: bool,
        stage: Decided,
    ) -> Result<(), Doubtful> {
        let p = compose::algebraic::<R>(map, self.ray, self.p, self.c, (a, b)).ok_or(Doubtful)?;
        let mut isolated = Vec::new();
        isolate(&p, self.goal.first_only, &mut isolated).map_err(|_| Doubtful)?;
        let mut brackets = Vec::with_capacity(isolated.len());
        for root in &isolated {
            let bracket = Bracket::new(map.t_ref, (a, b), root);
            let inside = bracket.s.0 >= map.start.1 && bracket.s.1 <= map.end.0;
            if !(inside && bracket.narrow()) {
                return Err(Doubtful);
            }
            brackets.push(bracket);
        }
        self.out.decided = self.out.decided.max(stage);
        if self.goal.watch {
            let b64: Vec<f64> = p.coefficients().iter().map(|x| x.f64()).collect();
            let most = b64.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
            self.watch.piece(
                &Stretch {
                    b: &b64,
                    most,
                    s0: map.t_ref + a,
                    s1: map.t_ref + b,
                    first,
                    last,
                    root: isolated.first().map(|r| r.lo),
                },
                0.0,
            );
        }
        self.out.roots.extend(brackets.iter().map(|b| b.root(0.0, stage)));
        Ok(())
    }

    fn exactly(&mut self) {
        self.out.decided = Decided::Exact;
        let exact = self.goal.exact_ray(self.ray, self.function.domain(), false);
        let Some((t0, t1)) = exact.and_then(|r| r.stay) else {
            return;
        };
        let point = t0.compare(&t1).is_eq();
        let t1 = if point { Ratio::new(&t0.n + &t0.d, t0.d.clone()) } else { t1 };
        let mut piece = algebraic_piece(self.ray, self.p, self.c, Span { t0, t1, closed: !point });
        piece.closed = !point;
        let roots = piece.roots(self.goal.first_only);
        self.note(&piece, &roots, point);
        let found = match roots {
            Roots::Zero => {
                let (lo, hi) = piece.t0.bounds();
                vec![Root {
                    lo,
                    hi,
                    multiplicity: Multiplicity::Interval,
                    interval_end: Some(if point { hi } else { piece.t1.bounds().1 }),
                    slope: 0.0,
                    decided: Decided::Exact,
                }]
            }
            Roots::Some(r) => r
                .iter()
                .filter(|r| !point || r.at_start)
                .map(|r| Root {
                    lo: r.lo,
                    hi: r.hi,
                    multiplicity: Multiplicity::of(r.order),
                    interval_end: None,
                    slope: match r.order {
                        1 => self.function.gradient(self.ray.at(r.lo)).dot(self.ray.direction),
                        _ => 0.0,
                    },
                    decided: Decided::Exact,
                })
                .collect(),
        };
        self.out.roots = found;
    }

    fn note(&mut self, piece: &Piece, roots: &Roots, point: bool) {
        if !self.goal.watch {
            return;
        }
        let (b, most) = piece.bernstein();
        let first = match roots {
            Roots::Zero => Some(0.0),
            Roots::Some(r) => r.first().map(|r| r.tau),
        };
        let s0 = piece.t0.bounds().0;
        self.watch.piece(
            &Stretch {
                b: &b,
                most,
                s0,
                s1: if point { s0 } else { piece.t1.bounds().1 },
                first: true,
                last: true,
                root: first,
            },
            0.0,
        );
    }
}
