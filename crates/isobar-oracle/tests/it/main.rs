//! One binary: the hard cases by their numbers, stages against each other, frames.
#![expect(
    clippy::excessive_precision,
    reason = "expected roots are written with the digits they were worked out to"
)]

mod algebraic;
mod analytic;
mod cells;
mod clips;
mod frames;
mod hexes;
mod random;
mod support;
mod type6;
mod univariate;
