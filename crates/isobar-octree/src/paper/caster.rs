//! One ray of `octree/cpu-paper` (thesis, section 3.3.3): tree, bricks, cells, roots.

use super::cell::{Along, along, gradient, scale};
use super::path::{Line, Visit, cells, traverse};
use super::tree::{Coefficients, Tree};
use crate::compose::Form;
use crate::finders::Finder;
use glam::DVec3;
use isobar_core::{Domain, Ray};
use isobar_cpu::scene::Isovalues;

/// Work done along rays.
#[derive(Debug, Default, Clone, Copy)]
pub(super) struct Work {
    /// Nodes of which the range was asked, bricks among them.
    pub(super) nodes: u64,
    /// Bricks looked into.
    pub(super) bricks: u64,
    /// Cells composed.
    pub(super) cells: u64,
    /// Roots found.
    pub(super) roots: u64,
}

/// A root along the ray.
#[derive(Debug, Clone, Copy)]
pub(super) struct Root {
    pub(super) t: f64,
    /// Place of its isovalue.
    pub(super) value: usize,
    /// In index space.
    pub(super) gradient: [f32; 3],
}

/// All that rays share.
#[derive(Debug, Clone, Copy)]
pub(super) struct Caster<'a> {
    pub(super) tree: &'a Tree,
    pub(super) coefficients: Coefficients<'a>,
    pub(super) cells: [u32; 3],
    pub(super) domain: Domain,
    /// 0.5 where cells are centred on samples: what is added to indices of samples.
    pub(super) shift: f64,
    pub(super) surfaces: &'a Isovalues,
    pub(super) form: Form,
    pub(super) finder: Finder,
}

/// A ray with unit speed along its fastest axis of index space, from where it enters the volume.
#[derive(Debug, Clone, Copy)]
struct Local {
    line: Line,
    span: [f32; 2],
    /// t is `start + s * rate`.
    start: f64,
    rate: f64,
}

impl Caster<'_> {
    /// Steps 1 and 2. The thesis begins rays at the near plane, here they begin at the volume, or at a cut: both ends come from f64, so that f32 has to tell positions in the volume only,
    /// however far the eye is. `None` where the ray misses.
    fn enter(&self, ray: &Ray, kept: (f64, f64)) -> Option<Local> {
        let (t0, t1) = self.domain.clip(ray)?;
        let (t0, t1) = (t0.max(kept.0), t1.min(kept.1));
        let d = self.domain.local_vector(ray.direction);
        let speed = d.abs().max_element();
        let length = (t1 - t0) * speed;
        if t0 > t1 || !length.is_finite() || !t0.is_finite() || speed == 0.0 {
            return None;
        }
        let o = (self.domain.local(ray.at(t0))).clamp(self.domain.lo, self.domain.hi) + self.shift;
        Some(Local {
            line: Line::new(o.as_vec3().to_array(), (d / speed).as_vec3().to_array(), self.cells),
            span: [0.0, length as f32],
            start: t0,
            rate: speed.recip(),
        })
    }

    /// Calls `push` with the roots in order until it returns false. At most one for each cell and isovalue, the first.
    pub(super) fn roots<const D: usize, const M: usize>(
        &self,
        ray: &Ray,
        kept: (f64, f64),
        work: &mut Work,
        push: impl FnMut(&Root) -> bool,
    ) {
        if let Some(local) = self.enter(ray, kept) {
            let mut search = Search::<D, M, _> {
                caster: self,
                local,
                samples: [0.0; 64],
                work,
                push,
            };
            traverse(&local.line, local.span, self.tree.depth, self.tree.side, &mut search);
        }
    }
}

struct Search<'a, const D: usize, const M: usize, F> {
    caster: &'a Caster<'a>,
    local: Local,
    samples: [f32; 64],
    work: &'a mut Work,
    push: F,
}

impl<const D: usize, const M: usize, F: FnMut(&Root) -> bool> Visit for Search<'_, D, M, F> {
    #[inline(always)]
    fn enters(&mut self, level: u32, index: [u32; 3]) -> bool {
        self.work.nodes += 1;
        let [lo, hi] = self.caster.tree.range(level, index).map(f64::from);
        self.caster.surfaces.values().iter().any(|&c| lo <= c && c <= hi)
    }

    #[inline(always)]
    fn brick(&mut self, index: [u32; 3], stretch: [f32; 2]) -> bool {
        self.work.bricks += 1;
        let line = self.local.line;
        cells(&line, index, self.caster.tree.side, stretch, |cell, part| {
            self.cell(cell, part)
        })
    }
}

impl<const D: usize, const M: usize, F: FnMut(&Root) -> bool> Search<'_, D, M, F> {
    /// Returns whether to go on.
    fn cell(&mut self, cell: [u32; 3], [a, b]: [f32; 2]) -> bool {
        self.work.cells += 1;
        let Caster { form, finder, .. } = *self.caster;
        let line = self.local.line;
        self.caster.coefficients.stencil::<D>(cell, &mut self.samples);
        let inside = |t: f32| [0, 1, 2].map(|i| line.at(i, t) - cell[i] as f32);
        let along: Along<M> = along::<D, M>(form, &self.samples, inside(a), inside(b));
        let values = self.caster.surfaces.values();
        if let [c] = values {
            return match along.first_root(finder, scale::<D>() * *c as f32) {
                Some(at) => self.found(cell, a + (b - a) * at, 0),
                None => true,
            };
        }
        // In order; none more than once.
        let mut last = (f32::NEG_INFINITY, 0);
        loop {
            let roots = values.iter().enumerate().filter_map(|(i, &c)| {
                let at = along.first_root(finder, scale::<D>() * c as f32)?;
                (at > last.0 || at == last.0 && i + 1 > last.1).then_some((at, i))
            });
            match roots.min_by(|x, y| x.0.total_cmp(&y.0)) {
                Some((at, i)) => {
                    last = (at, i + 1);
                    if !self.found(cell, a + (b - a) * at, i) {
                        return false;
                    }
                }
                None => return true,
            }
        }
    }

    /// Step 5f.
    fn found(&mut self, cell: [u32; 3], s: f32, value: usize) -> bool {
        self.work.roots += 1;
        let Local { line, start, rate, .. } = self.local;
        (self.push)(&Root {
            t: start + f64::from(s) * rate,
            value,
            gradient: gradient::<D>(&self.samples, [0, 1, 2].map(|i| line.at(i, s) - cell[i] as f32)),
        })
    }
}

/// Normal in the world of a gradient in index space: for the hit.
pub(super) fn normal(domain: &Domain, gradient: [f32; 3]) -> [f32; 3] {
    let g = domain.world_gradient(DVec3::from_array(gradient.map(f64::from)));
    g.normalize_or(DVec3::ZERO).as_vec3().to_array()
}
