//! The walk of sixteen lanes through the tree of halvings.

use super::LEVELS;
use crate::Real;
use crate::answer::Tolerance;
use crate::cell::halving_error;
use crate::simd::Wide;

/// A cell [a, a + w] of the tree with the coefficients of all lanes.
pub(super) struct Cell<W: Wide, const M: usize> {
    pub(super) b: [W; M],
    pub(super) a: f32,
    pub(super) w: f32,
    /// Error of a coefficient, per lane.
    pub(super) error: W,
    /// Greatest |coefficient|, per lane.
    pub(super) most: W,
}

/// What is done with cells that hold exactly one root.
pub(super) trait Keep<W: Wide, const M: usize> {
    /// A lane's search ends at its first such cell.
    const FIRST: bool;

    /// Takes the cell for the given lanes. Cells of one lane come in ascending order.
    fn keep(&mut self, cell: &Cell<W, M>, lanes: W::Mask);
}

/// The right half of a cell, waiting until the left one is done.
#[derive(Clone, Copy)]
pub(super) struct Waiting<W: Wide, const M: usize> {
    b: [W; M],
    error: W,
    need: W::Mask,
    a: f32,
    full: bool,
}

/// Room for the right halves of one way down.
pub(super) type Stack<W, const M: usize> = [Waiting<W, M>; LEVELS];

/// An empty stack.
#[inline(always)]
pub(super) fn stack<W: Wide, const M: usize>() -> Stack<W, M> {
    let zero = W::splat(0.0);
    [Waiting {
        b: [zero; M],
        error: zero,
        need: W::none(),
        a: 0.0,
        full: false,
    }; LEVELS]
}

/// Walks the tree of halvings, depth first, left first. Gives the lanes that need the scalar solver; what was kept of them does not count.
#[inline(always)]
pub(super) fn isolate<W: Wide, const M: usize, K: Keep<W, M>>(
    b: [W; M],
    tolerance: &Tolerance<f32>,
    stack: &mut Stack<W, M>,
    keep: &mut K,
) -> W::Mask {
    let zero = W::splat(0.0);
    let all = zero.equals(zero);
    let grow = W::splat(halving_error::<f32>(M));
    let mut need = plain_lanes(&b);
    let mut scalar = W::without(all, need);
    let mut cell = Cell {
        b,
        a: 0.0,
        w: 1.0,
        error: W::splat(tolerance.error),
        most: zero,
    };
    let mut level = 0;
    // Lanes still searching.
    let mut alive = need;
    loop {
        let (most, least, changes) = scan(&cell.b);
        cell.most = most;
        let sure = W::both(need, least.above(cell.error));
        let unsure = W::without(need, sure);
        let changing = W::both(sure, changes.0);
        let mut halved = W::both(sure, changes.1);
        let one = W::without(changing, halved);
        if W::any(one) {
            keep.keep(&cell, one);
            if K::FIRST {
                alive = W::without(alive, one);
            }
        }
        if level == LEVELS {
            scalar = W::either(scalar, halved);
            alive = W::without(alive, halved);
            halved = W::none();
        }
        scalar = W::either(scalar, unsure);
        alive = W::without(alive, unsure);
        if W::any(halved) {
            let wait = &mut stack[level];
            halve(&mut cell.b, &mut wait.b);
            cell.error = cell.error.add(grow.mul(most));
            cell.w *= 0.5;
            level += 1;
            (wait.error, wait.need, wait.a, wait.full) = (cell.error, halved, cell.a + cell.w, true);
            need = halved;
            continue;
        }
        // Up to the nearest waiting sibling that a searching lane needs.
        loop {
            if level == 0 {
                return scalar;
            }
            let wait = &mut stack[level - 1];
            if wait.full {
                wait.full = false;
                need = W::both(wait.need, alive);
                if W::any(need) {
                    (cell.b, cell.error, cell.a) = (wait.b, wait.error, wait.a);
                    break;
                }
            }
            level -= 1;
            cell.w *= 2.0;
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
