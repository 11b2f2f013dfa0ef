//! What integers can still say of a zero that double-double could not place.
//!
//! * **At a fraction.** Where all three polynomials vanish at the parameters with the smallest denominators near the doubt, there is a root, and its t is a fraction.
//! * **On a face.** On the face `u_k = 0` or 1 of an element the system has two unknowns left. If one of its equations is dependent there (all
//!   coefficients of the face are 0; or those of alpha and beta are proportional, which is so where the face is flat and holds the ray), it is
//!   replaced by `u_k - face`; a zero of the new system lies on the face exactly and is one of the old system too. Likewise for edges and corners.

use super::{Line, Target, forms::up};
use crate::exact::{Dyadic, Ratio, sign};
use dashu_int::IBig;
use isobar_core::HexElement;

/// Denominators of the fractions that are tried, at most.
const DENOMINATOR: f64 = 1_048_576.0;

/// A fraction in [0, 1].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Fraction {
    n: i64,
    d: i64,
}

/// A fraction with a small denominator in [0, 1] and (up to rounding) in `[lo, hi]`.
pub(super) fn simplest(lo: f64, hi: f64) -> Option<Fraction> {
    // The interval's simplest fraction by continued fractions; only a guess, integers decide.
    fn within(lo: f64, hi: f64, depth: u32) -> Option<(f64, f64)> {
        let whole = lo.ceil();
        if whole <= hi {
            return Some((whole, 1.0));
        }
        if depth == 0 {
            return None;
        }
        let floor = lo.floor();
        let (n, d) = within(1.0 / (hi - floor), 1.0 / (lo - floor), depth - 1)?;
        (n <= DENOMINATOR).then_some((floor * n + d, n))
    }
    let slack = 4.0 * f64::EPSILON;
    let (lo, hi) = ((lo - slack).max(0.0), (hi + slack).min(1.0));
    if lo > hi {
        return None;
    }
    let (n, d) = within(lo, hi, 40)?;
    (d <= DENOMINATOR && n >= 0.0 && n <= d).then_some(Fraction {
        n: n as i64,
        d: d as i64,
    })
}

/// Weights of the Bernstein coefficients at n/d, times d^degree.
fn weights(degree: u8, x: Fraction) -> Vec<IBig> {
    let n = usize::from(degree);
    let (a, b) = (IBig::from(x.n), IBig::from(x.d - x.n));
    let mut ways = IBig::ONE;
    (0..=n)
        .map(|i| {
            let w = &ways * a.pow(i) * b.pow(n - i);
            ways = &ways * IBig::from(n - i) / IBig::from(i + 1);
            w
        })
        .collect()
}

/// The polynomial at the fractions, times their denominators to the degrees.
fn value(mut c: Vec<IBig>, degree: [u8; 3], u: &[Fraction; 3]) -> IBig {
    for axis in 0..3 {
        let w = weights(degree[axis], u[axis]);
        c = c
            .chunks_exact(w.len())
            .map(|row| row.iter().zip(&w).map(|(c, w)| c * w).sum())
            .collect();
    }
    c.swap_remove(0)
}

fn exact(x: f64) -> Dyadic {
    Dyadic::from_f64(x)
}

fn minus(a: f64, b: f64) -> Dyadic {
    exact(a).plus(&exact(b).negated())
}

/// Coefficients of alpha or beta.
fn across(element: &HexElement, line: &Line, other: usize) -> Vec<Dyadic> {
    let (k, i) = (line.along, line.others[other]);
    let (o, d) = (line.origin, line.direction);
    element
        .points
        .iter()
        .map(|p| {
            let a = exact(d[k]).times(&minus(p[i], o[i]));
            let b = exact(d[i]).times(&minus(p[k], o[k]));
            exact(p[3]).times(&a.plus(&b.negated()))
        })
        .collect()
}

/// Coefficients of gamma and its degree.
fn gamma(element: &HexElement, target: Target) -> (Vec<Dyadic>, [u8; 3]) {
    match target {
        Target::Isovalue(c) => {
            let of = |n: usize| {
                let x = minus(element.values[n], c);
                if element.rational_value {
                    x.times(&exact(element.points[n][3]))
                } else {
                    x
                }
            };
            ((0..element.values.len()).map(of).collect(), element.value_degree)
        }
        Target::Parameter { axis, value } => (
            vec![exact(-value), minus(1.0, value)],
            std::array::from_fn(|a| u8::from(a == axis)),
        ),
    }
}

/// t of a root at these parameters, if there is one.
pub(super) fn root_at(element: &HexElement, line: &Line, target: Target, u: &[Fraction; 3]) -> Option<Ratio> {
    let zero = |c: &[Dyadic], degree| sign(&value(Dyadic::integers(c), degree, u)) == 0;
    let (g, degree) = gamma(element, target);
    let all = zero(&across(element, line, 0), element.degree) && zero(&across(element, line, 1), element.degree);
    if !(all && zero(&g, degree)) {
        return None;
    }
    // T and W d_k over one power of two.
    let k = line.along;
    let way = element.points.iter().map(|p| exact(p[3]).times(&minus(p[k], line.origin[k])));
    let weight = element.points.iter().map(|p| exact(p[3]).times(&exact(line.direction[k])));
    let both: Vec<Dyadic> = way.chain(weight).collect();
    let mut both = Dyadic::integers(&both);
    let weight = value(both.split_off(element.points.len()), element.degree, u);
    let way = value(both, element.degree, u);
    (sign(&weight) != 0).then(|| Ratio::new(way, weight))
}

/// The coefficients that count on the faces given.
fn on_faces(c: Vec<Dyadic>, degree: [u8; 3], faces: &[Option<f64>; 3]) -> Vec<Dyadic> {
    let n = degree.map(|d| usize::from(d) + 1);
    let kept = |at: usize| {
        let i = [at % n[0], at / n[0] % n[1], at / n[0] / n[1]];
        (0..3).all(|a| match faces[a] {
            None => true,
            Some(f) if f > 0.5 => i[a] + 1 == n[a],
            Some(_) => i[a] == 0,
        })
    };
    c.into_iter()
        .enumerate()
        .filter(|(at, _)| kept(*at))
        .map(|(_, c)| c)
        .collect()
}

/// Which of the three equations are left on the faces, if as many as there are unknowns.
pub(super) fn independent(element: &HexElement, line: &Line, target: Target, faces: &[Option<f64>; 3]) -> Option<Vec<usize>> {
    let cut = |c, degree| on_faces(c, degree, faces);
    let a = cut(across(element, line, 0), element.degree);
    let b = cut(across(element, line, 1), element.degree);
    let (g, degree) = gamma(element, target);
    let g = cut(g, degree);
    let pivot = |c: &[Dyadic]| c.iter().position(|x| x.sign() != 0);
    let mut kept = Vec::new();
    match (pivot(&a), pivot(&b)) {
        (None, None) => {}
        (Some(_), None) => kept.push(0),
        (None, Some(_)) => kept.push(1),
        (Some(n), Some(_)) => {
            kept.push(0);
            let apart = |(x, y): (&Dyadic, &Dyadic)| x.times(&b[n]).plus(&y.times(&a[n]).negated()).sign() != 0;
            if a.iter().zip(&b).any(apart) {
                kept.push(1);
            }
        }
    }
    if pivot(&g).is_some() {
        kept.push(2);
    }
    let unknowns = faces.iter().filter(|f| f.is_none()).count();
    (kept.len() == unknowns).then_some(kept)
}

/// f64 about a fraction, as centre and radius.
pub(super) fn ball(t: &Ratio) -> (f64, f64) {
    let (lo, hi) = t.bounds();
    (lo, if hi > lo { up(hi - lo) } else { 0.0 })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fractions_with_small_denominators_are_guessed() {
        for (n, d) in [(0, 1), (1, 1), (1, 2), (1, 3), (3, 10), (7, 64), (999, 1000)] {
            let x = n as f64 / d as f64;
            assert_eq!(simplest(x - 1e-15, x + 1e-15), Some(Fraction { n, d }));
        }
        assert_eq!(simplest(-0.1, -0.01), None);
        let x = std::f64::consts::FRAC_1_SQRT_2;
        assert_eq!(simplest(x, x), None);
    }

    #[test]
    fn integer_weights_are_those_of_bernstein() {
        let w = weights(3, Fraction { n: 1, d: 4 });
        assert_eq!(w, [27, 27, 9, 1].map(IBig::from));
    }
}
