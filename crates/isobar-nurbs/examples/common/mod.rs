//! The classes of Table 1 with our data.
#![allow(dead_code, reason = "each example uses a part")]

use isobar_core::{DVec3, Data, HexElement, HexPatches, Stage, View};
use isobar_fields::hexes_bezier::{Tensor, interpolation, split};
use isobar_fields::{Kind, refine_hexes, spline_to_hexes};
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

/// A class: name, data, isovalue, the paper's hits per frame, time (OBB, 32 cores), subdivisions.
pub(crate) struct Class {
    pub(crate) name: &'static str,
    pub(crate) make: fn() -> Made,
    /// Isovalues drawn beside that of the data, where one surface has fewer hits than the paper's from any distance.
    pub(crate) more: &'static [f64],
    pub(crate) hits: f64,
    pub(crate) seconds: f64,
    pub(crate) subdivisions: f64,
    /// With axis-aligned boxes; mean list size of both.
    pub(crate) aabb: f64,
    pub(crate) lists: [&'static str; 2],
}

pub(crate) const CLASSES: [Class; 7] = [
    Class {
        name: "cylinder",
        make: cylinder,
        more: &[],
        hits: 57_408.0,
        seconds: 0.15,
        subdivisions: 299_790.0,
        aabb: 667_000.0,
        lists: ["1.89/1.03", "2.70/2.56"],
    },
    Class {
        name: "bimba",
        make: bimba,
        more: &[-0.3],
        hits: 273_024.0,
        seconds: 0.27,
        subdivisions: 463_281.0,
        aabb: 2_090_467.0,
        lists: ["1.17/0.49", "1.58/5.42"],
    },
    Class {
        name: "teardrop",
        make: teardrop,
        more: &[],
        hits: 56_078.0,
        seconds: 0.65,
        subdivisions: 371_304.0,
        aabb: 1_007_734.0,
        lists: ["3.54/1.44", "6.14/3.46"],
    },
    Class {
        name: "vishuman",
        make: vishuman,
        more: &[],
        hits: 51_625.0,
        seconds: 0.40,
        subdivisions: 278_317.0,
        aabb: 587_194.0,
        lists: ["1.04/0.24", "1.12/4.03"],
    },
    Class {
        name: "silicium",
        make: silicium,
        more: &[],
        hits: 95_425.0,
        seconds: 0.43,
        subdivisions: 356_862.0,
        aabb: 738_945.0,
        lists: ["1.05/0.24", "1.16/3.29"],
    },
    Class {
        name: "torso",
        make: torso,
        more: &[],
        hits: 123_084.0,
        seconds: 0.83,
        subdivisions: 3_502_902.0,
        aabb: 14_913_568.0,
        lists: ["1.09/0.40", "1.36/6.26"],
    },
    Class {
        name: "cfd",
        make: cfd,
        more: &[2.0],
        hits: 631_342.0,
        seconds: 0.77,
        subdivisions: 2_016_399.0,
        aabb: 4_124_430.0,
        lists: ["1.88/1.16", "2.70/3.26"],
    },
];

pub(crate) type Made = Result<(Data, f64), Box<dyn std::error::Error>>;

/// A file of the folder that `ISOBAR_DATA` names, else of `shared/data` beside the workspace.
pub(crate) fn shared(file: &str) -> Result<Data, Box<dyn std::error::Error>> {
    let folder = std::env::var_os("ISOBAR_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data"),
        PathBuf::from,
    );
    Ok(isobar_io::load(&folder.join(file), &isobar_io::Options::default())?.data)
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
pub(crate) fn lattice(
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
pub(crate) fn cylinder() -> Made {
    let place = |[u, v, w]: [f64; 3]| {
        DVec3::new(
            (TAU * (u % 1.0)).cos() * (0.4 + 0.6 * v),
            (TAU * (u % 1.0)).sin() * (0.4 + 0.6 * v),
            2.0 * w,
        )
    };
    let mode = |[u, v, w]: [f64; 3]| (2.0 * TAU * u).cos() * (TAU * w).sin() * (0.5 + v);
    Ok((Data::Hexes(lattice([5, 2, 5], 3, place, mode)?), 0.35))
}

/// Rational tri-cubic NURBS of about 10^4 elements: each of the horseshoe's 432 cut into three along each axis, 11,664 (the paper's Bimba has 10,935).
pub(crate) fn bimba() -> Made {
    let Data::Hexes(h) = shared("nurbs/horseshoe_iga.json")? else {
        return Err("no elements".into());
    };
    let elements: Vec<HexElement> = h.elements.iter().flat_map(thirds).collect();
    Ok((Data::Hexes(HexPatches::new(elements)?), 0.2))
}

/// The 27 parts of an element.
fn thirds(e: &HexElement) -> Vec<HexElement> {
    let along = |t: &Tensor<f64>, axis: usize| {
        let cut = |t: &Tensor<f64>, at: f64, upper: bool| {
            t.along(axis, |c| {
                let (low, high) = split(c, &at);
                if upper { high } else { low }
            })
        };
        let rest = cut(t, 1.0 / 3.0, true);
        [cut(t, 1.0 / 3.0, false), cut(&rest, 0.5, false), cut(&rest, 0.5, true)]
    };
    let parts = |degree: [u8; 3], values: Vec<f64>| {
        let whole = Tensor {
            counts: degree.map(|d| usize::from(d) + 1),
            values,
        };
        (0..3).fold(vec![whole], |all, axis| all.iter().flat_map(|t| along(t, axis)).collect())
    };
    let weight = |i: usize| e.points[i][3];
    let [x, y, z, w] = [0, 1, 2, 3].map(|c| {
        let lane = |p: &[f64; 4]| p[3] * if c < 3 { p[c] } else { 1.0 };
        parts(e.degree, e.points.iter().map(lane).collect())
    });
    let by = |i: usize| if e.rational_value { weight(i) } else { 1.0 };
    let a = parts(e.value_degree, e.values.iter().enumerate().map(|(i, a)| by(i) * a).collect());
    (0..27)
        .map(|n| {
            let w = &w[n].values;
            let point = |i: usize| [x[n].values[i] / w[i], y[n].values[i] / w[i], z[n].values[i] / w[i], w[i]];
            let value = |(i, a): (usize, &f64)| if e.rational_value { a / w[i] } else { *a };
            HexElement {
                points: (0..w.len()).map(point).collect(),
                values: a[n].values.iter().enumerate().map(value).collect(),
                ..e.clone()
            }
        })
        .collect()
}

/// The teardrop on one deformed triquintic element.
pub(crate) fn teardrop() -> Made {
    stretched_teardrop(1.0)
}

/// The same, stretched by a factor along an oblique direction.
pub(crate) fn stretched_teardrop(factor: f64) -> Made {
    let f = |[x, y, z]: [f64; 3]| 0.5 * x.powi(5) + 0.5 * x.powi(4) - y * y - z * z;
    let own = |u: [f64; 3]| u.map(|u| 2.5 * u - 1.25);
    let along = DVec3::new(1.0, 0.3, 0.7).normalize();
    let place = |u: [f64; 3]| {
        let [x, y, z] = own(u);
        let p = DVec3::new(x + 0.25 * y * y, y + 0.2 * x * x - 0.15 * x * z, z + 0.2 * x * y);
        p + along * (along.dot(p) * (factor - 1.0))
    };
    Ok((Data::Hexes(lattice([1; 3], 5, place, |u| f(own(u)))?), 0.0))
}

/// Exact boxes, all cells.
pub(crate) fn silicium() -> Made {
    let Data::Grid(g) = shared("structured/silicium_98x34x34.nhdr")? else {
        return Err("no grid".into());
    };
    Ok((
        Data::Hexes(spline_to_hexes(&g, Kind::CubicInterpolating, Stage::Stored)?),
        130.0,
    ))
}

/// A grid: 7 million cells, without elements.
pub(crate) fn vishuman() -> Made {
    Ok((shared("structured/ch2_colin27_t1.nii.gz")?, 60.0))
}

/// A bent 132^3 grid of trilinear elements with the field of a few charges.
pub(crate) fn torso() -> Made {
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

/// Laghos' elements, each cut into eight.
pub(crate) fn cfd() -> Made {
    let Data::Hexes(h) = shared("highorder/laghos_q2.vtu")? else {
        return Err("no elements".into());
    };
    Ok((Data::Hexes(refine_hexes(&h)?), 1.05))
}

/// View n of a turn about z, from `distance` half diagonals.
pub(crate) fn turn(data: &Data, n: f64, distance: f64, pixels: usize) -> View {
    let (lo, hi) = data.bounds();
    let (centre, radius) = ((lo + hi) * 0.5, (hi - lo).length() * 0.5);
    let (s, c) = (TAU * n).sin_cos();
    let eye = centre + DVec3::new(c, s, 0.35).normalize() * (radius * distance);
    View::perspective(eye, centre, DVec3::Z, 40.0, pixels, pixels)
}
