//! Exact reference for the tests, the example and the bench: Sturm's theorem in big integers, and a fast exact
//! subdivision in i128 for the many easy cases. Shares no code with the library.
#![allow(dead_code, reason = "each user takes its part")]

use isobar_poly::{First, Root, RootKind, Roots};
use num_bigint::BigInt;
use num_integer::Integer;
use num_traits::{Signed, Zero};
use std::cell::OnceCell;

/// A polynomial with integer coefficients: a positive multiple of the given one.
pub(crate) struct Exact {
    /// Bernstein coefficients.
    pub(crate) b: Vec<BigInt>,
    /// Power coefficients.
    a: Vec<BigInt>,
}

/// `x = m 2^e`, m an integer.
fn decode(x: f64) -> (i64, i32) {
    let bits = x.to_bits();
    let exponent = ((bits >> 52) & 0x7ff) as i32;
    let fraction = (bits & ((1 << 52) - 1)) as i64;
    let (m, e) = if exponent == 0 {
        (fraction, -1074)
    } else {
        (fraction | 1 << 52, exponent - 1075)
    };
    (if x < 0.0 { -m } else { m }, e)
}

fn sign(x: &BigInt) -> i32 {
    if x.is_zero() {
        0
    } else if x.is_positive() {
        1
    } else {
        -1
    }
}

fn binomial(n: usize, k: usize) -> BigInt {
    (0..k).fold(BigInt::from(1), |p, i| p * (n - i) / (i + 1))
}

/// Content removed, sign kept.
fn primitive(mut p: Vec<BigInt>) -> Vec<BigInt> {
    while p.last().is_some_and(Zero::is_zero) {
        p.pop();
    }
    let g = p.iter().fold(BigInt::zero(), |g, x| g.gcd(x));
    if g > BigInt::from(1) {
        p.iter_mut().for_each(|x| *x /= &g);
    }
    p
}

/// -(a mod b), times a positive number.
fn negated_remainder(a: &[BigInt], b: &[BigInt]) -> Vec<BigInt> {
    let mut r = a.to_vec();
    let lead = &b[b.len() - 1];
    while r.len() >= b.len() {
        let top = r.pop().expect("not empty");
        let shift = r.len() + 1 - b.len();
        // |lead| r - sign(lead) top x^shift b
        for x in &mut r {
            *x *= lead.abs();
        }
        let k = if lead.is_positive() { top } else { -top };
        for (i, y) in b[..b.len() - 1].iter().enumerate() {
            r[shift + i] -= &k * y;
        }
    }
    primitive(r.into_iter().map(|x| -x).collect())
}

/// a / b for primitive polynomials where b divides a (then the quotient has integer coefficients, by Gauss).
fn quotient(a: &[BigInt], b: &[BigInt]) -> Vec<BigInt> {
    let mut r = a.to_vec();
    let mut q = vec![BigInt::zero(); a.len() + 1 - b.len()];
    for k in (0..q.len()).rev() {
        let (c, rest) = r[k + b.len() - 1].div_rem(&b[b.len() - 1]);
        assert!(rest.is_zero(), "not a divisor");
        for (i, y) in b.iter().enumerate() {
            r[k + i] -= &c * y;
        }
        q[k] = c;
    }
    q
}

impl Exact {
    /// From Bernstein coefficients, taken exactly.
    pub(crate) fn new(b: &[f64]) -> Self {
        let parts: Vec<_> = b.iter().map(|&x| decode(x)).collect();
        let least = parts.iter().filter(|p| p.0 != 0).map(|p| p.1).min().unwrap_or(0);
        Self::from_integers(
            parts
                .iter()
                .map(|&(m, e)| {
                    if m == 0 {
                        BigInt::zero()
                    } else {
                        BigInt::from(m) << (e - least) as usize
                    }
                })
                .collect(),
        )
    }

    /// From integer Bernstein coefficients.
    pub(crate) fn from_integers(b: Vec<BigInt>) -> Self {
        let n = b.len() - 1;
        let mut d = b.clone();
        for k in 1..=n {
            for i in (k..=n).rev() {
                d[i] = &d[i] - &d[i - 1];
            }
        }
        let a = d.iter().enumerate().map(|(j, x)| x * binomial(n, j)).collect();
        Self { b, a }
    }

    /// From integer power coefficients.
    pub(crate) fn from_power(a: Vec<BigInt>) -> Self {
        Self { b: Vec::new(), a }
    }

    pub(crate) fn is_zero(&self) -> bool {
        self.a.iter().all(Zero::is_zero)
    }

    /// Sign of p(x), exactly.
    pub(crate) fn sign_at(&self, x: f64) -> i32 {
        sign_of(&self.a, x)
    }

    /// Sturm's chain of the square-free part (so that it also counts from multiple roots on).
    pub(crate) fn chain(&self) -> Vec<Vec<BigInt>> {
        let chain = Self::chain_of(primitive(self.a.clone()));
        match chain.last() {
            Some(gcd) if gcd.len() > 1 => Self::chain_of(quotient(&chain[0], gcd)),
            _ => chain,
        }
    }

    fn chain_of(p: Vec<BigInt>) -> Vec<Vec<BigInt>> {
        let d = primitive(p.iter().enumerate().skip(1).map(|(i, x)| x * i).collect());
        let mut chain = vec![p];
        let mut next = d;
        while !next.is_empty() {
            chain.push(next);
            let k = chain.len();
            next = negated_remainder(&chain[k - 2], &chain[k - 1]);
        }
        chain
    }

    /// Number of distinct roots in the closed interval [lo, hi], for p not zero.
    pub(crate) fn distinct_roots(&self, lo: f64, hi: f64) -> usize {
        count(&self.chain(), lo, hi)
    }
}

fn sign_of(a: &[BigInt], x: f64) -> i32 {
    let (m, e) = decode(x);
    let (mut m, mut k) = (m, -e);
    while k > 0 && m % 2 == 0 && m != 0 {
        m /= 2;
        k -= 1;
    }
    if m == 0 {
        return a.first().map_or(0, sign);
    }
    assert!(k >= 0, "only used on [0, 1]");
    let m = BigInt::from(m);
    let mut acc = BigInt::zero();
    for (j, c) in a.iter().rev().enumerate() {
        acc = acc * &m + (c << (k as usize * j));
    }
    sign(&acc)
}

fn variations(chain: &[Vec<BigInt>], x: f64) -> usize {
    let signs: Vec<_> = chain.iter().map(|p| sign_of(p, x)).filter(|&s| s != 0).collect();
    signs.windows(2).filter(|w| w[0] != w[1]).count()
}

fn count(chain: &[Vec<BigInt>], lo: f64, hi: f64) -> usize {
    // V(lo) - V(hi) counts (lo, hi].
    let at_lo = usize::from(sign_of(&chain[0], lo) == 0);
    if lo == hi {
        at_lo
    } else {
        variations(chain, lo) - variations(chain, hi) + at_lo
    }
}

/// Cells `(index, level)`, [index, index + 1] 2^-level, each with exactly one simple root inside, none elsewhere in [0, 1].
/// `None` where i128 is too short or a coefficient at a cell's end is zero. With `first`, only the first cell.
pub(crate) fn quick_cells(b: &[f64], first: bool) -> Option<Vec<(u32, u32)>> {
    let parts: Vec<_> = b.iter().map(|&x| decode(x)).collect();
    let least = parts.iter().map(|p| p.1 + p.0.trailing_zeros() as i32).min()?;
    let mut root = Vec::with_capacity(b.len());
    for &(m, e) in &parts {
        let tz = if m == 0 { 0 } else { m.trailing_zeros() };
        let shift = if m == 0 { 0 } else { e + tz as i32 - least };
        if shift > 60 {
            return None;
        }
        root.push((i128::from(m) >> tz) << shift);
    }
    let n = b.len() - 1;
    let mut out = Vec::new();
    let mut stack = vec![(root, 0u32, 0u32)];
    while let Some((mut c, index, level)) = stack.pop() {
        if c[0] == 0 || c[n] == 0 {
            return None;
        }
        let mut v = 0;
        let mut last = c[0];
        for &x in &c[1..] {
            if x != 0 {
                v += usize::from((x < 0) != (last < 0));
                last = x;
            }
        }
        if v == 0 {
            continue;
        }
        if v == 1 {
            out.push((index, level));
            if first {
                break;
            }
            continue;
        }
        let bits = 128 - c.iter().map(|x| x.unsigned_abs().leading_zeros()).min()?;
        if bits as usize + n > 126 || level >= 30 {
            return None;
        }
        let (mut left, mut right) = (vec![0; n + 1], vec![0; n + 1]);
        for k in 0..=n {
            left[k] = c[0] << (n - k);
            right[n - k] = c[n - k] << (n - k);
            for i in 0..n - k {
                c[i] += c[i + 1];
            }
        }
        stack.push((right, 2 * index + 1, level + 1));
        stack.push((left, 2 * index, level + 1));
    }
    Some(out)
}

/// Outcome of a comparison with the truth.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Verdict {
    /// Proved answer, and it is true.
    Right,
    /// The solver said that it does not know (touching, or gave up), and nothing it said is false.
    Flagged,
    /// What the solver claimed is false.
    Wrong(String),
}

/// The same answer in f64.
pub(crate) fn widen(a: &First<f32>) -> First<f64> {
    match *a {
        First::None => First::None,
        First::GaveUp { at } => First::GaveUp { at: at.into() },
        First::Root(r) => First::Root(wide_root(&r)),
    }
}

fn wide_root(r: &Root<f32>) -> Root<f64> {
    Root {
        lo: r.lo.into(),
        hi: r.hi.into(),
        t: r.t.into(),
        kind: r.kind,
    }
}

/// The roots in f64, and where the search gave up.
pub(crate) struct Answer {
    pub(crate) roots: Vec<Root<f64>>,
    pub(crate) gave_up: Option<f64>,
}

impl From<&Roots<f64>> for Answer {
    fn from(a: &Roots<f64>) -> Self {
        Self {
            roots: a.as_slice().to_vec(),
            gave_up: a.gave_up(),
        }
    }
}

impl From<&Roots<f32>> for Answer {
    fn from(a: &Roots<f32>) -> Self {
        Self {
            roots: a.as_slice().iter().map(wide_root).collect(),
            gave_up: a.gave_up().map(f64::from),
        }
    }
}

/// Is this answer true of the polynomial with exactly these coefficients?
pub(crate) fn check_first(b: &[f64], answer: &First<f64>) -> Verdict {
    let wrong = |why: &str| Verdict::Wrong(format!("{why}: {answer:?} for {b:?}"));
    match (quick_cells(b, true), answer) {
        (Some(cells), First::None) => {
            if cells.is_empty() {
                Verdict::Right
            } else {
                wrong("lost a root")
            }
        }
        (Some(cells), First::Root(r)) if r.kind == RootKind::Crossing => match cells.first() {
            None => wrong("no root at all"),
            Some(&cell) => {
                if holds(&Signs::new(b), r, cell) {
                    Verdict::Right
                } else {
                    wrong("not the first root")
                }
            }
        },
        _ => check_first_by_sturm(b, answer),
    }
}

/// Signs of p, exactly: by de Casteljau in f64 where its error bound allows, else in integers.
struct Signs<'a> {
    b: &'a [f64],
    bound: f64,
    exact: OnceCell<Exact>,
}

impl<'a> Signs<'a> {
    fn new(b: &'a [f64]) -> Self {
        let most = b.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
        // Each of the n columns adds at most 3 roundings of numbers up to `most` (2^-53 each), to first order; 8 covers the rest.
        let bound = 8.0 * b.len() as f64 * most * 0.5 * f64::EPSILON;
        Self {
            b,
            bound,
            exact: OnceCell::new(),
        }
    }

    fn at(&self, x: f64) -> i32 {
        let mut c = self.b.to_vec();
        for k in 1..c.len() {
            for i in 0..c.len() - k {
                c[i] = c[i] * (1.0 - x) + c[i + 1] * x;
            }
        }
        if c[0].abs() > self.bound && self.bound > 1e-200 {
            return c[0].signum() as i32;
        }
        self.exact.get_or_init(|| Exact::new(self.b)).sign_at(x)
    }
}

/// Whether the one root of the cell lies in the bracket. (No root lies before the cell.)
fn holds(p: &Signs<'_>, r: &Root<f64>, (index, level): (u32, u32)) -> bool {
    let w = 0.5f64.powi(level as i32);
    let (a, z) = (f64::from(index) * w, f64::from(index + 1) * w);
    let rises = p.at(z);
    let below = |x: f64| x <= a || (x <= z && p.at(x) != rises);
    let above = |x: f64| x >= z || (x >= a && p.at(x) != -rises);
    below(r.lo) && above(r.hi)
}

/// The same by Sturm's theorem alone: works for every polynomial, slowly.
pub(crate) fn check_first_by_sturm(b: &[f64], answer: &First<f64>) -> Verdict {
    let wrong = |why: &str| Verdict::Wrong(format!("{why}: {answer:?} for {b:?}"));
    let p = Exact::new(b);
    if p.is_zero() {
        let whole = matches!(answer, First::Root(r) if r.kind == RootKind::Interval && r.lo == 0.0 && r.hi == 1.0);
        return if whole { Verdict::Right } else { wrong("the zero polynomial") };
    }
    let chain = p.chain();
    match answer {
        First::None if count(&chain, 0.0, 1.0) == 0 => Verdict::Right,
        First::None => wrong("lost a root"),
        First::GaveUp { at } if none_before(&p, &chain, *at) => Verdict::Flagged,
        First::GaveUp { .. } => wrong("gave up behind a root"),
        First::Root(r) if r.kind == RootKind::Interval => wrong("not the zero polynomial"),
        First::Root(r) if !none_before(&p, &chain, r.lo) => wrong("a root before"),
        First::Root(r) => match (r.kind, count(&chain, r.lo, r.hi)) {
            (RootKind::Touching, _) => Verdict::Flagged,
            (_, 0) => wrong("no root in the bracket"),
            (RootKind::End, _) if p.sign_at(r.t) != 0 => wrong("not a root"),
            (RootKind::Crossing, _) if p.sign_at(r.lo) * p.sign_at(r.hi) != -1 => wrong("no change of sign"),
            _ => Verdict::Right,
        },
    }
}

/// No root in [0, x).
fn none_before(p: &Exact, chain: &[Vec<BigInt>], x: f64) -> bool {
    count(chain, 0.0, x) == usize::from(p.sign_at(x) == 0)
}

/// Are these all roots, each in its own bracket?
pub(crate) fn check_all<A: Into<Answer>>(b: &[f64], answer: A) -> Verdict {
    let answer = answer.into();
    let roots = &answer.roots;
    let wrong = |why: &str| Verdict::Wrong(format!("{why}: {roots:?} for {b:?}"));
    let crossings = roots.iter().all(|r| r.kind == RootKind::Crossing) && answer.gave_up.is_none();
    if let (Some(cells), true) = (quick_cells(b, false), crossings) {
        let p = Signs::new(b);
        let same = cells.len() == roots.len() && cells.iter().zip(roots).all(|(&c, r)| in_cell(&p, r, c));
        if same {
            return Verdict::Right;
        }
    }
    let p = Exact::new(b);
    let chain = p.chain();
    if p.is_zero() || answer.gave_up.is_some() {
        return Verdict::Flagged;
    }
    let (mut sum, mut single) = (0, true);
    let mut last = -1.0;
    for r in roots {
        let k = count(&chain, r.lo, r.hi) - usize::from(last == r.lo && p.sign_at(last) == 0);
        if k == 0 && r.kind != RootKind::Touching {
            return wrong("no root in a bracket");
        }
        if r.kind == RootKind::Crossing && p.sign_at(r.lo) * p.sign_at(r.hi) != -1 {
            return wrong("no change of sign");
        }
        single &= k == 1;
        sum += k;
        last = r.hi;
    }
    if sum != count(&chain, 0.0, 1.0) {
        return wrong("a root outside of the brackets");
    }
    if crossings && single {
        Verdict::Right
    } else {
        Verdict::Flagged
    }
}

/// Whether the cell's root lies in the bracket; other roots may lie left of the cell.
fn in_cell(p: &Signs<'_>, r: &Root<f64>, cell: (u32, u32)) -> bool {
    let w = 0.5f64.powi(cell.1 as i32);
    r.hi >= f64::from(cell.0) * w && r.lo <= f64::from(cell.0 + 1) * w && holds(p, r, cell)
}

/// A small seeded generator (xorshift64*), so that a failure can be repeated.
pub(crate) struct Random(u64);

impl Random {
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1)
    }

    pub(crate) fn bits(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D)
    }

    /// In [-1, 1), 53 bits.
    pub(crate) fn signed(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    }

    /// In [-1, 1), 24 bits: exact in f32.
    pub(crate) fn signed24(&mut self) -> f64 {
        (self.bits() >> 40) as f64 / (1u64 << 23) as f64 - 1.0
    }
}
