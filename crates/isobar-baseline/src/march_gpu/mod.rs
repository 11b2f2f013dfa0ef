//! `march/gpu`: the twin of `march/cpu` as one WGSL compute kernel over a 3D texture.
//!
//! Sample k of a ray lies `k * step` voxels behind its entry into the domain, the last at the exit; where the class of s (how many
//! isovalues are not above it) changes between two samples, the bracket is halved `bisections` times and its middle is the
//! hit. Everything on the device is f32; rays come from core's generator in f64, cut by the domain in f64, and start at their entry,
//! and `t = t_entry + u / speed` is added up in f64 again. A position is off by at most about
//! `2^-23 * (length of the ray + longest axis)` voxels, so that more than some 14 bisections of a half-voxel step no longer help on 256^3.
//!
//! Coefficients stay in their own type (8-bit and 16-bit integers take 1 and 2 bytes of device memory) and are read by explicit loads;
//! `filter=bits8|bits9` instead rounds the fractions of every trilinear fetch as texture hardware does, with the quadratic and
//! cubic splines made of eight such fetches (M. Steinberger, 2010, section 6.2: the fast tri-cubic comparator; C. Sigg and M.
//! Hadwiger, GPU Gems 2, chapter 20, 2005).
//!
//! **No guarantee**, as for `march/cpu`: an even number of roots between two samples is missed, tangential hits always. Claims are never
//! made. Samples below 1.2e-38 may count as 0 on the device.

mod blocks;
mod data;
mod layout;
mod programs;
mod renderer;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod twin;

use crate::support;
use isobar_core::{DataKind, KnobKind, KnobSpec, Method, MethodInfo, RenderError, Renderer, Request, Scene, Unsupported};
use isobar_fields::Kind;
use isobar_gpu::Gpu;

/// Fixed step and bisection on the GPU.
#[derive(Debug)]
pub struct MarchGpu;

/// The method `march/gpu`.
pub static MARCH_GPU: MarchGpu = MarchGpu;

pub(crate) static INFO: MethodInfo = MethodInfo {
    id: "march/gpu",
    summary: "fixed steps and bisection over a 3D texture, min/max blocks skipped: the way most systems draw isosurfaces",
    paper: "",
    data: DataKind::GRID,
    hits: true,
    gpu: true,
    work_unit: "samples",
    knobs: &[
        KnobSpec {
            name: "reconstruction",
            doc: "function drawn from the samples",
            kind: KnobKind::Choice(Kind::NAMES),
        },
        KnobSpec {
            name: "step",
            doc: "distance of samples along the ray, voxels",
            kind: KnobKind::Float {
                default: 0.5,
                min: 0.05,
                max: 8.0,
            },
        },
        KnobSpec {
            name: "bisections",
            doc: "halvings of a step in which the sign changes; f32 resolves about 14",
            kind: KnobKind::Int {
                default: 8,
                min: 0,
                max: 60,
            },
        },
        KnobSpec {
            name: "filter",
            doc: "exact: f32 weights; bits8, bits9: the fixed-point weights of texture hardware, emulated",
            kind: KnobKind::Choice(&["exact", "bits8", "bits9"]),
        },
        KnobSpec {
            name: "skip",
            doc: "whether blocks without the isovalue are stepped over; the image is the same",
            kind: KnobKind::Choice(&["on", "off"]),
        },
    ],
    sweep: ("step", &["4", "2", "1", "0.5", "0.25", "0.125"]),
};

impl Method for MarchGpu {
    fn info(&self) -> &'static MethodInfo {
        &INFO
    }

    /// Also opens the shared device, which later calls find open.
    fn supports(&self, scene: &Scene<'_>, request: &Request) -> Result<(), Unsupported> {
        support::check_clipped_scene(&INFO, scene, request)?;
        Gpu::shared().map(|_| ()).map_err(|e| Unsupported::Machine {
            method: INFO.id,
            reason: e.to_string(),
        })
    }

    fn open(&self, request: &Request) -> Result<Box<dyn Renderer>, RenderError> {
        support::check_request(&INFO, request)?;
        let gpu = Gpu::shared().map_err(|e| Unsupported::Machine {
            method: INFO.id,
            reason: e.to_string(),
        })?;
        Ok(Box::new(renderer::MarchRenderer::new(gpu, request)?))
    }
}
