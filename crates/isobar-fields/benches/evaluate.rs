//! Time per value, gradient and enclosure of each reconstruction and of some fields, and of the prefilter at 128^3.

use criterion::{BenchmarkId, Criterion, Throughput, criterion_group, criterion_main};
use isobar_core::{DVec3, Data, Function, Grid, Interval, Lattice, Ray, Samples, Stage, Structure};
use isobar_fields::{GridSpline, Kind, Synthetic, analytic};
use std::collections::BTreeMap;
use std::hint::black_box;
use std::time::Duration;

/// Points per iteration.
const POINTS: usize = 4096;

/// Seeded points along short rays (neighbours are near one another, as in rendering).
fn points(lo: DVec3, hi: DVec3) -> Vec<DVec3> {
    let mut seed = 5u64;
    let mut next = || {
        seed = seed
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (seed >> 11) as f64 / (1u64 << 53) as f64
    };
    (0..POINTS / 64)
        .flat_map(|_| {
            let mut end = || lo + (hi - lo) * DVec3::new(next(), next(), next());
            let (a, b) = (end(), end());
            (0..64).map(move |n| a.lerp(b, f64::from(n) / 64.0))
        })
        .collect()
}

fn gyroid() -> Grid {
    let Ok(Data::Grid(grid)) = "gyroid,n=128".parse::<Synthetic>().and_then(|s| s.data()) else {
        unreachable!("the text names a grid")
    };
    grid
}

/// The gyroid scaled to bytes.
fn bytes(grid: &Grid) -> Grid {
    let s: Vec<u8> = (0..grid.samples.len())
        .map(|i| (127.5 + 80.0 * grid.samples.get(i)) as u8)
        .collect();
    Grid::new(grid.dims, grid.spacing, grid.origin, grid.direction, Samples::U8(s.into())).expect("the geometry is the same")
}

fn functions(c: &mut Criterion, group: &str, f: &dyn Function, name: &str) {
    let d = f.domain();
    let x = points(d.world(d.lo), d.world(d.hi));
    // What is timed is what the tests verify: a finite value near that of the enclosure.
    assert!(x.iter().all(|&x| f.value(x).is_finite()));
    let mut g = c.benchmark_group(group);
    g.throughput(Throughput::Elements(POINTS as u64));
    g.bench_function(BenchmarkId::new("value", name), |b| {
        b.iter(|| x.iter().map(|&x| f.value(black_box(x))).sum::<f64>());
    });
    g.bench_function(BenchmarkId::new("gradient", name), |b| {
        b.iter(|| x.iter().map(|&x| f.gradient(black_box(x))).sum::<DVec3>());
    });
    let half = 0.05 * (d.hi - d.lo) / 128.0;
    g.bench_function(BenchmarkId::new("enclosure", name), |b| {
        b.iter(|| {
            x.iter()
                .map(|&x| {
                    let u = d.local(x);
                    f.enclosure(black_box(u - half), u + half).lo
                })
                .sum::<f64>()
        });
    });
    g.finish();
}

/// Short intervals of one ray through an analytic field.
fn along_ray(c: &mut Criterion, f: &dyn Function, name: &str) {
    let Structure::Analytic(a) = f.structure() else { return };
    let ray = Ray {
        origin: DVec3::new(-0.9, -0.7, -0.8),
        direction: DVec3::new(0.6, 0.48, 0.64),
    };
    let mut g = c.benchmark_group("field");
    g.throughput(Throughput::Elements(256));
    g.bench_function(BenchmarkId::new("along-ray", name), |b| {
        b.iter(|| {
            (0..256)
                .map(|n| {
                    let t = f64::from(n) / 128.0;
                    a.along_ray(black_box(&ray), Interval::new(t, t + 0.01)).0.lo
                })
                .sum::<f64>()
        });
    });
    g.finish();
}

fn evaluate(c: &mut Criterion) {
    let grid = gyroid();
    for kind in Kind::ALL {
        let s = GridSpline::new(&grid, kind, Stage::Stored).expect("the grid is finite");
        functions(c, "grid", &s, kind.name());
    }
    let s = GridSpline::new(&bytes(&grid), Kind::Trilinear, Stage::Stored).expect("bytes are finite");
    functions(c, "grid", &s, "trilinear-u8");
    for name in ["marschner-lobb", "gyroid", "barth-sextic"] {
        let f = analytic(name, &BTreeMap::new()).expect("the name is in the list").function;
        functions(c, "field", &*f, name);
        along_ray(c, &*f, name);
    }
}

fn prefilter(c: &mut Criterion) {
    let grid = gyroid();
    let mut g = c.benchmark_group("prefilter-128");
    g.throughput(Throughput::Elements(grid.samples.len() as u64));
    for kind in Kind::ALL.into_iter().filter(|k| k.interpolates()) {
        for (stage, name) in [(Stage::Stored, "stored"), (Stage::Ideal, "ideal")] {
            g.bench_function(BenchmarkId::new(kind.name(), name), |b| {
                b.iter(|| GridSpline::new(&grid, kind, stage))
            });
        }
    }
    g.finish();
}

fn ranges(c: &mut Criterion) {
    let grid = gyroid();
    let mut g = c.benchmark_group("range-blocks-of-8");
    g.throughput(Throughput::Elements(16 * 16 * 16));
    for (grid, name) in [(grid.clone(), "f32"), (bytes(&grid), "u8")] {
        let s = GridSpline::new(&grid, Kind::Cubic, Stage::Stored).expect("the grid is finite");
        g.bench_function(name, |b| {
            b.iter(|| {
                let mut sum = 0.0;
                for n in 0..16 * 16 * 16 {
                    let lo = [n % 16, n / 16 % 16, n / 256].map(|i| i * 8);
                    sum += s.range(lo, lo.map(|i| (i + 7).min(126))).lo;
                }
                sum
            });
        });
    }
    g.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .warm_up_time(Duration::from_millis(200))
        .measurement_time(Duration::from_millis(600))
        .sample_size(12);
    targets = evaluate, prefilter, ranges
}
criterion_main!(benches);
