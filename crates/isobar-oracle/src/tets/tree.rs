//! A tree of boxes over the cells of a mesh, with the range of the values in each, and which faces of a cell bound the mesh.

use crate::extremum::far;
use isobar_core::{DVec3, Ray, TetMesh};
use std::collections::HashMap;

/// Cells in a leaf, at most.
const LEAF: usize = 4;

/// See the module.
#[derive(Debug)]
pub(crate) struct Index {
    nodes: Vec<Node>,
    order: Vec<u32>,
    /// Per cell: bit k tells that no other cell has the face opposite corner k.
    outer: Vec<u8>,
    /// Whether all points and values are 0 or of a magnitude that double-double arithmetic can multiply often enough.
    pub(crate) moderate: bool,
}

#[derive(Debug, Clone)]
struct Node {
    lo: DVec3,
    hi: DVec3,
    least: f64,
    greatest: f64,
    /// First cell of a leaf in `order`, else the second child; the first child follows its parent.
    at: u32,
    /// Cells of a leaf, 0 for an inner node.
    count: u32,
}

/// 0, or within 2^-120 and 2^120.
pub(crate) fn moderate(x: f64) -> bool {
    x == 0.0 || (7.6e-37..=1.3e36).contains(&x.abs())
}

impl Index {
    pub(crate) fn new(mesh: &TetMesh) -> Self {
        let mut order: Vec<u32> = (0..mesh.cells.len() as u32).collect();
        let centres: Vec<DVec3> = mesh
            .cells
            .iter()
            .map(|c| c.iter().map(|&i| mesh.points[i as usize] * 0.25).sum())
            .collect();
        let mut nodes = Vec::with_capacity(order.len());
        build(&mut nodes, &mut order, 0, mesh, &centres);
        Self {
            nodes,
            order,
            outer: outer_faces(mesh),
            moderate: mesh.points.iter().all(|p| p.to_array().into_iter().all(moderate))
                && mesh.values.iter().all(|&v| moderate(f64::from(v))),
        }
    }

    /// Whether the face of `cell` opposite corner k is on the boundary of the mesh.
    pub(crate) fn is_outer(&self, cell: u32, k: usize) -> bool {
        self.outer[cell as usize] >> k & 1 == 1
    }

    /// All cells whose box the ray meets at a t in `[from, until]` and whose values come near c, in no order; perhaps some more.
    pub(crate) fn gather(&self, ray: &Ray, c: f64, from: f64, until: f64, out: &mut Vec<u32>) {
        self.gather_where(ray, |least, greatest| far(least, greatest, c), from, until, out);
    }

    /// The same, leaving out boxes by the range of the values in them.
    pub(crate) fn gather_where(&self, ray: &Ray, without: impl Fn(f64, f64) -> bool, from: f64, until: f64, out: &mut Vec<u32>) {
        /// 8u: above the 3u of a difference, a reciprocal and a product.
        const SLACK: f64 = 4.0 * f64::EPSILON;
        let inverse = 1.0 / ray.direction;
        let mut stack = vec![0u32];
        while let Some(i) = stack.pop() {
            let n = &self.nodes[i as usize];
            if without(n.least, n.greatest) {
                continue;
            }
            let (mut enter, mut leave) = (from, until);
            let mut beside = false;
            for a in 0..3 {
                let (lo, hi) = (n.lo[a] - ray.origin[a], n.hi[a] - ray.origin[a]);
                if ray.direction[a] == 0.0 {
                    beside |= lo > 0.0 || hi < 0.0;
                } else if inverse[a].is_finite() {
                    let (x, y) = (lo * inverse[a], hi * inverse[a]);
                    let (x, y) = if x <= y { (x, y) } else { (y, x) };
                    // Differences, reciprocals and products are wrong by 3u, and by the smallest number where they vanish.
                    enter = enter.max(x - SLACK * x.abs() - f64::MIN_POSITIVE);
                    leave = leave.min(y + SLACK * y.abs() + f64::MIN_POSITIVE);
                }
            }
            if beside || enter > leave {
                continue;
            }
            if n.count == 0 {
                stack.push(n.at);
                stack.push(i + 1);
            } else {
                out.extend_from_slice(&self.order[n.at as usize..(n.at + n.count) as usize]);
            }
        }
    }
}

fn build(nodes: &mut Vec<Node>, order: &mut [u32], first: u32, mesh: &TetMesh, centres: &[DVec3]) {
    let mut node = Node {
        lo: DVec3::INFINITY,
        hi: DVec3::NEG_INFINITY,
        least: f64::INFINITY,
        greatest: f64::NEG_INFINITY,
        at: first,
        count: order.len() as u32,
    };
    let (mut least, mut most) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for &c in order.iter() {
        for i in mesh.cells[c as usize] {
            let (p, v) = (mesh.points[i as usize], f64::from(mesh.values[i as usize]));
            (node.lo, node.hi) = (node.lo.min(p), node.hi.max(p));
            (node.least, node.greatest) = (node.least.min(v), node.greatest.max(v));
        }
        (least, most) = (least.min(centres[c as usize]), most.max(centres[c as usize]));
    }
    let at = nodes.len();
    nodes.push(node);
    if order.len() <= LEAF {
        return;
    }
    let axis = (most - least).max_position();
    let middle = order.len() / 2;
    order.select_nth_unstable_by(middle, |&a, &b| {
        centres[a as usize][axis].total_cmp(&centres[b as usize][axis])
    });
    let (left, right) = order.split_at_mut(middle);
    build(nodes, left, first, mesh, centres);
    let second = nodes.len() as u32;
    build(nodes, right, first + middle as u32, mesh, centres);
    nodes[at].at = second;
    nodes[at].count = 0;
}

/// Faces are the same where their corners have the same coordinates, whatever their indices.
fn outer_faces(mesh: &TetMesh) -> Vec<u8> {
    let mut ids: HashMap<[u64; 3], u32> = HashMap::with_capacity(mesh.points.len());
    let same: Vec<u32> = (0..)
        .zip(mesh.points.iter())
        // + 0 makes -0 and 0 one
        .map(|(i, p)| *ids.entry(p.to_array().map(|x| (x + 0.0).to_bits())).or_insert(i))
        .collect();
    let mut faces: Vec<([u32; 3], u32, u8)> = Vec::with_capacity(4 * mesh.cells.len());
    for (n, c) in (0..).zip(mesh.cells.iter()) {
        for k in 0..4u8 {
            let k3 = usize::from(k);
            let mut f = [c[(k3 + 1) % 4], c[(k3 + 2) % 4], c[(k3 + 3) % 4]].map(|i| same[i as usize]);
            f.sort_unstable();
            faces.push((f, n, k));
        }
    }
    faces.sort_unstable();
    let mut outer = vec![0u8; mesh.cells.len()];
    for group in faces.chunk_by(|a, b| a.0 == b.0) {
        if let [(_, cell, k)] = group {
            outer[*cell as usize] |= 1 << k;
        }
    }
    outer
}
