//! Packets of rays: the 256 rays of a tile walk slices of bricks together, eight rays to a vector.
//!
//! Steinberger 2010, section 3.2, traces coherent blocks of rays that fall back to single rays. Here the order of loops is turned round: a tile visits the active bricks that its
//! rays can meet, front to back, and in each the active cells ([`Crossing`]); a cell goes to the blocks of 4 x 2 pixels that it covers on the screen ([`Projection`]). So
//! traversal and the data of a cell are shared by all rays, and what a method does in a cell runs in vectors of f64 ([`Lanes`]). A polynomial that has a root for certain is
//! put aside ([`Pending`]); at the end of the tile roots are worked out eight at a time, whatever rays they belong to ([`cubic_roots`]), and written front to back ([`Packet::write`]).
//!
//! **Order.** All directions of a packet have the same signs (a tile in which they differ is some packets, one after the other: [`Rays::next_group`]), and slices, bricks and cells are visited away from the eye along each axis, so of two cells on one ray the
//! nearer comes first, whichever axis is the outer loop. Roots of one cell are sorted.
//!
//! **Completeness.** A ray is inside a cell between the greatest of its three entry parameters and the least of its three exit parameters; the parameter of a plane is one
//! expression, monotone in its index, so these intervals cover the ray without gaps. In each of them a method either knows the number of roots for certain, ends not being among
//! them, or leaves the ray to be walked alone: so every root is found once, and none of two cells.
//!
//! **What is left to single rays** ([`Rays::single`]): rays a method is in doubt about, rays parallel to an axis plane, lists of rays.

mod crossing;
mod cubic;
mod fan;
mod hits;
mod lanes;
mod pending;
mod rays;
mod view;

use crate::{TILE, Tile};
pub use crossing::{Cells, Crossed, Crossing};
pub use cubic::{cubic_roots, only_roots};
pub use hits::{Packet, Solved, Wanted};
pub use lanes::{LANES, Lanes, Plain, SPREAD, WithLanes, run};
pub use pending::{Group, One, Pending};
pub use rays::{Frustum, Place, Rays, Space};
pub use view::{CellSize, Projection, Seen};

/// Blocks of a tile: 4 x 2 pixels each, 4 in a row.
pub const BLOCKS: usize = TILE * TILE / LANES;
const _: () = assert!(
    TILE == 16 && LANES == 8,
    "blocks of 4 x 2 pixels, one bit each in a u32; rays in a byte"
);

/// Rays of a tile.
pub const RAYS: usize = TILE * TILE;

/// One number per ray.
pub type PerRay = [[f64; LANES]; BLOCKS];

/// Rays of a tile, a byte per block.
pub type RaySet = [u8; BLOCKS];

/// Pixel of lane `l` of block `b` in its tile.
#[inline(always)]
#[must_use]
pub const fn pixel(b: usize, l: usize) -> (usize, usize) {
    ((b & 3) * 4 + (l & 3), (b >> 2) * 2 + (l >> 2))
}

/// Whether the set holds the ray of pixel (x, y) of the tile.
#[inline(always)]
#[must_use]
pub const fn holds(set: &RaySet, x: usize, y: usize) -> bool {
    set[(y >> 1) * 4 + (x >> 2)] >> ((y & 1) * 4 + (x & 3)) & 1 != 0
}

/// Whether packets can draw the tile: those of lists of rays may be longer than 16 pixels.
#[must_use]
pub const fn fits(tile: Tile) -> bool {
    tile.width <= TILE && tile.height <= TILE
}

/// Positions of the bits set, ascending.
#[inline(always)]
pub fn ones(mut set: u32) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        (set != 0).then(|| {
            let at = set.trailing_zeros();
            set &= set - 1;
            at as usize
        })
    })
}

/// One value per axis. `array::map` is not inlined into functions compiled for more instructions than the crate, at twice the cost of a frame.
#[inline(always)]
pub fn three<R>(f: impl Fn(usize) -> R) -> [R; 3] {
    [f(0), f(1), f(2)]
}
