//! Value and gradient on the device against `GridSpline` in f64 and the f32 twin; blocks against `Lattice::range`.

use crate::march_gpu::blocks::{self, Builder};
use crate::march_gpu::data;
use crate::march_gpu::layout::Params;
use crate::march_gpu::programs::{Filter, Program, SNIPPETS};
use crate::march_gpu::twin::Twin;
use bytemuck::Zeroable;
use isobar_core::{DVec3, Function, Lattice, Stage};
use isobar_fields::{GridSpline, Kind};
use isobar_gpu::{Gpu, Kernel, shader, test_adapter, wgpu};
use isobar_scenes::{Random, random_grid};

const EVALUATE: &[(&str, &str)] = &[("evaluate", include_str!("../../../shaders/evaluate.wgsl"))];

/// Rounding of a value in f32, in units of 2^-24 times the largest coefficient less the bias: 64 products, each with three weights
/// of a few roundings each.
const VALUE_ULPS: f64 = 24.0;
/// The same for a component of the gradient, whose weights are up to 3/2 and of both signs.
const GRADIENT_ULPS: f64 = 64.0;
/// GPU against the f32 twin, same unit: a driver may fuse a product into a sum, once per product.
const TWIN_ULPS: f64 = 16.0;

/// Values and gradients at points, from the device.
fn evaluate(
    gpu: &Gpu,
    spline: &GridSpline,
    filter: Filter,
    fractions: f32,
    bias: [f32; 2],
    points: &[[f32; 4]],
) -> Vec<[f32; 4]> {
    let (volume, _) = data::upload(gpu, spline).unwrap();
    let program = Program::new(volume.texel(), spline.kind(), filter);
    let source = program.source(&[EVALUATE, SNIPPETS, shader::SHARED], "evaluate").unwrap();
    shader::validate("evaluate", &source).unwrap();
    let kernel = Kernel::new(gpu, "evaluate", &source, "main").unwrap();
    let mut params = Params::zeroed();
    params.last = Lattice::dims(spline).map(|n| (n - 1) as f32);
    params.fractions = fractions;
    [params.bias_hi, params.bias_lo] = bias;
    let uniform = gpu.uniform("parameters", &params).unwrap();
    let input = gpu.storage("points", points).unwrap();
    let output = gpu.storage_empty("results", input.size()).unwrap();
    let resources = [
        (0, wgpu::BindingResource::TextureView(volume.view())),
        (1, uniform.as_entire_binding()),
        (2, input.as_entire_binding()),
        (3, output.as_entire_binding()),
    ];
    let bind = kernel.bind(gpu, &resources).unwrap();
    gpu.run("evaluate", 0, |w| {
        w.compute(&kernel, &bind, [points.len().div_ceil(64) as u32, 1, 1])
    })
    .unwrap();
    gpu.read(&output, points.len()).unwrap()
}

/// Random points, and points on faces, edges, cell borders and samples.
fn points(dims: [usize; 3], count: usize) -> Vec<[f32; 4]> {
    let mut r = Random(11);
    (0..count)
        .map(|i| {
            let mut p = [0.0; 4];
            for a in 0..3 {
                let last = (dims[a] - 1) as f64;
                let x = r.single() * last;
                p[a] = match (i + a * (i / 7)) % 6 {
                    0 => x.round(),
                    1 => (x.round() - 0.5).clamp(0.0, last),
                    2 => last * f64::from(u8::from(r.single() < 0.5)),
                    _ => x,
                } as f32;
            }
            p
        })
        .collect()
}

fn largest(spline: &GridSpline, bias: [f32; 2]) -> f64 {
    let cells = Lattice::cells(spline).map(|n| n - 1);
    let r = spline.range([0; 3], cells);
    let b = f64::from(bias[0]) + f64::from(bias[1]);
    (r.lo - b).abs().max((r.hi - b).abs())
}

/// One side of a comparison: largest differences of value and gradient, in units of 2^-24 of the largest coefficient.
fn differences(got: &[[f32; 4]], want: impl Iterator<Item = [f64; 4]>, unit: f64) -> (f64, f64) {
    got.iter().zip(want).fold((0.0f64, 0.0f64), |(v, g), (a, b)| {
        let d: [f64; 4] = std::array::from_fn(|i| (f64::from(a[i]) - b[i]).abs() / unit);
        (v.max(d[0]), g.max(d[1]).max(d[2]).max(d[3]))
    })
}

#[test]
fn the_device_evaluates_the_spline_of_a_random_64_cubed_volume() {
    let Some(gpu) = test_adapter("the_device_evaluates_the_spline_of_a_random_64_cubed_volume") else {
        return;
    };
    // every kind on floats, every other sample type once
    let cases = Kind::ALL.map(|k| (k, 3)).into_iter().chain([
        (Kind::Trilinear, 0),
        (Kind::Cubic, 1),
        (Kind::Quadratic, 2),
        (Kind::CubicInterpolating, 0),
    ]);
    let dims = [64; 3];
    let points = points(dims, 4000);
    for (kind, which) in cases {
        let spline = GridSpline::new(&random_grid(dims, which), kind, Stage::Stored).unwrap();
        let bias = [0.25, 1e-9];
        let b = f64::from(bias[0]) + f64::from(bias[1]);
        let unit = largest(&spline, bias) / f64::from(1 << 24);
        let got = evaluate(&gpu, &spline, Filter::Exact, 1.0, bias, &points);
        let at = |p: &[f32; 4]| DVec3::new(f64::from(p[0]), f64::from(p[1]), f64::from(p[2]));
        let exact = points.iter().map(|p| {
            let g = spline.gradient(at(p));
            [spline.value(at(p)) - b, g.x, g.y, g.z]
        });
        let (v, g) = differences(&got, exact, unit);
        assert!(v <= VALUE_ULPS && g <= GRADIENT_ULPS, "{kind} type {which}: {v} {g}");
        let twin = Twin::new(&spline, bias, 1.0);
        let (v, g) = differences(&got, points.iter().map(|p| twin_at(&twin, p)), unit);
        assert!(
            v <= TWIN_ULPS && g <= TWIN_ULPS,
            "{kind} type {which} against the twin: {v} {g}"
        );
    }
}

fn twin_at(twin: &Twin, p: &[f32; 4]) -> [f64; 4] {
    let u = [p[0], p[1], p[2]];
    let g = twin.gradient(u);
    [twin.value(u), g[0], g[1], g[2]].map(f64::from)
}

/// With fractions as fine as f32 allows, eight fetches are the spline; with 8 bits they are off by about what 2^-9 of a step in each
/// fraction makes, and less with 9.
#[test]
fn emulated_fetches_are_the_spline_but_for_their_fractions() {
    let Some(gpu) = test_adapter("emulated_fetches_are_the_spline_but_for_their_fractions") else {
        return;
    };
    let dims = [9, 7, 8];
    let points = points(dims, 3000);
    for kind in [Kind::Trilinear, Kind::Quadratic, Kind::Cubic, Kind::CubicInterpolating] {
        let spline = GridSpline::new(&random_grid(dims, 3), kind, Stage::Stored).unwrap();
        let bias = [0.0; 2];
        let size = largest(&spline, bias);
        let mut errors = Vec::new();
        for (filter, fractions) in [
            (Filter::Bits(8), 256.0),
            (Filter::Bits(9), 512.0),
            (Filter::Bits(22), 4_194_304.0),
        ] {
            assert_eq!(filter.fractions(), fractions);
            let got = evaluate(&gpu, &spline, filter, fractions, bias, &points);
            let twin = Twin::new(&spline, bias, fractions);
            let unit = size / f64::from(1 << 24);
            let close = |(a, p): (&[f32; 4], &[f32; 4])| {
                let (v, g) = differences(&[*a], std::iter::once(twin_at(&twin, p)), unit);
                v <= TWIN_ULPS && g <= GRADIENT_ULPS
            };
            // A fraction within rounding of a half step may be rounded to the other side.
            let other = got.iter().zip(&points).filter(|x| !close(*x)).count();
            assert!(other <= 15, "{kind} {filter:?}: {other} points differ from the twin");
            let at = |p: &[f32; 4]| DVec3::new(f64::from(p[0]), f64::from(p[1]), f64::from(p[2]));
            let exact = points.iter().map(|p| {
                let g = spline.gradient(at(p));
                [spline.value(at(p)), g.x, g.y, g.z]
            });
            errors.push(differences(&got, exact, size));
        }
        // |s| changes by at most 2 size per unit of a fraction, three fractions, each off by at most half a step; slopes likewise.
        let bound = |fractions: f64| 3.0 * 2.0 * 0.5 / fractions;
        for (i, fractions) in [256.0, 512.0].into_iter().enumerate() {
            let (v, g) = errors[i];
            assert!(
                v <= bound(fractions) && v > 0.05 * bound(fractions),
                "{kind} value {v} of {}",
                bound(fractions)
            );
            assert!(
                g <= 4.0 * bound(fractions) && g > 0.05 * bound(fractions),
                "{kind} gradient {g}"
            );
        }
        assert!(errors[1].0 < 0.75 * errors[0].0, "{kind}: a ninth bit helps: {errors:?}");
        assert!(errors[2].0 < 4e-6 && errors[2].1 < 2e-5, "{kind}: {errors:?}");
    }
}

#[test]
fn blocks_hold_the_range_of_their_stencils() {
    let Some(gpu) = test_adapter("blocks_hold_the_range_of_their_stencils") else {
        return;
    };
    for (dims, kind, which) in [
        ([17, 9, 22], Kind::Trilinear, 0),
        ([18, 2, 5], Kind::Quadratic, 1),
        ([5, 34, 7], Kind::Cubic, 2),
        ([6, 11, 17], Kind::CubicInterpolating, 3),
        ([2, 2, 2], Kind::QuadraticInterpolating, 3),
    ] {
        let spline = GridSpline::new(&random_grid(dims, which), kind, Stage::Stored).unwrap();
        let (volume, _) = data::upload(&gpu, &spline).unwrap();
        let mut params = Params::zeroed();
        params.last = dims.map(|n| (n - 1) as f32);
        blocks::describe(&mut params, dims, kind.basis().degree, 1 << 20);
        let built = Builder::new(&gpu, volume.texel())
            .unwrap()
            .build(&gpu, &volume, &params)
            .unwrap();
        let all: Vec<[f32; 2]> = gpu.read(&built.ranges, built.ranges.size() as usize / 8).unwrap();
        let mut at = 0;
        let mut whole = [f64::INFINITY, f64::NEG_INFINITY];
        for (counts, side) in [(params.fine, params.fine_side), (params.coarse, params.coarse_side)] {
            for k in 0..counts[2] {
                for j in 0..counts[1] {
                    for i in 0..counts[0] {
                        let b = [i, j, k].map(|b| (b * side) as usize);
                        // Cells that meet the closed stretch: centred ones reach half a cell before and behind it.
                        let cells = Lattice::cells(&spline);
                        let more = usize::from(kind.basis().centred);
                        let hi = std::array::from_fn(|a| (b[a] + side as usize - 1 + more).min(cells[a] - 1));
                        let want = spline.range(b, hi);
                        let got = all[at].map(f64::from);
                        // No tighter than the stencils, and no wider than one more coefficient on each side.
                        assert!(
                            got[0] <= want.lo && got[1] >= want.hi,
                            "{kind} {dims:?} block {b:?} of {side}"
                        );
                        let lo = b.map(|x| x.saturating_sub(1));
                        let hi = std::array::from_fn(|a| (hi[a] + 1).min(cells[a] - 1));
                        let wide = spline.range(lo, hi);
                        assert!(
                            got[0] >= wide.lo && got[1] <= wide.hi,
                            "{kind} {dims:?} block {b:?} of {side}"
                        );
                        whole = [whole[0].min(got[0]), whole[1].max(got[1])];
                        at += 1;
                    }
                }
            }
        }
        assert_eq!(at, all.len());
        assert_eq!(built.range.map(f64::from), whole);
        let everything = spline.range([0; 3], Lattice::cells(&spline).map(|n| n - 1));
        assert_eq!(whole, [everything.lo, everything.hi], "{kind}");
    }
}
