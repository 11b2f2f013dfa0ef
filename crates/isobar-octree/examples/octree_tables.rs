//! Tables 6.1, 6.3 and, of 6.2, the rows of the octree caster, of Steinberger 2010 in the thesis's form, its numbers in brackets: the stages of an algebraic surface and of a volume, one thread, 1024x768.
//! `cargo run --release -p isobar-octree --example octree_tables -- [REPEATS] [DATA ISOVALUE]...`. A column of Table 6.3 stands beside the thesis's data set of its place:
//! Bucky, Dragon, Foot, Vertebra; the default is Bucky's stand-in alone, a gyroid of 32^3.

use isobar_core::{Channels, Data, Knobs, Method, Request, Stop, Surface as Isosurface, View};
use isobar_fields::{Kind, Synthetic};
use isobar_octree::comparators::algebraic::{Composition, Drawn, Extent, STAGES, Surface, draw};
use isobar_octree::figures::degrees::KINDS;
use isobar_octree::figures::printed::{TABLE_6_1, TABLE_6_2, TABLE_6_3};
use isobar_octree::finders::Finder;
use isobar_octree::stages::{Laps, Staged, stages};
use std::error::Error;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

type Result<T> = std::result::Result<T, Box<dyn Error>>;

fn main() -> Result<()> {
    let mut args = std::env::args().skip(1);
    let repeats: usize = args.next().map_or(Ok(5), |s| s.parse())?;
    let mut scenes: Vec<String> = args.collect();
    if scenes.is_empty() {
        scenes = vec!["gyroid,n=32".into(), "0.2".into()];
    }
    algebraic(repeats)?;
    for (i, scene) in scenes.chunks(2).enumerate() {
        let [source, isovalue] = scene else {
            return Err("every DATA needs an ISOVALUE".into());
        };
        volume(
            source,
            isovalue.parse()?,
            TABLE_6_3.get(i).zip(TABLE_6_2.get(i).map(|t| &t.2)),
            repeats,
        )?;
    }
    Ok(())
}

fn ms(d: Duration) -> f64 {
    d.as_secs_f64() * 1e3
}

/// One algebraic surface per degree.
fn algebraic(repeats: usize) -> Result<()> {
    for (title, how, thesis) in [
        (
            "SB1, LR81 with 6 (d + 1) iterations, f32, as the thesis",
            Composition::Sb1,
            true,
        ),
        ("the recommended composition and solver, f64", Composition::Axis, false),
    ] {
        println!("Table 6.1, per cent of a frame [the thesis], {title}");
        println!(
            "{:18}  {:>17}  {:>17}  {:>17}",
            "Stage", "tri-linear", "tri-squared", "tri-cubic"
        );
        let columns = [
            one::<1, 4>('a', how, thesis, repeats)?,
            one::<2, 7>('b', how, thesis, repeats)?,
            one::<3, 10>('c', how, thesis, repeats)?,
        ];
        for (i, stage) in STAGES.iter().enumerate() {
            print!("{stage:18}");
            for (c, printed) in columns.iter().zip(TABLE_6_1[i]) {
                print!("  {:7.3} [{printed:7.3}]", 100.0 * ms(c.stages[i]) / ms(c.total()));
            }
            println!();
        }
        print!("{:18}", "all, ms");
        for c in &columns {
            print!("  {:7.2}          ", ms(c.total()));
        }
        println!("\n");
    }
    Ok(())
}

fn one<const D: usize, const M: usize>(letter: char, how: Composition, thesis: bool, repeats: usize) -> Result<Drawn> {
    let Data::Algebraic(p) = format!("steinberger-{letter},as=algebraic").parse::<Synthetic>()?.data()? else {
        return Err("a polynomial was asked for".into());
    };
    let view = View::fit((p.lo, p.hi), 40.0, 1024, 768);
    let iterations = 6 * (D as u32 + 1);
    let mut best: Option<Drawn> = None;
    for _ in 0..repeats.max(1) {
        let d = if thesis {
            draw::<f32, D, M>(&Surface::new(&p)?, &view, how, &Finder::Lr81 { iterations }, Extent::Box)?
        } else {
            draw::<f64, D, M>(&Surface::new(&p)?, &view, how, &Finder::Robust { width: 1e-9 }, Extent::Box)?
        };
        if best.as_ref().is_none_or(|b| d.total() < b.total()) {
            best = Some(d);
        }
    }
    best.ok_or_else(|| "at least one repeat".into())
}

/// What the thesis has of a data set: its name with the stages, and frames per second.
type Printed<'a> = (&'a (&'static str, [[f64; 3]; 5]), &'a [f64; 4]);

/// One volume, three degrees.
fn volume(source: &str, isovalue: f64, printed: Option<Printed<'_>>, repeats: usize) -> Result<()> {
    let data = match source.parse::<Synthetic>() {
        Ok(s) => s.data()?,
        Err(_) => isobar_io::load(Path::new(source), &isobar_io::Options::default())?.data,
    };
    let view = View::fit(data.bounds(), 40.0, 1024, 768);
    let Data::Grid(grid) = &data else {
        return Err(format!("{source} holds no grid").into());
    };
    let grid = grid.clone();
    let data = Arc::new(data);
    let rate = printed.map(|p| p.1);
    let printed = printed.map(|p| p.0);
    let beside = printed.map_or(String::new(), |p| format!(", beside {}", p.0));
    println!("Table 6.3, {source} at {isovalue}{beside} [the thesis]: ms and per cent");
    print!("{:20}", "");
    for k in KINDS {
        print!("  {:>30}", k.name());
    }
    println!();
    let mut columns: Vec<(Staged, f64)> = Vec::new();
    for kind in KINDS {
        let whole = ordinary(&data, isovalue, kind, &view, repeats)?;
        columns.push((stages(&grid, kind, isovalue, &view, repeats)?, whole));
    }
    for (i, name) in Laps::NAMES.iter().enumerate() {
        print!("{name:20}");
        for (d, (c, _)) in columns.iter().enumerate() {
            let lap = ms(c.laps.all()[i]);
            let share = 100.0 * lap / ms(c.laps.total());
            match printed.and_then(|p| p.1.get(i).map(|row| (row[d], p.1.iter().map(|r| r[d]).sum::<f64>()))) {
                Some((of, all)) => print!("  {lap:7.2} {share:5.1} [{of:6.2} {:5.1}]", 100.0 * of / all),
                None => print!("  {lap:7.2} {share:5.1}                "),
            }
        }
        println!();
    }
    print!("{:20}", "all");
    for (c, _) in &columns {
        print!("  {:7.2}                      ", ms(c.laps.total()));
    }
    print!("\n{:20}", "without clocks");
    for (_, whole) in &columns {
        print!("  {whole:7.2}                      ");
    }
    print!("\n{:20}", "Table 6.2, fps");
    for (d, (_, whole)) in columns.iter().enumerate() {
        match rate {
            Some(of) => print!("  {:7.1}       [{:6.1}]        ", 1e3 / whole, of[d]),
            None => print!("  {:7.1}                      ", 1e3 / whole),
        }
    }
    print!("\n{:20}", "pixels hit");
    for (c, _) in &columns {
        print!(
            "  {:7}                      ",
            c.frame.t.iter().filter(|t| t.is_finite()).count()
        );
    }
    println!("\n");
    Ok(())
}

/// The ordinary frame on one thread, least of the repeats after a first one, ms.
fn ordinary(data: &Arc<Data>, isovalue: f64, kind: Kind, view: &View, repeats: usize) -> Result<f64> {
    let request = Request {
        channels: Channels::T | Channels::NORMAL | Channels::SURFACE | Channels::RGBA | Channels::CLAIM,
        threads: 1,
        knobs: Knobs::default().with("reconstruction", kind.name()),
        ..Request::default()
    };
    let mut r = isobar_octree::OCTREE_CPU.open(&request)?;
    r.set_data(data)?;
    r.set_surfaces(&[Isosurface::isovalue(isovalue, 0)])?;
    r.set_view(view)?;
    r.render(&Stop::default())?;
    let mut least = Duration::MAX;
    for _ in 0..repeats.max(1) {
        least = least.min(r.render(&Stop::default())?.wall);
    }
    Ok(ms(least))
}
