//! `octree/gpu`: exact cell-by-cell ray casting of splines on grids, as a wgpu compute kernel.
//!
//! What `octree/cpu` does, in f32: min/max bricks of 4^3 cells under nodes of 16^3, a digital differential analyser on all three sizes, and in every
//! active cell the composition of the spline with the ray to a polynomial in Bernstein form (degree 3, 6 or 9), whose roots are isolated and
//! found left to right. All hits, in order, of several isovalues; analytic normals.
//!
//! **Precision.** Rays are made and cut by the domain in f64 and handed over in fixed point (32 bits of a cell at the entry, 42 bits
//! of the direction). In each active brick the ray is counted from the half voxel nearest to its middle, so that a position is off by at most
//! some 2^-22 of a cell at any distance, and `t = entry + (whole + u) / speed` is added up in f64: t is that of an f32 root, refined by
//! nothing. Only the walk over bricks works in the volume's f32 coordinates: within 2^-23 n cells of a brick's face, n the cells along an axis, the
//! polynomial of the cell before may be used beyond it.
//!
//! **No guarantee** with `claims=off` (the default): nothing is claimed. With `claims=cpu` each pixel is proved again by `octree/cpu` at that
//! method's cost.
//!
//! Sources: M. Steinberger, *Isosurface rendering with spline wavelets and octrees* (Graz 2010), sections 3.2 to 3.5. Different here: the digital
//! differential analyser instead of the parametric octree walk, fixed-point rays, the solver (`shaders/octree_solve.wgsl`).

pub mod agreement;
mod bricks;
mod data;
mod generate;
mod layout;
mod programs;
mod renderer;
#[cfg(test)]
mod tests;

use isobar_core::{DataKind, KnobKind, KnobSpec, Method, MethodInfo, RenderError, Renderer, Request, Scene, Unsupported};
use isobar_cpu::scene::{check_clipped_scene, check_request};
use isobar_fields::Kind;
use isobar_gpu::Gpu;

/// Exact ray casting of splines on the GPU.
#[derive(Debug)]
pub struct OctreeGpu;

/// The method `octree/gpu`.
pub static OCTREE_GPU: OctreeGpu = OctreeGpu;

pub(crate) static INFO: MethodInfo = MethodInfo {
    id: "octree/gpu",
    summary: "every root of the spline, cell by cell, in f32 on the GPU",
    paper: "Steinberger, Isosurface rendering with spline wavelets and octrees, Graz 2010",
    data: DataKind::GRID,
    hits: true,
    gpu: true,
    work_unit: "cells visited",
    knobs: &[
        KnobSpec {
            name: "reconstruction",
            doc: "function drawn from the samples",
            kind: KnobKind::Choice(Kind::NAMES),
        },
        KnobSpec {
            name: "loops",
            doc: "unrolled: loops over coefficients are written out; looped: they index private arrays; same operations",
            kind: KnobKind::Choice(&["unrolled", "looped"]),
        },
        KnobSpec {
            name: "claims",
            doc: "off: nothing is claimed; cpu: every pixel is proved again by octree/cpu, at its cost",
            kind: KnobKind::Choice(&["off", "cpu"]),
        },
    ],
    sweep: ("", &[]),
};

fn machine(e: &isobar_gpu::GpuError) -> Unsupported {
    Unsupported::Machine {
        method: INFO.id,
        reason: e.to_string(),
    }
}

impl Method for OctreeGpu {
    fn info(&self) -> &'static MethodInfo {
        &INFO
    }

    /// Also opens the shared device, which later calls find open.
    fn supports(&self, scene: &Scene<'_>, request: &Request) -> Result<(), Unsupported> {
        check_clipped_scene(&INFO, scene, request)?;
        Gpu::shared().map(|_| ()).map_err(|e| machine(&e))
    }

    fn open(&self, request: &Request) -> Result<Box<dyn Renderer>, RenderError> {
        check_request(&INFO, request)?;
        let gpu = Gpu::shared().map_err(|e| machine(&e))?;
        Ok(Box::new(renderer::OctreeRenderer::new(gpu, request)?))
    }
}
