//! Relations across gaps: per pixel, the cells by which its ray leaves the mesh and enters it again (XMPVO). Only cells on the boundary are projected,
//! and only where the boundary is not that of a convex body. The relations are those of the image's own rays, so they order everything it shows.

use crate::blocks::{Block, CellBins, SIDE};
use crate::cells::{CellOnScreen, Screen};
use crate::mesh::Cells;
use crate::topology::{NONE, Topology};
use rayon::prelude::*;

/// Pairs (front, behind), each once, ascending.
pub(crate) fn pairs(mesh: &Cells, topology: &Topology, screen: &Screen) -> Vec<(u32, u32)> {
    let bins = CellBins::new(mesh, screen, &topology.boundary, |_| true);
    let blocks: Vec<Block> = Block::all(&screen.projection).collect();
    let mut out: Vec<(u32, u32)> = blocks
        .par_iter()
        .flat_map_iter(|&block| in_block(mesh, topology, screen, &bins, block))
        .collect();
    out.par_sort_unstable();
    out.dedup();
    out
}

/// A place where a ray crosses the boundary: pixel, depth, cell.
type Crossing = (u16, f64, u32);

fn in_block(mesh: &Cells, topology: &Topology, screen: &Screen, bins: &CellBins, block: Block) -> Vec<(u32, u32)> {
    let perspective = screen.projection.perspective;
    let (mut entries, mut exits): (Vec<Crossing>, Vec<Crossing>) = (Vec::new(), Vec::new());
    let first = screen.projection.first_pixel();
    let reach = [screen.projection.width as f64, screen.projection.height as f64 + SIDE as f64];
    for cell in bins.of(block) {
        let c = &mesh.cells[cell as usize];
        let Some([x0, x1, y0, y1]) = screen.bounds(c) else { continue };
        let open = topology.neighbours[cell as usize].map(|n| n == NONE);
        let on_screen = CellOnScreen::new(perspective, &c.map(|i| screen.points[i as usize]), &[0.0; 4]);
        let spans = on_screen.spans(reach);
        let (bx, by) = (block.x as i32, block.y as i32);
        for y in y0.max(by)..=y1.min(by + SIDE as i32 - 1) {
            let (a, b) = ((x0 - bx).max(0) as usize, (x1 - bx).clamp(0, SIDE as i32 - 1) as usize);
            let (from, to) = spans.columns(first[1] + f64::from(y), first[0] + f64::from(bx), a, b);
            for x in (from..to.wrapping_add(1)).map(|x| bx + x as i32) {
                let Some(stay) = on_screen.stay(perspective, first[0] + f64::from(x), first[1] + f64::from(y)) else {
                    continue;
                };
                let pixel = ((y - by) * SIDE as i32 + x - bx) as u16;
                if stay.entry.is_some_and(|k| open[usize::from(k)]) {
                    entries.push((pixel, stay.from, cell));
                }
                if open[usize::from(stay.exit)] {
                    exits.push((pixel, stay.to, cell));
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
        // Every entry follows the last exit before it; rounding may exchange an exit and the entry at the same depth.
        for entry in here {
            let slack = 1e-9 * entry.1.abs();
            let before = left.partition_point(|e| e.1 <= entry.1 + slack);
            if before > 0 {
                let exit = left[before - 1];
                if exit.2 != entry.2 {
                    out.push((exit.2, entry.2));
                }
                left = &left[before - 1..];
            }
        }
    }
    out.sort_unstable();
    out.dedup();
    out
}
