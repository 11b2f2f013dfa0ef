//! Colours against the two references of isobar-oracle: I, the integral of the transfer function as given, and P, exact peak crossings with unscaled opacity and
//! the integral between.

use super::*;
use crate::{PEAKS_CPU, PEAKS_CPU_PAPER};
use isobar_core::{Function, Stage};
use isobar_oracle::{Colours, Difference, Reference};

fn function(data: &Arc<Data>, recon: &str) -> Arc<dyn Function> {
    let r = open(
        &PEAKS_CPU,
        data,
        &[],
        Some(&peaks(&[(0.0, RED, 0.5)], 0.1)),
        request(1, &[("reconstruction", recon)]),
    );
    r.reconstruction(Stage::Stored).unwrap()
}

fn reference(f: &Arc<dyn Function>, tf: &TransferFunction, which: Reference, view: &View) -> Colours {
    Colours::compute(f, &[], Some(tf), which, view, &Stop::default()).unwrap()
}

fn off(
    method: &dyn Method,
    data: &Arc<Data>,
    tf: &TransferFunction,
    want: &Colours,
    view: &View,
    k: &[(&str, &str)],
) -> Difference {
    want.difference(&draw(method, data, &[], Some(tf), view, (1, k))).unwrap()
}

fn waves(n: usize) -> Arc<Data> {
    grid([n; 3], |x, y, z| {
        ((x as f64) * 0.9).sin() + ((y as f64) * 0.7).cos() * ((z as f64) * 0.8).sin()
    })
}

/// A medium with a sharp peak and a soft one.
fn mixed() -> TransferFunction {
    let points = vec![
        (-1.2, BLUE, 0.0),
        (-0.8, GREEN, 0.15),
        (-0.3, BLUE, 0.02),
        (0.499, RED, 0.02),
        (0.5, RED, 0.4),
        (0.501, RED, 0.02),
        (1.2, [0.9, 0.9, 0.2], 0.1),
        (2.0, RED, 0.1),
    ];
    TransferFunction::new(points, 1.0).unwrap()
}

#[test]
fn exact_frames_are_the_references() {
    let (data, tf) = (waves(10), mixed());
    let view = View::fit(data.bounds(), 40.0, 24, 18);
    for recon in ["trilinear", "cubic"] {
        let f = function(&data, recon);
        for (mode, which, most) in [
            ("default", Reference::Peaks, 4e-3),
            ("peak_only", Reference::PeaksAlone, 1e-5),
            ("dvr_only", Reference::Integral, 4e-3),
        ] {
            let want = reference(&f, &tf, which, &view);
            assert!(want.greatest_error() < 1e-6);
            let run = |tolerance: &str| {
                let k = [("mode", mode), ("reconstruction", recon), ("tolerance", tolerance)];
                off(&PEAKS_CPU, &data, &tf, &want, &view, &k)
            };
            let d = run("0.0009765625");
            // 1.8e-3 at the pixel that grazes the sharp peak
            assert!(d.max < most, "{recon} {mode}: {d:?}");
            if mode != "peak_only" {
                let (coarse, fine) = (run("0.05"), run("0.00001"));
                // 3.9e-4 at that pixel, where chords are at their most
                assert!(fine.p99 < 1e-4 && fine.max < 1e-3, "{recon} {mode}: {fine:?}");
                assert!(
                    fine.mean < 0.2 * d.mean && d.mean < 0.5 * coarse.mean,
                    "{recon} {mode}: {coarse:?} {d:?} {fine:?}"
                );
            }
        }
    }
}

/// Post-classification and both pre-integrations come to I with shorter steps, the table to what its bins allow.
#[test]
fn comparators_converge_to_the_integral() {
    let data = waves(10);
    let tf = TransferFunction::new(vec![(-1.5, BLUE, 0.0), (0.0, GREEN, 0.3), (1.5, RED, 0.05)], 1.0).unwrap();
    let view = View::fit(data.bounds(), 40.0, 24, 18);
    let want = reference(&function(&data, "trilinear"), &tf, Reference::Integral, &view);
    for (scheme, last) in [("post", 6e-3), ("engel", 2e-3), ("lum", 2e-3), ("analytic", 1e-3)] {
        let at = |step: &str| {
            let k = [
                ("mode", "dvr_only"),
                ("sampling", "uniform"),
                ("step", step),
                ("integration", scheme),
            ];
            off(&PEAKS_CPU_PAPER, &data, &tf, &want, &view, &k)
        };
        let (coarse, fine) = (at("1"), at("0.05"));
        assert!(
            fine.mean < 0.3 * coarse.mean && fine.max < last,
            "{scheme}: {coarse:?} {fine:?}"
        );
    }
}

/// A peak of half-width 1e-3 of the range whose integrated opacity through the surface is the peak's: peak finding at s_k = 4 is nearer to I than
/// post-classification with 64 times the samples; and the bias |P - I| is no renderer's error.
#[test]
fn a_thin_peak_needs_no_short_steps() {
    // 8 per voxel along x, 0 to 255
    let data = grid([33, 17, 17], |x, _, _| 8.0 * x as f64 - 0.5);
    let half = 0.255;
    // depth through it: density * half-width / slope
    let opacity = 0.3;
    let steep = density(opacity) * (8.0 / half) as f32;
    let value = 101.3;
    let thin = TransferFunction::new(
        vec![(value - half, RED, 0.0), (value, RED, steep), (value + half, RED, 0.0)],
        1.0,
    )
    .unwrap();
    let peak = peaks(&[(value, RED, opacity)], half);
    let view = View::perspective(DVec3::new(-80.0, 8.0, 8.0), DVec3::new(16.0, 8.0, 8.0), DVec3::Z, 8.0, 32, 24);
    let want = reference(&function(&data, "trilinear"), &thin, Reference::Integral, &view);
    let found = off(
        &PEAKS_CPU_PAPER,
        &data,
        &peak,
        &want,
        &view,
        &[("mode", "peak_only"), ("table", "covering")],
    );
    let post = |sk: &str| {
        off(
            &PEAKS_CPU_PAPER,
            &data,
            &thin,
            &want,
            &view,
            &[("mode", "dvr_only"), ("sk", sk)],
        )
    };
    // steps of the printed law shrink with s_k, samples grow with 1 / s_k
    let many = post("0.0625");
    assert!(
        found.max < 5e-3 && found.max <= many.max && found.mean <= many.mean,
        "{found:?} {many:?}"
    );
    // the integral without a table needs no short steps either
    let analytic = off(&PEAKS_CPU, &data, &thin, &want, &view, &[("mode", "dvr_only")]);
    assert!(analytic.max < 1e-5, "{analytic:?}");
    let both = reference(&function(&data, "trilinear"), &thin, Reference::Peaks, &view);
    let bias = both.bias(&want).unwrap();
    assert!(bias.max > 0.1, "{bias:?}");
}
