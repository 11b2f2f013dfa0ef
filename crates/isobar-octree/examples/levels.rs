//! What drawing over levels of detail gains, and at which error (S15 to S18): the whole volume in view, levels chosen so that their pieces are seen at most some pixels wide,
//! beside the volume itself at full resolution. `cargo run --release -p isobar-octree --example levels -- DATA ISOVALUE [VIEW] [WIDTHxHEIGHT] [PIXELS,...]`; DATA is a
//! file or a synthetic field, VIEW `bench` or `default`. One thread; times are CPU time of the process, least of several, frames of both kinds in turn.

use isobar_core::{Data, View};
use isobar_fields::Synthetic;
use isobar_octree::wavelet::Bank;
use isobar_octree::wavelet::gain::{Gain, STEP};
use isobar_octree::wavelet::table::Setting;
use std::path::Path;
use std::time::Duration;

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

fn main() -> Result<()> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let get = |i: usize, default: &'static str| args.get(i).map_or(default, String::as_str);
    let [Some(file), Some(isovalue)] = [args.first(), args.get(1)] else {
        return Err("usage: levels DATA ISOVALUE [bench|default] [WIDTHxHEIGHT] [PIXELS,...]".into());
    };
    let data = match file.parse::<Synthetic>() {
        Ok(s) => s.data()?,
        Err(_) => isobar_io::load(Path::new(file), &isobar_io::Options::default())?.data,
    };
    let Data::Grid(grid) = data else {
        return Err(format!("{file} holds no grid").into());
    };
    let (width, height) = get(3, "1024x768").split_once('x').ok_or("give the size as 1024x768")?;
    let (width, height) = (width.parse()?, height.parse()?);
    let view = match get(2, "default") {
        "bench" => View::bench(width, height),
        "default" => View::fit(grid.domain().world_bounds(), 40.0, width, height),
        other => return Err(format!("{other} is no view; give bench or default").into()),
    };
    let pixels = get(4, "2,4,8,16")
        .split(',')
        .map(str::parse)
        .collect::<std::result::Result<Vec<f64>, _>>()?;
    let setting = Setting {
        grid: &grid,
        bank: Bank::Psi42,
        isovalue: isovalue.parse()?,
        view: &view,
        method: &isobar_octree::OCTREE_CPU,
        threads: 1,
        clock: cpu_time,
    };
    let centre = grid.domain().world(grid.domain().hi * 0.5);
    let distance = match view.camera {
        isobar_core::Camera::Perspective { eye, .. } => eye.distance(centre),
        _ => return Err("the views are in perspective".into()),
    };
    println!(
        "{file}, {isovalue}: {:?} samples, {width}x{height}, a voxel in the middle is {:.2} pixels wide; {}, cubic",
        grid.dims,
        grid.spacing.min_element() / view.footprint(distance),
        setting.bank
    );
    println!(
        "anew: selection, reconstruction and lattices; moved: the same from one frame to the next, {STEP} degree round the target; depth errors of first hits, along the ray"
    );
    println!(
        "pixels  anew ms  moved ms  frame ms  full ms  full / frame  full / (moved + frame)  cells per hit (full)  MSE x 1e3  depth rms, median, 99 % voxels  in pixel footprints  one-sided of hits  MiB  (level, bricks)"
    );
    for g in setting.gains(&pixels)? {
        row(&g);
    }
    Ok(())
}

fn row(g: &Gain) {
    let per_hit = g.cells.map(|c| c as f64 / g.hits.max(1) as f64);
    let d = &g.difference;
    println!(
        "{:6}  {:7.1}  {:8.1}  {:8.1}  {:7.1}  {:12.2}  {:22.2}  {:.2} ({:.2})  {:9.3}  {:.4}, {:.4}, {:.4}  {:.4}, {:.4}, {:.4}  {} of {}  {}  {:?}",
        g.pixels,
        ms(g.anew),
        ms(g.select),
        ms(g.render),
        ms(g.full),
        ms(g.full) / ms(g.render),
        ms(g.full) / ms(g.select + g.render),
        per_hit[0],
        per_hit[1],
        d.mse * 1e3,
        d.depth,
        d.voxels[0],
        d.voxels[1],
        d.footprints[0],
        d.footprints[1],
        d.footprints[2],
        d.one_sided,
        g.hits,
        g.bytes >> 20,
        g.levels
    );
}

/// Of all threads.
fn cpu_time() -> Duration {
    let t = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    Duration::new(t.tv_sec.unsigned_abs(), t.tv_nsec as u32)
}

fn ms(d: Duration) -> f64 {
    d.as_secs_f64() * 1e3
}
