//! Levels of detail of a volume by spline wavelets: Table 6.4, the numbers of Figures 4.2 to 4.6 and 6.7 to 6.9 of Steinberger 2010, and what a reconstruction
//! costs, with the feature `gpu` also on the first adapter. `cargo run --release -p isobar-octree --example wavelets -- DATA [ISOVALUE] [THREADS] [FOLDER]`; DATA is a file or a
//! synthetic field; with a folder the pictures are written there as PNG. Times are CPU time of the process, least of several. What drawing over levels gains
//! is in the example `levels`.

mod common;

use common::{load, save};
use isobar_core::{Data, Grid, View};
use isobar_octree::figures::levels::{SHARES, eye, transition};
use isobar_octree::figures::{Image, printed::TABLE_6_4};
use isobar_octree::wavelet::table::{Setting, epsilon_for, level_picture};
use isobar_octree::wavelet::{Adaptive, Bank, Extent, Pyramid, Selection};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

fn main() -> Result<()> {
    let mut args = std::env::args().skip(1);
    let file = args.next().ok_or("usage: wavelets DATA [ISOVALUE] [THREADS] [FOLDER]")?;
    let isovalue: f64 = args.next().map_or(Ok(0.0), |s| s.parse())?;
    let threads: usize = args.next().map_or(Ok(0), |s| s.parse())?;
    let folder: Option<PathBuf> = args.next().map(PathBuf::from);
    let Data::Grid(grid) = load(&file)? else {
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
    use isobar_octree::wavelet::Criteria;
    use isobar_octree::wavelet::gpu::GpuAdaptive;
    use std::time::Instant;
    let gpu = isobar_gpu::Gpu::open()?;
    let eye = eye(setting.view)?;
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
    for p in TABLE_6_4 {
        let selection = Selection::new(&pyramid, &criteria(p.chunks.1 / 100.0));
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

/// Table 6.4, with the pictures of Figures 4.6, 6.7 and 6.8.
fn levels(setting: &Setting<'_>, folder: Option<&Path>) -> Result<()> {
    let eye = eye(setting.view)?;
    let pyramid = Pyramid::new(setting.grid, setting.bank)?;
    let epsilons: Vec<f64> = (TABLE_6_4.iter())
        .map(|p| epsilon_for(&pyramid, eye, p.chunks.1 / 100.0))
        .collect();
    println!("\nTable 6.4, {}; the thesis's numbers in brackets.", setting.bank);
    println!(
        "epsilon  chunks        share %       wanted  anew ms         from before     render ms      MSE x 1e3        depth rms  one-sided  parts  finest chunks by level"
    );
    let rows = setting.rows(eye, &epsilons, false)?;
    for ((r, picture), p) in rows.iter().zip(TABLE_6_4) {
        println!(
            "{:7.4}  {:5} [{:4}]  {:5.1} [{:5.1}]  {:6}  {:6.2} [{:5.2}]  {:6.2} ({:5})  {:6.1} [{:5.1}]  {:7.3} [{:5.1}]  {:9.4}  {:9}  {:5}  {:?}",
            r.epsilon,
            r.chunks,
            p.chunks.0,
            r.share * 100.0,
            p.chunks.1,
            r.wanted,
            ms(r.from_nothing),
            p.times[0],
            ms(r.update),
            r.computed,
            ms(r.levels.render),
            p.times[1],
            r.mse * 1e3,
            p.mse,
            r.depth,
            r.one_sided,
            r.parts,
            r.by_level
        );
        let shaded = Image::linear(setting.view, &picture.frame.rgba);
        save(folder, &format!("figure-6.7-{}", p.figure), &shaded)?;
        let by_level = Image::linear(setting.view, &level_picture(setting, r, picture));
        save(folder, &format!("figure-4.6-{}", p.figure), &by_level)?;
        if p.figure == "b" && folder.is_some() {
            for s in transition(setting, r, picture)? {
                let name = s.name.replace(' ', "-");
                save(folder, &format!("figure-6.8-{name}"), &s.shaded)?;
                save(folder, &format!("figure-6.8-{name}-levels"), &s.by_level)?;
            }
        }
    }
    Ok(())
}

/// Figure 4.5.
fn compression(setting: &Setting<'_>, folder: Option<&Path>) -> Result<()> {
    println!("\nFigure 4.5: the greatest coefficients only");
    println!("weights    kept     share %  rms error   max error   MSE x 1e3  depth rms  one-sided");
    for weighted in [false, true] {
        for (c, picture) in setting.compressions(&SHARES, weighted)? {
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
            let image = Image::linear(setting.view, &picture.frame.rgba);
            save(folder, &format!("figure-4.5-{name}-{}", c.kept), &image)?;
        }
    }
    Ok(())
}
