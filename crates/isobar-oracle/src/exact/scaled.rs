//! Exact isolation of the roots of one piece in scaled Bernstein form.
//!
//! A piece is `p(t) = sum b_i tau^i (1 - tau)^(n-i)` (the binomials are inside `b_i`) with `t = t0 + tau (t1 - t0)`. As a homogeneous form
//! `sum b_i X^i Y^(n-i)`, `tau = X/(X+Y)`, it is the polynomial `sum b_i x^i` in `x = tau/(1-tau)`, so that Descartes' rule on the `b_i` counts
//! roots in (0, 1) (plus an even number), and square-free factors of `sum b_i x^i` are scaled Bernstein forms again. Splitting at 1/2 is
//! the substitution `X = 2X' + Y', Y = Y'` (right half) and its mirror image (left half).
//!
//! Termination: each square-free factor has simple roots only, for which repeated halving ends in 0 or 1 variation (Vincent's theorem in
//! the form of Collins and Akritas 1976).

use super::{
    algebra::square_free,
    number::{Ratio, normalised, sign},
    ray::Span,
};
use dashu_int::IBig;

/// A polynomial on `[t0, t1]`, and whether t1 belongs to it.
#[derive(Clone, Debug)]
pub(crate) struct Piece {
    /// Scaled Bernstein coefficients; any common positive factor.
    pub(crate) b: Vec<IBig>,
    /// Start, always part of the piece.
    pub(crate) t0: Ratio,
    /// End, at least `t0`.
    pub(crate) t1: Ratio,
    /// Whether `t1` is part of it.
    pub(crate) closed: bool,
    /// Greatest `|coefficient - c|` of the piece in the units of `b` (0: the greatest Bernstein coefficient).
    pub(crate) most: IBig,
}

/// One distinct root of a piece.
#[derive(Clone, Debug)]
pub(crate) struct ExactRoot {
    /// The greatest f64 not above and the least not below the root: equal, or neighbours.
    pub(crate) lo: f64,
    /// See `lo`.
    pub(crate) hi: f64,
    /// Multiplicity of the root in the polynomial of the piece.
    pub(crate) order: u32,
    /// Whether the root is exactly `t0`.
    pub(crate) at_start: bool,
    /// tau of the root, rounded.
    pub(crate) tau: f64,
}

/// The roots of a piece.
#[derive(Clone, Debug)]
pub(crate) enum Roots {
    /// The polynomial is zero.
    Zero,
    /// The distinct roots, ascending.
    Some(Vec<ExactRoot>),
}

/// A node of the subdivision: `tau = (c + local) / 2^k`, with each square-free factor on it.
struct Node {
    c: IBig,
    k: usize,
    factors: Vec<(u32, Vec<IBig>)>,
}

impl Piece {
    /// Zero on a span.
    pub(crate) fn zero(span: Span) -> Self {
        Self {
            b: vec![IBig::ZERO],
            t0: span.t0,
            t1: span.t1,
            closed: span.closed,
            most: IBig::ZERO,
        }
    }

    /// Bernstein coefficients (binomials divided out) as f64, up to a common positive factor, each to a few ulps of itself; and `most` in
    /// the same units.
    pub(crate) fn bernstein(&self) -> (Vec<f64>, f64) {
        let n = self.b.len() - 1;
        let mut all = self.b.clone();
        all.push(self.most.clone());
        let mut b = normalised(&all);
        let most = b.pop().unwrap_or(0.0);
        let mut binomial = 1.0;
        for (i, v) in b.iter_mut().enumerate() {
            if i > 0 {
                binomial *= (n + 1 - i) as f64 / i as f64;
            }
            *v /= binomial;
        }
        let most = if most > 0.0 {
            most
        } else {
            b.iter().fold(0.0, |m: f64, v| m.max(v.abs()))
        };
        (b, most)
    }

    /// Order of vanishing at t0 and the sign just after, `None` where the polynomial is zero.
    pub(crate) fn order_at_start(&self) -> Option<(u32, i32)> {
        let k = self.b.iter().position(|c| !c.is_zero())?;
        Some((k as u32, sign(&self.b[k])))
    }

    /// Order of vanishing at t1 and the sign just before, `None` where the polynomial is zero.
    pub(crate) fn order_at_end(&self) -> Option<(u32, i32)> {
        let k = self.b.iter().rev().position(|c| !c.is_zero())?;
        Some((k as u32, sign(&self.b[self.b.len() - 1 - k])))
    }

    /// The distinct roots in `[t0, t1)`, or `[t0, t1]` where it is closed. With `first_only`, at least the first.
    pub(crate) fn roots(&self, first_only: bool) -> Roots {
        let Some((k0, _)) = self.order_at_start() else {
            return Roots::Zero;
        };
        let mut out = Vec::new();
        if k0 > 0 {
            let (lo, hi) = self.t0.bounds();
            out.push(ExactRoot {
                lo,
                hi,
                order: k0,
                at_start: true,
                tau: 0.0,
            });
            if first_only {
                return Roots::Some(out);
            }
        }
        let k1 = self.order_at_end().map_or(0, |(k, _)| k);
        let inner = &self.b[k0 as usize..self.b.len() - k1 as usize];
        self.inner_roots(inner, first_only, &mut out);
        let wanted = !first_only || out.is_empty();
        if wanted && k1 > 0 && self.closed && self.t0.compare(&self.t1).is_lt() {
            let (lo, hi) = self.t1.bounds();
            out.push(ExactRoot {
                lo,
                hi,
                order: k1,
                at_start: false,
                tau: 1.0,
            });
        }
        Roots::Some(out)
    }

    /// Roots in the open interval (0, 1) of a form that vanishes at neither end.
    fn inner_roots(&self, b: &[IBig], first_only: bool, out: &mut Vec<ExactRoot>) {
        let factors = match variations(b) {
            0 => return,
            // One variation: one root, counted with multiplicity.
            1 => vec![(1, b.to_vec())],
            _ => square_free(b),
        };
        let mut stack = vec![Node {
            c: IBig::ZERO,
            k: 0,
            factors,
        }];
        while let Some(mut node) = stack.pop() {
            // A root exactly at the left end of a right half.
            for (order, f) in &mut node.factors {
                if f.first().is_some_and(IBig::is_zero) {
                    f.remove(0);
                    let t = self.time(&node.c, node.k);
                    let (lo, hi) = t.bounds();
                    out.push(ExactRoot {
                        lo,
                        hi,
                        order: *order,
                        at_start: false,
                        tau: tau(&node.c, node.k),
                    });
                }
                if f.last().is_some_and(IBig::is_zero) {
                    f.pop();
                }
            }
            if first_only && !out.is_empty() {
                return;
            }
            let counts: Vec<usize> = node.factors.iter().map(|(_, f)| variations(f)).collect();
            match counts.iter().sum::<usize>() {
                0 => {}
                1 => {
                    let i = counts.iter().position(|&v| v == 1).unwrap_or(0);
                    let (order, f) = &node.factors[i];
                    out.push(self.refine(&node, *order, f));
                }
                _ => {
                    let halves = |half: fn(&[IBig]) -> Vec<IBig>| {
                        let live = node.factors.iter().zip(&counts).filter(|(_, v)| **v > 0);
                        live.map(|((order, f), _)| (*order, half(f))).collect()
                    };
                    let left = Node {
                        c: &node.c << 1usize,
                        k: node.k + 1,
                        factors: halves(left_half),
                    };
                    let right = Node {
                        c: (&node.c << 1usize) + IBig::ONE,
                        k: node.k + 1,
                        factors: halves(right_half),
                    };
                    stack.push(right);
                    stack.push(left);
                }
            }
        }
    }

    /// `t` at `tau = c / 2^k`.
    fn time(&self, c: &IBig, k: usize) -> Ratio {
        // t0 + (t1 - t0) c / 2^k over the common denominator d0 d1 2^k
        let a = &self.t0.n * &self.t1.d;
        let span = &self.t1.n * &self.t0.d - &a;
        Ratio::new((a << k) + span * c, (&self.t0.d * &self.t1.d) << k)
    }

    /// The one root of `f` in the open node, enclosed by neighbouring f64: bisection over f64 with exact signs.
    fn refine(&self, node: &Node, order: u32, f: &[IBig]) -> ExactRoot {
        let at = |c: &IBig| self.time(c, node.k);
        let mut lo = at(&node.c).bounds().0;
        let mut hi = at(&(&node.c + IBig::ONE)).bounds().1;
        let before = f.iter().map(sign).find(|&s| s != 0).unwrap_or(0);
        // tau = (t q - a) / span; local X = tau 2^k - c, over the common denominator of t.
        let q = &self.t0.d * &self.t1.d;
        let a = &self.t0.n * &self.t1.d;
        let span = &self.t1.n * &self.t0.d - &a;
        let sign_at = |t: f64| -> i32 {
            let t = Ratio::from_f64(t);
            let whole = &span * &t.d;
            let x = ((&t.n * &q - &a * &t.d) << node.k) - &node.c * &whole;
            if sign(&x) <= 0 {
                return before;
            }
            let y = whole - &x;
            if sign(&y) <= 0 {
                return -before;
            }
            homogeneous_sign(f, &x, &y)
        };
        loop {
            let mid = middle(lo, hi);
            if mid <= lo || mid >= hi {
                break;
            }
            let s = sign_at(mid);
            if s == before {
                lo = mid;
            } else if s == 0 {
                (lo, hi) = (mid, mid);
            } else {
                hi = mid;
            }
        }
        ExactRoot {
            lo,
            hi,
            order,
            at_start: false,
            tau: {
                // Good to a few ulps of the node where t resolves it; else its middle.
                let t = Ratio::from_f64(lo);
                let x = Ratio::new(&t.n * &q - &a * &t.d, &span * &t.d).bounds().0;
                let (first, last) = (tau(&node.c, node.k), tau(&(&node.c + IBig::ONE), node.k));
                if (first..=last).contains(&x) {
                    x
                } else {
                    0.5 * (first + last)
                }
            },
        }
    }
}

/// `c / 2^k`, rounded.
fn tau(c: &IBig, k: usize) -> f64 {
    Ratio::new(c.clone(), IBig::ONE << k).bounds().0
}

/// The f64 in the middle of two, counted in representable numbers where the sizes differ much.
fn middle(lo: f64, hi: f64) -> f64 {
    let key = |x: f64| {
        let b = x.to_bits() as i64;
        if b < 0 { i64::MIN.wrapping_sub(b) } else { b }
    };
    let m = 0.5 * (lo + hi);
    if lo > 0.0 && hi < 4.0 * lo {
        return m;
    }
    let (a, b) = (key(lo), key(hi));
    let k = a + ((i128::from(b) - i128::from(a)) / 2) as i64;
    f64::from_bits(if k < 0 { i64::MIN.wrapping_sub(k) } else { k } as u64)
}

/// Sign of `sum f_i x^i y^(n-i)`.
fn homogeneous_sign(f: &[IBig], x: &IBig, y: &IBig) -> i32 {
    let mut sum = IBig::ZERO;
    let mut power = IBig::ONE;
    for c in f.iter().rev() {
        // Horner from the highest power of x: sum = sum * x + c * y^j
        sum = sum * x + c * &power;
        power *= y;
    }
    sign(&sum)
}

/// Sign variations, zeros left out.
fn variations(b: &[IBig]) -> usize {
    let mut last = 0;
    let mut count = 0;
    for s in b.iter().map(sign).filter(|&s| s != 0) {
        if last != 0 && s != last {
            count += 1;
        }
        last = s;
    }
    count
}

/// The form on the right half: `X = 2X' + Y'`.
fn right_half(b: &[IBig]) -> Vec<IBig> {
    let mut r = b.to_vec();
    let n = r.len();
    // Taylor shift by 1 in x, then x -> 2x.
    for i in 0..n {
        for j in (i..n - 1).rev() {
            let (a, b) = r.split_at_mut(j + 1);
            a[j] += &b[0];
        }
    }
    for (i, c) in r.iter_mut().enumerate() {
        *c <<= i;
    }
    shrink(&mut r);
    r
}

/// The form on the left half: the mirror image.
fn left_half(b: &[IBig]) -> Vec<IBig> {
    let mirrored: Vec<IBig> = b.iter().rev().cloned().collect();
    let mut r = right_half(&mirrored);
    r.reverse();
    r
}

/// Divides by a common power of two.
fn shrink(b: &mut [IBig]) {
    let zeros = b.iter().filter_map(IBig::trailing_zeros).min().unwrap_or(0);
    if zeros > 0 {
        for c in b.iter_mut() {
            *c >>= zeros;
        }
    }
}

impl Piece {
    /// A piece of a polynomial in power form, `sum c_i t^i`, on `[t0, t1]`, ends included.
    pub(crate) fn from_power(c: &[IBig], t0: Ratio, t1: Ratio) -> Self {
        let n = c.len().saturating_sub(1);
        // t = (a + span tau)/q = (a Y + (a + span) X)/q with X + Y = 1; degree n needs q^n.
        let q = &t0.d * &t1.d;
        let a = &t0.n * &t1.d;
        let e = &t1.n * &t0.d;
        let mut b = vec![IBig::ZERO; n + 1];
        // Horner in the homogeneous forms: result = result * (aY + eX) + c_i q^(n-i) (X + Y)^(n-i)
        let mut line: Vec<IBig> = vec![c.last().cloned().unwrap_or(IBig::ZERO)];
        let mut power = IBig::ONE;
        let mut row: Vec<IBig> = vec![IBig::ONE];
        for ci in c.iter().rev().skip(1) {
            power *= &q;
            row = convolve(&row, &[IBig::ONE, IBig::ONE]);
            line = convolve(&line, &[a.clone(), e.clone()]);
            for (l, r) in line.iter_mut().zip(&row) {
                *l += ci * &power * r;
            }
        }
        for (x, y) in b.iter_mut().zip(line) {
            *x = y;
        }
        Self {
            b,
            t0,
            t1,
            closed: true,
            most: IBig::ZERO,
        }
    }
}

/// Product of two scaled Bernstein (or power) forms.
pub(crate) fn convolve(a: &[IBig], b: &[IBig]) -> Vec<IBig> {
    let mut r = vec![IBig::ZERO; a.len() + b.len() - 1];
    for (i, x) in a.iter().enumerate().filter(|(_, x)| !x.is_zero()) {
        for (j, y) in b.iter().enumerate().filter(|(_, y)| !y.is_zero()) {
            r[i + j] += x * y;
        }
    }
    r
}

#[cfg(test)]
mod tests {
    use super::super::number::Dyadic;
    use super::*;

    fn piece(c: &[f64], t0: f64, t1: f64) -> Piece {
        let c: Vec<Dyadic> = c.iter().map(|&x| Dyadic::from_f64(x)).collect();
        Piece::from_power(&Dyadic::integers(&c), Ratio::from_f64(t0), Ratio::from_f64(t1))
    }

    fn list(p: &Piece) -> Vec<(f64, f64, u32)> {
        match p.roots(false) {
            Roots::Zero => panic!("zero"),
            Roots::Some(r) => r.iter().map(|r| (r.lo, r.hi, r.order)).collect(),
        }
    }

    #[test]
    fn dyadic_roots_are_exact_and_ends_follow_the_half_open_rule() {
        // t (t - 1/2) (t - 1)
        let mut p = piece(&[0.0, 0.5, -1.5, 1.0], 0.0, 1.0);
        assert_eq!(list(&p), [(0.0, 0.0, 1), (0.5, 0.5, 1), (1.0, 1.0, 1)]);
        p.closed = false;
        assert_eq!(list(&p), [(0.0, 0.0, 1), (0.5, 0.5, 1)]);
        assert_eq!(list(&piece(&[0.0, 0.5, -1.5, 1.0], 0.5, 1.0)), [(0.5, 0.5, 1), (1.0, 1.0, 1)]);
        assert_eq!(
            list(&piece(&[0.0, 0.5, -1.5, 1.0], -3.0, 5.0)),
            [(0.0, 0.0, 1), (0.5, 0.5, 1), (1.0, 1.0, 1)]
        );
    }

    #[test]
    fn irrational_roots_are_enclosed_by_neighbours() {
        let r = list(&piece(&[-2.0, 0.0, 1.0], -3.0, 3.0));
        assert_eq!(r.len(), 2);
        assert_eq!(r[1].1, r[1].0.next_up());
        assert!(r[1].0 <= 2f64.sqrt() && 2f64.sqrt() <= r[1].1);
        assert!(r[0].0 <= -(2f64.sqrt()) && -(2f64.sqrt()) <= r[0].1);
    }

    #[test]
    fn multiplicities_are_counted() {
        // (4t - 1)^2 (4t - 3)^3 (t - 2)
        let factors: [&[f64]; 6] = [
            &[-1.0, 4.0],
            &[-1.0, 4.0],
            &[-3.0, 4.0],
            &[-3.0, 4.0],
            &[-3.0, 4.0],
            &[-2.0, 1.0],
        ];
        let c = factors.iter().fold(vec![1.0], |p, f| {
            let mut r = vec![0.0; p.len() + 1];
            for (i, x) in p.iter().enumerate() {
                r[i] += x * f[0];
                r[i + 1] += x * f[1];
            }
            r
        });
        assert_eq!(list(&piece(&c, 0.0, 1.0)), [(0.25, 0.25, 2), (0.75, 0.75, 3)]);
        assert_eq!(list(&piece(&c, 0.1, 5.0)), [(0.25, 0.25, 2), (0.75, 0.75, 3), (2.0, 2.0, 1)]);
    }

    #[test]
    fn zero_is_zero() {
        assert!(matches!(piece(&[0.0, 0.0, 0.0], 0.0, 1.0).roots(false), Roots::Zero));
    }
}
