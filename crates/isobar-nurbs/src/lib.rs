//! Martin, Cohen and Kirby, *Direct Isosurface Visualization of Hex-Based High-Order Geometry and Attribute Representations* (IEEE TVCG 2012).
//!
//! [`NURBS_CPU`] draws isosurfaces, parametric surfaces and the boundary of rational Bezier elements: all hits, proved with interval Newton on the
//! system alpha = beta = gamma = 0. [`NURBS_CPU_PAPER`] is the algorithm as printed. [`orientation()`] tells folded and left-handed elements. The elements, Bezier algebra and readers are in `isobar_fields` and `isobar_io`.
//!
//! **Architecture invariants.** No other method is imported. Nothing prints.

mod affine;
mod bernstein;
mod candidates;
mod cover;
mod cpu;
mod ends;
#[cfg(test)]
mod extremes;
mod frustum;
mod grid;
mod matrix;
mod model;
mod newton;
mod orientation;
mod paper;
mod paper_cpu;
mod paper_forms;
mod paper_parts;
mod paper_silhouette;
#[cfg(test)]
mod paper_silhouette_tests;
#[cfg(test)]
mod paper_tests;
pub mod paper_trace;
mod paper_volume;
#[cfg(test)]
mod proofs;
mod solve;
#[cfg(test)]
mod tests;
mod tile;
mod tree;
mod wide;

pub use cpu::{NURBS_CPU, NURBS_CPU_PAPER, NurbsCpu};
pub use orientation::{Orientation, Orientations, orientation};
