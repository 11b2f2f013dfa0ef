//! All in exact fractions: equal means equal.

use super::*;
use num_rational::BigRational;
use num_traits::{FromPrimitive, Zero};

impl Number for BigRational {
    fn whole(n: i64) -> Self {
        Self::from_i64(n).unwrap()
    }
}

type Q = BigRational;

fn q(n: i64, d: i64) -> Q {
    Q::whole(n) / Q::whole(d)
}

/// Value of a Bernstein form: the last point of the left part.
fn value(c: &[Q], t: &Q) -> Q {
    split(c, t).0.pop().unwrap()
}

/// Coefficients without pattern.
fn some(n: usize) -> Vec<Q> {
    (0..n as i64).map(|i| q(i * i * 7 % 11 - 4, 1 + i % 3)).collect()
}

#[test]
fn elevation_and_splitting_keep_the_polynomial() {
    for d in 0..6 {
        let c = some(d + 1);
        let up = elevate(&elevate(&c));
        assert_eq!(up.len(), d + 3);
        let (left, right) = split(&c, &q(2, 7));
        assert_eq!(left.last(), right.first());
        for i in 0..=5 {
            let t = q(i, 5);
            assert_eq!(value(&up, &t), value(&c, &t));
            assert_eq!(value(&left, &t), value(&c, &(t.clone() * q(2, 7))));
            assert_eq!(value(&right, &t), value(&c, &(q(2, 7) + t * q(5, 7))));
        }
    }
}

#[test]
fn monomials_are_blossomed() {
    let (lo, hi) = (q(-5, 4), q(3, 2));
    for d in 0..7 {
        for a in 0..=d {
            let c = monomial(a, d, &lo, &hi);
            let dc = derivative(&c);
            for i in 0..=4 {
                let t = q(i, 4);
                let x = lo.clone() + (hi.clone() - lo.clone()) * t.clone();
                let power = |n: usize| (0..n).fold(q(1, 1), |p, _| p * x.clone());
                assert_eq!(value(&c, &t), power(a), "x^{a} of degree {d}");
                let slope = if a == 0 {
                    q(0, 1)
                } else {
                    q(a as i64, 1) * power(a - 1) * (hi.clone() - lo.clone())
                };
                assert_eq!(value(&dc, &t), slope);
            }
        }
    }
}

#[test]
fn interpolation_goes_through_its_values() {
    let nodes = [q(0, 1), q(1, 5), q(1, 2), q(9, 10)];
    let v = some(4);
    let rows = interpolation(&nodes).unwrap();
    let c: Vec<Q> = rows
        .iter()
        .map(|r| r.iter().zip(&v).fold(Q::zero(), |s, (a, b)| s + a * b))
        .collect();
    for (x, v) in nodes.iter().zip(&v) {
        assert_eq!(value(&c, x), *v);
    }
    assert!(interpolation(&[q(1, 2), q(1, 2)]).is_none() && interpolation::<Q>(&[]).is_none());
    // The common cases by hand, and all of them against the general solution.
    assert_eq!(equidistant(1), Some((vec![vec![1, 0], vec![0, 1]], 1)));
    assert_eq!(equidistant(2), Some((vec![vec![2, 0, 0], vec![-1, 4, -1], vec![0, 0, 2]], 2)));
    for d in 1..=6 {
        let (whole, common) = equidistant(d).unwrap();
        let nodes: Vec<Q> = (0..=d as i64).map(|i| q(i, d as i64)).collect();
        for (a, b) in whole.iter().flatten().zip(interpolation(&nodes).unwrap().iter().flatten()) {
            assert_eq!(q(*a, common), *b);
        }
    }
    assert!(equidistant(7).is_none());
}

/// A knot vector with a double, a full and a more than full knot inside.
fn knots() -> Vec<Q> {
    [0, 0, 0, 0, 1, 2, 2, 3, 4, 4, 4, 6, 7, 7, 7, 7, 8, 9, 9, 9, 9]
        .map(|k| q(k, 1))
        .to_vec()
}

#[test]
fn extraction_is_knot_insertion_until_every_knot_is_full() {
    let (p, knots) = (3, knots());
    let control = some(knots.len() - p - 1);
    let (mut full, mut c) = (knots.clone(), control.clone());
    let mut distinct = knots.clone();
    distinct.dedup();
    for t in &distinct[1..distinct.len() - 1] {
        while full.iter().filter(|k| *k == t).count() < p {
            (full, c) = insert_knot(p, &full, &c, t).unwrap();
        }
    }
    let spans = spans(p, &knots).count();
    assert_eq!(spans, distinct.len() - 1);
    let e = extract(p, &knots, &control);
    assert_eq!(e.len(), spans * (p + 1));
    // Full knots: one coefficient per joint, two at the fourfold knot 7.
    let mut want = Vec::new();
    let mut at = 0;
    for k in 0..spans {
        want.extend_from_slice(&c[at..=at + p]);
        at += p + usize::from(distinct[k + 1] == q(7, 1));
    }
    assert_eq!(e, want);
    assert!(insert_knot(p, &knots, &control, &q(10, 1)).is_none() && insert_knot(p, &knots, &control, &q(-1, 1)).is_none());
}

#[test]
fn joints_are_the_same_number_in_f64() {
    let knots = [0.0, 0.0, 0.0, 0.1, 0.3, 0.7, 1.0, 1.0, 1.0];
    let control = [0.1, 0.7, -0.3, 0.9, 0.2, 0.4];
    let e = extract(2, &knots, &control);
    assert_eq!(e.len(), 12);
    for s in 1..4 {
        assert_eq!(e[3 * s].to_bits(), e[3 * s - 1].to_bits());
    }
    assert_eq!((e[0], e[11]), (0.1, 0.4));
}

#[test]
fn tensors_multiply_and_map() {
    let a = Tensor {
        counts: [3, 1, 2],
        values: some(6),
    };
    let b = Tensor {
        counts: [2, 2, 2],
        values: some(8),
    };
    let at = |t: &Tensor<Q>, u: [&Q; 3]| {
        (0..3)
            .fold(t.clone(), |t, axis| t.along(axis, |c| vec![value(c, u[axis])]))
            .values
            .pop()
            .unwrap()
    };
    let p = a.product(&b);
    assert_eq!(p.counts, [4, 2, 3]);
    for i in 0..20 {
        let u = [q(i, 19), q(i * 3 % 7, 7), q(i * 5 % 11, 10)];
        let u = u.each_ref();
        assert_eq!(at(&p, u), at(&a, u) * at(&b, u));
        assert_eq!(at(&a.along(1, elevate), u), at(&a, u));
    }
}
