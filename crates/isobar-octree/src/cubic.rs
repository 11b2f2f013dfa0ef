//! A cubic in Bernstein form on [0, 1], left to right: where its sign is certain, its simple roots, and where it cannot be told from zero.
//!
//! "Certain" is meant in the sense of a bound on the error of the four coefficients (see `walk.rs` for its derivation): a coefficient
//! counts as positive or negative only beyond the bound. The number of sign changes bounds the number of roots from above and has its parity
//! (variation diminishing), so no change is a proof of no root, one change a proof of exactly one.

/// What is met on the way from 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Event {
    /// A stretch of certain sign: positive or not.
    Clear(bool),
    /// Exactly one root, between stretches of opposite certain signs (told before and after).
    Simple(f64),
    /// A stretch that cannot be told from zero, or of 2^-40.
    Doubt(f64, f64),
}

/// Parts are halved this often before what is left counts as in doubt: 2^-40 of a cell.
const DEPTH: u32 = 40;

/// The sign of a whole cubic, where all coefficients have it for certain.
#[inline(always)]
pub(crate) fn sign(b: [f64; 4], bound: f64) -> Option<bool> {
    // Not by the least and the greatest, which pass over what is not a number.
    let above = (b[0] > bound) & (b[1] > bound) & (b[2] > bound) & (b[3] > bound);
    let below = (b[0] < -bound) & (b[1] < -bound) & (b[2] < -bound) & (b[3] < -bound);
    if above {
        Some(true)
    } else if below {
        Some(false)
    } else {
        None
    }
}

/// Tells `on` what is met on [0, 1], given that each coefficient is off by at most `bound`.
pub(crate) fn scan(b: [f64; 4], bound: f64, on: &mut dyn FnMut(Event)) {
    // What is not a number compares with nothing and would be halved for ever.
    if !b.iter().all(|x| x.is_finite()) || bound.is_nan() {
        on(Event::Doubt(0.0, 1.0));
        return;
    }
    part(b, bound, 0.0, 1.0, DEPTH, on);
}

fn part(b: [f64; 4], bound: f64, lo: f64, hi: f64, depth: u32, on: &mut dyn FnMut(Event)) {
    if let Some(positive) = sign(b, bound) {
        on(Event::Clear(positive));
        return;
    }
    // Both ends clear and opposite, and an inner coefficient on the side that leaves a single change.
    let one = |s: f64| {
        let q = b.map(|x| s * x);
        q[0] > bound && q[3] < -bound && (q[1] > bound || q[2] < -bound)
    };
    if one(1.0) || one(-1.0) {
        on(Event::Clear(b[0] > 0.0));
        on(Event::Simple(lo + refine(b) * (hi - lo)));
        on(Event::Clear(b[3] > 0.0));
        return;
    }
    if depth == 0 || b.iter().all(|x| x.abs() <= bound) {
        on(Event::Doubt(lo, hi));
        return;
    }
    let m = |x: f64, y: f64| 0.5 * (x + y);
    let (p, q, r) = (m(b[0], b[1]), m(b[1], b[2]), m(b[2], b[3]));
    let (s, t) = (m(p, q), m(q, r));
    let mid = m(s, t);
    let half = 0.5 * (lo + hi);
    part([b[0], p, s, mid], bound, lo, half, depth - 1, on);
    part([mid, t, r, b[3]], bound, half, hi, depth - 1, on);
}

/// Value at x by de Casteljau's rule: convex combinations, so the rounding error is at most 6 units of the greatest coefficient.
#[inline(always)]
pub(crate) fn value(b: [f64; 4], x: f64) -> f64 {
    let y = 1.0 - x;
    let (p, q, r) = (y * b[0] + x * b[1], y * b[1] + x * b[2], y * b[2] + x * b[3]);
    y * (y * p + x * q) + x * (y * q + x * r)
}

/// The root of a cubic whose end coefficients differ in sign, by Newton's method kept inside a shrinking bracket.
#[inline(always)]
fn refine(b: [f64; 4]) -> f64 {
    let c1 = 3.0 * (b[1] - b[0]);
    let c2 = 3.0 * ((b[2] - b[1]) - (b[1] - b[0]));
    let c3 = (b[3] - b[0]) - 3.0 * (b[2] - b[1]);
    let negative = b[0] < 0.0;
    let (mut lo, mut hi) = (0.0f64, 1.0f64);
    let mut x = (b[0] / (b[0] - b[3])).clamp(0.0, 1.0);
    for _ in 0..60 {
        let f = b[0] + x * (c1 + x * (c2 + x * c3));
        if (f < 0.0) == negative {
            lo = x;
        } else {
            hi = x;
        }
        let g = c1 + x * (2.0 * c2 + x * (3.0 * c3));
        let newton = x - f / g;
        // NaN and anything outside the bracket fall back to halving it.
        let next = if newton >= lo && newton <= hi {
            newton
        } else {
            0.5 * (lo + hi)
        };
        let done = (next - x).abs() <= 1e-15;
        x = next;
        if done {
            break;
        }
    }
    x
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bernstein coefficients of k (x - r)(x - s)(x - t), by the polar form.
    fn with_roots(r: f64, s: f64, t: f64, k: f64) -> [f64; 4] {
        let polar = |x: f64, y: f64, z: f64| {
            let e = |a: f64, b: f64, c: f64| (x - a) * (y - b) * (z - c);
            k * (e(r, s, t) + e(r, t, s) + e(s, r, t) + e(s, t, r) + e(t, r, s) + e(t, s, r)) / 6.0
        };
        [
            polar(0.0, 0.0, 0.0),
            polar(1.0, 0.0, 0.0),
            polar(1.0, 1.0, 0.0),
            polar(1.0, 1.0, 1.0),
        ]
    }

    /// All that is met, with neighbouring stretches in doubt joined.
    fn events(b: [f64; 4]) -> Vec<Event> {
        let mut out: Vec<Event> = Vec::new();
        scan(b, 1e-15, &mut |e| match (out.last_mut(), e) {
            (Some(Event::Doubt(_, end)), Event::Doubt(from, to)) if *end == from => *end = to,
            (Some(last), e) if *last == e => {}
            _ => out.push(e),
        });
        out
    }

    fn at(b: [f64; 4]) -> Vec<f64> {
        let simple = |e| if let Event::Simple(x) = e { Some(x) } else { None };
        events(b).into_iter().filter_map(simple).collect()
    }

    fn near(a: &[f64], b: &[f64], tolerance: f64) {
        assert!(
            a.len() == b.len() && a.iter().zip(b).all(|(x, y)| (x - y).abs() <= tolerance),
            "{a:?} instead of {b:?}"
        );
    }

    #[test]
    fn what_is_not_a_number_has_no_sign() {
        assert_eq!(sign([1.0, 2.0, 3.0, 4.0], 0.5), Some(true));
        assert_eq!(sign([-1.0, -2.0, -3.0, -4.0], 0.5), Some(false));
        assert_eq!(sign([1.0, 2.0, 3.0, 0.5], 0.5), None);
        for i in 0..4 {
            for v in [1.0, -1.0] {
                let mut b = [v; 4];
                b[i] = f64::NAN;
                assert_eq!(sign(b, 0.5), None);
            }
        }
    }

    #[test]
    fn planted_roots_are_found_in_order() {
        near(&at(with_roots(0.3, 0.6, -1.0, 1.0)), &[0.3, 0.6], 1e-14); // hardcases B2
        near(&at(with_roots(0.1, 0.45, 0.9, -3.0)), &[0.1, 0.45, 0.9], 1e-14);
        near(&at(with_roots(0.5, 2.0, 3.0, 1.0)), &[0.5], 1e-14);
        near(&at(with_roots(-0.5, 2.0, 3.0, 1.0)), &[], 0.0);
        near(&at([1.0, 1.0, -4.0, 5.0]), &[0.343_553_830_433, 0.673_413_701_243], 1e-11); // hardcases A15
    }

    /// One stretch in doubt about `x`, between the given signs, and no root that is certain.
    fn in_doubt(b: [f64; 4], x: f64, width: f64, signs: [bool; 2]) {
        let e = events(b);
        let [Event::Clear(s), Event::Doubt(lo, hi), Event::Clear(t)] = e[..] else {
            panic!("{e:?}");
        };
        assert!(lo <= x && x <= hi && hi - lo < width && [s, t] == signs, "{e:?}");
    }

    #[test]
    fn tangents_and_triple_roots_are_one_stretch_in_doubt() {
        in_doubt(with_roots(0.45, 0.45, -1.0, 1.0), 0.45, 1e-6, [true, true]); // hardcases B3
        in_doubt(with_roots(0.5, 0.5, 0.5, 1.0), 0.5, 1e-4, [false, true]); // hardcases A3
    }

    #[test]
    fn roots_at_the_ends_are_in_doubt_there() {
        let e = events(with_roots(0.0, -1.0, -2.0, 1.0));
        assert!(
            matches!(e[..], [Event::Doubt(0.0, x), Event::Clear(true)] if x < 1e-11),
            "{e:?}"
        );
        let e = events(with_roots(0.25, 1.0, 1.0, 1.0));
        let signs =
            matches!(e[..], [Event::Clear(false), Event::Simple(_), Event::Clear(true), Event::Doubt(x, 1.0)] if x > 1.0 - 1e-6);
        assert!(signs, "{e:?}");
    }

    #[test]
    fn zero_is_in_doubt_from_end_to_end() {
        assert_eq!(events([0.0; 4]), [Event::Doubt(0.0, 1.0)]); // hardcases A16
    }

    #[test]
    fn no_root_is_certain_and_false_alarms_are_not_roots() {
        assert_eq!(events([1.0, 2.0, 3.0, 1.0]), [Event::Clear(true)]);
        // two sign changes, least value 0.1
        assert_eq!(events([1.0, -0.2, -0.2, 1.0]), [Event::Clear(true)]);
    }

    #[test]
    fn values_agree_with_the_power_form() {
        let b = with_roots(0.25, 0.5, 0.75, 2.0);
        for i in 0..=16 {
            let x = f64::from(i) / 16.0;
            assert!((value(b, x) - 2.0 * (x - 0.25) * (x - 0.5) * (x - 0.75)).abs() < 1e-15);
        }
    }
}
