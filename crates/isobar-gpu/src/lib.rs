//! The GPU house: adapter choice and report, a shared device whose failures are values, buffers and volumes within the device's limits, one
//! compute and one raster helper with pass-level timestamps, and WGSL from named snippets.
//!
//! What ray casters share besides: the view in [`bands`] of rows, rays up and hits back into a frame; isovalues in f32 ([`levels`]); a [`Prover`] of claims.
//!
//! [`Gpu::shared`] is where a method starts; without a Vulkan loader or adapter it says so with a remedy, and nothing else of the program
//! needs it. Calls into wgpu belong inside [`Gpu::guard`] (all functions here are), which turns what wgpu reports into
//! [`GpuError`]; nothing here panics on a lost device, a full memory or a refused shader.
//!
//! **Architecture invariants.** No method's mathematics, no data files, no threads of its own (rays are made on the caller's pool).

mod adapter;
pub mod bands;
mod buffer;
mod claims;
mod context;
mod error;
pub mod levels;
mod raster;
pub mod rays;
pub mod shader;
pub mod testing;
mod texture;
mod work;

pub use adapter::{AdapterReport, adapters};
pub use claims::Prover;
pub use context::Gpu;
pub use error::GpuError;
pub use raster::{Raster, RasterOptions, Target};
pub use testing::test_adapter;
pub use texture::{Texel, Texels, Volume};
pub use wgpu;
pub use work::{Kernel, Work};

/// The README's example compiles.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
