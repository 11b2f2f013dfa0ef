//! Counts of active cubes and tetrahedra by the paper's classification and the conservative ones:
//! `cargo run --release -p isobar-tetspline --example classes -- FILE|gyroid,n=256 ISOVALUE`.

use isobar_core::Data;
use isobar_fields::{Synthetic, Type6Spline};
use isobar_tetspline::classify::count;
use std::path::Path;
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let spec = std::env::args().nth(1).unwrap_or_else(|| "gyroid,n=256".into());
    let isovalue: f64 = std::env::args().nth(2).unwrap_or_else(|| "0.2".into()).parse()?;
    let data = if Path::new(&spec).exists() {
        isobar_io::load(Path::new(&spec), &isobar_io::Options::default())?.data
    } else {
        spec.parse::<Synthetic>()?.data()?
    };
    let Data::Grid(grid) = data else {
        return Err("not a grid".into());
    };
    let spline = Type6Spline::new(&grid)?;
    let clock = Instant::now();
    let c = count(&spline, isovalue);
    println!("{spec} at {isovalue}, {:?}: {c:#?}", clock.elapsed());
    let (rejected, lost) = (c.rejected as f64, c.lost as f64);
    let of = 100.0 / c.by_coefficients.max(1) as f64;
    println!(
        "rejected by the determining set: {:.4} %, with surface for certain: {:.4} %",
        rejected * of,
        lost * of
    );
    Ok(())
}
