//! Legacy VTK, DATASET UNSTRUCTURED_GRID: the arrays that [`crate::vtk`] found, to tetrahedra.
//!
//! Up to version 4.2 CELLS holds, for each cell, its number of corners and the corners; version 5 has OFFSETS (one more than cells) and CONNECTIVITY.

use crate::cells::{Cells, field, indices, points};
use crate::error::{Cause, quoted};
use crate::field::Named;
use crate::sample::{Layout, Pick, numbers_binary, numbers_text, read_binary, read_text};
use crate::vtk::{Array, Kind, Scan, malformed};
use crate::vtu::{ends, picked};
use crate::{Loaded, Options, lagrange};

/// Reads the mesh of a scanned file.
pub(crate) fn read(scan: &Scan<'_>, o: &Options) -> Result<Loaded, Cause> {
    let named: Vec<Named> = scan.arrays.iter().map(|a| a.named.clone()).collect();
    let (choice, fields) = field(&named, o, "legacy VTK")?;
    let geometry = |name: &str| {
        let all = scan.cells.iter().flatten();
        all.into_iter().find(|a| a.named.name == name)
    };
    let needed = |name: &str| geometry(name).ok_or_else(|| malformed(format!("there are no {name}")));
    let coordinates = needed("POINTS")?;
    let types = numbers(scan, needed("CELL_TYPES")?, 1)?;
    let points = points(&numbers(scan, coordinates, 3)?)?;
    let (ends, corners) = if let Some(offsets) = geometry("OFFSETS") {
        let offsets = numbers(scan, offsets, 1)?;
        let corners = numbers(scan, needed("CONNECTIVITY")?, 1)?;
        let ends = ends(offsets.get(1..).unwrap_or_default())?;
        if offsets.first() != Some(&0.0) || ends.last() != Some(&corners.len()) {
            return Err(malformed(format!(
                "the OFFSETS do not go from 0 to the {} numbers of CONNECTIVITY",
                corners.len()
            )));
        }
        (ends, corners)
    } else {
        let cells = needed("CELLS")?;
        counted(&numbers(scan, cells, 1)?, cells.named.components)?
    };
    if ends.is_empty() {
        return Err(malformed("there are no cells"));
    }
    if types.len() != ends.len() {
        return Err(malformed(format!(
            "there are {} cells but {} CELL_TYPES",
            ends.len(),
            types.len()
        )));
    }
    let corners = indices(&corners, points.len())?;
    let array = &scan.arrays[choice.array];
    let on_cells = array.named.on_cells;
    let (wanted, what) = if on_cells {
        (ends.len(), "cells")
    } else {
        (points.len(), "points")
    };
    if array.tuples != wanted as u64 {
        return Err(malformed(format!(
            "array {} has {} tuples, there are {wanted} {what}",
            quoted(&array.named.name),
            array.tuples
        )));
    }
    let layout = layout(array, array.named.components, choice.pick)?;
    let mut notes = Vec::new();
    if o.as_hexes || types.contains(&f64::from(lagrange::TYPE)) {
        let all = numbers(scan, array, array.named.components)?;
        let cells = lagrange::Cells {
            points,
            types: types.iter().map(|&t| t as u8).collect(),
            ends,
            corners,
            values: picked(&all, &layout),
            on_cells,
            new_numbering: scan.version >= (5, 1),
        };
        return cells.loaded(choice, fields, notes, o);
    }
    let mut reader = scan.input.open(array.at)?;
    let samples = if scan.binary {
        read_binary(&mut *reader, &layout, &mut notes)?
    } else {
        read_text(&mut *reader, &layout, &mut notes)?
    };
    let values = (0..samples.len()).map(|i| samples.get(i) as f32).collect();
    let cells = Cells {
        points,
        types: types.iter().map(|&t| t as u8).collect(),
        ends,
        corners,
    };
    cells.loaded(values, on_cells, choice, fields, notes, o)
}

/// Corners behind their number, `n` times.
fn counted(numbers: &[f64], n: usize) -> Result<(Vec<usize>, Vec<f64>), Cause> {
    let (mut ends, mut corners) = (Vec::new(), Vec::with_capacity(numbers.len()));
    let mut rest = numbers;
    while let Some((&count, more)) = rest.split_first() {
        if !(count >= 0.0 && count <= more.len() as f64) {
            return Err(malformed(format!(
                "cell {} has {count} corners, {} numbers are left",
                ends.len(),
                more.len()
            )));
        }
        let (own, after) = more.split_at(count as usize);
        corners.extend_from_slice(own);
        ends.push(corners.len());
        rest = after;
    }
    if ends.len() != n {
        return Err(malformed(format!("CELLS declares {n} cells but holds {}", ends.len())));
    }
    Ok((ends, corners))
}

fn layout(array: &Array, components: usize, pick: Pick) -> Result<Layout, Cause> {
    let Kind::Number(scalar) = array.kind else {
        return Err(Cause::Unsupported {
            format: "legacy VTK",
            what: format!("array {} of type bit", quoted(&array.named.name)),
            remedy: "choose another with --field",
        });
    };
    let count = usize::try_from(array.tuples).map_err(|_| Cause::Dims([array.tuples, 1, 1]))?;
    Ok(Layout {
        scalar,
        big_endian: true,
        components,
        pick,
        count,
        scale: None,
    })
}

/// All numbers of an array; the scan has found that they can be there.
fn numbers(scan: &Scan<'_>, array: &Array, components: usize) -> Result<Vec<f64>, Cause> {
    let layout = layout(array, components, Pick::Component(0))?;
    let mut reader = scan.input.open(array.at)?;
    if scan.binary {
        return numbers_binary(&mut *reader, &layout);
    }
    numbers_text(&mut *reader, &layout)
}
