//! Certified ground truth: first hit, all hits, misses and multiplicities along a ray.
//!
//! [`Oracle`] answers for one function and isovalue: the first t >= 0 in the closed domain with `s(o + t d) = c`, where o and d are the
//! ray's f64 taken as exact numbers, s is exact over the f64 coefficients that [`isobar_core::Lattice::stencil`] gives (or over the terms of an
//! [`isobar_core::Algebraic`], or the control points, weights and coefficients of [`isobar_core::HexPatches`]), and the domain's f64 axes are inverted exactly. Every answer is a bracket of two f64 that certainly
//! holds one root (with its multiplicity), a certified miss, or a stretch on which s = c; on mapped elements a stretch may stay undecided ([`Doubt`]). [`Truth`] is the first hit of every pixel of a view,
//! [`check()`] holds a frame against it, and [`univariate`] solves one polynomial. [`Integral`] is the colour of a ray through a medium and surfaces with
//! opacity, with a proved bound, [`Colours`] that of every pixel.
//!
//! Three stages decide, each only what the one before could not: f64 with proved error bounds, double-double with the same bounds and
//! a smaller unit, integers without limit. Where each bound is derived:
//!
//! | idea | module | bound |
//! |---|---|---|
//! | numbers | `real` | units of rounding of f64 and double-double |
//! | the ray in local coordinates | `map` | coordinates and crossing times of cell faces |
//! | clipping planes | `clip` | none: exact |
//! | cells on the way | `walk`, `skip` | no cell is left out; order is kept |
//! | `s - c` in Bernstein form | `compose` | one absolute bound for all coefficients |
//! | cubics on tetrahedra | `type6` | cuts between tetrahedra, one bound for all coefficients |
//! | linear pieces on the cells of a mesh | `tets` | a bound carried along with each number |
//! | mapped hexahedra: two planes and the surface | `hexes` | one bound per polynomial, interval Newton on enlarged boxes |
//! | roots of it | `isolate`, `bracket` | Descartes with doubtful signs, brackets in t |
//! | integers | `exact` | none: exact |
//! | fields without polynomials | `analytic` | the enclosures of [`isobar_core::Analytic`] |
//! | colours: medium and surfaces | `integral` | a bound carried along the ray |
//! | the undecidable flag | `extremum` | a statistic, no certificate |
//!
//! **Architecture invariants.** No composition, isolation or refinement code is shared with any method. Only `exact` modules use an integer
//! library. Nothing prints, nothing opens a file. Answers do not depend on the number of threads.

mod analytic;
mod bracket;
mod check;
mod clip;
mod codec;
mod compose;
mod exact;
mod extremum;
mod hexes;
mod integral;
mod isolate;
mod lattice;
mod map;
mod oracle;
mod pieces;
mod polynomial;
mod real;
mod root;
mod skip;
mod tets;
mod truth;
mod type6;
pub mod univariate;
mod walk;

pub use check::{Check, Class, Quantiles, check};
pub use codec::cache_key;
pub use hexes::Doubt;
pub use integral::{Colour, Colours, Difference, Integral, Model, Reference};
pub use oracle::Oracle;
pub use root::{AllRoots, Answer, Decided, Multiplicity, Root};
pub use truth::{Oracles, Stages, TruePixel, Truth, TruthError};
