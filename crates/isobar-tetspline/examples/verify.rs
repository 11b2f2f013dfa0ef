//! Draws a scene with several settings, holds each frame against the oracle, and gives the CPU time of a frame (least of five, all threads):
//! `cargo run --release -p isobar-tetspline --example verify -- FILE|NAME,n=64 ISOVALUE [WIDTHxHEIGHT] [gpu]`. `gpu`: `tetspline/gpu` and its variants,
//! with `--features gpu`. `alone`: packets and single rays (surfaces with curves on the faces of cubes, which packets do not draw), drawn in turn. Synthetic data are seen in the bench view, files in the default one.

use isobar_core::{Channels, Data, Frame, Knobs, Method, Request, Stage, Stop, Surface, View};
use isobar_fields::Synthetic;
use isobar_oracle::{Truth, check};
use rustix::time::{ClockId, clock_gettime};
use std::path::Path;
use std::sync::Arc;

fn cpu_seconds() -> f64 {
    let t = clock_gettime(ClockId::ProcessCPUTime);
    t.tv_sec as f64 + t.tv_nsec as f64 * 1e-9
}

/// A method and the knobs it is drawn with.
type Settings = (&'static dyn Method, Vec<Knobs>);

fn method(name: &str) -> Result<Settings, Box<dyn std::error::Error>> {
    let with = |name: &'static str, value: &'static str| Knobs::default().with(name, value);
    match name {
        "cpu" => Ok((
            &isobar_tetspline::TETSPLINE_CPU,
            vec![
                Knobs::default(),
                with("classify", "data"),
                with("roots", "newton3"),
                with("classify", "paper"),
            ],
        )),
        "alone" => Ok((
            &isobar_tetspline::TETSPLINE_CPU,
            vec![Knobs::default(), with("overlay", "curves")],
        )),
        #[cfg(feature = "gpu")]
        "gpu" => Ok((
            &isobar_tetspline::TETSPLINE_GPU,
            vec![
                Knobs::default(),
                with("coefficients", "determining-set"),
                with("roots", "hull"),
                with("roots", "analytic"),
                with("roots", "newton3"),
                with("rays", "interpolated"),
                with("rays", "interpolated")
                    .with("roots", "newton3")
                    .with("classify", "paper"),
            ],
        )),
        other => Err(format!("no method {other} here: cpu, alone, or gpu with --features gpu").into()),
    }
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let argument = |n: usize, default: &str| std::env::args().nth(n).unwrap_or_else(|| default.into());
    let (spec, size) = (argument(1, "marschner-lobb,n=64"), argument(3, "512x384"));
    let isovalue: f64 = argument(2, "0.5").parse()?;
    let (w, h) = size.split_once('x').ok_or("a size such as 512x384")?;
    let (w, h) = (w.parse()?, h.parse()?);
    let (data, view) = if Path::new(&spec).exists() {
        let data = isobar_io::load(Path::new(&spec), &isobar_io::Options::default())?.data;
        let view = View::fit(data.bounds(), 40.0, w, h);
        (data, view)
    } else {
        (spec.parse::<Synthetic>()?.data()?, View::bench(w, h))
    };
    let data: Arc<Data> = Arc::new(data);
    let surfaces = [Surface::isovalue(isovalue, 0)];
    let (method, settings) = method(&argument(4, "cpu"))?;
    let mut all = Vec::new();
    for knobs in settings {
        let text: Vec<String> = knobs.0.iter().map(|(k, v)| format!("{k}={v}")).collect();
        let request = Request {
            channels: Channels::T | Channels::NORMAL | Channels::SURFACE | Channels::RGBA | Channels::CLAIM | Channels::T_ERROR,
            knobs,
            ..Request::default()
        };
        let mut r = method.open(&request)?;
        r.set_data(&data)?;
        r.set_surfaces(&surfaces)?;
        r.set_view(&view)?;
        all.push((r, text.join(" "), 0.0, f64::INFINITY));
    }
    // A GPU in software is slow, and its times mean little.
    let frames = if method.info().gpu { 2 } else { 7 };
    for n in 0..frames {
        for (r, _, first, least) in &mut all {
            let start = cpu_seconds();
            r.render(&Stop::default())?;
            let ms = (cpu_seconds() - start) * 1e3;
            if n == 0 {
                *first = ms;
            }
            *least = ms.min(*least);
        }
    }
    let mut truth = None;
    let mut frame = Frame::default();
    for (mut r, text, first, least) in all {
        r.read(&mut frame)?;
        let f = r.reconstruction(Stage::Stored).ok_or("a reconstruction")?;
        if truth.is_none() {
            truth = Some(Truth::compute(&f, &surfaces, &view, &Stop::default())?);
        }
        let truth = truth.as_ref().ok_or("truth")?;
        let c = check(&frame, truth, &f, &surfaces, &view)?;
        println!(
            "{spec} at {isovalue}, {w}x{h}, {}: {} hits, missed {}, false {}, wrong root {}, refuted {}, undecidable {}, unclaimed {} of {}; t p99 {:.1e} max {:.1e} voxel, \
             normal max {:.1e} degrees; CPU {first:.0} ms first, {least:.0} ms least; index {} bytes; stages {:?}; {:?}",
            if text.is_empty() { "default".into() } else { text },
            c.hits,
            c.missed,
            c.false_hits,
            c.wrong_root,
            c.refuted,
            c.undecidable,
            c.unclaimed,
            c.pixels,
            c.t_error_voxels.p99,
            c.t_error_voxels.max,
            c.normal_error_deg.max,
            r.memory().index,
            c.stage,
            r.counters()
        );
    }
    Ok(())
}
