//! Trivariate NURBS patches and other sources of rational Bezier elements: knot spans, algebraic polynomials, splines on grids.

use crate::hexes_bezier::{Tensor, extract, monomial, spans, split};
use crate::{GridSpline, Kind};
use glam::DVec3;
use isobar_core::{Algebraic, DataError, Function, Grid, HexElement, HexPatches, Stage, Structure};
use rayon::prelude::*;
use std::sync::atomic::{AtomicUsize, Ordering};

/// More elements than this are refused.
const MAX_HEXES: usize = 1 << 22;
/// More coefficients of elements than this (4 GiB) are refused.
const MAX_COEFFICIENTS: usize = 1 << 29;

/// A trivariate NURBS patch with a scalar in the same basis (Martin, Cohen, Kirby 2011, equation 1).
#[derive(Debug, Clone, PartialEq)]
pub struct NurbsPatch {
    /// Degree along u, v, w: 1 to 20 each.
    pub degree: [usize; 3],
    /// Knots per axis, not decreasing, at most `degree + 1` fold.
    pub knots: [Vec<f64>; 3],
    /// Control points x, y, z, weight (not premultiplied), u fastest: `knots - degree - 1` per axis.
    pub points: Vec<[f64; 4]>,
    /// One coefficient of the scalar per control point: `f = sum w c B / sum w B`.
    pub values: Vec<f64>,
}

impl NurbsPatch {
    /// Control points per axis, checked.
    fn counts(&self) -> Result<[usize; 3], DataError> {
        let bad = |what: String| Err(DataError::Elements(what));
        let mut counts = [0; 3];
        for (axis, name) in ["u", "v", "w"].into_iter().enumerate() {
            let (p, knots) = (self.degree[axis], &self.knots[axis]);
            if !(1..=usize::from(HexElement::MOST_DEGREE)).contains(&p) {
                return bad(format!(
                    "degree {p} along {name}; degrees go from 1 to {}",
                    HexElement::MOST_DEGREE
                ));
            }
            if knots.iter().any(|k| !k.is_finite()) || knots.windows(2).any(|k| k[0] > k[1]) {
                return bad(format!("the knots along {name} fall or are not finite"));
            }
            if knots.len() < 2 * (p + 1) || spans(p, knots).next().is_none() {
                return bad(format!("{} knots along {name} of degree {p} have no span", knots.len()));
            }
            if knots.windows(p + 2).any(|k| k[0] == k[p + 1]) {
                return bad(format!("a knot along {name} comes more than {} times", p + 1));
            }
            counts[axis] = knots.len() - p - 1;
        }
        let want = counts.iter().try_fold(1usize, |n, &c| n.checked_mul(c));
        if want != Some(self.points.len()) || self.points.len() != self.values.len() {
            return bad(format!(
                "{} control points and {} coefficients, the knots ask for {counts:?}",
                self.points.len(),
                self.values.len()
            ));
        }
        if self.points.iter().any(|p| !p.iter().all(|v| v.is_finite()) || p[3] <= 0.0)
            || self.values.iter().any(|v| !v.is_finite())
        {
            return bad("a control point or coefficient is not finite, or a weight is not positive".into());
        }
        Ok(counts)
    }

    /// One rational Bezier element per non-empty knot span, u fastest: exact but for the rounding of f64. Elements that join continuously have equal
    /// control points there, bit for bit. Where all weights are equal the elements are polynomial, weight 1.
    ///
    /// # Errors
    /// [`DataError::Elements`] where knots fall, are not finite, too few or repeated too often, a degree is out of range, counts disagree, a number is not
    /// finite, or a weight is not positive.
    pub fn elements(&self) -> Result<Vec<HexElement>, DataError> {
        let counts = self.counts()?;
        let polynomial = self.points.iter().all(|p| p[3] == self.points[0][3]);
        // x, y, z, value; then the weight, where there is one.
        let channel = |f: &dyn Fn(usize) -> f64| {
            let values = (0..self.points.len()).map(f).collect();
            (0..3).fold(Tensor { counts, values }, |t, axis| {
                t.along(axis, |c| extract(self.degree[axis], &self.knots[axis], c))
            })
        };
        let weight = |i: usize| if polynomial { 1.0 } else { self.points[i][3] };
        let [x, y, z] = [0, 1, 2].map(|c| channel(&|i| weight(i) * self.points[i][c]));
        let a = channel(&|i| weight(i) * self.values[i]);
        let w = (!polynomial).then(|| channel(&weight));
        let n = self.degree.map(|d| d + 1);
        let per: [usize; 3] = std::array::from_fn(|c| x.counts[c] / n[c]);
        let count = per.iter().product::<usize>();
        if count > MAX_HEXES {
            return Err(DataError::Elements(format!("{count} knot spans are more than {MAX_HEXES}")));
        }
        Ok((0..count)
            .map(|e| {
                let e = [e % per[0], e / per[0] % per[1], e / per[0] / per[1]];
                let index = |i: usize| {
                    let i = [i % n[0], i / n[0] % n[1], i / n[0] / n[1]];
                    let [u, v, w]: [usize; 3] = std::array::from_fn(|c| e[c] * n[c] + i[c]);
                    (w * x.counts[1] + v) * x.counts[0] + u
                };
                let all = n.iter().product::<usize>();
                let degree = self.degree.map(|d| d as u8);
                HexElement {
                    degree,
                    points: (0..all)
                        .map(|i| {
                            let i = index(i);
                            let w = w.as_ref().map_or(1.0, |w| w.values[i]);
                            [x.values[i] / w, y.values[i] / w, z.values[i] / w, w]
                        })
                        .collect(),
                    value_degree: degree,
                    values: (0..all)
                        .map(|i| {
                            let i = index(i);
                            a.values[i] / w.as_ref().map_or(1.0, |w| w.values[i])
                        })
                        .collect(),
                    rational_value: !polynomial,
                }
            })
            .collect())
    }
}

/// Every element cut into eight at the middle of its parameters: the same maps but for rounding, u fastest among the eight.
///
/// # Errors
/// [`DataError::Elements`] where there would be more than 2^22 elements.
pub fn refine_hexes(patches: &HexPatches) -> Result<HexPatches, DataError> {
    let count = patches.elements.len().saturating_mul(8);
    if count > MAX_HEXES {
        return Err(DataError::Elements(format!("{count} are more than {MAX_HEXES}")));
    }
    let elements: Vec<HexElement> = patches.elements.par_iter().flat_map_iter(eighths).collect();
    HexPatches::new(elements)
}

/// The eight parts of an element.
fn eighths(e: &HexElement) -> Vec<HexElement> {
    let cut = |t: &Tensor<f64>| {
        (0..3).fold(vec![t.clone()], |parts, axis| {
            // The upper halves of this axis after all lower ones: u fastest.
            let half = |upper: bool| {
                parts
                    .iter()
                    .map(|t| {
                        t.along(axis, |c| {
                            let (lower, higher) = split(c, &0.5);
                            if upper { higher } else { lower }
                        })
                    })
                    .collect::<Vec<_>>()
            };
            [half(false), half(true)].concat()
        })
    };
    let tensor = |degree: [u8; 3], values: Vec<f64>| {
        cut(&Tensor {
            counts: degree.map(|d| usize::from(d) + 1),
            values,
        })
    };
    let flat = e.is_polynomial();
    let weight = |i: usize| if flat { 1.0 } else { e.points[i][3] };
    let n = e.points.len();
    let [x, y, z] = [0, 1, 2].map(|c| tensor(e.degree, (0..n).map(|i| weight(i) * e.points[i][c]).collect()));
    let w = tensor(e.degree, (0..n).map(weight).collect());
    let rational = e.rational_value && !flat;
    let a = tensor(
        e.value_degree,
        (0..e.values.len())
            .map(|i| if rational { weight(i) * e.values[i] } else { e.values[i] })
            .collect(),
    );
    (0..8)
        .map(|k| HexElement {
            points: (0..n)
                .map(|i| {
                    let w = w[k].values[i];
                    [x[k].values[i] / w, y[k].values[i] / w, z[k].values[i] / w, w]
                })
                .collect(),
            values: (0..e.values.len())
                .map(|i| {
                    if rational {
                        a[k].values[i] / w[k].values[i]
                    } else {
                        a[k].values[i]
                    }
                })
                .collect(),
            rational_value: rational,
            ..e.clone()
        })
        .collect()
}

/// The trilinear Bezier element of a box, weights 1.
fn box_element(lo: DVec3, hi: DVec3, value_degree: [u8; 3], values: Box<[f64]>) -> HexElement {
    HexElement {
        degree: [1; 3],
        points: (0..8)
            .map(|n| {
                let pick = |a: usize| if n >> a & 1 == 0 { lo[a] } else { hi[a] };
                [pick(0), pick(1), pick(2), 1.0]
            })
            .collect(),
        value_degree,
        values,
        rational_value: false,
    }
}

/// An algebraic polynomial as one element with identity geometry: its Bernstein coefficients on its box by blossoming (equation 27).
///
/// # Errors
/// As [`HexPatches::new`].
pub fn algebraic_to_hexes(p: &Algebraic) -> Result<HexPatches, DataError> {
    let degree: [usize; 3] = std::array::from_fn(|a| p.terms.iter().map(|(e, _)| usize::from(e[a])).max().unwrap_or(0));
    let counts = degree.map(|d| d + 1);
    let mut values = vec![0.0; counts.iter().product()];
    for (e, k) in p.terms.iter() {
        let m: [Vec<f64>; 3] = std::array::from_fn(|a| monomial(usize::from(e[a]), degree[a], &p.lo[a], &p.hi[a]));
        for (n, v) in values.iter_mut().enumerate() {
            *v += k * m[0][n % counts[0]] * m[1][n / counts[0] % counts[1]] * m[2][n / counts[0] / counts[1]];
        }
    }
    HexPatches::new(vec![box_element(p.lo, p.hi, degree.map(|d| d as u8), values.into())])
}

/// A tensor-product spline reconstruction of a grid as Bezier elements with trilinear geometry, one per cell of the lattice inside the domain, x fastest:
/// the very function of `reconstruction=kind` at a stage, but for rounding.
///
/// # Errors
/// As [`GridSpline::new`]; [`DataError::Dims`] where there would be more than 2^22 elements or 2^29 coefficients.
pub fn spline_to_hexes(grid: &Grid, kind: Kind, stage: Stage) -> Result<HexPatches, DataError> {
    spline_to_hexes_where(grid, kind, stage, |_| true)
}

/// As [`spline_to_hexes`], of the cells whose Bernstein coefficients `keep` accepts only: those that may reach an isovalue, say.
///
/// # Errors
/// As [`spline_to_hexes`], the number being that of the cells kept; [`DataError::Elements`] where none are.
pub fn spline_to_hexes_where(
    grid: &Grid,
    kind: Kind,
    stage: Stage,
    keep: impl Fn(&[f64]) -> bool + Sync,
) -> Result<HexPatches, DataError> {
    let spline = GridSpline::new(grid, kind, stage)?;
    let Structure::Lattice(lattice) = spline.structure() else {
        return Err(DataError::Unknown(format!("{kind} is no spline on a lattice")));
    };
    let (basis, cells) = (lattice.basis(), lattice.cells());
    let (d, n) = (basis.degree, basis.degree + 1);
    let count = cells
        .iter()
        .try_fold(1usize, |n, &c| n.checked_mul(c))
        .ok_or(DataError::Dims(grid.dims))?;
    let most = MAX_HEXES.min(MAX_COEFFICIENTS / (n * n * n));
    let kept = AtomicUsize::new(0);
    let domain = grid.domain();
    let top = grid.dims.map(|n| (n - 1) as f64);
    let elements: Vec<HexElement> = (0..count)
        .into_par_iter()
        .filter_map(|e| {
            // More than there may be: the rest is not made.
            if kept.load(Ordering::Relaxed) > most {
                return None;
            }
            let cell = [e % cells[0], e / cells[0] % cells[1], e / cells[0] / cells[1]];
            let mut stencil = [0.0; 64];
            lattice.stencil(cell, &mut stencil);
            // The part of the cell inside the domain, in the cell's own w in [0, 1] and in index space.
            let start = cell.map(|c| if basis.centred { c as f64 - 0.5 } else { c as f64 });
            let (mut lo, mut hi) = ([0.0; 3], [1.0; 3]);
            for a in 0..3 {
                lo[a] = (-start[a]).max(0.0);
                hi[a] = (top[a] - start[a]).min(1.0);
            }
            let t = (0..3).fold(
                Tensor {
                    counts: [n; 3],
                    values: stencil[..n * n * n].to_vec(),
                },
                |t, a| t.along(a, |c| bernstein(basis, d, c, lo[a], hi[a])),
            );
            if !keep(&t.values) {
                return None;
            }
            kept.fetch_add(1, Ordering::Relaxed);
            let corner = |n: usize| {
                let at = |a: usize| start[a] + if n >> a & 1 == 0 { lo[a] } else { hi[a] };
                domain.world(DVec3::new(at(0), at(1), at(2)))
            };
            Some(HexElement {
                degree: [1; 3],
                points: (0..8).map(corner).map(|x| [x.x, x.y, x.z, 1.0]).collect(),
                value_degree: [d as u8; 3],
                values: t.values.into(),
                rational_value: false,
            })
        })
        .collect();
    if elements.len() > most {
        return Err(DataError::Dims(grid.dims));
    }
    HexPatches::new(elements)
}

/// Bernstein coefficients on [lo, hi] of the piece with stencil `c`.
fn bernstein(basis: &isobar_core::Basis1, d: usize, c: &[f64], lo: f64, hi: f64) -> Vec<f64> {
    let mut out = vec![0.0; d + 1];
    for k in 0..=d {
        let power: f64 = (0..=d).map(|j| f64::from(basis.matrix[k][j]) * c[j]).sum::<f64>() / f64::from(basis.denominator);
        for (o, m) in out.iter_mut().zip(monomial(k, d, &lo, &hi)) {
            *o += power * m;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{HexField, evaluate_hex};
    use isobar_core::Samples;

    /// The quarter annulus of hardcases D1 with an extra knot in v, the attribute its radius squared in no way rational: y^2 + x^2 is not wanted, x is.
    fn annulus() -> NurbsPatch {
        let h = std::f64::consts::FRAC_1_SQRT_2;
        let arc = [[1.0, 0.0, 1.0], [1.0, 1.0, h], [0.0, 1.0, 1.0]];
        let points: Vec<[f64; 4]> = (0..18)
            .map(|n| {
                let ([c, s, w], r) = (arc[n % 3], 1.0 + 0.5 * (n / 3 % 3) as f64);
                [r * c, r * s, (n / 9) as f64, w]
            })
            .collect();
        NurbsPatch {
            degree: [2, 1, 1],
            knots: [
                vec![0.0, 0.0, 0.0, 1.0, 1.0, 1.0],
                vec![0.0, 0.0, 0.5, 1.0, 1.0],
                vec![0.0, 0.0, 1.0, 1.0],
            ],
            values: points.iter().map(|p| p[0]).collect(),
            points,
        }
    }

    #[test]
    fn spans_become_elements_that_share_faces() {
        let e = annulus().elements().unwrap();
        assert_eq!(e.len(), 2);
        for k in 0..2 {
            for i in 0..3 {
                let (a, b) = (k * 6 + 3 + i, k * 6 + i);
                assert_eq!(e[0].points[a].map(f64::to_bits), e[1].points[b].map(f64::to_bits));
                assert_eq!(e[0].values[a].to_bits(), e[1].values[b].to_bits());
            }
        }
        let p = evaluate_hex(&e[1], DVec3::new(0.3, 0.5, 0.25));
        assert!((p.position.truncate().length() - 1.75).abs() < 1e-15 && (p.position.z - 0.25).abs() < 1e-15);
        assert!((p.value - p.position.x).abs() < 1e-15);
        let mut flat = annulus();
        flat.points.iter_mut().for_each(|p| p[3] = 2.0);
        let e = flat.elements().unwrap();
        assert!(
            e.iter()
                .all(|e| e.is_polynomial() && !e.rational_value && e.points[0][3] == 1.0)
        );
    }

    #[test]
    fn eighths_are_the_same_maps() {
        let whole = HexPatches::new(annulus().elements().unwrap()).unwrap();
        let parts = refine_hexes(&whole).unwrap();
        assert_eq!(parts.elements.len(), 16);
        for (i, e) in parts.elements.iter().enumerate() {
            let corner = DVec3::new((i & 1) as f64, (i >> 1 & 1) as f64, (i >> 2 & 1) as f64);
            let u = DVec3::new(0.3, 0.9, 0.4);
            let (a, b) = (evaluate_hex(e, u), evaluate_hex(&whole.elements[i / 8], (corner + u) * 0.5));
            assert!((a.position - b.position).length() < 1e-15 && (a.value - b.value).abs() < 1e-15);
        }
    }

    #[test]
    fn bad_patches_are_one_line() {
        let said = |change: &dyn Fn(&mut NurbsPatch)| {
            let mut p = annulus();
            change(&mut p);
            p.elements().unwrap_err().to_string()
        };
        assert!(said(&|p| p.knots[0][2] = 2.0).contains("fall"));
        assert!(said(&|p| p.knots[0][2] = f64::NAN).contains("finite"));
        assert!(said(&|p| p.knots[1] = vec![0.0, 1.0]).contains("no span"));
        assert!(said(&|p| p.knots[1][2] = 0.0).contains("more than 2 times"));
        assert!(said(&|p| p.degree[2] = 0).contains("degree 0"));
        assert!(said(&|p| p.degree[2] = 21).contains("1 to 20"));
        assert!(said(&|p| p.points.truncate(17)).contains("17 control points"));
        assert!(said(&|p| p.points[4][3] = 0.0).contains("positive"));
        assert!(said(&|p| p.values[4] = f64::INFINITY).contains("finite"));
    }

    #[test]
    fn polynomials_and_splines_are_reproduced() {
        // hardcases D7: the teardrop
        let terms = [([5, 0, 0], 0.5), ([4, 0, 0], 0.5), ([0, 2, 0], -1.0), ([0, 0, 2], -1.0)];
        let p = Algebraic::new("teardrop", terms, DVec3::splat(-1.25), DVec3::splat(1.25)).unwrap();
        let h = algebraic_to_hexes(&p).unwrap();
        assert_eq!(h.elements[0].value_degree, [5, 2, 2]);
        let s: Vec<f32> = (0..180).map(|i| (i * 37 % 101) as f32).collect();
        let grid = Grid::unit([6, 5, 6], Samples::F32(s.into())).unwrap();
        for i in 0..50 {
            let u = DVec3::new((i % 5) as f64, (i / 5 % 5) as f64, (i % 7) as f64) * DVec3::new(0.2, 0.19, 0.13) + 0.03;
            let at = evaluate_hex(&h.elements[0], u);
            assert!(
                (at.value - p.value(at.position)).abs() < 1e-13 && (at.gradient() - p.gradient(at.position)).length() < 1e-12
            );
        }
        for kind in [Kind::Trilinear, Kind::Quadratic, Kind::CubicInterpolating] {
            let f = GridSpline::new(&grid, kind, Stage::Ideal).unwrap();
            let h = HexField::new(&spline_to_hexes(&grid, kind, Stage::Ideal).unwrap()).unwrap();
            for i in 0..40 {
                let x = DVec3::new((i % 5) as f64, (i / 5 % 5) as f64, (i % 7) as f64) * DVec3::new(1.2, 0.97, 0.8) + 0.04;
                assert!(
                    (f.value(x) - h.value(x)).abs() < 1e-10,
                    "{kind} {x}: {} {}",
                    f.value(x),
                    h.value(x)
                );
            }
        }
    }
}
