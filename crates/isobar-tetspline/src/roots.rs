//! Roots along the chain of cubics that a ray meets in adjoining tetrahedra.
//!
//! Each cubic is solved by [`isobar_poly::all_roots`] with the bound of its coefficients' errors as tolerance, so a crossing is a proof and "nothing" is one too. What rounding
//! leaves open at the end of one tetrahedron is settled by the next one: a stretch on which s - c cannot be told from zero and that reaches the common face goes on there, and is one root.

use isobar_poly::{Root as PolyRoot, RootKind, Tolerance, all_roots, bernstein};

/// How roots are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Finder {
    /// All of them, with proofs.
    Certified,
    /// The paper's three Newton sequences: at most one in each tetrahedron, nothing proved.
    Newton3,
}

/// A root found on the ray.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Found {
    pub(crate) t: f64,
    /// A root is proved to lie in [t - error, t + error]; +inf where it is not.
    pub(crate) error: f64,
    /// The stretch up to here holds no root but those found before: proved.
    pub(crate) first: bool,
}

/// A stretch on which s - c cannot be told from zero, up to the end of the last segment.
#[derive(Debug, Clone, Copy)]
struct Doubt {
    from: f64,
    to: f64,
    /// Certain sign before it: -1, 1, or 0 for none.
    before: i8,
    first: bool,
}

/// The state of one isovalue along a ray.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Chain {
    /// Parameter and value at the end of the last segment that was looked at.
    end: f64,
    value: f64,
    /// Certain sign there; 0: none.
    sign: i8,
    doubt: Option<Doubt>,
    /// Everything so far is proved free of roots but those found.
    pub(crate) certain: bool,
}

impl Chain {
    pub(crate) fn new() -> Self {
        Self {
            end: f64::NEG_INFINITY,
            value: 0.0,
            sign: 0,
            doubt: None,
            certain: true,
        }
    }

    /// Whether nothing is left open: a stretch without roots needs no word.
    #[inline(always)]
    pub(crate) fn is_settled(&self) -> bool {
        self.doubt.is_none()
    }

    /// s - c has the sign `sign` on the next stretch, or nothing is known of it (0).
    #[inline(always)]
    pub(crate) fn pass(&mut self, sign: i8, found: &mut impl FnMut(Found)) {
        if let Some(d) = self.doubt.take() {
            settle(d, sign, found);
        }
        self.end = f64::NEG_INFINITY;
    }

    /// The cubic with Bernstein coefficients `p`, each off by at most `bound`, on `[t0, t1]`.
    #[inline(always)]
    pub(crate) fn segment(
        &mut self,
        finder: Finder,
        mut p: [f64; 4],
        bound: f64,
        [t0, t1]: [f64; 2],
        found: &mut impl FnMut(Found),
    ) {
        let continues = self.end == t0;
        if continues {
            // Both tetrahedra give their common point the same sign.
            p[0] = self.value;
        } else {
            self.sign = 0;
        }
        (self.end, self.value) = (t1, p[3]);
        if finder == Finder::Newton3 {
            self.certain = false;
            if let Some(x) = crate::newton::first(p) {
                found(Found {
                    t: t0 + x * (t1 - t0),
                    error: f64::INFINITY,
                    first: false,
                });
            }
            return;
        }
        let least = p[0].min(p[1]).min(p[2].min(p[3]));
        let greatest = p[0].max(p[1]).max(p[2].max(p[3]));
        if least > bound || greatest < -bound {
            let sign = if least > 0.0 { 1 } else { -1 };
            if let Some(d) = self.doubt.take() {
                settle(d, sign, found);
            }
            self.sign = sign;
            return;
        }
        if let Some([lo, x, hi]) = only_crossing(&p, bound) {
            if let Some(d) = self.doubt.take() {
                settle(d, if p[0] > 0.0 { 1 } else { -1 }, found);
            }
            let at = |x: f64| t0 + x * (t1 - t0);
            let t = at(x);
            found(Found {
                t,
                error: (t - at(lo)).max(at(hi) - t) + 8.0 * f64::EPSILON * t1.abs().max(t0.abs()),
                first: self.certain,
            });
            self.sign = if p[3] > 0.0 { 1 } else { -1 };
            return;
        }
        self.solve(p, bound, t0, t1, found);
    }

    #[inline(never)]
    fn solve(&mut self, p: [f64; 4], bound: f64, t0: f64, t1: f64, found: &mut impl FnMut(Found)) {
        let h = t1 - t0;
        let at = |x: f64| t0 + x * h;
        let certain = |v: f64| {
            if v.abs() <= bound {
                0i8
            } else if v > 0.0 {
                1
            } else {
                -1
            }
        };
        // Evaluation adds 14 units of rounding of the greatest coefficient, which the caller's bound has room for.
        let sign_at = |x: f64| certain(bernstein::eval(&p, x));
        let roots = all_roots(
            &p,
            &Tolerance {
                error: bound,
                ..Tolerance::new(1e-13)
            },
        );
        let slack = 8.0 * f64::EPSILON * t1.abs().max(t0.abs());
        let mut settled = false;
        for r in roots.as_slice() {
            let open_start = r.lo <= 0.0 && self.doubt.is_some();
            if !open_start && !settled {
                // The doubt before ended at t0.
                if let Some(d) = self.doubt.take() {
                    settle(d, certain(p[0]), found);
                }
            }
            settled = true;
            if open_start {
                let mut d = self.doubt.take().unwrap_or(Doubt {
                    from: t0,
                    to: t0,
                    before: 0,
                    first: false,
                });
                d.to = at(r.hi);
                if r.hi >= 1.0 {
                    self.doubt = Some(d);
                } else {
                    settle(d, sign_at(r.hi), found);
                }
                self.certain = false;
                continue;
            }
            self.root(&p, r, at, sign_at, slack, found);
        }
        if !settled && let Some(d) = self.doubt.take() {
            settle(d, certain(p[0]), found);
        }
        if let Some(x) = roots.gave_up() {
            // Cannot happen for finite coefficients; were it to, the place must not look empty.
            self.certain = false;
            found(Found {
                t: at(x),
                error: f64::INFINITY,
                first: false,
            });
        }
        self.sign = certain(p[3]);
    }

    #[inline(always)]
    fn root(
        &mut self,
        p: &[f64; 4],
        r: &PolyRoot<f64>,
        at: impl Fn(f64) -> f64,
        sign_at: impl Fn(f64) -> i8,
        slack: f64,
        found: &mut impl FnMut(Found),
    ) {
        let proved = matches!(r.kind, RootKind::Crossing | RootKind::End);
        let t = at(if proved { polished(p, r) } else { r.t });
        if !proved && r.hi >= 1.0 {
            self.doubt = Some(Doubt {
                from: at(r.lo),
                to: at(r.hi),
                before: if r.lo > 0.0 { sign_at(r.lo) } else { self.sign },
                first: self.certain,
            });
            self.certain = false;
            return;
        }
        found(Found {
            t,
            error: if proved {
                (t - at(r.lo)).max(at(r.hi) - t) + slack
            } else {
                f64::INFINITY
            },
            first: proved && self.certain,
        });
        self.certain &= proved;
    }
}

/// The common case at a fraction of the solver's cost: coefficients of certain signs that change once have exactly one root (Descartes' rule), which is found by Newton's method and
/// enclosed by two certain signs. `None` where that fails; the solver decides then.
#[inline(always)]
fn only_crossing(p: &[f64; 4], bound: f64) -> Option<[f64; 3]> {
    let negative = p.map(|v| v < 0.0);
    let changes = (1..4).filter(|&i| negative[i] != negative[i - 1]).count();
    if changes != 1 || p.iter().any(|v| v.abs() <= bound) {
        return None;
    }
    let (mut lo, mut hi) = (0.0, 1.0);
    let mut x = p[0] / (p[0] - p[3]);
    let mut slope = 0.0;
    for _ in 0..16 {
        let (v, d) = bernstein::eval_with_derivative(p, x);
        slope = d;
        if (v < 0.0) == negative[0] {
            lo = x;
        } else {
            hi = x;
        }
        let step = v / d;
        let next = x - step;
        if step.abs() < 1e-8 {
            // The next step would be its square; rounding may have led out of the bracket.
            x = next.clamp(0.0, 1.0);
            break;
        }
        x = if next > lo && next < hi { next } else { 0.5 * (lo + hi) };
    }
    // At four bounds from the root the sign is certain, unless the cubic bends too much.
    let e = 4.0 * bound / slope.abs() + f64::EPSILON;
    let (lo, hi) = (x - e, x + e);
    let clear = |x: f64, side: bool| {
        let v = bernstein::eval(p, x);
        v.abs() > bound && (v < 0.0) == side
    };
    let fits = e < 1e-3 && (lo <= 0.0 || clear(lo, negative[0])) && (hi >= 1.0 || clear(hi, negative[3]));
    fits.then(|| [lo.max(0.0), x, hi.min(1.0)])
}

/// The solver stops where its error bound hides the sign, some 1e-10 from the root; rounding is far below its bound, so two more Newton steps inside the bracket gain digits.
#[inline(always)]
fn polished(p: &[f64; 4], r: &PolyRoot<f64>) -> f64 {
    let mut x = r.t;
    for _ in 0..2 {
        let (v, d) = bernstein::eval_with_derivative(p, x);
        let next = x - v / d;
        if next >= r.lo && next <= r.hi {
            x = next;
        }
    }
    x
}

/// A doubt whose other side is known to have the sign `after` (0: nothing is known).
#[cold]
fn settle(d: Doubt, after: i8, found: &mut impl FnMut(Found)) {
    // A sign change across it is a proof; else it is a tangent, a near miss, or an end of the domain.
    let crosses = d.before * after < 0;
    // A plateau is hit where it begins.
    let long = d.to - d.from > 1e-9 * d.to.abs();
    let t = if long { d.from } else { 0.5 * (d.from + d.to) };
    found(Found {
        t,
        error: if crosses {
            (t - d.from).max(d.to - t) + 8.0 * f64::EPSILON * d.to.abs()
        } else {
            f64::INFINITY
        },
        first: crosses && d.first,
    });
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run(segments: &[[f64; 4]], bound: f64) -> (Vec<Found>, bool) {
        let mut chain = Chain::new();
        let mut all = Vec::new();
        let mut push = |f| all.push(f);
        for (n, p) in segments.iter().enumerate() {
            chain.segment(Finder::Certified, *p, bound, [n as f64, n as f64 + 1.0], &mut push);
        }
        chain.pass(0, &mut push);
        (all, chain.certain)
    }

    /// The short way gives what the solver gives, and leaves to it what it cannot prove.
    #[test]
    fn one_certain_change_of_sign_is_one_root() {
        let mut s = 11u64;
        let mut next = || {
            s = s
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (s >> 11) as f64 / (1u64 << 52) as f64 - 1.0
        };
        let (mut short, mut left) = (0, 0);
        for _ in 0..100_000 {
            let p: [f64; 4] = std::array::from_fn(|_| next());
            let roots = all_roots(&p, &Tolerance::new(1e-13));
            match only_crossing(&p, 1e-12) {
                Some([lo, x, hi]) => {
                    short += 1;
                    assert_eq!(roots.as_slice().len(), 1, "{p:?}");
                    let r = roots.as_slice()[0];
                    assert!(
                        (r.t - x).abs() < 1e-11 && lo <= r.hi && r.lo <= hi && hi - lo < 2e-3,
                        "{p:?} {x} {r:?}"
                    );
                }
                None => left += usize::from(roots.as_slice().len() == 1),
            }
        }
        assert!(short > 35_000 && left < 12_000, "{short} {left}");
        assert!(
            only_crossing(&[1.0, 1e-13, -1.0, -1.0], 1e-12).is_none(),
            "a coefficient of no certain sign"
        );
        assert!(only_crossing(&[1.0, -1.0, 1.0, -1.0], 1e-12).is_none(), "three changes");
    }

    #[test]
    fn a_root_on_a_face_is_one_root_and_proved() {
        let (r, certain) = run(&[[3.0, 2.0, 1.0, 0.0], [0.0, -1.0, -2.0, -3.0]], 1e-12);
        assert_eq!(r.len(), 1, "{r:?}");
        assert!((r[0].t - 1.0).abs() < 1e-11 && r[0].error < 1e-10 && r[0].first && !certain);
    }

    #[test]
    fn a_touching_face_is_one_root_and_not_proved() {
        let (r, _) = run(&[[3.0, 2.0, 1.0, 0.0], [0.0, 1.0, 2.0, 3.0]], 1e-12);
        assert_eq!(r.len(), 1, "{r:?}");
        assert!((r[0].t - 1.0).abs() < 1e-11 && r[0].error.is_infinite() && !r[0].first);
    }

    #[test]
    fn a_plateau_is_hit_where_it_begins() {
        let (r, _) = run(&[[3.0, 1.0, 0.0, 0.0], [0.0; 4], [0.0; 4], [0.0, 0.0, 0.0, 1.0]], 1e-12);
        assert_eq!(r.len(), 1, "{r:?}");
        assert!(r[0].t > 0.9 && r[0].t < 1.01, "{r:?}");
    }

    #[test]
    fn three_roots_in_order_and_no_root_is_certain() {
        // (x - .1)(x - .5)(x - .9) by its blossom
        let f = |x: f64, y: f64, z: f64| {
            let e = [0.1, 0.5, 0.9];
            let mut s = 0.0;
            for (a, b, c) in [(0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)] {
                s += (x - e[a]) * (y - e[b]) * (z - e[c]) / 6.0;
            }
            s
        };
        let p = [f(0.0, 0.0, 0.0), f(1.0, 0.0, 0.0), f(1.0, 1.0, 0.0), f(1.0, 1.0, 1.0)];
        let (r, certain) = run(&[p], 1e-15);
        let t: Vec<f64> = r.iter().map(|r| r.t).collect();
        assert!(
            t.iter().zip([0.1, 0.5, 0.9]).all(|(a, b)| (a - b).abs() < 1e-12) && t.len() == 3,
            "{t:?}"
        );
        assert!(r.iter().all(|r| r.first && r.error < 1e-11) && certain);
        let (r, certain) = run(&[[1.0, -0.2, -0.2, 1.0]], 1e-15);
        assert!(r.is_empty() && certain);
    }
}
