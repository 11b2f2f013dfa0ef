//! The exact colours of a whole view.

use super::{Colour, Integral, Model, Reference};
use crate::TruthError;
use isobar_core::{Frame, Function, Stop, Surface, TransferFunction, View};
use rayon::prelude::*;
use std::sync::Arc;

/// Colours of all pixels of a view, row by row, each with the bound of its error.
#[derive(Clone, Debug, PartialEq)]
pub struct Colours {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Linear premultiplied colour and opacity, background 0.
    pub rgba: Vec<[f64; 4]>,
    /// Proved bound of the error of every channel; see [`Integral`].
    pub error: Vec<f64>,
    /// Parts of the medium that were integrated, over all pixels.
    pub leaves: u64,
}

impl Colours {
    /// Of every pixel's centre ray. In parallel on the current rayon pool; `stop` counts rows.
    ///
    /// # Errors
    /// [`TruthError::Stopped`], [`TruthError::View`], and those of [`Integral::new`].
    pub fn compute(
        function: &Arc<dyn Function>,
        surfaces: &[Surface],
        medium: Option<&TransferFunction>,
        reference: Reference,
        view: &View,
        stop: &Stop,
    ) -> Result<Self, TruthError> {
        view.validate()?;
        let integral = Integral::new(function, surfaces, medium, reference, Model::default(), &view.clips)?;
        Self::of(&integral, view, stop)
    }

    /// The same for a scene that is already prepared; the clipping planes are those it was prepared with.
    ///
    /// # Errors
    /// [`TruthError::Stopped`], [`TruthError::View`].
    pub fn of(integral: &Integral, view: &View, stop: &Stop) -> Result<Self, TruthError> {
        view.validate()?;
        let generator = view.generator();
        let (w, h) = (view.width, view.height);
        // A list of rays is one row: cut it, so that threads share it.
        let run = w.clamp(1, 256);
        stop.begin((w * h).div_ceil(run) as u64);
        let unknown = Colour {
            rgba: [0.0; 4],
            error: f64::INFINITY,
            leaves: 0,
        };
        let mut pixels = vec![unknown; w * h];
        pixels.par_chunks_mut(run).enumerate().for_each(|(n, chunk)| {
            for (k, p) in chunk.iter_mut().enumerate() {
                if stop.is_raised() {
                    return;
                }
                let i = n * run + k;
                *p = integral.colour(&generator.ray(i % w, i / w));
            }
            stop.step();
        });
        if stop.is_raised() {
            return Err(TruthError::Stopped);
        }
        Ok(Self {
            width: w,
            height: h,
            rgba: pixels.iter().map(|p| p.rgba).collect(),
            error: pixels.iter().map(|p| p.error).collect(),
            leaves: pixels.iter().map(|p| u64::from(p.leaves)).sum(),
        })
    }

    /// The greatest error bound.
    #[must_use]
    pub fn greatest_error(&self) -> f64 {
        self.error.iter().fold(0.0, |m, &e| m.max(e))
    }

    /// The colours rounded to f32.
    #[must_use]
    pub fn rounded(&self) -> Vec<[f32; 4]> {
        self.rgba.iter().map(|c| c.map(|v| v as f32)).collect()
    }

    /// Holds a frame against these colours.
    ///
    /// # Errors
    /// [`TruthError::Size`], [`TruthError::Channel`] where it has no colour.
    pub fn difference(&self, frame: &Frame) -> Result<super::Difference, TruthError> {
        if (frame.width, frame.height) != (self.width, self.height) {
            return Err(TruthError::Size {
                frame: (frame.width, frame.height),
                truth: (self.width, self.height),
            });
        }
        if frame.rgba.len() != self.rgba.len() {
            return Err(TruthError::Channel("rgba"));
        }
        Ok(super::Difference::between(self.width, &frame.rgba, &self.rounded()))
    }

    /// The difference to other colours of the same view: the bias |P - I|.
    ///
    /// # Errors
    /// [`TruthError::Size`].
    pub fn bias(&self, other: &Self) -> Result<super::Difference, TruthError> {
        if (other.width, other.height) != (self.width, self.height) {
            return Err(TruthError::Size {
                frame: (other.width, other.height),
                truth: (self.width, self.height),
            });
        }
        Ok(super::Difference::between(self.width, &other.rounded(), &self.rounded()))
    }
}
