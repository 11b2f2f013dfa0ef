//! Nodes of 16^3 cells, bricks of 4^3 cells and cells, and the way of a ray through those that may hold a surface.
//!
//! The digital differential analyser of Amanatides and Woo (1987) on three sizes, each of which ends at planes of the next ([`Line::plane`]). Whether anything is in the 4^3 bricks of a node is
//! one load, and so it is for the cells of a brick: the words of either have 64 bits.

use crate::Level;
use crate::index::{Bounds, Line};
use crate::packet::{Lanes, WithLanes, run, three};
use rayon::prelude::*;

/// Cells of a brick, and bricks of a node, per axis: the word of either has 4^3 = 64 bits, x fastest.
pub const SIDE: usize = 4;

/// Bit of cell or brick (x, y, z) in its word; only the lowest two bits of each count.
#[inline(always)]
#[must_use]
pub const fn bit([x, y, z]: [i32; 3]) -> u32 {
    ((z & 3) << 4 | (y & 3) << 2 | (x & 3)) as u32
}

/// Least and greatest datum of every brick; depends on the data alone.
#[derive(Debug)]
pub struct Ranges<T> {
    /// Bricks per axis.
    pub dims: [usize; 3],
    /// Of each brick the least and the greatest datum, x fastest.
    pub range: Vec<[T; 2]>,
}

impl<T: Copy + Into<f64>> Ranges<T> {
    /// Bytes held.
    #[must_use]
    pub fn bytes(&self) -> usize {
        size_of_val(self.range.as_slice())
    }

    /// Least and greatest datum of all.
    #[must_use]
    pub fn whole(&self) -> (f64, f64) {
        self.range
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), &[lo, hi]| {
                (a.min(lo.into()), b.max(hi.into()))
            })
    }
}

/// The bricks of a volume that may hold a surface; made anew when the isovalues change, in time linear in the number of bricks.
#[derive(Debug, Default)]
pub struct Nodes {
    /// Nodes per axis.
    pub dims: [usize; 3],
    /// One per node, x fastest; bit [`bit`] of a brick tells whether it may hold a surface.
    pub words: Vec<u64>,
    /// Such bricks before each node, as [`Nodes::new`] found them.
    before: Vec<u32>,
}

impl Nodes {
    /// The bricks whose range meets one of the isovalues; in the memory of those of `old`, where it suffices.
    #[must_use]
    pub fn new<T: Copy + Into<f64> + Sync>(bricks: &Ranges<T>, bounds: &[Bounds], old: Option<Self>) -> Self {
        let dims = bricks.dims.map(|n| n.div_ceil(SIDE));
        let Self {
            mut words, mut before, ..
        } = old.unwrap_or_default();
        words.clear();
        words.resize(dims.iter().product(), 0u64);
        let level = Level::detect();
        words.par_chunks_mut(dims[0] * dims[1]).enumerate().for_each(|(z, layer)| {
            run(
                level,
                Scan {
                    bricks,
                    bounds,
                    z,
                    layer,
                },
            );
        });
        let mut count = 0u32;
        before.clear();
        before.reserve_exact(words.len());
        before.extend(words.iter().map(|w| {
            let at = count;
            count += w.count_ones();
            at
        }));
        Self { dims, words, before }
    }

    /// Bricks that may hold a surface.
    #[must_use]
    pub fn count(&self) -> usize {
        match (self.before.last(), self.words.last()) {
            (Some(&before), Some(word)) => (before + word.count_ones()) as usize,
            _ => 0,
        }
    }

    /// Bytes held.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.words.len() * 12
    }

    /// Number of the node with these indices.
    #[inline(always)]
    #[must_use]
    pub fn word_of(&self, node: [i32; 3]) -> usize {
        (node[2] as usize * self.dims[1] + node[1] as usize) * self.dims[0] + node[0] as usize
    }

    /// Number, among those that may hold a surface, of the brick with bit `b` of word `w`, which is set.
    #[inline(always)]
    #[must_use]
    pub fn brick(&self, w: usize, b: u32) -> usize {
        let below = self.words[w] & ((1u64 << b) - 1);
        (self.before[w] + below.count_ones()) as usize
    }
}

/// Numbers of a vector that hold the ranges of four bricks, the bricks of a node along x.
const ROW: usize = 2 * SIDE;

/// One layer of nodes: which of their bricks meet an isovalue.
struct Scan<'a, T> {
    bricks: &'a Ranges<T>,
    bounds: &'a [Bounds],
    /// Its number.
    z: usize,
    layer: &'a mut [u64],
}

impl<T: Copy + Into<f64>> WithLanes for Scan<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run<S: Lanes>(self) {
        let [nx, ny, nz] = self.bricks.dims;
        let nodes = nx.div_ceil(SIDE);
        let (z0, z1) = (self.z * SIDE, (self.z * SIDE + SIDE).min(nz));
        for (node, word) in self.layer.iter_mut().enumerate() {
            let (x, y0) = (node % nodes * SIDE, node / nodes * SIDE);
            let wide = (nx - x).min(SIDE);
            let inside = (1u8 << wide) - 1;
            let mut all = 0;
            for k in z0..z1 {
                for j in y0..(y0 + SIDE).min(ny) {
                    let at = (k * ny + j) * nx + x;
                    let row = S::load(&ranges(&self.bricks.range[at..at + wide]));
                    let mut on = 0;
                    for b in self.bounds {
                        on |= met(row, b);
                    }
                    all |= u64::from(on & inside) << ((k & 3) << 4 | (j & 3) << 2);
                }
            }
            *word = all;
        }
    }
}

/// The ranges of up to four bricks in a row; others are zero.
#[inline(always)]
fn ranges<T: Copy + Into<f64>>(row: &[[T; 2]]) -> [f64; ROW] {
    if let Some(&[[a, b], [c, d], [e, f], [g, h]]) = row.first_chunk::<SIDE>() {
        return [a.into(), b.into(), c.into(), d.into(), e.into(), f.into(), g.into(), h.into()];
    }
    let mut out = [0.0; ROW];
    for (i, &[lo, hi]) in row.iter().enumerate() {
        out[2 * i] = lo.into();
        out[2 * i + 1] = hi.into();
    }
    out
}

/// Of four ranges, least and greatest in turn, those that [meet](Bounds::meets) an isovalue.
#[inline(always)]
fn met<S: Lanes>(row: S, bounds: &Bounds) -> u8 {
    const ALL: f64 = f64::INFINITY;
    let (lo, hi) = bounds.ends();
    // The least must not be above the one, the greatest not below the other; the other half of either vector tells nothing.
    let beyond = row.above(S::load(&[hi, ALL, hi, ALL, hi, ALL, hi, ALL]));
    let below = S::load(&[-ALL, lo, -ALL, lo, -ALL, lo, -ALL, lo]).above(row);
    let out = beyond | below;
    let pairs = !(out | out >> 1) & 0x55;
    let fours = (pairs | pairs >> 1) & 0x33;
    (fours | fours >> 2) & 0xf
}

/// What a method does on the way of a ray; `W` is what it keeps of that ray.
///
/// Functions are `#[inline(always)]` where the walk is part of a kernel: what is not inlined is compiled without its instructions.
pub trait Cast<W> {
    /// What is looked up once a brick.
    type Brick;
    /// A node comes.
    fn node(&self, way: &mut W);
    /// An active brick comes: bit [`bit`] of word `word`.
    fn brick(&self, way: &mut W, word: usize, brick: [i32; 3]) -> Self::Brick;
    /// The ray is in a cell of that brick between two parameters. Returns whether to go on.
    fn cell(&self, way: &mut W, brick: &Self::Brick, cell: [i32; 3], from: f64, to: f64) -> bool;
}

#[inline(always)]
fn nearest(t: [f64; 3]) -> usize {
    if t[0] < t[1] {
        if t[0] < t[2] { 0 } else { 2 }
    } else if t[1] < t[2] {
        1
    } else {
        2
    }
}

impl<const HALVES: bool> Line<HALVES> {
    /// Shows the cells of active bricks, of a volume of so many cells per axis, in the order of the ray. Returns false where it was told to stop.
    #[inline(always)]
    pub fn cross<W, C: Cast<W>>(&self, nodes: &Nodes, cells: [i32; 3], cast: &C, way: &mut W) -> bool {
        let last = three(|a| (cells[a] - 1) >> 2);
        let mut brick = three(|a| (self.cell_at(a, self.t0) >> 2).clamp(0, last[a]));
        let mut t = self.t0;
        'node: loop {
            cast.node(way);
            let node = three(|a| brick[a] >> 2);
            let at = nodes.word_of(node);
            let word = nodes.words[at];
            if word != 0 {
                let mut exits = self.exits(brick, 2);
                loop {
                    let a = nearest(exits);
                    // Rounded planes may lie behind where the ray is: it never goes back.
                    let te = exits[a].min(self.t1).max(t);
                    if word >> bit(brick) & 1 != 0 {
                        let held = cast.brick(way, at, brick);
                        if !self.cross_brick(cells, cast, way, (&held, brick), [t, te]) {
                            return false;
                        }
                    }
                    if te >= self.t1 {
                        return true;
                    }
                    brick[a] += self.step[a];
                    t = t.max(te);
                    if brick[a] >> 2 != node[a] {
                        if brick[a] < 0 || brick[a] > last[a] {
                            return true;
                        }
                        continue 'node;
                    }
                    exits[a] = self.plane(a, (brick[a] + self.up[a]) << 2);
                }
            }
            let exits = self.exits(node, 4);
            let a = nearest(exits);
            if exits[a] >= self.t1 {
                return true;
            }
            t = t.max(exits[a]);
            for i in 0..3 {
                brick[i] = (self.cell_at(i, t) >> 2).clamp(node[i] << 2, (node[i] << 2 | 3).min(last[i]));
            }
            brick[a] = if self.step[a] > 0 {
                (node[a] + 1) << 2
            } else {
                (node[a] << 2) - 1
            };
            if brick[a] < 0 || brick[a] > last[a] {
                return true;
            }
        }
    }

    /// The cells of one brick, in which the ray is between t0 and t1.
    #[inline(always)]
    fn cross_brick<W, C: Cast<W>>(
        &self,
        cells: [i32; 3],
        cast: &C,
        way: &mut W,
        (held, brick): (&C::Brick, [i32; 3]),
        [t0, t1]: [f64; 2],
    ) -> bool {
        let mut cell = three(|a| {
            let lo = brick[a] << 2;
            self.cell_at(a, t0).clamp(lo, (lo | 3).min(cells[a] - 1))
        });
        let mut exits = self.exits(cell, 0);
        let mut t = t0;
        loop {
            let a = nearest(exits);
            let te = exits[a].min(t1).max(t);
            if !cast.cell(way, held, cell, t, te) {
                return false;
            }
            if te >= t1 {
                return true;
            }
            cell[a] += self.step[a];
            if cell[a] >> 2 != brick[a] {
                return true;
            }
            t = t.max(te);
            exits[a] = self.plane(a, cell[a] + self.up[a]);
        }
    }
}

const _: () = assert!(SIDE == 4, "words of 64 bits, indices shifted by 2 and 4");

#[cfg(test)]
mod tests {
    use super::*;

    /// Bits are those of [`Bounds::meets`], by all instruction sets, where sizes divide nothing and at the bounds themselves; also in memory that held others.
    #[test]
    fn bricks_that_meet_an_isovalue_are_found() {
        let mut s = 7u32;
        let mut next = || {
            s = s.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (s >> 24) as u8
        };
        let bounds = [Bounds::new(40.0, 0.0, (0.0, 255.0)), Bounds::new(200.0, 1e-2, (0.0, 255.0))];
        let mut old = None;
        for dims in [[1, 1, 1], [4, 4, 4], [9, 5, 3], [7, 8, 13], [3, 2, 1]] {
            let range: Vec<[u8; 2]> = (0..dims.iter().product())
                .map(|_| {
                    let (a, b) = (next(), next() >> 2);
                    [a, a.saturating_add(b)]
                })
                .collect();
            let bricks = Ranges { dims, range };
            let want = |at: [usize; 3]| {
                let [lo, hi] = bricks.range[(at[2] * dims[1] + at[1]) * dims[0] + at[0]].map(f64::from);
                bounds.iter().any(|b| b.meets(lo, hi))
            };
            let nodes = Nodes::new(&bricks, &bounds, old.take());
            let mut count = 0;
            for (w, &word) in nodes.words.iter().enumerate() {
                let node = [
                    w % nodes.dims[0],
                    w / nodes.dims[0] % nodes.dims[1],
                    w / (nodes.dims[0] * nodes.dims[1]),
                ];
                for b in 0..64u32 {
                    let at = three(|a| node[a] * SIDE + (b as usize >> (2 * a) & 3));
                    let inside = (0..3).all(|a| at[a] < dims[a]);
                    let on = word >> b & 1 == 1;
                    assert_eq!(on, inside && want(at), "{at:?} of {dims:?}");
                    if on {
                        assert_eq!(nodes.brick(w, b), count);
                        count += 1;
                    }
                }
                let (z, layer) = (node[2], nodes.dims[0] * nodes.dims[1]);
                for level in Level::ALL {
                    let mut again = vec![!0; layer];
                    let scan = Scan {
                        bricks: &bricks,
                        bounds: &bounds,
                        z,
                        layer: &mut again,
                    };
                    run(level, scan);
                    assert_eq!(again, nodes.words[z * layer..][..layer], "{level}");
                }
            }
            assert_eq!(nodes.count(), count);
            old = Some(nodes);
        }
    }
}
