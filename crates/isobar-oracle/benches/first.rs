//! First hits along random rays through a gyroid, by reconstruction and stage.

use criterion::{Criterion, criterion_group, criterion_main};
use isobar_core::{Data, Function, Stage, View};
use isobar_fields::{GridSpline, Kind, Synthetic};
use isobar_oracle::{Decided, Oracle};
use std::{hint::black_box, sync::Arc};

fn first(c: &mut Criterion) {
    let mut group = c.benchmark_group("oracle/first");
    let synthetic: Synthetic = "gyroid,n=64".parse().expect("a synthetic grid");
    let Ok(Data::Grid(grid)) = synthetic.data() else {
        panic!("gyroid,n=64 is a grid");
    };
    let view = View::bench(64, 48);
    let rays: Vec<_> = (0..64 * 48).step_by(37).map(|i| view.ray(i % 64, i / 64)).collect();
    for kind in [Kind::Trilinear, Kind::Quadratic, Kind::Cubic] {
        let spline: Arc<dyn Function> = Arc::new(GridSpline::new(&grid, kind, Stage::Stored).expect("a spline"));
        let oracle = Oracle::new(spline, 0.2);
        for (name, stage) in [
            ("f64", Decided::F64),
            ("dd", Decided::DoubleDouble),
            ("exact", Decided::Exact),
        ] {
            let staged = oracle.with_stage(stage);
            // What is timed is verified: the same answers as the first stage's.
            assert!(
                rays.iter()
                    .all(|r| staged.first(r).hit().is_some() == oracle.first(r).hit().is_some())
            );
            let mut next = rays.iter().cycle();
            group.bench_function(format!("{kind}/{name}"), |b| {
                b.iter(|| next.next().map(|r| staged.first(black_box(r))));
            });
        }
    }
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(20);
    targets = first
}
criterion_main!(benches);
