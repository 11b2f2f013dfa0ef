//! What the paper compares itself with, counted against the oracle: `cargo run --release -p isobar-nurbs --example comparators -- [newton|system|tets|all]`.
//!
//! - `newton`: Newton's method along the ray on `f(t) = a(V^-1(r(t)))` between the entry and exit of each element (section 2.2, figure 6), and bisection in its place: *black pixels* are those with a
//!   surface that it does not find.
//! - `system`: the four equations `V(u) = r(t)`, `a(u) = c` in the four unknowns u, v, w, t by subdivision in all four and Newton's method (section 2.2 and 6).
//! - `tets`: marching tetrahedra on a tessellation of about 300,000 tetrahedra (figure 2).
//!
//! The scene is the paper's Figure 6 in kind: 50 tri-cubic Bezier elements, a thick cylinder with a vibration mode, seen from outside. Beside each comparator stands `nurbs/cpu` on the very rays.

mod newton;
mod system;
mod tets;

use isobar_core::{Channels, DVec3, Data, Frame, Function, HexElement, HexPatches, Method, Request, Stop, Surface, View};
use isobar_fields::HexField;
use isobar_fields::hexes_bezier::{Tensor, interpolation};
use isobar_oracle::{Oracles, Root, Truth};
use std::f64::consts::TAU;
use std::sync::Arc;
use std::time::Instant;

type Failure = Box<dyn std::error::Error>;

/// The scene, its isovalue and its view.
pub(crate) struct Scene {
    pub(crate) patches: HexPatches,
    pub(crate) isovalue: f64,
    pub(crate) view: View,
}

/// A tri-cubic element through a map and an attribute at its 64 nodes.
fn element(place: impl Fn([f64; 3]) -> [f64; 4]) -> HexElement {
    let nodes = [0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0];
    let rows = interpolation(&nodes).unwrap_or_default();
    let channel = |c: usize| {
        let values = (0..64)
            .map(|i| place([i % 4, i / 4 % 4, i / 16].map(|i| nodes[i]))[c])
            .collect();
        let counts = [4; 3];
        (0..3)
            .fold(Tensor { counts, values }, |t, axis| {
                t.along(axis, |c| {
                    rows.iter().map(|r| r.iter().zip(c).map(|(a, b)| a * b).sum()).collect()
                })
            })
            .values
    };
    let [x, y, z, a] = [0, 1, 2, 3].map(channel);
    HexElement {
        degree: [3; 3],
        points: (0..64).map(|i| [x[i], y[i], z[i], 1.0]).collect(),
        value_degree: [3; 3],
        values: a.into(),
        rational_value: false,
    }
}

impl Scene {
    /// The cylinder of Table 1, smaller.
    fn cylinder(pixels: usize) -> Result<Self, Failure> {
        let spans = [5, 2, 5];
        let elements: Vec<HexElement> = (0..50)
            .map(|e: usize| {
                let e = [e % 5, e / 5 % 2, e / 10];
                element(|u| {
                    let [u, v, w]: [f64; 3] = std::array::from_fn(|c| (e[c] as f64 + u[c]) / f64::from(spans[c]));
                    let (r, angle) = (0.4 + 0.6 * v, TAU * u);
                    [
                        r * angle.cos(),
                        r * angle.sin(),
                        2.0 * w,
                        (2.0 * angle).cos() * (TAU * w).sin() * (0.5 + v),
                    ]
                })
            })
            .collect();
        Ok(Self {
            patches: HexPatches::new(elements)?,
            isovalue: 0.35,
            view: View::perspective(
                DVec3::new(3.4, 2.1, 2.6),
                DVec3::new(0.0, 0.0, 1.0),
                DVec3::Z,
                40.0,
                pixels,
                pixels,
            ),
        })
    }

    pub(crate) fn surfaces(&self) -> [Surface; 1] {
        [Surface::isovalue(self.isovalue, 0)]
    }

    fn function(&self) -> Result<Arc<dyn Function>, Failure> {
        Ok(Arc::new(HexField::new(&self.patches)?))
    }
}

/// A frame of `nurbs/cpu`.
pub(crate) fn draw(patches: &HexPatches, surfaces: &[Surface], view: &View, layers: usize) -> Result<Frame, Failure> {
    let request = Request {
        channels: Channels::T | Channels::HITS | Channels::CLAIM | Channels::SURFACE,
        layers,
        threads: 2,
        ..Request::default()
    };
    let mut r = isobar_nurbs::NURBS_CPU.open(&request)?;
    r.set_data(&Arc::new(Data::Hexes(patches.clone())))?;
    r.set_surfaces(surfaces)?;
    r.set_view(view)?;
    r.render(&Stop::default())?;
    let mut f = Frame::default();
    r.read(&mut f)?;
    Ok(f)
}

/// All pixels of one comparator against the oracle.
#[derive(Debug, Default)]
struct Count {
    /// Pixels whose truth is certain, and those of them with a surface.
    pixels: usize,
    covered: usize,
    /// Surface there, none found; none there, one found; another root, or farther than a tenth of a pixel from the first.
    black: usize,
    false_hits: usize,
    wrong: usize,
    /// Roots of all layers not found, and found where none is.
    lost: usize,
    invented: usize,
}

impl Count {
    fn new(scene: &Scene, found: &[Vec<f64>], all_layers: bool) -> Result<Self, Failure> {
        let (function, view, surfaces) = (scene.function()?, &scene.view, scene.surfaces());
        let truth = Truth::compute(&function, &surfaces, view, &Stop::default())?;
        let oracles = Oracles::new(&function, &surfaces, &[])?;
        let mut count = Self::default();
        for (i, (p, own)) in truth.pixels.iter().zip(found).enumerate() {
            if p.undecidable {
                continue;
            }
            count.pixels += 1;
            count.covered += usize::from(p.is_hit());
            let near = 0.1 * view.footprint(p.t());
            match (p.is_hit(), own.first()) {
                (true, None) => count.black += 1,
                (false, Some(_)) => count.false_hits += 1,
                (true, Some(t)) if (t - p.t()).abs() > near => count.wrong += 1,
                _ => {}
            }
            if all_layers {
                let ray = view.ray(i % view.width, i / view.width);
                let roots: Vec<Root> = oracles.roots(&ray, f64::INFINITY).0.into_iter().map(|r| r.1).collect();
                let near = |t: f64, r: &Root| r.distance(t) <= 0.1 * view.footprint(t);
                count.lost += roots.iter().filter(|r| !own.iter().any(|&t| near(t, r))).count();
                count.invented += own.iter().filter(|&&t| !roots.iter().any(|r| near(t, r))).count();
            }
        }
        Ok(count)
    }

    fn print(&self, name: &str) {
        println!(
            "{name}: {} pixels, {} with a surface; black {}, false {}, wrong {}; of all roots {} lost, {} invented",
            self.pixels, self.covered, self.black, self.false_hits, self.wrong, self.lost, self.invented
        );
    }
}

/// `nurbs/cpu` on the scene.
fn ours(scene: &Scene) -> Result<(), Failure> {
    let start = Instant::now();
    let f = draw(&scene.patches, &scene.surfaces(), &scene.view, 8)?;
    let wall = start.elapsed();
    let n = scene.view.pixels();
    let found: Vec<Vec<f64>> = (0..n)
        .map(|i| (0..8).map(|l| f.t[l * n + i]).filter(|t| t.is_finite()).collect())
        .collect();
    Count::new(scene, &found, true)?.print(&format!("nurbs/cpu ({:.3} s)", wall.as_secs_f64()));
    Ok(())
}

fn main() -> Result<(), Failure> {
    let which = std::env::args().nth(1).unwrap_or_else(|| "all".into());
    let is = |name: &str| which == name || which == "all";
    if is("newton") {
        let scene = Scene::cylinder(192)?;
        ours(&scene)?;
        for bisect in [false, true] {
            let start = Instant::now();
            let (found, evaluations) = newton::draw_all(&scene, bisect)?;
            let name = if bisect { "bisection" } else { "Newton" };
            let wall = start.elapsed().as_secs_f64();
            let title = format!("{name} on the inverse map ({wall:.2} s, {evaluations} evaluations of V)");
            Count::new(&scene, &found, true)?.print(&title);
        }
    }
    if is("system") {
        // Few pixels: it is that slow.
        let scene = Scene::cylinder(16)?;
        ours(&scene)?;
        let start = Instant::now();
        let (found, subdivisions, hits) = system::draw_all(&scene);
        let title = format!(
            "four equations ({:.2} s, {:.1} subdivisions into 16 parts per hit)",
            start.elapsed().as_secs_f64(),
            subdivisions as f64 / hits.max(1) as f64
        );
        Count::new(&scene, &found, true)?.print(&title);
    }
    if is("tets") {
        let scene = Scene::cylinder(192)?;
        ours(&scene)?;
        for cells in [5, 10] {
            let start = Instant::now();
            let (found, tets, triangles) = tets::draw_first(&scene, cells);
            let title = format!(
                "marching tetrahedra ({tets} tetrahedra, {triangles} triangles, {:.2} s)",
                start.elapsed().as_secs_f64()
            );
            Count::new(&scene, &found, false)?.print(&title);
        }
    }
    Ok(())
}
