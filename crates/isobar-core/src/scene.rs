//! What is to be seen: surfaces and at most one transfer function.

use crate::{Data, View};
use std::sync::Arc;

/// A whole scene, borrowed: what a method is asked about.
#[derive(Debug, Clone, Copy)]
pub struct Scene<'a> {
    /// The data.
    pub data: &'a Arc<Data>,
    /// Surfaces in the order of the command line; `Frame::surface` indexes them.
    pub surfaces: &'a [Surface],
    /// The medium between the surfaces.
    pub medium: Option<&'a TransferFunction>,
    /// The view.
    pub view: &'a View,
}

/// One surface to draw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surface {
    /// Which points belong to it.
    pub kind: SurfaceKind,
    /// Linear RGB in [0, 1].
    pub colour: [f32; 3],
    /// 0 invisible (and then never hides what is behind), 1 opaque.
    pub opacity: f32,
}

impl Surface {
    /// The default colours of surfaces given without one, by position; linear RGB.
    pub const COLOURS: [[f32; 3]; 6] = [
        [0.68, 0.45, 0.22],
        [0.10, 0.34, 0.60],
        [0.18, 0.50, 0.20],
        [0.60, 0.14, 0.12],
        [0.42, 0.20, 0.52],
        [0.55, 0.55, 0.50],
    ];

    /// An opaque isosurface in the default colour of position `index`.
    #[must_use]
    pub fn isovalue(value: f64, index: usize) -> Self {
        Self {
            kind: SurfaceKind::Isovalue(value),
            colour: Self::COLOURS[index % Self::COLOURS.len()],
            opacity: 1.0,
        }
    }

    /// The isovalue, where the surface is one.
    #[must_use]
    pub fn value(&self) -> Option<f64> {
        match self.kind {
            SurfaceKind::Isovalue(v) => Some(v),
            _ => None,
        }
    }
}

/// What a surface is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum SurfaceKind {
    /// All x with s(x) = value, in data units.
    Isovalue(f64),
    /// All points with parameter `axis` (0, 1, 2) of their element equal to `value`.
    Parameter {
        /// Parametric axis.
        axis: u8,
        /// Its value in [0, 1].
        value: f64,
    },
    /// The boundary of the domain.
    Boundary,
}

/// Piecewise-linear colour and extinction over the data value.
#[derive(Debug, Clone, PartialEq)]
pub struct TransferFunction {
    /// `(value, [r, g, b], density)`, ascending in value (data units); linear between, constant outside. Linear RGB, not premultiplied.
    /// Density is extinction per [`Self::unit`] of world length, not negative.
    pub points: Vec<(f64, [f32; 3], f32)>,
    /// World length that density refers to, positive.
    pub unit: f64,
}
