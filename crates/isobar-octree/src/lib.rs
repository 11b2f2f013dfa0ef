//! Steinberger 2010: octree ray casting of splines on regular grids.
//!
//! M. Steinberger, *Isosurface rendering with spline wavelets and octrees* (thesis, Graz 2010). The casters `octree/cpu` and
//! `octree/gpu` (feature `gpu`) of degrees 1, 2 and 3 find every root of the spline along a ray, on the CPU with proofs in f64, or in exact arithmetic where that
//! cannot tell; [`compose`], [`finders`] and [`wavelet`] are the thesis's parts as studied things, [`comparators`] what it compares itself with,
//! [`blocks`] and [`stages`] its counts and clocks of a frame, [`figures`] its figures drawn again. What of the thesis is not here is listed in the README.
//!
//! ```
//! use isobar_core::{Data, Frame, Grid, Method, Request, Samples, Stop, Surface, View};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let samples: Vec<f32> = (0..4 * 4 * 4).map(|i| (i % 4) as f32).collect();
//! let data = std::sync::Arc::new(Data::Grid(Grid::unit([4, 4, 4], Samples::F32(samples.into()))?));
//! let mut renderer = isobar_octree::OCTREE_CPU.open(&Request::default())?;
//! renderer.set_data(&data)?;
//! renderer.set_surfaces(&[Surface::isovalue(1.5, 0)])?;
//! renderer.set_view(&View::fit(data.bounds(), 40.0, 64, 48))?;
//! renderer.render(&Stop::default())?;
//! let mut frame = Frame::default();
//! renderer.read(&mut frame)?;
//! assert!(frame.t.iter().any(|t| t.is_finite()));
//! # Ok(())
//! # }
//! ```

pub mod blocks;
mod bricks;
mod cell;
pub mod comparators;
pub mod compose;
mod cpu;
mod cubic;
mod exact;
#[cfg(test)]
mod exact_tests;
pub mod figures;
pub mod finders;
#[cfg(feature = "gpu")]
mod gpu;
#[cfg(test)]
mod memory_tests;
#[cfg(test)]
mod outlier_tests;
mod packet;
mod packet_cells;
#[cfg(test)]
mod packet_tests;
mod paper;
#[cfg(test)]
mod proofs;
mod smooth;
pub mod stages;
#[cfg(test)]
mod tests;
mod trilinear;
mod walk;
pub mod wavelet;

pub use cpu::{OCTREE_CPU, OctreeCpu};
#[cfg(feature = "gpu")]
pub use gpu::{OCTREE_GPU, OctreeGpu, agreement};
pub use paper::{OCTREE_CPU_PAPER, OctreeCpuPaper};
