//! Cell polynomials made on the fly against stored ones (S10; Steinberger 2010, section 3.3.2): memory against speed.
//! `cargo run --release -p isobar-octree --example stored -- DATA ISOVALUE`; DATA is a file or a synthetic field.
//!
//! For every cell that the isovalue may meet, by the hull of its coefficients, some rays: on the fly the samples are read and turned into powers, once for the
//! rays that share the cell; stored, the powers are read for each of them. Then the recommended composition, f32, one thread, no vectors. Cells in order
//! of memory, and shuffled: neighbouring rays meet neighbouring cells, but a large volume does not stay in the cache.

use isobar_core::{Data, Grid};
use isobar_fields::Synthetic;
use isobar_octree::compose::{Form, compose, powers_of_samples, scale_of_samples};
use std::error::Error;
use std::hint::black_box;
use std::path::Path;
use std::time::Duration;

type Result<T> = std::result::Result<T, Box<dyn Error>>;

/// Rays that share a cell.
const SHARED: [usize; 4] = [1, 4, 16, 64];

fn main() -> Result<()> {
    let mut args = std::env::args().skip(1);
    let (Some(source), Some(isovalue)) = (args.next(), args.next()) else {
        return Err("usage: stored DATA ISOVALUE".into());
    };
    let data = match source.parse::<Synthetic>() {
        Ok(s) => s.data()?,
        Err(_) => isobar_io::load(Path::new(&source), &isobar_io::Options::default())?.data,
    };
    let Data::Grid(grid) = data else {
        return Err(format!("{source} holds no grid").into());
    };
    let isovalue: f64 = isovalue.parse()?;
    println!("{source} at {isovalue}; ns of CPU time per ray: powers on the fly / stored");
    println!(
        "degree  cells met  stored MiB  of the samples' bytes  order     {}",
        SHARED.map(|n| format!("{n:2} rays a cell      ")).join("")
    );
    degree::<1>(&grid, isovalue);
    degree::<2>(&grid, isovalue);
    degree::<3>(&grid, isovalue);
    Ok(())
}

/// Stencils of this degree start this far below the cell.
const fn before(degree: usize) -> usize {
    if degree == 1 { 0 } else { 1 }
}

/// The first coefficient of each cell that may meet the isovalue; cells whose stencils leave the volume are left out.
fn met<const D: usize>(grid: &Grid, samples: &[f32], isovalue: f32) -> Vec<usize> {
    let [nx, ny, nz] = grid.dims;
    let mut cells = Vec::new();
    let span = |n: usize| before(D)..(n + before(D)).saturating_sub(D);
    for z in span(nz) {
        for y in span(ny) {
            for x in span(nx) {
                let first = ((z - before(D)) * ny + y - before(D)) * nx + x - before(D);
                let (mut lo, mut hi) = (f32::INFINITY, f32::NEG_INFINITY);
                for k in 0..=D {
                    for j in 0..=D {
                        for v in &samples[first + (k * ny + j) * nx..][..=D] {
                            lo = lo.min(*v);
                            hi = hi.max(*v);
                        }
                    }
                }
                if lo <= isovalue && isovalue <= hi {
                    cells.push(first);
                }
            }
        }
    }
    cells
}

/// Of all threads.
fn cpu_time() -> Duration {
    let t = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    Duration::new(t.tv_sec.unsigned_abs(), t.tv_nsec as u32)
}

fn powers<const D: usize>(samples: &[f32], [nx, ny, _]: [usize; 3], first: usize, isovalue: f32) -> [f32; 64] {
    let n = D + 1;
    let (mut stencil, mut f) = ([0.0f32; 64], [0.0f32; 64]);
    for k in 0..n {
        for j in 0..n {
            stencil[(k * n + j) * n..][..n].copy_from_slice(&samples[first + (k * ny + j) * nx..][..n]);
        }
    }
    powers_of_samples::<f32, D>(&stencil[..n * n * n], &mut f[..n * n * n]);
    f[0] -= isovalue * (scale_of_samples::<D>() as f32).powi(3);
    f
}

fn degree<const D: usize>(grid: &Grid, isovalue: f64) {
    let samples: Vec<f32> = (0..grid.samples.len()).map(|i| grid.samples.get(i) as f32).collect();
    let isovalue = isovalue as f32;
    let cells = met::<D>(grid, &samples, isovalue);
    let n = (D + 1).pow(3);
    let rays: Vec<[[f32; 2]; 3]> = (0..64u32)
        .map(|i| {
            let unit = |k: u32| (i.wrapping_mul(k) % 64) as f32 / 64.0;
            [[unit(17), 0.7 - unit(29)], [unit(37), unit(11) - 0.4], [0.0, 1.0]]
        })
        .collect();
    let bytes = cells.len() * n * 4;
    for shuffled in [false, true] {
        let mut cells = cells.clone();
        if shuffled {
            let mut state = 1u64;
            for i in (1..cells.len()).rev() {
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1_442_695_040_888_963_407);
                cells.swap(i, (state >> 33) as usize % (i + 1));
            }
        }
        // Where the powers of each cell lie, in the order of memory.
        let mut order: Vec<usize> = (0..cells.len()).collect();
        order.sort_by_key(|&i| cells[i]);
        let (mut place, mut stored) = (vec![0usize; cells.len()], vec![0.0f32; cells.len() * n]);
        for (at, &i) in order.iter().enumerate() {
            place[i] = at;
            stored[at * n..][..n].copy_from_slice(&powers::<D>(&samples, grid.dims, cells[i], isovalue)[..n]);
        }
        print!(
            "{D:6}  {:9}  {:10.1}  {:21.2}  {:8}",
            cells.len(),
            bytes as f64 / f64::from(1 << 20),
            bytes as f64 / grid.samples.bytes() as f64,
            if shuffled { "shuffled" } else { "memory" }
        );
        for shared in SHARED {
            let all = (cells.len() * shared).max(1) as f64;
            let [mut fly, mut kept] = [f64::INFINITY; 2];
            for _ in 0..5 {
                let mut out = [0.0f32; 10];
                let start = cpu_time();
                for &first in &cells {
                    let f = powers::<D>(&samples, grid.dims, first, isovalue);
                    for r in &rays[..shared] {
                        compose::<f32, D>(Form::Axis, &f[..n], r, &mut out[..3 * D + 1]);
                        black_box(&mut out);
                    }
                }
                let middle = cpu_time();
                for &at in &place {
                    for r in &rays[..shared] {
                        compose::<f32, D>(Form::Axis, &stored[at * n..][..n], r, &mut out[..3 * D + 1]);
                        black_box(&mut out);
                    }
                }
                fly = fly.min((middle - start).as_secs_f64() * 1e9 / all);
                kept = kept.min((cpu_time() - middle).as_secs_f64() * 1e9 / all);
            }
            print!("  {fly:6.1} / {kept:6.1}   ");
        }
        println!();
    }
}
