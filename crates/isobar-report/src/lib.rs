//! Definitions, measurements and the generated report.
//!
//! A benchmark is data ([`definitions`], [`cases`]); [`report`] measures all of them ([`measure`], [`hard`],
//! [`convergence`], [`benches`]) into plain structs ([`results`]), which [`page`], [`plots`] and [`tables`] turn into files.
//! [`data`] lists, verifies and generates the data, [`counts`] prints certified hits for the definitions, [`record`] keeps a run.
//!
//! **Architecture invariants.** Every number of the page comes from a frame that was checked against the oracle in the same run. The
//! code knows no particular benchmark. Nothing here draws or finds a root for a picture.

pub mod benches;
pub mod cases;
pub mod convergence;
pub mod counts;
pub mod data;
pub mod definitions;
pub mod hard;
pub mod machine;
pub mod measure;
mod models;
pub mod page;
pub mod plots;
pub mod record;
pub mod report;
pub mod results;
pub mod sdf;
pub mod steinberger;
pub mod tables;
