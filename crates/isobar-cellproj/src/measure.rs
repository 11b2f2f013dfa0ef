//! Lengths of cells that tables need.

use crate::mesh::Cells;
use rayon::prelude::*;

/// Lengths of the stays of rays in the cells of a mesh.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Lengths {
    /// The longest edge: no stay is longer.
    pub(crate) longest: f64,
    /// The mean over isotropic rays, 4 volumes over the surface (Cauchy), of all cells together: the paper's average thickness.
    pub(crate) average: f64,
}

impl Lengths {
    pub(crate) fn new(mesh: &Cells) -> Self {
        let of = |i: u32| {
            let p = mesh.corners(i);
            let (a, b, d) = (p[1] - p[0], p[2] - p[0], p[3] - p[0]);
            let normals = [a.cross(b), b.cross(d), d.cross(a), (b - a).cross(d - a)];
            let surface: f64 = normals.iter().map(|n| 0.5 * n.length()).sum();
            let edges = [a, b, d, b - a, d - a, d - b];
            let longest = edges.iter().fold(0.0, |m: f64, e| m.max(e.length()));
            (longest, (a.dot(normals[1]) / 6.0).abs(), surface)
        };
        // Sums over fixed runs of cells, so that they do not depend on threads.
        let runs: Vec<(f64, f64, f64)> = (0..mesh.cells.len().div_ceil(4096))
            .into_par_iter()
            .map(|r| {
                (r * 4096..((r + 1) * 4096).min(mesh.cells.len()))
                    .map(|i| of(i as u32))
                    .fold((0.0, 0.0, 0.0), |s: (f64, f64, f64), c| (s.0.max(c.0), s.1 + c.1, s.2 + c.2))
            })
            .collect();
        let all = runs
            .iter()
            .fold((0.0, 0.0, 0.0), |s: (f64, f64, f64), c| (s.0.max(c.0), s.1 + c.1, s.2 + c.2));
        let average = 4.0 * all.1 / all.2;
        Self {
            longest: all.0,
            average: if average > 0.0 && average.is_finite() {
                average
            } else {
                all.0
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use isobar_core::TetMesh;

    #[test]
    fn the_regular_tetrahedron() {
        // Edge sqrt 8: volume 8/3, surface 8 sqrt 3.
        let points = vec![
            DVec3::new(1.0, 1.0, 1.0),
            DVec3::new(1.0, -1.0, -1.0),
            DVec3::new(-1.0, 1.0, -1.0),
            DVec3::new(-1.0, -1.0, 1.0),
        ];
        let mesh = TetMesh::new(points.into(), vec![[0, 1, 2, 3]].into(), vec![0.0; 4].into()).unwrap();
        let l = Lengths::new(&Cells::new(&mesh).unwrap());
        assert!(
            (l.longest - 8f64.sqrt()).abs() < 1e-12 && (l.average - 4.0 / 3.0 / 3f64.sqrt()).abs() < 1e-12,
            "{l:?}"
        );
    }
}
