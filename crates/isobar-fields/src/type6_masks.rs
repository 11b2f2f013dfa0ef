//! The masks of the cubic C1 quasi-interpolating spline on the type-6 partition: data, and the 24 kinds of tetrahedra made from them.
//!
//! Kalbe, Koch and Goesele, *High-Quality Rendering of Varying Isosurfaces with Cubic Trivariate C1-continuous Splines* (ISVC 2009), section
//! 3.2: coefficients are weighted averages of the 27 data about a cube's centre. The weights stand in its Fig. 3, which does not survive as text; those here
//! are the only ones that are local, symmetric, sum to one and join with C1 (maths: corrections, section A, `masks.json`). `tests/type6.rs` proves C0, C1,
//! the reproduced polynomials and the counts again in exact arithmetic.

use isobar_core::TetMasks;

/// Weights times this are integers.
pub const DENOMINATOR: i32 = 192;

/// Exponents (i, j, k, l) of the 20 coefficients, in the order of every array of coefficients here.
pub const INDICES: [[u8; 4]; 20] = [
    [3, 0, 0, 0],
    [2, 1, 0, 0],
    [2, 0, 1, 0],
    [2, 0, 0, 1],
    [1, 2, 0, 0],
    [1, 1, 1, 0],
    [1, 1, 0, 1],
    [1, 0, 2, 0],
    [1, 0, 1, 1],
    [1, 0, 0, 2],
    [0, 3, 0, 0],
    [0, 2, 1, 0],
    [0, 2, 0, 1],
    [0, 1, 2, 0],
    [0, 1, 1, 1],
    [0, 1, 0, 2],
    [0, 0, 3, 0],
    [0, 0, 2, 1],
    [0, 0, 1, 2],
    [0, 0, 0, 3],
];

/// `192 w_ijkl(o)` for the canonical tetrahedron v0 = 0, v1 = (1/2, 0, 0), v2 = (1/2, 1/2, 1/2), v3 = (1/2, 1/2, -1/2), offsets o in
/// {-1, 0, 1}^3 with x fastest.
#[rustfmt::skip]
const CANONICAL: [[u8; 27]; 20] = [
    [0, 2, 0, 2, 16, 2, 0, 2, 0,  2, 16, 2, 16, 72, 16, 2, 16, 2,  0, 2, 0, 2, 16, 2, 0, 2, 0],
    [0, 2, 0, 1, 16, 3, 0, 2, 0,  1, 16, 3, 4, 72, 28, 1, 16, 3,  0, 2, 0, 1, 16, 3, 0, 2, 0],
    [0, 0, 0, 0, 4, 2, 0, 2, 0,  0, 4, 2, 4, 72, 28, 2, 28, 4,  0, 2, 0, 2, 28, 4, 0, 4, 0],
    [0, 2, 0, 2, 28, 4, 0, 4, 0,  0, 4, 2, 4, 72, 28, 2, 28, 4,  0, 0, 0, 0, 4, 2, 0, 2, 0],
    [0, 2, 0, 0, 14, 6, 0, 2, 0,  0, 14, 6, 0, 64, 40, 0, 14, 6,  0, 2, 0, 0, 14, 6, 0, 2, 0],
    [0, 0, 0, 0, 4, 2, 0, 2, 0,  0, 4, 2, 0, 64, 40, 0, 24, 10,  0, 2, 0, 0, 24, 10, 0, 4, 0],
    [0, 2, 0, 0, 24, 10, 0, 4, 0,  0, 4, 2, 0, 64, 40, 0, 24, 10,  0, 0, 0, 0, 4, 2, 0, 2, 0],
    [0, 0, 0, 0, 0, 0, 0, 0, 0,  0, 0, 0, 0, 48, 32, 0, 32, 16,  0, 0, 0, 0, 32, 16, 0, 16, 0],
    [0, 0, 0, 0, 8, 4, 0, 4, 0,  0, 0, 0, 0, 64, 40, 0, 40, 16,  0, 0, 0, 0, 8, 4, 0, 4, 0],
    [0, 0, 0, 0, 32, 16, 0, 16, 0,  0, 0, 0, 0, 48, 32, 0, 32, 16,  0, 0, 0, 0, 0, 0, 0, 0, 0],
    [0, 1, 1, 0, 10, 10, 0, 1, 1,  0, 10, 10, 0, 52, 52, 0, 10, 10,  0, 1, 1, 0, 10, 10, 0, 1, 1],
    [0, 0, 0, 0, 3, 3, 0, 1, 1,  0, 3, 3, 0, 52, 52, 0, 17, 17,  0, 1, 1, 0, 17, 17, 0, 2, 2],
    [0, 1, 1, 0, 17, 17, 0, 2, 2,  0, 3, 3, 0, 52, 52, 0, 17, 17,  0, 0, 0, 0, 3, 3, 0, 1, 1],
    [0, 0, 0, 0, 0, 0, 0, 0, 0,  0, 0, 0, 0, 40, 40, 0, 24, 24,  0, 0, 0, 0, 24, 24, 0, 8, 8],
    [0, 0, 0, 0, 6, 6, 0, 2, 2,  0, 0, 0, 0, 52, 52, 0, 28, 28,  0, 0, 0, 0, 6, 6, 0, 2, 2],
    [0, 0, 0, 0, 24, 24, 0, 8, 8,  0, 0, 0, 0, 40, 40, 0, 24, 24,  0, 0, 0, 0, 0, 0, 0, 0, 0],
    [0, 0, 0, 0, 0, 0, 0, 0, 0,  0, 0, 0, 0, 24, 24, 0, 24, 24,  0, 0, 0, 0, 24, 24, 0, 24, 24],
    [0, 0, 0, 0, 0, 0, 0, 0, 0,  0, 0, 0, 0, 40, 40, 0, 40, 40,  0, 0, 0, 0, 8, 8, 0, 8, 8],
    [0, 0, 0, 0, 8, 8, 0, 8, 8,  0, 0, 0, 0, 40, 40, 0, 40, 40,  0, 0, 0, 0, 0, 0, 0, 0, 0],
    [0, 0, 0, 0, 24, 24, 0, 24, 24,  0, 0, 0, 0, 24, 24, 0, 24, 24,  0, 0, 0, 0, 0, 0, 0, 0, 0],
];

/// The partition with its masks.
///
/// Kind `8 a + 4 [s_a > 0] + 2 q + [s_b > 0]`: a the axis of the face, b = a + 1 + q (modulo 3) that of the edge's middle, with their signs. Canonical
/// coordinates are `X = s_a x_a, Y = s_b x_b, Z = x_c`, c the remaining axis; the tetrahedron is `1/2 >= X >= Y >= |Z|`. A mirror image Z to -Z
/// maps the canonical tetrahedron and its masks to themselves with v2 and v3 exchanged, so the sign of Z does not matter.
pub static TYPE6: TetMasks = masks();

/// Axes (a, b, c) of a kind and the signs of the first two.
#[must_use]
pub const fn frame(kind: usize) -> ([usize; 3], [i8; 2]) {
    let a = kind / 8;
    let q = kind / 2 % 2;
    let b = (a + 1 + q) % 3;
    let (sa, sb) = (kind / 4 % 2, kind % 2);
    ([a, b, 3 - a - b], [2 * sa as i8 - 1, 2 * sb as i8 - 1])
}

const fn masks() -> TetMasks {
    let mut m = TetMasks {
        denominator: DENOMINATOR,
        indices: INDICES,
        vertices: [[[0; 3]; 4]; 24],
        barycentric: [[[0; 4]; 4]; 24],
        weights: [[[0; 27]; 20]; 24],
    };
    let mut kind = 0;
    while kind < 24 {
        let ([a, b, c], [sa, sb]) = frame(kind);
        let v = &mut m.vertices[kind];
        v[1][a] = sa;
        v[2][a] = sa;
        v[2][b] = sb;
        v[2][c] = 1;
        v[3][a] = sa;
        v[3][b] = sb;
        v[3][c] = -1;
        // phi0 = 1 - 2X, phi1 = 2X - 2Y, phi2 = Y + Z, phi3 = Y - Z
        let p = &mut m.barycentric[kind];
        p[0][0] = 1;
        p[0][1 + a] = -2 * sa;
        p[1][1 + a] = 2 * sa;
        p[1][1 + b] = -2 * sb;
        p[2][1 + b] = sb;
        p[2][1 + c] = 1;
        p[3][1 + b] = sb;
        p[3][1 + c] = -1;
        let mut n = 0;
        while n < 27 {
            let o = [(n % 3) as i32 - 1, (n / 3 % 3) as i32 - 1, (n / 9) as i32 - 1];
            // The canonical offset (X, Y, Z) of this one.
            let (x, y, z) = (sa as i32 * o[a], sb as i32 * o[b], o[c]);
            let from = ((z + 1) * 9 + (y + 1) * 3 + x + 1) as usize;
            let mut i = 0;
            while i < 20 {
                m.weights[kind][i][n] = CANONICAL[i][from];
                i += 1;
            }
            n += 1;
        }
        kind += 1;
    }
    m
}
