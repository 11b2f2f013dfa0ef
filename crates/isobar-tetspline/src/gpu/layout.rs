//! Structures shared with `shaders/tet_layout.wgsl` and `shaders/tet_draw_layout.wgsl`; a test compares them with what naga makes of the WGSL.

use bytemuck::{Pod, Zeroable};
use std::mem::offset_of;

/// `Params`: the grid and the lists of one chunk and part.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Params {
    pub(super) dims: [u32; 3],
    pub(super) levels: u32,
    pub(super) first: u32,
    pub(super) count: u32,
    pub(super) room_cubes: u32,
    pub(super) room_tets: u32,
    pub(super) bias: [f32; 2],
    pub(super) slots: u32,
    pub(super) blocks: u32,
}

/// `Level`.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Level {
    pub(super) value: f32,
    pub(super) surface: u32,
}

/// Planes `View` has room for: the six faces of the domain, and clipping planes.
pub(super) const PLANES: usize = 14;

/// `View`.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct View {
    pub(super) clip: [[f32; 4]; 4],
    pub(super) origin: [i32; 3],
    pub(super) width: u32,
    pub(super) eye: [f32; 3],
    pub(super) parallel: u32,
    /// Columns, each padded to four.
    pub(super) axes: [[f32; 4]; 3],
    /// Columns, each padded to four.
    pub(super) gradients: [[f32; 4]; 3],
    pub(super) grow: f32,
    pub(super) peel: u32,
    pub(super) planes: u32,
    pub(super) depth_scale: f32,
    pub(super) plane: [[f32; 4]; PLANES],
    pub(super) along: [f32; 4],
}

/// Bits of the second word of a hit: below these the whole half voxels, and from bit 16 the surface.
pub(super) const HIT: u32 = 1 << 24;
/// The first word is a distance in the world.
pub(super) const WORLD: u32 = 1 << 26;

/// A hit as the target holds it.
pub(super) type Texel = [u32; 4];

const _: () = {
    assert!(size_of::<Params>() == 48 && offset_of!(Params, bias) == 32);
    assert!(size_of::<Level>() == 8 && size_of::<View>() == 448);
    assert!(offset_of!(View, origin) == 64 && offset_of!(View, axes) == 96 && offset_of!(View, grow) == 192);
    assert!(offset_of!(View, plane) == 208 && offset_of!(View, along) == 432);
};

/// The unit normal of a hit: the inverse of `packed` in `tet_fragment.wgsl`; zero where the gradient vanishes.
pub(super) fn normal([x, y]: [u32; 2]) -> [f32; 3] {
    let (x, y) = (f32::from_bits(x), f32::from_bits(y));
    if x.is_nan() {
        return [0.0; 3];
    }
    let z = 1.0 - x.abs() - y.abs();
    let (x, y) = if z < 0.0 {
        ((1.0 - y.abs()).copysign(x), (1.0 - x.abs()).copysign(y))
    } else {
        (x, y)
    };
    let n = glam::Vec3::new(x, y, z);
    n.normalize_or(glam::Vec3::ZERO).to_array()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::programs;
    use isobar_gpu::{shader, wgpu::naga};

    /// Size and member offsets of a structure as naga lays it out.
    fn wgsl(name: &str) -> (u32, Vec<(String, u32)>) {
        let names = ["volume_f32", "tet_layout", "tet_draw_layout"];
        let source = shader::compose(&[programs::SNIPPETS, shader::SHARED], &names).unwrap();
        let module = naga::front::wgsl::parse_str(&source).unwrap();
        let (_, found) = module.types.iter().find(|(_, t)| t.name.as_deref() == Some(name)).unwrap();
        match &found.inner {
            naga::TypeInner::Struct { members, span } => {
                let members = members.iter().map(|m| (m.name.clone().unwrap(), m.offset)).collect();
                (*span, members)
            }
            other => panic!("{name}: {other:?}"),
        }
    }

    #[test]
    fn structures_are_laid_out_as_in_wgsl() {
        let of = |name: &str, size: usize, want: &[(&str, usize)]| {
            let (span, members) = wgsl(name);
            assert_eq!(span as usize, size, "{name}");
            for (member, offset) in want {
                let found = members.iter().find(|(m, _)| m == member).unwrap();
                assert_eq!(found.1 as usize, *offset, "{name}.{member}");
            }
        };
        of(
            "Params",
            size_of::<Params>(),
            &[("levels", 12), ("first", 16), ("bias_hi", 32), ("blocks", 44)],
        );
        of("Level", size_of::<Level>(), &[("surface", 4)]);
        of(
            "View",
            size_of::<View>(),
            &[
                ("origin", offset_of!(View, origin)),
                ("width", offset_of!(View, width)),
                ("eye", offset_of!(View, eye)),
                ("parallel", offset_of!(View, parallel)),
                ("axes", offset_of!(View, axes)),
                ("gradients", offset_of!(View, gradients)),
                ("grow", offset_of!(View, grow)),
                ("depth_scale", offset_of!(View, depth_scale)),
                ("plane", offset_of!(View, plane)),
                ("along", offset_of!(View, along)),
            ],
        );
    }

    #[test]
    fn normals_come_back() {
        for n in [[0.0f32, 0.0, -1.0], [0.6, -0.8, 0.0], [-0.36, 0.48, -0.8], [0.48, 0.36, 0.8]] {
            // What the shader does.
            let m = n.map(|v| v / (n[0].abs() + n[1].abs() + n[2].abs()));
            let sign = |v: f32| if v >= 0.0 { 1.0 } else { -1.0 };
            let p = if n[2] < 0.0 {
                [(1.0 - m[1].abs()) * sign(m[0]), (1.0 - m[0].abs()) * sign(m[1])]
            } else {
                [m[0], m[1]]
            };
            let back = normal(p.map(f32::to_bits));
            assert!((0..3).all(|a| (back[a] - n[a]).abs() < 2e-7), "{back:?} {n:?}");
        }
        assert_eq!(normal([f32::NAN.to_bits(), 0]), [0.0; 3]);
    }
}
