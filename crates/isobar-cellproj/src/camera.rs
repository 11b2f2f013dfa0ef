//! Views as linear maps to the screen, with the bounds that make the signs of edge functions certain.
//!
//! A point becomes homogeneous pixel coordinates `(x, y, w)` about the image's centre: perspective `w` is the depth along the line of sight and the
//! fourth coordinate, the *key*, is 1; orthographic `w` is 1 and the key is minus the depth. Key over w is then affine on the screen on any plane, and
//! **greater means nearer**: the inverse depth, or minus the depth.
//!
//! **Bound.** Let P be a corner minus the eye, |P| at most m over a cell. Each coordinate of a corner carries at most 10 units of rounding of |row| m (the
//! subtraction, three products, and rows that differ from core's by rounding), and the ray's direction, whose bits are what hits are certified
//! for, differs from the pixel's exact one by less than 8 units. A determinant of three vectors, two of them sums of two corners with weights W, is
//! then off by less than 240 units of the product of the lengths; [`UNIT`] is 512 units. Orthographic rays start at rounded points: the
//! length of the eye's position and the half diagonal of the image enter beside m.

use glam::DVec3;
use isobar_core::{Camera, Ray, View};

/// 512 units of rounding.
pub(crate) const UNIT: f64 = 512.0 * (f64::EPSILON / 2.0);

/// A corner on the screen.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Corner {
    /// x, y, w, key.
    pub(crate) h: [f64; 4],
    /// At least |P|.
    pub(crate) size: f64,
}

/// The map of a view, or of a single ray (then an orthographic image of one pixel, lengths in world units).
#[derive(Debug, Clone, Copy)]
pub(crate) struct Projection {
    pub(crate) eye: DVec3,
    /// Per world displacement: pixels right, pixels down, depth.
    pub(crate) rows: [DVec3; 3],
    /// World displacement per pixel right and down: at unit depth (perspective) or anywhere.
    pub(crate) steps: [DVec3; 2],
    /// Greatest length of the direction with depth 1.
    pub(crate) stretch: f64,
    pub(crate) perspective: bool,
    pub(crate) width: usize,
    pub(crate) height: usize,
    /// Factor of the bounds.
    scale: f64,
    pub(crate) reach: [f64; 2],
    /// Pixels per unit of the longer row.
    pixels: f64,
}

impl Projection {
    /// The map of a view; `None` for lists of rays.
    pub(crate) fn new(view: &View) -> Option<Self> {
        let (perspective, eye, target, up, half) = match &view.camera {
            Camera::Rays(_) => return None,
            Camera::Perspective { eye, target, up, fov } => (true, *eye, *target, *up, (fov.to_radians() * 0.5).tan()),
            Camera::Orthographic { eye, target, up, height } => (false, *eye, *target, *up, 0.5 * height),
        };
        let (width, height) = (view.width as f64, view.height as f64);
        let forward = (target - eye).normalize();
        let right = forward.cross(up).normalize();
        let up = right.cross(forward);
        let across = half * width / height;
        let per = [0.5 * width / across, 0.5 * height / half];
        let image = across.hypot(half);
        Some(Self {
            eye,
            rows: [right * per[0], -up * per[1], forward],
            steps: [right / per[0], -up / per[1]],
            stretch: if perspective { 1f64.hypot(image) } else { 1.0 },
            perspective,
            width: view.width,
            height: view.height,
            scale: UNIT * per[0] * per[1] * if perspective { 1f64.hypot(image) } else { 1.0 },
            reach: if perspective {
                [0.0; 2]
            } else {
                [image, image + eye.length()]
            },
            pixels: per[0].max(per[1]),
        })
    }

    /// The map of one ray: its own point is pixel (0, 0).
    pub(crate) fn of_ray(ray: &Ray) -> Self {
        let forward = ray.direction.normalize();
        let right = forward.any_orthonormal_vector();
        Self {
            eye: ray.origin,
            rows: [right, -right.cross(forward), forward],
            steps: [right, -right.cross(forward)],
            stretch: 1.0,
            perspective: false,
            width: 1,
            height: 1,
            scale: UNIT,
            reach: [0.0; 2],
            pixels: 1.0,
        }
    }

    /// A world point.
    #[inline(always)]
    pub(crate) fn corner(&self, p: DVec3) -> Corner {
        let q = p - self.eye;
        let [x, y, z] = self.rows.map(|r| r.x * q.x + r.y * q.y + r.z * q.z);
        let size = q.x.abs() + q.y.abs() + q.z.abs();
        let h = if self.perspective { [x, y, z, 1.0] } else { [x, y, 1.0, -z] };
        Corner { h, size }
    }

    /// Depth along the line of sight.
    pub(crate) fn depth(&self, p: DVec3) -> f64 {
        self.rows[2].dot(p - self.eye)
    }

    /// The centre of pixel (0, 0) in centred pixel coordinates; those of others follow in steps of 1.
    pub(crate) fn first_pixel(&self) -> [f64; 2] {
        [-0.5 * (self.width as f64 - 1.0), -0.5 * (self.height as f64 - 1.0)]
    }

    /// How far an edge function of corners with `size` at most m is off, per product of the two weights.
    #[inline(always)]
    pub(crate) fn edge_bound(&self, m: f64) -> f64 {
        self.scale * (m + self.reach[0]) * (m + self.reach[1])
    }

    /// How far a determinant of three such points is off, per product of the three weights.
    #[inline(always)]
    pub(crate) fn volume_bound(&self, m: f64) -> f64 {
        self.edge_bound(m) * if self.perspective { m } else { 1.0 }
    }

    /// Pixels that a projected point of weight 1 may be off, where `w` is above [`Projection::NEAR`] times m.
    #[inline(always)]
    pub(crate) fn pixel_slack(&self, m: f64) -> f64 {
        let length = if self.perspective {
            1.0 / Self::NEAR
        } else {
            m + self.reach[1]
        };
        1e-4 + UNIT * length * self.pixels
    }

    /// Points with w below this times |P| are treated as if they crossed the eye plane.
    pub(crate) const NEAR: f64 = 1e-5;
}
