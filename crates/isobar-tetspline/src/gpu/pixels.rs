//! From the hits that the device found, layer by layer, to the pixels of a frame.
//!
//! As many layers as the frame holds are kept. What lies behind them is wanted for its number and its colour alone: each further layer is added to one colour and one
//! count per pixel, so that the memory of a frame does not grow with the surfaces seen through.

use super::bands::{self, Band};
use super::layout::{self, Texel};
use crate::caps::Caps;
use crate::paint::{Colours, Paint};
use crate::ray::Space;
use isobar_core::{Claim, Frame, Hit, Pixel, Ray, RenderError, Request, Stop, Surface, View, over};
use isobar_cpu::scene::Isovalues;
use isobar_cpu::{Blend, PixelSink, Pool, render_tiles, require_memory};
use isobar_gpu::rays::Rectangle;
use rayon::prelude::*;

/// What the colours of hits depend on.
#[derive(Debug, Clone, Copy)]
pub(super) struct Look<'a> {
    pub(super) view: &'a View,
    pub(super) isovalues: &'a Isovalues,
    pub(super) rectangle: Rectangle,
    pub(super) paint: Paint,
}

impl Look<'_> {
    /// The surface of a hit as it looks there.
    fn surface(&self, h: &Texel, hit: &Hit) -> Surface {
        let surface = &self.isovalues.all()[usize::from(hit.surface)];
        if self.paint.is_plain() {
            *surface
        } else {
            layout::coat(h).on(surface)
        }
    }
}

/// Hits behind the layers kept: their colour and how many there are, per pixel of a band.
#[derive(Debug)]
pub(super) struct Behind {
    colour: Vec<Blend>,
    hits: Vec<u16>,
}

impl Behind {
    fn new(pixels: usize) -> Self {
        Self {
            colour: vec![Blend::default(); pixels],
            hits: vec![0; pixels],
        }
    }

    pub(super) fn bytes(&self) -> usize {
        size_of_val(self.colour.as_slice()) + size_of_val(self.hits.as_slice())
    }

    /// Adds a layer behind all that were added; parallel on the caller's pool.
    fn add(&mut self, layer: &[Texel], y: usize, look: &Look<'_>) {
        let width = look.rectangle.width;
        let generator = look.view.generator();
        let pixels = self.colour.par_iter_mut().zip(&mut self.hits).zip(layer).enumerate();
        pixels.with_min_len(1024).for_each(|(i, ((colour, hits), h))| {
            if let Some(hit) = bands::hit(h, None) {
                *hits = hits.saturating_add(1);
                if !colour.is_opaque() {
                    let ray = generator.ray(look.rectangle.x + i % width, y + i / width);
                    colour.add(&look.surface(h, &hit), hit.normal, ray.direction);
                }
            }
        });
    }
}

/// Takes a layer of a band: keeps it where the frame holds so many. Memory is asked for first.
///
/// # Errors
/// [`RenderError::Memory`] with what to change.
pub(super) fn take(band: &mut Band, pool: &Pool, layer: Vec<Texel>, kept: usize, look: &Look<'_>) -> Result<(), RenderError> {
    let n = layer.len();
    if band.layers.len() < kept {
        let what = || room(look, "one more layer of hits of");
        require_memory(what, size_of_val(layer.as_slice()) as u64)?;
        band.layers.push(layer);
        return Ok(());
    }
    if band.behind.is_none() {
        let what = || room(look, "the colours behind the layers of");
        require_memory(what, (n * (size_of::<Blend>() + size_of::<u16>())) as u64)?;
    }
    let behind = band.behind.get_or_insert_with(|| Behind::new(n));
    pool.install(|| behind.add(&layer, band.y, look));
    Ok(())
}

/// What needs memory, and what to change.
fn room(look: &Look<'_>, what: &str) -> String {
    let v = look.view;
    format!(
        "{what} {}x{} pixels (give a smaller --size or fewer --layers)",
        v.width, v.height
    )
}

/// Writes the layers of all bands into a frame with the channels of the request.
///
/// # Errors
/// As [`render_tiles`].
pub(super) fn collect(
    pool: &Pool,
    request: &Request,
    bands: &[Band],
    look: &Look<'_>,
    space: &Space,
    caps: Option<Caps<'_>>,
    out: &mut Frame,
) -> Result<(), RenderError> {
    let r = look.rectangle;
    let rows = bands.first().map_or(1, |b| b.rows);
    let generator = look.view.generator();
    let own = !look.paint.is_plain() || bands.iter().any(|b| b.behind.is_some());
    render_tiles(pool, look.view, request, &Stop::default(), out, |tile, out| {
        for (x, y) in tile.pixels() {
            let ray = generator.ray(x, y);
            let mut sink = PixelSink::new(out, x, y, &ray, look.isovalues.all());
            let mut own = Own::new(own, look, space, &ray);
            let mut work = 0;
            let [first, last] = caps.map_or([None; 2], |c| c.ends(&ray));
            if let Some(hit) = first {
                own.push(&mut sink, &hit, None);
            }
            if (r.x..r.x + r.width).contains(&x) && (r.y..r.y + r.height).contains(&y) {
                let band = &bands[(y - r.y) / rows];
                let at = (y - band.y) * r.width + x - r.x;
                work = band.fragments.get(at).copied().unwrap_or(0);
                for layer in &band.layers {
                    let h = &layer[at];
                    let Some(mut hit) = bands::hit(h, band.entries.get(at)).filter(|_| sink.wants_more()) else {
                        break;
                    };
                    hit.point = ray.at(hit.t);
                    own.push(&mut sink, &hit, Some(h));
                }
                if let Some(behind) = &band.behind {
                    own.behind(behind.colour[at], behind.hits[at]);
                }
            }
            if let Some(hit) = last.filter(|_| sink.wants_more()) {
                own.push(&mut sink, &hit, None);
            }
            let hits = sink.hits().saturating_add(own.hits);
            sink.finish(Claim::empty(), work);
            if let Some(rgba) = own.colour() {
                let claim = Claim::empty();
                out.set_pixel(x, y, &Pixel { hits, claim, rgba, work });
            }
        }
    })
}

/// The colour of a pixel where that is not the sink's: of painted surfaces, and of what lies behind the layers kept.
struct Own<'a> {
    /// Whether there is any such pixel.
    wanted: bool,
    look: &'a Look<'a>,
    space: &'a Space,
    ray: &'a Ray,
    front: [f32; 4],
    /// Hits behind the layers kept.
    hits: u16,
}

impl<'a> Own<'a> {
    const fn new(wanted: bool, look: &'a Look<'a>, space: &'a Space, ray: &'a Ray) -> Self {
        Self {
            wanted,
            look,
            space,
            ray,
            front: [0.0; 4],
            hits: 0,
        }
    }

    /// Gives a hit to the sink and to this; caps, which no texel tells of, are painted here.
    fn push(&mut self, sink: &mut PixelSink<'_, '_>, hit: &Hit, texel: Option<&Texel>) {
        sink.push(hit);
        if !self.wanted || self.front[3] >= 1.0 {
            return;
        }
        let one = match texel {
            Some(h) => {
                let mut one = Blend::default();
                one.add(&self.look.surface(h, hit), hit.normal, self.ray.direction);
                one.rgba()
            }
            None => Colours::of(
                self.look.paint,
                self.look.view,
                self.space,
                self.look.isovalues,
                hit,
                self.ray,
            ),
        };
        self.front = over(self.front, one);
    }

    fn behind(&mut self, colour: Blend, hits: u16) {
        self.front = over(self.front, colour.rgba());
        self.hits = hits;
    }

    /// Nothing where the sink's is right.
    fn colour(&self) -> Option<[f32; 4]> {
        (!self.look.paint.is_plain() || self.hits > 0).then_some(self.front)
    }
}
