//! Three by three matrices, rows first.

/// Rows.
pub(crate) type Matrix = [[f64; 3]; 3];

/// The inverse by cofactors; `None` where the determinant is zero or not finite.
#[inline(always)]
pub(crate) fn inverse(m: &Matrix) -> Option<Matrix> {
    let [[a, b, c], [d, e, f], [g, h, i]] = *m;
    let (p, q, r) = (e * i - f * h, f * g - d * i, d * h - e * g);
    let det = a * p + b * q + c * r;
    let k = 1.0 / det;
    if !(k.is_finite() && det != 0.0) {
        return None;
    }
    Some([
        [p * k, (c * h - b * i) * k, (b * f - c * e) * k],
        [q * k, (a * i - c * g) * k, (c * d - a * f) * k],
        [r * k, (b * g - a * h) * k, (a * e - b * d) * k],
    ])
}

/// `m v`.
#[inline(always)]
pub(crate) fn product(m: &Matrix, v: [f64; 3]) -> [f64; 3] {
    let row = |r: &[f64; 3]| r[0] * v[0] + r[1] * v[1] + r[2] * v[2];
    [row(&m[0]), row(&m[1]), row(&m[2])]
}

/// Sums of the rows of a matrix without negative entries.
#[inline(always)]
pub(crate) fn row_sums(m: &Matrix) -> [f64; 3] {
    let sum = |r: &[f64; 3]| (r[0] + r[1] + r[2]) * (1.0 + 4.0 * f64::EPSILON);
    [sum(&m[0]), sum(&m[1]), sum(&m[2])]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inverses_invert() {
        let m = [[2.0, 1.0, -1.0], [0.5, 3.0, 0.0], [1.0, -2.0, 4.0]];
        let y = inverse(&m).unwrap();
        for i in 0..3 {
            let column = m.map(|row| row[i]);
            let unit = product(&y, column);
            for (j, v) in unit.iter().enumerate() {
                assert!((v - if i == j { 1.0 } else { 0.0 }).abs() < 1e-15);
            }
        }
        assert!(inverse(&[[1.0, 2.0, 3.0], [2.0, 4.0, 6.0], [0.0, 0.0, 1.0]]).is_none());
        assert!(inverse(&[[f64::NAN; 3]; 3]).is_none());
        assert!(row_sums(&[[1.0, 2.0, 3.0]; 3])[1] >= 6.0);
    }
}
