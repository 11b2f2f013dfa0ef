//! Roots of eight cubics at a time, with their proofs.

use super::lanes::Lanes;

/// Lanes in which a cubic has exactly one root in [0, 1] and none near the ends for certain: its Bernstein coefficients, each off by at most `bound`, are clear of zero at
/// the ends, with opposite signs, and an inner one is clear on the side that leaves a single change. `minus`: -bound.
#[inline(always)]
pub fn only_roots<S: Lanes>(q: &[S; 4], bound: S, minus: S) -> u8 {
    let (above, below) = (
        [q[0].above(bound), q[1].above(bound), q[2].above(bound), q[3].above(bound)],
        [minus.above(q[0]), minus.above(q[1]), minus.above(q[2]), minus.above(q[3])],
    );
    (above[0] & below[3] & (above[1] | below[2])) | (below[0] & above[3] & (below[1] | above[2]))
}

/// Power coefficients of a cubic in Bernstein form.
#[inline(always)]
fn powers<S: Lanes>(q: &[S; 4]) -> [S; 4] {
    let three = S::splat(3.0);
    [
        q[0],
        three.mul(q[1].sub(q[0])),
        three.mul(q[2].sub(q[1]).sub(q[1].sub(q[0]))),
        q[3].sub(q[0]).sub(three.mul(q[2].sub(q[1]))),
    ]
}

#[inline(always)]
fn value<S: Lanes>(c: &[S; 4], x: S) -> S {
    c[0].add(x.mul(c[1].add(x.mul(c[2].add(x.mul(c[3]))))))
}

#[inline(always)]
fn slope<S: Lanes>(c: &[S; 4], x: S) -> S {
    c[1].add(x.mul(c[2].add(c[2]).add(x.mul(S::splat(3.0).mul(c[3])))))
}

#[inline(always)]
fn mix<S: Lanes>(p: S, q: S, x: S, y: S) -> S {
    y.mul(p).add(x.mul(q))
}

/// The value by de Casteljau's rule, for proofs.
#[inline(always)]
fn bernstein<S: Lanes>(q: &[S; 4], x: S) -> S {
    let y = S::splat(1.0).sub(x);
    let (a, b, c) = (mix(q[0], q[1], x, y), mix(q[1], q[2], x, y), mix(q[2], q[3], x, y));
    mix(mix(a, b, x, y), mix(b, c, x, y), x, y)
}

/// Roots of cubics that have one in [0, 1] each, by Newton's method in a shrinking bracket.
///
/// `q`: Bernstein coefficients between the parameters `ends`, each off by at most `bound`, evaluation included. `known`: the root in [0, 1], which lies within `reach` of it,
/// or below 0 where there is none but that. Only the lanes `todo` mean anything. Gives t, and the distance from t within which the cubic has opposite signs
/// beyond the bound on both sides; infinite where that was not found, or not asked for by `prove`.
#[inline(always)]
pub fn cubic_roots<S: Lanes>(q: &[S; 4], [known, reach]: [S; 2], [t0, t1]: [S; 2], bound: S, todo: u8, prove: bool) -> [S; 2] {
    let (zero, one, half) = (S::splat(0.0), S::splat(1.0), S::splat(0.5));
    let c = powers(q);
    let negative = zero.above(q[0]);
    let near = !zero.above(known);
    let mut lo = known.sub(reach).max(zero).where_or(near, zero);
    let mut hi = known.add(reach).min(one).where_or(near, one);
    let chord = q[0].div(q[0].sub(q[3])).max(zero).min(one);
    let mut x = known.where_or(near, chord);
    // The sign at the lower end of a bracket: of several roots every other one has that of the other end.
    let falls = negative & !near | zero.above(bernstein(q, lo)) & near;
    let mut open = todo;
    for _ in 0..60 {
        if open == 0 {
            break;
        }
        let f = value(&c, x);
        let left = !(zero.above(f) ^ falls);
        lo = x.where_or(left, lo);
        hi = x.where_or(!left, hi);
        let newton = x.sub(f.div(slope(&c, x)));
        // The last comparison fails for NaN, which passes the first two.
        let inside = !lo.above(newton) & !newton.above(hi) & newton.above(S::splat(-1.0));
        let next = newton.where_or(inside, half.mul(lo.add(hi)));
        let far = next.sub(x).abs().above(S::splat(1e-14));
        x = next.where_or(open, x);
        open &= far;
    }
    let length = t1.sub(t0);
    let t = t0.add(x.mul(length));
    let mut error = S::splat(f64::INFINITY);
    if !prove {
        return [t, error];
    }
    // Opposite signs beyond the bound on both sides, at parameters that exist as f64.
    let (mut todo, minus) = (todo, zero.sub(bound));
    // Twice the distance at which the tangent leaves the bound; then wider.
    let mut width = bound
        .add(bound)
        .div(slope(&c, x).abs())
        .max(S::splat(1e-14))
        .max(reach.add(reach));
    for _ in 0..4 {
        let (a, z) = (x.sub(width).max(zero), x.add(width).min(one));
        let (f, g) = (bernstein(q, a), bernstein(q, z));
        let up = minus.above(f) & g.above(bound);
        let down = f.above(bound) & minus.above(g);
        let proved = todo & (up | down) & S::splat(1e-3).above(width);
        let span = x.sub(a).max(z.sub(x)).mul(length);
        // t itself, and the two ends, are rounded.
        let e = span.add(S::splat(8.0 * f64::EPSILON).mul(t1.abs()));
        error = e.where_or(proved, error);
        todo &= !proved;
        if todo == 0 {
            break;
        }
        width = width.mul(S::splat(16.0));
    }
    [t, error]
}

#[cfg(test)]
mod tests {
    use super::super::lanes::{LANES, Plain};
    use super::*;

    fn lanes(v: [f64; LANES]) -> Plain {
        Plain::load(&v)
    }

    fn store(v: Plain) -> [f64; LANES] {
        let mut to = [0.0; LANES];
        v.store(&mut to);
        to
    }

    /// Bernstein coefficients of (x - r) (x - s) (x - t), by the polar form.
    fn with_roots(r: f64, s: f64, t: f64) -> [f64; 4] {
        let polar = |x: f64, y: f64, z: f64| {
            let e = |a: f64, b: f64, c: f64| (x - a) * (y - b) * (z - c);
            (e(r, s, t) + e(r, t, s) + e(s, r, t) + e(s, t, r) + e(t, r, s) + e(t, s, r)) / 6.0
        };
        [
            polar(0.0, 0.0, 0.0),
            polar(1.0, 0.0, 0.0),
            polar(1.0, 1.0, 0.0),
            polar(1.0, 1.0, 1.0),
        ]
    }

    /// The only root, and each of three that are known to within a few digits.
    #[test]
    fn roots_are_found_and_proved() {
        let want = [0.5, 0.1, 0.45, 0.9, 0.001, 0.999, 0.3, 0.7];
        let others = [
            [-3.0, 4.0],
            [0.45, 0.9],
            [0.1, 0.9],
            [0.1, 0.45],
            [2.0, 5.0],
            [-1.0, 3.0],
            [1.5, 2.0],
            [-0.5, -2.0],
        ];
        let known = [-1.0, 0.10005, 0.44995, 0.90005, -1.0, -1.0, -1.0, -1.0];
        let mut q = [[0.0; LANES]; 4];
        for l in 0..LANES {
            let b = with_roots(want[l], others[l][0], others[l][1]);
            for i in 0..4 {
                q[i][l] = b[i];
            }
        }
        let q = q.map(lanes);
        let single = only_roots(&q, Plain::splat(1e-12), Plain::splat(-1e-12));
        assert_eq!(single, 0b1111_0001);
        let known = [lanes(known), lanes(known.map(|x| if x < 0.0 { 0.0 } else { 1e-4 }))];
        let ends = [Plain::splat(2.0), Plain::splat(4.0)];
        let [t, error] = cubic_roots(&q, known, ends, Plain::splat(1e-13), u8::MAX, true);
        for (l, (t, e)) in store(t).into_iter().zip(store(error)).enumerate() {
            let off = (t - 2.0 - 2.0 * want[l]).abs();
            assert!(off < 1e-13 && off <= e, "lane {l}: {t}, {e}");
            assert!(e < if (1..4).contains(&l) { 1e-2 } else { 1e-10 }, "lane {l}: {e}");
        }
        // A bound that hides the signs proves nothing.
        let [_, error] = cubic_roots(&q, known, ends, Plain::splat(10.0), u8::MAX, true);
        assert_eq!(store(error), [f64::INFINITY; LANES]);
    }
}
