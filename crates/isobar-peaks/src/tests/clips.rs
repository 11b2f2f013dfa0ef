//! Open cuts, of both methods, against the oracle's clipped truth and its clipped integrals.

use super::*;
use crate::{PEAKS_CPU, PEAKS_CPU_PAPER};
use isobar_core::{ClipPlane, Stage};
use isobar_fields::Synthetic;
use isobar_oracle::{Colours, Reference, Truth, check};

fn plane(normal: DVec3, distance: f64) -> ClipPlane {
    ClipPlane {
        normal,
        distance,
        cap: false,
    }
}

/// Three planes, one of which all but contains the rays of the middle of the image.
fn cut(mut view: View) -> View {
    let middle = view.ray(view.width / 2, view.height / 2);
    let across = middle.direction.cross(DVec3::Z);
    view.clips = vec![
        plane(DVec3::new(1.0, 0.2, 0.1), 0.3),
        plane(DVec3::new(0.0, 0.0, -2.0), 1.0 / 3.0),
        plane(across, across.dot(middle.origin) + 0.2),
    ];
    view
}

#[test]
fn open_cuts_are_those_of_the_oracle() {
    let data: Arc<Data> = Arc::new("gyroid,n=24".parse::<Synthetic>().unwrap().data().unwrap());
    let surfaces = [Surface::isovalue(0.2, 0), Surface::isovalue(-0.6, 1)];
    let view = cut(View::bench(80, 60));
    for recon in ["trilinear", "quadratic", "cubic"] {
        let k = [("mode", "peak_only"), ("reconstruction", recon)];
        let mut r = open(&PEAKS_CPU, &data, &surfaces, None, request(1, &k));
        let frame = image(r.as_mut(), &view);
        let f = r.reconstruction(Stage::Stored).unwrap();
        let truth = Truth::compute(&f, &surfaces, &view, &Stop::default()).unwrap();
        let whole = Truth::compute(&f, &surfaces, &View::bench(80, 60), &Stop::default()).unwrap();
        assert!(
            truth.hits() > 500 && truth.hits() + 200 < whole.hits(),
            "{recon}: {}",
            truth.hits()
        );
        let c = check(&frame, &truth, &f, &surfaces, &view).unwrap();
        let wrong = (c.missed, c.false_hits, c.wrong_root, c.wrong_surface, c.refuted, c.unclaimed);
        assert_eq!(wrong, (0, 0, 0, 0, 0, 0), "{recon}");
    }
}

/// The medium begins and ends at the cut, for the exact ray and for short steps.
#[test]
fn the_medium_ends_at_the_cut() {
    let data: Arc<Data> = Arc::new("gyroid,n=16".parse::<Synthetic>().unwrap().data().unwrap());
    let points = vec![
        (-1.5, BLUE, 0.0),
        (-0.5, GREEN, 0.3),
        (0.25, RED, 0.05),
        (0.3, RED, 0.9),
        (0.35, RED, 0.05),
        (1.5, BLUE, 0.1),
    ];
    let tf = TransferFunction::new(points, 0.2).unwrap();
    let view = cut(View::bench(32, 24));
    let exact = open(&PEAKS_CPU, &data, &[], Some(&tf), request(1, &[]));
    let f = exact.reconstruction(Stage::Stored).unwrap();
    for (mode, which) in [("default", Reference::Peaks), ("dvr_only", Reference::Integral)] {
        let want = Colours::compute(&f, &[], Some(&tf), which, &view, &Stop::default()).unwrap();
        let off = |method: &dyn Method, k: &[(&str, &str)]| {
            want.difference(&draw(method, &data, &[], Some(&tf), &view, (1, k))).unwrap()
        };
        let d = off(&PEAKS_CPU, &[("mode", mode), ("tolerance", "0.00001")]);
        assert!(d.max < 1e-3 && d.p99 < 1e-4, "{mode}: {d:?}");
        let d = off(
            &PEAKS_CPU_PAPER,
            &[
                ("mode", mode),
                ("sampling", "uniform"),
                ("step", "0.01"),
                ("integration", "analytic"),
            ],
        );
        assert!(d.p99 < 5e-3, "{mode}: {d:?}");
        let k = [("mode", mode), ("tolerance", "0.00001"), ("macrocells", "off")];
        assert_eq!(off(&PEAKS_CPU, &k), off(&PEAKS_CPU, &k[..2]), "{mode}");
    }
}

/// Along one ray through a ramp, to the digit: both ends cut, samples on the cuts.
#[test]
fn a_ramp_is_cut_at_both_ends() {
    let data = grid([9, 5, 5], |x, _, _| x as f64 / 8.0);
    let tf = TransferFunction::new(vec![(0.0, RED, 0.0), (1.0, RED, 2.0)], 4.0).unwrap();
    let mut view = ray([-1.0, 2.0, 2.0], [1.0, 0.0, 0.0]);
    view.clips = vec![plane(DVec3::X, 6.25), plane(-DVec3::X, -2.5)];
    // integral of 2 x / 8 / 4 from 2.5 to 6.25
    let depth = (6.25f64 * 6.25 - 2.5 * 2.5) / 32.0;
    let want = (1.0 - (-depth).exp()) as f32;
    let got = exact(&data, &tf, &view, "default").rgba[0][3];
    assert!((got - want).abs() < 1e-6, "{got} {want}");
    let k = [("sampling", "uniform"), ("step", "0.3"), ("integration", "analytic")];
    let got = draw(&PEAKS_CPU_PAPER, &data, &[], Some(&tf), &view, (1, &k)).rgba[0][3];
    assert!((got - want).abs() < 1e-6, "{got} {want}");
    // crossings on this side of the cut are hits, on the other none
    for (x, there) in [(2.0, false), (2.625, true), (6.125, true), (6.5, false)] {
        let surfaces = [Surface::isovalue(x / 8.0, 0)];
        for method in [&PEAKS_CPU, &PEAKS_CPU_PAPER] {
            let f = draw(method, &data, &surfaces, None, &view, (2, &[]));
            near(&hits(&f), if there { &[(0.0, 0)] } else { &[] }, f64::INFINITY);
            assert!(!there || (f.t[0] - x - 1.0).abs() < 1e-6, "{x}: {:?}", f.t);
        }
    }
}

/// The length of such a direction is infinite in f64; the planes cut it all the same.
#[test]
fn huge_directions_are_cut() {
    let data = grid([9, 5, 5], |x, _, _| x as f64 / 8.0);
    let mut view = ray([-1.0, 2.0, 2.0], [1e200, 0.0, 0.0]);
    view.clips = vec![plane(DVec3::X, 6.25), plane(-DVec3::X, -2.5)];
    for (x, there) in [(6.5, false), (2.0, false), (4.0, true)] {
        let f = draw(&PEAKS_CPU, &data, &[Surface::isovalue(x / 8.0, 0)], None, &view, (2, &[]));
        assert_eq!(hits(&f).len(), usize::from(there), "{x}: {:?}", f.t);
    }
}
