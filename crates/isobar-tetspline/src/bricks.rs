//! Which cubes an isovalue can meet: a min/max hierarchy over bricks of 4^3 cubes.
//!
//! Kalbe et al. 2009, section 4.1, classify every cube on each change of the isovalue from its determining set, and name min/max structures as an improvement
//! (section 5). Here: the least and greatest datum of the 27-neighbourhoods of every brick, once per data set; per isovalue one bit per brick, 64 bricks to a word; the cubes of
//! a brick get such a word, from their 27 data, when the first ray enters it, and the 24 tetrahedra of a cube their bits, from their coefficients, when the first ray enters
//! the cube: the paper's arrays T_active, for what is seen of them. All this is conservative; the paper's own classification of cubes is not (maths: corrections, section A, caution 1;
//! counted by [`crate::classify`]).

use crate::classify::{Rule, is_active};
use isobar_cpu::index::Bounds;
use isobar_cpu::nodes::{Nodes, Ranges, SIDE};
use isobar_fields::type6::DeterminingSet;
use rayon::prelude::*;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};
use std::sync::{Mutex, OnceLock};

/// Data a volume may have.
pub(crate) trait Datum: Copy + PartialOrd + Into<f64> + Send + Sync + std::fmt::Debug + 'static {}
impl<T: Copy + PartialOrd + Into<f64> + Send + Sync + std::fmt::Debug + 'static> Datum for T {}

#[inline(always)]
fn least<T: PartialOrd>(a: T, b: T) -> T {
    if b < a { b } else { a }
}

#[inline(always)]
fn greatest<T: PartialOrd>(a: T, b: T) -> T {
    if b > a { b } else { a }
}

/// The range of every brick, for data of `dims`, each at least 2: as many cubes. In the memory of bricks that are not needed any more, where it suffices: a time step of the same size allocates nothing (K25).
pub(crate) fn ranges<T: Datum>(data: &[T], dims: [usize; 3], old: Option<Ranges<T>>) -> Ranges<T> {
    let bricks = dims.map(|n| n.div_ceil(SIDE));
    let mut range = old.map_or_else(Vec::new, |o| o.range);
    range.resize(bricks.iter().product(), [data[0]; 2]);
    range.par_chunks_mut(bricks[0]).enumerate().for_each(|(row, out)| {
        let span = |b: usize, n: usize| (b * SIDE).saturating_sub(1)..(b * SIDE + SIDE + 1).min(n);
        for (i, o) in out.iter_mut().enumerate() {
            let x = span(i, dims[0]);
            let mut r: Option<[T; 2]> = None;
            for z in span(row / bricks[1], dims[2]) {
                for y in span(row % bricks[1], dims[1]) {
                    let start = (z * dims[1] + y) * dims[0];
                    for &v in &data[start + x.start..start + x.end] {
                        r = Some(r.map_or([v; 2], |[a, b]| [least(a, v), greatest(b, v)]));
                    }
                }
            }
            if let Some(r) = r {
                *o = r;
            }
        }
    });
    Ranges { dims: bricks, range }
}

/// Bricks, and later cubes and tetrahedra, that the isovalues can meet; made anew when these change, in time linear in the number of bricks.
#[derive(Debug)]
pub(crate) struct Active {
    /// Which bricks may hold a surface.
    pub(crate) nodes: Nodes,
    /// How cubes are classified.
    rule: Rule,
    /// Per active brick, made when the first ray enters it.
    bricks: Vec<OnceLock<Box<Cubes>>>,
    /// Whether determining sets are kept for the cubes that rays enter (K13).
    stored: bool,
    /// Bricks of isovalues and time steps before, whose memory is used again.
    #[expect(clippy::vec_box, reason = "the boxes themselves are what is used again")]
    spare: Mutex<Vec<Box<Cubes>>>,
}

/// The cubes of an active brick, and their tetrahedra: the paper's list of active tetrahedra, for what is seen of it.
#[derive(Debug)]
pub(crate) struct Cubes {
    /// Active cubes; a bit is cleared when none of its tetrahedra turns out to be active.
    mask: AtomicU64,
    /// Per cube: active kinds (24 bits) and [`KNOWN`]. Empty where tetrahedra are not kept ([`Rule::Data`]).
    kinds: Vec<AtomicU32>,
    /// Per cube, its determining set: made when the first ray enters the cube. Empty where coefficients are worked out on the fly.
    sets: Vec<OnceLock<Box<DeterminingSet<f64>>>>,
}

/// Marks kinds that have been worked out.
const KNOWN: u32 = 1 << 31;

impl Cubes {
    /// Active cubes.
    #[inline(always)]
    pub(crate) fn mask(&self) -> u64 {
        self.mask.load(Ordering::Relaxed)
    }

    /// Active kinds of cube `b`, if known: all of them where they are not kept.
    #[inline(always)]
    pub(crate) fn known(&self, b: u32) -> Option<u32> {
        let Some(slot) = self.kinds.get(b as usize) else {
            return Some((1 << 24) - 1);
        };
        let kinds = slot.load(Ordering::Relaxed);
        (kinds != 0).then_some(kinds & !KNOWN)
    }

    /// The determining set of cube `b`, where sets are kept.
    #[inline(always)]
    pub(crate) fn set(&self, b: u32, make: impl FnOnce() -> DeterminingSet<f64>) -> Option<&DeterminingSet<f64>> {
        Some(self.sets.get(b as usize)?.get_or_init(|| Box::new(make())))
    }

    /// Keeps the active kinds of cube `b`; every thread would keep the same.
    #[inline(always)]
    pub(crate) fn keep(&self, b: u32, kinds: u32) {
        if let Some(slot) = self.kinds.get(b as usize) {
            slot.store(kinds | KNOWN, Ordering::Relaxed);
            if kinds == 0 {
                self.mask.fetch_and(!(1 << b), Ordering::Relaxed);
            }
        }
    }
}

impl Active {
    /// In the memory of what was active before, where it suffices.
    pub(crate) fn new<T: Datum>(bricks: &Ranges<T>, bounds: &[Bounds], rule: Rule, stored: bool, old: Option<Self>) -> Self {
        let (nodes, mut all, spare) = match old {
            Some(old) => (Some(old.nodes), old.bricks, old.spare),
            None => Default::default(),
        };
        let nodes = Nodes::new(bricks, bounds, nodes);
        let count = nodes.count();
        let mut free = spare.into_inner().unwrap_or_default();
        free.extend(all.iter_mut().filter_map(OnceLock::take));
        // No more than can be needed.
        free.truncate(count);
        all.resize_with(count, OnceLock::new);
        Self {
            nodes,
            rule,
            bricks: all,
            stored,
            spare: Mutex::new(free),
        }
    }

    /// A brick with these active cubes, nothing known of their tetrahedra.
    fn fresh(&self, mask: u64) -> Box<Cubes> {
        let of = |used: bool| if used { 64 } else { 0 };
        let (kinds, sets) = (of(self.rule != Rule::Data), of(self.stored));
        let spare = self.spare.lock().ok().and_then(|mut s| s.pop());
        let mut cubes = spare.unwrap_or_else(|| {
            Box::new(Cubes {
                mask: AtomicU64::new(0),
                kinds: Vec::new(),
                sets: Vec::new(),
            })
        });
        *cubes.mask.get_mut() = mask;
        cubes.kinds.iter_mut().for_each(|k| *k.get_mut() = 0);
        cubes.kinds.resize_with(kinds, || AtomicU32::new(0));
        cubes.sets.clear();
        cubes.sets.resize_with(sets, OnceLock::new);
        cubes
    }

    /// Bytes held now.
    pub(crate) fn bytes(&self) -> usize {
        let made = self.bricks.iter().filter_map(OnceLock::get);
        let set = |s: &OnceLock<Box<DeterminingSet<f64>>>| {
            if s.get().is_some() {
                size_of::<DeterminingSet<f64>>()
            } else {
                0
            }
        };
        let of =
            |c: &Cubes| size_of::<Cubes>() + c.kinds.capacity() * 4 + c.sets.len() * 16 + c.sets.iter().map(set).sum::<usize>();
        let spare: usize = self.spare.lock().map_or(0, |s| s.iter().map(|c| of(c)).sum());
        let cubes = made.map(|c| of(c)).sum::<usize>() + spare;
        self.nodes.bytes() + self.bricks.len() * size_of::<OnceLock<Box<Cubes>>>() + cubes
    }

    /// Whether nothing that can hold a surface is left out.
    pub(crate) fn is_conservative(&self) -> bool {
        self.rule != Rule::DeterminingSet
    }

    /// Whether active tetrahedra are kept.
    #[inline(always)]
    pub(crate) fn keeps(&self) -> bool {
        self.rule != Rule::Data
    }

    /// Active bricks.
    pub(crate) fn count(&self) -> usize {
        self.bricks.len()
    }

    /// The cubes of brick `at` (bit `b` of word `w`, which is set).
    #[inline(always)]
    pub(crate) fn cubes<T: Datum>(
        &self,
        w: usize,
        b: u32,
        at: [i32; 3],
        data: &[T],
        dims: [usize; 3],
        bounds: &[Bounds],
    ) -> &Cubes {
        self.bricks[self.nodes.brick(w, b)].get_or_init(|| {
            let mask = active_cubes(at, data, dims, bounds);
            let mask = match self.rule {
                Rule::DeterminingSet => narrowed(self.rule, mask, at, data, dims, bounds),
                _ => mask,
            };
            self.fresh(mask)
        })
    }
}

/// The cubes of a mask that another rule keeps.
#[inline(never)]
fn narrowed<T: Datum>(rule: Rule, mask: u64, brick: [i32; 3], data: &[T], dims: [usize; 3], bounds: &[Bounds]) -> u64 {
    let mut out = 0;
    let mut rest = mask;
    while rest != 0 {
        let n = rest.trailing_zeros();
        rest &= rest - 1;
        let cube: [usize; 3] = std::array::from_fn(|a| brick[a] as usize * SIDE + (n as usize >> (2 * a) & 3));
        let near = |a: usize, o: usize| (cube[a] + o).saturating_sub(1).min(dims[a] - 1);
        let on = bounds.iter().any(|b| {
            let d: [f64; 27] = std::array::from_fn(|n| {
                let at = (near(2, n / 9) * dims[1] + near(1, n / 3 % 3)) * dims[0] + near(0, n % 3);
                data[at].into() - b.isovalue
            });
            is_active(rule, &d, b.margin())
        });
        out |= u64::from(on) << n;
    }
    out
}

/// Least and greatest of three neighbours along one axis after the other.
#[inline(never)]
pub(crate) fn active_cubes<T: Datum>(brick: [i32; 3], data: &[T], dims: [usize; 3], bounds: &[Bounds]) -> u64 {
    const N: usize = SIDE + 2;
    let first = brick.map(|b| b as usize * SIDE);
    let index = |a: usize, i: usize| (first[a] + i).saturating_sub(1).min(dims[a] - 1);
    let zero = data[0];
    let mut rows = [[[zero; 2]; SIDE]; N * N];
    for (n, row) in rows.iter_mut().enumerate() {
        let start = (index(2, n / N) * dims[1] + index(1, n % N)) * dims[0];
        let v: [T; N] = std::array::from_fn(|i| data[start + index(0, i)]);
        for (i, r) in row.iter_mut().enumerate() {
            *r = [
                least(least(v[i], v[i + 1]), v[i + 2]),
                greatest(greatest(v[i], v[i + 1]), v[i + 2]),
            ];
        }
    }
    let three = |a: [T; 2], b: [T; 2], c: [T; 2]| [least(least(a[0], b[0]), c[0]), greatest(greatest(a[1], b[1]), c[1])];
    let mut planes = [[[zero; 2]; SIDE * SIDE]; N];
    for (k, plane) in planes.iter_mut().enumerate() {
        for j in 0..SIDE {
            for i in 0..SIDE {
                let at = k * N + j;
                plane[j * SIDE + i] = three(rows[at][i], rows[at + 1][i], rows[at + 2][i]);
            }
        }
    }
    let mut mask = 0;
    for k in 0..SIDE {
        for (n, &below) in planes[k].iter().enumerate() {
            let [lo, hi] = three(below, planes[k + 1][n], planes[k + 2][n]);
            let inside = first[0] + n % SIDE < dims[0] && first[1] + n / SIDE < dims[1] && first[2] + k < dims[2];
            let on = inside && bounds.iter().any(|b| b.meets(lo.into(), hi.into()));
            mask |= u64::from(on) << (k * SIDE * SIDE + n);
        }
    }
    mask
}

#[cfg(test)]
mod tests {
    use super::*;
    use isobar_cpu::nodes::bit;

    /// A brick or cube is active exactly where the range of its 27 data meets the isovalue, also where sizes divide nothing.
    #[test]
    fn activity_is_that_of_the_neighbourhoods() {
        let mut s = 12345u32;
        for dims in [[2, 2, 2], [5, 9, 17], [18, 3, 6]] {
            let data: Vec<f32> = (0..dims.iter().product())
                .map(|i: usize| {
                    s = s.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    (s >> 8) as f32 / 65536.0 / 8.0 + (i % dims[0]) as f32 * 10.0
                })
                .collect();
            let bricks = ranges(&data, dims, None);
            let bounds = [Bounds::new(20.0, 0.0, (0.0, 256.0)), Bounds::new(90.0, 0.0, (0.0, 256.0))];
            let active = Active::new(&bricks, &bounds, Rule::Data, false, None);
            let (mut count, mut off) = (0, 0);
            for z in 0..dims[2] {
                for y in 0..dims[1] {
                    for x in 0..dims[0] {
                        let near = |i: usize, o: usize, n: usize| (i + o).saturating_sub(1).min(n - 1);
                        let v = (0..27).map(|n| {
                            let at = [near(x, n % 3, dims[0]), near(y, n / 3 % 3, dims[1]), near(z, n / 9, dims[2])];
                            f64::from(data[(at[2] * dims[1] + at[1]) * dims[0] + at[0]])
                        });
                        let (lo, hi) = v.fold((f64::MAX, f64::MIN), |(a, b), v| (a.min(v), b.max(v)));
                        let want = bounds.iter().any(|b| b.meets(lo, hi));
                        let cube = [x as i32, y as i32, z as i32];
                        let brick = cube.map(|c| c >> 2);
                        let w = active.nodes.word_of(brick.map(|b| b >> 2));
                        let on = active.nodes.words[w] >> bit(brick) & 1 == 1;
                        assert!(on || !want, "an active cube in a brick that is not");
                        if on {
                            let mask = active.cubes(w, bit(brick), brick, &data, dims, &bounds).mask();
                            assert_eq!(mask >> bit(cube) & 1 == 1, want, "{cube:?} of {dims:?}");
                        }
                        count += usize::from(want);
                        off += usize::from(!want);
                    }
                }
            }
            assert!(count > 0 && (off > 0 || dims[0] == 2), "{dims:?}");
        }
    }

    /// A further time step, and a further isovalue, in the memory of the one before.
    #[test]
    fn a_time_step_allocates_nothing() {
        let dims = [21, 18, 13];
        let step = |shift: usize| -> Vec<f32> { (0..dims.iter().product()).map(|i: usize| ((i + shift) % 97) as f32).collect() };
        let bounds = [Bounds::new(40.0, 0.0, (0.0, 96.0))];
        let data = step(0);
        let bricks = ranges(&data, dims, None);
        let active = Active::new(&bricks, &bounds, Rule::Coefficients, false, None);
        let enter = |active: &Active, data: &[f32]| {
            let first = active.cubes(0, active.nodes.words[0].trailing_zeros(), [0; 3], data, dims, &bounds);
            first.keep(3, 5);
            (std::ptr::from_ref(first), first.kinds.as_ptr())
        };
        let cubes = enter(&active, &data);
        let (words, range, bytes) = (active.nodes.words.as_ptr(), bricks.range.as_ptr(), active.bytes());
        let data = step(31);
        let bricks = ranges(&data, dims, Some(bricks));
        let active = Active::new(&bricks, &bounds, Rule::Coefficients, false, Some(active));
        assert_eq!((active.nodes.words.as_ptr(), bricks.range.as_ptr()), (words, range));
        assert_eq!(active.bytes(), bytes, "the brick entered before is spare now");
        let first = active.cubes(0, active.nodes.words[0].trailing_zeros(), [0; 3], &data, dims, &bounds);
        assert_eq!(first.known(3), None, "nothing is known any more");
        assert_eq!((enter(&active, &data), active.bytes()), (cubes, bytes));
    }
}
