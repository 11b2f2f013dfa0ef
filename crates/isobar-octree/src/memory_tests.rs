//! What the index takes beyond the samples: at most a tenth of them, for sources of 64 MiB in which every brick is active.

use crate::OCTREE_CPU;
use isobar_core::{Channels, DVec3, Data, Frame, Grid, Knobs, Renderer, Request, Samples, Stop, Surface, View};
use isobar_fields::Kind;
use std::sync::Arc;

fn open(kind: Kind, data: &Arc<Data>) -> Box<dyn Renderer> {
    let request = Request {
        channels: Channels::T | Channels::NORMAL | Channels::CLAIM,
        knobs: Knobs::default().with("reconstruction", kind.name()),
        ..Request::default()
    };
    let mut r = isobar_scenes::open(&OCTREE_CPU, &request);
    r.set_data(data).unwrap();
    r
}

fn frame(r: &mut dyn Renderer, view: &View) -> Frame {
    r.set_view(view).unwrap();
    r.render(&Stop::default()).unwrap();
    let mut frame = Frame::default();
    r.read(&mut frame).unwrap();
    frame
}

fn counter(r: &dyn Renderer, name: &str) -> u64 {
    r.counters().0.iter().find(|c| c.0 == name).unwrap().1
}

/// From both ends of z: bricks with words of their own and bricks without, near and far.
fn views(data: &Data) -> [View; 2] {
    [-1.0, 1.0].map(|side| View::fit_from(data.bounds(), DVec3::new(0.2, 0.15, side), DVec3::Y, 40.0, 48, 32))
}

/// Noise of 64 MiB: less than a tenth of it for the index, before an image and after, and the hits of the same samples in f32.
fn holds(dims: [usize; 3], of: impl Fn(Vec<u8>) -> Samples) {
    let mut seed = 5u64;
    let noise: Vec<u8> = (0..dims.iter().product::<usize>().div_ceil(4))
        .flat_map(|_| {
            seed = seed
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            ((seed >> 32) as u32).to_le_bytes()
        })
        .collect();
    let single = Samples::F32(noise.iter().map(|&v| f32::from(v)).collect());
    let of_type = of(noise);
    assert_eq!(of_type.bytes(), 64 << 20);
    let name = of_type.type_name();
    let [data, same] = [of_type, single].map(|s| Arc::new(Data::Grid(Grid::unit(dims, s).unwrap())));
    let views = views(&data);
    for kind in [Kind::Trilinear, Kind::Cubic] {
        let mut renderers = [open(kind, &data), open(kind, &same)];
        for isovalue in [127.5, 100.0] {
            for r in &mut renderers {
                r.set_surfaces(&[Surface::isovalue(isovalue, 0)]).unwrap();
            }
            for view in &views {
                let [a, b] = renderers.each_mut().map(|r| frame(&mut **r, view));
                assert!(a.t.iter().filter(|t| t.is_finite()).count() > 300, "{name}, {kind}");
                assert!(
                    a.t == b.t && a.claim == b.claim,
                    "{name}, {kind} at {isovalue}: other hits than f32"
                );
                let r = &renderers[0];
                let bricks: usize = dims.map(|n| n.div_ceil(4)).iter().product();
                assert!(
                    counter(&**r, "active bricks") as usize * 10 > bricks * 9,
                    "all bricks are active"
                );
                let memory = r.memory();
                assert_eq!((memory.coefficients, memory.device), (0, 0));
                assert!(memory.index * 10 <= 64 << 20, "{name}, {kind}: {} bytes", memory.index);
            }
        }
    }
}

#[test]
fn an_index_of_u8_takes_a_tenth_of_the_samples() {
    holds([512, 512, 256], |s| Samples::U8(s.into()));
}

#[test]
fn an_index_of_16_bits_takes_a_tenth_of_the_samples() {
    holds([256, 512, 256], |s| Samples::U16(s.into_iter().map(u16::from).collect()));
    holds([256, 512, 256], |s| Samples::I16(s.into_iter().map(i16::from).collect()));
}

#[test]
fn an_index_of_f32_takes_a_tenth_of_the_samples() {
    holds([256, 256, 256], |s| Samples::F32(s.into_iter().map(f32::from).collect()));
}
