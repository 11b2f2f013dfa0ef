//! Kalbe, Koch and Goesele, *High-Quality Rendering of Varying Isosurfaces with Cubic Trivariate C1-continuous Splines* (ISVC 2009).
//!
//! The spline itself, its masks and its exact tests are in `isobar_fields::type6`; corrections to the paper in maths, section A. Here is how it is drawn:
//! [`TETSPLINE_CPU`] walks the active cubes along each ray and the tetrahedra of each in the order the ray crosses them, restricts the cubic to the ray by
//! blossoming, and finds its roots: certified ones, or those of the paper's three-start Newton iteration. First hits are found for the 256 rays of a tile together,
//! eight pieces of rays at a time. [`classify`] has the paper's classification of cubes
//! and tetrahedra and the conservative one. `TETSPLINE_GPU` (feature `gpu`) is the paper's renderer on wgpu.
//!
//! **Architecture invariants.** No other method is imported. Nothing prints.

mod bricks;
mod caps;
pub mod classify;
mod cpu;
mod cube;
#[cfg(feature = "gpu")]
mod gpu;
pub mod lists;
pub mod newton;
mod packet;
mod paint;
#[cfg(test)]
mod proofs;
mod ray;
mod roots;
mod single;
mod smooth;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod use_tests;
mod walk;

pub use cpu::{TETSPLINE_CPU, TetsplineCpu};
#[cfg(feature = "gpu")]
pub use gpu::{TETSPLINE_GPU, TetsplineGpu};
