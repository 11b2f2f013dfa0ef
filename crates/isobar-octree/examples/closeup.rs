//! Figure 6.6 of Steinberger 2010: a close-up by fast tri-cubic texture sampling with the weights of a texture unit, beside `octree/cpu`, and the angle between
//! their normals. `cargo run --release -p isobar-octree --example closeup -- DATA ISOVALUE [VOXELS] [FOLDER]`: DATA a file or a synthetic field, VOXELS the distance
//! of the eye from the surface; with a folder three pictures are written there as PNG.

mod common;

use common::{load, save};
use isobar_core::View;
use isobar_octree::comparators::texture::{Angles, FRACTION_BITS};
use isobar_octree::figures::closeup::{BITS, Closeup, near};
use std::error::Error;
use std::path::Path;
use std::sync::Arc;

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [source, isovalue, rest @ ..] = args.as_slice() else {
        return Err("usage: closeup DATA ISOVALUE [VOXELS] [FOLDER]".into());
    };
    let isovalue: f64 = isovalue.parse()?;
    let voxels: f64 = rest.first().map_or(Ok(4.0), |s| s.parse())?;
    let folder = rest.get(1).map(Path::new);
    let data = Arc::new(load(source)?);
    let size = [512, 384];
    let overview = View::fit(data.bounds(), 40.0, size[0], size[1]);
    let view = near(&data, isovalue, &overview, voxels, size)?;
    let exact = Closeup::draw(&data, isovalue, view)?;
    println!(
        "{source} at {isovalue}, eye {voxels} voxels from the surface, {} of {} pixels hit",
        exact.hits(),
        exact.view.pixels()
    );
    println!("\nangle to the exact gradient of the cubic B-spline, degrees    median      99 %  greatest");
    let line = |name: &str, a: &Angles| println!("{name:58}  {:8.5}  {:8.5}  {:8.5}", a.p50, a.p99, a.max);
    line("octree/cpu, at its own hits (normals stored as f32)", &exact.angles);
    save(folder, "figure-6.6-octree", &exact.image())?;
    for bits in BITS {
        let s = exact.sample(bits)?;
        let name = bits.map_or("f32 fractions".to_owned(), |b| format!("{b} bits of fraction"));
        line(&format!("eight fetches, {name}, at the exact hits"), &s.at_exact_hits);
        line(&format!("eight fetches, {name}, at its own hits"), &s.at_own_hits);
        println!(
            "    {} pixels hit by one of the two; t off by {:.1e} voxel (median), {:.1e} (99 %), {:.1e}; {:.1} samples a hit",
            s.one_sided, s.off[0], s.off[1], s.off[2], s.samples
        );
        if bits == Some(FRACTION_BITS) {
            save(folder, "figure-6.6-sampled", &exact.sampled_image(&s))?;
            save(folder, "figure-6.6-normals", &exact.angle_image(&s))?;
        }
    }
    Ok(())
}
