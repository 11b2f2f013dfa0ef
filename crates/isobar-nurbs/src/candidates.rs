//! Which elements a tile may see: those whose attribute reaches the value sought, in a hierarchy of boxes, by the planes of the tile.

use crate::affine::exact_box;
use crate::frustum::Frustum;
use crate::solve::{Target, Task};
use crate::tree::Tree;
use glam::DVec3;
use isobar_core::{HexElement, HexPatches, Surface, SurfaceKind};
use isobar_cpu::is_visible;
use std::collections::HashMap;
use std::collections::hash_map::DefaultHasher;
use std::hash::{Hash, Hasher};

/// The tasks of a scene and their hierarchy.
#[derive(Debug)]
pub(crate) struct Candidates {
    pub(crate) tasks: Vec<Task>,
    tree: Tree,
}

/// The box about an element's control points.
fn bounds(e: &HexElement) -> (DVec3, DVec3) {
    e.points.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), p| {
        let p = DVec3::new(p[0], p[1], p[2]);
        (lo.min(p), hi.max(p))
    })
}

impl Candidates {
    /// The elements that reach each visible surface. Of several surfaces with the same isovalue the first is drawn.
    pub(crate) fn new(patches: &HexPatches, surfaces: &[Surface]) -> Self {
        let mut tasks = Vec::new();
        for (n, s) in surfaces.iter().enumerate() {
            let again = surfaces[..n].iter().any(|o| is_visible(o) && o.kind == s.kind);
            if !is_visible(s) || again {
                continue;
            }
            let surface = n as u8;
            let task = |element: usize, target| Task {
                element: element as u32,
                surface,
                target,
                boxed: exact_box(&patches.elements[element]).is_some(),
            };
            match s.kind {
                SurfaceKind::Isovalue(c) => tasks.extend(patches.elements.iter().enumerate().filter_map(|(i, e)| {
                    let (lo, hi) = e.value_range();
                    (lo <= c && c <= hi).then(|| task(i, Target::Isovalue(c)))
                })),
                SurfaceKind::Parameter { axis, value } => {
                    tasks.extend((0..patches.elements.len()).map(|i| task(i, Target::Parameter(axis, value))));
                }
                _ => tasks.extend(
                    boundary(patches)
                        .into_iter()
                        .map(|(i, axis, side)| task(i, Target::Parameter(axis, f64::from(side)))),
                ),
            }
        }
        let boxes: Vec<_> = tasks.iter().map(|t| bounds(&patches.elements[t.element as usize])).collect();
        Self {
            tree: Tree::new(boxes, 0.0),
            tasks,
        }
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        self.tasks.len() * size_of::<Task>() + self.tree.bytes()
    }

    /// The tasks whose boxes the rays of the frustum may meet, with the least depths of these, by them where `sorted`.
    #[inline(always)]
    pub(crate) fn list(&self, f: &Frustum, stack: &mut Vec<u32>, sorted: bool) -> Vec<(f64, u32)> {
        self.tree.list(f, stack, sorted)
    }

    /// Calls `visit` for every task whose box the rays of the frustum may meet.
    #[inline(always)]
    pub(crate) fn visit(&self, f: &Frustum, stack: &mut Vec<u32>, mut visit: impl FnMut(&Task)) {
        self.tree.visit(f, stack, |i| visit(&self.tasks[i]));
    }
}

/// Element, axis, side.
type Face = (usize, u8, u8);

/// Faces that no other face has the control points and weights of, bit for bit in any order. Faces that are collapsed to a line or a
/// point are left out: they show nothing.
pub(crate) fn boundary(patches: &HexPatches) -> Vec<Face> {
    let mut seen: HashMap<(u64, u64), (u32, Face)> = HashMap::new();
    for (i, e) in patches.elements.iter().enumerate() {
        let n = e.degree.map(|d| usize::from(d) + 1);
        for axis in 0..3u8 {
            for side in 0..2u8 {
                let (a, b) = ((usize::from(axis) + 1) % 3, (usize::from(axis) + 2) % 3);
                let fixed = if side == 0 { 0 } else { n[usize::from(axis)] - 1 };
                let at = |p: usize, q: usize| {
                    let mut c = [0; 3];
                    (c[usize::from(axis)], c[a], c[b]) = (fixed, p, q);
                    // + 0 makes -0 and 0 one
                    e.points[(c[2] * n[1] + c[1]) * n[0] + c[0]].map(|x| (x + 0.0).to_bits())
                };
                let flat = (1..n[a]).all(|p| (0..n[b]).all(|q| at(p, q) == at(0, q)))
                    || (1..n[b]).all(|q| (0..n[a]).all(|p| at(p, q) == at(p, 0)));
                if flat {
                    continue;
                }
                let mut net: Vec<[u64; 4]> = (0..n[a])
                    .flat_map(|p| (0..n[b]).map(move |q| (p, q)))
                    .map(|(p, q)| at(p, q))
                    .collect();
                net.sort_unstable();
                let half = |salt: u8| {
                    let mut h = DefaultHasher::new();
                    (salt, &net).hash(&mut h);
                    h.finish()
                };
                seen.entry((half(0), half(1))).or_insert((0, (i, axis, side))).0 += 1;
            }
        }
    }
    let mut out: Vec<_> = seen.into_values().filter(|(n, _)| *n == 1).map(|(_, f)| f).collect();
    out.sort_unstable();
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use isobar_core::{Grid, Samples};
    use isobar_fields::grid_to_hexes;

    #[test]
    fn the_boundary_of_a_grid_is_its_outside() {
        let grid = Grid::unit([4, 3, 3], Samples::U8((0..36).collect())).unwrap();
        let h = grid_to_hexes(&grid).unwrap();
        assert_eq!(boundary(&h).len(), 2 * (3 * 2 + 3 * 2 + 2 * 2));
        let c = Candidates::new(
            &h,
            &[
                Surface::isovalue(17.5, 0),
                Surface::isovalue(17.5, 1),
                Surface::isovalue(99.0, 2),
            ],
        );
        assert!(!c.tasks.is_empty() && c.tasks.len() < 12 && c.tasks.iter().all(|t| t.surface == 0));
        assert!(c.bytes() > 0);
    }
}
