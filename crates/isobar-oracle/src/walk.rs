//! Conservative traversal: all boxes of a lattice that the exact ray visits, front to back, and perhaps a few it does not.
//!
//! Boxes are cubes of `stride` cells. Per axis the exit plane's crossing time is known to an error ([`crate::map::Axis::crossing`]). Where two or three
//! exits cannot be told apart (their error intervals overlap, closed transitively), every order of crossing is tried: the boxes in between are visited,
//! those one step away before those two steps away, then the one with all steps made. In truth at most one box of each number of
//! steps lies on the ray, so the order of visits is the order along the ray. A visited box comes with its own
//! enclosure of its stay, computed from its planes alone; a box the ray misses gets an enclosure that is empty (and is left
//! out) or a few ulps wide, in which exact arithmetic has the last word if a root is near.
//!
//! The scheme needs errors far below the time of one step, so that one axis never crosses twice inside a group; [`steady`] checks it.

use crate::map::RayMap;
use std::ops::ControlFlow;

/// A box on the way.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Visit {
    /// Index in units of the stride.
    pub(crate) index: [usize; 3],
    /// Outer enclosure of the stay, in s.
    pub(crate) outer: (f64, f64),
    /// Inner one: the ray is certainly inside between these; empty (`inner.0 > inner.1`) for tiny stays.
    pub(crate) inner: (f64, f64),
}

/// Whether crossing errors anywhere on the stay are below 2^-20 of the shortest step between two planes of one axis.
pub(crate) fn steady(map: &RayMap) -> bool {
    let step = map
        .axes
        .iter()
        .filter(|a| a.direction != 0)
        .map(|a| 1.0 / a.rate().abs())
        .fold(f64::INFINITY, f64::min);
    // The error grows with |s|; planes beyond the stay have larger errors but are only compared with the stay's end.
    let reach = map.start.0.abs().max(map.end.1.abs());
    map.axes.iter().filter(|a| a.direction != 0).all(|a| {
        let (_, constant) = a.crossing(a.rough(0.0).0);
        let (_, e) = a.crossing(a.rough(reach).0);
        constant.max(e) < step * 9.5e-7
    })
}

/// Walks the boxes of `[lo, hi]` (inclusive, in units of the stride) over the stay `[from, to]`.
pub(crate) struct Walk<'a> {
    pub(crate) map: &'a RayMap,
    pub(crate) stride: f64,
    pub(crate) lo: [usize; 3],
    pub(crate) hi: [usize; 3],
}

impl Walk<'_> {
    fn stay(&self, i: [usize; 3], from: f64, to: f64) -> Visit {
        let mut outer = (from, to);
        let mut inner = (self.map.start.1, self.map.end.0);
        for (axis, &i) in self.map.axes.iter().zip(&i) {
            if axis.direction == 0 {
                continue;
            }
            let (near, far) = (i as f64 * self.stride, (i + 1) as f64 * self.stride);
            let (enter, leave) = if axis.direction > 0 { (near, far) } else { (far, near) };
            let (s, e) = axis.crossing(enter);
            outer.0 = outer.0.max(s - e);
            inner.0 = inner.0.max(s + e);
            let (s, e) = axis.crossing(leave);
            outer.1 = outer.1.min(s + e);
            inner.1 = inner.1.min(s - e);
        }
        Visit { index: i, outer, inner }
    }

    /// The box the ray is in at `from`, or an earlier one where that is doubtful.
    fn first(&self, from: f64) -> [usize; 3] {
        std::array::from_fn(|a| {
            let axis = &self.map.axes[a];
            let at = if axis.direction == 0 {
                axis.constant_floor(self.stride)
            } else {
                let (v, e) = axis.rough(from);
                (if axis.direction > 0 { v - e } else { v + e } / self.stride).floor()
            };
            // Negative values saturate to 0.
            (at as usize).clamp(self.lo[a], self.hi[a])
        })
    }

    /// `index` one step along each axis of the set, `None` outside the box.
    fn step(&self, mut index: [usize; 3], set: [bool; 3]) -> Option<[usize; 3]> {
        for a in (0..3).filter(|&a| set[a]) {
            if self.map.axes[a].direction > 0 {
                if index[a] == self.hi[a] {
                    return None;
                }
                index[a] += 1;
            } else {
                if index[a] == self.lo[a] {
                    return None;
                }
                index[a] -= 1;
            }
        }
        Some(index)
    }

    /// Visits the boxes front to back until the visitor breaks.
    pub(crate) fn run<B>(&self, from: f64, to: f64, mut visit: impl FnMut(&Visit) -> ControlFlow<B>) -> ControlFlow<B> {
        let mut index = self.first(from);
        loop {
            let stay = self.stay(index, from, to);
            if stay.outer.0 <= stay.outer.1 {
                visit(&stay)?;
            }
            let mut exit = [(f64::INFINITY, f64::INFINITY); 3];
            let mut soonest = f64::INFINITY;
            let mut group_end = f64::INFINITY;
            for a in 0..3 {
                let axis = &self.map.axes[a];
                if axis.direction != 0 {
                    let plane = (index[a] + usize::from(axis.direction > 0)) as f64 * self.stride;
                    let (s, e) = axis.crossing(plane);
                    exit[a] = (s - e, s + e);
                    soonest = soonest.min(s - e);
                    group_end = group_end.min(s + e);
                }
            }
            if soonest > to || soonest == f64::INFINITY {
                return ControlFlow::Continue(());
            }
            let mut set = [false; 3];
            loop {
                let mut grown = false;
                for a in 0..3 {
                    if !set[a] && exit[a].0 <= group_end {
                        set[a] = true;
                        grown = true;
                        group_end = group_end.max(exit[a].1);
                    }
                }
                if !grown {
                    break;
                }
            }
            if set.iter().filter(|&&s| s).count() > 1 {
                self.between(index, set, (from, to), &mut visit)?;
            }
            match self.step(index, set) {
                Some(next) => index = next,
                None => return ControlFlow::Continue(()),
            }
        }
    }

    /// The boxes reached by some but not all steps of the set.
    fn between<B>(
        &self,
        index: [usize; 3],
        set: [bool; 3],
        (from, to): (f64, f64),
        visit: &mut impl FnMut(&Visit) -> ControlFlow<B>,
    ) -> ControlFlow<B> {
        let whole = (0..3).filter(|&a| set[a]).map(|a| 1usize << a).sum::<usize>();
        for steps in 1..whole.count_ones() {
            for part in (1..whole).filter(|p| p & !whole == 0 && p.count_ones() == steps) {
                let some = std::array::from_fn(|a| part >> a & 1 == 1);
                if let Some(i) = self.step(index, some) {
                    let stay = self.stay(i, from, to);
                    if stay.outer.0 <= stay.outer.1 {
                        visit(&stay)?;
                    }
                }
            }
        }
        ControlFlow::Continue(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        exact::{ExactRay, Ratio},
        map::{LocalMap, Mapped},
    };
    use isobar_core::{DMat3, DVec3, Domain, Ray};

    /// Compares `s + t_ref` with t, exactly.
    fn compare(s: f64, t_ref: f64, t: &Ratio) -> std::cmp::Ordering {
        let (a, b) = (Ratio::from_f64(s), Ratio::from_f64(t_ref));
        Ratio::new(&a.n * &b.d + &b.n * &a.d, a.d * b.d).compare(t)
    }

    fn random(seed: &mut u64) -> f64 {
        *seed = seed
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (*seed >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Every cell of the exact partition is visited, in order, inside its outer and around its inner enclosure; nested walks the same.
    #[test]
    fn no_cell_is_left_out() {
        const N: usize = 20;
        let mut seed = 9;
        let sheared = DMat3::from_cols(
            DVec3::new(1.0, 0.25, 0.0),
            DVec3::new(-0.5, 2.0, 0.125),
            DVec3::new(0.0, 0.5, -1.0),
        );
        let (mut cells, mut visits, mut rays) = (0, 0, 0);
        for n in 0..900 {
            let centred = n % 2 == 1;
            let count = [N - 1 + usize::from(centred); 3];
            let axes = [DMat3::IDENTITY, DMat3::from_diagonal(DVec3::new(0.1, 1e-6, -3.0)), sheared][n % 3];
            let domain = Domain {
                origin: DVec3::new(0.25, -1.0, 0.5),
                axes,
                lo: DVec3::ZERO,
                hi: DVec3::splat(N as f64 - 1.0),
            };
            // A third of the rays runs through lattice points and half cells, in simple directions: ties all the way.
            let point = |seed: &mut u64, from: f64, size: f64| {
                let v = DVec3::new(random(seed), random(seed), random(seed)) * size + from;
                if n % 9 < 3 { (v * 2.0).round() * 0.5 } else { v }
            };
            let a = point(&mut seed, -10.0, 40.0);
            let b = if n % 9 < 3 {
                a + (point(&mut seed, -1.0, 2.0)).round()
            } else {
                point(&mut seed, 0.0, 19.0)
            };
            let ray = Ray {
                origin: domain.origin + axes * a,
                direction: axes * (b - a),
            };
            let Some(exact) = ExactRay::new(&ray, &domain, centred) else {
                continue;
            };
            let map = match LocalMap::new(&domain, centred).unwrap().map(&ray) {
                Mapped::Ray(map) if steady(&map) => map,
                Mapped::Outside => {
                    assert!(exact.stay.is_none());
                    continue;
                }
                _ => continue,
            };
            rays += 1;
            let mut seen: Vec<Visit> = Vec::new();
            let coarse = Walk {
                map: &map,
                stride: 8.0,
                lo: [0; 3],
                hi: count.map(|n| (n - 1) / 8),
            };
            let _ = coarse.run(map.start.0, map.end.1, |v| -> ControlFlow<()> {
                let lo = v.index.map(|i| i * 8);
                let fine = Walk {
                    map: &map,
                    stride: 1.0,
                    lo,
                    hi: std::array::from_fn(|a| (lo[a] + 7).min(count[a] - 1)),
                };
                fine.run(v.outer.0, v.outer.1, |v| {
                    seen.push(*v);
                    ControlFlow::Continue(())
                })
            });
            visits += seen.len();
            let Some((mut t, _)) = exact.stay.clone() else { continue };
            let mut at = 0;
            loop {
                let index = exact.cell_at(&t, count, false);
                let span = exact.span(index, count).unwrap();
                let found = seen[at..].iter().position(|v| v.index == index);
                let found = found.unwrap_or_else(|| panic!("ray {n}: cell {index:?} is not visited after {at} of {seen:?}"));
                at += found + 1;
                cells += 1;
                let v = seen[at - 1];
                assert!(compare(v.outer.0, map.t_ref, &span.t0).is_le() && compare(v.outer.1, map.t_ref, &span.t1).is_ge());
                if v.inner.0 < v.inner.1 {
                    assert!(compare(v.inner.0, map.t_ref, &span.t0).is_ge() && compare(v.inner.1, map.t_ref, &span.t1).is_le());
                    let width = v.outer.1 - v.outer.0 - (v.inner.1 - v.inner.0);
                    assert!(width <= 1e-13 * (map.end.1 - map.start.0), "{v:?}");
                }
                if span.closed {
                    break;
                }
                t = span.t1;
            }
        }
        assert!(
            rays > 400 && cells > 5000 && visits < 3 * cells,
            "{rays} rays, {cells} cells, {visits} visits"
        );
    }
}
