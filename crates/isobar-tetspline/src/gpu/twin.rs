//! The kernels' CPU twins, for tests: the same numbers in f32, bit by bit.

use super::layout::Level;
use crate::classify::Rule;
use isobar_core::Tetrahedral as _;
use isobar_fields::Type6Spline;
use isobar_fields::type6::{DeterminingSet, Number};
use std::ops::{Add, Mul, Sub};

/// f32 as a number of the rules.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Single(f32);

impl Add for Single {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Self(self.0 + o.0)
    }
}
impl Sub for Single {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        Self(self.0 - o.0)
    }
}
impl Mul for Single {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        Self(self.0 * o.0)
    }
}
impl Number for Single {
    fn small(k: i32) -> Self {
        Self(k as f32)
    }
    fn half(self) -> Self {
        Self(0.5 * self.0)
    }
}

/// As in `tet_cube.wgsl`.
const SLACK: f32 = 3.814_697_3e-6;

/// What the lists of a volume should hold.
#[derive(Debug)]
pub(super) struct Twin {
    spline: Type6Spline,
    levels: Vec<Level>,
    bias: [f32; 2],
    rule: Rule,
}

fn hull(v: impl IntoIterator<Item = f32>) -> [f32; 2] {
    v.into_iter()
        .fold([f32::INFINITY, f32::NEG_INFINITY], |[a, b], v| [a.min(v), b.max(v)])
}

impl Twin {
    pub(super) fn new(spline: Type6Spline, levels: Vec<Level>, bias: [f32; 2], rule: Rule) -> Self {
        Self {
            spline,
            levels,
            bias,
            rule,
        }
    }

    fn data(&self, cube: u32) -> [Single; 27] {
        let n = self.spline.dims();
        let i = cube as usize;
        let mut d = [0.0; 27];
        self.spline.data([i % n[0], i / n[0] % n[1], i / (n[0] * n[1])], &mut d);
        d.map(|v| Single((v as f32 - self.bias[0]) - self.bias[1]))
    }

    fn meets(&self, [lo, hi]: [f32; 2], scale: f32, slack: f32) -> bool {
        self.levels.iter().any(|l| {
            let v = l.value * scale;
            lo - slack <= v && v <= hi + slack
        })
    }

    /// K10: the kinds of a cube.
    pub(super) fn kinds(&self, cube: u32) -> u32 {
        let d = self.data(cube);
        let [lo, hi] = hull(d.map(|v| v.0));
        let slack = 192.0 * (SLACK * lo.abs().max(hi.abs()));
        let set = DeterminingSet::new(&d);
        (0..24).fold(0, |mask, k| {
            let b = hull(set.coefficients(k).map(|v| v.0));
            mask | u32::from(self.meets(b, 192.0, slack)) << k
        })
    }

    /// K8: the class of a cube.
    pub(super) fn is_active(&self, cube: u32) -> bool {
        let d = self.data(cube);
        let data = hull(d.map(|v| v.0));
        let slack = SLACK * data[0].abs().max(data[1].abs());
        match self.rule {
            Rule::Data => self.meets(data, 1.0, slack),
            Rule::Coefficients => self.meets(data, 1.0, slack) && self.kinds(cube) != 0,
            Rule::DeterminingSet => {
                let s = DeterminingSet::new(&d);
                let all = s.vertices.iter().chain(s.edges.iter().flatten().flatten()).chain(&s.faces);
                self.meets(hull(all.map(|v| v.0)), 192.0, 0.0)
            }
        }
    }

    /// K9, K10: Q_active and the 24 lists T_active of a range of cubes.
    pub(super) fn lists(&self, range: std::ops::Range<u32>) -> (Vec<u32>, Vec<Vec<u32>>) {
        let cubes: Vec<u32> = range.filter(|&c| self.is_active(c)).collect();
        let masks: Vec<u32> = cubes.iter().map(|&c| self.kinds(c)).collect();
        let of = |k: usize| {
            cubes
                .iter()
                .zip(&masks)
                .filter(|(_, m)| **m >> k & 1 == 1)
                .map(|(c, _)| *c)
                .collect()
        };
        let tets = (0..24).map(of).collect();
        (cubes, tets)
    }

    /// A determining set as it is stored.
    pub(super) fn set(&self, cube: u32) -> Vec<f32> {
        let s = DeterminingSet::new(&self.data(cube));
        let all = s.vertices.iter().chain(s.edges.iter().flatten().flatten()).chain(&s.faces);
        all.map(|v| v.0).collect()
    }
}
