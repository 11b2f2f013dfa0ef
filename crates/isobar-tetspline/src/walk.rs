//! A ray through nodes, bricks, cubes and tetrahedra.
//!
//! Kalbe et al. 2009 rasterise bounding tetrahedra; on the CPU the ray walks them instead (their Fig. 4, right, is that picture): nodes of 16^3, bricks of 4^3 and cubes by a
//! digital differential analyser, then the tetrahedra of an active cube. All planes of the type-6 partition belong to nine families, `x_a = i + 1/2` and `x_a +- x_b = i`; a
//! plane's parameter is the same expression of its number wherever it is met, and the segments between the sorted parameters adjoin, so no ray slips between two of them. Which
//! tetrahedron a segment belongs to is read off its middle.
//! The bound on the error of a coefficient is derived in `ray.rs`.

use crate::bricks::{Active, Cubes, Datum};
use crate::cube::{self, Data};
use crate::ray::{FORMS, Walk, three};
use crate::roots::{Chain, Finder, Found};
use glam::DVec3;
use isobar_cpu::index::Bounds;
use isobar_cpu::nodes::{Cast, bit};
use isobar_fields::type6::{DENOMINATOR, DeterminingSet, kind_of};

/// Least and greatest coefficient.
#[inline(always)]
fn hull(b: &[f64; 20]) -> (f64, f64) {
    // Four running extrema, so that comparisons do not wait for each other.
    let (mut lo, mut hi) = ([b[0], b[1], b[2], b[3]], [b[0], b[1], b[2], b[3]]);
    for n in 1..5 {
        for l in 0..4 {
            let v = b[4 * n + l];
            lo[l] = if v < lo[l] { v } else { lo[l] };
            hi[l] = if v > hi[l] { v } else { hi[l] };
        }
    }
    (lo[0].min(lo[1]).min(lo[2].min(lo[3])), hi[0].max(hi[1]).max(hi[2].max(hi[3])))
}

/// The 20 coefficients of a kind from a stored determining set, by the averaging rules.
#[inline(never)]
fn averaged(set: &DeterminingSet<f64>, kind: usize) -> [f64; 20] {
    set.coefficients(kind).map(|v| v * (1.0 / f64::from(DENOMINATOR)))
}

/// A root along the ray.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Root {
    pub(crate) found: Found,
    /// Index of the isovalue.
    pub(crate) surface: usize,
    /// Gradient of s in index space.
    pub(crate) gradient: DVec3,
}

/// What is kept along a ray.
#[derive(Debug)]
pub(crate) struct Scratch {
    chains: Vec<Chain>,
    found: Vec<(Found, usize)>,
}

impl Scratch {
    pub(crate) fn new(surfaces: usize) -> Self {
        Self {
            chains: vec![Chain::new(); surfaces],
            found: Vec::with_capacity(3 * surfaces),
        }
    }
}

/// Work done along rays.
#[derive(Debug, Default, Clone, Copy)]
pub(crate) struct Work {
    pub(crate) nodes: u64,
    pub(crate) bricks: u64,
    pub(crate) cubes: u64,
    /// Active cubes entered.
    pub(crate) active: u64,
    /// Tetrahedra whose coefficients were worked out.
    pub(crate) tets: u64,
    /// Cubics made from them (in packets: those that may have a root).
    pub(crate) cubics: u64,
    /// Rays walked alone.
    pub(crate) alone: u64,
}

/// A volume with the surfaces sought in it.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Search<'a, T> {
    pub(crate) data: &'a [T],
    pub(crate) dims: [usize; 3],
    pub(crate) active: &'a Active,
    pub(crate) bounds: &'a [Bounds],
    pub(crate) finder: Finder,
    /// The relative bound of these rays.
    pub(crate) margin: f64,
}

/// State of one ray on its way.
struct Way<'w, F> {
    walk: Walk,
    scratch: &'w mut Scratch,
    work: &'w mut Work,
    /// End of the last tetrahedron looked at.
    end: f64,
    /// Where the last cubic ended, with the value of s (minus the first isovalue) and its slope there: those at the start of the next one.
    jet: (f64, [f64; 2]),
    push: F,
}

impl<T> Search<'_, T> {
    /// Whether every root is found: neither the paper's roots nor its classification.
    pub(crate) fn finds_all(&self) -> bool {
        self.finder == Finder::Certified && self.active.is_conservative()
    }
}

impl<'a, T: Datum, F: FnMut(&Root) -> bool> Cast<Way<'_, F>> for Search<'a, T> {
    type Brick = (&'a Cubes, u64);

    #[inline(always)]
    fn node(&self, way: &mut Way<'_, F>) {
        way.work.nodes += 1;
    }

    #[inline(always)]
    fn brick(&self, way: &mut Way<'_, F>, word: usize, brick: [i32; 3]) -> (&'a Cubes, u64) {
        way.work.bricks += 1;
        let cubes = self.active.cubes(word, bit(brick), brick, self.data, self.dims, self.bounds);
        (cubes, cubes.mask())
    }

    #[inline(always)]
    fn cell(&self, way: &mut Way<'_, F>, &(cubes, mask): &(&'a Cubes, u64), cube: [i32; 3], from: f64, to: f64) -> bool {
        way.work.cubes += 1;
        let b = bit(cube);
        if mask >> b & 1 == 0 {
            return true;
        }
        let kinds = cubes.known(b).unwrap_or_else(|| {
            let kinds = self.kinds(cube);
            cubes.keep(b, kinds);
            kinds
        });
        if kinds == 0 {
            return true;
        }
        let set = cubes.set(b, || {
            let data = self.gather(cube);
            DeterminingSet::new(&std::array::from_fn(|n| data[n]))
        });
        self.cube(way, cube, kinds, set, [from, to])
    }
}

impl<T: Datum> Search<'_, T> {
    /// Calls `push` with the roots in order until it returns false. Returns whether all of the ray that was walked is certain.
    #[inline(always)]
    pub(crate) fn roots(&self, walk: Walk, scratch: &mut Scratch, work: &mut Work, push: impl FnMut(&Root) -> bool) -> bool {
        scratch.chains.fill(Chain::new());
        let mut way = Way {
            walk,
            scratch,
            work,
            end: f64::NEG_INFINITY,
            jet: (f64::NEG_INFINITY, [0.0; 2]),
            push,
        };
        let cubes = three(|a| self.dims[a] as i32);
        if walk.line.cross(&self.active.nodes, cubes, self, &mut way) {
            self.skip(&mut way);
        }
        way.scratch.chains.iter().all(|c| c.certain && c.is_settled())
    }

    /// The 27 data of a cube minus the first isovalue.
    #[inline(always)]
    pub(crate) fn gather(&self, cube: [i32; 3]) -> Data {
        let reference = self.bounds[0].isovalue;
        let c = cube.map(|i| i as usize);
        let (nx, ny, nz) = (self.dims[0], self.dims[1], self.dims[2]);
        let mut out = [0.0; 32];
        let beside = |i: usize, n: usize| [i.saturating_sub(1), i, (i + 1).min(n - 1)];
        let (ys, zs) = (beside(c[1], ny), beside(c[2], nz));
        let inside = c[0] > 0 && c[0] + 1 < nx;
        for (k, z) in zs.into_iter().enumerate() {
            for (j, y) in ys.into_iter().enumerate() {
                let row = (z * ny + y) * nx;
                let o = (k * 3 + j) * 3;
                if inside {
                    let s = &self.data[row + c[0] - 1..row + c[0] + 2];
                    for i in 0..3 {
                        out[o + i] = s[i].into() - reference;
                    }
                } else {
                    let xs = beside(c[0], nx);
                    for i in 0..3 {
                        out[o + i] = self.data[row + xs[i]].into() - reference;
                    }
                }
            }
        }
        out
    }

    /// The kinds whose coefficients can meet an isovalue.
    #[inline(never)]
    fn kinds(&self, cube: [i32; 3]) -> u32 {
        let data = self.gather(cube);
        let mut mask = 0;
        for kind in 0..24 {
            let (least, greatest) = hull(&cube::patch(&data, kind));
            let c = self.bounds[0].isovalue;
            let on = self.bounds.iter().any(|b| {
                // Coefficients are rounded relative to the first isovalue.
                let (c, m) = (b.isovalue - c, b.margin().max(self.bounds[0].margin()));
                least - c <= m && greatest - c >= -m
            });
            mask |= u32::from(on) << kind;
        }
        mask
    }

    /// The active tetrahedra of a cube in the order of the ray. Returns whether to go on.
    #[inline(always)]
    fn cube<F: FnMut(&Root) -> bool>(
        &self,
        way: &mut Way<'_, F>,
        cube: [i32; 3],
        kinds: u32,
        set: Option<&DeterminingSet<f64>>,
        [t0, t1]: [f64; 2],
    ) -> bool {
        way.work.active += 1;
        let w = way.walk;
        // Sorted parameters of the six planes inside.
        let mut cuts = [t1; 8];
        let mut count = 0;
        for (n, &(a, b, sign)) in FORMS.iter().enumerate() {
            let t = (f64::from(cube[a]) + sign * f64::from(cube[b])) * w.form_inv[n] + w.form_shift[n];
            if t > t0 && t < t1 {
                let mut at = count;
                while at > 0 && cuts[at - 1] > t {
                    cuts[at] = cuts[at - 1];
                    at -= 1;
                }
                cuts[at] = t;
                count += 1;
            }
        }
        cuts[count] = t1;
        let mut data: Option<Data> = None;
        let local = |t: f64| three(|a| (w.line.o[a] - f64::from(cube[a])) + t * w.line.d[a]);
        let (mut from, mut p) = (t0, local(t0));
        for &to in &cuts[..=count] {
            let q = local(to);
            let kind = kind_of(three(|a| 0.5 * (p[a] + q[a])));
            if kinds >> kind & 1 != 0 {
                if way.end != from && !self.skip(way) {
                    return false;
                }
                let b = match set {
                    Some(set) => averaged(set, kind),
                    None => cube::patch(data.get_or_insert_with(|| self.gather(cube)), kind),
                };
                if !self.tetrahedron(way, &b, kind, [from, to], [p, q]) {
                    return false;
                }
                way.end = to;
            }
            (from, p) = (to, q);
        }
        true
    }

    #[inline(always)]
    fn tetrahedron<F: FnMut(&Root) -> bool>(
        &self,
        way: &mut Way<'_, F>,
        b: &[f64; 20],
        kind: usize,
        t: [f64; 2],
        [p, q]: [[f64; 3]; 2],
    ) -> bool {
        way.work.tets += 1;
        // Of kept tetrahedra the hull is known to hold an isovalue: with a single one it decides nothing.
        let known = self.active.keeps() && self.bounds.len() == 1;
        let (least, greatest) = if known { (f64::NEG_INFINITY, f64::INFINITY) } else { hull(b) };
        let mut cubic: Option<[f64; 4]> = None;
        let phi = || [cube::barycentric(kind, p), cube::barycentric(kind, q)];
        let (d, last) = (way.walk.line.d, &mut way.jet);
        let found = &mut way.scratch.found;
        found.clear();
        for (n, (bounds, chain)) in self.bounds.iter().zip(&mut way.scratch.chains).enumerate() {
            let c = bounds.isovalue - self.bounds[0].isovalue;
            // Coefficients are those of the first isovalue, shifted: what rounds them is of its size too.
            let bound = self.margin * bounds.size.max(self.bounds[0].size);
            let mut take = |f: Found| found.push((f, n));
            if least - c > bound {
                chain.pass(1, &mut take);
            } else if greatest - c < -bound {
                chain.pass(-1, &mut take);
            } else {
                let base = *cubic.get_or_insert_with(|| {
                    let step = cube::barycentric_step(kind, d);
                    let third = (t[1] - t[0]) / 3.0;
                    let [v0, s0] = if last.0 == t[0] {
                        last.1
                    } else {
                        cube::jet(b, cube::barycentric(kind, p), step)
                    };
                    let [v1, s1] = cube::jet(b, cube::barycentric(kind, q), step);
                    *last = (t[1], [v1, s1]);
                    [v0, v0 + third * s0, v1 - third * s1, v1]
                });
                way.work.cubics += 1;
                let shifted = [base[0] - c, base[1] - c, base[2] - c, base[3] - c];
                chain.segment(self.finder, shifted, bound, t, &mut take);
            }
        }
        if found.is_empty() {
            return true;
        }
        self.deliver(way, b, kind, t, phi())
    }

    /// Hands over the roots found last, in order. They lie in this tetrahedron, or where the one before ended.
    #[inline(always)]
    fn deliver<F: FnMut(&Root) -> bool>(
        &self,
        way: &mut Way<'_, F>,
        b: &[f64; 20],
        kind: usize,
        [t0, t1]: [f64; 2],
        [from, to]: [[f64; 4]; 2],
    ) -> bool {
        way.scratch.found.sort_by(|x, y| x.0.t.total_cmp(&y.0.t));
        let many = self.bounds.len() > 1;
        for i in 0..way.scratch.found.len() {
            let (mut found, surface) = way.scratch.found[i];
            // Of several isovalues each must be clear of roots up to here.
            found.first &= !many || way.scratch.chains.iter().enumerate().all(|(n, c)| n == surface || c.certain);
            let x = if t1 > t0 {
                ((found.t - t0) / (t1 - t0)).clamp(0.0, 1.0)
            } else {
                0.0
            };
            let phi = std::array::from_fn(|v| (1.0 - x) * from[v] + x * to[v]);
            let root = Root {
                found,
                surface,
                gradient: cube::gradient(b, kind, phi).into(),
            };
            if !(way.push)(&root) {
                return false;
            }
        }
        true
    }

    /// The walk passes over cubes without a surface, or ends: what is open is settled.
    #[inline(always)]
    fn skip<F: FnMut(&Root) -> bool>(&self, way: &mut Way<'_, F>) -> bool {
        if way.scratch.chains.iter().all(Chain::is_settled) {
            return true;
        }
        self.settle_open(way)
    }

    #[cold]
    fn settle_open<F: FnMut(&Root) -> bool>(&self, way: &mut Way<'_, F>) -> bool {
        let found = &mut way.scratch.found;
        found.clear();
        for (n, chain) in way.scratch.chains.iter_mut().enumerate() {
            chain.pass(0, &mut |f| found.push((f, n)));
        }
        // The gradient at the end of the last cube that was looked at.
        let w = way.walk;
        let t = way.scratch.found.iter().fold(f64::INFINITY, |t, f| t.min(f.0.t));
        let p = three(|a| w.line.at(a, t));
        let cube = three(|a| (p[a].round() as i32).clamp(0, self.dims[a] as i32 - 1));
        let p = three(|a| p[a] - f64::from(cube[a]));
        let kind = kind_of(p);
        let b = cube::patch(&self.gather(cube), kind);
        let phi = cube::barycentric(kind, p);
        self.deliver(way, &b, kind, [t, t], [phi, phi])
    }
}
