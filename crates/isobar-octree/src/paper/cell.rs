//! A cell as printed, in f32: from its coefficients to the first root of the polynomial along the ray, and to the normal there (thesis, section 3.3.3, steps 5b to 5f).

use crate::compose::{Basis, Form, compose, powers_of_samples, scale_of_samples, to_scaled};
use crate::finders::{Answer, Finder, sturm};

/// One axis of the B-spline's coefficients into the scaled Bernstein form, times the denominator 1, 2 or 6 (thesis, section 3.3.1; maths, corrections, section B: the last
/// row of degree 2 is 0, 1, 1, printed 0, 2, 1).
#[inline(always)]
fn axis<const D: usize>([a, b, c, d]: [f32; 4]) -> [f32; 4] {
    match D {
        1 => [a, b, 0.0, 0.0],
        2 => [a + b, 4.0 * b, b + c, 0.0],
        _ => [a + 4.0 * b + c, 12.0 * b + 6.0 * c, 6.0 * b + 12.0 * c, b + 4.0 * c + d],
    }
}

/// The scaled Bernstein form on [0, 1]^3 of the cell with the (D + 1)^3 coefficients `samples`, x fastest, times the cube of the denominator, into `f` as
/// [`compose`] wants it: 3 (D + 1)^2 transforms of one axis.
#[inline(always)]
pub(super) fn scaled_of_samples<const D: usize>(samples: &[f32], f: &mut [f32]) {
    let n = D + 1;
    let line = |get: &dyn Fn(usize) -> f32| axis::<D>(std::array::from_fn(|i| if i < n { get(i) } else { 0.0 }));
    let (mut x, mut y) = ([0.0; 64], [0.0; 64]);
    for r in 0..n * n {
        x[r * n..][..n].copy_from_slice(&line(&|i| samples[r * n + i])[..n]);
    }
    for k in 0..n {
        for i in 0..n {
            let p = line(&|j| x[(k * n + j) * n + i]);
            for j in 0..n {
                y[(k * n + j) * n + i] = p[j];
            }
        }
    }
    for j in 0..n {
        for i in 0..n {
            let p = line(&|k| y[(k * n + j) * n + i]);
            f[(i * n + j) * n..][..n].copy_from_slice(&p[..n]);
        }
    }
}

/// Binomial coefficients of degree n.
const fn binomials<const M: usize>() -> [f32; M] {
    let mut out = [1.0; M];
    let mut i = 1;
    while i < M {
        out[i] = out[i - 1] * (M - i) as f32 / i as f32;
        i += 1;
    }
    out
}

/// The polynomial of a cell along a stretch of a ray, which is [0, 1], times e.
#[derive(Debug, Clone, Copy)]
pub(super) struct Along<const M: usize> {
    p: [f32; M],
    basis: Basis,
}

/// What the function is scaled by: e = 1, 8 or 216.
pub(super) const fn scale<const D: usize>() -> f32 {
    let e = scale_of_samples::<D>();
    (e * e * e) as f32
}

/// Steps 5b and 5c: `from` and `to` are where the ray enters and leaves the cell, in its unit cube.
#[inline(always)]
pub(super) fn along<const D: usize, const M: usize>(form: Form, samples: &[f32; 64], from: [f32; 3], to: [f32; 3]) -> Along<M> {
    let n = (D + 1) * (D + 1) * (D + 1);
    let (mut f, mut p) = ([0.0; 64], [0.0; M]);
    let basis = form.basis();
    let ray = if basis == Basis::Power {
        powers_of_samples::<f32, D>(&samples[..n], &mut f[..n]);
        [0, 1, 2].map(|a| [from[a], to[a] - from[a]])
    } else {
        scaled_of_samples::<D>(&samples[..n], &mut f[..n]);
        [0, 1, 2].map(|a| [from[a], to[a]])
    };
    compose::<f32, D>(form, &f[..n], &ray, &mut p);
    Along { p, basis }
}

impl<const M: usize> Along<M> {
    /// Steps 5d and 5e: the first root on [0, 1] of e f - e c. The isovalue is taken off the constant of the power form, or off all coefficients of the scaled Bernstein form, where it is
    /// e c times the binomials. The finders want Bernstein coefficients, Sturm's chain powers; power form becomes scaled Bernstein form by
    /// additions, and where Sturm's chain follows a composition in scaled Bernstein form the powers are made in f64 and rounded.
    #[inline(always)]
    pub(super) fn first_root(&self, finder: Finder, scaled_isovalue: f32) -> Option<f32> {
        let mut p = self.p;
        let binomials = const { binomials::<M>() };
        if self.basis == Basis::Power {
            p[0] -= scaled_isovalue;
            if let Finder::Sturm { halvings } = finder {
                return sturm(&p, halvings);
            }
            to_scaled(&mut p);
        } else {
            for (p, k) in p.iter_mut().zip(&binomials) {
                *p -= k * scaled_isovalue;
            }
        }
        for (p, k) in p.iter_mut().zip(&binomials) {
            *p /= k;
        }
        match finder.first_of(&p) {
            Answer::Root(t) | Answer::Touching(t) => Some(t),
            Answer::None | Answer::GaveUp => None,
        }
    }
}

/// The gradient of the function in index space, by Horner's scheme in power form.
pub(super) fn gradient<const D: usize>(samples: &[f32; 64], [x, y, z]: [f32; 3]) -> [f32; 3] {
    let n = D + 1;
    let mut f = [0.0; 64];
    powers_of_samples::<f32, D>(&samples[..n * n * n], &mut f[..n * n * n]);
    // Value and slope of a polynomial.
    let horner = |t: f32, get: &dyn Fn(usize) -> f32| {
        (0..n)
            .rev()
            .fold((0.0, 0.0), |(v, s): (f32, f32), i| (v * t + get(i), s * t + v))
    };
    let mut planes = [[0.0; 3]; 4];
    for (i, plane) in planes.iter_mut().enumerate().take(n) {
        let mut rows = [(0.0, 0.0); 4];
        for (j, row) in rows.iter_mut().enumerate().take(n) {
            *row = horner(z, &|k| f[(i * n + j) * n + k]);
        }
        let (value, along_y) = horner(y, &|j| rows[j].0);
        *plane = [value, along_y, horner(y, &|j| rows[j].1).0];
    }
    let e = scale::<D>();
    [
        horner(x, &|i| planes[i][0]).1 / e,
        horner(x, &|i| planes[i][1]).0 / e,
        horner(x, &|i| planes[i][2]).0 / e,
    ]
}

#[cfg(test)]
impl<const M: usize> Along<M> {
    /// The polynomial at t, in f64.
    pub(super) fn value(&self, t: f64) -> f64 {
        let power = |x: f64, n: usize| x.powi(n as i32);
        let rest = |i: usize| {
            if self.basis == Basis::Power {
                1.0
            } else {
                power(1.0 - t, M - 1 - i)
            }
        };
        (0..M).map(|i| f64::from(self.p[i]) * power(t, i) * rest(i)).sum()
    }
}
