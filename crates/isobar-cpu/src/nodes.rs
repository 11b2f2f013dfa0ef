//! Nodes of 16^3 cells, bricks of 4^3 cells and cells, and the way of a ray through those that may hold a surface.
//!
//! The digital differential analyser of Amanatides and Woo (1987) on three sizes, each of which ends at planes of the next ([`Line::plane`]). Whether anything is in the 4^3 bricks of a node is
//! one load, and so it is for the cells of a brick: the words of either have 64 bits.

use crate::index::{Bounds, Line};
use crate::packet::three;
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
        words.par_chunks_mut(dims[0] * dims[1]).enumerate().for_each(|(z, layer)| {
            for k in z * SIDE..(z * SIDE + SIDE).min(bricks.dims[2]) {
                for j in 0..bricks.dims[1] {
                    let row = &bricks.range[(k * bricks.dims[1] + j) * bricks.dims[0]..][..bricks.dims[0]];
                    let word = &mut layer[j / SIDE * dims[0]..][..dims[0]];
                    for (i, &[lo, hi]) in row.iter().enumerate() {
                        let (lo, hi) = (lo.into(), hi.into());
                        let on = bounds.iter().any(|b| b.meets(lo, hi));
                        word[i / SIDE] |= u64::from(on) << bit([i as i32, j as i32, k as i32]);
                    }
                }
            }
        });
        let mut count = 0u32;
        before.clear();
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
