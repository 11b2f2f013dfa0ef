//! Times, samples and lost crossings of both methods on one data set.
//!
//! `measure DATA [repeats] [WxH] [reconstruction] [part of a case's name]`: with the two peaks of `bench-data/tf/two-peaks.toml` at .15 and .45 of the data's range, opacity .3. CPU time is that of the whole
//! process on one thread, least and median of the repeats, methods interleaved.

use isobar_core::{Channels, Frame, Knobs, Method, Renderer, Request, Samples, Stop, Surface, TransferFunction, View};
use isobar_peaks::tables::{Bins, PeakTable, Reach, SegmentTable};
use isobar_peaks::{Medium, PEAKS_CPU, PEAKS_CPU_PAPER, PeaksCpu};
use std::sync::Arc;

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

fn cpu() -> f64 {
    let t = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    t.tv_sec as f64 + 1e-9 * t.tv_nsec as f64
}

fn two_peaks((lo, hi): (f64, f64), unit: f64) -> Result<TransferFunction> {
    let mut points = Vec::new();
    for (at, c) in [(0.15, [0.15, 0.45, 0.1]), (0.45, [0.75, 0.35, 0.15])] {
        let v = lo + at * (hi - lo);
        let w = 1e-3 * (hi - lo);
        points.extend([(v - w, c, 0.0), (v, c, 0.356_674_94), (v + w, c, 0.0)]);
    }
    Ok(TransferFunction::new(points, unit)?)
}

/// A soft medium over the upper half of the range, with a peak in it.
fn soft((lo, hi): (f64, f64), unit: f64) -> Result<TransferFunction> {
    let at = |x: f64| lo + x * (hi - lo);
    let points = vec![
        (at(0.1), [0.2, 0.3, 0.6], 0.0),
        (at(0.3), [0.3, 0.5, 0.2], 0.02),
        (at(0.5), [0.8, 0.3, 0.1], 0.08),
        (at(0.9), [0.9, 0.9, 0.8], 0.01),
    ];
    Ok(TransferFunction::new(points, unit)?)
}

struct Case {
    name: &'static str,
    renderer: Box<dyn Renderer>,
    seconds: Vec<f64>,
}

fn case(
    name: &'static str,
    method: &PeaksCpu,
    data: &Arc<isobar_core::Data>,
    scene: (&[Surface], Option<&TransferFunction>, &View),
    (channels, knobs): (Channels, &str),
) -> Result<Case> {
    let mut k = Knobs::default();
    for pair in knobs.split_whitespace() {
        let (n, v) = pair.split_once('=').ok_or("knobs are name=value")?;
        k.set(n, v);
    }
    let request = Request {
        channels,
        threads: 1,
        knobs: k,
        ..Request::default()
    };
    let mut renderer = method.open(&request)?;
    renderer.set_data(data)?;
    renderer.set_surfaces(scene.0)?;
    renderer.set_medium(scene.1)?;
    renderer.set_view(scene.2)?;
    Ok(Case {
        name,
        renderer,
        seconds: Vec::new(),
    })
}

fn main() -> Result<()> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let path = args.first().ok_or("measure DATA [repeats] [WxH] [reconstruction]")?;
    let repeats: usize = args.get(1).map_or(Ok(5), |s| s.parse())?;
    let (w, h) = args.get(2).map_or("1024x768", |s| s).split_once('x').ok_or("WxH")?;
    let recon = args.get(3).map_or("trilinear", |s| s);
    let part = args.get(4).map_or("", |s| s);
    let loaded = isobar_io::load(path.as_ref(), &isobar_io::Options::default())?;
    let data = Arc::new(loaded.data);
    let isobar_core::Data::Grid(grid) = &*data else {
        return Err("a grid".into());
    };
    let range = match &grid.samples {
        Samples::U8(_) => (0.0, 255.0),
        s => s.range().0.ok_or("no finite sample")?,
    };
    let (lo, hi) = data.bounds();
    let view = View::fit((lo, hi), 40.0, w.parse()?, h.parse()?);
    let unit = (hi - lo).max_element() / 256.0;
    let (sharp, soft) = (two_peaks(range, unit)?, soft(range, unit)?);
    let first = Channels::T | Channels::NORMAL | Channels::SURFACE | Channels::RGBA;
    let every = first | Channels::HITS;
    let one = [Surface::isovalue(range.0 + 0.15 * (range.1 - range.0), 0)];
    let r = format!("reconstruction={recon}");
    let with = |k: &str| format!("{r} {k}");
    let mut cases = Vec::new();
    {
        let mut add = |name, method, surfaces: &[Surface], tf: Option<&TransferFunction>, channels, k: &str| -> Result<()> {
            if !str::contains(name, part) {
                return Ok(());
            }
            cases.push(case(name, method, &data, (surfaces, tf, &view), (channels, &with(k)))?);
            Ok(())
        };
        let (t, s) = (Some(&sharp), Some(&soft));
        add(
            "one opaque peak, exact, claims",
            &PEAKS_CPU,
            &one,
            None,
            first,
            "mode=peak_only",
        )?;
        add(
            "one opaque peak, exact",
            &PEAKS_CPU,
            &one,
            None,
            first,
            "mode=peak_only claims=off",
        )?;
        add(
            "one opaque peak, paper sk=4",
            &PEAKS_CPU_PAPER,
            &one,
            None,
            first,
            "mode=peak_only",
        )?;
        add("two peaks, exact", &PEAKS_CPU, &[], t, first, "")?;
        add("two peaks, exact, every hit", &PEAKS_CPU, &[], t, every, "mode=peak_only")?;
        add("two peaks, paper sk=4", &PEAKS_CPU_PAPER, &[], t, first, "")?;
        add(
            "two peaks, paper sk=4, xor",
            &PEAKS_CPU_PAPER,
            &[],
            t,
            first,
            "mode=peak_xor_dvr",
        )?;
        add("two peaks, paper sk=4, one peak", &PEAKS_CPU_PAPER, &[], t, first, "peaks=1")?;
        add(
            "two peaks, paper sk=4, every hit",
            &PEAKS_CPU_PAPER,
            &[],
            t,
            every,
            "mode=peak_only",
        )?;
        add(
            "  printed table, every hit",
            &PEAKS_CPU_PAPER,
            &[],
            t,
            every,
            "mode=peak_only table=printed",
        )?;
        add("  sk=1, every hit", &PEAKS_CPU_PAPER, &[], t, every, "mode=peak_only sk=1")?;
        add("two peaks, post sk=4", &PEAKS_CPU_PAPER, &[], t, first, "mode=dvr_only")?;
        add(
            "two peaks, engel sk=4",
            &PEAKS_CPU_PAPER,
            &[],
            t,
            first,
            "mode=dvr_only integration=engel",
        )?;
        add(
            "two peaks, paper, no macrocells",
            &PEAKS_CPU_PAPER,
            &[],
            t,
            first,
            "macrocells=off",
        )?;
        add(
            "two peaks, paper, multiplier",
            &PEAKS_CPU_PAPER,
            &[],
            t,
            first,
            "multiplier=on",
        )?;
        add("soft medium, exact", &PEAKS_CPU, &[], s, first, "mode=dvr_only")?;
        add("soft medium, post sk=4", &PEAKS_CPU_PAPER, &[], s, first, "mode=dvr_only")?;
    }
    for _ in 0..=repeats {
        for c in &mut cases {
            let before = cpu();
            c.renderer.render(&Stop::default())?;
            c.seconds.push(cpu() - before);
        }
    }
    println!("{path} {:?} {w}x{h} {recon}", grid.dims);
    println!("{:38} {:>8} {:>8} {:>8}  counters", "case", "least ms", "median", "first");
    for c in &mut cases {
        let mut s = c.seconds[1..].to_vec();
        s.sort_by(f64::total_cmp);
        let mut frame = Frame::default();
        c.renderer.read(&mut frame)?;
        let hits: u64 = frame.hits.iter().map(|&h| u64::from(h)).sum();
        let counters: Vec<String> = c.renderer.counters().0.iter().map(|(n, v)| format!("{n} {v}")).collect();
        println!(
            "{:38} {:8.1} {:8.1} {:8.1}  hits {hits}; {}",
            c.name,
            1e3 * s[0],
            1e3 * s[s.len() / 2],
            1e3 * c.seconds[0],
            counters.join(", ")
        );
    }
    let medium = Medium::new(&sharp);
    let values: Vec<f64> = sharp.peaks().iter().map(|p| p.value).collect();
    for n in [128, 256] {
        let bins = Bins::new(range, n);
        let (mut peak, mut pre) = (f64::INFINITY, f64::INFINITY);
        for _ in 0..5 {
            let t = cpu();
            std::hint::black_box(PeakTable::new(&values, bins, Reach::Printed, 4));
            let u = cpu();
            std::hint::black_box(SegmentTable::new(&medium, bins));
            (peak, pre) = (peak.min(u - t), pre.min(cpu() - u));
        }
        println!(
            "tables of {n} bins: peaks {:.3} ms, pre-integration {:.3} ms",
            1e3 * peak,
            1e3 * pre
        );
    }
    Ok(())
}
