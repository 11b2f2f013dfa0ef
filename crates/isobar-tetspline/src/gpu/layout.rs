//! Structures shared with `shaders/tet_layout.wgsl` and `shaders/tet_draw_layout.wgsl`; a test compares them with what naga makes of the WGSL.

use crate::paint::{Coat, Paint};
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
    pub(super) unit: f32,
    pub(super) reach: f32,
    /// Bits of the paint: see [`paint_bits`].
    pub(super) paint: u32,
    pub(super) pad: u32,
}

/// The bits of [`View::paint`].
pub(super) fn paint_bits(paint: Paint) -> u32 {
    u32::from(paint.marble) | u32::from(paint.curves) << 1
}

/// Bits of the second word of a hit: below these the whole half voxels, and from bit 16 the surface.
pub(super) const HIT: u32 = 1 << 24;
/// The first word is a distance in the world.
pub(super) const WORLD: u32 = 1 << 26;
/// The hit lies on a curve.
const CURVE: u32 = 1 << 27;

/// A hit as the target holds it.
pub(super) type Texel = [u32; 4];

const _: () = {
    assert!(size_of::<Params>() == 48 && offset_of!(Params, bias) == 32);
    assert!(size_of::<Level>() == 8 && size_of::<View>() == 464);
    assert!(offset_of!(View, origin) == 64 && offset_of!(View, axes) == 96 && offset_of!(View, grow) == 192);
    assert!(offset_of!(View, plane) == 208 && offset_of!(View, along) == 432 && offset_of!(View, paint) == 456);
};

/// Greatest of the 24-bit numbers of a normal.
const GREATEST: i32 = (1 << 23) - 1;

/// The unit normal of a hit: the inverse of `packed` in `tet_fragment.wgsl`, to 1e-7 each way; zero where the gradient vanishes.
pub(super) fn normal(words: [u32; 2]) -> [f32; 3] {
    let [x, y] = words.map(|w| w.cast_signed() >> 8);
    if x < -GREATEST {
        return [0.0; 3];
    }
    let [x, y] = [x, y].map(|v| f64::from(v) / f64::from(GREATEST));
    let z = 1.0 - x.abs() - y.abs();
    let (x, y) = if z < 0.0 {
        ((1.0 - y.abs()).copysign(x), (1.0 - x.abs()).copysign(y))
    } else {
        (x, y)
    };
    let n = glam::DVec3::new(x, y, z);
    n.normalize_or(glam::DVec3::ZERO).as_vec3().to_array()
}

/// The coat that the paint gave a hit.
pub(super) fn coat(h: &Texel) -> Coat {
    Coat {
        bright: f64::from((h[2] & 0xff) | (h[3] & 0xff) << 8) / 65_535.0,
        curve: h[1] & CURVE != 0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::programs;
    use isobar_gpu::{assert_laid_out, shader};

    #[test]
    fn structures_are_laid_out_as_in_wgsl() {
        let names = ["volume_f32", "tet_layout", "tet_draw_layout"];
        let source = &shader::compose(&[programs::SNIPPETS, shader::SHARED], &names).unwrap();
        assert_laid_out!(source, Params { levels, first, bias as "bias_hi", blocks });
        assert_laid_out!(source, Level { surface });
        assert_laid_out!(
            source,
            View {
                origin,
                width,
                eye,
                parallel,
                axes,
                gradients,
                grow,
                depth_scale,
                plane,
                along,
                unit,
                reach,
                paint
            }
        );
    }

    #[test]
    fn normals_come_back_beside_the_paint() {
        for n in [[0.0f32, 0.0, -1.0], [0.6, -0.8, 0.0], [-0.36, 0.48, -0.8], [0.48, 0.36, 0.8]] {
            // What the shader does.
            let m = n.map(|v| v / (n[0].abs() + n[1].abs() + n[2].abs()));
            let sign = |v: f32| if v >= 0.0 { 1.0 } else { -1.0 };
            let p = if n[2] < 0.0 {
                [(1.0 - m[1].abs()) * sign(m[0]), (1.0 - m[0].abs()) * sign(m[1])]
            } else {
                [m[0], m[1]]
            };
            let [x, y] = p.map(|v| ((v * GREATEST as f32).round() as i32).cast_unsigned() << 8);
            for (paint, curve) in [(0u32, false), (65_535, true), (0x1234, false)] {
                let h = [0, u32::from(curve) << 27, x | (paint & 0xff), y | paint >> 8];
                let back = normal([h[2], h[3]]);
                // Half a step of 2^-23 in two numbers, and the rounding of f32 before and behind.
                assert!((0..3).all(|a| (back[a] - n[a]).abs() < 3e-7), "{back:?} {n:?}");
                assert_eq!(
                    coat(&h),
                    Coat {
                        bright: f64::from(paint) / 65_535.0,
                        curve
                    }
                );
            }
        }
        assert_eq!(normal([0x8000_0000, 0]), [0.0; 3]);
    }
}
