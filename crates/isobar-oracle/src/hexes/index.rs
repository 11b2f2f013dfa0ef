//! A tree of boxes over elements, with the range of the attribute in each, and which faces bound the whole.
//!
//! An element lies in the box of its control points, and its attribute between its least and greatest coefficient, because weights are positive: no
//! rounding in either.

use crate::extremum::far;
use isobar_core::{DVec3, HexElement, HexPatches, Ray};
use std::{collections::HashMap, sync::OnceLock};

/// Elements in a leaf, at most.
const LEAF: usize = 2;

/// See the module.
#[derive(Debug)]
pub(crate) struct Index {
    nodes: Vec<Node>,
    order: Vec<u32>,
    own: Vec<Extent>,
    /// Whether all numbers are small enough for the bounds of `forms`.
    pub(super) moderate: bool,
    /// Per element: bit `2 axis + side` tells that no other element has this face. Made when first asked for.
    outer: OnceLock<Vec<u8>>,
}

/// The box of an element and the range of its attribute.
#[derive(Debug, Clone, Copy)]
struct Extent {
    lo: DVec3,
    hi: DVec3,
    least: f64,
    greatest: f64,
}

#[derive(Debug, Clone)]
struct Node {
    extent: Extent,
    /// First element of a leaf in `order`, else the second child; the first child follows its parent.
    at: u32,
    /// Elements of a leaf, 0 for an inner node.
    count: u32,
}

impl Extent {
    const NONE: Self = Self {
        lo: DVec3::INFINITY,
        hi: DVec3::NEG_INFINITY,
        least: f64::INFINITY,
        greatest: f64::NEG_INFINITY,
    };

    fn of(e: &HexElement) -> Self {
        let (least, greatest) = e.value_range();
        let start = Self {
            least,
            greatest,
            ..Self::NONE
        };
        e.points.iter().fold(start, |x, p| {
            let p = DVec3::new(p[0], p[1], p[2]);
            Self {
                lo: x.lo.min(p),
                hi: x.hi.max(p),
                ..x
            }
        })
    }

    fn with(self, o: &Self) -> Self {
        Self {
            lo: self.lo.min(o.lo),
            hi: self.hi.max(o.hi),
            least: self.least.min(o.least),
            greatest: self.greatest.max(o.greatest),
        }
    }

    /// Where the ray is in the box, rounded outward.
    fn stay(&self, ray: &Ray, inverse: DVec3, from: f64, until: f64) -> Option<(f64, f64)> {
        /// 8u: above the 3u of a difference, a reciprocal and a product.
        const SLACK: f64 = 4.0 * f64::EPSILON;
        let (mut enter, mut leave) = (from, until);
        for a in 0..3 {
            let (lo, hi) = (self.lo[a] - ray.origin[a], self.hi[a] - ray.origin[a]);
            if ray.direction[a] == 0.0 {
                if lo > 0.0 || hi < 0.0 {
                    return None;
                }
            } else if inverse[a].is_finite() {
                let (x, y) = (lo * inverse[a], hi * inverse[a]);
                let (x, y) = if x <= y { (x, y) } else { (y, x) };
                enter = enter.max(x - SLACK * x.abs() - f64::MIN_POSITIVE);
                leave = leave.min(y + SLACK * y.abs() + f64::MIN_POSITIVE);
            }
        }
        (enter <= leave).then_some((enter, leave))
    }
}

/// An element on the ray's way.
#[derive(Clone, Copy, Debug)]
pub(super) struct Candidate {
    pub(super) element: u32,
    /// Where the ray is in its box.
    pub(super) stay: (f64, f64),
}

impl Index {
    pub(crate) fn new(patches: &HexPatches) -> Self {
        let elements = &patches.elements;
        let own: Vec<Extent> = elements.iter().map(Extent::of).collect();
        let mut order: Vec<u32> = (0..elements.len() as u32).collect();
        let mut nodes = Vec::with_capacity(2 * order.len());
        build(&mut nodes, &mut order, 0, &own);
        let numbers = |e: &HexElement| e.points.iter().flatten().chain(&e.values).all(|&x| super::moderate(x));
        Self {
            nodes,
            order,
            own,
            moderate: elements.iter().all(numbers),
            outer: OnceLock::new(),
        }
    }

    /// The faces (axis, 0 or 1) of an element that no other has.
    pub(super) fn outer(&self, patches: &HexPatches, element: u32) -> impl Iterator<Item = (usize, f64)> + use<> {
        let bits = self.outer.get_or_init(|| outer_faces(&patches.elements))[element as usize];
        (0..6).filter(move |n| bits >> n & 1 == 1).map(|n| (n / 2, (n % 2) as f64))
    }

    /// All elements whose box the ray meets at a t in `[from, until]` and whose attribute comes near the value, if one is given, by the t where the ray
    /// enters their box; perhaps some more.
    pub(super) fn gather(&self, ray: &Ray, value: Option<f64>, from: f64, until: f64) -> Vec<Candidate> {
        let inverse = 1.0 / ray.direction;
        let apart = |x: &Extent| value.is_some_and(|c| far(x.least, x.greatest, c));
        let mut out = Vec::new();
        let mut stack = vec![0u32];
        while let Some(i) = stack.pop() {
            let n = &self.nodes[i as usize];
            if apart(&n.extent) || n.extent.stay(ray, inverse, from, until).is_none() {
                continue;
            }
            if n.count == 0 {
                stack.push(n.at);
                stack.push(i + 1);
                continue;
            }
            for &element in &self.order[n.at as usize..(n.at + n.count) as usize] {
                let x = &self.own[element as usize];
                if let (false, Some(stay)) = (apart(x), x.stay(ray, inverse, from, until)) {
                    out.push(Candidate { element, stay });
                }
            }
        }
        out.sort_by(|a, b| a.stay.0.total_cmp(&b.stay.0).then(a.element.cmp(&b.element)));
        out
    }
}

fn build(nodes: &mut Vec<Node>, order: &mut [u32], first: u32, own: &[Extent]) {
    let (mut least, mut most) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    // Halved first: sums of large numbers stay finite.
    let centre = |e: u32| 0.5 * own[e as usize].lo + 0.5 * own[e as usize].hi;
    let mut extent = Extent::NONE;
    for &e in order.iter() {
        extent = extent.with(&own[e as usize]);
        (least, most) = (least.min(centre(e)), most.max(centre(e)));
    }
    let at = nodes.len();
    nodes.push(Node {
        extent,
        at: first,
        count: order.len() as u32,
    });
    if order.len() <= LEAF {
        return;
    }
    let axis = (most - least).max_position();
    let middle = order.len() / 2;
    order.select_nth_unstable_by(middle, |&a, &b| centre(a)[axis].total_cmp(&centre(b)[axis]));
    let (left, right) = order.split_at_mut(middle);
    build(nodes, left, first, own);
    let second = nodes.len() as u32;
    build(nodes, right, first + middle as u32, own);
    nodes[at].at = second;
    nodes[at].count = 0;
}

/// The control points of a face, in an order that does not depend on how the element is turned.
fn face(e: &HexElement, axis: usize, side: usize) -> Vec<[u64; 4]> {
    let n = e.degree.map(|d| usize::from(d) + 1);
    let index = |at: usize| [at % n[0], at / n[0] % n[1], at / n[0] / n[1]];
    let wanted = side * (n[axis] - 1);
    let mut points: Vec<[u64; 4]> = (0..e.points.len())
        .filter(|&at| index(at)[axis] == wanted)
        // + 0 makes -0 and 0 one
        .map(|at| e.points[at].map(|x| (x + 0.0).to_bits()))
        .collect();
    points.sort_unstable();
    points
}

/// Faces are the same where their control points are, bit by bit.
fn outer_faces(elements: &[HexElement]) -> Vec<u8> {
    let mut faces: HashMap<Vec<[u64; 4]>, Vec<(u32, u8)>> = HashMap::with_capacity(3 * elements.len());
    for (n, e) in (0..).zip(elements) {
        for k in 0..6u8 {
            let key = face(e, usize::from(k) / 2, usize::from(k) % 2);
            faces.entry(key).or_default().push((n, k));
        }
    }
    let mut outer = vec![0u8; elements.len()];
    for (n, k) in faces.into_values().filter(|v| v.len() == 1).flatten() {
        outer[n as usize] |= 1 << k;
    }
    outer
}
