//! Square-free decomposition of integer polynomials: power form, constant term first, no leading zeros.

use super::number::{gcd, sign};
use dashu_int::IBig;

/// A Mersenne prime, for the test that spares most polynomials the gcd over the integers.
const PRIME: u64 = (1 << 61) - 1;

/// The square-free factors of `p` (degree at least 1) with their multiplicities: `p = constant * prod f_i^i`, each `f_i` square-free and
/// of degree at least 1, pairwise coprime. Yun's algorithm with a primitive remainder sequence (Knuth, TAOCP 2, 4.6.1 and 4.6.2 exercise 36).
pub(crate) fn square_free(p: &[IBig]) -> Vec<(u32, Vec<IBig>)> {
    let mut p = p.to_vec();
    primitive(&mut p);
    if p.len() <= 2 || coprime_to_derivative(&p) {
        return vec![(1, p)];
    }
    let dp = derivative(&p);
    let g = greatest_common(&p, &dp);
    if g.len() == 1 {
        return vec![(1, p)];
    }
    let mut factors = Vec::new();
    let mut b = divide(&p, &g);
    let c = divide(&dp, &g);
    let mut d = subtract(&c, &derivative(&b));
    let mut i = 1;
    while b.len() > 1 {
        let a = if d.is_empty() { b.clone() } else { greatest_common(&b, &d) };
        let next = divide(&b, &a);
        let c = divide(&d, &a);
        d = subtract(&c, &derivative(&next));
        b = next;
        if a.len() > 1 {
            factors.push((i, a));
        }
        i += 1;
    }
    factors
}

fn derivative(p: &[IBig]) -> Vec<IBig> {
    p.iter().enumerate().skip(1).map(|(i, c)| c * IBig::from(i)).collect()
}

fn trim(p: &mut Vec<IBig>) {
    while p.last().is_some_and(IBig::is_zero) {
        p.pop();
    }
}

/// Divides by the content; the sign stays.
fn primitive(p: &mut Vec<IBig>) {
    trim(p);
    let mut g = IBig::ZERO;
    for c in p.iter() {
        g = IBig::from(gcd(&g, c));
        if g.is_one() {
            return;
        }
    }
    if !g.is_zero() {
        for c in p.iter_mut() {
            *c = &*c / &g;
        }
    }
}

fn subtract(a: &[IBig], b: &[IBig]) -> Vec<IBig> {
    let zero = IBig::ZERO;
    let mut r: Vec<IBig> = (0..a.len().max(b.len()))
        .map(|i| a.get(i).unwrap_or(&zero) - b.get(i).unwrap_or(&zero))
        .collect();
    trim(&mut r);
    r
}

/// `a / b`, which divides it over the rationals with an integer quotient (b primitive, Gauss).
fn divide(a: &[IBig], b: &[IBig]) -> Vec<IBig> {
    let mut r = a.to_vec();
    let n = b.len();
    if r.len() < n {
        return Vec::new();
    }
    let mut q = vec![IBig::ZERO; r.len() - n + 1];
    for i in (0..q.len()).rev() {
        let c = &r[i + n - 1] / &b[n - 1];
        for (j, bj) in b.iter().enumerate() {
            r[i + j] -= &c * bj;
        }
        q[i] = c;
    }
    debug_assert!(r.iter().all(IBig::is_zero), "the division is exact");
    q
}

/// Pseudo-remainder of `a` by `b`, made primitive.
fn remainder(a: &[IBig], b: &[IBig]) -> Vec<IBig> {
    let mut r = a.to_vec();
    let lead = &b[b.len() - 1];
    while r.len() >= b.len() {
        let shift = r.len() - b.len();
        let top = r[r.len() - 1].clone();
        for c in &mut r {
            *c *= lead;
        }
        for (j, bj) in b.iter().enumerate() {
            r[shift + j] -= &top * bj;
        }
        trim(&mut r);
        if r.is_empty() {
            break;
        }
    }
    primitive(&mut r);
    r
}

/// Primitive greatest common divisor with a positive leading coefficient.
fn greatest_common(a: &[IBig], b: &[IBig]) -> Vec<IBig> {
    let (mut a, mut b) = (a.to_vec(), b.to_vec());
    primitive(&mut a);
    primitive(&mut b);
    if a.len() < b.len() {
        std::mem::swap(&mut a, &mut b);
    }
    while !b.is_empty() {
        let r = remainder(&a, &b);
        a = std::mem::replace(&mut b, r);
    }
    if a.last().is_some_and(|c| sign(c) < 0) {
        for c in &mut a {
            *c = -&*c;
        }
    }
    a
}

fn mul_mod(a: u64, b: u64) -> u64 {
    (u128::from(a) * u128::from(b) % u128::from(PRIME)) as u64
}

fn inverse_mod(a: u64) -> u64 {
    // a^(p-2)
    let (mut r, mut base, mut e) = (1, a, PRIME - 2);
    while e > 0 {
        if e & 1 == 1 {
            r = mul_mod(r, base);
        }
        base = mul_mod(base, base);
        e >>= 1;
    }
    r
}

/// A proof modulo [`PRIME`] that p and p' are coprime: where neither leading coefficient vanishes there and the gcd modulo the prime is
/// constant, the resultant is not 0 modulo the prime and so not 0. `false` proves nothing.
fn coprime_to_derivative(p: &[IBig]) -> bool {
    let modulo = |c: &IBig| -> u64 {
        let r = c % IBig::from(PRIME);
        let r = if sign(&r) < 0 { r + IBig::from(PRIME) } else { r };
        u64::try_from(&r).unwrap_or(0)
    };
    let mut a: Vec<u64> = p.iter().map(modulo).collect();
    if a[a.len() - 1] == 0 {
        return false;
    }
    let mut b: Vec<u64> = a.iter().enumerate().skip(1).map(|(i, &c)| mul_mod(c, i as u64)).collect();
    if b[b.len() - 1] == 0 {
        return false;
    }
    loop {
        if b.len() <= 1 {
            return !b.is_empty();
        }
        let inverse = inverse_mod(b[b.len() - 1]);
        while a.len() >= b.len() {
            let q = mul_mod(a[a.len() - 1], inverse);
            let shift = a.len() - b.len();
            for (j, &bj) in b.iter().enumerate() {
                a[shift + j] = (a[shift + j] + PRIME - mul_mod(q, bj)) % PRIME;
            }
            while a.last() == Some(&0) {
                a.pop();
            }
        }
        std::mem::swap(&mut a, &mut b);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn poly(c: &[i64]) -> Vec<IBig> {
        c.iter().map(|&c| IBig::from(c)).collect()
    }

    fn product(a: &[IBig], b: &[IBig]) -> Vec<IBig> {
        let mut r = vec![IBig::ZERO; a.len() + b.len() - 1];
        for (i, x) in a.iter().enumerate() {
            for (j, y) in b.iter().enumerate() {
                r[i + j] += x * y;
            }
        }
        r
    }

    #[test]
    fn factors_come_back_with_their_multiplicity() {
        // (3x - 1)^2 (x - 2) (x^2 + 1)^3 * 10
        let (a, b, c) = (poly(&[-1, 3]), poly(&[-2, 1]), poly(&[1, 0, 1]));
        let mut p = poly(&[10]);
        for f in [&a, &a, &b, &c, &c, &c] {
            p = product(&p, f);
        }
        let f = square_free(&p);
        assert_eq!(f, vec![(1, b), (2, a), (3, c)]);
    }

    #[test]
    fn square_free_polynomials_are_left_alone() {
        let p = poly(&[-6, 11, -6, 1]);
        assert!(coprime_to_derivative(&p));
        assert_eq!(square_free(&p), vec![(1, p)]);
        assert!(!coprime_to_derivative(&poly(&[1, -2, 1])));
    }
}
