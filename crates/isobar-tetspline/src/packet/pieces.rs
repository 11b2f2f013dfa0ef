//! Eight pieces of rays in tetrahedra at a time: coefficients, the cubic along each, and gradients.
//!
//! Lane l has its own kind of tetrahedron: a kind is a signed permutation of the axes (`isobar_fields::type6`), so the data in canonical order are gathered
//! with three strides, and the masks, de Casteljau's rule and the gradient are those of the one canonical tetrahedron. Values are 192 times too large, which saves 20 divisions.

use super::Paths;
use isobar_cpu::packet::{LANES, Lanes, RAYS};
use isobar_fields::type6::{DENOMINATOR, Number, coefficients_192, frame};
use std::ops::{Add, Mul, Sub};

/// Lanes as numbers of `isobar_fields::type6`.
#[derive(Clone, Copy)]
pub(super) struct Of<S>(pub(super) S);

impl<S: Lanes> Add for Of<S> {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        Self(self.0.add(o.0))
    }
}
impl<S: Lanes> Sub for Of<S> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        Self(self.0.sub(o.0))
    }
}
impl<S: Lanes> Mul for Of<S> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        Self(self.0.mul(o.0))
    }
}
impl<S: Lanes> Number for Of<S> {
    #[inline(always)]
    fn small(k: i32) -> Self {
        Self(S::splat(k.into()))
    }
    #[inline(always)]
    fn half(self) -> Self {
        Self(self.0.mul(S::splat(0.5)))
    }
}

/// What is looked up by kind: the three axes, their strides in the 27 data with sign, where they begin in tables of eight entries an axis and in the arrays of rays,
/// and the first two signs.
struct Kinds {
    axes: [[i32; 32]; 3],
    eights: [[i32; 32]; 3],
    strides: [[i32; 32]; 3],
    rays: [[i32; 32]; 3],
    signs: [[f64; 32]; 2],
}

static KINDS: Kinds = kinds();

const fn kinds() -> Kinds {
    let mut k = Kinds {
        axes: [[0; 32]; 3],
        eights: [[0; 32]; 3],
        strides: [[0; 32]; 3],
        rays: [[0; 32]; 3],
        signs: [[0.0; 32]; 2],
    };
    let stride = [1, 3, 9];
    let mut kind = 0;
    while kind < 24 {
        let (axes, signs) = frame(kind);
        let sign = [signs[0], signs[1], 1];
        let mut i = 0;
        while i < 3 {
            k.axes[i][kind] = axes[i] as i32;
            k.eights[i][kind] = (axes[i] * LANES) as i32;
            k.strides[i][kind] = sign[i] as i32 * stride[axes[i]];
            k.rays[i][kind] = (axes[i] * RAYS) as i32;
            if i < 2 {
                k.signs[i][kind] = sign[i] as f64;
            }
            i += 1;
        }
        kind += 1;
    }
    k
}

/// 192 times the 20 coefficients of the kinds in the lanes; the data of a lane begin at `at` of the table, x fastest.
#[inline(always)]
pub(super) fn coefficients<S: Lanes, const N: usize>(table: &[f64; N], at: S::Index, kind: S::Index) -> [S; 20] {
    // No `map` and few closures here: those the compiler does not inline are compiled without the lanes' instructions.
    let x = S::lookup(&KINDS.strides[0], kind);
    let y = S::lookup(&KINDS.strides[1], kind);
    let z = S::lookup(&KINDS.strides[2], kind);
    let thirteen = S::index(0x0d0d_0d0d_0d0d_0d0d);
    let centre = S::plus(at, thirteen);
    let mut d = [Of(S::splat(0.0)); 27];
    let layers = [S::minus(centre, z), centre, S::plus(centre, z)];
    for (k, layer) in layers.into_iter().enumerate() {
        for (j, row) in [S::minus(layer, y), layer, S::plus(layer, y)].into_iter().enumerate() {
            let n = 9 * k + 3 * j;
            // Behind the centre only five data count.
            if k == 1 || j == 1 {
                d[n] = Of(S::gather(table, S::minus(row, x)));
            }
            d[n + 1] = Of(S::gather(table, row));
            d[n + 2] = Of(S::gather(table, S::plus(row, x)));
        }
    }
    let b = coefficients_192(&d);
    let mut out = [S::splat(0.0); 20];
    for n in 0..20 {
        out[n] = b[n].0;
    }
    out
}

/// Rays in canonical coordinates of the tetrahedra in the lanes.
pub(super) struct Lines<S> {
    origin: [S; 3],
    direction: [S; 3],
}

impl<S: Lanes> Lines<S> {
    /// `rays`: numbers of the rays; the centres of the cubes stand in the table at `8 axis + at`.
    #[inline(always)]
    pub(super) fn new(p: &Paths, rays: S::Index, centres: &[f64; 32], at: S::Index, kind: S::Index) -> Self {
        let one = S::splat(1.0);
        let sign = [S::gather(&KINDS.signs[0], kind), S::gather(&KINDS.signs[1], kind), one];
        let mut lines = Self {
            origin: [one; 3],
            direction: [one; 3],
        };
        for (i, &sign) in sign.iter().enumerate() {
            let ray = S::plus(rays, S::lookup(&KINDS.rays[i], kind));
            let centre = S::gather(centres, S::plus(at, S::lookup(&KINDS.eights[i], kind)));
            lines.origin[i] = S::gather(&p.origin, ray).sub(centre).mul(sign);
            lines.direction[i] = S::gather(&p.direction, ray).mul(sign);
        }
        lines
    }

    /// Barycentric coordinates at a parameter.
    #[inline(always)]
    pub(super) fn at(&self, t: S) -> [S; 4] {
        let (o, d) = (&self.origin, &self.direction);
        let (x, y, z) = (o[0].add(t.mul(d[0])), o[1].add(t.mul(d[1])), o[2].add(t.mul(d[2])));
        let (one, two) = (S::splat(1.0), S::splat(2.0));
        [one.sub(two.mul(x)), two.mul(x.sub(y)), y.add(z), y.sub(z)]
    }
}

#[inline(always)]
fn dot<S: Lanes>(p: [S; 4], b: [S; 4]) -> S {
    p[0].mul(b[0]).add(p[1].mul(b[1])).add(p[2].mul(b[2]).add(p[3].mul(b[3])))
}

/// Two steps of de Casteljau's rule with the same point.
#[inline(always)]
pub(super) fn two_steps<S: Lanes>(b: &[S; 20], p: [S; 4]) -> [S; 4] {
    let q = [
        dot(p, [b[0], b[1], b[2], b[3]]),
        dot(p, [b[1], b[4], b[5], b[6]]),
        dot(p, [b[2], b[5], b[7], b[8]]),
        dot(p, [b[3], b[6], b[8], b[9]]),
        dot(p, [b[4], b[10], b[11], b[12]]),
        dot(p, [b[5], b[11], b[13], b[14]]),
        dot(p, [b[6], b[12], b[14], b[15]]),
        dot(p, [b[7], b[13], b[16], b[17]]),
        dot(p, [b[8], b[14], b[17], b[18]]),
        dot(p, [b[9], b[15], b[18], b[19]]),
    ];
    [
        dot(p, [q[0], q[1], q[2], q[3]]),
        dot(p, [q[1], q[4], q[5], q[6]]),
        dot(p, [q[2], q[5], q[7], q[8]]),
        dot(p, [q[3], q[6], q[8], q[9]]),
    ]
}

/// The cubic between two points in Bernstein form (K14): first steps shared, 32 inner products.
#[inline(always)]
pub(super) fn blossom<S: Lanes>(b: &[S; 20], from: [S; 4], to: [S; 4]) -> [S; 4] {
    let (l, m) = (two_steps(b, from), two_steps(b, to));
    [dot(from, l), dot(to, l), dot(from, m), dot(to, m)]
}

/// Gradients in index space from the result of [`two_steps`], 192 times too large there and right here; as lanes of x, y, z.
#[inline(always)]
pub(super) fn gradients<S: Lanes>(l: [S; 4], kinds: &[u8; LANES]) -> [[f64; LANES]; 3] {
    let (three, six) = (S::splat(3.0 / f64::from(DENOMINATOR)), S::splat(6.0 / f64::from(DENOMINATOR)));
    let canonical = [
        six.mul(l[1].sub(l[0])),
        three.mul(l[2].add(l[3]).sub(l[1].add(l[1]))),
        three.mul(l[2].sub(l[3])),
    ];
    let mut lanes = [[0.0; LANES]; 3];
    for (to, v) in lanes.iter_mut().zip(canonical) {
        v.store(to);
    }
    let mut out = [[0.0; LANES]; 3];
    for n in 0..LANES {
        let k = usize::from(kinds[n] & 31);
        for (i, v) in lanes.iter().enumerate() {
            let sign = if i < 2 { KINDS.signs[i][k] } else { 1.0 };
            out[KINDS.axes[i][k] as usize & 3][n] = sign * v[n];
        }
    }
    out
}
