//! The tetrahedra of one cube: coefficients on the fly, and the univariate cubic on the ray by blossoming.
//!
//! Kalbe et al. 2009, section 4.4: with the barycentric coordinates a at the entry and b at the exit of the ray, `b30 = bl[a, a, a]`, `b21 = bl[a, a, b]`, `b12 = bl[a, b, b]`,
//! `b03 = bl[b, b, b]`; de Casteljau's first step is shared (10 + 10 inner products), then 4 + 4, then 4. Different here: the exit is the tetrahedron's own (the paper takes
//! a point one unit behind the entry), so that the Bernstein coefficients enclose the cubic where it counts; and since the pieces join with C1, value and slope at the entry are
//! those at the exit of the tetrahedron before: of the 32 inner products 16 are left, by [`jet`] at the exit.

use isobar_fields::type6::{TYPE6, coefficients, frame, two_steps};

/// For each kind, where the data in canonical order lie among the 27 of the cube.
static ORDER: [[u8; 32]; 24] = order();

const fn order() -> [[u8; 32]; 24] {
    let mut all = [[0; 32]; 24];
    let mut kind = 0;
    while kind < 24 {
        let ([a, b, c], [sa, sb]) = frame(kind);
        let stride = [1, 3, 9];
        let mut n = 0;
        while n < 27 {
            let (x, y, z) = (n % 3 - 1, n / 3 % 3 - 1, n / 9 - 1);
            let at = 13 + sa as i32 * x * stride[a] + sb as i32 * y * stride[b] + z * stride[c];
            all[kind][n as usize] = at as u8;
            n += 1;
        }
        kind += 1;
    }
    all
}

/// Data of a cube minus a reference; the last five entries are not used.
pub(crate) type Data = [f64; 32];

/// The 20 Bernstein-Bezier coefficients of a kind.
#[inline(always)]
pub(crate) fn patch(data: &Data, kind: usize) -> [f64; 20] {
    let order = &ORDER[kind];
    let mut d = [0.0; 27];
    for n in 0..27 {
        d[n] = data[usize::from(order[n] & 31)];
    }
    coefficients(&d)
}

/// Barycentric coordinates of a point, in grid steps from the centre.
#[inline(always)]
pub(crate) fn barycentric(kind: usize, p: [f64; 3]) -> [f64; 4] {
    let ([a, b, c], [sa, sb]) = frame(kind);
    let (x, y, z) = (f64::from(sa) * p[a], f64::from(sb) * p[b], p[c]);
    [1.0 - 2.0 * x, 2.0 * (x - y), y + z, y - z]
}

/// Barycentric coordinates of a displacement.
#[inline(always)]
pub(crate) fn barycentric_step(kind: usize, d: [f64; 3]) -> [f64; 4] {
    let ([a, b, c], [sa, sb]) = frame(kind);
    let (x, y, z) = (f64::from(sa) * d[a], f64::from(sb) * d[b], d[c]);
    [-2.0 * x, 2.0 * (x - y), y + z, y - z]
}

/// Value of s and its change per unit of a displacement at a point: 14 inner products and two, K14's without the mixed ones.
#[inline(always)]
pub(crate) fn jet(b: &[f64; 20], phi: [f64; 4], step: [f64; 4]) -> [f64; 2] {
    let dot = |p: [f64; 4], l: [f64; 4]| (p[0] * l[0] + p[1] * l[1]) + (p[2] * l[2] + p[3] * l[3]);
    let l = two_steps(b, phi);
    [dot(phi, l), 3.0 * dot(step, l)]
}

/// The cubic along the segment between two points of a tetrahedron, in Bernstein form (the paper's way; [`jet`] at the ends gives the same).
#[cfg(test)]
pub(crate) fn blossom(b: &[f64; 20], from: [f64; 4], to: [f64; 4]) -> [f64; 4] {
    let dot = |p: [f64; 4], l: [f64; 4]| (p[0] * l[0] + p[1] * l[1]) + (p[2] * l[2] + p[3] * l[3]);
    let (l, m) = (two_steps(b, from), two_steps(b, to));
    [dot(from, l), dot(to, l), dot(from, m), dot(to, m)]
}

/// Gradient in index space at the point `(1 - x) from + x to` (K17: de Casteljau's first step is multi-affine; here it is done again at the point, once per hit).
#[inline(always)]
pub(crate) fn gradient(b: &[f64; 20], kind: usize, phi: [f64; 4]) -> [f64; 3] {
    let l = two_steps(b, phi);
    let rows = &TYPE6.barycentric[kind];
    let mut g = [0.0; 3];
    for a in 0..3 {
        g[a] = 3.0 * (0..4).map(|v| f64::from(rows[v][1 + a]) * l[v]).sum::<f64>();
    }
    g
}

#[cfg(test)]
mod tests {
    use super::*;
    use isobar_fields::type6::{canonical, canonical_gradient, from_canonical, last_step, reorder};

    #[test]
    fn patches_and_blossoms_are_those_of_the_spline() {
        let mut s = 1u64;
        let mut next = || {
            s = s
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (s >> 11) as f64 / (1u64 << 53) as f64
        };
        for kind in 0..24 {
            let d: [f64; 27] = std::array::from_fn(|_| next());
            let mut padded = [0.0; 32];
            padded[..27].copy_from_slice(&d);
            let b = patch(&padded, kind);
            assert_eq!(b, coefficients(&reorder(kind, &d)));
            let (p, q): ([f64; 3], [f64; 3]) = (std::array::from_fn(|_| next() - 0.5), std::array::from_fn(|_| next() - 0.5));
            let (phi, psi) = (barycentric(kind, p), barycentric(kind, q));
            assert_eq!(phi, isobar_fields::type6::barycentric(canonical(kind, p)));
            let c = blossom(&b, phi, psi);
            // The same from values and slopes at the ends.
            let along = barycentric_step(kind, std::array::from_fn(|a| q[a] - p[a]));
            let ([v, s], [w, r]) = (jet(&b, phi, along), jet(&b, psi, along));
            let ends = [v, v + s / 3.0, w - r / 3.0, w];
            assert!((0..4).all(|i| (ends[i] - c[i]).abs() < 1e-13), "{ends:?} {c:?}");
            for n in 0..=8 {
                let x = f64::from(n) / 8.0;
                let at: [f64; 4] = std::array::from_fn(|v| (1.0 - x) * phi[v] + x * psi[v]);
                let (y, z) = (1.0 - x, x);
                let cubic = y * y * y * c[0] + 3.0 * y * y * z * c[1] + 3.0 * y * z * z * c[2] + z * z * z * c[3];
                let l = two_steps(&b, at);
                assert!((cubic - last_step(l, at)).abs() < 1e-12);
                let g = from_canonical(kind, canonical_gradient(l));
                let h = gradient(&b, kind, at);
                assert!((0..3).all(|a| (g[a] - h[a]).abs() < 1e-12));
            }
        }
    }
}
