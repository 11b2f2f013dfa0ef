//! `octree/cpu-paper` by brick side, and by composition and finder at the thesis's budgets, beside `octree/cpu`:
//! `cargo run --release -p isobar-octree --example paper -- SOURCE ISOVALUE WIDTHxHEIGHT REPEATS RECONSTRUCTION...`.
//!
//! SOURCE is a synthetic field (bench view) or a file (whole volume in view). Least CPU time of a frame of t, normal, surface and rgba, one thread, all settings in turn; pixels against the oracle.

use isobar_core::{Channels, Data, Frame, Knobs, Method, Renderer, Request, Stage, Stop, Surface, View};
use isobar_fields::{Kind, Synthetic};
use isobar_oracle::{Truth, check};
use std::path::Path;
use std::sync::Arc;

/// A setting, its renderer, and the least time of its frames in milliseconds.
struct Timed {
    name: String,
    renderer: Box<dyn Renderer>,
    least: f64,
}

fn cpu_ms() -> f64 {
    let t = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    t.tv_sec as f64 * 1e3 + t.tv_nsec as f64 * 1e-6
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [source, isovalue, size, repeats, kinds @ ..] = arguments.as_slice() else {
        return Err("usage: paper SOURCE ISOVALUE WIDTHxHEIGHT REPEATS RECONSTRUCTION...".into());
    };
    let (width, height) = size.split_once('x').ok_or("the size is WIDTHxHEIGHT")?;
    let (width, height) = (width.parse()?, height.parse()?);
    let (data, view): (Data, _) = match source.parse::<Synthetic>() {
        Ok(s) => (s.data()?, View::bench(width, height)),
        Err(_) => {
            let data = isobar_io::load(Path::new(source), &isobar_io::Options::default())?.data;
            let view = View::fit(data.bounds(), 40.0, width, height);
            (data, view)
        }
    };
    let (data, surfaces) = (Arc::new(data), [Surface::isovalue(isovalue.parse()?, 0)]);
    for kind in kinds {
        one(&data, &surfaces, &view, repeats.parse()?, kind)?;
    }
    Ok(())
}

fn one(
    data: &Arc<Data>,
    surfaces: &[Surface],
    view: &View,
    repeats: usize,
    kind: &str,
) -> Result<(), Box<dyn std::error::Error>> {
    let default = Knobs::default().with("reconstruction", kind);
    let mut timed = Vec::new();
    let mut add = |name: String, method: &dyn Method, knobs: Knobs| -> Result<(), Box<dyn std::error::Error>> {
        let mut renderer = method.open(&Request {
            channels: Channels::T | Channels::NORMAL | Channels::SURFACE | Channels::RGBA,
            threads: 1,
            knobs,
            ..Request::default()
        })?;
        renderer.set_data(data)?;
        renderer.set_surfaces(surfaces)?;
        renderer.set_view(view)?;
        let least = f64::INFINITY;
        timed.push(Timed { name, renderer, least });
        Ok(())
    };
    add("octree/cpu".into(), &isobar_octree::OCTREE_CPU, default.clone())?;
    for (knob, values) in [
        ("brick", &["2", "1", "4", "8", "16"][..]),
        ("composition", &["naive", "pf", "sb0", "sb1"]),
        ("finder", &["mr07", "arfbs", "sturm"]),
        ("iterations", &["24"]),
    ] {
        for value in values {
            let knobs = default.clone().with(knob, value);
            add(format!("{knob}={value}"), &isobar_octree::OCTREE_CPU_PAPER, knobs)?;
        }
    }
    // Its last step of an odd number is halving; of an even one, regula falsi.
    let even = kind.parse::<Kind>()?.basis().degree * 2 + 2;
    let knobs = default.clone().with("finder", "arfbs").with("iterations", even);
    add(
        format!("finder=arfbs iterations={even}"),
        &isobar_octree::OCTREE_CPU_PAPER,
        knobs,
    )?;
    for _ in 0..repeats {
        for t in &mut timed {
            let before = cpu_ms();
            t.renderer.render(&Stop::default())?;
            t.least = t.least.min(cpu_ms() - before);
        }
    }
    let function = timed[0].renderer.reconstruction(Stage::Stored).ok_or("nothing drawn")?;
    let truth = Truth::compute(&function, surfaces, view, &Stop::default())?;
    let bytes = data.bytes() as f64;
    println!(
        "{kind}: CPU ms | hits | missed, false, wrong root | t error, voxels: p99, most | index, % of the samples | a ray: nodes, bricks, cells"
    );
    for t in &mut timed {
        let mut frame = Frame::default();
        t.renderer.read(&mut frame)?;
        let c = check(&frame, &truth, &function, surfaces, view)?;
        let counters = t.renderer.counters();
        let of = |name: &str| counters.0.iter().find(|c| c.0 == name).map_or(0.0, |c| c.1 as f64);
        let rays = of("rays launched");
        let a_ray = ["nodes", "bricks", "cells composed"]
            .map(|n| format!("{:.2}", of(n) / rays))
            .join(", ");
        println!(
            "{} | {:.1} | {} | {}, {}, {} | {:.1e}, {:.1e} | {:.2} | {}",
            t.name,
            t.least,
            c.hits,
            c.missed,
            c.false_hits,
            c.wrong_root,
            c.t_error_voxels.p99,
            c.t_error_voxels.max,
            t.renderer.memory().index as f64 / bytes * 100.0,
            if rays > 0.0 { &a_ray } else { "not counted so" },
        );
    }
    Ok(())
}
