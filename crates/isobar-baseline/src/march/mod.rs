//! `march/cpu`: samples at a fixed step along each ray, bisection where the sign of s - c changes.
//!
//! What most systems do (Open VKL, OSPRay, VTK, Inviwo): the ruler the methods are held against. Sample k of a ray lies `k * step` voxels
//! (index-space distance) behind its entry into the domain, the last sample at the exit. Where s - c changes its
//! sign between two consecutive samples, the bracket is halved `bisections` times and its middle is the hit, so that |t - root| is
//! at most `step * 2^-(bisections + 1)` voxels of *some* root in that step. s and t are f64; s - c counts as positive where it is 0.
//!
//! **No guarantee.** An even number of roots between two samples is missed, tangential hits always; of three roots one is found,
//! not always the first. Claims are never made.
//!
//! Min/max blocks are stepped over without changing the answer (`skip=off` gives the same bits).

mod blocks;
pub(crate) mod pair;
mod ray;
mod renderer;
pub(crate) mod volume;

use crate::support;
use isobar_core::{DataKind, KnobKind, KnobSpec, Method, MethodInfo, RenderError, Renderer, Request, Scene, Unsupported};
use isobar_fields::Kind;

/// Fixed step and bisection on the CPU.
#[derive(Debug)]
pub struct MarchCpu;

/// The method `march/cpu`.
pub static MARCH_CPU: MarchCpu = MarchCpu;

pub(crate) static INFO: MethodInfo = MethodInfo {
    id: "march/cpu",
    summary: "fixed steps and bisection, min/max blocks skipped: the way most systems draw isosurfaces",
    paper: "",
    data: DataKind::GRID,
    hits: true,
    gpu: false,
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
            doc: "halvings of a step in which the sign changes",
            kind: KnobKind::Int {
                default: 8,
                min: 0,
                max: 60,
            },
        },
        KnobSpec {
            name: "skip",
            doc: "whether blocks without the isovalue are stepped over; the image is the same",
            kind: KnobKind::Choice(&["on", "off"]),
        },
        KnobSpec {
            name: "block",
            doc: "side of the smaller blocks, cells; the larger ones are 4 times as long",
            kind: KnobKind::Choice(&["4", "8", "16"]),
        },
        KnobSpec {
            name: "simd",
            doc: "highest instruction set used; auto: the machine's best, or that of ISOBAR_SIMD; the image is the same",
            kind: KnobKind::Choice(&["auto", "scalar", "avx2", "avx512"]),
        },
    ],
    sweep: ("step", &["4", "2", "1", "0.5", "0.25", "0.125"]),
};

impl Method for MarchCpu {
    fn info(&self) -> &'static MethodInfo {
        &INFO
    }

    fn supports(&self, scene: &Scene<'_>, request: &Request) -> Result<(), Unsupported> {
        support::check_clipped_scene(&INFO, scene, request)
    }

    fn open(&self, request: &Request) -> Result<Box<dyn Renderer>, RenderError> {
        Ok(Box::new(renderer::MarchRenderer::new(request)?))
    }
}

#[cfg(test)]
mod tests;
