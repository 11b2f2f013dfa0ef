//! Cases of rays: grids and fields, each through every method.

use super::{Bar, declared, has_knob, list, row, short, verdict};
use crate::cases::{self, Case, CaseRay, FieldData, Problem};
use crate::results::{MatrixRow, Verdict, VerdictKind};
use anyhow::Result;
use isobar::run::{self, Setup};
use isobar_core::{
    Channels, Claim, DVec3, Data, DataKind, Frame, Function, Grid, Method, Ray, Request, Stage, Stop, Surface, View,
};
use isobar_fields::{Reconstruction, grid_to_hexes, grid_to_tets};
use isobar_oracle::{Oracle, Root, Truth};
use std::sync::Arc;

/// Hits asked for per ray of a case, of methods that can give more than one.
const LAYERS: usize = 32;

/// Hits of a ray shown one by one in a cell; the others are counted.
const LISTED: usize = 6;

/// s - c counts as zero to the rounding of f64 below this part of the range of s: positions are rounded too, and methods bound what that can do. In C9
/// octree/cpu hits, and claims nothing, where s - c is 1.3e-12 of the range along a whole stretch.
const ROUNDING: f64 = 1e-11;

/// Positions this close, in cells, are one root.
const ONE: f64 = 1e-6;

/// Rays shown one by one in a cell; the others are counted.
const SHOWN: usize = 6;

/// How far a turn of normals may be off, degrees: f32 normals are good to 1e-5.
const TURN: f64 = 0.01;

/// A grid larger than this, in samples, is not made into cells of a mesh for a case.
const MESHED: usize = 1 << 15;

/// Samples per axis where a field is drawn as a mesh.
const MESH_SIZE: usize = 17;

/// One row per reconstruction of a grid case.
pub(super) fn grid(c: &Case, methods: &[&'static dyn Method]) -> Result<Vec<MatrixRow>> {
    let Problem::Grid {
        isovalue,
        reconstructions,
        turn,
        ray,
        ..
    } = &c.problem
    else {
        anyhow::bail!("is no grid");
    };
    let grid = cases::grid(&c.problem)?;
    let mut rows = Vec::new();
    for name in reconstructions {
        let kind: Reconstruction = name.parse()?;
        let oracle = Oracle::new(kind.of(&grid, Stage::Stored)?, isovalue.value());
        let mut cells = vec![declared(c, "oracle", oracle_on_rays(c, &oracle, ray, *turn))];
        for m in methods {
            let q = Question {
                case: c,
                reconstruction: Some(name),
                isovalue: isovalue.value(),
                rays: ray,
                turn: *turn,
            };
            let v = match data_for(*m, grid.clone()) {
                Ok(data) => q.ask(*m, &data),
                Err(why) => verdict(VerdictKind::Refused, why),
            };
            cells.push(declared(c, m.info().id, v));
        }
        let id = if reconstructions.len() > 1 {
            format!("{} {name}", c.id)
        } else {
            c.id.clone()
        };
        let turned = turn.map_or_else(String::new, |t| format!("; normals {t:.4}° apart"));
        rows.push(row(c, id, format!("{}{turned}; {name}", expected_on_rays(ray)), cells));
    }
    Ok(rows)
}

/// A named field or a polynomial: exact for the oracle, sampled for methods that draw grids or meshes.
pub(super) fn field(c: &Case, methods: &[&'static dyn Method]) -> Result<MatrixRow> {
    let Problem::Field {
        data,
        terms,
        half,
        n,
        isovalue,
        ray,
    } = &c.problem
    else {
        anyhow::bail!("is no field");
    };
    let exact = FieldData::new(data.as_deref(), terms, *half)?;
    let oracle = Oracle::new(exact.function.clone(), isovalue.value());
    let mut cells = vec![declared(c, "oracle", oracle_on_rays(c, &oracle, ray, None))];
    let sampled = Arc::new(Data::Grid(exact.grid(*n)?));
    for m in methods {
        let q = Question {
            case: c,
            reconstruction: None,
            isovalue: isovalue.value(),
            rays: ray,
            turn: None,
        };
        let v = match field_for(*m, &exact, &sampled)? {
            Ok(data) => q.ask(*m, &data),
            Err(why) => verdict(VerdictKind::Refused, why),
        };
        cells.push(declared(c, m.info().id, v));
    }
    let expected = format!(
        "{}; methods: of the trilinear samples, n = {n}, casters of meshes {MESH_SIZE}",
        expected_on_rays(ray)
    );
    Ok(row(c, c.id.clone(), expected, cells))
}

/// The data of a field in a form that the method draws: samples, the polynomial, a mesh of few samples; or why there is none.
pub(super) fn field_for(m: &dyn Method, exact: &FieldData, sampled: &Arc<Data>) -> Result<Result<Arc<Data>, String>> {
    let kinds = m.info().data;
    // Casters of meshes make one of a grid too: an element for every cell.
    let meshes = kinds.intersects(DataKind::HEXES | DataKind::TETS);
    if kinds.contains(DataKind::GRID) && !meshes {
        return Ok(Ok(sampled.clone()));
    }
    if let (true, isobar_core::Structure::Polynomial(p)) = (
        kinds.contains(DataKind::ALGEBRAIC) && !kinds.contains(DataKind::GRID),
        exact.function.structure(),
    ) {
        return Ok(Ok(Arc::new(Data::Algebraic(p.clone()))));
    }
    Ok(data_for(m, exact.grid(MESH_SIZE)?))
}

/// A grid, or the mesh made of it that has the same values: hexahedra are trilinear, tetrahedra a function of their own.
pub(super) fn data_for(m: &dyn Method, grid: Grid) -> Result<Arc<Data>, String> {
    let kinds = m.info().data;
    let small = grid.samples.len() <= MESHED;
    let made = if kinds.contains(DataKind::GRID) {
        Ok(Data::Grid(grid))
    } else if !small {
        return Err(format!("{} samples are too many for a mesh in a case", grid.samples.len()));
    } else if kinds.contains(DataKind::HEXES) {
        grid_to_hexes(&grid).map(Data::Hexes)
    } else if kinds.contains(DataKind::TETS) {
        grid_to_tets(&grid).map(Data::Tets)
    } else {
        return Err(format!("draws {}, no samples", kinds.words()));
    };
    made.map(Arc::new).map_err(|e| e.to_string())
}

/// Some rays one by one, and how many more.
fn joined(parts: &[String]) -> String {
    let shown = parts[..parts.len().min(SHOWN)].join(" | ");
    if parts.len() > SHOWN {
        format!("{shown} | and {} rays more", parts.len() - SHOWN)
    } else {
        shown
    }
}

fn expected_on_rays(rays: &[CaseRay]) -> String {
    let one = |r: &CaseRay| match r.interval {
        Some([a, b]) => format!("s = c from {} to {}", short(a), short(b)),
        None => list(&r.roots),
    };
    joined(&rays.iter().map(one).collect::<Vec<_>>())
}

fn oracle_on_rays(c: &Case, oracle: &Oracle, rays: &[CaseRay], turn: Option<f64>) -> Verdict {
    let mut right = true;
    let mut given = Vec::new();
    let mut normals = Vec::new();
    for r in rays {
        let ray = r.ray();
        let all = oracle.all(&ray);
        if !all.unresolved.is_empty() {
            return verdict(VerdictKind::Refused, "enclosures could not decide".into());
        }
        let ends: Vec<_> = all.roots.iter().filter_map(|x| x.interval_end.map(|e| [x.t(), e])).collect();
        let close = |a: f64, b: f64| (a - b).abs() <= c.tolerance;
        right &= match r.interval {
            Some([a, b]) => ends.iter().any(|e| close(e[0], a) && close(e[1], b)) && all.roots.len() == 1,
            None => all.roots.len() == r.roots.len() && all.roots.iter().zip(&r.roots).all(|(x, e)| close(x.t(), e.t)),
        };
        normals.extend(all.roots.first().map(|x| oracle.function().gradient(ray.at(x.t()))));
        given.push(roots_text(&all.roots));
    }
    let mut text = joined(&given);
    if let Some(expected) = turn {
        let (fits, said) = turned(&normals, expected);
        right &= fits;
        text += &said;
    }
    verdict(if right { VerdictKind::Right } else { VerdictKind::Wrong }, text)
}

/// Whether the first two normals are turned as they must be, and the angle as text.
fn turned(normals: &[DVec3], expected: f64) -> (bool, String) {
    let [a, b, ..] = normals else {
        return (false, "; no two normals".into());
    };
    // atan2 keeps small angles.
    let angle = a.cross(*b).length().atan2(a.dot(*b)).to_degrees();
    ((angle - expected).abs() <= TURN, format!("; normals {angle:.4}° apart"))
}

/// Certified roots as text.
fn roots_text(roots: &[Root]) -> String {
    if roots.is_empty() {
        return "no root".into();
    }
    let end = |x: &Root| x.interval_end.map_or_else(String::new, |e| format!(" to {}", short(e)));
    listed(roots.iter().map(|x| short(x.t()) + &end(x)))
}

/// The first of many positions, and how many there are.
fn listed(all: impl Iterator<Item = String>) -> String {
    let all: Vec<String> = all.collect();
    if all.len() <= LISTED {
        return all.join(", ");
    }
    format!("{}, … ({} in all)", all[..LISTED - 1].join(", "), all.len())
}

/// What a method drew.
pub(super) struct Drawn {
    pub(super) frame: Frame,
    pub(super) function: Arc<dyn Function>,
}

/// Draws rays: with all hits where the method can, with claims where it has them. The error is why there is nothing to judge.
pub(super) fn draw(
    m: &'static dyn Method,
    data: &Arc<Data>,
    reconstruction: Option<&str>,
    surfaces: &[Surface],
    view: &View,
    layers: usize,
) -> Result<Drawn, String> {
    let mut request = Request {
        channels: Channels::T | Channels::NORMAL,
        layers,
        threads: 1,
        ..Request::default()
    };
    if has_knob(m, "claims") {
        request.channels |= Channels::SURFACE | Channels::T_ERROR | Channels::CLAIM;
    }
    if let Some(name) = reconstruction.filter(|k| *k != Reconstruction::NAMES[0] || has_knob(m, "reconstruction")) {
        request.knobs.set("reconstruction", name);
    }
    let setup = |request: &Request| Setup {
        method: m,
        data,
        surfaces,
        medium: None,
        view,
        request: request.clone(),
    };
    if m.supports(&setup(&request).scene(), &request).is_err() {
        // Not all methods give more than one hit.
        request.layers = 1;
    }
    let drawn = run::prepare(&setup(&request)).and_then(|mut p| {
        p.render(&Stop::default())?;
        let mut frame = Frame::default();
        p.renderer().read(&mut frame)?;
        Ok((frame, p.function()))
    });
    match drawn {
        Ok((frame, Some(function))) => Ok(Drawn { frame, function }),
        Ok((_, None)) => Err("tells no function to compare with".into()),
        Err(e) => Err(e.to_string()),
    }
}

/// A case as a method is asked it.
struct Question<'a> {
    case: &'a Case,
    reconstruction: Option<&'a str>,
    isovalue: f64,
    rays: &'a [CaseRay],
    turn: Option<f64>,
}

impl Question<'_> {
    /// Draws the rays and compares with the oracle on the function the method says it draws.
    fn ask(&self, m: &'static dyn Method, data: &Arc<Data>) -> Verdict {
        let view = View::rays(self.rays.iter().map(CaseRay::ray).collect::<Vec<Ray>>());
        let surfaces = [Surface::isovalue(self.isovalue, 0)];
        let drawn = match draw(m, data, self.reconstruction, &surfaces, &view, LAYERS) {
            Ok(d) => d,
            Err(why) => return verdict(VerdictKind::Refused, why),
        };
        let bar = Bar::of(m);
        let mut right = true;
        let mut notes = String::new();
        if bar.proves {
            match refuted(&drawn, &surfaces, &view) {
                Ok(0) => {}
                Ok(n) => {
                    right = false;
                    notes += &format!("; {n} claims refuted");
                }
                Err(e) => return verdict(VerdictKind::Refused, e),
            }
        }
        let Compared {
            right: near,
            unproved,
            given,
            certified,
        } = self.compare(&drawn, &bar);
        right &= near;
        if let Some(expected) = self.turn {
            let normals: Vec<DVec3> = (drawn.frame.normal.iter().take(2))
                .map(|n| DVec3::from_array(n.map(f64::from)))
                .collect();
            let (fits, said) = turned(&normals, expected);
            right &= fits;
            notes += &said;
        }
        let what = if drawn.frame.layers > 1 { "" } else { "first: " };
        // A grid's exact answer is the row's, unless the column is wrong about it or draws another function.
        let same = self.reconstruction.is_some() && right && m.info().data.contains(DataKind::GRID);
        let kind = match (right, unproved.is_empty()) {
            (false, _) => VerdictKind::Wrong,
            (true, false) => {
                let at = listed(unproved.iter().map(|t| short(*t)));
                notes += &format!("; cannot tell a root from none at {at}, where s - c is zero to rounding");
                VerdictKind::Refused
            }
            (true, true) => VerdictKind::Right,
        };
        Verdict {
            kind,
            given: format!("{what}{}{notes}", joined(&given)),
            expected: if same { String::new() } else { joined(&certified) },
        }
    }

    /// Holds all hits against the certified roots, ray by ray.
    fn compare(&self, drawn: &Drawn, bar: &Bar) -> Compared {
        let Drawn { frame, function } = drawn;
        let oracle = Oracle::new(function.clone(), self.isovalue);
        let n = self.rays.len();
        let mut out = Compared {
            right: true,
            ..Compared::default()
        };
        for (x, r) in self.rays.iter().enumerate() {
            let ray = r.ray();
            let hits: Vec<f64> = (0..frame.layers)
                .map(|l| frame.t[l * n + x])
                .filter(|t| t.is_finite())
                .collect();
            let mut truth = oracle.all(&ray).roots;
            // A root on a face of two elements of a mesh may come from both.
            truth.dedup_by(|b, a| b.lo <= a.hi);
            let slack = bar.slack(self.case.tolerance, function.domain(), &ray);
            let one = ONE / function.domain().local_vector(ray.direction).length();
            let mut sure = hits.clone();
            if bar.proves {
                let claim = frame.claim.get(x).copied().unwrap_or_default();
                // A hit that is claimed, the first one, is never put aside.
                let proved = hits.first().copied().filter(|_| claim.contains(Claim::EXISTS));
                let aside: Vec<f64> = (hits.iter().copied())
                    .filter(|h| Some(*h) != proved && self.is_unproved(function, &ray, *h, &hits, &truth, slack.max(one)))
                    .collect();
                sure.retain(|h| !aside.contains(h));
                out.unproved.extend(aside);
            }
            let near = |h: &f64, e: &Root| e.distance(*h) <= slack;
            let right = if frame.layers > 1 {
                sure.len() == truth.len().min(LAYERS) && sure.iter().zip(&truth).all(|(h, e)| near(h, e))
            } else {
                match (sure.first(), truth.first()) {
                    (Some(h), Some(e)) => near(h, e),
                    (None, None) => true,
                    _ => false,
                }
            };
            if !right && bar.proves && frame.layers > 1 {
                // Roots too near to be told apart, some of them one hit: as honest as a touching hit.
                let (a, b) = (clusters(sure.iter().copied(), one), clusters(truth.iter().map(Root::t), one));
                let same = a.len() == b.len() && a.iter().zip(&b).all(|(x, y)| (x - y).abs() <= one.max(slack));
                out.right &= same;
                out.unproved
                    .extend(truth.windows(2).filter(|w| w[1].lo - w[0].hi <= one).map(|w| w[0].t()));
            } else {
                out.right &= right;
            }
            let shown = listed(hits.iter().map(|t| short(*t)));
            out.given.push(if shown.is_empty() { "no hit".into() } else { shown });
            out.certified.push(roots_text(&truth));
        }
        out
    }

    /// Whether a hit is no root but a place where f64 cannot tell: s - c is zero to rounding, and neither a root nor another hit is near.
    fn is_unproved(&self, function: &Arc<dyn Function>, ray: &Ray, t: f64, hits: &[f64], truth: &[Root], one: f64) -> bool {
        let (lo, hi) = function.domain().world_bounds();
        let range = function.enclosure(lo, hi);
        let rounding = ROUNDING * (range.hi - self.isovalue).abs().max((range.lo - self.isovalue).abs());
        let alone = hits.iter().filter(|h| (*h - t).abs() <= one).count() == 1 && truth.iter().all(|e| e.distance(t) > one);
        alone && (function.value(ray.at(t)) - self.isovalue).abs() <= rounding
    }
}

/// The first of each run of positions that are at most `one` apart.
fn clusters(all: impl Iterator<Item = f64>, one: f64) -> Vec<f64> {
    let mut out = Vec::new();
    let mut last = f64::NEG_INFINITY;
    for t in all {
        if t - last > one {
            out.push(t);
        }
        last = t;
    }
    out
}

/// All rays of a case held against the truth.
#[derive(Default)]
struct Compared {
    /// Each certified root is hit, and nothing else but `unproved`.
    right: bool,
    /// Hits of a proving method that claims nothing there.
    unproved: Vec<f64>,
    /// Hits as text.
    given: Vec<String>,
    /// Certified roots as text.
    certified: Vec<String>,
}

/// Claims about the first hits that the oracle contradicts.
pub(super) fn refuted(drawn: &Drawn, surfaces: &[Surface], view: &View) -> Result<usize, String> {
    let check = || {
        let truth = Truth::compute(&drawn.function, surfaces, view, &Stop::default())?;
        isobar_oracle::check(&drawn.frame, &truth, &drawn.function, surfaces, view)
    };
    check().map(|c| c.refuted).map_err(|e| format!("the oracle: {e}"))
}
