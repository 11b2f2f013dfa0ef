//! A mesh made ready once per data set: cells with a volume, oriented, in blocks with the range of their values.

use crate::exact::volume_sign;
use glam::DVec3;
use isobar_core::{DataError, TetMesh};
use rayon::prelude::*;
use robust::{Coord3D, orient3d};
use std::ops::Range;

/// Cells in a block: neighbours in a file are mostly neighbours in space, so a block without the isovalue is passed over whole.
pub(crate) const BLOCK: usize = 64;

/// A mesh made ready.
#[derive(Debug)]
pub(crate) struct Cells {
    pub(crate) mesh: TetMesh,
    /// Cells with a volume, corners ordered so that it is positive.
    pub(crate) cells: Vec<[u32; 4]>,
    /// Least and greatest value of each block.
    blocks: Vec<[f32; 2]>,
    /// Cells of the mesh whose volume is exactly 0.
    pub(crate) flat: usize,
    /// Cells of the mesh whose corners were given in the other order.
    pub(crate) inverted: usize,
    /// World bounds of all points of the cells.
    pub(crate) bounds: (DVec3, DVec3),
}

/// A cell that meets isovalues.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ActiveCell {
    pub(crate) cell: u32,
    /// The isovalues, as a range of their ascending list.
    pub(crate) from: u8,
    pub(crate) to: u8,
}

/// The sign of the volume, exactly: adaptive floating point first; results that underflow could spoil are confirmed in integers.
fn orientation(p: &[DVec3; 4]) -> i32 {
    let c = |p: DVec3| Coord3D { x: p.x, y: p.y, z: p.z };
    // orient3d is positive where the fourth point lies below the plane of the others seen counterclockwise.
    let v = -orient3d(c(p[0]), c(p[1]), c(p[2]), c(p[3]));
    if v.is_finite() && v.abs() > 1e-250 {
        return if v > 0.0 { 1 } else { -1 };
    }
    volume_sign(p)
}

impl Cells {
    /// Makes a mesh ready.
    ///
    /// # Errors
    /// [`DataError::Mesh`] where no cell has a volume.
    pub(crate) fn new(mesh: &TetMesh) -> Result<Self, DataError> {
        let signs: Vec<i8> = mesh
            .cells
            .par_iter()
            .map(|c| orientation(&c.map(|i| mesh.points[i as usize])) as i8)
            .collect();
        let flat = signs.iter().filter(|s| **s == 0).count();
        let inverted = signs.iter().filter(|s| **s < 0).count();
        let cells: Vec<[u32; 4]> = mesh
            .cells
            .iter()
            .zip(&signs)
            .filter(|(_, s)| **s != 0)
            .map(|(&[a, b, c, d], &s)| if s > 0 { [a, b, c, d] } else { [a, b, d, c] })
            .collect();
        if cells.is_empty() {
            return Err(DataError::Mesh("no cell has a volume".into()));
        }
        let value = |i: u32| mesh.values[i as usize];
        let blocks = cells
            .par_chunks(BLOCK)
            .map(|block| {
                block
                    .iter()
                    .flatten()
                    .fold([f32::INFINITY, f32::NEG_INFINITY], |[lo, hi], &i| {
                        [lo.min(value(i)), hi.max(value(i))]
                    })
            })
            .collect();
        let point = |i: u32| mesh.points[i as usize];
        let bounds = cells
            .par_iter()
            .flatten()
            .fold(
                || (DVec3::INFINITY, DVec3::NEG_INFINITY),
                |(lo, hi), &i| (lo.min(point(i)), hi.max(point(i))),
            )
            .reduce(|| (DVec3::INFINITY, DVec3::NEG_INFINITY), |a, b| (a.0.min(b.0), a.1.max(b.1)));
        if !(bounds.1 - bounds.0).is_finite() {
            return Err(DataError::Mesh("its extent is too large for f64".into()));
        }
        Ok(Self {
            mesh: mesh.clone(),
            cells,
            blocks,
            flat,
            inverted,
            bounds,
        })
    }

    /// Corners of a cell.
    #[inline(always)]
    pub(crate) fn corners(&self, cell: u32) -> [DVec3; 4] {
        self.cells[cell as usize].map(|i| self.mesh.points[i as usize])
    }

    /// Values at the corners.
    #[inline(always)]
    pub(crate) fn values(&self, cell: u32) -> [f64; 4] {
        self.cells[cell as usize].map(|i| f64::from(self.mesh.values[i as usize]))
    }

    /// The cells with an isovalue between their least and greatest value, both included, in order. Blocks without one cost a comparison.
    pub(crate) fn active(&self, isovalues: &[f64]) -> Vec<ActiveCell> {
        if isovalues.is_empty() {
            return Vec::new();
        }
        let inside = |[lo, hi]: [f32; 2]| -> Range<usize> {
            let from = isovalues.partition_point(|&c| c < f64::from(lo));
            let to = isovalues[from..].partition_point(|&c| c <= f64::from(hi));
            from..from + to
        };
        self.blocks
            .par_iter()
            .enumerate()
            .with_min_len(256)
            .flat_map_iter(|(b, &range)| {
                let here = if inside(range).is_empty() {
                    0..0
                } else {
                    b * BLOCK..((b + 1) * BLOCK).min(self.cells.len())
                };
                here.filter_map(move |cell| {
                    let v = self.cells[cell].map(|i| self.mesh.values[i as usize]);
                    let (lo, hi) = (v[0].min(v[1]).min(v[2].min(v[3])), v[0].max(v[1]).max(v[2].max(v[3])));
                    let r = inside([lo, hi]);
                    (!r.is_empty()).then_some(ActiveCell {
                        cell: cell as u32,
                        from: r.start as u8,
                        to: r.end as u8,
                    })
                })
            })
            .collect()
    }

    /// Least and greatest value.
    pub(crate) fn range(&self) -> (f32, f32) {
        self.blocks
            .iter()
            .fold((f32::INFINITY, f32::NEG_INFINITY), |(lo, hi), b| (lo.min(b[0]), hi.max(b[1])))
    }

    /// Bytes beyond the mesh.
    pub(crate) fn bytes(&self) -> usize {
        self.cells.len() * 16 + self.blocks.len() * 8
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_are_oriented_and_flat_ones_left_out() {
        let points = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z, DVec3::splat(0.5)];
        let cells = vec![[0, 1, 2, 3], [0, 2, 1, 3], [0, 1, 1, 3], [1, 2, 3, 4]];
        let mesh = TetMesh::new(points.into(), cells.into(), vec![0.0, 1.0, 2.0, 3.0, 9.0].into()).unwrap();
        let c = Cells::new(&mesh).unwrap();
        assert_eq!((c.cells.len(), c.flat, c.inverted), (3, 1, 1));
        for i in 0..3 {
            assert_eq!(volume_sign(&c.corners(i)), 1);
        }
        assert_eq!(c.bounds, (DVec3::ZERO, DVec3::ONE));
    }

    #[test]
    fn the_index_finds_the_cells_a_search_finds() {
        let n = 3000u32;
        let mut seed = 5u64;
        let mut next = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (seed >> 33) as f32 / (1u64 << 31) as f32
        };
        let points: Vec<DVec3> = (0..4 * n)
            .map(|_| DVec3::new(next().into(), next().into(), next().into()))
            .collect();
        let values: Vec<f32> = (0..4 * n).map(|i| (i / 400) as f32 + (next() * 4.0).floor()).collect();
        let cells: Vec<[u32; 4]> = (0..n).map(|i| [4 * i, 4 * i + 1, 4 * i + 2, 4 * i + 3]).collect();
        let c = Cells::new(&TetMesh::new(points.into(), cells.into(), values.into()).unwrap()).unwrap();
        for isovalues in [vec![], vec![3.0], vec![1.5, 2.0, 2.0000001, 12.0], vec![-1.0], vec![99.0]] {
            let want: Vec<u32> = (0..c.cells.len() as u32)
                .filter(|&i| {
                    let v = c.values(i);
                    let (lo, hi) = (
                        v.iter().copied().fold(f64::INFINITY, f64::min),
                        v.iter().copied().fold(f64::NEG_INFINITY, f64::max),
                    );
                    isovalues.iter().any(|s| (lo..=hi).contains(s))
                })
                .collect();
            let found = c.active(&isovalues);
            assert_eq!(found.iter().map(|a| a.cell).collect::<Vec<_>>(), want);
            for a in found {
                let v = c.values(a.cell);
                for (i, s) in isovalues.iter().enumerate() {
                    let inside = v.iter().any(|v| v <= s) && v.iter().any(|v| v >= s);
                    assert_eq!(inside, (usize::from(a.from)..usize::from(a.to)).contains(&i));
                }
            }
        }
    }
}
