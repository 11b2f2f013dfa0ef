//! Closed cuts: what a ray meets where a capped clipping plane cuts through the solid (K19).
//!
//! Kalbe et al. 2009, section 5, clip volumes with planes, whose cuts show the inside. Here the solid of an isovalue is where s is above it, and a capped plane closes it: a ray that
//! begins to be kept inside the solid meets the cap there, and one that ceases to be kept inside meets it from within. Of several isovalues the cap is that of the greatest one below s at the
//! point, so a cut through nested solids shows each of them. A cap is no root: nothing is claimed about it. Its normal is opposite to the plane's: as everywhere, to the side of rising values.
//! Ends of the domain are not closed.

use crate::ray::Space;
use glam::DVec3;
use isobar_core::{ClipPlane, Function, Hit, Ray, View};
use isobar_cpu::scene::Isovalues;
use isobar_fields::Type6Spline;

/// The capped planes of a view through a spline.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Caps<'a> {
    spline: &'a Type6Spline,
    space: &'a Space,
    surfaces: &'a Isovalues,
    clips: &'a [ClipPlane],
    view: &'a View,
}

impl<'a> Caps<'a> {
    /// `None` where no cut is closed, or nothing is to be seen.
    pub(crate) fn new(spline: &'a Type6Spline, space: &'a Space, surfaces: &'a Isovalues, view: &'a View) -> Option<Self> {
        let some = view.clips.iter().any(|c| c.cap) && !surfaces.values().is_empty();
        some.then_some(Self {
            spline,
            space,
            surfaces,
            clips: &view.clips,
            view,
        })
    }

    /// The caps at both ends of what is kept of a ray: the one it enters by, and the one it leaves by.
    pub(crate) fn ends(&self, ray: &Ray) -> [Option<Hit>; 2] {
        let (Some((first, last)), Some((begin, end))) = (self.view.kept(ray), self.inside(ray)) else {
            return [None; 2];
        };
        // A cut outside the domain cuts nothing.
        let within = |t: f64| (begin.max(first)..=end.min(last)).contains(&t);
        [(first, true), (last, false)].map(|(t, entry)| if within(t) { self.cap(ray, t, entry) } else { None })
    }

    /// Where a ray is inside the domain, at t >= 0.
    fn inside(&self, ray: &Ray) -> Option<(f64, f64)> {
        let o = self.space.index_vector(ray.origin - self.space.domain.origin);
        let d = self.space.index_vector(ray.direction);
        let (mut begin, mut end) = (0.0f64, f64::INFINITY);
        for a in 0..3 {
            let hi = self.space.domain.hi[a];
            if d[a] == 0.0 {
                if !(0.0..=hi).contains(&o[a]) {
                    return None;
                }
            } else {
                let (x, y) = (-o[a] / d[a], (hi - o[a]) / d[a]);
                (begin, end) = (begin.max(x.min(y)), end.min(x.max(y)));
            }
        }
        (begin <= end).then_some((begin, end))
    }

    /// The cap at t, if a capped plane ends there what is kept, inside a solid.
    fn cap(&self, ray: &Ray, t: f64, entry: bool) -> Option<Hit> {
        let plane = self.clips.iter().filter(|c| c.cap).find(|c| {
            let rate = c.normal.dot(ray.direction);
            // As in `View::kept`, to the bit.
            (if entry { rate < 0.0 } else { rate > 0.0 }) && (c.distance - c.normal.dot(ray.origin)) / rate == t
        })?;
        let point = ray.at(t);
        let value = self.spline.value(point);
        let n = self.surfaces.values().iter().rposition(|c| value > *c)?;
        Some(Hit {
            t,
            point,
            normal: (-plane.normal).normalize_or(DVec3::ZERO).as_vec3().to_array(),
            surface: self.surfaces.surface(n),
            t_error: f64::INFINITY,
        })
    }
}
