//! What open clipping planes leave of a ray, with what rounding can hide.
//!
//! The planes' parameters are rounded, and a hit within their error of a cut is kept or lost by chance. So the kept part is known three times: as rounded, which is
//! what is drawn; so large that no kept point is lost; and so small that every point of it is kept. Between the last two the sign of the field is in doubt, as it is at the faces of the
//! domain, and what is found there is drawn but not proved.

use glam::DVec3;
use isobar_core::{ClipPlane, Ray};

/// Unit roundoff of f64.
const U: f64 = 0.5 * f64::EPSILON;

/// Which of the three parts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// As rounded: what is drawn.
    Rounded,
    /// Holds every kept point.
    Outer,
    /// Holds kept points alone.
    Inner,
}

/// No point of a box of the world lies further along the ray than half of this: the other half is for what is rounded, and for directions that are not of length one.
#[inline]
#[must_use]
pub fn reach(ray: &Ray, (lo, hi): (DVec3, DVec3)) -> f64 {
    2.0 * (ray.origin - lo).abs().max((ray.origin - hi).abs()).length() / ray.direction.length()
}

/// First and last t >= 0 that all planes keep; nothing is kept where the first is the greater. `reach`: at least twice the greatest t that matters, which leaves the branch for
/// planes along the ray its room.
///
/// The distance left to a plane at t is `rest + t rate` with the rate towards it negative. In exact arithmetic rest is `distance - normal . origin`, rounded by at most 5u (|distance| +
/// |normal| . |origin|), and t rate is rounded by at most 4u t |normal| . |direction|: 16u of the sum leaves room for the division.
#[inline]
#[must_use]
pub fn kept(ray: &Ray, clips: &[ClipPlane], reach: f64, side: Side) -> (f64, f64) {
    let nothing = (f64::INFINITY, f64::NEG_INFINITY);
    let (mut first, mut last) = (0.0f64, f64::INFINITY);
    for c in clips {
        let n = c.normal.abs();
        let size = c.distance.abs() + n.dot(ray.origin.abs()) + n.dot(ray.direction.abs()) * reach;
        let hidden = match side {
            Side::Rounded => 0.0,
            Side::Outer => 16.0 * U * size,
            Side::Inner => -16.0 * U * size,
        };
        if !hidden.is_finite() {
            // Of such numbers nothing is known.
            if side == Side::Inner {
                return nothing;
            }
            continue;
        }
        let rate = c.normal.dot(ray.direction);
        let rest = c.distance - c.normal.dot(ray.origin) + hidden;
        if rate == 0.0 || side != Side::Rounded && rate.abs() * reach <= hidden.abs() {
            if rest < 0.0 {
                return nothing;
            }
        } else if rate > 0.0 {
            last = last.min(rest / rate);
        } else {
            first = first.max(rest / rate);
        }
    }
    (first, last)
}

#[cfg(test)]
mod tests {
    use super::*;
    use isobar_core::View;

    fn plane(normal: DVec3, distance: f64) -> ClipPlane {
        ClipPlane {
            normal,
            distance,
            cap: false,
        }
    }

    #[test]
    fn the_rounded_part_lies_between_the_other_two() {
        let ray = Ray {
            origin: DVec3::new(-3.0, 0.1, 0.2),
            direction: DVec3::new(1.0, 0.3, -0.2),
        };
        let view = View {
            clips: vec![plane(DVec3::new(1.0, 0.2, 0.1), 0.3), plane(DVec3::new(-2.0, 0.0, 1.0), 5.0)],
            ..View::bench(2, 2)
        };
        let at = |side| kept(&ray, &view.clips, 10.0, side);
        assert_eq!(Some(at(Side::Rounded)), view.kept(&ray));
        let ((a, b), (c, d), (e, f)) = (at(Side::Outer), at(Side::Rounded), at(Side::Inner));
        assert!(a < c && c < e && f < d && d < b && b - f < 1e-13 && e - a < 1e-13);
    }

    /// Along a plane: inside, on it, outside. On it nothing is certain.
    #[test]
    fn a_ray_in_the_plane_is_kept_but_not_for_certain() {
        for (y, want) in [
            (0.5, [true, true, true]),
            (1.0, [true, true, false]),
            (1.5, [false, false, false]),
        ] {
            let ray = Ray {
                origin: DVec3::new(0.0, y, 0.0),
                direction: DVec3::X,
            };
            let got = [Side::Outer, Side::Rounded, Side::Inner].map(|s| {
                let (a, b) = kept(&ray, &[plane(DVec3::Y, 1.0)], 10.0, s);
                a <= b
            });
            assert_eq!(got, want, "{y}");
        }
    }

    #[test]
    fn numbers_beyond_all_bounds_cut_nothing_and_prove_nothing() {
        let far = [plane(DVec3::splat(1e300), 1e300)];
        let ray = Ray {
            origin: DVec3::splat(1e200),
            direction: DVec3::X,
        };
        assert_eq!(kept(&ray, &far, 1.0, Side::Outer), (0.0, f64::INFINITY));
        assert!(kept(&ray, &far, 1.0, Side::Inner).0 > 0.0);
    }
}
