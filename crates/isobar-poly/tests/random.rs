//! Random polynomials, every answer checked in exact arithmetic.

mod exact;

use exact::{Random, Verdict, check_all, check_first, check_first_by_sturm, widen};
use isobar_poly::{First, RootKind, Roots, Tolerance, all_roots, first_root, first_roots, packet, roots_of_packets};

const PER_DEGREE: usize = 100_000;

/// Counts what is not proved; panics on what is false.
fn flagged(v: Verdict) -> usize {
    match v {
        Verdict::Right => 0,
        Verdict::Flagged => 1,
        Verdict::Wrong(why) => panic!("{why}"),
    }
}

/// First root and all roots, in f64 and in f32 packets; brackets of the f32 ones as narrow as asked.
fn degree<const M: usize>() {
    let mut random = Random::new(M as u64);
    let (mut unsure, mut unsure_f32, mut wide) = (0, 0, 0);
    for _ in 0..PER_DEGREE / 16 {
        let b: [[f64; M]; 16] = std::array::from_fn(|_| std::array::from_fn(|_| random.signed24()));
        for b in &b {
            unsure += flagged(check_first(b, &first_root(b, &Tolerance::new(1e-6))));
            unsure += flagged(check_all(b, &all_roots(b, &Tolerance::new(1e-9))));
        }
        let input = [packet(&b.map(|p| p.map(|x| x as f32)))];
        let mut out = [[First::None; 16]];
        first_roots(&input, &Tolerance::new(1e-6), &mut out);
        for (b, a) in b.iter().zip(&out[0]) {
            unsure_f32 += flagged(check_first(b, &widen(a)));
        }
        let mut all = [[Roots::default(); 16]];
        roots_of_packets(&input, &Tolerance::new(1e-6), &mut all);
        for (b, a) in b.iter().zip(&all[0]) {
            unsure_f32 += flagged(check_all(b, a));
            let crossings = a.as_slice().iter().filter(|r| r.kind == RootKind::Crossing);
            wide += crossings.filter(|r| r.hi - r.lo > 1e-6).count();
        }
    }
    // Two roots, or a root and an end, within 1e-8 of each other (f64) or 1e-3 (f32).
    assert!(unsure <= 1, "{unsure} of {PER_DEGREE}");
    assert!(unsure_f32 <= 2 * PER_DEGREE / 1000, "{unsure_f32} of {PER_DEGREE}");
    // Roots that f32 coefficients with rounding errors from halving could not part.
    assert!(wide <= PER_DEGREE / 10_000, "{wide} of {PER_DEGREE}");
}

#[test]
fn degrees_1_to_3() {
    degree::<2>();
    degree::<3>();
    degree::<4>();
}

#[test]
fn degrees_4_to_6() {
    degree::<5>();
    degree::<6>();
    degree::<7>();
}

#[test]
fn degrees_7_to_8() {
    degree::<8>();
    degree::<9>();
}

#[test]
fn degree_9() {
    degree::<10>();
}

/// Small integers: exact zeros at 0, 1 and at cell corners, exact double roots; here the reference is Sturm's theorem alone.
#[test]
fn small_integers() {
    let mut random = Random::new(11);
    for k in 0..20_000 {
        let m = 1 + k % 10;
        let b: Vec<f64> = (0..m).map(|_| (random.bits() >> 40) as f64 % 5.0 - 2.0).collect();
        let first = first_root(&b, &Tolerance::new(1e-6));
        flagged(check_first_by_sturm(&b, &first));
        flagged(check_all(&b, &all_roots(&b, &Tolerance::new(1e-6))));
        let narrow: Vec<f32> = b.iter().map(|&x| x as f32).collect();
        flagged(check_first_by_sturm(&b, &widen(&first_root(&narrow, &Tolerance::new(1e-6)))));
    }
}

/// Degrees 10 to 27.
#[test]
fn high_degrees() {
    let mut random = Random::new(12);
    let mut unsure = 0;
    for k in 0..4_000 {
        let b: Vec<f64> = (0..11 + k % 18).map(|_| random.signed24()).collect();
        unsure += flagged(check_first(&b, &first_root(&b, &Tolerance::new(1e-9))));
        unsure += flagged(check_all(&b, &all_roots(&b, &Tolerance::new(1e-9))));
    }
    assert_eq!(unsure, 0);
}

/// The two references agree: the fast one (i128 subdivision) and Sturm's theorem.
#[test]
fn references_agree() {
    let mut random = Random::new(13);
    for k in 0..2_000 {
        let b: Vec<f64> = (0..2 + k % 12).map(|_| random.signed24()).collect();
        let cells = exact::quick_cells(&b, false).expect("short enough");
        let p = exact::Exact::new(&b);
        assert_eq!(cells.len(), p.distinct_roots(0.0, 1.0), "{b:?}");
        for (index, level) in cells {
            let w = 0.5f64.powi(level as i32);
            assert_eq!(p.distinct_roots(f64::from(index) * w, f64::from(index + 1) * w), 1, "{b:?}");
        }
    }
    // And a wrong answer is seen as one.
    let b = [1.0, -1.0, -1.0];
    assert!(matches!(check_first(&b, &First::None), Verdict::Wrong(_)));
    assert!(matches!(check_first_by_sturm(&b, &First::None), Verdict::Wrong(_)));
    let mut root = *first_root(&b, &Tolerance::new(1e-6)).root().expect("one root");
    root.lo = root.hi;
    root.hi = 1.0;
    assert!(matches!(check_first(&b, &First::Root(root)), Verdict::Wrong(_)));
}
