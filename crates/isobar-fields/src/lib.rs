//! Continuous functions: analytic fields and grid reconstructions.
//!
//! [`GridSpline`] reconstructs a grid: trilinear, quadratic and cubic B-spline, plain and interpolating ([`Kind`]); [`Type6Spline`] with cubics on
//! tetrahedra. [`Reconstruction`] names them all. [`analytic`] makes
//! the named fields of the command line, [`Synthetic`] the data sampled from them. All are [`isobar_core::Function`]s: value, gradient,
//! rigorous enclosure, and a structure that gives the exact polynomial pieces along a ray (or rigorous enclosures where there are none).
//! [`grid_to_tets`] and [`grid_to_hexes`] convert between containers.
//!
//! ```
//! use isobar_core::{DVec3, Data, Function, Stage};
//! use isobar_fields::{GridSpline, Kind, Synthetic};
//!
//! let source: Synthetic = "marschner-lobb,n=41".parse()?;
//! let Data::Grid(grid) = source.data()? else { unreachable!("as=grid is the default") };
//! let spline = GridSpline::new(&grid, Kind::CubicInterpolating, Stage::Stored)?;
//! let x = DVec3::new(0.1, 0.2, 0.3);
//! let error = spline.value(x) - source.field().function.value(x);
//! assert!(error.abs() < 0.1);
//! # Ok::<(), isobar_core::DataError>(())
//! ```
//!
//! **Architecture invariants.** The border rule is [`Border::index`] and nothing else. Nothing here finds a root. Nothing here opens a file.

mod algebraic;
mod convert;
mod enclose;
mod evaluate;
mod hexes;
pub mod hexes_bezier;
mod hexes_eval;
mod hexes_patch;
mod kind;
mod polynomial;
mod prefilter;
mod reconstruction;
mod scalar;
mod spline;
mod surfaces;
mod synthetic;
mod tets;
mod transcendental;
pub mod type6;
mod type6_enclose;
mod type6_masks;
mod type6_patch;

pub use algebraic::AlgebraicFunction;
pub use convert::{grid_to_hexes, grid_to_tets};
pub use hexes::HexField;
pub use hexes_eval::{HexPoint, evaluate_hex};
pub use hexes_patch::{NurbsPatch, algebraic_to_hexes, refine_hexes, spline_to_hexes, spline_to_hexes_where};
pub use kind::{Border, Kind};
pub use reconstruction::Reconstruction;
pub use spline::{Coefficients, GridSpline};
pub use synthetic::{Field, Synthetic, analytic};
pub use tets::TetLinear;
pub use type6::Type6Spline;
