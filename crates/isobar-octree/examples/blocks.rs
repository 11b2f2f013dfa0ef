//! Figure 3.2 of Steinberger 2010: how many blocks of 8 x 8 pixels end at the volume's box, meet no candidate cell, or work on polynomials.
//! `cargo run --release -p isobar-octree --example blocks -- DATA ISOVALUE [RECONSTRUCTION] [PICTURE.png]`, at 512x512 with the default view.

use isobar_core::{Channels, Data, Frame, Knobs, Method, Request, Stop, Surface, View, shade, to_srgb8};
use isobar_fields::Synthetic;
use isobar_octree::blocks::{BlockClass, Blocks};
use std::path::Path;
use std::sync::Arc;

/// The thesis's counts for Bucky: finished at the box, no candidate, root finding (paper-numbers: Steinberger2010, Fig3.2).
const PRINTED: [(&str, usize); 3] = [
    ("finished at the box", 752),
    ("no candidate voxel", 799),
    ("root finding", 1050),
];

/// Pixels along a block.
const SIDE: usize = 8;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [source, isovalue, rest @ ..] = arguments.as_slice() else {
        return Err("usage: blocks DATA ISOVALUE [RECONSTRUCTION] [PICTURE.png]".into());
    };
    let kind = rest.first().map_or("cubic", String::as_str);
    let data = match source.parse::<Synthetic>() {
        Ok(s) => s.data()?,
        Err(_) => isobar_io::load(Path::new(source), &isobar_io::Options::default())?.data,
    };
    let Data::Grid(grid) = &data else {
        return Err(format!("{source} holds no grid").into());
    };
    let (domain, view) = (grid.domain(), View::fit(data.bounds(), 40.0, 512, 512));
    let request = Request {
        channels: Channels::T | Channels::WORK | Channels::NORMAL,
        knobs: Knobs::default().with("reconstruction", kind),
        ..Request::default()
    };
    let mut r = isobar_octree::OCTREE_CPU.open(&request)?;
    r.set_data(&Arc::new(data))?;
    r.set_surfaces(&[Surface::isovalue(isovalue.parse()?, 0)])?;
    r.set_view(&view)?;
    r.render(&Stop::default())?;
    let mut frame = Frame::default();
    r.read(&mut frame)?;
    let blocks = Blocks::new(&frame, &view, &domain, SIDE)?;
    println!(
        "{source} at {isovalue}, {kind}: {} of {} blocks launched, pixels {:?}",
        blocks.launched_blocks(),
        blocks.classes.len(),
        blocks.launched
    );
    for class in &BlockClass::ALL[1..] {
        println!(
            "  {:28} {:6}  {:5.1} %",
            class.name(),
            blocks.count(*class),
            100.0 * blocks.share(*class)
        );
    }
    let worked = blocks.count(BlockClass::Composed) + blocks.count(BlockClass::Hit);
    println!(
        "  polynomials composed, the last two together: {worked}, {:.1} %",
        100.0 * worked as f64 / blocks.launched_blocks().max(1) as f64
    );
    let printed: usize = PRINTED.iter().map(|p| p.1).sum();
    println!("the thesis, Bucky, a view it does not give: {printed} blocks");
    for (name, count) in PRINTED {
        println!("  {name:28} {count:6}  {:5.1} %", 100.0 * count as f64 / printed as f64);
    }
    if let Some(path) = rest.get(1) {
        picture(&blocks, &frame, &view).save(path)?;
        println!("{path}");
    }
    Ok(())
}

/// The image, tinted by class, with the blocks' edges.
fn picture(blocks: &Blocks, frame: &Frame, view: &View) -> image::RgbImage {
    let (width, height) = (view.width as u32, view.height as u32);
    image::RgbImage::from_fn(width, height, |x, y| {
        let (x, y) = (x as usize, y as usize);
        let at = y * view.width + x;
        let tint = match blocks.at(x, y) {
            BlockClass::NotLaunched => [1.0, 1.0, 1.0],
            BlockClass::MissesBox => [0.55, 0.75, 1.0],
            BlockClass::NoCandidate => [0.6, 0.95, 0.6],
            BlockClass::Composed => [1.0, 0.9, 0.4],
            BlockClass::Hit => [1.0, 0.6, 0.45],
        };
        let colour = if frame.t[at].is_finite() {
            shade(tint, frame.normal[at], view.ray(x, y).direction)
        } else {
            tint
        };
        let edge = if x.is_multiple_of(SIDE) || y.is_multiple_of(SIDE) {
            0.8
        } else {
            1.0
        };
        let [r, g, b] = colour.map(|c| c * edge);
        image::Rgb(to_srgb8([r, g, b, 1.0]))
    })
}
