//! A packet on its way through slices, bricks and cells.

use super::lanes::Lanes;
use super::rays::{Frustum, Place, Rays, Space};
use super::three;
use super::view::{Projection, Seen};
use crate::nodes::bit;

/// The frustum is taken wider by this, index units: far more than rays are rounded by.
const WIDER: f64 = 1e-4;

impl Frustum {
    /// Interval of the i-th minor axis on the slab between planes a and b of the major one. The least of linear functions is concave, the
    /// greatest convex: the chords between the two ends bound them.
    #[inline(always)]
    fn side(&self, i: usize, a: f64, b: f64) -> [f64; 2] {
        let [k0, k1] = self.ends;
        let length = k1 - k0;
        let part = |k: f64| {
            if length == 0.0 {
                0.0
            } else {
                ((k - k0) / length).clamp(0.0, 1.0)
            }
        };
        let (p, q) = (part(a), part(b));
        let [s, e] = self.sides[i];
        let at = |n: usize, x: f64| s[n] + x * (e[n] - s[n]);
        let wider = if length == 0.0 {
            [e[0].min(s[0]), e[1].max(s[1])]
        } else {
            [at(0, p).min(at(0, q)), at(1, p).max(at(1, q))]
        };
        [wider[0] - WIDER, wider[1] + WIDER]
    }

    /// As [`Frustum::side`], for the slab of blocks of `1 << log` cells with index `slice`, in such blocks up to `last`; empty where the
    /// frustum lies outside.
    #[inline(always)]
    fn blocks(&self, i: usize, slice: i32, log: u32, last: i32) -> [i32; 2] {
        let size = f64::from(1 << log);
        let [lo, hi] = self.side(i, f64::from(slice) * size, f64::from(slice + 1) * size);
        let at = |x: f64| (x / size).floor() as i32;
        [at(lo).max(0), at(hi).min(last)]
    }
}

/// Whole numbers of an interval, in the order of travel.
#[inline(always)]
fn steps([lo, hi]: [i32; 2], down: bool) -> impl Iterator<Item = i32> {
    (0..=hi - lo).map(move |n| if down { hi - n } else { lo + n })
}

/// A brick's word of cells with the cells in the order of travel: bit b is that of cell b ^ flip.
#[inline(always)]
fn in_order(mut word: u64, flip: u32) -> u64 {
    const EVEN: [u64; 6] = [
        0x5555_5555_5555_5555,
        0x3333_3333_3333_3333,
        0x0f0f_0f0f_0f0f_0f0f,
        0x00ff_00ff_00ff_00ff,
        0x0000_ffff_0000_ffff,
        0x0000_0000_ffff_ffff,
    ];
    for (i, even) in EVEN.into_iter().enumerate() {
        let n = 1u32 << i;
        if flip & n != 0 {
            word = (word >> n & even) | (word & even) << n;
        }
    }
    word
}

/// Blocks of the tile at (x, y) that hold pixels of the rectangle.
#[inline(always)]
fn covered(s: &Seen, x: f64, y: f64) -> u32 {
    // Pixels ceil(lo) to floor(hi); the casts are saturating.
    let (x0, x1) = ((s.x - s.half[0] - x).ceil() as i32, (s.x + s.half[0] - x).floor() as i32);
    let (y0, y1) = ((s.y - s.half[1] - y).ceil() as i32, (s.y + s.half[1] - y).floor() as i32);
    if x0 > x1 || y0 > y1 || x1 < 0 || y1 < 0 || x0 > 15 || y0 > 15 {
        return 0;
    }
    let (x0, x1) = (x0.max(0) >> 2, x1.min(15) >> 2);
    let (y0, y1) = (y0.max(0) >> 1, y1.min(15) >> 1);
    let columns = ((2u32 << x1) - (1u32 << x0)) * 0x1111_1111;
    let rows = (16u64 << (4 * y1)) - (1u64 << (4 * y0));
    columns & rows as u32
}

/// What packets cross: the active bricks and cells of a volume, and what is done in a cell.
pub trait Cells {
    /// The rays on their way.
    fn rays(&mut self) -> &mut Rays;
    /// Cells per axis.
    fn size(&self) -> [i32; 3];
    /// The active bricks (4^3 cells) of a node (16^3), bit x + 4y + 16z.
    fn node(&self, node: [i32; 3]) -> u64;
    /// Turns to an active brick; gives its active cells.
    fn brick(&mut self, brick: [i32; 3]) -> u64;
    /// Takes those rays of the given blocks through an active cell, bit `bit` of the brick, that meet it.
    fn cell<S: Lanes>(&mut self, blocks: u32, cell: [i32; 3], bit: u32);
}

/// Work done on the way.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Crossed {
    /// Slices of nodes.
    pub nodes: u64,
    /// Active bricks that the tile covers.
    pub bricks: u64,
}

/// What a tile knows on its way.
#[derive(Debug)]
pub struct Crossing<'a> {
    view: &'a Projection,
    /// Upper left pixel.
    x: f64,
    y: f64,
    /// As in [`Place::shift`].
    shift: f64,
    down: [bool; 3],
    /// Bits of a cell's index to turn round.
    flip: u32,
}

impl<'a> Crossing<'a> {
    /// For a packet that has been started.
    #[inline(always)]
    #[must_use]
    pub fn new<D: Space>(p: &Rays, place: &Place<'_, D>, view: &'a Projection) -> Self {
        let far = three(|a| u32::from(p.down[a]));
        Self {
            view,
            x: place.tile.x as f64,
            y: place.tile.y as f64,
            shift: place.shift,
            down: p.down,
            flip: far[0] * 3 + far[1] * 12 + far[2] * 48,
        }
    }

    /// Takes the packet through the volume until all its rays have ended.
    #[inline(always)]
    pub fn cross<S: Lanes, C: Cells>(&self, cells: &mut C, frustum: &Frustum) -> Crossed {
        let mut work = Crossed::default();
        let size = cells.size();
        let last = three(|a| (size[a] - 1) >> 2);
        let k = frustum.major;
        let (i, j) = ((k + 1) % 3, (k + 2) % 3);
        let turned = |[u, v, w]: [i32; 3]| {
            let mut at = [0; 3];
            (at[k], at[i], at[j]) = (u, v, w);
            at
        };
        let reach = |log: u32| {
            let [a, b] = frustum
                .ends
                .map(|e| ((e / f64::from(1 << log)) as i32).clamp(0, last[k] >> (log - 2)));
            [a.min(b), a.max(b)]
        };
        let bricks = reach(2);
        for node in steps(reach(4), self.down[k]) {
            let (ni, nj) = (
                frustum.blocks(0, node, 4, last[i] >> 2),
                frustum.blocks(1, node, 4, last[j] >> 2),
            );
            work.nodes += 1;
            let mut any = 0;
            for v in steps(nj, false) {
                for u in steps(ni, false) {
                    any |= cells.node(turned([node, u, v]));
                }
            }
            if any == 0 {
                continue;
            }
            let slices = [(node << 2).max(bricks[0]), (node << 2 | 3).min(bricks[1])];
            for slice in steps(slices, self.down[k]) {
                let (bi, bj) = (frustum.blocks(0, slice, 2, last[i]), frustum.blocks(1, slice, 2, last[j]));
                for v in steps(bj, self.down[j]) {
                    for u in steps(bi, self.down[i]) {
                        let at = turned([slice, u, v]);
                        let word = cells.node(three(|a| at[a] >> 2));
                        if word >> bit(at) & 1 != 0 {
                            self.brick::<S, C>(cells, at, &mut work);
                            if cells.rays().blocks == 0 {
                                return work;
                            }
                        }
                    }
                }
            }
        }
        work
    }

    #[inline(always)]
    fn brick<S: Lanes, C: Cells>(&self, cells: &mut C, brick: [i32; 3], work: &mut Crossed) {
        let seen = self.view.seen(three(|a| f64::from(brick[a] << 2) + 2.0 - self.shift), 2.0);
        let mut blocks = cells.rays().blocks;
        let mut size = None;
        if let Some((s, cell)) = seen {
            blocks &= covered(&s, self.x, self.y);
            if blocks == 0 {
                return;
            }
            if blocks & (blocks - 1) != 0 {
                size = Some(cell);
            }
        }
        work.bricks += 1;
        let mut left = in_order(cells.brick(brick), self.flip);
        while left != 0 {
            let at = left.trailing_zeros() ^ self.flip;
            left &= left - 1;
            let cell = [
                brick[0] << 2 | (at & 3) as i32,
                brick[1] << 2 | (at >> 2 & 3) as i32,
                brick[2] << 2 | (at >> 4) as i32,
            ];
            let mut live = blocks & cells.rays().blocks;
            if let Some(size) = &size {
                let c = three(|a| f64::from(cell[a]) + 0.5 - self.shift);
                live &= covered(&self.view.cell(c, size), self.x, self.y);
            }
            if live != 0 {
                cells.cell::<S>(live, cell, at);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_put_in_the_order_of_travel() {
        let word = 0x8421_0ff0_1357_9bdf;
        for flip in [0, 3, 12, 48, 15, 51, 60, 63] {
            let turned = in_order(word, flip);
            for b in 0..64u32 {
                assert_eq!(turned >> b & 1, word >> (b ^ flip) & 1, "cell {b}, flip {flip}");
            }
        }
    }

    #[test]
    fn rectangles_cover_the_blocks_that_hold_their_pixels() {
        let blocks = |x: f64, y: f64, half: [f64; 2]| covered(&Seen { x, y, half }, 32.0, 16.0);
        assert_eq!(blocks(40.0, 24.0, [100.0, 100.0]), u32::MAX);
        assert_eq!(blocks(33.0, 17.0, [0.1, 0.1]), 1);
        assert_eq!(blocks(47.0, 31.0, [0.1, 0.1]), 1 << 31);
        assert_eq!(blocks(33.5, 17.0, [0.4, 0.1]), 0, "between two pixels");
        assert_eq!(blocks(31.0, 17.0, [0.9, 0.1]), 0, "left of the tile");
        assert_eq!(blocks(35.5, 17.5, [0.6, 0.6]), 0b0011_0011);
        assert_eq!(blocks(f64::MAX, 17.5, [0.6, 0.6]), 0);
    }

    /// The chords hold every ray of the frustum.
    #[test]
    fn slices_of_a_frustum_are_those_of_its_rays() {
        let f = Frustum {
            major: 2,
            ends: [31.0, 0.0],
            sides: [[[5.0, 6.0], [-2.0, 20.0]], [[3.0, 3.5], [3.0, 3.5]]],
        };
        assert_eq!(f.blocks(0, 7, 2, 7), [1, 1], "x from 4.3 to 7.4 at z from 28 to 31");
        assert_eq!(f.blocks(0, 3, 2, 7), [0, 3], "x from 0.7 to 14.6 at z from 12 to 16");
        assert_eq!(f.blocks(1, 0, 2, 7), [0, 0]);
        assert_eq!(steps([2, 4], true).collect::<Vec<_>>(), [4, 3, 2]);
        assert_eq!(steps([2, 1], false).count(), 0);
    }
}
