//! Compositions in power form: naive, PF (Listing A.1), and along a coordinate axis.

use super::{Scalar, at, check};

/// Coefficients of `(p + t v)^i`, `i <= D`: row i has i + 1 of them.
#[inline(always)]
fn powers<T: Scalar, const D: usize>([p, v]: [T; 2]) -> [[T; 4]; 4] {
    let mut x = [[T::ZERO; 4]; 4];
    x[0][0] = T::ONE;
    if D >= 1 {
        x[1] = [p, v, T::ZERO, T::ZERO];
    }
    if D >= 2 {
        let pv = p * v;
        x[2] = [p * p, pv + pv, v * v, T::ZERO];
        if D >= 3 {
            let (ppv, pvv) = (p * pv, pv * v);
            x[3] = [x[2][0] * p, ppv + ppv + ppv, pvv + pvv + pvv, x[2][2] * v];
        }
    }
    x
}

/// a b, without a multiplication where one of them is the constant 1 of a power 0.
#[inline(always)]
fn times<T: Scalar>(a: T, a_is_one: bool, b: T, b_is_one: bool) -> T {
    match (a_is_one, b_is_one) {
        (true, _) => b,
        (_, true) => a,
        _ => a * b,
    }
}

/// Every `f_ijk (p_x + t v_x)^i (p_y + t v_y)^j (p_z + t v_z)^k` multiplied out, all terms added (thesis, section 3.2.3, beginning).
///
/// The products of the ray's components that the terms have in common are calculated before, as the thesis says. With D = 3 that
/// leaves (1 + 2 + 3 + 4)^3 terms. The additions agree with the thesis's count but for the binomial coefficients, the multiplications do not: it does not say which
/// products its compiler shared.
///
/// # Panics
/// As [`super::compose`].
#[inline(always)]
pub fn naive<T: Scalar, const D: usize>(f: &[T], r: &[[T; 2]; 3], out: &mut [T]) {
    check::<D>(f.len(), out.len());
    let (x, y, z) = (powers::<T, D>(r[0]), powers::<T, D>(r[1]), powers::<T, D>(r[2]));
    let mut begun = [false; 10];
    let mut sum = [T::ZERO; 10];
    for i in 0..=D {
        for j in 0..=D {
            for (l, x) in x[i].iter().enumerate().take(i + 1) {
                for (m, y) in y[j].iter().enumerate().take(j + 1) {
                    let xy = times(*x, i == 0, *y, j == 0);
                    for k in 0..=D {
                        let c = f[at::<D>(i, j, k)];
                        for (n, z) in z[k].iter().enumerate().take(k + 1) {
                            let xyz = times(xy, i + j == 0, *z, k == 0);
                            let term = times(c, false, xyz, i + j + k == 0);
                            let to = l + m + n;
                            sum[to] = if begun[to] { sum[to] + term } else { term };
                            begun[to] = true;
                        }
                    }
                }
            }
        }
    }
    out.copy_from_slice(&sum[..=3 * D]);
}

/// One step of Horner's scheme: `a * b + c`. Sizes are constants and every loop is unrolled, so that all stays in registers, as in the thesis's chapter
/// 5. (Loops over arrays that hold the greatest size were 2 to 3 times slower.)
#[inline(always)]
fn step<T: Scalar, const N: usize, const C: usize, const M: usize>(a: [T; N], b: [T; 2], c: [T; C]) -> [T; M] {
    const { assert!(M == N + 1 && C <= M && N > 0) };
    let mut out = [T::ZERO; M];
    out[0] = b[0] * a[0];
    for i in 1..N {
        out[i] = b[0] * a[i] + a[i - 1] * b[1];
    }
    out[N] = a[N - 1] * b[1];
    for i in 0..C {
        out[i] = out[i] + c[i];
    }
    out
}

/// The innermost sums `f_ij`. (A trait and not closures: only functions can be inlined always, which register types need.)
trait Lines<T, const N: usize> {
    fn at(&self, i: usize, j: usize) -> [T; N];
}

/// Horner's scheme over the coefficients of a row.
struct Composed<'a, T> {
    f: &'a [T],
    rz: [T; 2],
}

impl<T: Scalar> Lines<T, 2> for Composed<'_, T> {
    #[inline(always)]
    fn at(&self, i: usize, j: usize) -> [T; 2] {
        let c = &self.f[at::<1>(i, j, 0)..];
        step([c[1]], self.rz, [c[0]])
    }
}

impl<T: Scalar> Lines<T, 3> for Composed<'_, T> {
    #[inline(always)]
    fn at(&self, i: usize, j: usize) -> [T; 3] {
        let c = &self.f[at::<2>(i, j, 0)..];
        let a: [T; 2] = step([c[2]], self.rz, [c[1]]);
        step(a, self.rz, [c[0]])
    }
}

impl<T: Scalar> Lines<T, 4> for Composed<'_, T> {
    #[inline(always)]
    fn at(&self, i: usize, j: usize) -> [T; 4] {
        let c = &self.f[at::<3>(i, j, 0)..];
        let a: [T; 2] = step([c[3]], self.rz, [c[2]]);
        let a: [T; 3] = step(a, self.rz, [c[1]]);
        step(a, self.rz, [c[0]])
    }
}

/// The coefficients of a row themselves: z is the parameter.
struct Rows<'a, T>(&'a [T]);

impl<T: Scalar, const N: usize> Lines<T, N> for Rows<'_, T> {
    #[inline(always)]
    fn at(&self, i: usize, j: usize) -> [T; N] {
        let mut row = [T::ZERO; N];
        row.copy_from_slice(&self.0[(i * N + j) * N..][..N]);
        row
    }
}

/// The two outer sums for degree 1.
#[inline(always)]
fn outer_1<T: Scalar>(rx: [T; 2], ry: [T; 2], f: &impl Lines<T, 2>) -> [T; 4] {
    let high: [T; 3] = step(f.at(1, 1), ry, f.at(1, 0));
    let low: [T; 3] = step(f.at(0, 1), ry, f.at(0, 0));
    step(high, rx, low)
}

/// The two outer sums for degree 2.
#[inline(always)]
fn outer_2<T: Scalar>(rx: [T; 2], ry: [T; 2], f: &impl Lines<T, 3>) -> [T; 7] {
    #[inline(always)]
    fn plane<T: Scalar>(ry: [T; 2], f: &impl Lines<T, 3>, i: usize) -> [T; 5] {
        let a: [T; 4] = step(f.at(i, 2), ry, f.at(i, 1));
        step(a, ry, f.at(i, 0))
    }
    let a: [T; 6] = step(plane(ry, f, 2), rx, plane(ry, f, 1));
    step(a, rx, plane(ry, f, 0))
}

/// The two outer sums for degree 3.
#[inline(always)]
fn outer_3<T: Scalar>(rx: [T; 2], ry: [T; 2], f: &impl Lines<T, 4>) -> [T; 10] {
    #[inline(always)]
    fn plane<T: Scalar>(ry: [T; 2], f: &impl Lines<T, 4>, i: usize) -> [T; 7] {
        let a: [T; 5] = step(f.at(i, 3), ry, f.at(i, 2));
        let a: [T; 6] = step(a, ry, f.at(i, 1));
        step(a, ry, f.at(i, 0))
    }
    let a: [T; 8] = step(plane(ry, f, 3), rx, plane(ry, f, 2));
    let a: [T; 9] = step(a, rx, plane(ry, f, 1));
    step(a, rx, plane(ry, f, 0))
}

/// PF: Horner's scheme by convolution in place, power form (thesis, section 3.2.3 and Listing A.1).
///
/// Corrected against the listing (maths, section B, and the inventory's errata of the thesis): its loops count down, so `++i` is `--i`; the innermost
/// convolution is with `r_z` and the outermost with `r_x` (the listing names `r_x` for both); the sums of the text start at 0. The
/// listing's fill with zeros and the first addition onto it are one copy here. The count for D = 3 is that of Table 3.1 with its two rows exchanged: 360
/// multiplications and 234 additions, printed as 234 and 360.
///
/// # Panics
/// As [`super::compose`].
#[inline(always)]
pub fn pf<T: Scalar, const D: usize>(f: &[T], r: &[[T; 2]; 3], out: &mut [T]) {
    check::<D>(f.len(), out.len());
    let [rx, ry, rz] = *r;
    let lines = Composed { f, rz };
    match D {
        1 => out.copy_from_slice(&outer_1(rx, ry, &lines)),
        2 => out.copy_from_slice(&outer_2(rx, ry, &lines)),
        _ => out.copy_from_slice(&outer_3(rx, ry, &lines)),
    }
}

/// The recommended form: power form along the ray's axis. The parameter t is the coordinate z itself, the other two are
/// `x = r[0][0] + t r[0][1]` and `y = r[1][0] + t r[1][1]`, so the innermost of the three sums is there already: the coefficients of a
/// row along z are those of `f_ij`. The two outer sums of PF remain, 168 of its 360 multiplications and 138 of its 234 additions.
///
/// Every ray has such an axis: the one along which it advances most, then both slopes are at most 1 in size. The axes of `f` are
/// permuted accordingly, which costs nothing while samples are loaded. On the cell, t runs over a part of the cell's side;
/// [`axis_segment`] puts it onto [0, 1].
///
/// # Panics
/// As [`super::compose`].
#[inline(always)]
pub fn axis<T: Scalar, const D: usize>(f: &[T], r: &[[T; 2]; 2], out: &mut [T]) {
    check::<D>(f.len(), out.len());
    match D {
        1 => out.copy_from_slice(&outer_1(r[0], r[1], &Rows(f))),
        2 => out.copy_from_slice(&outer_2(r[0], r[1], &Rows(f))),
        _ => out.copy_from_slice(&outer_3(r[0], r[1], &Rows(f))),
    }
}

/// [`axis`], then [`restrict`] to `[t0, t1]` and [`to_scaled`]: the scaled Bernstein form over the stretch, what a root finder wants.
///
/// # Panics
/// As [`super::compose`].
#[inline(always)]
pub fn axis_segment<T: Scalar, const D: usize>(f: &[T], r: &[[T; 2]; 2], [t0, t1]: [T; 2], out: &mut [T]) {
    #[inline(always)]
    fn onto<T: Scalar, const M: usize>(mut a: [T; M], t0: T, width: T, out: &mut [T]) {
        restrict(&mut a, t0, width);
        to_scaled(&mut a);
        out.copy_from_slice(&a);
    }
    check::<D>(f.len(), out.len());
    let width = t1 - t0;
    match D {
        1 => onto(outer_1(r[0], r[1], &Rows(f)), t0, width, out),
        2 => onto(outer_2(r[0], r[1], &Rows(f)), t0, width, out),
        _ => onto(outer_3(r[0], r[1], &Rows(f)), t0, width, out),
    }
}

/// Repeats a block for constant values of an index.
macro_rules! unroll {
    ($i:ident in $($k:literal)* => $body:block) => { $({ const $i: usize = $k; $body })* };
}

/// The power form of `p(start + width t)`, in place: Horner's shift, then powers of the width. At most 10 coefficients.
#[inline(always)]
pub fn restrict<T: Scalar, const M: usize>(a: &mut [T; M], start: T, width: T) {
    const { assert!(M > 0 && M <= 10) };
    unroll!(K in 0 1 2 3 4 5 6 7 8 => {
        unroll!(J in 2 3 4 5 6 7 8 9 10 => {
            // From the second highest down to K.
            if J + K <= M {
                a[M - J] = a[M - J] + a[M - J + 1] * start;
            }
        });
    });
    let mut power = width;
    unroll!(I in 1 2 3 4 5 6 7 8 9 => {
        if I < M {
            a[I] = a[I] * power;
            if I + 1 < M {
                power = power * width;
            }
        }
    });
}

/// From power form to scaled Bernstein form on [0, 1], in place: additions only. At most 10 coefficients.
#[inline(always)]
pub fn to_scaled<T: Scalar, const M: usize>(a: &mut [T; M]) {
    const { assert!(M > 0 && M <= 10) };
    unroll!(J in 1 2 3 4 5 6 7 8 9 => {
        if J < M {
            unroll!(I in 0 1 2 3 4 5 6 7 8 => {
                if I < J {
                    a[J - I] = a[J - I] + a[J - I - 1];
                }
            });
        }
    });
}
