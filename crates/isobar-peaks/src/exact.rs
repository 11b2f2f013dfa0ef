//! The ray that loses nothing: every crossing of every peak and isovalue, and the medium between them, cell by cell.
//!
//! Knoll et al. 2009, section 4, with another way to find the peaks: instead of the rule of signs between samples, the exact polynomial of the field in each
//! cell (`volume.rs`, `crossings.rs`). Opacity of a peak is unscaled, and its value is the isovalue itself, as in section 4.2. The medium is integrated on
//! stretches of a cell along which the field is as good as linear ([`crate::Medium::stretch`]): as many as keep its distance from a chord below the knob
//! `tolerance` times the range of the values, and more where the transfer function has narrower features there (`Way::chords_of`). Cells are taken one at a time, or eight (`eight.rs`).
//!
//! **Claims.** With no medium to be seen, EXISTS, FIRST and EMPTY are what `crossings.rs` proves, given the bound of `volume.rs`: (steep E + rounding + steep L) M, with E the error of
//! a position, L how far the ray travels between the domain shrunk and grown by E, clipping planes by their own error (`space.rs`, `isobar_cpu::clip`), M the range of the coefficients. Cells are passed by only where their range
//! stays [`MARGIN`] M away from every value, which is more than the bound, so that there no value is met; a stretch of the ray within E of a face and given to the
//! wrong one of two cells is covered, because both fields agree on the face and leave it by at most steep M E. Rays whose bound exceeds [`MARGIN`] (eyes more than some 10^8
//! voxels away) claim nothing.

mod eight;

use crate::crossings::{Crossing, Stretch, Track};
use crate::macrocells::{LOG, Visible, Visit, bit, span};
use crate::medium::{Medium, Sums, opacity};
use crate::sink::Sink;
use crate::space::{Dda, Entry, Walk, three};
use crate::volume::{Form, MOST, Volume};
use glam::DVec3;
use isobar_core::{Claim, ClipPlane, Hit, Ray};
use isobar_cpu::packet::{LANES, Lanes};
use isobar_poly::bernstein;
use std::marker::PhantomData;

/// Features narrower than this times the tolerance are looked at.
const FINE: f64 = 4.0;

/// Inverse of the part by which the field's slope may change along a chord through one.
const TURN: f64 = 4.0;

/// Most chords for the sake of a feature: enough for those of 1e-6 of the range where the field bends by all of it.
const FINEST: f64 = 4096.0;

/// Most chords of a cell: no tolerance asks for more than 2 10^4, at the greatest bend of degree 9.
const MOST_CHORDS: f64 = 65_536.0;

/// Cells are looked at where they come within this much of M to a value.
pub(crate) const MARGIN: f64 = 1e-6;

/// What all rays share.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Exact<'a> {
    pub(crate) volume: &'a Volume,
    pub(crate) visible: &'a Visible,
    /// Open cuts.
    pub(crate) clips: &'a [ClipPlane],
    /// Values to find, ascending, and the surface of each.
    pub(crate) values: &'a [f64],
    pub(crate) index: &'a [u8],
    /// Integrated between the surfaces.
    pub(crate) medium: Option<&'a Medium>,
    /// A cell with a crossing has no medium.
    pub(crate) either: bool,
    pub(crate) claims: bool,
    /// Cells are taken eight at a time where there is a medium.
    pub(crate) packets: bool,
    /// The reference subtracted from all values, and M.
    pub(crate) reference: f64,
    pub(crate) size: f64,
    /// Greatest distance of the field from its chords, in values.
    pub(crate) tolerance: f64,
    /// Optical depth up to which a stretch has one colour: attenuation inside it, which that leaves out, moves a channel by at most a twelfth of its square.
    pub(crate) thick: f64,
}

/// Work of one tile.
#[derive(Debug, Default, Clone, Copy)]
pub(crate) struct Work {
    pub(crate) macrocells: u64,
    pub(crate) cells: u64,
    pub(crate) stretches: u64,
    pub(crate) crossings: u64,
}

/// What is kept along a ray.
#[derive(Debug)]
pub(crate) struct Scratch {
    tracks: Vec<Track>,
    found: Vec<Crossing>,
    pub(crate) work: Work,
    /// Of the last ray, and the bound E of it.
    origin: DVec3,
    error: f64,
}

impl Scratch {
    pub(crate) fn new(values: usize) -> Self {
        Self {
            tracks: vec![Track::default(); values],
            found: Vec::with_capacity(3 * values + 1),
            work: Work::default(),
            origin: DVec3::NAN,
            error: f64::INFINITY,
        }
    }
}

impl<'a> Exact<'a> {
    /// Draws one pixel.
    #[inline(always)]
    pub(crate) fn draw<S: Lanes, F: Form>(&self, form: F, ray: &Ray, mut sink: Sink<'_, '_>, scratch: &mut Scratch) {
        if scratch.origin != ray.origin {
            scratch.origin = ray.origin;
            scratch.error = self.volume.space.position_error(ray.origin);
        }
        let error = scratch.error;
        let prove = self.claims && self.medium.is_none();
        let walk = match Walk::enter(ray, &self.volume.space, self.clips, prove.then_some(error)) {
            Entry::Through(walk) => walk,
            Entry::Misses { certain } => {
                return sink.finish(if certain { Claim::EMPTY } else { Claim::empty() });
            }
        };
        let steep = self.volume.steep();
        let certain_bound = steep * (error + walk.loose) + self.volume.rounding();
        // Where nothing can be proved the search goes on with the bound of a position alone.
        let certain = certain_bound <= MARGIN;
        let bound = if certain {
            certain_bound
        } else {
            (steep * error + self.volume.rounding()).min(MARGIN)
        };
        scratch.tracks.fill(Track::default());
        scratch.found.clear();
        let mut way = Way::<S, F> {
            shared: self,
            form,
            walk,
            ray,
            bound: bound * self.size,
            short: 1e-2 / walk.speed(),
            end: f64::NEG_INFINITY,
            tail: Tail::NOWHERE,
            run: Run::new(),
            // The first crossing may end a ray that has no medium, and what is walked ahead of it is lost.
            most: if self.packets && self.medium.is_some() { LANES } else { 1 },
            length: ray.direction.length(),
            sink: &mut sink,
            scratch,
            prove,
            certain: certain && prove,
            claim: Claim::empty(),
            ended: false,
            lanes: PhantomData,
        };
        self.visible.walk(&walk, &mut way);
        way.ended = way.ended || !way.take();
        way.finish();
        let (certain, mut claim) = (way.certain, way.claim);
        if certain && sink.hits() == 0 {
            claim = Claim::EMPTY;
        }
        sink.finish(claim);
    }
}

/// Where the last medium ended: what the next cell begins with if it begins there.
#[derive(Clone, Copy)]
struct Tail {
    t: f64,
    /// The field and its sums.
    value: f64,
    sums: Sums,
}

impl Tail {
    const NOWHERE: Self = Self {
        t: f64::NEG_INFINITY,
        value: 0.0,
        sums: Sums {
            depth: 0.0,
            colour: [0.0; 3],
        },
    };
}

/// Cells whose places are known, and not yet what is there.
struct Run {
    cell: [[i32; LANES]; 3],
    t0: [f64; LANES],
    t1: [f64; LANES],
    count: usize,
}

/// A ray on its way.
struct Way<'r, 's, 'a, 'p, 'q, S, F> {
    shared: &'r Exact<'a>,
    form: F,
    walk: Walk,
    ray: &'r Ray,
    /// Of a coefficient.
    bound: f64,
    short: f64,
    /// Where the last cell ended.
    end: f64,
    tail: Tail,
    run: Run,
    /// Cells taken together.
    most: usize,
    /// World length of the direction.
    length: f64,
    sink: &'s mut Sink<'p, 'q>,
    scratch: &'s mut Scratch,
    /// Crossings are to be proved.
    prove: bool,
    /// All that was walked is proved.
    certain: bool,
    claim: Claim,
    ended: bool,
    lanes: PhantomData<S>,
}

impl<S: Lanes, F: Form> Visit for Way<'_, '_, '_, '_, '_, S, F> {
    #[inline(always)]
    fn macrocell(&mut self, at: [i32; 3], from: f64, to: f64) -> bool {
        self.scratch.work.macrocells += 1;
        let mask = self.shared.visible.cells_of(at, self.form);
        if mask == 0 {
            return true;
        }
        let w = self.walk;
        let (lo, hi) = span(at, self.shared.volume.space.cells);
        let mut cell = Dda::new(&w, 0, from, lo, hi);
        let mut t = from;
        loop {
            let (a, exit) = cell.exit();
            let end = exit.min(to).max(t);
            if mask >> bit(cell.at) & 1 != 0 {
                self.run.push(cell.at, t, end);
                if self.run.count == self.most && !self.take() {
                    self.ended = true;
                    return false;
                }
            }
            if end >= to || !cell.step(&w, a, lo, hi) {
                return true;
            }
            t = end;
        }
    }
}

const _: () = assert!(LOG == 2, "words of 64 cells");

impl<S: Lanes, F: Form> Way<'_, '_, '_, '_, '_, S, F> {
    /// A cell along which the field has these Bernstein coefficients. Returns whether to go on.
    #[inline(always)]
    fn cell(&mut self, p: &[f64], stretch: Stretch) -> bool {
        let shared = self.shared;
        let Stretch { t0, t1, .. } = stretch;
        self.scratch.work.cells += 1;
        self.sink.work += 1;
        let (mut least, mut most) = (p[0], p[0]);
        for &x in &p[1..] {
            least = least.min(x);
            most = most.max(x);
        }
        let continues = self.end == t0;
        self.end = t1;
        let Scratch { tracks, found, .. } = &mut *self.scratch;
        for (i, (track, &value)) in tracks.iter_mut().zip(shared.values).enumerate() {
            if !continues {
                track.end(i, self.short, found);
            }
            let v = value - shared.reference;
            if least - v > self.bound {
                track.clear(1, i, self.short, found);
            } else if most - v < -self.bound {
                track.clear(-1, i, self.short, found);
            } else {
                let mut q = [0.0; MOST];
                for (q, p) in q.iter_mut().zip(p) {
                    *q = p - v;
                }
                track.follow(&q[..F::COUNT], self.bound, stretch, i, found);
            }
        }
        if found.len() > 1 {
            found.sort_by(|x, y| x.t.total_cmp(&y.t));
        }
        match shared.medium {
            Some(medium) if self.sink.is_clear() && (!shared.either || self.scratch.found.is_empty()) => {
                self.through(medium, p, least, most, stretch)
            }
            _ => self.push_all(),
        }
    }

    /// Chords that a cell needs, not rounded up.
    ///
    /// |p''| is at most n (n - 1) times the greatest second difference, and a chord of width h leaves p by at most h^2 |p''| / 8. The optical depth of a feature grows with the
    /// inverse of the slope there, and a chord has one slope: so where a feature is narrower than what a chord may leave the field by, there are as many as keep the slope within 1/[`TURN`]
    /// along each of them, or, where the field turns or all but stands still, its distance below a quarter of the feature's width.
    #[inline(always)]
    fn chords_of(&self, medium: &Medium, p: &[f64], least: f64, most: f64) -> f64 {
        let n = F::COUNT - 1;
        let mut before = p[1] - p[0];
        let (mut bend, mut flattest) = (0.0f64, before.abs());
        let (mut falls, mut rises) = (before < 0.0, before > 0.0);
        for i in 1..n {
            let d = p[i + 1] - p[i];
            bend = later((d - before).abs(), bend);
            flattest = if d.abs() < flattest { d.abs() } else { flattest };
            falls |= d < 0.0;
            rises |= d > 0.0;
            before = d;
        }
        let squared = 0.125 * (n * (n - 1)) as f64 * bend;
        let allowed = self.shared.tolerance;
        let turn = TURN * (n - 1) as f64 * bend;
        // What the lanes take as it is.
        if squared <= allowed && (medium.narrowest() >= FINE * allowed || !(falls && rises) && turn <= flattest) {
            return 1.0;
        }
        let chords = later((squared / allowed).sqrt(), 1.0);
        if medium.narrowest() >= FINE * allowed || !(falls && rises) && turn <= chords * flattest {
            return chords;
        }
        let reference = self.shared.reference;
        let fine = 0.25 * medium.finest(least + reference, most + reference);
        if fine >= allowed {
            return chords;
        }
        let fine = (squared / fine).sqrt().min(FINEST);
        if falls && rises {
            later(chords, fine)
        } else {
            later(chords, (turn / flattest).min(fine))
        }
    }

    /// Hands on what was found, in order. Returns whether to go on.
    #[inline(always)]
    fn push_all(&mut self) -> bool {
        for i in 0..self.scratch.found.len() {
            if !self.push(i) {
                self.scratch.found.clear();
                return false;
            }
        }
        self.scratch.found.clear();
        // A ray that is dark but whose hits are wanted goes on.
        true
    }

    /// Hands on crossing `i` of those found.
    #[inline(always)]
    fn push(&mut self, i: usize) -> bool {
        let found = self.scratch.found[i];
        self.scratch.work.crossings += 1;
        let t = found.t;
        let g = self.form.gradient(three(|a| self.walk.at(a, t)));
        let proved = found.error.is_finite();
        if self.sink.hits() == 0 && proved && self.prove {
            // An error bound holds whatever was before; that nothing was needs all of it proved, and that no other value is in doubt there.
            let undecided = self
                .scratch
                .tracks
                .iter()
                .any(|track| track.doubted_from() <= t + found.error);
            self.claim = if self.certain && !undecided {
                Claim::EXISTS | Claim::FIRST
            } else {
                Claim::empty()
            };
        }
        let hit = Hit {
            t,
            point: self.ray.at(t),
            normal: self
                .shared
                .volume
                .space
                .world_gradient(g)
                .normalize_or(DVec3::ZERO)
                .as_vec3()
                .to_array(),
            surface: self.shared.index[found.value],
            t_error: if self.claim.is_empty() { f64::INFINITY } else { found.error },
        };
        self.certain &= proved;
        self.sink.surface(&hit);
        self.sink.wants_more(true)
    }

    /// The medium of a cell between the crossings found in it.
    #[inline(always)]
    fn through(&mut self, medium: &Medium, p: &[f64], least: f64, highest: f64, s: Stretch) -> bool {
        let shared = self.shared;
        if !medium.support().meets(least + shared.reference, highest + shared.reference) {
            return self.push_all();
        }
        let n = F::COUNT - 1;
        let chords = self.chords_of(medium, p, least, highest);
        let length = (s.t1 - s.t0) * self.length;
        // Both cells at a face have the same field there: what was worked out before it holds after it.
        let (value, sums) = if self.tail.t == s.t0 {
            (self.tail.value, self.tail.sums)
        } else {
            let value = p[0] + shared.reference;
            (value, medium.sums(value))
        };
        let last = p[n] + shared.reference;
        let (value, sums) = if chords <= 1.0 && self.scratch.found.is_empty() {
            let after = medium.sums(last);
            self.layer(medium, [value, last], [&sums, &after], length);
            (last, after)
        } else {
            match self.bent(medium, p, (value, sums), chords, s, length) {
                Some(end) => end,
                None => return false,
            }
        };
        self.tail = Tail { t: s.t1, value, sums };
        self.sink.wants_more(!shared.values.is_empty())
    }

    /// A cell with crossings or more than one chord. Returns the field and its sums at the end; `None` ends the ray.
    #[inline(always)]
    fn bent(
        &mut self,
        medium: &Medium,
        p: &[f64],
        (value, sums): (f64, Sums),
        chords: f64,
        s: Stretch,
        length: f64,
    ) -> Option<(f64, Sums)> {
        let shared = self.shared;
        let chords = chords.ceil().clamp(1.0, MOST_CHORDS);
        let mut power = [0.0; MOST];
        let power = &mut power[..F::COUNT];
        power.copy_from_slice(p);
        bernstein::to_power(power);
        power[0] += shared.reference;
        let mut here = (0.0, value, sums);
        for i in 0..=self.scratch.found.len() {
            let (x, value) = match self.scratch.found.get(i) {
                Some(c) => {
                    let x = ((c.t - s.t0) / (s.t1 - s.t0)).clamp(here.0, 1.0);
                    (x, shared.values[c.value])
                }
                None => (1.0, p[F::COUNT - 1] + shared.reference),
            };
            here = self.chords(medium, power, here, (x, value), chords, length);
            if i < self.scratch.found.len() && !self.push(i) {
                self.scratch.found.clear();
                return None;
            }
        }
        self.scratch.found.clear();
        Some((here.1, here.2))
    }

    /// Integrates from one place (local position, value, sums) to another.
    #[inline(always)]
    fn chords(
        &mut self,
        medium: &Medium,
        power: &[f64],
        from: (f64, f64, Sums),
        (to, end): (f64, f64),
        chords: f64,
        length: f64,
    ) -> (f64, f64, Sums) {
        let count = (chords * (to - from.0)).ceil().max(1.0) as u32;
        let step = (to - from.0) / f64::from(count);
        let (mut value, mut sums) = (from.1, from.2);
        for k in 1..=count {
            let next = if k == count {
                end
            } else {
                horner(power, from.0 + step * f64::from(k))
            };
            let after = medium.sums(next);
            self.layer(medium, [value, next], [&sums, &after], step * length);
            (value, sums) = (next, after);
        }
        (to, value, sums)
    }

    /// One chord.
    #[inline(always)]
    fn layer(&mut self, medium: &Medium, [a, b]: [f64; 2], sums: [&Sums; 2], length: f64) {
        let (depth, colour, opacity) = medium.layer(a, b, sums, length);
        if depth > self.shared.thick && a != b {
            self.thick(medium, [a, b], length);
        } else {
            self.sink.layer(colour, opacity);
        }
        self.scratch.work.stretches += 1;
    }

    /// A stretch in which what is in front hides some of what is behind: cut at the transfer function's points and into parts of a small depth.
    #[inline(never)]
    fn thick(&mut self, medium: &Medium, [a, b]: [f64; 2], length: f64) {
        let (sink, thick) = (&mut *self.sink, self.shared.thick);
        medium.pieces_between(a, b, |from, to| {
            let length = length * ((to - from) / (b - a));
            let (mut value, mut sums) = (from, medium.sums(from));
            let all = medium.sums(to).depth - sums.depth;
            let parts = (all * (length / (to - from)) / thick).ceil().max(1.0);
            let mut left = parts;
            // Nothing is seen through a depth of 10, so that it takes no more than 10 / thick of them.
            while left > 0.0 && value != to && sink.is_clear() {
                let next = if left > 1.0 {
                    medium.after(value, to, all / parts)
                } else {
                    to
                };
                // Where the last digit of a value is more than a part.
                let next = if next == value { to } else { next };
                let after = medium.sums(next);
                let part = length * ((next - value) / (to - from));
                let (depth, colour) = medium.stretch(value, next, [&sums, &after], part);
                sink.medium(colour, opacity(depth));
                (value, sums) = (next, after);
                left -= 1.0;
            }
        });
    }

    /// The end of the ray.
    #[inline(always)]
    fn finish(&mut self) {
        if self.ended {
            return;
        }
        for i in 0..self.scratch.tracks.len() {
            if self.scratch.tracks[i].is_open() {
                let Scratch { tracks, found, .. } = &mut *self.scratch;
                tracks[i].end(i, self.short, found);
            }
        }
        self.scratch.found.sort_by(|x, y| x.t.total_cmp(&y.t));
        self.push_all();
    }
}

/// The greater of two numbers that are numbers: one instruction.
#[inline(always)]
fn later(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

#[inline(always)]
fn horner(power: &[f64], x: f64) -> f64 {
    power.iter().rev().fold(0.0, |s, c| s * x + c)
}
