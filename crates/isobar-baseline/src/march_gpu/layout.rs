//! Structures shared with `shaders/march_layout.wgsl`; a test compares them with what naga makes of the WGSL.

use bytemuck::{Pod, Zeroable};
use std::mem::offset_of;

/// `Params`: one uniform for all kernels.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Params {
    pub(super) last: [f32; 3],
    pub(super) step: f32,
    pub(super) bias_hi: f32,
    pub(super) bias_lo: f32,
    pub(super) fractions: f32,
    pub(super) bisections: u32,
    pub(super) fine: [u32; 3],
    pub(super) fine_side: u32,
    pub(super) coarse: [u32; 3],
    pub(super) coarse_side: u32,
    pub(super) levels: u32,
    pub(super) layers: u32,
    pub(super) flags: u32,
    pub(super) pad: u32,
    pub(super) width: u32,
    pub(super) unused: [u32; 3],
    /// Columns, each padded to four.
    pub(super) axes: [[f32; 4]; 3],
    /// Columns, each padded to four.
    pub(super) gradients: [[f32; 4]; 3],
}

/// Bits of [`Params::flags`].
pub(super) const SKIP: u32 = 1;
/// All hits are counted: the search goes on to the exit.
pub(super) const COUNT_ALL: u32 = 2;
/// Colour is asked for.
pub(super) const COLOUR: u32 = 4;
/// Normals are asked for.
pub(super) const NORMALS: u32 = 8;

/// `Ray`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Ray {
    pub(super) origin: [f32; 3],
    pub(super) length: f32,
    pub(super) direction: [f32; 3],
    pub(super) unused: f32,
}

/// `Level`.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Level {
    pub(super) value: f32,
    pub(super) opacity: f32,
    pub(super) surface: u32,
    pub(super) unused: u32,
    pub(super) colour: [f32; 3],
    pub(super) unused_1: f32,
}

/// `Hit`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Hit {
    pub(super) u: f32,
    pub(super) surface: u32,
    pub(super) normal: [f32; 3],
}

/// `Pixel`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Pixel {
    pub(super) rgba: [f32; 4],
    pub(super) hits: u32,
    pub(super) work: u32,
}

const _: () = {
    assert!(size_of::<Params>() == 192);
    assert!(offset_of!(Params, step) == 12 && offset_of!(Params, bisections) == 28);
    assert!(offset_of!(Params, fine) == 32 && offset_of!(Params, coarse) == 48);
    assert!(offset_of!(Params, levels) == 64 && offset_of!(Params, width) == 80);
    assert!(offset_of!(Params, axes) == 96 && offset_of!(Params, gradients) == 144);
    assert!(size_of::<Ray>() == 32 && offset_of!(Ray, length) == 12 && offset_of!(Ray, direction) == 16);
    assert!(size_of::<Level>() == 32 && offset_of!(Level, surface) == 8 && offset_of!(Level, colour) == 16);
    assert!(size_of::<Hit>() == 20 && offset_of!(Hit, normal) == 8);
    assert!(size_of::<Pixel>() == 24 && offset_of!(Pixel, hits) == 16 && offset_of!(Pixel, work) == 20);
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::march_gpu::programs;
    use isobar_gpu::{shader, wgpu::naga};

    /// Name, size and member offsets of a structure as naga lays it out.
    fn wgsl(name: &str) -> (u32, Vec<(String, u32)>) {
        let source = shader::compose(&[programs::SNIPPETS], &["march_layout"]).unwrap();
        let module = naga::front::wgsl::parse_str(&source).unwrap();
        let (_, found) = module.types.iter().find(|(_, t)| t.name.as_deref() == Some(name)).unwrap();
        match &found.inner {
            naga::TypeInner::Struct { members, span } => {
                let members = members.iter().map(|m| (m.name.clone().unwrap(), m.offset)).collect();
                (*span, members)
            }
            other => panic!("{name} is {other:?}"),
        }
    }

    macro_rules! same {
        ($t:ident { $($rust:ident as $wgsl:literal),* $(,)? }) => {{
            let (span, members) = wgsl(stringify!($t));
            assert_eq!(span as usize, size_of::<$t>(), stringify!($t));
            $(
                let at = members.iter().find(|(n, _)| n == $wgsl).map(|(_, at)| *at as usize);
                assert_eq!(at, Some(offset_of!($t, $rust)), "{}.{}", stringify!($t), $wgsl);
            )*
        }};
    }

    #[test]
    fn structures_are_laid_out_as_in_wgsl() {
        same!(Params { last as "last", step as "step", bias_hi as "bias_hi", bias_lo as "bias_lo", fractions as "fractions",
            bisections as "bisections", fine as "fine", fine_side as "fine_side", coarse as "coarse", coarse_side as "coarse_side",
            levels as "levels", layers as "layers", flags as "flags", pad as "pad", width as "width", axes as "axes",
            gradients as "gradients" });
        same!(Ray { origin as "origin", length as "length", direction as "direction" });
        same!(Level { value as "value", opacity as "opacity", surface as "surface", colour as "colour" });
        same!(Hit { u as "u", surface as "surface", normal as "normal_x" });
        same!(Pixel { rgba as "red", hits as "hits", work as "work" });
    }

    #[test]
    fn flags_are_those_of_wgsl() {
        let (_, text) = programs::SNIPPETS.iter().find(|(n, _)| *n == "march_layout").unwrap();
        for (name, bit) in [
            ("SKIP", SKIP),
            ("COUNT_ALL", COUNT_ALL),
            ("COLOUR", COLOUR),
            ("NORMALS", NORMALS),
        ] {
            assert!(text.contains(&format!("const {name}: u32 = {bit}u;")), "{name}");
        }
    }
}
