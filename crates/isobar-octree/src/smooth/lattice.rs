//! Coefficients with their border, and the ray in the shifted index space of their cells.

use super::basis::Spline;
use crate::bricks::{Values, values};
use glam::DVec3;
use isobar_core::{ClipPlane, Domain, Ray};
use isobar_cpu::index::{self, Line};
pub(crate) use isobar_cpu::packet::three;
use isobar_fields::Border;

/// Types coefficients are stored in; all are exact in f32.
pub(crate) trait Coefficient: Copy + PartialOrd + Into<f64> + Send + Sync + 'static {
    fn single(self) -> f32;
}
impl Coefficient for f32 {
    #[inline(always)]
    fn single(self) -> f32 {
        self
    }
}
macro_rules! integer {
    ($($t:ty)*) => {$(
        impl Coefficient for $t {
            #[inline(always)]
            fn single(self) -> f32 {
                f32::from(self)
            }
        }
    )*};
}
integer!(u8 i16 u16);

/// Coefficients, x fastest, with what stands for those outside.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lattice<'a> {
    pub(crate) values: Values<'a>,
    pub(crate) dims: [usize; 3],
    pub(crate) border: Border,
}

/// Where a block of coefficients is stored.
pub(crate) enum Block {
    /// In one piece of rows: index of its first coefficient.
    Inside(usize),
    /// Partly beyond the border.
    Across,
}

/// Index of a coefficient; 64 bits wide, so that volumes of more than 2^32 samples work.
#[inline(always)]
pub(crate) fn flat(dims: [usize; 3], i: [usize; 3]) -> usize {
    (i[2] * dims[1] + i[1]) * dims[0] + i[0]
}

/// Where the block of `n` (at most 8) coefficients per axis is that starts one below `cell`.
#[inline(always)]
pub(crate) fn block(dims: [usize; 3], cell: [i32; 3], n: usize) -> Block {
    let inside = |a: usize| cell[a] >= 1 && cell[a] as usize - 1 + n <= dims[a];
    if inside(0) && inside(1) && inside(2) {
        Block::Inside(flat(dims, three(|a| cell[a] as usize - 1)))
    } else {
        Block::Across
    }
}

/// Indices of the block that starts one below `cell`, per axis.
#[cold]
fn across(dims: [usize; 3], border: Border, cell: [i32; 3]) -> [[usize; 8]; 3] {
    three(|a| std::array::from_fn(|i| border.index(cell[a] as isize - 1 + i as isize, dims[a])))
}

/// Fills `$d[$at]` with `$convert` of the coefficients, x fastest, of the block of `n` (at most 7) per axis that starts one below `cell`; `$at` is the
/// position of the coefficient i of row r (y fastest).
macro_rules! fill {
    ($lattice:expr, $cell:expr, $n:expr, |$r:ident, $i:ident, $v:ident| $d:expr => $convert:expr) => {{
        let Lattice { dims, border, .. } = *$lattice;
        let (cell, n) = ($cell, $n);
        values!($lattice.values, c => match block(dims, cell, n) {
            Block::Inside(at) => {
                let all = &c[at..at + (dims[0] * dims[1] + dims[0] + 1) * (n - 1) + 1];
                for k in 0..n {
                    for j in 0..n {
                        let row = &all[(k * dims[1] + j) * dims[0]..][..n];
                        let $r = k * n + j;
                        for $i in 0..n {
                            let $v = row[$i];
                            $d = $convert;
                        }
                    }
                }
            }
            Block::Across => {
                let index = across(dims, border, cell);
                for k in 0..n {
                    for j in 0..n {
                        let row = &c[(index[2][k] * dims[1] + index[1][j]) * dims[0]..][..dims[0]];
                        let $r = k * n + j;
                        for $i in 0..n {
                            let $v = row[index[0][$i]];
                            $d = $convert;
                        }
                    }
                }
            }
        })
    }};
}

impl Lattice<'_> {
    /// c - isovalue of the stencil of a cell, x fastest.
    #[inline(always)]
    pub(crate) fn doubles<S: Spline>(&self, cell: [i32; 3], isovalue: f64) -> [f64; 64] {
        let n = S::DEGREE + 1;
        let mut d = [0.0; 64];
        fill!(self, cell, n, |r, i, v| d[r * n + i] => f64::from(v) - isovalue);
        d
    }

    /// (c - high) - low of the stencil of a cell in f32, x fastest.
    #[inline(always)]
    pub(crate) fn singles<S: Spline>(&self, cell: [i32; 3], high: f32, low: f32, d: &mut [f32; 64]) {
        let n = S::DEGREE + 1;
        fill!(self, cell, n, |r, i, v| d[r * n + i] => (v.single() - high) - low);
    }

    /// The `n^2` rows (y fastest) of `n` coefficients, at most 7, of the block that starts one below `cell`, relative to the coefficient at the cell; and
    /// that. Entries beyond are zero.
    pub(crate) fn block(&self, cell: [i32; 3], n: usize) -> (f32, [[f32; 16]; 49]) {
        let mut d = [[0.0; 16]; 49];
        let at = flat(self.dims, three(|a| (cell[a] as usize).min(self.dims[a] - 1)));
        let zero = values!(self.values, c => c[at].single());
        fill!(self, cell, n, |r, i, v| d[r][i] => v.single() - zero);
        (zero, d)
    }
}

/// Index space of a spline: a shift of a half where cells are centred on samples, so that cell i spans [i, i + 1].
#[derive(Debug, Clone, Copy)]
pub(crate) struct Space {
    pub(crate) cells: [i32; 3],
    shifted: crate::walk::Space,
    /// For the margin, which is that of the trilinear caster.
    plain: crate::walk::Space,
}

impl Space {
    /// For a grid of `dims` samples, each at least 2 and at most 2^30.
    pub(crate) fn new(domain: Domain, dims: [usize; 3], centred: bool) -> Self {
        let plain = crate::walk::Space::new(domain);
        Self {
            cells: dims.map(|n| n as i32 - i32::from(!centred)),
            shifted: plain.shifted(if centred { 0.5 } else { 0.0 }),
            plain,
        }
    }

    /// That of the trilinear caster, without the shift: cells of degree 3 are its cells.
    #[inline(always)]
    pub(crate) fn of_degree_1(&self) -> &crate::walk::Space {
        &self.plain
    }

    /// 12E of a ray, rounded up (twice the 6E + 64u of `crate::walk`). There E bounds the error of a position in index space, per axis. Positions are
    /// moved by as much again when they are cut to the cell they were attributed to, and s changes by at most 2M per unit of an axis: three
    /// axes, 2E, 2M. The shift by a half rounds once more, within the factor of two that E holds in reserve.
    #[inline(always)]
    pub(crate) fn margin(&self, origin: DVec3) -> f64 {
        2.0 * self.plain.margin(origin)
    }

    /// World gradient from that in index space.
    #[inline(always)]
    pub(crate) fn world_gradient(&self, g: DVec3) -> DVec3 {
        self.plain.world_gradient(g)
    }

    /// The way of a ray through the domain at t >= 0, where the planes keep it. `margin`: that of the ray; 2E and more for the ends of the domain.
    #[inline(always)]
    pub(crate) fn enter(&self, ray: &Ray, clips: &[ClipPlane], margin: f64) -> Entry {
        Path::enter(ray, &self.shifted, clips, Some(margin))
    }
}

/// A ray in the index space of a spline.
pub(crate) type Path = Line;

/// Whether a ray meets the domain.
pub(crate) type Entry = index::Entry<Path>;

/// Position at t in a cell, cut to it.
#[inline(always)]
pub(crate) fn local(path: &Path, cell: [i32; 3], t: f64) -> [f64; 3] {
    three(|a| {
        let x = path.at(a, t) - f64::from(cell[a]);
        let x = if x > 0.0 { x } else { 0.0 };
        if x < 1.0 { x } else { 1.0 }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Indices beyond 2^32 samples, without the memory: a block deep inside, and one across each border.
    #[test]
    fn blocks_of_huge_volumes_are_addressed() {
        let dims = [5000, 6000, 7000];
        let Block::Inside(at) = block(dims, [4001, 5001, 6001], 4) else {
            panic!("inside")
        };
        assert_eq!(at as u64, (6000 * 6000 + 5000) * 5000 + 4000u64);
        assert!(at > u32::MAX as usize);
        assert!(matches!(block(dims, [4998, 0, 6998], 4), Block::Across));
        let i = across(dims, Border::Mirror, [4998, 0, 6998]);
        assert_eq!(
            (i[0][..4].to_vec(), i[1][..4].to_vec()),
            (vec![4997, 4998, 4999, 4998], vec![1, 0, 1, 2])
        );
        assert_eq!(i[2][..4], [6997, 6998, 6999, 6998]);
        assert_eq!(flat(dims, [4999, 5999, 6999]) as u64, 5000 * 6000 * 7000u64 - 1);
    }

    /// The walk's own indices: cells of the largest axis there may be.
    #[test]
    fn paths_cross_the_longest_axis() {
        let n = 1usize << 30;
        let domain = Domain {
            origin: DVec3::ZERO,
            axes: glam::DMat3::IDENTITY,
            lo: DVec3::ZERO,
            hi: DVec3::new((n - 1) as f64, 1.0, 1.0),
        };
        let space = Space::new(domain, [n, 2, 2], true);
        let ray = Ray {
            origin: DVec3::new(-1.0, 0.5, 0.5),
            direction: DVec3::X,
        };
        let Entry::Through(p) = space.enter(&ray, &[], 0.0) else {
            panic!("it goes through")
        };
        assert_eq!((p.t0, p.t1), (1.0, n as f64));
        assert_eq!(p.cell_at(0, p.t1), n as i32 - 1);
        assert_eq!(p.exits([(n as i32 - 1) >> 4, 0, 0], 4)[0], n as f64 + 0.5);
    }
}
