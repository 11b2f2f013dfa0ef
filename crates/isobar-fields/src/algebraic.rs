//! A polynomial in world coordinates as a [`Function`].

use glam::DVec3;
use isobar_core::{Algebraic, DataError, Domain, Function, Interval, Structure};

/// The function of an [`Algebraic`].
///
/// Value and gradient are sums over the terms in f64: an error of a few ulps of the largest term, no more. The enclosure is the
/// intersection of the term-wise one and the mean value form, rigorous for the f64 coefficients as they are, and converges
/// quadratically as the box shrinks.
#[derive(Debug, Clone)]
pub struct AlgebraicFunction {
    polynomial: Algebraic,
    domain: Domain,
    /// Greatest exponent of each axis, so that powers are made once.
    top: [usize; 3],
}

/// Exponents are at most 15.
const POWERS: usize = 16;

impl AlgebraicFunction {
    /// The function of `polynomial` on its box.
    ///
    /// # Errors
    /// As [`Algebraic::check`].
    pub fn new(polynomial: Algebraic) -> Result<Self, DataError> {
        polynomial.check()?;
        let domain = Domain::world_box(polynomial.lo, polynomial.hi);
        let top = [0, 1, 2].map(|a| polynomial.terms.iter().map(|(e, _)| usize::from(e[a])).max().unwrap_or(0));
        Ok(Self { polynomial, domain, top })
    }

    /// The polynomial.
    #[must_use]
    pub fn polynomial(&self) -> &Algebraic {
        &self.polynomial
    }

    /// x^0 to x^top of the three coordinates.
    fn powers(&self, x: DVec3) -> [[f64; POWERS]; 3] {
        let mut p = [[1.0; POWERS]; 3];
        for a in 0..3 {
            for n in 1..=self.top[a] {
                p[a][n] = p[a][n - 1] * x[a];
            }
        }
        p
    }

    /// The intervals of the powers of three coordinates.
    fn interval_powers(&self, x: [Interval; 3]) -> [[Interval; POWERS]; 3] {
        let mut p = [[Interval::point(1.0); POWERS]; 3];
        for a in 0..3 {
            for (n, power) in p[a].iter_mut().enumerate().take(self.top[a] + 1).skip(1) {
                *power = x[a].powi(n as u32);
            }
        }
        p
    }

    fn sum(&self, p: &[[Interval; POWERS]; 3]) -> Interval {
        self.polynomial.terms.iter().fold(Interval::point(0.0), |s, (e, k)| {
            s + p[0][usize::from(e[0])] * p[1][usize::from(e[1])] * p[2][usize::from(e[2])] * *k
        })
    }

    fn gradient_sum(&self, p: &[[Interval; POWERS]; 3], axis: usize) -> Interval {
        self.polynomial
            .terms
            .iter()
            .filter(|(e, _)| e[axis] > 0)
            .fold(Interval::point(0.0), |s, (e, k)| {
                let mut f = *e;
                f[axis] -= 1;
                let factor = Interval::point(*k) * f64::from(e[axis]);
                s + p[0][usize::from(f[0])] * p[1][usize::from(f[1])] * p[2][usize::from(f[2])] * factor
            })
    }
}

impl Function for AlgebraicFunction {
    fn name(&self) -> String {
        self.polynomial.name.clone()
    }

    fn domain(&self) -> &Domain {
        &self.domain
    }

    fn value(&self, x: DVec3) -> f64 {
        let p = self.powers(x.max(self.domain.lo).min(self.domain.hi));
        self.polynomial
            .terms
            .iter()
            .map(|([a, b, c], k)| k * p[0][usize::from(*a)] * p[1][usize::from(*b)] * p[2][usize::from(*c)])
            .sum()
    }

    fn gradient(&self, x: DVec3) -> DVec3 {
        let p = self.powers(x.max(self.domain.lo).min(self.domain.hi));
        let mut g = DVec3::ZERO;
        for (e, k) in self.polynomial.terms.iter() {
            let v: [f64; 3] = std::array::from_fn(|a| p[a][usize::from(e[a])]);
            let d: [f64; 3] = std::array::from_fn(|a| match e[a] {
                0 => 0.0,
                n => f64::from(n) * p[a][usize::from(n) - 1],
            });
            g += *k * DVec3::new(d[0] * v[1] * v[2], v[0] * d[1] * v[2], v[0] * v[1] * d[2]);
        }
        g
    }

    fn enclosure(&self, lo: DVec3, hi: DVec3) -> Interval {
        let d = &self.domain;
        let (lo, hi) = (lo.max(d.lo).min(d.hi), hi.min(d.hi).max(d.lo));
        let x = [0, 1, 2].map(|a| Interval::new(lo[a], hi[a].max(lo[a])));
        let p = self.interval_powers(x);
        let plain = self.sum(&p);
        let middle = x.map(|x| Interval::point(x.mid()));
        let mut mean = self.sum(&self.interval_powers(middle));
        for a in 0..3 {
            mean = mean + self.gradient_sum(&p, a) * (x[a] - middle[a]);
        }
        plain.intersect(mean).unwrap_or(plain)
    }

    fn structure(&self) -> Structure<'_> {
        Structure::Polynomial(&self.polynomial)
    }
}
