//! Exact polynomial pieces along rays, beside a naive evaluation of the B-spline, all in rational arithmetic.
//!
//! The pieces come from `Lattice::stencil` and the integer matrix of `Basis1`, composed with a rational ray. The naive value is
//! the sum of Cox-de Boor basis functions over all coefficients of a padded lattice, with the border rule written out once more.

mod common;

use common::{Random, byte_grid};
use isobar_core::{DVec3, Function, Interval, Lattice, Stage, Structure};
use isobar_fields::{Coefficients, GridSpline, Kind, Synthetic, analytic};
use num_bigint::BigInt;
use num_rational::BigRational;
use num_traits::{FromPrimitive, One, Zero};
use std::collections::BTreeMap;

type Q = BigRational;

fn q(n: i64, d: i64) -> Q {
    Q::new(BigInt::from(n), BigInt::from(d))
}

/// Cox-de Boor: the B-spline of degree `d` on the knots i, i+1, ... , at x.
fn cox_de_boor(d: usize, i: i64, x: &Q) -> Q {
    let knot = |n: i64| q(n, 1);
    if d == 0 {
        return if knot(i) <= *x && *x < knot(i + 1) {
            Q::one()
        } else {
            Q::zero()
        };
    }
    let d_i = d as i64;
    (x - knot(i)) / q(d_i, 1) * cox_de_boor(d - 1, i, x) + (knot(i + d_i + 1) - x) / q(d_i, 1) * cox_de_boor(d - 1, i + 1, x)
}

/// The coefficient with the (possibly outside) index, as the contract states the rule.
fn padded(s: &GridSpline, at: [i64; 3]) -> Q {
    let dims = s.dims();
    let mirror = s.kind().interpolates();
    let inside: [usize; 3] = std::array::from_fn(|a| {
        let last = dims[a] as i64 - 1;
        let mut i = at[a];
        while !(0..=last).contains(&i) {
            i = match (mirror, i < 0) {
                (true, true) => -i,
                (true, false) => 2 * last - i,
                (false, true) => 0,
                (false, false) => last,
            };
        }
        i as usize
    });
    let n = (inside[2] * dims[1] + inside[1]) * dims[0] + inside[0];
    Q::from_f64(match s.coefficients() {
        Coefficients::Samples(c) => c.get(n),
        Coefficients::F32(c) => f64::from(c[n]),
        Coefficients::F64(c) => c[n],
    })
    .unwrap()
}

/// s at a rational local point by the sum over all basis functions that can reach it.
fn naive(s: &GridSpline, u: &[Q; 3]) -> Q {
    let d = s.kind().basis().degree;
    // Sample i carries the B-spline centred on i: its first knot is i - (d + 1) / 2.
    let weights: [Vec<(i64, Q)>; 3] = std::array::from_fn(|a| {
        (-3..s.dims()[a] as i64 + 3)
            .map(|i| (i, cox_de_boor(d, 0, &(&u[a] - q(2 * i - d as i64 - 1, 2)))))
            .filter(|(_, w)| !w.is_zero())
            .collect()
    });
    let mut sum = Q::zero();
    for (k, wz) in &weights[2] {
        for (j, wy) in &weights[1] {
            for (i, wx) in &weights[0] {
                sum += wx * wy * wz * padded(s, [*i, *j, *k]);
            }
        }
    }
    sum
}

fn add(a: &mut Vec<Q>, b: &[Q]) {
    a.resize(a.len().max(b.len()), Q::zero());
    a.iter_mut().zip(b).for_each(|(a, b)| *a += b);
}

fn multiply(a: &[Q], b: &[Q]) -> Vec<Q> {
    let mut out = vec![Q::zero(); a.len() + b.len() - 1];
    for (i, x) in a.iter().enumerate() {
        for (j, y) in b.iter().enumerate() {
            out[i + j] += x * y;
        }
    }
    out
}

/// The polynomial of s(o + t d) on one cell, coefficients by rising powers of t.
fn along_ray(lattice: &dyn Lattice, cell: [usize; 3], o: &[Q; 3], d: &[Q; 3]) -> Vec<Q> {
    let basis = lattice.basis();
    let w = basis.degree + 1;
    let shift = if basis.centred { q(1, 2) } else { Q::zero() };
    let mut stencil = [0.0; 64];
    lattice.stencil(cell, &mut stencil);
    // weights[a][j]: the basis function j of axis a as a polynomial in t
    let weights: [Vec<Vec<Q>>; 3] = std::array::from_fn(|a| {
        let local = [&o[a] - q(cell[a] as i64, 1) + &shift, d[a].clone()];
        (0..w)
            .map(|j| {
                let mut power = vec![q(1, i64::from(basis.denominator))];
                let mut sum = vec![Q::zero()];
                for row in basis.matrix.iter().take(w) {
                    let term: Vec<Q> = power.iter().map(|p| p * q(i64::from(row[j]), 1)).collect();
                    add(&mut sum, &term);
                    power = multiply(&power, &local);
                }
                sum
            })
            .collect()
    });
    let mut sum = vec![Q::zero()];
    for k in 0..w {
        for j in 0..w {
            let yz = multiply(&weights[1][j], &weights[2][k]);
            let mut x = vec![Q::zero()];
            for i in 0..w {
                let c = Q::from_f64(stencil[(k * w + j) * w + i]).unwrap();
                let term: Vec<Q> = weights[0][i].iter().map(|p| p * &c).collect();
                add(&mut x, &term);
            }
            add(&mut sum, &multiply(&yz, &x));
        }
    }
    sum
}

fn at(p: &[Q], t: &Q) -> Q {
    p.iter().rev().fold(Q::zero(), |s, c| s * t + c)
}

/// A point in the cell (cut by the domain), rational.
fn point_in(cell: [usize; 3], s: &GridSpline, r: &mut Random) -> [Q; 3] {
    std::array::from_fn(|a| {
        let (mut lo, mut hi) = (q(cell[a] as i64, 1), q(cell[a] as i64 + 1, 1));
        if s.kind().basis().centred {
            lo = (lo - q(1, 2)).max(Q::zero());
            hi = (hi - q(1, 2)).min(q(s.dims()[a] as i64 - 1, 1));
        }
        let part = q(1 + (r.unit() * 96.0) as i64, 97);
        &lo + (hi - &lo) * part
    })
}

fn check(kind: Kind, stage: Stage, dims: [usize; 3], seed: u64, rays: usize) {
    let s = GridSpline::new(&byte_grid(dims, seed), kind, stage).unwrap();
    let Structure::Lattice(lattice) = s.structure() else {
        panic!("a grid spline is a lattice")
    };
    let mut r = Random(seed);
    let cells = lattice.cells();
    let corners: Vec<[usize; 3]> = (0..8)
        .map(|n| [0, 1, 2].map(|a| if n >> a & 1 == 0 { 0 } else { cells[a] - 1 }))
        .collect();
    for n in 0..rays {
        let cell = match corners.get(n) {
            Some(&c) => c,
            None => cells.map(|c| (r.unit() * c as f64) as usize),
        };
        // Both points lie in the cell, so all of the segment does.
        let (o, e) = (point_in(cell, &s, &mut r), point_in(cell, &s, &mut r));
        let d: [Q; 3] = std::array::from_fn(|a| &e[a] - &o[a]);
        let p = along_ray(lattice, cell, &o, &d);
        assert!(p.len() <= 3 * kind.basis().degree + 1);
        for t in [q(0, 1), q(2, 7), q(5, 9), q(1, 1)] {
            let u: [Q; 3] = std::array::from_fn(|a| &o[a] + &t * &d[a]);
            assert_eq!(at(&p, &t), naive(&s, &u), "{kind} {stage:?} cell {cell:?}");
        }
    }
}

#[test]
fn trilinear_pieces() {
    check(Kind::Trilinear, Stage::Stored, [4, 3, 5], 1, 60);
    check(Kind::Trilinear, Stage::Stored, [2, 2, 2], 2, 8);
}

#[test]
fn quadratic_pieces() {
    check(Kind::Quadratic, Stage::Stored, [4, 3, 5], 3, 40);
    check(Kind::Quadratic, Stage::Stored, [2, 2, 2], 4, 8);
    check(Kind::QuadraticInterpolating, Stage::Stored, [4, 3, 5], 5, 30);
    check(Kind::QuadraticInterpolating, Stage::Ideal, [2, 3, 2], 6, 12);
}

#[test]
fn cubic_pieces() {
    check(Kind::Cubic, Stage::Stored, [4, 3, 5], 7, 24);
    check(Kind::Cubic, Stage::Stored, [2, 2, 2], 8, 8);
    check(Kind::CubicInterpolating, Stage::Stored, [4, 3, 5], 9, 16);
    check(Kind::CubicInterpolating, Stage::Ideal, [2, 3, 2], 10, 10);
}

fn holds(e: Interval, v: &Q) -> bool {
    Q::from_f64(e.lo).unwrap() <= *v && *v <= Q::from_f64(e.hi).unwrap()
}

/// `value` and `gradient` in f64 beside the exact ones, and enclosures of points and of small boxes without any slack.
#[test]
fn values_are_near_the_exact_ones() {
    for kind in Kind::ALL {
        let s = GridSpline::new(&byte_grid([4, 3, 5], 21), kind, Stage::Stored).unwrap();
        let mut r = Random(31);
        for n in 0..40 {
            let mut u = r.point(s.domain().lo, s.domain().hi);
            if n % 4 == 0 {
                // On the faces between pieces, and one number beside them.
                u = (2.0 * u).round() / 2.0;
                u.x = if n % 8 == 0 {
                    u.x.next_down().max(0.0)
                } else {
                    u.x.next_up().min(3.0)
                };
            }
            let exact: [Q; 3] = std::array::from_fn(|a| Q::from_f64(u[a]).unwrap());
            let value = naive(&s, &exact);
            let e = Q::from_f64(s.value(u)).unwrap() - &value;
            // Coefficients reach about 27 * 255; a few ulps of that.
            assert!(e.clone().max(-e) < q(1, 100_000_000_000), "{kind} at {u}");
            let point = s.enclosure(u, u);
            assert!(holds(point, &value) && point.width() < 1e-10, "{kind} at {u}: {point:?}");
            let edge = DVec3::splat(2f64.powi(-(n % 40)));
            assert!(holds(s.enclosure(u - edge, u), &value), "{kind} below {u}");
            assert!(holds(s.enclosure(u, u + edge), &value), "{kind} above {u}");
            if n % 4 == 0 {
                // On a border the gradient is that of one side.
                continue;
            }
            let g = s.gradient(u);
            for a in 0..3 {
                // Pieces are cubic at most in each variable, so the central difference is exact but for the h^2 term.
                let h = q(1, 1 << 40);
                let mut moved = exact.clone();
                moved[a] = &exact[a] + &h;
                let up = naive(&s, &moved);
                moved[a] = &exact[a] - &h;
                let slope = (up - naive(&s, &moved)) / (q(2, 1) * h);
                let e = Q::from_f64(g[a]).unwrap() - slope;
                assert!(e.clone().max(-e) < q(1, 10_000_000), "{kind} gradient at {u}");
            }
        }
    }
}

/// Enclosures of the polynomial fields hold the exact value of the f64 polynomial.
#[test]
fn algebraic_enclosures_hold_the_exact_value() {
    let mut polynomials = 0;
    for name in Synthetic::NAMES {
        let f = analytic(name, &BTreeMap::new()).unwrap().function;
        let Structure::Polynomial(p) = f.structure() else { continue };
        polynomials += 1;
        let mut r = Random(77);
        for _ in 0..25 {
            let x = r.point(p.lo, p.hi);
            let exact: Q = p
                .terms
                .iter()
                .map(|(e, k)| {
                    (0..3).fold(Q::from_f64(*k).unwrap(), |v, a| {
                        v * num_traits::pow(Q::from_f64(x[a]).unwrap(), usize::from(e[a]))
                    })
                })
                .sum();
            let e = f.enclosure(x, x);
            assert!(holds(e, &exact) && e.width() < 1e-9, "{name} at {x}: {e:?}");
            let edge = DVec3::splat(r.unit());
            assert!(
                holds(f.enclosure(x - edge, x), &exact) && holds(f.enclosure(x, x + edge), &exact),
                "{name} at {x}"
            );
        }
    }
    assert_eq!(polynomials, 16);
}
