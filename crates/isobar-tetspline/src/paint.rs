//! Procedural texture and the curves where the surface crosses the faces of cubes, as colours of hits (K20, K21).
//!
//! Kalbe et al. 2009, Figs. 5 and 7: "noise-based procedural texturing", and "the C1-continuous boundary curves on the outside of each cube of the partition are shown in black". Both are functions of
//! the exact hit point, so they need no parametrisation; they change the channel RGBA alone. `shaders/tet_paint_on.wgsl` is the same in f32, for `tetspline/gpu`.

use crate::ray::{Space, three};
use glam::DVec3;
use isobar_core::{Hit, Ray, ResolvedKnobs, Surface, View};
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

/// What paint makes of the colour of a surface at a hit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Coat {
    /// What the colour is multiplied by, in [0, 1].
    pub(crate) bright: f64,
    /// Black: on a curve.
    pub(crate) curve: bool,
}

impl Coat {
    /// The surface as it is.
    #[cfg(feature = "gpu")]
    const NONE: Self = Self {
        bright: 1.0,
        curve: false,
    };

    /// The surface with this coat.
    pub(crate) fn on(self, surface: &Surface) -> Surface {
        let mut out = *surface;
        out.colour = if self.curve {
            [0.0; 3]
        } else {
            out.colour.map(|c| (f64::from(c) * self.bright) as f32)
        };
        out
    }
}

/// Veins across the longest axis of the volume.
const VEINS: f64 = 5.0;
/// How far the noise bends them, in veins.
const BENT: f64 = 1.2;
/// The colour between veins, as a part of the surface's.
const DARK: f64 = 0.25;

impl Paint {
    /// By the knobs `texture` and `overlay`.
    pub(crate) fn new(knobs: &ResolvedKnobs) -> Self {
        Self {
            marble: knobs.word("texture") == "marble",
            curves: knobs.word("overlay") == "curves",
        }
    }

    pub(crate) const fn is_plain(self) -> bool {
        !self.marble && !self.curves
    }

    /// The coat at a hit. Curves are two pixels wide where the view has a footprint (lists of rays have none, and no curves).
    fn coat(self, hit: &Hit, view: &View, space: &Space) -> Coat {
        let p = space.index_vector(hit.point - space.domain.origin);
        let mut bright = 1.0;
        if self.marble {
            let unit = p / space.domain.hi.max_element();
            let vein = (std::f64::consts::TAU * VEINS * (unit.x + unit.z) * 0.5
                + BENT * std::f64::consts::TAU * turbulence(unit * 8.0))
            .sin();
            bright = DARK + (1.0 - DARK) * (0.5 + 0.5 * vein).max(0.0).sqrt();
        }
        Coat {
            bright,
            curve: self.curves && on_curve(p, hit, view.footprint(hit.t), space),
        }
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

    /// Adds a hit behind all that was added before, painted here.
    #[inline(always)]
    pub(crate) fn add(&mut self, hit: &Hit, ray: &Ray) {
        if !self.paint.is_plain() && !self.blend.is_opaque() {
            let surface = &self.surfaces.all()[usize::from(hit.surface)];
            let coat = self.paint.coat(hit, self.view, self.space);
            self.blend.add(&coat.on(surface), hit.normal, ray.direction);
        }
    }

    /// The colour of one hit alone, painted here.
    #[cfg(feature = "gpu")]
    pub(crate) fn of(paint: Paint, view: &View, space: &Space, surfaces: &Isovalues, hit: &Hit, ray: &Ray) -> [f32; 4] {
        let mut one = Blend::default();
        let surface = &surfaces.all()[usize::from(hit.surface)];
        let coat = if paint.is_plain() {
            Coat::NONE
        } else {
            paint.coat(hit, view, space)
        };
        one.add(&coat.on(surface), hit.normal, ray.direction);
        one.rgba()
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
        let across = space.world_gradient(DVec3::AXES[a]);
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

/// One of twelve slopes for each whole point, chosen by 32 bits, so that shaders choose the same.
fn slope(cell: [i64; 3]) -> DVec3 {
    let mut h = 0x9E37_79B9u32;
    for c in cell {
        h = (h ^ c as u32).wrapping_mul(0x85EB_CA6B);
        h ^= h >> 13;
    }
    h = h.wrapping_mul(0xC2B2_AE35);
    h ^= h >> 16;
    let (u, v) = (1.0 - 2.0 * f64::from(h >> 24 & 1), 1.0 - 2.0 * f64::from(h >> 25 & 1));
    match (h & 0xff_ffff) % 3 {
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
