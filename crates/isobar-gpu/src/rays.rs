//! Rays from the view to index space in f64, and from there to fixed point; which rectangle of the image the volume covers.
//!
//! f32 does not hold a position in a large volume, or far from the eye, to more than some 1e-5 voxels. A [`FixedRay`] does to 2^-32 at its entry
//! and 2^-42 per half voxel along it; the snippet `fixed_ray` turns it into f32 about any cell, by integer arithmetic.

use bytemuck::{Pod, Zeroable};
use isobar_core::{DMat3, DVec3, Domain, Ray as WorldRay, View};
use rayon::prelude::*;

/// A ray in fixed point, in index space, as `fixed_ray.wgsl` lays it out: its entry into the domain is `cell + fraction * 2^-32`, and each half voxel along it adds
/// `+-(direction * 2^-32 + tail * 2^-42)` per axis.
#[derive(Debug, Clone, Copy, PartialEq, Default, Pod, Zeroable)]
#[repr(C)]
pub struct FixedRay {
    /// Cell of the entry.
    pub cell: [u32; 3],
    /// Bits 0 to 15: whole half voxels from entry to exit; 16 to 18: the axes along which it falls; 31: it misses the domain.
    pub length: u32,
    /// Where in that cell, times 2^32.
    pub fraction: [u32; 3],
    /// The rest of the length, below 1.
    pub rest: f32,
    /// Size of the step per half voxel, times 2^32.
    pub direction: [u32; 3],
    /// Ten more bits of each.
    pub fine: u32,
}
const _: () = assert!(size_of::<FixedRay>() == 48);

/// Whole half voxels that a ray's length is told with: sixteen bits.
const MOST_LENGTH: f64 = 65_535.0;

/// World to index space.
#[derive(Debug, Clone, Copy)]
pub struct ToIndex {
    domain: Domain,
    inverse: DMat3,
    /// Steps of each index where the axes are the world's: dividing by them rounds once.
    diagonal: Option<DVec3>,
    /// Added to an index: cells that are centred on samples begin half a cell before them.
    shift: f64,
}

/// Where a ray enters, and how fast it goes: `t = entry + u / speed`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Entry {
    /// Parameter of the entry.
    pub t: f64,
    /// Units of u per unit of t: half voxels for a [`FixedRay`].
    pub speed: f64,
}

/// The part of a ray that is drawn, in index space.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Part {
    /// The ray's origin.
    pub origin: DVec3,
    /// Its direction, per unit of t; not zero.
    pub direction: DVec3,
    /// Parameter of the entry.
    pub t0: f64,
    /// Parameter of the exit, not before the entry.
    pub t1: f64,
}

const MISS: FixedRay = FixedRay {
    cell: [0; 3],
    length: 1 << 31,
    fraction: [0; 3],
    rest: 0.0,
    direction: [0; 3],
    fine: 0,
};

impl ToIndex {
    /// `centred`: cells are centred on samples.
    #[must_use]
    pub fn new(domain: &Domain, centred: bool) -> Self {
        let a = domain.axes;
        Self {
            domain: *domain,
            inverse: a.inverse(),
            diagonal: domain
                .is_axis_aligned()
                .then(|| DVec3::new(a.x_axis.x, a.y_axis.y, a.z_axis.z)),
            shift: if centred { 0.5 } else { 0.0 },
        }
    }

    /// The domain.
    #[must_use]
    pub const fn domain(&self) -> &Domain {
        &self.domain
    }

    fn vector(&self, v: DVec3) -> DVec3 {
        self.diagonal.map_or_else(|| self.inverse * v, |d| v / d)
    }

    /// Columns of the map from index-space directions to the world, scaled to a largest entry of 1.
    #[must_use]
    pub fn axes(&self) -> [[f32; 4]; 3] {
        columns(self.domain.axes)
    }

    /// Columns of the map from index-space gradients to the world, scaled to a largest entry of 1.
    #[must_use]
    pub fn gradients(&self) -> [[f32; 4]; 3] {
        match self.diagonal {
            Some(d) => columns(DMat3::from_diagonal(d.recip())),
            None => columns(self.inverse.transpose()),
        }
    }

    /// The part of a ray inside the domain and inside `kept` (what clipping planes leave of t >= 0); `None` where there is none.
    #[must_use]
    pub fn part(&self, r: &WorldRay, kept: Option<(f64, f64)>) -> Option<Part> {
        let (mut t0, mut t1) = kept?;
        let o = self.vector(r.origin - self.domain.origin);
        let d = self.vector(r.direction);
        let last = self.domain.hi;
        for a in 0..3 {
            if d[a] == 0.0 {
                if o[a] < 0.0 || o[a] > last[a] {
                    return None;
                }
                continue;
            }
            let (p, q) = (-o[a] / d[a], (last[a] - o[a]) / d[a]);
            t0 = t0.max(p.min(q));
            t1 = t1.min(p.max(q));
        }
        let speed = d.length();
        let is_some = t0 <= t1 && t1.is_finite() && speed > 0.0 && speed.is_finite();
        is_some.then_some(Part {
            origin: o,
            direction: d,
            t0,
            t1,
        })
    }

    /// [`ToIndex::part`] as the device sees it.
    #[must_use]
    pub fn ray(&self, r: &WorldRay, kept: Option<(f64, f64)>) -> (FixedRay, Entry) {
        let Some(Part {
            origin: o,
            direction: d,
            t0,
            t1,
        }) = self.part(r, kept)
        else {
            return (MISS, Entry::default());
        };
        let last = self.domain.hi;
        let speed = 2.0 * d.length();
        let length = (t1 - t0) * speed;
        if length.is_nan() || length >= MOST_LENGTH {
            return (MISS, Entry::default());
        }
        let entry = (o + d * t0).clamp(DVec3::ZERO, last) + self.shift;
        let step = d / speed;
        let mut ray = FixedRay {
            length: length as u32,
            rest: (length - length.floor()) as f32,
            ..MISS
        };
        for a in 0..3 {
            ray.cell[a] = entry[a] as u32;
            // 2^32 times a fraction below 1 fits.
            ray.fraction[a] = ((entry[a] - entry[a].floor()) * 4_294_967_296.0) as u32;
            // |step| <= 1/2: at most 2^41.
            let fixed = (step[a].abs() * 4_398_046_511_104.0).round() as u64;
            ray.direction[a] = (fixed >> 10) as u32;
            ray.fine |= (fixed as u32 & 1023) << (10 * a);
            ray.length |= u32::from(step[a] < 0.0) << (16 + a);
        }
        (ray, Entry { t: t0, speed })
    }

    /// The rays of some rows of a rectangle, row by row; parallel on the caller's pool.
    #[must_use]
    pub fn rows(&self, view: &View, rectangle: Rectangle, y: usize, rows: usize) -> (Vec<FixedRay>, Vec<Entry>) {
        rectangle.rows(view, y, rows, |ray, kept| self.ray(ray, kept))
    }
}

fn columns(m: DMat3) -> [[f32; 4]; 3] {
    let largest = m.to_cols_array().iter().fold(0.0f64, |a, x| a.max(x.abs()));
    m.to_cols_array_2d()
        .map(|[x, y, z]| [x, y, z, 0.0].map(|v| (v / largest) as f32))
}

/// Pixels that may see the volume.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Rectangle {
    /// Left column.
    pub x: usize,
    /// Top row.
    pub y: usize,
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
}

impl Rectangle {
    /// What `of` makes of the rays of rows `y..y + rows` of the image and of the part of each that clipping planes keep, row by row; parallel on the caller's pool.
    #[must_use]
    pub fn rows<R: Send>(
        self,
        view: &View,
        y: usize,
        rows: usize,
        of: impl Fn(&WorldRay, Option<(f64, f64)>) -> (R, Entry) + Sync,
    ) -> (Vec<R>, Vec<Entry>) {
        let generator = view.generator();
        (0..rows * self.width)
            .into_par_iter()
            .with_min_len(1024)
            .map(|i| {
                let ray = generator.ray(self.x + i % self.width, y + i / self.width);
                of(&ray, generator.kept(&ray))
            })
            .unzip()
    }

    /// All of the image.
    #[must_use]
    pub const fn whole(view: &View) -> Self {
        Self {
            x: 0,
            y: 0,
            width: view.width,
            height: view.height,
        }
    }

    /// The bounding rectangle of the projected domain (Steinberger 2010, section 3.3), a pixel wider on every side; the whole image for lists of
    /// rays and where a corner of the domain does not lie in front of the eye.
    #[must_use]
    pub fn of(view: &View, domain: &Domain) -> Self {
        let whole = Self::whole(view);
        let Some(lens) = view.lens() else { return whole };
        let (w, h) = (view.width as f64, view.height as f64);
        let (mut lo, mut hi) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for corner in domain.corners() {
            let v = corner - lens.eye;
            let depth = v.dot(lens.forward);
            let by = if lens.parallel {
                lens.half
            } else {
                // Nearer than this a corner may be projected anywhere.
                if depth.is_nan() || depth <= 1e-6 * v.length() {
                    return whole;
                }
                lens.half * depth
            };
            let x = (v.dot(lens.right) / (by * (w / h)) + 1.0) * 0.5 * w;
            let at = DVec3::new(x, (1.0 - v.dot(lens.up) / by) * 0.5 * h, 0.0);
            (lo, hi) = (lo.min(at), hi.max(at));
        }
        // Casts saturate; NaN becomes 0.
        let from = |x: f64, n: usize| ((x - 1.5).floor().max(0.0) as usize).min(n);
        let to = |x: f64, n: usize| ((x + 1.5).ceil().max(0.0) as usize).min(n);
        let (x, y) = (from(lo.x, view.width), from(lo.y, view.height));
        Self {
            x,
            y,
            width: to(hi.x, view.width).saturating_sub(x),
            height: to(hi.y, view.height).saturating_sub(y),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use isobar_core::{Camera, Grid, Samples};

    const EVERYWHERE: Option<(f64, f64)> = Some((0.0, f64::INFINITY));

    fn domain(direction: DMat3, spacing: DVec3) -> Domain {
        let samples = Samples::U8(vec![0; 5 * 6 * 7].into());
        Grid::new([5, 6, 7], spacing, DVec3::new(1.0, -2.0, 0.5), direction, samples)
            .unwrap()
            .domain()
    }

    /// The point `u` half voxels behind the entry, from the fixed-point numbers.
    fn at(r: &FixedRay, u: f64) -> DVec3 {
        let axis = |a: usize| {
            let step = f64::from(r.direction[a]) / 2f64.powi(32) + f64::from(r.fine >> (10 * a) & 1023) / 2f64.powi(42);
            let sign = if r.length >> (16 + a) & 1 == 1 { -1.0 } else { 1.0 };
            f64::from(r.cell[a]) + f64::from(r.fraction[a]) / 2f64.powi(32) + u * sign * step
        };
        DVec3::new(axis(0), axis(1), axis(2))
    }

    #[test]
    fn fixed_point_rays_are_the_rays() {
        let skew = DMat3::from_cols(
            DVec3::new(0.0, 1.0, 0.0),
            DVec3::new(-0.6, 0.0, 0.8),
            DVec3::new(1.0, 0.0, 0.0),
        );
        for d in [
            domain(DMat3::IDENTITY, DVec3::new(0.5, 2.0, 1e-3)),
            domain(skew, DVec3::new(0.5, 1.0, 3.0)),
        ] {
            for centred in [false, true] {
                let to = ToIndex::new(&d, centred);
                let (from, target) = (d.world(DVec3::new(-3.0, 2.0, 9.0)), d.world(DVec3::new(2.0, 2.5, 3.0)));
                let r = WorldRay {
                    origin: from,
                    direction: (target - from) * 0.25,
                };
                let (ray, entry) = to.ray(&r, EVERYWHERE);
                let length = f64::from(ray.length & 0xffff) + f64::from(ray.rest);
                for part in [0.0, 0.3, 1.0] {
                    let u = length * part;
                    let want = d.local(r.at(entry.t + u / entry.speed)) + if centred { 0.5 } else { 0.0 };
                    assert!(
                        (at(&ray, u) - want).length() < 1e-8,
                        "{centred} {part}: {} {want}",
                        at(&ray, u)
                    );
                }
                assert!(length > 5.0);
            }
        }
    }

    #[test]
    fn rays_past_the_domain_miss_and_from_inside_start_at_zero() {
        let to = ToIndex::new(&domain(DMat3::IDENTITY, DVec3::ONE), false);
        let ray = |o: [f64; 3], d: [f64; 3]| {
            let ray = WorldRay {
                origin: DVec3::from(o),
                direction: DVec3::from(d),
            };
            to.ray(&ray, EVERYWHERE)
        };
        assert_eq!(ray([0.0, 5.0, 0.0], [1.0, 0.0, 0.0]).0, MISS);
        assert_eq!(ray([9.0, 0.0, 1.0], [1.0, 0.0, 0.0]).0, MISS);
        let (r, e) = ray([2.0, 0.0, 1.5], [2.0, 0.0, 0.0]);
        assert_eq!((r.cell, r.fraction, r.length), ([1, 2, 1], [0; 3], 6));
        assert_eq!((r.direction, r.fine), ([1 << 31, 0, 0], 0));
        assert_eq!(e, Entry { t: 0.0, speed: 4.0 });
    }

    /// No ray that meets the domain lies outside the rectangle, and the rectangle is not the whole image where it need not be.
    #[test]
    fn the_rectangle_holds_every_ray_that_meets_the_domain() {
        let d = domain(DMat3::IDENTITY, DVec3::ONE);
        let to = ToIndex::new(&d, false);
        let far = View::perspective(DVec3::new(30.0, 9.0, 14.0), DVec3::new(0.0, 3.0, 2.0), DVec3::Z, 40.0, 90, 70);
        let near = View::perspective(DVec3::new(2.0, 0.0, 2.0), DVec3::new(4.0, 0.0, 2.0), DVec3::Z, 70.0, 40, 30);
        let away = View::perspective(DVec3::splat(100.0), DVec3::splat(200.0), DVec3::Z, 40.0, 9, 7);
        let ortho = View {
            camera: Camera::Orthographic {
                eye: DVec3::new(-9.0, 5.0, 5.0),
                target: DVec3::splat(2.0),
                up: DVec3::Z,
                height: 22.0,
            },
            ..far.clone()
        };
        for (view, is_whole) in [(far, false), (near, true), (away, true), (ortho, false)] {
            let r = Rectangle::of(&view, &d);
            assert_eq!(r.width * r.height == view.pixels(), is_whole, "{r:?}");
            for i in 0..view.pixels() {
                let (x, y) = (i % view.width, i / view.width);
                let inside = (r.x..r.x + r.width).contains(&x) && (r.y..r.y + r.height).contains(&y);
                assert!(inside || to.ray(&view.ray(x, y), EVERYWHERE).0 == MISS, "{x} {y} {r:?}");
            }
        }
    }
}
