//! The medium by tables, eight pixels at a time in f32: what [`crate::volume`] does in f64 for integration of each stay by itself, for clipping planes and for orders that have to be checked.
//!
//! A block's cells come in batches: corners gathered, set up eight at a time ([`crate::setup`]), then drawn one after the other, a run of eight pixels of a row at once: keys of entry and
//! exit. The stays found go into a queue, moved together, and from there eight at a time to lengths, values and nodes of the table; texels are fetched stay by stay, two at a load. A queue, because a
//! run holds some four stays: lanes are full, and no branch depends on how many there are. Surface hits cut stays as in [`crate::volume`].
//!
//! **Error.** Keys and values are off by some 1e-7 of the mesh's extent in depth and of the range, lengths by as much: below the tables' own error (`colour_tests.rs` holds both ways against each other).

use crate::blocks::{AREA, Block, Entry, SIDE};
use crate::lanes::{Eight, LANES, Plain, WithEight, prefetch};
use crate::setup::{BATCH, Corners, Flat, SetUp, Units, gather};
use crate::tables::Table;
use crate::volume::{Crossings, OPAQUE, Scene, VolumeWork};
use glam::Vec4;
use isobar_cpu::{Level, packet};

/// Lanes as steps.
const STEPS: [f32; LANES] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];
/// Columns beyond every block.
const BEYOND: f32 = 2.0 * SIDE as f32;

/// One block to draw.
pub(crate) struct DrawBlock<'a, T> {
    pub(crate) scene: &'a Scene<'a, T>,
    pub(crate) units: &'a Units,
    pub(crate) level: Level,
    pub(crate) block: Block,
    pub(crate) crossings: &'a Crossings,
}

impl<T: Table> WithEight for DrawBlock<'_, T> {
    type Output = (Vec<[f32; 4]>, VolumeWork);

    #[inline(always)]
    fn run<F: Eight>(self) -> Self::Output {
        let mut canvas = Canvas::new(&self);
        let mut corners: Box<Corners> = Box::new([[[0.0; LANES]; 16]; BATCH / LANES]);
        let mut flats = Box::new([Flat::default(); BATCH]);
        let mut group = None;
        let mut entries = Ahead::new(self.scene.bins.lists(self.block.number).flatten(), &self);
        loop {
            let batch = entries.next(&self);
            for (i, entry) in batch.iter().enumerate() {
                let cell = &self.scene.mesh.cells[entry.cell as usize];
                gather(&mut corners, i, &self.scene.screen.points, cell);
            }
            let set_up = SetUp {
                units: self.units,
                corner: canvas.corner,
                corners: &corners,
                entries: batch,
                out: &mut flats,
            };
            packet::run(self.level, set_up);
            for flat in &flats[..batch.len()] {
                let kept = if self.scene.groups.is_empty() {
                    None
                } else {
                    canvas.flush::<F, T>(&self, true);
                    canvas.grouped(&self, flat.entry.cell, &mut group)
                };
                canvas.cell::<F, T>(&self, flat, kept);
            }
            // The last ones first: of an image with holes they tell soonest that it is not opaque.
            if batch.len() < BATCH || canvas.colour.iter().rev().skip(LANES).all(|c| c.w <= OPAQUE) {
                break;
            }
        }
        canvas.flush::<F, T>(&self, true);
        if let Some((_, stays)) = group {
            canvas.sorted(&self, stays);
        }
        canvas.finish(&self)
    }
}

/// A block's cells in batches. Of those two batches on the cells are asked for, of the next one their corners.
struct Ahead<I> {
    entries: I,
    /// The batch given last, the next and the one after it, in turn; with how many there are.
    batches: [([Entry; BATCH], usize); 3],
    given: usize,
}

impl<'a, I: Iterator<Item = &'a Entry>> Ahead<I> {
    fn new<T>(entries: I, job: &DrawBlock<'_, T>) -> Self {
        let mut out = Self {
            entries,
            batches: [([Entry::default(); BATCH], 0); 3],
            given: 2,
        };
        out.fill(0, job);
        out.fill(1, job);
        out
    }

    fn fill<T>(&mut self, i: usize, job: &DrawBlock<'_, T>) {
        let (batch, n) = &mut self.batches[i];
        *n = 0;
        for (to, &entry) in batch.iter_mut().zip(&mut self.entries) {
            *to = entry;
            prefetch(&job.scene.mesh.cells, entry.cell);
            *n += 1;
        }
    }

    /// The next batch; shorter than [`BATCH`] at the end.
    fn next<T>(&mut self, job: &DrawBlock<'_, T>) -> &[Entry] {
        self.fill(self.given, job);
        self.given = (self.given + 1) % 3;
        let (next, n) = &self.batches[(self.given + 1) % 3];
        for entry in &next[..*n] {
            for &corner in &job.scene.mesh.cells[entry.cell as usize] {
                prefetch(&job.scene.screen.points, corner);
            }
        }
        let (batch, n) = &self.batches[self.given];
        &batch[..*n]
    }
}

/// A ray's stay in a cell.
#[derive(Debug, Clone, Copy)]
struct Stay {
    pixel: u16,
    /// Keys of entry and exit.
    entry: f32,
    exit: f32,
    /// The value at key 0 and its rise, and the range of the cell's.
    start: f32,
    rise: f32,
    least: f32,
    most: f32,
}

/// A cycle's number and its stays.
type Group = Option<(u32, Vec<Stay>)>;

/// The columns between which a row may meet a cell: lanes 0 to 3 the first, 4 to 7 minus the last, as affine functions of the row.
struct Spans<F> {
    slope: F,
    constant: F,
}

impl<F: Eight> Spans<F> {
    /// Inside, the key of each of the `E` entries is above that of each exit.
    #[inline(always)]
    fn new<const E: usize>(a: F, b: F, c: F) -> Self {
        let (entries, exits): ([u32; LANES], [u32; LANES]) = match E {
            1 => ([0; LANES], [1, 2, 3, 3, 1, 2, 3, 3]),
            2 => ([0, 0, 1, 1, 0, 0, 1, 1], [2, 3, 2, 3, 2, 3, 2, 3]),
            _ => ([0, 1, 2, 2, 0, 1, 2, 2], [3; LANES]),
        };
        const SIGNS: [f32; LANES] = [1.0, 1.0, 1.0, 1.0, -1.0, -1.0, -1.0, -1.0];
        let side = F::splat(SIDE as f32);
        let sizes = a.abs().add(b.abs()).mul(side).add(c.abs());
        let size = sizes.pick(&entries).add(sizes.pick(&exits));
        let da = a.pick(&entries).sub(a.pick(&exits));
        let db = b.pick(&entries).sub(b.pick(&exits));
        let dc = c.pick(&entries).sub(c.pick(&exits));
        let (zero, signs) = (F::splat(0.0), F::load(&SIGNS));
        let one = signs.div(da);
        // Above the rounding of keys and of all that follows.
        let margin = F::splat(1e-3).add(size.mul(F::splat(1e-6)).mul(one.abs()));
        let limits = da.mul(signs);
        Self {
            slope: limits.positive_or(zero.sub(db.mul(one)), zero),
            constant: limits.positive_or(zero.sub(dc.mul(one)).sub(margin), F::splat(-BEYOND)),
        }
    }

    /// First and last column of a row.
    #[inline(always)]
    fn columns(&self, y: F) -> (i32, i32) {
        // Undefined where nothing limits: then NaN is every column.
        let v = self
            .slope
            .mul(y)
            .add(self.constant)
            .max(F::splat(-BEYOND))
            .min(F::splat(BEYOND));
        let [first, minus_last] = v.ceilings();
        (first, -minus_last)
    }
}

/// What a cell's rows have in common.
struct Cell<'a, F> {
    flat: &'a Flat,
    /// Per column: keys and S.
    a: [F; 5],
    eye: F,
    least: F,
    most: F,
}

/// A run of pixels in a cell.
struct Run<F> {
    entry: F,
    exit: F,
    /// S and its rise.
    start: F,
    rise: F,
}

/// Stays waiting.
const QUEUE: usize = 128;

/// Stays found and not blended yet, front to back in each pixel.
struct Queue {
    /// Pixel, width, keys of entry and exit, S and its rise, least and most; lanes may reach beyond the last.
    rows: [[f32; QUEUE + LANES]; 8],
    n: usize,
}

/// Eight entries of a row from `at`, which is at most [`QUEUE`].
#[inline(always)]
fn part(row: &mut [f32; QUEUE + LANES], at: usize) -> &mut [f32; LANES] {
    (&mut row[at..at + LANES]).try_into().expect("as many as lanes")
}

/// The pixels of a block; lanes may reach beyond the last one.
struct Canvas {
    /// Premultiplied colour and transmittance.
    colour: Box<[Vec4; AREA + LANES]>,
    /// Length per difference of keys (in perspective at key 0), in the table's unit.
    stretch: Box<[f32; AREA + LANES]>,
    /// Key of the next hit of each pixel, and which it is.
    next: Box<[f32; AREA + LANES]>,
    place: Vec<u32>,
    /// Key of where rays start.
    start: f32,
    behind: f32,
    queue: Box<Queue>,
    /// Centred coordinates of the first pixel.
    corner: [f64; 2],
    work: VolumeWork,
}

impl Canvas {
    fn new<T: Table>(job: &DrawBlock<'_, T>) -> Self {
        let p = &job.scene.screen.projection;
        let first = p.first_pixel();
        let corner = [first[0] + job.block.x as f64, first[1] + job.block.y as f64];
        let length = job.units.unit * job.scene.integrator.per_length();
        let stretch = |i: usize| {
            if !p.perspective {
                return length as f32;
            }
            let (x, y) = (corner[0] + (i % SIDE) as f64, corner[1] + (i / SIDE) as f64);
            (length * (p.rows[2] + p.steps[0] * x + p.steps[1] * y).length()) as f32
        };
        let c = job.crossings;
        let next = |i: usize| {
            let here = if i < AREA { c.starts[i]..c.starts[i + 1] } else { 0..0 };
            let all = &c.all[here.start as usize..here.end as usize];
            all.first().map_or(f32::NEG_INFINITY, |c| job.units.key(c.depth))
        };
        Self {
            colour: Box::new([Vec4::W; AREA + LANES]),
            stretch: Box::new(std::array::from_fn(stretch)),
            next: Box::new(std::array::from_fn(next)),
            place: c.starts[..AREA].to_vec(),
            start: job.units.start(),
            behind: job.units.behind(),
            queue: Box::new(Queue {
                rows: [[0.0; QUEUE + LANES]; 8],
                n: 0,
            }),
            corner,
            work: VolumeWork::default(),
        }
    }

    /// Blends the stays in a cell, or keeps them.
    #[inline(always)]
    fn cell<F: Eight, T: Table>(&mut self, job: &DrawBlock<'_, T>, flat: &Flat, kept: Option<&mut Vec<Stay>>) {
        self.work.cells += 1;
        // How many faces rays enter by is known to the compiler: a cell's loops are unrolled.
        match (job.units.perspective, flat.entries) {
            (true, 0) => self.rows::<F, T, true, 0>(job, flat, kept),
            (true, 1) => self.rows::<F, T, true, 1>(job, flat, kept),
            (true, 2) => self.rows::<F, T, true, 2>(job, flat, kept),
            (true, 3) => self.rows::<F, T, true, 3>(job, flat, kept),
            (false, 1) => self.rows::<F, T, false, 1>(job, flat, kept),
            (false, 2) => self.rows::<F, T, false, 2>(job, flat, kept),
            (false, 3) => self.rows::<F, T, false, 3>(job, flat, kept),
            // Left by no face, or entered by none from outside.
            _ => {}
        }
    }

    #[inline(always)]
    fn rows<F: Eight, T: Table, const P: bool, const E: usize>(
        &mut self,
        job: &DrawBlock<'_, T>,
        flat: &Flat,
        mut kept: Option<&mut Vec<Stay>>,
    ) {
        let (a, b, c) = (F::load(&flat.a), F::load(&flat.b), F::load(&flat.c));
        let spans = Spans::new::<E>(a, b, c);
        let cell = Cell {
            flat,
            a: [
                F::splat(flat.a[0]),
                F::splat(flat.a[1]),
                F::splat(flat.a[2]),
                F::splat(flat.a[3]),
                F::splat(flat.a[4]),
            ],
            eye: F::splat(flat.eye),
            least: F::splat(flat.least),
            most: F::splat(flat.most),
        };
        let [x0, x1] = flat.entry.x.map(i32::from);
        for y in usize::from(flat.entry.y[0])..=usize::from(flat.entry.y[1]) {
            // A row has SIDE stays at most.
            if self.queue.n > QUEUE - SIDE {
                self.flush::<F, T>(job, false);
            }
            let cy = F::splat(y as f32);
            let (from, to) = if E == 0 { (x0, x1) } else { spans.columns(cy) };
            let (mut x, to) = (from.max(x0), to.min(x1));
            let mut row = [0.0; LANES];
            b.mul(cy).add(c).store(&mut row);
            while x <= to {
                let first = F::splat(x as f32).add(F::load(&STEPS));
                let run = self.run::<F, P, E>(&cell, &row, first);
                let left = (to - x) as u32;
                let covered = run.entry.above(run.exit) & (255 >> (7 - left.min(7)));
                if covered != 0 {
                    let at = y * SIDE + x as usize;
                    match &mut kept {
                        Some(kept) => kept.extend(Stays::new(flat, at, covered, &run).each()),
                        None => self.queue::<F, T>(job, &cell, (at, first), covered, &run),
                    }
                }
                x += LANES as i32;
            }
        }
    }

    /// The stays of the run from centred coordinates `x`.
    #[inline(always)]
    fn run<F: Eight, const P: bool, const E: usize>(&self, cell: &Cell<'_, F>, row: &[f32; LANES], x: F) -> Run<F> {
        let (mut entry, mut exit) = (F::splat(self.start), F::splat(self.behind));
        for (k, (a, &row)) in cell.a.iter().zip(row).enumerate().take(4) {
            let key = a.mul(x).add(F::splat(row));
            if k < E {
                entry = key.min(entry);
            } else {
                exit = key.max(exit);
            }
        }
        let start = cell.a[4].mul(x).add(F::splat(row[4]));
        let rise = if P { cell.eye.sub(start) } else { cell.eye };
        Run {
            entry,
            exit,
            start,
            rise,
        }
    }

    /// Puts a run into the queue, whose first pixel is `at` and whose columns are `x`.
    #[inline(always)]
    fn queue<F: Eight, T: Table>(
        &mut self,
        job: &DrawBlock<'_, T>,
        cell: &Cell<'_, F>,
        (at, x): (usize, F),
        covered: u32,
        run: &Run<F>,
    ) {
        self.work.fragments += u64::from(covered.count_ones());
        let lanes = at..at + LANES;
        let next: &[f32; LANES] = self.next[lanes.clone()].try_into().expect("as many as lanes");
        if F::load(next).above(run.exit) & covered != 0 {
            self.flush::<F, T>(job, true);
            return self.apart(job, &Stays::new(cell.flat, at, covered, run));
        }
        let stretch: &[f32; LANES] = self.stretch[lanes].try_into().expect("as many as lanes");
        let width = run.entry.sub(run.exit).mul(F::load(stretch));
        let pixel = x.add(F::splat((at / SIDE * SIDE) as f32));
        let (n, to) = (self.queue.n % QUEUE, F::together(covered));
        let rows = &mut self.queue.rows;
        pixel.packed(to).store(part(&mut rows[0], n));
        width.packed(to).store(part(&mut rows[1], n));
        run.entry.packed(to).store(part(&mut rows[2], n));
        run.exit.packed(to).store(part(&mut rows[3], n));
        run.start.packed(to).store(part(&mut rows[4], n));
        run.rise.packed(to).store(part(&mut rows[5], n));
        cell.least.store(part(&mut rows[6], n));
        cell.most.store(part(&mut rows[7], n));
        self.queue.n = n + covered.count_ones() as usize;
    }

    /// Blends what is queued: all, or all but the last few that fill no lanes.
    #[inline(always)]
    fn flush<F: Eight, T: Table>(&mut self, job: &DrawBlock<'_, T>, all: bool) {
        let table = job.scene.integrator;
        let n = self.queue.n;
        let full = n / LANES * LANES;
        for at in (0..if all { n } else { full }).step_by(LANES) {
            let rows = &mut self.queue.rows;
            let pixels = F::load(part(&mut rows[0], at)).whole();
            let width = F::load(part(&mut rows[1], at));
            let (entry, exit) = (F::load(part(&mut rows[2], at)), F::load(part(&mut rows[3], at)));
            let (start, rise) = (F::load(part(&mut rows[4], at)), F::load(part(&mut rows[5], at)));
            let (least, most) = (F::load(part(&mut rows[6], at)), F::load(part(&mut rows[7], at)));
            let (front, back, length) = if job.units.perspective {
                let one = F::splat(1.0);
                let (near, far) = (entry.add(one), exit.add(one));
                let inverse = one.div(near.mul(far));
                (entry.mul(far.mul(inverse)), exit.mul(near.mul(inverse)), width.mul(inverse))
            } else {
                (entry, exit, width)
            };
            let front = start.add(front.mul(rise)).max(least).min(most);
            let back = start.add(back.mul(rise)).max(least).min(most);
            let left = LANES.min(n - at);
            let spots = table.spots(front, back, length, 255 >> (LANES - left));
            for (i, pixel) in pixels.into_iter().enumerate().take(left) {
                let pixel = pixel as usize % AREA;
                let c = self.colour[pixel];
                if c.w > OPAQUE {
                    self.colour[pixel] = c + T::texel::<F>(&spots, i) * c.w;
                }
            }
        }
        if all {
            self.queue.n = 0;
            return;
        }
        for row in &mut self.queue.rows {
            let rest = F::load(part(row, full));
            rest.store(part(row, 0));
        }
        self.queue.n = n - full;
    }

    /// The same where surfaces cut the stays.
    #[cold]
    #[inline(never)]
    fn apart<T: Table>(&mut self, job: &DrawBlock<'_, T>, stays: &Stays) {
        for stay in stays.each() {
            self.mix(job, &stay);
        }
    }

    /// The length between two keys, in the table's unit.
    fn length(&self, perspective: bool, pixel: usize, from: f32, to: f32) -> f32 {
        let length = (from - to) * self.stretch[pixel];
        if perspective {
            length / ((1.0 + from) * (1.0 + to))
        } else {
            length
        }
    }

    #[inline(always)]
    fn add(&mut self, i: usize, texel: Vec4) {
        let c = self.colour[i];
        self.colour[i] = c + texel * c.w;
    }

    /// A stay, cut by the hits inside.
    fn mix<T: Table>(&mut self, job: &DrawBlock<'_, T>, stay: &Stay) {
        let (perspective, i) = (job.units.perspective, usize::from(stay.pixel));
        let value = |key: f32| {
            let e = if perspective { key / (1.0 + key) } else { key };
            (stay.start + e * stay.rise).max(stay.least).min(stay.most)
        };
        let mut from = stay.entry;
        let mut stretch = |canvas: &mut Self, to: f32| {
            if to < from && canvas.colour[i].w > OPAQUE {
                let length = canvas.length(perspective, i, from, to);
                canvas.add(i, job.scene.integrator.one::<Plain>(value(from), value(to), length));
                from = to;
            }
        };
        while self.next[i] > stay.exit {
            let hit = self.next[i];
            stretch(self, hit);
            self.surface(job, i);
        }
        stretch(self, stay.exit);
    }

    /// Blends the next hit of a pixel.
    fn surface<T>(&mut self, job: &DrawBlock<'_, T>, i: usize) {
        let at = self.place[i] as usize;
        self.add(i, job.crossings.all[at].colour);
        self.place[i] += 1;
        let left = at + 1 < job.crossings.starts[i + 1] as usize;
        // Behind an opaque surface nothing is cut any more.
        self.next[i] = if left && self.colour[i].w > OPAQUE {
            job.units.key(job.crossings.all[at + 1].depth)
        } else {
            f32::NEG_INFINITY
        };
    }

    /// Where the stays of a cell in a cycle are kept until all of them are there; `None` for other cells.
    #[cold]
    #[inline(never)]
    fn grouped<'g, T: Table>(&mut self, job: &DrawBlock<'_, T>, cell: u32, group: &'g mut Group) -> Option<&'g mut Vec<Stay>> {
        let here = job.scene.groups.get(&cell).copied();
        if let Some((_, stays)) = group.take_if(|g| here != Some(g.0)) {
            self.sorted(job, stays);
        }
        let here = here?;
        Some(&mut group.get_or_insert_with(|| (here, Vec::new())).1)
    }

    /// Cells that hide each other in a cycle: each pixel's stays in their own order.
    fn sorted<T: Table>(&mut self, job: &DrawBlock<'_, T>, mut stays: Vec<Stay>) {
        let key = |s: &Stay| (s.pixel, s.entry, s.exit);
        stays.sort_by(|a, b| {
            let ((i, a0, a1), (j, b0, b1)) = (key(a), key(b));
            i.cmp(&j).then(b0.total_cmp(&a0)).then(b1.total_cmp(&a1))
        });
        self.work.sorted += stays.len() as u64;
        self.work.fragments += stays.len() as u64;
        for stay in &stays {
            self.mix(job, stay);
        }
    }

    /// The surfaces behind all cells, and the image: premultiplied colour and opacity.
    fn finish<T>(mut self, job: &DrawBlock<'_, T>) -> (Vec<[f32; 4]>, VolumeWork) {
        for i in 0..AREA {
            while self.next[i] > f32::NEG_INFINITY {
                self.surface(job, i);
            }
        }
        let opacity = |c: &Vec4| [c.x, c.y, c.z, 1.0 - c.w];
        (self.colour[..AREA].iter().map(opacity).collect(), self.work)
    }
}

/// The stays of a run, lane by lane.
struct Stays {
    /// The first pixel.
    at: usize,
    covered: u32,
    /// Key of entry and exit, S and its rise.
    lanes: [[f32; LANES]; 4],
    least: f32,
    most: f32,
}

impl Stays {
    #[inline(always)]
    fn new<F: Eight>(flat: &Flat, at: usize, covered: u32, run: &Run<F>) -> Self {
        let mut lanes = [[0.0; LANES]; 4];
        run.entry.store(&mut lanes[0]);
        run.exit.store(&mut lanes[1]);
        run.start.store(&mut lanes[2]);
        run.rise.store(&mut lanes[3]);
        Self {
            at,
            covered,
            lanes,
            least: flat.least,
            most: flat.most,
        }
    }

    fn each(&self) -> impl Iterator<Item = Stay> + '_ {
        let covered = (0..LANES).filter(|i| self.covered >> i & 1 != 0);
        covered.map(|i| Stay {
            pixel: (self.at + i) as u16,
            entry: self.lanes[0][i],
            exit: self.lanes[1][i],
            start: self.lanes[2][i],
            rise: self.lanes[3][i],
            least: self.least,
            most: self.most,
        })
    }
}
