//! The piecewise linear function of a tetrahedral mesh, located by a tree of boxes.
//!
//! Each cell with a volume has its own linear function through the values at its four corners; neighbours that share a face agree on it. The function is
//! defined on the closed cells only: outside them `value` is NaN and `gradient` 0.

use glam::{DMat3, DVec3};
use isobar_core::{DataError, Domain, Function, Interval, Structure, TetMesh};

/// Cells in a leaf of the tree, at most.
const LEAF: usize = 8;
/// How far outside a cell, in barycentric coordinates, a point still counts as inside: roundings of points on faces.
const OUTSIDE: f64 = 1e-9;

/// s of a [`TetMesh`]: linear in each tetrahedron.
///
/// Local coordinates are world displacements from the lower corner of the bounds, in units of the geometric mean edge of the cells (which is so the
/// voxel of [`Domain::voxel`]).
#[derive(Debug)]
pub struct TetLinear {
    mesh: TetMesh,
    domain: Domain,
    nodes: Vec<Node>,
    /// Cells in the order of the leaves.
    order: Vec<u32>,
}

/// A box, widened by roundings, with the values in it.
#[derive(Debug, Clone)]
struct Node {
    lo: DVec3,
    hi: DVec3,
    values: (f64, f64),
    /// First cell in `order` of a leaf, else the second child; the first child follows its parent.
    at: u32,
    /// Cells of a leaf, 0 for an inner node.
    count: u32,
}

/// Six times the signed volume.
fn volume6(p: [DVec3; 4]) -> f64 {
    (p[1] - p[0]).cross(p[2] - p[0]).dot(p[3] - p[0])
}

impl TetLinear {
    /// The function of a mesh.
    ///
    /// # Errors
    /// [`DataError::Mesh`] where no cell has a volume, or the bounds of the mesh are beyond f64.
    pub fn new(mesh: &TetMesh) -> Result<Self, DataError> {
        let corners = |c: u32| mesh.cells[c as usize].map(|i| mesh.points[i as usize]);
        let mut order: Vec<u32> = (0..mesh.cells.len() as u32).filter(|&c| volume6(corners(c)) != 0.0).collect();
        if order.is_empty() {
            return Err(DataError::Mesh("no cell has a volume".into()));
        }
        let (mut lo, mut hi) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        let (mut logs, mut edges) = (0.0, 0u32);
        for &c in &order {
            let p = corners(c);
            for (i, a) in p.iter().enumerate() {
                (lo, hi) = (lo.min(*a), hi.max(*a));
                for b in &p[i + 1..] {
                    logs += (*a - *b).length().ln();
                    edges += 1;
                }
            }
        }
        let edge = (logs / f64::from(edges)).exp();
        // Rounded upward, with room: the box only has to hold the cells.
        let far = (hi - lo) / edge * (1.0 + 1e-12) + 1e-9;
        if !(edge > 0.0 && far.is_finite() && (hi - lo).is_finite()) {
            return Err(DataError::Mesh(
                "its extent or its cells are too large or too small for f64".into(),
            ));
        }
        let domain = Domain {
            origin: lo,
            axes: DMat3::from_diagonal(DVec3::splat(edge)),
            lo: DVec3::splat(-1e-9),
            hi: far,
        };
        let centre = |c: u32| corners(c).iter().sum::<DVec3>();
        let mut nodes = Vec::with_capacity(2 * order.len() / LEAF + 1);
        build(&mut nodes, &mut order, 0, mesh, &centre);
        Ok(Self {
            mesh: mesh.clone(),
            domain,
            nodes,
            order,
        })
    }

    /// The mesh.
    #[must_use]
    pub fn mesh(&self) -> &TetMesh {
        &self.mesh
    }

    /// Bytes beyond the mesh.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.nodes.len() * size_of::<Node>() + self.order.len() * 4
    }

    /// The cell that contains a world point and its barycentric coordinates; where several do (faces, edges, overlaps), the one it is deepest in.
    /// A point up to 1e-9 outside, in barycentric coordinates, still counts as inside.
    #[must_use]
    pub fn locate(&self, x: DVec3) -> Option<(usize, [f64; 4])> {
        let mut best = None;
        let mut depth = -OUTSIDE;
        self.visit(
            |n| x.cmpge(n.lo).all() && x.cmple(n.hi).all(),
            |c| {
                let b = self.barycentric(c, x);
                let least = b.iter().fold(f64::INFINITY, |m, &v| m.min(v));
                if least >= depth {
                    (best, depth) = (Some((c, b)), least);
                }
            },
        );
        best
    }

    fn corners(&self, cell: usize) -> [DVec3; 4] {
        self.mesh.cells[cell].map(|i| self.mesh.points[i as usize])
    }

    fn barycentric(&self, cell: usize, x: DVec3) -> [f64; 4] {
        let p = self.corners(cell);
        let all = volume6(p);
        std::array::from_fn(|k| {
            let mut q = p;
            q[k] = x;
            volume6(q) / all
        })
    }

    /// Calls `cell` for the cells of all leaves below nodes that `enter` accepts.
    fn visit(&self, enter: impl Fn(&Node) -> bool, mut cell: impl FnMut(usize)) {
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
                let cells = &self.order[n.at as usize..(n.at + n.count) as usize];
                cells.iter().for_each(|&c| cell(c as usize));
            }
        }
    }
}

/// Builds the node of `order`, which starts at `first` of the whole, and those below it.
fn build(nodes: &mut Vec<Node>, order: &mut [u32], first: u32, mesh: &TetMesh, centre: &impl Fn(u32) -> DVec3) {
    let mut node = Node {
        lo: DVec3::INFINITY,
        hi: DVec3::NEG_INFINITY,
        values: (f64::INFINITY, f64::NEG_INFINITY),
        at: first,
        count: order.len() as u32,
    };
    let (mut least, mut most) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    for &c in order.iter() {
        for i in mesh.cells[c as usize] {
            let (p, v) = (mesh.points[i as usize], f64::from(mesh.values[i as usize]));
            (node.lo, node.hi) = (node.lo.min(p), node.hi.max(p));
            node.values = (node.values.0.min(v), node.values.1.max(v));
        }
        let m = centre(c);
        (least, most) = (least.min(m), most.max(m));
    }
    // Points on a face of the box, rounded, are looked for too.
    let slack = OUTSIDE * (node.hi - node.lo).max_element() + 4.0 * f64::EPSILON * node.lo.abs().max(node.hi.abs()).max_element();
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
    build(nodes, left, first, mesh, centre);
    let second = nodes.len() as u32;
    build(nodes, right, first + middle as u32, mesh, centre);
    nodes[at].count = 0;
    nodes[at].at = second;
}

impl Function for TetLinear {
    fn name(&self) -> String {
        "linear on tetrahedra".into()
    }

    fn domain(&self) -> &Domain {
        &self.domain
    }

    /// NaN outside the cells.
    fn value(&self, x: DVec3) -> f64 {
        self.locate(x).map_or(f64::NAN, |(c, b)| {
            let v = self.mesh.cells[c].map(|i| f64::from(self.mesh.values[i as usize]));
            b.iter().zip(v).map(|(b, v)| b * v).sum()
        })
    }

    /// 0 outside the cells.
    fn gradient(&self, x: DVec3) -> DVec3 {
        let Some((c, _)) = self.locate(x) else { return DVec3::ZERO };
        let p = self.corners(c);
        let v = self.mesh.cells[c].map(|i| f64::from(self.mesh.values[i as usize]));
        let (a, b, d) = (p[1] - p[0], p[2] - p[0], p[3] - p[0]);
        let normals = [b.cross(d), d.cross(a), a.cross(b)];
        let sum = normals[0] * (v[1] - v[0]) + normals[1] * (v[2] - v[0]) + normals[2] * (v[3] - v[0]);
        sum / normals[2].dot(d)
    }

    /// The range of the values at the corners of all cells whose tree leaves meet the box; of all values where none do.
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
            |c| {
                for i in self.mesh.cells[c] {
                    let v = f64::from(self.mesh.values[i as usize]);
                    range = Some(range.map_or((v, v), |(x, y)| (x.min(v), y.max(v))));
                }
            },
        );
        let (lo, hi) = range.unwrap_or(self.nodes[0].values);
        Interval { lo, hi }
    }

    fn structure(&self) -> Structure<'_> {
        Structure::Mesh(&self.mesh)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid_to_tets;
    use isobar_core::{Grid, Samples};

    fn linear(n: usize) -> TetLinear {
        let s: Vec<f32> = (0..n * n * n)
            .map(|i| (i % n) as f32 + 2.0 * (i / n % n) as f32 - (i / n / n) as f32)
            .collect();
        let grid = Grid::unit([n; 3], Samples::F32(s.into())).unwrap();
        TetLinear::new(&grid_to_tets(&grid).unwrap()).unwrap()
    }

    #[test]
    fn a_linear_field_is_reproduced_and_ends_at_the_mesh() {
        let f = linear(6);
        let mut seed = 3u64;
        let mut next = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (seed >> 11) as f64 / (1u64 << 53) as f64 * 5.0
        };
        for _ in 0..500 {
            let x = DVec3::new(next(), next(), next());
            let want = x.x + 2.0 * x.y - x.z;
            assert!((f.value(x) - want).abs() < 1e-12, "{x}");
            assert!((f.gradient(x) - DVec3::new(1.0, 2.0, -1.0)).length() < 1e-12);
            let u = f.domain().local(x);
            let e = f.enclosure(u - 0.05, u + 0.05);
            assert!(e.lo <= want - 0.05 && want + 0.05 <= e.hi && e.hi - e.lo < 20.0);
        }
        for x in [DVec3::splat(5.0), DVec3::ZERO, DVec3::new(2.0, 3.0, 5.0)] {
            assert_eq!(f.value(x), x.x + 2.0 * x.y - x.z);
        }
        for x in [DVec3::splat(5.01), DVec3::new(-1e-6, 1.0, 1.0), DVec3::splat(f64::NAN)] {
            assert!(f.value(x).is_nan() && f.gradient(x) == DVec3::ZERO);
        }
        // 12 edges of length 1 are shared by more cells than diagonals are
        assert!((1.0..1.42).contains(&f.domain().voxel()), "{}", f.domain().voxel());
    }

    #[test]
    fn cells_without_volume_are_passed_over() {
        let points = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z, DVec3::splat(9.0)];
        let values = vec![0.0, 0.0, 0.0, 1.0, 5.0];
        let mesh = |cells: Vec<[u32; 4]>| TetMesh::new(points.clone().into(), cells.into(), values.clone().into()).unwrap();
        let f = TetLinear::new(&mesh(vec![[0, 2, 1, 3], [0, 0, 1, 4]])).unwrap();
        assert_eq!(f.value(DVec3::splat(0.25)), 0.25);
        assert_eq!(f.gradient(DVec3::splat(0.25)), DVec3::Z);
        assert!(f.domain().world_bounds().1.max_element() < 1.1 && f.bytes() > 0);
        assert!(TetLinear::new(&mesh(vec![[0, 0, 1, 4]])).is_err());
    }
}
