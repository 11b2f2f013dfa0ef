//! How time grows with tetrahedra and with intersected cells: `cargo run --release -p isobar-cellproj --example scaling -- tetrahedra|isovalues [DATA] [repeats=9] [plot=FILE.svg]`.
//!
//! `tetrahedra`: Marschner-Lobb and gyroid meshes up to 1.25 million cells, the bench view, 1024x768: preparation, sorting, one isosurface and the medium by 2D table. `isovalues`: 1 to 32 values
//! spread evenly over the range of DATA (a file, orthographic, default view): intersected cells against times, of `cellproj/cpu-paper` and `cellproj/cpu`. One thread, least
//! of the repeats; sorting is counted apart. A table goes to standard output, a plot to the file.

use isobar_core::{Camera, Channels, Data, Knobs, Method, Request, Stop, Surface, TransferFunction, View};
use isobar_fields::Synthetic;
use rustix::time::{ClockId, clock_gettime};
use std::fmt::Write as _;
use std::path::Path;
use std::sync::Arc;

type Outcome<T> = Result<T, Box<dyn std::error::Error>>;

fn cpu_ms() -> f64 {
    let t = clock_gettime(ClockId::ProcessCPUTime);
    t.tv_sec as f64 * 1e3 + t.tv_nsec as f64 * 1e-6
}

/// Least times of a frame in milliseconds of CPU, and what was counted.
struct Times {
    data: f64,
    frame: f64,
    sorting: f64,
    cells: u64,
    intersected: u64,
}

struct Scene<'a> {
    data: &'a Arc<Data>,
    view: &'a View,
    isovalues: &'a [f64],
    medium: Option<&'a TransferFunction>,
}

fn time(method: &dyn Method, scene: &Scene<'_>, knobs: &[(&str, &str)], repeats: usize) -> Outcome<Times> {
    let request = Request {
        channels: Channels::T | Channels::SURFACE | Channels::RGBA,
        threads: 1,
        knobs: knobs.iter().fold(Knobs::default(), |k, (name, value)| k.with(name, value)),
        ..Request::default()
    };
    let mut r = method.open(&request)?;
    let start = cpu_ms();
    r.set_data(scene.data)?;
    let surfaces: Vec<Surface> = scene.isovalues.iter().map(|&c| Surface::isovalue(c, 0)).collect();
    r.set_surfaces(&surfaces)?;
    r.set_medium(scene.medium)?;
    r.set_view(scene.view)?;
    let mut out = Times {
        data: cpu_ms() - start,
        frame: f64::INFINITY,
        sorting: f64::INFINITY,
        cells: 0,
        intersected: 0,
    };
    for _ in 0..repeats {
        let start = cpu_ms();
        r.render(&Stop::default())?;
        out.frame = out.frame.min(cpu_ms() - start);
        let counters = r.counters().0;
        let count = |name: &str| counters.iter().find(|c| c.0 == name).map(|c| c.1);
        // One thread: the wall clock is the CPU's, and what disturbs it is what the least leaves out.
        let ms = |name: &str| count(name).map_or(f64::INFINITY, |us| us as f64 * 1e-3);
        out.sorting = out.sorting.min(ms("microseconds of sorting"));
        out.cells = count("cells").unwrap_or(0);
        out.intersected = count("cells intersected").or(count("active cells")).unwrap_or(0);
    }
    Ok(out)
}

fn hills((lo, hi): (f64, f64), data: &Data) -> TransferFunction {
    let at = |x: f64| lo + x * (hi - lo);
    let (a, b) = data.bounds();
    TransferFunction {
        points: vec![
            (at(0.0), [0.1, 0.2, 1.0], 0.0),
            (at(0.25), [0.1, 0.8, 0.6], 0.006),
            (at(0.5), [1.0, 1.0, 0.2], 0.0),
            (at(0.75), [1.0, 0.3, 0.1], 0.012),
            (at(1.0), [1.0, 1.0, 1.0], 0.002),
        ],
        unit: (b - a).max_element() / 256.0,
    }
}

fn range(data: &Data) -> Outcome<(f64, f64)> {
    let Data::Tets(mesh) = data else {
        return Err("data that are no tetrahedra".into());
    };
    let (lo, hi) = mesh
        .values
        .iter()
        .fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), &v| (a.min(v), b.max(v)));
    Ok((lo.into(), hi.into()))
}

/// A named line of points.
type Series = (&'static str, Vec<(f64, f64)>);

/// A plot of lines from the origin on.
fn plot(path: &str, x: &str, y: &str, series: &[Series]) -> Outcome<()> {
    let all = series.iter().flat_map(|s| &s.1);
    let (right, top) = all.fold((0.0f64, 0.0f64), |(a, b), p| (a.max(p.0), b.max(p.1)));
    let place = |(px, py): (f64, f64)| (70.0 + 520.0 * px / right, 360.0 - 320.0 * py / top);
    let mut out = String::from(
        "<svg xmlns='http://www.w3.org/2000/svg' width='640' height='420' font-family='sans-serif' font-size='12'>\n",
    );
    out += "<rect width='640' height='420' fill='white'/><path d='M70 40V360H590' fill='none' stroke='black'/>\n";
    for i in 0..=4 {
        let (fx, fy) = (right * f64::from(i) / 4.0, top * f64::from(i) / 4.0);
        let (px, py) = place((fx, fy));
        writeln!(
            out,
            "<text x='{px:.0}' y='376' text-anchor='middle'>{fx:.0}</text><text x='64' y='{:.0}' text-anchor='end'>{fy:.1}</text>",
            py + 4.0
        )?;
    }
    writeln!(
        out,
        "<text x='330' y='400' text-anchor='middle'>{x}</text><text x='70' y='28'>{y}</text>"
    )?;
    for ((name, points), (i, colour)) in series
        .iter()
        .zip(["#1f77b4", "#d62728", "#2ca02c", "#9467bd"].iter().enumerate())
    {
        let line: String = points
            .iter()
            .map(|&p| place(p))
            .map(|(x, y)| format!("{x:.1},{y:.1} "))
            .collect();
        writeln!(out, "<polyline points='{line}' fill='none' stroke='{colour}'/>")?;
        for (x, y) in points.iter().map(|&p| place(p)) {
            writeln!(out, "<circle cx='{x:.1}' cy='{y:.1}' r='3' fill='{colour}'/>")?;
        }
        writeln!(out, "<text x='90' y='{}' fill='{colour}'>{name}</text>", 56 + 16 * i)?;
    }
    out += "</svg>\n";
    std::fs::write(path, out)?;
    Ok(())
}

fn tetrahedra(repeats: usize, path: Option<&str>) -> Outcome<()> {
    let exact = &isobar_cellproj::CELLPROJ_CPU;
    let (mut sorting, mut medium, mut surface): (Series, Series, Series) =
        (("sorting", vec![]), ("medium, 2D table", vec![]), ("one isosurface", vec![]));
    println!(
        "| data | cells | data ms | sorting ms, ns a cell | isosurface ms | medium without sorting ms, us a cell | with it |"
    );
    println!("|---|---|---|---|---|---|---|");
    for (name, c, n) in [
        ("marschner-lobb", 0.5, [9, 17, 25, 33, 41, 49, 57, 64]),
        ("gyroid", 0.2, [9, 17, 25, 33, 41, 49, 57, 64]),
    ]
    .into_iter()
    .flat_map(|(name, c, sizes)| sizes.map(|n| (name, c, n)))
    {
        let data = Arc::new(format!("{name},n={n},as=tets").parse::<Synthetic>()?.data()?);
        let transfer = hills(range(&data)?, &data);
        let view = View::bench(1024, 768);
        let scene = Scene {
            data: &data,
            view: &view,
            isovalues: &[],
            medium: Some(&transfer),
        };
        let v = time(exact, &scene, &[("integration", "table2d")], repeats)?;
        let only = Scene {
            isovalues: &[c],
            medium: None,
            ..scene
        };
        let s = time(exact, &only, &[], repeats)?;
        let cells = v.cells as f64;
        println!(
            "| {name} {n}^3 | {} | {:.0} | {:.1}, {:.0} | {:.1} | {:.0}, {:.3} | {:.0}, {:.3} |",
            v.cells,
            v.data,
            v.sorting,
            v.sorting / cells * 1e6,
            s.frame,
            v.frame - v.sorting,
            (v.frame - v.sorting) / cells * 1e3,
            v.frame,
            v.frame / cells * 1e3
        );
        if name == "marschner-lobb" {
            sorting.1.push((cells, v.sorting));
            medium.1.push((cells, v.frame - v.sorting));
            surface.1.push((cells, s.frame));
        }
    }
    path.map_or(Ok(()), |p| {
        plot(p, "tetrahedra", "ms, one thread", &[sorting, surface, medium])
    })
}

fn isovalues(spec: &str, repeats: usize, path: Option<&str>) -> Outcome<()> {
    let options = isobar_io::Options {
        cell_to_point: true,
        ..isobar_io::Options::default()
    };
    let data = Arc::new(isobar_io::load(Path::new(spec), &options)?.data);
    let mut view = View::fit(data.bounds(), 40.0, 1024, 768);
    if let Camera::Perspective { eye, target, up, fov } = view.camera {
        let height = 2.0 * (target - eye).length() * (0.5 * f64::to_radians(fov)).tan();
        view.camera = Camera::Orthographic { eye, target, up, height };
    }
    let (lo, hi) = range(&data)?;
    let names = ["printed, flat", "printed, smooth", "cellproj/cpu"];
    let mut series: Vec<Series> = names.iter().map(|&n| (n, vec![])).collect();
    println!(
        "| isovalues | cells intersected | printed, flat, without sorting: ms, us a cell | printed, smooth | cellproj/cpu |"
    );
    println!("|---|---|---|---|---|");
    for n in [1, 2, 3, 4, 6, 8, 12, 16, 24, 32] {
        let values: Vec<f64> = (1..=n).map(|i| lo + (hi - lo) * f64::from(i) / f64::from(n + 1)).collect();
        let scene = Scene {
            data: &data,
            view: &view,
            isovalues: &values,
            medium: None,
        };
        let printed = &isobar_cellproj::CELLPROJ_CPU_PAPER;
        let flat = time(printed, &scene, &[("shading", "flat")], repeats)?;
        let smooth = time(printed, &scene, &[("shading", "smooth")], repeats)?;
        let exact = time(&isobar_cellproj::CELLPROJ_CPU, &scene, &[], repeats)?;
        let cells = flat.intersected as f64;
        let all = [flat.frame - flat.sorting, smooth.frame - smooth.sorting, exact.frame];
        let columns: String = all.iter().map(|t| format!(" {t:.1}, {:.2} |", t / cells * 1e3)).collect();
        println!("| {n} | {} |{columns}", flat.intersected);
        for (s, t) in series.iter_mut().zip(all) {
            s.1.push((cells, t));
        }
    }
    path.map_or(Ok(()), |p| plot(p, "cells intersected", "ms, one thread", &series))
}

fn main() -> Outcome<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let value = |name: &str| arguments.iter().find_map(|f| f.strip_prefix(name)?.strip_prefix('='));
    let repeats = value("repeats").unwrap_or("9").parse()?;
    match &arguments[..] {
        [what, ..] if what == "tetrahedra" => tetrahedra(repeats, value("plot")),
        [what, data, ..] if what == "isovalues" => isovalues(data, repeats, value("plot")),
        _ => Err("say `tetrahedra`, or `isovalues` and a file".into()),
    }
}
