//! Table 6.4 and the numbers behind Figures 4.5, 4.6 and 6.7 to 6.9: what levels of detail cost and what they leave out (S24).

use super::{Adaptive, Bank, Criteria, Extent, Multiresolution, Pyramid, Selection};
use glam::DVec3;
use isobar_core::{
    Channels, Data, DataError, Frame, Grid, Knobs, Method, RenderError, Renderer, Request, Samples, Stop, Surface, View,
};
use isobar_cpu::Pool;
use std::sync::Arc;
use std::time::Duration;

/// What is drawn.
#[derive(Clone, Copy)]
pub struct Setting<'a> {
    /// The volume; its samples are the coefficients.
    pub grid: &'a Grid,
    /// The bank.
    pub bank: Bank,
    /// The isovalue, data units.
    pub isovalue: f64,
    /// The view.
    pub view: &'a View,
    /// Draws the coefficients at full resolution; it has the knobs `reconstruction`, with the bank's degree, and `claims`.
    pub method: &'a dyn Method,
    /// Threads of the reconstruction and of the renderer; 0: all.
    pub threads: usize,
    /// The clock of all times: time since some moment, of the wall or of the process's work on all threads.
    pub clock: fn() -> Duration,
}

impl std::fmt::Debug for Setting<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let method = self.method.info().id;
        f.debug_struct("Setting")
            .field("bank", &self.bank)
            .field("isovalue", &self.isovalue)
            .field("method", &method)
            .finish_non_exhaustive()
    }
}

/// A picture with what it is compared by.
#[derive(Debug, Clone)]
pub struct Picture {
    /// The frame: t, normal, surface and colour.
    pub frame: Frame,
    /// The coefficients that are drawn.
    pub grid: Grid,
    /// Time of its `render`.
    pub render: Duration,
}

/// A row of Table 6.4.
#[derive(Debug, Clone)]
pub struct Row {
    /// Threshold of s / c.
    pub epsilon: f64,
    /// Active chunks and those of the coarsest level: the thesis's "chunks".
    pub chunks: usize,
    /// `chunks` by all chunks.
    pub share: f64,
    /// Chunks of the levels with details that a multiresolution renderer needs computed ([`Extent::Drawn`]).
    pub wanted: usize,
    /// Time to select and to compute these from the coarsest level (least of three).
    pub from_nothing: Duration,
    /// Chunks computed when coming from the row before.
    pub computed: usize,
    /// Time to select and to compute these.
    pub update: Duration,
    /// The frame drawn over levels of detail.
    pub levels: OverLevels,
    /// Time of the frame of the row's function at full resolution.
    pub render: Duration,
    /// Mean squared difference of linear red, green and blue in [0, 1] from the full picture, over pixels hit in either.
    pub mse: f64,
    /// Root mean square distance of the first hits along the ray in voxels, over pixels hit in both.
    pub depth: f64,
    /// Pixels hit in one picture only.
    pub one_sided: usize,
    /// Connected parts of the samples above the isovalue, neighbours along axes (Figure 6.9: topology changes at aggressive settings).
    pub parts: usize,
    /// Finest chunks by the finest level whose details act in them ([`Adaptive::level_map`], Figure 4.6).
    pub by_level: Vec<usize>,
    /// [`Adaptive::level_map`].
    pub level_map: (Vec<u8>, [usize; 3]),
}

/// A frame drawn by [`Multiresolution`], which is that of the row's function; times are the least of several, interleaved.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OverLevels {
    /// Time of [`Multiresolution::select`], reconstruction included, and of the criteria, coming from the row before.
    pub select: Duration,
    /// Time of the frame.
    pub render: Duration,
    /// Time of the frame of the volume itself at full resolution.
    pub full: Duration,
    /// Pixels whose hit is farther than 1e-3 voxel from that of the row's picture, or is there in one of them only: at faces of the domain, see
    /// [`Multiresolution`].
    pub differ: usize,
    /// Bytes of the levels' lattices.
    pub bytes: usize,
}

/// Channels of the pictures.
pub(super) const CHANNELS: Channels = Channels::T
    .union(Channels::NORMAL)
    .union(Channels::SURFACE)
    .union(Channels::RGBA);

/// Frames of which the least time counts.
pub(super) const REPEATS: usize = 5;

impl Setting<'_> {
    /// The time `work` takes.
    pub(super) fn timed<R>(&self, work: impl FnOnce() -> R) -> (R, Duration) {
        let start = (self.clock)();
        let out = work();
        (out, (self.clock)().saturating_sub(start))
    }

    /// Draws coefficients.
    ///
    /// # Errors
    /// Those of the method.
    pub fn picture(&self, grid: &Grid) -> Result<Picture, RenderError> {
        let mut renderer = self.renderer(grid)?;
        let mut render = Duration::MAX;
        for _ in 0..3 {
            let (result, time) = self.timed(|| renderer.render(&Stop::default()));
            result?;
            render = render.min(time);
        }
        let mut frame = Frame::default();
        renderer.read(&mut frame)?;
        Ok(Picture {
            frame,
            grid: grid.clone(),
            render,
        })
    }

    /// The method with everything set.
    pub(super) fn renderer(&self, grid: &Grid) -> Result<Box<dyn Renderer>, RenderError> {
        let kind = ["trilinear", "quadratic", "cubic"][self.bank.degree() - 1];
        let request = Request {
            channels: CHANNELS,
            threads: self.threads,
            knobs: Knobs::default().with("reconstruction", kind).with("claims", "off"),
            ..Request::default()
        };
        let mut renderer = self.method.open(&request)?;
        renderer.set_data(&Arc::new(Data::Grid(grid.clone())))?;
        renderer.set_surfaces(&[Surface::isovalue(self.isovalue, 0)])?;
        renderer.set_view(self.view)?;
        Ok(renderer)
    }

    /// The rows for a list of thresholds, seen from `eye`, with their pictures; each row comes from the one before, as frames do. `near_surface`: chunks that
    /// no surface can meet are collapsed too.
    ///
    /// # Errors
    /// Those of the method, of the threads, and of data that are not finite.
    pub fn rows(&self, eye: DVec3, epsilons: &[f64], near_surface: bool) -> Result<Vec<(Row, Picture)>, RenderError> {
        let pool = Pool::new(self.threads)?;
        let pyramid = Arc::new(pool.install(|| Pyramid::new(self.grid, self.bank))?);
        let full = self.picture(self.grid)?;
        let mut whole = self.renderer(self.grid)?;
        let mut adaptive = Adaptive::new(pyramid.clone());
        let mut levels = Multiresolution::new(pyramid.clone(), CHANNELS, self.threads)?;
        levels.set_surfaces(&[Surface::isovalue(self.isovalue, 0)])?;
        // Pages are first touched outside the clock.
        pool.install(|| adaptive.update(&Selection::whole(&pyramid, true), Extent::Drawn));
        levels.select(&Selection::whole(&pyramid, true))?;
        let mut rows = Vec::new();
        for &epsilon in epsilons {
            let criteria = Criteria {
                view: Some((eye, epsilon)),
                isovalues: near_surface.then(|| vec![self.isovalue]),
                ..Criteria::default()
            };
            let select = || Selection::new(&pyramid, &criteria);
            let ((selection, update), update_time) = self.timed(|| {
                pool.install(|| {
                    let selection = select();
                    let update = adaptive.update(&selection, Extent::Drawn);
                    (selection, update)
                })
            });
            let mut from_nothing = Duration::MAX;
            for _ in 0..3 {
                let work = || {
                    adaptive.forget();
                    adaptive.update(&select(), Extent::Drawn)
                };
                let (_, time) = self.timed(|| pool.install(work));
                from_nothing = from_nothing.min(time);
            }
            let grid = pool.install(|| adaptive.grid())?;
            let picture = self.picture(&grid)?;
            let over = self.over_levels(&mut levels, &select, whole.as_mut(), &picture)?;
            let difference = Difference::of(&full.frame, &picture.frame, self.view, self.grid.spacing.min_element());
            let coarsest: usize = pyramid.level_chunks(pyramid.levels()).iter().product();
            let level_map = adaptive.level_map();
            let row = Row {
                epsilon,
                chunks: selection.count() + coarsest,
                share: (selection.count() + coarsest) as f64 / pyramid.chunks() as f64,
                wanted: update.computed + update.reused,
                from_nothing,
                computed: update.computed,
                update: update_time,
                levels: over,
                render: picture.render,
                mse: difference.mse,
                depth: difference.depth,
                one_sided: difference.one_sided,
                parts: parts(&grid, self.isovalue),
                by_level: (0..=pyramid.levels())
                    .map(|l| level_map.0.iter().filter(|&&m| usize::from(m) == l).count())
                    .collect(),
                level_map,
            };
            rows.push((row, picture));
        }
        Ok(rows)
    }

    /// The same over levels of detail, beside the volume itself at full resolution.
    fn over_levels(
        &self,
        levels: &mut Multiresolution,
        select: &dyn Fn() -> Selection,
        whole: &mut dyn Renderer,
        picture: &Picture,
    ) -> Result<OverLevels, RenderError> {
        let (result, time) = self.timed(|| levels.select(&select()));
        result?;
        let mut out = OverLevels {
            select: time,
            render: Duration::MAX,
            full: Duration::MAX,
            differ: 0,
            bytes: levels.bytes(),
        };
        for _ in 0..REPEATS {
            let (result, time) = self.timed(|| levels.render(self.view, &Stop::default()));
            result?;
            out.render = out.render.min(time);
            let (result, time) = self.timed(|| whole.render(&Stop::default()));
            result?;
            out.full = out.full.min(time);
        }
        let near = 1e-3 * self.grid.spacing.min_element();
        let both = levels.frame().t.iter().zip(&picture.frame.t);
        out.differ = both.filter(|&(a, b)| a != b && (a - b).abs() > near).count();
        Ok(out)
    }
}

/// The picture with every hit in the colour of its level of detail over its shade (Figures 4.6 b and 6.8 b): linear RGBA, black outlines where the level
/// changes from one pixel to the next.
#[must_use]
pub fn level_picture(setting: &Setting<'_>, row: &Row, picture: &Picture) -> Vec<[f32; 4]> {
    let domain = setting.grid.domain();
    let (map, chunks) = &row.level_map;
    let (width, height) = (setting.view.width, setting.view.height);
    let level = |i: usize| -> Option<u8> {
        let t = picture.frame.t[i];
        if !t.is_finite() {
            return None;
        }
        let ray = setting.view.ray(i % width, i / width);
        let u = domain.local(ray.at(t)).clamp(domain.lo, domain.hi).to_array();
        let c = [0, 1, 2].map(|a| (u[a] as usize / super::CHUNK).min(chunks[a] - 1));
        Some(map[(c[2] * chunks[1] + c[1]) * chunks[0] + c[0]])
    };
    let levels: Vec<Option<u8>> = (0..width * height).map(level).collect();
    (0..width * height)
        .map(|i| {
            let Some(l) = levels[i] else { return picture.frame.rgba[i] };
            let right = (i + 1) % width != 0 && levels[i + 1].is_some_and(|r| r != l);
            let below = i + width < levels.len() && levels[i + width].is_some_and(|b| b != l);
            if right || below {
                return [0.0, 0.0, 0.0, 1.0];
            }
            let shade = picture.frame.rgba[i];
            let bright = (shade[0] + shade[1] + shade[2]) / Surface::COLOURS[0].iter().sum::<f32>();
            let c = Surface::COLOURS[usize::from(l) % Surface::COLOURS.len()].map(|c| c * bright);
            [c[0], c[1], c[2], 1.0]
        })
        .collect()
}

/// The greatest threshold at which at least `share` of all chunks (the coarsest level's included) are active, by bisection to 1e-3 of itself. Above
/// the result the share is smaller; the number of chunks moves in steps.
#[must_use]
pub fn epsilon_for(pyramid: &Pyramid, eye: DVec3, share: f64) -> f64 {
    let coarsest: usize = pyramid.level_chunks(pyramid.levels()).iter().product();
    let wanted = share * pyramid.chunks() as f64;
    let enough = |epsilon: f64| {
        let criteria = Criteria {
            view: Some((eye, epsilon)),
            ..Criteria::default()
        };
        (Selection::new(pyramid, &criteria).count() + coarsest) as f64 >= wanted
    };
    let (mut lo, mut hi) = (1e-6, 1e6);
    while hi > lo * 1.001 {
        let middle = f64::sqrt(lo * hi);
        if enough(middle) { lo = middle } else { hi = middle }
    }
    lo
}

/// How a picture differs from the full one. Depths are distances of the first hits along the ray, over pixels hit in both.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Difference {
    /// See [`Row::mse`].
    pub mse: f64,
    /// See [`Row::depth`].
    pub depth: f64,
    /// See [`Row::one_sided`].
    pub one_sided: usize,
    /// Median and 99th percentile of the depths, voxels.
    pub voxels: [f64; 2],
    /// Root mean square, median and 99th percentile of the depths, each in pixel footprints at its hit ([`View::footprint`]).
    pub footprints: [f64; 3],
}

impl Difference {
    /// Of two frames of `view` with t and rgba; `voxel` is the world length depth is divided by. Zeros where nothing is hit.
    #[must_use]
    pub fn of(full: &Frame, other: &Frame, view: &View, voxel: f64) -> Self {
        let (mut colour, mut pixels, mut one_sided) = (0.0, 0usize, 0);
        let (mut depths, mut footprints) = (Vec::new(), Vec::new());
        for (i, (&a, &b)) in full.t.iter().zip(&other.t).enumerate() {
            if a.is_infinite() && b.is_infinite() {
                continue;
            }
            pixels += 1;
            let d = |c: usize| f64::from(full.rgba[i][c]) - f64::from(other.rgba[i][c]);
            colour += (d(0).powi(2) + d(1).powi(2) + d(2).powi(2)) / 3.0;
            if a.is_finite() && b.is_finite() {
                depths.push((a - b).abs() / voxel);
                footprints.push((a - b).abs() / view.footprint(a));
            } else {
                one_sided += 1;
            }
        }
        let square = |v: &[f64]| (v.iter().map(|d| d * d).sum::<f64>() / v.len().max(1) as f64).sqrt();
        let (depth, wide) = (square(&depths), square(&footprints));
        let [f50, f99] = quantiles(&mut footprints);
        Self {
            mse: colour / pixels.max(1) as f64,
            depth,
            one_sided,
            voxels: quantiles(&mut depths),
            footprints: [wide, f50, f99],
        }
    }
}

/// Median and 99th percentile; zeros of nothing.
fn quantiles(v: &mut [f64]) -> [f64; 2] {
    [0.5, 0.99].map(|q| {
        let at = (q * v.len() as f64) as usize;
        if at < v.len() {
            *v.select_nth_unstable_by(at, f64::total_cmp).1
        } else {
            0.0
        }
    })
}

/// Connected parts of the samples at or above a value; samples next to each other along an axis are connected.
#[must_use]
pub fn parts(grid: &Grid, value: f64) -> usize {
    part_sizes(grid, |v| v >= value).len()
}

/// Samples in each connected part of those that are `inside`; samples next to each other along an axis are connected.
#[must_use]
pub fn part_sizes(grid: &Grid, inside: impl Fn(f64) -> bool) -> Vec<usize> {
    let [nx, ny, nz] = grid.dims;
    let mut open: Vec<bool> = (0..grid.samples.len()).map(|i| inside(grid.samples.get(i))).collect();
    let mut sizes = Vec::new();
    let mut stack = Vec::new();
    for start in 0..open.len() {
        if !std::mem::take(&mut open[start]) {
            continue;
        }
        let mut size = 0;
        stack.push(start);
        while let Some(i) = stack.pop() {
            size += 1;
            let (x, y, z) = (i % nx, i / nx % ny, i / (nx * ny));
            let near = [
                (x > 0, i.wrapping_sub(1)),
                (x + 1 < nx, i + 1),
                (y > 0, i.wrapping_sub(nx)),
                (y + 1 < ny, i + nx),
                (z > 0, i.wrapping_sub(nx * ny)),
                (z + 1 < nz, i + nx * ny),
            ];
            for (inside, j) in near {
                if inside && std::mem::take(&mut open[j]) {
                    stack.push(j);
                }
            }
        }
        sizes.push(size);
    }
    sizes
}

/// A row of Figure 4.5: the greatest coefficients alone.
#[derive(Debug, Clone)]
pub struct Compression {
    /// Coefficients that are not dropped.
    pub kept: usize,
    /// `kept` by all.
    pub share: f64,
    /// Root mean square and greatest difference of the spline coefficients, data units.
    pub rms: f64,
    /// Greatest.
    pub max: f64,
    /// The picture against the full one.
    pub picture: Difference,
}

impl Setting<'_> {
    /// Compression to the given shares of the coefficients, with the picture of each.
    ///
    /// # Errors
    /// As [`Setting::rows`].
    pub fn compressions(&self, shares: &[f64], weighted: bool) -> Result<Vec<(Compression, Picture)>, RenderError> {
        let pool = Pool::new(self.threads)?;
        let pyramid = pool.install(|| Pyramid::new(self.grid, self.bank))?;
        let full = self.picture(self.grid)?;
        let mut rows = Vec::new();
        for &share in shares {
            let count = (share * pyramid.coefficients() as f64).round() as usize;
            let (small, kept) = pyramid.keep_largest(count, weighted);
            let small = Arc::new(small);
            let grid = pool.install(|| -> Result<Grid, DataError> {
                let mut adaptive = Adaptive::new(small.clone());
                adaptive.update(&Selection::whole(&small, true), Extent::Whole);
                adaptive.grid()
            })?;
            let (mut sum, mut max) = (0.0, 0.0f64);
            let Samples::F32(values) = &grid.samples else {
                unreachable!("an adaptive reconstruction is in f32")
            };
            for (i, &v) in values.iter().enumerate() {
                let d = f64::from(v) - self.grid.samples.get(i);
                sum += d * d;
                max = max.max(d.abs());
            }
            let picture = self.picture(&grid)?;
            let row = Compression {
                kept,
                share: kept as f64 / pyramid.coefficients() as f64,
                rms: (sum / values.len() as f64).sqrt(),
                max,
                picture: Difference::of(&full.frame, &picture.frame, self.view, self.grid.spacing.min_element()),
            };
            rows.push((row, picture));
        }
        Ok(rows)
    }
}
