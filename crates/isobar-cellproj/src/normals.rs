//! Normals at the points of a mesh, for smooth shading: Roettger, Kraus, Ertl 2000, section 8.
//!
//! The gradient at a point is the mean of those of the cells around it, each with the weight of its volume. On a cell the normals are then linear. The paper shades the front and
//! the back face and adds them with the weights (s_iso - s_b)/(s_f - s_b) and one minus that: the first is the share of the way from the back face to the
//! front face at which s = s_iso, so what it interpolates at the hit is what the normals of the corners give with the hit's barycentric weights.
//! [`Shading`] does the latter: it holds in perspective too, and needs no face.

use crate::mesh::Cells;
use crate::resolve::{Gradient, Root};
use crate::topology::canonical;
use glam::{DVec3, Vec3};
use isobar_core::Ray;

/// Unit normals of all points along the mean gradient; 0 where that vanishes and at points of no cell. Points with the same coordinates have the same.
pub(crate) fn at_points(mesh: &Cells) -> Vec<Vec3> {
    let (ids, _) = canonical(&mesh.mesh.points);
    let mut sums = vec![DVec3::ZERO; ids.len()];
    for (i, corners) in mesh.cells.iter().enumerate() {
        let i = i as u32;
        // Six volumes times the gradient: the weight is in it.
        let gradient = Gradient::new(&mesh.corners(i), &mesh.values(i)).scaled;
        for &c in corners {
            sums[ids[c as usize] as usize] += gradient;
        }
    }
    ids.iter().map(|&i| sums[i as usize].normalize_or_zero().as_vec3()).collect()
}

/// The section's weight of the front face: the share of the way from the back face to the front at which s is `isovalue`, in [0, 1]. Where both values are equal there
/// is no way; then 1/2 (hardcases E7).
#[inline(always)]
pub(crate) fn front_weight(front: f64, back: f64, isovalue: f64) -> f64 {
    let weight = (isovalue - back) / (front - back);
    if weight.is_finite() { weight.clamp(0.0, 1.0) } else { 0.5 }
}

/// How hits are shaded.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Shading<'a> {
    /// With the gradient of the cell.
    Flat,
    /// With the normals of the cell's corners, linear between.
    Smooth(&'a [Vec3]),
}

impl Shading<'_> {
    /// The normal that shades a hit: unit, or 0 where there is no gradient.
    #[inline(always)]
    pub(crate) fn normal(self, mesh: &Cells, ray: &Ray, root: &Root) -> [f32; 3] {
        let Self::Smooth(normals) = self else {
            return root.normal();
        };
        let p = mesh.corners(root.cell);
        let at = ray.at(root.t) - p[0];
        let (a, b, d) = (p[1] - p[0], p[2] - p[0], p[3] - p[0]);
        let (na, nb, nd) = (b.cross(d), d.cross(a), a.cross(b));
        let one = 1.0 / a.dot(na);
        let w = [na, nb, nd].map(|n| (n.dot(at) * one).clamp(0.0, 1.0) as f32);
        let [n0, n1, n2, n3] = mesh.cells[root.cell as usize].map(|i| normals[i as usize]);
        let rest = 1.0 - w[0] - w[1] - w[2];
        (n0 * rest + n1 * w[0] + n2 * w[1] + n3 * w[2]).normalize_or_zero().to_array()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use isobar_core::TetMesh;
    use isobar_fields::Synthetic;

    /// hardcases E7.
    #[test]
    fn weights_of_the_faces() {
        assert!((front_weight(0.2, 0.8, 0.3) - 5.0 / 6.0).abs() < 1e-15);
        assert!((front_weight(0.8, 0.2, 0.3) - 1.0 / 6.0).abs() < 1e-15);
        assert_eq!((front_weight(0.3, 0.8, 0.3), front_weight(0.8, 0.3, 0.3)), (1.0, 0.0));
        assert_eq!((front_weight(0.5, 0.5, 0.5), front_weight(0.5, 0.5, 0.2)), (0.5, 0.5));
    }

    /// A linear field has one normal everywhere, also where points come twice; a sphere's turn with the place.
    #[test]
    fn normals_follow_the_field() {
        let data = "sphere,n=9,as=tets".parse::<Synthetic>().unwrap().data().unwrap();
        let isobar_core::Data::Tets(mesh) = data else {
            panic!("a mesh")
        };
        let linear: Vec<f32> = mesh.points.iter().map(|p| (p.x + 2.0 * p.y - p.z) as f32).collect();
        // Each cell with points of its own.
        let points: Vec<DVec3> = mesh.cells.iter().flatten().map(|&i| mesh.points[i as usize]).collect();
        let values: Vec<f32> = mesh.cells.iter().flatten().map(|&i| linear[i as usize]).collect();
        let cells: Vec<[u32; 4]> = (0..mesh.cells.len() as u32)
            .map(|i| [4 * i, 4 * i + 1, 4 * i + 2, 4 * i + 3])
            .collect();
        let apart = TetMesh::new(points.into(), cells.into(), values.into()).unwrap();
        let want = Vec3::new(1.0, 2.0, -1.0).normalize();
        for n in at_points(&Cells::new(&apart).unwrap()) {
            assert!((n - want).length() < 1e-5, "{n}");
        }
        let cells = Cells::new(&mesh).unwrap();
        for (p, n) in mesh.points.iter().zip(at_points(&cells)) {
            let inside = p.abs().max_element() < 1.0;
            if inside && p.length() > 0.4 {
                assert!(n.dot(p.normalize().as_vec3()) > 0.99, "{p}: {n}");
            }
        }
    }
}
