//! Times frames of `octree/cpu` that want more than the first hit of one opaque isovalue, in turn:
//! `cargo run --release -p isobar-octree --example hits -- gyroid,n=256 [repeats] [threads] [reconstruction]`. Least CPU time of all threads, bench view.

use isobar_core::{Channels, ClipPlane, DVec3, Frame, Knobs, Method, Renderer, Request, Stop, Surface, View};
use isobar_fields::Synthetic;
use std::sync::Arc;

/// A scene under a name, and the least time of its frames in milliseconds.
struct Timed {
    name: &'static str,
    renderer: Box<dyn Renderer>,
    least: f64,
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let argument = |n: usize, default: &str| std::env::args().nth(n).unwrap_or_else(|| default.into());
    let synthetic: Synthetic = argument(1, "gyroid,n=256").parse()?;
    let (repeats, threads): (usize, usize) = (argument(2, "5").parse()?, argument(3, "1").parse()?);
    let knobs = Knobs::default().with("reconstruction", argument(4, "trilinear"));
    let data = Arc::new(synthetic.data()?);
    let c = synthetic.field().isovalue;
    let first = Channels::T | Channels::NORMAL | Channels::SURFACE | Channels::RGBA | Channels::CLAIM;
    let surface = |c: f64, opacity: f32| Surface {
        opacity,
        ..Surface::isovalue(c, 0)
    };
    let (one, glass) = (vec![surface(c, 1.0)], vec![surface(c, 0.4)]);
    let three = vec![surface(c, 0.4), surface(c + 0.2, 0.4), surface(c - 0.2, 1.0)];
    let plane = ClipPlane {
        normal: DVec3::new(1.0, 0.2, 0.1),
        distance: 0.3,
        cap: false,
    };
    let cases = [
        ("first hits", first, 1, &one, vec![]),
        ("first hits, work counted", first | Channels::WORK, 1, &one, vec![]),
        ("first hits, a cut", first, 1, &one, vec![plane]),
        ("all hits, 1 layer", first | Channels::HITS, 1, &one, vec![]),
        ("all hits, 4 layers", first | Channels::HITS, 4, &one, vec![]),
        ("all hits through glass", first | Channels::HITS, 1, &glass, vec![]),
        ("three isovalues, one opaque", first, 1, &three, vec![]),
        ("three isovalues, all hits", first | Channels::HITS, 4, &three, vec![]),
    ];
    let mut timed = Vec::new();
    for (name, channels, layers, surfaces, clips) in cases {
        let mut renderer = isobar_octree::OCTREE_CPU.open(&Request {
            channels,
            layers,
            threads,
            knobs: knobs.clone(),
            ..Request::default()
        })?;
        renderer.set_data(&data)?;
        renderer.set_surfaces(surfaces)?;
        renderer.set_view(&View {
            clips,
            ..View::bench(1024, 768)
        })?;
        let least = f64::INFINITY;
        timed.push(Timed { name, renderer, least });
    }
    for _ in 0..repeats {
        for t in &mut timed {
            let clock = cpu_seconds();
            t.renderer.render(&Stop::default())?;
            t.least = t.least.min((cpu_seconds() - clock) * 1e3);
        }
    }
    let mut f = Frame::default();
    for mut t in timed {
        t.renderer.read(&mut f)?;
        let hits: u64 = f.hits.iter().map(|&h| u64::from(h)).sum();
        let proved = f.claim.iter().filter(|c| [3, 4].contains(&c.bits())).count();
        println!("{}: {:.0} ms; {hits} hits counted, {proved} pixels proved", t.name, t.least);
    }
    Ok(())
}

fn cpu_seconds() -> f64 {
    let t = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    t.tv_sec as f64 + t.tv_nsec as f64 * 1e-9
}
