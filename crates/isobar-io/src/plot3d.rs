//! PLOT3D: a curvilinear grid and its solution, each in its own file, to five tetrahedra per cell, or one trilinear element where elements are asked for.
//!
//! One grid, big-endian, no record marks. Grid: three counts (int32), all x, all y, all z (float32, i fastest), perhaps a blanking flag per point (int32;
//! cells with a point of flag 0 are left out). Solution: the same counts, Mach number, angle of attack, Reynolds number, time, then density, the three momenta and the
//! energy, each as a whole array. The solution is found beside the grid: `xyz` in the name becomes `q`, else its extension does.
//!
//! **The split** alternates with the parity of i + j + k, so that the diagonals of shared faces agree.

use crate::cells::{finish, points};
use crate::error::Cause;
use crate::field::{Named, choices, choose};
use crate::finite::{elements as elements_of, replace};
use crate::input::{Input, fill};
use crate::sample::{Layout, Pick, Scalar, numbers_binary};
use crate::{Loaded, Options};
use isobar_core::{DVec3, Data, HexElement};

const FORMAT: &str = "PLOT3D file";

/// Corner n of a cell is at (i + (n & 1), j + (n >> 1 & 1), k + (n >> 2)). Five tetrahedra where i + j + k is even ...
const EVEN: [[u8; 4]; 5] = [[0, 1, 2, 4], [3, 2, 1, 7], [5, 4, 7, 1], [6, 7, 4, 2], [1, 2, 4, 7]];
/// ... and where it is odd.
const ODD: [[u8; 4]; 5] = [[1, 0, 5, 3], [2, 3, 6, 0], [4, 5, 0, 6], [7, 6, 3, 5], [0, 5, 3, 6]];
/// Bytes of the counts.
const COUNTS: u64 = 12;
/// Bytes of the four numbers before the solution.
const CONDITIONS: u64 = 16;

/// Reads the grid named and the solution beside it.
pub(crate) fn read(input: &dyn Input, o: &Options) -> Result<Loaded, Cause> {
    let (_, n) = counts(input)?;
    if blanked(input, n).is_none() {
        return Err(Cause::Unsupported {
            format: "PLOT3D",
            what: "a solution named alone".into(),
            remedy: "name the grid (xyz) file; the solution is found beside it",
        });
    }
    let name = solution_name(input.name()).ok_or_else(|| Cause::Unsupported {
        format: "PLOT3D",
        what: "a grid whose name tells no solution".into(),
        remedy: "call the files NAMExyz.bin and NAMEq.bin, or NAME.xyz and NAME.q",
    })?;
    let solution = input.beside(&name)?;
    read_both(input, &*solution, o)
}

/// The name of the solution of a grid.
fn solution_name(grid: &str) -> Option<String> {
    let lower = grid.to_ascii_lowercase();
    if let Some(at) = lower.rfind("xyz").filter(|_| !lower.ends_with(".xyz")) {
        return Some(format!("{}q{}", &grid[..at], &grid[at + 3..]));
    }
    [".xyz", ".x", ".g"]
        .iter()
        .find(|e| lower.ends_with(*e))
        .map(|e| format!("{}.q", &grid[..grid.len() - e.len()]))
}

/// The counts, and their product.
fn counts(input: &dyn Input) -> Result<([u64; 3], u64), Cause> {
    let mut bytes = [0u8; COUNTS as usize];
    if fill(&mut *input.open(0)?, &mut bytes)? < bytes.len() {
        return Err(Cause::malformed(FORMAT, "it ends in its counts"));
    }
    let mut dims = [0u64; 3];
    for (d, b) in dims.iter_mut().zip(bytes.as_chunks::<4>().0) {
        *d = u64::from(u32::from_be_bytes(*b));
    }
    let n = dims
        .iter()
        .try_fold(1u64, |n, &d| n.checked_mul(d))
        .filter(|&n| dims.iter().all(|&d| d >= 2) && n < u64::from(u32::MAX))
        .ok_or(Cause::Dims(dims))?;
    Ok((dims, n))
}

/// Whether a grid of n points has flags; `None` where it is not a grid by its size.
fn blanked(input: &dyn Input, n: u64) -> Option<bool> {
    match input.len() - COUNTS {
        l if l == 12 * n => Some(false),
        l if l == 16 * n => Some(true),
        _ => None,
    }
}

/// Reads `count` big-endian numbers from `at`.
fn numbers(input: &dyn Input, at: u64, scalar: Scalar, count: u64) -> Result<Vec<f64>, Cause> {
    let there = input.len().saturating_sub(at);
    let layout = Layout {
        scalar,
        big_endian: true,
        components: 1,
        pick: Pick::Component(0),
        count: usize::try_from(count).map_err(|_| Cause::Dims([count, 1, 1]))?,
        scale: None,
    };
    if 4 * count > there {
        return Err(Cause::TooShort {
            declared: 4 * count,
            possible: there,
        });
    }
    numbers_binary(&mut *input.open(at)?, &layout)
}

/// Reads a grid and its solution.
pub(crate) fn read_both(grid: &dyn Input, solution: &dyn Input, o: &Options) -> Result<Loaded, Cause> {
    let (dims, n) = counts(grid)?;
    let flags = blanked(grid, n).ok_or_else(|| Cause::Size {
        declared: COUNTS + 12 * n,
        found: grid.len(),
    })?;
    let (others, _) = counts(solution)?;
    if others != dims {
        return Err(Cause::malformed(
            FORMAT,
            format!("the grid has {dims:?} points, the solution {others:?}"),
        ));
    }
    let named: Vec<Named> = [("density", 1), ("momentum", 3), ("energy", 1)]
        .map(|(name, components)| Named {
            name: name.into(),
            components,
            on_cells: false,
        })
        .into();
    let all = choices(&named);
    let choice = choose(&all, &named, o.field.as_deref())?.clone();
    let part = |i: u64| numbers(solution, COUNTS + CONDITIONS + 4 * n * i, Scalar::F32, n);
    let values: Vec<f64> = match (choice.array, choice.pick) {
        (0, _) => part(0)?,
        (1, Pick::Component(c)) => part(1 + c as u64)?,
        (1, Pick::Magnitude) => {
            let [x, y, z] = [part(1)?, part(2)?, part(3)?];
            (0..x.len())
                .map(|i| (x[i] * x[i] + y[i] * y[i] + z[i] * z[i]).sqrt())
                .collect()
        }
        _ => part(4)?,
    };
    let planes = numbers(grid, COUNTS, Scalar::F32, 3 * n)?;
    let count = planes.len() / 3;
    let interleaved: Vec<f64> = (0..3 * count).map(|i| planes[i % 3 * count + i / 3]).collect();
    let points = points(&interleaved)?;
    let shown: Option<Vec<bool>> = if flags {
        let all = numbers(grid, COUNTS + 12 * n, Scalar::I32, n)?;
        Some(all.iter().map(|&f| f != 0.0).collect())
    } else {
        None
    };
    let [ni, nj, nk] = dims.map(|d| d as usize);
    let cells = (ni - 1) * (nj - 1) * (nk - 1);
    let (mut tets, mut elements) = (Vec::new(), Vec::new());
    if o.as_hexes {
        elements.try_reserve_exact(cells).map_err(|_| Cause::Memory(512 * n))?;
    } else {
        tets.try_reserve_exact(5 * cells).map_err(|_| Cause::Memory(80 * n))?;
    }
    let mut values = values;
    let mut notes = Vec::new();
    let not_finite = if o.as_hexes { replace(&mut values, &mut notes, o)? } else { 0 };
    let mut hidden = 0usize;
    for k in 0..nk - 1 {
        for j in 0..nj - 1 {
            for i in 0..ni - 1 {
                let at = |c: u8| {
                    let c = usize::from(c);
                    ((k + (c >> 2)) * nj + j + (c >> 1 & 1)) * ni + i + (c & 1)
                };
                if shown.as_ref().is_some_and(|s| (0..8).any(|c| !s[at(c)])) {
                    hidden += 1;
                    continue;
                }
                if o.as_hexes {
                    elements.push(linear(std::array::from_fn(|c| at(c as u8)), &points, &values));
                    continue;
                }
                let pattern = if (i + j + k) % 2 == 0 { EVEN } else { ODD };
                tets.extend(pattern.map(|t| t.map(|c| at(c) as u32)));
            }
        }
    }
    if hidden > 0 {
        notes.push(format!("{hidden} cells with a blanked point were left out"));
    }
    let fields = all.into_iter().map(|c| c.name).collect();
    if o.as_hexes {
        return Ok(Loaded {
            data: Data::Hexes(elements_of(elements)?),
            field: choice.name,
            fields,
            notes,
            not_finite,
        });
    }
    let values = values.into_iter().map(|v| v as f32).collect();
    finish(points, tets, values, choice.name, fields, notes, o)
}

/// The trilinear element of eight points, x fastest.
fn linear(corners: [usize; 8], points: &[DVec3], values: &[f64]) -> HexElement {
    let place = |i: usize| {
        let p = points[i];
        [p.x, p.y, p.z, 1.0]
    };
    HexElement {
        degree: [1; 3],
        points: corners.iter().map(|&i| place(i)).collect(),
        value_degree: [1; 3],
        values: corners.iter().map(|&i| values[i]).collect(),
        rational_value: false,
    }
}

#[cfg(test)]
mod tests {
    use super::solution_name;

    #[test]
    fn solutions_are_found_by_name() {
        for (grid, solution) in [
            ("bluntfinxyz.bin", "bluntfinq.bin"),
            ("a.xyz", "a.q"),
            ("POSTXYZ.BIN", "POSTq.BIN"),
            ("b.x", "b.q"),
        ] {
            assert_eq!(solution_name(grid).as_deref(), Some(solution));
        }
        assert_eq!(solution_name("a.bin"), None);
    }
}
