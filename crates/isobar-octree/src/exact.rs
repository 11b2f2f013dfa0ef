//! Rays that f64 cannot decide, in exact arithmetic: degrees 1, 2 and 3.
//!
//! What is drawn is a function of the bits of the samples, of the isovalue, of the grid's placement and of the ray; all of them are dyadic numbers. With
//! X = (A + B t) / W per axis, A, B and W dyadic, the ray passes plane k at t = (k W - A) / B, a ratio of dyadic numbers, and the polynomial in a cell between two such t, times the
//! product of all denominators, has dyadic coefficients (`isobar_poly::exact`). So cells are crossed in their exact order, signs are those of whole numbers, and there is no bound on
//! any error: a root on a face, an edge or an end of the domain is one, a near miss of 1e-30 is none, a ray that touches the surface meets it. Nothing of the walks in f64 is used,
//! neither their lists of active cells nor their bounds; nor anything of isobar-oracle.
//!
//! Most cells in which coefficients on both sides of the isovalue meet are passed far from the surface. There the polynomial is composed in f64 first, between ends that were rounded from exact ones, so that its error is
//! some units of the cell's own coefficients and knows of no distance to the eye; only where that leaves a sign open it is composed in whole numbers ([`Volume::sign`]).
//!
//! A ray takes far longer than in f64 (README, "Exact stage"), so only those are sent here whose answer in f64 is not proved, and for a view no more than [`WORK`] is spent.

use crate::cell::Root;
use crate::trilinear::hit;
use crate::walk::{Bounds, Space, three};
use glam::DVec3;
use isobar_core::{Camera, Channels, Claim, ClipPlane, Domain, Hit, Ray, View};
use isobar_cpu::scene::Isovalues;
use isobar_cpu::{PixelSink, TILE, TileOut};
use isobar_poly::exact::{Dyadic, ExactRoot, align, product, roots};
use std::cmp::Ordering;

/// What is spent on exact rays of a frame of a view, in cells crossed (a quarter to half a microsecond each): one in which f64 tells nothing has to end too. Every tile has the same share, so that the frame does not
/// depend on the order of tiles; the last ray of a tile may go beyond. Lists of rays have no such limit.
pub(crate) const WORK: usize = if cfg!(test) { 1 << 20 } else { 1 << 25 };

/// A composition in whole numbers counts as so many cells, by degree.
const COMPOSITION: [usize; 4] = [0, 16, 64, 256];

/// Width of brackets, in the part of the ray inside a cell.
const WIDTH: f64 = 1e-15;

/// The coefficients of a spline, cell by cell. Cells begin at whole numbers of the index space that is shifted by [`Volume::shift`].
pub(crate) trait Volume {
    /// Polynomial degree per axis, 1 to 3.
    fn degree(&self) -> usize;
    /// Cells per axis.
    fn cells(&self) -> [i32; 3];
    /// 0 or 1/2.
    fn shift(&self) -> f64;
    /// The `(degree + 1)^3` coefficients of a cell, x fastest; the rest is not used.
    fn stencil(&self, cell: [i32; 3]) -> [f64; 64];
    /// Gradient per cell at a place in it.
    fn gradient(&self, cell: [i32; 3], at: [f64; 3], isovalue: f64) -> DVec3;
    /// The sign of s - isovalue all along the segment between two places of a cell, each off by at most [`PLACE`] units roundoff per axis; 0 where it changes or rounding may hide it.
    fn sign(&self, cell: [i32; 3], isovalue: f64, ends: [[f64; 3]; 2]) -> i32;
}

/// Error of a place in a cell, per axis, in units roundoff: a ratio of exact numbers that is rounded, at most 1.
pub(crate) const PLACE: f64 = 4.0;

/// The sign of all coefficients beyond `error`, or 0; also for what is not a number.
#[inline]
pub(crate) fn common_sign(q: &[f64], error: f64) -> i32 {
    if q.iter().all(|&c| c > error) {
        1
    } else if q.iter().all(|&c| c < -error) {
        -1
    } else {
        0
    }
}

/// A parameter, n / m with m positive.
#[derive(Debug, Clone)]
struct Time {
    n: Dyadic,
    m: Dyadic,
    /// Rounded, and by at most how much.
    near: f64,
    error: f64,
}

impl Time {
    fn new(n: Dyadic, m: Dyadic) -> Self {
        let (n, m) = if m.sign() < 0 { (-n, -m) } else { (n, m) };
        let near = n.ratio(&m);
        Self {
            n,
            m,
            near,
            // That of the ratio, and what is lost to subnormal numbers.
            error: 2.0 * f64::EPSILON * near.abs() + f64::MIN_POSITIVE,
        }
    }

    fn order(&self, o: &Self) -> Ordering {
        // False for what is not finite, too.
        if (self.near - o.near).abs() > self.error + o.error {
            return self.near.total_cmp(&o.near);
        }
        (&self.n * &o.m).cmp(&(&o.n * &self.m))
    }

    fn later(self, o: Self) -> Self {
        if self.order(&o).is_lt() { o } else { self }
    }

    fn earlier(self, o: Self) -> Self {
        if self.order(&o).is_gt() { o } else { self }
    }
}

/// A shifted index coordinate along the ray, (a + b t) / w with w positive.
#[derive(Debug)]
struct Axis {
    a: Dyadic,
    b: Dyadic,
    w: Dyadic,
}

impl Axis {
    /// When the ray passes plane k.
    fn plane(&self, k: f64) -> Option<Time> {
        let at = &Dyadic::new(k)? * &self.w;
        Some(Time::new(&at - &self.a, self.b.clone()))
    }

    /// Numerator of the coordinate at t less k; the denominator is `w * t.m`.
    fn at(&self, t: &Time, k: i32) -> Dyadic {
        let own = &(&self.a * &t.m) + &(&self.b * &t.n);
        &own - &(&(&self.w * &t.m) * &Dyadic::whole(k.into()))
    }

    /// The cell at t on the way: of two that meet there the one the ray goes into.
    fn cell(&self, t: &Time, cells: i32) -> i32 {
        let below = |k: i32| {
            let s = self.at(t, k).sign();
            s < 0 || s == 0 && self.b.sign() < 0
        };
        let near = self.at(t, 0).ratio(&(&self.w * &t.m));
        let mut k = (near as i32).clamp(0, cells - 1);
        while k > 0 && below(k) {
            k -= 1;
        }
        while k + 1 < cells && !below(k + 1) {
            k += 1;
        }
        k
    }
}

/// A ray in the index space of a volume, exactly, with the part of it that is inside.
#[derive(Debug)]
pub(crate) struct Line {
    axes: [Axis; 3],
    first: Time,
    last: Time,
}

fn exact(v: DVec3) -> Option<[Dyadic; 3]> {
    Some([Dyadic::new(v.x)?, Dyadic::new(v.y)?, Dyadic::new(v.z)?])
}

fn minus(p: &[Dyadic; 3], q: &[Dyadic; 3]) -> [Dyadic; 3] {
    [&p[0] - &q[0], &p[1] - &q[1], &p[2] - &q[2]]
}

fn dot(p: &[Dyadic; 3], q: &[Dyadic; 3]) -> Dyadic {
    &(&(&p[0] * &q[0]) + &(&p[1] * &q[1])) + &(&p[2] * &q[2])
}

fn cross(p: &[Dyadic; 3], q: &[Dyadic; 3]) -> [Dyadic; 3] {
    let minor = |i: usize, j: usize| &(&p[i] * &q[j]) - &(&p[j] * &q[i]);
    [minor(1, 2), minor(2, 0), minor(0, 1)]
}

/// The axes of the index space, by the inverse of the grid's: along one of the world's axes, or minors over the determinant.
fn axes(ray: &Ray, domain: &Domain, shift: f64) -> Option<[Axis; 3]> {
    let (o, d) = (minus(&exact(ray.origin)?, &exact(domain.origin)?), exact(ray.direction)?);
    let c = [
        exact(domain.axes.x_axis)?,
        exact(domain.axes.y_axis)?,
        exact(domain.axes.z_axis)?,
    ];
    let shift = Dyadic::new(shift)?;
    let of = |a: usize| {
        let (p, q, w) = if domain.is_axis_aligned() {
            (o[a].clone(), d[a].clone(), c[a][a].clone())
        } else {
            let row = cross(&c[(a + 1) % 3], &c[(a + 2) % 3]);
            (dot(&row, &o), dot(&row, &d), dot(&row, &c[a]))
        };
        let (p, b, w) = match w.sign() {
            0 => return None,
            1 => (p, q, w),
            _ => (-p, -q, -w),
        };
        Some(Axis {
            a: &p + &(&shift * &w),
            b,
            w,
        })
    };
    Some([of(0)?, of(1)?, of(2)?])
}

/// The part of a ray in a domain, or that there is none.
#[derive(Debug)]
pub(crate) enum Stay {
    Inside(Box<Line>),
    Nowhere,
}

impl Line {
    /// `None` where numbers are not finite.
    pub(crate) fn of(ray: &Ray, domain: &Domain, shift: f64, clips: &[ClipPlane]) -> Option<Stay> {
        let axes = axes(ray, domain, shift)?;
        let mut first = Time::new(Dyadic::whole(0), Dyadic::whole(1));
        let mut last: Option<Time> = None;
        let mut until = |t: Time| {
            last = Some(match last.take() {
                Some(l) => l.earlier(t),
                None => t,
            });
        };
        for (a, axis) in axes.iter().enumerate() {
            let (lo, hi) = (shift, domain.hi[a] + shift);
            if axis.b.is_zero() {
                let at = |k: f64| Some(&Dyadic::new(k)? * &axis.w);
                if axis.a < at(lo)? || axis.a > at(hi)? {
                    return Some(Stay::Nowhere);
                }
                continue;
            }
            let (near, far) = if axis.b.sign() > 0 { (lo, hi) } else { (hi, lo) };
            first = first.later(axis.plane(near)?);
            until(axis.plane(far)?);
        }
        for plane in clips {
            let (n, o, d) = (exact(plane.normal)?, exact(ray.origin)?, exact(ray.direction)?);
            let rest = &Dyadic::new(plane.distance)? - &dot(&n, &o);
            let rate = dot(&n, &d);
            match rate.sign() {
                0 if rest.sign() < 0 => return Some(Stay::Nowhere),
                0 => {}
                1 => until(Time::new(rest, rate)),
                _ => first = first.later(Time::new(rest, rate)),
            }
        }
        let last = last?;
        if first.order(&last).is_gt() {
            return Some(Stay::Nowhere);
        }
        (first.near.is_finite() && last.near.is_finite()).then_some(Stay::Inside(Box::new(Self { axes, first, last })))
    }

    /// Calls `push` with the roots in order until it returns false, and counts the `work`. Returns whether all of the ray that was walked is certain.
    fn roots(
        &self,
        volume: &dyn Volume,
        bounds: &[Bounds],
        work: &mut usize,
        push: &mut dyn FnMut(&Root) -> bool,
    ) -> Option<bool> {
        let cells = volume.cells();
        let mut cell = three(|a| self.axes[a].cell(&self.first, cells[a]));
        let step = three(|a| self.axes[a].b.sign());
        let exit = |cell: [i32; 3], a: usize| match step[a] {
            0 => Some(None),
            s => self.axes[a].plane(f64::from(cell[a] + i32::from(s > 0))).map(Some),
        };
        let mut exits = [exit(cell, 0)?, exit(cell, 1)?, exit(cell, 2)?];
        let mut search = Along {
            line: self,
            volume,
            bounds,
            flat: vec![false; bounds.len()],
            found: Vec::new(),
            polynomials: Vec::new(),
            certain: true,
            work,
        };
        let mut t = self.first.clone();
        loop {
            *search.work += 1;
            let te = exits
                .iter()
                .flatten()
                .fold(&self.last, |m, e| if m.order(e).is_gt() { e } else { m });
            let te = te.clone();
            let ends = te.order(&self.last).is_eq();
            if (ends || t.order(&te).is_lt()) && !search.cell(cell, &t, &te, ends, push) {
                return Some(search.certain);
            }
            if ends {
                return Some(search.certain);
            }
            for a in 0..3 {
                if exits[a].as_ref().is_some_and(|e| e.order(&te).is_le()) {
                    cell[a] += step[a];
                    if cell[a] < 0 || cell[a] >= cells[a] {
                        return Some(search.certain);
                    }
                    exits[a] = exit(cell, a)?;
                }
            }
            t = te;
        }
    }
}

/// State of one ray on its way.
struct Along<'a> {
    line: &'a Line,
    volume: &'a dyn Volume,
    bounds: &'a [Bounds],
    /// Per isovalue: s = c all through the last cell.
    flat: Vec<bool>,
    /// With where their brackets begin, in the part of the ray inside the cell.
    found: Vec<(Root, f64)>,
    /// Of the cell, by isovalue: kept where there are several of them.
    polynomials: Vec<(usize, Vec<Dyadic>)>,
    certain: bool,
    /// In cells crossed.
    work: &'a mut usize,
}

impl Along<'_> {
    /// The roots in a cell, from t on and before te, or at it where the ray `ends`. Returns whether to go on.
    fn cell(&mut self, cell: [i32; 3], t: &Time, te: &Time, ends: bool, push: &mut dyn FnMut(&Root) -> bool) -> bool {
        let n = (self.volume.degree() + 1).pow(3);
        let d = self.volume.stencil(cell);
        let d = &d[..n];
        let (lo, hi) = d.iter().fold((d[0], d[0]), |(lo, hi), &v| (lo.min(v), hi.max(v)));
        let (mut weights, mut ends_of) = (None, None);
        for surface in 0..self.bounds.len() {
            let c = self.bounds[surface].isovalue;
            if lo > c || hi < c {
                self.flat[surface] = false;
                continue;
            }
            let places = *ends_of.get_or_insert_with(|| [self.place(cell, t), self.place(cell, te)]);
            if self.volume.sign(cell, c, places) != 0 || (lo == c || hi == c) && lo < hi && self.is_one_sided(d, c, cell, [t, te])
            {
                self.flat[surface] = false;
                continue;
            }
            // A plateau fills the cell.
            if lo == hi {
                self.tell(&[Dyadic::whole(0)], surface, (cell, places), [t, te], ends);
                continue;
            }
            *self.work += COMPOSITION[self.volume.degree()];
            let weights = weights.get_or_insert_with(|| three(|a| self.weights(a, cell[a], t, te)));
            let Some(q) = composed(d, c, self.volume.degree(), weights) else {
                self.certain = false;
                continue;
            };
            self.tell(&q, surface, (cell, places), [t, te], ends);
        }
        self.put_in_order();
        self.polynomials.clear();
        for (mut root, _) in std::mem::take(&mut self.found) {
            let sure = root.first;
            root.first = self.certain;
            self.certain &= sure;
            if !push(&root) {
                return false;
            }
        }
        true
    }

    /// By t; of two isovalues whose brackets meet, the one that s comes to first from where it is before both: the nearer one. Where s is between the two there, nothing is certain from then on.
    fn put_in_order(&mut self) {
        self.found.sort_by(|(p, _), (q, _)| p.t.total_cmp(&q.t));
        for i in 1..self.found.len() {
            for j in (1..=i).rev() {
                let [(p, from), (q, beside)] = [&self.found[j - 1], &self.found[j]];
                if p.surface == q.surface || !p.error.is_finite() || !q.error.is_finite() || q.t - p.t > p.error + q.error {
                    break;
                }
                let before = from.min(*beside);
                let [s, r] = [p.surface, q.surface].map(|of| self.sign_at(of, before));
                let higher = self.bounds[p.surface].isovalue > self.bounds[q.surface].isovalue;
                let right = match (s, r) {
                    // A root is there already.
                    (0, _) => true,
                    (_, 0) => false,
                    // From below to the lower one, from above to the higher one.
                    (-1, -1) => !higher,
                    (1, 1) => higher,
                    _ => {
                        self.certain = false;
                        break;
                    }
                };
                if right {
                    break;
                }
                let (t, later) = (p.t, q.t);
                self.found.swap(j - 1, j);
                (self.found[j - 1].0.t, self.found[j].0.t) = (t, later);
            }
        }
    }

    /// The sign of s less an isovalue at a part of the ray inside the cell.
    fn sign_at(&self, surface: usize, x: f64) -> i32 {
        let Some((_, q)) = self.polynomials.iter().find(|(of, _)| *of == surface) else {
            return 0;
        };
        let (Some(x), one) = (Dyadic::new(x), Dyadic::whole(1)) else {
            return 0;
        };
        // Horner's rule in x and 1 - x.
        let rest = &one - &x;
        let (mut sum, mut power) = (q[0].clone(), one);
        for c in &q[1..] {
            power = &power * &x;
            sum = &(&sum * &rest) + &(c * &power);
        }
        sum.sign()
    }

    /// Whether s keeps clear of an isovalue that is the least or the greatest coefficient of a cell: inside the cell every coefficient counts, on its faces the last or the first along an axis does not.
    fn is_one_sided(&self, d: &[f64], c: f64, cell: [i32; 3], [t, te]: [&Time; 2]) -> bool {
        let n = self.volume.degree() + 1;
        // Along each axis the coefficients that count at a parameter.
        let count = |t: &Time| {
            three(|a| {
                let axis = &self.line.axes[a];
                let (from, to) = (axis.at(t, cell[a]).is_zero(), axis.at(t, cell[a] + 1).is_zero());
                (usize::from(to), n - usize::from(from))
            })
        };
        let clear = |[x, y, z]: [(usize, usize); 3]| {
            let mut rows = (z.0..z.1).flat_map(|k| (y.0..y.1).map(move |j| (k * n + j) * n));
            rows.any(|row| d[row + x.0..row + x.1].iter().any(|&v| v != c))
        };
        // Between the two what counts at either does: where the ray runs in a face, it does so at both.
        clear(count(t)) && clear(count(te))
    }

    /// Where the ray is in a cell.
    fn place(&self, cell: [i32; 3], t: &Time) -> [f64; 3] {
        three(|a| {
            let axis = &self.line.axes[a];
            axis.at(t, cell[a]).ratio(&(&axis.w * &t.m)).clamp(0.0, 1.0)
        })
    }

    /// Weights of the coefficients along axis `a`, in scaled Bernstein form between two parameters, times one positive number.
    fn weights(&self, a: usize, cell: i32, t: &Time, te: &Time) -> Vec<Vec<Dyadic>> {
        let axis = &self.line.axes[a];
        let (w0, w1) = (&axis.at(t, cell) * &te.m, &axis.at(te, cell) * &t.m);
        let whole = &(&axis.w * &t.m) * &te.m;
        let mut all = [&whole - &w0, &whole - &w1, w0, w1];
        align(&mut all);
        let [v0, v1, w0, w1] = all;
        let (v, w) = ([v0, v1], [w0, w1]);
        let sum = |terms: &[(i64, &Vec<Dyadic>)]| -> Vec<Dyadic> {
            (0..terms[0].1.len())
                .map(|i| {
                    let term = |&(k, p): &(i64, &Vec<Dyadic>)| &Dyadic::whole(k) * &p[i];
                    terms[1..].iter().fold(term(&terms[0]), |s, x| &s + &term(x))
                })
                .collect()
        };
        if self.volume.degree() == 1 {
            return vec![v.to_vec(), w.to_vec()];
        }
        let (vv, vw, ww) = (product(&v, &v), product(&v, &w), product(&w, &w));
        if self.volume.degree() == 2 {
            let middle = sum(&[(1, &vv), (4, &vw), (1, &ww)]);
            return vec![vv, middle, ww];
        }
        let (vvv, vvw, vww, www) = (product(&vv, &v), product(&vv, &w), product(&vw, &w), product(&ww, &w));
        let second = sum(&[(4, &vvv), (12, &vvw), (6, &vww), (1, &www)]);
        let third = sum(&[(1, &vvv), (6, &vvw), (12, &vww), (4, &www)]);
        vec![vvv, second, third, www]
    }

    /// Keeps the roots of a polynomial between two parameters, at these places of a cell.
    fn tell(&mut self, q: &[Dyadic], surface: usize, (cell, places): ([i32; 3], [[f64; 3]; 2]), [t, te]: [&Time; 2], ends: bool) {
        let was_flat = std::mem::replace(&mut self.flat[surface], false);
        let (t0, t1) = (t.near, te.near);
        let mut told = Vec::new();
        roots(q, WIDTH, &mut |r| {
            told.push(r);
            true
        });
        let whole = told == [ExactRoot::Everywhere];
        // To bracket a root takes about as long as to compose.
        let bracketed = told
            .iter()
            .filter(|r| matches!(r, ExactRoot::Between(..) | ExactRoot::Close(..)))
            .count();
        *self.work += bracketed * COMPOSITION[self.volume.degree()];
        if ends && !whole && q[q.len() - 1].is_zero() {
            told.push(ExactRoot::At(1.0));
        }
        for r in told {
            let (lo, hi, sure) = match r {
                // What was zero up to here was a root where it began.
                ExactRoot::At(0.0) | ExactRoot::Everywhere if was_flat => continue,
                ExactRoot::At(x) => (x, x, true),
                ExactRoot::Everywhere => (0.0, 0.0, true),
                ExactRoot::Between(lo, hi) => (lo, hi, true),
                ExactRoot::Close(lo, hi) => (lo, hi, false),
            };
            let x = 0.5 * (lo + hi);
            let [from, to] = places;
            let at = three(|a| (from[a] + x * (to[a] - from[a])).clamp(0.0, 1.0));
            let root = Root {
                t: t0 + x * (t1 - t0),
                surface,
                gradient: self.volume.gradient(cell, at, self.bounds[surface].isovalue),
                // The bracket and t itself are rounded, the two ends within four units each.
                error: if sure {
                    0.5 * (hi - lo) * (t1 - t0) + 16.0 * f64::EPSILON * t1.abs() + f64::MIN_POSITIVE
                } else {
                    f64::INFINITY
                },
                first: sure,
            };
            self.found.push((root, lo));
        }
        self.flat[surface] = whole;
        if self.bounds.len() > 1 {
            self.polynomials.push((surface, q.to_vec()));
        }
    }
}

/// s - c along the ray, in scaled Bernstein form, times one positive number. `None` where a coefficient is not finite.
fn composed(d: &[f64], c: f64, degree: usize, weights: &[Vec<Vec<Dyadic>>; 3]) -> Option<Vec<Dyadic>> {
    let n = degree + 1;
    let c = Dyadic::new(c)?;
    let mut e = Vec::with_capacity(d.len());
    for &v in d {
        e.push(&Dyadic::new(v)? - &c);
    }
    align(&mut e);
    let sum = |terms: &mut dyn Iterator<Item = Vec<Dyadic>>| {
        terms
            .reduce(|s, p| s.iter().zip(&p).map(|(a, b)| a + b).collect())
            .unwrap_or_default()
    };
    let [x, y, z] = weights;
    let row = |i: usize, j: usize| {
        sum(&mut (0..n).map(|k| {
            let v = &e[(k * n + j) * n + i];
            z[k].iter().map(|w| w * v).collect()
        }))
    };
    let column = |i: usize| sum(&mut (0..n).map(|j| product(&row(i, j), &y[j])));
    Some(sum(&mut (0..n).map(|i| product(&column(i), &x[i]))))
}

/// What the rays of a frame share.
#[derive(Debug)]
pub(crate) struct Exact<'a> {
    pub(crate) space: &'a Space,
    pub(crate) clips: &'a [ClipPlane],
    pub(crate) bounds: &'a [Bounds],
    pub(crate) surfaces: &'a Isovalues,
}

impl Exact<'_> {
    /// Draws a pixel anew: `stale` hits have been written to its layers, and `cells` looked into. Takes from `left` what that costs. Gives the claim, or `None` where nothing was done.
    #[cold]
    #[inline(never)]
    pub(crate) fn draw(
        &self,
        volume: &dyn Volume,
        out: &mut TileOut<'_>,
        ([x, y], ray): ([usize; 2], &Ray),
        (stale, cells): (u16, u32),
        left: &mut usize,
    ) -> Option<Claim> {
        let mut work = 1;
        let stay = Line::of(ray, &self.space.domain, volume.shift(), self.clips)?;
        for layer in 0..usize::from(stale).min(out.layers()) {
            out.set_hit(layer, x, y, &Hit::NONE);
        }
        let mut claim = Claim::empty();
        let mut sink = PixelSink::new(out, x, y, ray, self.surfaces.all());
        let certain = match &stay {
            Stay::Nowhere => true,
            Stay::Inside(line) => line
                .roots(volume, self.bounds, &mut work, &mut |root| {
                    if sink.hits() == 0 && root.error.is_finite() {
                        claim = Claim::EXISTS;
                        claim.set(Claim::FIRST, root.first);
                    }
                    sink.push(&hit(ray, root, self.surfaces, self.space, !claim.is_empty()))
                })
                .unwrap_or(false),
        };
        if sink.hits() == 0 && certain {
            claim = Claim::EMPTY;
        }
        sink.finish(claim, cells);
        *left = left.saturating_sub(work);
        Some(claim)
    }

    /// Whether the claim leaves nothing to be decided.
    pub(crate) fn is_decided(claim: Claim) -> bool {
        claim.contains(Claim::EXISTS | Claim::FIRST) || claim.contains(Claim::EMPTY)
    }

    /// What may be spent on exact rays of the tile, in cells crossed, for a frame that wants claims.
    pub(crate) fn allowed(claims: bool, view: &View, out: &TileOut<'_>) -> usize {
        match (claims && out.holds(Channels::CLAIM), &view.camera) {
            (false, _) => 0,
            (true, Camera::Rays(_)) => usize::MAX,
            (true, _) => (WORK / (view.width.div_ceil(TILE) * view.height.div_ceil(TILE)).max(1)).max(1),
        }
    }
}
