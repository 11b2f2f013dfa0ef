//! Exact arithmetic, for the few polynomials whose signs floating point cannot tell.
//!
//! Numbers are [`Dyadic`]: whole numbers of any size times powers of two, as all finite f64 are. Polynomials are in scaled Bernstein form (`scaled.rs`), whose products are sums
//! of products of coefficients, with no factor. [`roots`] halves by de Casteljau's scheme, without a rounding, until Descartes' rule of signs says 0 or 1; so it
//! parts roots however close they are, and finds a root of any multiplicity that is a dyadic number of few digits. What it cannot tell is whether a polynomial touches zero
//! at any other number, or in how many roots: that is [`ExactRoot::Close`], 2^-[`DEPTH`] wide.
//!
//! Thousands of times slower than f64: some microseconds a cubic.

use crate::Real;
use num_bigint::{BigInt, Sign};
use std::cmp::Ordering;
use std::ops::{Add, Mul, Neg, Sub};

/// Parts are halved this often before what is left counts as close.
pub const DEPTH: i32 = 100;

/// `digits * 2^exponent`, exactly.
#[derive(Clone, Debug)]
pub struct Dyadic {
    digits: BigInt,
    exponent: i64,
}

impl Dyadic {
    /// The number itself; `None` for what is not finite.
    #[must_use]
    pub fn new(x: f64) -> Option<Self> {
        if !x.is_finite() {
            return None;
        }
        let bits = x.to_bits();
        let (stored, fraction) = ((bits >> 52 & 0x7ff) as i64, bits & ((1 << 52) - 1));
        let (digits, exponent) = if stored == 0 {
            (fraction, -1074)
        } else {
            (fraction | 1 << 52, stored - 1075)
        };
        let zeros = if digits == 0 { 0 } else { digits.trailing_zeros() };
        let digits = BigInt::from(digits >> zeros);
        Some(Self {
            digits: if x.is_sign_negative() { -digits } else { digits },
            exponent: exponent + i64::from(zeros),
        })
    }

    /// A whole number.
    #[must_use]
    pub fn whole(n: i64) -> Self {
        Self {
            digits: n.into(),
            exponent: 0,
        }
    }

    /// -1, 0 or 1.
    #[must_use]
    pub fn sign(&self) -> i32 {
        match self.digits.sign() {
            Sign::Minus => -1,
            Sign::NoSign => 0,
            Sign::Plus => 1,
        }
    }

    /// Whether it is 0.
    #[must_use]
    pub fn is_zero(&self) -> bool {
        self.sign() == 0
    }

    /// The number rounded, off by less than 1.01 units roundoff of itself; 0 or infinite where f64 does not reach, inexact below its normal numbers.
    #[must_use]
    pub fn to_f64(&self) -> f64 {
        let bits = self.digits.bits();
        let drop = bits.saturating_sub(64);
        let top = (self.digits.magnitude() >> drop).iter_u64_digits().next().unwrap_or(0);
        let exponent = self.exponent.saturating_add(drop.cast_signed());
        // In two steps, so that neither power overflows where the product does not.
        let half = (exponent / 2).clamp(-1022, 1023);
        let power = |e: i64| f64::from_bits(((1023 + e.clamp(-1022, 1023)) as u64) << 52);
        let x = top as f64 * power(half) * power(exponent - half);
        if self.digits.sign() == Sign::Minus { -x } else { x }
    }

    /// The digits at a smaller or equal exponent.
    fn at(&self, exponent: i64) -> BigInt {
        &self.digits << (self.exponent - exponent).max(0)
    }

    fn with(&self, o: &Self, f: impl Fn(&BigInt, &BigInt) -> BigInt) -> Self {
        if self.exponent == o.exponent {
            return Self {
                digits: f(&self.digits, &o.digits),
                exponent: self.exponent,
            };
        }
        let exponent = self.exponent.min(o.exponent);
        Self {
            digits: f(&self.at(exponent), &o.at(exponent)),
            exponent,
        }
    }

    fn halved(mut self, times: usize) -> Self {
        self.exponent -= times as i64;
        self
    }
}

impl Add for &Dyadic {
    type Output = Dyadic;
    fn add(self, o: Self) -> Dyadic {
        self.with(o, |a, b| a + b)
    }
}

impl Sub for &Dyadic {
    type Output = Dyadic;
    fn sub(self, o: Self) -> Dyadic {
        self.with(o, |a, b| a - b)
    }
}

impl Mul for &Dyadic {
    type Output = Dyadic;
    fn mul(self, o: Self) -> Dyadic {
        Dyadic {
            digits: &self.digits * &o.digits,
            exponent: self.exponent + o.exponent,
        }
    }
}

impl Neg for Dyadic {
    type Output = Self;
    fn neg(self) -> Self {
        Self {
            digits: -self.digits,
            exponent: self.exponent,
        }
    }
}

impl PartialEq for Dyadic {
    fn eq(&self, o: &Self) -> bool {
        self.cmp(o).is_eq()
    }
}

impl Eq for Dyadic {}

impl PartialOrd for Dyadic {
    fn partial_cmp(&self, o: &Self) -> Option<Ordering> {
        Some(self.cmp(o))
    }
}

impl Ord for Dyadic {
    fn cmp(&self, o: &Self) -> Ordering {
        (self - o).sign().cmp(&0)
    }
}

/// Gives all numbers the same exponent, so that sums of them, and of products with others of this kind, shift nothing.
pub fn align(numbers: &mut [Dyadic]) {
    let least = numbers.iter().filter(|n| !n.is_zero()).map(|n| n.exponent).min().unwrap_or(0);
    for n in numbers {
        if n.exponent != least {
            *n = Dyadic {
                digits: if n.is_zero() { BigInt::ZERO } else { n.at(least) },
                exponent: least,
            };
        }
    }
}

/// The product of two polynomials in scaled Bernstein form, at least one coefficient each.
///
/// # Panics
/// When one has none.
#[must_use]
pub fn product(p: &[Dyadic], q: &[Dyadic]) -> Vec<Dyadic> {
    let mut out: Vec<Option<Dyadic>> = vec![None; p.len() + q.len() - 1];
    for (i, a) in p.iter().enumerate() {
        for (j, b) in q.iter().enumerate() {
            let ab = a * b;
            let to = &mut out[i + j];
            *to = Some(to.take().map_or_else(|| ab.clone(), |sum| &sum + &ab));
        }
    }
    out.into_iter().map(|c| c.unwrap_or_else(|| Dyadic::whole(0))).collect()
}

/// What [`roots`] finds in [0, 1].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ExactRoot {
    /// A root at that number, of any multiplicity (rounded, where it has more than 53 digits).
    At(f64),
    /// One simple root between the two, with opposite signs on both sides.
    Between(f64, f64),
    /// Two roots, one of them twice, more, or none: not told after [`DEPTH`] halvings.
    Close(f64, f64),
    /// The polynomial is zero.
    Everywhere,
}

/// Tells `on` the roots in [0, 1), ascending, until it returns false; a root at 1 is the last coefficient being zero, which is left to the caller, for whom it may be the first of what
/// follows. Brackets are at most `width` wide (at least 2^-60). Returns whether all were told.
///
/// `scaled`: 1 to [`crate::MAX_DEGREE`] + 1 coefficients in scaled Bernstein form.
///
/// # Panics
/// When there are none or more.
pub fn roots(scaled: &[Dyadic], width: f64, on: &mut dyn FnMut(ExactRoot) -> bool) -> bool {
    let n = scaled.len() - 1;
    let binomials = f64::binomials(n);
    // Plain Bernstein coefficients, times what makes them whole.
    let all = (0..=n).fold(1u64, |m, i| {
        let c = binomials[i] as u64;
        m / gcd(m, c) * c
    });
    let mut b: Vec<Dyadic> = (scaled.iter().enumerate())
        .map(|(i, s)| s * &Dyadic::whole((all / binomials[i] as u64) as i64))
        .collect();
    if b.iter().all(Dyadic::is_zero) {
        return on(ExactRoot::Everywhere);
    }
    align(&mut b);
    let width = width.max(2f64.powi(-60));
    Search { width, on }.visit(b, 0.0, 0)
}

fn gcd(a: u64, b: u64) -> u64 {
    if b == 0 { a } else { gcd(b, a % b) }
}

/// Changes of sign, zeros left out: as many roots in the open interval, or an even number less.
fn variations(b: &[Dyadic]) -> usize {
    let (mut last, mut n) = (0, 0);
    for s in b.iter().map(Dyadic::sign).filter(|&s| s != 0) {
        n += usize::from(last != 0 && s != last);
        last = s;
    }
    n
}

/// Both halves, by de Casteljau's scheme.
fn halves(mut b: Vec<Dyadic>) -> [Vec<Dyadic>; 2] {
    align(&mut b);
    let n = b.len() - 1;
    let (mut left, mut right) = (Vec::with_capacity(n + 1), Vec::with_capacity(n + 1));
    for level in 0..=n {
        left.push(b[0].clone().halved(level));
        right.push(b[n - level].clone().halved(level));
        for i in 0..n - level {
            b[i] = &b[i] + &b[i + 1];
        }
    }
    right.reverse();
    [left, right]
}

struct Search<'a> {
    width: f64,
    on: &'a mut dyn FnMut(ExactRoot) -> bool,
}

impl Search<'_> {
    /// The part from `lo` on, 2^-depth wide.
    fn visit(&mut self, b: Vec<Dyadic>, lo: f64, depth: i32) -> bool {
        if b[0].is_zero() && !(self.on)(ExactRoot::At(lo)) {
            return false;
        }
        let size = 2f64.powi(-depth);
        match variations(&b) {
            0 => true,
            1 => self.bisect(b, lo, depth),
            _ if depth >= DEPTH => (self.on)(ExactRoot::Close(lo, lo + size)),
            _ => {
                let [left, right] = halves(b);
                self.visit(left, lo, depth + 1) && self.visit(right, lo + 0.5 * size, depth + 1)
            }
        }
    }

    /// Of a part with exactly one root inside.
    fn bisect(&mut self, mut b: Vec<Dyadic>, mut lo: f64, mut depth: i32) -> bool {
        while 2f64.powi(-depth) > self.width {
            let [left, right] = halves(b);
            depth += 1;
            let middle = lo + 2f64.powi(-depth);
            if right[0].is_zero() {
                return (self.on)(ExactRoot::At(middle));
            }
            (b, lo) = if variations(&left) == 1 { (left, lo) } else { (right, middle) };
        }
        (self.on)(ExactRoot::Between(lo, lo + 2f64.powi(-depth)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn number(x: f64) -> Dyadic {
        Dyadic::new(x).unwrap()
    }

    /// k times the product of (x - r), in scaled Bernstein form: x - r is -r and 1 - r at the ends.
    fn with_roots(k: f64, r: &[f64]) -> Vec<Dyadic> {
        let one = number(1.0);
        r.iter().fold(vec![number(k)], |p, &r| {
            let r = number(r);
            product(&p, &[-r.clone(), &one - &r])
        })
    }

    fn found(p: &[Dyadic]) -> Vec<ExactRoot> {
        let mut out = Vec::new();
        assert!(roots(p, 1e-15, &mut |r| {
            out.push(r);
            true
        }));
        out
    }

    #[test]
    fn numbers_are_what_f64_makes_of_them_where_it_is_exact() {
        let some = [
            0.0,
            1.0,
            -3.5,
            1e-300,
            1e300,
            f64::MIN_POSITIVE,
            f64::from_bits(1),
            -0.1,
            2f64.powi(52) + 1.0,
            f64::MAX,
        ];
        for &x in &some {
            assert_eq!(number(x).to_f64(), x);
            for &y in &some {
                assert_eq!(number(x).cmp(&number(y)), x.partial_cmp(&y).unwrap(), "{x} {y}");
                // (x + y) - y is x again, whatever the two are.
                assert_eq!((&(&number(x) + &number(y)) - &number(y)).to_f64(), x);
            }
        }
        assert_eq!((&number(3.0) * &number(-0.25)).to_f64(), -0.75);
        assert!(Dyadic::new(f64::NAN).is_none() && Dyadic::new(f64::INFINITY).is_none());
        assert_eq!((&number(1e300) * &number(1e300)).to_f64(), f64::INFINITY);
        let tiny = &(&number(1e-300) * &number(1e-300)) * &number(1e300);
        assert!((tiny.to_f64() / 1e-300 - 1.0).abs() < 1e-15);
    }

    #[test]
    fn roots_that_f64_cannot_part_are_parted() {
        // 1/3 and 2^-70 beside it, by 3x - 1: f64 cannot part them.
        let third = [number(-1.0), number(2.0)];
        let off = number(2f64.powi(-70));
        let p = product(&third, &[&third[0] - &off, &third[1] - &off]);
        let two = found(&p);
        assert!(
            matches!(two[..], [ExactRoot::Between(a, b), ExactRoot::Between(c, d)] if [a, b, c, d].iter().all(|x| (x - 1.0 / 3.0).abs() < 2e-15)),
            "{two:?}"
        );
        // As near to a double root from the other side: (3x - 1)^2 + 2^-140 has none.
        let square = product(&third, &third);
        let above = number(2f64.powi(-140));
        let p: Vec<Dyadic> = (square.iter().zip([1, 2, 1]))
            .map(|(c, k)| c + &(&above * &Dyadic::whole(k)))
            .collect();
        assert_eq!(found(&p), []);
        // And the double root itself is not told; at a number of few digits it is.
        assert!(
            matches!(found(&square)[..], [ExactRoot::Close(a, b)] if (a - 1.0 / 3.0).abs() < 1e-15 && (b - 1.0 / 3.0).abs() < 1e-15)
        );
        assert_eq!(found(&with_roots(1.0, &[0.375, 0.375])), [ExactRoot::At(0.375)]);
        assert_eq!(found(&with_roots(-2.0, &[0.375, 0.375, 0.375])), [ExactRoot::At(0.375)]);
    }

    #[test]
    fn ends_belong_to_the_part_that_starts_there() {
        assert_eq!(
            found(&with_roots(1.0, &[0.0, 0.0, 0.25, 1.0])),
            [ExactRoot::At(0.0), ExactRoot::At(0.25)]
        );
        assert_eq!(found(&with_roots(1.0, &[1.0, 1.5])), []);
        assert_eq!(found(&[number(0.0), number(0.0)]), [ExactRoot::Everywhere]);
        assert_eq!(found(&[number(5.0)]), []);
    }

    /// Random polynomials of degree 1 to 9 with planted roots: each is found, in order, and nothing else.
    #[test]
    fn planted_roots_are_found() {
        let mut seed = 7u64;
        let mut unit = || {
            seed = seed
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (seed >> 11) as f64 / (1u64 << 53) as f64
        };
        for n in 1..=9 {
            for _ in 0..20 {
                let r: Vec<f64> = (0..n).map(|_| 1.5 * unit() - 0.25).collect();
                let mut inside: Vec<f64> = r.iter().copied().filter(|r| (0.0..1.0).contains(r)).collect();
                inside.sort_by(f64::total_cmp);
                let got = found(&with_roots(0.1 + unit(), &r));
                assert_eq!(got.len(), inside.len(), "{r:?}: {got:?}");
                for (g, r) in got.iter().zip(inside) {
                    let (lo, hi) = match *g {
                        ExactRoot::Between(lo, hi) => (lo, hi),
                        // Planted ones are dyadic, some of few digits.
                        ExactRoot::At(x) => (x, x),
                        _ => panic!("{g:?}"),
                    };
                    // Brackets are rounded.
                    assert!(lo - 1e-16 <= r && r <= hi + 1e-16 && hi - lo <= 1e-15, "{r}: {g:?}");
                }
            }
        }
    }

    #[test]
    fn the_search_ends_where_it_is_told() {
        let p = with_roots(1.0, &[0.25, 0.5, 0.75]);
        let mut first = None;
        assert!(!roots(&p, 1e-9, &mut |r| {
            first = Some(r);
            false
        }));
        assert_eq!(first, Some(ExactRoot::At(0.25)));
    }
}
