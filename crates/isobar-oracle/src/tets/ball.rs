//! A number with a bound on its error, and the stay of a ray in one tetrahedron in that arithmetic.
//!
//! A [`Ball`] is a value of f64 or double-double and an f64 not below its distance from the exact result. Each operation adds the propagated errors
//! of its operands and its own rounding, `UNIT` times the result; the bound itself is rounded upward by the factor `1 + 8u` and the least normal
//! number. Signs are only told where the ball excludes 0.
//!
//! **The stay.** With `q_i = p_i - o` the side of edge ij is `S_ij = d . (q_i x (p_j - p_i))`. If no side is 0, the ray's line crosses the inside of a
//! face abc exactly where `S_ab, S_bc, S_ca` have one sign, and it crosses two faces or none. The sides are then the barycentric
//! weights of the crossing, `w_a = S_bc` and so on, by which s and `t = (x - o) . d/(d . d)` are both interpolated.

use super::tree::moderate;
use crate::real::{Dd, Real, U64, two_prod};
use isobar_core::{DVec3, Ray};

/// See the module.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Ball<R> {
    pub(crate) x: R,
    pub(crate) e: f64,
}

/// A number type that can also divide.
pub(crate) trait Divide: Real {
    /// Bound on the relative error of a quotient.
    const QUOTIENT: f64;
    fn divide(self, y: Self) -> Self;
    /// f64 that enclose the values within e.
    fn enclosed(self, e: f64) -> (f64, f64);
}

impl Divide for f64 {
    const QUOTIENT: f64 = Self::UNIT;
    fn divide(self, y: Self) -> Self {
        self / y
    }
    fn enclosed(self, e: f64) -> (f64, f64) {
        ((self - e).next_down(), (self + e).next_up())
    }
}

impl Divide for Dd {
    /// `15u^2 + 56u^3` is below twice `8u^2`.
    const QUOTIENT: f64 = 2.0 * Self::UNIT;
    fn divide(self, y: Self) -> Self {
        self.divide(y)
    }
    fn enclosed(self, e: f64) -> (f64, f64) {
        // The distances from `hi`, rounded upward; the sums round by at most half an ulp, which the step to the next f64 covers.
        let (down, above) = (up(e - self.lo), up(e + self.lo));
        let lo = if down <= 0.0 { self.hi } else { (self.hi - down).next_down() };
        let hi = if above <= 0.0 { self.hi } else { (self.hi + above).next_up() };
        (lo, hi)
    }
}

/// Rounds a bound that took a few operations upward.
fn up(e: f64) -> f64 {
    e + (4.0 * f64::EPSILON * e.abs() + f64::MIN_POSITIVE)
}

impl<R: Divide> Ball<R> {
    fn rounded(x: R, propagated: f64, unit: f64) -> Self {
        Self {
            x,
            e: up(propagated + unit * x.f64().abs()),
        }
    }

    /// `a - b` of exact numbers.
    pub(crate) fn difference(a: f64, b: f64) -> Self {
        Self::rounded(R::difference(a, b), 0.0, R::UNIT)
    }

    pub(crate) fn exact(x: f64) -> Self {
        Self {
            x: R::from_f64(x),
            e: 0.0,
        }
    }

    pub(crate) fn plus(self, o: Self) -> Self {
        Self::rounded(self.x + o.x, self.e + o.e, R::UNIT)
    }

    pub(crate) fn negated(self) -> Self {
        Self { x: -self.x, e: self.e }
    }

    pub(crate) fn minus(self, o: Self) -> Self {
        self.plus(o.negated())
    }

    pub(crate) fn times(self, o: Self) -> Self {
        let (a, b) = (self.x.f64().abs(), o.x.f64().abs());
        Self::rounded(self.x * o.x, a * o.e + b * self.e + self.e * o.e, R::UNIT)
    }

    /// The quotient, where the divisor is certainly not 0.
    pub(crate) fn over(self, o: Self) -> Option<Self> {
        let least = (o.x.f64().abs() - o.e) * (1.0 - 8.0 * f64::EPSILON);
        (least > 0.0).then(|| {
            let x = self.x.divide(o.x);
            Self::rounded(x, (self.e + x.f64().abs() * o.e) / least, R::QUOTIENT)
        })
    }

    /// -1 or 1 where certain.
    pub(crate) fn sign(self) -> Option<i32> {
        let x = self.x.f64();
        // The leading part of a double-double is its value to half an ulp.
        (x.abs() * (1.0 - 4.0 * f64::EPSILON) > self.e).then_some(if x > 0.0 { 1 } else { -1 })
    }

    /// f64 below and above.
    pub(crate) fn bounds(self) -> (f64, f64) {
        self.x.enclosed(self.e)
    }
}

fn dot<R: Divide>(a: [Ball<R>; 3], b: [Ball<R>; 3]) -> Ball<R> {
    a[0].times(b[0]).plus(a[1].times(b[1])).plus(a[2].times(b[2]))
}

fn cross<R: Divide>(a: [Ball<R>; 3], b: [Ball<R>; 3]) -> [Ball<R>; 3] {
    std::array::from_fn(|i| {
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        a[j].times(b[k]).minus(a[k].times(b[j]))
    })
}

/// Where the ray's line goes through a cell.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stay<R> {
    /// t where it comes in and goes out, certainly in this order.
    pub(crate) t: [Ball<R>; 2],
    /// s - c there.
    pub(crate) f: [Ball<R>; 2],
    /// The corners opposite the faces there.
    pub(crate) faces: [usize; 2],
}

/// What this arithmetic says of a cell.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Seen<R> {
    /// The line does not meet the closed cell.
    Beside,
    /// It goes through its inside.
    Through(Stay<R>),
    /// Too close to tell.
    Unclear,
}

/// The edges, and the faces opposite corners 0 to 3: corners a, b, c and the sides of bc, ca, ab as (edge, turned round).
const EDGES: [[usize; 2]; 6] = [[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]];
const FACES: [[usize; 3]; 4] = [[1, 2, 3], [0, 2, 3], [0, 1, 3], [0, 1, 2]];
const SIDES: [[(usize, bool); 3]; 4] = [
    [(5, false), (4, true), (3, false)],
    [(5, false), (2, true), (1, false)],
    [(4, false), (2, true), (0, false)],
    [(3, false), (1, true), (0, false)],
];

/// The stay in a cell with these corners and values; all numbers 0 or in `[2^-120, 2^120]`.
pub(crate) fn see<R: Divide>(ray: &Ray, corners: &[DVec3; 4], values: &[f64; 4], c: f64) -> Seen<R> {
    let q = corners.map(|p| minus(p, ray.origin));
    see_from(ray.direction, &q, corners, values, c)
}

fn minus<R: Divide>(a: DVec3, b: DVec3) -> [Ball<R>; 3] {
    std::array::from_fn(|k| Ball::difference(a[k], b[k]))
}

/// The same with the corners `q` as seen from a point of the ray, from which t is then counted.
fn see_from<R: Divide>(direction: DVec3, q: &[[Ball<R>; 3]; 4], corners: &[DVec3; 4], values: &[f64; 4], c: f64) -> Seen<R> {
    let d = direction.to_array().map(Ball::<R>::exact);
    let mut side = [Ball::exact(0.0); 6];
    let mut sign = [0; 6];
    let mut all = true;
    for (n, [i, j]) in EDGES.into_iter().enumerate() {
        side[n] = dot(d, cross(q[i], minus(corners[j], corners[i])));
        match side[n].sign() {
            Some(s) => sign[n] = s,
            None => all = false,
        }
    }
    if !all {
        return if beside(&sign) { Seen::Beside } else { Seen::Unclear };
    }
    let signed = |(n, turned): (usize, bool)| if turned { -sign[n] } else { sign[n] };
    let crossed: Vec<usize> = (0..4)
        .filter(|&k| SIDES[k].iter().all(|&s| signed(s) == signed(SIDES[k][0])))
        .collect();
    let [a, b] = match crossed[..] {
        [] => return Seen::Beside,
        [a, b] => [a, b],
        _ => return Seen::Unclear,
    };
    let length = dot(d, d);
    let at = |face: usize| -> Option<(Ball<R>, Ball<R>)> {
        let w = SIDES[face].map(|(n, turned)| if turned { side[n].negated() } else { side[n] });
        let mut sums = [Ball::exact(0.0); 3];
        for (w, i) in w.into_iter().zip(FACES[face]) {
            sums[0] = sums[0].plus(w);
            sums[1] = sums[1].plus(w.times(dot(q[i], d)));
            sums[2] = sums[2].plus(w.times(Ball::difference(values[i], c)));
        }
        let t = sums[1].over(sums[0].times(length))?;
        Some((t, sums[2].over(sums[0])?))
    };
    let (Some(x), Some(y)) = (at(a), at(b)) else {
        return Seen::Unclear;
    };
    match y.0.minus(x.0).sign() {
        Some(1) => Seen::Through(Stay {
            t: [x.0, y.0],
            f: [x.1, y.1],
            faces: [a, b],
        }),
        Some(_) => Seen::Through(Stay {
            t: [y.0, x.0],
            f: [y.1, x.1],
            faces: [b, a],
        }),
        None => Seen::Unclear,
    }
}

/// The corners of a cell as seen from the point `o + t d` of the ray near its middle, t an f64: of the size of the cell, whatever the distance of the eye.
///
/// `o + t d` is an exact product and a sum in double-double (3u^2), the differences to the corners are sums too (3u^2 more); rounded to f64 they are wrong by at
/// most `u |q| + 2^-102 (|o| + |t d| + |p|)`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Near {
    pub(crate) t: f64,
    q: [[Ball<f64>; 3]; 4],
}

impl Near {
    /// `None` where t is beyond what double-double can multiply.
    pub(crate) fn new(ray: &Ray, corners: &[DVec3; 4]) -> Option<Self> {
        let (o, d) = (ray.origin, ray.direction);
        let middle = 0.25 * (corners[0] + corners[1] + corners[2] + corners[3]);
        let t = (middle - o).dot(d) / d.length_squared();
        if !moderate(t) {
            return None;
        }
        let mut q = [[Ball::<f64>::exact(0.0); 3]; 4];
        for k in 0..3 {
            let step = two_prod(t, d[k]);
            let here = step + Dd::new(o[k]);
            for (q, p) in q.iter_mut().zip(corners) {
                let x = Dd::new(p[k]) - here;
                q[k] = Ball {
                    x: x.hi,
                    e: up(U64 * x.hi.abs() + 1.98e-31 * (o[k].abs() + step.abs() + p[k].abs())),
                };
            }
        }
        Some(Self { t, q })
    }

    /// As [`see`], with t counted from [`Near::t`].
    pub(crate) fn see(&self, direction: DVec3, corners: &[DVec3; 4], values: &[f64; 4], c: f64) -> Seen<f64> {
        see_from(direction, &self.q, corners, values, c)
    }
}

/// The edges from each corner, as (edge, turned round).
const FROM: [[(usize, bool); 3]; 4] = [
    [(0, false), (1, false), (2, false)],
    [(0, true), (3, false), (4, false)],
    [(1, true), (3, true), (5, false)],
    [(2, true), (4, true), (5, true)],
];

/// Whether certain sides (0: not certain) already exclude the closed cell: where the three sides `S_ij` of a corner i have one certain sign. A point of the
/// cell on the ray's line is `sum_j w_j p_j` with weights that are not negative, and then `sum_j w_j S_ij = 0`: only `w_i` is left, and with
/// the line through corner i its sides are 0.
fn beside(sign: &[i32; 6]) -> bool {
    FROM.iter().any(|edges| {
        let sum: i32 = edges.iter().map(|&(n, turned)| if turned { -sign[n] } else { sign[n] }).sum();
        sum.abs() == 3
    })
}

/// Whether the line misses the closed cell for certain, by the same rule in plain f64: so it is with most cells whose box it meets. A side is a sum of six products `d_a q_b e_c`, each with the roundings of
/// `q = p - o` and of e (u each), two of its own and at most four more in sums, so it is wrong by less than `9u` times the sum of their magnitudes, for which `|d|_1 |q|_1 |e|_1` stands.
pub(crate) fn surely_beside(ray: &Ray, corners: &[DVec3; 4]) -> bool {
    const ERROR: f64 = 16.0 * U64;
    let size = |v: DVec3| v.abs().element_sum();
    let direction = ray.direction;
    let q = corners.map(|p| p - ray.origin);
    let most = size(direction) * ERROR;
    let sizes = q.map(size);
    let mut sign = [0; 6];
    for (n, [i, j]) in EDGES.into_iter().enumerate() {
        let edge = corners[j] - corners[i];
        let side = direction.dot(q[i].cross(edge));
        if side.abs() > most * sizes[i] * size(edge) + f64::MIN_POSITIVE {
            sign[n] = if side > 0.0 { 1 } else { -1 };
        }
    }
    beside(&sign)
}
