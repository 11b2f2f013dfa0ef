//! Frames of `octree/cpu` on one thread: the bench view at 1024x768, T + NORMAL + RGBA, claims on, of the Marschner-Lobb signal at 64^3 and the gyroid
//! at 256^3.

use criterion::{Criterion, criterion_group, criterion_main};
use isobar_core::{Channels, Data, Frame, Knobs, Method, Request, Stop, Surface, View};
use isobar_fields::Synthetic;
use isobar_octree::OCTREE_CPU;
use std::hint::black_box;
use std::sync::Arc;
use std::time::Duration;

fn frames(c: &mut Criterion) {
    for (scene, isovalue) in [("marschner-lobb,n=64", 0.5), ("gyroid,n=256", 0.2)] {
        let data: Data = scene
            .parse::<Synthetic>()
            .and_then(|s| s.data())
            .expect("a field of the command line");
        let data = Arc::new(data);
        let mut group = c.benchmark_group(format!("octree/{scene}"));
        for reconstruction in ["trilinear", "quadratic", "cubic"] {
            let request = Request {
                threads: 1,
                channels: Channels::T | Channels::NORMAL | Channels::RGBA | Channels::CLAIM,
                knobs: Knobs::default().with("reconstruction", reconstruction),
                ..Request::default()
            };
            let mut r = OCTREE_CPU.open(&request).expect("the settings are in range");
            r.set_data(&data).expect("the grid is finite");
            r.set_surfaces(&[Surface::isovalue(isovalue, 0)]).expect("an isovalue");
            r.set_view(&View::bench(1024, 768)).expect("a view");
            r.render(&Stop::default()).expect("everything is set");
            let mut frame = Frame::default();
            r.read(&mut frame).expect("it is drawn");
            assert!(
                frame.t.iter().filter(|t| t.is_finite()).count() > 150_000,
                "the surface is in view"
            );
            group.bench_function(reconstruction, |b| b.iter(|| r.render(black_box(&Stop::default()))));
        }
        group.finish();
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default().sample_size(10).warm_up_time(Duration::from_millis(300)).measurement_time(Duration::from_secs(4));
    targets = frames
}
criterion_main!(benches);
