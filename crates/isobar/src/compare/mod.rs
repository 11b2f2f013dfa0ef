//! Every method that can, side by side, at one scene: measured interleaved, checked against the certified truth, ranked at equal error.

mod page;
mod plot;

pub use page::{page, table_csv, table_text, verdict};
pub use plot::curve;

use crate::checking::{self, Check};
use crate::output::{self, Picture};
use crate::run::{self, Entry, Outcome, Plan, Prepared, Setup, Stat};
use crate::settings;
use crate::truth::Truths;
use anyhow::{Context, Result};
use isobar_core::{Channels, Frame, Knobs, Memory, Method, MethodInfo, Request, ResolvedKnobs, Stop, Surface, View};
use std::time::Duration;

use crate::source::Source;

/// What is compared.
#[derive(Debug)]
pub struct Scene<'a> {
    /// The data.
    pub source: &'a Source,
    /// The surfaces.
    pub surfaces: &'a [Surface],
    /// The view.
    pub view: &'a View,
    /// Knobs for the methods that have them.
    pub knobs: &'a Knobs,
    /// Worker threads; 0: all.
    pub threads: usize,
}

/// How the comparison is made.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// Sweep each method's quality knob, and rank what stays within this error, in voxels.
    pub max_error: Option<f64>,
    /// Timed renderings of each row.
    pub repeats: usize,
    /// No further round of timing is begun after this long.
    pub budget: Duration,
}

/// A method at a setting.
#[derive(Debug)]
pub struct Row {
    /// The method.
    pub method: &'static MethodInfo,
    /// The sweep knob and its value, `step=0.5`; `default` without a sweep.
    pub setting: String,
    /// All settings.
    pub knobs: String,
    /// What was measured, or why nothing was.
    pub result: Result<Measured, String>,
}

/// What was measured of a row.
#[derive(Debug)]
pub struct Measured {
    /// Name of the function drawn.
    pub reconstruction: String,
    /// Opening, data, surfaces, view and settings: seconds before the first image, without drawing it.
    pub prepare: f64,
    /// The first rendering, seconds.
    pub first_render: f64,
    /// Rendering, seconds.
    pub render: Stat,
    /// Processor time of rendering.
    pub cpu: Stat,
    /// Device time; n is 0 without a device.
    pub device: Stat,
    /// Memory beyond the source and the frame.
    pub memory: Memory,
    /// Against the truth; `None` where the method gives only colour.
    pub check: Option<Check>,
    /// The image and the errors.
    pub pictures: Pictures,
}

/// Pictures of a row, as PNG.
#[derive(Debug, Default)]
pub struct Pictures {
    /// The image.
    pub image: Vec<u8>,
    /// The error of each pixel; empty where the method gives only colour.
    pub errors: Vec<u8>,
}

impl Measured {
    /// Whether every pixel is right, no claim is refuted, and every t lies within `voxels` of the truth.
    #[must_use]
    pub fn within(&self, voxels: f64) -> bool {
        // Without any hit there is no error: the maximum is NaN.
        self.check.as_ref().is_some_and(|c| {
            let max = c.t_error_voxels.max;
            c.is_clean() && (max.is_nan() || max <= voxels)
        })
    }
}

/// The rows, in the order of the list of methods, and their order at equal error.
#[derive(Debug)]
pub struct Comparison {
    /// One per method and setting.
    pub rows: Vec<Row>,
    /// Rows within the error asked for, fastest first: positions in `rows`. Empty without a maximum.
    pub ranking: Vec<usize>,
}

impl Comparison {
    /// The row that comes nearest to being right: fewest wrong pixels, then the smallest greatest error.
    #[must_use]
    pub fn closest(&self) -> Option<&Row> {
        let key = |r: &&Row| {
            let c = r.result.as_ref().ok()?.check.as_ref()?;
            Some((checking::wrong(c) + c.refuted, c.t_error_voxels.max))
        };
        let checked = self.rows.iter().filter_map(|r| Some((r, key(&r)?)));
        checked
            .min_by(|(_, a), (_, b)| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)))
            .map(|(r, _)| r)
    }

    /// For each method the row to show: its best ranked one, else the most accurate one, else the first.
    #[must_use]
    pub fn shown(&self) -> Vec<usize> {
        let mut ids: Vec<&str> = self.rows.iter().map(|r| r.method.id).collect();
        ids.dedup();
        let of = |id: &str| {
            (0..self.rows.len())
                .filter(move |&i| self.rows[i].method.id == id)
                .collect::<Vec<_>>()
        };
        ids.iter()
            .map(|id| {
                let rows = of(id);
                let ranked = self.ranking.iter().find(|i| rows.contains(i)).copied();
                let key = |i: &usize| {
                    let checked = self.rows[*i].result.as_ref().ok().and_then(|m| m.check.as_ref());
                    checked.map_or((usize::MAX, f64::MAX), |c| (checking::wrong(c), c.t_error_voxels.p99))
                };
                let best = rows
                    .iter()
                    .copied()
                    .min_by(|a, b| key(a).partial_cmp(&key(b)).unwrap_or(std::cmp::Ordering::Equal));
                ranked.or(best).unwrap_or_default()
            })
            .collect()
    }
}

/// Which knobs of `given` a method has.
fn own_knobs(method: &dyn Method, given: &Knobs) -> Knobs {
    let specs = method.info().knobs;
    Knobs(
        given
            .0
            .iter()
            .filter(|(name, _)| specs.iter().any(|s| s.name == name.as_str()))
            .map(|(n, v)| (n.clone(), v.clone()))
            .collect(),
    )
}

/// The settings of a method to measure: its default, and with a sweep the values of its sweep knob; each once.
fn variants(method: &dyn Method, base: &Knobs, sweep: bool) -> Vec<(String, Knobs)> {
    let (knob, values) = method.info().sweep;
    let fixed = base.0.contains_key(knob);
    if !sweep || knob.is_empty() || fixed {
        let name = base
            .0
            .get(knob)
            .map_or_else(|| "default".to_owned(), |v| format!("{knob}={v}"));
        return vec![(name, base.clone())];
    }
    let resolved = |k: &Knobs| ResolvedKnobs::new(method.info().knobs, k).ok();
    let mut out: Vec<(String, Knobs)> = values
        .iter()
        .map(|v| (format!("{knob}={v}"), base.clone().with(knob, v)))
        .collect();
    if !out.iter().any(|(_, k)| resolved(k) == resolved(base)) {
        out.insert(0, ("default".to_owned(), base.clone()));
    }
    out
}

struct Candidate {
    row: usize,
    entry: Entry,
}

/// Channels a comparison asks for.
fn channels(info: &MethodInfo) -> Channels {
    if info.hits {
        checking::CHANNELS | Channels::RGBA
    } else {
        Channels::RGBA
    }
}

/// Measures the methods. Methods that cannot draw the scene, fail, or draw different images in different repetitions are rows with the
/// reason. Every image is checked before it is timed, and every timed image must be the checked one.
///
/// # Errors
/// When the truth cannot be computed.
pub fn compare(
    methods: &[&'static dyn Method],
    scene: &Scene<'_>,
    settings: Settings,
    truths: &Truths,
    stop: &Stop,
) -> Result<Comparison> {
    let mut rows = Vec::new();
    let mut prepared: Vec<Prepared> = Vec::new();
    let mut candidates = Vec::new();
    for &method in methods {
        let info = method.info();
        let base = own_knobs(method, scene.knobs);
        let setup = Setup {
            method,
            data: &scene.source.data,
            surfaces: scene.surfaces,
            medium: None,
            view: scene.view,
            request: Request {
                channels: channels(info),
                threads: scene.threads,
                knobs: base.clone(),
                ..Request::default()
            },
        };
        match run::prepare(&setup) {
            Err(e) => rows.push(Row {
                method: info,
                setting: "default".into(),
                knobs: String::new(),
                result: Err(e.to_string()),
            }),
            Ok(p) => {
                prepared.push(p);
                for (setting, knobs) in variants(method, &base, settings.max_error.is_some()) {
                    candidates.push(Candidate {
                        row: rows.len(),
                        entry: Entry {
                            renderer: prepared.len() - 1,
                            knobs: Some(knobs.clone()),
                        },
                    });
                    rows.push(Row {
                        method: info,
                        setting,
                        knobs: ResolvedKnobs::new(info.knobs, &knobs).map_or(String::new(), |k| settings::knobs_text(&k)),
                        result: Err("not measured".into()),
                    });
                }
            }
        }
    }
    measure(&mut rows, &mut prepared, &candidates, scene, settings, truths, stop)?;
    let ranking = settings.max_error.map_or_else(Vec::new, |e| rank(&rows, e));
    Ok(Comparison { rows, ranking })
}

/// Rows within the error, fastest first by the median wall-clock time of rendering.
fn rank(rows: &[Row], max_error: f64) -> Vec<usize> {
    let time = |i: &usize| rows[*i].result.as_ref().map_or(f64::INFINITY, |m| m.render.median);
    let mut out: Vec<usize> = (0..rows.len())
        .filter(|&i| rows[i].result.as_ref().is_ok_and(|m| m.within(max_error)))
        .collect();
    out.sort_by(|a, b| time(a).total_cmp(&time(b)));
    out
}

fn measure(
    rows: &mut [Row],
    prepared: &mut [Prepared],
    candidates: &[Candidate],
    scene: &Scene<'_>,
    settings: Settings,
    truths: &Truths,
    stop: &Stop,
) -> Result<()> {
    let entries: Vec<Entry> = candidates.iter().map(|c| c.entry.clone()).collect();
    let mut verified: Vec<Option<(Option<Check>, Pictures)>> = candidates.iter().map(|_| None).collect();
    let mut failed = None;
    let first = run::interleaved_with(prepared, &entries, Plan::repeats(1), stop, &mut |i, function, frame| {
        match verify(&frame, function, scene, truths, stop) {
            Ok(v) => verified[i] = Some(v),
            Err(e) => failed = Some(e),
        }
        None
    });
    if let Some(e) = failed {
        return Err(e).context("the certified truth");
    }
    // Rows that failed once are not timed; the others keep their positions.
    let good: Vec<usize> = (0..first.len()).filter(|&i| first[i].is_ok()).collect();
    let timed_entries: Vec<Entry> = good.iter().map(|&i| entries[i].clone()).collect();
    let plan = Plan {
        repeats: settings.repeats,
        warm_up: true,
        budget: Some(settings.budget),
    };
    let timed = run::interleaved_with(prepared, &timed_entries, plan, stop, &mut |_, _, _| None);
    for (i, outcome) in first.iter().enumerate().filter(|(i, _)| !good.contains(i)) {
        let reason = outcome.as_ref().err().map_or_else(String::new, ToString::to_string);
        rows[candidates[i].row].result = Err(reason);
    }
    for (&i, timed) in good.iter().zip(timed) {
        let first = first[i].as_ref().ok();
        let row = &mut rows[candidates[i].row];
        row.result = match (timed, first, verified[i].take()) {
            (Ok(t), Some(f), Some((check, pictures))) if t.digest == f.digest => Ok(measured(&t, f, check, pictures)),
            (Ok(_), ..) => Err("the timed image is not the checked one; its times are not reported".into()),
            (Err(e), ..) => Err(e.to_string()),
        };
    }
    Ok(())
}

fn measured(timed: &Outcome, first: &Outcome, check: Option<Check>, pictures: Pictures) -> Measured {
    let t = &timed.timings;
    Measured {
        reconstruction: timed
            .function
            .as_ref()
            .map_or_else(|| "none to tell".to_owned(), |f| f.name()),
        prepare: t.open + t.data + t.surfaces + t.view + first.timings.knobs,
        first_render: first.timings.first_render,
        render: t.render,
        cpu: t.cpu_render,
        device: t.device_render,
        memory: timed.memory,
        check,
        pictures,
    }
}

fn verify(
    frame: &Frame,
    function: Option<&std::sync::Arc<dyn isobar_core::Function>>,
    scene: &Scene<'_>,
    truths: &Truths,
    stop: &Stop,
) -> Result<(Option<Check>, Pictures)> {
    let image = output::encode_png(&output::frame_picture(frame))?;
    let Some(function) = function.filter(|_| frame.channels.contains(Channels::T)) else {
        return Ok((None, Pictures { image, errors: vec![] }));
    };
    let truth = truths.get(function, scene.surfaces, scene.view, stop)?;
    let check = isobar_oracle::check(frame, &truth, function, scene.surfaces, scene.view)?;
    let errors = output::encode_png(&checking::picture(&check, frame.width, frame.height))?;
    Ok((Some(checking::summary(check)), Pictures { image, errors }))
}

/// A legend of the colours of an error map.
#[must_use]
pub fn error_scale() -> Picture {
    output::colour_bar(256, 12)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sweeps_have_every_setting_once() {
        let m = crate::method("march/cpu").unwrap();
        let n = m.info().sweep.1.len();
        let all = variants(m, &Knobs::default(), true);
        assert!(all.len() == n || all.len() == n + 1);
        let mut resolved: Vec<_> = all
            .iter()
            .map(|(_, k)| settings::knobs_text(&settings::resolve(m, k).unwrap()))
            .collect();
        resolved.sort();
        resolved.dedup();
        assert_eq!(resolved.len(), all.len());
        assert_eq!(variants(m, &Knobs::default(), false).len(), 1);
        assert_eq!(
            variants(m, &Knobs::default().with("step", 1), true).len(),
            1,
            "a given value is not swept"
        );
    }

    #[test]
    fn a_knob_goes_only_to_methods_that_have_it() {
        let m = crate::method("march/cpu").unwrap();
        let given = Knobs::default().with("step", 1).with("nothing", 2);
        assert_eq!(own_knobs(m, &given), Knobs::default().with("step", 1));
    }
}
