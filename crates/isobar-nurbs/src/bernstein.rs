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

/// Halves along `axis` (de Casteljau at 1/2): `c` becomes the upper half, `lower` the lower one.
#[inline(always)]
pub(crate) fn halve<T: Lanes>(d: [usize; 3], axis: usize, c: &mut [T], lower: &mut [T]) {
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

/// Least and greatest coefficient.
#[inline(always)]
pub(crate) fn range<T: Lanes>(c: &[T]) -> (T, T) {
    let mut r = (c[0], c[0]);
    for &v in &c[1..] {
        r = (r.0.least(v), r.1.most(v));
    }
    r
}

/// Least and greatest coefficient of the partial derivative along `axis`, but for the factor `degree`; zeros where the degree is 0.
#[inline(always)]
pub(crate) fn slopes<T: Lanes>(d: [usize; 3], axis: usize, c: &[T]) -> (T, T) {
    let n = d[axis];
    if n == 0 {
        return (T::ZERO, T::ZERO);
    }
    let (stride, outer) = strides(d, axis);
    let block = stride * (n + 1);
    let first = c[stride].minus(c[0]);
    let mut r = (first, first);
    for o in 0..outer {
        let c = &c[o * block..(o + 1) * block];
        for i in 0..n * stride {
            let v = c[i + stride].minus(c[i]);
            r = (r.0.least(v), r.1.most(v));
        }
    }
    r
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
        s.b[0] = 1.0;
        for n in 1..=d {
            if n == d {
                let d = d as f64;
                s.db[0] = -d * s.b[0];
                for i in 1..n {
                    s.db[i] = d * (s.b[i - 1] - s.b[i]);
                }
                s.db[n] = d * s.b[n - 1];
            }
            s.b[n] = x * s.b[n - 1];
            for i in (1..n).rev() {
                s.b[i] = x * s.b[i - 1] + y * s.b[i];
            }
            s.b[0] *= y;
        }
        s
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
