//! A change of the isovalue on all threads: Q_active without and with a stored hierarchy, and with the 24 lists T_active, for the gyroid at 256^3 and 0.2.

use criterion::{Criterion, criterion_group, criterion_main};
use isobar_core::Data;
use isobar_fields::{Synthetic, Type6Spline};
use isobar_tetspline::classify::Rule;
use isobar_tetspline::lists::Lists;
use std::hint::black_box;
use std::time::Duration;

fn lists(c: &mut Criterion) {
    let data: Data = "gyroid,n=256"
        .parse::<Synthetic>()
        .and_then(|s| s.data())
        .expect("a field of the command line");
    let Data::Grid(grid) = data else {
        panic!("synthetic data are grids unless another kind is asked for")
    };
    let spline = Type6Spline::new(&grid).expect("the grid is finite");
    let mut group = c.benchmark_group("lists/gyroid,n=256");
    for (name, hierarchy) in [("cubes", false), ("cubes, hierarchy", true)] {
        let mut lists = Lists::new(&spline, hierarchy).expect("2^24 cubes");
        lists.rebuild_cubes(0.2);
        assert!(lists.cubes().len() > 1_200_000, "the surface of the issue");
        group.bench_function(name, |b| b.iter(|| lists.rebuild_cubes(black_box(0.2))));
    }
    let mut lists = Lists::new(&spline, true).expect("2^24 cubes");
    group.bench_function("cubes and tetrahedra, hierarchy", |b| {
        b.iter(|| lists.rebuild(black_box(0.2), Rule::Coefficients));
    });
    group.finish();
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(10).warm_up_time(Duration::from_millis(300)).measurement_time(Duration::from_secs(3));
    targets = lists
}
criterion_main!(benches);
