//! Table 1 of Roettger, Kraus and Ertl 2000: 1, 2 and 10 isosurfaces, flat and smooth, drawn as printed (`cellproj/cpu-paper`, 256 x 256 textures) and exactly
//! (`cellproj/cpu`), on one thread, orthographic: `cargo run --release -p isobar-cellproj --example table1 -- PATH/bluntfinxyz.bin [repeats]`.
//!
//! The paper does not print its isovalues. Here the first is the one whose number of intersected cells is nearest the paper's 14,729, the second the one with which both
//! are nearest 25,361; the other eight lie beside these two, as far as the same cells hold all ten, evenly.

use isobar_core::{Camera, Channels, Data, Knobs, Method, Request, Stop, Surface, TetMesh, View};
use std::path::Path;
use std::sync::Arc;

/// (isosurfaces, cells, seconds flat, seconds smooth) on an Octane MXE with a MIPS R10000 of 250 MHz; without sorting and decomposition.
const PAPER: [(usize, usize, f64, f64); 3] = [(1, 14_729, 0.09, 0.22), (2, 25_361, 0.20, 0.41), (10, 25_361, 0.20, 0.41)];

/// Least and greatest value of each cell with a value range.
fn ranges(mesh: &TetMesh) -> Vec<[f32; 2]> {
    mesh.cells
        .iter()
        .map(|c| {
            let v = c.map(|i| mesh.values[i as usize]);
            [v[0].min(v[1]).min(v[2].min(v[3])), v[0].max(v[1]).max(v[2].max(v[3]))]
        })
        .collect()
}

fn cells(ranges: &[[f32; 2]], isovalues: &[f64]) -> usize {
    let holds = |r: &&[f32; 2]| isovalues.iter().any(|&c| f64::from(r[0]) <= c && c <= f64::from(r[1]));
    ranges.iter().filter(holds).count()
}

/// The candidate whose count is nearest.
fn nearest(candidates: &[f64], want: usize, count: impl Fn(f64) -> usize) -> f64 {
    let best = candidates.iter().min_by_key(|&&c| count(c).abs_diff(want));
    *best.expect("there are candidates")
}

/// The three sets of isovalues.
fn choose(ranges: &[[f32; 2]]) -> [Vec<f64>; 3] {
    let (lo, hi) = ranges
        .iter()
        .fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), r| (a.min(r[0]), b.max(r[1])));
    let (lo, hi) = (f64::from(lo), f64::from(hi));
    let candidates: Vec<f64> = (1..500).map(|i| lo + (hi - lo) * f64::from(i) / 500.0).collect();
    let first = nearest(&candidates, PAPER[0].1, |c| cells(ranges, &[c]));
    let second = nearest(&candidates, PAPER[1].1, |c| cells(ranges, &[first, c]));
    let two = vec![first, second];
    let n = cells(ranges, &two);
    let mut step = (hi - lo) / 500.0;
    loop {
        let beside = |c: f64| (0..5).map(move |i| c + step * f64::from(i));
        let ten: Vec<f64> = beside(first).chain(beside(second)).collect();
        if cells(ranges, &ten) == n {
            return [vec![first], two, ten];
        }
        step *= 0.5;
    }
}

struct Times {
    sorting: f64,
    decomposition: f64,
    drawing: f64,
    frame: f64,
    cells: u64,
}

/// Least times in milliseconds.
fn time(
    method: &dyn Method,
    data: &Arc<Data>,
    view: &View,
    isovalues: &[f64],
    shading: &str,
    repeats: usize,
) -> Result<Times, Box<dyn std::error::Error>> {
    let request = Request {
        channels: Channels::T | Channels::SURFACE | Channels::RGBA,
        threads: 1,
        knobs: Knobs::default().with("shading", shading),
        ..Request::default()
    };
    let mut r = method.open(&request)?;
    let surfaces: Vec<Surface> = isovalues.iter().enumerate().map(|(i, &c)| Surface::isovalue(c, i)).collect();
    r.set_data(data)?;
    r.set_surfaces(&surfaces)?;
    r.set_view(view)?;
    let mut out = Times {
        sorting: f64::INFINITY,
        decomposition: f64::INFINITY,
        drawing: f64::INFINITY,
        frame: f64::INFINITY,
        cells: 0,
    };
    for _ in 0..repeats {
        out.frame = out.frame.min(r.render(&Stop::default())?.wall.as_secs_f64() * 1e3);
        let counters = r.counters().0;
        let count = |name: &str| counters.iter().find(|c| c.0 == name).map_or(0, |c| c.1);
        out.cells = count("cells intersected");
        out.sorting = out.sorting.min(count("microseconds of sorting") as f64 * 1e-3);
        out.decomposition = out.decomposition.min(count("microseconds of decomposition") as f64 * 1e-3);
        out.drawing = out.drawing.min(count("microseconds of drawing") as f64 * 1e-3);
    }
    Ok(out)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let path = arguments
        .first()
        .ok_or("give the path of bluntfinxyz.bin, or of another mesh")?;
    let repeats = arguments.get(1).map_or(Ok(9), |n| n.parse())?;
    let data = isobar_io::load(Path::new(path), &isobar_io::Options::default())?.data;
    let Data::Tets(mesh) = &data else {
        return Err("data that are no tetrahedra".into());
    };
    let sets = choose(&ranges(mesh));
    println!("{} cells; isovalues {:?}", mesh.cells.len(), sets[2]);
    let mut view = View::fit(data.bounds(), 40.0, 1024, 768);
    if let Camera::Perspective { eye, target, up, fov } = view.camera {
        let height = 2.0 * (target - eye).length() * (0.5 * f64::to_radians(fov)).tan();
        view.camera = Camera::Orthographic { eye, target, up, height };
    }
    let data = Arc::new(data);
    println!(
        "| isosurfaces | cells | flat ms | smooth ms | sorting ms | decomposition ms | cellproj/cpu flat, smooth ms | the paper: cells, flat, smooth s |"
    );
    println!("|---|---|---|---|---|---|---|---|");
    for (set, paper) in sets.iter().zip(PAPER) {
        let of = |method: &dyn Method, shading| time(method, &data, &view, set, shading, repeats);
        let printed = &isobar_cellproj::CELLPROJ_CPU_PAPER;
        let (flat, smooth) = (of(printed, "flat")?, of(printed, "smooth")?);
        let exact = &isobar_cellproj::CELLPROJ_CPU;
        println!(
            "| {} | {} | {:.1} | {:.1} | {:.1} | {:.1} | {:.1}, {:.1} | {}, {:.2}, {:.2} |",
            set.len(),
            flat.cells,
            flat.drawing,
            smooth.drawing,
            flat.sorting.min(smooth.sorting),
            flat.decomposition.min(smooth.decomposition),
            of(exact, "flat")?.frame,
            of(exact, "smooth")?.frame,
            paper.1,
            paper.2,
            paper.3
        );
    }
    Ok(())
}
