//! Packets of rays (`isobar_cpu::packet`): pieces of eight rays are worked out at a time.
//!
//! The paper rasterises tetrahedra, each for all pixels it covers (section 4.3). Here a cube goes to the blocks of 4 x 2 pixels that it covers on the screen. There the pieces of
//! eight rays in the tetrahedra of the cube
//! are cut by sorted plane parameters, as single rays do it, and those in active tetrahedra are put into a queue (`cubes.rs`). The queue is emptied eight pieces
//! at a time, whatever ray and tetrahedron they belong to: coefficients from the data, blossoming, signs (`pieces.rs`). So lanes are full where tetrahedra are as small as
//! pixels. Roots, proofs and gradients come at the end, eight at a time (`finish.rs`).
//!
//! **Completeness.** Inside a cube the pieces between sorted parameters cover the ray without gaps. Coefficients obey the bound of `ray.rs`; those of further isovalues, which
//! shift the cubic of the first one, that of the greater of both |datum - isovalue|: 14 roundings more, of a bound that is seven times what it has to be.
//!
//! **What is left to single rays**, beside what packets leave in any method: a ray on which any coefficient that matters lies within the bound.

mod cubes;
mod finish;
mod pieces;
#[cfg(test)]
mod tests;

use crate::bricks::{self, Active, Datum};
use crate::cube::Data;
use crate::ray::{FORMS, Space, three};
use crate::walk::{Search, Work};
use cubes::Cubes;
use isobar_core::{Channels, View};
use isobar_cpu::index::Bounds;
use isobar_cpu::nodes::bit;
use isobar_cpu::packet::{BLOCKS, Crossing, LANES, Lanes, PerRay, Place, RAYS, Wanted, WithLanes, fits, ones, run};
pub(crate) use isobar_cpu::packet::{Projection, RaySet, holds};
use isobar_cpu::scene::Isovalues;
use isobar_cpu::{Level, Tile, TileOut};
use isobar_fields::type6::DENOMINATOR;
use std::cell::RefCell;

/// Index space is shifted by this where cubes are counted, so that they begin at whole numbers: the domain is `[SHIFT, hi + SHIFT]`.
const SHIFT: f64 = 0.5;

/// The rays of a tile, with cubics.
type Packet = isobar_cpu::packet::Packet<4>;

/// A volume with data of any type: what depends on the type is called once a cube, so that packets are compiled once per instruction set.
pub(crate) trait Field {
    /// Cubes per axis.
    fn size(&self) -> [i32; 3];
    fn bounds(&self) -> &[Bounds];
    fn active(&self) -> &Active;
    /// Whether every root is found.
    fn finds_all(&self) -> bool;
    /// The cubes of an active brick.
    fn brick(&self, brick: [i32; 3]) -> &bricks::Cubes;
    /// The 27 data of a cube minus the first isovalue.
    fn data(&self, cube: [i32; 3]) -> Data;
}

impl<T: Datum> Field for Search<'_, T> {
    fn size(&self) -> [i32; 3] {
        three(|a| self.dims[a] as i32)
    }
    fn bounds(&self) -> &[Bounds] {
        self.bounds
    }
    fn active(&self) -> &Active {
        self.active
    }
    fn finds_all(&self) -> bool {
        Search::finds_all(self)
    }
    fn brick(&self, brick: [i32; 3]) -> &bricks::Cubes {
        let word = self.active.nodes.word_of(three(|a| brick[a] >> 2));
        self.active.cubes(word, bit(brick), brick, self.data, self.dims, self.bounds)
    }
    fn data(&self, cube: [i32; 3]) -> Data {
        self.gather(cube)
    }
}

/// A tile to be drawn.
pub(crate) struct Job<'a, 'b> {
    pub(crate) field: &'a dyn Field,
    pub(crate) space: &'a Space,
    pub(crate) view: &'a View,
    pub(crate) surfaces: &'a Isovalues,
    pub(crate) claims: bool,
    pub(crate) tile: Tile,
    pub(crate) out: &'a mut TileOut<'b>,
}

/// What the pieces of rays need beside [`Packet`].
struct Paths {
    /// Index space: `a * RAYS + ray`.
    origin: [f64; 4 * RAYS],
    direction: [f64; 4 * RAYS],
    /// Parameters of the planes of the six forms of `ray.rs`, as those of the faces of cubes.
    form_inv: [PerRay; 6],
    form_shift: [PerRay; 6],
}

thread_local! {
    /// Some 130 KiB that need no clearing between tiles.
    static RAYS_OF_TILE: RefCell<(Box<Packet>, Box<Paths>)> = RefCell::new((Packet::new(), Box::new(Paths {
        origin: [0.0; 4 * RAYS],
        direction: [0.0; 4 * RAYS],
        form_inv: [[[0.0; LANES]; BLOCKS]; 6],
        form_shift: [[[0.0; LANES]; BLOCKS]; 6],
    })));
}

/// An isovalue, relative to the first one, 192 times.
#[derive(Debug, Clone, Copy)]
struct Value {
    /// What cubics of the first one are lowered by.
    shift: f64,
    /// What a coefficient may be off by.
    bound: f64,
    /// What active tetrahedra allow for.
    margin: f64,
}

/// `margin`: the relative bound of the packet's rays.
fn values(bounds: &[Bounds], margin: f64) -> Vec<Value> {
    let scale = f64::from(DENOMINATOR);
    bounds
        .iter()
        .map(|b| Value {
            shift: scale * (b.isovalue - bounds[0].isovalue),
            bound: scale * margin * b.size.max(bounds[0].size),
            margin: scale * b.margin().max(bounds[0].margin()),
        })
        .collect()
}

impl Job<'_, '_> {
    /// Whether packets can draw the tile.
    pub(crate) fn suits_packets(&self) -> bool {
        self.field.finds_all() && fits(self.tile) && !self.surfaces.values().is_empty()
    }

    /// Draws what packets can; gives the rays that are left. `most`: the margin that activity allows for.
    pub(crate) fn draw(&mut self, level: Level, view: &Projection, most: f64, work: &mut Work) -> RaySet {
        let place = Place {
            space: self.space,
            view: self.view,
            tile: self.tile,
            shift: SHIFT,
            margins: 1.0,
            most,
        };
        if place.misses(view) {
            let claims = self.claims && self.out.holds(Channels::CLAIM);
            place.write_empty(self.out, &place.rays(), claims, None);
            return [0; BLOCKS];
        }
        RAYS_OF_TILE.with_borrow_mut(|(packet, paths)| {
            let kernel = Draw {
                job: self,
                place,
                packet,
                paths,
                view,
                work,
            };
            run(level, kernel)
        })
    }
}

/// A tile as a kernel.
struct Draw<'k, 'a, 'b> {
    job: &'k mut Job<'a, 'b>,
    place: Place<'k, Space>,
    packet: &'k mut Packet,
    paths: &'k mut Paths,
    view: &'k Projection,
    work: &'k mut Work,
}

impl WithLanes for Draw<'_, '_, '_> {
    type Output = RaySet;

    #[inline(always)]
    fn run<S: Lanes>(self) -> RaySet {
        let Self {
            job,
            place,
            packet,
            paths,
            view,
            work,
        } = self;
        let wanted = Wanted::new(job.out, job.surfaces);
        let count = job.out.holds(Channels::WORK);
        let Some(frustum) = packet.start::<S, _>(&place, wanted, count) else {
            return place.rays();
        };
        if packet.rays.blocks != 0 {
            paths.start::<S>(packet, job.space);
            let values = values(job.field.bounds(), packet.rays.margin);
            let crossing = Crossing::new(&packet.rays, &place, view);
            let mut cubes = Cubes::new(job.field, &values, packet, paths, work, count);
            let crossed = crossing.cross::<S, _>(&mut cubes, &frustum);
            work.nodes += crossed.nodes;
            work.bricks += crossed.bricks;
            job.solve::<S>(packet, paths, &values);
        }
        packet.write(&place, job.surfaces, job.out, job.claims, count);
        packet.rays.single
    }
}

impl Paths {
    /// Eight of the numbers of rays, those of block `b` for axis `a`.
    #[inline(always)]
    fn of<S: Lanes>(all: &[f64; 4 * RAYS], a: usize, b: usize) -> S {
        let at = a * RAYS + b * LANES;
        all[at..].first_chunk().map_or(S::splat(0.0), S::load)
    }

    /// Of the rays of a packet that are under way. The parameters of planes through the centres of cubes are never inside where a ray is parallel.
    #[inline(always)]
    fn start<S: Lanes>(&mut self, p: &Packet, space: &Space) {
        let zero = S::splat(0.0);
        for b in ones(p.rays.blocks) {
            for n in b * LANES..(b + 1) * LANES {
                let ray = &p.rays.rays[n];
                let o = space.index_vector(ray.origin - space.domain.origin).to_array();
                let d = space.index_vector(ray.direction).to_array();
                for a in 0..3 {
                    self.origin[a * RAYS + n] = o[a];
                    self.direction[a * RAYS + n] = d[a];
                }
            }
            for (n, &(i, j, sign)) in FORMS.iter().enumerate() {
                let p = Self::of::<S>(&self.origin, i, b).add(S::splat(sign).mul(Self::of(&self.origin, j, b)));
                let q = Self::of::<S>(&self.direction, i, b).add(S::splat(sign).mul(Self::of(&self.direction, j, b)));
                let crosses = q.above(zero) | zero.above(q);
                let inv = S::splat(1.0).div(q).where_or(crosses, zero);
                let shift = zero.sub(p).mul(inv).where_or(crosses, S::splat(f64::NEG_INFINITY));
                inv.store(&mut self.form_inv[n][b]);
                shift.store(&mut self.form_shift[n][b]);
            }
        }
    }
}
