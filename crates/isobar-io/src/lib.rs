//! The only crate that opens a data file.
