//! Procedural texture and the curves where the surface crosses the faces of cubes, as colours of hits (K20, K21).
//!
//! Kalbe et al. 2009, Figs. 5 and 7: "noise-based procedural texturing", and "the C1-continuous boundary curves on the outside of each cube of the partition are shown in black". Both are functions of
//! the exact hit point, so they need no parametrisation; they change the channel RGBA alone.

use crate::ray::{Space, three};
use glam::DVec3;
use isobar_core::{Hit, Ray, Surface, View};
use isobar_cpu::Blend;
use isobar_cpu::scene::Isovalues;

/// How hits are coloured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Paint {
    /// Marble: veins of solid noise.
    pub(crate) marble: bool,
    /// Black curves on the faces of cubes.
    pub(crate) curves: bool,
}

/// Veins across the longest axis of the volume.
const VEINS: f64 = 5.0;
/// How far the noise bends them, in veins.
const BENT: f64 = 1.2;
/// The colour between veins, as a part of the surface's.
const DARK: f64 = 0.25;

impl Paint {
    pub(crate) const fn is_plain(self) -> bool {
        !self.marble && !self.curves
    }

    /// The surface as it looks at a hit. Curves are two pixels wide where the view has a footprint (lists of rays have none, and no curves).
    pub(crate) fn at(self, surface: &Surface, hit: &Hit, view: &View, space: &Space) -> Surface {
        let p = space.index_vector(hit.point - space.domain.origin);
        let mut out = *surface;
        if self.marble {
            let unit = p / space.domain.hi.max_element();
            let vein = (std::f64::consts::TAU * VEINS * (unit.x + unit.z) * 0.5
                + BENT * std::f64::consts::TAU * turbulence(unit * 8.0))
            .sin();
            let bright = DARK + (1.0 - DARK) * (0.5 + 0.5 * vein).sqrt();
            out.colour = out.colour.map(|c| (f64::from(c) * bright) as f32);
        }
        if self.curves && on_curve(p, hit, view.footprint(hit.t), space) {
            out.colour = [0.0; 3];
        }
        out
    }
}

/// The colour of a painted pixel, in place of the one of plain surfaces.
pub(crate) struct Colours<'a> {
    paint: Paint,
    view: &'a View,
    space: &'a Space,
    surfaces: &'a Isovalues,
    blend: Blend,
}

impl<'a> Colours<'a> {
    pub(crate) fn new(paint: Paint, view: &'a View, space: &'a Space, surfaces: &'a Isovalues) -> Self {
        Self {
            paint,
            view,
            space,
            surfaces,
            blend: Blend::default(),
        }
    }

    #[inline(always)]
    pub(crate) fn add(&mut self, hit: &Hit, ray: &Ray) {
        if !self.paint.is_plain() && !self.blend.is_opaque() {
            let surface = &self.surfaces.all()[usize::from(hit.surface)];
            let painted = self.paint.at(surface, hit, self.view, self.space);
            self.blend.add(&painted, hit.normal, ray.direction);
        }
    }

    /// Nothing where surfaces are plain.
    pub(crate) fn rgba(&self) -> Option<[f32; 4]> {
        (!self.paint.is_plain()).then(|| self.blend.rgba())
    }
}

/// Whether a face of a cube is within `reach` of the hit along the surface.
fn on_curve(p: DVec3, hit: &Hit, reach: f64, space: &Space) -> bool {
    let normal = DVec3::from_array(hit.normal.map(f64::from));
    (0..3).any(|a| {
        // Faces are the planes of index n + 1/2.
        let away = (p[a] - 0.5 - (p[a] - 0.5).round()).abs();
        let across = space.world_gradient(three(|b| if a == b { 1.0 } else { 0.0 }));
        let slope = across.reject_from_normalized(normal).length();
        away < reach * slope
    })
}

/// Four octaves of gradient noise, each twice as fine and half as strong.
fn turbulence(p: DVec3) -> f64 {
    (0..4).map(|n| f64::from(1 << n)).map(|f| noise(p * f) / f).sum()
}

/// Perlin's gradient noise (An image synthesizer, SIGGRAPH 1985): random slopes at whole numbers, joined by cubics; within [-1.1, 1.1].
fn noise(p: DVec3) -> f64 {
    let base = p.floor();
    let f = p - base;
    let fade = f * f * (3.0 - 2.0 * f);
    let cell = base.to_array().map(|v| v as i64);
    let mut sum = 0.0;
    for corner in 0..8usize {
        let o = three(|a| (corner >> a & 1) as i64);
        let weight: f64 = (0..3).map(|a| if o[a] == 1 { fade[a] } else { 1.0 - fade[a] }).product();
        let g = slope(three(|a| cell[a] + o[a]));
        sum += weight * g.dot(f - DVec3::from_array(o.map(|v| v as f64)));
    }
    sum
}

/// One of twelve slopes for each whole point.
fn slope(cell: [i64; 3]) -> DVec3 {
    let mut h = 0x9E37_79B9_7F4A_7C15u64;
    for c in cell {
        h = (h ^ c.cast_unsigned()).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        h ^= h >> 29;
    }
    let (a, signs) = ((h >> 8) % 3, h >> 40);
    let (u, v) = (1.0 - 2.0 * (signs & 1) as f64, 1.0 - 2.0 * (signs >> 1 & 1) as f64);
    match a {
        0 => DVec3::new(0.0, u, v),
        1 => DVec3::new(u, 0.0, v),
        _ => DVec3::new(u, v, 0.0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_smooth_and_zero_at_whole_points() {
        let (mut least, mut greatest) = (0.0f64, 0.0f64);
        for n in 0..4000 {
            let p = DVec3::new(f64::from(n) * 0.37, f64::from(n) * -0.173, f64::from(n) * 0.071);
            let v = noise(p);
            (least, greatest) = (least.min(v), greatest.max(v));
            assert!((noise(p + 1e-6) - v).abs() < 1e-5, "a jump at {p}");
            assert_eq!(noise(p.round()), 0.0);
        }
        assert!(
            least < -0.4 && greatest > 0.4 && least > -1.2 && greatest < 1.2,
            "{least} {greatest}"
        );
    }
}
