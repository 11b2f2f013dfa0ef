//! The matrix of hard cases: polynomials through every root finder, grids and surfaces through every method.
//!
//! A root finder may say that it cannot tell a root from a near miss: that is no answer, neither right nor wrong, and stands as refused with
//! its words. A method's hit is right within `VOXEL` of a voxel or the case's own tolerance, whichever is larger.

use crate::cases::{self, Basis, Case, CaseRay, CaseRoot, Problem};
use crate::results::{Matrix, MatrixRow, MatrixTable, Verdict, VerdictKind};
use anyhow::{Context, Result};
use isobar::run::{self, Setup};
use isobar_core::{Channels, Data, Frame, Method, Ray, Request, Stage, Stop, Surface, View};
use isobar_fields::{Reconstruction, Synthetic};
use isobar_oracle::{Oracle, univariate};
use isobar_poly::{First, NamedSolver, RootKind};
use std::path::Path;
use std::sync::Arc;

/// How far a method's hit may be from the certified root, voxels.
const VOXEL: f64 = 0.01;

/// Hits asked for per ray, of methods that can give more than one.
const LAYERS: usize = 8;

/// Runs all cases below `folder`.
///
/// # Errors
/// When a case file cannot be read or holds a case that makes no sense.
pub fn run(folder: &Path, methods: &[&'static dyn Method]) -> Result<Matrix> {
    let all = cases::read_all(folder)?;
    let solvers = [isobar_poly::solvers(), isobar_octree::finders::solvers()].concat();
    let mut polynomials = MatrixTable {
        title: "Polynomials, by root finder".into(),
        columns: std::iter::once("oracle".to_owned())
            .chain(solvers.iter().map(|s| s.name.to_owned()))
            .collect(),
        rows: Vec::new(),
    };
    let columns: Vec<String> = std::iter::once("oracle".to_owned())
        .chain(methods.iter().map(|m| m.info().id.to_owned()))
        .collect();
    let table = |title: &str| MatrixTable {
        title: title.into(),
        columns: columns.clone(),
        rows: Vec::new(),
    };
    let mut grids = table("Grids, by method");
    let mut surfaces = table("Surfaces sampled on grids, by method");
    for c in &all {
        let why = || format!("case {}", c.id);
        match &c.problem {
            Problem::Polynomial { .. } => polynomials.rows.push(polynomial(c, &solvers).with_context(why)?),
            Problem::Grid { .. } => grids.rows.extend(grid(c, methods).with_context(why)?),
            Problem::Field { .. } => surfaces.rows.push(field(c, methods).with_context(why)?),
        }
    }
    Ok(Matrix {
        tables: vec![polynomials, grids, surfaces],
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
    Verdict { kind, given }
}

/// Turns a verdict into a known failure where the case declares one for the column, and flags a declaration that no longer holds.
fn declared(c: &Case, column: &str, v: Verdict) -> Verdict {
    let Some(known) = c.known.iter().find(|k| k.method.iter().any(|m| matches(m, column))) else {
        return v;
    };
    match v.kind {
        VerdictKind::Wrong => verdict(VerdictKind::Known, format!("{}: {}", v.given, known.reason)),
        VerdictKind::Right => verdict(VerdictKind::Unexpected, v.given),
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
            isobar_oracle::Multiplicity::Interval => 0,
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

/// One row per reconstruction of a grid case.
fn grid(c: &Case, methods: &[&'static dyn Method]) -> Result<Vec<MatrixRow>> {
    let Problem::Grid {
        dims,
        origin,
        values,
        terms,
        isovalue,
        reconstructions,
        ray,
    } = &c.problem
    else {
        anyhow::bail!("is no grid");
    };
    let grid = cases::grid(*dims, *origin, values, terms)?;
    let data = Arc::new(Data::Grid(grid.clone()));
    let mut rows = Vec::new();
    for name in reconstructions {
        let kind: Reconstruction = name.parse()?;
        let oracle = Oracle::new(kind.of(&grid, Stage::Stored)?, isovalue.value());
        let mut cells = vec![declared(c, "oracle", oracle_on_rays(c, &oracle, ray))];
        for m in methods {
            let v = method_on_rays(c, *m, &data, Some(name), isovalue.value(), ray);
            cells.push(declared(c, m.info().id, v));
        }
        let id = if reconstructions.len() > 1 {
            format!("{} {name}", c.id)
        } else {
            c.id.clone()
        };
        rows.push(row(c, id, format!("{}; {name}", expected_on_rays(ray)), cells));
    }
    Ok(rows)
}

/// A named field: exact for the oracle, sampled for methods that draw grids.
fn field(c: &Case, methods: &[&'static dyn Method]) -> Result<MatrixRow> {
    let Problem::Field { data, n, isovalue, ray } = &c.problem else {
        anyhow::bail!("is no field");
    };
    let exact: Synthetic = data.parse()?;
    let oracle = Oracle::new(exact.field().function.clone(), isovalue.value());
    let mut cells = vec![declared(c, "oracle", oracle_on_rays(c, &oracle, ray))];
    let sampled = Arc::new(format!("{data},n={n}").parse::<Synthetic>()?.data()?);
    for m in methods {
        let v = method_on_rays(c, *m, &sampled, None, isovalue.value(), ray);
        cells.push(declared(c, m.info().id, v));
    }
    Ok(row(
        c,
        c.id.clone(),
        format!("{}; methods: of the trilinear samples, n = {n}", expected_on_rays(ray)),
        cells,
    ))
}

fn expected_on_rays(rays: &[CaseRay]) -> String {
    let one = |r: &CaseRay| match r.interval {
        Some([a, b]) => format!("s = c from {} to {}", short(a), short(b)),
        None => list(&r.roots),
    };
    rays.iter().map(one).collect::<Vec<_>>().join(" | ")
}

fn oracle_on_rays(c: &Case, oracle: &Oracle, rays: &[CaseRay]) -> Verdict {
    let mut right = true;
    let mut given = Vec::new();
    for r in rays {
        let all = oracle.all(&r.ray());
        if !all.unresolved.is_empty() {
            return verdict(VerdictKind::Refused, "enclosures could not decide".into());
        }
        let ends: Vec<_> = all.roots.iter().filter_map(|x| x.interval_end.map(|e| [x.t(), e])).collect();
        let close = |a: f64, b: f64| (a - b).abs() <= c.tolerance;
        right &= match r.interval {
            Some([a, b]) => ends.iter().any(|e| close(e[0], a) && close(e[1], b)) && all.roots.len() == 1,
            None => all.roots.len() == r.roots.len() && all.roots.iter().zip(&r.roots).all(|(x, e)| close(x.t(), e.t)),
        };
        given.push(roots_text(&all.roots));
    }
    verdict(if right { VerdictKind::Right } else { VerdictKind::Wrong }, given.join(" | "))
}

/// Certified roots as text.
fn roots_text(roots: &[isobar_oracle::Root]) -> String {
    if roots.is_empty() {
        return "no root".into();
    }
    let end = |x: &isobar_oracle::Root| x.interval_end.map_or_else(String::new, |e| format!(" to {}", short(e)));
    roots.iter().map(|x| short(x.t()) + &end(x)).collect::<Vec<_>>().join(", ")
}

/// Draws the rays and compares with the oracle on the function the method says it draws.
fn method_on_rays(
    c: &Case,
    m: &'static dyn Method,
    data: &Arc<Data>,
    reconstruction: Option<&str>,
    isovalue: f64,
    rays: &[CaseRay],
) -> Verdict {
    let view = View::rays(rays.iter().map(CaseRay::ray).collect::<Vec<Ray>>());
    let surfaces = [Surface::isovalue(isovalue, 0)];
    let mut request = Request {
        channels: Channels::T,
        layers: LAYERS,
        threads: 1,
        ..Request::default()
    };
    if let Some(name) = reconstruction.filter(|k| *k != Reconstruction::NAMES[0] || has_knob(m, "reconstruction")) {
        request.knobs.set("reconstruction", name);
    }
    let setup = |request: &Request| Setup {
        method: m,
        data,
        surfaces: &surfaces,
        medium: None,
        view: &view,
        request: request.clone(),
    };
    if m.supports(&setup(&request).scene(), &request).is_err() {
        // Most methods give one hit.
        request.layers = 1;
    }
    let drawn = run::prepare(&setup(&request)).and_then(|mut p| {
        p.render(&Stop::default())?;
        let mut frame = Frame::default();
        p.renderer().read(&mut frame)?;
        Ok((frame, p.function()))
    });
    let (frame, function) = match drawn {
        Ok((frame, Some(f))) => (frame, f),
        Ok((_, None)) => return verdict(VerdictKind::Refused, "tells no function to compare with".into()),
        Err(e) => return verdict(VerdictKind::Refused, e.to_string()),
    };
    let oracle = Oracle::new(function.clone(), isovalue);
    let voxel = function.domain().voxel();
    let mut right = true;
    let (mut given, mut certified) = (Vec::new(), Vec::new());
    for (x, r) in rays.iter().enumerate() {
        let ray = r.ray();
        let hits: Vec<f64> = (0..frame.layers)
            .map(|l| frame.t[l * rays.len() + x])
            .filter(|t| t.is_finite())
            .collect();
        let truth = oracle.all(&ray).roots;
        let slack = c.tolerance.max(VOXEL * voxel / ray.direction.length());
        let near = |h: &f64, e: &isobar_oracle::Root| e.distance(*h) <= slack;
        right &= if frame.layers > 1 {
            hits.len() == truth.len() && hits.iter().zip(&truth).all(|(h, e)| near(h, e))
        } else {
            match (hits.first(), truth.first()) {
                (Some(h), Some(e)) => near(h, e),
                (None, None) => true,
                _ => false,
            }
        };
        let shown: Vec<String> = hits.iter().map(|t| short((t * 1e6).round() / 1e6)).collect();
        given.push(if shown.is_empty() { "no hit".into() } else { shown.join(", ") });
        certified.push(roots_text(&truth));
    }
    let kind = if right { VerdictKind::Right } else { VerdictKind::Wrong };
    let what = if frame.layers > 1 { "" } else { "first: " };
    let mut text = format!("{what}{}", given.join(" | "));
    if reconstruction.is_none() || !right {
        text += &format!(" (certified: {})", certified.join(" | "));
    }
    verdict(kind, text)
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
