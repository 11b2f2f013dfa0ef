//! Times, samples and lost crossings of both methods on one data set.
//!
//! `peaks_measure DATA [repeats] [WxH] [reconstruction] [part of a case's name]`: with the two peaks of `bench-data/tf/two-peaks.toml` at .15 and .45 of the data's range, opacity .3. CPU time is that of the whole
//! process on one thread, least and median of the repeats, methods interleaved.

mod common;

use common::{Result, Volume, cpu, open};
use isobar_core::{Channels, Frame, Renderer, Stop, Surface, TransferFunction, View};
use isobar_peaks::tables::{Bins, PeakTable, Reach, SegmentTable};
use isobar_peaks::{Medium, PEAKS_CPU, PEAKS_CPU_PAPER, PeaksCpu};

struct Case {
    name: &'static str,
    renderer: Box<dyn Renderer>,
    seconds: Vec<f64>,
}

fn case(
    name: &'static str,
    method: &PeaksCpu,
    volume: &Volume,
    (surfaces, tf, view): (&[Surface], Option<&TransferFunction>, &View),
    with: (Channels, &str),
) -> Result<Case> {
    Ok(Case {
        name,
        renderer: open(method, volume, (surfaces, tf), view, with)?,
        seconds: Vec::new(),
    })
}

fn main() -> Result<()> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let path = args.first().ok_or("peaks_measure DATA [repeats] [WxH] [reconstruction]")?;
    let repeats: usize = args.get(1).map_or(Ok(5), |s| s.parse())?;
    let (w, h) = args.get(2).map_or("1024x768", |s| s).split_once('x').ok_or("WxH")?;
    let recon = args.get(3).map_or("trilinear", |s| s);
    let part = args.get(4).map_or("", |s| s);
    let volume = common::load(path.as_ref())?;
    let range = volume.range;
    let view = View::fit(volume.data.bounds(), 40.0, w.parse()?, h.parse()?);
    let (sharp, soft) = (volume.two_peaks()?, volume.soft()?);
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
            cases.push(case(name, method, &volume, (surfaces, tf, &view), (channels, &with(k)))?);
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
    println!("{path} {:?} {w}x{h} {recon}", volume.dims);
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
    changes(&volume, &view, (&soft, &sharp), (first, &r), repeats)?;
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

/// What a new transfer function costs: alone, and with the cells that rays then look at.
fn changes(
    volume: &Volume,
    view: &View,
    (soft, sharp): (&TransferFunction, &TransferFunction),
    with: (Channels, &str),
    repeats: usize,
) -> Result<()> {
    // One pixel past the volume: all that is left of a frame is what the change makes anew.
    let nothing = View {
        width: 1,
        height: 1,
        ..volume.view([1.0; 3], 1e6, 1, 1)
    };
    for (name, method) in [("peaks/cpu", &PEAKS_CPU), ("peaks/cpu-paper", &PEAKS_CPU_PAPER)] {
        let mut r = open(method, volume, (&[], Some(soft)), &nothing, with)?;
        let mut alone = f64::INFINITY;
        for _ in 0..8 * (repeats + 1) {
            r.set_medium(Some(soft))?;
            r.render(&Stop::default())?;
            let t = cpu();
            r.set_medium(Some(sharp))?;
            r.render(&Stop::default())?;
            alone = alone.min(cpu() - t);
        }
        r.set_view(view)?;
        let (mut after, mut steady) = (f64::INFINITY, f64::INFINITY);
        for _ in 0..=repeats {
            r.set_medium(Some(soft))?;
            r.render(&Stop::default())?;
            let t = cpu();
            r.set_medium(Some(sharp))?;
            r.render(&Stop::default())?;
            let u = cpu();
            r.render(&Stop::default())?;
            (after, steady) = (after.min(u - t), steady.min(cpu() - u));
        }
        println!(
            "{name}: a new transfer function {:.2} ms alone; the first image with it {:.1} ms more than the {:.1} ms of the next",
            1e3 * alone,
            1e3 * (after - steady),
            1e3 * steady
        );
    }
    Ok(())
}
