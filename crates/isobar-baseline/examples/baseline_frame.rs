//! CPU time of a frame of a ruler on a synthetic field: `baseline_frame [METHOD] [FIELD] [N] [WxH] [REPEATS] [KNOB=VALUE]...`; defaults:
//! `march/cpu gyroid 256 1024x768 5`. Prints seconds of each stage, the median CPU time of `render` summed over threads, peak memory,
//! bytes and counters. For a profiler: `valgrind --tool=callgrind target/release/examples/baseline_frame march/cpu gyroid 128 512x384 1`.

use isobar_baseline::{MARCH_CPU, MC_CPU};
use isobar_core::{Data, Grid, Knobs, Method, Request, Samples, Stop, Surface, View};
use std::sync::Arc;
use std::time::Instant;

fn field(name: &str, [x, y, z]: [f64; 3]) -> f64 {
    let (a, b, c) = (6.0 * x, 6.0 * y, 6.0 * z);
    match name {
        "gyroid" => a.sin() * b.cos() + b.sin() * c.cos() + c.sin() * a.cos(),
        _ => (x * x + y * y + z * z) * 1.25 * 1.25 - 0.8,
    }
}

/// Seconds of CPU time of all threads of this process.
fn cpu_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/schedstat").unwrap_or_default();
    let main: f64 = stat.split(' ').next().and_then(|s| s.parse().ok()).unwrap_or(0.0);
    let tasks = std::fs::read_dir("/proc/self/task").into_iter().flatten().flatten();
    let sum: f64 = tasks
        .filter_map(|t| {
            std::fs::read_to_string(t.path().join("schedstat"))
                .ok()?
                .split(' ')
                .next()?
                .parse::<f64>()
                .ok()
        })
        .sum();
    sum.max(main) * 1e-9
}

/// Most memory this process has held, MiB.
fn peak() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|l| l.strip_prefix("VmHWM:"));
    let kib = line.and_then(|l| l.trim().trim_end_matches(" kB").parse::<f64>().ok());
    kib.unwrap_or(f64::NAN) / 1024.0
}

fn main() {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let word = |i: usize, d: &str| args.get(i).cloned().unwrap_or_else(|| d.to_owned());
    let (id, name) = (word(0, "march/cpu"), word(1, "gyroid"));
    let n: usize = word(2, "256")
        .parse()
        .expect("the third argument is a number of samples per axis");
    let size = word(3, "1024x768");
    let (w, h) = size.split_once('x').expect("the fourth argument is WxH");
    let repeats: usize = word(4, "5").parse().expect("the fifth argument is a number of frames");
    let mut knobs = Knobs::default();
    for k in args.iter().skip(5) {
        let (name, value) = k.split_once('=').expect("settings are NAME=VALUE");
        knobs.set(name, value);
    }
    let spacing = 2.0 / (n - 1) as f64;
    let at = |i: usize| i as f64 * spacing - 1.0;
    let samples: Arc<[f32]> = (0..n * n * n)
        .map(|i| field(&name, [at(i % n), at(i / n % n), at(i / n / n)]) as f32)
        .collect();
    let grid = Grid::new(
        [n; 3],
        isobar_core::DVec3::splat(spacing),
        isobar_core::DVec3::splat(-1.0),
        isobar_core::DMat3::IDENTITY,
        Samples::F32(samples),
    );
    let data = Arc::new(Data::Grid(grid.expect("n is at least 2")));
    let methods: [&dyn Method; 2] = [&MARCH_CPU, &MC_CPU];
    let method = methods
        .into_iter()
        .find(|m| m.info().id == id)
        .expect("the first argument is a ruler");
    let request = Request {
        knobs,
        ..Request::default()
    };
    let mut r = method.open(&request).expect("the settings are in range");
    let start = Instant::now();
    r.set_data(&data).expect("the grid is finite");
    let data_seconds = start.elapsed().as_secs_f64();
    let (start, before) = (Instant::now(), peak());
    r.set_surfaces(&[Surface::isovalue(0.2, 0)]).expect("an isovalue");
    let surface_seconds = start.elapsed().as_secs_f64();
    let view = View::bench(w.parse().expect("width"), h.parse().expect("height"));
    r.set_view(&view).expect("a view");
    let mut cpu: Vec<f64> = (0..repeats)
        .map(|_| {
            let start = cpu_seconds();
            r.render(&Stop::default()).expect("everything is set");
            cpu_seconds() - start
        })
        .collect();
    cpu.sort_by(f64::total_cmp);
    println!(
        "{id} {name} {n}^3 {size}: data {data_seconds:.3} s, surfaces {surface_seconds:.3} s, render {:.1} ms CPU (least {:.1}), \
         peak {:.0} MiB ({before:.0} before the surfaces), {:?}, {:?}",
        cpu[repeats / 2] * 1e3,
        cpu[0] * 1e3,
        peak(),
        r.memory(),
        r.counters().0
    );
}
