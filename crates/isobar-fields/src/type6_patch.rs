//! One tetrahedron of the type-6 partition: its coefficients from the data, and its value and gradient by de Casteljau's rule.
//!
//! Kalbe, Koch and Goesele 2009, sections 3.1 and 3.2. Everything is in the canonical coordinates of [`crate::type6::frame`], so that one piece of
//! code without tables serves all 24 kinds. Two ways lead to the coefficients, as in the paper: directly from 23 of the 27 data
//! ([`coefficients`], the paper's on-the-fly variant), and from the determining set of a cube by averaging ([`DeterminingSet`]).
//!
//! The gradient has a factor 3 that the paper's equation (3) lacks (maths: corrections, section A, caution 2).

use crate::type6_masks::{DENOMINATOR, frame};
use std::ops::{Add, Mul, Sub};

/// What the rules need of a number: f64, and integers in exact tests.
pub trait Number: Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> {
    /// A small integer.
    fn small(k: i32) -> Self;
    /// Half of it; integers must be even (checked in debug builds).
    #[must_use]
    fn half(self) -> Self;
}

impl Number for f64 {
    #[inline(always)]
    fn small(k: i32) -> Self {
        k.into()
    }
    #[inline(always)]
    fn half(self) -> Self {
        0.5 * self
    }
}

impl Number for i64 {
    fn small(k: i32) -> Self {
        k.into()
    }
    fn half(self) -> Self {
        debug_assert!(self % 2 == 0, "{self} is odd");
        self / 2
    }
}

/// The kind of the tetrahedron that contains a point, given in grid steps from the centre of its cube; on a face any of the adjacent ones.
#[inline]
#[must_use]
pub fn kind_of(p: [f64; 3]) -> usize {
    let m = [p[0].abs(), p[1].abs(), p[2].abs()];
    let a = if m[0] >= m[1] && m[0] >= m[2] {
        0
    } else if m[1] >= m[2] {
        1
    } else {
        2
    };
    let (b, c) = ((a + 1) % 3, (a + 2) % 3);
    let (q, b) = if m[b] >= m[c] { (0, b) } else { (1, c) };
    8 * a + 4 * usize::from(p[a] >= 0.0) + 2 * q + usize::from(p[b] >= 0.0)
}

/// Canonical coordinates (X, Y, Z) of a point or vector for a kind.
#[inline]
#[must_use]
pub fn canonical(kind: usize, p: [f64; 3]) -> [f64; 3] {
    let ([a, b, c], [sa, sb]) = frame(kind);
    [f64::from(sa) * p[a], f64::from(sb) * p[b], p[c]]
}

/// Back from canonical coordinates: the inverse of [`canonical`].
#[inline]
#[must_use]
pub fn from_canonical(kind: usize, v: [f64; 3]) -> [f64; 3] {
    let ([a, b, c], [sa, sb]) = frame(kind);
    let mut p = [0.0; 3];
    p[a] = f64::from(sa) * v[0];
    p[b] = f64::from(sb) * v[1];
    p[c] = v[2];
    p
}

/// The 27 data of a cube (x fastest) in canonical order (X fastest).
#[must_use]
pub fn reorder<T: Copy>(kind: usize, data: &[T; 27]) -> [T; 27] {
    let ([a, b, c], [sa, sb]) = frame(kind);
    let stride = [1, 3, 9];
    std::array::from_fn(|n| {
        let (x, y, z) = (n as isize % 3 - 1, n as isize / 3 % 3 - 1, n as isize / 9 - 1);
        let at = 13 + isize::from(sa) * x * stride[a] + isize::from(sb) * y * stride[b] + z * stride[c];
        data[at as usize]
    })
}

/// Barycentric coordinates of a canonical point: `1 - 2X, 2(X - Y), Y + Z, Y - Z`.
#[inline(always)]
#[must_use]
pub fn barycentric([x, y, z]: [f64; 3]) -> [f64; 4] {
    [1.0 - 2.0 * x, 2.0 * (x - y), y + z, y - z]
}

/// 192 times the 20 coefficients of the canonical tetrahedron from data in canonical order; reads 23 of the 27, and is exact for integers.
///
/// In f64 each of the sums has at most 9 roundings of terms that sum to at most 192 max|d|.
#[inline(always)]
#[must_use]
pub fn coefficients_192<T: Number>(d: &[T; 27]) -> [T; 20] {
    let k = |n: i32| T::small(n);
    // Letters: o the centre, b ahead along X, m behind; y, z one step along Y, Z, v, w one step back; pairs of letters both.
    let (o, b, m) = (d[13], d[14], d[12]);
    let (y, v, z, w) = (d[16], d[10], d[22], d[4]);
    let (by, bv, bz, bw) = (d[17], d[11], d[23], d[5]);
    let (my, mv, mz, mw) = (d[15], d[9], d[21], d[3]);
    let (yz, yw, vz, vw) = (d[25], d[7], d[19], d[1]);
    let (byz, byw, bvz, bvw) = (d[26], d[8], d[20], d[2]);
    // Sums of the two data beside the face X = 1/2, on its plane.
    let (p, py, pv, pz, pw) = (o + b, y + by, v + bv, z + bz, w + bw);
    let (pyz, pyw, pvz, pvw) = (yz + byz, yw + byw, vz + bvz, vw + bvw);
    let (p24, p40, p52) = (k(24) * p, k(40) * p, k(52) * p);
    let (edge, inner) = (p + py, k(64) * o + k(40) * b);
    let around = (y + v) + (z + w);
    let beyond = (by + bv) + (bz + bw);
    let corners = (yz + yw) + (vz + vw);
    let behind = (my + mv) + (mz + mw);
    let centre = k(72) * o;
    let (zw, bzw) = (z + w, bz + bw);
    [
        centre + k(16) * (around + (b + m)) + k(2) * ((beyond + behind) + corners),
        centre + k(28) * b + k(16) * around + k(4) * m + k(3) * beyond + k(2) * corners + behind,
        centre + k(28) * (b + y + z) + k(4) * ((by + bz) + (m + yz) + (v + w)) + k(2) * ((bv + bw) + (my + mz) + (yw + vz)),
        centre + k(28) * (b + y + w) + k(4) * ((by + bw) + (m + yw) + (v + z)) + k(2) * ((bv + bz) + (my + mw) + (yz + vw)),
        inner + k(14) * around + k(6) * beyond + k(2) * corners,
        inner + k(24) * (y + z) + k(10) * (by + bz) + k(4) * (yz + v + w) + k(2) * ((bv + bw) + (yw + vz)),
        inner + k(24) * (y + w) + k(10) * (by + bw) + k(4) * (yw + v + z) + k(2) * ((bv + bz) + (yz + vw)),
        k(48) * o + k(32) * (b + y + z) + k(16) * (by + bz + yz),
        inner + k(40) * y + k(16) * by + k(8) * zw + k(4) * (bzw + (yz + yw)),
        k(48) * o + k(32) * (b + y + w) + k(16) * (by + bw + yw),
        p52 + k(10) * ((py + pv) + (pz + pw)) + ((pyz + pyw) + (pvz + pvw)),
        p52 + k(17) * (py + pz) + k(3) * (pv + pw) + k(2) * pyz + (pyw + pvz),
        p52 + k(17) * (py + pw) + k(3) * (pv + pz) + k(2) * pyw + (pyz + pvw),
        p40 + k(24) * (py + pz) + k(8) * pyz,
        p52 + k(28) * py + k(6) * (pz + pw) + k(2) * (pyz + pyw),
        p40 + k(24) * (py + pw) + k(8) * pyw,
        p24 + k(24) * (py + (pz + pyz)),
        k(40) * edge + k(8) * (pz + pyz),
        k(40) * edge + k(8) * (pw + pyw),
        p24 + k(24) * (py + (pw + pyw)),
    ]
}

/// The 20 coefficients in f64. With integer data below 2^44 only the division rounds; else the error is below 12 units of the greatest |datum|.
#[inline(always)]
#[must_use]
pub fn coefficients(d: &[f64; 27]) -> [f64; 20] {
    const PART: f64 = 1.0 / DENOMINATOR as f64;
    let mut b = coefficients_192(d);
    for v in &mut b {
        *v *= PART;
    }
    b
}

/// Two steps of de Casteljau's rule with the same point: the four `b^[2]` of which the next step with any second point gives a blossom.
#[inline(always)]
#[must_use]
pub fn two_steps(b: &[f64; 20], p: [f64; 4]) -> [f64; 4] {
    let dot = |i: usize, j: usize, k: usize, l: usize, b: &[f64]| (p[0] * b[i] + p[1] * b[j]) + (p[2] * b[k] + p[3] * b[l]);
    // The ten quadratic coefficients 2000, 1100, 1010, 1001, 0200, 0110, 0101, 0020, 0011, 0002.
    let q = [
        dot(0, 1, 2, 3, b),
        dot(1, 4, 5, 6, b),
        dot(2, 5, 7, 8, b),
        dot(3, 6, 8, 9, b),
        dot(4, 10, 11, 12, b),
        dot(5, 11, 13, 14, b),
        dot(6, 12, 14, 15, b),
        dot(7, 13, 16, 17, b),
        dot(8, 14, 17, 18, b),
        dot(9, 15, 18, 19, b),
    ];
    [
        dot(0, 1, 2, 3, &q),
        dot(1, 4, 5, 6, &q),
        dot(2, 5, 7, 8, &q),
        dot(3, 6, 8, 9, &q),
    ]
}

/// The last step of de Casteljau's rule.
#[inline(always)]
#[must_use]
pub fn last_step(l: [f64; 4], p: [f64; 4]) -> f64 {
    (p[0] * l[0] + p[1] * l[1]) + (p[2] * l[2] + p[3] * l[3])
}

/// Gradient in canonical coordinates from the `b^[2]` at a point: `3 sum b^[2]_v grad phi_v`.
#[inline(always)]
#[must_use]
pub fn canonical_gradient(l: [f64; 4]) -> [f64; 3] {
    [6.0 * (l[1] - l[0]), 3.0 * ((l[2] + l[3]) - 2.0 * l[1]), 3.0 * (l[2] - l[3])]
}

/// The determining set of one cube, 56 coefficients times 192: those at its vertices, two on each edge, one for each of the 24 kinds.
///
/// Kalbe et al. 2009, section 3.2: all other coefficients of the cube follow by averaging ([`DeterminingSet::coefficients`]).
#[derive(Debug, Clone, PartialEq)]
pub struct DeterminingSet<T> {
    /// `b_0030`, `b_0003` of the vertices, bit a of the index set where coordinate a is positive.
    pub vertices: [T; 8],
    /// `b_0021` and `b_0012`: along axis a, at the edge whose other two signs are bits 0 and 1 (axes a + 1 and a + 2), on the negative and the positive side.
    pub edges: [[[T; 2]; 4]; 3],
    /// `b_0111` per kind.
    pub faces: [T; 24],
}

impl<T: Number> DeterminingSet<T> {
    /// From the 27 data of a cube, x fastest.
    #[must_use]
    pub fn new(data: &[T; 27]) -> Self {
        let at = |o: [i32; 3]| data[((o[2] + 1) * 9 + (o[1] + 1) * 3 + o[0] + 1) as usize];
        let sign = |bits: usize, i: usize| if bits >> i & 1 == 1 { 1 } else { -1 };
        // Sum over the data at 0 and at s along the two axes b, c, in the layer `layer` of axis a.
        let layer = |a: usize, s: [i32; 2], layer: i32| {
            let point = |j: i32, k: i32| {
                let mut o = [0; 3];
                (o[a], o[(a + 1) % 3], o[(a + 2) % 3]) = (layer, j, k);
                at(o)
            };
            (point(0, 0) + point(s[0], 0)) + (point(0, s[1]) + point(s[0], s[1]))
        };
        let k = |n: i32| T::small(n);
        Self {
            vertices: std::array::from_fn(|v| {
                let s = [sign(v, 1), sign(v, 2)];
                k(24) * (layer(0, s, 0) + layer(0, s, sign(v, 0)))
            }),
            edges: std::array::from_fn(|a| {
                std::array::from_fn(|e| {
                    let s = [sign(e, 0), sign(e, 1)];
                    let own = k(40) * layer(a, s, 0);
                    [own + k(8) * layer(a, s, -1), own + k(8) * layer(a, s, 1)]
                })
            }),
            faces: std::array::from_fn(|kind| {
                let ([a, b, c], [sa, sb]) = frame(kind);
                let pair = |y: i32, z: i32| {
                    let mut o = [0; 3];
                    (o[b], o[c]) = (i32::from(sb) * y, z);
                    let near = at(o);
                    o[a] = sa.into();
                    near + at(o)
                };
                k(52) * pair(0, 0) + k(28) * pair(1, 0) + k(6) * (pair(0, 1) + pair(0, -1)) + k(2) * (pair(1, 1) + pair(1, -1))
            }),
        }
    }

    /// 192 times the 20 coefficients of a kind by the averaging rules (maths: corrections, section A, table of masks).
    #[must_use]
    pub fn coefficients(&self, kind: usize) -> [T; 20] {
        let own = self.half(kind, 1);
        let mirrored = self.half(kind, -1);
        [
            own.centre,
            own.b2100,
            own.b2010,
            mirrored.b2010,
            own.b1200,
            own.b1110,
            mirrored.b1110,
            own.b1020,
            own.b1011,
            mirrored.b1020,
            own.b0300,
            own.b0210,
            mirrored.b0210,
            own.b0120,
            own.b0111,
            mirrored.b0120,
            own.b0030,
            own.b0021,
            mirrored.b0021,
            mirrored.b0030,
        ]
    }

    /// Edge coefficient along axis a, at the edge on the side of the signs `s` of the other axes, nearer to the end on the side of `s[a]`.
    fn edge(&self, a: usize, s: [i32; 3]) -> T {
        let bits = usize::from(s[(a + 1) % 3] > 0) + 2 * usize::from(s[(a + 2) % 3] > 0);
        self.edges[a][bits][usize::from(s[a] > 0)]
    }

    /// `b_1011`-like coefficient of the wedge between the face along a and the face along b, with signs: symmetric in both.
    fn b1011(&self, a: usize, sa: i32, b: usize, sb: i32) -> T {
        let c = 3 - a - b;
        let mut s = [1; 3];
        (s[a], s[b]) = (sa, sb);
        let far = self.edge(c, s);
        s[c] = -1;
        let near = self.edge(c, s);
        self.faces[kind(a, sa, b, sb)] + self.faces[kind(b, sb, a, sa)] - (far + near).half()
    }

    /// `b_1110` toward the vertex of the signs `s`, in the pyramid along a: the mean of the two `b_1011` beside it.
    fn b1110(&self, a: usize, s: [i32; 3]) -> T {
        let (b, c) = ((a + 1) % 3, (a + 2) % 3);
        (self.b1011(a, s[a], b, s[b]) + self.b1011(a, s[a], c, s[c])).half()
    }

    /// `b_1020` at the vertex of the signs `s`.
    fn b1020(&self, s: [i32; 3]) -> T {
        let sum = self.edge(0, s) + self.edge(1, s) + self.edge(2, s);
        (sum - self.vertices[vertex(s)]).half()
    }

    /// `b_2010` toward the vertex of the signs `s`: the same from every pyramid; here from the wedge between axes a and b.
    fn b2010(&self, a: usize, b: usize, s: [i32; 3]) -> T {
        self.b1110(a, s) + self.b1110(b, s) - (self.b1020(s) + self.b1011(a, s[a], b, s[b])).half()
    }

    /// `b_2100` of the pyramid along a with sign `sa`: the mean of the four `b_2010` of its vertices.
    fn b2100(&self, a: usize, sa: i32) -> T {
        let (b, c) = ((a + 1) % 3, (a + 2) % 3);
        let at = |sb: i32, sc: i32| {
            let mut s = [0; 3];
            (s[a], s[b], s[c]) = (sa, sb, sc);
            self.b2010(a, b, s)
        };
        ((at(-1, -1) + at(1, -1)) + (at(-1, 1) + at(1, 1))).half().half()
    }

    /// The coefficients on the side of v2 (`sc` = 1) or v3 (-1).
    fn half(&self, at: usize, sc: i32) -> Half<T> {
        let ([a, b, c], [sa, sb]) = frame(at);
        let (sa, sb) = (i32::from(sa), i32::from(sb));
        let mut s = [0; 3];
        (s[a], s[b], s[c]) = (sa, sb, sc);
        let face = |x: usize, sx: i32| self.faces[kind(a, sa, x, sx)];
        let inner = |x: usize, sx: i32| self.b1011(a, sa, x, sx);
        let quarter = |f: &dyn Fn(usize, i32) -> T| ((f(b, 1) + f(b, -1)) + (f(c, 1) + f(c, -1))).half().half();
        Half {
            centre: (self.b2100(0, 1) + self.b2100(0, -1)).half(),
            b2100: self.b2100(a, sa),
            b2010: self.b2010(a, b, s),
            b1200: quarter(&inner),
            b1110: self.b1110(a, s),
            b1020: self.b1020(s),
            b1011: inner(b, sb),
            b0300: quarter(&face),
            b0210: (face(b, sb) + face(c, sc)).half(),
            b0120: (self.edge(c, s) + self.edge(b, s)).half(),
            b0111: face(b, sb),
            b0030: self.vertices[vertex(s)],
            b0021: self.edge(c, s),
        }
    }
}

/// Half of the coefficients of a kind.
struct Half<T> {
    centre: T,
    b2100: T,
    b2010: T,
    b1200: T,
    b1110: T,
    b1020: T,
    b1011: T,
    b0300: T,
    b0210: T,
    b0120: T,
    b0111: T,
    b0030: T,
    b0021: T,
}

/// The kind with face axis a and edge axis b.
fn kind(a: usize, sa: i32, b: usize, sb: i32) -> usize {
    8 * a + 4 * usize::from(sa > 0) + 2 * ((b + 2 - a) % 3) + usize::from(sb > 0)
}

fn vertex(s: [i32; 3]) -> usize {
    (0..3).map(|i| usize::from(s[i] > 0) << i).sum()
}
