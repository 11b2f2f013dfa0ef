//! Figure 6.6: a close-up by fast tri-cubic texture sampling with the weights of a texture unit, beside `octree/cpu`.

use super::{Image, Scene, nearest_to_middle};
use crate::comparators::texture::{Angles, FRACTION_BITS, Found, March, Texture};
use isobar_core::{Channels, DVec3, Data, DataError, Frame, Function, Grid, Ray, RenderError, Stage, View, shade, to_srgb8};
use isobar_fields::{GridSpline, Kind};
use rayon::prelude::*;
use std::sync::Arc;

/// Bits of a fetch's fraction that are compared: those of f32, one more than a texture unit's, and a texture unit's.
pub const BITS: [Option<u32>; 3] = [None, Some(FRACTION_BITS + 1), Some(FRACTION_BITS)];

/// Angle between normals that the picture shows white, degrees.
pub const WHITE: f64 = 0.25;

/// Exponent of the highlight: narrow, since it is there to show what happens to normals.
const SHININESS: i32 = 200;

/// Colour of the surface.
const COLOUR: [f32; 3] = [0.85, 0.75, 0.6];

/// The scene, seen from near, as `octree/cpu` draws it.
#[derive(Debug)]
pub struct Closeup {
    grid: Grid,
    isovalue: f64,
    spline: GridSpline,
    /// The camera.
    pub view: View,
    /// T, POINT, NORMAL, SURFACE.
    pub frame: Frame,
    /// Angle of its normals to the exact gradients at its hits.
    pub angles: Angles,
}

/// The same by texture sampling.
#[derive(Debug)]
pub struct Sampled {
    /// Bits of a fetch's fraction; `None`: those of f32.
    pub bits: Option<u32>,
    /// Pixel by pixel.
    pub found: Vec<Option<Found>>,
    /// Angle of its gradients to the exact ones, at the hits of `octree/cpu`.
    pub at_exact_hits: Angles,
    /// The same at its own hits.
    pub at_own_hits: Angles,
    /// Pixels hit by one of the two only.
    pub one_sided: usize,
    /// Distance between the two hits along the ray, voxels: median, 99 %, greatest.
    pub off: [f64; 3],
    /// Values sampled for a hit, eight fetches each.
    pub samples: f64,
}

/// A view of what the middle of `overview` hits, from so many voxels before it.
///
/// # Errors
/// [`RenderError::View`] where nothing is hit; those of `octree/cpu`.
pub fn near(data: &Arc<Data>, isovalue: f64, overview: &View, voxels: f64, size: [usize; 2]) -> Result<View, RenderError> {
    let scene = Scene {
        data,
        isovalue,
        kind: Kind::Cubic,
        view: overview,
    };
    let (frame, _) = scene.draw(Channels::T | Channels::POINT, 0, 0)?;
    let at = nearest_to_middle(overview, |i| frame.t[i].is_finite()).ok_or_else(|| {
        RenderError::View("the surface is not in view; give an isovalue inside the range of the data".to_owned())
    })?;
    let d = overview.ray(at % overview.width, at / overview.width).direction.normalize();
    let Data::Grid(grid) = &**data else {
        return Err(no_grid());
    };
    let eye = frame.point[at] - d * (voxels * grid.spacing.min_element());
    Ok(View::perspective(eye, frame.point[at], DVec3::Z, 60.0, size[0], size[1]))
}

fn no_grid() -> RenderError {
    DataError::Unknown("textures are sampled of grids; give one".to_owned()).into()
}

impl Closeup {
    /// Draws the cubic spline with the samples as coefficients.
    ///
    /// # Errors
    /// Those of `octree/cpu`; data that are no grid.
    pub fn draw(data: &Arc<Data>, isovalue: f64, view: View) -> Result<Self, RenderError> {
        let Data::Grid(grid) = &**data else {
            return Err(no_grid());
        };
        let scene = Scene {
            data,
            isovalue,
            kind: Kind::Cubic,
            view: &view,
        };
        let channels = Channels::T | Channels::POINT | Channels::NORMAL | Channels::SURFACE;
        let (frame, _) = scene.draw(channels, 0, 0)?;
        let spline = GridSpline::new(grid, Kind::Cubic, Stage::Stored)?;
        let hits = (0..view.pixels()).filter(|&i| frame.t[i].is_finite());
        let angles = Angles::between(hits.map(|i| {
            let exact = spline.gradient(frame.point[i]).normalize_or_zero();
            (DVec3::from_array(frame.normal[i].map(f64::from)), exact)
        }));
        Ok(Self {
            grid: grid.clone(),
            isovalue,
            spline,
            view,
            frame,
            angles,
        })
    }

    fn ray(&self, i: usize) -> Ray {
        self.view.ray(i % self.view.width, i / self.view.width)
    }

    /// Pixels hit.
    #[must_use]
    pub fn hits(&self) -> usize {
        self.frame.t.iter().filter(|t| t.is_finite()).count()
    }

    /// By sampling: half a voxel a step, an eighth near the surface, then twelve halvings.
    ///
    /// # Errors
    /// [`DataError`] as [`Texture::new`].
    pub fn sample(&self, bits: Option<u32>) -> Result<Sampled, DataError> {
        let texture = Texture::new(&self.grid, bits)?;
        let range = self.grid.samples.range().0.map_or(1.0, |(lo, hi)| hi - lo);
        let march = March {
            step: 0.5,
            fine: 0.125,
            near: 0.1 * range,
            halvings: 12,
        };
        let found: Vec<Option<Found>> = (0..self.view.pixels())
            .into_par_iter()
            .map(|i| texture.first(&self.ray(i), self.isovalue, &march))
            .collect();
        let exact = |p: DVec3| self.spline.gradient(p).normalize_or_zero();
        let at = (self.frame.point.iter()).filter(|p| p.is_finite());
        let at_exact_hits = Angles::between(at.map(|&p| (texture.normal(p), exact(p))));
        let own = (found.iter().enumerate()).filter_map(|(i, f)| f.map(|f| (f.normal, exact(self.ray(i).at(f.t)))));
        let voxel = self.grid.spacing.min_element();
        let pairs = || found.iter().zip(&self.frame.t);
        let mut off: Vec<f64> = pairs()
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
        Ok(Sampled {
            bits,
            at_exact_hits,
            at_own_hits: Angles::between(own),
            one_sided: pairs().filter(|(f, t)| f.is_some() != t.is_finite()).count(),
            off: [0.5, 0.99, 1.0].map(at),
            samples: samples as f64 / found.iter().flatten().count().max(1) as f64,
            found,
        })
    }

    /// The project's shading, and a highlight.
    fn lit(&self, normal: [f32; 3], i: usize) -> [u8; 3] {
        let d = self.ray(i).direction;
        let facing = DVec3::from_array(normal.map(f64::from)).dot(d.normalize()).abs().min(1.0);
        let highlight = 0.5 * facing.powi(SHININESS) as f32;
        let [r, g, b] = shade(COLOUR, normal, d).map(|c| 0.7 * c + highlight);
        to_srgb8([r, g, b, 1.0])
    }

    /// The exact close-up.
    #[must_use]
    pub fn image(&self) -> Image {
        Image::new(&self.view, |i| {
            if self.frame.t[i].is_finite() {
                self.lit(self.frame.normal[i], i)
            } else {
                [255; 3]
            }
        })
    }

    /// The sampled one.
    #[must_use]
    pub fn sampled_image(&self, s: &Sampled) -> Image {
        Image::new(&self.view, |i| {
            s.found[i].map_or([255; 3], |f| self.lit(f.normal.as_vec3().to_array(), i))
        })
    }

    /// The angle between the normals of the two: black 0, white [`WHITE`] degrees and more, blue where one of them has no hit.
    #[must_use]
    pub fn angle_image(&self, s: &Sampled) -> Image {
        Image::new(&self.view, |i| {
            let Some(f) = s.found[i].filter(|_| self.frame.t[i].is_finite()) else {
                return [0, 0, 64];
            };
            let a = Angles::between([(f.normal, DVec3::from_array(self.frame.normal[i].map(f64::from)))]).max;
            [(a / WHITE * 255.0).min(255.0) as u8; 3]
        })
    }
}
