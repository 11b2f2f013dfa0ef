//! The polynomials of the paper's form on one element: P, delta (equations 13 to 17) and eta (18), by explicit Bezier products.
//!
//! Everything is in the homogeneous coordinates of the camera's frame ([`crate::frustum`]): x, y, the depth W that the rays share (z where they start at the eye, w where they are parallel)
//! and the other of z and w, Z. Up to constants `x / W`, `y / W`, `Z / W` are the paper's perspective coordinates, whose z axis is the ray. With `[p, q]` for
//! `W^3 grad gamma . (grad (p / W) x grad (q / W))`, which is the polynomial `W det(g, p, q) + q det(g, W, p) + p det(g, q, W)` of the gradients of gamma, p, q and W,
//!
//! - delta = `[x, y]` (equation 17 as corrected in maths, section C: determinant of the Jacobian times the z component of the gradient),
//! - the other components, times the same determinant, are `Nx = [y, Z]` and `Ny = [Z, x]` (equation 16 with the inverse transposed),
//! - eta = `(x - s W) Ny - (y - r W) Nx` (equation 18, relative to the pixel's centre (s, r)) = `E0 - s E1 + r E2` with `E0 = x Ny - y Nx`, `E1 = W Ny`, `E2 = W Nx`.
//!
//! Products are of the least degree: 3g + h - 1 for delta and up to 4g + h - 1 for eta, g and h the degrees of geometry and gamma.

use crate::bernstein::{Lanes, Point, count};
use crate::frustum::Frustum;
use glam::DVec3;
use isobar_core::HexElement;
use isobar_fields::hexes_bezier::{Tensor, derivative, elevate};

/// Coefficients of eta, at most; elements that would have more are refused.
pub(crate) const MOST_PRODUCTS: usize = 1 << 16;

/// An element in the frame of the camera.
#[derive(Debug)]
pub(crate) struct Forms {
    /// Common degree of `lanes`.
    pub(crate) d: [usize; 3],
    /// x, y, W, gamma.
    pub(crate) lanes: Vec<Point>,
    /// z, w beside them.
    pub(crate) depth: Vec<Point>,
    pub(crate) e: [usize; 3],
    pub(crate) delta: Vec<f64>,
    /// Degree and coefficients of E0, E1, E2; none where silhouettes are not sought.
    pub(crate) q: [usize; 3],
    pub(crate) eta: Vec<Point>,
}

/// Degrees of geometry and of gamma.
pub(crate) fn degrees(e: &HexElement) -> ([usize; 3], [usize; 3]) {
    let g = e.degree.map(usize::from);
    (
        g,
        if e.rational_value {
            g
        } else {
            e.value_degree.map(usize::from)
        },
    )
}

/// Whether the products of an element have no more coefficients than [`MOST_PRODUCTS`].
pub(crate) fn is_feasible(e: &HexElement) -> bool {
    let (g, h) = degrees(e);
    (0..3)
        .map(|a| 4 * g[a] + h[a])
        .try_fold(1usize, usize::checked_mul)
        .is_some_and(|n| n <= MOST_PRODUCTS)
}

pub(crate) type Poly = Tensor<f64>;

/// A tensor in a degree at least its own.
fn raised(mut t: Poly, d: [usize; 3]) -> Poly {
    for (axis, &d) in d.iter().enumerate() {
        while t.counts[axis] <= d {
            t = t.along(axis, elevate);
        }
    }
    t
}

fn is_zero(t: &Poly) -> bool {
    t.values.iter().all(|&v| v == 0.0)
}

/// `a + sign b`, in the greater degrees.
fn plus(a: Poly, sign: f64, b: Poly) -> Poly {
    let d = [0, 1, 2].map(|i| a.counts[i].max(b.counts[i]) - 1);
    let (mut a, b) = (raised(a, d), raised(b, d));
    a.values.iter_mut().zip(&b.values).for_each(|(a, b)| *a += sign * b);
    a
}

/// A sum of which nothing is there yet; terms that are zero are left out, so that they raise no degree.
#[derive(Default)]
pub(crate) struct Sum(Option<Poly>);

impl Sum {
    pub(crate) fn add(&mut self, sign: f64, t: Poly) {
        if is_zero(&t) {
            return;
        }
        self.0 = Some(match self.0.take() {
            None if sign == 1.0 => t,
            None => Poly {
                counts: t.counts,
                values: t.values.iter().map(|v| sign * v).collect(),
            },
            Some(s) => plus(s, sign, t),
        });
    }

    pub(crate) fn get(self) -> Poly {
        self.0.unwrap_or(Poly {
            counts: [1; 3],
            values: vec![0.0],
        })
    }
}

/// A polynomial with its gradient.
pub(crate) struct Smooth {
    pub(crate) value: Poly,
    gradient: [Poly; 3],
}

impl Smooth {
    pub(crate) fn new(value: Poly) -> Self {
        let gradient = [0, 1, 2].map(|axis| value.along(axis, derivative));
        Self { value, gradient }
    }
}

/// `det (grad a, grad b, grad c)`.
pub(crate) fn determinant(a: &Smooth, b: &Smooth, c: &Smooth) -> Poly {
    let mut sum = Sum::default();
    for i in 0..3 {
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        let mut minor = Sum::default();
        minor.add(1.0, b.gradient[j].product(&c.gradient[k]));
        minor.add(-1.0, b.gradient[k].product(&c.gradient[j]));
        sum.add(1.0, a.gradient[i].product(&minor.get()));
    }
    sum.get()
}

/// `[p, q]` of the module's text.
fn bracket(g: &Smooth, p: &Smooth, q: &Smooth, w: &Smooth) -> Poly {
    let mut sum = Sum::default();
    for (by, a, b) in [(w, p, q), (q, w, p), (p, q, w)] {
        sum.add(1.0, determinant(g, a, b).product(&by.value));
    }
    sum.get()
}

impl Forms {
    /// `silhouettes`: whether eta is made.
    pub(crate) fn new(f: &Frustum, e: &HexElement, c: f64, silhouettes: bool) -> Self {
        let (g, h) = degrees(e);
        let d: [usize; 3] = std::array::from_fn(|a| g[a].max(h[a]));
        let tensor = |d: [usize; 3], values: Vec<f64>| Poly {
            counts: d.map(|d| d + 1),
            values,
        };
        let place = |n: DVec3| {
            let values = e.points.iter();
            let values = values.map(|p| p[3] * n.dot(DVec3::new(p[0], p[1], p[2]) - f.eye));
            tensor(g, values.collect())
        };
        let (x, y, z) = (place(f.right), place(f.up), place(f.forward));
        let one_weight = e.points.iter().all(|p| p[3] == e.points[0][3]);
        let w = if one_weight {
            tensor([0; 3], vec![e.points[0][3]])
        } else {
            tensor(g, e.points.iter().map(|p| p[3]).collect())
        };
        let weight = |i: usize| if e.rational_value { e.points[i][3] } else { 1.0 };
        let gamma = tensor(h, e.values.iter().enumerate().map(|(i, a)| weight(i) * (a - c)).collect());
        let [x, y, z, w, gamma] = [x, y, z, w, gamma].map(Smooth::new);
        let (depth, other) = if f.parallel { (&w, &z) } else { (&z, &w) };
        let delta = bracket(&gamma, &x, &y, depth);
        let (mut q, mut eta) = ([0; 3], Vec::new());
        if silhouettes {
            let (nx, ny) = (bracket(&gamma, &y, other, depth), bracket(&gamma, other, &x, depth));
            let mut first = Sum::default();
            first.add(1.0, x.value.product(&ny));
            first.add(-1.0, y.value.product(&nx));
            let deep = |n: &Poly| {
                let mut sum = Sum::default();
                sum.add(1.0, depth.value.product(n));
                sum.get()
            };
            let all = [first.get(), deep(&ny), deep(&nx)];
            q = [0, 1, 2].map(|a| all.iter().map(|t| t.counts[a]).max().unwrap_or(1) - 1);
            let [a, b, c] = all.map(|t| raised(t, q).values);
            eta = (0..a.len()).map(|i| [a[i], b[i], c[i], 0.0]).collect();
        }
        let [x, y, z, w, gamma] = [x, y, z, w, gamma].map(|s| raised(s.value, d).values);
        let depth = if f.parallel { &w } else { &z };
        Self {
            d,
            lanes: (0..count(d)).map(|i| [x[i], y[i], depth[i], gamma[i]]).collect(),
            depth: (0..count(d)).map(|i| [z[i], w[i], 0.0, 0.0]).collect(),
            e: delta.counts.map(|c| c - 1),
            delta: delta.values,
            q,
            eta,
        }
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> usize {
        (self.lanes.len() + self.depth.len() + self.eta.len()) * 32 + self.delta.len() * 8
    }
}

/// Bernstein polynomials of any degree at a point, and their derivatives.
fn basis(d: usize, x: f64) -> (Vec<f64>, Vec<f64>) {
    let (mut b, mut db, y) = (vec![1.0], vec![0.0], 1.0 - x);
    for n in 1..=d {
        db = (0..=n)
            .map(|i| n as f64 * (if i > 0 { b[i - 1] } else { 0.0 } - if i < n { b[i] } else { 0.0 }))
            .collect();
        b = (0..=n)
            .map(|i| if i > 0 { x * b[i - 1] } else { 0.0 } + if i < n { y * b[i] } else { 0.0 })
            .collect();
    }
    (b, db)
}

/// Value and three partial derivatives of a form of any degree ([`crate::bernstein::jet`] stops at degree 20).
pub(crate) fn evaluate<T: Lanes>(d: [usize; 3], c: &[T], u: [f64; 3]) -> [T; 4] {
    let [x, y, z] = [0, 1, 2].map(|a| basis(d[a], u[a]));
    let mut out = [T::ZERO; 4];
    for (row, line) in c.chunks_exact(d[0] + 1).enumerate() {
        let (j, k) = (row % (d[1] + 1), row / (d[1] + 1));
        let (mut v, mut dv) = (T::ZERO, T::ZERO);
        for (i, &p) in line.iter().enumerate() {
            v = v.plus(x.0[i], p);
            dv = dv.plus(x.1[i], p);
        }
        out[0] = out[0].plus(y.0[j] * z.0[k], v);
        out[1] = out[1].plus(y.0[j] * z.0[k], dv);
        out[2] = out[2].plus(y.1[j] * z.0[k], v);
        out[3] = out[3].plus(y.0[j] * z.1[k], v);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tests::annulus;
    use isobar_core::{Camera, View};
    use isobar_cpu::Tile;

    fn frustum(parallel: bool) -> Frustum {
        let (eye, target, up) = (DVec3::new(4.0, 3.0, 3.5), DVec3::new(0.8, 0.8, 0.5), DVec3::Z);
        let mut view = View::perspective(eye, target, up, 40.0, 8, 8);
        if parallel {
            view.camera = Camera::Orthographic {
                eye,
                target,
                up,
                height: 3.0,
            };
        }
        let tile = Tile {
            x: 0,
            y: 0,
            width: 8,
            height: 8,
        };
        Frustum::of_tile(&view, tile).remove(0).0
    }

    /// delta and eta are what the gradient by differences of the perspective map says, with a rational element in both projections.
    #[test]
    fn products_are_the_components_of_the_gradient() {
        let mut e = annulus();
        (e.value_degree, e.values) = ([1, 1, 1], (0..8).map(|i| f64::from(i * 5 % 7)).collect());
        for parallel in [false, true] {
            let f = frustum(parallel);
            let k = Forms::new(&f, &e, 2.5, true);
            let [s, r] = f.rays[19].slope;
            for n in 0..8 {
                let u = [
                    0.2 + 0.5 * f64::from(n & 1),
                    0.3 + 0.4 * f64::from(n >> 1 & 1),
                    0.1 + 0.7 * f64::from(n >> 2),
                ];
                let [p, pu, pv, pw] = evaluate(k.d, &k.lanes, u);
                let [q, qu, qv, qw] = evaluate(k.d, &k.depth, u);
                let (w, z) = (p[2], q[usize::from(!parallel)]);
                let quotient = |a: f64, da: f64, dw: f64| (da * w - a * dw) / (w * w);
                // Rows: gradients of x / W, y / W, Z / W and gamma by u, v, w.
                let other = usize::from(!parallel);
                let rows = [(pu, qu), (pv, qv), (pw, qw)].map(|(d, b)| {
                    [
                        quotient(p[0], d[0], d[2]),
                        quotient(p[1], d[1], d[2]),
                        quotient(z, b[other], d[2]),
                        d[3],
                    ]
                });
                let g = |c: usize| DVec3::new(rows[0][c], rows[1][c], rows[2][c]);
                let triple = |a: usize, b: usize| g(3).dot(g(a).cross(g(b))) * w.powi(3);
                let delta = evaluate(k.e, &k.delta, u)[0];
                assert!(
                    (delta - triple(0, 1)).abs() < 1e-10 * (1.0 + delta.abs()),
                    "{parallel} {delta} {}",
                    triple(0, 1)
                );
                let [a, b, c, _] = evaluate(k.q, &k.eta, u)[0];
                let eta = a - s * b + r * c;
                let want = (p[0] - s * w) * triple(2, 0) - (p[1] - r * w) * triple(1, 2);
                assert!((eta - want).abs() < 1e-9 * (1.0 + want.abs()), "{parallel} {eta} {want}");
            }
            assert!(k.bytes() > 0 && is_feasible(&e));
        }
    }

    #[test]
    fn weights_of_one_raise_no_degree() {
        let e = crate::tests::element([1; 3], |u| u, [3; 3], &[0.5; 64]);
        let k = Forms::new(&frustum(false), &e, 0.1, true);
        // A constant attribute has no gradient at all.
        assert_eq!((k.e, k.q, k.delta[0]), ([0; 3], [0; 3], 0.0));
        let values: Vec<f64> = (0..64).map(|i| f64::from(i * 7 % 13)).collect();
        let e = crate::tests::element([1; 3], |u| u, [3; 3], &values);
        let k = Forms::new(&frustum(false), &e, 0.1, true);
        assert_eq!((k.e, k.q), ([5; 3], [5; 3]));
        assert!(!is_feasible(&crate::tests::element([20, 20, 20], |u| u, [0; 3], &[0.0])));
    }
}
