//! The legs of a ray through lattices and polynomials, front to back.
//!
//! Floating point first: the walk over cells and the composition of [`crate::lattice`], in f64 alone, since its error goes into the bound and needs no sign. A ray that the walk cannot follow
//! (`map`, `walk`) is followed in integers.
//!
//! **Which cell.** Legs are the outer enclosures of the stays, each from where the one before ended. What lies outside the inner enclosure may belong to a neighbour: its length
//! is the leg's slop. The same stretch is in the slop of both neighbours, and the greatest extinction and emission of each count there, so the difference of the two is covered whichever is right. A cell
//! whose whole stay lies before that end counts as nothing but slop.

use super::beam::{Beam, Leg};
use crate::{
    compose::{self, Differences, MOST},
    exact::{ExactRay, Piece, Ratio, Span, lattice_piece},
    map::{Mapped, RayMap},
    oracle::{Goal, Shared},
    pieces,
    real::Dd,
    skip::Skip,
    walk::{Visit, steady},
};
use isobar_core::{Algebraic, Function, Lattice, Ray};
use std::ops::ControlFlow::{self, Break, Continue};

/// Floating point cannot follow this ray, or this part of it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Doubtful;

/// A stretch that may be passed over, its medium being put into the error: this share of the stay.
pub(crate) const TINY: f64 = 1e-13;

/// What `map` and the clipping planes make of a ray.
pub(crate) fn mapped(shared: &Shared, ray: &Ray, goal: Goal<'_>) -> Result<Option<Box<RayMap>>, Doubtful> {
    let Some(local) = &shared.local else { return Err(Doubtful) };
    match goal.keep(local.map(ray)) {
        Mapped::Outside => Ok(None),
        Mapped::Ray(map) if steady(&map) => Ok(Some(map)),
        _ => Err(Doubtful),
    }
}

/// Superblocks, blocks, cells; those without medium are passed by.
pub(crate) fn walk(
    map: &RayMap,
    skip: &Skip,
    cells: [usize; 3],
    beam: &mut Beam<'_>,
    mut visit: impl FnMut(&Visit, &mut Beam<'_>) -> Result<ControlFlow<()>, Doubtful>,
) -> Result<(), Doubtful> {
    let until = beam.last() - map.t_ref;
    let dark = |beam: &Beam<'_>, lo, hi| beam.dark(lo, hi);
    let stopped = pieces::walk(map, skip, cells, until, beam, dark, |beam, v| match visit(v, beam) {
        Ok(Continue(())) => Continue(()),
        Ok(Break(())) => Break(Ok(())),
        Err(doubt) => Break(Err(doubt)),
    });
    stopped.unwrap_or(Ok(()))
}

/// How much of a stay is not certainly in the cell.
pub(crate) fn slop(outer: (f64, f64), inner: (f64, f64)) -> f64 {
    (inner.0 - outer.0).max(0.0) + (outer.1 - inner.1).max(0.0)
}

/// `x - base`, rounded once.
pub(crate) fn from_base(x: &Ratio, base: f64) -> f64 {
    let b = Ratio::from_f64(base);
    Ratio::new(&x.n * &b.d - &b.n * &x.d, &x.d * &b.d).bounds().0
}

fn least_and_greatest(v: &[f64]) -> (f64, f64) {
    v.iter().fold((v[0], v[0]), |(lo, hi), &x| (lo.min(x), hi.max(x)))
}

/// Coefficients of `s - c` with c added.
pub(crate) fn lifted(b: &[f64], c: f64, out: &mut [f64; MOST + 1]) -> usize {
    for (o, b) in out.iter_mut().zip(b) {
        *o = b + c;
    }
    b.len()
}

/// A lattice in floating point.
pub(crate) fn lattice(l: &dyn Lattice, shared: &Shared, ray: &Ray, goal: Goal<'_>, beam: &mut Beam<'_>) -> Result<(), Doubtful> {
    let Some(map) = mapped(shared, ray, goal)? else {
        return Ok(());
    };
    let Some(skip) = &shared.skip else { return Err(Doubtful) };
    beam.begin(map.t_ref);
    let degree = l.basis().degree;
    let count = (degree + 1).pow(3);
    let tiny = TINY * (map.end.1 - map.start.0);
    let mut end = f64::NEG_INFINITY;
    let mut stencil = [0.0; 64];
    let mut lift = [0.0; MOST + 1];
    walk(&map, skip, l.cells(), beam, |v, beam| {
        l.stencil(v.index, &mut stencil);
        let (least, greatest) = least_and_greatest(&stencil[..count]);
        let s = (v.outer.0.max(end), v.outer.1);
        if beam.dark(least, greatest) {
            return Ok(Continue(()));
        }
        if s.0 >= s.1 {
            beam.smear(v.outer.1 - v.outer.0, least, greatest);
            return Ok(Continue(()));
        }
        let c = f64::midpoint(least, greatest);
        let differences = Differences::<f64>::new(&stencil, count, c);
        let Some(p) = compose::lattice(&map, v.index.map(|i| i as f64), s, degree, &differences) else {
            if s.1 - s.0 > tiny {
                return Err(Doubtful);
            }
            beam.smear(s.1 - s.0, least, greatest);
            return Ok(Continue(()));
        };
        end = s.1;
        let n = lifted(p.coefficients(), c, &mut lift);
        Ok(beam.leg(&Leg {
            s,
            b: &lift[..n],
            e: p.error,
            slop: slop(v.outer, v.inner),
        }))
    })
}

/// A lattice in integers.
pub(crate) fn lattice_exactly(l: &dyn Lattice, ray: &ExactRay, beam: &mut Beam<'_>) {
    let basis = l.basis();
    let (cells, count) = (l.cells(), (basis.degree + 1).pow(3));
    let Some((mut t, _)) = ray.stay.clone() else { return };
    let base = t.bounds().0;
    beam.begin(base);
    let mut stencil = [0.0; 64];
    loop {
        let index = ray.cell_at(&t, cells, false);
        let Some(span) = ray.span(index, cells) else { return };
        l.stencil(index, &mut stencil);
        let (least, greatest) = least_and_greatest(&stencil[..count]);
        let (closed, next) = (span.closed, span.t1.clone());
        if from_base(&span.t0, base) + base > beam.last() {
            return;
        }
        if !beam.dark(least, greatest) {
            let c = f64::midpoint(least, greatest);
            let spread = (greatest - c).max(c - least);
            let flow = exact_leg(
                lattice_span(ray, index, span, basis, &stencil, c),
                base,
                c,
                spread,
                3 * basis.degree,
                beam,
            );
            if flow.is_break() {
                return;
            }
        }
        if closed {
            return;
        }
        t = next;
    }
}

fn lattice_span(
    ray: &ExactRay,
    index: [usize; 3],
    span: Span,
    basis: &isobar_core::Basis1,
    stencil: &[f64; 64],
    c: f64,
) -> Option<Piece> {
    span.t0
        .compare(&span.t1)
        .is_lt()
        .then(|| lattice_piece(ray, index, span, basis, stencil, c))
}

/// A leg known in integers: `spread` is the greatest `|coefficient - c|`, which `Piece::most` stands for. The coefficients are right to a few ulps of themselves.
pub(crate) fn exact_leg(
    piece: Option<Piece>,
    base: f64,
    c: f64,
    spread: f64,
    degree: usize,
    beam: &mut Beam<'_>,
) -> ControlFlow<()> {
    let Some(piece) = piece else { return Continue(()) };
    let (b, most) = piece.bernstein();
    let s = (from_base(&piece.t0, base), from_base(&piece.t1, base));
    if b.is_empty() || b.len() > MOST + 1 || s.0 >= s.1 {
        return Continue(());
    }
    let scale = if most > 0.0 { spread / most } else { 0.0 };
    let mut lift = [0.0; MOST + 1];
    for (o, b) in lift.iter_mut().zip(&b) {
        *o = b * scale + c;
    }
    // A piece known to be constant has one coefficient.
    if b.len() == 1 {
        let v = lift[0];
        lift[..=degree].fill(v);
    }
    beam.leg(&Leg {
        s,
        b: &lift[..=degree],
        e: 1e-14 * spread,
        slop: 2.0 * f64::EPSILON * (s.0.abs() + s.1.abs()),
    })
}

/// One polynomial, in parts, in double-double. Integers are not needed: no sign is asked for, and the error goes into the bound.
pub(crate) fn polynomial(p: &Algebraic, shared: &Shared, ray: &Ray, goal: Goal<'_>, beam: &mut Beam<'_>) -> Result<(), Doubtful> {
    let Some(map) = mapped(shared, ray, goal)? else {
        return Ok(());
    };
    beam.begin(map.t_ref);
    let (s0, s1) = (map.start.0, map.end.1);
    let count = 1 + p.degree() / 2;
    let mut from = s0;
    for i in 1..=count {
        let to = if i == count {
            s1
        } else {
            s0 + (s1 - s0) * (i as f64 / count as f64)
        };
        if from >= to {
            continue;
        }
        let form = compose::algebraic::<Dd>(&map, ray, p, 0.0, (from, to)).ok_or(Doubtful)?;
        let mut b = [0.0; MOST + 1];
        for (b, x) in b.iter_mut().zip(form.coefficients()) {
            *b = x.hi;
        }
        // A constant counts as linear.
        b[1] = if form.n == 0 { b[0] } else { b[1] };
        let first = if from == s0 { map.start.1 - s0 } else { 0.0 };
        let last = if i == count { s1 - map.end.0 } else { 0.0 };
        let leg = Leg {
            s: (from, to),
            b: &b[..=form.n.max(1)],
            e: form.error,
            slop: first.max(0.0) + last.max(0.0),
        };
        if beam.leg(&leg).is_break() {
            return Ok(());
        }
        from = to;
    }
    Ok(())
}

/// The exact ray, with what clipping planes keep.
pub(crate) fn exact_ray(function: &dyn Function, shared: &Shared, ray: &Ray, goal: Goal<'_>) -> Option<ExactRay> {
    goal.exact_ray(ray, function.domain(), shared.centred)
}
