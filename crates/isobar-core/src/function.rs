//! The scalar function a method draws, described so that an oracle can be exact about it.

use crate::{Algebraic, Domain, HexPatches, Interval, Ray, TetMesh};
use glam::DVec3;
use std::fmt;

/// A scalar function s(x) on a closed [`Domain`], with what is needed to check an image of s = c.
pub trait Function: Send + Sync + fmt::Debug {
    /// Name of the reconstruction or field: `trilinear`, `cubic-interpolating`, `gyroid`.
    fn name(&self) -> String;

    /// Where it is defined. Outside, `value` and `gradient` are those of the nearest point of the domain (local coordinates clamped).
    fn domain(&self) -> &Domain;

    /// s(x) at a world point, f64 arithmetic (a few ulps of the largest coefficient nearby).
    fn value(&self, x: DVec3) -> f64;

    /// World gradient of s at a world point; on a border between pieces, that of one adjacent piece.
    fn gradient(&self, x: DVec3) -> DVec3;

    /// An interval that contains s(u) for all local u of the box `[lo, hi]` (local coordinates, cut by the domain). Rigorous.
    fn enclosure(&self, lo: DVec3, hi: DVec3) -> Interval;

    /// How s is made, for exact work.
    fn structure(&self) -> Structure<'_>;
}

/// How a function is made. Each form can be turned into exact polynomial pieces (or rigorous enclosures) along a ray.
#[derive(Debug)]
#[non_exhaustive]
pub enum Structure<'a> {
    /// A tensor-product spline over a lattice of cells.
    Lattice(&'a dyn Lattice),
    /// A cubic spline on the type-6 tetrahedral partition of the cubes about a lattice's samples.
    Tetrahedral(&'a dyn Tetrahedral),
    /// Linear in each tetrahedron of a mesh, in world coordinates. Its domain is the union of the closed cells with a volume: the [`Domain`] is only
    /// a box about them, and outside the cells there is no function and no root.
    Mesh(&'a TetMesh),
    /// Cell-wise parametric on trivariate rational Bezier elements: s(x(u)) = a(u). Its domain is the union of the closed elements: the [`Domain`] is
    /// only a box about them. In folded elements several u map to one point, and s has several values there.
    Elements(&'a HexPatches),
    /// One trivariate polynomial in world coordinates over the whole domain.
    Polynomial(&'a Algebraic),
    /// No polynomial: rigorous enclosures only.
    Analytic(&'a dyn Analytic),
}

/// The one-dimensional basis of a tensor-product spline piece, exactly.
///
/// On a cell, with `w` in [0, 1] measured from the cell's lower face and the `width` coefficients `c_j` of its stencil along the axis,
/// `s(w) = (1/denominator) * sum_k w^k * sum_j matrix[k][j] c_j`. All entries are small integers.
#[derive(Debug, PartialEq, Eq)]
pub struct Basis1 {
    /// Polynomial degree per axis: 1, 2 or 3. The stencil has `degree + 1` coefficients per axis.
    pub degree: usize,
    /// Common denominator of the matrix.
    pub denominator: i32,
    /// Row k: the weights of the coefficients in the factor of `w^k`. Rows and columns beyond `degree` are zero.
    pub matrix: [[i32; 4]; 4],
    /// Cells are centred on samples: cell i spans [i-1/2, i+1/2] of the local coordinate and its stencil starts at i-1.
    /// Otherwise cell i spans [i, i+1] and its stencil starts at `i + 1 - (degree + 1) / 2`: i for degree 1, i-1 for degree 3.
    pub centred: bool,
}

/// Linear interpolation between two samples.
pub static TRILINEAR: Basis1 = Basis1 {
    degree: 1,
    denominator: 1,
    matrix: [[1, 0, 0, 0], [-1, 1, 0, 0], [0; 4], [0; 4]],
    centred: false,
};

/// Uniform quadratic B-spline; maths B: the thesis prints the last row of its matrix wrongly as (1, -1, 1).
pub static QUADRATIC: Basis1 = Basis1 {
    degree: 2,
    denominator: 2,
    matrix: [[1, 1, 0, 0], [-2, 2, 0, 0], [1, -2, 1, 0], [0; 4]],
    centred: true,
};

/// Uniform cubic B-spline.
pub static CUBIC: Basis1 = Basis1 {
    degree: 3,
    denominator: 6,
    matrix: [[1, 4, 1, 0], [-3, 0, 3, 0], [3, -6, 3, 0], [-1, 3, -3, 1]],
    centred: false,
};

/// A tensor-product spline over a lattice: local coordinates are index space, the domain is [0, dims - 1] per axis.
///
/// Coefficients outside the grid follow the border rule inside [`Lattice::stencil`]; nobody else needs to know it.
pub trait Lattice: Send + Sync + fmt::Debug {
    /// Samples per axis, each at least 2.
    fn dims(&self) -> [usize; 3];

    /// The basis, the same on the three axes.
    fn basis(&self) -> &'static Basis1;

    /// Cells per axis: `dims - 1`, or `dims` where cells are centred on samples (the first and last are cut in half by the domain).
    fn cells(&self) -> [usize; 3] {
        let more = usize::from(self.basis().centred);
        self.dims().map(|n| n - 1 + more)
    }

    /// The `(degree + 1)^3` coefficients of a cell, x fastest, exactly as the function uses them, into the front of `out`.
    fn stencil(&self, cell: [usize; 3], out: &mut [f64; 64]);

    /// Least and greatest coefficient over the stencils of all cells of the box `lo..=hi`: s lies between them there, because the
    /// basis functions are non-negative and sum to one.
    fn range(&self, lo: [usize; 3], hi: [usize; 3]) -> Interval;
}

/// A cube cut into the 24 tetrahedra of the type-6 partition, and how the 20 Bernstein-Bezier coefficients of a cubic on each of them
/// come from the 27 data about the cube's centre. All entries are small integers; kinds of tetrahedra are numbered 0 to 23.
#[derive(Debug, PartialEq, Eq)]
pub struct TetMasks {
    /// Common denominator of the weights.
    pub denominator: i32,
    /// The exponents (i, j, k, l), i + j + k + l = 3, that the coefficients belong to: `p = sum b_ijkl 3!/(i! j! k! l!) phi0^i phi1^j phi2^k phi3^l`.
    pub indices: [[u8; 4]; 20],
    /// Vertices in half grid steps from the cube's centre: the centre, the centroid of a face, the two ends of an edge of that face.
    pub vertices: [[[i8; 3]; 4]; 24],
    /// Barycentric coordinates, exactly: `phi_v(x) = row[0] + row[1..] . x` with `row = barycentric[kind][v]` and x in grid steps from the centre.
    pub barycentric: [[[i8; 4]; 4]; 24],
    /// `weights[kind][coefficient][datum]`, data x fastest, each axis -1, 0, 1; not negative, with sum `denominator`.
    pub weights: [[[u8; 27]; 20]; 24],
}

/// A piecewise cubic over cubes centred on the samples of a lattice, each cut into 24 tetrahedra ([`TetMasks`]): local coordinates are index
/// space, the domain is [0, dims - 1] per axis, which cuts the outer cubes in half.
///
/// Data outside the grid follow the border rule inside [`Tetrahedral::data`]; nobody else needs to know it.
pub trait Tetrahedral: Send + Sync + fmt::Debug {
    /// Samples per axis, each at least 2; as many cubes.
    fn dims(&self) -> [usize; 3];

    /// The partition and the masks. The pieces join continuously (exactly, in exact arithmetic).
    fn masks(&self) -> &'static TetMasks;

    /// The 27 data of a cube, x fastest, exactly as the function uses them.
    fn data(&self, cube: [usize; 3], out: &mut [f64; 27]);

    /// Least and greatest datum of all cubes of the box `lo..=hi`: s lies between them there, because weights are not negative and sum to one.
    fn range(&self, lo: [usize; 3], hi: [usize; 3]) -> Interval;
}

/// A field without polynomial pieces.
pub trait Analytic: Send + Sync + fmt::Debug {
    /// Rigorous enclosures of `g(t) = s(o + t d)` and of `g'(t)` for all t of the interval. The point o + t d is the exact real
    /// one, and need not lie inside the domain.
    fn along_ray(&self, ray: &Ray, t: Interval) -> (Interval, Interval);
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Partition of unity: the constant row sums to the denominator, the others to zero.
    #[test]
    fn bases_sum_to_one() {
        for b in [&TRILINEAR, &QUADRATIC, &CUBIC] {
            for (k, row) in b.matrix.iter().enumerate() {
                let want = if k == 0 { b.denominator } else { 0 };
                assert_eq!(row.iter().sum::<i32>(), want, "degree {} row {k}", b.degree);
            }
        }
    }

    /// C^{d-1} at the joint: value and derivatives at w = 1 with stencil j equal those at w = 0 with stencil j + 1.
    #[test]
    fn bases_join_smoothly() {
        for b in [&TRILINEAR, &QUADRATIC, &CUBIC] {
            for order in 0..b.degree {
                for coefficient in 0..=b.degree + 1 {
                    let factor = |k: usize| (0..order).map(|i| (k as i64) - i as i64).product::<i64>();
                    let left: i64 = (order..=b.degree)
                        .map(|k| {
                            factor(k)
                                * if coefficient <= b.degree {
                                    i64::from(b.matrix[k][coefficient])
                                } else {
                                    0
                                }
                        })
                        .sum();
                    let right = if coefficient >= 1 {
                        factor(order) * i64::from(b.matrix[order][coefficient - 1])
                    } else {
                        0
                    };
                    assert_eq!(
                        left, right,
                        "degree {} derivative {order} coefficient {coefficient}",
                        b.degree
                    );
                }
            }
        }
    }
}
