//! Hardcases B (single cells and small grids) and rays in faces, edges and corners.

use crate::support::{Spline, expect, list, ray};
use isobar_core::{CUBIC, DMat3, DVec3, QUADRATIC, TRILINEAR};
use isobar_oracle::{Decided, Multiplicity, Oracle};

const DIAGONAL: [f64; 3] = [1.0, 1.0, 1.0];

/// All three stages.
fn staged(o: &Oracle) -> [Oracle; 3] {
    [Decided::F64, Decided::DoubleDouble, Decided::Exact].map(|s| o.with_stage(s))
}

fn corner_cell(f: impl Fn(f64, f64, f64) -> f64) -> Oracle {
    Spline::new([2; 3], &TRILINEAR, f).oracle(0.0)
}

#[test]
fn b1_checkerboard() {
    let o = corner_cell(|x, y, z| (1.0 - 2.0 * x) * (1.0 - 2.0 * y) * (1.0 - 2.0 * z));
    for o in staged(&o) {
        expect(&o, &ray([0.0; 3], DIAGONAL), 0.0, &[(0.5, 3)], 1e-15);
        expect(&o, &ray([0.0, 0.0, 1.0], [1.0, 1.0, -1.0]), 0.0, &[(0.5, 3)], 1e-15);
        for z in [0.0, 0.3, 1.0] {
            let all = o.all(&ray([-1.0, 0.5, z], [1.0, 0.0, 0.0]));
            assert_eq!(list(&all, 0.0), [(1.0, 0)]);
            assert_eq!(all.roots[0].interval_end, Some(2.0));
        }
    }
}

/// Values times 150 and 1200, so that they are exact.
#[test]
fn b2_b3_no_sign_change() {
    let by_sum = |v: [f64; 4]| move |x: f64, y: f64, z: f64| v[(x + y + z) as usize];
    for o in staged(&corner_cell(by_sum([27.0, -9.0, -40.0, 84.0]))) {
        expect(&o, &ray([0.0; 3], DIAGONAL), 0.0, &[(0.3, 1), (0.6, 1)], 1e-15);
        expect(&o, &ray([-1.0; 3], DIAGONAL), 1.0, &[(0.3, 1), (0.6, 1)], 1e-15);
    }
    for o in staged(&corner_cell(by_sum([243.0, -36.0, -275.0, 726.0]))) {
        expect(&o, &ray([0.0; 3], DIAGONAL), 0.0, &[(0.45, 2)], 1e-15);
        expect(&o, &ray([1.0; 3], [-1.0; 3]), 0.0, &[(0.55, 2)], 1e-15);
    }
}

/// The middle face's zero set is the cross j = 1/8, k = 1/2.
#[test]
fn b4_face_tie() {
    const V: [[[f64; 2]; 2]; 3] = [
        [[13.0, -1.0], [-1.0, -7.0]],
        [[-1.0, 1.0], [7.0, -7.0]],
        [[15.0, -9.0], [-3.0, -1.0]],
    ];
    let o = Spline::new([3, 2, 2], &TRILINEAR, |i, j, k| V[i as usize][j as usize][k as usize]).oracle(0.0);
    for o in staged(&o) {
        // in the face, along j: crosses j = 1/8; along k: crosses k = 1/2
        expect(&o, &ray([1.0, -1.0, 0.25], [0.0, 1.0, 0.0]), 1.0, &[(0.125, 1)], 1e-15);
        expect(&o, &ray([1.0, 0.5, -1.0], [0.0, 0.0, 1.0]), 1.0, &[(0.5, 1)], 1e-15);
        // along the arms: stretches
        let all = o.all(&ray([1.0, 0.125, -1.0], [0.0, 0.0, 1.0]));
        assert_eq!((list(&all, 1.0), all.roots[0].interval_end), (vec![(0.0, 0)], Some(2.0)));
        // through the saddle, in the face: a double root
        let r = ray([1.0, 0.125 - 0.0625, 0.0], [0.0, 0.125, 1.0]);
        expect(&o, &r, 0.0, &[(0.5, 2)], 1e-15);
        // across the face at a point of the cross: one root on it, reported once, from either side
        let a = o.all(&ray([0.5, 0.125, 0.25], [1.0, 0.0, 0.0]));
        let b = o.all(&ray([1.5, 0.125, 0.25], [-1.0, 0.0, 0.0]));
        assert_eq!(a.roots.iter().filter(|r| r.lo == 0.5).count(), 1);
        assert_eq!(b.roots.iter().filter(|r| r.lo == 0.5).count(), 1);
    }
}

fn peak(c: f64) -> Oracle {
    Spline::new(
        [3; 3],
        &TRILINEAR,
        |i, j, k| if (i, j, k) == (1.0, 1.0, 1.0) { 1.0 } else { 0.0 },
    )
    .oracle(c)
}

#[test]
fn b5_isovalue_is_a_data_value() {
    for o in staged(&peak(1.0)) {
        for d in [
            [1.0, 0.0, 0.0],
            [0.0, 0.0, -1.0],
            [1.0, 1.0, 1.0],
            [1.0, -1.0, 0.0],
            [0.5, 0.25, -1.0],
        ] {
            let d = DVec3::from(d);
            let o3 = DVec3::ONE - d * 4.0;
            let all = o.all(&ray(o3.into(), d.into()));
            assert_eq!(all.roots.len(), 1, "{all:?}");
            assert!(matches!(all.roots[0].multiplicity, Multiplicity::Even(_)), "{all:?}");
            assert_eq!((all.roots[0].lo, all.roots[0].hi), (4.0, 4.0));
            assert!(o.undecidable(&ray(o3.into(), d.into())));
        }
        expect(&o, &ray([-1.0, 1.0, 1.001], [1.0, 0.0, 0.0]), 0.0, &[], 0.0);
    }
}

#[test]
fn b6_half_way() {
    for o in staged(&peak(0.5)) {
        expect(
            &o,
            &ray([-1.0, 1.0, 1.0], [1.0, 0.0, 0.0]),
            2.0,
            &[(-0.5, 1), (0.5, 1)],
            1e-15,
        );
        let a = 0.206_299_474_015_900_26;
        expect(&o, &ray([-1.0; 3], DIAGONAL), 2.0, &[(-a, 1), (a, 1)], 1e-15);
    }
}

/// One plateau cell inside a ramp: one stretch, ended by the ramp, from both sides; and a stretch over several cells and blocks.
#[test]
fn b7_plateau() {
    let ramp = |i: f64| {
        if i < 3.0 {
            i
        } else if i < 5.0 {
            3.0
        } else {
            i - 2.0
        }
    };
    for basis in [&TRILINEAR, &CUBIC] {
        let values = move |i: f64, _: f64, _: f64| ramp(i);
        for o in staged(&Spline::new([8, 3, 3], basis, values).oracle(3.0)) {
            let all = o.all(&ray([-1.0, 0.7, 1.3], [1.0, 0.0, 0.0]));
            if basis.degree == 1 {
                assert_eq!(list(&all, 1.0), [(3.0, 0)]);
                assert_eq!(all.roots[0].interval_end, Some(6.0));
            }
            let back = o.all(&ray([9.0, 0.7, 1.3], [-1.0, 0.0, 0.0]));
            assert_eq!(all.roots.len(), back.roots.len());
        }
    }
    let wide = Spline::new([40, 3, 3], &TRILINEAR, |i, _, _| (i - 20.0).abs().max(15.0)).oracle(15.0);
    for o in staged(&wide) {
        for y in [0.0, 0.5, 1.0, 1.7] {
            let all = o.all(&ray([-1.0, y, 1.3], [1.0, 0.0, 0.0]));
            assert_eq!((list(&all, 1.0), all.roots[0].interval_end), (vec![(5.0, 0)], Some(36.0)));
            assert_eq!(o.first(&ray([-1.0, y, 1.3], [1.0, 0.0, 0.0])).hit(), Some(&all.roots[0]));
        }
        // A ray that starts inside the plateau
        let all = o.all(&ray([20.25, 1.0, 1.0], [-1.0, 0.0, 0.0]));
        assert_eq!((list(&all, 0.0), all.roots[0].interval_end), (vec![(0.0, 0)], Some(15.25)));
    }
}

/// Along edges, face and body diagonals: the count of rays shifted by 1e-9.
#[test]
fn b8_grazing_edges() {
    for basis in [&TRILINEAR, &QUADRATIC, &CUBIC] {
        let sphere = |i: f64, j: f64, k: f64| (i - 4.0).powi(2) + (j - 4.0).powi(2) + (k - 4.0).powi(2);
        let o = Spline::new([9; 3], basis, sphere).oracle(10.3);
        let mut lines = Vec::new();
        for a in 0..9 {
            let a = f64::from(a);
            lines.push(ray([-1.0, a, 4.0], [1.0, 0.0, 0.0]));
            lines.push(ray([a, 9.0, 3.0], [0.0, -1.0, 0.0]));
            lines.push(ray([-1.0, -1.0, a], [1.0, 1.0, 0.0]));
            lines.push(ray([-1.0, a - 5.0, 4.5], [1.0, 1.0, 0.0]));
        }
        for d in [[1.0, 1.0, 1.0], [1.0, -1.0, 1.0], [-1.0, 1.0, 1.0], [1.0, 1.0, -1.0]] {
            let d = DVec3::from(d);
            lines.push(ray((DVec3::splat(4.0) - d * 6.0).into(), d.into()));
            lines.push(ray((DVec3::splat(4.5) - d * 7.0).into(), d.into()));
        }
        for r in &lines {
            let n = o.all(r).roots.len();
            assert_eq!(n, o.with_stage(Decided::Exact).all(r).roots.len(), "{r:?}");
            for shift in [[1e-9, 2e-9, -1e-9], [-2e-9, 1e-9, 1e-9]] {
                let moved = ray((r.origin + DVec3::from(shift)).into(), r.direction.into());
                assert_eq!(n, o.all(&moved).roots.len(), "{r:?}");
            }
        }
    }
}

/// Moments: the splines of i^2 + j^2 + k^2 are x^2 + y^2 + z^2 plus a constant away from the border.
#[test]
fn b10_b11_b13_moments_on_an_axis() {
    let data = |i: f64, j: f64, k: f64| (i - 16.0).powi(2) + (j - 16.0).powi(2) + (k - 16.0).powi(2);
    let hit = |basis, c: f64| {
        let o = Spline::new([33; 3], basis, data).oracle(c);
        *o.first(&ray([16.0; 3], [1.0, 0.0, 0.0])).hit().unwrap()
    };
    let near = |h: isobar_oracle::Root, want: f64| (h.t() - want).abs() < 4e-15 * want;
    assert!(near(hit(&CUBIC, 100.0), 9.949_874_371_066_2));
    assert!(near(hit(&QUADRATIC, 100.0), 9.962_429_422_585_6));
    assert!(near(hit(&TRILINEAR, 90.25), 9.486_842_105_263_158));
    // the slope of the cubic spline is 2x
    let h = hit(&CUBIC, 100.0);
    assert!((h.conditioning() * 2.0 * h.t() - 1.0).abs() < 1e-9);
}

/// A9 as cells: the cubic spline with these coefficients is x (x - 1) (x - 2) about x = 4; its roots are faces, found once each.
#[test]
fn a9_roots_on_faces_of_half_open_cells() {
    let c = |i: f64, _: f64, _: f64| {
        let i = i - 4.0;
        i * i * i - 3.0 * i * i + i + 1.0
    };
    for o in staged(&Spline::new([12, 3, 3], &CUBIC, c).oracle(0.0)) {
        // border coefficients are clamped: look at the middle only
        for r in [ray([1.5, 1.0, 1.2], [1.0, 0.0, 0.0]), ray([8.5, 1.0, 1.2], [-1.0, 0.0, 0.0])] {
            let all = o.until(&r, 6.0);
            assert_eq!(list(&all, 0.0), [(2.5, 1), (3.5, 1), (4.5, 1)]);
            assert!(all.roots.iter().all(|r| r.lo == r.hi));
        }
    }
}

/// B17: spacings (1, 1, 1e-6), (1, 1e6, 1), far beyond, flipped and permuted axes, and a far camera: the isotropic problem's hits.
#[test]
fn b17_extreme_aspect() {
    let data = |i: f64, j: f64, k: f64| (i * 1.7).sin() + (j * 1.3).cos() * (k * 0.9).sin();
    let plain = Spline::new([7; 3], &CUBIC, data).oracle(0.2);
    let scales = [
        [1.0, 1.0, 1e-6],
        [1.0, 1e6, 1.0],
        [1e-12, 1.0, 1e12],
        [-2.0, 0.5, 1024.0],
        [1e-90, 1e-90, 1e80],
    ];
    for (o, d) in [([-1.0, 2.3, 3.1], [1.0, 0.11, 0.07]), ([5.5, -1.0, 4.0], [-0.3, 1.0, -0.2])] {
        let want = plain.all(&ray(o, d));
        assert!(!want.roots.is_empty());
        for s in scales {
            let s3 = DVec3::from(s);
            let o2 = Spline::new([7; 3], &CUBIC, data)
                .placed(DVec3::ZERO, DMat3::from_diagonal(s3))
                .oracle(0.2);
            let got = o2.all(&ray((DVec3::from(o) * s3).into(), (DVec3::from(d) * s3).into()));
            assert_eq!(got.roots.len(), want.roots.len());
            for (g, w) in got.roots.iter().zip(&want.roots) {
                assert!((g.t() - w.t()).abs() < 1e-13 * w.t(), "{s:?} {g:?} {w:?}");
            }
        }
        // x -> z, y -> -x, z -> y: exact
        let axes = DMat3::from_cols(DVec3::Z, -DVec3::X, DVec3::Y);
        let o2 = Spline::new([7; 3], &CUBIC, data).placed(DVec3::ZERO, axes).oracle(0.2);
        let got = o2.all(&ray((axes * DVec3::from(o)).into(), (axes * DVec3::from(d)).into()));
        assert_eq!(list(&got, 0.0), list(&want, 0.0));
    }
    // 1e7 away along the same line of doubles
    let r = ray([-1e7, 2.25, 3.125], [1.0, 0.0, 0.0]);
    let (far, near) = (plain.all(&r), plain.all(&ray([-1.0, 2.25, 3.125], [1.0, 0.0, 0.0])));
    assert_eq!(far.roots.len(), near.roots.len());
    for (f, n) in far.roots.iter().zip(&near.roots) {
        assert!((f.t() - 1e7 - (n.t() - 1.0)).abs() < 4e-9 && f.hi - f.lo <= 8e-9);
        assert_eq!(f.decided, Decided::F64);
    }
}

/// General (sheared) axes, also with rays in faces of cells.
#[test]
fn sheared_axes() {
    let axes = DMat3::from_cols(
        DVec3::new(1.0, 0.25, 0.0),
        DVec3::new(-0.5, 2.0, 0.125),
        DVec3::new(0.0, 0.5, -1.0),
    );
    let origin = DVec3::new(0.5, -3.0, 7.0);
    let data = |i: f64, j: f64, k: f64| (i * 1.7).sin() + (j * 1.3).cos() * (k * 0.9).sin();
    for basis in [&TRILINEAR, &QUADRATIC, &CUBIC] {
        let plain = Spline::new([6; 3], basis, data).oracle(0.2);
        let o = Spline::new([6; 3], basis, data).placed(origin, axes).oracle(0.2);
        for (from, d) in [
            ([-1.0, 2.25, 3.125], [1.0, 0.5, 0.25]),
            ([-1.0, 2.0, 3.125], [1.0, 0.0, 0.25]),
            ([2.0, 2.0, 6.0], [0.0, 0.0, -1.0]),
            ([-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]),
        ] {
            let want = plain.all(&ray(from, d));
            let got = o.all(&ray(
                (origin + axes * DVec3::from(from)).into(),
                (axes * DVec3::from(d)).into(),
            ));
            assert_eq!(list(&got, 0.0).len(), list(&want, 0.0).len());
            for (g, w) in got.roots.iter().zip(&want.roots) {
                assert!((g.t() - w.t()).abs() < 1e-14 * w.t().max(1.0));
            }
        }
    }
}

/// A quarter turn made with sines, so that axes lean by 6e-17, and a general rotation, both with rays along their axes: no ray of a
/// whole image may need integers.
#[test]
fn rays_along_rotated_axes() {
    let data = |i: f64, j: f64, k: f64| (i * 0.7).sin() + (j * 0.3).cos() * (k * 0.9).sin();
    let turns = [
        DMat3::from_rotation_z(std::f64::consts::FRAC_PI_2),
        DMat3::from_rotation_x(0.3) * DMat3::from_rotation_y(1.1),
    ];
    for turn in turns {
        let axes = turn * DMat3::from_diagonal(DVec3::new(0.1, 0.2, 0.15));
        let o = Spline::new([9; 3], &CUBIC, data)
            .placed(DVec3::new(0.3, -0.2, 0.1), axes)
            .oracle(0.2);
        let domain = *o.function().domain();
        let mut found = 0;
        for n in 0..40 {
            let u = DVec3::new(-2.0, 0.13 + 0.19 * f64::from(n), 7.7 - 0.17 * f64::from(n));
            for direction in [axes.x_axis, turn.x_axis, DVec3::X, DVec3::Y] {
                let from = domain.world(DVec3::new(4.0, u.y, u.z)) - direction * (3.0 / direction.length());
                let r = isobar_core::Ray { origin: from, direction };
                let (all, exact) = (o.all(&r), o.with_stage(Decided::Exact).all(&r));
                assert!(all.decided < Decided::Exact, "{r:?}");
                assert_eq!(all.roots.len(), exact.roots.len());
                for (a, b) in all.roots.iter().zip(&exact.roots) {
                    assert!(a.lo <= b.hi && b.lo <= a.hi);
                }
                found += all.roots.len();
            }
        }
        assert!(found > 100);
    }
}

/// Rays that only touch the domain: an edge, a corner, a face.
#[test]
fn touching_rays_are_inside() {
    let o = Spline::new([3; 3], &TRILINEAR, |i, _, _| i).oracle(0.0);
    for o in staged(&o) {
        // through the corner (0, 0, 0), where s = 0
        let all = o.all(&ray([-1.0, 1.0, 0.0], [1.0, -1.0, 0.0]));
        assert_eq!(all.roots.len(), 1, "{all:?}");
        assert_eq!((all.roots[0].lo, all.roots[0].hi), (1.0, 1.0));
        // in the face x = 0
        let all = o.all(&ray([0.0, -1.0, 1.0], [0.0, 1.0, 0.25]));
        assert_eq!((list(&all, 1.0), all.roots[0].interval_end), (vec![(0.0, 0)], Some(3.0)));
        // past it
        assert!(o.all(&ray([-1e-300, -1.0, 1.0], [0.0, 1.0, 0.25])).roots.is_empty());
        assert!(o.all(&ray([-1.0, 1.0 - 1e-15, 0.0], [1.0, -1.0, -1e-9])).roots.is_empty());
        // s = 0 at the far end of the stay
        let all = o.all(&ray([3.0, 1.3, 0.7], [-1.0, 0.0, 0.0]));
        assert_eq!((all.roots.len(), all.roots[0].lo), (1, 3.0));
    }
}

/// Only t >= 0 counts, and t = 0 does.
#[test]
fn the_start_counts() {
    let o = Spline::new([5; 3], &QUADRATIC, |i, _, _| i).oracle(2.0);
    for o in staged(&o) {
        assert_eq!(list(&o.all(&ray([2.0, 1.1, 2.3], [1.0, 0.0, 0.0])), 0.0), [(0.0, 1)]);
        assert!(o.all(&ray([2.0f64.next_up(), 1.1, 2.3], [1.0, 0.0, 0.0])).roots.is_empty());
        assert_eq!(o.all(&ray([2.0f64.next_up(), 1.1, 2.3], [-1.0, 0.0, 0.0])).roots.len(), 1);
    }
}

/// E2 in small: the camera a thousandth of a voxel before the wall.
#[test]
fn near_walls_have_narrow_brackets() {
    let o = Spline::new([9; 3], &CUBIC, |i, j, _| i + 0.01 * (j * 2.0).sin()).oracle(4.1);
    for y in 0..20 {
        let r = ray([4.1 - 0.011, 3.0 + f64::from(y) * 0.05, 4.4], [1.0, 0.001, 0.002]);
        let h = *o.first(&r).hit().unwrap();
        assert!(h.t() < 0.03 && h.hi - h.lo <= 1e-13 * h.t(), "{h:?}");
    }
}

#[test]
fn rays_that_are_no_rays_are_not_decided() {
    let o = peak(0.5);
    for r in [
        ray([0.0; 3], [0.0; 3]),
        ray([f64::NAN, 0.0, 0.0], DIAGONAL),
        ray([0.0; 3], [f64::INFINITY, 0.0, 0.0]),
    ] {
        assert!(matches!(o.first(&r), isobar_oracle::Answer::Unresolved { .. }));
    }
    assert!(matches!(
        peak(f64::NAN).first(&ray([0.0; 3], DIAGONAL)),
        isobar_oracle::Answer::Unresolved { .. }
    ));
}
