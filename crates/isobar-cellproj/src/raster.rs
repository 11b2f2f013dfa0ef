//! Patches to pixels: lists per tile, and the kernel that fills a tile.

use crate::patch::{KEY_TOLERANCE, Patch};
use isobar_cpu::{TILE, Tile};

/// Pixels of a full tile.
const PIXELS: usize = TILE * TILE;
/// Pixels side by side in the kernel.
const LANES: usize = 8;

/// Patches in the order made, in chunks so that they are made in parallel without being copied.
#[derive(Debug, Default)]
pub(crate) struct Patches {
    pub(crate) chunks: Vec<Vec<Patch>>,
}

/// Most patches in a chunk: their place in it has 16 bits.
pub(crate) const CHUNK: usize = 1 << 16;

impl Patches {
    #[inline(always)]
    pub(crate) fn get(&self, id: u32) -> &Patch {
        &self.chunks[(id >> 16) as usize][(id & 0xffff) as usize]
    }

    /// Gives back what was reserved and not used, where that is much.
    pub(crate) fn pack(&mut self) {
        for c in &mut self.chunks {
            if c.len() < c.capacity() / 2 {
                c.shrink_to_fit();
            }
        }
    }

    pub(crate) fn len(&self) -> usize {
        self.chunks.iter().map(Vec::len).sum()
    }

    pub(crate) fn bytes(&self) -> usize {
        self.chunks.iter().map(|c| c.capacity() * size_of::<Patch>()).sum()
    }
}

/// For every tile the patches that may touch it, in the order made.
#[derive(Debug)]
pub(crate) struct Bins {
    columns: usize,
    /// Where each tile begins, and the end.
    starts: Vec<u32>,
    ids: Vec<u32>,
}

/// A patch in more tiles than this is held against the corners of each.
const BOX_ONLY: usize = 4;

impl Bins {
    /// Sorts the patches of a `width` x `height` image; `first` is the centre of pixel (0, 0) in centred coordinates.
    pub(crate) fn new(patches: &Patches, width: usize, height: usize, first: [f64; 2]) -> Self {
        let columns = width.div_ceil(TILE);
        let tiles = columns * height.div_ceil(TILE);
        let mut starts = vec![0u32; tiles + 2];
        let each = |f: &mut dyn FnMut(usize, u32)| {
            for (c, chunk) in patches.chunks.iter().enumerate() {
                for (i, p) in chunk.iter().enumerate() {
                    let id = (c << 16 | i) as u32;
                    tiles_of(p, first, |x, y| f(y * columns + x, id));
                }
            }
        };
        each(&mut |tile, _| starts[tile + 2] += 1);
        for i in 2..starts.len() {
            starts[i] += starts[i - 1];
        }
        let mut ids = vec![0u32; starts[tiles + 1] as usize];
        each(&mut |tile, id| {
            ids[starts[tile + 1] as usize] = id;
            starts[tile + 1] += 1;
        });
        starts.pop();
        Self { columns, starts, ids }
    }

    pub(crate) fn tile(&self, tile: Tile) -> &[u32] {
        let i = tile.y / TILE * self.columns + tile.x / TILE;
        &self.ids[self.starts[i] as usize..self.starts[i + 1] as usize]
    }

    pub(crate) fn len(&self) -> usize {
        self.ids.len()
    }

    pub(crate) fn bytes(&self) -> usize {
        (self.ids.len() + self.starts.len()) * 4
    }
}

#[inline(always)]
fn tiles_of(p: &Patch, first: [f64; 2], mut f: impl FnMut(usize, usize)) {
    let [x0, x1] = p.x.map(|v| usize::from(v) / TILE);
    let [y0, y1] = p.y.map(|v| usize::from(v) / TILE);
    let large = (x1 - x0 + 1) * (y1 - y0 + 1) > BOX_ONLY && !p.is_unsure();
    for y in y0..=y1 {
        for x in x0..=x1 {
            if large {
                // An edge function is greatest over the tile's pixels at one of its corners.
                let side = (TILE - 1) as f64;
                let (cx, cy) = ((x * TILE) as f64 + first[0], (y * TILE) as f64 + first[1]);
                let outside = |[a, b, c]: [f64; 3]| (a * cx).max(a * (cx + side)) + (b * cy).max(b * (cy + side)) + c < -2.0;
                if p.edges.iter().any(|&e| outside(e)) {
                    continue;
                }
            }
            f(x, y);
        }
    }
}

/// What is known of the pixels of a tile.
#[derive(Debug)]
pub(crate) struct TileBuffer {
    /// Key of the nearest certain hit.
    key: [f64; PIXELS],
    /// Its patch plus 1; 0: none.
    nearest: [u64; PIXELS],
    /// Not 0 where something is left for the resolver.
    unclear: [u64; PIXELS],
    /// Patches that cover the pixel.
    covered: [u64; PIXELS],
}

/// How keys are compared.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Keys {
    /// Keys of a pixel without a hit: behind all.
    none: f64,
    relative: f64,
    absolute: f64,
    /// Keys below are certainly before the start of the ray's end, t > 0; above `behind` certainly t < 0.
    front: f64,
    behind: f64,
}

impl Keys {
    pub(crate) fn new(perspective: bool, key_unit: f64) -> Self {
        if perspective {
            // The inverse depth inside a patch is positive by the edge functions alone.
            Self {
                none: 0.0,
                relative: KEY_TOLERANCE,
                absolute: 0.0,
                front: f64::INFINITY,
                behind: f64::INFINITY,
            }
        } else {
            let absolute = KEY_TOLERANCE * key_unit;
            Self {
                none: -1e300,
                relative: 0.0,
                absolute,
                front: -absolute,
                behind: absolute,
            }
        }
    }
}

impl TileBuffer {
    pub(crate) fn new(keys: &Keys) -> Self {
        Self {
            key: [keys.none; PIXELS],
            nearest: [0; PIXELS],
            unclear: [0; PIXELS],
            covered: [0; PIXELS],
        }
    }

    /// The nearest patch of pixel `i` of the tile.
    #[inline(always)]
    pub(crate) fn nearest(&self, i: usize) -> Option<u32> {
        self.nearest[i].checked_sub(1).map(|n| n as u32)
    }

    #[inline(always)]
    pub(crate) fn is_unclear(&self, i: usize) -> bool {
        self.unclear[i] != 0
    }

    #[inline(always)]
    pub(crate) fn covered(&self, i: usize) -> u32 {
        self.covered[i] as u32
    }

    /// Draws a patch: the nearest certain hit of each pixel, and where something is unclear. `corner` is the centre of the tile's first pixel in
    /// centred coordinates.
    #[inline(always)]
    pub(crate) fn draw(&mut self, patch: &Patch, id: u32, tile: Tile, corner: [f64; 2], keys: &Keys) {
        let clip = |[a, b]: [u16; 2], from: usize, n: usize| -> Option<(usize, usize)> {
            let (a, b) = (usize::from(a).max(from) - from, usize::from(b).checked_sub(from)?.min(n - 1));
            (a <= b).then_some((a, b))
        };
        let (Some((x0, x1)), Some((y0, y1))) = (clip(patch.x, tile.x, TILE), clip(patch.y, tile.y, TILE)) else {
            return;
        };
        if patch.is_unsure() {
            return self.mark(patch, (x0, x1), (y0, y1), corner);
        }
        let e = &patch.edges;
        let id = u64::from(id) + 1;
        for y in y0..=y1 {
            let cy = corner[1] + y as f64;
            let row: [f64; 4] = std::array::from_fn(|k| e[k][1] * cy + e[k][2]);
            let key_row = patch.key[1] * cy + patch.key[2];
            for chunk in x0 / LANES..=x1 / LANES {
                let at = y * TILE + chunk * LANES;
                let cx: [f64; LANES] = std::array::from_fn(|i| corner[0] + (chunk * LANES + i) as f64);
                let mut least = [f64::INFINITY; LANES];
                for k in 0..4 {
                    for i in 0..LANES {
                        let v = e[k][0] * cx[i] + row[k];
                        least[i] = if v < least[i] { v } else { least[i] };
                    }
                }
                let mut any = false;
                for v in least {
                    any |= v >= -1.0;
                }
                if !any {
                    continue;
                }
                let best: &mut [f64; LANES] = (&mut self.key[at..at + LANES])
                    .try_into()
                    .expect("the chunk lies in the tile");
                let nearest: &mut [u64; LANES] = (&mut self.nearest[at..at + LANES])
                    .try_into()
                    .expect("the chunk lies in the tile");
                let unclear: &mut [u64; LANES] = (&mut self.unclear[at..at + LANES])
                    .try_into()
                    .expect("the chunk lies in the tile");
                let covered: &mut [u64; LANES] = (&mut self.covered[at..at + LANES])
                    .try_into()
                    .expect("the chunk lies in the tile");
                for i in 0..LANES {
                    let key = patch.key[0] * cx[i] + key_row;
                    let inside = least[i] >= 1.0;
                    let near = least[i] >= -1.0 && !inside;
                    let gap = (key - best[i]).abs();
                    let tie = gap <= keys.relative * best[i].abs() + keys.absolute;
                    let starts = key <= keys.front;
                    let maybe = key <= keys.behind && !starts;
                    let open = near || (inside && (maybe || tie));
                    let wins = inside && starts && key > best[i];
                    unclear[i] |= u64::from(open);
                    covered[i] += u64::from(inside);
                    best[i] = if wins { key } else { best[i] };
                    nearest[i] = if wins { id } else { nearest[i] };
                }
            }
        }
    }

    /// A patch of which nothing is certain.
    #[cold]
    #[inline(never)]
    fn mark(&mut self, patch: &Patch, (x0, x1): (usize, usize), (y0, y1): (usize, usize), corner: [f64; 2]) {
        for (y, x) in (y0..=y1).flat_map(|y| (x0..=x1).map(move |x| (y, x))) {
            if patch.covers(corner[0] + x as f64, corner[1] + y as f64).1 {
                self.unclear[y * TILE + x] = 1;
            }
        }
    }
}
