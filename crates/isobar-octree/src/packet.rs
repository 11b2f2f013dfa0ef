//! Tiles of rays together (`isobar_cpu::packet`): what the casters of all degrees share.
//!
//! Steinberger 2010, section 3.2 (S12, S13). Coefficients obey the bounds of `walk.rs` and `smooth/along.rs`: coordinates in a cell are
//! measured from the near plane, (t - t_near) |d|, or back from the far one, which rounds no more than o + t d does.
//!
//! **Several isovalues.** Polynomials are composed for the one nearest to the middle of the data, c; the others, c', shift it by a rounded c' - c. Both are off by at most 2u (M + M'), with M and M' the greatest
//! |sample - c| and |sample - c'|, and 6EM bounds what the position does, as does 6EM': positions move a polynomial by the same amount whatever its constant. So the bound
//! of the greater of M and M', which is M', holds for the other isovalue: what the shift adds is within the part of it that is left over (`walk.rs`: 22u of 64u are used; `smooth/along.rs`:
//! 716u of 800u).

use crate::trilinear::MARGIN;
use crate::walk::{Bounds, Space};
use isobar_core::{Channels, View};
use isobar_cpu::packet::{self, Cells, Crossed, Crossing, Lanes, Place, Projection, RaySet, Wanted, WithLanes, fits};
use isobar_cpu::scene::Isovalues;
use isobar_cpu::{Level, Tile, TileOut};
use std::cell::RefCell;

/// Most coefficients of the polynomial along a ray in a cell.
pub(crate) const COEFFICIENTS: usize = 10;

/// The rays of a tile.
pub(crate) type Packet = packet::Packet<COEFFICIENTS>;

/// Whether packets can draw the tile.
pub(crate) fn applies(tile: Tile, surfaces: &Isovalues) -> bool {
    fits(tile) && !surfaces.values().is_empty()
}

thread_local! {
    static PACKET: RefCell<Box<Packet>> = RefCell::new(Packet::new());
}

/// Runs `f` with this thread's packet.
pub(crate) fn with_packet<R>(f: impl FnOnce(&mut Packet) -> R) -> R {
    PACKET.with_borrow_mut(|p| f(p))
}

/// The place of a tile. `margins`: as [`Place::margins`]; `shift`: as [`Place::shift`].
pub(crate) fn place<'a>(space: &'a Space, view: &'a View, tile: Tile, shift: f64, margins: f64) -> Place<'a, Space> {
    Place {
        space,
        view,
        tile,
        shift,
        margins,
        most: MARGIN,
    }
}

/// An isovalue, relative to the one that polynomials are composed for.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Value {
    /// What those polynomials are lowered by.
    pub(crate) shift: f64,
    /// What a coefficient may be off by.
    pub(crate) bound: f64,
}

/// The isovalue that polynomials are composed for: the one whose samples differ least from it, so that one far outside the data puts no other in doubt.
pub(crate) fn reference(bounds: &[Bounds]) -> &Bounds {
    bounds[1..]
        .iter()
        .fold(&bounds[0], |least, b| if b.size < least.size { b } else { least })
}

/// The isovalues; `bound(size)`: what a coefficient may be off by where the samples differ from the isovalue by at most `size`.
pub(crate) fn values(bounds: &[Bounds], scale: f64, bound: impl Fn(f64) -> f64) -> Vec<Value> {
    let reference = reference(bounds).isovalue;
    bounds
        .iter()
        .map(|b| Value {
            shift: scale * (b.isovalue - reference),
            bound: bound(b.size),
        })
        .collect()
}

/// Cells that count how often they were looked into.
pub(crate) trait Looked: Cells {
    /// Once a ray.
    fn looked(&self) -> u64;
}

/// A tile of a volume.
pub(crate) trait Drawn {
    /// Its cells.
    type Cells<'c>: Looked
    where
        Self: 'c;
    /// Where it is.
    fn place(&self) -> &Place<'_, Space>;
    /// What is sought.
    fn surfaces(&self) -> &Isovalues;
    /// Whether what is proved is claimed.
    fn claims(&self) -> bool;
    /// The cells for a packet that has been started; `count`: whether those on each ray are to be counted.
    fn cells<'c>(&'c self, p: &'c mut Packet, count: bool) -> Self::Cells<'c>;
    /// Solves what is pending, with the proofs; keeps nothing.
    fn roots<S: Lanes>(&self, p: &Packet);
    /// Solves what is pending, with the proofs and normals.
    fn solve<S: Lanes>(&self, p: &mut Packet);
}

/// What is known after a tile.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Done {
    /// Rays to be walked alone.
    pub(crate) left: RaySet,
    pub(crate) crossed: Crossed,
    /// Active cells looked into, once a ray.
    pub(crate) cells: u64,
}

impl Done {
    fn leaving(left: RaySet) -> Self {
        Self {
            left,
            crossed: Crossed::default(),
            cells: 0,
        }
    }
}

/// Draws what packets can.
pub(crate) fn draw<W: Drawn>(level: Level, what: &W, view: &Projection, out: &mut TileOut<'_>) -> Done {
    let place = what.place();
    if place.misses(view) {
        let claims = what.claims() && out.holds(Channels::CLAIM);
        place.write_empty(out, &place.rays(), claims, None);
        return Done::leaving([0; packet::BLOCKS]);
    }
    with_packet(|packet| packet::run(level, Draw { what, packet, view, out }))
}

/// A tile as a kernel.
struct Draw<'k, 'o, W> {
    what: &'k W,
    packet: &'k mut Packet,
    view: &'k Projection,
    out: &'k mut TileOut<'o>,
}

impl<W: Drawn> WithLanes for Draw<'_, '_, W> {
    type Output = Done;

    #[inline(always)]
    fn run<S: Lanes>(self) -> Done {
        let Self { what, packet, view, out } = self;
        let place = what.place();
        let count = out.holds(Channels::WORK);
        let wanted = Wanted::new(out, what.surfaces());
        if !packet.make::<S, _>(place, wanted, count) {
            return Done::leaving(place.rays());
        }
        let mut done = Done::leaving([0; packet::BLOCKS]);
        while let Some(mut frustum) = packet.next_group::<S, _>(place) {
            if out.keeps_nearest() {
                let (tile, out) = (place.tile, &*out);
                frustum = packet.rays.end_at::<S>(frustum, |x, y| out.t(tile.x + x, tile.y + y));
            }
            if packet.rays.blocks == 0 {
                continue;
            }
            let crossing = Crossing::new(&packet.rays, place, view);
            let mut cells = what.cells(packet, count);
            let crossed = crossing.cross::<S, _>(&mut cells, &frustum);
            done.crossed.nodes += crossed.nodes;
            done.crossed.bricks += crossed.bricks;
            done.cells += cells.looked();
            drop(cells);
            what.solve::<S>(packet);
        }
        packet.write(place, what.surfaces(), out, what.claims(), count);
        done.left = packet.rays.single;
        done
    }
}
