//! The undecidable flag (DESIGN, section 4): whether f32-sized errors in the data could change what the first hit is.
//!
//! A ray is undecidable where, before or at its first root (or anywhere, on a miss), s - c has an extremum with
//! `|s - c| <= 8 * 2^-24 * M`, M the greatest `|coefficient - c|` of that piece; where it is as small at the start of the ray's stay in the
//! domain, or, on a miss, at its end; and where the first root is a tangent or a stretch. An extremum may be a kink on a face
//! between pieces. "At its first root" means as far after the root as |s - c| stays within the limit, since the root itself is not
//! known better than that to f32: the first of two roots about a shallow extremum is undecidable, and so is a root from which the
//! ray leaves the domain within the limit. This is a statistic, not a certificate: it is computed in f64 from the Bernstein coefficients, whose errors
//! (1e-13 M) are far below the limit (4.8e-7 M), and extrema are told to a millionth of the piece. Where the neighbour
//! of a small value at a face was skipped by the min/max blocks, which use the same limit for the neighbour's own M, it
//! counts as an extremum.

/// `8 * 2^-24`.
pub(crate) const LIMIT: f64 = 8.0 / 16_777_216.0;

/// Whether coefficients in `[lo, hi]` keep `|s - c|` above the limit everywhere (then there is no root either). The factor covers the roundings.
#[inline]
pub(crate) fn far(lo: f64, hi: f64, c: f64) -> bool {
    const MORE: f64 = LIMIT * (1.0 + 1e-6);
    (lo > c && lo - c > MORE * (hi - c)) || (hi < c && c - hi > MORE * (c - lo))
}

/// Watches the pieces of a ray go by, front to back.
#[derive(Clone, Debug, Default)]
pub(crate) struct Watch {
    /// The first near-extremum, in the caller's parameter.
    pub(crate) found: Option<f64>,
    last: Option<Last>,
    /// The first root was seen, and everything from there to the end of `last` is within the limit: the next piece must be seen too.
    chain: bool,
}

/// The end of the piece before.
#[derive(Clone, Copy, Debug)]
struct Last {
    at: f64,
    small: bool,
    slope: f64,
}

/// One piece: Bernstein coefficients of s - c over `[s0, s1]`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Stretch<'a> {
    pub(crate) b: &'a [f64],
    /// Greatest `|coefficient - c|`.
    pub(crate) most: f64,
    pub(crate) s0: f64,
    pub(crate) s1: f64,
    /// Whether the stay in the domain begins here.
    pub(crate) first: bool,
    /// Whether it ends here.
    pub(crate) last: bool,
    /// tau of the first root in the piece.
    pub(crate) root: Option<f64>,
}

/// What a piece holds.
enum Scan {
    /// An extremum within the limit, at this tau.
    Found(f64),
    /// None.
    Clear,
    /// None, but after the root (or all along, in a chain) everything is within the limit.
    Open,
}

impl Watch {
    /// Whether the first root has been seen but the next piece is still wanted.
    pub(crate) fn wants_more(&self) -> bool {
        self.chain && self.found.is_none()
    }

    /// Looks at the next piece. Pieces shorter than `tiny` are passed over: their slopes are noise, and their values those of the neighbours.
    pub(crate) fn piece(&mut self, p: &Stretch<'_>, tiny: f64) {
        let n = p.b.len() - 1;
        let limit = LIMIT * p.most;
        if self.found.is_some() {
            return;
        }
        if p.s1 - p.s0 <= tiny {
            // The ray only touches the domain, or a clipping plane ends the stay on a face between cells.
            let begins = p.first || self.last.is_some_and(|l| (p.s0 - l.at).abs() <= tiny);
            if begins && p.last && p.b[0].abs() <= limit {
                self.found = Some(p.s0);
            }
            return;
        }
        let (start, end) = (p.b[0], p.b[n]);
        let small_start = start.abs() <= limit;
        let (rise, fall) = if n > 0 {
            (p.b[1] - start, end - p.b[n - 1])
        } else {
            (0.0, 0.0)
        };
        if let Some(l) = self.last {
            let adjacent = (p.s0 - l.at).abs() <= tiny;
            if self.chain && !adjacent {
                // The neighbour was skipped: far from the isovalue by its own measure.
                self.chain = false;
                return;
            }
            let kink = adjacent && (l.small || small_start) && l.slope * rise <= 0.0;
            let beside_skipped = !adjacent && (l.small || small_start);
            if kink || beside_skipped {
                self.found = Some(if adjacent || small_start { p.s0 } else { l.at });
            }
        } else if small_start {
            // The stay begins near the surface, or the piece before was skipped.
            self.found = Some(p.s0);
        }
        let open = if self.found.is_some() || (all_far(p.b, limit) && p.root.is_none()) {
            false
        } else {
            let from = if self.chain { Some(-1.0) } else { p.root };
            match scan(p.b, limit, from) {
                Scan::Found(x) => {
                    self.found = Some(p.s0 + (p.s1 - p.s0) * x);
                    false
                }
                Scan::Clear => false,
                Scan::Open => true,
            }
        };
        self.chain = open;
        let rooted = p.root.is_some() || open;
        if self.found.is_none() && p.last && (open || !rooted && end.abs() <= limit) {
            self.found = Some(p.s1);
        }
        self.last = Some(Last {
            at: p.s1,
            small: end.abs() <= limit,
            slope: fall,
        });
    }

    /// The ray is over without a root: a small value beside cells that were skipped to the end.
    pub(crate) fn finish(&mut self) {
        if let (None, Some(l)) = (self.found, self.last)
            && l.small
        {
            self.found = Some(l.at);
        }
    }
}

fn all_far(b: &[f64], limit: f64) -> bool {
    b.iter().all(|&v| v > limit) || b.iter().all(|&v| v < -limit)
}

fn monotone(b: &[f64]) -> bool {
    let steps = || b.windows(2).map(|w| w[1] - w[0]);
    b.len() == 1 || steps().all(|d| d > 0.0) || steps().all(|d| d < 0.0)
}

/// Looks for an extremum within the limit: everywhere before `root` (everywhere at all without one), and after it as long as |s - c| stays
/// within the limit.
fn scan(b: &[f64], limit: f64, root: Option<f64>) -> Scan {
    const DEPTH: u32 = 20;
    let n = b.len() - 1;
    let until = root.unwrap_or(f64::INFINITY);
    let mut stack = vec![(b.to_vec(), 0.0f64, 1.0f64, 0)];
    while let Some((b, lo, hi, depth)) = stack.pop() {
        let after = hi > until;
        if all_far(&b, limit) {
            if after {
                return Scan::Clear;
            }
            continue;
        }
        if monotone(&b) {
            if after && b[n].abs() > limit {
                return Scan::Clear;
            }
            continue;
        }
        let turns = (b[1] - b[0]) * (b[n] - b[n - 1]) < 0.0;
        let everywhere = b.iter().all(|v| v.abs() <= limit);
        if depth == DEPTH || (turns && everywhere) {
            return Scan::Found(0.5 * (lo + hi));
        }
        let (mut left, mut right) = (b.clone(), b);
        for (k, l) in left.iter_mut().enumerate().skip(1) {
            for i in 0..=n - k {
                right[i] = 0.5 * (right[i] + right[i + 1]);
            }
            *l = right[0];
        }
        let mid = 0.5 * (lo + hi);
        // Rounding may make both halves monotone about an extremum at the cut.
        let joint = (left[n] - left[n - 1]) * (right[1] - right[0]) < 0.0 && right[0].abs() <= limit;
        if joint && monotone(&left) {
            return Scan::Found(mid);
        }
        stack.push((right, mid, hi, depth + 1));
        stack.push((left, lo, mid, depth + 1));
    }
    if root.is_some() { Scan::Open } else { Scan::Clear }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn watch(b: &[f64], root: Option<f64>) -> Option<f64> {
        let mut w = Watch::default();
        let most = b.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        w.piece(
            &Stretch {
                b,
                most,
                s0: 0.0,
                s1: 1.0,
                first: true,
                last: true,
                root,
            },
            1e-12,
        );
        w.finish();
        w.found
    }

    #[test]
    fn near_tangents_are_seen_and_crossings_are_not() {
        assert_eq!(watch(&[1.0, 0.5, -1.0], Some(0.7)), None);
        assert!(watch(&[1.0, -1.0 + 1e-7, 1.0], None).is_some());
        assert!(watch(&[1.0, -1.0 + 1e-5, 1.0], None).is_none());
        // grazes after the root do not count, a pair about a shallow extremum does
        assert!(watch(&[-1.0, 1.0, 0.6, -0.1, 1e-9, 1.0], Some(0.3)).is_none());
        assert!(watch(&[1.0, -1.0 - 1e-8, 1.0], Some(0.5 - 5e-5)).is_some());
        assert!(watch(&[1.0, -1.0 - 1e-5, 1.0], Some(0.5 - 1.6e-3)).is_none());
        // a root as near to the end of the stay
        assert!(watch(&[1.0, -1e-8], Some(1.0 - 1e-8)).is_some());
        assert!(watch(&[1.0, -1e-5], Some(1.0 - 1e-5)).is_none());
        assert!(watch(&[1.0, 0.5, 1e-9], None).is_some()); // the domain ends on the surface
        assert!(watch(&[1e-9, 0.5, 1.0], None).is_some()); // or begins on it
        assert!(watch(&[1.0, 0.5, 1e-3], None).is_none());
    }

    #[test]
    fn a_kink_between_pieces_is_an_extremum() {
        let piece = |w: &mut Watch, b: &[f64], s0: f64| {
            w.piece(
                &Stretch {
                    b,
                    most: 1.0,
                    s0,
                    s1: s0 + 1.0,
                    first: s0 == 0.0,
                    last: false,
                    root: None,
                },
                1e-12,
            );
        };
        let mut w = Watch::default();
        piece(&mut w, &[1.0, 1e-8], 0.0);
        piece(&mut w, &[1e-8, 1.0], 1.0);
        assert_eq!(w.found, Some(1.0));
        let mut w = Watch::default();
        piece(&mut w, &[1.0, 1e-8], 0.0);
        piece(&mut w, &[1e-8, -1.0], 1.0);
        assert_eq!(w.found, None);
        // a kink just after the root
        let mut w = Watch::default();
        let first = Stretch {
            b: &[1.0, -1e-8],
            most: 1.0,
            s0: 0.0,
            s1: 1.0,
            first: true,
            last: false,
            root: Some(1.0 - 1e-8),
        };
        w.piece(&first, 1e-12);
        assert!(w.wants_more());
        let mut through = w.clone();
        piece(&mut w, &[-1e-8, 1.0], 1.0);
        assert_eq!((w.found, w.wants_more()), (Some(1.0), false));
        piece(&mut through, &[-1e-8, -1.0], 1.0);
        assert_eq!((through.found, through.wants_more()), (None, false));
    }

    #[test]
    fn far_is_conservative() {
        assert!(far(1.0, 2.0, 0.0) && far(-2.0, -1.0, 0.0));
        assert!(!far(1e-8, 1.0, 0.0) && !far(-1.0, 1.0, 0.0) && !far(0.0, 1.0, 0.0));
    }
}
