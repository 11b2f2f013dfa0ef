//! Two levels of min/max blocks: where a stretch of a ray can be skipped.

use super::volume::Sample;
use rayon::prelude::*;

/// Blocks of the upper level per axis are this many times longer.
pub(crate) const UP: usize = 4;

/// Least and greatest coefficient over boxes of `side` cells per axis and of `4 side` cells.
///
/// A box covers the closed stretch `[b side, (b + 1) side]` of index space per axis, and its range all coefficients of the stencils
/// of that stretch; s lies between them there, because B-spline bases are non-negative and sum to one.
#[derive(Debug)]
pub(crate) struct Blocks<T> {
    fine: Level<T>,
    coarse: Level<T>,
}

/// One level: `[min, max]` per box, x fastest.
#[derive(Debug)]
pub(crate) struct Level<T> {
    ranges: Vec<[T; 2]>,
    dims: [usize; 3],
    side: usize,
    inverse: f64,
}

impl<T: Sample> Blocks<T> {
    /// Builds both levels of the coefficients `data` (x fastest, at least 2 per axis) for splines of `taps` coefficients per axis. Parallel over
    /// layers of blocks; reads each coefficient little more than once.
    pub(crate) fn new(data: &[T], dims: [usize; 3], taps: usize, side: usize) -> Self {
        let fine = Level::of(data, dims, taps, side);
        let coarse = fine.up();
        Self { fine, coarse }
    }

    /// The smaller boxes.
    #[inline(always)]
    pub(crate) fn fine(&self) -> &Level<T> {
        &self.fine
    }

    /// The larger boxes, of [`UP`] smaller ones per axis.
    #[inline(always)]
    pub(crate) fn coarse(&self) -> &Level<T> {
        &self.coarse
    }

    /// Least and greatest coefficient of all.
    pub(crate) fn range(&self) -> [f64; 2] {
        let all = self
            .coarse
            .ranges
            .iter()
            .skip(1)
            .fold(self.coarse.ranges[0], |a, b| union(a, *b));
        all.map(Sample::f64)
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        (self.fine.ranges.len() + self.coarse.ranges.len()) * size_of::<[T; 2]>()
    }
}

#[inline(always)]
fn union<T: Sample>(a: [T; 2], b: [T; 2]) -> [T; 2] {
    [if b[0] < a[0] { b[0] } else { a[0] }, if b[1] > a[1] { b[1] } else { a[1] }]
}

impl<T: Sample> Level<T> {
    fn of(data: &[T], dims: [usize; 3], taps: usize, side: usize) -> Self {
        let counts = dims.map(|n| (n - 1).div_ceil(side));
        let [bx, by, _] = counts;
        let [nx, ny, _] = dims;
        // Coefficients before and after the samples b side ..= (b + 1) side: of the cells i..i+1, or i-1/2..i+1/2 for 3 taps. What the
        // border rule takes from elsewhere lies inside the cut stretch, with either rule.
        let more = usize::from(taps > 2);
        let stretch = |b: usize, n: usize| (b * side).saturating_sub(more)..=((b + 1) * side + more).min(n - 1);
        let mut ranges = vec![[data[0]; 2]; counts.iter().product()];
        ranges.par_chunks_mut(bx * by).enumerate().for_each(|(k, layer)| {
            let mut row = vec![[data[0]; 2]; bx];
            for z in stretch(k, dims[2]) {
                for y in 0..ny {
                    let line = &data[(z * ny + y) * nx..][..nx];
                    for (i, r) in row.iter_mut().enumerate() {
                        let part = &line[stretch(i, nx)];
                        *r = part.iter().fold([part[0]; 2], |a, &b| union(a, [b, b]));
                    }
                    let first = (y.saturating_sub(side + more)) / side;
                    for j in first..by.min(y / side + 2) {
                        let s = stretch(j, ny);
                        if s.contains(&y) {
                            let start = y == *s.start() && z == *stretch(k, dims[2]).start();
                            for (out, r) in layer[j * bx..][..bx].iter_mut().zip(&row) {
                                *out = if start { *r } else { union(*out, *r) };
                            }
                        }
                    }
                }
            }
        });
        Self {
            ranges,
            dims: counts,
            side,
            inverse: 1.0 / side as f64,
        }
    }

    fn up(&self) -> Self {
        let dims = self.dims.map(|n| n.div_ceil(UP));
        let mut ranges = Vec::with_capacity(dims.iter().product());
        for k in 0..dims[2] {
            for j in 0..dims[1] {
                for i in 0..dims[0] {
                    let part = |b: usize, n: usize| b * UP..((b + 1) * UP).min(n);
                    let mut all = self.ranges[self.at([i * UP, j * UP, k * UP])];
                    for z in part(k, self.dims[2]) {
                        for y in part(j, self.dims[1]) {
                            let row = self.at([0, y, z]);
                            for r in &self.ranges[row..][part(i, self.dims[0])] {
                                all = union(all, *r);
                            }
                        }
                    }
                    ranges.push(all);
                }
            }
        }
        let side = self.side * UP;
        Self {
            ranges,
            dims,
            side,
            inverse: 1.0 / side as f64,
        }
    }

    #[inline(always)]
    pub(crate) fn at(&self, b: [usize; 3]) -> usize {
        (b[2] * self.dims[1] + b[1]) * self.dims[0] + b[0]
    }

    /// Side of a box, cells: a power of two.
    #[inline(always)]
    pub(crate) fn side(&self) -> f64 {
        self.side as f64
    }

    /// Boxes from one along x, y and z to the next.
    #[inline(always)]
    pub(crate) fn strides(&self) -> [isize; 3] {
        [1, self.dims[0] as isize, (self.dims[0] * self.dims[1]) as isize]
    }

    /// The box `[x, y, z]` that holds `u`, a point of the domain.
    #[inline(always)]
    pub(crate) fn find(&self, u: [f64; 3]) -> [usize; 3] {
        // the side is a power of two, so that the product is exact and the box is the right one
        std::array::from_fn(|a| ((u[a] * self.inverse) as u32 as usize).min(self.dims[a] - 1))
    }

    /// The box nearest to `b` among those that make up box `upper` of the level above.
    #[inline(always)]
    pub(crate) fn inside(&self, b: [usize; 3], upper: [usize; 3]) -> [usize; 3] {
        std::array::from_fn(|a| b[a].clamp(upper[a] * UP, (upper[a] * UP + UP - 1).min(self.dims[a] - 1)))
    }

    /// Least and greatest coefficient of box number `i`.
    #[inline(always)]
    pub(crate) fn get(&self, i: usize) -> [T; 2] {
        self.ranges[i]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Brute force: the range of a box is that of all coefficients its stencils use.
    #[test]
    fn ranges_are_those_of_the_stencils() {
        for (dims, taps, side) in [
            ([9, 8, 13], 2, 4),
            ([9, 8, 13], 4, 4),
            ([7, 2, 30], 3, 2),
            ([2, 2, 2], 4, 8),
            ([17, 33, 5], 3, 4),
        ] {
            let n: usize = dims.iter().product();
            let data: Vec<i16> = (0..n).map(|i| ((i * 7919) % 1009) as i16 - 500).collect();
            let blocks = Blocks::new(&data, dims, taps, side);
            for (level, cells) in [(&blocks.fine, side), (&blocks.coarse, side * UP)] {
                let lo = if taps > 2 { 1 } else { 0 };
                let hi = if taps > 2 { 1 } else { 0 };
                for (n, r) in level.ranges.iter().enumerate() {
                    let b = [
                        n % level.dims[0],
                        n / level.dims[0] % level.dims[1],
                        n / level.dims[0] / level.dims[1],
                    ];
                    let part = |a: usize| (b[a] * cells).saturating_sub(lo)..=((b[a] + 1) * cells + hi).min(dims[a] - 1);
                    let mut want: Option<[i16; 2]> = None;
                    for z in part(2) {
                        for y in part(1) {
                            for x in part(0) {
                                let v = data[(z * dims[1] + y) * dims[0] + x];
                                want = Some(want.map_or([v; 2], |w| union(w, [v; 2])));
                            }
                        }
                    }
                    assert_eq!(Some(*r), want, "{dims:?} taps {taps} box {b:?} of {cells}");
                }
            }
            let all = data.iter().fold([data[0]; 2], |a, &b| union(a, [b; 2])).map(f64::from);
            assert_eq!(blocks.range(), all);
        }
    }

    #[test]
    fn the_index_is_small() {
        let data = vec![0u8; 65 * 65 * 65];
        let b = Blocks::new(&data, [65; 3], 2, 4);
        assert!(b.bytes() * 25 < data.len(), "{} bytes", b.bytes());
    }

    #[test]
    fn points_are_found_in_their_boxes() {
        let b = Blocks::new(&vec![0u8; 34 * 33 * 9], [34, 33, 9], 2, 4);
        assert_eq!(b.fine().find([3.999, 4.0, 8.0]), [0, 1, 1]);
        assert_eq!(b.coarse().find([33.0, 32.0, 8.0]), [2, 1, 0]);
        assert_eq!(b.fine().inside([9, 0, 5], [1, 1, 0]), [7, 4, 1]);
        assert_eq!(
            b.fine().at([1, 2, 1]) as isize,
            [1, 2, 1].iter().zip(b.fine().strides()).map(|(i, s)| i * s).sum()
        );
    }
}
