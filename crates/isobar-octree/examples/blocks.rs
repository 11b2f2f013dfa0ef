//! Figure 3.2 of Steinberger 2010: how many blocks of 8 x 8 pixels end at the volume's box, meet no candidate cell, or work on polynomials.
//! `cargo run --release -p isobar-octree --example blocks -- DATA ISOVALUE [RECONSTRUCTION] [FOLDER]`, at 512x512 with the default view; with a folder the picture is written there.

mod common;

use common::{load, save};
use isobar_core::View;
use isobar_octree::blocks::BlockClass;
use isobar_octree::figures::classes::Classes;
use isobar_octree::figures::{Scene, printed};
use std::path::Path;
use std::sync::Arc;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [source, isovalue, rest @ ..] = arguments.as_slice() else {
        return Err("usage: blocks DATA ISOVALUE [RECONSTRUCTION] [FOLDER]".into());
    };
    let kind = rest.first().map_or("cubic", String::as_str);
    let data = Arc::new(load(source)?);
    let view = View::fit(data.bounds(), 40.0, 512, 512);
    let classes = Classes::draw(&Scene {
        data: &data,
        isovalue: isovalue.parse()?,
        kind: kind.parse()?,
        view: &view,
    })?;
    let blocks = &classes.blocks;
    println!(
        "{source} at {isovalue}, {kind}: {} of {} blocks launched, pixels {:?}",
        blocks.launched_blocks(),
        blocks.classes.len(),
        blocks.launched
    );
    let line = |name: &str, n: usize, all: usize| println!("  {name:42} {n:6}  {:5.1} %", 100.0 * n as f64 / all.max(1) as f64);
    for class in &BlockClass::ALL[1..] {
        line(class.name(), blocks.count(*class), blocks.launched_blocks());
    }
    let both = "polynomials composed, the last two together";
    line(both, classes.composed(), blocks.launched_blocks());
    let printed_blocks: usize = printed::FIGURE_3_2.iter().map(|p| p.1).sum();
    println!("the thesis, Bucky, a view it does not give: {printed_blocks} blocks");
    for (name, count) in printed::FIGURE_3_2 {
        line(name, count, printed_blocks);
    }
    save(rest.get(1).map(Path::new), "figure-3.2", &classes.image(&view))
}
