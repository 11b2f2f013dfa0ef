//! `cargo run --release -p isobar-oracle --example hexes -- [FILE|annulus|teardrop|bent] [isovalue] [WxH=256x256] [first|all|planted]`: the certified truth of mapped
//! hexahedra in the default view, with time per ray, stages, and what stayed unresolved and why. Without an isovalue the middle of the attribute's range.
//! `planted` shoots as many rays through random points of random elements, each with the value there as its isovalue, and counts those whose root is not found.

use isobar_core::{Algebraic, DVec3, Data, Function, HexElement, HexPatches, Ray, Stop, Surface, View};
use isobar_fields::{HexField, algebraic_to_hexes, evaluate_hex};
use isobar_oracle::{Decided, Doubt, Oracle, Truth};
use std::{collections::BTreeMap, error::Error, path::Path, sync::Arc, time::Instant};

/// A rational element from control points by index.
fn net(degree: [u8; 3], f: impl Fn([usize; 3]) -> [f64; 4]) -> Box<[[f64; 4]]> {
    let n = degree.map(|d| usize::from(d) + 1);
    let all = n.iter().product();
    (0..all).map(|i| f([i % n[0], i / n[0] % n[1], i / n[0] / n[1]])).collect()
}

fn made(name: &str) -> Result<HexPatches, Box<dyn Error>> {
    let terms = [([5, 0, 0], 0.5), ([4, 0, 0], 0.5), ([0, 2, 0], -1.0), ([0, 0, 2], -1.0)];
    let teardrop = Algebraic::new("teardrop", terms, DVec3::splat(-1.25), DVec3::splat(1.25))?;
    let elements: Vec<HexElement> = match name {
        "teardrop" => return Ok(algebraic_to_hexes(&teardrop)?),
        "annulus" => {
            let arc = [[1.0, 0.0, 1.0], [1.0, 1.0, 0.5f64.sqrt()], [0.0, 1.0, 1.0]];
            vec![HexElement {
                degree: [2, 1, 1],
                points: net([2, 1, 1], |[i, j, k]| {
                    let r = 1.0 + j as f64;
                    [r * arc[i][0], r * arc[i][1], k as f64, arc[i][2]]
                }),
                value_degree: [3, 3, 3],
                values: (0..64u32).map(|i| f64::from(i * 37 % 64) / 64.0).collect(),
                rational_value: false,
            }]
        }
        // A bent trilinear grid of n^3 elements.
        _ => {
            let n: usize = name.trim_start_matches("bent").parse().unwrap_or(16);
            let bend = |p: DVec3| DVec3::new(p.x + 0.3 * p.y * p.y, p.y + 0.2 * (3.0 * p.z).sin(), p.z + 0.2 * p.x * p.y);
            let f = |p: DVec3| (6.0 * p.x).sin() + (7.0 * p.y).cos() * (5.0 * p.z).sin();
            let at = |c: [usize; 3]| DVec3::from_array(c.map(|i| i as f64 / n as f64));
            let cells = (0..n * n * n).map(|c| [c % n, c / n % n, c / n / n]);
            let corner = |c: [usize; 3], i: [usize; 3]| at([c[0] + i[0], c[1] + i[1], c[2] + i[2]]);
            cells
                .map(|c| HexElement {
                    degree: [1; 3],
                    points: net([1; 3], |i| {
                        let p = bend(corner(c, i));
                        [p.x, p.y, p.z, 1.0]
                    }),
                    value_degree: [1; 3],
                    values: net([1; 3], |i| [f(corner(c, i)), 0.0, 0.0, 0.0])
                        .iter()
                        .map(|v| v[0])
                        .collect(),
                    rational_value: false,
                })
                .collect()
        }
    };
    Ok(HexPatches::new(elements)?)
}

/// Rays whose root is known because it was put there, but for the rounding of the point and its value.
fn planted(oracle: &Oracle, patches: &HexPatches, rays: usize) {
    let mut state = 88_172_645_463_325_252u64;
    let mut unit = || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1u64 << 53) as f64
    };
    let voxel = oracle.function().domain().voxel();
    let (mut missed, mut open, mut flat, mut worst) = (0, 0, 0, 0.0f64);
    let start = Instant::now();
    for _ in 0..rays {
        let element = &patches.elements[(unit() * patches.elements.len() as f64) as usize];
        let point = evaluate_hex(element, DVec3::new(unit(), unit(), unit()));
        let way = DVec3::new(unit() - 0.5, unit() - 0.5, unit() - 0.5).normalize();
        let far = 20.0 * voxel;
        let ray = Ray {
            origin: point.position - way * far,
            direction: way,
        };
        let all = oracle.with_isovalue(point.value).all(&ray);
        let off = all
            .roots
            .iter()
            .map(|r| (r.t() - far).abs() / voxel)
            .fold(f64::INFINITY, f64::min);
        let doubtful = all
            .unresolved
            .iter()
            .any(|u| u.0 <= far + 1e-9 * voxel && far - 1e-9 * voxel <= u.1);
        // What the rounding of the value and of the point moves the root by; where s hardly changes along the ray it may take it away.
        let slope = point.gradient().dot(way).abs();
        let size = element.values.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        let slack = 1e-10 + 64.0 * f64::EPSILON * size / (slope * voxel);
        if slope <= 1e-4 * point.gradient().length() {
            flat += 1;
        } else if off <= slack {
            worst = worst.max(off / slack);
        } else if doubtful {
            open += 1;
        } else {
            missed += 1;
            println!("missed: {ray:?}, value {}, {all:?}", point.value);
        }
    }
    let seconds = start.elapsed().as_secs_f64();
    println!(
        "{rays} planted roots: {missed} missed, {open} unresolved, {flat} too flat to tell, farthest {worst:.2} of what rounding allows, {seconds:.1} s"
    );
}

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let get = |i: usize, default: &'static str| arguments.get(i).map_or(default, String::as_str);
    let name = get(0, "annulus");
    let patches = if Path::new(name).exists() {
        match isobar_io::load(Path::new(name), &isobar_io::Options::default())?.data {
            Data::Hexes(h) => h,
            other => return Err(format!("{} is no hexes", other.kind()).into()),
        }
    } else {
        made(name)?
    };
    let (lo, hi) = patches
        .elements
        .iter()
        .map(HexElement::value_range)
        .fold((f64::INFINITY, f64::NEG_INFINITY), |a, b| (a.0.min(b.0), a.1.max(b.1)));
    let isovalue: f64 = get(1, "").parse().unwrap_or(0.5 * (lo + hi));
    let (w, h) = get(2, "256x256").split_once('x').ok_or("the size is WxH")?;
    let function: Arc<dyn Function> = Arc::new(HexField::new(&patches)?);
    let view = View::fit(Data::Hexes(patches.clone()).bounds(), 40.0, w.parse()?, h.parse()?);
    let what = format!(
        "{name}: {} elements, isovalue {isovalue} in [{lo}, {hi}]",
        patches.elements.len()
    );
    if get(3, "first") == "first" {
        let start = Instant::now();
        let truth = Truth::compute(&function, &[Surface::isovalue(isovalue, 0)], &view, &Stop::default())?;
        let seconds = start.elapsed().as_secs_f64();
        let unresolved = truth.pixels.iter().filter(|p| p.unresolved).count();
        println!(
            "{what}: first hits with the watch {seconds:.2} s, {:.1} us a ray, {} hits, {:?}, undecidable {}, unresolved {unresolved}",
            seconds * 1e6 / view.pixels() as f64,
            truth.hits(),
            truth.stages(),
            truth.undecidable(),
        );
        return Ok(());
    }
    let oracle = Oracle::new(function, isovalue);
    if get(3, "first") == "planted" {
        planted(&oracle, &patches, view.pixels());
        return Ok(());
    }
    let mut times: BTreeMap<Decided, (usize, f64)> = BTreeMap::new();
    let mut reasons: BTreeMap<Doubt, usize> = BTreeMap::new();
    let mut roots = 0;
    for y in 0..view.height {
        for x in 0..view.width {
            let ray = view.ray(x, y);
            let start = Instant::now();
            let all = oracle.all(&ray);
            let t = times.entry(all.decided).or_default();
            *t = (t.0 + 1, t.1 + start.elapsed().as_secs_f64());
            roots += all.roots.len();
            if !all.unresolved.is_empty() {
                oracle.doubts(&ray).iter().for_each(|d| *reasons.entry(d.2).or_default() += 1);
            }
        }
    }
    println!("{what}: all hits on one thread, {roots} roots, unresolved {reasons:?}");
    for (stage, (rays, seconds)) in times {
        println!("  {stage:?}: {rays} rays, {:.1} us each", seconds * 1e6 / rays as f64);
    }
    Ok(())
}
