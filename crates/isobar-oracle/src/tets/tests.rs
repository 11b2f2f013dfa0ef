//! Exact answers on meshes: linear fields, faces, edges and corners, gaps, stages against each other, frames.

use crate::{Answer, Class, Decided, Multiplicity, Oracle, Truth, check};
use isobar_core::{Channels, ClipPlane, DVec3, Frame, Function, Grid, Hit, Ray, Samples, Stop, Surface, TetMesh, View};
use isobar_fields::{TetLinear, grid_to_tets};
use std::sync::Arc;

const STAGES: [Decided; 3] = [Decided::F64, Decided::DoubleDouble, Decided::Exact];

fn ray(o: [f64; 3], d: [f64; 3]) -> Ray {
    Ray {
        origin: DVec3::from_array(o),
        direction: DVec3::from_array(d),
    }
}

fn function(mesh: &TetMesh) -> Arc<dyn Function> {
    Arc::new(TetLinear::new(mesh).unwrap())
}

fn mesh(points: &[[f64; 3]], cells: &[[u32; 4]], values: &[f32]) -> TetMesh {
    let points: Vec<DVec3> = points.iter().map(|&p| DVec3::from_array(p)).collect();
    TetMesh::new(points.into(), cells.into(), values.into()).unwrap()
}

/// The box [0, n - 1]^3 with s sampled at whole coordinates.
fn lattice(n: usize, s: impl Fn(DVec3) -> f64) -> TetMesh {
    let at = |i: usize| DVec3::new((i % n) as f64, (i / n % n) as f64, (i / n / n) as f64);
    let samples: Vec<f32> = (0..n * n * n).map(|i| s(at(i)) as f32).collect();
    grid_to_tets(&Grid::unit([n; 3], Samples::F32(samples.into())).unwrap()).unwrap()
}

fn random(seed: &mut u64) -> f64 {
    *seed = seed
        .wrapping_mul(6_364_136_223_846_793_005)
        .wrapping_add(1_442_695_040_888_963_407);
    (*seed >> 11) as f64 / (1u64 << 53) as f64
}

/// t and multiplicity of all roots, the same in every stage.
fn roots(f: &Arc<dyn Function>, c: f64, r: &Ray) -> Vec<(f64, Multiplicity)> {
    let of = |stage| -> Vec<_> { Oracle::new(f.clone(), c).with_stage(stage).all(r).roots };
    let exact = of(Decided::Exact);
    for stage in STAGES {
        let all = of(stage);
        assert_eq!(all.len(), exact.len(), "{stage:?} {all:?} {exact:?}");
        for (a, b) in all.iter().zip(&exact) {
            assert_eq!((a.multiplicity, a.interval_end), (b.multiplicity, b.interval_end));
            assert!(a.lo <= b.hi && b.lo <= a.hi, "{a:?} {b:?}");
            assert!(a.hi - a.lo <= (1e-13 * a.hi.abs()).max(1e-15) && b.hi <= b.lo.next_up());
        }
    }
    exact.iter().map(|r| (r.t(), r.multiplicity)).collect()
}

/// hardcases E8.
#[test]
fn one_tetrahedron_seen_along_its_edge() {
    let m = mesh(
        &[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        &[[0, 1, 2, 3]],
        &[0.0, 0.0, 0.0, 1.0],
    );
    let f = function(&m);
    let down = |x: f64, y: f64| ray([x, y, 2.0], [0.0, 0.0, -1.0]);
    use Multiplicity::Simple;
    // z = c, the cell from z = 0 to 1 - x - y; c as it is, not rounded
    let at = |x, y, c: f64| roots(&f, c, &down(x, y));
    let hit = at(0.25, 0.25, 0.2);
    assert!(hit.len() == 1 && (hit[0].0 - 1.8).abs() < 1e-15 && hit[0].1 == Simple);
    assert_eq!(at(0.25, 0.25, 0.5), [(1.5, Simple)]);
    assert_eq!(at(0.25, 0.25, 0.0), [(2.0, Simple)]);
    assert_eq!(at(0.25, 0.25, 0.5f64.next_up()), []);
    // along the edge of three corners, along faces, through a corner
    assert_eq!(at(0.0, 0.0, 0.25), [(1.75, Simple)]);
    assert_eq!(at(0.0, 0.5, 0.25), [(1.75, Simple)]);
    assert_eq!(at(0.0, 0.0, 1.0), [(1.0, Simple)]);
    assert_eq!(at(1.0, 0.0, 0.0), [(2.0, Simple)]);
    assert_eq!(at(1.0, 0.0, 0.25), []);
    assert_eq!(at(0.5, 0.5, 0.0), [(2.0, Simple)]);
    assert_eq!(at(-1e-300, 0.25, 0.2), []);
    // across the top, touching the corner only
    let over = ray([-1.0, 0.0, 1.0], [1.0, 0.0, 0.0]);
    assert_eq!(roots(&f, 1.0, &over), [(1.0, Simple)]);
    assert!(Oracle::new(f.clone(), 1.0).undecidable(&over));
    assert!(!Oracle::new(f.clone(), 0.2).undecidable(&down(0.25, 0.25)));
    // within the base s = 0 on a stretch, from one edge to the other
    let base = ray([-1.0, 0.25, 0.0], [2.0, 0.0, 0.0]);
    let o = Oracle::new(f.clone(), 0.0);
    assert_eq!(roots(&f, 0.0, &base), [(0.5, Multiplicity::Interval)]);
    assert_eq!(o.all(&base).roots[0].interval_end, Some(0.875));
    assert!(o.undecidable(&base) && roots(&f, 1e-9, &base).is_empty());
    // from inside, from the surface, from behind it
    assert_eq!(roots(&f, 0.25, &ray([0.1, 0.1, 0.5], [0.0, 0.0, -1.0])), [(0.25, Simple)]);
    assert_eq!(roots(&f, 0.25, &ray([0.1, 0.1, 0.25], [0.0, 0.0, -1.0])), [(0.0, Simple)]);
    assert_eq!(roots(&f, 0.25, &ray([0.1, 0.1, 0.125], [0.0, 0.0, -1.0])), []);
}

#[test]
fn linear_fields_have_one_root_wherever_the_ray_goes() {
    let m = lattice(5, |p| p.x + 2.0 * p.y - p.z);
    let f = function(&m);
    let mut seed = 5;
    for n in 0..300 {
        let mut to = DVec3::new(random(&mut seed), random(&mut seed), random(&mut seed)) * 4.0;
        let mut from = DVec3::new(random(&mut seed), random(&mut seed), random(&mut seed)) * 16.0 - 6.0;
        if n % 3 == 0 {
            // corners of cells, edges and faces
            to = to.round();
            from = from.round();
        }
        if n % 5 == 0 {
            from.x = to.x.round();
        }
        let direction = to - from;
        if direction == DVec3::ZERO {
            continue;
        }
        let c = to.x + 2.0 * to.y - to.z;
        let r = Ray { origin: from, direction };
        let slope = direction.x + 2.0 * direction.y - direction.z;
        let got = roots(&f, c, &r);
        if slope.abs() < 1e-9 {
            assert!(
                got.iter().all(|g| g.1 == Multiplicity::Interval) && got.len() <= 1,
                "{r:?} {got:?}"
            );
            continue;
        }
        assert_eq!(got.len(), 1, "{r:?}");
        assert_eq!(got[0].1, Multiplicity::Simple);
        assert!((got[0].0 - 1.0).abs() < 1e-12, "{r:?} {got:?}");
        let Answer::Hit(hit) = Oracle::new(f.clone(), c).first(&r) else {
            panic!("{r:?}")
        };
        assert!((hit.slope - slope).abs() < 1e-12 * direction.length());
    }
}

#[test]
fn stages_agree_on_noise() {
    let mut seed = 17;
    let m = lattice(6, |_| 0.0);
    let values: Vec<f32> = m.values.iter().map(|_| random(&mut seed) as f32).collect();
    // corners moved, so that nothing is aligned; still no cell turned over
    let points: Vec<DVec3> = m
        .points
        .iter()
        .map(|p| *p + 0.1 * DVec3::new(random(&mut seed), random(&mut seed), random(&mut seed)))
        .collect();
    let f = function(&TetMesh::new(points.into(), m.cells.clone(), values.into()).unwrap());
    let (mut total, mut most) = (0, 0);
    for _ in 0..150 {
        let mut p = || DVec3::new(random(&mut seed), random(&mut seed), random(&mut seed));
        let (from, to) = (p() * 20.0 - 8.0, p() * 5.0);
        let r = Ray {
            origin: from,
            direction: to - from,
        };
        let got = roots(&f, 0.5, &r);
        for (t, _) in &got {
            let v = f.value(r.at(*t));
            assert!((v - 0.5).abs() < 1e-9 || v.is_nan(), "{v}");
        }
        total += got.len();
        most = most.max(got.len());
        // nothing is aligned: no ray needs integers
        assert!(Oracle::new(f.clone(), 0.5).all(&r).decided < Decided::Exact);
    }
    assert!(total > 300 && most > 5, "{total} {most}");
}

#[test]
fn gaps_hold_no_root_and_later_parts_are_found() {
    // s = x on [0, 8] without the cells from x = 2 to 5
    let m = lattice(9, |p| p.x);
    let kept: Vec<[u32; 4]> = m
        .cells
        .iter()
        .copied()
        .filter(|c| {
            let x = c.iter().map(|&i| m.points[i as usize].x).sum::<f64>() / 4.0;
            !(2.0..5.0).contains(&x)
        })
        .collect();
    let m = TetMesh::new(m.points.clone(), kept.into(), m.values.clone()).unwrap();
    let f = function(&m);
    let r = ray([-1.0, 3.3, 4.7], [1.0, 0.0, 0.0]);
    for c in [0.5, 2.0, 5.0, 7.5, 8.0] {
        assert_eq!(roots(&f, c, &r), [(1.0 + c, Multiplicity::Simple)], "{c}");
    }
    for c in [2.0f64.next_up(), 3.5, 5.0f64.next_down()] {
        assert_eq!(roots(&f, c, &r), [], "{c}");
        assert!(f.value(DVec3::new(c, 3.3, 4.7)).is_nan() || !(2.1..=4.9).contains(&c));
    }
    // where the mesh ends on the surface a small error loses it; farther in not
    let o = |c: f64| Oracle::new(f.clone(), c).undecidable(&r);
    assert!(o(2.0) && o(5.0) && o(2.0 - 1e-8) && !o(1.99) && !o(3.5) && !o(7.5));
    // all hits of s = |x - 4| in one line, on both sides of the gap
    let bent: Vec<f32> = m.points.iter().map(|p| (p.x - 4.0).abs() as f32).collect();
    let f = function(&TetMesh::new(m.points.clone(), m.cells.clone(), bent.into()).unwrap());
    let got = roots(&f, 2.5, &r);
    assert_eq!(got, [(2.5, Multiplicity::Simple), (7.5, Multiplicity::Simple)]);
}

#[test]
fn kinks_that_touch_are_even_and_plateaus_are_one_stretch() {
    let m = lattice(5, |p| (p.x - 2.0).abs());
    let f = function(&m);
    let across = ray([-1.0, 1.3, 2.6], [1.0, 0.125, -0.0625]);
    assert_eq!(roots(&f, 0.0, &across), [(3.0, Multiplicity::Even(2))]);
    assert!(Oracle::new(f.clone(), 0.0).undecidable(&across));
    assert!(Oracle::new(f.clone(), 1e-8).undecidable(&across));
    assert!(!Oracle::new(f.clone(), 0.25).undecidable(&across));
    // through a corner and along an edge
    for r in [ray([-1.0, 2.0, 3.0], [1.0, 0.0, 0.0]), ray([-1.0, -1.0, -1.0], [1.0; 3])] {
        assert_eq!(roots(&f, 0.0, &r), [(3.0, Multiplicity::Even(2))]);
    }
    let flat = function(&lattice(5, |p| (p.x - 3.0).max(1.0 - p.x).max(0.0)));
    for r in [
        across,
        ray([-1.0, 2.0, 3.0], [1.0, 0.0, 0.0]),
        ray([-1.0, 2.5, 3.0], [1.0, 0.0, 0.0]),
    ] {
        let all = Oracle::new(flat.clone(), 0.0).all(&r).roots;
        assert_eq!(roots(&flat, 0.0, &r), [(2.0, Multiplicity::Interval)]);
        assert_eq!(all[0].interval_end, Some(4.0));
        assert_eq!(roots(&flat, 0.5, &r).len(), 2);
    }
}

#[test]
fn separate_points_flat_cells_and_folds() {
    // Two cells that share a face by coordinates only, one flat cell, and a copy of the first with other values.
    let p = [
        [0.0; 3],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
        [0.0; 3],
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, -1.0],
    ];
    let s = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0];
    let f = function(&mesh(&p, &[[0, 1, 2, 3], [4, 5, 6, 7], [0, 1, 2, 5]], &s));
    let down = ray([0.25, 0.25, 2.0], [0.0, 0.0, -1.0]);
    assert_eq!(roots(&f, 0.0, &down), [(2.0, Multiplicity::Simple)]);
    assert!(!Oracle::new(f, 0.0).undecidable(&down));
    let mut q = p.to_vec();
    q.extend([[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
    let mut s = s.to_vec();
    s.extend([0.5, 0.5, 0.5, 0.0]);
    let f = function(&mesh(&q, &[[0, 1, 2, 3], [8, 9, 10, 11]], &s));
    assert_eq!(
        roots(&f, 0.375, &down),
        [(1.625, Multiplicity::Simple), (1.75, Multiplicity::Simple)]
    );
    // where both have the value at the same t it is one root: z = 0.5 - 0.5 z
    let third = roots(&f, 0.25, &down);
    assert_eq!(third.len(), 2);
    let fold = function(&mesh(&q, &[[0, 1, 2, 3], [8, 9, 10, 11]], &{
        let mut s = s.clone();
        s[8..].copy_from_slice(&[0.5, 0.5, 0.5, -0.5]);
        s
    }));
    assert_eq!(roots(&fold, 0.25, &down).len(), 1);
}

/// The frame that says what the truth says.
fn perfect(f: &Arc<dyn Function>, truth: &Truth, v: &View) -> Frame {
    let mut frame = Frame::new(v.width, v.height, 1, Channels::T | Channels::NORMAL | Channels::SURFACE);
    for (i, p) in truth.pixels.iter().enumerate().filter(|(_, p)| p.is_hit()) {
        let point = v.ray(i % v.width, i / v.width).at(p.t());
        frame.set_hit(
            0,
            i,
            &Hit {
                t: p.t(),
                point,
                normal: f.gradient(point).normalize_or_zero().as_vec3().to_array(),
                surface: p.surface,
                t_error: 0.0,
            },
        );
    }
    frame
}

#[test]
fn frames_are_checked_against_the_truth_of_a_mesh() {
    let m = lattice(9, |p| (p - 4.0).length_squared());
    let f = function(&m);
    let v = View::perspective(DVec3::new(12.0, 9.0, 10.0), DVec3::splat(4.0), DVec3::Z, 40.0, 48, 36);
    let surfaces = [Surface::isovalue(9.3, 0), Surface::isovalue(4.0, 1)];
    let truth = Truth::compute(&f, &surfaces, &v, &Stop::default()).unwrap();
    assert!(
        truth.hits() > 500 && truth.undecidable() == 0,
        "{} {}",
        truth.hits(),
        truth.undecidable()
    );
    let frame = perfect(&f, &truth, &v);
    let all = check(&frame, &truth, &f, &surfaces, &v).unwrap();
    assert_eq!((all.missed, all.false_hits, all.wrong_root, all.wrong_surface), (0, 0, 0, 0));
    assert_eq!(all.t_error_voxels.max, 0.0);
    assert!(all.normal_error_deg.max < 1e-3, "{:?}", all.normal_error_deg);
    // one hit taken away, one moved to the back of the sphere
    let mut frame = frame;
    let hits: Vec<usize> = (0..truth.pixels.len())
        .filter(|&i| truth.pixels[i].surface == 0 && v.ray(i % 48, i / 48).direction.is_finite())
        .collect();
    let (a, b) = (hits[0], hits[hits.len() / 2]);
    frame.t[a] = f64::INFINITY;
    let r = v.ray(b % 48, b / 48);
    let back = Oracle::new(f.clone(), 9.3).all(&r).roots;
    assert!(back.len() > 1);
    frame.t[b] = back[1].t();
    let all = check(&frame, &truth, &f, &surfaces, &v).unwrap();
    assert_eq!((all.class[a], all.class[b]), (Class::Missed, Class::WrongRoot));
    // a clipping plane through the middle takes the front away
    let eye = (DVec3::new(12.0, 9.0, 10.0) - 4.0).normalize();
    let clip = ClipPlane {
        normal: eye,
        distance: eye.dot(DVec3::splat(4.0)),
        cap: false,
    };
    let cut = Oracle::new(f, 9.3).with_clips(&[clip]);
    let got = cut.all(&r).roots;
    assert!(got.len() == back.len() / 2 && got.iter().all(|x| eye.dot(r.at(x.t())) <= clip.distance + 1e-9));
}
