//! Marching tetrahedra: every element cut into `cells^3` boxes of its parameters, six tetrahedra each, linear between their corners; the triangles of the isosurface in a hierarchy of boxes.

use crate::Scene;
use isobar_core::{DVec3, HexElement};
use isobar_fields::evaluate_hex;
use obvhs::BvhBuildParams;
use obvhs::bvh2::builder::build_bvh2;
use obvhs::ray::Ray as BoxRay;
use obvhs::triangle::Triangle;
use std::time::Duration;

/// The six tetrahedra about the diagonal of a box; corner n is at (n & 1, n >> 1 & 1, n >> 2).
const SIX: [[usize; 4]; 6] = [
    [0, 1, 3, 7],
    [0, 3, 2, 7],
    [0, 2, 6, 7],
    [0, 6, 4, 7],
    [0, 4, 5, 7],
    [0, 5, 1, 7],
];

/// The triangles of one tetrahedron: none, one or two.
fn march(p: [DVec3; 4], v: [f64; 4], take: &mut impl FnMut([DVec3; 3])) {
    let (inside, outside): (Vec<usize>, Vec<usize>) = (0..4).partition(|&i| v[i] > 0.0);
    let cut = |i: usize, j: usize| p[i].lerp(p[j], v[i] / (v[i] - v[j]));
    match (&inside[..], &outside[..]) {
        ([a], [b, c, d]) | ([b, c, d], [a]) => take([cut(*a, *b), cut(*a, *c), cut(*a, *d)]),
        ([a, b], [c, d]) => {
            let q = [cut(*a, *c), cut(*a, *d), cut(*b, *d), cut(*b, *c)];
            take([q[0], q[1], q[2]]);
            take([q[0], q[2], q[3]]);
        }
        _ => {}
    }
}

fn triangles(e: &HexElement, c: f64, cells: usize, out: &mut Vec<[DVec3; 3]>) {
    let n = cells + 1;
    let at = |i: usize| DVec3::new((i % n) as f64, (i / n % n) as f64, (i / n / n) as f64) / cells as f64;
    let nodes: Vec<(DVec3, f64)> = (0..n * n * n)
        .map(|i| {
            let p = evaluate_hex(e, at(i));
            (p.position, p.value - c)
        })
        .collect();
    for cell in 0..cells * cells * cells {
        let (i, j, k) = (cell % cells, cell / cells % cells, cell / cells / cells);
        let corner = |m: usize| nodes[((k + (m >> 2)) * n + j + (m >> 1 & 1)) * n + i + (m & 1)];
        for tet in SIX {
            let q = tet.map(corner);
            march(q.map(|q| q.0), q.map(|q| q.1), &mut |t| out.push(t));
        }
    }
}

/// Distance along the ray to a triangle (Moeller and Trumbore, f64).
fn meet(t: &[DVec3; 3], o: DVec3, d: DVec3) -> Option<f64> {
    let (a, b) = (t[1] - t[0], t[2] - t[0]);
    let p = d.cross(b);
    let det = a.dot(p);
    let s = o - t[0];
    let (u, q) = (s.dot(p) / det, s.cross(a));
    let (v, x) = (d.dot(q) / det, b.dot(q) / det);
    // A little outside: no cracks between triangles.
    (u >= -1e-12 && v >= -1e-12 && u + v <= 1.0 + 1e-12 && x >= 0.0).then_some(x)
}

/// The first hit of every pixel; tetrahedra; triangles.
pub(crate) fn draw_first(scene: &Scene, cells: usize) -> (Vec<Vec<f64>>, usize, usize) {
    let mut list = Vec::new();
    for e in scene.patches.elements.iter() {
        triangles(e, scene.isovalue, cells, &mut list);
    }
    let boxes: Vec<_> = list
        .iter()
        .map(|t| {
            let t = t.map(|p| p.as_vec3a());
            let mut b = Triangle {
                v0: t[0],
                v1: t[1],
                v2: t[2],
            }
            .aabb();
            // Rounded to f32: wider than that.
            b.min -= 1e-5;
            b.max += 1e-5;
            b
        })
        .collect();
    let bvh = build_bvh2(&boxes, BvhBuildParams::medium_build(), &mut Duration::default());
    let view = &scene.view;
    let found = (0..view.pixels())
        .map(|i| {
            let ray = view.ray(i % view.width, i / view.width);
            let mut first = f64::INFINITY;
            let boxed = BoxRay::new_inf(ray.origin.as_vec3a(), ray.direction.as_vec3a());
            bvh.ray_traverse_anyhit(boxed, |_, id| {
                let triangle = &list[bvh.primitive_indices[id] as usize];
                if let Some(t) = meet(triangle, ray.origin, ray.direction) {
                    first = first.min(t);
                }
            });
            if first.is_finite() { vec![first] } else { Vec::new() }
        })
        .collect();
    (found, scene.patches.elements.len() * cells * cells * cells * 6, list.len())
}
