//! `isobar check`: every pixel of a method against the certified truth.

use crate::checking::{self, Check, ColourCheck};
use crate::cli::{Answer, CheckArgs};
use crate::output::{self, Format};
use crate::run::{self, Prepared, Setup};
use crate::source::Source;
use crate::truth::{Random, Truths, cache_dir};
use crate::{progress, settings, surfaces};
use anyhow::{Context, Result, anyhow, ensure};
use isobar_core::{Channels, DVec3, Frame, Function, Method, Request, Stop, Surface, TransferFunction, View};
use isobar_oracle::{Colours, Reference};
use serde_json::{Value, json};
use std::path::Path;
use std::sync::Arc;

/// Size of the random views of `--rays` without `--size`: small, so that there are many.
const RANDOM_VIEW: (usize, usize) = (32, 24);
/// Most rays: the errors of all are kept until the end.
const MAX_RAYS: u64 = 100_000_000;

/// Checks. The answer is no where a claim is refuted; with `--strict` also where a pixel is wrong.
///
/// # Errors
/// When arguments or data cannot be used, or the method refuses, fails, or draws no function that can be told.
pub fn run(args: &CheckArgs) -> Result<Answer> {
    let method = crate::method(&args.method)?;
    ensure!(
        method.info().hits,
        "--method {}: it gives colour only, so there is no t to check; see isobar methods",
        args.method
    );
    let surfaces = surfaces::parse(&args.isovalue, &args.more)?;
    let knobs = settings::parse_knobs(&args.draw.set)?;
    settings::resolve(method, &knobs)?;
    args.view.validate()?;
    args.view.require_open_cuts()?;
    ensure!(
        args.rays.is_none_or(|n| (1..=MAX_RAYS).contains(&n)),
        "--rays {}: give a number from 1 to {MAX_RAYS}",
        args.rays.unwrap_or_default()
    );
    if let Some(p) = args.json.as_deref().filter(|p| *p != Path::new("-")) {
        output::probe("--json", p)?;
    }
    if let Some(p) = &args.map {
        ensure!(
            Format::of(p).ok() == Some(Format::Png),
            "--map {}: end the name in .png",
            p.display()
        );
        output::probe("--map", p)?;
    }
    let json = args.json.as_deref().filter(|p| *p != Path::new("-")).map(|p| ("--json", p));
    let outputs: Vec<_> = json.into_iter().chain(args.map.as_deref().map(|p| ("--map", p))).collect();
    output::require_distinct(&outputs, &super::inputs(&args.data, args.tf.as_deref(), None))?;
    let colour = if args.tf.is_some() {
        Channels::RGBA
    } else {
        Channels::empty()
    };
    let request = super::request(&args.draw, knobs, checking::CHANNELS | colour, 1)?;
    let (source, _) = super::open(&args.data)?;
    source.require_finite()?;
    let (lo, hi) = source.bounds();
    let medium = args
        .tf
        .as_deref()
        .map(|p| surfaces::load_transfer(p, (hi - lo).max_element()))
        .transpose()?;
    let job = Job {
        judged: checking::judged(method, &request.knobs, &surfaces, medium.as_ref()),
        medium,
        args,
        method,
        source: &source,
        surfaces: &surfaces,
        request: &request,
    };
    let Answered {
        checked,
        function,
        colours,
    } = match args.rays {
        Some(n) => job.random_views(n)?,
        None => job.one_view()?,
    };
    let mut out = to_json(&checked, &job, &function);
    let mut text = to_text(&checked, &job, &function);
    if let Some(c) = &colours {
        out["colour"] = c.to_json();
        text.push_str(&c.to_text());
    }
    match args.json.as_deref() {
        Some(p) if p == Path::new("-") => text = settings::pretty(&out),
        Some(p) => output::write_text(p, &settings::pretty(&out)).context("--json")?,
        None => {}
    }
    Ok(Answer {
        text,
        warnings: super::warnings(&source, &job.judged),
        no: checked.refuted > 0 || args.strict && checking::wrong(&checked) > 0,
    })
}

struct Job<'a> {
    args: &'a CheckArgs,
    method: &'static dyn Method,
    source: &'a Source,
    surfaces: &'a [Surface],
    judged: Vec<Surface>,
    medium: Option<TransferFunction>,
    request: &'a Request,
}

/// What a check found.
struct Answered {
    checked: Check,
    /// Name of the function that was drawn.
    function: String,
    colours: Option<ColourCheck>,
}

impl Job<'_> {
    fn setup<'b>(&'b self, view: &'b View) -> Setup<'b> {
        Setup {
            method: self.method,
            data: &self.source.data,
            surfaces: self.surfaces,
            medium: self.medium.as_ref(),
            view,
            request: self.request.clone(),
        }
    }

    fn explain(&self, e: &isobar_core::RenderError) -> anyhow::Error {
        settings::explain(e, &self.args.method, &self.source.name)
    }

    /// Draws and checks one view with a prepared renderer.
    fn check(&self, p: &mut Prepared, view: &View, truths: &Truths) -> Result<Answered> {
        let function = p.function().ok_or_else(|| {
            anyhow!(
                "--method {}: it tells no function to check against; see isobar methods",
                self.args.method
            )
        })?;
        let stop = Stop::default();
        let mut frame = Frame::default();
        progress::watch(&format!("drawing with {}", self.args.method), &stop, || {
            p.render(&stop)?;
            p.renderer().read(&mut frame)
        })
        .map_err(|e| self.explain(&e))?;
        let stop = Stop::default();
        let truth = progress::watch("certifying every pixel", &stop, || {
            truths.get(&function, &self.judged, view, &stop)
        })
        .with_context(|| format!("check {}", self.args.method))?;
        Ok(Answered {
            checked: isobar_oracle::check(&frame, &truth, &function, &self.judged, view)?,
            colours: self
                .medium
                .as_ref()
                .map(|m| self.colours(&frame, &function, m, view))
                .transpose()?,
            function: function.name(),
        })
    }

    /// Holds the colours of a frame against the exact ones.
    fn colours(
        &self,
        frame: &Frame,
        function: &Arc<dyn Function>,
        medium: &TransferFunction,
        view: &View,
    ) -> Result<ColourCheck> {
        let exact = |reference| {
            let stop = Stop::default();
            progress::watch("integrating every pixel", &stop, || {
                Colours::compute(function, self.surfaces, Some(medium), reference, view, &stop)
            })
            .with_context(|| format!("check {}", self.args.method))
        };
        let integral = exact(Reference::Integral)?;
        let reference = checking::peaks_reference(self.method, &self.request.knobs);
        let peaks = reference.map(exact).transpose()?;
        Ok(ColourCheck::of(frame, &integral, reference.zip(peaks.as_ref()))?)
    }

    fn one_view(&self) -> Result<Answered> {
        let view = self.args.view.view(self.source.bounds())?;
        let truths = Truths::new(self.source.hash(), cache_dir());
        let mut p = run::prepare(&self.setup(&view)).map_err(|e| self.explain(&e))?;
        let answered = self.check(&mut p, &view, &truths)?;
        if let Some(path) = &self.args.map {
            let picture = checking::picture(&answered.checked, view.width, view.height);
            output::write_picture(path, &picture).context("--map")?;
        }
        Ok(answered)
    }

    fn random_views(&self, rays: u64) -> Result<Answered> {
        let bounds = self.source.bounds();
        ensure!(
            (bounds.1 - bounds.0).length() > 0.0,
            "--rays: {} is a single point; there is nothing to look at",
            self.source.name
        );
        let size = match self.args.view.size {
            Some(_) => self.args.view.pixels()?,
            None => RANDOM_VIEW,
        };
        let mut random = Random::new(self.args.seed);
        let first = random_view(&mut random, bounds, size, rays);
        let mut p = run::prepare(&self.setup(&first)).map_err(|e| self.explain(&e))?;
        // Random views are small and rarely asked for again: they are not kept.
        let truths = Truths::new(self.source.hash(), None);
        let (mut checks, mut pixels) = (Vec::new(), 0);
        let mut view = first;
        loop {
            let answered = self.check(&mut p, &view, &truths)?;
            pixels += answered.checked.pixels as u64;
            checks.push(answered.checked);
            if pixels >= rays {
                return Ok(Answered {
                    checked: Check::join(checks),
                    ..answered
                });
            }
            view = random_view(&mut random, bounds, size, rays - pixels);
            p.renderer().set_view(&view).map_err(|e| self.explain(&e))?;
        }
    }
}

/// A perspective view at random: one in three eyes lies inside the bounds, the others up to three diagonals away; the target lies inside;
/// 10 to 90 degrees. It has the width and height of `size`, or as many rows as are still needed for `pixels`. The bounds must have a size.
#[must_use]
pub fn random_view(random: &mut Random, bounds: (DVec3, DVec3), (w, h): (usize, usize), pixels: u64) -> View {
    let (lo, hi) = bounds;
    let size = hi - lo;
    let rows = (pixels.div_ceil(w as u64) as usize).clamp(1, h);
    loop {
        let mut inside = || lo + size * DVec3::new(random.unit(), random.unit(), random.unit());
        let (target, within) = (inside(), inside());
        let eye = if random.bits().is_multiple_of(3) {
            within
        } else {
            (lo + hi) * 0.5 + random.direction() * size.length() * (0.5 + 2.5 * random.unit())
        };
        let up = random.direction();
        let fov = 10.0 + 80.0 * random.unit();
        let view = View::perspective(eye, target, up, fov, w, rows);
        // Almost never taken twice: eye and target coincide, or up lies along the line of sight.
        if view.validate().is_ok() {
            return view;
        }
    }
}

fn to_json(c: &Check, job: &Job<'_>, function: &str) -> Value {
    let mut out = checking::to_json(c);
    out["method"] = json!(job.args.method);
    out["reconstruction"] = json!(function);
    out["data"] = json!(job.source.name);
    out["sha256"] = json!(job.source.hash());
    out["isovalues"] = job.judged.iter().map(Surface::value).collect();
    out["knobs"] = settings::resolve(job.method, &job.request.knobs).map_or(Value::Null, |k| settings::knobs_json(&k));
    if let Some(n) = job.args.rays {
        out["rays"] = json!({"asked": n, "seed": job.args.seed});
    }
    out["isobar"] = json!(env!("CARGO_PKG_VERSION"));
    out
}

fn to_text(c: &Check, job: &Job<'_>, function: &str) -> String {
    format!(
        "{} {function} on {}\n{}",
        job.args.method,
        job.source.name,
        checking::to_text(c)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn random_views_lie_inside_and_outside_and_repeat() {
        let bounds = (DVec3::splat(-1.0), DVec3::splat(1.0));
        let mut r = Random::new(3);
        let eyes: Vec<DVec3> = (0..60)
            .map(|_| match random_view(&mut r, bounds, RANDOM_VIEW, 10_000).camera {
                isobar_core::Camera::Perspective { eye, .. } => eye,
                other => panic!("{other:?}"),
            })
            .collect();
        let inside = eyes.iter().filter(|e| e.abs().max_element() <= 1.0).count();
        assert!((5..40).contains(&inside), "{inside}");
        assert_eq!(
            random_view(&mut Random::new(3), bounds, RANDOM_VIEW, 40),
            random_view(&mut Random::new(3), bounds, RANDOM_VIEW, 40)
        );
        assert_eq!(random_view(&mut Random::new(3), bounds, RANDOM_VIEW, 40).pixels(), 64);
    }
}
