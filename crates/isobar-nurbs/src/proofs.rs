//! Frames held against the oracle: real files, hard cases, random rays. No claim may be refuted, and no decidable pixel be wrong.

use crate::NURBS_CPU;
use crate::tests::{annulus, element, hexes, request};
use isobar_core::{DVec3, Data, Frame, Method, Ray, Stage, Stop, Surface, SurfaceKind, View};
use isobar_oracle::{Check, Truth, check};
use std::path::Path;
use std::sync::Arc;

/// Draws a view and checks it.
pub(crate) fn checked(data: &Arc<Data>, surfaces: &[Surface], view: &View) -> (Check, Frame) {
    let mut r = NURBS_CPU.open(&request(1)).unwrap();
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
    let (c, frame) = checked(data, surfaces, view);
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

/// Rays through the bounds from about them, and some from inside.
fn rays(data: &Data, n: usize, seed: u64) -> View {
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
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data");
    if !folder.is_dir() {
        use std::io::Write;
        let _ = writeln!(
            std::io::stdout(),
            "\nSKIPPED: isobar-nurbs files_agree_with_the_oracle: no ../shared/data"
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
        assert!(
            check.unclaimed <= 8 + check.undecidable,
            "{file}: {} unclaimed, {} undecidable",
            check.unclaimed,
            check.undecidable
        );
    }
}
