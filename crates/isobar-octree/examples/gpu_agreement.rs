//! How far `octree/gpu` is from `octree/cpu`: all layers of every pixel of a view, per degree, and how many pixels are beyond the constants of
//! `isobar_octree::agreement`. `cargo run --release -p isobar-octree --features gpu --example gpu_agreement -- WIDTH HEIGHT DATA ISOVALUE [DATA ISOVALUE]...`;
//! DATA is a file or a synthetic field, ISOVALUE a number or `middle`, that of the range of the samples.

use isobar_core::{Channels, Data, Frame, Knobs, Method, RenderError, Request, Stop, Surface, View};
use isobar_fields::Synthetic;
use isobar_octree::agreement::{Agreement, NORMAL, T};
use isobar_octree::{OCTREE_CPU, OCTREE_GPU};
use std::path::Path;
use std::sync::Arc;

/// Hits kept of a pixel; all are counted.
const LAYERS: usize = 4;

fn frame(method: &dyn Method, kind: &str, data: &Arc<Data>, isovalue: f64, view: &View) -> Result<Frame, RenderError> {
    let mut r = method.open(&Request {
        channels: Channels::T | Channels::NORMAL | Channels::SURFACE | Channels::HITS,
        layers: LAYERS,
        knobs: Knobs::default().with("reconstruction", kind),
        ..Request::default()
    })?;
    r.set_data(data)?;
    r.set_surfaces(&[Surface::isovalue(isovalue, 0)])?;
    r.set_view(view)?;
    r.render(&Stop::default())?;
    let mut frame = Frame::default();
    r.read(&mut frame)?;
    Ok(frame)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [width, height, scenes @ ..] = arguments.as_slice() else {
        return Err("usage: gpu_agreement WIDTH HEIGHT DATA ISOVALUE [DATA ISOVALUE]...".into());
    };
    println!(
        "| data | reconstruction | pixels hit | other hits | beyond {T:e} voxel or {NORMAL:e} of a normal | t, most | normal, most |"
    );
    println!("|---|---|---|---|---|---|---|");
    for scene in scenes.chunks_exact(2) {
        let data = match scene[0].parse::<Synthetic>() {
            Ok(s) => s.data()?,
            Err(_) => isobar_io::load(Path::new(&scene[0]), &isobar_io::Options::default())?.data,
        };
        let Data::Grid(grid) = &data else {
            return Err(format!("{} holds no grid", scene[0]).into());
        };
        let isovalue = match scene[1].as_str() {
            "middle" => {
                let (lo, hi) = grid.samples.range().0.ok_or("no sample is finite")?;
                0.5 * lo + 0.5 * hi
            }
            number => number.parse()?,
        };
        let view = View::fit(data.bounds(), 40.0, width.parse()?, height.parse()?);
        let (voxel, name) = (grid.domain().voxel(), scene[0].rsplit('/').next().unwrap_or("").to_owned());
        let data = Arc::new(data);
        for kind in ["trilinear", "quadratic", "cubic"] {
            let gpu = frame(&OCTREE_GPU, kind, &data, isovalue, &view)?;
            let cpu = frame(&OCTREE_CPU, kind, &data, isovalue, &view)?;
            let a = Agreement::of(&gpu, &cpu, view.pixels(), voxel);
            println!(
                "| {name}, {isovalue} | {kind} | {} | {} | {} | {:.1e} | {:.1e} |",
                a.hit, a.other, a.beyond, a.t, a.normal
            );
        }
    }
    Ok(())
}
