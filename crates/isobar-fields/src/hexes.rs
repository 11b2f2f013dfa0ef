//! The function of a collection of rational Bezier elements, evaluated by inverting their maps.
//!
//! There is no closed inverse: [`HexField::value`] and [`HexField::gradient`] find u by Newton's method from several starts. That is a convenience for
//! shading, tests and comparisons and comes with **no guarantee**; methods and the oracle work on [`isobar_core::Structure::Elements`].

use crate::hexes_eval::{HexPoint, evaluate_hex};
use glam::{DMat3, DVec3};
use isobar_core::{DataError, Domain, Function, HexElement, HexPatches, Interval, Structure};

/// Elements in a leaf of the tree, at most.
const LEAF: usize = 4;
/// How far outside [0, 1] a parameter still counts as inside.
const OUTSIDE: f64 = 1e-9;
/// Newton steps from one start, at most.
const STEPS: usize = 24;

/// s of [`HexPatches`]: s(x(u)) = a(u). NaN outside the elements; in folds, that of one of the sheets.
///
/// Local coordinates are world displacements from the lower corner of the bounds of the control points, in units of the geometric mean extent of
/// an element (the mean of the logarithms of their boxes' diagonals / sqrt 3), which is so the voxel of [`Domain::voxel`].
#[derive(Debug)]
pub struct HexField {
    patches: HexPatches,
    domain: Domain,
    nodes: Vec<Node>,
    /// Elements in the order of the leaves.
    order: Vec<u32>,
}

/// A box about control points with the range of the coefficients in it.
#[derive(Debug, Clone)]
struct Node {
    lo: DVec3,
    hi: DVec3,
    values: (f64, f64),
    /// First element in `order` of a leaf, else the second child; the first child follows its parent.
    at: u32,
    /// Elements of a leaf, 0 for an inner node.
    count: u32,
}

/// The box about the control points: it holds the element, because weights are positive.
fn bounds(e: &HexElement) -> (DVec3, DVec3) {
    e.points.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), p| {
        let p = DVec3::new(p[0], p[1], p[2]);
        (lo.min(p), hi.max(p))
    })
}

impl HexField {
    /// The function of a collection of elements.
    ///
    /// # Errors
    /// As [`HexPatches::new`], for a collection that was made field by field; [`DataError::Elements`] where all elements are points, or their extent
    /// is beyond f64.
    pub fn new(patches: &HexPatches) -> Result<Self, DataError> {
        let patches = HexPatches::new(patches.elements.clone())?;
        let boxes: Vec<_> = patches.elements.iter().map(bounds).collect();
        let (mut lo, mut hi, mut logs, mut count) = (DVec3::INFINITY, DVec3::NEG_INFINITY, 0.0, 0u32);
        for (a, b) in &boxes {
            (lo, hi) = (lo.min(*a), hi.max(*b));
            let extent = (*b - *a).length() / 3f64.sqrt();
            if extent > 0.0 && extent.is_finite() {
                logs += extent.ln();
                count += 1;
            }
        }
        let extent = (logs / f64::from(count)).exp();
        // Rounded upward, with room: the box only has to hold the elements.
        let far = (hi - lo) / extent * (1.0 + 1e-12) + 1e-9;
        if !(extent > 0.0 && far.is_finite() && (hi - lo).is_finite()) {
            return Err(DataError::Elements("their extent is too large or too small for f64".into()));
        }
        let domain = Domain {
            origin: lo,
            axes: DMat3::from_diagonal(DVec3::splat(extent)),
            lo: DVec3::splat(-1e-9),
            hi: far,
        };
        let mut order: Vec<u32> = (0..boxes.len() as u32).collect();
        let mut nodes = Vec::with_capacity(2 * order.len() / LEAF + 1);
        let values: Vec<_> = patches.elements.iter().map(HexElement::value_range).collect();
        build(&mut nodes, &mut order, 0, &boxes, &values);
        Ok(Self {
            patches,
            domain,
            nodes,
            order,
        })
    }

    /// The elements.
    #[must_use]
    pub fn patches(&self) -> &HexPatches {
        &self.patches
    }

    /// Bytes beyond the elements.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.nodes.len() * size_of::<Node>() + self.order.len() * 4
    }

    /// An element that contains a world point and the parameter there, by Newton's method from the centre and then the corners: the element and
    /// parameter whose position is nearest. No guarantee: `None` may be wrong near degenerate maps.
    #[must_use]
    pub fn locate(&self, x: DVec3) -> Option<(usize, DVec3)> {
        let mut best = None;
        let mut nearest = f64::INFINITY;
        self.visit(
            |n| x.cmpge(n.lo).all() && x.cmple(n.hi).all(),
            |i| {
                if let Some((u, miss)) = invert(&self.patches.elements[i], x)
                    && miss < nearest
                {
                    (best, nearest) = (Some((i, u)), miss);
                }
            },
        );
        best
    }

    fn point(&self, x: DVec3) -> Option<HexPoint> {
        self.locate(x).map(|(i, u)| evaluate_hex(&self.patches.elements[i], u))
    }

    /// Calls `element` for the elements of all leaves below nodes that `enter` accepts.
    fn visit(&self, enter: impl Fn(&Node) -> bool, mut element: impl FnMut(usize)) {
        let mut stack = vec![0u32];
        while let Some(i) = stack.pop() {
            let n = &self.nodes[i as usize];
            if !enter(n) {
                continue;
            }
            if n.count == 0 {
                stack.push(n.at);
                stack.push(i + 1);
            } else {
                let leaf = &self.order[n.at as usize..(n.at + n.count) as usize];
                leaf.iter().for_each(|&e| element(e as usize));
            }
        }
    }
}

/// u with x(u) = `x` inside the closed unit cube and the distance missed, from the first start that gets there.
fn invert(e: &HexElement, x: DVec3) -> Option<(DVec3, f64)> {
    let (lo, hi) = bounds(e);
    let size = (hi - lo).max_element() + 1e-3 * lo.abs().max(hi.abs()).max_element() * f64::EPSILON;
    let starts = std::iter::once(DVec3::splat(0.5))
        .chain((0..8).map(|n| DVec3::new((n & 1) as f64, (n >> 1 & 1) as f64, (n >> 2) as f64) * 0.8 + 0.1));
    for start in starts {
        let mut u = start;
        for _ in 0..STEPS {
            let p = evaluate_hex(e, u);
            let miss = (p.position - x).length();
            let step = p.jacobian.inverse() * (x - p.position);
            if miss <= 1e-12 * size || (miss <= 1e-9 * size && step.abs().max_element() < 1e-12) {
                let inside = u.clamp(DVec3::ZERO, DVec3::ONE);
                if (u - inside).abs().max_element() <= OUTSIDE {
                    return Some((inside, miss));
                }
                break;
            }
            // Steps that leave the cube come back to its border: Newton's method outside it knows nothing of the element.
            u = (u + step).clamp(DVec3::splat(-0.1), DVec3::splat(1.1));
            if !u.is_finite() {
                break;
            }
        }
    }
    None
}

/// Builds the node of `order`, which starts at `first` of the whole, and those below it.
fn build(nodes: &mut Vec<Node>, order: &mut [u32], first: u32, boxes: &[(DVec3, DVec3)], values: &[(f64, f64)]) {
    let mut node = Node {
        lo: DVec3::INFINITY,
        hi: DVec3::NEG_INFINITY,
        values: (f64::INFINITY, f64::NEG_INFINITY),
        at: first,
        count: order.len() as u32,
    };
    let (mut least, mut most) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let centre = |e: u32| (boxes[e as usize].0 + boxes[e as usize].1) * 0.5;
    for &e in order.iter() {
        let ((lo, hi), (a, b)) = (boxes[e as usize], values[e as usize]);
        (node.lo, node.hi) = (node.lo.min(lo), node.hi.max(hi));
        node.values = (node.values.0.min(a), node.values.1.max(b));
        (least, most) = (least.min(centre(e)), most.max(centre(e)));
    }
    // Points on a face of the box, rounded, are looked for too.
    let slack = 1e-12 * (node.hi - node.lo).max_element() + 4.0 * f64::EPSILON * node.lo.abs().max(node.hi.abs()).max_element();
    node.lo -= slack;
    node.hi += slack;
    let at = nodes.len();
    nodes.push(node);
    if order.len() <= LEAF {
        return;
    }
    let axis = (most - least).max_position();
    let middle = order.len() / 2;
    order.select_nth_unstable_by(middle, |&a, &b| centre(a)[axis].total_cmp(&centre(b)[axis]));
    let (left, right) = order.split_at_mut(middle);
    build(nodes, left, first, boxes, values);
    let second = nodes.len() as u32;
    build(nodes, right, first + middle as u32, boxes, values);
    nodes[at].count = 0;
    nodes[at].at = second;
}

impl Function for HexField {
    fn name(&self) -> String {
        "attribute on rational Bezier elements".into()
    }

    fn domain(&self) -> &Domain {
        &self.domain
    }

    /// NaN outside the elements. No guarantee, see [`HexField::locate`].
    fn value(&self, x: DVec3) -> f64 {
        self.point(x).map_or(f64::NAN, |p| p.value)
    }

    /// 0 outside the elements and where the Jacobian is singular. No guarantee, see [`HexField::locate`].
    fn gradient(&self, x: DVec3) -> DVec3 {
        self.point(x).map_or(DVec3::ZERO, |p| p.gradient())
    }

    /// The range of the coefficients of all elements whose boxes meet the box; of all coefficients where none do.
    fn enclosure(&self, lo: DVec3, hi: DVec3) -> Interval {
        let (a, b) = (
            self.domain.world(lo.max(self.domain.lo)),
            self.domain.world(hi.min(self.domain.hi)),
        );
        // The world position is rounded; the widening of the nodes covers it on one side, this on the other.
        let slack = 1e-12 * (a.abs().max(b.abs()).max_element() + (b - a).abs().max_element());
        let (a, b) = (a - slack, b + slack);
        let mut range: Option<(f64, f64)> = None;
        self.visit(
            |n| a.cmple(n.hi).all() && b.cmpge(n.lo).all(),
            |i| {
                let (x, y) = self.patches.elements[i].value_range();
                range = Some(range.map_or((x, y), |(lo, hi)| (lo.min(x), hi.max(y))));
            },
        );
        let (lo, hi) = range.unwrap_or(self.nodes[0].values);
        Interval { lo, hi }
    }

    fn structure(&self) -> Structure<'_> {
        Structure::Elements(&self.patches)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid_to_hexes;
    use isobar_core::{Grid, Samples};

    #[test]
    fn a_linear_field_is_reproduced_and_ends_at_the_elements() {
        let s: Vec<f32> = (0..125)
            .map(|i| (i % 5) as f32 + 2.0 * (i / 5 % 5) as f32 - (i / 25) as f32)
            .collect();
        let grid = Grid::unit([5; 3], Samples::F32(s.into())).unwrap();
        let f = HexField::new(&grid_to_hexes(&grid).unwrap()).unwrap();
        assert!((f.domain().voxel() - 1.0).abs() < 1e-12 && f.bytes() > 0);
        for n in 0..200 {
            let x = DVec3::new((n % 6) as f64, (n / 6 % 6) as f64, (n / 36) as f64) * 0.79 + 0.02;
            let want = x.x + 2.0 * x.y - x.z;
            assert!((f.value(x) - want).abs() < 1e-12, "{x}");
            assert!((f.gradient(x) - DVec3::new(1.0, 2.0, -1.0)).length() < 1e-11);
            let u = f.domain().local(x);
            let e = f.enclosure(u - 0.05, u + 0.05);
            assert!(e.lo <= want - 0.05 && want + 0.05 <= e.hi && e.hi - e.lo < 20.0);
        }
        assert!(f.value(DVec3::splat(4.01)).is_nan() && f.gradient(DVec3::splat(-1.0)) == DVec3::ZERO);
    }

    #[test]
    fn curved_elements_are_inverted() {
        // x = (2u - u^2, v, w): the attribute u is 1 - sqrt(1 - x)
        let e = HexElement {
            degree: [2, 1, 1],
            points: (0..12)
                .map(|n| [[0.0, 1.0, 1.0][n % 3], (n / 3 % 2) as f64, (n / 6) as f64, 1.0])
                .collect(),
            value_degree: [1, 0, 0],
            values: vec![0.0, 1.0].into(),
            rational_value: false,
        };
        let f = HexField::new(&HexPatches::new(vec![e]).unwrap()).unwrap();
        for x in [0.0, 0.1, 0.5, 0.9, 0.99] {
            assert!(
                (f.value(DVec3::new(x, 0.3, 0.7)) - (1.0 - (1.0 - x).sqrt())).abs() < 1e-10,
                "{x}"
            );
        }
    }

    #[test]
    fn points_and_infinite_extents_are_refused() {
        let element = |scale: f64| HexElement {
            degree: [1; 3],
            points: (0..8)
                .map(|n| [scale * f64::from(n & 1) - 0.5 * scale, 0.0, 0.0, 1.0])
                .collect(),
            value_degree: [0; 3],
            values: vec![0.0].into(),
            rational_value: false,
        };
        for scale in [0.0, f64::MAX] {
            let patches = HexPatches::new(vec![element(scale)]).unwrap();
            assert!(HexField::new(&patches).unwrap_err().to_string().contains("extent"), "{scale}");
        }
    }
}
