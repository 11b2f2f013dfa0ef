//! Frames against the oracle.

use crate::CELLPROJ_CPU;
use isobar_core::{
    Camera, Channels, Claim, DVec3, Data, Frame, Function, Knobs, Method, Ray, Request, Stage, Stop, Surface, TetMesh, View,
};
use isobar_fields::Synthetic;
use isobar_oracle::{Check, Truth, check};
use std::path::PathBuf;
use std::sync::Arc;

pub(crate) fn draw(
    data: &Arc<Data>,
    isovalues: &[f64],
    view: &View,
    request: &Request,
) -> (Frame, Arc<dyn Function>, Vec<Surface>) {
    let surfaces: Vec<_> = isovalues.iter().enumerate().map(|(i, &c)| Surface::isovalue(c, i)).collect();
    let mut r = CELLPROJ_CPU.open(request).unwrap();
    r.set_data(data).unwrap();
    r.set_surfaces(&surfaces).unwrap();
    r.set_view(view).unwrap();
    r.render(&Stop::default()).unwrap();
    let mut frame = Frame::default();
    r.read(&mut frame).unwrap();
    (frame, r.reconstruction(Stage::Stored).unwrap(), surfaces)
}

/// Draws the nearest hits, and again with three layers and counts; both against the oracle, every pixel.
fn verify(name: &str, data: &Arc<Data>, isovalues: &[f64], view: &View) -> Check {
    let channels = Channels::all() - Channels::HITS;
    let one = Request {
        channels,
        ..Request::default()
    };
    let (frame, function, surfaces) = draw(data, isovalues, view, &one);
    let truth = Truth::compute(&function, &surfaces, view, &Stop::default()).unwrap();
    let c = check(&frame, &truth, &function, &surfaces, view).unwrap();
    let wrong = (
        c.missed,
        c.false_hits,
        c.wrong_root,
        c.wrong_surface,
        c.refuted,
        c.undecidable_differs,
    );
    assert_eq!(wrong, (0, 0, 0, 0, 0, 0), "{name}: {} pixels, {} hits", c.pixels, c.hits);
    assert_eq!(c.unclaimed, 0, "{name}: every pixel is decided");
    let all = Request {
        channels: Channels::all(),
        layers: 3,
        ..Request::default()
    };
    let (layers, _, _) = draw(data, isovalues, view, &all);
    let d = check(&layers, &truth, &function, &surfaces, view).unwrap();
    assert_eq!(
        (d.missed, d.false_hits, d.wrong_root, d.wrong_surface, d.refuted, d.unclaimed),
        (0, 0, 0, 0, 0, 0),
        "{name}, layers"
    );
    c
}

pub(crate) fn synthetic(text: &str) -> Arc<Data> {
    Arc::new(text.parse::<Synthetic>().unwrap().data().unwrap())
}

pub(crate) fn orthographic(eye: DVec3, target: DVec3, height: f64, size: (usize, usize)) -> View {
    View {
        camera: Camera::Orthographic {
            eye,
            target,
            up: DVec3::Z,
            height,
        },
        width: size.0,
        height: size.1,
        clips: vec![],
    }
}

#[test]
fn synthetic_meshes_from_outside_and_inside() {
    let data = synthetic("marschner-lobb,n=20,as=tets");
    let c = verify("perspective", &data, &[0.5], &View::bench(97, 71));
    assert!(c.hits > 1500, "{}", c.hits);
    verify("two isovalues", &data, &[0.5, 0.3], &View::bench(97, 71));
    verify("flat image", &data, &[0.5], &View::bench(97, 5));
    let inside = View::perspective(
        DVec3::new(0.31, -0.2, 0.05),
        DVec3::new(1.0, 0.3, 0.1),
        DVec3::Z,
        100.0,
        80,
        60,
    );
    let c = verify("inside", &data, &[0.5], &inside);
    assert!(c.hits > 1000, "{}", c.hits);
    let outside = orthographic(DVec3::new(2.6, 1.9, 2.2), DVec3::ZERO, 2.6, (80, 60));
    assert!(verify("orthographic", &data, &[0.5], &outside).hits > 1000);
    let through = orthographic(DVec3::new(0.1, 0.05, 0.2), DVec3::new(0.9, 0.4, 0.3), 1.6, (80, 60));
    assert!(verify("orthographic from inside", &data, &[0.5], &through).hits > 300);
    verify("gyroid", &synthetic("gyroid,n=24,as=tets"), &[0.2], &View::bench(97, 71));
}

/// Meshes put together without their constructor: one line each, and what was drawn before is kept.
#[test]
fn bad_meshes_are_refused() {
    let points = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
    let good = TetMesh {
        points: points.into(),
        cells: [[0, 1, 2, 3]].into(),
        values: [0.0, 1.0, 2.0, 3.0].into(),
    };
    let nan = [points[0], points[1], points[2], DVec3::new(0.0, f64::NAN, 1.0)];
    let with = |f: &dyn Fn(&mut TetMesh)| {
        let mut m = good.clone();
        f(&mut m);
        Arc::new(Data::Tets(m))
    };
    let bad = [
        ("connectivity", with(&|m| m.cells = [[0, 1, 2, 4]].into())),
        ("a point that is NaN", with(&|m| m.points = nan.into())),
        ("a value that is NaN", with(&|m| m.values = [0.0, f32::NAN, 2.0, 3.0].into())),
        ("values missing", with(&|m| m.values = [0.0, 1.0].into())),
        ("no cells", with(&|m| m.cells = [].into())),
        ("no volume", with(&|m| m.cells = [[0, 1, 2, 2]].into())),
        ("a grid", synthetic("sphere,n=4")),
    ];
    let mut methods: Vec<&'static dyn Method> = vec![&CELLPROJ_CPU, &crate::CELLPROJ_CPU_PAPER];
    #[cfg(feature = "gpu")]
    if isobar_gpu::test_adapter("bad_meshes_are_refused").is_some() {
        methods.push(&crate::CELLPROJ_GPU);
    }
    for m in methods.drain(..) {
        let id = m.info().id;
        let mut r = m.open(&Request::default()).unwrap();
        r.set_data(&Arc::new(Data::Tets(good.clone()))).unwrap();
        r.set_surfaces(&[Surface::isovalue(1.5, 0)]).unwrap();
        r.set_view(&View::bench(16, 12)).unwrap();
        for (what, data) in &bad {
            let e = r.set_data(data).expect_err(what).to_string();
            assert!(!e.is_empty() && !e.contains('\n'), "{id}, {what}: {e}");
        }
        r.render(&Stop::default()).unwrap();
        let mut frame = Frame::default();
        r.read(&mut frame).unwrap();
        assert!(frame.t.iter().any(|t| t.is_finite()), "{id} still has its mesh");
    }
}

/// Rays in faces, along edges and through corners of the mesh: the whole image is a coincidence.
#[test]
fn rays_along_the_lattice() {
    let data = synthetic("sphere,n=9,as=tets");
    for (eye, target, up) in [
        (DVec3::new(0.0, 0.0, 4.0), DVec3::ZERO, DVec3::Y),
        (DVec3::new(0.0, -4.0, 0.0), DVec3::ZERO, DVec3::Z),
        (DVec3::splat(3.0), DVec3::ZERO, DVec3::Z),
    ] {
        // 2.5 world units to 17 pixels less a half at each end: pixel centres on the lattice of step 2.5/8.
        let height = 2.5 * 17.0 / 16.0;
        let view = View {
            camera: Camera::Orthographic { eye, target, up, height },
            width: 17,
            height: 17,
            clips: vec![],
        };
        for isovalue in [1.0, 1.5625, 0.78125, 0.0] {
            verify("lattice", &data, &[isovalue], &view);
        }
        verify(
            "through corners",
            &data,
            &[1.0],
            &View::perspective(eye, target, up, 40.0, 17, 17),
        );
    }
}

/// Isovalues that are data values, plateaus of one value, cells that only touch the surface.
#[test]
fn plateaus_and_touching_cells() {
    let grid = |f: &dyn Fn([usize; 3]) -> f32| {
        let n = 7;
        let samples: Vec<f32> = (0..n * n * n).map(|i| f([i % n, i / n % n, i / n / n])).collect();
        let grid = isobar_core::Grid::unit([n; 3], isobar_core::Samples::F32(samples.into())).unwrap();
        Arc::new(Data::Tets(isobar_fields::grid_to_tets(&grid).unwrap()))
    };
    let plateau = grid(&|[x, y, z]| {
        if (2..=4).contains(&x) && y > 1 {
            1.0
        } else {
            (x + y * z % 3) as f32
        }
    });
    let floor = grid(&|[_, _, z]| (z as f32 - 3.0).abs());
    let point = grid(&|[x, y, z]| if [x, y, z] == [3; 3] { -1.0 } else { 0.0 });
    let centre = DVec3::splat(3.0);
    for (name, data) in [("plateau", &plateau), ("floor", &floor), ("point", &point)] {
        for isovalue in [0.0, 1.0, -1.0] {
            let from = |d: DVec3| View::perspective(centre + d, centre, DVec3::Z, 45.0, 40, 30);
            verify(name, data, &[isovalue], &from(DVec3::new(7.0, 5.0, 6.0)));
            verify(name, data, &[isovalue], &from(DVec3::new(0.3, 0.5, 0.1)));
            verify(
                name,
                data,
                &[isovalue],
                &orthographic(centre + DVec3::new(9.0, 0.0, 0.0), centre, 6.0 * 13.0 / 12.0, (13, 13)),
            );
            verify(
                name,
                data,
                &[isovalue],
                &orthographic(centre, centre + DVec3::X, 6.0, (13, 13)),
            );
        }
    }
}

/// Planes through corners of the lattice, along rays and across them; and with more layers than one. Every pixel is decided.
#[test]
fn clipping_planes() {
    let data = synthetic("marschner-lobb,n=20,as=tets");
    let plane = |normal: DVec3, distance: f64| isobar_core::ClipPlane {
        normal,
        distance,
        cap: false,
    };
    let views = [
        View::bench(97, 71),
        orthographic(DVec3::new(2.6, 1.9, 2.2), DVec3::ZERO, 2.6, (80, 60)),
        orthographic(DVec3::new(0.1, 0.05, 0.2), DVec3::new(0.9, 0.4, 0.3), 1.6, (80, 60)),
    ];
    for mut view in views {
        let middle = view.ray(40, 30);
        let across = middle.direction.cross(DVec3::Z);
        view.clips = vec![
            plane(DVec3::new(1.0, 0.2, 0.1), 0.3),
            plane(across, across.dot(middle.origin) + 0.4),
        ];
        let c = verify("planes", &data, &[0.5, 0.3], &view);
        assert!(c.hits > 150, "{}", c.hits);
        let list: Vec<Ray> = (0..97 * 3).map(|i| view.ray(i % 60, 20 + i / 60)).collect();
        let rays = View {
            clips: view.clips.clone(),
            ..View::rays(list)
        };
        verify("rays", &data, &[0.5, 0.3], &rays);
    }
    // Planes that hold a face of the mesh, where the surface lies in it, and one that holds every ray.
    let grid = |f: &dyn Fn([usize; 3]) -> f32| {
        let n = 7;
        let samples: Vec<f32> = (0..n * n * n).map(|i| f([i % n, i / n % n, i / n / n])).collect();
        let grid = isobar_core::Grid::unit([n; 3], isobar_core::Samples::F32(samples.into())).unwrap();
        Arc::new(Data::Tets(isobar_fields::grid_to_tets(&grid).unwrap()))
    };
    let floor = grid(&|[_, _, z]| z as f32);
    let plateau = grid(&|[x, _, _]| if (2..=4).contains(&x) { 1.0 } else { x as f32 });
    let centre = DVec3::splat(3.0);
    for (data, isovalue, normal, distance) in [
        (&floor, 3.0, DVec3::Z, 3.0),
        (&floor, 3.0, -DVec3::Z, -3.0),
        (&floor, 3.0, DVec3::Z, 3.0f64.next_down()),
        (&floor, 3.0, DVec3::Y, 3.0),
        (&plateau, 1.0, DVec3::X, 3.5),
        (&plateau, 1.0, -DVec3::X, -3.5),
    ] {
        let mut view = orthographic(centre + DVec3::new(9.0, 0.0, 3.0), centre, 6.0, (13, 13));
        view.clips = vec![plane(normal, distance)];
        let c = verify("in the surface", data, &[isovalue], &view);
        let nothing = distance < 3.0 && normal == DVec3::Z;
        assert_eq!(c.hits == 0, nothing, "{normal} {distance}: {} hits", c.hits);
    }
}

#[test]
fn lists_of_rays() {
    let data = synthetic("marschner-lobb,n=16,as=tets");
    let view = View::bench(60, 40);
    let image = verify("image", &data, &[0.5], &view);
    let rays: Vec<Ray> = (0..60 * 40)
        .map(|i| view.ray(i % 60, i / 60))
        .map(|r| Ray {
            direction: r.direction * 3.0,
            ..r
        })
        .collect();
    let list = verify("rays", &data, &[0.5], &View::rays(rays));
    assert_eq!(image.hits, list.hits);
}

/// The file that is shipped.
pub(crate) fn fire() -> Arc<Data> {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../bench-data/fire_ug.vtu");
    Arc::new(isobar_io::load(&path, &isobar_io::Options::default()).unwrap().data)
}

#[test]
fn a_real_mesh() {
    let data = fire();
    let Data::Tets(mesh) = &*data else { panic!("a mesh") };
    let (lo, hi) = mesh
        .values
        .iter()
        .fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), &v| (a.min(v), b.max(v)));
    let view = View::fit(data.bounds(), 40.0, 120, 90);
    for share in [0.0, 0.1, 0.5] {
        let c = f64::from(lo) + share * f64::from(hi - lo);
        verify("fire", &data, &[c], &view);
    }
}

/// A mesh a million of its cells away from the origin, extreme sizes, and cells given inside out.
#[test]
fn far_small_and_inverted() {
    let Data::Tets(base) = &*synthetic("sphere,n=7,as=tets") else {
        panic!("a mesh")
    };
    let with = |f: &dyn Fn(DVec3) -> DVec3| {
        let points: Vec<DVec3> = base.points.iter().map(|&p| f(p)).collect();
        let cells: Vec<[u32; 4]> = base
            .cells
            .iter()
            .enumerate()
            .map(|(i, &[a, b, c, d])| if i % 3 == 0 { [b, a, c, d] } else { [a, b, c, d] })
            .collect();
        Arc::new(Data::Tets(
            TetMesh::new(points.into(), cells.into(), base.values.clone()).unwrap(),
        ))
    };
    let direction = DVec3::new(2.6, 1.9, 2.2);
    for (name, scale, shift) in [
        ("far", 1.0, 1e6),
        ("small", 1e-30, 0.0),
        ("tiny", 1e-90, 0.0),
        ("large", 1e60, 0.0),
    ] {
        let shift = DVec3::new(shift, -shift, 2.0 * shift);
        let data = with(&|p| p * scale + shift);
        let view = View::perspective(direction * scale + shift, shift, DVec3::Z, 40.0, 24, 16);
        let c = verify(name, &data, &[1.0], &view);
        assert!(c.hits > 50, "{name}: {}", c.hits);
        verify(
            name,
            &data,
            &[1.0],
            &orthographic(direction * scale + shift, shift, 2.5 * scale, (24, 16)),
        );
    }
    let stretched = with(&|p| p * DVec3::new(1.0, 1e-6, 1.0));
    verify(
        "flat",
        &stretched,
        &[1.0],
        &View::perspective(direction, DVec3::ZERO, DVec3::Z, 40.0, 40, 30),
    );
}

#[test]
fn frames_do_not_depend_on_threads_or_claims() {
    let data = synthetic("gyroid,n=20,as=tets");
    let view = View::bench(80, 60);
    let request = |threads, claims: &str| Request {
        threads,
        channels: Channels::all(),
        layers: 2,
        knobs: Knobs::default().with("claims", claims),
        ..Request::default()
    };
    let (a, _, _) = draw(&data, &[0.2, -0.4], &view, &request(1, "on"));
    let (b, _, _) = draw(&data, &[0.2, -0.4], &view, &request(3, "on"));
    assert_eq!(a, b);
    let (c, _, _) = draw(&data, &[0.2, -0.4], &view, &request(2, "off"));
    assert_eq!((&a.t, &a.normal), (&c.t, &c.normal));
    assert!(c.claim.iter().all(|c| *c == Claim::empty()) && c.t_error.iter().all(|e| *e == f64::INFINITY));
}

/// hardcases E4 and E8: the unit cell with s = z. Which isovalue is in front depends on the sign of s_b - s_f; the hit on 0.2 lies at z = 0.2.
#[test]
fn two_isovalues_in_one_cell() {
    let points = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];
    let mesh = TetMesh::new(points.into(), vec![[0, 1, 2, 3]].into(), vec![0.0, 0.0, 0.0, 1.0].into()).unwrap();
    let data = Arc::new(Data::Tets(mesh));
    let request = Request {
        layers: 3,
        channels: Channels::all(),
        ..Request::default()
    };
    for (z, order, heights) in [(3.0, [1, 0], [0.4, 0.2]), (-3.0, [0, 1], [0.2, 0.4])] {
        let view = View {
            camera: Camera::Orthographic {
                eye: DVec3::new(0.25, 0.25, z),
                target: DVec3::new(0.25, 0.25, 0.0),
                up: DVec3::Y,
                height: 1.0,
            },
            width: 1,
            height: 1,
            clips: vec![],
        };
        let (f, _, _) = draw(&data, &[0.2, 0.4], &view, &request);
        assert_eq!((f.hits[0], [f.surface[0], f.surface[1]]), (2, order));
        for (layer, height) in heights.into_iter().enumerate() {
            // Values are f64 sums of f32 0 and 1: the plane is z = isovalue.
            assert!((f.point[layer].z - height).abs() < 1e-15 && (f.t[layer] - (z - height).abs()).abs() < 1e-15);
            assert_eq!(f.normal[layer], [0.0, 0.0, 1.0]);
        }
        assert!(f.t[2].is_infinite());
    }
}
