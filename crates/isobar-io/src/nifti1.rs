//! NIfTI-1 in one file (`.nii`, `.nii.gz`).
//!
//! The 348 bytes of the header are read by the crate `nifti` 0.18, which neither panics nor allocates there on hostile bytes (fuzz target
//! `nifti`). Its volumes are not used: they gather all bytes in a vector and convert them into a second one, three times the memory allowed here, and
//! its affine code panics on a spacing that is not positive. So samples are streamed by this crate, and the affine is computed here by the
//! rules of `nifti1.h` (R. W. Cox et al., 2004): sform if its code is above 0, else qform (method 2), else the spacing alone (method 1).
//!
//! Values: scl_slope * stored + scl_inter, kept as f32, where the slope is finite, not 0, and the two are not 1 and 0; else the stored type.
//! Units (`xyzt_units`) are ignored: lengths are the file's numbers. A file of several volumes gives fields `volume-0`, `volume-1`, ...

use crate::error::Cause;
use crate::field::no_field;
use crate::input::{Input, Packing, finish, sized, unpack};
use crate::sample::{Layout, Pick, Scalar, read_binary};
use crate::volume::{Geometry, loaded, only_field};
use crate::{Loaded, Options};
use ::nifti::{Endianness, NiftiHeader};
use isobar_core::{DMat3, DVec3};
use std::io::Read;

const FORMAT: &str = "NIfTI-1 header";
/// `sizeof_hdr` of NIfTI-1, and the least of a file that can be one.
pub(crate) const HEADER: usize = 348;
/// `sizeof_hdr` of NIfTI-2.
const HEADER_2: i32 = 540;
/// Names of volumes offered; more would only fill a message.
const MOST_VOLUMES: u64 = 10_000;

/// What the first bytes of a file (unpacked) say it is.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Sign {
    /// Something else.
    No,
    /// NIfTI-1 in one file.
    One,
    /// NIfTI-1 or ANALYZE in two files.
    Pair,
    /// NIfTI-2.
    Two,
}

/// Looks at the header size and the magic.
pub(crate) fn sign(head: &[u8]) -> Sign {
    let Some(size) = head.first_chunk::<4>() else {
        return Sign::No;
    };
    let size = [i32::from_le_bytes(*size), i32::from_be_bytes(*size)];
    if size.contains(&HEADER_2) && head.get(4..8).is_some_and(|m| m == b"n+2\0" || m == b"ni2\0") {
        return Sign::Two;
    }
    if !size.contains(&(HEADER as i32)) {
        return Sign::No;
    }
    match head.get(344..348) {
        Some(b"n+1\0") => Sign::One,
        Some(b"ni1\0") => Sign::Pair,
        _ => Sign::No,
    }
}

/// Reads a NIfTI-1 file.
pub(crate) fn read(input: &dyn Input, packing: Packing, o: &Options) -> Result<Loaded, Cause> {
    let mut bytes = [0u8; HEADER];
    unpack(input, 0, packing)?
        .read_exact(&mut bytes)
        .map_err(|e| Cause::malformed(FORMAT, format!("its {HEADER} bytes cannot be read ({e})")))?;
    let header = NiftiHeader::from_reader(&bytes[..]).map_err(|e| Cause::malformed(FORMAT, e.to_string()))?;
    if header.sizeof_hdr != HEADER as i32 {
        return Err(Cause::malformed(
            FORMAT,
            format!("its size field is {}, not {HEADER}", header.sizeof_hdr),
        ));
    }
    let (dims, volumes) = dims(&header)?;
    let geometry = geometry(&header, dims)?;
    let n = geometry.check()?;
    let (fields, which) = volume(volumes, o)?;
    let scalar = scalar(&header)?;
    let mut notes = Vec::new();
    if i32::from(header.bitpix) != scalar.bytes() as i32 * 8 {
        notes.push(format!(
            "bitpix {} disagrees with datatype {}, which was believed",
            header.bitpix,
            scalar.name()
        ));
    }
    let layout = Layout {
        scalar,
        big_endian: header.endianness == Endianness::Big,
        components: 1,
        pick: Pick::Component(0),
        count: n,
        scale: scale(&header),
    };
    let start = offset(&header)?;
    let size = layout.bytes().ok_or(Cause::Dims(dims))?;
    let skip = size
        .checked_mul(which)
        .and_then(|s| s.checked_add(start))
        .ok_or(Cause::Dims(dims))?;
    let mut reader = sized(input, 0, packing, skip, size)?;
    let samples = read_binary(&mut *reader, &layout, &mut notes)?;
    // Later volumes are not read to verify a checksum nobody asked about.
    if which + 1 == volumes && finish(&mut *reader)? {
        notes.push("the file has more samples than its header declares; they were ignored".into());
    }
    let field = fields[usize::try_from(which).unwrap_or(0)].clone();
    loaded(geometry, samples, field, fields, notes, o)
}

/// Dimensions of a volume, and how many volumes there are.
fn dims(header: &NiftiHeader) -> Result<([u64; 3], u64), Cause> {
    let bad = || {
        Cause::malformed(
            FORMAT,
            format!("dim {:?} is not 1 to 7 axes of 1 to 32767 samples", header.dim),
        )
    };
    let axes = header.dim().map_err(|_| bad())?;
    // The field is signed in the format; the crate reads it as unsigned.
    if axes.iter().any(|&d| d > i16::MAX as u16) {
        return Err(bad());
    }
    let at = |axis: usize| axes.get(axis).map_or(1, |&d| u64::from(d));
    let volumes = (3..axes.len())
        .try_fold(1u64, |n, axis| n.checked_mul(at(axis)))
        .ok_or_else(bad)?;
    Ok(([at(0), at(1), at(2)], volumes))
}

/// The names of the volumes and the number of the one asked for.
fn volume(volumes: u64, o: &Options) -> Result<(Vec<String>, u64), Cause> {
    if volumes == 1 {
        return Ok((vec![only_field("value", o)?], 0));
    }
    if volumes > MOST_VOLUMES {
        return Err(Cause::malformed(
            FORMAT,
            format!("{volumes} volumes, at most {MOST_VOLUMES} are read"),
        ));
    }
    let names: Vec<String> = (0..volumes).map(|v| format!("volume-{v}")).collect();
    let which = match o.field.as_deref() {
        None => 0,
        Some(asked) => names
            .iter()
            .position(|n| n == asked)
            .ok_or_else(|| no_field(asked, names.iter().map(String::as_str)))?,
    };
    Ok((names, which as u64))
}

fn scalar(header: &NiftiHeader) -> Result<Scalar, Cause> {
    Ok(match header.datatype {
        2 => Scalar::U8,
        4 => Scalar::I16,
        8 => Scalar::I32,
        16 => Scalar::F32,
        64 => Scalar::F64,
        256 => Scalar::I8,
        512 => Scalar::U16,
        768 => Scalar::U32,
        1024 => Scalar::I64,
        1280 => Scalar::U64,
        other => {
            return Err(Cause::Unsupported {
                format: "NIfTI-1",
                what: format!("datatype {other}"),
                remedy: "write scalar samples of 8 to 64 bits (not colours, complex or long double)",
            });
        }
    })
}

/// Slope and intercept, where they change anything.
fn scale(header: &NiftiHeader) -> Option<(f64, f64)> {
    let slope = f64::from(header.scl_slope);
    let inter = f64::from(header.scl_inter);
    let inter = if inter.is_finite() { inter } else { 0.0 };
    // Exact: 0 means "no scaling" and 1, 0 the identity by definition.
    (slope.is_finite() && slope != 0.0 && (slope, inter) != (1.0, 0.0)).then_some((slope, inter))
}

/// Where the samples start, bytes.
fn offset(header: &NiftiHeader) -> Result<u64, Cause> {
    let v = header.vox_offset;
    // Left at 0 by some writers; the header and its four flag bytes are then meant.
    if v == 0.0 {
        return Ok(HEADER as u64 + 4);
    }
    // 2^53: past any file, and exact in f32 or not does not matter there.
    if v.is_finite() && v.fract() == 0.0 && v >= HEADER as f32 && v < 9e15 {
        return Ok(v as u64);
    }
    Err(Cause::malformed(
        FORMAT,
        format!("vox_offset {v} is not a position after the header"),
    ))
}

fn geometry(h: &NiftiHeader, dims: [u64; 3]) -> Result<Geometry, Cause> {
    if h.sform_code > 0 {
        let row = |r: [f32; 4]| r.map(f64::from);
        let (x, y, z) = (row(h.srow_x), row(h.srow_y), row(h.srow_z));
        let col = |c: usize| DVec3::new(x[c], y[c], z[c]);
        return Ok(Geometry::from_steps(dims, DMat3::from_cols(col(0), col(1), col(2)), col(3)));
    }
    // Some writers leave 0 where an axis has one sample; a real axis without spacing is refused by the grid.
    let spacing = DVec3::from_array([1, 2, 3].map(|a| match f64::from(h.pixdim[a]).abs() {
        0.0 if dims[a - 1] == 1 => 1.0,
        s => s,
    }));
    if h.qform_code <= 0 {
        return Ok(Geometry::aligned(dims, spacing, DVec3::ZERO));
    }
    let direction = rotation([h.quatern_b, h.quatern_c, h.quatern_d].map(f64::from), h.pixdim[0] < 0.0)
        .ok_or_else(|| Cause::malformed(FORMAT, "the quaternion of qform is not finite"))?;
    Ok(Geometry {
        dims,
        spacing,
        origin: DVec3::from_array([h.quatern_x, h.quatern_y, h.quatern_z].map(f64::from)),
        direction,
    })
}

/// `nifti1.h`, method 2: a = sqrt(1 - b^2 - c^2 - d^2), the vector part normalised where it is longer than 1; the third column is turned
/// round where qfac (pixdim[0]) is negative.
fn rotation([b, c, d]: [f64; 3], turned: bool) -> Option<DMat3> {
    let square = b * b + c * c + d * d;
    if !square.is_finite() {
        return None;
    }
    // Below f32 rounding of a half turn, a is noise.
    let (a, b, c, d) = if 1.0 - square < 1e-7 {
        let s = square.sqrt();
        (0.0, b / s, c / s, d / s)
    } else {
        ((1.0 - square).sqrt(), b, c, d)
    };
    let x = DVec3::new(a * a + b * b - c * c - d * d, 2.0 * (b * c + a * d), 2.0 * (b * d - a * c));
    let y = DVec3::new(2.0 * (b * c - a * d), a * a + c * c - b * b - d * d, 2.0 * (c * d + a * b));
    let z = DVec3::new(2.0 * (b * d + a * c), 2.0 * (c * d - a * b), a * a + d * d - b * b - c * c);
    let z = if turned { -z } else { z };
    // a^2 + b^2 + c^2 + d^2 is 1 up to rounding; -0 + 0 would print as -0.
    Some(DMat3::from_cols(x.normalize(), y.normalize(), z.normalize()) + DMat3::ZERO)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quaternions_turn_as_the_format_says() {
        assert_eq!(rotation([0.0; 3], false), Some(DMat3::IDENTITY));
        assert_eq!(rotation([0.0; 3], true).unwrap().z_axis, DVec3::NEG_Z);
        // Half a turn about z, the common radiological header.
        let r = rotation([0.0, 0.0, 1.0], false).unwrap();
        assert_eq!((r.x_axis, r.y_axis, r.z_axis), (DVec3::NEG_X, DVec3::NEG_Y, DVec3::Z));
        // A quarter about x: y goes to z.
        let h = 0.5f64.sqrt();
        let r = rotation([h, 0.0, 0.0], false).unwrap();
        assert!((r.y_axis - DVec3::Z).length() < 1e-12 && (r.z_axis - DVec3::NEG_Y).length() < 1e-12);
        assert!(rotation([f64::NAN, 0.0, 0.0], false).is_none());
        assert!(rotation([f64::MAX, 0.0, 0.0], false).is_none());
    }
}
