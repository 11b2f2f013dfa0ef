//! Rays from the view to index space, in f64; what goes to the device starts at the entry into the domain.

use super::layout::Ray;
use isobar_core::{DMat3, DVec3, Domain, View};
use rayon::prelude::*;

/// World to index space.
#[derive(Debug, Clone, Copy)]
pub(super) struct ToIndex {
    origin: DVec3,
    inverse: DMat3,
    /// Steps of each index where the axes are the world's: dividing by them rounds once.
    diagonal: Option<DVec3>,
    axes: DMat3,
    last: DVec3,
}

/// Where a ray enters, and how fast it goes: `t = entry + u / speed`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Entry {
    pub(super) t: f64,
    /// Voxels per unit of t.
    pub(super) speed: f64,
}

impl ToIndex {
    pub(super) fn new(domain: &Domain) -> Self {
        let a = domain.axes;
        Self {
            origin: domain.origin,
            inverse: a.inverse(),
            diagonal: domain
                .is_axis_aligned()
                .then(|| DVec3::new(a.x_axis.x, a.y_axis.y, a.z_axis.z)),
            axes: a,
            last: domain.hi,
        }
    }

    fn vector(&self, v: DVec3) -> DVec3 {
        self.diagonal.map_or_else(|| self.inverse * v, |d| v / d)
    }

    /// Columns of the map from index-space directions to the world, scaled to a largest entry of 1.
    pub(super) fn axes(&self) -> [[f32; 4]; 3] {
        columns(self.axes)
    }

    /// Columns of the map from index-space gradients to the world, scaled to a largest entry of 1.
    pub(super) fn gradients(&self) -> [[f32; 4]; 3] {
        match self.diagonal {
            Some(d) => columns(DMat3::from_diagonal(d.recip())),
            None => columns(self.inverse.transpose()),
        }
    }

    /// The part of a ray inside the domain and in the `kept` part, for t >= 0, as the device sees it; `length` is -1 where there is none.
    pub(super) fn ray(&self, r: &isobar_core::Ray, kept: Option<(f64, f64)>) -> (Ray, Entry) {
        let miss = Ray {
            length: -1.0,
            ..Ray::default()
        };
        let o = self.vector(r.origin - self.origin);
        let d = self.vector(r.direction);
        let Some((mut t0, mut t1)) = kept else {
            return (miss, Entry::default());
        };
        for a in 0..3 {
            if d[a] == 0.0 {
                if o[a] < 0.0 || o[a] > self.last[a] {
                    return (miss, Entry::default());
                }
                continue;
            }
            let (p, q) = (-o[a] / d[a], (self.last[a] - o[a]) / d[a]);
            t0 = t0.max(p.min(q));
            t1 = t1.min(p.max(q));
        }
        let speed = d.length();
        if !(t0 <= t1 && t1.is_finite() && speed > 0.0 && speed.is_finite()) {
            return (miss, Entry::default());
        }
        let ray = Ray {
            origin: (o + d * t0).clamp(DVec3::ZERO, self.last).as_vec3().to_array(),
            length: ((t1 - t0) * speed) as f32,
            direction: (d / speed).as_vec3().to_array(),
            unused: 0.0,
        };
        (ray, Entry { t: t0, speed })
    }

    /// The rays of rows `y..y + rows`, row by row; parallel.
    pub(super) fn rows(&self, view: &View, y: usize, rows: usize) -> (Vec<Ray>, Vec<Entry>) {
        let generator = view.generator();
        (y * view.width..(y + rows) * view.width)
            .into_par_iter()
            .with_min_len(1024)
            .map(|i| {
                let ray = generator.ray(i % view.width, i / view.width);
                self.ray(&ray, generator.kept(&ray))
            })
            .unzip()
    }
}

fn columns(m: DMat3) -> [[f32; 4]; 3] {
    let largest = m.to_cols_array().iter().fold(0.0f64, |a, x| a.max(x.abs()));
    m.to_cols_array_2d()
        .map(|[x, y, z]| [x, y, z, 0.0].map(|v| (v / largest) as f32))
}

#[cfg(test)]
mod tests {
    use super::*;
    use isobar_core::{Grid, Ray as WorldRay, Samples};

    const EVERYWHERE: Option<(f64, f64)> = Some((0.0, f64::INFINITY));

    fn domain(direction: DMat3, spacing: DVec3) -> Domain {
        let samples = Samples::U8(vec![0; 5 * 6 * 7].into());
        Grid::new([5, 6, 7], spacing, DVec3::new(1.0, -2.0, 0.5), direction, samples)
            .unwrap()
            .domain()
    }

    #[test]
    fn rays_start_at_their_entry_and_end_at_their_exit() {
        let skew = DMat3::from_cols(
            DVec3::new(0.0, 1.0, 0.0),
            DVec3::new(-0.6, 0.0, 0.8),
            DVec3::new(1.0, 0.0, 0.0),
        );
        for d in [
            domain(DMat3::IDENTITY, DVec3::new(0.5, 2.0, 1e-3)),
            domain(skew, DVec3::new(0.5, 1.0, 3.0)),
        ] {
            let to = ToIndex::new(&d);
            let (from, at) = (d.world(DVec3::new(-3.0, 2.0, 9.0)), d.world(DVec3::new(2.0, 2.5, 3.0)));
            let r = WorldRay {
                origin: from,
                direction: (at - from) * 0.25,
            };
            let (ray, entry) = to.ray(&r, EVERYWHERE);
            let u = |t: f64| d.local(r.at(t));
            let start = u(entry.t);
            let stop = u(entry.t + f64::from(ray.length) / entry.speed);
            assert!(
                (start - DVec3::from_array(ray.origin.map(f64::from))).length() < 1e-5,
                "{start} {ray:?}"
            );
            for p in [start, stop] {
                let faces = (0..3).filter(|&a| p[a].abs() < 1e-5 || (p[a] - d.hi[a]).abs() < 1e-5).count();
                assert!(
                    faces >= 1 && p.cmpgt(DVec3::splat(-1e-5)).all() && p.cmplt(d.hi + 1e-5).all(),
                    "{p}"
                );
            }
            let unit = DVec3::from_array(ray.direction.map(f64::from)).length();
            assert!((unit - 1.0).abs() < 1e-6);
            // World direction back from the index direction.
            let world = to
                .axes()
                .map(|c| DVec3::new(f64::from(c[0]), f64::from(c[1]), f64::from(c[2])));
            let back = DMat3::from_cols(world[0], world[1], world[2]) * DVec3::from_array(ray.direction.map(f64::from));
            assert!(back.normalize().dot(r.direction.normalize()) > 1.0 - 1e-6);
        }
    }

    #[test]
    fn rays_past_the_domain_miss_and_from_inside_start_at_zero() {
        let to = ToIndex::new(&domain(DMat3::IDENTITY, DVec3::ONE));
        let ray = |o: [f64; 3], d: [f64; 3]| {
            let r = WorldRay {
                origin: DVec3::from(o),
                direction: DVec3::from(d),
            };
            to.ray(&r, EVERYWHERE)
        };
        assert_eq!(ray([0.0, 5.0, 0.0], [1.0, 0.0, 0.0]).0.length, -1.0);
        assert_eq!(ray([9.0, 0.0, 1.0], [1.0, 0.0, 0.0]).0.length, -1.0);
        let (r, e) = ray([2.0, 0.0, 1.5], [2.0, 0.0, 0.0]);
        assert_eq!((r.origin, r.length, r.direction), ([1.0, 2.0, 1.0], 3.0, [1.0, 0.0, 0.0]));
        assert_eq!(e, Entry { t: 0.0, speed: 2.0 });
    }
}
