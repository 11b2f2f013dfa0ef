//! Figures 1 and 3 to 7 of Knoll et al. 2009 with our data: `peaks_figures FOLDER [number]` writes figure-1.png and so on, and prints what each panel took.
//!
//! The paper's zebrafish, aneurism, backpack and fireset cannot be had; entropic noise and the bonsai stand in for them, the head for the scene of figure 5. Data: those of `common::named`.
//!
//! | figure | panels |
//! |---|---|
//! | 1 | one ray through the head: samples of post-classification, chords of pre-integration, crossings of peak finding |
//! | 3 | heptane, near-Dirac peak in red, smoother feature in blue: peak finding, post-classification, pre-integration, `peaks/cpu` |
//! | 4 | entropic noise: peak finding over pre-integration and isosurfaces alone |
//! | 5 | head: one and four peaks a segment; bias: peak finding, peaks times 16, post-classification, peaks alone |
//! | 6 | close-ups of bonsai and noise, uniform beside differential at as many samples: post-classification, peak finding, peak finding with the B-spline |
//! | 7 | far views, uniform beside differential at the same error: bonsai with the B-spline, noise with peaks |

mod common;

use common::{Result, Volume, counter, draw, least, named, open, settings};
use image::{Rgb, RgbImage};
use isobar_core::{Channels, Frame, Stage, Surface, SurfaceKind, TransferFunction, View, to_srgb8};
use isobar_oracle::Difference;
use isobar_peaks::{PEAKS_CPU, PEAKS_CPU_PAPER, PeaksCpu};
use std::path::Path;

const RED: [f32; 3] = [0.8, 0.08, 0.05];
const BLUE: [f32; 3] = [0.1, 0.25, 0.8];
const GREEN: [f32; 3] = [0.15, 0.6, 0.15];
const GOLD: [f32; 3] = [0.85, 0.6, 0.15];
const GREY: [f32; 3] = [0.7, 0.7, 0.7];

type Figure = fn(&Path) -> Result<()>;

fn main() -> Result<()> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let folder = Path::new(args.first().ok_or("peaks_figures FOLDER [number]")?);
    std::fs::create_dir_all(folder)?;
    let all: [(&str, Figure); 6] = [("1", one), ("3", three), ("4", four), ("5", five), ("6", six), ("7", seven)];
    for (name, figure) in all {
        if args.get(1).is_none_or(|n| n == name)
            && let Err(e) = figure(&folder.join(format!("figure-{name}.png")))
        {
            println!("figure {name}: {e}");
        }
    }
    Ok(())
}

/// Panels in rows, with gaps, on white.
fn write(path: &Path, rows: &[Vec<RgbImage>]) -> Result<()> {
    const GAP: u32 = 8;
    let width = |r: &Vec<RgbImage>| r.iter().map(|p| p.width() + GAP).sum::<u32>();
    let height = |r: &Vec<RgbImage>| r.iter().map(RgbImage::height).max().unwrap_or(0) + GAP;
    let size = (
        rows.iter().map(width).max().unwrap_or(0) + GAP,
        rows.iter().map(height).sum::<u32>() + GAP,
    );
    let mut out = RgbImage::from_pixel(size.0, size.1, Rgb([255; 3]));
    let mut y = GAP;
    for row in rows {
        let mut x = GAP;
        for panel in row {
            image::imageops::replace(&mut out, panel, x.into(), y.into());
            x += panel.width() + GAP;
        }
        y += height(row);
    }
    out.save(path)?;
    println!("{}", path.display());
    Ok(())
}

fn picture(frame: &Frame) -> RgbImage {
    let w = frame.width;
    RgbImage::from_fn(w as u32, frame.height as u32, |x, y| {
        Rgb(to_srgb8(frame.rgba[y as usize * w + x as usize]))
    })
}

/// A frame in colour, with its CPU seconds and samples.
struct Drawn {
    frame: Frame,
    samples: u64,
}

fn panel(
    what: &str,
    method: &PeaksCpu,
    volume: &Volume,
    scene: (&[Surface], &TransferFunction),
    view: &View,
    knobs: &str,
) -> Result<Drawn> {
    let mut r = open(method, volume, (scene.0, Some(scene.1)), view, (Channels::RGBA, knobs))?;
    let frame = draw(r.as_mut())?;
    let samples = counter(r.as_ref(), "samples") + counter(r.as_ref(), "samples for peaks");
    if !what.is_empty() {
        println!(
            "  {what}: {:.0} ms, {:.1} samples per ray",
            1e3 * least(r.as_mut(), 2)?,
            samples as f64 / view.pixels() as f64
        );
    }
    Ok(Drawn { frame, samples })
}

/// Lines in a picture, from corner (0, 0) to (1, 1), y up.
struct Plot(RgbImage);

impl Plot {
    fn line(&mut self, a: [f64; 2], b: [f64; 2], colour: [u8; 3], thick: i64) {
        let (w, h) = (f64::from(self.0.width()), f64::from(self.0.height()));
        let n = ((b[0] - a[0]) * w).abs().max(((b[1] - a[1]) * h).abs()).ceil().max(1.0) as u32;
        for k in 0..=n {
            let s = f64::from(k) / f64::from(n);
            self.dot([a[0] + s * (b[0] - a[0]), a[1] + s * (b[1] - a[1])], colour, thick);
        }
    }

    fn dot(&mut self, at: [f64; 2], colour: [u8; 3], thick: i64) {
        let (w, h) = (i64::from(self.0.width()), i64::from(self.0.height()));
        let (x, y) = ((at[0] * w as f64) as i64, ((1.0 - at[1]) * h as f64) as i64);
        for j in -thick..=thick {
            for i in -thick..=thick {
                if i * i + j * j <= thick * thick + 1 && (0..w).contains(&(x + i)) && (0..h).contains(&(y + j)) {
                    self.0.put_pixel((x + i) as u32, (y + j) as u32, Rgb(colour));
                }
            }
        }
    }
}

/// Field (black) and opacity (filled) along one ray, with what each method sees of it.
fn one(path: &Path) -> Result<()> {
    let volume = named("head")?;
    let tf = volume.spikes(&[(0.2, 0.02, RED, 0.9), (0.38, 0.02, BLUE, 0.9)])?;
    let values: Vec<f64> = tf.peaks().iter().map(|p| p.value).collect();
    let f = open(
        &PEAKS_CPU,
        &volume,
        (&[], Some(&tf)),
        &volume.view([1.0, 0.3, 0.1], 2.0, 8, 8),
        (Channels::T, ""),
    )?
    .reconstruction(Stage::Stored)
    .ok_or("no function")?;
    let (from, step) = (
        volume.centre + volume.extent * isobar_core::DVec3::new(0.31, 0.02, 0.1),
        volume.extent / 60.0,
    );
    let along = -isobar_core::DVec3::new(0.96, 0.26, 0.1).normalize() * step;
    const SAMPLES: usize = 16;
    let top = 0.5 * (volume.range.0 + volume.range.1);
    let value = |x: f64| f.value(from + along * (x * SAMPLES as f64));
    let up = |v: f64| 0.3 + 0.65 * (v - volume.range.0) / (top - volume.range.0);
    let density = |v: f64| 0.25 * tf.at(v).1 / 2.31;
    let panels = (0..3).map(|which| {
        let mut p = Plot(RgbImage::from_pixel(560, 420, Rgb([255; 3])));
        let fine = |i: usize| i as f64 / 2240.0;
        for v in &values {
            p.line([0.0, up(*v)], [1.0, up(*v)], [230, 170, 170], 0);
        }
        for i in 0..2240 {
            let x = fine(i);
            p.line([x, 0.02], [x, 0.02 + density(value(x))], [170, 190, 235], 0);
        }
        for i in 0..2240 {
            p.line(
                [fine(i), up(value(fine(i)))],
                [fine(i + 1), up(value(fine(i + 1)))],
                [0; 3],
                1,
            );
        }
        for k in 0..=SAMPLES {
            let x = k as f64 / SAMPLES as f64;
            let v = value(x);
            let next = value(((k + 1) as f64 / SAMPLES as f64).min(1.0));
            let y = ((k + 1) as f64 / SAMPLES as f64).min(1.0);
            match which {
                0 => {
                    p.line([x, 0.02], [x, 0.02 + density(v)], [200, 60, 20], 1);
                    p.dot([x, up(v)], [200, 60, 20], 4);
                    p.dot([x, 0.02 + density(v)], [200, 60, 20], 4);
                }
                1 => {
                    p.line([x, up(v)], [y, up(next)], [20, 140, 40], 1);
                    p.dot([x, up(v)], [20, 140, 40], 4);
                    // What the chord makes of the opacity.
                    for i in 0..64 {
                        let s = f64::from(i) / 64.0;
                        let at = x + s * (y - x);
                        p.dot([at, 0.02 + density(v + s * (next - v))], [20, 140, 40], 1);
                    }
                }
                _ => {
                    p.dot([x, up(v)], [120; 3], 3);
                    for c in &values {
                        if (v < *c) != (next < *c) {
                            let (mut a, mut b) = (x, y);
                            for _ in 0..50 {
                                let m = 0.5 * (a + b);
                                if (value(m) < *c) == (v < *c) { a = m } else { b = m }
                            }
                            p.line([a, 0.02], [a, up(*c)], [150, 30, 150], 1);
                            p.dot([a, up(*c)], [150, 30, 150], 5);
                        }
                    }
                }
            }
        }
        p.0
    });
    write(path, &[panels.collect()])
}

fn three(path: &Path) -> Result<()> {
    let volume = named("heptane")?;
    let tf = volume.points(&[
        (0.06, BLUE, 0.0),
        (0.12, BLUE, 0.03),
        (0.2, BLUE, 0.0),
        (0.449_95, RED, 0.0),
        (0.45, RED, 0.9),
        (0.450_05, RED, 0.0),
    ])?;
    let view = volume.view([2.6, 1.9, 1.0], 1.9, 512, 450);
    let mut row = Vec::new();
    for (what, method, knobs) in [
        ("3 peak finding", &PEAKS_CPU_PAPER, "mode=peak_xor_dvr"),
        ("3 post-classification", &PEAKS_CPU_PAPER, "mode=dvr_only"),
        (
            "3 pre-integration",
            &PEAKS_CPU_PAPER,
            "mode=dvr_only integration=engel shading=on",
        ),
        ("3 peaks/cpu", &PEAKS_CPU, ""),
    ] {
        row.push(picture(&panel(what, method, &volume, (&[], &tf), &view, knobs)?.frame));
    }
    write(path, &[row])
}

fn four(path: &Path) -> Result<()> {
    let volume = named("entropic")?;
    let tf = volume.points(&[
        (0.20, BLUE, 0.0),
        (0.30, BLUE, 0.04),
        (0.348, BLUE, 0.01),
        (0.35, GOLD, 0.9),
        (0.352, BLUE, 0.01),
        (0.45, BLUE, 0.0),
        (0.728, RED, 0.0),
        (0.73, RED, 1.2),
        (0.732, RED, 0.0),
    ])?;
    let at = |w, h| volume.view([2.6, 0.4, 0.5], 0.42, w, h);
    let draw = |what, view: &View, knobs| {
        Ok::<_, Box<dyn std::error::Error>>(picture(
            &panel(what, &PEAKS_CPU_PAPER, &volume, (&[], &tf), view, knobs)?.frame,
        ))
    };
    write(
        path,
        &[
            vec![draw("4 peak finding", &at(1000, 320), "mode=peak_xor_dvr")?],
            vec![
                draw(
                    "4 pre-integration",
                    &at(496, 320),
                    "mode=dvr_only integration=engel shading=on",
                )?,
                draw("4 isosurfaces", &at(496, 320), "mode=peak_only")?,
            ],
        ],
    )
}

fn five(path: &Path) -> Result<()> {
    let volume = named("head")?;
    let view = volume.view([1.3, 2.2, 0.6], 2.1, 400, 512);
    let near = [BLUE, GREEN, GOLD, RED, GREY];
    let near: Vec<_> = near
        .iter()
        .enumerate()
        .map(|(i, &c)| (0.14 + 0.025 * i as f64, 2e-3, c, 0.25))
        .collect();
    let tf = volume.spikes(&near)?;
    let draw = |what, surfaces: &[Surface], tf: &TransferFunction, view: &View, knobs| {
        Ok::<_, Box<dyn std::error::Error>>(panel(what, &PEAKS_CPU_PAPER, &volume, (surfaces, tf), view, knobs)?.frame)
    };
    let left = [
        draw("5 one peak a segment", &[], &tf, &view, "mode=peak_xor_dvr peaks=1")?,
        draw("5 four peaks a segment", &[], &tf, &view, "mode=peak_xor_dvr")?,
    ];
    let smooth = volume.points(&[
        (0.10, GOLD, 0.0),
        (0.18, GOLD, 0.012),
        (0.30, GOLD, 0.002),
        (0.42, RED, 0.05),
        (0.55, RED, 0.004),
        (0.68, GREY, 0.06),
        (0.85, GREY, 0.0),
    ])?;
    // The peaks once more with what is left of sixteen times their density.
    let more: Vec<Surface> = (smooth.peaks().iter())
        .map(|p| Surface {
            kind: SurfaceKind::Isovalue(p.value + 1e-7),
            opacity: 1.0 - (1.0 - p.surface().opacity).powi(15),
            ..p.surface()
        })
        .collect();
    let c = draw("5c peak finding", &[], &smooth, &view, "mode=default")?;
    let d = draw("5d peaks times 16", &more, &smooth, &view, "mode=default")?;
    let e = draw("5e post-classification", &[], &smooth, &view, "mode=dvr_only")?;
    let f = draw("5f peaks alone", &more, &smooth, &view, "mode=peak_only")?;
    let bias = Difference::between(c.width, &c.rgba, &e.rgba);
    println!(
        "  5 bias, c against e: mean {:.4}, p99 {:.4}, max {:.4}",
        bias.mean, bias.p99, bias.max
    );
    write(
        path,
        &[left.iter().map(picture).collect(), [c, d, e, f].iter().map(picture).collect()],
    )
}

/// The knobs of uniform sampling with about as many samples as `samples`: sought on every fourth pixel of every fourth row, whose rays have the same steps.
fn as_many(volume: &Volume, tf: &TransferFunction, view: &View, knobs: &str, samples: u64) -> Result<String> {
    let few = View {
        width: view.width / 4,
        height: view.height / 4,
        ..view.clone()
    };
    let samples = samples as f64 * few.pixels() as f64 / view.pixels() as f64;
    let mut step = 1.0;
    let uniform = |step: f64| format!("{knobs} sampling=uniform step={step}");
    let mut r = open(&PEAKS_CPU_PAPER, volume, (&[], Some(tf)), &few, (Channels::RGBA, knobs))?;
    for _ in 0..5 {
        r.set_knobs(&settings(&uniform(step))?)?;
        draw(r.as_mut())?;
        let got = counter(r.as_ref(), "samples") + counter(r.as_ref(), "samples for peaks");
        step *= got as f64 / samples;
    }
    Ok(uniform(step))
}

fn six(path: &Path) -> Result<()> {
    let mut rows = Vec::new();
    for (data, side, distance, low, high) in [
        ("bonsai", [2.6, 1.9, 0.6], 0.42, 0.15, 0.3),
        ("entropic", [2.6, 1.9, 0.6], 0.35, 0.36, 0.66),
    ] {
        let volume = named(data)?;
        let tf = volume.points(&[
            (low - 0.06, GREEN, 0.0),
            (low - 0.004, GREEN, 0.02),
            (low, GOLD, 0.5),
            (low + 0.004, GREEN, 0.02),
            (high - 0.004, BLUE, 0.01),
            (high, RED, 0.9),
            (high + 0.004, BLUE, 0.01),
        ])?;
        let view = volume.view(side, distance, 320, 400);
        let mut row = Vec::new();
        for (what, knobs) in [
            ("post-classification", "mode=dvr_only shading=on"),
            ("peak finding", "mode=peak_xor_dvr"),
            ("peak finding, B-spline", "mode=peak_xor_dvr reconstruction=cubic"),
        ] {
            let different = panel(
                &format!("6 {data} {what}, differential"),
                &PEAKS_CPU_PAPER,
                &volume,
                (&[], &tf),
                &view,
                knobs,
            )?;
            let even = as_many(&volume, &tf, &view, knobs, different.samples)?;
            let even = panel(
                &format!("6 {data} {what}, uniform"),
                &PEAKS_CPU_PAPER,
                &volume,
                (&[], &tf),
                &view,
                &even,
            )?;
            row.extend([picture(&even.frame), picture(&different.frame)]);
        }
        rows.push(row);
    }
    write(path, &rows)
}

fn seven(path: &Path) -> Result<()> {
    let mut row = Vec::new();
    for (data, knobs) in [("bonsai", "mode=dvr_only reconstruction=cubic"), ("entropic", "mode=default")] {
        let volume = named(data)?;
        let tf = if data == "bonsai" {
            volume.soft()?
        } else {
            volume.spikes(&[(0.4, 4e-3, BLUE, 0.15), (0.55, 4e-3, GREEN, 0.2), (0.7, 4e-3, RED, 0.8)])?
        };
        let view = volume.view([2.6, 1.9, 1.2], 3.0, 420, 420);
        let exact = panel(&format!("7 {data} exact"), &PEAKS_CPU, &volume, (&[], &tf), &view, knobs)?.frame;
        let off = |f: &Frame| Difference::between(f.width, &f.rgba, &exact.rgba);
        let b = panel(
            &format!("7 {data} differential"),
            &PEAKS_CPU_PAPER,
            &volume,
            (&[], &tf),
            &view,
            knobs,
        )?
        .frame;
        let error = off(&b).psnr;
        let mut step = 8.0;
        let uniform = |step: f64| format!("{knobs} sampling=uniform step={step}");
        while off(&panel("", &PEAKS_CPU_PAPER, &volume, (&[], &tf), &view, &uniform(step))?.frame).psnr < error && step > 1e-2 {
            step *= 0.8;
        }
        let a = panel(
            &format!("7 {data} uniform, {step:.2} voxels"),
            &PEAKS_CPU_PAPER,
            &volume,
            (&[], &tf),
            &view,
            &uniform(step),
        )?
        .frame;
        println!("  7 {data}: {error:.1} dB and {:.1} dB against exact", off(&a).psnr);
        row.extend([picture(&a), picture(&b)]);
    }
    write(path, &[row])
}
