//! From hits, front to back, to a pixel: layers, the number of hits, and colour through semi-transparent surfaces.

use crate::TileOut;
use glam::DVec3;
use isobar_core::{Channels, Claim, Hit, Pixel, Ray, Surface, over, shade};

/// Whether a surface can be seen at all. One of opacity 0 (or below, or NaN) never hides what is behind, never counts as a hit and
/// need not be searched for.
#[must_use]
pub fn is_visible(surface: &Surface) -> bool {
    surface.opacity > 0.0
}

/// Colour gathered front to back.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Blend([f32; 4]);

impl Blend {
    /// Adds a surface behind all that was added before: the one shading of core, opacity clamped to [0, 1].
    #[inline]
    pub fn add(&mut self, surface: &Surface, normal: [f32; 3], direction: DVec3) {
        let a = surface.opacity.clamp(0.0, 1.0);
        let [r, g, b] = shade(surface.colour, normal, direction);
        self.0 = over(self.0, [r * a, g * a, b * a, a]);
    }

    /// Whether nothing behind can be seen any more: an opaque surface was added.
    #[must_use]
    pub fn is_opaque(&self) -> bool {
        self.0[3] >= 1.0
    }

    /// Linear premultiplied colour.
    #[must_use]
    pub const fn rgba(&self) -> [f32; 4] {
        self.0
    }
}

/// Takes the hits of one pixel front to back and writes them in place.
#[derive(Debug)]
pub struct PixelSink<'a, 'b> {
    out: &'a mut TileOut<'b>,
    x: usize,
    y: usize,
    direction: DVec3,
    surfaces: &'a [Surface],
    blend: Blend,
    hits: u16,
}

impl<'a, 'b> PixelSink<'a, 'b> {
    /// The pixel (x, y) of the image, seen along `ray`; `surfaces` are those [`Hit::surface`] counts.
    #[inline]
    #[must_use]
    pub fn new(out: &'a mut TileOut<'b>, x: usize, y: usize, ray: &Ray, surfaces: &'a [Surface]) -> Self {
        Self {
            out,
            x,
            y,
            direction: ray.direction,
            surfaces,
            blend: Blend::default(),
            hits: 0,
        }
    }

    /// Takes the next hit. Returns whether a further one could change the frame: layers are still free, every hit is counted (the
    /// channel HITS), or colour is asked for and what was hit so far can be seen through.
    ///
    /// Hits of surfaces that are not visible are dropped.
    ///
    /// # Panics
    /// When the surface is none of those given.
    #[inline]
    pub fn push(&mut self, hit: &Hit) -> bool {
        let surface = &self.surfaces[usize::from(hit.surface)];
        if is_visible(surface) {
            let layer = usize::from(self.hits);
            if layer < self.out.layers() {
                self.out.set_hit(layer, self.x, self.y, hit);
            }
            self.hits = self.hits.saturating_add(1);
            if self.out.holds(Channels::RGBA) && !self.blend.is_opaque() {
                self.blend.add(surface, hit.normal, self.direction);
            }
        }
        self.wants_more()
    }

    /// As [`PixelSink::push`] returns.
    #[inline]
    #[must_use]
    pub fn wants_more(&self) -> bool {
        usize::from(self.hits) < self.out.layers()
            || self.out.holds(Channels::HITS)
            || (self.out.holds(Channels::RGBA) && !self.blend.is_opaque())
    }

    /// Hits taken so far.
    #[must_use]
    pub const fn hits(&self) -> u16 {
        self.hits
    }

    /// Writes what is known of the pixel besides its hits.
    #[inline]
    pub fn finish(self, claim: Claim, work: u32) {
        let pixel = Pixel {
            hits: self.hits,
            claim,
            rgba: self.blend.rgba(),
            work,
        };
        self.out.set_pixel(self.x, self.y, &pixel);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Pool, render_tiles};
    use isobar_core::{Camera, Frame, Request, Stop, View};

    fn surface(opacity: f32) -> Surface {
        Surface {
            colour: [1.0; 3],
            opacity,
            ..Surface::isovalue(0.0, 0)
        }
    }

    fn hit(t: f64, surface: u8) -> Hit {
        Hit {
            t,
            surface,
            normal: [0.0, 0.0, 1.0],
            ..Hit::NONE
        }
    }

    /// hardcases E9: N equal semi-transparent surfaces give 1 - (1 - a)^N.
    #[test]
    fn equal_surfaces_add_up() {
        let mut b = Blend::default();
        for _ in 0..3 {
            b.add(&surface(0.5), [0.0, 0.0, 1.0], DVec3::Z);
        }
        assert_eq!(b.rgba(), [0.875; 4]);
        assert!(!b.is_opaque());
        b.add(&surface(1.0), [0.0, 0.0, 1.0], DVec3::Z);
        assert!(b.is_opaque());
    }

    /// Draws one pixel with the given hits; returns the frame and how many hits were taken.
    fn pixel(surfaces: &[Surface], hits: &[Hit], channels: Channels, layers: usize) -> (Frame, usize) {
        let ray = Ray {
            origin: DVec3::ZERO,
            direction: DVec3::Z,
        };
        let view = View {
            camera: Camera::Rays(vec![ray].into()),
            width: 1,
            height: 1,
            clips: vec![],
        };
        let request = Request {
            channels,
            layers,
            ..Request::default()
        };
        let mut frame = Frame::default();
        let taken = std::sync::atomic::AtomicUsize::new(0);
        render_tiles(
            &Pool::new(1).unwrap(),
            &view,
            &request,
            &Stop::default(),
            &mut frame,
            |_, out| {
                let mut sink = PixelSink::new(out, 0, 0, &ray, surfaces);
                for h in hits {
                    taken.fetch_add(1, std::sync::atomic::Ordering::Relaxed);
                    if !sink.push(h) {
                        break;
                    }
                }
                sink.finish(Claim::empty(), 7);
            },
        )
        .unwrap();
        (frame, taken.into_inner())
    }

    #[test]
    fn an_invisible_surface_never_hides_and_is_never_the_first_hit() {
        let surfaces = [surface(0.0), surface(0.5), surface(1.0), surface(1.0)];
        let hits = [hit(1.0, 0), hit(2.0, 1), hit(3.0, 2), hit(4.0, 3)];
        let all = Channels::T | Channels::SURFACE | Channels::RGBA | Channels::WORK;
        let (f, taken) = pixel(&surfaces, &hits, all, 1);
        assert_eq!((f.t[0], f.surface[0], f.rgba[0], f.work[0]), (2.0, 1, [1.0; 4], 7));
        assert_eq!(taken, 3, "behind an opaque surface nothing is searched for");
    }

    #[test]
    fn what_is_asked_for_decides_how_far_the_search_goes() {
        let surfaces = [surface(1.0)];
        let hits = [hit(1.0, 0), hit(2.0, 0), hit(3.0, 0)];
        assert_eq!(pixel(&surfaces, &hits, Channels::T, 1).1, 1);
        let (f, taken) = pixel(&surfaces, &hits, Channels::T, 2);
        assert_eq!((taken, f.t), (2, vec![1.0, 2.0]));
        let (f, taken) = pixel(&surfaces, &hits, Channels::T | Channels::HITS, 2);
        assert_eq!((taken, f.hits, f.t), (3, vec![3], vec![1.0, 2.0]));
    }
}
