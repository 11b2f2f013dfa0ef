//! Tables 1 and 2 of Knoll et al. 2009 in the paper's form.
//!
//! `peaks_tables 1`: frames per CPU second and samples per ray, for peak finding, post-classification and pre-integration, with the paper's frame rates of the same kinds of scene.
//! `peaks_tables 2 [part of a row's name] [distance of the close views]`: differential and geometric against uniform sampling at equal error, close up and far away. Data: those of
//! `common::named`; what is absent is said and left out.
//!
//! **Protocol of Table 2.** The paper takes the converged image as the control and finds by eye the frame rate at which each scheme looks the same. Here the error decides: the root of the mean
//! squared difference in sRGB over white to the exact colours of isobar-oracle, I for post-classification and P for peak finding. For each law the step is halved again and again; CPU time and
//! samples at the error of the differential image at s_k = 4, 2 and 1 are interpolated between the two steps around it (log-log). Image 1280 x 800, of which the window of 48 x 30
//! pixels in the middle is drawn, measured and timed: same rays, same pixel footprint; from four sides, whose squared errors, samples and times are summed, since in one close view a few edges decide.
//! Both the error of pixels and that of means over blocks of 6 x 6 pixels, in linear light, are compared: far features are as small as pixels, and their errors cancel in a block, as they do for the eye.
//! "wide" is a close view of 100 degrees in 160 x 100 pixels, where the law grows as fast as the pixel is wide. "at most" is the greatest gain that `Steps::greatest_gain` leaves the printed law.

mod common;

use common::{Result, Volume, counter, draw, least, named, open, settings, window};
use isobar_core::{Camera, Channels, Frame, Renderer, Stage, Stop, TransferFunction, View};
use isobar_oracle::{Colours, Reference};
use isobar_peaks::sampling::{Law, Sampler};
use isobar_peaks::{PEAKS_CPU, PEAKS_CPU_PAPER};

fn main() -> Result<()> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let part = args.get(1).map_or("", |s| s);
    match args.first().map(String::as_str) {
        Some("1") => table1(),
        Some("2") => table2(part, args.get(2).map_or(Ok(0.3), |s| s.parse())?),
        _ => Err("peaks_tables 1 | peaks_tables 2 [part of a row's name] [distance of the close view]".into()),
    }
}

const RED: [f32; 3] = [0.8, 0.1, 0.05];
const BLUE: [f32; 3] = [0.1, 0.25, 0.8];
const GREEN: [f32; 3] = [0.15, 0.6, 0.15];
const GOLD: [f32; 3] = [0.85, 0.6, 0.15];

/// A row of Table 1: what the paper says of the scene of this kind, in frames per second on a GeForce GTX 285 (figures 3 to 5; the table's own numbers are only in its picture).
struct Row {
    name: &'static str,
    data: &'static str,
    size: [usize; 2],
    knobs: &'static str,
    tf: fn(&Volume) -> Result<TransferFunction>,
    paper: [&'static str; 3],
}

/// A near-Dirac peak and a smoother feature: figure 3.
fn dirac(v: &Volume) -> Result<TransferFunction> {
    v.points(&[
        (0.08, BLUE, 0.0),
        (0.14, BLUE, 0.02),
        (0.2, BLUE, 0.0),
        (0.449_95, RED, 0.0),
        (0.45, RED, 0.7),
        (0.450_05, RED, 0.0),
    ])
}

/// Narrow bands in noise: figure 4.
fn bands(v: &Volume) -> Result<TransferFunction> {
    v.spikes(&[(0.35, 2e-3, BLUE, 0.05), (0.5, 2e-3, GREEN, 0.1), (0.68, 2e-3, RED, 0.5)])
}

/// Five peaks close together: figure 5, left.
fn several(v: &Volume) -> Result<TransferFunction> {
    let at = |i: usize| 0.14 + 0.03 * i as f64;
    let colours = [BLUE, GREEN, GOLD, RED, [0.8; 3]];
    let of: Vec<_> = colours.iter().enumerate().map(|(i, &c)| (at(i), 2e-3, c, 0.15)).collect();
    v.spikes(&of)
}

fn table1() -> Result<()> {
    let xor = "mode=peak_xor_dvr";
    let rows = [
        Row {
            name: "heptane, near-Dirac peak (Fig. 3)",
            data: "heptane",
            size: [1024, 900],
            knobs: xor,
            tf: dirac,
            paper: ["7.1", "11.6", "8.8"],
        },
        Row {
            name: "entropic noise for the zebrafish (Fig. 4)",
            data: "entropic",
            size: [1600, 512],
            knobs: xor,
            tf: bands,
            paper: ["2.1", "-", "2.0"],
        },
        Row {
            name: "head, one peak a segment (Fig. 5, left)",
            data: "head",
            size: [800, 1024],
            knobs: "mode=peak_xor_dvr peaks=1",
            tf: several,
            paper: ["10.7", "-", "-"],
        },
        Row {
            name: "head, four peaks a segment (Fig. 5, left)",
            data: "head",
            size: [800, 1024],
            knobs: xor,
            tf: several,
            paper: ["8.2", "-", "-"],
        },
        Row {
            name: "bonsai, two peaks",
            data: "bonsai",
            size: [1024, 768],
            knobs: xor,
            tf: Volume::two_peaks,
            paper: ["-", "-", "-"],
        },
        Row {
            name: "bonsai, two peaks, B-spline",
            data: "bonsai",
            size: [1024, 768],
            knobs: "mode=peak_xor_dvr reconstruction=cubic",
            tf: Volume::two_peaks,
            paper: ["-", "-", "-"],
        },
    ];
    println!(
        "frames per CPU second, one thread, default view, s_k = 4 | the paper's fps; samples per ray: all, and without peaks"
    );
    println!(
        "{:42} {:>9} | {:>9} {:>9} | {:>7} {:>7} {:>7} | {:>5} {:>5} {:>5} | {:>7}",
        "scene", "size", "samples", "DVR only", "peaks", "post", "preint", "peaks", "post", "pre", "exact"
    );
    for r in rows {
        let volume = match named(r.data) {
            Ok(v) => v,
            Err(e) => {
                println!("{:42} {e}", r.name);
                continue;
            }
        };
        let tf = (r.tf)(&volume)?;
        let [w, h] = r.size;
        let view = View::fit(volume.data.bounds(), 40.0, w, h);
        let recon = r.knobs.split_whitespace().find(|k| k.starts_with("recon")).unwrap_or("");
        let mut renderer = open(&PEAKS_CPU_PAPER, &volume, (&[], Some(&tf)), &view, (Channels::RGBA, recon))?;
        let mut run = |knobs: &str| -> Result<(f64, f64)> {
            renderer.set_knobs(&settings(knobs)?)?;
            let seconds = least(renderer.as_mut(), 3)?;
            let samples = counter(renderer.as_ref(), "samples") + counter(renderer.as_ref(), "samples for peaks");
            Ok((1.0 / seconds, samples as f64 / (w * h) as f64))
        };
        let (peaks, samples) = run(r.knobs)?;
        let (post, alone) = run(&format!("mode=dvr_only {recon}"))?;
        let (pre, _) = run(&format!("mode=dvr_only integration=engel {recon}"))?;
        let mut exact = open(&PEAKS_CPU, &volume, (&[], Some(&tf)), &view, (Channels::RGBA, recon))?;
        let exact = 1.0 / least(exact.as_mut(), 3)?;
        println!(
            "{:42} {:>9} | {samples:9.1} {alone:9.1} | {peaks:7.2} {post:7.2} {pre:7.2} | {:>5} {:>5} {:>5} | {exact:7.2}",
            r.name,
            format!("{w}x{h}"),
            r.paper[0],
            r.paper[1],
            r.paper[2]
        );
    }
    Ok(())
}

/// A law and the knob that shortens its steps.
struct Sweep {
    law: &'static str,
    knob: &'static str,
    /// The first value; each further one is half of the one before.
    first: f64,
    /// Seconds, samples per ray, root mean square error, and that of means over blocks; by value.
    runs: Vec<[f64; 4]>,
}

impl Sweep {
    /// Halves the steps until both errors are below `until`, at most `count` times in all. `run`: draws once with these knobs.
    fn run(
        law: &'static str,
        knob: &'static str,
        first: f64,
        (count, until): (i32, [f64; 2]),
        run: &mut dyn FnMut(&str) -> Result<[f64; 4]>,
    ) -> Result<Self> {
        let mut runs = Vec::new();
        for i in 0..count {
            runs.push(run(&format!("sampling={law} {knob}={}", first * 0.5f64.powi(i)))?);
            let [.., each, blocks] = runs[runs.len() - 1];
            if each < until[0] && blocks < until[1] {
                break;
            }
        }
        Ok(Self { law, knob, first, runs })
    }

    /// Seconds and samples per ray at this error (2: of pixels, 3: of blocks): between the first run that reaches it and the one before; `None` where none does.
    fn at(&self, which: usize, error: f64) -> Option<[f64; 2]> {
        let i = self.runs.iter().position(|r| r[which] <= error)?;
        let b = self.runs[i];
        if i == 0 {
            return Some([b[0], b[1]]);
        }
        let a = self.runs[i - 1];
        let w = (error / a[which]).ln() / (b[which] / a[which]).ln();
        Some([0, 1].map(|k| a[k] * (b[k] / a[k]).powf(w)))
    }
}

/// One soft feature and two peaks of half-width .02 of the range, which post-classification too can resolve.
fn mixed(v: &Volume, noise: bool) -> Result<TransferFunction> {
    let (low, high) = if noise { (0.42, 0.6) } else { (0.15, 0.45) };
    v.points(&[
        (low - 0.08, BLUE, 0.0),
        (low - 0.02, BLUE, 0.01),
        (low, GREEN, 0.3),
        (low + 0.02, BLUE, 0.01),
        (high - 0.02, RED, 0.02),
        (high, RED, 0.4),
        (high + 0.02, RED, 0.02),
        (high + 0.3, GOLD, 0.05),
    ])
}

/// Where the eye is, and what the image is like.
struct Place {
    name: &'static str,
    /// Of the eye from the middle, in extents.
    distance: f64,
    fov: f64,
    size: [usize; 2],
    /// The greatest s_k whose error is asked for; the others are a half and a quarter of it.
    s_k: f64,
}

/// Sides from which each place is looked at.
const SIDES: [[f64; 3]; 4] = [[2.6, 1.9, 1.2], [-1.9, 2.6, 0.7], [-2.6, -1.7, -1.0], [1.5, -2.4, 1.9]];

impl Place {
    fn views(&self, volume: &Volume) -> Vec<View> {
        let [w, h] = self.size;
        let view = |side| {
            let mut view = volume.view(side, self.distance, w, h);
            if let Camera::Perspective { fov, .. } = &mut view.camera {
                *fov = self.fov;
            }
            window(&view, 48, 30)
        };
        SIDES.into_iter().map(view).collect()
    }
}

fn table2(part: &str, near: f64) -> Result<()> {
    println!(
        "windows of 48x30 of 1280x800 (wide: 160x100) from four sides, one thread; error: rms in sRGB over white; x: CPU time, then samples, of uniform sampling at the same error over the law's; close: eye {near} extents from the middle"
    );
    let place = |name, distance, fov, size, s_k| Place {
        name,
        distance,
        fov,
        size,
        s_k,
    };
    let places = [
        place("close", near, 40.0, [1280, 800], 4.0),
        place("far", 3.0, 40.0, [1280, 800], 4.0),
        place("wide", near, 100.0, [160, 100], 0.25),
    ];
    for (data, noise) in [("heptane", false), ("entropic", true), ("bonsai", false)] {
        let volume = match named(data) {
            Ok(v) => v,
            Err(e) => {
                println!("{data}: {e}");
                continue;
            }
        };
        let tf = mixed(&volume, noise)?;
        for place in &places {
            for (what, mode, which) in [
                ("post", "dvr_only", Reference::Integral),
                ("peaks", "default", Reference::Peaks),
            ] {
                for recon in ["trilinear", "cubic"] {
                    let name = format!("{data} {} {what} {recon}", place.name);
                    if name.contains(part) {
                        compare(&name, &volume, &tf, place, (mode, which, recon))?;
                    }
                }
            }
        }
    }
    Ok(())
}

/// The most that the printed law can gain at this s_k: that of each ray, by its samples.
fn greatest_gain(volume: &Volume, views: &[View], s_k: f64) -> f64 {
    let (lo, hi) = volume.data.bounds();
    let (mut uniform, mut law) = (0.0, 0.0);
    for view in views {
        let sampler = Sampler::new(Law::Differential, s_k, volume.extent, 1.0, view);
        let rays = view.generator();
        for i in 0..view.pixels() {
            let ray = rays.ray(i % view.width, i / view.width);
            let (a, b) = ((lo - ray.origin) / ray.direction, (hi - ray.origin) / ray.direction);
            let (t0, t1) = (a.min(b).max_element().max(0.0), a.max(b).min_element());
            if t0 < t1 {
                let steps = sampler.steps(ray.direction);
                let n = steps.x(t1) - steps.x(t0);
                (uniform, law) = (uniform + n * steps.greatest_gain(t0, t1), law + n);
            }
        }
    }
    uniform / law
}

/// Side of the blocks whose means are compared too.
const BLOCK: usize = 6;

/// Mean over all blocks and channels of the squared difference of their mean colours, in linear light over white: pixels that err each for itself, as far ones do, have less of it than those that
/// err together, as near ones do.
fn block_square(view: &View, frame: &Frame, want: &[[f32; 4]]) -> f64 {
    let seen = |c: &[f32; 4], i: usize| f64::from(c[i]) + 1.0 - f64::from(c[3]);
    let (mut square, mut count) = (0.0, 0.0);
    for y in (0..view.height).step_by(BLOCK) {
        for x in (0..view.width).step_by(BLOCK) {
            for channel in 0..3 {
                let pixels = (0..BLOCK * BLOCK).map(|k| (y + k / BLOCK) * view.width + x + k % BLOCK);
                let sum: f64 = pixels.map(|p| seen(&frame.rgba[p], channel) - seen(&want[p], channel)).sum();
                square += (sum / (BLOCK * BLOCK) as f64).powi(2);
                count += 1.0;
            }
        }
    }
    square / count
}

fn compare(
    name: &str,
    volume: &Volume,
    tf: &TransferFunction,
    place: &Place,
    (mode, which, recon): (&str, Reference, &str),
) -> Result<()> {
    let scene = (&[][..], Some(tf));
    let common = format!("mode={mode} reconstruction={recon}");
    let views = place.views(volume);
    let rms = |psnr: f64| 10f64.powf(-psnr / 20.0);
    let mut wanted = Vec::new();
    let (mut bound, mut time, mut square, mut p99) = (0.0f64, 0.0, 0.0, 0.0f64);
    let mut exact = open(&PEAKS_CPU, volume, scene, &views[0], (Channels::RGBA, &common))?;
    let function = exact.reconstruction(Stage::Stored).ok_or("no function to hold it against")?;
    for view in &views {
        let want = Colours::compute(&function, &[], Some(tf), which, view, &Stop::default())?;
        exact.set_view(view)?;
        let d = want.difference(&draw(exact.as_mut())?)?;
        bound = bound.max(want.greatest_error());
        time += least(exact.as_mut(), 3)?;
        square += rms(d.psnr).powi(2) / views.len() as f64;
        p99 = p99.max(d.p99);
        wanted.push(want);
    }
    println!(
        "{name}: reference to {bound:.0e}; peaks/cpu {:.1} ms, error {:.1e}, p99 {p99:.1e}",
        1e3 * time,
        square.sqrt()
    );
    // One renderer for all steps: it keeps the ranges of the macrocells.
    let mut r: Box<dyn Renderer> = open(&PEAKS_CPU_PAPER, volume, scene, &views[0], (Channels::RGBA, &common))?;
    let mut run = |knobs: &str| -> Result<[f64; 4]> {
        r.set_knobs(&settings(&format!("{common} {knobs}"))?)?;
        let mut sum = [0.0; 4];
        for (view, want) in views.iter().zip(&wanted) {
            r.set_view(view)?;
            let frame = draw(r.as_mut())?;
            let d = want.difference(&frame)?;
            let samples = counter(r.as_ref(), "samples") + counter(r.as_ref(), "samples for peaks");
            let one = [
                least(r.as_mut(), 5)?,
                samples as f64 / view.pixels() as f64,
                rms(d.psnr).powi(2),
                block_square(view, &frame, &want.rounded()),
            ];
            for (sum, one) in sum.iter_mut().zip(one) {
                *sum += one;
            }
        }
        let n = views.len() as f64;
        Ok([sum[0], sum[1] / n, (sum[2] / n).sqrt(), (sum[3] / n).sqrt()])
    };
    // Down to a quarter of the greatest.
    let differential = Sweep::run("differential", "sk", 8.0 * place.s_k, (6, [0.0; 2]), &mut run)?;
    let least = |which: usize| differential.runs.iter().fold(f64::INFINITY, |m, r| m.min(r[which]));
    let until = [least(2), least(3)];
    let uniform = Sweep::run("uniform", "step", 8.0, (8, until), &mut run)?;
    let geometric = Sweep::run("geometric", "sk", 16.0 * place.s_k, (9, until), &mut run)?;
    for i in 3..6 {
        let sk = differential.first * 0.5f64.powi(i as i32);
        println!("  s_k = {sk}, at most {:.2}", greatest_gain(volume, &views, sk));
        for (what, which) in [("pixels", 2), ("blocks", 3)] {
            let error = differential.runs[i][which];
            print!("    error of {what} {error:.2e}");
            let ruler = uniform.at(which, error);
            for s in [&uniform, &differential, &geometric] {
                match (s.at(which, error), ruler) {
                    (Some([t, n]), Some([u, m])) => {
                        print!("; {} {:.2} ms, {n:.1} samples, x {:.2} {:.2}", s.law, 1e3 * t, u / t, m / n);
                    }
                    (Some([t, n]), None) => print!("; {} {:.2} ms, {n:.1} samples", s.law, 1e3 * t),
                    (None, _) => {
                        let last = s.first * 0.5f64.powi(s.runs.len() as i32 - 1);
                        print!("; {} does not reach it with {} {last}", s.law, s.knob);
                    }
                }
            }
            println!();
        }
    }
    Ok(())
}
