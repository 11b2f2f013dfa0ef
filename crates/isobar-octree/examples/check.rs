//! `octree/cpu` against the certified oracle, every pixel at 512x384, drawn in packets:
//! `cargo run --release -p isobar-octree --example check -- SOURCE ISOVALUE RECONSTRUCTION...`.
//!
//! SOURCE is a synthetic field (bench view) or a file (whole volume in view). The exit status is 1 where a pixel is missed, false or wrong, or a claim refuted.

use isobar_core::{Channels, Data, Frame, Knobs, Method, Request, Stage, Stop, Surface, View};
use isobar_fields::Synthetic;
use isobar_oracle::{Truth, check};
use std::path::Path;
use std::sync::Arc;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [source, isovalue, kinds @ ..] = arguments.as_slice() else {
        return Err("usage: check SOURCE ISOVALUE RECONSTRUCTION...".into());
    };
    let (data, view): (Data, _) = match source.parse::<Synthetic>() {
        Ok(s) => (s.data()?, View::bench(512, 384)),
        Err(_) => {
            let data = isobar_io::load(Path::new(source), &isobar_io::Options::default())?.data;
            let view = View::fit(data.bounds(), 40.0, 512, 384);
            (data, view)
        }
    };
    let data = Arc::new(data);
    let surfaces = [Surface::isovalue(isovalue.parse()?, 0)];
    let mut bad = 0;
    for kind in kinds {
        let request = Request {
            channels: Channels::all() - Channels::HITS,
            knobs: Knobs::default().with("reconstruction", kind),
            ..Request::default()
        };
        let mut r = isobar_octree::OCTREE_CPU.open(&request)?;
        r.set_data(&data)?;
        r.set_surfaces(&surfaces)?;
        r.set_view(&view)?;
        r.render(&Stop::default())?;
        let mut frame = Frame::default();
        r.read(&mut frame)?;
        let f = r.reconstruction(Stage::Stored).ok_or("no function")?;
        let truth = Truth::compute(&f, &surfaces, &view, &Stop::default())?;
        let c = check(&frame, &truth, &f, &surfaces, &view)?;
        println!(
            "{source} {isovalue} {kind}: {} hits, missed {}, false {}, wrong {}, refuted {}, undecidable {}, unclaimed {}, t error {:.1e} voxels, normal {:.1e} degrees at most; {:?}",
            c.hits,
            c.missed,
            c.false_hits,
            c.wrong_root + c.wrong_surface,
            c.refuted,
            c.undecidable,
            c.unclaimed,
            c.t_error_voxels.max,
            c.normal_error_deg.max,
            r.counters(),
        );
        bad += c.missed + c.false_hits + c.wrong_root + c.wrong_surface + c.refuted;
    }
    std::process::exit(i32::from(bad > 0));
}
