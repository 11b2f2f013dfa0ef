//! The medium: cells of a block front to back, each pixel's stays blended over each other, with the isosurface hits of the pixel where they lie.
//!
//! **Mixing** (section 10): the paper cuts the integration at isovalues, in a table per set of isovalues. Here the hits are known exactly, so each fragment is cut at
//! the hits inside its stay: in front of it the medium, then the surface, then the rest. The cost does not depend on the number of isovalues, surfaces may be
//! semi-transparent, and every hit is blended once.

use crate::blocks::{AREA, Block, CellBins, SIDE};
use crate::cells::{CellOnScreen, Screen};
use crate::lanes::LANES;
use crate::mesh::Cells;
use crate::order::Order;
use crate::tables::Integrator;
use glam::Vec4;
use isobar_cpu::Kernel;
use std::collections::HashMap;

/// Lanes as steps, and as bits.
const STEPS: [f64; LANES] = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0];
const BITS: [u64; LANES] = [1, 2, 4, 8, 16, 32, 64, 128];
/// Transmittance below which what is behind cannot be seen: a tenth of a part in 2^16.
pub(crate) const OPAQUE: f32 = 1.5e-6;

/// A surface hit on a pixel, front to back.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Crossing {
    /// Depth along the line of sight.
    pub(crate) depth: f64,
    /// Premultiplied colour and minus the opacity.
    pub(crate) colour: Vec4,
}

/// Hits of a block's pixels.
#[derive(Debug)]
pub(crate) struct Crossings {
    /// Where each pixel's begin, and the end.
    pub(crate) starts: Vec<u32>,
    pub(crate) all: Vec<Crossing>,
    /// Greatest and least key that clipping planes keep, by pixel; empty without planes. Lanes may reach beyond the last pixel.
    pub(crate) kept: Vec<[f64; 2]>,
}

/// Work of a block.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct VolumeWork {
    /// Cells set up, once per block.
    pub(crate) cells: u64,
    /// Stays of rays in cells.
    pub(crate) fragments: u64,
    /// Fragments that begin in front of the end of what was blended before: out of order.
    pub(crate) disordered: u64,
    /// Pixels with such fragments.
    pub(crate) disordered_pixels: u64,
    /// Fragments sorted per pixel, of cells in cycles.
    pub(crate) sorted: u64,
}

/// Everything of a view that blocks share.
#[derive(Debug)]
pub(crate) struct Scene<'a, I> {
    pub(crate) mesh: &'a Cells,
    pub(crate) screen: &'a Screen,
    pub(crate) bins: &'a CellBins,
    /// The group of each cell in a cycle.
    pub(crate) groups: &'a HashMap<u32, u32>,
    pub(crate) integrator: &'a I,
}

/// The group of each cell in a cycle.
pub(crate) fn groups(order: &Order) -> HashMap<u32, u32> {
    let places = order.groups.iter().enumerate();
    places
        .flat_map(|(g, range)| {
            order.cells[range.start as usize..range.end as usize]
                .iter()
                .map(move |&c| (c, g as u32))
        })
        .collect()
}

/// One block to draw.
pub(crate) struct DrawBlock<'a, I> {
    pub(crate) scene: &'a Scene<'a, I>,
    pub(crate) block: Block,
    pub(crate) crossings: &'a Crossings,
}

impl<I: Integrator> Kernel for DrawBlock<'_, I> {
    type Output = (Vec<[f32; 4]>, VolumeWork);

    #[inline(always)]
    fn run(self) -> Self::Output {
        let mut canvas = Canvas::new(&self);
        let mut group: Option<(u32, Vec<u32>)> = None;
        for (n, cell) in self.scene.bins.of(self.block).enumerate() {
            let here = if self.scene.groups.is_empty() {
                None
            } else {
                self.scene.groups.get(&cell).copied()
            };
            if let Some((g, cells)) = &mut group {
                if here == Some(*g) {
                    cells.push(cell);
                    continue;
                }
                canvas.draw_sorted(&self, cells);
                group = None;
            }
            match here {
                Some(g) => group = Some((g, vec![cell])),
                None => canvas.draw(&self, cell, None),
            }
            if n % 512 == 511 && canvas.colour.iter().all(|c| c.w <= OPAQUE) {
                break;
            }
        }
        if let Some((_, cells)) = group {
            canvas.draw_sorted(&self, &cells);
        }
        canvas.finish(&self)
    }
}

/// A ray's stay in a cell with what it needs to be blended.
#[derive(Debug, Clone, Copy)]
struct Fragment {
    pixel: u16,
    /// Depths.
    from: f64,
    to: f64,
    /// Values there.
    front: f64,
    back: f64,
}

/// What a row of pixels has in common: the part of each affine function that does not depend on the column.
struct Row {
    keys: [f64; 4],
    start: f64,
    rise: f64,
}

impl Row {
    #[inline(always)]
    fn new(c: &CellOnScreen, y: f64) -> Self {
        Self {
            keys: std::array::from_fn(|k| c.keys[k][1] * y + c.keys[k][2]),
            start: c.start[1] * y + c.start[2],
            rise: c.rise[1] * y + c.rise[2],
        }
    }
}

/// Where neighbouring pixels' rays meet a cell.
struct Hull {
    /// Keys of entry and exit.
    entry: [f64; LANES],
    exit: [f64; LANES],
    /// Above 0 in lanes that meet it, and these as bits.
    width: [f64; LANES],
    covered: u32,
}

impl Hull {
    /// From centred coordinate `first` on; `more` pixels follow the first.
    #[inline(always)]
    fn new(perspective: bool, c: &CellOnScreen, row: &Row, first: f64, more: usize) -> Self {
        let cx = STEPS.map(|i| first + i);
        // In front of the eye, or of the plane rays start on.
        let mut entry = [if perspective { f64::INFINITY } else { 0.0 }; LANES];
        let mut exit = [if perspective { 0.0 } else { f64::NEG_INFINITY }; LANES];
        for (key, row) in c.keys.iter().zip(&row.keys).take(c.entries) {
            for i in 0..LANES {
                let v = key[0] * cx[i] + row;
                entry[i] = if v < entry[i] { v } else { entry[i] };
            }
        }
        for (key, row) in c.keys.iter().zip(&row.keys).skip(c.entries) {
            for i in 0..LANES {
                let v = key[0] * cx[i] + row;
                exit[i] = if v > exit[i] { v } else { exit[i] };
            }
        }
        let more = more as f64;
        let mut width = [0.0; LANES];
        for i in 0..LANES {
            width[i] = if STEPS[i] <= more { entry[i] - exit[i] } else { -1.0 };
        }
        let mut bits = [0u64; LANES];
        for i in 0..LANES {
            bits[i] = if width[i] > 0.0 { BITS[i] } else { 0 };
        }
        let covered = bits.iter().fold(0, |all, bit| all | bit) as u32;
        Self {
            entry,
            exit,
            width,
            covered,
        }
    }

    /// Ends the stays where planes do.
    #[cold]
    #[inline(never)]
    fn cut(&mut self, kept: &[[f64; 2]]) {
        for (i, [near, far]) in kept.iter().enumerate().take(LANES) {
            self.entry[i] = self.entry[i].min(*near);
            self.exit[i] = self.exit[i].max(*far);
            if self.covered >> i & 1 != 0 {
                self.width[i] = self.entry[i] - self.exit[i];
            }
            if self.width[i].is_nan() || self.width[i] <= 0.0 {
                self.covered &= !(1 << i);
            }
        }
    }

    fn lanes(&self) -> impl Iterator<Item = usize> + use<> {
        let covered = self.covered;
        (0..LANES).filter(move |i| covered >> i & 1 != 0)
    }
}

/// The stays of those rays.
struct Run {
    /// Depths of entry and exit, and the values there.
    near: [f64; LANES],
    far: [f64; LANES],
    front: [f64; LANES],
    back: [f64; LANES],
}

impl Run {
    #[inline(always)]
    fn new(perspective: bool, c: &CellOnScreen, row: &Row, first: f64, hull: &Hull) -> Self {
        let (mut near, mut far) = ([0.0; LANES], [0.0; LANES]);
        let (mut front, mut back) = ([0.0; LANES], [0.0; LANES]);
        for i in 0..LANES {
            near[i] = if perspective { 1.0 / hull.entry[i] } else { -hull.entry[i] };
            far[i] = if perspective { 1.0 / hull.exit[i] } else { -hull.exit[i] };
        }
        for i in 0..LANES {
            let x = first + STEPS[i];
            let start = c.start[0] * x + row.start;
            let rise = c.rise[0] * x + row.rise;
            front[i] = start + near[i] * rise;
            back[i] = start + far[i] * rise;
        }
        Self { near, far, front, back }
    }

    /// Lane `i` of a run whose first pixel is `at`.
    fn fragment(&self, at: usize, i: usize) -> Fragment {
        Fragment {
            pixel: (at + i) as u16,
            from: self.near[i],
            to: self.far[i],
            front: self.front[i],
            back: self.back[i],
        }
    }
}

/// The pixels of a block.
struct Canvas {
    /// Premultiplied colour and transmittance.
    colour: Box<[Vec4; AREA]>,
    /// World length per depth; lanes may reach beyond the last pixel.
    stretch: Box<[f64; AREA + LANES]>,
    /// Depth of the next hit of each pixel, and which it is.
    next: Box<[f64; AREA + LANES]>,
    place: Vec<u32>,
    /// Where the last fragment of each pixel began.
    last: Box<[f64; AREA + LANES]>,
    disordered: Box<[bool; AREA]>,
    /// Centred coordinates of the first pixel, and at least those of any.
    corner: [f64; 2],
    reach: [f64; 2],
    work: VolumeWork,
}

impl Canvas {
    #[inline(always)]
    fn new<I>(job: &DrawBlock<'_, I>) -> Self {
        let p = &job.scene.screen.projection;
        let first = p.first_pixel();
        let corner = [first[0] + job.block.x as f64, first[1] + job.block.y as f64];
        let direction = |i: usize| {
            let (x, y) = (corner[0] + (i % SIDE) as f64, corner[1] + (i / SIDE) as f64);
            (p.rows[2] + p.steps[0] * x + p.steps[1] * y).length()
        };
        let starts = &job.crossings.starts;
        let next = |i: usize| {
            if i >= AREA {
                return f64::INFINITY;
            }
            let here = &job.crossings.all[starts[i] as usize..starts[i + 1] as usize];
            here.first().map_or(f64::INFINITY, |c| c.depth)
        };
        Self {
            colour: Box::new([Vec4::W; AREA]),
            stretch: Box::new(std::array::from_fn(|i| if p.perspective { direction(i) } else { 1.0 })),
            next: Box::new(std::array::from_fn(next)),
            place: starts[..AREA].to_vec(),
            last: Box::new([f64::NEG_INFINITY; AREA + LANES]),
            disordered: Box::new([false; AREA]),
            corner,
            reach: [p.width as f64, p.height as f64 + SIDE as f64],
            work: VolumeWork::default(),
        }
    }

    /// Blends the fragments of a cell, or keeps them in `kept`.
    #[inline(always)]
    fn draw<I: Integrator>(&mut self, job: &DrawBlock<'_, I>, cell: u32, mut kept: Option<&mut Vec<Fragment>>) {
        let screen = job.scene.screen;
        let corners = &job.scene.mesh.cells[cell as usize];
        let Some([x0, x1, y0, y1]) = screen.bounds(corners) else {
            return;
        };
        let (bx, by, most) = (job.block.x as i32, job.block.y as i32, SIDE as i32 - 1);
        let (x0, x1) = ((x0 - bx).max(0) as usize, (x1 - bx).min(most) as usize);
        let (y0, y1) = ((y0 - by).max(0) as usize, (y1 - by).min(most) as usize);
        let values = job.scene.mesh.values(cell);
        let perspective = screen.projection.perspective;
        let c = CellOnScreen::new(perspective, &corners.map(|i| screen.points[i as usize].at), &values);
        let spans = c.spans(self.reach);
        self.work.cells += 1;
        for y in y0..=y1 {
            let cy = self.corner[1] + y as f64;
            // Runs begin at the row's first column, wherever that is: cells are narrow.
            let (from, to) = spans.columns(cy, self.corner[0], x0, x1);
            let row = Row::new(&c, cy);
            let mut x = from;
            while x < to.wrapping_add(1) {
                let first = self.corner[0] + x as f64;
                let mut hull = Hull::new(perspective, &c, &row, first, to - x);
                if !job.crossings.kept.is_empty() {
                    hull.cut(&job.crossings.kept[y * SIDE + x..]);
                }
                if hull.covered != 0 {
                    let run = Run::new(perspective, &c, &row, first, &hull);
                    let at = y * SIDE + x;
                    match &mut kept {
                        Some(kept) => kept.extend(hull.lanes().map(|i| run.fragment(at, i))),
                        None => self.blend(job, at, &hull, &run),
                    }
                }
                x += LANES;
            }
        }
    }

    /// Blends a run whose first pixel is `at`.
    #[inline(always)]
    fn blend<I: Integrator>(&mut self, job: &DrawBlock<'_, I>, at: usize, hull: &Hull, run: &Run) {
        let stretch: &[f64; LANES] = self.stretch[at..at + LANES].try_into().expect("as many as lanes");
        let next: &[f64; LANES] = self.next[at..at + LANES].try_into().expect("as many as lanes");
        let last: &mut [f64; LANES] = (&mut self.last[at..at + LANES]).try_into().expect("as many as lanes");
        self.work.fragments += u64::from(hull.covered.count_ones());
        // Below 0: out of order, or cut by a surface. Neighbours agree on the depth of their face to rounding.
        let mut slack = [0.0; LANES];
        for i in 0..LANES {
            let order = run.near[i] - last[i] + 1e-9 * run.near[i].abs();
            let behind = next[i] - run.far[i];
            let least = if order < behind { order } else { behind };
            slack[i] = if hull.width[i] > 0.0 { least } else { 1.0 };
        }
        let least = |a: f64, b: f64| if a < b { a } else { b };
        let pair = |k: usize| least(slack[k], slack[k + 4]);
        if least(least(pair(0), pair(1)), least(pair(2), pair(3))) < 0.0 {
            return self.blend_apart(job, at, hull, run);
        }
        for ((last, near), width) in last.iter_mut().zip(&run.near).zip(&hull.width) {
            *last = if *width > 0.0 { *near } else { *last };
        }
        let mut length = [0.0; LANES];
        for i in 0..LANES {
            length[i] = (run.far[i] - run.near[i]) * stretch[i];
        }
        let places = job.scene.integrator.places(&run.front, &run.back, &length);
        let mut left = hull.covered;
        while left != 0 {
            let i = left.trailing_zeros() as usize;
            left &= left - 1;
            // Lanes that are covered lie in the block.
            let Some(colour) = self.colour.get_mut(at + i) else { return };
            if colour.w > OPAQUE {
                *colour += job.scene.integrator.at(&places, i) * colour.w;
            }
        }
    }

    /// The same where fragments are out of order or cut by surfaces.
    #[cold]
    #[inline(never)]
    fn blend_apart<I: Integrator>(&mut self, job: &DrawBlock<'_, I>, at: usize, hull: &Hull, run: &Run) {
        for i in hull.lanes() {
            self.check(at + i, run.near[i]);
            if self.colour[at + i].w > OPAQUE {
                self.mix(job, run.fragment(at, i));
            }
        }
    }

    /// Counts what is out of order.
    fn check(&mut self, pixel: usize, from: f64) {
        if from - self.last[pixel] + 1e-9 * from.abs() < 0.0 {
            self.work.disordered += 1;
            self.disordered[pixel] = true;
        }
        self.last[pixel] = from;
    }

    #[inline(always)]
    fn add(&mut self, i: usize, texel: Vec4) {
        let c = self.colour[i];
        self.colour[i] = c + texel * c.w;
    }

    /// A fragment with hits in front of its end, if it has some.
    #[cold]
    #[inline(never)]
    fn mix<I: Integrator>(&mut self, job: &DrawBlock<'_, I>, f: Fragment) {
        let i = usize::from(f.pixel);
        let (mut from, mut front) = (f.from, f.front);
        let per = (f.back - f.front) / (f.to - f.from);
        while self.next[i] < f.to {
            let depth = self.next[i].max(from);
            if depth > from {
                let value = f.front + per * (depth - f.from);
                let texel = job.scene.integrator.stretch(front, value, (depth - from) * self.stretch[i]);
                self.add(i, texel);
                (from, front) = (depth, value);
            }
            self.surface(job, i);
        }
        if self.colour[i].w > OPAQUE {
            let texel = job.scene.integrator.stretch(front, f.back, (f.to - from) * self.stretch[i]);
            self.add(i, texel);
        }
    }

    /// Blends the next hit of a pixel.
    fn surface<I>(&mut self, job: &DrawBlock<'_, I>, i: usize) {
        let at = self.place[i] as usize;
        self.add(i, job.crossings.all[at].colour);
        self.place[i] += 1;
        let left = at + 1 < job.crossings.starts[i + 1] as usize;
        self.next[i] = if left {
            job.crossings.all[at + 1].depth
        } else {
            f64::INFINITY
        };
    }

    /// Cells that hide each other in a cycle: each pixel's fragments in their own order.
    #[cold]
    #[inline(never)]
    fn draw_sorted<I: Integrator>(&mut self, job: &DrawBlock<'_, I>, cells: &[u32]) {
        let mut all: Vec<Fragment> = Vec::new();
        for &cell in cells {
            self.draw(job, cell, Some(&mut all));
        }
        all.sort_by(|a, b| {
            a.pixel
                .cmp(&b.pixel)
                .then(a.from.total_cmp(&b.from))
                .then(a.to.total_cmp(&b.to))
        });
        self.work.sorted += all.len() as u64;
        self.work.fragments += all.len() as u64;
        for f in all {
            let pixel = usize::from(f.pixel);
            self.check(pixel, f.from);
            if self.colour[pixel].w > OPAQUE {
                self.mix(job, f);
            }
        }
    }

    /// The surfaces behind all cells, and the image: premultiplied colour and opacity.
    fn finish<I>(mut self, job: &DrawBlock<'_, I>) -> (Vec<[f32; 4]>, VolumeWork) {
        for i in 0..AREA {
            while self.next[i] < f64::INFINITY {
                self.surface(job, i);
            }
        }
        let opacity = |c: &Vec4| [c.x, c.y, c.z, 1.0 - c.w];
        self.work.disordered_pixels = self.disordered.iter().filter(|d| **d).count() as u64;
        (self.colour.iter().map(opacity).collect(), self.work)
    }
}
