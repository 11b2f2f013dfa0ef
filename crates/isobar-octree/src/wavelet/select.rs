//! Which chunks' details are used (S15): by view, magnitude and isovalue.

use super::Number;
use super::blocks::{CHUNK, ChunkSet};
use super::pyramid::{Node, Pyramid};
use glam::DVec3;
use isobar_core::{Camera, View};

/// When a chunk is activated: all that is given must hold, and its parent must be active (Algorithm 1: c0, c1, c2).
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Criteria {
    /// The eye in world coordinates and epsilon: collapsed where `s / c < epsilon`, s the diameter of the node, c its distance from the eye
    /// (section 4.2). The distance is that of the nearest point of the node's box; in a sheared grid, of a point of it that may be farther.
    pub view: Option<(DVec3, f64)>,
    /// Collapsed where all details of the node and of the finer nodes inside it are below this.
    pub magnitude: Option<f64>,
    /// Collapsed where no isovalue lies in [`Node::range`]: where a detail of the node or of a finer one inside it acts, neither the function nor what is left of it without any of these details has a
    /// surface. So isovalues alone change no surface, rounding apart.
    pub isovalues: Option<Vec<f64>>,
}

impl Criteria {
    /// By view, so that no piece of a coarser level is seen wider than some `pixels`: s / c is below 4 sqrt(3) times the angle of so many pixels, because a
    /// collapsed node of diameter s is drawn with cubes of diameter s / 4. Pieces that are no cubes are as wide as those of that diameter at most sqrt(3) times. `None`
    /// for cameras without an eye.
    #[must_use]
    pub fn pixels(view: &View, pixels: f64) -> Option<Self> {
        let Camera::Perspective { eye, .. } = view.camera else {
            return None;
        };
        Some(Self {
            view: Some((eye, 4.0 * 3f64.sqrt() * pixels * view.footprint(1.0))),
            ..Self::default()
        })
    }

    /// Whether a node passes, its parent apart.
    #[must_use]
    pub fn passes<T: Number>(&self, pyramid: &Pyramid<T>, node: &Node) -> bool {
        let near = |&(eye, epsilon): &(DVec3, f64)| {
            let domain = pyramid.domain();
            let corners = (0..4).map(|i| {
                let d = node.hi - node.lo;
                let flip = DVec3::new(1.0, if i & 1 == 0 { 1.0 } else { -1.0 }, if i & 2 == 0 { 1.0 } else { -1.0 });
                (domain.axes * (d * flip)).length()
            });
            let diameter = corners.fold(0.0, f64::max);
            let distance = eye.distance(domain.world(domain.local(eye).clamp(node.lo, node.hi)));
            // Written so that an eye inside the node, with distance 0, passes.
            diameter >= epsilon * distance
        };
        // What costs least first.
        self.magnitude.is_none_or(|m| node.magnitude >= m)
            && self
                .isovalues
                .as_ref()
                .is_none_or(|v| v.iter().any(|&c| node.range.0 <= c && c <= node.range.1))
            && self.view.as_ref().is_none_or(near)
    }
}

/// The active chunks of every level with details.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Selection {
    pub(super) active: Vec<ChunkSet>,
}

impl Selection {
    /// No details at all, or all of them.
    #[must_use]
    pub fn whole<T: Number>(pyramid: &Pyramid<T>, all: bool) -> Self {
        let active = (0..pyramid.levels())
            .map(|l| ChunkSet::new(pyramid.level_chunks(l), all))
            .collect();
        Self { active }
    }

    /// The chunks that pass, from the coarsest level down: a chunk whose parent is not active is not asked about.
    #[must_use]
    pub fn by<T: Number>(pyramid: &Pyramid<T>, pass: impl Fn(&Node) -> bool) -> Self {
        let mut selection = Self::whole(pyramid, false);
        for l in (0..pyramid.levels()).rev() {
            let mut set = selection.active[l].clone();
            for i in 0..set.members().len() {
                let chunk = set.chunk(i);
                let parent = selection.active.get(l + 1).is_none_or(|p| p.contains(chunk.map(|c| c / 2)));
                if parent && pass(&pyramid.node(l, chunk)) {
                    set.set(chunk, true);
                }
            }
            selection.active[l] = set;
        }
        selection
    }

    /// The chunks that pass the criteria.
    #[must_use]
    pub fn new<T: Number>(pyramid: &Pyramid<T>, criteria: &Criteria) -> Self {
        Self::by(pyramid, |node| criteria.passes(pyramid, node))
    }

    /// The active chunks of a level.
    ///
    /// # Panics
    /// When the level has no details.
    #[must_use]
    pub fn level(&self, level: usize) -> &ChunkSet {
        &self.active[level]
    }

    /// To switch chunks by hand; parents are not asked for.
    ///
    /// # Panics
    /// When the level has no details.
    pub fn level_mut(&mut self, level: usize) -> &mut ChunkSet {
        &mut self.active[level]
    }

    /// Number of active chunks, the coarsest level's not counted.
    #[must_use]
    pub fn count(&self) -> usize {
        self.active.iter().map(ChunkSet::count).sum()
    }

    /// By level, the chunks in which the function is drawn with pieces of this level or of a finer one: [`Selection::drawn`], and what lies above such chunks
    /// of finer levels where parents were switched off by hand.
    #[must_use]
    pub fn covered(&self) -> Vec<ChunkSet> {
        let mut covered: Vec<ChunkSet> = Vec::with_capacity(self.active.len());
        for l in 0..self.active.len() {
            let mut set = self.drawn(l);
            if let Some(finer) = covered.last() {
                for chunk in finer.iter() {
                    set.set(chunk.map(|c| c / 2), true);
                }
            }
            covered.push(set);
        }
        covered
    }

    /// By level, the coarsest included, the bricks of 4^3 pieces that are drawn with pieces of that level: every point of the domain lies in one brick of one level. A
    /// brick of a level is a chunk of the next finer one.
    #[must_use]
    pub fn bricks<T: Number>(&self, pyramid: &Pyramid<T>) -> Vec<ChunkSet> {
        let covered = self.covered();
        (0..=self.active.len())
            .map(|l| {
                let bricks = pyramid.level_dims(l).map(|n| n.div_ceil(CHUNK / 2));
                // All of the coarsest level, else those of the chunks that are covered; but for what is finer.
                let Some(here) = covered.get(l) else {
                    return covered
                        .last()
                        .map_or(ChunkSet::new(bricks, true), |finer| finer.zip(finer, |f, _| !f));
                };
                let mut set = ChunkSet::new(bricks, false);
                for chunk in here.iter() {
                    for i in 0..8 {
                        let brick = [0, 1, 2].map(|a| 2 * chunk[a] + (i >> a & 1));
                        let inside = (0..3).all(|a| brick[a] < bricks[a]);
                        if inside && !(l > 0 && covered[l - 1].contains(brick)) {
                            set.set(brick, true);
                        }
                    }
                }
                set
            })
            .collect()
    }

    /// As [`Selection::bricks`], and beside them a layer of bricks where coarser ones are: there no detail of the level acts, so both are one function but for rounding, and what
    /// that hides from one level next to its border is found by the other.
    pub(super) fn overlapping<T: Number>(&self, pyramid: &Pyramid<T>) -> Vec<ChunkSet> {
        let covered = self.covered();
        let mut bricks = self.bricks(pyramid);
        for (own, covered) in bricks.iter_mut().zip(&covered) {
            let mut wider = own.dilated([1; 3]);
            for brick in wider.clone().iter() {
                let here = covered.contains(brick.map(|b| b / 2));
                wider.set(brick, own.contains(brick) || !here);
            }
            *own = wider;
        }
        bricks
    }

    /// The chunks that are drawn at a level or finer: the active ones and their neighbours, into which the active ones' wavelets reach
    /// (Figure 4.8). In all other chunks of the level the function is that of the next coarser level, exactly.
    ///
    /// # Panics
    /// When the level has no details.
    #[must_use]
    pub fn drawn(&self, level: usize) -> ChunkSet {
        self.active[level].dilated([1; 3])
    }
}
