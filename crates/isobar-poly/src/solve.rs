//! The scalar solver: depth-first, left-first halving until Descartes' rule decides, then refinement.

use crate::answer::{Collect, First, Root, RootKind, Roots, Tolerance};
use crate::cell::{Signs, count, halve, halving_error, signs};
use crate::refine::{HALF_WIDTH, Local, polygon_crossing};
use crate::{MAX_DEGREE, Real};

/// The first root of `p(t) = sum b[i] C(n,i) t^i (1-t)^(n-i)` in [0, 1]; see the crate documentation for what is proved.
///
/// `b`: 1 to [`MAX_DEGREE`] + 1 finite coefficients. Allocates nothing.
#[must_use]
pub fn first_root<T: Real>(b: &[T], tolerance: &Tolerance<T>) -> First<T> {
    let mut found = None;
    match search(b, tolerance, &mut found) {
        Flow::GaveUp(at) => First::GaveUp { at },
        Flow::Done | Flow::On => found.map_or(First::None, First::Root),
    }
}

/// All roots of p in [0, 1], ascending; the same search as [`first_root`], continued.
#[must_use]
pub fn all_roots<T: Real>(b: &[T], tolerance: &Tolerance<T>) -> Roots<T> {
    let mut found = Roots::new();
    if let Flow::GaveUp(at) = search(b, tolerance, &mut found) {
        found.give_up(at);
    }
    found
}

/// How the walk goes on after a cell.
#[derive(Clone, Copy, PartialEq)]
enum Flow<T> {
    On,
    Done,
    GaveUp(T),
}

/// Picks the instance whose number of coefficients the compiler knows (degrees 1 to 9), or the general one.
fn search<T: Real, C: Collect<T>>(b: &[T], tolerance: &Tolerance<T>, out: &mut C) -> Flow<T> {
    macro_rules! pick {
        ($($m:literal)*) => {
            match b.len() {
                $($m => run::<T, C, $m, false>(b, tolerance, out),)*
                1 | 11..=28 => run::<T, C, { MAX_DEGREE + 1 }, true>(b, tolerance, out),
                _ => Flow::GaveUp(T::ZERO),
            }
        };
    }
    pick!(2 3 4 5 6 7 8 9 10)
}

/// Checks and scales the coefficients, then walks.
#[inline(always)]
fn run<T: Real, C: Collect<T>, const CAP: usize, const DYN: bool>(b: &[T], tolerance: &Tolerance<T>, out: &mut C) -> Flow<T> {
    let m = count::<CAP, DYN>(b.len());
    let mut cell = [T::ZERO; CAP];
    cell[..m].copy_from_slice(&b[..m]);
    let mut error = tolerance.error;
    let finite = cell[..m].iter().fold(error.is_finite(), |all, x| all & x.is_finite());
    if !finite || error < T::ZERO {
        return Flow::GaveUp(T::ZERO);
    }
    let mut scan = signs(&cell[..m]);
    if scan.most <= error {
        let root = Root {
            lo: T::ZERO,
            hi: T::ONE,
            t: T::ZERO,
            kind: RootKind::Interval,
        };
        out.take(root);
        return Flow::Done;
    }
    if !(scan.most >= T::SMALL && scan.most <= T::LARGE) {
        rescale(&mut cell[..m], &mut error);
        scan = signs(&cell[..m]);
    }
    let certain = |x: T| if x.abs() <= error { 0 } else { 1 - 2 * x.sign_bit() as i8 };
    let (first, last) = (cell[0], cell[m - 1]);
    let mut walk = Walk::<T, C, CAP, DYN> {
        out,
        whole: &cell,
        error,
        m,
        width: tolerance.width,
        splits: tolerance.splits,
        sign: certain(first),
        pending: None,
        zero_ends: [first == T::ZERO && error == T::ZERO, last == T::ZERO && error == T::ZERO],
    };
    let flow = walk.visit(&cell, T::ZERO, T::ONE, error, scan);
    match flow {
        Flow::On if walk.flush(certain(last)) => Flow::Done,
        // What is pending where the search ended is not known to be anything.
        Flow::GaveUp(at) => Flow::GaveUp(walk.pending.map_or(at, |p| p.lo)),
        _ => flow,
    }
}

/// Brings the largest coefficient into [SMALL, LARGE] by exact powers of two.
#[cold]
fn rescale<T: Real>(b: &mut [T], error: &mut T) {
    let most = |b: &[T]| signs(b).most;
    while most(b) < T::SMALL {
        b.iter_mut().for_each(|x| *x *= T::SCALE);
        *error *= T::SCALE;
    }
    while most(b) > T::LARGE {
        b.iter_mut().for_each(|x| *x = *x / T::SCALE);
        // Small coefficients may have underflowed.
        *error = *error / T::SCALE + T::TINY;
    }
}

/// A stretch of [0, 1] on which p cannot be told from zero.
#[derive(Clone, Copy)]
struct Region<T> {
    lo: T,
    hi: T,
    /// Certain sign on its left: -1, 1, or 0 where it starts at t = 0 with an uncertain coefficient.
    before: i8,
}

struct Walk<'a, T, C, const CAP: usize, const DYN: bool> {
    out: &'a mut C,
    /// Coefficients over [0, 1], each wrong by at most `error`.
    whole: &'a [T; CAP],
    error: T,
    m: usize,
    width: T,
    splits: u32,
    /// Sign of p left of the cells still to come.
    sign: i8,
    /// Region that ends where those begin.
    pending: Option<Region<T>>,
    /// Whether p(0), p(1) are exactly zero.
    zero_ends: [bool; 2],
}

impl<T: Real, C: Collect<T>, const CAP: usize, const DYN: bool> Walk<'_, T, C, CAP, DYN> {
    /// The cell [a, a + w] with coefficients `b`, each wrong by at most `error`.
    fn visit(&mut self, b: &[T; CAP], a: T, w: T, error: T, scan: Signs<T>) -> Flow<T> {
        let m = count::<CAP, DYN>(self.m);
        if scan.least > error {
            if scan.changes == 0 {
                return self.certain(1 - 2 * b[0].sign_bit() as i8);
            }
            if scan.changes == 1 {
                return self.isolated(b, a, w, error, scan.most);
            }
        } else if let Some(flow) = self.uncertain(b, a, w, error, scan) {
            return flow;
        }
        if self.splits == 0 {
            return Flow::GaveUp(a);
        }
        self.splits -= 1;
        let (left, right) = halve::<T, CAP>(b, m);
        let (w, error) = (w * T::HALF, error + halving_error::<T>(m) * scan.most);
        match self.visit(&left, a, w, error, signs(&left[..m])) {
            Flow::On => self.visit(&right, a + w, w, error, signs(&right[..m])),
            flow => flow,
        }
    }

    /// p has the certain sign `sign` on the next stretch.
    #[inline(always)]
    fn certain(&mut self, sign: i8) -> Flow<T> {
        if self.pending.is_some() && self.flush(sign) {
            return Flow::Done;
        }
        self.sign = sign;
        Flow::On
    }

    /// Exactly one simple root in the cell, end coefficients certain.
    #[inline(always)]
    fn isolated(&mut self, b: &[T; CAP], a: T, w: T, error: T, most: T) -> Flow<T> {
        let m = count::<CAP, DYN>(self.m);
        if self.pending.is_some() && self.flush(1 - 2 * b[0].sign_bit() as i8) {
            return Flow::Done;
        }
        let local = Local::new(b, m, error, most);
        let half = self.width * T::from_f64(HALF_WIDTH) / w;
        let x = match local.newton(polygon_crossing(&b[..m]), half) {
            Some(x) => x,
            None => local.bisect(T::ZERO, T::ONE, half),
        };
        self.sign = 1 - 2 * b[m - 1].sign_bit() as i8;
        let (lo, hi) = outward(a, w, x.lo, x.hi);
        let mut bracket = [lo, hi, a + w * x.x];
        if hi - lo > self.width {
            bracket = T::sharpen(self.whole, m, self.error, self.width, b[m - 1] > T::ZERO, bracket);
        }
        let [lo, hi, t] = bracket;
        let root = Root {
            lo,
            hi,
            t,
            kind: RootKind::Crossing,
        };
        if self.out.take(root) { Flow::Done } else { Flow::On }
    }

    /// A cell in which some coefficient's sign is not certain; `None` if it has to be halved.
    #[cold]
    #[inline(never)]
    fn uncertain(&mut self, b: &[T; CAP], a: T, w: T, error: T, scan: Signs<T>) -> Option<Flow<T>> {
        let m = count::<CAP, DYN>(self.m);
        let b = &b[..m];
        let sure = |x: T| x.abs() > error;
        // Nothing is certain any more, or the cell is as narrow as asked for (or as numbers can be).
        let narrowest = T::from_f64(8.0) * T::ROUNDOFF;
        if scan.most <= error || w <= self.width.larger(narrowest) {
            self.region(a, a + w);
            return Some(Flow::On);
        }
        // Only end coefficients are uncertain, all others have one sign: p vanishes at most close to the uncertain ends. Let k be the
        // least size of the others and x the distance from one end. The true coefficients are at least k - e, and -2e at an uncertain
        // end, so with one such end |p| >= (k - e)(1 - x^n) - 2e x^n > 0 for x < 1 - 2e/(k + e). With two, n >= 2 and
        // (1-x)^n + x^n <= 1 - 2x(1-x), so |p| > 0 where x(1-x) > e/(k + e): for x in [r, 1-r] if r <= 1/4 and r >= 2e/(k + e).
        let sign = b.iter().find(|x| sure(**x))?.sign_bit();
        let one_sign = b.iter().all(|&x| !sure(x) || x.sign_bit() == sign) && b[1..m - 1].iter().all(|&x| sure(x));
        if !one_sign {
            return None;
        }
        let least = b.iter().filter(|x| sure(**x)).fold(scan.most, |k, &x| k.smaller(x.abs()));
        let reach = T::from_f64(2.0) * error / (least + error) * (T::ONE + T::from_f64(8.0) * T::ROUNDOFF);
        if reach * w > self.width || reach > T::from_f64(0.25) {
            return None;
        }
        let (left_end, right_start) = match reach > T::ZERO {
            true => (outward(a, w, T::ZERO, reach).1, outward(a, w, T::ONE - reach, T::ONE).0),
            false => (a, a + w),
        };
        if !sure(b[0]) {
            self.region(a, left_end);
        }
        let flow = self.certain(1 - 2 * sign as i8);
        if flow == Flow::On && !sure(b[m - 1]) {
            self.region(right_start, a + w);
        }
        Some(flow)
    }

    /// p cannot be told from zero on [lo, hi], which starts where everything before ended.
    fn region(&mut self, lo: T, hi: T) {
        match &mut self.pending {
            Some(p) => p.hi = hi,
            None => {
                self.pending = Some(Region {
                    lo,
                    hi,
                    before: self.sign,
                });
            }
        }
    }

    /// Turns the pending region into a root, `after` being the certain sign on its right (0: it ends at t = 1). True if the search may end.
    #[cold]
    #[inline(never)]
    fn flush(&mut self, after: i8) -> bool {
        let Some(p) = self.pending.take() else { return false };
        let (kind, t) = if p.lo == T::ZERO && self.zero_ends[0] {
            (RootKind::End, T::ZERO)
        } else if p.hi == T::ONE && self.zero_ends[1] {
            (RootKind::End, T::ONE)
        } else {
            let crossing = p.before * after < 0;
            let kind = if crossing { RootKind::Crossing } else { RootKind::Touching };
            (kind, p.lo + (p.hi - p.lo) * T::HALF)
        };
        self.out.take(Root {
            lo: p.lo,
            hi: p.hi,
            t,
            kind,
        })
    }
}

/// The cell's local bracket [lo, hi] in t, rounded outward and cut by [0, 1] and the cell. `a`, `w` are dyadic, `w` times anything is exact.
#[inline(always)]
fn outward<T: Real>(a: T, w: T, lo: T, hi: T) -> (T, T) {
    ((a + w * lo).below().larger(a), (a + w * hi).above().smaller(a + w))
}
