//! Figures 6.2 to 6.5 of Steinberger 2010: a volume in degrees 1, 2 and 3, and the bricks that have to be looked into, side by side.
//! `cargo run --release -p isobar-octree --example bricks -- DATA ISOVALUE PICTURE.png [SIDE]`, 512x384 each, with the default view. The thesis's bricks have 2^3 cells; those of the
//! caster have 4^3, the default here. A brick is drawn where its samples lie on both sides of the isovalue, as the caster of degree 1 has it.

use isobar_core::{Channels, DVec3, Data, Frame, Grid, Knobs, Method, Request, Stop, Surface, View, shade, to_srgb8};
use isobar_fields::{Kind, Synthetic};
use std::path::Path;
use std::sync::Arc;

const SIZE: (u32, u32) = (512, 384);

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [source, isovalue, path, rest @ ..] = arguments.as_slice() else {
        return Err("usage: bricks DATA ISOVALUE PICTURE.png [SIDE]".into());
    };
    let (isovalue, side): (f64, usize) = (isovalue.parse()?, rest.first().map_or(Ok(4), |s| s.parse())?);
    let data = match source.parse::<Synthetic>() {
        Ok(s) => s.data()?,
        Err(_) => isobar_io::load(Path::new(source), &isobar_io::Options::default())?.data,
    };
    let Data::Grid(grid) = &data else {
        return Err(format!("{source} holds no grid").into());
    };
    let bricks = Bricks::new(grid, isovalue, side.max(1));
    let active = bricks.active.iter().filter(|a| **a).count();
    println!(
        "{source} at {isovalue}: {active} of {} bricks of {side}^3 cells are active, {:.1} %",
        bricks.active.len(),
        100.0 * active as f64 / bricks.active.len() as f64
    );
    let view = View::fit(data.bounds(), 40.0, SIZE.0 as usize, SIZE.1 as usize);
    let data = Arc::new(data);
    let mut out = image::RgbImage::new(4 * SIZE.0, SIZE.1);
    for (i, kind) in [Kind::Trilinear, Kind::Quadratic, Kind::Cubic].into_iter().enumerate() {
        let frame = draw(&data, isovalue, kind, &view)?;
        for (n, p) in frame.rgba.iter().enumerate() {
            let (x, y) = (n as u32 % SIZE.0, n as u32 / SIZE.0);
            out.put_pixel(i as u32 * SIZE.0 + x, y, image::Rgb(to_srgb8(*p)));
        }
    }
    for (x, y) in (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| (x, y))) {
        let colour = bricks.colour(&view, x as usize, y as usize);
        out.put_pixel(3 * SIZE.0 + x, y, image::Rgb(to_srgb8(colour)));
    }
    out.save(path)?;
    println!("{path}");
    Ok(())
}

fn draw(data: &Arc<Data>, isovalue: f64, kind: Kind, view: &View) -> Result<Frame, Box<dyn std::error::Error>> {
    let request = Request {
        channels: Channels::T | Channels::RGBA,
        knobs: Knobs::default().with("reconstruction", kind.name()),
        ..Request::default()
    };
    let mut r = isobar_octree::OCTREE_CPU.open(&request)?;
    r.set_data(data)?;
    r.set_surfaces(&[Surface::isovalue(isovalue, 0)])?;
    r.set_view(view)?;
    r.render(&Stop::default())?;
    let mut frame = Frame::default();
    r.read(&mut frame)?;
    Ok(frame)
}

/// Which bricks have samples on both sides of the isovalue.
struct Bricks {
    domain: isobar_core::Domain,
    side: usize,
    /// Per axis.
    count: [usize; 3],
    active: Vec<bool>,
}

impl Bricks {
    fn new(grid: &Grid, isovalue: f64, side: usize) -> Self {
        let [nx, ny, nz] = grid.dims;
        let count = grid.dims.map(|n| (n - 1).div_ceil(side));
        let mut range = vec![(f64::INFINITY, f64::NEG_INFINITY); count.iter().product()];
        // A sample belongs to the bricks on both sides of it.
        let of = |i: usize, n: usize| i.saturating_sub(1) / side..=(i / side).min((n - 1).div_ceil(side) - 1);
        for (z, y, x) in (0..nz).flat_map(|z| (0..ny).flat_map(move |y| (0..nx).map(move |x| (z, y, x)))) {
            let v = grid.samples.get((z * ny + y) * nx + x);
            for (k, j, i) in of(z, nz).flat_map(|k| of(y, ny).flat_map(move |j| of(x, nx).map(move |i| (k, j, i)))) {
                let r = &mut range[(k * count[1] + j) * count[0] + i];
                *r = (r.0.min(v), r.1.max(v));
            }
        }
        Self {
            domain: grid.domain(),
            side,
            count,
            active: range.into_iter().map(|(lo, hi)| lo <= isovalue && isovalue <= hi).collect(),
        }
    }

    /// The first active brick along the ray of a pixel, its edges darker.
    fn colour(&self, view: &View, x: usize, y: usize) -> [f32; 4] {
        let ray = view.ray(x, y);
        let (o, d) = (self.domain.local(ray.origin), self.domain.local_vector(ray.direction));
        let Some((mut t, end)) = self.domain.clip(&ray) else {
            return [0.0; 4];
        };
        let side = self.side as f64;
        let mut axis = 0;
        while t <= end {
            // A little beyond the face that was passed.
            let p = (o + d * (t + 1e-9 * (1.0 + t.abs()))) / side;
            let at = [0, 1, 2].map(|a| (p[a].floor().max(0.0) as usize).min(self.count[a] - 1));
            if self.active[(at[2] * self.count[1] + at[1]) * self.count[0] + at[0]] {
                let q = (o + d * t) / side;
                let near = |a: usize| (q[a] - at[a] as f64 - 0.5).abs() > 0.45;
                let edge = (0..3).filter(|&a| a != axis).any(near);
                let normal = (self.domain.world_gradient(DVec3::AXES[axis]))
                    .normalize()
                    .as_vec3()
                    .to_array();
                let [r, g, b] = shade([0.9, 0.75, 0.35], normal, ray.direction).map(|c| if edge { 0.4 * c } else { c });
                return [r, g, b, 1.0];
            }
            let exit = |a: usize| {
                let plane = if d[a] > 0.0 { at[a] + 1 } else { at[a] };
                if d[a] == 0.0 {
                    f64::INFINITY
                } else {
                    (plane as f64 * side - o[a]) / d[a]
                }
            };
            let exits = [exit(0), exit(1), exit(2)];
            axis = (0..3).fold(0, |m, a| if exits[a] < exits[m] { a } else { m });
            t = exits[axis].max(t + 1e-12 * (1.0 + t.abs()));
        }
        [0.0; 4]
    }
}
