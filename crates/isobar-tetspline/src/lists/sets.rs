//! The determining sets of many cubes: sixteen side by side, so that the rules' indices are worked out once for all of them.

use super::kinds::{Value, gather};
use isobar_fields::type6::{DeterminingSet, Number};
use std::array::from_fn;
use std::ops::{Add, Mul, Sub};

/// Numbers of a determining set.
pub(super) const SET: usize = 56;

/// Cubes side by side.
const SIDE_BY_SIDE: usize = 16;

/// One number of each cube.
#[derive(Debug, Clone, Copy)]
struct Row([f64; SIDE_BY_SIDE]);

impl Add for Row {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        Self(from_fn(|l| self.0[l] + o.0[l]))
    }
}
impl Sub for Row {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        Self(from_fn(|l| self.0[l] - o.0[l]))
    }
}
impl Mul for Row {
    type Output = Self;
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        Self(from_fn(|l| self.0[l] * o.0[l]))
    }
}
impl Number for Row {
    #[inline(always)]
    fn small(k: i32) -> Self {
        Self([k.into(); SIDE_BY_SIDE])
    }
    #[inline(always)]
    fn half(self) -> Self {
        Self(self.0.map(|v| 0.5 * v))
    }
}

/// 192 times the determining sets of some cubes, less the isovalue.
pub(super) fn store<T: Value>(data: &[T], dims: [usize; 3], isovalue: f64, cubes: &[u32], out: &mut [[f32; SET]]) {
    let mut rows = [[0.0; SIDE_BY_SIDE]; 27];
    for (cubes, out) in cubes.chunks(SIDE_BY_SIDE).zip(out.chunks_mut(SIDE_BY_SIDE)) {
        gather(data, dims, isovalue, cubes, &mut rows);
        let set = DeterminingSet::new(&rows.map(Row));
        let all = set
            .vertices
            .iter()
            .chain(set.edges.iter().flatten().flatten())
            .chain(&set.faces);
        for (n, row) in all.enumerate() {
            out.iter_mut().zip(&row.0).for_each(|(to, v)| to[n] = *v as f32);
        }
    }
}
