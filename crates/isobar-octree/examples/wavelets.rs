//! Levels of detail of a volume by spline wavelets: Table 6.4, the numbers of Figures 4.2 to 4.6 and 6.7 to 6.9 of Steinberger 2010, and what a reconstruction
//! costs, with the feature `gpu` also on the first adapter. `cargo run --release -p isobar-octree --example wavelets -- DATA [ISOVALUE] [THREADS] [FOLDER]`; DATA is a file or a
//! synthetic field; with a folder the pictures are written there as PPM. Times are CPU time of the process, least of several. What drawing over levels gains
//! is in the example `levels`.

use glam::DVec3;
use isobar_core::{Camera, Channels, Data, Grid, Stop, Surface, View, to_srgb8};
use isobar_fields::Synthetic;
use isobar_octree::wavelet::table::{Picture, Row, Setting, epsilon_for, level_picture};
use isobar_octree::wavelet::{Adaptive, Bank, Criteria, Extent, Multiresolution, Pyramid, Selection};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

/// Table 6.4 as printed (full, 6.7 b to f): chunks, share in per cent, reconstruction and rendering in ms on a GTX 285, MSE times 1000.
const PRINTED: [(usize, f64, f64, f64, f64); 6] = [
    (4681, 100.0, 7.23, 225.0, 0.0),
    (3421, 73.0, 8.72, 219.0, 24.0),
    (1877, 40.0, 9.25, 161.0, 45.0),
    (585, 12.0, 6.11, 115.0, 57.0),
    (295, 6.0, 6.92, 89.3, 176.0),
    (73, 1.6, 3.58, 61.4, 370.0),
];

fn main() -> Result<()> {
    let mut args = std::env::args().skip(1);
    let file = args.next().ok_or("usage: wavelets DATA [ISOVALUE] [THREADS] [FOLDER]")?;
    let isovalue: f64 = args.next().map_or(Ok(0.0), |s| s.parse())?;
    let threads: usize = args.next().map_or(Ok(0), |s| s.parse())?;
    let folder: Option<PathBuf> = args.next().map(PathBuf::from);
    if let Some(folder) = &folder {
        fs::create_dir_all(folder)?;
    }
    let data = match file.parse::<Synthetic>() {
        Ok(s) => s.data()?,
        Err(_) => isobar_io::load(Path::new(&file), &isobar_io::Options::default())?.data,
    };
    let Data::Grid(grid) = data else {
        return Err(format!("{file} holds no grid").into());
    };
    let view = View::fit(grid.domain().world_bounds(), 40.0, 1024, 768);
    let setting = Setting {
        grid: &grid,
        bank: Bank::Psi42,
        isovalue,
        view: &view,
        method: &isobar_octree::OCTREE_CPU,
        threads,
        clock: cpu_time,
    };
    banks(&grid, threads)?;
    #[cfg(feature = "gpu")]
    devices(&setting)?;
    levels(&setting, folder.as_deref())?;
    compression(&setting, folder.as_deref())
}

/// Of all threads.
fn cpu_time() -> Duration {
    let t = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    Duration::new(t.tv_sec.unsigned_abs(), t.tv_nsec as u32)
}

fn ms(d: Duration) -> f64 {
    d.as_secs_f64() * 1e3
}

/// Every bank: error of the full reconstruction, time, throughput.
fn banks(grid: &Grid, threads: usize) -> Result<()> {
    println!("\nbank     decompose ms  reconstruct ms  Mchunk/s  MSample/s  greatest error / range");
    let pool = isobar_cpu::Pool::new(threads)?;
    for bank in Bank::ALL {
        let clock = cpu_time();
        let pyramid = Arc::new(pool.install(|| Pyramid::new(grid, bank))?);
        let decompose = cpu_time() - clock;
        let all = Selection::whole(&pyramid, true);
        let mut adaptive = Adaptive::new(pyramid.clone());
        let mut least = Duration::MAX;
        for _ in 0..7 {
            adaptive.forget();
            let clock = cpu_time();
            pool.install(|| adaptive.update(&all, Extent::Whole));
            least = least.min(cpu_time() - clock);
        }
        let out = adaptive.grid()?;
        let worst = (0..out.samples.len()).fold(0.0f64, |m, i| m.max((out.samples.get(i) - grid.samples.get(i)).abs()));
        let (lo, hi) = grid.samples.range().0.ok_or("no sample is finite")?;
        let s = least.as_secs_f64();
        println!(
            "{bank:8} {:12.1} {:15.2} {:9.3} {:10.1}  {:.2e}",
            ms(decompose),
            ms(least),
            pyramid.chunks() as f64 / s * 1e-6,
            pyramid.coefficients() as f64 / s * 1e-6,
            worst / (hi - lo)
        );
    }
    Ok(())
}

/// Algorithms 1 to 3 on the CPU and as compute kernels: Table 6.4's selections, each from nothing.
#[cfg(feature = "gpu")]
fn devices(setting: &Setting<'_>) -> Result<()> {
    use isobar_octree::wavelet::gpu::GpuAdaptive;
    use std::time::Instant;
    let gpu = isobar_gpu::Gpu::open()?;
    let Camera::Perspective { eye, .. } = setting.view.camera else {
        return Err("the view is in perspective".into());
    };
    let pool = isobar_cpu::Pool::new(setting.threads)?;
    let pyramid = Arc::new(pool.install(|| Pyramid::new(setting.grid, setting.bank))?);
    let (mut device, mut host) = (GpuAdaptive::new(&gpu, pyramid.clone())?, Adaptive::new(pyramid.clone()));
    println!(
        "\nReconstruction on {} and on the CPU ({} threads), wall ms, least of 5 in turn; the kernels' own time where the device tells",
        gpu.report(),
        setting.threads
    );
    println!("chunks  computed  GPU ms (kernels)  CPU ms");
    let criteria = |share: f64| Criteria {
        view: Some((eye, epsilon_for(&pyramid, eye, share))),
        ..Criteria::default()
    };
    for (_, share, ..) in PRINTED {
        let selection = Selection::new(&pyramid, &criteria(share / 100.0));
        let (mut best, mut kernels, mut cpu, mut computed) = (f64::INFINITY, None, f64::INFINITY, 0);
        for _ in 0..5 {
            device.forget();
            let clock = Instant::now();
            let (update, time) = device.update(&selection, Extent::Drawn)?;
            gpu.wait()?;
            let wall = ms(clock.elapsed());
            if wall < best {
                (best, kernels, computed) = (wall, time, update.computed);
            }
            host.forget();
            let clock = Instant::now();
            pool.install(|| host.update(&selection, Extent::Drawn));
            cpu = cpu.min(ms(clock.elapsed()));
        }
        let kernels = kernels.map_or("-".into(), |t| format!("{:.2}", ms(t)));
        println!("{:6}  {computed:8}  {best:6.2} ({kernels})  {cpu:6.2}", selection.count());
    }
    Ok(())
}

/// Table 6.4.
fn levels(setting: &Setting<'_>, folder: Option<&Path>) -> Result<()> {
    let Camera::Perspective { eye, .. } = setting.view.camera else {
        return Err("the view is in perspective".into());
    };
    let pyramid = Pyramid::new(setting.grid, setting.bank)?;
    let epsilons: Vec<f64> = PRINTED.iter().map(|p| epsilon_for(&pyramid, eye, p.1 / 100.0)).collect();
    println!("\nTable 6.4, {}; the thesis's numbers in brackets.", setting.bank);
    println!(
        "epsilon  chunks        share %       wanted  anew ms         from before     render ms      MSE x 1e3        depth rms  one-sided  parts  finest chunks by level"
    );
    let rows = setting.rows(eye, &epsilons, false)?;
    for (i, ((r, picture), p)) in rows.iter().zip(PRINTED).enumerate() {
        println!(
            "{:7.4}  {:5} [{:4}]  {:5.1} [{:5.1}]  {:6}  {:6.2} [{:5.2}]  {:6.2} ({:5})  {:6.1} [{:5.1}]  {:7.3} [{:5.1}]  {:9.4}  {:9}  {:5}  {:?}",
            r.epsilon,
            r.chunks,
            p.0,
            r.share * 100.0,
            p.1,
            r.wanted,
            ms(r.from_nothing),
            p.2,
            ms(r.update),
            r.computed,
            ms(r.levels.render),
            p.3,
            r.mse * 1e3,
            p.4,
            r.depth,
            r.one_sided,
            r.parts,
            r.by_level
        );
        if let Some(folder) = folder {
            let letter = ["full", "b", "c", "d", "e", "f"][i];
            write(folder, &format!("figure-6.7-{letter}"), setting.view, &picture.frame.rgba)?;
            write(
                folder,
                &format!("figure-4.6-{letter}"),
                setting.view,
                &level_picture(setting, r, picture),
            )?;
            if letter == "b" {
                transition(setting, eye, r, folder)?;
            }
        }
    }
    Ok(())
}

/// Figure 6.8: the levels chosen for one view seen from the other side, and the border of levels next to the middle of that picture close up; each shaded and by level.
fn transition(setting: &Setting<'_>, eye: DVec3, row: &Row, folder: &Path) -> Result<()> {
    let pyramid = Arc::new(Pyramid::new(setting.grid, setting.bank)?);
    let criteria = Criteria {
        view: Some((eye, row.epsilon)),
        ..Criteria::default()
    };
    let channels = Channels::T | Channels::NORMAL | Channels::SURFACE | Channels::RGBA;
    let mut levels = Multiresolution::new(pyramid.clone(), channels, setting.threads)?;
    levels.set_surfaces(&[Surface::isovalue(setting.isovalue, 0)])?;
    levels.select(&Selection::new(&pyramid, &criteria))?;
    let mut draw = |name: &str, view: &View| -> Result<(Picture, Vec<[f32; 4]>)> {
        levels.render(view, &Stop::default())?;
        let picture = Picture {
            frame: levels.frame().clone(),
            render: Duration::ZERO,
        };
        let by_level = level_picture(&Setting { view, ..*setting }, row, &picture);
        write(folder, &format!("figure-6.8-{name}"), view, &picture.frame.rgba)?;
        write(folder, &format!("figure-6.8-{name}-levels"), view, &by_level)?;
        Ok((picture, by_level))
    };
    let (width, height) = (setting.view.width, setting.view.height);
    let bounds = setting.grid.domain().world_bounds();
    let view = View::fit_from(bounds, DVec3::new(-1.9, 2.6, 2.2), DVec3::Z, 40.0, width, height);
    let (picture, by_level) = draw("a", &view)?;
    let off = |i: usize| (i % width).abs_diff(width / 2).pow(2) + (i / width).abs_diff(height / 2).pow(2);
    // Outlines of levels are black.
    let border = (0..by_level.len()).filter(|&i| by_level[i] == [0.0, 0.0, 0.0, 1.0]);
    let Some(i) = border.min_by_key(|&i| off(i)) else {
        return Ok(());
    };
    let ray = view.ray(i % width, i / width);
    let point = ray.at(picture.frame.t[i]);
    let normal = DVec3::from_array(picture.frame.normal[i].map(f64::from));
    let out = (normal * -normal.dot(ray.direction).signum() - ray.direction).normalize();
    let from = point + out * 20.0 * setting.grid.spacing.min_element();
    let up = if out.z.abs() < 0.9 { DVec3::Z } else { DVec3::X };
    draw("close", &View::perspective(from, point, up, 40.0, width, height))?;
    Ok(())
}

/// Figure 4.5.
fn compression(setting: &Setting<'_>, folder: Option<&Path>) -> Result<()> {
    println!("\nFigure 4.5: the greatest coefficients only");
    println!("weights    kept     share %  rms error   max error   MSE x 1e3  depth rms  one-sided");
    for weighted in [false, true] {
        for (c, picture) in setting.compressions(&[0.2, 0.05, 0.01, 0.002], weighted)? {
            let name = if weighted { "norm" } else { "none" };
            println!(
                "{name:8} {:8}  {:7.3}  {:10.3e}  {:10.3e}  {:9.3}  {:9.4}  {:9}",
                c.kept,
                c.share * 100.0,
                c.rms,
                c.max,
                c.picture.mse * 1e3,
                c.picture.depth,
                c.picture.one_sided
            );
            if let Some(folder) = folder {
                write(
                    folder,
                    &format!("figure-4.5-{name}-{}", c.kept),
                    setting.view,
                    &picture.frame.rgba,
                )?;
            }
        }
    }
    Ok(())
}

fn write(folder: &Path, name: &str, view: &View, pixels: &[[f32; 4]]) -> Result<()> {
    let mut bytes = format!("P6\n{} {}\n255\n", view.width, view.height).into_bytes();
    bytes.extend(pixels.iter().flat_map(|&p| to_srgb8(p)));
    fs::write(folder.join(format!("{name}.ppm")), bytes)?;
    Ok(())
}
