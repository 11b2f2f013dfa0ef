//! The table of Fig. 6, right (Kalbe et al. 2009): for each data set the isovalue, active cubes and tetrahedra, bytes, times of a change of the isovalue and of a frame:
//! `cargo run --release -p isobar-tetspline --example reconstruct -- [FILE|NAME,n=64|dragon=MESH ISOVALUE]...`. Of 15 changes between two
//! isovalues the median wall-clock time on all threads and, in brackets, the least CPU time summed over threads, which other work on the machine disturbs less; CPU time of a frame, median of 5, at 1280x1024
//! in the default view, with coefficients on the fly and with stored determining sets (both drawn ray by ray, as frames with curves on the faces of cubes are), and of the default way (packets). `dragon=MESH.off`: the signed
//! distance to a mesh at 256^3. With `--features gpu` and `gpu` as the first argument: `tetspline/gpu` instead, changes of the isovalue and frames with both variants.

#[path = "common/distance.rs"]
mod distance;

use isobar_core::{Channels, Data, Knobs, Method, Request, Stop, Surface, View};
use isobar_fields::{Synthetic, Type6Spline};
use isobar_tetspline::TETSPLINE_CPU;
use isobar_tetspline::classify::Rule;
use isobar_tetspline::lists::Lists;
use rustix::time::{ClockId, clock_gettime};
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

const CHANGES: usize = 15;
const FRAMES: usize = 5;

fn main() -> Result<()> {
    let mut given: Vec<String> = std::env::args().skip(1).collect();
    let on_gpu = given.first().is_some_and(|g| g == "gpu");
    if on_gpu {
        given.remove(0);
    }
    let defaults = ["gyroid,n=256", "0.2"].map(String::from);
    let given = if given.is_empty() { defaults.to_vec() } else { given };
    if on_gpu {
        return gpu_rows(&given);
    }
    println!(
        "data | isovalue | active cubes: 27 data, coefficients | active tetrahedra | Q, T, sets in MB | cubes | cubes, hierarchy | \
         cubes and tetrahedra, hierarchy | sets | frame on the fly: first, next | frame stored | frame in packets"
    );
    for pair in given.chunks(2) {
        let [spec, isovalue] = pair else {
            return Err("an isovalue after each data set".into());
        };
        row(spec, isovalue.parse()?)?;
    }
    Ok(())
}

fn load(spec: &str) -> Result<Data> {
    if let Some(mesh) = spec.strip_prefix("dragon=") {
        return Ok(Data::Grid(distance::field(&isobar_io::load_mesh(Path::new(mesh))?, 256)?));
    }
    Ok(if Path::new(spec).exists() {
        isobar_io::load(Path::new(spec), &isobar_io::Options::default())?.data
    } else {
        spec.parse::<Synthetic>()?.data()?
    })
}

fn median(mut v: Vec<f64>) -> f64 {
    v.sort_by(f64::total_cmp);
    v[v.len() / 2]
}

/// Times of one thing: wall clock and CPU, in milliseconds.
#[derive(Default)]
struct Clock(Vec<[f64; 2]>);

impl Clock {
    fn time<R>(&mut self, work: impl FnOnce() -> R) -> R {
        let (wall, cpu) = (Instant::now(), cpu_ms());
        let out = work();
        self.0.push([wall.elapsed().as_secs_f64() * 1e3, cpu_ms() - cpu]);
        out
    }
}

/// Median of the wall-clock times, least of the CPU times.
impl std::fmt::Display for Clock {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let least = self.0.iter().map(|t| t[1]).fold(f64::INFINITY, f64::min);
        write!(f, "{:.1} ({least:.1})", median(self.0.iter().map(|t| t[0]).collect()))
    }
}

fn row(spec: &str, isovalue: f64) -> Result<()> {
    let data = load(spec)?;
    let Data::Grid(grid) = &data else {
        return Err("not a grid".into());
    };
    let spline = Type6Spline::new(grid)?;
    let (mut plain, mut blocks) = (Lists::new(&spline, false)?, Lists::new(&spline, true)?);
    let other = isovalue - 1e-3 * isovalue.abs().max(1.0);
    let cubes = count_cubes(&mut plain, isovalue);
    let [mut without, mut with, mut both, mut stored] = [(); 4].map(|()| Clock::default());
    for _ in 0..CHANGES {
        // Away and back: every timed change ends at the isovalue of the table.
        plain.rebuild_cubes(other);
        without.time(|| plain.rebuild_cubes(isovalue));
        blocks.rebuild_cubes(other);
        with.time(|| blocks.rebuild_cubes(isovalue));
        blocks.rebuild(other, Rule::Coefficients);
        both.time(|| blocks.rebuild(isovalue, Rule::Coefficients));
    }
    let sets = stored.time(|| blocks.determining_sets(isovalue));
    let mb = |bytes: usize| bytes as f64 / 1e6;
    let (kept, tets) = (blocks.cubes().len(), blocks.count());
    let bytes = [mb(4 * kept), mb(4 * tets), mb(size_of_val(sets.as_slice()))];
    drop((plain, blocks, sets));
    let data = Arc::new(data);
    // What packets do not draw.
    let alone = Knobs::default().with("overlay", "curves");
    let fly = frame(&data, isovalue, alone.clone())?;
    let set = frame(&data, isovalue, alone.with("coefficients", "determining-set"))?;
    let packets = frame(&data, isovalue, Knobs::default())?;
    println!(
        "{} | {isovalue} | {cubes}, {kept} | {tets} | {:.1}, {:.1}, {:.1} | {without} | {with} | {both} | {stored} | \
         {fly} | {set} | {packets}",
        Path::new(spec).file_name().map_or(spec.into(), |n| n.to_string_lossy()),
        bytes[0],
        bytes[1],
        bytes[2],
    );
    Ok(())
}

fn count_cubes(lists: &mut Lists, isovalue: f64) -> usize {
    lists.rebuild_cubes(isovalue);
    lists.cubes().len()
}

fn cpu_ms() -> f64 {
    let t = clock_gettime(ClockId::ProcessCPUTime);
    t.tv_sec as f64 * 1e3 + t.tv_nsec as f64 * 1e-6
}

/// CPU time of the first frame after a change of the isovalue, and of a further one.
fn frame(data: &Arc<Data>, isovalue: f64, knobs: Knobs) -> Result<String> {
    let view = View::fit(data.bounds(), 40.0, 1280, 1024);
    let mut r = TETSPLINE_CPU.open(&Request {
        channels: Channels::T | Channels::NORMAL | Channels::RGBA,
        knobs,
        ..Request::default()
    })?;
    r.set_data(data)?;
    r.set_view(&view)?;
    let (mut first, mut next) = (Vec::new(), Vec::new());
    for _ in 0..FRAMES {
        r.set_surfaces(&[Surface::isovalue(isovalue, 0)])?;
        for times in [&mut first, &mut next] {
            let start = cpu_ms();
            r.render(&Stop::default())?;
            times.push(cpu_ms() - start);
        }
    }
    Ok(format!("{:.0}, {:.0}", median(first), median(next)))
}

#[cfg(not(feature = "gpu"))]
fn gpu_rows(_: &[String]) -> Result<()> {
    Err("tetspline/gpu is there with --features gpu".into())
}

/// Rows of `tetspline/gpu`, one for each way to the coefficients.
#[cfg(feature = "gpu")]
fn gpu_rows(given: &[String]) -> Result<()> {
    println!(
        "data | isovalue | coefficients | active cubes | active tetrahedra | Q, T, sets in MB | change of the isovalue: wall (CPU) ms | frame: wall (CPU) ms"
    );
    for pair in given.chunks(2) {
        let [spec, isovalue] = pair else {
            return Err("an isovalue after each data set".into());
        };
        let (data, isovalue) = (Arc::new(load(spec)?), isovalue.parse()?);
        for coefficients in ["on-the-fly", "determining-set"] {
            let name = Path::new(spec).file_name().map_or(spec.into(), |n| n.to_string_lossy());
            println!(
                "{name} | {isovalue} | {coefficients} | {}",
                gpu_row(&data, isovalue, coefficients)?
            );
        }
    }
    Ok(())
}

#[cfg(feature = "gpu")]
fn gpu_row(data: &Arc<Data>, isovalue: f64, coefficients: &str) -> Result<String> {
    const TIMES: usize = 3;
    let mut r = isobar_tetspline::TETSPLINE_GPU.open(&Request {
        channels: Channels::T | Channels::NORMAL | Channels::RGBA,
        knobs: Knobs::default().with("coefficients", coefficients).with("cull", "off"),
        ..Request::default()
    })?;
    r.set_data(data)?;
    let view = View::fit(data.bounds(), 40.0, 1280, 1024);
    // Nothing is to be seen to the other side: only the lists are made.
    let mut away = view.clone();
    if let isobar_core::Camera::Perspective { eye, target, .. } = &mut away.camera {
        *target = 2.0 * *eye - *target;
    }
    let (mut changes, mut frames) = (Clock::default(), Clock::default());
    let other = isovalue - 1e-3 * isovalue.abs().max(1.0);
    r.set_view(&away)?;
    for n in 0..=TIMES {
        r.set_surfaces(&[Surface::isovalue(other, 0)])?;
        r.render(&Stop::default())?;
        r.set_surfaces(&[Surface::isovalue(isovalue, 0)])?;
        // The first change compiles the kernels and lets the lists grow.
        let mut warm = Clock::default();
        let clock = if n == 0 { &mut warm } else { &mut changes };
        clock.time(|| r.render(&Stop::default()))?;
    }
    r.set_view(&view)?;
    r.render(&Stop::default())?;
    for _ in 0..TIMES {
        frames.time(|| r.render(&Stop::default()))?;
    }
    let counters = r.counters();
    let of = |name: &str| counters.0.iter().find(|(n, _)| *n == name).map_or(0, |c| c.1);
    let mb = |name: &str| of(name) as f64 / 1e6;
    Ok(format!(
        "{} | {} | {:.1}, {:.1}, {:.1} | {changes} | {frames}",
        of("active cubes"),
        of("active tetrahedra"),
        mb("bytes of Q_active"),
        mb("bytes of T_active"),
        mb("bytes of determining sets"),
    ))
}
