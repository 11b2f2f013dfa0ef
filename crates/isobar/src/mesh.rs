//! An opaque triangle mesh, drawn by ray casting and joined with the surfaces by distance.
//!
//! The hierarchy (crate `obvhs`) works in f32 on the mesh moved and scaled into the unit ball, with boxes widened by 1e-5 so that no
//! triangle is lost to rounding; triangles are intersected in f64. Edges count to both triangles. No guarantee is claimed.

use anyhow::{Result, ensure};
use glam::{DVec3, Vec3A};
use isobar_core::{Channels, ClipPlane, Frame, Hit, Pixel, Ray, Request, View, shade};
use isobar_cpu::Pool;
use isobar_io::TriangleMesh;
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::{Bvh2, builder::build_bvh2};
use obvhs::ray::{Ray as BoxRay, RayHit};
use rayon::prelude::*;
use std::time::Duration;

/// Linear RGB of a mesh: a light grey.
pub const COLOUR: [f32; 3] = [0.62, 0.62, 0.62];
/// How far boxes are widened, in radii of the mesh.
const MARGIN: f64 = 1e-5;

/// A mesh with its hierarchy.
pub struct Mesh {
    mesh: TriangleMesh,
    centre: DVec3,
    radius: f64,
    bvh: Bvh2,
}

impl std::fmt::Debug for Mesh {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Mesh")
            .field("triangles", &self.mesh.triangles.len())
            .field("centre", &self.centre)
            .field("radius", &self.radius)
            .finish_non_exhaustive()
    }
}

impl Mesh {
    /// Builds the hierarchy.
    ///
    /// # Errors
    /// When there are no triangles, an index is out of range, or a point is not finite.
    pub fn new(mesh: TriangleMesh) -> Result<Self> {
        ensure!(!mesh.triangles.is_empty(), "it has no triangles; give a mesh with some");
        ensure!(
            mesh.triangles.iter().flatten().all(|&i| (i as usize) < mesh.points.len()),
            "a triangle names a point that is not there; repair the file"
        );
        ensure!(
            mesh.points.iter().all(|p| p.is_finite()),
            "a point is not finite; repair the file"
        );
        let (lo, hi) = mesh
            .points
            .iter()
            .fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), p| (lo.min(*p), hi.max(*p)));
        let centre = (lo + hi) * 0.5;
        let radius = ((hi - lo).length() * 0.5).max(f64::MIN_POSITIVE);
        ensure!(radius.is_finite(), "its extent overflows; scale it down");
        let unit = |p: DVec3| ((p - centre) / radius).as_vec3a();
        let margin = Vec3A::splat(MARGIN as f32);
        let boxes: Vec<Aabb> = mesh
            .triangles
            .iter()
            .map(|t| {
                let [a, b, c] = t.map(|i| unit(mesh.points[i as usize]));
                Aabb::new(a.min(b).min(c) - margin, a.max(b).max(c) + margin)
            })
            .collect();
        let bvh = build_bvh2(&boxes, BvhBuildParams::medium_build(), &mut Duration::default());
        Ok(Self {
            mesh,
            centre,
            radius,
            bvh,
        })
    }

    /// Nearest hit at t >= 0 that no clipping plane takes away: t and the unit normal of the triangle.
    #[must_use]
    pub fn first(&self, ray: &Ray, clips: &[ClipPlane]) -> Option<(f64, DVec3)> {
        let length = ray.direction.length();
        let direction = ray.direction / length;
        // Start near the mesh, so that f32 has digits left for it.
        let skip = ((self.centre - ray.origin).dot(direction) - self.radius * 1.01).max(0.0);
        let start = (ray.origin + direction * skip - self.centre) / self.radius;
        if start.length() > 1e6 {
            return None;
        }
        let boxes = BoxRay::new_inf(start.as_vec3a(), direction.as_vec3a());
        let mut best: Option<(f64, DVec3)> = None;
        self.bvh.ray_traverse(boxes, &mut RayHit::none(), |_, id| {
            let triangle = self.mesh.triangles[self.bvh.primitive_indices[id] as usize];
            let Some((t, normal)) = self.intersect(ray, triangle) else {
                return f32::INFINITY;
            };
            if clips.iter().any(|c| c.normal.dot(ray.at(t)) > c.distance) || best.is_some_and(|(b, _)| b <= t) {
                return f32::INFINITY;
            }
            best = Some((t, normal));
            // In the hierarchy's units, a little farther: boxes that begin there are still looked at.
            (((t * length - skip) / self.radius) + 10.0 * MARGIN) as f32
        });
        best
    }

    /// Moeller and Trumbore 1997, f64, both sides, borders included.
    fn intersect(&self, ray: &Ray, triangle: [u32; 3]) -> Option<(f64, DVec3)> {
        let [a, b, c] = triangle.map(|i| self.mesh.points[i as usize]);
        let (ab, ac) = (b - a, c - a);
        let p = ray.direction.cross(ac);
        let determinant = ab.dot(p);
        if determinant == 0.0 {
            return None;
        }
        let s = ray.origin - a;
        let u = s.dot(p) / determinant;
        let q = s.cross(ab);
        let v = ray.direction.dot(q) / determinant;
        let t = ac.dot(q) / determinant;
        let slack = 1e-12;
        (u >= -slack && v >= -slack && u + v <= 1.0 + slack && t >= 0.0 && t.is_finite())
            .then(|| (t, ab.cross(ac).normalize_or_zero()))
    }

    /// The mesh alone as a frame of this view; `surface` is the index its pixels get. Nothing is claimed.
    ///
    /// # Errors
    /// When the threads cannot be started.
    pub fn draw(&self, view: &View, request: &Request, surface: u8) -> Result<Frame, isobar_core::RenderError> {
        let pool = Pool::new(request.threads)?;
        let generator = view.generator();
        let pixels: Vec<Option<(f64, DVec3)>> = pool.install(|| {
            (0..view.pixels())
                .into_par_iter()
                .with_min_len(256)
                .map(|i| self.first(&generator.ray(i % view.width, i / view.width), &view.clips))
                .collect()
        });
        let mut frame = Frame::new(view.width, view.height, request.layers, request.channels);
        for (i, (t, n)) in pixels.iter().enumerate().filter_map(|(i, p)| p.map(|p| (i, p))) {
            let ray = generator.ray(i % view.width, i / view.width);
            let normal = n.as_vec3().to_array();
            let hit = Hit {
                t,
                point: ray.at(t),
                normal,
                surface,
                t_error: Hit::NONE.t_error,
            };
            frame.set_hit(0, i, &hit);
            let [r, g, b] = shade(COLOUR, normal, ray.direction);
            frame.set_pixel(
                i,
                &Pixel {
                    hits: 1,
                    rgba: [r, g, b, 1.0],
                    ..Pixel::default()
                },
            );
        }
        Ok(frame)
    }
}

/// Whether a frame can be joined by t: what the mesh needs of the request.
pub const CHANNELS: Channels = Channels::T;

#[cfg(test)]
mod tests {
    use super::*;

    /// An octahedron of radius 2 around (100, 0, 0).
    fn octahedron() -> Mesh {
        let c = DVec3::new(100.0, 0.0, 0.0);
        let points = [DVec3::X, DVec3::NEG_X, DVec3::Y, DVec3::NEG_Y, DVec3::Z, DVec3::NEG_Z].map(|v| c + 2.0 * v);
        let mut triangles = vec![];
        for x in [0, 1] {
            for y in [2, 3] {
                for z in [4, 5] {
                    triangles.push([x, y, z]);
                }
            }
        }
        Mesh::new(TriangleMesh {
            points: points.to_vec(),
            triangles,
        })
        .unwrap()
    }

    #[test]
    fn rays_hit_the_near_face_exactly() {
        let m = octahedron();
        // |x - 100| + |y| + |z| = 2
        for (y, z) in [(0.3, 0.4), (-1.0, 0.5), (0.0, 0.0), (1.9, 0.05)] {
            let ray = Ray {
                origin: DVec3::new(0.0, y, z),
                direction: DVec3::X * 0.5,
            };
            let (t, n) = m.first(&ray, &[]).unwrap();
            assert!((t * 0.5 - (98.0 + f64::abs(y) + f64::abs(z))).abs() < 1e-12, "{y} {z}: {t}");
            assert!((n.x.abs() - 1.0 / 3f64.sqrt()).abs() < 1e-12);
        }
        let miss = Ray {
            origin: DVec3::new(0.0, 1.2, 1.0),
            direction: DVec3::X,
        };
        assert_eq!(m.first(&miss, &[]), None);
        let behind = Ray {
            origin: DVec3::new(200.0, 0.0, 0.0),
            direction: DVec3::X,
        };
        assert_eq!(m.first(&behind, &[]), None);
        let far = Ray {
            origin: DVec3::new(-1e9, 0.1, 0.0),
            direction: DVec3::X,
        };
        assert!((m.first(&far, &[]).unwrap().0 - (1e9 + 98.1)).abs() < 1e-5);
    }

    #[test]
    fn clipping_shows_the_far_side() {
        let ray = Ray {
            origin: DVec3::ZERO,
            direction: DVec3::X,
        };
        let keep_far = ClipPlane {
            normal: DVec3::NEG_X,
            distance: -100.0,
            cap: false,
        };
        assert_eq!(octahedron().first(&ray, &[keep_far]).unwrap().0, 102.0);
    }

    #[test]
    fn a_frame_of_the_mesh_covers_its_silhouette() {
        let view = View::perspective(
            DVec3::new(90.0, 0.0, 0.0),
            DVec3::new(100.0, 0.0, 0.0),
            DVec3::Z,
            40.0,
            32,
            32,
        );
        let request = Request::default();
        let f = octahedron().draw(&view, &request, 3).unwrap();
        let hit = f.t.iter().filter(|t| t.is_finite()).count();
        assert!(hit > 40 && hit < 32 * 32 / 2, "{hit}");
        assert!(f.surface.iter().all(|&s| s == 3 || s == isobar_core::NO_SURFACE));
        assert_eq!(f.t[16 * 32 + 16].floor(), 8.0);
    }

    #[test]
    fn broken_meshes_are_refused() {
        let mesh = |points: Vec<DVec3>, triangles| Mesh::new(TriangleMesh { points, triangles }).is_err();
        assert!(mesh(vec![], vec![]));
        assert!(mesh(vec![DVec3::ZERO; 3], vec![[0, 1, 3]]));
        assert!(mesh(vec![DVec3::NAN; 3], vec![[0, 1, 2]]));
    }
}
