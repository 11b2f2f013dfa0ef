//! Which cubes are active by their 27 data: two bits of every sample, joined over neighbourhoods a word at a time.

use super::kinds::Value;
use isobar_cpu::{Kernel, Level};
use rayon::prelude::*;

/// Samples of a word.
const WORD: usize = 64;
/// Samples of a block of the hierarchy along x, y and z.
const BLOCK: [usize; 3] = [16, 4, 4];

/// Least and greatest sample of the blocks of 16 x 4 x 4, x fastest.
#[derive(Debug)]
struct Blocks {
    dims: [usize; 3],
    range: Vec<[f64; 2]>,
}

/// Flags of all cubes.
#[derive(Debug)]
pub(super) struct Flags {
    dims: [usize; 3],
    /// Words of a row.
    words: usize,
    /// Per sample, joined over x and y: whether a neighbour is at least, and at most, the isovalue.
    high: Vec<u64>,
    low: Vec<u64>,
    /// Active cubes.
    active: Vec<u64>,
    /// Of each layer.
    counts: Vec<usize>,
    blocks: Option<Blocks>,
}

impl Flags {
    pub(super) fn new(dims: [usize; 3]) -> Self {
        let words = dims[0].div_ceil(WORD);
        let all = words * dims[1] * dims[2];
        Self {
            dims,
            words,
            high: vec![0; all],
            low: vec![0; all],
            active: vec![0; all],
            counts: vec![0; dims[2]],
            blocks: None,
        }
    }

    pub(super) fn bytes(&self) -> usize {
        8 * (self.high.len() + self.low.len() + self.active.len() + self.counts.len()) + self.block_bytes()
    }

    pub(super) fn block_bytes(&self) -> usize {
        self.blocks.as_ref().map_or(0, |b| size_of_val(b.range.as_slice()))
    }

    /// Works out the hierarchy.
    pub(super) fn keep_blocks<T: Value>(&mut self, data: &[T]) {
        let n = self.dims;
        let dims = [0, 1, 2].map(|a| n[a].div_ceil(BLOCK[a]));
        let mut range = vec![[f64::INFINITY, f64::NEG_INFINITY]; dims.iter().product()];
        range.par_chunks_mut(dims[0]).enumerate().for_each(|(row, out)| {
            let [j, k] = [row % dims[1] * BLOCK[1], row / dims[1] * BLOCK[2]];
            for z in k..(k + BLOCK[2]).min(n[2]) {
                for y in j..(j + BLOCK[1]).min(n[1]) {
                    let samples = data[(z * n[1] + y) * n[0]..][..n[0]].chunks(BLOCK[0]);
                    for (r, piece) in out.iter_mut().zip(samples) {
                        for &v in piece {
                            let v: f64 = v.into();
                            *r = [if v < r[0] { v } else { r[0] }, if v > r[1] { v } else { r[1] }];
                        }
                    }
                }
            }
        });
        self.blocks = Some(Blocks { dims, range });
    }

    /// K8: flags and how many there are of each layer.
    pub(super) fn classify<T: Value>(&mut self, level: Level, data: &[T], isovalue: f64) {
        let layer = (self.words * self.dims[1]).max(1);
        let (dims, words, blocks) = (self.dims, self.words, self.blocks.as_ref());
        self.high
            .par_chunks_mut(layer)
            .zip(self.low.par_chunks_mut(layer))
            .enumerate()
            .for_each_init(
                || [vec![0; layer], vec![0; layer]],
                |[raw_high, raw_low], (z, (high, low))| {
                    level.run(Bits {
                        data: &data[z * dims[0] * dims[1]..][..dims[0] * dims[1]],
                        nx: dims[0],
                        isovalue,
                        blocks: blocks.map(|b| &b.range[z / BLOCK[2] * b.dims[0] * b.dims[1]..][..b.dims[0] * b.dims[1]]),
                        high: raw_high,
                        low: raw_low,
                    });
                    join(words, raw_high, high);
                    join(words, raw_low, low);
                },
            );
        let (high, low) = (&self.high, &self.low);
        let last = dims[2] - 1;
        self.active
            .par_chunks_mut(layer)
            .zip(&mut self.counts)
            .enumerate()
            .for_each(|(z, (out, count))| {
                let at = [z.saturating_sub(1), z, (z + 1).min(last)].map(|z| z * layer..(z + 1) * layer);
                let of = |bits: &'_ [u64], l: usize| -> u64 { at.iter().fold(0, |all, r| all | bits[r.start + l]) };
                *count = 0;
                for (l, o) in out.iter_mut().enumerate() {
                    *o = of(high, l) & of(low, l) & valid(dims[0], l % words);
                    *count += o.count_ones() as usize;
                }
            });
    }

    /// K9: the exclusive scan over the layers, and the compaction.
    pub(super) fn compact(&self, out: &mut Vec<u32>) {
        let layer = (self.words * self.dims[1]).max(1);
        out.resize(self.counts.iter().sum(), 0);
        let mut parts = Vec::with_capacity(self.counts.len());
        let mut rest = out.as_mut_slice();
        for &n in &self.counts {
            let (part, after) = rest.split_at_mut(n);
            parts.push(part);
            rest = after;
        }
        let rows = self.dims[1];
        parts
            .into_par_iter()
            .zip(self.active.par_chunks(layer))
            .enumerate()
            .for_each(|(z, (to, flags))| {
                let mut to = to.iter_mut();
                for (l, &word) in flags.iter().enumerate() {
                    let first = ((z * rows + l / self.words) * self.dims[0] + l % self.words * WORD) as u32;
                    let mut left = word;
                    while left != 0 {
                        if let Some(place) = to.next() {
                            *place = first + left.trailing_zeros();
                        }
                        left &= left - 1;
                    }
                }
            });
    }
}

/// The bits of word `w` of a row that are samples.
fn valid(nx: usize, w: usize) -> u64 {
    let n = nx - (w * WORD).min(nx);
    if n >= WORD { u64::MAX } else { (1 << n) - 1 }
}

/// Every bit joined with its eight neighbours of the layer; outside the grid is the nearest sample, which adds nothing.
fn join(words: usize, raw: &mut [u64], out: &mut [u64]) {
    for row in raw.chunks_mut(words) {
        let mut before = 0;
        for w in 0..words {
            let own = row[w];
            let after = row.get(w + 1).copied().unwrap_or(0);
            row[w] = own | own << 1 | own >> 1 | before >> (WORD - 1) | after << (WORD - 1);
            before = own;
        }
    }
    let rows = raw.len() / words;
    for y in 0..rows {
        let at = [y.saturating_sub(1), y, (y + 1).min(rows - 1)].map(|y| y * words);
        for w in 0..words {
            out[y * words + w] = raw[at[0] + w] | raw[at[1] + w] | raw[at[2] + w];
        }
    }
}

/// Two bits of every sample of a layer.
struct Bits<'a, T> {
    data: &'a [T],
    nx: usize,
    isovalue: f64,
    /// The blocks that the layer goes through.
    blocks: Option<&'a [[f64; 2]]>,
    high: &'a mut [u64],
    low: &'a mut [u64],
}

impl<T: Value> Kernel for Bits<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let words = self.nx.div_ceil(WORD);
        let c = self.isovalue;
        for (y, row) in self.data.chunks_exact(self.nx).enumerate() {
            let (high, low) = (&mut self.high[y * words..][..words], &mut self.low[y * words..][..words]);
            if let Some(blocks) = self.blocks {
                let across = self.nx.div_ceil(BLOCK[0]);
                let blocks = &blocks[y / BLOCK[1] * across..][..across];
                let of = |b: usize| blocks.get(b).copied().unwrap_or([f64::NAN; 2]);
                for (w, piece) in row.chunks(WORD).enumerate() {
                    let ranges = [of(4 * w), of(4 * w + 1), of(4 * w + 2), of(4 * w + 3)];
                    let mixed = ranges
                        .iter()
                        .filter(|[least, greatest]| *least <= c && *greatest >= c)
                        .count();
                    [high[w], low[w]] = match <&[T; WORD]>::try_from(piece) {
                        // Reading on is cheaper than stepping over one block or two.
                        Ok(piece) if mixed > 1 => bits(piece, c),
                        _ => by_block(piece, ranges, c),
                    };
                }
            } else {
                for ((high, low), piece) in high.iter_mut().zip(low).zip(row.chunks(WORD)) {
                    [*high, *low] = if let Ok(piece) = <&[T; WORD]>::try_from(piece) {
                        bits(piece, c)
                    } else {
                        rest(piece, c)
                    };
                }
            }
        }
    }
}

/// The bits of a word, reading only the blocks whose samples lie on both sides.
#[inline(always)]
fn by_block<T: Value>(word: &[T], ranges: [[f64; 2]; WORD / BLOCK[0]], c: f64) -> [u64; 2] {
    let mut out = [0; 2];
    for (b, (&[least, greatest], piece)) in ranges.iter().zip(word.chunks(BLOCK[0])).enumerate() {
        let all = (1u64 << piece.len()) - 1;
        let [high, low] = if least > c {
            [all, 0]
        } else if greatest < c {
            [0, all]
        } else if let Ok(piece) = <&[T; BLOCK[0]]>::try_from(piece) {
            bits(piece, c)
        } else {
            rest(piece, c)
        };
        out[0] |= high << (b * BLOCK[0]);
        out[1] |= low << (b * BLOCK[0]);
    }
    out
}

/// Bits of at least and of at most, of N samples (a multiple of 8, at most 64).
#[inline(always)]
fn bits<T: Value, const N: usize>(piece: &[T; N], c: f64) -> [u64; 2] {
    let (mut high, mut low) = ([0u8; N], [0u8; N]);
    for i in 0..N {
        let v: f64 = piece[i].into();
        high[i] = u8::from(v >= c);
        low[i] = u8::from(v <= c);
    }
    // Eight bytes of 0 or 1 to eight bits: byte k reaches bit 56 + k by the factor 2^(56 - 7 k), and no other product does.
    let pack = |bytes: &[u8; N]| {
        let mut word = 0;
        for (i, eight) in bytes.as_chunks::<8>().0.iter().enumerate() {
            word |= (u64::from_le_bytes(*eight).wrapping_mul(0x0102_0408_1020_4080) >> 56) << (8 * i);
        }
        word
    };
    [pack(&high), pack(&low)]
}

/// The end of a row.
fn rest<T: Value>(piece: &[T], c: f64) -> [u64; 2] {
    let mut out = [0; 2];
    for (i, &v) in piece.iter().enumerate() {
        let v: f64 = v.into();
        out[0] |= u64::from(v >= c) << i;
        out[1] |= u64::from(v <= c) << i;
    }
    out
}
