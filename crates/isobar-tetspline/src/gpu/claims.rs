//! Claims about the pixels of the GPU, proved on the CPU.
//!
//! The f32 arithmetic of the device proves nothing. With `claims=cpu` every ray is cast again by `tetspline/cpu`, whose proofs in f64 are
//! taken over where they speak of the same answer: EMPTY for a pixel without a hit, EXISTS and FIRST for a hit of the same surface nearby, with
//! the distance of the two added to the error bound. Everything else claims nothing and is counted.

use crate::TETSPLINE_CPU;
use isobar_core::{
    Channels, Claim, Data, Frame, Knobs, Memory, Method, NO_SURFACE, RenderError, Renderer, Request, Stop, Surface, View,
};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Hits of GPU and CPU at most this far apart, in voxels, are the same one.
const SAME_VOXELS: f64 = 1e-3;

/// The second caster.
pub(super) struct Prover {
    renderer: Box<dyn Renderer>,
    frame: Frame,
    /// What the last proof took, reading it back included.
    pub(super) time: Duration,
    /// Pixels of the last frame whose answer was proved to be right.
    pub(super) proved: u64,
    /// Pixels of the last frame where the CPU gives another answer.
    pub(super) unlike: u64,
}

impl std::fmt::Debug for Prover {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Prover").field("time", &self.time).finish_non_exhaustive()
    }
}

impl Prover {
    /// Opens `tetspline/cpu` for the same function.
    pub(super) fn new(request: &Request, reconstruction: &str) -> Result<Self, RenderError> {
        let mut knobs = Knobs::default();
        knobs.set("reconstruction", reconstruction);
        knobs.set("claims", "on");
        let request = Request {
            channels: Channels::T | Channels::SURFACE | Channels::T_ERROR | Channels::CLAIM,
            layers: 1,
            knobs,
            ..request.clone()
        };
        Ok(Self {
            renderer: TETSPLINE_CPU.open(&request)?,
            frame: Frame::default(),
            time: Duration::ZERO,
            proved: 0,
            unlike: 0,
        })
    }

    pub(super) fn set_data(&mut self, data: &Arc<Data>) -> Result<(), RenderError> {
        self.renderer.set_data(data)
    }

    pub(super) fn set_surfaces(&mut self, surfaces: &[Surface]) -> Result<(), RenderError> {
        self.renderer.set_surfaces(surfaces)
    }

    pub(super) fn set_view(&mut self, view: &View) -> Result<(), RenderError> {
        self.renderer.set_view(view)
    }

    /// What the second caster holds.
    pub(super) fn memory(&self) -> Memory {
        let m = self.renderer.memory();
        Memory {
            view: m.view + self.frame.bytes() as u64,
            ..m
        }
    }

    /// Casts all rays.
    pub(super) fn prove(&mut self, stop: &Stop) -> Result<(), RenderError> {
        let start = Instant::now();
        self.renderer.render(stop)?;
        self.renderer.read(&mut self.frame)?;
        self.time = start.elapsed();
        Ok(())
    }

    /// The claims about pixel `i`, whose first hit is `t` of `surface`, and the bound of EXISTS. `voxel`: its length in units of t.
    pub(super) fn claim(&mut self, i: usize, t: f64, surface: u8, voxel: f64) -> (Claim, f64) {
        let (claim, proved) = (self.frame.claim[i], self.frame.t[i]);
        let none = (Claim::empty(), f64::INFINITY);
        let same = if t.is_finite() {
            (t - proved).abs() <= SAME_VOXELS * voxel && surface == self.frame.surface[i]
        } else {
            self.frame.surface[i] == NO_SURFACE
        };
        if !same {
            self.unlike += 1;
            return none;
        }
        let out = if claim.contains(Claim::EXISTS) && t.is_finite() {
            // The sum is rounded up.
            let error = ((t - proved).abs() + self.frame.t_error[i]) * (1.0 + 4.0 * f64::EPSILON);
            (claim & (Claim::EXISTS | Claim::FIRST), error)
        } else if claim.contains(Claim::EMPTY) && t.is_infinite() {
            (Claim::EMPTY, f64::INFINITY)
        } else {
            none
        };
        self.proved += u64::from(out.0.intersects(Claim::FIRST | Claim::EMPTY));
        out
    }
}
