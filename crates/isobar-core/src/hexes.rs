//! Trivariate rational Bezier elements: mapped hexahedra with an attribute (Martin, Cohen, Kirby 2011, section 2.1).

use crate::DataError;
use std::sync::Arc;

/// A trivariate rational Bezier element: geometry x(u) and attribute a(u), u in [0, 1]^3.
///
/// With Bernstein polynomials `B_i` of the geometry's degree and control points `c_i` with weights `w_i`,
/// `x(u) = sum w_i c_i B_i(u) / sum w_i B_i(u)`: the products `w_i c_i` are the real ones, not rounded, so the f64 bits *are* the element. The
/// attribute is `a(u) = sum v_j B_j(u)` in the basis of its own degree, or `sum w_i v_i B_i(u) / sum w_i B_i(u)` where it is rational.
#[derive(Debug, Clone, PartialEq)]
pub struct HexElement {
    /// Degree of the geometry along u, v, w: 1 to 20 each.
    pub degree: [u8; 3],
    /// `(degree + 1)` per axis control points x, y, z, weight (not premultiplied), u fastest.
    pub points: Box<[[f64; 4]]>,
    /// Degree of the attribute: 0 to 20 each.
    pub value_degree: [u8; 3],
    /// Control coefficients of the attribute, u fastest; it is polynomial where `rational_value` is false, else it shares the weights.
    pub values: Box<[f64]>,
    /// Whether the attribute is weighted like the geometry (then both degrees are equal).
    pub rational_value: bool,
}

/// A collection of elements, checked by [`HexPatches::new`].
///
/// As a function it is cell-wise parametric: `s(x(u)) = a(u)` on the closed elements and nothing outside them. A ray `o + t d` meets the surface
/// s = c in every t with `x(u) = o + t d` and `a(u) = c` for some u of some element. Elements may be folded or degenerate: several u (of one element
/// or of several) may then map to one point, with different values. Neighbours need not agree: a crack stays a crack.
#[derive(Debug, Clone, PartialEq)]
pub struct HexPatches {
    /// The elements, at least one.
    pub elements: Arc<[HexElement]>,
}

impl HexElement {
    /// Greatest degree along a parametric axis.
    pub const MOST_DEGREE: u8 = 20;

    /// Control points per axis product: what `points` holds for a degree.
    #[must_use]
    pub fn count(degree: [u8; 3]) -> usize {
        degree.iter().map(|&d| usize::from(d) + 1).product()
    }

    /// Whether all weights are equal, so that the geometry is polynomial.
    #[must_use]
    pub fn is_polynomial(&self) -> bool {
        self.points.iter().all(|p| p[3] == self.points[0][3])
    }

    /// Least and greatest coefficient of the attribute: a lies between them everywhere, because weights are positive.
    #[must_use]
    pub fn value_range(&self) -> (f64, f64) {
        self.values
            .iter()
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), &v| (lo.min(v), hi.max(v)))
    }

    /// What is wrong with it, if anything.
    fn fault(&self) -> Option<String> {
        let most = Self::MOST_DEGREE;
        if let Some(&d) = self.degree.iter().find(|&&d| d == 0 || d > most) {
            return Some(format!("a geometry of degree {d}; degrees go from 1 to {most}"));
        }
        if let Some(&d) = self.value_degree.iter().find(|&&d| d > most) {
            return Some(format!("an attribute of degree {d}; degrees go from 0 to {most}"));
        }
        let (want, found) = (Self::count(self.degree), self.points.len());
        if want != found {
            return Some(format!(
                "{found} control points, its degree {:?} asks for {want}",
                self.degree
            ));
        }
        let (want, found) = (Self::count(self.value_degree), self.values.len());
        if want != found {
            return Some(format!(
                "{found} coefficients of the attribute, its degree {:?} asks for {want}",
                self.value_degree
            ));
        }
        if self.rational_value && self.value_degree != self.degree {
            return Some(format!(
                "a rational attribute of degree {:?} on a geometry of degree {:?}; the degrees must be equal",
                self.value_degree, self.degree
            ));
        }
        if self.points.iter().flatten().any(|v| !v.is_finite()) {
            return Some("a control point or weight that is not finite".into());
        }
        if let Some(p) = self.points.iter().find(|p| p[3] <= 0.0) {
            return Some(format!("the weight {}; weights must be positive", p[3]));
        }
        None
    }
}

impl HexPatches {
    /// Elements that everything downstream can draw: this is how to make them from input.
    ///
    /// # Errors
    /// [`DataError::Elements`] where there are none or more than 2^32 - 1, a degree is out of range (geometry 1 to 20, attribute 0 to 20), counts
    /// disagree with degrees, a weight is not positive, a point or weight is not finite, or a rational attribute differs in degree from its geometry;
    /// [`DataError::NotFinite`] where a coefficient of the attribute is NaN or infinite.
    pub fn new(elements: impl Into<Arc<[HexElement]>>) -> Result<Self, DataError> {
        let elements = elements.into();
        if elements.is_empty() {
            return Err(DataError::Elements("there are none".into()));
        }
        if u32::try_from(elements.len()).is_err() {
            return Err(DataError::Elements(format!("{} are more than 2^32 - 1", elements.len())));
        }
        if let Some((i, fault)) = elements.iter().enumerate().find_map(|(i, e)| e.fault().map(|f| (i, f))) {
            return Err(DataError::Elements(format!("element {i} has {fault}")));
        }
        let count = elements.iter().flat_map(|e| &e.values).filter(|v| !v.is_finite()).count();
        if count > 0 {
            let total = elements.iter().map(|e| e.values.len()).sum();
            return Err(DataError::NotFinite { count, total });
        }
        Ok(Self { elements })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube() -> HexElement {
        HexElement {
            degree: [1; 3],
            points: (0..8)
                .map(|n| [f64::from(n & 1), f64::from(n >> 1 & 1), f64::from(n >> 2), 1.0])
                .collect(),
            value_degree: [2, 0, 0],
            values: vec![0.0, 1.5, 0.0].into(),
            rational_value: false,
        }
    }

    #[test]
    fn elements_are_checked() {
        assert!(HexPatches::new(vec![cube()]).is_ok());
        assert!(cube().is_polynomial() && cube().value_range() == (0.0, 1.5));
        let said = |change: &dyn Fn(&mut HexElement)| {
            let mut e = cube();
            change(&mut e);
            HexPatches::new(vec![cube(), e]).unwrap_err().to_string()
        };
        assert_eq!(
            said(&|e| e.points[3][3] = 0.0),
            "unusable elements: element 1 has the weight 0; weights must be positive"
        );
        assert!(said(&|e| e.points[3][3] = -1.0).contains("positive"));
        assert!(said(&|e| e.points[3][3] = f64::NAN).contains("not finite"));
        assert!(said(&|e| e.points[0][0] = f64::INFINITY).contains("not finite"));
        assert!(said(&|e| e.degree[1] = 0).contains("1 to 20"));
        assert!(said(&|e| e.degree[1] = 21).contains("1 to 20"));
        assert!(said(&|e| e.degree[1] = 2).contains("asks for 12"));
        assert!(said(&|e| e.value_degree[0] = 21).contains("0 to 20"));
        assert!(said(&|e| e.value_degree[0] = 3).contains("asks for 4"));
        assert!(said(&|e| e.rational_value = true).contains("must be equal"));
        assert!(said(&|e| e.values[0] = f64::NAN).contains("1 of 6"));
        assert!(HexPatches::new(vec![]).unwrap_err().to_string().contains("none"));
    }
}
