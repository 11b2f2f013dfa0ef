//! Figures of Kalbe et al. 2009, as PNG files in a folder: `cargo run --release -p isobar-tetspline --example tetspline_figures -- FOLDER [MESH.off]`.
//!
//! - `fig5-*.png`: the function x^16 + y^16 + z^16 - cos 7x - cos 7y - cos 7z on 64^3 samples at four isovalues, plain and with texture.
//! - `fig6.png`: a closed cut through two isosurfaces of the same data (their Fig. 6, left, clips a head).
//! - `fig7.png`, `fig7-mouth.png`, `fig7-silhouette.png`, with a mesh: the signed distance to it at 256^3 with texture, and two close-ups with the curves on the faces of cubes, one into the mouth as theirs and
//!   one at the silhouette, further in. Meant for the mesh ChineseDragon-10kv.off, which looks along +z; theirs is another dragon.

#[path = "common/distance.rs"]
mod distance;

use isobar_core::{
    Channels, ClipPlane, DMat3, DVec3, Data, Frame, Grid, Knobs, Method, Request, Samples, Stop, Surface, View, to_srgb8,
};
use isobar_tetspline::TETSPLINE_CPU;
use std::path::Path;
use std::sync::Arc;

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

const SIZE: [usize; 2] = [640, 512];

fn main() -> Result<()> {
    let folder = std::env::args().nth(1).ok_or("a folder to write to")?;
    let folder = Path::new(&folder);
    std::fs::create_dir_all(folder)?;
    let chmutov = Arc::new(Data::Grid(chmutov()?));
    let view = View::fit(chmutov.bounds(), 38.0, SIZE[0], SIZE[1]);
    for (n, isovalue) in [-1.2, -0.6, 0.0, 0.8].into_iter().enumerate() {
        for texture in ["plain", "marble"] {
            let knobs = Knobs::default().with("texture", texture);
            let file = folder.join(format!("fig5-{n}-{texture}.png"));
            draw(&chmutov, &[Surface::isovalue(isovalue, n)], &view, knobs, &file)?;
        }
    }
    let mut cut = view;
    cut.clips = vec![ClipPlane {
        normal: DVec3::new(1.0, 0.8, 0.3),
        distance: 0.1,
        cap: true,
    }];
    // Minus the function, so that the solid is what the surface encloses.
    let Data::Grid(grid) = &*chmutov else {
        return Err("a grid".into());
    };
    let negative = negated(grid)?;
    let nested = [Surface::isovalue(-0.8, 0), Surface::isovalue(0.6, 1)];
    draw(&negative, &nested, &cut, Knobs::default(), &folder.join("fig6.png"))?;
    if let Some(mesh) = std::env::args().nth(2) {
        dragon(Path::new(&mesh), folder)?;
    }
    Ok(())
}

/// Fig. 5's function, 64 samples along each axis of [-1.1, 1.1]^3.
fn chmutov() -> Result<Grid> {
    const N: usize = 64;
    const SIDE: f64 = 1.1;
    let step = 2.0 * SIDE / (N as f64 - 1.0);
    let one = |i: usize| {
        let x = i as f64 * step - SIDE;
        x.powi(16) - (7.0 * x).cos()
    };
    let samples: Vec<f32> = (0..N * N * N)
        .map(|n| (one(n % N) + one(n / N % N) + one(n / N / N)) as f32)
        .collect();
    Ok(Grid::new(
        [N; 3],
        DVec3::splat(step),
        DVec3::splat(-SIDE),
        DMat3::IDENTITY,
        Samples::F32(samples.into()),
    )?)
}

fn negated(grid: &Grid) -> Result<Arc<Data>> {
    let Samples::F32(s) = &grid.samples else {
        return Err("f32".into());
    };
    let samples = Samples::F32(s.iter().map(|v| -v).collect::<Vec<f32>>().into());
    Ok(Arc::new(Data::Grid(Grid { samples, ..grid.clone() })))
}

fn dragon(mesh: &Path, folder: &Path) -> Result<()> {
    let grid = distance::field(&isobar_io::load_mesh(mesh)?, 256)?;
    let data = Arc::new(Data::Grid(grid));
    let surface = [Surface::isovalue(0.0, 2)];
    let (lo, hi) = data.bounds();
    let (middle, size) = ((lo + hi) * 0.5, (hi - lo).max_element());
    let look = |eye: DVec3, at: DVec3| View::perspective(eye, at, DVec3::Y, 30.0, SIZE[0], SIZE[1]);
    let eye = middle + DVec3::new(0.9, 0.25, 1.0).normalize() * (2.15 * size);
    let marble = Knobs::default().with("texture", "marble");
    let curves = marble.clone().with("overlay", "curves");
    let frame = draw(&data, &surface, &look(eye, middle), marble, &folder.join("fig7.png"))?;
    let mouth = DVec3::new(middle.x, lo.y + 0.74 * size, hi.z - 0.1 * size);
    let beside = mouth + DVec3::new(1.0, 0.1, 0.55).normalize() * (0.3 * size);
    draw(
        &data,
        &surface,
        &look(beside, mouth),
        curves.clone(),
        &folder.join("fig7-mouth.png"),
    )?;
    // A silhouette: the first pixel from the left of a row that hits; close by, the same ray is in the middle.
    let row = SIZE[1] / 3;
    let hit = (0..SIZE[0]).map(|x| row * SIZE[0] + x).find(|i| frame.t[*i].is_finite());
    let at = frame.point[hit.ok_or("the row hits nothing")?];
    let close = at + (eye - at).normalize() * size * 0.1;
    draw(&data, &surface, &look(close, at), curves, &folder.join("fig7-silhouette.png"))?;
    Ok(())
}

fn draw(data: &Arc<Data>, surfaces: &[Surface], view: &View, knobs: Knobs, file: &Path) -> Result<Frame> {
    let mut r = TETSPLINE_CPU.open(&Request {
        channels: Channels::T | Channels::POINT | Channels::NORMAL | Channels::RGBA,
        knobs,
        ..Request::default()
    })?;
    r.set_data(data)?;
    r.set_surfaces(surfaces)?;
    r.set_view(view)?;
    r.render(&Stop::default())?;
    let mut frame = Frame::default();
    r.read(&mut frame)?;
    let bytes: Vec<u8> = frame.rgba.iter().flat_map(|c| to_srgb8(*c)).collect();
    image::save_buffer(file, &bytes, SIZE[0] as u32, SIZE[1] as u32, image::ColorType::Rgb8)?;
    println!(
        "{}: {} pixels hit",
        file.display(),
        frame.t.iter().filter(|t| t.is_finite()).count()
    );
    Ok(frame)
}
