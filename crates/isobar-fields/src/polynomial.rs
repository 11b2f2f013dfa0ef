//! Polynomials in x, y, z with coefficients in Z[phi], phi = (1 + sqrt 5) / 2, to expand products without rounding.

use std::collections::BTreeMap;
use std::ops::{Add, Mul, Sub};

/// `a + b phi`; phi^2 = phi + 1.
type Golden = (i64, i64);

/// phi * 2^110, rounded: 34 digits, so that `a + b phi` rounds once to f64 for all small a and b.
const PHI_110: i128 = 2_100_328_199_197_163_912_311_977_299_941_179;

/// A polynomial; no term is zero.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Polynomial {
    terms: BTreeMap<[u8; 3], Golden>,
}

impl Polynomial {
    /// The coordinate 0, 1 or 2.
    pub(crate) fn variable(axis: usize) -> Self {
        let mut e = [0; 3];
        e[axis] = 1;
        Self {
            terms: [(e, (1, 0))].into(),
        }
    }

    /// `a + b phi`.
    pub(crate) fn golden(a: i64, b: i64) -> Self {
        let mut p = Self::default();
        p.accumulate([0; 3], (a, b));
        p
    }

    /// The n-th power.
    pub(crate) fn pow(&self, n: u32) -> Self {
        (0..n).fold(Self::golden(1, 0), |p, _| &p * self)
    }

    fn accumulate(&mut self, e: [u8; 3], (a, b): Golden) {
        let c = self.terms.entry(e).or_default();
        *c = (c.0 + a, c.1 + b);
        if *c == (0, 0) {
            self.terms.remove(&e);
        }
    }

    /// The terms with each coefficient divided by `denominator` and rounded once to f64 (exact where it is representable).
    pub(crate) fn terms_over(&self, denominator: i64) -> Vec<([u8; 3], f64)> {
        let number = |(a, b): Golden| {
            if b == 0 {
                a as f64 / denominator as f64
            } else {
                let fixed = (i128::from(a) << 110) + i128::from(b) * PHI_110;
                fixed as f64 * 2f64.powi(-110) / denominator as f64
            }
        };
        self.terms.iter().map(|(&e, &c)| (e, number(c))).collect()
    }
}

impl Add for Polynomial {
    type Output = Self;
    fn add(mut self, o: Self) -> Self {
        for (e, c) in o.terms {
            self.accumulate(e, c);
        }
        self
    }
}

impl Sub for Polynomial {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        self + &Self::golden(-1, 0) * &o
    }
}

impl Mul for &Polynomial {
    type Output = Polynomial;
    fn mul(self, o: Self) -> Polynomial {
        let mut p = Polynomial::default();
        for (e, &(a, b)) in &self.terms {
            for (f, &(c, d)) in &o.terms {
                p.accumulate(std::array::from_fn(|i| e[i] + f[i]), (a * c + b * d, a * d + b * c + b * d));
            }
        }
        p
    }
}

impl Mul for Polynomial {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        &self * &o
    }
}

impl Mul<Polynomial> for i64 {
    type Output = Polynomial;
    fn mul(self, o: Polynomial) -> Polynomial {
        &Polynomial::golden(self, 0) * &o
    }
}

impl Add<i64> for Polynomial {
    type Output = Self;
    fn add(self, k: i64) -> Self {
        self + Self::golden(k, 0)
    }
}

impl Sub<i64> for Polynomial {
    type Output = Self;
    fn sub(self, k: i64) -> Self {
        self - Self::golden(k, 0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_golden_ratio_is_the_golden_ratio() {
        let phi = Polynomial::golden(0, 1);
        assert_eq!(phi.pow(2), Polynomial::golden(1, 1));
        assert_eq!(phi.pow(6), Polynomial::golden(5, 8));
        let f = phi.terms_over(1)[0].1;
        assert_eq!(f, f64::midpoint(1.0, 5f64.sqrt()));
        // phi^-1 = phi - 1, where a rounded phi would lose a digit.
        assert_eq!(Polynomial::golden(-1, 1).terms_over(1)[0].1, 0.618_033_988_749_894_9);
    }

    #[test]
    fn products_expand_and_cancel() {
        let (x, y) = (Polynomial::variable(0), Polynomial::variable(1));
        let p = (x.clone() + y.clone()) * (x.clone() - y.clone());
        assert_eq!(p, x.pow(2) - y.pow(2));
        assert_eq!(
            ((x.clone() + 1).pow(3) - 1).terms_over(2),
            [([1, 0, 0], 1.5), ([2, 0, 0], 1.5), ([3, 0, 0], 0.5)]
        );
    }
}
