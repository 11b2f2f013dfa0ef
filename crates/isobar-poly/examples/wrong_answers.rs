//! Counts wrong answers: random Bernstein polynomials of degree 9, every answer checked in exact arithmetic.
//!
//! `cargo run --release -p isobar-poly --example wrong_answers [COUNT] [SEED]`, COUNT 10000000 by default.

#[path = "../tests/exact/mod.rs"]
mod exact;

use exact::{Answer, Random, Verdict, check_all, check_first, widen};
use isobar_poly::{First, LANES, Root, RootKind, Roots, Tolerance, all_roots, first_root, first_roots, packet, roots_of_packets};
use std::thread;
use std::time::Instant;

const DEGREE: usize = 9;
const WIDTH: f64 = 1e-6;

/// What one solver answered.
#[derive(Default)]
struct Tally {
    none: u64,
    root: u64,
    /// Touching or gave up: true, but not decided.
    undecided: u64,
    wrong: u64,
    /// Brackets wider than asked for, and the widest.
    wide: u64,
    widest: f64,
    /// The first few wrong ones.
    examples: Vec<String>,
}

impl Tally {
    fn count(&mut self, b: &[f64], answer: &First<f64>) {
        self.judge(check_first(b, answer), answer.root().into_iter().copied().collect());
    }

    fn count_all(&mut self, b: &[f64], answer: Answer) {
        let roots = answer.roots.clone();
        self.judge(check_all(b, answer), roots);
    }

    fn judge(&mut self, verdict: Verdict, roots: Vec<Root<f64>>) {
        match verdict {
            Verdict::Wrong(why) => {
                self.wrong += 1;
                self.examples.push(why);
                self.examples.truncate(5);
                return;
            }
            Verdict::Flagged => self.undecided += 1,
            Verdict::Right if roots.is_empty() => self.none += 1,
            Verdict::Right => self.root += 1,
        }
        for r in roots.iter().filter(|r| r.kind == RootKind::Crossing) {
            self.wide += u64::from(r.hi - r.lo > WIDTH);
            self.widest = self.widest.max(r.hi - r.lo);
        }
    }

    fn add(&mut self, o: Self) {
        self.none += o.none;
        self.root += o.root;
        self.undecided += o.undecided;
        self.wrong += o.wrong;
        self.wide += o.wide;
        self.widest = self.widest.max(o.widest);
        self.examples.extend(o.examples);
    }
}

fn work(packets: u64, seed: u64) -> [Tally; 4] {
    let mut random = Random::new(seed);
    let mut tallies: [Tally; 4] = Default::default();
    for _ in 0..packets {
        // 24 bits, so that both solvers see the same polynomials.
        let b: [[f64; DEGREE + 1]; LANES] = std::array::from_fn(|_| std::array::from_fn(|_| random.signed24()));
        let input = [packet(&b.map(|p| p.map(|x| x as f32)))];
        let (mut first, mut all) = ([[First::None; LANES]], [[Roots::default(); LANES]]);
        first_roots(&input, &Tolerance::new(WIDTH as f32), &mut first);
        roots_of_packets(&input, &Tolerance::new(WIDTH as f32), &mut all);
        for ((b, first), all) in b.iter().zip(&first[0]).zip(&all[0]) {
            tallies[0].count(b, &first_root(b, &Tolerance::new(WIDTH)));
            tallies[1].count(b, &widen(first));
            tallies[2].count_all(b, (&all_roots(b, &Tolerance::new(WIDTH))).into());
            tallies[3].count_all(b, all.into());
        }
    }
    tallies
}

fn main() {
    let mut arguments = std::env::args().skip(1);
    let mut number = |default: u64| arguments.next().map_or(Some(default), |a| a.parse().ok());
    let (Some(count), Some(seed)) = (number(10_000_000), number(1)) else {
        eprintln!("usage: wrong_answers [COUNT] [SEED], both whole numbers");
        std::process::exit(2);
    };
    let start = Instant::now();
    let threads = thread::available_parallelism().map_or(1, |n| n.get() as u64);
    let packets = count.div_ceil(LANES as u64 * threads);
    let mut total: [Tally; 4] = Default::default();
    thread::scope(|scope| {
        let parts: Vec<_> = (0..threads)
            .map(|k| scope.spawn(move || work(packets, seed * 1000 + k)))
            .collect();
        for part in parts {
            for (t, p) in total.iter_mut().zip(part.join().expect("a worker's panic is shown")) {
                t.add(p);
            }
        }
    });
    let all = packets * threads * LANES as u64;
    println!(
        "{all} polynomials of degree {DEGREE}, seed {seed}, tolerance {WIDTH:e}, {:.0} s",
        start.elapsed().as_secs_f64()
    );
    println!("| solver | no root | root | undecided | wrong | wider than asked | widest |\n|---|---|---|---|---|---|---|");
    let names = ["first, f64", "first, f32 packets", "all, f64", "all, f32 packets"];
    for (name, t) in names.iter().zip(&total) {
        println!(
            "| {name} | {} | {} | {} | {} | {} | {:.1e} |",
            t.none, t.root, t.undecided, t.wrong, t.wide, t.widest
        );
        t.examples.iter().for_each(|e| println!("wrong: {e}"));
    }
    std::process::exit(i32::from(total.iter().any(|t| t.wrong > 0)));
}
