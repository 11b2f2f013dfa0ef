//! All roots: cells with one root each, gathered until sixteen can be refined together.

use super::refine::{Isolated, refine};
use super::walk::{Cell, Keep, isolate, stack};
use super::{NO_ROOT, is_plain, load, rest_all};
use crate::answer::{Collect, Roots, Tolerance};
use crate::simd::{LANES, Wide};

/// Packets whose cells are gathered together. At the end of each group a refinement may have idle lanes.
const GROUP: usize = 64;

/// Cells of a group of packets that wait for refinement, one per lane.
struct Gather<'a, const M: usize> {
    packets: &'a [[[f32; LANES]; M]],
    tolerance: &'a Tolerance<f32>,
    out: &'a mut [[Roots<f32>; LANES]],
    /// Lanes left to the scalar solver.
    scalar: [u16; GROUP],
    /// The packet that is walked.
    now: usize,
    len: usize,
    b: [[f32; LANES]; M],
    original: [[f32; LANES]; M],
    a: [f32; LANES],
    w: [f32; LANES],
    error: [f32; LANES],
    most: [f32; LANES],
    /// Packet and lane.
    from: [(usize, usize); LANES],
}

#[inline(always)]
pub(super) fn many<W: Wide, const M: usize>(
    packets: &[[[f32; LANES]; M]],
    tolerance: &Tolerance<f32>,
    out: &mut [[Roots<f32>; LANES]],
) {
    let plain = is_plain::<M>(tolerance);
    let mut stack = stack::<W, M>();
    for (packets, out) in packets.chunks(GROUP).zip(out.chunks_mut(GROUP)) {
        let zero = [0.0; LANES];
        let mut gather = Gather {
            packets,
            tolerance,
            out,
            scalar: [if plain { 0 } else { u16::MAX }; GROUP],
            now: 0,
            len: 0,
            b: [zero; M],
            original: [zero; M],
            a: zero,
            w: [1.0; LANES],
            error: zero,
            most: zero,
            from: [(0, 0); LANES],
        };
        if plain {
            for (now, input) in packets.iter().enumerate() {
                gather.now = now;
                gather.out[now].iter_mut().for_each(Roots::clear);
                let left = isolate(load::<W, M>(input), tolerance, &mut stack, &mut gather);
                gather.scalar[now] |= W::bits(left);
            }
            gather.flush::<W>();
        }
        for ((input, out), which) in packets.iter().zip(gather.out).zip(gather.scalar) {
            if which != 0 {
                rest_all(input, tolerance, which, out);
            }
        }
    }
}

impl<const M: usize> Gather<'_, M> {
    /// Refines what waits.
    #[inline(always)]
    fn flush<W: Wide>(&mut self) {
        let zero = W::splat(0.0);
        // Lanes beyond are old or empty cells; what comes of them is not read.
        let cells = Isolated {
            b: load::<W, M>(&self.b),
            a: W::load(&self.a),
            w: W::load(&self.w),
            error: W::load(&self.error),
            most: W::load(&self.most),
            root: zero.equals(zero),
        };
        let mut roots = [NO_ROOT; LANES];
        let open = refine(&cells, &self.original, self.tolerance, &mut roots);
        for (l, root) in roots.into_iter().enumerate().take(self.len) {
            let (packet, lane) = self.from[l];
            if open >> l & 1 != 0 {
                self.scalar[packet] |= 1 << lane;
            } else {
                self.out[packet][lane].take(root);
            }
        }
        self.len = 0;
    }
}

impl<W: Wide, const M: usize> Keep<W, M> for Gather<'_, M> {
    const FIRST: bool = false;

    #[inline(always)]
    fn keep(&mut self, cell: &Cell<W, M>, lanes: W::Mask) {
        let mut set = W::bits(lanes);
        // Not `array::map`, which is not inlined into functions compiled for more instructions than the crate.
        let mut b = [[0.0; LANES]; M];
        for (to, row) in b.iter_mut().zip(&cell.b) {
            *to = row.store();
        }
        let (error, most) = (cell.error.store(), cell.most.store());
        let input = &self.packets[self.now];
        while set != 0 {
            let (lane, to) = (set.trailing_zeros() as usize % LANES, self.len % LANES);
            set &= set - 1;
            for i in 0..M {
                self.b[i][to] = b[i][lane];
                self.original[i][to] = input[i][lane];
            }
            (self.a[to], self.w[to]) = (cell.a, cell.w);
            (self.error[to], self.most[to]) = (error[lane], most[lane]);
            self.from[to] = (self.now, lane);
            self.len += 1;
            if self.len == LANES {
                self.flush::<W>();
            }
        }
    }
}
