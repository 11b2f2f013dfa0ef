//! The ray as printed: samples along it, and between two of them the peaks that the rule of signs finds.
//!
//! Knoll et al. 2009, sections 4.2 and 6. In every macrocell that can be seen the field is sampled at T(n) (`sampling.rs`). For each segment between samples the peak
//! table names up to four peaks; for each of them whose sign differs at the ends, three steps of the secant method inside the bracket give the place,
//! where the peak is shaded by the gradient and composited with its unscaled opacity and its own value, not the field's. Then the sample at the segment's end is
//! composited: post-classified, or by the pre-integration table, through the same loop.
//!
//! Where the samples lie does not depend on what is seen there. So they are taken eight at a time: positions, cells, interpolation, bins and table rows of eight samples of a ray in
//! the lanes of a vector; signs, secants and compositing then follow sample by sample, by the same expressions as one at a time (knob `packets`), so that both give the same bits.
//!
//! Segments are numbered, and the last one done is kept, so that a macrocell begins with the segment that reaches into it and none is done twice or left out (hardcases
//! E12; the paper keeps the greatest t). With [`Law::Printed`] positions inside a macrocell are summed from the printed increments, so that at the
//! next macrocell, where T(n) is computed anew, segments overlap or leave gaps: counted in [`Work::gaps`].

use crate::macrocells::{Macrocells, Visible, Visit};
use crate::medium::{Medium, opacity};
use crate::sampling::{Law, Sampler, Steps};
use crate::sink::Sink;
use crate::space::{Entry, Walk, three};
use crate::tables::{Lookup, NO_PEAK, PeakTable, SegmentTable};
use crate::volume::{Form, Volume};
use glam::DVec3;
use isobar_core::{Claim, ClipPlane, Hit, Ray, shade};
use isobar_cpu::packet::{LANES, Lanes};
use std::marker::PhantomData;

/// What a segment contributes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Mode {
    /// Peaks and the medium.
    Both,
    /// Peaks, and the medium of segments without one.
    Either,
    /// Peaks.
    Peaks,
    /// The medium.
    Medium,
}

/// How the medium of a segment is integrated.
#[derive(Debug)]
pub(crate) enum Integration {
    /// The sample at the segment's end stands for all of it.
    Post(Lookup),
    /// The table of Engel et al. 2001, shaded, if at all, at the segment's end.
    Table(SegmentTable),
    /// The same, shaded at both ends: Lum et al. 2004.
    Smooth(SegmentTable),
    /// Integral functions without a table.
    Analytic(Medium),
}

/// What all rays share.
#[derive(Debug)]
pub(crate) struct Paper<'a> {
    pub(crate) volume: &'a Volume,
    pub(crate) macrocells: &'a Macrocells,
    /// `None`: nothing is skipped and there are no macrocells.
    pub(crate) visible: Option<&'a Visible>,
    /// Open cuts: the first sample lies on the cut, the numbers of the others do not depend on it.
    pub(crate) clips: &'a [ClipPlane],
    /// Per macrocell its step multiplier, where they are used.
    pub(crate) multipliers: Option<&'a [u8]>,
    /// Ascending, and the surface of each.
    pub(crate) values: &'a [f64],
    pub(crate) index: &'a [u8],
    pub(crate) table: &'a PeakTable,
    pub(crate) mode: Mode,
    pub(crate) integration: Option<&'a Integration>,
    pub(crate) iterations: u32,
    pub(crate) sampler: &'a Sampler,
    /// The medium is shaded by the gradient.
    pub(crate) shaded: bool,
    /// Step to and position on the ray are rounded to single precision, steps summed.
    pub(crate) single: bool,
    /// Samples are taken eight at a time.
    pub(crate) packets: bool,
}

/// Work of one tile.
#[derive(Debug, Default, Clone, Copy)]
pub(crate) struct Work {
    pub(crate) macrocells: u64,
    /// Evaluations of the field at samples.
    pub(crate) samples: u64,
    /// And for peaks.
    pub(crate) secants: u64,
    pub(crate) gradients: u64,
    pub(crate) crossings: u64,
    /// Segments that do not begin where the one before ended though their macrocells touch.
    pub(crate) gaps: u64,
}

impl Paper<'_> {
    /// Draws one pixel.
    #[inline(always)]
    pub(crate) fn draw<S: Lanes, F: Form>(&self, form: F, ray: &Ray, mut sink: Sink<'_, '_>, work: &mut Work) {
        if let Entry::Through(walk) = Walk::enter(ray, &self.volume.space, self.clips, None) {
            let before = work.samples + work.secants;
            let mut way = Way::<S, F> {
                shared: self,
                form,
                walk,
                ray,
                steps: self.sampler.steps(ray.direction),
                length: ray.direction.length(),
                end: f64::NEG_INFINITY,
                next: 0.0,
                step: 0.0,
                // Without a medium the first peak may end the ray, and what is walked ahead of it is lost.
                run: Run::new(if self.packets && self.integration.is_some() {
                    LANES
                } else {
                    1
                }),
                seen: Seen::default(),
                ended: false,
                sink: &mut sink,
                work,
                lanes: PhantomData,
            };
            match self.visible {
                Some(visible) => visible.walk(&walk, &mut way),
                None => {
                    way.stretch(walk.t0, walk.t1, 1.0);
                }
            }
            if !way.ended && way.run.count > 0 {
                way.take();
            }
            sink.work = (work.samples + work.secants - before) as u32;
        }
        sink.finish(Claim::empty());
    }
}

/// Samples whose places are known, and not yet what is there.
struct Run {
    t: [f64; LANES],
    /// Those at which a segment does not end but only begins, a bit each.
    begins: u8,
    count: usize,
    /// Taken together.
    most: usize,
}

impl Run {
    #[inline(always)]
    const fn new(most: usize) -> Self {
        Self {
            t: [0.0; LANES],
            begins: 0,
            count: 0,
            most,
        }
    }

    #[inline(always)]
    fn push(&mut self, t: f64, begins: bool) {
        self.t[self.count] = t;
        self.begins |= u8::from(begins) << self.count;
        self.count += 1;
    }
}

/// A sample: its place, the field there, and the bin of that in the peak table.
#[derive(Debug, Clone, Copy, Default)]
struct Seen {
    t: f64,
    value: f64,
    bin: u32,
    /// Of the transfer function, where that is looked up.
    row: [f64; 4],
}

/// A ray on its way.
struct Way<'r, 's, 'a, 'p, 'q, S, F> {
    shared: &'r Paper<'a>,
    form: F,
    walk: Walk,
    ray: &'r Ray,
    steps: Steps,
    /// World length of the direction.
    length: f64,
    /// The last sample whose place is known: the place, and its number.
    end: f64,
    next: f64,
    /// The next increment where positions are summed; else T of sample `next`.
    step: f64,
    run: Run,
    /// The last sample that was taken.
    seen: Seen,
    ended: bool,
    sink: &'s mut Sink<'p, 'q>,
    work: &'s mut Work,
    lanes: PhantomData<S>,
}

impl<S: Lanes, F: Form> Visit for Way<'_, '_, '_, '_, '_, S, F> {
    #[inline(always)]
    fn macrocell(&mut self, at: [i32; 3], from: f64, to: f64) -> bool {
        self.work.macrocells += 1;
        let m = match self.shared.multipliers {
            Some(m) => f64::from(m[self.shared.macrocells.index(at)]),
            None => 1.0,
        };
        self.stretch(from, to, m)
    }
}

impl<S: Lanes, F: Form> Way<'_, '_, '_, '_, '_, S, F> {
    #[inline(always)]
    fn value(&self, t: f64) -> f64 {
        self.form.value(three(|a| self.walk.at(a, t)))
    }

    /// Samples all segments that begin before `to` and reach over `from`. Returns whether to go on.
    #[inline(always)]
    fn stretch(&mut self, from: f64, to: f64, m: f64) -> bool {
        self.begin(from);
        loop {
            let more = self.follow(to, m);
            if self.run.count == self.run.most && !self.take() {
                return false;
            }
            if !more {
                return true;
            }
        }
    }

    /// The first sample of a stretch: the end of the one before where its segments reach so far.
    #[inline(always)]
    fn begin(&mut self, from: f64) {
        let summed = self.sums();
        // The last sample lies beyond what has not been seen yet.
        if !summed && self.end >= from {
            return;
        }
        // Where increments are summed, each macrocell begins with the closed form again, as printed.
        let (n, at) = self.steps.before(if summed { from.max(self.end) } else { from });
        if summed || n > self.next || self.end == f64::NEG_INFINITY {
            let t = at.max(self.walk.t0);
            self.work.gaps += u64::from(self.end >= from && t != self.end);
            if t != self.end {
                self.end = t;
                // There is room: what is full has been taken.
                self.run.push(t, true);
            }
            self.next = n;
            self.step = match self.steps.law() {
                Law::Printed => self.steps.printed_increment(n),
                _ if summed => self.steps.t(n + 1.0) - at,
                _ => at,
            };
        }
    }

    /// Samples on until the run is full or the last segment reaches over `to`. Returns whether there are more.
    #[inline(always)]
    fn follow(&mut self, to: f64, m: f64) -> bool {
        let summed = self.sums();
        while self.end < to {
            if self.run.count == self.run.most {
                return true;
            }
            let n = self.next + m;
            let t = match (summed, self.shared.single) {
                (true, _) => self.summed(m),
                (false, true) => f64::from(self.steps.t(n) as f32),
                (false, false) => {
                    self.step = self.steps.after(self.step, self.next, m);
                    self.step
                }
            };
            let t = t.min(self.walk.t1);
            self.next = n;
            // Steps below the last digit of t end nowhere.
            if t <= self.end {
                if self.steps.t(n) > to {
                    return false;
                }
                continue;
            }
            self.run.push(t, false);
            self.end = t;
        }
        false
    }

    /// What is there of the run. Returns whether to go on.
    #[inline(always)]
    fn take(&mut self) -> bool {
        let (n, begins) = (self.run.count, self.run.begins);
        (self.run.count, self.run.begins) = (0, 0);
        let shared = self.shared;
        let (mut values, mut bins, mut rows) = ([0.0; LANES], [0; LANES], [[0.0; 4]; LANES]);
        let bins_of = (shared.mode != Mode::Medium && !shared.values.is_empty()).then_some(shared.table.bins());
        let lookup = match shared.integration {
            Some(Integration::Post(lookup)) if self.sink.is_clear() => Some(lookup),
            _ => None,
        };
        if self.run.most > 1 {
            let t = S::load(&self.run.t);
            let mut at = [t; 3];
            for (at, (&o, &d)) in at.iter_mut().zip(self.walk.o.iter().zip(&self.walk.d)) {
                *at = S::splat(o).add(t.mul(S::splat(d)));
            }
            let all = self.form.values(at, n);
            all.store(&mut values);
            if let Some(b) = bins_of {
                bins = b.of_eight(all);
            }
            if let Some(lookup) = lookup {
                rows = lookup.rows_of_eight(all, n);
            }
        } else if n > 0 {
            values[0] = self.value(self.run.t[0]);
            bins[0] = bins_of.map_or(0, |b| b.of(values[0]) as u32);
            rows[0] = lookup.map_or([0.0; 4], |l| l.row_at(values[0]));
        }
        for i in 0..n {
            self.work.samples += 1;
            let after = Seen {
                t: self.run.t[i],
                value: values[i],
                bin: bins[i],
                row: rows[i],
            };
            if begins >> i & 1 == 0 && !self.segment(&after) {
                self.ended = true;
                return false;
            }
            self.seen = after;
        }
        true
    }

    /// Whether positions are sums of increments.
    #[inline(always)]
    fn sums(&self) -> bool {
        match self.steps.law() {
            Law::Printed => true,
            Law::Differential => self.shared.single,
            Law::Geometric | Law::Uniform => false,
        }
    }

    /// The position after m increments.
    #[inline(always)]
    fn summed(&mut self, m: f64) -> f64 {
        let a = self.steps.printed_increment(1.0) - self.steps.printed_increment(0.0);
        let step = m * self.step + 0.5 * a * m * (m - 1.0);
        self.step += m * a;
        if self.shared.single {
            f64::from(self.end as f32 + step as f32)
        } else {
            self.end + step
        }
    }

    /// The segment from the last sample taken to this one. Returns whether to go on.
    #[inline(always)]
    fn segment(&mut self, after: &Seen) -> bool {
        let shared = self.shared;
        let before = self.seen;
        let mut found = false;
        if shared.mode != Mode::Medium && !shared.values.is_empty() {
            let peaks = shared.table.between(before.bin, after.bin);
            if peaks[0] != NO_PEAK {
                for peak in peaks {
                    if peak == NO_PEAK {
                        break;
                    }
                    let v = shared.values[usize::from(peak)];
                    let (d0, d1) = (before.value - v, after.value - v);
                    if (d0 < 0.0) != (d1 < 0.0) {
                        found = true;
                        if !self.peak(usize::from(peak), [before.t, after.t], [d0, d1]) {
                            return false;
                        }
                    }
                }
            }
        }
        match shared.integration {
            Some(integration) if self.sink.is_clear() && !(found && shared.mode == Mode::Either) => {
                self.medium(integration, &before, after);
            }
            _ => {}
        }
        self.sink.wants_more(!shared.values.is_empty())
    }

    /// The secant method inside a bracket: each step replaces the end of the same sign.
    #[inline(always)]
    fn peak(&mut self, peak: usize, mut t: [f64; 2], mut d: [f64; 2]) -> bool {
        let v = self.shared.values[peak];
        let secant = |t: [f64; 2], d: [f64; 2]| (t[0] - d[0] * (t[1] - t[0]) / (d[1] - d[0])).clamp(t[0], t[1]);
        let mut x = secant(t, d);
        for _ in 1..self.shared.iterations {
            let f = self.value(x) - v;
            self.work.secants += 1;
            let side = usize::from((f < 0.0) != (d[0] < 0.0));
            (t[side], d[side]) = (x, f);
            x = secant(t, d);
        }
        self.work.crossings += 1;
        let hit = Hit {
            t: x,
            point: self.ray.at(x),
            normal: self.normal(x),
            surface: self.shared.index[peak],
            t_error: f64::INFINITY,
        };
        self.sink.surface(&hit);
        self.sink.wants_more(true)
    }

    #[inline(always)]
    fn normal(&mut self, t: f64) -> [f32; 3] {
        self.work.gradients += 1;
        let g = self.form.gradient(three(|a| self.walk.at(a, t)));
        let g = self.shared.volume.space.world_gradient(g);
        g.normalize_or(DVec3::ZERO).as_vec3().to_array()
    }

    #[inline(always)]
    fn medium(&mut self, integration: &Integration, before: &Seen, after: &Seen) {
        let (t, f) = ([before.t, after.t], [before.value, after.value]);
        let length = (t[1] - t[0]) * self.length;
        let shaded = self.shared.shaded;
        let (depth, colour) = match integration {
            Integration::Post(_) => {
                let (e, c) = Lookup::parted(after.row);
                (e * length, if shaded && e > 0.0 { self.lit(t[1], c) } else { c })
            }
            Integration::Table(table) => {
                let (e, front, back) = table.segment(f[0], f[1]);
                let c = three(|i| front[i] + back[i]);
                (e * length, if shaded && e > 0.0 { self.lit(t[1], c) } else { c })
            }
            Integration::Smooth(table) => {
                let (e, front, back) = table.segment(f[0], f[1]);
                if shaded && e > 0.0 {
                    let (front, back) = (self.lit(t[0], front), self.lit(t[1], back));
                    (e * length, three(|i| front[i] + back[i]))
                } else {
                    (e * length, three(|i| front[i] + back[i]))
                }
            }
            Integration::Analytic(medium) => {
                let sums = [&medium.sums(f[0]), &medium.sums(f[1])];
                let (depth, c) = medium.stretch(f[0], f[1], sums, length);
                (depth, if shaded && depth > 0.0 { self.lit(t[1], c) } else { c })
            }
        };
        if depth > 0.0 {
            self.sink.medium(colour, opacity(depth));
        }
    }

    /// A colour shaded by the gradient at t.
    #[inline(always)]
    fn lit(&mut self, t: f64, colour: [f64; 3]) -> [f64; 3] {
        let n = self.normal(t);
        shade(colour.map(|c| c as f32), n, self.ray.direction).map(f64::from)
    }
}
