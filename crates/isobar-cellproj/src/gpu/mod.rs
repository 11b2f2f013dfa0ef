//! `cellproj/gpu`: projected cells on wgpu.
//!
//! **Isosurfaces** (`surfaces.rs`, `patch.wgsl`): each isovalue of each cell that meets it is drawn as the rectangle of its pixels. The vertex stage makes the patch's edge lines and the plane s = c of
//! the cell, the fragment stage keeps the pixels inside and writes the depth at which the pixel's own ray meets the plane, exact but for f32. Neighbours have a common line to the bit, so no
//! pixel between them is lost or drawn twice, whatever the rasteriser rounds. The depth test finds the first hit; further layers are peeled off one draw after the other.
//!
//! **Medium** (`medium.rs`, `medium.wgsl`): the CPU sorts the cells into visibility order and into squares of 8 x 8 pixels; a compute kernel goes through the cells of its square front to
//! back, each ray with its own entry and exit, looks stretches up in the tables of `cellproj/cpu`, and cuts them at the hits of the pixel. Colours are sums in f32; nothing is blended by the
//! fixed-function hardware, which has no f32 blending everywhere and cannot stop at a surface.
//!
//! **Precision.** Points come in two f32 about the middle of the mesh, so a mesh far from the origin loses nothing; from there all is f32. A hit's t has an error of some 2^-22 of the distance over the cosine between ray and
//! normal. Edges of patches lie some 1e-3 of a pixel from where they should.
//!
//! **No guarantee** with `claims=off` (the default). With `claims=cpu` each pixel is proved again by `cellproj/cpu`, at that method's cost.

mod device;
mod medium;
mod renderer;
mod surfaces;
#[cfg(test)]
mod tests;

use crate::cpu::{MODEL, SHADING, SORT, TABLE};
use crate::faces::INSIDE;
use isobar_core::{
    Camera, DataKind, KnobKind, KnobSpec, Method, MethodInfo, RenderError, Renderer, Request, Scene, Unsupported, View,
};
use isobar_cpu::scene::{check_clipped_scene, check_open_cuts, check_request};
use isobar_gpu::{Gpu, GpuError, shader};

/// Projected cells on the GPU.
#[derive(Debug)]
pub struct CellprojGpu;

/// The method `cellproj/gpu`: isosurfaces of a tetrahedral mesh, a pre-integrated medium in it, or both, on wgpu.
///
/// No guarantee with `claims=off`: depths are f32. With `claims=cpu` each pixel carries what `cellproj/cpu` proves of the same hit. Refused: lists of rays, closed cuts, more than eight
/// clipping planes, values that span more than 1e37. Rays that start inside a cell on which s is the isovalue everywhere miss it. Source: sections 2 to 7 and 10.
pub static CELLPROJ_GPU: CellprojGpu = CellprojGpu;

pub(crate) static INFO: MethodInfo = MethodInfo {
    id: "cellproj/gpu",
    summary: "projected tetrahedra: patches with analytic depth per fragment, and a pre-integrated medium in visibility order",
    paper: "Roettger, Kraus, Ertl, Hardware-accelerated volume and isosurface rendering based on cell-projection, IEEE Visualization 2000",
    data: DataKind::TETS,
    hits: true,
    gpu: true,
    work_unit: "layers peeled that hit the pixel",
    knobs: &[
        KnobSpec {
            name: "claims",
            doc: "off: nothing is claimed; cpu: every pixel is proved again by cellproj/cpu, at its cost",
            kind: KnobKind::Choice(&["off", "cpu"]),
        },
        SHADING,
        INSIDE,
        KnobSpec {
            name: "integration",
            doc: "how a ray's stay in a cell is integrated: 3D table, or 2D table at the average thickness",
            kind: KnobKind::Choice(&["table3d", "table2d"]),
        },
        TABLE,
        MODEL,
        SORT,
    ],
    sweep: ("table", &["8", "16", "32", "64", "128"]),
};

/// This crate's snippets.
const SNIPPETS: shader::Snippets = &[
    ("view", include_str!("../../shaders/view.wgsl")),
    ("patch", include_str!("../../shaders/patch.wgsl")),
    ("medium", include_str!("../../shaders/medium.wgsl")),
];

fn source(name: &str) -> Result<String, GpuError> {
    shader::compose(&[SNIPPETS], &["view", name])
}

fn machine(e: &GpuError) -> Unsupported {
    Unsupported::Machine {
        method: INFO.id,
        reason: e.to_string(),
    }
}

fn feature(what: impl Into<String>) -> Unsupported {
    Unsupported::Feature {
        method: INFO.id,
        what: what.into(),
    }
}

/// Refuses what is not drawn.
fn check_view(view: &View) -> Result<(), Unsupported> {
    check_open_cuts(&INFO, view)?;
    if matches!(view.camera, Camera::Rays(_)) {
        return Err(feature("lists of rays, because it projects by a camera; use cellproj/cpu"));
    }
    if view.clips.len() > device::PLANES {
        return Err(feature(format!(
            "more than {} clipping planes; use cellproj/cpu",
            device::PLANES
        )));
    }
    Ok(())
}

impl Method for CellprojGpu {
    fn info(&self) -> &'static MethodInfo {
        &INFO
    }

    /// Also opens the shared device, which later calls find open.
    fn supports(&self, scene: &Scene<'_>, request: &Request) -> Result<(), Unsupported> {
        check_clipped_scene(&INFO, &Scene { medium: None, ..*scene }, request)?;
        check_view(scene.view)?;
        Gpu::shared().map(|_| ()).map_err(|e| machine(&e))
    }

    fn open(&self, request: &Request) -> Result<Box<dyn Renderer>, RenderError> {
        check_request(&INFO, request)?;
        let gpu = Gpu::shared().map_err(|e| machine(&e))?;
        Ok(Box::new(renderer::CellprojRenderer::new(gpu, request)?))
    }
}
