//! Structures shared with `shaders/octree_layout.wgsl`; a test compares them with what naga makes of the WGSL.

use bytemuck::{Pod, Zeroable};
use isobar_gpu::bands::DeviceHit;
use std::mem::offset_of;

/// `Params`: one uniform for all kernels.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Params {
    pub(super) cells: [u32; 3],
    pub(super) flags: u32,
    pub(super) nodes: [u32; 3],
    pub(super) levels: u32,
    pub(super) last: [i32; 3],
    pub(super) layers: u32,
    pub(super) bias_hi: f32,
    pub(super) bias_lo: f32,
    pub(super) width: u32,
    pub(super) bricks: u32,
    /// Columns, each padded to four.
    pub(super) axes: [[f32; 4]; 3],
    /// Columns, each padded to four.
    pub(super) gradients: [[f32; 4]; 3],
}

/// All hits are counted: the search goes on to the exit.
pub(super) const COUNT_ALL: u32 = 1;
/// Colour is asked for.
pub(super) const COLOUR: u32 = 2;
/// Normals are asked for.
pub(super) const NORMALS: u32 = 4;
/// Coefficients outside the grid are mirrored, not clamped.
pub(super) const MIRROR: u32 = 8;

/// `Ray`.
pub(super) use isobar_gpu::rays::FixedRay as Ray;

/// `Node`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Node {
    pub(super) lo: u32,
    pub(super) hi: u32,
    pub(super) first: u32,
    pub(super) unused: u32,
}

/// `Hit`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Hit {
    pub(super) whole: u32,
    pub(super) u: f32,
    pub(super) surface: u32,
    pub(super) normal: [f32; 3],
}

impl DeviceHit for Hit {
    fn along(&self) -> f64 {
        f64::from(self.whole) + f64::from(self.u)
    }

    fn surface(&self) -> u32 {
        self.surface
    }

    fn normal(&self) -> [f32; 3] {
        self.normal
    }
}

const _: () = {
    assert!(size_of::<Params>() == 160);
    assert!(offset_of!(Params, bias_hi) == 48 && offset_of!(Params, axes) == 64);
    assert!(size_of::<Ray>() == 48 && size_of::<Node>() == 16 && size_of::<Hit>() == 24);
};

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::programs;
    use isobar_gpu::testing::assert_bits;
    use isobar_gpu::{assert_laid_out, shader};

    #[test]
    fn structures_are_laid_out_as_in_wgsl() {
        let source = &shader::compose(&[programs::SNIPPETS, shader::SHARED], &["volume_f32", "octree_layout"]).unwrap();
        assert_laid_out!(
            source,
            Params {
                cells,
                flags,
                nodes,
                levels,
                last,
                layers,
                bias_hi,
                bias_lo,
                width,
                bricks,
                axes,
                gradients
            }
        );
        assert_laid_out!(
            source,
            Ray {
                cell,
                length,
                fraction,
                rest,
                direction,
                fine
            }
        );
        assert_laid_out!(source, Node { lo, hi, first });
        assert_laid_out!(source, Hit { whole, u, surface, normal as "normal_x" });
    }

    #[test]
    fn flags_are_those_of_wgsl() {
        let (_, text) = programs::SNIPPETS.iter().find(|(n, _)| *n == "octree_layout").unwrap();
        let bits = [
            ("COUNT_ALL", COUNT_ALL),
            ("COLOUR", COLOUR),
            ("NORMALS", NORMALS),
            ("MIRROR", MIRROR),
        ];
        assert_bits(text, &bits);
    }
}
