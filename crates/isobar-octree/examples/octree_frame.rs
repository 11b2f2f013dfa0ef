//! Times `octree/cpu` on a synthetic volume at the bench view: `cargo run --release -p isobar-octree --example octree_frame -- gyroid,n=256 [repeats]
//! [threads] [reconstruction]`.

use isobar_core::{Channels, Frame, Knobs, Method, Request, Stop, Surface, View};
use isobar_fields::Synthetic;
use std::sync::Arc;
use std::time::Instant;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let spec = std::env::args().nth(1).unwrap_or_else(|| "gyroid,n=256".into());
    let repeats: usize = std::env::args().nth(2).map_or(Ok(5), |s| s.parse())?;
    let threads: usize = std::env::args().nth(3).map_or(Ok(1), |s| s.parse())?;
    let reconstruction = std::env::args().nth(4).unwrap_or_else(|| "trilinear".into());
    let synthetic: Synthetic = spec.parse()?;
    let data = Arc::new(synthetic.data()?);
    let request = Request {
        channels: Channels::T | Channels::NORMAL | Channels::SURFACE | Channels::RGBA | Channels::CLAIM,
        threads,
        knobs: Knobs::default().with("reconstruction", &reconstruction),
        ..Request::default()
    };
    let mut r = isobar_octree::OCTREE_CPU.open(&request)?;
    let clock = Instant::now();
    r.set_data(&data)?;
    println!("set_data {:?}", clock.elapsed());
    let clock = Instant::now();
    r.set_surfaces(&[Surface::isovalue(synthetic.field().isovalue, 0)])?;
    println!("set_surfaces {:?}", clock.elapsed());
    r.set_view(&View::bench(1024, 768))?;
    for _ in 0..repeats {
        println!("render {:?}", r.render(&Stop::default())?.wall);
    }
    // Another isovalue, and its first image, by turns.
    let c = synthetic.field().isovalue;
    let mut change = std::time::Duration::MAX;
    for i in 1..=repeats {
        let clock = Instant::now();
        r.set_surfaces(&[Surface::isovalue(c + 1e-3 * (i % 2) as f64, 0)])?;
        r.render(&Stop::default())?;
        change = change.min(clock.elapsed());
    }
    println!("set_surfaces and render, least {change:?}");
    r.set_surfaces(&[Surface::isovalue(c, 0)])?;
    r.render(&Stop::default())?;
    let mut f = Frame::default();
    r.read(&mut f)?;
    let hits = f.t.iter().filter(|t| t.is_finite()).count();
    let proved = f.claim.iter().filter(|c| c.bits() == 3 || c.bits() == 4).count();
    println!(
        "{hits} hits, {proved} of {} pixels proved, {:?}, {:?}",
        f.claim.len(),
        r.counters(),
        r.memory()
    );
    Ok(())
}
