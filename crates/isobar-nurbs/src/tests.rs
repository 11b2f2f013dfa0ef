//! The hard cases of mapped cells (hardcases, section D) and pictures with a known answer, against answers worked out by hand.

use crate::NURBS_CPU;
use isobar_core::{
    Channels, Claim, DVec3, Data, Frame, Grid, HexElement, HexPatches, Method, Ray, Request, Samples, Stop, Surface, SurfaceKind,
    View,
};
use std::sync::Arc;

pub(crate) fn request(layers: usize) -> Request {
    Request {
        channels: Channels::all(),
        layers,
        threads: 1,
        ..Request::default()
    }
}

pub(crate) fn draw(data: &Arc<Data>, surfaces: &[Surface], view: &View, layers: usize) -> Frame {
    let mut r = NURBS_CPU.open(&request(layers)).unwrap();
    r.set_data(data).unwrap();
    r.set_surfaces(surfaces).unwrap();
    r.set_view(view).unwrap();
    r.render(&Stop::default()).unwrap();
    let mut f = Frame::default();
    r.read(&mut f).unwrap();
    f
}

pub(crate) fn ray(o: [f64; 3], d: [f64; 3]) -> Ray {
    Ray {
        origin: DVec3::from_array(o),
        direction: DVec3::from_array(d),
    }
}

/// A polynomial element from its position at parameters, which must be of the degree.
pub(crate) fn element(degree: [u8; 3], at: impl Fn([f64; 3]) -> [f64; 3], value_degree: [u8; 3], values: &[f64]) -> HexElement {
    use isobar_fields::hexes_bezier::{Tensor, interpolation};
    let counts = degree.map(|d| usize::from(d) + 1);
    let channel = |c: usize| {
        let values = (0..counts.iter().product::<usize>())
            .map(|n| {
                let i = [n % counts[0], n / counts[0] % counts[1], n / counts[0] / counts[1]];
                at([0, 1, 2].map(|a| i[a] as f64 / f64::from(degree[a])))[c]
            })
            .collect();
        (0..3)
            .fold(Tensor { counts, values }, |t, axis| {
                let nodes: Vec<f64> = (0..counts[axis]).map(|i| i as f64 / f64::from(degree[axis])).collect();
                let rows = interpolation(&nodes).unwrap();
                t.along(axis, |c| {
                    rows.iter().map(|r| r.iter().zip(c).map(|(a, b)| a * b).sum()).collect()
                })
            })
            .values
    };
    let [x, y, z] = [channel(0), channel(1), channel(2)];
    HexElement {
        degree,
        points: (0..x.len()).map(|i| [x[i], y[i], z[i], 1.0]).collect(),
        value_degree,
        values: values.into(),
        rational_value: false,
    }
}

pub(crate) fn hexes(elements: Vec<HexElement>) -> Arc<Data> {
    Arc::new(Data::Hexes(HexPatches::new(elements).unwrap()))
}

/// The hits of rays, as coordinate `axis` of the points.
fn hits(data: &Arc<Data>, c: f64, rays: &[Ray], axis: usize) -> (Vec<Vec<f64>>, Frame) {
    let layers = 8;
    let f = draw(data, &[Surface::isovalue(c, 0)], &View::rays(rays.to_vec()), layers);
    let n = rays.len();
    let all = (0..n)
        .map(|i| {
            (0..usize::from(f.hits[i]).min(layers))
                .map(|l| f.point[l * n + i][axis])
                .collect()
        })
        .collect();
    (all, f)
}

#[track_caller]
fn near(found: &[f64], want: &[f64], by: f64) {
    assert_eq!(found.len(), want.len(), "{found:?} {want:?}");
    for (a, b) in found.iter().zip(want) {
        assert!((a - b).abs() <= by, "{found:?} {want:?}");
    }
}

/// Hardcases D1: V = ((1 + v) c, (1 + v) s, w), c and s on the quarter circle; A = v.
pub(crate) fn annulus() -> HexElement {
    let h = std::f64::consts::FRAC_1_SQRT_2;
    let arc = [[1.0, 0.0, 1.0], [1.0, 1.0, h], [0.0, 1.0, 1.0]];
    HexElement {
        degree: [2, 1, 1],
        points: (0..12)
            .map(|n| {
                let ([c, s, w], r) = (arc[n % 3], 1.0 + (n / 3 % 2) as f64);
                [r * c, r * s, (n / 6) as f64, w]
            })
            .collect(),
        value_degree: [0, 1, 0],
        values: vec![0.0, 1.0].into(),
        rational_value: false,
    }
}

#[test]
fn d1_a_rational_annulus() {
    let data = hexes(vec![annulus()]);
    let rays = [ray([0.0, 0.9, 0.5], [1.0, 0.0, 0.0]), ray([0.3, 0.8, 0.5], [1.0, 0.3, 0.1])];
    let (all, f) = hits(&data, 0.5, &rays, 0);
    near(&all[0], &[1.2], 1e-14);
    assert!(
        f.claim[0].contains(Claim::EXISTS | Claim::FIRST) && f.t_error[0] < 1e-11,
        "{:?} {:?}",
        f.claim,
        f.t_error
    );
    assert_eq!(all[1].len(), 1);
    let p = f.point[1];
    assert!((p.truncate().length() - 1.5).abs() < 1e-14);
    let n = f.normal[0];
    assert!(
        (f64::from(n[0]) - 0.8).abs() < 1e-6 && (f64::from(n[1]) - 0.6).abs() < 1e-6,
        "{n:?}"
    );
    // The interval of the element along the first ray: its boundary.
    let boundary = Surface {
        kind: SurfaceKind::Boundary,
        ..Surface::isovalue(0.0, 0)
    };
    let f = draw(&data, &[boundary], &View::rays(rays[..1].to_vec()), 4);
    near(
        &f.t[..usize::from(f.hits[0])],
        &[0.435_889_894_354_067_3, 1.786_057_109_949_175],
        1e-14,
    );
}

#[test]
fn d2_two_intervals_in_one_element() {
    let e = element([2, 1, 1], |[u, v, w]| [u, v, 0.2 * w + u * (1.0 - u)], [0, 0, 1], &[0.0, 1.0]);
    let (all, f) = hits(&hexes(vec![e]), 0.5, &[ray([-1.0, 0.5, 0.2], [1.0, 0.0, 0.0])], 0);
    near(&all[0], &[0.112_701_665_379_258_3, 0.887_298_334_620_741_6], 1e-14);
    assert!(f.claim[0].contains(Claim::EXISTS | Claim::FIRST));
}

#[test]
fn d3_a_vanishing_jacobian() {
    let e = element([2, 1, 1], |[u, v, w]| [u * u, v, w], [1, 0, 0], &[0.0, 1.0]);
    let data = hexes(vec![e]);
    for a in [0.5, 1e-2, 1e-4, 1e-6] {
        let (all, f) = hits(&data, a, &[ray([-1.0, 0.3, 0.4], [1.0, 0.0, 0.0])], 0);
        near(&all[0], &[a * a], 1e-14);
        assert!(f.claim[0].contains(Claim::EXISTS | Claim::FIRST), "{a}: {:?}", f.claim[0]);
    }
}

#[test]
fn d4_a_collapsed_face() {
    let e = element([1, 1, 1], |[u, v, w]| [u, u * v, w], [0, 1, 0], &[0.0, 1.0]);
    let data = hexes(vec![e]);
    for k in 1..=9 {
        let x = 10f64.powi(-k);
        let (all, _) = hits(&data, 0.5, &[ray([x, -1.0, 0.4], [0.0, 1.0, 0.0])], 1);
        near(&all[0], &[x / 2.0], 1e-14);
    }
}

#[test]
fn d5_a_folded_element() {
    let e = element([2, 1, 1], |[u, v, w]| [4.0 * u * u - 3.0 * u, v, w], [1, 0, 0], &[0.0, 1.0]);
    let (all, f) = hits(&hexes(vec![e]), 0.25, &[ray([-2.0, 0.3, 0.4], [1.0, 0.0, 0.0])], 0);
    near(&all[0], &[-0.5], 1e-14);
    assert!(f.claim[0].contains(Claim::EXISTS | Claim::FIRST));
}

#[test]
fn d7_the_teardrop_as_one_patch() {
    let p = isobar_fields::analytic("teardrop", &Default::default()).unwrap();
    let isobar_core::Structure::Polynomial(a) = p.function.structure() else {
        panic!()
    };
    let data = Arc::new(Data::Algebraic(a.clone()));
    // x^4 (x + 1) / 2 = y^2 on z = 0
    let (all, f) = hits(
        &data,
        0.0,
        &[
            ray([0.5, -3.0, 0.0], [0.0, 1.0, 0.0]),
            ray([-0.5, -3.0, 0.0], [0.0, 1.0, 0.0]),
        ],
        1,
    );
    let y = (0.0625f64 * 1.5 / 2.0).sqrt();
    near(&all[0], &[-y, y], 1e-13);
    let y = (0.0625f64 * 0.5 / 2.0).sqrt();
    near(&all[1], &[-y, y], 1e-13);
    assert!(f.claim.iter().all(|c| c.contains(Claim::EXISTS | Claim::FIRST)));
}

/// Hardcases D8: two hexahedra that share a face that is not plane.
#[test]
fn d8_a_shared_face_that_is_not_plane() {
    let z = |x: f64, y: f64| 0.3 * x * y + 0.1 * x;
    let lower = element([1; 3], |[u, v, w]| [u, v, -1.0 + w * (1.0 + z(u, v))], [1, 0, 0], &[0.0, 1.0]);
    let upper = element(
        [1; 3],
        |[u, v, w]| [u, v, z(u, v) + w * (1.0 - z(u, v))],
        [1, 0, 0],
        &[0.0, 1.0],
    );
    let data = hexes(vec![lower, upper]);
    let mut rays = Vec::new();
    for i in 0..400 {
        // through points of the face and beside them
        let y = 0.1 + 0.002 * f64::from(i);
        let target = DVec3::new(0.5, y, z(0.5, y) + [0.0, 1e-12, -1e-12, 1e-15][i as usize % 4]);
        let from = DVec3::new(-1.0, 0.3 + y, [0.2, -0.4][i as usize / 4 % 2]);
        rays.push(Ray {
            origin: from,
            direction: target - from,
        });
    }
    let (all, _) = hits(&data, 0.5, &rays, 0);
    for (h, r) in all.iter().zip(&rays) {
        assert_eq!(h.len(), 1, "{r:?}: {h:?}");
        assert!((h[0] - 0.5).abs() < 1e-12);
    }
}

/// A Bezier cell with identity geometry and coefficients 0, 1.5, 0: its maximum is 0.75, and nothing is drawn at 0.9.
#[test]
fn a_control_net_is_not_the_function() {
    let e = element([1; 3], |u| u, [2, 0, 0], &[0.0, 1.5, 0.0]);
    let data = hexes(vec![e]);
    let view = View::perspective(DVec3::new(2.6, 1.9, 2.2), DVec3::splat(0.5), DVec3::Z, 40.0, 64, 48);
    let f = draw(&data, &[Surface::isovalue(0.9, 0)], &view, 1);
    assert!(f.hits.iter().all(|&h| h == 0) && f.claim.iter().all(|c| c.contains(Claim::EMPTY)));
    let f = draw(&data, &[Surface::isovalue(0.7, 0)], &view, 1);
    assert!(f.hits.iter().filter(|&&h| h > 0).count() > 200);
}

/// x^2 + y^2 on curved order-2 hexahedra: interpolated exactly, the surface is a circular cylinder.
#[test]
fn circles_are_exact() {
    let bend = |p: [f64; 3]| {
        [
            p[0] * 2.0 - 1.0 + 0.1 * p[2] * p[2],
            p[1] * 2.0 - 1.0,
            p[2] + 0.2 * p[0] * p[1],
        ]
    };
    let mut elements = Vec::new();
    for n in 0..8 {
        let o = [n & 1, n >> 1 & 1, n >> 2].map(|i| f64::from(i) * 0.5);
        let at = |u: [f64; 3]| bend([0, 1, 2].map(|a| o[a] + 0.5 * u[a]));
        let mut e = element([2; 3], at, [4; 3], &[0.0; 125]);
        // x^2 + y^2 has degree 4 in u: interpolate it.
        let f = element([4; 3], |u| [at(u)[0].powi(2) + at(u)[1].powi(2), 0.0, 0.0], [0; 3], &[0.0]);
        e.values = f.points.iter().map(|p| p[0]).collect();
        elements.push(e);
    }
    let data = hexes(elements);
    let view = View::perspective(DVec3::new(2.6, 1.9, 2.2), DVec3::new(0.0, 0.0, 0.5), DVec3::Z, 40.0, 80, 60);
    let f = draw(&data, &[Surface::isovalue(0.64, 0)], &view, 2);
    let n = 80 * 60;
    let (mut count, mut claimed) = (0, 0);
    for i in 0..2 * n {
        if f.t[i].is_finite() {
            count += 1;
            let r = f.point[i].truncate().length();
            assert!((r - 0.8).abs() < 1e-12, "{r}");
            let radial = (f.point[i].truncate() / 0.8).extend(0.0);
            assert!(radial.dot(DVec3::from_array(f.normal[i].map(f64::from))) > 1.0 - 1e-6);
        }
    }
    for c in &f.claim {
        claimed += usize::from(c.contains(Claim::EMPTY) || c.contains(Claim::EXISTS | Claim::FIRST));
    }
    assert!(
        count > 800 && claimed + 3 >= n,
        "{count} hits, {claimed} of {n} pixels claimed"
    );
}

/// An eye inside an element, and planes of parameters.
#[test]
fn eyes_inside_elements_see_what_lies_before_them() {
    let e = element(
        [1; 3],
        |[u, v, w]| [u + 0.1 * v * w, v, w - 0.2 * u * v],
        [1; 3],
        &[0.0, 1.0, 0.3, 0.9, 0.1, 0.8, 0.2, 1.1],
    );
    let data = hexes(vec![e]);
    let view = View::perspective(DVec3::new(0.3, 0.4, 0.5), DVec3::new(1.0, 0.5, 0.5), DVec3::Z, 100.0, 20, 20);
    let plane = |axis: u8, value: f64| Surface {
        kind: SurfaceKind::Parameter { axis, value },
        ..Surface::isovalue(0.0, 0)
    };
    let f = draw(&data, &[Surface::isovalue(0.6, 0), plane(1, 0.5), plane(0, 1.0)], &view, 4);
    assert!(f.hits[210] >= 1 && f.t.iter().all(|&t| t >= 0.0));
    assert!((0..3u8).all(|s| f.surface.contains(&s)));
    for (i, &s) in f.surface.iter().enumerate().filter(|(_, s)| **s == 1) {
        assert!(s == 1 && (f.point[i].y - 0.5).abs() < 1e-13);
    }
}

/// The form as printed finds what there is to within its quarter pixel on an easy scene, with any box.
#[test]
fn the_paper_s_form_agrees_to_a_quarter_pixel() {
    let data = hexes(vec![annulus()]);
    let view = View::perspective(DVec3::new(4.0, 3.0, 3.5), DVec3::new(0.8, 0.8, 0.5), DVec3::Z, 40.0, 40, 40);
    let surfaces = [Surface::isovalue(0.5, 0)];
    let exact = draw(&data, &surfaces, &view, 2);
    let mut subdivisions = Vec::new();
    for bounds in ["obb", "aabb", "pca"] {
        let mut q = request(2);
        q.knobs.set("bounds", bounds);
        let mut r = crate::NURBS_CPU_PAPER.open(&q).unwrap();
        r.set_data(&data).unwrap();
        r.set_surfaces(&surfaces).unwrap();
        r.set_view(&view).unwrap();
        r.render(&Stop::default()).unwrap();
        let mut f = Frame::default();
        r.read(&mut f).unwrap();
        // A difference is infinite where only one has a hit, and not a number where neither has. Which pixels differ and why: `paper_tests.rs`.
        let differ = (0..1600).filter(|&i| (f.t[i] - exact.t[i]).abs() > 0.1).count();
        assert!(
            f.hits.iter().filter(|&&h| h > 0).count() > 200 && differ <= 20,
            "{bounds}: {differ} pixels differ"
        );
        assert!(f.claim.iter().all(|c| c.is_empty()));
        subdivisions.push(r.counters().0[0].1);
    }
    assert!(
        subdivisions[0] < subdivisions[1],
        "boxes along the Jacobian are tighter: {subdivisions:?}"
    );
}

/// A grid of more cells than would be made into elements: drawn, but not its boundary.
#[test]
fn grids_of_any_size() {
    const N: usize = 164;
    let far = |i: usize| (i as f64 - 81.5).powi(2);
    let samples: Vec<u8> = (0..N * N * N)
        .map(|i| (far(i % N) + far(i / N % N) + far(i / N / N)).sqrt() as u8)
        .collect();
    let grid = isobar_core::Grid::unit([N; 3], isobar_core::Samples::U8(samples.into())).unwrap();
    let data = Arc::new(Data::Grid(grid));
    let (lo, hi) = data.bounds();
    let (view, centre) = (View::fit((lo, hi), 40.0, 24, 24), (lo + hi) * 0.5);
    let f = draw(&data, &[Surface::isovalue(59.5, 0)], &view, 1);
    let voxel = (hi - lo).x / (N - 1) as f64;
    let hits: Vec<f64> = (0..f.t.len())
        .filter(|&i| f.t[i].is_finite())
        .map(|i| (f.point[i] - centre).length() / voxel)
        .collect();
    // Distances are cut to integers, so radii are up to a voxel more.
    assert!(hits.len() > 60 && hits.iter().all(|r| (59.4..61.1).contains(r)), "{hits:?}");
    let boundary = [Surface {
        kind: SurfaceKind::Boundary,
        ..Surface::isovalue(0.0, 0)
    }];
    let scene = isobar_core::Scene {
        data: &data,
        surfaces: &boundary,
        medium: None,
        view: &view,
    };
    let said = NURBS_CPU.supports(&scene, &request(1)).unwrap_err().to_string();
    assert!(said.contains("boundary surfaces of grids of more than 4194304"), "{said}");
}

/// Thin boxes and far eyes: the position of the ray in a box is known to some 1e-15 of distance over size, and the margin of the search grows with it; from still farther the
/// box is halved in world coordinates.
#[test]
fn thin_boxes_are_seen_from_afar() {
    // s = w across the thin axis
    let thin = element([1; 3], |[u, v, w]| [u, v, 1e-6 * w], [0, 0, 1], &[0.0, 1.0]);
    assert!(crate::affine::exact_box(&thin).is_some());
    let data = hexes(vec![thin]);
    for distance in [5.0, 500.0, 5e4] {
        for side in [1.0, -1.0] {
            let rays = [ray([0.3, 0.4, side * distance], [0.0, 0.0, -side])];
            let (found, f) = hits(&data, 0.5, &rays, 2);
            assert_eq!(found[0].len(), 1, "{distance}: {found:?} {:?}", f.claim);
            assert!((found[0][0] - 0.5e-6).abs() < 1e-14 * distance, "{distance}: {found:?}");
            assert!(f.claim[0].contains(Claim::EXISTS | Claim::FIRST), "{distance}: {:?}", f.claim);
        }
    }
}

/// What is refused leaves everything as it was.
#[test]
fn refused_data_and_surfaces_change_nothing() {
    let grid = |dims: [usize; 3]| {
        let samples: Vec<f32> = (0..dims.iter().product()).map(|i: usize| (i % dims[0]) as f32).collect();
        Arc::new(Data::Grid(Grid::unit(dims, Samples::F32(samples.into())).unwrap()))
    };
    let mut r = NURBS_CPU.open(&request(1)).unwrap();
    r.set_data(&grid([9, 9, 9])).unwrap();
    r.set_surfaces(&[Surface::isovalue(4.25, 0)]).unwrap();
    let view = View::rays(vec![ray([-1.0, 4.0, 4.0], [1.0, 0.0, 0.0])]);
    r.set_view(&view).unwrap();
    let mut hit = || {
        r.render(&Stop::default()).unwrap();
        let mut f = Frame::default();
        r.read(&mut f).unwrap();
        (f.t[0], r.set_data(&grid([9, 9, 1])).is_err())
    };
    let (first, refused) = hit();
    assert!((first - 5.25).abs() < 1e-12 && refused, "{first}");
    assert_eq!(hit().0, first);
}

/// A root whose t is beyond all numbers is no proved miss.
#[test]
fn a_root_beyond_all_numbers_is_no_miss() {
    let far = element([1; 3], |[u, v, w]| [1e10 + u + 0.1 * v * w, v, w], [1, 0, 0], &[0.0, 1.0]);
    let (all, f) = hits(&hexes(vec![far]), 0.5, &[ray([0.0, 0.4, 0.5], [1e-300, 0.0, 0.0])], 0);
    assert!(all[0].is_empty() && !f.claim[0].contains(Claim::EMPTY), "{:?}", f.claim);
    let far = ray([0.0, 0.4, 0.5], [1e-290, 0.0, 0.0]);
    let e = element([1; 3], |[u, v, w]| [1e10 + u + 0.1 * v * w, v, w], [1, 0, 0], &[0.0, 1.0]);
    assert_eq!(hits(&hexes(vec![e]), 0.5, &[far], 0).0[0].len(), 1);
}
