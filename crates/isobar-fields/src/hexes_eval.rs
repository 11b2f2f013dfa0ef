//! Point values of rational Bezier elements: position, Jacobian, attribute and its parametric gradient, by Bernstein weights in f64.

use glam::{DMat3, DVec3};
use isobar_core::HexElement;

/// Bernstein polynomials of one axis: at most degree 20.
const MOST: usize = HexElement::MOST_DEGREE as usize + 1;

/// What an element is at one parameter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HexPoint {
    /// x(u), world.
    pub position: DVec3,
    /// Columns dx/du, dx/dv, dx/dw.
    pub jacobian: DMat3,
    /// a(u), data units.
    pub value: f64,
    /// da/du, da/dv, da/dw.
    pub parametric_gradient: DVec3,
}

impl HexPoint {
    /// Gradient of s in the world, `J^-T grad_u a` (maths C, equation 16); zero where the Jacobian is singular.
    #[must_use]
    pub fn gradient(&self) -> DVec3 {
        let j = self.jacobian;
        let (a, b, c) = (j.x_axis, j.y_axis, j.z_axis);
        let g = self.parametric_gradient;
        let cofactors = b.cross(c) * g.x + c.cross(a) * g.y + a.cross(b) * g.z;
        let out = cofactors / a.dot(b.cross(c));
        if out.is_finite() { out } else { DVec3::ZERO }
    }
}

/// `B_i(x)` and `B_i'(x)` of degree `d`, by the recurrence over degrees (no cancellation inside [0, 1]).
fn basis(d: usize, x: f64) -> ([f64; MOST], [f64; MOST]) {
    let (mut b, mut db) = ([0.0; MOST], [0.0; MOST]);
    b[0] = 1.0;
    for n in 1..=d {
        if n == d {
            for i in 0..=d {
                let left = if i > 0 { b[i - 1] } else { 0.0 };
                let right = if i < d { b[i] } else { 0.0 };
                db[i] = d as f64 * (left - right);
            }
        }
        for i in (0..=n).rev() {
            let left = if i > 0 { b[i - 1] } else { 0.0 };
            b[i] = x * left + (1.0 - x) * if i < n { b[i] } else { 0.0 };
        }
    }
    (b, db)
}

/// Sums of `K` numbers per coefficient, with the three partial derivatives: `[value, d/du, d/dv, d/dw]`.
fn sums<const K: usize>(degree: [u8; 3], u: DVec3, coefficient: impl Fn(usize) -> [f64; K]) -> [[f64; K]; 4] {
    let [du, dv, dw] = degree.map(usize::from);
    let ((bu, gu), (bv, gv), (bw, gw)) = (basis(du, u.x), basis(dv, u.y), basis(dw, u.z));
    let mut out = [[0.0; K]; 4];
    let mut at = 0;
    for k in 0..=dw {
        for j in 0..=dv {
            let (mut s, mut g) = ([0.0; K], [0.0; K]);
            for i in 0..=du {
                let c = coefficient(at);
                for n in 0..K {
                    s[n] += bu[i] * c[n];
                    g[n] += gu[i] * c[n];
                }
                at += 1;
            }
            for n in 0..K {
                out[0][n] += bv[j] * bw[k] * s[n];
                out[1][n] += bv[j] * bw[k] * g[n];
                out[2][n] += gv[j] * bw[k] * s[n];
                out[3][n] += bv[j] * gw[k] * s[n];
            }
        }
    }
    out
}

/// The element at parameter `u`, f64 arithmetic (a few ulps of the largest control point times the degree); `u` outside [0, 1] extrapolates.
#[must_use]
pub fn evaluate_hex(e: &HexElement, u: DVec3) -> HexPoint {
    let s = sums(e.degree, u, |i| {
        let [x, y, z, w] = e.points[i];
        [w * x, w * y, w * z, w, if e.rational_value { w * e.values[i] } else { 0.0 }]
    });
    let w = s[0][3];
    let quotient = |n: usize| {
        let v = s[0][n] / w;
        (
            v,
            DVec3::new(s[1][n] - v * s[1][3], s[2][n] - v * s[2][3], s[3][n] - v * s[3][3]) / w,
        )
    };
    let ((x, gx), (y, gy), (z, gz)) = (quotient(0), quotient(1), quotient(2));
    let (value, parametric_gradient) = if e.rational_value {
        quotient(4)
    } else {
        let a = sums(e.value_degree, u, |i| [e.values[i]]);
        (a[0][0], DVec3::new(a[1][0], a[2][0], a[3][0]))
    };
    HexPoint {
        position: DVec3::new(x, y, z),
        jacobian: DMat3::from_cols(gx, gy, gz).transpose(),
        value,
        parametric_gradient,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The quarter annulus of hardcases D1.
    fn annulus() -> HexElement {
        let h = std::f64::consts::FRAC_1_SQRT_2;
        let arc = [[1.0, 0.0, 1.0], [1.0, 1.0, h], [0.0, 1.0, 1.0]];
        HexElement {
            degree: [2, 1, 1],
            points: (0..12)
                .map(|n| {
                    let ([c, s, w], r) = (arc[n % 3], 1.0 + (n / 3 % 2) as f64);
                    [r * c, r * s, (n / 6) as f64, w]
                })
                .collect(),
            value_degree: [0, 1, 0],
            values: vec![0.0, 1.0].into(),
            rational_value: false,
        }
    }

    #[test]
    fn an_annulus_is_round_and_its_derivatives_are_differences() {
        let e = annulus();
        let h = 1e-6;
        for n in 0..27 {
            let u = DVec3::new((n % 3) as f64, (n / 3 % 3) as f64, (n / 9) as f64) * 0.4 + 0.1;
            let p = evaluate_hex(&e, u);
            assert!((p.position.truncate().length() - (1.0 + u.y)).abs() < 1e-15 && p.value == u.y);
            for a in 0..3 {
                let step = DVec3::AXES[a] * h;
                let (l, r) = (evaluate_hex(&e, u - step), evaluate_hex(&e, u + step));
                assert!((p.jacobian.col(a) - (r.position - l.position) / (2.0 * h)).length() < 1e-9);
                assert!((p.parametric_gradient[a] - (r.value - l.value) / (2.0 * h)).abs() < 1e-9);
            }
            let radial = p.position.truncate().normalize().extend(0.0);
            assert!((p.gradient() - radial).length() < 1e-13);
        }
    }

    #[test]
    fn a_rational_attribute_shares_the_weights() {
        let mut e = annulus();
        (e.value_degree, e.rational_value) = (e.degree, true);
        e.values = e.points.iter().map(|p| p[0]).collect();
        let p = evaluate_hex(&e, DVec3::new(0.3, 0.6, 0.2));
        assert_eq!(p.value, p.position.x);
        assert!((p.gradient() - DVec3::X).length() < 1e-14);
    }
}
