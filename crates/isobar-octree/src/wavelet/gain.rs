//! What drawing over levels of detail gains over the volume at full resolution, and at which error.

use super::table::{CHANNELS, Difference, REPEATS, Setting};
use super::{Criteria, Multiresolution, Pyramid, Selection};
use glam::DQuat;
use isobar_core::{Camera, Frame, RenderError, Renderer, Stop, Surface, View};
use isobar_cpu::Pool;
use std::sync::Arc;
use std::time::Duration;

/// The eye goes so far round its target from one frame to the next, degrees.
pub const STEP: f64 = 1.0;

/// Frames of the walk round the target.
const WALK: usize = 4;

/// One choice of levels; times are those of the setting's clock, the least of several, frames of both kinds in turn.
#[derive(Debug, Clone)]
pub struct Gain {
    /// Pieces of coarser levels are seen at most so wide ([`Criteria::pixels`]); chunks without a surface are collapsed too.
    pub pixels: f64,
    /// By level that is drawn: the level, and its bricks of 4^3 pieces that the surface may meet.
    pub levels: Vec<(usize, usize)>,
    /// Criteria, reconstruction and lattices: from nothing but the coarsest level.
    pub anew: Duration,
    /// The same in a walk round the target, from one frame to the next one: the mean.
    pub select: Duration,
    /// The frame.
    pub render: Duration,
    /// The frame of the volume at full resolution.
    pub full: Duration,
    /// Active cells that rays looked into, over levels and at full resolution.
    pub cells: [u64; 2],
    /// Pixels hit at full resolution.
    pub hits: usize,
    /// Of the picture from that at full resolution.
    pub difference: Difference,
    /// Bytes of the reconstruction and of the lattices; the decomposition is as large as the samples in f32.
    pub bytes: usize,
}

/// Seen from further round the target by so many degrees about the vertical of the image.
fn turned(view: &View, degrees: f64) -> View {
    let mut view = view.clone();
    if let Camera::Perspective { eye, target, up, .. } = &mut view.camera {
        *eye = *target + DQuat::from_axis_angle(up.normalize(), degrees.to_radians()) * (*eye - *target);
    }
    view
}

/// Work of a renderer's last frame.
fn cells(renderer: &dyn Renderer) -> u64 {
    let counters = renderer.counters();
    counters.0.iter().find(|c| c.0 == "cells").map_or(0, |c| c.1)
}

impl Setting<'_> {
    /// A row for each width in pixels.
    ///
    /// # Errors
    /// [`RenderError::View`] for cameras without an eye; those of the method, of the threads, and of data that are not finite.
    pub fn gains(&self, pixels: &[f64]) -> Result<Vec<Gain>, RenderError> {
        let pool = Pool::new(self.threads)?;
        let pyramid = Arc::new(pool.install(|| Pyramid::new(self.grid, self.bank))?);
        let mut whole = self.renderer(self.grid)?;
        let mut full = Frame::default();
        whole.render(&Stop::default())?;
        whole.read(&mut full)?;
        pixels
            .iter()
            .map(|&p| self.gain(&pool, &pyramid, (whole.as_mut(), &full), p))
            .collect()
    }

    fn gain(
        &self,
        pool: &Pool,
        pyramid: &Arc<Pyramid>,
        (whole, picture): (&mut dyn Renderer, &Frame),
        pixels: f64,
    ) -> Result<Gain, RenderError> {
        let select = |view: &View| {
            let criteria = Criteria {
                isovalues: Some(vec![self.isovalue]),
                ..Criteria::pixels(view, pixels)
                    .ok_or_else(|| RenderError::View("levels of detail by pixels want a perspective view".into()))?
            };
            Ok::<_, RenderError>(pool.install(|| Selection::new(pyramid, &criteria)))
        };
        let mut levels = Multiresolution::new(pyramid.clone(), CHANNELS, self.threads)?;
        levels.set_surfaces(&[Surface::isovalue(self.isovalue, 0)])?;
        // Pages are first touched outside the clock.
        levels.select(&select(self.view)?)?;
        let mut anew = Duration::MAX;
        for _ in 0..2 {
            levels.forget();
            let (result, time) = self.timed(|| levels.select(&select(self.view)?));
            result?;
            anew = anew.min(time);
        }
        let mut walk = Duration::ZERO;
        for i in 1..=WALK {
            let view = turned(self.view, STEP * i as f64);
            let (result, time) = self.timed(|| levels.select(&select(&view)?));
            result?;
            walk += time;
        }
        levels.select(&select(self.view)?)?;
        let (mut render, mut full) = (Duration::MAX, Duration::MAX);
        for _ in 0..REPEATS {
            let (result, time) = self.timed(|| levels.render(self.view, &Stop::default()));
            result?;
            render = render.min(time);
            let (result, time) = self.timed(|| whole.render(&Stop::default()));
            result?;
            full = full.min(time);
        }
        Ok(Gain {
            pixels,
            levels: levels.levels().map(|l| (l.0, l.2)).collect(),
            anew,
            select: walk / WALK as u32,
            render,
            full,
            cells: [levels.cells(), cells(whole)],
            hits: picture.t.iter().filter(|t| t.is_finite()).count(),
            difference: Difference::of(picture, levels.frame(), self.view, self.grid.spacing.min_element()),
            bytes: levels.adaptive().bytes() + levels.bytes(),
        })
    }
}
