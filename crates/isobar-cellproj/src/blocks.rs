//! Squares of the image that cells are sorted into: on the CPU larger than tiles, so that few cells are in several.

use crate::camera::Projection;
use crate::cells::Screen;
use crate::lanes::prefetch;
use crate::mesh::Cells;
use isobar_core::RenderError;
use isobar_cpu::{Kernel, Level, require_memory};
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

/// A cell in a block: its number, and the first and last column and row of the block that it may cover.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Entry {
    pub(crate) cell: u32,
    pub(crate) x: [u8; 2],
    pub(crate) y: [u8; 2],
}

/// For each block the cells that may cover it, in the order given.
#[derive(Debug)]
pub(crate) struct CellBins(Vec<Chunk>);

#[derive(Debug)]
struct Chunk {
    starts: Vec<u32>,
    cells: Vec<Entry>,
}

/// Whether there is room for so many entries of a chunk.
fn require_entries(total: u64) -> Result<(), RenderError> {
    /// Asking takes some 20 us.
    const LARGE: u64 = 1 << 24;
    let what = || "the lists of cells by square; give a smaller --size, or an eye outside the mesh: they".to_owned();
    let bytes = total * size_of::<Entry>() as u64;
    if total > u64::from(u32::MAX) {
        let limit = u64::from(u32::MAX) * size_of::<Entry>() as u64;
        return Err(RenderError::Memory {
            what: what(),
            bytes,
            limit,
        });
    }
    if total > LARGE { require_memory(what, bytes) } else { Ok(()) }
}

/// Cells between asking for a cell, for its corners, and for both.
const AHEAD: usize = 12;

/// Sorts the cells of a chunk.
struct Sort<'a, W> {
    mesh: &'a Cells,
    screen: &'a Screen,
    cells: &'a [u32],
    side: usize,
    wanted: &'a W,
}

/// An empty range of columns and rows.
const NOWHERE: [i32; 4] = [i32::MAX, i32::MIN, i32::MAX, i32::MIN];

impl<W: Fn(u32) -> bool> Kernel for Sort<'_, W> {
    type Output = Result<Chunk, RenderError>;

    #[inline(always)]
    fn run(self) -> Self::Output {
        let columns = self.screen.projection.width.div_ceil(self.side);
        let blocks = columns * self.screen.projection.height.div_ceil(self.side);
        let (side, shift) = (self.side as i32, self.side.trailing_zeros());
        let mut starts = vec![0u32; blocks + 2];
        let mut bounds: Vec<[i32; 4]> = Vec::with_capacity(self.cells.len());
        let mut total = 0;
        for (n, &cell) in self.cells.iter().enumerate() {
            if let Some(&ahead) = self.cells.get(n + 2 * AHEAD) {
                prefetch(&self.mesh.cells, ahead);
            }
            if let Some(&ahead) = self.cells.get(n + AHEAD) {
                self.screen.prefetch(&self.mesh.cells[ahead as usize]);
            }
            let here = if (self.wanted)(cell) {
                self.screen.bounds(&self.mesh.cells[cell as usize]).unwrap_or(NOWHERE)
            } else {
                NOWHERE
            };
            let [x0, x1, y0, y1] = [here[0] >> shift, here[1] >> shift, here[2] >> shift, here[3] >> shift];
            for y in y0..=y1 {
                for x in x0..=x1 {
                    // More than 2^32 are refused below.
                    let n = &mut starts[y as usize * columns + x as usize + 2];
                    *n = n.wrapping_add(1);
                    total += 1;
                }
            }
            bounds.push(here);
        }
        require_entries(total)?;
        for i in 2..starts.len() {
            starts[i] += starts[i - 1];
        }
        let mut out = vec![Entry::default(); starts[blocks + 1] as usize];
        for (&cell, here) in self.cells.iter().zip(&bounds) {
            let [x0, x1, y0, y1] = [here[0] >> shift, here[1] >> shift, here[2] >> shift, here[3] >> shift];
            for y in y0..=y1 {
                for x in x0..=x1 {
                    let at = &mut starts[y as usize * columns + x as usize + 1];
                    let (cx, cy) = (x * side, y * side);
                    out[*at as usize] = Entry {
                        cell,
                        x: [(here[0] - cx).max(0) as u8, (here[1] - cx).min(side - 1) as u8],
                        y: [(here[2] - cy).max(0) as u8, (here[3] - cy).min(side - 1) as u8],
                    };
                    *at += 1;
                }
            }
        }
        starts.pop();
        Ok(Chunk { starts, cells: out })
    }
}

impl CellBins {
    /// Sorts `cells` for which `wanted` holds.
    ///
    /// # Errors
    /// [`RenderError::Memory`] where the lists need more than there is, or more than 2^32 entries for 2^15 cells.
    pub(crate) fn new(
        mesh: &Cells,
        screen: &Screen,
        cells: &[u32],
        wanted: impl Fn(u32) -> bool + Sync,
    ) -> Result<Self, RenderError> {
        Self::with_side(mesh, screen, cells, SIDE, wanted)
    }

    /// The same with squares of `side` pixels, a power of two up to 256, numbered row by row.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub(crate) fn with_side(
        mesh: &Cells,
        screen: &Screen,
        cells: &[u32],
        side: usize,
        wanted: impl Fn(u32) -> bool + Sync,
    ) -> Result<Self, RenderError> {
        debug_assert!(side.is_power_of_two() && side <= 256, "columns in a byte");
        let level = Level::best(Level::Avx2);
        let sort = |cells: &[u32]| {
            level.run(Sort {
                mesh,
                screen,
                cells,
                side,
                wanted: &wanted,
            })
        };
        Ok(Self(cells.par_chunks(CHUNK).map(sort).collect::<Result<_, _>>()?))
    }

    /// The cells of a block.
    pub(crate) fn of(&self, block: Block) -> impl Iterator<Item = u32> + '_ {
        self.numbered(block.number)
    }

    /// The cells of a square.
    pub(crate) fn numbered(&self, number: usize) -> impl Iterator<Item = u32> + '_ {
        self.lists(number).flatten().map(|e| e.cell)
    }

    /// The cells of a square, in pieces.
    pub(crate) fn lists(&self, number: usize) -> impl Iterator<Item = &[Entry]> + '_ {
        let range = move |c: &Chunk| c.starts[number] as usize..c.starts[number + 1] as usize;
        self.0.iter().map(move |c| &c.cells[range(c)])
    }

    /// Entries of all blocks.
    pub(crate) fn len(&self) -> usize {
        self.0.iter().map(|c| c.cells.len()).sum()
    }

    pub(crate) fn bytes(&self) -> usize {
        self.0
            .iter()
            .map(|c| c.cells.len() * size_of::<Entry>() + c.starts.len() * 4)
            .sum()
    }
}
