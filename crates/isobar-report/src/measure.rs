//! Measuring one definition: all methods on each reconstruction, interleaved, every timed frame verified pixel by pixel.

use crate::definitions::{Definition, ViewSpec};
use crate::models;
use crate::results::{Checked, Colour, Comparison, Pictures, Row, Scene, Spread, Stat, Storage, Truth};
use anyhow::{Context, Result};
use isobar::checking;
use isobar::run::{self, Entry, Plan, Prepared, Setup};
use isobar::source::{self, Source};
use isobar::truth::Truths;
use isobar::{output, surfaces, view_spec};
use isobar_core::{
    Channels, DVec3, Data, Frame, Function, KnobKind, Knobs, Method, MethodInfo, Request, ResolvedKnobs, Stage, Stop, Surface,
    TransferFunction, View,
};
use isobar_oracle::{Check, Difference, Quantiles};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

mod colours;
pub mod peak;
mod stages;
mod storage;

pub(crate) use stages::METHOD as STAGED;

/// How a run measures.
#[derive(Debug, Clone)]
pub struct Settings {
    /// The repository's root.
    pub root: PathBuf,
    /// Where the page and its files are being made.
    pub stage: PathBuf,
    /// Where certified frames are kept.
    pub truths: PathBuf,
    /// Twice the width and height, a whole orbit, more repetitions.
    pub full: bool,
}

impl Settings {
    /// Timed repetitions of each row.
    const fn repeats(&self) -> usize {
        if self.full { 15 } else { 5 }
    }

    /// No further round of a comparison begins after this.
    const fn budget(&self) -> Duration {
        Duration::from_secs(if self.full { 60 } else { 3 })
    }
}

/// The default of a reconstruction knob's absence: what methods draw that have no such knob.
const ONLY: &str = "trilinear";

/// Everything a comparison needs.
pub(crate) struct Job<'a> {
    pub(crate) source: &'a Source,
    pub(crate) surfaces: &'a [Surface],
    pub(crate) medium: Option<&'a TransferFunction>,
    pub(crate) view: &'a View,
    pub(crate) settings: &'a Settings,
    exact: colours::Exact,
    truths: &'a Truths,
    definition: &'a Definition,
}

/// Measures a definition. A scene that cannot be measured has a reason.
///
/// # Errors
/// When files of the page cannot be written.
pub fn scene(d: &Definition, methods: &[&'static dyn Method], settings: &Settings, stop: &Stop) -> Result<Scene> {
    let start = Instant::now();
    let scale = if settings.full && d.doubles() { 2 } else { 1 };
    let mut out = Scene {
        id: d.id.clone(),
        group: d.group.clone(),
        title: d.title.clone(),
        analysis: d.analysis.clone(),
        isovalues: d.isovalues.clone(),
        medium: d.medium.clone(),
        view: view_words(&d.view),
        size: d.size.map(|n| n * scale),
        ..Scene::default()
    };
    let opened = d
        .source(&settings.root)
        .and_then(|name| open(d, &name, out.size).map_err(|e| format!("{e:#}")));
    let (source, surfaces, view) = match opened {
        Ok(o) => o,
        Err(reason) => {
            out.skipped = Some(reason);
            return Ok(out);
        }
    };
    let medium = match d
        .medium
        .as_deref()
        .map(|m| load_medium(&settings.root.join(m), &source))
        .transpose()
    {
        Ok(m) => m,
        Err(e) => {
            out.skipped = Some(format!("{e:#}"));
            return Ok(out);
        }
    };
    out.data = data_words(&source);
    source.hash().clone_into(&mut out.data_hash);
    let truths = Truths::new(source.hash(), Some(settings.truths.clone()));
    let job = Job {
        source: &source,
        surfaces: &surfaces,
        medium: medium.as_ref(),
        view: &view,
        settings,
        exact: colours::Exact::default(),
        truths: &truths,
        definition: d,
    };
    for reconstruction in &d.reconstructions {
        out.comparisons.push(job.comparison(reconstruction, methods, stop)?);
    }
    if let Some(first) = out.comparisons.first_mut().filter(|_| d.medium.is_none()) {
        peak::measure(first, d, &source, settings.full);
    }
    out.seconds = start.elapsed().as_secs_f64();
    Ok(out)
}

/// Data, surfaces and view of a definition at an image size.
///
/// # Errors
/// The line that stands in place of numbers.
pub(crate) fn open(d: &Definition, name: &str, size: [usize; 2]) -> Result<(Source, Vec<Surface>, View)> {
    let options = isobar_io::Options {
        field: d.field.clone(),
        ..isobar_io::Options::default()
    };
    let source = source::open(name, &options)?;
    source.require_finite()?;
    let [w, h] = size;
    let view = match &d.view {
        ViewSpec::Name(name) => view_spec::named(name, source.bounds(), 40.0, w, h)?,
        ViewSpec::Camera { eye, target, up, fov } => {
            let v = DVec3::from_array;
            View::perspective(v(*eye), v(*target), v(*up), *fov, w, h)
        }
    };
    view.validate()?;
    let surfaces = d
        .isovalues
        .iter()
        .enumerate()
        .map(|(i, v)| Surface::isovalue(*v, i))
        .collect();
    Ok((source, surfaces, view))
}

/// A transfer function, as `--tf` reads it.
fn load_medium(path: &Path, source: &Source) -> Result<TransferFunction> {
    let (lo, hi) = source.bounds();
    surfaces::load_transfer(path, (hi - lo).max_element())
}

fn view_words(v: &ViewSpec) -> String {
    match v {
        ViewSpec::Name(n) => n.clone(),
        ViewSpec::Camera { eye, target, .. } => format!(
            "from {}, {}, {} to {}, {}, {}",
            eye[0], eye[1], eye[2], target[0], target[1], target[2]
        ),
    }
}

/// `256×256×256 samples, f32, 64.0 MiB`.
fn data_words(s: &Source) -> String {
    let bytes = crate::page::bytes(s.data.bytes() as u64);
    match s.dims() {
        Some([x, y, z]) => format!("{x}×{y}×{z} samples, {}, {bytes}", s.type_name()),
        None => format!("{} {}, {bytes}", s.cells(), s.data.kind()),
    }
}

/// Whether a method offers this reconstruction of a grid; `None` where it has no such knob.
fn offers(m: &dyn Method, reconstruction: &str) -> Option<bool> {
    match m.info().knobs.iter().find(|k| k.name == "reconstruction")?.kind {
        KnobKind::Choice(words) => Some(words.contains(&reconstruction)),
        _ => None,
    }
}

/// Whether a method draws this reconstruction. Data that are no grid are drawn as they are: there the word is only a title.
fn draws(m: &dyn Method, reconstruction: &str, data: &Data) -> bool {
    !matches!(data, Data::Grid(_)) || offers(m, reconstruction).unwrap_or(reconstruction == ONLY)
}

/// What the check of a frame gives.
struct Verified {
    checked: Checked,
    colour: Option<Colour>,
    truth: Truth,
    pictures: Option<Pictures>,
}

/// One row to measure.
struct Candidate {
    row: usize,
    knobs: Knobs,
    entry: Entry,
}

impl Job<'_> {
    /// The settings all rows of a method share.
    pub(crate) fn knobs(m: &dyn Method, reconstruction: &str) -> Knobs {
        let mut k = Knobs::default();
        if offers(m, reconstruction) == Some(true) {
            k.set("reconstruction", reconstruction);
        }
        k
    }

    pub(crate) fn setup<'b>(&'b self, method: &'static dyn Method, knobs: Knobs, channels: Channels) -> Setup<'b> {
        Setup {
            method,
            data: &self.source.data,
            surfaces: self.surfaces,
            medium: self.medium,
            view: self.view,
            request: Request {
                channels,
                knobs,
                ..Request::default()
            },
        }
    }

    fn comparison(&self, reconstruction: &str, methods: &[&'static dyn Method], stop: &Stop) -> Result<Comparison> {
        let mut out = Comparison {
            reconstruction: reconstruction.into(),
            ..Comparison::default()
        };
        let chosen: Vec<&'static dyn Method> = (methods.iter().copied())
            .filter(|m| self.definition.wants(m.info().id) && draws(*m, reconstruction, &self.source.data))
            .collect();
        let mut prepared: Vec<Prepared> = Vec::new();
        let mut candidates = Vec::new();
        for m in &chosen {
            for (setting, default, knobs) in self.variants(*m, reconstruction) {
                let kept = knobs.clone();
                let row = Row {
                    setting,
                    default,
                    ..refused(m.info(), "not measured")
                };
                // A renderer for each setting: what depends on the setting is prepared once, not before every frame.
                match run::prepare(&self.setup(*m, knobs, timed_channels(m.info()))) {
                    Err(e) => {
                        let reason = e.to_string();
                        // What a method refuses at its default it refuses at every setting: one row says it.
                        if !out
                            .rows
                            .iter()
                            .any(|r| r.method == row.method && r.reason.as_ref() == Some(&reason))
                        {
                            out.rows.push(Row {
                                reason: Some(reason),
                                ..row
                            });
                        }
                    }
                    Ok(p) => {
                        let entry = Entry {
                            renderer: prepared.len(),
                            knobs: None,
                        };
                        prepared.push(p);
                        candidates.push(Candidate {
                            row: out.rows.len(),
                            knobs: kept,
                            entry,
                        });
                        out.rows.push(row);
                    }
                }
            }
        }
        self.measure(&mut out, &mut prepared, &candidates, stop)?;
        if self.medium.is_none() {
            self.storage(&mut out, &mut prepared, &candidates, stop)?;
        }
        drop(prepared);
        out.stages = self.stages(&out, stop)?;
        for m in &chosen {
            if out
                .rows
                .iter()
                .any(|r| r.method == m.info().id && r.default && r.reason.is_none())
            {
                self.work_map(&mut out, *m, reconstruction, stop)?;
                // The models ask for other isovalues and hold rays against their roots: they are about surfaces.
                if self.medium.is_none() {
                    out.models.extend(models::models(self, *m, reconstruction, &out.rows, stop));
                }
            }
        }
        self.failures(&mut out);
        Ok(out)
    }

    /// The default setting and the sweep of a method, each once: text, whether it is the default, knobs.
    fn variants(&self, m: &dyn Method, reconstruction: &str) -> Vec<(String, bool, Knobs)> {
        let base = Self::knobs(m, reconstruction);
        let (knob, values) = m.info().sweep;
        let own = || values.iter().map(|v| format!("{knob}={v}")).collect();
        let settings: Vec<String> = self.definition.settings(m.info().id).cloned().unwrap_or_else(own);
        let resolved = |k: &Knobs| ResolvedKnobs::new(m.info().knobs, k).ok();
        let mut out: Vec<_> = (settings.into_iter())
            .map(|s| {
                let mut k = base.clone();
                for (knob, value) in s.split_whitespace().filter_map(|p| p.split_once('=')) {
                    k.set(knob, value);
                }
                let default = resolved(&k) == resolved(&base);
                (s, default, k)
            })
            .collect();
        if !out.iter().any(|(_, default, _)| *default) {
            out.insert(0, ("default".to_owned(), true, base));
        }
        out
    }

    fn measure(&self, out: &mut Comparison, prepared: &mut [Prepared], candidates: &[Candidate], stop: &Stop) -> Result<()> {
        let entries: Vec<Entry> = candidates.iter().map(|c| c.entry.clone()).collect();
        let mut checks: Vec<Option<(Checked, Option<Colour>)>> = vec![None; entries.len()];
        let mut failed = None;
        let rows = out.rows.clone();
        let mut truth = Truth::default();
        let mut pictures = Vec::new();
        // Every frame is checked before it is timed.
        let first = run::interleaved_with(prepared, &entries, Plan::repeats(1), stop, &mut |i, function, frame| {
            let (row, knobs) = (&rows[candidates[i].row], &candidates[i].knobs);
            let done = self.verify(&frame, function, (row, knobs), out.reconstruction.as_str(), stop);
            match done {
                Ok(v) => {
                    checks[i] = Some((v.checked, v.colour));
                    // Settings of one method may draw other surfaces of a medium, or none: the facts are those of the defaults.
                    if row.default || truth.pixels == 0 {
                        truth = v.truth;
                    }
                    pictures.extend(v.pictures);
                }
                Err(e) => failed = Some(e),
            }
            None
        });
        if let Some(e) = failed {
            return Err(e);
        }
        (out.truth, out.pictures) = (truth, pictures);
        let good: Vec<usize> = (0..first.len()).filter(|&i| first[i].is_ok()).collect();
        let timed_entries: Vec<Entry> = good.iter().map(|&i| entries[i].clone()).collect();
        let plan = Plan {
            repeats: self.settings.repeats(),
            warm_up: true,
            budget: Some(self.settings.budget()),
        };
        let timed = run::interleaved_with(prepared, &timed_entries, plan, stop, &mut |_, _, _| None);
        for (i, f) in first.iter().enumerate() {
            if let Err(e) = f {
                out.rows[candidates[i].row].reason = Some(e.to_string());
            }
        }
        for (&i, t) in good.iter().zip(timed) {
            let row = &mut out.rows[candidates[i].row];
            match (t, &first[i], checks[i]) {
                (Ok(t), Ok(f), Some((checked, colour))) if t.digest == f.digest => {
                    fill(row, &t, checked);
                    row.colour = colour;
                }
                (Ok(_), ..) => row.reason = Some("the timed image is not the checked one; its times are not reported".into()),
                (Err(e), ..) => row.reason = Some(e.to_string()),
            }
        }
        Ok(())
    }

    /// What storing the coefficients moves, for every row that was drawn; settings of one function share the answer.
    fn storage(&self, out: &mut Comparison, prepared: &mut [Prepared], candidates: &[Candidate], stop: &Stop) -> Result<()> {
        let mut known: Vec<([String; 2], Storage)> = Vec::new();
        for c in candidates {
            if out.rows[c.row].reason.is_some() {
                continue;
            }
            let p = &mut prepared[c.entry.renderer];
            let Some(stored) = p.function() else { continue };
            let Some(ideal) = p.renderer().reconstruction(Stage::Ideal) else {
                continue;
            };
            let key = |f: &Arc<dyn Function>| isobar::truth::key(f.as_ref(), self.surfaces, self.view, "");
            let keys = [key(&stored), key(&ideal)];
            let found = known.iter().find(|(k, _)| *k == keys).map(|(_, s)| *s);
            let storage = match found {
                Some(s) => s,
                None if keys[0] == keys[1] => Storage {
                    same: true,
                    ..Storage::default()
                },
                None => {
                    let get = |f| {
                        self.truths
                            .get(f, self.surfaces, self.view, stop)
                            .context("the certified truth")
                    };
                    let (a, b) = (get(&stored)?, get(&ideal)?);
                    storage::compare(&a, &b, self.view, stored.domain().voxel())
                }
            };
            known.push((keys, storage));
            out.rows[c.row].storage = Some(storage);
        }
        Ok(())
    }

    /// Checks a frame; draws its pictures where it is that of a default setting.
    fn verify(
        &self,
        frame: &Frame,
        function: Option<&Arc<dyn Function>>,
        (row, knobs): (&Row, &Knobs),
        reconstruction: &str,
        stop: &Stop,
    ) -> Result<Verified> {
        let function = function.with_context(|| format!("{} tells no function to check against", row.method))?;
        let method = isobar::method(&row.method)?;
        let judged = checking::judged(method, knobs, self.surfaces, self.medium);
        let start = Instant::now();
        let truth = self
            .truths
            .get(function, &judged, self.view, stop)
            .context("the certified truth")?;
        let seconds = start.elapsed().as_secs_f64();
        let check = isobar_oracle::check(frame, &truth, function, &judged, self.view).with_context(|| row.method.clone())?;
        let stages = truth.stages();
        let facts = Truth {
            pixels: truth.pixels.len() as u64,
            hits: truth.hits() as u64,
            undecidable: truth.undecidable() as u64,
            stages: [stages.f64 as u64, stages.dd as u64, stages.exact as u64],
            expected: self.definition.expected(reconstruction, [self.view.width, self.view.height]),
            seconds,
        };
        let pictures = if row.default {
            Some(self.pictures(frame, (!judged.is_empty()).then_some(&check), row, reconstruction)?)
        } else {
            None
        };
        Ok(Verified {
            checked: checked(&check, facts.hits),
            colour: self.colour(frame, function, (method, knobs), stop)?,
            truth: facts,
            pictures,
        })
    }

    /// File name of a picture, relative to the page.
    fn file(&self, row: &Row, reconstruction: &str, what: &str) -> String {
        let method = row.method.replace('/', "-");
        format!("files/{}/{reconstruction}-{method}-{what}.png", self.definition.id)
    }

    fn pictures(&self, frame: &Frame, check: Option<&Check>, row: &Row, reconstruction: &str) -> Result<Pictures> {
        let mut out = Pictures {
            method: row.method.clone(),
            setting: row.setting.clone(),
            image: self.file(row, reconstruction, "image"),
            ..Pictures::default()
        };
        self.write(&out.image, &output::frame_picture(frame))?;
        // A medium alone has no surface that could lie elsewhere.
        if let Some(check) = check {
            out.error = self.file(row, reconstruction, "error");
            self.write(&out.error, &checking::picture(check, frame.width, frame.height))?;
        }
        Ok(out)
    }

    fn write(&self, name: &str, picture: &output::Picture) -> Result<()> {
        let path = self.settings.stage.join(name);
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder).with_context(|| format!("{} cannot be made", folder.display()))?;
        }
        output::write_picture(&path, picture)
    }

    /// The work of every pixel, in a rendering of its own: counting costs time.
    fn work_map(&self, out: &mut Comparison, m: &'static dyn Method, reconstruction: &str, stop: &Stop) -> Result<()> {
        if m.info().work_unit.is_empty() {
            return Ok(());
        }
        let setup = self.setup(m, Self::knobs(m, reconstruction), Channels::T | Channels::WORK);
        let drawn = run::prepare(&setup).and_then(|mut p| {
            let mut frame = Frame::default();
            p.render(stop)?;
            p.renderer().read(&mut frame)?;
            Ok(frame)
        });
        // A method that cannot count has no map; its other pictures stay.
        let Ok(frame) = drawn else { return Ok(()) };
        let Some((picture, most)) = output::work_picture(&frame) else {
            return Ok(());
        };
        let total: u64 = frame.work.iter().map(|w| u64::from(*w)).sum();
        if total == 0 {
            return Ok(());
        }
        let Some(row) = out.rows.iter_mut().find(|r| r.method == m.info().id && r.default) else {
            return Ok(());
        };
        row.work = total;
        m.info().work_unit.clone_into(&mut row.work_unit);
        let name = self.file(row, reconstruction, "work");
        self.write(&name, &picture)?;
        if let Some(p) = out.pictures.iter_mut().find(|p| p.method == m.info().id) {
            p.work = name;
            p.work_most = f64::from(most);
            m.info().work_unit.clone_into(&mut p.work_unit);
        }
        Ok(())
    }

    /// What is not as the definition says.
    fn failures(&self, out: &mut Comparison) {
        let mut lines = Vec::new();
        let t = &out.truth;
        if t.expected.is_some_and(|e| e != t.hits) {
            lines.push(format!(
                "the oracle finds {} hits, the definition demands {}",
                t.hits,
                t.expected.unwrap_or_default()
            ));
        }
        // Wrong pixels are allowed at the definition's own size; four times as many pixels have four times as many.
        let scale = (t.pixels / (self.definition.size[0] * self.definition.size[1]).max(1) as u64).max(1);
        for r in out.rows.iter().filter(|r| r.default && r.reason.is_none()) {
            let allow = self.definition.allowed(&r.method, &out.reconstruction);
            let k = &r.checked;
            let pairs = [
                ("missed", k.missed, allow.missed),
                ("false", k.false_hits, allow.false_hits),
                ("on a wrong root", k.wrong_root, allow.wrong_root),
                ("on a wrong surface", k.wrong_surface, allow.wrong_surface),
                ("with refuted claims", k.refuted, 0),
            ];
            for (what, n, most) in pairs {
                if n > most * scale {
                    lines.push(format!("{} has {n} pixels {what}, {} allowed", r.method, most * scale));
                }
            }
        }
        out.failures = lines;
        let t = &out.truth;
        if t.pixels > 0 && t.undecidable * 1000 > t.pixels {
            let rate = 1e6 * t.undecidable as f64 / t.pixels as f64;
            out.remarks.push(format!("{rate:.0} pixels per million are undecidable, more than 1000: many rays graze the surface, or the isovalue is a data value"));
        }
    }
}

/// Channels of a timed rendering: what a check and a picture need.
pub(crate) fn timed_channels(info: &MethodInfo) -> Channels {
    let wanted = Channels::T | Channels::NORMAL | Channels::SURFACE | Channels::RGBA;
    if info.knobs.iter().any(|k| k.name == "claims") {
        wanted | checking::CHANNELS
    } else {
        wanted
    }
}

fn refused(info: &MethodInfo, reason: &str) -> Row {
    Row {
        method: info.id.into(),
        setting: "default".into(),
        default: true,
        reason: Some(reason.into()),
        ..Row::default()
    }
}

fn fill(row: &mut Row, o: &run::Outcome, checked: Checked) {
    row.reason = None;
    row.wall = o.timings.render.into();
    row.cpu = o.timings.cpu_render.into();
    let device: Stat = o.timings.device_render.into();
    row.device = (device.n > 0).then_some(device);
    row.checked = checked;
    let m = o.memory;
    row.memory = [m.coefficients, m.index, m.view, m.device];
    row.counters = o.counters.0.iter().map(|(name, n)| ((*name).to_owned(), *n)).collect();
}

/// A check as plain numbers; errors of a frame without right hits are 0.
pub(crate) fn checked(c: &Check, hits: u64) -> Checked {
    let n = |x: usize| x as u64;
    Checked {
        pixels: n(c.pixels),
        hits,
        missed: n(c.missed),
        false_hits: n(c.false_hits),
        wrong_root: n(c.wrong_root),
        wrong_surface: n(c.wrong_surface),
        refuted: n(c.refuted),
        undecidable: n(c.undecidable),
        unclaimed: n(c.unclaimed),
        t_voxels: spread(&c.t_error_voxels),
        t_pixels: spread(&c.t_error_pixels),
        normal_deg: spread(&c.normal_error_deg),
    }
}

/// Quantiles as plain numbers; 0 where there are no values.
fn spread(q: &Quantiles) -> Spread {
    let f = |x: f64| if x.is_finite() { x } else { 0.0 };
    Spread {
        median: f(q.median),
        p99: f(q.p99),
        max: f(q.max),
    }
}

/// Where certified frames are kept: under cargo's target folder.
#[must_use]
pub fn truth_folder(target: &Path) -> PathBuf {
    target.join("isobar-truth")
}

#[cfg(test)]
mod tests;
