//! Properties of the forms and of the solvers on polynomials made to be difficult.

mod exact;

use exact::{Verdict, check_all, check_first};
use isobar_poly::{RootKind, Tolerance, all_roots, bernstein, first_root, power, scaled};
use proptest::prelude::*;

fn coefficients() -> impl Strategy<Value = Vec<f64>> {
    prop::collection::vec(-1.0..1.0f64, 1..29)
}

/// Bound used below: roundings are at most some n in sequence, on numbers up to `size`.
fn close(a: f64, b: f64, n: usize, size: f64) -> bool {
    (a - b).abs() <= 4.0 * (n as f64 + 1.0) * f64::EPSILON * size
}

/// A number and one within 32 ulps of it.
fn pair() -> impl Strategy<Value = (f64, f64)> {
    (1e-3..0.999f64, -32i64..=32).prop_map(|(x, k)| (x, f64::from_bits((x.to_bits() as i64 + k) as u64)))
}

/// The product of (t - r) over the roots, as Bernstein coefficients rounded several times: a root within a few ulps is not exactly there.
fn with_roots(roots: &[f64]) -> Vec<f64> {
    let mut s = vec![1.0];
    for &r in roots {
        let mut next = vec![0.0; s.len() + 1];
        scaled::multiply(&s, &[-r, 1.0 - r], &mut next);
        s = next;
    }
    scaled::to_bernstein(&mut s);
    s
}

proptest! {
    #[test]
    fn conversions_round_trip(b in coefficients()) {
        let n = b.len() - 1;
        let mut c = b.clone();
        bernstein::to_scaled(&mut c);
        scaled::to_bernstein(&mut c);
        prop_assert!(b.iter().zip(&c).all(|(x, y)| close(*x, *y, 1, 1.0)));
        // Through the power form numbers grow by up to 3^n; the way back is additions of the same size.
        bernstein::to_scaled(&mut c);
        scaled::to_power(&mut c);
        power::to_scaled(&mut c);
        scaled::to_bernstein(&mut c);
        let growth = 3f64.powi(n as i32) * 2f64.powi(n as i32);
        prop_assert!(b.iter().zip(&c).all(|(x, y)| close(*x, *y, n, growth)));
        let (mut p, mut q) = (b.clone(), b.clone());
        bernstein::to_power(&mut p);
        bernstein::to_scaled(&mut q);
        scaled::to_power(&mut q);
        prop_assert!(p.iter().zip(&q).all(|(x, y)| close(*x, *y, n, growth)));
    }

    #[test]
    fn forms_have_the_same_values(b in coefficients(), t in 0.0..=1.0f64) {
        let n = b.len() - 1;
        let value = bernstein::de_casteljau(&mut b.clone(), t);
        prop_assert!(close(bernstein::eval(&b, t), value, 4 * n, 1.0));
        let mut s = b.clone();
        bernstein::to_scaled(&mut s);
        prop_assert!(close(scaled::eval(&s, t), value, 4 * n, 1.0));
        let mut a = b.clone();
        bernstein::to_power(&mut a);
        prop_assert!(close(power::eval(&a, t), value, 2 * n, 3f64.powi(n as i32)));
        // The derivative, three ways.
        let (_, d) = bernstein::eval_with_derivative(&b, t);
        let size = 2.0 * n as f64;
        prop_assert!(close(d, bernstein::eval(bernstein::derivative(&mut b.clone()), t), 4 * n, size));
        let growth = size * 3f64.powi(n as i32);
        prop_assert!(close(d, power::eval_with_derivative(&a, t).1, 4 * n, growth));
        prop_assert!(close(d, power::eval(power::derivative(&mut a), t), 4 * n, growth));
    }

    #[test]
    fn parts_and_elevation_keep_the_polynomial(b in coefficients(), t in 0.0..=1.0f64, u in 0.0..=1.0f64, v in 0.0..=1.0f64) {
        let n = b.len() - 1;
        let (mut left, mut right) = (b.clone(), vec![0.0; n + 1]);
        bernstein::split(&mut left, t, &mut right);
        prop_assert!(close(bernstein::eval(&left, u), bernstein::eval(&b, t * u), 12 * n, 1.0 + n as f64));
        prop_assert!(close(bernstein::eval(&right, u), bernstein::eval(&b, t + (1.0 - t) * u), 12 * n, 1.0 + n as f64));
        // A part's hull lies in the whole's, and holds its values.
        let (lo, hi) = bernstein::hull(&b).expect("not empty");
        let (l, h) = bernstein::hull(&left).expect("not empty");
        let slack = 8.0 * (n as f64 + 1.0) * f64::EPSILON;
        prop_assert!(l >= lo - slack && h <= hi + slack);
        let value = bernstein::eval(&left, u);
        prop_assert!(value >= l - slack && value <= h + slack);
        let mut part = b.clone();
        let (from, to) = (t.min(v), t.max(v));
        bernstein::restrict(&mut part, from, to);
        let at = from + (to - from) * u;
        prop_assert!(close(bernstein::eval(&part, u), bernstein::eval(&b, at), 12 * n, 1.0 + n as f64));
        let mut up = b.clone();
        if n < 27 {
            up.push(0.0);
            bernstein::elevate(&mut up);
            prop_assert!(close(bernstein::eval(&up, u), bernstein::eval(&b, u), 8 * n, 1.0));
            prop_assert!(bernstein::variations(&up) <= bernstein::variations(&b));
        }
        let mut a = b.clone();
        bernstein::to_power(&mut a);
        let mut moved = a.clone();
        power::restrict(&mut moved, from, to);
        prop_assert!(close(power::eval(&moved, u), power::eval(&a, at), 16 * n, 6f64.powi(n as i32)));
    }

    #[test]
    fn products_in_scaled_form(a in prop::collection::vec(-1.0..1.0f64, 1..14), b in prop::collection::vec(-1.0..1.0f64, 1..14), t in 0.0..=1.0f64) {
        let mut out = vec![0.0; a.len() + b.len() - 1];
        scaled::multiply(&a, &b, &mut out);
        prop_assert!(close(scaled::eval(&out, t), scaled::eval(&a, t) * scaled::eval(&b, t), 8 * out.len(), 30.0));
    }

    /// Near double roots: two roots within 32 ulps, others anywhere. The rounded coefficients may have none, one or two there: whatever the
    /// exact truth, no claim may be false and something must be reported at the place.
    #[test]
    fn near_double_roots((r, s) in pair(), others in prop::collection::vec(-1.0..2.0f64, 0..8), error in prop::option::of(1e-15..1e-6f64)) {
        let roots: Vec<f64> = [r, s].into_iter().chain(others).collect();
        let b = with_roots(&roots);
        let tolerance = Tolerance { error: error.unwrap_or(0.0), ..Tolerance::new(1e-9) };
        let (first, all) = (first_root(&b, &tolerance), all_roots(&b, &tolerance));
        for v in [check_first(&b, &first), check_all(&b, &all)] {
            prop_assert!(!matches!(v, Verdict::Wrong(_)), "{:?}", v);
        }
        prop_assert_eq!(all.gave_up(), None);
        // The first root's own search ends at the same answer.
        prop_assert_eq!(first.root(), all.as_slice().first());
        let most = b.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
        let value = bernstein::eval(&b, r).abs().min(bernstein::eval(&b, s).abs());
        if value < f64::EPSILON * most {
            prop_assert!(all.as_slice().iter().any(|x| x.lo <= r.max(s) && r.min(s) <= x.hi), "{} {:?}", r, all.as_slice());
        }
    }

    /// Roots at cell corners of the subdivision, of any multiplicity, and at the ends.
    #[test]
    fn roots_at_dyadic_numbers(corners in prop::collection::vec((0u8..=16).prop_map(|k| f64::from(k) / 16.0), 1..9)) {
        let b = with_roots(&corners);
        let (first, all) = (first_root(&b, &Tolerance::new(1e-6)), all_roots(&b, &Tolerance::new(1e-6)));
        for v in [check_first(&b, &first), check_all(&b, &all)] {
            prop_assert!(!matches!(v, Verdict::Wrong(_)), "{:?}", v);
        }
    }

    /// `Tolerance::error`: what is proved for one polynomial holds for one within that distance.
    #[test]
    fn known_to_an_error(b in prop::collection::vec(-1.0..1.0f64, 2..10), shift in prop::collection::vec(-1.0..1.0f64, 10), error in 1e-12..1e-2f64) {
        let answer = first_root(&b, &Tolerance { error, ..Tolerance::new(1e-6) });
        // 0.99: rounding of the sum stays within the error.
        let other: Vec<f64> = b.iter().zip(&shift).map(|(x, s)| x + 0.99 * error * s).collect();
        let v = check_first(&other, &answer);
        prop_assert!(!matches!(v, Verdict::Wrong(_)), "{:?}", v);
    }
}

#[test]
fn multiplicities_are_told_by_parity() {
    for (multiplicity, kind) in [
        (1, RootKind::Crossing),
        (2, RootKind::Touching),
        (3, RootKind::Crossing),
        (4, RootKind::Touching),
    ] {
        // Power-of-two coefficients make (t - 1/4)^k exact.
        let b = with_roots(&[0.25; 4][..multiplicity]);
        let roots = all_roots(&b, &Tolerance::new(1e-6));
        let [root] = roots.as_slice() else { panic!("{roots:?}") };
        assert!(
            root.kind == kind && root.lo <= 0.25 && 0.25 <= root.hi,
            "{multiplicity} {root:?}"
        );
    }
}
