//! Dyadic and rational numbers over dashu's integers.

use dashu_int::{
    IBig, UBig,
    ops::{BitTest, Gcd, UnsignedAbs},
};
use std::cmp::Ordering;

/// Sign of an integer: -1, 0, 1.
pub(crate) fn sign(x: &IBig) -> i32 {
    if x.is_zero() {
        0
    } else if *x < IBig::ZERO {
        -1
    } else {
        1
    }
}

/// Bits of the magnitude; 0 for 0.
pub(crate) fn bits(x: &IBig) -> usize {
    x.unsigned_abs().bit_len()
}

/// Greatest common divisor of the magnitudes, 0 only where both are 0.
pub(crate) fn gcd(a: &IBig, b: &IBig) -> UBig {
    match (a.is_zero(), b.is_zero()) {
        (true, _) => b.unsigned_abs(),
        (_, true) => a.unsigned_abs(),
        _ => a.gcd(b),
    }
}

/// `m * 2^e`, exactly.
#[derive(Clone, Debug)]
pub(crate) struct Dyadic {
    m: IBig,
    e: i64,
}

impl Dyadic {
    /// Exactly `x`, which must be finite.
    pub(crate) fn from_f64(x: f64) -> Self {
        debug_assert!(x.is_finite());
        if x == 0.0 {
            return Self { m: IBig::ZERO, e: 0 };
        }
        let raw = x.to_bits();
        let field = i64::from((raw >> 52) as u16 & 0x7ff);
        let fraction = (raw & ((1 << 52) - 1)) as i64;
        let (m, e) = if field == 0 {
            (fraction, -1074)
        } else {
            (fraction | 1 << 52, field - 1075)
        };
        let zeros = m.trailing_zeros();
        let m = m >> zeros;
        Self {
            m: IBig::from(if x < 0.0 { -m } else { m }),
            e: e + i64::from(zeros),
        }
    }

    fn shifted_to(&self, e: i64) -> IBig {
        &self.m << usize::try_from(self.e - e).unwrap_or(0)
    }

    pub(crate) fn plus(&self, o: &Self) -> Self {
        if self.m.is_zero() {
            return o.clone();
        }
        if o.m.is_zero() {
            return self.clone();
        }
        let e = self.e.min(o.e);
        Self {
            m: self.shifted_to(e) + o.shifted_to(e),
            e,
        }
    }

    pub(crate) fn times(&self, o: &Self) -> Self {
        Self {
            m: &self.m * &o.m,
            e: self.e + o.e,
        }
    }

    /// The quotient; `o` is not 0.
    pub(crate) fn over(&self, o: &Self) -> Ratio {
        let both = Self::integers([self, o]);
        Ratio::new(both[0].clone(), both[1].clone())
    }

    pub(crate) fn negated(&self) -> Self {
        Self { m: -&self.m, e: self.e }
    }

    pub(crate) fn sign(&self) -> i32 {
        sign(&self.m)
    }

    #[cfg(test)]
    pub(crate) fn compare(&self, o: &Self) -> Ordering {
        self.plus(&o.negated()).sign().cmp(&0)
    }

    /// As a fraction in lowest terms.
    pub(crate) fn ratio(&self) -> Ratio {
        if self.e >= 0 {
            Ratio::new(self.shifted_to(0), IBig::ONE)
        } else {
            Ratio::new(self.m.clone(), IBig::ONE << usize::try_from(-self.e).unwrap_or(0))
        }
    }

    /// The f64 next to it below and above, equal where it is one.
    #[cfg(test)]
    pub(crate) fn to_f64_bounds(&self) -> (f64, f64) {
        self.ratio().bounds()
    }

    /// All the numbers times one common positive power of two, so that they are integers.
    pub(crate) fn integers<'a>(all: impl IntoIterator<Item = &'a Self> + Clone) -> Vec<IBig> {
        let e = all
            .clone()
            .into_iter()
            .filter(|x| !x.m.is_zero())
            .map(|x| x.e)
            .min()
            .unwrap_or(0);
        all.into_iter()
            .map(|x| if x.m.is_zero() { IBig::ZERO } else { x.shifted_to(e) })
            .collect()
    }
}

/// A fraction with a positive denominator.
#[derive(Clone, Debug)]
pub(crate) struct Ratio {
    /// Numerator.
    pub(crate) n: IBig,
    /// Denominator, above 0.
    pub(crate) d: IBig,
}

impl Ratio {
    /// `n / d` in lowest terms; d is not 0.
    pub(crate) fn new(n: IBig, d: IBig) -> Self {
        debug_assert!(!d.is_zero());
        let (n, d) = if sign(&d) < 0 { (-n, -d) } else { (n, d) };
        let g = IBig::from(gcd(&n, &d));
        if g.is_one() {
            Self { n, d }
        } else {
            Self { n: n / &g, d: d / g }
        }
    }

    /// Exactly `x`.
    pub(crate) fn from_f64(x: f64) -> Self {
        Dyadic::from_f64(x).ratio()
    }

    pub(crate) fn compare(&self, o: &Self) -> Ordering {
        (&self.n * &o.d).cmp(&(&o.n * &self.d))
    }

    pub(crate) fn max(self, o: Self) -> Self {
        if self.compare(&o).is_lt() { o } else { self }
    }

    pub(crate) fn min(self, o: Self) -> Self {
        if self.compare(&o).is_gt() { o } else { self }
    }

    /// The greatest f64 not above and the least f64 not below: equal where the fraction is an f64. Beyond the range of normal numbers
    /// the ends are 0 and the least normal number, or the greatest and infinity.
    pub(crate) fn bounds(&self) -> (f64, f64) {
        let (lo, hi) = magnitude_bounds(&(&self.n).unsigned_abs(), &(&self.d).unsigned_abs());
        if sign(&self.n) < 0 { (-hi, -lo) } else { (lo, hi) }
    }
}

/// Bounds of `n / d`, both not negative, d above 0.
fn magnitude_bounds(n: &UBig, d: &UBig) -> (f64, f64) {
    if n.is_zero() {
        return (0.0, 0.0);
    }
    // A quotient of 54 or 55 bits: q = floor(n 2^s / d).
    let s = 54 - (n.bit_len() as i64 - d.bit_len() as i64);
    let (a, b) = if s >= 0 {
        (n << s as usize, d.clone())
    } else {
        (n.clone(), d << (-s) as usize)
    };
    let q = &a / &b;
    let mut inexact = &q * &b != a;
    let q = u64::try_from(&q).unwrap_or(u64::MAX);
    let drop = q.ilog2() - 52;
    let top = q >> drop;
    inexact |= top << drop != q;
    let e = i64::from(drop) - s;
    if e < -1074 {
        return (0.0, f64::MIN_POSITIVE);
    }
    if e > 1023 - 52 {
        return (f64::MAX, f64::INFINITY);
    }
    // 53 bits times two powers of two, neither of which leaves the normal range: exact.
    let (e1, e2) = (e / 2, e - e / 2);
    let lo = top as f64 * 2f64.powi(e1 as i32) * 2f64.powi(e2 as i32);
    (lo, if inexact { lo.next_up() } else { lo })
}

/// The numbers as multiples of the largest one, rounded (each to about one ulp); all 0 where they are.
pub(crate) fn normalised(x: &[IBig]) -> Vec<f64> {
    let most = x.iter().map(bits).max().unwrap_or(0);
    x.iter()
        .map(|v| {
            let drop = bits(v).saturating_sub(60);
            let top = i64::try_from(v >> drop).unwrap_or(0) as f64;
            let e = drop as i64 - most as i64;
            if e < -1000 { 0.0 } else { top * 2f64.powi(e as i32) }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn doubles_survive_the_round_trip() {
        for x in [0.1, -1e300, 3.0, f64::MIN_POSITIVE, 1.0 + f64::EPSILON, -7e-200, 0.0] {
            assert_eq!(Ratio::from_f64(x).bounds(), (x, x));
            assert_eq!(Dyadic::from_f64(x).to_f64_bounds(), (x, x));
        }
        // subnormal numbers are read exactly
        let tiny = Dyadic::from_f64(5e-324).times(&Dyadic::from_f64(2f64.powi(1000)));
        assert_eq!(tiny.to_f64_bounds().0, 2f64.powi(-74));
    }

    #[test]
    fn fractions_are_enclosed_by_neighbours() {
        let third = Ratio::new(IBig::from(-2), IBig::from(-6));
        let (lo, hi) = third.bounds();
        assert_eq!(hi, lo.next_up());
        assert!(lo <= 1.0 / 3.0 && 1.0 / 3.0 <= hi);
        assert!(Ratio::from_f64(lo).compare(&third).is_lt() && Ratio::from_f64(hi).compare(&third).is_gt());
        let (lo, hi) = Ratio::new(IBig::from(-1), IBig::from(10)).bounds();
        assert!(lo < hi && lo <= -0.1 && -0.1 <= hi);
        assert_eq!(Ratio::new(IBig::ONE << 2000, IBig::ONE).bounds(), (f64::MAX, f64::INFINITY));
    }

    #[test]
    fn integers_share_one_scale() {
        let x = [Dyadic::from_f64(0.75), Dyadic::from_f64(-3.0), Dyadic::from_f64(0.0)];
        assert_eq!(Dyadic::integers(&x), [IBig::from(3), IBig::from(-12), IBig::ZERO]);
    }
}
