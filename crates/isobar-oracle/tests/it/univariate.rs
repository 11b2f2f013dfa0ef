//! Hardcases A and planted polynomials.

use crate::support::{Random, list};
use isobar_oracle::{
    Decided, Multiplicity,
    univariate::{Coefficient, Form, bernstein_roots, roots},
};

/// A case: id, form, coefficients as exact text, interval, roots with multiplicity (0: a stretch), relative tolerance of the expected numbers.
type Case = (&'static str, Form, &'static str, (f64, f64), &'static [(f64, u32)], f64);

const ULP: f64 = 2.3e-16;

const CASES: &[Case] = &[
    (
        "A1",
        Form::Power,
        "-567/1562500 64161/6250000 -11727/100000 4523/6250 -10773/4000 63273/10000 -189/20 87/10 -9/2 1",
        (0.0, 1.0),
        &[
            (0.1, 1),
            (0.2, 1),
            (0.3, 1),
            (0.4, 1),
            (0.5, 1),
            (0.6, 1),
            (0.7, 1),
            (0.8, 1),
            (0.9, 1),
        ],
        ULP,
    ),
    (
        "A1 Bernstein",
        Form::Bernstein,
        "-362880 777760 -1339100 39937340/21 -47446720/21 47446720/21 -39937340/21 1339100 -777760 362880",
        (0.0, 1.0),
        &[
            (0.1, 1),
            (0.2, 1),
            (0.3, 1),
            (0.4, 1),
            (0.5, 1),
            (0.6, 1),
            (0.7, 1),
            (0.8, 1),
            (0.9, 1),
        ],
        ULP,
    ),
    ("A2", Form::Power, "-2/9 13/9 -8/3 1", (0.0, 1.0), &[(1.0 / 3.0, 2)], ULP),
    ("A3", Form::Power, "-1/8 3/4 -3/2 1", (0.0, 1.0), &[(0.5, 3)], 0.0),
    (
        "A4-",
        Form::Power,
        "0.249999999999 -1 1",
        (0.0, 1.0),
        &[(0.499999, 1), (0.500001, 1)],
        ULP,
    ),
    ("A4+", Form::Power, "0.250000000001 -1 1", (0.0, 1.0), &[], 0.0),
    (
        "A5",
        Form::Power,
        "-2 40 -200 0 0 0 0 0 0 1",
        (0.0, 1.0),
        &[(0.099_997_764_156_991_060_60, 1), (0.100_002_236_293_008_949_6, 1)],
        ULP,
    ),
    (
        "A6",
        Form::Power,
        "-2 400 -20000 0 0 0 0 0 0 1",
        (0.0, 1.0),
        &[(0.009_999_999_992_928_932_211, 1), (0.010_000_000_007_071_067_83, 1)],
        ULP,
    ),
    ("A7", Form::Bernstein, "1 -9/10 1", (0.0, 1.0), &[], 0.0),
    (
        "A7 degree 9",
        Form::Bernstein,
        "1 26/45 47/180 1/20 -1/18 -1/18 1/20 47/180 26/45 1",
        (0.0, 1.0),
        &[],
        0.0,
    ),
    ("A8", Form::Bernstein, "1 -1 1", (0.0, 1.0), &[(0.5, 2)], 0.0),
    (
        "A9",
        Form::Power,
        "0 1/2 -3/2 1",
        (0.0, 1.0),
        &[(0.0, 1), (0.5, 1), (1.0, 1)],
        0.0,
    ),
    (
        "A10",
        Form::Power,
        "2 -3 1 1e-18",
        (0.0, 3.0),
        &[(1.0, 1), (1.999_999_999_999_999_992, 1)],
        ULP,
    ),
    (
        "A10 far",
        Form::Power,
        "2 -3 1 1e-18",
        (-1e19, 3.0),
        &[(-1.000_000_000_000_000_003e18, 1), (1.0, 1), (2.0, 1)],
        ULP,
    ),
    (
        "A11",
        Form::Power,
        // T9(x) = 256x^9 - 576x^7 + 432x^5 - 120x^3 + 9x at x = 2t - 1
        "-1 162 -4320 44352 -228096 658944 -1118208 1105920 -589824 131072",
        (0.0, 1.0),
        &[
            (0.007_596_123_493_895_970, 1),
            (0.066_987_298_107_780_677, 1),
            (0.178_606_195_156_730_34, 1),
            (0.328_989_928_337_165_63, 1),
            (0.5, 1),
            (1.0 - 0.328_989_928_337_165_63, 1),
            (1.0 - 0.178_606_195_156_730_34, 1),
            (1.0 - 0.066_987_298_107_780_677, 1),
            (1.0 - 0.007_596_123_493_895_970, 1),
        ],
        1e-15,
    ),
    (
        "A12",
        Form::Power,
        // (t - e)(t - 1/2)(t - 1 + e), e = 1e-8: t^3 - 3/2 t^2 + (1/2 + e(1 - e)) t - e(1 - e)/2
        "-0.00000000499999995 0.5000000099999999 -1.5 1",
        (0.0, 1.0),
        &[(1e-8, 1), (0.5, 1), (1.0 - 1e-8, 1)],
        ULP,
    ),
    ("A13", Form::Power, "25.05 20.02 14.01 4 1", (-100.0, 100.0), &[], 0.0),
    (
        "A14",
        Form::Power,
        "26471900.25 -1325880 25449 -240 1",
        (0.0, 100.0),
        &[(50.645_112_696_944_666_58, 1), (69.354_887_303_055_333_42, 1)],
        ULP,
    ),
    (
        "A15",
        Form::Bernstein,
        "1 1 -4 5",
        (0.0, 1.0),
        &[(0.343_553_830_433, 1), (0.673_413_701_243, 1)],
        2e-12,
    ),
    ("A16", Form::Power, "0 0 0", (0.0, 1.0), &[(0.0, 0)], 0.0),
    (
        "A17",
        Form::Bernstein,
        // 1e6 + g - (1e6 + 5e-3), g from 0 to 1e-2
        "-0.005 0.005",
        (0.0, 1.0),
        &[(0.5, 1)],
        0.0,
    ),
];

fn exact(text: &str) -> Vec<Coefficient> {
    text.split_whitespace().map(|t| t.parse().unwrap()).collect()
}

#[test]
fn hardcases_a() {
    for (id, form, text, (lo, hi), want, tolerance) in CASES {
        let all = roots(*form, &exact(text), *lo, *hi).unwrap();
        let got = list(&all, 0.0);
        assert_eq!(got.len(), want.len(), "{id}: {got:?}");
        for (g, w) in got.iter().zip(*want) {
            assert!((g.0 - w.0).abs() <= tolerance * w.0.abs() && g.1 == w.1, "{id}: {got:?}");
        }
        for r in &all.roots {
            assert!(r.hi <= r.lo.next_up(), "{id}: {r:?}");
        }
        if *id == "A16" {
            assert_eq!(all.roots[0].interval_end, Some(1.0));
        }
    }
}

/// A15 has two further forms, of which the first root is given.
#[test]
fn hardcase_a15_variants() {
    for (text, want) in [("1 1 -5 5", 0.294_660_077_515), ("1 1 -5 6", 0.300_217_892_903)] {
        let r = roots(Form::Bernstein, &exact(text), 0.0, 1.0).unwrap().roots[0];
        assert!((r.t() - want).abs() < 1e-12 && r.multiplicity == Multiplicity::Simple);
    }
}

/// Split at 1/2, the closed halves both report the middle; the cells of a lattice are half open (see `cells`).
#[test]
fn hardcase_a9_split() {
    let c = exact("0 1/2 -3/2 1");
    let count = |a, b| roots(Form::Power, &c, a, b).unwrap().roots.len();
    assert_eq!((count(0.0, 0.5), count(0.5, 1.0), count(0.0, 1.0)), (2, 2, 3));
}

#[test]
fn numbers_are_read_exactly() {
    for (text, want) in [("-1.25e-2", "-1/80"), ("6/-4", "-3/2"), ("1e3", "1000/1"), (".5", "1/2")] {
        assert_eq!(text.parse::<Coefficient>().unwrap().to_string(), want);
    }
    for text in ["", "1/0", "x", "1e99999", "1.2.3", "nan"] {
        assert!(text.parse::<Coefficient>().is_err(), "{text}");
    }
    assert!(roots(Form::Power, &[], 0.0, 1.0).is_none());
    assert!(roots(Form::Power, &[1.into()], 1.0, 0.0).is_none());
    assert!(bernstein_roots(&[f64::NAN], 0.0, 1.0).is_none());
}

/// Products of (2^20 t - a)^m with quadratic factors that have no real root: the multiset of roots must come back.
#[test]
fn planted_roots_of_degree_3_and_9() {
    let mut random = Random(5);
    for n in 0..1500 {
        let degree = if n % 2 == 0 { 3 } else { 9 };
        let scale = 1i64 << 20;
        let mut planted: Vec<(i64, i64, u32)> = Vec::new(); // numerator, denominator, multiplicity
        let mut p: Vec<i128> = vec![1];
        let multiply = |p: &mut Vec<i128>, f: &[i128]| {
            let mut r = vec![0i128; p.len() + f.len() - 1];
            for (i, x) in p.iter().enumerate() {
                for (j, y) in f.iter().enumerate() {
                    r[i + j] += x * y;
                }
            }
            *p = r;
        };
        // Small integers for degree 9, so that the product stays within i128.
        let scale = if degree == 9 { 1 << 10 } else { scale };
        let mut left = degree;
        match n % 3 {
            0 => {
                planted.push((random.below(scale as u64) as i64, scale, 2));
                left -= 2;
            }
            1 => {
                planted.push((random.below(scale as u64) as i64, scale, 3));
                left -= 3;
            }
            _ => {
                // two roots 2^-50 apart (2^-10 for degree 9 beside others)
                let scale = if degree == 3 { 1i64 << 50 } else { scale };
                let a = random.below(scale as u64 - 1) as i64;
                planted.push((a, scale, 1));
                planted.push((a + 1, scale, 1));
                left -= 2;
            }
        }
        while left > 0 {
            if left >= 2 && random.below(2) == 0 {
                // (t - a)^2 + b, b > 0
                let (a, b) = (random.below(5) as i128 - 2, random.below(3) as i128 + 1);
                multiply(&mut p, &[a * a + b, -2 * a, 1]);
                left -= 2;
            } else {
                let a = random.below(scale as u64) as i64;
                if planted
                    .iter()
                    .all(|q| i128::from(q.0) * i128::from(scale) != i128::from(a) * i128::from(q.1))
                {
                    planted.push((a, scale, 1));
                    left -= 1;
                }
            }
        }
        for &(a, d, m) in &planted {
            for _ in 0..m {
                multiply(&mut p, &[-i128::from(a), i128::from(d)]);
            }
        }
        let c: Vec<Coefficient> = p.iter().map(|&v| Coefficient::new(v, 1).unwrap()).collect();
        let mut want: Vec<(f64, u32)> = planted.iter().map(|&(a, d, m)| (a as f64 / d as f64, m)).collect();
        want.sort_by(|a, b| a.0.total_cmp(&b.0));
        let all = roots(Form::Power, &c, 0.0, 1.0).unwrap();
        // The roots are dyadic and so are found exactly.
        assert!(all.roots.iter().all(|r| r.lo == r.hi));
        assert_eq!(list(&all, 0.0), want, "polynomial {n}");
    }
}

/// The three stages agree with integers alone, on random and on nearly tangent Bernstein polynomials.
#[test]
fn stages_agree_on_bernstein_polynomials() {
    let mut random = Random(77);
    let mut stages = [0; 3];
    for n in 0..3000 {
        let degree = [1, 2, 3, 6, 9][n % 5];
        let mut b: Vec<f64> = (0..=degree).map(|_| random.within(-1.0, 1.0)).collect();
        if n % 4 == 0 && degree >= 2 {
            // shift by a value taken inside, to within 1e-17..1e-9: near-tangents and near-ends
            let e = 10f64.powf(random.within(-17.0, -9.0));
            let x = b[degree / 2];
            b.iter_mut().for_each(|v| *v -= x);
            b[0] = if n % 8 == 0 { e } else { b[0] };
        }
        let staged = bernstein_roots(&b, -2.0, 3.0).unwrap();
        let c: Vec<Coefficient> = b.iter().map(|&v| Coefficient::from_f64(v).unwrap()).collect();
        let exact = roots(Form::Bernstein, &c, -2.0, 3.0).unwrap();
        assert_eq!(staged.roots.len(), exact.roots.len(), "{b:?}");
        for (s, e) in staged.roots.iter().zip(&exact.roots) {
            assert!(
                s.lo <= e.hi && e.lo <= s.hi && s.multiplicity == e.multiplicity,
                "{s:?} {e:?}"
            );
            assert!(s.hi - s.lo <= 4e-13);
        }
        stages[match staged.decided {
            Decided::F64 => 0,
            Decided::DoubleDouble => 1,
            Decided::Exact => 2,
        }] += 1;
    }
    assert!(stages[0] > 2200 && stages.iter().all(|&n| n > 0), "{stages:?}");
}
