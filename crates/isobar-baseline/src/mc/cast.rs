//! Rays against the mesh: a compressed wide bounding volume hierarchy (crate `obvhs`: PLOC builder, CWBVH of Ylitie, Karras and Laine,
//! HPG 2017) and the watertight triangle test of Woop, Benthin and Wald (JCGT 2(1), 2013).
//!
//! The hierarchy is f32 and its boxes are widened by more than a ray's rounding, so that it only ever offers too much; the triangle
//! test is f64, with the ray's origin moved to where it enters the grid.

use super::mesh::{Mesh, Vertex};
use crate::index_space::IndexRay;
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::cwbvh::{CwBvh, builder::build_cwbvh};
use obvhs::ray::{Ray as BvhRay, RayHit};
use std::time::Duration;

/// A mesh ready for rays.
///
/// One triangle per leaf entry: groups of up to 4 neighbours in one entry took half the time and memory to build, and half as long
/// again to render (a triangle test with its vertices costs about 50 ns).
#[derive(Debug)]
pub(crate) struct Scene {
    vertices: Vec<Vertex>,
    /// In the order of the hierarchy's leaves.
    triangles: Vec<[u32; 3]>,
    bvh: Option<CwBvh>,
    /// Cells of the grid per edge of the lattice.
    scale: f64,
}

/// A hit of a triangle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct TriangleHit {
    /// In the ray's unit.
    pub(crate) t: f64,
    /// Its position in the scene.
    pub(crate) triangle: u32,
    /// Number of its isovalue.
    pub(crate) isovalue: usize,
}

/// Hits of one surface nearer than this, in voxels, are one: a ray through an edge meets both triangles.
const SAME: f64 = 1e-9;

impl Scene {
    /// Builds the hierarchy over the triangles that have an area; `scale` is one over the refinement, `dims` the grid's.
    pub(crate) fn new(mut mesh: Mesh, scale: f64, dims: [usize; 3]) -> Self {
        let largest = dims.iter().copied().max().unwrap_or(1) as f64;
        // A ray's f32 coordinates are off by some ulps of the largest coordinate.
        let pad = (largest * 16.0 * f64::from(f32::EPSILON)) as f32;
        mesh.triangles.retain(|t| {
            let [a, b, c] = t.map(|i| mesh.vertices[i as usize].position(scale));
            a != b && b != c && c != a
        });
        let boxes: Vec<Aabb> = mesh
            .triangles
            .iter()
            .map(|t| {
                let p = t.map(|i| mesh.vertices[i as usize].position(scale));
                let end = |f: fn(f64, f64) -> f64| std::array::from_fn::<f32, 3, _>(|a| f(f(p[0][a], p[1][a]), p[2][a]) as f32);
                let (lo, hi) = (end(f64::min), end(f64::max));
                Aabb::new((glam::Vec3A::from_array(lo)) - pad, glam::Vec3A::from_array(hi) + pad)
            })
            .collect();
        let bvh = (!boxes.is_empty()).then(|| {
            let mut bvh = build_cwbvh(&boxes, BvhBuildParams::fast_build(), &mut Duration::default());
            mesh.triangles = bvh.primitive_indices.iter().map(|&i| mesh.triangles[i as usize]).collect();
            bvh.primitive_indices = Vec::new();
            bvh.nodes.shrink_to_fit();
            bvh.exact_node_aabbs = None;
            bvh
        });
        mesh.vertices.shrink_to_fit();
        mesh.triangles.shrink_to_fit();
        Self {
            vertices: mesh.vertices,
            triangles: mesh.triangles,
            bvh,
            scale,
        }
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        self.vertices.capacity() * size_of::<Vertex>()
            + self.triangles.capacity() * 12
            + self.bvh.as_ref().map_or(0, |b| b.nodes.capacity() * size_of_val(&b.nodes[0]))
    }

    /// Triangles with an area.
    pub(crate) fn len(&self) -> usize {
        self.triangles.len()
    }

    fn corners(&self, triangle: u32) -> [[f64; 3]; 3] {
        self.triangles[triangle as usize].map(|i| self.vertices[i as usize].position(self.scale))
    }

    /// Index-space normal of a triangle, along the gradient (to where s is greater), any length.
    pub(crate) fn normal(&self, triangle: u32) -> [f64; 3] {
        let [a, b, c] = self.corners(triangle).map(isobar_core::DVec3::from_array);
        (c - a).cross(b - a).to_array()
    }

    /// The first hit with t in [t0, t1], the stretch of the ray inside the grid; counts triangle tests in `tests`.
    pub(crate) fn first(&self, ray: &IndexRay, [t0, t1]: [f64; 2], tests: &mut u32) -> Option<TriangleHit> {
        let bvh = self.bvh.as_ref()?;
        let local = Local::new(ray, t0, t1);
        let mut best: Option<(f64, u32)> = None;
        bvh.ray_traverse(local.ray, &mut RayHit::none(), |_, i| {
            *tests += 1;
            let i = i as u32;
            let Some(t) = local.woop.hit(self.corners(i)).filter(|t| t0 + t >= 0.0) else {
                return f32::INFINITY;
            };
            if best.is_none_or(|b| (t, i) < b) {
                best = Some((t, i));
            }
            // widened, so that a hit as near as this one is still looked at
            local.to_bvh(t)
        });
        best.map(|(t, triangle)| self.told(t0 + t, triangle))
    }

    /// All hits with t in [t0, t1] in the order of t, each root once, into `out`.
    pub(crate) fn all(&self, ray: &IndexRay, [t0, t1]: [f64; 2], tests: &mut u32, out: &mut Vec<TriangleHit>) {
        out.clear();
        let Some(bvh) = &self.bvh else {
            return;
        };
        let local = Local::new(ray, t0, t1);
        bvh.ray_traverse_anyhit(local.ray, |_, i| {
            *tests += 1;
            if let Some(t) = local.woop.hit(self.corners(i as u32)).filter(|t| t0 + t >= 0.0) {
                out.push(self.told(t0 + t, i as u32));
            }
        });
        let same = SAME / ray.speed();
        out.sort_by(|a, b| {
            a.isovalue
                .cmp(&b.isovalue)
                .then(a.t.total_cmp(&b.t))
                .then(a.triangle.cmp(&b.triangle))
        });
        out.dedup_by(|b, a| a.isovalue == b.isovalue && b.t - a.t <= same);
        out.sort_by(|a, b| a.t.total_cmp(&b.t).then(a.isovalue.cmp(&b.isovalue)));
    }

    fn told(&self, t: f64, triangle: u32) -> TriangleHit {
        let vertex = self.triangles[triangle as usize][0];
        TriangleHit {
            t,
            triangle,
            isovalue: self.vertices[vertex as usize].isovalue(),
        }
    }
}

/// A ray as the hierarchy and the triangle test see it: from its entry into the grid on, t counted from there.
struct Local {
    ray: BvhRay,
    woop: Woop,
    /// Voxels per unit of t, and where the hierarchy's own t is 0: a voxel before the entry.
    speed: f64,
}

/// The hierarchy's ray starts this many voxels before the entry.
const BEFORE: f64 = 1.0;

impl Local {
    fn new(ray: &IndexRay, t0: f64, t1: f64) -> Self {
        let speed = ray.speed();
        let entry = ray.at(t0).get();
        let direction = ray.d.map(|d| d / speed);
        let start: [f64; 3] = std::array::from_fn(|a| entry[a] - BEFORE * direction[a]);
        let length = ((t1 - t0) * speed + 2.0 * BEFORE) as f32 * 1.0001;
        // Adding zero turns -0 into +0: the hierarchy takes the octant from `< 0` but the reciprocal's sign from the sign bit, and where the
        // two disagree it finds nothing.
        let vector = |v: [f64; 3]| glam::Vec3A::from_array(v.map(|x| x as f32 + 0.0));
        Self {
            ray: BvhRay::new(vector(start), vector(direction), 0.0, length),
            woop: Woop::new(entry, ray.d),
            speed,
        }
    }

    /// The t of the hierarchy's ray for a t from the entry on, rounded up.
    fn to_bvh(&self, t: f64) -> f32 {
        let t = (t * self.speed + BEFORE) as f32;
        t + t.abs() * 16.0 * f32::EPSILON + 1e-4
    }
}

/// The shear that takes the ray to the z axis (Woop et al., section 3), in f64.
struct Woop {
    axes: [usize; 3],
    shear: [f64; 3],
    origin: [f64; 3],
}

impl Woop {
    fn new(origin: [f64; 3], d: [f64; 3]) -> Self {
        let z = (0..3).fold(0, |z, a| if d[a].abs() > d[z].abs() { a } else { z });
        let axes = [(z + 1) % 3, (z + 2) % 3, z];
        Self {
            axes,
            shear: [d[axes[0]] / d[z], d[axes[1]] / d[z], 1.0 / d[z]],
            origin,
        }
    }

    /// t of the plane of the triangle where the ray passes through it, edges included. Both triangles of an edge compute the same edge
    /// function with the other sign, so that no ray passes between them.
    fn hit(&self, corners: [[f64; 3]; 3]) -> Option<f64> {
        let [kx, ky, kz] = self.axes;
        let [a, b, c] = corners.map(|p| {
            let z = p[kz] - self.origin[kz];
            let x = p[kx] - self.origin[kx] - self.shear[0] * z;
            let y = p[ky] - self.origin[ky] - self.shear[1] * z;
            [x, y, z * self.shear[2]]
        });
        let u = c[0] * b[1] - c[1] * b[0];
        let v = a[0] * c[1] - a[1] * c[0];
        let w = b[0] * a[1] - b[1] * a[0];
        if (u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0) {
            return None;
        }
        let det = u + v + w;
        (det != 0.0).then(|| (u * a[2] + v * b[2] + w * c[2]) / det)
    }
}

#[cfg(test)]
mod tests {
    use super::super::mesh::Lattice;
    use super::*;
    use crate::testing::Seed;

    fn scene(n: usize, f: impl Fn([f64; 3]) -> f64, c: &[f64]) -> Scene {
        let data: Vec<f32> = (0..n * n * n)
            .map(|i| f([i % n, i / n % n, i / n / n].map(|x| x as f64)) as f32)
            .collect();
        let mut mesh = Mesh::default();
        for (i, c) in c.iter().enumerate() {
            mesh.add(&Lattice::new(&data, [n; 3], 1), *c, i).unwrap();
        }
        Scene::new(mesh, 1.0, [n; 3])
    }

    /// The hierarchy offers every triangle a ray meets: the same hits as testing all of them.
    #[test]
    fn the_hierarchy_loses_no_hit() {
        let mut seed = Seed(5);
        let s = scene(
            12,
            |p| (p[0] * 0.9).sin() + (p[1] * 0.8).cos() + (p[2] * 0.7).sin(),
            &[0.1, 0.7],
        );
        let mut found = 0;
        let mut out = Vec::new();
        for n in 0..3000 {
            let o = seed.point(-3.0, 14.0).to_array();
            // also along lattice lines, which meet edges and vertices
            let d = match n % 5 {
                0 => [0.0, 0.0, 1.0],
                1 => [1.0, -1.0, 0.0],
                2 => [-0.0, -1.0, -0.0],
                _ => seed.point(-1.0, 1.0).to_array(),
            };
            let o = if n % 10 < 3 { o.map(f64::round) } else { o };
            let ray = IndexRay::new(o, d);
            let Some((t0, t1)) = ray.clip([11.0; 3]) else { continue };
            s.all(&ray, [t0, t1], &mut 0, &mut out);
            let local = Local::new(&ray, t0, t1);
            let brute: Vec<f64> = (0..s.len() as u32)
                .filter_map(|i| local.woop.hit(s.corners(i)))
                .map(|t| t0 + t)
                .filter(|t| *t >= 0.0)
                .collect();
            for t in &brute {
                assert!(out.iter().any(|h| (h.t - t).abs() <= 1e-8), "{t} is lost: {out:?}");
            }
            let first = s.first(&ray, [t0, t1], &mut 0);
            assert_eq!(first.map(|h| h.t), brute.iter().copied().min_by(f64::total_cmp));
            assert_eq!(first.map(|h| h.t), out.first().map(|h| h.t));
            found += brute.len();
        }
        assert!(found > 2000, "{found} hits compared");
    }

    /// Rays from inside a closed surface never escape, not even through edges and vertices.
    #[test]
    fn a_closed_mesh_is_watertight() {
        let s = scene(17, |p| -(p.map(|x| (x - 8.0) * (x - 8.0)).iter().sum::<f64>()), &[-30.0]);
        let mut seed = Seed(9);
        let (mut out, mut n) = (Vec::new(), 0);
        for v in &s.vertices {
            let target = v.position(1.0);
            let o = (seed.point(-1.0, 1.0) + 8.0).to_array();
            let ray = IndexRay::new(o, std::array::from_fn(|a| target[a] - o[a]));
            let (t0, t1) = ray.clip([16.0; 3]).unwrap();
            s.all(&ray, [t0, t1], &mut 0, &mut out);
            assert_eq!(out.len(), 1, "towards {target:?}: {out:?}");
            assert!((out[0].t - 1.0).abs() < 1e-6);
            n += 1;
        }
        assert!(n > 500);
    }

    #[test]
    fn nothing_is_hit_where_there_is_nothing() {
        let s = scene(4, |p| p[0], &[9.0]);
        let ray = IndexRay::new([-1.0, 1.0, 1.0], [1.0, 0.1, 0.0]);
        assert_eq!((s.first(&ray, [1.0, 4.0], &mut 0), s.len(), s.bytes()), (None, 0, 0));
    }
}
