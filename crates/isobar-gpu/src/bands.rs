//! The pixels of a view in bands of rows: rays up, one kernel over each band, hits and pixels back into a frame.
//!
//! A band has buffers of its own that fit one binding each, and is short enough that `Stop` is seen between two of them and no driver's watchdog bites. A kernel of workgroups of 8x8
//! invocations finds the ray of pixel (x, y) of its band at `y * width + x`, writes hit `layer` of it at `layer * pixels + y * width + x`, and its pixel there.

use crate::rays::{Entry, Rectangle};
use crate::{Gpu, GpuError, Kernel, wgpu};
use bytemuck::{Pod, Zeroable};
use isobar_core::{Channels, Claim, Frame, Hit as FrameHit, Pixel as FramePixel, RenderError, Stop, View};
use std::marker::PhantomData;
use std::time::Duration;

/// Pixels of one dispatch: long enough to fill a large GPU.
const BAND_PIXELS: usize = 1 << 16;
/// Most bytes on the device for rays and hits of one view.
const MOST_VIEW_BYTES: u64 = 4 << 30;

/// A hit as a kernel writes it.
pub trait DeviceHit: Pod {
    /// Its distance behind the ray's entry, in the units of [`Entry::speed`].
    fn along(&self) -> f64;
    /// Index of its surface.
    fn surface(&self) -> u32;
    /// Unit normal, or zero.
    fn normal(&self) -> [f32; 3];
}

/// A hit with an f32 distance: `u: f32, surface: u32, normal_x: f32, normal_y: f32, normal_z: f32` in WGSL.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct Hit {
    /// Distance behind the entry, in the units of [`Entry::speed`].
    pub u: f32,
    /// Index of the surface.
    pub surface: u32,
    /// Unit normal, or zero.
    pub normal: [f32; 3],
}

impl DeviceHit for Hit {
    fn along(&self) -> f64 {
        self.u.into()
    }

    fn surface(&self) -> u32 {
        self.surface
    }

    fn normal(&self) -> [f32; 3] {
        self.normal
    }
}

/// What a kernel writes for a pixel besides hits: `red, green, blue, alpha: f32, hits: u32, work: u32` in WGSL.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct Pixel {
    /// Linear, premultiplied.
    pub rgba: [f32; 4],
    /// Hits found, also beyond the layers kept.
    pub hits: u32,
    /// Work done; [`CUT`] where the driver ended the pixel's loops.
    pub work: u32,
}

/// [`Pixel::work`] of a pixel whose loops the driver ended before the shader did, as software Vulkan (Mesa) does after 65,535 turns of all loops of a
/// ray together, without an error. A shader knows it by a loop that was left although its condition holds.
pub const CUT: u32 = u32::MAX;

/// Some rows of the rectangle.
#[derive(Debug)]
struct Band {
    y: usize,
    rows: usize,
    entries: Vec<Entry>,
    rays: wgpu::Buffer,
    hits: wgpu::Buffer,
    pixels: wgpu::Buffer,
    bind: Option<wgpu::BindGroup>,
}

/// Bindings of what a band owns, in group 0.
#[derive(Debug, Clone, Copy)]
pub struct Bindings {
    /// Of its rays.
    pub rays: u32,
    /// Of its hits.
    pub hits: u32,
    /// Of its pixels.
    pub pixels: u32,
}

/// The rectangle of a view that sees the volume, in bands, with hits of type `H`.
#[derive(Debug)]
pub struct Bands<H> {
    rectangle: Rectangle,
    layers: usize,
    bands: Vec<Band>,
    hit: PhantomData<H>,
}

impl<H> Default for Bands<H> {
    fn default() -> Self {
        Self {
            rectangle: Rectangle::default(),
            layers: 1,
            bands: Vec::new(),
            hit: PhantomData,
        }
    }
}

impl<H: DeviceHit> Bands<H> {
    /// Buffers for `layers` hits a pixel of `rectangle`, and its rays: `rays(y, rows)` makes those of some rows, row by row.
    ///
    /// # Errors
    /// [`RenderError::Memory`] beyond 4 GiB in all or one binding; as [`Gpu::storage`].
    pub fn new<R: Pod>(
        gpu: &Gpu,
        rectangle: Rectangle,
        layers: usize,
        mut rays: impl FnMut(usize, usize) -> (Vec<R>, Vec<Entry>),
    ) -> Result<Self, RenderError> {
        let layers = layers.max(1);
        let row = rectangle.width as u64;
        let hit_row = (size_of::<H>() as u64).saturating_mul(row).saturating_mul(layers as u64);
        let other_row = row * (size_of::<R>() + size_of::<Pixel>()) as u64;
        let total = hit_row.saturating_add(other_row).saturating_mul(rectangle.height as u64);
        if total > MOST_VIEW_BYTES {
            return Err(RenderError::Memory {
                what: format!("{}x{} pixels with {layers} layers", rectangle.width, rectangle.height),
                bytes: total,
                limit: MOST_VIEW_BYTES,
            });
        }
        let mut out = Self {
            rectangle,
            layers,
            ..Self::default()
        };
        if rectangle.width * rectangle.height == 0 {
            return Ok(out);
        }
        let widest = hit_row.max(row * size_of::<R>() as u64);
        let fit = (gpu.binding_limit() / widest).max(1) as usize;
        let rows = BAND_PIXELS.div_ceil(rectangle.width).min(fit);
        // Whole workgroups, where there is more than one.
        let rows = if rows > 8 { rows & !7 } else { rows };
        let end = rectangle.y + rectangle.height;
        for y in (rectangle.y..end).step_by(rows) {
            let rows = rows.min(end - y);
            let pixels = (rows * rectangle.width) as u64;
            let (rays, entries) = rays(y, rows);
            out.bands.push(Band {
                y,
                rows,
                entries,
                rays: gpu.storage("rays", &rays)?,
                hits: gpu.storage_empty("hits", hit_row * rows as u64)?,
                pixels: gpu.storage_empty("pixels", pixels * size_of::<Pixel>() as u64)?,
                bind: None,
            });
        }
        Ok(out)
    }

    /// Pixels that are launched.
    #[must_use]
    pub const fn rectangle(&self) -> Rectangle {
        self.rectangle
    }

    /// Forgets which buffers a kernel is bound to: one of the resources of [`Bands::cast`] is another now.
    pub fn unbind(&mut self) {
        for b in &mut self.bands {
            b.bind = None;
        }
    }

    /// Runs a kernel over all bands, `common` bound beside what is the band's own; the device time where the device tells it.
    ///
    /// # Errors
    /// [`RenderError::Stopped`]; as [`Kernel::bind`] and [`Gpu::run`].
    pub fn cast(
        &mut self,
        gpu: &Gpu,
        what: &str,
        kernel: &Kernel,
        common: &[(u32, wgpu::BindingResource<'_>)],
        own: Bindings,
        stop: &Stop,
    ) -> Result<Option<Duration>, RenderError> {
        let mut device = gpu.report().timestamps.then_some(Duration::ZERO);
        stop.begin(self.bands.len() as u64);
        for band in &mut self.bands {
            if stop.is_raised() {
                return Err(RenderError::Stopped);
            }
            if band.bind.is_none() {
                let mut resources = common.to_vec();
                resources.push((own.rays, band.rays.as_entire_binding()));
                resources.push((own.hits, band.hits.as_entire_binding()));
                resources.push((own.pixels, band.pixels.as_entire_binding()));
                band.bind = Some(kernel.bind(gpu, &resources)?);
            }
            let groups = [self.rectangle.width.div_ceil(8) as u32, band.rows.div_ceil(8) as u32, 1];
            let times = gpu.run(what, 1, |w| {
                if let Some(bind) = &band.bind {
                    w.compute(kernel, bind, groups);
                }
            })?;
            device = device.zip(times).map(|(sum, t)| sum + t.iter().sum::<Duration>());
            stop.step();
        }
        Ok(device)
    }

    /// Copies hits and pixels into a frame of the view, which holds the channels wanted; returns the work of all pixels. Nothing is claimed.
    ///
    /// # Errors
    /// As [`Gpu::read`]; [`GpuError::Cut`] where the driver ended the loops of a pixel.
    pub fn read(&self, gpu: &Gpu, view: &View, out: &mut Frame) -> Result<u64, RenderError> {
        self.bands
            .iter()
            .try_fold(0, |work, band| Ok(work + self.read_band(gpu, band, view, out)?))
    }

    fn read_band(&self, gpu: &Gpu, band: &Band, view: &View, out: &mut Frame) -> Result<u64, RenderError> {
        let width = self.rectangle.width;
        let count = band.rows * width;
        let pixels: Vec<Pixel> = gpu.read(&band.pixels, count)?;
        let most = pixels.iter().map(|p| p.hits as usize).max().unwrap_or(0);
        let hits: Vec<H> = gpu.read(&band.hits, most.min(self.layers) * count)?;
        let generator = out.channels.contains(Channels::POINT).then(|| view.generator());
        let mut work = 0;
        for (i, (p, entry)) in pixels.iter().zip(&band.entries).enumerate() {
            let (x, y) = (self.rectangle.x + i % width, band.y + i / width);
            let at = y * view.width + x;
            for layer in 0..self.layers.min(p.hits as usize) {
                let h = &hits[layer * count + i];
                let t = entry.t + h.along().max(0.0) / entry.speed;
                let mut hit = FrameHit {
                    t,
                    normal: h.normal(),
                    surface: h.surface() as u8,
                    ..FrameHit::NONE
                };
                if let Some(g) = &generator {
                    hit.point = g.ray(x, y).at(t);
                }
                out.set_hit(layer, at, &hit);
            }
            if p.work == CUT {
                return Err(GpuError::Cut { x, y }.into());
            }
            work += u64::from(p.work);
            let pixel = FramePixel {
                hits: p.hits.min(u32::from(u16::MAX)) as u16,
                claim: Claim::empty(),
                rgba: p.rgba,
                work: p.work,
            };
            out.set_pixel(at, &pixel);
        }
        Ok(work)
    }

    /// Bytes held on the host.
    #[must_use]
    pub fn host_bytes(&self) -> u64 {
        let entries = self.bands.iter().map(|b| b.entries.capacity() * size_of::<Entry>());
        entries.sum::<usize>() as u64
    }

    /// Bytes held on the device.
    #[must_use]
    pub fn device_bytes(&self) -> u64 {
        let bytes = self.bands.iter().map(|b| b.rays.size() + b.hits.size() + b.pixels.size());
        bytes.sum()
    }
}
