//! The knobs, read.

use super::INFO;
use super::programs::{Rays, Roots};
use crate::classify::Rule;
use crate::paint::Paint;
use isobar_core::{Knobs, RenderError, ResolvedKnobs};

/// Settings, read once.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Settings {
    pub(super) prefiltered: bool,
    pub(super) rays: Rays,
    pub(super) roots: Roots,
    pub(super) stored: bool,
    pub(super) rule: Rule,
    pub(super) claims: bool,
    pub(super) cull: bool,
    /// Standard deviation in voxels; 0: not smoothed.
    pub(super) smooth: f64,
    pub(super) paint: Paint,
}

impl Settings {
    pub(super) fn new(knobs: &Knobs) -> Result<Self, RenderError> {
        let k = ResolvedKnobs::new(INFO.knobs, knobs)?;
        Ok(Self {
            prefiltered: k.word("reconstruction") == "type6-prefiltered",
            rays: if k.word("rays") == "exact" {
                Rays::Exact
            } else {
                Rays::Interpolated
            },
            roots: match k.word("roots") {
                "newton3" => Roots::Newton3,
                "analytic" => Roots::Analytic,
                "hull" => Roots::Hull,
                _ => Roots::Bracketed,
            },
            stored: k.word("coefficients") == "determining-set",
            rule: match k.word("classify") {
                "data" => Rule::Data,
                "paper" => Rule::DeterminingSet,
                _ => Rule::Coefficients,
            },
            claims: k.word("claims") == "cpu",
            cull: k.word("cull") == "on",
            smooth: k.float("smooth"),
            paint: Paint::new(&k),
        })
    }

    pub(super) const fn reconstruction(&self) -> &'static str {
        if self.prefiltered { "type6-prefiltered" } else { "type6" }
    }
}
