//! The case table of marching cubes (Lorensen and Cline, SIGGRAPH 1987), derived instead of copied.
//!
//! A corner is inside where s >= c. **Faces**: on each face of the cube, seen from outside and walked counter-clockwise, every run of
//! inside corners is cut off by one directed segment from the edge where the run begins to the edge where it ends. That depends on
//! the four signs alone, so the cell beyond the face draws the same segments the other way round; an ambiguous face (two inside corners
//! across the diagonal) always separates the inside corners. **Loops**: each crossed edge ends one segment and begins
//! another, so the segments close to loops. **Triangles**: each loop is cut by diagonals of which none lies in a face of the cube (a
//! diagonal there could coincide with one of the neighbour's, and four triangles would share it). Seen from outside the surface
//! (s < c), triangles turn counter-clockwise. The result is closed and oriented inside the domain for all fields; it need not have the
//! topology of the trilinear surface (Nielson and Hamann 1991; Chernyaev 1995).

use std::sync::LazyLock;

/// Corners of cube edge `e`: the lower one and the upper one along axis `e / 4`. Bit 0, 1, 2 of a corner is its x, y, z.
pub(crate) const fn corners(e: usize) -> [usize; 2] {
    let axis = e / 4;
    let low = ((e & 1) << ((axis + 1) % 3)) | ((e >> 1 & 1) << ((axis + 2) % 3));
    [low, low | 1 << axis]
}

/// Triangles of the 256 cases.
#[derive(Debug)]
pub(crate) struct Table {
    start: [u16; 257],
    triangles: Vec<[u8; 3]>,
}

impl Table {
    /// Triangles of a case (bit i: corner i is inside), as cube edges.
    pub(crate) fn get(&self, case: usize) -> &[[u8; 3]] {
        &self.triangles[usize::from(self.start[case])..usize::from(self.start[case + 1])]
    }

    fn derive() -> Self {
        let mut start = [0; 257];
        let mut triangles = Vec::new();
        for case in 0..256 {
            for l in loops(case) {
                triangulate(&l, &mut triangles);
            }
            start[case + 1] = triangles.len() as u16;
        }
        Self { start, triangles }
    }
}

/// The table.
pub(crate) static TABLE: LazyLock<Table> = LazyLock::new(Table::derive);

/// The edge between two neighbouring corners.
fn edge_between(a: usize, b: usize) -> usize {
    (0..12)
        .find(|&e| corners(e) == [a.min(b), a.max(b)])
        .expect("the corners are neighbours")
}

/// The corners of a face, counter-clockwise seen from outside.
fn face(axis: usize, upper: bool) -> [usize; 4] {
    let (u, v) = (1 << ((axis + 1) % 3), 1 << ((axis + 2) % 3));
    let base = if upper { 1 << axis } else { 0 };
    if upper {
        [base, base | u, base | u | v, base | v]
    } else {
        [base, base | v, base | u | v, base | u]
    }
}

/// Directed segments of all faces: `next[e]` is the edge at which the segment from edge e ends.
fn segments(case: usize) -> [Option<usize>; 12] {
    let inside = |c: usize| case >> c & 1 == 1;
    let mut next = [None; 12];
    for axis in 0..3 {
        for upper in [false, true] {
            let f = face(axis, upper);
            for i in 0..4 {
                // a run of inside corners begins at i
                if inside(f[i]) && !inside(f[(i + 3) % 4]) {
                    let mut j = i;
                    while inside(f[(j + 1) % 4]) {
                        j += 1;
                    }
                    let (begin, end) = (edge_between(f[(i + 3) % 4], f[i]), edge_between(f[j % 4], f[(j + 1) % 4]));
                    next[begin] = Some(end);
                }
            }
        }
    }
    next
}

/// The closed loops of crossed edges.
fn loops(case: usize) -> Vec<Vec<usize>> {
    let mut next = segments(case);
    let mut all = Vec::new();
    for e in 0..12 {
        let mut one = Vec::new();
        let mut at = e;
        while let Some(to) = next[at].take() {
            one.push(at);
            at = to;
        }
        if !one.is_empty() {
            all.push(one);
        }
    }
    all
}

/// Whether two cube edges lie in a common face.
fn share_a_face(a: usize, b: usize) -> bool {
    let all = corners(a).into_iter().chain(corners(b));
    let (and, or) = all.fold((7, 0), |(and, or), c| (and & c, or | c));
    and != 0 || or != 7
}

/// Cuts a loop into triangles with as few diagonals inside faces as can be: dynamic programming over the sub-polygons i..=j.
fn triangulate(polygon: &[usize], out: &mut Vec<[u8; 3]>) {
    let n = polygon.len();
    let mut cost = vec![vec![(0usize, 0usize); n]; n];
    for length in 2..n {
        for i in 0..n - length {
            let j = i + length;
            let chord = usize::from(length < n - 1 && share_a_face(polygon[i], polygon[j]));
            cost[i][j] = (i + 1..j)
                .map(|k| (cost[i][k].0 + cost[k][j].0 + chord, k))
                .min()
                .expect("there is a vertex between");
        }
    }
    let mut stack = vec![(0, n - 1)];
    while let Some((i, j)) = stack.pop() {
        if j - i >= 2 {
            let k = cost[i][j].1;
            out.push([i, k, j].map(|v| polygon[v] as u8));
            stack.extend([(i, k), (k, j)]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_crossed_edge_is_used_and_no_other() {
        for case in 0..256 {
            let crossed: usize = (0..12)
                .filter(|&e| {
                    let [a, b] = corners(e);
                    (case >> a ^ case >> b) & 1 == 1
                })
                .map(|e| 1 << e)
                .sum();
            let used = TABLE.get(case).iter().flatten().fold(0, |m, e| m | 1 << e);
            assert_eq!(used, crossed, "case {case}");
            let l = loops(case);
            let sizes: usize = l.iter().map(Vec::len).sum();
            assert_eq!(TABLE.get(case).len(), sizes - 2 * l.len());
        }
    }

    #[test]
    fn no_diagonal_lies_in_a_face() {
        for case in 0..256 {
            for l in loops(case) {
                let mut triangles = Vec::new();
                triangulate(&l, &mut triangles);
                let on_loop = |a: u8, b: u8| {
                    let at = |e: u8| l.iter().position(|&x| x == usize::from(e)).expect("on the loop");
                    let d = at(a).abs_diff(at(b));
                    d == 1 || d == l.len() - 1
                };
                for [a, b, c] in triangles {
                    for (p, q) in [(a, b), (b, c), (c, a)] {
                        assert!(on_loop(p, q) || !share_a_face(p.into(), q.into()), "case {case}: {p}-{q}");
                    }
                }
            }
        }
    }

    /// One inside corner: one triangle that looks away from it.
    #[test]
    fn triangles_look_to_the_outside() {
        let middle = |e: u8| {
            let [a, b] = corners(e.into());
            [0, 1, 2].map(|i| ((a >> i & 1) + (b >> i & 1)) as f64 / 2.0)
        };
        let [a, b, c] = TABLE.get(1)[0].map(middle);
        let (u, v): ([f64; 3], [f64; 3]) = (std::array::from_fn(|i| b[i] - a[i]), std::array::from_fn(|i| c[i] - a[i]));
        let normal = [
            u[1] * v[2] - u[2] * v[1],
            u[2] * v[0] - u[0] * v[2],
            u[0] * v[1] - u[1] * v[0],
        ];
        assert!(normal.iter().all(|x| *x > 0.0), "{normal:?}");
        assert_eq!(TABLE.get(1).len(), 1);
        assert!(TABLE.get(0).is_empty() && TABLE.get(255).is_empty());
    }
}
