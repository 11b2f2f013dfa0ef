//! All integration tests of isobar-io in one binary.

mod build;
mod cells;
mod corpus;
mod data;
mod files;
mod hexes;
mod hostile;
mod meshes;
mod nifti1;
mod nrrd;
mod vtk;
