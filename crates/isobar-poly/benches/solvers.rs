//! Root finders on random Bernstein polynomials, beside public crates: ns per polynomial.
//!
//! Degree 9, coefficients uniform in [-1, 1), tolerance 1e-6 on [0, 1]. Every solver gets its input in its own form, converted
//! outside of the timed part (power coefficients, highest first for `rpoly`). Before timing, the numbers of roots are compared in this process.
//! Widths of our brackets are printed before. The f32 packets are also timed at 1e-4, where f32 alone reaches the width for most (no f64 step).
//! `first`: the first root. `all`: every root in [0, 1] (`rpoly`: every complex root on the plane; it cannot do less).

#[path = "../tests/exact/mod.rs"]
mod exact;

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use exact::{Random, Verdict, check_all, check_first};
use isobar_poly::{
    First, LANES, Level, Roots, Tolerance, all_roots, bernstein, first_root, first_roots_at, packet, roots_of_packets_at,
};
use std::hint::black_box;
use std::time::Duration;

const COUNT: usize = 4096;
const WIDTH: f64 = 1e-6;

fn polynomials<const M: usize>() -> Vec<[f64; M]> {
    let mut random = Random::new(2026);
    (0..COUNT).map(|_| std::array::from_fn(|_| random.signed24())).collect()
}

fn power<const M: usize>(b: &[[f64; M]]) -> Vec<[f64; M]> {
    b.iter()
        .map(|b| {
            let mut a = *b;
            bernstein::to_power(&mut a);
            a
        })
        .collect()
}

fn narrow<const M: usize>(b: &[[f64; M]]) -> Vec<[f32; M]> {
    b.iter().map(|b| b.map(|x| x as f32)).collect()
}

/// Times `f` over all polynomials; reported per polynomial.
fn time<P, R>(c: &mut Criterion, group: &str, name: &str, p: &[P], mut f: impl FnMut(&P) -> R) {
    let mut g = c.benchmark_group(group);
    g.throughput(Throughput::Elements(p.len() as u64));
    g.bench_function(name, |b| {
        b.iter(|| {
            for x in p {
                black_box(f(black_box(x)));
            }
        });
    });
    g.finish();
}

/// Exactly the number of distinct roots in [0, 1] for each polynomial (our f64 answer, proved right here).
fn verified<const M: usize>(b: &[[f64; M]]) -> Vec<usize> {
    b.iter()
        .map(|b| {
            let (first, all) = (first_root(b, &Tolerance::new(WIDTH)), all_roots(b, &Tolerance::new(WIDTH)));
            assert_eq!(check_first(b, &first), Verdict::Right);
            assert_eq!(check_all(b, &all), Verdict::Right);
            all.as_slice().len()
        })
        .collect()
}

/// How often a solver's number of roots is not the right one.
fn wrong<P>(name: &str, p: &[P], want: &[usize], f: impl Fn(&P) -> usize) {
    let wrong = p.iter().zip(want).filter(|(p, want)| f(p) != **want).count();
    println!("{name}: {wrong} of {} with a wrong number of roots in [0, 1]", p.len());
}

fn inside<'a>(roots: impl IntoIterator<Item = &'a f64>) -> usize {
    roots.into_iter().filter(|t| (0.0..=1.0).contains(*t)).count()
}

fn rpoly_real(a: &[f64; 10]) -> usize {
    rpoly::rpoly(a).map_or(0, |roots| {
        let real: Vec<f64> = roots.into_iter().filter(|z| z.im == 0.0).map(|z| z.re).collect();
        inside(&real)
    })
}

/// Prints how wide brackets are.
fn widths(name: &str, mut w: Vec<f32>) {
    w.sort_by(f32::total_cmp);
    let wide = w.iter().filter(|w| f64::from(**w) > WIDTH).count();
    println!(
        "{name}: {wide} of {} brackets wider than {WIDTH:e}, median {:.1e}, widest {:.1e}",
        w.len(),
        w[w.len() / 2],
        w[w.len() - 1]
    );
}

/// The packets' answers are those of the scalar f32 solver, and their widths and times.
fn in_packets(c: &mut Criterion, packets: &[[[f32; LANES]; 10]], b: &[[f32; 10]]) {
    let mut out = vec![[First::None; LANES]; packets.len()];
    let mut all = vec![[Roots::default(); LANES]; packets.len()];
    for width in [WIDTH as f32, 1e-4] {
        let t = Tolerance::new(width);
        for (name, level) in [("avx512", Level::Avx512), ("avx2", Level::Avx2), ("base", Level::Base)] {
            if level > Level::detect() {
                continue;
            }
            first_roots_at(level, packets, &t, &mut out);
            roots_of_packets_at(level, packets, &t, &mut all);
            for ((b, first), all) in b.iter().zip(out.iter().flatten()).zip(all.iter().flatten()) {
                assert_eq!(*first, first_root(b, &t));
                assert_eq!(all.as_slice(), all_roots(b, &t).as_slice());
            }
            if level == Level::detect() {
                let brackets = out.iter().flatten().filter_map(First::root).map(|r| r.hi - r.lo);
                widths(&format!("f32 packets asked for {width:e}"), brackets.collect());
            }
            for all_of_them in [false, true] {
                let group = if all_of_them { "degree-9-all" } else { "degree-9-first" };
                let mut g = c.benchmark_group(group);
                g.throughput(Throughput::Elements(COUNT as u64));
                let asked = if width > 1e-5 { "-to-1e-4" } else { "" };
                g.bench_function(format!("isobar-f32x16-{name}{asked}"), |bench| {
                    bench.iter(|| {
                        if all_of_them {
                            roots_of_packets_at(level, black_box(packets), &t, black_box(&mut all));
                        } else {
                            first_roots_at(level, black_box(packets), &t, black_box(&mut out));
                        }
                    });
                });
                g.finish();
            }
        }
    }
}

fn degree_9(c: &mut Criterion) {
    let b = polynomials::<10>();
    let (a, b32) = (power(&b), narrow(&b));
    let want = verified(&b);
    let cool: Vec<_> = a.iter().map(|a| poly_cool::Poly::new(*a)).collect();
    let falling: Vec<[f64; 10]> = a.iter().map(|a| std::array::from_fn(|i| a[9 - i])).collect();
    wrong("poly-cool", &cool, &want, |p| inside(&p.roots_between(0.0, 1.0, WIDTH)));
    wrong("rpoly", &falling, &want, rpoly_real);

    let (t64, t32) = (Tolerance::new(WIDTH), Tolerance::new(WIDTH as f32));
    time(c, "degree-9-first", "isobar-f64", &b, |b| first_root(b, &t64));
    time(c, "degree-9-first", "isobar-f32", &b32, |b| first_root(b, &t32));
    let packets: Vec<_> = b32
        .chunks_exact(LANES)
        .map(|p| packet::<10>(p.try_into().expect("16")))
        .collect();
    in_packets(c, &packets, &b32);
    time(c, "degree-9-all", "isobar-f64", &b, |b| all_roots(b, &t64));
    time(c, "degree-9-all", "isobar-f32", &b32, |b| all_roots(b, &t32));
    time(c, "degree-9-all", "poly-cool", &cool, |p| p.roots_between(0.0, 1.0, WIDTH));
    time(c, "degree-9-all", "rpoly", &falling, rpoly::rpoly);
}

fn degrees_3_and_4(c: &mut Criterion) {
    let t64 = Tolerance::new(WIDTH);
    let b = polynomials::<4>();
    let (a, want) = (power(&b), verified(&b));
    let kurbo = |a: &[f64; 4]| kurbo::common::solve_cubic(a[0], a[1], a[2], a[3]);
    wrong("kurbo cubic", &a, &want, |a| inside(&kurbo(a)));
    time(c, "degree-3-all", "isobar-f64", &b, |b| all_roots(b, &t64));
    time(c, "degree-3-all", "kurbo", &a, kurbo);

    let b = polynomials::<5>();
    let (a, want) = (power(&b), verified(&b));
    let kurbo = |a: &[f64; 5]| kurbo::common::solve_quartic(a[0], a[1], a[2], a[3], a[4]);
    wrong("kurbo quartic", &a, &want, |a| inside(&kurbo(a)));
    time(c, "degree-4-all", "isobar-f64", &b, |b| all_roots(b, &t64));
    time(c, "degree-4-all", "kurbo", &a, kurbo);
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(30).warm_up_time(Duration::from_secs(1)).measurement_time(Duration::from_secs(2));
    targets = degree_9, degrees_3_and_4
}
criterion_main!(benches);
