//! Univariate polynomials on a ray: three forms, and root finders on [0, 1] that say what they know.
//!
//! # Forms
//! A polynomial of degree n is a slice of n + 1 coefficients, f32 or f64 ([`Real`]), n at most [`MAX_DEGREE`] where a table is needed:
//! - [`power`]: `sum a[i] t^i`;
//! - [`bernstein`]: `sum b[i] C(n,i) t^i (1-t)^(n-i)`, the form of the solvers: its coefficients enclose p on [0, 1] and the
//!   number of their sign changes bounds the number of roots (Descartes' rule);
//! - [`scaled`]: `sum s[i] t^i (1-t)^(n-i)`, what compositions along a ray give.
//!
//! Conversions, evaluation, derivative, subdivision and elevation work in place and allocate nothing.
//!
//! # Root finders
//! [`first_root`] and [`all_roots`] (scalar, f32 or f64); [`first_roots`] and [`roots_of_packets`] (packets of sixteen f32 polynomials, the same
//! answers bit for bit). "No root", "root in [lo, hi]" and "gave up" are different values.
//!
//! ```
//! use isobar_poly::{First, RootKind, Tolerance, all_roots, first_root, power};
//!
//! // (t - 1/4)(t - 1/2), scaled by 8
//! let mut b = [1.0, -6.0, 8.0];
//! power::to_bernstein(&mut b);
//! let First::Root(root) = first_root(&b, &Tolerance::new(1e-9)) else { panic!("two roots") };
//! assert!(root.kind == RootKind::Crossing && root.lo <= 0.25 && 0.25 <= root.hi && root.hi - root.lo <= 1e-9);
//! assert_eq!(all_roots(&b, &Tolerance::new(1e-9)).as_slice().len(), 2);
//!
//! // Two sign changes, no root: not reported as one.
//! assert_eq!(first_root(&[1.0, -0.9, 1.0], &Tolerance::new(1e-9)), First::None);
//! // A double root: found, and flagged, because rounding cannot tell it from a near miss.
//! let touching = first_root(&[1.0, -1.0, 1.0], &Tolerance::new(1e-9));
//! assert!(touching.root().is_some_and(|r| r.kind == RootKind::Touching && r.lo <= 0.5 && 0.5 <= r.hi));
//! ```
//!
//! # Guarantee
//! The coefficients are taken as exact (or as known up to [`Tolerance::error`], then each statement holds for every polynomial within that
//! distance). Arithmetic is floating point; every coefficient of every cell carries a bound of its accumulated rounding error, and
//! a sign counts only if the coefficient exceeds it. Proved, therefore:
//! - [`First::None`]: p has no root in [0, 1].
//! - [`RootKind::Crossing`], [`RootKind::End`]: the bracket contains a root (an odd number with multiplicity; for `End` at `t`), and `[0, lo)`
//!   contains none. With [`all_roots`]: nothing outside of the brackets is a root.
//! - A bracket is at most [`Tolerance::width`] wide unless the sign of p is not certain closer to the root, or (f32) numbers there are not close
//!   enough. f32 solvers find the root in f32, and where that leaves the bracket too wide, take signs in f64. A `Crossing` of at most the
//!   wanted width found by Newton's iteration is one simple root.
//!
//! Not proved, and said so by its own value:
//! - [`RootKind::Touching`]: |p| is below what the error bound can tell from zero, and no sign change is seen. A double root, a pair
//!   of roots, or a near miss within a few error bounds (f64: about 1e-15 of the largest coefficient; f32: about 1e-6). So an exact double root
//!   is always reported, but always as `Touching`; a pair of roots closer than about the square root of the relative error bound (3e-8 in f64, 1e-3
//!   in f32) is one `Touching`; a triple root is one `Crossing` with a bracket of about its cube root.
//! - [`RootKind::Interval`]: every coefficient is within the error bound of zero (exactly zero, if `error` is 0).
//! - [`First::GaveUp`]: not finite, no coefficients or too many, or the work limit. A root is never lost silently.
//!
//! The bounds are worst case, usually several times the real error.
//!
//! [`exact`] has whole numbers of any size instead, for what is left undecided: no bounds, some thousand times slower.
//!
//! # Method
//! Depth-first, left-first halving by de Casteljau's scheme until Descartes' rule of signs says 0 or 1 (Lane and Riesenfeld,
//! "Bounds on a polynomial", BIT 21, 1981), then Newton's iteration inside the cell from the crossing of the control polygon, then a check
//! of the signs on both sides of the estimate. If the check fails, bisection.

mod answer;
pub mod bernstein;
mod cell;
pub mod exact;
mod packet;
pub mod power;
mod real;
mod refine;
pub mod scaled;
mod sharpen;
mod simd;
mod solve;
mod solvers;

pub use answer::{First, Root, RootKind, Roots, Tolerance};
pub use packet::{Level, first_roots, first_roots_at, packet, roots_of_packets, roots_of_packets_at};
pub use real::{MAX_DEGREE, Real};
pub use simd::LANES;
pub use solve::{all_roots, first_root};
pub use solvers::{FindAll, FindFirst, NamedSolver, solvers};
