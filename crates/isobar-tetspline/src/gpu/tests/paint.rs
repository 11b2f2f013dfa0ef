//! Texture, curves, and what lies behind the layers kept.

use super::*;
use crate::TETSPLINE_CPU;
use crate::gpu::TETSPLINE_GPU;
use isobar_core::{Camera, ClipPlane};

/// Pixels whose colours are further apart than `apart`, and those where both frames hit.
fn unlike(a: &Frame, b: &Frame, apart: f32) -> (usize, usize) {
    let far = |(x, y): &(&[f32; 4], &[f32; 4])| (0..4).any(|k| (x[k] - y[k]).abs() > apart);
    let hits = a.t.iter().zip(&b.t).take(a.rgba.len());
    (
        a.rgba.iter().zip(&b.rgba).filter(far).count(),
        hits.filter(|(x, y)| x.is_finite() && y.is_finite()).count(),
    )
}

/// Texture and curves are those of `tetspline/cpu`, and change nothing but the channel RGBA: for both kinds of rays, perspective and parallel, an oblique lattice, surfaces
/// seen through, closed cuts.
#[test]
fn painted_surfaces_are_those_of_the_cpu() {
    let Some(_gpu) = adapter("painted_surfaces_are_those_of_the_cpu") else {
        return;
    };
    let gyroid = synthetic("gyroid,n=14");
    let skew = Arc::new(Data::Grid(oblique(random_grid([9, 6, 12], 3))));
    let bench = View::bench(80, 60);
    let mut cut = bench.clone();
    cut.clips = vec![ClipPlane {
        normal: DVec3::new(1.0, 0.2, 0.1),
        distance: 0.2,
        cap: true,
    }];
    let fit = View::fit(skew.bounds(), 40.0, 80, 60);
    let parallel = View {
        camera: Camera::Orthographic {
            eye: DVec3::new(4.0, 3.0, 3.0),
            target: DVec3::ZERO,
            up: DVec3::Z,
            height: 3.0,
        },
        ..bench.clone()
    };
    let clear = Surface {
        opacity: 0.5,
        ..Surface::isovalue(0.2, 0)
    };
    let one = vec![Surface::isovalue(0.2, 0)];
    let cases = [
        ("bench", &gyroid, one.clone(), bench, "exact"),
        ("interpolated", &gyroid, one.clone(), View::bench(80, 60), "interpolated"),
        ("parallel", &gyroid, one.clone(), parallel, "exact"),
        ("skew", &skew, vec![Surface::isovalue(0.1, 0)], fit, "exact"),
        (
            "clear",
            &gyroid,
            vec![clear, Surface::isovalue(-0.4, 1)],
            View::bench(80, 60),
            "exact",
        ),
        ("cut", &gyroid, one, cut, "exact"),
    ];
    for (name, data, surfaces, view, rays) in cases {
        let on_gpu = |texture: &str, overlay: &str| {
            let knobs = Knobs::default()
                .with("rays", rays)
                .with("texture", texture)
                .with("overlay", overlay);
            draw(&mut *open(&TETSPLINE_GPU, &request(2, knobs)), data, &surfaces, &view)
        };
        let plain = on_gpu("plain", "none");
        let both = [("marble", "curves"), ("marble", "none"), ("plain", "curves")];
        // One alone is as well seen in the first case.
        for &(texture, overlay) in &both[..if name == "bench" { 3 } else { 1 }] {
            let got = on_gpu(texture, overlay);
            assert!(
                got.t == plain.t && got.normal == plain.normal && got.surface == plain.surface && got.hits == plain.hits,
                "{name} {texture} {overlay}"
            );
            let knobs = Knobs::default().with("texture", texture).with("overlay", overlay);
            let want = draw(&mut *open(&TETSPLINE_CPU, &request(2, knobs)), data, &surfaces, &view);
            let (apart, hits) = unlike(&got, &want, 4e-3);
            let (changed, _) = unlike(&got, &plain, 0.05);
            println!("{name} {texture} {overlay}: {apart} of {hits} pixels unlike, {changed} changed by the paint");
            // Where a curve ends is a matter of rounding; of interpolated rays the hits are off by up to 1e-3 voxels too.
            let most = if rays == "exact" { hits / 500 + 2 } else { hits / 50 };
            assert!(
                hits > 200 && apart <= most && changed > hits / 20,
                "{name} {texture} {overlay}"
            );
        }
    }
}

/// Layers that the frame has no room for are added up as they come: colours and counts are those of a frame with room for all, and of `tetspline/cpu`.
#[test]
fn what_lies_behind_the_layers_kept_counts() {
    let Some(_gpu) = adapter("what_lies_behind_the_layers_kept_counts") else {
        return;
    };
    let data = Arc::new(Data::Grid(random_grid([9, 8, 10], 1)));
    let mut surfaces: Vec<Surface> = (0..7)
        .map(|i| Surface::isovalue(f64::from(i) * 5000.0 - 15_000.5, i as usize))
        .collect();
    surfaces.iter_mut().for_each(|s| s.opacity = 0.15);
    surfaces[3].opacity = 1.0;
    let view = View::fit(data.bounds(), 40.0, 32, 24);
    for texture in ["plain", "marble"] {
        let knobs = Knobs::default().with("texture", texture);
        let of = |method: &dyn Method, layers: usize| {
            let mut r = open(method, &request(layers, knobs.clone()));
            let frame = draw(&mut *r, &data, &surfaces, &view);
            (frame, r.memory().view)
        };
        let ((few, small), (many, large)) = (of(&TETSPLINE_GPU, 1), of(&TETSPLINE_GPU, 40));
        let (want, _) = of(&TETSPLINE_CPU, 1);
        let most = many.hits.iter().max().copied().unwrap_or(0);
        assert!((8..40).contains(&most) && few.hits == many.hits, "{most} hits on a ray");
        assert!(few.t[..] == many.t[..32 * 24]);
        let (apart, hits) = unlike(&few, &many, 1e-5);
        assert!(apart == 0 && hits > 200, "{apart} of {hits}");
        let (apart, _) = unlike(&few, &want, 4e-3);
        // Near-tangent pixels of noise, where two roots more or less are a matter of rounding.
        assert!(
            apart <= hits / 100 + 1,
            "{texture}: {apart} of {hits} pixels unlike the CPU's"
        );
        // One layer of 16 bytes and 18 of what lies behind, instead of all layers.
        assert!(small + 16 * 32 * 24 * 4 < large, "{small} and {large} bytes");
    }
}
