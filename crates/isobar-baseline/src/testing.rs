//! What the tests of both CPU rulers use.

use isobar_core::{
    Channels, DMat3, DVec3, Data, Frame, Grid, Knobs, Method, Ray, Renderer, Request, Samples, Stop, Surface, View,
};
use std::sync::Arc;

/// A seeded generator of numbers in [0, 1).
pub(crate) struct Seed(pub(crate) u64);

impl Seed {
    pub(crate) fn next(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    pub(crate) fn between(&mut self, a: f64, b: f64) -> f64 {
        a + (b - a) * self.next()
    }

    /// A point of the box [a, b]^3.
    pub(crate) fn point(&mut self, a: f64, b: f64) -> DVec3 {
        DVec3::new(self.between(a, b), self.between(a, b), self.between(a, b))
    }
}

/// f at the points of an n^3 lattice with unit spacing, centred on the origin, as f32.
pub(crate) fn sampled(n: usize, f: impl Fn(DVec3) -> f64) -> Arc<Data> {
    let h = (n - 1) as f64 / 2.0;
    let at = |i: usize| DVec3::new((i % n) as f64, (i / n % n) as f64, (i / n / n) as f64) - h;
    let s: Arc<[f32]> = (0..n * n * n).map(|i| f(at(i)) as f32).collect();
    let grid = Grid::new([n; 3], DVec3::ONE, DVec3::splat(-h), DMat3::IDENTITY, Samples::F32(s));
    Arc::new(Data::Grid(grid.expect("n is at least 2")))
}

/// Opaque isosurfaces.
pub(crate) fn isovalues(values: &[f64]) -> Vec<Surface> {
    values.iter().enumerate().map(|(i, v)| Surface::isovalue(*v, i)).collect()
}

/// All channels, one thread, these settings.
pub(crate) fn request(knobs: Knobs) -> Request {
    Request {
        channels: Channels::all(),
        threads: 1,
        knobs,
        ..Request::default()
    }
}

/// A renderer with everything set.
pub(crate) fn ready(m: &dyn Method, data: &Arc<Data>, s: &[Surface], view: &View, request: &Request) -> Box<dyn Renderer> {
    let mut r = m.open(request).expect("the request is good");
    r.set_data(data).expect("the data are good");
    r.set_surfaces(s).expect("the surfaces are good");
    r.set_view(view).expect("the view is good");
    r
}

/// Draws and reads a frame.
pub(crate) fn draw(m: &dyn Method, data: &Arc<Data>, s: &[Surface], view: &View, request: &Request) -> Frame {
    let mut r = ready(m, data, s, view, request);
    r.render(&Stop::default()).expect("everything is set");
    let mut f = Frame::default();
    r.read(&mut f).expect("it is drawn");
    f
}

/// Random rays through the box [-h, h]^3 of [`sampled`], from outside and from inside.
pub(crate) fn rays(seed: u64, n: usize, h: f64) -> Vec<Ray> {
    let mut s = Seed(seed);
    (0..n)
        .map(|i| {
            let origin = s.point(-h, h) * if i % 3 == 0 { 0.9 } else { 4.0 };
            let target = s.point(-h, h) * 0.7;
            Ray {
                origin,
                direction: (target - origin).normalize(),
            }
        })
        .collect()
}
