//! The colour and opacity of a ray's stay in a cell: Roettger, Kraus, Ertl 2000, equation (1), for any piecewise linear transfer function.
//!
//! In a cell s is linear along the ray. Between the points of the transfer function extinction and colour are so too. Over a stretch of length L let
//! `T(u) = exp(-L (rho_0 u + (rho_1 - rho_0) u^2/2))`, J0 the integral of T over \[0, 1\] and J1 that of u T. The premultiplied colour of the volume-density
//! model (Williams and Max) is, by parts, `c_0 - c_1 T(1) + (c_1 - c_0) J0`; that of Wilhelms and Van Gelder, in which the colour shines without the
//! density (section 3: a differential colour vector E), is `L (c_0 J0 + (c_1 - c_0) J1)/unit`. Opacity is exact; J0 and J1 are Gauss-Legendre sums.
//!
//! **Error.** On a piece whose optical rate L rho is at most r the n-point rule is off by less than r^(2n) (n!)^4/((2n + 1) (2n)!^3) times a constant near 1: 3 points
//! below r = 0.1, 5 below 1 and 8 on pieces of at most 4 give less than 1e-12; what lies behind an optical depth of 40 (4e-18) is left out.

use isobar_core::TransferFunction;

/// What emits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Model {
    /// Extinction times colour.
    WilliamsMax,
    /// Colour per unit of the transfer function.
    WilhelmsVanGelder,
}

/// A transfer function between which nothing is but lines.
#[derive(Debug, Clone)]
pub(crate) struct Medium {
    /// Value, colour, extinction per world length.
    points: Vec<(f64, [f64; 3], f64)>,
    unit: f64,
    model: Model,
}

/// Nodes in [-1, 1] (positive half and 0) and weights.
const GAUSS3: [(f64, f64); 2] = [(0.0, 8.0 / 9.0), (0.774_596_669_241_483_4, 5.0 / 9.0)];
const GAUSS5: [(f64, f64); 3] = [
    (0.0, 0.568_888_888_888_888_9),
    (0.538_469_310_105_683, 0.478_628_670_499_366_47),
    (0.906_179_845_938_664, 0.236_926_885_056_189_08),
];
const GAUSS8: [(f64, f64); 4] = [
    (0.183_434_642_495_649_8, 0.362_683_783_378_362),
    (0.525_532_409_916_329, 0.313_706_645_877_887_27),
    (0.796_666_477_413_626_7, 0.222_381_034_453_374_48),
    (0.960_289_856_497_536_3, 0.101_228_536_290_376_26),
];

/// `exp(-L (r0 u + (r1 - r0) u^2/2))` over u in [0, 1], by its two rates.
#[derive(Debug, Clone, Copy)]
struct Transmittance {
    r0: f64,
    r1: f64,
}

impl Transmittance {
    fn at(&self, u: f64) -> f64 {
        (-(self.r0 * u + 0.5 * (self.r1 - self.r0) * u * u)).exp()
    }

    /// The integrals of T and u T over [0, 1].
    fn moments(&self) -> (f64, f64) {
        const DEPTH: f64 = 40.0;
        let rate = self.r0.max(self.r1);
        if rate < 0.1 {
            return self.rule(&GAUSS3, 0.0, 1.0);
        }
        if rate < 1.0 {
            return self.rule(&GAUSS5, 0.0, 1.0);
        }
        // Up to an optical depth of 40: r0 u + a u^2 = 40 with a = (r1 - r0)/2.
        let end = if 0.5 * (self.r0 + self.r1) <= DEPTH {
            1.0
        } else {
            let a = 0.5 * (self.r1 - self.r0);
            (2.0 * DEPTH / (self.r0 + (self.r0 * self.r0 + 4.0 * a * DEPTH).max(0.0).sqrt())).min(1.0)
        };
        let most = end * self.r0.max(self.r0 + (self.r1 - self.r0) * end);
        let pieces = (most * 0.25).ceil().clamp(1.0, 64.0);
        let (mut j0, mut j1) = (0.0, 0.0);
        for i in 0..pieces as usize {
            let (a, b) = self.rule(&GAUSS8, end * i as f64 / pieces, end * (i + 1) as f64 / pieces);
            (j0, j1) = (j0 + a, j1 + b);
        }
        (j0, j1)
    }

    fn rule(&self, nodes: &[(f64, f64)], a: f64, b: f64) -> (f64, f64) {
        let (middle, half) = (0.5 * (a + b), 0.5 * (b - a));
        let (mut j0, mut j1) = (0.0, 0.0);
        for &(x, w) in nodes {
            let mut add = |u: f64| {
                let t = w * self.at(u);
                (j0, j1) = (j0 + t, j1 + t * u);
            };
            add(middle + half * x);
            if x > 0.0 {
                add(middle - half * x);
            }
        }
        (half * j0, half * j1)
    }
}

impl Medium {
    pub(crate) fn new(transfer: &TransferFunction, model: Model) -> Self {
        let points = transfer
            .points
            .iter()
            .map(|&(v, c, d)| (v, c.map(f64::from), f64::from(d) / transfer.unit))
            .collect();
        Self {
            points,
            unit: transfer.unit,
            model,
        }
    }

    /// Colour and extinction at a value.
    pub(crate) fn at(&self, s: f64) -> ([f64; 3], f64) {
        let i = self.points.partition_point(|p| p.0 < s);
        let (first, last) = (&self.points[0], &self.points[self.points.len() - 1]);
        if i == 0 {
            return (first.1, first.2);
        }
        if i == self.points.len() {
            return (last.1, last.2);
        }
        let (a, b) = (&self.points[i - 1], &self.points[i]);
        let w = ((s - a.0) / (b.0 - a.0)).clamp(0.0, 1.0);
        (std::array::from_fn(|k| a.1[k] + w * (b.1[k] - a.1[k])), a.2 + w * (b.2 - a.2))
    }

    /// Whether values between the two certainly leave a ray as it is.
    pub(crate) fn is_clear(&self, lo: f64, hi: f64) -> bool {
        let shines = |c: [f64; 3]| self.model == Model::WilhelmsVanGelder && c != [0.0; 3];
        let clear = |(c, rho): ([f64; 3], f64)| rho == 0.0 && !shines(c);
        let from = self.points.partition_point(|p| p.0 <= lo);
        let to = self.points.partition_point(|p| p.0 < hi);
        clear(self.at(lo)) && clear(self.at(hi)) && self.points[from.min(to)..to].iter().all(|p| clear((p.1, p.2)))
    }

    /// Premultiplied colour and **minus the opacity** of a stretch of world length l on which s goes linearly from `front` to `back`.
    pub(crate) fn integrate(&self, front: f64, back: f64, l: f64) -> [f64; 4] {
        let mut out = [0.0, 0.0, 0.0, 1.0];
        if l <= 0.0 || l.is_nan() {
            return [0.0; 4];
        }
        let (lo, hi) = (front.min(back), front.max(back));
        let from = self.points.partition_point(|p| p.0 <= lo);
        let to = self.points.partition_point(|p| p.0 < hi);
        let mut a = (front, self.at(front));
        let inner = to.saturating_sub(from);
        for n in 0..=inner {
            let b = if n == inner {
                (back, self.at(back))
            } else {
                let p = if front <= back {
                    &self.points[from + n]
                } else {
                    &self.points[to - 1 - n]
                };
                (p.0, (p.1, p.2))
            };
            let length = if front == back {
                l
            } else {
                l * ((b.0 - a.0) / (back - front))
            };
            self.piece(a.1, b.1, length, &mut out);
            a = b;
        }
        [out[0], out[1], out[2], out[3] - 1.0]
    }

    /// Adds a stretch between two points of the transfer function behind what is there (colour, transmittance).
    fn piece(&self, (c0, rho0): ([f64; 3], f64), (c1, rho1): ([f64; 3], f64), l: f64, out: &mut [f64; 4]) {
        let t = Transmittance {
            r0: l * rho0,
            r1: l * rho1,
        };
        let shines = self.model == Model::WilhelmsVanGelder;
        if t.r0 == 0.0 && t.r1 == 0.0 && !shines {
            return;
        }
        let rest = t.at(1.0);
        let (j0, j1) = t.moments();
        for k in 0..3 {
            let step = c1[k] - c0[k];
            let colour = if shines {
                l / self.unit * (c0[k] * j0 + step * j1)
            } else {
                c0[k] * (1.0 - rest) + step * (j0 - rest)
            };
            out[k] += out[3] * colour;
        }
        out[3] *= rest;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn medium(points: &[(f64, [f32; 3], f32)], model: Model) -> Medium {
        Medium::new(
            &TransferFunction {
                points: points.to_vec(),
                unit: 1.0,
            },
            model,
        )
    }

    /// hardcases E5: constant and linear extinction.
    #[test]
    fn closed_forms() {
        let constant = medium(&[(0.0, [1.0, 0.5, 0.0], 0.75)], Model::WilliamsMax);
        let linear = medium(&[(0.0, [1.0; 3], 0.0), (1000.0, [1.0; 3], 1000.0)], Model::WilliamsMax);
        for l in [1e-6, 0.01, 0.3, 2.0, 50.0, 3000.0] {
            let alpha = -(-0.75f64 * l).exp_m1();
            let c = constant.integrate(3.0, 5.0, l);
            for (k, want) in [alpha, 0.5 * alpha, 0.0, -alpha].into_iter().enumerate() {
                assert!((c[k] - want).abs() < 1e-13, "{l}: {c:?}");
            }
            for (f, b) in [(0.0, 1.0), (2.0, 0.5), (0.3, 0.3), (0.0, 900.0)] {
                let alpha = -(-0.5f64 * l * (f + b)).exp_m1();
                let c = linear.integrate(f, b, l);
                // of one colour: as much colour as opacity
                assert!(
                    (c[3] + alpha).abs() < 1e-13 && (c[0] - alpha).abs() < 1e-11,
                    "{l} {f} {b}: {c:?} {alpha}"
                );
            }
        }
    }

    /// Against sums over 200000 slices.
    #[test]
    fn many_points_against_slices() {
        let points = [
            (0.0, [1.0, 0.0, 0.2], 0.0),
            (0.3, [0.2, 1.0, 0.0], 4.0),
            (0.35, [0.0, 0.3, 1.0], 0.5),
            (0.8, [1.0, 1.0, 0.0], 9.0),
        ];
        for model in [Model::WilliamsMax, Model::WilhelmsVanGelder] {
            let m = medium(&points, model);
            for (f, b, l) in [
                (-0.2, 1.1, 1.0),
                (0.9, 0.1, 0.4),
                (0.31, 0.34, 3.0),
                (0.5, 0.5, 0.2),
                (0.8, 0.3, 0.01),
            ] {
                let n = 200_000;
                let mut want = [0.0, 0.0, 0.0, 1.0];
                for i in 0..n {
                    let (c, rho) = m.at(f + (b - f) * (f64::from(i) + 0.5) / f64::from(n));
                    let step = l / f64::from(n);
                    let alpha = -(-rho * step).exp_m1();
                    let e = if model == Model::WilliamsMax { alpha } else { step };
                    for k in 0..3 {
                        want[k] += want[3] * c[k] * e;
                    }
                    want[3] *= 1.0 - alpha;
                }
                want[3] -= 1.0;
                let found = m.integrate(f, b, l);
                for k in 0..4 {
                    assert!((found[k] - want[k]).abs() < 3e-5, "{model:?} {f} {b} {l}: {found:?} {want:?}");
                }
            }
        }
    }

    /// The integrals of T do not depend on how the stretch is cut.
    #[test]
    fn a_stretch_is_the_sum_of_its_parts() {
        let points = [
            (0.0, [1.0, 0.0, 0.2], 0.0),
            (0.4, [0.2, 1.0, 0.0], 30.0),
            (1.0, [0.0, 0.3, 1.0], 700.0),
        ];
        for model in [Model::WilliamsMax, Model::WilhelmsVanGelder] {
            let m = medium(&points, model);
            for l in [1e-3, 0.1, 1.0, 9.0] {
                let whole = m.integrate(0.05, 0.95, l);
                let mut parts = [0.0, 0.0, 0.0, 1.0];
                for i in 0..37 {
                    let at = |i: i32| 0.05 + 0.9 * f64::from(i) / 37.0;
                    let p = m.integrate(at(i), at(i + 1), l / 37.0);
                    let t = parts[3];
                    parts = std::array::from_fn(|k| parts[k] + t * p[k]);
                }
                for k in 0..3 {
                    assert!((parts[k] - whole[k]).abs() < 1e-11, "{model:?} {l}: {parts:?} {whole:?}");
                }
                assert!((parts[3] - 1.0 - whole[3]).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn clear_ranges() {
        let m = medium(
            &[
                (0.0, [1.0; 3], 0.0),
                (1.0, [1.0; 3], 0.0),
                (2.0, [1.0; 3], 3.0),
                (3.0, [0.0; 3], 0.0),
            ],
            Model::WilliamsMax,
        );
        for (lo, hi, clear) in [
            (-1.0, 1.0, true),
            (0.2, 0.9, true),
            (0.5, 1.1, false),
            (1.0, 3.0, false),
            (3.0, 9.0, true),
            (-5.0, 9.0, false),
        ] {
            assert_eq!(m.is_clear(lo, hi), clear, "{lo} {hi}");
        }
        assert!(!medium(&[(0.0, [1.0; 3], 0.0)], Model::WilhelmsVanGelder).is_clear(0.0, 1.0));
    }
}
