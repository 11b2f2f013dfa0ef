//! Least time per polynomial over many short runs: what the processor can do, also on a machine that is shared.
//!
//! `cargo run --release -p isobar-poly --example best_times`. Same inputs as the bench `solvers` (which gives medians and the
//! statistics); answers are checked by the tests and by the example `wrong_answers`.

#[path = "../tests/exact/mod.rs"]
mod exact;

use exact::Random;
use isobar_poly::{
    First, LANES, Level, Roots, Tolerance, all_roots, bernstein, first_root, first_roots_at, packet, roots_of_packets_at,
};
use std::hint::black_box;
use std::time::Instant;

const COUNT: usize = 4096;
const RUNS: usize = 200;

/// Prints the least time of one call of `f`, per polynomial.
fn best(name: &str, mut f: impl FnMut()) {
    let least = (0..RUNS)
        .map(|_| {
            let start = Instant::now();
            f();
            start.elapsed()
        })
        .min()
        .unwrap_or_default();
    println!("| {name} | {:.0} ns |", least.as_nanos() as f64 / COUNT as f64);
}

fn over<P, R>(p: &[P], f: impl Fn(&P) -> R) {
    for x in p {
        black_box(f(black_box(x)));
    }
}

fn main() {
    let mut random = Random::new(2026);
    let b: Vec<[f64; 10]> = (0..COUNT).map(|_| std::array::from_fn(|_| random.signed24())).collect();
    let b32: Vec<[f32; 10]> = b.iter().map(|b| b.map(|x| x as f32)).collect();
    let packets: Vec<_> = b32
        .chunks_exact(LANES)
        .map(|p| packet::<10>(p.try_into().expect("whole packets")))
        .collect();
    let a: Vec<[f64; 10]> = b
        .iter()
        .map(|b| {
            let mut a = *b;
            bernstein::to_power(&mut a);
            a
        })
        .collect();
    let cool: Vec<_> = a.iter().map(|a| poly_cool::Poly::new(*a)).collect();
    let falling: Vec<[f64; 10]> = a.iter().map(|a| std::array::from_fn(|i| a[9 - i])).collect();
    let (t64, t32) = (Tolerance::new(1e-6), Tolerance::new(1e-6f32));
    println!("| degree 9, to 1e-6 | least of {RUNS} runs |\n|---|---|");
    best("first root, f64", || over(&b, |b| first_root(b, &t64)));
    best("first root, f32", || over(&b32, |b| first_root(b, &t32)));
    let mut out = vec![[First::None; LANES]; packets.len()];
    let mut all = vec![[Roots::default(); LANES]; packets.len()];
    for level in [Level::Avx512, Level::Avx2, Level::Base] {
        for width in [1e-6f32, 1e-4] {
            if level <= Level::detect() {
                let t = Tolerance::new(width);
                best(&format!("first root, f32 packets, {level:?}, to {width:e}"), || {
                    first_roots_at(level, black_box(&packets), &t, black_box(&mut out))
                });
                best(&format!("all roots, f32 packets, {level:?}, to {width:e}"), || {
                    roots_of_packets_at(level, black_box(&packets), &t, black_box(&mut all))
                });
            }
        }
    }
    best("all roots, f64", || over(&b, |b| all_roots(b, &t64)));
    best("all roots, f32", || over(&b32, |b| all_roots(b, &t32)));
    best("all roots, poly-cool", || over(&cool, |p| p.roots_between(0.0, 1.0, 1e-6)));
    best("all complex roots, rpoly", || over(&falling, rpoly::rpoly));
    for degree in [12, 18, 27] {
        let b: Vec<Vec<f64>> = (0..COUNT)
            .map(|_| (0..=degree).map(|_| random.signed24()).collect())
            .collect();
        best(&format!("degree {degree}, first root, f64"), || {
            over(&b, |b| first_root(b, &t64))
        });
        best(&format!("degree {degree}, all roots, f64"), || {
            over(&b, |b| all_roots(b, &t64))
        });
    }
}
