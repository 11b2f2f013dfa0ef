//! The rulers: fixed-step marching with bisection, and marching cubes with ray casting.

#[cfg(feature = "gpu")]
mod march_gpu;

#[cfg(feature = "gpu")]
pub use march_gpu::MARCH_GPU;
