//! `tetspline/gpu`: the renderer of Kalbe, Koch and Goesele 2009 on wgpu.
//!
//! On a change of the isovalue compute kernels classify the cubes, scan and compact them, and do the same for 24 kinds of tetrahedra (`lists.rs`, section 4.1 of the paper).
//! A frame is 24 indirect, instanced draws of generic tetrahedra (sections 4.2 to 4.4): coefficients in the vertex stage, blossoming, the root, the normal and the
//! depth in the fragment stage; the depth test finds the first hit. Further layers are peeled off one draw after the other.
//!
//! **Rays.** As printed (`rays=interpolated`) a fragment's ray is interpolated from the vertices of a front face: off by where the rasteriser rounds vertices to sub-pixels, lost
//! about an eye inside the volume, and not quite a ray, because unit vectors are interpolated. By default (`rays=exact`) each pixel has its own ray,
//! made in f64, cut by the domain and the clipping planes, and handed over in fixed point (`isobar_gpu::rays`); back faces are drawn, slightly grown, and say only which tetrahedra a ray may
//! meet. What is behind a tetrahedron's ends is cut off exactly, so an eye inside the volume sees what is before it.
//!
//! **Precision** of `rays=exact`: a position is off by some 2^-22 of a voxel at any distance; a hit is a whole number of half voxels and an f32 rest, added up in f64. The depth has
//! 2^-29 of a ray's length.
//!
//! **No guarantee** with `claims=off` (the default). With `claims=cpu` each pixel is proved again by `tetspline/cpu` at that method's cost.

mod bands;
mod camera;
mod cull;
mod data;
mod generate;
mod layout;
mod lists;
mod pixels;
mod programs;
mod renderer;
mod settings;
mod smooth;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod twin;

use isobar_core::{
    Camera, DataKind, KnobKind, KnobSpec, Method, MethodInfo, RenderError, Renderer, Request, Scene, Unsupported, View,
};
use isobar_cpu::scene::{check_clipped_scene, check_request};
use isobar_gpu::Gpu;

/// The paper's renderer on the GPU.
#[derive(Debug)]
pub struct TetsplineGpu;

/// The method `tetspline/gpu`.
pub static TETSPLINE_GPU: TetsplineGpu = TetsplineGpu;

pub(crate) static INFO: MethodInfo = MethodInfo {
    id: "tetspline/gpu",
    summary: "active tetrahedra of the cubic C1 spline, instanced and ray cast in the fragment stage",
    paper: "Kalbe, Koch and Goesele, High-quality rendering of varying isosurfaces with cubic trivariate C1-continuous splines, ISVC 2009",
    data: DataKind::GRID,
    hits: true,
    gpu: true,
    work_unit: "fragments",
    knobs: &[
        KnobSpec {
            name: "reconstruction",
            doc: "the function drawn",
            kind: KnobKind::Choice(&["type6", "type6-prefiltered"]),
        },
        KnobSpec {
            name: "rays",
            doc: "exact: each pixel's own ray; interpolated: as printed, from the vertices of front faces, which loses what is next to the eye",
            kind: KnobKind::Choice(&["exact", "interpolated"]),
        },
        KnobSpec {
            name: "roots",
            doc: "bracketed: the first sign change between extrema; newton3: the paper's three sequences; analytic: Cardano; hull: subdivision",
            kind: KnobKind::Choice(&["bracketed", "newton3", "analytic", "hull"]),
        },
        KnobSpec {
            name: "coefficients",
            doc: "on-the-fly: from 23 texels in the vertex stage; determining-set: stored for every active cube, 224 bytes",
            kind: KnobKind::Choice(&["on-the-fly", "determining-set"]),
        },
        KnobSpec {
            name: "classify",
            doc: "cubes by all coefficients, by their 27 data, or paper: by the determining set as printed, which loses surface",
            kind: KnobKind::Choice(&["coefficients", "data", "paper"]),
        },
        KnobSpec {
            name: "smooth",
            doc: "standard deviation, in voxels, of a Gaussian that the samples are smoothed with first, on the device; 0: as they are",
            kind: KnobKind::Float {
                default: 0.0,
                min: 0.0,
                max: 16.0,
            },
        },
        KnobSpec {
            name: "texture",
            doc: "colours: plain, or marble: solid noise at the hit, by the fragment stage",
            kind: KnobKind::Choice(&["plain", "marble"]),
        },
        KnobSpec {
            name: "overlay",
            doc: "curves: the curves where the surface crosses the faces of cubes in black, by the fragment stage",
            kind: KnobKind::Choice(&["none", "curves"]),
        },
        KnobSpec {
            name: "cull",
            doc: "on: only the active tetrahedra inside the view frustum are sent, found once per view; off: all of them",
            kind: KnobKind::Choice(&["on", "off"]),
        },
        KnobSpec {
            name: "claims",
            doc: "off: nothing is claimed; cpu: every pixel is proved again by tetspline/cpu, at its cost",
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

fn feature(what: impl Into<String>) -> Unsupported {
    Unsupported::Feature {
        method: INFO.id,
        what: what.into(),
    }
}

/// Refuses lists of rays: tetrahedra are projected by a camera.
fn check_view(view: &View) -> Result<(), Unsupported> {
    if matches!(view.camera, Camera::Rays(_)) {
        return Err(feature("lists of rays, because it projects by a camera; use tetspline/cpu"));
    }
    Ok(())
}

impl Method for TetsplineGpu {
    fn info(&self) -> &'static MethodInfo {
        &INFO
    }

    /// Also opens the shared device, which later calls find open.
    fn supports(&self, scene: &Scene<'_>, request: &Request) -> Result<(), Unsupported> {
        // Cuts may be closed: they are as good as open ones here.
        let mut view = scene.view.clone();
        view.clips.iter_mut().for_each(|c| c.cap = false);
        check_clipped_scene(&INFO, &Scene { view: &view, ..*scene }, request)?;
        check_view(scene.view)?;
        Gpu::shared().map(|_| ()).map_err(|e| machine(&e))
    }

    fn open(&self, request: &Request) -> Result<Box<dyn Renderer>, RenderError> {
        check_request(&INFO, request)?;
        let gpu = Gpu::shared().map_err(|e| machine(&e))?;
        let limits = lists::Limits::new(&gpu);
        Ok(Box::new(renderer::TetsplineRenderer::new(gpu, request, limits)?))
    }
}
