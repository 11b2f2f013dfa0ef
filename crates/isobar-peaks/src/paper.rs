//! The ray as printed: samples along it, and between two of them the peaks that the rule of signs finds.
//!
//! Knoll et al. 2009, sections 4.2 and 6. In every macrocell that can be seen the field is sampled at T(n) (`sampling.rs`). For each segment between samples the peak
//! table names up to four peaks; for each of them whose sign differs at the ends, three steps of the secant method inside the bracket give the place,
//! where the peak is shaded by the gradient and composited with its unscaled opacity and its own value, not the field's. Then the sample at the segment's end is
//! composited: post-classified, or by the pre-integration table, through the same loop.
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
    pub(crate) fn draw<F: Form>(&self, form: F, ray: &Ray, mut sink: Sink<'_, '_>, work: &mut Work) {
        if let Entry::Through(walk) = Walk::enter(ray, &self.volume.space, self.clips, None) {
            let before = work.samples + work.secants;
            let mut way = Way {
                shared: self,
                form,
                walk,
                ray,
                steps: self.sampler.steps(ray.direction),
                length: ray.direction.length(),
                end: f64::NEG_INFINITY,
                next: 0.0,
                last: 0.0,
                step: 0.0,
                sink: &mut sink,
                work,
            };
            match self.visible {
                Some(visible) => visible.walk(&walk, &mut way),
                None => {
                    way.stretch(walk.t0, walk.t1, 1.0);
                }
            }
            sink.work = (work.samples + work.secants - before) as u32;
        }
        sink.finish(Claim::empty());
    }
}

/// A ray on its way.
struct Way<'r, 's, 'a, 'p, 'q, F> {
    shared: &'r Paper<'a>,
    form: F,
    walk: Walk,
    ray: &'r Ray,
    steps: Steps,
    /// World length of the direction.
    length: f64,
    /// Where the last segment ended, the number of the sample there, and the field there.
    end: f64,
    next: f64,
    last: f64,
    /// The next increment where positions are summed; else T of sample `next`.
    step: f64,
    sink: &'s mut Sink<'p, 'q>,
    work: &'s mut Work,
}

impl<F: Form> Visit for Way<'_, '_, '_, '_, '_, F> {
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

impl<F: Form> Way<'_, '_, '_, '_, '_, F> {
    #[inline(always)]
    fn value(&self, t: f64) -> f64 {
        self.form.value(three(|a| self.walk.at(a, t)))
    }

    /// Samples all segments that begin before `to` and reach over `from`. Returns whether to go on.
    #[inline(always)]
    fn stretch(&mut self, from: f64, to: f64, m: f64) -> bool {
        let (t0, t1) = (self.walk.t0, self.walk.t1);
        let summed = self.sums();
        // Where increments are summed, each macrocell begins with the closed form again, as printed.
        let n = self.steps.before(if summed { from.max(self.end) } else { from });
        if summed || n > self.next || self.end == f64::NEG_INFINITY {
            let t = self.steps.t(n).max(t0);
            self.work.gaps += u64::from(self.end >= from && t != self.end);
            if t != self.end {
                self.end = t;
                self.last = self.value(t);
                self.work.samples += 1;
            }
            self.next = n;
            self.step = match self.steps.law() {
                Law::Printed => self.steps.printed_increment(n),
                _ if summed => self.steps.t(n + 1.0) - self.steps.t(n),
                _ => self.steps.t(n),
            };
        }
        while self.end < to {
            let n = self.next + m;
            let t = match (summed, self.shared.single) {
                (true, _) => self.summed(m),
                (false, true) => f64::from(self.steps.t(n) as f32),
                (false, false) => {
                    self.step = self.steps.after(self.step, self.next, m);
                    self.step
                }
            };
            let t = t.min(t1);
            // Steps below the last digit of t end nowhere.
            if t <= self.end {
                self.next = n;
                if self.steps.t(n) > to {
                    return true;
                }
                continue;
            }
            let value = self.value(t);
            self.work.samples += 1;
            let go_on = self.segment(self.end, t, self.last, value);
            (self.end, self.last, self.next) = (t, value, n);
            if !go_on {
                return false;
            }
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

    /// One segment. Returns whether to go on.
    #[inline(always)]
    fn segment(&mut self, t0: f64, t1: f64, f0: f64, f1: f64) -> bool {
        let mut found = false;
        if self.shared.mode != Mode::Medium {
            let peaks = self.shared.table.peaks(f0, f1);
            if peaks[0] != NO_PEAK {
                for peak in peaks {
                    if peak == NO_PEAK {
                        break;
                    }
                    let v = self.shared.values[usize::from(peak)];
                    let (d0, d1) = (f0 - v, f1 - v);
                    if (d0 < 0.0) != (d1 < 0.0) {
                        found = true;
                        if !self.peak(usize::from(peak), [t0, t1], [d0, d1]) {
                            return false;
                        }
                    }
                }
            }
        }
        match self.shared.integration {
            Some(integration) if self.sink.is_clear() && !(found && self.shared.mode == Mode::Either) => {
                self.medium(integration, [t0, t1], [f0, f1]);
            }
            _ => {}
        }
        self.sink.wants_more(!self.shared.values.is_empty())
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
    fn medium(&mut self, integration: &Integration, t: [f64; 2], f: [f64; 2]) {
        let length = (t[1] - t[0]) * self.length;
        let shaded = self.shared.shaded;
        let (depth, colour) = match integration {
            Integration::Post(lookup) => {
                let (e, c) = lookup.at(f[1]);
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
