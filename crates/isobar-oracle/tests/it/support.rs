//! A lattice with f64 coefficients, rays, and comparisons.

use isobar_core::{Algebraic, Basis1, DMat3, DVec3, Domain, Function, Interval, Lattice, Ray, Structure};
use isobar_fields::AlgebraicFunction;
use isobar_oracle::{AllRoots, Multiplicity, Oracle};
use std::sync::Arc;

/// A spline with its coefficients given directly, clamped at the border.
#[derive(Debug)]
pub(crate) struct Spline {
    pub(crate) dims: [usize; 3],
    pub(crate) coefficients: Vec<f64>,
    pub(crate) basis: &'static Basis1,
    pub(crate) domain: Domain,
}

impl Spline {
    /// Coefficients from a formula in index space.
    pub(crate) fn new(dims: [usize; 3], basis: &'static Basis1, f: impl Fn(f64, f64, f64) -> f64) -> Self {
        let mut coefficients = Vec::new();
        for k in 0..dims[2] {
            for j in 0..dims[1] {
                for i in 0..dims[0] {
                    coefficients.push(f(i as f64, j as f64, k as f64));
                }
            }
        }
        Self {
            dims,
            coefficients,
            basis,
            domain: Domain {
                origin: DVec3::ZERO,
                axes: DMat3::IDENTITY,
                lo: DVec3::ZERO,
                hi: DVec3::from_array(dims.map(|n| (n - 1) as f64)),
            },
        }
    }

    pub(crate) fn placed(mut self, origin: DVec3, axes: DMat3) -> Self {
        self.domain.origin = origin;
        self.domain.axes = axes;
        self
    }

    pub(crate) fn oracle(self, c: f64) -> Oracle {
        Oracle::new(Arc::new(self), c)
    }

    /// The polynomial factors of a coordinate: first coefficient and the weights (value, slope) at u.
    fn weights(&self, a: usize, u: f64) -> (isize, [f64; 4], [f64; 4]) {
        let b = self.basis;
        let shift = if b.centred { 0.5 } else { 0.0 };
        let cells = self.cells()[a] as f64;
        let cell = (u + shift).floor().clamp(0.0, cells - 1.0);
        let w = u + shift - cell;
        let first = if b.centred {
            cell as isize - 1
        } else {
            cell as isize + 1 - (b.degree as isize).div_euclid(2) - 1
        };
        let (mut v, mut d) = ([0.0; 4], [0.0; 4]);
        for j in 0..=b.degree {
            for k in 0..=b.degree {
                let m = f64::from(b.matrix[k][j]) / f64::from(b.denominator);
                v[j] += m * w.powi(k as i32);
                if k > 0 {
                    d[j] += m * k as f64 * w.powi(k as i32 - 1);
                }
            }
        }
        (first, v, d)
    }

    fn coefficient(&self, i: [isize; 3]) -> f64 {
        let c: [usize; 3] = std::array::from_fn(|a| i[a].clamp(0, self.dims[a] as isize - 1) as usize);
        self.coefficients[(c[2] * self.dims[1] + c[1]) * self.dims[0] + c[0]]
    }

    fn sum(&self, u: DVec3, derivative: Option<usize>) -> f64 {
        let w: [_; 3] = std::array::from_fn(|a| self.weights(a, u[a].clamp(self.domain.lo[a], self.domain.hi[a])));
        let pick = |a: usize, j: usize| if derivative == Some(a) { w[a].2[j] } else { w[a].1[j] };
        let n = self.basis.degree;
        let mut s = 0.0;
        for k in 0..=n {
            for j in 0..=n {
                for i in 0..=n {
                    let at = [w[0].0 + i as isize, w[1].0 + j as isize, w[2].0 + k as isize];
                    s += self.coefficient(at) * pick(0, i) * pick(1, j) * pick(2, k);
                }
            }
        }
        s
    }
}

impl Function for Spline {
    fn name(&self) -> String {
        format!("test spline of degree {}", self.basis.degree)
    }
    fn domain(&self) -> &Domain {
        &self.domain
    }
    fn value(&self, x: DVec3) -> f64 {
        self.sum(self.domain.local(x), None)
    }
    fn gradient(&self, x: DVec3) -> DVec3 {
        let u = self.domain.local(x);
        self.domain
            .world_gradient(DVec3::from_array([0, 1, 2].map(|a| self.sum(u, Some(a)))))
    }
    fn enclosure(&self, _: DVec3, _: DVec3) -> Interval {
        let cells = self.cells();
        self.range([0; 3], cells.map(|n| n - 1))
    }
    fn structure(&self) -> Structure<'_> {
        Structure::Lattice(self)
    }
}

impl Lattice for Spline {
    fn dims(&self) -> [usize; 3] {
        self.dims
    }
    fn basis(&self) -> &'static Basis1 {
        self.basis
    }
    fn stencil(&self, cell: [usize; 3], out: &mut [f64; 64]) {
        let n = self.basis.degree + 1;
        let before = self.basis.degree / 2;
        for k in 0..n {
            for j in 0..n {
                for i in 0..n {
                    let at = [(0, i), (1, j), (2, k)].map(|(a, d)| (cell[a] + d) as isize - before as isize);
                    out[(k * n + j) * n + i] = self.coefficient(at);
                }
            }
        }
    }
    fn range(&self, lo: [usize; 3], hi: [usize; 3]) -> Interval {
        let n = self.basis.degree as isize;
        let before = n / 2;
        let (mut a, mut b) = (f64::INFINITY, f64::NEG_INFINITY);
        for k in lo[2] as isize - before..=hi[2] as isize + n - before {
            for j in lo[1] as isize - before..=hi[1] as isize + n - before {
                for i in lo[0] as isize - before..=hi[0] as isize + n - before {
                    let c = self.coefficient([i, j, k]);
                    a = a.min(c);
                    b = b.max(c);
                }
            }
        }
        Interval::new(a, b)
    }
}

/// A polynomial on `[-half, half]^3`.
pub(crate) fn algebraic(terms: &[([u8; 3], f64)], half: f64) -> Oracle {
    let p = Algebraic {
        name: "test".into(),
        terms: terms.into(),
        lo: DVec3::splat(-half),
        hi: DVec3::splat(half),
    };
    Oracle::new(Arc::new(AlgebraicFunction::new(p).unwrap()), 0.0)
}

/// A synthetic field of the contract with its own isovalue.
pub(crate) fn field(name: &str) -> Oracle {
    let f = isobar_fields::analytic(name, &Default::default()).unwrap();
    Oracle::new(f.function, f.isovalue)
}

pub(crate) fn ray(o: [f64; 3], d: [f64; 3]) -> Ray {
    Ray {
        origin: o.into(),
        direction: d.into(),
    }
}

/// Roots as t minus `shift` with their multiplicity: 1, 2, 3...; 0 for a stretch.
pub(crate) fn list(all: &AllRoots, shift: f64) -> Vec<(f64, u32)> {
    assert!(all.unresolved.is_empty(), "{all:?}");
    all.roots
        .iter()
        .map(|r| {
            assert!(r.lo <= r.hi);
            let m = match r.multiplicity {
                Multiplicity::Simple => 1,
                Multiplicity::Even(m) | Multiplicity::Odd(m) => m,
                Multiplicity::Interval | Multiplicity::Unknown => 0,
            };
            (r.t() - shift, m)
        })
        .collect()
}

/// The roots along a ray that starts `shift` before t = 0 of the case: each in its bracket, up to the rounding of the expected number.
pub(crate) fn expect(o: &Oracle, r: &Ray, shift: f64, want: &[(f64, u32)], tolerance: f64) {
    let all = o.all(r);
    let got = list(&all, shift);
    assert_eq!(got.len(), want.len(), "{got:?}, not {want:?}");
    for ((root, g), w) in all.roots.iter().zip(&got).zip(want) {
        let slack = tolerance * (w.0.abs() + shift.abs());
        let inside = root.lo - slack <= w.0 + shift && w.0 + shift <= root.hi + slack;
        assert!(inside && g.1 == w.1, "{got:?}, not {want:?}");
        let ulp = root.hi.next_up() - root.hi;
        assert!(root.hi - root.lo <= (4.0 * ulp).max(1e-13 * root.hi), "{root:?}");
    }
    match (o.first(r).hit(), all.roots.first()) {
        (None, None) => {}
        (Some(h), Some(a)) => assert!(h.lo <= a.hi && a.lo <= h.hi && h.multiplicity == a.multiplicity),
        other => panic!("{other:?}"),
    }
}

/// A seeded generator (xorshift64*).
pub(crate) struct Random(pub(crate) u64);

impl Random {
    pub(crate) fn bits(&mut self) -> u64 {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        self.0.wrapping_mul(0x2545_F491_4F6C_DD1D)
    }
    /// In [0, 1).
    pub(crate) fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }
    pub(crate) fn within(&mut self, a: f64, b: f64) -> f64 {
        a + (b - a) * self.unit()
    }
    pub(crate) fn vector(&mut self, a: f64, b: f64) -> DVec3 {
        DVec3::new(self.within(a, b), self.within(a, b), self.within(a, b))
    }
    pub(crate) fn below(&mut self, n: u64) -> u64 {
        self.bits() % n
    }
}
