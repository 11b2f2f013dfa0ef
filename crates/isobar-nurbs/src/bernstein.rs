//! Coefficients of one element or a part of it: halving, ranges of values and of partial derivatives, point values.
//!
//! Control points are kept as `[x, y, z, w]`, four lanes that are worked on together; the attribute beside them, in its own degree. All functions are inlined into
//! the kernel of a tile and so compiled for its instruction set. Rounding: a halving takes the mean of neighbours `degree` times, each
//! with one rounding, so it adds at most `degree * 2^-53` of the greatest coefficient; point values are discussed at [`value_roundings`].

/// Greatest degree plus one.
pub(crate) const MOST: usize = 21;

/// One coefficient: a lane group that can be averaged.
pub(crate) trait Lanes: Copy {
    /// `0.5 * (a + b)`.
    fn mean(self, o: Self) -> Self;
    /// `self + k * o`.
    fn plus(self, k: f64, o: Self) -> Self;
    /// `self - o`.
    fn minus(self, o: Self) -> Self;
    fn least(self, o: Self) -> Self;
    fn most(self, o: Self) -> Self;
    const ZERO: Self;
}

impl Lanes for f64 {
    const ZERO: Self = 0.0;
    #[inline(always)]
    fn mean(self, o: Self) -> Self {
        0.5 * (self + o)
    }
    #[inline(always)]
    fn plus(self, k: f64, o: Self) -> Self {
        self + k * o
    }
    #[inline(always)]
    fn minus(self, o: Self) -> Self {
        self - o
    }
    #[inline(always)]
    fn least(self, o: Self) -> Self {
        if o < self { o } else { self }
    }
    #[inline(always)]
    fn most(self, o: Self) -> Self {
        if o > self { o } else { self }
    }
}

/// `[x, y, z, w]` of a control point times its weight.
pub(crate) type Point = [f64; 4];

impl Lanes for Point {
    const ZERO: Self = [0.0; 4];
    #[inline(always)]
    fn mean(self, o: Self) -> Self {
        std::array::from_fn(|i| 0.5 * (self[i] + o[i]))
    }
    #[inline(always)]
    fn plus(self, k: f64, o: Self) -> Self {
        std::array::from_fn(|i| self[i] + k * o[i])
    }
    #[inline(always)]
    fn minus(self, o: Self) -> Self {
        std::array::from_fn(|i| self[i] - o[i])
    }
    #[inline(always)]
    fn least(self, o: Self) -> Self {
        std::array::from_fn(|i| if o[i] < self[i] { o[i] } else { self[i] })
    }
    #[inline(always)]
    fn most(self, o: Self) -> Self {
        std::array::from_fn(|i| if o[i] > self[i] { o[i] } else { self[i] })
    }
}

/// Number of coefficients of a degree.
pub(crate) const fn count(d: [usize; 3]) -> usize {
    (d[0] + 1) * (d[1] + 1) * (d[2] + 1)
}

/// Distance in memory between neighbours along an axis, and the number of lines' starts above it.
#[inline(always)]
fn strides(d: [usize; 3], axis: usize) -> (usize, usize) {
    match axis {
        0 => (1, (d[1] + 1) * (d[2] + 1)),
        1 => (d[0] + 1, d[2] + 1),
        _ => ((d[0] + 1) * (d[1] + 1), 1),
    }
}

/// Halves along `axis` (de Casteljau at 1/2): `c` becomes the upper half, `lower` the lower one. Degrees that the compiler knows make constant loops.
#[inline(always)]
pub(crate) fn halve<T: Lanes>(d: [usize; 3], axis: usize, c: &mut [T], lower: &mut [T]) {
    match (d, axis) {
        ([3, 3, 3], 0) => halve_in([3; 3], 0, &mut c[..64], &mut lower[..64]),
        ([3, 3, 3], 1) => halve_in([3; 3], 1, &mut c[..64], &mut lower[..64]),
        ([3, 3, 3], 2) => halve_in([3; 3], 2, &mut c[..64], &mut lower[..64]),
        _ => halve_in(d, axis, c, lower),
    }
}

#[inline(always)]
fn halve_in<T: Lanes>(d: [usize; 3], axis: usize, c: &mut [T], lower: &mut [T]) {
    let n = d[axis];
    let (stride, outer) = strides(d, axis);
    let block = stride * (n + 1);
    for o in 0..outer {
        let c = &mut c[o * block..(o + 1) * block];
        let lower = &mut lower[o * block..(o + 1) * block];
        for level in 0..=n {
            lower[level * stride..(level + 1) * stride].copy_from_slice(&c[..stride]);
            for i in 0..(n - level) * stride {
                c[i] = c[i].mean(c[i + stride]);
            }
        }
    }
}

/// As [`halve`], at `t`: three roundings where that has one.
#[inline(always)]
pub(crate) fn cut<T: Lanes>(d: [usize; 3], axis: usize, t: f64, c: &mut [T], lower: &mut [T]) {
    let n = d[axis];
    let (stride, outer) = strides(d, axis);
    let block = stride * (n + 1);
    for o in 0..outer {
        let c = &mut c[o * block..(o + 1) * block];
        let lower = &mut lower[o * block..(o + 1) * block];
        for level in 0..=n {
            lower[level * stride..(level + 1) * stride].copy_from_slice(&c[..stride]);
            for i in 0..(n - level) * stride {
                c[i] = c[i].plus(t, c[i + stride].minus(c[i]));
            }
        }
    }
}

/// Minima and maxima kept side by side in one pass, so that none waits for the one before.
const WAYS: usize = 4;

/// Least and greatest of what was seen, in [`WAYS`] parts.
struct Extremes<T>([T; WAYS], [T; WAYS]);

impl<T: Lanes> Extremes<T> {
    #[inline(always)]
    fn new(first: T) -> Self {
        Self([first; WAYS], [first; WAYS])
    }

    #[inline(always)]
    fn see(&mut self, way: usize, v: T) {
        self.0[way] = self.0[way].least(v);
        self.1[way] = self.1[way].most(v);
    }

    #[inline(always)]
    fn get(&self) -> (T, T) {
        let (lo, hi) = (&self.0, &self.1);
        (
            lo[0].least(lo[1]).least(lo[2].least(lo[3])),
            hi[0].most(hi[1]).most(hi[2].most(hi[3])),
        )
    }
}

/// Least and greatest coefficient, of each lane.
#[inline(always)]
pub(crate) fn range<T: Lanes>(c: &[T]) -> (T, T) {
    range_of(c, |v| v)
}

/// As [`range`], of what `map` makes of the coefficients.
#[inline(always)]
pub(crate) fn range_of<T: Lanes>(c: &[T], map: impl Fn(T) -> T) -> (T, T) {
    let mut r = Extremes::new(map(c[0]));
    let mut groups = c.chunks_exact(WAYS);
    for group in &mut groups {
        for (i, &v) in group.iter().enumerate() {
            r.see(i, map(v));
        }
    }
    for &v in groups.remainder() {
        r.see(0, map(v));
    }
    r.get()
}

/// Least and greatest coefficient of the partial derivative along `axis`, but for the factor `degree`; zeros where the degree is 0.
#[inline(always)]
pub(crate) fn slopes<T: Lanes>(d: [usize; 3], axis: usize, c: &[T]) -> (T, T) {
    match d {
        [1, 1, 1] => slopes_in([1; 3], axis, &c[..8]),
        [2, 2, 2] => slopes_in([2; 3], axis, &c[..27]),
        [3, 3, 3] => slopes_in([3; 3], axis, &c[..64]),
        _ => slopes_in(d, axis, c),
    }
}

#[inline(always)]
fn slopes_in<T: Lanes>(d: [usize; 3], axis: usize, c: &[T]) -> (T, T) {
    let n = d[axis];
    if n == 0 {
        return (T::ZERO, T::ZERO);
    }
    let (stride, outer) = strides(d, axis);
    let block = stride * (n + 1);
    let mut r = Extremes::new(c[stride].minus(c[0]));
    if axis == 0 {
        // Four lines at a time.
        let mut groups = c.chunks_exact(WAYS * block);
        for group in &mut groups {
            for i in 0..n {
                for way in 0..WAYS {
                    let at = way * block + i;
                    r.see(way, group[at + 1].minus(group[at]));
                }
            }
        }
        for line in groups.remainder().chunks_exact(block) {
            for i in 0..n {
                r.see(0, line[i + 1].minus(line[i]));
            }
        }
        return r.get();
    }
    for o in 0..outer {
        let c = &c[o * block..(o + 1) * block];
        let mut low = c[..n * stride].chunks_exact(WAYS);
        let mut high = c[stride..].chunks_exact(WAYS);
        for (a, b) in (&mut low).zip(&mut high) {
            for way in 0..WAYS {
                r.see(way, b[way].minus(a[way]));
            }
        }
        for (&a, &b) in low.remainder().iter().zip(high.remainder()) {
            r.see(0, b.minus(a));
        }
    }
    r.get()
}

/// Bernstein polynomials of one axis and their derivatives at a point.
#[derive(Clone, Copy)]
pub(crate) struct Basis {
    b: [f64; MOST],
    db: [f64; MOST],
}

impl Basis {
    #[inline(always)]
    pub(crate) fn new(d: usize, x: f64) -> Self {
        let mut s = Self {
            b: [0.0; MOST],
            db: [0.0; MOST],
        };
        let y = 1.0 - x;
        // Up to degree 3 written out, with fewer roundings than the recurrence.
        match d {
            1 => {
                [s.b[0], s.b[1]] = [y, x];
                [s.db[0], s.db[1]] = [-1.0, 1.0];
            }
            2 => {
                [s.b[0], s.b[1], s.b[2]] = [y * y, 2.0 * (x * y), x * x];
                [s.db[0], s.db[1], s.db[2]] = [-2.0 * y, 2.0 * (y - x), 2.0 * x];
            }
            3 => {
                let (xx, xy, yy) = (x * x, 2.0 * (x * y), y * y);
                [s.b[0], s.b[1], s.b[2], s.b[3]] = [yy * y, 3.0 * (x * yy), 3.0 * (xx * y), xx * x];
                [s.db[0], s.db[1], s.db[2], s.db[3]] = [-3.0 * yy, 3.0 * (yy - xy), 3.0 * (xy - xx), 3.0 * xx];
            }
            _ => s.fill(d, x, y),
        }
        s
    }

    /// Any degree, by the recurrence.
    #[inline(always)]
    fn fill(&mut self, d: usize, x: f64, y: f64) {
        self.b[0] = 1.0;
        for n in 1..=d {
            if n == d {
                let d = d as f64;
                self.db[0] = -d * self.b[0];
                for i in 1..n {
                    self.db[i] = d * (self.b[i - 1] - self.b[i]);
                }
                self.db[n] = d * self.b[n - 1];
            }
            self.b[n] = x * self.b[n - 1];
            for i in (1..n).rev() {
                self.b[i] = x * self.b[i - 1] + y * self.b[i];
            }
            self.b[0] *= y;
        }
    }
}

/// The three bases of a point.
#[inline(always)]
pub(crate) fn bases(d: [usize; 3], u: [f64; 3]) -> [Basis; 3] {
    [Basis::new(d[0], u[0]), Basis::new(d[1], u[1]), Basis::new(d[2], u[2])]
}

/// Value and the three partial derivatives.
#[inline(always)]
pub(crate) fn jet<T: Lanes>(d: [usize; 3], c: &[T], at: &[Basis; 3]) -> [T; 4] {
    match d {
        [1, 1, 1] => jet_of::<2, T>(c, at),
        [2, 2, 2] => jet_of::<3, T>(c, at),
        [3, 3, 3] => jet_of::<4, T>(c, at),
        _ => jet_any(d, c, at),
    }
}

/// As [`jet`], with N coefficients along each axis.
#[inline(always)]
fn jet_of<const N: usize, T: Lanes>(c: &[T], at: &[Basis; 3]) -> [T; 4] {
    let first = |b: &[f64; MOST]| -> [f64; N] { std::array::from_fn(|i| b[i]) };
    let (bu, du) = (first(&at[0].b), first(&at[0].db));
    let (bv, dv) = (first(&at[1].b), first(&at[1].db));
    let (bw, dw) = (first(&at[2].b), first(&at[2].db));
    let mut out = [T::ZERO; 4];
    for (k, plane) in c[..N * N * N].chunks_exact(N * N).enumerate() {
        let (mut s, mut su, mut sv) = (T::ZERO, T::ZERO, T::ZERO);
        for (j, line) in plane.chunks_exact(N).enumerate() {
            let (mut v, mut g) = (T::ZERO, T::ZERO);
            for i in 0..N {
                v = v.plus(bu[i], line[i]);
                g = g.plus(du[i], line[i]);
            }
            s = s.plus(bv[j], v);
            su = su.plus(bv[j], g);
            sv = sv.plus(dv[j], v);
        }
        out[0] = out[0].plus(bw[k], s);
        out[1] = out[1].plus(bw[k], su);
        out[2] = out[2].plus(bw[k], sv);
        out[3] = out[3].plus(dw[k], s);
    }
    out
}

#[inline(always)]
fn jet_any<T: Lanes>(d: [usize; 3], c: &[T], at: &[Basis; 3]) -> [T; 4] {
    let [bu, bv, bw] = at;
    let mut out = [T::ZERO; 4];
    let mut row = 0;
    for k in 0..=d[2] {
        let (mut s, mut su, mut sv) = (T::ZERO, T::ZERO, T::ZERO);
        for j in 0..=d[1] {
            let line = &c[row..=row + d[0]];
            let (mut v, mut g) = (T::ZERO, T::ZERO);
            for (i, &p) in line.iter().enumerate() {
                v = v.plus(bu.b[i], p);
                g = g.plus(bu.db[i], p);
            }
            s = s.plus(bv.b[j], v);
            su = su.plus(bv.b[j], g);
            sv = sv.plus(bv.db[j], v);
            row += d[0] + 1;
        }
        out[0] = out[0].plus(bw.b[k], s);
        out[1] = out[1].plus(bw.b[k], su);
        out[2] = out[2].plus(bw.b[k], sv);
        out[3] = out[3].plus(bw.db[k], s);
    }
    out
}

/// Value alone.
#[inline(always)]
pub(crate) fn value<T: Lanes>(d: [usize; 3], c: &[T], at: &[Basis; 3]) -> T {
    let [bu, bv, bw] = at;
    let mut out = T::ZERO;
    let mut row = 0;
    for k in 0..=d[2] {
        let mut s = T::ZERO;
        for j in 0..=d[1] {
            let mut v = T::ZERO;
            for (i, &p) in c[row..=row + d[0]].iter().enumerate() {
                v = v.plus(bu.b[i], p);
            }
            s = s.plus(bv.b[j], v);
            row += d[0] + 1;
        }
        out = out.plus(bw.b[k], s);
    }
    out
}

/// Value in the middle.
#[inline(always)]
pub(crate) fn middle<T: Lanes>(d: [usize; 3], c: &[T]) -> T {
    match d {
        [1, 1, 1] => middle_of(c, [0.5; 2]),
        [2, 2, 2] => middle_of(c, [0.25, 0.5, 0.25]),
        [3, 3, 3] => middle_of(c, [0.125, 0.375, 0.375, 0.125]),
        _ => value(d, c, &bases(d, [0.5; 3])),
    }
}

#[inline(always)]
fn middle_of<const N: usize, T: Lanes>(c: &[T], b: [f64; N]) -> T {
    let mut out = T::ZERO;
    for (k, plane) in c[..N * N * N].chunks_exact(N * N).enumerate() {
        let mut s = T::ZERO;
        for (j, line) in plane.chunks_exact(N).enumerate() {
            let mut v = T::ZERO;
            for i in 0..N {
                v = v.plus(b[i], line[i]);
            }
            s = s.plus(b[j], v);
        }
        out = out.plus(b[k], s);
    }
    out
}

/// Roundings, in units of 2^-53 of the greatest coefficient, that [`value`] may make: a basis polynomial of degree d has a relative error of at
/// most 3 d, a sum of d + 1 products d + 2 more; over three axes, with the sum of the basis at most 1.03 on the widened unit cube.
pub(crate) fn value_roundings(d: [usize; 3]) -> f64 {
    (4 * (d[0] + d[1] + d[2]) + 12) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_and_jets_agree() {
        let d = [3, 1, 2];
        let mut c: Vec<f64> = (0..count(d)).map(|i| (i * i * 7 % 23) as f64 - 9.0).collect();
        let whole = c.clone();
        for axis in 0..3 {
            c.copy_from_slice(&whole);
            let mut lower = c.clone();
            halve(d, axis, &mut c, &mut lower);
            for n in 0..27 {
                let u = [n % 3, n / 3 % 3, n / 9].map(|i| 0.1 + 0.35 * i as f64);
                for (half, part) in [(0.0, &lower), (0.5, &c)] {
                    let mut at = u;
                    at[axis] = half + 0.5 * u[axis];
                    let (a, b) = (jet(d, part, &bases(d, u)), jet(d, &whole, &bases(d, at)));
                    let centre = value(d, part, &bases(d, [0.5; 3]));
                    assert!((middle(d, part) - centre).abs() < 1e-14);
                    assert!((a[0] - b[0]).abs() < 1e-13 && (value(d, part, &bases(d, u)) - a[0]).abs() < 1e-14);
                    for k in 0..3 {
                        let scale = if k == axis { 0.5 } else { 1.0 };
                        assert!((a[1 + k] - scale * b[1 + k]).abs() < 1e-12, "axis {axis} {k}");
                        let (lo, hi) = slopes(d, k, part);
                        assert!(lo * d[k] as f64 <= a[1 + k] + 1e-12 && a[1 + k] <= hi * d[k] as f64 + 1e-12);
                    }
                    let (lo, hi) = range(part);
                    assert!(lo <= a[0] + 1e-13 && a[0] <= hi + 1e-13);
                }
            }
        }
        assert_eq!(slopes([0, 1, 0], 0, &[1.0, 2.0]), (0.0, 0.0));
        assert_eq!(jet([0, 0, 0], &[3.0], &bases([0; 3], [0.5; 3])), [3.0, 0.0, 0.0, 0.0]);
    }
}
