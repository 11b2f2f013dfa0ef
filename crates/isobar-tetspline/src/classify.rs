//! Which cubes and tetrahedra can hold a piece of the surface: the paper's classification and two conservative ones.
//!
//! Kalbe et al. 2009, section 4.1, test the hull of the determining set of a cube, and say that by the convex hull property the others hold nothing. They may: `b1020`, `b1011`
//! and `b2010` are no convex combinations of the determining set (maths: corrections, section A, caution 1). [`Rule::Data`] and [`Rule::Coefficients`] are conservative: the 27 data,
//! and all coefficients of the 24 tetrahedra, enclose the spline.

use crate::cube::{self, Data};
use isobar_core::Tetrahedral;
use isobar_fields::Type6Spline;
use isobar_fields::type6::DeterminingSet;
use rayon::prelude::*;

/// How cubes are classified.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Rule {
    /// By the least and greatest of the 27 data: conservative, cheap.
    Data,
    /// By all coefficients of its tetrahedra: conservative, as tight as the hull property allows.
    Coefficients,
    /// By the determining set alone, as printed: **not** conservative.
    DeterminingSet,
}

/// Whether the 27 data of a cube (minus the isovalue, x fastest) can hold a zero within `margin` under a rule.
#[must_use]
pub fn is_active(rule: Rule, data: &[f64; 27], margin: f64) -> bool {
    let meets = |least: f64, greatest: f64| least <= margin && greatest >= -margin;
    let hull = |v: &mut dyn Iterator<Item = f64>| v.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)));
    let (least, greatest) = hull(&mut data.iter().copied());
    if !meets(least, greatest) {
        return false;
    }
    match rule {
        Rule::Data => true,
        Rule::Coefficients => active_kinds(data, margin) != 0,
        Rule::DeterminingSet => {
            let set = DeterminingSet::new(data);
            let edges = set.edges.iter().flatten().flatten();
            let (least, greatest) = hull(&mut set.vertices.iter().chain(edges).chain(&set.faces).map(|v| v / 192.0));
            meets(least, greatest)
        }
    }
}

/// Bit k: the hull of the 20 coefficients of kind k holds a value within `margin` of zero.
#[must_use]
pub fn active_kinds(data: &[f64; 27], margin: f64) -> u32 {
    let mut padded: Data = [0.0; 32];
    padded[..27].copy_from_slice(data);
    let mut mask = 0;
    for kind in 0..24 {
        let b = cube::patch(&padded, kind);
        let (mut least, mut greatest) = (b[0], b[0]);
        for &v in &b[1..] {
            least = least.min(v);
            greatest = greatest.max(v);
        }
        mask |= u32::from(least <= margin && greatest >= -margin) << kind;
    }
    mask
}

/// Cubes and tetrahedra by rule.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Counts {
    /// All cubes: as many as samples.
    pub cubes: usize,
    /// Active by their 27 data.
    pub by_data: usize,
    /// Active by all coefficients.
    pub by_coefficients: usize,
    /// Active by the determining set.
    pub by_determining_set: usize,
    /// Active by all coefficients and not by the determining set.
    pub rejected: usize,
    /// Of these, cubes in which s takes values on both sides of the isovalue for certain (at the centre, the vertices and the centroids of faces): lost surface.
    pub lost: usize,
    /// Active tetrahedra by their 20 coefficients.
    pub tetrahedra: usize,
}

/// Counts over all cubes of a grid, on all threads of the current pool. Comparisons are those of f64, without margin.
#[must_use]
pub fn count(spline: &Type6Spline, isovalue: f64) -> Counts {
    let dims = spline.dims();
    let one = |n: usize| {
        let cube = [n % dims[0], n / dims[0] % dims[1], n / dims[0] / dims[1]];
        let mut d = [0.0; 27];
        spline.data(cube, &mut d);
        for v in &mut d {
            *v -= isovalue;
        }
        let mut c = Counts {
            cubes: 1,
            ..Counts::default()
        };
        if is_active(Rule::Data, &d, 0.0) {
            c.by_data = 1;
            let kinds = active_kinds(&d, 0.0);
            let set = is_active(Rule::DeterminingSet, &d, 0.0);
            c.by_coefficients = usize::from(kinds != 0);
            c.by_determining_set = usize::from(set);
            c.tetrahedra = kinds.count_ones() as usize;
            if kinds != 0 && !set {
                c.rejected = 1;
                c.lost = usize::from(changes_sign(&d));
            }
        }
        c
    };
    let add = |a: Counts, b: Counts| Counts {
        cubes: a.cubes + b.cubes,
        by_data: a.by_data + b.by_data,
        by_coefficients: a.by_coefficients + b.by_coefficients,
        by_determining_set: a.by_determining_set + b.by_determining_set,
        rejected: a.rejected + b.rejected,
        lost: a.lost + b.lost,
        tetrahedra: a.tetrahedra + b.tetrahedra,
    };
    let all: usize = dims.iter().product();
    (0..all)
        .into_par_iter()
        .with_min_len(4096)
        .map(one)
        .reduce(Counts::default, add)
}

/// Whether s - c takes both signs among the vertices of the tetrahedra, where it equals a coefficient.
fn changes_sign(data: &[f64; 27]) -> bool {
    let mut padded: Data = [0.0; 32];
    padded[..27].copy_from_slice(data);
    let (mut below, mut above) = (false, false);
    for kind in 0..24 {
        let b = cube::patch(&padded, kind);
        for v in [b[0], b[10], b[16], b[19]] {
            below |= v < 0.0;
            above |= v > 0.0;
        }
    }
    below && above
}

#[cfg(test)]
mod tests {
    use super::*;
    use isobar_core::{Grid, Samples};

    /// The counter-example of the corrections: one voxel 1, the rest 0, any isovalue in (13/48, 3/8).
    #[test]
    fn the_determining_set_is_not_conservative() {
        for c in [0.28, 0.3, 0.37] {
            let mut d = [-c; 27];
            d[13] += 1.0;
            assert!(!is_active(Rule::DeterminingSet, &d, 0.0));
            assert!(is_active(Rule::Coefficients, &d, 0.0) && is_active(Rule::Data, &d, 0.0) && changes_sign(&d));
        }
        let mut d = [-0.27; 27];
        d[13] += 1.0;
        assert!(is_active(Rule::DeterminingSet, &d, 0.0), "13/48 is reached");
    }

    /// White noise at one standard deviation: 4.2 % of the cubes active by coefficients are rejected (maths: corrections, section A).
    #[test]
    fn noise_loses_some_cubes() {
        let n = 48;
        let mut s = 7u64;
        let mut unit = || {
            s = s
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            ((s >> 11) as f64 + 0.5) / (1u64 << 53) as f64
        };
        let samples: Vec<f32> = (0..n * n * n)
            .map(|_| ((-2.0 * unit().ln()).sqrt() * (std::f64::consts::TAU * unit()).cos()) as f32)
            .collect();
        let spline = Type6Spline::new(&Grid::unit([n; 3], Samples::F32(samples.into())).unwrap()).unwrap();
        let c = count(&spline, 1.0);
        let share = 100.0 * c.rejected as f64 / c.by_coefficients as f64;
        println!("{c:?}: {share:.2} % rejected");
        assert!((3.2..5.2).contains(&share), "{share}");
        assert!(c.by_data >= c.by_coefficients && c.lost > 0 && c.lost <= c.rejected);
        assert_eq!(c.by_coefficients, c.by_determining_set + c.rejected);
    }
}
