//! From header numbers and samples to [`Loaded`]: what all readers of grids end with.

use crate::error::Cause;
use crate::sample::{count, replace_not_finite};
use crate::{Loaded, Options};
use isobar_core::{DMat3, DVec3, Data, DataError, Grid, Samples};

/// Where the samples of a grid lie.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Geometry {
    /// Samples per axis.
    pub(crate) dims: [u64; 3],
    /// World distance along each axis.
    pub(crate) spacing: DVec3,
    /// Position of sample (0, 0, 0).
    pub(crate) origin: DVec3,
    /// Columns: unit directions.
    pub(crate) direction: DMat3,
}

impl Geometry {
    /// Axis-aligned. A negative spacing turns its axis round: the direction is then negative, the spacing positive.
    pub(crate) fn aligned(dims: [u64; 3], spacing: DVec3, origin: DVec3) -> Self {
        Self::from_steps(dims, DMat3::from_diagonal(spacing), origin)
    }

    /// From the steps between neighbouring samples along each axis (columns). Steps along a world axis give their length exactly.
    pub(crate) fn from_steps(dims: [u64; 3], steps: DMat3, origin: DVec3) -> Self {
        let mut spacing = DVec3::ZERO;
        let mut direction = DMat3::IDENTITY;
        for axis in 0..3 {
            let (length, unit) = split(steps.col(axis));
            spacing[axis] = length;
            *direction.col_mut(axis) = unit;
        }
        Self {
            dims,
            spacing,
            origin,
            direction,
        }
    }

    /// The same with the origin moved by index coordinates `by`.
    pub(crate) fn shifted(mut self, by: DVec3) -> Self {
        // Only axes that move: 0 * infinity would make a good origin NaN before the bad spacing is named.
        for axis in 0..3 {
            if by[axis] != 0.0 {
                self.origin += self.direction.col(axis) * (self.spacing[axis] * by[axis]);
            }
        }
        self
    }

    /// Checks everything that can be checked without samples, so that a bad header is refused before they are read; the number of samples.
    pub(crate) fn check(&self) -> Result<usize, Cause> {
        let n = count(self.dims)?;
        let dims = self.dims.map(|d| usize::try_from(d).unwrap_or(usize::MAX));
        // Grid::new holds the rules; an empty buffer passes the geometry only to be refused for its count.
        let probe = Grid::new([1; 3], self.spacing, self.origin, self.direction, Samples::U8([0u8].into()))?;
        let far = DVec3::from_array(dims.map(|d| (d - 1) as f64));
        let corner = probe.domain().axes.abs() * far;
        if !(corner + self.origin.abs()).is_finite() {
            return Err(Cause::Data(DataError::Geometry {
                what: "extent",
                value: corner.to_string(),
            }));
        }
        Ok(n)
    }
}

/// Length and unit vector. A vector along a world axis is split exactly; one without a length stays as it is, to be refused by the grid.
fn split(v: DVec3) -> (f64, DVec3) {
    let largest = v.abs().max_element();
    if !(v.is_finite() && largest > 0.0) {
        return (if v.is_finite() { 0.0 } else { f64::NAN }, v);
    }
    if v.to_array().iter().filter(|c| **c != 0.0).count() == 1 {
        return (largest, v.to_array().map(|c| if c == 0.0 { 0.0 } else { c.signum() }).into());
    }
    // Scaled, so that squares neither overflow nor vanish.
    let scaled = v / largest;
    let length = scaled.length();
    (length * largest, scaled / length)
}

/// The grid with its name and notes; NaN and infinite samples replaced where that is asked.
pub(crate) fn loaded(
    geometry: Geometry,
    mut samples: Samples,
    field: String,
    fields: Vec<String>,
    mut notes: Vec<String>,
    o: &Options,
) -> Result<Loaded, Cause> {
    let mut dims = [0; 3];
    for (out, d) in dims.iter_mut().zip(geometry.dims) {
        *out = usize::try_from(d).map_err(|_| Cause::Dims(geometry.dims))?;
    }
    if let Some(value) = o.nan {
        if !(value as f32).is_finite() {
            return Err(Cause::Replacement(value));
        }
        let n = replace_not_finite(&mut samples, value);
        if n > 0 {
            notes.push(format!("{n} NaN or infinite samples were read as {value}"));
        }
    }
    let grid = Grid::new(dims, geometry.spacing, geometry.origin, geometry.direction, samples)?;
    Ok(Loaded {
        data: Data::Grid(grid),
        field,
        fields,
        notes,
        not_finite: 0,
    })
}

/// Refuses a field name in a file that has one field only.
pub(crate) fn only_field(name: &str, o: &Options) -> Result<String, Cause> {
    match o.field.as_deref() {
        Some(asked) if asked != name => Err(crate::field::no_field(asked, std::iter::once(name))),
        _ => Ok(name.to_owned()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_split_into_length_and_direction() {
        assert_eq!(split(DVec3::new(0.0, -1e-300, 0.0)), (1e-300, DVec3::NEG_Y));
        let (length, unit) = split(DVec3::new(3e200, 4e200, 0.0));
        assert!((length / 5e200 - 1.0).abs() < 1e-15 && (unit - DVec3::new(0.6, 0.8, 0.0)).length() < 1e-15);
        let g = Geometry::aligned([2, 2, 2], DVec3::new(0.957031, 2.0, -3.0), DVec3::ONE);
        assert_eq!(g.spacing, DVec3::new(0.957031, 2.0, 3.0));
        assert_eq!(g.direction.z_axis, DVec3::NEG_Z);
        assert_eq!(
            g.shifted(DVec3::new(0.5, 0.0, 1.0)).origin,
            DVec3::new(1.0 + 0.957031 * 0.5, 1.0, -2.0)
        );
    }

    #[test]
    fn bad_geometry_is_refused_before_samples() {
        let ok = Geometry::aligned([3, 4, 5], DVec3::ONE, DVec3::ZERO);
        assert_eq!(ok.check().unwrap(), 60);
        let with = |f: fn(&mut Geometry)| {
            let mut g = ok;
            f(&mut g);
            g.check().unwrap_err().to_string()
        };
        assert!(with(|g| g.dims = [0, 1, 1]).contains("dimensions"));
        assert!(with(|g| g.dims = [u64::MAX, 2, 2]).contains("dimensions"));
        assert!(with(|g| g.spacing.y = f64::NAN).contains("spacing"));
        assert!(with(|g| g.spacing.x = 0.0).contains("spacing"));
        assert!(with(|g| g.spacing.x = 1e308).contains("extent"));
        assert!(with(|g| g.origin.x = f64::INFINITY).contains("origin"));
        assert!(with(|g| g.direction.x_axis = g.direction.y_axis).contains("direction"));
    }
}
