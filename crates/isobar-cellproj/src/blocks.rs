//! Squares of the image that cells are sorted into: on the CPU larger than tiles, so that few cells are in several.

use crate::camera::Projection;
use crate::cells::Screen;
use crate::mesh::Cells;
use rayon::prelude::*;

/// Pixels along a side.
pub(crate) const SIDE: usize = 32;
/// Pixels.
pub(crate) const AREA: usize = SIDE * SIDE;

/// One square; it may reach over the right and lower end of the image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Block {
    pub(crate) x: usize,
    pub(crate) y: usize,
    pub(crate) number: usize,
}

impl Block {
    pub(crate) fn columns(p: &Projection) -> usize {
        p.width.div_ceil(SIDE)
    }

    /// All of an image, row by row.
    pub(crate) fn all(p: &Projection) -> impl Iterator<Item = Self> + use<> {
        let columns = Self::columns(p);
        (0..columns * p.height.div_ceil(SIDE)).map(move |number| Self {
            x: number % columns * SIDE,
            y: number / columns * SIDE,
            number,
        })
    }
}

/// Cells put into blocks together.
const CHUNK: usize = 1 << 15;

/// For each block the cells that may cover it, in the order given.
#[derive(Debug)]
pub(crate) struct CellBins(Vec<Chunk>);

#[derive(Debug)]
struct Chunk {
    starts: Vec<u32>,
    cells: Vec<u32>,
}

impl CellBins {
    /// Sorts `cells` for which `wanted` holds.
    pub(crate) fn new(mesh: &Cells, screen: &Screen, cells: &[u32], wanted: impl Fn(u32) -> bool + Sync) -> Self {
        Self::with_side(mesh, screen, cells, SIDE, wanted)
    }

    /// The same with squares of `side` pixels, numbered row by row.
    pub(crate) fn with_side(
        mesh: &Cells,
        screen: &Screen,
        cells: &[u32],
        side: usize,
        wanted: impl Fn(u32) -> bool + Sync,
    ) -> Self {
        let columns = screen.projection.width.div_ceil(side);
        let blocks = columns * screen.projection.height.div_ceil(side);
        let side = side as i32;
        let sort = |cells: &[u32]| {
            let mut starts = vec![0u32; blocks + 2];
            let mut ranges: Vec<[u16; 4]> = Vec::with_capacity(cells.len());
            for &cell in cells {
                let bounds = if wanted(cell) {
                    screen.bounds(&mesh.cells[cell as usize])
                } else {
                    None
                };
                let range = bounds.map_or([1, 0, 1, 0], |b| b.map(|v| (v / side) as u16));
                for y in range[2]..=range[3] {
                    for x in range[0]..=range[1] {
                        starts[usize::from(y) * columns + usize::from(x) + 2] += 1;
                    }
                }
                ranges.push(range);
            }
            for i in 2..starts.len() {
                starts[i] += starts[i - 1];
            }
            let mut out = vec![0u32; starts[blocks + 1] as usize];
            for (&cell, range) in cells.iter().zip(&ranges) {
                for y in range[2]..=range[3] {
                    for x in range[0]..=range[1] {
                        let at = &mut starts[usize::from(y) * columns + usize::from(x) + 1];
                        out[*at as usize] = cell;
                        *at += 1;
                    }
                }
            }
            starts.pop();
            Chunk { starts, cells: out }
        };
        Self(cells.par_chunks(CHUNK).map(sort).collect())
    }

    /// The cells of a block.
    pub(crate) fn of(&self, block: Block) -> impl Iterator<Item = u32> + '_ {
        self.numbered(block.number)
    }

    /// The cells of a square.
    pub(crate) fn numbered(&self, number: usize) -> impl Iterator<Item = u32> + '_ {
        self.0.iter().flat_map(move |c| {
            let range = c.starts[number] as usize..c.starts[number + 1] as usize;
            c.cells[range].iter().copied()
        })
    }

    /// Entries of all blocks.
    pub(crate) fn len(&self) -> usize {
        self.0.iter().map(|c| c.cells.len()).sum()
    }

    pub(crate) fn bytes(&self) -> usize {
        self.0.iter().map(|c| (c.cells.len() + c.starts.len()) * 4).sum()
    }
}
