//! The 24 classifications of the tetrahedra of many cubes: 64 cubes side by side.

use isobar_cpu::{Kernel, Level};
use isobar_fields::type6::{coefficients_192, frame};

/// Kinds of tetrahedra.
pub(super) const KINDS: usize = 24;
/// Cubes side by side: their data take half of a first-level cache.
const SIDE_BY_SIDE: usize = 64;

/// Data a spline may have.
pub(super) trait Value: Copy + Into<f64> + Send + Sync {}
impl<T: Copy + Into<f64> + Send + Sync> Value for T {}

/// Where the data in canonical order lie among the 27 of a cube, per kind.
static ORDER: [[u8; 27]; KINDS] = {
    let mut all = [[0; 27]; KINDS];
    let mut kind = 0;
    while kind < KINDS {
        let ([a, b, c], [sa, sb]) = frame(kind);
        let stride = [1, 3, 9];
        let mut n = 0;
        while n < 27 {
            let (x, y, z) = (n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1);
            all[kind][n as usize] = (13 + sa as i32 * x * stride[a] + sb as i32 * y * stride[b] + z * stride[c]) as u8;
            n += 1;
        }
        kind += 1;
    }
    all
};

/// One datum of each cube.
type Row = [f64; SIDE_BY_SIDE];

/// The bits of active kinds of each cube.
pub(super) fn classify<T: Value>(level: Level, data: &[T], dims: [usize; 3], isovalue: f64, cubes: &[u32], masks: &mut [u32]) {
    let mut rows = [[0.0; SIDE_BY_SIDE]; 27];
    let mut out = [0u64; SIDE_BY_SIDE];
    for (cubes, masks) in cubes.chunks(SIDE_BY_SIDE).zip(masks.chunks_mut(SIDE_BY_SIDE)) {
        gather(data, dims, isovalue, cubes, &mut rows);
        level.run(Hulls {
            rows: &rows,
            out: &mut out,
        });
        masks.iter_mut().zip(&out).for_each(|(m, o)| *m = *o as u32);
    }
}

/// The 27 data of each cube less the isovalue, x fastest.
pub(super) fn gather<T: Value, const N: usize>(
    data: &[T],
    dims: [usize; 3],
    isovalue: f64,
    cubes: &[u32],
    rows: &mut [[f64; N]; 27],
) {
    for (l, &cube) in cubes.iter().enumerate() {
        let [x, y, z] = super::coordinates(cube, dims);
        let beside = |i: usize, n: usize| [i.saturating_sub(1), i, (i + 1).min(n - 1)];
        let (ys, zs) = (beside(y, dims[1]), beside(z, dims[2]));
        let xs = beside(x, dims[0]);
        for (k, z) in zs.into_iter().enumerate() {
            for (j, y) in ys.into_iter().enumerate() {
                let row = &data[(z * dims[1] + y) * dims[0]..][..dims[0]];
                let at = 3 * (3 * k + j);
                for i in 0..3 {
                    rows[at + i][l] = row[xs[i]].into() - isovalue;
                }
            }
        }
    }
}

/// Whether zero lies in the hull of the 20 coefficients of each kind.
struct Hulls<'a> {
    rows: &'a [Row; 27],
    out: &'a mut [u64; SIDE_BY_SIDE],
}

impl Kernel for Hulls<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let mut masks = [0u64; SIDE_BY_SIDE];
        for (kind, order) in ORDER.iter().enumerate() {
            let mut rows = [&self.rows[0]; 27];
            for n in 0..27 {
                rows[n] = &self.rows[usize::from(order[n]) % 27];
            }
            let bit = 1u64 << kind;
            // A plain loop over cubes, which the compiler makes one over vectors of them.
            for l in 0..SIDE_BY_SIDE {
                let mut d = [0.0; 27];
                for n in 0..27 {
                    d[n] = rows[n][l];
                }
                let b = coefficients_192(&d);
                let (mut least, mut greatest) = (b[0], b[0]);
                for v in b {
                    least = if v < least { v } else { least };
                    greatest = if v > greatest { v } else { greatest };
                }
                masks[l] |= if least <= 0.0 && greatest >= 0.0 { bit } else { 0 };
            }
        }
        *self.out = masks;
    }
}
