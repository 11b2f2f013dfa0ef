//! From the polynomial of a cell to roots along the ray, with signs carried from cell to cell.
//!
//! Coefficients count as signed only beyond their bound. No change of sign is a proof of no root; one change with every sign certain is a proof
//! of exactly one, which Newton's iteration brackets; everything else is isobar-poly's robust solver's. Stretches on which the polynomial cannot be
//! told from zero are kept until a certain sign follows, also in the next cell: a root on a shared face is one crossing, if the
//! signs before and after differ, and is found once; a plateau through many cells is one touch, at its entry.

use isobar_poly::{First, RootKind, Tolerance, all_roots, bernstein, first_root};

/// Brackets in local parameters are at most this wide, where signs are certain that close.
const WIDTH: f64 = 1e-10;

/// Brackets are asked to be at least this many times as wide as the bound over the mean slope.
const HIDDEN: f64 = 2.0;

/// A root, where it was found.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Candidate {
    pub(crate) t: f64,
    /// Bracket, in t.
    pub(crate) lo: f64,
    pub(crate) hi: f64,
    /// The signs at the ends of the bracket are certain and differ.
    pub(crate) crosses: bool,
    pub(crate) surface: usize,
    pub(crate) cell: [i32; 3],
    /// Position in the cell.
    pub(crate) at: [f64; 3],
}

/// The stretch of a ray in one cell.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Segment {
    pub(crate) cell: [i32; 3],
    /// Local ends.
    pub(crate) a: [f64; 3],
    pub(crate) b: [f64; 3],
    pub(crate) t0: f64,
    pub(crate) t1: f64,
}

impl Segment {
    #[inline(always)]
    fn t(&self, x: f64) -> f64 {
        self.t0 + x * (self.t1 - self.t0)
    }

    #[inline(always)]
    fn candidate(&self, lo: f64, x: f64, hi: f64, crosses: bool, surface: usize) -> Candidate {
        Candidate {
            t: self.t(x),
            lo: self.t(lo),
            hi: self.t(hi),
            crosses,
            surface,
            cell: self.cell,
            at: std::array::from_fn(|i| self.a[i] + x * (self.b[i] - self.a[i])),
        }
    }
}

/// What is known of s - c where a ray has come to.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Track {
    /// Certain sign at the end of the last cell; 0 where it is not known.
    sign: i8,
    /// A stretch that reaches there and cannot be told from zero, with the certain sign before it.
    pending: Option<(Candidate, i8)>,
}

impl Track {
    /// Nothing lies open.
    #[inline(always)]
    pub(crate) fn is_settled(&self) -> bool {
        self.pending.is_none()
    }

    /// The certain sign `sign` follows.
    #[inline(always)]
    pub(crate) fn certain(&mut self, sign: i8, found: &mut Vec<Candidate>) {
        if self.pending.is_some() {
            self.settle(sign, found);
        }
        self.sign = sign;
    }

    /// Ends the open stretch; `after` is the certain sign behind it, or 0.
    #[cold]
    #[inline(never)]
    pub(crate) fn settle(&mut self, after: i8, found: &mut Vec<Candidate>) {
        if let Some((mut c, before)) = self.pending.take() {
            c.crosses = before * after < 0;
            found.push(c);
        }
    }

    /// The ray skipped cells (proved to be without a root, but their sign was not asked for) or left the domain.
    #[inline(always)]
    pub(crate) fn skip(&mut self, found: &mut Vec<Candidate>) {
        if self.pending.is_some() {
            self.settle(0, found);
        }
        self.sign = 0;
    }

    /// Takes the polynomial of the next cell: Bernstein coefficients `b`, each off by at most `bound`. Returns false where the search gave up.
    #[inline(always)]
    pub(crate) fn take(&mut self, b: &[f64], bound: f64, surface: usize, segment: &Segment, found: &mut Vec<Candidate>) -> bool {
        let (mut least, mut changes) = (b[0].abs(), 0);
        for i in 1..b.len() {
            least = least.min(b[i].abs());
            changes += u32::from((b[i] < 0.0) != (b[i - 1] < 0.0));
        }
        if least > bound && changes <= 1 {
            let sign = |v: f64| if v < 0.0 { -1 } else { 1 };
            self.certain(sign(b[0]), found);
            if changes == 0 {
                return true;
            }
            // Where the bound hides the sign further than WIDTH from the root, as it does where s is flat, there is no use in asking for less: isobar-poly
            // would bisect to the borders of what cannot be told, at ten times the cost of Newton's iteration. `bound / rise` is how far that is.
            let rise = (b[b.len() - 1] - b[0]).abs();
            let tolerance = Tolerance {
                error: bound,
                ..Tolerance::new(WIDTH.max(HIDDEN * bound / rise))
            };
            if let First::Root(r) = first_root(b, &tolerance) {
                found.push(segment.candidate(r.lo, r.t, r.hi, true, surface));
                self.sign = sign(b[b.len() - 1]);
                return true;
            }
        }
        self.unsettled(b, bound, surface, segment, found)
    }

    /// As [`Track::take`], whatever the signs.
    #[inline(never)]
    fn unsettled(&mut self, b: &[f64], bound: f64, surface: usize, segment: &Segment, found: &mut Vec<Candidate>) -> bool {
        let tolerance = Tolerance {
            error: bound,
            ..Tolerance::new(WIDTH)
        };
        let roots = all_roots(b, &tolerance);
        // Certain sign at x, by de Casteljau's scheme: averages, so 2 roundings a step.
        let most = b.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        let sign = |x: f64| {
            let v = bernstein::eval(b, x);
            if v.abs() <= bound + 64.0 * f64::EPSILON * most {
                0
            } else if v < 0.0 {
                -1
            } else {
                1
            }
        };
        for r in roots.as_slice() {
            if r.lo > 0.0 || r.kind == RootKind::Crossing {
                self.certain(sign(r.lo), found);
            }
            match r.kind {
                RootKind::Crossing => {
                    found.push(segment.candidate(r.lo, r.t, r.hi, true, surface));
                }
                RootKind::End | RootKind::Touching | RootKind::Interval => {
                    // A stretch is reported at its entry; what continues one from the cell before belongs to it.
                    let x = if r.kind == RootKind::Interval { r.lo } else { r.t };
                    let now = segment.candidate(r.lo, x, r.hi, false, surface);
                    match &mut self.pending {
                        Some((c, _)) => c.hi = now.hi,
                        None => self.pending = Some((now, self.sign)),
                    }
                }
            }
            if r.hi < 1.0 {
                self.certain(sign(r.hi), found);
            } else if r.kind == RootKind::Crossing {
                self.sign = 0;
            }
        }
        if roots.as_slice().is_empty() && roots.gave_up().is_none() {
            // No root: all certain signs are the same.
            let v = b
                .iter()
                .find(|v| v.abs() > bound)
                .map_or(0, |v| if *v < 0.0 { -1 } else { 1 });
            self.certain(v, found);
        }
        if roots.gave_up().is_some() {
            self.skip(found);
        }
        roots.gave_up().is_none()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn segment(t0: f64) -> Segment {
        Segment {
            cell: [0; 3],
            a: [0.0; 3],
            b: [1.0; 3],
            t0,
            t1: t0 + 1.0,
        }
    }

    /// Bernstein coefficients of degree 6 of (x - r) k.
    fn linear(r: f64, k: f64) -> [f64; 7] {
        std::array::from_fn(|i| (i as f64 / 6.0 - r) * k)
    }

    fn run(cells: &[[f64; 7]], bound: f64) -> Vec<Candidate> {
        let (mut track, mut found) = (Track::default(), Vec::new());
        for (i, b) in cells.iter().enumerate() {
            assert!(track.take(b, bound, 0, &segment(i as f64), &mut found));
        }
        track.skip(&mut found);
        found
    }

    #[test]
    fn a_root_on_a_shared_face_is_found_once_and_proved() {
        for shift in [0.0, 1e-15, -1e-15] {
            let found = run(&[linear(1.0 + shift, 1.0), linear(shift, 1.0)], 1e-12);
            assert_eq!(found.len(), 1, "{shift}: {found:?}");
            let c = found[0];
            assert!(c.crosses && (c.t - 1.0).abs() < 1e-10 && c.lo <= 1.0 && c.hi >= 1.0, "{c:?}");
        }
    }

    #[test]
    fn a_touch_on_a_shared_face_is_one_and_not_proved() {
        let square = [1.0, 2.0 / 3.0, 0.4, 0.2, 1.0 / 15.0, 0.0, 0.0];
        let mut back = square;
        back.reverse();
        let found = run(&[square, back], 1e-13);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(!found[0].crosses && (found[0].t - 1.0).abs() < 1e-5, "{found:?}");
    }

    #[test]
    fn a_plateau_is_one_touch_at_its_entry() {
        let found = run(&[linear(1.0, 1.0), [0.0; 7], [0.0; 7], linear(0.0, -1.0)], 1e-12);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!(
            !found[0].crosses && (found[0].t - 1.0).abs() < 1e-9 && (found[0].hi - 3.0).abs() < 1e-9,
            "{found:?}"
        );
    }

    #[test]
    fn roots_inside_are_in_order() {
        let found = run(&[linear(0.25, -2.0), linear(0.5, 1.0), linear(2.0, 1.0)], 1e-13);
        let t: Vec<f64> = found.iter().map(|c| c.t).collect();
        assert!(
            t.len() == 2 && (t[0] - 0.25).abs() < 1e-9 && (t[1] - 1.5).abs() < 1e-9,
            "{t:?}"
        );
        assert!(found.iter().all(|c| c.crosses && c.hi - c.lo < 1e-9));
    }
}
