//! The legs of a ray through cubics on tetrahedra: as for a lattice ([`crate::integral`]), each cube's stay cut into those of its tetrahedra. A cube that floating point cannot cut is cut in integers.

use super::{
    compose::{self, cut, signatures},
    exact::{parts, piece},
};
use crate::{
    exact::ExactRay,
    integral::{
        beam::{Beam, Leg},
        legs::{Doubtful, TINY, exact_leg, exact_ray, from_base, lifted, mapped, slop, walk},
    },
    oracle::{Goal, Shared},
};
use isobar_core::{Function, Ray, Tetrahedral};
use std::ops::ControlFlow::{self, Break, Continue};

fn range(data: &[f64; 27]) -> (f64, f64) {
    data.iter().fold((data[0], data[0]), |(lo, hi), &x| (lo.min(x), hi.max(x)))
}

/// In floating point as far as that goes.
pub(crate) fn legs(
    spline: &dyn Tetrahedral,
    function: &dyn Function,
    shared: &Shared,
    ray: &Ray,
    goal: Goal<'_>,
    beam: &mut Beam<'_>,
) -> Result<(), Doubtful> {
    let Some(map) = mapped(shared, ray, goal)? else {
        return Ok(());
    };
    let Some(skip) = &shared.skip else { return Err(Doubtful) };
    beam.begin(map.t_ref);
    let masks = spline.masks();
    let signs = signatures(masks);
    let tiny = TINY * (map.end.1 - map.start.0);
    let mut end = f64::NEG_INFINITY;
    let mut data = [0.0; 27];
    let mut lift = [0.0; crate::compose::MOST + 1];
    let mut exact: Option<ExactRay> = None;
    walk(&map, skip, spline.dims(), beam, |v, beam| {
        spline.data(v.index, &mut data);
        let (least, greatest) = range(&data);
        if beam.dark(least, greatest) {
            return Ok(Continue(()));
        }
        if v.outer.0.max(end) >= v.outer.1 {
            beam.smear(v.outer.1 - v.outer.0, least, greatest);
            return Ok(Continue(()));
        }
        let c = f64::midpoint(least, greatest);
        let most = (greatest - c).max(c - least).next_up();
        let Some(parts) = cut(&map, v, &signs) else {
            if v.outer.1 - v.outer.0.max(end) <= tiny {
                beam.smear(v.outer.1 - v.outer.0, least, greatest);
                return Ok(Continue(()));
            }
            if exact.is_none() {
                exact = exact_ray(function, shared, ray, goal);
            }
            let Some(exact) = &exact else { return Err(Doubtful) };
            // The exact stay may overlap the leg before, or leave something of it out.
            beam.smear(slop(v.outer, v.inner), least, greatest);
            end = v.outer.1;
            return Ok(cube_exactly(spline, exact, v.index, map.t_ref, beam));
        };
        for part in parts {
            let s = (part.outer.0.max(end), part.outer.1);
            if s.0 >= s.1 {
                beam.smear(part.outer.1 - part.outer.0, least, greatest);
                continue;
            }
            let slop = slop(part.outer, part.inner);
            let cropped = compose::Part { outer: s, ..part };
            let Some(p) = compose::compose::<f64>(&map, v.index, &cropped, masks, &data, c, most) else {
                if s.1 - s.0 > tiny {
                    return Err(Doubtful);
                }
                beam.smear(s.1 - s.0, least, greatest);
                continue;
            };
            end = s.1;
            let n = lifted(p.coefficients(), c, &mut lift);
            let leg = Leg {
                s,
                b: &lift[..n],
                e: p.error,
                slop,
            };
            if beam.leg(&leg).is_break() {
                return Ok(Break(()));
            }
        }
        Ok(Continue(()))
    })
}

/// All cubes in integers.
pub(crate) fn legs_exactly(spline: &dyn Tetrahedral, ray: &ExactRay, beam: &mut Beam<'_>) {
    let cubes = spline.dims();
    let Some((mut t, _)) = ray.stay.clone() else { return };
    let base = t.bounds().0;
    beam.begin(base);
    loop {
        let index = ray.cell_at(&t, cubes, false);
        let Some(span) = ray.span(index, cubes) else { return };
        if from_base(&span.t0, base) + base > beam.last()
            || cube_exactly(spline, ray, index, base, beam).is_break()
            || span.closed
        {
            return;
        }
        t = span.t1;
    }
}

fn cube_exactly(spline: &dyn Tetrahedral, ray: &ExactRay, index: [usize; 3], base: f64, beam: &mut Beam<'_>) -> ControlFlow<()> {
    let mut data = [0.0; 27];
    spline.data(index, &mut data);
    let (least, greatest) = range(&data);
    let Some(span) = ray.span(index, spline.dims()) else {
        return Continue(());
    };
    if beam.dark(least, greatest) {
        return Continue(());
    }
    let c = f64::midpoint(least, greatest);
    let spread = (greatest - c).max(c - least);
    for part in parts(ray, index, span, spline.masks()) {
        let solid = part.span.t0.compare(&part.span.t1).is_lt();
        let piece = solid.then(|| piece(ray, index, part, spline.masks(), &data, c));
        exact_leg(piece, base, c, spread, 3, beam)?;
    }
    Continue(())
}
