//! The one shading of all methods: two-sided Lambert with the light at the eye and 0.15 ambient; linear colours.

use glam::{DVec3, Vec3};

/// Ambient part of the one shading.
const AMBIENT: f32 = 0.15;

/// Linear RGB of a surface: `colour * (0.15 + 0.85 |n . d|)`, n the unit normal and d the ray's direction (any length). A zero normal
/// gives the ambient part only.
#[must_use]
#[inline]
pub fn shade(colour: [f32; 3], normal: [f32; 3], direction: DVec3) -> [f32; 3] {
    let d = direction.as_vec3().normalize_or_zero();
    let k = AMBIENT + (1.0 - AMBIENT) * Vec3::from_array(normal).dot(d).abs().min(1.0);
    colour.map(|c| c * k)
}

/// `front` over `back`, both linear and premultiplied.
#[must_use]
#[inline]
pub fn over(front: [f32; 4], back: [f32; 4]) -> [f32; 4] {
    let k = 1.0 - front[3];
    std::array::from_fn(|i| front[i] + k * back[i])
}

/// A linear premultiplied colour over white, as 8-bit sRGB.
#[must_use]
pub fn to_srgb8(rgba: [f32; 4]) -> [u8; 3] {
    let over_white = over(rgba, [1.0; 4]);
    std::array::from_fn(|i| {
        let c = over_white[i].clamp(0.0, 1.0);
        let s = if c <= 0.003_130_8 {
            12.92 * c
        } else {
            1.055 * c.powf(1.0 / 2.4) - 0.055
        };
        (s * 255.0 + 0.5) as u8
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shading_is_two_sided_and_has_an_ambient_floor() {
        let c = [1.0, 0.5, 0.0];
        let n = [0.0, 0.0, 1.0];
        assert_eq!(shade(c, n, DVec3::Z), shade(c, n, -DVec3::Z * 3.0));
        assert_eq!(shade(c, n, DVec3::Z), c);
        assert_eq!(shade(c, [0.0; 3], DVec3::Z)[0], AMBIENT);
    }

    #[test]
    fn srgb_ends_are_exact() {
        assert_eq!(to_srgb8([0.0; 4]), [255; 3]);
        assert_eq!(to_srgb8([0.0, 0.0, 0.0, 1.0]), [0; 3]);
        assert_eq!(to_srgb8([0.2140, 0.0, 1.0, 1.0]), [127, 0, 255]);
    }
}
