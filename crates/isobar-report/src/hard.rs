//! The matrix of hard cases: polynomials through every root finder, grids and surfaces through every method.
//!
//! A root finder may say that it cannot tell a root from a near miss: that is no answer, neither right nor wrong, and stands as refused with
//! its words. What a method's hit must keep is said by [`Bar`]: the case's own tolerance, and no refuted claim, for methods that prove their answers; for
//! rulers what their step allows. A proving method that hits where it claims nothing and s - c is zero to the rounding of f64 has not told a root from a near miss, and
//! is as honest as a root finder that says so.

use crate::cases::{self, Basis, Case, CaseRoot, Problem};
use crate::results::{Elsewhere, Matrix, MatrixRow, MatrixTable, Verdict, VerdictKind};
use anyhow::{Context, Result};
use isobar_core::Method;
use isobar_oracle::univariate;
use isobar_poly::{First, NamedSolver, RootKind};
use rayon::prelude::*;
use std::path::Path;

mod bar;
mod random;
mod rays;

pub use bar::Bar;

/// Runs all cases below `folder`.
///
/// # Errors
/// When a case file cannot be read or holds a case that makes no sense.
pub fn run(folder: &Path, methods: &[&'static dyn Method]) -> Result<Matrix> {
    let all = cases::read_all(folder)?;
    let solvers = [isobar_poly::solvers(), isobar_octree::finders::solvers()].concat();
    let oracle = || std::iter::once("oracle".to_owned());
    let mut polynomials = MatrixTable {
        title: "Polynomials, by root finder".into(),
        columns: oracle().chain(solvers.iter().map(|s| s.name.to_owned())).collect(),
        ..MatrixTable::default()
    };
    let columns: Vec<String> = oracle().chain(methods.iter().map(|m| m.info().id.to_owned())).collect();
    let bars: Vec<String> = std::iter::once("the case's tolerance".to_owned())
        .chain(methods.iter().map(|m| Bar::of(*m).words))
        .collect();
    let table = |title: &str| MatrixTable {
        title: title.into(),
        columns: columns.clone(),
        bars: bars.clone(),
        rows: Vec::new(),
    };
    let mut grids = table("Grids, by method");
    let mut surfaces = table("Surfaces sampled on grids, by method");
    let mut elsewhere = Vec::new();
    // Most cases keep one core busy.
    let found: Vec<Result<Vec<MatrixRow>>> = (all.par_iter())
        .map(|c| {
            let rows = match &c.problem {
                Problem::Polynomial { .. } => polynomial(c, &solvers).map(|r| vec![r]),
                Problem::Grid { .. } => rays::grid(c, methods),
                Problem::Field { .. } => rays::field(c, methods).map(|r| vec![r]),
                Problem::RandomRays { .. } => random::row_of(c, methods).map(|r| vec![r]),
                Problem::Elsewhere { .. } => Ok(Vec::new()),
            };
            rows.with_context(|| format!("case {}", c.id))
        })
        .collect();
    for (c, rows) in all.iter().zip(found) {
        let table = match &c.problem {
            Problem::Polynomial { .. } => &mut polynomials,
            Problem::Grid { .. } => &mut grids,
            _ => &mut surfaces,
        };
        table.rows.extend(rows?);
        if let Problem::Elsewhere { why, tests } = &c.problem {
            elsewhere.push(Elsewhere {
                id: c.id.clone(),
                title: c.title.clone(),
                trap: c.trap.clone(),
                source: c.source.clone(),
                why: why.clone(),
                tests: tests.clone(),
            });
        }
    }
    Ok(Matrix {
        tables: vec![polynomials, grids, surfaces],
        elsewhere,
    })
}

fn row(c: &Case, id: String, expected: String, cells: Vec<Verdict>) -> MatrixRow {
    MatrixRow {
        id,
        title: c.title.clone(),
        trap: c.trap.clone(),
        source: c.source.clone(),
        expected,
        cells,
    }
}

fn verdict(kind: VerdictKind, given: String) -> Verdict {
    Verdict {
        kind,
        given,
        ..Verdict::default()
    }
}

/// Turns a verdict into a known failure where the case declares one for the column, and flags a declaration that no longer holds.
fn declared(c: &Case, column: &str, v: Verdict) -> Verdict {
    let Some(known) = c.known.iter().find(|k| k.method.iter().any(|m| matches(m, column))) else {
        return v;
    };
    match v.kind {
        VerdictKind::Wrong => Verdict {
            kind: VerdictKind::Known,
            given: format!("{}: {}", v.given, known.reason),
            ..v
        },
        VerdictKind::Right => Verdict {
            kind: VerdictKind::Unexpected,
            ..v
        },
        _ => v,
    }
}

/// Whether a pattern, an id or the beginning of one followed by `*`, names a column.
#[must_use]
pub fn matches(pattern: &str, column: &str) -> bool {
    pattern.strip_suffix('*').map_or(pattern == column, |p| column.starts_with(p))
}

/// A position with as many digits as tell it apart.
fn short(t: f64) -> String {
    let s = format!("{t:.9}");
    let s = s.trim_end_matches('0').trim_end_matches('.');
    if s.is_empty() || s == "-0" { "0".into() } else { s.into() }
}

fn list(roots: &[CaseRoot]) -> String {
    if roots.is_empty() {
        return "no root".into();
    }
    let one = |r: &CaseRoot| {
        if r.m > 1 {
            format!("{} (×{})", short(r.t), r.m)
        } else {
            short(r.t)
        }
    };
    roots.iter().map(one).collect::<Vec<_>>().join(", ")
}

fn polynomial(c: &Case, solvers: &[NamedSolver]) -> Result<MatrixRow> {
    let Problem::Polynomial {
        basis,
        coefficients,
        isovalue,
        domain,
        roots,
        everywhere,
    } = &c.problem
    else {
        anyhow::bail!("is no polynomial");
    };
    let unit = [cases::Number::ZERO, cases::Number { n: 1, d: 1 }];
    let domain = domain.unwrap_or(unit);
    let exact = cases::bernstein(*basis, coefficients, *isovalue, domain)?;
    let b: Vec<f64> = exact.iter().map(|x| x.value()).collect();
    let (lo, width) = (domain[0].value(), domain[1].value() - domain[0].value());
    let question = Question {
        roots,
        everywhere: *everywhere,
        tolerance: c.tolerance,
        lo,
        width,
    };
    let expected = if *everywhere {
        "zero everywhere".to_owned()
    } else {
        list(roots)
    };
    let coefficients: Option<Vec<_>> = exact.iter().map(|x| univariate::Coefficient::new(x.n, x.d)).collect();
    let certified = coefficients.and_then(|k| univariate::roots(univariate::Form::Bernstein, &k, 0.0, 1.0));
    let mut cells = vec![declared(c, "oracle", oracle_on_polynomial(&question, certified.as_ref()))];
    cells.extend(solvers.iter().map(|s| declared(c, s.name, question.judge(s, &b))));
    let form = match basis {
        Basis::Power => "power form",
        Basis::Bernstein => "Bernstein form",
    };
    let expected = format!("{expected}; degree {}, {form}", b.len() - 1);
    Ok(row(c, c.id.clone(), expected, cells))
}

fn oracle_on_polynomial(q: &Question<'_>, all: Option<&isobar_oracle::AllRoots>) -> Verdict {
    let Some(all) = all else {
        return verdict(VerdictKind::Refused, "not a polynomial it takes".into());
    };
    let interval = all.roots.len() == 1 && all.roots[0].interval_end.is_some();
    let found: Vec<f64> = all.roots.iter().map(|r| q.lo + q.width * r.t()).collect();
    let right = if q.everywhere {
        interval
    } else {
        let multiplicity = |m: isobar_oracle::Multiplicity| match m {
            isobar_oracle::Multiplicity::Simple => 1,
            isobar_oracle::Multiplicity::Even(n) | isobar_oracle::Multiplicity::Odd(n) => n,
            isobar_oracle::Multiplicity::Interval | isobar_oracle::Multiplicity::Unknown => 0,
        };
        found.len() == q.roots.len()
            && found.iter().zip(q.roots).all(|(t, r)| (t - r.t).abs() <= q.tolerance)
            && all
                .roots
                .iter()
                .zip(q.roots)
                .all(|(a, r)| multiplicity(a.multiplicity) == r.m)
    };
    let given = match (interval, found.is_empty()) {
        (true, _) => "zero everywhere".to_owned(),
        (_, true) => "no root".to_owned(),
        _ => found.iter().map(|t| short(*t)).collect::<Vec<_>>().join(", "),
    };
    verdict(if right { VerdictKind::Right } else { VerdictKind::Wrong }, given)
}

/// A polynomial and its exact roots.
struct Question<'a> {
    roots: &'a [CaseRoot],
    everywhere: bool,
    tolerance: f64,
    lo: f64,
    width: f64,
}

impl Question<'_> {
    fn judge(&self, s: &NamedSolver, b: &[f64]) -> Verdict {
        let (found, gave_up, only_first) = match s.all {
            Some(all) => {
                let r = all(b);
                (r.as_slice().to_vec(), r.gave_up(), false)
            }
            None => match (s.first)(b) {
                First::None => (vec![], None, true),
                First::Root(r) => (vec![r], None, true),
                First::GaveUp { at } => (vec![], Some(at), true),
            },
        };
        if let Some(at) = gave_up {
            return verdict(
                VerdictKind::Refused,
                format!("gave up at {}", short(self.lo + self.width * at)),
            );
        }
        let map = |u: f64| self.lo + self.width * u;
        let slack = self.tolerance.max(2.0 * s.width * self.width.max(1.0));
        let mut given: Vec<String> = found.iter().map(|r| short(map(r.t))).collect();
        if only_first {
            given.iter_mut().for_each(|g| g.insert_str(0, "first "));
        }
        let given = if given.is_empty() {
            "no root".into()
        } else {
            given.join(", ")
        };
        let expected = if only_first {
            &self.roots[..self.roots.len().min(1)]
        } else {
            self.roots
        };
        let mut covered = vec![false; expected.len()];
        for r in &found {
            let inside = |t: f64| map(r.lo) - slack <= t && t <= map(r.hi) + slack;
            // All the roots, also those not asked for: a bracket over several is not one root.
            let held = self.roots.iter().filter(|e| inside(e.t)).count();
            let (from, to) = (short(map(r.lo)), short(map(r.hi)));
            match r.kind {
                RootKind::Interval if self.everywhere => return verdict(VerdictKind::Right, "zero everywhere".into()),
                RootKind::Touching | RootKind::Interval if held != 1 => {
                    return verdict(
                        VerdictKind::Refused,
                        format!("{given}; cannot tell what lies in [{from}, {to}]"),
                    );
                }
                RootKind::Crossing if held > 1 && r.hi - r.lo > s.width * 4.0 => {
                    return verdict(
                        VerdictKind::Refused,
                        format!("{given}; several roots may lie in [{from}, {to}]"),
                    );
                }
                _ if held == 0 => return verdict(VerdictKind::Wrong, given),
                _ => {}
            }
            for (c, e) in covered.iter_mut().zip(expected) {
                *c |= inside(e.t);
            }
        }
        let complete = !self.everywhere && covered.iter().all(|c| *c) && found.len() == expected.len();
        verdict(if complete { VerdictKind::Right } else { VerdictKind::Wrong }, given)
    }
}

/// Whether a method has a knob.
#[must_use]
pub fn has_knob(m: &dyn Method, name: &str) -> bool {
    m.info().knobs.iter().any(|k| k.name == name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cases::Known;

    fn folder() -> std::path::PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../bench-data/definitions/hard/cases")
    }

    fn case(text: &str) -> Case {
        toml::from_str(text).unwrap()
    }

    /// The oracle gives the exact answer of every case; the root finders never a wrong one.
    #[test]
    fn the_oracle_is_right_on_every_case() {
        let m = run(&folder(), &[]).unwrap();
        for row in m.tables.iter().flat_map(|t| &t.rows) {
            let given = &row.cells[0];
            assert_eq!(
                given.kind,
                VerdictKind::Right,
                "{}: expected {}, given {}",
                row.id,
                row.expected,
                given.given
            );
        }
        let polynomials = &m.tables[0];
        assert!(polynomials.rows.len() >= 17 && polynomials.columns.len() >= 2);
        for row in &polynomials.rows {
            for (column, v) in polynomials.columns.iter().zip(&row.cells) {
                let fine = matches!(v.kind, VerdictKind::Right | VerdictKind::Refused | VerdictKind::Known);
                assert!(fine, "{} by {column}: {v:?}", row.id);
            }
        }
    }

    #[test]
    fn a_wrong_expectation_is_found() {
        let c = case(
            "id='X'\ntitle=''\ntrap=''\nsource=''\ntolerance=1e-9\nkind='polynomial'\nbasis='power'\ncoefficients=[-1,2]\n\
             roots=[{t=0.4,m=1}]",
        );
        let r = polynomial(&c, isobar_poly::solvers()).unwrap();
        assert!(r.cells.iter().all(|v| v.kind == VerdictKind::Wrong), "{:?}", r.cells);
    }

    #[test]
    fn declared_failures_must_fail() {
        let mut c =
            case("id='X'\ntitle=''\ntrap=''\nsource=''\ntolerance=1e-9\nkind='polynomial'\nbasis='power'\ncoefficients=[-1,2]");
        c.known.push(Known {
            method: vec!["march/*".into()],
            reason: "because".into(),
        });
        let v = |k| verdict(k, "0.5".into());
        assert_eq!(declared(&c, "march/cpu", v(VerdictKind::Wrong)).kind, VerdictKind::Known);
        assert_eq!(declared(&c, "march/gpu", v(VerdictKind::Right)).kind, VerdictKind::Unexpected);
        assert_eq!(declared(&c, "march/gpu", v(VerdictKind::Refused)).kind, VerdictKind::Refused);
        assert_eq!(declared(&c, "mc/cpu", v(VerdictKind::Wrong)).kind, VerdictKind::Wrong);
    }
}
