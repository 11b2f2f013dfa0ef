//! Boxes in a hierarchy (crate `obvhs`), and which of them a tile may see.
//!
//! The hierarchy works in f32 on the scene moved and scaled into the unit ball; boxes are widened by 1e-5, far more than rounding moves them. Boxes far smaller than that are told apart by a test
//! in f64 of each box of a leaf.
//!
//! **Room.** A plane `n . x >= d` of a frustum may only discard a box that no point of a ray is in. Both tests compare the greatest `n . x` over a box with d, and both err by
//!
//! 1. the planes' own rounding: n is off by some EPS of itself, `n . x` by that times x, and d by that times the eye: at most `16 EPS (|n| . (|x| + |eye|) + |d|)`;
//! 2. the boxes: their corners are off by `noise` in each coordinate, so `n . x` is by `noise |n|_1`.
//!
//! In the unit ball x is `centre + radius y`, |y| <= 2, and d becomes `(d - n . centre) / radius`: the same errors are divided by the radius, |x| is at most `|centre| + 2 radius`, and the product
//! `n . centre` is rounded once more. Where the scene is far from the origin for its size (a radius of 3 at 10^15) they are greater than the boxes' own widening. f32 rounds y by 2^-24 of 2
//! at most, a hundredth of that widening.

use crate::frustum::{EPS, Frustum};
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
    boxes: Vec<(DVec3, DVec3)>,
    /// Error of the boxes' corners.
    noise: f64,
}

impl std::fmt::Debug for Tree {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Tree")
            .field("nodes", &self.bvh.nodes.len())
            .finish_non_exhaustive()
    }
}

impl Tree {
    /// Of boxes between two corners each, which are wrong by `noise` at most.
    pub(crate) fn new(boxes: Vec<(DVec3, DVec3)>, noise: f64) -> Self {
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
        let widened: Vec<Aabb> = boxes
            .iter()
            .map(|(lo, hi)| Aabb::new(unit(*lo) - margin, unit(*hi) + margin))
            .collect();
        let bvh = build_bvh2(&widened, BvhBuildParams::medium_build(), &mut Duration::default());
        Self {
            centre,
            radius,
            bvh,
            boxes,
            noise,
        }
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        size_of_val(&self.bvh.nodes[..]) + self.bvh.primitive_indices.len() * 4 + size_of_val(&self.boxes[..])
    }

    /// The boxes the rays of the frustum may meet, with their least depths, by these where `sorted`.
    #[inline(always)]
    pub(crate) fn list(&self, f: &Frustum, stack: &mut Vec<u32>, sorted: bool) -> Vec<(f64, u32)> {
        let mut out = Vec::new();
        self.visit(f, stack, |i| out.push((self.depth(f, i), i as u32)));
        if sorted {
            out.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        }
        out
    }

    /// At most the depth of all points of a box.
    #[inline(always)]
    fn depth(&self, f: &Frustum, i: usize) -> f64 {
        let (lo, hi) = self.boxes[i];
        let size = f.forward.abs().dot(lo.abs().max(hi.abs()) + f.eye.abs());
        let least = (f.forward * lo).min(f.forward * hi).element_sum() - f.forward.dot(f.eye);
        least - 16.0 * EPS * size - self.noise * f.forward.abs().element_sum()
    }

    /// Calls `visit` for every box the rays of the frustum may meet.
    #[inline(always)]
    pub(crate) fn visit(&self, f: &Frustum, stack: &mut Vec<u32>, mut visit: impl FnMut(usize)) {
        if self.bvh.primitive_indices.is_empty() {
            return;
        }
        let away = (f.eye - self.centre).length() / self.radius;
        // What does not depend on the box; see Room above.
        let room = |n: DVec3, d: f64| 16.0 * EPS * (n.abs().dot(f.eye.abs()) + d.abs()) + self.noise * n.abs().element_sum();
        let exact = f.planes().map(|(n, d)| (n, d - room(n, d)));
        let planes = f.planes().map(|(n, d)| {
            let size = n.length();
            let (n, d) = (n / size, d / size);
            let moved = room(n, d) + 16.0 * EPS * n.abs().dot(self.centre.abs());
            (n, (d - n.dot(self.centre) - moved) / self.radius - 1e-12 * (away + 1.0))
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
                let own = self.bvh.primitive_indices[p as usize] as usize;
                let (lo, hi) = self.boxes[own];
                let size = lo.abs().max(hi.abs());
                let outside = |&(n, d): &(DVec3, f64)| (n * lo).max(n * hi).element_sum() < d - 16.0 * EPS * n.abs().dot(size);
                if !exact.iter().any(outside) {
                    visit(own);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use isobar_core::View;
    use isobar_cpu::Tile;

    /// Boxes of a ten thousand millionth of the scene, side by side: a tile sees its own, and at least those.
    #[test]
    fn boxes_far_below_the_margin_are_told_apart() {
        let size = 1e-10;
        let mut boxes: Vec<_> = (0..100)
            .map(|i| {
                let lo = DVec3::new(f64::from(i % 10) * size, 0.0, f64::from(i / 10) * size);
                (lo, lo + size)
            })
            .collect();
        boxes.push((DVec3::splat(-1.0), DVec3::splat(-0.9)));
        let tree = Tree::new(boxes.clone(), 0.0);
        let middle = DVec3::new(5.0, 0.0, 5.0) * size;
        let view = View::perspective(middle - DVec3::Y * 40.0 * size, middle, DVec3::Z, 20.0, 64, 64);
        let tile = Tile {
            x: 32,
            y: 32,
            width: 4,
            height: 4,
        };
        let (f, _) = Frustum::of_tile(&view, tile).remove(0);
        let mut seen = Vec::new();
        tree.visit(&f, &mut Vec::new(), |i| seen.push(i));
        assert!((1..=12).contains(&seen.len()), "{seen:?}");
        let point = f.rays[5].ray.at(41.0 * size);
        let own = boxes
            .iter()
            .position(|(a, b)| point.cmpge(*a).all() && point.cmple(*b).all())
            .unwrap();
        assert!(seen.contains(&own), "{own} {seen:?}");
    }
}
