//! The reconstruction of chunks of one level by convolutions along z, y and x (Algorithms 1 to 3).
//!
//! The thesis gives a thread block a beam of chunks along the direction of a pass and skips the inactive ones. Here a task has a slab, all chunks of
//! one z, so that the three passes follow each other while its values are in the cache: the z pass gathers from the coarser level and the details
//! of the chunk and of its two neighbours (Algorithm 2) into a scratch slab, the y pass goes through that in place with the unchanged values of
//! the chunk before and the chunk itself kept aside (Algorithm 3's pre and main), and the x pass writes the samples.

use super::Number;
use super::banks::{Mirror, REACH, Synthesis};
use super::blocks::{Blocks, CHUNK, ChunkSet, VOLUME};
use isobar_cpu::{Kernel, Level};
use rayon::prelude::*;

/// Slots that eight outputs read.
const WINDOW: usize = CHUNK + 2 * REACH;

type Row<T> = [T; CHUNK];

/// What one level is made from.
#[derive(Debug)]
pub(super) struct Source<'a, T> {
    pub(super) details: &'a Blocks<T>,
    pub(super) active: &'a ChunkSet,
    pub(super) coarse: &'a Blocks<T>,
    pub(super) taps: &'a Synthesis<T>,
    pub(super) mirror: Mirror,
}

/// Reconstructs the chunks of `todo` into `out`; other chunks are left as they are.
pub(super) fn reconstruct<T: Number>(source: &Source<'_, T>, todo: &ChunkSet, out: &mut Blocks<T>, level: Level) {
    let [nx, ny, _] = todo.chunks();
    let slab = nx * ny;
    out.data
        .par_chunks_mut(slab * VOLUME)
        .zip(todo.members().par_chunks(slab))
        .enumerate()
        .filter(|(_, (_, todo))| todo.contains(&true))
        .for_each_init(Vec::new, |scratch, (z, (out, todo))| {
            scratch.resize(slab * VOLUME, T::default());
            level.run(Slab {
                source,
                z,
                todo,
                scratch,
                out,
            });
        });
}

/// One task.
struct Slab<'a, T> {
    source: &'a Source<'a, T>,
    z: usize,
    todo: &'a [bool],
    scratch: &'a mut [T],
    out: &'a mut [T],
}

impl<T: Number> Kernel for Slab<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(mut self) {
        let [nx, ny, _] = self.source.details.chunks;
        // Whether any chunk of `todo` lies within one chunk along x, and along y too.
        let near = |x: usize, y: usize| (x.saturating_sub(1)..=(x + 1).min(nx - 1)).any(|x| self.todo[y * nx + x]);
        let along_y: Vec<bool> = (0..nx * ny).map(|i| near(i % nx, i / nx)).collect();
        let along_z = |x: usize, y: usize| (y.saturating_sub(1)..=(y + 1).min(ny - 1)).any(|y| along_y[y * nx + x]);
        for y in 0..ny {
            for x in 0..nx {
                if along_z(x, y) {
                    self.z_pass(x, y);
                }
            }
        }
        for x in 0..nx {
            self.y_beam(x, &along_y);
        }
        for y in 0..ny {
            for x in 0..nx {
                if self.todo[y * nx + x] {
                    self.x_pass(x, y);
                }
            }
        }
    }
}

/// A row times a weight, added.
#[inline(always)]
fn add<T: Number>(sum: &mut Row<T>, w: T, row: &Row<T>) {
    for (s, &v) in sum.iter_mut().zip(row) {
        *s = *s + w * v;
    }
}

/// The eight outputs of a window of rows: eight convolutions side by side.
#[inline(always)]
fn convolve<T: Number>(window: &[Row<T>; WINDOW], taps: &Synthesis<T>) -> [Row<T>; CHUNK] {
    let mut out = [[T::default(); CHUNK]; CHUNK];
    for (j, sum) in out.iter_mut().enumerate() {
        for &(o, w) in &taps.taps[j % 2] {
            add(sum, w, &window[(j + REACH).wrapping_add_signed(o)]);
        }
    }
    out
}

/// The slots of the window about chunk `i` of a line of `n`: `load(slot, negative)` or zeros.
#[inline(always)]
fn window<T: Number>(mirror: Mirror, i: usize, n: usize, load: impl Fn(usize) -> Row<T>) -> [Row<T>; WINDOW] {
    let mut window = [[T::default(); CHUNK]; WINDOW];
    for (j, row) in window.iter_mut().enumerate() {
        let slot = (i * CHUNK + j) as isize - REACH as isize;
        if let Some((slot, negative)) = mirror.slot(slot, n) {
            *row = load(slot);
            if negative {
                row.iter_mut().for_each(|v| *v = T::dyadic(-1, 0) * *v);
            }
        }
    }
    window
}

#[inline(always)]
fn row_of<T: Number>(values: &[T], at: usize) -> Row<T> {
    *values[at..].first_chunk().expect("rows lie inside chunks")
}

impl<T: Number> Slab<'_, T> {
    fn start(&self, x: usize, y: usize) -> usize {
        (y * self.source.details.chunks[0] + x) * VOLUME
    }

    /// Algorithm 2: the slots along z of chunk (x, y), from the coarser level and the details of active chunks.
    #[inline(always)]
    fn z_pass(&mut self, x: usize, y: usize) {
        let s = self.source;
        let n = s.details.dims[2];
        let start = self.start(x, y);
        for row in 0..CHUNK {
            let gy = y * CHUNK + row;
            let w = window(s.mirror, self.z, n, |slot| s.slots([x, gy, slot]));
            let out = convolve(&w, s.taps);
            for (z, out) in out.iter().enumerate() {
                let at = start + (z * CHUNK + row) * CHUNK;
                self.scratch[at..at + CHUNK].copy_from_slice(out);
            }
        }
    }

    /// Algorithm 3 along y, in place: values already overwritten are read from the copies of the chunk before and of the chunk itself.
    #[inline(always)]
    fn y_beam(&mut self, x: usize, along_y: &[bool]) {
        let s = self.source;
        let [nx, ny, _] = s.details.chunks;
        let n = s.details.dims[1];
        let (mut pre, mut main) = ([T::default(); VOLUME], [T::default(); VOLUME]);
        for y in 0..ny {
            std::mem::swap(&mut pre, &mut main);
            let start = self.start(x, y);
            main.copy_from_slice(&self.scratch[start..start + VOLUME]);
            if !along_y[y * nx + x] {
                continue;
            }
            for z in 0..CHUNK {
                let w = window(s.mirror, y, n, |slot| {
                    let at = (z * CHUNK + slot % CHUNK) * CHUNK;
                    match slot / CHUNK {
                        c if c == y => row_of(&main, at),
                        c if c + 1 == y => row_of(&pre, at),
                        c => row_of(self.scratch, self.start(x, c) + at),
                    }
                });
                let out = convolve(&w, s.taps);
                for (row, out) in out.iter().enumerate() {
                    let at = start + (z * CHUNK + row) * CHUNK;
                    self.scratch[at..at + CHUNK].copy_from_slice(out);
                }
            }
        }
    }

    /// Algorithm 3 along x: eight rows are turned so that the convolutions of the eight lie side by side, and turned back.
    #[inline(always)]
    fn x_pass(&mut self, x: usize, y: usize) {
        let s = self.source;
        let n = s.details.dims[0];
        let start = self.start(x, y);
        for z in 0..CHUNK {
            let w = window(s.mirror, x, n, |slot| {
                let at = self.start(slot / CHUNK, y) + z * CHUNK * CHUNK + slot % CHUNK;
                std::array::from_fn(|row| self.scratch[at + row * CHUNK])
            });
            let out = convolve(&w, s.taps);
            let plane: &mut [T] = &mut self.out[start + z * CHUNK * CHUNK..][..CHUNK * CHUNK];
            for (row, to) in plane.chunks_exact_mut(CHUNK).enumerate() {
                for (v, from) in to.iter_mut().zip(&out) {
                    *v = from[row];
                }
            }
        }
    }
}

impl<T: Number> Source<'_, T> {
    /// Eight slots along x of chunk column `x`: the coarser level's values where all coordinates are even, details of an active chunk elsewhere.
    #[inline(always)]
    fn slots(&self, [x, y, z]: [usize; 3]) -> Row<T> {
        let chunk = [x, y / CHUNK, z / CHUNK];
        let mut row = if self.active.contains(chunk) {
            *self.details.row([x * CHUNK, y, z])
        } else {
            [T::default(); CHUNK]
        };
        if y % 2 == 0 && z % 2 == 0 {
            let at = self.coarse.at([x * CHUNK / 2, y / 2, z / 2]);
            let low: &[T] = &self.coarse.data[at..at + CHUNK / 2];
            for (k, &v) in low.iter().enumerate() {
                row[2 * k] = v;
            }
        }
        row
    }
}
