//! What levels of detail do to the topology (S18; Steinberger 2010, Figure 6.9): connected parts of the samples at or above an isovalue, and of those below it, with ever
//! fewer levels of details. `cargo run --release -p isobar-octree --example topology -- [DATA ISOVALUE]...`; DATA is a file or a synthetic field.
//!
//! Parts are counted on the coefficients at full resolution, neighbours along axes; those of a few samples are noise more often than not, so parts of at
//! least 64 samples have a column of their own.

use isobar_core::{Data, Grid};
use isobar_fields::Synthetic;
use isobar_octree::wavelet::table::part_sizes;
use isobar_octree::wavelet::{Adaptive, Bank, Criteria, Extent, Pyramid, Selection};
use std::error::Error;
use std::path::Path;
use std::sync::Arc;

/// A part of fewer samples is small.
const SMALL: usize = 64;

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    println!(
        "data  isovalue  details  active chunks  parts above (of 64 samples and more)  largest  parts below (of 64 and more)"
    );
    for scene in args.chunks(2) {
        let [source, isovalue] = scene else {
            return Err("every DATA needs an ISOVALUE".into());
        };
        let data = match source.parse::<Synthetic>() {
            Ok(s) => s.data()?,
            Err(_) => isobar_io::load(Path::new(source), &isobar_io::Options::default())?.data,
        };
        let Data::Grid(grid) = data else {
            return Err(format!("{source} holds no grid").into());
        };
        one(source, &grid, isovalue.parse()?)?;
    }
    Ok(())
}

fn one(source: &str, grid: &Grid, isovalue: f64) -> Result<(), Box<dyn Error>> {
    let pyramid = Arc::new(Pyramid::new(grid, Bank::Psi42)?);
    let mut adaptive = Adaptive::new(pyramid.clone());
    let name = Path::new(source).file_name().map_or(source.into(), |n| n.to_string_lossy());
    let (lo, hi) = grid.samples.range().0.ok_or("no sample is finite")?;
    let levels = pyramid.levels();
    // Whole levels off, finest first; then by magnitude, which keeps what matters.
    let whole = (0..=levels).map(|from| (format!("levels >= {from}"), Selection::by(&pyramid, |n| n.level >= from)));
    let magnitudes = [0.02, 0.05, 0.1, 0.2].map(|m| {
        let criteria = Criteria {
            magnitude: Some(m * (hi - lo)),
            ..Criteria::default()
        };
        (format!("above {} %", 100.0 * m), Selection::new(&pyramid, &criteria))
    });
    for (what, selection) in whole.chain(magnitudes) {
        adaptive.update(&selection, Extent::Whole);
        let out = adaptive.grid()?;
        let above = part_sizes(&out, |v| v >= isovalue);
        let below = part_sizes(&out, |v| v < isovalue);
        let big = |sizes: &[usize]| sizes.iter().filter(|&&n| n >= SMALL).count();
        println!(
            "{name}  {isovalue}  {what:12}  {:6}  {:6} ({:4})  {:9}  {:6} ({:4})",
            selection.count(),
            above.len(),
            big(&above),
            above.iter().max().copied().unwrap_or(0),
            below.len(),
            big(&below),
        );
    }
    Ok(())
}
