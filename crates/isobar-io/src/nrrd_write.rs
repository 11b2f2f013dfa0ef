//! Writing a grid as NRRD: attached header, gzip, under a temporary name first.

use crate::error::Cause;
use flate2::Compression;
use flate2::write::GzEncoder;
use isobar_core::{Grid, Samples};
use std::io::{BufWriter, Write};
use std::path::Path;
use tempfile::NamedTempFile;

/// Writes to a temporary file in the folder of `path` and renames it: the name never holds half a file, and a failure leaves nothing.
pub(crate) fn write(path: &Path, grid: &Grid) -> Result<(), Cause> {
    if path.is_dir() {
        return Err(Cause::Folder);
    }
    let failed = |e: &std::io::Error| Cause::System {
        doing: "write",
        error: crate::error::one_line(&e.to_string(), 120),
    };
    let folder = match path.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
    };
    let mut file = temporary(folder).map_err(|e| failed(&e))?;
    stream(BufWriter::new(file.as_file_mut()), grid).map_err(|e| failed(&e))?;
    file.persist(path).map_err(|e| failed(&e.error))?;
    Ok(())
}

/// With the permissions of an ordinary new file, not the private ones of a temporary file.
fn temporary(folder: &Path) -> std::io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(".isobar-").suffix(".tmp");
    #[cfg(unix)]
    let builder = builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
    builder.tempfile_in(folder)
}

/// The file's bytes.
pub(crate) fn stream(mut out: impl Write, grid: &Grid) -> std::io::Result<()> {
    let axes = grid.domain().axes;
    let vector = |v: isobar_core::DVec3| format!("({},{},{})", v.x, v.y, v.z);
    let kind = match grid.samples {
        Samples::U8(_) => "uint8",
        Samples::I16(_) => "int16",
        Samples::U16(_) => "uint16",
        Samples::F32(_) => "float",
    };
    let [nx, ny, nz] = grid.dims;
    let (x, y, z) = (vector(axes.x_axis), vector(axes.y_axis), vector(axes.z_axis));
    write!(
        out,
        "NRRD0004\ntype: {kind}\ndimension: 3\nspace dimension: 3\nsizes: {nx} {ny} {nz}\nspace directions: {x} {y} {z}\n\
         space origin: {}\nkinds: domain domain domain\nendian: little\nencoding: gzip\n\n",
        vector(grid.origin)
    )?;
    // Level 6 is gzip's own default.
    let mut packed = GzEncoder::new(out, Compression::new(6));
    match &grid.samples {
        Samples::U8(s) => packed.write_all(s)?,
        Samples::I16(s) => little(&mut packed, s, |v| v.to_le_bytes())?,
        Samples::U16(s) => little(&mut packed, s, |v| v.to_le_bytes())?,
        Samples::F32(s) => little(&mut packed, s, |v| v.to_le_bytes())?,
    }
    packed.finish()?.flush()
}

/// Values in little-endian bytes, in batches.
fn little<T: Copy, const N: usize>(out: &mut impl Write, samples: &[T], bytes: impl Fn(T) -> [u8; N]) -> std::io::Result<()> {
    let mut batch = Vec::with_capacity(N << 14);
    for part in samples.chunks(1 << 14) {
        batch.clear();
        batch.extend(part.iter().flat_map(|&v| bytes(v)));
        out.write_all(&batch)?;
    }
    Ok(())
}
