//! How far two images of linear premultiplied colour are apart.

use image_compare::{Algorithm, prelude::RgbImage, rgb_similarity_structure};
use isobar_core::{over, to_srgb8};

/// Differences of two images. The first four are of linear premultiplied colour and opacity; the last two of what is seen: sRGB over white.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Difference {
    /// Greatest difference of a channel, opacity included.
    pub max: f64,
    /// 99th percentile over the pixels of the greatest difference of their channels (the least value that 99 % do not exceed).
    pub p99: f64,
    /// Mean over the pixels of the greatest difference of their channels.
    pub mean: f64,
    /// Pixels with a difference above 1/255.
    pub visible: usize,
    /// Peak signal-to-noise ratio in decibels over red, green and blue as sRGB over white, peak 1, without rounding to 8 bits; infinite for equal images.
    pub psnr: f64,
    /// Mean structural similarity over windows of 8x8 of the 8-bit images, the least of the three channels; 1 for equal images.
    pub ssim: f64,
}

impl Difference {
    /// Of two images of the same size, rows of `width` pixels.
    ///
    /// # Panics
    /// When the images differ in size or are empty, or their length is no multiple of the width.
    #[must_use]
    pub fn between(width: usize, a: &[[f32; 4]], b: &[[f32; 4]]) -> Self {
        assert!(a.len() == b.len() && !a.is_empty(), "two images of the same size");
        assert!(width > 0 && a.len().is_multiple_of(width), "whole rows");
        let mut apart: Vec<f64> = a.iter().zip(b).map(|(x, y)| farthest(x, y)).collect();
        let squares: f64 = a.iter().zip(b).map(|(x, y)| seen(x, y)).sum();
        let mean_square = squares / (3 * a.len()) as f64;
        let (mean, visible) = (
            apart.iter().sum::<f64>() / apart.len() as f64,
            apart.iter().filter(|&&d| d > 1.0 / 255.0).count(),
        );
        apart.sort_by(f64::total_cmp);
        let at = (apart.len() * 99).div_ceil(100) - 1;
        Self {
            max: apart[apart.len() - 1],
            p99: apart[at],
            mean,
            visible,
            psnr: -10.0 * mean_square.log10(),
            ssim: similarity(width, a, b),
        }
    }
}

/// Greatest difference of a channel; a number that is none is infinitely wrong.
fn farthest(x: &[f32; 4], y: &[f32; 4]) -> f64 {
    x.iter().zip(y).fold(0.0, |m: f64, (x, y)| {
        let d = (f64::from(*x) - f64::from(*y)).abs();
        if d.is_nan() { f64::INFINITY } else { m.max(d) }
    })
}

/// Sum of the squares of the differences in sRGB over white.
fn seen(x: &[f32; 4], y: &[f32; 4]) -> f64 {
    let srgb = |c: &[f32; 4], i: usize| {
        let v = f64::from(over(*c, [1.0; 4])[i]).clamp(0.0, 1.0);
        if v <= 0.003_130_8 {
            12.92 * v
        } else {
            1.055 * v.powf(1.0 / 2.4) - 0.055
        }
    };
    (0..3).map(|i| (srgb(x, i) - srgb(y, i)).powi(2)).sum()
}

fn similarity(width: usize, a: &[[f32; 4]], b: &[[f32; 4]]) -> f64 {
    let image = |p: &[[f32; 4]]| {
        let bytes = p.iter().flat_map(|c| to_srgb8(*c)).collect();
        RgbImage::from_raw(width as u32, (p.len() / width) as u32, bytes)
    };
    match (image(a), image(b)) {
        (Some(a), Some(b)) => rgb_similarity_structure(&Algorithm::MSSIMSimple, &a, &b).map_or(0.0, |s| s.score),
        _ => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_are_counted_and_measured() {
        let a = vec![[0.25, 0.5, 0.125, 0.75f32]; 64 * 32];
        let same = Difference::between(64, &a, &a);
        assert_eq!((same.max, same.p99, same.visible, same.psnr), (0.0, 0.0, 0, f64::INFINITY));
        assert!((same.ssim - 1.0).abs() < 1e-12);
        let mut b = a.clone();
        for p in b.iter_mut().step_by(128) {
            p[1] -= 0.25;
        }
        let d = Difference::between(64, &a, &b);
        // 16 of 2048 pixels: below a hundredth
        assert_eq!((d.max, d.p99, d.visible), (0.25, 0.0, 16));
        assert!(
            (d.mean - 0.25 / 128.0).abs() < 1e-12 && d.ssim < 0.99 && d.ssim > 0.0,
            "{d:?}"
        );
        // green over white: 0.75 and 0.5 are 0.8808 and 0.7354 in sRGB
        let want = -10.0 * ((0.880_825f64 - 0.735_357).powi(2) / 3.0 / 128.0).log10();
        assert!((d.psnr - want).abs() < 1e-3, "{} {want}", d.psnr);
        let c = vec![[f32::NAN; 4]; a.len()];
        assert_eq!(Difference::between(64, &a, &c).max, f64::INFINITY);
    }
}
