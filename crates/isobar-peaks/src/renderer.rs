//! `peaks/cpu` and `peaks/cpu-paper` as methods.

use crate::exact::{self, Exact};
use crate::knobs::{Settings, Variant};
use crate::paper::{self, Mode, Paper};
use crate::sampling::Sampler;
use crate::scene::{Field, Inputs, Prepared, check};
use crate::sink::Sink;
use crate::volume::{Form, Linear, Smooth};
use isobar_core::{
    Channels, Counters, Data, Frame, Function, Knobs, Memory, Method, MethodInfo, RenderError, RenderTime, Renderer, Request,
    Scene, Stage, Stop, Surface, TransferFunction, Unsupported, View,
};
use isobar_cpu::packet::{self, Lanes, WithLanes};
use isobar_cpu::{Level, Pool, Tile, TileOut, copy_frame, render_tiles};
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
        check(self.info(), scene, request)
    }

    fn open(&self, request: &Request) -> Result<Box<dyn Renderer>, RenderError> {
        Ok(Box::new(Peaks {
            inputs: Inputs::new(self.0, request)?,
            frame: None,
            work: Counters::default(),
        }))
    }
}

#[derive(Debug)]
struct Peaks {
    inputs: Inputs,
    frame: Option<Frame>,
    work: Counters,
}

impl Renderer for Peaks {
    fn set_data(&mut self, data: &Arc<Data>) -> Result<(), RenderError> {
        self.inputs.set_data(data)
    }

    fn set_surfaces(&mut self, surfaces: &[Surface]) -> Result<(), RenderError> {
        self.inputs.set_surfaces(surfaces)
    }

    fn set_medium(&mut self, medium: Option<&TransferFunction>) -> Result<(), RenderError> {
        self.inputs.set_medium(medium)
    }

    fn set_view(&mut self, view: &View) -> Result<(), RenderError> {
        self.inputs.set_view(view)
    }

    fn set_knobs(&mut self, knobs: &Knobs) -> Result<(), RenderError> {
        self.inputs.set_knobs(knobs)
    }

    fn render(&mut self, stop: &Stop) -> Result<RenderTime, RenderError> {
        let start = Instant::now();
        self.inputs.prepare()?;
        let inputs = &self.inputs;
        let field = inputs.field.as_ref().ok_or(RenderError::NotReady("set_data"))?;
        let scene = inputs.scene.as_ref().ok_or(RenderError::NotReady("set_surfaces"))?;
        let view = inputs.view.as_ref().ok_or(RenderError::NotReady("set_view"))?;
        let sampler = match &inputs.settings.sampled {
            Some(s) => Some(inputs.sampler(s, field, view)?),
            None => None,
        };
        let mut frame = self.frame.take().unwrap_or_default();
        let job = Job {
            settings: &inputs.settings,
            level: inputs.level,
            request: &inputs.request,
            pool: &inputs.pool,
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

    fn reconstruction(&self, stage: Stage) -> Option<Arc<dyn Function>> {
        self.inputs.reconstruction(stage)
    }

    fn memory(&self) -> Memory {
        self.inputs.memory()
    }

    fn counters(&self) -> Counters {
        let mut out = self.work.clone();
        out.0.extend(self.inputs.counters());
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
            packets: settings.packets,
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
                packets: settings.packets,
            }),
            _ => None,
        };
        render_tiles(self.pool, self.view, self.request, stop, frame, |tile, out| {
            let surfaces = scene.values.all();
            let view = self.view;
            match &paper {
                Some(paper) => {
                    let tile = SampledTile {
                        paper,
                        form,
                        view,
                        surfaces,
                        tile,
                        out,
                    };
                    self.work.sampled(packet::run(self.level, tile));
                }
                None => {
                    let tile = ExactTile {
                        exact: &exact,
                        form,
                        view,
                        surfaces,
                        tile,
                        out,
                    };
                    self.work.exact(packet::run(self.level, tile));
                }
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

impl<F: Form> WithLanes for ExactTile<'_, '_, F> {
    type Output = exact::Work;

    #[inline(always)]
    fn run<S: Lanes>(self) -> exact::Work {
        let rays = self.view.generator();
        let mut scratch = exact::Scratch::new(self.exact.values.len());
        for (x, y) in self.tile.pixels() {
            let ray = rays.ray(x, y);
            let sink = Sink::new(self.out, (x, y), ray.direction, self.surfaces);
            self.exact.draw::<S, F>(self.form, &ray, sink, &mut scratch);
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

impl<F: Form> WithLanes for SampledTile<'_, '_, F> {
    type Output = paper::Work;

    #[inline(always)]
    fn run<S: Lanes>(self) -> paper::Work {
        let rays = self.view.generator();
        let mut work = paper::Work::default();
        for (x, y) in self.tile.pixels() {
            let ray = rays.ray(x, y);
            let sink = Sink::new(self.out, (x, y), ray.direction, self.surfaces);
            self.paper.draw::<S, F>(self.form, &ray, sink, &mut work);
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
