//! Drawing with the time taken apart: opening, data, surfaces, view, rendering and reading are separate numbers.
//!
//! Timed output is verified output: every repeated frame is read and must equal the first one.

use crate::machine;
use isobar_core::{
    Channels, Counters, Data, Frame, Function, Knobs, Memory, Method, RenderError, Renderer, Request, ResolvedKnobs, Scene,
    Stage, Stop, Surface, TransferFunction, View,
};
use serde::Serialize;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// What is drawn, by what.
#[derive(Clone)]
pub struct Setup<'a> {
    /// The method.
    pub method: &'static dyn Method,
    /// The data.
    pub data: &'a Arc<Data>,
    /// The surfaces.
    pub surfaces: &'a [Surface],
    /// The medium.
    pub medium: Option<&'a TransferFunction>,
    /// The view.
    pub view: &'a View,
    /// Channels, layers, threads, knobs.
    pub request: Request,
}

impl std::fmt::Debug for Setup<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Setup")
            .field("method", &self.method.info().id)
            .field("data", &self.data.kind())
            .field("surfaces", &self.surfaces)
            .field("view", &self.view)
            .field("request", &self.request)
            .finish_non_exhaustive()
    }
}

impl Setup<'_> {
    /// The scene, as methods are asked about it.
    #[must_use]
    pub fn scene(&self) -> Scene<'_> {
        Scene {
            data: self.data,
            surfaces: self.surfaces,
            medium: self.medium,
            view: self.view,
        }
    }
}

/// Why a run gave no result.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RunError {
    /// The method refused or failed.
    #[error(transparent)]
    Render(#[from] RenderError),
    /// Two renderings of the same scene differ: their times mean nothing.
    #[error("{method}: repeated frames of one scene differ (rendering {repeat}); its times are not reported")]
    Unequal {
        /// The method.
        method: &'static str,
        /// Which repetition.
        repeat: usize,
    },
}

/// Median and median absolute deviation of n times, seconds.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Stat {
    /// Median.
    pub median: f64,
    /// Median of the absolute distances from the median; 0 for one time.
    pub mad: f64,
    /// How many.
    pub n: usize,
}

impl Stat {
    /// Of these times; all 0 where there are none.
    #[must_use]
    pub fn of(times: &[f64]) -> Self {
        let median = median(times);
        let spread: Vec<f64> = times.iter().map(|t| (t - median).abs()).collect();
        Self {
            median,
            mad: self::median(&spread),
            n: times.len(),
        }
    }
}

fn median(values: &[f64]) -> f64 {
    let mut v = values.to_vec();
    v.sort_by(f64::total_cmp);
    match v.len() {
        0 => 0.0,
        n if n % 2 == 1 => v[n / 2],
        n => (v[n / 2 - 1] + v[n / 2]) * 0.5,
    }
}

/// The time of one run, taken apart; seconds of wall clock unless said otherwise.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Timings {
    /// Reading and decoding DATA; filled in by who did that.
    pub load: f64,
    /// Starting the renderer: threads, pipelines.
    pub open: f64,
    /// Taking the data.
    pub data: f64,
    /// Taking surfaces and medium.
    pub surfaces: f64,
    /// Taking the view.
    pub view: f64,
    /// Taking the settings of an [`Entry`]; 0 where it has none of its own.
    pub knobs: f64,
    /// Copying the frame out.
    pub read: f64,
    /// The first rendering: what a method builds only when it draws is in here. With one repetition it is also `render`.
    pub first_render: f64,
    /// Rendering.
    pub render: Stat,
    /// Processor time of rendering, summed over threads.
    pub cpu_render: Stat,
    /// Device time of rendering by timestamps; `n` is 0 where there is no device.
    pub device_render: Stat,
}

/// What came of a run.
pub struct Outcome {
    /// The frame; empty where a visitor of [`interleaved_with`] took it.
    pub frame: Frame,
    /// [`digest`] of the frame: that of every repetition.
    pub digest: u64,
    /// Times.
    pub timings: Timings,
    /// Memory of the renderer beyond the shared source and the frame.
    pub memory: Memory,
    /// Greatest resident memory of the process so far, bytes; 0 where the system does not say.
    pub peak_bytes: u64,
    /// Work done by the last rendering.
    pub counters: Counters,
    /// The function really drawn; `None` where the method has none to tell.
    pub function: Option<Arc<dyn Function>>,
}

impl std::fmt::Debug for Outcome {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Outcome")
            .field("timings", &self.timings)
            .field("memory", &self.memory)
            .field("counters", &self.counters)
            .finish_non_exhaustive()
    }
}

/// A renderer that has its scene and can draw.
pub struct Prepared {
    method: &'static dyn Method,
    renderer: Box<dyn Renderer>,
    timings: Timings,
}

impl std::fmt::Debug for Prepared {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Prepared")
            .field("method", &self.method.info().id)
            .field("timings", &self.timings)
            .finish_non_exhaustive()
    }
}

fn timed<T>(seconds: &mut f64, work: impl FnOnce() -> T) -> T {
    let start = Instant::now();
    let out = work();
    *seconds = start.elapsed().as_secs_f64();
    out
}

/// Opens a renderer and gives it the scene, each part timed.
///
/// # Errors
/// What the method refuses ([`Method::supports`] is asked first) or fails at; an image too large for the memory left.
pub fn prepare(setup: &Setup<'_>) -> Result<Prepared, RenderError> {
    setup.view.validate()?;
    check_memory(setup, 0)?;
    setup.method.supports(&setup.scene(), &setup.request)?;
    let coefficients = coefficient_bytes(setup);
    if coefficients > 0 {
        check_memory(setup, coefficients)?;
    }
    let mut t = Timings::default();
    let mut renderer = timed(&mut t.open, || setup.method.open(&setup.request))?;
    timed(&mut t.data, || renderer.set_data(setup.data))?;
    timed(&mut t.surfaces, || {
        renderer.set_surfaces(setup.surfaces)?;
        renderer.set_medium(setup.medium)
    })?;
    timed(&mut t.view, || renderer.set_view(setup.view))?;
    Ok(Prepared {
        method: setup.method,
        renderer,
        timings: t,
    })
}

/// Bytes of a frame of this view and request: one in the renderer and one copied out are needed.
#[must_use]
pub fn frame_bytes(view: &View, request: &Request) -> u64 {
    let sizes = [
        (Channels::T, 8, true),
        (Channels::POINT, 24, true),
        (Channels::NORMAL, 12, true),
        (Channels::SURFACE, 1, true),
        (Channels::T_ERROR, 8, true),
        (Channels::HITS, 2, false),
        (Channels::CLAIM, 1, false),
        (Channels::RGBA, 16, false),
        (Channels::WORK, 4, false),
    ];
    let per_pixel = |(c, bytes, layered): &(Channels, u64, bool)| {
        let layers = if *layered { request.layers.max(1) as u64 } else { 1 };
        if request.channels.contains(*c) {
            bytes.saturating_mul(layers)
        } else {
            0
        }
    };
    let pixel = sizes.iter().map(per_pixel).fold(0u64, u64::saturating_add);
    (view.pixels() as u64).saturating_mul(pixel)
}

/// Asks for a frame in the renderer, one copied out, and `coefficients` bytes.
fn check_memory(setup: &Setup<'_>, coefficients: u64) -> Result<(), RenderError> {
    let (view, layers) = (setup.view, setup.request.layers.max(1));
    let what = || {
        let frame = format!("a frame of {}x{} with {layers} layers", view.width, view.height);
        if coefficients > 0 {
            format!("{frame} and the coefficients of the reconstruction")
        } else {
            frame
        }
    };
    let frames = frame_bytes(view, &setup.request).saturating_mul(2);
    isobar_cpu::require_memory(what, frames.saturating_add(coefficients))
}

/// Bytes of the f32 coefficients that reconstructions keep which are not their samples; methods make them before they draw. What they need beside them for a while is not
/// counted.
fn coefficient_bytes(setup: &Setup<'_>) -> u64 {
    let Data::Grid(grid) = &**setup.data else { return 0 };
    let Ok(knobs) = ResolvedKnobs::new(setup.method.info().knobs, &setup.request.knobs) else {
        return 0;
    };
    let named = knobs.iter().find(|(k, _)| *k == "reconstruction");
    let made = named.is_some_and(|(_, v)| {
        let r = v.to_string();
        r.ends_with("-interpolating") || r.ends_with("-prefiltered")
    });
    if made { 4 * grid.samples.len() as u64 } else { 0 }
}

impl Prepared {
    /// The method.
    #[must_use]
    pub fn method(&self) -> &'static dyn Method {
        self.method
    }

    /// The renderer, for further changes of its scene.
    pub fn renderer(&mut self) -> &mut dyn Renderer {
        self.renderer.as_mut()
    }

    /// The times of preparation.
    #[must_use]
    pub const fn timings(&self) -> &Timings {
        &self.timings
    }

    /// The function really drawn.
    #[must_use]
    pub fn function(&self) -> Option<Arc<dyn Function>> {
        self.renderer.reconstruction(Stage::Stored)
    }

    /// Draws once.
    ///
    /// # Errors
    /// What the renderer says.
    pub fn render(&mut self, stop: &Stop) -> Result<Sample, RenderError> {
        let _heard = self.method.info().gpu.then(crate::interrupt::watched);
        let cpu = machine::cpu_time();
        let start = Instant::now();
        let told = self.renderer.render(stop)?;
        Ok(Sample {
            wall: start.elapsed(),
            cpu: machine::cpu_time().saturating_sub(cpu),
            device: told.device,
        })
    }
}

/// The time of one rendering.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Wall clock around the call.
    pub wall: Duration,
    /// Processor time of the process during the call, summed over threads.
    pub cpu: Duration,
    /// Device time.
    pub device: Option<Duration>,
}

/// How often to draw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Plan {
    /// Timed renderings of each entry, at least 1.
    pub repeats: usize,
    /// One untimed rendering before the timed ones (and again whenever an entry's knobs differ from those its renderer drew last).
    pub warm_up: bool,
    /// No further round is begun once this much time has passed; every entry has been drawn at least once then.
    pub budget: Option<Duration>,
}

impl Plan {
    /// n timed renderings, after a warm-up where n is more than 1.
    #[must_use]
    pub const fn repeats(n: usize) -> Self {
        Self {
            repeats: if n == 0 { 1 } else { n },
            warm_up: n > 1,
            budget: None,
        }
    }
}

/// One thing to measure: a prepared renderer, by position, and the settings to draw with.
#[derive(Debug, Clone, PartialEq)]
pub struct Entry {
    /// Position among the prepared renderers.
    pub renderer: usize,
    /// Settings; `None`: those it was opened with.
    pub knobs: Option<Knobs>,
}

#[derive(Default)]
struct Series {
    wall: Vec<f64>,
    cpu: Vec<f64>,
    device: Vec<f64>,
    first: Option<f64>,
    knobs: Option<f64>,
    outcome: Option<Outcome>,
}

/// Measures several entries interleaved, round by round, so that a drifting machine drifts for all of them. The outcomes come in the order
/// of the entries; one that fails does not stop the others.
///
/// # Panics
/// When an entry names a renderer that is not there.
pub fn interleaved(prepared: &mut [Prepared], entries: &[Entry], plan: Plan, stop: &Stop) -> Vec<Result<Outcome, RunError>> {
    interleaved_with(prepared, entries, plan, stop, &mut |_, _, frame| Some(frame))
}

/// What [`interleaved_with`] gives the first frame of each entry to: the entry's position, the function drawn, the frame. What it returns
/// is kept in the outcome.
pub type Visitor<'a> = dyn FnMut(usize, Option<&Arc<dyn Function>>, Frame) -> Option<Frame> + 'a;

/// As [`interleaved`], for many entries whose frames would not fit in memory together: `visit` looks at each first frame as it comes.
///
/// # Panics
/// When an entry names a renderer that is not there.
pub fn interleaved_with(
    prepared: &mut [Prepared],
    entries: &[Entry],
    plan: Plan,
    stop: &Stop,
    visit: &mut Visitor<'_>,
) -> Vec<Result<Outcome, RunError>> {
    let start = Instant::now();
    let mut series: Vec<Result<Series, RunError>> = entries.iter().map(|_| Ok(Series::default())).collect();
    let mut last_drawn: Vec<Option<usize>> = vec![None; prepared.len()];
    let mut scratch = Frame::default();
    for round in 0..plan.repeats.max(1) {
        if round > 0 && plan.budget.is_some_and(|b| start.elapsed() > b) {
            break;
        }
        for (i, entry) in entries.iter().enumerate() {
            let Ok(s) = &mut series[i] else { continue };
            let p = &mut prepared[entry.renderer];
            let changed = last_drawn[entry.renderer] != Some(i);
            last_drawn[entry.renderer] = Some(i);
            match measure(p, entry, s, changed, round, plan, stop, &mut scratch) {
                Err(e) => series[i] = Err(e),
                Ok(()) => {
                    if let Some(o) = s.outcome.as_mut().filter(|_| round == 0) {
                        let frame = std::mem::take(&mut o.frame);
                        o.frame = visit(i, o.function.as_ref(), frame).unwrap_or_default();
                    }
                }
            }
        }
    }
    series.into_iter().map(|s| s.and_then(finish)).collect()
}

fn finish(s: Series) -> Result<Outcome, RunError> {
    let mut out = s.outcome.ok_or(RenderError::NotReady("render"))?;
    out.timings.render = Stat::of(&s.wall);
    out.timings.cpu_render = Stat::of(&s.cpu);
    out.timings.device_render = Stat::of(&s.device);
    out.timings.first_render = s.first.unwrap_or_default();
    out.timings.knobs = s.knobs.unwrap_or_default();
    out.peak_bytes = machine::peak_bytes().unwrap_or(0);
    Ok(out)
}

#[expect(clippy::too_many_arguments, reason = "one step of the loop above, split off for its length")]
fn measure(
    p: &mut Prepared,
    entry: &Entry,
    s: &mut Series,
    changed: bool,
    round: usize,
    plan: Plan,
    stop: &Stop,
    scratch: &mut Frame,
) -> Result<(), RunError> {
    if changed {
        if let Some(knobs) = &entry.knobs {
            let mut seconds = 0.0;
            timed(&mut seconds, || p.renderer.set_knobs(knobs))?;
            s.knobs.get_or_insert(seconds);
        }
        if plan.warm_up {
            let sample = p.render(stop)?;
            s.first.get_or_insert(sample.wall.as_secs_f64());
        }
    }
    let sample = p.render(stop)?;
    s.first.get_or_insert(sample.wall.as_secs_f64());
    s.wall.push(sample.wall.as_secs_f64());
    s.cpu.push(sample.cpu.as_secs_f64());
    s.device.extend(sample.device.map(|d| d.as_secs_f64()));
    if let Some(o) = &s.outcome {
        p.renderer.read(scratch)?;
        if digest(scratch) != o.digest {
            return Err(RunError::Unequal {
                method: p.method.info().id,
                repeat: round + 1,
            });
        }
    } else {
        let mut timings = p.timings;
        let mut frame = Frame::default();
        timed(&mut timings.read, || p.renderer.read(&mut frame))?;
        s.outcome = Some(Outcome {
            digest: digest(&frame),
            frame,
            timings,
            memory: p.renderer.memory(),
            peak_bytes: 0,
            counters: p.renderer.counters(),
            function: p.function(),
        });
    }
    Ok(())
}

/// Draws one scene `repeats` times (at least once; more than once after a warm-up).
///
/// # Errors
/// What the method refuses or fails at, or [`RunError::Unequal`].
pub fn run(setup: &Setup<'_>, repeats: usize, stop: &Stop) -> Result<Outcome, RunError> {
    let mut prepared = [prepare(setup)?];
    let entry = Entry {
        renderer: 0,
        knobs: None,
    };
    let mut out = interleaved(&mut prepared, &[entry], Plan::repeats(repeats), stop);
    out.pop().unwrap_or(Err(RunError::Render(RenderError::NotReady("render"))))
}

/// A hash of the bits of t, surface, normal, colour, hits and claims of all layers; work is left out. Equal frames have equal hashes.
#[must_use]
pub fn digest(frame: &Frame) -> u64 {
    let mut h = DefaultHasher::new();
    (frame.width, frame.height, frame.layers, frame.channels.bits()).hash(&mut h);
    bytemuck::cast_slice::<f64, u8>(&frame.t).hash(&mut h);
    for x in frame.point.iter().flat_map(|p| p.to_array()) {
        h.write_u64(x.to_bits());
    }
    bytemuck::cast_slice::<f64, u8>(&frame.t_error).hash(&mut h);
    bytemuck::cast_slice::<[f32; 3], u8>(&frame.normal).hash(&mut h);
    bytemuck::cast_slice::<[f32; 4], u8>(&frame.rgba).hash(&mut h);
    frame.surface.hash(&mut h);
    frame.hits.hash(&mut h);
    frame.claim.iter().for_each(|c| h.write_u8(c.bits()));
    h.finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use isobar_core::{DVec3, Grid, Samples};

    fn data() -> Arc<Data> {
        let samples: Vec<f32> = (0..512)
            .map(|i| {
                let p = DVec3::new((i % 8) as f64, (i / 8 % 8) as f64, (i / 64) as f64) - DVec3::splat(3.5);
                p.length() as f32
            })
            .collect();
        Arc::new(Data::Grid(Grid::unit([8; 3], Samples::F32(samples.into())).unwrap()))
    }

    fn setup<'a>(data: &'a Arc<Data>, surfaces: &'a [Surface], view: &'a View, knobs: Knobs) -> Setup<'a> {
        Setup {
            method: crate::method("march/cpu").unwrap(),
            data,
            surfaces,
            medium: None,
            view,
            request: Request {
                knobs,
                ..Request::default()
            },
        }
    }

    #[test]
    fn statistics_are_medians() {
        assert_eq!(
            Stat::of(&[3.0, 1.0, 10.0]),
            Stat {
                median: 3.0,
                mad: 2.0,
                n: 3
            }
        );
        assert_eq!(Stat::of(&[1.0, 2.0]).median, 1.5);
        assert_eq!(Stat::of(&[]), Stat::default());
    }

    #[test]
    fn a_run_is_repeated_and_its_parts_are_timed() {
        let (data, surfaces) = (data(), [Surface::isovalue(2.0, 0)]);
        let view = View::fit(data.bounds(), 40.0, 24, 24);
        let o = run(&setup(&data, &surfaces, &view, Knobs::default()), 3, &Stop::default()).unwrap();
        assert_eq!((o.timings.render.n, o.timings.cpu_render.n), (3, 3));
        assert!(o.timings.first_render > 0.0 && o.timings.render.median > 0.0);
        assert_eq!(o.frame.t.len(), 576);
        assert!(o.frame.t.iter().any(|t| t.is_finite()));
        assert_eq!(o.digest, digest(&o.frame));
        assert_eq!(o.function.unwrap().name(), "trilinear");
    }

    #[test]
    fn settings_are_interleaved_and_failures_stay_alone() {
        let (data, surfaces) = (data(), [Surface::isovalue(2.0, 0)]);
        let view = View::fit(data.bounds(), 40.0, 16, 16);
        let mut prepared = [prepare(&setup(&data, &surfaces, &view, Knobs::default())).unwrap()];
        let entry = |step: &str| Entry {
            renderer: 0,
            knobs: Some(Knobs::default().with("step", step)),
        };
        let mut seen = vec![];
        let out = interleaved_with(
            &mut prepared,
            &[entry("0.5"), entry("no number"), entry("0.25")],
            Plan::repeats(2),
            &Stop::default(),
            &mut |i, f, frame| {
                seen.push((i, f.is_some(), frame.t.len()));
                None
            },
        );
        assert_eq!(seen, [(0, true, 256), (2, true, 256)]);
        assert!(out[0].is_ok() && out[2].is_ok());
        assert!(matches!(out[1], Err(RunError::Render(RenderError::Knob { .. }))));
        assert!(out[0].as_ref().unwrap().frame.t.is_empty(), "the visitor kept it");
    }

    #[test]
    fn images_beyond_the_memory_are_refused() {
        let (data, surfaces) = (data(), [Surface::isovalue(2.0, 0)]);
        let view = View::fit(data.bounds(), 40.0, 16_384, 16_384);
        let mut s = setup(&data, &surfaces, &view, Knobs::default());
        s.request.layers = 65_535;
        assert_eq!(frame_bytes(&view, &s.request), (1 << 28) * (65_535 * 21 + 16));
        if isobar_cpu::available_bytes().is_some() {
            assert!(matches!(prepare(&s), Err(RenderError::Memory { .. })));
        }
    }

    #[test]
    fn coefficients_are_counted_where_they_are_made() {
        let (data, surfaces) = (data(), [Surface::isovalue(2.0, 0)]);
        let view = View::fit(data.bounds(), 40.0, 16, 16);
        let bytes = |method: &str, reconstruction: &str| {
            let mut s = setup(
                &data,
                &surfaces,
                &view,
                Knobs::default().with("reconstruction", reconstruction),
            );
            s.method = crate::method(method).unwrap();
            coefficient_bytes(&s)
        };
        assert_eq!(bytes("march/cpu", "trilinear"), 0);
        assert_eq!(bytes("octree/cpu", "cubic"), 0);
        assert_eq!(bytes("octree/cpu", "cubic-interpolating"), 4 * 512);
        assert_eq!(bytes("tetspline/cpu", "type6-prefiltered"), 4 * 512);
    }

    #[test]
    fn digests_tell_frames_apart() {
        let mut a = Frame::new(2, 2, 1, Channels::T);
        let b = digest(&a);
        a.t[3] = 1.0;
        assert_ne!(digest(&a), b);
    }
}
