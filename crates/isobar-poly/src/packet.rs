//! First roots of sixteen polynomials at a time, f32.
//!
//! The sixteen lanes walk the tree of halvings together: a cell is visited if any lane needs it, and each lane does exactly the arithmetic of
//! the scalar f32 solver in the cells it needs, so results agree with [`crate::first_root`] bit for bit. Then all lanes run
//! Newton's iteration in lockstep. A lane that meets anything but the plain case (a coefficient of uncertain sign, a cell deeper
//! than [`LEVELS`], a failed check) is handed to the scalar solver.
//!
//! The bodies are inlined into functions compiled for AVX-512, AVX2 or the build's base level, chosen at run time.

use crate::answer::{First, Root, RootKind, Tolerance};
use crate::cell::{eval_error, halving_error};
use crate::refine::{FAR, HALF_WIDTH, LAST_STEP, NEWTON};
use crate::simd::{LANES, Plain, Wide};
use crate::{MAX_DEGREE, Real, first_root};

/// Depth to which lanes stay together.
const LEVELS: usize = 12;

/// Coefficients of sixteen polynomials as a packet: `packet[i][lane]` is coefficient i of polynomial `lane`.
#[must_use]
pub fn packet<const M: usize>(polynomials: &[[f32; M]; LANES]) -> [[f32; LANES]; M] {
    std::array::from_fn(|i| std::array::from_fn(|lane| polynomials[lane][i]))
}

/// Instructions used by [`first_roots_at`]. Answers do not depend on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// What the crate was compiled for.
    Base,
    /// AVX2.
    Avx2,
    /// AVX-512 F and DQ.
    Avx512,
}

impl Level {
    /// The best level of this processor.
    #[must_use]
    pub fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512dq") {
                return Self::Avx512;
            }
            if is_x86_feature_detected!("avx2") {
                return Self::Avx2;
            }
        }
        Self::Base
    }
}

/// [`crate::first_root`] for packets of sixteen polynomials with M Bernstein coefficients each (`packets[p][i][lane]`, degree M - 1): the
/// same answers, bit for bit, into `out[p][lane]`. Fastest for many packets per call.
///
/// # Panics
/// If `out` is not as long as `packets`.
pub fn first_roots<const M: usize>(packets: &[[[f32; LANES]; M]], tolerance: &Tolerance<f32>, out: &mut [[First<f32>; LANES]]) {
    first_roots_at(Level::detect(), packets, tolerance, out);
}

/// [`first_roots`] with at most the given level (less where the processor has less): to compare levels.
///
/// # Panics
/// If `out` is not as long as `packets`.
pub fn first_roots_at<const M: usize>(
    level: Level,
    packets: &[[[f32; LANES]; M]],
    tolerance: &Tolerance<f32>,
    out: &mut [[First<f32>; LANES]],
) {
    assert_eq!(packets.len(), out.len(), "one place per packet");
    match level.min(Level::detect()) {
        #[cfg(target_arch = "x86_64")]
        #[expect(unsafe_code, reason = "functions with target features")]
        // SAFETY: `detect` found the features.
        Level::Avx512 => unsafe { many_avx512(packets, tolerance, out) },
        #[cfg(target_arch = "x86_64")]
        #[expect(unsafe_code, reason = "functions with target features")]
        // SAFETY: `detect` found the feature.
        Level::Avx2 => unsafe { many_avx2(packets, tolerance, out) },
        _ => many::<Plain, M>(packets, tolerance, out),
    }
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512dq")]
fn many_avx512<const M: usize>(packets: &[[[f32; LANES]; M]], tolerance: &Tolerance<f32>, out: &mut [[First<f32>; LANES]]) {
    many::<crate::simd::Avx512, M>(packets, tolerance, out);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn many_avx2<const M: usize>(packets: &[[[f32; LANES]; M]], tolerance: &Tolerance<f32>, out: &mut [[First<f32>; LANES]]) {
    many::<crate::simd::Avx2, M>(packets, tolerance, out);
}

/// The right half of a cell, waiting until the left one is done.
#[derive(Clone, Copy)]
struct Waiting<W: Wide, const M: usize> {
    b: [W; M],
    error: W,
    need: W::Mask,
    a: f32,
    full: bool,
}

#[inline(always)]
fn many<W: Wide, const M: usize>(packets: &[[[f32; LANES]; M]], tolerance: &Tolerance<f32>, out: &mut [[First<f32>; LANES]]) {
    let plain = (2..=MAX_DEGREE + 1).contains(&M)
        && tolerance.error >= 0.0
        && tolerance.error.is_finite()
        && tolerance.splits >= Tolerance::<f32>::SPLITS;
    let zero = W::splat(0.0);
    let none = Waiting {
        b: [zero; M],
        error: zero,
        need: W::none(),
        a: 0.0,
        full: false,
    };
    let mut stack = [none; LEVELS];
    for (input, out) in packets.iter().zip(out) {
        let scalar = if plain {
            let mut b = [zero; M];
            for (wide, row) in b.iter_mut().zip(input) {
                *wide = W::load(row);
            }
            let found = isolate(b, tolerance, &mut stack);
            refine(&found, tolerance, out)
        } else {
            u16::MAX
        };
        if scalar != 0 {
            rest(input, tolerance, scalar, out);
        }
    }
}

/// The scalar solver for the lanes in `which`.
#[cold]
#[inline(never)]
fn rest<const M: usize>(input: &[[f32; LANES]; M], tolerance: &Tolerance<f32>, which: u16, out: &mut [First<f32>; LANES]) {
    for (lane, out) in out.iter_mut().enumerate() {
        if which >> lane & 1 != 0 {
            let one: [f32; M] = std::array::from_fn(|i| input[i][lane]);
            *out = first_root(&one, tolerance);
        }
    }
}

/// Per lane: the first cell with exactly one root.
struct Isolated<W: Wide, const M: usize> {
    b: [W; M],
    a: W,
    w: W,
    error: W,
    most: W,
    /// Lanes with such a cell.
    root: W::Mask,
    /// Lanes that need the scalar solver.
    scalar: W::Mask,
}

/// Walks the tree of halvings, depth first, left first.
#[inline(always)]
fn isolate<W: Wide, const M: usize>(
    mut b: [W; M],
    tolerance: &Tolerance<f32>,
    stack: &mut [Waiting<W, M>; LEVELS],
) -> Isolated<W, M> {
    let zero = W::splat(0.0);
    let all = zero.equals(zero);
    let grow = W::splat(halving_error::<f32>(M));
    let mut need = plain_lanes(&b);
    let mut found = Isolated {
        b,
        a: zero,
        w: W::splat(1.0),
        error: zero,
        most: zero,
        root: W::none(),
        scalar: W::without(all, need),
    };
    let mut error = W::splat(tolerance.error);
    let (mut a, mut w, mut level) = (0.0, 1.0, 0);
    // Lanes still searching.
    let mut alive = need;
    loop {
        let (most, least, changes) = scan(&b);
        let sure = W::both(need, least.above(error));
        let unsure = W::without(need, sure);
        let changing = W::both(sure, changes.0);
        let mut halved = W::both(sure, changes.1);
        let one = W::without(changing, halved);
        if W::any(one) {
            for (kept, new) in found.b.iter_mut().zip(b) {
                *kept = new.where_or(one, *kept);
            }
            found.a = W::splat(a).where_or(one, found.a);
            found.w = W::splat(w).where_or(one, found.w);
            found.error = error.where_or(one, found.error);
            found.most = most.where_or(one, found.most);
            found.root = W::either(found.root, one);
            alive = W::without(alive, one);
        }
        if level == LEVELS {
            found.scalar = W::either(found.scalar, halved);
            alive = W::without(alive, halved);
            halved = W::none();
        }
        found.scalar = W::either(found.scalar, unsure);
        alive = W::without(alive, unsure);
        if W::any(halved) {
            let wait = &mut stack[level];
            halve(&mut b, &mut wait.b);
            error = error.add(grow.mul(most));
            w *= 0.5;
            level += 1;
            (wait.error, wait.need, wait.a, wait.full) = (error, halved, a + w, true);
            need = halved;
            continue;
        }
        // Up to the nearest waiting sibling that a searching lane needs.
        loop {
            if level == 0 {
                return found;
            }
            let wait = &mut stack[level - 1];
            if wait.full {
                wait.full = false;
                need = W::both(wait.need, alive);
                if W::any(need) {
                    (b, error, a) = (wait.b, wait.error, wait.a);
                    break;
                }
            }
            level -= 1;
            w *= 2.0;
        }
    }
}

/// Lanes whose coefficients are finite and need no scaling.
#[inline(always)]
fn plain_lanes<W: Wide, const M: usize>(b: &[W; M]) -> W::Mask {
    let (mut ok, mut most) = (b[0].equals(b[0]), W::splat(0.0));
    for row in b {
        // False for NaN.
        ok = W::both(ok, row.abs().up_to(W::splat(f32::LARGE)));
        most = most.larger(row.abs());
    }
    W::both(ok, W::splat(f32::SMALL).up_to(most))
}

/// [`crate::cell::signs`], lane by lane: largest and smallest size; lanes with a sign change, lanes with more than one.
#[inline(always)]
fn scan<W: Wide, const M: usize>(b: &[W; M]) -> (W, W, (W::Mask, W::Mask)) {
    let mut most = b[0].abs();
    let mut least = most;
    let (mut once, mut twice) = (W::splat(0.0), W::splat(0.0));
    for i in 1..M {
        let size = b[i].abs();
        most = most.larger(size);
        least = least.smaller(size);
        // Only the sign bits of these matter.
        let change = b[i].xor(b[i - 1]);
        twice = twice.or(once.and(change));
        once = once.or(change);
    }
    (most, least, (once.negative(), twice.negative()))
}

/// Repeats a block for constant values of an index. The compiler does not unroll these loops by itself, and then keeps the
/// coefficients in memory instead of in registers (1.4 times slower).
macro_rules! unroll {
    ($i:ident in $($k:literal)* => $body:block) => { $({ const $i: usize = $k; $body })* };
}

/// [`crate::cell::halve`], lane by lane: `b` becomes the left half.
#[inline(always)]
fn halve<W: Wide, const M: usize>(b: &mut [W; M], right: &mut [W; M]) {
    let mut s = *b;
    right[M - 1] = s[M - 1];
    if M > 10 {
        for k in 1..M {
            for i in 0..M - k {
                s[i] = s[i].add(s[i + 1]);
            }
            let scale = W::splat(f32::half_power(k as u32));
            b[k] = s[0].mul(scale);
            right[M - 1 - k] = s[M - 1 - k].mul(scale);
        }
        return;
    }
    unroll!(K in 1 2 3 4 5 6 7 8 9 => {
        if K < M {
            unroll!(I in 0 1 2 3 4 5 6 7 8 => {
                if I + K < M {
                    s[I] = s[I].add(s[I + 1]);
                }
            });
            let scale = W::splat(f32::half_power(K as u32));
            b[K] = s[0].mul(scale);
            right[M - 1 - K] = s[M - 1 - K].mul(scale);
        }
    });
}

/// [`crate::refine::Local::newton`], lane by lane; writes the answers of all lanes it decides and returns the others.
#[inline(always)]
fn refine<W: Wide, const M: usize>(cell: &Isolated<W, M>, tolerance: &Tolerance<f32>, out: &mut [First<f32>; LANES]) -> u16 {
    *out = [First::None; LANES];
    if !W::any(cell.root) {
        return W::bits(cell.scalar);
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
    let (lo, hi) = (a.add(w.mul(low)).store(), a.add(w.mul(high)).store());
    let (t, a, end) = (a.add(w.mul(x)).store(), a.store(), a.add(w).store());
    let root = W::bits(cell.root);
    for l in 0..LANES {
        if root >> l & 1 != 0 {
            out[l] = First::Root(Root {
                lo: f32::from_bits(lo[l].to_bits().saturating_sub(1)).larger(a[l]),
                hi: f32::from_bits(hi[l].to_bits() + 1).smaller(end[l]),
                t: t[l],
                kind: RootKind::Crossing,
            });
        }
    }
    W::bits(cell.scalar) | (root & !W::bits(ok))
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
