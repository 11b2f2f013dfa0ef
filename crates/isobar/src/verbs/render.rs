//! `isobar render`: one image by one method, with its times.

use crate::cli::{Answer, RenderArgs};
use crate::mesh::Mesh;
use crate::output::{self, Format};
use crate::run::{self, Outcome, RunError, Setup};
use crate::source::Source;
use crate::{machine, progress, settings, surfaces};
use anyhow::{Context, Result, ensure};
use isobar_core::{Channels, Method, Request, Stop, Surface};
use serde_json::{Value, json};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Draws and writes what was asked for.
///
/// # Errors
/// When arguments, data or outputs cannot be used, or the method refuses or fails. No output file is left then.
pub fn run(args: &RenderArgs, command: &[String]) -> Result<Answer> {
    let plan = Plan::new(args)?;
    let (source, load) = super::open(&args.data)?;
    source.require_finite()?;
    let view = args.view.view(source.bounds())?;
    let (lo, hi) = source.bounds();
    let medium = args
        .tf
        .as_deref()
        .map(|p| surfaces::load_transfer(p, (hi - lo).max_element()))
        .transpose()?;
    let mesh = args.mesh.as_deref().map(load_mesh).transpose()?;
    let setup = Setup {
        method: plan.method,
        data: &source.data,
        surfaces: &plan.surfaces,
        medium: medium.as_ref(),
        view: &view,
        request: plan.request.clone(),
    };
    let mut outcome = draw(&setup, args, &source)?;
    outcome.timings.load = load;
    let mesh_seconds = mesh.map(|m| join_mesh(&mut outcome, &m, &setup)).transpose()?;
    let _whole = crate::interrupt::writing()?;
    let mut files = Vec::new();
    for (path, format) in &plan.outputs {
        files.push(format.stage(path, &outcome.frame, args.layers.is_some()).context("-o")?);
    }
    if let Some(path) = &args.stats {
        let stats = stats_json(args, command, &setup, &source, &outcome, mesh_seconds);
        files.push(output::stage_text(path, &settings::pretty(&stats)).context("--stats")?);
    }
    output::publish(files).context("-o or --stats")?;
    Ok(Answer {
        text: to_text(&setup, &outcome, &plan.outputs),
        warnings: super::warnings(&source, &plan.surfaces),
        no: false,
    })
}

/// What can be known and checked before the data are read.
struct Plan {
    method: &'static dyn Method,
    surfaces: Vec<Surface>,
    request: Request,
    outputs: Vec<(PathBuf, Format)>,
}

impl Plan {
    fn new(args: &RenderArgs) -> Result<Self> {
        let method = crate::method(&args.method)?;
        let surfaces = surfaces::parse(&args.isovalue, &args.more)?;
        let knobs = settings::parse_knobs(&args.draw.set)?;
        settings::resolve(method, &knobs)?;
        args.view.validate()?;
        ensure!(args.repeat >= 1, "--repeat 0: nothing would be drawn; give 1 or more");
        let mut outputs = Vec::new();
        for path in &args.output {
            outputs.push((path.clone(), Format::of(path)?));
            output::probe("-o", path)?;
        }
        if let Some(path) = &args.stats {
            output::probe("--stats", path)?;
        }
        let images = args.output.iter().map(|p| ("-o", p.as_path()));
        let all: Vec<(&str, &Path)> = images.chain(args.stats.iter().map(|p| ("--stats", p.as_path()))).collect();
        let inputs = super::inputs(&args.data, args.tf.as_deref(), args.mesh.as_deref());
        output::require_distinct(&all, &inputs)?;
        let hits = method.info().hits;
        let mut channels = outputs.iter().fold(Channels::empty(), |c, (_, f)| c | f.channels());
        if channels.is_empty() || args.stats.is_some() {
            channels |= if hits { Channels::T } else { Channels::RGBA };
        }
        if args.mesh.is_some() {
            ensure!(
                hits,
                "--mesh: {} gives colour only, so nothing can be joined by distance; use another --method",
                args.method
            );
            ensure!(
                args.layers.unwrap_or(1) == 1 && args.tf.is_none() && surfaces.iter().all(|s| s.opacity == 1.0),
                "--mesh: only opaque images are joined with a mesh; leave out --layers, --tf and opacities below 1"
            );
            channels |= crate::mesh::CHANNELS;
        }
        let request = super::request(&args.draw, knobs, channels, args.layers.unwrap_or(1))?;
        Ok(Self {
            method,
            surfaces,
            request,
            outputs,
        })
    }
}

fn load_mesh(path: &Path) -> Result<Mesh> {
    let read = isobar_io::load_mesh(path).context("--mesh")?;
    Mesh::new(read).with_context(|| format!("--mesh {}", path.display()))
}

fn draw(setup: &Setup<'_>, args: &RenderArgs, source: &Source) -> Result<Outcome> {
    let stop = Stop::default();
    progress::watch(&format!("drawing with {}", args.method), &stop, || {
        run::run(setup, args.repeat, &stop)
    })
    .map_err(|e| match e {
        RunError::Render(e) => settings::explain(&e, &args.method, &source.name),
        other => other.into(),
    })
}

/// Joins the mesh into the frame and returns the seconds it took.
fn join_mesh(outcome: &mut Outcome, mesh: &Mesh, setup: &Setup<'_>) -> Result<f64> {
    let start = Instant::now();
    // The frame's own layout: what the method gave may be less than what was asked.
    let frame = &outcome.frame;
    ensure!(
        frame.channels.contains(crate::mesh::CHANNELS),
        "--mesh: {} gave no t, so nothing can be joined; use another --method",
        setup.method.info().id
    );
    let request = Request {
        channels: frame.channels,
        layers: frame.layers,
        ..setup.request.clone()
    };
    let drawn = mesh
        .draw(setup.view, &request, setup.surfaces.len() as u8)
        .context("--mesh")?;
    outcome.frame.compose(&drawn);
    Ok(start.elapsed().as_secs_f64())
}

/// Pixels that show anything: by t where the frame has it, else by opacity.
#[must_use]
pub fn pixels_hit(outcome: &Outcome) -> usize {
    let f = &outcome.frame;
    let n = f.width * f.height;
    if f.t.is_empty() {
        f.rgba.iter().filter(|c| c[3] > 0.0).count()
    } else {
        f.t[..n].iter().filter(|t| t.is_finite()).count()
    }
}

fn to_text(setup: &Setup<'_>, o: &Outcome, outputs: &[(PathBuf, Format)]) -> String {
    let s = settings::seconds;
    let t = &o.timings;
    let function = o.function.as_ref().map_or(String::new(), |f| format!(" {}", f.name()));
    let mut out = format!(
        "{}{function}: {} of {} pixels hit\n",
        setup.method.info().id,
        pixels_hit(o),
        setup.view.pixels()
    );
    let device = if t.device_render.n > 0 {
        format!(", device {}", s(t.device_render.median))
    } else {
        String::new()
    };
    // Writing to a String cannot fail.
    let _ = writeln!(
        out,
        "load {}, open {}, data {}, surfaces {}, view {}, render {} (cpu {}{device}; {} of {}), read {}",
        s(t.load),
        s(t.open),
        s(t.data),
        s(t.surfaces),
        s(t.view),
        s(t.render.median),
        s(t.cpu_render.median),
        if t.render.n > 1 { "median" } else { "first" },
        t.render.n,
        s(t.read),
    );
    for (path, _) in outputs {
        let _ = writeln!(out, "wrote {}", path.display());
    }
    out
}

/// The device a method ran on.
#[must_use]
pub fn device(method: &dyn Method) -> machine::Device {
    #[cfg(feature = "gpu")]
    if method.info().gpu {
        return crate::machine::gpu();
    }
    let _ = method;
    machine::processor()
}

fn stats_json(
    args: &RenderArgs,
    command: &[String],
    setup: &Setup<'_>,
    source: &Source,
    o: &Outcome,
    mesh_seconds: Option<f64>,
) -> Value {
    let t = &o.timings;
    let info = setup.method.info();
    // The knobs were resolved before drawing; here that cannot fail.
    let knobs = settings::resolve(setup.method, &setup.request.knobs).map_or(Value::Null, |k| settings::knobs_json(&k));
    let device = device(setup.method);
    let mut stats = json!({
        "isobar": env!("CARGO_PKG_VERSION"),
        "command": command,
        "method": info.id,
        "reconstruction": o.function.as_ref().map(|f| f.name()),
        "data": {
            "name": source.name, "kind": source.data.kind(), "type": source.type_name(), "dims": source.dims(),
            "field": source.field, "bytes": source.data.bytes(), "sha256": source.hash(),
        },
        "settings": {
            "knobs": knobs,
            "threads": setup.request.threads,
            "layers": setup.request.layers,
            "repeat": args.repeat,
            "surfaces": settings::surfaces_json(setup.surfaces),
            "medium": setup.medium.map(|m| json!({"points": m.points, "unit": m.unit})),
            "view": settings::view_json(setup.view),
            "nan": args.data.nan,
            "cell_to_point": args.data.cell_to_point,
            "tf": args.tf,
            "mesh": args.mesh,
        },
        "seconds": {
            "load": t.load, "open": t.open, "data": t.data, "surfaces": t.surfaces, "view": t.view, "read": t.read,
            "first_render": t.first_render, "render": t.render,
        },
        "cpu_seconds": {"render": t.cpu_render},
        "device_seconds": {"render": if t.device_render.n > 0 { json!(t.device_render) } else { Value::Null }},
        "memory": {
            "source": source.data.bytes(),
            "coefficients": o.memory.coefficients,
            "index": o.memory.index,
            "view": o.memory.view,
            "device": o.memory.device,
            "frame": o.frame.bytes(),
            "process_peak": machine::peak_bytes(),
        },
        "counters": o.counters.0.iter().map(|(k, v)| ((*k).to_owned(), json!(v))).collect::<serde_json::Map<_, _>>(),
        "device": device.name,
        "driver": device.driver,
        "pixels": {"total": setup.view.pixels(), "hit": pixels_hit(o)},
    });
    if let Some(s) = mesh_seconds {
        stats["seconds"]["mesh"] = json!(s);
    }
    stats
}
