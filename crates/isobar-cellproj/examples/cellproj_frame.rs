//! Draws a scene, gives the CPU time of a frame (least and median of the repeats, summed over threads) with counters, and holds it against the oracle:
//! `cargo run --release -p isobar-cellproj --example cellproj_frame -- FILE|NAME,as=tets ISOVALUE[,ISOVALUE...]|N [size=1024x768] [ortho] [check] [repeats=9]
//! [tf=sharp|smooth|FILE.toml] [colours] [paper|gpu] [threads=N] [eye=X,Y,Z target=X,Y,Z] [set=knob:value,...]`. N without a point asks for N isovalues evenly inside the range; cell data are averaged to
//! the points; `paper` draws with `cellproj/cpu-paper`, `gpu` (feature `gpu`) with `cellproj/gpu`; `check` also tells where a normal is far from the oracle's; synthetic data are seen in the bench view, files in the default one.

use isobar_core::{
    Camera, Channels, DVec3, Data, Frame, Knobs, Method, Request, Stage, Stop, Surface, TetMesh, TransferFunction, View,
};
use isobar_fields::Synthetic;
use isobar_oracle::{Colours, Reference, Truth, check};
use rustix::time::{ClockId, clock_gettime};
use std::collections::HashMap;
use std::path::Path;
use std::sync::Arc;

/// CPU time of all threads; with `ISOBAR_WALL` in the environment the wall clock, for tools under which the former cannot be read.
fn cpu_seconds() -> f64 {
    static START: std::sync::LazyLock<std::time::Instant> = std::sync::LazyLock::new(std::time::Instant::now);
    if std::env::var_os("ISOBAR_WALL").is_some() {
        return START.elapsed().as_secs_f64();
    }
    let t = clock_gettime(ClockId::ProcessCPUTime);
    t.tv_sec as f64 + t.tv_nsec as f64 * 1e-9
}

/// `smooth`: two hills with slopes of at most 8 over the range; `sharp`: a thin peak in the middle.
fn transfer(kind: &str, (lo, hi): (f64, f64), data: &Data) -> TransferFunction {
    let (a, b) = data.bounds();
    let at = |x: f64| lo + x * (hi - lo);
    let points = if kind == "sharp" {
        vec![
            (at(0.49), [1.0, 0.5, 0.1], 0.0),
            (at(0.5), [1.0, 0.5, 0.1], 0.5),
            (at(0.51), [1.0, 0.5, 0.1], 0.0),
        ]
    } else {
        vec![
            (at(0.0), [0.1, 0.2, 1.0], 0.0),
            (at(0.25), [0.1, 0.8, 0.6], 0.006),
            (at(0.5), [1.0, 1.0, 0.2], 0.0),
            (at(0.75), [1.0, 0.3, 0.1], 0.012),
            (at(1.0), [1.0, 1.0, 1.0], 0.002),
        ]
    };
    TransferFunction {
        points,
        unit: (b - a).max_element() / 256.0,
    }
}

/// A transfer function from a file of the program's form.
fn read_transfer(path: &str, data: &Data) -> Result<TransferFunction, Box<dyn std::error::Error>> {
    let table: toml::Table = std::fs::read_to_string(path)?.parse()?;
    let number = |v: &toml::Value| v.as_float().or(v.as_integer().map(|i| i as f64));
    let rows = table.get("points").and_then(|p| p.as_array()).ok_or("no points")?;
    let mut points = Vec::new();
    for row in rows {
        let n: Vec<f64> = row
            .as_array()
            .ok_or("a point is no list")?
            .iter()
            .filter_map(number)
            .collect();
        let [v, r, g, b, d] = n[..] else {
            return Err("a point has not five numbers".into());
        };
        points.push((v, [r as f32, g as f32, b as f32], d as f32));
    }
    let (a, b) = data.bounds();
    let unit = table.get("unit").and_then(number).unwrap_or((b - a).max_element() / 256.0);
    Ok(TransferFunction::new(points, unit)?)
}

/// Faces whose two cells lie on the same side: there the mesh is folded, and cells overlap.
fn folds(mesh: &TetMesh) -> usize {
    let mut faces: HashMap<[u32; 3], Vec<u32>> = HashMap::new();
    for c in mesh.cells.iter() {
        for k in 0..4 {
            let mut face = [c[(k + 1) % 4], c[(k + 2) % 4], c[(k + 3) % 4]];
            face.sort_unstable();
            faces.entry(face).or_default().push(c[k]);
        }
    }
    let p = |i: u32| mesh.points[i as usize];
    let is_folded = |(face, corners): &(&[u32; 3], &Vec<u32>)| {
        let [a, b, c] = face.map(p);
        let side = |i: u32| (b - a).cross(c - a).dot(p(i) - a);
        corners.len() == 2 && side(corners[0]) * side(corners[1]) > 0.0
    };
    faces.iter().filter(is_folded).count()
}

/// The cells that hold a point.
fn cells_at(mesh: &TetMesh, at: DVec3) -> Vec<usize> {
    let holds = |c: &[u32; 4]| {
        let [a, b, d, e] = c.map(|i| mesh.points[i as usize] - at);
        let parts = [b.cross(d).dot(e), -a.cross(d).dot(e), a.cross(b).dot(e), -a.cross(b).dot(d)];
        parts.iter().all(|v| *v >= 0.0) || parts.iter().all(|v| *v <= 0.0)
    };
    (0..mesh.cells.len()).filter(|&i| holds(&mesh.cells[i])).collect()
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [spec, isovalues, flags @ ..] = &arguments[..] else {
        return Err("give data and isovalues".into());
    };
    let flag = |name: &str| flags.iter().any(|f| f == name);
    let value = |name: &str| flags.iter().find_map(|f| f.strip_prefix(name)?.strip_prefix('='));
    let (w, h) = value("size")
        .unwrap_or("1024x768")
        .split_once('x')
        .ok_or("a size such as 512x384")?;
    let (w, h): (usize, usize) = (w.parse()?, h.parse()?);
    let start = cpu_seconds();
    let (data, mut view) = if Path::new(spec).exists() {
        let options = isobar_io::Options {
            cell_to_point: true,
            ..isobar_io::Options::default()
        };
        let data = isobar_io::load(Path::new(spec), &options)?.data;
        let view = View::fit(data.bounds(), 40.0, w, h);
        (data, view)
    } else {
        (spec.parse::<Synthetic>()?.data()?, View::bench(w, h))
    };
    let point = |name: &str| -> Option<DVec3> {
        let numbers: Vec<f64> = value(name)?.split(',').filter_map(|v| v.parse().ok()).collect();
        (numbers.len() == 3).then(|| DVec3::from_slice(&numbers))
    };
    if let (Some(eye), Some(target)) = (point("eye"), point("target")) {
        view = View::perspective(eye, target, DVec3::Z, 40.0, w, h);
    }
    let Data::Tets(mesh) = &data else {
        return Err("data that are no tetrahedra".into());
    };
    let (lo, hi) = mesh
        .values
        .iter()
        .fold((f32::INFINITY, f32::NEG_INFINITY), |(a, b), &v| (a.min(v), b.max(v)));
    println!(
        "{} cells, values {lo} to {hi}, loaded in {:.0} ms",
        mesh.cells.len(),
        (cpu_seconds() - start) * 1e3
    );
    let isovalues: Vec<f64> = match isovalues.parse::<usize>() {
        Ok(n) => (1..=n)
            .map(|i| f64::from(lo) + f64::from(hi - lo) * i as f64 / (n + 1) as f64)
            .collect(),
        Err(_) => isovalues.split(',').map(str::parse).collect::<Result<_, _>>()?,
    };
    if flag("ortho")
        && let Camera::Perspective { eye, target, up, fov } = view.camera
    {
        let height = 2.0 * (target - eye).length() * (0.5 * f64::to_radians(fov)).tan();
        view.camera = Camera::Orthographic { eye, target, up, height };
    }
    let mesh = mesh.clone();
    let mesh = &mesh;
    let data: Arc<Data> = Arc::new(data);
    let surfaces: Vec<Surface> = isovalues.iter().enumerate().map(|(i, &c)| Surface::isovalue(c, i)).collect();
    let mut knobs = Knobs::default();
    for pair in value("set").unwrap_or("").split(',').filter_map(|p| p.split_once(':')) {
        knobs.set(pair.0, pair.1);
    }
    let request = Request {
        channels: Channels::T | Channels::NORMAL | Channels::SURFACE | Channels::RGBA | Channels::CLAIM | Channels::T_ERROR,
        knobs,
        threads: value("threads").unwrap_or("0").parse()?,
        ..Request::default()
    };
    let method: &dyn Method = match (flag("paper"), flag("gpu")) {
        (true, _) => &isobar_cellproj::CELLPROJ_CPU_PAPER,
        #[cfg(feature = "gpu")]
        (_, true) => &isobar_cellproj::CELLPROJ_GPU,
        #[cfg(not(feature = "gpu"))]
        (_, true) => return Err("built without the feature gpu".into()),
        _ => &isobar_cellproj::CELLPROJ_CPU,
    };
    let mut r = method.open(&request)?;
    let timed = |name: &str, start: f64| println!("{name}: {:.2} ms", (cpu_seconds() - start) * 1e3);
    let start = cpu_seconds();
    r.set_data(&data)?;
    timed("data", start);
    let start = cpu_seconds();
    r.set_surfaces(&surfaces)?;
    timed("surfaces", start);
    let start = cpu_seconds();
    r.set_view(&view)?;
    timed("view", start);
    let transfer = match value("tf") {
        None => None,
        Some(path) if Path::new(path).exists() => Some(read_transfer(path, &data)?),
        Some(kind) => Some(transfer(kind, (f64::from(lo), f64::from(hi)), &data)),
    };
    if transfer.is_some() {
        let start = cpu_seconds();
        r.set_medium(transfer.as_ref())?;
        timed("medium", start);
    }
    let mut times: Vec<f64> = Vec::new();
    for _ in 0..value("repeats").unwrap_or("9").parse()? {
        let start = cpu_seconds();
        r.render(&Stop::default())?;
        times.push((cpu_seconds() - start) * 1e3);
    }
    times.sort_by(f64::total_cmp);
    println!(
        "frame: least {:.2} ms, median {:.2} ms; {:?}; {:?}",
        times[0],
        times[times.len() / 2],
        r.counters().0,
        r.memory()
    );
    let mut frame = Frame::default();
    r.read(&mut frame)?;
    let hits = frame.t.iter().filter(|t| t.is_finite()).count();
    println!("{hits} hits");
    if let (true, Some(t)) = (flag("colours"), &transfer) {
        let f = r.reconstruction(Stage::Stored).ok_or("no function")?;
        let start = cpu_seconds();
        let truth = Colours::compute(&f, &surfaces, Some(t), Reference::Integral, &view, &Stop::default())?;
        println!(
            "{:?} (oracle {:.0} ms, error at most {:e})",
            truth.difference(&frame)?,
            (cpu_seconds() - start) * 1e3,
            truth.greatest_error()
        );
    }
    if flag("check") {
        let f = r.reconstruction(Stage::Stored).ok_or("no function")?;
        let start = cpu_seconds();
        let truth = Truth::compute(&f, &surfaces, &view, &Stop::default())?;
        let c = check(&frame, &truth, &f, &surfaces, &view)?;
        // Both sides of the hit: on a common face the gradient is that of either cell.
        for i in 0..view.pixels() {
            let (t, ray) = (frame.t[i], view.ray(i % w, i / w));
            let [x, y, z] = frame.normal[i].map(f64::from);
            let side = |s: f64| f.gradient(ray.at(t * (1.0 + s))).normalize_or_zero().to_array();
            let [a, b, d] = side(0.0);
            if t.is_finite() && a * x + b * y + d * z < 0.0 {
                let (before, behind) = (side(-1e-7), side(1e-7));
                println!(
                    "pixel {i}: normal {:?}, before it {before:?}, behind it {behind:?}; cells {:?}",
                    [x, y, z],
                    cells_at(mesh, ray.at(t * (1.0 + 1e-7)))
                );
            }
        }
        println!("{} faces have both their cells on the same side", folds(mesh));
        println!(
            "{w}x{h}: {} hits; missed {}, false {}, wrong root {}, wrong surface {}, refuted {}, undecidable {} (differing {}), unclaimed {}; t off by {:?} voxels, normals {:?} degrees; {:?}; oracle {:.0} ms",
            c.hits,
            c.missed,
            c.false_hits,
            c.wrong_root,
            c.wrong_surface,
            c.refuted,
            c.undecidable,
            c.undecidable_differs,
            c.unclaimed,
            c.t_error_voxels,
            c.normal_error_deg,
            c.stage,
            (cpu_seconds() - start) * 1e3
        );
    }
    Ok(())
}
