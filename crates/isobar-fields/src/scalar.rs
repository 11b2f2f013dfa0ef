//! Number types the formulas of the analytic fields are evaluated with: values, enclosures, gradients and Taylor terms along a ray.
//!
//! A formula is written once, generic over [`Scalar`]. With [`Interval`] every operation rounds outward, so each result
//! encloses the real one; pi is the real number.

use isobar_core::Interval;
use std::f64::consts::PI;
use std::ops::{Add, Mul, Sub};

/// What a formula may use.
pub(crate) trait Scalar: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// The number `k` exactly.
    fn constant(k: f64) -> Self;
    /// pi * k.
    fn pi_times(k: f64) -> Self;
    /// 1 / k, k not 0.
    fn one_over(k: f64) -> Self;
    fn sin(self) -> Self;
    fn cos(self) -> Self;
    fn sin_cos(self) -> (Self, Self);
    /// `k` times this.
    fn scale(self, k: f64) -> Self;
    fn powi(self, n: u32) -> Self;
    /// cos(sqrt(p)), an entire function of p; p >= 0 up to rounding.
    fn cos_sqrt(self) -> Self;
}

/// The scalars that carry no derivatives.
pub(crate) trait Plain: Scalar {
    /// sin(sqrt(p)) / sqrt(p): -2 times the derivative of cos(sqrt(p)).
    fn sinc_sqrt(self) -> Self;
    /// Derivative of [`Plain::sinc_sqrt`] by p.
    fn sinc_sqrt_slope(self) -> Self;
}

impl Scalar for f64 {
    fn constant(k: f64) -> Self {
        k
    }
    fn pi_times(k: f64) -> Self {
        PI * k
    }
    fn one_over(k: f64) -> Self {
        1.0 / k
    }
    fn sin(self) -> Self {
        self.sin()
    }
    fn cos(self) -> Self {
        self.cos()
    }
    fn sin_cos(self) -> (Self, Self) {
        self.sin_cos()
    }
    fn scale(self, k: f64) -> Self {
        k * self
    }
    fn powi(self, n: u32) -> Self {
        self.powi(n as i32)
    }
    fn cos_sqrt(self) -> Self {
        self.max(0.0).sqrt().cos()
    }
}

impl Plain for f64 {
    fn sinc_sqrt(self) -> Self {
        let p = self.max(0.0);
        if p < 1e-8 {
            1.0 - p / 6.0
        } else {
            let q = p.sqrt();
            q.sin() / q
        }
    }
    fn sinc_sqrt_slope(self) -> Self {
        let p = self.max(0.0);
        if p < 1.0 {
            slope_series(p, |c| c)
        } else {
            (p.cos_sqrt() - p.sinc_sqrt()) / (2.0 * p)
        }
    }
}

/// `(-1)^k k / (2k+1)!`, k = 1 to 9, each to one ulp.
const SLOPE: [f64; 9] = {
    let mut out = [0.0; 9];
    let mut factorial = 1.0;
    let mut k = 1;
    while k <= 9 {
        factorial *= (2 * k * (2 * k + 1)) as f64;
        out[k - 1] = if k % 2 == 0 { k as f64 } else { -(k as f64) } / factorial;
        k += 1;
    }
    out
};

/// `sum_{k>=1} (-1)^k k p^(k-1) / (2k+1)!` to k = 9, by Horner: for p <= 1 the next term is below 2e-19.
fn slope_series<S: Scalar>(p: S, coefficient: fn(f64) -> S) -> S {
    let top = coefficient(SLOPE[8]);
    SLOPE[..8].iter().rev().fold(top, |s, &c| s * p + coefficient(c))
}

impl Scalar for Interval {
    fn constant(k: f64) -> Self {
        Self::point(k)
    }
    fn pi_times(k: f64) -> Self {
        // The f64 nearest to pi is below it.
        Self::new(PI, PI.next_up()) * k
    }
    fn one_over(k: f64) -> Self {
        let r = 1.0 / k;
        Self::new(r.next_down(), r.next_up())
    }
    fn sin(self) -> Self {
        self.sin()
    }
    fn cos(self) -> Self {
        self.cos()
    }
    fn sin_cos(self) -> (Self, Self) {
        (self.sin(), self.cos())
    }
    fn scale(self, k: f64) -> Self {
        let (a, b) = (k * self.lo, k * self.hi);
        if a.is_nan() || b.is_nan() {
            return self * k;
        }
        Self::new(a.min(b).next_down(), a.max(b).next_up())
    }
    fn powi(self, n: u32) -> Self {
        self.powi(n)
    }
    fn cos_sqrt(self) -> Self {
        root(self).cos()
    }
}

/// sqrt of the non-negative part.
fn root(p: Interval) -> Interval {
    let (lo, hi) = (p.lo.max(0.0), p.hi.max(0.0));
    Interval::new(lo.sqrt().next_down().max(0.0), hi.sqrt().next_up())
}

/// a / b for b > 0.
fn over(a: Interval, b: Interval) -> Interval {
    a * Interval::new((1.0 / b.hi).next_down(), (1.0 / b.lo).next_up())
}

/// sin(t)/t at one t >= 0.
fn sinc_at(t: f64) -> Interval {
    if t < 1e-4 {
        // 1 - t^2/6 <= sin(t)/t <= 1
        let lo = 1.0 - t * t / 6.0;
        return Interval::new(lo.next_down().next_down(), 1.0);
    }
    over(Interval::point(t).sin(), Interval::point(t))
}

/// Derivative of sin(sqrt(p))/sqrt(p) at one p >= 0.
fn slope_at(p: f64) -> Interval {
    if p <= 1.0 {
        // The alternating series stops after k = 9; the next term bounds the rest.
        let wide = |c: f64| Interval::new(c.next_down(), c.next_up());
        return slope_series(Interval::point(p), wide) + Interval::new(-2e-19, 2e-19);
    }
    let t = root(Interval::point(p));
    over(t.cos() - over(t.sin(), t), Interval::point(p) * 2.0)
}

impl Plain for Interval {
    fn sinc_sqrt(self) -> Self {
        let t = root(self);
        // sin(t)/t falls from 1 until its first minimum, -0.217233..., at t = 4.4934...
        if t.hi < 4.49 {
            return Self::new(sinc_at(t.hi).lo, sinc_at(t.lo).hi);
        }
        let whole = Self::new(-0.2173, 1.0);
        if t.lo < 1.0 {
            return whole;
        }
        over(t.sin(), t).intersect(whole).unwrap_or(whole)
    }

    fn sinc_sqrt_slope(self) -> Self {
        // -(1/2) j1(t)/t with t = sqrt(p); it rises while j2 > 0, that is to t = 5.763...
        let p = Self::new(self.lo.max(0.0), self.hi.max(0.0));
        if p.hi < 33.0 {
            return Self::new(slope_at(p.lo).lo, slope_at(p.hi).hi);
        }
        // |j1(t)/t| <= 1/3 everywhere.
        let whole = Self::new(-0.1667, 0.1667);
        if p.lo < 1.0 {
            return whole;
        }
        let t = root(p);
        over(t.cos() - over(t.sin(), t), p * 2.0).intersect(whole).unwrap_or(whole)
    }
}

/// A value with its gradient.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Dual<S> {
    pub(crate) v: S,
    pub(crate) g: [S; 3],
}

impl<S: Plain> Dual<S> {
    /// The coordinate `axis` with value `v`.
    pub(crate) fn variable(v: S, axis: usize) -> Self {
        let mut g = [S::constant(0.0); 3];
        g[axis] = S::constant(1.0);
        Self { v, g }
    }

    /// A function with value `v` and derivative `slope` of this.
    fn chain(self, v: S, slope: S) -> Self {
        Self {
            v,
            g: self.g.map(|g| slope * g),
        }
    }
}

impl<S: Plain> Add for Dual<S> {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Self {
            v: self.v + o.v,
            g: [0, 1, 2].map(|i| self.g[i] + o.g[i]),
        }
    }
}

impl<S: Plain> Sub for Dual<S> {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        Self {
            v: self.v - o.v,
            g: [0, 1, 2].map(|i| self.g[i] - o.g[i]),
        }
    }
}

impl<S: Plain> Mul for Dual<S> {
    type Output = Self;
    #[expect(clippy::suspicious_arithmetic_impl, reason = "the product rule has a sum")]
    fn mul(self, o: Self) -> Self {
        Self {
            v: self.v * o.v,
            g: [0, 1, 2].map(|i| self.g[i] * o.v + self.v * o.g[i]),
        }
    }
}

impl<S: Plain> Scalar for Dual<S> {
    fn constant(k: f64) -> Self {
        Self {
            v: S::constant(k),
            g: [S::constant(0.0); 3],
        }
    }
    fn pi_times(k: f64) -> Self {
        Self {
            v: S::pi_times(k),
            ..Self::constant(0.0)
        }
    }
    fn one_over(k: f64) -> Self {
        Self {
            v: S::one_over(k),
            ..Self::constant(0.0)
        }
    }
    fn sin(self) -> Self {
        self.sin_cos().0
    }
    fn cos(self) -> Self {
        self.sin_cos().1
    }
    fn sin_cos(self) -> (Self, Self) {
        let (s, c) = self.v.sin_cos();
        (self.chain(s, c), self.chain(c, s.scale(-1.0)))
    }
    fn scale(self, k: f64) -> Self {
        Self {
            v: self.v.scale(k),
            g: self.g.map(|g| g.scale(k)),
        }
    }
    fn powi(self, n: u32) -> Self {
        let slope = if n == 0 {
            S::constant(0.0)
        } else {
            self.v.powi(n - 1).scale(f64::from(n))
        };
        self.chain(self.v.powi(n), slope)
    }
    fn cos_sqrt(self) -> Self {
        self.chain(self.v.cos_sqrt(), self.v.sinc_sqrt().scale(-0.5))
    }
}

/// Enclosures of a function of one variable and of its first two derivatives.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Jet {
    pub(crate) v: Interval,
    pub(crate) d: Interval,
    pub(crate) dd: Interval,
}

impl Jet {
    /// The coordinate `origin + t * direction`.
    pub(crate) fn coordinate(origin: f64, direction: f64, t: Interval) -> Self {
        Self {
            v: t * direction + Interval::point(origin),
            d: Interval::point(direction),
            dd: Interval::point(0.0),
        }
    }

    /// A function with these value and derivatives of this.
    fn chain(self, v: Interval, first: Interval, second: Interval) -> Self {
        Self {
            v,
            d: first * self.d,
            dd: second * self.d.square() + first * self.dd,
        }
    }

    fn fixed(v: Interval) -> Self {
        let zero = Interval::point(0.0);
        Self { v, d: zero, dd: zero }
    }
}

impl Add for Jet {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Self {
            v: self.v + o.v,
            d: self.d + o.d,
            dd: self.dd + o.dd,
        }
    }
}

impl Sub for Jet {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        Self {
            v: self.v - o.v,
            d: self.d - o.d,
            dd: self.dd - o.dd,
        }
    }
}

impl Mul for Jet {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        Self {
            v: self.v * o.v,
            d: self.d * o.v + self.v * o.d,
            dd: self.dd * o.v + self.d * o.d * 2.0 + self.v * o.dd,
        }
    }
}

impl Scalar for Jet {
    fn constant(k: f64) -> Self {
        Self::fixed(Interval::point(k))
    }
    fn pi_times(k: f64) -> Self {
        Self::fixed(Interval::pi_times(k))
    }
    fn one_over(k: f64) -> Self {
        Self::fixed(Interval::one_over(k))
    }
    fn sin(self) -> Self {
        self.sin_cos().0
    }
    fn cos(self) -> Self {
        self.sin_cos().1
    }
    fn sin_cos(self) -> (Self, Self) {
        let (s, c) = self.v.sin_cos();
        (self.chain(s, c, -s), self.chain(c, -s, -c))
    }
    fn scale(self, k: f64) -> Self {
        Self {
            v: self.v.scale(k),
            d: self.d.scale(k),
            dd: self.dd.scale(k),
        }
    }
    fn powi(self, n: u32) -> Self {
        let zero = Interval::point(0.0);
        let k = f64::from(n);
        let first = if n == 0 { zero } else { self.v.powi(n - 1) * k };
        let second = if n < 2 { zero } else { self.v.powi(n - 2) * (k * (k - 1.0)) };
        self.chain(self.v.powi(n), first, second)
    }
    fn cos_sqrt(self) -> Self {
        self.chain(self.v.cos_sqrt(), self.v.sinc_sqrt() * -0.5, self.v.sinc_sqrt_slope() * -0.5)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Power series of cos(sqrt p), its first derivative by -1/2, and that one's derivative: independent of the closed forms.
    fn series(p: f64) -> [f64; 3] {
        let (mut c, mut s, mut ds) = (0.0, 0.0, 0.0);
        let mut even = 1.0; // (-1)^k / (2k)!
        for k in 0..40 {
            let kf = f64::from(k);
            let odd = even / (2.0 * kf + 1.0);
            c += even * p.powi(k);
            s += odd * p.powi(k);
            if k > 0 {
                ds += odd * kf * p.powi(k - 1);
            }
            even = -odd / (2.0 * kf + 2.0);
        }
        [c, s, ds]
    }

    #[test]
    fn cosine_of_a_root_and_its_derivatives() {
        for n in 0..400 {
            let p = f64::from(n) * 0.1;
            let [c, s, ds] = series(p);
            let tol = 1e-14 * p.sqrt().exp();
            assert!((p.cos_sqrt() - c).abs() < tol && (p.sinc_sqrt() - s).abs() < tol && (p.sinc_sqrt_slope() - ds).abs() < tol);
            for width in [0.0, 1e-6, 0.3, 5.0] {
                let x = Interval::new(p, p + width);
                for q in [p, p + width, p + 0.37 * width] {
                    let [c, s, ds] = series(q);
                    let slack = 1e-14 * q.sqrt().exp();
                    let holds = |i: Interval, v: f64| i.lo - slack <= v && v <= i.hi + slack;
                    assert!(
                        holds(x.cos_sqrt(), c) && holds(x.sinc_sqrt(), s) && holds(x.sinc_sqrt_slope(), ds),
                        "{x:?} {q}"
                    );
                }
                if width <= 1e-6 {
                    for i in [x.cos_sqrt(), x.sinc_sqrt(), x.sinc_sqrt_slope()] {
                        assert!(i.width() < 2.0 * width + 1e-13, "{x:?} {i:?}");
                    }
                }
            }
        }
    }
}
