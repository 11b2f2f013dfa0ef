//! Figures of the spaces of parameters and of (alpha, beta, gamma), and of a ray.

use crate::common::{self, turn};
use crate::draw::{BLACK, BLUE, Failure, GOLD, GREEN, GREY, Oblique, RED, blank, dot, line, write};
use crate::scenes::ours;
use isobar_core::{Data, HexElement, Surface, View};
use isobar_fields::evaluate_hex;
use isobar_nurbs::paper_trace::{roots, trace};
use std::path::Path;
use std::sync::Arc;

const SIZE: usize = 384;
const PIXELS: usize = 256;

/// The teardrop, its isovalue, its view, and the pixel with the most roots.
fn scene() -> Result<(HexElement, f64, View, [usize; 2]), Failure> {
    let (data, c) = common::teardrop()?;
    let view = turn(&data, 0.12, 1.9, PIXELS);
    let surface = Surface {
        opacity: 0.5,
        ..Surface::isovalue(c, 0)
    };
    let Data::Hexes(h) = &data else {
        return Err("no element".into());
    };
    let e = h.elements[0].clone();
    let frame = ours(&Arc::new(data), &[surface], &view)?;
    let at = (0..PIXELS * PIXELS).max_by_key(|&i| frame.hits[i]).unwrap_or(0);
    let pixel = [at % PIXELS, at / PIXELS];
    println!("  pixel {pixel:?} with {} roots", frame.hits[at]);
    Ok((e, c, view, pixel))
}

/// The faces of an element as lines of a lattice, mapped.
fn wires(map: &dyn Fn([f64; 3]) -> [f64; 3]) -> Vec<Vec<[f64; 3]>> {
    let mut out = Vec::new();
    for axis in 0..3 {
        for side in [0.0, 1.0] {
            for i in 0..=6 {
                for across in 0..2 {
                    let (a, b) = ((axis + 1 + across) % 3, (axis + 2 - across) % 3);
                    let curve = (0..=48).map(|j| {
                        let mut u = [0.0; 3];
                        (u[axis], u[a], u[b]) = (side, f64::from(i) / 6.0, f64::from(j) / 48.0);
                        map(u)
                    });
                    out.push(curve.collect());
                }
            }
        }
    }
    out
}

fn curves(p: &mut image::RgbImage, look: &Oblique, list: &[Vec<[f64; 3]>], colour: image::Rgb<u8>) {
    for c in list {
        for w in c.windows(2) {
            line(p, look.at(w[0]), look.at(w[1]), colour);
        }
    }
}

pub(crate) fn nine(path: &Path) -> Result<(), Failure> {
    let (e, c, view, pixel) = scene()?;
    let ray = view.ray(pixel[0], pixel[1]);
    let world = |u: [f64; 3]| evaluate_hex(&e, u.into()).position.to_array();
    let list = wires(&world);
    let look = Oblique::about(list.iter().flatten(), SIZE);
    let mut left = blank(SIZE, SIZE);
    curves(&mut left, &look, &list, GREY);
    let found = roots(std::slice::from_ref(&e), c, &view, pixel, "obb")?.1;
    if let (Some(first), Some(last)) = (found.first(), found.last()) {
        let (a, b) = (ray.at(first.0 - 1.5), ray.at(last.0 + 1.5));
        line(&mut left, look.at(a.to_array()), look.at(b.to_array()), BLUE);
    }
    for (t, _) in &found {
        dot(&mut left, look.at(ray.at(*t).to_array()), 4, RED);
    }
    // P of the whole element by its net, as the solver has it.
    let whole = trace(&e, c, &view, pixel, "obb", 0);
    let part = whole.first().and_then(|l| l.first()).ok_or("no part")?;
    let mapped = |u: [f64; 3]| {
        let mut net: Vec<[f64; 3]> = part.net.clone();
        let n = part.counts;
        // de Casteljau along each axis in turn.
        for (axis, u) in u.iter().enumerate() {
            let stride: usize = n[..axis].iter().product();
            for r in 1..n[axis] {
                for i in 0..net.len() {
                    if i / stride % n[axis] < n[axis] - r {
                        let next = net[i + stride];
                        (0..3).for_each(|k| net[i][k] += (next[k] - net[i][k]) * u);
                    }
                }
            }
        }
        net[0]
    };
    let list = wires(&mapped);
    let origin = [[0.0; 3]];
    let look = Oblique::about(list.iter().flatten().chain(&origin), SIZE);
    let mut right = blank(SIZE, SIZE);
    curves(&mut right, &look, &list, GREY);
    dot(&mut right, look.at([0.0; 3]), 5, RED);
    write(path, &[left, right])
}

pub(crate) fn ten(path: &Path) -> Result<(), Failure> {
    const LEVEL: usize = 5;
    let (e, c, view, pixel) = scene()?;
    let unit: Vec<[f64; 3]> = (0..8).map(|n| [n & 1, n >> 1 & 1, n >> 2].map(f64::from)).collect();
    let mut panels = Vec::new();
    for bounds in ["aabb", "obb"] {
        let lists = trace(&e, c, &view, pixel, bounds, 8);
        let sizes: Vec<usize> = lists.iter().map(Vec::len).collect();
        println!("  {bounds}: {sizes:?} parts at levels 0 to 8");
        let mut p = blank(SIZE, SIZE);
        let look = Oblique::about(unit.iter(), SIZE);
        look.cuboid(&mut p, &std::array::from_fn(|n| unit[n]), GREY);
        for part in lists.get(LEVEL).into_iter().flatten() {
            let corner = |n: usize| [0, 1, 2].map(|a| part.lo[a] + part.size * unit[n][a]);
            look.cuboid(&mut p, &std::array::from_fn(corner), RED);
        }
        panels.push(p);
    }
    write(path, &panels)
}

pub(crate) fn eleven(path: &Path) -> Result<(), Failure> {
    let (e, c, view, pixel) = scene()?;
    let lists = trace(&e, c, &view, pixel, "obb", 12);
    // Up from a part of the last list.
    let last = lists.last().and_then(|l| l.first()).ok_or("no part")?.lo;
    let chain: Vec<_> = lists
        .iter()
        .filter_map(|l| {
            let holds = |lo: [f64; 3], size: f64| (0..3).all(|a| lo[a] <= last[a] && last[a] < lo[a] + size);
            l.iter().find(|p| holds(p.lo, p.size))
        })
        .collect();
    let panels: Vec<_> = [1, 4]
        .iter()
        .map(|&from| {
            let own = &chain[from.min(chain.len() - 1)..(from + 4).min(chain.len())];
            let look = Oblique::about(own.iter().flat_map(|p| &p.volume), SIZE);
            let mut p = blank(SIZE, SIZE);
            for (part, colour) in own.iter().zip([GREY, GOLD, GREEN, BLUE]) {
                look.cuboid(&mut p, &part.volume, colour);
            }
            dot(&mut p, look.at([0.0; 3]), 4, RED);
            p
        })
        .collect();
    write(path, &panels)
}

pub(crate) fn thirteen(path: &Path) -> Result<(), Failure> {
    let (e, c, view, pixel) = scene()?;
    let (w, h) = (640, SIZE);
    let mut p = blank(w, h);
    let (all, kept) = roots(std::slice::from_ref(&e), c, &view, pixel, "aabb")?;
    println!("  {} roots by Newton's method, {} after the filter", all.len(), kept.len());
    let (Some(first), Some(last)) = (all.first(), all.last()) else {
        return Err("no roots".into());
    };
    let room = 0.35 * (last.0 - first.0).max(0.2);
    let (t0, t1) = (first.0 - room, last.0 + room);
    let field = isobar_fields::HexField::new(&isobar_core::HexPatches::new(vec![e])?)?;
    let ray = view.ray(pixel[0], pixel[1]);
    let value = |t: f64| isobar_core::Function::value(&field, ray.at(t)) - c;
    let samples: Vec<(f64, f64)> = (0..w)
        .map(|x| t0 + (t1 - t0) * x as f64 / w as f64)
        .map(|t| (t, value(t)))
        .collect();
    let most = samples
        .iter()
        .map(|s| s.1.abs())
        .filter(|v| v.is_finite())
        .fold(1e-300, f64::max);
    // By the root of its size, so that shallow parts are seen.
    let y = |v: f64| 0.5 * h as f64 - 0.46 * h as f64 * v.signum() * (v.abs() / most).sqrt();
    let x = |t: f64| (t - t0) / (t1 - t0) * w as f64;
    line(&mut p, (0.0, y(0.0)), (w as f64, y(0.0)), GREY);
    for s in samples.windows(2).filter(|s| s[0].1.is_finite() && s[1].1.is_finite()) {
        line(&mut p, (x(s[0].0), y(s[0].1)), (x(s[1].0), y(s[1].1)), BLACK);
    }
    all.iter().for_each(|r| dot(&mut p, (x(r.0), y(0.0)), 6, GOLD));
    kept.iter().for_each(|r| dot(&mut p, (x(r.0), y(0.0)), 3, RED));
    write(path, &[p])
}
