//! Packets against single rays and the oracle, all degrees.

use crate::OCTREE_CPU;
use isobar_core::{
    Camera, Channels, ClipPlane, DMat3, DVec3, Data, Frame, Grid, Knobs, Method, Renderer, Request, Samples, Stage, Stop,
    Surface, View,
};
use isobar_fields::{Kind, Synthetic};
use isobar_oracle::{Truth, check};
use std::sync::Arc;

fn noise(dims: [usize; 3], spacing: DVec3, direction: DMat3, mut seed: u64) -> Arc<Data> {
    let mut unit = || {
        seed = seed
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (seed >> 11) as f64 / (1u64 << 53) as f64
    };
    let samples: Vec<f32> = (0..dims.iter().product()).map(|_| unit() as f32).collect();
    let origin = DVec3::new(0.5, -3.0, 11.0);
    let grid = Grid::new(dims, spacing, origin, direction, Samples::F32(samples.into())).unwrap();
    Arc::new(Data::Grid(grid))
}

fn draw(kind: Kind, data: &Arc<Data>, surfaces: &[Surface], view: &View, channels: Channels, layers: usize) -> Drawn {
    let request = Request {
        channels,
        layers,
        knobs: Knobs::default().with("reconstruction", kind.name()),
        ..Request::default()
    };
    let mut renderer = OCTREE_CPU.open(&request).unwrap();
    renderer.set_data(data).unwrap();
    renderer.set_surfaces(surfaces).unwrap();
    renderer.set_view(view).unwrap();
    renderer.render(&Stop::default()).unwrap();
    let mut frame = Frame::default();
    renderer.read(&mut frame).unwrap();
    Drawn { frame, renderer }
}

struct Drawn {
    frame: Frame,
    renderer: Box<dyn Renderer>,
}

impl Drawn {
    /// Steps through nodes: of packets a few hundred a tile, of single rays a few each.
    fn nodes(&self) -> u64 {
        let counters = self.renderer.counters();
        counters.0.iter().find(|c| c.0 == "nodes").unwrap().1
    }
}

/// The same rays as a list: those do not travel together.
fn one_by_one(view: &View) -> View {
    let rays = (0..view.height).flat_map(|y| (0..view.width).map(move |x| view.ray(x, y)));
    View {
        clips: view.clips.clone(),
        ..View::rays(rays.collect::<Vec<_>>())
    }
}

/// Holds frames of packets against those of single rays: the same hits, surfaces and claims, t within what is proved, normals and colours; and the first hits against the oracle.
/// Gives the number of hits in the layers.
fn agree(name: &str, kind: Kind, data: &Arc<Data>, surfaces: &[Surface], view: &View, asked: &[(Channels, usize)]) -> usize {
    let list = one_by_one(view);
    let mut truth = None;
    let mut hits = 0;
    for &(channels, layers) in asked {
        let name = format!("{name}, {kind}, {channels:?}, {layers} layers");
        let packets = draw(kind, data, surfaces, view, channels, layers);
        let single = draw(kind, data, surfaces, &list, channels, layers);
        let (p, s) = (&packets.frame, &single.frame);
        // A view may miss the volume.
        assert!(
            packets.nodes() < single.nodes() || single.nodes() == 0,
            "{name}: rays go together"
        );
        let f = packets.renderer.reconstruction(Stage::Stored).unwrap();
        let truth = truth.get_or_insert_with(|| Truth::compute(&f, surfaces, view, &Stop::default()).unwrap());
        let c = check(p, truth, &f, surfaces, view).unwrap();
        let wrong = (c.missed, c.false_hits, c.wrong_root, c.wrong_surface, c.refuted);
        assert_eq!(wrong, (0, 0, 0, 0, 0), "{name}");
        assert_eq!(p.claim, s.claim, "{name}");
        assert_eq!(p.hits, s.hits, "{name}");
        assert_eq!(p.surface, s.surface, "{name}");
        for (i, (a, b)) in p.t.iter().zip(&s.t).enumerate() {
            // Each within its proved bound: up to 2e-8 apart where a ray grazes noise.
            let proved = p.t_error[i] + s.t_error[i];
            assert!(
                a == b || (a - b).abs() <= if proved.is_finite() { proved } else { 1e-9 },
                "{name}, entry {i}: {a} and {b}, {proved}"
            );
            let apart = (0..3).any(|k| (p.normal[i][k] - s.normal[i][k]).abs() > 1e-4);
            assert!(!apart, "{name}, entry {i}: {:?} and {:?}", p.normal[i], s.normal[i]);
            hits += usize::from(a.is_finite());
        }
        for (i, (a, b)) in p.rgba.iter().zip(&s.rgba).enumerate() {
            assert!(
                (0..4).all(|k| (a[k] - b[k]).abs() < 1e-3),
                "{name}, pixel {i}: {a:?} and {b:?}"
            );
        }
    }
    hits
}

const FIRST: Channels = Channels::T
    .union(Channels::NORMAL)
    .union(Channels::SURFACE)
    .union(Channels::T_ERROR)
    .union(Channels::CLAIM)
    .union(Channels::RGBA);

/// First hits, some layers, all hits counted.
const ASKED: [(Channels, usize); 4] = [
    (FIRST, 1),
    (FIRST, 3),
    (FIRST.union(Channels::HITS), 1),
    (FIRST.union(Channels::HITS), 40),
];

fn surface(value: f64, opacity: f32) -> Surface {
    Surface {
        opacity,
        ..Surface::isovalue(value, 0)
    }
}

/// Views from outside and inside, parallel rays, seen along an axis: directions of both signs in some tiles; images that tiles do not divide.
fn views(data: &Data) -> Vec<View> {
    let (lo, hi) = data.bounds();
    let (middle, size) = ((lo + hi) * 0.5, hi - lo);
    let look = |eye: DVec3, to: DVec3| View::perspective(eye, to, DVec3::new(0.1, 0.2, 1.0), 50.0, 51, 35);
    vec![
        View::fit(data.bounds(), 40.0, 51, 35),
        View::fit_from(data.bounds(), -DVec3::X, DVec3::Z, 40.0, 51, 35),
        look(middle + size * 0.2, middle - size),
        look(lo + size * DVec3::new(0.5, 0.01, 0.5), hi),
        look(middle + size * 1.2, middle + size * 2.0),
        View {
            camera: Camera::Orthographic {
                eye: middle + size * DVec3::new(1.0, -1.4, 0.8),
                target: middle,
                up: DVec3::Z,
                height: size.length(),
            },
            ..View::bench(51, 35)
        },
    ]
}

/// Noise has every case in it: axes in any direction, several roots in a cell.
#[test]
fn packets_agree_with_single_rays_and_the_oracle() {
    let turned = DMat3::from_rotation_z(0.3) * DMat3::from_rotation_x(-1.1);
    let grids = [
        noise([19, 14, 23], DVec3::new(1.0, 1.5, 0.7), DMat3::IDENTITY, 4),
        noise([12, 12, 12], DVec3::ONE, turned, 5),
        noise([9, 30, 11], DVec3::ONE, DMat3::from_diagonal(DVec3::new(-1.0, 1.0, -1.0)), 6),
    ];
    for (g, data) in grids.iter().enumerate() {
        for (i, view) in views(data).iter().enumerate() {
            let name = format!("grid {g}, view {i}");
            let hits = agree(&name, Kind::Trilinear, data, &[surface(0.75, 1.0)], view, &ASKED);
            assert!(hits > 100 || i == 4, "{name}: {hits} hits");
        }
    }
}

#[test]
fn packets_of_degrees_2_and_3_agree_with_single_rays_and_the_oracle() {
    let turned = DMat3::from_rotation_z(0.3) * DMat3::from_rotation_x(-1.1);
    let grids = [
        noise([19, 14, 23], DVec3::new(1.0, 1.5, 0.7), DMat3::IDENTITY, 4),
        noise([8, 9, 7], DVec3::ONE, turned, 5),
    ];
    for (g, data) in grids.iter().enumerate() {
        for kind in Kind::ALL.into_iter().filter(|&k| k != Kind::Trilinear) {
            for (i, view) in views(data).iter().enumerate().filter(|(i, _)| ![1, 4].contains(i)) {
                let name = format!("grid {g}, view {i}");
                let asked = if kind.interpolates() { &ASKED[..1] } else { &ASKED[..] };
                let hits = agree(&name, kind, data, &[surface(0.55, 1.0)], view, asked);
                assert!(hits > 100, "{name}, {kind}: {hits} hits");
            }
        }
    }
}

/// Opaque and semi-transparent surfaces, cut by planes and whole: what ends a ray is seen by its colours and layers.
#[test]
fn packets_of_several_isovalues_agree_with_single_rays_and_the_oracle() {
    let grids = [
        "gyroid,n=24".parse::<Synthetic>().unwrap().data().map(Arc::new).unwrap(),
        noise([9, 13, 10], DVec3::ONE, DMat3::IDENTITY, 8),
    ];
    for (g, data) in grids.iter().enumerate() {
        let c = |v: f64| if g == 0 { 2.0 * v - 1.0 } else { v };
        let sets = [
            vec![surface(c(0.6), 0.4)],
            vec![surface(c(0.7), 1.0), surface(c(0.45), 0.4), surface(c(0.55), 0.7)],
            vec![surface(c(0.6), 1.0), surface(c(0.5), 1.0), surface(c(0.4), 0.0)],
        ];
        let mut view = views(data)[0].clone();
        for (n, surfaces) in sets.iter().enumerate() {
            view.clips.clear();
            if n == 1 {
                let (lo, hi) = data.bounds();
                let normal = DVec3::new(1.0, 0.3, 0.2);
                view.clips.push(plane(normal, normal.dot((lo + hi) * 0.5)));
            }
            for kind in [Kind::Trilinear, Kind::Quadratic, Kind::Cubic] {
                let hits = agree(&format!("grid {g}, set {n}"), kind, data, surfaces, &view, &ASKED);
                assert!(hits > 1000, "grid {g}, set {n}, {kind}: {hits} hits");
            }
        }
    }
}

/// WORK: the active cells on a ray. Packets count those that a rounded ray touches only in a point too.
#[test]
fn packets_count_the_cells_of_their_rays() {
    let data = Arc::new("gyroid,n=24".parse::<Synthetic>().unwrap().data().unwrap());
    let view = View::bench(51, 35);
    for kind in [Kind::Trilinear, Kind::Cubic] {
        for channels in [FIRST | Channels::WORK, FIRST | Channels::WORK | Channels::HITS] {
            let frame = |v: &View| draw(kind, &data, &[surface(0.2, 1.0)], v, channels, 1).frame;
            let (packets, single) = (frame(&view), frame(&one_by_one(&view)));
            assert!(packets.work.iter().sum::<u32>() > 1000);
            let differ = packets.work.iter().zip(&single.work).filter(|(a, b)| a != b).count();
            assert!(differ < 5, "{kind}, {channels:?}: {differ} pixels");
        }
    }
}

/// Where rounding spoils the camera's axes (an `up` whose square underflows, or almost along the line of sight) or the focal length is infinite, rectangles on the
/// screen mean nothing, and every ray goes alone.
#[test]
fn views_that_rounding_spoils_lose_nothing() {
    let data = Arc::new("marschner-lobb,n=24".parse::<Synthetic>().unwrap().data().unwrap());
    let Camera::Perspective { eye, target, .. } = View::bench(48, 36).camera else {
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
        let frame = |v: &View| draw(Kind::Trilinear, &data, &[surface(0.5, 1.0)], v, FIRST, 1).frame;
        let (packets, single) = (frame(view), frame(&one_by_one(view)));
        assert_eq!((packets.claim, packets.t), (single.claim, single.t), "view {i}");
    }
}

fn plane(normal: DVec3, distance: f64) -> ClipPlane {
    ClipPlane {
        normal,
        distance,
        cap: false,
    }
}

/// Every kind, in packets and ray by ray, against the oracle's clipped truth; with a plane through samples and one that grazes rays.
#[test]
fn open_cuts_are_those_of_the_oracle() {
    let data = Arc::new("gyroid,n=24".parse::<Synthetic>().unwrap().data().unwrap());
    let surfaces = [surface(0.2, 1.0)];
    let mut view = View::bench(96, 72);
    let middle = view.ray(48, 36);
    let across = middle.direction.cross(DVec3::Z);
    view.clips = vec![
        plane(DVec3::new(1.0, 0.2, 0.1), 0.3),
        plane(DVec3::new(0.0, 0.0, -2.0), 1.0 / 3.0),
        plane(across, across.dot(middle.origin) + 0.4),
    ];
    let list = one_by_one(&view);
    for kind in Kind::ALL {
        let packets = draw(kind, &data, &surfaces, &view, Channels::all(), 1);
        let single = draw(kind, &data, &surfaces, &list, Channels::all(), 1).frame;
        let f = packets.renderer.reconstruction(Stage::Stored).unwrap();
        for (frame, view) in [(&packets.frame, &view), (&single, &list)] {
            let truth = Truth::compute(&f, &surfaces, view, &Stop::default()).unwrap();
            assert!(truth.hits() > 1000, "{kind}: {}", truth.hits());
            let c = check(frame, &truth, &f, &surfaces, view).unwrap();
            let wrong = (c.missed, c.false_hits, c.wrong_root, c.wrong_surface, c.refuted, c.unclaimed);
            assert_eq!(wrong, (0, 0, 0, 0, 0, 0), "{kind}");
        }
        assert_eq!(packets.frame.hits, single.hits, "{kind}");
        for (a, b) in packets.frame.t.iter().zip(&single.t) {
            assert!(a == b || (a - b).abs() < 1e-8, "{kind}: {a} and {b}");
        }
    }
}
