//! One ray's colour, gathered front to back, with a bound of its error.
//!
//! **Legs.** A leg is a stretch of the ray on which s is one polynomial, given by Bernstein coefficients that are known to an error e. It is cut until all coefficients of a part lie
//! in one band of the transfer function, or outside it by no more than e: at the roots of s - knot where the ends of the part lie on both sides of a knot, else in the
//! middle. A polynomial lies within its Bernstein coefficients, so that no peak of the transfer function, however narrow, is stepped over. Coefficients outside the band by at most e are
//! moved into it: then s is known to 2e, all of it lies in the band, and extinction and colour are linear in it.
//!
//! **Leaves.** On a part in one band let w in [0, 1] be the place in the band, a polynomial of degree n with coefficients in [0, 1]. The depth
//! `X = h |d| mean((1 - w) rho_0 + w rho_1)` is exact (the integral of a Bernstein form is the mean of its coefficients), so is the colour `c (1 - exp(-X))` where the band has one colour.
//! Otherwise the colour is integrated by a rule with a proved bound ([`super::rule`]); parts with X > 2, or for which no rule is good enough, are halved.
//!
//! **Errors of s.** Where s is wrong by at most r = 2e, extinction and emission are wrong by at most `L r`, L their steepness in the band, except where s comes within r of an end
//! of the band: there the neighbour's steepness counts too. With coefficients at distances `d_i` from that end, `s - knot >= m (1 - (1 - tau)^n) >= m tau` for
//! `m = min(d_1 .. d_n)`: that is so for at most `r/m` of the part (or the like seen from its end, or all of it). Integrated, this bounds both the error of X and that of the integral of E.
//!
//! **Sum.** With T the transparency of what lies before, C the colour of a leaf and eta the bound of the error of the depth so far,
//! `|T C - T~ C~| <= T~ (|C - C~| + C~ (exp(eta) - 1))`; `|C - C~|` is at most the errors of E and X, the bound of the rule and `128 u C~` for roundings (all terms are sums of products
//! that are not negative; at most 96 nodes, each with a dozen operations more than its sums of at most 47 terms whose weights sum to one). Second-order terms are covered by the factor 1.05; a depth known worse than
//! 0.05, or more than 2^20 parts, give the error 1, and what follows is left out. Where T falls below a thousandth of the target the rest is left out: it is at most T in every channel.

use super::{
    rule::{DEEPEST, Rules},
    transfer::{Band, Bands},
};
use crate::{compose::MOST, real::U64};
use std::ops::ControlFlow::{self, Break, Continue};

/// A surface the ray meets.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Event {
    /// t, the middle of its bracket.
    pub(crate) t: f64,
    /// Width of the bracket.
    pub(crate) width: f64,
    /// Shaded.
    pub(crate) colour: [f64; 3],
    pub(crate) opacity: f64,
}

/// A polynomial along `[s0, s1]`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Leg<'a> {
    /// `t = base + s`.
    pub(crate) s: (f64, f64),
    /// Bernstein coefficients of the value.
    pub(crate) b: &'a [f64],
    /// Bound of their errors.
    pub(crate) e: f64,
    /// Length at its ends that may belong to the neighbours.
    pub(crate) slop: f64,
}

#[derive(Clone, Copy, Debug)]
struct Part {
    b: [f64; MOST + 1],
    s0: f64,
    s1: f64,
    e: f64,
    cuts: u32,
}

/// See the module.
#[derive(Debug)]
pub(crate) struct Beam<'a> {
    bands: Option<&'a Bands>,
    rules: &'a Rules,
    /// World length per unit of t.
    speed: f64,
    target: f64,
    base: f64,
    events: &'a [Event],
    next: usize,
    stack: Vec<Part>,
    /// Transparency of the surfaces.
    through: f64,
    /// Depth of the medium and the bound of its error.
    depth: f64,
    depth_error: f64,
    /// `through * exp(-depth)`.
    front: f64,
    colour: [f64; 3],
    error: f64,
    /// Parts looked at.
    work: u32,
    pub(crate) leaves: u32,
}

/// More parts of one ray are not looked at (seconds): its colour is then unknown, the error 1.
const MOST_WORK: u32 = 1 << 20;

/// Parts are not cut more often: 2^-60 of a leg.
const CUTS: u32 = 60;

impl<'a> Beam<'a> {
    pub(crate) fn new(bands: Option<&'a Bands>, rules: &'a Rules, speed: f64, target: f64, events: &'a [Event]) -> Self {
        Self {
            bands,
            rules,
            speed,
            target,
            base: 0.0,
            events,
            next: 0,
            stack: Vec::new(),
            through: 1.0,
            depth: 0.0,
            depth_error: 0.0,
            front: 1.0,
            colour: [0.0; 3],
            error: 0.0,
            work: 0,
            leaves: 0,
        }
    }

    /// Nothing can be said of the colour any more: the depth is known too badly, or the work is too much. Then the rest is left out.
    fn hopeless(&self) -> bool {
        self.depth_error.is_nan() || self.depth_error >= 0.05 || self.work > MOST_WORK
    }

    /// Begins, or begins again, with legs in `s = t - base`.
    pub(crate) fn begin(&mut self, base: f64) {
        *self = Self {
            base,
            stack: std::mem::take(&mut self.stack),
            ..Self::new(self.bands, self.rules, self.speed, self.target, self.events)
        };
        self.stack.clear();
    }

    /// Whether values of `[lo, hi]` neither absorb nor emit.
    pub(crate) fn dark(&self, lo: f64, hi: f64) -> bool {
        self.bands.is_none_or(|b| b.most(lo, hi) == 0.0)
    }

    /// The t beyond which nothing can be seen, if a surface ends the ray.
    pub(crate) fn last(&self) -> f64 {
        let opaque = self.events.iter().find(|e| e.opacity >= 1.0);
        opaque.map_or(f64::INFINITY, |e| e.t + e.width)
    }

    /// A stretch of the ray that may or may not hold what values of `[lo, hi]` absorb and emit.
    pub(crate) fn smear(&mut self, length: f64, lo: f64, hi: f64) {
        let most = self.bands.map_or(0.0, |b| b.most(lo, hi));
        self.add_doubt(length.max(0.0) * self.speed * most);
    }

    /// Bounds of an error of the depth and of the emission about here.
    fn add_doubt(&mut self, x: f64) {
        self.depth_error += x;
        self.error += self.front * x;
    }

    /// The next leg.
    pub(crate) fn leg(&mut self, leg: &Leg<'_>) -> ControlFlow<()> {
        let Some(bands) = self.bands else { return Continue(()) };
        let (lo, hi) = hull(leg.b);
        self.smear(leg.slop.min(leg.s.1 - leg.s.0), lo - leg.e, hi + leg.e);
        let mut b = [0.0; MOST + 1];
        b[..leg.b.len()].copy_from_slice(leg.b);
        let mut rest = Part {
            b,
            s0: leg.s.0,
            s1: leg.s.1,
            e: leg.e + 4.0 * U64 * lo.abs().max(hi.abs()),
            cuts: 0,
        };
        while let Some(event) = self.events.get(self.next) {
            let at = event.t - self.base;
            if at >= rest.s1 {
                break;
            }
            if at > rest.s0 {
                let (left, right) = self.split(&rest, (at - rest.s0) / (rest.s1 - rest.s0));
                self.part(bands, Part { s1: at, ..left })?;
                rest = Part { s0: at, ..right };
            }
            self.meet(event)?;
        }
        self.part(bands, rest)
    }

    /// Composes a surface.
    fn meet(&mut self, event: &Event) -> ControlFlow<()> {
        self.next += 1;
        // The medium inside the bracket may lie on the other side.
        let rounding = 2.0 * f64::EPSILON * event.t.abs();
        let most = self.bands.map_or(0.0, |b| b.most);
        self.error += self.front * (2.0 * (event.width + rounding) * self.speed * most).min(2.0);
        let k = self.front * event.opacity;
        for (c, e) in self.colour.iter_mut().zip(event.colour) {
            *c += k * e;
        }
        self.error += k * (self.spread() + 4.0 * U64);
        self.through *= 1.0 - event.opacity;
        self.depth_error += 4.0 * U64;
        self.front *= 1.0 - event.opacity;
        self.enough()
    }

    /// Relative error of the transparency so far.
    fn spread(&self) -> f64 {
        self.depth_error.min(1.0).exp_m1()
    }

    fn enough(&self) -> ControlFlow<()> {
        let glows = self.bands.is_some_and(|b| b.glow.is_some());
        if self.front == 0.0 || self.hopeless() || (!glows && self.front < 1e-3 * self.target) {
            return Break(());
        }
        Continue(())
    }

    /// The medium of a part.
    fn part(&mut self, bands: &Bands, part: Part) -> ControlFlow<()> {
        self.stack.clear();
        self.stack.push(part);
        while let Some(p) = self.stack.pop() {
            if p.s1 <= p.s0 {
                continue;
            }
            self.work += 1;
            if self.work > MOST_WORK {
                return Break(());
            }
            let b = &p.b[..=self.rules.degree];
            let (lo, hi) = hull(b);
            let k = bands.find(0.5 * (lo + hi));
            let band = &bands.all[k];
            let inside = lo >= band.from - p.e && hi <= band.to + p.e;
            if !inside && p.cuts < CUTS {
                let at = self.place(bands, b, lo, hi, p.e);
                self.cut(&p, at);
                continue;
            }
            if !inside {
                self.smear(p.s1 - p.s0, lo - p.e, hi + p.e);
            }
            self.leaf(bands, k, &p)?;
        }
        Continue(())
    }

    /// Where to cut a part that is in several bands.
    fn place(&self, bands: &Bands, b: &[f64], lo: f64, hi: f64, e: f64) -> f64 {
        let n = b.len() - 1;
        let (first, last) = (b[0].min(b[n]), b[0].max(b[n]));
        let crossed = bands.knots_between(first + e, last - e);
        if crossed.is_empty() || lo >= hi {
            return 0.5;
        }
        let at = crossing(b, crossed[crossed.len() / 2], e);
        if at > 1e-14 && at < 1.0 - 1e-14 { at } else { 0.5 }
    }

    /// Puts both halves on the stack, the first on top.
    fn cut(&mut self, p: &Part, at: f64) {
        let (left, right) = self.split(p, at);
        let s = p.s0 + (p.s1 - p.s0) * at;
        self.stack.push(Part {
            s0: s,
            cuts: p.cuts + 1,
            ..right
        });
        self.stack.push(Part {
            s1: s,
            cuts: p.cuts + 1,
            ..left
        });
    }

    /// Both sides of `at` by de Casteljau's algorithm, which adds `4 n u max|b|` to the error (see `isolate`); the ends of the stretch are left as they are.
    fn split(&self, p: &Part, at: f64) -> (Part, Part) {
        let n = self.rules.degree;
        let (mut left, mut right) = (*p, *p);
        let (lo, hi) = hull(&p.b[..=n]);
        for k in 1..=n {
            for i in 0..=n - k {
                right.b[i] = (1.0 - at) * right.b[i] + at * right.b[i + 1];
            }
            left.b[k] = right.b[0];
        }
        let e = p.e + 4.0 * n as f64 * U64 * lo.abs().max(hi.abs());
        (left.e, right.e) = (e, e);
        (left, right)
    }

    /// A part in one band.
    fn leaf(&mut self, bands: &Bands, k: usize, p: &Part) -> ControlFlow<()> {
        let n = self.rules.degree;
        let band = &bands.all[k];
        let length = (p.s1 - p.s0) * self.speed;
        let wrong = length * Self::doubt(bands, k, &p.b[..=n], 2.0 * p.e);
        if band.most == 0.0 {
            self.add_doubt(wrong);
            return self.enough();
        }
        let mut w = [0.0; MOST + 1];
        if band.from.is_finite() && band.to.is_finite() {
            for (w, &b) in w.iter_mut().zip(&p.b[..=n]) {
                *w = ((b - band.from) / (band.to - band.from)).clamp(0.0, 1.0);
            }
        }
        let mean = w[..=n].iter().sum::<f64>() / (n + 1) as f64;
        let depth = length * ((1.0 - mean) * band.density[0] + mean * band.density[1]);
        if depth > DEEPEST && p.cuts < CUTS {
            self.cut(p, 0.5);
            return Continue(());
        }
        let Some((colour, rule)) = self.leaf_colour(bands, band, &w, length, depth) else {
            if p.cuts < CUTS {
                self.cut(p, 0.5);
                return Continue(());
            }
            self.add_doubt(length * band.most);
            return self.enough();
        };
        self.leaves += 1;
        // 32u: the place in the band, its mean, the depth.
        let wrong = wrong + 32.0 * U64 * length * band.most;
        let brightest = colour.iter().fold(0.0f64, |m, &c| m.max(c));
        self.error += self.front * (wrong * (1.0 + brightest) + rule + brightest * (128.0 * U64 + self.spread()));
        for (sum, c) in self.colour.iter_mut().zip(colour) {
            *sum += self.front * c;
        }
        self.depth += depth;
        self.depth_error += wrong + 2.0 * U64 * self.depth;
        self.front = self.through * (-self.depth).exp();
        self.enough()
    }

    /// The colour of a leaf and the bound of the rule; `None` where no rule is good enough.
    fn leaf_colour(&self, bands: &Bands, band: &Band, w: &[f64], length: f64, depth: f64) -> Option<([f64; 3], f64)> {
        let [c0, c1] = band.colour;
        if bands.glow.is_none() && band.flat {
            let opacity = -(-depth).exp_m1();
            return Some((c0.map(|c| c * opacity), 0.0));
        }
        let emission = match bands.glow {
            // The colour is at most 1.
            None => depth,
            Some(_) => length * band.most,
        };
        let tolerance = 1e-3 * self.target / self.front.max(1e-3);
        let (rule, bound) = self.rules.choose(depth, emission, tolerance)?;
        let n = self.rules.degree;
        // Bernstein coefficients of the integral of w from 0.
        let mut sums = [0.0; MOST + 2];
        for i in 0..=n {
            sums[i + 1] = sums[i] + w[i] / (n + 1) as f64;
        }
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
        let [r0, r1] = band.density;
        let mut colour = [0.0; 3];
        for node in &rule.nodes {
            let x = dot(&node.value, w);
            let gone = dot(&node.depth, &sums);
            let before = length * (r0 * (node.at - gone) + r1 * gone);
            let emission = bands.glow.unwrap_or((1.0 - x) * r0 + x * r1);
            let k = node.weight * length * emission * (-before).exp();
            for i in 0..3 {
                colour[i] += k * ((1.0 - x) * c0[i] + x * c1[i]);
            }
        }
        Some((colour, bound))
    }

    /// How far extinction and emission may be wrong, in the mean over a part in band k, where s is wrong by at most r.
    fn doubt(bands: &Bands, k: usize, b: &[f64], r: f64) -> f64 {
        let n = b.len() - 1;
        let band = &bands.all[k];
        let mut sum = (band.steepness * r).min(band.most);
        for (knot, up) in [(band.from, false), (band.to, true)] {
            if !knot.is_finite() {
                continue;
            }
            let distance = |i: usize| if up { knot - b[i] } else { b[i] - knot }.max(0.0);
            let least = |range: std::ops::RangeInclusive<usize>| range.map(distance).fold(f64::INFINITY, f64::min);
            if least(0..=n) > r {
                continue;
            }
            let m = least(1..=n).max(least(0..=n - 1));
            let share = if m > r { r / m } else { 1.0 };
            let beyond = if up {
                bands.change(knot, knot + r, r)
            } else {
                bands.change(knot - r, knot.next_down(), r)
            };
            sum += share * beyond;
        }
        sum
    }

    /// The surfaces that are left, then colour, opacity and the bound of the error of each.
    pub(crate) fn finish(&mut self) -> ([f64; 4], f64) {
        if self.enough().is_continue() {
            while let Some(event) = self.events.get(self.next) {
                if self.meet(event).is_break() {
                    break;
                }
            }
        }
        let [r, g, b] = self.colour;
        // Left out: at most what is still seen through (nothing, where all was gone through).
        let rest = if self.enough().is_break() { self.front } else { 0.0 };
        let opacity_error = self.front * self.spread() + 4.0 * U64;
        let error = 1.05 * (self.error.max(opacity_error) + rest);
        let hopeless = self.hopeless() || !error.is_finite();
        let error = if hopeless { error.max(1.0) } else { error };
        ([r, g, b, 1.0 - self.front], error)
    }
}

/// Least and greatest coefficient.
fn hull(b: &[f64]) -> (f64, f64) {
    b.iter().fold((b[0], b[0]), |(lo, hi), &v| (lo.min(v), hi.max(v)))
}

fn value(b: &[f64], x: f64) -> f64 {
    let n = b.len() - 1;
    let mut c = [0.0; MOST + 1];
    c[..=n].copy_from_slice(b);
    for k in 1..=n {
        for i in 0..=n - k {
            c[i] = (1.0 - x) * c[i] + x * c[i + 1];
        }
    }
    c[0]
}

/// A place where a polynomial with ends on both sides of v comes within e of v, or as near as f64 has it: regula falsi (Illinois) with halving.
fn crossing(b: &[f64], v: f64, e: f64) -> f64 {
    let n = b.len() - 1;
    let (mut lo, mut hi) = (0.0f64, 1.0f64);
    let (mut flo, mut fhi) = (b[0] - v, b[n] - v);
    let mut x = flo / (flo - fhi);
    let mut side = 0;
    for step in 0..200 {
        let f = value(b, x) - v;
        if f.abs() <= 0.5 * e || hi - lo <= f64::EPSILON * x {
            break;
        }
        if (f < 0.0) == (flo < 0.0) {
            (lo, flo) = (x, f);
            fhi *= if side == 1 { 0.5 } else { 1.0 };
            side = 1;
        } else {
            (hi, fhi) = (x, f);
            flo *= if side == 2 { 0.5 } else { 1.0 };
            side = 2;
        }
        x = lo + (hi - lo) * if step % 4 == 3 { 0.5 } else { flo / (flo - fhi) };
    }
    x
}
