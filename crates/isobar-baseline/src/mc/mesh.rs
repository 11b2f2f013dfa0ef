//! From samples to indexed meshes of blocks of cells, one isovalue at a time, in parallel over slabs of the lattice.
//!
//! Signs are kept as bits, 64 samples to a word, so that the cells that hold a surface are found 64 at a time. A vertex belongs to a
//! lattice edge, and its number is its rank among the crossed edges: no table of numbers is kept and no vertex is made twice.

use super::table::{TABLE, corners};
use crate::march::volume::Sample;
use rayon::prelude::*;

/// Samples of a grid (x fastest), seen on a lattice `factor` times finer by trilinear interpolation.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lattice<'a, T> {
    data: &'a [T],
    coarse: [usize; 3],
    dims: [usize; 3],
    factor: usize,
}

impl<'a, T: Sample> Lattice<'a, T> {
    pub(crate) fn new(data: &'a [T], coarse: [usize; 3], factor: usize) -> Self {
        Self {
            data,
            coarse,
            dims: coarse.map(|n| (n - 1) * factor + 1),
            factor,
        }
    }

    /// The coarse index at or before a fine one, and how far beyond it the fine one lies.
    fn split(&self, i: usize, axis: usize) -> (usize, f64) {
        let cell = (i / self.factor).min(self.coarse[axis] - 2);
        (cell, (i - cell * self.factor) as f64 / self.factor as f64)
    }

    /// One row of the lattice along x.
    fn row(&self, j: usize, k: usize, blend: &mut [f64], out: &mut [f64]) {
        let [nx, ny, _] = self.coarse;
        let line = |j: usize, k: usize| &self.data[(k * ny + j) * nx..][..nx];
        if self.factor == 1 {
            for (o, s) in out.iter_mut().zip(line(j, k)) {
                *o = s.f64();
            }
            return;
        }
        let ((y, wy), (z, wz)) = (self.split(j, 1), self.split(k, 2));
        let lines = [line(y, z), line(y, z + 1), line(y + 1, z), line(y + 1, z + 1)];
        for (i, b) in blend.iter_mut().enumerate() {
            let [p, q, r, s] = lines.map(|l| l[i].f64());
            let (a, c) = (p + wz * (q - p), r + wz * (s - r));
            *b = a + wy * (c - a);
        }
        for (i, o) in out.iter_mut().enumerate() {
            let (x, w) = self.split(i, 0);
            *o = blend[x] + w * (blend[x + 1] - blend[x]);
        }
    }

    /// One value, with the bits that `row` gives.
    fn value(&self, [i, j, k]: [usize; 3]) -> f64 {
        let [nx, ny, _] = self.coarse;
        if self.factor == 1 {
            return self.data[(k * ny + j) * nx + i].f64();
        }
        let ((x, wx), (y, wy), (z, wz)) = (self.split(i, 0), self.split(j, 1), self.split(k, 2));
        let at = |i: usize, j: usize, k: usize| self.data[(k * ny + j) * nx + i].f64();
        let blend = |i: usize| {
            let (p, q, r, s) = (at(i, y, z), at(i, y, z + 1), at(i, y + 1, z), at(i, y + 1, z + 1));
            let (a, c) = (p + wz * (q - p), r + wz * (s - r));
            a + wy * (c - a)
        };
        let b = blend(x);
        b + wx * (blend(x + 1) - b)
    }
}

/// Cells per tile along x, y and z: a tile's edges, at most `3 * 33 * 33 * 17`, are numbered by 16 bits.
const TILE: [usize; 3] = [32, 32, 16];

/// Layers of cells in a slab: two tiles. Slabs are made in parallel.
const SLAB: usize = 2 * TILE[2];

/// Two tiles, one upon the other, make a block where they have no more triangles than this, whose corners 16 bits can number even if they
/// share none. Blocks want to be cubes: the builder of hierarchies orders triangles by their place in the block relative to its sides.
const MOST_TRIANGLES: usize = (1 << 16) / 3;

/// A vertex: a point of a lattice edge, 8 bytes, placed to 2^-24 of the edge wherever it lies.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Vertex {
    /// Lower end of the edge on the (refined) lattice, from the block's first point on.
    base: [u8; 3],
    /// Axis of the edge.
    axis: u8,
    /// Position along the edge, 0 to 1.
    w: f32,
}

impl Vertex {
    /// Index-space position, in cells of the grid, in a block that begins at `origin`.
    #[inline(always)]
    pub(crate) fn position(&self, origin: [u16; 3], scale: f64) -> [f64; 3] {
        let mut p: [f64; 3] = std::array::from_fn(|a| f64::from(u32::from(origin[a]) + u32::from(self.base[a])));
        p[usize::from(self.axis)] += f64::from(self.w);
        p.map(|x| x * scale)
    }
}

/// The mesh of one isovalue in one block of cells, with vertices of its own. Blocks that share a face place the vertices there alike, to the
/// bit, so that the whole is as closed as if they were one.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Block {
    /// First lattice point.
    pub(crate) origin: [u16; 3],
    /// Number of its isovalue.
    pub(crate) isovalue: u16,
    pub(crate) vertices: Vec<Vertex>,
    /// Counter-clockwise seen from where s < c.
    pub(crate) triangles: Vec<[u16; 3]>,
}

/// The lattice has more points along an axis, or the mesh more triangles, than can be numbered.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct TooLarge;

/// Most lattice points along an axis.
pub(crate) const MOST_POINTS: usize = 1 << 16;

/// The surface s = c in blocks, those without triangles left out: each passes through `finish` in the thread that made it, then, in an order
/// that does not depend on the number of threads, to `take`. No more than one slab per thread is held at a time.
///
/// # Errors
/// [`TooLarge`] beyond [`MOST_POINTS`] lattice points along an axis, and what `take` returns.
pub(crate) fn blocks<T: Sample, B: Send, E: From<TooLarge>>(
    lattice: &Lattice<'_, T>,
    c: f64,
    isovalue: u16,
    finish: impl Fn(Block) -> B + Sync,
    mut take: impl FnMut(B) -> Result<(), E>,
) -> Result<(), E> {
    if lattice.dims.iter().any(|&n| n > MOST_POINTS) {
        return Err(TooLarge.into());
    }
    let slabs: Vec<usize> = (0..lattice.dims[2] - 1).step_by(SLAB).collect();
    for some in slabs.chunks(rayon::current_num_threads()) {
        let made: Vec<Vec<B>> = some
            .par_iter()
            .map(|&k0| slab(lattice, c, k0).blocks(lattice.dims, k0, isovalue).map(&finish).collect())
            .collect();
        made.into_iter().flatten().try_for_each(&mut take)?;
    }
    Ok(())
}

/// A vertex of a slab.
#[derive(Debug, Clone, Copy)]
struct Crossing {
    base: [u16; 3],
    axis: u8,
    w: f32,
}

/// The surface in one slab of cells.
struct Slab {
    vertices: Vec<Crossing>,
    /// Triangles by tile, x fastest, z slowest; vertices are numbered through the slab.
    tiles: Vec<Vec<[u32; 3]>>,
}

/// Tiles along x and y.
fn tiles(dims: [usize; 3]) -> [usize; 2] {
    [0, 1].map(|a| (dims[a] - 1).div_ceil(TILE[a]))
}

/// The tiles of each block.
fn groups(lists: &[Vec<[u32; 3]>], dims: [usize; 3]) -> Vec<Vec<usize>> {
    let below = tiles(dims).into_iter().product();
    let mut groups = Vec::new();
    for t in 0..below {
        let full: Vec<usize> = [t, t + below].into_iter().filter(|&t| !lists[t].is_empty()).collect();
        if full.iter().map(|&t| lists[t].len()).sum::<usize>() <= MOST_TRIANGLES {
            groups.push(full);
        } else {
            groups.extend(full.into_iter().map(|t| vec![t]));
        }
    }
    groups.retain(|g| !g.is_empty());
    groups
}

impl Slab {
    /// One block after the other, with vertices numbered anew.
    fn blocks(mut self, dims: [usize; 3], k0: usize, isovalue: u16) -> impl Iterator<Item = Block> {
        const UNSEEN: u32 = u32::MAX;
        let [nx, ny] = tiles(dims);
        let mut number = vec![UNSEEN; self.vertices.len()];
        let mut used: Vec<u32> = Vec::new();
        groups(&self.tiles, dims).into_iter().map(move |group| {
            let first = group[0];
            let tile = [first % nx, first / nx % ny, first / (nx * ny)];
            let from = [0, 0, k0];
            let origin: [usize; 3] = std::array::from_fn(|a| from[a] + tile[a] * TILE[a]);
            let mut triangles = Vec::with_capacity(group.iter().map(|&t| self.tiles[t].len()).sum());
            for tile in group {
                for t in std::mem::take(&mut self.tiles[tile]) {
                    triangles.push(t.map(|v| {
                        let n = &mut number[v as usize];
                        if *n == UNSEEN {
                            *n = used.len() as u32;
                            used.push(v);
                        }
                        *n as u16
                    }));
                }
            }
            let local = |v: &Crossing| Vertex {
                base: std::array::from_fn(|a| (usize::from(v.base[a]) - origin[a]) as u8),
                axis: v.axis,
                w: v.w,
            };
            let own = used.iter().map(|&v| local(&self.vertices[v as usize])).collect();
            for v in used.drain(..) {
                number[v as usize] = UNSEEN;
            }
            Block {
                origin: origin.map(|i| i as u16),
                isovalue,
                vertices: own,
                triangles,
            }
        })
    }
}

/// Bits of one layer, row by row, a whole number of words each.
struct Bits {
    words: Vec<u64>,
    per_row: usize,
}

impl Bits {
    fn row(&self, j: usize) -> &[u64] {
        &self.words[j * self.per_row..][..self.per_row]
    }

    #[inline(always)]
    fn get(&self, i: usize, j: usize) -> usize {
        (self.words[j * self.per_row + i / 64] >> (i % 64) & 1) as usize
    }
}

/// The row moved down by one sample.
#[inline(always)]
fn shifted(row: &[u64], w: usize) -> u64 {
    row[w] >> 1 | row.get(w + 1).map_or(0, |n| n << 63)
}

/// Which edges of one direction in a layer are crossed, and how many come before each word.
struct Edges {
    bits: Bits,
    before: Vec<u32>,
    count: u32,
    /// Number of the first in the slab.
    first: u32,
}

impl Edges {
    fn new(bits: Bits, first: u32) -> Self {
        let mut count = 0;
        let before = bits
            .words
            .iter()
            .map(|w| {
                let n = count;
                count += w.count_ones();
                n
            })
            .collect();
        Self {
            bits,
            before,
            count,
            first,
        }
    }

    fn number(&self, i: usize, j: usize) -> u32 {
        let at = j * self.bits.per_row + i / 64;
        let below = self.bits.words[at] & ((1 << (i % 64)) - 1);
        self.first + self.before[at] + below.count_ones()
    }

    /// Calls `f(i, j)` for each crossed edge in order.
    fn each(&self, mut f: impl FnMut(usize, usize)) {
        for (at, &word) in self.bits.words.iter().enumerate() {
            let mut word = word;
            while word != 0 {
                f(
                    at % self.bits.per_row * 64 + word.trailing_zeros() as usize,
                    at / self.bits.per_row,
                );
                word &= word - 1;
            }
        }
    }
}

/// What is known of one layer: signs, and crossed edges along x and y.
struct Layer {
    signs: Bits,
    x: Edges,
    y: Edges,
}

impl Layer {
    fn new<T: Sample>(lattice: &Lattice<'_, T>, c: f64, k: usize, first: u32) -> Self {
        let [nx, ny, _] = lattice.dims;
        let per_row = nx.div_ceil(64);
        let mut words = Vec::with_capacity(ny * per_row);
        let mut blend = vec![0.0; if lattice.factor == 1 { 0 } else { lattice.coarse[0] }];
        let mut row = vec![0.0; nx];
        for j in 0..ny {
            lattice.row(j, k, &mut blend, &mut row);
            words.extend(
                row.chunks(64)
                    .map(|v| v.iter().enumerate().fold(0, |w, (b, s)| w | u64::from(*s >= c) << b)),
            );
        }
        let signs = Bits { words, per_row };
        let along_x = (0..ny)
            .flat_map(|j| {
                let row = signs.row(j);
                (0..per_row).map(move |w| (row[w] ^ shifted(row, w)) & cells(nx, w))
            })
            .collect();
        let along_y = (0..ny - 1)
            .flat_map(|j| {
                let (p, q) = (signs.row(j), signs.row(j + 1));
                (0..per_row).map(move |w| p[w] ^ q[w])
            })
            .collect();
        let x = Edges::new(Bits { words: along_x, per_row }, first);
        let y = Edges::new(Bits { words: along_y, per_row }, first + x.count);
        Self { signs, x, y }
    }
}

/// The bits of word w that are cells: all samples of the row but the last.
fn cells(nx: usize, w: usize) -> u64 {
    let n = (nx - 1).saturating_sub(w * 64);
    if n >= 64 { u64::MAX } else { (1 << n) - 1 }
}

/// The cells of layers from `k0` on.
fn slab<T: Sample>(lattice: &Lattice<'_, T>, c: f64, k0: usize) -> Slab {
    let k1 = (k0 + SLAB).min(lattice.dims[2] - 1);
    let [nx, ny] = tiles(lattice.dims);
    let mut slab = Slab {
        vertices: Vec::new(),
        tiles: vec![Vec::new(); 2 * nx * ny],
    };
    let mut lower = Layer::new(lattice, c, k0, 0);
    place(lattice, c, k0, &lower, &mut slab.vertices);
    for k in k0..k1 {
        let mut upper = Layer::new(lattice, c, k + 1, 0);
        let words = lower.signs.words.iter().zip(&upper.signs.words).map(|(p, q)| p ^ q).collect();
        let per_row = lower.signs.per_row;
        let z = Edges::new(Bits { words, per_row }, lower.y.first + lower.y.count);
        upper.x.first = z.first + z.count;
        upper.y.first = upper.x.first + upper.x.count;
        z.each(|i, j| slab.vertices.push(vertex(lattice, c, 2, [i, j, k])));
        place(lattice, c, k + 1, &upper, &mut slab.vertices);
        let above = (k - k0) / TILE[2] * nx * ny;
        triangles(lattice.dims, &lower, &upper, &z, &mut slab.tiles[above..]);
        lower = upper;
    }
    slab
}

/// The vertices inside a layer, in the order of their numbers.
fn place<T: Sample>(lattice: &Lattice<'_, T>, c: f64, k: usize, layer: &Layer, out: &mut Vec<Crossing>) {
    layer.x.each(|i, j| out.push(vertex(lattice, c, 0, [i, j, k])));
    layer.y.each(|i, j| out.push(vertex(lattice, c, 1, [i, j, k])));
}

/// Where the linear function along an edge is c: exact for trilinear interpolation, rounded to f32 of the edge.
fn vertex<T: Sample>(lattice: &Lattice<'_, T>, c: f64, axis: u8, base: [usize; 3]) -> Crossing {
    let mut end = base;
    end[usize::from(axis)] += 1;
    let (a, b) = (lattice.value(base), lattice.value(end));
    // one end is >= c and the other is not, so they differ
    let w = ((c - a) / (b - a)).clamp(0.0, 1.0) as f32;
    Crossing {
        base: base.map(|i| i as u16),
        axis,
        w,
    }
}

/// The triangles of one layer of cells, by tile.
fn triangles(dims: [usize; 3], lower: &Layer, upper: &Layer, z: &Edges, out: &mut [Vec<[u32; 3]>]) {
    let layers = [lower, upper];
    for j in 0..dims[1] - 1 {
        let first_tile = j / TILE[1] * tiles(dims)[0];
        let rows = [
            lower.signs.row(j),
            lower.signs.row(j + 1),
            upper.signs.row(j),
            upper.signs.row(j + 1),
        ];
        for w in 0..lower.signs.per_row {
            let (mut any, mut all) = (0, u64::MAX);
            for row in rows {
                let next = shifted(row, w);
                any |= row[w] | next;
                all &= row[w] & next;
            }
            let mut active = any & !all & cells(dims[0], w);
            while active != 0 {
                let i = w * 64 + active.trailing_zeros() as usize;
                active &= active - 1;
                let sign = |c: usize| layers[c >> 2].signs.get(i + (c & 1), j + (c >> 1 & 1)) << c;
                let case = (0..8).map(sign).sum();
                let number = |e: u8| {
                    let low = corners(e.into())[0];
                    let (x, y, layer) = (i + (low & 1), j + (low >> 1 & 1), layers[low >> 2]);
                    match e / 4 {
                        0 => layer.x.number(x, y),
                        1 => layer.y.number(x, y),
                        _ => z.number(x, y),
                    }
                };
                out[first_tile + i / TILE[0]].extend(TABLE.get(case).iter().map(|t| t.map(number)));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::Seed;
    use std::collections::HashMap;

    /// All blocks as one mesh: vertices by lattice edge.
    struct Mesh {
        vertices: Vec<[f64; 3]>,
        triangles: Vec<[u32; 3]>,
    }

    impl Mesh {
        fn new<T: Sample>(lattice: &Lattice<'_, T>, c: f64) -> Self {
            let mut mesh = Self {
                vertices: Vec::new(),
                triangles: Vec::new(),
            };
            let mut numbers = HashMap::new();
            let mut all = Vec::new();
            let add = |b| {
                all.push(b);
                Ok::<(), TooLarge>(())
            };
            blocks(lattice, c, 3, |b| b, add).unwrap();
            for b in all {
                assert_eq!((b.isovalue, b.triangles.is_empty()), (3, false));
                for t in &b.triangles {
                    mesh.triangles.push(t.map(|v| {
                        let vertex = b.vertices[usize::from(v)];
                        let base: [u32; 3] = std::array::from_fn(|a| u32::from(b.origin[a]) + u32::from(vertex.base[a]));
                        let next = mesh.vertices.len() as u32;
                        let n = *numbers.entry((base, vertex.axis)).or_insert(next);
                        if n == next {
                            mesh.vertices.push(vertex.position(b.origin, 1.0));
                        }
                        assert_eq!(mesh.vertices[n as usize], vertex.position(b.origin, 1.0), "blocks disagree");
                        n
                    }));
                }
            }
            mesh
        }
    }

    /// Directed edges of the triangles and how often each occurs.
    fn directed(mesh: &Mesh) -> HashMap<(u32, u32), u32> {
        let mut edges = HashMap::new();
        for [a, b, c] in &mesh.triangles {
            for e in [(*a, *b), (*b, *c), (*c, *a)] {
                *edges.entry(e).or_insert(0) += 1;
            }
        }
        edges
    }

    /// Every edge is used once in each direction, or once and it lies in a face of the domain.
    fn assert_closed(mesh: &Mesh, dims: [usize; 3]) {
        let edges = directed(mesh);
        for (&(a, b), &n) in &edges {
            assert_eq!(n, 1, "edge {a}-{b} is used {n} times in one direction");
            if !edges.contains_key(&(b, a)) {
                let (p, q) = (mesh.vertices[a as usize], mesh.vertices[b as usize]);
                let on_face = (0..3).any(|i| p[i] == q[i] && (p[i] == 0.0 || p[i] == (dims[i] - 1) as f64));
                assert!(on_face, "{p:?} - {q:?} is an open edge inside");
            }
        }
    }

    /// Random fields meet all 256 cases, on all borders of slabs and words.
    #[test]
    fn surfaces_are_closed_inside_the_domain() {
        let mut seed = Seed(11);
        let mut met = [false; 256];
        for dims in [[6, 5, 40], [70, 4, 3], [2, 2, 2], [9, 9, 9], [66, 35, 19]] {
            for _ in 0..4 {
                let data: Vec<f32> = (0..dims.iter().product()).map(|_| seed.next() as f32 - 0.5).collect();
                for k in 0..dims[2] - 1 {
                    for j in 0..dims[1] - 1 {
                        for i in 0..dims[0] - 1 {
                            let at = |c: usize| data[((k + (c >> 2)) * dims[1] + j + (c >> 1 & 1)) * dims[0] + i + (c & 1)];
                            met[(0..8).map(|c| usize::from(at(c) >= 0.0) << c).sum::<usize>()] = true;
                        }
                    }
                }
                for factor in [1, 2] {
                    let lattice = Lattice::new(&data, dims, factor);
                    assert_closed(&Mesh::new(&lattice, 0.0), lattice.dims);
                }
            }
        }
        assert!(met.iter().all(|m| *m), "all cases are met");
    }

    /// Vertices lie where the trilinear function along the lattice edge is c, at every refinement.
    #[test]
    fn vertices_are_on_the_surface() {
        let dims = [5, 6, 20];
        let data: Vec<f32> = (0..600).map(|i| ((i * 7919) % 1009) as f32).collect();
        for factor in [1, 2, 4] {
            let lattice = Lattice::new(&data, dims, factor);
            let mesh = Mesh::new(&lattice, 500.25);
            let volume = crate::march::volume::Volume::<f32, 2>::new(&data, dims, isobar_fields::Border::Clamp);
            for v in &mesh.vertices {
                let s = volume.value(crate::march::volume::Point::new(v.map(|x| x / factor as f64)));
                assert!((s - 500.25).abs() < 1e-3, "{v:?}: {s}");
            }
        }
    }

    /// A sphere has Euler characteristic 2, its volume, and outward triangles.
    #[test]
    fn a_sphere_is_a_sphere() {
        let n = 33;
        let data: Vec<f32> = (0..n * n * n)
            .map(|i| {
                let p = [i % n, i / n % n, i / n / n].map(|x| x as f32 - 16.0);
                -(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]).sqrt()
            })
            .collect();
        let mesh = Mesh::new(&Lattice::new(&data, [n; 3], 1), -12.0);
        let (v, t) = (mesh.vertices.len() as i64, mesh.triangles.len() as i64);
        let edges = directed(&mesh).len() as i64 / 2;
        assert_eq!(v - edges + t, 2);
        let volume: f64 = mesh
            .triangles
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(|i| isobar_core::DVec3::from_array(mesh.vertices[i as usize]) - 16.0);
                a.dot(b.cross(c)) / 6.0
            })
            .sum();
        let want = 4.0 / 3.0 * std::f64::consts::PI * 12f64.powi(3);
        assert!((volume / want - 1.0).abs() < 0.01, "{volume} for {want}");
    }

    /// Random samples cross so many edges that tiles stay blocks of their own; a smooth field's are joined.
    #[test]
    fn full_tiles_are_not_joined() {
        let mut seed = Seed(3);
        let noise: Vec<f32> = (0..33 * 33 * 33).map(|_| seed.next() as f32 - 0.5).collect();
        let smooth: Vec<f32> = (0..33 * 33 * 33).map(|i| (i % 33) as f32 - 8.3).collect();
        for (data, count) in [(noise, 2), (smooth, 1)] {
            let lattice = Lattice::new(&data, [33, 33, 33], 1);
            assert_closed(&Mesh::new(&lattice, 0.0), lattice.dims);
            let mut n = 0;
            let add = |_| {
                n += 1;
                Ok::<(), TooLarge>(())
            };
            blocks(&lattice, 0.0, 3, |b| b, add).unwrap();
            assert_eq!(n, count);
        }
    }

    #[test]
    fn a_lattice_that_cannot_be_numbered_is_refused() {
        let data = vec![0u8; 4 * 40_000];
        let lattice = Lattice::new(&data, [40_000, 2, 2], 2);
        assert_eq!(blocks(&lattice, 0.5, 0, |b| b, |_| Ok(())), Err(TooLarge));
    }
}
