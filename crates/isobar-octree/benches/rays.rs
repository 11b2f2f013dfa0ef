//! The thesis's two inner loops, ns per ray: compositions (f32, degree 3 and 1; single rays, and packets of the recommended ones at each
//! instruction set), and root finders on random polynomials of degree 9 with the budgets of the thesis.
//!
//! What the timed code answers is compared first: packets with single rays bit for bit; answers of root finders are judged in the report.

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use isobar_cpu::Level;
use isobar_octree::compose::{Form, Lanes, Packet, WIDTH, axis_packets, axis_segment_packets, compose};
use isobar_octree::finders::{Finder, power_form, sturm};
use std::hint::black_box;
use std::time::Duration;

/// Rays per iteration: their cells and results stay in the nearest cache.
const COUNT: usize = 128;

/// Polynomials per iteration: too many for branches to be learnt.
const POLYNOMIALS: usize = 1024;

/// splitmix64.
struct Random(u64);

impl Random {
    fn unit(&mut self) -> f32 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 40) as f32 / (1 << 24) as f32
    }
    fn signed(&mut self) -> f32 {
        2.0 * self.unit() - 1.0
    }
}

fn compositions<const D: usize>(c: &mut Criterion) {
    let mut random = Random(2010);
    let (n, m) = ((D + 1).pow(3), 3 * D + 1);
    let cells: Vec<Lanes<WIDTH>> = (0..COUNT / WIDTH * n)
        .map(|_| Lanes(std::array::from_fn(|_| random.signed())))
        .collect();
    let mut lanes = || Lanes(std::array::from_fn(|_| random.unit()));
    let mut pair = || [lanes(), lanes()];
    let packets: Vec<Packet<'_>> = (cells.chunks(n))
        .map(|cells| Packet {
            cells,
            rays: [pair(), pair()],
            stretch: pair(),
        })
        .collect();
    let single: Vec<(Vec<f32>, [[f32; 2]; 3])> = packets
        .iter()
        .flat_map(|p| {
            (0..WIDTH).map(|l| {
                let f = p.cells.iter().map(|c| c.0[l]).collect();
                (f, [p.rays[0], p.rays[1], p.stretch].map(|r| r.map(|x| x.0[l])))
            })
        })
        .collect();
    let mut group = c.benchmark_group(format!("compose-degree-{D}"));
    group.throughput(Throughput::Elements(COUNT as u64));
    for form in Form::ALL {
        let mut out = vec![0.0f32; COUNT * m];
        group.bench_function(form.name(), |b| {
            b.iter(|| {
                for ((f, r), out) in black_box(&single).iter().zip(out.chunks_exact_mut(m)) {
                    compose::<f32, D>(form, f, r, out);
                }
                black_box(&mut out);
            });
        });
        let compose_packets = match form {
            Form::Axis => axis_packets::<D>,
            Form::AxisSegment => axis_segment_packets::<D>,
            _ => continue,
        };
        for level in Level::ALL.into_iter().filter(|l| l.is_available()) {
            let mut wide = vec![Lanes::splat(0.0); COUNT / WIDTH * m];
            group.bench_function(format!("{} packets {level}", form.name()), |b| {
                b.iter(|| compose_packets(level, black_box(&packets), black_box(&mut wide)));
            });
            for (i, one) in out.chunks_exact(m).enumerate() {
                let packet = &wide[i / WIDTH * m..][..m];
                let same = one.iter().zip(packet).all(|(x, p)| *x == p.0[i % WIDTH]);
                assert!(same, "{} {level}", form.name());
            }
        }
    }
    group.finish();
}

fn finders(c: &mut Criterion) {
    let mut random = Random(9);
    let polynomials: Vec<[f32; 10]> = (0..POLYNOMIALS).map(|_| std::array::from_fn(|_| random.signed())).collect();
    let powers: Vec<[f32; 10]> = polynomials.iter().map(power_form).collect();
    let mut group = c.benchmark_group("finders-degree-9");
    group.throughput(Throughput::Elements(POLYNOMIALS as u64));
    let budgets = [7, 24].into_iter().flat_map(Finder::with_budget);
    for finder in budgets.chain([Finder::Robust { width: 1e-6 }]) {
        group.bench_function(finder.label(), |b| {
            b.iter(|| match finder {
                // As in the thesis, whose compositions give it the power form.
                Finder::Sturm { halvings } => {
                    for p in black_box(&powers) {
                        black_box(sturm(p, halvings));
                    }
                }
                _ => {
                    for p in black_box(&polynomials) {
                        black_box(finder.first_of(p));
                    }
                }
            });
        });
    }
    group.finish();
}

fn all(c: &mut Criterion) {
    compositions::<3>(c);
    compositions::<1>(c);
    finders(c);
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(15).warm_up_time(Duration::from_millis(200)).measurement_time(Duration::from_millis(400));
    targets = all
}
criterion_main!(benches);
