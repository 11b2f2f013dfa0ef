//! The polynomial along eight rays in one cell, by powers.
//!
//! **Form.** Local coordinates are s = 2x - 1 in [-1, 1]. [`powers`] turns the stencil of a cell into coefficients of s_x^p s_y^q s_z^r, once for all
//! rays of a tile; [`along`] puts in s = m + h v for each ray, v from -1 where it enters to 1 where it leaves: the axis x by Taylor's shift, y and z by Horner's
//! rule on polynomials (Steinberger 2010, section 3.1.2, composes by products of polynomials too; the thesis's PF form has no shift to the middle of cell and segment).
//! [`bernstein`] gives the coefficients whose signs count.
//!
//! **Scale.** Values are [`scale`] = 48^3 or 8^3 times too large, so that the constants of [`powers`] are whole numbers.
//!
//! **Bound.** u = 2^-53, M the greatest |coefficient - c|. With every sign taken as positive, the weights of the powers of one axis sum to at most 104/48
//! (degree 3; 16/8 in degree 2), because |m| + |h| <= 1: all products that make up a coefficient, also one by powers of v, sum to at most (104/48)^3 M < 10.2 M.
//! Each of them is rounded at most so often: c subtracted 1; powers 3 * 4; m, h and powers of h 3 + 3 * 2, Taylor's shift 2 * 5 + 1; three Horner steps for
//! each of two axes, 3 * 2 * 3; Bernstein form, |constants| <= 1, 1 + 1 + 9 (or 2 * 9 for evaluation at some v): 69 times. That is 704 u M to first order; the local
//! coordinates are rounded by at most 2u, which moves s by 12 u M. **800 u M** is taken, beside 12E M for the position (`caster.rs`).

use super::basis::Spline;
use crate::packet::COEFFICIENTS;
use isobar_cpu::packet::Lanes;

/// Coefficients of s_x^p s_y^q s_z^r at `[p][4r + q]`.
pub(super) type Powers = [[f64; 16]; 4];

/// Bound on the rounding of a coefficient, in units of u M times the scale.
pub(super) const ROUNDING: f64 = 800.0;

/// What all values are too large by.
pub(super) const fn scale<S: Spline>() -> f64 {
    if S::DEGREE == 3 { 48.0 * 48.0 * 48.0 } else { 8.0 * 8.0 * 8.0 }
}

/// Powers of s along one axis.
#[inline(always)]
fn axis<S: Spline>(d: [f64; 4]) -> [f64; 4] {
    if S::DEGREE == 3 {
        let (outer, inner) = (d[0] + d[3], d[1] + d[2]);
        let (wide, narrow) = (d[3] - d[0], d[2] - d[1]);
        [
            outer + 23.0 * inner,
            3.0 * wide + 15.0 * narrow,
            3.0 * (outer - inner),
            wide - 3.0 * narrow,
        ]
    } else {
        let outer = d[0] + d[2];
        [outer + 6.0 * d[1], 2.0 * (d[2] - d[0]), outer - 2.0 * d[1], 0.0]
    }
}

/// The powers of a cell from its stencil `d`, x fastest, `degree + 1` per axis.
#[inline(always)]
pub(super) fn powers<S: Spline>(d: &[f64; 64]) -> Powers {
    let n = S::DEGREE + 1;
    let mut z = [[0.0; 16]; 4];
    for l in 0..n * n {
        let t = axis::<S>([d[l], d[n * n + l], d[2 * n * n + l], if n == 4 { d[48 + l] } else { 0.0 }]);
        for r in 0..n {
            z[r][l] = t[r];
        }
    }
    let mut y = [[0.0; 16]; 4];
    for r in 0..n {
        for i in 0..n {
            let t = axis::<S>([z[r][i], z[r][n + i], z[r][2 * n + i], if n == 4 { z[r][12 + i] } else { 0.0 }]);
            for q in 0..n {
                y[i][4 * r + q] = t[q];
            }
        }
    }
    let mut x = [[0.0; 16]; 4];
    for l in 0..16 {
        let t = axis::<S>([y[0][l], y[1][l], y[2][l], y[3][l]]);
        for p in 0..n {
            x[p][l] = t[p];
        }
    }
    x
}

/// s = m + h v along an axis.
#[derive(Clone, Copy)]
struct Line<L> {
    m: L,
    h: L,
}

/// p times the line; p has `N` coefficients before and one more after.
#[inline(always)]
fn times<L: Lanes, const N: usize>(p: &mut [L; COEFFICIENTS], line: Line<L>) {
    p[N] = p[N - 1].mul(line.h);
    for i in (1..N).rev() {
        p[i] = p[i].mul(line.m).add(p[i - 1].mul(line.h));
    }
    p[0] = p[0].mul(line.m);
}

/// p plus the first `N` coefficients of q.
#[inline(always)]
fn plus<L: Lanes, const N: usize>(p: &mut [L; COEFFICIENTS], q: &[L; COEFFICIENTS]) {
    for i in 0..N {
        p[i] = p[i].add(q[i]);
    }
}

/// Row 4r + q of the cell along x, by powers of v. `h2`, `h3`: powers of h.
#[inline(always)]
fn row<S: Spline, L: Lanes>(c: &Powers, l: usize, x: Line<L>, h2: L, h3: L) -> [L; COEFFICIENTS] {
    let (c0, c1, c2, c3) = (L::splat(c[0][l]), L::splat(c[1][l]), L::splat(c[2][l]), L::splat(c[3][l]));
    let mut out = [L::splat(0.0); COEFFICIENTS];
    if S::DEGREE == 3 {
        let e2 = c2.add(c3.mul(x.m));
        let e1 = c1.add(e2.mul(x.m));
        let f2 = e2.add(c3.mul(x.m));
        let f1 = e1.add(f2.mul(x.m));
        out[0] = c0.add(e1.mul(x.m));
        out[1] = f1.mul(x.h);
        out[2] = f2.add(c3.mul(x.m)).mul(h2);
        out[3] = c3.mul(h3);
    } else {
        let e1 = c1.add(c2.mul(x.m));
        out[0] = c0.add(e1.mul(x.m));
        out[1] = e1.add(c2.mul(x.m)).mul(x.h);
        out[2] = c2.mul(h2);
    }
    out
}

/// One plane of the cell, 4r + q for all q, by powers of v. (No closures here: those the compiler does not inline are compiled without the lanes'
/// instructions.)
#[inline(always)]
fn plane<S: Spline, L: Lanes>(c: &Powers, r: usize, [x, y]: [Line<L>; 2], h2: L, h3: L) -> [L; COEFFICIENTS] {
    if S::DEGREE == 3 {
        let mut p = row::<S, L>(c, 4 * r + 3, x, h2, h3);
        times::<L, 4>(&mut p, y);
        plus::<L, 4>(&mut p, &row::<S, L>(c, 4 * r + 2, x, h2, h3));
        times::<L, 5>(&mut p, y);
        plus::<L, 4>(&mut p, &row::<S, L>(c, 4 * r + 1, x, h2, h3));
        times::<L, 6>(&mut p, y);
        plus::<L, 4>(&mut p, &row::<S, L>(c, 4 * r, x, h2, h3));
        p
    } else {
        let mut p = row::<S, L>(c, 4 * r + 2, x, h2, h3);
        times::<L, 3>(&mut p, y);
        plus::<L, 3>(&mut p, &row::<S, L>(c, 4 * r + 1, x, h2, h3));
        times::<L, 4>(&mut p, y);
        plus::<L, 3>(&mut p, &row::<S, L>(c, 4 * r, x, h2, h3));
        p
    }
}

/// s = m + h v from `a` at v = -1 to `b` at 1.
#[inline(always)]
fn line<L: Lanes>(a: L, b: L) -> Line<L> {
    let half = L::splat(0.5);
    Line {
        m: a.add(b).mul(half),
        h: b.sub(a).mul(half),
    }
}

/// Coefficients by powers of v of the polynomial along eight rays, from local `a` to local `b`, both in [-1, 1]. Those beyond `3 degree` are zero.
#[inline(always)]
pub(super) fn along<S: Spline, L: Lanes>(c: &Powers, a: [L; 3], b: [L; 3]) -> [L; COEFFICIENTS] {
    let (x, y, z) = (line(a[0], b[0]), line(a[1], b[1]), line(a[2], b[2]));
    let h2 = x.h.mul(x.h);
    let h3 = h2.mul(x.h);
    if S::DEGREE == 3 {
        let mut p = plane::<S, L>(c, 3, [x, y], h2, h3);
        times::<L, 7>(&mut p, z);
        plus::<L, 7>(&mut p, &plane::<S, L>(c, 2, [x, y], h2, h3));
        times::<L, 8>(&mut p, z);
        plus::<L, 7>(&mut p, &plane::<S, L>(c, 1, [x, y], h2, h3));
        times::<L, 9>(&mut p, z);
        plus::<L, 7>(&mut p, &plane::<S, L>(c, 0, [x, y], h2, h3));
        p
    } else {
        let mut p = plane::<S, L>(c, 2, [x, y], h2, h3);
        times::<L, 5>(&mut p, z);
        plus::<L, 5>(&mut p, &plane::<S, L>(c, 1, [x, y], h2, h3));
        times::<L, 6>(&mut p, z);
        plus::<L, 5>(&mut p, &plane::<S, L>(c, 0, [x, y], h2, h3));
        p
    }
}

/// Bernstein coefficients of degree n on [-1, 1] of the powers of v, `[i][k]`: the k-th elementary symmetric function of i ones and n - i times -1, over
/// (n over k). The coefficients n - i differ from these by (-1)^k.
const fn table(n: usize) -> [[f64; COEFFICIENTS]; COEFFICIENTS] {
    let mut out = [[0.0; COEFFICIENTS]; COEFFICIENTS];
    let mut i = 0;
    while i <= n {
        // (1 + y)^i (1 - y)^(n - i), and (1 + y)^n.
        let (mut e, mut choose) = ([0i64; COEFFICIENTS], [0i64; COEFFICIENTS]);
        e[0] = 1;
        choose[0] = 1;
        let mut factor = 0;
        while factor < n {
            let mut k = factor + 1;
            while k > 0 {
                e[k] += if factor < i { e[k - 1] } else { -e[k - 1] };
                choose[k] += choose[k - 1];
                k -= 1;
            }
            factor += 1;
        }
        let mut k = 0;
        while k <= n {
            out[i][k] = e[k] as f64 / choose[k] as f64;
            k += 1;
        }
        i += 1;
    }
    out
}

const QUADRATIC: [[f64; COEFFICIENTS]; COEFFICIENTS] = table(6);
const CUBIC: [[f64; COEFFICIENTS]; COEFFICIENTS] = table(9);

/// Bernstein coefficients on [-1, 1] of what [`along`] gives; in degree 2 the last three are zero.
#[inline(always)]
pub(super) fn bernstein<S: Spline, L: Lanes>(p: &[L; COEFFICIENTS]) -> [L; COEFFICIENTS] {
    let n = 3 * S::DEGREE;
    let table = if S::DEGREE == 3 { &CUBIC } else { &QUADRATIC };
    let mut out = [L::splat(0.0); COEFFICIENTS];
    for i in 0..n / 2 + 1 {
        let (mut even, mut odd) = (L::splat(table[i][0]).mul(p[0]), L::splat(table[i][1]).mul(p[1]));
        for k in 1..COEFFICIENTS / 2 {
            if 2 * k <= n {
                even = even.add(L::splat(table[i][2 * k]).mul(p[2 * k]));
            }
            if 2 * k < n {
                odd = odd.add(L::splat(table[i][2 * k + 1]).mul(p[2 * k + 1]));
            }
        }
        out[i] = even.add(odd);
        out[n - i] = even.sub(odd);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::smooth::basis::{Cubic, Quadratic, Table, growth};
    use crate::smooth::vector::{Portable, Register};
    use isobar_cpu::packet::{LANES, Plain};

    /// Against the composition of single rays, within both bounds; and the polynomial by powers is the one in Bernstein form.
    fn agrees<S: Spline>() {
        let mut seed = 3u64;
        let mut unit = || {
            seed = seed
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (seed >> 11) as f64 / (1u64 << 53) as f64
        };
        let double = Table::<f64>::new::<S>();
        let n = 3 * S::DEGREE;
        let mut worst = 0.0f64;
        for _ in 0..500 {
            let d: [f64; 64] = std::array::from_fn(|_| unit() * 2.0 - 1.0);
            let ends: [[[f64; LANES]; 3]; 2] = std::array::from_fn(|_| std::array::from_fn(|_| std::array::from_fn(|_| unit())));
            let local = |e: usize| std::array::from_fn(|a| Plain::load(&ends[e][a].map(|x| 2.0 * x - 1.0)));
            let p = along::<S, Plain>(&powers::<S>(&d), local(0), local(1));
            let b = bernstein::<S, Plain>(&p);
            let lanes = |v: &[Plain; COEFFICIENTS]| {
                v.map(|v| {
                    let mut to = [0.0; LANES];
                    v.store(&mut to);
                    to
                })
            };
            let (p, b) = (lanes(&p), lanes(&b));
            for l in 0..LANES {
                let end = |e: usize| std::array::from_fn(|a| ends[e][a][l]);
                let mut want = [0.0; 16];
                double.compose::<S, S::Double<Portable>>(&d, end(0), end(1)).store(&mut want);
                let bound = (growth::<S>() + ROUNDING) * 0.5 * f64::EPSILON;
                for i in 0..=n {
                    let error = (b[i][l] / scale::<S>() - want[i] / S::SCALE).abs();
                    assert!(error <= bound, "degree {n}, coefficient {i}: {error} of {bound}");
                    worst = worst.max(error / bound);
                }
                let x = unit();
                let value = (0..=n).rev().fold(0.0, |s, k| s * (2.0 * x - 1.0) + p[k][l]);
                let coefficients: [f64; COEFFICIENTS] = std::array::from_fn(|i| b[i][l]);
                let also = isobar_poly::bernstein::eval(&coefficients[..=n], x);
                assert!(
                    (value - also).abs() <= ROUNDING * f64::EPSILON * scale::<S>(),
                    "{value} and {also} at {x}"
                );
            }
        }
        assert!(worst > 1e-6, "{worst}: the bound is not absurd");
    }

    #[test]
    fn polynomials_are_those_of_single_rays() {
        agrees::<Quadratic>();
        agrees::<Cubic>();
    }

    /// The rounding itself, against f32 inputs for which f64 is exact enough: small whole numbers and dyadic ends, for which all values are exact.
    #[test]
    fn powers_are_exact_on_whole_numbers() {
        let d: [f64; 64] = std::array::from_fn(|i| ((i * 37) % 11) as f64 - 5.0);
        let c = powers::<Cubic>(&d);
        for n in 0..=4 {
            let s = f64::from(n) * 0.5 - 1.0;
            // Along the diagonal of the cell, from (s, s, s): the tensor product by its definition.
            let w = (s + 1.0) / 2.0;
            let v = 1.0 - w;
            let weights = [
                v * v * v,
                4.0 - 6.0 * w * w + 3.0 * w * w * w,
                4.0 - 6.0 * v * v + 3.0 * v * v * v,
                w * w * w,
            ];
            let want: f64 = (0..64)
                .map(|i| d[i] * weights[i % 4] * weights[i / 4 % 4] * weights[i / 16])
                .sum();
            let got: f64 = (0..64)
                .map(|i| c[i / 16][i % 16] * s.powi((i / 16) as i32) * s.powi((i % 4) as i32) * s.powi((i / 4 % 4) as i32))
                .sum();
            assert_eq!(got / 512.0, want, "at {s}");
        }
    }
}
