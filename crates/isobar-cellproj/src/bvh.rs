//! A tree of boxes over active cells, for lists of rays, which share no image plane to project to.

use crate::mesh::{ActiveCell, Cells};
use glam::DVec3;
use isobar_core::Ray;

/// Cells in a leaf, at most.
const LEAF: usize = 4;

#[derive(Debug)]
struct Node {
    lo: DVec3,
    hi: DVec3,
    /// First cell of a leaf, else the second child; the first child follows its parent.
    at: u32,
    /// Cells of a leaf, 0 for an inner node.
    count: u32,
}

/// The tree; cells keep their order inside a leaf, so that what is found does not depend on threads.
#[derive(Debug, Default)]
pub(crate) struct Bvh {
    nodes: Vec<Node>,
    cells: Vec<ActiveCell>,
}

impl Bvh {
    pub(crate) fn new(cells: &Cells, active: &[ActiveCell]) -> Self {
        let mut tree = Self {
            nodes: Vec::with_capacity(active.len() / 2 + 1),
            cells: active.to_vec(),
        };
        if active.is_empty() {
            return tree;
        }
        let centres: Vec<DVec3> = active.iter().map(|a| cells.corners(a.cell).iter().sum()).collect();
        let mut order: Vec<u32> = (0..active.len() as u32).collect();
        tree.build(cells, active, &centres, &mut order, 0);
        tree.cells = order.iter().map(|&i| active[i as usize]).collect();
        tree
    }

    fn build(&mut self, cells: &Cells, active: &[ActiveCell], centres: &[DVec3], order: &mut [u32], first: u32) {
        let (mut lo, mut hi) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (mut least, mut most) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for &i in order.iter() {
            for p in cells.corners(active[i as usize].cell) {
                (lo, hi) = (lo.min(p), hi.max(p));
            }
            let m = centres[i as usize];
            (least, most) = (least.min(m), most.max(m));
        }
        let at = self.nodes.len();
        self.nodes.push(Node {
            lo,
            hi,
            at: first,
            count: order.len() as u32,
        });
        if order.len() <= LEAF {
            return;
        }
        let axis = (most - least).max_position();
        let middle = order.len() / 2;
        order.select_nth_unstable_by(middle, |&a, &b| {
            centres[a as usize][axis]
                .total_cmp(&centres[b as usize][axis])
                .then(a.cmp(&b))
        });
        let (left, right) = order.split_at_mut(middle);
        self.build(cells, active, centres, left, first);
        self.nodes[at].at = self.nodes.len() as u32;
        self.nodes[at].count = 0;
        self.build(cells, active, centres, right, first + middle as u32);
    }

    /// Calls `f` for every cell whose box the ray may meet at t >= 0.
    pub(crate) fn visit(&self, ray: &Ray, mut f: impl FnMut(ActiveCell)) {
        let mut stack = Vec::with_capacity(64);
        if !self.nodes.is_empty() {
            stack.push(0u32);
        }
        while let Some(i) = stack.pop() {
            let n = &self.nodes[i as usize];
            if !meets(ray, n.lo, n.hi) {
                continue;
            }
            if n.count == 0 {
                stack.push(n.at);
                stack.push(i + 1);
            } else {
                self.cells[n.at as usize..(n.at + n.count) as usize]
                    .iter()
                    .for_each(|&c| f(c));
            }
        }
    }

    pub(crate) fn bytes(&self) -> usize {
        self.nodes.len() * size_of::<Node>() + self.cells.len() * size_of::<ActiveCell>()
    }
}

/// Whether a ray may meet a box: never false where it does.
///
/// The t of a plane, (box - o)/d, is two roundings off, relatively; widening each end by 8 units and comparing entry and exit with as much room
/// covers it. Where d is 0 the axis decides by the origin alone.
fn meets(ray: &Ray, lo: DVec3, hi: DVec3) -> bool {
    let (mut from, mut to) = (0.0f64, f64::INFINITY);
    for k in 0..3 {
        let (o, d) = (ray.origin[k], ray.direction[k]);
        if d == 0.0 {
            if o < lo[k] || o > hi[k] {
                return false;
            }
            continue;
        }
        let (a, b) = ((lo[k] - o) / d, (hi[k] - o) / d);
        let (a, b) = (a.min(b), a.max(b));
        from = from.max(a - a.abs() * 8.0 * f64::EPSILON);
        to = to.min(b + b.abs() * 8.0 * f64::EPSILON);
    }
    // NaN does not exclude.
    from <= to || from.is_nan() || to.is_nan()
}
