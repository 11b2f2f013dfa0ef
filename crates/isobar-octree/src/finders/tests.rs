//! What each finder does at an ample budget on easy polynomials, and the failures that are its own.

use super::*;
use isobar_oracle::univariate;

struct Random(u64);

impl Random {
    /// Uniform in [-1, 1), 24 bits.
    fn signed(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 40) as f32 / (1 << 23) as f32 - 1.0
    }
}

/// Bernstein coefficients, in f64, of the product of `t - r`.
fn with_roots<const M: usize>(roots: &[f64]) -> [f64; M] {
    let mut a = [0.0; M];
    a[0] = 1.0;
    for (n, r) in roots.iter().enumerate() {
        for i in (0..=n + 1).rev() {
            a[i] = if i > 0 { a[i - 1] } else { 0.0 } - r * a[i];
        }
    }
    isobar_poly::power::to_bernstein(&mut a);
    a
}

#[test]
fn well_parted_roots_are_found_by_all() {
    let b = with_roots::<4>(&[0.25, 0.6, 1.5]);
    for finder in Finder::THESIS.into_iter().chain([Finder::Robust { width: 1e-7 }]) {
        let Answer::Root(t) = finder.first(&b) else {
            panic!("{}", finder.label())
        };
        assert!((t - 0.25).abs() < 1e-6, "{} {t}", finder.label());
        let none = with_roots::<3>(&[-0.5, 1.5]);
        assert_eq!(finder.first(&none), Answer::None, "{}", finder.label());
    }
}

/// In f64 with a large budget Sturm's chain is right about random polynomials; the others lose or misplace very few, and there are such: a part
/// of the polygon that crosses without a root was preferred to the one with the root. Against certified roots.
#[test]
fn random_polynomials_at_ample_budgets() {
    let mut random = Random(5);
    let finders = Finder::with_budget(48);
    let mut wrong = [0; 4];
    let count = 2000;
    for _ in 0..count {
        let b: [f64; 10] = std::array::from_fn(|_| f64::from(random.signed()));
        let truth = univariate::bernstein_roots(&b, 0.0, 1.0).expect("finite");
        for (f, wrong) in finders.iter().zip(&mut wrong) {
            let right = match (f.first(&b), truth.roots.first()) {
                (Answer::None, None) => true,
                (Answer::Root(t), Some(r)) => (t - r.t()).abs() < 1e-6,
                _ => false,
            };
            *wrong += u32::from(!right);
        }
    }
    // aRFBS never comes back to the part it has discarded.
    assert_eq!(wrong, [0, 1, 3, 0], "LR81, MR07, aRFBS, Sturm");
}

/// Each doubling of the budget of a halving finder squares its accuracy, as far as f64 goes.
#[test]
fn errors_shrink_with_the_budget() {
    let b = with_roots::<4>(&[0.3, 1.25, 2.0]);
    for (budget, bound) in [(4, 0.04), (8, 3e-3), (16, 1e-5), (32, 1e-9)] {
        for finder in Finder::with_budget(budget) {
            let Answer::Root(t) = finder.first(&b) else {
                panic!("{}", finder.label())
            };
            assert!((t - 0.3).abs() <= bound, "{} {t}", finder.label());
        }
    }
}

#[test]
fn a_false_alarm_misleads_at_a_small_budget_only() {
    // hardcases A7: the polygon crosses twice, the least value is 1/20
    let b = [1.0, -0.9, 1.0f64];
    assert!(matches!(Finder::Lr81 { iterations: 1 }.first(&b), Answer::Root(_)));
    assert!(matches!(Finder::Mr07 { knots: 1 }.first(&b), Answer::Root(_)));
    for finder in Finder::THESIS {
        assert_eq!(finder.first(&b), Answer::None, "{}", finder.label());
    }
}

#[test]
fn close_roots_use_up_the_splits_of_arfbs_and_an_exact_double_root_is_lost() {
    let b = with_roots::<3>(&[0.3, 0.3001]);
    let arfbs = |splits| Finder::Arfbs { splits, iterations: 24 }.first(&b);
    assert_eq!(arfbs(2), Answer::GaveUp);
    assert!(matches!(arfbs(SPLITS), Answer::Root(t) if (t - 0.3).abs() < 1e-6));
    // hardcases A8: the first split hits the root, and zero is no crossing
    assert_eq!(Finder::THESIS[2].first(&[1.0, -1.0, 1.0f64]), Answer::None);
}

#[test]
fn a_root_on_a_shared_face_belongs_to_one_cell() {
    // p rises or falls through zero at the face: the left cell ends with 0, the right one begins with 0.
    for s in [1.0, -1.0f64] {
        let (left, right) = ([-s, -0.5 * s, 0.0], [0.0, 0.5 * s, s]);
        for finder in &Finder::THESIS[..3] {
            let hits = [finder.first(&left), finder.first(&right)]
                .iter()
                .filter(|a| matches!(a, Answer::Root(_)))
                .count();
            assert_eq!(hits, 1, "{} {s}", finder.label());
        }
    }
}

#[test]
fn a_zero_in_sturms_chain_is_no_change_lost() {
    // (t - 1/2)(t - 2) at t = 1/2: p = 0, p' < 0; and t^2 - 1/4 whose derivative is 0 at 0
    assert!((sturm(&[1.0, -2.5, 1.0f64], 30).unwrap() - 0.5).abs() < 1e-8);
    assert!((sturm(&[-0.25, 0.0, 1.0f64], 30).unwrap() - 0.5).abs() < 1e-8);
    // multiple roots are counted once
    assert!((sturm(&[0.25, -1.0, 1.0f64], 30).unwrap() - 0.5).abs() < 1e-8);
    assert_eq!(sturm(&[0.0f32; 4], 9), None);
    assert_eq!(sturm(&[3.0f32], 9), None);
}

#[test]
fn bad_input_is_no_panic() {
    for finder in Finder::THESIS.into_iter().chain([Finder::Robust { width: 1e-6 }]) {
        assert_eq!(finder.first::<f32>(&[]), Answer::GaveUp);
        assert_eq!(finder.first(&[1.0f32; 11]), Answer::GaveUp);
        for bad in [f32::NAN, f32::INFINITY, -f32::INFINITY, f32::MAX, 1e-45] {
            for at in 0..10 {
                let mut b = [-1.0f32, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0];
                b[at] = bad;
                let _ = finder.first(&b);
            }
        }
        let _ = finder.first(&[0.0f32; 10]);
    }
    for s in solvers() {
        assert!(
            matches!((s.first)(&[f64::NAN, 1.0]), First::GaveUp { .. } | First::None),
            "{}",
            s.name
        );
        assert!(matches!((s.first)(&[]), First::GaveUp { .. }), "{}", s.name);
    }
}
