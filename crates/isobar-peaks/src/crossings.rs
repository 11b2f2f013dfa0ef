//! Every crossing of a value along a ray, from the polynomials of the cells it passes.
//!
//! The paper isolates crossings by the rule of signs between two samples (Knoll et al. 2009, section 4.2) and so loses pairs of them. Here the polynomial in a
//! cell is known with a bound on its coefficients (`volume.rs`), and isobar-poly's finder gives all its roots, with proofs.
//!
//! What is left is where the polynomial of a cell cannot be told from zero at the cell's ends: a crossing on a face, an edge or a vertex, a
//! plateau. Such a stretch is kept until the sign is certain again, in whichever cell that is, and is one crossing then: proved between opposite signs, not proved (it
//! touches, or the ray ends) otherwise. The sign between two roots of one cell follows from the signs at its ends, since a proved crossing turns it
//! and a touching point leaves it.

use isobar_poly::{First, Root, RootKind, Tolerance, all_roots, bernstein, first_root};

/// A crossing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Crossing {
    pub(crate) t: f64,
    /// Index of the value.
    pub(crate) value: usize,
    /// A root is proved to lie within this of t; +inf where none is proved.
    pub(crate) error: f64,
}

/// A stretch in doubt that has not ended yet.
#[derive(Debug, Clone, Copy)]
struct Doubt {
    from: f64,
    to: f64,
    /// The certain sign before it, or 0.
    before: i8,
}

/// What is known of one value along a ray.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Track {
    /// The last certain sign, 0 where there is none.
    sign: i8,
    doubt: Option<Doubt>,
}

/// The part of a ray in a cell.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Stretch {
    pub(crate) t0: f64,
    pub(crate) t1: f64,
    /// Stretches in doubt up to this long are one point.
    pub(crate) short: f64,
    /// Roots are to be proved.
    pub(crate) prove: bool,
}

impl Stretch {
    #[inline(always)]
    fn t(&self, x: f64) -> f64 {
        if x == 1.0 {
            self.t1
        } else {
            self.t0 + x * (self.t1 - self.t0)
        }
    }
}

/// Wanted width of a bracket, in cells.
const WIDTH: f64 = 1e-11;

#[inline(always)]
fn sign(x: f64, bound: f64) -> i8 {
    i8::from(x > bound) - i8::from(x < -bound)
}

impl Track {
    /// The polynomial has this sign on all of the next cell.
    #[inline(always)]
    pub(crate) fn clear(&mut self, sign: i8, value: usize, short: f64, out: &mut Vec<Crossing>) {
        if self.doubt.is_some() {
            self.close(sign, value, short, out);
        }
        self.sign = sign;
    }

    /// The same where nothing is in doubt.
    #[inline(always)]
    pub(crate) const fn stays(&mut self, sign: i8) {
        self.sign = sign;
    }

    /// Nothing is known any more: a gap in the ray, or its end.
    pub(crate) fn end(&mut self, value: usize, short: f64, out: &mut Vec<Crossing>) {
        self.close(0, value, short, out);
        self.sign = 0;
    }

    /// Where what is in doubt begins; +inf where nothing is.
    pub(crate) fn doubted_from(&self) -> f64 {
        self.doubt.map_or(f64::INFINITY, |d| d.from)
    }

    /// Whether a stretch is in doubt.
    #[inline(always)]
    pub(crate) const fn is_open(&self) -> bool {
        self.doubt.is_some()
    }

    #[cold]
    #[inline(never)]
    fn close(&mut self, after: i8, value: usize, short: f64, out: &mut Vec<Crossing>) {
        let Some(Doubt { from, to, before }) = self.doubt.take() else {
            return;
        };
        // A plateau is hit at its entry.
        let t = if to - from <= short { 0.5 * (from + to) } else { from };
        let error = if before * after < 0 {
            // t and both ends are rounded.
            (t - from).max(to - t) + 8.0 * f64::EPSILON * to.abs()
        } else {
            f64::INFINITY
        };
        out.push(Crossing { t, value, error });
    }

    /// Follows the value through a cell on which its polynomial `q` (Bernstein form, each coefficient off by at most `bound`) may vanish.
    pub(crate) fn follow(&mut self, q: &[f64], bound: f64, s: Stretch, value: usize, out: &mut Vec<Crossing>) {
        let last = q.len() - 1;
        let ends = [sign(q[0], bound), sign(q[last], bound)];
        let tolerance = Tolerance {
            error: bound,
            ..Tolerance::new(WIDTH)
        };
        // The plain case: all signs certain, one change, nothing in doubt.
        if self.doubt.is_none() && ends[0] * ends[1] < 0 && q.iter().all(|x| x.abs() > bound) && bernstein::variations(q) == 1 {
            if let [a, b, c, d] = *q
                && let Some(crossing) = cubic([a, b, c, d], bound, s, value)
            {
                out.push(crossing);
                self.sign = ends[1];
                return;
            }
            if let First::Root(root) = first_root(q, &tolerance) {
                out.push(proved(&root, s, value));
                self.sign = ends[1];
                return;
            }
        }
        self.follow_all(q, tolerance, ends, s, value, out);
    }

    #[inline(never)]
    fn follow_all(
        &mut self,
        q: &[f64],
        tolerance: Tolerance<f64>,
        ends: [i8; 2],
        s: Stretch,
        value: usize,
        out: &mut Vec<Crossing>,
    ) {
        let found = all_roots(q, &tolerance);
        let roots = found.as_slice();
        let n = roots.len();
        let starts = n > 0 && ends[0] == 0 && roots[0].lo == 0.0;
        let stops = n > 0 && ends[1] == 0 && roots[n - 1].hi == 1.0;
        let mut gaps = [0i8; isobar_poly::MAX_DEGREE + 2];
        let told = found.gave_up().is_none() && signs_between(q, &tolerance, roots, ends, [starts, stops], &mut gaps);
        if !told {
            // All of it is in doubt.
            self.open(s.t0, self.sign).to = s.t1;
            return;
        }
        if !starts && self.doubt.is_some() {
            self.close(ends[0], value, s.short, out);
        }
        for (i, root) in roots.iter().enumerate() {
            let first_open = i == 0 && starts;
            if first_open || (i + 1 == n && stops) {
                let before = if first_open { self.sign } else { gaps[i] };
                self.open(s.t(root.lo), before).to = s.t(root.hi);
                if first_open && !(n == 1 && stops) {
                    self.close(gaps[1], value, s.short, out);
                }
            } else if root.kind == RootKind::Crossing {
                out.push(proved(root, s, value));
            } else {
                out.push(Crossing {
                    t: s.t(root.t),
                    value,
                    error: f64::INFINITY,
                });
            }
        }
        if !(n == 1 && starts && stops) {
            // Before what is in doubt at the end, if anything is.
            let known = gaps[if stops { n - 1 } else { n }];
            if known != 0 {
                self.sign = known;
            }
        }
    }

    fn open(&mut self, from: f64, before: i8) -> &mut Doubt {
        self.doubt.get_or_insert(Doubt { from, to: from, before })
    }
}

/// Signs of the gaps before, between and after the roots; false where they cannot be told.
fn signs_between(
    q: &[f64],
    tolerance: &Tolerance<f64>,
    roots: &[Root<f64>],
    ends: [i8; 2],
    [starts, stops]: [bool; 2],
    gaps: &mut [i8],
) -> bool {
    let n = roots.len();
    gaps[0] = if starts { 0 } else { ends[0] };
    gaps[n] = if stops { 0 } else { ends[1] };
    if n == 0 || (n == 1 && starts && stops) {
        return true;
    }
    // Roots inside relate the signs on their sides; those that reach an end do not.
    let inside = usize::from(starts)..n - usize::from(stops);
    let turn = |i: usize| if roots[i].kind == RootKind::Crossing { -1i8 } else { 1 };
    if starts && stops {
        let x = 0.5 * (roots[0].hi + roots[1].lo);
        let most = q.iter().fold(0.0f64, |m, c| m.max(c.abs()));
        let rounding = (4 * q.len() + 2) as f64 * f64::EPSILON * most;
        gaps[1] = sign(bernstein::eval(q, x), tolerance.error + rounding);
        if gaps[1] == 0 {
            return false;
        }
    }
    for i in inside.clone() {
        if gaps[i + 1] == 0 {
            gaps[i + 1] = turn(i) * gaps[i];
        }
    }
    for i in inside.rev() {
        if gaps[i] == 0 {
            gaps[i] = turn(i) * gaps[i + 1];
        }
    }
    true
}

/// The one root of a cubic whose certain signs change once: Newton's method inside a shrinking bracket, then certain opposite signs beside it, where a proof is wanted; `None`
/// where they are not found.
#[inline(always)]
fn cubic(q: [f64; 4], bound: f64, s: Stretch, value: usize) -> Option<Crossing> {
    let c1 = 3.0 * (q[1] - q[0]);
    let c2 = 3.0 * ((q[2] - q[1]) - (q[1] - q[0]));
    let c3 = (q[3] - q[0]) - 3.0 * (q[2] - q[1]);
    let negative = q[0] < 0.0;
    let (mut lo, mut hi) = (0.0f64, 1.0f64);
    let mut x = q[0] / (q[0] - q[3]);
    let mut slope = c1;
    for _ in 0..60 {
        let f = q[0] + x * (c1 + x * (c2 + x * c3));
        if (f < 0.0) == negative {
            lo = x;
        } else {
            hi = x;
        }
        slope = c1 + x * (2.0 * c2 + x * (3.0 * c3));
        let newton = x - f / slope;
        // NaN and what lies outside of the bracket halve it.
        let next = if newton >= lo && newton <= hi {
            newton
        } else {
            0.5 * (lo + hi)
        };
        let done = (next - x).abs() <= 1e-14;
        x = next;
        if done {
            break;
        }
    }
    let t = s.t(x);
    if !s.prove {
        return Some(Crossing {
            t,
            value,
            error: f64::INFINITY,
        });
    }
    // Twice the distance at which the tangent leaves the bound; then wider.
    let mut width = (2.0 * bound / slope.abs()).max(1e-13);
    while width < 1e-3 {
        let (lo, hi) = ((x - width).max(0.0), (x + width).min(1.0));
        let (f, g) = (at(q, lo), at(q, hi));
        if f.abs() > bound && g.abs() > bound && (f < 0.0) != (g < 0.0) {
            // t and both ends are rounded.
            let error = (x - lo).max(hi - x) * (s.t1 - s.t0) + 8.0 * f64::EPSILON * s.t1.abs();
            return Some(Crossing { t, value, error });
        }
        width *= 16.0;
    }
    None
}

/// Value by de Casteljau's rule: convex combinations, off by at most 6 units of the greatest coefficient, which the bound includes.
#[inline(always)]
fn at(q: [f64; 4], x: f64) -> f64 {
    let y = 1.0 - x;
    let (a, b, c) = (y * q[0] + x * q[1], y * q[1] + x * q[2], y * q[2] + x * q[3]);
    y * (y * a + x * b) + x * (y * b + x * c)
}

#[inline(always)]
fn proved(root: &Root<f64>, s: Stretch, value: usize) -> Crossing {
    let (t, lo, hi) = (s.t(root.t), s.t(root.lo), s.t(root.hi));
    Crossing {
        t,
        value,
        // t and both ends are rounded.
        error: (t - lo).max(hi - t) + 8.0 * f64::EPSILON * s.t1.abs(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BOUND: f64 = 1e-14;

    /// Follows one polynomial given per cell (power form on [i, i + 1]) and returns t and whether it is proved.
    fn run(cells: &[&[f64]]) -> Vec<(f64, bool)> {
        let (mut track, mut out) = (Track::default(), Vec::new());
        for (i, c) in cells.iter().enumerate() {
            let mut q = c.to_vec();
            isobar_poly::power::to_bernstein(&mut q);
            let s = Stretch {
                t0: i as f64,
                t1: i as f64 + 1.0,
                short: 0.01,
                prove: true,
            };
            let (lo, hi) = q
                .iter()
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), &x| (a.min(x), b.max(x)));
            if lo > BOUND {
                track.clear(1, 0, s.short, &mut out);
            } else if hi < -BOUND {
                track.clear(-1, 0, s.short, &mut out);
            } else {
                track.follow(&q, BOUND, s, 0, &mut out);
            }
        }
        if track.is_open() {
            track.end(0, 0.01, &mut out);
        }
        out.iter().map(|c| (c.t, c.error.is_finite())).collect()
    }

    fn near(got: &[(f64, bool)], want: &[(f64, bool)]) {
        let same = got.len() == want.len() && got.iter().zip(want).all(|(g, w)| (g.0 - w.0).abs() < 1e-6 && g.1 == w.1);
        assert!(same, "{got:?} instead of {want:?}");
    }

    /// hardcases E11: a pair inside one cell.
    #[test]
    fn pairs_are_found() {
        near(&run(&[&[-0.0075, 0.04, -0.04, 0.0]]), &[(0.25, true), (0.75, true)]);
        let three = [-0.045, 0.59, -1.5, 1.0]; // (x - .1)(x - .5)(x - .9)
        near(&run(&[&three]), &[(0.1, true), (0.5, true), (0.9, true)]);
    }

    #[test]
    fn a_crossing_on_a_face_is_one_and_proved() {
        // x - 1 over two cells; with a second root before it
        near(&run(&[&[-1.0, 1.0], &[0.0, 1.0]]), &[(1.0, true)]);
        near(&run(&[&[0.5, -1.5, 1.0], &[0.0, 1.0, 0.0]]), &[(0.5, true), (1.0, true)]);
        // both ends of a cell are zero: 1 - x, then 0 at both ends of -x(1 - x), then x
        near(
            &run(&[&[1.0, -1.0, 0.0], &[0.0, -1.0, 1.0], &[0.0, 1.0, 0.0]]),
            &[(1.0, true), (2.0, true)],
        );
    }

    #[test]
    fn touching_points_and_ends_are_not_proved() {
        near(&run(&[&[0.25, -1.0, 1.0]]), &[(0.5, false)]);
        near(&run(&[&[1.0, -1.0], &[0.0, 1.0]]), &[(1.0, false)]);
        near(&run(&[&[0.0, 1.0]]), &[(0.0, false)]);
        near(&run(&[&[-1.0, 1.0]]), &[(1.0, false)]);
    }

    #[test]
    fn a_plateau_is_hit_at_its_entry() {
        // falls to 0, stays there for a cell, falls on
        near(&run(&[&[1.0, -1.0], &[0.0, 0.0], &[0.0, -1.0]]), &[(1.0, true)]);
        near(&run(&[&[1.0, -1.0], &[0.0, 0.0], &[0.0, 1.0]]), &[(1.0, false)]);
    }
}
