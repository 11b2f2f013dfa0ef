//! The rulers: fixed-step marching with bisection, and marching cubes with ray casting.
//!
//! Simple methods that most systems use, written to be fast and reported without mercy: the other methods are measured against them. None
//! of them makes a claim. See the README for their knobs, what they cost and where they fail.

#[cfg(test)]
mod clipping;
mod given;
mod index_space;
mod march;
#[cfg(feature = "gpu")]
mod march_gpu;
mod mc;
#[cfg(test)]
mod testing;

use isobar_cpu::scene as support;

pub use march::{MARCH_CPU, MarchCpu};
#[cfg(feature = "gpu")]
pub use march_gpu::MARCH_GPU;
pub use mc::{MC_CPU, McCpu};
