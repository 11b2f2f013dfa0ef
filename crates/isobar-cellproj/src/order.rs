//! Visibility order of cells: the meshed polyhedra visibility order (Williams 1992) with relations across gaps (as XMPVO, Silva, Mitchell and Williams
//! 1998, which the paper names with [5]), or a sort by the distance of centroids.
//!
//! Two cells with a common face are ordered by the side of it the eye is on. Cells that the rays of the image leave into a gap and cells they
//! enter next are ordered by pairs found per pixel ([`crate::exterior`]). Kahn's algorithm gives an order in time linear in cells and pairs; what it leaves over holds
//! cycles, whose strongly connected parts (Tarjan) stay together as *groups*, in which each pixel sorts its own cells.
//!
//! A face seen edge-on within rounding gives no relation: the two cells then share no more of the screen than that.

use crate::camera::Projection;
use crate::lanes::prefetch;
use crate::mesh::Cells;
use crate::topology::{NONE, Topology};
use glam::DVec3;
use rayon::prelude::*;
use std::ops::Range;

/// Cells from front to back.
#[derive(Debug, Default)]
pub(crate) struct Order {
    pub(crate) cells: Vec<u32>,
    /// Places in `cells` of cells that hide each other in a cycle.
    pub(crate) groups: Vec<Range<u32>>,
}

/// Cells between fetching what is told of one and asking for it.
const AHEAD: usize = 8;

/// How a cell lies to the neighbour behind one of its faces: two bits.
const BEHIND_IT: u8 = 1;
const IN_FRONT: u8 = 2;

/// For each face of a cell, two bits: the neighbour there hides it, or is hidden by it.
#[inline(always)]
fn sides(eye: DVec3, forward: Option<DVec3>, p: &[DVec3; 4]) -> u8 {
    let (a, b, d) = (p[1] - p[0], p[2] - p[0], p[3] - p[0]);
    let size = |v: DVec3| v.x.abs() + v.y.abs() + v.z.abs();
    let n1 = b.cross(d);
    let n2 = d.cross(a);
    let n3 = a.cross(b);
    let n0 = -(n1 + n2 + n3);
    let [la, lb, ld] = [a, b, d].map(size);
    let most = la.max(lb).max(ld);
    // Inward normals: positive means that the eye is on the inner side of the face, or rays go inward through it.
    let (values, off) = if let Some(f) = forward {
        // Rays that go inward come from the neighbour.
        (
            [n0.dot(f), n1.dot(f), n2.dot(f), n3.dot(f)].map(|v| -v),
            most * most * size(f),
        )
    } else {
        let from = eye - p[0];
        let [v1, v2, v3] = [n1.dot(from), n2.dot(from), n3.dot(from)];
        ([a.dot(n1) - v1 - v2 - v3, v1, v2, v3], most * most * (size(from) + most))
    };
    let off = 64.0 * f64::EPSILON * off;
    let mut out = 0;
    for (k, v) in values.into_iter().enumerate() {
        out |= ((u8::from(v < -off) * BEHIND_IT) | (u8::from(v > off) * IN_FRONT)) << (2 * k);
    }
    out
}

#[inline(always)]
fn turned(bits: u8) -> u8 {
    (bits & 1) << 1 | bits >> 1 & 1
}

/// The side each cell is on of all its neighbours, told by the cell with the smaller number so that both agree.
fn relations(mesh: &Cells, topology: &Topology, p: &Projection) -> Vec<u8> {
    let forward = (!p.perspective).then_some(p.rows[2]);
    let own: Vec<u8> = (0..mesh.cells.len() as u32)
        .into_par_iter()
        .with_min_len(4096)
        .map(|i| sides(p.eye, forward, &mesh.corners(i)))
        .collect();
    (0..own.len())
        .into_par_iter()
        .with_min_len(4096)
        .map(|i| {
            let mut out = 0;
            for (k, &n) in topology.neighbours[i].iter().enumerate() {
                if n != NONE {
                    let (j, l) = (n as usize / 4, n % 4);
                    let bits = if i < j {
                        own[i] >> (2 * k) & 3
                    } else {
                        turned(own[j] >> (2 * l) & 3)
                    };
                    out |= bits << (2 * k);
                }
            }
            out
        })
        .collect()
}

/// Pairs (front, behind) by their front cell.
struct Pairs {
    starts: Vec<u32>,
    behind: Vec<u32>,
}

impl Pairs {
    fn new(n: usize, pairs: &[(u32, u32)]) -> Self {
        if pairs.is_empty() {
            return Self {
                starts: Vec::new(),
                behind: Vec::new(),
            };
        }
        let mut starts = vec![0u32; n + 1];
        for p in pairs {
            starts[p.0 as usize + 1] += 1;
        }
        for i in 1..=n {
            starts[i] += starts[i - 1];
        }
        let mut behind = vec![0u32; pairs.len()];
        let mut next = starts.clone();
        for p in pairs {
            behind[next[p.0 as usize] as usize] = p.1;
            next[p.0 as usize] += 1;
        }
        Self { starts, behind }
    }

    #[inline(always)]
    fn of(&self, cell: usize) -> &[u32] {
        if self.starts.is_empty() {
            return &[];
        }
        &self.behind[self.starts[cell] as usize..self.starts[cell + 1] as usize]
    }
}

/// The graph of relations.
struct Graph<'a> {
    topology: &'a Topology,
    relations: Vec<u8>,
    pairs: Pairs,
}

impl Graph<'_> {
    /// Calls `f` for every cell directly behind one.
    #[inline(always)]
    fn behind(&self, cell: usize, mut f: impl FnMut(usize)) {
        let bits = self.relations[cell];
        for k in 0..4 {
            if bits >> (2 * k) & IN_FRONT != 0 {
                f(self.topology.neighbours[cell][k] as usize / 4);
            }
        }
        self.pairs.of(cell).iter().for_each(|&j| f(j as usize));
    }
}

impl Order {
    /// The meshed polyhedra visibility order; `pairs` (front, behind) across gaps.
    pub(crate) fn visibility(mesh: &Cells, topology: &Topology, projection: &Projection, pairs: &[(u32, u32)]) -> Self {
        let n = mesh.cells.len();
        let graph = Graph {
            topology,
            relations: relations(mesh, topology, projection),
            pairs: Pairs::new(n, pairs),
        };
        let mut before: Vec<u32> = graph.relations.iter().map(|&r| (r & 0b0101_0101).count_ones()).collect();
        pairs.iter().for_each(|p| before[p.1 as usize] += 1);
        let mut out = Self {
            cells: Vec::with_capacity(n),
            groups: Vec::new(),
        };
        // First come, first served: cells that lie together in memory stay so in the order, which those who follow it gain by.
        for (i, before) in before.iter_mut().enumerate().filter(|(_, b)| **b == 0) {
            *before = u32::MAX;
            out.cells.push(i as u32);
        }
        let mut next = 0;
        while let Some(&i) = out.cells.get(next) {
            next += 1;
            if let Some(&ahead) = out.cells.get(next + AHEAD) {
                prefetch(&graph.relations, ahead);
                prefetch(&topology.neighbours, ahead);
            }
            let cells = &mut out.cells;
            graph.behind(i as usize, |j| {
                before[j] -= 1;
                if before[j] == 0 {
                    before[j] = u32::MAX;
                    cells.push(j as u32);
                }
            });
        }
        if out.cells.len() < n {
            out.rest(&graph, |i| before[i] != u32::MAX);
        }
        out
    }

    /// The cells that Kahn's algorithm leaves: strongly connected parts, front to back.
    #[cold]
    fn rest(&mut self, graph: &Graph<'_>, left: impl Fn(usize) -> bool) {
        let n = graph.relations.len();
        // Tarjan's algorithm without recursion; parts come out back to front.
        const UNSEEN: u32 = u32::MAX;
        let (mut index, mut low) = (vec![UNSEEN; n], vec![0u32; n]);
        let mut on_stack = vec![false; n];
        let (mut next, mut stack) = (0u32, Vec::new());
        let mut parts: Vec<Vec<u32>> = Vec::new();
        let mut calls: Vec<(usize, Vec<usize>)> = Vec::new();
        let successors = |i: usize| {
            let mut s = Vec::new();
            graph.behind(i, |j| {
                if left(j) {
                    s.push(j);
                }
            });
            s
        };
        for start in (0..n).filter(|&i| left(i)) {
            if index[start] != UNSEEN {
                continue;
            }
            calls.push((start, successors(start)));
            (index[start], low[start], next) = (next, next, next + 1);
            stack.push(start);
            on_stack[start] = true;
            while let Some((i, todo)) = calls.last_mut() {
                let i = *i;
                if let Some(j) = todo.pop() {
                    if index[j] == UNSEEN {
                        (index[j], low[j], next) = (next, next, next + 1);
                        stack.push(j);
                        on_stack[j] = true;
                        calls.push((j, successors(j)));
                    } else if on_stack[j] {
                        low[i] = low[i].min(index[j]);
                    }
                    continue;
                }
                calls.pop();
                if let Some((above, _)) = calls.last() {
                    low[*above] = low[*above].min(low[i]);
                }
                if low[i] == index[i] {
                    let from = stack
                        .iter()
                        .rposition(|&j| j == i)
                        .expect("the root of a part is on the stack");
                    let part: Vec<u32> = stack.drain(from..).map(|j| j as u32).collect();
                    part.iter().for_each(|&j| on_stack[j as usize] = false);
                    parts.push(part);
                }
            }
        }
        for part in parts.into_iter().rev() {
            let from = self.cells.len() as u32;
            self.cells.extend(&part);
            if part.len() > 1 {
                self.groups.push(from..self.cells.len() as u32);
            }
        }
    }

    /// By the distance of the centroids (perspective) or their depth (orthographic): no guarantee.
    pub(crate) fn centroids(mesh: &Cells, projection: &Projection) -> Self {
        let mut keys: Vec<(f64, u32)> = (0..mesh.cells.len() as u32)
            .into_par_iter()
            .with_min_len(4096)
            .map(|i| {
                let c = mesh.corners(i).iter().sum::<DVec3>() * 0.25;
                let key = if projection.perspective {
                    c.distance_squared(projection.eye)
                } else {
                    projection.depth(c)
                };
                (key, i)
            })
            .collect();
        keys.par_sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        Self {
            cells: keys.into_iter().map(|k| k.1).collect(),
            groups: Vec::new(),
        }
    }

    /// Cells in cycles.
    pub(crate) fn in_cycles(&self) -> usize {
        self.groups.iter().map(|g| (g.end - g.start) as usize).sum()
    }

    pub(crate) fn bytes(&self) -> usize {
        self.cells.len() * 4 + self.groups.len() * 8
    }
}
