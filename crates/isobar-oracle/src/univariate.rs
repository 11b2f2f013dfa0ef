//! Roots of one univariate polynomial with exact coefficients: the oracle's own machinery, without a ray.

use crate::{
    AllRoots, Decided, Multiplicity, Root,
    bracket::Bracket,
    compose::{Bernstein, MOST, binomials},
    exact::{Piece, Ratio, Roots},
    isolate::isolate,
    real::{Dd, Real, in_range},
};
use dashu_int::IBig;
use std::{fmt, str::FromStr};

/// An exact rational coefficient: from an f64 (its bits), a fraction, or a decimal or fraction in text.
#[derive(Clone, Debug)]
pub struct Coefficient(Ratio);

/// Text that is no number.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` is no exact number; write an integer, a decimal such as -1.25e-18, or a fraction such as -9/10")]
pub struct ParseError(String);

impl Coefficient {
    /// `n / d`, `None` for d = 0.
    #[must_use]
    pub fn new(n: i128, d: i128) -> Option<Self> {
        (d != 0).then(|| Self(Ratio::new(IBig::from(n), IBig::from(d))))
    }

    /// Exactly `x`, `None` where it is not finite.
    #[must_use]
    pub fn from_f64(x: f64) -> Option<Self> {
        x.is_finite().then(|| Self(Ratio::from_f64(x)))
    }
}

impl From<i32> for Coefficient {
    fn from(n: i32) -> Self {
        Self(Ratio::new(IBig::from(n), IBig::ONE))
    }
}

impl fmt::Display for Coefficient {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.0.n, self.0.d)
    }
}

impl FromStr for Coefficient {
    type Err = ParseError;

    fn from_str(s: &str) -> Result<Self, ParseError> {
        let bad = || ParseError(s.to_owned());
        if let Some((n, d)) = s.split_once('/') {
            let (n, d): (IBig, IBig) = (n.trim().parse().map_err(|_| bad())?, d.trim().parse().map_err(|_| bad())?);
            return if d.is_zero() { Err(bad()) } else { Ok(Self(Ratio::new(n, d))) };
        }
        let (mantissa, exponent) = match s.split_once(['e', 'E']) {
            Some((m, e)) => (m, e.parse::<i32>().map_err(|_| bad())?),
            None => (s, 0),
        };
        let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
        let digits: IBig = format!("{whole}{fraction}").parse().map_err(|_| bad())?;
        let exponent = exponent - i32::try_from(fraction.len()).map_err(|_| bad())?;
        if exponent.abs() > 5000 {
            return Err(bad());
        }
        let power = IBig::from(10).pow(exponent.unsigned_abs() as usize);
        Ok(Self(if exponent < 0 {
            Ratio::new(digits, power)
        } else {
            Ratio::new(digits * power, IBig::ONE)
        }))
    }
}

/// How coefficients are meant.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// `sum c_i t^i`.
    Power,
    /// `sum c_i C(n, i) tau^i (1 - tau)^(n - i)` with `t = lo + tau (hi - lo)`.
    Bernstein,
}

/// All distinct roots in the closed interval `[lo, hi]`, by integers alone; `None` where lo, hi are not finite with `lo < hi`, or there are
/// no coefficients. A polynomial that is zero has one root with [`Multiplicity::Interval`]. The
/// slope of simple roots is not worked out (NaN).
#[must_use]
pub fn roots(form: Form, coefficients: &[Coefficient], lo: f64, hi: f64) -> Option<AllRoots> {
    if !(lo.is_finite() && hi.is_finite() && lo < hi) || coefficients.is_empty() {
        return None;
    }
    // One common denominator.
    let mut common = IBig::ONE;
    for c in coefficients {
        common = Ratio::new(common.clone(), c.0.d.clone()).n * &c.0.d;
    }
    let integers: Vec<IBig> = coefficients.iter().map(|c| &c.0.n * (&common / &c.0.d)).collect();
    let (t0, t1) = (Ratio::from_f64(lo), Ratio::from_f64(hi));
    let piece = match form {
        Form::Power => Piece::from_power(&integers, t0, t1),
        Form::Bernstein => scaled(integers, t0, t1),
    };
    Some(solve(&piece, lo, hi))
}

fn scaled(mut b: Vec<IBig>, t0: Ratio, t1: Ratio) -> Piece {
    let n = b.len() - 1;
    let mut binomial = IBig::ONE;
    for (i, c) in b.iter_mut().enumerate() {
        if i > 0 {
            binomial = binomial * IBig::from(n + 1 - i) / IBig::from(i);
        }
        *c *= &binomial;
    }
    Piece {
        b,
        t0,
        t1,
        closed: true,
        most: IBig::ZERO,
    }
}

fn solve(piece: &Piece, lo: f64, hi: f64) -> AllRoots {
    let roots = match piece.roots(false) {
        Roots::Zero => vec![Root {
            lo,
            hi: lo,
            multiplicity: Multiplicity::Interval,
            interval_end: Some(hi),
            slope: 0.0,
            decided: Decided::Exact,
        }],
        Roots::Some(r) => r
            .iter()
            .map(|r| Root {
                lo: r.lo,
                hi: r.hi,
                multiplicity: Multiplicity::of(r.order),
                interval_end: None,
                slope: if r.order == 1 { f64::NAN } else { 0.0 },
                decided: Decided::Exact,
            })
            .collect(),
    };
    AllRoots {
        roots,
        unresolved: Vec::new(),
        decided: Decided::Exact,
    }
}

/// All distinct roots in `[lo, hi]` of the polynomial with exactly these f64 Bernstein coefficients, by the three stages. `None` as for
/// [`roots`], or where a coefficient is not finite.
#[must_use]
pub fn bernstein_roots(b: &[f64], lo: f64, hi: f64) -> Option<AllRoots> {
    if !b.iter().all(|v| v.is_finite()) {
        return None;
    }
    if b.len() - usize::from(!b.is_empty()) <= MOST && b.iter().copied().chain([lo, hi]).all(in_range) && lo < hi {
        if let Some(r) = staged::<f64>(b, lo, hi, Decided::F64) {
            return Some(r);
        }
        if let Some(r) = staged::<Dd>(b, lo, hi, Decided::DoubleDouble) {
            return Some(r);
        }
    }
    let exact: Vec<Coefficient> = b.iter().map(|&v| Coefficient(Ratio::from_f64(v))).collect();
    let mut all = roots(Form::Bernstein, &exact, lo, hi)?;
    for r in all.roots.iter_mut().filter(|r| r.slope.is_nan()) {
        r.slope = slope(b, (r.lo - lo) / (hi - lo)) / (hi - lo);
    }
    Some(all)
}

fn staged<R: Real>(b: &[f64], lo: f64, hi: f64, stage: Decided) -> Option<AllRoots> {
    if b.is_empty() {
        return None;
    }
    let mut p = Bernstein {
        n: b.len() - 1,
        b: [R::ZERO; MOST + 1],
        error: 0.0,
    };
    for (x, &v) in p.b.iter_mut().zip(b) {
        *x = R::from_f64(v);
    }
    let mut isolated = Vec::new();
    isolate(&p, false, &mut isolated).ok()?;
    let mut found = Vec::with_capacity(isolated.len());
    for r in &isolated {
        let bracket = Bracket::new(0.0, (lo, hi), r);
        if !bracket.narrow() {
            return None;
        }
        found.push(bracket.root(lo, stage));
    }
    Some(AllRoots {
        roots: found,
        unresolved: Vec::new(),
        decided: stage,
    })
}

/// Derivative by tau, rounded.
fn slope(b: &[f64], tau: f64) -> f64 {
    let n = b.len() - 1;
    if n == 0 || n > MOST {
        return 0.0;
    }
    let k = binomials(n - 1);
    (0..n)
        .map(|i| (b[i + 1] - b[i]) * k[i] * tau.powi(i as i32) * (1.0 - tau).powi((n - 1 - i) as i32))
        .sum::<f64>()
        * n as f64
}
