//! Figure 3.2: which blocks of 8 x 8 pixels end at the volume's box, meet no candidate cell, or work on polynomials.

use super::{Image, Scene};
use crate::blocks::{BlockClass, Blocks};
use isobar_core::{Channels, Data, Frame, RenderError, View, shade, to_srgb8};

/// Pixels along a block of the thesis.
pub const SIDE: usize = 8;

/// A frame and the classes of its blocks.
#[derive(Debug, Clone)]
pub struct Classes {
    /// T, WORK and NORMAL.
    pub frame: Frame,
    /// The blocks.
    pub blocks: Blocks,
}

impl Classes {
    /// Draws the scene.
    ///
    /// # Errors
    /// Those of `octree/cpu`, and [`RenderError::View`] for data that are no grid.
    pub fn draw(scene: &Scene<'_>) -> Result<Self, RenderError> {
        let Data::Grid(grid) = &**scene.data else {
            return Err(RenderError::View(
                "blocks of pixels are classed for grids; give one".to_owned(),
            ));
        };
        let (frame, _) = scene.draw(Channels::T | Channels::WORK | Channels::NORMAL, 0, 0)?;
        let blocks = Blocks::new(&frame, scene.view, &grid.domain(), SIDE)?;
        Ok(Self { frame, blocks })
    }

    /// Blocks whose rays work on polynomials, with a hit or without: the thesis's third class.
    #[must_use]
    pub fn composed(&self) -> usize {
        self.blocks.count(BlockClass::Composed) + self.blocks.count(BlockClass::Hit)
    }

    /// The frame tinted by class, in the thesis's colours, with the blocks' edges: white not launched, blue finished at the box, green no candidate, light red
    /// polynomials without a root, red with one.
    #[must_use]
    pub fn image(&self, view: &View) -> Image {
        Image::new(view, |i| {
            let (x, y) = (i % view.width, i / view.width);
            let tint = match self.blocks.at(x, y) {
                BlockClass::NotLaunched => [1.0, 1.0, 1.0],
                BlockClass::MissesBox => [0.30, 0.50, 0.95],
                BlockClass::NoCandidate => [0.35, 0.80, 0.35],
                BlockClass::Composed => [1.0, 0.62, 0.55],
                BlockClass::Hit => [0.95, 0.25, 0.18],
            };
            let colour = if self.frame.t[i].is_finite() {
                shade(tint, self.frame.normal[i], view.ray(x, y).direction)
            } else {
                tint
            };
            let edge = x.is_multiple_of(SIDE) || y.is_multiple_of(SIDE);
            let [r, g, b] = colour.map(|c| if edge { 0.7 * c } else { c });
            to_srgb8([r, g, b, 1.0])
        })
    }
}
