//! NaN and infinite values of meshes and elements: read as a number where that is asked, else kept and counted, so that they can be told and refused by who draws.

use crate::Options;
use crate::error::Cause;
use isobar_core::{DVec3, HexElement, HexPatches, TetMesh};
use std::sync::Arc;

/// Replaces NaN and infinite values as asked; how many are left.
pub(crate) fn replace(values: &mut [f64], notes: &mut Vec<String>, o: &Options) -> Result<usize, Cause> {
    let bad = values.iter().filter(|v| !v.is_finite()).count();
    let Some(value) = o.nan.filter(|_| bad > 0) else {
        return Ok(bad);
    };
    if !value.is_finite() {
        return Err(Cause::Replacement(value));
    }
    values.iter_mut().filter(|v| !v.is_finite()).for_each(|v| *v = value);
    notes.push(format!("{bad} NaN or infinite values were read as {value}"));
    Ok(0)
}

/// The refusal of a reader that cannot keep `bad` of them.
pub(crate) fn refusal(format: &'static str, bad: usize) -> Cause {
    Cause::Unsupported {
        format,
        what: format!("{bad} NaN or infinite values"),
        remedy: "give --nan C to read them as C",
    }
}

/// Elements, everything of them checked but that their values are finite.
pub(crate) fn elements(mut elements: Vec<HexElement>) -> Result<HexPatches, Cause> {
    let mut kept = Vec::new();
    for (i, e) in elements.iter_mut().enumerate() {
        if e.values.iter().any(|v| !v.is_finite()) {
            let zeros = vec![0.0; e.values.len()].into();
            kept.push((i, std::mem::replace(&mut e.values, zeros)));
        }
    }
    let mut patches = HexPatches::new(elements)?;
    // Nobody else has them yet.
    if let Some(all) = Arc::get_mut(&mut patches.elements) {
        for (i, values) in kept {
            all[i].values = values;
        }
    }
    Ok(patches)
}

/// Tetrahedra, everything of them checked but that their values are finite.
pub(crate) fn tetrahedra(points: Vec<DVec3>, cells: Vec<[u32; 4]>, values: Vec<f32>) -> Result<TetMesh, Cause> {
    let finite = values.iter().map(|v| if v.is_finite() { *v } else { 0.0 }).collect();
    let mut mesh = TetMesh::new(points.into(), cells.into(), finite)?;
    if mesh.values.iter().zip(&values).any(|(a, b)| a.to_bits() != b.to_bits()) {
        mesh.values = values.into();
    }
    Ok(mesh)
}
