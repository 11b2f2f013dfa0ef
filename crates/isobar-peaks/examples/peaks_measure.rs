//! Times, samples and lost crossings of both methods on one data set.
//!
//! `peaks_measure DATA [repeats] [WxH] [reconstruction] [part of a case's name] [threads]`: with the two peaks of `bench-data/tf/two-peaks.toml` at .15 and .45 of the data's range, opacity .3. CPU time is that
//! of the whole process, summed over its threads (one, unless said), least and median of the repeats, cases interleaved; beside it the median of the wall time. After the cases, and for the part "change",
//! what a new transfer function costs, and the first image with it.

mod common;

use common::{Result, Volume, cpu, open_on};
use isobar_core::{Channels, Frame, Renderer, Stop, Surface, TransferFunction, View};
use isobar_peaks::tables::{Bins, PeakTable, Reach, SegmentTable};
use isobar_peaks::{Medium, PEAKS_CPU, PEAKS_CPU_PAPER, PeaksCpu};

struct Case {
    name: &'static str,
    renderer: Box<dyn Renderer>,
    seconds: Vec<f64>,
    walls: Vec<f64>,
}

fn case(
    name: &'static str,
    threads: usize,
    method: &PeaksCpu,
    volume: &Volume,
    (surfaces, tf, view): (&[Surface], Option<&TransferFunction>, &View),
    with: (Channels, &str),
) -> Result<Case> {
    Ok(Case {
        name,
        renderer: open_on(threads, method, volume, (surfaces, tf), view, with)?,
        seconds: Vec::new(),
        walls: Vec::new(),
    })
}

fn main() -> Result<()> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let path = args
        .first()
        .ok_or("peaks_measure DATA [repeats] [WxH] [reconstruction] [part of a case's name] [threads]")?;
    let repeats: usize = args.get(1).map_or(Ok(5), |s| s.parse())?;
    let (w, h) = args.get(2).map_or("1024x768", |s| s).split_once('x').ok_or("WxH")?;
    let recon = args.get(3).map_or("trilinear", |s| s);
    let part = args.get(4).map_or("", |s| s);
    let threads: usize = args.get(5).map_or(Ok(1), |s| s.parse())?;
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
            cases.push(case(
                name,
                threads,
                method,
                &volume,
                (surfaces, tf, &view),
                (channels, &with(k)),
            )?);
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
        add("two peaks, exact, cell by cell", &PEAKS_CPU, &[], t, first, "packets=off")?;
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
        add(
            "soft medium, exact, cell by cell",
            &PEAKS_CPU,
            &[],
            s,
            first,
            "mode=dvr_only packets=off",
        )?;
        add("soft medium, post sk=4", &PEAKS_CPU_PAPER, &[], s, first, "mode=dvr_only")?;
    }
    for _ in 0..=repeats {
        for c in &mut cases {
            let before = cpu();
            let time = c.renderer.render(&Stop::default())?;
            c.seconds.push(cpu() - before);
            c.walls.push(time.wall.as_secs_f64());
        }
    }
    println!("{path} {:?} {w}x{h} {recon}, threads: {threads}", volume.dims);
    println!(
        "{:38} {:>8} {:>8} {:>8} {:>8}  counters",
        "case", "least ms", "median", "first", "wall"
    );
    for c in &mut cases {
        let [s, walls] = [&c.seconds, &c.walls].map(|all| {
            let mut s = all[1..].to_vec();
            s.sort_by(f64::total_cmp);
            s
        });
        let mut frame = Frame::default();
        c.renderer.read(&mut frame)?;
        let hits: u64 = frame.hits.iter().map(|&h| u64::from(h)).sum();
        let counters: Vec<String> = c.renderer.counters().0.iter().map(|(n, v)| format!("{n} {v}")).collect();
        println!(
            "{:38} {:8.1} {:8.1} {:8.1} {:8.1}  hits {hits}; {}",
            c.name,
            1e3 * s[0],
            1e3 * s[s.len() / 2],
            1e3 * c.seconds[0],
            1e3 * walls[walls.len() / 2],
            counters.join(", ")
        );
    }
    if part.is_empty() || part == "change" {
        changes(&volume, &view, (&soft, &sharp), (first, &r), (repeats, threads))?;
        tables(&sharp, range);
    }
    Ok(())
}

/// What the tables cost.
fn tables(sharp: &TransferFunction, range: (f64, f64)) {
    let medium = Medium::new(sharp);
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
}

/// What a new transfer function costs: alone, and with what the first image looks at for the first time. CPU time, then wall time.
fn changes(
    volume: &Volume,
    view: &View,
    (soft, sharp): (&TransferFunction, &TransferFunction),
    with: (Channels, &str),
    (repeats, threads): (usize, usize),
) -> Result<()> {
    // One pixel past the volume: all that is left of a frame is what the change makes anew.
    let nothing = View {
        width: 1,
        height: 1,
        ..volume.view([1.0; 3], 1e6, 1, 1)
    };
    // CPU and wall seconds of one image, with a new transfer function or not.
    let image = |r: &mut dyn Renderer, tf: Option<&TransferFunction>| -> Result<[f64; 2]> {
        let (t, wall) = (cpu(), std::time::Instant::now());
        if tf.is_some() {
            r.set_medium(tf)?;
        }
        r.render(&Stop::default())?;
        Ok([cpu() - t, wall.elapsed().as_secs_f64()])
    };
    let median = |all: &mut Vec<f64>| {
        all.sort_by(f64::total_cmp);
        1e3 * all[all.len() / 2]
    };
    for (name, method) in [("peaks/cpu", &PEAKS_CPU), ("peaks/cpu-paper", &PEAKS_CPU_PAPER)] {
        let mut r = open_on(threads, method, volume, (&[], Some(soft)), &nothing, with)?;
        let mut alone = [f64::INFINITY; 2];
        for _ in 0..8 * (repeats + 1) {
            image(r.as_mut(), Some(soft))?;
            let new = image(r.as_mut(), Some(sharp))?;
            alone = [0, 1].map(|i| alone[i].min(new[i]));
        }
        r.set_view(view)?;
        let (mut steady, mut more) = ([Vec::new(), Vec::new()], [Vec::new(), Vec::new()]);
        for _ in 0..=repeats {
            image(r.as_mut(), Some(soft))?;
            let first = image(r.as_mut(), Some(sharp))?;
            let next = image(r.as_mut(), None)?;
            for i in 0..2 {
                steady[i].push(next[i]);
                more[i].push(first[i] - next[i]);
            }
        }
        let ([a, b], [steady, wall], [c, d]) = (
            alone.map(|x| 1e3 * x),
            steady.each_mut().map(median),
            more.each_mut().map(median),
        );
        println!(
            "{name}: a new transfer function {a:.2} ms alone (wall {b:.2}); the first image with it {c:.1} ms more than the {steady:.1} ms of the next (wall {d:.1} more than {wall:.1}), medians"
        );
    }
    Ok(())
}
