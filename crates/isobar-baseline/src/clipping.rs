//! Clipping planes, through all rulers.

use crate::testing::{draw, isovalues, rays, request, sampled};
use isobar_core::{ClipPlane, DVec3, Frame, Knobs, Method, View};

fn plane(normal: DVec3, distance: f64) -> ClipPlane {
    ClipPlane {
        normal,
        distance,
        cap: false,
    }
}

/// march/gpu only where there is an adapter.
fn rulers(name: &str) -> Vec<&'static dyn Method> {
    #[allow(unused_mut, reason = "the list grows with the feature gpu")]
    let mut all: Vec<&'static dyn Method> = vec![&crate::MARCH_CPU, &crate::MC_CPU];
    #[cfg(feature = "gpu")]
    if isobar_gpu::test_adapter(name).is_some() {
        all.push(&crate::MARCH_GPU);
    }
    let _ = name;
    all
}

/// A linear field is its own reconstruction and its own mesh: where its plane lies in what is kept, and nowhere else, it is hit.
#[test]
fn a_plane_is_cut_where_it_should_be() {
    let normal = DVec3::new(0.5, -0.25, 1.0);
    let data = sampled(25, |x| normal.dot(x));
    let rays = rays(3, 600, 12.0);
    let mut view = View::rays(rays.clone());
    view.clips = vec![plane(DVec3::new(2.0, 0.0, 0.0), 3.0), plane(DVec3::new(-0.3, 0.1, -1.0), 5.0)];
    for m in rulers("a_plane_is_cut_where_it_should_be") {
        let f = draw(m, &data, &isovalues(&[0.375]), &view, &request(Knobs::default()));
        let (mut seen, mut cut) = (0, 0);
        for (i, r) in rays.iter().enumerate() {
            let t = (0.375 - normal.dot(r.origin)) / normal.dot(r.direction);
            if t < 0.1 || r.at(t).abs().max_element() > 11.9 {
                continue;
            }
            let out = view.clips.iter().map(|c| c.normal.dot(r.at(t)) - c.distance);
            let out = out.fold(f64::NEG_INFINITY, f64::max);
            if out < -1e-2 {
                assert!((f.t[i] - t).abs() < 4e-3, "{}: {} for {t}", m.info().id, f.t[i]);
                seen += 1;
            } else if out > 1e-2 {
                assert_eq!(f.t[i], f64::INFINITY, "{}", m.info().id);
                cut += 1;
            }
        }
        assert!(seen > 80 && cut > 50, "{seen} seen, {cut} cut");
    }
}

/// All layers of a clipped frame are the layers of the open one that are kept; nothing else changes.
#[test]
fn layers_are_those_that_are_kept() {
    let data = sampled(21, |x| (0.9 * x.x).sin() + (0.8 * x.y).cos() * (0.7 * x.z).sin());
    let open = View::fit(data.bounds(), 35.0, 40, 30);
    let mut cut = open.clone();
    cut.clips = vec![plane(DVec3::new(1.0, 0.2, 0.1), 1.3), plane(DVec3::new(0.0, 0.0, -1.0), 4.0)];
    for m in rulers("layers_are_those_that_are_kept") {
        let knobs = match m.info().id {
            "mc/cpu" => Knobs::default(),
            // Small steps: samples begin at the plane, so a pair of roots in one step may be found in one frame only.
            _ => Knobs::default().with("step", 0.05),
        };
        let r = isobar_core::Request {
            layers: 12,
            ..request(knobs)
        };
        let surfaces = isovalues(&[0.3, -0.1]);
        let layers = |f: &Frame, i: usize| -> Vec<(f64, u8)> {
            let n = f.width * f.height;
            (0..12)
                .map(|l| (f.t[l * n + i], f.surface[l * n + i]))
                .take_while(|h| h.0.is_finite())
                .collect()
        };
        let (a, b) = (draw(m, &data, &surfaces, &open, &r), draw(m, &data, &surfaces, &cut, &r));
        let (mut same, mut doubtful) = (0, 0);
        for i in 0..open.pixels() {
            let ray = open.ray(i % 40, i / 40);
            let out = |t: f64| {
                cut.clips
                    .iter()
                    .map(|c| c.normal.dot(ray.at(t)) - c.distance)
                    .fold(f64::NEG_INFINITY, f64::max)
            };
            if layers(&a, i).iter().any(|h| out(h.0).abs() < 1e-2) {
                doubtful += 1;
                continue;
            }
            let want: Vec<_> = layers(&a, i).into_iter().filter(|h| out(h.0) < 0.0).collect();
            let got = layers(&b, i);
            let equal = want.len() == got.len() && want.iter().zip(&got).all(|(w, g)| w.1 == g.1 && (w.0 - g.0).abs() < 4e-3);
            if equal {
                same += 1;
            } else {
                doubtful += 1;
            }
        }
        assert!(
            same > 1000 && doubtful < 60,
            "{}: {same} same, {doubtful} doubtful",
            m.info().id
        );
    }
}
