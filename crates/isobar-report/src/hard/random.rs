//! Random rays through a closed surface, both ways (hardcases C19).
//!
//! No answer is known beforehand, but every answer must have three properties: an even number of hits counted with multiplicity, entries and exits in
//! turn, and the same hits from the other end. Ends and directions have few binary digits, so that a ray and its reverse are exactly one line and t of the one
//! is exactly 32 less t of the other.

use super::rays::{Drawn, draw, field_for, refuted};
use super::{Bar, declared, row, verdict};
use crate::cases::{Case, FieldData, Problem};
use crate::results::{MatrixRow, Verdict, VerdictKind};
use anyhow::Result;
use isobar::truth::Random;
use isobar_core::{DVec3, Data, DataKind, Method, Ray, Surface, View};
use isobar_oracle::{Multiplicity, Oracle, Root};
use rayon::prelude::*;
use std::sync::Arc;

/// t from one end to the other.
const LENGTH: f64 = 32.0;

/// Of so many rays the claims are held against the truth.
const PROVED: usize = 2048;

/// Hits asked for per ray.
const LAYERS: usize = 8;

/// Steps of a coordinate across the box.
const STEPS: f64 = 2048.0;

/// One end and the other, through two random points of the box at least half its edge apart.
fn pairs(half: f64, count: usize, seed: u64) -> (Vec<Ray>, Vec<Ray>) {
    let mut random = Random::new(seed);
    let mut point = || {
        let c: [f64; 3] = std::array::from_fn(|_| ((random.unit() - 0.5) * STEPS).round() / STEPS);
        DVec3::from_array(c) * (2.0 * half)
    };
    let (mut there, mut back) = (Vec::with_capacity(count), Vec::with_capacity(count));
    while there.len() < count {
        let (a, b) = (point(), point());
        let direction = b - a;
        if direction.length() < half {
            continue;
        }
        there.push(Ray {
            origin: a - direction * (LENGTH / 2.0),
            direction,
        });
        back.push(Ray {
            origin: a + direction * (LENGTH / 2.0),
            direction: -direction,
        });
    }
    (there, back)
}

/// What was found on a ray: t and whether f grows along the ray there; a root that only touches has no side.
type Found = Vec<(f64, Option<bool>)>;

/// How many rays lack a property.
#[derive(Debug, Default, PartialEq, Eq)]
struct Lacking {
    odd: usize,
    turn: usize,
    reversed: usize,
}

impl Lacking {
    /// `slack` is that of one position in t.
    fn of(there: &[Found], back: &[Found], slack: impl Fn(usize) -> f64) -> Self {
        let mut out = Self::default();
        for (i, (f, g)) in there.iter().zip(back).enumerate() {
            let sides: Vec<bool> = f.iter().filter_map(|h| h.1).collect();
            out.odd += usize::from(!sides.len().is_multiple_of(2));
            out.turn += usize::from(sides.windows(2).any(|w| w[0] == w[1]));
            let near = |a: &(f64, Option<bool>), b: &(f64, Option<bool>)| (a.0 + b.0 - LENGTH).abs() <= 2.0 * slack(i);
            let same = f.len() == g.len() && f.iter().zip(g.iter().rev()).all(|(a, b)| near(a, b));
            out.reversed += usize::from(!same);
        }
        out
    }

    fn verdict(&self, rays: usize, hits: usize, notes: &str) -> Verdict {
        let right = *self == Self::default() && notes.is_empty();
        let text = format!(
            "{hits} hits on {rays} rays; rays with an odd number: {}, with two entries or exits in a row: {}, unlike their reverse: {}{notes}",
            self.odd, self.turn, self.reversed
        );
        verdict(if right { VerdictKind::Right } else { VerdictKind::Wrong }, text)
    }
}

/// The row of a case.
pub(super) fn row_of(c: &Case, methods: &[&'static dyn Method]) -> Result<MatrixRow> {
    let Problem::RandomRays {
        data,
        n,
        isovalue,
        rays,
        seed,
    } = &c.problem
    else {
        anyhow::bail!("has no random rays");
    };
    let exact = FieldData::new(Some(data), &[], None)?;
    let (there, back) = pairs(exact.function.domain().hi.x, *rays, *seed);
    let oracle = Oracle::new(exact.function.clone(), isovalue.value());
    let mut cells = vec![declared(c, "oracle", oracle_both_ways(c, &oracle, &there, &back))];
    let sampled = Arc::new(Data::Grid(exact.grid(*n)?));
    let surfaces = [Surface::isovalue(isovalue.value(), 0)];
    for m in methods {
        let v = match field_for(*m, &exact, &sampled)? {
            Ok(data) => {
                let count = asked(*m, there.len());
                both_ways(c, *m, &data, &surfaces, &there[..count], &back[..count])
            }
            Err(why) => verdict(VerdictKind::Refused, why),
        };
        cells.push(declared(c, m.info().id, v));
    }
    let expected = format!(
        "{rays} rays: all even, entries and exits in turn, the same from the other end; methods: of the trilinear samples, n = {n}, casters of meshes fewer of both"
    );
    Ok(row(c, c.id.clone(), expected, cells))
}

/// How many of the rays a method is asked: casters of meshes search a tree for every ray of a list and would take longer than all other cases.
fn asked(m: &dyn Method, rays: usize) -> usize {
    if m.info().data.intersects(DataKind::HEXES | DataKind::TETS) {
        rays / 25
    } else {
        rays
    }
}

fn oracle_both_ways(c: &Case, oracle: &Oracle, there: &[Ray], back: &[Ray]) -> Verdict {
    let find = |r: &Ray| -> Option<Found> {
        let all = oracle.all(r);
        let side = |x: &Root| match x.multiplicity {
            Multiplicity::Even(_) | Multiplicity::Interval | Multiplicity::Unknown => None,
            Multiplicity::Simple => Some(x.slope > 0.0),
            // The slope of a flat crossing is 0; its side is seen behind it.
            Multiplicity::Odd(_) => Some(oracle.function().value(r.at(x.hi + 1e-4)) > oracle.isovalue()),
        };
        let found = all.roots.iter().map(|x| (x.t(), side(x))).collect();
        all.unresolved.is_empty().then_some(found)
    };
    let all = |rays: &[Ray]| rays.par_iter().map(find).collect::<Option<Vec<Found>>>();
    let (Some(f), Some(g)) = (all(there), all(back)) else {
        return verdict(VerdictKind::Refused, "enclosures could not decide".into());
    };
    let hits = f.iter().map(Vec::len).sum();
    Lacking::of(&f, &g, |_| c.tolerance).verdict(there.len(), hits, "")
}

fn both_ways(c: &Case, m: &'static dyn Method, data: &Arc<Data>, surfaces: &[Surface], there: &[Ray], back: &[Ray]) -> Verdict {
    let drawn = |rays: &[Ray]| draw(m, data, None, surfaces, &View::rays(rays.to_vec()), LAYERS);
    let (f, g) = match (drawn(there), drawn(back)) {
        (Ok(f), Ok(g)) => (f, g),
        (Err(why), _) | (_, Err(why)) => return verdict(VerdictKind::Refused, why),
    };
    if f.frame.layers < 2 {
        return verdict(VerdictKind::Refused, "gives the first hit only".into());
    }
    let bar = Bar::of(m);
    let mut notes = String::new();
    if bar.proves {
        let few = there.len().min(PROVED);
        let view = View::rays(there[..few].to_vec());
        match draw(m, data, None, surfaces, &view, 1).and_then(|d| refuted(&d, surfaces, &view)) {
            Ok(0) => {}
            Ok(n) => notes = format!("; {n} claims refuted"),
            Err(why) => return verdict(VerdictKind::Refused, why),
        }
    }
    let (a, b) = (found(&f, there), found(&g, back));
    let hits = a.iter().map(Vec::len).sum();
    let slack = |i: usize| bar.slack(c.tolerance, f.function.domain(), &there[i]);
    Lacking::of(&a, &b, slack).verdict(there.len(), hits, &notes)
}

/// The hits of a frame, ray by ray.
fn found(d: &Drawn, rays: &[Ray]) -> Vec<Found> {
    let n = rays.len();
    (0..n)
        .map(|i| {
            let layers = (0..d.frame.layers).map(|l| l * n + i).filter(|&k| d.frame.t[k].is_finite());
            layers
                .map(|k| {
                    let normal = DVec3::from_array(d.frame.normal[k].map(f64::from));
                    (d.frame.t[k], Some(normal.dot(rays[i].direction) > 0.0))
                })
                .collect()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ray_and_its_reverse_are_one_line() {
        let (there, back) = pairs(1.5, 200, 3);
        for (a, b) in there.iter().zip(&back) {
            assert_eq!((a.at(LENGTH), b.at(LENGTH)), (b.origin, a.origin));
            assert!(a.direction.length() >= 1.5 && a.origin.abs().max_element() > 1.5);
        }
    }

    #[test]
    fn each_lacking_property_is_counted() {
        let hit = |t: f64, up: bool| (t, Some(up));
        let there = vec![
            vec![hit(10.0, false), hit(12.0, true)],
            vec![hit(10.0, false)],
            vec![hit(10.0, false), hit(12.0, false)],
            vec![hit(10.0, false), hit(12.0, true)],
        ];
        let back = vec![
            vec![hit(20.0, false), hit(22.0, true)],
            vec![hit(22.0, false)],
            vec![hit(20.0, false), hit(22.0, true)],
            vec![hit(20.0, false), hit(22.5, true)],
        ];
        let lacking = Lacking::of(&there, &back, |_| 1e-6);
        assert_eq!(
            lacking,
            Lacking {
                odd: 1,
                turn: 1,
                reversed: 1
            }
        );
        assert_eq!(lacking.verdict(4, 7, "").kind, VerdictKind::Wrong);
        assert_eq!(Lacking::default().verdict(4, 7, "").kind, VerdictKind::Right);
        assert_eq!(
            Lacking::default().verdict(4, 7, "; 1 claims refuted").kind,
            VerdictKind::Wrong
        );
    }
}
