//! `cargo run --release -p isobar-oracle --example oracle_frame -- [n=256] [kind=trilinear] [WxH=1024x768] [field=gyroid]`: the certified truth of a
//! synthetic grid in the bench view, with time, stage counts and brackets.

use isobar_core::{Data, Function, Stage, Stop, Surface, View};
use isobar_fields::{GridSpline, Kind, Synthetic};
use isobar_oracle::Truth;
use std::{error::Error, sync::Arc, time::Instant};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let get = |i: usize, default: &'static str| arguments.get(i).map_or(default, String::as_str);
    let n: usize = get(0, "256").parse()?;
    let kind: Kind = get(1, "trilinear").parse()?;
    let (w, h) = get(2, "1024x768").split_once('x').ok_or("the size is WxH")?;
    let synthetic: Synthetic = format!("{},n={n}", get(3, "gyroid")).parse()?;
    let Data::Grid(grid) = synthetic.data()? else {
        return Err("not a grid".into());
    };
    let isovalue = synthetic.field().isovalue;
    let function: Arc<dyn Function> = Arc::new(GridSpline::new(&grid, kind, Stage::Stored)?);
    let start = Instant::now();
    let truth = Truth::compute(
        &function,
        &[Surface::isovalue(isovalue, 0)],
        &View::bench(w.parse()?, h.parse()?),
        &Stop::default(),
    )?;
    let seconds = start.elapsed().as_secs_f64();
    let widest = truth
        .pixels
        .iter()
        .filter(|p| p.is_hit())
        .map(|p| (p.hi - p.lo) / p.hi)
        .fold(0.0, f64::max);
    println!(
        "{} {kind} n={n} isovalue {isovalue} {w}x{h}: {seconds:.2} s, {} hits, {:?}, undecidable {}, widest bracket {widest:.1e} of t, {} bytes",
        get(3, "gyroid"),
        truth.hits(),
        truth.stages(),
        truth.undecidable(),
        truth.to_bytes().len(),
    );
    Ok(())
}
