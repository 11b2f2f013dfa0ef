//! What levels of detail do to the topology (S18; Steinberger 2010, Figure 6.9): connected parts of the samples at or above an isovalue, and of those below it, with ever
//! fewer levels of details. `cargo run --release -p isobar-octree --example topology -- [DATA ISOVALUE]... [FOLDER]`; DATA is a file or a synthetic field; with a folder the pictures
//! are written there as PNG. How parts are counted: `figures::topology`.

mod common;

use common::{load, save};
use isobar_core::{Data, View};
use isobar_octree::figures::{Image, topology};
use isobar_octree::wavelet::Bank;
use isobar_octree::wavelet::table::Setting;
use std::error::Error;
use std::path::Path;
use std::time::Duration;

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    println!(
        "data  isovalue  details  active chunks  parts above (of 64 samples and more)  largest  parts below (of 64 and more)"
    );
    let (scenes, folder) = args.as_chunks::<2>();
    let folder = folder.first().map(Path::new);
    for [source, isovalue] in scenes {
        let Data::Grid(grid) = load(source)? else {
            return Err(format!("{source} holds no grid").into());
        };
        let view = View::fit(grid.domain().world_bounds(), 40.0, 512, 512);
        let setting = Setting {
            grid: &grid,
            bank: Bank::Psi42,
            isovalue: isovalue.parse()?,
            view: &view,
            method: &isobar_octree::OCTREE_CPU,
            threads: 0,
            clock: || Duration::ZERO,
        };
        let name = Path::new(source).file_name().map_or(source.into(), |n| n.to_string_lossy());
        for (i, s) in topology::stages(&setting, &[0.02, 0.05, 0.1, 0.2])?.iter().enumerate() {
            println!(
                "{name}  {isovalue}  {:26}  {:6}  {:6} ({:4})  {:9}  {:6} ({:4})",
                s.details, s.chunks, s.above.all, s.above.large, s.above.largest, s.below.all, s.below.large,
            );
            let image = Image::linear(&view, &s.picture.frame.rgba);
            save(folder, &format!("figure-6.9-{name}-{i}"), &image)?;
        }
    }
    Ok(())
}
