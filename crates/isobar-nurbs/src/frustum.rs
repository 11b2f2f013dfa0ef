//! The rays of a tile as two planes each (Martin, Cohen, Kirby 2011, section 3; equations 7 to 15 as corrected in maths, section C).
//!
//! Instead of a perspective projection, which would divide, everything stays in the homogeneous coordinates of a camera frame `x = right . (p - eye)`, `y = up . (p - eye)`,
//! `z = forward . (p - eye)`, weight w. A ray meets the element where `alpha = x - s D` and `beta = y - r D` vanish, with D = z and the slopes s, r of the ray where
//! all rays of the tile start at the eye, and D = w and the ray's offsets where they are parallel. **These are equations of the very f64 ray**: with `d` its direction
//! bits, `x (forward . d) = z (right . d)` holds on it whatever the frame's bits are; only the rounding of s itself enters, which
//! [`Frustum::error_of_slopes`] bounds.

use glam::DVec3;
use isobar_core::{Camera, Ray, View};
use isobar_cpu::Tile;

/// Half a unit in the last place, relative.
pub(crate) const EPS: f64 = f64::EPSILON / 2.0;

/// A rectangle of pixels of the tile, ends included.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct PixelBox {
    pub(crate) x0: u16,
    pub(crate) x1: u16,
    pub(crate) y0: u16,
    pub(crate) y1: u16,
}

impl PixelBox {
    /// The rectangle about another and a pixel.
    #[inline(always)]
    pub(crate) fn with(other: Option<Self>, x: u16, y: u16) -> Self {
        let o = other.unwrap_or(Self {
            x0: x,
            x1: x,
            y0: y,
            y1: y,
        });
        Self {
            x0: o.x0.min(x),
            x1: o.x1.max(x),
            y0: o.y0.min(y),
            y1: o.y1.max(y),
        }
    }

    #[inline(always)]
    pub(crate) fn pixels(self) -> usize {
        usize::from(self.x1 - self.x0 + 1) * usize::from(self.y1 - self.y0 + 1)
    }
}

/// One ray.
#[derive(Debug, Clone, Copy)]
pub(crate) struct PixelRay {
    pub(crate) ray: Ray,
    /// Slopes (perspective) or offsets (parallel rays).
    pub(crate) slope: [f64; 2],
    /// forward . direction: depth z - `start` is t times this.
    pub(crate) rate: f64,
    /// z of the ray's origin.
    pub(crate) start: f64,
}

/// The rays of a tile and their common frame.
#[derive(Debug, Clone)]
pub(crate) struct Frustum {
    pub(crate) eye: DVec3,
    pub(crate) right: DVec3,
    pub(crate) up: DVec3,
    pub(crate) forward: DVec3,
    pub(crate) parallel: bool,
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) rays: Vec<PixelRay>,
    /// Least and greatest slope of the pixels of a column, the exact slope included.
    columns: Vec<(f64, f64)>,
    rows: Vec<(f64, f64)>,
    /// Greatest `1 + |s| + |r|` (perspective; else 1).
    pub(crate) obliquity: f64,
    /// Greatest |slope|.
    pub(crate) reach: f64,
    /// See [`Frustum::error_of_slopes`].
    pub(crate) slope_error: f64,
    /// Half a pixel, as a slope or offset; 0 for lists of rays.
    pub(crate) half: f64,
    /// Least z of an origin.
    start: f64,
}

/// A right-handed orthonormal frame (to rounding) that looks along `d`.
fn frame(d: DVec3, up: DVec3) -> (DVec3, DVec3, DVec3) {
    let forward = d.normalize();
    let mut right = forward.cross(up.normalize_or_zero());
    if right.length() < 1e-9 {
        right = forward.cross(forward.any_orthonormal_vector());
    }
    let right = right.normalize();
    (right, right.cross(forward), forward)
}

impl Frustum {
    /// The frusta of a tile: one, or one per ray where the rays have nothing in common. The second number is the tile's pixel (x, y) the frustum starts at.
    pub(crate) fn of_tile(view: &View, tile: Tile) -> Vec<(Self, (usize, usize))> {
        let generator = view.generator();
        // A pixel is a square: the same half across and down.
        let half = match &view.camera {
            Camera::Perspective { fov, .. } => (fov.to_radians() * 0.5).tan() / view.height as f64,
            Camera::Orthographic { height, .. } => 0.5 * height / view.height as f64,
            Camera::Rays(_) => 0.0,
        };
        let sized = |f: Self| Self { half, ..f };
        let all = || tile.pixels().map(|(x, y)| generator.ray(x, y)).collect::<Vec<_>>();
        match &view.camera {
            Camera::Perspective { eye, target, up, .. } => {
                vec![(
                    sized(Self::new(
                        *eye,
                        frame(*target - *eye, *up),
                        false,
                        tile.width,
                        tile.height,
                        all(),
                    )),
                    (tile.x, tile.y),
                )]
            }
            Camera::Orthographic { eye, target, up, .. } => {
                vec![(
                    sized(Self::new(
                        *eye,
                        frame(*target - *eye, *up),
                        true,
                        tile.width,
                        tile.height,
                        all(),
                    )),
                    (tile.x, tile.y),
                )]
            }
            Camera::Rays(_) => tile
                .pixels()
                .map(|(x, y)| {
                    let ray = generator.ray(x, y);
                    // Any frame that looks along the ray; lengths far from 1 are brought near it first.
                    let d = ray.direction / ray.direction.abs().max_element();
                    (
                        Self::new(ray.origin, frame(d, d.any_orthogonal_vector()), false, 1, 1, vec![ray]),
                        (x, y),
                    )
                })
                .collect(),
        }
    }

    fn new(
        eye: DVec3,
        (right, up, forward): (DVec3, DVec3, DVec3),
        parallel: bool,
        width: usize,
        height: usize,
        rays: Vec<Ray>,
    ) -> Self {
        let rays: Vec<PixelRay> = rays
            .into_iter()
            .map(|ray| {
                let (d, o) = (ray.direction, ray.origin - eye);
                let rate = forward.dot(d);
                let slope = [right.dot(d) / rate, up.dot(d) / rate];
                let start = if parallel { forward.dot(o) } else { 0.0 };
                PixelRay {
                    ray,
                    slope: if parallel {
                        [right.dot(o) - slope[0] * start, up.dot(o) - slope[1] * start]
                    } else {
                        slope
                    },
                    rate,
                    start,
                }
            })
            .collect();
        let most = |f: &dyn Fn(&PixelRay) -> f64| rays.iter().map(f).fold(0.0f64, f64::max);
        let obliquity = if parallel {
            1.0
        } else {
            most(&|r| 1.0 + r.slope[0].abs() + r.slope[1].abs())
        };
        let mut f = Self {
            eye,
            right,
            up,
            forward,
            parallel,
            width,
            height,
            columns: vec![(f64::INFINITY, f64::NEG_INFINITY); width],
            rows: vec![(f64::INFINITY, f64::NEG_INFINITY); height],
            obliquity,
            reach: most(&|r| r.slope[0].abs().max(r.slope[1].abs())),
            slope_error: 0.0,
            half: 0.0,
            start: rays.iter().map(|r| r.start).fold(f64::INFINITY, f64::min),
            rays,
        };
        let slack = f.error_of_slopes();
        f.slope_error = slack;
        for y in 0..height {
            for x in 0..width {
                let [s, r] = f.rays[y * width + x].slope;
                let c = &mut f.columns[x];
                *c = (c.0.min(s - slack), c.1.max(s + slack));
                let c = &mut f.rows[y];
                *c = (c.0.min(r - slack), c.1.max(r + slack));
            }
        }
        f
    }

    /// Bound of the error of a slope or offset: dot products of unit vectors have an absolute error of 4 roundings, the quotient by
    /// `rate` multiplies both errors by the obliquity; offsets add those of `right . origin`.
    fn error_of_slopes(&self) -> f64 {
        let origins = self
            .rays
            .iter()
            .map(|r| (r.ray.origin - self.eye).length())
            .fold(0.0, f64::max);
        EPS * (16.0 * self.obliquity * self.obliquity + 24.0 * if self.parallel { origins } else { 0.0 })
    }

    /// The same rays with columns and rows as wide as the pixels, for the search of whole frusta.
    pub(crate) fn widened(&self) -> Self {
        let mut f = self.clone();
        for c in f.columns.iter_mut().chain(&mut f.rows) {
            *c = (c.0 - self.half, c.1 + self.half);
        }
        f
    }

    /// The middle and half the width of the slopes of some columns, and of some rows.
    #[inline(always)]
    pub(crate) fn slopes(&self, b: PixelBox) -> [(f64, f64); 2] {
        let middle = |list: &[(f64, f64)], i: u16, j: u16| {
            let (a, b) = (list[usize::from(i)], list[usize::from(j)]);
            let (lo, hi) = (a.0.min(b.0), a.1.max(b.1));
            let m = 0.5 * (lo + hi);
            (m, (hi - m).max(m - lo) * (1.0 + 4.0 * EPS))
        };
        [middle(&self.columns, b.x0, b.x1), middle(&self.rows, b.y0, b.y1)]
    }

    /// All pixels.
    pub(crate) fn all(&self) -> PixelBox {
        PixelBox {
            x0: 0,
            x1: (self.width - 1) as u16,
            y0: 0,
            y1: (self.height - 1) as u16,
        }
    }

    /// The pixels of `b` whose slopes meet the intervals; `None` where none do.
    #[inline(always)]
    pub(crate) fn narrow(&self, mut b: PixelBox, x: (f64, f64), y: (f64, f64)) -> Option<PixelBox> {
        let outside = |c: (f64, f64), q: (f64, f64)| c.1 < q.0 || c.0 > q.1;
        while outside(self.columns[usize::from(b.x0)], x) {
            if b.x0 == b.x1 {
                return None;
            }
            b.x0 += 1;
        }
        while outside(self.columns[usize::from(b.x1)], x) {
            b.x1 -= 1;
        }
        while outside(self.rows[usize::from(b.y0)], y) {
            if b.y0 == b.y1 {
                return None;
            }
            b.y0 += 1;
        }
        while outside(self.rows[usize::from(b.y1)], y) {
            b.y1 -= 1;
        }
        Some(b)
    }

    /// Half spaces `normal . p >= distance` (world) that hold all points of all rays at t >= 0, but for roundings.
    pub(crate) fn planes(&self) -> [(DVec3, f64); 5] {
        let [(s, ds), (r, dr)] = self.slopes(self.all());
        let through = |n: DVec3| (n, n.dot(self.eye));
        if self.parallel {
            let shifted = |n: DVec3, by: f64| (n, n.dot(self.eye) + by);
            return [
                shifted(self.right, s - ds),
                shifted(-self.right, -s - ds),
                shifted(self.up, r - dr),
                shifted(-self.up, -r - dr),
                shifted(self.forward, self.start),
            ];
        }
        [
            through(self.right - self.forward * (s - ds)),
            through(self.forward * (s + ds) - self.right),
            through(self.up - self.forward * (r - dr)),
            through(self.forward * (r + dr) - self.up),
            through(self.forward),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_on_rays_satisfy_their_planes() {
        let bench = View::bench(40, 30);
        let mut parallel = bench.clone();
        parallel.camera = Camera::Orthographic {
            eye: DVec3::new(3.0, -2.0, 1.0),
            target: DVec3::ZERO,
            up: DVec3::Z,
            height: 3.0,
        };
        let rays = View::rays(vec![
            Ray {
                origin: DVec3::new(0.1, 0.2, 0.3),
                direction: DVec3::new(0.0, 0.0, -7.0),
            },
            Ray {
                origin: DVec3::new(5.0, 0.2, 0.3),
                direction: DVec3::new(-1e-9, 2e-9, 0.0),
            },
        ]);
        for view in [bench, parallel, rays] {
            let tile = Tile {
                x: view.width - view.width.min(7),
                y: 0,
                width: view.width.min(7),
                height: view.height.min(16),
            };
            for (f, (x0, y0)) in Frustum::of_tile(&view, tile) {
                for (i, r) in f.rays.iter().enumerate() {
                    assert_eq!(r.ray, view.ray(x0 + i % f.width, y0 + i / f.width));
                    for t in [0.0, 0.7, 5.0] {
                        let p = r.ray.at(t / r.ray.direction.length());
                        let [x, y, z] = [f.right, f.up, f.forward].map(|a| a.dot(p - f.eye));
                        let depth = if f.parallel { 1.0 } else { z };
                        assert!((x - r.slope[0] * depth).abs() < 1e-14 && (y - r.slope[1] * depth).abs() < 1e-14);
                        assert!(
                            ((z - r.start) / r.rate - t / r.ray.direction.length()).abs()
                                < 1e-14 * t.max(1.0) / r.ray.direction.length()
                        );
                        assert!(f.planes().iter().all(|(n, d)| n.dot(p) >= d - 1e-12));
                    }
                }
                let whole = f.all();
                assert_eq!(f.narrow(whole, (-9.0, 9.0), (-9.0, 9.0)), Some(whole));
                assert_eq!(f.narrow(whole, (8.0, 9.0), (-9.0, 9.0)), None);
                let one = f.rays[0].slope;
                let n = f.narrow(whole, (one[0], one[0]), (one[1], one[1])).unwrap();
                assert_eq!((n.x0, n.y0, n.x1, n.y1), (0, 0, 0, 0));
            }
        }
    }
}
