//! The fields without polynomial pieces: Marschner-Lobb, gyroid, Chmutov with cosines.
//!
//! - `marschner-lobb` (Marschner and Lobb 1994): s = [1 - sin(pi z/2) + a (1 + cos(2 pi f_M cos(pi r/2)))] / (2 (1 + a)), r = sqrt(x^2 + y^2), with
//!   f_M = 6 and a = 1/4. Bounds: 0 <= s <= 1, |ds/dz| <= pi / (4 (1 + a)), |ds/dr| <= a pi^2 f_M / (2 (1 + a)); smooth everywhere, because
//!   cos(pi r/2) is an entire function of r^2. The surface s = 1/2 is z = (2/pi) asin(a cos(2 pi f_M cos(pi r/2))).
//! - `gyroid`: s = sin 6x cos 6y + sin 6y cos 6z + sin 6z cos 6x. Bounds: |s| <= 3/2, each partial derivative at most 6 sqrt 2 in absolute value,
//!   each second one at most 72.
//! - `chmutov` (hardcases C16): s = x^16 + y^16 + z^16 - cos 7x - cos 7y - cos 7z. Bounds: -3 <= s <= 3 L^16 + 3, each partial derivative at most
//!   16 L^15 + 7, each second one at most 240 L^14 + 49; there are no mixed ones.
//!
//! Enclosures are of the real function (real pi, f64 parameters). Over boxes: the plain interval evaluation cut by the mean value
//! form, so the excess falls with the square of the size. Along rays: g' plain, cut by its mean value form
//! where the plain one has a zero; g from its ends where g' has none (then exact to rounding), else from the plain
//! evaluation and the Taylor forms of first and second order (then the excess falls with the square of the length).

use crate::scalar::{Dual, Jet, Scalar};
use glam::DVec3;
use isobar_core::{Analytic, Domain, Function, Interval, Ray, Structure};

/// A formula with its parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Formula {
    MarschnerLobb { fm: f64, alpha: f64 },
    Gyroid,
    Chmutov,
}

impl Formula {
    const fn name(self) -> &'static str {
        match self {
            Self::MarschnerLobb { .. } => "marschner-lobb",
            Self::Gyroid => "gyroid",
            Self::Chmutov => "chmutov",
        }
    }

    fn evaluate<S: Scalar>(self, [x, y, z]: [S; 3]) -> S {
        let c = S::constant;
        match self {
            Self::MarschnerLobb { fm, alpha } => {
                let p = S::pi_times(0.5).powi(2) * (x.powi(2) + y.powi(2));
                let wave = (S::pi_times(2.0) * p.cos_sqrt().scale(fm)).cos();
                let sum = c(1.0) - (S::pi_times(0.5) * z).sin() + (c(1.0) + wave).scale(alpha);
                // 1 + alpha is rounded in f64, so the factor 1 / (2 (1 + alpha)) is taken of the rounded number.
                sum * S::one_over(2.0 * (1.0 + alpha))
            }
            Self::Gyroid => {
                let [x, y, z] = [x, y, z].map(|v| v.scale(6.0).sin_cos());
                x.0 * y.1 + y.0 * z.1 + z.0 * x.1
            }
            Self::Chmutov => {
                let one = |v: S| v.powi(16) - v.scale(7.0).cos();
                one(x) + one(y) + one(z)
            }
        }
    }
}

/// An analytic field on a box.
#[derive(Debug, Clone)]
pub(crate) struct AnalyticFunction {
    formula: Formula,
    domain: Domain,
}

impl AnalyticFunction {
    /// The formula on [-half, half]^3.
    pub(crate) fn new(formula: Formula, half: f64) -> Self {
        Self {
            formula,
            domain: Domain::world_box(DVec3::splat(-half), DVec3::splat(half)),
        }
    }

    fn clamped(&self, x: DVec3) -> DVec3 {
        x.max(self.domain.lo).min(self.domain.hi)
    }
}

impl Function for AnalyticFunction {
    fn name(&self) -> String {
        self.formula.name().into()
    }

    fn domain(&self) -> &Domain {
        &self.domain
    }

    fn value(&self, x: DVec3) -> f64 {
        self.formula.evaluate(self.clamped(x).to_array())
    }

    fn gradient(&self, x: DVec3) -> DVec3 {
        let x = self.clamped(x);
        let v = [0, 1, 2].map(|a| Dual::variable(x[a], a));
        DVec3::from_array(self.formula.evaluate(v).g)
    }

    fn enclosure(&self, lo: DVec3, hi: DVec3) -> Interval {
        let (lo, hi) = (self.clamped(lo), self.clamped(hi));
        let x = [0, 1, 2].map(|a| Interval::new(lo[a], hi[a].max(lo[a])));
        let all = self.formula.evaluate([0, 1, 2].map(|a| Dual::variable(x[a], a)));
        let middle = x.map(|x| Interval::point(x.mid()));
        let mut mean = self.formula.evaluate(middle);
        for a in 0..3 {
            mean = mean + all.g[a] * (x[a] - middle[a]);
        }
        all.v.intersect(mean).unwrap_or(all.v)
    }

    fn structure(&self) -> Structure<'_> {
        Structure::Analytic(self)
    }
}

impl Analytic for AnalyticFunction {
    fn along_ray(&self, ray: &Ray, t: Interval) -> (Interval, Interval) {
        let jet = |t: Interval| {
            self.formula
                .evaluate([0, 1, 2].map(|a| Jet::coordinate(ray.origin[a], ray.direction[a], t)))
        };
        let end = |t: f64| {
            self.formula
                .evaluate([0, 1, 2].map(|a| Interval::point(t) * ray.direction[a] + Interval::point(ray.origin[a])))
        };
        let cut = |a: Interval, b: Interval| a.intersect(b).unwrap_or(a);
        let all = jet(t);
        if !(t.lo.is_finite() && t.hi.is_finite()) {
            return (all.v, all.d);
        }
        // Monotone: the ends decide.
        if !all.d.has_zero() {
            return (cut(all.v, end(t.lo).union(end(t.hi))), all.d);
        }
        let m = Interval::point(t.mid());
        let at = jet(m);
        let step = t - m;
        let slope = cut(all.d, at.d + all.dd * step);
        if !slope.has_zero() {
            return (cut(all.v, end(t.lo).union(end(t.hi))), slope);
        }
        let first = at.v + slope * step;
        let second = at.v + at.d * step + all.dd * step.square() * 0.5;
        (cut(cut(all.v, first), second), slope)
    }
}
