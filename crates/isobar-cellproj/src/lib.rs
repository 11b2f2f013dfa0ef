//! Projected tetrahedra: S. Roettger, M. Kraus, T. Ertl, *Hardware-Accelerated Volume And Isosurface Rendering Based On Cell-Projection*, IEEE
//! Visualization 2000.
//!
//! [`CELLPROJ_CPU_PAPER`] is the algorithm as printed, `CELLPROJ_GPU` (feature `gpu`) draws on wgpu. [`CELLPROJ_CPU`] projects the cells of a tetrahedral mesh to the image and finds in each pixel what the ray meets there. What
//! the paper does with textures and blending of graphics hardware is done here per fragment and without their limits: isosurfaces are exact hits.
//!
//! **Architecture invariants.** Rays are certified for the bits of `View::ray`. Frames do not depend on the number of threads. What f64 cannot
//! decide within its proved bound is decided in integers, so no claim rests on a tolerance.

mod blocks;
mod bvh;
mod camera;
mod cells;
#[cfg(test)]
mod colour_tests;
mod cpu;
mod exact;
mod exterior;
mod faces;
#[cfg(feature = "gpu")]
mod gpu;
#[cfg(test)]
mod hostile_tests;
mod lanes;
mod measure;
mod medium;
mod mesh;
mod mixed;
mod normals;
mod order;
mod paper;
mod patch;
mod raster;
mod resolve;
mod setup;
mod spans;
mod stays;
mod surfaces;
mod tables;
#[cfg(test)]
mod tests;
mod topology;
mod volume;

pub use cpu::{CELLPROJ_CPU, CellprojCpu};
#[cfg(feature = "gpu")]
pub use gpu::{CELLPROJ_GPU, CellprojGpu};
pub use paper::{CELLPROJ_CPU_PAPER, CellprojCpuPaper, TextureMap, TextureMaps};
