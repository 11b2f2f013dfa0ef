//! Which format a file is in: by content first, by name for raw volumes, which have none.

use crate::error::Cause;
use crate::input::{Input, Packing, head};
use crate::{Loaded, Options, mesh, mfem, nifti1, nrrd, nurbs, plot3d, raw, vti, vtk};

/// Enough for the NIfTI-1 header and for the first tag of an XML file.
const HEAD: usize = 4096;

/// Reads a volume with the reader of its format.
pub(crate) fn read(input: &dyn Input, o: &Options) -> Result<Loaded, Cause> {
    let (bytes, packing) = head(input, HEAD)?;
    match nifti1::sign(&bytes) {
        nifti1::Sign::One => return nifti1::read(input, packing, o),
        nifti1::Sign::Two => return Err(Cause::NotYet("NIfTI-2".into())),
        nifti1::Sign::Pair => return Err(Cause::NotYet("NIfTI in two files (.hdr and .img)".into())),
        nifti1::Sign::No => {}
    }
    if let Some(named) = raw::name(input.name()) {
        return raw::read(input, &named, packing, o);
    }
    let lower = input.name().to_ascii_lowercase();
    if packing == Packing::Gzip {
        // A damaged file hides its magic; its name still tells what it should be.
        if lower.ends_with(".nii.gz") {
            return nifti1::read(input, packing, o);
        }
        if kind(&bytes, &lower, input.len()).is_some() {
            return Err(Cause::Unsupported {
                format: "this format",
                what: "the whole file in gzip".into(),
                remedy: "unpack it with gunzip first",
            });
        }
        return Err(Cause::Unknown);
    }
    match kind(&bytes, &lower, input.len()) {
        Some(Kind::Nrrd) => nrrd::read(input, o),
        Some(Kind::Vtk) => vtk::read(input, o),
        Some(Kind::VtkXml) => vti::read(input, o),
        Some(Kind::NurbsJson) => nurbs::read_json(input, o),
        Some(Kind::MfemFunction) => Err(Cause::Unsupported {
            format: "MFEM",
            what: "a grid function named alone".into(),
            remedy: "name its mesh; the function of the same stem is found beside it",
        }),
        Some(Kind::Mfem) => mfem::read(input, o),
        Some(Kind::Gismo) => nurbs::read_gismo(input, o),
        Some(Kind::GeoPdes) => nurbs::read_geopdes(input, o),
        Some(Kind::Plot3d) => plot3d::read(input, o),
        Some(Kind::Mesh(format)) => Err(Cause::IsMesh(format)),
        None if lower.ends_with(".nii") => nifti1::read(input, packing, o),
        None => Err(Cause::Unknown),
    }
}

enum Kind {
    Nrrd,
    Vtk,
    VtkXml,
    Plot3d,
    NurbsJson,
    Gismo,
    Mfem,
    MfemFunction,
    GeoPdes,
    Mesh(&'static str),
}

fn kind(head: &[u8], name: &str, len: u64) -> Option<Kind> {
    if head.starts_with(b"NRRD") {
        return Some(Kind::Nrrd);
    }
    if head.get(..14).is_some_and(|h| h.eq_ignore_ascii_case(b"# vtk DataFile")) {
        return Some(Kind::Vtk);
    }
    if let Some(format) = mesh::sign(head) {
        return Some(Kind::Mesh(format));
    }
    let text = String::from_utf8_lossy(head);
    let text = text.trim_start_matches('\u{feff}').trim_start();
    if text.starts_with('<') {
        if text.contains("<VTKFile") {
            return Some(Kind::VtkXml);
        }
        // G+Smo: <xml> with Geometry elements.
        if text.contains("<Geometry") || text.contains("TensorBSpline") || text.contains("TensorNurbs") {
            return Some(Kind::Gismo);
        }
        return None;
    }
    if text.starts_with("MFEM ") {
        return Some(Kind::Mfem);
    }
    if text.starts_with("FiniteElementSpace") {
        return Some(Kind::MfemFunction);
    }
    if text.starts_with('{') && text.contains("nurbs-volume") {
        return Some(Kind::NurbsJson);
    }
    if text.starts_with("# nurbs mesh") {
        return Some(Kind::GeoPdes);
    }
    is_plot3d(head, name, len).then_some(Kind::Plot3d)
}

/// Three big-endian counts, then coordinates (with or without blanking) or solution values of exactly those counts.
fn is_plot3d(head: &[u8], name: &str, len: u64) -> bool {
    if ![".bin", ".xyz", ".q", ".g", ".p3d", ".x"].iter().any(|e| name.ends_with(e)) {
        return false;
    }
    let Some(counts) = head.first_chunk::<12>() else {
        return false;
    };
    let n = counts
        .as_chunks::<4>()
        .0
        .iter()
        .try_fold(1u64, |n, c| n.checked_mul(u64::from(u32::from_be_bytes(*c))))
        .unwrap_or(0);
    // xyz: 3 floats, 4 with blanking; q: 4 numbers, then 5 floats. Trailing bytes occur.
    let sizes = [12, 16, 20].map(|per| n.saturating_mul(per));
    n > 1
        && sizes
            .iter()
            .any(|s| len >= s.saturating_add(12) && len <= s.saturating_add(12 + 16 + 1024))
}
