//! Eight consecutive cells of a ray in the lanes of a vector.
//!
//! Where cells lie does not depend on what is in them, so the walk runs up to eight cells ahead. Local coordinates, composition, which values a cell may cross, and, where one chord is enough, its
//! optical depth are then worked out for all of them by the expressions that `exact.rs` has for one cell, so that both give the same bits. What follows goes cell by cell, in order:
//! a lane is taken as it is where no value is crossed and one chord without special care is enough; the others go the way of single cells, with the polynomial that is there already.

use super::{Run, Tail, Way};
use crate::crossings::Stretch;
use crate::medium::{Medium, Sums};
use crate::space::Walk;
use crate::volume::{Form, MOST};
use isobar_cpu::packet::{LANES, Lanes, three};

/// Values whose signs are told in lanes.
const TOLD: usize = 8;

/// What the lanes know of eight cells.
struct Eight {
    /// Bernstein coefficients, by coefficient.
    p: [[f64; LANES]; MOST],
    /// No value can be met.
    plain: u8,
    /// Per value, where the field is greater than it.
    greater: [u8; TOLD],
    /// There is medium to be seen.
    medium: u8,
    /// Plain, with medium, and one chord as it is.
    chord: u8,
    chords: Chords,
}

/// One chord in each cell.
struct Chords {
    /// The cell takes its first value over from the one before.
    joined: u8,
    /// The field at the end, and its sums.
    end: [f64; LANES],
    sums: [Sums; LANES],
    /// What they add: premultiplied colour, opacity.
    layer: [[f64; 4]; LANES],
}

/// Lanes where both are the same number.
#[inline(always)]
fn same<S: Lanes>(a: S, b: S) -> u8 {
    !(a.above(b) | b.above(a))
}

/// [`Walk::local`] of eight cells.
#[inline(always)]
fn local<S: Lanes>(w: &Walk, cell: [S; 3], t: S) -> [S; 3] {
    let (zero, one) = (S::splat(0.0), S::splat(1.0));
    // No closures here and below: one that is not inlined calls every instruction as a function.
    let mut out = [zero; 3];
    for a in 0..3 {
        let (inv, shift) = (S::splat(w.inv[a]), S::splat(w.shift[a]));
        let x = S::splat(w.o[a]).add(t.mul(S::splat(w.d[a]))).sub(cell[a]);
        let (near, far) = (cell[a].mul(inv).add(shift), cell[a].add(one).mul(inv).add(shift));
        out[a] = zero.where_or(same(t, near), one.where_or(same(t, far), x));
    }
    out
}

impl<S: Lanes, F: Form> Way<'_, '_, '_, '_, '_, S, F> {
    /// The cells of the run. Returns whether to go on.
    #[inline(always)]
    pub(super) fn take(&mut self) -> bool {
        let n = std::mem::take(&mut self.run.count);
        // Lanes pay from three cells on.
        let eight = if n > 2 { Some(self.in_lanes(n)) } else { None };
        for l in 0..n {
            let s = Stretch {
                t0: self.run.t0[l],
                t1: self.run.t1[l],
                short: self.short,
                prove: self.prove,
            };
            let mut p = [0.0; MOST];
            match &eight {
                Some(e) => {
                    if let Some(go_on) = self.plain(e, l, s) {
                        if go_on {
                            continue;
                        }
                        return false;
                    }
                    for (p, all) in p.iter_mut().zip(&e.p).take(F::COUNT) {
                        *p = all[l];
                    }
                }
                None => {
                    let cell = three(|a| self.run.cell[a][l]);
                    let (a, b) = (self.walk.local(cell, s.t0), self.walk.local(cell, s.t1));
                    self.form.compose(cell, a, b, self.shared.reference, &mut p);
                }
            }
            if !self.cell(&p[..F::COUNT], s) {
                return false;
            }
        }
        true
    }

    /// Lane l, where nothing but a chord is in it; `None` where it is not so plain.
    #[inline(always)]
    fn plain(&mut self, e: &Eight, l: usize, s: Stretch) -> Option<bool> {
        let bit = 1u8 << l;
        if e.plain & bit == 0 || self.scratch.tracks.iter().any(|t| t.is_open()) {
            return None;
        }
        let medium = if self.sink.is_clear() { self.shared.medium } else { None };
        let seen = medium.is_some() && e.medium & bit != 0;
        let joined = self.tail.t == s.t0;
        if seen && (e.chord & bit == 0 || joined != (e.chords.joined & bit != 0)) {
            return None;
        }
        self.scratch.work.cells += 1;
        self.sink.work += 1;
        self.end = s.t1;
        for (track, greater) in self.scratch.tracks.iter_mut().zip(&e.greater) {
            track.stays(if greater & bit != 0 { 1 } else { -1 });
        }
        if !seen {
            return Some(true);
        }
        let [r, g, b, opacity] = e.chords.layer[l];
        self.sink.layer([r, g, b], opacity);
        self.scratch.work.stretches += 1;
        self.tail = Tail {
            t: s.t1,
            value: e.chords.end[l],
            sums: e.chords.sums[l],
        };
        Some(self.sink.wants_more(!self.shared.values.is_empty()))
    }

    #[inline(always)]
    fn in_lanes(&self, n: usize) -> Eight {
        let shared = self.shared;
        let run = &self.run;
        let mut cell = [S::splat(0.0); 3];
        for (cell, indices) in cell.iter_mut().zip(&run.cell) {
            let mut c = [0.0; LANES];
            for (c, &i) in c.iter_mut().zip(indices) {
                *c = f64::from(i);
            }
            *cell = S::load(&c);
        }
        let ends = [S::load(&run.t0), S::load(&run.t1)];
        let at = [local(&self.walk, cell, ends[0]), local(&self.walk, cell, ends[1])];
        let mut p = [S::splat(0.0); MOST];
        self.form.composed(&run.cell, at, shared.reference, n, &mut p);
        let p = &p[..F::COUNT];
        let (mut least, mut most, mut sum) = (p[0], p[0], p[0]);
        for &x in &p[1..] {
            (least, most, sum) = (x.min(least), x.max(most), sum.add(x));
        }
        // What is not a number goes the way of single cells.
        let mut plain = S::splat(f64::INFINITY).above(sum.abs());
        let mut greater = [0; TOLD];
        if shared.values.len() > TOLD {
            plain = 0;
        }
        let bound = S::splat(self.bound);
        for (greater, &value) in greater.iter_mut().zip(shared.values) {
            let v = S::splat(value - shared.reference);
            *greater = least.sub(v).above(bound);
            plain &= *greater | S::splat(-self.bound).above(most.sub(v));
        }
        let mut out = Eight {
            p: [[0.0; LANES]; MOST],
            plain,
            greater,
            medium: 0,
            chord: 0,
            chords: Chords {
                joined: 0,
                end: [0.0; LANES],
                sums: [Sums::default(); LANES],
                layer: [[0.0; 4]; LANES],
            },
        };
        for (p, out) in p.iter().zip(&mut out.p) {
            p.store(out);
        }
        if let Some(medium) = shared.medium
            && self.sink.is_clear()
        {
            out.medium = self.seen(medium, least, most) & u8::MAX >> (LANES - n);
            // A crossing, or no medium at all, needs no chord.
            out.chord = out.plain & out.medium & self.single(medium, p);
            if out.chord != 0 {
                let length = ends[1].sub(ends[0]).mul(S::splat(self.length));
                self.one_chord(medium, n, [p[0], p[F::COUNT - 1]], length, &mut out);
            }
        }
        out
    }

    /// Where a cell's range meets values with extinction.
    #[inline(always)]
    fn seen(&self, medium: &Medium, least: S, most: S) -> u8 {
        let reference = S::splat(self.shared.reference);
        let (lo, hi) = (least.add(reference), most.add(reference));
        let mut m = 0;
        for (a, b) in medium.support().iter() {
            m |= !(S::splat(a).above(hi) | lo.above(S::splat(b)));
        }
        m
    }

    /// Where one chord is within what is allowed, without a look at the features: [`Way::bend`].
    #[inline(always)]
    fn single(&self, medium: &Medium, p: &[S]) -> u8 {
        let n = F::COUNT - 1;
        let zero = S::splat(0.0);
        let mut before = p[1].sub(p[0]);
        let mut flattest = before.abs();
        let (mut bend, mut falls, mut rises) = (zero, zero.above(before), before.above(zero));
        for i in 1..n {
            let d = p[i + 1].sub(p[i]);
            bend = d.sub(before).abs().max(bend);
            flattest = d.abs().min(flattest);
            falls |= zero.above(d);
            rises |= d.above(zero);
            before = d;
        }
        let tolerance = self.shared.tolerance;
        let squared = S::splat(0.125 * (n * (n - 1)) as f64).mul(bend);
        let mut m = !squared.above(S::splat(tolerance));
        if medium.narrowest() < super::FINE * tolerance {
            // Where the slope changes too much for one chord through a narrow feature.
            m &= !(falls & rises) & !S::splat(super::TURN * (n - 1) as f64).mul(bend).above(flattest);
        }
        m
    }

    /// One chord in each cell: [`Medium::layer`]. Takes those lanes out of `chord` that need more care: flat ones and thick ones.
    #[inline(always)]
    fn one_chord(&self, medium: &Medium, n: usize, [first, last]: [S; 2], length: S, out: &mut Eight) {
        let reference = S::splat(self.shared.reference);
        let c = &mut out.chords;
        last.add(reference).store(&mut c.end);
        let mut start = [0.0; LANES];
        first.add(reference).store(&mut start);
        let (mut from, mut to) = ([Sums::default(); LANES], [0.0; LANES]);
        for l in 0..n {
            // Its own chord, or that of the next, which begins with what is at the end of this one.
            if out.medium >> l & 1 == 0 || out.chord >> l & 3 == 0 {
                continue;
            }
            let (t, end, sums) = if l == 0 {
                (self.tail.t, self.tail.value, self.tail.sums)
            } else if out.medium >> (l - 1) & 1 != 0 {
                (self.run.t1[l - 1], c.end[l - 1], c.sums[l - 1])
            } else {
                (f64::NEG_INFINITY, 0.0, Sums::default())
            };
            c.sums[l] = medium.sums(c.end[l]);
            if out.chord >> l & 1 == 0 {
                continue;
            }
            from[l] = if t == self.run.t0[l] {
                c.joined |= 1 << l;
                start[l] = end;
                sums
            } else {
                medium.sums(start[l])
            };
            to[l] = c.sums[l].depth - from[l].depth;
        }
        let (a, b) = (S::load(&start), S::load(&c.end));
        let rise = b.sub(a);
        let curved = rise.abs().above(medium.flat(a, b));
        let per = length.div(rise);
        let depth = per.mul(S::load(&to));
        let thin = S::splat(0.5).above(depth.abs()) & !depth.above(S::splat(self.shared.thick));
        out.chord &= curved & thin;
        let k = per.div(thinned(depth));
        let mut factor = [0.0; LANES];
        k.store(&mut factor);
        for l in 0..n {
            if out.chord >> l & 1 == 0 {
                continue;
            }
            let ([d0, r0, g0, b0], [d1, r1, g1, b1]) = (from[l].lanes(), c.sums[l].lanes());
            let (from, to) = ([r0, g0, b0, d0], [r1, g1, b1, d1]);
            for i in 0..4 {
                c.layer[l][i] = (to[i] - from[i]) * factor[l];
            }
        }
    }
}

/// depth / (1 - exp(-depth)) of eight depths below 1/2: as `medium::thinned`.
#[inline(always)]
fn thinned<S: Lanes>(depth: S) -> S {
    let s = depth.mul(depth);
    let inner = S::splat(1.0 / 30_240.0).sub(s.mul(S::splat(1.0 / 1_209_600.0)));
    let inner = S::splat(1.0 / 12.0).sub(s.mul(S::splat(1.0 / 720.0).sub(s.mul(inner))));
    S::splat(1.0).add(S::splat(0.5).mul(depth)).add(s.mul(inner))
}

impl Run {
    /// Nothing yet.
    pub(super) const fn new() -> Self {
        Self {
            cell: [[0; LANES]; 3],
            t0: [0.0; LANES],
            t1: [0.0; LANES],
            count: 0,
        }
    }

    #[inline(always)]
    pub(super) fn push(&mut self, cell: [i32; 3], t0: f64, t1: f64) {
        for (all, i) in self.cell.iter_mut().zip(cell) {
            all[self.count] = i;
        }
        (self.t0[self.count], self.t1[self.count]) = (t0, t1);
        self.count += 1;
    }
}
