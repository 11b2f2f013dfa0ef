//! The adaptive reconstruction: which chunks of which levels are computed, kept and drawn (S15 to S17).

use super::banks::Synthesis;
use super::blocks::{Blocks, CHUNK, ChunkSet};
use super::passes::{Source, reconstruct};
use super::pyramid::Pyramid;
use super::{Number, Selection};
use isobar_core::{DataError, Grid};
use isobar_cpu::Level;
use std::sync::Arc;

/// How much of each level is wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Extent {
    /// What a multiresolution renderer reads: the drawn chunks, a chunk around them for the stencils of their last pieces (together the two chunks of
    /// neighbourhood of Algorithm 1), and what these are made from.
    Drawn,
    /// Every chunk of every level, so that the finest lattice describes the whole function.
    Whole,
}

/// What an update did, in chunks of levels with details.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Update {
    /// Wanted and computed.
    pub computed: usize,
    /// Wanted and taken over from before.
    pub reused: usize,
}

/// What an update has to compute, by level.
pub(super) struct Plan {
    pub(super) todo: Vec<ChunkSet>,
    /// What is there afterwards.
    pub(super) valid: Vec<ChunkSet>,
    pub(super) update: Update,
}

impl Plan {
    /// From the selection `before` to the one `now`, with the chunks that are `valid` by level.
    ///
    /// # Panics
    /// When the selection was made for a pyramid of other dimensions.
    pub(super) fn new<T: Number>(
        pyramid: &Pyramid<T>,
        [before, now]: [&Selection; 2],
        valid: Vec<&ChunkSet>,
        extent: Extent,
    ) -> Self {
        let levels = pyramid.levels();
        assert!(
            now.active.len() == levels && (0..levels).all(|l| now.active[l].chunks() == pyramid.level_chunks(l)),
            "the selection is of this pyramid"
        );
        let wanted = wanted(pyramid, now, extent);
        let mut plan = Self {
            todo: wanted.clone(),
            valid: wanted.clone(),
            update: Update::default(),
        };
        // Chunks of the next coarser level whose values are not those of before.
        let mut touched: Option<ChunkSet> = None;
        for l in (0..levels).rev() {
            let mut dirty = before.active[l].zip(&now.active[l], |a, b| a != b).dilated([1; 3]);
            if let Some(touched) = touched {
                dirty = dirty.zip(&fed_by(&touched, dirty.chunks()), |a, b| a || b);
            }
            let kept = valid[l].zip(&dirty, |valid, dirty| valid && !dirty);
            let todo = wanted[l].zip(&kept, |wanted, kept| wanted && !kept);
            plan.update.computed += todo.count();
            plan.update.reused += wanted[l].count() - todo.count();
            touched = Some(kept.zip(&kept, |a, _| !a));
            plan.valid[l] = kept.zip(&todo, |a, b| a || b);
            plan.todo[l] = todo;
        }
        plan
    }
}

/// The chunks that must be there, by level: closed under what they are made from.
fn wanted<T: Number>(pyramid: &Pyramid<T>, selection: &Selection, extent: Extent) -> Vec<ChunkSet> {
    let mut wanted: Vec<ChunkSet> = Vec::with_capacity(pyramid.levels());
    for (l, covered) in selection.covered().iter().enumerate() {
        let chunks = pyramid.level_chunks(l);
        let own = match extent {
            Extent::Whole => ChunkSet::new(chunks, true),
            Extent::Drawn => covered.dilated([1; 3]),
        };
        let set = match wanted.last() {
            Some(finer) if extent == Extent::Drawn => own.zip(&feeding(finer, chunks), |a, b| a || b),
            _ => own,
        };
        wanted.push(set);
    }
    wanted
}

/// One level's values and which chunks of them are those of the present selection.
#[derive(Debug)]
struct State<T> {
    values: Blocks<T>,
    valid: ChunkSet,
}

/// A spline with details in the active chunks only, kept from one selection to the next.
///
/// The function is one spline over the finest lattice: the sum of the coarsest level and of the wavelets of the active chunks. So it is C^(d-1)
/// everywhere, between chunks of different levels too, with no stitching (S17), and where no active wavelet reaches it is the coarser spline exactly.
#[derive(Debug)]
pub struct Adaptive<T: Number = f32> {
    pyramid: Arc<Pyramid<T>>,
    taps: Synthesis<T>,
    states: Vec<State<T>>,
    selection: Selection,
    /// By level, whether the last update computed any of its values.
    changed: Vec<bool>,
    simd: Level,
}

impl<T: Number> Adaptive<T> {
    /// Nothing active; nothing computed.
    #[must_use]
    pub fn new(pyramid: Arc<Pyramid<T>>) -> Self {
        let states = (0..pyramid.levels())
            .map(|l| State {
                values: Blocks::new(pyramid.level_dims(l)),
                valid: ChunkSet::new(pyramid.level_chunks(l), false),
            })
            .collect();
        Self {
            taps: Synthesis::new(pyramid.bank),
            selection: Selection::whole(&pyramid, false),
            changed: vec![false; pyramid.levels()],
            states,
            pyramid,
            simd: Level::detect(),
        }
    }

    /// The pyramid.
    #[must_use]
    pub fn pyramid(&self) -> &Arc<Pyramid<T>> {
        &self.pyramid
    }

    /// The selection of the last update.
    #[must_use]
    pub const fn selection(&self) -> &Selection {
        &self.selection
    }

    /// Bytes of the levels' values.
    #[must_use]
    pub fn bytes(&self) -> usize {
        self.states.iter().map(|s| s.values.data.len() * size_of::<T>()).sum()
    }

    /// Makes a selection the present one. Only chunks that are wanted and that the change reaches, or that were not computed before, are computed; parallel by
    /// slabs of chunks on the current rayon pool (`isobar_cpu::Pool::install`). The values do not depend on the number of threads nor on what was reused.
    ///
    /// # Panics
    /// When the selection was made for a pyramid of other dimensions.
    pub fn update(&mut self, selection: &Selection, extent: Extent) -> Update {
        let valid = self.states.iter().map(|s| &s.valid).collect();
        let plan = Plan::new(&self.pyramid, [&self.selection, selection], valid, extent);
        for l in (0..self.pyramid.levels()).rev() {
            let (finer, coarser) = self.states.split_at_mut(l + 1);
            let source = Source {
                details: &self.pyramid.levels[l].details,
                active: &selection.active[l],
                coarse: coarser.first().map_or(&self.pyramid.coarsest, |s| &s.values),
                taps: &self.taps,
                mirror: self.pyramid.bank.mirror(),
            };
            reconstruct(&source, &plan.todo[l], &mut finer[l].values, self.simd);
            self.changed[l] = plan.todo[l].count() > 0;
        }
        for (state, valid) in self.states.iter_mut().zip(plan.valid) {
            state.valid = valid;
        }
        self.selection = selection.clone();
        plan.update
    }

    /// Forgets what was computed, so that the next update makes all it needs.
    pub fn forget(&mut self) {
        for state in &mut self.states {
            state.valid = ChunkSet::new(state.valid.chunks(), false);
        }
    }

    /// Makes the whole of the finest level, and gives its spline coefficients, x fastest. With all chunks active these are the samples but for
    /// rounding; where no active wavelet reaches they are those of the coarser spline, subdivided.
    pub fn coefficients(&mut self) -> Vec<T> {
        let selection = self.selection.clone();
        self.update(&selection, Extent::Whole);
        self.states.first().map_or(&self.pyramid.coarsest, |s| &s.values).to_rows()
    }

    /// The coefficient of a level at (x, y, z), if the chunk it lies in has been computed for the present selection; level `levels()` is the coarsest.
    ///
    /// # Panics
    /// When the level or the index is out of range.
    #[must_use]
    pub fn coefficient(&self, level: usize, xyz: [usize; 3]) -> Option<T> {
        let Some(state) = self.states.get(level) else {
            assert_eq!(level, self.states.len(), "levels() is the coarsest level");
            return Some(self.pyramid.coarsest.data[self.pyramid.coarsest.at(xyz)]);
        };
        state
            .valid
            .contains(xyz.map(|v| v / CHUNK))
            .then(|| state.values.data[state.values.at(xyz)])
    }

    /// Whether the last update computed any value of a level; the coarsest one never changes.
    pub(super) fn changed(&self, level: usize) -> bool {
        self.changed.get(level).copied().unwrap_or(false)
    }

    /// The values of a level, stored by chunks; level `levels()` is the coarsest. Those of chunks that were not wanted are old or zero.
    pub(super) fn values(&self, level: usize) -> &Blocks<T> {
        self.states.get(level).map_or(&self.pyramid.coarsest, |s| &s.values)
    }

    /// The level of detail for pictures: per chunk of the finest level (x fastest, beside their number per axis) the finest level whose details act in it.
    #[must_use]
    pub fn level_map(&self) -> (Vec<u8>, [usize; 3]) {
        let levels = self.pyramid.levels();
        let drawn: Vec<ChunkSet> = (0..levels).map(|l| self.selection.drawn(l)).collect();
        let chunks = self.pyramid.level_chunks(0);
        let set = ChunkSet::new(chunks, false);
        let map = (0..set.members().len())
            .map(|i| {
                let chunk = set.chunk(i);
                let level = (0..levels).find(|&l| drawn[l].contains(chunk.map(|c| c >> l)));
                level.unwrap_or(levels) as u8
            })
            .collect();
        (map, chunks)
    }
}

impl Adaptive<f32> {
    /// The function as a grid of spline coefficients at full resolution: what the casters of reconstruction `trilinear`, `quadratic` or `cubic` (the
    /// bank's degree) and the oracle take as samples.
    ///
    /// # Errors
    /// [`DataError`] where the pyramid's placement is not one a grid may have.
    pub fn grid(&mut self) -> Result<Grid, DataError> {
        let values = self.coefficients();
        self.pyramid.grid(values)
    }
}

/// The coarser chunks that hold the low pass of finer ones: a fine chunk i along an axis reads coarse samples 4i-1 to 4i+4.
fn feeding(finer: &ChunkSet, coarse: [usize; 3]) -> ChunkSet {
    let mut set = ChunkSet::new(coarse, false);
    for chunk in finer.iter() {
        let span = |a: usize| {
            let i = chunk[a];
            let first = (4 * i).saturating_sub(1) / CHUNK;
            first..=((4 * i + 4) / CHUNK).min(coarse[a] - 1)
        };
        for z in span(2) {
            for y in span(1) {
                for x in span(0) {
                    set.set([x, y, z], true);
                }
            }
        }
    }
    set
}

/// The finer chunks that read one of these coarser chunks.
fn fed_by(coarse: &ChunkSet, finer: [usize; 3]) -> ChunkSet {
    let mut set = ChunkSet::new(finer, false);
    for chunk in coarse.iter() {
        // Chunk I holds samples 8I to 8I+7; 4i-1 <= 8I+7 and 4i+4 >= 8I leave i from 2I-1 to 2I+2.
        let span = |a: usize| (2 * chunk[a]).saturating_sub(1)..=(2 * chunk[a] + 2).min(finer[a] - 1);
        for z in span(2) {
            for y in span(1) {
                for x in span(0) {
                    set.set([x, y, z], true);
                }
            }
        }
    }
    set
}
