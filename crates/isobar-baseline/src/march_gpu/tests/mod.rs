//! Tests on an adapter: the reconstruction alone, the blocks, frames against march/cpu and against the f32 twin, errors.

mod evaluate;
mod frames;
mod scenes;
