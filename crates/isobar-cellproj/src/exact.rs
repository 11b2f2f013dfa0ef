//! What floating point cannot decide, in integers: the volume of a cell, and where a ray meets s = c in a closed cell.
//!
//! All f64 are dyadic numbers, so after multiplication with one power of two they are integers and every determinant is exact. Slow (some
//! microseconds), used only where a proved bound leaves a sign open.

use dashu_int::IBig;
use dashu_int::ops::BitTest;
use isobar_core::{ClipPlane, DVec3, Ray};

type V = [IBig; 3];

/// Where the closed cell holds s = c on the ray, t >= 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Meeting {
    /// Nowhere.
    None,
    /// At one t, correct to one part in 2^52.
    At(f64),
    /// On a stretch, ends correct to one part in 2^52 (equal where the ray only touches the cell).
    Stretch(f64, f64),
}

/// Mantissa and exponent: `m * 2^e`.
fn decode(v: f64) -> (i64, i32) {
    let bits = v.to_bits();
    let exponent = ((bits >> 52) & 0x7ff) as i32;
    let fraction = (bits & ((1 << 52) - 1)) as i64;
    let (m, e) = if exponent == 0 {
        (fraction, -1074)
    } else {
        (fraction | 1 << 52, exponent - 1075)
    };
    if m == 0 {
        return (0, 0);
    }
    let zeros = m.trailing_zeros();
    let m = m >> zeros;
    (if v < 0.0 { -m } else { m }, e + zeros as i32)
}

/// Finite numbers times one power of two, as integers.
fn integers(values: &[f64]) -> Vec<IBig> {
    let decoded: Vec<(i64, i32)> = values.iter().map(|&v| decode(v)).collect();
    let least = decoded.iter().filter(|d| d.0 != 0).map(|d| d.1).min().unwrap_or(0);
    decoded
        .iter()
        .map(|&(m, e)| {
            if m == 0 {
                IBig::ZERO
            } else {
                IBig::from(m) << (e - least) as usize
            }
        })
        .collect()
}

fn minus(a: &V, b: &V) -> V {
    std::array::from_fn(|i| &a[i] - &b[i])
}

fn cross(a: &V, b: &V) -> V {
    [
        &a[1] * &b[2] - &a[2] * &b[1],
        &a[2] * &b[0] - &a[0] * &b[2],
        &a[0] * &b[1] - &a[1] * &b[0],
    ]
}

fn dot(a: &V, b: &V) -> IBig {
    &a[0] * &b[0] + &a[1] * &b[1] + &a[2] * &b[2]
}

fn sign(v: &IBig) -> i32 {
    if v.is_zero() {
        0
    } else if *v > IBig::ZERO {
        1
    } else {
        -1
    }
}

/// `n / d` rounded, both not negative and d not 0.
fn quotient(n: &IBig, d: &IBig) -> f64 {
    if n.is_zero() {
        return 0.0;
    }
    // 66 or 67 bits of the quotient.
    let shift = 66 - (n.bit_len() as i64 - d.bit_len() as i64);
    let q = if shift >= 0 {
        (n << shift as usize) / d
    } else {
        n / (d << (-shift) as usize)
    };
    let q = u128::try_from(q).unwrap_or(u128::MAX) as f64;
    // In two steps, so that neither power leaves the range of f64 before the product does.
    let half = -shift / 2;
    q * 2f64.powi(half.clamp(-1000, 1000) as i32) * 2f64.powi((-shift - half).clamp(-1000, 1000) as i32)
}

/// A rational `n / d`, d > 0.
#[derive(Clone)]
struct Ratio {
    n: IBig,
    d: IBig,
}

impl Ratio {
    fn new(n: IBig, d: IBig) -> Self {
        if sign(&d) < 0 { Self { n: -n, d: -d } } else { Self { n, d } }
    }

    fn less(&self, other: &Self) -> bool {
        &self.n * &other.d < &other.n * &self.d
    }

    /// Not negative.
    fn f64(&self) -> f64 {
        quotient(&self.n, &self.d)
    }
}

/// The sign of the volume of four points: that of `(p1 - p0) x (p2 - p0) . (p3 - p0)`.
pub(crate) fn volume_sign(p: &[DVec3; 4]) -> i32 {
    let all: Vec<f64> = p.iter().flat_map(|p| p.to_array()).collect();
    let x = integers(&all);
    let v = |n: usize| -> V { std::array::from_fn(|i| x[3 * n + i].clone()) };
    let e = [1, 2, 3].map(|n| minus(&v(n), &v(0)));
    sign(&dot(&cross(&e[0], &e[1]), &e[2]))
}

/// What clipping planes keep of a ray: from and to, exactly.
struct Kept {
    from: Ratio,
    to: Option<Ratio>,
}

impl Kept {
    /// `o`, `d`: the ray's origin and direction, and `one`: 1, in the same unit; `None` where nothing is kept.
    fn new(clips: &[ClipPlane], o: &V, d: &V, one: &IBig) -> Option<Self> {
        let (n, zero) = (IBig::ONE, IBig::ZERO);
        let mut out = Self {
            from: Ratio { n: zero, d: n },
            to: None,
        };
        for clip in clips {
            let [x, y, z] = clip.normal.to_array();
            let [x, y, z, distance] = integers(&[x, y, z, clip.distance]).try_into().ok()?;
            let normal = [x, y, z];
            // Kept where rest - t rate >= 0.
            let (rest, rate) = (distance * one - dot(&normal, o), dot(&normal, d));
            match sign(&rate) {
                0 if sign(&rest) < 0 => return None,
                0 => {}
                s => {
                    let t = Ratio::new(rest, rate);
                    if s < 0 {
                        if out.from.less(&t) {
                            out.from = t;
                        }
                    } else if out.to.as_ref().is_none_or(|u| t.less(u)) {
                        out.to = Some(t);
                    }
                }
            }
        }
        Some(out)
    }

    fn holds(&self, t: &Ratio) -> bool {
        !t.less(&self.from) && self.to.as_ref().is_none_or(|to| !to.less(t))
    }
}

/// Where the linear function with `values` at the corners is c on the part of the ray with t >= 0 inside the closed cell that the clipping planes keep, points on a plane
/// included.
pub(crate) fn meet(ray: &Ray, corners: &[DVec3; 4], values: &[f64; 4], c: f64, clips: &[ClipPlane]) -> Meeting {
    let all: Vec<f64> = [&ray.origin, &ray.direction]
        .into_iter()
        .chain(corners)
        .flat_map(|v| v.to_array())
        .chain([1.0])
        .collect();
    let x = integers(&all);
    let v = |n: usize| -> V { std::array::from_fn(|i| x[3 * n + i].clone()) };
    let (o, d, p) = (v(0), v(1), [v(2), v(3), v(4), v(5)]);
    let numbers: Vec<f64> = values.iter().copied().chain([c]).collect();
    let numbers = integers(&numbers);
    // Twice-signed distances from the faces, a + t b, at least 0 inside; s - c in the same unit is f0 + t f1.
    let mut inside: Vec<(IBig, IBig)> = Vec::with_capacity(4);
    let (mut f0, mut f1) = (IBig::ZERO, IBig::ZERO);
    for k in 0..4 {
        let [i, j, l] = [(k + 1) % 4, (k + 2) % 4, (k + 3) % 4];
        let mut n = cross(&minus(&p[j], &p[i]), &minus(&p[l], &p[i]));
        match sign(&dot(&n, &minus(&p[k], &p[i]))) {
            0 => return Meeting::None,
            -1 => n = n.map(|v| -v),
            _ => {}
        }
        let (a, b) = (dot(&n, &minus(&o, &p[i])), dot(&n, &d));
        let g = &numbers[k] - &numbers[4];
        f0 += &g * &a;
        f1 += &g * &b;
        inside.push((a, b));
    }
    let Some(kept) = Kept::new(clips, &o, &d, &x[18]) else {
        return Meeting::None;
    };
    if f1.is_zero() {
        return if f0.is_zero() { stay(&inside, kept) } else { Meeting::None };
    }
    let t = Ratio::new(-f0, f1);
    let holds = kept.holds(&t) && inside.iter().all(|(a, b)| sign(&(a * &t.d + b * &t.n)) >= 0);
    if holds { Meeting::At(t.f64()) } else { Meeting::None }
}

/// The stay of the ray in the closed cell, as far as it is kept.
fn stay(inside: &[(IBig, IBig)], kept: Kept) -> Meeting {
    let Kept { mut from, mut to } = kept;
    for (a, b) in inside {
        match sign(b) {
            0 if sign(a) < 0 => return Meeting::None,
            0 => {}
            s => {
                let t = Ratio::new(-a, b.clone());
                if s > 0 {
                    if from.less(&t) {
                        from = t;
                    }
                } else if to.as_ref().is_none_or(|u| t.less(u)) {
                    to = Some(t);
                }
            }
        }
    }
    match to {
        Some(to) if !to.less(&from) => Meeting::Stretch(from.f64(), to.f64()),
        _ => Meeting::None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const UNIT: [DVec3; 4] = [DVec3::ZERO, DVec3::X, DVec3::Y, DVec3::Z];

    fn ray(o: [f64; 3], d: [f64; 3]) -> Ray {
        Ray {
            origin: DVec3::from_array(o),
            direction: DVec3::from_array(d),
        }
    }

    /// hardcases E8: the cell with s = z seen along -z.
    #[test]
    fn the_unit_cell() {
        let s = [0.0, 0.0, 0.0, 1.0];
        let down = ray([0.25, 0.25, 2.0], [0.0, 0.0, -1.0]);
        assert_eq!(meet(&down, &UNIT, &s, 0.25, &[]), Meeting::At(1.75));
        assert_eq!(meet(&down, &UNIT, &s, 0.5, &[]), Meeting::At(1.5));
        assert_eq!(meet(&down, &UNIT, &s, 0.75, &[]), Meeting::None);
        // along an edge, through a corner, on the plane of a face, behind the origin
        assert_eq!(
            meet(&ray([0.0, 0.0, 2.0], [0.0, 0.0, -2.0]), &UNIT, &s, 1.0, &[]),
            Meeting::At(0.5)
        );
        assert_eq!(
            meet(&ray([0.0, 0.5, 2.0], [0.0, 0.0, -1.0]), &UNIT, &s, 0.0, &[]),
            Meeting::At(2.0)
        );
        assert_eq!(
            meet(&ray([0.25, 0.25, 0.1], [0.0, 0.0, -1.0]), &UNIT, &s, 0.25, &[]),
            Meeting::None
        );
        assert_eq!(meet(&down, &UNIT, &[3.0; 4], 3.0, &[]), Meeting::Stretch(1.5, 2.0));
        assert_eq!(
            meet(&ray([0.25, 0.25, 0.25], [0.0, 0.0, -1.0]), &UNIT, &[3.0; 4], 3.0, &[]),
            Meeting::Stretch(0.0, 0.25)
        );
        assert_eq!(meet(&down, &UNIT, &[3.0; 4], 3.5, &[]), Meeting::None);
    }

    /// hardcases E8 with a plane at z: a root on it is kept, one bit beyond is not; a stretch is cut.
    #[test]
    fn planes_are_decided_to_the_bit() {
        let s = [0.0, 0.0, 0.0, 1.0];
        let down = ray([0.25, 0.25, 2.0], [0.0, 0.0, -1.0]);
        let at = |normal: DVec3, distance: f64, values: &[f64; 4], c: f64| {
            let cap = false;
            let clip = ClipPlane { normal, distance, cap };
            meet(&down, &UNIT, values, c, &[clip])
        };
        assert_eq!(at(DVec3::Z, 0.25, &s, 0.25), Meeting::At(1.75));
        assert_eq!(at(DVec3::Z, 0.25f64.next_down(), &s, 0.25), Meeting::None);
        assert_eq!(at(-DVec3::Z * 3.0, -0.75, &s, 0.25), Meeting::At(1.75));
        assert_eq!(at(-DVec3::Z * 3.0, (-0.75f64).next_down(), &s, 0.25), Meeting::None);
        assert_eq!(at(DVec3::Z, 0.25, &[3.0; 4], 3.0), Meeting::Stretch(1.75, 2.0));
        assert_eq!(at(-DVec3::Z, -0.25, &[3.0; 4], 3.0), Meeting::Stretch(1.5, 1.75));
        assert_eq!(at(DVec3::Z, -0.25, &[3.0; 4], 3.0), Meeting::None);
        // Along the ray: all or nothing.
        assert_eq!(at(DVec3::X, 0.25, &s, 0.25), Meeting::At(1.75));
        assert_eq!(at(DVec3::X, 0.25f64.next_down(), &s, 0.25), Meeting::None);
    }

    #[test]
    fn a_ray_one_bit_outside_misses() {
        let s = [0.0, 0.0, 0.0, 1.0];
        let at = |x: f64| meet(&ray([x, 0.25, 2.0], [0.0, 0.0, -1.0]), &UNIT, &s, 0.0, &[]);
        assert_eq!((at(0.0), at(-f64::MIN_POSITIVE)), (Meeting::At(2.0), Meeting::None));
        assert_eq!((at(0.75), at(0.75 + f64::EPSILON)), (Meeting::At(2.0), Meeting::None));
    }

    #[test]
    fn volumes_have_signs() {
        let mut p = UNIT;
        assert_eq!(volume_sign(&p), 1);
        p.swap(0, 1);
        assert_eq!(volume_sign(&p), -1);
        let flat = [
            DVec3::splat(0.1),
            DVec3::splat(0.2),
            DVec3::splat(0.3),
            DVec3::new(1.0, 2.0, 5.0),
        ];
        assert_eq!(
            volume_sign(&flat),
            0,
            "0.1, 0.2 and 0.3 in all coordinates are collinear whatever their bits"
        );
        assert_eq!(volume_sign(&[p[0], p[1], p[2], p[2]]), 0);
    }

    #[test]
    fn quotients_are_rounded_well() {
        for (n, d) in [(1i64, 3i64), (10, 7), (1, 1 << 60), (i64::MAX, 3), (5, 5)] {
            let q = quotient(&IBig::from(n), &IBig::from(d));
            let want = n as f64 / d as f64;
            assert!((q - want).abs() <= 2.0 * f64::EPSILON * want, "{n}/{d}");
        }
    }
}
