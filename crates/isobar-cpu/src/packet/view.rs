//! Where bricks and cells are seen: index space to pixels, and the rectangle of pixels whose rays may meet a box.
//!
//! Steinberger 2010, section 3.2, launches only the projected bounding rectangle of the volume, and Kalbe et al. 2009, section 4.3, rasterise bounding tetrahedra; here every
//! brick and every cell has a rectangle.
//!
//! **Why nothing is lost.** A box with half edge h about c is seen at x = X/W with X, W affine in index space, so its corners lie within
//! h |X' - x_c W'| / (W_c - h |W'|) of x_c (1-norms of the gradients), as long as that denominator is positive; else the box counts as seen everywhere. Each
//! rectangle is grown by a 64th of a pixel, by the rounding of X and W (`error`), and the box by [`GROWN`] of an index unit, which covers the
//! rounding of rays (less than 2e-7 where rays are traced in packets: [`super::Place::most`]).

use glam::DVec3;
use isobar_core::{Domain, Lens, View};

/// Boxes are taken larger by this share of their half edge, which is at least 1/2.
const GROWN: f64 = 1.0 + 1e-5;

/// Rectangles are larger by this many pixels.
const PAD: f64 = 1.0 / 64.0;

/// An affine function of index space.
#[derive(Debug, Clone, Copy)]
struct Affine {
    at0: f64,
    along: [f64; 3],
}

impl Affine {
    #[inline(always)]
    fn at(&self, [x, y, z]: [f64; 3]) -> f64 {
        let a = self.along;
        self.at0 + x * a[0] + y * a[1] + z * a[2]
    }

    /// 1-norm of the gradient of this - k w.
    #[inline(always)]
    fn slope(&self, k: f64, w: &Self) -> f64 {
        let s = |a: usize| (self.along[a] - k * w.along[a]).abs();
        s(0) + s(1) + s(2)
    }
}

/// Index space to pixels: x/w and y/w, pixel centres at whole numbers.
#[derive(Debug, Clone, Copy)]
pub struct Projection {
    x: Affine,
    y: Affine,
    w: Affine,
    /// 1-norm of the gradient of w.
    depth: f64,
    /// Rounding of x/w and y/w is at most this over w.
    error: f64,
}

/// What a box covers: pixels within (`x` +- `half.0`, `y` +- `half.1`).
#[derive(Debug, Clone, Copy)]
pub struct Seen {
    /// Middle, in pixels of the image.
    pub x: f64,
    /// Middle, in pixels of the image.
    pub y: f64,
    /// Half its width and height.
    pub half: [f64; 2],
}

/// What all cells of a brick share.
#[derive(Debug, Clone, Copy)]
pub struct CellSize {
    /// As [`Seen::half`], for any cell of the brick.
    half: [f64; 2],
}

impl Projection {
    /// `None` for lists of rays, and views whose axes f64 does not hold as orthonormal: their rays go alone.
    #[must_use]
    pub fn new(view: &View, domain: &Domain) -> Option<Self> {
        let Lens {
            eye,
            right,
            up,
            forward,
            half,
            parallel,
        } = view.lens()?;
        // The expressions below take these as orthonormal, as they are but for views that rounding spoils: `up` almost along the line of sight, or so short that its square underflows.
        let off = [
            forward.length_squared() - 1.0,
            right.length_squared() - 1.0,
            right.dot(forward),
        ];
        if off.iter().any(|v| v.is_nan() || v.abs() > 5e-14) {
            return None;
        }
        let (width, height) = (view.width as f64, view.height as f64);
        let origin = domain.origin - eye;
        let axes = domain.axes;
        let row = |v: DVec3, k: f64| Affine {
            at0: k * v.dot(origin),
            along: [k * v.dot(axes.x_axis), k * v.dot(axes.y_axis), k * v.dot(axes.z_axis)],
        };
        let w = if parallel {
            Affine {
                at0: 1.0,
                along: [0.0; 3],
            }
        } else {
            row(forward, 1.0)
        };
        let focal = 0.5 * height / half;
        let centred = |r: Affine, middle: f64| Affine {
            at0: r.at0 + middle * w.at0,
            along: [0, 1, 2].map(|a| r.along[a] + middle * w.along[a]),
        };
        let (lo, hi) = domain.world_bounds();
        let size = eye.abs().max_element() + lo.abs().max(hi.abs()).max_element() + (hi - lo).length();
        let steps = if parallel {
            focal * size + width + height
        } else {
            (focal + width + height) * size
        };
        let error = 1024.0 * f64::EPSILON * steps;
        // An infinite focal length leaves no number to compare.
        (error < 1e100).then(|| Self {
            x: centred(row(right, focal), 0.5 * width - 0.5),
            y: centred(row(up, -focal), 0.5 * height - 0.5),
            depth: w.slope(0.0, &w),
            w,
            error,
        })
    }

    /// What the box of the given half edges about `c` covers; `None` where it is not in front of the eye.
    #[inline(always)]
    #[must_use]
    pub fn seen(&self, c: [f64; 3], half: f64) -> Option<(Seen, CellSize)> {
        let w = self.w.at(c);
        let least = w - half * GROWN * self.depth;
        if least <= 0.0 || least.is_nan() {
            return None;
        }
        let inv = 1.0 / w;
        let (x, y) = (self.x.at(c) * inv, self.y.at(c) * inv);
        let near = 1.0 / least;
        let slope = [self.x.slope(x, &self.w), self.y.slope(y, &self.w)];
        let pad = PAD + self.error * near;
        let span = |a: usize| half * GROWN * slope[a] * near;
        let cell = |a: usize| 0.5 * GROWN * (slope[a] + span(a) * self.depth) * near + pad;
        Some((
            Seen {
                x,
                y,
                half: [span(0) + pad, span(1) + pad],
            },
            CellSize {
                half: [cell(0), cell(1)],
            },
        ))
    }

    /// What the cell about `c`, one of a brick for which [`Projection::seen`] gave `size`, covers.
    #[inline(always)]
    #[must_use]
    pub fn cell(&self, c: [f64; 3], size: &CellSize) -> Seen {
        let inv = 1.0 / self.w.at(c);
        Seen {
            x: self.x.at(c) * inv,
            y: self.y.at(c) * inv,
            half: size.half,
        }
    }

    /// The pixels whose rays may meet the box `[0, hi]`: least and greatest x and y; `None` where the box is not wholly in front of the eye.
    #[must_use]
    pub fn bounds(&self, hi: [f64; 3]) -> Option<[[f64; 2]; 2]> {
        let mut out = [[f64::INFINITY, f64::NEG_INFINITY]; 2];
        for n in 0..8 {
            let grow = GROWN - 1.0;
            let c: [f64; 3] = std::array::from_fn(|a| if n >> a & 1 == 0 { -grow } else { hi[a] + grow });
            let w = self.w.at(c);
            if w <= 0.0 || w.is_nan() {
                return None;
            }
            let pad = PAD + self.error / w;
            for (o, v) in out.iter_mut().zip([self.x.at(c) / w, self.y.at(c) / w]) {
                *o = [o[0].min(v - pad), o[1].max(v + pad)];
            }
        }
        Some(out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use isobar_core::{Camera, DMat3, Ray};

    /// Whether a ray meets a box of index space, in f64.
    fn meets(ray: &Ray, domain: &Domain, c: [f64; 3], half: f64) -> bool {
        let o = domain.local_vector(ray.origin - domain.origin);
        let d = domain.local_vector(ray.direction);
        let (mut t0, mut t1) = (0.0f64, f64::INFINITY);
        for a in 0..3 {
            let (p, q) = ((c[a] - half - o[a]) / d[a], (c[a] + half - o[a]) / d[a]);
            t0 = t0.max(p.min(q));
            t1 = t1.min(p.max(q));
        }
        t0 <= t1
    }

    /// Every pixel whose ray meets a brick or a cell lies in its rectangle, and the rectangles are not much too large.
    #[test]
    fn rectangles_hold_all_rays_that_meet_the_box() {
        let axes = DMat3::from_rotation_y(0.4) * DMat3::from_diagonal(DVec3::new(0.1, 0.2, 0.15));
        let domain = Domain {
            origin: DVec3::new(-1.0, -2.0, -1.5),
            axes,
            lo: DVec3::ZERO,
            hi: DVec3::splat(20.0),
        };
        let (width, height) = (40, 30);
        let parallel = Camera::Orthographic {
            eye: DVec3::new(3.0, -5.0, 2.0),
            target: DVec3::ZERO,
            up: DVec3::Z,
            height: 5.0,
        };
        let views = [
            View::perspective(DVec3::new(4.0, 3.0, 2.5), DVec3::ZERO, DVec3::Z, 40.0, width, height),
            View::perspective(
                DVec3::new(0.0, -0.5, 0.1),
                DVec3::new(0.3, 1.0, 0.2),
                DVec3::Z,
                70.0,
                width,
                height,
            ),
            View {
                camera: parallel,
                ..View::bench(width, height)
            },
        ];
        let (mut met, mut area, mut unknown) = (0, 0.0, 0);
        for view in views {
            let projection = Projection::new(&view, &domain).unwrap();
            for brick in 0..125 {
                let corner = [brick % 5, brick / 5 % 5, brick / 25].map(|b| f64::from(b) * 4.0);
                let Some((seen, size)) = projection.seen(corner.map(|x| x + 2.0), 2.0) else {
                    unknown += 1;
                    continue;
                };
                let cells = [0.5, 1.5, 3.5].map(|x| (corner.map(|c| c + x), 0.5));
                let boxes = [(corner.map(|x| x + 2.0), 2.0, seen)]
                    .into_iter()
                    .chain(cells.map(|(c, h)| (c, h, projection.cell(c, &size))));
                for (c, half, s) in boxes {
                    area += 4.0 * s.half[0].min(20.0) * s.half[1].min(15.0);
                    for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
                        if meets(&view.ray(x, y), &domain, c, half) {
                            met += 1;
                            let inside = (x as f64 - s.x).abs() <= s.half[0] && (y as f64 - s.y).abs() <= s.half[1];
                            assert!(inside, "pixel ({x}, {y}) sees {c:?} outside {s:?}");
                        }
                    }
                }
            }
        }
        assert!(met > 5000 && area < 20.0 * f64::from(met), "{met} of {area}");
        assert!(unknown > 0 && unknown < 100, "{unknown} bricks beside or behind the eye");
    }
}
