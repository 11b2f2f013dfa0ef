//! How many rays of a frame need exact arithmetic, how many pixels are left without a claim, what claims cost, and what an exact ray costs: `octree/cpu`, one thread, 1024x768.
//! `cargo run --release -p isobar-octree --example proofs -- [REPEATS] [DATA ISOVALUE]...`; DATA is a file (default view) or a synthetic field (bench view). Times are CPU time of the process, the least
//! of the frames with claims and without, in turn. For the last two columns the first sample is made so great that f64 tells nothing about the others, and 2000 rays of the view are drawn as a list.

use isobar_core::{Channels, Data, Frame, Grid, Knobs, Method, Renderer, Request, Samples, Stop, Surface, View};
use isobar_fields::{Kind, Synthetic};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

fn main() -> Result<()> {
    let mut args = std::env::args().skip(1);
    let repeats: usize = args.next().map_or(Ok(5), |s| s.parse())?;
    let mut scenes: Vec<String> = args.collect();
    if scenes.is_empty() {
        scenes = ["marschner-lobb,n=64", "0.5", "gyroid,n=256", "0.2"]
            .map(String::from)
            .to_vec();
    }
    println!(
        "data, isovalue, reconstruction: hits, rays alone, exact, undecided, pixels without a claim; ms with claims, without; exact rays drawn, microseconds each"
    );
    for scene in scenes.chunks(2) {
        let [source, isovalue] = scene else {
            return Err("every DATA needs an ISOVALUE".into());
        };
        let isovalue: f64 = isovalue.parse()?;
        let synthetic = source.parse::<Synthetic>();
        let of_file = synthetic.is_err();
        let data = match synthetic {
            Ok(s) => s.data()?,
            Err(_) => isobar_io::load(Path::new(source), &isobar_io::Options::default())?.data,
        };
        let view = if of_file {
            View::fit(data.bounds(), 40.0, 1024, 768)
        } else {
            View::bench(1024, 768)
        };
        let Data::Grid(grid) = &data else {
            return Err(format!("{source} holds no grid").into());
        };
        let blind = Arc::new(Data::Grid(blinded(grid)));
        let data = Arc::new(data.clone());
        let name = Path::new(source)
            .file_name()
            .map_or(source.as_str().into(), |n| n.to_string_lossy());
        for kind in [Kind::Trilinear, Kind::Cubic] {
            let mut with = Drawn::new(&data, kind, isovalue, &view, true)?;
            let mut without = Drawn::new(&data, kind, isovalue, &view, false)?;
            let mut least = [Duration::MAX; 2];
            for _ in 0..=repeats {
                least[0] = least[0].min(with.draw()?);
                least[1] = least[1].min(without.draw()?);
            }
            let pixels = (0..2000).map(|i| (i * 7919 % 1024, i * 104_729 % 768));
            let list = View::rays(pixels.map(|(x, y)| view.ray(x, y)).collect::<Vec<_>>());
            let mut all = Drawn::new(&blind, kind, isovalue, &list, true)?;
            let mut off = Drawn::new(&blind, kind, isovalue, &list, false)?;
            let time = all.draw()?.saturating_sub(off.draw()?);
            let exact = all.count("rays exact");
            let mut frame = Frame::default();
            with.renderer.read(&mut frame)?;
            println!(
                "{name}, {isovalue}, {kind}: {}, {}, {}, {}, {}; {:.1}, {:.1}; {exact}, {:.0}",
                frame.t.iter().filter(|t| t.is_finite()).count(),
                with.count("rays alone"),
                with.count("rays exact"),
                with.count("rays undecided"),
                frame.claim.iter().filter(|c| c.bits() & 3 != 3 && c.bits() & 4 == 0).count(),
                least[0].as_secs_f64() * 1e3,
                least[1].as_secs_f64() * 1e3,
                time.as_secs_f64() * 1e6 / exact.max(1) as f64,
            );
        }
    }
    Ok(())
}

/// The samples as f32, the first one of 1e30 times their size.
fn blinded(grid: &Grid) -> Grid {
    let mut samples: Vec<f32> = (0..grid.samples.len()).map(|i| grid.samples.get(i) as f32).collect();
    samples[0] = 1e30;
    let mut grid = grid.clone();
    grid.samples = Samples::F32(samples.into());
    grid
}

struct Drawn {
    renderer: Box<dyn Renderer>,
}

impl Drawn {
    fn new(data: &Arc<Data>, kind: Kind, isovalue: f64, view: &View, claims: bool) -> Result<Self> {
        let request = Request {
            channels: Channels::T | Channels::NORMAL | Channels::SURFACE | Channels::RGBA | Channels::CLAIM,
            threads: 1,
            knobs: Knobs::default()
                .with("reconstruction", kind.name())
                .with("claims", if claims { "on" } else { "off" }),
            ..Request::default()
        };
        let mut renderer = isobar_octree::OCTREE_CPU.open(&request)?;
        renderer.set_data(data)?;
        renderer.set_surfaces(&[Surface::isovalue(isovalue, 0)])?;
        renderer.set_view(view)?;
        Ok(Self { renderer })
    }

    fn draw(&mut self) -> Result<Duration> {
        let start = cpu_time();
        self.renderer.render(&Stop::default())?;
        Ok(cpu_time().saturating_sub(start))
    }

    fn count(&self, name: &str) -> u64 {
        self.renderer.counters().0.iter().find(|c| c.0 == name).map_or(0, |c| c.1)
    }
}

/// Of all threads.
fn cpu_time() -> Duration {
    let t = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    Duration::new(t.tv_sec.unsigned_abs(), t.tv_nsec as u32)
}
