//! What clipping planes leave of a ray, with what rounding can hide.

use isobar_core::{ClipPlane, Ray};

/// Unit roundoff of f64.
const U: f64 = 0.5 * f64::EPSILON;

/// Least and greatest t >= 0 that all planes keep, as `View::kept` has it; nothing is kept where the first is the greater.
///
/// `side` 0: as rounded. `side` 1: planes so far out that no kept point is lost, -1: so far in that every point is kept, for t up to `reach`. With f the distance
/// left to a plane, rest + t rate in exact arithmetic, rest is rounded by at most 5u (|distance| + |normal| . |origin|) and t rate by at most 4u t |normal| . |direction|:
/// 16u of the sum leaves room for the division.
#[inline]
pub(crate) fn kept(ray: &Ray, clips: &[ClipPlane], reach: f64, side: f64) -> (f64, f64) {
    let (mut first, mut last) = (0.0f64, f64::INFINITY);
    for c in clips {
        let n = c.normal.abs();
        let size = c.distance.abs() + n.dot(ray.origin.abs()) + n.dot(ray.direction.abs()) * reach;
        let hidden = 16.0 * U * size;
        if side != 0.0 && !hidden.is_finite() {
            if side < 0.0 {
                return (f64::INFINITY, f64::NEG_INFINITY);
            }
            continue;
        }
        let rate = c.normal.dot(ray.direction);
        let mut rest = c.distance - c.normal.dot(ray.origin);
        if side != 0.0 {
            rest += side * hidden;
        }
        if rate == 0.0 || (side != 0.0 && rate.abs() * reach <= hidden) {
            if rest < 0.0 {
                return (f64::INFINITY, f64::NEG_INFINITY);
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
    use crate::OCTREE_CPU;
    use isobar_core::{Channels, DVec3, Data, Frame, Knobs, Method, Request, Stage, Stop, Surface, View};
    use isobar_fields::{Kind, Synthetic};
    use isobar_oracle::{Truth, check};
    use std::sync::Arc;

    fn plane(normal: DVec3, distance: f64) -> ClipPlane {
        ClipPlane {
            normal,
            distance,
            cap: false,
        }
    }

    #[test]
    fn the_cut_lies_between_its_bounds() {
        let ray = Ray {
            origin: DVec3::new(-3.0, 0.1, 0.2),
            direction: DVec3::new(1.0, 0.3, -0.2),
        };
        let view = View {
            clips: vec![plane(DVec3::new(1.0, 0.2, 0.1), 0.3), plane(DVec3::new(-2.0, 0.0, 1.0), 5.0)],
            ..View::bench(2, 2)
        };
        let at = |side| kept(&ray, &view.clips, 10.0, side);
        assert_eq!(Some(at(0.0)), view.kept(&ray));
        let ((a, b), (c, d), (e, f)) = (at(1.0), at(0.0), at(-1.0));
        assert!(a < c && c < e && f < d && d < b && b - f < 1e-13 && e - a < 1e-13);
        // Along a plane, inside, on it, outside: on it nothing is certain.
        for (y, want) in [
            (0.5, [true, true, true]),
            (1.0, [true, true, false]),
            (1.5, [false, false, false]),
        ] {
            let ray = Ray {
                origin: DVec3::new(0.0, y, 0.0),
                direction: DVec3::X,
            };
            let got = [1.0, 0.0, -1.0].map(|s| {
                let (a, b) = kept(&ray, &[plane(DVec3::Y, 1.0)], 10.0, s);
                a <= b
            });
            assert_eq!(got, want, "{y}");
        }
        let far = [plane(DVec3::splat(1e300), 1e300)];
        let ray = Ray {
            origin: DVec3::splat(1e200),
            direction: DVec3::X,
        };
        assert_eq!(kept(&ray, &far, 1.0, 1.0), (0.0, f64::INFINITY));
        assert!(kept(&ray, &far, 1.0, -1.0).0 > 0.0);
    }

    /// Every kind, in packets and ray by ray, against the oracle's clipped truth; with a plane through samples and one that grazes rays.
    #[test]
    fn open_cuts_are_those_of_the_oracle() {
        let data: Data = "gyroid,n=24".parse::<Synthetic>().unwrap().data().unwrap();
        let data = Arc::new(data);
        let surfaces = [Surface::isovalue(0.2, 0)];
        let mut view = View::bench(96, 72);
        let middle = view.ray(48, 36);
        let across = middle.direction.cross(DVec3::Z);
        view.clips = vec![
            plane(DVec3::new(1.0, 0.2, 0.1), 0.3),
            plane(DVec3::new(0.0, 0.0, -2.0), 1.0 / 3.0),
            plane(across, across.dot(middle.origin) + 0.4),
        ];
        for kind in Kind::ALL {
            let draw = |channels, layers| {
                let request = Request {
                    channels,
                    layers,
                    knobs: Knobs::default().with("reconstruction", kind.name()),
                    ..Request::default()
                };
                let mut r = OCTREE_CPU.open(&request).unwrap();
                r.set_data(&data).unwrap();
                r.set_surfaces(&surfaces).unwrap();
                r.set_view(&view).unwrap();
                r.render(&Stop::default()).unwrap();
                let mut f = Frame::default();
                r.read(&mut f).unwrap();
                (f, r.reconstruction(Stage::Stored).unwrap())
            };
            let (packets, f) = draw(Channels::all() - Channels::HITS, 1);
            let (alone, _) = draw(Channels::all(), 1);
            let truth = Truth::compute(&f, &surfaces, &view, &Stop::default()).unwrap();
            assert!(truth.hits() > 1000, "{kind}: {}", truth.hits());
            for frame in [&packets, &alone] {
                let c = check(frame, &truth, &f, &surfaces, &view).unwrap();
                let wrong = (c.missed, c.false_hits, c.wrong_root, c.wrong_surface, c.refuted, c.unclaimed);
                assert_eq!(wrong, (0, 0, 0, 0, 0, 0), "{kind}");
            }
            for (a, b) in packets.t.iter().zip(&alone.t) {
                assert!(a == b || (a - b).abs() < 1e-8, "{kind}: {a} and {b}");
            }
        }
    }
}
