//! Frames held against the oracle: real files, hard cases, random rays. No claim may be refuted, and no decidable pixel be wrong.

use crate::NURBS_CPU;
use crate::tests::{annulus, element, hexes, request};
use isobar_core::{
    Camera, Claim, DMat3, DVec3, Data, Frame, Grid, Knobs, Method, Ray, Samples, Stage, Stop, Surface, SurfaceKind, View,
};
use isobar_oracle::{Check, Multiplicity, Oracle, Truth, check};
use rayon::prelude::*;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Draws a view and checks it.
pub(crate) fn checked(data: &Arc<Data>, surfaces: &[Surface], view: &View, knobs: Knobs) -> (Check, Frame) {
    let mut r = NURBS_CPU.open(&isobar_core::Request { knobs, ..request(1) }).unwrap();
    r.set_data(data).unwrap();
    r.set_surfaces(surfaces).unwrap();
    r.set_view(view).unwrap();
    r.render(&Stop::default()).unwrap();
    let mut frame = Frame::default();
    r.read(&mut frame).unwrap();
    let f = r.reconstruction(Stage::Stored).unwrap();
    let truth = Truth::compute(&f, surfaces, view, &Stop::default()).unwrap();
    (check(&frame, &truth, &f, surfaces, view).unwrap(), frame)
}

#[track_caller]
fn clean(name: &str, data: &Arc<Data>, surfaces: &[Surface], view: &View) -> Check {
    clean_with(name, data, surfaces, view, Knobs::default())
}

#[track_caller]
fn clean_with(name: &str, data: &Arc<Data>, surfaces: &[Surface], view: &View, knobs: Knobs) -> Check {
    let (c, frame) = checked(data, surfaces, view, knobs);
    assert!(
        c.is_clean(),
        "{name}: missed {}, false {}, wrong root {}, wrong surface {}, refuted {} at {:?}",
        c.missed,
        c.false_hits,
        c.wrong_root,
        c.wrong_surface,
        c.refuted,
        c.class
            .iter()
            .zip(&c.refuted_claims)
            .enumerate()
            .filter(|(_, (k, r))| (2..=5).contains(&(**k as u8)) || !r.is_empty())
            .take(4)
            .map(|(i, (k, r))| (
                i,
                *k,
                *r,
                frame.t[i],
                frame.t_error[i],
                view.ray(i % view.width, i / view.width)
            ))
            .collect::<Vec<_>>()
    );
    c
}

/// Numbers in [0, 1) from a seed.
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }

    fn point(&mut self, lo: DVec3, hi: DVec3) -> DVec3 {
        lo + (hi - lo) * DVec3::new(self.next(), self.next(), self.next())
    }
}

/// Rays of a view.
const BATCH: usize = 50_000;

/// Rays of a hard case: 10^6 under `cargo xtask test --full`.
fn many() -> usize {
    if std::env::var_os("ISOBAR_FULL").is_some_and(|v| v == "1") {
        1_000_000
    } else {
        100_000
    }
}

/// What became of the rays of a view, all hits against all certified roots.
#[derive(Debug, Default, Clone, Copy)]
struct Tally {
    roots: usize,
    /// Rays with a hit too many, too few, or farther than 1e-10 of t (and the certified bracket) from its root.
    wrong: usize,
    /// Rays of which a claim is not true, or that have no hit and neither EMPTY nor LIMIT.
    refuted: usize,
    /// Rays that neither this method (LIMIT) nor the oracle (a root that is not simple, or a part of the ray left open) decides.
    open: usize,
    /// Rays that only this method leaves open.
    limits: usize,
    /// Greatest |t - root| / t of the rest.
    worst: f64,
}

impl Tally {
    fn and(self, o: Self) -> Self {
        Self {
            roots: self.roots + o.roots,
            wrong: self.wrong + o.wrong,
            refuted: self.refuted + o.refuted,
            open: self.open + o.open,
            limits: self.limits + o.limits,
            worst: self.worst.max(o.worst),
        }
    }
}

/// Every hit of every ray against the oracle.
fn all_hits(data: &Arc<Data>, c: f64, view: &View) -> Tally {
    const LAYERS: usize = 16;
    let mut r = NURBS_CPU.open(&request(LAYERS)).unwrap();
    r.set_data(data).unwrap();
    r.set_surfaces(&[Surface::isovalue(c, 0)]).unwrap();
    r.set_view(view).unwrap();
    r.render(&Stop::default()).unwrap();
    let mut f = Frame::default();
    r.read(&mut f).unwrap();
    let oracle = Oracle::new(r.reconstruction(Stage::Stored).unwrap(), c);
    let n = view.pixels();
    let one = |i: usize| {
        let truth = oracle.all(&view.ray(i % view.width, i / view.width));
        let hits: Vec<f64> = (0..usize::from(f.hits[i]).min(LAYERS)).map(|l| f.t[l * n + i]).collect();
        let (claim, e) = (f.claim[i], f.t_error[i]);
        let decided = truth.unresolved.is_empty();
        let first = truth.roots.first();
        let exists = |t: f64| truth.roots.iter().any(|r| r.lo <= t + e && t - e <= r.hi);
        let refuted = claim.contains(Claim::EMPTY) && first.is_some()
            || claim.contains(Claim::EXISTS) && decided && !exists(hits[0])
            || claim.contains(Claim::FIRST) && first.is_some_and(|r| r.hi < hits[0] - e)
            || hits.is_empty() && !claim.intersects(Claim::EMPTY | Claim::LIMIT);
        let simple = decided && truth.roots.iter().all(|r| r.multiplicity == Multiplicity::Simple);
        let mut tally = Tally {
            roots: truth.roots.len(),
            refuted: usize::from(refuted),
            ..Tally::default()
        };
        match (simple, claim.contains(Claim::LIMIT)) {
            (true, false) => {
                let off = hits
                    .iter()
                    .zip(&truth.roots)
                    .map(|(t, r)| r.distance(*t) / t.abs().max(1e-3))
                    .fold(0.0, f64::max);
                tally.wrong = usize::from(hits.len() != truth.roots.len() || off > 1e-10);
                tally.worst = off;
            }
            (true, true) => tally.limits = 1,
            _ => tally.open = 1,
        }
        tally
    };
    (0..n).into_par_iter().map(one).reduce(Tally::default, Tally::and)
}

/// Rays through the bounds from about them, and some from inside.
pub(crate) fn rays(data: &Data, n: usize, seed: u64) -> View {
    let (lo, hi) = data.bounds();
    let mut random = Random(seed);
    let wide = (hi - lo).max_element();
    let rays: Vec<Ray> = (0..n)
        .map(|i| {
            let out = if i % 5 == 0 { 0.0 } else { wide };
            let from = random.point(lo - out, hi + out);
            let to = random.point(lo, hi);
            Ray {
                origin: from,
                direction: (to - from).normalize_or(DVec3::X),
            }
        })
        .collect();
    View::rays(rays)
}

#[test]
fn hard_elements_on_random_rays() {
    let folded = element(
        [2, 1, 1],
        |[u, v, w]| [4.0 * u * u - 3.0 * u, v + 0.1 * u, w],
        [1, 0, 0],
        &[0.0, 1.0],
    );
    let bent = element([2, 1, 1], |[u, v, w]| [u, v, 0.2 * w + u * (1.0 - u)], [0, 0, 1], &[0.0, 1.0]);
    let vanishing = element([2, 1, 1], |[u, v, w]| [u * u, v, w], [1, 0, 0], &[0.0, 1.0]);
    let collapsed = element([1, 1, 1], |[u, v, w]| [u, u * v, w], [0, 1, 0], &[0.0, 1.0]);
    let hump = element([1; 3], |u| u, [2, 0, 0], &[0.0, 1.5, 0.0]);
    let mut left = element(
        [1, 2, 1],
        |[u, v, w]| [-u + 0.2 * v * v, v, w + 0.1 * u * v],
        [2, 1, 1],
        &[0.0, 2.0, 0.1, 1.0, 0.3, 0.9, 0.5, 0.2, 0.8, 0.4, 1.3, 0.0],
    );
    left.points[3][3] = 2.5;
    left.points[8][3] = 0.2;
    let mut said = Vec::new();
    for (name, e, c) in [
        ("annulus", annulus(), 0.5),
        ("folded", folded, 0.25),
        ("bent", bent, 0.5),
        ("vanishing", vanishing, 0.01),
        ("collapsed", collapsed, 0.5),
        ("hump", hump, 0.7),
        ("left-handed", left, 0.6),
    ] {
        let data = hexes(vec![e]);
        let view = rays(&data, 2000, 7);
        let check = clean(name, &data, &[Surface::isovalue(c, 0)], &view);
        assert!(
            check.hits > 100 && check.unclaimed < 20 + check.undecidable,
            "{name}: {} hits, {} unclaimed",
            check.hits,
            check.unclaimed
        );
        let n = many();
        // A view has at most 65,536 rays.
        let views = (0..n / BATCH).map(|k| rays(&data, BATCH, 23 + k as u64));
        let tally = views.map(|v| all_hits(&data, c, &v)).fold(Tally::default(), Tally::and);
        said.push(format!("{name}: {tally:?}"));
        assert!(
            tally.roots > n / 50 && tally.wrong == 0 && tally.refuted == 0,
            "{name}: {tally:?}"
        );
        assert!(tally.limits + tally.open <= n / 10_000, "{name}: {tally:?}");
    }
    use std::io::Write;
    let _ = writeln!(std::io::stdout(), "{}", said.join("\n"));
}

/// Eyes in, on and beside elements: control points before, behind and in the plane of the eye, none of which is divided by.
#[test]
fn elements_across_the_plane_of_the_eye() {
    let mut curved = annulus();
    (curved.value_degree, curved.values) = ([1, 1, 1], (0..8).map(|i| f64::from(i * 5 % 7) / 7.0).collect());
    let data = hexes(vec![curved]);
    let mut hits = 0;
    for eye in [
        DVec3::new(1.0, 0.0, 0.0),
        DVec3::new(1.1, 0.9, 0.45),
        DVec3::new(0.0, 1.5, 0.25),
        DVec3::new(2.0, 2.0, 1.0),
        DVec3::new(0.4, 0.4, 0.5),
    ] {
        for target in [
            DVec3::new(0.2, 1.4, 0.6),
            DVec3::new(1.9, 0.3, 0.1),
            eye + DVec3::X,
            eye + DVec3::Y,
        ] {
            let perspective = View::perspective(eye, target, DVec3::Z, 110.0, 20, 20);
            let parallel = View {
                camera: Camera::Orthographic {
                    eye,
                    target,
                    up: DVec3::Z,
                    height: 1.3,
                },
                ..perspective.clone()
            };
            for view in [perspective, parallel] {
                let check = clean("across", &data, &[Surface::isovalue(0.45, 0)], &view);
                let tally = all_hits(&data, 0.45, &view);
                assert!(tally.wrong == 0 && tally.refuted == 0, "{eye} {target}: {tally:?}");
                hits += check.hits;
            }
        }
    }
    assert!(hits > 2000, "{hits}");
}

/// An attribute that jumps between two elements: the surface has a crack, and rays go through it.
#[test]
fn cracks_of_discontinuous_attributes_stay() {
    let left = element([1; 3], |u| u, [1, 1, 0], &[0.0, 0.3, 1.0, 1.3]);
    let right = element([1; 3], |[u, v, w]| [1.0 + u, v, w], [0, 1, 0], &[-0.1, 0.9]);
    let data = hexes(vec![left, right]);
    // At x = 1 the surface ends at y = 0.2 on the left and goes on at y = 0.6.
    let along = |y: f64| Ray {
        origin: DVec3::new(-1.0, y, 0.5),
        direction: DVec3::X,
    };
    let f = crate::tests::draw(
        &data,
        &[Surface::isovalue(0.5, 0)],
        &View::rays(vec![along(0.4), along(0.55), along(0.1)]),
        2,
    );
    assert_eq!(f.hits[..3], [1, 0, 0], "{:?}", f.t);
    assert!((f.t[0] - 4.0 / 3.0).abs() < 1e-13 && f.claim[1..3].iter().all(|c| c.contains(Claim::EMPTY)));
    let view = rays(&data, 3000, 19);
    assert!(clean("cracks", &data, &[Surface::isovalue(0.5, 0)], &view).hits > 500);
    let tally = all_hits(&data, 0.5, &view);
    assert!(tally.wrong == 0 && tally.refuted == 0, "{tally:?}");
}

/// A grid of noise, its axes the world's, mirrored, or oblique.
pub(crate) fn noise(dims: [usize; 3], direction: DMat3) -> Grid {
    let mut random = Random(11);
    let samples: Vec<u8> = (0..dims.iter().product()).map(|_| (random.next() * 256.0) as u8).collect();
    let (spacing, origin) = (DVec3::new(0.7, 1.1, 1.3), DVec3::new(-2.0, 40.0, 3.0));
    Grid::new(dims, spacing, origin, direction, Samples::U8(samples.into())).unwrap()
}

#[test]
fn grids_agree_with_the_oracle_cell_by_cell() {
    let oblique = DMat3::from_cols(
        DVec3::new(0.9, 0.3, 0.1).normalize(),
        DVec3::new(-0.2, 1.0, 0.4).normalize(),
        DVec3::new(0.1, -0.3, 0.8).normalize(),
    );
    let mirrored = DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0));
    let (mut hits, mut unclaimed) = (0, 0);
    for (direction, name) in [(DMat3::IDENTITY, "straight"), (mirrored, "mirrored"), (oblique, "oblique")] {
        let data = Arc::new(Data::Grid(noise([9, 6, 7], direction)));
        for reconstruction in [
            "trilinear",
            "quadratic",
            "quadratic-interpolating",
            "cubic",
            "cubic-interpolating",
        ] {
            let knobs = || Knobs::default().with("reconstruction", reconstruction);
            let surfaces = [Surface::isovalue(127.3, 0), Surface::isovalue(160.0, 1)];
            for view in [rays(&data, 600, 5), View::fit(data.bounds(), 40.0, 24, 18)] {
                let c = clean_with(&format!("{name} {reconstruction}"), &data, &surfaces, &view, knobs());
                hits += c.hits;
                unclaimed += c.unclaimed.saturating_sub(c.undecidable);
            }
        }
    }
    assert!(hits > 9000 && unclaimed <= 20, "{hits} hits, {unclaimed} unclaimed");
}

/// Rays along the planes, edges and lines of samples, at an isovalue that samples have.
#[test]
fn rays_along_the_faces_of_cells_lose_nothing() {
    let mut grid = noise([6, 6, 6], DMat3::IDENTITY);
    (grid.spacing, grid.origin) = (DVec3::ONE, DVec3::ZERO);
    let c = grid.sample([2, 3, 3]);
    let data = Arc::new(Data::Grid(grid));
    let mut list = Vec::new();
    for n in 0..36 {
        let (i, j) = (f64::from(n % 6), f64::from(n / 6));
        for (o, d) in [
            (DVec3::new(i, j, -2.0), DVec3::Z),
            (DVec3::new(i + 0.5, j, -2.0), DVec3::Z),
            (DVec3::new(-1.0, i, j), DVec3::X),
            (DVec3::new(i, -1.0, -1.0 + j), DVec3::new(0.0, 1.0, 1.0)),
        ] {
            list.push(Ray { origin: o, direction: d });
        }
    }
    for reconstruction in ["trilinear", "quadratic", "cubic"] {
        let knobs = Knobs::default().with("reconstruction", reconstruction);
        let c = clean_with(
            reconstruction,
            &data,
            &[Surface::isovalue(c, 0)],
            &View::rays(list.clone()),
            knobs,
        );
        assert!(c.hits > 80, "{reconstruction}: {}", c.hits);
    }
}

/// A slope that grows a thousand million times at a face, and a crossing within rounding of it: one hit, wherever the rays start.
#[test]
fn a_kink_at_a_face_is_hit_once() {
    let samples: Vec<f32> = (0..12).map(|i| [-1e-6, 0.0, 1e3][i % 3]).collect();
    let grid = Grid::new(
        [3, 2, 2],
        DVec3::ONE,
        DVec3::ZERO,
        DMat3::IDENTITY,
        Samples::F32(samples.into()),
    )
    .unwrap();
    let data = Arc::new(Data::Grid(grid));
    let mut random = Random(3);
    let rays: Vec<Ray> = (0..200)
        .map(|i| {
            let start = DVec3::new(-3.0 * random.next(), 0.2 + 0.6 * random.next(), 0.1 + 0.8 * random.next());
            let (origin, direction) = (start, DVec3::X * (1.0 + random.next()));
            let back = Ray {
                origin: DVec3::new(2.5, start.y, start.z),
                direction: -direction,
            };
            if i % 2 == 0 { Ray { origin, direction } } else { back }
        })
        .collect();
    let view = View::rays(rays);
    for e in [1e-21, 1e-19, 1e-18, 1e-17, 1e-15] {
        for c in [-e, e] {
            let surface = Surface {
                opacity: 0.5,
                ..Surface::isovalue(c, 0)
            };
            let (check, frame) = checked(&data, &[surface], &view, Knobs::default());
            assert!(check.is_clean(), "{c}: {check:?}");
            assert!(frame.hits.iter().all(|&h| h == 1), "{c}: {:?}", frame.hits);
        }
    }
}

/// A root that touches at a face is two crossings, one from each cell, between two others (hardcases C4): none of the three is lost, whichever cell's comes first.
#[test]
fn a_touching_root_at_a_face_hides_no_other() {
    let samples: Vec<f32> = (0..20).map(|i| [1.0, -1.0, 0.0, -1.0, 1.0][i % 5]).collect();
    let grid = Grid::new(
        [5, 2, 2],
        DVec3::ONE,
        DVec3::ZERO,
        DMat3::IDENTITY,
        Samples::F32(samples.into()),
    )
    .unwrap();
    let rays = [0.0, 0.37, 0.5, 1.0].map(|y| Ray {
        origin: DVec3::new(-1.25, y, 0.3),
        direction: DVec3::X,
    });
    let (_, frame) = checked(
        &Arc::new(Data::Grid(grid)),
        &[Surface::isovalue(0.0, 0)],
        &View::rays(rays.to_vec()),
        Knobs::default(),
    );
    assert_eq!(frame.hits, [3; 4], "{:?}", frame.t);
}

/// The same frames as from elements, all hits, from inside too; COVERED as well.
#[test]
fn cells_and_elements_agree() {
    for (kind, name) in [
        (isobar_fields::Kind::Cubic, "cubic"),
        (isobar_fields::Kind::Quadratic, "quadratic"),
    ] {
        agree(kind, name);
    }
}

fn agree(kind: isobar_fields::Kind, name: &str) {
    let grid = noise([7, 8, 6], DMat3::IDENTITY);
    let elements = Arc::new(Data::Hexes(
        isobar_fields::spline_to_hexes(&grid, kind, Stage::Stored).unwrap(),
    ));
    let data = Arc::new(Data::Grid(grid));
    let (lo, hi) = data.bounds();
    let parallel = View {
        camera: Camera::Orthographic {
            eye: lo - (hi - lo) * 0.7,
            target: (lo + hi) * 0.5,
            up: DVec3::Z,
            height: (hi - lo).length(),
        },
        ..View::bench(30, 20)
    };
    let inside = View::perspective(lo + (hi - lo) * 0.4, hi, DVec3::Z, 90.0, 30, 20);
    for view in [parallel, inside, View::fit((lo, hi), 40.0, 30, 20)] {
        let draw = |data: &Arc<Data>| {
            let mut q = request(6);
            q.knobs.set("reconstruction", name);
            q.sampling = isobar_core::Sampling::PixelFrustum;
            let mut r = NURBS_CPU.open(&q).unwrap();
            r.set_data(data).unwrap();
            r.set_surfaces(&[Surface {
                opacity: 0.2,
                ..Surface::isovalue(127.3, 0)
            }])
            .unwrap();
            r.set_view(&view).unwrap();
            r.render(&Stop::default()).unwrap();
            let mut f = Frame::default();
            r.read(&mut f).unwrap();
            f
        };
        let (a, b) = (draw(&data), draw(&elements));
        let (mut count, mut limits) = (0, 0);
        for i in 0..a.hits.len() {
            if a.claim[i].contains(Claim::LIMIT) || b.claim[i].contains(Claim::LIMIT) {
                limits += 1;
                continue;
            }
            assert_eq!(a.hits[i], b.hits[i], "pixel {i}");
            assert_eq!(a.claim[i], b.claim[i], "pixel {i}");
            for l in 0..usize::from(a.hits[i]).min(6) {
                let at = l * a.hits.len() + i;
                assert!((a.t[at] - b.t[at]).abs() < 1e-9, "pixel {i}: {} {}", a.t[at], b.t[at]);
                let cosine: f32 = (0..3).map(|k| a.normal[at][k] * b.normal[at][k]).sum();
                assert!(cosine > 0.9999);
                count += 1;
            }
        }
        assert!(count > 250 && limits <= 4, "{name}: {count} hits, {limits} pixels undecided");
        let covered = |f: &Frame| f.claim.iter().filter(|c| c.contains(Claim::COVERED)).count();
        assert!(covered(&a) > 0 || covered(&b) == 0, "{name}");
    }
}

#[test]
fn parameters_and_boundaries() {
    let data = hexes(vec![annulus()]);
    let view = rays(&data, 1500, 3);
    for kind in [
        SurfaceKind::Parameter { axis: 0, value: 0.3 },
        SurfaceKind::Parameter { axis: 2, value: 1.0 },
        SurfaceKind::Boundary,
    ] {
        let s = Surface {
            kind,
            ..Surface::isovalue(0.0, 0)
        };
        // The oracle of frames is one of isovalues; what is on the surface can be told from the point.
        let f = crate::tests::draw(&data, &[s], &view, 4);
        let mut count = 0;
        for i in (0..f.t.len()).filter(|&i| f.t[i].is_finite()) {
            let p = f.point[i];
            let r = p.truncate().length();
            let off = match kind {
                SurfaceKind::Parameter { axis: 2, .. } => (p.z - 1.0).abs(),
                SurfaceKind::Parameter { .. } => {
                    // All points of one u lie on a half plane through the axis.
                    let w = [0.49, 0.42 * std::f64::consts::FRAC_1_SQRT_2, 0.09];
                    (p.y * (w[0] + w[1]) - p.x * (w[1] + w[2])).abs()
                }
                _ => [p.x, p.y, p.z, p.z - 1.0, r - 1.0, r - 2.0]
                    .iter()
                    .fold(1.0, |m, v| v.abs().min(m)),
            };
            assert!(off < 1e-12 && r > 1.0 - 1e-12 && r < 2.0 + 1e-12, "{kind:?} {p}");
            count += 1;
        }
        assert!(count > 100, "{kind:?}: {count}");
        if kind == SurfaceKind::Boundary {
            // A closed surface: an even number of hits from outside.
            let inside = |p: DVec3| p.min_element() >= 0.0 && p.z <= 1.0 && (1.0..=2.0).contains(&p.truncate().length());
            let odd = (0..view.pixels())
                .filter(|&i| !inside(view.ray(i, 0).origin) && f.hits[i] % 2 == 1)
                .count();
            assert!(odd <= 2, "{odd} rays with an odd number of hits");
        }
    }
}

#[test]
fn files_agree_with_the_oracle() {
    let folder = std::env::var_os("ISOBAR_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"),
        PathBuf::from,
    );
    if !folder.join("MANIFEST.tsv").is_file() {
        use std::io::Write;
        let _ = writeln!(
            std::io::stdout(),
            "\nSKIPPED: isobar-nurbs files_agree_with_the_oracle: no MANIFEST.tsv in {} (set ISOBAR_DATA)",
            folder.display()
        );
        return;
    }
    for (file, c) in [
        ("nurbs/horseshoe_iga.json", 0.2),
        ("nurbs/gshaped_iga.json", 0.2),
        ("nurbs/pipe_nurbs_iga.json", 0.15),
        ("nurbs/twisted_pipe_mp_iga.json", -0.2),
        ("nurbs/horseshoe.xml", 1.3),
        ("highorder/laghos_q2.vtu", 2.0),
        ("highorder/toroid_hex_p4.vtu", 0.3),
        ("highorder/hex_3x3x3_o4.vtk", 1.2),
    ] {
        let data = Arc::new(
            isobar_io::load(&folder.join(file), &isobar_io::Options::default())
                .unwrap()
                .data,
        );
        let view = View::fit(data.bounds(), 40.0, 48, 36);
        let check = clean(file, &data, &[Surface::isovalue(c, 0)], &view);
        assert!(check.hits > 10, "{file}: {}", check.hits);
        let tally = all_hits(&data, c, &view);
        assert!(
            tally.wrong == 0 && tally.refuted == 0 && tally.limits <= 8,
            "{file}: {tally:?}"
        );
        assert!(
            check.unclaimed <= 8 + check.undecidable,
            "{file}: {} unclaimed, {} undecidable",
            check.unclaimed,
            check.undecidable
        );
    }
}
