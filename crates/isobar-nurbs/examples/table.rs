//! Table 1 of the paper on our data: `cargo run --release -p isobar-nurbs --example table -- [CLASS|all] [views] [corrected|obb|aabb|pca] [ISOVALUE]`.
//!
//! Seven classes (cylinder, bimba, teardrop, silicium, vishuman, torso, cfd), 512x512, a turn about z in as many views (36), all hits, 2 threads. The distance of the
//! camera is chosen so that the mean number of hits per frame reaches the paper's column. Prints wall and CPU time (both threads) per frame and subdivisions per hit, beside the
//! paper's. The words obb, aabb, pca take the form as printed with that bounding volume, at the distance of the corrected form.

use isobar_core::{Channels, DVec3, Data, HexElement, HexPatches, Knobs, Method, RenderError, Request, Stop, Surface, View};
use isobar_fields::hexes_bezier::{Tensor, interpolation};
use isobar_fields::{Kind, refine_hexes, spline_to_hexes};
use rustix::time::{ClockId, clock_gettime};
use std::f64::consts::TAU;
use std::path::Path;
use std::sync::Arc;

/// A class: name, data, isovalue, the paper's hits per frame, time (OBB, 32 cores), subdivisions.
struct Class {
    name: &'static str,
    make: fn() -> Made,
    hits: f64,
    seconds: f64,
    subdivisions: f64,
}

const CLASSES: [Class; 7] = [
    Class {
        name: "cylinder",
        make: cylinder,
        hits: 57_408.0,
        seconds: 0.15,
        subdivisions: 299_790.0,
    },
    Class {
        name: "bimba",
        make: bimba,
        hits: 273_024.0,
        seconds: 0.27,
        subdivisions: 463_281.0,
    },
    Class {
        name: "teardrop",
        make: teardrop,
        hits: 56_078.0,
        seconds: 0.65,
        subdivisions: 371_304.0,
    },
    Class {
        name: "vishuman",
        make: vishuman,
        hits: 51_625.0,
        seconds: 0.40,
        subdivisions: 278_317.0,
    },
    Class {
        name: "silicium",
        make: silicium,
        hits: 95_425.0,
        seconds: 0.43,
        subdivisions: 356_862.0,
    },
    Class {
        name: "torso",
        make: torso,
        hits: 123_084.0,
        seconds: 0.83,
        subdivisions: 3_502_902.0,
    },
    Class {
        name: "cfd",
        make: cfd,
        hits: 631_342.0,
        seconds: 0.77,
        subdivisions: 2_016_399.0,
    },
];

type Made = Result<(Data, f64), Box<dyn std::error::Error>>;

fn shared(file: &str) -> Result<Data, Box<dyn std::error::Error>> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data").join(file);
    Ok(isobar_io::load(&path, &isobar_io::Options::default())?.data)
}

/// Coefficients of the polynomial of degree n per axis through values at i/n.
fn interpolate(n: usize, f: impl Fn([f64; 3]) -> f64) -> Vec<f64> {
    let nodes: Vec<f64> = (0..=n).map(|i| i as f64 / n as f64).collect();
    let rows = interpolation(&nodes).unwrap_or_default();
    let counts = [n + 1; 3];
    let values = (0..counts.iter().product())
        .map(|i: usize| f([i % (n + 1), i / (n + 1) % (n + 1), i / (n + 1) / (n + 1)].map(|i| nodes[i])))
        .collect();
    (0..3)
        .fold(Tensor { counts, values }, |t, axis| {
            t.along(axis, |c| {
                rows.iter().map(|r| r.iter().zip(c).map(|(a, b)| a * b).sum()).collect()
            })
        })
        .values
}

/// Tri-cubic elements through a map and an attribute, on a lattice of parameters.
fn lattice(
    spans: [usize; 3],
    n: usize,
    x: impl Fn([f64; 3]) -> DVec3,
    a: impl Fn([f64; 3]) -> f64,
) -> Result<HexPatches, isobar_core::DataError> {
    let elements: Vec<HexElement> = (0..spans.iter().product())
        .map(|e: usize| {
            let e = [e % spans[0], e / spans[0] % spans[1], e / spans[0] / spans[1]];
            let global = |u: [f64; 3]| [0, 1, 2].map(|c| (e[c] as f64 + u[c]) / spans[c] as f64);
            let [px, py, pz] = [0, 1, 2].map(|c| interpolate(n, |u| x(global(u))[c]));
            HexElement {
                degree: [n as u8; 3],
                points: (0..px.len()).map(|i| [px[i], py[i], pz[i], 1.0]).collect(),
                value_degree: [n as u8; 3],
                values: interpolate(n, |u| a(global(u))).into(),
                rational_value: false,
            }
        })
        .collect();
    HexPatches::new(elements)
}

/// A thick cylinder with a vibration mode, tri-cubic, 5 x 2 x 5 elements.
fn cylinder() -> Made {
    let place = |[u, v, w]: [f64; 3]| DVec3::new((TAU * u).cos() * (0.4 + 0.6 * v), (TAU * u).sin() * (0.4 + 0.6 * v), 2.0 * w);
    let mode = |[u, v, w]: [f64; 3]| (2.0 * TAU * u).cos() * (TAU * w).sin() * (0.5 + v);
    Ok((Data::Hexes(lattice([5, 2, 5], 3, place, mode)?), 0.35))
}

/// Rational tri-cubic NURBS of about 10^4 elements: the horseshoe cut twice along its parameters.
fn bimba() -> Made {
    let Data::Hexes(h) = shared("nurbs/horseshoe_iga.json")? else {
        return Err("no elements".into());
    };
    let mut h = h;
    while h.elements.len() < 3500 {
        h = refine_hexes(&h)?;
    }
    Ok((Data::Hexes(h), 0.2))
}

/// The teardrop on one deformed triquintic element.
fn teardrop() -> Made {
    let f = |[x, y, z]: [f64; 3]| 0.5 * x.powi(5) + 0.5 * x.powi(4) - y * y - z * z;
    let own = |u: [f64; 3]| u.map(|u| 2.5 * u - 1.25);
    let place = |u: [f64; 3]| {
        let [x, y, z] = own(u);
        DVec3::new(x + 0.25 * y * y, y + 0.2 * x * x - 0.15 * x * z, z + 0.2 * x * y)
    };
    Ok((Data::Hexes(lattice([1; 3], 5, place, |u| f(own(u)))?), 0.0))
}

fn silicium() -> Made {
    let Data::Grid(g) = shared("structured/silicium_98x34x34.nhdr")? else {
        return Err("no grid".into());
    };
    Ok((Data::Hexes(spline_to_hexes(&g, Kind::CubicInterpolating)?), 130.0))
}

fn vishuman() -> Made {
    Ok((shared("structured/ch2_colin27_t1.nii.gz")?, 60.0))
}

/// A bent 132^3 grid of trilinear elements with the field of a few charges.
fn torso() -> Made {
    const N: usize = 132;
    let charges = [
        ([0.3, 0.4, 0.6], 1.0),
        ([0.7, 0.5, 0.3], -0.8),
        ([0.5, 0.7, 0.7], 0.6),
        ([0.4, 0.2, 0.3], -0.5),
    ];
    let value = |u: [f64; 3]| {
        charges
            .iter()
            .map(|(c, q): &([f64; 3], f64)| q / ((0..3).map(|i| (u[i] - c[i]).powi(2)).sum::<f64>() + 0.01).sqrt())
            .sum::<f64>()
    };
    let place = |[u, v, w]: [f64; 3]| {
        let (r, t) = (1.0 + 0.5 * u, 1.2 * v);
        DVec3::new(r * t.cos() + 0.05 * (7.0 * w).sin(), r * t.sin(), w + 0.1 * u * v)
    };
    let at = |i: usize, j: usize, k: usize| [i, j, k].map(|i| i as f64 / N as f64);
    let elements: Vec<HexElement> = (0..N * N * N)
        .map(|e| {
            let (i, j, k) = (e % N, e / N % N, e / N / N);
            let corner = |n: usize| at(i + (n & 1), j + (n >> 1 & 1), k + (n >> 2));
            HexElement {
                degree: [1; 3],
                points: (0..8).map(|n| place(corner(n))).map(|p| [p.x, p.y, p.z, 1.0]).collect(),
                value_degree: [1; 3],
                values: (0..8).map(|n| value(corner(n))).collect(),
                rational_value: false,
            }
        })
        .collect();
    Ok((Data::Hexes(HexPatches::new(elements)?), 1.5))
}

fn cfd() -> Made {
    let Data::Hexes(h) = shared("highorder/laghos_q2.vtu")? else {
        return Err("no elements".into());
    };
    Ok((Data::Hexes(refine_hexes(&h)?), 1.05))
}

/// View n of a turn about z, from `distance` half diagonals.
fn turn(data: &Data, n: f64, distance: f64) -> View {
    let (lo, hi) = data.bounds();
    let (centre, radius) = ((lo + hi) * 0.5, (hi - lo).length() * 0.5);
    let (s, c) = (TAU * n).sin_cos();
    let eye = centre + DVec3::new(c, s, 0.35).normalize() * (radius * distance);
    View::perspective(eye, centre, DVec3::Z, 40.0, 512, 512)
}

fn cpu_seconds() -> f64 {
    let t = clock_gettime(ClockId::ProcessCPUTime);
    t.tv_sec as f64 + t.tv_nsec as f64 * 1e-9
}

/// What one method does with a class.
struct Scene {
    renderer: Box<dyn isobar_core::Renderer>,
    data: Arc<Data>,
}

/// Of one frame: wall and CPU seconds, counters.
type Drawn = (f64, f64, Vec<(&'static str, u64)>);

impl Scene {
    fn open(method: &dyn Method, knobs: Knobs, data: &Arc<Data>, isovalue: f64) -> Result<Self, RenderError> {
        let request = Request {
            channels: Channels::T
                | Channels::NORMAL
                | Channels::SURFACE
                | Channels::RGBA
                | Channels::HITS
                | Channels::CLAIM
                | Channels::T_ERROR,
            layers: 4,
            threads: 2,
            knobs,
            ..Request::default()
        };
        let mut renderer = method.open(&request)?;
        renderer.set_data(data)?;
        renderer.set_surfaces(&[Surface {
            opacity: 0.5,
            ..Surface::isovalue(isovalue, 0)
        }])?;
        Ok(Self {
            renderer,
            data: Arc::clone(data),
        })
    }

    fn draw(&mut self, n: f64, distance: f64) -> Result<Drawn, RenderError> {
        self.renderer.set_view(&turn(&self.data, n, distance))?;
        let start = cpu_seconds();
        let time = self.renderer.render(&Stop::default())?;
        Ok((time.wall.as_secs_f64(), cpu_seconds() - start, self.renderer.counters().0))
    }
}

fn counter(list: &[(&'static str, u64)], name: &str) -> f64 {
    list.iter().find(|c| c.0 == name).map_or(0.0, |c| c.1 as f64)
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let argument = |n: usize, default: &str| std::env::args().nth(n).unwrap_or_else(|| default.into());
    let (which, views, form) = (
        argument(1, "all"),
        argument(2, "36").parse::<usize>()?,
        argument(3, "corrected"),
    );
    for class in CLASSES.iter().filter(|c| which == "all" || c.name == which) {
        if let Err(e) = row(class, views, &form, std::env::args().nth(4).as_deref()) {
            println!("{} {form}: {e}", class.name);
        }
    }
    Ok(())
}

/// One row of the table.
fn row(class: &Class, views: usize, form: &str, isovalue: Option<&str>) -> Result<(), Box<dyn std::error::Error>> {
    let (data, usual) = (class.make)()?;
    let isovalue = isovalue.map_or(Ok(usual), str::parse)?;
    let data = Arc::new(data);
    // What grids are made of: a tri-cubic spline through the samples, as the paper's volumes.
    let cubic = Knobs::default().with("reconstruction", "cubic-interpolating");
    let mut scene = Scene::open(&isobar_nurbs::NURBS_CPU, cubic.clone(), &data, isovalue)?;
    // The distance by bisection, on four views.
    // Nearer than that the eye leaves parts of the surface behind.
    let (mut near, mut far) = (0.8f64, 12.0f64);
    for _ in 0..7 {
        let middle = (near * far).sqrt();
        let mut hits = 0.0;
        for k in 0..4 {
            hits += counter(&scene.draw(0.03 + f64::from(k) * 0.25, middle)?.2, "hits") / 4.0;
        }
        if hits > class.hits { near = middle } else { far = middle }
    }
    let distance = (near * far).sqrt();
    if form != "corrected" {
        let knobs = cubic.with("bounds", form);
        scene = Scene::open(&isobar_nurbs::NURBS_CPU_PAPER, knobs, &data, isovalue)?;
    }
    let (mut wall, mut cpu, mut sums) = (0.0, 0.0, Vec::<(&'static str, u64)>::new());
    for n in 0..views {
        let (w, c, counters) = scene.draw(n as f64 / views as f64, distance)?;
        (wall, cpu) = (wall + w, cpu + c);
        if sums.is_empty() {
            sums = counters;
        } else {
            sums.iter_mut().zip(counters).for_each(|(a, b)| a.1 += b.1);
        }
    }
    let (n, hits) = (views as f64, counter(&sums, "hits"));
    println!(
        "{} {form}: hits/frame {:.0} (paper {:.0}), distance {distance:.3}; wall {:.3} s, CPU {:.3} s (paper {:.2} s on 32 cores); \
         subdivisions/hit {:.2}, polynomials/hit {:.2} (paper, OBB, subdivisions/hit {:.1})",
        class.name,
        hits / n,
        class.hits,
        wall / n,
        cpu / n,
        class.seconds,
        counter(&sums, "subdivisions") / hits,
        counter(&sums, "polynomials") / hits,
        class.subdivisions / class.hits,
    );
    let (lists, sizes) = (counter(&sums, "lists"), counter(&sums, "list entries"));
    if lists > 0.0 {
        let mean = sizes / lists;
        let deviation = (counter(&sums, "squares of list sizes") / lists - mean * mean).sqrt();
        println!("  list size {mean:.2} / {deviation:.2}");
    }
    println!("  sums over the frames {sums:?}; {:?}", scene.renderer.memory());
    Ok(())
}
