//! Frames of both methods.

mod bc21;
mod cases;
mod clips;
#[cfg(feature = "gpu")]
mod gpu;
#[cfg(feature = "gpu")]
mod gpu_scenes;
mod hard;
mod input;
mod packets;
mod reference;
mod truth;

use crate::PEAKS_CPU;
use isobar_core::{
    Channels, DVec3, Data, Frame, Grid, Knobs, Method, Ray, Renderer, Request, Samples, Stop, Surface, TransferFunction, View,
};
use std::sync::Arc;

const RED: [f32; 3] = [1.0, 0.0, 0.0];
const GREEN: [f32; 3] = [0.0, 1.0, 0.0];
const BLUE: [f32; 3] = [0.0, 0.0, 1.0];

/// Density of a peak of this opacity.
fn density(opacity: f64) -> f32 {
    -(1.0 - opacity).ln() as f32
}

/// A transfer function of near-Dirac peaks: value, colour, opacity, half-width.
fn peaks(of: &[(f64, [f32; 3], f64)], half: f64) -> TransferFunction {
    let mut points = Vec::new();
    for &(v, c, a) in of {
        points.extend([(v - half, c, 0.0), (v, c, density(a)), (v + half, c, 0.0)]);
    }
    TransferFunction::new(points, 1.0).unwrap()
}

fn knobs(of: &[(&str, &str)]) -> Knobs {
    let mut k = Knobs::default();
    for (name, value) in of {
        k.set(name, value);
    }
    k
}

fn open(
    method: &dyn Method,
    data: &Arc<Data>,
    surfaces: &[Surface],
    tf: Option<&TransferFunction>,
    request: Request,
) -> Box<dyn Renderer> {
    let mut r = method.open(&request).unwrap();
    r.set_data(data).unwrap();
    r.set_surfaces(surfaces).unwrap();
    r.set_medium(tf).unwrap();
    r
}

fn image(r: &mut dyn Renderer, view: &View) -> Frame {
    r.set_view(view).unwrap();
    r.render(&Stop::default()).unwrap();
    let mut f = Frame::default();
    r.read(&mut f).unwrap();
    f
}

fn request(layers: usize, k: &[(&str, &str)]) -> Request {
    Request {
        channels: Channels::all(),
        layers,
        threads: 1,
        knobs: knobs(k),
        ..Request::default()
    }
}

/// A frame with all channels.
fn draw(
    method: &dyn Method,
    data: &Arc<Data>,
    surfaces: &[Surface],
    tf: Option<&TransferFunction>,
    view: &View,
    (layers, k): (usize, &[(&str, &str)]),
) -> Frame {
    image(open(method, data, surfaces, tf, request(layers, k)).as_mut(), view)
}

/// A grid with a sample function, unit spacing.
fn grid(dims: [usize; 3], sample: impl Fn(usize, usize, usize) -> f64) -> Arc<Data> {
    let [nx, ny, nz] = dims;
    let samples: Vec<f32> = (0..nx * ny * nz)
        .map(|i| sample(i % nx, i / nx % ny, i / nx / ny) as f32)
        .collect();
    Arc::new(Data::Grid(Grid::unit(dims, Samples::F32(samples.into())).unwrap()))
}

fn ray(origin: [f64; 3], direction: [f64; 3]) -> View {
    View::rays(vec![Ray {
        origin: DVec3::from_array(origin),
        direction: DVec3::from_array(direction),
    }])
}

/// Hits of a frame of one ray.
fn hits(f: &Frame) -> Vec<(f64, u8)> {
    let found = f.t.iter().zip(&f.surface).filter(|(t, _)| t.is_finite());
    found.map(|(t, s)| (*t, *s)).collect()
}

fn near(got: &[(f64, u8)], want: &[(f64, u8)], tolerance: f64) {
    let same = got.len() == want.len()
        && got
            .iter()
            .zip(want)
            .all(|(g, w)| (g.0 - w.0).abs() <= tolerance && g.1 == w.1);
    assert!(same, "{got:?} instead of {want:?}");
}

fn exact(data: &Arc<Data>, tf: &TransferFunction, view: &View, mode: &str) -> Frame {
    draw(&PEAKS_CPU, data, &[], Some(tf), view, (8, &[("mode", mode)]))
}
