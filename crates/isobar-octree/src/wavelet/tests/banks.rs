//! The six banks, exactly.

use super::dyadic::Dyadic;
use super::noise;
use crate::wavelet::transform::{analysis_rows, synthesis_rows};
use crate::wavelet::{Bank, Filter, Mirror, Number};

/// `sum taps[m] m^p`, or with alternating signs, over 2^log2.
fn moment(f: &Filter, p: u32, alternating: bool) -> i64 {
    (f.first..)
        .zip(f.taps)
        .map(|(m, &t)| i64::from(t) * i64::from(m).pow(p) * if alternating && m.rem_euclid(2) == 1 { -1 } else { 1 })
        .sum()
}

#[test]
fn sums_and_lengths_are_those_of_the_tables() {
    // Table 4.1: low, high, moments, pieces low, high.
    let table = [
        (3, 5, 2, 2, 6),
        (3, 9, 4, 2, 10),
        (4, 4, 1, 3, 6),
        (4, 8, 3, 3, 10),
        (5, 7, 2, 4, 10),
        (5, 11, 4, 4, 14),
    ];
    for (bank, row) in Bank::ALL.into_iter().zip(table) {
        let f = bank.filters();
        let found = (
            f.g0.taps.len(),
            f.g1.taps.len(),
            bank.moments().0,
            bank.pieces().0,
            bank.pieces().1,
        );
        assert_eq!(found, row, "{bank}");
        let one = |f: &Filter| 1i64 << f.log2;
        assert_eq!(moment(&f.g0, 0, false), 2 * one(&f.g0), "{bank}");
        assert_eq!(moment(&f.a0, 0, false), one(&f.a0), "{bank}");
        assert_eq!(moment(&f.a1, 0, true).abs(), one(&f.a1), "{bank}");
        assert_eq!(moment(&f.g1, 0, true).abs(), 2 * one(&f.g1), "{bank}");
    }
}

#[test]
fn scaling_functions_are_b_splines() {
    // The two-scale mask of the B-spline of degree d: binomial coefficients over 2^d.
    for bank in Bank::ALL {
        let d = bank.degree() as i64;
        let binomial = |k: i64| (0..k).fold(1, |b, j| b * (d + 1 - j) / (j + 1));
        let mask: Vec<i32> = (0..=d + 1).map(|k| binomial(k) as i32).collect();
        assert_eq!(
            (bank.filters().g0.taps, bank.filters().g0.log2 as i64),
            (&mask[..], d),
            "{bank}"
        );
    }
}

#[test]
fn moments_vanish_as_many_times_as_said_and_no_more() {
    for bank in Bank::ALL {
        let (synthesis, analysis) = bank.moments();
        for (filter, n) in [(&bank.filters().g1, synthesis), (&bank.filters().a1, analysis)] {
            for p in 0..n {
                assert_eq!(moment(filter, p as u32, false), 0, "{bank} {p}");
            }
            assert_ne!(moment(filter, n as u32, false), 0, "{bank}");
        }
    }
}

#[test]
fn reconstruction_is_perfect_for_every_length() {
    for bank in Bank::ALL {
        for n in 1..=40 {
            let s: Vec<Dyadic> = noise(n, n as u64).into_iter().map(|v| Dyadic::int(v.into())).collect();
            let apply = |rows: Vec<Vec<(usize, Dyadic)>>, line: &[Dyadic]| -> Vec<Dyadic> {
                rows.iter()
                    .map(|r| r.iter().fold(Dyadic::default(), |sum, &(i, w)| sum + w * line[i]))
                    .collect()
            };
            let slots = apply(analysis_rows(bank, n), &s);
            assert_eq!(apply(synthesis_rows(bank, n), &slots), s, "{bank} {n}");
        }
    }
}

#[test]
fn a_wrong_tap_would_be_seen() {
    // The print of psi2,4 has 4 where 6 is right: then the taps no longer cancel (maths: perfect reconstruction fails by 1/128).
    let right = Bank::Psi24.filters().a0;
    let printed = Filter {
        taps: &[3, -4, -16, 38, 90, 38, -16, -4, 3],
        ..right
    };
    assert_eq!(moment(&right, 0, false), 128);
    assert_ne!(moment(&printed, 0, false), 128);
}

#[test]
fn details_of_polynomials_vanish_inside() {
    for bank in Bank::ALL {
        let (_, analysis) = bank.moments();
        let n = 33;
        let line = |p: u32| -> Vec<Dyadic> { (0..n).map(|i: i64| Dyadic::int(i.pow(p))).collect() };
        let rows = analysis_rows::<Dyadic>(bank, n as usize);
        let detail = |line: &[Dyadic], slot: usize| rows[slot].iter().fold(Dyadic::default(), |sum, &(i, w)| sum + w * line[i]);
        for p in 0..analysis as u32 {
            assert_eq!(detail(&line(p), 15), Dyadic::default(), "{bank} {p}");
        }
        assert_ne!(detail(&line(analysis as u32), 15), Dyadic::default(), "{bank}");
    }
}

#[test]
fn mirrored_slots_are_those_of_the_mirrored_samples() {
    // Slots of the infinite symmetric extension, computed from samples, equal the mirrored slots.
    for bank in Bank::ALL {
        let f = bank.filters();
        for n in 1..20usize {
            let s: Vec<f64> = noise(n, 7 + n as u64).into_iter().map(f64::from).collect();
            let mirror: Mirror = bank.mirror();
            let slot = |i: isize| -> f64 {
                let filter = if i.rem_euclid(2) == 0 { &f.a0 } else { &f.a1 };
                let centre = i - i.rem_euclid(2);
                filter
                    .weights::<f64>()
                    .map(|(o, w)| w * s[mirror.sample(centre + o as isize, n)])
                    .sum()
            };
            for i in -30..50 {
                let folded = mirror.slot(i, n).map_or(0.0, |(j, negative)| {
                    assert!(j < n);
                    if negative { -slot(j as isize) } else { slot(j as isize) }
                });
                assert_eq!(folded, slot(i), "{bank} n={n} slot {i}");
            }
        }
    }
}

#[test]
fn responses_split_the_frequencies() {
    for bank in Bank::ALL {
        let ((l0, h0), (l1, h1)) = (bank.response(0.0), bank.response(std::f64::consts::PI));
        assert!((l0 - 2.0).abs() < 1e-12 && h0 < 1e-12, "{bank}");
        assert!(l1 < 1e-12 && (h1 - 2.0).abs() < 1e-12, "{bank}");
        assert_eq!(f32::dyadic(-3, 2), -0.75);
    }
}
