//! Tests on an adapter: kernels against their twins, frames against the oracle and `tetspline/cpu`, variants, claims, errors.

mod culling;
mod frames;
mod lists;
mod paint;
mod scenes;

use isobar_core::{
    Channels, DMat3, DVec3, Data, Frame, Grid, Knobs, Method, Renderer, Request, Samples, Stage, Stop, Surface, View,
};
use isobar_fields::Synthetic;
use isobar_gpu::{Gpu, test_adapter};
use isobar_oracle::{Check, Truth, check};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The shared device, for one test at a time: a test that waits for the device also runs what another one waits for.
pub(super) fn adapter(name: &str) -> Option<(Gpu, MutexGuard<'static, ()>)> {
    static ONE: Mutex<()> = Mutex::new(());
    let guard = ONE.lock().unwrap_or_else(PoisonError::into_inner);
    test_adapter(name).map(|gpu| (gpu, guard))
}

/// Seeded numbers in [0, 1).
pub(super) struct Random(pub(super) u64);

impl Random {
    pub(super) fn next(&mut self) -> f64 {
        // A linear congruence, its high bits taken.
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 40) as f64 / (1u64 << 24) as f64
    }
}

/// A grid of seeded random samples of each type.
pub(super) fn random_grid(dims: [usize; 3], which: usize) -> Grid {
    let mut r = Random(which as u64 + 7);
    let n = dims.iter().product();
    let mut draw = |scale: f64, offset: f64| (0..n).map(|_| r.next() * scale + offset).collect::<Vec<f64>>();
    let samples = match which {
        0 => Samples::U8(draw(256.0, 0.0).into_iter().map(|v| v as u8).collect()),
        1 => Samples::I16(draw(60000.0, -30000.0).into_iter().map(|v| v as i16).collect()),
        2 => Samples::U16(draw(65536.0, 0.0).into_iter().map(|v| v as u16).collect()),
        _ => Samples::F32(draw(2.0, -1.0).into_iter().map(|v| v as f32).collect()),
    };
    Grid::unit(dims, samples).unwrap()
}

pub(super) fn synthetic(spec: &str) -> Arc<Data> {
    Arc::new(spec.parse::<Synthetic>().unwrap().data().unwrap())
}

/// A request of every channel.
pub(super) fn request(layers: usize, knobs: Knobs) -> Request {
    Request {
        channels: Channels::all(),
        layers,
        knobs,
        ..Request::default()
    }
}

/// A request of the first hits only.
pub(super) fn first_hits(knobs: Knobs) -> Request {
    Request {
        channels: Channels::T | Channels::NORMAL | Channels::SURFACE | Channels::CLAIM,
        ..request(1, knobs)
    }
}

/// Draws one frame.
pub(super) fn draw(renderer: &mut dyn Renderer, data: &Arc<Data>, surfaces: &[Surface], view: &View) -> Frame {
    renderer.set_view(view).unwrap();
    renderer.set_surfaces(surfaces).unwrap();
    renderer.set_data(data).unwrap();
    redraw(renderer)
}

/// Draws what is set.
pub(super) fn redraw(renderer: &mut dyn Renderer) -> Frame {
    let mut frame = Frame::default();
    renderer.render(&Stop::default()).unwrap();
    renderer.read(&mut frame).unwrap();
    frame
}

/// Opens a method.
pub(super) fn open(method: &dyn Method, request: &Request) -> Box<dyn Renderer> {
    method.open(request).unwrap()
}

/// A first-hit frame against the oracle, with the renderer that drew it.
pub(super) fn checked(knobs: Knobs, data: &Arc<Data>, surfaces: &[Surface], view: &View) -> (Check, Box<dyn Renderer>) {
    let mut r = open(&super::TETSPLINE_GPU, &first_hits(knobs));
    let frame = draw(&mut *r, data, surfaces, view);
    let f = r.reconstruction(Stage::Stored).unwrap();
    let truth = Truth::compute(&f, surfaces, view, &Stop::default()).unwrap();
    (check(&frame, &truth, &f, surfaces, view).unwrap(), r)
}

/// Missed, false, on the wrong root, on the wrong surface.
pub(super) fn wrong(c: &Check) -> [usize; 4] {
    [c.missed, c.false_hits, c.wrong_root, c.wrong_surface]
}

/// A grid with skew, left-handed, anisotropic axes.
pub(super) fn oblique(grid: Grid) -> Grid {
    let direction = DMat3::from_cols(
        DVec3::new(0.0, 0.8, 0.6),
        DVec3::new(1.0, 0.0, 0.0),
        DVec3::new(0.0, 0.28, 0.96),
    );
    Grid::new(
        grid.dims,
        DVec3::new(1.0, 0.5, 2.0),
        DVec3::new(5.0, -2.0, 1.0),
        direction,
        grid.samples,
    )
    .unwrap()
}
