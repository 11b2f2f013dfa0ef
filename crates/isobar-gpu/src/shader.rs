//! WGSL from named snippets, and its validation.
//!
//! A module is the concatenation of snippets by name: no preprocessor, no import resolution. Each crate keeps its snippets in a
//! `&[(name, text)]` table filled by `include_str!`; [`SHARED`] is the table of this crate.

use crate::GpuError;
use crate::error::one_line;
use wgpu::naga;

/// A table of named snippets.
pub type Snippets = &'static [(&'static str, &'static str)];

/// Snippets every method may use:
///
/// - `volume_f32`, `volume_u32`, `volume_i32`: declare the 3D texture `volume` at group 0, binding 0, and
///   `fn texel(p: vec3<i32>) -> f32`, one sample, exactly;
/// - `fixed_ray`: `struct FixedRay`, as [`crate::rays::FixedRay`], and its points and direction in f32 about any cell;
/// - `shade`: `fn shade(colour, normal, direction) -> vec3<f32>`, the twin of `isobar_core::shade`, and `fn over(front, back)`.
pub const SHARED: Snippets = &[
    ("volume_f32", include_str!("../shaders/volume_f32.wgsl")),
    ("volume_u32", include_str!("../shaders/volume_u32.wgsl")),
    ("volume_i32", include_str!("../shaders/volume_i32.wgsl")),
    ("fixed_ray", include_str!("../shaders/fixed_ray.wgsl")),
    ("shade", include_str!("../shaders/shade.wgsl")),
];

/// Joins the snippets `names`, in order, looked up in `tables`, the first table first.
///
/// # Errors
/// [`GpuError::Refused`] names a snippet that no table has.
pub fn compose(tables: &[&[(&str, &str)]], names: &[&str]) -> Result<String, GpuError> {
    let mut out = String::new();
    for name in names {
        let found = tables.iter().flat_map(|t| t.iter()).find(|(n, _)| n == name);
        let (_, text) = found.ok_or_else(|| GpuError::Refused {
            what: "composing a shader".into(),
            reason: format!("there is no snippet {name}"),
        })?;
        out.push_str("// ");
        out.push_str(name);
        out.push('\n');
        out.push_str(text);
        out.push('\n');
    }
    Ok(out)
}

/// Parses and validates a module without any optional capability, so that what passes runs on every WebGPU device. Needs no adapter.
///
/// # Errors
/// [`GpuError::Refused`] with the place and the reason.
pub fn validate(what: &str, source: &str) -> Result<(), GpuError> {
    let refused = |reason: String| GpuError::Refused {
        what: what.to_owned(),
        reason: one_line(&reason),
    };
    let module = naga::front::wgsl::parse_str(source).map_err(|e| refused(e.emit_to_string(source)))?;
    naga::valid::Validator::new(naga::valid::ValidationFlags::all(), naga::valid::Capabilities::empty())
        .validate(&module)
        .map(|_| ())
        .map_err(|e| refused(e.emit_to_string(source)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shared_snippets_are_portable() {
        for (name, _) in SHARED {
            let source = compose(&[SHARED], &[name]).unwrap();
            validate(name, &source).unwrap();
        }
    }

    #[test]
    fn what_is_not_portable_or_not_there_is_refused() {
        let e = validate(
            "f64",
            "@compute @workgroup_size(1) fn main() { var x: f64 = 1.0lf; x += 1.0lf; }",
        )
        .unwrap_err();
        assert!(e.to_string().starts_with("f64: "), "{e}");
        assert!(validate("broken", "fn main( {").is_err());
        assert!(
            compose(&[SHARED], &["shade", "nothing"])
                .unwrap_err()
                .to_string()
                .contains("nothing")
        );
        // The first table wins.
        let text = compose(&[&[("shade", "A")], SHARED], &["shade"]).unwrap();
        assert_eq!(text, "// shade\nA\n");
    }
}
