//! What is to be seen: surfaces and at most one transfer function.

use crate::{Data, DataError, View};
use std::sync::Arc;

/// A whole scene, borrowed: what a method is asked about.
#[derive(Debug, Clone, Copy)]
pub struct Scene<'a> {
    /// The data.
    pub data: &'a Arc<Data>,
    /// Surfaces in the order of the command line; `Frame::surface` indexes them.
    pub surfaces: &'a [Surface],
    /// The medium between the surfaces.
    pub medium: Option<&'a TransferFunction>,
    /// The view.
    pub view: &'a View,
}

/// One surface to draw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Surface {
    /// Which points belong to it.
    pub kind: SurfaceKind,
    /// Linear RGB in [0, 1].
    pub colour: [f32; 3],
    /// 0 invisible (and then never hides what is behind), 1 opaque.
    pub opacity: f32,
}

impl Surface {
    /// The default colours of surfaces given without one, by position; linear RGB.
    pub const COLOURS: [[f32; 3]; 6] = [
        [0.68, 0.45, 0.22],
        [0.10, 0.34, 0.60],
        [0.18, 0.50, 0.20],
        [0.60, 0.14, 0.12],
        [0.42, 0.20, 0.52],
        [0.55, 0.55, 0.50],
    ];

    /// An opaque isosurface in the default colour of position `index`.
    #[must_use]
    pub fn isovalue(value: f64, index: usize) -> Self {
        Self {
            kind: SurfaceKind::Isovalue(value),
            colour: Self::COLOURS[index % Self::COLOURS.len()],
            opacity: 1.0,
        }
    }

    /// The isovalue, where the surface is one.
    #[must_use]
    pub fn value(&self) -> Option<f64> {
        match self.kind {
            SurfaceKind::Isovalue(v) => Some(v),
            _ => None,
        }
    }
}

/// What a surface is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum SurfaceKind {
    /// All x with s(x) = value, in data units.
    Isovalue(f64),
    /// All points with parameter `axis` (0, 1, 2) of their element equal to `value`.
    Parameter {
        /// Parametric axis.
        axis: u8,
        /// Its value in [0, 1].
        value: f64,
    },
    /// The boundary of the domain.
    Boundary,
}

/// Piecewise-linear colour and extinction over the data value.
#[derive(Debug, Clone, PartialEq)]
pub struct TransferFunction {
    /// `(value, [r, g, b], density)`, ascending in value (data units); linear between, constant outside. Linear RGB, not premultiplied.
    /// Density is extinction per [`Self::unit`] of world length, not negative.
    pub points: Vec<(f64, [f32; 3], f32)>,
    /// World length that density refers to, positive.
    pub unit: f64,
}

/// A local maximum of a transfer function's density: what Knoll et al. 2009, section 4.1, sample directly.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Peak {
    /// The value sampled: the knot, or the middle of the plateau.
    pub value: f64,
    /// Both ends of the stretch of values with this density; the same value twice for a knot higher than both its neighbours.
    pub plateau: [f64; 2],
    /// Linear RGB of the transfer function at `value`.
    pub colour: [f32; 3],
    /// Density there, extinction per [`TransferFunction::unit`].
    pub density: f32,
}

impl Peak {
    /// The unscaled opacity: the paper's sample opacity 1 - exp(-step * density) (equation 3) with the constant step 1 of section 4.2 in place
    /// of the step taken, hence 1 - exp(-density), whatever the ray's direction, speed or step. The step of 1 is one
    /// [`TransferFunction::unit`], since density is given per unit: the unit cancels, and a file states a peak of opacity a as density -ln(1 - a).
    #[must_use]
    pub fn opacity(&self) -> f32 {
        (-(-f64::from(self.density)).exp_m1()) as f32
    }

    /// The peak as a surface: the isovalue, its colour and its unscaled opacity. Crossings are shaded and composited like those of any surface.
    #[must_use]
    pub fn surface(&self) -> Surface {
        Surface {
            kind: SurfaceKind::Isovalue(self.value),
            colour: self.colour,
            opacity: self.opacity(),
        }
    }
}

impl TransferFunction {
    /// Checks the points: at least one, finite, strictly ascending, colours in [0, 1], densities not negative, and a positive unit
    /// by which 1 and every density can be divided.
    ///
    /// # Errors
    /// [`DataError::Transfer`] naming the point (counted from 1) and what to do.
    pub fn new(points: Vec<(f64, [f32; 3], f32)>, unit: f64) -> Result<Self, DataError> {
        let bad = |text: String| Err(DataError::Transfer(text));
        if points.is_empty() {
            return bad("it has no points; write points = [[value, r, g, b, density], ...]".into());
        }
        for (i, &(value, colour, density)) in points.iter().enumerate() {
            let n = i + 1;
            if !value.is_finite() || !density.is_finite() || colour.iter().any(|c| !c.is_finite()) {
                return bad(format!("point {n} has a number that is not finite; correct it"));
            }
            if colour.iter().any(|c| !(0.0..=1.0).contains(c)) {
                return bad(format!("point {n} has a colour outside 0 to 1; give linear r, g, b"));
            }
            if density < 0.0 {
                return bad(format!("point {n} has a negative density; extinction is at least 0"));
            }
            if i > 0 && points[i - 1].0 >= value {
                return bad(format!("point {n} is not above the one before it; sort the points by value"));
            }
        }
        if !(unit > 0.0 && unit.is_finite()) {
            return bad(format!("unit {unit} is not a positive length; give it in world units"));
        }
        let densest = points.iter().fold(0.0f32, |m, p| m.max(p.2));
        if !(1.0 / unit).is_finite() || !(f64::from(densest) / unit).is_finite() {
            return bad(format!(
                "unit {unit} is so small that the extinction of density {densest} overflows; give a longer unit"
            ));
        }
        Ok(Self { points, unit })
    }

    /// Linear RGB, not premultiplied, and density per [`Self::unit`] at a value, in f64: linear between the points, constant outside. Nothing
    /// (zeros) for NaN, and without points.
    #[must_use]
    pub fn at(&self, value: f64) -> ([f64; 3], f64) {
        let after = self.points.partition_point(|p| p.0 <= value);
        let (a, b) = match (self.points.get(after.wrapping_sub(1)), self.points.get(after)) {
            (Some(a), Some(b)) => (a, b),
            (Some(p), None) | (None, Some(p)) if !value.is_nan() => (p, p),
            _ => return ([0.0; 3], 0.0),
        };
        let w = if a.0 < b.0 { (value - a.0) / (b.0 - a.0) } else { 0.0 };
        let mix = |x: f32, y: f32| (1.0 - w) * f64::from(x) + w * f64::from(y);
        (std::array::from_fn(|i| mix(a.1[i], b.1[i])), mix(a.2, b.2))
    }

    /// Extinction per world length at a value: density / unit.
    #[must_use]
    pub fn extinction(&self, value: f64) -> f64 {
        self.at(value).1 / self.unit
    }

    /// The local maxima of the density, ascending in value: each knot higher than both its neighbours (Knoll et al. 2009, section 4.1), and each
    /// plateau higher than both knots beside it, which the paper does not speak of, as one peak in its middle. The function is
    /// constant outside its points, so that its first and last point, and a plateau that holds one of them, go on for ever on one side
    /// and are no maxima: a peak at the end of the data's range needs a point beyond it.
    #[must_use]
    pub fn peaks(&self) -> Vec<Peak> {
        let p = &self.points;
        let mut out = Vec::new();
        let mut first = 0;
        while first < p.len() {
            let mut last = first;
            while last + 1 < p.len() && p[last + 1].2 == p[first].2 {
                last += 1;
            }
            let density = p[first].2;
            if first > 0 && last + 1 < p.len() && p[first - 1].2 < density && p[last + 1].2 < density {
                let plateau = [p[first].0, p[last].0];
                let value = if first == last {
                    plateau[0]
                } else {
                    f64::midpoint(plateau[0], plateau[1])
                };
                let colour = self.at(value).0.map(|c| c as f32);
                out.push(Peak {
                    value,
                    plateau,
                    colour,
                    density,
                });
            }
            first = last + 1;
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tf(points: &[(f64, f32)]) -> TransferFunction {
        TransferFunction::new(
            points.iter().map(|&(v, d)| (v, [v as f32 / 10.0, 0.5, 0.0], d)).collect(),
            2.0,
        )
        .unwrap()
    }

    #[test]
    fn a_transfer_function_is_linear_between_and_constant_outside() {
        let f = tf(&[(0.0, 1.0), (4.0, 3.0), (10.0, 0.0)]);
        for (v, d, red) in [
            (-5.0, 1.0, 0.0),
            (0.0, 1.0, 0.0),
            (1.0, 1.5, 0.1),
            (4.0, 3.0, 0.4),
            (7.0, 1.5, 0.7),
            (11.0, 0.0, 1.0),
        ] {
            let (c, density) = f.at(v);
            assert!(
                (c[0] - red).abs() < 1e-7 && (density - d).abs() < 1e-12,
                "{v}: {c:?} {density}"
            );
        }
        assert_eq!(f.extinction(4.0), 1.5);
        assert_eq!(f.at(f64::NAN), ([0.0; 3], 0.0));
    }

    #[test]
    fn peaks_are_maxima_inside() {
        let f = tf(&[
            (0.0, 9.0),
            (1.0, 0.0),
            (2.0, 1.0),
            (3.0, 0.5),
            (4.0, 2.0),
            (6.0, 2.0),
            (7.0, 0.0),
            (8.0, 3.0),
            (9.0, 3.0),
        ]);
        let peaks = f.peaks();
        assert_eq!(peaks.iter().map(|p| p.value).collect::<Vec<_>>(), [2.0, 5.0]);
        assert_eq!((peaks[0].plateau, peaks[1].plateau), ([2.0, 2.0], [4.0, 6.0]));
        assert!((peaks[1].colour[0] - 0.5).abs() < 1e-7);
        // a plateau on the way up is none, and neither are the ends
        assert!(tf(&[(0.0, 0.0), (1.0, 1.0), (2.0, 1.0), (3.0, 2.0)]).peaks().is_empty());
        // opacity a as density -ln(1 - a), whatever the unit
        let half = tf(&[(0.0, 0.0), (1.0, std::f32::consts::LN_2), (2.0, 0.0)]).peaks();
        assert!((half[0].opacity() - 0.5).abs() < 1e-7 && half[0].surface().value() == Some(1.0));
    }

    #[test]
    fn unusable_transfer_functions_are_refused() {
        let c = [0.5; 3];
        for (points, unit) in [
            (vec![], 1.0),
            (vec![(0.0, c, 1.0), (0.0, c, 1.0)], 1.0),
            (vec![(1.0, c, 1.0), (0.0, c, 1.0)], 1.0),
            (vec![(f64::NAN, c, 1.0)], 1.0),
            (vec![(0.0, c, -1.0)], 1.0),
            (vec![(0.0, c, f32::INFINITY)], 1.0),
            (vec![(0.0, [0.0, 2.0, 0.0], 1.0)], 1.0),
            (vec![(0.0, c, 1.0)], 0.0),
            (vec![(0.0, c, 1.0)], f64::NAN),
            (vec![(0.0, c, 1.0)], 1e-320),
            (vec![(0.0, c, 1e38)], 1e-300),
            (vec![(0.0, c, 0.0)], 1e-310),
        ] {
            assert!(TransferFunction::new(points.clone(), unit).is_err(), "{points:?} {unit}");
        }
    }
}
