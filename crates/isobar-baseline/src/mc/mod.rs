//! `mc/cpu`: marching cubes, a bounding volume hierarchy over the triangles, and ray casting.
//!
//! The mesh is made when data and surfaces are known (its time counts as theirs), on the grid's own lattice or on one
//! `subdivide` times finer, on which it lies closer to the trilinear surface: the distance falls with the square of the cell. The
//! ray-triangle test is watertight and f64.
//!
//! **No guarantee** with respect to the trilinear function: a mesh is another surface, up to a fraction of a voxel away; it misses
//! sheets that pass between lattice points, rounds off edges, and at tangent rays and silhouettes hits where the function does not and
//! the other way round. Claims are never made.

mod cast;
mod join;
mod mesh;
mod renderer;
mod table;

use crate::support;
use isobar_core::{DataKind, KnobKind, KnobSpec, Method, MethodInfo, RenderError, Renderer, Request, Scene, Unsupported};

/// Marching cubes and ray casting.
#[derive(Debug)]
pub struct McCpu;

/// The method `mc/cpu`.
pub static MC_CPU: McCpu = McCpu;

pub(crate) static INFO: MethodInfo = MethodInfo {
    id: "mc/cpu",
    summary: "marching cubes mesh, ray cast through a bounding volume hierarchy",
    paper: "",
    data: DataKind::GRID,
    hits: true,
    gpu: false,
    work_unit: "triangle tests",
    knobs: &[
        KnobSpec {
            name: "reconstruction",
            doc: "function that the mesh approximates",
            kind: KnobKind::Choice(&["trilinear"]),
        },
        KnobSpec {
            name: "subdivide",
            doc: "cells of the mesh per cell of the grid along each axis",
            kind: KnobKind::Choice(&["1", "2", "4"]),
        },
        KnobSpec {
            name: "normals",
            doc: "gradient of the trilinear function at the hit, or the triangle's own normal",
            kind: KnobKind::Choice(&["gradient", "face"]),
        },
    ],
    sweep: ("subdivide", &["1", "2", "4"]),
};

impl Method for McCpu {
    fn info(&self) -> &'static MethodInfo {
        &INFO
    }

    fn supports(&self, scene: &Scene<'_>, request: &Request) -> Result<(), Unsupported> {
        support::check_clipped_scene(&INFO, scene, request)
    }

    fn open(&self, request: &Request) -> Result<Box<dyn Renderer>, RenderError> {
        Ok(Box::new(renderer::McRenderer::new(request)?))
    }
}

#[cfg(test)]
mod tests;
