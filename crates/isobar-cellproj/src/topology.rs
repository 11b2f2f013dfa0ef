//! Which cells share a face: exact matching of the faces' corners, points with the same coordinates taken as one.

use crate::mesh::Cells;
use glam::DVec3;
use isobar_core::RenderError;
use rayon::prelude::*;
use robust::{Coord3D, orient3d};

/// No neighbour: the face lies on the boundary.
pub(crate) const NONE: u32 = u32::MAX;

/// The faces opposite corners 0 to 3 of a cell with positive volume, counterclockwise seen from outside.
pub(crate) const FACES: [[usize; 3]; 4] = [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]];

/// Neighbours of all cells.
#[derive(Debug)]
pub(crate) struct Topology {
    /// Across the face opposite each corner: 4 times the neighbour plus its own corner opposite that face, or [`NONE`].
    pub(crate) neighbours: Vec<[u32; 4]>,
    /// Cells with a face on the boundary, ascending.
    pub(crate) boundary: Vec<u32>,
    /// Faces on the boundary.
    pub(crate) boundary_faces: usize,
    /// Faces that more than two cells share; they count as boundary of each.
    pub(crate) crowded_faces: usize,
    /// Points with the coordinates of an earlier one.
    pub(crate) duplicate_points: usize,
    /// Parts without a common face.
    pub(crate) components: usize,
    /// Whether the boundary certainly is that of a convex body: then no ray leaves and enters again.
    pub(crate) convex: bool,
}

/// For each point the first one with the same coordinates.
pub(crate) fn canonical(points: &[DVec3]) -> (Vec<u32>, usize) {
    let size = (2 * points.len()).next_power_of_two().max(2);
    let mut table = vec![NONE; size];
    let mut duplicates = 0;
    let ids = points
        .iter()
        .enumerate()
        .map(|(i, p)| {
            // -0 and 0 are the same place.
            let key = (*p + DVec3::ZERO).to_array().map(f64::to_bits);
            let mut h = key
                .iter()
                .fold(0u64, |h, k| (h ^ k).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(29));
            loop {
                let slot = (h >> 7) as usize & (size - 1);
                match table[slot] {
                    NONE => {
                        table[slot] = i as u32;
                        return i as u32;
                    }
                    j if points[j as usize] == *p => {
                        duplicates += 1;
                        return j;
                    }
                    _ => h = h.wrapping_add(1 << 7),
                }
            }
        })
        .collect();
    (ids, duplicates)
}

/// Faces sorted by their least corner: the other two, and 4 times the cell plus the opposite corner.
fn faces(cells: &[[u32; 4]], ids: &[u32]) -> (Vec<u32>, Vec<[u32; 3]>) {
    let face = |c: &[u32; 4], k: usize| {
        let [mut a, mut b, mut d] = FACES[k].map(|i| ids[c[i] as usize]);
        if a > b {
            std::mem::swap(&mut a, &mut b);
        }
        if b > d {
            std::mem::swap(&mut b, &mut d);
        }
        if a > b {
            std::mem::swap(&mut a, &mut b);
        }
        [a, b, d]
    };
    let mut starts = vec![0u32; ids.len() + 2];
    for c in cells {
        for k in 0..4 {
            starts[face(c, k)[0] as usize + 2] += 1;
        }
    }
    for i in 2..starts.len() {
        starts[i] += starts[i - 1];
    }
    let mut out = vec![[0u32; 3]; 4 * cells.len()];
    for (i, c) in cells.iter().enumerate() {
        for k in 0..4 {
            let [a, b, d] = face(c, k);
            let at = &mut starts[a as usize + 1];
            out[*at as usize] = [b, d, (4 * i + k) as u32];
            *at += 1;
        }
    }
    starts.pop();
    (starts, out)
}

impl Topology {
    /// Matches the faces of a mesh.
    ///
    /// # Errors
    /// [`RenderError::Memory`] for more than 2^30 cells.
    pub(crate) fn new(mesh: &Cells) -> Result<Self, RenderError> {
        let n = mesh.cells.len();
        if n >= 1 << 30 {
            return Err(RenderError::Memory {
                what: "the list of neighbours".into(),
                bytes: n as u64 * 16,
                limit: 1 << 34,
            });
        }
        let (ids, duplicate_points) = canonical(&mesh.mesh.points);
        let (starts, mut faces) = faces(&mesh.cells, &ids);
        // Each point's faces apart: sorted, equal ones are neighbours.
        let mut rest = &mut faces[..];
        let mut buckets = Vec::with_capacity(starts.len());
        for w in starts.windows(2) {
            let (head, tail) = rest.split_at_mut((w[1] - w[0]) as usize);
            buckets.push(head);
            rest = tail;
        }
        buckets.into_par_iter().with_min_len(512).for_each(<[_]>::sort_unstable);
        let mut neighbours = vec![[NONE; 4]; n];
        let (mut boundary_faces, mut crowded_faces) = (0, 0);
        for w in starts.windows(2) {
            for same in faces[w[0] as usize..w[1] as usize].chunk_by(|a, b| a[..2] == b[..2]) {
                if let [a, b] = same {
                    neighbours[a[2] as usize / 4][a[2] as usize % 4] = b[2];
                    neighbours[b[2] as usize / 4][b[2] as usize % 4] = a[2];
                } else {
                    boundary_faces += same.len();
                    crowded_faces += usize::from(same.len() > 2);
                }
            }
        }
        let boundary: Vec<u32> = (0..n as u32).filter(|&i| neighbours[i as usize].contains(&NONE)).collect();
        let components = components(&neighbours);
        let mut out = Self {
            neighbours,
            boundary,
            boundary_faces,
            crowded_faces,
            duplicate_points,
            components,
            convex: false,
        };
        out.convex = components == 1 && crowded_faces == 0 && out.is_locally_convex(mesh, &ids);
        Ok(out)
    }

    /// Whether the boundary is one surface, every edge of it belongs to two of its faces and neither's far corner lies outside the other, exactly. A connected
    /// closed surface with this property bounds a convex body (Tietze, Nakajima). A second surface may have it as well: two faces of the same place that do not match, in a slit of no thickness.
    fn is_locally_convex(&self, mesh: &Cells, ids: &[u32]) -> bool {
        let mut edges: Vec<([u32; 2], [u32; 3], u32, usize)> = Vec::with_capacity(3 * self.boundary_faces);
        let mut faces = 0;
        for &i in &self.boundary {
            for k in (0..4).filter(|&k| self.neighbours[i as usize][k] == NONE) {
                let f = FACES[k].map(|c| ids[mesh.cells[i as usize][c] as usize]);
                for e in 0..3 {
                    let (a, b, far) = (f[e], f[(e + 1) % 3], f[(e + 2) % 3]);
                    edges.push(([a.min(b), a.max(b)], f, far, faces));
                }
                faces += 1;
            }
        }
        edges.par_sort_unstable();
        let point = |i: u32| {
            let p = mesh.mesh.points[i as usize];
            Coord3D { x: p.x, y: p.y, z: p.z }
        };
        let mut pairs = edges.chunk_by(|a, b| a.0 == b.0);
        let mut parts = Parts::new(faces);
        let convex = pairs.all(|pair| match pair {
            // orient3d is negative where the last point lies above the plane of the others seen counterclockwise: outside.
            [a, b] => {
                parts.join(a.3, b.3);
                let outside = |f: [u32; 3], far: u32| orient3d(point(f[0]), point(f[1]), point(f[2]), point(far)) < 0.0;
                !outside(a.1, b.2) && !outside(b.1, a.2)
            }
            _ => false,
        });
        convex && parts.count == 1
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        self.neighbours.len() * 16 + self.boundary.len() * 4
    }
}

/// Sets of things joined two by two.
struct Parts {
    above: Vec<usize>,
    count: usize,
}

impl Parts {
    fn new(n: usize) -> Self {
        Self {
            above: (0..n).collect(),
            count: n,
        }
    }

    fn of(&mut self, mut i: usize) -> usize {
        while self.above[i] != i {
            self.above[i] = self.above[self.above[i]];
            i = self.above[i];
        }
        i
    }

    fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.of(a), self.of(b));
        self.count -= usize::from(a != b);
        self.above[a] = b;
    }
}

/// Parts without a common face.
fn components(neighbours: &[[u32; 4]]) -> usize {
    let mut seen = vec![false; neighbours.len()];
    let mut stack = Vec::new();
    let mut count = 0;
    for start in 0..neighbours.len() {
        if seen[start] {
            continue;
        }
        count += 1;
        seen[start] = true;
        stack.push(start);
        while let Some(i) = stack.pop() {
            for &n in &neighbours[i] {
                if n != NONE && !std::mem::replace(&mut seen[n as usize / 4], true) {
                    stack.push(n as usize / 4);
                }
            }
        }
    }
    count
}

#[cfg(test)]
mod tests {
    use super::*;
    use isobar_core::{Grid, Samples, TetMesh};
    use isobar_fields::grid_to_tets;

    fn lattice(n: usize) -> TetMesh {
        grid_to_tets(&Grid::unit([n; 3], Samples::F32(vec![0.0; n * n * n].into())).unwrap()).unwrap()
    }

    fn topology(mesh: &TetMesh) -> Topology {
        Topology::new(&Cells::new(mesh).unwrap()).unwrap()
    }

    #[test]
    fn a_box_has_a_boundary_and_is_convex() {
        let t = topology(&lattice(5));
        assert_eq!((t.boundary_faces, t.components, t.convex), (2 * 6 * 16, 1, true));
        assert_eq!((t.crowded_faces, t.duplicate_points), (0, 0));
        for (i, n) in t.neighbours.iter().enumerate() {
            for (k, &j) in n.iter().enumerate().filter(|n| *n.1 != NONE) {
                assert_eq!(t.neighbours[j as usize / 4][j as usize % 4] as usize, 4 * i + k);
            }
        }
    }

    #[test]
    fn points_given_twice_are_one_place() {
        let m = lattice(4);
        // Every cell with points of its own.
        let points: Vec<DVec3> = m
            .cells
            .iter()
            .flatten()
            .map(|&i| m.points[i as usize] - DVec3::ZERO)
            .collect();
        let cells: Vec<[u32; 4]> = (0..m.cells.len() as u32)
            .map(|i| [4 * i, 4 * i + 1, 4 * i + 2, 4 * i + 3])
            .collect();
        let values = vec![0.0; points.len()];
        let t = topology(&TetMesh::new(points.into(), cells.into(), values.into()).unwrap());
        assert_eq!((t.boundary_faces, t.components, t.convex), (2 * 6 * 9, 1, true));
        assert_eq!(t.duplicate_points, 4 * 135 - 64);
    }

    #[test]
    fn notches_cavities_and_parts_are_not_convex() {
        let m = lattice(6);
        let without = |drop: &dyn Fn(DVec3) -> bool| {
            let keep = |c: &&[u32; 4]| !drop(c.iter().map(|&i| m.points[i as usize]).sum::<DVec3>() / 4.0);
            let cells: Vec<[u32; 4]> = m.cells.iter().filter(keep).copied().collect();
            topology(&TetMesh::new(m.points.clone(), cells.into(), m.values.clone()).unwrap())
        };
        assert!(!without(&|x| x.x > 4.0 && x.y > 4.0).convex, "a notch");
        assert!(!without(&|x| (x - 2.5).abs().max_element() < 0.5).convex, "a cavity");
        let parts = without(&|x| x.x > 2.0 && x.x < 3.0);
        assert_eq!((parts.components, parts.convex), (2, false));
        assert!(without(&|x| x.x > 4.0).convex, "a smaller box");
    }
}
