//! VTK's Lagrange hexahedra (type 72) to Bezier elements: the polynomial through the nodes, in Bernstein form; linear ones (types 11 and 12) too, where elements are asked for.
//!
//! **Nodes**: corners, edges, faces, interior, as VTK numbers them; the order follows from their count. VTK 9 exchanged the nodes of the edges (1, 1, w) and
//! (0, 1, w): files from before (legacy below 5.1, XML with a minor version below 2) have the old numbering. **Conversion** up to order 6 by whole numbers
//! over a common denominator (a few roundings per coefficient), above by elimination in f64.

use crate::error::Cause;
use crate::field::Choice;
use crate::finite::{elements as elements_of, replace};
use crate::{Loaded, Options};
use isobar_core::{DVec3, Data, HexElement};
use isobar_fields::hexes_bezier::{Tensor, equidistant, interpolation};

/// VTK's number of the cell.
pub(crate) const TYPE: u8 = 72;
/// VTK's linear hexahedron, and its voxel: the same with its corners in another order.
const LINEAR: u8 = 12;
const VOXEL: u8 = 11;
/// VTK's own limit of the order.
const MOST_ORDER: usize = 10;

/// Cells and values as a file has them.
pub(crate) struct Cells {
    pub(crate) points: Vec<DVec3>,
    pub(crate) types: Vec<u8>,
    pub(crate) ends: Vec<usize>,
    pub(crate) corners: Vec<u32>,
    /// A value per point, or per cell where `on_cells`.
    pub(crate) values: Vec<f64>,
    pub(crate) on_cells: bool,
    /// Numbering of VTK 9 and later.
    pub(crate) new_numbering: bool,
}

/// VTK's number of the node (i, j, k) of a cell of `order`.
fn number([i, j, k]: [usize; 3], order: usize, new: bool) -> usize {
    let m = order - 1;
    let end = |x: usize| x == 0 || x == order;
    let up = |x: usize, n: usize| if x > 0 { n } else { 0 };
    match (end(i), end(j), end(k)) {
        (true, true, true) => [[0, 3], [1, 2]][i.min(1)][j.min(1)] + up(k, 4),
        (false, true, true) => 8 + i - 1 + up(j, 2 * m) + up(k, 4 * m),
        (true, false, true) => 8 + j - 1 + if i > 0 { m } else { 3 * m } + up(k, 4 * m),
        (true, true, false) => {
            let edges = if new { [[0, 3], [1, 2]] } else { [[0, 2], [1, 3]] };
            8 + 8 * m + k - 1 + m * edges[i.min(1)][j.min(1)]
        }
        (true, false, false) => 8 + 12 * m + j - 1 + m * (k - 1) + up(i, m * m),
        (false, true, false) => 8 + 12 * m + 2 * m * m + i - 1 + m * (k - 1) + up(j, m * m),
        (false, false, true) => 8 + 12 * m + 4 * m * m + i - 1 + m * (j - 1) + up(k, m * m),
        (false, false, false) => 8 + 12 * m + 6 * m * m + i - 1 + m * (j - 1 + m * (k - 1)),
    }
}

/// From values at i/n to Bernstein coefficients, along one axis.
struct Conversion {
    rows: Vec<Vec<f64>>,
    denominator: f64,
}

impl Conversion {
    fn new(order: usize) -> Option<Self> {
        if let Some((rows, denominator)) = equidistant(order) {
            let rows = rows.iter().map(|r| r.iter().map(|&v| v as f64).collect()).collect();
            let denominator = denominator as f64;
            return Some(Self { rows, denominator });
        }
        let nodes: Vec<f64> = (0..=order).map(|i| i as f64 / order as f64).collect();
        interpolation(&nodes).map(|rows| Self { rows, denominator: 1.0 })
    }

    fn of(&self, n: usize, values: Vec<f64>) -> Vec<f64> {
        let t = Tensor { counts: [n; 3], values };
        (0..3)
            .fold(t, |t, axis| {
                t.along(axis, |c| {
                    let sum = |r: &Vec<f64>| r.iter().zip(c).map(|(a, b)| a * b).sum::<f64>() / self.denominator;
                    let mut out: Vec<f64> = self.rows.iter().map(sum).collect();
                    // The ends are interpolated: the very same numbers, so that neighbours share them.
                    (out[0], out[n - 1]) = (c[0], c[n - 1]);
                    out
                })
            })
            .values
    }
}

impl Cells {
    /// The elements, with NaN replaced as asked, or counted.
    pub(crate) fn loaded(
        mut self,
        choice: Choice,
        fields: Vec<String>,
        mut notes: Vec<String>,
        o: &Options,
    ) -> Result<Loaded, Cause> {
        let not_finite = replace(&mut self.values, &mut notes, o)?;
        let mut conversions: [Option<Conversion>; MOST_ORDER + 1] = Default::default();
        let mut elements = Vec::with_capacity(self.ends.len());
        let mut start = 0;
        for (cell, (&end, &kind)) in self.ends.iter().zip(&self.types).enumerate() {
            let nodes = &self.corners[start..end];
            start = end;
            let order = (1..=MOST_ORDER).find(|n| (n + 1).pow(3) == nodes.len());
            let order = match (kind, order) {
                (TYPE, Some(n)) | (LINEAR | VOXEL, Some(n @ 1)) => n,
                (TYPE | LINEAR | VOXEL, _) => {
                    return Err(Cause::malformed(
                        "mesh",
                        format!(
                            "cell {cell} of type {kind} has {} nodes, no cube of 2 to {}",
                            nodes.len(),
                            MOST_ORDER + 1
                        ),
                    ));
                }
                _ => {
                    return Err(Cause::Unsupported {
                        format: "mesh",
                        what: format!("hexahedra and a cell {cell} of type {kind}"),
                        remedy: "write hexahedra (72, 12, 11) only, or leave as=hexes out where there are none of type 72",
                    });
                }
            };
            if conversions[order].is_none() {
                conversions[order] = Conversion::new(order);
            }
            let Some(convert) = &conversions[order] else {
                return Err(Cause::malformed("mesh", format!("order {order} cannot be converted")));
            };
            elements.push(self.element(cell, nodes, order, convert, kind == VOXEL));
        }
        if self.on_cells {
            notes.push("values of cells are constant on each element".into());
        }
        Ok(Loaded {
            data: Data::Hexes(elements_of(elements)?),
            field: choice.name,
            fields,
            notes,
            not_finite,
        })
    }

    /// `plain`: nodes stand in the order of their indices, x fastest, as those of voxels.
    fn element(&self, cell: usize, nodes: &[u32], order: usize, convert: &Conversion, plain: bool) -> HexElement {
        let n = order + 1;
        let node = |at: usize| {
            let numbered = number([at % n, at / n % n, at / n / n], order, self.new_numbering);
            nodes[if plain { at } else { numbered }] as usize
        };
        let channel = |f: &dyn Fn(usize) -> f64| convert.of(n, (0..n * n * n).map(|at| f(node(at))).collect());
        let [x, y, z] = [0, 1, 2].map(|c| channel(&|i| self.points[i][c]));
        let degree = [order as u8; 3];
        HexElement {
            degree,
            points: (0..x.len()).map(|i| [x[i], y[i], z[i], 1.0]).collect(),
            value_degree: if self.on_cells { [0; 3] } else { degree },
            values: if self.on_cells {
                [self.values[cell]].into()
            } else {
                channel(&|i| self.values[i]).into()
            },
            rational_value: false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_are_numbered_once_each() {
        for order in 1..=5 {
            for new in [false, true] {
                let n = order + 1;
                let mut seen: Vec<usize> = (0..n * n * n)
                    .map(|at| number([at % n, at / n % n, at / n / n], order, new))
                    .collect();
                seen.sort_unstable();
                assert!(seen.iter().enumerate().all(|(i, &s)| i == s), "order {order}");
            }
        }
        // The mid-edge node of the quadratic cell on the edge (1, 1, w) is 18 as in VTK's quadratic hexahedron, before VTK 9 it was 19.
        assert_eq!((number([2, 2, 1], 2, true), number([2, 2, 1], 2, false)), (18, 19));
    }

    #[test]
    fn polynomials_of_the_order_are_exact() {
        for order in 1..=8usize {
            let n = order + 1;
            let f = |at: usize| {
                (0..3)
                    .map(|a| (at / n.pow(a) % n) as f64 / order as f64)
                    .map(|x| x.powi(order as i32))
                    .sum::<f64>()
            };
            let c = Conversion::new(order).unwrap().of(n, (0..n * n * n).map(f).collect());
            // u^n has the coefficients 0, ..., 0, 1
            for (at, c) in c.iter().enumerate() {
                let want = (0..3).filter(|&a| at / n.pow(a) % n == order).count() as f64;
                // Observed: 1.1e-12 at order 6 (whole numbers, sums of weights of some 10^3 per axis), 1.0e-10 at order 8 (elimination in f64).
                let near = if order <= 6 { 1e-11 } else { 1e-9 };
                assert!((c - want).abs() < near, "order {order}: {c} {want}");
            }
        }
    }
}
