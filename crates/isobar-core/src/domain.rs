//! The closed parallelepiped a function lives on.

use glam::{DMat3, DVec3};

/// World and local coordinates, and the closed local box.
///
/// A world point is `x = origin + axes * u` with local coordinates `u`, `lo <= u <= hi`. For a grid `u` is the index
/// space (sample (i,j,k) at u = (i,j,k), `lo` = 0, `hi` = dims - 1) and column `a` of `axes` is `direction.col(a) * spacing[a]`, rounded
/// once to f64. These f64 bits *are* the map: the inverse is the exact rational one, of which [`Domain::local`] returns a rounded value.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Domain {
    /// World position of u = 0.
    pub origin: DVec3,
    /// Columns: world displacement of one unit of each local axis.
    pub axes: DMat3,
    /// Lower local corner.
    pub lo: DVec3,
    /// Upper local corner.
    pub hi: DVec3,
}

impl Domain {
    /// World coordinates are the local ones: the box `[lo, hi]` of an analytic field.
    #[must_use]
    pub const fn world_box(lo: DVec3, hi: DVec3) -> Self {
        Self {
            origin: DVec3::ZERO,
            axes: DMat3::IDENTITY,
            lo,
            hi,
        }
    }

    /// Whether `axes` has zeros exactly off the diagonal, so that each local axis follows one world axis.
    #[must_use]
    pub fn is_axis_aligned(&self) -> bool {
        let a = self.axes;
        [a.x_axis.y, a.x_axis.z, a.y_axis.x, a.y_axis.z, a.z_axis.x, a.z_axis.y]
            .iter()
            .all(|&v| v == 0.0)
    }

    /// World position of local `u`, rounded.
    #[must_use]
    pub fn world(&self, u: DVec3) -> DVec3 {
        self.origin + self.axes * u
    }

    /// Local coordinates of world `x`, rounded (relative error a few ulps of the largest term).
    #[must_use]
    pub fn local(&self, x: DVec3) -> DVec3 {
        self.local_vector(x - self.origin)
    }

    /// Local components of a world displacement, rounded.
    #[must_use]
    pub fn local_vector(&self, v: DVec3) -> DVec3 {
        if self.is_axis_aligned() {
            v / DVec3::new(self.axes.x_axis.x, self.axes.y_axis.y, self.axes.z_axis.z)
        } else {
            self.axes.inverse() * v
        }
    }

    /// World gradient from the local one: `axes^-T * g`.
    #[must_use]
    pub fn world_gradient(&self, g: DVec3) -> DVec3 {
        if self.is_axis_aligned() {
            g / DVec3::new(self.axes.x_axis.x, self.axes.y_axis.y, self.axes.z_axis.z)
        } else {
            self.axes.inverse().transpose() * g
        }
    }

    /// The eight corners in the world, x fastest.
    #[must_use]
    pub fn corners(&self) -> [DVec3; 8] {
        std::array::from_fn(|n| {
            let pick = |bit: usize, lo: f64, hi: f64| if n >> bit & 1 == 0 { lo } else { hi };
            self.world(DVec3::new(
                pick(0, self.lo.x, self.hi.x),
                pick(1, self.lo.y, self.hi.y),
                pick(2, self.lo.z, self.hi.z),
            ))
        })
    }

    /// World axis-aligned bounds `(min, max)`.
    #[must_use]
    pub fn world_bounds(&self) -> (DVec3, DVec3) {
        let c = self.corners();
        c[1..].iter().fold((c[0], c[0]), |(lo, hi), &p| (lo.min(p), hi.max(p)))
    }

    /// Geometric mean edge length of one local unit (the voxel), in world units: the length errors are counted in.
    #[must_use]
    pub fn voxel(&self) -> f64 {
        let lengths = [self.axes.x_axis, self.axes.y_axis, self.axes.z_axis].map(DVec3::length);
        // Relative to the longest: the product of three lengths below 1e-103 or above 1e102 is none.
        let longest = lengths.into_iter().fold(0.0, f64::max);
        if longest == 0.0 {
            return 0.0;
        }
        longest * lengths.into_iter().map(|x| x / longest).product::<f64>().cbrt()
    }

    /// The part `[t0, t1]`, `t >= 0`, of a ray inside the box in f64, or `None`. No guarantee: rounding may move the ends by a few
    /// ulps, and a ray that only touches the box may be lost or kept.
    #[must_use]
    pub fn clip(&self, ray: &crate::Ray) -> Option<(f64, f64)> {
        let o = self.local(ray.origin);
        let d = self.local_vector(ray.direction);
        let (mut t0, mut t1) = (0.0f64, f64::INFINITY);
        for a in 0..3 {
            if d[a] == 0.0 {
                if o[a] < self.lo[a] || o[a] > self.hi[a] {
                    return None;
                }
                continue;
            }
            let (a0, a1) = ((self.lo[a] - o[a]) / d[a], (self.hi[a] - o[a]) / d[a]);
            t0 = t0.max(a0.min(a1));
            t1 = t1.min(a0.max(a1));
        }
        (t0 <= t1).then_some((t0, t1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn local_inverts_world() {
        let d = Domain {
            origin: DVec3::new(1.0, -2.0, 3.0),
            axes: DMat3::from_cols(
                DVec3::new(0.0, 2.0, 0.0),
                DVec3::new(-3.0, 0.0, 0.5),
                DVec3::new(0.0, 0.25, 1.5),
            ),
            lo: DVec3::ZERO,
            hi: DVec3::new(3.0, 4.0, 5.0),
        };
        let u = DVec3::new(0.5, 1.25, 4.0);
        assert!((d.local(d.world(u)) - u).length() < 1e-14);
        // grad of f(x) = u.x is row 0 of the inverse
        let g = d.world_gradient(DVec3::X);
        assert!((g.dot(d.axes.x_axis) - 1.0).abs() < 1e-14 && g.dot(d.axes.y_axis).abs() < 1e-14);
    }

    #[test]
    fn a_voxel_has_a_length_at_any_scale() {
        for scale in [1e-120, 1e-30, 1.0, 1e30, 1e120] {
            let domain = Domain {
                axes: DMat3::from_diagonal(DVec3::new(scale, 8.0 * scale, scale)),
                ..Domain::world_box(DVec3::ZERO, DVec3::ONE)
            };
            assert!((domain.voxel() / scale - 2.0).abs() < 1e-14, "{scale}: {}", domain.voxel());
        }
    }

    #[test]
    fn clip_cuts_at_zero_and_at_the_faces() {
        let d = Domain::world_box(DVec3::splat(-1.0), DVec3::splat(1.0));
        let ray = |o, v| crate::Ray { origin: o, direction: v };
        assert_eq!(d.clip(&ray(DVec3::new(-3.0, 0.0, 0.0), DVec3::X)), Some((2.0, 4.0)));
        assert_eq!(d.clip(&ray(DVec3::ZERO, DVec3::X)), Some((0.0, 1.0)));
        assert_eq!(d.clip(&ray(DVec3::new(-3.0, 2.0, 0.0), DVec3::X)), None);
        assert_eq!(d.clip(&ray(DVec3::new(3.0, 0.0, 0.0), DVec3::X)), None);
        assert_eq!(d.clip(&ray(DVec3::new(-3.0, 1.0, 0.0), DVec3::X)), Some((2.0, 4.0)));
    }
}
