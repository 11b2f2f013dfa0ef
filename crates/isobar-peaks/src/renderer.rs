//! `peaks/cpu` and `peaks/cpu-paper` as methods.

use crate::exact::{self, Exact, MARGIN};
use crate::interval::Intervals;
use crate::knobs::{Sampled, Scheme, Settings, Variant};
use crate::macrocells::{Macrocells, Visible, multipliers};
use crate::medium::Medium;
use crate::paper::{self, Integration, Mode, Paper};
use crate::sampling::Sampler;
use crate::sink::Sink;
use crate::tables::{Bins, Lookup, PeakTable, SegmentTable};
use crate::volume::{Form, Linear, Smooth, Volume};
use isobar_core::{
    Channels, Counters, Data, DataKind, Frame, Function, Grid, Knobs, Memory, Method, MethodInfo, RenderError, RenderTime,
    Renderer, Request, Scene, Stage, Stop, Surface, TransferFunction, Unsupported, View,
};
use isobar_cpu::scene::{Isovalues, check_open_cuts, check_request, grid};
use isobar_cpu::{Kernel, Level, Pool, Tile, TileOut, copy_frame, render_tiles};
use isobar_fields::GridSpline;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Instant;

/// Volume ray casting with peak finding, on the CPU; see [`PEAKS_CPU`] and [`PEAKS_CPU_PAPER`].
#[derive(Debug)]
pub struct PeaksCpu(Variant);

/// The method `peaks/cpu`: every crossing of every isovalue and of every peak of the transfer function, exactly and in order, and the medium between.
///
/// Grids of any sample type; the knob `reconstruction` takes the B-splines of isobar-fields and `bc21`. Open cuts by clipping planes. Opacity of peaks is unscaled
/// ([`isobar_core::Peak::opacity`]); in `Frame::surface` they follow the isovalues, ascending. Guarantee with `claims=on` where no medium is
/// drawn (`mode=peak_only`, or no transfer function): a pixel with EXISTS has a root within `t_error` of t, with FIRST none before it, with EMPTY none at all. With a medium: no
/// claims. The medium's optical depth is exact on chords of the field that leave it by at most `tolerance` times its range. Source: Knoll et al. 2009, section
/// 4, but for the finding of peaks.
pub static PEAKS_CPU: PeaksCpu = PeaksCpu(Variant::Exact);

/// The method `peaks/cpu-paper`: the algorithm as printed, with its comparators as knobs. No guarantee: the rule of signs passes pairs of crossings between two
/// samples. Source: Knoll et al. 2009, sections 4 to 6; corrections in the documentation of [`crate::sampling`].
pub static PEAKS_CPU_PAPER: PeaksCpu = PeaksCpu(Variant::Paper);

impl Method for PeaksCpu {
    fn info(&self) -> &'static MethodInfo {
        self.0.info()
    }

    fn supports(&self, scene: &Scene<'_>, request: &Request) -> Result<(), Unsupported> {
        let info = self.info();
        if DataKind::of(scene.data) != DataKind::GRID {
            return Err(Unsupported::DataKind {
                method: info.id,
                can: info.data.words(),
                given: scene.data.kind(),
            });
        }
        let mut surfaces = scene.surfaces.to_vec();
        surfaces.extend(scene.medium.iter().flat_map(|m| m.peaks()).map(|p| p.surface()));
        Isovalues::new(info, &surfaces)?;
        check_open_cuts(info, scene.view)?;
        check_request(info, request)
    }

    fn open(&self, request: &Request) -> Result<Box<dyn Renderer>, RenderError> {
        check_request(self.info(), request)?;
        Ok(Box::new(Peaks {
            variant: self.0,
            settings: Settings::new(self.0, &request.knobs)?,
            pool: Pool::new(request.threads)?,
            level: Level::detect(),
            request: request.clone(),
            grid: None,
            field: None,
            surfaces: None,
            transfer: None,
            view: None,
            scene: None,
            frame: None,
            work: Counters::default(),
        }))
    }
}

/// What depends on data and reconstruction.
#[derive(Debug)]
struct Field {
    volume: Volume,
    macrocells: Macrocells,
    multipliers: Option<Vec<u8>>,
}

/// What depends on surfaces and transfer function too.
#[derive(Debug)]
struct Prepared {
    values: Isovalues,
    medium: Option<Medium>,
    visible: Visible,
    tables: Option<(PeakTable, Option<Integration>)>,
}

#[derive(Debug)]
struct Peaks {
    variant: Variant,
    settings: Settings,
    pool: Pool,
    level: Level,
    request: Request,
    grid: Option<Grid>,
    field: Option<Field>,
    surfaces: Option<Vec<Surface>>,
    transfer: Option<TransferFunction>,
    view: Option<View>,
    /// Made when the next image is drawn.
    scene: Option<Prepared>,
    frame: Option<Frame>,
    work: Counters,
}

impl Peaks {
    fn load(&mut self) -> Result<(), RenderError> {
        (self.field, self.scene) = (None, None);
        let Some(grid) = &self.grid else { return Ok(()) };
        let filter = self.settings.filter;
        self.field = Some(self.pool.install(|| {
            let volume = Volume::new(grid, filter)?;
            let macrocells = Macrocells::new(&volume);
            Ok::<_, RenderError>(Field {
                volume,
                macrocells,
                multipliers: None,
            })
        })?);
        Ok(())
    }

    fn prepare(&mut self) -> Result<(), RenderError> {
        let field = self.field.as_mut().ok_or(RenderError::NotReady("set_data"))?;
        if self.surfaces.is_none() && self.transfer.is_none() {
            return Err(RenderError::NotReady("set_surfaces"));
        }
        let sampled = self.settings.sampled.as_ref();
        if sampled.is_some_and(|s| s.multiplier) && field.multipliers.is_none() {
            field.multipliers = Some(self.pool.install(|| multipliers(&field.volume, &field.macrocells)));
        }
        if self.scene.is_some() {
            return Ok(());
        }
        let mode = self.settings.mode;
        let surfaces = all_surfaces(self.surfaces.as_deref(), self.transfer.as_ref(), mode);
        let values = Isovalues::new(self.variant.info(), &surfaces)?;
        let medium = match &self.transfer {
            Some(tf) if mode != Mode::Peaks => Some(Medium::new(tf)),
            _ => None,
        };
        let (lo, hi) = field.macrocells.range;
        let wanted = values.values().iter().map(|&v| (v, v));
        let wanted = wanted.chain(medium.iter().flat_map(|m| m.support().iter()));
        let wanted = Intervals::new(wanted, MARGIN * (hi - lo));
        let all = !self.settings.macrocells;
        let visible = self
            .pool
            .install(|| Visible::new(&field.volume, &field.macrocells, &wanted, all, self.level));
        let tables = sampled.map(|s| tables(s, values.values(), medium.as_ref(), (lo, hi)));
        self.scene = Some(Prepared {
            values,
            medium,
            visible,
            tables,
        });
        Ok(())
    }

    /// The sampler of a view.
    fn sampler(&self, s: &Sampled, field: &Field, view: &View) -> Result<Sampler, RenderError> {
        let space = &field.volume.space;
        let sampler = Sampler::new(s.law, s.s_k, space.extent, s.step * space.domain.voxel(), view);
        sampler.check(view, space.domain.world_bounds())?;
        Ok(sampler)
    }
}

/// The surfaces given, then the peaks.
fn all_surfaces(given: Option<&[Surface]>, transfer: Option<&TransferFunction>, mode: Mode) -> Vec<Surface> {
    if mode == Mode::Medium {
        return Vec::new();
    }
    let mut all = given.unwrap_or_default().to_vec();
    all.extend(transfer.iter().flat_map(|t| t.peaks()).map(|p| p.surface()));
    all
}

fn tables(s: &Sampled, values: &[f64], medium: Option<&Medium>, range: (f64, f64)) -> (PeakTable, Option<Integration>) {
    let table = PeakTable::new(values, Bins::new(range, s.bins), s.reach, s.peaks);
    let segments = |m: &Medium| SegmentTable::new(m, Bins::new(range, s.segments));
    let integration = medium.map(|m| match s.scheme {
        Scheme::Post => Integration::Post(Lookup::new(m, range)),
        Scheme::Table => Integration::Table(segments(m)),
        Scheme::Smooth => Integration::Smooth(segments(m)),
        Scheme::Analytic => Integration::Analytic(m.clone()),
    });
    (table, integration)
}

impl Renderer for Peaks {
    fn set_data(&mut self, data: &Arc<Data>) -> Result<(), RenderError> {
        let grid = grid(self.variant.info(), data)?;
        if grid.dims.iter().any(|&n| n > 1 << 30) {
            return Err(isobar_core::DataError::Dims(grid.dims).into());
        }
        let former = self.grid.replace(grid.clone());
        if let Err(e) = self.load() {
            // The former data stay.
            self.grid = former;
            self.load()?;
            return Err(e);
        }
        Ok(())
    }

    fn set_surfaces(&mut self, surfaces: &[Surface]) -> Result<(), RenderError> {
        Isovalues::new(
            self.variant.info(),
            &all_surfaces(Some(surfaces), self.transfer.as_ref(), Mode::Both),
        )?;
        (self.surfaces, self.scene) = (Some(surfaces.to_vec()), None);
        Ok(())
    }

    fn set_medium(&mut self, medium: Option<&TransferFunction>) -> Result<(), RenderError> {
        let checked = medium.map(|m| TransferFunction::new(m.points.clone(), m.unit)).transpose()?;
        Isovalues::new(
            self.variant.info(),
            &all_surfaces(self.surfaces.as_deref(), checked.as_ref(), Mode::Both),
        )?;
        if checked != self.transfer {
            (self.transfer, self.scene) = (checked, None);
        }
        Ok(())
    }

    fn set_view(&mut self, view: &View) -> Result<(), RenderError> {
        view.validate()?;
        check_open_cuts(self.variant.info(), view)?;
        self.view = Some(view.clone());
        Ok(())
    }

    fn set_knobs(&mut self, knobs: &Knobs) -> Result<(), RenderError> {
        let settings = Settings::new(self.variant, knobs)?;
        let former = std::mem::replace(&mut self.settings, settings);
        if former.filter != self.settings.filter {
            self.load()?;
        } else if former != self.settings {
            self.scene = None;
        }
        Ok(())
    }

    fn render(&mut self, stop: &Stop) -> Result<RenderTime, RenderError> {
        let start = Instant::now();
        self.prepare()?;
        let field = self.field.as_ref().ok_or(RenderError::NotReady("set_data"))?;
        let scene = self.scene.as_ref().ok_or(RenderError::NotReady("set_surfaces"))?;
        let view = self.view.as_ref().ok_or(RenderError::NotReady("set_view"))?;
        let sampler = match &self.settings.sampled {
            Some(s) => Some(self.sampler(s, field, view)?),
            None => None,
        };
        let mut frame = self.frame.take().unwrap_or_default();
        let job = Job {
            settings: &self.settings,
            level: self.level,
            request: &self.request,
            pool: &self.pool,
            field,
            scene,
            view,
            sampler: sampler.as_ref(),
            work: &Totals::default(),
        };
        // A frame drawn in part is none.
        match field.volume.filter.basis().degree {
            1 => job.run(Linear::new(&field.volume), stop, &mut frame)?,
            2 => job.run(Smooth::<3>(&field.volume), stop, &mut frame)?,
            _ => job.run(Smooth::<4>(&field.volume), stop, &mut frame)?,
        }
        self.work = job.work.counters(sampler.is_some());
        self.frame = Some(frame);
        Ok(RenderTime {
            wall: start.elapsed(),
            device: None,
        })
    }

    fn read(&mut self, out: &mut Frame) -> Result<(), RenderError> {
        copy_frame(self.frame.as_ref().ok_or(RenderError::NotReady("render"))?, out);
        Ok(())
    }

    /// `None` for `bc21` too: it has no description that the oracle could use, since its weights are negative.
    fn reconstruction(&self, stage: Stage) -> Option<Arc<dyn Function>> {
        let volume = &self.field.as_ref()?.volume;
        if volume.filter.has_negative_lobes() {
            return None;
        }
        Some(match stage {
            Stage::Stored => Arc::new(volume.spline.clone()),
            Stage::Ideal => Arc::new(GridSpline::new(volume.spline.grid(), volume.filter.coefficients(), stage).ok()?),
        })
    }

    fn memory(&self) -> Memory {
        let field = self.field.as_ref();
        let scene = self.scene.as_ref();
        let index = field.map_or(0, |f| f.macrocells.bytes() + f.multipliers.as_ref().map_or(0, Vec::len));
        let tables = scene.and_then(|s| s.tables.as_ref()).map_or(0, |(t, i)| {
            t.bytes()
                + match i {
                    Some(Integration::Post(l)) => l.bytes(),
                    Some(Integration::Table(t) | Integration::Smooth(t)) => t.bytes(),
                    Some(Integration::Analytic(_)) | None => 0,
                }
        });
        Memory {
            coefficients: field.map_or(0, |f| f.volume.spline.own_bytes()) as u64,
            index: (index + tables + scene.map_or(0, |s| s.visible.bytes())) as u64,
            ..Memory::default()
        }
    }

    fn counters(&self) -> Counters {
        let mut out = self.work.clone();
        if let Some(scene) = &self.scene {
            out.0.push(("visible macrocells", scene.visible.count()));
            if let Some((table, _)) = &scene.tables {
                out.0.push(("peaks in one bin with the next", table.crowded() as u64));
                out.0.push(("table entries with dropped peaks", table.dropped() as u64));
            }
        }
        out
    }
}

/// One image.
struct Job<'a> {
    settings: &'a Settings,
    level: Level,
    request: &'a Request,
    pool: &'a Pool,
    field: &'a Field,
    scene: &'a Prepared,
    view: &'a View,
    sampler: Option<&'a Sampler>,
    work: &'a Totals,
}

impl Job<'_> {
    fn run(&self, form: impl Form + Send + Sync, stop: &Stop, frame: &mut Frame) -> Result<(), RenderError> {
        let (field, scene, settings) = (self.field, self.scene, self.settings);
        let (lo, hi) = field.macrocells.range;
        let medium_wanted = self.request.channels.contains(Channels::RGBA);
        // Indices of the values in the list of all surfaces.
        let index: Vec<u8> = (0..scene.values.values().len()).map(|i| scene.values.surface(i)).collect();
        let exact = Exact {
            volume: &field.volume,
            visible: &scene.visible,
            clips: &self.view.clips,
            values: scene.values.values(),
            index: &index,
            medium: scene.medium.as_ref(),
            either: settings.mode == Mode::Either,
            // Without surfaces nothing is said of the isovalues of the scene.
            claims: settings.claims && settings.mode != Mode::Medium,
            reference: 0.5 * lo + 0.5 * hi,
            size: hi - lo,
            tolerance: (settings.tolerance * (hi - lo)).max(f64::MIN_POSITIVE),
            thick: (12.0 * settings.tolerance).sqrt(),
        };
        let paper = match (&settings.sampled, &scene.tables, self.sampler) {
            (Some(s), Some((table, integration)), Some(sampler)) => Some(Paper {
                volume: &field.volume,
                macrocells: &field.macrocells,
                visible: settings.macrocells.then_some(&scene.visible),
                clips: &self.view.clips,
                multipliers: if s.multiplier { field.multipliers.as_deref() } else { None },
                values: scene.values.values(),
                index: &index,
                table,
                mode: settings.mode,
                integration: integration.as_ref().filter(|_| medium_wanted),
                iterations: s.iterations,
                sampler,
                shaded: s.shaded,
                single: s.single,
            }),
            _ => None,
        };
        render_tiles(self.pool, self.view, self.request, stop, frame, |tile, out| {
            let surfaces = scene.values.all();
            let view = self.view;
            match &paper {
                Some(paper) => self.work.sampled(self.level.run(SampledTile {
                    paper,
                    form,
                    view,
                    surfaces,
                    tile,
                    out,
                })),
                None => self.work.exact(self.level.run(ExactTile {
                    exact: &exact,
                    form,
                    view,
                    surfaces,
                    tile,
                    out,
                })),
            }
        })
    }
}

struct ExactTile<'a, 'b, F> {
    exact: &'a Exact<'a>,
    form: F,
    view: &'a View,
    surfaces: &'a [Surface],
    tile: Tile,
    out: &'a mut TileOut<'b>,
}

impl<F: Form> Kernel for ExactTile<'_, '_, F> {
    type Output = exact::Work;

    #[inline(always)]
    fn run(self) -> exact::Work {
        let rays = self.view.generator();
        let mut scratch = exact::Scratch::new(self.exact.values.len());
        for (x, y) in self.tile.pixels() {
            let ray = rays.ray(x, y);
            let sink = Sink::new(self.out, (x, y), ray.direction, self.surfaces);
            self.exact.draw(self.form, &ray, sink, &mut scratch);
        }
        scratch.work
    }
}

struct SampledTile<'a, 'b, F> {
    paper: &'a Paper<'a>,
    form: F,
    view: &'a View,
    surfaces: &'a [Surface],
    tile: Tile,
    out: &'a mut TileOut<'b>,
}

impl<F: Form> Kernel for SampledTile<'_, '_, F> {
    type Output = paper::Work;

    #[inline(always)]
    fn run(self) -> paper::Work {
        let rays = self.view.generator();
        let mut work = paper::Work::default();
        for (x, y) in self.tile.pixels() {
            let ray = rays.ray(x, y);
            let sink = Sink::new(self.out, (x, y), ray.direction, self.surfaces);
            self.paper.draw(self.form, &ray, sink, &mut work);
        }
        work
    }
}

/// Work of all tiles.
#[derive(Debug, Default)]
struct Totals([AtomicU64; 6]);

impl Totals {
    fn add(&self, work: [u64; 6]) {
        for (total, n) in self.0.iter().zip(work) {
            total.fetch_add(n, Ordering::Relaxed);
        }
    }

    fn exact(&self, w: exact::Work) {
        self.add([w.macrocells, w.cells, w.stretches, w.crossings, 0, 0]);
    }

    fn sampled(&self, w: paper::Work) {
        self.add([w.macrocells, w.samples, w.secants, w.gradients, w.crossings, w.gaps]);
    }

    fn counters(&self, sampled: bool) -> Counters {
        let names: &[&str] = if sampled {
            &[
                "macrocells",
                "samples",
                "samples for peaks",
                "gradients",
                "crossings",
                "segments out of place",
            ]
        } else {
            &["macrocells", "cells", "stretches of medium", "crossings"]
        };
        let load = |w: &AtomicU64| w.load(Ordering::Relaxed);
        Counters(names.iter().zip(&self.0).map(|(&n, w)| (n, load(w))).collect())
    }
}
