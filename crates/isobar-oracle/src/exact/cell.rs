//! Exact composition of a cell's polynomial, or of an algebraic function, with the ray.

use super::{
    number::{Dyadic, sign},
    ray::{ExactRay, Span},
    scaled::{Piece, convolve},
};
use dashu_int::IBig;
use isobar_core::{Algebraic, Basis1, Ray};

/// `s - c` on a cell along its span: degree `3 * basis.degree`, up to a positive factor. `stencil` holds the cell's coefficients, x
/// fastest. `sum_ijk (c_ijk - c) N_i(w_x) N_j(w_y) N_k(w_z)`, because the basis sums to one.
pub(crate) fn lattice_piece(ray: &ExactRay, cell: [usize; 3], span: Span, basis: &Basis1, stencil: &[f64], c: f64) -> Piece {
    let n = basis.degree + 1;
    let mut all: Vec<Dyadic> = stencil[..n * n * n].iter().map(|&v| Dyadic::from_f64(v)).collect();
    all.push(Dyadic::from_f64(c));
    let mut coefficients = Dyadic::integers(&all);
    let c = coefficients.pop().unwrap_or(IBig::ZERO);
    for v in &mut coefficients {
        *v -= &c;
    }
    let mut most = coefficients
        .iter()
        .map(|v| if sign(v) < 0 { -v } else { v.clone() })
        .max()
        .unwrap_or(IBig::ZERO);
    // Contract x, then y, then z; each step multiplies by a form of degree n - 1.
    let mut layers: Vec<Vec<IBig>> = coefficients.into_iter().map(|v| vec![v]).collect();
    for (a, &base) in cell.iter().enumerate() {
        let weights = basis_along(ray, a, base as i64, &span, basis);
        // The weights sum to this times (X + Y)^degree.
        most *= weights.iter().map(|w| &w[0]).sum::<IBig>();
        layers = layers
            .chunks(n)
            .map(|row| {
                let mut sum = vec![IBig::ZERO; row[0].len() + n - 1];
                for (v, w) in row.iter().zip(&weights) {
                    for (s, x) in sum.iter_mut().zip(convolve(v, w)) {
                        *s += x;
                    }
                }
                sum
            })
            .collect();
    }
    Piece {
        b: layers.swap_remove(0),
        t0: span.t0,
        t1: span.t1,
        closed: span.closed,
        most,
    }
}

/// The scaled Bernstein forms (integers, one common positive factor) of the basis functions along axis a on the span.
fn basis_along(ray: &ExactRay, a: usize, base: i64, span: &Span, basis: &Basis1) -> Vec<Vec<IBig>> {
    let n = basis.degree;
    let (e0, e1, f) = ray.ends(a, base, &span.t0, &span.t1);
    // w = (e0 Y + e1 X)/f; w^k f^n = (e0 Y + e1 X)^k (f (X + Y))^(n-k)
    let powers = |line: &[IBig; 2]| -> Vec<Vec<IBig>> {
        let mut p = vec![vec![IBig::ONE]];
        for k in 0..n {
            p.push(convolve(&p[k], line));
        }
        p
    };
    let (w, one) = (powers(&[e0, e1]), powers(&[f.clone(), f]));
    let monomials: Vec<Vec<IBig>> = (0..=n).map(|k| convolve(&w[k], &one[n - k])).collect();
    (0..=n)
        .map(|j| {
            let mut form = vec![IBig::ZERO; n + 1];
            for (k, m) in monomials.iter().enumerate() {
                let weight = IBig::from(basis.matrix[k][j]);
                for (s, x) in form.iter_mut().zip(m) {
                    *s += &weight * x;
                }
            }
            form
        })
        .collect()
}

/// `s - c` of one polynomial in world coordinates on a closed span.
pub(crate) fn algebraic_piece(ray: &Ray, function: &Algebraic, c: f64, span: Span) -> Piece {
    let degree = function.degree();
    let line = |a: usize| vec![Dyadic::from_f64(ray.origin[a]), Dyadic::from_f64(ray.direction[a])];
    let zero = || Dyadic::from_f64(0.0);
    let product = |a: &[Dyadic], b: &[Dyadic]| -> Vec<Dyadic> {
        let mut r = vec![zero(); a.len() + b.len() - 1];
        for (i, x) in a.iter().enumerate() {
            for (j, y) in b.iter().enumerate() {
                r[i + j] = r[i + j].plus(&x.times(y));
            }
        }
        r
    };
    let powers: [Vec<Vec<Dyadic>>; 3] = std::array::from_fn(|a| {
        let most = function.terms.iter().map(|(e, _)| usize::from(e[a])).max().unwrap_or(0);
        let mut p = vec![vec![Dyadic::from_f64(1.0)]];
        for k in 0..most {
            p.push(product(&p[k], &line(a)));
        }
        p
    });
    let mut sum = vec![zero(); degree + 1];
    sum[0] = Dyadic::from_f64(-c);
    for ([x, y, z], k) in function.terms.iter() {
        let xy = product(&powers[0][usize::from(*x)], &powers[1][usize::from(*y)]);
        let term = product(&xy, &powers[2][usize::from(*z)]);
        let k = Dyadic::from_f64(*k);
        for (s, t) in sum.iter_mut().zip(&term) {
            *s = s.plus(&t.times(&k));
        }
    }
    Piece::from_power(&Dyadic::integers(&sum), span.t0, span.t1)
}
