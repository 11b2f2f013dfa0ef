//! aRFBS: isolation by subdivision, then regula falsi and halving in turn (thesis, section 3.2.4 and Listing A.3).

use super::Answer;
use super::polygon::{first_two_crossings, split};
use isobar_poly::{Real, bernstein, scaled};

/// First root on [0, 1]: splits half way between the first two crossings of the control polygon until one is left, at most `splits` times,
/// then `iterations` steps of regula falsi and halving in turn, by the scaled Bernstein form's Horner scheme.
///
/// **No guarantee.** One crossing left is one root, but as in LR81 the part on the right is gone once the one on the left crosses at all: if that one has no
/// root, [`Answer::None`] loses those on the right. A double root or a near miss can use up the splits ([`Answer::GaveUp`]; the
/// listing has no limit). How close the root is depends on `iterations`: each pair halves the interval at least.
///
/// Corrected against the listing (maths, section B, and reading it): `findFirstCrossing` and `findFirstCrossings` are one function, `crossing` in two
/// places is `crossings`; phase 2 takes `crossing1` and returns through `rootpos`, which it never sets after the loop; `left` in it is `poly`. Filled in:
/// the part of [0, 1] ("snipped update of Scale and Root"), and `RES`, which is not given: two roundings of the largest coefficient. The sign of `fc*fa` is
/// taken from the factors, because in f32 the product underflows; a step that hits zero is the last (the listing then divides 0 by 0, hardcases A9).
#[must_use]
pub fn arfbs<T: Real, const M: usize>(b: &[T; M], splits: u32, iterations: u32) -> Answer<T> {
    let mut p = *b;
    let (mut start, mut width) = (T::ZERO, T::ONE);
    let (mut crossings, mut first, mut second) = first_two_crossings(&p);
    let mut used = 0;
    while crossings > 1 {
        if used == splits {
            return Answer::GaveUp;
        }
        used += 1;
        let at = T::HALF * (first + second);
        let (left, right) = split(&p, at);
        (crossings, first, second) = first_two_crossings(&left);
        if crossings > 0 {
            width *= at;
            p = left;
        } else {
            (crossings, first, second) = first_two_crossings(&right);
            start += width * at;
            width *= T::ONE - at;
            p = right;
        }
    }
    if crossings == 0 {
        return Answer::None;
    }
    Answer::Root(start + width * refine(&mut p, first, iterations))
}

/// Phase 2: the one root of `p`, from `c`.
#[inline(always)]
fn refine<T: Real, const M: usize>(p: &mut [T; M], mut c: T, iterations: u32) -> T {
    let resolution = p.iter().fold(T::ZERO, |m, x| m.larger(x.abs())) * (T::ROUNDOFF + T::ROUNDOFF);
    let (mut a, mut b, mut fa, mut fb) = (T::ZERO, T::ONE, p[0], p[M - 1]);
    bernstein::to_scaled(&mut p[..]);
    let mut fc = scaled::eval(&p[..], c);
    if fc.abs() < resolution {
        return c;
    }
    for iteration in 0..iterations {
        if iteration > 0 {
            c = if iteration % 2 == 1 {
                (a * fb - b * fa) / (fb - fa)
            } else {
                T::HALF * (a + b)
            };
            fc = scaled::eval(&p[..], c);
        }
        if fc == T::ZERO {
            break;
        }
        if (fc > T::ZERO && fa > T::ZERO) || (fc < T::ZERO && fa < T::ZERO) {
            (a, fa) = (c, fc);
        } else {
            (b, fb) = (c, fc);
        }
    }
    c
}
