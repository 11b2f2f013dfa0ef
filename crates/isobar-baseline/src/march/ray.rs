//! One ray: samples at a fixed step, sign changes between consecutive ones, bisection.

use super::blocks::{Blocks, Level, UP};
use super::volume::{Sample, Volume};
use crate::index_space::IndexRay;

/// A walk along a ray from box to box of one level.
#[derive(Debug, Clone, Copy)]
struct Walk {
    /// The faces through which the present box is left, one per axis.
    face: [f64; 3],
    /// From such a face to the next one: the side, with the sign of the direction.
    along: [f64; 3],
    strides: [isize; 3],
    /// Number of the present box.
    index: isize,
}

impl Walk {
    #[inline(always)]
    fn new<T: Sample>(ray: &IndexRay, level: &Level<T>, b: [usize; 3]) -> Self {
        let (side, strides) = (level.side(), level.strides());
        let forth: [bool; 3] = std::array::from_fn(|a| ray.d[a] > 0.0);
        Self {
            face: std::array::from_fn(|a| (b[a] as f64 + if forth[a] { 1.0 } else { 0.0 }) * side),
            along: std::array::from_fn(|a| if forth[a] { side } else { -side }),
            strides: std::array::from_fn(|a| if forth[a] { strides[a] } else { -strides[a] }),
            index: level.at(b) as isize,
        }
    }

    /// Where the ray leaves the present box.
    #[inline(always)]
    fn exit(&self, ray: &IndexRay) -> ([f64; 3], f64) {
        let t = ray.reach(self.face);
        let m = if t[0] < t[1] { t[0] } else { t[1] };
        (t, if t[2] < m { t[2] } else { m })
    }

    /// Goes on through the face reached at `exit`; through an edge or a corner where several are. Masks instead of branches: which
    /// face comes next is not predictable.
    #[inline(always)]
    fn step(&mut self, t: [f64; 3], exit: f64) {
        for (a, t) in t.into_iter().enumerate() {
            let through = -isize::from(t == exit);
            self.face[a] += f64::from_bits(self.along[a].to_bits() & through as u64);
            self.index += self.strides[a] & through;
        }
    }
}

/// What the rays of a frame share.
#[derive(Debug, Clone, Copy)]
pub(crate) struct March<'a, T, const W: usize> {
    pub(crate) volume: Volume<'a, T, W>,
    pub(crate) blocks: Option<&'a Blocks<T>>,
    /// Ascending, distinct.
    pub(crate) isovalues: &'a [f64],
    /// The first of them.
    pub(crate) lowest: f64,
    /// Rounding of s: a block counts as free of an isovalue only beyond this distance.
    pub(crate) slack: f64,
    /// Distance of samples in voxels of index space.
    pub(crate) step: f64,
    pub(crate) bisections: u32,
}

/// Work done.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Work {
    /// Evaluations of s, those of the bisections included.
    pub(crate) samples: u32,
    /// Blocks looked up.
    pub(crate) blocks: u32,
    /// Bisection steps.
    pub(crate) bisections: u32,
}

/// Sample k of a ray lies at `t0 + k h`, the last at `t1`.
#[derive(Debug, Clone, Copy)]
struct Steps {
    t0: f64,
    t1: f64,
    h: f64,
    inverse: f64,
    last: i64,
}

impl Steps {
    #[inline(always)]
    fn new(t0: f64, t1: f64, h: f64) -> Self {
        let inverse = 1.0 / h;
        Self {
            t0,
            t1,
            h,
            inverse,
            last: ((t1 - t0) * inverse).ceil() as i64,
        }
    }

    #[inline(always)]
    fn t(&self, k: i64) -> f64 {
        let t = self.t0 + k as f64 * self.h;
        if k < self.last && t < self.t1 { t } else { self.t1 }
    }

    /// The last sample not beyond `t`, which lies in [t0, t1].
    #[inline(always)]
    fn last_before(&self, t: f64) -> i64 {
        if t >= self.t1 {
            return self.last;
        }
        (((t - self.t0) * self.inverse) as i64).min(self.last)
    }
}

/// How far a ray has come.
#[derive(Debug, Clone, Copy)]
struct Progress {
    /// The next sample.
    k: i64,
    /// The class of the sample before it; `NONE` at the start.
    before: usize,
}

/// No sample was taken yet.
const NONE: usize = usize::MAX;

impl<T: Sample, const W: usize> March<'_, T, W> {
    /// How many isovalues are not above `s`: a surface lies between two samples whose classes differ.
    #[inline(always)]
    fn class(&self, s: f64) -> usize {
        let first = usize::from(s >= self.lowest);
        if self.isovalues.len() == 1 || first == 0 {
            return first;
        }
        self.isovalues.iter().filter(|c| s >= **c).count()
    }

    /// Class of a whole block, or `NONE` where an isovalue lies in its range.
    #[inline(always)]
    fn class_of_block(&self, range: [T; 2]) -> usize {
        let lo = self.class(range[0].f64() - self.slack);
        if lo == self.class(range[1].f64() + self.slack) {
            lo
        } else {
            NONE
        }
    }

    #[inline(always)]
    fn value(&self, ray: &IndexRay, t: f64) -> f64 {
        self.volume.value(self.volume.clamp(ray.at(t)))
    }

    /// Calls `hit(t, i)` for each sign change of s - isovalue i between consecutive samples, in the order of t, until it returns false; only in
    /// the `kept` part of the ray, if any, where its entry into the grid is then the start of what is kept.
    ///
    /// Blocks without an isovalue in their range are stepped over; all samples in one have its class, so the hits are those found
    /// without blocks.
    #[inline(always)]
    pub(crate) fn run(&self, ray: &IndexRay, kept: Option<(f64, f64)>, work: &mut Work, mut hit: impl FnMut(f64, usize) -> bool) {
        let Some((t0, t1)) = ray.clip_within(self.volume.last(), kept) else {
            return;
        };
        let steps = Steps::new(t0, t1, self.step / ray.speed());
        let mut p = Progress { k: 0, before: NONE };
        let Some(blocks) = self.blocks else {
            self.sample(ray, &steps, t0, t1, &mut p, work, &mut hit);
            return;
        };
        let (coarse, fine) = (blocks.coarse(), blocks.fine());
        let mut enter = t0;
        let mut outer = Walk::new(ray, coarse, coarse.find(self.volume.clamp(ray.at(t0)).get()));
        loop {
            work.blocks += 1;
            let (t, next) = outer.exit(ray);
            let exit = if next < t1 { next } else { t1 };
            let class = self.class_of_block(coarse.get(outer.index as usize));
            let more = if class == NONE {
                self.walk_fine(ray, &steps, fine, [enter, exit], &mut p, work, &mut hit)
            } else {
                class == p.before || self.pass(ray, &steps, [enter, exit], class, &mut p, work, &mut hit)
            };
            if !more || next >= t1 {
                return;
            }
            enter = exit;
            outer.step(t, next);
        }
    }

    /// The smaller blocks between two t, all inside one larger block; whether to go on.
    #[inline(always)]
    #[expect(clippy::too_many_arguments, reason = "a part of `run`, taken out for its length")]
    fn walk_fine(
        &self,
        ray: &IndexRay,
        steps: &Steps,
        fine: &Level<T>,
        [mut enter, end]: [f64; 2],
        p: &mut Progress,
        work: &mut Work,
        hit: &mut impl FnMut(f64, usize) -> bool,
    ) -> bool {
        // The larger block that holds the middle of the stretch: its ends are rounded.
        let middle = self.volume.clamp(ray.at(0.5 * (enter + end))).get();
        let upper = fine.find(middle).map(|b| b / UP);
        let first = fine.inside(fine.find(self.volume.clamp(ray.at(enter)).get()), upper);
        let mut walk = Walk::new(ray, fine, first);
        loop {
            work.blocks += 1;
            let (t, next) = walk.exit(ray);
            let exit = if next < end { next } else { end };
            let class = self.class_of_block(fine.get(walk.index as usize));
            let more = if class == NONE {
                self.sample(ray, steps, enter, exit, p, work, hit)
            } else {
                class == p.before || self.pass(ray, steps, [enter, exit], class, p, work, hit)
            };
            if !more {
                return false;
            }
            if next >= end {
                return true;
            }
            enter = exit;
            walk.step(t, next);
        }
    }

    /// Takes the samples of a stretch; whether to go on.
    #[inline(always)]
    #[expect(clippy::too_many_arguments, reason = "a part of `run`, taken out for its length")]
    fn sample(
        &self,
        ray: &IndexRay,
        steps: &Steps,
        enter: f64,
        exit: f64,
        p: &mut Progress,
        work: &mut Work,
        hit: &mut impl FnMut(f64, usize) -> bool,
    ) -> bool {
        if p.before == NONE {
            p.before = self.class(self.value(ray, steps.t0));
            p.k = 1;
            work.samples += 1;
        }
        let from = p.k.max(steps.last_before(enter) + 1);
        let end = steps.last_before(exit) + 1;
        let mut k = from;
        while k < end {
            let class = self.class(self.value(ray, steps.t(k)));
            if class != p.before {
                work.samples += (k - from) as u32;
                if !self.refine(ray, steps, k, p.before, class, work, hit) {
                    work.samples += 1;
                    return false;
                }
                work.samples -= (k - from) as u32;
                p.before = class;
            }
            k += 1;
        }
        work.samples += (k - from) as u32;
        p.k = k;
        true
    }

    /// A stretch through a block of a class other than that of the last sample; whether to go on.
    #[inline(never)]
    #[expect(
        clippy::too_many_arguments,
        reason = "kept out of the loop's way; a struct would only rename them"
    )]
    fn pass(
        &self,
        ray: &IndexRay,
        steps: &Steps,
        [enter, exit]: [f64; 2],
        class: usize,
        p: &mut Progress,
        work: &mut Work,
        hit: &mut impl FnMut(f64, usize) -> bool,
    ) -> bool {
        if p.before == NONE {
            (p.k, p.before) = (1, class);
            return true;
        }
        let k = p.k.max(steps.last_before(enter) + 1);
        let end = steps.last_before(exit) + 1;
        p.k = p.k.max(end);
        if k >= end {
            return true;
        }
        let before = std::mem::replace(&mut p.before, class);
        self.refine(ray, steps, k, before, class, work, hit)
    }

    /// The hits between samples k - 1 (of class `from`) and k (of class `to`).
    #[inline(never)]
    #[expect(
        clippy::too_many_arguments,
        reason = "kept out of the loop's way; a struct would only rename them"
    )]
    fn refine(
        &self,
        ray: &IndexRay,
        steps: &Steps,
        k: i64,
        from: usize,
        to: usize,
        work: &mut Work,
        hit: &mut impl FnMut(f64, usize) -> bool,
    ) -> bool {
        let (lo, hi) = (steps.t(k - 1), steps.t(k));
        let (first, last) = (from.min(to), from.max(to));
        if last - first == 1 {
            return hit(self.bisect(ray, lo, hi, first, to > from, work), first);
        }
        // Several isovalues in one step: rare, so found anew in each round rather than kept in a list.
        let mut after = (f64::NEG_INFINITY, 0);
        for _ in first..last {
            let mut next = (f64::INFINITY, usize::MAX);
            for i in first..last {
                let t = self.bisect(ray, lo, hi, i, to > from, work);
                // order of t, then of the values along the ray
                let rank = if to > from { i } else { last - i };
                let key = (t, rank + 1);
                if key > after && key < next {
                    next = key;
                }
            }
            after = next;
            let i = if to > from { next.1 - 1 } else { last - (next.1 - 1) };
            if !hit(next.0, i) {
                return false;
            }
        }
        true
    }

    /// The middle of the last bracket of s = isovalue `i` in [lo, hi]; `rising`: s >= isovalue at hi and not at lo.
    #[inline(always)]
    fn bisect(&self, ray: &IndexRay, mut lo: f64, mut hi: f64, i: usize, rising: bool, work: &mut Work) -> f64 {
        let c = self.isovalues[i];
        for _ in 0..self.bisections {
            let mid = 0.5 * (lo + hi);
            if mid <= lo || mid >= hi {
                break;
            }
            work.samples += 1;
            work.bisections += 1;
            if (self.value(ray, mid) >= c) == rising {
                hi = mid;
            } else {
                lo = mid;
            }
        }
        0.5 * (lo + hi)
    }
}
