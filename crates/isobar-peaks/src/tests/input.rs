//! Bad input, and what a change costs.

use super::*;
use crate::{PEAKS_CPU, PEAKS_CPU_PAPER};
use isobar_core::{Camera, RenderError, Scene};

fn small() -> Arc<Data> {
    grid([6, 5, 4], |x, y, z| (x + 2 * y + 3 * z) as f64)
}

#[test]
fn unusable_transfer_functions_are_refused_in_one_line() {
    let c = [0.5; 3];
    let good = peaks(&[(5.0, RED, 0.5)], 0.1);
    for points in [
        vec![],
        vec![(1.0, c, 1.0), (0.0, c, 1.0)],
        vec![(0.0, c, 1.0), (0.0, c, 2.0)],
        vec![(f64::NAN, c, 1.0)],
        vec![(0.0, c, f32::NAN)],
        vec![(0.0, c, -1.0)],
        vec![(0.0, [0.0, f32::NAN, 0.0], 1.0)],
    ] {
        let bad = TransferFunction { points, unit: 1.0 };
        let mut r = open(&PEAKS_CPU, &small(), &[], Some(&good), request(1, &[]));
        let e = r.set_medium(Some(&bad)).unwrap_err().to_string();
        assert!(!e.contains('\n') && e.len() > 20, "{e}");
        // the former one stays
        let f = image(r.as_mut(), &View::fit(small().bounds(), 40.0, 16, 12));
        assert!(f.t.iter().any(|t| t.is_finite()));
    }
}

#[test]
fn a_transfer_function_outside_the_data_gives_an_empty_image() {
    let data = small();
    let view = View::fit(data.bounds(), 40.0, 16, 12);
    let tf = peaks(&[(1e6, RED, 0.5)], 0.1);
    for method in [&PEAKS_CPU, &PEAKS_CPU_PAPER] {
        let f = draw(method, &data, &[], Some(&tf), &view, (1, &[]));
        assert!(f.rgba.iter().all(|c| *c == [0.0; 4]) && f.t.iter().all(|t| t.is_infinite()));
    }
}

/// Data that stay at the peak's value: one hit, where the plateau is entered.
#[test]
fn a_plateau_at_a_peak_is_one_hit() {
    let data = grid([8, 3, 3], |x, _, _| [0.0, 1.0, 2.0, 2.0, 2.0, 2.0, 3.0, 4.0][x]);
    let tf = peaks(&[(2.0, RED, 0.5)], 0.01);
    let f = exact(&data, &tf, &ray([-1.0, 1.3, 0.8], [1.0, 0.0, 0.0]), "peak_only");
    near(&hits(&f), &[(3.0, 0)], 1e-6);
    assert!((f.rgba[0][3] - 0.5).abs() < 1e-6);
    // all of the data
    let flat = grid([4; 3], |_, _, _| 2.0);
    let f = exact(&flat, &tf, &ray([-1.0, 1.3, 0.8], [1.0, 0.0, 0.0]), "peak_only");
    near(&hits(&f), &[(1.0, 0)], 1e-6);
    // a plateau of the transfer function is one peak in its middle
    let points = vec![(0.5, RED, 0.0), (1.2, RED, 0.7), (1.8, RED, 0.7), (2.5, RED, 0.0)];
    let tf = TransferFunction::new(points, 1.0).unwrap();
    let f = exact(&data, &tf, &ray([-1.0, 1.3, 0.8], [1.0, 0.0, 0.0]), "peak_only");
    near(&hits(&f), &[(2.5, 0)], 1e-6);
}

#[test]
fn peaks_within_a_bin_are_reported() {
    let data = grid([2, 2, 2], |x, _, _| x as f64);
    let tf = peaks(&[(0.5, RED, 0.5), (0.501, BLUE, 0.5)], 1e-4);
    let view = ray([-1.0, 0.5, 0.5], [1.0, 0.0, 0.0]);
    let mut r = open(&PEAKS_CPU_PAPER, &data, &[], Some(&tf), request(4, &[("mode", "peak_only")]));
    image(r.as_mut(), &view);
    let shared = r.counters().0.iter().find(|c| c.0.starts_with("peaks in one bin")).unwrap().1;
    assert_eq!(shared, 1);
    near(&hits(&exact(&data, &tf, &view, "peak_only")), &[(1.5, 0), (1.501, 1)], 1e-9);
}

#[test]
fn steps_without_end_are_refused_with_their_count() {
    let data = small();
    let tf = peaks(&[(5.0, RED, 0.5)], 0.1);
    for k in [("sk", "1e-15"), ("step", "1e-9")] {
        let sampling = if k.0 == "step" { "uniform" } else { "differential" };
        let mut r = open(
            &PEAKS_CPU_PAPER,
            &data,
            &[],
            Some(&tf),
            request(1, &[k, ("sampling", sampling)]),
        );
        r.set_view(&View::fit(data.bounds(), 40.0, 16, 12)).unwrap();
        let e = r.render(&Stop::default()).unwrap_err();
        assert!(matches!(&e, RenderError::Knob { name, .. } if name == k.0), "{e}");
        assert!(e.to_string().contains(" samples, more than 16777216"), "{e}");
    }
}

#[test]
fn what_cannot_be_drawn_is_said() {
    let data = small();
    let mut view = View::fit(data.bounds(), 40.0, 16, 12);
    let scene = |view: &View| {
        let s = Scene {
            data: &data,
            surfaces: &[],
            medium: None,
            view,
        };
        PEAKS_CPU.supports(&s, &Request::default()).map_err(|e| e.to_string())
    };
    assert_eq!(scene(&view), Ok(()));
    view.clips.push(isobar_core::ClipPlane {
        normal: DVec3::X,
        distance: 1.0,
        cap: true,
    });
    assert!(scene(&view).unwrap_err().contains("closed cuts"));
    view.clips[0].cap = false;
    assert_eq!(scene(&view), Ok(()));
    let mut r = PEAKS_CPU.open(&Request::default()).unwrap();
    assert_eq!(r.render(&Stop::default()).unwrap_err(), RenderError::NotReady("set_data"));
    r.set_data(&data).unwrap();
    assert_eq!(r.render(&Stop::default()).unwrap_err(), RenderError::NotReady("set_surfaces"));
    for (name, value) in [("mode", "both"), ("tolerance", "0"), ("reconstruction", "bc12"), ("sk", "4")] {
        assert!(r.set_knobs(&knobs(&[(name, value)])).is_err(), "{name}={value}");
    }
    let thin = grid([4, 1, 4], |_, _, _| 0.0);
    assert!(r.set_data(&thin).is_err());
}

/// Settings whose coefficients overflow are refused, and those before stay, with the data.
#[test]
fn refused_settings_leave_the_former_ones() {
    let data = grid([9; 3], |x, y, z| if (x + y + z) % 2 == 0 { 3e38 } else { 0.0 });
    let view = View::fit(data.bounds(), 40.0, 16, 12);
    let one = [Surface::isovalue(1e38, 0)];
    for method in [&PEAKS_CPU, &PEAKS_CPU_PAPER] {
        let mut r = open(method, &data, &one, None, request(1, &[]));
        let want = image(r.as_mut(), &view);
        let e = r.set_knobs(&knobs(&[("reconstruction", "cubic-interpolating")])).unwrap_err();
        assert!(!e.to_string().contains('\n'), "{e}");
        assert_eq!(image(r.as_mut(), &view), want);
        assert!(want.t.iter().any(|t| t.is_finite()));
    }
}

/// Setters in any order and over and over give the frame of a new renderer; one thread gives the frame of two.
#[test]
fn changes_give_the_frame_of_a_new_renderer() {
    let data = grid([20, 18, 16], |x, y, z| ((x * y) as f64 * 0.11).sin() + (z as f64 * 0.4).cos());
    let one = peaks(&[(0.2, RED, 0.4), (0.9, BLUE, 0.3)], 0.05);
    let two = TransferFunction::new(vec![(-1.0, GREEN, 0.01), (0.5, RED, 0.2), (1.0, BLUE, 0.0)], 1.0).unwrap();
    let view = View::fit(data.bounds(), 40.0, 40, 30);
    for method in [&PEAKS_CPU, &PEAKS_CPU_PAPER] {
        let want = draw(method, &data, &[], Some(&two), &view, (2, &[("reconstruction", "cubic")]));
        let mut r = method
            .open(&Request {
                threads: 2,
                ..request(2, &[])
            })
            .unwrap();
        r.set_medium(Some(&one)).unwrap();
        r.set_view(&view).unwrap();
        r.set_data(&data).unwrap();
        r.render(&Stop::default()).unwrap();
        r.set_surfaces(&[]).unwrap();
        r.set_medium(Some(&two)).unwrap();
        r.set_knobs(&knobs(&[("reconstruction", "cubic")])).unwrap();
        let got = image(r.as_mut(), &view);
        assert_eq!(got, want);
        assert_eq!(image(r.as_mut(), &view), want, "again");
        assert!(want.rgba.iter().any(|c| c[3] > 0.1));
    }
}

/// An orthographic view has parallel rays, no ray differentials, and equal steps.
#[test]
fn parallel_rays_are_sampled_evenly() {
    let data = grid([20, 9, 9], |x, _, _| x as f64);
    let tf = peaks(&[(7.3, RED, 0.5)], 0.1);
    let view = View {
        camera: Camera::Orthographic {
            eye: DVec3::new(-3.0, 4.0, 4.0),
            target: DVec3::new(3.0, 4.0, 4.0),
            up: DVec3::Z,
            height: 4.0,
        },
        width: 8,
        height: 8,
        clips: vec![],
    };
    for law in crate::sampling::Law::NAMES {
        let f = draw(
            &PEAKS_CPU_PAPER,
            &data,
            &[],
            Some(&tf),
            &view,
            (1, &[("sampling", law), ("table", "covering")]),
        );
        assert!(f.t.iter().all(|t| (t - 10.3).abs() < 1e-6), "{law}: {:?}", &f.t[..4]);
    }
}
