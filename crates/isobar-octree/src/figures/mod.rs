//! The figures of the thesis, drawn again: frames, pictures, and the numbers under them.
//!
//! [`classes`]: Figure 3.2. [`levels`]: Figures 4.5, 4.6, 6.7 and 6.8. [`surfaces`]: Figure 6.1. [`degrees`]: Figures 6.2 to 6.5. [`closeup`]: Figure 6.6.
//! [`topology`]: Figure 6.9. [`printed`] holds what the thesis prints beside them. Nothing here proves anything: who shows a number holds the frame it
//! comes from against certified roots, as the report does.

pub mod classes;
pub mod closeup;
pub mod degrees;
pub mod levels;
pub mod printed;
pub mod surfaces;
#[cfg(test)]
mod tests;
pub mod topology;

use crate::OCTREE_CPU;
use isobar_core::{Channels, Data, Frame, Knobs, Method, RenderError, Request, Stop, Surface, View, to_srgb8};
use isobar_fields::Kind;
use rayon::prelude::*;
use std::sync::Arc;
use std::time::Duration;

/// An 8-bit sRGB picture.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Image {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Red, green and blue of every pixel, row by row.
    pub rgb: Vec<u8>,
}

impl Image {
    /// The picture of a view, each pixel's colour from its place in the image, row by row.
    #[must_use]
    pub fn new(view: &View, colour: impl Fn(usize) -> [u8; 3] + Sync + Send) -> Self {
        Self {
            width: view.width,
            height: view.height,
            rgb: (0..view.pixels()).into_par_iter().flat_map_iter(colour).collect(),
        }
    }

    /// Linear premultiplied colours over white, one for each pixel of the view.
    ///
    /// # Panics
    /// When there are fewer colours than pixels.
    #[must_use]
    pub fn linear(view: &View, rgba: &[[f32; 4]]) -> Self {
        Self::new(view, |i| to_srgb8(rgba[i]))
    }
}

/// One isosurface of a grid as `octree/cpu` draws it.
#[derive(Debug, Clone, Copy)]
pub struct Scene<'a> {
    /// The grid.
    pub data: &'a Arc<Data>,
    /// Data units.
    pub isovalue: f64,
    /// Degree.
    pub kind: Kind,
    /// Camera and size.
    pub view: &'a View,
}

impl Scene<'_> {
    /// The frame with these channels, and the least wall time of `repeats` frames after a first one; 0 threads: all.
    ///
    /// # Errors
    /// Those of `octree/cpu`.
    pub fn draw(&self, channels: Channels, threads: usize, repeats: usize) -> Result<(Frame, Duration), RenderError> {
        let request = Request {
            channels,
            threads,
            knobs: Knobs::default().with("reconstruction", self.kind.name()),
            ..Request::default()
        };
        let mut r = OCTREE_CPU.open(&request)?;
        r.set_data(self.data)?;
        r.set_surfaces(&[Surface::isovalue(self.isovalue, 0)])?;
        r.set_view(self.view)?;
        let mut least = r.render(&Stop::default())?.wall;
        for n in 0..repeats {
            let wall = r.render(&Stop::default())?.wall;
            least = if n == 0 { wall } else { least.min(wall) };
        }
        let mut frame = Frame::default();
        r.read(&mut frame)?;
        Ok((frame, least))
    }
}

/// The pixel of a frame's hits that is nearest to the middle of the image; `None` where nothing is hit.
fn nearest_to_middle(view: &View, wanted: impl Fn(usize) -> bool) -> Option<usize> {
    let (cx, cy) = (view.width / 2, view.height / 2);
    let off = |i: usize| (i % view.width).abs_diff(cx).pow(2) + (i / view.width).abs_diff(cy).pow(2);
    (0..view.pixels()).filter(|&i| wanted(i)).min_by_key(|&i| off(i))
}
