//! What the function may be near a chunk, whatever details of the chunk and of finer ones act: bounds for the selection by isovalue (S15).
//!
//! At a point that no detail of a coarser level is missing at, the function is the spline of the next coarser level and some of the wavelets of this level and of finer
//! ones, those of a chunk all or none. A coefficient is moved by details of its level no further up than by all chunks together that move it up, each alone, and no further down; a piece
//! no further than the coefficients that act on it, because B-splines are not negative and sum to 1; and by details of finer levels no further than its own smaller pieces are.

use super::Number;
use super::banks::{Bank, Synthesis};
use super::blocks::{Blocks, CHUNK, ChunkSet};
use super::transform::{movements, synthesise};
use rayon::prelude::*;

/// From the finest level to coarser ones.
#[derive(Debug, Default)]
pub(super) struct Ranges {
    /// How far details of all levels so far move the function up, by piece of the next coarser level.
    up: Vec<f32>,
    /// And down: numbers of at most 0.
    down: Vec<f32>,
}

/// Coefficients before and behind coefficient j that act on piece j.
const fn stencil(bank: Bank) -> (usize, usize) {
    match bank.degree() {
        1 => (0, 1),
        2 => (1, 1),
        _ => (1, 2),
    }
}

/// The pieces that details in slots 0 to 7 of a line act on: from, to.
fn pieces(bank: Bank) -> (isize, isize) {
    let taps = Synthesis::<f32>::new(bank);
    let (mut lo, mut hi) = (0, 0);
    for (parity, taps) in taps.taps.iter().enumerate() {
        for (o, _) in taps {
            // The first and last slot of the parity that this tap reads.
            let slot = (parity as isize + o).rem_euclid(2);
            lo = lo.min(slot - o);
            hi = hi.max(slot + CHUNK as isize - 2 - o);
        }
    }
    let (before, after) = stencil(bank);
    (lo - after as isize, hi + before as isize)
}

impl Ranges {
    /// Takes the next level in, and gives the range of each of its chunks: least and greatest value of the function wherever a detail of the chunk acts.
    pub(super) fn level<T: Number>(&mut self, bank: Bank, details: &Blocks<T>, coarse: &Blocks<T>) -> Vec<(f64, f64)> {
        let (dims, coarser) = (details.dims, coarse.dims);
        let slots: Vec<f32> = details.to_rows().into_iter().map(|v| v.to_f64() as f32).collect();
        let [up, down] = movements(bank, &slots, dims);
        drop(slots);
        let mut up = windows(up, dims, stencil(bank), f32::max);
        let mut down = windows(down, dims, stencil(bank), f32::min);
        add(&mut up, &self.up);
        add(&mut down, &self.down);
        self.up = pooled(&up, dims, coarser, f32::max);
        self.down = pooled(&down, dims, coarser, f32::min);
        // The coarser level, subdivided.
        let mut values = vec![0.0f32; up.len()];
        for (row, from) in coarse.to_rows().chunks(coarser[0]).enumerate() {
            let at = (2 * (row / coarser[1]) * dims[1] + 2 * (row % coarser[1])) * dims[0];
            for (v, from) in values[at..at + dims[0]].iter_mut().step_by(2).zip(from) {
                *v = from.to_f64() as f32;
            }
        }
        let values = synthesise(bank, &values, dims);
        let mut low = windows(values.clone(), dims, stencil(bank), f32::min);
        let mut high = windows(values, dims, stencil(bank), f32::max);
        add(&mut low, &down);
        add(&mut high, &up);
        let set = ChunkSet::new(details.chunks, false);
        let (from, to) = pieces(bank);
        (0..set.members().len())
            .into_par_iter()
            .map(|i| {
                let chunk = set.chunk(i);
                let span = |a: usize| {
                    let first = (CHUNK * chunk[a]) as isize;
                    let last = dims[a] as isize - 1;
                    let piece = |p: isize| (first + p).clamp(0, last) as usize;
                    piece(from)..=piece(to)
                };
                let mut range = (f32::INFINITY, f32::NEG_INFINITY);
                for z in span(2) {
                    for y in span(1) {
                        let row = (z * dims[1] + y) * dims[0];
                        for x in span(0) {
                            range = (range.0.min(low[row + x]), range.1.max(high[row + x]));
                        }
                    }
                }
                (f64::from(range.0), f64::from(range.1))
            })
            .collect()
    }
}

/// The least or greatest of the values from `before` before to `after` behind each, along all axes.
fn windows(mut values: Vec<f32>, dims: [usize; 3], (before, after): (usize, usize), op: fn(f32, f32) -> f32) -> Vec<f32> {
    let [nx, ny, nz] = dims;
    for (axis, (n, stride)) in [(nx, 1), (ny, nx), (nz, nx * ny)].into_iter().enumerate() {
        if n == 1 {
            continue;
        }
        let mut out = values.clone();
        out.par_chunks_mut(nx).enumerate().for_each(|(row, to)| {
            if axis == 0 {
                let from = &values[row * nx..][..nx];
                for (x, v) in to.iter_mut().enumerate() {
                    let window = &from[x.saturating_sub(before)..=(x + after).min(nx - 1)];
                    *v = window.iter().fold(*v, |a, b| op(a, *b));
                }
                return;
            }
            let at = if axis == 1 { row % ny } else { row / ny };
            for k in at.saturating_sub(before)..=(at + after).min(n - 1) {
                let from = &values[row * nx + k * stride - at * stride..][..nx];
                to.iter_mut().zip(from).for_each(|(v, b)| *v = op(*v, *b));
            }
        });
        values = out;
    }
    values
}

/// Adds numbers; none where there are none.
fn add(to: &mut [f32], more: &[f32]) {
    to.iter_mut().zip(more).for_each(|(v, m)| *v += m);
}

/// The least or greatest of the up to 2^3 values in each place of a lattice of half the size, and of 0.
fn pooled(values: &[f32], dims: [usize; 3], to: [usize; 3], op: fn(f32, f32) -> f32) -> Vec<f32> {
    let mut out = vec![0.0f32; to.iter().product()];
    out.par_chunks_mut(to[0]).enumerate().for_each(|(row, out)| {
        for z in (2 * (row / to[1])..dims[2]).take(2) {
            for y in (2 * (row % to[1])..dims[1]).take(2) {
                let from = &values[(z * dims[1] + y) * dims[0]..][..dims[0]];
                for (v, pair) in out.iter_mut().zip(from.chunks(2)) {
                    *v = pair.iter().fold(*v, |a, b| op(a, *b));
                }
            }
        }
    });
    out
}
