//! A cell set up by [`crate::setup`] in lanes: the columns of each row that it may cover, and where rays of eight pixels enter and leave it.

use crate::blocks::SIDE;
use crate::lanes::{Eight, LANES};
use crate::setup::{Flat, Units};

/// Lanes as steps.
pub(crate) const STEPS: [f32; LANES] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];
/// Columns beyond every block.
const BEYOND: f32 = 2.0 * SIDE as f32;

/// For each number of faces that rays enter by: of eight pairs of an entry and an exit the lanes. All pairs are among the first four, and again among the last four.
const PAIRS: [[[u32; LANES]; 2]; 4] = [
    [[0; LANES]; 2],
    [[0; LANES], [1, 2, 3, 3, 1, 2, 3, 3]],
    [[0, 0, 1, 1, 0, 0, 1, 1], [2, 3, 2, 3, 2, 3, 2, 3]],
    [[0, 1, 2, 2, 0, 1, 2, 2], [3; LANES]],
];

/// The columns between which a row may meet a cell, as affine functions of the row: no pixel is before any of the first four nor, with the sign changed, behind any of the last four.
pub(crate) struct Spans {
    slope: [f32; LANES],
    constant: [f32; LANES],
}

impl Spans {
    /// Of a cell with keys `a x + b y + c`: inside, that of each of the `entries` (1 to 3) is above that of each exit.
    #[inline(always)]
    pub(crate) fn new<F: Eight>(flat: &Flat, entries: usize) -> Self {
        const SIGNS: [f32; LANES] = [1.0, 1.0, 1.0, 1.0, -1.0, -1.0, -1.0, -1.0];
        let (a, b, c) = (F::load(&flat.a), F::load(&flat.b), F::load(&flat.c));
        let [entries, exits] = &PAIRS[entries % PAIRS.len()];
        let side = F::splat(SIDE as f32);
        let sizes = a.abs().add(b.abs()).mul(side).add(c.abs());
        let size = sizes.pick(entries).add(sizes.pick(exits));
        let da = a.pick(entries).sub(a.pick(exits));
        let db = b.pick(entries).sub(b.pick(exits));
        let dc = c.pick(entries).sub(c.pick(exits));
        let (zero, signs) = (F::splat(0.0), F::load(&SIGNS));
        let one = signs.div(da);
        // Above the rounding of keys and of all that follows.
        let margin = F::splat(1e-3).add(size.mul(F::splat(1e-6)).mul(one.abs()));
        let limits = da.mul(signs);
        let mut out = Self {
            slope: [0.0; LANES],
            constant: [0.0; LANES],
        };
        limits.positive_or(zero.sub(db.mul(one)), zero).store(&mut out.slope);
        let constant = zero.sub(dc.mul(one)).sub(margin);
        limits.positive_or(constant, F::splat(-BEYOND)).store(&mut out.constant);
        out
    }

    /// First column of eight rows from `y` on, and how many follow it, that one included; of columns `x[0]..=x[1]`.
    #[inline(always)]
    pub(crate) fn columns<F: Eight>(&self, y: usize, x: [u8; 2]) -> ([u32; LANES], [u32; LANES]) {
        let y = F::splat(y as f32).add(F::load(&STEPS));
        let (mut first, mut minus_last) = (F::splat(f32::from(x[0])), F::splat(-f32::from(x[1])));
        for k in 0..LANES / 2 {
            // Undefined where nothing limits: then NaN is every column.
            let at = |k: usize| F::splat(self.slope[k]).mul(y).add(F::splat(self.constant[k]));
            first = at(k).max(first);
            minus_last = at(k + LANES / 2).max(minus_last);
        }
        let (zero, beyond) = (F::splat(0.0), F::splat(BEYOND));
        let (first, minus_last) = (first.min(beyond).ceil(), minus_last.min(beyond).ceil());
        let count = F::splat(1.0).sub(minus_last).sub(first).max(zero);
        (first.min(F::splat((SIDE - 1) as f32)).whole(), count.whole())
    }
}

/// What a cell's pixels have in common.
pub(crate) struct Cell<F> {
    /// Of the keys and S.
    a: [F; 5],
    b: [F; 5],
    c: [F; 5],
    /// The value at the eye or the rise per key, least and most.
    eye: F,
    least: F,
    most: F,
    /// In perspective 1 + the base.
    near: F,
    /// Keys above the base of where rays start, and of what is behind everything.
    start: F,
    behind: F,
}

impl<F: Eight> Cell<F> {
    #[inline(always)]
    pub(crate) fn new(flat: &Flat, units: &Units) -> Self {
        let five = |v: &[f32; LANES]| [F::splat(v[0]), F::splat(v[1]), F::splat(v[2]), F::splat(v[3]), F::splat(v[4])];
        Self {
            a: five(&flat.a),
            b: five(&flat.b),
            c: five(&flat.c),
            eye: F::splat(flat.eye),
            least: F::splat(flat.least),
            most: F::splat(flat.most),
            near: F::splat(1.0 + flat.base),
            start: F::splat(units.start() - flat.base),
            behind: F::splat(units.behind() - flat.base),
        }
    }

    /// The stays of eight pixels; `E` of the faces are entered by.
    #[inline(always)]
    pub(crate) fn run<const P: bool, const E: usize>(&self, x: F, y: F) -> Run<F> {
        let (mut entry, mut exit) = (self.start, self.behind);
        let at = |k: usize| self.a[k].mul(x).add(self.b[k].mul(y).add(self.c[k]));
        for k in 0..4 {
            if k < E {
                entry = at(k).min(entry);
            } else {
                exit = at(k).max(exit);
            }
        }
        let start = at(4);
        let rise = if P { self.eye.sub(start) } else { self.eye };
        Run {
            entry,
            exit,
            start,
            rise,
        }
    }

    /// Values at entry and exit in nodes, and the length in the table's unit, 0 where there is no stay. `stretch` as in [`crate::stays`].
    #[inline(always)]
    pub(crate) fn ends<const P: bool>(&self, run: &Run<F>, stretch: F) -> (F, F, F) {
        let width = run.entry.sub(run.exit);
        let length = width.mul(stretch);
        let (front, back, length) = if P {
            let (near, far) = (self.near.add(run.entry), self.near.add(run.exit));
            let inverse = F::splat(1.0).div(near.mul(far));
            let (front, back) = (run.entry.mul(far.mul(inverse)), run.exit.mul(near.mul(inverse)));
            (front, back, length.mul(inverse))
        } else {
            (run.entry, run.exit, length)
        };
        let value = |e: F| run.start.add(e.mul(run.rise)).max(self.least).min(self.most);
        (value(front), value(back), width.positive_or(length, F::splat(0.0)))
    }
}

/// Rays of neighbouring pixels in a cell.
pub(crate) struct Run<F> {
    pub(crate) entry: F,
    pub(crate) exit: F,
    /// S and its rise.
    pub(crate) start: F,
    pub(crate) rise: F,
}
