//! Packets against single rays and the oracle.

use super::pieces::{blossom, coefficients, gradients, two_steps};
use crate::{TETSPLINE_CPU, cube};
use isobar_core::{
    Camera, Channels, ClipPlane, DMat3, DVec3, Data, Frame, Grid, Method, Renderer, Request, Samples, Stage, Stop, Surface, View,
};
use isobar_cpu::packet::{LANES, Lanes, Plain};
use isobar_fields::Synthetic;
use isobar_oracle::{Truth, check};
use std::sync::Arc;

/// A seeded generator of numbers in [0, 1).
fn unit(seed: &mut u64) -> f64 {
    *seed = seed
        .wrapping_mul(6_364_136_223_846_793_005)
        .wrapping_add(1_442_695_040_888_963_407);
    (*seed >> 11) as f64 / (1u64 << 53) as f64
}

/// Lanes of different kinds, bit for bit as the scalar code but for the division by 192.
#[test]
fn pieces_are_those_of_single_rays() {
    let mut seed = 5;
    for round in 0..30 {
        let mut table = [0.0; 32 * LANES];
        table.fill_with(|| unit(&mut seed) - 0.5);
        let kinds: [u8; LANES] = std::array::from_fn(|l| ((3 * l + round) % 24) as u8);
        let ends: [[[f64; 3]; 2]; LANES] =
            std::array::from_fn(|_| std::array::from_fn(|_| std::array::from_fn(|_| unit(&mut seed) - 0.5)));
        let phi = |e: usize| {
            let of = |v: usize| std::array::from_fn(|l| cube::barycentric(kinds[l].into(), ends[l][e])[v]);
            [0, 1, 2, 3].map(|v| Plain::load(&of(v)))
        };
        let kind = Plain::index(u64::from_le_bytes(kinds));
        let b = coefficients(&table, Plain::index(0xe0c0_a080_6040_2000), kind);
        let c = blossom::<Plain>(&b, phi(0), phi(1)).map(|c| {
            let mut to = [0.0; LANES];
            c.store(&mut to);
            to
        });
        let g = gradients(two_steps(&b, phi(0)), &kinds);
        for l in 0..LANES {
            let mut data = [0.0; 32];
            data.copy_from_slice(&table[32 * l..32 * (l + 1)]);
            let k = usize::from(kinds[l]);
            let b = cube::patch(&data, k);
            let [from, to] = ends[l].map(|p| cube::barycentric(k, p));
            let want = cube::blossom(&b, from, to);
            assert!((0..4).all(|i| (c[i][l] / 192.0 - want[i]).abs() < 1e-14), "{want:?}");
            let want = cube::gradient(&b, k, from);
            assert!((0..3).all(|a| (g[a][l] - want[a]).abs() < 1e-13), "{want:?}");
        }
    }
}

const FIRST: Channels = Channels::T
    .union(Channels::NORMAL)
    .union(Channels::SURFACE)
    .union(Channels::RGBA)
    .union(Channels::CLAIM)
    .union(Channels::T_ERROR);

/// The same rays as a list, whose pixels have no neighbours: each goes alone.
fn listed(view: &View) -> View {
    let rays: Vec<_> = (0..view.pixels()).map(|i| view.ray(i % view.width, i / view.width)).collect();
    View {
        clips: view.clips.clone(),
        ..View::rays(rays)
    }
}

fn draw(data: &Arc<Data>, surfaces: &[Surface], view: &View, channels: Channels, layers: usize) -> (Frame, Box<dyn Renderer>) {
    let request = Request {
        channels,
        layers,
        ..Request::default()
    };
    let mut r = TETSPLINE_CPU.open(&request).unwrap();
    r.set_data(data).unwrap();
    r.set_surfaces(surfaces).unwrap();
    r.set_view(view).unwrap();
    r.render(&Stop::default()).unwrap();
    let mut f = Frame::default();
    r.read(&mut f).unwrap();
    (f, r)
}

fn alone(r: &dyn Renderer) -> usize {
    let counters = r.counters();
    counters.0.iter().find(|(n, _)| *n == "rays alone").unwrap().1 as usize
}

/// Both ways give the same pixels, and the oracle agrees; gives the number of hits in the layers and of rays that went alone.
fn agree(name: &str, data: &Arc<Data>, surfaces: &[Surface], view: &View, channels: Channels, layers: usize) -> (usize, usize) {
    let (one, single) = draw(data, surfaces, &listed(view), channels, layers);
    let (packets, r) = draw(data, surfaces, view, channels, layers);
    assert_eq!(alone(&*single), view.width * view.height, "{name}");
    let f = r.reconstruction(Stage::Stored).unwrap();
    let truth = Truth::compute(&f, surfaces, view, &Stop::default()).unwrap();
    let c = check(&packets, &truth, &f, surfaces, view).unwrap();
    assert_eq!((c.missed, c.false_hits, c.wrong_root, c.refuted), (0, 0, 0, 0), "{name}");
    assert!(c.unclaimed <= 5, "{name}: {} pixels are not proved", c.unclaimed);
    assert_eq!(one.claim, packets.claim, "{name}");
    assert_eq!(one.surface, packets.surface, "{name}");
    assert_eq!(one.hits, packets.hits, "{name}");
    let mut hits = 0;
    for (p, (a, b)) in one.t.iter().zip(&packets.t).enumerate() {
        // Of a pixel each within its proved bound.
        let proved = one.t_error[p] + packets.t_error[p];
        let apart = if proved.is_finite() { proved.max(1e-10) } else { 1e-10 };
        assert!(a == b || (a - b).abs() < apart, "{name}, entry {p}: {a} and {b}");
        hits += usize::from(b.is_finite());
    }
    let apart = |a: &[f32; 3], b: &[f32; 3]| (0..3).any(|k| (a[k] - b[k]).abs() > 1e-4);
    let normals = one.normal.iter().zip(&packets.normal);
    assert_eq!(normals.filter(|(a, b)| apart(a, b)).count(), 0, "{name}");
    for (p, (a, b)) in one.rgba.iter().zip(&packets.rgba).enumerate() {
        assert!(
            (0..4).all(|k| (a[k] - b[k]).abs() < 1e-3),
            "{name}, pixel {p}: {a:?} and {b:?}"
        );
    }
    (hits, alone(&*r))
}

fn surface(value: f64, opacity: f32) -> Surface {
    Surface {
        opacity,
        ..Surface::isovalue(value, 0)
    }
}

fn noise(dims: [usize; 3], spacing: DVec3, direction: DMat3, mut seed: u64) -> Arc<Data> {
    let samples: Vec<f32> = (0..dims.iter().product()).map(|_| unit(&mut seed) as f32).collect();
    let samples = Samples::F32(samples.into());
    let grid = Grid::new(dims, spacing, DVec3::new(0.5, -3.0, 11.0), direction, samples).unwrap();
    Arc::new(Data::Grid(grid))
}

/// Views from outside and inside, parallel rays, axes in any direction, images that tiles do not divide, directions of both signs in a tile.
#[test]
fn packets_agree_with_single_rays_and_the_oracle() {
    let turned = DMat3::from_rotation_z(0.3) * DMat3::from_rotation_x(-1.1);
    let grids = [
        noise([19, 14, 23], DVec3::new(1.0, 1.5, 0.7), DMat3::IDENTITY, 4),
        noise([12, 12, 12], DVec3::ONE, turned, 5),
        noise([9, 30, 11], DVec3::ONE, DMat3::from_diagonal(DVec3::new(-1.0, 1.0, -1.0)), 6),
    ];
    for (g, data) in grids.iter().enumerate() {
        let (lo, hi) = data.bounds();
        let (middle, size) = ((lo + hi) * 0.5, hi - lo);
        let look = |eye: DVec3, to: DVec3| View::perspective(eye, to, DVec3::new(0.1, 0.2, 1.0), 50.0, 75, 50);
        let parallel = |from: DVec3| View {
            camera: Camera::Orthographic {
                eye: middle + from * size.length(),
                target: middle,
                up: DVec3::Z,
                height: size.length(),
            },
            ..View::bench(75, 50)
        };
        let views = [
            View::fit(data.bounds(), 40.0, 75, 50),
            View::fit_from(data.bounds(), -DVec3::X, DVec3::Z, 40.0, 75, 50),
            look(middle + size * 0.2, middle - size),
            look(lo + size * DVec3::new(0.5, 0.01, 0.5), hi),
            look(middle + size * 1.2, middle + size * 2.0),
            parallel(DVec3::new(0.6, -0.9, 0.5)),
            parallel(DVec3::ONE),
        ];
        for (i, view) in views.iter().enumerate() {
            for (channels, layers) in [(FIRST, 1), (FIRST | Channels::HITS, 30)] {
                let name = format!("grid {g}, view {i}, {layers} layers");
                let (hits, alone) = agree(&name, data, &[surface(0.6, 1.0)], view, channels, layers);
                assert!(hits > 100 || i == 4, "{name}: {hits} hits");
                // Seen along an axis, directions have both signs in half of the tiles.
                assert!(alone < 75 * 50 * 2 / 3, "{name}: {alone} rays alone");
            }
        }
    }
}

/// A surface one sees in a bench view: no ray goes alone but those of a tile or two in which a component of the directions changes its sign.
#[test]
fn packets_draw_almost_all_of_a_frame() {
    for (spec, isovalue) in [("marschner-lobb,n=40", 0.5), ("gyroid,n=48", 0.2)] {
        let data = Arc::new(spec.parse::<Synthetic>().unwrap().data().unwrap());
        for channels in [FIRST, FIRST | Channels::HITS] {
            let (hits, alone) = agree(spec, &data, &[surface(isovalue, 1.0)], &View::bench(160, 120), channels, 1);
            assert!(hits > 1000 && alone <= 512, "{spec}: {alone} of {hits} alone");
        }
    }
}

/// Opaque and semi-transparent surfaces, cut by a plane and whole: what ends a ray is seen by its colours and layers.
#[test]
fn several_isovalues_and_cuts_go_together() {
    let data = noise([9, 13, 10], DVec3::ONE, DMat3::IDENTITY, 8);
    let sets = [
        vec![surface(0.55, 0.4)],
        vec![surface(0.6, 1.0), surface(0.45, 0.4), surface(0.52, 0.7)],
        vec![surface(0.55, 1.0), surface(0.5, 1.0), surface(0.4, 0.0)],
    ];
    let (lo, hi) = data.bounds();
    let normal = DVec3::new(1.0, 0.3, 0.2);
    let plane = ClipPlane {
        normal,
        distance: normal.dot((lo + hi) * 0.5),
        cap: false,
    };
    for (n, surfaces) in sets.iter().enumerate() {
        let mut view = View::fit(data.bounds(), 40.0, 51, 35);
        for clips in [vec![], vec![plane]] {
            view.clips = clips;
            for (channels, layers) in [
                (FIRST, 1),
                (FIRST, 3),
                (FIRST | Channels::HITS, 1),
                (FIRST | Channels::HITS, 30),
            ] {
                let name = format!("set {n}, {channels:?}, {layers} layers, {} planes", view.clips.len());
                let (hits, alone) = agree(&name, &data, surfaces, &view, channels, layers);
                assert!(hits > 300 && alone < 51 * 35 / 2, "{name}: {hits} hits, {alone} rays alone");
            }
        }
    }
}

/// WORK: the active cubes that a ray crosses. In packets and alone it is the same number, but where a rounded ray touches a cube in a point, and nothing else changes.
#[test]
fn packets_count_work() {
    let data = noise([14, 11, 12], DVec3::ONE, DMat3::IDENTITY, 21);
    let view = View::fit(data.bounds(), 40.0, 75, 50);
    for (isovalue, channels) in [(0.8, FIRST), (0.8, FIRST | Channels::HITS), (0.7, FIRST)] {
        let surfaces = [surface(isovalue, 1.0)];
        let (plain, _) = draw(&data, &surfaces, &view, channels, 1);
        let (packets, r) = draw(&data, &surfaces, &view, channels | Channels::WORK, 1);
        let (one, _) = draw(&data, &surfaces, &listed(&view), channels | Channels::WORK, 1);
        assert!(alone(&*r) < 75 * 50 / 3, "{} rays alone", alone(&*r));
        assert!(plain.t == packets.t && plain.rgba == packets.rgba && plain.claim == packets.claim && plain.hits == packets.hits);
        let apart = packets.work.iter().zip(&one.work).filter(|(a, b)| a != b).count();
        let total: u64 = packets.work.iter().map(|w| u64::from(*w)).sum();
        assert!(
            total > 500 && apart < 20,
            "{apart} of {} pixels, {total} cubes",
            view.pixels()
        );
    }
}

/// Where rounding spoils the camera's axes (an `up` whose square underflows, or almost along the line of sight) or the focal length is infinite, rectangles on the
/// screen mean nothing: every ray goes alone.
#[test]
fn views_that_rounding_spoils_go_alone() {
    let data = Arc::new("marschner-lobb,n=24".parse::<Synthetic>().unwrap().data().unwrap());
    let bench = View::bench(48, 36);
    let Camera::Perspective { eye, target, .. } = bench.camera else {
        panic!("the bench view is a perspective");
    };
    let sight = (target - eye).normalize();
    let view = |up: DVec3, fov: f64| View::perspective(eye, target, up, fov, 48, 36);
    let views = [
        view(DVec3::new(0.0, 0.0, 1e-161), 40.0),
        view(DVec3::new(0.0, 0.0, 3e-162), 40.0),
        view(sight + DVec3::new(0.6e-11, -1e-11, 1.4e-11), 0.1),
        view(DVec3::Z, 1e-310),
    ];
    for (i, view) in views.iter().enumerate() {
        view.validate().unwrap();
        let (_, alone) = agree(&format!("view {i}"), &data, &[surface(0.5, 1.0)], view, FIRST, 1);
        assert_eq!(alone, 48 * 36, "view {i}");
    }
}
