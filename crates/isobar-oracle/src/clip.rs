//! The part of a ray that clipping planes keep.
//!
//! A plane keeps `n . x <= d`, so of the ray `o + t v` it keeps `t <= T` or `t >= T` with `T = (d - n . o)/(n . v)`, or all or nothing where
//! `n . v = 0`. All of it is decided on the bits of plane and ray taken as exact numbers, so the kept part is a closed interval with
//! rational ends, and to the search it is what the stay in the domain is: a root exactly on a plane counts, and the undecidable flag treats an end
//! made by a plane as one made by the domain's faces.

use crate::exact::{Dyadic, ExactRay, Ratio};
use crate::map::Mapped;
use isobar_core::{ClipPlane, DVec3, Ray};

/// How far f64 arithmetic may put a plane's crossing from where it is, relative to the sizes of its terms: some 10^4 roundings.
const ROUNDED: f64 = 1e-12;

/// The kept part of a ray: `t` in `[first, last]`.
#[derive(Clone, Debug)]
pub(crate) struct Kept {
    /// `None`: from the start of the ray on.
    first: Option<Ratio>,
    /// `None`: without end.
    last: Option<Ratio>,
    nothing: bool,
    /// Whether the ray runs so nearly along a plane that rounding in f64 moves the crossing farther than the distance given to
    /// [`Kept::new`], or turns all into nothing.
    pub(crate) grazes: bool,
}

impl Kept {
    /// What all planes keep of a ray of finite numbers; `fine` is the length that makes a crossing doubtful, in units of t.
    pub(crate) fn new(ray: &Ray, clips: &[ClipPlane], fine: f64) -> Self {
        let mut kept = Self {
            first: None,
            last: None,
            nothing: false,
            grazes: false,
        };
        for plane in clips {
            kept.cut(ray, plane, fine);
        }
        kept.nothing |= match (&kept.first, &kept.last) {
            (Some(a), Some(b)) => a.compare(b).is_gt(),
            (None, Some(b)) => b.compare(&Ratio::from_f64(0.0)).is_lt(),
            _ => false,
        };
        kept
    }

    fn cut(&mut self, ray: &Ray, plane: &ClipPlane, fine: f64) {
        let rest = Dyadic::from_f64(plane.distance).plus(&dot(plane.normal, ray.origin).negated());
        let rate = dot(plane.normal, ray.direction);
        let size = plane.distance.abs() + plane.normal.abs().dot(ray.origin.abs());
        if rate.sign() == 0 {
            self.nothing |= rest.sign() < 0;
            let left = plane.normal.dot(ray.origin) - plane.distance;
            self.grazes |= left.abs() <= ROUNDED * size;
            return;
        }
        let t = rest.over(&rate);
        let (lo, hi) = t.bounds();
        let speed = plane.normal.dot(ray.direction).abs();
        let reach = lo.abs().max(hi.abs());
        let doubt = ROUNDED * (size + reach * plane.normal.abs().dot(ray.direction.abs())) / speed;
        // Not beside the ray altogether (a comparison that NaN fails counts as doubtful).
        self.grazes |= !(doubt <= fine || hi + doubt < 0.0);
        if rate.sign() > 0 {
            self.last = Some(match self.last.take() {
                Some(b) => b.min(t),
                None => t,
            });
        } else if hi > 0.0 {
            self.first = Some(match self.first.take() {
                Some(a) => a.max(t),
                None => t,
            });
        }
    }

    /// Whether nothing is kept.
    pub(crate) fn is_nothing(&self) -> bool {
        self.nothing
    }

    /// The same stay in the domain, as far as it is kept.
    pub(crate) fn narrow(&self, mapped: Mapped) -> Mapped {
        let Mapped::Ray(mut map) = mapped else { return mapped };
        // The difference rounds by at most half an ulp, which the step to the next f64 covers.
        let s = |(lo, hi): (f64, f64)| ((lo - map.t_ref).next_down(), (hi - map.t_ref).next_up());
        if let Some(a) = &self.first {
            let (lo, hi) = s(a.bounds());
            map.start = (map.start.0.max(lo), map.start.1.max(hi));
        }
        if let Some(b) = &self.last {
            let (lo, hi) = s(b.bounds());
            map.end = (map.end.0.min(lo), map.end.1.min(hi));
        }
        if map.start.0 > map.end.1 {
            Mapped::Outside
        } else {
            Mapped::Ray(map)
        }
    }

    /// The same in integers.
    pub(crate) fn narrow_exactly(&self, ray: &mut ExactRay) {
        let Some((mut t0, mut t1)) = ray.stay.take() else { return };
        if let Some(a) = &self.first {
            t0 = t0.max(a.clone());
        }
        if let Some(b) = &self.last {
            t1 = t1.min(b.clone());
        }
        ray.stay = t0.compare(&t1).is_le().then_some((t0, t1));
    }
}

fn dot(a: DVec3, b: DVec3) -> Dyadic {
    let products = (0..3).map(|i| Dyadic::from_f64(a[i]).times(&Dyadic::from_f64(b[i])));
    products.fold(Dyadic::from_f64(0.0), |s, x| s.plus(&x))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plane(normal: [f64; 3], distance: f64) -> ClipPlane {
        ClipPlane {
            normal: normal.into(),
            distance,
            cap: false,
        }
    }

    #[test]
    fn the_ends_are_exact_fractions_and_planes_intersect() {
        let ray = Ray {
            origin: DVec3::new(1.0, 0.0, 0.0),
            direction: DVec3::new(3.0, 0.0, 0.0),
        };
        // x <= 2, x >= 1.5, x >= 1.25; y <= 0 runs along the ray
        let clips = [
            plane([1.0, 0.0, 0.0], 2.0),
            plane([-2.0, 0.0, 0.0], -3.0),
            plane([-1.0, 0.0, 0.0], -1.25),
        ];
        let k = Kept::new(&ray, &clips, 1e-9);
        let third = 1.0 / 3.0;
        let (a, b) = (k.first.as_ref().unwrap().bounds(), k.last.as_ref().unwrap().bounds());
        assert!(a.0 <= third / 2.0 && third / 2.0 <= a.1 && b.0 <= third && third <= b.1 && b.1 == b.0.next_up());
        assert!(!k.is_nothing() && !k.grazes);
        let along = Kept::new(&ray, &[plane([0.0, 1.0, 0.0], 0.0)], 1e-9);
        assert!(!along.is_nothing() && along.grazes);
        let beside = Kept::new(&ray, &[plane([0.0, 1.0, 0.0], -0.5)], 1e-9);
        assert!(beside.is_nothing() && !beside.grazes);
        assert!(Kept::new(&ray, &[plane([1.0, 0.0, 0.0], 0.5)], 1e-9).is_nothing());
        // one point is kept
        assert!(!Kept::new(&ray, &[plane([1.0, 0.0, 0.0], 1.0)], 1e-9).is_nothing());
        assert!(!Kept::new(&ray, &[plane([1.0, 0.0, 0.0], 1.5), clips[1]], 1e-9).is_nothing());
        // a plane hardly leaning against the ray, where n . o cannot be told from d
        let above = Ray {
            origin: DVec3::new(1.0, 1.0, 0.0),
            ..ray
        };
        assert!(Kept::new(&above, &[plane([1e-14, 1.0, 0.0], 1.0 + 1e-14)], 1e-9).grazes);
        assert!(!Kept::new(&above, &[plane([1e-2, 1.0, 0.0], 1.02)], 1e-9).grazes);
    }
}
