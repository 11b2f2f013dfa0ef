//! Against the lattice's and the polynomial's oracles, which share no code with this one beyond arithmetic; and every root held against the data.

use super::{cuboid, element, net, oracle, roots, through, together};
use crate::support::{Random, Spline, ray};
use isobar_core::{Algebraic, Basis1, CUBIC, DVec3, HexElement, HexPatches, Lattice, QUADRATIC, TRILINEAR};
use isobar_fields::{AlgebraicFunction, HexField, algebraic_to_hexes, evaluate_hex};
use isobar_oracle::{Decided, Multiplicity, Oracle};
use std::sync::Arc;

/// The pieces of a lattice as cubes: power form to Bernstein form with the integers of the basis. Exact where the coefficients are small multiples of
/// the denominators' cube.
fn pieces(s: &Spline) -> Vec<HexElement> {
    let n = s.basis.degree + 1;
    let choose = |n: usize, k: usize| (0..k).fold(1.0, |c, i| c * (n - i) as f64 / (i + 1) as f64);
    // Times the denominator, in whole numbers: b_i = sum_k choose(i, k)/choose(d, k) p_k
    let row = |i: usize, j: usize| -> f64 {
        let sum: f64 = (0..=i)
            .map(|k| choose(i, k) / choose(n - 1, k) * f64::from(s.basis.matrix[k][j]))
            .sum();
        sum.round()
    };
    let denominator = f64::from(s.basis.denominator).powi(3);
    let cells = s.cells();
    let mut out = Vec::new();
    for cell in (0..cells.iter().product()).map(|c: usize| [c % cells[0], c / cells[0] % cells[1], c / cells[0] / cells[1]]) {
        let mut c = [0.0; 64];
        s.stencil(cell, &mut c);
        let values = net([n as u8 - 1; 3], |i| {
            let mut v = 0.0;
            for (m, c) in c[..n * n * n].iter().enumerate() {
                v += c * row(i[0], m % n) * row(i[1], m / n % n) * row(i[2], m / n / n);
            }
            [v / denominator, 0.0, 0.0, 0.0]
        });
        let lo = DVec3::from_array(cell.map(|c| c as f64 - if s.basis.centred { 0.5 } else { 0.0 }));
        out.push(cuboid(lo, lo + 1.0, [n as u8 - 1; 3], values.iter().map(|v| v[0]).collect()));
    }
    out
}

/// Both oracles on integers times `scale`, so that both functions are the same exactly: the same roots.
fn same(basis: &'static Basis1, scale: f64, rays: usize, seed: u64) {
    let mut random = Random(seed);
    let values: Vec<f64> = (0..125).map(|_| (random.below(17) as f64 - 8.0) * scale).collect();
    let at = |i: f64, j: f64, k: f64| values[(i + 5.0 * (j + 5.0 * k)) as usize];
    let spline = Spline::new([5; 3], basis, at);
    let c = 0.37 * scale;
    let mapped = oracle(pieces(&spline), c);
    let lattice = spline.oracle(c);
    let (mut found, mut first) = (0, 0);
    for _ in 0..rays {
        let r = through(&mut random, DVec3::ZERO, DVec3::splat(4.0));
        // Quadratic pieces are centred on samples: the outer ones reach beyond the lattice's domain.
        let inside = |t: f64| (r.at(t) - 2.0).abs().max_element() < 2.0 - 1e-9;
        let (mut a, b) = (mapped.all(&r), lattice.all(&r));
        if basis.centred {
            a.roots.retain(|x| inside(x.t()));
        }
        assert!(together(&a, &b, 0.0), "{r:?}\n{a:?}\n{b:?}");
        for (x, y) in a.roots.iter().zip(&b.roots) {
            assert!(x.multiplicity == y.multiplicity && (x.slope - y.slope).abs() <= 1e-6 * (scale + y.slope.abs()));
        }
        found += a.roots.len();
        if !basis.centred {
            let (h, g) = (mapped.first(&r), lattice.first(&r));
            assert!(h.hit().map(|h| h.lo) == a.roots.first().map(|x| x.lo) && h.hit().is_some() == g.hit().is_some());
            first += usize::from(h.hit().is_some());
            // Statistics both, by different means: the same but for borderline cases.
            assert_eq!(mapped.undecidable(&r), lattice.undecidable(&r), "{r:?}");
        }
    }
    assert!(found > rays && (basis.centred || first > rays / 2), "{found} {first}");
}

#[test]
fn trilinear_lattices_have_the_same_roots() {
    same(&TRILINEAR, 1.0, 50_000, 1);
}

#[test]
fn quadratic_lattices_have_the_same_roots() {
    same(&QUADRATIC, 8.0, 15_000, 2);
}

#[test]
fn cubic_lattices_have_the_same_roots() {
    same(&CUBIC, 216.0, 8000, 3);
}

/// D7: the teardrop as one element with identity geometry; the function is the same but for the rounding of coefficients.
#[test]
fn d7_the_teardrop_as_one_element() {
    let terms = [([5, 0, 0], 0.5), ([4, 0, 0], 0.5), ([0, 2, 0], -1.0), ([0, 0, 2], -1.0)];
    let p = Algebraic::new("teardrop", terms, DVec3::splat(-1.25), DVec3::splat(1.25)).unwrap();
    let patches = algebraic_to_hexes(&p).unwrap();
    let mapped = Oracle::new(Arc::new(HexField::new(&patches).unwrap()), 0.0);
    let polynomial = Oracle::new(Arc::new(AlgebraicFunction::new(p).unwrap()), 0.0);
    // C6
    for (x, want) in [(-0.1, 6.7082039324993691e-3), (-0.8, 0.20238577025077628)] {
        let got = roots(&mapped, &ray([x, 0.0, -1.0], [0.0, 0.0, 1.0]));
        assert_eq!(got.len(), 2);
        assert!(
            (got[0].0 - 1.0 + want).abs() < 1e-12 && (got[1].0 - 1.0 - want).abs() < 1e-12,
            "{got:?}"
        );
    }
    let mut random = Random(17);
    let mut found = 0;
    for _ in 0..8000 {
        let target = DVec3::new(random.within(-1.0, 0.3), random.within(-0.2, 0.2), random.within(-0.2, 0.2));
        let from = random.vector(-1.0, 1.0).normalize() * 4.0;
        let r = isobar_core::Ray {
            origin: from,
            direction: (target - from).normalize(),
        };
        let (a, b) = (mapped.all(&r), polynomial.all(&r));
        let flat = b.roots.iter().any(|x| x.slope.abs() < 1e-4);
        assert!(flat || together(&a, &b, 1e-10), "{r:?}\n{a:?}\n{b:?}");
        found += a.roots.len();
    }
    assert!(found > 5000, "{found}");
}

/// A polynomial map with terms that do not cancel, one to one for these coefficients; a tri-quadratic attribute.
fn deformed(random: &mut Random, fold: f64) -> HexElement {
    let points = net([2; 3], |i| {
        let p = DVec3::from_array(i.map(|v| v as f64 / 2.0)) + random.vector(-fold, fold);
        [p.x, p.y, p.z, random.within(0.5, 2.0)]
    });
    let values = (0..27).map(|_| random.within(-1.0, 1.0)).collect();
    let mut e = element([2; 3], points, [2; 3], values);
    e.rational_value = random.below(2) == 0;
    e
}

/// Every root: some u of the element lies there and has the value. And no root is missed that a fine walk in the parameters' cells sees: the three polynomials'
/// zeros by Newton's method in f64 from many starts.
fn held_against_the_data(fold: f64, elements: usize, rays: usize, seed: u64) -> usize {
    let mut random = Random(seed);
    let mut found = 0;
    for _ in 0..elements {
        let e = deformed(&mut random, fold);
        let c = random.within(-0.3, 0.3);
        let o = oracle(vec![e.clone()], c);
        let field = HexField::new(&HexPatches::new(vec![e.clone()]).unwrap()).unwrap();
        for _ in 0..rays {
            let r = through(&mut random, DVec3::splat(0.1), DVec3::splat(0.9));
            let all = o.all(&r);
            assert!(all.unresolved.is_empty(), "{r:?} {all:?} {:?}", o.doubts(&r));
            assert!(all.roots.iter().all(|x| x.multiplicity == Multiplicity::Simple));
            let seen = newton_from_everywhere(&e, c, &r);
            assert_eq!(seen.len(), all.roots.len(), "{r:?}\n{all:?}\n{seen:?}");
            for (x, t) in all.roots.iter().zip(&seen) {
                assert!((x.t() - t).abs() < 1e-9, "{x:?} {seen:?}");
            }
            if fold < 0.2 {
                // One to one: the inverse of the map is a function.
                for x in &all.roots {
                    let v = isobar_core::Function::value(&field, r.at(x.t()));
                    assert!((v - c).abs() < 1e-9, "{v} {c}");
                }
            }
            found += all.roots.len();
        }
    }
    found
}

/// All t of the ray, sorted: Newton's method for `x(u) - t d = o`, `a(u) = c` from 5^3 starts.
fn newton_from_everywhere(e: &HexElement, c: f64, r: &isobar_core::Ray) -> Vec<f64> {
    let mut out: Vec<(f64, DVec3)> = Vec::new();
    let side = r.direction.any_orthonormal_pair();
    for n in 0..125 {
        let mut u = DVec3::new((n % 5) as f64, (n / 5 % 5) as f64, (n / 25) as f64) * 0.25;
        for _ in 0..60 {
            let p = evaluate_hex(e, u);
            let off = p.position - r.origin;
            let f = DVec3::new(side.0.dot(off), side.1.dot(off), p.value - c);
            let j = isobar_core::DMat3::from_cols(
                p.jacobian.transpose() * side.0,
                p.jacobian.transpose() * side.1,
                p.parametric_gradient,
            )
            .transpose();
            let step = j.inverse() * f;
            if !step.is_finite() {
                break;
            }
            let step = step * (0.3 / step.length()).min(1.0);
            u -= step;
            if (u - 0.5).abs().max_element() > 1.5 {
                break;
            }
            if step.length() < 1e-14 {
                let t = (evaluate_hex(e, u).position - r.origin).dot(r.direction) / r.direction.length_squared();
                let inside = (u - 0.5).abs().max_element() <= 0.5;
                if inside && t >= 0.0 && out.iter().all(|o| (o.1 - u).length() > 1e-8) {
                    out.push((t, u));
                }
                break;
            }
        }
    }
    let mut t: Vec<f64> = out.into_iter().map(|o| o.0).collect();
    t.sort_by(f64::total_cmp);
    t
}

#[test]
fn deformed_elements_have_the_roots_of_their_data() {
    assert!(held_against_the_data(0.1, 30, 10, 23) > 150);
}

#[test]
fn folded_elements_have_the_roots_of_their_data() {
    assert!(held_against_the_data(0.5, 30, 10, 29) > 150);
}

/// Double-double alone, too.
#[test]
fn the_stages_agree() {
    let mut random = Random(41);
    for _ in 0..10 {
        let e = deformed(&mut random, 0.3);
        let o = oracle(vec![e], 0.1);
        let dd = o.with_stage(Decided::DoubleDouble);
        for _ in 0..6 {
            let r = through(&mut random, DVec3::splat(0.1), DVec3::splat(0.9));
            assert!(together(&o.all(&r), &dd.all(&r), 0.0));
        }
    }
}
