//! A ray in the local coordinates of a domain, exactly, and its exact stay in each cell.
//!
//! Per axis `v = (p + q t)/d` with integers p, q and d > 0. For lattices v is the local coordinate plus 1/2 where cells are centred on
//! samples, so that cell i spans `[i, i + 1]`; otherwise v is the local coordinate. The local coordinates are
//! `adj(A) (o - origin + t dir) / det(A)` with the bits of the domain's `axes` taken as exact numbers.
//!
//! **Which cell a point belongs to.** Each t of the closed stay in the domain belongs to exactly one cell: the one the ray is in just after
//! t (per axis: `floor(v)` where q >= 0, `ceil(v) - 1` where q < 0), and at the domain's faces the nearest cell inside.

use super::number::{Dyadic, Ratio, gcd, sign};
use dashu_int::{IBig, ops::DivEuclid};
use isobar_core::{DVec3, Domain, Ray};
use std::cmp::Ordering;

/// See the module.
#[derive(Clone, Debug)]
pub(crate) struct ExactRay {
    p: [IBig; 3],
    q: [IBig; 3],
    d: [IBig; 3],
    /// The closed stay in the domain with t >= 0, `None` where there is none.
    pub(crate) stay: Option<(Ratio, Ratio)>,
}

/// A stay `[t0, t1)`, or `[t0, t1]` where it is closed.
#[derive(Clone, Debug)]
pub(crate) struct Span {
    /// First parameter.
    pub(crate) t0: Ratio,
    /// Last parameter, or the first that is outside.
    pub(crate) t1: Ratio,
    /// Whether t1 belongs to it.
    pub(crate) closed: bool,
}

impl ExactRay {
    /// Whether the numbers are finite and the direction is not zero.
    pub(crate) fn usable(ray: &Ray, domain: &Domain) -> bool {
        let boxed = domain.lo.is_finite() && domain.hi.is_finite();
        let map = domain.origin.is_finite() && domain.axes.is_finite();
        boxed && map && ray.origin.is_finite() && ray.direction.is_finite() && ray.direction != DVec3::ZERO
    }

    /// The ray in the coordinates of `domain`, with `v = u + 1/2` where `centred`. `None` where a number is not finite, the direction is
    /// zero, or the domain's axes are singular.
    pub(crate) fn new(ray: &Ray, domain: &Domain, centred: bool) -> Option<Self> {
        let (o, dir, origin) = (ray.origin, ray.direction, domain.origin);
        if !Self::usable(ray, domain) {
            return None;
        }
        let exact = |v: DVec3| v.to_array().map(Dyadic::from_f64);
        let columns = [
            exact(domain.axes.x_axis),
            exact(domain.axes.y_axis),
            exact(domain.axes.z_axis),
        ];
        let minor = |a: &[Dyadic; 3], b: &[Dyadic; 3]| -> [Dyadic; 3] {
            std::array::from_fn(|i| {
                let (j, k) = ((i + 1) % 3, (i + 2) % 3);
                a[j].times(&b[k]).plus(&a[k].times(&b[j]).negated())
            })
        };
        let dot = |a: &[Dyadic; 3], b: &[Dyadic; 3]| (0..3).fold(Dyadic::from_f64(0.0), |s, i| s.plus(&a[i].times(&b[i])));
        // Row a of the adjugate is the cross product of the other two columns.
        let rows: [[Dyadic; 3]; 3] = std::array::from_fn(|a| minor(&columns[(a + 1) % 3], &columns[(a + 2) % 3]));
        let det = dot(&rows[0], &columns[0]);
        if det.sign() == 0 {
            return None;
        }
        let (eo, eorigin, edir) = (exact(o), exact(origin), exact(dir));
        let from: [Dyadic; 3] = std::array::from_fn(|i| eo[i].plus(&eorigin[i].negated()));
        let mut this = Self {
            p: std::array::from_fn(|_| IBig::ZERO),
            q: std::array::from_fn(|_| IBig::ZERO),
            d: std::array::from_fn(|_| IBig::ONE),
            stay: None,
        };
        for (a, row) in rows.iter().enumerate() {
            let mut n = Dyadic::integers(&[dot(row, &from), dot(row, &edir), det.clone()]);
            if centred {
                // v = (p + q t)/d + 1/2
                n = vec![IBig::from(2) * &n[0] + &n[2], IBig::from(2) * &n[1], IBig::from(2) * &n[2]];
            }
            let g = IBig::from(gcd(&IBig::from(gcd(&n[0], &n[1])), &n[2]));
            let g = if sign(&n[2]) < 0 { -g } else { g };
            [this.p[a], this.q[a], this.d[a]] = std::array::from_fn(|i| &n[i] / &g);
        }
        this.stay = this.domain_stay(domain, centred);
        Some(this)
    }

    fn domain_stay(&self, domain: &Domain, centred: bool) -> Option<(Ratio, Ratio)> {
        let half = Dyadic::from_f64(if centred { 0.5 } else { 0.0 });
        let mut t0 = Ratio::from_f64(0.0);
        let mut t1: Option<Ratio> = None;
        for a in 0..3 {
            let lo = Dyadic::from_f64(domain.lo[a]).plus(&half).ratio();
            let hi = Dyadic::from_f64(domain.hi[a]).plus(&half).ratio();
            if self.q[a].is_zero() {
                let v = Ratio::new(self.p[a].clone(), self.d[a].clone());
                if v.compare(&lo).is_lt() || v.compare(&hi).is_gt() {
                    return None;
                }
                continue;
            }
            let (enter, leave) = if sign(&self.q[a]) > 0 { (lo, hi) } else { (hi, lo) };
            t0 = t0.max(self.crossing(a, &enter));
            let t = self.crossing(a, &leave);
            t1 = Some(match t1 {
                Some(o) => o.min(t),
                None => t,
            });
        }
        // The direction is not zero and the axes are regular, so some q is not zero.
        t1.filter(|t1| t0.compare(t1) != Ordering::Greater).map(|t1| (t0, t1))
    }

    /// t where `v_a = plane`; `q_a` is not 0.
    fn crossing(&self, a: usize, plane: &Ratio) -> Ratio {
        Ratio::new(&plane.n * &self.d[a] - &self.p[a] * &plane.d, &self.q[a] * &plane.d)
    }

    fn crossing_integer(&self, a: usize, plane: i64) -> Ratio {
        Ratio::new(IBig::from(plane) * &self.d[a] - &self.p[a], self.q[a].clone())
    }

    /// Direction of the ray along axis a: -1, 0, 1.
    pub(crate) fn direction(&self, a: usize) -> i32 {
        sign(&self.q[a])
    }

    /// `v - base` at t0 and t1 as numerators over a common positive denominator.
    pub(crate) fn ends(&self, a: usize, base: i64, t0: &Ratio, t1: &Ratio) -> (IBig, IBig, IBig) {
        let p = &self.p[a] - IBig::from(base) * &self.d[a];
        // (p + q n/m)/d = (p m + q n)/(d m)
        let e0 = (&p * &t0.d + &self.q[a] * &t0.n) * &t1.d;
        let e1 = (&p * &t1.d + &self.q[a] * &t1.n) * &t0.d;
        let f = &self.d[a] * &t0.d * &t1.d;
        let g = IBig::from(gcd(&IBig::from(gcd(&e0, &e1)), &f));
        (e0 / &g, e1 / &g, f / g)
    }

    /// The stay in a cell of a lattice of `cells`, `None` where no t belongs to it.
    pub(crate) fn span(&self, cell: [usize; 3], cells: [usize; 3]) -> Option<Span> {
        let (s0, s1) = self.stay.as_ref()?;
        let mut t0 = s0.clone();
        let mut t1: Option<Ratio> = None;
        for a in 0..3 {
            let (i, n) = (cell[a] as i64, cells[a] as i64);
            // The planes by which the ray comes in and goes out; none at the first and the last cell, where the domain's stay is the limit.
            let (enter, leave) = match self.direction(a) {
                1 => ((i > 0).then_some(i), (i + 1 < n).then_some(i + 1)),
                -1 => ((i + 1 < n).then_some(i + 1), (i > 0).then_some(i)),
                _ => {
                    let floor = (&self.p[a]).div_euclid(&self.d[a]);
                    let at = i64::try_from(&floor).unwrap_or(i64::MAX).clamp(0, n - 1);
                    if at != i {
                        return None;
                    }
                    (None, None)
                }
            };
            if let Some(plane) = enter {
                t0 = t0.max(self.crossing_integer(a, plane));
            }
            if let Some(plane) = leave {
                let t = self.crossing_integer(a, plane);
                t1 = Some(match t1 {
                    Some(o) => o.min(t),
                    None => t,
                });
            }
        }
        let (t1, closed) = match t1 {
            Some(t) if t.compare(s1) != Ordering::Greater => (t, false),
            _ => (s1.clone(), true),
        };
        match t0.compare(&t1) {
            Ordering::Less => Some(Span { t0, t1, closed }),
            Ordering::Equal if closed => Some(Span { t0, t1, closed }),
            _ => None,
        }
    }

    /// The cell t belongs to; with `before`, the one the ray is in just before t instead of just after. t lies in the stay.
    pub(crate) fn cell_at(&self, t: &Ratio, cells: [usize; 3], before: bool) -> [usize; 3] {
        std::array::from_fn(|a| {
            // v = (p d_t + q n_t)/(d d_t)
            let n = &self.p[a] * &t.d + &self.q[a] * &t.n;
            let d = &self.d[a] * &t.d;
            let floor = (&n).div_euclid(&d);
            let whole = &floor * &d == n;
            let direction = if before { -self.direction(a) } else { self.direction(a) };
            let i = if whole && direction < 0 { floor - IBig::ONE } else { floor };
            let i = i64::try_from(&i).unwrap_or(if sign(&i) < 0 { 0 } else { i64::MAX });
            usize::try_from(i.max(0)).unwrap_or(0).min(cells[a] - 1)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use isobar_core::DMat3;

    fn lattice(n: f64) -> Domain {
        Domain {
            origin: DVec3::ZERO,
            axes: DMat3::IDENTITY,
            lo: DVec3::ZERO,
            hi: DVec3::splat(n - 1.0),
        }
    }

    fn ray(o: [f64; 3], d: [f64; 3]) -> Ray {
        Ray {
            origin: o.into(),
            direction: d.into(),
        }
    }

    /// Every t of the stay lies in exactly one cell, also along faces, edges, diagonals and for rays that only touch.
    #[test]
    fn cells_partition_the_stay() {
        let cells = [3; 3];
        let rays = [
            ray([-1.0, 1.0, 2.0], [1.0, 0.0, 0.0]),
            ray([-1.0, 0.3, 0.4], [1.0, 0.1, 0.2]),
            ray([4.0, 4.0, 4.0], [-1.0, -1.0, -1.0]),
            ray([0.0, 3.0, 0.0], [1.0, -1.0, 0.0]),
            ray([-1.0, 1.0, 0.0], [1.0, -1.0, 0.0]), // touches the edge x = y = 0
            ray([1.0, 1.0, 1.0], [0.0, 0.0, -2.0]),
            ray([1.5, 1.5, 1.5], [0.3, -0.7, 0.1]),
        ];
        for (n, r) in rays.iter().enumerate() {
            for centred in [false, true] {
                let cells = cells.map(|c| c + usize::from(centred));
                let e = ExactRay::new(r, &lattice(4.0), centred).unwrap();
                let (s0, s1) = e.stay.clone().unwrap_or_else(|| panic!("ray {n} misses"));
                let mut spans = Vec::new();
                for k in 0..cells[2] {
                    for j in 0..cells[1] {
                        for i in 0..cells[0] {
                            if let Some(s) = e.span([i, j, k], cells) {
                                assert_eq!(e.cell_at(&s.t0, cells, false), [i, j, k]);
                                spans.push(s);
                            }
                        }
                    }
                }
                spans.sort_by(|a, b| a.t0.compare(&b.t0));
                assert!(spans[0].t0.compare(&s0).is_eq() && spans[spans.len() - 1].t1.compare(&s1).is_eq());
                assert!(
                    spans.windows(2).all(|w| w[0].t1.compare(&w[1].t0).is_eq() && !w[0].closed),
                    "ray {n}"
                );
                assert!(spans[spans.len() - 1].closed);
            }
        }
    }

    #[test]
    fn the_ends_are_exact_fractions() {
        let e = ExactRay::new(&ray([-1.0, 0.5, 0.5], [3.0, 0.0, 0.0]), &lattice(2.0), false).unwrap();
        let (a, b) = e.stay.clone().unwrap();
        assert!(a.compare(&Ratio::new(IBig::ONE, IBig::from(3))).is_eq());
        assert!(b.compare(&Ratio::new(IBig::from(2), IBig::from(3))).is_eq());
        let (e0, e1, f) = e.ends(0, 0, &a, &b);
        assert!(e0.is_zero() && e1 == f);
    }

    #[test]
    fn general_axes_are_inverted_exactly() {
        let domain = Domain {
            axes: DMat3::from_cols(
                DVec3::new(1.0, 1.0, 0.0),
                DVec3::new(-1.0, 2.0, 0.0),
                DVec3::new(0.25, 0.0, -3.0),
            ),
            ..lattice(3.0)
        };
        // world point of u = (1/2, 1, 2) + t e_x-column
        let o = domain.axes * DVec3::new(0.5, 1.0, 2.0);
        let e = ExactRay::new(
            &Ray {
                origin: o,
                direction: domain.axes.x_axis,
            },
            &domain,
            false,
        )
        .unwrap();
        assert_eq!(e.stay.unwrap().1.bounds(), (1.5, 1.5));
        assert!(e.q[1].is_zero() && e.q[2].is_zero());
    }
}
