//! What the paper's form does for one pixel on one element, for figures: the list L level by level, and the roots before they are filtered.

use crate::bernstein::Point;
use crate::candidates::Candidates;
use crate::frustum::Frustum;
use crate::paper::{Kept, Manner, Paper, Seen};
use crate::paper_cpu::epsilon;
use crate::paper_forms::Forms;
use crate::paper_parts::{Cutting, Parts};
use crate::paper_volume::{Bounds, axes, extent, holds_origin};
use crate::tile::Index;
use isobar_core::{DVec3, DataError, HexElement, HexPatches, Surface, View};
use isobar_cpu::Tile;

/// A part of the list L.
#[derive(Debug, Clone, PartialEq)]
pub struct TracedPart {
    /// Its box of parameters: the lower corner, and the edge.
    pub lo: [f64; 3],
    /// Edge, in parameters of the element.
    pub size: f64,
    /// Coefficients per axis.
    pub counts: [usize; 3],
    /// Coefficients of (alpha, beta, gamma), the first axis fastest.
    pub net: Vec<[f64; 3]>,
    /// Corners of its bounding volume, bit a of the index the side along the volume's axis a.
    pub volume: [[f64; 3]; 8],
}

/// One pixel of a view.
struct One {
    frustum: Frustum,
    manner: Manner,
}

impl One {
    fn new(view: &View, [x, y]: [usize; 2], bounds: &str) -> Option<Self> {
        let tile = Tile {
            x,
            y,
            width: 1,
            height: 1,
        };
        let inside = view.validate().is_ok() && x < view.width && y < view.height;
        let (frustum, _) = inside.then(|| Frustum::of_tile(view, tile)).and_then(|mut f| f.pop())?;
        let manner = Manner {
            bounds: match bounds {
                "aabb" => Bounds::Aabb,
                "pca" => Bounds::Pca,
                _ => Bounds::Obb,
            },
            cutting: Cutting::Bezier,
            region: None,
            epsilon: epsilon(view),
        };
        Some(Self { frustum, manner })
    }
}

/// The lists L of levels 0 to `levels` for one pixel, as printed but for Newton's method: parts go on until their volume (`bounds`: obb, aabb or pca) no longer holds the origin. Lists of more than
/// 10,000 parts end the trace; empty where the pixel is not in the view.
#[must_use]
pub fn trace(
    element: &HexElement,
    isovalue: f64,
    view: &View,
    pixel: [usize; 2],
    bounds: &str,
    levels: usize,
) -> Vec<Vec<TracedPart>> {
    let Some(one) = One::new(view, pixel, bounds) else {
        return Vec::new();
    };
    let forms = Forms::new(&one.frustum, element, isovalue, false);
    let mut parts = Parts::new(&forms, Cutting::Bezier);
    let slope = one.frustum.rays[0].slope;
    let mut list = vec![0];
    let mut out = Vec::new();
    for _ in 0..=levels.min(20) {
        out.push(list.iter().map(|&i| traced(&parts, i, slope, one.manner.bounds)).collect());
        let mut next = Vec::new();
        for i in list {
            let first = parts.octants(i);
            next.extend((first..first + 8).filter(|&i| {
                let seen = Seen::new(parts.get(i), slope);
                holds_origin(one.manner.bounds, &seen.p, seen.jacobian)
            }));
        }
        list = next;
        if list.is_empty() || list.len() > 10_000 {
            break;
        }
    }
    out
}

fn traced(parts: &Parts<'_>, i: usize, slope: [f64; 2], bounds: Bounds) -> TracedPart {
    let part = parts.get(i);
    let seen = Seen::new(part, slope);
    let axes = axes(bounds, &seen.p, seen.jacobian).unwrap_or(DVec3::AXES);
    let ends = axes.map(|v| extent(v, &seen.p));
    let corner = |n: usize| {
        let side = |a: usize| if n >> a & 1 == 0 { ends[a].0 } else { ends[a].1 };
        (axes[0] * side(0) + axes[1] * side(1) + axes[2] * side(2)).to_array()
    };
    TracedPart {
        lo: part.lo,
        size: part.size(),
        counts: part.p.d.map(|d| d + 1),
        net: seen.p.iter().map(|p: &Point| [p[0], p[1], p[2]]).collect(),
        volume: std::array::from_fn(corner),
    }
}

/// The roots of one pixel as t and the sign of f'(t) (1 where the attribute grows along the ray), sorted: all that Newton's method gave, and what the filter of section 4.2 leaves of them.
///
/// # Errors
/// As [`HexPatches::new`]; [`DataError::Unknown`] where the pixel is not in the view.
#[expect(clippy::type_complexity, reason = "two lists of the same pairs")]
pub fn roots(
    elements: &[HexElement],
    isovalue: f64,
    view: &View,
    pixel: [usize; 2],
    bounds: &str,
) -> Result<(Vec<(f64, f64)>, Vec<(f64, f64)>), DataError> {
    let patches = HexPatches::new(elements.to_vec())?;
    let one = One::new(view, pixel, bounds).ok_or_else(|| DataError::Unknown("the pixel is not in the view".into()))?;
    let candidates = Candidates::new(&patches, &[Surface::isovalue(isovalue, 0)]);
    let index = Index::Elements(patches, Box::new(candidates));
    let mut paper = Paper::default();
    let f = &one.frustum;
    paper.draw(f, &f.widened(), &index, &one.manner, &Kept::default());
    let direction = f.rays[0].ray.direction;
    let pairs = |list: &[crate::solve::Found]| list.iter().map(|f| (f.t, f.normal.dot(direction).signum())).collect();
    let mut own = paper.found;
    own.sort_by(|a, b| a.t.total_cmp(&b.t));
    let all = pairs(&own);
    Paper::filter(&mut own, direction, one.manner.epsilon[1]);
    Ok((all, pairs(&own)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::annulus;

    #[test]
    fn lists_shrink_to_the_roots() {
        let view = View::perspective(DVec3::new(4.0, 3.0, 3.5), DVec3::new(0.8, 0.8, 0.5), DVec3::Z, 40.0, 40, 40);
        let e = annulus();
        let (all, kept) = roots(std::slice::from_ref(&e), 0.5, &view, [20, 20], "obb").unwrap();
        assert!(!kept.is_empty() && kept.len() <= all.len());
        let lists = trace(&e, 0.5, &view, [20, 20], "obb", 6);
        let wide = trace(&e, 0.5, &view, [20, 20], "aabb", 6);
        assert_eq!((lists.len(), lists[0].len(), lists[0][0].size), (7, 1, 1.0));
        assert!((kept.len()..=8 * kept.len()).contains(&lists[6].len()) && wide[6].len() >= lists[6].len());
        // The volume holds the net.
        for part in lists.iter().flatten() {
            let span = |list: &[[f64; 3]]| {
                list.iter()
                    .map(|p| p[2])
                    .fold((f64::MAX, f64::MIN), |(a, b), x| (a.min(x), b.max(x)))
            };
            let (net, volume) = (span(&part.net), span(&part.volume));
            assert!(volume.0 <= net.0 + 1e-12 && net.1 <= volume.1 + 1e-12);
        }
        assert!(trace(&e, 0.5, &view, [40, 0], "obb", 2).is_empty() && roots(&[e], 0.5, &view, [0, 40], "obb").is_err());
    }
}
