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
/// - `shade`: `fn shade(colour, normal, direction) -> vec3<f32>`, the twin of `isobar_core::shade`, and `fn over(front, back)`;
/// - `unit`: `fn unit(v: vec3<f32>) -> vec3<f32>`, zero for zero;
/// - `bands`: `struct Level` and `struct Pixel`, as [`crate::levels::Level`] and [`crate::bands::Pixel`]; `hit`: `struct Hit`, as [`crate::bands::Hit`];
/// - `coefficient`: `fn coefficient(p: vec3<i32>) -> f32`, a texel less the bias, of a uniform `params` with `bias_hi` and `bias_lo`;
/// - `trilinear`, `quadratic`, and `cubic` after `cubic_weights` (or other `weights` and `slopes`): `fn value(u: vec3<f32>) -> f32` and
///   `fn gradient(u: vec3<f32>) -> vec3<f32>` in index space, from `coefficient` and `params.last`, the index of the last sample. Above degree 1 the texture
///   has one texel more on every side.
pub const SHARED: Snippets = &[
    ("volume_f32", include_str!("../shaders/volume_f32.wgsl")),
    ("volume_u32", include_str!("../shaders/volume_u32.wgsl")),
    ("volume_i32", include_str!("../shaders/volume_i32.wgsl")),
    ("fixed_ray", include_str!("../shaders/fixed_ray.wgsl")),
    ("shade", include_str!("../shaders/shade.wgsl")),
    ("unit", include_str!("../shaders/unit.wgsl")),
    ("bands", include_str!("../shaders/bands.wgsl")),
    ("hit", include_str!("../shaders/hit.wgsl")),
    ("coefficient", include_str!("../shaders/coefficient.wgsl")),
    ("trilinear", include_str!("../shaders/trilinear.wgsl")),
    ("quadratic", include_str!("../shaders/quadratic.wgsl")),
    ("cubic_weights", include_str!("../shaders/cubic_weights.wgsl")),
    ("cubic", include_str!("../shaders/cubic.wgsl")),
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
        const PARAMS: &[(&str, &str)] = &[(
            "params",
            "struct Params { last: vec3<f32>, bias_hi: f32, bias_lo: f32 }
            @group(0) @binding(1) var<uniform> params: Params;",
        )];
        for (name, _) in SHARED {
            let names: &[&str] = match *name {
                "coefficient" => &["params", "volume_f32", "coefficient"],
                "trilinear" => &["params", "volume_u32", "coefficient", "trilinear"],
                "quadratic" => &["params", "volume_i32", "coefficient", "quadratic"],
                "cubic" => &["params", "volume_f32", "coefficient", "cubic_weights", "cubic"],
                _ => &[name],
            };
            let source = compose(&[PARAMS, SHARED], names).unwrap();
            validate(name, &source).unwrap();
        }
    }

    #[test]
    fn structures_are_laid_out_as_in_wgsl() {
        use crate::bands::{Hit, Pixel};
        use crate::levels::Level;
        use crate::testing::laid_out;
        use std::mem::offset_of;
        let of = |snippet: &str, name: &str, size: usize, offsets: &[usize]| {
            let (span, found) = laid_out(&compose(&[SHARED], &[snippet]).unwrap(), name);
            let found: Vec<usize> = found.into_iter().map(|(_, at)| at).collect();
            assert_eq!((span, found.as_slice()), (size, offsets), "{name}");
        };
        let level = [
            offset_of!(Level, value),
            offset_of!(Level, opacity),
            offset_of!(Level, surface),
            offset_of!(Level, unused),
            offset_of!(Level, colour),
            offset_of!(Level, unused_1),
        ];
        of("bands", "Level", size_of::<Level>(), &level);
        let rgba = offset_of!(Pixel, rgba);
        let pixel = [
            rgba,
            rgba + 4,
            rgba + 8,
            rgba + 12,
            offset_of!(Pixel, hits),
            offset_of!(Pixel, work),
        ];
        of("bands", "Pixel", size_of::<Pixel>(), &pixel);
        let normal = offset_of!(Hit, normal);
        let hit = [offset_of!(Hit, u), offset_of!(Hit, surface), normal, normal + 4, normal + 8];
        of("hit", "Hit", size_of::<Hit>(), &hit);
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
