//! Rays in the index space of a grid, and normals back in the world.

use crate::march::pair::{Pair, PairOps};
use crate::march::volume::Point;
use isobar_core::{DMat3, DVec3, Domain, Ray};

/// World to index space.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ToIndex {
    origin: DVec3,
    /// Rows are the local axes' gradients: `u = inverse * (x - origin)`.
    inverse: DMat3,
    /// Lengths of one step of each index, where the axes are the world's: dividing by them rounds once.
    diagonal: Option<DVec3>,
}

impl ToIndex {
    pub(crate) fn new(domain: &Domain) -> Self {
        let a = domain.axes;
        Self {
            origin: domain.origin,
            inverse: a.inverse(),
            diagonal: domain
                .is_axis_aligned()
                .then(|| DVec3::new(a.x_axis.x, a.y_axis.y, a.z_axis.z)),
        }
    }

    #[inline(always)]
    fn vector(&self, v: DVec3) -> DVec3 {
        self.diagonal.map_or_else(|| self.inverse * v, |d| v / d)
    }

    /// The ray in index space; t keeps its unit.
    #[inline(always)]
    pub(crate) fn ray(&self, r: &Ray) -> IndexRay {
        IndexRay::new(
            self.vector(r.origin - self.origin).to_array(),
            self.vector(r.direction).to_array(),
        )
    }

    /// World gradient, as a unit vector; zero where it vanishes or is not finite.
    pub(crate) fn normal(&self, g: [f64; 3]) -> [f32; 3] {
        let g = DVec3::from_array(g);
        let g = self.diagonal.map_or_else(|| self.inverse.transpose() * g, |d| g / d);
        // Scaled first, so that no square overflows or vanishes.
        let largest = g.abs().max_element();
        if !(largest > 0.0 && largest.is_finite()) {
            return [0.0; 3];
        }
        (g / largest).normalize().as_vec3().to_array()
    }
}

/// A ray in index space: `u(t) = o + t d`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct IndexRay {
    pub(crate) o: [f64; 3],
    pub(crate) d: [f64; 3],
    /// Where it meets the plane `u_a = f`: `t = (f - from) * inverse`; +inf along axes it does not move on.
    from: [f64; 3],
    inverse: [f64; 3],
}

impl IndexRay {
    #[inline(always)]
    pub(crate) fn new(o: [f64; 3], d: [f64; 3]) -> Self {
        let inverse = d.map(|d| 1.0 / d);
        let moves: [bool; 3] = std::array::from_fn(|a| inverse[a].abs() < f64::INFINITY);
        Self {
            o,
            d,
            from: std::array::from_fn(|a| if moves[a] { o[a] } else { f64::NEG_INFINITY }),
            inverse: std::array::from_fn(|a| if moves[a] { inverse[a] } else { 1.0 }),
        }
    }

    #[inline(always)]
    pub(crate) fn at(&self, t: f64) -> Point {
        Point {
            xy: Pair::new(self.o[0], self.o[1]).add(Pair::splat(t).mul(Pair::new(self.d[0], self.d[1]))),
            z: self.o[2] + t * self.d[2],
        }
    }

    /// Voxels per unit of t.
    #[inline(always)]
    pub(crate) fn speed(&self) -> f64 {
        (self.d[0] * self.d[0] + self.d[1] * self.d[1] + self.d[2] * self.d[2]).sqrt()
    }

    /// The t at which each coordinate reaches `face`.
    #[inline(always)]
    pub(crate) fn reach(&self, face: [f64; 3]) -> [f64; 3] {
        std::array::from_fn(|a| (face[a] - self.from[a]) * self.inverse[a])
    }

    /// The part t >= 0 inside the box [0, last], or `None`. The ends are the `reach` of its faces, to the bit.
    #[inline(always)]
    pub(crate) fn clip(&self, last: [f64; 3]) -> Option<(f64, f64)> {
        let (p, q) = (self.reach([0.0; 3]), self.reach(last));
        let (mut t0, mut t1) = (0.0f64, f64::INFINITY);
        for a in 0..3 {
            if p[a] == f64::INFINITY {
                if self.o[a] < 0.0 || self.o[a] > last[a] {
                    return None;
                }
                continue;
            }
            let (near, far) = if p[a] < q[a] { (p[a], q[a]) } else { (q[a], p[a]) };
            t0 = if near > t0 { near } else { t0 };
            t1 = if far < t1 { far } else { t1 };
        }
        (t0 <= t1 && t1 < f64::INFINITY).then_some((t0, t1))
    }

    /// The same, of the part that clipping planes keep; `None` where that is nothing.
    #[inline(always)]
    pub(crate) fn clip_within(&self, last: [f64; 3], kept: Option<(f64, f64)>) -> Option<(f64, f64)> {
        let ((first, end), (t0, t1)) = (kept?, self.clip(last)?);
        let t0 = if first > t0 { first } else { t0 };
        let t1 = if end < t1 { end } else { t1 };
        (t0 <= t1).then_some((t0, t1))
    }
}
