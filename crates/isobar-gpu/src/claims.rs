//! Claims about the pixels of the GPU, proved on the CPU.
//!
//! The f32 arithmetic of the device proves nothing. A [`Prover`] casts every ray again by a method of the CPU, whose proofs in f64 are taken over where
//! they speak of the same answer: EMPTY for a pixel without a hit, EXISTS and FIRST for a hit of the same surface nearby, with the distance of the two
//! added to the error bound. Everything else claims nothing and is counted.

use isobar_core::{
    Channels, Claim, Data, Frame, Knobs, Memory, Method, NO_SURFACE, RenderError, Renderer, Request, Stop, Surface, View,
};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Hits of GPU and CPU at most this far apart, in voxels, are the same one.
const SAME_VOXELS: f64 = 1e-3;

/// The second caster.
pub struct Prover {
    renderer: Box<dyn Renderer>,
    frame: Frame,
    time: Duration,
    proved: u64,
    unlike: u64,
}

impl std::fmt::Debug for Prover {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Prover").field("time", &self.time).finish_non_exhaustive()
    }
}

impl Prover {
    /// Opens `method`, with `knobs`, for the request of the GPU's renderer.
    ///
    /// # Errors
    /// As [`Method::open`].
    pub fn new(method: &dyn Method, request: &Request, knobs: Knobs) -> Result<Self, RenderError> {
        let request = Request {
            channels: Channels::T | Channels::SURFACE | Channels::T_ERROR | Channels::CLAIM,
            layers: 1,
            knobs,
            ..request.clone()
        };
        Ok(Self {
            renderer: method.open(&request)?,
            frame: Frame::default(),
            time: Duration::ZERO,
            proved: 0,
            unlike: 0,
        })
    }

    /// Sets what is known of the scene so far.
    ///
    /// # Errors
    /// As the renderer's setters.
    pub fn set(
        &mut self,
        data: Option<&Arc<Data>>,
        surfaces: Option<&[Surface]>,
        view: Option<&View>,
    ) -> Result<(), RenderError> {
        data.map_or(Ok(()), |d| self.renderer.set_data(d))?;
        surfaces.map_or(Ok(()), |s| self.renderer.set_surfaces(s))?;
        view.map_or(Ok(()), |v| self.renderer.set_view(v))
    }

    /// What the second caster holds.
    #[must_use]
    pub fn memory(&self) -> Memory {
        let m = self.renderer.memory();
        Memory {
            view: m.view + self.frame.bytes() as u64,
            ..m
        }
    }

    /// What the last proof took, reading it back included, and said: microseconds, pixels whose answer was proved to be right, and pixels where the CPU gives
    /// another answer.
    #[must_use]
    pub fn counters(&self) -> [(&'static str, u64); 3] {
        [
            ("proof microseconds", self.time.as_micros() as u64),
            ("pixels proved", self.proved),
            ("pixels unlike the cpu", self.unlike),
        ]
    }

    /// Casts all rays.
    ///
    /// # Errors
    /// As the renderer's.
    pub fn prove(&mut self, stop: &Stop) -> Result<(), RenderError> {
        let start = Instant::now();
        self.renderer.render(stop)?;
        self.renderer.read(&mut self.frame)?;
        self.time = start.elapsed();
        Ok(())
    }

    /// The channels a frame must hold to be compared, where `asked` are wanted.
    #[must_use]
    pub fn channels(prover: Option<&Self>, asked: Channels) -> Channels {
        match prover {
            Some(_) => asked | Channels::T | Channels::SURFACE,
            None => asked,
        }
    }

    /// Writes what was proved into a frame with [`Prover::channels`], and leaves `asked` of them. `voxel`: its length in the world.
    pub fn write(&mut self, out: &mut Frame, view: &View, voxel: f64, asked: Channels) {
        (self.proved, self.unlike) = (0, 0);
        let generator = view.generator();
        for i in 0..view.pixels() {
            let t = out.t.get(i).copied().unwrap_or(f64::INFINITY);
            let surface = out.surface.get(i).copied().unwrap_or(NO_SURFACE);
            let speed = generator.ray(i % view.width, i / view.width).direction.length();
            let (claim, error) = self.claim(i, t, surface, voxel / speed);
            if let Some(c) = out.claim.get_mut(i) {
                *c = claim;
            }
            if let Some(e) = out.t_error.get_mut(i) {
                *e = error;
            }
        }
        out.channels = asked;
        if !asked.contains(Channels::T) {
            out.t.clear();
        }
        if !asked.contains(Channels::SURFACE) {
            out.surface.clear();
        }
    }

    /// The claims about pixel `i`, whose first hit is `t` of `surface`, and the bound of EXISTS. `voxel`: its length in units of t.
    fn claim(&mut self, i: usize, t: f64, surface: u8, voxel: f64) -> (Claim, f64) {
        let none = (Claim::empty(), f64::INFINITY);
        let (Some(&claim), Some(&proved)) = (self.frame.claim.get(i), self.frame.t.get(i)) else {
            return none;
        };
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
