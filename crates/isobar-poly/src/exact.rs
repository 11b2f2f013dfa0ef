//! Exact arithmetic, for the few polynomials whose signs floating point cannot tell.
//!
//! Numbers are [`Dyadic`]: whole numbers of any size times powers of two, as all finite f64 are. Polynomials are in scaled Bernstein form (`scaled.rs`), whose products are sums
//! of products of coefficients, with no factor. [`roots`] halves by de Casteljau's scheme, without a rounding, until Descartes' rule of signs says 0 or 1; so it
//! parts roots however close they are. Where [`DEPTH`] halvings do not part them, the polynomial is divided by the greatest common divisor of itself and its derivative: every root is
//! then a simple one, and the rule comes to its end (Vincent, Obreshkoff). So it is told, too, whether a polynomial touches zero.
//!
//! Thousands of times slower than f64: some microseconds a cubic.

use crate::Real;
use num_bigint::{BigInt, Sign};
use std::cmp::Ordering;
use std::ops::{Add, Mul, Neg, Sub};

/// Parts are halved this often before repeated roots are divided out.
pub const DEPTH: i32 = 80;

/// And this often after that: different roots still nearer to each other are [`ExactRoot::Close`].
pub const LAST_DEPTH: i32 = 1000;

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
        if digits == 0 {
            return Some(Self::whole(0));
        }
        let zeros = digits.trailing_zeros();
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
        let (x, exponent) = self.leading();
        scaled_by(x, exponent)
    }

    /// self / o rounded, off by less than 3.1 units roundoff of itself wherever that is a normal number, however great or small the two are; not a number where o is 0.
    #[must_use]
    pub fn ratio(&self, o: &Self) -> f64 {
        let ((x, p), (y, q)) = (self.leading(), o.leading());
        scaled_by(x / y, p.saturating_sub(q))
    }

    /// The leading 64 digits, rounded, and what they are to be scaled by.
    fn leading(&self) -> (f64, i64) {
        let bits = self.digits.bits();
        let drop = bits.saturating_sub(64);
        let top = (self.digits.magnitude() >> drop).iter_u64_digits().next().unwrap_or(0) as f64;
        let exponent = self.exponent.saturating_add(drop.cast_signed());
        (if self.digits.sign() == Sign::Minus { -top } else { top }, exponent)
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

/// x times a power of two.
fn scaled_by(x: f64, exponent: i64) -> f64 {
    // In two steps, so that neither power overflows where the product does not.
    let half = (exponent / 2).clamp(-1022, 1023);
    let power = |e: i64| f64::from_bits(((1023 + e.clamp(-1022, 1023)) as u64) << 52);
    x * power(half) * power(exponent - half)
}

impl Add for &Dyadic {
    type Output = Dyadic;
    fn add(self, o: Self) -> Dyadic {
        // The exponent of a zero means nothing.
        match (self.is_zero(), o.is_zero()) {
            (_, true) => self.clone(),
            (true, _) => o.clone(),
            _ => self.with(o, |a, b| a + b),
        }
    }
}

impl Sub for &Dyadic {
    type Output = Dyadic;
    fn sub(self, o: Self) -> Dyadic {
        match (self.is_zero(), o.is_zero()) {
            (_, true) => self.clone(),
            (true, _) => -o.clone(),
            _ => self.with(o, |a, b| a - b),
        }
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
    /// One root between the two, of any multiplicity.
    Between(f64, f64),
    /// Different roots, real or complex, too near to each other to be told apart: after [`LAST_DEPTH`] halvings.
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
    if scaled.iter().all(Dyadic::is_zero) {
        return on(ExactRoot::Everywhere);
    }
    let width = width.max(2f64.powi(-60));
    let (mut told, mut close) = (Vec::new(), false);
    Search {
        width,
        depth: DEPTH,
        on: &mut |r| {
            close = matches!(r, ExactRoot::Close(..));
            told.push(r);
            !close
        },
    }
    .visit(bernstein(scaled), 0.0, 0);
    if !close {
        return told.into_iter().all(on);
    }
    let depth = LAST_DEPTH;
    Search { width, depth, on }.visit(bernstein(&without_repeated_roots(scaled)), 0.0, 0)
}

/// Plain Bernstein coefficients, times what makes them whole.
fn bernstein(scaled: &[Dyadic]) -> Vec<Dyadic> {
    let n = scaled.len() - 1;
    let binomials = f64::binomials(n);
    let all = (0..=n).fold(1u64, |m, i| {
        let c = binomials[i] as u64;
        m / gcd(m, c) * c
    });
    let mut b: Vec<Dyadic> = (scaled.iter().enumerate())
        .map(|(i, s)| s * &Dyadic::whole((all / binomials[i] as u64) as i64))
        .collect();
    align(&mut b);
    b
}

/// A polynomial with the same roots in [0, 1), each once; not zero everywhere.
///
/// In scaled Bernstein form p(x) = (1 - x)^n q(x / (1 - x)), where q has the same coefficients by powers. Roots of p in [0, 1) are those of q in [0, inf).
fn without_repeated_roots(scaled: &[Dyadic]) -> Vec<Dyadic> {
    let mut q = scaled.to_vec();
    align(&mut q);
    let mut q: Vec<BigInt> = q.into_iter().map(|c| c.digits).collect();
    trim(&mut q);
    let slope: Vec<BigInt> = q.iter().enumerate().skip(1).map(|(i, c)| c * BigInt::from(i)).collect();
    if !slope.is_empty() {
        let (g, n) = (common_divisor(q.clone(), slope), q.len());
        q = divide(q, &g, n + 1 - g.len()).0;
    }
    let exponent = 0;
    q.into_iter().map(|digits| Dyadic { digits, exponent }).collect()
}

/// Takes out leading zeros.
fn trim(q: &mut Vec<BigInt>) {
    while q.last().is_some_and(|c| c.sign() == Sign::NoSign) {
        q.pop();
    }
}

/// Quotient and remainder by powers, in as many steps as the quotient has coefficients: each multiplies all by the leading coefficient of g, so that nothing is divided.
fn divide(mut r: Vec<BigInt>, g: &[BigInt], steps: usize) -> (Vec<BigInt>, Vec<BigInt>) {
    let (lead, rest) = (&g[g.len() - 1], &g[..g.len() - 1]);
    let mut quotient = vec![BigInt::ZERO; steps];
    for at in (0..steps).rev() {
        let top = r.pop().unwrap_or_default();
        for c in r.iter_mut().chain(&mut quotient[at + 1..]) {
            *c *= lead;
        }
        for (c, d) in r[at..].iter_mut().zip(rest) {
            *c -= &top * d;
        }
        quotient[at] = top;
    }
    trim(&mut r);
    (quotient, r)
}

/// The greatest common divisor of two polynomials by powers, up to a constant factor: the subresultant algorithm (Brown and Collins), which divides by what is known to divide.
fn common_divisor(mut a: Vec<BigInt>, mut b: Vec<BigInt>) -> Vec<BigInt> {
    let (mut g, mut h) = (BigInt::from(1), BigInt::from(1));
    while b.len() > 1 {
        let delta = (a.len() - b.len()) as u32;
        let (_, mut r) = divide(a, &b, delta as usize + 1);
        let known = &g * h.pow(delta);
        for c in &mut r {
            *c /= &known;
        }
        (a, b) = (b, r);
        g = a[a.len() - 1].clone();
        if delta > 0 {
            h = g.pow(delta) / h.pow(delta - 1);
        }
    }
    // A constant divides all; zero is where the division came out even.
    if b.is_empty() { a } else { b }
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
    depth: i32,
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
            _ if depth >= self.depth => (self.on)(ExactRoot::Close(lo, lo + size)),
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
        // Zeros leave the digits of others as few as they are.
        let third = number(1.0 / 3.0);
        for sum in [&third + &number(0.0), &number(-0.0) + &third, &third - &number(0.0)] {
            assert_eq!((sum.digits.bits(), sum.exponent), (third.digits.bits(), third.exponent));
        }
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
        // And the double root itself is one; at a number of few digits without a division.
        assert!(
            matches!(found(&square)[..], [ExactRoot::Between(a, b)] if (a - 1.0 / 3.0).abs() < 2e-15 && (b - 1.0 / 3.0).abs() < 2e-15)
        );
        // Beyond the last depth two roots are not told apart.
        let off = &number(2f64.powi(-600)) * &number(2f64.powi(-600));
        let p = product(&third, &[&third[0] - &off, &third[1] - &off]);
        assert!(matches!(found(&p)[..], [ExactRoot::Close(..)]));
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

    /// Roots of any multiplicity at numbers that are not dyadic, beside simple ones: each once, in order; and complex ones next to the axis are none.
    #[test]
    fn repeated_roots_are_told_once() {
        // k x - m, for the root m / k.
        let root = |m: i64, k: i64| [Dyadic::whole(-m), Dyadic::whole(k - m)];
        let times = |roots: &[(i64, i64)]| {
            roots
                .iter()
                .fold(vec![Dyadic::whole(-3)], |p, &(m, k)| product(&p, &root(m, k)))
        };
        for (roots, want) in [
            (&[(1, 3), (1, 3)][..], &[1.0 / 3.0][..]),
            (&[(1, 3), (1, 3), (1, 3)], &[1.0 / 3.0]),
            (
                &[(2, 7), (1, 3), (2, 7), (1, 3), (2, 7), (9, 10)],
                &[2.0 / 7.0, 1.0 / 3.0, 0.9],
            ),
            // At both ends, and beyond them.
            (
                &[(0, 1), (0, 1), (1, 3), (1, 3), (1, 1), (1, 1), (5, 3), (-1, 2)],
                &[0.0, 1.0 / 3.0],
            ),
            (&[(1, 7); 9], &[1.0 / 7.0]),
            (&[(1, 1); 9], &[]),
            (&[(1, 3), (1, 3), (4, 3), (4, 3)], &[1.0 / 3.0]),
        ] {
            let got = found(&times(roots));
            assert_eq!(got.len(), want.len(), "{roots:?}: {got:?}");
            for (g, w) in got.iter().zip(want) {
                let (lo, hi) = match *g {
                    ExactRoot::Between(lo, hi) => (lo, hi),
                    ExactRoot::At(x) => (x, x),
                    _ => panic!("{roots:?}: {g:?}"),
                };
                assert!((lo - w).abs() < 2e-15 && (hi - w).abs() < 2e-15, "{roots:?}: {g:?}");
            }
        }
        // ((3x - 1)^2 + 2^-200) (3x - 1)^2: one touching root, and two complex ones beside it.
        let square = times(&[(1, 3), (1, 3)]);
        let above: Vec<Dyadic> = (square.iter().zip([1, 2, 1]))
            .map(|(c, k)| c - &(&number(2f64.powi(-200)) * &Dyadic::whole(k)))
            .collect();
        assert_eq!(found(&above), []);
        assert!(matches!(found(&product(&square, &above))[..], [ExactRoot::Between(..)]));
    }

    #[test]
    fn ratios_of_numbers_beyond_f64() {
        let (great, small) = (&number(1e300) * &number(3e300), &number(1e-300) * &number(2e-300));
        assert_eq!(great.to_f64(), f64::INFINITY);
        assert!((great.ratio(&(&number(1e300) * &number(1e300))) - 3.0).abs() < 1e-15);
        assert!((small.ratio(&(&number(1e-300) * &number(1e-300))) - 2.0).abs() < 1e-15);
        assert_eq!(great.ratio(&small), f64::INFINITY);
        assert!(number(0.0).ratio(&number(0.0)).is_nan());
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
