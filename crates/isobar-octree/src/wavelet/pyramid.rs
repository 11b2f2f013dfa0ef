//! The decomposition of a volume into levels of wavelet coefficients (S14, S16).

use super::banks::Synthesis;
use super::blocks::{Blocks, CHUNK, ChunkSet, VOLUME, chunks_of, index_of};
use super::ranges::Ranges;
use super::transform::{analyse, low};
use super::{Bank, Number};
use glam::{DMat3, DVec3};
use isobar_core::{DataError, Domain, Grid, Samples};
use rayon::prelude::*;

/// Where a lattice lies in the world: [`Grid`]'s spacing, origin and direction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placement {
    /// World distance of samples.
    pub spacing: DVec3,
    /// World position of sample (0, 0, 0).
    pub origin: DVec3,
    /// Columns: unit directions of the axes.
    pub direction: DMat3,
}

impl Default for Placement {
    fn default() -> Self {
        Self {
            spacing: DVec3::ONE,
            origin: DVec3::ZERO,
            direction: DMat3::IDENTITY,
        }
    }
}

/// A chunk of 8^3 samples of a level, and the wavelets that belong to it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Node {
    /// 0 is the finest.
    pub level: usize,
    /// Its chunk.
    pub chunk: [usize; 3],
    /// The box of its polynomial pieces in index space of the finest lattice, cut by the domain.
    pub lo: DVec3,
    /// Upper corner.
    pub hi: DVec3,
    /// Greatest magnitude of the details of the chunk and of all finer chunks inside it.
    pub magnitude: f64,
    /// Bounds of the function wherever a detail of the chunk or of a finer one inside it acts, which is somewhat beyond the box: whatever details of the level and of finer ones are used, as long as those of coarser
    /// levels that act there are. Rounding of the reconstruction apart.
    pub range: (f64, f64),
}

/// What is known of one level but the coarsest.
#[derive(Debug, Clone)]
pub(super) struct Level<T> {
    /// Slots: details where a coordinate is odd. The slots of the low pass (all coordinates even) are those of the next level, and 0 here.
    pub(super) details: Blocks<T>,
    /// [`Node::magnitude`] by chunk.
    magnitudes: Vec<f64>,
    /// [`Node::range`] by chunk.
    ranges: Vec<(f64, f64)>,
}

/// A volume as coefficients of spline wavelets: a coarsest level of at most 8 samples per axis, and the details of every finer one.
///
/// The samples are the spline coefficients (maths, section B: the thesis has no prefilter). Each step halves all axes, odd lengths rounded up, and
/// leaves seven times as many details as low-pass coefficients (non-standard scheme, section 4.1). Lines go on beyond their ends as in [`super::Mirror`].
#[derive(Debug, Clone)]
pub struct Pyramid<T = f32> {
    pub(super) bank: Bank,
    pub(super) levels: Vec<Level<T>>,
    pub(super) coarsest: Blocks<T>,
    pub(super) placement: Placement,
    dims: [usize; 3],
}

impl Pyramid<f32> {
    /// Decomposes a grid of any sample type; arithmetic in f32.
    ///
    /// # Errors
    /// [`DataError::NotFinite`] where samples are not finite, [`DataError::Unknown`] where details, or what a reconstruction with any of them may come to, are beyond f32.
    pub fn new(grid: &Grid, bank: Bank) -> Result<Self, DataError> {
        grid.require_finite()?;
        let samples: Vec<f32> = (0..grid.samples.len()).map(|i| grid.samples.get(i) as f32).collect();
        let placement = Placement {
            spacing: grid.spacing,
            origin: grid.origin,
            direction: grid.direction,
        };
        let pyramid = Self::of(grid.dims, &samples, bank, placement);
        // Written so that NaN, which sums of infinities are, is refused too.
        if pyramid.reach() < f64::from(f32::MAX) {
            Ok(pyramid)
        } else {
            Err(DataError::Unknown(format!(
                "details of {bank}, or sums of some of them, are beyond f32: samples come too near to 3.4e38; scale them down"
            )))
        }
    }

    /// A bound of all that reconstructions compute, whatever is selected: the coarsest level, which subdivision does not enlarge, and the details of every level times the most that
    /// three passes make of them (the low-pass taps of a sample sum to 1).
    fn reach(&self) -> f64 {
        let most = |b: &Blocks<f32>| {
            let finite = |m: f64, v: &f32| {
                if v.is_finite() {
                    m.max(f64::from(v.abs()))
                } else {
                    f64::INFINITY
                }
            };
            b.data
                .par_chunks(VOLUME)
                .map(|c| c.iter().fold(0.0, finite))
                .reduce(|| 0.0, f64::max)
        };
        let high = |(parity, taps): (usize, &Vec<(isize, f64)>)| {
            let odd = taps.iter().filter(|(o, _)| (parity as isize + o).rem_euclid(2) == 1);
            odd.map(|(_, w)| w.abs()).sum::<f64>()
        };
        let high = Synthesis::<f64>::new(self.bank)
            .taps
            .iter()
            .enumerate()
            .map(high)
            .fold(0.0, f64::max);
        let gain = (1.0 + high).powi(3) - 1.0;
        let details: f64 = self.levels.iter().map(|l| gain * most(&l.details)).sum();
        (most(&self.coarsest) + details) * (1.0 + 1e-4)
    }

    /// A grid at this pyramid's place with other samples.
    pub(super) fn grid(&self, samples: Vec<f32>) -> Result<Grid, DataError> {
        let p = self.placement;
        Grid::new(self.dims, p.spacing, p.origin, p.direction, Samples::F32(samples.into()))
    }
}

impl<T: Number> Pyramid<T> {
    /// Decomposes values stored x fastest.
    ///
    /// # Panics
    /// When the number of values is not that of `dims`, or an axis is empty.
    #[must_use]
    pub fn of(dims: [usize; 3], values: &[T], bank: Bank, placement: Placement) -> Self {
        assert_eq!(values.len(), dims.iter().product::<usize>(), "one value per lattice point");
        assert!(dims.iter().all(|&n| n > 0), "no axis is empty");
        let (mut current, mut size) = (values.to_vec(), dims);
        let mut levels = Vec::new();
        // Coefficients of each level but the finest, for the ranges.
        let mut functions = Vec::new();
        while size.iter().any(|&n| n > CHUNK) {
            let slots = analyse(bank, &current, size);
            let (coarse, coarse_size) = low(&slots, size);
            let mut details = Blocks::from_rows(size, &slots);
            clear_low(&mut details);
            levels.push(Level {
                details,
                magnitudes: Vec::new(),
                ranges: Vec::new(),
            });
            (current, size) = (coarse, coarse_size);
            functions.push(Blocks::from_rows(size, &current));
        }
        let coarsest = Blocks::from_rows(size, &current);
        let mut pyramid = Self {
            bank,
            levels,
            coarsest,
            placement,
            dims,
        };
        pyramid.measure(&functions);
        pyramid
    }

    /// Fills in magnitudes and ranges, finest level first; `functions` are the coefficients of the next coarser level of each.
    fn measure(&mut self, functions: &[Blocks<T>]) {
        let mut ranges = Ranges::default();
        for (l, coarse) in functions.iter().enumerate() {
            let level = &self.levels[l];
            let set = ChunkSet::new(level.details.chunks, false);
            let finer = l.checked_sub(1).map(|f| &self.levels[f]);
            let magnitude = |i: usize| {
                let block = &level.details.data[i * VOLUME..][..VOLUME];
                let own = block.iter().fold(0.0f64, |m, v| m.max(v.to_f64().abs()));
                finer.map_or(own, |finer| {
                    children(set.chunk(i), finer.details.chunks)
                        .map(|child| finer.magnitudes[index_of(finer.details.chunks, child)])
                        .fold(own, f64::max)
                })
            };
            let magnitudes = (0..set.members().len()).into_par_iter().map(magnitude).collect();
            let ranges = ranges.level(self.bank, &level.details, coarse);
            (self.levels[l].magnitudes, self.levels[l].ranges) = (magnitudes, ranges);
        }
    }

    /// The bank.
    #[must_use]
    pub const fn bank(&self) -> Bank {
        self.bank
    }

    /// Samples per axis.
    #[must_use]
    pub const fn dims(&self) -> [usize; 3] {
        self.dims
    }

    /// Number of levels with details; level `levels()` is the coarsest, which is always whole.
    #[must_use]
    pub const fn levels(&self) -> usize {
        self.levels.len()
    }

    /// Samples per axis of a level.
    #[must_use]
    pub fn level_dims(&self, level: usize) -> [usize; 3] {
        self.levels.get(level).map_or(self.coarsest.dims, |l| l.details.dims)
    }

    /// Chunks per axis of a level.
    #[must_use]
    pub fn level_chunks(&self, level: usize) -> [usize; 3] {
        chunks_of(self.level_dims(level))
    }

    /// Chunks of all levels, the coarsest included: 4681 for 128^3 (Table 6.4).
    #[must_use]
    pub fn chunks(&self) -> usize {
        (0..=self.levels())
            .map(|l| self.level_chunks(l).iter().product::<usize>())
            .sum()
    }

    /// The domain of the lattice, as [`Grid::domain`] has it.
    #[must_use]
    pub fn domain(&self) -> Domain {
        let p = self.placement;
        Domain {
            origin: p.origin,
            axes: DMat3::from_cols(
                p.direction.x_axis * p.spacing.x,
                p.direction.y_axis * p.spacing.y,
                p.direction.z_axis * p.spacing.z,
            ),
            lo: DVec3::ZERO,
            hi: DVec3::from_array(self.dims.map(|n| (n - 1) as f64)),
        }
    }

    /// A chunk of a level with details.
    ///
    /// # Panics
    /// When there is no such level or chunk.
    #[must_use]
    pub fn node(&self, level: usize, chunk: [usize; 3]) -> Node {
        let l = &self.levels[level];
        let i = index_of(l.details.chunks, chunk);
        let size = (CHUNK << level) as f64;
        // Coarse pieces of the quadratic spline are centred on coefficients that sit between the fine ones (maths, section B).
        let shift = if self.bank.degree() == 2 { 0.5 } else { 0.0 };
        let (first, last) = (DVec3::ZERO, self.domain().hi);
        let corner = |c: [usize; 3]| DVec3::from_array(c.map(|v| v as f64 * size - shift)).clamp(first, last);
        Node {
            level,
            chunk,
            lo: corner(chunk),
            hi: corner(chunk.map(|c| c + 1)),
            magnitude: l.magnitudes[i],
            range: l.ranges[i],
        }
    }

    /// Number of coefficients: that of the samples.
    #[must_use]
    pub fn coefficients(&self) -> usize {
        self.dims.iter().product()
    }

    /// The pyramid with only the `count` coefficients of greatest magnitude (S15, Figure 4.5: compression), ties all kept, and the number kept. The
    /// coarsest level is always kept. With `weighted` a magnitude counts 2^(3 level / 2) times, its wavelet's norm, as least squares would have it were
    /// the wavelets orthogonal; the thesis does not weight. [`Node::range`] stays that of all coefficients.
    #[must_use]
    pub fn keep_largest(&self, count: usize, weighted: bool) -> (Self, usize) {
        let weight = |level: usize| if weighted { 2f64.powf(1.5 * level as f64) } else { 1.0 };
        let mut all: Vec<f64> = Vec::with_capacity(self.coefficients());
        for (l, level) in self.levels.iter().enumerate() {
            let w = weight(l);
            all.extend(level.details.data.iter().map(|v| v.to_f64().abs() * w).filter(|&v| v > 0.0));
        }
        let base: usize = self.coarsest.dims.iter().product();
        let wanted = count.saturating_sub(base);
        let threshold = if wanted == 0 {
            f64::INFINITY
        } else if wanted >= all.len() {
            0.0
        } else {
            *all.select_nth_unstable_by(wanted - 1, |a, b| b.total_cmp(a)).1
        };
        let mut out = self.clone();
        let mut kept = base;
        for (l, level) in out.levels.iter_mut().enumerate() {
            let w = weight(l);
            for v in &mut level.details.data {
                if v.to_f64().abs() * w < threshold {
                    *v = T::default();
                } else if *v != T::default() {
                    kept += 1;
                }
            }
        }
        (out, kept)
    }
}

/// Sets the slots of the low pass to 0.
fn clear_low<T: Number>(details: &mut Blocks<T>) {
    for block in details.data.chunks_mut(VOLUME) {
        for z in (0..CHUNK).step_by(2) {
            for y in (0..CHUNK).step_by(2) {
                for x in (0..CHUNK).step_by(2) {
                    block[(z * CHUNK + y) * CHUNK + x] = T::default();
                }
            }
        }
    }
}

/// The finer chunks inside a chunk.
fn children(chunk: [usize; 3], finer: [usize; 3]) -> impl Iterator<Item = [usize; 3]> {
    (0..8).filter_map(move |i: usize| {
        let child = [2 * chunk[0] + i % 2, 2 * chunk[1] + i / 2 % 2, 2 * chunk[2] + i / 4];
        (0..3).all(|a| child[a] < finer[a]).then_some(child)
    })
}
