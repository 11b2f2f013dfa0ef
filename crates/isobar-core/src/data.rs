//! Containers of data: what a method is given to draw. Conversions between them live in isobar-fields.

use crate::{DataError, Domain, HexPatches};
use glam::{DMat3, DVec3};
use std::sync::Arc;

/// Any data a scene may show. Shared by `Arc`; methods re-lay it out only where that pays.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub enum Data {
    /// Samples on a regular lattice.
    Grid(Grid),
    /// Tetrahedra with values at the vertices.
    Tets(TetMesh),
    /// Trivariate Bezier elements.
    Hexes(HexPatches),
    /// One polynomial.
    Algebraic(Algebraic),
}

impl Data {
    /// The kind, in words: `grid`, `tets`, `hexes`, `algebraic`.
    #[must_use]
    pub const fn kind(&self) -> &'static str {
        match self {
            Self::Grid(_) => "grid",
            Self::Tets(_) => "tets",
            Self::Hexes(_) => "hexes",
            Self::Algebraic(_) => "algebraic",
        }
    }

    /// World bounds `(min, max)`.
    #[must_use]
    pub fn bounds(&self) -> (DVec3, DVec3) {
        let of = |points: &mut dyn Iterator<Item = DVec3>| {
            points.fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(lo, hi), p| (lo.min(p), hi.max(p)))
        };
        match self {
            Self::Grid(g) => g.domain().world_bounds(),
            Self::Tets(m) => of(&mut m.points.iter().copied()),
            Self::Hexes(h) => of(&mut h
                .elements
                .iter()
                .flat_map(|e| e.points.iter().map(|p| DVec3::new(p[0], p[1], p[2])))),
            Self::Algebraic(a) => (a.lo, a.hi),
        }
    }

    /// Bytes of the samples, points, cells and coefficients.
    #[must_use]
    pub fn bytes(&self) -> usize {
        match self {
            Self::Grid(g) => g.samples.bytes(),
            Self::Tets(m) => m.points.len() * 24 + m.cells.len() * 16 + m.values.len() * 4,
            Self::Hexes(h) => h.elements.iter().map(|e| e.points.len() * 32 + e.values.len() * 8).sum(),
            Self::Algebraic(a) => a.terms.len() * 12,
        }
    }
}

/// Scalar samples in their own type, x fastest.
#[derive(Debug, Clone, PartialEq)]
pub enum Samples {
    /// Unsigned bytes.
    U8(Arc<[u8]>),
    /// Signed 16-bit integers.
    I16(Arc<[i16]>),
    /// Unsigned 16-bit integers.
    U16(Arc<[u16]>),
    /// 32-bit floats.
    F32(Arc<[f32]>),
}

/// Runs `$body` with `$s` bound to the typed slice.
macro_rules! each {
    ($samples:expr, $s:ident => $body:expr) => {
        match $samples {
            Samples::U8($s) => $body,
            Samples::I16($s) => $body,
            Samples::U16($s) => $body,
            Samples::F32($s) => $body,
        }
    };
}

impl Samples {
    /// Number of samples.
    #[must_use]
    pub fn len(&self) -> usize {
        each!(self, s => s.len())
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Sample i, exactly.
    ///
    /// # Panics
    /// When i is out of range.
    #[must_use]
    #[inline]
    pub fn get(&self, i: usize) -> f64 {
        each!(self, s => f64::from(s[i]))
    }

    /// Bytes held.
    #[must_use]
    pub fn bytes(&self) -> usize {
        each!(self, s => size_of_val::<[_]>(s))
    }

    /// `u8`, `i16`, `u16` or `f32`.
    #[must_use]
    pub const fn type_name(&self) -> &'static str {
        match self {
            Self::U8(_) => "u8",
            Self::I16(_) => "i16",
            Self::U16(_) => "u16",
            Self::F32(_) => "f32",
        }
    }

    /// Least and greatest finite sample and the number of NaN or infinite ones; `None` for the range where no sample is finite.
    #[must_use]
    pub fn range(&self) -> (Option<(f64, f64)>, usize) {
        let mut range: Option<(f64, f64)> = None;
        let mut bad = 0;
        each!(self, s => for &v in s.iter() {
            let v = f64::from(v);
            if v.is_finite() {
                range = Some(range.map_or((v, v), |(lo, hi)| (lo.min(v), hi.max(v))));
            } else {
                bad += 1;
            }
        });
        (range, bad)
    }
}

/// Samples on a lattice: sample (i, j, k) lies at `origin + direction * (spacing * (i, j, k))`.
#[derive(Debug, Clone, PartialEq)]
pub struct Grid {
    /// Samples per axis.
    pub dims: [usize; 3],
    /// World distance of samples along each axis, positive.
    pub spacing: DVec3,
    /// World position of sample (0, 0, 0).
    pub origin: DVec3,
    /// Columns: unit directions of the axes (not necessarily orthogonal; may be left-handed).
    pub direction: DMat3,
    /// The samples, x fastest, in data units.
    pub samples: Samples,
}

impl Grid {
    /// A grid with spacing, origin and direction checked.
    ///
    /// # Errors
    /// [`DataError::Dims`], [`DataError::Count`] or [`DataError::Geometry`]. Samples that are not finite are not refused here: see
    /// [`Grid::require_finite`].
    pub fn new(dims: [usize; 3], spacing: DVec3, origin: DVec3, direction: DMat3, samples: Samples) -> Result<Self, DataError> {
        let n = dims
            .iter()
            .try_fold(1usize, |n, &d| n.checked_mul(d))
            .filter(|&n| n > 0)
            .ok_or(DataError::Dims(dims))?;
        if samples.len() != n {
            return Err(DataError::Count {
                dims,
                found: samples.len(),
            });
        }
        let bad = |what, value: String| Err(DataError::Geometry { what, value });
        if !(spacing.is_finite() && spacing.cmpgt(DVec3::ZERO).all()) {
            return bad("spacing", spacing.to_string());
        }
        if !origin.is_finite() {
            return bad("origin", origin.to_string());
        }
        // Unit columns: the determinant is the volume of the unit cell, so this bound is scale free.
        if !(direction.is_finite() && direction.determinant().abs() > 1e-9) {
            return bad("direction", direction.to_string());
        }
        let grid = Self {
            dims,
            spacing,
            origin,
            direction,
            samples,
        };
        let (lo, hi) = grid.domain().world_bounds();
        if !(lo.is_finite() && hi.is_finite()) {
            return bad("extent", format!("{lo} to {hi}"));
        }
        Ok(grid)
    }

    /// An axis-aligned grid with unit spacing at the origin.
    ///
    /// # Errors
    /// [`DataError::Dims`] or [`DataError::Count`].
    pub fn unit(dims: [usize; 3], samples: Samples) -> Result<Self, DataError> {
        Self::new(dims, DVec3::ONE, DVec3::ZERO, DMat3::IDENTITY, samples)
    }

    /// The lattice's domain: the box of the sample centres, local coordinates are indices.
    #[must_use]
    pub fn domain(&self) -> Domain {
        Domain {
            origin: self.origin,
            axes: DMat3::from_cols(
                self.direction.x_axis * self.spacing.x,
                self.direction.y_axis * self.spacing.y,
                self.direction.z_axis * self.spacing.z,
            ),
            lo: DVec3::ZERO,
            hi: DVec3::from_array(self.dims.map(|n| (n - 1) as f64)),
        }
    }

    /// Position of sample (i, j, k) in `samples`.
    #[must_use]
    #[inline]
    pub fn index(&self, [i, j, k]: [usize; 3]) -> usize {
        (k * self.dims[1] + j) * self.dims[0] + i
    }

    /// Sample (i, j, k), exactly.
    ///
    /// # Panics
    /// When the index is out of range.
    #[must_use]
    #[inline]
    pub fn sample(&self, ijk: [usize; 3]) -> f64 {
        self.samples.get(self.index(ijk))
    }

    /// Checks that all samples are finite.
    ///
    /// # Errors
    /// [`DataError::NotFinite`] with the number of samples that are not.
    pub fn require_finite(&self) -> Result<(), DataError> {
        match self.samples.range().1 {
            0 => Ok(()),
            count => Err(DataError::NotFinite {
                count,
                total: self.samples.len(),
            }),
        }
    }
}

/// Tetrahedra with one value per point, linear inside each.
#[derive(Debug, Clone, PartialEq)]
pub struct TetMesh {
    /// World positions.
    pub points: Arc<[DVec3]>,
    /// Four point indices each, any orientation.
    pub cells: Arc<[[u32; 4]]>,
    /// Value at each point, data units.
    pub values: Arc<[f32]>,
}

impl TetMesh {
    /// A mesh with connectivity and numbers checked.
    ///
    /// # Errors
    /// [`DataError::Mesh`] where there are no cells, an index is out of range, the counts disagree, or a number is not finite.
    pub fn new(points: Arc<[DVec3]>, cells: Arc<[[u32; 4]]>, values: Arc<[f32]>) -> Result<Self, DataError> {
        let bad = |s: String| Err(DataError::Mesh(s));
        if cells.is_empty() {
            return bad("it has no cells".into());
        }
        if points.len() != values.len() {
            return bad(format!("{} points but {} values", points.len(), values.len()));
        }
        if let Some(c) = cells.iter().find(|c| c.iter().any(|&i| i as usize >= points.len())) {
            return bad(format!("cell {c:?} names a point beyond the {} there are", points.len()));
        }
        if points.iter().any(|p| !p.is_finite()) {
            return bad("a point is not finite".into());
        }
        let count = values.iter().filter(|v| !v.is_finite()).count();
        if count > 0 {
            return Err(DataError::NotFinite {
                count,
                total: values.len(),
            });
        }
        Ok(Self { points, cells, values })
    }
}

/// A trivariate polynomial `sum coefficient * x^a y^b z^c` in world coordinates, over the box `[lo, hi]`.
#[derive(Debug, Clone, PartialEq)]
pub struct Algebraic {
    /// Its name.
    pub name: String,
    /// `([a, b, c], coefficient)`; exponents at most [`Algebraic::MOST`] each, each triple once.
    pub terms: Arc<[([u8; 3], f64)]>,
    /// Lower corner of the domain.
    pub lo: DVec3,
    /// Upper corner.
    pub hi: DVec3,
}

impl Algebraic {
    /// Greatest exponent of a coordinate.
    pub const MOST: u8 = 15;

    /// A polynomial that everything downstream can draw: this is how to make one from input.
    ///
    /// # Errors
    /// [`DataError::Algebraic`] where an exponent exceeds [`Algebraic::MOST`], a triple of exponents comes twice, a coefficient or a corner is not
    /// finite, or the box has no inside.
    pub fn new(
        name: impl Into<String>,
        terms: impl Into<Arc<[([u8; 3], f64)]>>,
        lo: DVec3,
        hi: DVec3,
    ) -> Result<Self, DataError> {
        let new = Self {
            name: name.into(),
            terms: terms.into(),
            lo,
            hi,
        };
        new.check()?;
        Ok(new)
    }

    /// Whether [`Algebraic::new`] would have made this, for one made field by field.
    ///
    /// # Errors
    /// As [`Algebraic::new`].
    pub fn check(&self) -> Result<(), DataError> {
        let bad = |what: String| Err(DataError::Algebraic(format!("{}: {what}", self.name)));
        let mut seen: Vec<[u8; 3]> = Vec::with_capacity(self.terms.len());
        for (e, k) in self.terms.iter() {
            let term = || format!("the term {k} x^{} y^{} z^{}", e[0], e[1], e[2]);
            if e.iter().any(|&p| p > Self::MOST) {
                return bad(format!("{} has an exponent above {}", term(), Self::MOST));
            }
            if !k.is_finite() {
                return bad(format!("{} is not finite", term()));
            }
            seen.push(*e);
        }
        seen.sort_unstable();
        if let Some(w) = seen.windows(2).find(|w| w[0] == w[1]) {
            let [x, y, z] = w[0];
            return bad(format!("x^{x} y^{y} z^{z} comes twice; add the coefficients up"));
        }
        if !(self.lo.is_finite() && self.hi.is_finite() && self.lo.cmplt(self.hi).all()) {
            return bad(format!("the box from {} to {} has no inside", self.lo, self.hi));
        }
        Ok(())
    }

    /// Greatest total degree of a term: the degree of the polynomial along any ray.
    #[must_use]
    pub fn degree(&self) -> usize {
        self.terms
            .iter()
            .map(|(e, _)| e.iter().map(|&p| usize::from(p)).sum())
            .max()
            .unwrap_or(0)
    }

    /// Value at a world point, f64.
    #[must_use]
    pub fn value(&self, x: DVec3) -> f64 {
        self.terms
            .iter()
            .map(|([a, b, c], k)| k * x.x.powi(i32::from(*a)) * x.y.powi(i32::from(*b)) * x.z.powi(i32::from(*c)))
            .sum()
    }

    /// Gradient at a world point, f64.
    #[must_use]
    pub fn gradient(&self, x: DVec3) -> DVec3 {
        let p = |v: f64, e: u8| v.powi(i32::from(e));
        let d = |v: f64, e: u8| if e == 0 { 0.0 } else { f64::from(e) * p(v, e - 1) };
        self.terms.iter().fold(DVec3::ZERO, |g, ([a, b, c], k)| {
            g + DVec3::new(
                k * d(x.x, *a) * p(x.y, *b) * p(x.z, *c),
                k * p(x.x, *a) * d(x.y, *b) * p(x.z, *c),
                k * p(x.x, *a) * p(x.y, *b) * d(x.z, *c),
            )
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_polynomial_checks_its_exponents_coefficients_and_box() {
        let make = |terms: &[([u8; 3], f64)], hi: f64| Algebraic::new("p", terms, DVec3::NEG_ONE, DVec3::splat(hi));
        assert_eq!(make(&[([15, 0, 0], 1.0), ([0, 0, 15], -2.0)], 1.0).unwrap().degree(), 15);
        assert!(make(&[], 1.0).is_ok());
        let said = |r: Result<Algebraic, DataError>| r.unwrap_err().to_string();
        let e = said(make(&[([0, 16, 0], 1.0)], 1.0));
        assert_eq!(e, "unusable polynomial: p: the term 1 x^0 y^16 z^0 has an exponent above 15");
        assert!(said(make(&[([0; 3], f64::NAN)], 1.0)).contains("not finite"));
        assert!(said(make(&[([1, 0, 0], 1.0), ([0; 3], 1.0), ([1, 0, 0], 1.0)], 1.0)).contains("comes twice"));
        for hi in [-1.0, f64::NAN, f64::INFINITY] {
            assert!(said(make(&[], hi)).contains("no inside"));
        }
    }

    #[test]
    fn a_grid_checks_its_counts_and_geometry() {
        let s = || Samples::U8(vec![0; 8].into());
        assert!(Grid::unit([2, 2, 2], s()).is_ok());
        assert_eq!(
            Grid::unit([2, 2, 3], s()),
            Err(DataError::Count {
                dims: [2, 2, 3],
                found: 8
            })
        );
        assert!(matches!(Grid::unit([0, 2, 3], s()), Err(DataError::Dims(_))));
        assert!(matches!(Grid::unit([usize::MAX, 2, 3], s()), Err(DataError::Dims(_))));
        for spacing in [
            DVec3::new(0.0, 1.0, 1.0),
            DVec3::new(f64::NAN, 1.0, 1.0),
            DVec3::new(-1.0, 1.0, 1.0),
        ] {
            assert!(matches!(
                Grid::new([2, 2, 2], spacing, DVec3::ZERO, DMat3::IDENTITY, s()),
                Err(DataError::Geometry { what: "spacing", .. })
            ));
        }
        let flat = DMat3::from_cols(DVec3::X, DVec3::X, DVec3::Z);
        assert!(Grid::new([2, 2, 2], DVec3::ONE, DVec3::ZERO, flat, s()).is_err());
    }

    #[test]
    fn ranges_leave_out_what_is_not_finite() {
        let s = Samples::F32(vec![1.0, f32::NAN, -2.0, f32::INFINITY].into());
        assert_eq!(s.range(), (Some((-2.0, 1.0)), 2));
        assert_eq!(Samples::F32(vec![f32::NAN].into()).range(), (None, 1));
    }

    #[test]
    fn meshes_are_checked() {
        let p: Arc<[DVec3]> = vec![DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z].into();
        let v: Arc<[f32]> = vec![0.0; 4].into();
        assert!(TetMesh::new(p.clone(), vec![[0, 1, 2, 3]].into(), v.clone()).is_ok());
        assert!(TetMesh::new(p.clone(), vec![[0, 1, 2, 4]].into(), v.clone()).is_err());
        assert!(TetMesh::new(p, vec![].into(), v).is_err());
    }

    #[test]
    fn polynomials_have_value_gradient_and_degree() {
        let a = Algebraic {
            name: "test".into(),
            terms: vec![([2, 0, 1], 3.0), ([0, 1, 0], -1.0)].into(),
            lo: DVec3::NEG_ONE,
            hi: DVec3::ONE,
        };
        assert_eq!(a.degree(), 3);
        assert_eq!(a.value(DVec3::new(2.0, 5.0, 0.5)), 1.0);
        assert_eq!(a.gradient(DVec3::new(2.0, 5.0, 0.5)), DVec3::new(6.0, -1.0, 12.0));
    }
}
