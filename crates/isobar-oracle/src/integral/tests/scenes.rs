//! Surfaces and peaks with a medium (hardcases E9, E10, E11), frames, and what is refused.

use super::*;
use isobar_core::{Channels, Frame};
use isobar_fields::analytic;

/// hardcases E9: three equal peaks of opacity 1/2 are .875, whatever the step; P is the surfaces alone here, since the medium is a peak of no width.
#[test]
fn equal_peaks_compose() {
    // s goes up and down and up along x
    let g = grid(4, |x| [0.0, 1.0, 0.0, 1.0][x.x as usize]);
    let m = tf(&[(0.0, RED, 0.0), (0.5, RED, std::f32::consts::LN_2), (1.0, RED, 0.0)], 1e9);
    for f in [tets(&g), spline(&g, Kind::Trilinear)] {
        let i = Integral::new(&f, &[], Some(&m), Reference::Peaks, Model::VolumeDensity, &[]).unwrap();
        assert_eq!(i.surfaces().len(), 1);
        let c = i.colour(&ray([-1.0, 1.5, 1.25], [1.0, 0.0, 0.0]));
        // LN_2 as f32
        assert!(
            (c.rgba[3] - 0.875).abs() < 1e-7 && (c.rgba[0] - 0.875).abs() < 1e-7 && c.rgba[1] == 0.0,
            "{c:?}"
        );
    }
}

/// hardcases E10: order by the direction of the value. With peak_only, five peaks in one cell all count.
#[test]
fn peaks_are_composed_in_order() {
    let half = std::f32::consts::LN_2;
    let m = tf(
        &[
            (0.0, RED, 0.0),
            (0.3, RED, half),
            (0.45, RED, 0.0),
            (0.6, BLUE, half),
            (1.0, BLUE, 0.0),
        ],
        1e9,
    );
    let g = grid(2, |x| x.x);
    for f in [tets(&g), spline(&g, Kind::Trilinear)] {
        let i = Integral::new(&f, &[], Some(&m), Reference::PeaksAlone, Model::VolumeDensity, &[]).unwrap();
        let up = i.colour(&ray([-1.0, 0.5, 0.25], [1.0, 0.0, 0.0])).rgba;
        let down = i.colour(&ray([2.0, 0.5, 0.25], [-1.0, 0.0, 0.0])).rgba;
        for (c, want) in [(up, [0.5, 0.0, 0.25, 0.75]), (down, [0.25, 0.0, 0.5, 0.75])] {
            assert!(c.iter().zip(want).all(|(x, y)| (x - y).abs() < 1e-7), "{c:?}");
        }
        let five: Vec<(f64, [f32; 3], f32)> = (0..11)
            .map(|k| (k as f64 / 10.0, WHITE, if k % 2 == 1 { half } else { 0.0 }))
            .collect();
        let i = Integral::new(
            &f,
            &[],
            Some(&tf(&five, 1.0)),
            Reference::PeaksAlone,
            Model::VolumeDensity,
            &[],
        )
        .unwrap();
        let c = i.colour(&ray([-1.0, 0.5, 0.25], [1.0, 0.0, 0.0])).rgba;
        assert!((c[3] - (1.0 - 1.0 / 32.0)).abs() < 1e-6, "{c:?}");
    }
}

/// hardcases E11: .49 + .04 s (1 - s) along the diagonal of a face, peak .4975: two crossings, s = 1/4 and 3/4, inside one cell.
#[test]
fn hidden_pairs_are_found() {
    let g = grid(2, |x| 0.49 + 0.04 * x.x * (1.0 - x.y));
    let f = spline(&g, Kind::Trilinear);
    let m = tf(
        &[(0.4, RED, 0.0), (0.4975, RED, std::f32::consts::LN_2), (0.6, RED, 0.0)],
        1e9,
    );
    let i = Integral::new(&f, &[], Some(&m), Reference::Peaks, Model::VolumeDensity, &[]).unwrap();
    let r = ray([0.0, 0.0, 0.5], [1.0, 1.0, 0.0]);
    let roots = i.oracle.all(&r).roots;
    let t: Vec<f64> = roots.iter().map(|r| r.t()).collect();
    assert!(
        t.len() == 2 && (t[0] - 0.25).abs() < 1e-4 && (t[1] - 0.75).abs() < 1e-4,
        "{t:?}"
    );
    let c = i.colour(&r);
    assert!((c.rgba[3] - 0.75).abs() < 1e-7 && c.error < 1e-12, "{c:?}");
    // and the medium about a narrow peak above the sampled values is found in that cell too
    let thin = tf(&[(0.4974, RED, 0.0), (0.4975, RED, 100.0), (0.4976, RED, 0.0)], 1.0);
    let c = integral(&f, &thin).colour(&r);
    let d = dense(&f, &thin, &r, (0.0, 1.0), 400_000);
    assert!(
        (c.rgba[3] - d[3]).abs() < 1e-5 && c.rgba[3] > 0.1 && c.error < 1e-9,
        "{c:?} {d:?}"
    );
}

/// An opaque surface hides what is behind, a surface of opacity 0 nothing; the medium before it counts.
#[test]
fn surfaces_and_medium_are_composed() {
    let g = grid(6, |x| x.x);
    let m = tf(&[(0.0, BLUE, 1.0)], 2.0);
    for f in [tets(&g), spline(&g, Kind::Trilinear)] {
        let scene = [surface(1.5, WHITE, 0.0), surface(2.0, RED, 0.25), surface(4.0, WHITE, 1.0)];
        let i = Integral::new(&f, &scene, Some(&m), Reference::Integral, Model::VolumeDensity, &[]).unwrap();
        let c = i.colour(&ray([-1.0, 1.5, 1.25], [1.0, 0.0, 0.0]));
        let e = (-1.0f64).exp();
        let before = 1.0 - e;
        let after = 0.75 * e * (1.0 - e);
        let red = 0.25 * e;
        let white = 0.75 * e * e;
        near(&c, [red + white, white, before + after + white, 1.0], 1e-10);
        // beyond the opaque surface the medium does not matter
        let other = tf(&[(0.0, BLUE, 1.0), (4.0, BLUE, 1.0), (4.5, RED, 9.0)], 2.0);
        let i = Integral::new(&f, &scene, Some(&other), Reference::Integral, Model::VolumeDensity, &[]).unwrap();
        near(&i.colour(&ray([-1.0, 1.5, 1.25], [1.0, 0.0, 0.0])), c.rgba, 1e-10);
    }
}

/// Opacity zero everywhere, values outside the transfer function's points, a constant field on a knot.
#[test]
fn plain_scenes() {
    let g = grid(4, |_| 0.5);
    let r = ray([-1.0, 1.5, 1.25], [1.0, 0.0, 0.0]);
    for (name, f) in all_kinds(&g) {
        let of = |m: &TransferFunction, reference| {
            let i = Integral::new(&f, &[], Some(m), reference, Model::VolumeDensity, &[]).unwrap();
            i.colour(&r)
        };
        let nothing = tf(&[(0.0, RED, 0.0), (0.5, WHITE, 0.0), (1.0, BLUE, 0.0)], 1.0);
        let beyond = tf(&[(2.0, RED, 0.5), (3.0, WHITE, 1.0)], 1.0);
        let knot = tf(&[(0.0, RED, 0.0), (0.5, WHITE, 0.25), (1.0, BLUE, 0.0)], 1.0);
        for reference in [Reference::Integral, Reference::Peaks] {
            assert_eq!(of(&nothing, reference).rgba, [0.0; 4], "{name}");
            let a = 1.0 - (-1.5f64).exp();
            near(&of(&beyond, reference), [a, 0.0, 0.0, a], 1e-11);
        }
        let a = 1.0 - (-0.75f64).exp();
        near(&of(&knot, Reference::Integral), [a; 4], 1e-11);
        // the stretch at the peak's value is one crossing, at its entry; no gradient: the ambient part of the shading only
        let c = of(&knot, Reference::Peaks).rgba;
        let front = 1.0 - (-0.25f64).exp();
        let want = [front * 0.15 + (1.0 - front) * a, front + (1.0 - front) * a];
        assert!(
            (c[0] - want[0]).abs() < 1e-7 && (c[3] - want[1]).abs() < 1e-7,
            "{name}: {c:?} {want:?}"
        );
    }
}

#[test]
fn what_cannot_be_done_is_refused() {
    let g = grid(3, |x| x.x);
    let f = spline(&g, Kind::Trilinear);
    let of = |f: &Arc<dyn Function>, m: &TransferFunction, clips: &[ClipPlane]| {
        Integral::new(f, &[], Some(m), Reference::Integral, Model::VolumeDensity, clips).map(|_| ())
    };
    let m = tf(&[(0.0, RED, 1.0)], 1.0);
    let empty = TransferFunction {
        points: vec![],
        unit: 1.0,
    };
    assert!(matches!(of(&f, &empty, &[]), Err(TruthError::Medium(_))));
    let gyroid = analytic("gyroid", &std::collections::BTreeMap::new()).unwrap().function;
    assert!(matches!(of(&gyroid, &m, &[]), Err(TruthError::Unsupported(_))));
    let cap = ClipPlane {
        normal: DVec3::X,
        distance: 1.0,
        cap: true,
    };
    assert!(matches!(of(&f, &m, &[cap]), Err(TruthError::Unsupported(_))));
    // surfaces alone in a field without pieces are no trouble
    assert!(
        Integral::new(
            &gyroid,
            &[surface(0.2, RED, 0.5)],
            None,
            Reference::Integral,
            Model::VolumeDensity,
            &[]
        )
        .is_ok()
    );
    let c = integral(&f, &m).colour(&ray([f64::NAN, 0.0, 0.0], [1.0, 0.0, 0.0]));
    assert_eq!((c.rgba, c.error), ([0.0; 4], f64::INFINITY));
    let stop = Stop::default();
    stop.raise();
    let view = View::bench(8, 8);
    assert_eq!(
        Colours::compute(&f, &[], Some(&m), Reference::Integral, &view, &stop),
        Err(TruthError::Stopped)
    );
}

/// Frames are held against colours; the bias of a wide peak is what it is in closed form.
#[test]
fn frames_are_compared_and_the_bias_is_measured() {
    let g = grid(6, |x| x.x);
    let f = spline(&g, Kind::Trilinear);
    let m = tf(&[(1.0, RED, 0.0), (2.0, RED, 0.5), (3.0, RED, 0.0)], 1.0);
    let rays: Vec<Ray> = (0..256)
        .map(|k| ray([-1.0, 1.5 + 0.001 * f64::from(k), 1.25], [1.0, 0.0, 0.0]))
        .collect();
    let view = View::rays(rays);
    let of = |r| Colours::compute(&f, &[], Some(&m), r, &view, &Stop::default()).unwrap();
    let (i, p) = (of(Reference::Integral), of(Reference::Peaks));
    let bias = p.bias(&i).unwrap();
    // half before the peak, the peak, half after: 1 - exp(-1/2 - 1/2) against 1 - exp(-1/2)
    let want = (-0.5f64).exp() - (-1.0f64).exp();
    assert!(
        (bias.max - want).abs() < 1e-6 && (bias.p99 - want).abs() < 1e-6,
        "{bias:?} {want}"
    );
    let mut frame = Frame::new(256, 1, 1, Channels::RGBA);
    frame.rgba = i.rounded();
    assert_eq!(i.difference(&frame).unwrap().max, 0.0);
    frame.rgba.clear();
    assert!(matches!(i.difference(&frame), Err(TruthError::Channel("rgba"))));
    assert!(i.difference(&Frame::new(2, 1, 1, Channels::RGBA)).is_err());
}
