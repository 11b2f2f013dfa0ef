//! What the thesis compares its caster with (chapter 6), on the CPU, to be measured beside it.
//!
//! [`frustum`]: the frustum form of Reimers and Seland for one algebraic surface. [`algebraic`]: the thesis's pipeline for such a surface (section 3.2), with
//! either composition, its stages clocked one by one. [`texture`]: fast tri-cubic texture sampling after Sigg and Hadwiger, with the weights of a
//! texture unit. None of them claims anything.

pub mod algebraic;
pub mod frustum;
#[cfg(test)]
mod tests;
pub mod texture;
