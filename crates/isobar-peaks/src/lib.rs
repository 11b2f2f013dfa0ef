//! Knoll et al. 2009: volume ray casting with peak finding and differential sampling.
//!
//! A. Knoll, Y. Hijazi, R. Westerteiger, M. Schott, C. Hansen, H. Hagen, *Volume ray casting with peak finding and differential sampling*, IEEE Visualization 2009. An
//! isosurface is a transfer function with a Dirac peak: the method draws the local maxima of a transfer function's opacity, and isovalues, as surfaces inside the
//! volume rendering integral. [`PEAKS_CPU`] finds all of their crossings exactly; [`PEAKS_CPU_PAPER`] is the algorithm as printed with its comparators, and `peaks/gpu`
//! (feature `gpu`) the same on the GPU.
//!
//! The parts: [`sampling`], where along a ray; [`tables`], what between two samples; [`Medium`], the integrals of a transfer function; [`Filter`], the reconstructions. What
//! of the paper is here, and what is not, is listed in the README.
//!
//! ```
//! use isobar_core::{Data, Frame, Grid, Method, Request, Samples, Stop, TransferFunction, View};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let samples: Vec<f32> = (0..4 * 4 * 4).map(|i| (i % 4) as f32).collect();
//! let data = std::sync::Arc::new(Data::Grid(Grid::unit([4, 4, 4], Samples::F32(samples.into()))?));
//! // a red peak at 1.5
//! let red = [1.0, 0.0, 0.0];
//! let points = vec![(1.4, red, 0.0), (1.5, red, 0.7), (1.6, red, 0.0)];
//! let mut renderer = isobar_peaks::PEAKS_CPU.open(&Request::default())?;
//! renderer.set_data(&data)?;
//! renderer.set_surfaces(&[])?;
//! renderer.set_medium(Some(&TransferFunction::new(points, 1.0)?))?;
//! renderer.set_view(&View::fit(data.bounds(), 40.0, 64, 48))?;
//! renderer.render(&Stop::default())?;
//! let mut frame = Frame::default();
//! renderer.read(&mut frame)?;
//! assert!(frame.t.iter().any(|t| t.is_finite()));
//! # Ok(())
//! # }
//! ```

mod crossings;
mod exact;
mod filter;
#[cfg(feature = "gpu")]
mod gpu;
mod interval;
mod knobs;
mod macrocells;
mod medium;
mod paper;
mod renderer;
pub mod sampling;
mod scene;
mod sink;
mod space;
pub mod tables;
#[cfg(test)]
mod tests;
mod volume;

pub use filter::{BC21, Filter};
#[cfg(feature = "gpu")]
pub use gpu::{PEAKS_GPU, PeaksGpu};
pub use medium::{Medium, Sums, opacity};
pub use renderer::{PEAKS_CPU, PEAKS_CPU_PAPER, PeaksCpu};
