//! The answer: per-pixel hits, only the channels that were asked for.

use crate::DVec3;
use bitflags::bitflags;

bitflags! {
    /// What a frame holds.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
    pub struct Channels: u16 {
        /// Distance along the ray, f64; +inf where nothing is hit.
        const T = 1;
        /// World hit point.
        const POINT = 2;
        /// Unit normal along grad s.
        const NORMAL = 4;
        /// Index of the surface hit.
        const SURFACE = 8;
        /// Error bound e of the claim EXISTS.
        const T_ERROR = 16;
        /// Number of hits found.
        const HITS = 32;
        /// Claims.
        const CLAIM = 64;
        /// Linear premultiplied colour.
        const RGBA = 128;
        /// Work done, in the unit the method states: a heat map.
        const WORK = 256;
    }
}

bitflags! {
    /// What a method claims about a pixel; each can be refuted by a checker.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
    pub struct Claim: u8 {
        /// A root of s - c lies in [t - e, t + e].
        const EXISTS = 1;
        /// No root lies before t - e.
        const FIRST = 2;
        /// The ray has no root: a proved miss.
        const EMPTY = 4;
        /// A cap ended the search; without FIRST or EMPTY the pixel is undecided.
        const LIMIT = 8;
        /// The root has even multiplicity.
        const TANGENT = 16;
        /// s = c on a stretch of the ray; t is its entry.
        const INTERVAL = 32;
        /// The surface lies inside the pixel but not on its centre ray; t stays +inf.
        const COVERED = 64;
    }
}

/// `Frame::surface` where nothing is hit.
pub const NO_SURFACE: u8 = 255;

/// One hit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Distance along the ray.
    pub t: f64,
    /// World point.
    pub point: DVec3,
    /// Unit, along grad s in the world; zero where it vanishes.
    pub normal: [f32; 3],
    /// Index of the surface, in the order given.
    pub surface: u8,
    /// The e of EXISTS; +inf without that claim.
    pub t_error: f64,
}

impl Hit {
    /// No hit.
    pub const NONE: Self = Self {
        t: f64::INFINITY,
        point: DVec3::INFINITY,
        normal: [0.0; 3],
        surface: NO_SURFACE,
        t_error: f64::INFINITY,
    };
}

/// What is known of a pixel besides its hits.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Pixel {
    /// Hits found, also beyond the layers kept.
    pub hits: u16,
    /// Claims about the first hit, or the miss.
    pub claim: Claim,
    /// Linear premultiplied colour.
    pub rgba: [f32; 4],
    /// Work done.
    pub work: u32,
}

/// An image of hits. Vectors of channels that were not asked for are empty; the others hold `width * height` entries, row by row,
/// and `layers` such images one after the other for t, point, normal, surface and t_error (front to back, each distinct root once).
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Frame {
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Layers kept per pixel, at least 1.
    pub layers: usize,
    /// Channels held.
    pub channels: Channels,
    /// Distance along the ray; +inf: no hit.
    pub t: Vec<f64>,
    /// World hit point; infinite: no hit.
    pub point: Vec<DVec3>,
    /// Unit normal along grad s, zero where it vanishes.
    pub normal: Vec<[f32; 3]>,
    /// Surface index; [`NO_SURFACE`]: no hit.
    pub surface: Vec<u8>,
    /// Error bound of t; +inf: none.
    pub t_error: Vec<f64>,
    /// Hits found.
    pub hits: Vec<u16>,
    /// Claims.
    pub claim: Vec<Claim>,
    /// Linear premultiplied colour.
    pub rgba: Vec<[f32; 4]>,
    /// Work done.
    pub work: Vec<u32>,
}

impl Frame {
    /// An empty frame (no hits, background 0) of the given size; keeps the memory of `self` where it suffices.
    pub fn reset(&mut self, width: usize, height: usize, layers: usize, channels: Channels) {
        let n = width * height;
        let layers = layers.max(1);
        let has = |c| channels.contains(c);
        let size = |c, n| if has(c) { n } else { 0 };
        fn fill<T: Clone>(v: &mut Vec<T>, n: usize, x: T) {
            v.clear();
            v.resize(n, x);
        }
        (self.width, self.height, self.layers, self.channels) = (width, height, layers, channels);
        fill(&mut self.t, size(Channels::T, n * layers), Hit::NONE.t);
        fill(&mut self.point, size(Channels::POINT, n * layers), Hit::NONE.point);
        fill(&mut self.normal, size(Channels::NORMAL, n * layers), Hit::NONE.normal);
        fill(&mut self.surface, size(Channels::SURFACE, n * layers), NO_SURFACE);
        fill(&mut self.t_error, size(Channels::T_ERROR, n * layers), Hit::NONE.t_error);
        fill(&mut self.hits, size(Channels::HITS, n), 0);
        fill(&mut self.claim, size(Channels::CLAIM, n), Claim::empty());
        fill(&mut self.rgba, size(Channels::RGBA, n), [0.0; 4]);
        fill(&mut self.work, size(Channels::WORK, n), 0);
    }

    /// An empty frame.
    #[must_use]
    pub fn new(width: usize, height: usize, layers: usize, channels: Channels) -> Self {
        let mut f = Self::default();
        f.reset(width, height, layers, channels);
        f
    }

    /// Stores a hit in `layer` of pixel `i` (row by row); channels not held are dropped.
    ///
    /// # Panics
    /// When the layer or the pixel is out of range.
    pub fn set_hit(&mut self, layer: usize, i: usize, h: &Hit) {
        let at = layer * self.width * self.height + i;
        if !self.t.is_empty() {
            self.t[at] = h.t;
        }
        if !self.point.is_empty() {
            self.point[at] = h.point;
        }
        if !self.normal.is_empty() {
            self.normal[at] = h.normal;
        }
        if !self.surface.is_empty() {
            self.surface[at] = h.surface;
        }
        if !self.t_error.is_empty() {
            self.t_error[at] = h.t_error;
        }
    }

    /// Stores what is known of pixel `i` besides its hits.
    ///
    /// # Panics
    /// When the pixel is out of range.
    pub fn set_pixel(&mut self, i: usize, p: &Pixel) {
        if !self.hits.is_empty() {
            self.hits[i] = p.hits;
        }
        if !self.claim.is_empty() {
            self.claim[i] = p.claim;
        }
        if !self.rgba.is_empty() {
            self.rgba[i] = p.rgba;
        }
        if !self.work.is_empty() {
            self.work[i] = p.work;
        }
    }

    /// Bytes held.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.t.capacity() * 8
            + self.point.capacity() * 24
            + self.normal.capacity() * 12
            + self.surface.capacity()
            + self.t_error.capacity() * 8
            + self.hits.capacity() * 2
            + self.claim.capacity()
            + self.rgba.capacity() * 16
            + self.work.capacity() * 4
    }

    /// Joins two opaque frames of the same rays: at each pixel the nearer first hit wins, with everything the frames hold of it. Ties
    /// keep `self`. Only the first layer is joined; deeper layers of the pixel are those of the winner.
    ///
    /// # Panics
    /// When sizes, layers or channels differ or `t` is missing.
    pub fn compose(&mut self, other: &Self) {
        assert_eq!(
            (self.width, self.height, self.layers, self.channels),
            (other.width, other.height, other.layers, other.channels),
            "frames of one scene are joined"
        );
        assert!(self.channels.contains(Channels::T), "frames are joined by t");
        let n = self.width * self.height;
        fn take<T: Copy>(a: &mut [T], b: &[T], i: usize) {
            if let (Some(x), Some(y)) = (a.get_mut(i), b.get(i)) {
                *x = *y;
            }
        }
        for i in 0..n {
            if other.t[i] < self.t[i] {
                for at in (0..self.layers).map(|l| l * n + i) {
                    take(&mut self.t, &other.t, at);
                    take(&mut self.point, &other.point, at);
                    take(&mut self.normal, &other.normal, at);
                    take(&mut self.surface, &other.surface, at);
                    take(&mut self.t_error, &other.t_error, at);
                }
                take(&mut self.hits, &other.hits, i);
                take(&mut self.claim, &other.claim, i);
                take(&mut self.rgba, &other.rgba, i);
                take(&mut self.work, &other.work, i);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_holds_only_what_was_asked() {
        let f = Frame::new(4, 3, 2, Channels::T | Channels::CLAIM);
        assert_eq!((f.t.len(), f.claim.len(), f.point.len(), f.rgba.len()), (24, 12, 0, 0));
    }

    #[test]
    fn the_nearer_frame_wins() {
        let c = Channels::T | Channels::SURFACE;
        let mut a = Frame::new(2, 1, 1, c);
        let mut b = Frame::new(2, 1, 1, c);
        a.set_hit(
            0,
            0,
            &Hit {
                t: 2.0,
                surface: 0,
                ..Hit::NONE
            },
        );
        b.set_hit(
            0,
            0,
            &Hit {
                t: 1.0,
                surface: 1,
                ..Hit::NONE
            },
        );
        b.set_hit(
            0,
            1,
            &Hit {
                t: 5.0,
                surface: 2,
                ..Hit::NONE
            },
        );
        a.compose(&b);
        assert_eq!((a.t, a.surface), (vec![1.0, 5.0], vec![1, 2]));
    }
}
