//! Colours of a medium against the exact ones.

use super::{Difference, Job};
use crate::results::{Apart, Colour};
use anyhow::{Context, Result};
use isobar::checking::{self, ColourCheck};
use isobar_core::{Frame, Function, Knobs, Method, Stop};
use isobar_oracle::{Colours, Reference};
use std::sync::{Arc, Mutex, PoisonError};

/// Exact colours of the scene, with the name of what they are of: settings ask for the same.
#[derive(Debug, Default)]
pub(super) struct Exact(Mutex<Vec<(String, Arc<Colours>)>>);

impl Job<'_> {
    /// The exact colours of the scene for a function.
    fn exact(&self, function: &Arc<dyn Function>, reference: Reference, stop: &Stop) -> Result<Arc<Colours>> {
        let key = isobar::truth::key(function.as_ref(), self.surfaces, self.view, &format!("{reference:?}"));
        let mut kept = self.exact.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((_, c)) = kept.iter().find(|(k, _)| *k == key) {
            return Ok(c.clone());
        }
        let computed = Colours::compute(function, self.surfaces, self.medium, reference, self.view, stop);
        let colours = Arc::new(computed.context("the exact colours")?);
        kept.push((key, colours.clone()));
        Ok(colours)
    }

    /// Holds a frame's colours against the exact ones; `None` without a medium.
    pub(super) fn colour(
        &self,
        frame: &Frame,
        f: &Arc<dyn Function>,
        (m, knobs): (&dyn Method, &Knobs),
        stop: &Stop,
    ) -> Result<Option<Colour>> {
        if self.medium.is_none() {
            return Ok(None);
        }
        let integral = self.exact(f, Reference::Integral, stop)?;
        let reference = checking::peaks_reference(m, knobs);
        let peaks = reference.map(|r| self.exact(f, r, stop)).transpose()?;
        let c = ColourCheck::of(frame, &integral, reference.zip(peaks.as_deref()))?;
        Ok(Some(Colour {
            integral: apart(&c.integral),
            peaks: c.peaks.as_ref().map(apart),
            bias: c.bias.as_ref().map(apart),
            bound: finite(c.bound),
            surfaces: !checking::judged(m, knobs, self.surfaces, self.medium).is_empty(),
        }))
    }
}

fn finite(x: f64) -> Option<f64> {
    x.is_finite().then_some(x)
}

fn apart(d: &Difference) -> Apart {
    Apart {
        p99: finite(d.p99),
        max: finite(d.max),
        visible: d.visible as u64,
        psnr: finite(d.psnr),
    }
}
