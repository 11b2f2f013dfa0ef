//! From sixteen cells with one root each to brackets: Newton's iteration in f32, and the last digits in f64.

use crate::Real;
use crate::answer::{Root, RootKind, Tolerance};
use crate::cell::eval_error;
use crate::refine::{FAR, HALF_WIDTH, LAST_STEP, NEWTON};
use crate::sharpen::HALF;
use crate::simd::{Double, LANES, Wide};

/// Per lane a cell with exactly one root.
pub(super) struct Isolated<W: Wide, const M: usize> {
    pub(super) b: [W; M],
    pub(super) a: W,
    pub(super) w: W,
    pub(super) error: W,
    pub(super) most: W,
    /// Lanes with such a cell.
    pub(super) root: W::Mask,
}

/// [`crate::refine::Local::newton`], then [`sharpen`], lane by lane: writes the roots of all lanes it decides to `out` and returns the other ones.
/// `input`: the polynomials of the lanes, `input[i][lane]`.
#[inline(always)]
pub(super) fn refine<W: Wide, const M: usize>(
    cell: &Isolated<W, M>,
    input: &[[f32; LANES]; M],
    tolerance: &Tolerance<f32>,
    out: &mut [Root<f32>; LANES],
) -> u16 {
    if !W::any(cell.root) {
        return 0;
    }
    let b = &cell.b;
    let (c, c1) = (f32::binomials(M - 1), f32::binomials(M - 2));
    let (zero, one, degree) = (W::splat(0.0), W::splat(1.0), (M - 1) as f32);
    let mut x = polygon_crossing(b);
    let (mut s, mut d) = (*b, [zero; M]);
    for i in 0..M {
        s[i] = b[i].mul(W::splat(c[i]));
    }
    for i in 0..M - 1 {
        d[i] = b[i + 1].sub(b[i]).mul(W::splat(c1[i] * degree));
    }
    // All zeros where p falls, else the sign bit: xor turns p into one that falls.
    let turn = W::splat(-0.0).where_or(b[M - 1].above(zero), zero);
    let error = cell.error.add(W::splat(eval_error::<f32>(M)).mul(cell.most));
    let half = W::splat(tolerance.width * (HALF_WIDTH as f32)).div(cell.w);
    let last = half.mul(W::splat(LAST_STEP as f32));
    let (mut lo, mut hi, mut slope) = (zero, one, zero);
    let mut active = cell.root;
    for _ in 0..NEWTON {
        let (p, q) = value_and_slope(&s, &d, x);
        let falling = p.xor(turn);
        lo = x.where_or(W::both(active, falling.above(error)), lo);
        hi = x.where_or(W::both(active, zero.sub(error).above(falling)), hi);
        let step = p.div(q);
        let next = x.sub(step);
        let inside = W::both(next.above(lo), hi.above(next));
        let next = next.where_or(inside, lo.add(hi).mul(W::splat(0.5)));
        let step = step.where_or(inside, one);
        slope = q.where_or(active, slope);
        x = next.where_or(active, x);
        active = W::without(active, step.mul(step).up_to(last));
        if !W::any(active) {
            break;
        }
    }
    let reach = half.larger(W::splat(2.0).mul(error).div(slope.abs()));
    let (low, high) = (x.sub(reach).larger(lo), x.add(reach).smaller(hi));
    let (below, above) = (value(&s, low).xor(turn), value(&s, high).xor(turn));
    let ok = W::both(
        W::both(
            W::either(below.above(error), low.equals(lo)),
            W::either(zero.sub(error).above(above), high.equals(hi)),
        ),
        reach.up_to(half.mul(W::splat(FAR as f32))),
    );
    let (a, w) = (cell.a, cell.w);
    let (mut lo, mut hi) = (a.add(w.mul(low)).store(), a.add(w.mul(high)).store());
    let (start, end) = (a.store(), a.add(w).store());
    for l in 0..LANES {
        lo[l] = f32::from_bits(lo[l].to_bits().saturating_sub(1)).larger(start[l]);
        hi[l] = f32::from_bits(hi[l].to_bits().wrapping_add(1)).smaller(end[l]);
    }
    let bracket = [W::load(&lo), W::load(&hi), a.add(w.mul(x))];
    let mut open = W::bits(cell.root) & !W::bits(ok);
    let wide = W::bits(cell.root) & W::bits(bracket[1].sub(bracket[0]).above(W::splat(tolerance.width)));
    let mut t = bracket[2].store();
    if wide != 0 {
        let (sharper, good) = sharpen(input, tolerance, b[M - 1].above(zero), bracket);
        open |= wide & !good;
        let (sharp_lo, sharp_hi, sharp_t) = (sharper[0].store(), sharper[1].store(), sharper[2].store());
        for l in 0..LANES {
            if wide >> l & 1 != 0 {
                (lo[l], hi[l], t[l]) = (sharp_lo[l], sharp_hi[l], sharp_t[l]);
            }
        }
    }
    for l in 0..LANES {
        out[l] = Root {
            lo: lo[l],
            hi: hi[l],
            t: t[l],
            kind: RootKind::Crossing,
        };
    }
    open
}

/// [`crate::sharpen::sharpen`], lane by lane: `[lo, hi, t]`, and the lanes in which one step was enough. `rising`: lanes in which p rises through zero.
#[inline(always)]
fn sharpen<W: Wide, const M: usize>(
    input: &[[f32; LANES]; M],
    tolerance: &Tolerance<f32>,
    rising: W::Mask,
    [lo, hi, t]: [W; 3],
) -> ([W; 3], u16) {
    let (c, c1) = (f64::binomials(M - 1), f64::binomials(M - 2));
    let degree = (M - 1) as f64;
    let zero = W::Double::splat(0.0);
    let (mut s, mut d) = ([[zero; M]; 2], [[zero; M]; 2]);
    let mut most = W::splat(0.0);
    for i in 0..M {
        let row = W::load(&input[i]);
        most = most.larger(row.abs());
        let b = row.widen();
        for h in 0..2 {
            s[h][i] = b[h];
        }
    }
    for h in 0..2 {
        for i in 0..M - 1 {
            d[h][i] = s[h][i + 1].sub(s[h][i]).mul(W::Double::splat(c1[i] * degree));
        }
        for i in 0..M {
            s[h][i] = s[h][i].mul(W::Double::splat(c[i]));
        }
    }
    let mut x = t.widen();
    for h in 0..2 {
        let (p, q) = value_and_slope_double(&s[h], &d[h], x[h]);
        x[h] = x[h].sub(p.div(q));
    }
    let x = W::narrow(x);
    let half = W::splat(HALF * tolerance.width);
    let (low, high) = (x.sub(half).larger(lo), x.add(half).smaller(hi));
    let side = W::splat(1.0).where_or(rising, W::splat(-1.0)).widen();
    let (l, r, most) = (low.widen(), high.widen(), most.widen());
    let (mut below, mut above) = (0, 0);
    for h in 0..2 {
        let error = W::Double::splat(f64::from(tolerance.error)).add(W::Double::splat(eval_error::<f64>(M)).mul(most[h]));
        let (p, q) = (value_double(&s[h], l[h]).mul(side[h]), value_double(&s[h], r[h]).mul(side[h]));
        below |= u16::from(zero.sub(error).above(p)) << (8 * h);
        above |= u16::from(q.above(error)) << (8 * h);
    }
    let inside = W::bits(W::both(x.above(lo), hi.above(x)));
    let good = inside & (below | W::bits(low.equals(lo))) & (above | W::bits(high.equals(hi)));
    ([low, high, x], good)
}

#[inline(always)]
fn value_double<D: Double, const M: usize>(s: &[D; M], x: D) -> D {
    let r = D::splat(1.0).sub(x);
    let (mut p, mut power) = (s[0], D::splat(1.0));
    for row in &s[1..] {
        power = power.mul(x);
        p = p.mul(r).add(row.mul(power));
    }
    p
}

#[inline(always)]
fn value_and_slope_double<D: Double, const M: usize>(s: &[D; M], d: &[D; M], x: D) -> (D, D) {
    let r = D::splat(1.0).sub(x);
    let (mut p, mut q, mut power) = (s[0], d[0], D::splat(1.0));
    for i in 1..M {
        power = power.mul(x);
        p = p.mul(r).add(s[i].mul(power));
        if i + 1 < M {
            q = q.mul(r).add(d[i].mul(power));
        }
    }
    (p, q)
}

/// [`crate::refine::polygon_crossing`], lane by lane.
#[inline(always)]
fn polygon_crossing<W: Wide, const M: usize>(b: &[W; M]) -> W {
    let (mut p, mut q, mut at) = (b[0], b[1], W::splat(0.0));
    for i in 1..M - 1 {
        let other = b[i].xor(b[0]).negative();
        p = p.where_or(other, b[i]);
        q = q.where_or(other, b[i + 1]);
        at = at.where_or(other, W::splat(i as f32));
    }
    at.add(p.div(p.sub(q))).div(W::splat((M - 1) as f32))
}

#[inline(always)]
fn value<W: Wide, const M: usize>(s: &[W; M], x: W) -> W {
    let r = W::splat(1.0).sub(x);
    let (mut p, mut power) = (s[0], W::splat(1.0));
    for row in &s[1..] {
        power = power.mul(x);
        p = p.mul(r).add(row.mul(power));
    }
    p
}

#[inline(always)]
fn value_and_slope<W: Wide, const M: usize>(s: &[W; M], d: &[W; M], x: W) -> (W, W) {
    let r = W::splat(1.0).sub(x);
    let (mut p, mut q, mut power) = (s[0], d[0], W::splat(1.0));
    for i in 1..M {
        power = power.mul(x);
        p = p.mul(r).add(s[i].mul(power));
        if i + 1 < M {
            q = q.mul(r).add(d[i].mul(power));
        }
    }
    (p, q)
}
