//! Stages 1 and 2: `s - c` along a stretch of the ray in Bernstein form, with one error bound for all coefficients.
//!
//! On `[s0, s1]` the cell coordinate is `w(tau) = (1 - tau) w0 + tau w1` per axis. The coefficients of the basis function N_i(w(tau)) in
//! Bernstein form of degree d are its blossoms `n_i(w0^(d-m), w1^m)`; they are multi-affine, not negative and sum to one over i
//! for w in [0, 1]. Products of scaled forms are convolutions of non-negative numbers, so every Bernstein coefficient of
//! `sum (c_ijk - c) N_i N_j N_k` is an average of the `c_ijk - c`, and all errors are absolute fractions of `M = max |c_ijk - c|`.
//!
//! **Bound.** U is the unit of rounding, e_w the greatest error of a w (rounding included). w may leave [0, 1] by 2^-10, so the absolute
//! values of blossoms of one axis sum to at most `A = (1 + 2^-9)^d <= 1.006`. Errors of one axis' basis coefficients, summed over i:
//!
//! | d | rounding | of w (each of d arguments has partial derivatives that sum to 2A or less) |
//! |---|---|---|
//! | 1 | `1 - w`: 1.1 U | 2.1 e_w |
//! | 2 | `(1-a)(1-b)/2`: 1.6, `ab/2`: 0.6, `(1 + a(1-b) + b(1-a))/2`: 4.7; 7 U | 4.4 e_w |
//! | 3 | with `e1 = a+b+c, e2 = ab+bc+ca, e3 = abc`: `(1-a)(1-b)(1-c)/6`: 1, `e3/6`: 0.7, `(4 - 2e2 + 3e3)/6`: 7.6, `(1 + e1 + e2 - 3e3)/6`: 8.4; 20 U | 6.5 e_w |
//!
//! Roundings of the contraction, each term at most: x: d+1; binomials of three axes: 3; y and z: (d+1)^2 each; division by the
//! binomial: 2; `c_ijk - c`: 1. With `A^3 <= 1.02` the bound `(K U + W e_w) M` has
//! `K = 1.02 (3 * rounding + 3 + d+1 + 2 (d+1)^2 + 3)` = 1.02 (3.3 + 16, 21 + 27, 60 + 42) < 24, 56, 112 and
//! `W = 1.02 * 3 * (2.1, 4.4, 6.5)` < 8, 16, 24, rounded up to cover second-order terms and the rounding of the bound.

use crate::{
    map::RayMap,
    real::{Dd, Real, two_prod},
};
use isobar_core::Algebraic;

/// Greatest degree along a ray: three exponents of at most 15.
pub(crate) const MOST: usize = 45;

/// A polynomial in Bernstein form on [0, 1] whose coefficients are known to `error`.
#[derive(Clone, Debug)]
pub(crate) struct Bernstein<R> {
    /// Degree.
    pub(crate) n: usize,
    /// `n + 1` coefficients at the front.
    pub(crate) b: [R; MOST + 1],
    /// Bound of the error of each.
    pub(crate) error: f64,
}

impl<R: Real> Bernstein<R> {
    /// The coefficients.
    pub(crate) fn coefficients(&self) -> &[R] {
        &self.b[..=self.n]
    }
}

/// `K` and `W` by degree; see the module.
const ROUNDING: [f64; 4] = [0.0, 24.0, 56.0, 112.0];
const COORDINATE: [f64; 4] = [0.0, 8.0, 16.0, 24.0];

/// Room outside the cell that the bound allows.
const OUTSIDE: f64 = 1.0 / 1024.0;

/// Binomials C(d, m) for d up to 3.
const SMALL: [[f64; 4]; 4] = [
    [1.0, 0.0, 0.0, 0.0],
    [1.0, 1.0, 0.0, 0.0],
    [1.0, 2.0, 1.0, 0.0],
    [1.0, 3.0, 3.0, 1.0],
];

/// The differences `c_ijk - c` of a cell, and their greatest magnitude (rounded up).
#[derive(Clone, Debug)]
pub(crate) struct Differences<R> {
    value: [R; 64],
    /// M.
    pub(crate) most: f64,
}

impl<R: Real> Differences<R> {
    /// Of the first `n` coefficients.
    pub(crate) fn new(stencil: &[f64; 64], n: usize, c: f64) -> Self {
        let mut value = [R::ZERO; 64];
        let mut most = 0.0f64;
        for (v, &x) in value.iter_mut().zip(&stencil[..n]) {
            *v = R::difference(x, c);
            most = most.max(v.f64().abs());
        }
        Self {
            value,
            most: most.next_up(),
        }
    }
}

/// `s - c` of a lattice cell on `[s0, s1]`; `None` where the stretch leaves the cell too far for the bound (or over- or underflow could
/// touch it). `base` holds the v coordinates of the cell's lower corner.
pub(crate) fn lattice<R: Real>(
    map: &RayMap,
    base: [f64; 3],
    (s0, s1): (f64, f64),
    degree: usize,
    c: &Differences<R>,
) -> Option<Bernstein<R>> {
    let mut e_w = 0.0f64;
    let mut weights = [[[R::ZERO; 4]; 4]; 3];
    for a in 0..3 {
        let axis = &map.axes[a];
        let ((w0, e0), (w1, e1)) = (axis.at(s0, base[a]), axis.at(s1, base[a]));
        let inside = |w: f64| (-OUTSIDE..=1.0 + OUTSIDE).contains(&w);
        if !(inside(w0.hi) && inside(w1.hi)) {
            return None;
        }
        // A double-double loses its low part where R is f64: half an ulp of at most 1 + 2^-10, which U bounds (times 1.001).
        e_w = e_w.max(e0.max(e1));
        weights[a] = blossoms(degree, R::from_dd(w0), R::from_dd(w1));
    }
    e_w += 1.001 * R::UNIT;
    // Underflow adds at most 2^-1074 per operation, nothing against M above 2^-900; overflow cannot happen below 2^900.
    if !(c.most == 0.0 || (1e-270..1e270).contains(&c.most)) {
        return None;
    }
    let error = (ROUNDING[degree] * R::UNIT + COORDINATE[degree] * e_w) * c.most;
    let mut out = Bernstein {
        n: 3 * degree,
        b: [R::ZERO; MOST + 1],
        error,
    };
    match degree {
        1 => contract::<R, 2>(&c.value, &weights, &mut out.b),
        2 => contract::<R, 3>(&c.value, &weights, &mut out.b),
        _ => contract::<R, 4>(&c.value, &weights, &mut out.b),
    }
    let reciprocal: &[f64] = match degree {
        1 => &[1.0, 1.0 / 3.0, 1.0 / 3.0, 1.0],
        2 => &[1.0, 1.0 / 6.0, 1.0 / 15.0, 1.0 / 20.0, 1.0 / 15.0, 1.0 / 6.0, 1.0],
        _ => &NINTH,
    };
    for (m, b) in out.b[..=3 * degree].iter_mut().enumerate() {
        // The reciprocal is rounded to f64; for double-double it is corrected by one Newton step on the exact binomial.
        let binomial = R::from_f64((1.0 / reciprocal[m]).round());
        let r = R::from_f64(reciprocal[m]);
        let r = r + r * (R::from_f64(1.0) - binomial * r);
        *b = *b * r;
    }
    Some(out)
}

const NINTH: [f64; 10] = [
    1.0,
    1.0 / 9.0,
    1.0 / 36.0,
    1.0 / 84.0,
    1.0 / 126.0,
    1.0 / 126.0,
    1.0 / 84.0,
    1.0 / 36.0,
    1.0 / 9.0,
    1.0,
];

/// `weights[i][m]`: coefficient m of basis function i in scaled Bernstein form.
fn blossoms<R: Real>(degree: usize, w0: R, w1: R) -> [[R; 4]; 4] {
    let one = R::from_f64(1.0);
    let mut out = [[R::ZERO; 4]; 4];
    match degree {
        1 => {
            out[0] = [one - w0, one - w1, R::ZERO, R::ZERO];
            out[1] = [w0, w1, R::ZERO, R::ZERO];
        }
        2 => {
            let half = R::from_f64(0.5);
            for (m, (a, b)) in [(w0, w0), (w0, w1), (w1, w1)].into_iter().enumerate() {
                let k = R::from_f64(SMALL[2][m]);
                let (a1, b1) = (one - a, one - b);
                out[0][m] = half * a1 * b1 * k;
                out[1][m] = half * (one + (a * b1 + b * a1)) * k;
                out[2][m] = half * a * b * k;
            }
        }
        _ => {
            let sixth = sixth::<R>();
            let (two, three, four) = (R::from_f64(2.0), R::from_f64(3.0), R::from_f64(4.0));
            for (m, (a, b, c)) in [(w0, w0, w0), (w0, w0, w1), (w0, w1, w1), (w1, w1, w1)]
                .into_iter()
                .enumerate()
            {
                let k = R::from_f64(SMALL[3][m]);
                let (e1, ab) = (a + b + c, a * b);
                let (e2, e3) = (ab + b * c + c * a, ab * c);
                let three_e3 = three * e3;
                out[0][m] = (one - a) * (one - b) * (one - c) * sixth * k;
                out[1][m] = (four - two * e2 + three_e3) * sixth * k;
                out[2][m] = (one + e1 + e2 - three_e3) * sixth * k;
                out[3][m] = e3 * sixth * k;
            }
        }
    }
    out
}

/// 1/6 to about one unit of R: one Newton step from the f64.
fn sixth<R: Real>() -> R {
    let x = R::from_f64(1.0 / 6.0);
    x + x * (R::from_f64(1.0) - R::from_f64(6.0) * x)
}

/// x, then y, then z; N = degree + 1.
fn contract<R: Real, const N: usize>(c: &[R; 64], w: &[[[R; 4]; 4]; 3], out: &mut [R; MOST + 1]) {
    for k in 0..N {
        let mut plane = [R::ZERO; 7];
        for j in 0..N {
            let mut row = [R::ZERO; N];
            let at = (k * N + j) * N;
            for i in 0..N {
                for (r, x) in row.iter_mut().zip(&w[0][i][..N]) {
                    *r = *r + c[at + i] * *x;
                }
            }
            for (m, y) in w[1][j][..N].iter().enumerate() {
                for (p, r) in plane[m..].iter_mut().zip(&row) {
                    *p = *p + *r * *y;
                }
            }
        }
        for (m, z) in w[2][k][..N].iter().enumerate() {
            for (o, p) in out[m..].iter_mut().zip(&plane[..2 * N - 1]) {
                *o = *o + *p * *z;
            }
        }
    }
}

/// Binomials C(n, m), exact in f64 for n up to 45 (all below 2^53).
pub(crate) fn binomials(n: usize) -> [f64; MOST + 1] {
    let mut row = [0.0; MOST + 1];
    row[0] = 1.0;
    for i in 1..=n {
        for m in (1..=i).rev() {
            row[m] += row[m - 1];
        }
    }
    row
}

/// `s - c` of one polynomial in world coordinates on `[s0, s1]`, or `None` where magnitudes leave the safe range.
///
/// **Bound.** World coordinates `x_k = alpha_k + s d_k` with `alpha_k = o_k + t_ref d_k`: exact product, exact start, sum `3u^2`; the
/// second product and sum `2u^2 + 3u^2`: error below `2^-102 (|alpha| + |s d|)`, plus U |x| where R is f64. With `B_k = max |x_k|` at
/// the two ends, a scaled form of `x^a` is bounded by that of `B_x^a`. A coefficient of a term of total degree g carries at most
/// `2g` roundings for the powers and their binomials, `g + 2` for two products of forms and one with the coefficient, `n - g + 1`
/// for the elevation, one per term for the sum, 3 for the division: `3n + terms + 8`. The effect of the errors of x is at
/// most `D = sum |c| sum_k a_k B_k^(a_k - 1) e_k prod of the others`. Both are enlarged by 5 % for second-order terms, and the isovalue
/// adds its own magnitude to S, one rounding.
pub(crate) fn algebraic<R: Real>(
    map: &RayMap,
    ray: &isobar_core::Ray,
    function: &Algebraic,
    c: f64,
    (s0, s1): (f64, f64),
) -> Option<Bernstein<R>> {
    let n = function.degree();
    let Powers {
        forms: powers,
        sizes,
        error,
    } = Powers::<R>::new(map, ray, function, (s0, s1));
    let mut out = Bernstein {
        n,
        b: [R::ZERO; MOST + 1],
        error: 0.0,
    };
    let (mut size, mut slope) = (c.abs(), 0.0);
    // Terms are gathered by total degree, so that each degree is elevated once.
    let mut by_degree = vec![None::<[R; MOST + 1]>; n + 1];
    for (e, coefficient) in function.terms.iter() {
        let [a, b, g] = e.map(usize::from);
        let mut term = [R::ZERO; MOST + 1];
        let mut pair = [R::ZERO; 31];
        for (i, x) in powers[0][a][..=a].iter().enumerate() {
            for (o, y) in pair[i..].iter_mut().zip(&powers[1][b][..=b]) {
                *o = *o + *x * *y;
            }
        }
        for (i, z) in powers[2][g][..=g].iter().enumerate() {
            for (o, p) in term[i..].iter_mut().zip(&pair[..=a + b]) {
                *o = *o + *p * *z;
            }
        }
        let k = R::from_f64(*coefficient);
        let sum = by_degree[a + b + g].get_or_insert([R::ZERO; MOST + 1]);
        for (o, t) in sum.iter_mut().zip(&term[..=a + b + g]) {
            *o = *o + *t * k;
        }
        let parts = [sizes[0][a], sizes[1][b], sizes[2][g]];
        let magnitude = coefficient.abs();
        size += magnitude * parts[0] * parts[1] * parts[2];
        for q in 0..3 {
            let p = usize::from(e[q]);
            if p > 0 {
                let others = parts[(q + 1) % 3] * parts[(q + 2) % 3];
                slope += magnitude * p as f64 * sizes[q][p - 1] * others * error[q];
            }
        }
    }
    if !(size == 0.0 || (1e-270..1e270).contains(&size)) {
        return None;
    }
    for (g, form) in by_degree.iter().enumerate() {
        let Some(form) = form else { continue };
        let lift = binomials(n - g);
        for (i, f) in form[..=g].iter().enumerate() {
            for (o, l) in out.b[i..].iter_mut().zip(&lift[..=n - g]) {
                *o = *o + *f * R::from_f64(*l);
            }
        }
    }
    let row = binomials(n);
    for (b, k) in out.b[..=n].iter_mut().zip(&row) {
        let r = R::from_f64(1.0 / k);
        let r = r + r * (R::from_f64(1.0) - R::from_f64(*k) * r);
        *b = *b * r - R::from_f64(c);
    }
    // Repeated products of degree-1 forms cost two roundings a degree, which is the 2g of the bound.
    let count = (3 * n + function.terms.len() + 16) as f64;
    out.error = 1.05 * (count * R::UNIT * size + slope);
    // Underflow: each of fewer than 1e5 operations errs by at most 1e-322, then meets factors of at most these and a binomial below 1e13.
    let factor = |a: f64, b: f64| a.max(1.0) * b.max(1.0);
    let largest = (0..3).fold(1.0, |p, k| factor(p, sizes[k].iter().fold(1.0, |m: f64, &v| m.max(v))));
    let coefficient = function.terms.iter().fold(1.0, |m: f64, (_, c)| m.max(c.abs()));
    out.error += 1e-303 * largest * coefficient;
    if !out.error.is_finite() {
        return None;
    }
    Some(out)
}

/// Powers of the world coordinates along a stretch.
struct Powers<R> {
    /// `[k][a]`: scaled Bernstein form of `x_k^a`, degree a.
    forms: [[[R; 16]; 16]; 3],
    /// `[k][a]`: `B_k^a`.
    sizes: [[f64; 16]; 3],
    /// e_k.
    error: [f64; 3],
}

impl<R: Real> Powers<R> {
    fn new(map: &RayMap, ray: &isobar_core::Ray, function: &Algebraic, (s0, s1): (f64, f64)) -> Self {
        let mut ends = [[R::ZERO; 2]; 3];
        let (mut most, mut error) = ([0.0f64; 3], [0.0f64; 3]);
        for k in 0..3 {
            let alpha = two_prod(map.t_ref, ray.direction[k]) + Dd::new(ray.origin[k]);
            for (i, s) in [s0, s1].into_iter().enumerate() {
                let step = two_prod(s, ray.direction[k]);
                let x = alpha + step;
                ends[k][i] = R::from_dd(x);
                most[k] = most[k].max(x.abs());
                error[k] = error[k].max(1.98e-31 * (alpha.abs() + step.abs()));
            }
            most[k] *= 1.0 + 1e-15;
            error[k] += R::UNIT * most[k];
        }
        let mut forms = [[[R::ZERO; 16]; 16]; 3];
        let mut sizes = [[1.0f64; 16]; 3];
        for k in 0..3 {
            let highest = function
                .terms
                .iter()
                .map(|(e, _)| usize::from(e[k]))
                .max()
                .unwrap_or(0)
                .min(15);
            let [x0, x1] = ends[k];
            forms[k][0][0] = R::from_f64(1.0);
            for a in 1..=highest {
                sizes[k][a] = sizes[k][a - 1] * most[k];
                // (x0 Y + x1 X) times the previous form: a + 1 coefficients, each C(a, m) x0^(a-m) x1^m. One product and one sum a degree.
                for m in 0..=a {
                    let left = if m < a { forms[k][a - 1][m] * x0 } else { R::ZERO };
                    let right = if m > 0 { forms[k][a - 1][m - 1] * x1 } else { R::ZERO };
                    forms[k][a][m] = left + right;
                }
            }
        }
        Self { forms, sizes, error }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        exact::{ExactRay, Ratio, Span, lattice_piece},
        map::{LocalMap, Mapped},
    };
    use dashu_int::IBig;
    use isobar_core::{Basis1, CUBIC, DMat3, DVec3, Domain, QUADRATIC, Ray, TRILINEAR};

    struct Random(u64);

    impl Random {
        fn unit(&mut self) -> f64 {
            self.0 = self
                .0
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (self.0 >> 11) as f64 / (1u64 << 53) as f64
        }
        fn vector(&mut self, a: f64, b: f64) -> DVec3 {
            DVec3::new(self.unit(), self.unit(), self.unit()) * (b - a) + a
        }
    }

    fn map(domain: &Domain, centred: bool, ray: &Ray) -> RayMap {
        match LocalMap::new(domain, centred).unwrap().map(ray) {
            Mapped::Ray(map) => *map,
            other => panic!("{other:?}"),
        }
    }

    /// Greatest |coefficient - exact one| over the bound, over random cells, rays and stretches.
    fn worst<R: Real + Parts>(basis: &'static Basis1, random: &mut Random) -> f64 {
        let n = (basis.degree + 1).pow(3);
        let axes = DMat3::from_cols(
            DVec3::new(0.7, 0.1, 0.0),
            DVec3::new(0.0, 1.3, -0.2),
            DVec3::new(0.05, 0.0, 0.9),
        );
        let domain = Domain {
            origin: DVec3::new(0.3, -0.4, 1.7),
            axes,
            lo: DVec3::ZERO,
            hi: DVec3::splat(9.0),
        };
        let mut worst = 0.0f64;
        for _ in 0..150 {
            let inside = axes * random.vector(1.0, 8.0) + domain.origin;
            let ray = Ray {
                origin: inside,
                direction: random.vector(-1.0, 1.0),
            };
            let map = map(&domain, basis.centred, &ray);
            let exact = ExactRay::new(&ray, &domain, basis.centred).unwrap();
            let cell = exact.cell_at(&Ratio::from_f64(0.0), [10; 3], false);
            let end = exact.span(cell, [10; 3]).unwrap().t1.bounds().0;
            let (s0, s1) = (end * 0.25 * random.unit(), end * (0.5 + 0.5 * random.unit()));
            let mut stencil = [0.0; 64];
            stencil[..n].iter_mut().for_each(|v| *v = random.unit() * 2.0 - 1.0);
            let c = random.unit() - 0.5;
            let d = Differences::<R>::new(&stencil, n, c);
            assert!(map.t_ref.abs() < 1e-300);
            let p = lattice::<R>(&map, cell.map(|i| i as f64), (s0, s1), basis.degree, &d).unwrap();
            let span = Span {
                t0: Ratio::from_f64(s0),
                t1: Ratio::from_f64(s1),
                closed: false,
            };
            let piece = lattice_piece(&exact, cell, span, basis, &stencil, c);
            // Exact: coefficient i is b_i / binomial * M / most, with M the exact greatest difference.
            let most = stencil[..n]
                .iter()
                .map(|&v| {
                    let (v, c) = (Ratio::from_f64(v), Ratio::from_f64(c));
                    let x = Ratio::new(&v.n * &c.d - &c.n * &v.d, &v.d * &c.d);
                    if x.n < IBig::ZERO { Ratio::new(-x.n, x.d) } else { x }
                })
                .reduce(Ratio::max)
                .unwrap();
            let row = binomials(3 * basis.degree);
            for (i, b) in p.coefficients().iter().enumerate() {
                let binomial = IBig::from(row[i] as i64);
                let want = Ratio::new(&piece.b[i] * &most.n, &piece.most * &most.d * binomial);
                let parts = b.parts();
                let got = [parts.0, parts.1].map(Ratio::from_f64);
                let got = Ratio::new(&got[0].n * &got[1].d + &got[1].n * &got[0].d, &got[0].d * &got[1].d);
                let error = Ratio::new(&got.n * &want.d - &want.n * &got.d, got.d * want.d).bounds();
                worst = worst.max(error.0.abs().max(error.1.abs()) / p.error);
            }
        }
        worst
    }

    trait Parts {
        fn parts(&self) -> (f64, f64);
    }
    impl Parts for f64 {
        fn parts(&self) -> (f64, f64) {
            (*self, 0.0)
        }
    }
    impl Parts for Dd {
        fn parts(&self) -> (f64, f64) {
            (self.hi, self.lo)
        }
    }

    /// The proved bound holds, and is not absurdly large: rounding errors of random data stay within it and exceed 1e-5 of it (double-double in a
    /// sheared domain: the bound of the map rules there).
    #[test]
    fn lattice_coefficients_keep_their_bound() {
        let mut random = Random(3);
        for basis in [&TRILINEAR, &QUADRATIC, &CUBIC] {
            for worst in [worst::<f64>(basis, &mut random), worst::<Dd>(basis, &mut random)] {
                assert!((1e-5..1.0).contains(&worst), "degree {}: {worst}", basis.degree);
            }
        }
    }

    /// f64 against double-double, whose own bound is 2^-50 of it.
    #[test]
    fn algebraic_coefficients_keep_their_bound() {
        let mut random = Random(4);
        let domain = Domain::world_box(DVec3::splat(-2.0), DVec3::splat(2.0));
        let mut worst = 0.0f64;
        for n in 0..200u32 {
            let terms: Vec<([u8; 3], f64)> = (0..8)
                .map(|_| {
                    let e = random.vector(0.0, if n % 2 == 0 { 3.0 } else { 5.9 });
                    (e.to_array().map(|x| x as u8), random.unit() * 2.0 - 1.0)
                })
                .collect();
            let f = Algebraic {
                name: "random".into(),
                terms: terms.into(),
                lo: domain.lo,
                hi: domain.hi,
            };
            let target = random.vector(-1.0, 1.0);
            let origin = random.vector(-3.0, 3.0) * if n % 3 == 0 { 1000.0 } else { 1.0 };
            let ray = Ray {
                origin,
                direction: (target - origin).normalize(),
            };
            let map = map(&domain, false, &ray);
            let range = (map.start.0, map.end.1);
            let a = algebraic::<f64>(&map, &ray, &f, 0.25, range).unwrap();
            let b = algebraic::<Dd>(&map, &ray, &f, 0.25, range).unwrap();
            assert!(b.error < 1e-13 * a.error);
            for (x, y) in a.coefficients().iter().zip(b.coefficients()) {
                worst = worst.max(((y.hi - x) + y.lo).abs() / (a.error + b.error));
            }
        }
        assert!((1e-3..1.0).contains(&worst), "{worst}");
    }
}
