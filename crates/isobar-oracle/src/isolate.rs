//! Stages 1 and 2: certified isolation and refinement of the roots of a polynomial whose Bernstein coefficients are known to an error bound.
//!
//! * All coefficients certainly of one sign: no root (the polynomial is an average of them).
//! * Certain signs at both ends and exactly one variation whatever the doubtful coefficients are: exactly one root, and it is simple
//!   (Descartes).
//! * Otherwise the interval is cut at 1/2 (or 7/16, 9/16 where the value at the cut is doubtful) by de Casteljau's algorithm and the
//!   halves are treated alike, left first. A doubtful sign at an end, or twelve cuts, gives up: the caller goes to the next stage.
//!
//! A step of de Casteljau's `(1 - x) b_i + x b_(i+1)` has two products and a sum and, for general x, a rounded `1 - x`: at most
//! 4 units of rounding of `max |b|`. n such steps follow one another and averages do not enlarge errors: `4 n U max|b|` is
//! added to the bound, for a cut and for an evaluation.

use crate::{
    compose::{Bernstein, MOST},
    real::Real,
};

/// Why a stage could not decide.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Undecided;

/// A certified simple root: `lo < root < hi` in the parameter tau of the polynomial, with certain signs at both.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Isolated {
    pub(crate) lo: f64,
    pub(crate) hi: f64,
    /// Derivative by tau at the root, rounded.
    pub(crate) slope: f64,
}

/// Cuts on the way to a node. Each makes the ends of the interval at most 4 bits longer, so they stay exact in f64.
const DEPTH: usize = 12;

/// What certain signs say.
enum Count {
    None,
    One,
    More,
}

/// Certainly positive 1, certainly negative -1, doubtful 0.
#[inline]
fn certain(x: f64, error: f64) -> i32 {
    // x is a double-double's leading part at worst: half an ulp off, so the comparison keeps a margin.
    if x.abs() * (1.0 - 4.0 * f64::EPSILON) > error {
        if x > 0.0 { 1 } else { -1 }
    } else {
        0
    }
}

/// Least and greatest possible number of sign variations decide.
fn count<R: Real>(b: &[R], error: f64) -> Result<Count, Undecided> {
    let first = certain(b[0].f64(), error);
    let last = certain(b[b.len() - 1].f64(), error);
    if first == 0 || last == 0 {
        return Err(Undecided);
    }
    // The greatest number: a doubtful run of length k between certain signs adds up to k + 1 changes, of the parity its ends force.
    let (mut most, mut before, mut doubtful) = (0usize, first, 0usize);
    for x in &b[1..] {
        match certain(x.f64(), error) {
            0 => doubtful += 1,
            s => {
                let differs = usize::from(s != before);
                most += if doubtful % 2 == differs { doubtful } else { doubtful + 1 };
                (before, doubtful) = (s, 0);
            }
        }
    }
    Ok(match most {
        0 => Count::None,
        1 => Count::One,
        _ => Count::More,
    })
}

/// The roots in (0, 1), ascending and certified, or the confession that this arithmetic cannot tell. With `first_only` at most one.
pub(crate) fn isolate<R: Real>(p: &Bernstein<R>, first_only: bool, out: &mut Vec<Isolated>) -> Result<(), Undecided> {
    out.clear();
    match count(p.coefficients(), p.error)? {
        Count::None => return Ok(()),
        Count::One => {
            out.push(refine(p, 0.0, 1.0)?);
            return Ok(());
        }
        Count::More => {}
    }
    let mut stack = vec![(p.clone(), 0.0, 1.0, 0)];
    while let Some((q, lo, hi, depth)) = stack.pop() {
        match count(q.coefficients(), q.error)? {
            Count::None => {}
            Count::One => {
                out.push(refine(&q, lo, hi)?);
                if first_only {
                    return Ok(());
                }
            }
            Count::More if depth == DEPTH => return Err(Undecided),
            Count::More => {
                let (left, right, at) = cut(&q)?;
                let mid = lo + (hi - lo) * at;
                stack.push((right, mid, hi, depth + 1));
                stack.push((left, lo, mid, depth + 1));
            }
        }
    }
    Ok(())
}

/// Both halves and where they meet, a place with a certain sign.
fn cut<R: Real>(p: &Bernstein<R>) -> Result<(Bernstein<R>, Bernstein<R>, f64), Undecided> {
    for at in [0.5, 0.4375, 0.5625] {
        let (left, right) = split(p, at);
        if certain(right.b[0].f64(), right.error) != 0 {
            return Ok((left, right, at));
        }
    }
    Err(Undecided)
}

/// The polynomial on `[0, at]` and `[at, 1]`; `1 - at` must be exact.
fn split<R: Real>(p: &Bernstein<R>, at: f64) -> (Bernstein<R>, Bernstein<R>) {
    let n = p.n;
    let (x, y) = (R::from_f64(at), R::from_f64(1.0 - at));
    let mut left = p.clone();
    let mut right = p.clone();
    let most = greatest(p.coefficients());
    for k in 1..=n {
        for i in 0..=n - k {
            right.b[i] = y * right.b[i] + x * right.b[i + 1];
        }
        left.b[k] = right.b[0];
    }
    let error = p.error + 4.0 * n as f64 * R::UNIT * most;
    left.error = error;
    right.error = error;
    (left, right)
}

fn greatest<R: Real>(b: &[R]) -> f64 {
    b.iter().fold(0.0f64, |m, x| m.max(x.f64().abs()))
}

/// Value and derivative at x, without the error bound.
fn evaluate<R: Real>(p: &Bernstein<R>, x: f64) -> (R, f64) {
    let n = p.n;
    let mut b = [R::ZERO; MOST + 1];
    b[..=n].copy_from_slice(&p.b[..=n]);
    let one = R::from_f64(1.0);
    let x = R::from_f64(x);
    let y = one - x;
    let mut slope = 0.0;
    for k in 1..=n {
        if k == n {
            slope = (b[1] - b[0]).f64() * n as f64;
        }
        for i in 0..=n - k {
            b[i] = y * b[i] + x * b[i + 1];
        }
    }
    (b[0], slope)
}

/// Narrows the single root of `p`, which lives on `[lo, hi]` of the caller's parameter: a safeguarded Newton iteration in R, then two
/// certified signs around its result.
fn refine<R: Real>(p: &Bernstein<R>, lo: f64, hi: f64) -> Result<Isolated, Undecided> {
    let error = p.error + 4.0 * p.n as f64 * R::UNIT * greatest(p.coefficients());
    let first = certain(p.b[0].f64(), p.error);
    let (mut a, mut b) = (0.0f64, 1.0f64);
    let (fa, fb) = (p.b[0].f64(), p.b[p.n].f64());
    let mut x = (fa / (fa - fb)).clamp(0.0, 1.0);
    let mut slope = fb - fa;
    for _ in 0..40 {
        let (v, d) = evaluate(p, x);
        let v = v.f64();
        slope = d;
        match certain(v, error) {
            0 => break,
            s if s == first => a = x,
            _ => b = x,
        }
        let step = x - v / d;
        if (step - x).abs() <= 2.0 * f64::EPSILON * x {
            // Converged to the f64 next to the root; bisecting now would only lead away.
            break;
        }
        x = if step > a && step < b { step } else { 0.5 * (a + b) };
        if x <= a || x >= b {
            break;
        }
    }
    // Where the value is doubtful, the root is within error/|slope|; four times that and one ulp give certain signs at a simple root.
    let mut reach = (2.0 * error / slope.abs()).max(f64::EPSILON * x).max(f64::MIN_POSITIVE);
    for _ in 0..8 {
        let (l, r) = (x - reach, x + reach);
        if l > a && certain(evaluate(p, l).0.f64(), error) == first {
            a = l;
        }
        if r < b && certain(evaluate(p, r).0.f64(), error) == -first {
            b = r;
        }
        if b - a <= 2.0 * reach * (1.0 + 1e-9) {
            break;
        }
        reach *= 4.0;
    }
    let h = hi - lo;
    // `lo + h x` with h exact: product and sum round once each.
    let outward = |x: f64, down: bool| {
        let v = lo + h * x;
        let slack = 3.0 * crate::real::U64 * (v.abs() + (h * x).abs());
        if down { (v - slack).max(lo) } else { (v + slack).min(hi) }
    };
    Ok(Isolated {
        lo: outward(a, true),
        hi: outward(b, false),
        slope: slope / h,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::real::Dd;

    fn bernstein<R: Real>(b: &[f64], error: f64) -> Bernstein<R> {
        let mut c = [R::ZERO; MOST + 1];
        for (x, &y) in c.iter_mut().zip(b) {
            *x = R::from_f64(y);
        }
        Bernstein {
            n: b.len() - 1,
            b: c,
            error,
        }
    }

    fn roots<R: Real>(b: &[f64], error: f64) -> Result<Vec<Isolated>, Undecided> {
        let mut out = Vec::new();
        isolate(&bernstein::<R>(b, error), false, &mut out).map(|()| out)
    }

    #[test]
    fn doubtful_signs_are_not_guessed() {
        assert_eq!(roots::<f64>(&[1.0, 1e-9, 1.0], 1e-8).map(|r| r.len()), Ok(0));
        assert_eq!(roots::<f64>(&[1.0, 1e-9, -1.0], 1e-8).map(|r| r.len()), Ok(1));
        assert_eq!(roots::<f64>(&[1e-9, 1.0, 1.0], 1e-8), Err(Undecided));
        assert_eq!(roots::<f64>(&[1.0, -1.0, 1.0], 1e-12), Err(Undecided)); // a tangent
        assert_eq!(roots::<f64>(&[1.0, -0.9, 1.0], 1e-12).map(|r| r.len()), Ok(0));
        assert_eq!(roots::<f64>(&[1.0, -1.1, 1.0], 1e-12).map(|r| r.len()), Ok(2));
    }

    #[test]
    fn brackets_hold_the_root_and_are_narrow() {
        // 1 - 3 tau: root 1/3
        for r in [
            roots::<f64>(&[1.0, -2.0], 1e-15).unwrap()[0],
            roots::<Dd>(&[1.0, -2.0], 1e-31).unwrap()[0],
        ] {
            assert!(r.lo <= 1.0 / 3.0 && 1.0 / 3.0 <= r.hi && r.hi - r.lo < 4e-15, "{r:?}");
            assert!((r.slope + 3.0).abs() < 1e-12);
        }
        assert!(roots::<Dd>(&[1.0, -2.0], 1e-31).unwrap()[0].hi - roots::<Dd>(&[1.0, -2.0], 1e-31).unwrap()[0].lo < 8e-16);
    }
}
