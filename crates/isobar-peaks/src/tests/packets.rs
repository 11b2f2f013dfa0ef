//! Cells and samples eight at a time give the bits of those one at a time.

use super::*;
use crate::{PEAKS_CPU, PEAKS_CPU_PAPER};
use isobar_core::{Camera, ClipPlane};

fn data(which: usize) -> Arc<Data> {
    let dims = [[19, 23, 17], [9, 30, 12], [2, 2, 2], [33, 5, 8]][which];
    let value = |x: usize, y: usize, z: usize| {
        // A corner without any change.
        if x + y < 6 && which != 2 {
            0.0
        } else {
            ((x * y) as f64 * 0.07).sin() + (z as f64 * 0.45).cos() + 0.3 * ((x + 2 * y + 3 * z) as f64 * 0.9).sin()
        }
    };
    let n: usize = dims.iter().product();
    let all = |scale: f64, offset: f64| {
        (0..n).map(move |i| value(i % dims[0], i / dims[0] % dims[1], i / dims[0] / dims[1]) * scale + offset)
    };
    let samples = match which {
        0 => Samples::F32(all(1.0, 0.0).map(|v| v as f32).collect()),
        1 => Samples::U8(all(50.0, 120.0).map(|v| v as u8).collect()),
        2 => Samples::I16(all(9000.0, 100.0).map(|v| v as i16).collect()),
        _ => Samples::U16(all(9000.0, 30_000.0).map(|v| v as u16).collect()),
    };
    Arc::new(Data::Grid(Grid::unit(dims, samples).unwrap()))
}

/// Soft medium, sharp peaks, a dense core that is cut into parts.
fn transfer((scale, offset): (f64, f64), unit: f64) -> TransferFunction {
    let v = |x: f64| x * scale + offset;
    let points = vec![
        (v(-0.9), BLUE, 0.0),
        (v(-0.6), BLUE, 0.05),
        (v(-0.301), GREEN, 0.02),
        (v(-0.3), RED, density(0.4)),
        (v(-0.299), RED, 0.01),
        (v(0.4), GREEN, 0.06),
        (v(0.69), BLUE, 0.0),
        (v(0.7), BLUE, density(0.5)),
        (v(0.71), BLUE, 0.0),
        (v(1.0), RED, 40.0),
        (v(1.3), GREEN, 3.0),
    ];
    TransferFunction::new(points, unit).unwrap()
}

fn views(data: &Data) -> Vec<View> {
    let (lo, hi) = data.bounds();
    let middle = 0.5 * (lo + hi);
    let fit = View::fit((lo, hi), 40.0, 40, 30);
    let mut cut = fit.clone();
    cut.clips.push(ClipPlane {
        normal: DVec3::new(0.6, 0.8, 0.0),
        distance: DVec3::new(0.6, 0.8, 0.0).dot(middle),
        cap: false,
    });
    let along = View {
        camera: Camera::Orthographic {
            eye: middle - 40.0 * DVec3::X,
            target: middle,
            up: DVec3::Z,
            height: (hi - lo).length(),
        },
        ..fit.clone()
    };
    vec![
        View::perspective(middle, hi + 0.3, DVec3::Y, 70.0, 40, 30),
        cut,
        along,
        View::rays((0..100).map(|i| fit.ray(i * 7 % 40, i % 30)).collect::<Vec<_>>()),
        fit,
    ]
}

fn same(method: &dyn Method, which: usize, tf: &TransferFunction, k: &[(&str, &str)], layers: usize) -> usize {
    let data = data(which);
    let surfaces = [Surface {
        opacity: 0.4,
        ..Surface::isovalue(tf.points[5].0, 2)
    }];
    let mut one = k.to_vec();
    one.push(("packets", "off"));
    let mut hits = 0;
    for view in views(&data) {
        let eight = draw(method, &data, &surfaces, Some(tf), &view, (layers, k));
        let single = draw(method, &data, &surfaces, Some(tf), &view, (layers, &one));
        assert_eq!(eight.rgba.len(), single.rgba.len());
        for i in 0..eight.rgba.len() {
            assert_eq!(
                eight.rgba[i].map(f32::to_bits),
                single.rgba[i].map(f32::to_bits),
                "{} {k:?} {which} pixel {i}",
                method.info().id
            );
        }
        assert_eq!(eight, single, "{} {k:?} {which}", method.info().id);
        hits += eight.hits.iter().map(|h| usize::from(*h)).sum::<usize>();
    }
    hits
}

const SCALES: [(f64, f64); 4] = [(1.0, 0.0), (50.0, 120.0), (9000.0, 100.0), (9000.0, 30_000.0)];

#[test]
fn eight_cells_are_one_by_one() {
    for (which, scale) in SCALES.into_iter().enumerate() {
        for (unit, k) in [
            (1.0, &[("mode", "default")][..]),
            (10.0, &[("mode", "dvr_only")]),
            (10.0, &[("mode", "peak_xor_dvr"), ("tolerance", "0.1")]),
            (100.0, &[("tolerance", "0.0001"), ("reconstruction", "cubic")]),
            (10.0, &[("reconstruction", "quadratic"), ("macrocells", "off")]),
            (10.0, &[("reconstruction", "bc21")]),
        ] {
            let hits = same(&PEAKS_CPU, which, &transfer(scale, unit), k, 2);
            assert!(hits > 100 || k == [("mode", "dvr_only")], "{k:?}: {hits}");
        }
    }
}

#[test]
fn eight_samples_are_one_by_one() {
    for (which, scale) in SCALES.into_iter().enumerate() {
        let tf = transfer(scale, 10.0);
        for k in [
            &[("mode", "default")][..],
            &[("mode", "peak_only"), ("sampling", "printed")],
            &[("mode", "dvr_only"), ("integration", "engel")],
            &[("mode", "peak_xor_dvr"), ("sampling", "geometric"), ("sk", "2")],
            &[("sampling", "printed"), ("shading", "on"), ("multiplier", "on")],
            &[
                ("sampling", "uniform"),
                ("step", "0.3"),
                ("integration", "lum"),
                ("shading", "on"),
            ],
            &[("integration", "analytic"), ("macrocells", "off")],
            &[("precision", "single"), ("sk", "1")],
            &[("reconstruction", "cubic"), ("table", "printed")],
            &[("reconstruction", "quadratic"), ("bins", "16"), ("peaks", "1")],
        ] {
            let hits = same(&PEAKS_CPU_PAPER, which, &tf, k, 2);
            assert!(hits > 100 || k[0] == ("mode", "dvr_only"), "{k:?}: {hits}");
        }
    }
}
