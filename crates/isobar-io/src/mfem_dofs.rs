//! Numbers of the degrees of freedom of MFEM's conforming spaces on hexahedra: vertices, edges, faces, insides.

use crate::error::Cause;
use crate::mfem::bad;
use std::collections::HashMap;

/// Corners of a hexahedron's edges and faces, as MFEM lists them.
const EDGES: [[usize; 2]; 12] = [
    [0, 1],
    [1, 2],
    [3, 2],
    [0, 3],
    [4, 5],
    [5, 6],
    [7, 6],
    [4, 7],
    [0, 4],
    [1, 5],
    [2, 6],
    [3, 7],
];
const FACES: [[usize; 4]; 6] = [
    [3, 2, 1, 0],
    [0, 1, 5, 4],
    [1, 2, 6, 5],
    [2, 3, 7, 6],
    [3, 0, 4, 7],
    [4, 5, 6, 7],
];

/// Elements by their vertices, with everything numbered.
#[derive(Default)]
pub(crate) struct Topology {
    pub(crate) elements: Vec<[u32; 8]>,
    pub(crate) vertices: usize,
    pub(crate) edges: HashMap<(u32, u32), usize>,
    pub(crate) faces: HashMap<[u32; 4], (usize, [u32; 4])>,
}

pub(crate) const fn edge(a: u32, b: u32) -> (u32, u32) {
    if a < b { (a, b) } else { (b, a) }
}

impl Topology {
    /// Numbers edges that are not known yet, and faces.
    pub(crate) fn number(&mut self) {
        for e in &self.elements {
            for [a, b] in EDGES {
                let next = self.edges.len();
                self.edges.entry(edge(e[a], e[b])).or_insert(next);
            }
            for f in FACES {
                let base = f.map(|c| e[c]);
                let mut key = base;
                key.sort_unstable();
                let next = self.faces.len();
                self.faces.entry(key).or_insert((next, base));
            }
        }
    }

    /// Local vertex at a corner given by 0 or 1 per axis.
    fn corner(c: [usize; 3]) -> usize {
        [[0, 1], [3, 2]][c[1]][c[0]] + 4 * c[2]
    }
}

/// The numbers of all degrees of freedom of a space with `counts` of them along the axes of each element, ends included.
pub(crate) struct Numbering<'a> {
    topology: &'a Topology,
    counts: &'a dyn Fn(usize) -> [usize; 3],
    pub(crate) edges: Vec<usize>,
    pub(crate) faces: Vec<usize>,
    inside: Vec<usize>,
    pub(crate) total: usize,
}

impl<'a> Numbering<'a> {
    pub(crate) fn new(topology: &'a Topology, counts: &'a dyn Fn(usize) -> [usize; 3]) -> Result<Self, Cause> {
        let mut edges = vec![0; topology.edges.len()];
        let mut faces = vec![0; topology.faces.len()];
        let mut inside = vec![0; topology.elements.len()];
        for (n, e) in topology.elements.iter().enumerate() {
            let own = counts(n).map(|c| c.saturating_sub(2));
            inside[n] = own[0] * own[1] * own[2];
            for (k, [a, b]) in EDGES.into_iter().enumerate() {
                let axis = if k >= 8 { 2 } else { k % 2 };
                let size = &mut edges[topology.edges[&edge(e[a], e[b])]];
                if *size != 0 && *size != own[axis] {
                    return Err(bad(format!(
                        "element {n} has {} degrees of freedom on an edge of {size}",
                        own[axis]
                    )));
                }
                *size = own[axis];
            }
            for (k, f) in FACES.into_iter().enumerate() {
                let mut key = f.map(|c| e[c]);
                key.sort_unstable();
                let (a, b) = [(0, 1), (0, 2), (1, 2), (0, 2), (1, 2), (0, 1)][k];
                faces[topology.faces[&key].0] = own[a] * own[b];
            }
        }
        let mut total = topology.vertices;
        for list in [&mut edges, &mut faces, &mut inside] {
            for size in list.iter_mut() {
                (*size, total) = (total, total + *size);
            }
        }
        Ok(Self {
            topology,
            counts,
            edges,
            faces,
            inside,
            total,
        })
    }

    /// The number of the degree of freedom (i, j, k) of element n.
    pub(crate) fn of(&self, n: usize, at: [usize; 3]) -> usize {
        let e = &self.topology.elements[n];
        let counts = (self.counts)(n);
        let end = |a: usize| usize::from(at[a] == counts[a] - 1);
        let inner: Vec<usize> = (0..3).filter(|&a| at[a] > 0 && at[a] < counts[a] - 1).collect();
        let vertex = |set: &[(usize, usize)]| {
            let mut c = [end(0), end(1), end(2)];
            set.iter().for_each(|&(a, v)| c[a] = v);
            e[Topology::corner(c)]
        };
        match inner[..] {
            [] => vertex(&[]) as usize,
            [a] => {
                let (from, to) = (vertex(&[(a, 0)]), vertex(&[(a, 1)]));
                let along = if from < to { at[a] - 1 } else { counts[a] - 2 - at[a] };
                self.edges[self.topology.edges[&edge(from, to)]] + along
            }
            [a, b] => {
                let corners = [(0, 0), (1, 0), (1, 1), (0, 1)].map(|(p, q)| vertex(&[(a, p), (b, q)]));
                let mut key = corners;
                key.sort_unstable();
                let (face, base) = self.topology.faces[&key];
                let place = |v: u32| [(0, 0), (1, 0), (1, 1), (0, 1)][corners.iter().position(|&c| c == v).unwrap_or(0)];
                let (origin, first) = (place(base[0]), place(base[1]));
                let (na, nb) = (counts[a] - 2, counts[b] - 2);
                let (ia, ib) = (at[a] - 1, at[b] - 1);
                let ia = if origin.0 == 0 { ia } else { na - 1 - ia };
                let ib = if origin.1 == 0 { ib } else { nb - 1 - ib };
                // The first direction of the base runs along a where its second vertex differs from the origin there.
                self.faces[face] + if first.0 == origin.0 { ib + ia * nb } else { ia + ib * na }
            }
            _ => {
                let c = counts.map(|c| c - 2);
                self.inside[n] + at[0] - 1 + c[0] * (at[1] - 1 + c[1] * (at[2] - 1))
            }
        }
    }
}
