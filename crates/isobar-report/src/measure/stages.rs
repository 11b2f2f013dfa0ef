//! The stages of a frame of `octree/cpu`, clocked: Table 6.3 of Steinberger's thesis on our scenes.

use super::Job;
use crate::results::Comparison;
use anyhow::{Context, Result};
use isobar::checking;
use isobar_core::{Data, Stage, Stop};
use isobar_fields::{Kind, Reconstruction};

/// The method that is clocked.
pub(crate) const METHOD: &str = "octree/cpu";

/// Frames after the first, of which the fastest counts.
const REPEATS: usize = 3;

impl Job<'_> {
    /// Seconds of each stage on one thread, of scenes of one isovalue in which the method took part. The clocked frame is held against the truth as any
    /// other; where it has a wrong pixel there is no answer.
    pub(super) fn stages(&self, c: &Comparison, stop: &Stop) -> Result<Option<[f64; 6]>> {
        let (Data::Grid(grid), [surface], None) = (&*self.source.data, self.surfaces, self.medium) else {
            return Ok(None);
        };
        let (Some(isovalue), Ok(kind)) = (surface.value(), c.reconstruction.parse::<Kind>()) else {
            return Ok(None);
        };
        let drew = c.rows.iter().any(|r| r.method == METHOD && r.default && r.reason.is_none());
        if !drew || matches!(self.definition.group.as_str(), "hard" | "sweep") {
            return Ok(None);
        }
        let staged = isobar_octree::stages::stages(grid, kind, isovalue, self.view, REPEATS).context("the clocked frame")?;
        let function = c.reconstruction.parse::<Reconstruction>()?.of(grid, Stage::Stored)?;
        let truth = self.truths.get(&function, self.surfaces, self.view, stop);
        let truth = truth.context("the certified truth")?;
        let check = isobar_oracle::check(&staged.frame, &truth, &function, self.surfaces, self.view)?;
        let right = checking::wrong(&check) == 0 && check.refuted == 0;
        Ok(right.then(|| staged.laps.all().map(|d| d.as_secs_f64())))
    }
}
