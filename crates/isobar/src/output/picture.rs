//! Pictures for people: the frame itself, heat maps of errors and of work.

use super::{Staged, publish, stage};
use anyhow::{Result, anyhow};
use image::{ImageEncoder, Rgb, RgbImage, codecs::png};
use isobar_core::{Frame, to_srgb8};
use std::path::Path;

/// An 8-bit sRGB picture.
pub type Picture = RgbImage;

/// A pixel's colour that overrides its number: wrong answers stand out of the scale.
pub type ClassColour = [u8; 3];

/// The frame's colour over white, 8-bit sRGB; white where the frame holds no colour.
#[must_use]
pub fn frame_picture(frame: &Frame) -> Picture {
    RgbImage::from_fn(frame.width as u32, frame.height as u32, |x, y| {
        let i = y as usize * frame.width + x as usize;
        Rgb(to_srgb8(frame.rgba.get(i).copied().unwrap_or_default()))
    })
}

/// Anchors of the heat scale, dark blue over green to yellow, even in lightness; sRGB.
const SCALE: [[u8; 3]; 9] = [
    [68, 1, 84],
    [71, 44, 122],
    [59, 81, 139],
    [44, 113, 142],
    [33, 144, 141],
    [39, 173, 129],
    [92, 200, 99],
    [170, 220, 50],
    [253, 231, 37],
];

/// Colour of `x` in [0, 1] on the heat scale; outside, that of the nearer end. NaN is the lower end.
#[must_use]
pub fn heat_colour(x: f64) -> [u8; 3] {
    let x = if x.is_nan() { 0.0 } else { x.clamp(0.0, 1.0) };
    let at = x * (SCALE.len() - 1) as f64;
    let i = (at as usize).min(SCALE.len() - 2);
    let f = at - i as f64;
    std::array::from_fn(|c| {
        let (a, b) = (f64::from(SCALE[i][c]), f64::from(SCALE[i + 1][c]));
        (a + (b - a) * f + 0.5) as u8
    })
}

/// Position of an error on a logarithmic scale from `lo` to `hi`: 0 at `lo` and below, 1 at `hi` and above.
#[must_use]
pub fn log_position(value: f64, lo: f64, hi: f64) -> f64 {
    if value <= lo || value.is_nan() {
        0.0
    } else {
        ((value / lo).ln() / (hi / lo).ln()).min(1.0)
    }
}

/// A picture of one number per pixel on a logarithmic scale from `lo` to `hi`; pixels without a number (NaN) are white, pixels with
/// a class colour have that.
///
/// # Panics
/// When there are fewer values or classes than pixels.
#[must_use]
pub fn error_picture(width: usize, height: usize, values: &[f64], classes: &[Option<ClassColour>], lo: f64, hi: f64) -> Picture {
    RgbImage::from_fn(width as u32, height as u32, |x, y| {
        let i = y as usize * width + x as usize;
        Rgb(match classes[i] {
            Some(c) => c,
            None if values[i].is_nan() => [255; 3],
            None => heat_colour(log_position(values[i], lo, hi)),
        })
    })
}

/// A picture of one number per pixel on a linear scale from 0 to `hi`; NaN is white.
///
/// # Panics
/// When there are fewer values than pixels.
#[must_use]
pub fn heat_picture(width: usize, height: usize, values: &[f64], hi: f64) -> Picture {
    RgbImage::from_fn(width as u32, height as u32, |x, y| {
        let v = values[y as usize * width + x as usize];
        Rgb(if v.is_nan() {
            [255; 3]
        } else {
            heat_colour(v / hi.max(f64::MIN_POSITIVE))
        })
    })
}

/// The work per pixel on a linear scale, and the number at the scale's upper end: the 99.5th percentile, so that single pixels do not
/// darken all others. `None` where the frame holds no work.
#[must_use]
pub fn work_picture(frame: &Frame) -> Option<(Picture, u32)> {
    if frame.work.is_empty() {
        return None;
    }
    let mut sorted = frame.work.clone();
    sorted.sort_unstable();
    let top = sorted[(sorted.len() - 1) * 995 / 1000].max(1);
    let values: Vec<f64> = frame.work.iter().map(|&w| f64::from(w)).collect();
    Some((heat_picture(frame.width, frame.height, &values, f64::from(top)), top))
}

/// A horizontal bar of the heat scale.
#[must_use]
pub fn colour_bar(width: u32, height: u32) -> Picture {
    RgbImage::from_fn(width, height, |x, _| {
        Rgb(heat_colour(f64::from(x) / f64::from((width - 1).max(1))))
    })
}

/// The PNG bytes of a picture.
///
/// # Errors
/// When the encoder refuses it.
pub fn encode_png(picture: &Picture) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    png::PngEncoder::new_with_quality(&mut bytes, png::CompressionType::Default, png::FilterType::Adaptive)
        .write_image(picture, picture.width(), picture.height(), image::ExtendedColorType::Rgb8)
        .map_err(|e| anyhow!("PNG: {e}"))?;
    Ok(bytes)
}

/// Writes a picture as PNG.
///
/// # Errors
/// When the file cannot be written; then none is left.
pub fn write_picture(path: &Path, picture: &Picture) -> Result<()> {
    publish([stage_picture(path, picture)?])
}

/// Writes a picture as PNG under a temporary name.
///
/// # Errors
/// When the file cannot be written; then none is left.
pub fn stage_picture(path: &Path, picture: &Picture) -> Result<Staged> {
    let bytes = encode_png(picture)?;
    stage(path, |w| Ok(std::io::Write::write_all(w, &bytes)?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use isobar_core::Channels;

    #[test]
    fn the_scale_is_clamped_and_monotone_in_lightness() {
        assert_eq!(heat_colour(-1.0), SCALE[0]);
        assert_eq!(heat_colour(f64::NAN), SCALE[0]);
        assert_eq!(heat_colour(2.0), SCALE[8]);
        let light = |c: [u8; 3]| 0.21 * f64::from(c[0]) + 0.72 * f64::from(c[1]) + 0.07 * f64::from(c[2]);
        let steps: Vec<f64> = (0..=32).map(|i| light(heat_colour(f64::from(i) / 32.0))).collect();
        assert!(steps.windows(2).all(|w| w[0] < w[1]), "{steps:?}");
    }

    #[test]
    fn errors_are_logarithmic_and_classes_stand_out() {
        assert_eq!(log_position(1e-6, 1e-6, 1.0), 0.0);
        assert!((log_position(1e-3, 1e-6, 1.0) - 0.5).abs() < 1e-12);
        assert_eq!(log_position(10.0, 1e-6, 1.0), 1.0);
        let p = error_picture(3, 1, &[f64::NAN, 1.0, 0.0], &[None, None, Some([255, 0, 0])], 1e-6, 1.0);
        assert_eq!(p.get_pixel(0, 0).0, [255; 3]);
        assert_eq!(p.get_pixel(1, 0).0, SCALE[8]);
        assert_eq!(p.get_pixel(2, 0).0, [255, 0, 0]);
    }

    #[test]
    fn work_ignores_single_peaks() {
        let mut f = Frame::new(100, 10, 1, Channels::WORK);
        f.work.fill(10);
        f.work[0] = 1_000_000;
        assert_eq!(work_picture(&f).unwrap().1, 10);
        assert!(work_picture(&Frame::new(1, 1, 1, Channels::T)).is_none());
    }
}
