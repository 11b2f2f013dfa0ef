//! What levels of detail do to the topology (S18; Steinberger 2010, Figure 6.9): connected parts of the samples at or above an isovalue, and of those below it, with ever
//! fewer levels of details. `cargo run --release -p isobar-octree --example topology -- [DATA ISOVALUE]... [FOLDER]`; DATA is a file or a synthetic field; with a folder the pictures
//! are written there as PPM.
//!
//! Parts are counted on the coefficients at full resolution, neighbours along axes; those of a few samples are noise more often than not, so parts of at
//! least 64 samples have a column of their own.

use isobar_core::{Channels, Data, Grid, Stop, Surface, View, to_srgb8};
use isobar_fields::Synthetic;
use isobar_octree::wavelet::table::part_sizes;
use isobar_octree::wavelet::{Adaptive, Bank, Criteria, Extent, Multiresolution, Pyramid, Selection};
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
    let (scenes, folder) = args.as_chunks::<2>();
    let folder = folder.first().map(Path::new);
    if let Some(folder) = folder {
        std::fs::create_dir_all(folder)?;
    }
    for [source, isovalue] in scenes {
        let data = match source.parse::<Synthetic>() {
            Ok(s) => s.data()?,
            Err(_) => isobar_io::load(Path::new(source), &isobar_io::Options::default())?.data,
        };
        let Data::Grid(grid) = data else {
            return Err(format!("{source} holds no grid").into());
        };
        one(source, &grid, isovalue.parse()?, folder)?;
    }
    Ok(())
}

fn one(source: &str, grid: &Grid, isovalue: f64, folder: Option<&Path>) -> Result<(), Box<dyn Error>> {
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
        if let Some(folder) = folder {
            let file = format!("figure-6.9-{name}-{what}.ppm").replace([' ', '%', '>', '='], "");
            picture(&pyramid, &selection, isovalue, &folder.join(file))?;
        }
    }
    Ok(())
}

/// The surface of a selection, as PPM.
fn picture(pyramid: &Arc<Pyramid>, selection: &Selection, isovalue: f64, file: &Path) -> Result<(), Box<dyn Error>> {
    let mut levels = Multiresolution::new(pyramid.clone(), Channels::RGBA, 0)?;
    levels.set_surfaces(&[Surface::isovalue(isovalue, 0)])?;
    levels.select(selection)?;
    let view = View::fit(pyramid.domain().world_bounds(), 40.0, 512, 512);
    levels.render(&view, &Stop::default())?;
    let mut bytes = b"P6\n512 512\n255\n".to_vec();
    bytes.extend(levels.frame().rgba.iter().flat_map(|&p| to_srgb8(p)));
    std::fs::write(file, bytes)?;
    Ok(())
}
