//! Explicit conversions of a grid to cells. Nothing converts silently.

use isobar_core::{DataError, Grid, HexElement, HexPatches, TetMesh};
use rayon::prelude::*;

/// Corner n of a cell is at (i + (n & 1), j + (n >> 1 & 1), k + (n >> 2)). Five tetrahedra where i + j + k is even ...
const EVEN: [[u8; 4]; 5] = [[0, 1, 2, 4], [3, 2, 1, 7], [5, 4, 7, 1], [6, 7, 4, 2], [1, 2, 4, 7]];
/// ... and where it is odd, so that the diagonals of shared faces agree.
const ODD: [[u8; 4]; 5] = [[1, 0, 5, 3], [2, 3, 6, 0], [4, 5, 0, 6], [7, 6, 3, 5], [0, 5, 3, 6]];

/// More tetrahedra than this (2 GiB of indices) are refused.
const MAX_TETS: usize = 1 << 27;
/// More elements than this (about 1.8 GiB) are refused.
const MAX_HEXES: usize = 1 << 22;

/// The number of cells of a grid with at least two samples along each axis. `form` is what becomes of it.
fn cells(grid: &Grid, form: &str) -> Result<[usize; 3], DataError> {
    if grid.dims.iter().any(|&n| n < 2) {
        return Err(DataError::TooThin {
            reconstruction: form.to_owned(),
            dims: grid.dims,
        });
    }
    Ok(grid.dims.map(|n| n - 1))
}

/// Why a grid makes too many cells of a kind, if it does: `per` of them per cell of the grid.
fn too_many(cells: [usize; 3], per: usize, most: usize, what: &str) -> Option<String> {
    let n = cells.iter().fold(per as u128, |n, &c| n.saturating_mul(c as u128));
    (n > most as u128).then(|| format!("{n} {what} of {cells:?} cells are more than {most}"))
}

/// Five tetrahedra per cell, alternating with the parity of i + j + k; points and values are the samples.
///
/// All volumes are positive (a left-handed grid has two corners of each cell exchanged), the mesh is conforming, and the linear
/// interpolant on it agrees with the samples, not with the trilinear reconstruction between them.
///
/// # Errors
/// [`DataError::TooThin`] where an axis has one sample only, [`DataError::Mesh`] where there would be more than 2^27 tetrahedra,
/// [`DataError::NotFinite`] where a sample is NaN or infinite.
pub fn grid_to_tets(grid: &Grid) -> Result<TetMesh, DataError> {
    let cells = cells(grid, "as=tets")?;
    if let Some(reason) = too_many(cells, 5, MAX_TETS, "tetrahedra") {
        return Err(DataError::Mesh(reason));
    }
    grid.require_finite()?;
    let domain = grid.domain();
    let [nx, ny, _] = grid.dims;
    let points: Vec<_> = (0..grid.samples.len())
        .into_par_iter()
        .map(|n| domain.world(glam::DVec3::new((n % nx) as f64, (n / nx % ny) as f64, (n / nx / ny) as f64)))
        .collect();
    let values: Vec<f32> = (0..grid.samples.len())
        .into_par_iter()
        .map(|n| grid.samples.get(n) as f32)
        .collect();
    let left_handed = domain.axes.determinant() < 0.0;
    let tets: Vec<[u32; 4]> = (0..cells[2] * cells[1])
        .into_par_iter()
        .flat_map_iter(|row| {
            let (j, k) = (row % cells[1], row / cells[1]);
            (0..cells[0]).flat_map(move |i| {
                let corners = if (i + j + k) % 2 == 0 { EVEN } else { ODD };
                corners.map(|tet| {
                    let mut tet = tet.map(|n| {
                        let n = usize::from(n);
                        (((k + (n >> 2)) * ny + j + (n >> 1 & 1)) * nx + i + (n & 1)) as u32
                    });
                    if left_handed {
                        tet.swap(2, 3);
                    }
                    tet
                })
            })
        })
        .collect();
    TetMesh::new(points.into(), tets.into(), values.into())
}

/// One trilinear Bezier element per cell, x fastest, weights 1: its attribute is the trilinear reconstruction of the grid. Samples that are NaN or infinite stay so:
/// [`HexPatches::new`] refuses such elements.
///
/// # Errors
/// [`DataError::TooThin`] where an axis has one sample only, [`DataError::Elements`] where there would be more than 2^22 elements.
pub fn grid_to_hexes(grid: &Grid) -> Result<HexPatches, DataError> {
    let cells = cells(grid, "as=hexes")?;
    if let Some(reason) = too_many(cells, 1, MAX_HEXES, "elements") {
        return Err(DataError::Elements(reason));
    }
    let domain = grid.domain();
    let elements: Vec<HexElement> = (0..cells.iter().product::<usize>())
        .into_par_iter()
        .map(|n| {
            let cell = [n % cells[0], n / cells[0] % cells[1], n / cells[0] / cells[1]];
            let corner = |n: usize| [cell[0] + (n & 1), cell[1] + (n >> 1 & 1), cell[2] + (n >> 2)];
            HexElement {
                degree: [1; 3],
                points: (0..8)
                    .map(|n| {
                        let x = domain.world(glam::DVec3::from_array(corner(n).map(|i| i as f64)));
                        [x.x, x.y, x.z, 1.0]
                    })
                    .collect(),
                value_degree: [1; 3],
                values: (0..8).map(|n| grid.sample(corner(n))).collect(),
                rational_value: false,
            }
        })
        .collect();
    Ok(HexPatches {
        elements: elements.into(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DMat3, DVec3};
    use isobar_core::Samples;

    fn grid(dims: [usize; 3], direction: DMat3) -> Grid {
        let n = dims.iter().product::<usize>();
        let s: Vec<u16> = (0..n).map(|i| (i * 7919 % 1000) as u16).collect();
        Grid::new(
            dims,
            DVec3::new(0.5, 2.0, 1.0),
            DVec3::new(1.0, -3.0, 0.25),
            direction,
            Samples::U16(s.into()),
        )
        .unwrap()
    }

    fn volume(m: &TetMesh, c: [u32; 4]) -> f64 {
        let p = c.map(|i| m.points[i as usize]);
        (p[1] - p[0]).cross(p[2] - p[0]).dot(p[3] - p[0]) / 6.0
    }

    #[test]
    fn tetrahedra_fill_the_box_and_share_faces() {
        let mirrored = DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0));
        for direction in [DMat3::IDENTITY, mirrored] {
            let g = grid([4, 3, 5], direction);
            let m = grid_to_tets(&g).unwrap();
            assert_eq!((m.cells.len(), m.points.len()), (5 * 3 * 2 * 4, 60));
            let mut total = 0.0;
            let mut faces = std::collections::BTreeMap::new();
            for &c in m.cells.iter() {
                let v = volume(&m, c);
                assert!(v > 0.1, "{c:?} has volume {v}");
                total += v;
                for leave in 0..4 {
                    let mut f: Vec<u32> = (0..4).filter(|&i| i != leave).map(|i| c[i]).collect();
                    f.sort_unstable();
                    *faces.entry(f).or_insert(0) += 1;
                }
            }
            assert!((total - 24.0).abs() < 1e-12);
            // Every face is shared by two, or lies on the boundary: two triangles per boundary square.
            assert!(faces.values().all(|&n| n <= 2));
            assert_eq!(faces.values().filter(|&&n| n == 1).count(), 2 * 2 * (3 * 2 + 2 * 4 + 3 * 4));
            assert_eq!(f64::from(m.values[17]), g.samples.get(17));
        }
    }

    #[test]
    fn elements_have_the_corners_of_their_cells() {
        let g = grid([3, 4, 2], DMat3::IDENTITY);
        let h = grid_to_hexes(&g).unwrap();
        assert_eq!(h.elements.len(), 6);
        let e = &h.elements[2 * 2 + 1]; // cell (1, 2, 0)
        assert_eq!(e.values[0], g.sample([1, 2, 0]));
        assert_eq!(e.values[6], g.sample([1, 3, 1]));
        let x = g.domain().world(DVec3::new(2.0, 2.0, 1.0));
        assert_eq!(e.points[5], [x.x, x.y, x.z, 1.0]);
    }

    #[test]
    fn thin_huge_and_bad_grids_are_refused() {
        let one = Grid::unit([1, 4, 4], Samples::U8(vec![0; 16].into())).unwrap();
        let thin = |form: &str| DataError::TooThin {
            reconstruction: form.into(),
            dims: [1, 4, 4],
        };
        assert_eq!(grid_to_tets(&one), Err(thin("as=tets")));
        assert_eq!(grid_to_hexes(&one), Err(thin("as=hexes")));
        let large = Grid::unit([302, 302, 302], Samples::U8(vec![0; 302 * 302 * 302].into())).unwrap();
        let said = |e: DataError, words: [&str; 2]| {
            let text = e.to_string();
            assert!(words.iter().all(|w| text.contains(w)), "{text}");
        };
        said(
            grid_to_tets(&large).unwrap_err(),
            ["136354505 tetrahedra", "more than 134217728"],
        );
        said(grid_to_hexes(&large).unwrap_err(), ["27270901 elements", "more than 4194304"]);
        let nan = Grid::unit([2, 2, 2], Samples::F32(vec![f32::NAN; 8].into())).unwrap();
        assert!(matches!(grid_to_tets(&nan), Err(DataError::NotFinite { count: 8, total: 8 })));
        let kept = grid_to_hexes(&nan).unwrap();
        assert!(kept.elements[0].values.iter().all(|v| v.is_nan()) && HexPatches::new(kept.elements).is_err());
    }
}
