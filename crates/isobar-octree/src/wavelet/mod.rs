//! Spline wavelets: levels of detail of a grid without cracks (Steinberger 2010, chapter 4; S14 to S18).
//!
//! A [`Pyramid`] is the decomposition of a volume, made once. A [`Selection`] says which chunks of 8^3 wavelets are used: by view, magnitude or
//! isovalue ([`Criteria`]), or by hand. An [`Adaptive`] reconstructs what a selection needs, chunk by chunk, and keeps it for the next one. What it
//! describes is one spline over the finest lattice; [`Adaptive::grid`] gives its coefficients, which the casters of this crate draw and the oracle checks
//! with the reconstruction of the bank's degree and the samples as coefficients.
//! [`Multiresolution`] draws it with every part at its own level, and with the feature `gpu` `gpu::GpuAdaptive` reconstructs on a device.
//!
//! ```
//! use isobar_core::{Grid, Samples};
//! use isobar_octree::wavelet::{Adaptive, Bank, Criteria, Pyramid, Selection};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let samples: Vec<f32> = (0..20 * 20 * 20).map(|i| (i % 20) as f32).collect();
//! let grid = Grid::unit([20; 3], Samples::F32(samples.into()))?;
//! let pyramid = std::sync::Arc::new(Pyramid::new(&grid, Bank::Psi42)?);
//! let near = Criteria { view: Some((glam::DVec3::new(-5.0, 10.0, 10.0), 0.8)), ..Criteria::default() };
//! let mut adaptive = Adaptive::new(pyramid.clone());
//! adaptive.update(&Selection::new(&pyramid, &near), isobar_octree::wavelet::Extent::Drawn);
//! assert_eq!(adaptive.grid()?.dims, [20; 3]);
//! # Ok(())
//! # }
//! ```
//!
//! **Borders.** Inside the transform lines are mirrored (maths, corrections, section B), so that it is exact for every size. The function drawn is the spline
//! of the finest lattice with the contract's rule of clamped indices; with all details its coefficients are the samples but for rounding, so it is
//! the contract's function. Where details are dropped near a face, the coefficients are those of the mirrored coarse ones, which differ from a coarse grid of
//! its own by the border rule. On an axis whose size is not m 2^L + 1 (degrees 1 and 3) or m 2^L (degree 2) the mirror of a coarse level lies beside that
//! of the finest, so the last steps of that axis are not an exact subdivision of the coarse spline; they join without a jump all the same.
//!
//! **Guarantee.** The function is continuous with its first degree - 1 derivatives, whatever is selected. Values are f32 sums of at most a few hundred terms;
//! no bound is claimed; the tests hold noise of three levels to 16 units in the last place of the greatest sample.

mod adaptive;
mod banks;
mod blocks;
pub mod gain;
#[cfg(feature = "gpu")]
pub mod gpu;
mod multires;
mod passes;
mod pyramid;
mod ranges;
mod select;
pub mod table;
#[cfg(test)]
mod tests;
mod transform;

pub use adaptive::{Adaptive, Extent, Update};
pub use banks::{Bank, Filter, Filters, Mirror, Number};
pub use blocks::{CHUNK, ChunkSet};
pub use multires::Multiresolution;
pub use pyramid::{Node, Placement, Pyramid};
pub use select::{Criteria, Selection};
