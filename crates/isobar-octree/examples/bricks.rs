//! Figures 6.2 to 6.5 of Steinberger 2010: a volume in degrees 1, 2 and 3, and the bricks that have to be looked into.
//! `cargo run --release -p isobar-octree --example bricks -- DATA ISOVALUE FOLDER [SIDE]`, 512x384 each, with the default view. The thesis's bricks have 2^3 cells; those of the
//! caster have 4^3, the default here. A brick is drawn where its samples lie on both sides of the isovalue, as the caster of degree 1 has it.

mod common;

use common::{load, save};
use isobar_core::{Channels, Data, View};
use isobar_octree::figures::degrees::{Bricks, KINDS};
use isobar_octree::figures::{Image, Scene};
use std::path::Path;
use std::sync::Arc;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [source, isovalue, folder, rest @ ..] = arguments.as_slice() else {
        return Err("usage: bricks DATA ISOVALUE FOLDER [SIDE]".into());
    };
    let (isovalue, side): (f64, usize) = (isovalue.parse()?, rest.first().map_or(Ok(4), |s| s.parse())?);
    let folder = Some(Path::new(folder));
    let data = Arc::new(load(source)?);
    let Data::Grid(grid) = &*data else {
        return Err(format!("{source} holds no grid").into());
    };
    let view = View::fit(data.bounds(), 40.0, 512, 384);
    for kind in KINDS {
        let scene = Scene {
            data: &data,
            isovalue,
            kind,
            view: &view,
        };
        let (frame, _) = scene.draw(Channels::T | Channels::RGBA, 0, 0)?;
        save(folder, kind.name(), &Image::linear(&view, &frame.rgba))?;
    }
    let bricks = Bricks::new(grid, isovalue, side);
    println!(
        "{source} at {isovalue}: {} of {} bricks of {}^3 cells are active, {:.1} %",
        bricks.active(),
        bricks.active.len(),
        bricks.side,
        100.0 * bricks.active() as f64 / bricks.active.len() as f64
    );
    save(folder, "bricks", &bricks.image(&view))
}
