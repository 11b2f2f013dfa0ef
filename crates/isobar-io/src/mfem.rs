//! MFEM meshes of hexahedra (v1.0, curved or not; NURBS v1.0) and the grid function of the same stem beside them, as Bezier elements.
//!
//! **Degrees of freedom** lie on vertices, edges, faces, then inside, each numbered as the elements first name it (NURBS: edges as the file lists them); those of an
//! edge go from its lower to its higher vertex, those of a face follow the first element that has it. Format: MFEM mesh formats,
//! <https://mfem.org/mesh-formats/>. **Spaces**: H1 (`H1_3D_Pn`, nodes of Gauss and Lobatto), L2 (`L2_3D_Pn` and `L2_T0_`: Gauss and Legendre, `L2_T1_`: Lobatto,
//! `L2_T2_`: Bernstein), NURBS (`NURBSn`). Fields: `field` where the grid function is there, then the coordinates x, y, z.

use crate::error::{Cause, quoted};
use crate::field::no_field;
use crate::finite::{elements as elements_of, refusal, replace};
use crate::input::Input;
use crate::mfem_dofs::{Numbering, Topology, edge};
use crate::nurbs::{Volume, loaded, text};
use crate::{Loaded, Options};
use isobar_core::{Data, HexElement};
use isobar_fields::NurbsPatch;
use isobar_fields::hexes_bezier::{Tensor, interpolation};

const FORMAT: &str = "MFEM mesh";
pub(crate) fn bad(what: impl Into<String>) -> Cause {
    Cause::malformed(FORMAT, what)
}

/// Words of a text without comments.
struct Words<'a> {
    words: std::iter::Peekable<std::vec::IntoIter<&'a str>>,
    /// No count can be larger.
    most: usize,
}

impl<'a> Words<'a> {
    fn new(text: &'a str) -> Self {
        let lines = text.lines().filter(|l| !l.trim_start().starts_with('#'));
        let words: Vec<&str> = lines.flat_map(str::split_whitespace).collect();
        Self {
            most: words.len(),
            words: words.into_iter().peekable(),
        }
    }

    fn next(&mut self) -> Result<&'a str, Cause> {
        self.words.next().ok_or_else(|| bad("it ends early"))
    }

    fn count(&mut self) -> Result<usize, Cause> {
        let w = self.next()?;
        w.parse()
            .ok()
            .filter(|&n| n <= self.most)
            .ok_or_else(|| bad(format!("{} is no count the file can hold", quoted(w))))
    }

    fn number(&mut self) -> Result<f64, Cause> {
        let w = self.next()?;
        w.parse().map_err(|_| bad(format!("{} is not a number", quoted(w))))
    }

    fn numbers(&mut self, n: usize) -> Result<Vec<f64>, Cause> {
        if n > self.most {
            return Err(bad(format!("{n} numbers are more than the file has words")));
        }
        (0..n).map(|_| self.number()).collect()
    }

    fn expect(&mut self, word: &str) -> Result<(), Cause> {
        let w = self.next()?;
        if w == word {
            return Ok(());
        }
        Err(bad(format!("{} stands where {word} should", quoted(w))))
    }
}

/// Where the values of a space sit along one axis.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Nodes {
    Lobatto,
    Legendre,
    Bernstein,
}

/// A finite element space of a file.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Space {
    /// Shared between elements.
    H1(usize),
    /// Own values in each element.
    L2(usize, Nodes),
    Nurbs,
}

/// A grid function: its space, and per degree of freedom `dim` numbers.
struct Function {
    space: Space,
    dim: usize,
    by_dim: bool,
    values: Vec<f64>,
}

impl Function {
    /// Reads header and all numbers that follow.
    fn read(words: &mut Words<'_>) -> Result<Self, Cause> {
        words.expect("FiniteElementSpace")?;
        words.expect("FiniteElementCollection:")?;
        let space = space(words.next()?)?;
        words.expect("VDim:")?;
        let dim = words.count()?.max(1);
        words.expect("Ordering:")?;
        let by_dim = words.count()? == 1;
        let mut values = Vec::new();
        while let Some(v) = words.words.peek().and_then(|w| w.parse().ok()) {
            values.push(v);
            words.words.next();
        }
        Ok(Self {
            space,
            dim,
            by_dim,
            values,
        })
    }

    /// Component `c` of degree of freedom `i`.
    fn get(&self, i: usize, c: usize) -> f64 {
        let n = self.values.len() / self.dim;
        self.values[if self.by_dim { i * self.dim + c } else { c * n + i }]
    }

    fn require(&self, count: usize) -> Result<(), Cause> {
        if count.checked_mul(self.dim) == Some(self.values.len()) {
            return Ok(());
        }
        Err(bad(format!(
            "a grid function has {} numbers, {} times {} are needed",
            self.values.len(),
            count,
            self.dim
        )))
    }
}

fn space(name: &str) -> Result<Space, Cause> {
    let order = |from: &str| from.parse::<usize>().ok().filter(|n| *n <= 20);
    let found = if let Some(n) = name.strip_prefix("H1_3D_P") {
        order(n).filter(|n| *n > 0).map(Space::H1)
    } else if let Some(n) = name.strip_prefix("NURBS") {
        order(n).map(|_| Space::Nurbs)
    } else {
        [
            ("L2_3D_P", Nodes::Legendre),
            ("L2_T0_3D_P", Nodes::Legendre),
            ("L2_T1_3D_P", Nodes::Lobatto),
            ("L2_T2_3D_P", Nodes::Bernstein),
        ]
        .iter()
        .find_map(|(prefix, nodes)| name.strip_prefix(prefix).and_then(order).map(|n| Space::L2(n, *nodes)))
    };
    found.ok_or_else(|| Cause::Unsupported {
        format: FORMAT,
        what: format!("the space {}", quoted(name)),
        remedy: "write it as H1_3D_Pn, L2_3D_Pn, L2_T1_3D_Pn, L2_T2_3D_Pn or NURBSn with n up to 20",
    })
}

/// The nodes on [0, 1] of n + 1 values: roots by Newton's method.
fn nodes(kind: Nodes, n: usize) -> Vec<f64> {
    // Legendre's polynomial and its derivative on [-1, 1].
    let legendre = |d: usize, x: f64| {
        let (mut a, mut b) = (1.0, x);
        if d == 0 {
            return (1.0, 0.0);
        }
        for k in 2..=d {
            (a, b) = (b, ((2 * k - 1) as f64 * x * b - (k - 1) as f64 * a) / k as f64);
        }
        (b, d as f64 * (a - x * b) / (1.0 - x * x))
    };
    let count = n + 1;
    (0..count)
        .map(|i| {
            let angle = std::f64::consts::PI;
            if kind == Nodes::Lobatto && (i == 0 || i == n) {
                return if i == 0 { 0.0 } else { 1.0 };
            }
            let mut x = if kind == Nodes::Lobatto {
                -(angle * i as f64 / n as f64).cos()
            } else {
                -(angle * (i as f64 + 0.75) / (count as f64 + 0.5)).cos()
            };
            for _ in 0..60 {
                // Lobatto: roots of P_n'; (1 - x^2) P'' = 2 x P' - n (n + 1) P.
                let step = if kind == Nodes::Lobatto {
                    let (p, dp) = legendre(n, x);
                    dp * (1.0 - x * x) / (2.0 * x * dp - (n * (n + 1)) as f64 * p)
                } else {
                    let (p, dp) = legendre(count, x);
                    p / dp
                };
                x -= step;
                if step.abs() < 1e-16 {
                    break;
                }
            }
            0.5 + 0.5 * x
        })
        .collect()
}

/// The rows that turn nodal values along an axis into Bernstein coefficients; `None` where they already are.
fn conversion(kind: Nodes, n: usize) -> Result<Option<Vec<Vec<f64>>>, Cause> {
    if kind == Nodes::Bernstein || n == 0 {
        return Ok(None);
    }
    interpolation(&nodes(kind, n))
        .map(Some)
        .ok_or_else(|| bad(format!("order {n} cannot be converted")))
}

fn converted(rows: Option<&[Vec<f64>]>, n: usize, values: Vec<f64>) -> Vec<f64> {
    let Some(rows) = rows else { return values };
    let t = Tensor {
        counts: [n + 1; 3],
        values,
    };
    let line = |c: &[f64]| rows.iter().map(|r| r.iter().zip(c).map(|(a, b)| a * b).sum()).collect();
    (0..3).fold(t, |t, axis| t.along(axis, line)).values
}

/// Reads a mesh and the grid function beside it.
pub(crate) fn read(input: &dyn Input, o: &Options) -> Result<Loaded, Cause> {
    let mesh = text(input, FORMAT)?;
    let name = input.name();
    let stem = name.strip_suffix(".mesh").unwrap_or(name);
    let beside = input
        .beside(&format!("{stem}.gf"))
        .and_then(|f| text(&*f, "MFEM grid function"));
    read_both(&mesh, beside.ok().as_deref(), o)
}

/// Reads a mesh and a grid function.
pub(crate) fn read_both(mesh: &str, function: Option<&str>, o: &Options) -> Result<Loaded, Cause> {
    let mut field = function.map(|t| Function::read(&mut Words::new(t))).transpose()?;
    let (mut notes, mut not_finite) = (Vec::new(), 0);
    // In the file's own numbers: a coefficient of an element is made of many.
    if let Some(f) = field.as_mut().filter(|_| o.field.as_deref().is_none_or(|n| n == "field")) {
        not_finite = replace(&mut f.values, &mut notes, o)?;
    }
    if let Some(f) = field.as_ref().filter(|f| f.dim != 1) {
        return Err(Cause::Unsupported {
            format: FORMAT,
            what: format!("a grid function of {} components", f.dim),
            remedy: "write one component",
        });
    }
    let mut words = Words::new(mesh);
    words.expect("MFEM")?;
    let kind = words.next()?;
    let nurbs = kind == "NURBS";
    if nurbs {
        words.expect("mesh")?;
    }
    let version = words.next()?;
    if version != "v1.0" {
        return Err(Cause::Unsupported {
            format: FORMAT,
            what: format!("version {}", quoted(version)),
            remedy: "write it as MFEM mesh v1.0 or MFEM NURBS mesh v1.0",
        });
    }
    words.expect("dimension")?;
    if words.count()? != 3 {
        return Err(bad("it is not three-dimensional"));
    }
    let mut topology = Topology::default();
    words.expect("elements")?;
    for n in 0..words.count()? {
        let (_attribute, shape) = (words.next()?, words.count()?);
        if shape != 5 {
            return Err(Cause::Unsupported {
                format: FORMAT,
                what: format!("element {n} of geometry {shape}"),
                remedy: "give hexahedra (5) only",
            });
        }
        let mut corners = [0; 8];
        for c in &mut corners {
            *c = u32::try_from(words.count()?).unwrap_or(u32::MAX);
        }
        topology.elements.push(corners);
    }
    words.expect("boundary")?;
    for _ in 0..words.count()? {
        let (_attribute, shape) = (words.next()?, words.count()?);
        words.numbers(
            [1, 2, 3, 4]
                .get(shape)
                .copied()
                .ok_or_else(|| bad(format!("a boundary element of geometry {shape}")))?,
        )?;
    }
    let read = if nurbs {
        if not_finite > 0 {
            return Err(refusal(FORMAT, not_finite));
        }
        read_nurbs(words, topology, field, o)?
    } else {
        read_plain(words, topology, field.as_ref(), o)?
    };
    notes.extend(read.notes);
    Ok(Loaded {
        notes,
        not_finite,
        ..read
    })
}

/// The corners of all elements are vertices there are.
fn check(topology: &Topology) -> Result<(), Cause> {
    let n = topology.vertices;
    match topology.elements.iter().flatten().find(|&&c| c as usize >= n) {
        Some(c) => Err(bad(format!("an element names vertex {c} of {n}"))),
        None if topology.elements.is_empty() => Err(bad("there are no elements")),
        None => Ok(()),
    }
}

fn read_plain(mut words: Words<'_>, mut topology: Topology, field: Option<&Function>, o: &Options) -> Result<Loaded, Cause> {
    words.expect("vertices")?;
    topology.vertices = words.count()?;
    check(&topology)?;
    topology.number();
    let positions = if words.words.peek() == Some(&"nodes") {
        words.next()?;
        Function::read(&mut words)?
    } else {
        let dim = words.count()?;
        Function {
            space: Space::H1(1),
            dim,
            by_dim: true,
            values: words.numbers(topology.vertices.saturating_mul(dim))?,
        }
    };
    if positions.dim != 3 {
        return Err(bad(format!("positions have {} coordinates", positions.dim)));
    }
    let mut fields: Vec<String> = ["x", "y", "z"].map(String::from).into();
    if field.is_some() {
        fields.insert(0, "field".into());
    }
    let name = o.field.clone().unwrap_or_else(|| fields[0].clone());
    if !fields.contains(&name) {
        return Err(no_field(&name, fields.iter().map(String::as_str)));
    }
    let (degree, geometry) = coefficients(&topology, &positions, 3)?;
    let axis = ["x", "y", "z"].iter().position(|a| *a == name);
    let (value_degree, values) = match (axis, field) {
        (None, Some(f)) => coefficients(&topology, f, 1)?,
        _ => (degree, geometry.iter().skip(axis.unwrap_or(0)).step_by(3).cloned().collect()),
    };
    let elements: Vec<HexElement> = geometry
        .chunks_exact(3)
        .zip(values)
        .map(|(p, values)| HexElement {
            degree: [degree as u8; 3],
            points: (0..p[0].len()).map(|i| [p[0][i], p[1][i], p[2][i], 1.0]).collect(),
            value_degree: [value_degree as u8; 3],
            values: values.into(),
            rational_value: false,
        })
        .collect();
    Ok(Loaded {
        data: Data::Hexes(elements_of(elements)?),
        field: name,
        fields,
        notes: Vec::new(),
        not_finite: 0,
    })
}

/// Degree, and Bernstein coefficients per element and component.
fn coefficients(topology: &Topology, f: &Function, dim: usize) -> Result<(usize, Vec<Vec<f64>>), Cause> {
    let elements = topology.elements.len();
    let (n, kind, shared) = match f.space {
        Space::H1(n) => (n, Nodes::Lobatto, true),
        Space::L2(n, kind) => (n, kind, false),
        Space::Nurbs => return Err(bad("a NURBS space on a mesh that is none")),
    };
    let counts = move |_: usize| [n + 1; 3];
    let numbering = Numbering::new(topology, &counts)?;
    let per = (n + 1).pow(3);
    f.require(if shared { numbering.total } else { elements * per })?;
    let rows = conversion(kind, n)?;
    let mut out = Vec::with_capacity(elements * dim);
    for e in 0..elements {
        let number = |i: usize| {
            if shared {
                numbering.of(e, [i % (n + 1), i / (n + 1) % (n + 1), i / (n + 1) / (n + 1)])
            } else {
                e * per + i
            }
        };
        for c in 0..dim {
            let values = (0..per).map(|i| f.get(number(i), c)).collect();
            out.push(converted(rows.as_deref(), n, values));
        }
    }
    Ok((n, out))
}

fn read_nurbs(mut words: Words<'_>, mut topology: Topology, field: Option<Function>, o: &Options) -> Result<Loaded, Cause> {
    // Per edge, from its lower to its higher vertex: which knots, and whether they run the other way.
    let mut along: Vec<(usize, bool)> = Vec::new();
    words.expect("edges")?;
    for _ in 0..words.count()? {
        let (knots, a, b) = (words.count()?, words.count()? as u32, words.count()? as u32);
        let next = topology.edges.len();
        if topology.edges.insert(edge(a, b), next).is_some() {
            return Err(bad(format!("the edge {a} {b} comes twice")));
        }
        along.push((knots, a > b));
    }
    words.expect("vertices")?;
    topology.vertices = words.count()?;
    check(&topology)?;
    topology.number();
    words.expect("knotvectors")?;
    let mut knots = Vec::new();
    for _ in 0..words.count()? {
        let (degree, n) = (words.count()?, words.count()?);
        knots.push((degree, n, words.numbers(n + degree + 1)?));
    }
    if along.len() != topology.edges.len() || along.iter().any(|a| a.0 >= knots.len()) {
        return Err(bad("an edge of a patch has no knots"));
    }
    let axis = |n: usize, axis: usize| {
        let e = &topology.elements[n];
        let (a, b) = (e[0], e[[1, 3, 4][axis]]);
        let (k, turned) = along[topology.edges[&edge(a, b)]];
        (k, turned != (a > b))
    };
    let counts = |n: usize| [0, 1, 2].map(|a| knots[axis(n, a).0].1);
    if (0..topology.elements.len()).any(|n| counts(n).iter().any(|&c| c < 2)) {
        return Err(bad("a knot vector has fewer than two control points"));
    }
    let numbering = Numbering::new(&topology, &counts)?;
    words.expect("weights")?;
    let weights = words.numbers(numbering.total)?;
    let positions = Function::read(&mut words)?;
    positions.require(numbering.total)?;
    if positions.dim != 3 {
        return Err(bad(format!("positions have {} coordinates", positions.dim)));
    }
    if let Some(f) = &field {
        f.require(numbering.total)?;
    }
    let mut volumes = Vec::new();
    for n in 0..topology.elements.len() {
        let c = counts(n);
        let total = c
            .iter()
            .try_fold(1usize, |t, &c| t.checked_mul(c))
            .filter(|&t| t <= numbering.total);
        let total = total.ok_or_else(|| bad(format!("patch {n} has {c:?} control points")))?;
        let numbers: Vec<usize> = (0..total)
            .map(|i| numbering.of(n, [i % c[0], i / c[0] % c[1], i / c[0] / c[1]]))
            .collect();
        let own = [0, 1, 2].map(|a| {
            let (k, turned) = axis(n, a);
            let mut v = knots[k].2.clone();
            if turned && let (Some(&lo), Some(&hi)) = (v.first(), v.last()) {
                v = v.iter().rev().map(|x| lo + hi - x).collect();
            }
            v
        });
        volumes.push(Volume {
            patch: NurbsPatch {
                degree: [0, 1, 2].map(|a| knots[axis(n, a).0].0),
                knots: own,
                points: numbers
                    .iter()
                    .map(|&i| [positions.get(i, 0), positions.get(i, 1), positions.get(i, 2), weights[i]])
                    .collect(),
                values: Vec::new(),
            },
            field: field.as_ref().map(|f| numbers.iter().map(|&i| f.get(i, 0)).collect()),
        });
    }
    loaded(volumes, "field", FORMAT, o)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_are_those_of_the_tables() {
        let near = |a: &[f64], b: &[f64]| a.len() == b.len() && a.iter().zip(b).all(|(a, b)| (a - (0.5 + 0.5 * b)).abs() < 1e-15);
        assert!(near(&nodes(Nodes::Lobatto, 2), &[-1.0, 0.0, 1.0]));
        let s = 5f64.sqrt().recip();
        assert!(near(&nodes(Nodes::Lobatto, 3), &[-1.0, -s, s, 1.0]));
        let s = (3.0f64 / 7.0).sqrt();
        assert!(near(&nodes(Nodes::Lobatto, 4), &[-1.0, -s, 0.0, s, 1.0]));
        let s = 3f64.sqrt().recip();
        assert!(near(&nodes(Nodes::Legendre, 1), &[-s, s]) && near(&nodes(Nodes::Legendre, 0), &[0.0]));
    }
}
