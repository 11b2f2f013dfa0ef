//! Frames of the CPU rulers on one thread: gyroid 128^3, isovalue 0.2, bench view at 512x384, T + NORMAL + SURFACE + RGBA; and
//! `march-256/step-0.5`, the gyroid at 256^3 and 1024x768.
//!
//! `march/RECONSTRUCTION/step-S` by step, `march-level/RECONSTRUCTION/LEVEL` by instruction set, `mc/build` and `mc/frame` for the mesh. Before
//! anything is timed, all instruction sets are checked to give the same frame.

use criterion::{Criterion, criterion_group, criterion_main};
use isobar_baseline::{MARCH_CPU, MC_CPU};
use isobar_core::{DMat3, DVec3, Data, Frame, Grid, Knobs, Method, Renderer, Request, Samples, Stop, Surface, View};
use isobar_cpu::Level;
use std::hint::black_box;
use std::sync::Arc;
use std::time::Duration;

const N: usize = 128;

fn gyroid(n: usize) -> Arc<Data> {
    let spacing = 2.0 / (n - 1) as f64;
    let at = |i: usize| 6.0 * (i as f64 * spacing - 1.0);
    let samples: Arc<[f32]> = (0..n * n * n)
        .map(|i| {
            let (x, y, z) = (at(i % n), at(i / n % n), at(i / n / n));
            (x.sin() * y.cos() + y.sin() * z.cos() + z.sin() * x.cos()) as f32
        })
        .collect();
    let grid = Grid::new(
        [n; 3],
        DVec3::splat(spacing),
        DVec3::NEG_ONE,
        DMat3::IDENTITY,
        Samples::F32(samples),
    );
    Arc::new(Data::Grid(grid.expect("a good grid")))
}

fn renderer(method: &dyn Method, data: &Arc<Data>, knobs: Knobs) -> Box<dyn Renderer> {
    let request = Request {
        threads: 1,
        knobs,
        ..Request::default()
    };
    let mut r = method.open(&request).expect("the settings are in range");
    r.set_data(data).expect("the grid is finite");
    r.set_surfaces(&[Surface::isovalue(0.2, 0)]).expect("an isovalue");
    r.set_view(&View::bench(512, 384)).expect("a view");
    r
}

fn frame(r: &mut dyn Renderer) -> Frame {
    r.render(&Stop::default()).expect("everything is set");
    let mut f = Frame::default();
    r.read(&mut f).expect("it is drawn");
    f
}

fn march(c: &mut Criterion) {
    let data = gyroid(N);
    for reconstruction in ["trilinear", "quadratic", "cubic"] {
        let mut group = c.benchmark_group(format!("march/{reconstruction}"));
        for step in ["2", "0.5", "0.125"] {
            let knobs = Knobs::default().with("reconstruction", reconstruction).with("step", step);
            let mut r = renderer(&MARCH_CPU, &data, knobs);
            group.bench_function(format!("step-{step}"), |b| {
                b.iter(|| r.render(black_box(&Stop::default())));
            });
        }
        group.finish();
    }
    for reconstruction in ["trilinear", "cubic"] {
        let mut group = c.benchmark_group(format!("march-level/{reconstruction}"));
        let with = |simd: String| {
            let knobs = Knobs::default().with("reconstruction", reconstruction).with("simd", simd);
            renderer(&MARCH_CPU, &data, knobs)
        };
        let want = frame(&mut *with("scalar".into()));
        assert!(
            want.t.iter().filter(|t| t.is_finite()).count() > 50_000,
            "the gyroid is in view"
        );
        for level in Level::ALL.into_iter().filter(|l| l.is_available()) {
            let mut r = with(level.to_string());
            assert_eq!(frame(&mut *r), want, "{level} gives the scalar frame");
            group.bench_function(level.to_string(), |b| {
                b.iter(|| r.render(black_box(&Stop::default())));
            });
        }
        group.finish();
    }
}

fn large(c: &mut Criterion) {
    let mut r = renderer(&MARCH_CPU, &gyroid(256), Knobs::default());
    r.set_view(&View::bench(1024, 768)).expect("a view");
    let mut group = c.benchmark_group("march-256");
    group.bench_function("step-0.5", |b| b.iter(|| r.render(black_box(&Stop::default()))));
    group.finish();
}

fn mc(c: &mut Criterion) {
    let data = gyroid(N);
    let mut group = c.benchmark_group("mc");
    let mut r = renderer(&MC_CPU, &data, Knobs::default());
    assert!(
        frame(&mut *r).t.iter().filter(|t| t.is_finite()).count() > 50_000,
        "the gyroid is in view"
    );
    group.bench_function("frame", |b| b.iter(|| r.render(black_box(&Stop::default()))));
    // two isovalues in turn, so that every call builds
    let mut turn = 0.2;
    group.bench_function("build", |b| {
        b.iter(|| {
            turn = 0.5 - turn;
            r.set_surfaces(black_box(&[Surface::isovalue(turn, 0)]))
        });
    });
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(10).warm_up_time(Duration::from_millis(300)).measurement_time(Duration::from_secs(2));
    targets = march, large, mc
}
criterion_main!(benches);
