//! The functions the fuzz targets call, one per format; the test `corpus` runs them on stable Rust. None may panic, whatever the bytes.

use crate::input::{BytesInput, Input, Packing};
use crate::{Cause, Loaded, Options, mesh, mfem, nifti1, nrrd, nurbs, vti, vtk};

/// The default field, then the last of the fields there are, with NaN replaced.
fn fields(bytes: &[u8], read: impl Fn(&dyn Input, &Options) -> Result<Loaded, Cause>) {
    let Ok(input) = BytesInput::new("fuzz", bytes) else { return };
    match read(&input, &Options::default()) {
        Ok(first) => {
            let o = Options {
                field: first.fields.last().cloned(),
                nan: Some(0.0),
                cell_to_point: true,
                as_hexes: false,
            };
            let _ = read(&input, &o);
            let _ = read(&input, &Options { as_hexes: true, ..o });
        }
        Err(e) => assert!(!e.to_string().contains('\n'), "an error of more than one line: {e}"),
    }
}

/// NRRD.
pub fn nrrd(bytes: &[u8]) {
    fields(bytes, nrrd::read);
}

/// NIfTI-1, as it is and as gzip.
pub fn nifti(bytes: &[u8]) {
    fields(bytes, |i, o| nifti1::read(i, Packing::None, o));
    fields(bytes, |i, o| nifti1::read(i, Packing::Gzip, o));
}

/// VTI.
pub fn vti(bytes: &[u8]) {
    fields(bytes, vti::read);
}

/// VTU: the tags of VTI, the arrays of a mesh.
pub fn vtu(bytes: &[u8]) {
    fields(bytes, vti::read);
}

/// A PLOT3D grid and its solution in one: the first four bytes are the size of the grid's file.
pub fn plot3d(bytes: &[u8]) {
    let Some((size, rest)) = bytes.split_first_chunk::<4>() else {
        return;
    };
    let size = (u32::from_be_bytes(*size) as usize).min(rest.len());
    let (grid, solution) = rest.split_at(size);
    fields(grid, |input, o| {
        let solution = BytesInput::new("q", solution)?;
        crate::plot3d::read_both(input, &solution, o)
    });
}

/// Legacy VTK.
pub fn vtk(bytes: &[u8]) {
    fields(bytes, vtk::read);
}

/// NURBS volumes: the first byte says which text the rest is.
pub fn nurbs(bytes: &[u8]) {
    let Some((kind, rest)) = bytes.split_first() else { return };
    fields(
        rest,
        match kind {
            b'{' => |i: &dyn Input, o: &Options| nurbs::read_json(i, o),
            b'<' => nurbs::read_gismo,
            _ => nurbs::read_geopdes,
        },
    );
}

/// An MFEM mesh and its grid function in one, the function behind the first form feed.
pub fn mfem(bytes: &[u8]) {
    let text = String::from_utf8_lossy(bytes);
    let (mesh, function) = text.split_once('\u{c}').map_or((&*text, None), |(m, f)| (m, Some(f)));
    fields(bytes, |_, o| mfem::read_both(mesh, function, o));
}

/// OFF.
pub fn off(bytes: &[u8]) {
    meshes(bytes, crate::off::read);
}

/// PLY.
pub fn ply(bytes: &[u8]) {
    meshes(bytes, crate::ply::read);
}

fn meshes(bytes: &[u8], read: impl Fn(&dyn Input) -> Result<mesh::TriangleMesh, Cause>) {
    let Ok(input) = BytesInput::new("fuzz", bytes) else { return };
    match read(&input) {
        Ok(m) => assert!(m.triangles.iter().flatten().all(|&i| (i as usize) < m.points.len())),
        Err(e) => assert!(!e.to_string().contains('\n'), "an error of more than one line: {e}"),
    }
}
