//! hardcases E2, E3, E9 to E12.

use super::*;
use crate::{PEAKS_CPU, PEAKS_CPU_PAPER};
use isobar_core::{Camera, Stage};
use isobar_oracle::{Oracle, Truth, check};

/// A field that goes up and down n times between 0 and 1.
fn zigzag(n: usize) -> Arc<Data> {
    grid([n + 1, 2, 2], |x, _, _| (x % 2) as f64)
}

/// E9: N equal semi-transparent hits add up to 1 - (1 - a)^N, whatever the step.
#[test]
fn equal_hits_add_up() {
    let data = zigzag(3);
    let tf = peaks(&[(0.5, RED, 0.5)], 1e-3);
    let view = ray([-1.0, 0.5, 0.5], [1.0, 0.0, 0.0]);
    let f = exact(&data, &tf, &view, "peak_only");
    assert!(
        (f.rgba[0][3] - 0.875).abs() < 1e-6 && (f.rgba[0][0] - 0.875).abs() < 1e-6,
        "{:?}",
        f.rgba[0]
    );
    near(&hits(&f), &[(1.5, 0), (2.5, 0), (3.5, 0)], 1e-9);
    for step in ["0.9", "0.5", "0.1", "0.013"] {
        let f = draw(
            &PEAKS_CPU_PAPER,
            &data,
            &[],
            Some(&tf),
            &view,
            (8, &[("mode", "peak_only"), ("sampling", "uniform"), ("step", step)]),
        );
        assert!((f.rgba[0][3] - 0.875).abs() < 1e-6, "step {step}: {:?}", f.rgba[0]);
    }
}

/// E10: two peaks in the order met, four in one segment, and the fifth.
#[test]
fn peaks_are_composited_in_the_order_met() {
    let rising = grid([2, 2, 2], |x, _, _| x as f64);
    let tf = peaks(&[(0.3, RED, 0.5), (0.6, BLUE, 0.5)], 1e-3);
    let up = ray([-1.0, 0.5, 0.5], [1.0, 0.0, 0.0]);
    let down = ray([2.0, 0.5, 0.5], [-1.0, 0.0, 0.0]);
    let paper = [("mode", "peak_only"), ("sampling", "uniform"), ("step", "5")];
    for (view, want) in [(&up, [0.5, 0.0, 0.25, 0.75]), (&down, [0.25, 0.0, 0.5, 0.75])] {
        for f in [
            exact(&rising, &tf, view, "peak_only"),
            draw(&PEAKS_CPU_PAPER, &rising, &[], Some(&tf), view, (8, &paper)),
        ] {
            assert!(
                f.rgba[0].iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-6),
                "{:?}",
                f.rgba[0]
            );
        }
    }
    let five: Vec<_> = [0.15, 0.3, 0.5, 0.7, 0.9].map(|v| (v, GREEN, 0.2)).to_vec();
    let tf = peaks(&five, 1e-3);
    near(
        &hits(&exact(&rising, &tf, &up, "peak_only")),
        &[(1.15, 0), (1.3, 1), (1.5, 2), (1.7, 3), (1.9, 4)],
        1e-6,
    );
    let f = draw(&PEAKS_CPU_PAPER, &rising, &[], Some(&tf), &up, (8, &paper));
    near(&hits(&f), &[(1.15, 0), (1.3, 1), (1.5, 2), (1.7, 3)], 1e-6);
    let mut r = open(&PEAKS_CPU_PAPER, &rising, &[], Some(&tf), request(8, &paper));
    image(r.as_mut(), &down);
    let dropped = r
        .counters()
        .0
        .iter()
        .find(|c| c.0 == "table entries with dropped peaks")
        .unwrap()
        .1;
    assert!(dropped > 0);
}

/// E11: a pair of crossings between two samples; the gate sees none of them, the exact ray both.
#[test]
fn a_hidden_pair_is_found_exactly_and_missed_by_the_gate() {
    // .49 + .04 x (1 - y) is .49 + .04 s (1 - s) on the diagonal
    let data = grid([2, 2, 2], |x, y, _| 0.49 + 0.04 * (x * (1 - y)) as f64);
    let tf = peaks(&[(0.4975, RED, 0.5)], 1e-4);
    let view = ray([0.0, 0.0, 0.5], [1.0, 1.0, 0.0]);
    let f = exact(&data, &tf, &view, "peak_only");
    near(&hits(&f), &[(0.25, 0), (0.75, 0)], 1e-5);
    assert_eq!(f.hits[0], 2);
    let paper = [
        ("mode", "peak_only"),
        ("sampling", "uniform"),
        ("step", "3"),
        ("table", "covering"),
    ];
    let f = draw(&PEAKS_CPU_PAPER, &data, &[], Some(&tf), &view, (8, &paper));
    assert_eq!((f.hits[0], f.rgba[0][3]), (0, 0.0));
}

/// E12: every segment of the ray is sampled once, whichever macrocells are skipped; printed increments leave their places.
#[test]
fn macrocells_neither_repeat_nor_skip_segments() {
    // two slabs with extinction, far apart, and nothing between
    let data = grid([61, 9, 9], |x, _, _| {
        if (10..15).contains(&x) || (40..47).contains(&x) {
            1.0
        } else {
            0.0
        }
    });
    let tf = TransferFunction::new(vec![(0.2, RED, 0.0), (1.0, BLUE, 0.05)], 1.0).unwrap();
    let view = View::perspective(DVec3::new(-30.0, 4.3, 4.1), DVec3::new(30.0, 4.0, 4.0), DVec3::Z, 6.0, 24, 24);
    let run = |macrocells: &str, sampling: &str| {
        let k = [
            ("mode", "dvr_only"),
            ("macrocells", macrocells),
            ("sampling", sampling),
            ("sk", "3"),
        ];
        let mut r = open(&PEAKS_CPU_PAPER, &data, &[], Some(&tf), request(1, &k));
        let f = image(r.as_mut(), &view);
        let c = r.counters();
        let count = |n: &str| c.0.iter().find(|c| c.0 == n).unwrap().1;
        (f, count("samples"), count("segments out of place"))
    };
    for sampling in ["differential", "geometric", "uniform"] {
        let ((a, all, _), (b, some, gaps)) = (run("off", sampling), run("on", sampling));
        assert!(
            a.rgba.iter().zip(&b.rgba).all(|(p, q)| (p[3] - q[3]).abs() < 1e-6),
            "{sampling}"
        );
        assert!(some < all * 3 / 4 && gaps == 0, "{sampling}: {some} of {all}, {gaps}");
        assert!(a.rgba[300][3] > 0.3, "{:?}", a.rgba[300]);
    }
    let (_, _, gaps) = run("on", "printed");
    assert!(gaps > 0);
}

/// E2: an eye 1e-3 voxel from the wall, one voxel over 2000 pixels, coordinates up to 512.
#[test]
fn endoscopy_is_smooth() {
    let data = grid([512, 8, 8], |x, y, z| {
        ((x as f64) * 0.37).sin() + 0.2 * ((y as f64) * 1.3).cos() + 0.1 * ((z as f64) * 0.9).sin()
    });
    let r = open(&PEAKS_CPU, &data, &[], None, request(1, &[("reconstruction", "cubic")]));
    let f = r.reconstruction(Stage::Stored).unwrap();
    let at = DVec3::new(471.3, 3.4, 3.6);
    let c = f.value(at);
    let g = f.gradient(at).normalize();
    // 1e-3 voxel before the surface, looking at it at a flat angle; a pixel is 1/2000 voxel at a voxel's distance
    let side = g.cross(DVec3::Z).normalize();
    let eye = at - g * 1e-3;
    let fov = 2.0 * (32.0f64 / 2000.0).atan().to_degrees();
    let view = View::perspective(eye, eye + g + 0.2 * side, DVec3::Z, fov, 64, 64);
    let surfaces = [Surface::isovalue(c, 0)];
    let frame = draw(&PEAKS_CPU, &data, &surfaces, None, &view, (1, &[("reconstruction", "cubic")]));
    let oracle = Oracle::new(f.clone(), c);
    let mut last: Option<f64> = None;
    for x in 0..64 {
        let i = 32 * 64 + x;
        let truth = oracle.first(&view.ray(x, 32));
        let root = truth.hit().expect("the wall is before the eye");
        let t = root.t();
        assert!((frame.t[i] - t).abs() < 1e-4, "pixel {x}: {} {t}", frame.t[i]);
        // one direction of change along the row: no staircase
        let n = DVec3::from_array(frame.normal[i].map(f64::from));
        let turn = n.dot(side);
        if let (Some(l), true) = (last, x > 1) {
            let n0 = DVec3::from_array(frame.normal[i - 1].map(f64::from));
            assert!((n0 - n).length() < 1e-3, "{l} {turn}");
        }
        last = Some(turn);
    }
    let normals: Vec<f64> = (0..64)
        .map(|x| DVec3::from_array(frame.normal[32 * 64 + x].map(f64::from)).dot(side))
        .collect();
    let (up, down) = normals
        .windows(2)
        .fold((0.0f64, 0.0f64), |(u, d), w| (u.max(w[1] - w[0]), d.max(w[0] - w[1])));
    assert!(up.min(down) <= 2e-7, "normals go both ways: {up} {down}");
}

/// E3: 10^6 times into the silhouette of a sphere.
#[test]
fn the_silhouette_is_right_at_any_zoom() {
    let n = 33;
    let data = grid([n; 3], |x, y, z| {
        let p = [x, y, z].map(|i| 2.5 * i as f64 / 32.0 - 1.25);
        p[0] * p[0] + p[1] * p[1] + p[2] * p[2]
    });
    let surfaces = [Surface::isovalue(1.0, 0)];
    let scale = 32.0 / 2.5;
    for recon in ["trilinear", "quadratic", "cubic"] {
        let r = open(&PEAKS_CPU, &data, &surfaces, None, request(1, &[("reconstruction", recon)]));
        let f = r.reconstruction(Stage::Stored).unwrap();
        let oracle = Oracle::new(f.clone(), 1.0);
        // the silhouette of parallel rays along x, by bisection in y
        let along = |y: f64| Ray {
            origin: DVec3::new(-5.0, y, 16.3),
            direction: DVec3::X,
        };
        let (mut inside, mut outside) = (16.0, 16.0 + 1.2 * scale);
        for _ in 0..60 {
            let y = 0.5 * (inside + outside);
            if oracle.first(&along(y)).hit().is_some() {
                inside = y;
            } else {
                outside = y;
            }
        }
        let view = View {
            camera: Camera::Orthographic {
                eye: DVec3::new(-5.0, inside, 16.3),
                target: DVec3::new(0.0, inside, 16.3),
                up: DVec3::Z,
                height: 32.0 * 1e-6,
            },
            width: 48,
            height: 32,
            clips: vec![],
        };
        let frame = draw(&PEAKS_CPU, &data, &surfaces, None, &view, (1, &[("reconstruction", recon)]));
        let truth = Truth::compute(&f, &surfaces, &view, &Stop::default()).unwrap();
        let c = check(&frame, &truth, &f, &surfaces, &view).unwrap();
        assert_eq!((c.missed, c.false_hits, c.wrong_root, c.refuted), (0, 0, 0, 0), "{recon}");
        assert!(c.hits > 300 && c.hits < 1300, "{recon}: {} hits", c.hits);
    }
}
