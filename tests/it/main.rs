//! Integration tests: one binary, so that it links once.
//!
//! - `conformance`: every method of the list, the same checks through the traits;
//! - `hard`: the numerical cases of `bench-data/definitions/hard/cases`, every grid method and every root finder;
//! - `tidy`: rules of the repository that no compiler checks.

mod conformance;
mod hard;
mod tidy;
