//! The frustum form of Reimers and Seland (Computer Graphics Forum 27, 2008; thesis, section 6.1): a polynomial in coordinates of the view.
//!
//! A point of the view frustum is p(u, v, t) = (1 - t) near(u, v) + t far(u, v), with u, v in [0, 1] across the image and t from the near plane to
//! the far one. f(p(u, v, t)) is a polynomial of degree n in each of u, v, t if f has total degree n. Its coefficients are worked out once
//! per view: f is sampled at (n + 1)^3 points and the samples are multiplied by the inverse collocation matrix along each axis. A ray is a pair (u, v): its polynomial in t is
//! got by evaluating along two axes, with no composition. The thesis prints no listing and had the authors' program; this is written after its description.
//!
//! All in the scaled Bernstein form (weights x^i (1 - x)^(n - i), binomials inside the coefficients), as the thesis's compositions, so that what they give can
//! be compared coefficient by coefficient.

use crate::compose::Scalar;
use glam::DVec3;
use isobar_core::View;
use isobar_poly::Real;

/// The part of the world between two planes across the line of sight that the image shows.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Frustum {
    /// Corner u = v = 0 (upper left) and the edges along u and v, world.
    near: [DVec3; 3],
    far: [DVec3; 3],
}

impl Frustum {
    /// The frustum of a view between the planes at depths `near` and `far` along the line of sight (world units, near < far); `None` for lists of rays,
    /// and in perspective where `near` is not positive.
    #[must_use]
    pub fn new(view: &View, near: f64, far: f64) -> Option<Self> {
        let lens = view.lens()?;
        let aspect = view.width as f64 / view.height as f64;
        let plane = |depth: f64| {
            let half = if lens.parallel { lens.half } else { lens.half * depth };
            let (x, y) = (lens.right * (half * aspect), lens.up * half);
            [lens.eye + lens.forward * depth - x + y, x * 2.0, y * -2.0]
        };
        let in_front = near > 0.0 || lens.parallel;
        (in_front && near < far).then(|| Self {
            near: plane(near),
            far: plane(far),
        })
    }

    /// The frustum whose planes touch the sphere round the box from `lo` to `hi`; `None` as [`Frustum::new`], also where the eye lies inside that sphere.
    #[must_use]
    pub fn around(view: &View, lo: DVec3, hi: DVec3) -> Option<Self> {
        let lens = view.lens()?;
        let depth = ((lo + hi) * 0.5 - lens.eye).dot(lens.forward);
        let radius = (hi - lo).length() * 0.5;
        Self::new(view, depth - radius, depth + radius)
    }

    /// near(u, v) and far(u, v).
    #[must_use]
    #[inline]
    pub fn ends(&self, u: f64, v: f64) -> [DVec3; 2] {
        [self.near, self.far].map(|[corner, along_u, along_v]| corner + along_u * u + along_v * v)
    }

    /// p(u, v, t).
    #[must_use]
    #[inline]
    pub fn at(&self, u: f64, v: f64, t: f64) -> DVec3 {
        let [near, far] = self.ends(u, v);
        near * (1.0 - t) + far * t
    }
}

/// Weights of the scaled Bernstein form of degree M - 1: x^i (1 - x)^(M - 1 - i).
#[must_use]
#[inline]
pub fn weights<T: Scalar, const M: usize>(x: T) -> [T; M] {
    const { assert!(M >= 2 && M <= 10, "degrees 1 to 9") };
    let y = T::ONE - x;
    let (mut up, mut down) = ([T::ONE; M], [T::ONE; M]);
    (up[1], down[1]) = (x, y);
    for i in 2..M {
        up[i] = up[i - 1] * x;
        down[i] = down[i - 1] * y;
    }
    // Not multiplied where the other factor is the constant 1.
    std::array::from_fn(|i| match i {
        0 => down[M - 1],
        i if i == M - 1 => up[i],
        i => up[i] * down[M - 1 - i],
    })
}

/// A polynomial in the coordinates of a frustum, of degree M - 1 in each of u, v, t.
#[derive(Debug, Clone, PartialEq)]
pub struct FrustumForm<T, const M: usize> {
    /// Coefficient of v's weight j, u's weight i and t's weight k at `(j M + i) M + k`.
    coefficients: Vec<T>,
}

/// The polynomials of one row of pixels, v being the same: [`FrustumForm::row`].
#[derive(Debug, Clone, PartialEq)]
pub struct Row<T, const M: usize>([[T; M]; M]);

impl<const M: usize> FrustumForm<f64, M> {
    /// The frustum form of `f`, whose degree along any line is at most M - 1: the pre-calculation of the thesis's Figure 6.1, M^3 values of f and 3 M^4
    /// multiplications.
    ///
    /// Samples lie at Chebyshev's extrema (1 - cos(pi a / n)) / 2 of [0, 1]; with these the inverse matrix of degree 9 loses some three digits along an axis,
    /// uniform places lose one more. No bound is claimed.
    #[must_use]
    pub fn new(f: impl Fn(DVec3) -> f64, frustum: &Frustum) -> Self {
        let at: [f64; M] = std::array::from_fn(|a| 0.5 - 0.5 * (std::f64::consts::PI * a as f64 / (M - 1) as f64).cos());
        let mut c = Vec::with_capacity(M * M * M);
        for v in at {
            for u in at {
                c.extend(at.iter().map(|&t| f(frustum.at(u, v, t))));
            }
        }
        let inverse = collocation_inverse(&at);
        for stride in [1, M, M * M] {
            along(&mut c, stride, &inverse);
        }
        Self { coefficients: c }
    }

    /// With coefficients of another type, each rounded once.
    #[must_use]
    pub fn rounded<T: Real>(&self) -> FrustumForm<T, M> {
        FrustumForm {
            coefficients: self.coefficients.iter().map(|&c| T::from_f64(c)).collect(),
        }
    }
}

impl<T: Scalar, const M: usize> FrustumForm<T, M> {
    /// The coefficients, that of v's weight j, u's weight i and t's weight k at `(j M + i) M + k`.
    #[must_use]
    pub fn coefficients(&self) -> &[T] {
        &self.coefficients
    }

    /// From coefficients as [`FrustumForm::coefficients`] gives them; `None` where there are not M^3.
    #[must_use]
    pub fn from_coefficients(coefficients: Vec<T>) -> Option<Self> {
        (coefficients.len() == M * M * M).then_some(Self { coefficients })
    }

    /// The polynomial of the ray (u, v), scaled Bernstein form over [0, 1], from the [`weights`] of u and v: M^2 (M + 1) multiplications. Every ray for
    /// itself, as a fragment shader has to.
    #[must_use]
    #[inline]
    pub fn ray(&self, u: &[T; M], v: &[T; M]) -> [T; M] {
        self.row(v).ray(u)
    }

    /// What the rays of one row of pixels share: M^3 multiplications, once per row.
    #[must_use]
    #[inline]
    pub fn row(&self, v: &[T; M]) -> Row<T, M> {
        let mut row = [[T::ZERO; M]; M];
        for (j, &weight) in v.iter().enumerate() {
            for (i, out) in row.iter_mut().enumerate() {
                let c = &self.coefficients[(j * M + i) * M..][..M];
                for (o, &c) in out.iter_mut().zip(c) {
                    *o = if j == 0 { c * weight } else { *o + c * weight };
                }
            }
        }
        Row(row)
    }
}

impl<T: Scalar, const M: usize> Row<T, M> {
    /// The polynomial of the ray with these [`weights`] of u: M^2 multiplications.
    #[must_use]
    #[inline]
    pub fn ray(&self, u: &[T; M]) -> [T; M] {
        let mut out = [T::ZERO; M];
        for (i, (c, &weight)) in self.0.iter().zip(u).enumerate() {
            for (o, &c) in out.iter_mut().zip(c) {
                *o = if i == 0 { c * weight } else { *o + c * weight };
            }
        }
        out
    }
}

/// Multiplies by a matrix along the axis with this stride, in place.
fn along<const M: usize>(c: &mut [f64], stride: usize, matrix: &[[f64; M]; M]) {
    for first in (0..c.len()).filter(|n| (n / stride).is_multiple_of(M)) {
        let line: [f64; M] = std::array::from_fn(|a| c[first + a * stride]);
        for (i, row) in matrix.iter().enumerate() {
            c[first + i * stride] = row.iter().zip(line).map(|(m, x)| m * x).sum();
        }
    }
}

/// The inverse of `[weights(x) for x in at]`, by Gauss and Jordan with pivots.
fn collocation_inverse<const M: usize>(at: &[f64; M]) -> [[f64; M]; M] {
    let mut a: [[f64; M]; M] = at.map(weights::<f64, M>);
    let mut inverse: [[f64; M]; M] = std::array::from_fn(|i| std::array::from_fn(|j| if i == j { 1.0 } else { 0.0 }));
    for k in 0..M {
        let pivot = (k..M).fold(k, |p, i| if a[i][k].abs() > a[p][k].abs() { i } else { p });
        a.swap(k, pivot);
        inverse.swap(k, pivot);
        let scale = 1.0 / a[k][k];
        a[k] = a[k].map(|x| x * scale);
        inverse[k] = inverse[k].map(|x| x * scale);
        let (row, row_of_inverse) = (a[k], inverse[k]);
        for i in (0..M).filter(|&i| i != k) {
            let factor = a[i][k];
            for j in 0..M {
                a[i][j] -= factor * row[j];
                inverse[i][j] -= factor * row_of_inverse[j];
            }
        }
    }
    inverse
}
