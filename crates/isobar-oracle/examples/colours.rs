//! `cargo run --release -p isobar-oracle --example colours -- N KIND [WxH]`: both references of a gyroid of N^3 samples by a reconstruction in the bench view;
//! `... -- XYZ Q [WxH]`: of the density of a PLOT3D grid (big-endian, without blanking), five tetrahedra per cell, in the default view. Microseconds of CPU time a ray on one thread, the greatest error
//! bound, and the bias |P - I|. The transfer function has a smooth hill, a flank and two peaks of a 500th of the range.

use isobar_core::{DVec3, Data, Function, Stage, Stop, TetMesh, TransferFunction, View};
use isobar_fields::{Reconstruction, Synthetic, TetLinear};
use isobar_oracle::{Colours, Integral, Model, Reference};
use std::{error::Error, sync::Arc, time::Instant};

const EVEN: [[usize; 4]; 5] = [[0, 1, 2, 4], [3, 2, 1, 7], [5, 4, 7, 1], [6, 7, 4, 2], [1, 2, 4, 7]];
const ODD: [[usize; 4]; 5] = [[1, 0, 5, 3], [2, 3, 6, 0], [4, 5, 0, 6], [7, 6, 3, 5], [0, 5, 3, 6]];

fn words(path: &str) -> Result<Vec<[u8; 4]>, Box<dyn Error>> {
    Ok(std::fs::read(path)?.as_chunks::<4>().0.to_vec())
}

fn mesh(xyz: &str, q: &str) -> Result<TetMesh, Box<dyn Error>> {
    let (grid, solution) = (words(xyz)?, words(q)?);
    let [ni, nj, nk] = [0, 1, 2].map(|a| u32::from_be_bytes(grid[a]) as usize);
    let n = ni * nj * nk;
    let x = |i: usize| f64::from(f32::from_be_bytes(grid[3 + i]));
    let points: Vec<DVec3> = (0..n).map(|i| DVec3::new(x(i), x(n + i), x(2 * n + i))).collect();
    let values: Vec<f32> = (0..n).map(|i| f32::from_be_bytes(solution[7 + i])).collect();
    let mut cells = Vec::new();
    for (k, j, i) in (0..nk - 1).flat_map(|k| (0..nj - 1).flat_map(move |j| (0..ni - 1).map(move |i| (k, j, i)))) {
        let at = |c: usize| (((k + (c >> 2)) * nj + j + (c >> 1 & 1)) * ni + i + (c & 1)) as u32;
        cells.extend(if (i + j + k) % 2 == 0 { EVEN } else { ODD }.map(|t| t.map(at)));
    }
    Ok(TetMesh::new(points.into(), cells.into(), values.into())?)
}

fn medium(lo: f64, hi: f64, extent: f64) -> Result<TransferFunction, Box<dyn Error>> {
    let v = |x: f64| lo + (hi - lo) * x;
    let peak = 0.36; // opacity .3
    let points = vec![
        (v(0.05), [0.1, 0.2, 0.9], 0.0),
        (v(0.2), [0.1, 0.5, 0.8], 0.01),
        (v(0.3), [0.2, 0.8, 0.2], 0.0),
        (v(0.448), [0.9, 0.7, 0.1], 0.0),
        (v(0.45), [0.9, 0.7, 0.1], peak),
        (v(0.452), [0.9, 0.7, 0.1], 0.0),
        (v(0.648), [0.9, 0.2, 0.1], 0.0),
        (v(0.65), [0.9, 0.2, 0.1], peak),
        (v(0.652), [0.9, 0.2, 0.1], 0.0),
        (v(0.8), [0.9, 0.5, 0.5], 0.0),
        (v(0.95), [0.9, 0.9, 0.9], 0.02),
    ];
    Ok(TransferFunction::new(points, extent / 256.0)?)
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [first, second, rest @ ..] = &arguments[..] else {
        return Err("give N and a reconstruction, or a grid and its solution".into());
    };
    let (w, h) = rest
        .first()
        .map_or("128x96", String::as_str)
        .split_once('x')
        .ok_or("the size is WxH")?;
    let (w, h) = (w.parse()?, h.parse()?);
    let (function, range): (Arc<dyn Function>, (f64, f64)) = if let Ok(n) = first.parse::<usize>() {
        let synthetic: Synthetic = format!("gyroid,n={n}").parse()?;
        let Data::Grid(grid) = synthetic.data()? else {
            return Err("not a grid".into());
        };
        let range = grid.samples.range().0.ok_or("no values")?;
        (second.parse::<Reconstruction>()?.of(&grid, Stage::Stored)?, range)
    } else {
        let mesh = mesh(first, second)?;
        let range = mesh
            .values
            .iter()
            .fold((f64::MAX, f64::MIN), |(a, b), &v| (a.min(f64::from(v)), b.max(f64::from(v))));
        (Arc::new(TetLinear::new(&mesh)?), range)
    };
    let (lo, hi) = function.domain().world_bounds();
    let medium = medium(range.0, range.1, (hi - lo).max_element())?;
    let (centre, radius) = (0.5 * (lo + hi), 0.5 * (hi - lo).length());
    let eye = centre + DVec3::new(2.6, 1.9, 2.2).normalize() * radius / 20f64.to_radians().sin();
    let view = View::perspective(eye, centre, DVec3::Z, 40.0, w, h);
    // CPU time of the calling thread where the system tells it, else wall time.
    let began = Instant::now();
    let clock = || {
        let ns = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
        let ns = ns.and_then(|s| s.split(' ').next()?.parse::<f64>().ok());
        ns.map_or_else(|| began.elapsed().as_secs_f64(), |ns| ns * 1e-9)
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build()?;
    let mut all: Vec<Colours> = Vec::new();
    for reference in [Reference::Integral, Reference::Peaks, Reference::PeaksAlone] {
        let integral = Integral::new(&function, &[], Some(&medium), reference, Model::VolumeDensity, &[])?;
        let (mut best, mut last) = (f64::INFINITY, None);
        for _ in 0..3 {
            let (seconds, colours) = pool.install(|| {
                let start = clock();
                let colours = Colours::of(&integral, &view, &Stop::default());
                (clock() - start, colours)
            });
            last = Some(colours?);
            best = best.min(seconds);
        }
        let Some(c) = last else { continue };
        let seen = c.rgba.iter().filter(|c| c[3] > 0.0).count();
        println!(
            "{reference:?}: {:.1} us a ray (least of 3), {seen} of {} pixels not empty, {:.1} leaves a ray, greatest error bound {:.1e}",
            best * 1e6 / (w * h) as f64,
            w * h,
            c.leaves as f64 / (w * h) as f64,
            c.greatest_error(),
        );
        all.push(c);
    }
    println!("bias |P - I|: {:?}", all[1].bias(&all[0])?);
    Ok(())
}
