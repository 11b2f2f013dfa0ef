//! Pictures put together from frames, lines and squares.

use image::{Rgb, RgbImage};
use isobar_core::{Frame, to_srgb8};
use std::path::Path;

pub(crate) type Failure = Box<dyn std::error::Error>;

pub(crate) const BLACK: Rgb<u8> = Rgb([0, 0, 0]);
pub(crate) const GREY: Rgb<u8> = Rgb([170, 170, 170]);
pub(crate) const RED: Rgb<u8> = Rgb([215, 35, 30]);
pub(crate) const BLUE: Rgb<u8> = Rgb([30, 80, 200]);
pub(crate) const GREEN: Rgb<u8> = Rgb([20, 140, 60]);
pub(crate) const GOLD: Rgb<u8> = Rgb([235, 165, 30]);

pub(crate) fn blank(w: usize, h: usize) -> RgbImage {
    RgbImage::from_pixel(w as u32, h as u32, Rgb([255; 3]))
}

/// Panels beside each other, on white.
pub(crate) fn write(path: &Path, panels: &[RgbImage]) -> Result<(), Failure> {
    const GAP: u32 = 8;
    let width = panels.iter().map(|p| p.width() + GAP).sum::<u32>() + GAP;
    let height = panels.iter().map(RgbImage::height).max().unwrap_or(0) + 2 * GAP;
    let mut out = RgbImage::from_pixel(width, height, Rgb([255; 3]));
    let mut x = GAP;
    for p in panels {
        image::imageops::replace(&mut out, p, x.into(), GAP.into());
        x += p.width() + GAP;
    }
    out.save(path)?;
    println!("{}", path.display());
    Ok(())
}

pub(crate) fn picture(f: &Frame) -> RgbImage {
    RgbImage::from_fn(f.width as u32, f.height as u32, |x, y| {
        Rgb(to_srgb8(f.rgba[y as usize * f.width + x as usize]))
    })
}

/// Counts from white (0) over yellow and red to black (`most`).
pub(crate) fn heat(counts: &[u32], width: usize, most: u32) -> RgbImage {
    RgbImage::from_fn(width as u32, (counts.len() / width) as u32, |x, y| {
        let v = counts[y as usize * width + x as usize].min(most);
        let t = f64::from(v) / f64::from(most.max(1));
        let ramp = |from: f64, to: f64| (255.0 * (1.0 - ((t - from) / (to - from)).clamp(0.0, 1.0))) as u8;
        if v == 0 {
            return Rgb([255; 3]);
        }
        Rgb([ramp(0.66, 1.0), ramp(0.33, 0.66), ramp(0.0, 0.33)])
    })
}

pub(crate) fn dot(p: &mut RgbImage, (x, y): (f64, f64), radius: i64, colour: Rgb<u8>) {
    let (cx, cy) = (x.round() as i64, y.round() as i64);
    for j in -radius..=radius {
        for i in -radius..=radius {
            let (x, y) = (cx + i, cy + j);
            if i * i + j * j <= radius * radius && x >= 0 && y >= 0 && x < i64::from(p.width()) && y < i64::from(p.height()) {
                p.put_pixel(x as u32, y as u32, colour);
            }
        }
    }
}

pub(crate) fn line(p: &mut RgbImage, a: (f64, f64), b: (f64, f64), colour: Rgb<u8>) {
    let n = (a.0 - b.0).abs().max((a.1 - b.1).abs()).ceil().min(1e4) as usize + 1;
    for i in 0..=n {
        let t = i as f64 / n as f64;
        dot(p, (a.0 + (b.0 - a.0) * t, a.1 + (b.1 - a.1) * t), 0, colour);
    }
}

/// A look at points of three dimensions from a corner, fitted into a square.
pub(crate) struct Oblique {
    centre: [f64; 2],
    scale: f64,
    size: f64,
}

impl Oblique {
    fn flat([x, y, z]: [f64; 3]) -> [f64; 2] {
        [0.87 * x - 0.5 * y, 0.25 * x + 0.43 * y + 0.87 * z]
    }

    /// About these points, in a picture of `size` pixels.
    pub(crate) fn about<'a>(points: impl Iterator<Item = &'a [f64; 3]>, size: usize) -> Self {
        let (mut lo, mut hi) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for q in points.map(|p| Self::flat(*p)) {
            (0..2).for_each(|a| (lo[a], hi[a]) = (lo[a].min(q[a]), hi[a].max(q[a])));
        }
        let extent = (hi[0] - lo[0]).max(hi[1] - lo[1]).max(1e-300);
        Self {
            centre: [0.5 * (lo[0] + hi[0]), 0.5 * (lo[1] + hi[1])],
            scale: 0.92 * size as f64 / extent,
            size: size as f64,
        }
    }

    pub(crate) fn at(&self, p: [f64; 3]) -> (f64, f64) {
        let q = Self::flat(p);
        (
            0.5 * self.size + (q[0] - self.centre[0]) * self.scale,
            0.5 * self.size - (q[1] - self.centre[1]) * self.scale,
        )
    }

    /// The twelve edges of a box with corners by bits.
    pub(crate) fn cuboid(&self, p: &mut RgbImage, corners: &[[f64; 3]; 8], colour: Rgb<u8>) {
        for n in 0..8 {
            for a in (0..3).filter(|a| n >> a & 1 == 0) {
                line(p, self.at(corners[n]), self.at(corners[n | 1 << a]), colour);
            }
        }
    }
}
