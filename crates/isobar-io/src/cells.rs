//! From the cells of a file to tetrahedra with a value at each point: what all readers of meshes end with.
//!
//! **The split.** A cell is cut into the cones from its corner of least number over the faces that do not have this corner, each face beforehand
//! into triangles about its own corner of least number. A face that has the cell's least corner is cut by the cones about the same corner, so
//! two cells that share a face cut it alike: the mesh conforms. A hexahedron gives 6 tetrahedra, a wedge 3, a pyramid 2. Points of equal coordinates have one
//! number here, so that cells with separate points conform too.

use crate::error::{Cause, quoted};
use crate::field::{Choice, Named, choices, choose};
use crate::finite::tetrahedra;
use crate::{Loaded, Options};
use isobar_core::{DVec3, Data};
use std::collections::HashMap;

/// More tetrahedra than this (2 GiB of indices) are refused.
const MOST: usize = 1 << 27;

/// Faces of VTK's cells 10, 12, 13, 14 as corners, anticlockwise seen from outside.
type Faces = &'static [&'static [usize]];
const TETRA: Faces = &[&[0, 2, 1], &[0, 1, 3], &[1, 2, 3], &[2, 0, 3]];
const HEXAHEDRON: Faces = &[
    &[0, 3, 2, 1],
    &[4, 5, 6, 7],
    &[0, 1, 5, 4],
    &[1, 2, 6, 5],
    &[2, 3, 7, 6],
    &[3, 0, 4, 7],
];
const WEDGE: Faces = &[&[0, 2, 1], &[3, 4, 5], &[0, 1, 4, 3], &[1, 2, 5, 4], &[2, 0, 3, 5]];
const PYRAMID: Faces = &[&[0, 3, 2, 1], &[0, 1, 4], &[1, 2, 4], &[2, 3, 4], &[3, 0, 4]];

/// Cells as files have them.
#[derive(Debug, Default)]
pub(crate) struct Cells {
    /// World positions.
    pub(crate) points: Vec<DVec3>,
    /// VTK's type of each cell.
    pub(crate) types: Vec<u8>,
    /// Where the corners of each cell end in `corners`.
    pub(crate) ends: Vec<usize>,
    /// Point indices.
    pub(crate) corners: Vec<u32>,
}

/// The field that is read of a mesh: as asked for, else the first scalar of the points, else their first field of any kind.
pub(crate) fn field(named: &[Named], o: &Options, format: &'static str) -> Result<(Choice, Vec<String>), Cause> {
    let all = choices(named);
    let on_points = || all.iter().filter(|c| !named[c.array].on_cells);
    let choice = match o.field {
        None => on_points()
            .find(|c| named[c.array].components == 1)
            .or(on_points().next())
            .or(all.first())
            .ok_or(Cause::NoFields)?,
        Some(_) => choose(&all, named, o.field.as_deref())?,
    }
    .clone();
    if named[choice.array].on_cells && !o.cell_to_point {
        return Err(Cause::Unsupported {
            format,
            what: format!("field {} on cells", quoted(&choice.name)),
            remedy: "give --cell-to-point to average it to the points, or another --field",
        });
    }
    Ok((choice, all.into_iter().map(|c| c.name).collect()))
}

/// Three coordinates per point.
pub(crate) fn points(coordinates: &[f64]) -> Result<Vec<DVec3>, Cause> {
    let points: Vec<DVec3> = coordinates.as_chunks::<3>().0.iter().map(|&p| DVec3::from_array(p)).collect();
    match points.iter().position(|p| !p.is_finite()) {
        Some(i) => Err(Cause::malformed("mesh", format!("point {i} is {}", points[i]))),
        None => Ok(points),
    }
}

/// Numbers that must be indices below `limit`.
pub(crate) fn indices(numbers: &[f64], limit: usize) -> Result<Vec<u32>, Cause> {
    numbers
        .iter()
        .map(|&v| {
            if v >= 0.0 && v < limit as f64 && v < f64::from(u32::MAX) {
                Ok(v as u32)
            } else {
                Err(Cause::malformed("mesh", format!("a cell names point {v} of {limit}")))
            }
        })
        .collect()
}

impl Cells {
    /// The mesh with `values` at the points, or at the cells where `on_cells`.
    pub(crate) fn loaded(
        self,
        values: Vec<f32>,
        on_cells: bool,
        choice: Choice,
        fields: Vec<String>,
        mut notes: Vec<String>,
        o: &Options,
    ) -> Result<Loaded, Cause> {
        let values = if on_cells {
            self.averaged(&values, &mut notes)
        } else {
            values
        };
        let tets = self.tetrahedra(&mut notes)?;
        finish(self.points, tets, values, choice.name, fields, notes, o)
    }

    /// Corners of each cell.
    fn each(&self) -> impl Iterator<Item = &[u32]> {
        let mut start = 0;
        self.ends.iter().map(move |&end| {
            let part = &self.corners[start..end];
            start = end;
            part
        })
    }

    /// The mean of the cells about each point; 0 at points of no cell.
    fn averaged(&self, values: &[f32], notes: &mut Vec<String>) -> Vec<f32> {
        let mut sums = vec![(0.0f64, 0u32); self.points.len()];
        for (corners, &v) in self.each().zip(values) {
            for &i in corners {
                let s = &mut sums[i as usize];
                *s = (s.0 + f64::from(v), s.1 + 1);
            }
        }
        notes.push("values of cells were averaged to the points".into());
        sums.iter().map(|&(s, n)| (s / f64::from(n.max(1))) as f32).collect()
    }

    /// Surplus corners, as of quadratic cells written under the number of linear ones, are left out: the first are those of the linear cell.
    fn tetrahedra(&self, notes: &mut Vec<String>) -> Result<Vec<[u32; 4]>, Cause> {
        let mut surplus = 0;
        let number = numbered(&self.points);
        let mut out = Vec::new();
        for (n, (corners, &kind)) in self.each().zip(&self.types).enumerate() {
            let (faces, wanted) = match kind {
                10 => (TETRA, 4),
                12 => (HEXAHEDRON, 8),
                13 => (WEDGE, 6),
                14 => (PYRAMID, 5),
                _ => return Err(other_type(n, kind)),
            };
            surplus += usize::from(corners.len() > wanted);
            if corners.len() < wanted {
                return Err(Cause::malformed(
                    "mesh",
                    format!("cell {n} of type {kind} has {} corners instead of {wanted}", corners.len()),
                ));
            }
            if out.len() >= MOST {
                return Err(Cause::Memory(MOST as u64 * 16));
            }
            let least = |a: &usize, b: &usize| number[corners[*a] as usize].cmp(&number[corners[*b] as usize]);
            let top = (0..wanted).min_by(least).unwrap_or(0);
            for face in faces.iter().filter(|f| !f.contains(&top)) {
                let start = (0..face.len()).min_by(|&a, &b| least(&face[a], &face[b])).unwrap_or(0);
                for i in 1..face.len() - 1 {
                    let at = |k: usize| corners[face[(start + k) % face.len()]];
                    // Seen from the inside, so that the volume of a cell as VTK orders it is positive.
                    out.push([at(0), at(i + 1), at(i), corners[top]]);
                }
            }
        }
        if surplus > 0 {
            notes.push(format!(
                "{surplus} of {} cells have more corners than their type; the first ones were taken",
                self.types.len()
            ));
        }
        Ok(out)
    }
}

fn other_type(n: usize, kind: u8) -> Cause {
    let name = match kind {
        1 | 2 => " (vertex)",
        3 | 4 => " (line)",
        5..=7 | 9 => " (polygon)",
        8 | 11 => " (pixel or voxel)",
        24..=29 => " (quadratic)",
        42 => " (polyhedron)",
        68..=75 => " (Lagrange)",
        _ => "",
    };
    Cause::Unsupported {
        format: "mesh",
        what: format!("cell {n} of type {kind}{name}"),
        remedy: "write tetrahedra (10), hexahedra (12), wedges (13) or pyramids (14) only; as=hexes takes voxels",
    }
}

/// For each point the least index of a point with the same coordinates.
fn numbered(points: &[DVec3]) -> Vec<u32> {
    let mut first: HashMap<[u64; 3], u32> = HashMap::with_capacity(points.len());
    (0..)
        .zip(points)
        // + 0 makes -0 and 0 one
        .map(|(i, p)| *first.entry(p.to_array().map(|x| (x + 0.0).to_bits())).or_insert(i))
        .collect()
}

/// Tetrahedra with values at the points, NaN replaced as asked, or counted: turned over where their volume is negative; those without volume stay, are counted, and are not drawn.
pub(crate) fn finish(
    points: Vec<DVec3>,
    mut tets: Vec<[u32; 4]>,
    mut values: Vec<f32>,
    field: String,
    fields: Vec<String>,
    mut notes: Vec<String>,
    o: &Options,
) -> Result<Loaded, Cause> {
    let mut not_finite = values.iter().filter(|v| !v.is_finite()).count();
    if let Some(value) = o.nan.filter(|_| not_finite > 0) {
        if !(value as f32).is_finite() {
            return Err(Cause::Replacement(value));
        }
        values.iter_mut().filter(|v| !v.is_finite()).for_each(|v| *v = value as f32);
        notes.push(format!("{not_finite} NaN or infinite values were read as {value}"));
        not_finite = 0;
    }
    let (mut flat, mut turned) = (0, 0);
    for t in &mut tets {
        let p = t.map(|i| points[i as usize]);
        let volume = (p[1] - p[0]).cross(p[2] - p[0]).dot(p[3] - p[0]);
        if volume == 0.0 {
            flat += 1;
        } else if volume < 0.0 {
            t.swap(2, 3);
            turned += 1;
        }
    }
    if flat > 0 {
        notes.push(format!(
            "{flat} of {} tetrahedra have no volume and are not drawn",
            tets.len()
        ));
    }
    if turned > 0 {
        notes.push(format!(
            "{turned} of {} tetrahedra were inside out and have been turned over",
            tets.len()
        ));
    }
    let mesh = tetrahedra(points, tets, values)?;
    Ok(Loaded {
        data: Data::Tets(mesh),
        field,
        fields,
        notes,
        not_finite,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    fn volume(p: [DVec3; 4]) -> f64 {
        (p[1] - p[0]).cross(p[2] - p[0]).dot(p[3] - p[0]) / 6.0
    }

    /// Cubes, a wedge and a pyramid side by side, numbered in every rotation: volumes add up, shared faces match.
    #[test]
    fn mixed_cells_conform_whatever_their_numbers() {
        let coordinates = [
            [0.0, 0.0, 0.0],
            [1.0, 0.0, 0.0],
            [1.0, 1.0, 0.0],
            [0.0, 1.0, 0.0],
            [0.0, 0.0, 1.0],
            [1.0, 0.0, 1.0],
            [1.0, 1.0, 1.0],
            [0.0, 1.0, 1.0],
            [2.0, 0.0, 0.0],
            [2.0, 1.0, 0.0],
            [2.0, 0.0, 1.0],
            [2.0, 1.0, 1.0],
            [1.5, 2.0, 0.0],
            [1.5, 2.0, 1.0],
            [0.5, 0.5, 2.0],
        ];
        // two cubes, a wedge on the second's side y = 1, a pyramid on the first's top
        let cells: [(u8, Vec<u32>, f64); 4] = [
            (12, vec![0, 1, 2, 3, 4, 5, 6, 7], 1.0),
            (12, vec![1, 8, 9, 2, 5, 10, 11, 6], 1.0),
            (13, vec![2, 9, 12, 6, 11, 13], 0.5),
            (14, vec![4, 5, 6, 7, 14], 1.0 / 3.0),
        ];
        for shift in 0..45u32 {
            let map = |i: u32| (i * 7 + shift) % 15;
            let mut points = vec![DVec3::ZERO; 15];
            for (i, c) in (0..).zip(coordinates) {
                points[map(i) as usize] = DVec3::from_array(c);
            }
            let mut all = Cells {
                points,
                ..Cells::default()
            };
            for (kind, corners, _) in &cells {
                all.types.push(*kind);
                all.corners.extend(corners.iter().map(|&i| map(i)));
                all.ends.push(all.corners.len());
            }
            let tets = all.tetrahedra(&mut Vec::new()).unwrap();
            assert_eq!(tets.len(), 6 + 6 + 3 + 2);
            let mut faces = BTreeMap::new();
            let mut total = 0.0;
            for t in &tets {
                let v = volume(t.map(|i| all.points[i as usize]));
                assert!(v > 0.01, "{v}");
                total += v;
                for k in 0..4 {
                    let mut f: Vec<u32> = (0..4).filter(|&i| i != k).map(|i| t[i]).collect();
                    f.sort_unstable();
                    *faces.entry(f).or_insert(0) += 1;
                }
            }
            assert!((total - cells.iter().map(|c| c.2).sum::<f64>()).abs() < 1e-12);
            assert!(faces.values().all(|&n| n <= 2));
            // On the outside: 8 squares of the cubes, 2 triangles and 2 rectangles of the wedge, 4 triangles of the pyramid.
            assert_eq!(faces.values().filter(|&&n| n == 1).count(), 8 * 2 + 2 + 2 * 2 + 4);
        }
    }
}
