//! The parts of an element in the paper's subdivision (section 4.1.1): octants of its parameters with the coefficients of P, delta and eta.
//!
//! All pixels cut an element in the same places, so an octant is made once for a tile and kept: what is counted (subdivisions, sizes of lists) is what each pixel does for itself, as printed,
//! what is computed is shared. alpha and beta of a pixel are linear in what is kept.
//!
//! **Two ways of cutting** ("Bezier subdivision or knot insertion"): de Casteljau at the middle, which gives each half its Bernstein coefficients; or the middle as one more knot of the B-spline
//! that the element is, with the middles of all other spans of the level, which leaves a wider net, because a part has simple knots it shares with its neighbours.

use crate::bernstein::{Lanes, Point, bases, halve, jet, range};
use crate::paper_forms::Forms;

/// How parts are cut.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Cutting {
    Bezier,
    Knots,
}

/// Coefficients of a part, and the knots they belong to where these are not the Bezier ones: 2 d per axis about the part's own span.
#[derive(Debug, Clone)]
pub(crate) struct Net<T> {
    pub(crate) d: [usize; 3],
    pub(crate) c: Vec<T>,
    knots: Option<Box<[Vec<f64>; 3]>>,
}

impl<T: Lanes> Net<T> {
    pub(crate) fn new(d: [usize; 3], c: Vec<T>, cutting: Cutting) -> Self {
        let own = |d: usize| [vec![0.0; d], vec![1.0; d]].concat();
        Self {
            d,
            c,
            knots: (cutting == Cutting::Knots).then(|| Box::new(d.map(own))),
        }
    }

    const fn empty() -> Self {
        Self {
            d: [0; 3],
            c: Vec::new(),
            knots: None,
        }
    }

    /// The part of one side of the middle along an axis.
    fn half(&self, axis: usize, upper: bool) -> Self {
        let n = self.d[axis];
        if n == 0 {
            return self.clone();
        }
        match &self.knots {
            None => {
                let (mut c, mut lower) = (self.c.clone(), self.c.clone());
                halve(self.d, axis, &mut c, &mut lower);
                Self {
                    d: self.d,
                    c: if upper { c } else { lower },
                    knots: None,
                }
            }
            Some(knots) => self.inserted(axis, upper, knots),
        }
    }

    /// The half's coefficients in the spline whose knots stand at every multiple of the half's length inside [0, 1] (the ends d fold): all parts of a level are windows of the one spline that
    /// midpoint insertion into every span gives. Each is a blossom of the part's own ones.
    fn inserted(&self, axis: usize, upper: bool, knots: &[Vec<f64>; 3]) -> Self {
        let (n, t) = (self.d[axis], &knots[axis]);
        let half = 0.5 * (t[n] - t[n - 1]);
        let start = t[n - 1] + if upper { half } else { 0.0 };
        let own: Vec<f64> = (0..2 * n)
            .map(|j| (start + (j as f64 - (n - 1) as f64) * half).clamp(0.0, 1.0))
            .collect();
        let weights: Vec<Vec<f64>> = (0..=n).map(|i| blossom(n, t, &own[i..i + n])).collect();
        let stride: usize = self.d[..axis].iter().map(|d| d + 1).product();
        let mut c = Vec::with_capacity(self.c.len());
        for block in self.c.chunks_exact(stride * (n + 1)) {
            for w in &weights {
                for s in 0..stride {
                    let sum = |sum: T, (i, &w): (usize, &f64)| sum.plus(w, block[i * stride + s]);
                    c.push(w.iter().enumerate().fold(T::ZERO, sum));
                }
            }
        }
        let mut more = knots.clone();
        more[axis] = own;
        Self {
            d: self.d,
            c,
            knots: Some(Box::new(more)),
        }
    }

    /// Octant n: bit a is the side along axis a.
    fn octant(&self, n: usize) -> Self {
        self.half(0, n & 1 == 1).half(1, n >> 1 & 1 == 1).half(2, n >> 2 == 1)
    }

    /// All eight, at the cost of seven cuts.
    fn octants(&self) -> Vec<Self> {
        let mut parts = vec![self.clone()];
        for axis in 0..3 {
            parts = [false, true]
                .iter()
                .flat_map(|&u| parts.iter().map(move |p| p.half(axis, u)))
                .collect();
        }
        parts
    }

    /// The node of coefficient `i` in the parameters of the element, of a part that starts at `lo` with edges of `size`.
    pub(crate) fn node(&self, i: usize, lo: [f64; 3], size: f64) -> [f64; 3] {
        let n = self.d.map(|d| d + 1);
        let at = [i % n[0], i / n[0] % n[1], i / n[0] / n[1]];
        [0, 1, 2].map(|a| {
            let d = self.d[a];
            match &self.knots {
                _ if d == 0 => lo[a] + 0.5 * size,
                None => lo[a] + size * (at[a] as f64 / d as f64),
                Some(k) => k[a][at[a]..at[a] + d].iter().sum::<f64>() / d as f64,
            }
        })
    }

    fn bytes(&self) -> usize {
        self.c.len() * size_of::<T>() + self.knots.as_ref().map_or(0, |k| k.iter().map(|k| k.len() * 8).sum())
    }
}

/// The blossom at `at` as weights of the coefficients with the local knots `t`.
fn blossom(n: usize, t: &[f64], at: &[f64]) -> Vec<f64> {
    let unit = |i: usize| {
        let mut c: Vec<f64> = (0..=n).map(|j| if i == j { 1.0 } else { 0.0 }).collect();
        for (r, x) in (1..=n).zip(at) {
            for j in (r..=n).rev() {
                let (lo, hi) = (t[j - 1], t[j + n - r]);
                let by = (x - lo) / (hi - lo);
                c[j] = c[j - 1] + (c[j] - c[j - 1]) * by;
            }
        }
        c[n]
    };
    (0..=n).map(unit).collect()
}

/// An octant.
#[derive(Debug)]
pub(crate) struct Part {
    pub(crate) lo: [f64; 3],
    pub(crate) level: u8,
    /// x, y, W, gamma.
    pub(crate) p: Net<Point>,
    /// Value and partial derivatives of the same at the middle.
    pub(crate) middle: [Point; 4],
    /// Whether gamma has both signs.
    pub(crate) gamma: bool,
    /// Empty until asked for.
    delta: Net<f64>,
    eta: Net<Point>,
    /// Whether delta has both signs, where known.
    turns: Option<bool>,
    /// The first of eight parts; 0 where there are none yet.
    children: usize,
    /// Part and octant of it that this is.
    parent: (usize, usize),
}

impl Part {
    pub(crate) fn size(&self) -> f64 {
        0.5f64.powi(i32::from(self.level))
    }
}

/// The parts of one element made so far; the first is the whole.
#[derive(Debug)]
pub(crate) struct Parts<'a> {
    pub(crate) forms: &'a Forms,
    pub(crate) cutting: Cutting,
    parts: Vec<Part>,
    bytes: usize,
}

impl<'a> Parts<'a> {
    pub(crate) fn new(forms: &'a Forms, cutting: Cutting) -> Self {
        let mut out = Self {
            forms,
            cutting,
            parts: Vec::new(),
            bytes: 0,
        };
        out.clear();
        out
    }

    /// Forgets all parts but the whole.
    pub(crate) fn clear(&mut self) {
        let k = self.forms;
        self.parts.clear();
        self.bytes = 0;
        let whole = self.part([0.0; 3], 0, Net::new(k.d, k.lanes.clone(), self.cutting), (0, 0));
        self.parts.push(Part {
            delta: Net::new(k.e, k.delta.clone(), self.cutting),
            eta: Net::new(k.q, k.eta.clone(), self.cutting),
            ..whole
        });
    }

    fn part(&mut self, lo: [f64; 3], level: u8, p: Net<Point>, parent: (usize, usize)) -> Part {
        let size = 0.5f64.powi(i32::from(level));
        let middle = lo.map(|x| x + 0.5 * size);
        let (least, most) = range(&p.c);
        self.bytes += p.bytes() + size_of::<Part>();
        Part {
            lo,
            level,
            middle: jet(p.d, &self.forms.lanes, &bases(p.d, middle)),
            gamma: least[3] <= 0.0 && most[3] >= 0.0,
            p,
            delta: Net::empty(),
            eta: Net::empty(),
            turns: None,
            children: 0,
            parent,
        }
    }

    pub(crate) fn get(&self, i: usize) -> &Part {
        &self.parts[i]
    }

    /// Bytes of all parts.
    pub(crate) fn bytes(&self) -> usize {
        self.bytes
    }

    /// The first of the eight octants of a part.
    pub(crate) fn octants(&mut self, i: usize) -> usize {
        if self.parts[i].children == 0 {
            let (lo, level) = (self.parts[i].lo, self.parts[i].level + 1);
            let size = 0.5f64.powi(i32::from(level));
            let first = self.parts.len();
            for (n, p) in self.parts[i].p.octants().into_iter().enumerate() {
                // Octants are in the order of their bits: the first axis was cut first and so varies fastest.
                let at = [0, 1, 2].map(|a| lo[a] + if n >> a & 1 == 1 { size } else { 0.0 });
                let part = self.part(at, level, p, (i, n));
                self.parts.push(part);
            }
            self.parts[i].children = first;
        }
        self.parts[i].children
    }

    /// Whether delta has both signs on a part, so that the surface may turn about there.
    pub(crate) fn turns(&mut self, i: usize) -> bool {
        if let Some(t) = self.parts[i].turns {
            return t;
        }
        let (lo, hi) = range(&self.delta(i).c);
        let t = !(lo > 0.0 || hi < 0.0);
        self.parts[i].turns = Some(t);
        t
    }

    /// delta of a part.
    pub(crate) fn delta(&mut self, i: usize) -> &Net<f64> {
        if self.parts[i].delta.c.is_empty() {
            let (parent, n) = self.parts[i].parent;
            let own = self.delta(parent).octant(n);
            self.bytes += own.bytes();
            self.parts[i].delta = own;
        }
        &self.parts[i].delta
    }

    /// E0, E1, E2 of a part; the forms have them.
    pub(crate) fn eta(&mut self, i: usize) -> &Net<Point> {
        if i != 0 && self.parts[i].eta.c.is_empty() {
            let (parent, n) = self.parts[i].parent;
            let own = self.eta(parent).octant(n);
            self.bytes += own.bytes();
            self.parts[i].eta = own;
        }
        &self.parts[i].eta
    }
}

/// Bernstein coefficients on an octant, however the parts are cut.
pub(crate) fn bezier<T: Lanes>(d: [usize; 3], c: &[T], lo: [f64; 3], level: u8) -> Vec<T> {
    let mut net = Net::new(d, c.to_vec(), Cutting::Bezier);
    let mut rest = lo;
    for _ in 0..level {
        rest = rest.map(|x| 2.0 * x);
        net = net.octant((0..3).map(|a| usize::from(rest[a] >= 1.0) << a).sum());
        rest = rest.map(|x| if x >= 1.0 { x - 1.0 } else { x });
    }
    net.c
}

#[cfg(test)]
mod tests {
    use super::*;
    use isobar_fields::hexes_bezier::insert_knot;

    /// Both cuts are of the same polynomial: its range narrows to the value at the point.
    #[test]
    fn parts_close_in_on_the_value() {
        let d = [3, 2, 1];
        let c: Vec<f64> = (0..24).map(|i| f64::from(i * i * 7 % 23) - 9.0).collect();
        let u = [0.37, 0.81, 0.5];
        let want = jet(d, &c, &bases(d, u))[0];
        for cutting in [Cutting::Bezier, Cutting::Knots] {
            let mut net = Net::new(d, c.clone(), cutting);
            let (mut lo, mut size, mut before) = ([0.0f64; 3], 1.0, f64::INFINITY);
            for _ in 0..12 {
                size *= 0.5;
                let n = (0..3).map(|a| usize::from(u[a] >= lo[a] + size) << a).sum::<usize>();
                net = net.octant(n);
                (0..3).for_each(|a| lo[a] += if n >> a & 1 == 1 { size } else { 0.0 });
                let (least, most) = range(&net.c);
                assert!(
                    least <= want + 1e-12 && want <= most + 1e-12,
                    "{cutting:?} {least} {want} {most}"
                );
                assert!(most - least <= before + 1e-12);
                before = most - least;
            }
            assert!(before < 0.05, "{cutting:?} {before}");
            let node = net.node(0, lo, size);
            assert!((0..3).all(|a| (node[a] - u[a]).abs() < 3.0 * size), "{cutting:?} {node:?}");
        }
    }

    #[test]
    fn octants_by_their_corner_are_those_by_their_path() {
        let c: Vec<f64> = (0..12).map(f64::from).collect();
        let net = Net::new([2, 1, 1], c.clone(), Cutting::Bezier);
        assert_eq!(bezier([2, 1, 1], &c, [0.25, 0.5, 0.75], 2), net.octant(0b110).octant(0b101).c);
    }

    /// One knot by Boehm's rule on the whole spline: the parts' coefficients are windows of it.
    #[test]
    fn inserted_knots_are_boehm_s() {
        let c = vec![1.0, 4.0, -2.0, 3.0];
        let knots = vec![0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0];
        let near = |a: &[f64], b: &[f64]| a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-14);
        let (more, whole) = insert_knot(3, &knots, &c, &0.5).unwrap();
        let net = Net::new([3, 0, 0], c, Cutting::Knots);
        assert!(near(&net.octant(0).c, &whole[..4]) && near(&net.octant(1).c, &whole[1..]));
        let (more, whole) = insert_knot(3, &more, &whole, &0.25).unwrap();
        let (_, whole) = insert_knot(3, &more, &whole, &0.75).unwrap();
        for (i, (a, b)) in [(0, 0), (0, 1), (1, 0), (1, 1)].into_iter().enumerate() {
            assert!(near(&net.octant(a).octant(b).c, &whole[i..i + 4]), "{i}");
        }
        // Bezier's halves have their ends on the curve, and so tighter nets.
        let width = |n: &Net<f64>| range(&n.c).1 - range(&n.c).0;
        let bezier = Net::new([3, 0, 0], vec![1.0, 4.0, -2.0, 3.0], Cutting::Bezier);
        assert!(width(&bezier.octant(1).octant(0)) < width(&net.octant(1).octant(0)));
    }
}
