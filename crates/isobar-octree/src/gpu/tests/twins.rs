//! Frames of the GPU against those of the CPU: how far apart they are, and how many pixels are beyond the constants of [`agreement`](crate::agreement).

use super::*;
use crate::OCTREE_CPU;
use crate::agreement::{Agreement, NORMAL, T};
use crate::gpu::OCTREE_GPU;
use isobar_core::{DMat3, Samples};

const KINDS: [Kind; 3] = [Kind::Trilinear, Kind::Quadratic, Kind::Cubic];

/// Noise of `n` samples from -128 to 127, times a power of two: floats of few digits, so that even subnormal ones hold them.
fn bytes(dims: [usize; 3], exponent: i32) -> Arc<Data> {
    let mut random = Random(11);
    let by = f64::from_bits(((1023 + exponent) as u64) << 52);
    let samples: Vec<f32> = (0..dims.iter().product())
        .map(|_| ((random.single() * 256.0 - 128.0).floor() * by) as f32)
        .collect();
    Arc::new(Data::Grid(
        Grid::new(
            dims,
            DVec3::new(1.0, 0.75, 1.25),
            DVec3::ZERO,
            DMat3::IDENTITY,
            Samples::F32(samples.into()),
        )
        .unwrap(),
    ))
}

/// Samples near 3.4e38 and subnormal ones are drawn as those in the middle of f32's range, bit by bit: t, surfaces, normals, colours and work.
#[test]
fn frames_do_not_depend_on_the_scale_of_the_samples() {
    let Some(_gpu) = adapter("frames_do_not_depend_on_the_scale_of_the_samples") else {
        return;
    };
    let view = View::fit(bytes([7, 6, 5], 0).bounds(), 40.0, 40, 30);
    for kind in KINDS.into_iter().chain([Kind::CubicInterpolating]) {
        let asked = Request {
            channels: Channels::all() - Channels::CLAIM - Channels::T_ERROR,
            ..request(3, knobs(kind))
        };
        let mut r = open(&OCTREE_GPU, &asked);
        let mut drawn = |exponent: i32| {
            let by = 2f64.powi(exponent);
            let surfaces = [Surface::isovalue(20.5 * by, 0), Surface::isovalue(-31.25 * by, 1)];
            draw(&mut *r, &bytes([7, 6, 5], exponent), &surfaces, &view)
        };
        let usual = drawn(0);
        let hits: u64 = usual.hits.iter().map(|h| u64::from(*h)).sum();
        assert!(hits > 300, "{kind}: {hits}");
        // 128 * 2^120 is 1.7e38; prefiltered coefficients, up to 27 times as large, are to fit f32. Below 2^-126 floats are subnormal; prefiltered ones are rounded there.
        let exponents: &[i32] = if kind.interpolates() {
            &[-100, 100, 115]
        } else {
            &[-149, -140, -100, 100, 120]
        };
        for exponent in exponents {
            assert!(drawn(*exponent) == usual, "{kind}, samples times 2^{exponent}");
        }
    }
}

/// One huge sample beside tiny ones: what is 2^-157 of the greatest, and no more, is lost.
#[test]
fn tiny_samples_beside_large_ones_keep_their_surface() {
    let Some(_gpu) = adapter("tiny_samples_beside_large_ones_keep_their_surface") else {
        return;
    };
    let grid = |far: f64| sampled([12, 3, 3], |x, _, _| if x == 11.0 { far } else { (x - 4.25) * 1e-40 });
    let ray = isobar_core::Ray {
        origin: DVec3::new(-1.0, 1.0, 1.0),
        direction: DVec3::X,
    };
    let mut r = open(&OCTREE_GPU, &request(1, Knobs::default()));
    for far in [1.0, 1e-40, 1e4] {
        let f = draw(
            &mut *r,
            &Arc::new(Data::Grid(grid(far))),
            &[Surface::isovalue(0.0, 0)],
            &View::rays(vec![ray]),
        );
        assert!((f.t[0] - 5.25).abs() < 2e-4, "{far}: {}", f.t[0]);
    }
}

/// Every pixel is alike within the constants, or is counted here. Other drivers may round otherwise: the numbers are those of llvmpipe (Mesa 22.3.6).
#[test]
fn every_pixel_is_that_of_the_cpu_or_is_counted() {
    let Some(_gpu) = adapter("every_pixel_is_that_of_the_cpu_or_is_counted") else {
        return;
    };
    let noise = |dims, which| Arc::new(Data::Grid(random_grid(dims, which)));
    let scenes = [
        ("noise, f32", noise([12, 9, 10], 3), 0.1, [(0, 0); 3]),
        ("noise, i16", noise([12, 9, 10], 1), 300.25, [(0, 0); 3]),
        ("gyroid", synthetic("gyroid,n=35"), 0.2, [(0, 0); 3]),
        ("marschner-lobb", synthetic("marschner-lobb,n=40"), 0.5, [(0, 0); 3]),
    ];
    let mut wrong = Vec::new();
    for (name, data, c, counts) in scenes {
        let view = View::fit(data.bounds(), 40.0, 80, 60);
        for (kind, count) in KINDS.into_iter().zip(counts) {
            let frame = |m: &dyn isobar_core::Method| {
                draw(
                    &mut *open(m, &request(4, knobs(kind))),
                    &data,
                    &[Surface::isovalue(c, 0)],
                    &view,
                )
            };
            let Data::Grid(grid) = &*data else {
                unreachable!("scenes are grids")
            };
            let a = Agreement::of(&frame(&OCTREE_GPU), &frame(&OCTREE_CPU), view.pixels(), grid.domain().voxel());
            assert!(a.hit > 500, "{name} {kind}: {a:?}");
            println!("{name} {kind}: {a:?}");
            // Seen: 1.3e-5 voxel and 3e-5 of a normal at most, both in noise of degree 2.
            if (a.other, a.beyond) != count || a.t > 0.4 * T || a.normal > 0.5 * NORMAL {
                wrong.push(format!("{name} {kind}: {a:?}"));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}
