//! Stage 3: integers without limit. Nothing here rounds, except where a root is handed back as two f64 that enclose it.

mod algebra;
mod cell;
mod number;
mod ray;
mod scaled;

pub(crate) use cell::{algebraic_piece, lattice_piece};
pub(crate) use number::{Dyadic, Ratio, sign};
pub(crate) use ray::{ExactRay, Span};
pub(crate) use scaled::{ExactRoot, Piece, Roots, convolve};
