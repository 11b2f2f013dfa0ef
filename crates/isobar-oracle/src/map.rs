//! Stages 1 and 2: a ray in the local coordinates of a domain, in double-double with error bounds.
//!
//! t is re-based, `t = t_ref + s` with an f64 `t_ref` near the entry into the domain, so that a camera 1e7 away costs no digits. Per
//! axis `v(s) = alpha + beta s`, where v is the local coordinate, plus 1/2 where cells are centred on samples (cell i spans `[i, i+1]`).
//!
//! Error bounds, `u = 2^-53`:
//! * an axis that follows one world axis: `x = o + t_ref d - origin` has an exact product, an exact difference and one sum (`3u^2`), the
//!   quotient by the axis adds `3u^2`, the half cell `2u^2 |v|`: at most `2^-102 (|alpha| + 1)`. `beta` is one quotient: `2^-103 |beta|`.
//! * any other axis: the minors are differences of exact products (`3u^2` of the result), their products with x `7u^2 + 3u^2 + 3u^2`,
//!   two sums `6u^2` of the sum S of the magnitudes; the determinant `11u^2` of the sum T of its magnitudes; the
//!   quotient `15u^2`. With `kappa = T/|det| >= 1` that is less than `45 kappa u^2 S/|det|`, taken as `2^-100 kappa S/|det|`.
//! * `v(s)` for an f64 s: product `2u^2 |beta s|`, sum `3u^2 |v|`, subtraction of the cell's index `2u^2 |w|`, which
//!   [`RayMap::at`] bounds by `2^-102 (|alpha| + |beta s| + 1)` on top of the errors of alpha and `|s|` times that of beta.
//! * crossing times `s = (k - alpha)/beta`: see [`Axis::crossing`].

use crate::real::{Dd, in_range, two_prod, two_sum};
use isobar_core::{DVec3, Domain, Ray};

/// Two to the minus 100, 102 and 103.
const P100: f64 = 7.888_609_052_210_118e-31;
const P102: f64 = P100 / 4.0;
const P103: f64 = P100 / 8.0;

/// The inverse of a domain's axes, prepared once.
#[derive(Clone, Debug)]
pub(crate) struct LocalMap {
    domain: Domain,
    shift: f64,
    rows: [Row; 3],
    /// Middle of the domain and its half diagonal, rounded: only to choose `t_ref`.
    centre: DVec3,
    radius: f64,
}

/// How one local coordinate comes from the world.
#[derive(Clone, Debug)]
enum Row {
    /// `u = (x_k - origin_k)/scale`.
    Along { k: usize, scale: f64 },
    /// `u = sum minor_k (x_k - origin_k) / det`, and `kappa / |det|`.
    General { minor: [Dd; 3], det: Dd, kappa: f64 },
}

/// One local coordinate along a ray.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Axis {
    alpha: Dd,
    beta: Dd,
    alpha_error: f64,
    beta_error: f64,
    /// Sign of beta: -1, 0, 1; certain.
    pub(crate) direction: i32,
    inverse: f64,
    /// Crossing error: constant and relative part.
    crossing_error: (f64, f64),
}

impl Axis {
    /// When the ray crosses `v = k` (an f64 exactly), and a bound of the error. Only where `direction` is not 0.
    ///
    /// `k - alpha.hi` errs by u of the result, subtracting `alpha.lo` by u more; where they cancel the first is exact (Sterbenz), and
    /// it is at least half an ulp of alpha, so at most 3u of the result; 1/beta and `beta.lo` 2u, the product u: less than 8u,
    /// taken as 16u. The errors of alpha and beta shift s by `(e_alpha + |s| e_beta)/|beta|`, taken twice.
    #[inline]
    pub(crate) fn crossing(&self, k: f64) -> (f64, f64) {
        let s = ((k - self.alpha.hi) - self.alpha.lo) * self.inverse;
        (s, self.crossing_error.0 + self.crossing_error.1 * s.abs())
    }

    /// An enclosure of v(s) in f64: middle and error.
    #[inline]
    pub(crate) fn rough(&self, s: f64) -> (f64, f64) {
        let v = self.alpha.hi + self.beta.hi * s;
        let size = self.alpha.hi.abs() + (self.beta.hi * s).abs() + 1.0;
        (v, 8.9e-16 * size + self.alpha_error + s.abs() * self.beta_error)
    }

    /// `v(s) - base` in double-double and a bound of its error; base is an integer below 2^52.
    #[inline]
    pub(crate) fn at(&self, s: f64, base: f64) -> (Dd, f64) {
        let product = self.beta.times(s);
        let w = (self.alpha + product).plus(-base);
        let size = self.alpha.abs() + product.abs() + 1.0;
        (w, self.alpha_error + s.abs() * self.beta_error + P102 * size)
    }

    /// d v / d s, rounded.
    pub(crate) fn rate(&self) -> f64 {
        self.beta.hi
    }

    /// `floor(v / stride)` of the constant v where `direction` is 0; [`LocalMap::map`] has made sure that it is certain.
    pub(crate) fn constant_floor(&self, stride: f64) -> f64 {
        let q = self.alpha.hi / stride;
        let f = q.floor();
        // strides are powers of two, so q is exact
        if f == q && self.alpha.lo < 0.0 { f - 1.0 } else { f }
    }

    /// The constant v where `direction` is 0: value and error, 0 where it is known exactly.
    pub(crate) fn constant(&self) -> (Dd, f64) {
        (self.alpha, self.alpha_error)
    }
}

/// A ray in local coordinates; see the module.
#[derive(Clone, Debug)]
pub(crate) struct RayMap {
    /// The re-basing: t = t_ref + s.
    pub(crate) t_ref: f64,
    /// The three local coordinates.
    pub(crate) axes: [Axis; 3],
    /// Enclosure `(lo, hi)` of the start of the stay in the domain, in s. Where the ray starts inside both are `-t_ref`, exactly.
    pub(crate) start: (f64, f64),
    /// Enclosure of its end.
    pub(crate) end: (f64, f64),
}

/// What f64 and double-double can say about a ray and a domain.
#[derive(Clone, Debug)]
pub(crate) enum Mapped {
    /// The ray and an enclosure of its stay, which may still turn out to be empty.
    Ray(Box<RayMap>),
    /// It certainly misses the domain.
    Outside,
    /// Only exact arithmetic can tell.
    Unclear,
}

impl LocalMap {
    /// Prepares a domain; `None` where its numbers are outside [2^-200, 2^200] or singular in double-double.
    pub(crate) fn new(domain: &Domain, centred: bool) -> Option<Self> {
        let columns = [domain.axes.x_axis, domain.axes.y_axis, domain.axes.z_axis];
        let numbers = columns.iter().chain([&domain.origin, &domain.lo, &domain.hi]);
        if !numbers.flat_map(|v| v.to_array()).all(in_range) {
            return None;
        }
        let (mut rows, mut used) = (Vec::with_capacity(3), [false; 3]);
        for c in &columns {
            // A column with one entry on a world axis that no other column touches: u_a depends on that world axis alone.
            let hits: Vec<usize> = (0..3).filter(|&k| c[k] != 0.0).collect();
            if let [k] = hits[..] {
                let alone = columns.iter().filter(|o| o[k] != 0.0).count() == 1;
                if alone && !used[k] {
                    used[k] = true;
                    rows.push(Some(Row::Along { k, scale: c[k] }));
                    continue;
                }
            }
            rows.push(None);
        }
        let mut it = rows.into_iter().enumerate().map(|(a, row)| match row {
            Some(r) => Some(r),
            None => general(&columns, a),
        });
        let rows = [it.next()??, it.next()??, it.next()??];
        let (lo, hi) = domain.world_bounds();
        Some(Self {
            domain: *domain,
            shift: if centred { 0.5 } else { 0.0 },
            rows,
            centre: 0.5 * (lo + hi),
            radius: 0.5 * (hi - lo).length(),
        })
    }

    /// The ray in these coordinates.
    pub(crate) fn map(&self, ray: &Ray) -> Mapped {
        let (o, d) = (ray.origin, ray.direction);
        if !o.to_array().into_iter().chain(d.to_array()).all(in_range) || d == DVec3::ZERO {
            return Mapped::Unclear;
        }
        // Any t_ref is right; one near the entry is best.
        let length = d.length();
        let near = (self.centre - o).dot(d) / (length * length) - self.radius / length;
        let t_ref = if near > 0.0 && in_range(near) { near } else { 0.0 };
        // How far from t_ref the stay should reach; checked below.
        let reach = 4.0 * self.radius / length;
        let mut x = [Dd::new(0.0); 3];
        for k in 0..3 {
            x[k] = two_prod(t_ref, d[k]) + two_sum(o[k], -self.domain.origin[k]);
        }
        let mut map = RayMap {
            t_ref,
            axes: [Axis {
                alpha: Dd::new(0.0),
                beta: Dd::new(0.0),
                alpha_error: 0.0,
                beta_error: 0.0,
                direction: 0,
                inverse: 0.0,
                crossing_error: (0.0, 0.0),
            }; 3],
            start: (-t_ref, -t_ref),
            end: (f64::INFINITY, f64::INFINITY),
        };
        for a in 0..3 {
            let axis = self.axis(a, &x, d, reach);
            map.axes[a] = axis;
            let (lo, hi) = (self.domain.lo[a] + self.shift, self.domain.hi[a] + self.shift);
            if axis.direction == 0 {
                let (v, e) = axis.constant();
                // v.hi + v.lo - bound, to a relative 2^-52, decides; e = 0 means v.lo = 0 and then the comparison is exact.
                let (below, above) = ((v.hi - lo) + v.lo, (v.hi - hi) + v.lo);
                let doubt = e * 2.0;
                if below < -doubt || above > doubt {
                    return Mapped::Outside;
                }
                let to_face = ((v.hi - v.hi.round()) + v.lo).abs();
                if e > 0.0 && (below <= doubt || above >= -doubt || to_face <= doubt) {
                    return Mapped::Unclear;
                }
                continue;
            }
            let (enter, leave) = if axis.direction > 0 { (lo, hi) } else { (hi, lo) };
            let (s, e) = axis.crossing(enter);
            map.start = (map.start.0.max(s - e), map.start.1.max(s + e));
            let (s, e) = axis.crossing(leave);
            map.end = (map.end.0.min(s - e), map.end.1.min(s + e));
        }
        if map.start.0 > map.end.1 {
            return Mapped::Outside;
        }
        let within = map.start.0.abs().max(map.end.1.abs()) <= reach;
        let leaning = map.axes.iter().any(|a| a.direction == 0 && a.beta_error > 0.0);
        if map.end.1.is_finite() && (within || !leaning) {
            Mapped::Ray(Box::new(map))
        } else {
            Mapped::Unclear
        }
    }

    /// One coordinate. Where the sign of beta is not certain, or crossing times would not be known to 2^-40 of the stay (a ray parallel to a
    /// face but for rounding), v counts as constant, and its error covers what `beta s` can amount to for `|s| <= reach`.
    fn axis(&self, a: usize, x: &[Dd; 3], d: DVec3, reach: f64) -> Axis {
        let (alpha, mut alpha_error, beta, beta_error) = match &self.rows[a] {
            Row::Along { k, scale } => {
                let x = x[*k];
                let mut alpha = x.over(*scale);
                let p = two_prod(alpha.hi, *scale);
                // Where the quotient has no remainder it is exact; this matters for rays parallel to a face of cells.
                let exact = d[*k] == 0.0 && x.lo == 0.0 && alpha.lo == 0.0 && p.hi == x.hi && p.lo == 0.0;
                let shifted = two_sum(alpha.hi, self.shift);
                let exact = exact && shifted.lo == 0.0;
                alpha = alpha.plus(self.shift);
                let error = if exact { 0.0 } else { P102 * (alpha.abs() + 1.0) };
                let beta = Dd::new(d[*k]).over(*scale);
                (alpha, error, beta, P103 * beta.abs())
            }
            Row::General { minor, det, kappa } => {
                let mut n = [Dd::new(0.0); 2];
                let mut size = [0.0; 2];
                for k in 0..3 {
                    let terms = [minor[k] * x[k], minor[k].times(d[k])];
                    for i in 0..2 {
                        n[i] = n[i] + terms[i];
                        size[i] += terms[i].abs();
                    }
                }
                let alpha = n[0].divide(*det).plus(self.shift);
                let error = P100 * kappa * size[0] + P102 * (alpha.abs() + 1.0);
                let beta = n[1].divide(*det);
                (alpha, error, beta, P100 * kappa * size[1])
            }
        };
        let direction = if beta.hi == 0.0 && beta_error == 0.0 {
            0
        } else if beta_error <= 9.5e-7 * beta.abs() && 2.0 * alpha_error <= 9.1e-13 * reach * beta.abs() {
            // 2^-20: the sign is certain, and crossing times carry the error on.
            if beta.hi > 0.0 { 1 } else { -1 }
        } else {
            alpha_error += 1.001 * (beta.abs() + beta_error) * reach;
            0
        };
        let mut axis = Axis {
            alpha,
            beta,
            alpha_error,
            beta_error,
            direction,
            inverse: 0.0,
            crossing_error: (0.0, 0.0),
        };
        if direction != 0 {
            axis.inverse = 1.0 / beta.hi;
            // 16u = 2^-49
            axis.crossing_error = (2.0 * alpha_error / beta.abs(), 1.78e-15 + 2.0 * beta_error / beta.abs());
        }
        axis
    }
}

/// Row a of the inverse: minors over the determinant.
fn general(columns: &[DVec3; 3], a: usize) -> Option<Row> {
    let minors = |b: DVec3, c: DVec3| -> [Dd; 3] {
        std::array::from_fn(|i| {
            let (j, k) = ((i + 1) % 3, (i + 2) % 3);
            two_prod(b[j], c[k]) - two_prod(b[k], c[j])
        })
    };
    let minor = minors(columns[(a + 1) % 3], columns[(a + 2) % 3]);
    let mut det = Dd::new(0.0);
    let mut size = 0.0;
    for k in 0..3 {
        let term = minor[k].times(columns[a][k]);
        det = det + term;
        size += term.abs();
    }
    let kappa = size / det.abs();
    // Beyond this the determinant has few certain digits; exact arithmetic takes over.
    (kappa < 1e9).then(|| Row::General {
        minor,
        det,
        kappa: kappa / det.abs(),
    })
}
