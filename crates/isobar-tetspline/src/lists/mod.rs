//! Q_active and the 24 lists T_active on the CPU: classification, exclusive prefix scan and compaction, in parallel (K8 to K10).
//!
//! Kalbe et al. 2009, section 4.1, on each change of the isovalue: every cube is classified, a prefix scan over the flags gives each active one its place, and a compaction writes the
//! list; then the same for the 24 kinds of tetrahedra. `tetspline/gpu` does so by kernels; [`Lists`] does it with threads, for programs that want the paper's arrays
//! rather than rays. `tetspline/cpu` itself needs no lists: it asks for bits where a ray comes by.
//!
//! 1. **Cubes** (`flags.rs`). Of every sample two bits, `d >= c` and `d <= c`, 64 samples to a word; the bits of the 27 neighbours are joined by shifts and ors of whole words. A cube whose
//!    neighbourhood has both bits is active by its 27 data: exactly [`Rule::Data`]. With a stored hierarchy (least and greatest sample of blocks of 16 x 4 x 4) the data
//!    are read only where a block has both; the flags are the same.
//! 2. **Tetrahedra** (`kinds.rs`). The 27 data of 64 active cubes side by side, and for each kind the 20 coefficients and their hull, eight cubes to a vector of AVX-512. The coefficients are those of
//!    [`classify`](crate::classify), rounded alike, so the lists agree with its counts.
//! 3. **Determining sets** (`sets.rs`), where they are asked for: sixteen cubes side by side.
//!
//! Everything is exact about the rounded coefficients of f64, as [`count`](crate::classify::count) is, without margin.

mod flags;
mod kinds;
mod sets;
#[cfg(test)]
mod tests;

use crate::classify::{Rule, is_active};
use flags::Flags;
use isobar_core::{DataError, Samples, Tetrahedral};
use isobar_cpu::Level;
use isobar_fields::{Coefficients, Type6Spline};
use kinds::KINDS;
use rayon::prelude::*;
use sets::SET;
use std::time::{Duration, Instant};

/// Cubes classified at a time by one thread.
const CHUNK: usize = 4096;

/// Runs `$body` with the data of a spline, whatever their type.
macro_rules! with_data {
    ($spline:expr, $data:ident => $body:expr) => {
        match $spline.coefficients() {
            Coefficients::Samples(Samples::U8(d)) => {
                let $data: &[u8] = d;
                $body
            }
            Coefficients::Samples(Samples::I16(d)) => {
                let $data: &[i16] = d;
                $body
            }
            Coefficients::Samples(Samples::U16(d)) => {
                let $data: &[u16] = d;
                $body
            }
            Coefficients::Samples(Samples::F32(d)) => {
                let $data: &[f32] = d;
                $body
            }
            Coefficients::F32($data) => $body,
            Coefficients::F64($data) => $body,
        }
    };
}

/// What a change of the isovalue took.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Times {
    /// Classification of cubes by their 27 data, scan and compaction.
    pub cubes: Duration,
    /// Classification of their tetrahedra, scans and compactions, and for other rules than [`Rule::Data`] the compaction of what is left of the cubes.
    pub tetrahedra: Duration,
}

/// The active cubes and tetrahedra of a spline for one isovalue. Memory is kept from one isovalue to the next.
#[derive(Debug)]
pub struct Lists {
    spline: Type6Spline,
    level: Level,
    flags: Flags,
    /// Active by their 27 data, ascending.
    candidates: Vec<u32>,
    /// Bits of active kinds, beside the candidates.
    masks: Vec<u32>,
    /// Active by the rule, where that is another one.
    narrowed: Option<Vec<u32>>,
    /// The 24 lists, one after the other.
    tetrahedra: Vec<u32>,
    /// Where each begins, and where the last one ends.
    bases: [usize; KINDS + 1],
}

impl Lists {
    /// Empty lists. With `hierarchy` the least and greatest sample of every block of 16 x 4 x 4 are stored: worked out once, 16 bytes a block.
    ///
    /// # Errors
    /// [`DataError::Dims`] for more than 2^32 samples, the most that a list of 32-bit numbers can index.
    pub fn new(spline: &Type6Spline, hierarchy: bool) -> Result<Self, DataError> {
        let dims = spline.dims();
        if dims
            .iter()
            .try_fold(1u32, |n, &d| n.checked_mul(u32::try_from(d).ok()?))
            .is_none()
        {
            return Err(DataError::Dims(dims));
        }
        let level = Level::detect();
        let mut flags = Flags::new(dims);
        if hierarchy {
            with_data!(spline, data => flags.keep_blocks(data));
        }
        Ok(Self {
            spline: spline.clone(),
            level,
            flags,
            candidates: Vec::new(),
            masks: Vec::new(),
            narrowed: None,
            tetrahedra: Vec::new(),
            bases: [0; KINDS + 1],
        })
    }

    /// Finds the cubes that are active by their 27 data, on the threads of the current pool; the lists of tetrahedra are empty after it.
    pub fn rebuild_cubes(&mut self, isovalue: f64) -> Duration {
        let start = Instant::now();
        let spline = self.spline.clone();
        with_data!(spline, data => self.flags.classify(self.level, data, isovalue));
        self.flags.compact(&mut self.candidates);
        self.bases = [0; KINDS + 1];
        self.narrowed = None;
        start.elapsed()
    }

    /// Finds everything active anew, on the threads of the current pool.
    pub fn rebuild(&mut self, isovalue: f64, rule: Rule) -> Times {
        let kept = self.narrowed.take();
        let cubes = self.rebuild_cubes(isovalue);
        self.narrowed = kept;
        let start = Instant::now();
        let spline = self.spline.clone();
        with_data!(spline, data => self.classify_kinds(data, isovalue, rule));
        Times {
            cubes,
            tetrahedra: start.elapsed(),
        }
    }

    /// Q_active: the active cubes i + j n_x + k n_x n_y, ascending.
    #[must_use]
    pub fn cubes(&self) -> &[u32] {
        self.narrowed.as_deref().unwrap_or(&self.candidates)
    }

    /// T_active of a kind: the cubes whose tetrahedron of this kind is active, ascending.
    ///
    /// # Panics
    /// When `kind` is not below 24.
    #[must_use]
    pub fn tetrahedra(&self, kind: usize) -> &[u32] {
        &self.tetrahedra[self.bases[kind]..self.bases[kind + 1]]
    }

    /// Active tetrahedra of all kinds.
    #[must_use]
    pub fn count(&self) -> usize {
        self.bases[KINDS]
    }

    /// Bytes of the hierarchy.
    #[must_use]
    pub fn hierarchy_bytes(&self) -> usize {
        self.flags.block_bytes()
    }

    /// Bytes of everything held beyond the data: the lists, with the room they have, flags, and the hierarchy.
    #[must_use]
    pub fn bytes(&self) -> usize {
        let lists = [&self.candidates, &self.masks, &self.tetrahedra];
        let room: usize = lists.into_iter().chain(&self.narrowed).map(|v| v.capacity() * 4).sum();
        room + self.flags.bytes()
    }

    /// The determining sets of the active cubes (K13, the paper's stored variant): 192 times their 56 coefficients, less the isovalue, in the order vertices, edges,
    /// faces of [`isobar_fields::type6::DeterminingSet`]; 224 bytes a cube, as `tetspline/gpu` stores them.
    #[must_use]
    pub fn determining_sets(&self, isovalue: f64) -> Vec<[f32; SET]> {
        let mut out = vec![[0.0; SET]; self.cubes().len()];
        let dims = self.spline.dims();
        let parts = out.par_chunks_mut(CHUNK).zip(self.cubes().par_chunks(CHUNK));
        with_data!(self.spline, data => parts.for_each(|(to, cubes)| sets::store(data, dims, isovalue, cubes, to)));
        out
    }

    /// K10: the kinds of every candidate, the scans over chunks and kinds, the compactions.
    fn classify_kinds<T: kinds::Value>(&mut self, data: &[T], isovalue: f64, rule: Rule) {
        let dims = self.spline.dims();
        self.masks.resize(self.candidates.len(), 0);
        let (level, spline) = (self.level, &self.spline);
        let counts: Vec<Counts> = self
            .masks
            .par_chunks_mut(CHUNK)
            .zip(self.candidates.par_chunks(CHUNK))
            .map(|(masks, cubes)| {
                kinds::classify(level, data, dims, isovalue, cubes, masks);
                if rule == Rule::DeterminingSet {
                    reject(spline, cubes, masks, isovalue);
                }
                Counts::of(masks)
            })
            .collect();
        self.narrow(&counts, rule);
        self.scan_and_compact(&counts);
    }

    /// The cubes with any bit set, for the rules that look at more than the 27 data.
    fn narrow(&mut self, counts: &[Counts], rule: Rule) {
        if rule == Rule::Data {
            self.narrowed = None;
            return;
        }
        let mut out = self.narrowed.take().unwrap_or_default();
        out.resize(counts.iter().map(|c| c.cubes).sum(), 0);
        let mut parts = Vec::with_capacity(counts.len());
        let mut rest = out.as_mut_slice();
        for c in counts {
            let (part, after) = rest.split_at_mut(c.cubes);
            parts.push(part);
            rest = after;
        }
        let from = self.candidates.par_chunks(CHUNK).zip(self.masks.par_chunks(CHUNK));
        parts.into_par_iter().zip(from).for_each(|(to, (cubes, masks))| {
            let kept = cubes.iter().zip(masks).filter(|(_, m)| **m != 0);
            to.iter_mut().zip(kept).for_each(|(t, (c, _))| *t = *c);
        });
        self.narrowed = Some(out);
    }

    /// The exclusive scan over kinds, and chunks within each, gives every chunk its place in every list; there it writes its tetrahedra.
    fn scan_and_compact(&mut self, counts: &[Counts]) {
        for kind in 0..KINDS {
            self.bases[kind + 1] = self.bases[kind] + counts.iter().map(|c| c.kinds[kind]).sum::<usize>();
        }
        self.tetrahedra.resize(self.bases[KINDS], 0);
        let mut parts: Vec<[&mut [u32]; KINDS]> = counts.iter().map(|_| std::array::from_fn(|_| [].as_mut_slice())).collect();
        let mut rest = self.tetrahedra.as_mut_slice();
        for kind in 0..KINDS {
            for (part, c) in parts.iter_mut().zip(counts) {
                let (own, after) = rest.split_at_mut(c.kinds[kind]);
                part[kind] = own;
                rest = after;
            }
        }
        let from = self.candidates.par_chunks(CHUNK).zip(self.masks.par_chunks(CHUNK));
        parts.into_par_iter().zip(from).for_each(|(mut to, (cubes, masks))| {
            let mut at = [0usize; 32];
            for (&cube, &mask) in cubes.iter().zip(masks) {
                let mut left = mask & !KEPT;
                while left != 0 {
                    let kind = left.trailing_zeros() as usize;
                    left &= left - 1;
                    // A kind is below 24 and its place below the count made from the same masks.
                    if let Some(place) = to.get_mut(kind).and_then(|list| list.get_mut(at[kind])) {
                        *place = cube;
                    }
                    at[kind] += 1;
                }
            }
        });
    }
}

/// The paper's rule: cubes whose determining set misses the isovalue lose their tetrahedra, the others are marked.
fn reject(spline: &Type6Spline, cubes: &[u32], masks: &mut [u32], isovalue: f64) {
    for (mask, &cube) in masks.iter_mut().zip(cubes) {
        let mut d = [0.0; 27];
        spline.data(coordinates(cube, spline.dims()), &mut d);
        *mask = if is_active(Rule::DeterminingSet, &d.map(|v| v - isovalue), 0.0) {
            *mask | KEPT
        } else {
            0
        };
    }
}

/// Marks a cube that the paper's rule keeps, whatever its tetrahedra.
const KEPT: u32 = 1 << 31;

/// What a chunk of cubes holds.
#[derive(Debug, Clone, Copy)]
struct Counts {
    /// Cubes with any bit set.
    cubes: usize,
    kinds: [usize; KINDS],
}

impl Counts {
    fn of(masks: &[u32]) -> Self {
        let mut kinds = [0u32; KINDS];
        let mut cubes = 0;
        for &m in masks {
            cubes += usize::from(m != 0);
            for (k, n) in kinds.iter_mut().enumerate() {
                *n += m >> k & 1;
            }
        }
        Self {
            cubes,
            kinds: kinds.map(|n| n as usize),
        }
    }
}

/// A cube from its index.
fn coordinates(cube: u32, dims: [usize; 3]) -> [usize; 3] {
    let n = cube as usize;
    [n % dims[0], n / dims[0] % dims[1], n / dims[0] / dims[1]]
}
