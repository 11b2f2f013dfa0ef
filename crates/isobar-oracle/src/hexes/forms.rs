//! Three polynomials in Bernstein form over a box, with bounds on the errors of their coefficients.
//!
//! **The system.** With the homogeneous geometry `X = sum w_i p_i B_i`, `W = sum w_i B_i` of an element, a ray `o + t d` and k the axis of the
//! greatest `|d_k|`, the two vectors `n_1 = d_k e_i - d_i e_k` and `n_2 = d_k e_j - d_j e_k` (i, j the other axes) span the plane orthogonal to d. So for W > 0
//! the point x(u) lies on the ray's line where `alpha = n_1 . (X - W o)` and `beta = n_2 . (X - W o)` vanish; their coefficients are
//! `w (d_k (p_i - o_i) - d_i (p_k - o_k))` and likewise with j: no division, and no vector that had to be rounded. The third is
//! `gamma = sum w_i (a_i - c) B_i` for a rational attribute, `sum (a_i - c) B_i` for a polynomial one, `u_axis - value` for a parameter surface.
//!
//! **Bounds.** U is the unit of the arithmetic (2^-53, or 2^-103 for double-double). One absolute bound e per polynomial holds for all its coefficients; M is
//! their greatest magnitude.
//! * A coefficient of alpha: two differences, two products, a difference and a product with w: at most `4U(1 + 4U)` of
//!   `|w| (|d_k| |p_i - o_i| + |d_i| |p_k - o_k|)`; 5U is used. gamma: 3U of its own size at most.
//! * One degree more: `c_i + r (c_(i-1) - c_i)` with a rounded quotient r (at most 2U) in [0, 1]: difference 2UM, product 2UM + 2UM + 4UM, sum 3UM: 12UM is used.
//! * A cut in the middle along an axis of degree n: n rounds of `(a + b)/2`, each wrong by at most UM, none enlarging what came before: `1.01 n U M`.
//! * A cut at t in `[-1/128, 1 + 1/128]` along an axis of degree n: n rounds of the step below, `(1 + 2/128)^n (e + 6 n U M)`.
//! * A value at m in `[-1/128, 1 + 1/128]^3`: `a + t (b - a)` is wrong by at most 6UM' for `|a|, |b| <= M'`, and enlarges M' and earlier errors by at most
//!   `1 + 2/128`. With N the sum of the degrees and `G = (1 + 2/128)^N` the error is at most `G (e + 6 N U M)`.
//! * Derivatives: with coefficients d_i in `[c - r, c + r]` a polynomial stays in `[c - G r, c + G r]` on the enlarged box, because
//!   `sum B_i = 1` and `sum |B_i| <= G` there.
//! * 2^-700 is added to every bound: more than all underflows, since every number that comes in is at most 2^120 in magnitude ([`super::moderate`]).

use super::{Line, Target};
use crate::{
    real::{Dd, U64},
    tets::ball::{Ball, Divide},
};
use isobar_core::HexElement;

/// By how much boxes are enlarged, in units of their size.
pub(super) const EDGE: f64 = 1.0 / 128.0;
/// 2^-700.
const TINY: f64 = 1.902e-211;

/// A number type of the search.
pub(super) trait Number: Divide {
    /// Half, exactly.
    fn half(self) -> Self;
    /// Product with an f64, at most `UNIT` wrong.
    fn scaled(self, y: f64) -> Self;
    /// Sum with an f64, at most `UNIT` wrong.
    fn shifted(self, y: f64) -> Self;
    /// The same as a double-double, exactly.
    fn dd(self) -> Dd;
}

impl Number for f64 {
    #[inline]
    fn half(self) -> Self {
        0.5 * self
    }
    #[inline]
    fn scaled(self, y: f64) -> Self {
        self * y
    }
    #[inline]
    fn shifted(self, y: f64) -> Self {
        self + y
    }
    fn dd(self) -> Dd {
        Dd::new(self)
    }
}

impl Number for Dd {
    #[inline]
    fn half(self) -> Self {
        Self {
            hi: 0.5 * self.hi,
            lo: 0.5 * self.lo,
        }
    }
    #[inline]
    fn scaled(self, y: f64) -> Self {
        self.times(y)
    }
    #[inline]
    fn shifted(self, y: f64) -> Self {
        self.plus(y)
    }
    fn dd(self) -> Dd {
        self
    }
}

/// A bound that took some operations, rounded upward.
pub(super) fn up(e: f64) -> f64 {
    e * (1.0 + 1e-13) + TINY
}

/// See the module.
#[derive(Clone, Debug)]
pub(super) struct Forms<R> {
    pub(super) degree: [usize; 3],
    /// Coefficients of one polynomial.
    pub(super) count: usize,
    /// Three times as many, u fastest.
    pub(super) c: Vec<R>,
    /// Bounds on their errors.
    pub(super) e: [f64; 3],
}

/// One polynomial on the way into [`Forms`].
struct Single<R> {
    degree: [usize; 3],
    c: Vec<R>,
    e: f64,
}

/// Derivatives over the enlarged box by its own unit coordinates: row j, axis k.
#[derive(Clone, Copy, Debug)]
pub(super) struct Slopes {
    pub(super) middle: [[f64; 3]; 3],
    pub(super) radius: [[f64; 3]; 3],
}

impl<R: Number> Single<R> {
    /// Greatest magnitude; with it whether the polynomial is certainly not 0 on the box.
    fn range(&self) -> (f64, bool) {
        let (lo, hi) = range(&self.c);
        (lo.abs().max(hi.abs()), one_sign(lo, hi, self.e))
    }

    /// alpha (other = 0) or beta (other = 1).
    fn across(element: &HexElement, line: &Line, other: usize) -> Self {
        let (k, i) = (line.along, line.others[other]);
        let (dk, di) = (line.direction[k], line.direction[i]);
        let mut most = 0.0f64;
        let c = element
            .points
            .iter()
            .map(|p| {
                let (a, b) = (R::difference(p[i], line.origin[i]), R::difference(p[k], line.origin[k]));
                most = most.max(p[3] * (dk.abs() * a.f64().abs() + di.abs() * b.f64().abs()));
                let x = a.scaled(dk) - b.scaled(di);
                if p[3] == 1.0 { x } else { x.scaled(p[3]) }
            })
            .collect();
        Self {
            degree: element.degree.map(usize::from),
            c,
            e: up(5.0 * R::UNIT * most),
        }
    }

    fn gamma(element: &HexElement, target: Target) -> Self {
        match target {
            Target::Isovalue(iso) => {
                let mut most = 0.0f64;
                let mut value = |v: f64, w: f64| {
                    let x = R::difference(v, iso).scaled(w);
                    most = most.max(x.f64().abs());
                    x
                };
                let c = if element.rational_value {
                    element
                        .values
                        .iter()
                        .zip(&element.points)
                        .map(|(&v, p)| value(v, p[3]))
                        .collect()
                } else {
                    element.values.iter().map(|&v| value(v, 1.0)).collect()
                };
                Self {
                    degree: element.value_degree.map(usize::from),
                    c,
                    e: up(3.0 * R::UNIT * most),
                }
            }
            Target::Parameter { axis, value } => Self {
                degree: std::array::from_fn(|a| usize::from(a == axis)),
                c: vec![R::from_f64(-value), R::difference(1.0, value)],
                e: up(2.0 * R::UNIT),
            },
        }
    }

    /// The same with the degrees wanted, each at least its own.
    fn elevated(mut self, to: [usize; 3]) -> Self {
        for (axis, to) in to.into_iter().enumerate() {
            while self.degree[axis] < to {
                let n = self.degree[axis];
                let stride: usize = self.degree[..axis].iter().map(|d| d + 1).product();
                let most = self.range().0;
                let ratio: Vec<R> = (0..=n + 1)
                    .map(|i| R::from_f64(i as f64).divide(R::from_f64((n + 1) as f64)))
                    .collect();
                let mut c = Vec::with_capacity(self.c.len() / (n + 1) * (n + 2));
                for block in self.c.chunks_exact(stride * (n + 1)) {
                    for (i, &r) in ratio.iter().enumerate() {
                        for s in 0..stride {
                            let at = |i: usize| block[i * stride + s];
                            c.push(match i {
                                0 => at(0),
                                _ if i == n + 1 => at(n),
                                _ => at(i) + (at(i - 1) - at(i)) * r,
                            });
                        }
                    }
                }
                self.c = c;
                self.degree[axis] += 1;
                self.e = up(self.e + 12.0 * R::UNIT * most);
            }
        }
        self
    }
}

/// Least and greatest coefficient, leading parts.
#[inline]
fn range<R: Number>(c: &[R]) -> (f64, f64) {
    c.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), x| {
        let x = x.f64();
        (if x < lo { x } else { lo }, if x > hi { x } else { hi })
    })
}

/// Whether coefficients between `lo` and `hi` (the leading parts) that are wrong by at most e exclude a zero.
#[inline]
fn one_sign(lo: f64, hi: f64, e: f64) -> bool {
    // The leading part of a double-double is its value to half an ulp.
    lo > 0.0 && lo * (1.0 - 4.0 * f64::EPSILON) > e || hi < 0.0 && -hi * (1.0 - 4.0 * f64::EPSILON) > e
}

impl<R: Number> Forms<R> {
    /// The system of an element; `None` where one of the three is certainly not 0 in it.
    pub(super) fn new(element: &HexElement, line: &Line, target: Target) -> Option<Self> {
        Self::near(element, line, target, 0.0)
    }

    /// The same; `None` for gamma only where it is certainly farther than `band` from 0.
    pub(super) fn near(element: &HexElement, line: &Line, target: Target, band: f64) -> Option<Self> {
        let gamma = Single::<R>::gamma(element, target);
        let (lo, hi) = range(&gamma.c);
        if one_sign(lo, hi, up(gamma.e + band)) {
            return None;
        }
        let alpha = Single::across(element, line, 0);
        if alpha.range().1 {
            return None;
        }
        let beta = Single::across(element, line, 1);
        if beta.range().1 {
            return None;
        }
        Some(Self::join([alpha, beta, gamma]))
    }

    /// Some of the three, and `u_k - value` for the axes given: the system of a root on faces.
    pub(super) fn on_faces(
        element: &HexElement,
        line: &Line,
        target: Target,
        kept: &[usize],
        faces: &[(usize, f64)],
    ) -> Option<Self> {
        let kept = kept.iter().map(|&row| match row {
            0 | 1 => Single::across(element, line, row),
            _ => Single::gamma(element, target),
        });
        let faces = faces
            .iter()
            .map(|&(axis, value)| Single::gamma(element, Target::Parameter { axis, value }));
        let all: Vec<Single<R>> = kept.chain(faces).collect();
        all.try_into().ok().map(Self::join)
    }

    fn join(all: [Single<R>; 3]) -> Self {
        let degree = std::array::from_fn(|a| all.iter().map(|s| s.degree[a]).max().unwrap_or(0));
        let all = all.map(|s| s.elevated(degree));
        let e = [all[0].e, all[1].e, all[2].e];
        let count = all[0].c.len();
        let mut c = Vec::with_capacity(3 * count);
        for s in all {
            c.extend(s.c);
        }
        Self { degree, count, c, e }
    }

    fn row(&self, j: usize) -> &[R] {
        &self.c[j * self.count..(j + 1) * self.count]
    }

    /// Greatest magnitudes; `None` where one is certainly not 0 on the box, gamma by more than `band`.
    pub(super) fn sizes(&self, band: f64) -> Option<[f64; 3]> {
        let mut most = [0.0; 3];
        for (j, m) in most.iter_mut().enumerate() {
            let (lo, hi) = range(self.row(j));
            let e = if j == 2 { up(self.e[2] + band) } else { self.e[j] };
            if one_sign(lo, hi, e) {
                return None;
            }
            *m = lo.abs().max(hi.abs());
        }
        Some(most)
    }

    /// How far values may leave the hull of the coefficients on the enlarged box.
    fn growth(&self) -> f64 {
        (1.0 + 2.0 * EDGE).powi(self.degree.iter().sum::<usize>() as i32) * (1.0 + 1e-12)
    }

    /// See [`Slopes`].
    pub(super) fn slopes(&self, most: &[f64; 3]) -> Slopes {
        let growth = self.growth();
        let mut out = Slopes {
            middle: [[0.0; 3]; 3],
            radius: [[0.0; 3]; 3],
        };
        for (j, &size) in most.iter().enumerate() {
            let row = self.row(j);
            let mut stride = 1;
            for k in 0..3 {
                let n = self.degree[k];
                if n > 0 {
                    let (mut lo, mut hi) = (f64::INFINITY, f64::NEG_INFINITY);
                    for block in row.chunks_exact(stride * (n + 1)) {
                        for (a, b) in block.iter().zip(&block[stride..]) {
                            let x = (*b - *a).f64();
                            lo = if x < lo { x } else { lo };
                            hi = if x > hi { x } else { hi };
                        }
                    }
                    let n = n as f64;
                    out.middle[j][k] = 0.5 * n * (lo + hi);
                    // Two coefficients and their difference; its leading part and the middle.
                    let doubt = 2.0 * self.e[j] + 4.0 * R::UNIT * size + 8.0 * U64 * lo.abs().max(hi.abs());
                    out.radius[j][k] = up(growth * n * (0.5 * (hi - lo) + doubt));
                }
                stride *= n + 1;
            }
        }
        out
    }

    /// Values at a point of the enlarged box, and bounds on their errors.
    pub(super) fn value(&self, at: &[R; 3], most: &[f64; 3], scratch: &mut Vec<R>) -> ([R; 3], [f64; 3]) {
        let sum: usize = self.degree.iter().sum();
        let growth = self.growth();
        let values = std::array::from_fn(|j| {
            scratch.clear();
            scratch.extend_from_slice(self.row(j));
            let mut slab = self.count;
            for axis in (0..3).rev() {
                let n = self.degree[axis];
                slab /= n + 1;
                for last in (1..=n).rev() {
                    for first in (0..last).map(|i| i * slab) {
                        let (head, tail) = scratch.split_at_mut(first + slab);
                        for (a, &b) in head[first..].iter_mut().zip(&tail[..slab]) {
                            *a = *a + (b - *a) * at[axis];
                        }
                    }
                }
            }
            scratch[0]
        });
        let errors = std::array::from_fn(|j| up(growth * (self.e[j] + 6.0 * sum as f64 * R::UNIT * most[j])));
        (values, errors)
    }

    /// The greatest magnitude of `sum_j y_j F_j`, the bound on its error, and whether it is certainly not 0 on the box.
    pub(super) fn combined(&self, y: &[f64; 3], most: &[f64; 3], band: f64) -> (f64, f64, bool) {
        let (mut lo, mut hi) = (f64::INFINITY, f64::NEG_INFINITY);
        let (a, b, g) = (self.row(0), self.row(1), self.row(2));
        for ((a, b), g) in a.iter().zip(b).zip(g) {
            let x = (a.scaled(y[0]) + b.scaled(y[1]) + g.scaled(y[2])).f64();
            lo = if x < lo { x } else { lo };
            hi = if x > hi { x } else { hi };
        }
        // Three products, two sums: 4U of the sum of magnitudes.
        let e = (0..3)
            .map(|j| y[j].abs() * (self.e[j] + 4.0 * R::UNIT * most[j]))
            .sum::<f64>()
            + y[2].abs() * band;
        let e = up(e);
        (lo.abs().max(hi.abs()), e, one_sign(lo, hi, e))
    }

    /// Value and derivatives at a point, in f64 and without bounds.
    pub(super) fn jet(&self, at: &[f64; 3]) -> ([f64; 3], [[f64; 3]; 3]) {
        let b: [_; 3] = std::array::from_fn(|k| super::place::basis(self.degree[k], at[k]));
        let (mut value, mut slope) = ([0.0; 3], [[0.0; 3]; 3]);
        for j in 0..3 {
            let mut c = self.row(j).iter();
            for (z, dz) in b[2].0.iter().zip(&b[2].1) {
                for (y, dy) in b[1].0.iter().zip(&b[1].1) {
                    let (mut x, mut dx) = (0.0, 0.0);
                    for ((w, dw), c) in b[0].0.iter().zip(&b[0].1).zip(&mut c) {
                        let c = c.f64();
                        x += w * c;
                        dx += dw * c;
                    }
                    value[j] += x * y * z;
                    slope[j][0] += dx * y * z;
                    slope[j][1] += x * dy * z;
                    slope[j][2] += x * y * dz;
                }
            }
        }
        (value, slope)
    }

    /// Cuts at `t` along an axis and keeps the upper part, or the lower.
    fn cut(&mut self, axis: usize, t: R, upper: bool, most: &mut [f64; 3]) {
        let n = self.degree[axis];
        let stride: usize = self.degree[..axis].iter().map(|d| d + 1).product();
        for l in self.c.chunks_exact_mut(stride * (n + 1)) {
            for m in 1..=n {
                if upper {
                    // Slab i holds the point of the level that begins at i.
                    for i in 0..(n + 1 - m) * stride {
                        l[i] = l[i] + (l[i + stride] - l[i]) * t;
                    }
                } else {
                    for i in (m * stride..(n + 1) * stride).rev() {
                        l[i] = l[i - stride] + (l[i] - l[i - stride]) * t;
                    }
                }
            }
        }
        let growth = (1.0 + 2.0 * EDGE).powi(n as i32) * (1.0 + 1e-12);
        for (e, m) in self.e.iter_mut().zip(most) {
            *e = up(growth * (*e + 6.0 * n as f64 * R::UNIT * *m));
            *m *= growth;
        }
    }

    /// The same polynomials on a box within `EDGE` of this one: in `[m - w, m + w]` per axis, up to the rounding of its ends, which are given as
    /// lower end and size.
    pub(super) fn about(&self, m: &[f64; 3], w: f64, most: &[f64; 3]) -> (Self, [Ball<R>; 3], [Ball<R>; 3]) {
        let (mut new, mut most) = (self.clone(), *most);
        let mut lower = [Ball::exact(0.0); 3];
        let mut size = [Ball::exact(1.0); 3];
        for k in 0..3 {
            // The first cut is exact; the second, at a rounded quotient in (0, 1), defines the other end.
            let (lo, hi) = (m[k] - w, m[k] + w);
            if m[k] < 0.5 {
                let t = R::from_f64((hi - lo) / (1.0 - lo));
                new.cut(k, R::from_f64(lo), true, &mut most);
                new.cut(k, t, false, &mut most);
                lower[k] = Ball::exact(lo);
                size[k] = Ball { x: t, e: 0.0 }.times(Ball::exact(1.0).minus(lower[k]));
            } else {
                let t = R::from_f64(lo / hi);
                new.cut(k, R::from_f64(hi), false, &mut most);
                new.cut(k, t, true, &mut most);
                lower[k] = Ball { x: t, e: 0.0 }.times(Ball::exact(hi));
                size[k] = Ball::exact(hi).minus(lower[k]);
            }
        }
        (new, lower, size)
    }

    /// The halves along an axis; vectors come from the pool.
    pub(super) fn halves(&self, axis: usize, most: &[f64; 3], pool: &mut Vec<Vec<R>>) -> [Self; 2] {
        let n = self.degree[axis];
        let stride: usize = self.degree[..axis].iter().map(|d| d + 1).product();
        let mut left = pool.pop().unwrap_or_default();
        left.clear();
        left.extend_from_slice(&self.c);
        let mut right = pool.pop().unwrap_or_default();
        right.resize(left.len(), R::ZERO);
        for (l, r) in left
            .chunks_exact_mut(stride * (n + 1))
            .zip(right.chunks_exact_mut(stride * (n + 1)))
        {
            // After round m, slab i >= m of l holds the point of level m that ends at i.
            for m in 0..=n {
                r[(n - m) * stride..(n - m + 1) * stride].copy_from_slice(&l[n * stride..]);
                for i in (m + 1..=n).rev() {
                    let (head, tail) = l.split_at_mut(i * stride);
                    for (b, &a) in tail[..stride].iter_mut().zip(&head[(i - 1) * stride..]) {
                        *b = (a + *b).half();
                    }
                }
            }
        }
        let e = std::array::from_fn(|j| up(self.e[j] + 1.01 * n as f64 * R::UNIT * most[j]));
        [left, right].map(|c| Self {
            degree: self.degree,
            count: self.count,
            c,
            e,
        })
    }
}
