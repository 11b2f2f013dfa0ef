//! A rasteriser with the rules of graphics hardware: positions on a lattice of 1/256 pixel, a pixel belongs to the triangle its centre lies in, and
//! one on a common edge to exactly one of the two triangles (the top-left rule). Edge functions are integers below 2^53, so f64 holds them exactly.

use super::fan::SUB;
use crate::blocks::{Block, SIDE};

/// Pixels side by side.
const LANES: usize = 8;

/// Calls `fragment` with each pixel of the block that the triangle covers and with the weights of its corners there. Triangles without area cover nothing.
#[inline(always)]
pub(crate) fn fill(block: Block, corners: [[i32; 2]; 3], mut fragment: impl FnMut(usize, [f64; 3])) {
    let p = corners.map(|c| c.map(f64::from));
    let edge = |a: [f64; 2], b: [f64; 2]| {
        let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
        [-dy, dx, dy * a[0] - dx * a[1]]
    };
    let mut edges = [edge(p[1], p[2]), edge(p[2], p[0]), edge(p[0], p[1])];
    let area = edges[0][0] * p[0][0] + edges[0][1] * p[0][1] + edges[0][2];
    if area == 0.0 {
        return;
    }
    if area < 0.0 {
        edges = edges.map(|e| e.map(|v| -v));
    }
    // Of the two directions in which neighbours go along an edge one takes it in.
    let bias = edges.map(|[a, b, _]| if a < 0.0 || (a == 0.0 && b > 0.0) { 0.0 } else { -1.0 });
    let one = 1.0 / area.abs();
    let range = |axis: usize, from: usize| {
        let (lo, hi) = (
            p[0][axis].min(p[1][axis]).min(p[2][axis]),
            p[0][axis].max(p[1][axis]).max(p[2][axis]),
        );
        let (lo, hi) = ((lo / SUB).ceil() - from as f64, (hi / SUB).floor() - from as f64);
        let most = SIDE as f64 - 1.0;
        (lo <= most && hi >= 0.0 && lo <= hi).then(|| (lo.max(0.0) as usize, hi.min(most) as usize))
    };
    let (Some((x0, x1)), Some((y0, y1))) = (range(0, block.x), range(1, block.y)) else {
        return;
    };
    for y in y0..=y1 {
        let cy = (block.y + y) as f64 * SUB;
        let row: [f64; 3] = std::array::from_fn(|k| edges[k][1] * cy + edges[k][2]);
        for x in (x0..=x1).step_by(LANES) {
            let cx: [f64; LANES] = std::array::from_fn(|i| (block.x + x + i) as f64 * SUB);
            let mut values = [[0.0; LANES]; 3];
            let mut inside = [true; LANES];
            for k in 0..3 {
                for i in 0..LANES {
                    values[k][i] = edges[k][0] * cx[i] + row[k];
                    inside[i] &= values[k][i] + bias[k] >= 0.0;
                }
            }
            for i in 0..LANES.min(x1 - x + 1) {
                if inside[i] {
                    fragment(y * SIDE + x + i, std::array::from_fn(|k| values[k][i] * one));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Triangles that share edges cover each pixel of their union once, wherever corners lie; weights add up to the place.
    #[test]
    fn neighbours_share_no_pixel_and_lose_none() {
        let block = Block { x: 32, y: 64, number: 0 };
        let centre = [48 * 256, 80 * 256];
        for shift in 0..40 {
            // A fan of eight triangles around a point that may lie on a pixel's centre, corners on the lattice of pixels.
            let middle = [centre[0] + shift * 64, centre[1] + shift * 32];
            let ring = [[0, 0], [10, 0], [20, 0], [20, 9], [20, 20], [9, 20], [0, 20], [0, 7]]
                .map(|[x, y]| [(38 + x) * 256 + shift % 3, (70 + y) * 256 - shift % 5]);
            let mut count = vec![0; SIDE * SIDE];
            for i in 0..8 {
                let corners = [middle, ring[i], ring[(i + 1) % 8]];
                // Either orientation.
                let corners = if shift % 2 == 0 {
                    corners
                } else {
                    [corners[1], corners[0], corners[2]]
                };
                fill(block, corners, |pixel, w| {
                    count[pixel] += 1;
                    let (x, y) = (block.x + pixel % SIDE, block.y + pixel / SIDE);
                    for (axis, at) in [x, y].into_iter().enumerate() {
                        let here: f64 = (0..3).map(|k| w[k] * f64::from(corners[k][axis])).sum();
                        assert!((here - at as f64 * 256.0).abs() < 1e-6);
                    }
                });
            }
            assert!(count.iter().all(|c| *c <= 1));
            let n = count.iter().sum::<i32>();
            assert!((400..=441).contains(&n), "{n}");
            // The square's own pixels, counted by its two triangles.
            let mut square = 0;
            for c in [[ring[0], ring[2], ring[4]], [ring[0], ring[4], ring[6]]] {
                fill(block, c, |_, _| square += 1);
            }
            assert_eq!(n, square);
        }
        fill(block, [[0, 0], [10_000, 20_000], [5_000, 10_000]], |_, _| panic!("no area"));
    }
}
