//! Figure 6.1 of Steinberger 2010: the frustum form beside compositions, on the thesis's three algebraic surfaces at several viewport sizes; and how exact the
//! coefficients are. `cargo run --release -p isobar-octree --example frustum -- [REPEATS]`.
//!
//! Times are those of one thread, the least of the repeats, ways interleaved. Both use the thesis's 6 (d + 1) iterations of LR81, f32, and search from the near plane to the
//! far one. The thesis gives bars without numbers.

use isobar_core::{Algebraic, DVec3};
use isobar_octree::comparators::algebraic::{Composition, Extent, Surface, draw};
use isobar_octree::comparators::frustum::{Frustum, FrustumForm, weights};
use isobar_octree::compose::{Form, Scalar, compose};
use isobar_octree::figures::surfaces::{contenders, polynomial, view};
use isobar_octree::finders::Finder;
use isobar_poly::{Real, scaled};
use std::error::Error;
use std::ops::{Add, Mul, Sub};

const SIZES: [usize; 5] = [64, 128, 256, 512, 1024];

fn main() -> Result<(), Box<dyn Error>> {
    let repeats: usize = std::env::args().nth(1).map_or(Ok(5), |s| s.parse())?;
    println!(
        "surface  viewport  way                 preprocessing us  composition ns/ray  composition ms  root finding ms  frame ms  rays hit  pixels that differ from f64"
    );
    times::<1, 4>('a', repeats)?;
    times::<2, 7>('b', repeats)?;
    times::<3, 10>('c', repeats)?;
    println!("\nerror of Bernstein coefficients over the greatest of the polynomial, against 106-bit arithmetic; 4096 rays");
    println!("surface  way           f32: median      99 %   greatest   f64: median      99 %   greatest");
    errors::<1, 4>('a')?;
    errors::<2, 7>('b')?;
    errors::<3, 10>('c')
}

fn times<const D: usize, const M: usize>(letter: char, repeats: usize) -> Result<(), Box<dyn Error>> {
    let wide = Surface::<f64, D>::new(&polynomial(letter)?)?;
    for size in SIZES {
        let view = view(size);
        let robust = Finder::Robust { width: 1e-9 };
        let truth = draw::<f64, D, M>(&wide, &view, Composition::Axis, &robust, Extent::Planes)?;
        for c in contenders(letter, size, repeats)? {
            let d = &c.drawn;
            let footprint = view.footprint(8.0);
            let differ = (d.points.iter().zip(&truth.points))
                .filter(|(a, b)| a.is_finite() != b.is_finite() || (a.is_finite() && (**a - **b).length() > footprint))
                .count();
            let ms = |d: std::time::Duration| d.as_secs_f64() * 1e3;
            println!(
                "({letter})      {size:4}^2    {:18}  {:16.1}  {:18.1}  {:14.2}  {:15.2}  {:8.2}  {:8}  {differ:6}",
                c.how.name(),
                ms(d.preprocessing) * 1e3,
                ms(d.stages[3]) * 1e6 / d.composed.max(1) as f64,
                ms(d.stages[3]),
                ms(d.stages[4]),
                ms(d.total()),
                d.points.iter().filter(|p| p.is_finite()).count(),
            );
        }
    }
    Ok(())
}

/// A number of twice the digits of f64: the unevaluated sum of two.
#[derive(Clone, Copy)]
struct Wide(f64, f64);

fn two_sum(a: f64, b: f64) -> Wide {
    let s = a + b;
    let t = s - a;
    Wide(s, (a - (s - t)) + (b - t))
}

impl Add for Wide {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        let s = two_sum(self.0, o.0);
        let t = two_sum(self.1, o.1);
        let u = two_sum(s.0, s.1 + t.0);
        two_sum(u.0, u.1 + t.1)
    }
}

impl Sub for Wide {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        self + Self(-o.0, -o.1)
    }
}

impl Mul for Wide {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        let p = self.0 * o.0;
        let rest = self.0.mul_add(o.0, -p) + (self.0 * o.1 + self.1 * o.0);
        two_sum(p, rest)
    }
}

impl Scalar for Wide {
    const ZERO: Self = Self(0.0, 0.0);
    const ONE: Self = Self(1.0, 0.0);
}

/// The polynomial between two world points, from the terms in the world, in 106 bits, Bernstein form.
fn exact<const D: usize, const M: usize>(p: &Algebraic, near: DVec3, far: DVec3) -> [f64; M] {
    let n = D + 1;
    let mut f = vec![Wide::ZERO; n * n * n];
    for ([i, j, k], c) in p.terms.iter() {
        f[(usize::from(*i) * n + usize::from(*j)) * n + usize::from(*k)] = Wide(*c, 0.0);
    }
    let r = [0, 1, 2].map(|a| [Wide(near[a], 0.0), Wide(far[a], 0.0) - Wide(near[a], 0.0)]);
    let mut power = [Wide::ZERO; M];
    compose::<Wide, D>(Form::Pf, &f, &r, &mut power);
    // Bernstein coefficient i: the sum of (i over k) / (n over k) a_k.
    let choose = |n: usize, k: usize| (0..k).fold(1.0, |c, i| c * (n - i) as f64 / (i + 1) as f64);
    std::array::from_fn(|i| {
        let sum = (0..=i).fold(Wide::ZERO, |s, k| {
            let (num, den) = (choose(i, k), choose(M - 1, k));
            // The quotient with what its rounding leaves.
            let q = num / den;
            s + power[k] * Wide(q, (-q).mul_add(den, num) / den)
        });
        sum.0 + sum.1
    })
}

fn errors<const D: usize, const M: usize>(letter: char) -> Result<(), Box<dyn Error>> {
    let p = polynomial(letter)?;
    let view = view(64);
    let frustum = Frustum::around(&view, p.lo, p.hi).ok_or("the eye is outside")?;
    let form = FrustumForm::<f64, M>::new(|x| p.value(x), &frustum);
    let one = |how: Composition| -> Result<[[f64; 3]; 2], Box<dyn Error>> {
        Ok([
            quantiles::<f32, D, M>(&p, &frustum, &form, how)?,
            quantiles::<f64, D, M>(&p, &frustum, &form, how)?,
        ])
    };
    for how in [Composition::Frustum, Composition::Pf, Composition::Sb1, Composition::Axis] {
        let [a, b] = one(how)?;
        println!(
            "({letter})      {:12}  {:10.1e}  {:8.1e}  {:9.1e}    {:10.1e}  {:8.1e}  {:9.1e}",
            how.name(),
            a[0],
            a[1],
            a[2],
            b[0],
            b[1],
            b[2]
        );
    }
    Ok(())
}

/// Median, 99 % and greatest over rays of the worst coefficient's error.
fn quantiles<T: Scalar + Real, const D: usize, const M: usize>(
    p: &Algebraic,
    frustum: &Frustum,
    form: &FrustumForm<f64, M>,
    how: Composition,
) -> Result<[f64; 3], Box<dyn Error>> {
    let surface = Surface::<T, D>::new(p)?;
    let form = form.rounded::<T>();
    let (middle, half) = ((p.lo + p.hi) * 0.5, (p.hi - p.lo) * 0.5);
    let mut all = Vec::with_capacity(4096);
    for n in 0..4096u32 {
        let (u, v) = ((f64::from(n % 64) + 0.5) / 64.0, (f64::from(n / 64) + 0.5) / 64.0);
        let ends = frustum.ends(u, v);
        let want = exact::<D, M>(p, ends[0], ends[1]);
        let got = if how == Composition::Frustum {
            let mut b = form.ray(&weights(T::from_f64(u)), &weights(T::from_f64(v)));
            scaled::to_bernstein(&mut b);
            b
        } else {
            let [a, b] = ends.map(|x| ((x - middle) / half).to_array().map(T::from_f64));
            surface.composed(how, a, b).ok_or("the ends are apart")?
        };
        let size = want.iter().fold(0.0f64, |m, x| m.max(x.abs()));
        let worst = got.iter().zip(want).fold(0.0f64, |m, (g, w)| m.max((g.to_f64() - w).abs()));
        all.push(worst / size);
    }
    all.sort_by(f64::total_cmp);
    Ok([all[2047], all[4055], all[4095]])
}
