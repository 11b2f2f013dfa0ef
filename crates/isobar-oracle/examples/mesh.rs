//! `cargo run --release -p isobar-oracle --example mesh -- XYZ Q [isovalue=1.8] [WxH=512x384]`: the certified truth of the density of a PLOT3D grid
//! (big-endian, without blanking), five tetrahedra per cell, in the default view, with time and stage counts.

use isobar_core::{DVec3, Function, Stop, Surface, TetMesh, View};
use isobar_fields::TetLinear;
use isobar_oracle::Truth;
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

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [xyz, q, rest @ ..] = &arguments[..] else {
        return Err("give the grid and its solution".into());
    };
    let isovalue: f64 = rest.first().map_or("1.8", String::as_str).parse()?;
    let (w, h) = rest
        .get(1)
        .map_or("512x384", String::as_str)
        .split_once('x')
        .ok_or("the size is WxH")?;
    let start = Instant::now();
    let function: Arc<dyn Function> = Arc::new(TetLinear::new(&mesh(xyz, q)?)?);
    let read = start.elapsed().as_secs_f64();
    let (lo, hi) = function.domain().world_bounds();
    let (centre, radius) = (0.5 * (lo + hi), 0.5 * (hi - lo).length());
    let eye = centre + DVec3::new(2.6, 1.9, 2.2).normalize() * radius / 20f64.to_radians().sin();
    let view = View::perspective(eye, centre, DVec3::Z, 40.0, w.parse()?, h.parse()?);
    let start = Instant::now();
    let truth = Truth::compute(&function, &[Surface::isovalue(isovalue, 0)], &view, &Stop::default())?;
    // Outside the cells the value is NaN.
    let step = 1e-6 * radius;
    let generator = view.generator();
    let at_an_end = |(i, p): (usize, &isobar_oracle::TruePixel)| {
        let ray = generator.ray(i % truth.width, i / truth.width);
        let outside = |t: f64| function.value(ray.at(t)).is_nan();
        p.undecidable && p.is_hit() && (outside(p.t() - step) || outside(p.t() + step))
    };
    let ends = truth.pixels.iter().enumerate().filter(|&x| at_an_end(x)).count();
    println!(
        "{w}x{h} isovalue {isovalue}: mesh and its tree {read:.2} s, truth {:.2} s, {} hits, {:?}, undecidable {}, {ends} of them with the root where the ray enters or leaves the mesh",
        start.elapsed().as_secs_f64(),
        truth.hits(),
        truth.stages(),
        truth.undecidable(),
    );
    Ok(())
}
