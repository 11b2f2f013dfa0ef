//! The medium by tables, eight pixels at a time in f32: what [`crate::volume`] does in f64 for integration of each stay by itself, for clipping planes and for orders that have to be checked.
//!
//! A block's cells come in batches: corners gathered, set up eight at a time ([`crate::setup`]), then drawn one after the other. A cell's pixels are listed first, row by row between the columns that its edges
//! leave, eight rows at once; then eight of the list at a time, whatever their rows, to keys of entry and exit, lengths, values and nodes of the table. What they give goes into a queue, and from there stay by stay to
//! the texels, two at a load. So lanes are full but for the last of a cell, and no branch depends on how many there are. Surface hits cut stays as in [`crate::volume`].
//!
//! **Error.** Keys count from a depth in the middle of the cell, so that they and the values are off by some 1e-7 of the cell's own extent, however small it is in the mesh: below the tables' own error
//! (`colour_tests.rs` and `hostile_tests.rs` hold both ways against each other).

use crate::blocks::{AREA, Block, Entry, SIDE};
use crate::lanes::{Eight, LANES, Plain, WithEight, prefetch};
use crate::setup::{BATCH, Corners, Flat, SetUp, Units, gather};
use crate::spans::{Cell, Run, STEPS, Spans};
use crate::tables::{Spot, Table};
use crate::volume::{Crossings, OPAQUE, Scene, VolumeWork};
use glam::Vec4;
use isobar_cpu::{Level, packet};

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
                let mut kept = None;
                if !self.scene.groups.is_empty() {
                    let here = self.scene.groups.get(&flat.entry.cell).copied();
                    if here.is_some() || group.is_some() {
                        canvas.flush::<F, T>(&self);
                        kept = canvas.grouped(&self, here, &mut group);
                    }
                }
                canvas.cell::<F, T>(&self, flat, kept);
            }
            // The last ones first: of an image with holes they tell soonest that it is not opaque.
            if batch.len() < BATCH || canvas.colour.iter().rev().skip(LANES).all(|c| c.w <= OPAQUE) {
                break;
            }
        }
        canvas.flush::<F, T>(&self);
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
    /// The cell's base, and the keys of entry and exit above it.
    base: f32,
    entry: f32,
    exit: f32,
    /// The value at the base and its rise, and the range of the cell's.
    start: f32,
    rise: f32,
    least: f32,
    most: f32,
}

/// A cycle's number and its stays.
type Group = Option<(u32, Vec<Stay>)>;

/// The pixels whose rays may meet a cell, row by row; lanes may reach beyond the last.
struct Pixels {
    /// Column and row, length per difference of keys, and the key of the next hit, this only where there are hits.
    rows: [[f32; AREA + LANES]; 4],
    n: usize,
}

/// Stays waiting at most.
const QUEUE: usize = 256;

/// Stays found and not blended yet, front to back in each pixel; lanes may reach beyond the last.
struct Queue {
    pixel: [u32; QUEUE + LANES],
    /// Where they are looked up.
    first: [u32; QUEUE + LANES],
    shares: [[f32; QUEUE + LANES]; 3],
    /// Whether some opacity may exceed 1.
    dense: bool,
    n: usize,
}

/// Eight entries of a row from `at`, which leaves room for them.
#[inline(always)]
fn part<T>(row: &mut [T], at: usize) -> &mut [T; LANES] {
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
    /// Whether the block has hits.
    hit: bool,
    pixels: Box<Pixels>,
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
            hit: !c.all.is_empty(),
            pixels: Box::new(Pixels {
                rows: [[0.0; AREA + LANES]; 4],
                n: 0,
            }),
            queue: Box::new(Queue {
                pixel: [0; QUEUE + LANES],
                first: [0; QUEUE + LANES],
                shares: [[0.0; QUEUE + LANES]; 3],
                dense: false,
                n: 0,
            }),
            corner,
            work: VolumeWork::default(),
        }
    }

    /// Blends the stays in a cell, or keeps them.
    #[inline(always)]
    fn cell<F: Eight, T: Table>(&mut self, job: &DrawBlock<'_, T>, flat: &Flat, mut kept: Option<&mut Vec<Stay>>) {
        self.work.cells += 1;
        self.find::<F>(flat);
        let (mut at, apart) = (0, kept.is_some());
        while at < self.pixels.n {
            // How many faces rays enter by is known to the compiler: a cell's loops are unrolled.
            let cut = match (job.units.perspective, flat.entries) {
                (true, 0) => self.pass::<F, T, true, 0>(job, flat, &mut at, apart),
                (true, 1) => self.pass::<F, T, true, 1>(job, flat, &mut at, apart),
                (true, 2) => self.pass::<F, T, true, 2>(job, flat, &mut at, apart),
                (true, 3) => self.pass::<F, T, true, 3>(job, flat, &mut at, apart),
                (false, 1) => self.pass::<F, T, false, 1>(job, flat, &mut at, apart),
                (false, 2) => self.pass::<F, T, false, 2>(job, flat, &mut at, apart),
                (false, 3) => self.pass::<F, T, false, 3>(job, flat, &mut at, apart),
                // Left by no face, or entered by none from outside.
                _ => return,
            };
            match (cut, &mut kept) {
                (Some(stays), Some(kept)) => kept.extend(stays.each()),
                (None, _) if at >= self.pixels.n => return,
                (cut, _) => {
                    self.flush::<F, T>(job);
                    if let Some(stays) = cut {
                        self.apart(job, &stays);
                    }
                }
            }
        }
    }

    /// Lists the pixels whose rays may meet a cell.
    #[inline(always)]
    fn find<F: Eight>(&mut self, flat: &Flat) {
        let [y0, y1] = flat.entry.y.map(usize::from);
        let entries = usize::from(flat.entries);
        let spans = Spans::new::<F>(flat, entries);
        let (steps, pixels) = (F::load(&STEPS), &mut *self.pixels);
        let (mut n, mut block) = (0, y0);
        while block <= y1 {
            let (first, count) = if (1..4).contains(&entries) {
                spans.columns::<F>(block, flat.entry.x)
            } else {
                let [from, to] = flat.entry.x.map(u32::from);
                ([from; LANES], [to + 1 - from; LANES])
            };
            for i in 0..LANES.min(y1 + 1 - block) {
                let (y, first, count) = (block + i, first[i], count[i]);
                // Most rows are done at once, so that is tried without asking.
                let mut done = 0;
                loop {
                    let (to, x) = ((n + done).min(AREA), first as usize + done);
                    let from = (y * SIDE + x).min(AREA);
                    F::splat(x as f32).add(steps).store(part(&mut pixels.rows[0], to));
                    F::splat(y as f32).store(part(&mut pixels.rows[1], to));
                    F::load(part(&mut *self.stretch, from)).store(part(&mut pixels.rows[2], to));
                    if self.hit {
                        F::load(part(&mut *self.next, from)).store(part(&mut pixels.rows[3], to));
                    }
                    done += LANES;
                    if done >= count as usize {
                        break;
                    }
                }
                n += count as usize;
            }
            block += LANES;
        }
        pixels.n = n.min(AREA);
    }

    /// Puts the stays of a cell's pixels from `at` on into the queue, until it is full or surfaces cut some, which are given back; so are all where `apart`. Moves `at` to where it stopped.
    #[inline(always)]
    fn pass<F: Eight, T: Table, const P: bool, const E: usize>(
        &mut self,
        job: &DrawBlock<'_, T>,
        flat: &Flat,
        at: &mut usize,
        apart: bool,
    ) -> Option<Stays> {
        let cell = Cell::<F>::new(flat, job.units);
        let (pixels, queue) = (&mut *self.pixels, &mut *self.queue);
        while *at < pixels.n && queue.n <= QUEUE - LANES {
            let here = *at % AREA;
            let left = LANES.min(pixels.n - here);
            let (x, y) = (
                F::load(part(&mut pixels.rows[0], here)),
                F::load(part(&mut pixels.rows[1], here)),
            );
            let run = cell.run::<P, E>(x, y);
            let covered = run.entry.above(run.exit) & (255 >> (LANES - left));
            *at += LANES;
            if covered == 0 {
                continue;
            }
            let pixel = x.add(y.mul(F::splat(SIDE as f32))).whole();
            if self.hit || apart {
                let next = F::load(part(&mut pixels.rows[3], here)).sub(F::splat(flat.base));
                if apart || next.above(run.exit) & covered != 0 {
                    return Some(Stays::new(flat, pixel, covered, &run));
                }
            }
            self.work.fragments += u64::from(covered.count_ones());
            let (front, back, length) = cell.ends::<P>(&run, F::load(part(&mut pixels.rows[2], here)));
            let spots = job.scene.integrator.spots(front, back, length, covered);
            let n = queue.n % QUEUE;
            *part(&mut queue.pixel, n) = pixel;
            *part(&mut queue.first, n) = spots.first;
            for (row, shares) in queue.shares.iter_mut().zip(&spots.shares) {
                *part(row, n) = *shares;
            }
            queue.dense |= spots.dense;
            // Lanes without a stay among them have length 0, which adds nothing.
            queue.n = n + left;
        }
        None
    }

    /// Blends what is queued.
    #[inline(always)]
    fn flush<F: Eight, T: Table>(&mut self, job: &DrawBlock<'_, T>) {
        let (table, queue) = (job.scene.integrator, &mut *self.queue);
        for i in 0..queue.n.min(QUEUE) {
            let pixel = queue.pixel[i] as usize % AREA;
            let c = self.colour[pixel];
            if c.w > OPAQUE {
                let spot = Spot {
                    first: queue.first[i],
                    shares: [queue.shares[0][i], queue.shares[1][i], queue.shares[2][i]],
                    dense: queue.dense,
                };
                self.colour[pixel] = c + table.texel::<F>(spot) * c.w;
            }
        }
        (queue.n, queue.dense) = (0, false);
    }

    /// The same where surfaces cut the stays.
    #[cold]
    #[inline(never)]
    fn apart<T: Table>(&mut self, job: &DrawBlock<'_, T>, stays: &Stays) {
        self.work.fragments += u64::from(stays.covered.count_ones());
        for stay in stays.each() {
            self.mix(job, &stay);
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
        let near = 1.0 + stay.base;
        let value = |key: f32| {
            let e = if perspective { key / (near + key) } else { key };
            (stay.start + e * stay.rise).max(stay.least).min(stay.most)
        };
        let mut from = stay.entry;
        let mut stretch = |canvas: &mut Self, to: f32| {
            if to < from && canvas.colour[i].w > OPAQUE {
                let length = (from - to) * canvas.stretch[i];
                let length = if perspective {
                    length / ((near + from) * (near + to))
                } else {
                    length
                };
                canvas.add(i, job.scene.integrator.one::<Plain>(value(from), value(to), length));
                from = to;
            }
        };
        while self.next[i] - stay.base > stay.exit {
            let hit = self.next[i] - stay.base;
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

    /// Where the stays of a cell in a cycle are kept until all of them are there; `None` for other cells. Nothing is queued then.
    #[cold]
    #[inline(never)]
    fn grouped<'g, T: Table>(
        &mut self,
        job: &DrawBlock<'_, T>,
        here: Option<u32>,
        group: &'g mut Group,
    ) -> Option<&'g mut Vec<Stay>> {
        if let Some((_, stays)) = group.take_if(|g| here != Some(g.0)) {
            self.sorted(job, stays);
        }
        let here = here?;
        Some(&mut group.get_or_insert_with(|| (here, Vec::new())).1)
    }

    /// Cells that hide each other in a cycle: each pixel's stays in their own order.
    fn sorted<T: Table>(&mut self, job: &DrawBlock<'_, T>, mut stays: Vec<Stay>) {
        let key = |s: &Stay, key: f32| f64::from(s.base) + f64::from(key);
        stays.sort_by(|a, b| {
            let (entries, exits) = ((key(a, a.entry), key(b, b.entry)), (key(a, a.exit), key(b, b.exit)));
            let order = a.pixel.cmp(&b.pixel);
            order.then(entries.1.total_cmp(&entries.0)).then(exits.1.total_cmp(&exits.0))
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

/// The stays of eight pixels, lane by lane.
struct Stays {
    pixel: [u32; LANES],
    covered: u32,
    /// Key of entry and exit, S and its rise.
    lanes: [[f32; LANES]; 4],
    base: f32,
    least: f32,
    most: f32,
}

impl Stays {
    #[inline(always)]
    fn new<F: Eight>(flat: &Flat, pixel: [u32; LANES], covered: u32, run: &Run<F>) -> Self {
        let mut lanes = [[0.0; LANES]; 4];
        run.entry.store(&mut lanes[0]);
        run.exit.store(&mut lanes[1]);
        run.start.store(&mut lanes[2]);
        run.rise.store(&mut lanes[3]);
        Self {
            pixel,
            covered,
            lanes,
            base: flat.base,
            least: flat.least,
            most: flat.most,
        }
    }

    fn each(&self) -> impl Iterator<Item = Stay> + '_ {
        let covered = (0..LANES).filter(|i| self.covered >> i & 1 != 0);
        covered.map(|i| Stay {
            pixel: self.pixel[i] as u16,
            base: self.base,
            entry: self.lanes[0][i],
            exit: self.lanes[1][i],
            start: self.lanes[2][i],
            rise: self.lanes[3][i],
            least: self.least,
            most: self.most,
        })
    }
}
