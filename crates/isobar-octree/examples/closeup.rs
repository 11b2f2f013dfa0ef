//! Figure 6.6 of Steinberger 2010: a close-up by fast tri-cubic texture sampling with the weights of a texture unit, beside `octree/cpu`, and the angle between
//! their normals. `cargo run --release -p isobar-octree --example closeup -- DATA ISOVALUE [VOXELS] [FOLDER]`: DATA a file or a synthetic field, VOXELS the distance
//! of the eye from the surface; with a folder three pictures are written there as PNG.

use isobar_core::{
    Channels, DVec3, Data, Frame, Function, Grid, Knobs, Method, Request, Stage, Stop, Surface, View, shade, to_srgb8,
};
use isobar_fields::{GridSpline, Kind, Synthetic};
use isobar_octree::comparators::texture::{Angles, FRACTION_BITS, Found, March, Texture};
use std::error::Error;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

type Result<T> = std::result::Result<T, Box<dyn Error>>;

const SIZE: [usize; 2] = [512, 384];

fn main() -> Result<()> {
    let mut args = std::env::args().skip(1);
    let usage = "usage: closeup DATA ISOVALUE [VOXELS] [FOLDER]";
    let source = args.next().ok_or(usage)?;
    let isovalue: f64 = args.next().ok_or(usage)?.parse()?;
    let voxels: f64 = args.next().map_or(Ok(4.0), |s| s.parse())?;
    let folder: Option<PathBuf> = args.next().map(PathBuf::from);
    let data = match source.parse::<Synthetic>() {
        Ok(s) => s.data()?,
        Err(_) => isobar_io::load(Path::new(&source), &isobar_io::Options::default())?.data,
    };
    let Data::Grid(grid) = &data else {
        return Err(format!("{source} holds no grid").into());
    };
    let grid = grid.clone();
    let data = Arc::new(data);
    let overview = View::fit(data.bounds(), 40.0, SIZE[0], SIZE[1]);
    let view = near(&draw(&data, isovalue, &overview)?.0, &overview, &grid, voxels)?;
    let (frame, seconds) = draw(&data, isovalue, &view)?;
    let spline = GridSpline::new(&grid, Kind::Cubic, Stage::Stored)?;
    let exact = |p: DVec3| spline.gradient(p).normalize_or_zero();
    let hits = frame.t.iter().filter(|t| t.is_finite()).count();
    println!(
        "{source} at {isovalue}, eye {voxels} voxels from the surface, {hits} of {} pixels hit; octree/cpu {:.0} ms",
        view.pixels(),
        seconds * 1e3
    );
    let own = (0..view.pixels()).filter(|&i| frame.t[i].is_finite());
    let own = Angles::between(own.map(|i| (DVec3::from_array(frame.normal[i].map(f64::from)), exact(frame.point[i]))));
    println!("\nangle to the exact gradient of the cubic B-spline, degrees    median      99 %  greatest");
    println!(
        "octree/cpu, at its own hits (normals stored as f32)         {:8.5}  {:8.5}  {:8.5}",
        own.p50, own.p99, own.max
    );
    for bits in [None, Some(9), Some(FRACTION_BITS)] {
        let texture = Texture::new(&grid, bits)?;
        let name = bits.map_or("f32 fractions".to_owned(), |b| format!("{b} bits of fraction"));
        let at = (frame.point.iter()).filter(|p| p.is_finite());
        let a = Angles::between(at.map(|&p| (texture.normal(p), exact(p))));
        println!(
            "{:58}  {:8.5}  {:8.5}  {:8.5}",
            format!("eight fetches, {name}, at the exact hits"),
            a.p50,
            a.p99,
            a.max
        );
        let (found, seconds) = sampled(&texture, &view, isovalue, &grid);
        let pairs = (found.iter().enumerate()).filter_map(|(i, f)| f.map(|f| (f.normal, exact(ray(&view, i).at(f.t)))));
        let a = Angles::between(pairs);
        println!(
            "{:58}  {:8.5}  {:8.5}  {:8.5}",
            format!("eight fetches, {name}, at its own hits"),
            a.p50,
            a.p99,
            a.max
        );
        report(&found, &frame, &grid, seconds);
        if let (Some(FRACTION_BITS), Some(folder)) = (bits, &folder) {
            pictures(folder, &view, &frame, &found)?;
        }
    }
    Ok(())
}

fn ray(view: &View, i: usize) -> isobar_core::Ray {
    view.ray(i % view.width, i / view.width)
}

/// The frame of `octree/cpu` on one thread, and the seconds it took.
fn draw(data: &Arc<Data>, isovalue: f64, view: &View) -> Result<(Frame, f64)> {
    let request = Request {
        channels: Channels::T | Channels::POINT | Channels::NORMAL,
        threads: 1,
        knobs: Knobs::default().with("reconstruction", "cubic"),
        ..Request::default()
    };
    let mut r = isobar_octree::OCTREE_CPU.open(&request)?;
    r.set_data(data)?;
    r.set_surfaces(&[Surface::isovalue(isovalue, 0)])?;
    r.set_view(view)?;
    r.render(&Stop::default())?;
    let seconds = r.render(&Stop::default())?.wall.as_secs_f64();
    let mut frame = Frame::default();
    r.read(&mut frame)?;
    Ok((frame, seconds))
}

/// A view of what the middle of the overview hits, from that many voxels before it.
fn near(frame: &Frame, overview: &View, grid: &Grid, voxels: f64) -> Result<View> {
    let middle = |i: usize| {
        let (x, y) = (i % overview.width, i / overview.width);
        x.abs_diff(overview.width / 2).pow(2) + y.abs_diff(overview.height / 2).pow(2)
    };
    let at = (0..overview.pixels())
        .filter(|&i| frame.t[i].is_finite())
        .min_by_key(|&i| middle(i))
        .ok_or("the surface is not in view; give an isovalue inside the range of the data")?;
    let d = ray(overview, at).direction;
    let eye = frame.point[at] - d * (voxels * grid.spacing.min_element());
    Ok(View::perspective(eye, frame.point[at], DVec3::Z, 60.0, SIZE[0], SIZE[1]))
}

/// Every pixel by sampling, and the seconds that took.
fn sampled(texture: &Texture, view: &View, isovalue: f64, grid: &Grid) -> (Vec<Option<Found>>, f64) {
    let range = grid.samples.range().0.map_or(1.0, |(lo, hi)| hi - lo);
    let march = March {
        step: 0.5,
        fine: 0.125,
        near: 0.1 * range,
        halvings: 12,
    };
    let clock = Instant::now();
    let found = (0..view.pixels())
        .map(|i| texture.first(&ray(view, i), isovalue, &march))
        .collect();
    (found, clock.elapsed().as_secs_f64())
}

/// How the hits differ.
fn report(found: &[Option<Found>], frame: &Frame, grid: &Grid, seconds: f64) {
    let voxel = grid.spacing.min_element();
    let one_sided = found
        .iter()
        .zip(&frame.t)
        .filter(|(f, t)| f.is_some() != t.is_finite())
        .count();
    let mut off: Vec<f64> = (found.iter().zip(&frame.t))
        .filter(|(_, t)| t.is_finite())
        .filter_map(|(f, t)| f.map(|f| (f.t - t).abs() / voxel))
        .collect();
    off.sort_by(f64::total_cmp);
    let at = |share: f64| {
        off.get((off.len() as f64 * share) as usize)
            .or(off.last())
            .copied()
            .unwrap_or(0.0)
    };
    let samples: u64 = found.iter().flatten().map(|f| u64::from(f.samples)).sum();
    println!(
        "    {one_sided} pixels hit by one of the two; t off by {:.1e} voxel (median), {:.1e} (99 %), {:.1e}; {:.1} samples a hit; {:.0} ms, emulated and without an octree",
        at(0.5),
        at(0.99),
        at(1.0),
        samples as f64 / off.len().max(1) as f64,
        seconds * 1e3
    );
}

/// The exact close-up, the sampled one, and the angle between their normals: black 0, white 2 degrees and more.
fn pictures(folder: &Path, view: &View, frame: &Frame, found: &[Option<Found>]) -> Result<()> {
    std::fs::create_dir_all(folder)?;
    let lit = |n: [f32; 3], i: usize| {
        let [r, g, b] = shade([0.85, 0.75, 0.6], n, ray(view, i).direction);
        to_srgb8([r, g, b, 1.0])
    };
    let octree = (0..view.pixels()).map(|i| {
        if frame.t[i].is_finite() {
            lit(frame.normal[i], i)
        } else {
            [255; 3]
        }
    });
    let texture = (0..view.pixels()).map(|i| found[i].map_or([255; 3], |f| lit(f.normal.as_vec3().to_array(), i)));
    let angle = (0..view.pixels()).map(|i| {
        let Some(f) = found[i].filter(|_| frame.t[i].is_finite()) else {
            return [0, 0, 64];
        };
        let a = Angles::between([(f.normal, DVec3::from_array(frame.normal[i].map(f64::from)))]).max;
        [(a / 2.0 * 255.0).min(255.0) as u8; 3]
    });
    write(folder, "figure-6.6-octree", view, octree)?;
    write(folder, "figure-6.6-sampled", view, texture)?;
    write(folder, "figure-6.6-normals", view, angle)
}

fn write(folder: &Path, name: &str, view: &View, pixels: impl Iterator<Item = [u8; 3]>) -> Result<()> {
    let path = folder.join(name).with_file_name(format!("{name}.png"));
    let bytes: Vec<u8> = pixels.flatten().collect();
    let (width, height) = (u32::try_from(view.width)?, u32::try_from(view.height)?);
    let picture = image::RgbImage::from_raw(width, height, bytes).ok_or("three bytes a pixel")?;
    picture.save(&path)?;
    println!("    {}", path.display());
    Ok(())
}
