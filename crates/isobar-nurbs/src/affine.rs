//! Elements whose geometry is affine: cells of a grid, boxes, polynomials on a box. Along a ray their attribute is **one univariate polynomial**.
//!
//! Of the system P = (alpha, beta, gamma) the first two are linear here and solved at once: the ray in the element's parameters is `u(t) = p + t q`. What is left is gamma(u(t)), of the
//! degree of the attribute's three degrees together (9 for a tri-cubic), made in Bernstein form by blossoming and solved by isobar-poly's proved search.
//!
//! **Far eyes.** Where the ray's origin is more than [`FAR`] parameters away, positions along it would be known too roughly. The origin is then moved along the ray to about where it passes the
//! middle of the element or grid: t there is a number s of f64, the point `o + s d` is made with the errors of its products and sums added back ([`moved`]), and what is left of them is counted
//! in the error of p. t is then measured from s, from -s on.
//!
//! **Segment.** `[t0, t1]` is where the computed ray is within a margin of the element's box and t >= 0: [`WIDE`], or 8 delta where that is more. Its ends' parameters a, b (f64) define the polynomial
//! `P(x) = gamma(a + x (b - a))`, x in [0, 1]; gamma is the element's polynomial beyond its faces too. With `delta` a bound of the error of u(t) for t in the segment
//! ([`LocalRay`]), the true function along the ray differs from P by at most `L delta`, L the sum of the greatest partial derivatives: degree times the spread of the
//! coefficients, for each axis. The computed coefficients differ from P's by at most [`roundings`] times their size. Both together are the `error` of the search.
//!
//! **Roots.** A sign that the search calls certain exceeds `error`, so it is the true function's. A bracket with certain and opposite signs at its ends holds a root, because the true
//! function is continuous. Where the coefficients (each beyond `error`) change sign once, `P = e` has one root for each |e| <= error, so all zeros of the true function lie
//! between the roots for both extremes, and these in the bracket: outside of brackets there is none, although the true function is no polynomial of the search's degree to the last bit.
//!
//! **Faces.** A bracket whose parameters are farther than `delta` outside the box belongs to a neighbour and is dropped; one farther than `delta` inside on every axis is
//! certain; the rest are hits without a claim, found by both neighbours and joined. As the margin is more than `2 delta` plus the rounding of the segment's ends,
//! every t at which the true ray is in the closed element lies in the segment: no ray slips between two cells.

use crate::bernstein::{MOST, bases, jet, range};
use crate::frustum::{EPS, Frustum, PixelBox};
use crate::solve::{Found, Solver};
use glam::DVec3;
use isobar_core::{HexElement, Ray};
use isobar_poly::bernstein::eval_with_derivative;
use isobar_poly::{First, MAX_DEGREE, Root, RootKind, Tolerance, all_roots, first_root};

/// How far beyond the box the search goes at least, in the element's size.
const WIDE: f64 = 1.0 / (1 << 24) as f64;
/// Greatest `delta`, else the pixel is undecided: beyond the box by 8 of it, partial derivatives of degree 27 together are at most 1.01 times those in the box.
const MOST_DELTA: f64 = 1e-5;
/// From how many parameters on the ray's origin is moved.
const FAR: f64 = (1 << 20) as f64;
/// What the projected box is widened by, in its own size, beside the rounding of its centre.
const BORDER: f64 = 1.0 + 1.0 / (1 << 20) as f64;
/// Wanted width of a bracket, in segments.
const WIDTH: f64 = 1.0 / (1u64 << 36) as f64;
/// Coefficients of a polynomial, at most.
const CAPACITY: usize = MAX_DEGREE + 1;

/// World to the parameters of a box or the index space of a grid.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Place {
    origin: DVec3,
    /// Rows of about the inverse of the map's matrix A.
    rows: [DVec3; 3],
    /// Greatest row sum of |rows A - I|.
    spread: f64,
}

impl Place {
    /// The box between two opposite corners; `None` where it is flat.
    pub(crate) fn of_box(lo: DVec3, hi: DVec3) -> Option<Self> {
        let size = hi - lo;
        let k = size.recip();
        (k.is_finite() && size.is_finite()).then_some(Self {
            origin: lo,
            rows: [DVec3::X * k.x, DVec3::Y * k.y, DVec3::Z * k.z],
            spread: 0.0,
        })
    }

    /// Index space of a grid's domain; `None` where its axes are (nearly) dependent.
    pub(crate) fn of_domain(d: &isobar_core::Domain) -> Option<Self> {
        let a = d.axes;
        if d.is_axis_aligned() {
            let diagonal = DVec3::new(a.x_axis.x, a.y_axis.y, a.z_axis.z);
            return Self::of_box(DVec3::ZERO, diagonal).map(|p| Self { origin: d.origin, ..p });
        }
        let inverse = a.inverse();
        let rows = [inverse.row(0), inverse.row(1), inverse.row(2)];
        let columns = [a.x_axis, a.y_axis, a.z_axis];
        let spread = (0..3)
            .map(|i| {
                (0..3)
                    .map(|j| {
                        let unit = if i == j { 1.0 } else { 0.0 };
                        (rows[i].dot(columns[j]) - unit).abs() + 8.0 * EPS * rows[i].abs().dot(columns[j].abs())
                    })
                    .sum::<f64>()
            })
            .fold(0.0f64, f64::max)
            * 1.01;
        (spread < 1e-3 && rows.iter().all(|r| r.is_finite())).then_some(Self {
            origin: d.origin,
            rows,
            spread: spread * 1.01,
        })
    }

    /// A displacement in parameters, and the bound of each component's error: the rounding of the sum, of the inverse's entries and of the size of a box (six at most), and the
    /// spread (`|u* - M x| = |(I - M A) u*|`).
    #[inline(always)]
    fn local(&self, x: DVec3) -> ([f64; 3], f64) {
        let u = self.rows.map(|r| r.dot(x));
        let size = self.rows.map(|r| r.abs().dot(x.abs()));
        let most = |v: [f64; 3]| v[0].abs().max(v[1].abs()).max(v[2].abs());
        (u, self.spread * most(u) + 6.0 * EPS * most(size))
    }

    /// The world gradient of a function with this gradient in parameters.
    #[inline(always)]
    fn gradient(&self, g: [f64; 3]) -> DVec3 {
        self.rows[0] * g[0] + self.rows[1] * g[1] + self.rows[2] * g[2]
    }
}

/// A ray in parameters: `u(t) = p + t q`, with the errors of p and q.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LocalRay {
    p: [f64; 3],
    q: [f64; 3],
    inverse: [f64; 3],
    error: f64,
    drift: f64,
    /// At least the parameter t it takes to go by 1 along some axis.
    pace: f64,
    /// The ray's own t where this t is 0.
    shift: f64,
}

/// Sum and its exact error.
#[inline(always)]
fn two_sum(a: DVec3, b: DVec3) -> (DVec3, DVec3) {
    let s = a + b;
    let c = s - a;
    (s, (a - (s - c)) + (b - c))
}

/// `o + s d - origin`, wrong by its own rounding and by 4 EPS^2 of the second number: product and sums have their errors added back.
#[inline(always)]
fn moved(ray: &Ray, origin: DVec3, s: f64) -> (DVec3, DVec3) {
    let far = ray.direction * s;
    let (away, a) = two_sum(ray.origin, -origin);
    let rest = ray.direction.mul_add(DVec3::splat(s), -far);
    let (sum, b) = two_sum(away, far);
    (sum + (b + (a + rest)), away.abs() + far.abs())
}

impl LocalRay {
    /// `centre`: of the element or grid, in parameters.
    #[inline(always)]
    pub(crate) fn new(place: &Place, ray: &Ray, centre: [f64; 3]) -> Self {
        let (mut p, mut error) = place.local(ray.origin - place.origin);
        let (q, drift) = place.local(ray.direction);
        let mut shift = 0.0;
        if p[0].abs().max(p[1].abs()).max(p[2].abs()) > FAR {
            // Lengths of q far from 1 are brought near it: squares do not overflow.
            let most = q[0].abs().max(q[1].abs()).max(q[2].abs());
            let d = q.map(|q| q / most);
            let ahead: f64 = (0..3).map(|a| (centre[a] - p[a]) * d[a]).sum();
            shift = ahead / (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]) / most;
            let (x, sizes) = moved(ray, place.origin, shift);
            (p, error) = place.local(x);
            let most = place.rows.map(|r| r.abs().dot(sizes)).into_iter().fold(0.0, f64::max);
            error += 4.0 * EPS * EPS * most;
        }
        Self {
            shift,
            p,
            q,
            inverse: q.map(|q| 1.0 / q),
            error,
            drift,
            pace: 1.0 / (q[0].abs().max(q[1].abs()).max(q[2].abs()) - drift),
        }
    }

    /// The same ray in the parameters of a cell that starts at `start` of this space.
    #[inline(always)]
    pub(crate) fn from(&self, start: [f64; 3]) -> Self {
        Self {
            p: std::array::from_fn(|a| self.p[a] - start[a]),
            ..*self
        }
    }
}

/// The attribute of an element with affine geometry, minus the isovalue, and the box of parameters it holds on.
pub(crate) struct Field<'a> {
    pub(crate) place: &'a Place,
    pub(crate) degree: [usize; 3],
    /// Bernstein coefficients on [0, 1]^3.
    pub(crate) values: &'a [f64],
    pub(crate) lo: [f64; 3],
    pub(crate) hi: [f64; 3],
    pub(crate) surface: u8,
    /// Error of computed coefficients along a ray.
    rounding: f64,
    /// Sum of the greatest partial derivatives.
    slope: f64,
}

/// Roundings of a composed coefficient, in units of 2^-53 of the greatest coefficient and isovalue: of each axis 3 d in a blossom, d + 2 in the sum over a row, d + 2 in the product; one
/// division; 12 for the coefficients themselves (a conversion from B-splines and the isovalue taken off). Taken twice as many.
pub(crate) fn roundings(degree: [usize; 3]) -> f64 {
    (10 * (degree[0] + degree[1] + degree[2]) + 36) as f64
}

impl<'a> Field<'a> {
    /// `size`: greatest magnitude of the numbers the values were made of, isovalue included. `ends`: their range.
    pub(crate) fn new(
        place: &'a Place,
        degree: [usize; 3],
        values: &'a [f64],
        surface: u8,
        size: f64,
        ends: (f64, f64),
        (lo, hi): ([f64; 3], [f64; 3]),
    ) -> Self {
        let total = (degree[0] + degree[1] + degree[2]) as f64;
        Self {
            place,
            degree,
            values,
            lo,
            hi,
            surface,
            rounding: EPS * roundings(degree) * size,
            slope: total * (ends.1 - ends.0) * 1.01,
        }
    }
}

/// Corners of an element whose geometry is exactly a box (with a volume) with faces along the world's axes and whose attribute is polynomial, of no higher degree than the search takes.
pub(crate) fn exact_box(e: &HexElement) -> Option<(DVec3, DVec3)> {
    let total: u32 = e.value_degree.iter().map(|&d| u32::from(d)).sum();
    if e.degree != [1; 3] || total as usize > MAX_DEGREE || !e.is_polynomial() {
        return None;
    }
    let ends = [e.points[0], e.points[7]];
    let boxed = (0..8).all(|n| (0..3).all(|a| e.points[n][a] == ends[n >> a & 1][a]));
    let at = |p: [f64; 4]| DVec3::new(p[0], p[1], p[2]);
    let corners = (at(ends[0]), at(ends[1]));
    (boxed && Place::of_box(corners.0, corners.1).is_some()).then_some(corners)
}

/// Whether an eye is so near to a box, in sizes of its thinnest side, that the box is known from a plane: at 2^53 of them one size is a rounding of the distance. Others are halved as any element, in world coordinates.
pub(crate) fn is_near((lo, hi): (DVec3, DVec3), eye: DVec3) -> bool {
    let far = (eye - lo).abs().max((eye - hi).abs());
    (far / (hi - lo).abs()).max_element() < 1e15
}

/// The pixels whose rays may pass a box: its centre in the camera frame and half its extent there. `noise`: error of the centre.
#[inline(always)]
pub(crate) fn rectangle(f: &Frustum, centre: [f64; 3], half: [f64; 3], noise: f64, all: PixelBox) -> Option<PixelBox> {
    let ends = |a: usize| {
        let h = half[a] * BORDER + noise;
        (centre[a] - h, centre[a] + h)
    };
    let (x, y, z) = (ends(0), ends(1), ends(2));
    if f.parallel {
        return f.narrow(all, x, y);
    }
    if z.1 < 0.0 {
        return None;
    }
    // Before and behind the eye: no quotients.
    if z.0 <= 1e-9 * z.1 {
        return Some(all);
    }
    let (near, far) = (1.0 / z.0, 1.0 / z.1);
    let slopes = |(a, b): (f64, f64)| {
        let lo = a * if a < 0.0 { near } else { far };
        let hi = b * if b < 0.0 { far } else { near };
        (lo - 8.0 * EPS * lo.abs(), hi + 8.0 * EPS * hi.abs())
    };
    f.narrow(all, slopes(x), slopes(y))
}

/// Weights of the coefficients of degree d in the coefficients of the same polynomial on a segment: `w[i][m]` of coefficient i in coefficient m, times binomial(d, m).
#[inline(always)]
fn blossoms<const N: usize>(d: usize, a: f64, b: f64) -> [[f64; N]; N] {
    let mut out = [[0.0; N]; N];
    let mut binomial = 1.0;
    for m in 0..=d {
        let mut w = [0.0; N];
        w[0] = 1.0;
        for s in 0..d {
            let x = if s < d - m { a } else { b };
            let y = 1.0 - x;
            for i in (1..=s + 1).rev() {
                w[i] = w[i] * y + w[i - 1] * x;
            }
            w[0] *= y;
        }
        for (out, w) in out.iter_mut().zip(&w).take(d + 1) {
            out[m] = w * binomial;
        }
        binomial = binomial * (d - m) as f64 / (m + 1) as f64;
    }
    out
}

/// Bernstein coefficients of the attribute on the segment from `a` to `b`. `N`: room for an axis, `M` for the result.
#[inline(always)]
fn compose<const N: usize, const M: usize>(d: [usize; 3], values: &[f64], a: [f64; 3], b: [f64; 3], out: &mut [f64; CAPACITY]) {
    let x = blossoms::<N>(d[0], a[0], b[0]);
    let y = blossoms::<N>(d[1], a[1], b[1]);
    let z = blossoms::<N>(d[2], a[2], b[2]);
    let mut sum = [0.0; M];
    let mut at = 0;
    for z in &z[..=d[2]] {
        let mut plane = [0.0; M];
        for y in &y[..=d[1]] {
            let mut row = [0.0; N];
            for x in &x[..=d[0]] {
                let v = values[at];
                at += 1;
                for m in 0..=d[0] {
                    row[m] += v * x[m];
                }
            }
            for m in 0..=d[0] {
                for n in 0..=d[1] {
                    plane[m + n] += row[m] * y[n];
                }
            }
        }
        for m in 0..=d[0] + d[1] {
            for n in 0..=d[2] {
                sum[m + n] += plane[m] * z[n];
            }
        }
    }
    let total = d[0] + d[1] + d[2];
    let mut binomial = 1.0;
    for (m, out) in out.iter_mut().enumerate().take(total + 1) {
        *out = sum[m] / binomial;
        binomial = binomial * (total - m) as f64 / (m + 1) as f64;
    }
}

/// The instance whose degrees the compiler knows, or the general one.
#[inline(always)]
fn along(d: [usize; 3], values: &[f64], a: [f64; 3], b: [f64; 3], out: &mut [f64; CAPACITY]) {
    match d {
        [1, 1, 1] => compose::<2, 4>([1; 3], values, a, b, out),
        [2, 2, 2] => compose::<3, 7>([2; 3], values, a, b, out),
        [3, 3, 3] => compose::<4, 10>([3; 3], values, a, b, out),
        _ => along_any(d, values, a, b, out),
    }
}

/// Outside of the kernels: it is large and seldom used.
#[inline(never)]
fn along_any(d: [usize; 3], values: &[f64], a: [f64; 3], b: [f64; 3], out: &mut [f64; CAPACITY]) {
    compose::<MOST, CAPACITY>(d, values, a, b, out);
}

impl Solver {
    /// All roots of an element with exactly box-shaped geometry.
    #[inline(always)]
    pub(crate) fn solve_box(&mut self, f: &Frustum, e: &HexElement, (lo, hi): (DVec3, DVec3), surface: u8, c: f64) {
        let (middle, half) = ((lo + hi) * 0.5 - f.eye, (hi - lo).abs() * 0.5);
        let axes = [f.right, f.up, f.forward];
        let noise = EPS * 16.0 * (lo.abs().max(hi.abs()) + f.eye.abs()).element_sum();
        let pixels = rectangle(
            f,
            axes.map(|a| a.dot(middle)),
            axes.map(|a| a.abs().dot(half)),
            noise,
            f.all(),
        );
        let Some(pixels) = pixels else { return };
        let Some(place) = Place::of_box(lo, hi) else { return };
        let mut values = std::mem::take(&mut self.values);
        values.clear();
        values.extend(e.values.iter().map(|v| v - c));
        let (least, most) = e.value_range();
        let field = Field::new(
            &place,
            e.value_degree.map(usize::from),
            &values,
            surface,
            least.abs().max(most.abs()) + c.abs(),
            (least, most),
            ([0.0; 3], [1.0; 3]),
        );
        self.work.tasks += 1;
        for y in usize::from(pixels.y0)..=usize::from(pixels.y1) {
            for x in usize::from(pixels.x0)..=usize::from(pixels.x1) {
                let pixel = y * f.width + x;
                self.along_ray(&field, &LocalRay::new(&place, &f.rays[pixel].ray, [0.5; 3]), pixel);
            }
        }
        self.values = values;
    }

    /// All roots of one element on one ray.
    #[inline(always)]
    pub(crate) fn along_ray(&mut self, field: &Field<'_>, ray: &LocalRay, pixel: usize) {
        let size = ray.p[0].abs().max(ray.p[1].abs()).max(ray.p[2].abs());
        // The ray is past the box, margin and all, once it has gone by size + 2 along its main axis.
        let delta = ray.error + (size + 2.0) * (ray.pace * ray.drift + 8.0 * EPS);
        if !(0.0..=MOST_DELTA).contains(&delta) {
            self.undecided[pixel] = true;
            self.work.limits += 1;
            return;
        }
        let wide = WIDE.max(8.0 * delta);
        let (mut t0, mut t1) = (-ray.shift, f64::INFINITY);
        for a in 0..3 {
            let from = (field.lo[a] - wide - ray.p[a]) * ray.inverse[a];
            let to = (field.hi[a] + wide - ray.p[a]) * ray.inverse[a];
            t0 = t0.max(from.min(to));
            t1 = t1.min(from.max(to));
        }
        if t0 > t1 || self.ends.is_past(pixel, ray.shift + t0) {
            return;
        }
        self.work.polynomials += 1;
        if let Some(seen) = &mut self.seen {
            seen[pixel] += 1;
        }
        let a: [f64; 3] = std::array::from_fn(|i| ray.p[i] + t0 * ray.q[i]);
        let b: [f64; 3] = std::array::from_fn(|i| ray.p[i] + t1 * ray.q[i]);
        let mut p = [0.0; CAPACITY];
        along(field.degree, field.values, a, b, &mut p);
        let p = &p[..=field.degree[0] + field.degree[1] + field.degree[2]];
        let error = field.rounding + field.slope * delta;
        let (least, most) = range(p);
        if least > error || most < -error {
            return;
        }
        // Where the error hides the sign further from the root than the wanted width, as it does where the attribute is flat, asking for less only costs bisections.
        let tolerance = Tolerance {
            error,
            ..Tolerance::new(WIDTH.max(8.0 * error / (most - least)).min(1e-3))
        };
        self.roots(
            field,
            p,
            &tolerance,
            delta,
            &Segment {
                t0,
                t1,
                a,
                b,
                shift: ray.shift,
            },
            pixel,
        );
    }

    /// The polynomial has both signs: its roots.
    fn roots(&mut self, field: &Field<'_>, p: &[f64], tolerance: &Tolerance<f64>, delta: f64, s: &Segment, pixel: usize) {
        let changes = p.windows(2).filter(|w| (w[0] < 0.0) != (w[1] < 0.0)).count();
        // One root, which the cheaper search finds.
        if changes == 1
            && p.iter().all(|v| v.abs() > tolerance.error)
            && let First::Root(r) = first_root(p, tolerance)
        {
            self.root(field, p, &r, delta, s, pixel);
            return;
        }
        let roots = all_roots(p, tolerance);
        if roots.gave_up().is_some() {
            self.undecided[pixel] = true;
            self.work.limits += 1;
        }
        for r in roots.as_slice() {
            self.root(field, p, r, delta, s, pixel);
        }
    }

    /// A root as a hit, unless it certainly lies outside the box.
    #[inline(always)]
    fn root(&mut self, field: &Field<'_>, p: &[f64], r: &Root<f64>, delta: f64, s: &Segment, pixel: usize) {
        let at = |x: f64, i: usize| s.a[i] + x * (s.b[i] - s.a[i]);
        let (mut inside, mut outside) = (true, false);
        for i in 0..3 {
            let (u, v) = (at(r.lo, i), at(r.hi, i));
            let (low, high) = (u.min(v), u.max(v));
            let room = 2.0 * delta;
            inside &= low >= field.lo[i] + room && high <= field.hi[i] - room;
            outside |= high < field.lo[i] - room || low > field.hi[i] + room;
        }
        if outside {
            return;
        }
        let time = |x: f64| s.shift + (s.t0 + x * (s.t1 - s.t0));
        // One more step: the search stops where its bracket is narrow enough.
        let (value, slope) = eval_with_derivative(p, r.t);
        let next = r.t - value / slope;
        let x = if r.kind == RootKind::Crossing && next >= r.lo && next <= r.hi {
            next
        } else {
            r.t
        };
        let t = time(x);
        let u: [f64; 3] = std::array::from_fn(|i| at(x, i));
        let [_, gu, gv, gw] = jet(field.degree, field.values, &bases(field.degree, u));
        let found = Found {
            pixel: pixel as u16,
            surface: field.surface,
            certain: inside && r.kind == RootKind::Crossing,
            face: !inside && r.kind == RootKind::Crossing,
            t,
            error: (t - time(r.lo)).max(time(r.hi) - t) + 8.0 * EPS * (s.t0.abs().max(s.t1.abs()) + s.shift.abs()),
            normal: field.place.gradient([gu, gv, gw]).normalize_or(DVec3::ZERO),
        };
        self.ends.note(&found);
        self.found.push(found);
    }
}

/// The part of a ray in an element: ends in t and in parameters.
struct Segment {
    t0: f64,
    t1: f64,
    a: [f64; 3],
    b: [f64; 3],
    shift: f64,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bernstein::{count, value};

    #[test]
    fn the_polynomial_along_a_segment_is_the_attribute() {
        for d in [[1, 1, 1], [2, 2, 2], [3, 3, 3], [5, 2, 0], [9, 9, 9]] {
            let c: Vec<f64> = (0..count(d)).map(|i| (i * i * 7 % 23) as f64 - 9.0).collect();
            let (a, b) = ([0.0, 0.9, 0.25], [1.0, 0.1, 0.75]);
            let mut p = [0.0; CAPACITY];
            along(d, &c, a, b, &mut p);
            let p = &p[..=d.iter().sum::<usize>()];
            for n in 0..=10 {
                let x = f64::from(n) * 0.1;
                let u = [0, 1, 2].map(|i| a[i] + x * (b[i] - a[i]));
                let want = value(d, &c, &bases(d, u));
                let bound = EPS * (roundings(d) + 100.0) * 14.0;
                assert!((isobar_poly::bernstein::eval(p, x) - want).abs() <= bound, "{d:?} {x}");
            }
        }
    }

    #[test]
    fn boxes_are_told_from_what_is_nearly_one() {
        let e = crate::tests::element([1; 3], |[u, v, w]| [3.0 * u - 1.0, 0.1 * v, w + 7.0], [3, 0, 1], &[0.5; 8]);
        assert_eq!(exact_box(&e), Some((DVec3::new(-1.0, 0.0, 7.0), DVec3::new(2.0, 0.1, 8.0))));
        let mut bent = e.clone();
        bent.points[5][1] += 1e-17;
        assert_eq!(exact_box(&bent), None);
        let mut heavy = e.clone();
        heavy.points[5][3] = 2.0;
        assert_eq!(exact_box(&heavy), None);
        let high = HexElement {
            value_degree: [10, 10, 8],
            values: vec![0.0; 11 * 11 * 9].into(),
            ..e
        };
        assert_eq!(exact_box(&high), None);
    }

    #[test]
    fn rays_in_parameters_are_within_their_bounds() {
        use glam::DMat3;
        let oblique = DMat3::from_cols(
            DVec3::new(1.0, 2.0, -0.5),
            DVec3::new(0.25, 1.0, 0.125),
            DVec3::new(-0.75, 0.25, 2.0),
        );
        let d = isobar_core::Domain {
            origin: DVec3::new(0.3, -7.0, 1e3),
            axes: oblique,
            lo: DVec3::ZERO,
            hi: DVec3::splat(9.0),
        };
        let place = Place::of_domain(&d).unwrap();
        let u = DVec3::new(3.0, 5.0, 7.0);
        // Exact.
        let x = oblique * u;
        let (v, error) = place.local(x);
        let most = (DVec3::from_array(v) - u).abs().max_element();
        assert!(most <= error && error < 1e-12, "{most:e} {error:e}");
        let flat = isobar_core::Domain {
            axes: DMat3::from_cols(DVec3::X, DVec3::X, DVec3::Z),
            ..d
        };
        assert!(Place::of_domain(&flat).is_none());
    }
}
