//! Figures 3 to 6 and 10 to 17 of Roettger, Kraus and Ertl 2000: `cargo run -p isobar-cellproj --example cellproj_figures -- FOLDER [BLUNTFIN [HEAD [BONSAI]]]` writes figure-3.png and so
//! on for the data that are given: bluntfinxyz.bin, a head and a bonsai as grids, which become tetrahedra.
//!
//! | figure | panels, left to right |
//! |---|---|
//! | 3, 4 | distance to a sphere, two thin shells: 3D texture 64^3; 2D texture 256^2 |
//! | 5 | a cell at the isovalue 0.5: the patch, by the stencil |
//! | 6 | a cell at 0.75, 0.5 and 0.3: flat patch and texture |
//! | 10, 11 | the same data: four coloured isosurfaces, smooth; with figure 4's medium |
//! | 12 | opacity 0.25 in the 3D texture of figure 15 |
//! | 13, 15 | blunt fin: textures of back faces, medium, front faces; the medium stopped at the isovalues |
//! | 14 | blunt fin, three isosurfaces and the medium: as printed, `cellproj/cpu` |
//! | 16, 17 | head, bonsai: an isosurface and the medium, `cellproj/cpu` |

use image::{Rgb, RgbImage};
use isobar_cellproj::{CELLPROJ_CPU, CELLPROJ_CPU_PAPER, TextureMap, TextureMaps};
use isobar_core::{
    Camera, DVec3, Data, Frame, Grid, Knobs, Method, Request, Samples, Stop, Surface, TetMesh, TransferFunction, View, to_srgb8,
};
use isobar_fields::{Synthetic, grid_to_tets};
use std::path::{Path, PathBuf};
use std::sync::Arc;

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

const RED: [f32; 3] = [0.8, 0.1, 0.05];
const GREEN: [f32; 3] = [0.1, 0.55, 0.12];
const BLUE: [f32; 3] = [0.1, 0.25, 0.85];
const GOLD: [f32; 3] = [0.9, 0.65, 0.1];
const BROWN: [f32; 3] = [0.35, 0.18, 0.08];

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [folder, files @ ..] = &arguments[..] else {
        return Err("figures FOLDER [BLUNTFIN [HEAD [BONSAI]]]".into());
    };
    let folder = PathBuf::from(folder);
    std::fs::create_dir_all(&folder)?;
    sphere(&folder)?;
    cells(&folder)?;
    if let Some(file) = files.first() {
        blunt_fin(&folder, Path::new(file))?;
    }
    if let Some(file) = files.get(1) {
        // Soft tissue over the medium of what is denser.
        let medium = |lo: f64, hi: f64| {
            vec![
                (lo, GREEN, 0.0),
                (lo + 0.35 * (hi - lo), GREEN, 0.0),
                (hi, [0.5, 0.3, 0.1], 0.2),
            ]
        };
        scan(
            &folder.join("figure-16.png"),
            Path::new(file),
            96,
            (0.22, [0.85, 0.6, 0.5], 0.35),
            // The slices go from the crown down.
            (-DVec3::Z, DVec3::new(0.8, -2.4, -0.6)),
            medium,
        )?;
    }
    if let Some(file) = files.get(2) {
        // Leaves as the medium, trunk and branches as the surface.
        let medium = |lo: f64, hi: f64| {
            let at = |x: f64| lo + x * (hi - lo);
            vec![(at(0.14), GREEN, 0.0), (at(0.22), GREEN, 0.06), (at(0.36), GREEN, 0.0)]
        };
        let look = (DVec3::Y, DVec3::new(0.5, 0.6, 2.4));
        let path = folder.join("figure-17.png");
        scan(&path, Path::new(file), 128, (0.42, BROWN, 1.0), look, medium)?;
    }
    Ok(())
}

fn save(path: &Path, panels: &[RgbImage]) -> Result<()> {
    const GAP: u32 = 8;
    let width = panels.iter().map(|p| p.width() + GAP).sum::<u32>() + GAP;
    let height = panels.iter().map(RgbImage::height).max().unwrap_or(0) + 2 * GAP;
    let mut out = RgbImage::from_pixel(width, height, Rgb([255; 3]));
    let mut x = GAP;
    for panel in panels {
        image::imageops::replace(&mut out, panel, x.into(), GAP.into());
        x += panel.width() + GAP;
    }
    out.save(path)?;
    println!("{}", path.display());
    Ok(())
}

/// Over white.
fn picture(frame: &Frame) -> RgbImage {
    let w = frame.width;
    RgbImage::from_fn(w as u32, frame.height as u32, |x, y| {
        Rgb(to_srgb8(frame.rgba[y as usize * w + x as usize]))
    })
}

/// s_f to the right, s_b upward, over black as in the paper.
fn texture(map: &TextureMap) -> RgbImage {
    let n = map.side as u32;
    RgbImage::from_fn(n, n, |x, y| {
        let [r, g, b, _] = map.texels[((n - 1 - y) * n + x) as usize];
        Rgb(to_srgb8([r, g, b, 1.0]))
    })
}

fn draw(
    method: &dyn Method,
    data: &Arc<Data>,
    surfaces: &[Surface],
    transfer: Option<&TransferFunction>,
    view: &View,
    knobs: Knobs,
) -> Result<RgbImage> {
    let request = Request {
        knobs,
        ..Request::default()
    };
    let mut r = method.open(&request)?;
    r.set_data(data)?;
    r.set_surfaces(surfaces)?;
    r.set_medium(transfer)?;
    r.set_view(view)?;
    r.render(&Stop::default())?;
    let mut frame = Frame::default();
    r.read(&mut frame)?;
    Ok(picture(&frame))
}

fn set(knobs: &[(&str, &str)]) -> Knobs {
    knobs.iter().fold(Knobs::default(), |k, (name, value)| k.with(name, value))
}

fn orthographic(eye: DVec3, target: DVec3, height: f64, size: (usize, usize)) -> View {
    View {
        camera: Camera::Orthographic {
            eye,
            target,
            up: DVec3::Z,
            height,
        },
        width: size.0,
        height: size.1,
        clips: vec![],
    }
}

fn surfaces(values: &[(f64, [f32; 3])]) -> Vec<Surface> {
    let surface = |(i, &(c, colour)): (usize, &(f64, [f32; 3]))| Surface {
        colour,
        ..Surface::isovalue(c, i)
    };
    values.iter().enumerate().map(surface).collect()
}

/// Figures 3, 4, 10, 11: the distance to the surface of a sphere on a mesh of a grid.
fn sphere(folder: &Path) -> Result<()> {
    let Data::Tets(base) = "sphere,n=17,as=tets".parse::<Synthetic>()?.data()? else {
        return Err("no mesh".into());
    };
    let distance: Vec<f32> = base.points.iter().map(|p| (p.length() - 0.6).abs() as f32).collect();
    let data = Arc::new(Data::Tets(TetMesh::new(base.points, base.cells, distance.into())?));
    let view = orthographic(DVec3::new(0.0, -4.0, 0.001), DVec3::ZERO, 2.1, (384, 384));
    let shells = TransferFunction::new(
        vec![
            (0.10, RED, 0.0),
            (0.13, RED, 6.0),
            (0.16, [0.9, 0.7, 0.1], 6.0),
            (0.19, GOLD, 0.0),
        ],
        1.0,
    )?;
    let medium = |volume: &str| {
        draw(
            &CELLPROJ_CPU_PAPER,
            &data,
            &[],
            Some(&shells),
            &view,
            set(&[("volume", volume)]),
        )
    };
    save(&folder.join("figure-3.png"), &[medium("table3d")?])?;
    save(&folder.join("figure-4.png"), &[medium("table2d")?])?;
    // The nearest to the sphere opaque, those around it glass.
    let mut four = surfaces(&[(0.06, RED), (0.22, GOLD), (0.34, GREEN), (0.5, BLUE)]);
    for s in &mut four[1..] {
        s.opacity = 0.3;
    }
    let tilted = orthographic(DVec3::new(2.6, 1.9, 2.2), DVec3::ZERO, 2.4, (384, 384));
    let mixed = |transfer| draw(&CELLPROJ_CPU_PAPER, &data, &four, transfer, &tilted, Knobs::default());
    save(&folder.join("figure-10.png"), &[mixed(None)?])?;
    save(&folder.join("figure-11.png"), &[mixed(Some(&shells))?])?;
    Ok(())
}

/// Figures 5 and 6: one cell.
fn cells(folder: &Path) -> Result<()> {
    let points = vec![
        DVec3::new(-1.0, -0.8, -0.6),
        DVec3::new(1.0, -0.7, -0.5),
        DVec3::new(0.1, 0.9, -0.3),
        DVec3::new(0.0, 0.0, 0.9),
    ];
    let mesh = TetMesh::new(points.into(), vec![[0, 1, 2, 3]].into(), vec![0.0, 1.0, 0.35, 0.6].into())?;
    let data = Arc::new(Data::Tets(mesh.clone()));
    let view = orthographic(DVec3::new(0.8, -2.0, 1.2), DVec3::ZERO, 2.2, (256, 256));
    let (mut stencil, mut flat) = (Vec::new(), Vec::new());
    for (c, colour) in [(0.75, RED), (0.5, GREEN), (0.3, BLUE)] {
        let s = surfaces(&[(c, colour)]);
        let one = |word: &str| {
            let knobs = set(&[("isosurface", word), ("shading", "flat")]);
            draw(&CELLPROJ_CPU_PAPER, &data, &s, None, &view, knobs)
        };
        if c == 0.5 {
            stencil.push(one("stencil")?);
        }
        let maps = TextureMaps::new(&mesh, &s, None, &Knobs::default())?;
        flat.extend([one("texture")?, texture(&maps.flat.ok_or("no texture")?)]);
    }
    save(&folder.join("figure-5.png"), &stencil)?;
    save(&folder.join("figure-6.png"), &flat)
}

/// Figures 12 to 15.
fn blunt_fin(folder: &Path, file: &Path) -> Result<()> {
    let data = Arc::new(isobar_io::load(file, &isobar_io::Options::default())?.data);
    let Data::Tets(mesh) = &*data else {
        return Err("the blunt fin is no mesh".into());
    };
    let unit = (data.bounds().1 - data.bounds().0).max_element() / 256.0;
    let points = vec![
        (0.19, [0.1, 0.2, 0.9], 0.02),
        (0.7, [0.1, 0.45, 0.8], 0.008),
        (0.95, [0.2, 0.7, 0.6], 0.0),
        (1.05, [0.6, 0.8, 0.2], 0.0),
        (1.6, [1.0, 0.85, 0.1], 0.012),
        (2.6, [1.0, 0.4, 0.05], 0.03),
        (5.0, [1.0, 0.95, 0.9], 0.08),
    ];
    let transfer = TransferFunction::new(points, unit)?;
    let three = surfaces(&[(0.7, BLUE), (1.6, GOLD), (2.6, RED)]);
    let maps = |knobs: &[(&str, &str)]| TextureMaps::new(mesh, &three, Some(&transfer), &set(knobs));
    let all = maps(&[])?;
    let need = |m: Option<&TextureMap>| m.map(texture).ok_or("no texture");
    let panels = [need(all.back.as_ref())?, need(all.volume.first())?, need(all.front.as_ref())?];
    save(&folder.join("figure-13.png"), &panels)?;
    let stopped = maps(&[("mixing", "stopped")])?;
    save(&folder.join("figure-15.png"), &[need(stopped.volume.first())?])?;
    let view = View::fit(data.bounds(), 40.0, 512, 384);
    let view = match view.camera {
        Camera::Perspective { eye, target, fov, .. } => {
            let height = 1.2 * (target - eye).length() * (0.5 * fov.to_radians()).tan();
            orthographic(eye, target, height, (512, 384))
        }
        _ => view,
    };
    let panel = |method: &dyn Method, knobs| draw(method, &data, &three, Some(&transfer), &view, knobs);
    let panels = [
        panel(&CELLPROJ_CPU_PAPER, Knobs::default())?,
        panel(&CELLPROJ_CPU, set(&[("shading", "smooth")]))?,
    ];
    save(&folder.join("figure-14.png"), &panels)?;
    // The texture's own opacity as a field over (s_f, s_b, l).
    let stopped = maps(&[("mixing", "stopped"), ("volume", "table3d"), ("table", "64")])?.volume;
    let alpha: Vec<f32> = stopped.iter().flat_map(|s| s.texels.iter().map(|t| t[3])).collect();
    let n = stopped.len();
    let grid = Grid::unit([n; 3], Samples::F32(alpha.into()))?;
    let field = Arc::new(Data::Tets(grid_to_tets(&grid)?));
    let centre = DVec3::splat(0.5 * (n - 1) as f64);
    let view = View::perspective(
        centre + DVec3::new(-1.5, -1.9, 1.2) * n as f64,
        centre,
        DVec3::Z,
        35.0,
        384,
        384,
    );
    let image = draw(
        &CELLPROJ_CPU,
        &field,
        &surfaces(&[(0.25, GOLD)]),
        None,
        &view,
        Knobs::default(),
    )?;
    save(&folder.join("figure-12.png"), &[image])
}

/// Figures 16 and 17: a grid, thinned out to at most `most` samples along its axes, as tetrahedra. `surface`: where in the range it lies, colour and opacity; `look`: what is up and from
/// where.
fn scan(
    path: &Path,
    file: &Path,
    most: usize,
    surface: (f64, [f32; 3], f32),
    look: (DVec3, DVec3),
    medium: impl Fn(f64, f64) -> Vec<(f64, [f32; 3], f32)>,
) -> Result<()> {
    let Data::Grid(grid) = isobar_io::load(file, &isobar_io::Options::default())?.data else {
        return Err(format!("{}: no grid", file.display()).into());
    };
    let step = grid.dims.iter().max().ok_or("no axes")?.div_ceil(most);
    let dims = grid.dims.map(|n| n.div_ceil(step));
    let mut samples = Vec::with_capacity(dims.iter().product());
    for k in 0..dims[2] {
        for j in 0..dims[1] {
            for i in 0..dims[0] {
                let at = ((k * step) * grid.dims[1] + j * step) * grid.dims[0] + i * step;
                samples.push(grid.samples.get(at) as f32);
            }
        }
    }
    let (lo, hi) = samples.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), &v| {
        (a.min(v.into()), b.max(v.into()))
    });
    let thin = Grid::new(
        dims,
        grid.spacing * step as f64,
        grid.origin,
        grid.direction,
        Samples::F32(samples.into()),
    )?;
    let data = Arc::new(Data::Tets(grid_to_tets(&thin)?));
    let unit = (data.bounds().1 - data.bounds().0).max_element() / 256.0;
    let transfer = TransferFunction::new(medium(lo, hi), unit)?;
    let (share, colour, opacity) = surface;
    let mut one = surfaces(&[(lo + share * (hi - lo), colour)]);
    one[0].opacity = opacity;
    let (a, b) = data.bounds();
    let view = View::fit_from((a, b), look.1, look.0, 30.0, 400, 400);
    let image = draw(
        &CELLPROJ_CPU,
        &data,
        &one,
        Some(&transfer),
        &view,
        set(&[("shading", "smooth")]),
    )?;
    save(path, &[image])
}
