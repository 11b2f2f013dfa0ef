//! Bounding volumes of a part's (alpha, beta, gamma): whether they hold the origin (section 4.1.1).

use crate::bernstein::{Point, range};
use glam::DVec3;

/// The bounding volume of a part.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Bounds {
    /// Along alpha, beta, gamma.
    Aabb,
    /// Along the two longest columns of the Jacobian at the middle.
    Obb,
    /// Along the principal axes of the coefficients.
    Pca,
}

/// The axes of the volume about coefficients whose partial derivatives at the middle are `jacobian`; `None` where they have no direction.
pub(crate) fn axes(bounds: Bounds, p: &[Point], jacobian: [DVec3; 3]) -> Option<[DVec3; 3]> {
    match bounds {
        Bounds::Aabb => Some(DVec3::AXES),
        Bounds::Obb => jacobian_axes(jacobian),
        Bounds::Pca => principal_axes(p),
    }
}

/// Whether the bounding volume of the first three lanes holds the origin. The box along alpha, beta and gamma is asked first, whatever the volume.
pub(crate) fn holds_origin(bounds: Bounds, p: &[Point], jacobian: [DVec3; 3]) -> bool {
    let (lo, hi) = range(p);
    if (0..3).any(|i| lo[i] > 0.0 || hi[i] < 0.0) {
        return false;
    }
    if bounds == Bounds::Aabb {
        return true;
    }
    axes(bounds, p, jacobian).is_none_or(|axes| {
        axes.iter().all(|v| {
            let (a, b) = extent(*v, p);
            a <= 0.0 && b >= 0.0
        })
    })
}

/// Least and greatest coordinate along a direction.
pub(crate) fn extent(v: DVec3, p: &[Point]) -> (f64, f64) {
    p.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), q| {
        let x = v.x * q[0] + v.y * q[1] + v.z * q[2];
        (a.min(x), b.max(x))
    })
}

/// The paper's frame: v1 along the longest partial derivative at the middle, v3 across it and the second longest, v2 = v3 x v1.
fn jacobian_axes(mut v: [DVec3; 3]) -> Option<[DVec3; 3]> {
    v.sort_by(|a, b| b.length_squared().total_cmp(&a.length_squared()));
    let v1 = v[0].try_normalize()?;
    let v3 = v[0].cross(v[1]).try_normalize()?;
    Some([v1, v3.cross(v1), v3])
}

/// Eigenvectors of the covariance of the coefficients, by Jacobi rotations.
fn principal_axes(p: &[Point]) -> Option<[DVec3; 3]> {
    let n = p.len() as f64;
    let at = |q: &Point| DVec3::new(q[0], q[1], q[2]);
    let mean = p.iter().map(at).sum::<DVec3>() / n;
    let mut m = [[0.0f64; 3]; 3];
    for q in p {
        let x = at(q) - mean;
        for (i, row) in m.iter_mut().enumerate() {
            for (j, e) in row.iter_mut().enumerate() {
                *e += x[i] * x[j] / n;
            }
        }
    }
    let mut axes = [DVec3::X, DVec3::Y, DVec3::Z];
    for _ in 0..12 {
        for (i, j) in [(0, 1), (0, 2), (1, 2)] {
            if m[i][j] == 0.0 {
                continue;
            }
            let theta = (m[j][j] - m[i][i]) / (2.0 * m[i][j]);
            let t = theta.signum() / (theta.abs() + (theta * theta + 1.0).sqrt());
            let t = if theta == 0.0 { 1.0 } else { t };
            let c = 1.0 / (t * t + 1.0).sqrt();
            let s = t * c;
            let (a, b) = (m[i], m[j]);
            m[i] = std::array::from_fn(|k| c * a[k] - s * b[k]);
            m[j] = std::array::from_fn(|k| s * a[k] + c * b[k]);
            for row in &mut m {
                let (a, b) = (row[i], row[j]);
                (row[i], row[j]) = (c * a - s * b, s * a + c * b);
            }
            let (a, b) = (axes[i], axes[j]);
            (axes[i], axes[j]) = (a * c - b * s, a * s + b * c);
        }
    }
    axes.iter().all(|a| a.is_finite()).then_some(axes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn principal_axes_are_those_of_a_stretched_cloud() {
        let long = DVec3::new(1.0, 2.0, -0.5).normalize();
        let wide = long.any_orthonormal_vector();
        let p: Vec<Point> = (0..50)
            .map(|i| {
                let x = long * f64::from(i - 25) + wide * f64::from(i * 7 % 11 - 5) + long.cross(wide) * 0.1 * f64::from(i % 3);
                [x.x, x.y, x.z, 1.0]
            })
            .collect();
        let axes = principal_axes(&p).unwrap();
        assert!(axes.iter().any(|a| a.dot(long).abs() > 0.999));
        assert!((axes[0].dot(axes[1])).abs() < 1e-12 && (axes[1].dot(axes[2])).abs() < 1e-12);
    }

    #[test]
    fn oriented_boxes_are_tighter() {
        // A thin slab across the diagonal, away from the origin: its axis-aligned box holds it.
        let p: Vec<Point> = (0..8)
            .map(|n| {
                let [u, v, w] = [n & 1, n >> 1 & 1, n >> 2].map(f64::from);
                [2.0 * u - 1.0 + 0.4, 2.0 * v - 1.0 + 0.4, 1.0 - u - v + 0.02 * w + 0.4, 1.0]
            })
            .collect();
        let jacobian = [DVec3::new(2.0, 0.0, -1.0), DVec3::new(0.0, 2.0, -1.0), DVec3::Z * 0.02];
        let holds = |bounds| holds_origin(bounds, &p, jacobian);
        assert!(holds(Bounds::Aabb) && !holds(Bounds::Obb) && !holds(Bounds::Pca));
    }
}
