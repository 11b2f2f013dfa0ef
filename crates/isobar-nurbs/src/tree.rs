//! Boxes in a hierarchy (crate `obvhs`), and which of them a tile may see.
//!
//! The hierarchy works in f32 on the scene moved and scaled into the unit ball; boxes are widened by 1e-5, far more than rounding moves them.

use crate::frustum::Frustum;
use glam::{DVec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::aabb::Aabb;
use obvhs::bvh2::{Bvh2, builder::build_bvh2};
use std::time::Duration;

/// How far boxes are widened, in radii of the scene.
const MARGIN: f64 = 1e-5;

/// A hierarchy of boxes, numbered as they were given.
pub(crate) struct Tree {
    centre: DVec3,
    radius: f64,
    bvh: Bvh2,
}

impl std::fmt::Debug for Tree {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Tree")
            .field("nodes", &self.bvh.nodes.len())
            .finish_non_exhaustive()
    }
}

impl Tree {
    /// Of boxes between two corners each.
    pub(crate) fn new(boxes: &[(DVec3, DVec3)]) -> Self {
        let (lo, hi) = boxes.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(a, b), (lo, hi)| {
            (a.min(*lo), b.max(*hi))
        });
        let (centre, radius) = if boxes.is_empty() {
            (DVec3::ZERO, 1.0)
        } else {
            // Halved first: the sum may overflow.
            (lo * 0.5 + hi * 0.5, (hi * 0.5 - lo * 0.5).length().max(f64::MIN_POSITIVE))
        };
        let unit = |p: DVec3| ((p - centre) / radius).as_vec3a();
        let margin = Vec3A::splat(MARGIN as f32);
        let boxes: Vec<Aabb> = boxes
            .iter()
            .map(|(lo, hi)| Aabb::new(unit(*lo) - margin, unit(*hi) + margin))
            .collect();
        let bvh = build_bvh2(&boxes, BvhBuildParams::medium_build(), &mut Duration::default());
        Self { centre, radius, bvh }
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&self.bvh.nodes[..]) + self.bvh.primitive_indices.len() * 4
    }

    /// Calls `visit` for every box the rays of the frustum may meet.
    #[inline(always)]
    pub(crate) fn visit(&self, f: &Frustum, stack: &mut Vec<u32>, mut visit: impl FnMut(usize)) {
        if self.bvh.primitive_indices.is_empty() {
            return;
        }
        let away = (f.eye - self.centre).length() / self.radius;
        let planes = f.planes().map(|(n, d)| {
            let size = n.length();
            let n = n / size;
            (n, (d / size - n.dot(self.centre)) / self.radius - 1e-12 * (away + 1.0))
        });
        stack.clear();
        stack.push(0);
        while let Some(i) = stack.pop() {
            let node = &self.bvh.nodes[i as usize];
            let (lo, hi) = (node.aabb.min.as_dvec3(), node.aabb.max.as_dvec3());
            let outside = planes.iter().any(|&(n, d)| (n * lo).max(n * hi).element_sum() < d);
            if outside {
                continue;
            }
            if node.prim_count == 0 {
                stack.push(node.first_index + 1);
                stack.push(node.first_index);
                continue;
            }
            for p in node.first_index..node.first_index + node.prim_count {
                visit(self.bvh.primitive_indices[p as usize] as usize);
            }
        }
    }
}
