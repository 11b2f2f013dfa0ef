//! Signed distance of a closed triangle mesh at points of a grid.
//!
//! The distance is that to the nearest triangle, found in a tree of boxes, in f64. The sign is the winding number along grid lines: the
//! signed count of triangles crossed from -infinity on, with edge tests that two triangles on one edge share bit for bit, so that no line
//! slips between them. A mesh with holes is closed first by a fan over each hole's border; otherwise the sign would have to jump in the air.

use anyhow::{Result, bail};
use isobar_core::DVec3;
use rayon::prelude::*;
use std::collections::BTreeMap;

/// A closed mesh and its tree.
#[derive(Debug)]
pub struct SignedDistance {
    points: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
    nodes: Vec<Node>,
    /// Triangles added to close holes.
    pub closed_by: usize,
}

/// A box over `count` triangles from `first`, or over the two children at `first` and `first + 1` where `count` is 0.
#[derive(Debug, Clone, Copy)]
struct Node {
    lo: DVec3,
    hi: DVec3,
    first: u32,
    count: u32,
}

/// Triangles in a leaf at most.
const LEAF: usize = 4;

impl SignedDistance {
    /// Closes the mesh and builds the tree.
    ///
    /// # Errors
    /// Where there are no triangles, an index is out of range, a point is not finite, or an edge has more than one triangle on a side.
    pub fn new(points: Vec<DVec3>, mut triangles: Vec<[u32; 3]>) -> Result<Self> {
        if triangles.is_empty() || points.iter().any(|p| !p.is_finite()) {
            bail!("the mesh has no triangles or points that are not finite");
        }
        if triangles.iter().flatten().any(|&i| i as usize >= points.len()) {
            bail!("the mesh names a point it does not have");
        }
        let closed_by = close(&mut triangles)?;
        let mut d = Self {
            points,
            triangles,
            nodes: Vec::new(),
            closed_by,
        };
        d.build();
        Ok(d)
    }

    /// Bounds of the points that triangles use.
    #[must_use]
    pub fn bounds(&self) -> (DVec3, DVec3) {
        (self.nodes[0].lo, self.nodes[0].hi)
    }

    fn corners(&self, t: usize) -> [DVec3; 3] {
        self.triangles[t].map(|i| self.points[i as usize])
    }

    fn build(&mut self) {
        let mut order: Vec<u32> = (0..self.triangles.len() as u32).collect();
        let centre: Vec<DVec3> = (0..order.len())
            .map(|t| self.corners(t).iter().sum::<DVec3>() / 3.0)
            .collect();
        let blank = Node {
            lo: DVec3::INFINITY,
            hi: DVec3::NEG_INFINITY,
            first: 0,
            count: 0,
        };
        self.nodes.push(blank);
        let mut todo = vec![(0usize, 0usize, order.len())];
        while let Some((at, from, to)) = todo.pop() {
            let mut node = blank;
            for &t in &order[from..to] {
                for p in self.corners(t as usize) {
                    (node.lo, node.hi) = (node.lo.min(p), node.hi.max(p));
                }
            }
            if to - from <= LEAF {
                (node.first, node.count) = (from as u32, (to - from) as u32);
            } else {
                let extent = node.hi - node.lo;
                let axis = (0..3).max_by(|&a, &b| extent[a].total_cmp(&extent[b])).unwrap_or(0);
                let middle = (to - from) / 2;
                order[from..to]
                    .select_nth_unstable_by(middle, |&a, &b| centre[a as usize][axis].total_cmp(&centre[b as usize][axis]));
                node.first = self.nodes.len() as u32;
                self.nodes.extend([blank, blank]);
                todo.push((node.first as usize, from, from + middle));
                todo.push((node.first as usize + 1, from + middle, to));
            }
            self.nodes[at] = node;
        }
        self.triangles = order.iter().map(|&t| self.triangles[t as usize]).collect();
    }

    /// Distance from `p` to the mesh, not signed; `bound` is a distance known to suffice (infinity where none is known).
    #[must_use]
    pub fn distance(&self, p: DVec3, bound: f64) -> f64 {
        let to_box = |n: &Node| (p.max(n.lo).min(n.hi) - p).length_squared();
        let mut best = bound * bound;
        let mut stack = [(0u32, 0.0f64); 64];
        stack[0] = (0, to_box(&self.nodes[0]));
        let mut height = 1;
        while height > 0 {
            height -= 1;
            let (at, d) = stack[height];
            if d > best {
                continue;
            }
            let n = &self.nodes[at as usize];
            if n.count > 0 {
                for t in n.first..n.first + n.count {
                    best = best.min(to_triangle(p, self.corners(t as usize)));
                }
                continue;
            }
            let (a, b) = (n.first, n.first + 1);
            let (da, db) = (to_box(&self.nodes[a as usize]), to_box(&self.nodes[b as usize]));
            let (near, far) = if da <= db { ((a, da), (b, db)) } else { ((b, db), (a, da)) };
            // Depth is log2 of the triangles: halves are exact, so 64 entries serve 2^32 triangles.
            for entry in [far, near] {
                if entry.1 <= best {
                    stack[height] = entry;
                    height += 1;
                }
            }
        }
        best.sqrt()
    }

    /// Signed distance at the `n^3` points `origin + spacing * (i, j, k)`, x fastest, negative inside, as f32.
    #[must_use]
    pub fn sample(&self, n: usize, origin: DVec3, spacing: f64) -> Vec<f32> {
        let crossings = self.crossings(n, origin, spacing);
        let mut out = vec![0.0f32; n * n * n];
        out.par_chunks_mut(n).enumerate().for_each(|(row, line)| {
            let (j, k) = (row % n, row / n);
            let mut crossed = crossings[row].iter().peekable();
            let mut winding = 0;
            let mut known = f64::INFINITY;
            for (i, value) in line.iter_mut().enumerate() {
                let p = origin + DVec3::new(i as f64, j as f64, k as f64) * spacing;
                while let Some((_, sign)) = crossed.next_if(|(x, _)| *x < p.x) {
                    winding += sign;
                }
                // The neighbour's distance plus the step bounds this one; the factor covers rounding.
                let d = self.distance(p, (known + spacing) * (1.0 + 1e-12));
                known = d;
                *value = if winding == 0 { d as f32 } else { -d as f32 };
            }
        });
        out
    }

    /// For every grid line along x: where it crosses triangles (ascending), and +1 entering, -1 leaving.
    fn crossings(&self, n: usize, origin: DVec3, spacing: f64) -> Vec<Vec<(f64, i32)>> {
        let mut lines = vec![Vec::new(); n * n];
        for t in 0..self.triangles.len() {
            let c = self.corners(t);
            let index = |v: f64, o: f64| (v - o) / spacing;
            let range = |f: &dyn Fn(DVec3) -> f64| {
                let v = c.map(f);
                let lo = v.iter().copied().fold(f64::INFINITY, f64::min).floor().max(0.0);
                let hi = v.iter().copied().fold(f64::NEG_INFINITY, f64::max).ceil().min(n as f64 - 1.0);
                (lo as usize, hi as i64)
            };
            let (j0, j1) = range(&|p| index(p.y, origin.y));
            let (k0, k1) = range(&|p| index(p.z, origin.z));
            for k in k0..=(k1.max(-1) + 1) as usize {
                for j in j0..=(j1.max(-1) + 1) as usize {
                    if j as i64 > j1 || k as i64 > k1 {
                        continue;
                    }
                    let (y, z) = (origin.y + j as f64 * spacing, origin.z + k as f64 * spacing);
                    if let Some(hit) = self.cross(t, y, z) {
                        lines[k * n + j].push(hit);
                    }
                }
            }
        }
        for line in &mut lines {
            line.sort_by(|a, b| a.0.total_cmp(&b.0));
        }
        lines
    }

    /// Where the line (., y, z) crosses triangle t, and the orientation.
    fn cross(&self, t: usize, y: f64, z: f64) -> Option<(f64, i32)> {
        let [a, b, c] = self.triangles[t];
        // Twice the area of the edge and the point, computed from the edge's lower index so that both triangles get the same bits. Zero
        // counts as positive for the lower-to-higher direction: a point on an edge belongs to exactly one side.
        let side = |i: u32, j: u32| -> (f64, bool) {
            let flip = i > j;
            let (p, q) = if flip { (j, i) } else { (i, j) };
            let (p, q) = (self.points[p as usize], self.points[q as usize]);
            let area = (q.y - p.y) * (z - p.z) - (q.z - p.z) * (y - p.y);
            let positive = area >= 0.0;
            if flip { (-area, !positive) } else { (area, positive) }
        };
        let (ab, bc, ca) = (side(a, b), side(b, c), side(c, a));
        if ab.1 != bc.1 || bc.1 != ca.1 {
            return None;
        }
        let [pa, pb, pc] = self.corners(t);
        let total = ab.0 + bc.0 + ca.0;
        let x = if total == 0.0 {
            (pa.x + pb.x + pc.x) / 3.0
        } else {
            (pa.x * bc.0 + pb.x * ca.0 + pc.x * ab.0) / total
        };
        // Counter-clockwise seen along -x means the normal points to +x: the line leaves.
        Some((x, if ab.1 { -1 } else { 1 }))
    }
}

/// Closes every hole by a fan; returns the triangles added.
fn close(triangles: &mut Vec<[u32; 3]>) -> Result<usize> {
    let mut edges = BTreeMap::<(u32, u32), i32>::new();
    for t in triangles.iter() {
        for e in 0..3 {
            let (a, b) = (t[e], t[(e + 1) % 3]);
            *edges.entry((a, b)).or_default() += 1;
            *edges.entry((b, a)).or_default() -= 1;
        }
    }
    // Directed border edges (b, a): what is missing beside the triangles' own (a, b).
    let mut next = BTreeMap::<u32, Vec<u32>>::new();
    for ((a, b), n) in edges {
        if n.abs() > 1 {
            bail!("edge {a}-{b} has triangles of one orientation more than once");
        }
        if n == 1 {
            next.entry(b).or_default().push(a);
        }
    }
    let before = triangles.len();
    while let Some((&start, _)) = next.iter().next() {
        let mut ring = vec![start];
        loop {
            let at = ring[ring.len() - 1];
            let Some(to) = next.get_mut(&at).and_then(Vec::pop) else {
                bail!("the border of a hole does not close at point {at}");
            };
            next.retain(|_, v| !v.is_empty());
            if to == start {
                break;
            }
            ring.push(to);
        }
        triangles.extend(ring[1..].windows(2).map(|w| [start, w[0], w[1]]));
    }
    Ok(triangles.len() - before)
}

/// Squared distance from a point to a triangle, by its Voronoi regions (Ericson, Real-Time Collision Detection 2005, 5.1.5).
fn to_triangle(p: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let (ab, ac, ap) = (b - a, c - a, p - a);
    let (d1, d2) = (ab.dot(ap), ac.dot(ap));
    if d1 <= 0.0 && d2 <= 0.0 {
        return ap.length_squared();
    }
    let bp = p - b;
    let (d3, d4) = (ab.dot(bp), ac.dot(bp));
    if d3 >= 0.0 && d4 <= d3 {
        return bp.length_squared();
    }
    let cp = p - c;
    let (d5, d6) = (ab.dot(cp), ac.dot(cp));
    if d6 >= 0.0 && d5 <= d6 {
        return cp.length_squared();
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return (ap - ab * (d1 / (d1 - d3))).length_squared();
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return (ap - ac * (d2 / (d2 - d6))).length_squared();
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        return (bp - (c - b) * ((d4 - d3) / ((d4 - d3) + (d5 - d6)))).length_squared();
    }
    let whole = va + vb + vc;
    if whole == 0.0 {
        // A degenerate triangle: its edges are covered by its neighbours, its corners here.
        return ap.length_squared().min(bp.length_squared()).min(cp.length_squared());
    }
    (ap - ab * (vb / whole) - ac * (vc / whole)).length_squared()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The cube [-1, 1]^3, outward triangles; `drop` leaves the last ones out.
    fn cube(drop: usize) -> SignedDistance {
        let points = (0..8)
            .map(|n| DVec3::from_array([0, 1, 2].map(|b| if n >> b & 1 == 0 { -1.0 } else { 1.0 })))
            .collect();
        let quads = [
            [0u32, 2, 3, 1],
            [4, 5, 7, 6],
            [0, 1, 5, 4],
            [2, 6, 7, 3],
            [0, 4, 6, 2],
            [1, 3, 7, 5],
        ];
        let mut triangles: Vec<_> = quads.iter().flat_map(|q| [[q[0], q[1], q[2]], [q[0], q[2], q[3]]]).collect();
        triangles.truncate(12 - drop);
        SignedDistance::new(points, triangles).unwrap()
    }

    fn exact(p: DVec3) -> f64 {
        let q = p.abs() - DVec3::ONE;
        q.max(DVec3::ZERO).length() + q.max_element().min(0.0)
    }

    #[test]
    fn a_cube_has_its_exact_distance_and_sign_also_on_lines_through_edges() {
        for drop in [0, 1, 2] {
            let d = cube(drop);
            assert_eq!(d.closed_by, drop);
            // spacing 0.5 puts lines exactly through corners, edges and diagonals
            let n = 9;
            let v = d.sample(n, DVec3::splat(-2.0), 0.5);
            for (i, got) in v.iter().enumerate() {
                let p = DVec3::new((i % n) as f64, (i / n % n) as f64, (i / n / n) as f64) * 0.5 - 2.0;
                let want = exact(p);
                assert!(
                    (f64::from(*got) - want).abs() < 1e-6 || want == 0.0 && *got == 0.0,
                    "{p} {got} {want}"
                );
            }
        }
    }

    #[test]
    fn bounds_known_before_do_not_change_the_distance() {
        let d = cube(0);
        for i in 0..200 {
            let a = f64::from(i);
            let p = DVec3::new((a * 0.7).sin(), (a * 1.3).cos(), (a * 2.1).sin()) * 2.5;
            let free = d.distance(p, f64::INFINITY);
            assert_eq!(free, d.distance(p, free * (1.0 + 1e-12)));
            assert!((free - exact(p).abs()).abs() < 1e-12);
        }
    }

    #[test]
    fn broken_meshes_are_refused() {
        assert!(SignedDistance::new(vec![DVec3::ZERO], vec![]).is_err());
        assert!(SignedDistance::new(vec![DVec3::ZERO], vec![[0, 1, 2]]).is_err());
    }
}
