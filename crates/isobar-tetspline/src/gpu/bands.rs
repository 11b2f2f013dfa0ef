//! The part of the image that sees the volume, in bands that fit a binding.

use super::camera::{self, MOST_CLIPS};
use super::data::Prepared;
use super::feature;
use super::layout::{self, Texel, View as Uniform};
use super::pixels::Behind;
use super::programs::{FORMAT, Rays};
use isobar_core::{Hit, RenderError, View};
use isobar_cpu::Pool;
use isobar_gpu::rays::{Entry, FixedRay, Rectangle};
use isobar_gpu::{Gpu, Target, wgpu};

/// Pixels drawn at once, within what a binding of rays holds: short enough that `Stop` is seen, long enough that tetrahedra are not sent too often.
const BAND_PIXELS: usize = 1 << 21;
/// Most bytes on the device for the pixels of a view.
const MOST_VIEW_BYTES: u64 = 4 << 30;

/// Some rows of the rectangle of the view that sees the volume, with buffers of their own.
#[derive(Debug)]
pub(super) struct Band {
    pub(super) y: usize,
    pub(super) rows: usize,
    /// Of exact rays.
    pub(super) entries: Vec<Entry>,
    pub(super) rays: Option<wgpu::Buffer>,
    pub(super) work: Option<wgpu::Buffer>,
    /// The layer at hand, and the one before where layers are peeled.
    pub(super) targets: Vec<Target>,
    pub(super) view: Uniform,
    /// Layers of the last frame.
    pub(super) layers: Vec<Vec<Texel>>,
    /// Hits behind them.
    pub(super) behind: Option<Behind>,
    pub(super) fragments: Vec<u32>,
}

impl Band {
    pub(super) fn device_bytes(&self, width: usize) -> u64 {
        let buffers = self.rays.iter().chain(&self.work).map(wgpu::Buffer::size).sum::<u64>();
        buffers + (self.targets.len() * self.rows * width * 20) as u64
    }
}

/// The rectangle of a view that sees the domain, and its bands with their rays. `counted`: fragments are counted.
pub(super) fn bands(
    gpu: &Gpu,
    pool: &Pool,
    prepared: &Prepared,
    view: &View,
    rays: Rays,
    counted: bool,
) -> Result<(Rectangle, Vec<Band>), RenderError> {
    let domain = &prepared.domain;
    let rectangle = Rectangle::of(view, domain);
    let width = rectangle.width;
    let exact = rays == Rays::Exact;
    if !exact && view.clips.len() > MOST_CLIPS {
        return Err(feature(format!("more than {MOST_CLIPS} clipping planes with rays=interpolated")).into());
    }
    let pixels = (width * rectangle.height) as u64;
    let total = pixels * (size_of::<FixedRay>() as u64 + 40);
    if total > MOST_VIEW_BYTES {
        return Err(RenderError::Memory {
            what: format!("{}x{} pixels", width, rectangle.height),
            bytes: total,
            limit: MOST_VIEW_BYTES,
        });
    }
    if pixels == 0 {
        return Ok((rectangle, Vec::new()));
    }
    let fit = (gpu.binding_limit() / (size_of::<FixedRay>() * width) as u64).max(1) as usize;
    let rows = (BAND_PIXELS / width).clamp(1, fit).min(gpu.report().max_texture_2d as usize);
    let end = rectangle.y + rectangle.height;
    let bands = (rectangle.y..end).step_by(rows).map(|y| {
        let rows = rows.min(end - y);
        let part = Rectangle {
            y,
            height: rows,
            ..rectangle
        };
        let uniform =
            camera::uniform(view, domain, part, exact, prepared.to_index.gradients()).ok_or_else(|| feature("lists of rays"))?;
        let (rays, entries) = if exact {
            let (rays, entries) = pool.install(|| prepared.to_index.rows(view, rectangle, y, rows));
            (Some(gpu.storage("rays", &rays)?), entries)
        } else {
            (None, Vec::new())
        };
        Ok(Band {
            y,
            rows,
            entries,
            rays,
            work: counted
                .then(|| gpu.storage_empty("fragments", (width * rows * 4) as u64))
                .transpose()?,
            targets: vec![Target::new(gpu, width, rows, FORMAT)?],
            view: uniform,
            layers: Vec::new(),
            behind: None,
            fragments: Vec::new(),
        })
    });
    Ok((rectangle, bands.collect::<Result<_, RenderError>>()?))
}

/// A hit of the target, as the frame holds it but for its point.
pub(super) fn hit(h: &Texel, entry: Option<&Entry>) -> Option<Hit> {
    if h[1] & layout::HIT == 0 {
        return None;
    }
    let s = f64::from(f32::from_bits(h[0]));
    let t = match entry {
        Some(e) if h[1] & layout::WORLD == 0 => e.t + (f64::from(h[1] & 0xffff) + s).max(0.0) / e.speed,
        _ => s,
    };
    Some(Hit {
        t,
        normal: layout::normal([h[2], h[3]]),
        surface: (h[1] >> 16 & 255) as u8,
        ..Hit::NONE
    })
}
