//! Mapped elements: hardcases D, faces, edges and corners, folds, tangents; and against the lattice oracle.

mod against;
mod cases;
mod surfaces;

use crate::support::{Random, ray};
use isobar_core::{DVec3, HexElement, HexPatches, Ray};
use isobar_fields::{HexField, evaluate_hex};
use isobar_oracle::{AllRoots, Decided, Multiplicity, Oracle};
use std::sync::Arc;

/// An element from control points x, y, z, w and coefficients, u fastest.
pub(crate) fn element(degree: [u8; 3], points: Vec<[f64; 4]>, value_degree: [u8; 3], values: Vec<f64>) -> HexElement {
    HexElement {
        degree,
        points: points.into(),
        value_degree,
        values: values.into(),
        rational_value: false,
    }
}

/// Control points from their indices.
pub(crate) fn net(degree: [u8; 3], mut f: impl FnMut([usize; 3]) -> [f64; 4]) -> Vec<[f64; 4]> {
    let n = degree.map(|d| usize::from(d) + 1);
    let all = n.iter().product();
    (0..all).map(|i| f([i % n[0], i / n[0] % n[1], i / n[0] / n[1]])).collect()
}

/// The box [lo, hi] with the attribute given.
pub(crate) fn cuboid(lo: DVec3, hi: DVec3, value_degree: [u8; 3], values: Vec<f64>) -> HexElement {
    let points = net([1; 3], |i| {
        let x = |a: usize| if i[a] == 0 { lo[a] } else { hi[a] };
        [x(0), x(1), x(2), 1.0]
    });
    element([1; 3], points, value_degree, values)
}

pub(crate) fn oracle(elements: Vec<HexElement>, c: f64) -> Oracle {
    let field = HexField::new(&HexPatches::new(elements).unwrap()).unwrap();
    Oracle::new(Arc::new(field), c)
}

/// The roots in every stage: t and multiplicity; brackets narrow, stages in agreement, nothing left open.
pub(crate) fn roots(o: &Oracle, r: &Ray) -> Vec<(f64, Multiplicity)> {
    let of = |stage| o.with_stage(stage).all(r);
    let (a, b) = (of(Decided::F64), of(Decided::DoubleDouble));
    assert!(
        a.unresolved.is_empty() && b.unresolved.is_empty(),
        "{r:?}\n{a:?}\n{b:?}\n{:?}",
        o.doubts(r)
    );
    assert_eq!(a.roots.len(), b.roots.len(), "{r:?}\n{a:?}\n{b:?}");
    for (x, y) in a.roots.iter().zip(&b.roots) {
        assert!(
            x.lo <= y.hi && y.lo <= x.hi && x.multiplicity == y.multiplicity,
            "{x:?} {y:?}"
        );
        let ulp = x.hi.abs().next_up() - x.hi.abs();
        assert!(x.hi - x.lo <= (4.0 * ulp).max(1e-13 * x.hi.abs()), "{x:?}");
    }
    match (o.first(r).hit(), a.roots.first()) {
        (None, None) => {}
        (Some(h), Some(x)) => assert!(h.lo <= x.hi && x.lo <= h.hi && h.multiplicity == x.multiplicity),
        other => panic!("{other:?}"),
    }
    a.roots.iter().map(|r| (r.t(), r.multiplicity)).collect()
}

/// Roots at these t, crossings all.
pub(crate) fn expect(o: &Oracle, r: &Ray, want: &[f64]) {
    let got = roots(o, r);
    assert_eq!(got.len(), want.len(), "{got:?}, not {want:?}");
    for (g, w) in got.iter().zip(want) {
        assert!((g.0 - w).abs() <= 1e-14 * (1.0 + w.abs()), "{got:?}, not {want:?}");
        assert_eq!(g.1, Multiplicity::Simple);
    }
}

/// Whether the brackets of two oracles' roots go together one by one, up to `slack`.
pub(crate) fn together(a: &AllRoots, b: &AllRoots, slack: f64) -> bool {
    a.unresolved.is_empty()
        && b.unresolved.is_empty()
        && a.roots.len() == b.roots.len()
        && a.roots
            .iter()
            .zip(&b.roots)
            .all(|(x, y)| x.lo <= y.hi + slack && y.lo <= x.hi + slack)
}

/// A ray through the box [lo, hi] from outside it.
pub(crate) fn through(random: &mut Random, lo: DVec3, hi: DVec3) -> Ray {
    let target = lo + (hi - lo) * random.vector(0.0, 1.0);
    let from = 0.5 * (lo + hi) + random.vector(-1.0, 1.0).normalize() * (hi - lo).length() * 1.5;
    Ray {
        origin: from,
        direction: (target - from).normalize(),
    }
}

/// Where the ray enters and leaves: positions of an element, for tests that walk along it.
pub(crate) fn position(e: &HexElement, u: DVec3) -> DVec3 {
    evaluate_hex(e, u).position
}

pub(crate) fn towards(from: [f64; 3], to: [f64; 3]) -> Ray {
    ray(from, [to[0] - from[0], to[1] - from[1], to[2] - from[2]])
}
