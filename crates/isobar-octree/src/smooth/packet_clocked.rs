//! Packets of degrees 2 and 3 with the clocks of `crate::stages`.

use super::Job;
use super::basis::Spline;
use super::caster::Search;
use super::packet::{SmoothCells, Tile, place, solved};
use super::vector::{self, Isa};
use crate::packet::{self, BLOCKS, Packet, Place, RaySet, with_packet};
use crate::packet_lanes::{self, Lanes};
use crate::packet_view::Projection;
use crate::stages::{Clocked, Laps, Run};
use isobar_cpu::Level;
use std::marker::PhantomData;
use std::time::Instant;

/// As `packet::draw`, with clocks.
pub(super) fn draw<S: Spline>(search: &Search<'_>, job: &mut Job<'_, '_>, laps: &mut Laps) -> Option<RaySet> {
    let clock = Instant::now();
    if !packet::applies(job.tile, job.surfaces, job.out) {
        return None;
    }
    let view = Projection::new(job.view, search.space.of_degree_1())?;
    let place = place::<S>(search, job);
    laps.setup += clock.elapsed();
    Some(with_packet(|packet| {
        macro_rules! run {
            ($lanes:ty, $isa:ty) => {
                <$isa>::run(Run::<$lanes, Hits<'_, '_, '_, S, $isa>> {
                    what: &mut Hits {
                        tile: Tile {
                            search,
                            place: &place,
                            view: &view,
                            kind: PhantomData,
                        },
                        job,
                        isa: PhantomData,
                    },
                    packet,
                    place: &place,
                    view: &view,
                    laps,
                    lanes: PhantomData,
                })
            };
        }
        // The level of a `Search` is one this machine has.
        match search.level {
            #[cfg(target_arch = "x86_64")]
            Level::Avx512 => run!(packet_lanes::Avx512, vector::Avx512),
            #[cfg(target_arch = "x86_64")]
            Level::Avx2 => run!(packet_lanes::Avx2, vector::Avx2),
            _ => run!(packet_lanes::Plain, vector::Portable),
        }
    }))
}

/// A tile and where it is drawn.
struct Hits<'t, 'j, 'o, S, I> {
    tile: Tile<'t, S>,
    job: &'t mut Job<'j, 'o>,
    isa: PhantomData<I>,
}

impl<'t, S: Spline, I: Isa> Clocked for Hits<'t, '_, '_, S, I> {
    type Cells<'c>
        = SmoothCells<'t, S, I>
    where
        Self: 'c;

    #[inline(always)]
    fn to_cross(&self, p: &Packet) -> SmoothCells<'t, S, I> {
        self.tile.cells::<I>(p, false)
    }

    #[inline(always)]
    fn solve<L: Lanes>(&self, p: &Packet) {
        let bound = self.to_cross(p).bound;
        for b in (0..BLOCKS).filter(|&b| p.hit[b] != 0) {
            std::hint::black_box(solved::<S, L>(p, b, bound));
        }
    }

    #[inline(always)]
    fn store<L: Lanes>(&mut self, p: &mut Packet, place: &Place<'_>) {
        let bound = self.to_cross(p).bound;
        self.tile.finish::<L>(p, bound, self.job);
        place.finish_empty(self.job.out, &p.empty(place), None);
    }
}
