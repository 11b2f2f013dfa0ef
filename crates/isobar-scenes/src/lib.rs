//! What the tests of methods share: seeded data, drawing one frame, the frame against the oracle, and whole [`trials`].
//!
//! A dev-dependency of methods: nothing that is shipped needs it. Functions panic where a test would fail.

pub mod trials;

use isobar_core::{
    Channels, DMat3, DVec3, Data, Frame, Grid, Knobs, Method, Ray, Renderer, Request, Samples, Stage, Stop, Surface, View,
};
use isobar_fields::Synthetic;
use isobar_oracle::{Check, Truth, check};
use std::sync::Arc;

/// A seeded generator of numbers: a linear congruence, its high bits taken.
#[derive(Debug, Clone)]
pub struct Random(pub u64);

impl Random {
    fn step(&mut self) -> u64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        self.0
    }

    /// In [0, 1), of 53 bits.
    pub fn unit(&mut self) -> f64 {
        (self.step() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// In [0, 1), of 24 bits: exact in f32.
    pub fn single(&mut self) -> f64 {
        (self.step() >> 40) as f64 / (1u64 << 24) as f64
    }

    /// In the unit cube.
    pub fn vector(&mut self) -> DVec3 {
        DVec3::new(self.unit(), self.unit(), self.unit())
    }

    /// Of unit length, each as likely as any other.
    pub fn direction(&mut self) -> DVec3 {
        loop {
            let v = self.vector() * 2.0 - 1.0;
            if v.length() > 0.1 && v.length() < 1.0 {
                return v.normalize();
            }
        }
    }
}

/// The data of a synthetic field such as `gyroid,n=32`.
///
/// # Panics
/// When there is none of that name.
#[must_use]
pub fn synthetic(spec: &str) -> Arc<Data> {
    Arc::new(spec.parse::<Synthetic>().unwrap().data().unwrap())
}

/// White noise in [0, 1), away from the origin.
///
/// # Panics
/// When there is no such grid.
#[must_use]
pub fn noise(dims: [usize; 3], spacing: DVec3, direction: DMat3, seed: u64) -> Arc<Data> {
    let mut random = Random(seed);
    let samples: Vec<f32> = (0..dims.iter().product()).map(|_| random.unit() as f32).collect();
    let samples = Samples::F32(samples.into());
    let grid = Grid::new(dims, spacing, DVec3::new(0.5, -3.0, 11.0), direction, samples);
    Arc::new(Data::Grid(grid.unwrap()))
}

/// Sizes, spacings and axes of grids: the smallest, uneven ones, turned and mirrored axes.
#[must_use]
pub fn lattices() -> [([usize; 3], DVec3, DMat3); 4] {
    let turned = DMat3::from_rotation_z(0.3) * DMat3::from_rotation_x(-1.1);
    let mirrored = DMat3::from_diagonal(DVec3::new(-1.0, 1.0, -1.0));
    [
        ([2, 2, 2], DVec3::ONE, DMat3::IDENTITY),
        ([7, 18, 5], DVec3::new(1.0, 0.25, 3.0), DMat3::IDENTITY),
        ([9, 6, 17], DVec3::new(1.0, 2.0, 0.5), turned),
        ([6, 9, 6], DVec3::ONE, mirrored),
    ]
}

/// A grid of seeded random samples: of 8 bits (0), 16 bits with (1) and without sign (2), f32 in [-1, 1) (3 and above).
///
/// # Panics
/// When there is no such grid.
#[must_use]
pub fn random_grid(dims: [usize; 3], which: usize) -> Grid {
    let mut random = Random(which as u64 + 7);
    let n = dims.iter().product();
    let mut draw = |scale: f64, offset: f64| (0..n).map(|_| random.single() * scale + offset).collect::<Vec<f64>>();
    let samples = match which {
        0 => Samples::U8(draw(256.0, 0.0).into_iter().map(|v| v as u8).collect()),
        1 => Samples::I16(draw(60000.0, -30000.0).into_iter().map(|v| v as i16).collect()),
        2 => Samples::U16(draw(65536.0, 0.0).into_iter().map(|v| v as u16).collect()),
        _ => Samples::F32(draw(2.0, -1.0).into_iter().map(|v| v as f32).collect()),
    };
    Grid::unit(dims, samples).unwrap()
}

/// Samples of `f` at the indices.
///
/// # Panics
/// When there is no such grid.
#[must_use]
pub fn sampled(dims: [usize; 3], f: impl Fn(f64, f64, f64) -> f64) -> Grid {
    let n = dims.iter().product::<usize>();
    let samples = (0..n)
        .map(|i| (i % dims[0], i / dims[0] % dims[1], i / dims[0] / dims[1]))
        .map(|(x, y, z)| f(x as f64, y as f64, z as f64) as f32);
    Grid::unit(dims, Samples::F32(samples.collect())).unwrap()
}

/// `n`^3 samples, given by their indices, at the origin.
///
/// # Panics
/// When there is no such grid.
#[must_use]
pub fn cube(n: usize, spacing: DVec3, axes: DMat3, sample: impl Fn([usize; 3]) -> f32) -> Arc<Data> {
    let samples: Arc<[f32]> = (0..n * n * n).map(|i| sample([i % n, i / n % n, i / n / n])).collect();
    let grid = Grid::new([n; 3], spacing, DVec3::ZERO, axes, Samples::F32(samples));
    Arc::new(Data::Grid(grid.unwrap()))
}

/// The grid with skew, left-handed, anisotropic axes.
///
/// # Panics
/// Never for a grid that exists.
#[must_use]
pub fn oblique(grid: Grid) -> Grid {
    let direction = DMat3::from_cols(
        DVec3::new(0.0, 0.8, 0.6),
        DVec3::new(1.0, 0.0, 0.0),
        DVec3::new(0.0, 0.28, 0.96),
    );
    let (spacing, origin) = (DVec3::new(1.0, 0.5, 2.0), DVec3::new(5.0, -2.0, 1.0));
    Grid::new(grid.dims, spacing, origin, direction, grid.samples).unwrap()
}

/// A ray.
#[must_use]
pub fn ray(origin: [f64; 3], direction: [f64; 3]) -> Ray {
    Ray {
        origin: origin.into(),
        direction: direction.into(),
    }
}

/// Every channel.
#[must_use]
pub fn request(layers: usize, knobs: Knobs) -> Request {
    Request {
        channels: Channels::all(),
        layers,
        knobs,
        ..Request::default()
    }
}

/// Opens a method.
///
/// # Panics
/// When it refuses.
#[must_use]
pub fn open(method: &dyn Method, request: &Request) -> Box<dyn Renderer> {
    method.open(request).unwrap()
}

/// Draws one frame.
///
/// # Panics
/// When something is refused.
pub fn draw(renderer: &mut dyn Renderer, data: &Arc<Data>, surfaces: &[Surface], view: &View) -> Frame {
    renderer.set_view(view).unwrap();
    renderer.set_surfaces(surfaces).unwrap();
    renderer.set_data(data).unwrap();
    redraw(renderer)
}

/// Draws what is set.
///
/// # Panics
/// When something is missing.
pub fn redraw(renderer: &mut dyn Renderer) -> Frame {
    let mut frame = Frame::default();
    renderer.render(&Stop::default()).unwrap();
    renderer.read(&mut frame).unwrap();
    frame
}

/// The truth about the function that a renderer draws.
///
/// # Panics
/// When there is none.
#[must_use]
pub fn truth(renderer: &dyn Renderer, surfaces: &[Surface], view: &View) -> Truth {
    let f = renderer.reconstruction(Stage::Stored).unwrap();
    Truth::compute(&f, surfaces, view, &Stop::default()).unwrap()
}

/// A frame against the truth about the function that its renderer draws.
///
/// # Panics
/// When there is no truth, or the frame has another size.
#[must_use]
pub fn against(frame: &Frame, renderer: &dyn Renderer, surfaces: &[Surface], view: &View) -> Check {
    let f = renderer.reconstruction(Stage::Stored).unwrap();
    check(frame, &truth(renderer, surfaces, view), &f, surfaces, view).unwrap()
}

/// Pixels of two frames of `layers` layers that are not alike: another number of hits or other surfaces, t more than 1e-3, a normal more than 0.02 or a colour
/// more than 1e-3 apart.
///
/// # Panics
/// When the layers of a pixel of `a` are out of order.
#[must_use]
pub fn unlike_layers(a: &Frame, b: &Frame, layers: usize) -> usize {
    let n = a.hits.len();
    let unlike = |i: &usize| {
        let i = *i;
        assert!(
            (1..layers).all(|l| a.t[l * n + i] >= a.t[(l - 1) * n + i]),
            "pixel {i} is out of order"
        );
        let alike = (0..layers).map(|l| l * n + i).all(|at| {
            let mut normals = a.normal[at].iter().zip(b.normal[at]);
            a.surface[at] == b.surface[at]
                && (a.t[at] == b.t[at] || (a.t[at] - b.t[at]).abs() < 1e-3)
                && normals.all(|(x, y)| (x - y).abs() < 0.02)
        });
        let mut colours = a.rgba[i].iter().zip(b.rgba[i]);
        a.hits[i] != b.hits[i] || !alike || !colours.all(|(x, y)| (x - y).abs() < 1e-3)
    };
    (0..n).filter(unlike).count()
}

/// Pixels missed, false, on the wrong root, on the wrong surface, and claims refuted.
#[must_use]
pub fn wrong(c: &Check) -> [usize; 5] {
    [c.missed, c.false_hits, c.wrong_root, c.wrong_surface, c.refuted]
}
