//! The only crate that opens a data file.
//!
//! [`load`] reads a volume (NRRD, NIfTI-1, VTI, legacy VTK structured points, raw with a telling name) or a mesh of cells with values (VTU, legacy VTK
//! unstructured grids, PLOT3D; split into tetrahedra) or curved hexahedra (NURBS volumes, MFEM, Lagrange hexahedra; as Bezier elements), [`load_mesh`] a triangle mesh (OFF, PLY);
//! [`write_nrrd`] writes a volume. The format is found by content, by name only for raw volumes. The table of formats with their limits is in
//! the crate's README.
//!
//! **Guarantees.** A declared size is checked against the file before memory is taken for it. Samples go straight into their final shared
//! buffer: peak memory is the samples and less than 1 MiB (VTI and legacy VTK too; a PLY mesh takes several times itself). Nothing here panics,
//! whatever the bytes; an unusable file is an [`IoError`] of one line, `FILE: reason; remedy`.
//!
//! **Architecture invariants.** No other crate parses a data format. Nothing here prints, and nothing here reads the network.

mod base64_stream;
mod cells;
mod error;
mod field;
mod finite;
#[doc(hidden)]
pub mod fuzz;
mod input;
mod lagrange;
mod mesh;
mod mfem;
mod mfem_dofs;
mod nifti1;
mod nrrd;
mod nrrd_write;
mod nurbs;
mod off;
mod plot3d;
mod ply;
mod raw;
mod sample;
mod sniff;
mod volume;
mod vti;
mod vti_data;
mod vtk;
mod vtk_cells;
mod vtu;

pub use error::{Cause, IoError};
pub use mesh::TriangleMesh;

use input::{BytesInput, FileInput};
use isobar_core::{Data, Grid};
use std::path::Path;

/// What of a file is read, and how.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Options {
    /// Name of the field; without it the first scalar of the points (else of the cells, else the first field of any kind).
    pub field: Option<String>,
    /// What NaN and infinite samples are read as; without it they are kept: [`Grid::require_finite`] and [`Loaded::not_finite`] tell.
    pub nan: Option<f64>,
    /// Whether fields of the cells of a mesh are averaged to its points; without it they are refused.
    pub cell_to_point: bool,
    /// Whether hexahedra (VTK types 11, 12 and 72, PLOT3D) and the cells of a grid become Bezier elements; without it those of types 12 and of PLOT3D become tetrahedra (11 is
    /// refused) and grids stay grids. Values of cells are then constant on each element.
    pub as_hexes: bool,
}

/// A volume read from a file.
#[derive(Debug, Clone)]
pub struct Loaded {
    /// A grid, tetrahedra or Bezier elements, world coordinates and lengths as in the file.
    pub data: Data,
    /// Name of the field read; `value` where the format has no names.
    pub field: String,
    /// All names `Options::field` may have.
    pub fields: Vec<String>,
    /// Warnings, a line each: values changed by rounding, surplus data ignored, NaN replaced.
    pub notes: Vec<String>,
    /// Values of a mesh or of elements, as counted in the file, that are NaN or infinite and were left so: such data are to be described, not drawn. A Bezier element
    /// with one may hold NaN in all its coefficients. 0 for a grid, whose samples tell themselves.
    pub not_finite: usize,
}

/// Reads a volume from a file.
///
/// # Errors
/// [`IoError`] naming the file, what is wrong with it, and what to do.
pub fn load(path: &Path, o: &Options) -> Result<Loaded, IoError> {
    FileInput::new(path)
        .and_then(|input| sniff::read(&input, o))
        .and_then(|l| in_form(l, o))
        .map_err(|cause| IoError::new(path, cause))
}

/// Reads a volume from the bytes of a file called `name`. A detached header finds no data file.
///
/// # Errors
/// As [`load`], with `name` as the file.
pub fn load_bytes(name: &str, bytes: &[u8], o: &Options) -> Result<Loaded, IoError> {
    BytesInput::new(name, bytes)
        .and_then(|input| sniff::read(&input, o))
        .and_then(|l| in_form(l, o))
        .map_err(|cause| IoError::new(Path::new(name), cause))
}

/// Grids as trilinear elements where these are asked for; meshes are by now.
fn in_form(mut l: Loaded, o: &Options) -> Result<Loaded, Cause> {
    if o.as_hexes {
        match &l.data {
            Data::Grid(g) => {
                l.not_finite = g.samples.range().1;
                l.data = Data::Hexes(isobar_fields::grid_to_hexes(g).map_err(Cause::AsHexes)?);
            }
            Data::Hexes(_) => {}
            other => {
                return Err(Cause::Unsupported {
                    format: "as=hexes",
                    what: other.kind().to_owned(),
                    remedy: "leave it out, or give a file of hexahedra or a grid",
                });
            }
        }
    }
    Ok(l)
}

/// Reads a triangle mesh from a file.
///
/// # Errors
/// [`IoError`] naming the file, what is wrong with it, and what to do.
pub fn load_mesh(path: &Path) -> Result<TriangleMesh, IoError> {
    FileInput::new(path)
        .and_then(|input| mesh::read(&input))
        .map_err(|cause| IoError::new(path, cause))
}

/// Reads a triangle mesh from the bytes of a file called `name`.
///
/// # Errors
/// As [`load_mesh`], with `name` as the file.
pub fn load_mesh_bytes(name: &str, bytes: &[u8]) -> Result<TriangleMesh, IoError> {
    BytesInput::new(name, bytes)
        .and_then(|input| mesh::read(&input))
        .map_err(|cause| IoError::new(Path::new(name), cause))
}

/// Writes a grid as NRRD0004: attached header, `space directions` and `space origin`, gzip, little-endian. Read back it is the same grid: bit
/// for bit where each axis lies along a world axis, else within rounding of direction and spacing. The file appears under its name whole or not at all.
///
/// # Errors
/// [`IoError`] where the folder does not exist or cannot be written, or the disk is full.
pub fn write_nrrd(path: &Path, grid: &Grid) -> Result<(), IoError> {
    nrrd_write::write(path, grid).map_err(|cause| IoError::new(path, cause))
}
