//! Figures that are frames.

use crate::Scene;
use crate::common::{self, turn};
use crate::draw::{Failure, GOLD, RED, blank, heat, line, picture, write};
use crate::tets;
use image::{Rgb, RgbImage};
use isobar_core::{
    Channels, Claim, DVec3, Data, Frame, HexElement, HexPatches, Knobs, Method, Request, Sampling, Stop, Surface, SurfaceKind,
    View, to_srgb8,
};
use isobar_nurbs::{NURBS_CPU, NURBS_CPU_PAPER};
use std::path::Path;
use std::sync::Arc;

const SIZE: usize = 384;
/// How far the camera is from the teardrop's element, in half diagonals: all of it is in the picture.
const AWAY: f64 = 2.7;

/// A frame with every channel.
fn frame(
    method: &dyn Method,
    data: &Arc<Data>,
    surfaces: &[Surface],
    view: &View,
    knobs: Knobs,
    sampling: Sampling,
) -> Result<Frame, Failure> {
    let request = Request {
        channels: Channels::all(),
        layers: 6,
        threads: 2,
        knobs,
        sampling,
    };
    let mut r = method.open(&request)?;
    r.set_data(data)?;
    r.set_surfaces(surfaces)?;
    r.set_view(view)?;
    r.render(&Stop::default())?;
    let mut f = Frame::default();
    r.read(&mut f)?;
    Ok(f)
}

pub(crate) fn ours(data: &Arc<Data>, surfaces: &[Surface], view: &View) -> Result<Frame, Failure> {
    frame(&NURBS_CPU, data, surfaces, view, Knobs::default(), Sampling::PixelCentre)
}

fn lucid(c: f64, n: usize, opacity: f32) -> Surface {
    Surface {
        opacity,
        ..Surface::isovalue(c, n)
    }
}

fn patches(data: &Data) -> Result<HexPatches, Failure> {
    match data {
        Data::Hexes(h) => Ok(h.clone()),
        other => Err(format!("{} instead of hexes", other.kind()).into()),
    }
}

pub(crate) fn one(path: &Path) -> Result<(), Failure> {
    let (data, c) = common::teardrop()?;
    let view = turn(&data, 0.12, AWAY, 512);
    write(path, &[picture(&ours(&Arc::new(data), &[Surface::isovalue(c, 0)], &view)?)])
}

/// A frame of triangles with their own normals.
fn marched(data: &Data, c: f64, view: &View, cells: usize) -> Result<RgbImage, Failure> {
    let scene = Scene {
        patches: patches(data)?,
        isovalue: c,
        view: view.clone(),
    };
    let (found, count, triangles) = tets::draw_first(&scene, cells);
    println!("  {count} tetrahedra, {triangles} triangles");
    // Normals by differences of neighbouring hits: the facets as they are seen.
    let at = |x: usize, y: usize| found[y * view.width + x].first().map(|&t| view.ray(x, y).at(t));
    Ok(RgbImage::from_fn(view.width as u32, view.height as u32, |x, y| {
        let (x, y) = (x as usize, y as usize);
        let beside = |dx: usize, dy: usize| {
            let (a, b) = (x.saturating_sub(dx), y.saturating_sub(dy));
            at(a, b).or_else(|| at((x + dx).min(view.width - 1), (y + dy).min(view.height - 1)))
        };
        let Some(p) = at(x, y) else { return Rgb([255; 3]) };
        let normal = match (beside(1, 0), beside(0, 1)) {
            (Some(a), Some(b)) => (a - p).cross(b - p).normalize_or(DVec3::Z),
            _ => DVec3::Z,
        };
        let shade = 0.15 + 0.85 * normal.dot(view.ray(x, y).direction.normalize()).abs() as f32;
        Rgb(to_srgb8([shade * 0.8, shade * 0.8, shade * 0.8, 1.0]))
    }))
}

pub(crate) fn two(path: &Path) -> Result<(), Failure> {
    let (data, c) = common::teardrop()?;
    let view = turn(&data, 0.12, AWAY, SIZE);
    let tets = marched(&data, c, &view, 37)?;
    let own = patches(&data)?;
    let data = Arc::new(data);
    let direct = picture(&ours(&data, &[Surface::isovalue(c, 0)], &view)?);
    let half = Surface {
        kind: SurfaceKind::Parameter { axis: 0, value: 0.5 },
        ..Surface::isovalue(0.0, 0)
    };
    let cut = ours(&data, &[half], &view)?;
    let field = isobar_fields::HexField::new(&own)?;
    // The attribute on the surface u = 1/2: blue below the isovalue, red above, by its logarithm.
    let field = RgbImage::from_fn(SIZE as u32, SIZE as u32, |x, y| {
        let i = y as usize * SIZE + x as usize;
        if !cut.t[i].is_finite() {
            return Rgb([255; 3]);
        }
        let v = isobar_core::Function::value(&field, cut.point[i]) - c;
        let t = (1.0 - (v.abs() * 30.0).ln_1p() / 5.0).clamp(0.0, 1.0);
        let low = (255.0 * t) as u8;
        if v > 0.0 { Rgb([255, low, low]) } else { Rgb([low, low, 255]) }
    });
    write(path, &[tets, direct, field])
}

pub(crate) fn three(path: &Path) -> Result<(), Failure> {
    let (data, c) = common::silicium()?;
    let view = turn(&data, 0.1, 1.9, SIZE);
    let Data::Grid(g) = common::shared("structured/silicium_98x34x34.nhdr")? else {
        return Err("no grid".into());
    };
    let linear = Data::Hexes(isobar_fields::grid_to_hexes(&g)?);
    let tets = marched(&linear, c, &view, 1)?;
    write(
        path,
        &[tets, picture(&ours(&Arc::new(data), &[Surface::isovalue(c, 0)], &view)?)],
    )
}

pub(crate) fn six(path: &Path) -> Result<(), Failure> {
    let (data, c) = common::cylinder()?;
    let view = turn(&data, 0.08, 2.4, SIZE);
    let own = patches(&data)?;
    let data = Arc::new(data);
    let exact = ours(&data, &[Surface::isovalue(c, 0)], &view)?;
    let mut newton = picture(&exact);
    let boundary = Surface {
        kind: SurfaceKind::Boundary,
        opacity: 0.5,
        ..Surface::isovalue(0.0, 0)
    };
    // Newton's method on f(t) from the middle of each stay in an element, as printed in section 2.2.
    let n = SIZE * SIZE;
    let mut found = vec![false; n];
    for e in own.elements.iter() {
        let single = Arc::new(Data::Hexes(HexPatches::new(vec![e.clone()])?));
        let f = ours(&single, &[boundary], &view)?;
        for (i, found) in found.iter_mut().enumerate() {
            let ends: Vec<f64> = (0..6).map(|l| f.t[l * n + i]).filter(|t| t.is_finite()).collect();
            let ray = view.ray(i % SIZE, i / SIZE);
            *found |= ends.chunks_exact(2).any(|s| newton_finds(e, c, &ray, (s[0], s[1])));
        }
    }
    let mut black = 0;
    for (i, found) in found.iter().enumerate() {
        if exact.hits[i] > 0 && !found {
            black += 1;
            newton.put_pixel((i % SIZE) as u32, (i / SIZE) as u32, RED);
        }
    }
    println!(
        "  {black} black of {} pixels",
        exact.hits[..n].iter().filter(|&&h| h > 0).count()
    );
    write(path, &[newton, picture(&exact)])
}

fn newton_finds(e: &HexElement, c: f64, ray: &isobar_core::Ray, (from, to): (f64, f64)) -> bool {
    let (mut t, mut u) = (0.5 * (from + to), DVec3::splat(0.5));
    for _ in 0..20 {
        let x = ray.at(t);
        let mut p = isobar_fields::evaluate_hex(e, u);
        for _ in 0..20 {
            if (p.position - x).length() < 1e-12 {
                break;
            }
            u = (u - p.jacobian.inverse() * (p.position - x)).clamp(DVec3::splat(-0.5), DVec3::splat(1.5));
            p = isobar_fields::evaluate_hex(e, u);
        }
        let step = (p.value - c) / p.gradient().dot(ray.direction);
        if !step.is_finite() || (p.position - x).length() > 1e-9 {
            return false;
        }
        if step.abs() < 1e-10 * (to - from) {
            return true;
        }
        t -= step;
        if !(from..=to).contains(&t) {
            return false;
        }
    }
    false
}

/// A bent ball and its bent box.
fn ball() -> Result<Arc<Data>, Failure> {
    let own = |u: [f64; 3]| u.map(|u| 2.0 * u - 1.0);
    let place = |u: [f64; 3]| {
        let [x, y, z] = own(u);
        DVec3::new(x + 0.2 * y * y, y + 0.1 * x * z, z)
    };
    let value = |u: [f64; 3]| own(u).iter().map(|x| x * x).sum();
    Ok(Arc::new(Data::Hexes(common::lattice([1; 3], 3, place, value)?)))
}

pub(crate) fn eight(path: &Path) -> Result<(), Failure> {
    const PIXELS: usize = 24;
    const EACH: usize = 24;
    let data = ball()?;
    let view = turn(&data, 0.1, 2.2, PIXELS);
    let fine = turn(&data, 0.1, 2.2, PIXELS * EACH);
    let surfaces = [Surface::isovalue(0.5, 0)];
    let coarse = frame(&NURBS_CPU, &data, &surfaces, &view, Knobs::default(), Sampling::PixelFrustum)?;
    let fine = ours(&data, &surfaces, &fine)?;
    let mut out = picture(&fine);
    let mut counts = [0; 3];
    for i in 0..PIXELS * PIXELS {
        let (x, y) = (i % PIXELS * EACH, i / PIXELS * EACH);
        let hits = |n: usize| fine.hits[(y + n / EACH) * PIXELS * EACH + x + n % EACH];
        let whole = (0..EACH * EACH).all(|n| hits(n) > 0 && hits(n) == hits(0));
        let kind = match (coarse.hits[i] > 0, coarse.claim[i].contains(Claim::COVERED)) {
            (true, _) if whole => 0,
            (true, _) => 1,
            (false, true) => 2,
            _ => continue,
        };
        counts[kind] += 1;
        let colour = [Rgb([70, 110, 230]), Rgb([20, 140, 60]), GOLD][kind];
        for n in 0..EACH * EACH {
            let p = out.get_pixel_mut((x + n % EACH) as u32, (y + n / EACH) as u32);
            (0..3).for_each(|c| p.0[c] = ((u16::from(p.0[c]) + u16::from(colour.0[c])) / 2) as u8);
        }
    }
    let end = (PIXELS * EACH) as f64;
    for i in 0..=PIXELS {
        let at = (i * EACH) as f64;
        line(&mut out, (at, 0.0), (at, end), Rgb([200; 3]));
        line(&mut out, (0.0, at), (end, at), Rgb([200; 3]));
    }
    println!("  types 1, 2, 3: {counts:?} pixels");
    write(path, &[out])
}

pub(crate) fn twelve(path: &Path) -> Result<(), Failure> {
    let (torso, _) = common::torso()?;
    let view = turn(&torso, 0.15, 1.7, SIZE);
    let layers = [lucid(2.6, 0, 1.0), lucid(1.5, 1, 0.4), lucid(-0.6, 2, 0.7)];
    let left = picture(&ours(&Arc::new(torso), &layers, &view)?);
    let (flow, c) = common::cfd()?;
    let view = turn(&flow, 0.15, 1.7, SIZE);
    let right = picture(&ours(&Arc::new(flow), &[Surface::isovalue(c, 0)], &view)?);
    write(path, &[left, right])
}

pub(crate) fn fourteen(path: &Path) -> Result<(), Failure> {
    const PIXELS: usize = 128;
    let (data, c) = common::teardrop()?;
    let view = turn(&data, 0.12, AWAY, PIXELS);
    let data = Arc::new(data);
    let mut panels = Vec::new();
    for bounds in ["aabb", "obb"] {
        let knobs = Knobs::default().with("bounds", bounds);
        let f = frame(
            &NURBS_CPU_PAPER,
            &data,
            &[lucid(c, 0, 0.5)],
            &view,
            knobs,
            Sampling::PixelCentre,
        )?;
        let (most, sum) = f.work.iter().fold((0, 0u64), |(m, s), &w| (w.max(m), s + u64::from(w)));
        println!(
            "  {bounds}: most {most}, mean {:.2} per pixel; the scale ends at 100",
            sum as f64 / f.work.len() as f64
        );
        let map = heat(&f.work, PIXELS, 100);
        panels.push(image::imageops::resize(
            &map,
            SIZE as u32,
            SIZE as u32,
            image::imageops::FilterType::Nearest,
        ));
    }
    write(path, &panels)
}

pub(crate) fn type3(path: &Path) -> Result<(), Failure> {
    const PIXELS: usize = 48;
    let data = ball()?;
    let view = turn(&data, 0.1, 2.4, PIXELS);
    let surfaces = [Surface::isovalue(0.5, 0)];
    let of = |method: &dyn Method, sampling| frame(method, &data, &surfaces, &view, Knobs::default(), sampling);
    let (centres, frusta) = (
        of(&NURBS_CPU, Sampling::PixelCentre)?,
        of(&NURBS_CPU, Sampling::PixelFrustum)?,
    );
    let printed = of(&NURBS_CPU_PAPER, Sampling::PixelFrustum)?;
    let mark = |yes: &dyn Fn(usize) -> bool| {
        let mut p = picture(&centres);
        for i in (0..PIXELS * PIXELS).filter(|&i| centres.hits[i] == 0 && yes(i)) {
            p.put_pixel((i % PIXELS) as u32, (i / PIXELS) as u32, GOLD);
        }
        image::imageops::resize(&p, SIZE as u32, SIZE as u32, image::imageops::FilterType::Nearest)
    };
    let covered = |i: usize| frusta.claim[i].contains(Claim::COVERED);
    let shown = |i: usize| printed.hits[i] > 0;
    let count = |yes: &dyn Fn(usize) -> bool| (0..PIXELS * PIXELS).filter(|&i| centres.hits[i] == 0 && yes(i)).count();
    println!(
        "  COVERED {}, shown by Q {}, both {}",
        count(&covered),
        count(&shown),
        count(&|i| covered(i) && shown(i))
    );
    write(path, &[mark(&|_| false), mark(&covered), mark(&shown)])
}

pub(crate) fn transparency(path: &Path) -> Result<(), Failure> {
    let (data, c) = common::cylinder()?;
    let view = turn(&data, 0.08, 2.4, 512);
    let boundary = Surface {
        kind: SurfaceKind::Boundary,
        opacity: 0.12,
        ..Surface::isovalue(0.0, 2)
    };
    let f = ours(&Arc::new(data), &[lucid(c, 0, 0.6), lucid(-c, 1, 0.6), boundary], &view)?;
    println!("  at most {} layers", f.hits.iter().max().unwrap_or(&0));
    write(path, &[picture(&f)])
}

pub(crate) fn cell(path: &Path) -> Result<(), Failure> {
    let corner = |n: usize| [(n & 1) as f64, (n >> 1 & 1) as f64, (n >> 2) as f64, 1.0];
    let e = HexElement {
        degree: [1; 3],
        points: (0..8).map(corner).collect(),
        value_degree: [2, 0, 0],
        values: [0.0, 1.5, 0.0].into(),
        rational_value: false,
    };
    let data = Arc::new(Data::Hexes(HexPatches::new(vec![e])?));
    let view = turn(&data, 0.1, 3.0, 256);
    let boundary = Surface {
        kind: SurfaceKind::Boundary,
        opacity: 0.15,
        ..Surface::isovalue(0.0, 2)
    };
    let mut panels = Vec::new();
    for c in [0.9, 0.7] {
        let alone = ours(&data, &[Surface::isovalue(c, 0)], &view)?;
        println!("  {c}: {} pixels hit", alone.hits.iter().filter(|&&h| h > 0).count());
        panels.push(picture(&ours(&data, &[Surface::isovalue(c, 0), boundary], &view)?));
    }
    panels.push(blank(8, 256));
    write(path, &panels)
}
