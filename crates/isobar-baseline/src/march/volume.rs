//! The spline at a point: value and gradient from its coefficients in their own type.
//!
//! Positions, weights and sums are f64: the sums over 8 to 64 coefficients fill vector registers whatever the precision, so that f32
//! would save little (README, "what was tried") and would move roots.

use super::pair::{Pair, PairOps};
use isobar_fields::Border;

/// A coefficient as stored.
pub(crate) trait Sample: Copy + Send + Sync + PartialOrd + std::fmt::Debug + 'static {
    /// Its value, exactly.
    fn f64(self) -> f64;
    /// Two of them.
    fn pair<P: PairOps>(v: [Self; 2]) -> P;
}

macro_rules! sample {
    ($($t:ty),*) => {$(
        impl Sample for $t {
            #[inline(always)]
            fn f64(self) -> f64 {
                f64::from(self)
            }
            #[inline(always)]
            fn pair<P: PairOps>(v: [Self; 2]) -> P {
                P::of_i32(v.map(i32::from))
            }
        }
    )*};
}
sample!(u8, i16, u16);

impl Sample for f32 {
    #[inline(always)]
    fn f64(self) -> f64 {
        f64::from(self)
    }
    #[inline(always)]
    fn pair<P: PairOps>(v: [Self; 2]) -> P {
        P::of_f32(v)
    }
}

/// A point: x and y side by side, and z.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Point {
    pub(crate) xy: Pair,
    pub(crate) z: f64,
}

impl Point {
    #[inline(always)]
    pub(crate) fn new(u: [f64; 3]) -> Self {
        Self {
            xy: Pair::new(u[0], u[1]),
            z: u[2],
        }
    }

    #[inline(always)]
    pub(crate) fn get(self) -> [f64; 3] {
        let [x, y] = self.xy.get();
        [x, y, self.z]
    }
}

/// Coefficients of a tensor-product B-spline with `W = degree + 1` taps per axis, x fastest; at least 2 per axis.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Volume<'a, T, const W: usize> {
    data: &'a [T],
    dims: [usize; 3],
    /// `dims - 1`: the upper corner of the domain.
    last: Point,
    /// The greatest f64 that lies in the last piece when cut to an integer.
    below: Point,
    border: Border,
}

/// The taps that a point uses.
struct Taps {
    /// First coefficient of each axis; may lie outside the grid.
    start: [isize; 3],
    /// Position inside the piece, 0 to 1.
    w: Point,
}

impl<'a, T: Sample, const W: usize> Volume<'a, T, W> {
    /// Pieces are cells between samples (W even) or around them (W odd).
    const SHIFT: f64 = if W % 2 == 1 { 0.5 } else { 0.0 };

    /// # Panics
    /// When the counts disagree or an axis has less than 2 coefficients: both are checked by whoever made the spline.
    pub(crate) fn new(data: &'a [T], dims: [usize; 3], border: Border) -> Self {
        assert!(dims.iter().all(|&n| (2..1 << 31).contains(&n)) && data.len() == dims.iter().product());
        let last = dims.map(|n| (n - 1) as f64);
        // W even: cells 0..=n-2; odd: 0..=n-1
        let below = last.map(|l| if W % 2 == 1 { l } else { l.next_down() });
        Self {
            data,
            dims,
            last: Point::new(last),
            below: Point::new(below),
            border,
        }
    }

    /// Upper corner of the domain; the lower one is 0.
    #[inline(always)]
    pub(crate) fn last(&self) -> [f64; 3] {
        self.last.get()
    }

    /// The nearest point of the domain; NaN becomes 0.
    #[inline(always)]
    pub(crate) fn clamp(&self, u: Point) -> Point {
        let z = if u.z > 0.0 { u.z } else { 0.0 };
        Point {
            xy: u.xy.max(Pair::splat(0.0)).min(self.last.xy),
            z: if z < self.last.z { z } else { self.last.z },
        }
    }

    /// `u` lies in the domain.
    #[inline(always)]
    fn taps(&self, u: Point) -> Taps {
        let cut = |z: f64| -> i32 { Pair::splat(z).cut()[0] };
        let (cxy, cz) = if W % 2 == 1 {
            (u.xy.add(Pair::splat(Self::SHIFT)).cut(), cut(u.z + Self::SHIFT))
        } else {
            (
                u.xy.min(self.below.xy).cut(),
                cut(if u.z < self.below.z { u.z } else { self.below.z }),
            )
        };
        let before = (W as isize - 1) / 2;
        let corner = Pair::of_i32(cxy).sub(Pair::splat(Self::SHIFT));
        Taps {
            start: [cxy[0] as isize - before, cxy[1] as isize - before, cz as isize - before],
            w: Point {
                xy: u.xy.sub(corner),
                z: u.z - (f64::from(cz) - Self::SHIFT),
            },
        }
    }

    /// Whether all taps lie inside the grid.
    #[inline(always)]
    fn is_inside(&self, taps: &Taps) -> bool {
        W == 2 || (0..3).all(|a| taps.start[a] >= 0 && taps.start[a] as usize + W <= self.dims[a])
    }

    /// Position of the first coefficient of taps that lie inside the grid.
    #[inline(always)]
    fn base(&self, taps: &Taps) -> usize {
        let [nx, ny, _] = self.dims;
        let [x, y, z] = taps.start;
        (z as usize * ny + y as usize) * nx + x as usize
    }

    /// Calls `f(j, k, row)` with each row of W coefficients along x, in order.
    #[inline(always)]
    fn rows(&self, taps: &Taps, mut f: impl FnMut(usize, usize, [f64; W])) {
        let [nx, ny, _] = self.dims;
        if self.is_inside(taps) {
            let base = self.base(taps);
            for k in 0..W {
                for j in 0..W {
                    f(j, k, self.take::<W>(base + (k * ny + j) * nx).map(Sample::f64));
                }
            }
        } else {
            let at = |a: usize, i: usize| self.border.index(taps.start[a] + i as isize, self.dims[a]);
            let x: [usize; W] = std::array::from_fn(|i| at(0, i));
            for k in 0..W {
                for j in 0..W {
                    let row = (at(2, k) * ny + at(1, j)) * nx;
                    f(j, k, std::array::from_fn(|i| self.data[row + x[i]].f64()));
                }
            }
        }
    }

    /// N coefficients from `at` on.
    #[inline(always)]
    #[expect(unsafe_code, reason = "bounds checks of every row cost a tenth of the frame time (README)")]
    fn take<const N: usize>(&self, at: usize) -> [T; N] {
        debug_assert!(at + N <= self.data.len());
        // SAFETY: callers ask for taps that lie inside the grid along every axis (for W = 2 always: `taps` keeps the cell in 0..=n-2
        // and n >= 2), so that at + N <= nx * ny * nz, which `new` has found to be the length. [T; N] has the alignment of T.
        unsafe { self.data.as_ptr().add(at).cast::<[T; N]>().read() }
    }

    /// s(u) at a point of the domain (index space).
    #[inline(always)]
    pub(crate) fn value(&self, u: Point) -> f64 {
        let taps = self.taps(u);
        if W == 2 {
            return self.trilinear(&taps);
        }
        let [wx, wy] = taps.w.xy.get();
        let (bx, by, bz) = (weights::<W>(wx), weights::<W>(wy), weights::<W>(taps.w.z));
        let mut plane = [0.0; W];
        let mut sum = [0.0; W];
        // Explicit pairs here, row by row or from an array of rows, took 10 to 20 % more time than what the compiler makes of this.
        self.rows(&taps, |j, k, row| {
            for i in 0..W {
                plane[i] = if j == 0 { by[0] * row[i] } else { plane[i] + by[j] * row[i] };
                if j == W - 1 {
                    sum[i] = if k == 0 { bz[0] * plane[i] } else { sum[i] + bz[k] * plane[i] };
                }
            }
        });
        dot(bx, sum)
    }

    /// Interpolation along z, y, x: exact where the ends are equal.
    #[inline(always)]
    fn trilinear(&self, taps: &Taps) -> f64 {
        let [nx, ny, _] = self.dims;
        let (j, k) = (nx, nx * ny);
        let base = self.base(taps);
        let [wx, wy] = taps.w.xy.get();
        let (wy, wz) = (Pair::splat(wy), Pair::splat(taps.w.z));
        let a = T::pair::<Pair>(self.take(base)).lerp(T::pair(self.take(base + k)), wz);
        let b = T::pair::<Pair>(self.take(base + j)).lerp(T::pair(self.take(base + j + k)), wz);
        let [p, q] = a.lerp(b, wy).get();
        p + wx * (q - p)
    }

    /// Gradient of s at a point of the domain, in index space.
    pub(crate) fn gradient(&self, u: Point) -> [f64; 3] {
        let taps = self.taps(u);
        let w = taps.w.get();
        let (b, d) = (w.map(weights::<W>), w.map(slopes::<W>));
        let mut g = [0.0; 3];
        self.rows(&taps, |j, k, row| {
            let along = dot(b[0], row);
            g[0] += b[1][j] * b[2][k] * dot(d[0], row);
            g[1] += d[1][j] * b[2][k] * along;
            g[2] += b[1][j] * d[2][k] * along;
        });
        g
    }
}

#[inline(always)]
fn dot<const W: usize>(a: [f64; W], b: [f64; W]) -> f64 {
    let mut s = a[0] * b[0];
    for i in 1..W {
        s += a[i] * b[i];
    }
    s
}

/// The B-spline basis functions of degree W - 1 on a piece.
#[inline(always)]
fn weights<const W: usize>(w: f64) -> [f64; W] {
    let v = 1.0 - w;
    let mut b = [0.0; W];
    match W {
        2 => b.copy_from_slice(&[v, w]),
        3 => b.copy_from_slice(&[0.5 * v * v, 0.5 + w * v, 0.5 * w * w]),
        _ => {
            let (w2, v2) = (w * w, v * v);
            let sixth = 1.0 / 6.0;
            b.copy_from_slice(&[
                sixth * v2 * v,
                2.0 / 3.0 - 0.5 * w2 * (2.0 - w),
                2.0 / 3.0 - 0.5 * v2 * (1.0 + w),
                sixth * w2 * w,
            ]);
        }
    }
    b
}

/// Their derivatives.
#[inline(always)]
fn slopes<const W: usize>(w: f64) -> [f64; W] {
    let v = 1.0 - w;
    let mut d = [0.0; W];
    match W {
        2 => d.copy_from_slice(&[-1.0, 1.0]),
        3 => d.copy_from_slice(&[-v, v - w, w]),
        _ => d.copy_from_slice(&[-0.5 * v * v, w * (1.5 * w - 2.0), v * (2.0 - 1.5 * v), 0.5 * w * w]),
    }
    d
}

#[cfg(test)]
mod tests {
    use super::*;
    use isobar_core::{DVec3, Function, Grid, Samples, Stage};
    use isobar_fields::{GridSpline, Kind};

    fn compare<T: Sample, const W: usize>(kind: Kind, data: &[T], samples: Samples) {
        let dims = [5, 4, 3];
        let spline = GridSpline::new(&Grid::unit(dims, samples).unwrap(), kind, Stage::Stored).unwrap();
        let v = Volume::<T, W>::new(data, dims, kind.border());
        for n in 0..4000u32 {
            // the last points lie on faces and lattice points
            let r = |a: u32, n_a: usize| {
                let x = f64::from(n.wrapping_mul(2_654_435_761).rotate_left(a * 9) >> 8) / f64::from(1 << 24) * (n_a - 1) as f64;
                if n > 3000 { x.round() } else { x }
            };
            let u = [r(0, 5), r(1, 4), r(2, 3)];
            let x = DVec3::from_array(u);
            let (got, want) = (v.value(Point::new(u)), spline.value(x));
            assert!((got - want).abs() < 1e-11, "{kind} at {u:?}: {got} for {want}");
            let (got, want) = (DVec3::from_array(v.gradient(Point::new(u))), spline.gradient(x));
            if n <= 3000 || W > 2 {
                assert!((got - want).length() < 1e-11, "{kind} at {u:?}: gradient {got} for {want}");
            }
        }
    }

    /// The kernels agree with the reference reconstruction, borders included.
    #[test]
    fn values_and_gradients_are_those_of_the_reconstruction() {
        let data: Vec<i16> = (0..60).map(|i: i32| (i.wrapping_mul(7919) % 199) as i16 - 99).collect();
        let samples = || Samples::I16(data.clone().into());
        compare::<_, 2>(Kind::Trilinear, &data, samples());
        compare::<_, 3>(Kind::Quadratic, &data, samples());
        compare::<_, 4>(Kind::Cubic, &data, samples());
        // the prefiltered coefficients stand for themselves here, so only the mirrored border differs
        for kind in [Kind::QuadraticInterpolating, Kind::CubicInterpolating] {
            let grid = Grid::unit([5, 4, 3], samples()).unwrap();
            let spline = GridSpline::new(&grid, kind, Stage::Stored).unwrap();
            let isobar_fields::Coefficients::F32(c) = spline.coefficients() else {
                panic!("stored coefficients of {kind} are f32")
            };
            if kind == Kind::CubicInterpolating {
                compare::<f32, 4>(kind, c, samples());
            } else {
                compare::<f32, 3>(kind, c, samples());
            }
        }
    }

    #[test]
    fn weights_are_a_partition_of_one_and_slopes_their_derivatives() {
        fn check<const W: usize>() {
            for n in 0..=64 {
                let w = f64::from(n) / 64.0;
                let (b, d) = (weights::<W>(w), slopes::<W>(w));
                assert!((b.iter().sum::<f64>() - 1.0).abs() < 1e-15 && d.iter().sum::<f64>().abs() < 1e-15);
                let (p, m) = (weights::<W>(w + 1e-6), weights::<W>(w - 1e-6));
                for i in 0..W {
                    assert!(((p[i] - m[i]) / 2e-6 - d[i]).abs() < 1e-9, "W {W} tap {i} at {w}");
                }
            }
        }
        check::<2>();
        check::<3>();
        check::<4>();
    }
}
