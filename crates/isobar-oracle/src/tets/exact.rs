//! The stay of a ray in one closed tetrahedron and s - c on it, in integers.
//!
//! All coordinates are made integers by one power of two, the values and c by another. The face opposite corner k has the plane `N_k . x = N_k . p_a`, turned so that
//! corner k lies on its positive side; `L_k(t) = N_k . (o - p_a) + t N_k . d` is six times the volume times the barycentric coordinate k at `o + t d`.
//! So the stay is where all `L_k >= 0`, and `F(t) = sum_k (v_k - c) L_k(t)` is six times the volume times s - c.

use crate::exact::{Dyadic, Ratio, sign};
use dashu_int::IBig;
use isobar_core::{DVec3, Ray};

/// A cell that the ray meets, perhaps in a point only.
#[derive(Clone, Debug)]
pub(crate) struct ExactCell {
    pub(crate) cell: u32,
    pub(crate) t0: Ratio,
    pub(crate) t1: Ratio,
    /// F(t) = f0 + f1 t.
    f0: IBig,
    f1: IBig,
    /// Six times the volume times the greatest |v - c|; 0 where all values are c.
    most: IBig,
    /// The corner opposite a face by which the ray goes out, if not the end of its stay in what is looked at.
    pub(crate) out: Option<usize>,
}

/// Where s = c in a cell.
#[derive(Clone, Debug)]
pub(crate) enum Zero {
    /// Nowhere.
    None,
    /// At one t.
    At(Ratio),
    /// On all of its stay.
    All,
}

type V = [IBig; 3];

fn minus(a: &V, b: &V) -> V {
    std::array::from_fn(|i| &a[i] - &b[i])
}

fn cross(a: &V, b: &V) -> V {
    std::array::from_fn(|i| {
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        &a[j] * &b[k] - &a[k] * &b[j]
    })
}

fn dot(a: &V, b: &V) -> IBig {
    &a[0] * &b[0] + &a[1] * &b[1] + &a[2] * &b[2]
}

impl ExactCell {
    /// The stay in the closed cell within `stay` (from, to); `None` where there is none or the cell has no volume.
    pub(crate) fn new(
        ray: &Ray,
        cell: u32,
        corners: &[DVec3; 4],
        values: &[f64; 4],
        c: f64,
        (from, to): (&Ratio, Option<&Ratio>),
    ) -> Option<Self> {
        let all: Vec<Dyadic> = [&ray.origin, &ray.direction]
            .into_iter()
            .chain(corners)
            .flat_map(|v| v.to_array())
            .map(Dyadic::from_f64)
            .collect();
        let x = Dyadic::integers(&all);
        let v = |n: usize| -> V { std::array::from_fn(|i| x[3 * n + i].clone()) };
        let (o, d, p) = (v(0), v(1), [v(2), v(3), v(4), v(5)]);
        let volume = dot(&minus(&p[3], &p[0]), &cross(&minus(&p[1], &p[0]), &minus(&p[2], &p[0])));
        if volume.is_zero() {
            return None;
        }
        let numbers: Vec<Dyadic> = values.iter().chain([&c]).map(|&v| Dyadic::from_f64(v)).collect();
        let numbers = Dyadic::integers(&numbers);
        let (mut t0, mut t1, mut out) = (from.clone(), to.cloned(), None);
        let (mut f0, mut f1, mut most) = (IBig::ZERO, IBig::ZERO, IBig::ZERO);
        for k in 0..4 {
            let [a, b, e] = [(k + 1) % 4, (k + 2) % 4, (k + 3) % 4];
            let mut n = cross(&minus(&p[b], &p[a]), &minus(&p[e], &p[a]));
            if sign(&dot(&n, &minus(&p[k], &p[a]))) < 0 {
                n = n.map(|v| -v);
            }
            let (l0, l1) = (dot(&n, &minus(&o, &p[a])), dot(&n, &d));
            let g = &numbers[k] - &numbers[4];
            f0 += &g * &l0;
            f1 += &g * &l1;
            most = most.max(if sign(&g) < 0 { -g } else { g });
            match sign(&l1) {
                0 if sign(&l0) < 0 => return None,
                0 => {}
                1 => t0 = t0.max(Ratio::new(-l0, l1)),
                _ => {
                    let t = Ratio::new(-l0, l1);
                    if t1.as_ref().is_none_or(|u| t.compare(u).is_lt()) {
                        (t1, out) = (Some(t), Some(k));
                    }
                }
            }
        }
        let t1 = t1?;
        let most = most * if sign(&volume) < 0 { -volume } else { volume };
        t0.compare(&t1).is_le().then_some(Self {
            cell,
            t0,
            t1,
            f0,
            f1,
            most,
            out,
        })
    }

    /// Whether the ray only touches the cell.
    pub(crate) fn is_point(&self) -> bool {
        self.t0.compare(&self.t1).is_eq()
    }

    /// Where s = c.
    pub(crate) fn zero(&self) -> Zero {
        if self.f1.is_zero() {
            return if self.f0.is_zero() { Zero::All } else { Zero::None };
        }
        let t = Ratio::new(-&self.f0, self.f1.clone());
        if t.compare(&self.t0).is_lt() || t.compare(&self.t1).is_gt() {
            return Zero::None;
        }
        Zero::At(t)
    }

    /// Sign of ds/dt.
    pub(crate) fn rise(&self) -> i32 {
        sign(&self.f1)
    }

    /// s - c over the greatest |v - c| at an end, rounded.
    pub(crate) fn share(&self, t: &Ratio) -> f64 {
        if self.most.is_zero() {
            return 0.0;
        }
        let n = &self.f0 * &t.d + &self.f1 * &t.n;
        Ratio::new(n, &self.most * &t.d).bounds().0
    }
}
