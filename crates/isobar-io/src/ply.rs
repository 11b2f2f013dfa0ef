//! PLY (Stanford polygon files), ASCII and binary of both byte orders, by the crate `ply-rs-bw` 4.0 (July 2026; it caps what it allocates for a
//! declared count).
//!
//! Read: x, y, z of element `vertex`, the list `vertex_indices` or `vertex_index` of `face`; all else is skipped. Counts are
//! checked against the file's length before the payload is read.

use crate::error::{Cause, one_line};
use crate::input::Input;
use crate::mesh::TriangleMesh;
use isobar_core::DVec3;
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{ElementDef, Encoding, Property, PropertyAccess, PropertyAccessResult, PropertyType, ScalarType};

const FORMAT: &str = "PLY file";

/// Reads a PLY file.
pub(crate) fn read(input: &dyn Input) -> Result<TriangleMesh, Cause> {
    let bad = |e: ply_rs_bw::parser::ParseError| Cause::malformed(FORMAT, one_line(&e.to_string(), 160));
    let mut reader = Reader::new(input.open(0)?);
    let header = Parser::<Skipped>::new().read_header(&mut reader).map_err(bad)?;
    let ascii = header.encoding == Encoding::Ascii;
    let mut need = 0u64;
    for element in header.elements.values() {
        need = need.saturating_add((element.count as u64).saturating_mul(least(element, ascii)?));
    }
    if need > input.len() {
        return Err(Cause::TooShort {
            declared: need,
            possible: input.len(),
        });
    }
    let mut points: Option<Vec<DVec3>> = None;
    let mut faces: Option<Vec<Face>> = None;
    for (name, element) in &header.elements {
        match name.as_str() {
            "vertex" => {
                let all = Parser::<Vertex>::new()
                    .read_payload_for_element(&mut reader, element, &header)
                    .map_err(bad)?;
                points = Some(all.into_iter().map(|v| v.0).collect());
            }
            "face" => {
                let all = Parser::<Face>::new()
                    .read_payload_for_element(&mut reader, element, &header)
                    .map_err(bad)?;
                faces = Some(all);
            }
            _ => {
                Parser::<Skipped>::new()
                    .read_payload_for_element(&mut reader, element, &header)
                    .map_err(bad)?;
            }
        }
    }
    let missing = |what: &str| Cause::malformed(FORMAT, format!("there is no element {what:?}"));
    let mut mesh = TriangleMesh {
        points: points.ok_or_else(|| missing("vertex"))?,
        triangles: Vec::new(),
    };
    if let Some(p) = mesh.points.iter().find(|p| !p.is_finite()) {
        return Err(Cause::malformed(
            FORMAT,
            format!("a vertex is {p}, without finite x, y and z"),
        ));
    }
    for face in faces.ok_or_else(|| missing("face"))? {
        let corners = face
            .0
            .ok_or_else(|| Cause::malformed(FORMAT, "a face has no list vertex_indices of whole numbers"))?;
        mesh.polygon(&corners, FORMAT)?;
    }
    Ok(mesh)
}

/// The fewest bytes an element can take.
fn least(element: &ElementDef, ascii: bool) -> Result<u64, Cause> {
    if element.properties.is_empty() && element.count > 0 {
        return Err(Cause::malformed(
            FORMAT,
            format!("element {:?} has no properties", one_line(&element.name, 40)),
        ));
    }
    let size = |s: &ScalarType| match s {
        ScalarType::Char | ScalarType::UChar => 1,
        ScalarType::Short | ScalarType::UShort => 2,
        ScalarType::Int | ScalarType::UInt | ScalarType::Float => 4,
        ScalarType::Double => 8,
    };
    Ok(element
        .properties
        .values()
        .map(|p| match &p.data_type {
            // A digit and a separator; the last line may lack its end, which is less than the header takes.
            _ if ascii => 2,
            PropertyType::Scalar(s) => size(s),
            PropertyType::List(count, _) => size(count),
        })
        .sum())
}

/// An element nobody asked for.
struct Skipped;

impl PropertyAccess for Skipped {
    fn new() -> Self {
        Self
    }
}

/// A position; NaN where a coordinate is missing.
struct Vertex(DVec3);

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self(DVec3::NAN)
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        let axis = match name {
            "x" => 0,
            "y" => 1,
            "z" => 2,
            _ => return PropertyAccessResult::Ignored,
        };
        self.0[axis] = match property {
            Property::Char(v) => v.into(),
            Property::UChar(v) => v.into(),
            Property::Short(v) => v.into(),
            Property::UShort(v) => v.into(),
            Property::Int(v) => v.into(),
            Property::UInt(v) => v.into(),
            Property::Float(v) => v.into(),
            Property::Double(v) => v,
            _ => return PropertyAccessResult::UnsupportedType,
        };
        PropertyAccessResult::Set
    }
}

/// Corners; `None` where there is no usable list.
struct Face(Option<Vec<u32>>);

impl PropertyAccess for Face {
    fn new() -> Self {
        Self(None)
    }

    fn set_property(&mut self, name: &str, property: Property) -> PropertyAccessResult {
        if !matches!(name, "vertex_indices" | "vertex_index") {
            return PropertyAccessResult::Ignored;
        }
        let corners = match property {
            Property::ListUInt(v) => Some(v),
            other => other.to_u32_list(),
        };
        let result = if corners.is_some() {
            PropertyAccessResult::Set
        } else {
            PropertyAccessResult::UnsupportedType
        };
        self.0 = corners;
        result
    }
}
