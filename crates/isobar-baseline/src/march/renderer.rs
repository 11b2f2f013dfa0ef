//! The renderer: what is kept between calls, and one typed kernel per sample type, number of taps and instruction set.

use super::INFO;
use super::blocks::Blocks;
use super::ray::{March, Work};
use super::volume::{Sample, Volume};
use crate::given::Given;
use crate::index_space::ToIndex;
use crate::support::{self, Isovalues};
use isobar_core::{
    Channels, Claim, Counters, Data, DataError, Frame, Function, Hit, Knobs, Memory, RayGenerator, RenderError, RenderTime,
    Renderer, Request, ResolvedKnobs, Samples, Stage, Stop, Surface, TransferFunction, View,
};
use isobar_cpu::{Kernel, Level, PixelSink, Pool, TileOut, copy_frame, render_tiles};
use isobar_fields::{Coefficients, GridSpline, Kind};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// Settings, read once.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Settings {
    kind: Kind,
    step: f64,
    bisections: u32,
    skip: bool,
    block: usize,
    level: Level,
}

impl Settings {
    fn new(knobs: &Knobs) -> Result<Self, RenderError> {
        let k = ResolvedKnobs::new(INFO.knobs, knobs)?;
        let wrong = |name: &str| RenderError::Knob {
            name: name.into(),
            reason: format!("{} cannot be read", k.word(name)),
        };
        Ok(Self {
            kind: k.word("reconstruction").parse()?,
            step: k.float("step"),
            bisections: k.int("bisections") as u32,
            skip: k.word("skip") == "on",
            block: k.word("block").parse().map_err(|_| wrong("block"))?,
            level: match k.word("simd") {
                "auto" => Level::detect(),
                word => Level::best(word.parse().map_err(|_| wrong("simd"))?),
            },
        })
    }
}

/// Blocks in the type of the coefficients.
#[derive(Debug)]
enum AnyBlocks {
    U8(Blocks<u8>),
    I16(Blocks<i16>),
    U16(Blocks<u16>),
    F32(Blocks<f32>),
}

/// What is built for the data.
#[derive(Debug)]
struct Prepared {
    data: Arc<Data>,
    spline: GridSpline,
    blocks: AnyBlocks,
    block: usize,
    to_index: ToIndex,
    /// Least and greatest coefficient.
    range: [f64; 2],
}

/// Runs `$body` with `$c` bound to the typed coefficients and `$wrap` to the variant of [`AnyBlocks`] that fits them.
macro_rules! typed {
    ($spline:expr, $c:ident, $wrap:ident => $body:expr) => {
        match $spline.coefficients() {
            Coefficients::Samples(Samples::U8($c)) => {
                use AnyBlocks::U8 as $wrap;
                $body
            }
            Coefficients::Samples(Samples::I16($c)) => {
                use AnyBlocks::I16 as $wrap;
                $body
            }
            Coefficients::Samples(Samples::U16($c)) => {
                use AnyBlocks::U16 as $wrap;
                $body
            }
            Coefficients::Samples(Samples::F32($c)) => {
                use AnyBlocks::F32 as $wrap;
                $body
            }
            Coefficients::F32($c) => {
                use AnyBlocks::F32 as $wrap;
                $body
            }
            Coefficients::F64(_) => return Err(RenderError::Data(DataError::Unknown("f64 coefficients are not drawn".into()))),
        }
    };
}

impl Prepared {
    fn new(data: &Arc<Data>, settings: &Settings) -> Result<Self, RenderError> {
        let grid = support::grid(&INFO, data)?;
        let spline = GridSpline::new(grid, settings.kind, Stage::Stored)?;
        let taps = settings.kind.basis().degree + 1;
        let (blocks, range) = typed!(spline, c, Wrap => {
            let b = Blocks::new(c, grid.dims, taps, settings.block);
            let range = b.range();
            (Wrap(b), range)
        });
        Ok(Self {
            data: Arc::clone(data),
            to_index: ToIndex::new(&grid.domain()),
            spline,
            blocks,
            block: settings.block,
            range,
        })
    }

    fn index_bytes(&self) -> usize {
        match &self.blocks {
            AnyBlocks::U8(b) => b.bytes(),
            AnyBlocks::I16(b) => b.bytes(),
            AnyBlocks::U16(b) => b.bytes(),
            AnyBlocks::F32(b) => b.bytes(),
        }
    }
}

/// A renderer of `march/cpu`.
#[derive(Debug)]
pub(crate) struct MarchRenderer {
    pool: Pool,
    request: Request,
    settings: Settings,
    prepared: Option<Prepared>,
    given: Given,
    frame: Frame,
    totals: Totals,
}

/// Sums over the frame.
#[derive(Debug, Default)]
struct Totals {
    samples: AtomicU64,
    blocks: AtomicU64,
    bisections: AtomicU64,
}

impl Totals {
    fn add(&self, w: [u64; 3]) {
        for (total, n) in [&self.samples, &self.blocks, &self.bisections].into_iter().zip(w) {
            total.fetch_add(n, Ordering::Relaxed);
        }
    }
}

impl MarchRenderer {
    pub(crate) fn new(request: &Request) -> Result<Self, RenderError> {
        Ok(Self {
            given: Given::new(&INFO, request)?,
            pool: Pool::new(request.threads)?,
            settings: Settings::new(&request.knobs)?,
            request: request.clone(),
            prepared: None,
            frame: Frame::default(),
            totals: Totals::default(),
        })
    }

    fn prepare(&self, data: &Arc<Data>, settings: &Settings) -> Result<Prepared, RenderError> {
        self.pool.install(|| Prepared::new(data, settings))
    }
}

impl Renderer for MarchRenderer {
    fn set_data(&mut self, data: &Arc<Data>) -> Result<(), RenderError> {
        self.prepared = Some(self.prepare(data, &self.settings)?);
        self.given.changed();
        Ok(())
    }

    fn set_surfaces(&mut self, surfaces: &[Surface]) -> Result<(), RenderError> {
        self.given.set_surfaces(self.given.isovalues(surfaces)?);
        Ok(())
    }

    fn set_medium(&mut self, medium: Option<&TransferFunction>) -> Result<(), RenderError> {
        self.given.set_medium(medium)
    }

    fn set_view(&mut self, view: &View) -> Result<(), RenderError> {
        self.given.check_view(view)?;
        self.given.set_view(view);
        Ok(())
    }

    fn set_knobs(&mut self, knobs: &Knobs) -> Result<(), RenderError> {
        let settings = Settings::new(knobs)?;
        if let Some(p) = &self.prepared
            && (p.spline.kind(), p.block) != (settings.kind, settings.block)
        {
            let data = Arc::clone(&p.data);
            self.prepared = Some(self.prepare(&data, &settings)?);
        }
        self.settings = settings;
        self.given.changed();
        Ok(())
    }

    fn render(&mut self, stop: &Stop) -> Result<RenderTime, RenderError> {
        let prepared = self.prepared.as_ref().ok_or(RenderError::NotReady("set_data"))?;
        self.given.changed();
        let (surfaces, view) = self.given.scene()?;
        let start = Instant::now();
        self.totals = Totals::default();
        let job = Job {
            prepared,
            surfaces,
            rays: view.generator(),
            settings: self.settings,
            totals: &self.totals,
        };
        let taps = self.settings.kind.basis().degree + 1;
        let (pool, request, frame) = (&self.pool, &self.request, &mut self.frame);
        let in_range = surfaces
            .values()
            .iter()
            .any(|c| prepared.range[0] <= *c && *c <= prepared.range[1]);
        render_tiles(pool, view, request, stop, frame, |_, out| {
            if in_range {
                match taps {
                    2 => job.draw::<2>(out),
                    3 => job.draw::<3>(out),
                    _ => job.draw::<4>(out),
                }
            }
        })?;
        self.given.drew();
        Ok(RenderTime {
            wall: start.elapsed(),
            device: None,
        })
    }

    fn read(&mut self, out: &mut Frame) -> Result<(), RenderError> {
        self.given.frame()?;
        copy_frame(&self.frame, out);
        Ok(())
    }

    fn reconstruction(&self, stage: Stage) -> Option<Arc<dyn Function>> {
        let p = self.prepared.as_ref()?;
        if stage == Stage::Stored || !p.spline.kind().interpolates() {
            return Some(Arc::new(p.spline.clone()));
        }
        let ideal = self.pool.install(|| GridSpline::new(p.spline.grid(), p.spline.kind(), stage));
        ideal.ok().map(|s| Arc::new(s) as Arc<dyn Function>)
    }

    fn memory(&self) -> Memory {
        let p = self.prepared.as_ref();
        Memory {
            coefficients: p.map_or(0, |p| p.spline.own_bytes() as u64),
            index: p.map_or(0, |p| p.index_bytes() as u64),
            ..Memory::default()
        }
    }

    fn counters(&self) -> Counters {
        let get = |a: &AtomicU64| a.load(Ordering::Relaxed);
        Counters(vec![
            ("samples", get(&self.totals.samples)),
            ("blocks", get(&self.totals.blocks)),
            ("bisections", get(&self.totals.bisections)),
        ])
    }
}

/// What the tiles of a frame share.
struct Job<'a> {
    prepared: &'a Prepared,
    surfaces: &'a Isovalues,
    rays: RayGenerator<'a>,
    settings: Settings,
    totals: &'a Totals,
}

impl Job<'_> {
    /// Draws a tile with W taps per axis.
    fn draw<const W: usize>(&self, out: &mut TileOut<'_>) {
        let grid = self.prepared.spline.grid();
        match (self.prepared.spline.coefficients(), &self.prepared.blocks) {
            (Coefficients::Samples(Samples::U8(c)), AnyBlocks::U8(b)) => self.typed::<_, W>(c, grid.dims, b, out),
            (Coefficients::Samples(Samples::I16(c)), AnyBlocks::I16(b)) => self.typed::<_, W>(c, grid.dims, b, out),
            (Coefficients::Samples(Samples::U16(c)), AnyBlocks::U16(b)) => self.typed::<_, W>(c, grid.dims, b, out),
            (Coefficients::Samples(Samples::F32(c)), AnyBlocks::F32(b)) => self.typed::<_, W>(c, grid.dims, b, out),
            (Coefficients::F32(c), AnyBlocks::F32(b)) => self.typed::<_, W>(c, grid.dims, b, out),
            _ => unreachable!("Prepared::new makes the blocks of the coefficients' type"),
        }
    }

    fn typed<T: Sample, const W: usize>(&self, c: &[T], dims: [usize; 3], blocks: &Blocks<T>, out: &mut TileOut<'_>) {
        let range = self.prepared.range;
        let march = March {
            volume: Volume::<T, W>::new(c, dims, self.prepared.spline.border()),
            blocks: self.settings.skip.then_some(blocks),
            isovalues: self.surfaces.values(),
            lowest: self.surfaces.values()[0],
            slack: range[0].abs().max(range[1].abs()) * SLACK,
            step: self.settings.step,
            bisections: self.settings.bisections,
        };
        self.settings.level.run(TileKernel { job: self, march, out });
    }
}

/// Relative rounding of s, and of the position it is taken at, granted to blocks: some 10^5 times that of one f64 operation.
const SLACK: f64 = 1.0 / (1u64 << 36) as f64;

/// One tile, compiled per instruction set.
struct TileKernel<'a, 'b, T, const W: usize> {
    job: &'a Job<'a>,
    march: March<'a, T, W>,
    out: &'a mut TileOut<'b>,
}

impl<T: Sample, const W: usize> Kernel for TileKernel<'_, '_, T, W> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self { job, march, out } = self;
        let with_normal = out.holds(Channels::NORMAL | Channels::RGBA);
        let to_index = &job.prepared.to_index;
        let mut totals = [0u64; 3];
        for (x, y) in out.tile().pixels() {
            let world = job.rays.ray(x, y);
            let ray = to_index.ray(&world);
            let mut work = Work::default();
            let mut sink = PixelSink::new(out, x, y, &world, job.surfaces.all());
            march.run(&ray, job.rays.kept(&world), &mut work, |t, i| {
                let normal = if with_normal {
                    to_index.normal(march.volume.gradient(march.volume.clamp(ray.at(t))))
                } else {
                    [0.0; 3]
                };
                sink.push(&Hit {
                    t,
                    point: world.at(t),
                    normal,
                    surface: job.surfaces.surface(i),
                    t_error: f64::INFINITY,
                })
            });
            sink.finish(Claim::empty(), work.samples);
            totals[0] += u64::from(work.samples);
            totals[1] += u64::from(work.blocks);
            totals[2] += u64::from(work.bisections);
        }
        job.totals.add(totals);
    }
}

impl std::fmt::Debug for Job<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Job")
            .field("settings", &self.settings)
            .finish_non_exhaustive()
    }
}
