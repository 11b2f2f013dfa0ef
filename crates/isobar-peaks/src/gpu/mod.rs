//! `peaks/gpu`: the ray of `peaks/cpu-paper` in f32, as one WGSL compute kernel over a 3D texture.
//!
//! The paper's own algorithm is a fragment shader; this one does what it prints, ray by ray: samples at T(n), the 2D peak table, the rule of signs, secant steps inside the bracket,
//! unscaled opacity, post-classification or pre-integration through the same loop, macrocells walked by a 3DDDA, in four modes and for all reconstructions of the crate.
//! Macrocells, their bits for a transfer function, and the tables are made on the host by the code of the CPU methods, and uploaded: 8 bytes a node of 16^3 cells and the tables, per
//! transfer function.
//!
//! **Precision.** Rays, what clipping planes keep of them and the coefficients of T are worked out in f64; T is counted from the last sample at or before the entry, so that f32
//! need not hold the number of samples before it. A position in a volume of n voxels is off by some 2^-23 n voxels, and so is t. The field is read less the middle of its
//! range.
//!
//! **Passes.** Software Vulkan (Mesa) ends the loops of a shader silently after 65,535 turns. There a ray pauses before that and goes on in another pass over the image; its
//! state is kept with it on the device, and both ways give the same bits. Other adapters draw in one pass.
//!
//! **No guarantee**, as for `peaks/cpu-paper`: pairs of crossings between two samples are lost. Claims are never made.
//!
//! Source: Knoll et al. 2009, sections 4 to 6; corrections in the documentation of [`crate::sampling`].

mod layout;
mod programs;
pub(crate) mod renderer;

use crate::knobs::GPU as INFO;
use crate::scene::check;
use isobar_core::{Method, MethodInfo, RenderError, Renderer, Request, Scene, Unsupported};
use isobar_cpu::scene::check_request;
use isobar_gpu::{Gpu, GpuError};

/// Volume ray casting with peak finding on the GPU; see [`PEAKS_GPU`].
#[derive(Debug)]
pub struct PeaksGpu;

/// The method `peaks/gpu`: `peaks/cpu-paper` in f32 on the GPU, without guarantee. Grids of any sample type; all reconstructions of the crate; open cuts by clipping planes. In
/// `Frame::surface` peaks follow the isovalues, ascending. Source: Knoll et al. 2009, sections 4 to 6.
pub static PEAKS_GPU: PeaksGpu = PeaksGpu;

fn machine(e: &GpuError) -> Unsupported {
    Unsupported::Machine {
        method: INFO.id,
        reason: e.to_string(),
    }
}

impl Method for PeaksGpu {
    fn info(&self) -> &'static MethodInfo {
        &INFO
    }

    /// Also opens the shared device, which later calls find open.
    fn supports(&self, scene: &Scene<'_>, request: &Request) -> Result<(), Unsupported> {
        check(&INFO, scene, request)?;
        Gpu::shared().map(|_| ()).map_err(|e| machine(&e))
    }

    fn open(&self, request: &Request) -> Result<Box<dyn Renderer>, RenderError> {
        check_request(&INFO, request)?;
        let gpu = Gpu::shared().map_err(|e| machine(&e))?;
        Ok(Box::new(renderer::GpuRenderer::new(gpu, request)?))
    }
}
