//! Isovalues as kernels compare with them: less a bias near the middle of them, so that values far from 0 keep their digits in f32.

use bytemuck::{Pod, Zeroable};
use isobar_core::Surface;

/// Most of them: `Frame::surface` counts to 254.
pub const MOST_LEVELS: u64 = 255;

/// An isovalue less the bias, with its surface: `value: f32, opacity: f32, surface: u32, unused: u32, colour: vec3<f32>, unused_1: f32` in WGSL.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Level {
    /// The isovalue less the bias.
    pub value: f32,
    /// From 0 to 1.
    pub opacity: f32,
    /// Index of the surface.
    pub surface: u32,
    /// Zero.
    pub unused: u32,
    /// Linear RGB.
    pub colour: [f32; 3],
    /// Zero.
    pub unused_1: f32,
}

impl Level {
    /// One isovalue of a surface.
    #[must_use]
    pub fn new(value: f64, bias: f64, surface: u8, of: &Surface) -> Self {
        Self {
            value: (value - bias) as f32,
            opacity: of.opacity.clamp(0.0, 1.0),
            surface: surface.into(),
            unused: 0,
            colour: of.colour,
            unused_1: 0.0,
        }
    }
}

/// A number as a sum of two f32.
#[must_use]
pub fn halves(bias: f64) -> [f32; 2] {
    let hi = bias as f32;
    [hi, (bias - f64::from(hi)) as f32]
}

/// Those of the ascending isovalues that lie within `range`, and the bias, the middle of them, as a sum of two f32. `surface_of` tells the surface of each
/// place in `values`, an index into `surfaces`.
#[must_use]
pub fn levels_within(
    values: &[f64],
    surface_of: impl Fn(usize) -> u8,
    surfaces: &[Surface],
    range: [f32; 2],
) -> (Vec<Level>, [f32; 2]) {
    let inside = |c: f64| f64::from(range[0]) <= c && c <= f64::from(range[1]);
    let within: Vec<(usize, f64)> = values.iter().copied().enumerate().filter(|(_, c)| inside(*c)).collect();
    let bias = match (within.first(), within.last()) {
        (Some(a), Some(b)) => 0.5 * a.1 + 0.5 * b.1,
        _ => 0.0,
    };
    let levels = within.into_iter().map(|(i, c)| {
        let surface = surface_of(i);
        Level::new(c, bias, surface, &surfaces[usize::from(surface)])
    });
    (levels.collect(), halves(bias))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_keep_their_digits_far_from_zero() {
        let surfaces = [1e6, 1e6 + 0.001, -5.0].map(|c| Surface::isovalue(c, 0));
        let (levels, [hi, lo]) = levels_within(&[-5.0, 1e6, 1e6 + 0.001], |i| [2, 0, 1][i], &surfaces, [0.0, 2e6]);
        assert_eq!(levels.iter().map(|l| l.surface).collect::<Vec<_>>(), [0, 1]);
        assert!((levels[1].value - levels[0].value - 0.001).abs() < 1e-9);
        assert!((f64::from(hi) + f64::from(lo) - 1e6 - 0.0005).abs() < 1e-9);
        assert_eq!(levels_within(&[1.0], |_| 0, &surfaces, [2.0, 3.0]), (Vec::new(), [0.0; 2]));
    }
}
