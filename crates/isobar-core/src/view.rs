//! Cameras and the rays they mean.

use crate::RenderError;
use glam::DVec3;
use std::sync::Arc;

/// A half line `origin + t * direction`, t >= 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// World position of t = 0.
    pub origin: DVec3,
    /// World direction; unit length (to rounding) except for [`Camera::Rays`].
    pub direction: DVec3,
}

impl Ray {
    /// `origin + t * direction`, rounded.
    #[must_use]
    pub fn at(&self, t: f64) -> DVec3 {
        self.origin + self.direction * t
    }
}

/// Where rays come from.
#[derive(Debug, Clone, PartialEq)]
pub enum Camera {
    /// All rays through the eye.
    Perspective {
        /// World position.
        eye: DVec3,
        /// Point in the middle of the image.
        target: DVec3,
        /// Upward; need not be orthogonal to the line of sight, must not be parallel to it.
        up: DVec3,
        /// Vertical field of view, degrees, in (0, 180).
        fov: f64,
    },
    /// Parallel rays that start on the plane through the eye.
    Orthographic {
        /// World position of the image's centre on the start plane.
        eye: DVec3,
        /// Point in the middle of the image.
        target: DVec3,
        /// Upward.
        up: DVec3,
        /// World height of the image.
        height: f64,
    },
    /// An explicit list: pixel x of row 0. t is in units of the direction given, which need not have unit length.
    Rays(Arc<[Ray]>),
}

/// Points with `normal . x <= distance` are kept.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClipPlane {
    /// World normal, not zero.
    pub normal: DVec3,
    /// Offset along the normal, in units of its length.
    pub distance: f64,
    /// Whether the cut through the solid (values above the isovalue) is closed.
    pub cap: bool,
}

/// Camera, image size and clipping planes.
#[derive(Debug, Clone, PartialEq)]
pub struct View {
    /// The camera.
    pub camera: Camera,
    /// Pixels per row.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// Clipping planes.
    pub clips: Vec<ClipPlane>,
}

/// Makes the rays of a view; [`View::ray`] is this, so the bits are the same.
#[derive(Debug, Clone, Copy)]
pub struct RayGenerator<'a> {
    view: &'a View,
    /// Zero for lists of rays.
    lens: Lens,
}

impl RayGenerator<'_> {
    /// The ray of pixel (x, y); see [`View::ray`].
    ///
    /// # Panics
    /// When `x`, `y` lie outside the image of a list of rays.
    #[must_use]
    #[inline]
    pub fn ray(&self, x: usize, y: usize) -> Ray {
        let v = self.view;
        let b = &self.lens;
        let aspect = v.width as f64 / v.height as f64;
        let sx = (2.0 * (x as f64 + 0.5) / v.width as f64 - 1.0) * b.half * aspect;
        let sy = (1.0 - 2.0 * (y as f64 + 0.5) / v.height as f64) * b.half;
        match &v.camera {
            Camera::Rays(rays) => rays[y * v.width + x],
            Camera::Perspective { .. } => Ray {
                origin: b.eye,
                direction: (b.forward + b.right * sx + b.up * sy).normalize(),
            },
            Camera::Orthographic { .. } => Ray {
                origin: b.eye + b.right * sx + b.up * sy,
                direction: b.forward,
            },
        }
    }
}

impl RayGenerator<'_> {
    /// See [`View::kept`].
    #[must_use]
    #[inline]
    pub fn kept(&self, ray: &Ray) -> Option<(f64, f64)> {
        self.view.kept(ray)
    }
}

/// A camera as [`View::ray`] takes it: its place, an orthonormal frame (to rounding) and half the height of its image.
///
/// The ray through the point (x, y) of the image, both in units of [`half`](Self::half) with y up, has the direction `forward + right * x + up * y` from the eye, or, where rays are
/// parallel, the direction `forward` from `eye + right * x + up * y`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Lens {
    /// World position; of the image's centre on the start plane where rays are parallel.
    pub eye: DVec3,
    /// Right in the image: forward x up.
    pub right: DVec3,
    /// Up in the image.
    pub up: DVec3,
    /// Along the line of sight.
    pub forward: DVec3,
    /// Half the image's height: at unit distance, or in the world where rays are parallel.
    pub half: f64,
    /// Whether rays are.
    pub parallel: bool,
}

impl View {
    /// The bench view of the contract: eye (2.6, 1.9, 2.2), target 0, up +z, field of view 40 degrees.
    #[must_use]
    pub fn bench(width: usize, height: usize) -> Self {
        Self::perspective(DVec3::new(2.6, 1.9, 2.2), DVec3::ZERO, DVec3::Z, 40.0, width, height)
    }

    /// A perspective view without clipping planes.
    #[must_use]
    pub fn perspective(eye: DVec3, target: DVec3, up: DVec3, fov: f64, width: usize, height: usize) -> Self {
        Self {
            camera: Camera::Perspective { eye, target, up, fov },
            width,
            height,
            clips: Vec::new(),
        }
    }

    /// The given rays as a one-row image.
    #[must_use]
    pub fn rays(rays: impl Into<Arc<[Ray]>>) -> Self {
        let rays = rays.into();
        Self {
            width: rays.len(),
            height: 1,
            camera: Camera::Rays(rays),
            clips: Vec::new(),
        }
    }

    /// The contract's default view of the bounds `(min, max)`: from the direction (2.6, 1.9, 2.2), far enough that the bounding sphere fits.
    #[must_use]
    pub fn fit(bounds: (DVec3, DVec3), fov: f64, width: usize, height: usize) -> Self {
        Self::fit_from(bounds, DVec3::new(2.6, 1.9, 2.2), DVec3::Z, fov, width, height)
    }

    /// As [`View::fit`], from the side `from`.
    #[must_use]
    pub fn fit_from(bounds: (DVec3, DVec3), from: DVec3, up: DVec3, fov: f64, width: usize, height: usize) -> Self {
        let centre = (bounds.0 + bounds.1) * 0.5;
        let radius = (bounds.1 - bounds.0).length() * 0.5;
        let eye = centre + from.normalize() * (radius / (fov.to_radians() * 0.5).sin());
        Self::perspective(eye, centre, up, fov, width, height)
    }

    /// Number of pixels.
    #[must_use]
    pub fn pixels(&self) -> usize {
        self.width * self.height
    }

    /// Checks that the view has pixels and a direction, and that its numbers are finite.
    ///
    /// # Errors
    /// [`RenderError::View`] with what is wrong and which flag to change.
    pub fn validate(&self) -> Result<(), RenderError> {
        let bad = |s: &str| Err(RenderError::View(s.to_owned()));
        if self.width == 0 || self.height == 0 {
            return bad("the image has no pixels; give --size WxH with both above 0");
        }
        if self.width > 65_536 || self.height > 1 << 26 || self.width.saturating_mul(self.height) > 1 << 28 {
            return bad("the image is larger than 65536 wide or 2^28 pixels; give a smaller --size");
        }
        if self
            .clips
            .iter()
            .any(|c| !c.normal.is_finite() || !c.distance.is_finite() || c.normal == DVec3::ZERO)
        {
            return bad("a clipping plane needs four finite numbers and a normal that is not zero (--clip nx,ny,nz,d)");
        }
        let (eye, target, up) = match &self.camera {
            Camera::Rays(rays) => {
                if rays.len() != self.pixels() {
                    return bad("the number of rays is not the number of pixels");
                }
                return if rays
                    .iter()
                    .all(|r| r.origin.is_finite() && r.direction.is_finite() && r.direction != DVec3::ZERO)
                {
                    Ok(())
                } else {
                    bad("a ray has a zero direction or numbers that are not finite")
                };
            }
            Camera::Perspective { eye, target, up, fov } => {
                if !(*fov > 0.0 && *fov < 180.0) {
                    return bad("--fov must lie between 0 and 180 degrees");
                }
                (eye, target, up)
            }
            Camera::Orthographic { eye, target, up, height } => {
                if !(*height > 0.0 && height.is_finite()) {
                    return bad("--ortho needs a positive height");
                }
                (eye, target, up)
            }
        };
        if !(eye.is_finite() && target.is_finite() && up.is_finite()) {
            return bad("--eye, --target and --up must be finite");
        }
        let forward = *target - *eye;
        if forward.length() == 0.0 || !forward.length().is_finite() {
            return bad("--eye and --target are the same point or too far apart");
        }
        if forward.normalize().cross(up.normalize_or_zero()).length() < 1e-12 {
            return bad("--up is zero or parallel to the line of sight");
        }
        Ok(())
    }

    /// The world-space ray of pixel (x, y), y down. The pixel's centre is at ((x + .5) / width, (y + .5) / height) of the image.
    /// Certificates speak of exactly the bits returned here.
    ///
    /// # Panics
    /// When `x`, `y` lie outside the image of a list of rays.
    #[must_use]
    pub fn ray(&self, x: usize, y: usize) -> Ray {
        self.generator().ray(x, y)
    }

    /// The part of a ray that the clipping planes keep: first and last t with t >= 0, infinite where nothing ends it; `None` where nothing is
    /// kept. The ends are rounded: each is off by some roundings of the terms of `(distance - normal . origin) / (normal . direction)`.
    /// Caps are not considered.
    #[must_use]
    #[inline]
    pub fn kept(&self, ray: &Ray) -> Option<(f64, f64)> {
        let (mut first, mut last) = (0.0f64, f64::INFINITY);
        for plane in &self.clips {
            let rest = plane.distance - plane.normal.dot(ray.origin);
            let rate = plane.normal.dot(ray.direction);
            if rate == 0.0 {
                if rest < 0.0 {
                    return None;
                }
            } else if rate > 0.0 {
                last = last.min(rest / rate);
            } else {
                first = first.max(rest / rate);
            }
        }
        (first <= last).then_some((first, last))
    }

    /// What all pixels share, worked out once: for loops over pixels.
    #[must_use]
    pub fn generator(&self) -> RayGenerator<'_> {
        let none = Lens {
            eye: DVec3::ZERO,
            right: DVec3::ZERO,
            up: DVec3::ZERO,
            forward: DVec3::ZERO,
            half: 0.0,
            parallel: false,
        };
        RayGenerator {
            view: self,
            lens: self.lens().unwrap_or(none),
        }
    }

    /// The camera's frame, to the bits that [`View::ray`] uses; `None` for lists of rays.
    #[must_use]
    pub fn lens(&self) -> Option<Lens> {
        let (eye, target, up, half, parallel) = match self.camera {
            Camera::Rays(_) => return None,
            Camera::Perspective { eye, target, up, fov } => (eye, target, up, (fov.to_radians() * 0.5).tan(), false),
            Camera::Orthographic { eye, target, up, height } => (eye, target, up, 0.5 * height, true),
        };
        let forward = (target - eye).normalize();
        let right = forward.cross(up).normalize();
        Some(Lens {
            eye,
            right,
            up: right.cross(forward),
            forward,
            half,
            parallel,
        })
    }

    /// World size of a pixel at distance t along its ray: the footprint errors are compared with. 0 for lists of rays.
    #[must_use]
    pub fn footprint(&self, t: f64) -> f64 {
        match &self.camera {
            Camera::Rays(_) => 0.0,
            Camera::Perspective { fov, .. } => 2.0 * (fov.to_radians() * 0.5).tan() * t / self.height as f64,
            Camera::Orthographic { height, .. } => height / self.height as f64,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_middle_looks_at_the_target_and_y_points_down() {
        let v = View::bench(1024, 768);
        let a = v.ray(511, 383).direction;
        let b = v.ray(512, 384).direction;
        let f = (DVec3::ZERO - DVec3::new(2.6, 1.9, 2.2)).normalize();
        assert!(((a + b).normalize() - f).length() < 1e-12);
        assert!(v.ray(512, 0).direction.z > v.ray(512, 767).direction.z);
        // half the vertical field of view, to half a pixel
        let top = View::perspective(DVec3::ZERO, DVec3::Y, DVec3::Z, 40.0, 1, 100_000)
            .ray(0, 0)
            .direction;
        assert!((top.z.atan2(top.y).to_degrees() - 20.0).abs() < 1e-3);
        // looking along +y with z up, right is +x
        assert!(
            View::perspective(DVec3::ZERO, DVec3::Y, DVec3::Z, 40.0, 10, 10)
                .ray(9, 5)
                .direction
                .x
                > 0.0
        );
    }

    #[test]
    fn orthographic_rays_start_on_the_eye_plane() {
        let v = View {
            camera: Camera::Orthographic {
                eye: DVec3::new(0.0, -3.0, 0.0),
                target: DVec3::ZERO,
                up: DVec3::Z,
                height: 2.0,
            },
            width: 4,
            height: 2,
            clips: vec![],
        };
        let r = v.ray(0, 0);
        assert!((r.origin - DVec3::new(-1.5, -3.0, 0.5)).length() < 1e-15);
        assert_eq!(r.direction, DVec3::Y);
    }

    #[test]
    fn planes_keep_an_interval_of_the_ray() {
        let mut v = View::bench(4, 3);
        let ray = Ray {
            origin: DVec3::new(-3.0, 0.0, 0.0),
            direction: DVec3::new(2.0, 0.0, 0.0),
        };
        let mut with = |planes: &[([f64; 3], f64)]| {
            v.clips = planes
                .iter()
                .map(|&(normal, distance)| ClipPlane {
                    normal: normal.into(),
                    distance,
                    cap: false,
                })
                .collect();
            assert_eq!(v.kept(&ray), v.generator().kept(&ray));
            v.kept(&ray)
        };
        assert_eq!(with(&[]), Some((0.0, f64::INFINITY)));
        assert_eq!(with(&[([1.0, 0.0, 0.0], 1.0)]), Some((0.0, 2.0)));
        assert_eq!(with(&[([1.0, 0.0, 0.0], 1.0), ([-2.0, 0.0, 0.0], 2.0)]), Some((1.0, 2.0)));
        assert_eq!(with(&[([1.0, 0.0, 0.0], -4.0)]), None);
        assert_eq!(with(&[([0.0, 1.0, 0.0], 0.0)]), Some((0.0, f64::INFINITY)));
        assert_eq!(with(&[([0.0, 1.0, 0.0], -1e-9)]), None);
        assert_eq!(with(&[([-1.0, 0.0, 0.0], 0.0), ([1.0, 0.0, 0.0], -1.0)]), None);
    }

    #[test]
    fn useless_views_are_refused() {
        let ok = View::bench(4, 3);
        assert!(ok.validate().is_ok());
        let with = |f: &dyn Fn(&mut View)| {
            let mut v = ok.clone();
            f(&mut v);
            v.validate()
        };
        assert!(with(&|v| v.width = 0).is_err());
        assert!(
            with(&|v| v.camera = Camera::Perspective {
                eye: DVec3::Z,
                target: DVec3::ZERO,
                up: DVec3::Z,
                fov: 40.0
            })
            .is_err()
        );
        assert!(
            with(&|v| v.camera = Camera::Perspective {
                eye: DVec3::X,
                target: DVec3::X,
                up: DVec3::Z,
                fov: 40.0
            })
            .is_err()
        );
        assert!(
            with(&|v| v.camera = Camera::Perspective {
                eye: DVec3::X,
                target: DVec3::ZERO,
                up: DVec3::Z,
                fov: 180.0
            })
            .is_err()
        );
        assert!(
            with(&|v| v.camera = Camera::Perspective {
                eye: DVec3::NAN,
                target: DVec3::ZERO,
                up: DVec3::Z,
                fov: 40.0
            })
            .is_err()
        );
        assert!(
            with(&|v| {
                v.width = usize::MAX / 2;
                v.height = 4;
            })
            .is_err()
        );
    }
}
