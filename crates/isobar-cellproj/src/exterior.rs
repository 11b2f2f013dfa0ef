//! Relations across gaps: per pixel, the cells by which its ray leaves the mesh and enters it again (XMPVO). Only cells on the boundary are projected,
//! and only where the boundary is not that of a convex body. The relations are those of the image's own rays, so they order everything it shows.
//!
//! A ray that starts outside and enters once has no gap. So the faces by which rays enter are first counted per pixel, a row of a block at a time in the bits of a word, with a margin; cells are
//! worked out only where two of them cover a pixel.

use crate::blocks::{Block, CellBins, SIDE};
use crate::camera::Projection;
use crate::cells::{CellOnScreen, Screen};
use crate::mesh::Cells;
use crate::topology::{FACES, NONE, Topology};
use isobar_core::RenderError;
use rayon::prelude::*;

const _: () = assert!(SIDE == 32, "a row of a block in the bits of a word");

/// Pairs (front, behind), each once, ascending.
///
/// # Errors
/// [`RenderError::Memory`], as [`CellBins::new`].
pub(crate) fn pairs(mesh: &Cells, topology: &Topology, screen: &Screen) -> Result<Vec<(u32, u32)>, RenderError> {
    let bins = CellBins::new(mesh, screen, &topology.boundary, |_| true)?;
    let blocks: Vec<Block> = Block::all(&screen.projection).collect();
    let outside = starts_outside(mesh, &screen.projection);
    let mut out: Vec<(u32, u32)> = blocks
        .par_iter()
        .flat_map_iter(|&block| {
            let wanted = if outside {
                entered_twice(mesh, topology, screen, &bins, block)
            } else {
                [u32::MAX; SIDE]
            };
            if wanted == [0; SIDE] {
                return Vec::new();
            }
            in_block(mesh, topology, screen, &bins, block, &wanted)
        })
        .collect();
    out.par_sort_unstable();
    out.dedup();
    Ok(out)
}

/// Whether no ray of the image starts inside the mesh, by its bounds.
fn starts_outside(mesh: &Cells, p: &Projection) -> bool {
    let (lo, hi) = mesh.bounds;
    if p.perspective {
        return !(lo.cmple(p.eye) & p.eye.cmple(hi)).all();
    }
    // Depths are linear: the least is that of a corner.
    let least = |axis: usize| (p.rows[2][axis] * (lo[axis] - p.eye[axis])).min(p.rows[2][axis] * (hi[axis] - p.eye[axis]));
    least(0) + least(1) + least(2) > 0.0
}

/// Calls `row` with the rows of a block, and columns as bits, that a triangle on the screen covers, and a little more.
#[inline(always)]
fn cover(p: [[f64; 2]; 3], corner: [f64; 2], mut row: impl FnMut(usize, u32)) {
    const MARGIN: f64 = 1e-3;
    let area = (p[1][0] - p[0][0]) * (p[2][1] - p[0][1]) - (p[1][1] - p[0][1]) * (p[2][0] - p[0][0]);
    let p = if area < 0.0 { [p[0], p[2], p[1]] } else { p };
    let (mut lows, mut highs) = ([[0.0, f64::NEG_INFINITY]; 3], [[0.0, f64::INFINITY]; 3]);
    for k in 0..3 {
        let (a, b) = (p[k], p[(k + 1) % 3]);
        let slope = (b[0] - a[0]) / (b[1] - a[1]);
        let constant = a[0] - slope * a[1];
        let margin = MARGIN + 1e-9 * slope.abs() + 1e-12 * constant.abs();
        if !margin.is_finite() {
            continue;
        }
        if b[1] > a[1] {
            highs[k] = [slope, constant + margin];
        } else {
            lows[k] = [slope, constant - margin];
        }
    }
    let least = p[0][1].min(p[1][1]).min(p[2][1]) - MARGIN - corner[1];
    let most = p[0][1].max(p[1][1]).max(p[2][1]) + MARGIN - corner[1];
    // Casts saturate.
    let (from, to) = (least.ceil().max(0.0) as usize, most.floor().min(SIDE as f64 - 1.0) as i32);
    for y in from as i32..=to {
        let cy = corner[1] + f64::from(y);
        let [l, h] = [&lows, &highs].map(|s| s.map(|[slope, constant]| slope * cy + constant));
        let (first, last) = (l[0].max(l[1]).max(l[2]) - corner[0], h[0].min(h[1]).min(h[2]) - corner[0]);
        let (first, last) = (first.ceil().max(0.0) as u32, last.floor().min(SIDE as f64 - 1.0) as i32);
        if first as i32 <= last {
            row(y as usize, (u32::MAX << first) & (u32::MAX >> (31 - last)));
        }
    }
}

/// Pixels that two faces cover by which rays enter the mesh, row by row; more where rounding leaves it open.
fn entered_twice(mesh: &Cells, topology: &Topology, screen: &Screen, bins: &CellBins, block: Block) -> [u32; SIDE] {
    let p = &screen.projection;
    let first = p.first_pixel();
    let corner = [first[0] + block.x as f64, first[1] + block.y as f64];
    let (mut once, mut twice) = ([0u32; SIDE], [0u32; SIDE]);
    for entry in bins.lists(block.number).flatten() {
        let points = mesh.cells[entry.cell as usize].map(|i| screen.points[i as usize].at);
        if p.perspective
            && points
                .iter()
                .any(|q| q[2] <= Projection::NEAR * (q[0].abs() + q[1].abs() + q[2].abs()))
        {
            // Across the eye plane, or all but.
            for y in entry.y[0]..=entry.y[1] {
                twice[usize::from(y)] = u32::MAX;
            }
            continue;
        }
        let at = points.map(|[x, y, z]| if p.perspective { [x / z, y / z] } else { [x, y] });
        for (k, face) in FACES.iter().enumerate() {
            if topology.neighbours[entry.cell as usize][k] != NONE {
                continue;
            }
            let [a, b, c] = face.map(|i| at[i]);
            // Faces are counterclockwise from outside, and the screen's y goes down.
            let (u, v) = ([b[0] - a[0], b[1] - a[1]], [c[0] - a[0], c[1] - a[1]]);
            let size = (a[0].abs() + a[1].abs() + 1.0) * (u[0].abs() + u[1].abs() + v[0].abs() + v[1].abs());
            if u[0] * v[1] - u[1] * v[0] > 1e-9 * size {
                continue;
            }
            cover([a, b, c], corner, |y, columns| {
                twice[y] |= once[y] & columns;
                once[y] |= columns;
            });
        }
    }
    twice
}

/// A stay that begins or ends on the boundary: pixel, depth of its middle, cell. Stays of a ray do not overlap, so their middles tell their order whatever rounding does to ends that meet: no
/// tolerance, which from far away would be as long as a cell.
type Crossing = (u16, f64, u32);

/// The pairs of the pixels `wanted`, a bit each.
fn in_block(
    mesh: &Cells,
    topology: &Topology,
    screen: &Screen,
    bins: &CellBins,
    block: Block,
    wanted: &[u32; SIDE],
) -> Vec<(u32, u32)> {
    let perspective = screen.projection.perspective;
    let (mut entries, mut exits): (Vec<Crossing>, Vec<Crossing>) = (Vec::new(), Vec::new());
    let first = screen.projection.first_pixel();
    let reach = [screen.projection.width as f64, screen.projection.height as f64 + SIDE as f64];
    for entry in bins.lists(block.number).flatten() {
        let [y0, y1] = entry.y.map(usize::from);
        let columns = (u32::MAX << entry.x[0]) & (u32::MAX >> (31 - entry.x[1]));
        if wanted[y0..=y1].iter().all(|w| w & columns == 0) {
            continue;
        }
        let (cell, c) = (entry.cell, &mesh.cells[entry.cell as usize]);
        let open = topology.neighbours[cell as usize].map(|n| n == NONE);
        let on_screen = CellOnScreen::new(perspective, &c.map(|i| screen.points[i as usize].at), &[0.0; 4]);
        let spans = on_screen.spans(reach);
        for (y, &columns) in wanted.iter().enumerate().take(y1 + 1).skip(y0) {
            let (py, px) = (first[1] + (block.y + y) as f64, first[0] + block.x as f64);
            let (from, to) = spans.columns(py, px, usize::from(entry.x[0]), usize::from(entry.x[1]));
            for x in (from..to.wrapping_add(1)).filter(|x| columns >> x & 1 != 0) {
                let Some(stay) = on_screen.stay(perspective, px + x as f64, py) else {
                    continue;
                };
                let pixel = (y * SIDE + x) as u16;
                let middle = 0.5 * stay.from + 0.5 * stay.to;
                if stay.entry.is_some_and(|k| open[usize::from(k)]) {
                    entries.push((pixel, middle, cell));
                }
                if open[usize::from(stay.exit)] {
                    exits.push((pixel, middle, cell));
                }
            }
        }
    }
    let sort = |v: &mut Vec<Crossing>| v.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)).then(a.2.cmp(&b.2)));
    sort(&mut entries);
    sort(&mut exits);
    let mut out = Vec::new();
    let mut exits = &exits[..];
    for here in entries.chunk_by(|a, b| a.0 == b.0) {
        let from = exits.partition_point(|e| e.0 < here[0].0);
        exits = &exits[from..];
        let mut left = &exits[..exits.partition_point(|e| e.0 == here[0].0)];
        // Every entry follows the last exit before it.
        for entry in here {
            let before = left.partition_point(|e| e.1 < entry.1);
            if before > 0 {
                out.push((left[before - 1].2, entry.2));
                left = &left[before - 1..];
            }
        }
    }
    out.sort_unstable();
    out.dedup();
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All pixels inside a triangle are covered, and none more than the margin outside.
    #[test]
    fn triangles_cover_their_pixels() {
        let corner = [-40.5, 12.5];
        let mut seed = 3u64;
        let mut next = || {
            seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (seed >> 33) as f64 / (1u64 << 31) as f64 * 60.0 - 15.0
        };
        let mut covered = 0;
        for n in 0..300 {
            let mut p: [[f64; 2]; 3] = std::array::from_fn(|_| [corner[0] + next(), corner[1] + next()]);
            if n % 3 == 0 {
                // Corners on pixels, and an edge along a row.
                p = p.map(|q| q.map(|v| v.floor() + 0.5));
                p[1][1] = p[0][1];
            }
            let mut rows = [0u32; SIDE];
            cover(p, corner, |y, columns| rows[y] = columns);
            for (y, x) in (0..SIDE).flat_map(|y| (0..SIDE).map(move |x| (y, x))) {
                let q = [corner[0] + x as f64, corner[1] + y as f64];
                let side = |a: [f64; 2], b: [f64; 2]| (b[0] - a[0]) * (q[1] - a[1]) - (b[1] - a[1]) * (q[0] - a[0]);
                let sides = [side(p[0], p[1]), side(p[1], p[2]), side(p[2], p[0])];
                let inside = sides.iter().all(|s| *s >= 0.0) || sides.iter().all(|s| *s <= 0.0);
                let area: f64 = sides.iter().sum();
                let found = rows[y] >> x & 1 != 0;
                assert!(found || !inside || area == 0.0, "{p:?} ({x}, {y})");
                let beyond = sides.iter().any(|s| s * area.signum() < -1.0);
                assert!(!found || !beyond || area == 0.0, "{p:?} ({x}, {y})");
                covered += usize::from(found);
            }
        }
        assert!(covered > 10_000, "{covered}");
    }
}
