//! Tiles, threads, run-time SIMD dispatch and frame assembly for CPU methods.
//!
//! A method on the CPU opens a [`Pool`], hands [`render_tiles`] a closure that draws one [`Tile`], and pushes each ray's hits front to
//! back into a [`PixelSink`]; colour, layers and the number of hits follow from that. Inside the closure a kernel may be run at the
//! best instruction set of the machine through [`Level::run`], or the rays of a tile may travel together ([`packet`]).
//!
//! **Architecture invariants.** No allocation per ray: channels are written in place. The frame does not depend on the number of
//! threads, because a tile depends on nothing but the scene. No method and no reconstruction is known here.

mod blend;
pub mod clip;
pub mod index;
mod level;
mod memory;
pub mod nodes;
pub mod packet;
mod pool;
pub mod scene;
mod tiles;

pub use blend::{Blend, PixelSink, is_visible};
pub use level::{Kernel, Level};
pub use memory::{available_bytes, require_memory};
pub use pool::Pool;
pub use tiles::{TILE, Tile, TileOut, copy_frame, render_tiles};
