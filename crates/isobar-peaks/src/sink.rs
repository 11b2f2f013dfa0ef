//! What a ray gathers front to back: hits, surfaces seen through one another, and the medium between them.

use glam::DVec3;
use isobar_core::{Channels, Claim, Hit, Pixel, Surface, shade};
use isobar_cpu::TileOut;

/// Where less than this is seen through, colour is done: what is behind changes no channel by more.
const DARK: f64 = 1.0 / 16384.0;

/// One pixel.
#[derive(Debug)]
pub(crate) struct Sink<'a, 'b> {
    out: &'a mut TileOut<'b>,
    at: (usize, usize),
    direction: DVec3,
    surfaces: &'a [Surface],
    /// Premultiplied.
    colour: [f64; 3],
    /// What is still seen through.
    clear: f64,
    hits: u16,
    /// Channels for which hits beyond those that are stored matter.
    all_hits: bool,
    rgba: bool,
    pub(crate) work: u32,
}

impl<'a, 'b> Sink<'a, 'b> {
    #[inline(always)]
    pub(crate) fn new(out: &'a mut TileOut<'b>, at: (usize, usize), direction: DVec3, surfaces: &'a [Surface]) -> Self {
        Self {
            all_hits: out.holds(Channels::HITS),
            rgba: out.holds(Channels::RGBA),
            out,
            at,
            direction,
            surfaces,
            colour: [0.0; 3],
            clear: 1.0,
            hits: 0,
            work: 0,
        }
    }

    pub(crate) const fn hits(&self) -> u16 {
        self.hits
    }

    /// Whether colour can still change.
    #[inline(always)]
    pub(crate) fn is_clear(&self) -> bool {
        self.rgba && self.clear > DARK
    }

    /// Whether a further hit would be stored or counted.
    #[inline(always)]
    fn wants_hits(&self) -> bool {
        self.all_hits || usize::from(self.hits) < self.out.layers()
    }

    /// Whether going on can change the pixel.
    #[inline(always)]
    pub(crate) fn wants_more(&self, any_surface: bool) -> bool {
        self.is_clear() || (any_surface && self.wants_hits())
    }

    /// Puts some of the medium behind what is there: linear colour, not premultiplied, and opacity.
    #[inline(always)]
    pub(crate) fn medium(&mut self, colour: [f64; 3], opacity: f64) {
        let k = self.clear * opacity;
        for (sum, c) in self.colour.iter_mut().zip(colour) {
            *sum += k * c;
        }
        self.clear -= k;
    }

    /// The same with a premultiplied colour.
    #[inline(always)]
    pub(crate) fn layer(&mut self, colour: [f64; 3], opacity: f64) {
        for (sum, c) in self.colour.iter_mut().zip(colour) {
            *sum += self.clear * c;
        }
        self.clear -= self.clear * opacity;
    }

    /// Puts a surface behind what is there.
    #[inline(always)]
    pub(crate) fn surface(&mut self, hit: &Hit) {
        if usize::from(self.hits) < self.out.layers() {
            self.out.set_hit(usize::from(self.hits), self.at.0, self.at.1, hit);
        }
        self.hits = self.hits.saturating_add(1);
        if self.is_clear() {
            let s = &self.surfaces[usize::from(hit.surface)];
            let colour = shade(s.colour, hit.normal, self.direction);
            self.medium(colour.map(f64::from), f64::from(s.opacity.clamp(0.0, 1.0)));
        }
    }

    /// Writes what is known besides the hits.
    #[inline(always)]
    pub(crate) fn finish(self, claim: Claim) {
        let [r, g, b] = self.colour.map(|c| c as f32);
        let pixel = Pixel {
            hits: self.hits,
            claim,
            rgba: [r, g, b, (1.0 - self.clear) as f32],
            work: self.work,
        };
        self.out.set_pixel(self.at.0, self.at.1, &pixel);
    }
}
