//! Packets against the scalar f32 solver: the same bits, at every level of instructions, for every kind of polynomial.

mod exact;

use exact::Random;
use isobar_poly::{First, LANES, Level, Roots, Tolerance, all_roots, first_root, first_roots_at, packet, roots_of_packets_at};

/// Bits of an answer: `==` would let -0 pass for 0.
fn bits(a: &First<f32>) -> [u32; 5] {
    match a {
        First::None => [0; 5],
        First::Root(r) => [1, r.lo.to_bits(), r.hi.to_bits(), r.t.to_bits(), r.kind as u32],
        First::GaveUp { at } => [2, at.to_bits(), 0, 0, 0],
    }
}

fn all_bits(a: &Roots<f32>) -> Vec<[u32; 5]> {
    let end = a.gave_up().map(|at| First::GaveUp { at });
    a.as_slice()
        .iter()
        .map(|r| bits(&First::Root(*r)))
        .chain(end.iter().map(bits))
        .collect()
}

fn compare<const M: usize>(mut next: impl FnMut() -> f32, packets: usize, tolerance: &Tolerance<f32>) {
    let polynomials: Vec<[[f32; M]; LANES]> = (0..packets)
        .map(|_| std::array::from_fn(|_| std::array::from_fn(|_| next())))
        .collect();
    let input: Vec<_> = polynomials.iter().map(packet).collect();
    for level in [Level::Base, Level::Avx2, Level::Avx512] {
        let mut out = vec![[First::None; LANES]; packets];
        first_roots_at(level, &input, tolerance, &mut out);
        for (p, a) in polynomials.iter().flatten().zip(out.iter().flatten()) {
            assert_eq!(bits(a), bits(&first_root(p, tolerance)), "{level:?} {p:?}");
        }
        // What the places held before does not matter.
        let mut out = vec![[all_roots(&[-1.0, 1.0], tolerance); LANES]; packets];
        roots_of_packets_at(level, &input, tolerance, &mut out);
        for (p, a) in polynomials.iter().flatten().zip(out.iter().flatten()) {
            assert_eq!(all_bits(a), all_bits(&all_roots(p, tolerance)), "{level:?} {p:?}");
        }
    }
}

fn all_kinds<const M: usize>() {
    let mut random = Random::new(M as u64);
    let wide = Tolerance::new(1e-6);
    compare::<M>(|| random.signed24() as f32, 300, &wide);
    compare::<M>(|| random.signed24() as f32, 30, &Tolerance::new(0.0));
    compare::<M>(|| random.signed24() as f32, 30, &Tolerance::new(0.3));
    compare::<M>(|| random.signed24() as f32, 30, &Tolerance { error: 1e-3, ..wide });
    compare::<M>(|| random.signed24() as f32, 30, &Tolerance { error: f32::NAN, ..wide });
    compare::<M>(|| random.signed24() as f32, 30, &Tolerance { splits: 3, ..wide });
    // Exact zeros, double roots, cell corners.
    compare::<M>(|| (random.bits() >> 40) as f32 % 5.0 - 2.0, 100, &wide);
    // Extreme sizes, subnormal numbers, infinities and NaN.
    let extreme = [
        0.0,
        -0.0,
        1.0,
        -1.0,
        3e38,
        -3e38,
        1e-45,
        -1e-40,
        f32::INFINITY,
        f32::NAN,
        0.5,
        -2.0,
        7.0,
        -1e-6,
        1e30,
        -1e-30,
    ];
    compare::<M>(|| extreme[(random.bits() >> 60) as usize], 100, &wide);
    compare::<M>(|| random.signed24() as f32 * 1e-38, 30, &wide);
    compare::<M>(|| random.signed24() as f32 * 3e38, 30, &wide);
}

#[test]
fn degrees_1_to_5() {
    all_kinds::<2>();
    all_kinds::<3>();
    all_kinds::<4>();
    all_kinds::<5>();
    all_kinds::<6>();
}

#[test]
fn degrees_6_to_9() {
    all_kinds::<7>();
    all_kinds::<8>();
    all_kinds::<9>();
    all_kinds::<10>();
}

#[test]
fn other_degrees() {
    all_kinds::<1>();
    all_kinds::<16>();
    all_kinds::<28>();
    all_kinds::<29>();
}
