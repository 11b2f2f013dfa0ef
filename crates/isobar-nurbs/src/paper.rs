//! `nurbs/cpu-paper`: the algorithm of section 4 as printed, pixel by pixel.
//!
//! Per pixel and candidate element the tuple (P, delta) is subdivided into octants at the middle; parts whose bounding volume holds the origin stay in the list L
//! (section 4.1.1). The volume is an axis-aligned box, the box along the Jacobian's directions, or the box along the principal axes of the coefficients (`paper_volume.rs`). A part whose delta
//! (equation 17 as corrected in maths, section C: the attribute's derivative along the ray, times a positive polynomial; `paper_forms.rs`) has no change of sign goes to Newton's
//! method from the node of the coefficient nearest to the origin; where that fails it is subdivided. A part that is dropped, with changes of sign of gamma and delta and inside the pixel's square, is searched for a
//! silhouette (section 4.1.2, `paper_silhouette.rs`) where pixels are frusta and the ray hits nothing. Roots are filtered by the alternation of the signs of f'(t)
//! (section 4.2, equation 26 with the inverse transposed), and many roots in a short stretch become its two ends.
//!
//! What is taken from the corrections instead of the print, because nothing would be drawn otherwise: pixel centres (12), the weight in gamma (13, 15), signs in the projection
//! (9), eta relative to the pixel's centre (18), (20) as convergence of Newton's method (epsilon has no meaning for delta and eta). **As printed stays**: Newton stops at epsilon = 1/(2h), a quarter pixel, for alpha and beta and for the attribute alike (14), so hits are only
//! that near, and a ray that passes the edge of the surface within a quarter pixel gets a hit where there is none (counted in `paper_tests.rs`; with a tolerance of 1e-8 the same scene has no such pixel, and none is lost in either case); alternation of signs drops true roots where the surface leaves the domain between two of them; roots that Newton's method misses in a part without a change of
//! sign of delta are found after further subdivision or, at the last level, lost. Nothing is claimed.

use crate::bernstein::{Point, bases, jet};
use crate::frustum::{Frustum, PixelBox};
use crate::matrix::{inverse, product};
use crate::paper_forms::{Forms, evaluate};
use crate::paper_parts::{Cutting, Part, Parts, bezier};
use crate::paper_silhouette::{self as silhouette, Region, Square, silhouettes};
use crate::paper_volume::{Bounds, holds_origin};
use crate::solve::{Found, Target, Task};
use crate::tile::Index;
use glam::DVec3;
use isobar_core::{HexElement, Stop};
use std::collections::HashMap;
use std::sync::{Arc, Mutex};

/// Subdivision levels, at most.
const DEEPEST: u8 = 20;
/// Parts in the list, at most; more end the search of the pixel.
const MOST_PARTS: usize = 4096;
/// Newton steps from one start.
const STEPS: usize = 8;
/// More roots than this within an epsilon of t are taken for a stretch of the ray on the surface.
const CROWD: usize = 4;
/// Bytes of octants kept for the pixels of a tile; more are made again for the next pixel.
const MOST_BYTES: usize = 1 << 26;
/// Forms of so many tasks are kept for the whole frame; of more for a tile only.
const KEPT: usize = 4096;
/// Bytes of forms kept for the frame, about: what is made beyond that is made again for the next tile.
const MOST_KEPT: usize = 1 << 28;

/// How the paper's form works.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Manner {
    pub(crate) bounds: Bounds,
    pub(crate) cutting: Cutting,
    /// Where silhouettes are sought; `None` where pixels are centres.
    pub(crate) region: Option<Region>,
    /// The paper's epsilon, as a slope or offset for alpha and beta, and as it is for the attribute.
    pub(crate) epsilon: [f64; 2],
}

/// Counts of work.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Work {
    /// Octant subdivisions.
    pub(crate) subdivisions: u64,
    pub(crate) newton: u64,
    pub(crate) hits: u64,
    /// Lists looked at (one per level), their sizes and the squares of these, the longest.
    pub(crate) lists: u64,
    pub(crate) sizes: u64,
    pub(crate) squares: u64,
    pub(crate) longest: u64,
    pub(crate) limits: u64,
    /// Of the silhouette system.
    pub(crate) silhouettes: silhouette::Work,
    /// Bytes of the octants of one element in one tile, at most.
    pub(crate) octants: u64,
    /// Bytes of the products kept for the frame.
    pub(crate) forms: u64,
}

impl Work {
    pub(crate) fn add(&mut self, o: Self) {
        self.subdivisions += o.subdivisions;
        self.newton += o.newton;
        self.hits += o.hits;
        self.lists += o.lists;
        self.sizes += o.sizes;
        self.squares += o.squares;
        self.limits += o.limits;
        self.silhouettes.subdivisions += o.silhouettes.subdivisions;
        self.silhouettes.points += o.silhouettes.points;
        self.silhouettes.limits += o.silhouettes.limits;
        self.longest = self.longest.max(o.longest);
        self.octants = self.octants.max(o.octants);
        self.forms = self.forms.max(o.forms);
    }
}

/// Element and isovalue.
type Key = (u32, u64);

/// The forms of a frame, made when first needed: all tiles of a camera have one frame.
#[derive(Debug, Default)]
pub(crate) struct Kept(Mutex<Store>);

/// Forms, and their bytes.
#[derive(Debug, Default)]
struct Store {
    forms: HashMap<Key, Arc<Forms>>,
    bytes: usize,
}

impl Kept {
    fn get(&self, key: Key, make: impl FnOnce() -> Forms) -> Arc<Forms> {
        let known = || self.0.lock().ok().and_then(|s| s.forms.get(&key).cloned());
        known().unwrap_or_else(|| {
            let made = Arc::new(make());
            if let Ok(mut s) = self.0.lock()
                && s.bytes < MOST_KEPT
                && s.forms.insert(key, Arc::clone(&made)).is_none()
            {
                s.bytes += made.bytes();
            }
            made
        })
    }

    /// Bytes of all forms.
    pub(crate) fn bytes(&self) -> usize {
        self.0.lock().map_or(0, |s| s.bytes)
    }
}

/// What one part is to a pixel.
pub(crate) struct Seen {
    /// alpha, beta, gamma, W of every coefficient.
    pub(crate) p: Vec<Point>,
    /// Partial derivatives of (alpha, beta, gamma) at the middle.
    pub(crate) jacobian: [DVec3; 3],
}

impl Seen {
    /// A part seen along the ray with this slope.
    pub(crate) fn new(part: &Part, [s, r]: [f64; 2]) -> Self {
        let turned = |l: &Point| [l[0] - s * l[2], l[1] - r * l[2], l[3], l[2]];
        let column = |l: &Point| {
            let l = turned(l);
            DVec3::new(l[0], l[1], l[2])
        };
        Self {
            p: part.p.c.iter().map(turned).collect(),
            jacobian: [1, 2, 3].map(|i| column(&part.middle[i])),
        }
    }
}

/// Results of a tile.
#[derive(Default)]
pub(crate) struct Paper<'a> {
    /// Asked before each part of a list: where the attribute is constant one pixel may take many seconds.
    pub(crate) stop: Option<&'a Stop>,
    pub(crate) found: Vec<Found>,
    /// Points of silhouettes, one for a pixel and part.
    pub(crate) beside: Vec<Found>,
    pub(crate) undecided: Vec<bool>,
    pub(crate) seen: Vec<u32>,
    pub(crate) work: Work,
}

impl Paper<'_> {
    fn is_stopped(&self) -> bool {
        self.stop.is_some_and(Stop::is_raised)
    }

    /// All pixels of a frustum. The elements of a grid are its cells that reach the isovalue, made for the tile.
    pub(crate) fn draw(&mut self, f: &Frustum, wide: &Frustum, index: &Index, manner: &Manner, kept: &Kept) {
        self.found.clear();
        self.beside.clear();
        (self.undecided, self.seen) = (vec![false; f.rays.len()], vec![0; f.rays.len()]);
        let mut stack = Vec::new();
        match index {
            Index::Elements(patches, candidates) => {
                let keep = f.half > 0.0 && candidates.tasks.len() <= KEPT;
                candidates.visit(wide, &mut stack, |task| {
                    let element = &patches.elements[task.element as usize];
                    self.element(f, wide, element, task, manner, keep.then_some(kept));
                });
            }
            Index::Cells(cells) => cells.elements(wide, &mut stack, |element, task, _| {
                self.element(f, wide, element, task, manner, None);
            }),
        }
    }

    /// The pixels that may see an element.
    fn element(&mut self, f: &Frustum, wide: &Frustum, element: &HexElement, task: &Task, manner: &Manner, kept: Option<&Kept>) {
        let Target::Isovalue(c) = task.target else { return };
        if self.is_stopped() {
            return;
        }
        let Some(pixels) = rectangle(wide, element) else { return };
        let make = || Forms::new(f, element, c, manner.region.is_some());
        let forms = kept.map_or_else(|| Arc::new(make()), |k| k.get((task.element, c.to_bits()), make));
        let mut parts = Parts::new(&forms, manner.cutting);
        for y in usize::from(pixels.y0)..=usize::from(pixels.y1) {
            for x in usize::from(pixels.x0)..=usize::from(pixels.x1) {
                self.pixel(f, task, &mut parts, y * f.width + x, manner);
                self.work.octants = self.work.octants.max(parts.bytes() as u64);
                if parts.bytes() > MOST_BYTES {
                    parts.clear();
                }
            }
        }
    }

    /// All roots of one element on one ray, with duplicates; where there are none, points of the silhouette in the pixel.
    fn pixel(&mut self, f: &Frustum, task: &Task, parts: &mut Parts<'_>, pixel: usize, manner: &Manner) {
        let square = manner.region.map(|region| Square {
            slope: f.rays[pixel].slope,
            half: f.half,
            region,
        });
        let (before, known) = (self.work.subdivisions, self.found.len());
        let mut dropped = Vec::new();
        // Case 2: dropped parts that a silhouette may pass through.
        let mut beside = |parts: &mut Parts<'_>, i: usize| {
            if let Some(square) = &square
                && parts.get(i).gamma
                && square.meets(&parts.get(i).p.c)
                && parts.turns(i)
            {
                dropped.push(i);
            }
        };
        let whole = Seen::new(parts.get(0), f.rays[pixel].slope);
        if !holds_origin(Bounds::Aabb, &whole.p, whole.jacobian) {
            beside(parts, 0);
        } else {
            self.subdivide(f, task, parts, pixel, manner, &mut beside);
        }
        self.seen[pixel] += (self.work.subdivisions - before) as u32;
        if let Some(square) = &square
            && self.found.len() == known
        {
            for i in dropped {
                if self.is_stopped() {
                    return;
                }
                self.silhouettes(f, task, parts, i, pixel, square);
            }
        }
    }

    /// The list L of section 4.1.1, level by level; what is dropped goes to `beside`.
    fn subdivide(
        &mut self,
        f: &Frustum,
        task: &Task,
        parts: &mut Parts<'_>,
        pixel: usize,
        manner: &Manner,
        beside: &mut impl FnMut(&mut Parts<'_>, usize),
    ) {
        let slope = f.rays[pixel].slope;
        let mut list = vec![0];
        for level in 0..=DEEPEST {
            let n = list.len() as u64;
            self.work.lists += 1;
            (self.work.sizes, self.work.squares) = (self.work.sizes + n, self.work.squares + n * n);
            self.work.longest = self.work.longest.max(n);
            let mut next = Vec::new();
            for i in list {
                if self.is_stopped() {
                    return;
                }
                if !parts.turns(i)
                    && let Some(u) = self.newton(parts, i, slope, manner.epsilon)
                {
                    self.found.push(hit(f, task, parts.forms, pixel, u));
                    continue;
                }
                if level == DEEPEST {
                    continue;
                }
                self.work.subdivisions += 1;
                let first = parts.octants(i);
                for octant in first..first + 8 {
                    let seen = Seen::new(parts.get(octant), slope);
                    if holds_origin(manner.bounds, &seen.p, seen.jacobian) {
                        next.push(octant);
                    } else {
                        beside(parts, octant);
                    }
                }
            }
            list = next;
            if list.is_empty() {
                return;
            }
            if list.len() > MOST_PARTS {
                self.undecided[pixel] = true;
                self.work.limits += 1;
                return;
            }
        }
    }

    /// A root of P in a part, to epsilon, from the node nearest to the origin.
    fn newton(&mut self, parts: &Parts<'_>, i: usize, [s, r]: [f64; 2], epsilon: [f64; 2]) -> Option<[f64; 3]> {
        let (k, part) = (parts.forms, parts.get(i));
        let turned = |l: &Point| [l[0] - s * l[2], l[1] - r * l[2], l[3], l[2]];
        let far = |l: &Point| {
            let p = turned(l);
            p[0] * p[0] + p[1] * p[1] + p[2] * p[2]
        };
        let c = &part.p.c;
        let nearest = (0..c.len()).min_by(|&a, &b| far(&c[a]).total_cmp(&far(&c[b])))?;
        let (lo, size) = (part.lo, part.size());
        // Nodes of inserted knots may lie beyond the part.
        let node = part.p.node(nearest, lo, size);
        let mut u = [0, 1, 2].map(|a| node[a].clamp(lo[a], lo[a] + size));
        for _ in 0..STEPS {
            self.work.newton += 1;
            let [p, pu, pv, pw] = jet(k.d, &k.lanes, &bases(k.d, u)).map(|l| turned(&l));
            let limit = epsilon[0] * p[3].abs();
            if p[0].abs() < limit && p[1].abs() < limit && p[2].abs() < epsilon[1] {
                return (0..3).all(|a| (lo[a]..=lo[a] + size).contains(&u[a])).then_some(u);
            }
            let j = [0, 1, 2].map(|n| [pu[n], pv[n], pw[n]]);
            let step = product(&inverse(&j)?, [p[0], p[1], p[2]]);
            (0..3).for_each(|a| u[a] -= step[a]);
            if (0..3).any(|a| !(lo[a] - size..=lo[a] + 2.0 * size).contains(&u[a])) {
                return None;
            }
        }
        None
    }

    /// The silhouette system on a dropped part.
    fn silhouettes(&mut self, f: &Frustum, task: &Task, parts: &mut Parts<'_>, i: usize, pixel: usize, square: &Square) {
        let k = parts.forms;
        let place = (parts.get(i).lo, parts.get(i).level);
        let (p, delta, eta) = if parts.cutting == Cutting::Bezier {
            (parts.get(i).p.c.clone(), parts.delta(i).c.clone(), parts.eta(i).c.clone())
        } else {
            let at = |d, c: &[Point]| bezier(d, c, place.0, place.1);
            (at(k.d, &k.lanes), bezier(k.e, &k.delta, place.0, place.1), at(k.q, &k.eta))
        };
        for u in silhouettes(k, square, place, p, delta, &eta, &mut self.work.silhouettes) {
            self.beside.push(hit(f, task, k, pixel, u));
        }
    }

    /// Section 4.2: of one pixel's roots, sorted by t, those whose f' has the sign of the one before are removed; a crowd within an epsilon becomes its two ends.
    pub(crate) fn filter(own: &mut Vec<Found>, direction: DVec3, epsilon: f64) {
        own.sort_by(|a, b| a.surface.cmp(&b.surface).then(a.t.total_cmp(&b.t)));
        let mut kept: Vec<Found> = Vec::with_capacity(own.len());
        for f in own.iter() {
            let sign = f.normal.dot(direction) > 0.0;
            let last = kept.last().filter(|l| l.surface == f.surface);
            if last.is_none_or(|l| (l.normal.dot(direction) > 0.0) != sign) {
                kept.push(*f);
            }
        }
        let crowded = kept.len() > CROWD && kept[kept.len() - 1].t - kept[0].t < epsilon;
        if crowded && let (Some(&a), Some(&b)) = (kept.first(), kept.last()) {
            kept = vec![a, b];
        }
        kept.sort_by(|a, b| a.t.total_cmp(&b.t));
        *own = kept;
    }
}

/// The pixels that an element's control points are about, with half a pixel around.
fn rectangle(wide: &Frustum, e: &HexElement) -> Option<PixelBox> {
    let (mut x, mut y) = ((f64::INFINITY, f64::NEG_INFINITY), (f64::INFINITY, f64::NEG_INFINITY));
    for p in &e.points {
        let d = DVec3::new(p[0], p[1], p[2]) - wide.eye;
        let depth = if wide.parallel { 1.0 } else { wide.forward.dot(d) };
        if depth <= 0.0 {
            return Some(wide.all());
        }
        let (a, b) = (wide.right.dot(d) / depth, wide.up.dot(d) / depth);
        (x, y) = ((x.0.min(a), x.1.max(a)), (y.0.min(b), y.1.max(b)));
    }
    // A millionth for rounding: lists of rays have no half pixel.
    let slack = |q: (f64, f64)| {
        let by = 1e-6 * (q.1 - q.0) + 1e-12 * q.0.abs().max(q.1.abs());
        (q.0 - by, q.1 + by)
    };
    wide.narrow(wide.all(), slack(x), slack(y))
}

fn hit(f: &Frustum, task: &Task, k: &Forms, pixel: usize, u: [f64; 3]) -> Found {
    let [p, pu, pv, pw] = evaluate(k.d, &k.lanes, u);
    let [q, qu, qv, qw] = evaluate(k.d, &k.depth, u);
    let ray = &f.rays[pixel];
    let join = |p: &Point, q: &Point| [p[0], p[1], q[0], q[1]];
    let normal = crate::solve::normal(
        f,
        join(&p, &q),
        [join(&pu, &qu), join(&pv, &qv), join(&pw, &qw)],
        [pu[3], pv[3], pw[3]],
    );
    Found {
        pixel: pixel as u16,
        surface: task.surface,
        certain: false,
        face: false,
        t: (q[0] / q[1] - ray.start) / ray.rate,
        error: 0.0,
        normal,
    }
}
