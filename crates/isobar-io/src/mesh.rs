//! Triangle meshes: what a mesh file becomes, and which reader takes it.

use crate::error::{Cause, quoted};
use crate::input::{Input, Packing, head};
use crate::{off, ply};
use isobar_core::DVec3;

/// Triangles with shared points. Polygons of the file are fans of triangles about their first corner.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TriangleMesh {
    /// World positions, finite.
    pub points: Vec<DVec3>,
    /// Three point indices each, in the order of the file (counter-clockwise from outside by custom). Degenerate ones are kept.
    pub triangles: Vec<[u32; 3]>,
}

impl TriangleMesh {
    /// Adds a polygon as a fan; fewer than three corners add nothing.
    pub(crate) fn polygon(&mut self, corners: &[u32], format: &'static str) -> Result<(), Cause> {
        if let Some(bad) = corners.iter().find(|&&i| i as usize >= self.points.len()) {
            return Err(Cause::malformed(
                format,
                format!("a face names point {bad}, there are {}", self.points.len()),
            ));
        }
        if let [first, rest @ ..] = corners {
            self.triangles.extend(rest.windows(2).map(|pair| [*first, pair[0], pair[1]]));
        }
        Ok(())
    }
}

/// Whether the first bytes are those of a mesh file, and which.
pub(crate) fn sign(head: &[u8]) -> Option<&'static str> {
    if head.starts_with(b"ply\n") || head.starts_with(b"ply\r") || head.starts_with(b"ply ") {
        return Some("PLY");
    }
    let first = head.split(|b| b.is_ascii_whitespace()).next().unwrap_or_default();
    (first.ends_with(b"OFF") && first.len() <= 7).then_some("OFF")
}

/// Reads a mesh by its first bytes.
pub(crate) fn read(input: &dyn Input) -> Result<TriangleMesh, Cause> {
    let (bytes, packing) = head(input, 64)?;
    if packing == Packing::Gzip && sign(&bytes).is_some() {
        return Err(Cause::Unsupported {
            format: "a mesh",
            what: "the whole file in gzip".into(),
            remedy: "unpack it with gunzip first",
        });
    }
    let mesh = match sign(&bytes) {
        Some("PLY") => ply::read(input)?,
        Some(_) => off::read(input)?,
        None => return Err(Cause::NotMesh),
    };
    if mesh.triangles.is_empty() {
        return Err(Cause::malformed("mesh", "it has no triangles"));
    }
    Ok(mesh)
}

/// A point of three finite numbers.
pub(crate) fn point(words: [&str; 3], format: &'static str) -> Result<DVec3, Cause> {
    let mut p = DVec3::NAN;
    for (axis, word) in words.iter().enumerate() {
        p[axis] = word.parse().unwrap_or(f64::NAN);
    }
    if p.is_finite() {
        Ok(p)
    } else {
        Err(Cause::malformed(
            format,
            format!("{} is not a point", quoted(&words.join(" "))),
        ))
    }
}
