//! Roots of fields without polynomial pieces: subdivision with rigorous enclosures of value and slope along the ray.
//!
//! Leftmost first, an interval of t is
//! * dropped where the enclosure of s - c excludes zero;
//! * solved where the enclosure of the slope excludes zero: s - c is monotone there, so certain signs at the ends tell whether there is
//!   exactly one root, and bisection with interval Newton steps narrows it;
//! * halved otherwise, until halving no longer narrows the enclosure or the interval is shorter than 2^-44 of the stay (or 8 ulps
//!   of t). What is then still open is *unresolved*: a tangent, or a root within that length of the domain's faces or of t = 0. Neighbouring unresolved intervals are joined.
//!
//! A monotone interval whose end has a doubtful sign (the root is within rounding of the cut) is cut elsewhere.

use crate::{
    Decided, Multiplicity, Root,
    extremum::LIMIT,
    map::Mapped,
    oracle::{Goal, Search, Shared},
};
use isobar_core::{Analytic, Interval, Ray};

/// Parts whose enclosure gives the magnitude M of the undecidable flag.
const PARTS: f64 = 64.0;

/// Finds what the goal asks for.
pub(crate) fn search(a: &dyn Analytic, shared: &Shared, c: f64, ray: &Ray, goal: Goal<'_>) -> Search {
    let mut out = Search::new(Decided::F64);
    let map = match shared.local.as_ref().map(|l| goal.keep(l.map(ray))) {
        Some(Mapped::Outside) => return out,
        Some(Mapped::Ray(map)) => map,
        Some(Mapped::Unclear) | None => {
            out.unresolved.push((0.0, f64::INFINITY));
            return out;
        }
    };
    // Enclosures of the ends in t: the sum with t_ref rounds by half an ulp. Where the ray starts inside, the start is 0 exactly.
    let inside = map.start.0 <= -map.t_ref && map.start.1 <= -map.t_ref;
    let t = |s: f64| map.t_ref + s;
    let start = if inside {
        (0.0, 0.0)
    } else {
        (t(map.start.0).next_down().max(0.0), t(map.start.1).next_up())
    };
    let end = (t(map.end.0).next_down(), t(map.end.1).next_up());
    if start.0 > end.1 {
        return out;
    }
    let length = end.1 - start.0;
    let mut run = Run {
        a,
        ray,
        c,
        goal,
        start,
        end,
        least: length * 2f64.powi(-44),
        near: None,
        out,
    };
    if goal.watch {
        run.ends(length / PARTS);
    }
    run.search(length / PARTS);
    if let (Some(first), Some(near)) = (run.out.roots.first(), run.near)
        && near > first.hi
    {
        run.near = None;
    }
    if goal.watch && run.near.is_none() && run.out.roots.is_empty() && run.small_end(length / PARTS) {
        run.near = Some(end.1);
    }
    run.out.near = run.near;
    run.out
}

struct Run<'a> {
    a: &'a dyn Analytic,
    ray: &'a Ray,
    c: f64,
    goal: Goal<'a>,
    start: (f64, f64),
    end: (f64, f64),
    /// Shortest interval.
    least: f64,
    near: Option<f64>,
    out: Search,
}

/// An interval to look at, M of the part it lies in, and the width of the enclosure of s on the interval it was cut from.
struct Node {
    lo: f64,
    hi: f64,
    most: Option<f64>,
    before: f64,
}

impl Run<'_> {
    /// Enclosures of s - c and of its slope.
    fn enclose(&self, lo: f64, hi: f64) -> (Interval, Interval) {
        let (v, d) = self.a.along_ray(self.ray, Interval::new(lo, hi));
        (v - Interval::point(self.c), d)
    }

    fn sign(&self, t: f64) -> i32 {
        let v = self.enclose(t, t).0;
        i32::from(v.lo > 0.0) - i32::from(v.hi < 0.0)
    }

    fn shortest(&self, t: f64) -> f64 {
        self.least.max(8.0 * f64::EPSILON * t.abs())
    }

    fn search(&mut self, part: f64) {
        let mut stack = vec![Node {
            lo: self.start.0,
            hi: self.end.1,
            most: None,
            before: f64::INFINITY,
        }];
        while let Some(node) = stack.pop() {
            if node.lo > self.goal.until {
                return;
            }
            self.look(node, part, &mut stack);
            if self.goal.first_only {
                // A doubtful part is followed to its end.
                let doubt_ends = |u: &(f64, f64)| stack.last().is_none_or(|n| n.lo > u.1);
                if !self.out.roots.is_empty() || self.out.unresolved.last().is_some_and(doubt_ends) {
                    return;
                }
            }
        }
    }

    fn look(&mut self, n: Node, part: f64, stack: &mut Vec<Node>) {
        let (v, d) = self.enclose(n.lo, n.hi);
        let own = v.lo.abs().max(v.hi.abs());
        // M is that of the first interval not longer than a 64th; before, the own one, which is larger.
        let most = n.most.or((n.hi - n.lo <= part).then_some(own));
        let watch = self.goal.watch && self.near.is_none();
        let small = if watch { LIMIT * most.unwrap_or(own) } else { 0.0 };
        if v.lo > small || v.hi < -small {
            return;
        }
        let zero = v.has_zero();
        if !d.has_zero() {
            if !zero || self.monotone(&n, d) {
                return;
            }
        } else if !zero && n.hi - n.lo < 1e-6 * (self.end.1 - self.start.0) {
            self.near = Some(0.5 * (n.lo + n.hi));
            return;
        }
        // Where halving no longer narrows the enclosure, rounding rules: more of it decides nothing.
        let noise = v.width() > 0.75 * n.before && n.hi - n.lo < 1e-5 * (self.end.1 - self.start.0);
        if noise || n.hi - n.lo <= self.shortest(n.hi) {
            if zero {
                self.doubt(n.lo, n.hi);
            }
            return;
        }
        halve(&n, most, v.width(), stack);
    }

    fn doubt(&mut self, lo: f64, hi: f64) {
        match self.out.unresolved.last_mut() {
            Some(u) if lo <= u.1 + 2.0 * (hi - lo) => u.1 = hi,
            _ => self.out.unresolved.push((lo, hi)),
        }
    }

    /// A monotone interval: `true` where it is settled.
    fn monotone(&mut self, n: &Node, slope: Interval) -> bool {
        let (sl, sh) = (self.sign(n.lo), self.sign(n.hi));
        if sl != 0 && sl == sh {
            return true;
        }
        if sl == 0 || sh == 0 {
            // A root within rounding of an end: move the ends outward, as far as s stays monotone.
            return self.at_cut(n);
        }
        let (lo, hi) = self.narrow(n.lo, n.hi, sl, slope);
        self.accept(lo, hi)
    }

    /// The root of a monotone interval with certain signs, narrowed by interval Newton steps and bisection.
    fn narrow(&self, mut lo: f64, mut hi: f64, first: i32, mut slope: Interval) -> (f64, f64) {
        for _ in 0..200 {
            let width = hi - lo;
            let ulp = hi.abs().max(lo.abs()) * f64::EPSILON;
            if width <= 4.0 * ulp {
                break;
            }
            let mid = 0.5 * (lo + hi);
            let v = self.enclose(mid, mid).0;
            // t - mid = -v / slope; slope excludes zero.
            let steep = slope.lo.abs().min(slope.hi.abs());
            let reach = (v.lo.abs().max(v.hi.abs()) / steep).next_up();
            let (a, b) = ((mid - reach).next_down().max(lo), (mid + reach).next_up().min(hi));
            let (mut a, mut b) = if a <= b { (a, b) } else { (lo, hi) };
            let s = i32::from(v.lo > 0.0) - i32::from(v.hi < 0.0);
            if s == first {
                a = a.max(mid);
            } else if s != 0 {
                b = b.min(mid);
            }
            (lo, hi) = (a.min(b), b.max(a));
            if hi - lo > 0.75 * width {
                break;
            }
            let d = self.enclose(lo, hi).1;
            if !d.has_zero() {
                slope = d;
            }
        }
        (lo, hi)
    }

    /// A root certainly in `[lo, hi]`: takes it over if it is certainly in the domain, drops it if certainly outside.
    fn accept(&mut self, lo: f64, hi: f64) -> bool {
        if hi < self.start.0 || lo > self.end.1 {
            return true;
        }
        if lo < self.start.1 || hi > self.end.0 {
            self.doubt(lo, hi);
            return true;
        }
        // A root at a cut is met from both sides.
        if self.out.roots.last().is_some_and(|r| lo <= r.hi) {
            return true;
        }
        let d = self.enclose(lo, hi).1;
        self.out.roots.push(Root {
            lo,
            hi,
            multiplicity: Multiplicity::Simple,
            interval_end: None,
            slope: d.mid(),
            decided: Decided::F64,
        });
        true
    }

    /// A doubtful sign at an end of a monotone interval: looks at a slightly larger one.
    fn at_cut(&mut self, n: &Node) -> bool {
        let mut reach = 16.0 * f64::EPSILON * n.hi.abs().max(self.least);
        for _ in 0..12 {
            let (lo, hi) = (n.lo - reach, n.hi + reach);
            let d = self.enclose(lo, hi).1;
            if d.has_zero() {
                return false;
            }
            let (sl, sh) = (self.sign(lo), self.sign(hi));
            if sl != 0 && sh != 0 {
                if sl == sh {
                    return true;
                }
                let (lo, hi) = self.narrow(lo, hi, sl, d);
                return self.accept(lo, hi);
            }
            reach *= 4.0;
        }
        false
    }

    /// Whether the stay begins near the surface.
    fn ends(&mut self, part: f64) {
        let (v, _) = self.enclose(self.start.0, (self.start.0 + part).min(self.end.1));
        let at = self.enclose(self.start.0, self.start.0).0.mid();
        if at.abs() <= LIMIT * v.lo.abs().max(v.hi.abs()) {
            self.near = Some(self.start.0);
        }
    }

    fn small_end(&self, part: f64) -> bool {
        let (v, _) = self.enclose((self.end.1 - part).max(self.start.0), self.end.1);
        self.enclose(self.end.1, self.end.1).0.mid().abs() <= LIMIT * v.lo.abs().max(v.hi.abs())
    }
}

/// Cuts in two, at a place off the middle so that symmetric roots do not sit on it.
fn halve(n: &Node, most: Option<f64>, before: f64, stack: &mut Vec<Node>) {
    let cut = n.lo + 0.4871 * (n.hi - n.lo);
    for (lo, hi) in [(cut, n.hi), (n.lo, cut)] {
        stack.push(Node { lo, hi, most, before });
    }
}
