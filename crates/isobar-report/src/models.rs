//! The time models: what each change costs on its own. Never ranked together.

use crate::measure::{Job, timed_channels};
use crate::results::{Model, Row};
use isobar::run::{self, Prepared, Setup};
use isobar::truth::Random;
use isobar_core::{Camera, Channels, Frame, Function, Method, NO_SURFACE, Ray, RenderError, Stop, Surface, View};
use isobar_oracle::{Oracle, Truth};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Rays verified of the first and of the last frame of a sequence.
const RAYS: usize = 64;

/// Hits asked for in the model all-hits.
const LAYERS: usize = 16;

/// Timed copies of an image.
const READS: usize = 5;

/// No further repetition of a preparation begins after this.
const PATIENCE: Duration = Duration::from_secs(1);

/// A sequence of timings.
#[derive(Default)]
struct Times {
    wall: Vec<f64>,
    cpu: Vec<f64>,
}

impl Times {
    fn add<T>(&mut self, work: impl FnOnce() -> T) -> T {
        let cpu = isobar::machine::cpu_time();
        let start = Instant::now();
        let out = work();
        self.wall.push(start.elapsed().as_secs_f64());
        self.cpu.push(isobar::machine::cpu_time().saturating_sub(cpu).as_secs_f64());
        out
    }

    fn model(&self, method: &str, model: &str, verified: String) -> Model {
        Model {
            method: method.into(),
            model: model.into(),
            wall: run::Stat::of(&self.wall).into(),
            cpu: run::Stat::of(&self.cpu).into(),
            reason: None,
            verified,
        }
    }
}

fn failed(method: &str, model: &str, reason: &str) -> Model {
    Model {
        method: method.into(),
        model: model.into(),
        reason: Some(reason.into()),
        ..Model::default()
    }
}

/// All models of one method at its default setting.
pub(crate) fn models(job: &Job<'_>, m: &'static dyn Method, reconstruction: &str, rows: &[Row], stop: &Stop) -> Vec<Model> {
    let id = m.info().id;
    let setup = job.setup(m, Job::knobs(m, reconstruction), timed_channels(m.info()));
    let (mut out, digests) = start(&setup, id, stop);
    match run::prepare(&setup).and_then(|mut p| p.render(stop).map(|_| p)) {
        // Views first: the isovalues leave other surfaces behind.
        Ok(mut p) => {
            if let Err(e) = same_images(&mut out, &digests, &mut p, job, stop) {
                out.retain(|m| m.model != "data");
                out.push(failed(id, "data", &e.to_string()));
            }
            out.push(read(&mut p, id, digests.first().copied()).unwrap_or_else(|e| failed(id, "read", &e.to_string())));
            for (name, work) in [("view", views as Sequence), ("isovalue", isovalues)] {
                out.push(work(job, &mut p, id, stop).unwrap_or_else(|e| failed(id, name, &e.to_string())));
            }
        }
        Err(e) => out.extend(["read", "view", "isovalue"].map(|name| failed(id, name, &e.to_string()))),
    }
    if let Some(row) = rows.iter().find(|r| r.method == id && r.default && r.reason.is_none()) {
        out.push(Model {
            method: id.into(),
            model: "steady".into(),
            wall: row.wall,
            cpu: row.cpu,
            reason: None,
            verified: "every pixel".into(),
        });
    }
    out.push(all_hits(job, &setup, id, stop).unwrap_or_else(|e| failed(id, "all-hits", &e.to_string())));
    out
}

type Sequence = fn(&Job<'_>, &mut Prepared, &str, &Stop) -> Result<Model, RenderError>;

/// Opening, and from the data to the first image: three times, fewer where that takes long.
///
/// Also the digests of the images.
fn start(setup: &Setup<'_>, id: &str, stop: &Stop) -> (Vec<Model>, Vec<u64>) {
    let (mut open, mut data) = (Times::default(), Times::default());
    let mut digests = Vec::new();
    let began = Instant::now();
    for i in 0..3 {
        if i > 0 && began.elapsed() > PATIENCE {
            break;
        }
        let once = (|| -> Result<(), RenderError> {
            let mut r = open.add(|| setup.method.open(&setup.request))?;
            data.add(|| {
                r.set_data(setup.data)?;
                r.set_surfaces(setup.surfaces)?;
                r.set_view(setup.view)?;
                r.render(stop).map(|_| ())
            })?;
            let mut frame = Frame::default();
            r.read(&mut frame)?;
            digests.push(run::digest(&frame));
            Ok(())
        })();
        if let Err(e) = once {
            let reason = e.to_string();
            return (vec![failed(id, "open", &reason), failed(id, "data", &reason)], digests);
        }
    }
    let models = vec![
        open.model(id, "open", "nothing drawn".into()),
        data.model(id, "data", String::new()),
    ];
    (models, digests)
}

/// Holds the first images against that of a renderer of its own, and rays of it against the truth.
fn same_images(out: &mut [Model], digests: &[u64], p: &mut Prepared, job: &Job<'_>, stop: &Stop) -> Result<(), RenderError> {
    let Some(data) = out.iter_mut().find(|m| m.model == "data" && m.reason.is_none()) else {
        return Ok(());
    };
    let mut frame = Frame::default();
    p.renderer().read(&mut frame)?;
    let other = digests.iter().filter(|d| **d != run::digest(&frame)).count();
    if other > 0 {
        data.reason = Some(format!("{other} of {} first images differ from a later one", digests.len()));
        return Ok(());
    }
    data.verified = told(&[verify(p, job.surfaces, job.view, stop)?]);
    Ok(())
}

/// Copying the image out, into a frame that has its memory already.
fn read(p: &mut Prepared, id: &str, digest: Option<u64>) -> Result<Model, RenderError> {
    let mut times = Times::default();
    let mut frame = Frame::default();
    p.renderer().read(&mut frame)?;
    for _ in 0..READS {
        times.add(|| p.renderer().read(&mut frame))?;
    }
    Ok(match digest {
        Some(d) if d == run::digest(&frame) => times.model(id, "read", "every bit".into()),
        _ => failed(id, "read", "the image read is not the first image"),
    })
}

/// Other isovalues, near the definition's.
fn isovalues(job: &Job<'_>, p: &mut Prepared, id: &str, stop: &Stop) -> Result<Model, RenderError> {
    let span = span(job);
    let changes = if job.settings.full { 12 } else { 3 };
    let mut times = Times::default();
    let mut wrong = Vec::new();
    for i in 1..=changes {
        let shift = span * 0.01 * f64::from(i) * if i % 2 == 0 { 1.0 } else { -1.0 };
        let surfaces: Vec<Surface> = (job.surfaces.iter().enumerate())
            .map(|(k, s)| Surface::isovalue(s.value().unwrap_or_default() + shift, k))
            .collect();
        times.add(|| {
            p.renderer().set_surfaces(&surfaces)?;
            p.renderer().render(stop).map(|_| ())
        })?;
        if i == 1 || i == changes {
            wrong.push(verify(p, &surfaces, job.view, stop)?);
        }
    }
    Ok(times.model(id, "isovalue", told(&wrong)))
}

/// Other cameras: an orbit about the target and the upward direction.
fn views(job: &Job<'_>, p: &mut Prepared, id: &str, stop: &Stop) -> Result<Model, RenderError> {
    let (steps, shown) = if job.settings.full { (24, 24) } else { (24, 4) };
    let mut times = Times::default();
    let mut wrong = Vec::new();
    for i in 1..=shown {
        // A few steps of the orbit, spread over all of it.
        let view = orbit(job.view, f64::from(i * steps / shown) / f64::from(steps));
        times.add(|| {
            p.renderer().set_view(&view)?;
            p.renderer().render(stop).map(|_| ())
        })?;
        if i == 1 || i == shown {
            wrong.push(verify(p, job.surfaces, &view, stop)?);
        }
    }
    Ok(times.model(id, "view", told(&wrong)))
}

/// The view with its eye turned about the target by a part of a full turn.
fn orbit(view: &View, part: f64) -> View {
    let mut out = view.clone();
    if let Camera::Perspective { eye, target, up, .. } = &mut out.camera {
        let axis = up.normalize();
        let arm = *eye - *target;
        let (sin, cos) = (part * std::f64::consts::TAU).sin_cos();
        // Rodrigues' rotation.
        *eye = *target + arm * cos + axis.cross(arm) * sin + axis * axis.dot(arm) * (1.0 - cos);
    }
    out
}

/// All intersections of every pixel's ray.
fn all_hits(job: &Job<'_>, setup: &Setup<'_>, id: &str, stop: &Stop) -> Result<Model, RenderError> {
    let mut setup = setup.clone();
    setup.request.layers = LAYERS;
    setup.request.channels = Channels::T | Channels::SURFACE;
    let mut p = run::prepare(&setup)?;
    let mut times = Times::default();
    p.render(stop)?;
    for _ in 0..3 {
        times.add(|| p.renderer().render(stop).map(|_| ()))?;
    }
    let mut frame = Frame::default();
    p.renderer().read(&mut frame)?;
    let function = p.function().ok_or(RenderError::NotReady("set_data"))?;
    let oracles = oracles(&function, job.surfaces);
    let n = job.view.pixels();
    let mut wrong = 0;
    for i in pixels(job.view) {
        let ray = job.view.ray(i % job.view.width, i / job.view.width);
        let given: Vec<f64> = (0..frame.layers)
            .map(|l| frame.t[l * n + i])
            .filter(|t| t.is_finite())
            .collect();
        let truth = layers(&oracles, &ray);
        let far = function.domain().voxel() * 0.5;
        let same = given.len() == truth.len().min(LAYERS) && given.iter().zip(&truth).all(|(a, b)| (a - b).abs() < far);
        wrong += usize::from(!same);
    }
    Ok(times.model(id, "all-hits", format!("{RAYS} rays, {wrong} wrong")))
}

/// The oracle of each surface; they share what does not depend on the isovalue, which takes time linear in the samples.
fn oracles(function: &Arc<dyn Function>, surfaces: &[Surface]) -> Vec<Oracle> {
    let first = Oracle::new(function.clone(), 0.0);
    surfaces
        .iter()
        .filter_map(Surface::value)
        .map(|c| first.with_isovalue(c))
        .collect()
}

/// Certified roots of all surfaces on a ray, front to back.
fn layers(oracles: &[Oracle], ray: &Ray) -> Vec<f64> {
    let mut all: Vec<f64> = (oracles.iter()).flat_map(|o| o.all(ray).roots).map(|r| r.t()).collect();
    all.sort_by(f64::total_cmp);
    all
}

/// Seeded pixels of a view.
fn pixels(view: &View) -> Vec<usize> {
    let mut random = Random::new(view.pixels() as u64);
    (0..RAYS).map(|_| (random.unit() * view.pixels() as f64) as usize).collect()
}

/// Wrong ones among seeded pixels of the frame that was drawn last; undecidable ones are not counted.
fn verify(p: &mut Prepared, surfaces: &[Surface], view: &View, stop: &Stop) -> Result<usize, RenderError> {
    let mut frame = Frame::default();
    p.renderer().read(&mut frame)?;
    let function = p.function().ok_or(RenderError::NotReady("set_data"))?;
    let chosen = pixels(view);
    let rays: Vec<Ray> = chosen.iter().map(|i| view.ray(i % view.width, i / view.width)).collect();
    let rays = View::rays(rays);
    let mut few = Frame::new(RAYS, 1, 1, Channels::T | Channels::SURFACE);
    few.t = chosen.iter().map(|&i| frame.t[i]).collect();
    few.surface = chosen
        .iter()
        .map(|&i| frame.surface.get(i).copied().unwrap_or(NO_SURFACE))
        .collect();
    let oracle = |e: isobar_oracle::TruthError| RenderError::Device(format!("the oracle: {e}"));
    let truth = Truth::compute(&function, surfaces, &rays, stop).map_err(oracle)?;
    let check = isobar_oracle::check(&few, &truth, &function, surfaces, &rays).map_err(oracle)?;
    Ok(isobar::checking::wrong(&check))
}

fn told(wrong: &[usize]) -> String {
    format!("{} rays, {} wrong", RAYS * wrong.len(), wrong.iter().sum::<usize>())
}

/// Size of the range of values.
fn span(job: &Job<'_>) -> f64 {
    job.source.summary().range.map_or(1.0, |(lo, hi)| hi - lo)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::results::Stat;
    use isobar_core::DVec3;

    #[test]
    fn an_orbit_keeps_the_distance_and_comes_back() {
        let view = View::bench(8, 6);
        let eye = |v: &View| match v.camera {
            Camera::Perspective { eye, .. } => eye,
            _ => DVec3::ZERO,
        };
        let start = eye(&view);
        for part in [0.1, 0.25, 0.7] {
            let e = eye(&orbit(&view, part));
            assert!((e.length() - start.length()).abs() < 1e-12 && (e.z - start.z).abs() < 1e-12);
            assert!((e - start).length() > 0.1);
        }
        assert!((eye(&orbit(&view, 1.0)) - start).length() < 1e-12);
    }

    #[test]
    fn statistics_of_times_are_medians() {
        let t = Times {
            wall: vec![3.0, 1.0, 2.0],
            cpu: vec![1.0],
        };
        let m = t.model("a", "view", String::new());
        assert_eq!(
            m.wall,
            Stat {
                median: 2.0,
                mad: 1.0,
                n: 3
            }
        );
    }
}
